"""Meshes that follow an estimated error: spaces, strategies, levels, and what came of them."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..accuracy.table import ResultTable
from ..arguments import checked
from ..beam import Beam
from ..diagnostics import missing_strains
from ..diagnostics.error import beam_of
from ..errors import AccuracyWarning, Diverged, InputError
from ..history import History
from ..mesh import MeshCurve
from ..model import Model, System, system_of
from ..types import Floats, IndexArray, numbers, positive
from ..warn import Notices, logger, sum_up, told, warn
from .runs import OfConfiguration, Run, RunStatic

if TYPE_CHECKING:
    pass

# -- what to do about an error: which elements to halve, which orders to raise ---------------------

#: part of an element's share that one order more leaves at least: decays are guesses
LEAST = 1e-3


@dataclass(frozen=True, eq=False)
class Outlook:
    """What a strategy decides by; all mappings by the names of meshes.

    Attributes
    ----------
    shares : mapping of str to (ne,) array
        Magnitudes of the elements' shares in the error.
    decays : mapping of str to (ne,) array
        Part of them that elements of one order more are expected to leave.
    orders : mapping of str to int
    highest : int
        Highest order allowed.
    aim : float
        Part of the sum of all shares that may remain.
    """

    shares: Mapping[str, Floats]
    decays: Mapping[str, Floats]
    orders: Mapping[str, int]
    highest: int
    aim: float

    @property
    def total(self) -> float:
        """Sum of all shares."""
        return sum(float(s.sum()) for s in self.shares.values())


@dataclass(frozen=True, eq=False)
class Change:
    """What to do: elements to halve, and orders, by the names of meshes."""

    marked: Mapping[str, IndexArray]
    orders: Mapping[str, int]

    def __str__(self) -> str:
        count = sum(len(m) for m in self.marked.values())
        orders = sorted(set(self.orders.values()))
        return f"halved {count}" if count else f"order {', '.join(map(str, orders))}"


class Strategy(ABC):
    """A choice of what to do about an error."""

    @abstractmethod
    def choose(self, outlook: Outlook) -> Change:
        """The next mesh and orders."""

    def rescue(self, counts: Mapping[str, int], orders: Mapping[str, int], highest: int) -> Change:
        """What to do where the problem could not be solved: all elements are halved.

        Parameters
        ----------
        counts : mapping of str to int
            Elements of each mesh.
        orders : mapping of str to int
        highest : int
        """
        return Change({k: np.arange(n) for k, n in counts.items()}, orders)


class Uniform(Strategy):
    """All elements are halved: for comparison."""

    def choose(self, outlook: Outlook) -> Change:
        """See the base class."""
        everything = {k: np.arange(len(s)) for k, s in outlook.shares.items()}
        return Change(everything, outlook.orders)


@dataclass(frozen=True)
class Halve(Strategy):
    """The elements with the largest shares are halved.

    They are as many as it takes to reach the aim, if halving an element of order p leaves
    ``2^(-2 p)`` of its share; at most so many that they have `bulk` of all shares.

    Parameters
    ----------
    bulk : float
        Above 0, at most 1.
    """

    bulk: float = 0.7

    def __post_init__(self) -> None:
        bulk = numbers("strategy", "bulk", self.bulk)
        if bulk.shape != () or not 0 < bulk <= 1:
            raise InputError("strategy", f"bulk = {self.bulk!r}, expected a number in (0, 1]")

    def choose(self, outlook: Outlook) -> Change:
        """See the base class."""
        return self._halved(outlook)[0]

    def _halved(self, outlook: Outlook) -> tuple[Change, float, float]:
        """What to halve, the part of all shares that is expected to remain, and its unknowns."""
        names = list(outlook.shares)
        shares = np.concatenate([outlook.shares[k] for k in names])
        sizes = [len(outlook.shares[k]) for k in names]
        order = np.repeat([outlook.orders[k] for k in names], sizes)
        owner = np.repeat(np.arange(len(names)), sizes)
        element = np.concatenate([np.arange(n) for n in sizes])
        gain = shares * (1 - 0.25**order)
        total = shares.sum()
        if not total > 0:
            return Uniform().choose(outlook), 0.0, float((6 * order).sum())
        ranked = np.argsort(-gain, kind="stable")
        left = 1 - np.cumsum(gain[ranked]) / total
        bulk = int(np.searchsorted(np.cumsum(shares[ranked]) / total, self.bulk * (1 - 1e-12))) + 1
        enough = np.flatnonzero(left <= outlook.aim)
        count = min(bulk, enough[0] + 1 if len(enough) else len(ranked), len(ranked))
        chosen = ranked[:count]
        marked = {k: np.sort(element[chosen[owner[chosen] == i]]) for i, k in enumerate(names)}
        change = Change(marked, outlook.orders)
        return change, float(left[count - 1]), float((6 * order[chosen]).sum())


@dataclass(frozen=True)
class HalveOrRaise(Halve):
    """The elements with the largest shares are halved, or the order of a whole mesh is raised.

    One order more is expected to leave of an element's share what the strains beyond its reach
    have of the energy that those of the degree before have: little where the solution is smooth,
    all of it where it is not. Of both, that is done which lowers the logarithm of the error by
    more for each unknown it adds; what goes below the aim does not count. Where a problem cannot be
    solved all orders are raised: elements of high order can be bent farther.
    """

    def rescue(self, counts: Mapping[str, int], orders: Mapping[str, int], highest: int) -> Change:
        """See the base class."""
        if min(orders.values()) >= highest:
            return super().rescue(counts, orders, highest)
        nothing = {k: np.zeros(0, dtype=np.int64) for k in counts}
        return Change(nothing, {k: min(p + 1, highest) for k, p in orders.items()})

    def choose(self, outlook: Outlook) -> Change:
        """See the base class."""
        best, left, cost = self._halved(outlook)
        worth = _worth(left, outlook.aim, cost)
        total = outlook.total
        for name, shares in outlook.shares.items():
            if outlook.orders[name] >= outlook.highest or not total > 0:
                continue
            kept = np.clip(outlook.decays[name], LEAST, 1.0)
            left = 1 - float((shares * (1 - kept)).sum()) / total
            value = _worth(left, outlook.aim, 6.0 * len(shares))
            if value > worth:
                worth = value
                orders = {**outlook.orders, name: outlook.orders[name] + 1}
                best = Change({k: np.zeros(0, dtype=np.int64) for k in outlook.shares}, orders)
        return best


def _worth(left: float, aim: float, cost: float) -> float:
    """How much the logarithm of the error falls for each unknown."""
    return float(-np.log(min(max(left, aim, 1e-12), 1.0)) / cost)


# -- meshes and orders of a scene, and which beam lies on which mesh -------------------------------

#: Name of a mesh that was given alone.
ALONE = "mesh"

Meshes: TypeAlias = MeshCurve | Mapping[str, MeshCurve]


@dataclass(eq=False)
class Space:
    """Meshes and their orders."""

    meshes: dict[str, MeshCurve]
    orders: dict[str, int]

    def richer(self, highest: int) -> Space:
        """One order more, or halved elements where there is none."""
        meshes = {
            k: m.refined() if self.orders[k] >= highest else m for k, m in self.meshes.items()
        }
        return Space(meshes, {k: min(p + 1, highest) for k, p in self.orders.items()})

    def richest(self, highest: int) -> Space:
        """Halved elements and one order more."""
        return Space({k: m.refined() for k, m in self.meshes.items()}, self.orders).richer(highest)

    def changed(self, change: Change) -> Space:
        """After a change."""
        meshes = {
            k: m.refined(change.marked[k]) if len(change.marked[k]) else m
            for k, m in self.meshes.items()
        }
        return Space(meshes, dict(change.orders))


def beams(system: System) -> list[Beam]:
    """Beams of a system."""
    return [item for item in system.structures if isinstance(item, Beam)]


def named(name: str) -> str:
    """How errors call a mesh."""
    return "mesh" if name == ALONE else f"mesh {name!r}"


def owners(system: System, meshes: Mapping[str, MeshCurve]) -> dict[str, str]:
    """The name of the mesh of each beam."""
    out = {}
    for beam in beams(system):
        names = [name for name, mesh in meshes.items() if beam.mesh is mesh]
        if not names:
            raise InputError(
                beam.label,
                "lies on a mesh of its own: build must put each beam on a mesh it is given, as it"
                " is, or its error would not be seen",
            )
        out[str(beam.name)] = names[0]
    return out


def whole(name: str, value: object, largest: int | None = None) -> None:
    """Refuse what is no positive integer up to a largest one."""
    integer = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not integer or value < 1 or (largest is not None and value > largest):  # type: ignore[operator]
        upto = "" if largest is None else f" up to {largest}"
        raise InputError(f"argument {name}", f"{value!r}, expected a positive integer{upto}")


def checked_space(mesh: Meshes, order: int | Mapping[str, int], highest: int) -> Space:
    """From the arguments of :func:`skfem_cosserat.adaptive.adapt`."""
    meshes = {ALONE: mesh} if not isinstance(mesh, Mapping) else dict(mesh)
    if not meshes:
        raise InputError("argument mesh", "there is none")
    for name, one in meshes.items():
        if not isinstance(one, MeshCurve):
            raise InputError(
                "argument mesh", f"{name!r} is {type(one).__name__}, expected MeshCurve: lines"
            )
    orders = dict(order) if isinstance(order, Mapping) else dict.fromkeys(meshes, order)
    if set(orders) != set(meshes):
        raise InputError("argument order", f"names {sorted(orders)}, expected {sorted(meshes)}")
    for value in orders.values():
        whole("order", value, highest)
    return Space(meshes, orders)


# -- what adaptive refinement gives: a level for each mesh, and the last solution ------------------


@dataclass(frozen=True, eq=False)
class Level:
    """One mesh of the sequence.

    Attributes
    ----------
    mesh : MeshCurve or dict of str to MeshCurve
        As :func:`adapt` was given it.
    order : int or dict of str to int
    elements, unknowns : int
        Of all beams; of the null space method.
    value : (T, k) array
        The quantity at its T times.
    estimate : float
        Of its error: the largest distance over the times to that of a richer mesh.
    shares : dict of str to (ne,) array
        Of the elements of each mesh in this error; by the adjoint solution with signs.
    origin : str
        Of the shares: "adjoint" or "strains".
    verified : float
        Distance to the quantity on a mesh that is richer twice; NaN where it was not looked at.
    change : str
        What was done next.
    warnings : sequence of dict
        Of its solution, as in ``history.meta["warnings"]``.
    """

    mesh: Meshes
    order: int | Mapping[str, int]
    elements: int
    unknowns: int
    value: Floats
    estimate: float
    shares: Mapping[str, Floats]
    origin: str
    verified: float = float("nan")
    change: str = ""
    warnings: Sequence[dict[str, Any]] = ()


@checked
@dataclass(frozen=True, eq=False)
class Adapted:
    """What :func:`adapt` gives.

    Attributes
    ----------
    reached : bool
        Whether the tolerance was.
    reason : str
        Why it ended.
    tolerance : float
    levels : list of Level
    system : System
        Of the last mesh.
    history : History
        Its solution.
    best : (T, k) array
        The quantity on the richest mesh there was: better than the last value.
    step_error : float
        Error by the step of a run in time: from the change of the quantity by half the step, on
        the last mesh, and the order of the scheme. Zero for equilibria; NaN where the mesh did not
        come so far.
    """

    reached: bool
    reason: str
    tolerance: float
    levels: list[Level]
    system: System
    history: History
    best: Floats
    step_error: float = float("nan")

    @property
    def mesh(self) -> Meshes:
        """The last one, as it was given."""
        return self.levels[-1].mesh

    @property
    def order(self) -> int | Mapping[str, int]:
        """Of the last mesh."""
        return self.levels[-1].order

    @property
    def value(self) -> Floats:
        """The quantity (T, k) on the last mesh."""
        return self.levels[-1].value

    @property
    def unknowns(self) -> int:
        """Of the last mesh."""
        return self.levels[-1].unknowns

    @property
    def estimate(self) -> float:
        """Of the error of the last value, from the richest mesh there was."""
        last = self.levels[-1]
        return last.estimate if np.isnan(last.verified) else last.verified

    @property
    def table(self) -> ResultTable:
        """One row a level: elements, orders, unknowns, values, estimates and what was done."""
        return ResultTable(
            [
                {"level": k, "elements": level.elements, "order": level.order}
                | {"unknowns": level.unknowns}
                | {f"value_{i}": float(each) for i, each in enumerate(level.value.ravel())}
                | {"estimate": level.estimate, "verified": level.verified}
                | {"shares": level.origin, "change": level.change}
                | {"warnings": told(level.warnings)}
                for k, level in enumerate(self.levels)
            ]
        )

    def write_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write the :attr:`table`."""
        return self.table.to_csv(path)


