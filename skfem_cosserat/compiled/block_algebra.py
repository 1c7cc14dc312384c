"""Blocks of six by six, or three by three, in vector registers for compiled kernels.

LLVM's own vectorising leaves loops over six numbers to single ones, or unrolls them into code that
does not fit into the processor's caches for instructions. Arrays of blocks are contiguous, blocks
are named by their numbers in them: arrays (n, 6, 6) hold those of six by six, one register for each
row, arrays (n, 12) those of three by three, whose rows end with a zero.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

__all__ = ["GROWTH", "Shape", "add_block", "add_crossed", "add_times", "entry", "put_crossed"]
__all__ += ["put_entry", "put_times", "put_turned", "shape_of", "subtract_crossed", "transpose"]
__all__ += ["triangles"]

#: how much entries of the diagonal may grow while a block is factorised without exchanging rows.
#: Those of positive definite ones do not grow; rows and columns may have any units
GROWTH = 10.0
_INDEX, _LANE = ir.IntType(64), ir.IntType(32)
_FUSED = ("contract",)


class Shape(NamedTuple):
    """Rows of a block, and how many numbers each takes."""

    side: int
    width: int

    @property
    def row(self) -> Any:
        """Type of a row."""
        return ir.VectorType(ir.DoubleType(), self.width)


def shape_of(kind: Any) -> Shape:
    """Of the blocks in an array of this type."""
    assert kind.layout == "C", kind
    return Shape(6, 6) if kind.ndim == 3 else Shape(3, 4)


def _places(builder: Any, context: Any, kind: Any, array: Any, number: Any) -> Any:
    """Address of the first entry of a block."""
    size = shape_of(kind).side * shape_of(kind).width
    data = context.make_array(kind)(context, builder, array).data
    return builder.gep(data, [builder.mul(number, ir.Constant(_INDEX, size))])


def _row(builder: Any, shape: Shape, block: Any, r: int) -> Any:
    """Address of a row."""
    place = builder.gep(block, [ir.Constant(_INDEX, shape.width * r)])
    return builder.bitcast(place, shape.row.as_pointer())


def _load(builder: Any, shape: Shape, block: Any) -> list[Any]:
    """All rows."""
    return [builder.load(_row(builder, shape, block, r), align=8) for r in range(shape.side)]


def _store(builder: Any, shape: Shape, rows: list[Any], block: Any) -> None:
    for r, row in enumerate(rows):
        builder.store(row, _row(builder, shape, block, r), align=8)


def _mixed(builder: Any, a: Any, b: Any, which: list[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_LANE, len(which)), which))


def _spread(builder: Any, shape: Shape, number: Any) -> Any:
    """The same number in a whole row."""
    undefined = ir.Constant(shape.row, ir.Undefined)
    one = builder.insert_element(undefined, number, ir.Constant(_LANE, 0))
    return _mixed(builder, one, undefined, [0] * shape.width)


def _turned(builder: Any, rows: list[Any]) -> list[Any]:
    """Columns of the block of these rows."""
    if len(rows) == 3:
        a, b, c = rows
        low, high = _mixed(builder, a, b, [0, 4, 1, 5]), _mixed(builder, a, b, [2, 6, 2, 6])
        first, second = _mixed(builder, low, c, [0, 1, 4, 7]), _mixed(builder, low, c, [2, 3, 5, 7])
        return [first, second, _mixed(builder, high, c, [0, 1, 6, 7])]
    pairs = [(rows[k], rows[k + 1]) for k in (0, 2, 4)]
    even = [_mixed(builder, a, b, [0, 6, 2, 8, 4, 10]) for a, b in pairs]
    odd = [_mixed(builder, a, b, [1, 7, 3, 9, 5, 11]) for a, b in pairs]
    out = []
    for k in (0, 2, 4):
        for a, b, c in (even, odd):
            four = _mixed(builder, a, b, [k, k + 1, 6 + k, 7 + k, 0, 0])
            out.append(_mixed(builder, four, c, [0, 1, 2, 3, 6 + k, 7 + k]))
    return out


def _multiply(sign: int, crossed: bool, turned: bool = False) -> Any:
    """``out_k = A_i B_j`` or, with a sign, ``out_k += sign A_i B_j``.

    crossed, turned: A, B transposed. All is read before anything is written.
    """

    def typed(typing: Any, A: Any, i: Any, B: Any, j: Any, out: Any, k: Any) -> Any:
        def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
            left, right, target = (
                _places(builder, context, kind.args[n], values[n], values[n + 1]) for n in (0, 2, 4)
            )
            shape = shape_of(kind.args[0])
            side, width = shape
            rows = _load(builder, shape, right)
            if turned:
                rows = _turned(builder, rows)
            sums: list[Any] = _load(builder, shape, target) if sign else [None] * side
            for r in range(side):
                for t, row in enumerate(rows):
                    place = ir.Constant(_INDEX, width * t + r if crossed else width * r + t)
                    factor = _spread(builder, shape, builder.load(builder.gep(left, [place])))
                    term = builder.fmul(factor, row, flags=_FUSED)
                    combine = builder.fsub if sign < 0 else builder.fadd
                    last = sums[r]
                    sums[r] = term if last is None else combine(last, term, flags=_FUSED)
            _store(builder, shape, sums, target)
            return context.get_dummy_value()

        n = types.int64
        return types.none(A, n, B, n, out, n), generate

    return typed


@intrinsic
def put_times(typing: Any, A: Any, i: Any, B: Any, j: Any, out: Any, k: Any) -> Any:
    """``out_k = A_i B_j``, which may be in the place of one of them, as below."""
    return _multiply(0, False)(typing, A, i, B, j, out, k)


@intrinsic
def put_turned(typing: Any, A: Any, i: Any, B: Any, j: Any, out: Any, k: Any) -> Any:
    """``out_k = A_i B_j^T``."""
    return _multiply(0, False, True)(typing, A, i, B, j, out, k)


@intrinsic
def put_crossed(typing: Any, A: Any, i: Any, B: Any, j: Any, out: Any, k: Any) -> Any:
    """``out_k = A_i^T B_j``."""
    return _multiply(0, True)(typing, A, i, B, j, out, k)


@intrinsic
def add_times(typing: Any, A: Any, i: Any, B: Any, j: Any, out: Any, k: Any) -> Any:
    """``out_k += A_i B_j``."""
    return _multiply(1, False)(typing, A, i, B, j, out, k)


@intrinsic
def add_crossed(typing: Any, A: Any, i: Any, B: Any, j: Any, out: Any, k: Any) -> Any:
    """``out_k += A_i^T B_j``."""
    return _multiply(1, True)(typing, A, i, B, j, out, k)


@intrinsic
def subtract_crossed(typing: Any, A: Any, i: Any, B: Any, j: Any, out: Any, k: Any) -> Any:
    """``out_k -= A_i^T B_j``."""
    return _multiply(-1, True)(typing, A, i, B, j, out, k)


def _clear(builder: Any, shape: Shape, rows: list[Any], n: int, own: Any, others: range) -> None:
    """Clear column n of others by row n: `own` is that row, with what takes the column's place."""
    zero = ir.Constant(shape.row, [0.0] * shape.width)
    for i in others:
        factor = _mixed(builder, rows[i], zero, [n] * shape.width)
        left = [shape.width + c if c == n else c for c in range(shape.width)]
        term = builder.fmul(factor, own, flags=_FUSED)
        rows[i] = builder.fsub(_mixed(builder, rows[i], zero, left), term, flags=_FUSED)


