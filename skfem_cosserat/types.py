"""Array types used in annotations, and numbers from what a user gives."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeAlias, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray  # noqa: F401, others take it from here

from .errors import InputError

#: Real or complex numbers: kernels take complex input so that tangents can be checked by the
#: complex step.
Array: TypeAlias = NDArray[Any]
Floats: TypeAlias = NDArray[np.float64]
IndexArray: TypeAlias = NDArray[np.int64]
#: What is known of a result, by names: numbers, texts, lists and mappings of them.
Meta: TypeAlias = dict[str, Any]
#: Numbers of nothing.
NO_INDICES: IndexArray = np.zeros(0, np.int64)
#: The name of a file or folder.
FilePath: TypeAlias = str | os.PathLike[str]
#: Three numbers.
VectorLike: TypeAlias = Sequence[float] | NDArray[np.float64]

#: numbers closer than this, relative to what they are made of, are one and the same: what is left
#: is rounding
SAME = 1e-12
#: of lengths, sines and cosines in the reference configuration, and of places in elements
TOLERANCE = 1e-9
#: how many steps may be asked for: at a million a second these take eleven days
MOST = 10**12
#: so many names a message lists, and so many that are like the one asked for
LISTED, ALIKE = 12, 3
#: other words for the places of a beam
SYNONYMS = dict.fromkeys(("begin", "beginning", "first"), "start")
SYNONYMS |= dict.fromkeys(("last", "stop", "finish"), "end")


def numbers(item: str, name: str, value: Any) -> Floats:
    """Fresh array of real numbers (NaN included), or an error naming item and argument."""
    try:
        return floats(value)
    except OverflowError as error:
        raise InputError(item, f"{name} = {shown(value)}, too large for a number") from error
    except (TypeError, ValueError) as error:
        raise InputError(item, f"{name} = {shown(value)}, expected real numbers") from error


#: what :func:`floats` ends in
NUMBERLESS = (OverflowError, TypeError, ValueError)


def floats(value: Any) -> Floats:
    """A fresh array; text, None, truth values and complex numbers are no numbers (TypeError)."""
    array = np.asarray(value)
    if array.dtype.kind not in "iufO" or (array.dtype == object and None in list(array.flat)):
        raise TypeError
    return np.array(array, float)


def shaped(item: str, name: str, value: Any, *shapes: tuple[int, ...]) -> Floats:
    """Fresh array of finite numbers in one of these shapes, or an error naming the argument."""
    array = numbers(item, name, value)
    if array.shape not in shapes:
        expected = " or ".join(map(str, shapes))
        raise InputError(item, f"{name} has shape {array.shape}, expected {expected}")
    if not np.isfinite(array).all():
        raise InputError(item, f"{name} is not finite: {array.tolist()}")
    return array


def symmetric(item: str, name: str, value: Floats) -> Floats:
    """The mean of a matrix and its transpose, or an error if they differ by more than rounding."""
    skewed = float(abs(value - value.T).max())
    if skewed > SAME * abs(value).max():
        raise InputError(item, f"{name} is not symmetric by {skewed:.6g}: {value.tolist()}")
    return 0.5 * (value + value.T)


def shown(value: Any) -> str:
    """A value in an error, cut where it is long; Python does not write very long integers."""
    try:
        text = repr(value)
    except ValueError:
        return f"{type(value).__name__} of thousands of digits"
    return text if len(text) <= 60 else f"{text[:30]}...{text[-20:]}"


def real(item: str, name: str, value: Any, expected: str) -> float:
    """One number (not NaN), or an error saying what is expected; text and truth values are none."""
    try:
        out = floats(value)
    except NUMBERLESS:
        out = np.array(np.nan)
    if out.shape != () or np.isnan(out):
        raise InputError(item, f"{name} = {shown(value)}, expected {expected}")
    return float(out)


def switch(item: str, value: Any, name: str = "") -> bool:
    """True or False, or an error: any text would count as true."""
    if not isinstance(value, (bool, np.bool_)):
        given = f"{name} = {value!r}" if name else repr(value)
        raise InputError(item, f"{given}, expected True or False")
    return bool(value)


def spread(count: int, most: int = 20) -> IndexArray:
    """So many numbers from 0 on, or `most` of them, evenly spread, with the first and the last.

    Examples
    --------
    >>> spread(4, 20).tolist(), spread(11, 3).tolist()
    ([0, 1, 2, 3], [0, 5, 10])
    """
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)


def file_path(value: Any) -> Path:
    """The name of a file that the argument path gives, or an error."""
    if not isinstance(value, (str, os.PathLike)):
        raise InputError("argument path", f"{shown(value)}, expected the name of a file")
    if "\0" in os.fsdecode(value):
        raise InputError("argument path", f"{shown(value)}, names of files hold no zero character")
    return Path(os.fsdecode(value))


def finite(
    item: str, name: str, value: Any, expected: str = "a finite number", least: float = -np.inf
) -> float:
    """A finite number, from `least` on, or an error naming item and argument."""
    out = real(item, name, value, expected)
    if not (np.isfinite(out) and out >= least):
        raise InputError(item, f"{name} = {shown(value)}, expected {expected}")
    return out


def not_negative(item: str, name: str, value: Any) -> float:
    """A finite number from zero on, or an error naming item and argument."""
    return finite(item, name, value, "a finite number that is not negative", 0.0)


def positive(item: str, name: str, value: Any, unit: str = "") -> float:
    """A positive finite number, or an error naming item and argument."""
    return finite(item, name, value, f"a positive finite number{unit}", np.nextafter(0.0, 1.0))


def is_whole(value: object) -> TypeGuard[int]:
    """True if a value is an integer; truth values are none."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def whole(item: str, value: Any, least: int | None, name: str = "") -> int:
    """An integer, from `least` on if there is one, or an error naming item and argument."""
    if not is_whole(value) or (least is not None and value < least):
        given = f"{name} = {shown(value)}" if name else shown(value)
        expected = "an integer" if least is None else f"an integer from {least} on"
        raise InputError(item, f"{given}, expected {expected}")
    return int(value)


