"""Compilation of kernels: importing this module imports numba.

A step is made of *parts*, functions of one of two signatures. They are compiled one by one and
called through their addresses: a compiled function that calls another one directly has that one
optimised with it once more, which would double the time to compile. So a step needs, and compiles,
just the parts of what is in the scene. What is compiled is kept by :mod:`.kept`.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, TypeVar, cast

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from .kept import Key, keep
from .numba_types import type_of

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def _made(function: Kernel, **options: bool) -> Any:
    """IEEE arithmetic as in numpy; arrays belong to others."""
    made: Any = njit(
        function,
        error_model="numpy",
        boundscheck=False,
        no_cfunc_wrapper=True,
        no_cpython_wrapper=True,
        _nrt=False,
        **options,
    )
    template = made.get_call_template
    # not once more for each literal argument: the optimiser finds them anyway
    made.get_call_template = lambda args, kws: template(tuple(map(types.unliteral, args)), kws)
    return made


def part(function: Kernel) -> Kernel:
    """For compiled code to call through its address: ``f(*structures, numbers, flag)``.

    It gives a float. Loops are written out: assigning to slices takes numba seconds to compile.
    Whole arrays are filled by :func:`.simd.copy` and :func:`.simd.clear`.
    Short loops of fixed length are unrolled, those over ``a.shape`` are not.
    """
    return cast(Kernel, _made(function))


def inlined(function: Kernel) -> Kernel:
    """For parts to call: compiled into them."""
    return cast(Kernel, _made(function, forceinline=True))


def shared(function: Kernel) -> Kernel:
    """For functions that a part calls in several places: compiled into it once, not inlined."""
    return cast(Kernel, _made(function))


#: modules of the parts of a scene; those of other families are in the module of its name
_OF_SCENES = (
    *("nodes", "tree", "rows", "flow", "blocks"),
    *("elements", "forces", "static"),
)


def function_named(family: str, name: str) -> Any:
    """The function of this name.

    Families are those of parts of a scene ("tree"), of laws of beams with a stored energy, and of
    what Python calls: steps and statics.
    """
    for module in _OF_SCENES if family == "tree" else (family,):
        own = import_module(f".{module}", __package__)
        if getattr(vars(own).get(name), "__module__", None) == own.__name__:
            return vars(own)[name]
    raise LookupError(name)


def compiled(key: Key) -> int:
    """Address of a function that is compiled now, and kept."""
    family, name, kinds = key
    function, given = function_named(family, name), tuple(map(type_of, kinds))
    function.compile(given)
    made = function.overloads[given]
    library, symbol = made.library, made.fndesc.llvm_func_name
    place = int(library.get_pointer_to_function(symbol))
    needs = [f.name for f in library._final_module.functions if f.is_declaration]
    needs = [each for each in needs if not each.startswith("llvm.")]
    if not library.has_dynamic_globals:
        keep(key, symbol, needs, library.serialize_using_object_code()[2][0])
    return place


@intrinsic
def call(typing: Any, place: Any, *arguments: Any) -> Any:
    """Call the part at an address."""
    kinds = arguments[0] if len(arguments) == 1 else arguments
    kinds = tuple(kinds)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        own = cgutils.unpack_tuple(builder, values[1], len(kinds))
        return _called(context, builder, values[0], kinds, own)

    return types.float64(types.int64, types.StarArgTuple(kinds)), generate


@intrinsic
def call_with(typing: Any, place: Any, structure: Any) -> Any:
    """Call the part at an address with the one structure at another address, and no flag."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        own = builder.inttoptr(values[1], context.get_value_type(types.voidptr))
        flag = ir.Constant(ir.IntType(64), 0)
        return _called(context, builder, values[0], (types.voidptr, types.int64), [own, flag])

    return types.float64(types.int64, types.int64), generate


def _called(context: Any, builder: Any, place: Any, kinds: Any, own: Any) -> Any:
    """Result of the part at a place for arguments of these types."""
    convention = context.call_conv
    kind = convention.get_function_type(types.float64, kinds)
    function = builder.inttoptr(place, ir.PointerType(kind))
    status, result = convention.call_function(builder, function, types.float64, kinds, own)
    with cgutils.if_unlikely(builder, status.is_error):
        convention.return_status_propagate(builder, status)
    return result


@intrinsic
def call_beams(typing: Any, place: Any, g: Any, w: Any, numbers: Any, flag: Any) -> Any:
    """Call the parts of all groups of beams, some with numbers of their own.

    At the address is a row of their addresses, see :class:`.structures.Groups`.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        word = ir.IntType(64).as_pointer()
        parts, words = builder.inttoptr(values[0], word), builder.bitcast(values[1], word)
        own = [builder.load(builder.gep(words, [ir.Constant(ir.IntType(64), k)])) for k in range(3)]
        count, places, numbers = own[0], *(builder.inttoptr(each, word) for each in own[1:])
        kinds = signature.args[1:]
        with cgutils.for_range(builder, count) as loop:
            part, beams, other = (
                builder.load(builder.gep(each, [loop.index])) for each in (parts, places, numbers)
            )
            beams = builder.inttoptr(beams, context.get_value_type(kinds[0]))
            array = context.make_array(kinds[2])(context, builder, value=values[3])
            given = builder.icmp_unsigned("!=", other, ir.Constant(other.type, 0))
            other = builder.inttoptr(other, array.data.type)
            array.data = builder.select(given, other, array.data)
            chosen = [beams, values[2], array._getvalue(), values[4]]
            _called(context, builder, part, kinds, chosen)
        return ir.Constant(ir.DoubleType(), 0.0)

    return types.float64(types.int64, g, w, numbers, flag), generate


@intrinsic
def call_back(typing: Any, place: Any, flag: Any) -> Any:
    """Call the C function ``double f(int64)`` at an address, such as one that calls Python."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kind = ir.FunctionType(ir.DoubleType(), [ir.IntType(64)])
        return builder.call(builder.inttoptr(values[0], ir.PointerType(kind)), [values[1]])

    return types.float64(types.int64, types.int64), generate
