"""The loop of Newton's method over a step, compiled once for all scenes: it calls their parts."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import newton
from ..types import Floats, IndexArray
from . import numbers as n
from .flow import BORDER
from .jit import call, call_back, call_beams, inlined, jit
from .rates import begin_rates, finish_rates, go_on, stay_in_plane
from .simd import WIDTH, load, store

__all__ = ["evaluate", "increment", "matrix", "solve", "start"]

#: residual, relative, with which no step is solved whatever its increments are
WRONG = 1e-3
#: increments that do not shrink any more with kept factors are nothing but rounding below this
ROUNDING = 1e-14
#: contraction assumed for factors of an earlier step before any is measured
UNKNOWN = 0.1

enough = inlined(newton.enough)
left_over = inlined(newton.left_over)


@inlined
def at_start(p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats) -> None:
    """Forces of dampers at the start, and where their way to the end begins."""
    y0, mid, earlier, later, reach = w.y0, w.mid, w.earlier, w.later, numbers[n.REACH]
    for r in range(y0.shape[0]):
        for c in range(3):
            way = reach * w.rate0[r, c]
            earlier[r, c], mid[r, c], later[r, c] = y0[r, c] - way, y0[r, c], y0[r, c] + way
    if p[n.BEAM_START]:
        call_beams(p[n.BEAM_START], g, w, numbers, 0)
        call_beams(p[n.BEAM_FORCE], g, w, numbers, 2)
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
        at_start(p, s, m, w, g, numbers)
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
    return gap if not gap <= size else size  # NaN as well


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
def worn(numbers: Floats, record: Floats) -> bool:
    """Whether new factors pay: the last step took more than the mean of all with these factors.

    Their making counts as `worth` iterations: this mean is smallest where steps come to cost more.
    """
    steps = record[n.STEPS]
    return steps > 0.0 and record[n.ITERATIONS] * steps > numbers[n.WORTH] + record[n.SPENT]


@inlined
def keeps(numbers: Floats, record: Floats) -> bool:
    """Whether a step begins with the factors that there are."""
    if not (numbers[n.REUSE] > 0.0 and record[n.KEPT] != 0.0):
        return False
    rate = record[n.RATE]
    # where factors of the step before did not do they are tried again some steps later only
    if left_over(record[n.FIRST], rate, numbers[n.SETTLED]) > numbers[n.REUSE]:
        record[n.RATE] = 0.8 * rate
        return False
    return not worn(numbers, record)


@inlined
def accepted(
    p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats, record: Floats
) -> bool:
    """Finish a step, and keep what the next one starts with; False: it ended on another branch."""
    if p[n.ROW_BRANCH] and call(p[n.ROW_BRANCH], s, m, w, numbers, 0) != 0.0:
        return False
    if p[n.BEAM_FINISH]:
        call_beams(p[n.BEAM_FINISH], g, w, numbers, 0)
    record[n.WORK] = call(p[n.FINISH], s, m, w, numbers, 0)
    keep = numbers[n.REUSE] > 0.0
    record[n.KEPT] = 1.0 if keep else 0.0
    better = call(p[n.BETTER], s, m, w, numbers, int(record[n.KNOWN]))
    record[n.GUESS] = better if keep else 1.0
    record[n.KNOWN] = min(record[n.KNOWN] + 1.0, 2.0)
    return True


@inlined
def solve_one(
    p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats, record: Floats
) -> bool:
    """Solve a step, with the factors of earlier matrices as long as they do; False: not found."""
    reuse, settled = numbers[n.REUSE], numbers[n.SETTLED]
    rate = record[n.RATE]
    kept = keeps(numbers, record)
    record[n.KEPT] = 0.0
    record[n.FACTORED] = 0.0
    start(p, s, m, w, g, numbers, int(record[n.GUESS]))
    size = evaluate(p, s, m, w, g, numbers, int(not kept))
    last, mixed, swept = np.inf, 0, 0.0
    for count in range(1, int(numbers[n.LIMIT]) + 1):
        fresh = not kept
        if fresh:
            record[n.FACTORED] += 1.0
            if not (np.isfinite(size) and matrix(p, s, m, w, g, numbers, mixed)):
                return False
            if p[n.FLOW]:
                border(p, s, m, w, numbers)
        length = increment(p, s, m, w, g, numbers, int(kept))
        mixed = int(w.found[1])
        before, last = last, length
        done = False
        if not fresh:
            if count > 1:
                rate = length / before
            elif rate == 0.0:
                rate = UNKNOWN
            if count == 2:
                record[n.RATE], record[n.FIRST] = rate, before
            if not (rate < 0.5 and length <= numbers[n.LARGEST]):  # NaN as well
                done = length < ROUNDING
                if not done:
                    kept, mixed, last = False, 0, before
                    continue
            further = left_over(length, rate, settled)
            # a rate of steps before says nothing of factors that have grown old since, and that
            # after an iteration with factors of its own is quadratic, once
            done = done or (further <= 0.0 and (swept > 0.0 or length <= settled))
            swept += 1.0
            kept = further <= reuse or rate == UNKNOWN  # the next iteration will tell
            kept = kept and swept < reuse + 2.0
        elif not length <= numbers[n.LARGEST]:
            return False
        size = evaluate(p, s, m, w, g, numbers, int(fresh or done or not kept))
        if fresh:
            done = w.found[0] <= numbers[n.ROTATION] and enough(
                length,
                before,
                size,
                numbers[n.INCREMENT],
                numbers[n.NEGLIGIBLE],
                numbers[n.STAGNATION],
                numbers[n.MIXED],
            )
            kept = reuse > 0.0 and mixed == 0
            rate, swept = 0.0, 0.0
        if done and size <= WRONG:
            record[n.ITERATIONS], record[n.RESIDUAL] = count, size
            if record[n.FACTORED] > 0.0:
                record[n.STEPS], record[n.SPENT] = 0.0, 0.0
            record[n.STEPS], record[n.SPENT] = record[n.STEPS] + 1.0, record[n.SPENT] + count
            return accepted(p, s, m, w, g, numbers, record)
    return False


@jit
def solve(
    p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats, record: Floats, o: Any
) -> bool:
    """Solve as many steps as are asked for, each from where the last one ended.

    It ends early where the caller has to look: after a step that takes many iterations, after
    motions of closed loops, or where velocities are left to be moved. False: the last one tried was
    not found; it starts where y_0, p_0 and the rates are then.

    Parameters
    ----------
    p : int array
        Addresses of the parts, 0 for those that a scene does not have.
    numbers, record : arrays
        See :mod:`.numbers`.
    o : Structure
        What is carried on, by rows in space.
    """
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
            return False
        record[n.DONE] += 1.0
        record[n.ALL_ITERATIONS] += record[n.ITERATIONS]
        record[n.ALL_WORK] += record[n.WORK]
        finish_rates(o, numbers, record)
        record[n.ALL_TAKEN] += record[n.TAKEN]
        stay_in_plane(o)
        if record[n.DONE] >= record[n.ASKED] or record[n.ITERATIONS] > n.SHORT:
            return True
        if record[n.UNMOVED] > 0.0:
            return True
        if looped and (w.found[1] >= n.SHORT_WAY or record[n.TRAVELLED] >= record[n.CLEARANCE]):
            return True
        go_on(o)
