"""Vectors of a plane as complex numbers, each a pair of numbers or lanes."""

from __future__ import annotations

import numpy as np

from ...types import Floats
from ..jit import inlined
from ..small import series

__all__ = ["Pair", "add_scaled", "arrow", "crossed", "inner", "left", "minus", "outer", "over"]
__all__ += ["pair", "plus", "point", "product", "put_pair", "scaled", "spot", "turn_by"]

Pair = tuple[float, float]


@inlined
def pair(a: Floats, k: int, c: int) -> Pair:
    """``a_k``, from column c on."""
    return a[k, c], a[k, c + 1]


@inlined
def put_pair(a: Floats, k: int, c: int, z: Pair) -> None:
    """``a_k = z``, from column c on."""
    a[k, c] = z[0]
    a[k, c + 1] = z[1]


@inlined
def point(y: Floats, v: int) -> Pair:
    """Origin of a frame."""
    return y[v, 0], y[v, 1]


@inlined
def arrow(y: Floats, v: int) -> Pair:
    """Unit vector of a frame."""
    return y[v, 2], y[v, 3]


@inlined
def plus(a: Pair, b: Pair) -> Pair:
    """``a + b``."""
    return a[0] + b[0], a[1] + b[1]


@inlined
def minus(a: Pair, b: Pair) -> Pair:
    """``a - b``."""
    return a[0] - b[0], a[1] - b[1]


@inlined
def scaled(c: float, a: Pair) -> Pair:
    """``c a``."""
    return c * a[0], c * a[1]


@inlined
def left(a: Pair) -> Pair:
    """``i a``: turned to the left by a right angle."""
    return 0.0 - a[1], a[0]


@inlined
def product(a: Pair, b: Pair) -> Pair:
    """``a b``."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


@inlined
def crossed(a: Pair, b: Pair) -> Pair:
    """``conj(a) b``."""
    return a[0] * b[0] + a[1] * b[1], a[0] * b[1] - a[1] * b[0]


@inlined
def inner(a: Pair, b: Pair) -> float:
    """``Re(conj(a) b)``: the scalar product."""
    return a[0] * b[0] + a[1] * b[1]


@inlined
def outer(a: Pair, b: Pair) -> float:
    """``Im(conj(a) b)``: along the normal of the vector product."""
    return a[0] * b[1] - a[1] * b[0]


@inlined
def over(a: Pair, b: Pair) -> Pair:
    """``a / b``."""
    f = 1.0 / (b[0] * b[0] + b[1] * b[1])
    return scaled(f, crossed(b, a))


@inlined
def spot(y: Floats, v: int, offset: Pair) -> Pair:
    """Position of a material point, whose offset is a multiple of e."""
    return plus(point(y, v), product(offset, arrow(y, v)))


@inlined
def turn_by(theta: float) -> Pair:
    """``exp(i theta)``."""
    square = theta * theta
    if square < 0.01:
        w, f = series(square)
        return w, f * theta
    return np.cos(theta), np.sin(theta)


@inlined
def add_scaled(
    xx: float, xe: Pair, ex: Pair, ee: Pair, L: Pair, R: Pair, A: Floats, k: int
) -> None:
    """Add ``P_L^T C P_R`` to block k, C by origins and unit vectors; L, R: e on both sides."""
    column, row = product(xe, left(R)), crossed(ex, left(L))
    A[k, 0] += xx
    A[k, 2] += column[0]
    A[k, 5] += xx
    A[k, 6] += column[1]
    A[k, 8] += row[0]
    A[k, 9] += row[1]
    A[k, 10] += inner(L, product(ee, R))
