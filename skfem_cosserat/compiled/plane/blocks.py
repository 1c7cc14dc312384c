"""Compiled sweeps of the block elimination in a plane: what turns with the frames."""

from __future__ import annotations

from typing import Any

from ...types import Floats
from ..blocks import solve_blocks
from ..jit import inlined, part
from ..lanes import load, pack, store
from .pairs import arrow, crossed, point, product, put_pair
from .places import CHILD, FRAMED

__all__ = ["sweep"]


@inlined
def turn(a: Floats, v: int, y: Floats, z: Floats) -> None:
    """Turn the first two of a_v with the frame: from where it is at y to where at z."""
    put_pair(a, v, 0, product(crossed(arrow(y, v), arrow(z, v)), point(a, v)))


@part
def sweep(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Solve for minus the residual: own coordinates x, and as twists of the vertices.

    See :func:`skfem_cosserat.compiled.blocks.sweep`: factors that were kept are turned.
    """
    b, x, twist, extra, now, then = w.b, w.x, w.twist, w.extra, w.y1, w.frames
    loose, edges, none = s.loose, s.edges, pack((0.0, 0.0, 0.0, 0.0))
    for v in range(len(x)):
        store(x, v, -1.0 * load(b, v))
        store(extra, v, none)
    if flag == 1:
        for k in range(len(loose)):
            turn(x, loose[k], now, then)
    solve_blocks(m, w)
    if flag == 1:
        for k in range(len(loose)):
            v = loose[k]
            turn(x, v, then, now)
            put_pair(twist, v, 0, point(x, v))
        for e in range(len(edges)):
            if edges[e, FRAMED]:
                turn(twist, edges[e, CHILD], then, now)
    return 0.0
