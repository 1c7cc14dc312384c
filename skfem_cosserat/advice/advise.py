"""Advice: which model, mesh, step and method meet a tolerance at least cost."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..accuracy.table import ResultTable
from ..arguments import checked
from ..constraints import Multipliers, NullSpace, Treatment
from ..errors import InputError
from ..figures import check_folder
from ..integrators import EnergyMomentum, Integrator, Variational
from ..model import Model, System, model_of
from ..run import Sensor
from ..types import ArrayLike, positive, whole
from ..warn import sum_up, told
from .proposals import Proposal
from .reference import ORDER, FinestRun, find_reference
from .search import Candidate, Search
from .trials import NUDGE, PATIENCE, Budget, Pilot, Start, Targets, Trials, check_start

if TYPE_CHECKING:
    pass

# -- what the advisor gives: a proposal, its errors and costs, all candidates, and why -------------

ErrorSize = float | dict[str, float]


@checked
@dataclass
class Advice:
    """Result of :func:`advise`.

    Attributes
    ----------
    proposal : Proposal or None
        The cheapest that was seen to be within the tolerance; None: none was.
        ``proposal.build(model)`` is the scene of it.
    predicted_error, true_error : float, or dict of str to float
        The largest of the quantities' errors as they were predicted before the proposal was run,
        and as measured against the reference; by quantity if the tolerance was so.
    reference_error : float, or dict of str to float
        Estimated error of the reference itself.
    predicted_cost_s, true_cost_s : float
        Processor time of the whole event (s); the true one is the least that its first step and
        an iteration have taken in all runs of that scene with that method.
    confident : bool
        Whether true error and that of the reference together are within the tolerance, and
        nothing speaks against both.
    reasons : list of str
        What does.
    candidates : list of dict
        A row for each proposal that was run: theories, order, elements, integrator, treatment,
        step, unknowns, error, cost, status, warnings (in words); not "robust": it goes through,
        with half the step it fails.
    explanation : str
        All that as a table and sentences.
    spent_s : float
        Processor time of the advice (s).
    until : float
        How long the event is (s).
    reference : Proposal or None
        What errors were measured against.
    pilot : Pilot
        Energies, frequencies and bending of a pilot run.
    """

    proposal: Proposal | None
    predicted_error: ErrorSize
    true_error: ErrorSize
    reference_error: ErrorSize
    predicted_cost_s: float
    true_cost_s: float
    confident: bool
    reasons: list[str]
    candidates: list[dict[str, Any]]
    explanation: str = ""
    spent_s: float = 0.0
    until: float = np.nan
    reference: Proposal | None = None
    pilot: Pilot = field(default_factory=Pilot, repr=False)

    def __str__(self) -> str:
        return self.explanation

    def build(self, model: Model | System) -> Model:
        """The scene of the proposal; `model` does not change.

        Raises
        ------
        InputError
            If there is no proposal, or it is not the model that was advised on.
        """
        if self.proposal is None:
            raise InputError("advice", "has no proposal: " + "; ".join(self.reasons))
        return self.proposal.build(model)

    @property
    def table(self) -> ResultTable:
        """One row a candidate."""
        return ResultTable(self.candidates)

    def csv(self, path: str | os.PathLike[str]) -> None:
        """Write the candidates, one a line.

        Raises
        ------
        InputError
            If the folder does not exist.
        """
        check_folder(path)
        self.table.to_csv(path)


def explained(advice: Advice, lines: Sequence[str], tolerance: dict[str, float]) -> str:
    """The table of the best candidates of each kind, and what was found."""
    columns = ("theories", "p", "elements", "steps", "method", "error/tol", "cost s")
    head = "{:<28} {} {:>14} {:>6} {:<28} {:>9} {:>8}".format(*columns)
    rows = [head, "-" * len(head)]
    for row in _worth_telling(advice.candidates):
        mark = " <-" if row["chosen"] else "" if row["robust"] else " fails with half the step"
        error = f"{row['error']:.3g}" if row["status"] == "ok" else row["status"]
        rows.append(
            f"{row['theories'][:28]:<28} {row['order']:>1} {row['elements'][:14]:>14}"
            f" {row['steps']:>6} {(row['integrator'] + ', ' + row['treatment'])[:28]:<28}"
            f" {error:>9} {row['cost_s']:>8.3g}{mark}"
        )
    rows += [
        f"warned: {row['theories']}, {row['steps']} steps: {row['warnings']}"
        for row in advice.candidates
        if row["chosen"] and row["warnings"]
    ]
    wanted = ", ".join(f"{name} to {each:.3g}" for name, each in tolerance.items())
    what = [f"{wanted} until {advice.until:.4g} s"]
    if advice.proposal is not None:
        what += [f"proposal: {advice.proposal}"]
        what += [
            f"error {_sizes(advice.true_error)} (predicted {_sizes(advice.predicted_error)}),"
            f" of the reference {_sizes(advice.reference_error)};"
            f" cost {advice.true_cost_s:.3g} s (predicted {advice.predicted_cost_s:.3g} s)"
        ]
    what += ["confident" if advice.confident else "not confident: " + "; ".join(advice.reasons)]
    return "\n".join(
        [
            *what,
            *lines,
            f"{len(advice.candidates)} candidates run in {advice.spent_s:.3g} s:",
            *rows,
        ]
    )


def _sizes(error: ErrorSize) -> str:
    if isinstance(error, dict):
        return ", ".join(f"{name} {each:.3g}" for name, each in error.items())
    return f"{error:.3g}"


def _worth_telling(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those that no other one beats in both error and cost, and failures."""
    done = sorted((row for row in rows if row["status"] == "ok"), key=lambda row: row["cost_s"])
    out, least = [], np.inf
    for row in done:
        if row["error"] < least or row["chosen"]:
            out.append(row)
            least = min(least, row["error"])
    return out + [row for row in rows if row["status"] != "ok"][:5]