def numbered(item: str, value: Any, count: int, what: str) -> int:
    """Number of one of so many items, from 0 on; negative numbers count from the end."""
    if not is_whole(value) or not -count <= value < count:
        raise InputError(item, f"{value!r}, expected an integer: there are {count} {what}")
    return int(value) % count


def check_kind(item: str, value: object, kind: type, more: str = "") -> None:
    """Raise InputError if a value is not of a type; `more` says where one comes from."""
    if isinstance(value, kind):
        return
    if isinstance(value, type) and issubclass(value, kind):
        name = value.__name__
        raise InputError(item, f"got the class {name}, expected an object of it: {name}()")
    raise InputError(item, f"{value!r}, expected an object of type {kind.__name__}{more}")


def names_known(name: object, known: Iterable[object], what: str = "known", ask: str = "") -> str:
    """Names for an error about one that does not exist, those most like it first.

    Parameters
    ----------
    name : object
        What was asked for.
    known : iterable of str
        What there is.
    what : str
        In front of the list.
    ask : str
        Expression that gives all names, where they may be too many for a message.

    Examples
    --------
    >>> names_known("tipp", ["root", "tip"])
    "did you mean 'tip'? known: 'root', 'tip'"
    >>> names_known("angle", [f"joint/{k}/angle" for k in range(30)], ask="list(history)")
    "did you mean 'joint/0/angle', 'joint/1/angle' or 'joint/2/angle'? (all: list(history))"
    >>> names_known("rod.begin", ["rod.start", "rod.end"])
    "did you mean 'rod.start'? known: 'rod.start', 'rod.end'"
    """
    names = list(dict.fromkeys(map(str, known)))
    beam, dot, place = str(name).rpartition(".")
    wanted = beam + dot + (SYNONYMS.get(place, place) if dot else place)
    near = [each for each in names if wanted and wanted in each][:ALIKE]
    of_beam = [each for each in names if dot and each.startswith(beam + dot)]
    if of_beam and not near:  # what all of them begin with makes none of them alike
        start = len(beam + dot)
        tails = get_close_matches(wanted[start:], [each[start:] for each in of_beam], 1)
        near = [beam + dot + tail for tail in tails]
    elif not near:
        near = get_close_matches(wanted, names, ALIKE, cutoff=0.75)
        near = near or get_close_matches(wanted, names, 1)
    quoted = [repr(each) for each in near]
    either = " or ".join([", ".join(quoted[:-1]), *quoted[-1:]][len(quoted) < 2 :])
    question = f"did you mean {either}?" if near else ""
    every = f" (all: {ask})" if ask else f" ({len(names)} names)"
    if len(names) <= LISTED:
        listed = f"{what}: {', '.join(map(repr, names)) or 'none'}"
        return f"{question} {listed}".strip()
    first = ", ".join(map(repr, names[:LISTED]))
    return f"{question}{every}" if near else f"{what}: {first}, ...{every}"


def largest(*terms: Array) -> float:
    """Largest magnitude in any of the arrays; zero if they are empty."""
    every = terms[0] if len(terms) == 1 else np.concatenate(terms)
    return float(np.maximum.reduce(abs(every), axis=None)) if every.size else 0.0
