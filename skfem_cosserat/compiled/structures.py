"""Arrays of a scene as structures for kernels, and what is in each."""

from __future__ import annotations

import ctypes
import hashlib
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..types import IndexArray

__all__ = [
    "BEAMS",
    "BEAMS_BY_LAW",
    "CARRIED",
    "EQUILIBRIUM",
    "FAMILIES",
    "FLOW",
    "LAW_POINTS",
    "LOOKS",
    "PLAN",
    "PROJECTION",
    "STEPS",
    "TREE",
    "WORK",
    "ArrayField",
    "Groups",
    "Kind",
    "Structure",
    "array_field",
    "flags",
    "integers",
    "roomy",
    "structure",
]


# -- many arrays as one argument of compiled kernels: their addresses and shapes, side by side -----
#
# Python fills the memory, so nothing has to be compiled for it, and the arrays belong to Python:
# what kernels take out of a structure counts no references. Kinds are named by a digest of their
# fields: names of all arguments go into symbols and into names of files, many times over. Numba's
# types for them are in :mod:`.numba_types`: only compiling needs these.


class ArrayField:
    """A contiguous array; one for each kind of them, from :func:`array_field`."""

    __slots__ = ("dtype", "ndim")

    def __init__(self, dtype: str, ndim: int) -> None:
        self.dtype, self.ndim = dtype, ndim

    def __repr__(self) -> str:
        return f"array({self.dtype}, {self.ndim}d)"


_ARRAYS: dict[tuple[Any, int], ArrayField] = {}


def array_field(dtype: Any, ndim: int) -> ArrayField:
    """Of arrays of a dtype of numpy."""
    key = dtype, ndim
    return _ARRAYS.get(key) or _ARRAYS.setdefault(key, ArrayField(dtype.str, ndim))


