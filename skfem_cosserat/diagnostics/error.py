"""Where the error of a mesh comes from, element by element, seen from a richer one.

A richer system has elements of one order more on the same mesh, or each element halved.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.sparse.linalg import splu

from ..errors import InputError
from ..kinds import is_beam
from ..linear import SingularMatrixError
from ..model import System
from ..model.balance import Amplitudes
from ..types import ArrayLike, Floats, IndexArray
from .energy import section_strains
from .resultants import element_forces
from .settle import inner_rows, settled
from .tangent import reduced_tangent
from .transfer import transfer

if TYPE_CHECKING:
    from ..beam import Beam

__all__ = ["beam_of", "goal_shares", "missing_strains", "parents"]


def missing_strains(coarse: Beam, fine: System, beam: Beam, q: ArrayLike) -> Floats:
    """Stored energy of the strains that elements cannot hold, seen from a richer solution.

    An element of order p has strains at p Gauss points: polynomials of degree p - 1. How much
    energy is in what is left of the richer strains says where a mesh is too coarse; how much less
    that is than in the part of degree p - 1, how smooth they are there, and so how much a higher
    order would gain.

    Parameters
    ----------
    coarse : Beam
        The one to judge.
    fine : System
    beam : Beam
        Of `fine`, the same one with elements of one order more or halved.
    q : (n,) or (N, n) array
        Configurations of `fine`; the mean over them is taken.

    Returns
    -------
    (ne, 2) array
        For each element of `coarse`, the energy (J) beyond degree p - 1, and that of degree p - 1.

    Raises
    ------
    InputError
        If the beam is not in the system, its elements are no parts of those of `coarse`, or the
        shape of `q` does not fit.
    MeshError
        If the meshes do not divide the same lines.

    Examples
    --------
    The curvature of a cantilever under an end force grows along it in proportion: an element of
    order 2 holds it, one of order 1 does not.

    >>> from skfem_cosserat import Beam, JointFixed, LoadForce, MeshCurve, Model, Section
    >>> from skfem_cosserat import ground, static
    >>> section = Section([1e9, 1e9, 1e9, 100, 100, 100], mass=1.0, inertia=(1.0, 1.0))
    >>> model = Model()
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 1, name="rod")
    >>> rod = model.add("rod", Beam(mesh, section, order=3))
    >>> clamp = model.add("clamp", JointFixed(ground((0, 0, 0)), rod.node("rod.start")))
    >>> push = model.add("push", LoadForce(rod.node("rod.end"), (0, 0.1, 0)))
    >>> q = static(model)["q"][-1]
    >>> system = model.freeze()
    >>> (one,), (two,) = (missing_strains(rod.refined(order=p), system, rod, q) for p in (1, 2))
    >>> round(float(one[0] * 24 * 100 / 0.1**2), 3), bool(two[0] < 1e-9 * two[1])
    (1.0, True)
    """
    strains = section_strains(fine, beam, q)
    strains = strains.reshape(-1, *strains.shape[-3:])
    parent, xi = _gauss_places(coarse, beam)
    ne, p = coarse.mesh.nelements, coarse.basis.order
    weights = beam.basis.weights * (beam.mesh.lengths / coarse.mesh.lengths[parent])[:, None]
    basis = legvander(2 * xi - 1, p - 1) * np.sqrt(2 * np.arange(p) + 1)
    # orthonormal under the rule: it is exact to degree 2 p and more
    parts = np.einsum("eg,egd,kegi->keid", weights, basis, strains)
    coefficients = np.zeros((ne, len(strains), 6, p))
    np.add.at(coefficients, parent, np.swapaxes(parts, 0, 1))
    coefficients = np.swapaxes(coefficients, 0, 1)
    rest = strains - np.einsum("egd,keid->kegi", basis, coefficients[:, parent])
    D = beam.elements.stiffness
    density = 0.5 * np.einsum("kegi,eij,kegj->eg", rest, D, rest)
    out = np.zeros((ne, 2))
    np.add.at(out[:, 0], parent, (weights * density).sum(axis=1))
    last = coefficients[..., -1]
    out[:, 1] = 0.5 * np.einsum("kei,eij,kej->e", last, coarse.elements.stiffness, last)
    return np.asarray(out * coarse.mesh.lengths[:, None] / len(strains))


def beam_of(system: System, name: str | None, label: str) -> Beam:
    """The beam of a name in a system."""
    for item in system.structures:
        if is_beam(item) and item.name == name:
            return item
    known = sorted(str(item.name) for item in system.structures if is_beam(item))
    raise InputError(label, f"is not in the system, which has the beams {known}")


def _gauss_places(coarse: Beam, fine: Beam) -> tuple[IndexArray, Floats]:
    """Elements of `coarse` that hold those of `fine`, and places (ne, g) of its Gauss points."""
    parent = parents(coarse, fine)
    from ..mesh.relate import places_in

    _, xi = places_in(coarse.mesh, fine.mesh, fine.basis.points)
    return parent, xi


def parents(coarse: Beam, fine: Beam) -> IndexArray:
    """The element of `coarse` that holds each element of `fine`.

    Raises
    ------
    MeshError
        If the meshes do not divide the same lines.
    InputError
        If an element of `fine` reaches beyond one of `coarse`.
    """
    from ..mesh.relate import places_in

    e, _ = places_in(coarse.mesh, fine.mesh, np.array([0.0, 1.0]))
    if (e[:, 0] != e[:, 1]).any():
        k = int(np.flatnonzero(e[:, 0] != e[:, 1])[0])
        raise InputError(fine.label, f"element {k} lies in elements {e[k].tolist()} of the other")
    return e[:, 0]


def goal_shares(
    coarse: System,
    fine: System,
    q: ArrayLike,
    good: ArrayLike,
    gradient: ArrayLike,
    amplitudes: Amplitudes,
    t: float = 0.0,
) -> dict[str, Floats]:
    """Shares of the elements in the error of a quantity at an equilibrium.

    The residual that the solution of the richer system leaves in the equations of the coarse one,
    weighted by the adjoint solution: ``z . (f_h - f)``, z from ``K^T z = dJ/dq``, f_h the nodal
    forces of a coarse element with the ends where the richer solution has them and its inner nodes
    at rest between them, f those which the richer elements pass on at these ends. The shares add
    up to ``J(fine) - J(coarse)``: K is the mean of the stiffness at both solutions, so that what
    is left out is of third order in their difference.

    Parameters
    ----------
    coarse, fine : System
        Of the same scene.
    q : (coarse.n,) array
        Equilibrium of `coarse`.
    good : (fine.n,) array
        Equilibrium of `fine`.
    gradient : (coarse.n,) array
        Derivative of the quantity by the coordinates of `coarse`, at :func:`transfer` of `good`.
    amplitudes : Amplitudes
        Of the loads, as in :func:`skfem_cosserat.diagnostics.reduced_tangent`; the same channels
        in both systems.
    t : float
        Time or load factor of prescribed motion.

    Returns
    -------
    dict of str to (ne,) array
        By the names of the beams of `coarse`, with their signs.

    Raises
    ------
    SingularMatrixError
        If the stiffness is singular, as at a limit point.

    Examples
    --------
    >>> from skfem_cosserat import Beam, JointFixed, LoadForce, MeshCurve, Model, Section
    >>> from skfem_cosserat import ground, static
    >>> from skfem_cosserat.model.balance import amplitudes_at
    >>> section = Section([1e4, 1e4, 1e4, 100, 100, 100], mass=1.0, inertia=(1.0, 1.0))
    >>> def build(order):
    ...     model = Model()
    ...     mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    ...     rod = model.add("rod", Beam(mesh, section, order=order))
    ...     model.add("clamp", JointFixed(ground((0, 0, 0)), rod.node("rod.start")))
    ...     model.add("push", LoadForce(rod.node("rod.end"), (0, 10.0, 0)))
    ...     return model.freeze(), 12 * rod.node("rod.end").vertex + 1
    >>> (coarse, tip), (fine, _) = build(1), build(2)
    >>> q, good = (static(system)["q"][-1] for system in (coarse, fine))
    >>> gradient = np.eye(coarse.n)[tip]
    >>> shares = goal_shares(coarse, fine, q, good, gradient, amplitudes_at(coarse, 0.0))["rod"]
    >>> round(float(shares.sum() / (good[tip] - q[tip])), 3)
    1.0
    """
    y = coarse.extend(transfer(fine, coarse, good)[0], t)
    y, tangent = settled(coarse, y, amplitudes, inner_rows(coarse))
    start = coarse.extend(np.asarray(q, dtype=float), t)
    K = (tangent.K + reduced_tangent(coarse, start, amplitudes).K) / 2
    try:
        z = splu(K.T.tocsc()).solve(tangent.P.T @ np.asarray(gradient, dtype=float))
    except RuntimeError as error:  # SuperLU: exactly singular
        raise SingularMatrixError("the stiffness is singular: no adjoint solution") from error
    weight = (tangent.P @ z).reshape(-1, 3)
    rows = np.asarray(good, dtype=float).reshape(-1, 3)
    out = {}
    for beam in (item for item in coarse.structures if is_beam(item)):
        richer = beam_of(fine, beam.name, beam.label)
        forces = element_forces(coarse, beam, y[: coarse.rows], amplitudes.loads)
        passed = element_forces(fine, richer, rows, amplitudes.loads)
        parent = parents(beam, richer)
        first = np.searchsorted(parent, np.arange(len(forces)))
        last = np.searchsorted(parent, np.arange(len(forces)), side="right") - 1
        forces[:, 0] -= passed[first, 0]
        forces[:, -1] -= passed[last, -1]
        at = coarse.first[id(beam)][1] + 4 * beam.basis.connectivity[:, :, None] + np.arange(4)
        out[str(beam.name)] = np.einsum("eaic,eaic->e", weight[at], forces)
    return out
