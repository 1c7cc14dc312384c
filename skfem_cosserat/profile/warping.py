"""Stiffness and mass of a section from its mesh: elasticity, warping, constants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix, kron
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree
from skfem import Basis, BilinearForm, Mesh
from skfem.element import Element, ElementQuad2, ElementQuadP, ElementTriP2, ElementTriP3

from ..errors import InputError
from ..frozen import Frozen
from ..kernels import skew
from ..section import Material, Section
from ..types import Array, ArrayLike, Floats, IndexArray, finite, positive, shaped, symmetric

# -- three-dimensional elasticity of what a profile is made of -------------------------------------

#: Pairs of axes in Voigt's order (11, 22, 33, 23, 13, 12).
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


class MaterialAnisotropic(Frozen):
    """Linear elastic material without any symmetry.

    Parameters
    ----------
    elasticity : (6, 6) array
        ``C`` (N/m^2) with ``stress = C strain`` in Voigt's order (11, 22, 33, 23, 13, 12), shear
        strains doubled; axis 3 is along the beam, axes 1 and 2 are those of the section.
    rho : float
        Density (kg/m^3).

    Raises
    ------
    InputError
        If the elasticity is not finite, symmetric and positive definite.

    Examples
    --------
    >>> MaterialAnisotropic(1e9 * np.eye(6), rho=1600.0).elasticity.shape
    (6, 6)
    """

    def __init__(self, elasticity: ArrayLike, rho: float):
        item = "material"
        name = "elasticity"
        C = self.elasticity = symmetric(item, name, shaped(item, name, elasticity, (6, 6)))
        lowest, highest = np.linalg.eigvalsh(C)[[0, -1]]
        if lowest <= 1e-12 * highest:
            raise InputError(
                item, f"{name} is not positive definite: its lowest eigenvalue is {lowest:.3g}"
            )
        self.rho = positive(item, "rho", rho)

    @classmethod
    def orthotropic(
        cls, E: Sequence[float], G: Sequence[float], nu: Sequence[float], rho: float
    ) -> MaterialAnisotropic:
        """Material with three planes of symmetry, those of the section's axes.

        Parameters
        ----------
        E : (E_1, E_2, E_3)
            Young's moduli (N/m^2); ``E_3`` along the beam.
        G : (G_23, G_13, G_12)
            Shear moduli (N/m^2).
        nu : (nu_23, nu_13, nu_12)
            Poisson's ratios, ``nu_ij = -strain_j / strain_i`` under tension along i; so
            ``nu_ji = nu_ij E_j / E_i``.
        rho : float
            Density (kg/m^3).

        Examples
        --------
        >>> ply = MaterialAnisotropic.orthotropic(
        ...     (9e9, 9e9, 140e9), (4e9, 5e9, 5e9), (0.02, 0.02, 0.3), 1600.0)
        >>> bool(np.isclose(1 / np.linalg.inv(ply.elasticity)[2, 2], 140e9))
        True
        """
        item = "material"
        given = {"E": E, "G": G, "nu": nu}
        moduli, shear, ratio = (shaped(item, name, value, (3,)) for name, value in given.items())
        for name, values in (("E", moduli), ("G", shear)):
            if (values <= 0).any():
                raise InputError(item, f"{name} = {values.tolist()}, expected positive numbers")
        compliance = np.diag(np.concatenate([1 / moduli, 1 / shear]))
        for (i, j), value in zip(VOIGT[3:], ratio, strict=True):
            compliance[i, j] = compliance[j, i] = -value / moduli[i]
        if np.linalg.eigvalsh(compliance)[0] <= 0:
            raise InputError(
                item,
                f"nu = {ratio.tolist()} is too large for E = {moduli.tolist()}: some strain"
                " would give back energy",
            )
        return cls(np.linalg.inv(compliance), rho)

    def rotated(self, rotation: ArrayLike) -> MaterialAnisotropic:
        """Rotated copy of the material.

        Parameters
        ----------
        rotation : (3, 3) array
            Its columns are the material's old axes after the turn, in the section's axes.

        Examples
        --------
        Fibres along the beam, turned to 30 degrees in the plane of the axes 1 and 3:

        >>> ply = MaterialAnisotropic.orthotropic(
        ...     (9e9, 9e9, 140e9), (4e9, 5e9, 5e9), (0.02, 0.02, 0.3), 1600.0)
        >>> c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
        >>> off = ply.rotated([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        >>> bool(abs(off.elasticity[2, 4]) > 1e9)              # tension shears it
        True
        """
        Q = shaped("material", "rotation", rotation, (3, 3))
        if not np.allclose(Q.T @ Q, np.eye(3), atol=1e-9):
            raise InputError("material", f"rotation = {Q.tolist()} is no (3, 3) rotation")
        i, j = np.transpose(VOIGT)
        mixed = Q[np.ix_(i, j)] * Q[np.ix_(j, i)] * (i != j)
        T = Q[np.ix_(i, i)] * Q[np.ix_(j, j)] + mixed  # stress_new = T stress_old
        return MaterialAnisotropic(T @ self.elasticity @ T.T, self.rho)


def elasticity(material: Material | MaterialAnisotropic) -> Floats:
    """Elasticity ``C`` (6, 6) in N/m^2, Voigt's order (11, 22, 33, 23, 13, 12).

    Raises
    ------
    InputError
        If it is no material, or nearly incompressible (``nu > 0.495``).

    Examples
    --------
    >>> elasticity(Material(E=1.0, nu=0.0, rho=1.0)).diagonal().tolist()
    [1.0, 1.0, 1.0, 0.5, 0.5, 0.5]
    """
    if isinstance(material, MaterialAnisotropic):
        return material.elasticity
    if not isinstance(material, Material):
        raise InputError(
            "profile", f"material = {material!r}, expected a Material or MaterialAnisotropic"
        )
    if material.nu > 0.495:
        raise InputError(
            "profile",
            f"nu = {material.nu!r}: warping of a material that keeps its volume is not solved;"
            " take nu = 0.495 at most",
        )
    C = np.zeros((6, 6))
    C[:3, :3] = 2 * material.G * material.nu / (1 - 2 * material.nu)
    C[range(6), range(6)] += material.G * np.array([2, 2, 2, 1, 1, 1])
    return C


# -- saint-Venant's six problems on one mesh of a section: warping, stiffness, stresses ------------
#
# Displacements near a section are those of a rigid section with the strains ``psi = (Gamma, K)`` of
# the beam, and a warping ``w(X_1, X_2, s)`` in all three directions. The strain in the material is
# ``H_1 w,1 + H_2 w,2 + H_0 (w' + Gamma + K x X)``, and with test functions of the section alone
# equilibrium reads
#
# ``d/ds (C^T w + M v) = E w + C v``,  ``v = w' + z psi``,  ``z psi = Gamma + K x X``
#
# (Giavotto, Borri, Mantegazza, Ghiringhelli, Carmaschi, Maffioli & Mussi, Comput. Struct. 16 (1983)
# 403). Under end loads alone all is linear in s, and two steps give the six central solutions:
# first tension, bending and torsion, where nothing depends on s; then shear, whose bending moment
# grows with s. The energy of the six under unit resultants is the compliance of the beam.

#: Strains (11, 22, 33, 23, 13, 12) of v, of w,1 and of w,2.
H = np.zeros((3, 6, 3))
H[0, [4, 3, 2], [0, 1, 2]] = 1
H[1, [0, 5, 4], [0, 1, 2]] = 1
H[2, [5, 1, 3], [0, 1, 2]] = 1

#: Axial force, bending and torsion among the six resultants.
CLASSICAL = [2, 3, 4, 5]
#: How the resultants change along an unloaded beam: M' = -e_3 x N.
GROWTH = np.zeros((6, 6))
GROWTH[3, 1], GROWTH[4, 0] = 1.0, -1.0


def element_of(mesh: Mesh, order: int) -> Element:
    """Scalar element of order 2 or 3 on triangles or quadrilaterals."""
    if mesh.t.shape[0] == 3:
        return ElementTriP2() if order == 2 else ElementTriP3()
    return ElementQuad2() if order == 2 else ElementQuadP(3)


def _matrices(
    mesh: Mesh, order: int, index: IndexArray, elasticities: Floats, intorder: int
) -> tuple[csc_matrix, csc_matrix, csc_matrix]:
    """The matrices E, C and M of the module's text."""
    parts: dict[str, Any] = {"E": 0, "C": 0, "M": 0}
    for k, D in enumerate(elasticities):
        elements = np.flatnonzero(index == k)
        basis = Basis(mesh, element_of(mesh, order), elements=elements, intorder=intorder)
        for a, b in ((0, 0), (1, 0), (2, 0), (1, 1), (1, 2), (2, 1), (2, 2)):
            name = "E" if b else "C" if a else "M"
            # u,b v,a where index 0 is the value itself
            form = BilinearForm(lambda u, v, _, a=a, b=b: (u, *u.grad)[b] * (v, *v.grad)[a])
            parts[name] = parts[name] + kron(form.assemble(basis), H[a].T @ D @ H[b], format="csr")
    return parts["E"].tocsc(), parts["C"].tocsc(), parts["M"].tocsc()


def _one(x: Floats) -> Floats:
    return 1 + 0 * x[0]


def _rigid(basis: Basis) -> Floats:
    """(3 n, 6): ``Gamma + K x X`` for unit strains, at the unknowns."""
    if isinstance(basis.elem, ElementQuadP):  # hierarchic
        X_1, X_2, one = (basis.project(f) for f in (lambda x: x[0], lambda x: x[1], _one))
    else:
        (X_1, X_2), one = basis.doflocs, np.ones(basis.N)
    zero = np.zeros(basis.N)
    columns = (
        (one, zero, zero),
        (zero, one, zero),
        (zero, zero, one),
        (zero, zero, X_2),
        (zero, zero, -X_1),
        (-X_2, X_1, zero),
    )
    return np.stack([np.stack(column, 1).ravel() for column in columns], 1)


def _free(basis: Basis) -> IndexArray:
    """Unknowns of the warping when its four rigid motions are held at two vertices."""
    vertices = basis.nodal_dofs[0]
    p = basis.mesh.p[:, : len(vertices)]
    near = vertices[np.argmin(p[0])]
    far = vertices[np.argmax(p[0])]
    return np.delete(np.arange(3 * basis.N), [3 * near, 3 * near + 1, 3 * near + 2, 3 * far + 1])


@dataclass(frozen=True, eq=False)
class Warping:
    """The six central solutions on a mesh, one for each unit resultant.

    Attributes
    ----------
    basis : skfem.Basis
        Scalar basis of each component of the warping.
    w, v : (3 n, 6) array
        Warping (m), and its change along the beam with the rigid part; ``3 node + component``.
    compliance : (6, 6) array
        ``psi = compliance (N, M)``.
    index, elasticities : (elements,) and (materials, 6, 6) array
        Material of each element.
    """

    basis: Basis
    w: Floats
    v: Floats
    compliance: Floats
    index: IndexArray
    elasticities: Floats

    @cached_property
    def strains(self) -> Floats:
        """(6 resultants, 6 strains, elements, quadrature points), for unit resultants."""
        return self._strains(self.basis.element_dofs, self.basis.basis, self.basis.dx.shape)

    def _strains(self, dofs: Array, basis: Sequence[Any], full: tuple[int, ...]) -> Floats:
        """(6 resultants, 6 strains, elements, points) by the shape functions of these elements."""
        w, v = (x.T.reshape(6, -1, 3)[:, dofs] for x in (self.w, self.v))
        out = np.zeros((6, 6, *full))
        for i, (shape,) in enumerate(basis):
            local = (np.asarray(shape), shape.grad[0], shape.grad[1])
            for a, x in enumerate((v, w, w)):
                strain = np.einsum("ic,rec->rie", H[a], x[:, i])
                out += strain[..., None] * np.broadcast_to(local[a], full)
        return out

    def stresses_at(self, x: Floats) -> Floats:
        """(k, 6 stresses, 6 unit resultants) at points (k, 2) in the section (N/m^2)."""
        basis = self.basis
        mapping = self.basis.mapping
        known = np.reshape(basis.global_coordinates(), (2, -1)).T
        tind = cKDTree(known).query(x)[1] // basis.dx.shape[1]  # whose quadrature point is nearest
        local = np.full((2, len(x), 1), 1 / 3)
        for _ in range(10):  # Newton's method; elements are hardly curved
            gap = x.T[..., None] - mapping.F(local, tind=tind)
            local = local + np.einsum("ijkl,jkl->ikl", mapping.invDF(local, tind=tind), gap)
        shapes = [basis.elem.gbasis(mapping, local, i, tind=tind) for i in range(basis.Nbfun)]
        strains = self._strains(basis.element_dofs[:, tind], shapes, (len(x), 1))[..., 0]
        return np.einsum("kij,rjk->kir", self.elasticities[self.index[tind]], strains)

    def energies(self, strains: Floats) -> Floats:
        """(6, elements): elastic energy times two of six strain fields."""
        D = self.elasticities[self.index]
        return np.einsum("rieq,eij,rjeq,eq->re", strains, D, strains, self.basis.dx, optimize=True)

    def stresses(self, resultants: Floats) -> Floats:
        """(6, elements, quadrature points) stresses (N/m^2) for resultants (6,)."""
        strain = np.einsum("r,rieq->ieq", resultants, self.strains)
        return np.einsum("eij,jeq->ieq", self.elasticities[self.index], strain)


def solve_warping(mesh: Mesh, order: int, index: IndexArray, elasticities: Floats) -> Warping:
    """Central solutions of a connected section.

    Parameters
    ----------
    mesh : skfem.Mesh
        Triangles or quadrilaterals in the plane (m).
    order : int
        2 or 3, of the elements.
    index : (elements,) array
        Row of ``elasticities`` for each element.
    elasticities : (materials, 6, 6) array
        In N/m^2, see :func:`~skfem_cosserat.profile.warping.elasticity`.
    """
    intorder = 6 if mesh.affine else 8
    basis = Basis(mesh, element_of(mesh, order), intorder=intorder)
    E, C, M = _matrices(mesh, order, index, elasticities, intorder)
    z = _rigid(basis)
    free = _free(basis)
    lu = splu(E[free][:, free], permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})

    def solved(rhs: Floats) -> Floats:
        out = np.zeros_like(rhs)
        out[free] = lu.solve(rhs[free])
        return out

    # tension, bending and torsion by unit strains, then by unit resultants
    v = np.zeros((E.shape[0], 6))
    v[:, CLASSICAL] = z[:, CLASSICAL]
    w = -solved(C @ v)
    flux = C.T @ w + M @ v
    inverse = np.linalg.inv((z.T @ flux)[np.ix_(CLASSICAL, CLASSICAL)])
    v[:, CLASSICAL] = v[:, CLASSICAL] @ inverse
    w[:, CLASSICAL] = w[:, CLASSICAL] @ inverse
    # shear: its moment grows, the warping of that bending is the rate w'
    flux = C.T @ w + M @ v
    rate = w @ GROWTH
    shear = solved((flux - C @ w) @ GROWTH)
    wrong = z.T @ (C.T @ shear + M @ rate)  # resultants that it has besides the unit shear
    w[:, :2] = (shear - w @ wrong)[:, :2]
    v[:, :2] = (rate - v @ wrong)[:, :2]
    mixed = w.T @ (C @ v)
    compliance = w.T @ (E @ w) + mixed + mixed.T + v.T @ (M @ v)
    return Warping(basis, w, v, (compliance + compliance.T) / 2, index, elasticities)


# -- what a section is to a beam: stiffness and mass, and the classical numbers read from them -----


#: how far inside of a boundary its stresses are taken, as part of the section's size
INSIDE = 1e-7


class SectionOfProfile(Section):
    """Section that knows the stresses of its profile's skin."""

    def __init__(self, constants: ProfileConstants, *given: Any, **more: Any):
        super().__init__(*given, **more)
        self.holes = constants.holes
        self._stresses = constants.skin_stresses(self.skin)

    def skin_stresses(self) -> Floats:
        """See :meth:`Section.skin_stresses`."""
        return self._stresses


def _turned(angle: float, x: Floats) -> tuple[Floats, Floats]:
    """To turned axes (3, 3), and of six resultants there (6, 6) about the point x (2,)."""
    c = np.cos(angle)
    s = np.sin(angle)
    R = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return R, np.block([[R, np.zeros((3, 3))], [-R @ skew(np.append(x, 0.0)), R]])


@dataclass(frozen=True, eq=False, repr=False)
class ProfileConstants(Frozen):
    """Constants of a section for the beam line through the origin of its axes.

    Attributes
    ----------
    stiffness : (6, 6) array
        ``(N, M) = stiffness (Gamma, K)`` (N, N m, N m^2).
    area : float
        (m^2).
    centroid, second_moments : (2,) and (2, 2) array
        Of the area: mean of ``X`` (m), and ``int X_i X_j dA`` about the origin (m^4).
    mass : float
        Per length (kg/m).
    centre : (2,) array
        Of mass (m).
    inertia : (2, 2) array
        ``int rho X_i X_j dA`` about the origin (kg m).
    shear_moduli : (2, 2) array
        ``int dA`` of the moduli ``((C_55, C_45), (C_45, C_44))`` of shear along d1 and d2 (N), of
        the material alone; ``G A`` on the diagonal if it is isotropic.
    error : float
        Estimated relative error of the elastic energy under the worst of all resultants.
    elements, unknowns : int
        Of the last mesh.
    outline : (k, 2) array
        Outer boundary (m).
    holes : tuple of (k, 2) array
        Boundaries of the holes (m).
    warping : Warping
        The six central solutions; resultants about ``origin``, axes turned by ``angle``.
    origin : (2,) array
        The beam line in the coordinates of ``warping`` (m).
    angle : float
        From the axes of ``warping`` to these (rad).

    Notes
    -----
    *Shear factors* are those of the energy (Renton, Comput. Struct. 38 (1991) 333; Pilkey,
    Analysis and Design of Elastic Beams, 2002): a shear force through the shear centre stores
    ``N^2 / (2 k G A)`` per length where its moment vanishes. A beam of this stiffness then stores
    exactly what the body does in Saint-Venant's solution. Cowper's factors (those of
    :class:`~skfem_cosserat.SectionCircle` and :class:`~skfem_cosserat.SectionTube`) average
    displacements instead: for a circle and nu = 0.3 they give 0.8864 in place of 0.8507.

    The *shear centre* is where a shear force stores no energy together with a torque, and so
    gives no twist in the mean of the energy (Trefftz, ZAMM 15 (1935) 220); it depends on Poisson's
    ratio only where materials differ in it. The definition by a vanishing mean rotation of the
    area differs from it by a term proportional to nu / (1 + nu).
    """

    stiffness: Floats
    area: float
    centroid: Floats
    second_moments: Floats
    mass: float
    centre: Floats
    inertia: Floats
    shear_moduli: Floats
    error: float
    elements: int
    unknowns: int
    outline: Floats = field(repr=False)
    warping: Warping = field(repr=False)
    holes: tuple[Floats, ...] = field(repr=False, default=())
    origin: Floats = field(repr=False, default_factory=lambda: np.zeros(2))
    angle: float = field(repr=False, default=0.0)

    @property
    def compliance(self) -> Floats:
        """(6, 6): ``(Gamma, K) = compliance (N, M)``."""
        return np.asarray(np.linalg.inv(self.stiffness))

    @property
    def elastic_centre(self) -> Floats:
        """Point (2,) whose axial force bends nothing (m)."""
        F = self.compliance
        y, minus_x = -np.linalg.solve(F[3:5, 3:5], F[3:5, 2])
        return np.array([-minus_x, y])

    @property
    def shear_centre(self) -> Floats:
        """Point (2,) whose shear forces twist nothing (m)."""
        F = self.compliance
        return np.array([-F[5, 1], F[5, 0]]) / F[5, 5]

    @property
    def EA(self) -> float:
        """Axial stiffness: force by stretch where moments vanish at the elastic centre (N)."""
        return float(1 / self.moved(self.elastic_centre).compliance[2, 2])

    @property
    def EI(self) -> Floats:
        """Bending stiffness (2, 2) about d1 and d2 through the elastic centre (N m^2)."""
        return np.asarray(np.linalg.inv(self.compliance[3:5, 3:5]))

    @property
    def GJ(self) -> float:
        """Torsional stiffness: torque by twist (N m^2)."""
        return float(1 / self.compliance[5, 5])

    @property
    def GA(self) -> Floats:
        """Shear stiffness (2,): a force along d1 or d2 through the shear centre (N)."""
        return 1 / self.moved(self.shear_centre).compliance.diagonal()[:2]

    @property
    def torsion_constant(self) -> float:
        """``GJ`` divided by the mean shear modulus of the material (m^4)."""
        return float(self.GJ * self.area / self.shear_moduli.diagonal().mean())

    @property
    def shear_factors(self) -> Floats:
        """(2,): ``GA`` divided by the shear stiffness of the material alone."""
        return self.GA / self.shear_moduli.diagonal()

    @property
    def principal_EI(self) -> tuple[Floats, float]:
        """Bending stiffnesses (2,), the larger first (N m^2), and the angle of its axis (rad).

        The angle is from d1 to the axis *about* which the section is stiffest, in (-pi/2, pi/2];
        zero if all axes are alike.
        """
        values, vectors = np.linalg.eigh(self.EI)
        axis = vectors[:, 1]
        if values[1] - values[0] <= 1e-9 * values[1]:
            return values[::-1], 0.0  # every axis is
        axis = axis * np.sign(axis[(abs(axis) > 1e-12).argmax()])
        return values[::-1], float(np.arctan2(axis[1], axis[0]))

    def moved(self, origin: ArrayLike, angle: float = 0.0) -> ProfileConstants:
        """Constants of the same section about another line, and in turned axes.

        Parameters
        ----------
        origin : (2,) array
            Where the new line is, in the axes of these constants (m).
        angle : float
            From the axes d1, d2 of these constants to the new ones (rad).

        Examples
        --------
        >>> from skfem_cosserat import Material
        >>> from skfem_cosserat.profile import ProfileRectangle
        >>> about = ProfileRectangle(2.0, 1.0, Material(1.0, 0.0, 1.0)).constants(1e-2)
        >>> edge = about.moved((0, -0.5))
        >>> bool(np.isclose(edge.stiffness[3, 3], 2 / 3))          # 2 * 1**3 / 3
        True
        """
        item = "profile"
        o = shaped(item, "origin", origin, (2,))
        turn = finite(item, "angle", angle)
        R3, P = _turned(turn, o)
        R = R3[:2, :2]
        D = P @ self.stiffness @ P.T

        def about(moments: Floats, weight: float, centre: Floats) -> Floats:
            mixed = weight * np.outer(o, centre)
            out = R @ (moments - mixed - mixed.T + weight * np.outer(o, o)) @ R.T
            return (out + out.T) / 2

        return replace(
            self,
            stiffness=(D + D.T) / 2,
            centroid=R @ (self.centroid - o),
            second_moments=about(self.second_moments, self.area, self.centroid),
            centre=R @ (self.centre - o),
            inertia=about(self.inertia, self.mass, self.centre),
            shear_moduli=R @ self.shear_moduli @ R.T,
            outline=(self.outline - o) @ R.T,
            holes=tuple((hole - o) @ R.T for hole in self.holes),
            origin=self.origin + o @ self._axes[0][:2, :2],
            angle=self.angle + turn,
        )

    def section(self, viscosity: ArrayLike | None = None) -> Section:
        """The section of a beam along this line.

        Numbers that are zero to round-off are set to zero.

        Parameters
        ----------
        viscosity : (6, 6) or (6,) array, optional
            See :class:`~skfem_cosserat.Section`.
        """
        scale = np.sqrt(self.stiffness.diagonal())
        D = np.where(abs(self.stiffness) < 1e-11 * np.outer(scale, scale), 0, self.stiffness)
        own = np.sqrt(self.area)
        centre = np.where(abs(self.centre) < 1e-11 * own, 0, self.centre)
        inertia = self.inertia
        if abs(inertia[0, 1]) < 1e-11 * np.sqrt(inertia[0, 0] * inertia[1, 1]):
            inertia = inertia.diagonal()
        more = {"centre": centre} if centre.any() else {}
        return SectionOfProfile(self, D, self.mass, inertia, self.outline, viscosity, **more)

    @property
    def _axes(self) -> tuple[Floats, Floats]:
        """To these axes (3, 3) from those of the warping; to its resultants (6, 6) from these."""
        R, P = _turned(self.angle, self.origin)
        return R, np.asarray(np.linalg.inv(P))

    def skin_stresses(self, skin: Sequence[Floats]) -> Floats:
        """(k, 3, 6) at points of closed polygons, for unit resultants: just inside of these."""
        places = []
        for loop in skin:
            before = loop - np.roll(loop, 1, axis=0)
            after = np.roll(loop, -1, axis=0) - loop
            along = sum(each / np.linalg.norm(each, axis=1)[:, None] for each in (before, after))
            inward = along @ [[0, 1], [-1, 0]]  # the material is on the left
            places.append(loop + INSIDE * np.sqrt(self.area) * inward)
        R, to = self._axes
        x = np.concatenate(places) @ R[:2, :2] + self.origin
        return (R @ self.warping.stresses_at(x)[:, [4, 3, 2]] @ to)[:, [2, 0, 1]]

    def stresses(self, resultants: ArrayLike) -> tuple[Floats, Floats]:
        """Stresses in the material under the six resultants of the beam.

        Parameters
        ----------
        resultants : (6,) array
            ``(N_1, N_2, N_3, M_1, M_2, M_3)`` on the face with outward normal d3, about the
            origin and in the axes of these constants (N, N m).

        Returns
        -------
        points : (2, k) array
            Where, in the axes of these constants (m): the quadrature points of all elements.
        stresses : (6, k) array
            (11, 22, 33, 23, 13, 12) in the axes of these constants (N/m^2).

        Examples
        --------
        >>> from skfem_cosserat import Material
        >>> from skfem_cosserat.profile import ProfileRectangle
        >>> steel = Material(210e9, 0.3, 7850)
        >>> bar = ProfileRectangle(0.02, 0.04, steel).constants(1e-2)
        >>> x, stress = bar.stresses((0, 0, 0, 100.0, 0, 0))
        >>> bool(np.allclose(stress[2], 100 * x[1] / (0.02 * 0.04**3 / 12)))
        True
        """
        given = shaped("profile", "resultants", resultants, (6,))
        R, to = self._axes
        tensor = self.warping.stresses(to @ given).reshape(6, -1)[[[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
        tensor = np.einsum("ia,abk,jb->ijk", R, tensor, R)
        points = np.reshape(self.warping.basis.global_coordinates(), (2, -1))
        turned = tensor[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
        return R[:2, :2] @ (points - self.origin[:, None]), turned

    def __str__(self) -> str:
        stiff, angle = self.principal_EI
        k = self.shear_factors

        def pair(values: Floats) -> str:
            own = 1e-11 * np.sqrt(self.area)
            return "  ".join(f"{0.0 if abs(x) < own else x:.6g}" for x in values)

        EI = self.EI
        rows = (
            ("area", f"{self.area:.6g}", "m^2"),
            ("centroid", pair(self.centroid), "m"),
            ("elastic centre", pair(self.elastic_centre), "m"),
            ("shear centre", pair(self.shear_centre), "m"),
            ("EA", f"{self.EA:.6g}", "N"),
            ("EI about d1, d2", f"{EI[0, 0]:.6g}  {EI[1, 1]:.6g}", "N m^2"),
            ("principal EI", f"{stiff[0]:.6g}  {stiff[1]:.6g}", "N m^2"),
            ("axis of the first", f"{np.degrees(angle):.4g}", "degrees from d1"),
            ("GJ", f"{self.GJ:.6g}", "N m^2"),
            ("torsion constant", f"{self.torsion_constant:.6g}", "m^4"),
            ("GA along d1, d2", f"{self.GA[0]:.6g}  {self.GA[1]:.6g}", "N"),
            ("shear factors", f"{k[0]:.6g}  {k[1]:.6g}", ""),
            ("mass", f"{self.mass:.6g}", "kg/m"),
            ("centre of mass", pair(self.centre), "m"),
            ("estimated error", f"{self.error:.1e}", f"with {self.elements} elements"),
        )
        return "\n".join(f"{name:<18}{value:<26}{unit}".rstrip() for name, value, unit in rows)
