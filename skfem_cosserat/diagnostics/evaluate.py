"""Beams at any point inside their elements: place, triad, strains and resultants."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import InputError
from ..kernels import beam_stress
from ..model import System
from ..types import ArrayLike, Floats, IndexArray, numbers
from .energy import group_of, held_forces
from .stacks import as_stack

if TYPE_CHECKING:
    from ..beam import Beam

__all__ = ["SectionValues", "evaluate"]


class SectionValues(NamedTuple):
    """What :func:`evaluate` gives, m points; with N states there is a leading axis N."""

    #: Places (m, 3) in m.
    position: Floats
    #: Section directors (m, 3, 3), d_{i+1} in row i.
    triad: Floats
    #: ``(Gamma, K)`` (m, 6), relative to the interpolated reference (-, 1/m).
    strain: Floats
    #: Elastic ``(N, M)`` (m, 6) in the section's frame, on the face with outward normal +d3
    #: (N, N m).
    resultant: Floats


def evaluate(
    system: System,
    beam: Beam,
    q: ArrayLike,
    elements: ArrayLike,
    xi: ArrayLike,
    *,
    orthonormal: bool = False,
    multipliers: ArrayLike | None = None,
) -> SectionValues:
    """A beam at any points inside its elements.

    Parameters
    ----------
    beam : Beam
        Of this system.
    q : (n,) or (N, n) array
        Configurations.
    elements, xi : (m,) array
        Elements and reference coordinates in [0, 1]; by arc length: ``*beam.along(s, part)``.
    orthonormal : bool
        Triads orthonormal, by polar decomposition: the rotations nearest to the interpolated
        directors.
    multipliers : (m,) or (N, m) array, optional
        As of :func:`multipliers`: resultants of strains that the beam's rung holds, interpolated
        from the Gauss points; NaN without.

    Returns
    -------
    SectionValues
        ``position``, ``triad``, ``strain``, ``resultant``.

    Raises
    ------
    InputError
        If the beam is not in the system, an element is not in the beam, a coordinate not in
        [0, 1], or the shape of `q` does not fit the system.

    Notes
    -----
    Directors are interpolated as they are (113). At nodes they are orthonormal, between them not:
    ``d_i.d_j`` deviates by an amount that vanishes with h^(p+1) (a linear element that turns by
    an angle t has directors of length cos(t/2) in its middle). Positions and triads converge with
    h^(p+1), strains and resultants with h^p, and with h^(p+1) at the Gauss points, where
    :func:`section_strains` takes them; at nodes :func:`nodal_resultants` are far better.

    Examples
    --------
    >>> from skfem_cosserat import Beam, MeshCurve, Model, Section
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> model = Model()
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 2), 1)
    >>> beam = model.add("beam", Beam(mesh, section, director=(1, 0, 0)))
    >>> system = model.freeze()
    >>> q = system.q0
    >>> q[14] = 2.02   # the end, drawn by 1 %
    >>> at = evaluate(system, beam, q, *beam.along([0.5, 1.5]))
    >>> at.position[:, 2].round(9).tolist(), at.resultant[:, 2].round(9).tolist()
    ([0.505, 1.515], [100.0, 100.0])
    """
    Q, single = as_stack(system, "q", q)
    group = group_of(system, beam)
    e, x = _places(beam, elements, xi)
    rows = group.rows[group.slices[id(beam)]][e]
    N = beam.basis.shape(x).T
    dN = beam.basis.dshape(x).T / beam.elements.lengths[e][:, None]

    def at(y: Floats) -> tuple[Floats, Floats]:
        """Values (k, m, 4, 3) of phi, d1, d2, d3 of the sections, and their strains (k, m, 6)."""
        nodal = y.reshape(*y.shape[:2], -1, 4, 3).copy()
        nodal[..., 1:, :] = beam.rotations[e] @ nodal[..., 1:, :]
        value, slope = (np.einsum("ma,kmaic->kmic", S, nodal) for S in (N, dN))
        return value, _measures(value, slope)

    value, strain = at(Q.reshape(len(Q), -1, 3)[:, rows])
    strain = strain - at(beam.reference.reshape(1, -1, 3)[:, _own_rows(beam)[e]])[1]
    triad = value[:, :, 1:]
    if orthonormal:
        u, _, vt = np.linalg.svd(triad)
        triad = u @ vt
    resultant = beam_stress(beam.elements.taken(e), strain[:, :, None])[:, :, 0]
    count = None if single else len(Q)
    held = np.asarray(held_forces(system, beam, multipliers, count))
    if held.ndim:
        at_points = held.reshape(-1, *held.shape[-3:])[:, e]
        weights = _between(beam.elements.points, x)
        resultant = resultant + np.einsum("mg,kmgi->kmi", weights, at_points)
    out = SectionValues(value[:, :, 0], triad, strain, resultant)
    return SectionValues(*(array[0] for array in out)) if single else out


def _between(points: Floats, x: Floats) -> Floats:
    """Lagrange polynomials (m, ng) of points (ng,) at x (m,)."""
    return np.array(
        [
            np.prod([(x - q) / (p - q) for q in np.delete(points, k)], axis=0) * np.ones_like(x)
            for k, p in enumerate(points)
        ]
    ).T


def _own_rows(beam: Beam) -> IndexArray:
    """Rows (ne, 4 (p + 1)) of each element in the beam's own coordinates."""
    rows = 4 * beam.basis.connectivity[:, :, None] + np.arange(4)
    return rows.reshape(len(rows), -1)


def _places(beam: Beam, elements: ArrayLike, xi: ArrayLike) -> tuple[IndexArray, Floats]:
    from ..mesh.lookup import element_numbers

    e = element_numbers(elements, len(beam.basis.connectivity))
    x = numbers(beam.label, "xi", xi)
    if x.shape not in ((), e.shape):
        raise InputError(beam.label, f"xi has shape {x.shape}, expected {e.shape} as elements")
    x = np.broadcast_to(x, e.shape)
    wrong = ~((x >= 0) & (x <= 1))
    if wrong.any():
        raise InputError(beam.label, f"xi = {x[wrong][0]} in element {e[wrong][0]}, not in [0, 1]")
    return e, x


def _measures(value: Floats, slope: Floats) -> Floats:
    """``d_i . phi'`` and ``(1/2) eps_ijk d_k . d_j'`` (k, m, 6)."""
    d = value[:, :, 1:]
    gamma = np.einsum("kmic,kmc->kmi", d, slope[:, :, 0])
    W = d @ np.swapaxes(slope[:, :, 1:], -1, -2)
    wedge = (W - np.swapaxes(W, -1, -2)) / 2
    return np.concatenate([gamma, wedge[..., [2, 0, 1], [1, 2, 0]]], axis=-1)