# -- meshes refined where it matters, until a quantity is right to a tolerance ---------------------

#: Highest order of elements.
HIGHEST = 4
#: How many times larger than their signed sum shares may be taken to be: what cancels today need
#: not tomorrow.
CANCEL = 2.0

Build: TypeAlias = Callable[[Any, Any], Model | System]


@checked
def adapt(
    build: Build,
    mesh: Meshes,
    quantity: OfConfiguration,
    tolerance: float,
    *,
    run: Run | None = None,
    order: int | Mapping[str, int] = 2,
    highest: int = HIGHEST,
    strategy: Strategy | None = None,
    safety: float = 1.1,
    levels: int = 20,
    unknowns: int = 20000,
) -> Adapted:
    """Refine a mesh until a quantity is right to a tolerance.

    On each mesh the problem is solved twice: with its elements, and with elements of one order
    more (where they have the highest, halved). The difference is the estimate of the error, the
    shares of the elements in it say where to refine. A mesh is accepted if ``safety`` times the
    estimate is within the tolerance, and so is ``safety`` times the distance to a third solution,
    on a mesh that is richer twice. On a mesh where the problem cannot be solved orders are raised,
    or all elements halved.

    Parameters
    ----------
    build : callable
        ``build(mesh, order)`` gives the model: mesh and order in the form in which they are given
        here, the elements of `mesh` halved where it was refined. It refers to nodes by name or
        position. Each mesh is that of a beam, as it is.
    mesh : MeshCurve or dict of str to MeshCurve
        To begin with.
    quantity : callable
        ``quantity(system, q)``: a number, or a row of numbers of one unit, for a configuration
        (n,), e.g. :class:`~skfem_cosserat.adaptive.NodePosition`.
    tolerance : float
        Of its error: the largest over the times of the norm, in its unit.
    run : Run, optional
        :class:`~skfem_cosserat.adaptive.RunStatic` (default) or
        :class:`~skfem_cosserat.adaptive.RunInTime`.
    order : int or dict of str to int
        To begin with.
    highest : int
        Highest order, up to 4.
    strategy : Strategy, optional
        :class:`HalveOrRaise` (default), :class:`Halve` or :class:`Uniform`.
    safety : float
        1 or more.
    levels, unknowns : int
        When to give up.

    Returns
    -------
    Adapted
        Look at ``reached``.

    Raises
    ------
    InputError, MeshError
        For bad input, before the first solution.
    Diverged
        If the problem cannot be solved on the last mesh allowed, either.

    Notes
    -----
    What the difference of the two solutions tells is the error in space: a time step, what the
    model leaves out, and chords in place of a curve (a mesh from a file) are the same in both. The
    step is looked at once, on the mesh that is accepted: with ``Adapted.step_error`` the error has
    to be within the tolerance, too; else ``reached`` is False, and ``reason`` says why. The
    order is that of a whole beam: where parts are to have orders of their own they must be beams of
    their own on meshes of their own.

    Examples
    --------
    A cantilever of 10 m with a force at 4 m; only the part up to there is bent.

    >>> from skfem_cosserat import Beam, JointFixed, LoadForce, MeshCurve, Model, Section, ground
    >>> from skfem_cosserat.adaptive import NodePosition, adapt
    >>> def build(mesh, order):
    ...     section = Section([1e6, 1e6, 1e6, 1e3, 1e3, 1e3], mass=1.0, inertia=(10.0, 10.0))
    ...     model = Model()
    ...     rod = model.add("rod", Beam(mesh, section, order=order))
    ...     model.add("clamp", JointFixed(ground((0, 0, 0)), rod.node("rod.start")))
    ...     model.add("push", LoadForce(rod.node("hook"), (0, 50.0, 0)))
    ...     return model
    >>> mesh = MeshCurve.init_line((0, 0, 0), (10, 0, 0), 5, name="rod", nodes={"hook": 0.4})
    >>> found = adapt(build, mesh, NodePosition("rod", "rod.end"), tolerance=1e-4, order=1)
    >>> found.reached, bool(found.estimate < 1e-4)
    (True, True)
    """
    study = _Adaptation.checked(
        build, mesh, quantity, tolerance, run, order, highest, strategy, safety, levels, unknowns
    )
    with Notices(quiet=True, alone=True):  # of meshes that are replaced; levels keep their own
        found = study.go()
    if not found.reached:
        text = f"{tolerance:.3g} was not reached: {found.reason}, estimate {found.estimate:.3g}"
        warn("argument tolerance", text, AccuracyWarning)
    last = {"last mesh": found.levels[-1].warnings}
    sum_up("adapted mesh", "meshes", last, "adapted.levels")
    return found


