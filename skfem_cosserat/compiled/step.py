"""The loop of Newton's method over a step, compiled once for all scenes: it calls their parts."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import newton
from ..law import EPS
from ..types import Floats, IndexArray
from . import numbers as n
from .flow import BORDER, flow_velocity
from .jit import call, call_back, call_beams, call_with, inlined, part
from .simd import clear, copy
from .small import combination, mass_times
from .tables import MOST_XI


@inlined
def given(o: Any) -> Any:
    """Arguments of the parts of a scene: c of the functions below."""
    return o.parts, o.tree, o.plan, o.work, o.beams, o.numbers


@inlined
def ask(c: Any, k: int, flag: int) -> float:
    """Call a part and give its result; 0 for one that the scene does without."""
    p, s, m, w, _, numbers = c
    if p[k] == 0:
        return 0.0
    return call(p[k], s, m, w, numbers, flag)


@inlined
def ask_beams(c: Any, k: int, flag: int) -> None:
    """Call a part of beams, if there are any."""
    p, _, _, w, g, numbers = c
    if p[k] != 0:
        call_beams(p[k], g, w, numbers, flag)


@inlined
def ask_python(p: IndexArray, stage: int) -> None:
    """Call loads that are functions, if there are any."""
    if p[n.CALLED_BACK] != 0:
        call_back(p[n.CALLED_BACK], stage)


@inlined
def start(c: Any, guess: int) -> None:
    """Compute the quantities that stay fixed during a step, and its first increments."""
    p, _, _, w, _, numbers = c
    ask(c, n.BEGIN, guess)
    ask(c, n.JOINT_BEGIN, 0)
    if numbers[n.WEIGHT] == 0.0:
        ask(c, n.JOINT_MAPS, 0)
    if numbers[n.REACH] != 0.0:
        combination(1.0, w.y0, -numbers[n.REACH], w.drift, w.earlier)
    ask_beams(c, n.BEAM_START, 0)
    ask(c, n.COUPLE, 3)
    ask_python(p, n.AT_BEGIN)


@inlined
def evaluate(c: Any, sized: bool) -> float:
    """Add the increment x and evaluate; if asked, the size of the residual against its terms."""
    p, _, _, w, _, numbers = c
    ask(c, n.JOINT_ADD, 0)
    ask(c, n.MOVE, 0)
    ask(c, n.JOINT_MOVE, 0)
    combination(1.0 - numbers[n.SHARE], w.y0, numbers[n.SHARE], w.y1, w.mid)
    if numbers[n.REACH] != 0.0:
        combination(2.0, w.mid, -1.0, w.earlier, w.later)
    clear(w.internal)
    ask_beams(c, n.BEAM_FORCE, 0)
    ask(c, n.COUPLE, 0)
    ask(c, n.LOAD, 0)
    ask_python(p, n.AT_FORCE)
    ask(c, n.FLOW, 0)
    clear(w.closing)
    gap = ask(c, n.ROW_FORCE, 0)
    largest = ask(c, n.BALANCE, 2 * int(sized))
    if numbers[n.WEIGHT] != 0.0:
        ask(c, n.JOINT_MAPS, 0)
    ask(c, n.JOINT_REDUCE, 0)
    if not sized:
        return 0.0
    size = ask(c, n.SIZE, 0)
    if largest > 0.0:
        size /= largest
    # NaN is one of both if it is in their sum
    return max(gap, size) if gap + size < np.inf else gap + size


@inlined
def matrix(c: Any, mixed: int) -> bool:
    """Factorise the tangent where the residual was evaluated; False if it is singular."""
    p, _, _, w, _, _ = c
    ask(c, n.CLEAR, 0)
    ask_beams(c, n.BEAM_TANGENT, mixed)
    if mixed and p[n.PREDICT_CHANGES]:
        # R and the forces of subtrees with the predicted stresses: multipliers take none
        clear(w.R_mixed)
        ask_beams(c, n.BEAM_FORCE, 1)
        ask(c, n.COUPLE, 2)
        ask_python(p, n.AT_PREDICTED)
        ask(c, n.BALANCE, 1)
        ask(c, n.JOINT_REDUCE, 1)
    ask(c, n.LOAD, 1)
    ask(c, n.COUPLE, 1)
    ask_python(p, n.AT_MATRIX)
    ask(c, n.NODAL_MASS_MATRIX, 0)
    ask(c, n.FLOW_MATRIX, 0)
    ask(c, n.NODE_MATRIX, mixed)
    ask(c, n.JOINT_MAPS, 1)
    ask(c, n.JOINT_CURVATURE, mixed)
    ask(c, n.ROW_MATRIX, 0)
    ask(c, n.HOLD, 0)
    if ask(c, n.FACTOR, 0) == 0.0:
        return False
    if p[n.FLOW]:
        border(c)
    return True


@inlined
def border(c: Any) -> None:
    """Motions by the columns of the border, for new factors; they are kept with these."""
    _, _, _, w, _, _ = c
    for k in range(w.flow.begin[0], BORDER):
        ask(c, n.FLOW_COLUMN, k)
        ask(c, n.JOINT_REDUCE, 0)
        ask(c, n.SWEEP, 0)
        ask(c, n.FLOW_KEEP, k)


# -- the loop over the iterations, whose stages are above and here, and what comes after it --------


@inlined
def increment(c: Any, kept: bool) -> tuple[float, float, int]:
    """Increment x for the residual and the factors there are, its size before it was capped.

    As :func:`skfem_cosserat.newton.newton_loop` asks for it. If the next matrix is to be taken with
    the stresses that it predicts, they are ready then.
    """
    p, _, _, w, _, _ = c
    ask(c, n.SWEEP, int(kept))
    ask(c, n.FLOW_CORRECT, 0)
    size = ask(c, n.CAP, 0)
    if w.found[1] != 0.0 and p[n.BEAM_PREDICTED]:
        ask(c, n.PREDICT_CHANGES, 0)
        ask_beams(c, n.BEAM_PREDICTED, 0)
    else:
        w.found[1] = 0.0
    return size, w.found[0], int(w.found[1])


@inlined
def advance(c: Any, sized: bool, before: float) -> float:
    """Evaluate after the increment: parts of the evaluation move by it."""
    return evaluate(c, sized)


loop = newton.newton_loop(evaluate, matrix, increment, advance, inlined)


@inlined
def accepted(c: Any, record: Floats) -> bool:
    """Finish a step, and keep what the next one starts with; False: it ended on another branch."""
    _, _, _, _, _, numbers = c
    if ask(c, n.ROW_BRANCH, 0) != 0.0:
        return False
    record[n.WORK] = ask(c, n.FINISH, 0)
    kept = numbers[n.REUSE] > 0.0
    record[n.KEPT] = 1.0 if kept else 0.0
    better = ask(c, n.BETTER, int(record[n.KNOWN]))
    record[n.GUESS] = better if kept else 1.0
    record[n.KNOWN] = min(record[n.KNOWN] + 1.0, 2.0)
    return True


@inlined
def solve_one(c: Any, record: Floats) -> bool:
    """Solve a step, with the factors of earlier matrices as long as they do; False: not found."""
    _, _, _, _, _, numbers = c
    start(c, int(record[n.GUESS]))
    limits = newton.Limits(
        numbers[n.LIMIT],
        numbers[n.ROTATION],
        numbers[n.MIXED],
        numbers[n.REUSE],
        numbers[n.LARGEST],
        numbers[n.INCREMENT],
        numbers[n.NEGLIGIBLE],
        numbers[n.STAGNATION],
        numbers[n.WORTH],
        newton.WRONG,
    )
    return loop(c, limits, record) == newton.SETTLED and accepted(c, record)


# -- quantities carried on beside the configuration: momenta, rates, and moves of velocities -------
#
# All is by rows of y, whatever the unknowns of a step are. Numbers of a scheme are explained where
# it is defined, in integrators/scheme.py.


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
        record[n.WORK] += coupled[c, n.PUSHED]
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


@part
def solve(steps: Any, flag: int) -> float:
    """Solve as many steps as are asked for, each from where the last one ended, and keep them.

    It ends early where the caller has to look: after a step that takes many iterations, after
    motions of closed loops, where velocities are left to be moved, or where loads are not known. 0:
    the last one tried was not found; it starts where y_0, p_0 and the rates are then. For what is
    in ``steps.numbers`` and ``steps.record`` see :mod:`.numbers`.
    """
    p, w, numbers, record, o = (
        steps.parts,
        steps.work,
        steps.numbers,
        steps.record,
        steps.carried,
    )
    looped = record[n.CLEARANCE] < np.inf
    for k in range(n.DONE, n.CLEARANCE):
        record[k] = 0.0
    while True:
        begin_rates(o)
        solved = solve_one(given(steps), record)
        record[n.ALL_FACTORED] += record[n.FACTORED]
        if looped:
            record[n.TRAVELLED] += w.found[0]
        if not solved:
            return 0.0
        record[n.DONE] += 1.0
        finish_rates(o, numbers, record)
        stay_in_plane(o)
        keep(o, w.coupled, numbers, record)
        if record[n.DONE] >= record[n.ASKED] or record[n.FACTORED] > n.SHORT:
            return 1.0
        if record[n.UNMOVED] > 0.0:
            return 1.0
        if looped and (w.found[1] >= n.SHORT_WAY or record[n.TRAVELLED] >= record[n.CLEARANCE]):
            return 1.0
        go_on(o, w.coupled)
        if record[n.VARYING] != 0.0 and call_back(p[n.NEXT_LOADS], int(record[n.DONE])) == 0.0:
            return 1.0
