"""Errors and costs of proposals that have not been run, from those that have."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .event import Event, Trial
from .proposal import Proposal
from .reference import ORDER, Reference

__all__ = ["HOPELESS", "SIZES", "Predictor"]

#: elements a piece that are looked at
SIZES = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
#: what is predicted to be worse than this is not tried (in tolerances)
HOPELESS = 4.0
#: error of the meshes that orders are compared with, in tolerances
EVEN = 0.5


class Predictor:
    """Sums of what each axis (rung, mesh, step, integrator) was seen to do by itself.

    Parameters
    ----------
    event : Event
    reference : Reference

    Attributes
    ----------
    mesh : dict of int to dict of float to float
        By order, and by how many times the elements of `even` there are: error in tolerances.
    rung, rung_cost : dict of (str, str) to float
        By beam and rung: error in tolerances, factor of costs.
    integrators : dict of str to (float, float)
        Factors of the errors in time and of costs.
    treatments : dict of str to float
        Factors of costs.
    scale : float
        What was measured over what was predicted, lately.
    """

    def __init__(self, event: Event, reference: Reference) -> None:
        self.event, self.reference = event, reference
        self.mesh: dict[int, dict[float, float]] = {}
        self.rung: dict[tuple[str, str], float] = {}
        self.rung_cost: dict[tuple[str, str], float] = {}
        self.integrators: dict[str, tuple[float, float]] = {}
        self.treatments: dict[str, float] = {}
        self.scale = 1.0
        self._fitted: tuple[int, tuple[float, float], dict[int, float]] = (-1, (0.0, 0.0), {})
        #: by beam: error of references' elements by number a piece
        self.fine: dict[str, dict[int, float]] = {name: {} for name in event.beams}
        for name, found in self.fine.items():
            levels = sorted(k for each, k in reference.space if each == name)
            below = reference.space[name, levels[-1]] / 3
            for level in reversed(levels):
                below += reference.space[name, level]
                found[2**level] = below
        #: elements a piece for an error that beams share
        self.even = {
            name: next(
                (k for k in SIZES if self.part(name, ORDER, k) <= EVEN / len(event.beams)),
                SIZES[-1],
            )
            for name in event.beams
        }

    def time(self, steps: int) -> float:
        """Error of a number of steps, of second order where nothing was run."""
        known = self.reference.time
        first, last = min(known), max(known)
        tail = known[last] / 3
        if steps > last:
            return tail * (last / steps) ** 2 * 4
        found = tail + sum(d for n, d in known.items() if n >= max(steps, first))
        return found * (first / min(steps, first)) ** 2

    def part(self, beam: str, order: int, per: float) -> float:
        """Error that a beam contributes with so many elements a piece."""
        if order == ORDER:
            return _between(self.fine[beam], per, 2 * order)
        known = self.mesh.get(order, {})
        even = {name: self.part(name, ORDER, k) for name, k in self.even.items()}
        total, count = sum(even.values()), len(even)
        share = 0.9 * even[beam] / total + 0.1 / count if total else 1.0 / count
        return share * _between(known, per / self.even[beam], 2 * order) if known else np.inf

    def error(self, proposal: Proposal) -> float:
        """Of a proposal, in tolerances."""
        rungs = sum(
            self.rung.get((name, str(rung)), np.inf)
            for name, rung in proposal.rung.items()
            if str(rung) != "full"
        )
        factor = self.integrators.get(repr(proposal.integrator), (1.0, 1.0))[0]
        space = sum(
            self.part(name, proposal.order, proposal.elements[name] / self.event.pieces[name])
            for name, rung in proposal.rung.items()
            if rung.meshed
        )
        return self.scale * (rungs + space + factor * self.time(proposal.steps))

    def cost(self, proposal: Proposal) -> float:
        """Processor time (s) of a proposal: steps times iterations times what one takes."""
        factor = self.integrators.get(repr(proposal.integrator), (1.0, 1.0))[1]
        factor *= self.treatments.get(repr(proposal.treatment), 1.0)
        for name, rung in proposal.rung.items():
            factor *= self.rung_cost.get((name, str(rung)), 1.0)
        count = len(self.event.trials)
        if count != self._fitted[0]:
            self._fitted = (count, self._per_iteration(), self._iterations())
        _, (base, slope), found = self._fitted
        iterations = found[min(found, key=lambda n: abs(np.log(n / proposal.steps)))]
        return factor * proposal.steps * iterations * (base + slope * proposal.nodes)

    def _plain(self) -> list[Trial]:
        """Runs with energy-momentum and the null space."""
        plain = ("EnergyMomentum()", "NullSpace()")
        return [
            trial
            for trial in self.event.plain
            if trial.ok
            and trial.proposal.method == plain
            and trial.proposal.planar is self.event.planar
            and all(str(rung) in ("full", "rigid") for rung in trial.proposal.rung.values())
        ]

    def _per_iteration(self) -> tuple[float, float]:
        """Processor time of an iteration (s): a constant, and what each node adds."""
        rows, times = [], []
        for trial in self._plain():
            cost = trial.cost_s / trial.proposal.steps / max(trial.iterations, 1.0)
            rows.append([1.0 / cost, trial.proposal.nodes / cost])
            times.append(1.0)
        from scipy.optimize import nnls  # slow to import, seldom needed

        base, slope = nnls(np.array(rows), np.array(times))[0]
        return float(base), float(slope)

    def _iterations(self) -> dict[int, float]:
        """Newton iterations a step, by number of steps, of runs that are not too far off."""
        found: dict[int, list[float]] = {}
        plain, finest = self._plain(), self.reference.trial
        assert finest is not None
        near = [each for each in plain if self.event.distance(each, finest) <= HOPELESS]
        for trial in near or plain:
            found.setdefault(trial.proposal.steps, []).append(max(trial.iterations, 1.0))
        return {steps: float(np.median(each)) for steps, each in found.items()}


def _between(known: Mapping[Any, float], m: float, order: int) -> float:
    """Error at m elements a piece: straight in the logarithms, beyond them of the order known."""
    sizes = np.array([n for n, d in sorted(known.items()) if np.isfinite(d) and d > 0])
    if not len(sizes):
        return 0.0 if any(d == 0 for d in known.values()) else np.inf
    errors = np.array([known[n] for n in sizes.tolist()])
    if m > sizes[-1]:
        return float(errors[-1] * (sizes[-1] / m) ** order)
    if m < sizes[0]:
        return float(errors[0] * (sizes[0] / m) ** order)
    return float(np.exp(np.interp(np.log(m), np.log(sizes), np.log(errors))))
