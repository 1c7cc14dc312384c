"""The arc-length mapping scikit-fem evaluates bases with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from skfem.mapping import Mapping

from ..types import Array, Floats

if TYPE_CHECKING:  # pragma: no cover - for annotations only
    from .mesh import MeshCurve

__all__ = ["MappingCurve"]


class MappingCurve(Mapping):
    """Maps [0, 1] onto each element of a space curve, proportionally to arc length.

    Points have three rows (x, y, z) and reference points one. The Jacobian is ds/dxi, the length
    of the element, so that ``u.grad[0]`` in a form is the derivative with respect to arc
    length. Facet normals are the unit tangents (3 rows) that point out of the element.

    Parameters
    ----------
    mesh : MeshCurve
        The mesh; its lengths, curves and vertices are used.

    Examples
    --------
    >>> from skfem_cosserat.mesh import MeshCurve
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 4), elements=2)
    >>> mesh.mapping().F(np.array([[0.5]]))[:, 1, 0].tolist()
    [0.0, 0.0, 3.0]
    """

    def __init__(self, mesh: MeshCurve) -> None:
        self.mesh = mesh

    def _select(self, X: Array, tind: Array | None) -> tuple[Array, Array]:
        """Element numbers (n,) and reference coordinates (n, nq)."""
        elements = np.arange(self.mesh.nelements) if tind is None else np.asarray(tind)
        return elements, np.broadcast_to(X[0], (len(elements), X.shape[-1]))

    def _on_curves(self, elements: Array, xi: Array, tangent: bool) -> Floats:
        """Points or unit tangents (3, n, nq) of elements at reference coordinates (n, nq)."""
        mesh = self.mesh
        out = np.empty((3, *xi.shape))
        ids = mesh.curve_ids[elements]
        for c in np.unique(ids).tolist():
            rows = np.flatnonzero(ids == c)
            e, x = elements[rows], xi[rows]
            a, b = mesh.p[:, mesh.t[0, e], None], mesh.p[:, mesh.t[1, e], None]
            if c < 0:
                chord = (b - a) / mesh.lengths[e][:, None]
                out[:, rows] = chord + 0.0 * x if tangent else (1.0 - x) * a + x * b
                continue
            s0, s1 = mesh.spans[:, e, None]
            s = (1.0 - x) * s0 + x * s1
            if tangent:
                out[:, rows] = mesh.curves[c].tangent(s) * np.sign(s1 - s0)
            else:
                out[:, rows] = mesh.curves[c].point(s)
        return out

    def F(self, X: Array, tind: Array | None = None) -> Floats:
        """Points (3, ne, nq) at reference points (1, nq) or (1, ne, nq)."""
        return self._on_curves(*self._select(X, tind), tangent=False)

    def tangent(self, X: Array, tind: Array | None = None) -> Floats:
        """Unit tangents (3, ne, nq) of the curves in the elements' direction."""
        return self._on_curves(*self._select(X, tind), tangent=True)

    def invF(self, x: Array, tind: Array | None = None) -> Floats:
        """Reference coordinates (1, ne, nq) of the nearest points of the given elements.

        Exact at the ends; clipped to [0, 1].
        """
        x = np.asarray(x, dtype=float)
        mesh = self.mesh
        elements = np.arange(mesh.nelements) if tind is None else np.asarray(tind)
        length = mesh.lengths[elements][:, None]
        grid = np.linspace(0.0, 1.0, 9)
        near = self.F(grid[None, :], elements)
        gaps = np.linalg.norm(x[..., None] - near[:, :, None, :], axis=0)
        xi = grid[np.argmin(gaps, axis=-1)]
        for _ in range(50):
            ahead = x - self.F(xi[None], elements)
            step = (ahead * self.tangent(xi[None], elements)).sum(axis=0) / length
            new = np.clip(xi + step, 0.0, 1.0)
            done = np.abs(new - xi).max(initial=0.0) <= 1e-15
            xi = new
            if done:
                break
        for end in (0, 1):
            vertex = mesh.p[:, mesh.t[end, elements], None]
            xi = np.where((x == vertex).all(axis=0), float(end), xi)
        return xi[None]

    def detDF(self, X: Array, tind: Array | None = None) -> Floats:
        """Arc length for one unit of the reference coordinate (ne, nq), in m."""
        elements, xi = self._select(X, tind)
        return np.broadcast_to(self.mesh.lengths[elements][:, None], xi.shape)

    def DF(self, X: Array, tind: Array | None = None) -> Floats:
        """The same as a 1 x 1 Jacobian (1, 1, ne, nq)."""
        return self.detDF(X, tind)[None, None]

    def invDF(self, X: Array, tind: Array | None = None) -> Floats:
        """Its inverse (1, 1, ne, nq), in 1/m."""
        return 1.0 / self.DF(X, tind)

    def G(self, X: Array, find: Array | None = None) -> Floats:
        """Positions (3, nf, 1) of facets: in one dimension these are the vertices."""
        return self.mesh.p[:, self._vertices(find), None]

    def detDG(self, X: Array, find: Array | None = None) -> Floats:
        """Ones (nf, 1): an integral over a vertex is the value there."""
        return np.ones((len(self._vertices(find)), 1))

    def _vertices(self, find: Array | None) -> Array:
        """Vertex numbers of facets."""
        facets = self.mesh.facets[0]
        return facets if find is None else facets[np.asarray(find)]

    def normals(self, X: Array, tind: Array, find: Array, t2f: Array) -> Floats:
        """Unit tangents (3, nf, 1) at facets, pointing out of the elements ``tind``."""
        sign = np.where(t2f[1, tind] == find, 1.0, -1.0)
        xi = np.where(sign > 0, 1.0, 0.0)[:, None]
        return self._on_curves(np.asarray(tind), xi, tangent=True) * sign[:, None]
