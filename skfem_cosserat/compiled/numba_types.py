"""Types of numba for the structures of :mod:`.structures`; importing this module imports numba."""

from __future__ import annotations

from functools import cache
from typing import Any

from llvmlite import ir
from numba import from_dtype, types
from numba.core.datamodel import models
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import NativeValue, register_model, typeof_impl, unbox
from numpy import dtype

from .structures import ArrayField, Kind, Structure

_WORD = ir.IntType(64)


class View(types.Array):
    """A contiguous array that does not belong to compiled code."""

    def __init__(self, dtype: Any, ndim: int) -> None:
        super().__init__(dtype, ndim, "C", name=f"view({dtype}, {ndim}d)")

    def unify(self, typing: Any, other: Any) -> Any:
        """None with arrays whose references are counted."""
        return None

    def can_convert_to(self, typing: Any, other: Any) -> Any:
        """Not to such arrays."""
        return None


@register_model(View)
class _ViewModel(models.ArrayModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind)
        own: Any = self
        assert own._fields[0] == "meminfo", own._fields
        # what counts references keeps its place: a pointer, to nothing
        own._members = types.voidptr, *own._members[1:]
        own._models = manager.lookup(types.voidptr), *own._models[1:]


class _Type(types.Type):
    """Numba's type of a structure."""

    def __init__(self, kind: Kind) -> None:
        super().__init__(kind.name)
        self.family, self.places = kind.family, kind.places
        self.fields = {name: type_of(field) for name, field in kind.fields.items()}


_NUMBERS = {float: types.float64, int: types.int64, bool: types.boolean}


@cache
def type_of(field: Any) -> Any:
    """Numba's type of a field, or of a structure by its kind."""
    if isinstance(field, ArrayField):
        return View(from_dtype(dtype(field.dtype)), field.ndim)
    if isinstance(field, tuple):
        own = [*map(type_of, field)]
        assert len(set(own)) == 1, field
        return types.UniTuple(own[0], len(own))
    return _Type(field) if isinstance(field, Kind) else _NUMBERS[field]


@register_model(_Type)
class _TypeModel(models.OpaqueModel):
    pass


@typeof_impl.register(Structure)
def _type_of_structure(value: Structure, context: Any) -> Any:
    """Type of a structure where Python calls functions of numba, as tests do."""
    return type_of(value.kind)


@unbox(_Type)
def _unboxed(kind: Any, value: Any, c: Any) -> Any:
    number = c.pyapi.object_getattr_string(value, "address")
    address = c.pyapi.long_as_voidptr(number)
    c.pyapi.decref(number)
    return NativeValue(address)


@infer_getattr
class _Fields(AttributeTemplate):
    key = _Type

    def generic_resolve(self, kind: Any, name: str) -> Any:
        return kind.fields.get(name)


@lower_getattr_generic(_Type)
def _field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    own = kind.fields[name]
    words = builder.bitcast(value, _WORD.as_pointer())
    place = builder.gep(words, [ir.Constant(_WORD, kind.places[name])])
    if own == types.boolean:
        return builder.trunc(builder.load(place), ir.IntType(1))
    pointer = context.get_value_type(own).as_pointer()
    return builder.load(builder.bitcast(place, pointer), align=8)
