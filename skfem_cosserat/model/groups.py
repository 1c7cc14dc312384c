"""Elements of one kind as arrays, beams by their interpolation, and masses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from scipy.sparse import csr_matrix

from ..body import MassPoint, RigidBody
from ..damping import RayleighDamping
from ..errors import InputError
from ..frames import is_beam
from ..kernels import (
    BeamElements,
    add_scalar,
    beam_damping,
    beam_discrete_moduli,
    beam_discrete_stress,
    beam_dissipation,
    beam_force,
    beam_geometric,
    beam_moduli,
    beam_strain,
    beam_stress,
    beam_viscous_stress,
    bilinear,
    mass_blocks,
)
from ..law import Law
from ..pattern import FrozenPattern
from ..types import NO_INDICES, Array, Floats, IndexArray

if TYPE_CHECKING:
    from ..beam import Beam

# -- the constant mass matrix of a scene, and the factors of damping in proportion to it -----------

Structure: TypeAlias = "Beam | RigidBody | MassPoint"

#: Of a body or mass point: vertex, scalar mass (4, 4) or (1, 1), whether that is a frame's.
NodalMass = tuple[int, Floats, bool]


def assemble_mass(
    structures: Sequence[Structure],
    masses: Mapping[int, Floats],
    first: Mapping[int, tuple[int, int]],
    size: int,
) -> tuple[csr_matrix, list[NodalMass]]:
    """Mass matrix (64), (114) without the factor I_3, and the masses of single vertices.

    Parameters
    ----------
    structures : sequence of items
    masses : dict
        ``id(item) -> scalar mass`` of it, or a multiple for a drag matrix; zero if not there.
    first : dict
        ``id(item) -> (first vertex, first row of y)``.
    size : int
        Rows of y.
    """
    i, j, c = [NO_INDICES], [NO_INDICES], [np.zeros(0)]

    def add(rows: IndexArray, blocks: Floats) -> None:
        ne, r = rows.shape
        i.append(np.broadcast_to(rows[:, :, None], (ne, r, r)).ravel())
        j.append(np.broadcast_to(rows[:, None, :], (ne, r, r)).ravel())
        c.append(blocks.ravel())

    nodal_masses = []
    for item in structures:
        if id(item) not in masses:
            continue
        mass_of_item = masses[id(item)]
        if is_beam(item):
            add(_rows(item.basis.connectivity, first[id(item)][1]), mass_of_item)
            continue
        place = lumped(item).on
        host, node = (item, 0) if place is None else (place.item, place.vertex)
        vertex, row = first[id(host)]
        framed = len(mass_of_item) == 4
        nodal_masses.append((vertex + node, mass_of_item, framed))
        step = 4 if framed or is_beam(host) or isinstance(host, RigidBody) else 1
        add(row + step * node + np.arange(len(mass_of_item))[None], mass_of_item[None])
    entries = np.concatenate(c)
    present = np.flatnonzero(entries)
    columns = np.concatenate(j)[present]
    rows = np.concatenate(i)[present]
    turned = FrozenPattern(columns, rows, (size, size))  # its columns are the rows
    compressed = turned.data(entries[present]), turned.indices, turned.indptr
    return csr_matrix(compressed, shape=(size, size)), nodal_masses


def _rows(nodes: IndexArray, first: int) -> IndexArray:
    """Rows of y (ne, 4 nn) of a beam's elements with nodes (ne, nn)."""
    return (first + 4 * nodes[:, :, None] + np.arange(4)).reshape(len(nodes), -1)


def lumped(item: Structure) -> RigidBody | MassPoint:
    """An item that is no beam."""
    assert isinstance(item, (RigidBody, MassPoint))
    return item


