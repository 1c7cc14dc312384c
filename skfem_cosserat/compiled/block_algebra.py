"""Blocks of six by six in vector registers for compiled kernels.

LLVM's own vectorising leaves loops over six numbers to single ones, or unrolls them into code that
does not fit into the processor's caches for instructions. Arrays (n, 6, 6) of blocks are
contiguous, blocks are named by their numbers in them; a register holds a row.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

#: how much entries of the diagonal may grow while a block is factorised without exchanging rows.
#: Those of positive definite ones do not grow; rows and columns may have any units
GROWTH = 10.0
#: rows of a block, and the type of one
SIDE = 6
ROW = ir.VectorType(ir.DoubleType(), SIDE)
_INDEX, _LANE = ir.IntType(64), ir.IntType(32)
_FUSED = ("contract",)


def pointer(context: Any, builder: Any, kind: Any, array: Any, place: Any, size: int = 1) -> Any:
    """Address of the entry at a flat place of an array, counted in so many entries."""
    assert kind.layout == "C", kind
    data = context.make_array(kind)(context, builder, array).data
    return builder.gep(data, [builder.mul(place, ir.Constant(_INDEX, size))])


def _places(builder: Any, context: Any, kind: Any, array: Any, number: Any) -> Any:
    """Address of the first entry of a block."""
    return pointer(context, builder, kind, array, number, SIDE * SIDE)


def row_of(builder: Any, block: Any, r: int) -> Any:
    """Address of a row."""
    place = builder.gep(block, [ir.Constant(_INDEX, SIDE * r)])
    return builder.bitcast(place, ROW.as_pointer())


def _load(builder: Any, block: Any) -> list[Any]:
    """All rows."""
    return [builder.load(row_of(builder, block, r), align=8) for r in range(SIDE)]


def _store(builder: Any, rows: list[Any], block: Any) -> None:
    for r, row in enumerate(rows):
        builder.store(row, row_of(builder, block, r), align=8)


def _mixed(builder: Any, a: Any, b: Any, which: list[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_LANE, len(which)), which))


def spread(builder: Any, number: Any) -> Any:
    """A row with the same number in all entries."""
    undefined = ir.Constant(ROW, ir.Undefined)
    one = builder.insert_element(undefined, number, ir.Constant(_LANE, 0))
    return _mixed(builder, one, undefined, [0] * SIDE)


def _turned(builder: Any, rows: list[Any]) -> list[Any]:
    """Columns of the block of these rows."""
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
            rows = _load(builder, right)
            if turned:
                rows = _turned(builder, rows)
            sums: list[Any] = _load(builder, target) if sign else [None] * SIDE
            for r in range(SIDE):
                for t, row in enumerate(rows):
                    place = ir.Constant(_INDEX, SIDE * t + r if crossed else SIDE * r + t)
                    factor = spread(builder, builder.load(builder.gep(left, [place])))
                    term = builder.fmul(factor, row, flags=_FUSED)
                    combine = builder.fsub if sign < 0 else builder.fadd
                    last = sums[r]
                    sums[r] = term if last is None else combine(last, term, flags=_FUSED)
            _store(builder, sums, target)
            return context.get_dummy_value()

        n = types.int64
        return types.none(A, n, B, n, out, n), generate

    return typed


#: ``out_k = A_i B_j``, which may be in the place of one of them, as below.
put_times = intrinsic(_multiply(0, False))
#: ``out_k = A_i B_j^T``.
put_turned = intrinsic(_multiply(0, False, True))
#: ``out_k = A_i^T B_j``.
put_crossed = intrinsic(_multiply(0, True))
#: ``out_k += A_i B_j``.
add_times = intrinsic(_multiply(1, False))
#: ``out_k += A_i^T B_j``.
add_crossed = intrinsic(_multiply(1, True))
#: ``out_k -= A_i^T B_j``.
subtract_crossed = intrinsic(_multiply(-1, True))


def _clear(builder: Any, rows: list[Any], n: int, own: Any, others: range) -> None:
    """Clear column n of others by row n: `own` is that row, with what takes the column's place."""
    zero = ir.Constant(ROW, [0.0] * SIDE)
    for i in others:
        factor = _mixed(builder, rows[i], zero, [n] * SIDE)
        left = [SIDE + c if c == n else c for c in range(SIDE)]
        term = builder.fmul(factor, own, flags=_FUSED)
        rows[i] = builder.fsub(_mixed(builder, rows[i], zero, left), term, flags=_FUSED)


