"""Doubts about the motion of a run: steps that do not resolve it, see its inputs, keep energy."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..diagnostics import (
    Alternation,
    Projection,
    Resolution,
    alternation,
    coupling_energy,
    doubtful_steps,
    kinetic_energy,
    resolution,
    strain_energy,
    unseen,
)
from ..diagnostics.resolution import MOST_OFF
from ..errors import CosseratError
from ..integrators import Integrator
from ..linear import SingularMatrixError
from ..model import System
from ..model.limits import FAR_TURN, fastest_turn
from ..types import Floats, IndexArray, spread
from .result import Doubt, Recorded

#: share of the scale that energies and works may be out of balance, and that a scheme may lose
#: which is meant to lose; energies of symplectic schemes swing by (h omega)^2 / 8, 3 % of a
#: vibration of 13 steps a period, whose motion is right to a few per cent
OFF, LOST = 0.03, 0.1
#: energies below this share of ``|G^T lambda| . |q|`` are rounding of what holds a scene at rest,
#: as are motions slower than this share of its length in the time of the run
NOISE = 1e-9


def facts(integrator: Integrator) -> dict[str, Any]:
    """Facts about the integrator of a run that checks ask for: ``history.meta["scheme"]``."""
    single = integrator.single.scheme(1.0)
    return {
        "name": repr(integrator),
        "solves": integrator.solves,
        "loses": integrator.loses,
        "keeping": integrator.keeping,
        "alternates": integrator.frequency_limit is not None,
        "at_ends": single is not None and single.at_end,
        "node_momentum": integrator.carries_node_momentum,
    }


class Balance(NamedTuple):
    """Balance of the energies and works of a run.

    Attributes
    ----------
    numbers : dict
        ``history.meta["energy_balance"]`` (J): ``start`` and ``end``, the kinetic and stored
        energy; ``loads``, ``actuators`` and ``drives``, their works; ``dissipated`` by dampers,
        viscous sections, drag and events; ``lost``, what the scheme has taken (gained where it is
        negative); ``scale``, the largest of these energies and of all works on the way. What the
        scheme takes is damping in the series of the history: ``"dissipated"`` has it, and
        ``"energy_balance"`` is the rest. Energies are those of the momenta that it carries.
    time, lost, scale : float
        When (s) more was lost or gained (J) than the scheme may, at the end or before, and the
        largest energy or work up to the end; zero: at no time.
    """

    numbers: dict[str, float]
    time: float
    lost: float
    scale: float


class Run(Recorded):
    """States of a run in time."""

    @property
    def scheme(self) -> dict[str, Any]:
        """Facts about the integrator, by :func:`facts`."""
        return self.history.meta["scheme"]

    @property
    def longest(self) -> float:
        """Longest part of a step, as a share of it: of composed steps parts count."""
        return max(map(abs, self.history.meta["shares"]), default=1.0)

    @property
    def equal(self) -> bool:
        """True if steps are of the size that was asked for (but those that end at events)."""
        return "step_control" not in self.history.meta

    @property
    def h(self) -> float:
        """Size of the steps (s); the last one under control."""
        meta = self.history.meta
        return float(meta["step"] if self.equal else self.history["step_size"][-1])

    @property
    def comparable(self) -> bool:
        """True if steps are alike; explicit schemes have others within them."""
        return self.equal and self.scheme["solves"]

    @cached_property
    def resolution(self) -> Resolution | None:
        """Resolution of the motion; None where states do not tell it."""
        return resolution(self.system, self.history) if self.comparable else None

    @cached_property
    def doubtful(self) -> NDArray[np.bool_]:
        """States (N,) to which a step led that may have several solutions."""
        history = self.history
        if self.comparable:
            return doubtful_steps(self.system, history)
        return np.zeros(len(history), bool)

    @cached_property
    def alternation(self) -> Alternation | None:
        """Rotations that alternate and grow, as with variational schemes."""
        if not self.scheme["alternates"]:
            return None
        try:
            return alternation(self.system, self.history, self.longest * self.h)
        except SingularMatrixError:  # not found: nothing is claimed
            return None

    @property
    def hint(self) -> str:
        """Cause of a failure, or of energy gained, of variational runs: alternating rotations."""
        found = self.alternation
        if found is None:
            return ""
        return (
            f"compression drives node rotations of {found.item} that alternate from step to step:"
            f" at t = {found.time:.6g} s the step times their frequency is {found.ratio:.3g}, and"
            " they grow above 2"
        )

    @cached_property
    def balance(self) -> Balance | CosseratError | None:
        """Balance of energy, None where nothing is to be compared, or why it cannot be had."""
        if len(self.history) < 2:
            return None
        try:
            with np.errstate(all="ignore"):
                return _balance(self)
        except CosseratError as error:
            return error

    def numbers(self) -> dict[str, dict[str, float]]:
        """Metadata of its history: what steps do to its motion, ``"steps"``, and its energies.

        Of the steps ``off`` and ``turn``, the error and the rotation in a step (in the longest part
        of a composed one) of :class:`skfem_cosserat.diagnostics.Resolution`, or in a step that
        failed; ``doubtful``, whether a step may have several solutions; ``elements``, whether some
        are bent or drawn too far in a recorded state; ``h_omega_c``, see
        :class:`skfem_cosserat.diagnostics.Alternation`.
        """
        found = self.resolution
        balance = self.balance
        with np.errstate(all="ignore" if self.failed else None):  # it may have blown up
            out = {"elements": float(bool(self.bent or self.drawn))}
        if self.comparable:
            out["doubtful"] = float(self.doubtful.any())
        if found is not None:
            out |= {"off": found.error, "turn": found.turn * self.longest}
        unbalanced = isinstance(balance, Balance) and balance.scale > 0
        if (self.failed or unbalanced) and self.alternation is not None:
            out["h_omega_c"] = self.alternation.ratio
        if self.failed and out.get("turn", 0.0) < (turn := self._turn_at_end()) < np.pi:
            out["turn"] = turn  # more is of a run that has blown up
        energies = {"energy_balance": balance.numbers} if isinstance(balance, Balance) else {}
        return {"steps": out, **energies}

    def _turn_at_end(self) -> float:
        """Rotation (rad) of a frame in the step that failed, by the velocity at its start."""
        history = self.history
        try:
            last = history["q"][-1], history["carried"][-1], history.times[-1]
            v = Projection(self.system)(*last)[0]
        except (CosseratError, ArithmeticError, ValueError):
            return 0.0
        return fastest_turn(self.system, v)[1] * self.longest * self.h


# -- steps -----------------------------------------------------------------------------------------


def several_solutions(run: Run) -> Iterator[Doubt]:
    """Steps that may have several solutions."""
    if run.doubtful.any():
        yield Doubt(
            "argument step",
            f"a step of {run.h:.3g} s may have several solutions: the one that was found took many"
            " iterations, and the steps around it do not lead there"
            ' (history["doubtful_step"] marks all of them)',
            run.history.times[run.doubtful.argmax()],
        )


def unresolved(run: Run) -> Iterator[Doubt]:
    """Steps that are too long: a motion may be bounded, balanced in energy, and wrong."""
    found = run.resolution
    if found is not None and found.error > MOST_OFF:
        yield Doubt(
            "argument step",
            f"steps of {run.h:.3g} s do not resolve the motion: they put the {found.item} off by"
            f" some {100 * min(found.error, 1.0):.0f} % of the range of its motion, as a period of"
            f" what moves it has {found.period:.2g} steps",
            found.time,
        )
    elif found is not None and found.turn * run.longest > FAR_TURN:
        what = "part of a step" if run.history.meta["shares"] else "step"
        yield Doubt(
            "argument step",
            f"the {found.turning} turns by {found.turn * run.longest:.2g} rad in each {what}: above"
            f" {FAR_TURN:g} rad the motion stays bounded, but is not accurate",
            found.time,
        )


def unseen_inputs(run: Run) -> Iterator[Doubt]:
    """A load, drive or moving ground that does what steps do not see."""
    found = unseen(run.system, run.history, run.scheme["at_ends"])
    if found is not None:
        yield Doubt(*found)


def early_end(run: Run) -> Iterator[Doubt]:
    """A run whose time is no multiple of its step, which ends before the time asked for."""
    history = run.history
    until = run.history.meta["until"]
    start, end = history.times[[0, -1]]
    rest = until - end
    if (
        history.status == "completed"
        and run.equal
        and 1e-6 * run.h + 1e-8 * (until - start) < rest < run.h
    ):
        count = int(np.ptp(history["step"])) + 1
        yield Doubt(
            "argument until",
            f"the run ends at t = {end:.9g} s, {rest:.3g} s before until = {until:.9g} s, which is"
            f" no multiple of the step of {run.h:.9g} s",
            remedy=f"give step = {(until - start) / count:.9g}, which makes {count} steps",
        )


# -- energies and works ----------------------------------------------------------------------------


def energies(
    system: System,
    node_momentum: bool,
    q: Floats,
    p: Floats,
    times: Floats,
    turns: IndexArray | None,
) -> Floats:
    """Kinetic and stored energy (J) of some states of a run (N, n).

    Kinetic energy is that of the momentum in terms of which a scheme has its balance. With the
    variational scheme this is the one on the hidden constraints: a part along ``G^T``, which what
    it carries has to first order in the step, moves nothing and only changes the next multipliers
    (the motion is that of ``stabilized=True``). Others carry the momentum of the node.
    """
    stored = strain_energy(system, q, times) + coupling_energy(system, q, times, turns)
    if node_momentum:
        return kinetic_energy(system, p) + stored
    v, own = Projection(system).stack(q, p, times)
    return 0.5 * (v * own).sum(1) + stored


def _balance(run: Run) -> Balance:
    history, system, rows = run.history, run.system, spread(len(run.history), 100)
    found = np.empty(len(rows))
    for own, (start, stop) in zip(run.systems, history.segments, strict=True):
        some = (start <= rows) & (rows < stop)
        q, p, t = (history[name][rows[some]] for name in ("q", "carried", "t"))
        turns = history["turns"][rows[some]] if "turns" in history else None
        found[some] = energies(own, run.scheme["node_momentum"], q, p, t, turns)
    works = [history[f"work_{name}"][rows] for name in ("loads", "actuators", "drives")]
    taken = (history["dissipated"] - history["dissipated_by_scheme"])[rows]
    lost = sum(works) - taken - found  # up to a constant
    lost = lost - lost[0]
    scale = float(np.nanmax(np.abs([*found[[0, -1]], *np.ravel([*works, taken])])))
    mass = float(system.mass.diagonal()[system.origin_rows].sum())
    arms = abs(history["q"][-1]).reshape(-1, 3)
    arms[system.origin_rows] = arms[system.origin_rows].clip(system.length)  # also at the origin
    held = float(np.nansum(abs(history["constraint_force"][-1]) * arms.ravel()))
    rest = mass * (NOISE * system.length / np.ptp(history.times)) ** 2
    scale = scale if scale > max(NOISE * held, rest) else 0.0
    names = "start", "end", "loads", "actuators", "drives", "dissipated", "lost", "scale"
    ends = found[0], found[-1], *(work[-1] for work in works), taken[-1], lost[-1], scale
    over = np.maximum(lost / (LOST if run.scheme["loses"] else OFF), -lost / OFF)
    k = -1
    size = scale
    if over[-1] <= scale:  # in order at the end, but perhaps not before
        k = int(over.argmax())
        size = max(scale, float(np.nanmax(found)))
    off = scale > 0 and not over[k] <= size
    numbers = dict(zip(names, map(float, ends), strict=True))
    return Balance(numbers, history.times[rows[k]], lost[k], size if off else 0.0)


def unbalanced(run: Run) -> Iterator[Doubt]:
    """Energy that no load, drive, damper or event explains, at the end or in between."""
    found = run.balance
    if not isinstance(found, Balance) or found.scale == 0:
        return
    numbers = found.numbers
    scale = found.scale
    amount = (
        f"the run {'gained' if found.lost < 0 else 'lost'} {abs(found.lost):.3g} J,"
        f" {100 * abs(found.lost) / scale:.3g} % of {scale:.3g} J, the largest of its energies and"
        " works"
    )
    if not np.isfinite(found.lost):
        amount = f"the energy went from {numbers['start']:.3g} J to {numbers['end']} J"
    yield Doubt(
        "balance of energy",
        f"{amount}; no load, drive, damper or event explains this, {run.scheme['name']} does not"
        f" follow the motion in steps of {run.h:.3g} s",
        found.time,
        f"take smaller ones{run.scheme['keeping']}" + (f"; {run.hint}" if run.hint else ""),
    )


def no_balance(run: Run) -> Iterator[Doubt]:
    """Energies that cannot be had."""
    if isinstance(run.balance, CosseratError):
        yield Doubt("balance of energy", f"it cannot be had: {run.balance}", remedy="")
