"""Meshes refined where it matters, until a quantity is right to a tolerance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from ..diagnostics import missing_strains
from ..diagnostics.error import beam_of
from ..errors import Diverged, InputError
from ..history import History
from ..log import logger
from ..mesh import MeshCurve
from ..model import Model, System
from ..types import Floats, positive
from .levels import Adapted, Level
from .quantity import Quantity
from .runs import Run, RunStatic
from .space import ALONE, Meshes, Space, beams, checked_space, named, owners, whole
from .strategy import Change, HalveOrRaise, Outlook, Strategy

__all__ = ["adapt"]

#: Highest order of elements.
HIGHEST = 4
#: How many times larger than their signed sum shares may be taken to be: what cancels today need
#: not tomorrow.
CANCEL = 2.0

Build: TypeAlias = Callable[[Any, Any], Model | System]


def adapt(
    build: Build,
    mesh: Meshes,
    quantity: Quantity,
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
        (n,), e.g. :class:`NodePosition`.
    tolerance : float
        Of its error: the largest over the times of the norm, in its unit.
    run : Run, optional
        :class:`RunStatic` (default) or :class:`RunInTime`.
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
    study = _Study.checked(
        build, mesh, quantity, tolerance, run, order, highest, strategy, safety, levels, unknowns
    )
    return study.go()


@dataclass(eq=False)
class _Study:
    """The arguments of :func:`adapt`, checked, and its loop."""

    build: Build
    space: Space
    alone: bool
    quantity: Quantity
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
        quantity: Quantity,
        tolerance: float,
        run: Run | None,
        order: int | Mapping[str, int],
        highest: int,
        strategy: Strategy | None,
        safety: float,
        levels: int,
        unknowns: int,
    ) -> _Study:
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
        system = model.freeze() if isinstance(model, Model) else model
        if not isinstance(system, System):
            raise InputError("argument build", f"gave {model!r}, expected a Model")
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
        return self.noted(coarse, value, _size(error), shares, origin)

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
                    return self.ended(True, "within the tolerance", coarse, rough, best)
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

    def ended(
        self, reached: bool, reason: str, system: System, history: History, best: Floats
    ) -> Adapted:
        """The result."""
        if not reached:
            logger.warning(
                "the tolerance %.3g was not reached: %s, estimate %.3g",
                *(self.tolerance, reason, self.levels[-1].estimate),
            )
        return Adapted(reached, reason, self.tolerance, self.levels, system, history, best)


def _size(error: Floats) -> float:
    """Largest norm over the times of differences (T, k)."""
    return float(np.linalg.norm(error, axis=1).max())
