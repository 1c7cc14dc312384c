"""Finding nodes, beams and elements by name, number or position."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import MeshError
from ..types import Array, ArrayLike, Floats, IndexArray, VectorLike, numbers
from .topology import find_chains

if TYPE_CHECKING:  # pragma: no cover - for annotations only
    from .mesh import MeshCurve

__all__ = ["element_finder", "element_numbers", "find_beam", "find_node", "number_of_times"]
__all__ += ["places_along"]

#: Distance at which a position is said to meet a node, as a part of the mesh size.
POSITION_TOLERANCE = 1e-8


def _listed(names: Mapping[str, Any]) -> str:
    """Names for a message."""
    return ", ".join(f"'{name}'" for name in names) or "none"


def find_beam(beams: Mapping[str, IndexArray], beam: str) -> IndexArray:
    """Elements of a named beam."""
    if beam not in beams:
        raise MeshError(f"beam '{beam}'", f"unknown; known beams: {_listed(beams)}")
    return beams[beam]


def find_node(
    points: Floats, names: Mapping[str, IndexArray], which: str | int | VectorLike, size: float
) -> int:
    """Number of the node in ``points`` (n, 3) given by name, number or position."""
    if isinstance(which, str):
        if which not in names:
            raise MeshError(f"node '{which}'", f"unknown; known nodes: {_listed(names)}")
        if len(names[which]) != 1:
            raise MeshError(
                f"node '{which}'", f"names {len(names[which])} nodes, expected exactly one"
            )
        return int(names[which][0])
    if isinstance(which, (int, np.integer)) and not isinstance(which, bool):
        if not 0 <= which < len(points):
            raise MeshError(f"node {which}", f"the mesh has nodes 0 .. {len(points) - 1}")
        return int(which)
    place = numbers(f"node {which!r}", "position", which)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise MeshError(f"node {which!r}", "expected a name, a number or a position (3,)")
    gaps = np.linalg.norm(points - place, axis=1)
    hits = np.flatnonzero(gaps <= POSITION_TOLERANCE * size)
    where = f"node at {place.tolist()}"
    if hits.size == 0:
        k = int(np.argmin(gaps))
        raise MeshError(where, f"no node there; node {k} is nearest, {gaps[k]:.3g} m away")
    if hits.size > 1:
        raise MeshError(where, f"several nodes there: {hits.tolist()}; give the number or a name")
    return int(hits[0])


def places_along(
    mesh: MeshCurve, s: ArrayLike, beam: str | None = None
) -> tuple[IndexArray, Floats]:
    """Elements (m,) and reference coordinates (m,) at arc lengths s (m,) along a beam or all."""
    ids = np.arange(mesh.nelements) if beam is None else find_beam(mesh.beams, beam)
    item = "mesh" if beam is None else f"beam '{beam}'"
    chains = find_chains(mesh.t[:, ids], np.zeros(len(ids), dtype=np.int64), [beam or ""])
    if len(chains) != 1:
        raise MeshError(
            item,
            f"is no single line but {len(chains)}: give the name of one, of"
            f" {_listed(mesh.beams)}, or elements and their reference coordinates",
        )
    ids = ids[chains[0].elements]
    ends = np.cumsum(mesh.lengths[ids])
    tol = 1e-12 * ends[-1]
    at = np.atleast_1d(numbers(item, "arc length s", s))
    wrong = ~((at >= -tol) & (at <= ends[-1] + tol))
    if at.ndim != 1 or wrong.any():
        what = f"shape {at.shape}" if at.ndim != 1 else f"{at[wrong][0]} m"
        raise MeshError(item, f"arc length s: {what}, expected numbers in 0 .. {ends[-1]:.9g} m")
    k = np.minimum(np.searchsorted(ends, at + tol, side="right"), len(ids) - 1)
    xi = 1.0 - (ends[k] - at) / mesh.lengths[ids[k]]
    return ids[k], np.clip(xi, 0.0, 1.0)


def number_of_times(value: Any) -> int:
    """How often a mesh is to be refined; MeshError for a negative number."""
    if value < 0:
        raise MeshError("refinement", f"{value} times, expected 0 or more")
    return int(value)


def element_numbers(which: Any, count: int) -> IndexArray:
    """Element numbers from numbers or a mask (ne,)."""
    index = np.atleast_1d(np.asarray(which))
    if index.dtype == bool:
        if index.shape != (count,):
            raise MeshError("element mask", f"has shape {index.shape}, expected ({count},)")
        return np.flatnonzero(index)
    if index.size == 0:
        return np.zeros(0, dtype=np.int64)
    if not np.issubdtype(index.dtype, np.integer):
        raise MeshError("element numbers", f"have type {index.dtype}, expected integers")
    if index.min() < 0 or index.max() >= count:
        bad = index.min() if index.min() < 0 else index.max()
        raise MeshError(f"element {bad}", f"the mesh has elements 0 .. {count - 1}")
    return index.astype(np.int64)


def element_finder(mesh: MeshCurve) -> Callable[..., Array]:
    """Function of coordinates x, y, z (n,) that returns the element each point lies on."""
    mapping = mesh.mapping()
    middle = mapping.F(np.array([[0.5]]))[:, :, 0]
    reach = 0.5 * mesh.lengths + POSITION_TOLERANCE * mesh.size

    def finder(x: Array, y: Array, z: Array) -> Array:
        found = np.empty(len(x), dtype=np.int32)
        for k, place in enumerate(np.stack([x, y, z], axis=1)):
            near = np.flatnonzero(np.linalg.norm(middle.T - place, axis=1) <= reach)
            at = np.broadcast_to(place[:, None, None], (3, len(near), 1))
            feet = mapping.F(mapping.invF(at, near), near) if near.size else at
            gaps = np.linalg.norm(feet - at, axis=0)[:, 0]
            if near.size == 0 or gaps.min() > POSITION_TOLERANCE * mesh.size:
                raise MeshError(f"point {place.tolist()}", "lies on no element of the mesh")
            found[k] = near[np.argmin(gaps)]
        return found

    return finder
