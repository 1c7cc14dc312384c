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

from .block_algebra import ROW, SIDE, pointer, row_of, spread
from .numba_types import View
from .numbers import WIDTH

_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_INDEX, _LANE = ir.IntType(64), ir.IntType(32)


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


def _all(builder: Any, value: Any) -> Any:
    """SIMD vector with the same number in all lanes."""
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    one = builder.insert_element(undefined, value, ir.Constant(_LANE, 0))
    zeros = ir.Constant(ir.VectorType(_LANE, WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(one, undefined, zeros)


@lower_cast(types.float64, simd)
def _cast(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    return _all(builder, value)


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
            value if own == simd else _all(builder, value)
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

    def mixed(a: Any, b: Any, *which: int) -> Any:
        mask = ir.Constant(ir.VectorType(_LANE, WIDTH), list(which))
        return builder.shuffle_vector(a, b, mask)

    a, b, c, d = given
    ab, cd = mixed(a, b, 0, 4, 2, 6), mixed(c, d, 0, 4, 2, 6)
    AB, CD = mixed(a, b, 1, 5, 3, 7), mixed(c, d, 1, 5, 3, 7)
    return [
        mixed(ab, cd, 0, 1, 4, 5),
        mixed(AB, CD, 0, 1, 4, 5),
        mixed(ab, cd, 2, 3, 6, 7),
        mixed(AB, CD, 2, 3, 6, 7),
    ]


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


def _product(add: bool) -> Any:
    def typed(typing: Any, A: Any, k: Any, x: Any, u: Any, sign: Any, out: Any, v: Any) -> Any:
        def generate(context: Any, builder: Any, kind: Any, values: Any) -> Any:
            block, given, target = (
                pointer(context, builder, kind.args[n], values[n], values[n + 1], size)
                for n, size in ((0, SIDE * SIDE), (2, SIDE), (5, SIDE))
            )
            target = builder.bitcast(target, ROW.as_pointer())
            sums: list[Any] = [None, None]
            for r in range(SIDE):
                entry = builder.load(builder.gep(given, [ir.Constant(_INDEX, r)]))
                entry = spread(builder, builder.fmul(entry, values[4]))
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


#: ``out_v += sign A_k^T x_u``, of blocks as in :mod:`.block_algebra`.
add_product = intrinsic(_product(True))
#: ``out_v = sign A_k^T x_u``, which may be in the same place.
put_product = intrinsic(_product(False))
