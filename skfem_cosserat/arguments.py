"""Arguments of public calls: the one that does not fit the signature is named in an InputError.

Constructors and functions check what they know best themselves, by :mod:`skfem_cosserat.types`.
Everything else that an argument can be wrong in stands in its annotation. It is read when a call
has failed, so calls that are right pay nothing.
"""

from __future__ import annotations

import builtins
import os
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import wraps
from inspect import BoundArguments, Parameter, Signature, isgeneratorfunction, signature, unwrap
from types import FunctionType, NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

import numpy as np

from .errors import CosseratError, InputError
from .types import NUMBERLESS, floats, shown

T = TypeVar("T")

#: errors of Python and numpy that a bad argument can end in
FOREIGN = (TypeError, ValueError, AttributeError, LookupError, ArithmeticError)


class _Numbers:
    """Stands for array types in annotations."""


class _Vector(_Numbers):
    """Stands for three numbers."""


def _shape(value: Any) -> tuple[int, ...] | None:
    """Shape of real numbers, None of anything else."""
    try:
        return floats(value).shape
    except NUMBERLESS:
        return None


#: what stands in an annotation, in words, and whether a value is one
_KINDS: dict[Any, tuple[str, Callable[[Any], bool]]] = {
    _Numbers: ("real numbers", lambda value: _shape(value) is not None),
    _Vector: ("three real numbers", lambda value: _shape(value) == (3,)),
    float: ("a real number", lambda value: _shape(value) == ()),
    int: ("an integer", lambda value: _shape(value) == () and float(value).is_integer()),
    bool: ("True or False", lambda value: isinstance(value, bool | np.bool_)),
    str: ("text", lambda value: isinstance(value, str)),
    os.PathLike: ("the name of a file", lambda value: isinstance(value, os.PathLike)),
    NoneType: ("None", lambda value: value is None),
    Callable: ("a function", callable),
}
_ARRAYS = dict.fromkeys(("Array", "ArrayLike", "Floats", "IndexArray", "NDArray"), _Numbers)


class _Names(dict[str, Any]):
    """Names in the annotations of a function; those that only type checkers import are public."""

    def __init__(self, function: Callable[..., Any]) -> None:
        known = unwrap(function).__globals__  # type: ignore[attr-defined]
        super().__init__(vars(builtins) | known | _ARRAYS | {"VectorLike": _Vector})

    def __missing__(self, name: str) -> Any:
        return getattr(sys.modules[str(__package__)], name, Any)


def fits(value: Any, hint: Any) -> bool:
    """True if a value is of the kind that an annotation asks for, as far as that can be told."""
    kind, of = get_origin(hint) or hint, get_args(hint)
    if kind in (Union, UnionType):
        return any(fits(value, each) for each in of)
    if kind is Literal:
        return isinstance(value, NoneType | str | bool | int) and value in of
    if kind in _KINDS:
        return _KINDS[kind][1](value)
    if kind is Any or not isinstance(kind, type) or getattr(kind, "_is_protocol", False):
        return True
    if isinstance(value, np.ndarray) and issubclass(kind, Iterable):
        return True
    return isinstance(value, kind) and (not of or _entries_fit(value, of))


def _entries_fit(value: Any, of: tuple[Any, ...]) -> bool:
    """True if the entries of a container fit; what can be gone through only once is believed."""
    if isinstance(value, Mapping) and len(of) == 2:
        return _entries_fit([*value], of[:1]) and _entries_fit([*value.values()], of[1:])
    if not isinstance(value, Collection):
        return True
    if isinstance(value, tuple) and of[-1] is not Ellipsis:
        return len(value) == len(of) and all(map(fits, value, of))
    return all(fits(each, of[0]) for each in value)


def _in_words(hint: Any) -> str:
    kind, of = get_origin(hint) or hint, get_args(hint)
    if kind in (Union, UnionType):
        return " or ".join(dict.fromkeys(map(_in_words, of)))
    if kind is Literal:
        return " or ".join(map(repr, of))
    if kind in _KINDS:
        return _KINDS[kind][0]
    name = getattr(kind, "__name__", str(kind))
    many = f" with {_in_words(of[0])} in it" if of and issubclass(kind, Collection) else ""
    return f"an object of type {name}{many}"


def _given(bound: BoundArguments) -> Iterator[tuple[str, Any, Any]]:
    """Name, value and annotation of what was given."""
    for name, value in bound.arguments.items():
        parameter = bound.signature.parameters[name]
        if parameter.kind is Parameter.VAR_KEYWORD:
            yield from ((each, given, parameter.annotation) for each, given in value.items())
        elif parameter.kind is Parameter.VAR_POSITIONAL:
            yield from ((name, given, parameter.annotation) for given in value)
        elif parameter.annotation is not Signature.empty:
            yield name, value, parameter.annotation


def _check(function: Callable[..., Any], args: Any, kwargs: Any, error: Exception) -> None:
    """Raise InputError from an error, if an argument of the call that raised it does not fit."""
    try:
        asked = signature(function, eval_str=True, locals=_Names(function))
        bound = asked.bind(*args, **kwargs)
    except TypeError:  # not a call of this function: Python's own message says why
        return
    item = function.__qualname__.removesuffix(".__init__")
    for name, value, hint in _given(bound):
        if not fits(value, hint):
            raise InputError(
                item, f"{name} = {shown(value)}, expected {_in_words(hint)}"
            ) from error
    for name, value, _ in _given(bound):
        if _shape(value) is not None and not np.isfinite(floats(value)).all():
            raise InputError(item, f"{name} = {shown(value)}, expected finite numbers") from error


def checked(thing: T) -> T:
    """A public function, or a class with its public methods, whose arguments are checked.

    Errors of Python or numpy become an InputError if an argument does not fit its annotation.

    Examples
    --------
    >>> @checked
    ... def halved(length: float) -> float:
    ...     return length / 2
    >>> halved(3.0)
    1.5
    >>> halved("long")
    Traceback (most recent call last):
        ...
    skfem_cosserat.errors.InputError: halved: length = 'long', expected a real number
    """
    if isinstance(thing, type):
        for name, own in list(vars(thing).items()):
            if name == "__init__" or not name.startswith("_"):
                _check_method(thing, name, own)
        return thing
    if not isinstance(thing, FunctionType) or isgeneratorfunction(thing):
        return thing

    @wraps(thing)
    def calling(*args: Any, **kwargs: Any) -> Any:
        try:
            return thing(*args, **kwargs)
        except CosseratError:
            raise
        except FOREIGN as error:
            _check(thing, args, kwargs, error)
            raise

    return calling


def _check_method(kind: type, name: str, own: Any) -> None:
    if isinstance(own, classmethod | staticmethod):
        type.__setattr__(kind, name, type(own)(checked(own.__func__)))
    elif isinstance(own, FunctionType):
        type.__setattr__(kind, name, checked(own))
