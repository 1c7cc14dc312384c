"""The loop of Newton's method over a step, compiled once for all scenes: it calls their parts."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import newton
from ..types import Floats, IndexArray
from . import numbers as n
from .flow import BORDER
from .jit import call, call_back, call_beams, inlined, part
from .rates import begin_rates, finish_rates, go_on, keep, stay_in_plane
from .simd import WIDTH, load, store

__all__ = ["evaluate", "increment", "matrix", "solve", "start"]


@inlined
def around_start(w: Any, reach: float) -> None:
    """The way of dampers at the start of a step, by the velocity there."""
    y0, mid, earlier, later = w.y0, w.mid, w.earlier, w.later
    for r in range(y0.shape[0]):
        for c in range(3):
            way = reach * w.rate0[r, c]
            earlier[r, c], mid[r, c], later[r, c] = y0[r, c] - way, y0[r, c], y0[r, c] + way


@inlined
def viscous_work(p: IndexArray, w: Any, g: Any, numbers: Floats) -> None:
    """What viscous sections take along a step, by their stresses at its end, then at its start."""
    y0, y1, mid, later = w.y0, w.y1, w.mid, w.later
    for stage in range(2):
        if stage:
            around_start(w, numbers[n.REACH])
            call_beams(p[n.BEAM_START], g, w, numbers, 0)
            call_beams(p[n.BEAM_FORCE], g, w, numbers, 2)
        for r in range(y0.shape[0]):
            for c in range(3):
                mid[r, c], later[r, c] = 0.5 * (y0[r, c] + y1[r, c]), y1[r, c]
        call_beams(p[n.BEAM_FORCE], g, w, numbers, 3)


@inlined
def at_start(p: IndexArray, s: Any, m: Any, w: Any, numbers: Floats) -> None:
    """Forces of dampers at the start, and where their way to the end begins."""
    y0, earlier, reach = w.y0, w.earlier, numbers[n.REACH]
    around_start(w, reach)
    if p[n.COUPLE]:
        call(p[n.COUPLE], s, m, w, numbers, 4)
    for r in range(y0.shape[0]):
        for c in range(3):
            earlier[r, c] = y0[r, c] - reach * w.drift[r, c]


@inlined
def start(p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats, guess: int) -> None:
    """What is fixed during a step, and the increments that it starts with."""
    call(p[n.BEGIN], s, m, w, numbers, guess)
    if p[n.JOINT_BEGIN]:
        call(p[n.JOINT_BEGIN], s, m, w, numbers, 0)
        if numbers[n.WEIGHT] == 0.0:
            call(p[n.JOINT_MAPS], s, m, w, numbers, 0)
    if numbers[n.REACH] != 0.0:
        at_start(p, s, m, w, numbers)
    if p[n.BEAM_START]:
        call_beams(p[n.BEAM_START], g, w, numbers, 0)
    if p[n.COUPLE]:
        call(p[n.COUPLE], s, m, w, numbers, 3)
    if p[n.CALLED_BACK]:
        call_back(p[n.CALLED_BACK], n.AT_BEGIN)


@inlined
def evaluate(p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats, sized: int) -> float:
    """Add the increment x and evaluate; if asked, the size of the residual against its terms."""
    if p[n.JOINT_ADD]:
        call(p[n.JOINT_ADD], s, m, w, numbers, 0)
    call(p[n.MOVE], s, m, w, numbers, 0)
    if p[n.JOINT_MOVE]:
        call(p[n.JOINT_MOVE], s, m, w, numbers, 0)
    y0, y1, mid, internal = w.y0, w.y1, w.mid, w.internal
    share = numbers[n.SHARE]
    for k in range(y1.size // WIDTH):
        store(mid, k, (1.0 - share) * load(y0, k) + share * load(y1, k))
    for r in range(max(len(y1) - 1, 0), len(y1)):  # what may be left
        for c in range(3):
            mid[r, c] = (1.0 - share) * y0[r, c] + share * y1[r, c]
    if numbers[n.REACH] != 0.0:
        earlier, later = w.earlier, w.later
        for r in range(later.shape[0]):
            for c in range(3):
                later[r, c] = 2.0 * mid[r, c] - earlier[r, c]
    for r in range(internal.shape[0]):
        for c in range(internal.shape[1]):
            internal[r, c] = 0.0
    if p[n.BEAM_FORCE]:
        call_beams(p[n.BEAM_FORCE], g, w, numbers, 0)
    if p[n.COUPLE]:
        call(p[n.COUPLE], s, m, w, numbers, 0)
    if p[n.LOAD]:
        call(p[n.LOAD], s, m, w, numbers, 0)
    if p[n.CALLED_BACK]:
        call_back(p[n.CALLED_BACK], n.AT_FORCE)
    if p[n.FLOW]:
        call(p[n.FLOW], s, m, w, numbers, 0)
    gap = 0.0
    if p[n.ROW_FORCE]:
        closing = w.closing
        for r in range(closing.shape[0]):
            for c in range(closing.shape[1]):
                closing[r, c] = 0.0
        if p[n.BEAM_HOLD]:
            call_beams(p[n.BEAM_HOLD], g, w, numbers, 0)
        gap = call(p[n.ROW_FORCE], s, m, w, numbers, 0)
    largest = call(p[n.BALANCE], s, m, w, numbers, 2 * sized)
    if p[n.JOINT_MAPS]:
        if numbers[n.WEIGHT] != 0.0:
            call(p[n.JOINT_MAPS], s, m, w, numbers, 0)
        call(p[n.JOINT_REDUCE], s, m, w, numbers, 0)
    if not sized:
        return 0.0
    size = call(p[n.SIZE], s, m, w, numbers, 0)
    if largest > 0.0:
        size /= largest
    # NaN is one of both if it is in their sum
    return max(gap, size) if gap + size < np.inf else gap + size


@inlined
def matrix(p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats, mixed: int) -> bool:
    """Factorise the tangent where the residual was evaluated; False if it is singular."""
    call(p[n.CLEAR], s, m, w, numbers, 0)
    if p[n.BEAM_TANGENT]:
        call_beams(p[n.BEAM_TANGENT], g, w, numbers, mixed)
    if mixed and p[n.PREDICT_CHANGES]:
        # R and the forces of subtrees with the predicted stresses: multipliers take none
        force = w.R_mixed
        for r in range(force.shape[0]):
            for c in range(force.shape[1]):
                force[r, c] = 0.0
        call_beams(p[n.BEAM_FORCE], g, w, numbers, 1)
        if p[n.COUPLE]:
            call(p[n.COUPLE], s, m, w, numbers, 2)
        if p[n.CALLED_BACK]:
            call_back(p[n.CALLED_BACK], n.AT_PREDICTED)
        call(p[n.BALANCE], s, m, w, numbers, 1)
        if p[n.JOINT_REDUCE]:
            call(p[n.JOINT_REDUCE], s, m, w, numbers, 1)
    if p[n.LOAD]:
        call(p[n.LOAD], s, m, w, numbers, 1)
    if p[n.COUPLE]:
        call(p[n.COUPLE], s, m, w, numbers, 1)
    if p[n.CALLED_BACK]:
        call_back(p[n.CALLED_BACK], n.AT_MATRIX)
    if p[n.NODAL_MASS_MATRIX]:
        call(p[n.NODAL_MASS_MATRIX], s, m, w, numbers, 0)
    if p[n.FLOW]:
        call(p[n.FLOW_MATRIX], s, m, w, numbers, 0)
    if p[n.NODE_MATRIX]:
        call(p[n.NODE_MATRIX], s, m, w, numbers, mixed)
    if p[n.JOINT_MAPS]:
        call(p[n.JOINT_MAPS], s, m, w, numbers, 1)
    if p[n.JOINT_CURVATURE]:
        call(p[n.JOINT_CURVATURE], s, m, w, numbers, mixed)
    if p[n.BEAM_HOLD_MATRIX]:
        call_beams(p[n.BEAM_HOLD_MATRIX], g, w, numbers, 0)
    if p[n.ROW_MATRIX]:
        call(p[n.ROW_MATRIX], s, m, w, numbers, 0)
    if p[n.HOLD]:
        call(p[n.HOLD], s, m, w, numbers, 0)
    return call(p[n.FACTOR], s, m, w, numbers, 0) != 0.0


@inlined
def border(p: IndexArray, s: Any, m: Any, w: Any, numbers: Floats) -> None:
    """Motions by the columns of the border, for new factors; they are kept with these."""
    for k in range(w.flow.begin[0], BORDER):
        call(p[n.FLOW_COLUMN], s, m, w, numbers, k)
        if p[n.JOINT_REDUCE]:
            call(p[n.JOINT_REDUCE], s, m, w, numbers, 0)
        call(p[n.SWEEP], s, m, w, numbers, 0)
        call(p[n.FLOW_KEEP], s, m, w, numbers, k)


@inlined
def increment(p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats, kept: int) -> float:
    """Increment x for the residual and the factors there are; its size before it was capped.

    ``w.found`` is its largest rotation, and whether the next matrix is to be taken with the
    stresses that it predicts: they are ready then.
    """
    call(p[n.SWEEP], s, m, w, numbers, kept)
    if p[n.FLOW]:
        call(p[n.FLOW_CORRECT], s, m, w, numbers, 0)
    size = call(p[n.CAP], s, m, w, numbers, 0)
    if w.found[1] != 0.0 and p[n.BEAM_PREDICTED]:
        if p[n.PREDICT_CHANGES]:
            call(p[n.PREDICT_CHANGES], s, m, w, numbers, 0)
        call_beams(p[n.BEAM_PREDICTED], g, w, numbers, 0)
    else:
        w.found[1] = 0.0
    return size


@inlined
def accepted(p: IndexArray, s: Any, m: Any, w: Any, numbers: Floats, record: Floats) -> bool:
    """Finish a step, and keep what the next one starts with; False: it ended on another branch."""
    if p[n.ROW_BRANCH] and call(p[n.ROW_BRANCH], s, m, w, numbers, 0) != 0.0:
        return False
    record[n.WORK] = call(p[n.FINISH], s, m, w, numbers, 0)
    keep = numbers[n.REUSE] > 0.0
    record[n.KEPT] = 1.0 if keep else 0.0
    better = call(p[n.BETTER], s, m, w, numbers, int(record[n.KNOWN]))
    record[n.GUESS] = better if keep else 1.0
    record[n.KNOWN] = min(record[n.KNOWN] + 1.0, 2.0)
    return True


# -- the loop over the iterations, whose stages are above ------------------------------------------


@inlined
def first_evaluation(c: Any, sized: bool) -> float:
    """Stages of :func:`skfem_cosserat.newton.newton_loop`; c is what the parts take."""
    p, s, m, w, g, numbers = c
    return evaluate(p, s, m, w, g, numbers, int(sized))


@inlined
def factorise(c: Any, mixed: int) -> bool:
    """See there."""
    p, s, m, w, g, numbers = c
    if not matrix(p, s, m, w, g, numbers, mixed):
        return False
    if p[n.FLOW]:
        border(p, s, m, w, numbers)
    return True


@inlined
def direct(c: Any, kept: bool) -> tuple[float, float, int]:
    """See there."""
    p, s, m, w, g, numbers = c
    length = increment(p, s, m, w, g, numbers, int(kept))
    return length, w.found[0], int(w.found[1])


@inlined
def advance(c: Any, sized: bool, before: float) -> float:
    """See there: parts of the evaluation move by the increment."""
    p, s, m, w, g, numbers = c
    return evaluate(p, s, m, w, g, numbers, int(sized))


loop = newton.newton_loop(first_evaluation, factorise, direct, advance, inlined)


@inlined
def solve_one(
    p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats, record: Floats
) -> bool:
    """Solve a step, with the factors of earlier matrices as long as they do; False: not found."""
    start(p, s, m, w, g, numbers, int(record[n.GUESS]))
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
    if loop((p, s, m, w, g, numbers), limits, record) != newton.SETTLED:
        return False
    return accepted(p, s, m, w, numbers, record)


@part
def solve(steps: Any, flag: int) -> float:
    """Solve as many steps as are asked for, each from where the last one ended, and keep them.

    It ends early where the caller has to look: after a step that takes many iterations, after
    motions of closed loops, or where velocities are left to be moved. 0: the last one tried was not
    found; it starts where y_0, p_0 and the rates are then. For what is in ``steps.numbers`` and
    ``steps.record`` see :mod:`.numbers`.
    """
    p, s, m, w, g = steps.parts, steps.tree, steps.plan, steps.work, steps.beams
    numbers, record, o = steps.numbers, steps.record, steps.carried
    looped = record[n.CLEARANCE] < np.inf
    for k in range(n.DONE, n.CLEARANCE):
        record[k] = 0.0
    while True:
        begin_rates(o)
        solved = solve_one(p, s, m, w, g, numbers, record)
        record[n.ALL_FACTORED] += record[n.FACTORED]
        if looped:
            record[n.TRAVELLED] += w.found[0]
        if not solved:
            return 0.0
        record[n.DONE] += 1.0
        if numbers[n.REACH] != 0.0 and p[n.BEAM_START]:
            viscous_work(p, w, g, numbers)
        finish_rates(o, numbers, record)
        stay_in_plane(o)
        keep(o, w.coupled, numbers, record)
        if record[n.DONE] >= record[n.ASKED] or record[n.FACTORED] > n.SHORT:
            return 1.0
        if record[n.UNMOVED] > 0.0:
            return 1.0
        if looped and (w.found[1] >= n.SHORT_WAY or record[n.TRAVELLED] >= record[n.CLEARANCE]):
            return 1.0
        go_on(o, w.coupled, record)