def damping_factors(
    structures: Sequence[Structure], dampings: Sequence[RayleighDamping]
) -> tuple[dict[int, float], dict[int, float]]:
    """Sums of alpha and of beta by ``id(item)``, of items that have any.

    Raises
    ------
    InputError
        If a damping of stiffness alone meets no beam.
    """
    alpha: dict[int, float] = {}
    beta: dict[int, float] = {}
    for damping in dampings:
        items = structures if damping.items is None else damping.items
        beams = [item for item in items if is_beam(item)]
        if not beams and not damping.mass:
            raise InputError(damping.label, "damps the stiffness of beams, and there are none")
        for item in items if damping.mass else ():
            alpha[id(item)] = alpha.get(id(item), 0.0) + damping.mass
        for item in beams if damping.stiffness else ():
            beta[id(item)] = beta.get(id(item), 0.0) + damping.stiffness
    return alpha, beta


# -- groups of equal blocks: all beam elements of one interpolation, single frames, mass points ----
#
# The tangent of a step is a list of block arrays, one for each group. Treatments know the groups'
# connectivity and nothing else of the items; items never see a treatment.


@dataclass(eq=False)
class Parts:
    """Blocks of a group that are not multiplied out: ``scalar x 1_3 + left^T weight right``.

    Projected by the null space matrices of the nodes they cost less than their blocks.

    Attributes
    ----------
    scalar : (ne, r, r) array
        Mass and geometric part: the same for x, y and z.
    left, right : (ne, 6 ng, 3 r) array or None
        Strains by coordinates; None: there is no such part.
    weight : (ne, ng, 6, 6) array or None
    """

    scalar: Array
    left: Array | None = None
    right: Array | None = None
    weight: Array | None = None

    def blocks(self) -> Array:
        """The blocks (ne, 3 r, 3 r)."""
        if self.left is None or self.right is None or self.weight is None:
            ne, r = self.scalar.shape[:2]
            return add_scalar(np.zeros((ne, 3 * r, 3 * r), self.scalar.dtype), self.scalar)
        return add_scalar(bilinear(self.weight, self.left, self.right), self.scalar)

    def between(self, left: Array, right: Array) -> Array:
        """``left^T blocks right`` for matrices (ne, 3 r, k)."""
        ne, r = self.scalar.shape[:2]
        half = (self.scalar @ right.reshape(ne, r, -1)).reshape(ne, 3 * r, -1)
        if self.left is not None and self.right is not None and self.weight is not None:
            half += bilinear(self.weight, self.left, self.right @ right)
        return left.transpose(0, 2, 1) @ half


#: blocks of a group (ne, 3 r, 3 r), multiplied out or not
Blocks = Array | Parts


@dataclass(eq=False)
class Group:
    """Blocks of one size.

    Attributes
    ----------
    vertices : (ne, nn) int array
        Vertices of each block; all frames (12 coordinates each) or all points (3).
    rows : (ne, r) int array
        Rows of y of each block, in the block's order.
    scalar_mass : (ne, r, r) array
        Constant mass without the factor 1_3.
    framed : bool
        Frames or points.
    scalar_drag : (ne, r, r) array or None
        Drag against space per velocity, ``alpha M``, likewise; None: none.
    """

    vertices: IndexArray
    rows: IndexArray
    scalar_mass: Floats
    framed: bool = True
    scalar_drag: Floats | None = None

    @cached_property
    def mass(self) -> Floats:
        """Constant mass (ne, 3 r, 3 r): nine times as large as :attr:`scalar_mass`."""
        return mass_blocks(self.scalar_mass)

    @cached_property
    def drag(self) -> Floats | None:
        """Drag against space per velocity (ne, 3 r, 3 r); None: none."""
        return None if self.scalar_drag is None else mass_blocks(self.scalar_drag)

    def inertia(self, factor: float) -> Floats:
        """``factor`` times the scalar mass (ne, r, r)."""
        return factor * self.scalar_mass

    @property
    def dofs(self) -> IndexArray:
        """Numbers in q of each block, (ne, 3 r)."""
        return (3 * self.rows[:, :, None] + np.arange(3)).reshape(len(self.rows), -1)


