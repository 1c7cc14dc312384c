"""Arguments of public calls: one that does not fit the signature is named in an InputError.

Constructors and functions check what they know best themselves, with :mod:`skfem_cosserat.types`.
All else that an argument has to be stands in its annotation, which is read when a call has failed:
calls that are right pay nothing.
"""

from __future__ import annotations

import builtins
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import wraps
from inspect import Parameter, signature, unwrap
from types import FunctionType, GenericAlias, NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin

import numpy as np

from .errors import CosseratError, InputError
from .types import NUMBERLESS, Floats, floats, shown

T = TypeVar("T")

#: errors of Python and numpy that a bad argument can end in
FOREIGN = TypeError, ValueError, AttributeError, LookupError, ArithmeticError, NotImplementedError


class _Numbers:
    """Real numbers in an array of any shape."""


class _Array:
    """Real numbers in an array, not a single one."""


class _Vector:
    """Three real numbers."""


class _Names(dict[str, Any]):
    """Names in annotations; those that only type checkers import are public ones."""

    def __missing__(self, name: str) -> Any:
        return getattr(sys.modules[str(__package__)], name, Any)


def _sizes(value: Any) -> Floats:
    """Real numbers, no numbers of anything else."""
    try:
        return floats(value)
    except NUMBERLESS:
        return np.zeros((0,) * 9)


#: what an annotation asks for, in words, and whether a value is that
_KINDS: dict[Any, tuple[str, Callable[[Any], bool]]] = {
    _Numbers: ("real numbers", lambda value: _sizes(value).ndim < 9),
    _Array: ("an array of numbers", lambda value: 0 < _sizes(value).ndim < 9),
    _Vector: ("three real numbers", lambda value: _sizes(value).shape == (3,)),
    float: ("a real number", lambda value: _sizes(value).shape == ()),
    int: ("an integer", lambda value: isinstance(value, (int, np.integer))),
    NoneType: ("None", lambda value: value is None),
    Any: ("anything", lambda value: True),
    ...: ("", lambda value: False),  # of tuple[float, ...]
}
#: names of these in annotations
_ARRAYS: dict[str, type] = {"ArrayLike": _Numbers, "VectorLike": _Vector}
_ARRAYS |= dict.fromkeys(("Array", "Floats", "IndexArray"), _Array)


def fits(value: Any, hint: Any) -> bool:
    """True if a value is what an annotation asks for, as far as that can be told."""
    kind = get_origin(hint) or hint
    of = get_args(hint)
    if kind in (Union, UnionType):
        return any(fits(value, each) for each in of)
    if kind is Literal:
        return repr(value) in map(repr, of)
    if kind in _KINDS:
        return _KINDS[kind][1](value)
    kind = Sequence if kind in (list, tuple) else kind  # each is taken for the other
    if isinstance(value, np.ndarray) and value.ndim and kind in (Sequence, Iterable, Collection):
        value = list(value)
    try:
        if not isinstance(value, kind):
            return False
    except TypeError:  # a type variable, or a protocol, which cannot be asked
        return True
    if isinstance(value, Mapping):
        value = value.values()
        of = of[-1:]
    inside = value if of and isinstance(value, Collection) else ()
    return all(any(fits(entry, each) for each in of) for entry in inside)


def _in_words(hint: Any) -> str:
    kind = get_origin(hint) or hint
    of = [each for each in get_args(hint) if each is not ...]
    if kind in (Union, UnionType, Literal):
        return " or ".join(dict.fromkeys(map(_in_words, of)))
    if kind in _KINDS:
        return _KINDS[kind][0]
    inside = f" of {_in_words(of[-1])}" if of and issubclass(kind, Iterable) else ""
    return getattr(kind, "__name__", repr(kind)) + inside


def _check(function: Callable[..., Any], args: Any, kwargs: Any, error: Exception) -> None:
    """Raise InputError from an error, if an argument of the call that ended in it does not fit."""
    names = vars(builtins) | unwrap(function).__globals__ | _ARRAYS
    try:
        asked = signature(function, eval_str=True, locals=_Names(names))
        given = asked.bind(*args, **kwargs).arguments
    except TypeError:  # no call of this function: Python's own text says why
        return
    hints = {name: each.annotation for name, each in asked.parameters.items()}
    for name, each in asked.parameters.items():
        if each.kind is Parameter.VAR_POSITIONAL:
            hints[name] = GenericAlias(tuple, (each.annotation, ...))
        elif each.kind is Parameter.VAR_KEYWORD or each.annotation is Parameter.empty:
            given.pop(name, None)
    unfit = {name: _in_words(hints[name]) for name in given if not fits(given[name], hints[name])}
    endless = [name for name in given if not np.isfinite(_sizes(given[name])).all()]
    for name, expected in (unfit or dict.fromkeys(endless, "finite numbers")).items():
        text = f"{name} = {shown(given[name])}, expected {expected}"
        raise InputError(function.__qualname__.removesuffix(".__init__"), text) from error


def checked(thing: T) -> T:
    """A public function, or a class with its public methods, whose arguments are checked.

    Errors of Python or numpy become an InputError where an argument does not fit its annotation.

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
    if isinstance(thing, classmethod):
        return type(thing)(checked(thing.__func__))
    if isinstance(thing, type):
        for name, own in list(vars(thing).items()):
            public = name == "__init__" or not name.startswith("_")
            if public and isinstance(own, (FunctionType, classmethod)):
                type.__setattr__(thing, name, checked(own))
        return thing
    function = cast("Callable[..., Any]", thing)

    @wraps(function)
    def calling(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except CosseratError:
            raise
        except FOREIGN as error:
            _check(function, args, kwargs, error)
            raise

    return cast("T", calling)
