"""Arrays of a scene as structures for kernels, and what is in each."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..types import IndexArray

# -- many arrays as one argument of compiled kernels: their addresses and shapes, side by side -----
#
# Python fills the memory, so nothing has to be compiled for it, and the arrays belong to Python:
# what kernels take out of a structure counts no references. Kinds are named by a digest of their
# fields: names of all arguments go into symbols and into names of files, many times over. Numba's
# types for them are in :mod:`.numba_types`: only compiling needs these.


@dataclass(frozen=True)
class ArrayField:
    """A contiguous array of numbers of a dtype, by numpy's text for it."""

    dtype: str
    ndim: int


class Kind:
    """Layout of a structure: names and types of its fields.

    A field is an :class:`ArrayField`, a structure (its kind), a number (``float``, ``int`` or
    ``bool``), or a tuple of such.
    """

    def __init__(self, family: str, fields: dict[str, Any]) -> None:
        text = repr([(name, _text(field)) for name, field in fields.items()])
        self.name = f"{family}_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
        self.family, self.fields = family, fields
        self.places, end = {}, 0
        for name, field in fields.items():
            self.places[name] = end
            end += _words(field)

    def __repr__(self) -> str:
        return self.name


#: by family, names and fields; as few as there are kinds
_KINDS: dict[tuple[Any, ...], Kind] = {}
_NUMBER, _BITS = struct.Struct("d"), struct.Struct("q")


def _text(field: Any) -> str:
    if isinstance(field, tuple):
        return f"({', '.join(map(_text, field))})"
    return field.__name__ if isinstance(field, type) else repr(field)


def _words(field: Any) -> int:
    """Words of memory that a field takes: arrays as numba has them, tuples of numbers, numbers.

    A structure inside another one takes its address.
    """
    if isinstance(field, ArrayField):
        return 5 + 2 * field.ndim
    if isinstance(field, tuple):
        return sum(map(_words, field))
    if isinstance(field, Kind) or field in (float, int, bool):
        return 1
    raise TypeError(f"compiled kernels take no field of type {field}")


def _field(name: str, value: Any) -> Any:
    """Type of the field that holds a value."""
    if isinstance(value, np.ndarray):
        flags = value.flags
        if not (flags.c_contiguous and flags.aligned):
            raise TypeError(f"array {name} for compiled kernels is not contiguous")
        return ArrayField(value.dtype.str, value.ndim)
    if isinstance(value, Structure):
        return value.kind
    if isinstance(value, tuple):
        return tuple(_field(name, each) for each in value)
    return type(value)


def _put(value: Any, out: list[int]) -> None:
    """Add what is in memory for a field: of numbers their bits."""
    if isinstance(value, np.ndarray):
        out += (0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides)
    elif isinstance(value, tuple):
        for each in value:
            _put(each, out)
    elif isinstance(value, Structure):
        out.append(value.address)
    elif isinstance(value, float):
        out += _BITS.unpack(_NUMBER.pack(value))
    else:
        out.append(int(value))


class Structure:
    """Fields of compiled kernels in memory.

    Parameters
    ----------
    family : str
        Such as "beams".
    names : sequence of str
    values : sequence
        Contiguous arrays, numbers, tuples of numbers or of such tuples, structures. Arrays and
        structures are shared.
    """

    __slots__ = ("_memory", "_values", "address", "kind")

    def __init__(self, family: str, names: Sequence[str], values: Sequence[Any]) -> None:
        fields = tuple(map(_field, names, values))
        key = family, tuple(names), fields
        kind = _KINDS.get(key)
        if kind is None:
            made = Kind(family, dict(zip(names, fields, strict=True)))
            kind = _KINDS.setdefault(key, made)  # that of another thread, if it was faster
        self.kind = kind
        self._values = tuple(values)
        entries: list[int] = []
        for value in values:
            _put(value, entries)
        self._memory = np.array(entries, dtype=np.int64)
        self.address = self._memory.ctypes.data

    def __reduce_ex__(self, protocol: object) -> Any:
        """A copy would have its numbers, which are addresses in arrays of this one."""
        raise TypeError("what kernels work in cannot be copied or pickled")


class Groups(Structure):
    """Groups of beams as one argument: what calls their parts is compiled once for all beams.

    Of beam parts, tables of scenes have the address of a row here, with that of each group's part;
    see :func:`.jit.call_beams`.

    Parameters
    ----------
    members : sequence of Structure
        Of :func:`beams` or :func:`beams_by_law`.
    numbers : sequence of (array or None)
        Numbers of a step that a member takes in place of those of the scene.
    parts : sequence of str
        Names of beam parts.
    """

    __slots__ = ("_kept", "_parts", "_rows", "members")

    def __init__(
        self, members: Sequence[Structure], numbers: Sequence[Any], parts: Sequence[str]
    ) -> None:
        places = np.array([each.address for each in members], dtype=np.int64)
        own = [0 if each is None else each.ctypes.data for each in numbers]
        others = np.array(own, dtype=np.int64)
        self.members, self._kept = tuple(members), (places, others, tuple(numbers))
        self._parts = tuple(parts)
        self._rows = np.zeros((len(parts), len(members)), dtype=np.int64)
        ends = len(members), places.ctypes.data, others.ctypes.data
        super().__init__("groups", ("count", "places", "numbers"), ends)

    def place(self, name: str, addresses: Sequence[int]) -> int:
        """Address of the row of a part, of which each member has its own."""
        row = self._rows[self._parts.index(name)]
        row[:] = addresses
        return int(row.ctypes.data)


#: all that a projection of velocities takes; looks at k states: q, p and v (k, rows, 3), energies
#: (k, 2); steps; an iteration to an equilibrium, with right-hand
#: sides (2, each, 6), solutions (2, 2, each, 6) and what else it gives
PROJECTION = ("parts", "tree", "plan", "work", "beams", "numbers")
LOOKS = (*PROJECTION, "q", "p", "v", "energies")
STEPS = (*PROJECTION, "record", "carried")
EQUILIBRIUM = (*PROJECTION, "residuals", "increments", "pivots")


def structure(family: str, fields: Mapping[str, Any]) -> Structure:
    """One argument of kernels, made of what is given by name."""
    return Structure(family, [*fields], [*fields.values()])


def integers(numbers: Sequence[Any] | IndexArray) -> IndexArray:
    """Integers as an array for kernels."""
    return np.array(numbers, dtype=np.int64).reshape(len(numbers))


def flags(values: Sequence[bool] | NDArray[np.bool_]) -> Any:
    """Truth values as an array for kernels."""
    return np.array(values, dtype=bool).reshape(len(values))