def _eliminate(builder: Any, shape: Shape, rows: list[Any], n: int) -> Any:
    """A step of Gauss in place, without exchange of rows; gives the pivot."""
    one, lane = ir.Constant(ir.DoubleType(), 1.0), ir.Constant(_LANE, n)
    pivot = builder.extract_element(rows[n], lane)
    inverse = _spread(builder, shape, builder.fdiv(one, pivot))
    rows[n] = builder.fmul(builder.insert_element(rows[n], one, lane), inverse)
    _clear(builder, shape, rows, n, rows[n], range(n + 1, shape.side))
    return pivot


def _upper(builder: Any, shape: Shape, rows: list[Any]) -> list[Any]:
    """Inverse of the upper triangle that elimination leaves, with ones on its diagonal."""
    width = shape.width
    out: list[Any] = []
    for n in reversed(range(shape.side)):
        unit = ir.Constant(shape.row, [float(c == n) for c in range(width)])
        out.insert(0, _mixed(builder, rows[n], unit, [c + width * (c <= n) for c in range(width)]))
        _clear(builder, shape, rows, n, out[0], range(n))
    return out


@intrinsic
def triangles(typing: Any, A: Any, k: Any, lower: Any, upper: Any, v: Any) -> Any:
    """Inverses of a block's triangular factors, ``A_k^-T = lower_v upper_v``.

    Products with one after the other lose no more to rounding than triangular solutions do. Those
    with the inverse lose the more the nearer the block is to a singular one. No rows are exchanged:
    it tells whether that was stable, so whether no entry of the diagonal grew more than
    :data:`GROWTH` times. It was not if there are NaN.
    """

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        shape = shape_of(kind.args[0])
        side, width = shape
        block = _places(builder, context, kind.args[0], values[0], values[1])
        rows = _load(builder, shape, block)
        absolute = builder.module.declare_intrinsic(
            f"llvm.fabs.v{width}f64", fnty=ir.FunctionType(shape.row, [shape.row])
        )

        def diagonal(base: Any, first: int) -> Any:
            for i in range(first, side):
                which = [width + c if c == i else c for c in range(width)]
                base = _mixed(builder, base, rows[i], which)
            return builder.call(absolute, [base])

        start = diagonal(rows[0], 1)
        last = largest = start
        pivot = None
        for n in range(side):
            pivot = _eliminate(builder, shape, rows, n)
            if n < side - 1:
                last = diagonal(last, n + 1)
                more = builder.fcmp_ordered(">", largest, last)
                largest = builder.select(more, largest, last)  # NaN if that is NaN
        allowed = builder.fmul(start, ir.Constant(shape.row, [GROWTH] * width))
        within = builder.fcmp_ordered("<=", largest, allowed)
        small = builder.bitcast(within, ir.IntType(width))
        stable = builder.icmp_unsigned("==", small, ir.Constant(ir.IntType(width), 2**width - 1))
        regular = builder.fcmp_ordered("!=", pivot, ir.Constant(ir.DoubleType(), 0.0))
        zero = ir.Constant(shape.row, [0.0] * width)
        which = [[c + width * (c > i) for c in range(width)] for i in range(side)]
        below = [_mixed(builder, row, zero, own) for row, own in zip(rows, which, strict=True)]
        for found, n in ((below, 2), (_upper(builder, shape, rows), 3)):
            place = _places(builder, context, kind.args[n], values[n], values[4])
            _store(builder, shape, _turned(builder, found), place)
        return builder.and_(stable, regular)

    return types.boolean(A, types.int64, lower, upper, types.int64), generate


