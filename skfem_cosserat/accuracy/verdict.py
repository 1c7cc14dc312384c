"""Verdict on a run: judged by its energy, or by the error that it raised."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..arguments import checked
from ..diagnostics.resolution import ALTERNATES, MOST_OFF
from ..errors import Diverged, InputError
from ..history import History
from ..model.limits import FAR_TURN
from ..newton import NewtonSettings
from ..types import TOLERANCE, Floats, IndexArray, positive
from .run import LATE, in_words

#: With these settings a step that fails has had the full protocol: from an extrapolated and from a
#: zero increment, without and with line search, up to 100 iterations each, rotations capped.
FULL_PROTOCOL = NewtonSettings(iterations=100, damped_iterations=100)
#: attempts of the protocol
ATTEMPTS = 4
#: status of runs that have a mechanism
FAILED = ("blowup", "drift", "newton", "error")
#: series that the energy is made of, unless a judge is told otherwise
DERIVED = {"energy", "external"}


#: mechanisms of failures, the surest one first: the number of a run that tells each, and above
#: which value
MECHANISMS: Mapping[str, tuple[str, float]] = {
    "compression": ("h_omega_c", ALTERNATES),
    "rotation": ("turn", FAR_TURN),
    "branch": ("doubtful", 0.0),
    "unresolved": ("off", MOST_OFF),
}


def mechanism(status: str, numbers: Mapping[str, float]) -> str:
    """Why a run has failed, by what its steps do to its motion.

    Where none of :data:`MECHANISMS` shows, an energy that has grown tenfold is all that is known,
    then elements that are bent or drawn too far, then energy that the scheme has taken.

    Parameters
    ----------
    status : str
        See :class:`Verdict`.
    numbers : mapping of str to float
        ``history.meta["steps"]``; and `lost`, the part of the largest energy or work that the
        scheme has taken (negative: added), by ``history.meta["energy_balance"]``.

    Examples
    --------
    >>> mechanism("newton", {"turn": 0.8, "doubtful": 1.0}), mechanism("ok", {"turn": 0.8})
    ('rotation', '')
    >>> mechanism("drift", {"turn": 0.1, "lost": 0.2})
    'damping'
    """
    if status not in FAILED:
        return ""
    for name, (number, limit) in MECHANISMS.items():
        if numbers.get(number, 0.0) > limit:
            return name
    lost = numbers.get("lost", 0.0)
    # a share of the largest energy or work of a run: it has grown tenfold
    if status == "blowup" or lost < -0.9:
        return "energy"
    if numbers.get("elements", 0.0) > 0:
        return "elements"
    return "damping" if status == "drift" and lost > 0.01 else ""


@dataclass(frozen=True)
class Verdict:
    """Verdict on how a run ended.

    Attributes
    ----------
    status : str
        ``ok``, ``drift``, ``blowup``, ``newton``, ``timeout`` or ``error``; your own judge may have
        other words.
    time : float
        Of the blow-up, of the last step that was solved, or the end (s).
    energy_error : float
        Largest relative change of the energy until then.
    newton_residual : float
        Smallest scaled residual of a step that could not be solved; NaN if all could.
    reason : str
        More about it.
    numbers : dict
        Others that you want to see as arrays over the axes.
    kernels : str
        Those that ran, as the history tells: ``numpy`` or ``numba``; empty if none came.
    warnings : str
        Those of the run in words; empty if it gave none.
    mechanism : str
        Why it failed, as far as the run tells (:func:`mechanism`); empty if it did not, or if it
        does not tell.

    Examples
    --------
    >>> Verdict("ok", time=1.0).status
    'ok'
    """

    status: str
    time: float = float("nan")
    energy_error: float = float("nan")
    newton_residual: float = float("nan")
    reason: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)
    kernels: str = ""
    warnings: str = ""
    mechanism: str = ""


@checked
class JudgeEnergy:
    """Judge runs by their energy, which ought to stay what it was.

    A failed run is judged by the history that came with its error: what has blown up before a step
    could not be solved has blown up.

    Parameters
    ----------
    energy : callable, optional
        Energies (N,) of a History; default: its series ``energy`` plus ``external``.
    since : float
        The energy at the first state from this time on (s) is the right one, E0: the end of a
        pulse, say.
    scale : float, optional
        Of energy; default: abs(E0). Where that is nothing beside the work of the loads (a pendulum
        let go at the height of its hinge): the largest change of their potential, ``external``.
    drift : float
        Relative change of the energy above which a run that ended well has drifted.
    blowup : float
        Blown up is an energy E with E - E0 > (blowup - 1) scale: by default, E > 10 E0.

    Raises
    ------
    InputError
        If a number is not positive; when called, if E0 is zero and neither loads nor `scale` say
        what to compare with, or the history has no such energy.

    Examples
    --------
    >>> t = np.arange(5.0)
    >>> series = {"t": t, "step": t, "q": np.zeros((5, 3)), "p": np.zeros((5, 3))}
    >>> history = History({"status": "completed"}, {}, series)
    >>> found = JudgeEnergy(lambda history: 2 + 0.02 * history.times)(history)
    >>> found.status, found.time, round(found.energy_error, 9)
    ('drift', 4.0, 0.04)
    """

    def __init__(
        self,
        energy: Callable[[History], Any] | None = None,
        since: float = 0.0,
        scale: float | None = None,
        drift: float = 0.01,
        blowup: float = 10.0,
    ) -> None:
        item = "JudgeEnergy"
        if energy is not None and not callable(energy):
            raise InputError(item, f"energy = {energy!r}, expected a function of a History")
        self.energy = energy
        self.since = float(since) if since == 0 else positive(item, "since", since, " of seconds")
        self.scale = None if scale is None else positive(item, "scale", scale)
        self.drift = positive(item, "drift", drift)
        self.blowup = positive(item, "blowup", blowup)

    def __call__(self, result: Any) -> Verdict:
        """The verdict on a History, or on an exception; with the numbers of its steps."""
        failed = isinstance(result, Exception)
        history = getattr(result, "history", None) if failed else result
        if not isinstance(history, History):
            if not failed:
                raise InputError(
                    "argument problem",
                    f"gave a {type(result).__name__}, expected a History (or another outcome=)",
                )
            return self._failed(result, float("nan"), float("nan"), False)
        try:
            time, error, blown = self._change(history, failed)
        except InputError:
            if not failed:
                raise
            # it was stopped before its energies were there
            time, error, blown = float(history.times[-1]), float("nan"), False
        if failed:
            found = self._failed(result, time, error, blown)
        elif history.status == "diverged" and not blown:
            reason = f"no error came with the history: {history.meta.get('failure', '')}"
            found = Verdict("error", time, error, reason=reason)
        else:
            state = "blowup" if blown else "drift" if error > self.drift else "ok"
            found = Verdict(state, time, error)
        numbers = dict(history.meta.get("steps") or {})
        balance = history.meta.get("energy_balance") or {}
        if balance.get("scale", 0.0) > 0:
            numbers["lost"] = balance["lost"] / balance["scale"]
        return replace(found, numbers=numbers, mechanism=mechanism(found.status, numbers))

    def _failed(self, error: Exception, time: float, change: float, blown: bool) -> Verdict:
        """Verdict on a run that failed, by the time it reached and its change of energy."""
        reason, residual = in_words(error), float("nan")
        state = "timeout" if isinstance(error, LATE) else "error"
        if isinstance(error, Diverged):
            residual = float(error.residual)
            if not error.residuals:  # nothing was iterated: an explicit scheme, or a dead point
                state = "error" if np.isfinite(residual) else "blowup"
            elif full_protocol(error):
                state = "newton"
            else:
                reason = NOT_FULL + reason
        if blown:
            return Verdict("blowup", time, change, residual, f"then {reason}")
        end = float(error.time) if isinstance(error, Diverged) else time
        return Verdict(state, end, change, residual, reason)

    def _change(self, history: History, failed: bool = False) -> tuple[float, float, bool]:
        """Time reached, largest change of the energy up to it, and whether it has blown up.

        Before a failed step the momentum, which comes from that step, may not be known.
        """
        t, energy = history.times, self._energies(history)
        if failed and len(t) > 1 and np.isnan(energy[-1]):
            t, energy = t[:-1], energy[:-1]
        after = np.flatnonzero(t >= self.since - 1e-12 * max(abs(t[-1]), abs(self.since)))
        if not len(after):
            return float(t[-1]), float("nan"), False
        start = float(energy[after[0]])
        if not np.isfinite(start):
            return float(t[after[0]]), float("inf"), True
        scale = self._scale(start, history, after)
        if not scale > 0:
            raise InputError(
                "JudgeEnergy",
                f"the energy at t = {t[after[0]]:g} s is zero, which nothing can be compared with:"
                " give scale=, or since=, a time from which it is to stay the same",
            )
        with np.errstate(all="ignore"):
            change = (energy[after] - start) / scale
        bad = ~(change <= self.blowup - 1)
        end = int(bad.argmax()) if bad.any() else len(after) - 1
        return float(t[after[end]]), float(np.nanmax(abs(change[: end + 1]))), bool(bad.any())

    def _scale(self, start: float, history: History, after: IndexArray) -> float:
        """Scale of the energy, by which its changes are divided."""
        if self.scale is not None:
            return self.scale
        if self.energy is None:
            potential = history["external"][after]
            change = abs(potential - potential[0])
            work = float(change[np.isfinite(change)].max(initial=0.0))
            # beside the work of loads it is zero by the choice of a height
            if abs(start) <= TOLERANCE * work:
                return work
        return abs(start)

    def _energies(self, history: History) -> Floats:
        if self.energy is not None:
            values = np.asarray(self.energy(history), dtype=float)
            if values.shape != history.times.shape:
                raise InputError(
                    "JudgeEnergy",
                    f"energy gave shape {values.shape}, expected ({len(history)},)",
                )
            return values
        if not DERIVED.issubset(history.series):
            raise InputError(
                "JudgeEnergy",
                "the history has no series 'energy' and 'external': run it without derive=False,"
                " or give energy=, a function of it",
            )
        return np.asarray(history["energy"] + history["external"])


NOT_FULL = "(not the full retry protocol: run it with settings=FULL_PROTOCOL) "


def full_protocol(error: Diverged) -> bool:
    """True if a step was tried in all the ways of :data:`FULL_PROTOCOL`.

    Examples
    --------
    >>> full_protocol(Diverged(0.0, 1, 1.0, "no convergence", "try", [[1.0]]))
    False
    """
    given, full = error.settings, FULL_PROTOCOL
    return (
        given is not None
        and len(error.residuals) >= ATTEMPTS
        and given.iterations >= full.iterations
        and given.damped_iterations >= full.damped_iterations
    )
