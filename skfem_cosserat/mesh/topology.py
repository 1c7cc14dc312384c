"""Chains of elements from connectivity, arrays of meshes along curves, checks, finding by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, MeshError, ModelWarning
from ..frozen import lock_arrays
from ..types import (
    Array,
    ArrayLike,
    Floats,
    IndexArray,
    VectorLike,
    is_whole,
    names_known,
    numbers,
    real,
    shown,
)
from ..warn import warn
from .curves import Curve

if TYPE_CHECKING:
    from .mesh import MeshCurve

# -- chains: the order of elements along beams, found from connectivity alone ----------------------


@dataclass(frozen=True, eq=False)
class Chain:
    """Elements of one beam in order, each starting where the one before ends.

    Attributes
    ----------
    elements : (m,)
        Element numbers from the chain's start to its end.
    closed : bool
        If the last element ends where the first one starts.
    owner : int
        Number of the beam, -1 for elements in no beam.
    """

    elements: IndexArray
    closed: bool
    owner: int


@dataclass(frozen=True, eq=False)
class ChainOrder:
    """All chains of a mesh one after the other, as arrays.

    Attributes
    ----------
    elements : (ne,)
        Element numbers, chain by chain.
    first : (chains + 1,)
        Place in ``elements`` at which a chain begins.
    closed : (chains,)
        If the last element ends where the first one starts.
    owner : (chains,)
        Number of the beam, -1 for elements in no beam.
    before, after : (k,)
        Elements that follow each other, also where a closed chain begins again.
    """

    elements: IndexArray
    first: IndexArray
    closed: Array
    owner: IndexArray
    before: IndexArray
    after: IndexArray

    def chains(self) -> list[Chain]:
        """Each by itself."""
        parts = np.split(self.elements, self.first[1:-1])
        closed = self.closed.tolist()
        return [Chain(*each) for each in zip(parts, closed, self.owner.tolist(), strict=True)]

    def side_by_side(self) -> Iterator[tuple[IndexArray, Array]]:
        """Elements (c, m) of all chains of one length m, and which of them (c,) are closed."""
        count = np.diff(self.first)
        for m in np.unique(count).tolist():
            which = np.flatnonzero(count == m)
            yield self.elements[self.first[which][:, None] + np.arange(m)], self.closed[which]


def _neighbours(t: Array, owner: IndexArray) -> IndexArray:
    """Neighbours of elements at start and end (2, ne): ``2 * other + its end``, or -1.

    Only where it meets one other element of its own beam: the chain neither ends nor branches.
    """
    ne = t.shape[1]
    key = (t.astype(np.int64) * (owner.max() + 2) + owner + 1).T.ravel()
    order = np.argsort(key, kind="stable")
    at = key[order]
    new = np.ones(len(at) + 1, bool)
    new[1:-1] = at[1:] != at[:-1]
    first = np.flatnonzero(new)
    pairs = first[:-1][np.diff(first) == 2]
    one = order[pairs]
    two = order[pairs + 1]
    out = np.full(2 * ne, -1)
    out[one] = two
    out[two] = one
    return out.reshape(ne, 2).T


def find_chains(t: Array, owner: IndexArray, names: Sequence[str]) -> ChainOrder:
    """Chains of all beams; a chain ends where its beam ends or branches.

    Parameters
    ----------
    t : (2, ne)
        Vertices of the elements.
    owner : (ne,)
        Beam number of each element, -1 for none.
    names : sequence of str
        Names of the beams, for messages.

    Raises
    ------
    MeshError
        If two elements of a beam point against each other where nothing else joins them.
    """
    ne = t.shape[1]
    met = _neighbours(t, owner)
    against = (met >= 0) & (met % 2 == np.array([[0], [1]]))
    if against.any():
        which = np.flatnonzero(against.any(0))
        e = int(which[owner[which].argmin()])
        end = int(np.argmax(against[:, e]))
        raise MeshError(
            f"beam '{names[owner[e]]}'" if owner[e] >= 0 else "elements in no beam",
            f"elements {e} and {int(met[end, e]) // 2} point against each other at node"
            f" {t[end, e]}: use mesh.directed() to turn one",
        )
    successor = np.where(met[1] >= 0, met[1] // 2, -1)
    leading = np.ones(ne, bool)
    leading[successor[successor >= 0]] = False
    following = successor.tolist()
    used = [False] * ne
    elements: list[int] = []
    begun = []  # first element, closed, where it is in `elements`
    # open chains from their first elements, then the closed ones
    for closed, firsts in ((False, np.flatnonzero(leading).tolist()), (True, range(ne))):
        for e in firsts if len(elements) < ne else ():
            if used[e]:
                continue
            begun.append((e, closed, len(elements)))
            while e >= 0 and not used[e]:
                used[e] = True
                elements.append(e)
                e = following[e]
    heads, rings, starts = map(np.array, zip(*begun, strict=True))
    every = np.array(elements, np.int64)
    sort = np.lexsort((heads, rings, owner[heads]))
    count = np.diff(np.append(starts, ne))[sort]
    first = np.append(0, count.cumsum())
    every = every[np.repeat(starts[sort] - first[:-1], count) + np.arange(ne)]
    before = every[successor[every] >= 0]
    out = ChainOrder(every, first, rings[sort], owner[heads][sort], before, successor[before])
    lock_arrays(out)
    return out


def directed_flips(t: Array, owner: IndexArray) -> Array:
    """Mask (ne,) of the elements to turn so that every chain runs head to tail.

    The lowest-numbered element of each chain keeps its direction.
    """
    met = _neighbours(t, owner).tolist()
    flip, seen = ([False] * t.shape[1] for _ in range(2))
    for first in range(t.shape[1]):
        if seen[first]:
            continue
        seen[first] = True
        for end in (1, 0):  # forwards from the head, backwards from the tail
            place = met[end][first]
            while place >= 0 and not seen[other := place // 2]:
                seen[other] = True
                flip[other] = place % 2 == end
                place = met[1 - place % 2][other]
    return np.array(flip)


def arc_starts(order: ChainOrder, lengths: Floats) -> Floats:
    """Arc length (ne,) from the start of its chain to the start of each element (m)."""
    starts = np.zeros(len(lengths))
    for elements, _ in order.side_by_side():
        starts[elements[:, 1:]] = lengths[elements].cumsum(1)[:, :-1]
    return starts


def duplicates(mesh: MeshCurve, tol: float) -> tuple[int, int] | None:
    """First pair of elements with the same nodes and the same middle point, if any."""
    a, b = np.sort(mesh.t.astype(np.int64), axis=0)
    _, key, times = np.unique(a * mesh.p.shape[1] + b, return_inverse=True, return_counts=True)
    again = np.flatnonzero((times > 1)[key])
    if not len(again):
        return None
    from scipy.spatial import cKDTree  # slow to import, seldom needed

    middle = mesh.mapping().F(np.array([[0.5]]), again)[:, :, 0].T
    pairs = again[cKDTree(middle).query_pairs(tol, output_type="ndarray")].tolist()
    return next(((e, f) for e, f in sorted(pairs) if key[e] == key[f]), None)


# -- checks of a mesh at construction: every message names the element, node or array --------------


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
        node = np.argmin(np.isfinite(points).all(0))
        raise MeshError(f"node {node}", f"coordinates {points[:, node].tolist()} are not finite")
    nv = points.shape[1]
    wrong = ((lines < 0) | (lines >= nv)).any(0)
    if wrong.any():
        e = np.argmax(wrong)
        raise MeshError(f"element {e}", f"has nodes {lines[:, e].tolist()}, the mesh has {nv}")
    used = np.zeros(nv, bool)
    used[lines] = True
    if not used.all():
        node = used.argmin()
        raise MeshError(f"node {node}", f"at {points[:, node].tolist()} belongs to no element")
    return np.ascontiguousarray(points), np.ascontiguousarray(lines)


def check_numbers(item: str, index: Array, least: int, count: int) -> None:
    """Raise MeshError unless these are integers from `least` on, below `count`."""
    if index.size and not np.issubdtype(index.dtype, np.integer):
        raise MeshError(item, f"type {index.dtype}, expected integers")
    wrong = index[(index < least) | (index >= count)]
    if wrong.size:
        raise MeshError(item, f"number {wrong[0]} is not in {least} .. {count - 1}")


def check_name(kind: str, name: object) -> None:
    """Raise MeshError unless it is a text."""
    if not isinstance(name, str):
        raise MeshError(f"name of a {kind}", f"got {name!r}, expected a text")


def check_geometry(mesh: MeshCurve) -> None:
    """Lengths, vertices on curves, duplicates and names."""
    size = mesh.size
    degenerate = (mesh.lengths <= 1e-14 * size) | (mesh.t[0] == mesh.t[1])
    if degenerate.any():
        e = np.argmax(degenerate)
        raise MeshError(
            f"element {e}",
            f"between nodes {mesh.t[0, e]} and {mesh.t[1, e]} has zero length or one node only",
        )
    _check_curves(mesh, size)
    pair = duplicates(mesh, 1e-9 * size)
    if pair is not None:
        nodes = mesh.t[:, pair[0]].tolist()
        raise MeshError(f"element {pair[1]}", f"duplicates element {pair[0]}, both join {nodes}")
    for kind, names, count in (
        ("beam", mesh._subdomains, mesh.nelements),
        ("node", mesh._boundaries, mesh.p.shape[1]),
    ):
        for name, index in (names or {}).items():
            check_name(kind, name)
            check_numbers(f"{kind} '{name}'", np.asarray(index), 0, count)
    if not 0.0 <= mesh.feature_angle <= np.pi:
        raise MeshError("argument feature_angle", f"{mesh.feature_angle} is not in [0, pi] rad")


def _check_curves(mesh: MeshCurve, size: float) -> None:
    """Ends of elements against the curves they are said to lie on."""
    on_curve = np.flatnonzero(mesh.curve_ids >= 0)
    if on_curve.size == 0:
        return
    spans = mesh.spans[:, on_curve]
    limit = np.array([curve.length for curve in mesh.curves])[mesh.curve_ids[on_curve]]
    outside = ~((spans >= -1e-9 * limit) & (spans <= (1 + 1e-9) * limit)).all(0)
    if outside.any():
        k = np.argmax(outside)
        raise MeshError(
            f"element {on_curve[k]}",
            f"span {spans[:, k].tolist()} m leaves its curve of length {limit[k]} m",
        )
    ends = mesh.mapping().F(np.array([[0.0, 1.0]]), on_curve)
    gap = np.linalg.norm(ends - mesh.p[:, mesh.t[:, on_curve].T], axis=0)
    if gap.max() > 1e-6 * size:
        k, end = divmod(np.argmax(gap), 2)
        e = on_curve[k]
        raise MeshError(
            f"element {e}",
            f"node {mesh.t[end, e]} is {gap[k, end]:.3g} m off its curve: change the curves"
            " together with the points, e.g. by mesh.moved()",
        )


# -- lines that cross without a common vertex ------------------------------------------------------


#: elements of which all pairs are looked at
FEW = 200


def crossings(mesh: MeshCurve, tol: float) -> tuple[IndexArray, Floats]:
    """Elements (2, k) that meet between the vertices of one of them at least, and where (k, 3).

    By their chords, of those that have no vertex in common. Parallel ones are left out.
    """
    ends = mesh.p.T[mesh.t]
    along = ends[1] - ends[0]
    size = np.linalg.norm(along, axis=1)
    if mesh.nelements <= FEW:
        e, f = np.triu_indices(mesh.nelements, 1)
    else:
        from scipy.spatial import cKDTree  # slow to import

        middle = ends.mean(0)
        # of two that meet the middles are not farther apart than the longer one is long
        near = cKDTree(middle).query_ball_point(middle, size + tol)
        first = np.repeat(range(mesh.nelements), [len(each) for each in near])
        e, f = np.unique(np.sort(np.stack([first, np.concatenate(near)]), axis=0), axis=1)
    apart = (mesh.t[:, None, e] != mesh.t[None, :, f]).all((0, 1))
    e = e[apart]
    f = f[apart]
    # the points that are closest: s of the way along e, r along f
    u, v, gap = along[e], along[f], ends[0, f] - ends[0, e]
    normal = np.cross(u, v)
    with np.errstate(all="ignore"):
        s, r = ((np.cross(gap, each) * normal).sum(1) / (normal**2).sum(1) for each in (v, u))
    place = np.stack([s, r])
    off = tol / size[np.stack([e, f])]
    on = ((place >= -off) & (place <= 1 + off)).all(0)
    on &= ((place > off) & (place < 1 - off)).any(0)
    on &= np.linalg.norm(gap + r[:, None] * v - s[:, None] * u, axis=1) <= tol
    return np.stack([e, f])[:, on], (ends[0, e] + s[:, None] * u)[on]


def warn_of_crossings(mesh: MeshCurve, part: IndexArray) -> None:
    """Say which lines of different parts (ne,) cross without a common vertex."""
    pairs, places = crossings(mesh, POSITION_TOLERANCE * mesh.size)
    between = part[pairs[0]] != part[pairs[1]]
    pairs = pairs[:, between]
    places = places[between]
    if not len(places):
        return
    more = f" ({len(places) - 1} more like it)" * (len(places) > 1)
    warn(
        mesh_label(mesh.beams),
        f"elements {pairs[0, 0]} and {pairs[1, 0]} meet at {places[0].round(9).tolist()} without a"
        f" common vertex{more}, nothing connects them there: right if they pass each other, else"
        " divide both so that they have a vertex there",
        ModelWarning,
    )


# -- arrays of meshes along chains of curves, used by the factories of MeshCurve -------------------

#: how many elements a beam or a refined mesh may have: each takes kilobytes in a scene
MOST_ELEMENTS = 10**7


def element_count(value: int, item: str) -> int:
    """A number of elements, at least one."""
    if not is_whole(value) or value < 1:
        given = f"number of elements is {shown(value)}"
        raise MeshError(item, f"{given}, expected an integer of 1 or more")
    if value > MOST_ELEMENTS:
        given = f"number of elements is {shown(value)}"
        raise MeshError(item, f"{given}, expected at most {MOST_ELEMENTS}")
    return int(value)


def chain_arrays(curves: Sequence[Curve], arcs: Sequence[Floats], closed: bool) -> dict[str, Any]:
    """Fields of a mesh with vertices at arc lengths ``arcs[k]`` (n_k + 1,) of each curve."""
    points = [curve.point(s[:-1]) for curve, s in zip(curves, arcs, strict=True)]
    if not closed:
        points.append(curves[-1].point(arcs[-1][-1:]))
    counts = [len(s) - 1 for s in arcs]
    t = np.arange(sum(counts)) + np.array([[0], [1]])
    if closed:
        t[1, -1] = 0
    return {
        "doflocs": np.concatenate(points, 1),
        "t": t,
        "curves": curves,
        "curve_ids": np.arange(len(curves)).repeat(counts),
        "spans": np.concatenate([np.stack([s[:-1], s[1:]]) for s in arcs], 1),
    }


def relative_length(node: str, value: float) -> float:
    """A finite number."""
    try:
        place = real("node", "place", value, "a number")
    except InputError:
        place = np.nan
    if not np.isfinite(place):
        raise MeshError(
            f"node {node!r}", f"got {value!r}, expected a share of the length in [0, 1]"
        )
    return place


def beam_nodes(
    name: str, spans: Floats, closed: bool, nodes: Mapping[str, float] | None
) -> dict[str, IndexArray]:
    """Vertices of a chain's named nodes: its ends and those given by relative arc length."""
    check_name("beam", name)
    if not isinstance(nodes, Mapping | None):
        raise MeshError(f"beam {name!r}", f"nodes = {nodes!r}, expected a dict of relative lengths")
    ends = np.concatenate([[0.0], np.cumsum(spans[1] - spans[0])])
    places = ends / ends[-1]
    named = {f"{name}.start": np.array([0])}
    if not closed:
        named[f"{name}.end"] = np.array([len(places) - 1])
    for key, given in (nodes or {}).items():
        check_name("node", key)
        place = relative_length(key, given)
        if key in named:
            raise MeshError(f"node '{key}'", f"the name is given to an end of beam '{name}'")
        k = abs(places - place).argmin()
        if not abs(places[k] - place) <= 1e-9:
            close = ", ".join(f"{x:.6g}" for x in np.sort(places[max(k - 1, 0) : k + 2]))
            raise MeshError(
                f"node '{key}'",
                f"relative arc length {place} of beam '{name}' meets no vertex; nearby: {close}."
                " Change the number of elements",
            )
        named[key] = np.array([0 if closed and k == len(places) - 1 else k])
    return named


