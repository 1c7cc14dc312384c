"""Checks of a mesh at construction: every message names the element, node or array."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import MeshError
from ..types import Array, Floats, numbers
from .topology import duplicates

if TYPE_CHECKING:  # pragma: no cover - for annotations only
    from .mesh import MeshCurve

__all__ = ["check_arrays", "check_geometry"]


def check_arrays(doflocs: Any, t: Any) -> tuple[Floats, Array]:
    """Vertices (3, nv) and connectivity (2, ne) of sound shape and content."""
    points = numbers("mesh points", "coordinates", doflocs)
    if points.ndim != 2 or points.shape[0] != 3:
        raise MeshError("mesh points", f"have shape {points.shape}, expected (3, nv)")
    lines = np.asarray(t)
    if lines.size == 0:
        raise MeshError("mesh", f"has no elements (connectivity of shape {lines.shape})")
    if lines.ndim != 2 or lines.shape[0] != 2:
        raise MeshError("mesh connectivity", f"has shape {lines.shape}, expected (2, ne)")
    if not np.issubdtype(lines.dtype, np.integer):
        raise MeshError("mesh connectivity", f"has type {lines.dtype}, expected integers")
    if not np.isfinite(points).all():
        node = int(np.argmin(np.isfinite(points).all(axis=0)))
        raise MeshError(f"node {node}", f"coordinates {points[:, node].tolist()} are not finite")
    nv = points.shape[1]
    wrong = ((lines < 0) | (lines >= nv)).any(axis=0)
    if wrong.any():
        e = int(np.argmax(wrong))
        raise MeshError(f"element {e}", f"has nodes {lines[:, e].tolist()}, the mesh has {nv}")
    used = np.zeros(nv, dtype=bool)
    used[lines] = True
    if not used.all():
        node = int(np.argmin(used))
        raise MeshError(f"node {node}", f"at {points[:, node].tolist()} belongs to no element")
    return np.ascontiguousarray(points), np.ascontiguousarray(lines)


def check_geometry(mesh: MeshCurve) -> None:
    """Lengths, vertices on curves, duplicates and names."""
    size = mesh.size
    degenerate = (mesh.lengths <= 1e-14 * size) | (mesh.t[0] == mesh.t[1])
    if degenerate.any():
        e = int(np.argmax(degenerate))
        raise MeshError(
            f"element {e}",
            f"between nodes {mesh.t[0, e]} and {mesh.t[1, e]} has zero length or one node only",
        )
    _check_curves(mesh, size)
    middle = mesh.mapping().F(np.array([[0.5]]))[:, :, 0]
    pair = duplicates(mesh.t, middle, 1e-9 * size)
    if pair is not None:
        nodes = mesh.t[:, pair[0]].tolist()
        raise MeshError(f"element {pair[1]}", f"duplicates element {pair[0]}, both join {nodes}")
    _check_names(mesh)
    if not 0.0 <= mesh.feature_angle <= np.pi:
        raise MeshError("argument feature_angle", f"{mesh.feature_angle} is not in [0, pi] rad")


def _check_curves(mesh: MeshCurve, size: float) -> None:
    """Ends of elements against the curves they are said to lie on."""
    on_curve = np.flatnonzero(mesh.curve_ids >= 0)
    if on_curve.size == 0:
        return
    spans = mesh.spans[:, on_curve]
    limit = np.array([curve.length for curve in mesh.curves])[mesh.curve_ids[on_curve]]
    outside = ~((spans >= -1e-9 * limit) & (spans <= (1 + 1e-9) * limit)).all(axis=0)
    if outside.any():
        k = int(np.argmax(outside))
        raise MeshError(
            f"element {on_curve[k]}",
            f"span {spans[:, k].tolist()} m leaves its curve of length {limit[k]} m",
        )
    ends = mesh.mapping().F(np.array([[0.0, 1.0]]), on_curve)
    gap = np.linalg.norm(ends - mesh.p[:, mesh.t[:, on_curve].T], axis=0)
    if gap.max() > 1e-6 * size:
        k, end = divmod(int(np.argmax(gap)), 2)
        e = on_curve[k]
        raise MeshError(
            f"element {e}",
            f"node {mesh.t[end, e]} is {gap[k, end]:.3g} m off its curve: change the curves"
            " together with the points, e.g. by mesh.moved()",
        )


def _check_names(mesh: MeshCurve) -> None:
    """Index arrays of beams and nodes."""
    for kind, names, count in (
        ("beam", mesh._subdomains, mesh.nelements),
        ("node", mesh._boundaries, mesh.p.shape[1]),
    ):
        for name, index in (names or {}).items():
            ix = np.asarray(index)
            if ix.size and not np.issubdtype(ix.dtype, np.integer):
                raise MeshError(
                    f"{kind} '{name}'", f"numbers of type {ix.dtype}, expected integers"
                )
            if ix.size and (ix.min() < 0 or ix.max() >= count):
                bad = ix.min() if ix.min() < 0 else ix.max()
                raise MeshError(f"{kind} '{name}'", f"number {bad} is not in 0 .. {count - 1}")