def _eliminate(builder: Any, rows: list[Any], n: int) -> Any:
    """A step of Gauss in place, without exchange of rows; gives the pivot."""
    one, lane = ir.Constant(ir.DoubleType(), 1.0), ir.Constant(_LANE, n)
    pivot = builder.extract_element(rows[n], lane)
    inverse = spread(builder, builder.fdiv(one, pivot))
    rows[n] = builder.fmul(builder.insert_element(rows[n], one, lane), inverse)
    _clear(builder, rows, n, rows[n], range(n + 1, SIDE))
    return pivot


def _upper(builder: Any, rows: list[Any]) -> list[Any]:
    """Inverse of the upper triangle that elimination leaves, with ones on its diagonal."""
    out: list[Any] = []
    for n in reversed(range(SIDE)):
        unit = ir.Constant(ROW, [float(c == n) for c in range(SIDE)])
        out.insert(0, _mixed(builder, rows[n], unit, [c + SIDE * (c <= n) for c in range(SIDE)]))
        _clear(builder, rows, n, out[0], range(n))
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
        block = _places(builder, context, kind.args[0], values[0], values[1])
        rows = _load(builder, block)
        absolute = builder.module.declare_intrinsic(
            f"llvm.fabs.v{SIDE}f64", fnty=ir.FunctionType(ROW, [ROW])
        )

        def diagonal(base: Any, first: int) -> Any:
            for i in range(first, SIDE):
                which = [SIDE + c if c == i else c for c in range(SIDE)]
                base = _mixed(builder, base, rows[i], which)
            return builder.call(absolute, [base])

        start = diagonal(rows[0], 1)
        last = largest = start
        pivot = None
        for n in range(SIDE):
            pivot = _eliminate(builder, rows, n)
            if n < SIDE - 1:
                last = diagonal(last, n + 1)
                more = builder.fcmp_ordered(">", largest, last)
                largest = builder.select(more, largest, last)  # NaN if that is NaN
        allowed = builder.fmul(start, ir.Constant(ROW, [GROWTH] * SIDE))
        within = builder.fcmp_ordered("<=", largest, allowed)
        small = builder.bitcast(within, ir.IntType(SIDE))
        stable = builder.icmp_unsigned("==", small, ir.Constant(ir.IntType(SIDE), 2**SIDE - 1))
        regular = builder.fcmp_ordered("!=", pivot, ir.Constant(ir.DoubleType(), 0.0))
        zero = ir.Constant(ROW, [0.0] * SIDE)
        which = [[c + SIDE * (c > i) for c in range(SIDE)] for i in range(SIDE)]
        below = [_mixed(builder, row, zero, own) for row, own in zip(rows, which, strict=True)]
        for found, n in ((below, 2), (_upper(builder, rows), 3)):
            place = _places(builder, context, kind.args[n], values[n], values[4])
            _store(builder, _turned(builder, found), place)
        return builder.and_(stable, regular)

    return types.boolean(A, types.int64, lower, upper, types.int64), generate


@intrinsic
def transpose(typing: Any, A: Any, k: Any) -> Any:
    """Transpose ``A_k`` in place."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        block = _places(builder, context, kind.args[0], *values)
        _store(builder, _turned(builder, _load(builder, block)), block)
        return context.get_dummy_value()

    return types.none(A, types.int64), generate


@intrinsic
def add_block(typing: Any, A: Any, i: Any, out: Any, k: Any) -> Any:
    """``out_k += A_i``."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        given, target = (
            _places(builder, context, kind.args[n], values[n], values[n + 1]) for n in (0, 2)
        )
        pairs = zip(_load(builder, given), _load(builder, target), strict=True)
        _store(builder, [builder.fadd(a, b) for a, b in pairs], target)
        return context.get_dummy_value()

    return types.none(A, types.int64, out, types.int64), generate


def _entry(context: Any, builder: Any, kind: Any, values: Any) -> Any:
    """Address of entry (r, c) of a block."""
    block = _places(builder, context, kind.args[0], values[0], values[1])
    return builder.gep(
        block, [builder.add(builder.mul(values[2], ir.Constant(_INDEX, SIDE)), values[3])]
    )


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
