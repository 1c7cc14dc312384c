"""Complex coordinates of a plane, and where frames of a plane are in space."""

from __future__ import annotations

import numpy as np

from ...types import Floats
from ..jit import inlined
from ..small import series

__all__ = [
    "ALONG",
    "ARMS",
    "COORDINATES",
    "EDGES",
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


# -- columns of the tables of a tree in a plane ----------------------------------------------------
#
# Tables, and not an array for each: kernels take what they need at once, see :mod:`..elements`.

#: of an edge: child, parent (-1: ground) and the same with numbers of the ground, frame of slides,
#: point of the child that moves as if fixed to the parent, its first coordinate and the one behind
#: its last; whether the child is a frame, whether it
#: turns with its parent, whether it slides, whether the parent is a frame that moves it
EDGES = (
    *("child", "parent", "parent_at", "guide", "fulcrum", "first", "last"),
    *("framed", "relative", "open", "carried"),
)
CHILD, PARENT, PARENT_AT, GUIDE_AT, FULCRUM, FIRST, LAST = range(7)
FRAMED, RELATIVE, OPEN, CARRIED = range(7, 11)
#: multiples of unit vectors, two numbers each: of the child's and the parent's point, of the
#: fulcrum, from the parent's to the child's point where a step starts (a vector)
ARMS = ("child", "child", "parent", "parent", "fulcrum", "fulcrum", "arm", "arm")
CHILD_SPOT, PARENT_SPOT, FULCRUM_SPOT, ARM = 0, 2, 4, 6
#: of a coordinate: kind, place among its vertex' own (-1: driven), vertices of its frame, of the
#: point that it moves and of the one that it turns about
COORDINATES = ("kind", "own", "guide", "target", "centre")
KIND, OWN, GUIDE, TARGET, CENTRE = range(5)
#: its sign about the normal (one number), direction of a slide, both points, and that direction
#: where a step starts (a vector)
ALONG = (*("sign", "slide", "slide", "target", "target", "centre", "centre", "slide0", "slide0"),)
SIGN, SLIDE, TARGET_SPOT, CENTRE_SPOT, SLIDE0 = 0, 1, 3, 5, 7


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