# -- the advisor: the cheapest model, mesh, integrator and step that give what is asked ------------

#: starts that are apart by a part of the scene's extent may grow apart so many times as far
CHAOS = 1e3


@checked
def advise(
    model: Model | System,
    quantities: Mapping[str, Sensor | Callable[..., ArrayLike]],
    tolerance: float | Mapping[str, float],
    budget_s: float | None = None,
    seed: int = 0,
    *,
    until: float | None = None,
    start: Start = None,
    integrators: Sequence[Integrator] = (EnergyMomentum(), Variational()),
    treatments: Sequence[Treatment] = (NullSpace(), Multipliers()),
    kernels: str = "numpy",
    base: int = 32,
) -> Advice:
    """Find out how simple a model, how coarse a mesh and how long a step a scene allows.

    Every candidate is run through the whole event, and compared with a reference whose own error
    is estimated below a tenth of the tolerance. The model itself never changes.

    Parameters
    ----------
    model : Model or System
    quantities : dict of str to quantity
        What is wanted: sensors, functions ``f(history)``, or ``f(system, state)`` (both get
        recorded states, ``base + 1`` of them; items are to be found by name in
        ``system.structures``, as other beams stand there). Compared are values at all instants
        that both runs have, by the largest Euclidean distance.
    tolerance : float or dict of str to float
        Largest error of all or each of them, in their units.
    budget_s : float, optional
        Processor time of the advice (s); default: as long as it takes.
    seed : int
        Of the order in which things are tried and of the nudge that shows whether the scene is
        chaotic.
    until : float, optional
        How long the event is (s); default: twice as long as tables of loads, a swing under
        gravity, a passage at the initial speed, whichever is longest.
    start : State or callable, optional
        State of the model's own system, or ``start(system)`` for whatever stands in its place;
        default: the items' initial velocities.
    integrators, treatments : sequence
        To choose from, the first one first.
    kernels : str
        See :func:`simulate`; costs are those with these, without compiling. With "numba" nothing is
        confined to a plane, where compiled kernels take fewer scenes.
    base : int
        The smallest number of steps; others are that many times a power of two.

    Returns
    -------
    Advice
        ``advice.proposal``, errors and costs, predicted and true; ``print(advice)`` explains.

    Raises
    ------
    InputError
        For bad arguments, before anything is run.

    Examples
    --------
    A pendulum of steel may be rigid:

    >>> import skfem_cosserat as sc
    >>> mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    >>> steel = sc.SectionCircle(radius=5e-3, material=sc.Material(E=210e9, nu=0.3, rho=7850))
    >>> model = sc.Model()
    >>> rod = model.add("rod", sc.Beam(mesh, steel, director=(0, 1, 0)))
    >>> pin = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 1, 0))
    >>> pin = model.add("pin", pin)
    >>> weight = model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    >>> sensors = {"tip": sc.SensorPosition(rod.node("rod.end"))}
    >>> advice = advise(model, sensors, tolerance=0.02, until=0.5)
    >>> str(advice.proposal.theory["rod"]), advice.confident, bool(advice.true_error < 0.02)
    ('rigid', True, True)
    """
    model = model_of(model)
    wanted = _checked(quantities, tolerance, seed, integrators, treatments, base)
    budget = Budget(None if budget_s is None else positive("argument budget_s", "value", budget_s))
    check_start(start)
    event = Trials(model, wanted, until, start, kernels, base, budget)
    reference = find_reference(event)
    if reference.trial is None:
        return _nothing(event, reference)
    search = Search(event, reference, integrators, treatments, np.random.default_rng(seed))
    search.look()
    reasons = [*reference.doubts, *_chaos(event, search, seed)]
    search.go()
    advice = _advice(event, reference, search, reasons)
    if search.best is not None:
        item = "advice, its proposal and reference"
        runs = {"proposal": search.best.trial, "reference": reference.trial}
        about = {name: trial.warnings for name, trial in runs.items()}
        sum_up(item, "runs", about, "advice.candidates, print(advice)")
    return advice


