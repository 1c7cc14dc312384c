"""The fixed step for a tolerance, from a pilot: a short run repeated with half the step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..constraints import Treatment
from ..diagnostics import highest_frequency
from ..errors import CosseratError, Diverged, InputError
from ..integrators import Integrator, State, Stepper
from ..linear import SingularMatrixError
from ..model import System, takes_scene
from ..newton import NewtonSettings
from ..types import Floats, check_kind, positive
from ..warn import Notices, logger, sum_up
from .start import consistent_start, initial_state
from .step_size import distance

#: steps of the first trial, and how often they are halved at most
STEPS, HALVINGS = 16, 6
#: how far an observed order may be from that of the scheme
CLOSE = 0.5
#: steps in a period that count as resolving it: the midpoint rule is off by 0.8 % of it then
RESOLVED = 20


@dataclass(frozen=True)
class StepAdvice:
    """A step for a tolerance, and where it comes from.

    Attributes
    ----------
    step : float
        (s); a whole number of them makes up the run.
    error : float
        Estimate for the whole run with this step: relative to the extent of the scene, rad.
    tolerance : float
        What was asked for.
    order : float
        By which the differences of the pilot's trials fell.
    trials : tuple of (float, float)
        Steps (s) of the pilot, and the largest difference to the trial with half the step;
        infinite where one of them could not be run.
    pilot : float
        Its duration (s).
    resolved : float
        Highest frequency (rad/s) of which a period has twenty steps.
    highest : float or None
        Highest frequency (rad/s) of the beams; None: there are none.
    limit : str
        What the step is bounded by.
    warnings : tuple of dict
        Of the pilot's trials, as in ``history.meta["warnings"]``.

    Examples
    --------
    >>> advice = StepAdvice(1e-3, 9e-4, 1e-3, 2.0, ((4e-3, 1e-2),), 0.5, 314.0, None, "tolerance")
    >>> print(advice)
    step 0.001 s: error 9.00e-04 estimated for 1.00e-03 (order 2.00 in a pilot of 0.5 s)
    bounded by the tolerance; frequencies are resolved up to 314 rad/s
    """

    step: float
    error: float
    tolerance: float
    order: float
    trials: tuple[tuple[float, float], ...]
    pilot: float
    resolved: float
    highest: float | None
    limit: str
    warnings: tuple[dict[str, Any], ...] = ()

    def __str__(self) -> str:
        of = "" if self.highest is None else f", of {self.highest:.3g} rad/s that the beams have"
        return (
            f"step {self.step:.4g} s: error {self.error:.2e} estimated for {self.tolerance:.2e}"
            f" (order {self.order:.2f} in a pilot of {self.pilot:.4g} s)\n"
            f"bounded by the {self.limit}; frequencies are resolved up to"
            f" {self.resolved:.3g} rad/s{of}"
        )


@takes_scene
def advise_step(
    system: System,
    integrator: Integrator,
    treatment: Treatment,
    tolerance: float,
    until: float,
    *,
    start: State | None = None,
    pilot: float | None = None,
    first: float | None = None,
    settings: NewtonSettings | None = None,
    kernels: str = "numpy",
) -> StepAdvice:
    """The fixed step with which a run is right to a tolerance.

    A pilot from the start of the run is repeated with half the step until its differences fall by
    the order of the scheme; the error of the run is then taken to grow in proportion to time, and
    to the step to the power of the order. For schemes whose steps must not vary, and others.

    Parameters
    ----------
    system, integrator, treatment, start, settings, kernels
        As for :func:`simulate`.
    tolerance : float
        Of the configuration at any time of the run: positions relative to the scene's extent,
        directors (rad).
    until : float
        End of the run (s).
    pilot : float, optional
        Duration (s) of the pilot; default: a tenth of the run. Take one that sees what is fastest.
    first : float, optional
        Its first step (s); default: a sixteenth of the pilot.

    Raises
    ------
    InputError
        If numbers are not positive, or the pilot is longer than the run.
    Diverged
        If no two trials could be run, or their differences do not fall by the order: the advice
        says which steps were tried.

    Examples
    --------
    >>> from skfem_cosserat import JointDistance, LoadGravity, MassPoint, Model, Multipliers
    >>> from skfem_cosserat import Variational, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(1.0, position=(1, 0, 0)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> gravity = model.add("gravity", LoadGravity((0, 0, -10.0)))
    >>> run = model.freeze(), Variational(), Multipliers()
    >>> advice = advise_step(*run, tolerance=1e-3, until=2.0, pilot=1.0)
    >>> advice.limit, bool(advice.error <= 1e-3), round(advice.order, 1)
    ('tolerance', True, 2.0)
    """
    item = "step advice"
    check_kind("argument integrator", integrator, Integrator)
    tolerance = positive(item, "tolerance", tolerance)
    until = positive(item, "until", until, " of seconds")
    state = initial_state(system) if start is None else consistent_start(system, start)
    duration = positive(item, "until less the start", until - state.time, " of seconds")
    length = positive(item, "pilot", duration / 10 if pilot is None else pilot, " of seconds")
    if length > duration * (1 + 1e-12):
        raise InputError(item, f"pilot = {length:g} s is longer than the run, {duration:g} s")
    count = STEPS
    if first is not None:
        count = max(1, int(np.ceil(length / positive(item, "first", first, " of seconds") - 1e-9)))
    run = system, integrator, treatment, settings, kernels
    with Notices(quiet=True, alone=True) as notices:
        trials, order = _trials(run, state, length, count, integrator.order)
    sum_up(item, "pilots", {"all steps": notices.found}, "advice.warnings")
    h, difference = next(pair for pair in reversed(trials) if np.isfinite(pair[1]))
    p = integrator.order
    error = difference / (1 - 0.5**p) * duration / length
    step, limit = h * (tolerance / error) ** (1 / p) if error > 0 else np.inf, "tolerance"
    sound = max(pair[0] for pair in _sound(trials, p))
    if step > sound:
        step, limit = sound, "largest step whose error follows the order"
    highest = _highest(system)
    if integrator.frequency_limit is not None and highest is not None:
        bound = integrator.frequency_limit / highest
        if step > bound:
            step, limit = bound, f"{integrator.name} scheme's limit for the highest frequency"
    step = duration / np.ceil(duration / step - 1e-9)
    estimate = error * (step / h) ** p
    resolved = 2 * np.pi / (RESOLVED * step)
    return StepAdvice(
        *(float(step), float(estimate), tolerance, order, tuple(trials), length),
        *(float(resolved), highest, limit, tuple(notices.found)),
    )


Chosen = tuple[System, Integrator, Treatment, NewtonSettings | None, str]


def _trials(
    run: Chosen, state: State, length: float, count: int, order: int
) -> tuple[list[tuple[float, float]], float]:
    """Steps and differences of the pilot's trials, and the order of the last ones."""
    trials: list[tuple[float, float]] = []
    before, seen = _trial(run, state, length, count, 1), np.nan
    for k in range(1, HALVINGS + 1):
        now = _trial(run, state, length, count * 2**k, 2**k)
        difference = np.inf
        if before is not None and now is not None:
            pairs = zip(before, now, strict=True)
            difference = max(distance(run[0], a, b) for a, b in pairs)
        trials.append((length / (count * 2 ** (k - 1)), difference))
        before = now
        if len(trials) > 1 and np.isfinite(trials[-2][1]) and difference > 0:
            seen = float(np.log2(trials[-2][1] / difference))
            if abs(seen - order) < CLOSE:
                return trials, seen
        elif difference == 0:  # nothing moves, or nothing is left out
            return trials, float(order)
    tried = ", ".join(f"{h:.3g} s: {d:.3g}" for h, d in trials)
    raise Diverged(
        *(state.time, 0, trials[-1][1]),
        f"the differences of the pilot's steps do not fall by the order {order} of the scheme"
        f" ({tried})",
        "try a shorter first step, another pilot, loads that set in smoothly, or a coarser mesh",
    )


def _sound(trials: list[tuple[float, float]], order: int) -> list[tuple[float, float]]:
    """Trials from which on the differences fall by the order."""
    out = [trials[-1]]
    for before, after in zip(reversed(trials[:-1]), reversed(trials[1:]), strict=True):
        if not np.isfinite(before[1]) or not after[1] > 0:
            break
        if abs(np.log2(before[1] / after[1]) - order) > CLOSE:
            break
        out.append(before)
    return out


def _trial(run: Chosen, state: State, length: float, count: int, every: int) -> list[Floats] | None:
    """Configurations at equal times of a trial; None: it could not be run."""
    system, integrator, treatment, settings, kernels = run
    h, found, now = length / count, [], state
    try:
        stepper = Stepper(system, integrator, treatment, h, settings, kernels, count)
        for k in range(1, count + 1):
            now = stepper.advance(now, state.time + k * h).state
            if k % every == 0:
                found.append(now.q)
    except (Diverged, SingularMatrixError) as error:
        logger.info("the pilot with steps of %.3g s failed: %s", h, error)
        return None
    except InputError as error:
        if error.item != "argument step":
            raise
        logger.info("steps of %.3g s are refused: %s", h, error)
        return None
    return found


def _highest(system: System) -> float | None:
    if not system.beam_groups:
        return None
    try:
        return float(highest_frequency(system))
    except (CosseratError, ArithmeticError, ValueError) as error:  # an estimate beside the advice
        logger.debug("the highest frequency could not be estimated: %s", error)
        return None
