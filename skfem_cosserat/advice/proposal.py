"""A proposal: which model of each beam, which mesh, which integrator, treatment and step."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..beam import Beam
from ..constraints import Treatment
from ..integrators import Integrator
from ..model import Model, System
from ..model.plane import Planar
from ..twin import Twins
from .rungs import BeamModel

__all__ = ["Proposal"]


@dataclass(frozen=True)
class Proposal:
    """A model of a scene, and how it is integrated in time.

    Attributes
    ----------
    rung : dict of str to BeamModel
        By beam; ``str(rung["rod"])`` is its name.
    order : int
        Of the elements of all beams.
    elements : dict of str to int
        By beam (none for rigid ones).
    integrator : Integrator
    treatment : Treatment
    steps : int
        Number of steps of the whole event.
    step : float
        (s)
    keep : dict of str to sequence of (int, float)
        By beam: places of its mesh that need a node, as something is attached there.
    planar : Planar or None
        The plane that the scene is confined to, if it stays there anyway.
    """

    rung: Mapping[str, BeamModel]
    order: int
    elements: Mapping[str, int]
    integrator: Integrator
    treatment: Treatment
    steps: int
    step: float
    keep: Mapping[str, Sequence[tuple[int, float]]] = field(repr=False)
    planar: Planar | None = None

    @property
    def scene(self) -> Hashable:
        """Equal for proposals of the same scene, however it is integrated."""
        meshes = tuple((name, self.count(name)) for name in self.rung)
        rungs = tuple((name, str(rung)) for name, rung in self.rung.items())
        order = self.order if any(rung.meshed for rung in self.rung.values()) else 0
        return (rungs, meshes, order, self.planar is None)

    @property
    def method(self) -> Hashable:
        """Equal for equal integrators and treatments."""
        return repr(self.integrator), repr(self.treatment)

    @property
    def kind(self) -> Hashable:
        """Equal for proposals that are stepped by the same code, whatever their meshes."""
        order = self.order if any(rung.meshed for rung in self.rung.values()) else 0
        return frozenset(str(rung) for rung in self.rung.values()), order, self.method

    @property
    def key(self) -> Hashable:
        """Equal for equal proposals."""
        return self.scene, self.method, self.steps

    def count(self, beam: str) -> int:
        """Elements of a beam; zero if it is rigid."""
        return self.elements[beam] if self.rung[beam].meshed else 0

    @property
    def nodes(self) -> int:
        """Nodes of all beams, one for a rigid one, branches not counted."""
        return sum(self.order * self.count(name) + 1 for name in self.rung)

    def build(self, model: Model) -> Model:
        """The scene with these beams; `model` does not change.

        Parameters
        ----------
        model : Model
            The one that was advised on.

        Raises
        ------
        InputError, MeshError
            If a beam cannot be had so.
        """
        return self.rebuilt(model)[0]

    def system(self, model: Model) -> System:
        """The scene with these beams, frozen: in its plane, if there is one."""
        return self.build(model).freeze(planar=self.planar)

    def rebuilt(self, model: Model) -> tuple[Model, Twins]:
        """As :meth:`build`, with what finds the twins of sensors."""
        items: dict[str, Any] = {}
        for name, rung in self.rung.items():
            beam = model[name]
            assert isinstance(beam, Beam)
            keep = self.keep.get(name, ())
            items[name] = rung.item(beam, self.elements[name], self.order, keep)
        return model.rebuilt(items)

    def __str__(self) -> str:
        """In one line."""
        beams = [
            f"{name}: {rung}" + (f", {self.elements[name]} elements" if rung.meshed else "")
            for name, rung in self.rung.items()
        ]
        text = "; ".join(beams)
        if any(rung.meshed for rung in self.rung.values()):
            text += f"; order {self.order}"
        text += "" if self.planar is None else "; in the plane"
        return (
            f"{text}; {self.integrator.name}, {self.treatment.name}, {self.steps} steps of"
            f" {self.step:.3g} s"
        ).lstrip("; ")