def _checked(
    quantities: Any,
    tolerance: Any,
    seed: Any,
    integrators: Any,
    treatments: Any,
    base: Any,
) -> Targets:
    """The quantities, after a look at all arguments."""
    whole("argument seed", seed, 0)
    whole("argument base", base, 8)
    for name, given, kind in (
        ("integrators", integrators, Integrator),
        ("treatments", treatments, Treatment),
    ):
        if not given or not all(isinstance(each, kind) for each in given):
            raise InputError(f"argument {name}", f"{given!r}, expected a list of {kind.__name__}")
    return Targets(quantities, tolerance)


def _chaos(event: Trials, search: Search, seed: int) -> list[str]:
    """Whether a nudge at the start grows beyond all measure."""
    fine = search.fine
    if not fine.ok or not event.budget.allows(2 * fine.cost_s):
        return ["the budget ran out before a nudged run could show whether the scene is chaotic"]
    nudged = event.run(replace(fine.proposal, planar=None), PATIENCE * fine.cost_s, seed)
    if not nudged.ok:
        return [f"a nudge of {NUDGE:g} at the start makes the run fail ({nudged.reason})"]
    growth = 0.0
    for name in event.quantities.names:
        one, other = fine.readings[name], nudged.readings[name]
        size = max(one.span, event.quantities.tolerance[name])
        growth = max(growth, one.distance(other) / size / NUDGE)
    search.growth = growth
    if growth <= CHAOS:
        return []
    return [f"chaotic: a nudge at the start grows {growth:.2g} times"]