def nodal_group(
    vertices: Sequence[int],
    size: int,
    rows: IndexArray,
    nodal_masses: Sequence[NodalMass],
    drags: Sequence[NodalMass],
) -> Group | None:
    """Single frames (`size` 4) or points (1), with all masses on them.

    Parameters
    ----------
    vertices : list of int
    size : int
    rows : (N,) int array
        First row of y of every vertex.
    nodal_masses, drags : list of NodalMass
        Masses, and drag per velocity.
    """
    if not vertices:
        return None
    number = np.array(vertices, np.int64)
    drag = _summed(vertices, size, drags)
    return Group(
        number[:, None],
        rows[number][:, None] + np.arange(size),
        _summed(vertices, size, nodal_masses),
        framed=size == 4,
        scalar_drag=drag if drag.any() else None,
    )


def _summed(vertices: Sequence[int], size: int, nodal_masses: Sequence[NodalMass]) -> Floats:
    scalar = np.zeros((len(vertices), size, size))
    number = {v: k for k, v in enumerate(vertices)}
    for v, block, _ in nodal_masses:
        if v in number and len(block) == size:
            scalar[number[v]] += block
    return scalar


class BeamGroup(Group):
    """All beam elements of one interpolation, of all beams: one call of each kernel."""

    def __init__(
        self,
        beams: list[tuple[Beam, int, int]],
        masses: Mapping[int, Floats],
        drags: Mapping[int, Floats],
        beta: Mapping[int, float],
    ):
        """`beams`: (beam, its first vertex, its first row of y).

        `masses`, `drags`, `beta`: by ``id(beam)`` scalar mass and drag, Rayleigh's damping.
        """
        first = beams[0][0].elements
        self.interpolation = beams[0][0].basis.interpolation
        connectivity = [(beam.basis.connectivity, v, r) for beam, v, r in beams]
        own = [masses[id(b)] for b, _, _ in beams]
        drag = [drags.get(id(b), 0.0 * mass) for (b, _, _), mass in zip(beams, own, strict=True)]
        super().__init__(
            np.concatenate([c + v for c, v, _ in connectivity]),
            np.concatenate([_rows(c, r) for c, _, r in connectivity]),
            np.concatenate(own),
            scalar_drag=np.concatenate(drag) if any(id(b) in drags for b, _, _ in beams) else None,
        )
        stop = np.cumsum([len(c) for c, _, _ in connectivity])
        #: which elements are whose
        self.slices = {
            id(beam): slice(int(b - len(c)), int(b))
            for (beam, _, _), (c, _, _), b in zip(beams, connectivity, stop, strict=True)
        }
        es = [beam.elements for beam, _, _ in beams]
        damped = [beta.get(id(b), 0.0) for b, _, _ in beams]
        turned = any(e.rotations is not None for e in es)
        self.elements = (
            es[0]  # that of the beam itself, which nobody changes
            if len(es) == 1 and not any(damped)
            else BeamElements(
                lengths=np.concatenate([e.lengths for e in es]),
                points=first.points,
                weights=first.weights,
                table=first.table,
                stiffness=np.concatenate([e.stiffness for e in es]),
                reference=np.concatenate([e.reference for e in es]),
                rotations=np.concatenate([b.rotations for b, _, _ in beams]) if turned else None,
                viscosity=_viscosity(es, damped),
                **_laws(es),
            )
        )

    def gather(self, y: Array) -> Array:
        """Rows of y of each element (ne, 12 nn)."""
        return y.take(self.rows, 0).reshape(len(self.rows), -1)

    def strain(self, y: Array) -> tuple[Array, Array]:
        """Strains (ne, ng, 6) and B (ne, 6 ng, 12 nn) at configuration y (nv, 3)."""
        return beam_strain(self.elements, self.gather(y))

    def stress(self, eps: Array) -> Array:
        """Stress resultants (ne, ng, 6)."""
        return beam_stress(self.elements, eps)

    def moduli(self, eps: Array) -> Array:
        """Derivatives of stresses by strains with weights, :func:`kernels.beam_moduli`."""
        return beam_moduli(self.elements, eps)

    def discrete_stress(self, eps0: Array, S0: Array, eps1: Array) -> Array:
        """Stresses whose work on ``eps1 - eps0`` is the change of the stored energy."""
        return beam_discrete_stress(self.elements, eps0, S0, eps1)

    def discrete_moduli(self, eps0: Array, eps1: Array) -> Array:
        """Twice the derivative of :meth:`discrete_stress` by eps1, with weights."""
        return beam_discrete_moduli(self.elements, eps0, eps1)

    def linear_stress(self, moduli: Array, change: Array) -> Array:
        """Change of the stresses by a small change (ne, ng, 6) of strains; moduli with weights."""
        return (moduli @ change[..., None])[..., 0] / self.elements.measure

    def force(self, B: Array, stress: Array) -> Array:
        """Nodal forces of each element (ne, 12 nn)."""
        return beam_force(self.elements, B, stress)

    def parts(
        self,
        left: Array,
        right: Array,
        stress: Array,
        material: float,
        geometric: float,
        moduli: Array | None = None,
    ) -> Parts:
        """``material * int left^T D right ds + geometric * int S . C/l ds`` of each element.

        See :func:`skfem_cosserat.kernels.beam_tangent`.
        """
        scalar = beam_geometric(self.elements, geometric * stress)
        weight = self.elements.weighted_stiffness if moduli is None else moduli
        return Parts(scalar, left, right, material * weight)

    @property
    def viscous(self) -> bool:
        """True if a section has Kelvin-Voigt damping, its own or Rayleigh's."""
        return self.elements.viscosity is not None

    def strain_rate(self, B: Array, velocity: Array) -> Array:
        """Strain rates ``B qdot`` (ne, ng, 6) of velocities (nv, 3).

        With B at the midpoint of a step and ``(q_1 - q_0)/h`` they are ``(eps_1 - eps_0)/h``,
        exactly: strains are quadratic. A rigid turn has none, however large the step.
        """
        return (B @ self.gather(velocity)[:, :, None]).reshape(len(B), -1, 6)

    def viscous_stress(self, rate: Array) -> Array:
        """Viscous part (ne, ng, 6) of the resultants, of a viscous group."""
        return beam_viscous_stress(self.elements, rate)

    def dissipation(self, rate: Array) -> float:
        """Power (W) that a viscous group dissipates at strain rates (ne, ng, 6)."""
        return float(beam_dissipation(self.elements, rate).sum())

    def damping(self, B: Array, B_right: Array | None = None) -> Array:
        """Damping matrices ``int B^T eta B_right ds`` (ne, 12 nn, 12 nn), B_right = B by default.

        Zero for a group without viscosity.
        """
        if not self.viscous:
            return np.zeros_like(self.mass)
        return beam_damping(self.elements, B, B if B_right is None else B_right)


def _viscosity(elements: Sequence[BeamElements], betas: Sequence[float]) -> Floats | None:
    """Viscosity of sections and ``beta D`` of all elements (ne, ng, 6, 6); None without any."""
    if not any(betas) and all(e.viscosity is None for e in elements):
        return None
    return np.concatenate(
        [
            beta * e.stiffness + (0.0 if e.viscosity is None else e.viscosity)
            for e, beta in zip(elements, betas, strict=True)
        ]
    )


def _laws(elements: Sequence[BeamElements]) -> dict[str, Any]:
    """Laws of all elements that are not quadratic, and which points have them."""
    laws: list[Law] = []
    numbers = []
    for e in elements:
        none = np.full(e.stiffness.shape[:2], -1)
        own = none if e.law_of is None else np.where(e.law_of < 0, -1, e.law_of + len(laws))
        numbers.append(own)
        laws += e.laws
    return {"laws": tuple(laws), "law_of": np.concatenate(numbers) if laws else None}
