"""Nodes of a plane, and their blocks."""

from __future__ import annotations

from typing import Any

from ...types import Floats
from .. import simd
from ..blocks import solve_blocks
from ..jit import inlined, part
from ..nodes import carried_on, mass_times, start_increments, sum_balance
from ..numbers import FORCE, MASS, WEIGHT
from ..simd import WIDTH, load, pack, put_rows, rows, store
from ..small import block, chosen, cosines
from ..tables.plane import CHILD, FRAMED
from .complex_numbers import (
    Complex,
    add_scaled,
    arrow,
    crossed,
    inner,
    left,
    plus,
    point,
    product,
    put_complex,
    scaled,
)

__all__ = [
    "balance",
    "begin",
    "finish",
    "move",
    "nodal_mass_matrix",
    "node_matrix",
    "predict_changes",
    "sweep",
]


# -- compiled sweeps of the block elimination in a plane: what turns with the frames ---------------


@inlined
def turn(a: Floats, v: int, y: Floats, z: Floats) -> None:
    """Turn the first two of a_v with the frame: from where it is at y to where at z."""
    put_complex(a, v, 0, product(crossed(arrow(y, v), arrow(z, v)), point(a, v)))


@inlined
def turn_rows(s: Any, x: Floats, y: Floats, z: Floats) -> None:
    """The same of vectors among constraint rows, with a frame that they hold."""
    owner, handed, triple, count = s.row_owner, s.row_handed, s.row_triple, len(s.framed)
    for k in range(len(owner)):
        sense = handed[k]
        if triple[k] == 0 and sense != 0.0:
            a = x[count + k, 0], sense * x[count + k, 1]
            a = product(crossed(arrow(y, owner[k]), arrow(z, owner[k])), a)
            put_complex(x, count + k, 0, (a[0], sense * a[1]))