class Kind:
    """What is in a structure: names of its fields, and what each of them is.

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
    """What a field takes of the memory: arrays as numba has them, tuples of numbers, numbers.

    A structure inside another one takes its address.
    """
    if isinstance(field, ArrayField):
        return 5 + 2 * field.ndim
    if isinstance(field, tuple):
        return sum(map(_words, field))
    if isinstance(field, Kind) or field in (float, int, bool):
        return 1
    raise TypeError(f"compiled kernels take no field of type {field}")


_BYTES = ctypes.c_char * 0


def _place_of(array: Any) -> int:
    """Where its numbers are; of those that can be written to four times as fast as from numpy."""
    try:
        return ctypes.addressof(_BYTES.from_buffer(array))
    except TypeError:
        return int(array.ctypes.data)


def _field(name: str, value: Any) -> Any:
    """What a value is as a field."""
    if isinstance(value, np.ndarray):
        flags = value.flags
        if not (flags.c_contiguous and flags.aligned):
            raise TypeError(f"array {name} for compiled kernels is not contiguous")
        return array_field(value.dtype, value.ndim)
    if isinstance(value, Structure):
        return value.kind
    if isinstance(value, tuple):
        return tuple(_field(name, each) for each in value)
    return type(value)


def _put(value: Any, out: list[int]) -> None:
    """Add what is in memory for a field: of numbers their bits."""
    if isinstance(value, np.ndarray):
        out += (0, 0, value.size, value.itemsize, _place_of(value), *value.shape, *value.strides)
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
        self.address = _place_of(self._memory)

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
        own = [0 if each is None else _place_of(each) for each in numbers]
        others = np.array(own, dtype=np.int64)
        self.members, self._kept = tuple(members), (places, others, tuple(numbers))
        self._parts = tuple(parts)
        self._rows = np.zeros((len(parts), len(members)), dtype=np.int64)
        ends = len(members), _place_of(places), _place_of(others)
        super().__init__("groups", ("count", "places", "numbers"), ends)

    def place(self, name: str, addresses: Sequence[int]) -> int:
        """Address of the row of a part, of which each member has its own."""
        row = self._rows[self._parts.index(name)]
        row[:] = addresses
        return _place_of(row)


# -- arrays of a frozen system as the compiled kernels take them: one argument for many arrays -----

#: strains that elements hold by rows: which ones; of each element, Gauss point and such strain its
#: place in vectors and among rows, and in the matrix where the blocks with each node begin; what
#: multipliers add to the stresses of geometric terms; which rows are chosen, and their weights
HELD = ("holds", "held", "held_on", "held_down", "held_up", "held_stress", "row_on", "row_weight")
#: elements of one interpolation: shape functions and slopes at Gauss points as tuples, so that
#: their numbers are known when compiling; first rows of y of the nodes; slots of the blocks
BEAMS = (
    *("N", "dN", "weights", "base", "slot", "lengths", "section", "stiffness", "reference", "mass"),
    *("diagonal", "rotations", "turned", "S0", "S", "predicted", *HELD),
)
#: elements of which some have a stored energy: stiffness by Gauss points, S0 the strains at the
#: start; beside these the strains, the address of :func:`.laws.law_points`, which makes stresses
#: and stiffness of them, and what it takes
BEAMS_BY_LAW = (*BEAMS, "strains", "law", "points")
#: Gauss points of such elements, one after the other: numbers of their laws (-1: quadratic),
#: strains at the start of a step and now, stresses, their derivative (n, 36) and that at zero
#: strain. What laws give: energies at both ends, stresses in the middle and at the end, derivatives
#: along the increment. Whether the derivative is that of these strains; what is called back. Of
#: each law: addresses of functions (0: called back), zero for strains that are held, the metric of
#: increments, steps of derivatives, its noise
LAW_POINTS = (
    *("law", "start", "strains", "stresses", "moduli", "stiffness"),
    *("before", "after", "middle", "last", "along", "known", "called"),
    *("functions", "free", "metric", "steps", "noise"),
)
#: vertices of moments and whether these follow; of each pair of vertices that a force fixed in a
#: body, or drag, couples: first rows of y of where it acts and of what it depends on, and the slot
#: of their block
FOLLOWING = ("moment_vertex", "moment_follows", "follower")
#: force elements: integers, matrices of laws, entries of the matrices of invariants
COUPLINGS = ("coupling", "coupling_law", "coupling_entry", "coupling_factor")
#: vertices, edges (joints from parent to child) and their coordinates, driven ones as in
#: :func:`.tree.prescribe`; what holds an equilibrium, see :mod:`.static`
TREE = (
    *(
        "row",
        "framed",
        "free",
        "loose",
        "R",
        "triads",
        "turn",
        "swing",
        "followed",
        "value",
        "drives",
        "turning",
    ),
    *("child", "parent", "child_row", "parent_row", "parent_frame", "guide_frame", "relative"),
    *("sphere", "open", "child_offset", "parent_offset", "arm0"),
    *("fulcrum_row", "fulcrum_offset", "fulcrum_vertex", "first"),
    *("kind", "own", "axis", "right", "axis0", "guide_row", "guide_vertex"),
    *("target_row", "target_offset", "target_vertex"),
    *("centre_row", "centre_offset", "centre_vertex"),
    *("mass_data", "mass_indices", "mass_indptr"),
    *("row_products", "row_factors", "row_linear", "row_linear_factors", "row_constant"),
    *("row_size", "row_on", "row_kept", "row_weight", "row_weighted", "row_pairs"),
    *("row_triple", "row_owner"),
    *("cosines", "cosine_factors", "cosine_constant", "cosine"),
    *("triple", "frame_vertex", "frame_masses", "point_vertex", "point_masses"),
    *FOLLOWING,
    *COUPLINGS,
    "hold",
)
#: the order of elimination, neighbours still to come, slots of blocks; how many are eliminated in
#: blocks, and what is called back to solve for the rest (0: none)
PLAN = (
    *("order", "edge", "parent", "size", "diag", "ptr", "neighbour", "right", "down"),
    *("update_ptr", "update", "parent_at", "to_parent", "rest"),
)
#: what changes during a step. Dampers act by the way from `earlier` to `later`, whose middle is
#: `mid`: from y0 to y1, or as far before and behind the end of a step as the velocity there goes;
#: then `rate0` is the velocity at the start, and `drift` what of that at the end is known
WORK = (
    *("y0", "p0", "external", "ground1", "y1", "mid", "R", "momentum", "internal"),
    *("earlier", "later", "rate0", "drift"),
    *("R_mixed", "change", "F", "F_mixed", "b", "x", "total", "last", "extra", "twist", "A"),
    *("closing", "before", "found", "carried", "frames", "lower", "upper", "S_kept"),
    *("X_kept", "S_left", "X_left", "S_right", "X_right", "C_child", "C_parent", "scratch"),
    *("dead", "moments", "followers", "coupled", "flow"),
)
#: velocities with a damped relative part: of rows of y their connected part, ends of runs
#: of one part, slots by entries of the mass matrix; what is summed up over parts, see :mod:`.flow`
FLOW = (
    *(
        "owner",
        "runs",
        "holder",
        "local",
        "slot",
        "free",
        "total",
        "lift",
        "mu",
        "ones",
        "scheme",
        "begin",
    ),
    *("sums", "turn", "rest", "mdq", "column", "kept", "forms", "motion", "twists"),
    *("schur", "scratch"),
)
#: by rows in space, whatever the unknowns are: both ends of a step, the mass matrix; rates that are
#: carried on, one block of rows after the other, and the numbers of the scheme for them; addresses
#: of what moves velocities, with the rows it takes and gives, and the change of momentum; what
#: dampers take of the rates, see `WORK`; what is kept of each of the steps in one go; where loads
#: are taken from, and those of each of the steps; numbers of viscous elements
CARRIED = (
    *("y0", "y1", "p0", "carried", "mass_data", "mass_indices", "mass_indptr"),
    *("rates", "after", "table", "before", "moved", "scratch", "rate0", "drift", "of_drift"),
    *("nearest", "near_y", "near_p", "velocity", "change", "flow", "normal", "limit"),
    *("R", "closing", "moved_force", "log_q", "log_p", "log_rates", "log_impulse", "log_turns"),
    *("log_numbers", "viscous"),
    *("dead", "moments", "followers", "all_dead", "all_moments", "all_followers"),
    *("all_driven", "ground1", "all_ground"),
)
#: all that a projection of velocities takes; looks at k states: q, p and v (k, rows, 3), energies
#: (k, 2); steps; an iteration to an equilibrium, with right-hand
#: sides (2, each, 6), solutions (2, 2, each, 6) and what else it gives
PROJECTION = ("parts", "tree", "plan", "work", "beams", "numbers")
LOOKS = (*PROJECTION, "q", "p", "v", "energies")
STEPS = (*PROJECTION, "record", "carried")
EQUILIBRIUM = (*PROJECTION, "residuals", "increments", "pulled", "pivots")
#: fields of each kind of structure
FAMILIES = {
    "beams": BEAMS,
    "beams_by_law": BEAMS_BY_LAW,
    "law_points": LAW_POINTS,
    "tree": TREE,
    "plan": PLAN,
    "work": WORK,
    "carried": CARRIED,
    "flow": FLOW,
    "projection": PROJECTION,
    "looks": LOOKS,
    "steps": STEPS,
    "equilibrium": EQUILIBRIUM,
}


def structure(family: str, fields: Mapping[str, Any]) -> Structure:
    """Of a kind, from what is in it by name; there may be more than it takes."""
    names = FAMILIES[family]
    return Structure(family, names, [fields[name] for name in names])


def integers(numbers: Sequence[Any] | IndexArray) -> IndexArray:
    """As the kernels take them."""
    return np.array(numbers, dtype=np.int64).reshape(len(numbers))


def roomy(values: NDArray[Any]) -> Any:
    """The same, with zeros in memory for one row more: kernels put there what is nowhere else."""
    out = room(values.shape, values.dtype)
    out[:] = values
    return out


def room(shape: tuple[int, ...], kind: Any = float) -> Any:
    """Zeros of this shape, and in memory for one row more; see :func:`roomy`."""
    return np.zeros((shape[0] + 1, *shape[1:]), dtype=kind)[:-1]


def flags(values: Sequence[bool] | NDArray[np.bool_]) -> Any:
    """As the kernels take them."""
    return np.array(values, dtype=bool).reshape(len(values))
