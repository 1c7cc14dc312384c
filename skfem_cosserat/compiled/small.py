"""Vectors, rotations and nodes for the compiled kernels.

Vectors are tuples, not arrays: they stay in registers, and compile in a fifth of the time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats, IndexArray
from .jit import inlined
from .numbers import WEIGHT
from .simd import largest, pack, put_rows, rows

Vector = tuple[float, float, float]
Rotation = tuple[Vector, Vector, Vector]
Quaternion = tuple[float, float, float, float]
#: of four elements, vertices or rows
Places = tuple[int, int, int, int]


@inlined
def row(a: Floats, r: int) -> Vector:
    """``a_r``."""
    return a[r, 0], a[r, 1], a[r, 2]


@inlined
def put(a: Floats, r: int, v: Vector) -> None:
    """``a_r = v``."""
    a[r, 0] = v[0]
    a[r, 1] = v[1]
    a[r, 2] = v[2]


@inlined
def increase(a: Floats, r: int, v: Vector) -> None:
    """``a_r += v``."""
    a[r, 0] += v[0]
    a[r, 1] += v[1]
    a[r, 2] += v[2]


@inlined
def dot(a: Vector, b: Vector) -> float:
    """``a . b``."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a: Vector, b: Vector) -> Vector:
    """``a x b``."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def plus(a: Vector, b: Vector) -> Vector:
    """``a + b``."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def minus(a: Vector, b: Vector) -> Vector:
    """``a - b``."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def times(c: float, a: Vector) -> Vector:
    """``c a``."""
    return c * a[0], c * a[1], c * a[2]


@inlined
def rows3(a: Floats, r: int) -> Rotation:
    """Three rows as those of a matrix."""
    return row(a, r), row(a, r + 1), row(a, r + 2)


@inlined
def combination(c: float, a: Floats, d: float, b: Floats, out: Floats) -> None:
    """``out = c a + d b``, of the first rows of both."""
    for r in range(out.shape[0]):
        for i in range(3):
            out[r, i] = c * a[r, i] + d * b[r, i]


@inlined
def mass_times(s: Any, factor: float, a: Floats, out: Floats) -> None:
    """``out = factor M a``, of the first rows of a; the mass matrix is a part of s."""
    first, columns, entries = s.mass_indptr, s.mass_indices, s.mass_data
    for r in range(out.shape[0]):
        u = (0.0, 0.0, 0.0)
        for k in range(first[r], first[r + 1]):
            u = plus(u, times(entries[k], row(a, columns[k])))
        put(out, r, times(factor, u))


@inlined
def pulled(y0: Floats, mid: Floats, numbers: Floats) -> Floats:
    """Configuration at which constraint forces act."""
    if numbers[WEIGHT] != 0.0:
        return mid
    return y0


@inlined
def directors(y: Floats, r: int) -> Rotation:
    """The three directors of the frame whose origin is row r."""
    return rows3(y, r + 1)


@inlined
def combine(c: Vector, d: Rotation) -> Vector:
    """``sum c_i d_i``."""
    return (
        c[0] * d[0][0] + c[1] * d[1][0] + c[2] * d[2][0],
        c[0] * d[0][1] + c[1] * d[1][1] + c[2] * d[2][1],
        c[0] * d[0][2] + c[1] * d[1][2] + c[2] * d[2][2],
    )


@inlined
def column(R: Rotation, k: int) -> Vector:
    """Column k of a matrix by its rows."""
    return R[0][k], R[1][k], R[2][k]


@inlined
def unit(k: int, size: float) -> Vector:
    """``size e_k``."""
    return size if k == 0 else 0.0, size if k == 1 else 0.0, size if k == 2 else 0.0


@inlined
def put_matrix(a: Floats, k: int, R: Rotation) -> None:
    """``a_k = R``."""
    for r in range(3):
        for c in range(3):
            a[k, r, c] = R[r][c]


@inlined
def turned(R: Rotation, a: Vector) -> Vector:
    """``R a``, R by its rows."""
    return dot(R[0], a), dot(R[1], a), dot(R[2], a)


@inlined
def series(square: float) -> tuple[float, float]:
    """``cos a`` and ``sin a / a`` from a small ``a^2``, to rounding below 0.01."""
    w = 1 - square / 2 * (1 - square / 12 * (1 - square / 30 * (1 - square / 56)))
    f = 1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72)))
    return w, f


@inlined
def quaternion(theta: Vector) -> Quaternion:
    """Unit quaternion (w, x, y, z) of a rotation vector."""
    half2 = 0.25 * dot(theta, theta)
    if half2 < 0.01:
        w, f = series(half2)
        f = 0.5 * f
    else:
        half = np.sqrt(half2)
        w = np.cos(half)
        f = 0.5 * np.sin(half) / half
    return w, f * theta[0], f * theta[1], f * theta[2]


@inlined
def cosines(square: float) -> tuple[float, float]:
    """``cos a`` and ``sin a / a`` of SIMD vectors ``a^2`` of any size, by doubling the angle."""
    part = square
    doubled = 0
    while largest(part) >= 0.01 and doubled < 30:
        part = 0.25 * part
        doubled += 1
    w, f = series(part)
    f = f * 0.5**doubled
    for _ in range(doubled):
        w, f = w * w - f * f * square, 2.0 * w * f
    return w, f


@inlined
def quaternions(theta: Vector) -> Quaternion:
    """Unit quaternions (w, x, y, z) of rotation vectors, in SIMD vectors."""
    w, f = cosines(0.25 * dot(theta, theta))
    f = 0.5 * f
    return w, f * theta[0], f * theta[1], f * theta[2]


@inlined
def composed(a: Quaternion, b: Quaternion) -> Quaternion:
    """Product of unit quaternions, normalised."""
    w = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    x = a[0] * b[1] + b[0] * a[1] + a[2] * b[3] - a[3] * b[2]
    y = a[0] * b[2] + b[0] * a[2] + a[3] * b[1] - a[1] * b[3]
    z = a[0] * b[3] + b[0] * a[3] + a[1] * b[2] - a[2] * b[1]
    # both have length one to rounding: one step towards the inverse of a square root
    f = 1.5 - 0.5 * (w * w + x * x + y * y + z * z)
    return f * w, f * x, f * y, f * z


@inlined
def compose(theta: Vector, q: Floats, v: int) -> None:
    """Turn the quaternion ``q_v`` by a rotation vector, and normalise it."""
    p = composed(quaternion(theta), (q[v, 0], q[v, 1], q[v, 2], q[v, 3]))
    for c in range(4):
        q[v, c] = p[c]


@inlined
def rotation(w: float, x: float, y: float, z: float) -> Rotation:
    """Rotation matrix of a unit quaternion; not w^2 - v.v, whose rounding would add up."""
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


@inlined
def rotation_of(q: Floats, v: int) -> Rotation:
    """Rotation matrix of the quaternion ``q_v``."""
    return rotation(q[v, 0], q[v, 1], q[v, 2], q[v, 3])


@inlined
def add_skew(A: Floats, k: int, r: int, c: int, a: Vector) -> None:
    """``A_k += a^``, from (r, c) on."""
    A[k, r, c + 1] -= a[2]
    A[k, r, c + 2] += a[1]
    A[k, r + 1, c] += a[2]
    A[k, r + 1, c + 2] -= a[0]
    A[k, r + 2, c] -= a[1]
    A[k, r + 2, c + 1] += a[0]


@inlined
def block(k: int, count: int) -> Places:
    """Numbers k and the three behind it; the last one instead of those that are not there."""
    last = count - 1
    return k, min(k + 1, last), min(k + 2, last), min(k + 3, last)


@inlined
def counted(k: int, count: int) -> float:
    """Lanes of such a block: 1, but 0 where the last one is taken again."""
    return pack(
        (
            1.0,
            1.0 if k + 1 < count else 0.0,
            1.0 if k + 2 < count else 0.0,
            1.0 if k + 3 < count else 0.0,
        )
    )


@inlined
def chosen(a: IndexArray, places: Places) -> Places:
    """Entries at these places."""
    return a[places[0]], a[places[1]], a[places[2]], a[places[3]]


@inlined
def frames(y: Floats, first: Places) -> tuple[Vector, Rotation]:
    """Origins and directors of four frames, from their first rows on."""
    a, b, c = rows(y, first, 3, 0), rows(y, first, 3, 4), rows(y, first, 3, 8)
    triad = (a[3], b[0], b[1]), (b[2], b[3], c[0]), (c[1], c[2], c[3])
    return (a[0], a[1], a[2]), triad


@inlined
def put_frames(y: Floats, first: Places, x: Vector, D: Rotation) -> None:
    """Store what :func:`frames` loads."""
    put_rows(y, first, 3, 0, (x[0], x[1], x[2], D[0][0]))
    put_rows(y, first, 3, 4, (D[0][1], D[0][2], D[1][0], D[1][1]))
    put_rows(y, first, 3, 8, (D[1][2], D[2][0], D[2][1], D[2][2]))
