"""Section triads along beams, and checks of what elements can follow of the line they lie on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..element import Interpolation
from ..errors import InputError, MeshError, ModelWarning
from ..types import SAME, Array, Floats, IndexArray, VectorLike, names_known, numbers, shaped
from ..warn import warn

if TYPE_CHECKING:
    from .mesh import MeshCurve


#: Hint for d1: one for all beams or by beam name.
Directors: TypeAlias = VectorLike | Mapping[str, VectorLike] | None
#: Twist: rate (rad/m) or angle (rad) as a function of arc length (m), for all or by beam name.
Twist: TypeAlias = float | Callable[[float], float] | Mapping[str, Any] | None


def node_tangents(mesh: MeshCurve, xi: Floats) -> Floats:
    """Unit tangents (ne, n, 3) at reference coordinates xi (n,) of all elements.

    On curves they are exact. Chords that meet below the mesh's feature angle within one beam
    share a tangent there (weighted by the lengths, so that it is exact to second order) and
    interpolate between their two ends.
    """
    exact = np.moveaxis(mesh.mapping().tangent(np.asarray(xi)[None]), 0, -1)
    chord = mesh.curve_ids < 0
    if not chord.any():
        return exact
    own = exact[:, 0]
    ends = np.stack([own, own], 1)
    cosine = np.cos(mesh.feature_angle) - 1e-9  # an angle equal to it is smooth too
    e = mesh.chain_order.before
    f = mesh.chain_order.after
    smooth = chord[e] & chord[f] & ((own[e] * own[f]).sum(1) > cosine)
    e = e[smooth]
    f = f[smooth]
    mean = mesh.lengths[f][:, None] * own[e] + mesh.lengths[e][:, None] * own[f]
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    ends[e, 1] = ends[f, 0] = mean
    x = np.asarray(xi)[None, :, None]
    blend = (1.0 - x) * ends[:, :1] + x * ends[:, 1:]
    blend /= np.linalg.norm(blend, axis=-1, keepdims=True)
    return np.where(chord[:, None, None], blend, exact)


def section_triads(
    mesh: MeshCurve, xi: Floats, points: Floats, directors: Directors, twist: Twist
) -> Floats:
    """Orthonormal triads (ne, n, 3, 3), rows d1, d2, d3, at the nodes xi (n,) of all elements.

    The nodes are at `points` (ne, n, 3). See
    :meth:`skfem_cosserat.basis.DirectorBasis.triads`.
    """
    tangents = node_tangents(mesh, xi)
    hints = _hints(mesh, directors)
    given = ~np.isnan(hints[:, 0])
    d1 = np.empty(tangents.shape)
    d1[given] = hints[given, None]
    along = mesh.lengths[:, None] * xi
    if not given.all():
        for e, closed in mesh.chain_order.side_by_side():
            if (todo := ~given[e].all(1)).any():
                moved = _transported(points, tangents, along, e[todo], closed[todo])
                own = e[todo].ravel()
                d1[own] = np.where(given[own, None, None], d1[own], moved)
    sine = np.linalg.norm(np.cross(hints[:, None], tangents), axis=-1)
    parallel = sine < 1e-6  # NaN where there is no hint
    if parallel.any():
        order = mesh.chain_order.elements
        k = int(order[np.argmax(parallel[order].any(1))])
        a = np.argmax(parallel[k])
        raise MeshError(
            _owner_item("director", mesh, mesh.owners[k]),
            f"{hints[k].tolist()} is parallel to the tangent of element {k} at"
            f" arc length {mesh.arc_starts[k] + along[k, a]:.6g} m: give another direction",
        )
    triads = _orthonormal(d1, tangents)
    for value, e in _by_beam(mesh, twist, "twist"):
        if value is not None:
            angles = _angles(mesh, value, e, mesh.arc_starts[e, None] + along[e])
            triads[e] = _turned(triads[e], angles)
    # neighbours on a chain have the very same triad where theirs agree to round-off
    before = mesh.chain_order.before
    after = mesh.chain_order.after
    same = abs(triads[before, -1] - triads[after, 0]).max((1, 2)) <= SAME
    triads[after[same], 0] = triads[before[same], -1]
    return triads


def _owner_item(what: str, mesh: MeshCurve, owner: int) -> str:
    """Item of an error about a chain."""
    return f"{what} of beam '{list(mesh.beams)[owner]}'" if owner >= 0 else f"{what} of no beam"


def _by_beam(mesh: MeshCurve, value: Any, what: str) -> Iterator[tuple[Any, IndexArray]]:
    """Each value with its elements, from one for all or from a dict by beam name."""
    if not isinstance(value, Mapping):
        yield value, np.arange(mesh.nelements)
        return
    number = np.full(mesh.nelements, -1)
    beams = mesh.beams
    for k, name in enumerate(value):
        if name not in beams:
            known = names_known(name, beams, "known beams")
            raise MeshError(f"{what} of beam '{name}'", f"unknown beam; {known}")
        number[beams[name]] = k
    order = number.argsort(kind="stable")
    cuts = np.searchsorted(number[order], np.arange(len(value) + 1))
    for k, part in enumerate(value.values()):
        yield part, order[cuts[k] : cuts[k + 1]]


def _hints(mesh: MeshCurve, directors: Directors) -> Floats:
    """Checked unit hints (ne, 3), NaN where there is none."""
    out = np.full((mesh.nelements, 3), np.nan)
    names = list(directors) if isinstance(directors, Mapping) else [""]
    for name, (value, rows) in zip(names, _by_beam(mesh, directors, "director"), strict=True):
        if value is None:
            continue
        item = f"director of beam '{name}'" if name else f"director of beams {list(mesh.beams)}"
        hint = shaped(item, "direction", value, (3,))
        size = float(np.linalg.norm(hint))
        if abs(size - 1.0) > 1e-8:
            raise InputError(item, f"{hint.tolist()} has length {size:.9g}, expected a unit vector")
        out[rows] = hint
    return out


def _orthonormal(d1: Array, tangent: Array) -> Floats:
    """Triads (..., 3, 3) of unit tangents d3 (..., 3) and directions d1 (..., 3)."""
    d3 = tangent / np.linalg.norm(tangent, axis=-1, keepdims=True)
    for _ in range(2):
        d1 = d1 - (d1 * d3).sum(axis=-1, keepdims=True) * d3
        d1 = d1 / np.linalg.norm(d1, axis=-1, keepdims=True)
    d2 = np.cross(d3, d1)
    return np.stack([d1, d2 / np.linalg.norm(d2, axis=-1, keepdims=True), d3], -2)


def _angles(mesh: MeshCurve, twist: Any, e: IndexArray, s: Floats) -> Floats:
    """Angles (m, n) in rad at arc lengths s (m, n) of elements e (m,)."""

    def item(row: int) -> str:
        return _owner_item("twist", mesh, mesh.owners[e[row]])

    if callable(twist):
        angles = numbers(item(0), "twist", [[twist(x) for x in row] for row in s.tolist()])
    elif np.ndim(twist) == 0 and not isinstance(twist, str):
        angles = float(twist) * s
    else:
        raise InputError(item(0), f"{twist!r} is neither a rate nor a function of arc length")
    if not np.isfinite(angles).all():
        row, a = map(int, np.argwhere(~np.isfinite(angles))[0])
        raise InputError(item(row), f"{twist!r} is not finite at arc length {s[row, a]:.6g} m")
    return angles


def _turned(triads: Floats, angle: Floats) -> Floats:
    """Triads (..., 3, 3) turned about their own d3 by angles (...)."""
    c = np.cos(angle)[..., None]
    s = np.sin(angle)[..., None]
    d1, d2, d3 = (triads[..., i, :] for i in range(3))
    return _orthonormal(c * d1 + s * d2, d3)


# -------------------------------------------------------------------- transport
def _minimal(vector: Floats, before: Floats, after: Floats) -> Floats:
    """Vectors turned by the smallest rotations that take unit tangents to others, all (..., 3)."""
    cosine = (before * after).sum(-1, keepdims=True)
    fold = cosine <= -1.0 + 1e-12  # any normal axis will do, take the vector's own
    along = (vector * (before + after)).sum(-1, keepdims=True) / np.where(fold, 1.0, 1.0 + cosine)
    turned = vector - along * (before + after)
    turned += 2.0 * (vector * before).sum(-1, keepdims=True) * after
    return np.where(fold, vector, turned)


def _reflected(vector: Floats, step: Floats, before: Floats, after: Floats) -> Floats:
    """Rotation-minimising transport over steps by double reflection, all (..., 3).

    Wang, Juettler, Zheng & Liu, ACM Trans. Graph. 27 (2008) 2:1.
    """

    def mirrored(x: Floats, normal: Floats) -> Floats:
        square = (normal * normal).sum(-1, keepdims=True)
        part = (normal * x).sum(-1, keepdims=True) / np.where(square == 0, 1.0, square)
        return x - 2.0 * part * normal

    return mirrored(mirrored(vector, step), after - mirrored(before, step))


def _transported(
    points: Floats, tangents: Floats, along: Floats, elements: IndexArray, closed: Array
) -> Floats:
    """Rotation-minimising d1 (c * m, n, 3) along chains of elements (c, m), all of one length.

    Every node has a normal of its own; what is summed up along a chain is the angle between it
    and the transported one. On a closed chain the angle by which the transport fails to close is
    spread over its length.
    """
    chains, m = elements.shape
    n = along.shape[1]
    t = tangents[elements].reshape(chains, m * n, 3)
    # the coordinate axes farthest from the tangents, x before y before z, normal to them
    axis = np.eye(3)[abs(t).round(12).argmin(-1)]
    normal = axis - (axis * t).sum(-1, keepdims=True) * t
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    if (t == t[:, :1]).all():  # straight lines
        return normal.reshape(chains * m, n, 3)
    x = points[elements].reshape(t.shape)

    def angles(which: slice | IndexArray, to: slice | IndexArray, inside: bool) -> Floats:
        """By which transport from nodes to others turns their normals."""
        v, before, after = normal[:, which], t[:, which], t[:, to]
        step = x[:, to] - x[:, which]
        v = _reflected(v, step, before, after) if inside else _minimal(v, before, after)
        side = np.cross(after, normal[:, to])
        turned = np.arctan2((v * side).sum(-1), (v * normal[:, to]).sum(-1))
        return np.where((before == after).all(-1), 0.0, turned)

    total = np.zeros((chains, m * n))
    node = np.arange(m * n - 1)
    inner = node[node % n != n - 1]
    total[:, inner + 1] = angles(inner, inner + 1, inside=True)
    if m > 1:
        last = node[node % n == n - 1]
        total[:, last + 1] = angles(last, last + 1, inside=False)
    total = total.cumsum(1)
    if closed.any():
        gap = total[:, -1:] + angles(np.array([m * n - 1]), np.array([0]), inside=False)
        miss = -np.arctan2(np.sin(gap), np.cos(gap))
        ends = np.cumsum(along[elements, -1], 1)
        s = along[elements] + (ends - along[elements, -1])[..., None]
        share = s.reshape(chains, m * n) / ends[:, -1:]
        total += np.where(closed[:, None] & (abs(miss) > 1e-13), miss * share, 0.0)
    c = np.cos(total)[..., None]
    s = np.sin(total)[..., None]
    return (c * normal + s * np.cross(t, normal)).reshape(chains * m, n, 3)


def turns(before: Floats, after: Floats) -> Floats:
    """Angles (...) in rad of the rotations between triads (..., 3, 3), 0 to pi.

    Exact also at small angles: ``|A - B|^2 = 8 sin^2(t/2)``.
    """
    return 2 * np.arcsin(np.sqrt(((after - before) ** 2).sum(axis=(-2, -1)) / 8).clip(0, 1))


def _twists(before: Floats, after: Floats) -> Floats:
    """Angles (...) of their part about d3, on top of the smallest rotation between the two d3."""
    R = after @ before.swapaxes(-1, -2)
    return np.arctan2(R[..., 1, 0] - R[..., 0, 1], R[..., 0, 0] + R[..., 1, 1])


def gives_way(kind: Interpolation, angle: Floats) -> str:
    """End of a message about elements that turn by the angles (k,) in rad: the largest, the limit.

    See :attr:`skfem_cosserat.element.Interpolation.turn_limit`.
    """
    limit = np.degrees(kind.turn_limit)
    others = int((angle > kind.turn_limit + 1e-8).sum()) - 1
    more = f" ({others} more like it)" if others else ""
    return (
        f"{np.degrees(angle.max()):.3g} degrees, beyond the {limit:.3g} that an element of order"
        f" {kind.order} can be bent by{more}: refine"
    )


def check_bends(
    mesh: MeshCurve,
    kind: Interpolation,
    nodes: IndexArray,
    places: Floats,
    triads: Floats,
    item: str,
) -> None:
    """Directors that flip, lines that fold back and elements that turn too far.

    Parameters
    ----------
    mesh : MeshCurve
    kind : Interpolation
    nodes : (ne, p + 1) int array
        Nodes of each element.
    places : (ne, p + 1, 3) array
        Where they are (m).
    triads : (ne, p + 1, 3, 3) array
        Section triads there.
    item : str
        Name of the beam in messages.

    Raises
    ------
    MeshError
        If neighbouring nodes of an element differ by 90 degrees or more, or its line turns
        against its sections inside.

    Notes
    -----
    An element that turns by more than :attr:`Interpolation.turn_limit` between its ends, and
    triads that flip about the tangent at a corner, are reported by a warning.
    """
    angle = turns(triads[:, :-1], triads[:, 1:]).round(9)  # of equal ones the first is named
    # at a quarter turn nothing is left of the stiffness of a linear element
    if angle.max() >= round(np.pi / 2, 9):
        e, a = np.unravel_index(angle.argmax(), angle.shape)
        twist = abs(float(_twists(triads[e, a], triads[e, a + 1])))
        where = f"between the nodes {nodes[e, a]} and {nodes[e, a + 1]} of element {e}"
        if twist > angle[e, a] / 2:
            raise MeshError(
                item,
                f"section triads turn by {np.degrees(twist):.3g} degrees about the tangent"
                f" {where}, expected less than 90: the given director is almost parallel to the"
                " line there, or the twist too fast for the mesh; change them or refine",
            )
        raise MeshError(
            item,
            f"the line turns by {np.degrees(angle[e, a]):.3g} degrees {where}, expected less than"
            " 90: refine",
        )
    _check_folds(mesh, kind, nodes, places, triads, item)
    total = angle.sum(1).round(8)
    if total.max() > round(kind.turn_limit, 8):
        e = total.argmax()
        warn(
            item,
            f"element {e} turns between its ends, the nodes {nodes[e, 0]} and {nodes[e, -1]}, by"
            f" {gives_way(kind, total)}",
            ModelWarning,
        )
    # a first director may turn by more than 90 degrees about the line at a corner
    order = mesh.chain_order
    before = order.before
    after = order.after
    about = abs(_twists(triads[before, -1], triads[after, 0]))
    flips = about > np.pi / 2 + 1e-9
    if not flips.any():
        return
    number = np.empty(mesh.nelements, np.int64)  # of the chain
    number[order.elements] = np.arange(len(order.closed)).repeat(np.diff(order.first))
    for chain in np.unique(number[before[flips]]).tolist():
        own = np.flatnonzero(number[before] == chain)
        k = int(own[about[own].argmax()])
        warn(
            item,
            f"section triads turn by {np.degrees(about[k]):.3g} degrees about the line at node"
            f" {nodes[before[k], -1]}, between the elements {before[k]} and {after[k]}: forces and"
            " moments change their signs there; give another director",
            ModelWarning,
        )


def _check_folds(
    mesh: MeshCurve,
    kind: Interpolation,
    nodes: IndexArray,
    places: Floats,
    triads: Floats,
    item: str,
) -> None:
    """The line, and the interpolated one, run along the interpolated d3 everywhere."""
    xi = kind.dense.points
    at = kind.dense
    exact = mesh.mapping().tangent(xi[None])
    slope = np.einsum("ag,eac->ceg", at.slopes, places)
    d3 = np.einsum("ag,eac->ceg", at.values, triads[:, :, 2])
    cosine = np.minimum((exact * d3).sum(0), (slope * d3).sum(0))
    if cosine.min() <= 0:
        e, g = np.unravel_index(cosine.argmin(), cosine.shape)
        raise MeshError(
            item,
            f"the line folds back inside element {e}, between the nodes {nodes[e, 0]} and"
            f" {nodes[e, -1]}: {xi[g] * mesh.lengths[e]:.3g} m from its start it runs against the"
            " tangents interpolated between its nodes; refine",
        )
