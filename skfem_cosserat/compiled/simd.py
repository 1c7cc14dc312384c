"""Four elements or vertices at a time: a number type of vector registers for compiled kernels.

A value of :data:`simd` holds the same quantity of :data:`WIDTH` elements. It is added, subtracted
and multiplied like a number, with numbers as well, so the functions of :mod:`.small` take both.
Compilers find such vectors in loops by themselves only where arrays cannot overlap and neighbours
lie side by side; here whole nodes are loaded and transposed in registers.

Arrays are taken as flat, whatever their shape; ``places`` are the numbers of the elements or rows,
``size`` how many entries each has, ``first`` where to start among them.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, register_model

from .numba_types import View
from .numbers import WIDTH

_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_INDEX, _LANE = ir.IntType(64), ir.IntType(32)


def pointer(context: Any, builder: Any, kind: Any, array: Any, place: Any, size: int = 1) -> Any:
    """Address of the entry at a flat place of an array, counted in so many entries."""
    assert kind.layout == "C", kind
    data = context.make_array(kind)(context, builder, array).data
    return builder.gep(data, [builder.mul(place, ir.Constant(_INDEX, size))])


class _Simd(types.Type):
    """One number for each of some elements."""

    def __init__(self) -> None:
        super().__init__(name="simd")

    def can_convert_from(self, typing: Any, other: Any) -> Any:
        """Numbers are those of all lanes."""
        return Conversion.promote if other == types.float64 else None


simd = _Simd()


@register_model(_Simd)
class _SimdModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


def _mixed(builder: Any, a: Any, b: Any, which: list[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_LANE, len(which)), which))


def _spread(builder: Any, value: Any, kind: Any) -> Any:
    """Vector of a kind with the same number in all lanes."""
    undefined = ir.Constant(kind, ir.Undefined)
    one = builder.insert_element(undefined, value, ir.Constant(_LANE, 0))
    return _mixed(builder, one, undefined, [0] * kind.count)


@lower_cast(types.float64, simd)
def _cast(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    return _spread(builder, value, _VECTOR)


def _define(operation: Any, name: str) -> None:
    """An operation of two vectors, or of a vector and a number; sums of products may be fused."""
    cases = [
        signature(simd, simd, simd),
        signature(simd, simd, types.float64),
        signature(simd, types.float64, simd),
    ]
    infer_global(operation)(type(f"_Simd_{name}", (ConcreteTemplate,), {"cases": cases}))

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        both = [
            value if own == simd else _spread(builder, value, _VECTOR)
            for own, value in zip(kind.args, values, strict=True)
        ]
        return getattr(builder, name)(*both, flags=("contract",))

    for case in cases:
        lower_builtin(operation, *case.args)(generate)


for _operation, _name in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
    (operator.iadd, "fadd"),
    (operator.isub, "fsub"),
    (operator.imul, "fmul"),
):
    _define(_operation, _name)


def _places(builder: Any, places: Any, size: Any, first: Any) -> list[Any]:
    """``size place + first`` for each lane."""
    return [
        builder.add(builder.mul(place, size), first)
        for place in cgutils.unpack_tuple(builder, places)
    ]


def _load(builder: Any, pointer: Any) -> Any:
    """SIMD vector of consecutive entries, from any address on."""
    return builder.load(builder.bitcast(pointer, _VECTOR.as_pointer()), align=8)


def _store(builder: Any, value: Any, pointer: Any) -> None:
    builder.store(value, builder.bitcast(pointer, _VECTOR.as_pointer()), align=8)


def _transposed(builder: Any, given: list[Any]) -> list[Any]:
    """Rows to columns."""
    a, b, c, d = given
    pairs = (a, b), (c, d)
    ab, cd = (_mixed(builder, *pair, [0, 4, 2, 6]) for pair in pairs)
    AB, CD = (_mixed(builder, *pair, [1, 5, 3, 7]) for pair in pairs)
    low, high = [0, 1, 4, 5], [2, 3, 6, 7]
    return [_mixed(builder, *own, which) for which in (low, high) for own in ((ab, cd), (AB, CD))]


def _local(kind: Any) -> Any:
    """An array of these numbers on the stack: gone when its part ends. Not for loops."""

    def typed(typing: Any, shape: Any) -> Any:
        sizes = [shape] if isinstance(shape, types.Integer) else [*shape]
        array = View(kind, len(sizes))

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            own = values if len(sizes) == 1 and sizes[0] is shape else None
            lengths = own or cgutils.unpack_tuple(builder, values[0])
            number = context.get_value_type(kind)
            size = ir.Constant(_INDEX, context.get_abi_sizeof(number))
            strides = [size]
            for length in reversed(lengths):
                strides.insert(0, builder.mul(strides[0], length))
            total = builder.udiv(strides[0], size)
            data = builder.alloca(number, total)
            data.align = 32
            out = context.make_array(array)(context, builder)
            for name in ("meminfo", "parent"):
                setattr(out, name, cgutils.get_null_value(getattr(out, name).type))
            out.nitems, out.itemsize, out.data = total, size, data
            out.shape = cgutils.pack_array(builder, lengths)
            out.strides = cgutils.pack_array(builder, strides[1:])
            return out._getvalue()

        return array(shape), generate

    return typed


#: room for a part alone, of one or several dimensions; what is in it is not said.
local = intrinsic(_local(types.float64))
#: the same for complex numbers.
local_complex = intrinsic(_local(types.complex128))


@intrinsic
def clear(typing: Any, a: Any) -> Any:
    """Make a whole array zero."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        own = context.make_array(kind.args[0])(context, builder, values[0])
        cgutils.memset(builder, own.data, builder.mul(own.nitems, own.itemsize), 0)
        return context.get_dummy_value()

    return types.none(a), generate