# -- finding nodes, beams and elements by name, number or position ---------------------------------

#: Distance at which a position is said to meet a node, as a part of the mesh size.
POSITION_TOLERANCE = 1e-8


def _listed(names: Mapping[str, Any]) -> str:
    """Names for a message."""
    return ", ".join(f"'{name}'" for name in names) or "none"


def mesh_label(beams: Mapping[str, Any]) -> str:
    """Name of a mesh in messages, by its beams."""
    names = [f"'{name}'" for name in beams]
    if not names:
        return "the mesh"
    more = f", ... ({len(names)} beams)" if len(names) > 4 else ""
    return f"the mesh of beam{'s' * (len(names) > 1)} {', '.join(names[:4])}{more}"


def find_beam(beams: Mapping[str, IndexArray], beam: str) -> IndexArray:
    """Elements of a named beam."""
    if not isinstance(beam, str):
        raise MeshError(f"beam {beam!r}", f"expected a name; known beams: {_listed(beams)}")
    if beam not in beams:
        raise MeshError(f"beam '{beam}'", f"unknown; {names_known(beam, beams, 'known beams')}")
    return beams[beam]


def find_node(mesh: MeshCurve, points: Floats, which: str | int | VectorLike) -> int:
    """Number of the node in ``points`` (n, 3) of a mesh given by name, number or position."""
    if isinstance(which, str):
        names = mesh._boundaries or {}
        if which not in names:
            known = names_known(which, names, "known nodes", "mesh.nodes")
            raise MeshError(f"node '{which}'", f"unknown in {mesh_label(mesh.beams)}; {known}")
        if len(names[which]) != 1:
            raise MeshError(
                f"node '{which}'", f"names {len(names[which])} nodes, expected exactly one"
            )
        return int(names[which][0])
    if is_whole(which):
        if not 0 <= which < len(points):
            raise MeshError(f"node {which}", f"the mesh has nodes 0 .. {len(points) - 1}")
        return int(which)
    try:
        place = numbers(f"node {which!r}", "position", which)
    except InputError:
        place = np.zeros(0)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise MeshError(f"node {which!r}", "expected a name, a number or a position (3,)")
    gaps = np.linalg.norm(points - place, axis=1)
    hits = np.flatnonzero(gaps <= POSITION_TOLERANCE * mesh.size)
    spot = f"node at {place.tolist()}"
    if hits.size == 0:
        k = np.argmin(gaps)
        raise MeshError(spot, f"no node there; node {k} is nearest, {gaps[k]:.3g} m away")
    if hits.size > 1:
        raise MeshError(spot, f"several nodes there: {hits.tolist()}; give the number or a name")
    return int(hits[0])


