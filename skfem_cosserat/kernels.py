"""Plain numpy kernels over all elements of a group: arrays in, arrays out.

They are vectorised over elements, accept complex input (so that tangents can be checked by the
complex step) and know no model. Those compiled by numba are in :mod:`skfem_cosserat.compiled`. Of
two plain matrices the product is ``a.dot(b)``: for a few elements its call costs half of that of
``a @ b``.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from .law import Law
from .strain import strain_table
from .types import Array, Floats, IndexArray

if TYPE_CHECKING:
    from .element import Tabulated


@dataclass(eq=False, kw_only=True)
class SectionPoints:
    """What sections resist strains with at points of a line, of any shape (...).

    Attributes
    ----------
    stiffness : (..., 6, 6) array
        Section stiffness at each point.
    viscosity : (..., 6, 6) array or None
        Kelvin-Voigt damping of the sections (N s, N m^2 s); None: none is damped.
    laws : tuple of Law
        Stored energies that are not quadratic.
    law_of : (...) int array or None
        Which of them each point has, -1: the quadratic one of its stiffness. None: all have.
    """

    stiffness: Floats
    viscosity: Floats | None = None
    laws: tuple[Law, ...] = ()
    law_of: IndexArray | None = None
    #: points of each of the laws
    stored: list[tuple[Any, Law]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        law_of = np.asarray(self.law_of)
        self.stored = [(np.nonzero(law_of == k), law) for k, law in enumerate(self.laws)]

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled are the arrays that it is made of: those that follow are made anew."""
        given = {each.name: getattr(self, each.name) for each in fields(self) if each.init}
        return partial(type(self), **given), ()