@dataclass(eq=False)
class _Adaptation:
    """The arguments of :func:`adapt`, checked, and its loop."""

    build: Build
    space: Space
    alone: bool
    quantity: OfConfiguration
    tolerance: float
    run: Run
    highest: int
    strategy: Strategy
    safety: float
    most: tuple[int, int]
    levels: list[Level] = field(default_factory=list)

    @classmethod
    def checked(
        cls,
        build: Build,
        mesh: Meshes,
        quantity: OfConfiguration,
        tolerance: float,
        run: Run | None,
        order: int | Mapping[str, int],
        highest: int,
        strategy: Strategy | None,
        safety: float,
        levels: int,
        unknowns: int,
    ) -> _Adaptation:
        """With sound arguments."""
        for name, function in (("build", build), ("quantity", quantity)):
            if not callable(function):
                raise InputError(f"argument {name}", f"{function!r}, expected a function")
        tolerance = positive("argument tolerance", "tolerance", tolerance)
        if positive("argument safety", "safety", safety) < 1:
            raise InputError("argument safety", f"{safety!r}, expected 1 or more")
        whole("highest", highest, HIGHEST)
        whole("levels", levels)
        whole("unknowns", unknowns)
        chosen, how = RunStatic() if run is None else run, strategy or HalveOrRaise()
        for name, value, kind in (("run", chosen, Run), ("strategy", how, Strategy)):
            if not isinstance(value, kind):
                raise InputError(f"argument {name}", f"{value!r}, expected a {kind.__name__}")
        space = checked_space(mesh, order, highest)
        alone = isinstance(mesh, MeshCurve)
        most = (int(levels), int(unknowns))
        return cls(
            build, space, alone, quantity, tolerance, chosen, int(highest), how, safety, most
        )

    # -- parts -------------------------------------------------------------------------------------

    def given(self, of: Mapping[str, Any]) -> Any:
        """In the form in which meshes and orders were given."""
        return of[ALONE] if self.alone else dict(of)

    def system(self, space: Space) -> System:
        """Of a model on these meshes; each of them must carry a beam."""
        model = self.build(self.given(space.meshes), self.given(space.orders))
        system = system_of(model, "argument build: what it gave")
        on = owners(system, space.meshes)
        for name, mesh in space.meshes.items():
            if name not in on.values():
                raise InputError(
                    "argument build",
                    f"gave no beam on the {named(name)} of {mesh.nelements} elements it was given",
                )
        for beam in beams(system):
            wanted = space.orders[on[str(beam.name)]]
            if beam.basis.order != wanted:
                raise InputError(
                    beam.label, f"has order {beam.basis.order}, build was asked for {wanted}"
                )
        return system

    def outlook(self, coarse: System, fine: System, history: History, level: Level) -> Outlook:
        """What the strategy decides by."""
        looks = self.run.looks(history)
        decays = {k: np.zeros(m.nelements) for k, m in self.space.meshes.items()}
        on = owners(coarse, self.space.meshes)
        for beam in beams(coarse):
            beyond, last = missing_strains(
                beam, fine, beam_of(fine, beam.name, beam.label), looks
            ).T
            part = np.divide(beyond, last, out=np.ones_like(last), where=last > beyond)
            mesh = on[str(beam.name)]
            decays[mesh] = np.maximum(decays[mesh], part)
        sizes = {k: abs(s) for k, s in level.shares.items()}
        total = sum(float(s.sum()) for s in sizes.values())
        error = level.estimate if np.isnan(level.verified) else level.verified
        allowed = 0.9 * self.tolerance / self.safety * min(total / (error or 1.0), CANCEL)
        return Outlook(
            sizes, decays, self.space.orders, self.highest, min(allowed / (total or 1.0), 1.0)
        )

    def level(self, coarse: System, fine: System, rough: History, good: History) -> Level:
        """The present mesh, with the shares of its elements in the error."""
        value = self.run.values(self.quantity, coarse, rough)
        error = self.run.values(self.quantity, fine, good) - value
        by_beam, origin = self.run.shares(self.quantity, coarse, fine, rough, good, error)
        shares = {k: np.zeros(m.nelements) for k, m in self.space.meshes.items()}
        for beam, name in owners(coarse, self.space.meshes).items():
            shares[name] = shares[name] + by_beam[beam]
        level = self.noted(coarse, value, _size(error), shares, origin)
        return replace(level, warnings=rough.meta.get("warnings", []))

    def noted(
        self,
        system: System,
        value: Floats,
        estimate: float,
        shares: Mapping[str, Floats],
        origin: str,
    ) -> Level:
        """A level with the present meshes."""
        meshes = self.space.meshes
        count = sum(m.nelements for m in meshes.values())
        forms = self.given(meshes), self.given(self.space.orders)
        return Level(*forms, count, system.unknowns, value, estimate, shares, origin)

    # -- loop --------------------------------------------------------------------------------------

    def go(self) -> Adapted:
        """Mesh after mesh."""
        before: tuple[System, History] | None = None
        coarse = self.system(self.space)
        while True:
            try:
                fine = self.system(self.space.richer(self.highest))
                rough = self.run.solve(coarse, before)
                good = self.run.solve(fine, (coarse, rough))
            except Diverged as error:
                coarse, before = self.rescued(coarse, error), None
                continue
            level = self.level(coarse, fine, rough, good)
            best = self.run.values(self.quantity, fine, good)
            if level.estimate * self.safety <= self.tolerance:
                best, distance = self.verified(level, (fine, good))
                level = replace(level, verified=distance)
                if distance * self.safety <= self.tolerance:
                    self.levels.append(level)
                    return self.of_the_step(level, coarse, rough, best)
            change = self.strategy.choose(self.outlook(coarse, fine, good, level))
            after = self.next(level, change)
            if self.exhausted(after):
                reason = f"{len(self.levels)} levels, next {after.unknowns} unknowns"
                return self.ended(False, reason, coarse, rough, best)
            coarse, before = after, (fine, good)

    def next(self, level: Level, change: Change) -> System:
        """Note a level with what is done about it, and do it."""
        self.levels.append(replace(level, change=str(change)))
        logger.info(
            "%d elements, %d unknowns, estimate %.3g: %s",
            *(level.elements, level.unknowns, level.estimate, change),
        )
        self.space = self.space.changed(change)
        return self.system(self.space)

    def exhausted(self, after: System) -> bool:
        """Whether the next mesh is beyond what is allowed."""
        return len(self.levels) >= self.most[0] or after.unknowns > self.most[1]

    def rescued(self, coarse: System, error: Diverged) -> System:
        """The next system where the problem could not be solved."""
        meshes = self.space.meshes
        nothing = {k: np.full(m.nelements, np.nan) for k, m in meshes.items()}
        value = np.full((1, 1), np.nan)
        level = self.noted(coarse, value, float("inf"), nothing, f"not solved: {error}")
        counts = {k: m.nelements for k, m in meshes.items()}
        change = self.strategy.rescue(counts, self.space.orders, self.highest)
        after = self.next(level, change)
        if self.exhausted(after):
            raise error
        return after

    def verified(self, level: Level, from_: tuple[System, History]) -> tuple[Floats, float]:
        """The quantity on a mesh that is richer twice, and how far it is from the level's."""
        richest = self.system(self.space.richest(self.highest))
        values = self.run.values(self.quantity, richest, self.run.solve(richest, from_))
        return values, _size(values - level.value)

    def of_the_step(self, level: Level, system: System, history: History, best: Floats) -> Adapted:
        """The result on a mesh that is within the tolerance: so the step has to be, too."""
        finer, change, error = self.run.finer(), 0.0, 0.0
        if finer is not None:
            run, order = finer
            try:
                solved = run.solve(system, None)
            except Diverged as failed:  # the levels are kept
                reason = f"the mesh is within the tolerance, half of the step fails: {failed}"
                return self.ended(False, reason, system, history, best)
            change = _size(run.values(self.quantity, system, solved) - level.value)
            error = change / (1 - 0.5**order)
        if (level.verified + error) * self.safety <= self.tolerance:
            done = self.ended(True, "within the tolerance", system, history, best)
        else:
            reason = (
                f"the mesh is within the tolerance, the step is not: half of it changes the"
                f" quantity by {change:.2g}; take a smaller one"
            )
            done = self.ended(False, reason, system, history, best)
        return replace(done, step_error=error)

    def ended(
        self, reached: bool, reason: str, system: System, history: History, best: Floats
    ) -> Adapted:
        """The result."""
        return Adapted(reached, reason, self.tolerance, self.levels, system, history, best)


def _size(error: Floats) -> float:
    """Largest norm over the times of differences (T, k)."""
    return float(np.linalg.norm(error, axis=1).max())
