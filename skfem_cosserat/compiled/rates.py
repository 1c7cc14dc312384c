"""Quantities carried on beside the configuration: momenta, rates, and moves of velocities.

All is by rows of y, whatever the unknowns of a step are: these functions serve steps with the null
space and with multipliers. Numbers of a scheme are explained where it is defined,
:mod:`skfem_cosserat.integrators.scheme`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..law import EPS
from ..types import Floats
from . import numbers as n
from .flow import flow_velocity
from .jit import call_with, inlined
from .simd import copy
from .small import mass_times
from .tables import MOST_XI


@inlined
def sum_rates(weights: Floats, rates: Floats, rows: int, out: Floats) -> None:
    """``out = sum w_k rates_k``, of its first rows."""
    for r in range(rows):
        for c in range(3):
            total = 0.0
            for k in range(len(weights)):
                total += weights[k] * rates[k * rows + r, c]
            out[r, c] = total


@inlined
def begin_rates(o: Any) -> None:
    """Set the momentum p_0 to that of the carried rates, if the scheme has weights for it.

    Sum up what is known of the velocity at the end, too, which dampers need.
    """
    rows = o.scratch.shape[0]
    if len(o.drift) > 0:
        sum_rates(o.of_drift, o.rates, rows, o.drift)
    if len(o.before) > 0:
        sum_rates(o.before, o.rates, rows, o.scratch)
        mass_times(o, 1.0, o.scratch, o.p0)


@inlined
def finish_rates(o: Any, numbers: Floats, record: Floats) -> None:
    """Rates at the end, and velocities moved onto the hidden constraints if they are to be."""
    table, rates, after, y0, y1, carried = o.table, o.rates, o.after, o.y0, o.y1, o.carried
    rows, count = carried.shape[0], table.shape[0]
    record[n.TAKEN], record[n.UNMOVED] = 0.0, 0.0
    for i in range(count):
        for r in range(rows):
            for c in range(3):
                total = table[i, 0] * (y1[r, c] - y0[r, c])
                for k in range(count):
                    total += table[i, 1 + k] * rates[k * rows + r, c]
                after[i * rows + r, c] = total
    if len(o.flow.owner) > 0:
        record[n.TAKEN] = flow_velocity(o.flow, o)
    if len(o.before) > 0:
        mass_times(o, 1.0, after, carried)
    if len(o.moved) == 0:
        return
    if o.nearest[0] == 0:
        record[n.UNMOVED] = 1.0
        return
    v, new, change = o.velocity, o.scratch, o.change
    copy(y1, o.near_y)
    copy(carried, o.near_p)
    if call_with(o.nearest[0], o.nearest[1]) == 0.0:
        record[n.UNMOVED] = 1.0
        return
    mass_times(o, 1.0, v, new)
    early, lost = numbers[n.WEIGHT] == 0.0, 0.0
    for r in range(rows):
        for c in range(3):
            change[r, c] = new[r, c] - carried[r, c]
            if early:  # of the constraint force of this node, which the next step finds
                after[r, c] = -change[r, c]
            else:
                lost += after[r, c] * carried[r, c] - v[r, c] * new[r, c]
                move = v[r, c] - after[r, c]
                for i in range(count):
                    after[i * rows + r, c] += o.moved[i] * move
            carried[r, c] = new[r, c]
    if not early and numbers[n.SHARE] < 1.0:
        record[n.TAKEN] += 0.5 * lost


@inlined
def flatten(normal: Floats, a: Floats, limit: float) -> None:
    """Take away what leads out of a plane, but where more than a limit, rounding, does."""
    for r in range(a.shape[0]):
        out = abs(normal[0] * a[r, 0] + normal[1] * a[r, 1] + normal[2] * a[r, 2])
        if not out <= limit:
            return
    for r in range(a.shape[0]):
        out = normal[0] * a[r, 0] + normal[1] * a[r, 1] + normal[2] * a[r, 2]
        for c in range(3):
            a[r, c] -= out * normal[c]


@inlined
def stay_in_plane(o: Any) -> None:
    """Take away what rounding has led out of the plane of a scene, which might grow there."""
    normal, y0, y1, carried, after, largest = o.normal, o.y0, o.y1, o.carried, o.after, 0.0
    if len(normal) == 0:
        return
    for r in range(carried.shape[0]):  # rows of the ground may be angles, prescribed
        out = 0.0
        for c in range(3):
            out += normal[c] * (y1[r, c] - y0[r, c])
        for c in range(3):
            y1[r, c] -= out * normal[c]
            if abs(normal[c]) == 1.0:  # without a last digit
                y1[r, c] = y0[r, c]
    flatten(normal, carried, 4.0 * EPS * o.limit[0])  # forces along directors have a share, too
    for r in range(after.shape[0]):
        for c in range(3):
            largest = max(largest, abs(after[r, c]))
    flatten(normal, after, 4.0 * EPS * largest)


@inlined
def keep(o: Any, coupled: Floats, numbers: Floats, record: Floats) -> None:
    """Keep what a step has found: the state at its end, and the impulse of its constraints.

    ``h G^T lambda`` is what balances the step, and what moved its velocities: at the node of the
    start that is what the step before has left.
    """
    for i in range(n.ACTUATORS, n.BY_SCHEME + 1):
        record[i] = 0.0
    record[n.DISSIPATED] = record[n.BY_SCHEME] = record[n.TAKEN]
    for c in range(coupled.shape[0]):
        record[n.DISSIPATED] += coupled[c, n.LOST]
        record[n.BY_SCHEME] += coupled[c, n.NUMERICAL]
        record[n.BY_GROUND] += coupled[c, n.GROUND]
        for i in range(MOST_XI):
            record[n.ACTUATORS] += coupled[c, n.AMPLITUDE + i] * coupled[c, n.TRAVEL + i]
    viscous = 0.0
    for g in range(o.viscous.shape[0]):
        viscous += o.viscous[g, n.VISCOUS_WORK]
    if viscous * o.size[0] > 0.0:  # a step back gives what was lost
        record[n.DISSIPATED] += viscous
    k, early, moved = int(record[n.DONE]) - 1, numbers[n.WEIGHT] == 0.0, len(o.moved) > 0
    for i in range(len(n.LOGGED)):
        o.log_numbers[k, i] = record[n.LOGGED[i]]
    for c in range(coupled.shape[0]):
        o.log_turns[k, c] = coupled[c, n.TURNED]
    R, closing, change, rates, after = o.R, o.closing, o.change, o.rates, o.after
    q, p, impulse, log_rates, y1, carried = (
        o.log_q,
        o.log_p,
        o.log_impulse,
        o.log_rates,
        o.y1,
        o.carried,
    )
    rows = R.shape[0]
    for r in range(rows):
        for c in range(3):
            q[k, r, c], p[k, r, c], impulse[k, r, c] = y1[r, c], carried[r, c], -R[r, c]
    for r in range(closing.shape[0]):
        for c in range(3):
            impulse[k, r, c] += closing[r, c]
    if moved and record[n.UNMOVED] == 0.0:
        for r in range(rows):
            for c in range(3):
                more = rates[r, c] if early else -o.moved_force[0] * change[r, c]
                impulse[k, r, c] += more
    for r in range(after.shape[0]):
        for c in range(3):
            log_rates[k, r, c] = after[r, c]


@inlined
def go_on(o: Any, coupled: Floats) -> None:
    """Start the next step where the last one ended."""
    for c in range(coupled.shape[0]):
        if coupled[c, n.WINDS] != 0.0:
            coupled[c, n.TURNS] = np.floor(coupled[c, n.TURNED] + 0.5)
    copy(o.y1, o.y0)
    copy(o.carried, o.p0)
    copy(o.after, o.rates)