@part
def sweep(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Solve for minus the residual: own coordinates x, and as twists of the vertices.

    See :func:`skfem_cosserat.compiled.blocks.sweep`: factors that were kept are turned.
    """
    b, x, twist, extra, now, then = w.b, w.x, w.twist, w.extra, w.y1, w.frames
    loose, edges, none = s.loose, s.edges, pack((0.0, 0.0, 0.0, 0.0))
    for v in range(len(x)):
        store(x, v, -1.0 * load(b, v))
    for v in range(len(s.framed)):  # behind them stand impulses of rows
        store(extra, v, none)
    if flag == 1:
        for k in range(len(loose)):
            turn(x, loose[k], now, then)
        turn_rows(s, x, now, then)
    solve_blocks(m, w)
    if flag == 1:
        turn_rows(s, x, then, now)
        for k in range(len(loose)):
            v = loose[k]
            turn(x, v, then, now)
            put_complex(twist, v, 0, point(x, v))
        for e in range(len(edges)):
            if edges[e, FRAMED]:
                turn(twist, edges[e, CHILD], then, now)
    return 0.0


# -- compiled parts of vertices in a plane: configuration, balance, masses -------------------------
#
# Parts take ``(s, m, w, numbers, flag)``; ``s.rows`` is what there is by rows of y in space.


@inlined
def along(axes: Floats, a: Floats, r: int) -> Complex:
    """Row r in the plane."""
    return (
        axes[0, 0] * a[r, 0] + axes[0, 1] * a[r, 1] + axes[0, 2] * a[r, 2],
        axes[1, 0] * a[r, 0] + axes[1, 1] * a[r, 1] + axes[1, 2] * a[r, 2],
    )


@inlined
def gathered(axes: Floats, director: Floats, a: Floats, r: int, v: int) -> Complex:
    """``sum conj(k_i) a_i`` over the directors of vertex v, whose first row is r."""
    z = (0.0, 0.0)
    for i in range(3):
        k = director[v, i, 0], director[v, i, 1]
        z = plus(z, crossed(k, along(axes, a, r + 1 + i)))
    return z


@inlined
def regained(axes: Floats, rest: Floats, a: Floats, r: int, at: int) -> Complex:
    """Row r in the plane as `put_row` has put it into space; its own row is number `at`.

    Axes have length one and are normal to each other to rounding only. That is taken out, for it
    would move all that steps hand on to the next ones, and always the same way.
    """
    z = along(axes, a, r)
    u, v = axes[0], axes[1]
    x0 = a[r, 0] - rest[at, 0] - z[0] * u[0] - z[1] * v[0]
    x1 = a[r, 1] - rest[at, 1] - z[0] * u[1] - z[1] * v[1]
    x2 = a[r, 2] - rest[at, 2] - z[0] * u[2] - z[1] * v[2]
    return (
        z[0] + (u[0] * x0 + u[1] * x1 + u[2] * x2),
        z[1] + (v[0] * x0 + v[1] * x1 + v[2] * x2),
    )


@inlined
def take_frame(o: Any, a: Floats, r: int, v: int, y: Floats, k: int) -> None:
    """Frame k of y from rows in space; e of length one to rounding, whatever it was."""
    axes, rest, director, at = o.axes, o.rest, o.director, o.first[v]
    put_complex(y, k, 0, regained(axes, rest, a, r, at))
    if o.framed[v]:
        e = (0.0, 0.0)
        for i in range(3):
            d = regained(axes, rest, a, r + 1 + i, at + 1 + i)
            e = plus(e, crossed((director[v, i, 0], director[v, i, 1]), d))
        # |k_1|^2 + |k_2|^2 + |k_3|^2 = 2; then one step to the inverse of a square root
        put_complex(y, k, 2, scaled(0.5 * (1.5 - 0.125 * inner(e, e)), e))


@part
def begin(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Start of a step: increments to start with, and what there is in space, in the plane."""
    start_increments(w, flag)
    o = s.rows
    first, axes, director, framed = o.first, o.axes, o.director, o.framed
    y, p, f, moved = w.y0, w.p0, w.external, w.ground1
    y0, p0, external, ground1, internal = o.y0, o.p0, o.external, o.ground1, o.internal
    for r in range(len(internal)):  # beams add to it when the step is solved
        for c in range(3):
            internal[r, c] = 0.0
    for v in range(len(p)):
        r = first[v]
        take_frame(o, y0, r, v, y, v)
        put_complex(p, v, 0, along(axes, p0, r))
        put_complex(f, v, 0, along(axes, external, r))
        if framed[v]:
            put_complex(p, v, 2, gathered(axes, director, p0, r, v))
            put_complex(f, v, 2, gathered(axes, director, external, r, v))
    count = len(p)
    for v in range(count, len(y)):
        take_frame(o, y0, first[v], v, y, v)
        take_frame(o, ground1, first[v] - len(p0), v, moved, v - count)
    return 0.0


@part
def move(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add up the increments x; frames of y_1 of free vertices, and the ground's."""
    y0, y1, ground1, x, total, turn = w.y0, w.y1, w.ground1, w.x, w.total, s.turn
    free, framed, followed, loose = s.free, s.framed, s.followed, s.loose
    nv, count = len(framed), len(loose)
    for v in range(len(x)):
        store(total, v, load(total, v) + load(x, v))
    for g in range(len(ground1)):
        store(y1, nv + g, load(ground1, g))
        put_complex(turn, nv + g, 0, crossed(arrow(y0, nv + g), arrow(ground1, g)))
    for k in range(0, count, WIDTH):
        vs = chosen(loose, block(k, count))
        t, y = rows(total, vs, 4, 0), rows(y0, vs, 4, 0)
        cosine, f = cosines(t[2] * t[2])
        e = product((cosine, f * t[2]), (y[2], y[3]))
        put_rows(y1, vs, 4, 0, (y[0] + t[0], y[1] + t[1], e[0], e[1]))
    for k in range(len(free)):
        v = free[k]
        if not framed[v]:
            put_complex(y1, v, 0, plus(point(y0, v), point(total, v)))
        elif followed[v]:
            put_complex(turn, v, 0, crossed(arrow(y0, v), arrow(y1, v)))
    return 0.0


@inlined
def inertia(s: Any, y1: Floats, y0: Floats, factor: float, out: Floats) -> None:
    """``factor M (y1 - y0)``, M by blocks of four columns."""
    first, vertices, blocks = s.mass_indptr, s.mass_indices, s.mass_blocks
    for v in range(len(out)):
        u = simd.pack((0.0, 0.0, 0.0, 0.0))
        for k in range(first[v], first[v + 1]):
            j = vertices[k]
            for c in range(4):
                u = u + (factor * (y1[j, c] - y0[j, c])) * load(blocks, 4 * k + c)
        store(out, v, u)


@inlined
def twist_force(y: Floats, R: Floats, F: Floats, b: Floats) -> None:
    """``F = b = P_int(y)^T R``."""
    count = len(R)
    for k in range(0, count, WIDTH):
        vs = block(k, count)
        e, f = rows(y, vs, 4, 0), rows(R, vs, 4, 0)
        moment = e[2] * f[3] - e[3] * f[2]
        four = f[0], f[1], moment, simd.pack((0.0, 0.0, 0.0, 0.0))
        put_rows(F, vs, 4, 0, four)
        put_rows(b, vs, 4, 0, four)


@part
def balance(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """R of the step and the forces on vertices; flag 2: gives the largest of its terms.

    Flag 1: R with the predicted stresses, whose internal force stands in its place.
    """
    R, internal, predicted, y = w.R, w.internal, w.R_mixed, w.y0
    if numbers[WEIGHT] != 0.0:
        y = w.mid
    if flag == 1:
        force = numbers[FORCE]
        for v in range(len(R)):
            more = load(predicted, v) - load(internal, v)
            store(predicted, v, load(R, v) + force * more)
        twist_force(y, predicted, w.F_mixed, w.x)
        return 0.0
    inertia(s, w.y1, w.y0, numbers[MASS], w.momentum)
    most = sum_balance(w, numbers, flag == 2)
    if len(s.row_on):
        closing = w.closing
        for v in range(len(R)):
            store(R, v, load(R, v) + load(closing, v))
    twist_force(y, R, w.F, w.b)
    return most


@part
def nodal_mass_matrix(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add masses of single frames and of mass points."""
    A, y1, diag, framed, y = w.A, w.y1, m.diag, s.framed, w.y0
    masses, where, mass = s.frame_masses, s.frame_vertex, numbers[MASS]
    if numbers[WEIGHT] != 0.0:
        y = w.mid
    for k in range(len(where)):
        v = where[k]
        xe = scaled(mass, (masses[k, 1, 0], masses[k, 1, 1]))
        ex = scaled(mass, (masses[k, 2, 0], masses[k, 2, 1]))
        ee = scaled(mass, (masses[k, 3, 0], masses[k, 3, 1]))
        add_scaled(mass * masses[k, 0, 0], xe, ex, ee, arrow(y, v), arrow(y1, v), A, diag[v])
    for v in range(len(s.framed)):
        if not framed[v]:
            A[diag[v], 10] = 1.0
    for k in range(len(s.point_vertex)):
        here = diag[s.point_vertex[k]]
        A[here, 0] += mass * s.point_masses[k]
        A[here, 5] += mass * s.point_masses[k]
    return 0.0


@part
def node_matrix(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add ``weight d(P_int^T R)`` of single nodes; flag 1: of the R with predicted stresses."""
    A, y1, diag, R, weight = w.A, w.y1, m.diag, w.R, numbers[WEIGHT]
    if flag == 1:
        R = w.R_mixed
    for v in range(len(s.framed)):
        A[diag[v], 10] -= weight * inner(arrow(y1, v), arrow(R, v))
    return 0.0


@part
def predict_changes(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """``P_int(y_1) twist``."""
    y, twist, change = w.y1, w.twist, w.change
    for v in range(len(change)):
        put_complex(change, v, 0, point(twist, v))
        put_complex(change, v, 2, scaled(twist[v, 2], left(arrow(y, v))))
    return 0.0


@inlined
def put_row(axes: Floats, rest: Floats, z: Complex, a: Floats, r: int) -> None:
    """Row r in space from what it is in the plane, and along the normal."""
    for c in range(3):
        a[r, c] = rest[r, c] + z[0] * axes[0, c] + z[1] * axes[1, c]


@part
def finish(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Rows of y_1 and of R in space, momentum carried on; gives the work of the loads."""
    o, y = s.rows, w.y1
    first, axes, framed, director, y1, rest = o.first, o.axes, o.framed, o.director, o.y1, o.rest
    for v in range(len(first)):
        r = first[v]
        put_row(axes, rest, point(y, v), y1, r)
        if framed[v]:
            for i in range(3):
                k = director[v, i, 0], director[v, i, 1]
                put_row(axes, rest, product(k, arrow(y, v)), y1, r + 1 + i)
    own = o.mass_indptr, o.mass_indices, o.mass_data
    mass_times(own[0], own[1], own[2], y1, o.y0, numbers[MASS], o.momentum)
    sum_balance(o, numbers, False)
    return carried_on(o, numbers)
