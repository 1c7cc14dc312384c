"""Complex coordinates of a plane, and where frames of a plane are in space."""

from __future__ import annotations

import numpy as np

from ...types import Floats
from ..jit import inlined
from ..small import series

__all__ = [
    "Complex",
    "add_scaled",
    "arrow",
    "complex_at",
    "crossed",
    "inner",
    "left",
    "minus",
    "outer",
    "plus",
    "point",
    "product",
    "put_complex",
    "scaled",
    "spot",
    "turn_by",
]


# -- vectors of a plane as complex numbers, each two numbers or SIMD vectors ---------------------

Complex = tuple[float, float]


@inlined
def complex_at(a: Floats, k: int, c: int) -> Complex:
    """``a_k``, from column c on."""
    return a[k, c], a[k, c + 1]


@inlined
def put_complex(a: Floats, k: int, c: int, z: Complex) -> None:
    """``a_k = z``, from column c on."""
    a[k, c] = z[0]
    a[k, c + 1] = z[1]


@inlined
def point(y: Floats, v: int) -> Complex:
    """Origin of a frame."""
    return y[v, 0], y[v, 1]


@inlined
def arrow(y: Floats, v: int) -> Complex:
    """Unit vector of a frame."""
    return y[v, 2], y[v, 3]


@inlined
def plus(a: Complex, b: Complex) -> Complex:
    """``a + b``."""
    return a[0] + b[0], a[1] + b[1]


@inlined
def minus(a: Complex, b: Complex) -> Complex:
    """``a - b``."""
    return a[0] - b[0], a[1] - b[1]


@inlined
def scaled(c: float, a: Complex) -> Complex:
    """``c a``."""
    return c * a[0], c * a[1]


@inlined
def left(a: Complex) -> Complex:
    """``i a``: turned to the left by a right angle."""
    return 0.0 - a[1], a[0]


@inlined
def product(a: Complex, b: Complex) -> Complex:
    """``a b``."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


@inlined
def crossed(a: Complex, b: Complex) -> Complex:
    """``conj(a) b``."""
    return a[0] * b[0] + a[1] * b[1], a[0] * b[1] - a[1] * b[0]


@inlined
def inner(a: Complex, b: Complex) -> float:
    """``Re(conj(a) b)``: the scalar product."""
    return a[0] * b[0] + a[1] * b[1]


@inlined
def outer(a: Complex, b: Complex) -> float:
    """``Im(conj(a) b)``: along the normal of the vector product."""
    return a[0] * b[1] - a[1] * b[0]


@inlined
def spot(y: Floats, v: int, offset: Complex) -> Complex:
    """Position of a material point, whose offset is a multiple of e."""
    return plus(point(y, v), product(offset, arrow(y, v)))


@inlined
def turn_by(theta: float) -> Complex:
    """``exp(i theta)``."""
    square = theta * theta
    if square < 0.01:
        w, f = series(square)
        return w, f * theta
    return np.cos(theta), np.sin(theta)


@inlined
def add_scaled(
    xx: float, xe: Complex, ex: Complex, ee: Complex, L: Complex, R: Complex, A: Floats, k: int
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