@intrinsic
def copy(typing: Any, a: Any, out: Any) -> Any:
    """Fill a whole array with the first numbers of another one."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        given, own = (
            context.make_array(array)(context, builder, value)
            for array, value in zip(kind.args, values, strict=True)
        )
        cgutils.raw_memcpy(builder, own.data, given.data, own.nitems, own.itemsize)
        return context.get_dummy_value()

    return types.none(a, out), generate


@intrinsic
def pack(typing: Any, numbers: Any) -> Any:
    """A number for each lane."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        out = ir.Constant(_VECTOR, ir.Undefined)
        for k, number in enumerate(cgutils.unpack_tuple(builder, values[0])):
            out = builder.insert_element(out, number, ir.Constant(_LANE, k))
        return out

    return simd(types.UniTuple(types.float64, WIDTH)), generate


@intrinsic
def load(typing: Any, a: Any, k: Any) -> Any:
    """Vector number k of scratch, ``a[WIDTH k : WIDTH (k + 1)]``."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        return _load(builder, pointer(context, builder, kind.args[0], values[0], values[1], WIDTH))

    return simd(a, types.int64), generate


@intrinsic
def store(typing: Any, a: Any, k: Any, value: Any) -> Any:
    """The other way round."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        place = pointer(context, builder, kind.args[0], values[0], values[1], WIDTH)
        _store(builder, values[2], place)
        return context.get_dummy_value()

    return types.none(a, types.int64, simd), generate


@intrinsic
def gather(typing: Any, a: Any, places: Any, size: Any, first: Any) -> Any:
    """Entry ``size place + first`` for each lane."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        out = ir.Constant(_VECTOR, ir.Undefined)
        for k, place in enumerate(_places(builder, *values[1:])):
            entry = builder.load(pointer(context, builder, kind.args[0], values[0], place))
            out = builder.insert_element(out, entry, ir.Constant(_LANE, k))
        return out

    return simd(a, places, types.int64, types.int64), generate


@intrinsic
def scatter(typing: Any, a: Any, places: Any, size: Any, first: Any, value: Any) -> Any:
    """The other way round; of equal places the last one counts."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        for k, place in enumerate(_places(builder, *values[1:4])):
            entry = builder.extract_element(values[4], ir.Constant(_LANE, k))
            builder.store(entry, pointer(context, builder, kind.args[0], values[0], place))
        return context.get_dummy_value()

    return types.none(a, places, types.int64, types.int64, simd), generate


@intrinsic
def rows(typing: Any, a: Any, places: Any, size: Any, first: Any) -> Any:
    """Entries ``size place + first`` and the three behind it, for each lane: a tuple."""
    result = types.UniTuple(simd, WIDTH)

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        found = [
            _load(builder, pointer(context, builder, kind.args[0], values[0], place))
            for place in _places(builder, *values[1:])
        ]
        return context.make_tuple(builder, result, _transposed(builder, found))

    return result(a, places, types.int64, types.int64), generate