def _advice(event: Trials, reference: FinestRun, search: Search, reasons: list[str]) -> Advice:
    best, wanted = search.best, event.quantities
    if best is None:
        reasons.append("no candidate is within the tolerance")
    elif best.error + reference.error > 1.0:
        reasons.append("error and that of the reference are above the tolerance together")
    elif not search.confirmed:
        reasons.append("the budget ran out before the proposal was run with half its step")
    advice = Advice(
        best.trial.proposal if best else None,
        wanted.given(best.predicted_error if best else np.nan),
        _error(event, reference, best),
        wanted.given(reference.error),
        best.predicted_cost_s if best else np.nan,
        best.trial.cost_s if best else np.nan,
        not reasons,
        reasons,
        [_row(each, best, search.fragile) for each in search.candidates],
        spent_s=event.budget.spent,
        until=event.until,
        reference=reference.trial.proposal if reference.trial else None,
        pilot=search.pilot,
    )
    lines = [*_found(reference, search), *search.notes]
    advice.explanation = explained(advice, lines, wanted.tolerance)
    return advice


def _nothing(event: Trials, reference: FinestRun) -> Advice:
    nan = event.quantities.given(np.nan)
    rows = [_row(Candidate(each, np.inf), None, ()) for each in event.plain]
    advice = Advice(None, nan, nan, nan, np.nan, np.nan, False, reference.doubts, rows)
    advice.spent_s, advice.until = event.budget.spent, event.until
    advice.explanation = explained(advice, [], event.quantities.tolerance)
    return advice


def _error(event: Trials, reference: FinestRun, best: Candidate | None) -> float | dict[str, float]:
    """Against the reference, in the units of the quantities."""
    if best is None or reference.trial is None:
        return event.quantities.given(np.nan)
    found = event.quantities.distances(best.trial.readings, reference.trial.readings)
    return max(found.values()) if event.quantities.single else found


def _row(own: Candidate, best: Candidate | None, fragile: Collection[Hashable]) -> dict[str, Any]:
    trial, proposal = own.trial, own.trial.proposal
    meshed = [name for name, theory in proposal.theory.items() if theory.meshed]
    return {
        "theories": ", ".join(str(theory) for theory in proposal.theory.values()),
        "order": proposal.order if meshed else "",
        "elements": ", ".join(str(proposal.count(name)) for name in proposal.theory),
        "integrator": proposal.integrator.name,
        "treatment": proposal.treatment.name,
        "planar": proposal.planar is not None,
        "steps": proposal.steps,
        "step_s": proposal.step,
        "unknowns": trial.unknowns,
        "error": own.error,
        "predicted_error": own.predicted_error,
        "cost_s": trial.cost_s,
        "predicted_cost_s": own.predicted_cost_s,
        "iterations": trial.iterations,
        "status": trial.status,
        "reason": trial.reason,
        "warnings": told(trial.warnings),
        "robust": proposal.key not in fragile,
        "chosen": own is best,
    }


def _found(reference: FinestRun, search: Search) -> list[str]:
    """What is known of the axes."""
    out = search.pilot.lines(
        search.best.trial.proposal.step if search.best else search.fine.proposal.step
    )
    for (name, theory), error in search.predictor.theory.items():
        out.append(f"{name} as {theory}: {error:.2g} tolerances off")
    for name, known in search.predictor.fine.items():
        table = ", ".join(f"{size}: {error:.2g}" for size, error in sorted(known.items()))
        out.append(f"{name} in elements of order {ORDER} a piece: tolerances off: {table}")
    for order, sizes in sorted(search.predictor.mesh.items()):
        table = ", ".join(f"{size}: {error:.2g}" for size, error in sorted(sizes.items()))
        even = ", ".join(f"{name}: {k}" for name, k in search.predictor.even.items())
        out.append(f"order {order}, times {even} elements a piece: tolerances off: {table}")
    table = ", ".join(f"{n}: {d:.2g}" for n, d in sorted(reference.time.items()))
    out.append(f"steps: tolerances that twice as many change: {table}")
    out.append(f"a nudge at the start grows {search.growth:.2g} times")
    return out