def places_along(
    mesh: MeshCurve, s: ArrayLike, beam: str | None = None
) -> tuple[IndexArray, Floats]:
    """Elements (m,) and reference coordinates (m,) at arc lengths s (m,) along a beam or all."""
    ids = np.arange(mesh.nelements) if beam is None else mesh.elements_of(beam)
    item = "mesh" if beam is None else f"beam '{beam}'"
    chains = find_chains(mesh.t[:, ids], np.zeros(len(ids), np.int64), [beam or ""]).chains()
    if len(chains) != 1:
        raise MeshError(
            item,
            f"is no single line but {len(chains)}: give the name of one, of"
            f" {_listed(mesh.beams)}, or elements and their reference coordinates",
        )
    ids = ids[chains[0].elements]
    ends = mesh.lengths[ids].cumsum()
    tol = 1e-12 * ends[-1]
    at = np.atleast_1d(numbers(item, "arc length s", s))
    wrong = ~((at >= -tol) & (at <= ends[-1] + tol))
    if at.ndim != 1 or wrong.any():
        what = f"shape {at.shape}" if at.ndim != 1 else f"{at[wrong][0]} m"
        raise MeshError(item, f"arc length s: {what}, expected numbers in 0 .. {ends[-1]:.9g} m")
    k = np.minimum(np.searchsorted(ends, at + tol, side="right"), len(ids) - 1)
    return ids[k], np.clip(1.0 - (ends[k] - at) / mesh.lengths[ids[k]], 0.0, 1.0)