def _put(sum_up: bool) -> Any:
    def typed(typing: Any, a: Any, places: Any, size: Any, first: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
            found = _transposed(builder, cgutils.unpack_tuple(builder, values[4]))
            for new, place in zip(found, _places(builder, *values[1:4]), strict=True):
                at = pointer(context, builder, kind.args[0], values[0], place)
                total = builder.fadd(_load(builder, at), new) if sum_up else new
                _store(builder, total, at)
            return context.get_dummy_value()

        four = types.UniTuple(simd, WIDTH)
        return types.none(a, places, types.int64, types.int64, four), generate

    return typed


#: stores what :func:`rows` loads; of equal places the last one counts.
put_rows = intrinsic(_put(False))
#: adds to what :func:`rows` loads, one lane after the other: places may be equal.
add_rows = intrinsic(_put(True))


@intrinsic
def largest(typing: Any, value: Any) -> Any:
    """Largest entry of all lanes; NaN only if it is in the first one."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        out = builder.extract_element(values[0], ir.Constant(_LANE, 0))
        for k in range(1, WIDTH):
            entry = builder.extract_element(values[0], ir.Constant(_LANE, k))
            out = builder.select(builder.fcmp_ordered(">", entry, out), entry, out)
        return out

    return types.float64(simd), generate


# -- blocks of six by six in vector registers ------------------------------------------------------
#
# LLVM's own vectorising leaves loops over six numbers to single ones, or unrolls them into code
# that does not fit into the processor's caches for instructions. Arrays (n, 6, 6) of blocks are
# contiguous, blocks are named by their numbers in them; a register holds a row.

#: how much entries of the diagonal may grow while a block is factorised without exchanging rows.
#: Those of positive definite ones do not grow; rows and columns may have any units
GROWTH = 10.0
#: rows of a block, and the type of one
SIDE = 6
ROW = ir.VectorType(ir.DoubleType(), SIDE)
_FUSED = ("contract",)


def _block(builder: Any, context: Any, kind: Any, array: Any, number: Any) -> Any:
    """Address of the first entry of a block."""
    return pointer(context, builder, kind, array, number, SIDE * SIDE)


def row_of(builder: Any, block: Any, r: int) -> Any:
    """Address of a row."""
    place = builder.gep(block, [ir.Constant(_INDEX, SIDE * r)])
    return builder.bitcast(place, ROW.as_pointer())


def _load_rows(builder: Any, block: Any) -> list[Any]:
    """All rows."""
    return [builder.load(row_of(builder, block, r), align=8) for r in range(SIDE)]


def _store_rows(builder: Any, rows: list[Any], block: Any) -> None:
    for r, row in enumerate(rows):
        builder.store(row, row_of(builder, block, r), align=8)


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


def _product(add: bool) -> Any:
    def typed(typing: Any, A: Any, k: Any, x: Any, u: Any, sign: Any, out: Any, v: Any) -> Any:
        def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
            block, given, target = (
                pointer(context, builder, kind.args[n], values[n], values[n + 1], size)
                for n, size in ((0, SIDE * SIDE), (2, SIDE), (5, SIDE))
            )
            target = builder.bitcast(target, ROW.as_pointer())
            sums = [None, None]
            for r in range(SIDE):
                entry = builder.load(builder.gep(given, [ir.Constant(_INDEX, r)]))
                entry = _spread(builder, builder.fmul(entry, values[4]), ROW)
                row = builder.load(row_of(builder, block, r), align=8)
                term = builder.fmul(entry, row, flags=("contract",))
                last = sums[r % 2]
                sums[r % 2] = (
                    term if last is None else builder.fadd(last, term, flags=("contract",))
                )
            total = builder.fadd(*sums)
            if add:
                total = builder.fadd(builder.load(target, align=8), total)
            builder.store(total, target, align=8)
            return context.get_dummy_value()

        integer, number = types.int64, types.float64
        return types.none(A, integer, x, integer, number, out, integer), generate

    return typed


#: ``out_v += sign A_k^T x_u``, of blocks.
add_product = intrinsic(_product(True))
#: ``out_v = sign A_k^T x_u``, which may be in the same place.
put_product = intrinsic(_product(False))


def _multiply(sign: int, crossed: bool, turned: bool = False) -> Any:
    """``out_k = A_i B_j`` or, with a sign, ``out_k += sign A_i B_j``.

    crossed, turned: A, B transposed. All is read before anything is written.
    """

    def typed(typing: Any, A: Any, i: Any, B: Any, j: Any, out: Any, k: Any) -> Any:
        def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
            left, right, target = (
                _block(builder, context, kind.args[n], values[n], values[n + 1]) for n in (0, 2, 4)
            )
            rows = _load_rows(builder, right)
            if turned:
                rows = _turned(builder, rows)
            sums = _load_rows(builder, target) if sign else [None] * SIDE
            for r in range(SIDE):
                for t, row in enumerate(rows):
                    place = ir.Constant(_INDEX, SIDE * t + r if crossed else SIDE * r + t)
                    factor = _spread(builder, builder.load(builder.gep(left, [place])), ROW)
                    term = builder.fmul(factor, row, flags=_FUSED)
                    combine = builder.fsub if sign < 0 else builder.fadd
                    last = sums[r]
                    sums[r] = term if last is None else combine(last, term, flags=_FUSED)
            _store_rows(builder, sums, target)
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
    inverse = _spread(builder, builder.fdiv(one, pivot), ROW)
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
        block = _block(builder, context, kind.args[0], values[0], values[1])
        rows = _load_rows(builder, block)
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
            place = _block(builder, context, kind.args[n], values[n], values[4])
            _store_rows(builder, _turned(builder, found), place)
        return builder.and_(stable, regular)

    return types.boolean(A, types.int64, lower, upper, types.int64), generate


@intrinsic
def transpose(typing: Any, A: Any, k: Any) -> Any:
    """Transpose ``A_k`` in place."""

    def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
        block = _block(builder, context, kind.args[0], *values)
        _store_rows(builder, _turned(builder, _load_rows(builder, block)), block)
        return context.get_dummy_value()

    return types.none(A, types.int64), generate