@intrinsic
def transpose(typing: Any, A: Any, k: Any) -> Any:
    """Transpose ``A_k`` in place."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        shape = shape_of(kind.args[0])
        block = _places(builder, context, kind.args[0], *values)
        _store(builder, shape, _turned(builder, _load(builder, shape, block)), block)
        return context.get_dummy_value()

    return types.none(A, types.int64), generate


@intrinsic
def add_block(typing: Any, A: Any, i: Any, out: Any, k: Any) -> Any:
    """``out_k += A_i``."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        shape = shape_of(kind.args[0])
        given, target = (
            _places(builder, context, kind.args[n], values[n], values[n + 1]) for n in (0, 2)
        )
        pairs = zip(_load(builder, shape, given), _load(builder, shape, target), strict=True)
        _store(builder, shape, [builder.fadd(a, b) for a, b in pairs], target)
        return context.get_dummy_value()

    return types.none(A, types.int64, out, types.int64), generate


def _entry(context: Any, builder: Any, kind: Any, values: Any) -> Any:
    """Address of entry (r, c) of a block."""
    width = ir.Constant(_INDEX, shape_of(kind.args[0]).width)
    block = _places(builder, context, kind.args[0], values[0], values[1])
    return builder.gep(block, [builder.add(builder.mul(values[2], width), values[3])])


@intrinsic
def entry(typing: Any, A: Any, k: Any, r: Any, c: Any) -> Any:
    """Entry (r, c) of a block."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        return builder.load(_entry(context, builder, kind, values))

    return types.float64(A, types.int64, types.int64, types.int64), generate


@intrinsic
def put_entry(typing: Any, A: Any, k: Any, r: Any, c: Any, value: Any) -> Any:
    """The other way round."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        builder.store(values[4], _entry(context, builder, kind, values))
        return context.get_dummy_value()

    return types.none(A, types.int64, types.int64, types.int64, types.float64), generate