def number_of_times(value: Any, count: int) -> int:
    """Number of refinements of a mesh of so many elements; MeshError for a value without sense."""
    if value < 0:
        raise MeshError("refinement", f"{shown(value)} times, expected 0 or more")
    most = int(np.log2(max(MOST_ELEMENTS / count, 1)))
    if value > most:
        text = f"{shown(value)} times, expected at most {most}: {count} elements become"
        raise MeshError("refinement", f"{text} {MOST_ELEMENTS}, and no mesh may have more")
    return int(value)


def element_numbers(which: Any, count: int) -> IndexArray:
    """Element numbers from numbers or a mask (ne,)."""
    index = np.atleast_1d(np.asarray(which))
    if index.dtype == bool:
        if index.shape != (count,):
            raise MeshError("element mask", f"has shape {index.shape}, expected ({count},)")
        return np.flatnonzero(index)
    check_numbers("element numbers", index, 0, count)
    return index.astype(np.int64)


def element_finder(mesh: MeshCurve) -> Callable[..., Array]:
    """Function of coordinates x, y, z (n,) that returns the element each point lies on."""
    mapping = mesh.mapping()
    middle = mapping.F(np.array([[0.5]]))[:, :, 0]
    reach = 0.5 * mesh.lengths + POSITION_TOLERANCE * mesh.size

    def finder(x: Array, y: Array, z: Array) -> Array:
        found = np.empty(len(x), np.int32)
        for k, place in enumerate(np.stack([x, y, z], 1)):
            near = np.flatnonzero(np.linalg.norm(middle.T - place, axis=1) <= reach)
            at = np.broadcast_to(place[:, None, None], (3, len(near), 1))
            feet = mapping.F(mapping.invF(at, near), near) if near.size else at
            gaps = np.linalg.norm(feet - at, axis=0)[:, 0]
            if near.size == 0 or gaps.min() > POSITION_TOLERANCE * mesh.size:
                raise MeshError(f"point {place.tolist()}", "lies on no element of the mesh")
            found[k] = near[np.argmin(gaps)]
        return found

    return finder
