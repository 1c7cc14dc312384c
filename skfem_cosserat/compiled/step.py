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
from .simd import clear
from .small import combination


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
    keep = numbers[n.REUSE] > 0.0
    record[n.KEPT] = 1.0 if keep else 0.0
    better = ask(c, n.BETTER, int(record[n.KNOWN]))
    record[n.GUESS] = better if keep else 1.0
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
