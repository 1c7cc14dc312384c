"""Arrays of meshes along chains of curves, used by the factories of MeshCurve."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import MeshError
from ..types import Floats, IndexArray
from .curves import Curve

__all__ = ["CurveChain", "beam_nodes", "curve_chain", "element_count"]


@dataclass(frozen=True, eq=False)
class CurveChain:
    """A chain of elements on curves that follow each other.

    Attributes
    ----------
    points : (3, nv)
        Vertices (m).
    t : (2, ne)
        Vertices of the elements.
    curve_ids : (ne,)
        Curve of each element.
    spans : (2, ne)
        Arc lengths on that curve at which the element starts and ends (m).
    """

    points: Floats
    t: IndexArray
    curve_ids: IndexArray
    spans: Floats


def element_count(value: int, item: str) -> int:
    """A number of elements, at least one."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise MeshError(item, f"number of elements is {value!r}, expected an integer of 1 or more")
    return int(value)


def curve_chain(curves: Sequence[Curve], arcs: Sequence[Floats], closed: bool) -> CurveChain:
    """Chain with vertices at given arc lengths ``arcs[k]`` (n_k + 1,) of each curve."""
    points = [curve.point(s[:-1]) for curve, s in zip(curves, arcs, strict=True)]
    if not closed:
        points.append(curves[-1].point(arcs[-1][-1:]))
    counts = [len(s) - 1 for s in arcs]
    ne = sum(counts)
    t = np.stack([np.arange(ne), np.arange(1, ne + 1)])
    if closed:
        t[1, -1] = 0
    return CurveChain(
        points=np.concatenate(points, axis=1),
        t=t,
        curve_ids=np.repeat(np.arange(len(curves)), counts),
        spans=np.concatenate([np.stack([s[:-1], s[1:]]) for s in arcs], axis=1),
    )


def beam_nodes(
    name: str, spans: Floats, closed: bool, nodes: Mapping[str, float] | None
) -> dict[str, IndexArray]:
    """Vertices of a chain's named nodes: its ends and those given by relative arc length."""
    ends = np.concatenate([[0.0], np.cumsum(spans[1] - spans[0])])
    places = ends / ends[-1]
    named = {f"{name}.start": np.array([0])}
    if not closed:
        named[f"{name}.end"] = np.array([len(places) - 1])
    for key, place in (nodes or {}).items():
        if key in named:
            raise MeshError(f"node '{key}'", f"the name is given to an end of beam '{name}'")
        k = int(np.argmin(np.abs(places - place))) if np.isfinite(place) else 0
        if not abs(places[k] - place) <= 1e-9:
            close = ", ".join(f"{x:.6g}" for x in np.sort(places[max(k - 1, 0) : k + 2]))
            raise MeshError(
                f"node '{key}'",
                f"relative arc length {place} of beam '{name}' meets no vertex; nearby: {close}."
                " Change the number of elements",
            )
        named[key] = np.array([0 if closed and k == len(places) - 1 else k])
    return named
