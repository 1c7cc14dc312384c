"""The search among proposals, by what trials tell of errors and costs."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from ..constraints import Treatment
from ..integrators import Integrator
from ..types import Floats
from .proposals import THEORIES, BeamModel, Proposal
from .reference import ORDER, FinestRun
from .trials import PATIENCE, Pilot, Trial, Trials, look

# -- proposals that were run, and which of two is to be preferred ----------------------------------

#: of costs that are closer than this factor, more than clocks can tell, the simpler beams' counts
ALIKE = 1.15


@dataclass
class Candidate:
    """A proposal with what was predicted and what came out.

    Attributes
    ----------
    trial : Trial
    error : float
        Difference from the reference, in tolerances; infinite if it failed.
    predicted_error : float
        In tolerances; not a number if nothing was predicted.
    predicted_cost_s : float
    """

    trial: Trial
    error: float
    predicted_error: float = np.nan
    predicted_cost_s: float = np.nan


def cost_of(candidate: Candidate) -> float:
    """Processor time (s), to sort by."""
    return candidate.trial.cost_s


def alike(own: Candidate, other: Candidate) -> float:
    """The factor of the other one's cost that an own one must stay below to be preferred."""
    if simpler_beams(own.trial.proposal, other.trial.proposal):
        return ALIKE
    return 1 / ALIKE if simpler_beams(other.trial.proposal, own.trial.proposal) else 1.0


def simpler_beams(a: Proposal, b: Proposal) -> bool:
    """Whether a beam of the first is simpler than in the second, and none is less simple."""
    places = [(THEORIES.index(a.theory[name]), THEORIES.index(b.theory[name])) for name in a.theory]
    return a.theory != b.theory and all(i <= j for i, j in places)


# -- errors and costs of proposals that have not been run, from those that have --------------------

#: elements a piece that are looked at
SIZES = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
#: what is predicted to be worse than this is not tried (in tolerances)
HOPELESS = 4.0
#: error of the meshes that orders are compared with, in tolerances
EVEN = 0.5


class Predictor:
    """Sums of what each axis (theory, mesh, step, integrator) was seen to do by itself.

    Parameters
    ----------
    event : Event
    reference : FinestRun

    Attributes
    ----------
    mesh : dict of int to dict of float to float
        By order, and by how many times the elements of `even` there are: error in tolerances.
    theory, theory_cost : dict of (str, str) to float
        By beam and theory: error in tolerances, factor of costs.
    integrators : dict of str to (float, float)
        Factors of the errors in time and of costs.
    treatments : dict of str to float
        Factors of costs.
    scale : float
        What was measured over what was predicted, lately.
    """

    def __init__(self, event: Trials, reference: FinestRun) -> None:
        self.event, self.reference = event, reference
        self.mesh: dict[int, dict[float, float]] = {}
        self.theory: dict[tuple[str, str], float] = {}
        self.theory_cost: dict[tuple[str, str], float] = {}
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
        theories = sum(
            self.theory.get((name, str(theory)), np.inf)
            for name, theory in proposal.theory.items()
            if str(theory) != "full"
        )
        factor = self.integrators.get(repr(proposal.integrator), (1.0, 1.0))[0]
        space = sum(
            self.part(name, proposal.order, proposal.elements[name] / self.event.pieces[name])
            for name, theory in proposal.theory.items()
            if theory.meshed
        )
        return self.scale * (theories + space + factor * self.time(proposal.steps))

    def cost(self, proposal: Proposal) -> float:
        """Processor time (s) of a proposal: steps times iterations times what one takes."""
        factor = self.integrators.get(repr(proposal.integrator), (1.0, 1.0))[1]
        factor *= self.treatments.get(repr(proposal.treatment), 1.0)
        for name, theory in proposal.theory.items():
            factor *= self.theory_cost.get((name, str(theory)), 1.0)
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
            and all(str(theory) in ("full", "rigid") for theory in trial.proposal.theory.values())
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


# -- the search for the cheapest proposal within the tolerance: predict, run, step down ------------

ORDERS = (1, 2, 3)
#: elements of lower orders for one of the highest
MORE = {1: (3, 6, 12), 2: (1, 2, 4)}
#: predicted errors may be this part of the tolerance for a first try
SAFETY = 0.8
#: costs that are closer than this factor are taken again: so much a busy machine may change them
CLOSE = 2.0
#: costs of runs that took turns are told apart by this factor at once
CLEAR = 1.4
#: so many are run in turn at last
FINALISTS = 4
#: candidates that are tried before the search goes on from what is known
TRIES = 8
#: a beam that bends by more (rad) is not tried as a rigid one
RIGID = 0.2
#: a beam that shears or extends by more is tried as the full one only
HELD = 0.05
#: a beam with a larger part of its strain energy in torsion is not tried without
TWISTED = 0.02


