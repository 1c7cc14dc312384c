"""Why a job cannot travel: the load, drive or argument that holds what cannot be pickled."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from functools import partial
from types import BuiltinFunctionType, FunctionType, MethodType
from typing import Any, NamedTuple

from ..errors import InputError
from ..frames import Item
from ..model import Model, System
from .jobs import Caught, Job

__all__ = ["refusal"]

#: what to do about a function
ADVICE = (
    "write functions with def at the top level of an importable module (parameters by"
    " functools.partial), give loads a Table, or run with executor=None"
)


class _Culprit(NamedTuple):
    """What cannot be pickled, and where it is."""

    where: str
    what: str


def refusal(job: Job, error: BaseException) -> InputError:
    """The error for a job that cannot be pickled: names all that stands in the way."""
    label = f"job {job.name!r}"
    named = {"function": job.function}
    named |= {f"argument {k + 1}": value for k, value in enumerate(job.args)}
    named |= {f"argument {name}": value for name, value in job.kwargs.items()}
    found: list[_Culprit] = []
    seen: set[int] = set()
    for where, value in named.items():
        found += _culprits(value, where, seen)
    if not found:  # each can go alone, but not all together
        return InputError(label, f"cannot be sent to another process: {error}; {ADVICE}")
    first, *others = found
    what = "; ".join([first.what, *(f"{each.where}: {each.what}" for each in others)])
    return InputError(
        f"{label}, {first.where}", f"{what} cannot be sent to another process: {ADVICE}"
    )


def _culprits(value: Any, where: str, seen: set[int]) -> Iterator[_Culprit]:
    """The smallest parts that cannot be pickled, each once."""
    if id(value) in seen or _travels(value):
        return
    seen.add(id(value))
    if isinstance(value, Item) and not isinstance(value, type):
        where = value.label
    parts = [part for part in _parts(value) if not _travels(part)]
    if not parts:
        yield _Culprit(where, _named(value))
    for part in parts:
        yield from _culprits(part, where, seen)


def _travels(value: Any) -> bool:
    trial = Caught()
    with trial:
        pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
    return trial.error is None


def _parts(value: Any) -> list[Any]:
    """What an object is pickled with, as far as it is ours or a container."""
    if isinstance(value, System):
        return list(value.__reduce__()[1])
    if isinstance(value, Model):
        return [value[name] for name in value]
    if isinstance(value, list | tuple | set | frozenset):
        return list(value)
    if isinstance(value, dict):
        return [*value.keys(), *value.values()]
    if isinstance(value, MethodType):
        return [value.__self__]
    if isinstance(value, partial):
        return [value.func, *value.args, *value.keywords.values()]
    if type(value).__module__.split(".")[0] == __name__.split(".")[0]:
        return list(getattr(value, "__dict__", {}).values())
    return []


def _named(value: Any) -> str:
    if isinstance(value, FunctionType | BuiltinFunctionType | type):
        return f"{value.__qualname__!r} of module {value.__module__!r}"
    return f"an object of type {type(value).__name__!r}"
