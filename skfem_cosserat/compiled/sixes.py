"""Blocks of six by six in vector registers, one for each row, for compiled kernels.

LLVM's own vectorising leaves loops over six numbers to single ones, or unrolls them into code that
does not fit into the processor's caches for instructions. Arrays of blocks are contiguous, blocks
are named by their numbers in them.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

__all__ = ["GROWTH", "add_crossed", "add_times", "invert", "put_crossed", "put_times", "put_turned"]
__all__ += ["subtract_crossed"]

#: how much entries of the diagonal may grow while a block is inverted without exchanging rows.
#: Those of positive definite ones do not grow; rows and columns may have any units
GROWTH = 10.0
_ROW = ir.VectorType(ir.DoubleType(), 6)
_INDEX, _LANE = ir.IntType(64), ir.IntType(32)
_FUSED = ("contract",)


def _places(builder: Any, context: Any, kind: Any, array: Any, number: Any) -> Any:
    """Address of the first entry of a block."""
    assert kind.layout == "C", kind
    data = context.make_array(kind)(context, builder, array).data
    return builder.gep(data, [builder.mul(number, ir.Constant(_INDEX, 36))])


def _row(builder: Any, block: Any, r: int) -> Any:
    """Address of a row."""
    place = builder.gep(block, [ir.Constant(_INDEX, 6 * r)])
    return builder.bitcast(place, _ROW.as_pointer())


def _load(builder: Any, block: Any) -> list[Any]:
    """All rows."""
    return [builder.load(_row(builder, block, r), align=8) for r in range(6)]


def _store(builder: Any, rows: list[Any], block: Any) -> None:
    for r, row in enumerate(rows):
        builder.store(row, _row(builder, block, r), align=8)


def _mixed(builder: Any, a: Any, b: Any, which: list[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_LANE, 6), which))


def _spread(builder: Any, number: Any) -> Any:
    """The same number six times."""
    undefined = ir.Constant(_ROW, ir.Undefined)
    one = builder.insert_element(undefined, number, ir.Constant(_LANE, 0))
    return _mixed(builder, one, undefined, [0] * 6)


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
            sums: list[Any] = _load(builder, target) if sign else [None] * 6
            for r in range(6):
                for t, row in enumerate(rows):
                    place = ir.Constant(_INDEX, 6 * t + r if crossed else 6 * r + t)
                    entry = _spread(builder, builder.load(builder.gep(left, [place])))
                    term = builder.fmul(entry, row, flags=_FUSED)
                    combine = builder.fsub if sign < 0 else builder.fadd
                    last = sums[r]
                    sums[r] = term if last is None else combine(last, term, flags=_FUSED)
            _store(builder, sums, target)
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


def _eliminate(builder: Any, rows: list[Any], n: int) -> Any:
    """A step of Gauss and Jordan in place, without exchange of rows; gives the pivot."""
    one, zero = ir.Constant(ir.DoubleType(), 1.0), ir.Constant(_ROW, [0.0] * 6)
    lane = ir.Constant(_LANE, n)
    pivot = builder.extract_element(rows[n], lane)
    inverse = _spread(builder, builder.fdiv(one, pivot))
    own = builder.fmul(builder.insert_element(rows[n], one, lane), inverse)
    for i in range(6):
        if i != n:
            factor = _mixed(builder, rows[i], zero, [n] * 6)
            rest = _mixed(builder, rows[i], zero, [6 + c if c == n else c for c in range(6)])
            term = builder.fmul(factor, own, flags=_FUSED)
            rows[i] = builder.fsub(rest, term, flags=_FUSED)
    rows[n] = own
    return pivot


@intrinsic
def invert(typing: Any, A: Any, k: Any, out: Any, v: Any) -> Any:
    """``out_v = A_k^-T`` without exchange of rows; whether that was stable (not if NaN).

    It is where no entry of the diagonal grew more than :data:`GROWTH` times.
    """

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        rows = _load(builder, _places(builder, context, kind.args[0], values[0], values[1]))
        absolute = builder.module.declare_intrinsic(
            "llvm.fabs.v6f64", fnty=ir.FunctionType(_ROW, [_ROW])
        )

        def diagonal(base: Any, first: int) -> Any:
            for i in range(first, 6):
                base = _mixed(builder, base, rows[i], [6 + c if c == i else c for c in range(6)])
            return builder.call(absolute, [base])

        start = diagonal(rows[0], 1)
        last = largest = start
        pivot = None
        for n in range(6):
            pivot = _eliminate(builder, rows, n)
            if n < 5:
                last = diagonal(last, n + 1)
                more = builder.fcmp_ordered(">", largest, last)
                largest = builder.select(more, largest, last)  # NaN if that is NaN
        allowed = builder.fmul(start, ir.Constant(_ROW, [GROWTH] * 6))
        small = builder.bitcast(builder.fcmp_ordered("<=", largest, allowed), ir.IntType(6))
        stable = builder.icmp_unsigned("==", small, ir.Constant(ir.IntType(6), 63))
        regular = builder.fcmp_ordered("!=", pivot, ir.Constant(ir.DoubleType(), 0.0))
        place = _places(builder, context, kind.args[2], values[2], values[3])
        _store(builder, _turned(builder, rows), place)
        return builder.and_(stable, regular)

    return types.boolean(A, types.int64, out, types.int64), generate
