"""What makes a case the same case again: texts that change with functions and arguments."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Mapping
from functools import partial
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType
from typing import Any

import numpy as np
import skfem

from ..errors import InputError
from ..parallel.jobs import Caught
from ..version import VERSION

__all__ = ["digest", "identity", "token"]


def digest(text: str) -> str:
    """Twelve characters that stand for a text.

    Examples
    --------
    >>> digest("step = 0.1") == digest("step = 0.1"), digest("step = 0.1") == digest("step = 0.2")
    (True, False)
    """
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def token(value: Any, item: str) -> str:
    """Text that is the same for equal values, in this run of Python and in others.

    Numbers, text, arrays, containers, meshes and functions (by module, name, code, what is bound to
    them, and the numbers, texts and arrays that they take from their module) are told apart by
    themselves, all else by its pickled data.

    Raises
    ------
    InputError
        If a value cannot be pickled.

    Examples
    --------
    >>> token({"step": 0.5, "elements": (4, 8)}, "arguments")
    "{'elements': (4, 8), 'step': 0.5}"
    """
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        return repr(value)
    if isinstance(value, np.generic):
        return token(value.item(), item)
    if isinstance(value, np.ndarray):
        return f"array {value.shape} {value.dtype} {_bytes(value)}"
    if isinstance(value, list | tuple):
        return "(" + ", ".join(token(each, item) for each in value) + ")"
    if isinstance(value, set | frozenset):
        return "{" + ", ".join(sorted(token(each, item) for each in value)) + "}"
    if isinstance(value, Mapping):
        pairs = sorted((token(key, item), token(each, item)) for key, each in value.items())
        return "{" + ", ".join(f"{key}: {each}" for key, each in pairs) + "}"
    if isinstance(value, skfem.Mesh):
        names = token([value.boundaries, value.subdomains], item)
        return f"{type(value).__name__} {_bytes(value.p)} {_bytes(value.t)} {digest(names)}"
    if isinstance(value, partial):
        return f"partial({token([value.func, value.args, value.keywords], item)})"
    if isinstance(value, FunctionType):
        bound = [value.__defaults__, value.__kwdefaults__, _cells(value), _constants(value)]
        code = digest(_code(value.__code__) + token(bound, item))
        return f"{value.__module__}.{value.__qualname__} (code {code})"
    if isinstance(value, MethodType):
        return f"{token(value.__self__, item)}.{token(value.__func__, item)}"
    if isinstance(value, BuiltinFunctionType | type):
        return f"{value.__module__}.{value.__qualname__}"
    return _pickled(value, item)


def identity(**values: Any) -> dict[str, str]:
    """Tokens by name, with the version of the package: what all cases of a study share.

    Examples
    --------
    >>> list(identity(problem=print))
    ['problem', 'version of skfem-cosserat']
    """
    tokens = {name: token(value, f"argument {name}") for name, value in values.items()}
    return tokens | {"version of skfem-cosserat": VERSION}


def _bytes(array: Any) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()[:12]


def _cells(function: FunctionType) -> list[Any]:
    """What a function has taken along from around it; it may be itself that it calls."""
    contents = [cell.cell_contents for cell in function.__closure__ or ()]
    return [each for each in contents if each is not function]


def _constants(function: FunctionType) -> dict[str, Any]:
    """Plain data that a function takes from its module, by name: ``LENGTH = 2.0`` at its top."""
    around = function.__globals__
    names = sorted(name for name in _names(function.__code__) if not name.startswith("__"))
    return {name: around[name] for name in names if name in around and _plain(around[name])}


def _names(code: CodeType) -> set[str]:
    """Of what the instructions look up, also those of functions inside."""
    inner = (_names(each) for each in code.co_consts if isinstance(each, CodeType))
    return set(code.co_names).union(*inner)


def _plain(value: Any) -> bool:
    """Lists and dicts are not: functions keep their notes in them."""
    if isinstance(value, tuple):
        return all(_plain(each) for each in value)
    return isinstance(value, bool | int | float | complex | str | np.generic | np.ndarray)


def _code(code: CodeType) -> str:
    """Instructions and constants: comments, docstrings and the place in the file do not count."""
    constants = [
        _code(each) if isinstance(each, CodeType) else token(each, "constant")
        for each in code.co_consts
        if each is not Ellipsis
    ]
    document = code.co_consts[0] if code.co_consts else None
    if isinstance(document, str):
        constants = constants[1:]
    return f"{code.co_code.hex()} {code.co_names} {constants}"


def _pickled(value: Any, item: str) -> str:
    caught, data = Caught(), b""
    with caught:
        data = pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
    if caught.error is not None:
        raise InputError(
            item,
            f"holds an object of type {type(value).__name__!r} that cannot be recognised in a later"
            f" run ({caught.error}): use plain data and functions, or folder=None",
        ) from caught.error
    return f"{type(value).__name__} {hashlib.sha256(data).hexdigest()[:12]}"
