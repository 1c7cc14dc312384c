"""How kernels are compiled: importing this module imports numba.

A step is made of *parts*, functions of one of two signatures. They are compiled one by one and
called through their addresses: a compiled function that calls another one directly has that one
optimised with it once more, which would double the time to compile. So a step needs, and compiles,
just the parts of what is in the scene.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pickle import UnpicklingError
from typing import Any, TypeVar, cast

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.caching import FunctionCache
from numba.core.runtime import rtsys
from numba.extending import intrinsic

from .structures import is_groups
from .warm import NotKept, Source, stamp

__all__ = ["STAMP", "address", "call", "call_back", "call_beams", "call_with", "inlined", "jit"]
__all__ += ["part", "ready", "shared"]

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


#: numba's cache notices changes in a function's own file only, but code of others is compiled in
STAMP = stamp()


#: what reading files of the cache raises; ImportError: they name a module that is no more
_UNREADABLE: tuple[type[Exception], ...] = (UnpicklingError, EOFError, ValueError, LookupError)
_UNREADABLE = (*_UNREADABLE, AttributeError, TypeError, ImportError)


class _Cache(FunctionCache):
    """Compiled code on disk that is valid as long as no file in this folder changes."""

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (*super()._index_key(sig, codegen), STAMP)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Code from the disk; files cut short, damaged, or of other sources are made anew.

        Numba would get ready to compile first, which takes as long as all else.
        """
        found = None
        try:
            rtsys.initialize(target_context)
            with self._guard_against_spurious_io_errors():
                found = self._load_overload(sig, target_context)
        except _UNREADABLE:
            self.flush()
        return found

    def holds(self, sig: Any, target_context: Any) -> bool:
        """Whether there is a whole file of code for these types."""
        found = None
        with suppress(*_UNREADABLE), self._guard_against_spurious_io_errors():
            found = self._cache_file.load(self._index_key(sig, target_context.codegen()))
        return found is not None


def _compiled(function: Kernel, keep: bool, **options: bool) -> Any:
    """IEEE arithmetic as in numpy; kept on disk or not."""
    made: Any = njit(
        function,
        error_model="numpy",
        boundscheck=False,
        no_cfunc_wrapper=True,
        **options,
    )
    template = made.get_call_template
    # not once more for each literal argument: the optimiser finds them anyway
    made.get_call_template = lambda args, kws: template(tuple(map(types.unliteral, args)), kws)
    if keep:
        with suppress(RuntimeError):  # no folder to write to: compiled in every process
            made._cache = _Cache(function)
    return made


def jit(function: Kernel) -> Kernel:
    """For Python to call: compiled at the first call.

    Loops are written out: assigning to slices takes numba seconds to compile. Short loops of fixed
    length are unrolled, those over ``a.shape`` are not.
    """
    return cast(Kernel, _compiled(function, True))


def part(function: Kernel) -> Kernel:
    """For compiled code to call through its :func:`address`: ``f(*structures, numbers, flag)``.

    It gives a float.
    """
    return cast(Kernel, _compiled(function, True, no_cpython_wrapper=True))


def inlined(function: Kernel) -> Kernel:
    """For parts to call: compiled into them. They take arrays, but make none."""
    made = _compiled(function, False, no_cpython_wrapper=True, forceinline=True, _nrt=False)
    return cast(Kernel, made)


def shared(function: Kernel) -> Kernel:
    """As :func:`inlined`, for what a part calls in several places: compiled into it once."""
    made = _compiled(function, False, no_cpython_wrapper=True, _nrt=False)
    return cast(Kernel, made)


def ready(function: Any, kinds: tuple[Any, ...], source: Source = Source.COMPILER) -> Any:
    """What is compiled of a function for arguments of these types.

    Raises
    ------
    NotKept
        If it is in none of the places that it may come from.
    """
    if kinds in function.overloads:
        return function.overloads[kinds]
    if source < Source.COMPILER:
        cache = function._cache  # another one where there is no folder to keep it in
        kept = source == Source.DISK and isinstance(cache, _Cache)
        if not (kept and cache.holds(kinds, function.targetctx)):
            raise NotKept(function.__name__)
    function.compile(kinds)
    return function.overloads[kinds]


#: of parts that are in this process, which keeps their code
_ADDRESSES: dict[tuple[Any, tuple[Any, ...]], int] = {}


def address(function: Any, *kinds: Any, source: Source = Source.COMPILER) -> int:
    """Address of a part for arguments of these types, see :func:`ready`."""
    place = _ADDRESSES.get((function, kinds))
    if place is None:
        compiled = ready(function, kinds, source)
        place = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
        _ADDRESSES[function, kinds] = place
    return int(place)


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
    """Call the part at an address with the one structure at another address."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        own = builder.inttoptr(values[1], context.get_value_type(types.voidptr))
        return _called(context, builder, values[0], (types.voidptr,), [own])

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
    """Call the part of beams at an address.

    Where g is :class:`.structures.Groups` it is that of a row of addresses: each of its groups has
    a part of its own.
    """
    kinds = (g, w, numbers, flag)
    if is_groups(g):
        return types.float64(types.int64, *kinds), _each_group

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place, *own = values
        return _called(context, builder, place, kinds, own)

    return types.float64(types.int64, g, w, numbers, flag), generate


def _each_group(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    """Call the parts of all groups, some with numbers of their own."""
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


@intrinsic
def call_back(typing: Any, place: Any, flag: Any) -> Any:
    """Call the C function ``double f(int64)`` at an address, such as one that calls Python."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kind = ir.FunctionType(ir.DoubleType(), [ir.IntType(64)])
        return builder.call(builder.inttoptr(values[0], ir.PointerType(kind)), [values[1]])

    return types.float64(types.int64, types.int64), generate
