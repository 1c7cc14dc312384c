"""Elastic foundations: springs and dampers along a beam."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import TYPE_CHECKING, Self

import numpy as np

from .coupling import Coupling, semidefinite
from .errors import InputError
from .frames import Item, Place, ground
from .kinds import is_beam
from .relative import displacement
from .twin import Twins
from .types import ArrayLike, Floats, numbers

if TYPE_CHECKING:
    from .beam import Beam

__all__ = ["Foundation"]


class _Support(Coupling):
    """Springs and dampers in space on a node of a beam."""

    kind = "foundation"

    def __init__(self, place: Place, stiffness: Floats, damping: Floats) -> None:
        self.a, self.b = ground(place.position), place
        axes = np.eye(3)
        self.coordinates = tuple(
            displacement(f"u_{k + 1}", self.a, self.b, axis) for k, axis in enumerate(axes)
        )
        self._set_law(stiffness, damping, 0.0)


class Foundation(Item):
    """Elastic (Winkler) foundation of a beam: it is held everywhere along its axis.

    A displacement u of the axis from its reference is resisted by ``k u + c du/dt`` per reference
    length, in space. In the model it is one spring and damper on each node, with the node's weight
    of the Gauss-Lobatto rule: displacements at nodes keep their order 2p. Node k of the beam is
    ``coupling/NAME/k/...`` in histories; the energy is in ``coupling_energy``.

    Parameters
    ----------
    beam : Beam
    stiffness : float, (3,) or (3, 3) array
        k (N/m^2): in all directions, along e1, e2 and e3, or a symmetric positive semidefinite
        matrix.
    damping : float, (3,) or (3, 3) array
        c (N s/m^2), likewise.
    part : str, optional
        Name of a part of the mesh; default: the whole beam.

    Raises
    ------
    InputError
        If `beam` is no beam, both coefficients are zero, or one is negative, not symmetric or not
        finite; MeshError for an unknown part.

    Examples
    --------
    A guided rail that lies on its bed:

    >>> from skfem_cosserat import Beam, JointPrismatic, LoadGravity, MeshCurve, Model
    >>> from skfem_cosserat import Section, static
    >>> section = Section([1e6, 1e6, 1e6, 50, 50, 50], mass=2.0, inertia=(1e-3, 1e-3))
    >>> model = Model()
    >>> mesh = MeshCurve.init_line((0, 0, 0), (3, 0, 0), 4)
    >>> rail = model.add("rail", Beam(mesh, section, director=(0, 0, 1)))
    >>> start = rail.node((0, 0, 0))
    >>> guide = model.add("guide", JointPrismatic(ground((0, 0, 0)), start, axis=(0, 0, 1)))
    >>> bed = model.add("bed", Foundation(rail, stiffness=1e3))
    >>> weight = model.add("weight", LoadGravity((0, 0, -10.0)))
    >>> path = static(model)
    >>> path["q"][-1][2::12].round(9).tolist()   # -20 N/m over 1000 N/m^2
    [-0.02, -0.02, -0.02, -0.02, -0.02]
    """

    kind = "foundation"

    def __init__(
        self,
        beam: Beam,
        stiffness: float | ArrayLike,
        damping: float | ArrayLike = 0.0,
        part: str | None = None,
    ) -> None:
        if not is_beam(beam):
            raise InputError(self.label, f"beam is {type(beam).__name__}, expected a beam")
        self.beam, self.part = beam, part
        self.tensors = tuple(
            self._tensor(name, value)
            for name, value in (("stiffness", stiffness), ("damping", damping))
        )
        self._supports = self._on_nodes()

    def _on_nodes(self) -> dict[int, _Support]:
        """A spring on each node, in proportion to its length."""
        beam, (k, c) = self.beam, self.tensors
        elements = beam.part(self.part)
        weights = np.zeros(len(beam.basis.nodes))
        np.add.at(weights, beam.basis.connectivity[elements], beam.line_weights(elements))
        return {
            int(node): _Support(beam.node(int(node)), weights[node] * k, weights[node] * c)
            for node in np.flatnonzero(weights)
        }

    def _tensor(self, name: str, value: float | ArrayLike) -> Floats:
        """(3, 3) of a number, three or nine."""
        array = numbers(self.label, name, value)
        if array.shape not in ((), (3,), (3, 3)):
            raise InputError(
                self.label, f"{name} has shape {array.shape}, expected a number, (3,) or (3, 3)"
            )
        return semidefinite(self.label, name, array if array.ndim == 2 else array * np.eye(3))

    def twin(self, twins: Twins) -> Self:
        """See the base class; on the nodes that the beam has there."""
        other = copy(self)
        other.name, other.beam = None, twins.of(self.beam)
        if not is_beam(other.beam):
            raise InputError(self.label, f"acts on {other.beam.label}, expected a beam")
        other._supports = other._on_nodes()
        return other

    def supports(self) -> list[Coupling]:
        """Its springs, named after it and the beam's nodes."""
        for node, support in self._supports.items():
            support.name = f"{self.name}/{node}"
        return list(self._supports.values())

    def references(self) -> Sequence[Item]:
        """The beam."""
        return [self.beam]
