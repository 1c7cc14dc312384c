"""Division of lines into other elements, and the places of one mesh's nodes in another mesh."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..arguments import checked
from ..errors import MeshError
from ..types import TOLERANCE, Floats, IndexArray
from .topology import POSITION_TOLERANCE, element_count

if TYPE_CHECKING:
    from .mesh import MeshCurve


# -- the same lines divided into other numbers of elements, fewer ones included --------------------


@checked
def divided(mesh: MeshCurve, elements: int, keep: Sequence[tuple[int, float]] = ()) -> MeshCurve:
    """Copy of a mesh with another number of elements, finer or coarser than it is.

    Where lines meet, end, have a corner or a named node, or change their name there is a vertex
    in any case; in between, elements are of equal length. Chords of a curve that is not known
    are not merged: that would be another line.

    Parameters
    ----------
    mesh : MeshCurve
    elements : int
        As many as there are lines of that kind at least.
    keep : sequence of (int, float), optional
        Elements and reference coordinates in [0, 1] of further places that get a vertex.

    Returns
    -------
    MeshCurve
        Elements follow each other as before, so that states can be carried over.

    Raises
    ------
    MeshError
        For a number below one.

    Examples
    --------
    >>> from skfem_cosserat.mesh import MeshCurve, divided
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 20, nodes={"mid": 0.5})
    >>> divided(mesh, 1).p[0].tolist(), divided(mesh, 1).node("mid")
    ([0.0, 0.5, 1.0], 1)
    >>> divided(mesh, 4).lengths.tolist()
    [0.25, 0.25, 0.25, 0.25]
    """
    count = element_count(elements, "mesh")
    lines = []
    for run in _runs(mesh):
        ends = np.append(0.0, mesh.lengths[run].cumsum())
        inside = [ends[e - run[0]] + xi * mesh.lengths[e] for e, xi in keep if e in run]
        stops = np.unique((np.array([0.0, *inside, ends[-1]]) / ends[-1]).round(12)) * ends[-1]
        lines.append((run, stops))
    counts = _counts(mesh, lines, count)
    points, chains, spans = [mesh.p], [], []
    for run, stops in lines:
        parts = [np.linspace(a, b, counts.pop(0) + 1)[1:] for a, b in pairwise(stops)]
        along, inner = _along(mesh, run, np.concatenate([[0.0], *parts]))
        fresh = sum(each.shape[1] for each in points) + np.arange(inner.shape[1])
        points.append(inner)
        chains.append(np.concatenate([mesh.t[:1, run[0]], fresh, mesh.t[1:, run[-1]]]))
        spans.append(np.stack([along[:-1], along[1:]]))
    # vertices are numbered along the lines
    used, first = np.unique(np.concatenate(chains), return_index=True)
    used = used[first.argsort()]
    every = np.concatenate(points, 1)
    number = np.empty(every.shape[1], np.int64)
    number[used] = np.arange(len(used))
    parent = np.repeat([run[0] for run, _ in lines], [len(chain) - 1 for chain in chains])
    return replace(
        mesh,
        doflocs=every[:, used],
        t=np.concatenate([number[np.stack([chain[:-1], chain[1:]])] for chain in chains], 1),
        spans=np.concatenate(spans, 1),
        curve_ids=mesh.curve_ids[parent],
        _subdomains={k: np.flatnonzero(np.isin(parent, v)) for k, v in mesh.beams.items()},
        _boundaries={k: number[v] for k, v in mesh.nodes.items()},
    )


def _along(mesh: MeshCurve, run: IndexArray, places: Floats) -> tuple[Floats, Floats]:
    """Spans (n,) of arc lengths from the start of a run, and points (3, n - 2) between its ends."""
    w = places / places[-1]
    curve = int(mesh.curve_ids[run[0]])
    if curve < 0:
        a = mesh.p[:, mesh.t[0, run[0]]]
        b = mesh.p[:, mesh.t[1, run[-1]]]
        return places, (np.outer(a, 1 - w) + np.outer(b, w))[:, 1:-1]
    spans = mesh.spans[0, run[0]] * (1 - w) + mesh.spans[1, run[-1]] * w
    return spans, np.asarray(mesh.curves[curve].point(spans))[:, 1:-1]


def _counts(mesh: MeshCurve, lines: Sequence[tuple[IndexArray, Floats]], total: int) -> list[int]:
    """Elements of each line between stops: the next one goes where they are longest."""
    lengths = []
    counts = []
    for run, stops in lines:
        closed = mesh.t[0, run[0]] == mesh.t[1, run[-1]]
        lengths += np.diff(stops).tolist()
        counts += [3 if closed and len(stops) == 2 else 1] * (len(stops) - 1)
    queue = [(-length / n, k) for k, (length, n) in enumerate(zip(lengths, counts, strict=True))]
    heapq.heapify(queue)
    for _ in range(total - sum(counts)):
        k = queue[0][1]
        counts[k] += 1
        heapq.heapreplace(queue, (-lengths[k] / counts[k], k))
    return counts


def _runs(mesh: MeshCurve) -> list[IndexArray]:
    """Elements that follow each other on one line without anything between them."""
    ne = mesh.nelements
    t = mesh.t
    first = np.arange(ne - 1)
    second = np.arange(1, ne)
    joined = t[1, :-1] == t[0, 1:]
    joined &= np.bincount(t.ravel(), minlength=mesh.p.shape[1])[t[1, :-1]] == 2
    named = np.zeros(mesh.p.shape[1], bool)
    for vertices in mesh.nodes.values():
        named[vertices] = True
    joined &= ~named[t[1, :-1]]
    for part in mesh.beams.values():
        inside = np.zeros(ne, bool)
        inside[part] = True
        joined &= inside[first] == inside[second]
    joined &= mesh.curve_ids[first] == mesh.curve_ids[second]
    chord = mesh.curve_ids[first] < 0
    along = mesh.p[:, t[1]] - mesh.p[:, t[0]]
    along = along / np.linalg.norm(along, axis=0)
    bend = np.linalg.norm(along[:, 1:] - along[:, :-1], axis=0)
    gap = abs(mesh.spans[1, :-1] - mesh.spans[0, 1:])
    same_way = (np.diff(mesh.spans, axis=0)[0, :-1] > 0) == (np.diff(mesh.spans, axis=0)[0, 1:] > 0)
    follows = (gap <= TOLERANCE * mesh.lengths[first]) & same_way
    joined &= np.where(chord, bend <= TOLERANCE, follows)
    return np.split(np.arange(ne), np.flatnonzero(~joined) + 1)


# -- where the nodes of one mesh lie in the elements of another one of the same lines --------------


def places_in(mesh: MeshCurve, other: MeshCurve, xi: Floats) -> tuple[IndexArray, Floats]:
    """Elements of a mesh, and reference coordinates in them, of places in another mesh.

    Both meshes divide the same lines, and their elements follow each other in the same order, as
    they do after :meth:`MeshCurve.refined`: elements are found by the length of all before them,
    so that lines may cross, touch or lie upon each other.

    Parameters
    ----------
    mesh, other : MeshCurve
    xi : (n,) array
        Reference coordinates, the same in all elements of `other`.

    Returns
    -------
    elements, xi : (ne, n) arrays
        For each element of `other`. Where two elements of `mesh` meet: the one towards the middle
        of the element of `other`.

    Raises
    ------
    MeshError
        If places of both meshes are apart: they do not divide the same lines.

    Examples
    --------
    >>> from skfem_cosserat.mesh import MeshCurve
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2)
    >>> elements, xi = places_in(mesh, mesh.refined([1]), np.array([0.0, 1.0]))
    >>> elements.tolist(), xi.tolist()
    ([[0, 0], [1, 1], [1, 1]], [[0.0, 1.0], [0.0, 0.5], [0.5, 1.0]])
    """
    ends, starts = (np.append(0.0, m.lengths.cumsum()) for m in (mesh, other))
    total = ends[-1]
    if not abs(ends[-1] - starts[-1]) <= POSITION_TOLERANCE * max(ends[-1], starts[-1]):
        raise MeshError(
            "mesh", f"its lines are {starts[-1]:.9g} m long, of the mesh before {total:.9g} m"
        )
    s = starts[:-1, None] + other.lengths[:, None] * xi
    inside = s + 1e-6 * ((starts[:-1, None] + 0.5 * other.lengths[:, None]) - s)
    e = (np.searchsorted(ends, inside, side="right") - 1).clip(0, mesh.nelements - 1)
    x = (s - ends[e]) / mesh.lengths[e]
    for end in (0.0, 1.0):
        x = np.where(abs(x - end) <= TOLERANCE, end, x)
    x = np.clip(x, 0.0, 1.0)
    here = mesh.mapping().F(x.reshape(1, -1, 1), e.ravel())[:, :, 0]
    gaps = np.linalg.norm(here - other.mapping().F(xi[None]).reshape(3, -1), axis=0)
    if gaps.max() > POSITION_TOLERANCE * mesh.size:
        raise MeshError(
            f"element {gaps.argmax() // len(xi)}",
            f"is {gaps.max():.3g} m away from the line of the mesh before: expected the same lines"
            " in the same order, as after mesh.refined()",
        )
    return e.astype(np.int64), x
