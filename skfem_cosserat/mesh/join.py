"""New arrays for changed meshes: joined, refined, restricted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from ..errors import MeshError
from ..types import Array, Floats, IndexArray
from .curves import CurveMoved

if TYPE_CHECKING:  # pragma: no cover - for annotations only
    from .mesh import MeshCurve

__all__ = ["halved_arrays", "joined_arrays", "moved_arrays", "restricted_arrays"]


def halved_arrays(mesh: MeshCurve, marked: IndexArray) -> dict[str, Any]:
    """Fields of a mesh whose marked elements are halved; children take their parent's place."""
    ne, nv = mesh.nelements, mesh.p.shape[1]
    halves = np.ones(ne, dtype=np.int64)
    halves[marked] = 2
    parent = np.repeat(np.arange(ne), halves)
    first = np.cumsum(halves) - halves
    t, spans = mesh.t[:, parent].copy(), mesh.spans[:, parent].copy()
    left, right = first[marked], first[marked] + 1
    t[1, left] = t[0, right] = nv + np.arange(len(marked))
    spans[1, left] = spans[0, right] = mesh.spans[:, marked].mean(axis=0)
    points = mesh.p
    if len(marked):
        middle = mesh.mapping().F(np.array([[0.5]]), marked)[:, :, 0]
        points = np.concatenate([mesh.p, middle], axis=1)
    beams = None
    if mesh._subdomains is not None:
        beams = {k: np.flatnonzero(np.isin(parent, v)) for k, v in mesh.beams.items()}
    return {
        "doflocs": points,
        "t": t,
        "curve_ids": mesh.curve_ids[parent],
        "spans": spans,
        "_subdomains": beams,
    }


def moved_arrays(mesh: MeshCurve, rotation: Any, shift: Any) -> dict[str, Any]:
    """Fields of a mesh moved by ``x -> rotation @ x + shift``."""
    turn = np.eye(3) if rotation is None else np.asarray(rotation, dtype=float)
    if turn.shape != (3, 3) or not np.allclose(turn @ turn.T, np.eye(3), rtol=0, atol=1e-12):
        raise MeshError("argument rotation", f"{turn.tolist()} is no orthogonal matrix")
    by = np.asarray(shift, dtype=float)
    if by.shape != (3,) or not np.isfinite(by).all():
        raise MeshError("argument shift", f"got {shift}, expected three finite numbers")
    return {
        "doflocs": turn @ mesh.p + by[:, None],
        "curves": [CurveMoved(curve, turn, by) for curve in mesh.curves],
    }


def restricted_arrays(mesh: MeshCurve, elements: Array) -> tuple[dict[str, Any], IndexArray]:
    """Fields of a mesh with some elements only, and the old numbers of its vertices."""
    vertices = np.unique(mesh.t[:, elements])
    number = np.full(mesh.p.shape[1], -1)
    number[vertices] = np.arange(len(vertices))
    place = np.full(mesh.nelements, -1)
    place[elements] = np.arange(len(elements))
    nodes = {k: number[v][number[v] >= 0] for k, v in mesh.nodes.items()}
    beams = {k: place[v][place[v] >= 0] for k, v in mesh.beams.items()}
    arrays = {
        "doflocs": mesh.p[:, vertices],
        "t": number[mesh.t[:, elements]],
        "curve_ids": mesh.curve_ids[elements],
        "spans": mesh.spans[:, elements],
        "_boundaries": {k: v for k, v in nodes.items() if v.size},
        "_subdomains": {k: v for k, v in beams.items() if v.size},
    }
    return arrays, vertices


def joined_arrays(meshes: Sequence[MeshCurve], tol: float | None, weld: bool) -> dict[str, Any]:
    """Fields of the mesh of several meshes."""
    points = np.concatenate([m.p for m in meshes], axis=1)
    limit = 1e-9 * float(np.linalg.norm(np.ptp(points, axis=1))) if tol is None else float(tol)
    if not (np.isfinite(limit) and limit >= 0.0):
        raise MeshError("argument tol", f"got {tol}, expected a distance in m")
    kept: list[Floats] = []
    numbers: list[IndexArray] = []
    total = 0
    for k, mesh in enumerate(meshes):
        number = np.full(mesh.p.shape[1], -1)
        if weld and k > 0:
            number = _coinciding(np.concatenate(kept, axis=1), mesh, limit)
        new = number < 0
        number[new] = total + np.arange(new.sum())
        total += int(new.sum())
        kept.append(mesh.p[:, new])
        numbers.append(number)
    shifts = np.cumsum([0] + [len(m.curves) for m in meshes])
    first = np.cumsum([0] + [m.nelements for m in meshes])
    ids = [
        np.where(m.curve_ids < 0, -1, m.curve_ids + s) for m, s in zip(meshes, shifts, strict=False)
    ]
    return {
        "doflocs": np.concatenate(kept, axis=1),
        "t": np.concatenate([n[m.t] for m, n in zip(meshes, numbers, strict=True)], axis=1),
        "curves": [curve for m in meshes for curve in m.curves],
        "curve_ids": np.concatenate(ids),
        "spans": np.concatenate([m.spans for m in meshes], axis=1),
        "_subdomains": _united("beam", [m.beams for m in meshes], lambda k, v: v + first[k]),
        "_boundaries": _united("node", [m.nodes for m in meshes], lambda k, v: numbers[k][v]),
    }


def _united(kind: str, parts: Sequence[dict[str, IndexArray]], renumber: Any) -> dict[str, Any]:
    """All names of all meshes; each may occur once."""
    out: dict[str, Any] = {}
    for k, names in enumerate(parts):
        for name, index in names.items():
            if name in out:
                raise MeshError(f"{kind} '{name}'", f"occurs in several meshes (again in mesh {k})")
            out[name] = renumber(k, index)
    return out


def _coinciding(points: Floats, mesh: MeshCurve, tol: float) -> IndexArray:
    """For each vertex of a mesh the number of the point (3, n) it coincides with, or -1."""
    number = np.full(mesh.p.shape[1], -1)
    hits = cKDTree(points.T).query_ball_point(mesh.p.T, tol)
    for v, found in enumerate(hits):
        if len(found) > 1:
            raise MeshError(
                f"node at {mesh.p[:, v].tolist()}",
                f"lies within tol = {tol:.3g} m of several nodes {sorted(found)}: join with a"
                " smaller tol or weld=False",
            )
        if found:
            number[v] = found[0]
    pairs = number[mesh.t]
    collapsed = (pairs[0] == pairs[1]) & (pairs[0] >= 0)
    if collapsed.any():
        e = int(np.argmax(collapsed))
        a, b = mesh.p[:, mesh.t[:, e]].T.tolist()
        raise MeshError("argument tol", f"{tol:.3g} m would collapse the element from {a} to {b}")
    hit, times = np.unique(number[number >= 0], return_counts=True)
    if (times > 1).any():
        vertices = np.flatnonzero(number == hit[np.argmax(times > 1)]).tolist()
        raise MeshError(
            f"node at {mesh.p[:, vertices[0]].tolist()}",
            f"nodes {vertices} of one mesh would all be merged into one: join with a smaller tol"
            " or weld=False",
        )
    return number