@dataclass(eq=False, kw_only=True)
class BeamElements(SectionPoints):
    """Constant data of a group of director beam elements of one interpolation.

    Those of sections belong to the Gauss points (ne, ng).

    Attributes
    ----------
    lengths : (ne,) array
        Reference arc lengths (m).
    points, weights : (ng,) array
        Gauss rule on [0, 1].
    table : (ng, 6, k, k) array
        See :func:`skfem_cosserat.strain.strain_table`; k = 12 nn.
    reference : (ne, ng, 6) array
        Strains of the interpolated reference, subtracted: a curved start is stress free.
    rotations : (ne, nn, 3, 3) array or None
        Constant rotation of the section triad against the nodal triad where they differ (beams
        rigidly connected at an angle); None if all coincide.
    """

    lengths: Floats
    points: Floats
    weights: Floats
    table: Floats
    reference: Floats
    rotations: Floats | None = None

    # what the kernels multiply with, computed once
    B_table: Floats = field(init=False, repr=False)
    C_table: Floats = field(init=False, repr=False)
    weighted_stiffness: Floats = field(init=False, repr=False)
    inverse_length: Floats = field(init=False, repr=False)
    measure: Floats = field(init=False, repr=False)
    weighted_viscosity: Floats | None = field(init=False, repr=False, default=None)
    viscosity_root: Floats | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        super().__post_init__()
        ng, _, k, _ = self.table.shape
        # one matrix product gives B of all elements and points
        self.B_table = self.table.reshape(ng * 6 * k, k).T.copy()
        # C is the same for x, y and z: one number for each pair of coordinate vectors
        scalar = self.table.reshape(ng * 6, k // 3, 3, k // 3, 3)[:, :, 0, :, 0]
        # times weights: weight l times the 1/l of C
        self.C_table = self.weights.repeat(6)[:, None] * scalar.reshape(ng * 6, -1)
        self.measure = (self.weights * self.lengths[:, None])[:, :, None]
        self.weighted_stiffness = self.measure[..., None] * self.stiffness
        self.inverse_length = (1 / self.lengths)[:, None]
        if self.viscosity is not None:
            self.weighted_viscosity = self.measure[..., None] * self.viscosity
            # eta = root root^T: what is dissipated is a sum of squares
            values, vectors = np.linalg.eigh(self.viscosity)
            self.viscosity_root = vectors * np.sqrt(values.clip(0))[..., None, :]

    def taken(self, ids: IndexArray) -> BeamElements:
        """The elements of these numbers, each as often as it is there."""
        own = {
            name: array[ids]
            for name in ("lengths", "stiffness", "reference", "rotations", "viscosity", "law_of")
            if (array := getattr(self, name)) is not None
        }
        return replace(self, **own)

    @classmethod
    def create(
        cls,
        q: Floats,
        lengths: Floats,
        tabulated: Tabulated,
        sections: SectionPoints,
        rotations: Floats | None = None,
    ) -> BeamElements:
        """Elements whose reference is the configuration ``q`` (ne, 12 nn)."""
        out = cls(
            lengths=lengths,
            points=tabulated.points,
            weights=tabulated.weights,
            table=_table(tabulated),
            stiffness=sections.stiffness,
            reference=np.zeros((len(lengths), len(tabulated.points), 6)),
            rotations=rotations,
            viscosity=sections.viscosity,
            laws=sections.laws,
            law_of=sections.law_of,
        )
        out.reference, _ = _section_strain(out, q)
        return out


@lru_cache(maxsize=16)
def _table(tabulated: Tabulated) -> Floats:
    """Coefficients of the strains, which all beams of an interpolation share."""
    table = strain_table(tabulated.values, tabulated.slopes)
    table.setflags(write=False)
    return table


def beam_strain(elements: BeamElements, q: Array) -> tuple[Array, Array]:
    """Strains and their derivative.

    Parameters
    ----------
    elements : BeamElements
    q : (ne, 12 nn) array
        Coordinates of each element's nodes.

    Returns
    -------
    eps : (ne, ng, 6) array
        ``(Gamma, K)`` minus their reference values.
    B : (ne, 6 ng, 12 nn) array
        ``delta eps = B delta q``; linear in q.
    """
    eps, B = _section_strain(elements, q)
    if elements.rotations is not None:
        B = _from_section(elements.rotations, B)
    return eps, B


def _section_strain(elements: BeamElements, q: Array) -> tuple[Array, Array]:
    """Strains, and their derivative by coordinates of sections instead of nodes."""
    ne, k = q.shape
    ng = len(elements.points)
    section = q if elements.rotations is None else _to_section(elements.rotations, q)
    B = (section * elements.inverse_length).dot(elements.B_table)
    B = B.reshape(ne, 6 * ng, k)
    eps = (B @ section[:, :, None]).reshape(ne, ng, 6)
    eps *= 0.5
    eps -= elements.reference
    return eps, B


def product(eps: Array, matrices: Floats) -> Array:
    """Strains (..., 6) times the symmetric matrices (..., 6, 6) of their points."""
    return (eps[..., None, :] @ matrices)[..., 0, :]


def beam_stress(sections: SectionPoints, eps: Array) -> Array:
    """Stress resultants ``(N, M)`` (..., 6) in the section's frame: forces in N, moments N m.

    Strains may be a stack of those of all points.
    """
    S = product(eps, sections.stiffness)
    for points, law in sections.stored:
        S[..., *points, :] = law.stress(eps[..., *points, :])
    return S


def beam_energy(sections: SectionPoints, eps: Array) -> Array:
    """Stored energy per length (...) in J/m of strains (..., 6)."""
    W = 0.5 * (eps * product(eps, sections.stiffness)).sum(-1)
    for points, law in sections.stored:
        W[..., *points] = law.energy(eps[..., *points, :])
    return W


def beam_moduli(elements: BeamElements, eps: Array) -> Array:
    """Derivative (ne, ng, 6, 6) of the resultants by the strains, times the weight of the point."""
    if not elements.stored:
        return elements.weighted_stiffness
    return elements.measure[..., None] * section_moduli(elements, eps)


def section_moduli(sections: SectionPoints, eps: Array) -> Array:
    """Derivative (..., 6, 6) of the resultants by the strains (..., 6)."""
    D = np.zeros((*eps.shape, 6)) + sections.stiffness
    for points, law in sections.stored:
        D[..., *points, :, :] = law.tangent(eps[..., *points, :].real)
    return D


def beam_discrete_stress(elements: BeamElements, eps0: Array, S0: Array, eps1: Array) -> Array:
    """Stresses (ne, ng, 6) whose work on ``eps1 - eps0`` is the change of the stored energy.

    The mean of both ends for quadratic energies, S0 at the first one; else
    :meth:`skfem_cosserat.law.Law.discrete`.
    """
    S = 0.5 * (S0 + product(eps1, elements.stiffness))
    for points, law in elements.stored:
        S[points] = law.discrete(eps0[points], eps1[points])
    return S


def beam_discrete_moduli(elements: BeamElements, eps0: Array, eps1: Array) -> Array:
    """Twice the derivative (ne, ng, 6, 6) of these stresses by eps1, times weights."""
    if not elements.stored:
        return elements.weighted_stiffness
    D = elements.stiffness.copy()
    for points, law in elements.stored:
        D[points] = 2 * law.discrete_tangent(eps0[points], eps1[points].real)
    return elements.measure[..., None] * D


def beam_force(elements: BeamElements, B: Array, stress: Array) -> Array:
    """Internal force ``int B^T S ds`` (ne, 12 nn) for stress (ne, ng, 6)."""
    return ((stress * elements.measure).reshape(len(B), 1, -1) @ B)[:, 0]


def beam_tangent(
    elements: BeamElements,
    B_left: Array,
    B_right: Array,
    stress: Array,
    material: float,
    geometric: float,
    moduli: Array | None = None,
) -> Array:
    """``material * int B_left^T D B_right ds + geometric * int S . C/l ds``, (ne, 12nn, 12nn).

    The derivative of ``int B(q_a)^T S* ds`` where ``S*`` depends on the new state through
    ``material * D B_right`` and ``q_a`` through the factor ``geometric``. D with weights as of
    :func:`beam_moduli`; default: the stiffness at zero strain.
    """
    D = elements.weighted_stiffness if moduli is None else moduli
    K = bilinear(material * D, B_left, B_right)
    return add_scalar(K, beam_geometric(elements, geometric * stress))


def beam_geometric(elements: BeamElements, stress: Array) -> Array:
    """``int S . C/l ds`` as (ne, 4 nn, 4 nn), one number for each pair of coordinate vectors.

    The derivative of ``int B(q)^T S ds`` for fixed S is this times the identity of space.
    """
    size = elements.table.shape[-1] // 3
    S = stress.reshape(len(stress), -1)
    G = S.dot(elements.C_table).reshape(len(S), size, size)
    if elements.rotations is None:
        return G
    G = _from_section(elements.rotations, G)
    return _from_section(elements.rotations, G.transpose(0, 2, 1)).transpose(0, 2, 1)


def add_scalar(blocks: Array, scalar: Array) -> Array:
    """Add ``scalar x 1_3`` (ne, r, r) to blocks (ne, 3 r, 3 r) in place."""
    ne, r = scalar.shape[:2]
    by_axis = blocks.reshape(ne, r, 3, r, 3)
    for c in range(3):
        by_axis[:, :, c, :, c] += scalar
    return blocks


def bilinear(weighted: Floats, B_left: Array, B_right: Array) -> Array:
    """``sum_g B_left^T D_g B_right`` (ne, k, l) for weighted D (ne, ng, 6, 6)."""
    ne, rows, k = B_right.shape
    DB = (weighted @ B_right.reshape(ne, rows // 6, 6, k)).reshape(ne, rows, k)
    return B_left.transpose(0, 2, 1) @ DB


def mass_blocks(scalar: Floats) -> Floats:
    """(ne, r, r) without -> (ne, 3r, 3r) with the factor I_3."""
    ne, r = scalar.shape[:2]
    return np.einsum("eij,cd->eicjd", scalar, np.eye(3)).reshape(ne, 3 * r, 3 * r)


def beam_viscous_stress(elements: BeamElements, rate: Array) -> Array:
    """Kelvin-Voigt part ``eta deps/dt`` (ne, ng, 6) of the resultants, for strain rates."""
    assert elements.viscosity is not None
    return product(rate, elements.viscosity)


def beam_dissipation(elements: BeamElements, rate: Array) -> Array:
    """Dissipated power ``int deps/dt . eta deps/dt ds`` (ne,), not negative (W)."""
    assert elements.viscosity_root is not None
    return (product(rate, elements.viscosity_root) ** 2 * elements.measure).sum((1, 2))


def beam_damping(elements: BeamElements, B_left: Array, B_right: Array) -> Array:
    """``int B_left^T eta B_right ds`` (ne, 12nn, 12nn): with ``B(q)`` twice the damping matrix."""
    assert elements.weighted_viscosity is not None
    return bilinear(elements.weighted_viscosity, B_left, B_right)


def _to_section(rotations: Floats, q: Array) -> Array:
    ne, nn = rotations.shape[:2]
    out = q.reshape(ne, nn, 4, 3).copy()
    out[:, :, 1:] = rotations @ out[:, :, 1:]
    return out.reshape(ne, -1)


def _from_section(rotations: Floats, rows: Array) -> Array:
    """Rows (ne, r, 4 nn c) by section coordinates -> by nodal ones (chain rule); c = 1 or 3."""
    ne, r, k = rows.shape
    out = rows.reshape(ne, r, rotations.shape[1], 4, -1).copy()
    out[:, :, :, 1:] = rotations.transpose(0, 1, 3, 2)[:, None] @ out[:, :, :, 1:]
    return out.reshape(ne, r, k)


# -- one-node structures -------------------------------------------------------------------------


def cross(a: Array, b: Array) -> Array:
    """Cross product over the last axis; much faster than numpy's for small arrays."""
    return (a * b.take(_YZX, -1) - a.take(_YZX, -1) * b).take(_YZX, -1)


_YZX = np.array([1, 2, 0])


#: e_ijk
_LEVI = np.zeros((3, 3, 3))
_LEVI[(0, 1, 2), (1, 2, 0), (2, 0, 1)] = 1
_LEVI[(1, 2, 0), (0, 1, 2), (2, 0, 1)] = -1


def skew(v: Array) -> Array:
    """Matrices ``v^`` (..., 3, 3) with ``v^ w = v x w``."""
    return -(v @ _LEVI.reshape(3, 9)).reshape(*v.shape, 3)


def director_force(directors: Array, force: Array) -> Array:
    """Moment ``sum_i d_i x f_i`` (N, 3): the omega rows of ``P_int^T f`` (69)."""
    return (directors.transpose(0, 2, 1) @ force).reshape(-1, 9) @ _LEVI.reshape(9, 3)


def spin_gradient(directors: Array, force: Array) -> Array:
    """Derivative (N, 3, 3) of ``sum_i d_i x f_i`` by a spin of the directors, for fixed forces.

    ``d(d_i) = omega x d_i``: ``sum_i f_i^ d_i^ = W - tr(W) 1`` with ``W = sum_i d_i f_i^T``.
    """
    W = (directors.transpose(0, 2, 1) @ force).reshape(-1, 9)
    return W.dot(_LESS_TRACE).reshape(-1, 3, 3)


_LESS_TRACE = np.eye(9) - np.outer(np.eye(3), np.eye(3))


def null_space_blocks(directors: Array) -> Array:
    """Internal null space matrices ``P_int`` (69) of blocks of nodes (N, 12 nn, 6 nn).

    ``qdot = P_int (phidot, omega)`` for directors (N, nn, 3, 3), or (N, 3, 3) of single nodes:
    rows ``[[I, 0], [0, -d1^], [0, -d2^], [0, -d3^]]`` of each node.
    """
    nn = 1 if directors.ndim == 3 else directors.shape[1]
    each = directors.reshape(-1, nn, 3, 3)
    out = np.zeros((len(each), nn, 4, 3, nn, 2, 3), directors.dtype)
    for a in range(nn):
        out[:, a, 0, :, a, 0] = np.eye(3)
        out[:, a, 1:, :, a, 1] = -skew(each[:, a])
    return out.reshape(-1, 12 * nn, 6 * nn)


# half of a vanishing angle: the sine of it over itself is one, also for complex steps
_QUARTER = np.full((3, 1), 0.25)


def exp_quaternion(theta: Array) -> Array:
    """Unit quaternions ``(w, x, y, z)`` (..., 4) of rotation vectors ``theta`` (..., 3)."""
    # the sine of a vanishing angle over itself is one, also for complex steps
    half = np.sqrt((theta * theta).dot(_QUARTER) + 1e-300)
    out = np.empty((*theta.shape[:-1], 4), theta.dtype)
    np.cos(half, out=out[..., :1])
    np.multiply(np.sin(half) / (2 * half), theta, out=out[..., 1:])
    return out


def _product_table() -> Floats:
    """``(a b)_k = T_ijk a_i b_j`` as (16, 4)."""
    table = np.zeros((4, 4, 4))
    table[0, :, :] = np.eye(4)
    table[1:, 0, 1:] = np.eye(3)
    table[1:, 1:, 0] = -np.eye(3)
    table[1:, 1:, 1:] = _LEVI
    return table.reshape(16, 4)


def _rotation_table() -> Floats:
    """``R - 1 = T_ij q_i q_j`` as (16, 9): ``2 v v^T - 2 v.v 1 + 2 w v^``."""
    # not with w^2 - v.v: the rounding of |q| would add up over many steps as a change of scale
    table = np.zeros((4, 4, 3, 3))
    for i in range(3):
        table[i + 1, i + 1] = -2 * np.eye(3)
        table[0, i + 1] = -2 * _LEVI[:, :, i]
        for j in range(3):
            table[i + 1, j + 1, i, j] += 2
    return table.reshape(16, 9)


_PRODUCT = _product_table()
_ROTATION = _rotation_table()
_UNIT = np.eye(3).ravel()


def _outer(a: Array, b: Array) -> Array:
    """Products of all pairs of numbers, flat: (N, 16) of quaternions (..., 4)."""
    return (a[..., :, None] * b[..., None, :]).reshape(-1, 16)


def quaternion_product(a: Array, b: Array) -> Array:
    """Product ``a b`` (N, 4): the rotation b, then a.

    Not normalised: an error of the length is one of second order in the angle for what
    :func:`rotation_matrix` makes of it.
    """
    return _outer(a, b).dot(_PRODUCT)


def rotation_matrix(quaternion: Array) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions ``(w, x, y, z)``."""
    out = _outer(quaternion, quaternion).dot(_ROTATION)
    out += _UNIT
    return out.reshape(*quaternion.shape[:-1], 3, 3)


def nearest_rotations(triads: Array) -> Floats:
    """Rotations (..., 3, 3) nearest to matrices: their polar decomposition."""
    u, _, vt = np.linalg.svd(triads)
    return u @ vt
