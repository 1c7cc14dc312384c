"""Section triads along beams: tangents, first directors, twist."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..errors import InputError, MeshError
from ..types import Array, Floats, VectorLike, names_known, numbers

if TYPE_CHECKING:  # pragma: no cover - for annotations only
    from .mesh import MeshCurve
    from .topology import Chain

#: Hint for d1: one for all beams or by beam name.
Directors: TypeAlias = VectorLike | Mapping[str, VectorLike] | None
#: Twist: rate (rad/m) or angle (rad) as a function of arc length (m), for all or by beam name.
Twist: TypeAlias = float | Callable[[float], float] | Mapping[str, Any] | None

#: Two triads closer than this are one and the same.
SAME = 1e-12
#: Smallest sine between a hint and the tangent.
PARALLEL = 1e-6


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
    ends = np.stack([own, own], axis=1)
    cosine = np.cos(mesh.feature_angle) - 1e-9  # an angle equal to it is smooth too
    for chain in mesh.chains:
        e = chain.elements
        f = np.roll(e, -1)
        if not chain.closed:
            e, f = e[:-1], f[:-1]
        smooth = chord[e] & chord[f] & ((own[e] * own[f]).sum(axis=1) > cosine)
        e, f = e[smooth], f[smooth]
        mean = mesh.lengths[f][:, None] * own[e] + mesh.lengths[e][:, None] * own[f]
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        ends[e, 1] = ends[f, 0] = mean
    x = np.asarray(xi)[None, :, None]
    blend = (1.0 - x) * ends[:, :1] + x * ends[:, 1:]
    blend /= np.linalg.norm(blend, axis=-1, keepdims=True)
    return np.where(chord[:, None, None], blend, exact)


def section_triads(mesh: MeshCurve, xi: Floats, directors: Directors, twist: Twist) -> Floats:
    """Orthonormal triads (ne, n, 3, 3), rows d1, d2, d3, at the nodes xi (n,) of all elements.

    See :meth:`skfem_cosserat.basis.DirectorBasis.triads`.
    """
    tangents = node_tangents(mesh, xi)
    points = np.moveaxis(mesh.mapping().F(np.asarray(xi)[None]), 0, -1)
    points[:, 0], points[:, -1] = mesh.p[:, mesh.t[0]].T, mesh.p[:, mesh.t[1]].T
    hints = _hints(mesh, directors)
    twists = _by_beam(mesh, twist, "twist")
    triads = np.empty((*tangents.shape, 3))
    starts = mesh.arc_starts
    for chain in mesh.chains:
        e = chain.elements
        s = starts[e][:, None] + mesh.lengths[e][:, None] * xi
        d1 = np.empty((len(e), len(xi), 3))
        if np.isnan(hints[e]).any():
            d1 = _transported(points[e], tangents[e], s, chain.closed)
        given = ~np.isnan(hints[e, 0])
        d1[given] = np.broadcast_to(hints[e][given][:, None], d1[given].shape)
        _check_parallel(mesh, chain, hints[e], tangents[e], s)
        triads[e] = _orthonormal(d1, tangents[e])
        for value in {id(v): v for v in (twists[i] for i in e.tolist()) if v is not None}.values():
            rows = np.array([twists[i] is value for i in e.tolist()])
            angles = _angles(value, s[rows], _owner_item("twist", mesh, chain.owner))
            triads[e[rows]] = _turned(triads[e[rows]], angles)
        _unify(triads, chain)
    return triads


def _owner_item(what: str, mesh: MeshCurve, owner: int) -> str:
    """Item of an error about a chain."""
    return f"{what} of beam '{list(mesh.beams)[owner]}'" if owner >= 0 else f"{what} of no beam"


def _by_beam(mesh: MeshCurve, value: Any, what: str) -> list[Any]:
    """Value for each element, from one for all or from a dict by beam name."""
    if not isinstance(value, Mapping):
        return [value] * mesh.nelements
    out: list[Any] = [None] * mesh.nelements
    for name, part in value.items():
        if name not in mesh.beams:
            known = names_known(name, mesh.beams, "known beams")
            raise MeshError(f"{what} of beam '{name}'", f"unknown beam; {known}")
        for e in mesh.elements_of(name).tolist():
            out[e] = part
    return out


def _hints(mesh: MeshCurve, directors: Directors) -> Floats:
    """Checked unit hints (ne, 3), NaN where there is none."""
    out = np.full((mesh.nelements, 3), np.nan)
    named = directors if isinstance(directors, Mapping) else {"": directors}
    by_beam = _by_beam(mesh, directors, "director")
    for name, value in named.items():
        if value is None:
            continue
        item = f"director of beam '{name}'" if name else f"director of beams {list(mesh.beams)}"
        hint = numbers(item, "direction", value)
        if hint.shape != (3,):
            raise InputError(item, f"has shape {hint.shape}, expected three numbers")
        if not np.isfinite(hint).all():
            raise InputError(item, f"{hint.tolist()} is not finite")
        if abs(float(np.linalg.norm(hint)) - 1.0) > 1e-8:
            size = float(np.linalg.norm(hint))
            raise InputError(item, f"{hint.tolist()} has length {size:.9g}, expected a unit vector")
        rows = [e for e, v in enumerate(by_beam) if v is value]
        out[rows] = hint
    return out


def _check_parallel(
    mesh: MeshCurve, chain: Chain, hints: Floats, tangents: Floats, s: Floats
) -> None:
    """Refuse hints (m, 3) that are parallel to a tangent (m, n, 3)."""
    sine = np.linalg.norm(np.cross(hints[:, None], tangents), axis=-1)
    if (sine < PARALLEL).any():  # NaN where there is no hint
        k, a = np.unravel_index(int(np.argmax(sine < PARALLEL)), sine.shape)
        raise MeshError(
            _owner_item("director", mesh, chain.owner),
            f"{hints[k].tolist()} is parallel to the tangent of element {chain.elements[k]} at"
            f" arc length {s[k, a]:.6g} m: give another direction",
        )


def _orthonormal(d1: Array, tangent: Array) -> Floats:
    """Triads (..., 3, 3) of unit tangents d3 (..., 3) and directions d1 (..., 3)."""
    d3 = tangent / np.linalg.norm(tangent, axis=-1, keepdims=True)
    for _ in range(2):
        d1 = d1 - (d1 * d3).sum(axis=-1, keepdims=True) * d3
        d1 = d1 / np.linalg.norm(d1, axis=-1, keepdims=True)
    d2 = np.cross(d3, d1)
    return np.stack([d1, d2 / np.linalg.norm(d2, axis=-1, keepdims=True), d3], axis=-2)


def _angles(twist: Any, s: Floats, item: str) -> Floats:
    """Angles (m, n) in rad at arc lengths s (m, n)."""
    if callable(twist):
        angles = numbers(item, "twist", [[twist(x) for x in row] for row in s.tolist()])
    elif np.ndim(twist) == 0 and not isinstance(twist, str):
        angles = float(twist) * s
    else:
        raise InputError(item, f"{twist!r} is neither a rate nor a function of arc length")
    if not np.isfinite(angles).all():
        where = s[~np.isfinite(angles)][0]
        raise InputError(item, f"{twist!r} is not finite at arc length {where:.6g} m")
    return angles


def _turned(triads: Floats, angle: Floats) -> Floats:
    """Triads (..., 3, 3) turned about their own d3 by angles (...)."""
    c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
    d1, d2, d3 = (triads[..., i, :] for i in range(3))
    return _orthonormal(c * d1 + s * d2, d3)


def _unify(triads: Floats, chain: Chain) -> None:
    """Give neighbours on a chain the very same triad where theirs agree to round-off."""
    e = chain.elements
    for before, after in zip(e, np.roll(e, -1), strict=True):
        if after == e[0] and not chain.closed:
            break
        if np.abs(triads[before, -1] - triads[after, 0]).max() <= SAME:
            triads[after, 0] = triads[before, -1]


# -------------------------------------------------------------------- transport
def _first_normal(tangent: Floats) -> Floats:
    """Coordinate axis farthest from the tangent (x before y before z), made normal to it."""
    axis = np.zeros(3)
    axis[int(np.argmin(np.abs(tangent).round(12)))] = 1.0
    normal = axis - (axis @ tangent) * tangent
    return normal / np.linalg.norm(normal)


def _minimal(vector: Floats, before: Floats, after: Floats) -> Floats:
    """Vector turned by the smallest rotation that takes one unit tangent to another."""
    cosine = float(before @ after)
    if cosine <= -1.0 + 1e-12:  # a fold: any normal axis will do, take the vector's own
        return vector
    sum_ = before + after
    return vector - (vector @ sum_) / (1.0 + cosine) * sum_ + 2.0 * (vector @ before) * after


def _reflected(d1: Floats, step: Floats, before: Floats, after: Floats) -> Floats:
    """Rotation-minimising transport over one step by double reflection.

    Wang, Juettler, Zheng & Liu, ACM Trans. Graph. 27 (2008) 2:1.
    """
    c1 = step @ step
    if c1 == 0.0:
        return _minimal(d1, before, after)
    half = d1 - 2.0 / c1 * (step @ d1) * step
    tangent = before - 2.0 / c1 * (step @ before) * step
    v = after - tangent
    c2 = v @ v
    return half if c2 == 0.0 else half - 2.0 / c2 * (v @ half) * v


def _transported(points: Floats, tangents: Floats, s: Floats, closed: bool) -> Floats:
    """Rotation-minimising d1 (m, n, 3) along a chain of m elements with n nodes each.

    On a closed chain the angle by which the transport fails to close is spread over its length.
    """
    m, n = s.shape
    d1 = np.empty((m, n, 3))
    here, t = _first_normal(tangents[0, 0]), tangents[0, 0]
    for k in range(m):
        here = _minimal(here, t, tangents[k, 0])
        for a in range(n):
            if a:
                step = points[k, a] - points[k, a - 1]
                here = _reflected(here, step, tangents[k, a - 1], tangents[k, a])
            t = tangents[k, a]
            here = here - (here @ t) * t
            here = here / np.linalg.norm(here)
            d1[k, a] = here
    if closed:
        end = _minimal(here, t, tangents[0, 0])
        miss = np.arctan2(np.cross(end, d1[0, 0]) @ tangents[0, 0], end @ d1[0, 0])
        if abs(miss) > 1e-13:
            angle = (miss * s / s[-1, -1])[..., None]
            d1 = np.cos(angle) * d1 + np.sin(angle) * np.cross(tangents, d1)
    return d1