@dataclass
class Search:
    """Stages of the search; see :func:`advise`.

    Attributes
    ----------
    candidates : list of Candidate
        All that were run through the event.
    best : Candidate or None
        The cheapest within the tolerance.
    """

    event: Trials
    reference: FinestRun
    integrators: Sequence[Integrator]
    treatments: Sequence[Treatment]
    rng: np.random.Generator
    candidates: list[Candidate] = field(default_factory=list)
    best: Candidate | None = None
    pilot: Pilot = field(default_factory=Pilot)
    notes: list[str] = field(default_factory=list)

    growth: float = 0.0
    OUT = "the budget ran out"

    def __post_init__(self) -> None:
        assert self.reference.trial is not None
        self.finest = self.reference.trial
        self.predictor = Predictor(self.event, self.reference)
        self._known: set[int] = set()
        self.fragile: set[Hashable] = set()
        #: steps that proposals are predicted with, at least; fewer ones are tried from the best
        self.fewest = self.event.base
        #: whether the best one is being run with half its step, and goes through with it, too
        self.confirming = self.confirmed = False

    def go(self) -> None:
        """All stages after :meth:`look`, as long as the budget lasts."""
        self._meshes()
        self._theories()
        self._collect()
        self._try_predicted()
        self._swaps()
        self._step_down()
        self._collect()
        self._finals()
        self._confirm()

    # -- what each axis does by itself -------------------------------------------------------------

    def elements(self, per: int | Mapping[str, int]) -> dict[str, int]:
        """Elements of the beams from those a piece."""
        return {
            name: pieces * (per if isinstance(per, int) else per[name])
            for name, pieces in self.event.pieces.items()
        }

    def look(self) -> None:
        """The pilot: the coarser meshes of the reference, at the fewest steps that make sense.

        Differences in time that were found on meshes coarser than these count no longer.
        """
        level, time = self.reference.coarse, self.reference.time
        elements = {name: self.event.pieces[name] * 2**k for name, k in level.items()}
        self.steps = self.reference.steps
        self.fine = self.event.run(self.event.proposal(elements, ORDER, self.steps))
        for stale in [n for n in time if n < self.steps]:
            del time[stale]
        while self.steps % 2 == 0 and self.steps // 2 >= self.event.base:
            proposal = self.event.proposal(elements, ORDER, self.steps // 2)
            if not self.event.budget.allows(2 * self.fine.cost_s):
                break
            coarser = self.event.run(proposal)
            if not coarser.ok:
                self.fewest = self.steps
                self.notes.append(f"the pilot fails with {proposal.steps} steps: {coarser.reason}")
                break
            time[self.steps // 2] = self.event.distance(coarser, self.fine)
            if self.predictor.time(self.steps // 2) > 1.0:
                break
            self.fine, self.steps = coarser, self.steps // 2
        if self.fine.ok and self.event.budget.allows(2 * self.fine.cost_s):
            self.event.again(self.fine)
            assert self.event.history is not None
            self.pilot = look(self.event.built(self.fine.proposal)[0], self.event.history)

    def _meshes(self) -> None:
        """Errors of lower orders, with more elements than the highest needs."""
        if not self.event.beams:
            return
        most = 1.5 * self.fine.proposal.nodes
        for order in self.rng.permutation(ORDERS[:-1]).tolist():
            found = self.predictor.mesh.setdefault(order, {})
            for times in MORE[order]:
                per = {name: times * k for name, k in self.predictor.even.items()}
                proposal = self.event.proposal(self.elements(per), order, self.steps)
                if proposal.nodes > most or not self._affordable(proposal):
                    break
                found[times] = self.event.distance(self.event.run(proposal), self.fine)
                if found[times] <= 0.3:
                    break

    def _theories(self) -> None:
        """Errors of cheaper models of each beam, the others as they are."""
        for name in self.rng.permutation(list(self.event.beams)).tolist():
            told: dict[str, list[str]] = {}
            for theory in self._simpler(name):
                if why := self._told(name, theory):
                    told.setdefault(why, []).append(str(theory))
                    continue
                proposal = replace(
                    self.fine.proposal, theory=dict(self.fine.proposal.theory) | {name: theory}
                )
                if not self._affordable(proposal):
                    return
                trial = self.event.run(proposal)
                if not trial.ok:
                    self.notes.append(f"{name} as {theory}: {trial.status}, {trial.reason}")
                if trial.status == "impossible":
                    continue
                error = self.event.distance(trial, self.fine)
                self.predictor.theory[name, str(theory)] = error
                if trial.ok and theory.meshed:
                    self.predictor.theory_cost[name, str(theory)] = trial.cost_s / self.fine.cost_s
                if error <= 0.1:
                    break
            for why, theories in told.items():
                self.notes.append(f"{name}: not tried as {', '.join(theories)}: it {why}")

    def _simpler(self, name: str) -> Iterator[BeamModel]:
        """Models of a beam with less than it has, the simplest first."""
        for theory in (each for each in THEORIES[:-1] if each.simpler(self.event.beams[name])):
            if theory.untwisted and self.event.planar is not None:
                continue  # nothing twists in a plane
            if str(theory) == "rigid beam" and (name, "rigid") in self.predictor.theory:
                continue  # as a body it costs less
            yield theory

    def _told(self, name: str, theory: BeamModel) -> str:
        """Why the pilot run rules out a model of a beam; empty: it does not."""
        bend, stretch = self.pilot.bend.get(name, 0.0), self.pilot.stretch.get(name, 0.0)
        twist = self.pilot.share(name, "torsion")
        if {3, 4} & set(theory.held) and bend > RIGID:
            return f"bends by {bend:.2g} rad"
        if {0, 1, 2} & set(theory.held) and stretch > HELD:
            return f"is strained by {stretch:.2g}"
        if theory.untwisted and twist > TWISTED:
            return f"has {100 * twist:.2g} % of its strain energy in torsion"
        return ""

    def _affordable(self, proposal: Proposal) -> bool:
        """Whether there is time for it, and for the run that confirms the best one after that."""
        cost = self.predictor.cost(proposal)
        if self.best is not None and not self.confirming:
            cost += self.predictor.cost(_halved(self.best.trial.proposal))
        fits = self.event.budget.allows(2 * cost)
        if not fits and self.OUT not in self.notes:
            self.notes.append(self.OUT)
        return fits

    # -- candidates --------------------------------------------------------------------------------

    def _collect(self) -> None:
        """Everything that has been run is a candidate; the cheapest good one is the best."""
        for trial in sorted(self.event.plain, key=lambda each: (not each.ok, each.cost_s)):
            if id(trial) not in self._known:
                own = trial.proposal
                self._note(trial, (self.predictor.error(own), self.predictor.cost(own)))

    def _note(self, trial: Trial, predicted: tuple[float, float] | None = None) -> Candidate:
        if id(trial) in self._known:
            return next(c for c in self.candidates if c.trial is trial)
        self._known.add(id(trial))
        error = self.event.distance(trial, self.finest)
        own = Candidate(trial, error, *(predicted or (np.nan, np.nan)))
        self.candidates.append(own)
        if self._good(own) and (self.best is None or self._cheaper(own, self.best)):
            self.best = own
        return own

    def _cheaper(self, own: Candidate, best: Candidate) -> bool:
        """Whether it costs less; if they are close, in runs that take turns."""
        costs = np.array([own.trial.cost_s, best.trial.cost_s])
        if (
            own.trial.running_cost is not best.trial.running_cost
            and 1 / CLOSE < costs[0] / costs[1] < CLOSE
        ):
            costs = self._in_turn([own, best], 2)
        return bool(costs[0] < alike(own, best) * costs[1])

    def _in_turn(self, candidates: Sequence[Candidate], rounds: int) -> Floats:
        """Least costs (s) of a few in rounds of all of them: what slows one slows all.

        Rounds end early when costs are apart by more than clocks err, and without budget.
        """
        costs = np.array([each.trial.cost_s for each in candidates])
        for k in range(rounds):
            if not all(self._affordable(each.trial.proposal) for each in candidates):
                break
            again = np.array([self.event.again(each.trial) for each in candidates])
            costs = again if k == 0 else np.minimum(costs, again)
            if costs.max() > CLEAR * costs.min():
                break
        return costs

    def _finals(self) -> None:
        """The best once more, in turn with the cheapest of other scenes and methods.

        All the others were compared with whatever was the best then.
        """
        if self.best is None:
            return
        least: dict[int, Candidate] = {id(self.best.trial.running_cost): self.best}
        for each in sorted(filter(self._good, self.candidates), key=cost_of):
            if each.trial.cost_s < CLOSE * self.best.trial.cost_s:
                least.setdefault(id(each.trial.running_cost), each)
        last = list(least.values())[:FINALISTS]
        costs = self._in_turn(last, 3)
        k = int(costs.argmin())
        for i, each in enumerate(last):
            if costs[i] < alike(each, last[k]) * costs[k]:
                k = i
        self.best = last[k]

    def _good(self, own: Candidate) -> bool:
        """Within the tolerance, whatever the error of the reference, and coarser than that."""
        proposal, finest = own.trial.proposal, self.finest.proposal
        coarser = proposal.steps < finest.steps and (
            not self.event.beams or proposal.nodes < finest.nodes
        )
        sound = proposal.key not in self.fragile
        return own.error + self.reference.error <= 1.0 and coarser and sound

    def try_it(self, proposal: Proposal) -> Candidate:
        """Run a proposal and note what was predicted of it."""
        predicted = self.predictor.error(proposal), self.predictor.cost(proposal)
        own = self._note(self.event.run(proposal, max(PATIENCE * predicted[1], 0.5)), predicted)
        if 0 < own.error < np.inf and 0 < predicted[0] < np.inf:
            self.predictor.scale *= float(np.clip(own.error / predicted[0], 0.25, 4.0))
        return own

    def all(self) -> Iterator[Proposal]:
        """Proposals worth a prediction."""
        names = list(self.event.beams)
        ladder = self._ladder()
        choices = [self._choices(name) for name in names]
        meshes: dict[tuple[str, ...], list[tuple[int, dict[str, int]]]] = {}
        for theories in product(*choices):
            models = dict(zip(names, theories, strict=True))
            meshed = tuple(name for name, theory in models.items() if theory.meshed)
            if meshed not in meshes:
                meshes[meshed] = list(self._distributions(meshed))
            for order, elements in meshes[meshed]:
                for steps in ladder:
                    yield self.event.proposal(elements, order, steps, models)

    def _ladder(self) -> list[int]:
        steps, most = self.event.base, self.reference.steps
        found = []
        while steps <= most:
            found.append(steps)
            steps *= 2
        return [each for each in found if each >= self.fewest] or [most]

    def _choices(self, name: str) -> list[BeamModel]:
        """The full beam, and the two cheapest of the others that may do."""
        known = self.predictor.theory
        good = [theory for theory in THEORIES[:-1] if known.get((name, str(theory)), np.inf) <= 1.0]
        return [*good[:2], THEORIES[-1]]

    def _distributions(self, names: Sequence[str]) -> Iterator[tuple[int, dict[str, int]]]:
        """Meshes of the beams that have one, which share an error among them."""
        per = dict.fromkeys(self.event.pieces, 1)
        if not names:
            yield ORDERS[0], self.elements(per)
            return
        seen = set()
        for order in ORDERS:
            errors = {
                name: [(k, self.predictor.part(name, order, k)) for k in SIZES] for name in names
            }
            for allowed in np.geomspace(2.0, 0.01, 24) / len(names):
                for name in names:
                    fine = [k for k, error in errors[name] if error <= allowed]
                    per[name] = fine[0] if fine else SIZES[-1]
                key = (order, *per.values())
                if key not in seen:
                    seen.add(key)
                    yield order, self.elements(per)

    def _try_predicted(self) -> None:
        """The cheapest predicted to be good, again and again until one is."""
        ranked = [(self.predictor.cost(each), each) for each in self.all()]
        ranked.sort(key=lambda pair: pair[0])
        for _ in range(TRIES):
            limit = self.best.trial.cost_s if self.best else np.inf
            chosen = next(
                (
                    each
                    for cost, each in ranked
                    if cost < limit
                    and self.predictor.error(each) <= SAFETY
                    and (each.key, None) not in self.event.trials
                ),
                None,
            )
            if chosen is None or not self._affordable(chosen):
                return
            own = self.try_it(chosen)
            if self._good(own):
                return
            if not own.trial.ok:
                self.predictor.scale *= 2.0

    def _swaps(self) -> None:
        """Other integrators and treatments in the best one's place, and in a simpler one's.

        Simpler beams may win with another treatment: rigid bodies in a loop leave few unknowns to
        the null space, which takes long to find.
        """
        if self.best is None:
            return
        self._swaps_of(self.best)
        best = self.best
        for each in sorted(filter(self._good, self.candidates), key=cost_of):
            near = each.trial.cost_s < CLOSE * best.trial.cost_s
            if near and simpler_beams(each.trial.proposal, best.trial.proposal):
                self._swaps_of(each)
                return

    def _swaps_of(self, here: Candidate) -> None:
        for integrator in self.integrators:
            here = self._swap(here, replace(here.trial.proposal, integrator=integrator))
        if here.trial.proposal.planar is not None:  # small scenes may be as fast in space
            here = self._swap(here, replace(here.trial.proposal, planar=None))
        for treatment in self.treatments:
            here = self._swap(here, replace(here.trial.proposal, treatment=treatment))

    def _swap(self, start: Candidate, proposal: Proposal) -> Candidate:
        """The better one of a candidate and of a proposal that is run now."""
        if proposal.key == start.trial.proposal.key or not self._affordable(proposal):
            return start
        own = self.try_it(proposal)
        if not own.trial.ok:
            return start
        cost = own.trial.cost_s / start.trial.cost_s
        before = start.trial.proposal
        if proposal.integrator is not before.integrator:
            error = max(own.error, 0.01) / max(start.error, 0.01)
            self.predictor.integrators[repr(proposal.integrator)] = (error, cost)
        elif proposal.treatment is not before.treatment:
            self.predictor.treatments[repr(proposal.treatment)] = cost
        return own if own is self.best or (self._good(own) and cost < 1.0) else start

    # -- down --------------------------------------------------------------------------------------

    def _step_down(self) -> None:
        """From the best to a cheaper neighbour that is good, until there is none."""
        tried: set[object] = set()
        while self.best is not None:
            here = self.best
            moves = {each.key: each for each in self._neighbours(here.trial.proposal)}
            ranked = sorted(
                ((self.predictor.cost(each), each) for each in moves.values()),
                key=lambda pair: pair[0],
            )
            own = self.predictor.cost(here.trial.proposal)
            for cost, each in ranked:
                simpler = simpler_beams(each, here.trial.proposal)
                if each.key in tried or cost > (ALIKE if simpler else 0.97) * own:
                    continue
                tried.add(each.key)
                if not self._affordable(each):
                    return
                self.try_it(each)
                if self.best is not here:
                    break
            else:
                return

    def _confirm(self) -> None:
        """With half the step it must go through, too: one step that does proves little."""
        self.confirming = True
        for _ in range(TRIES):
            here = self.best
            if here is None:
                return
            own = here.trial.proposal
            finer = _halved(own)
            if not self._affordable(finer):
                return
            trial = self.event.run(finer)
            self._note(trial)
            if trial.status != "diverged":
                self.confirmed = trial.ok
                return
            self.notes.append(f"not robust, with half the step it fails: {own}")
            self.fragile.add(own.key)
            good = [each for each in self.candidates if self._good(each)]
            self.best = min(good, key=cost_of, default=None)

    def _richer(self, own: Proposal, order: int, per: Mapping[str, int]) -> Proposal:
        """With more nodes than `per` elements a piece have, perhaps of another order."""
        more = {
            name: min([s for s in SIZES if s * order > k * own.order], default=SIZES[-1])
            for name, k in per.items()
        }
        return replace(own, order=order, elements=self.elements(more))

    def _neighbours(self, own: Proposal) -> Iterator[Proposal]:
        """One thing coarser or simpler, or one coarser and another one finer."""
        per = {name: own.elements[name] // p for name, p in self.event.pieces.items()}
        meshed = [name for name, theory in own.theory.items() if theory.meshed]
        if own.steps % 2 == 0 and own.steps // 2 >= self.event.base // 4:
            longer = replace(own, steps=own.steps // 2, step=2 * own.step)
            richer = (self._richer(longer, order, per) for order in ORDERS if meshed)
            for each in (longer, *richer):
                for integrator in self.integrators:
                    yield replace(each, integrator=integrator)
        for names in [meshed, *([name] for name in meshed if len(meshed) > 1)]:
            fewer = {
                name: max([s for s in SIZES if s < k], default=1) if name in names else k
                for name, k in per.items()
            }
            yield replace(own, elements=self.elements(fewer))
        for order in (own.order - 1, own.order + 1):
            if meshed and order in ORDERS:
                yield replace(own, order=order)
                nodes = {
                    name: max([s for s in SIZES if s * order < k * own.order], default=1)
                    for name, k in per.items()
                }
                yield replace(own, order=order, elements=self.elements(nodes))
        for name, theory in own.theory.items():
            for other in THEORIES[: THEORIES.index(theory)]:
                if self.predictor.theory.get((name, str(other)), np.inf) <= HOPELESS:
                    yield replace(own, theory=dict(own.theory) | {name: other})


def _halved(proposal: Proposal) -> Proposal:
    """With half the step."""
    return replace(proposal, steps=2 * proposal.steps, step=proposal.step / 2)
