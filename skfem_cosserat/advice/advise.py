"""The advisor: the cheapest model, mesh, integrator and step that give what is asked."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..constraints import Multipliers, NullSpace, Treatment
from ..errors import InputError
from ..integrators import EnergyMomentum, Integrator, Variational
from ..model import Model
from ..types import positive, whole
from .advice import Advice, explained
from .candidate import Candidate
from .event import NUDGE, PATIENCE, Budget, Event, Start, check_start
from .quantities import Quantities, Quantity
from .reference import ORDER, Reference, find_reference
from .search import Search

__all__ = ["advise"]

#: starts that are apart by a part of the scene's extent may grow apart so many times as far
CHAOS = 1e3


def advise(
    model: Model,
    quantities: Mapping[str, Quantity],
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

    Every candidate is run through the whole event. First a reference is refined, in space and
    time, until its own error is estimated below a tenth of the tolerance. Coarser meshes, other
    orders and simpler models of each beam are then compared with each other at one step, and the
    cheapest sum of their errors below the tolerance is run; from there the search goes to cheaper
    neighbours as long as they are good. The model itself never changes.

    Whatever else the machine does changes times, not iterations: costs are those times the least
    that one has taken with that scene and method, and close ones are compared in runs that take
    turns.

    Parameters
    ----------
    model : Model
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
    >>> str(advice.proposal.rung["rod"]), advice.confident, bool(advice.true_error < 0.02)
    ('rigid', True, True)
    """
    wanted = _checked(model, quantities, tolerance, seed, integrators, treatments, base)
    budget = Budget(None if budget_s is None else positive("argument budget_s", "value", budget_s))
    check_start(start)
    event = Event(model, wanted, until, start, kernels, base, budget)
    reference = find_reference(event)
    if reference.trial is None:
        return _nothing(event, reference)
    search = Search(event, reference, integrators, treatments, np.random.default_rng(seed))
    search.look()
    reasons = [*reference.doubts, *_chaos(event, search, seed)]
    search.go()
    return _advice(event, reference, search, reasons)


def _checked(
    model: Model,
    quantities: Any,
    tolerance: Any,
    seed: Any,
    integrators: Any,
    treatments: Any,
    base: Any,
) -> Quantities:
    """The quantities, after a look at all arguments."""
    if not isinstance(model, Model):
        raise InputError("argument model", f"{model!r}, expected a Model")
    whole("argument seed", seed, 0)
    whole("argument base", base, 8)
    for name, given, kind in (
        ("integrators", integrators, Integrator),
        ("treatments", treatments, Treatment),
    ):
        if not given or not all(isinstance(each, kind) for each in given):
            raise InputError(f"argument {name}", f"{given!r}, expected a list of {kind.__name__}")
    return Quantities(quantities, tolerance)


def _chaos(event: Event, search: Search, seed: int) -> list[str]:
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


def _advice(event: Event, reference: Reference, search: Search, reasons: list[str]) -> Advice:
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


def _nothing(event: Event, reference: Reference) -> Advice:
    nan = event.quantities.given(np.nan)
    rows = [_row(Candidate(each, np.inf), None, ()) for each in event.plain]
    advice = Advice(None, nan, nan, nan, np.nan, np.nan, False, reference.doubts, rows)
    advice.spent_s, advice.until = event.budget.spent, event.until
    advice.explanation = explained(advice, [], event.quantities.tolerance)
    return advice


def _error(event: Event, reference: Reference, best: Candidate | None) -> float | dict[str, float]:
    """Against the reference, in the units of the quantities."""
    if best is None or reference.trial is None:
        return event.quantities.given(np.nan)
    found = event.quantities.distances(best.trial.readings, reference.trial.readings)
    return max(found.values()) if event.quantities.single else found


def _row(own: Candidate, best: Candidate | None, fragile: Collection[Hashable]) -> dict[str, Any]:
    trial, proposal = own.trial, own.trial.proposal
    meshed = [name for name, rung in proposal.rung.items() if rung.meshed]
    return {
        "rungs": ", ".join(str(rung) for rung in proposal.rung.values()),
        "order": proposal.order if meshed else "",
        "elements": ", ".join(str(proposal.count(name)) for name in proposal.rung),
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
        "robust": proposal.key not in fragile,
        "chosen": own is best,
    }


def _found(reference: Reference, search: Search) -> list[str]:
    """What is known of the axes."""
    out = search.pilot.lines(
        search.best.trial.proposal.step if search.best else search.fine.proposal.step
    )
    for (name, rung), error in search.predictor.rung.items():
        out.append(f"{name} as {rung}: {error:.2g} tolerances off")
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
