"""Vectors, rotations and small matrices for the compiled kernels."""

from __future__ import annotations

import numpy as np

from ..types import Floats
from .jit import jit

__all__ = [
    "clear",
    "compose",
    "copy",
    "cross",
    "dot",
    "increase",
    "put_cross",
    "put_cross_cross",
    "quaternion",
    "rotation",
]


@jit
def dot(a: Floats, b: Floats) -> float:
    """``a . b``."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit
def cross(a: Floats, b: Floats, out: Floats) -> None:
    """``out = a x b``."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@jit
def copy(a: Floats, out: Floats) -> None:
    """``out = a``, two axes."""
    for i in range(a.shape[0]):
        for c in range(a.shape[1]):
            out[i, c] = a[i, c]


@jit
def clear(out: Floats) -> None:
    """``out = 0``, two axes."""
    for i in range(out.shape[0]):
        for c in range(out.shape[1]):
            out[i, c] = 0.0


@jit
def increase(out: Floats, a: Floats) -> None:
    """``out += a``, two axes."""
    for i in range(out.shape[0]):
        for c in range(out.shape[1]):
            out[i, c] += a[i, c]


@jit
def quaternion(theta: Floats, out: Floats) -> None:
    """Unit quaternion (w, x, y, z) of a rotation vector."""
    half2 = 0.25 * dot(theta, theta)
    if half2 < 1e-8:
        out[0] = 1 - half2 / 2 + half2 * half2 / 24
        factor = 0.5 * (1 - half2 / 6 + half2 * half2 / 120)
    else:
        half = np.sqrt(half2)
        out[0] = np.cos(half)
        factor = 0.5 * np.sin(half) / half
    for c in range(3):
        out[1 + c] = factor * theta[c]


@jit
def compose(a: Floats, b: Floats, out: Floats) -> None:
    """Quaternion of the rotation b, then a; normalised. `out` may be one of them."""
    w = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    x = a[0] * b[1] + b[0] * a[1] + a[2] * b[3] - a[3] * b[2]
    y = a[0] * b[2] + b[0] * a[2] + a[3] * b[1] - a[1] * b[3]
    z = a[0] * b[3] + b[0] * a[3] + a[1] * b[2] - a[2] * b[1]
    factor = 1 / np.sqrt(w * w + x * x + y * y + z * z)
    out[0] = factor * w
    out[1] = factor * x
    out[2] = factor * y
    out[3] = factor * z


@jit
def rotation(q: Floats, R: Floats) -> None:
    """Rotation matrix of a unit quaternion; not w^2 - v.v, whose rounding would add up."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    R[0, 0] = 1 - 2 * (y * y + z * z)
    R[1, 1] = 1 - 2 * (x * x + z * z)
    R[2, 2] = 1 - 2 * (x * x + y * y)
    R[0, 1] = 2 * (x * y - w * z)
    R[1, 0] = 2 * (x * y + w * z)
    R[0, 2] = 2 * (x * z + w * y)
    R[2, 0] = 2 * (x * z - w * y)
    R[1, 2] = 2 * (y * z - w * x)
    R[2, 1] = 2 * (y * z + w * x)


@jit
def put_cross(K: Floats, row: int, col: int, sign: float, a: Floats) -> None:
    """Add ``sign a^`` to a block, from (row, col) on."""
    K[row, col + 1] -= sign * a[2]
    K[row, col + 2] += sign * a[1]
    K[row + 1, col] += sign * a[2]
    K[row + 1, col + 2] -= sign * a[0]
    K[row + 2, col] -= sign * a[1]
    K[row + 2, col + 1] += sign * a[0]


@jit
def put_cross_cross(K: Floats, row: int, col: int, sign: float, f: Floats, s: Floats) -> None:
    """Add ``sign f^ s^ = sign (s f^T - (f . s) I)`` to a block, from (row, col) on."""
    fs = dot(f, s)
    for a in range(3):
        for b in range(3):
            K[row + a, col + b] += sign * s[a] * f[b]
        K[row + a, col + a] -= sign * fs
