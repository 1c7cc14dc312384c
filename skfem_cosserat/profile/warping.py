"""Saint-Venant's six problems on one mesh of a section: warping, stiffness, stresses.

Displacements near a section are those of a rigid section with the strains ``psi = (Gamma, K)`` of
the beam, and a warping ``w(X_1, X_2, s)`` in all three directions. The strain in the material is
``H_1 w,1 + H_2 w,2 + H_0 (w' + Gamma + K x X)``, and with test functions of the section alone
equilibrium reads

``d/ds (C^T w + M v) = E w + C v``,  ``v = w' + z psi``,  ``z psi = Gamma + K x X``

(Giavotto, Borri, Mantegazza, Ghiringhelli, Carmaschi, Maffioli & Mussi, Comput. Struct. 16 (1983)
403). Under end loads alone all is linear in s, and two steps give the six central solutions: first
tension, bending and torsion, where nothing depends on s; then shear, whose bending moment grows
with s. The energy of the six under unit resultants is the compliance of the beam.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, kron
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, Mesh
from skfem.element import Element, ElementQuad2, ElementQuadP, ElementTriP2, ElementTriP3

from ..types import Array, Floats, IndexArray

__all__ = ["Warping", "solve_warping"]

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


def _part(function: Any, a: int) -> Array:
    return function if a == 0 else function.grad[a - 1]


def _scalar_matrices(basis: Basis) -> dict[tuple[int, int], csr_matrix]:
    """``int u,a v,b dA`` for a <= b, where index 0 is the value itself."""
    found = {}
    for a in range(3):
        for b in range(a, 3):

            def form(u: Any, v: Any, _: Any, a: int = a, b: int = b) -> Array:
                return _part(u, b) * _part(v, a)

            found[a, b] = BilinearForm(form).assemble(basis)
            found[b, a] = found[a, b].T
    return found


def _matrices(
    mesh: Mesh, order: int, index: IndexArray, elasticities: Floats, intorder: int
) -> tuple[csc_matrix, csc_matrix, csc_matrix]:
    """The matrices E, C and M of the module's text."""
    parts: dict[str, Any] = {"E": 0, "C": 0, "M": 0}
    for k, D in enumerate(elasticities):
        elements = np.flatnonzero(index == k)
        basis = Basis(mesh, element_of(mesh, order), elements=elements, intorder=intorder)
        scalar = _scalar_matrices(basis)
        for a in range(3):
            for b in range(3):
                if a == 0 and b > 0:
                    continue  # the transpose of C
                name = "M" if a == b == 0 else "C" if b == 0 else "E"
                parts[name] = parts[name] + kron(scalar[a, b], H[a].T @ D @ H[b], format="csr")
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
    return np.stack([np.stack(column, axis=1).ravel() for column in columns], axis=1)


def _free(basis: Basis) -> IndexArray:
    """Unknowns of the warping when its four rigid motions are held at two vertices."""
    vertices = basis.nodal_dofs[0]
    p = basis.mesh.p[:, : len(vertices)]
    near, far = vertices[np.argmin(p[0])], vertices[np.argmax(p[0])]
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
        dofs = self.basis.element_dofs
        w, v = (x.T.reshape(6, -1, 3)[:, dofs] for x in (self.w, self.v))
        shapes = [self.basis.basis[i][0] for i in range(len(dofs))]
        full = (*self.basis.dx.shape,)
        out = np.zeros((6, 6, *full))
        for i, shape in enumerate(shapes):
            local = (np.asarray(shape), shape.grad[0], shape.grad[1])
            for a, x in enumerate((v, w, w)):
                strain = np.einsum("ic,rec->rie", H[a], x[:, i])
                out += strain[..., None] * np.broadcast_to(local[a], full)
        return out

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
        In N/m^2, see :func:`~skfem_cosserat.profile.elasticity.elasticity`.
    """
    intorder = 6 if mesh.affine else 8
    basis = Basis(mesh, element_of(mesh, order), intorder=intorder)
    E, C, M = _matrices(mesh, order, index, elasticities, intorder)
    z, free = _rigid(basis), _free(basis)
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
    rate, source = w @ GROWTH, (flux - C @ w) @ GROWTH
    shear = solved(source)
    wrong = z.T @ (C.T @ shear + M @ rate)  # resultants that it has besides the unit shear
    w[:, :2] = (shear - w @ wrong)[:, :2]
    v[:, :2] = (rate - v @ wrong)[:, :2]
    mixed = w.T @ (C @ v)
    compliance = w.T @ (E @ w) + mixed + mixed.T + v.T @ (M @ v)
    return Warping(basis, w, v, (compliance + compliance.T) / 2, index, elasticities)
