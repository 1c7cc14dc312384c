"""Files of histories: blocks with checksums, and the plain data they take."""

from __future__ import annotations

import contextlib
import json
import mmap
import os
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from math import prod
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from ..arguments import checked
from ..errors import HistoryError, IncompleteWarning, InputError, StorageError
from ..types import Array, FilePath, file_path, switch
from ..warn import logger, warn

# -- what a history keeps of an event --------------------------------------------------------------


class EventRecord(NamedTuple):
    """An event of a run.

    Attributes
    ----------
    time : float
        (s)
    name : str
    value : float
        What its condition gave there, beyond zero by what its time is located to.
    row : int
        The recorded state, before what the event does; where the scene or the state has changed
        the next row has the same time and is the state after it.
    step : int
        Number of the step, a shortened one, that ends there.
    loss : float
        Energy (J) that it took out of the scene.
    action : str
        What it did.

    Examples
    --------
    >>> print(EventRecord(0.25, "catch", 1e-13, 26, 26, 0.5, "ActionLock(knee)"))
    t = 0.25 s: 'catch', ActionLock(knee), takes 0.5 J
    """

    time: float
    name: str
    value: float
    row: int
    step: int
    loss: float
    action: str

    def __str__(self) -> str:
        lost = f", takes {self.loss:.6g} J" if self.loss else ""
        return f"t = {self.time:.9g} s: {self.name!r}, {self.action}{lost}"


# -- checks and conversions that keep a history plain: JSON data and arrays of numbers -------------

#: Kinds of numpy types a history may hold: bool, integers, floats, complex numbers, text.
KINDS = "biufcU"

#: Series every history has, with the shape after the first axis (None: any length).
BASIC = ("t", "step", "q", "p")


#: types of most entries, which are kept as they are
_PLAIN = frozenset({str, int, float, bool, type(None)})


def plain(value: Any, item: str) -> Any:
    """Convert ``value`` to JSON data: numpy numbers and arrays, tuples and dicts are accepted.

    Parameters
    ----------
    value : object
        None, bool, int, float (NaN and infinity too), str, numpy scalars and arrays, and lists,
        tuples and dicts (with names as keys) of these.
    item : str
        Name of the value for the error.

    Raises
    ------
    InputError
        If something else is found inside; the error names the place.

    Examples
    --------
    >>> plain({"step": np.float64(0.5), "parts": ("a", "b")}, "meta")
    {'step': 0.5, 'parts': ['a', 'b']}
    """
    if isinstance(value, np.generic | np.ndarray):
        return plain(value.tolist(), item)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, list | tuple):
        return [
            entry if type(entry) in _PLAIN else plain(entry, f"{item}[{k}]")
            for k, entry in enumerate(value)
        ]
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise InputError(item, f"key {key!r} is not a string")
        return {
            str(key): entry if type(entry) in _PLAIN else plain(entry, f"{item}[{key!r}]")
            for key, entry in value.items()
        }
    raise InputError(item, f"got {type(value).__name__}, expected JSON data (numbers, text, lists)")


def series_numbers(value: Any, item: str) -> Array:
    """Return ``value`` as an array of a type that can be stored (see `KINDS`).

    Raises
    ------
    InputError
        If the array holds objects or records.
    """
    array = np.asarray(value)
    if array.dtype.kind not in KINDS:
        raise InputError(item, f"got data type {array.dtype}, expected numbers or text")
    if array.dtype.byteorder == ">":
        array = array.astype(array.dtype.newbyteorder("<"))
    return array


def check_loaded(
    meta: Mapping[str, Any],
    static: Mapping[str, Array],
    series: Mapping[str, Array],
    sensors: Mapping[str, Array],
) -> None:
    """Check what a file says against what a history is: sums cannot tell who wrote it.

    Parameters
    ----------
    meta, static, series, sensors : mapping
        As read.

    Raises
    ------
    InputError
        If a basic series is missing.
    TypeError, ValueError, LookupError
        For anything else, saying what.
    """
    check_basic(series, "series")
    t = series["t"]
    if t.ndim != 1 or any(series[name].dtype.kind not in "fiu" for name in BASIC):
        raise ValueError("shapes or types of the series t, step, q, p")
    if any(array.ndim == 0 or len(array) != len(t) for array in series.values()):
        raise ValueError("series of different lengths")
    for name, array in (*static.items(), *series.items(), *sensors.items()):
        if array.size and array.dtype.kind in "Ub":
            unit, top = (np.uint32, 0x10FFFF) if array.dtype.kind == "U" else (np.uint8, 1)
            if np.ascontiguousarray(array).reshape(-1).view(unit).max() > top:
                raise ValueError(f"array {name!r} holds what is no value of its type")
    _check_sensors(meta, sensors)
    for number in [about["row"] for about in meta.get("segments", [])]:
        if type(number) is not int or number < 0:
            raise ValueError(f"segment from row {number!r}")
    for event in meta.get("events", []):
        record = EventRecord(**event)
        if type(record.row) is not int or record.row < 0:
            raise ValueError(f"event at row {record.row!r}")


def _check_sensors(meta: Mapping[str, Any], sensors: Mapping[str, Array]) -> None:
    for name, array in sensors.items():
        base, _, part = name.rpartition("/")
        other = sensors[f"{base}/{'x' if part == 't' else 't'}"]
        if part not in ("t", "x") or not array.ndim or array.shape[:1] != other.shape[:1]:
            raise ValueError(f"instants and values of sensor {base!r}")
        if array.dtype.kind not in "fiu" or (part == "t" and array.ndim != 1):
            raise ValueError(f"values of sensor {base!r}")
    for name, about in meta.get("sensors", {}).items():
        if not isinstance(about["unit"], str) or about["derivative"] not in (0, 1, 2):
            raise ValueError(f"unit and derivative of sensor {name!r}")


def check_basic(names: Mapping[str, Any], item: str) -> None:
    """Check that the basic series ``t, step, q, p`` are all there.

    Raises
    ------
    InputError
        Naming those that are missing.
    """
    missing = [name for name in BASIC if name not in names]
    if missing:
        raise InputError(item, f"misses {', '.join(missing)}; got {', '.join(names) or 'nothing'}")


# -- the file format: one file, blocks appended, each sound although the writer is killed later ----
#
# Layout (all text is ASCII or UTF-8, numbers in arrays little-endian, C order)::
#
#     SKFEM-COSSERAT HISTORY 1\n                    magic and version
#     <bytes:020d> <crc:08x>\n                      committed length, overwritten in place
#     BLOCK <header:010d> <payload:020d> <crc:08x> <crc:08x>\n
#     <header: JSON>                                kind, arrays (name, dtype, shape), ...
#     <payload: arrays one after the other>
#     BLOCK ...
#
# Kinds of blocks: ``head`` (``meta`` and the static arrays, once, first), ``rows`` (some states of
# all series; ``first`` is the number of the first one), ``sensors`` (instants and values of
# sensors, NAME/t and NAME/x), ``spare`` (the head again, where it is small beside the rest),
# ``tail`` (``status``, number of ``states`` and changes of ``meta``; missing if the writer was
# killed). A
# block counts once the committed length includes it; that number is changed after the bytes of the
# block were handed to the operating system. CRC-32 sums guard the committed length, the headers and
# the payloads: a damaged block is left out, and the next one is found by its sums. Files without
# ``first``, ``states`` and ``spare`` are older ones.

_FAMILY = b"SKFEM-COSSERAT HISTORY "
_MAGIC = _FAMILY + b"1\n"
_COMMIT_BYTES = 30
_BLOCK_BYTES = 56
#: `save_file` cuts long series into blocks of at most so many states, and about so many bytes:
#: damage takes whole blocks
_SAVE_ROWS, SAVE_BYTES = 100, 2**22
#: of sensors, which have few numbers at each instant
_SAVE_INSTANTS = 4096
#: the head is written again where it adds at most this part of the file
_SPARE = 0.02
#: types of arrays as `FileWriter` names them
_DTYPE = re.compile(rf"[<|][{KINDS}][1-9]\d{{0,8}}")
#: what wrong bytes raise where they are no header of ours
_WRONG = (
    *(ArithmeticError, AttributeError, LookupError, MemoryError),
    *(RecursionError, TypeError, ValueError),
)


@dataclass(frozen=True)
class Block:
    """Place of one block in a file."""

    header: dict[str, Any]
    start: int
    size: int
    crc: int
    #: whether bytes before it are no block
    gap: bool = False

    @property
    def kind(self) -> str:
        """What it holds."""
        return str(self.header["kind"])

    @property
    def rows(self) -> int:
        """Number of states in the block."""
        return int(self.header.get("rows", 0))


@dataclass
class Scan:
    """What the headers of a file say; ``problem`` is empty if all is well.

    ``missing`` are ranges of states that a damage took, the end excluded; an empty range stands
    for an unknown number of them, in a file of older form.
    """

    path: Path
    found: int
    expected: int
    blocks: list[Block] = field(default_factory=list)
    problem: str = ""
    missing: list[tuple[int, int]] = field(default_factory=list)

    @property
    def item(self) -> str:
        """Name of the file in errors."""
        return f"history file {str(self.path)!r}"

    @property
    def rows(self) -> int:
        """Number of states in the blocks."""
        return sum(block.rows for block in self.blocks)

    def of(self, kind: str) -> list[Block]:
        """Blocks of a kind."""
        return [block for block in self.blocks if block.kind == kind]

    def blame(self, problem: str) -> None:
        """Take down what is wrong; of several things the first one is told."""
        self.problem = self.problem or problem


def _commit_line(size: int) -> bytes:
    digits = b"%020d" % size
    return b"%s %08x\n" % (digits, zlib.crc32(digits))


def _block_line(size: int, payload: int, crc: int, payload_crc: int) -> bytes:
    return b"BLOCK %010d %020d %08x %08x\n" % (size, payload, crc, payload_crc)


@lru_cache(maxsize=16)
def _arrays_as_json(form: tuple[tuple[str, str, tuple[int, ...]], ...]) -> str:
    """The arrays of a block in its header; most blocks of a file have the same form."""
    listing = [{"name": name, "dtype": dtype, "shape": shape} for name, dtype, shape in form]
    return json.dumps({"arrays": listing})[1:-1]


def write_at(handle: BinaryIO, offset: int, data: bytes) -> None:
    """Write all of it at an offset: a full disk takes a part and says no more than how much."""
    handle.seek(offset)
    view = memoryview(data)
    while view:
        view = view[handle.write(view) :]


class FileWriter:
    """Append blocks to a history file.

    Parameters
    ----------
    path : path-like
        Name of the file; an older one is overwritten.

    Raises
    ------
    InputError
        If the file cannot be opened for writing.
    """

    def __init__(self, path: FilePath) -> None:
        self.path = file_path("argument path", path)
        new = not self.path.exists()
        try:
            self._handle: BinaryIO = self.path.open("wb", buffering=0)
        except OSError as error:
            raise InputError(
                f"history file {str(self.path)!r}", f"cannot be written: {error.strerror}"
            ) from error
        self._end = len(_MAGIC) + _COMMIT_BYTES
        try:
            self._write(0, _MAGIC + _commit_line(self._end))
        except OSError as error:
            self.close()
            if new:  # what was there before may be a device
                self.path.unlink(missing_ok=True)
            raise InputError(
                f"history file {str(path)!r}", f"cannot be written: {error.strerror}"
            ) from error

    def _write(self, offset: int, data: bytes) -> None:
        write_at(self._handle, offset, data)

    def append(self, header: dict[str, Any], arrays: Mapping[str, Array]) -> None:
        """Write one block and commit it.

        Parameters
        ----------
        header : dict
            JSON data with the entry ``kind``.
        arrays : mapping of str to array
            Any shapes; types as in `skfem_cosserat.history.file.KINDS`.

        Raises
        ------
        OSError
            If the system takes no more; the blocks before are committed and sound.
        """
        form = tuple([(name, each.dtype.str, each.shape) for name, each in arrays.items()])
        # a header has entries of its own, and the arrays as the last one
        text = f"{json.dumps(header)[:-1]}, {_arrays_as_json(form)}}}".encode()
        payload = b"".join([np.ascontiguousarray(each).data for each in arrays.values()])
        line = _block_line(len(text), len(payload), zlib.crc32(text), zlib.crc32(payload))
        self._write(self._end, line + text)
        self._write(self._end + len(line + text), payload)
        self._end += len(line + text) + len(payload)
        self._write(len(_MAGIC), _commit_line(self._end))

    def finish(
        self,
        head: dict[str, Any],
        static: Mapping[str, Array],
        status: str,
        updates: dict[str, Any],
        states: int,
    ) -> None:
        """Write what ends a file: the head again, and the tail; OSError as in `append`.

        Parameters
        ----------
        head : dict
            ``meta`` as the head of the file has it.
        static : mapping of str to array
        status : str
        updates : dict
            Changes of ``meta``.
        states : int
            How many have been written.
        """
        size = len(json.dumps(head)) + sum(array.nbytes for array in static.values())
        if size <= _SPARE * self._end:
            self.append({"kind": "spare", "meta": head}, static)
        self.append({"kind": "tail", "status": status, "meta": updates, "states": states}, {})

    def sync(self) -> None:
        """Wait until the bytes are on the disk."""
        os.fsync(self._handle.fileno())

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._handle.close()


def _open(path: Path) -> BinaryIO:
    try:
        return path.open("rb")
    except OSError as error:
        raise HistoryError(
            f"history file {str(path)!r}", f"cannot be read: {error.strerror}"
        ) from error


def _start(handle: BinaryIO, path: Path) -> Scan:
    """Read magic line and committed length."""
    item = f"history file {str(path)!r}"
    magic = handle.read(len(_MAGIC))
    found = os.fstat(handle.fileno()).st_size
    if not magic:
        raise HistoryError(item, "is empty")
    if magic != _MAGIC:
        if magic.startswith(_FAMILY):
            version = magic[len(_FAMILY) :].decode("ascii", "replace").strip()
            raise HistoryError(item, f"has format version {version!r}, expected '1'")
        raise HistoryError(item, f"is not a history: it starts with {magic[:16]!r}")
    line = handle.read(_COMMIT_BYTES)
    digits = line[:20]
    if line != b"%s %08x\n" % (digits, zlib.crc32(digits)):
        return Scan(path, found, found, problem="the committed length is damaged")
    scan = Scan(path, found, int(digits))
    if found < scan.expected:
        scan.problem = f"cut short: {found} bytes found, {scan.expected} bytes expected"
    elif found > scan.expected:
        logger.info("%s: %d uncommitted bytes ignored", path, found - scan.expected)
    return scan


def _sizes(header: dict[str, Any]) -> list[int]:
    """Bytes of each array of a block; an error of `_WRONG` if the header is not what we write."""
    kind, sizes, names = header["kind"], [], set()
    if kind == "rows" and not _counts([header["rows"], header.get("first", 0)]):
        raise ValueError(f"rows = {header['rows']!r}")
    if kind in ("head", "spare", "note", "tail") and not isinstance(header["meta"], dict):
        raise ValueError("the meta data are no names and values")
    if kind == "tail" and not (
        isinstance(header["status"], str) and _counts([header.get("states", 0)])
    ):
        raise ValueError(f"status = {header['status']!r}")
    for entry in header["arrays"]:
        name, text, shape = entry["name"], entry["dtype"], entry["shape"]
        if not _counts(shape) or not isinstance(name, str):
            raise ValueError(f"array {name!r} of shape {shape}")
        if kind == "rows" and shape[:1] != [header["rows"]]:
            raise ValueError(f"array {name!r} does not have {header['rows']} rows")
        sizes.append(_dtype(text).itemsize * prod(shape))
        names.add(name)
    if len(names) < len(sizes):
        raise ValueError("two arrays have the same name")
    return sizes


@cache
def _dtype(text: str) -> np.dtype[Any]:
    """A type as `FileWriter` names it."""
    if not _DTYPE.fullmatch(text):
        raise ValueError(f"an array of type {text!r}")
    return np.dtype(text)


def _counts(values: Any) -> bool:
    """Whether these are whole numbers that count something."""
    return isinstance(values, list) and all(type(k) is int and 0 <= k < 2**63 for k in values)


def _read_block(handle: BinaryIO, limit: int) -> Block:
    """Read the header of the block at the current place and step over its payload.

    Raises one of `_WRONG` if the bytes are not a block.
    """
    line = handle.read(_BLOCK_BYTES)
    words = line.split()
    if len(words) != 5:
        raise ValueError("no block header")
    size, payload, crc, payload_crc = (*map(int, words[1:3]), *(int(w, 16) for w in words[3:]))
    if line != _block_line(size, payload, crc, payload_crc):
        raise ValueError("no block header")
    start = handle.tell() + size
    if start + payload > limit:
        raise ValueError("the block is not complete")
    text = handle.read(size)
    if zlib.crc32(text) != crc:
        raise ValueError("the header of the block is damaged")
    if not payload and payload_crc:  # other payloads are checked when they are read
        raise ValueError("the block is damaged")
    header = json.loads(text)
    if sum(_sizes(header)) != payload:
        raise ValueError("sizes of arrays and block differ")
    handle.seek(start + payload)
    return Block(header, start, payload, payload_crc)


def _next_block(handle: BinaryIO, place: int, limit: int) -> int:
    """Next byte at or after `place` where a block may start; `limit` if there is none."""
    with mmap.mmap(handle.fileno(), 0, access=mmap.ACCESS_READ) as data:
        found = data.find(b"BLOCK ", place, limit)
    return limit if found < 0 else found


def _scan(handle: BinaryIO, path: Path) -> Scan:
    """Find all blocks, looking at headers only; what is no block is stepped over."""
    scan = _start(handle, path)
    limit, gap = min(scan.found, scan.expected), False
    while (place := handle.tell()) < limit:
        try:
            block = _read_block(handle, limit)
            if (block.kind == "head") != (place == len(_MAGIC) + _COMMIT_BYTES):
                raise ValueError("unexpected block")
        except _WRONG as error:
            scan.blame(f"damaged at byte {place}: {error}")
            handle.seek(_next_block(handle, place + 1, limit))
            gap = True
            continue
        scan.blocks.append(replace(block, gap=gap) if gap else block)
        gap = False
    return scan


def _arrays(handle: BinaryIO, block: Block) -> dict[str, Array] | None:
    """Arrays of a block (read-only views of its bytes); None if its sum is wrong."""
    handle.seek(block.start)
    payload = handle.read(block.size)
    if zlib.crc32(payload) != block.crc:
        return None
    arrays: dict[str, Array] = {}
    offset = 0
    sizes = _sizes(block.header)
    for entry, size in zip(block.header["arrays"], sizes, strict=True):
        dtype = _dtype(entry["dtype"])
        if size:
            array = np.frombuffer(payload, dtype, size // dtype.itemsize, offset)
        else:
            array = np.empty(0, dtype)
        arrays[entry["name"]] = array.reshape(entry["shape"])
        offset += size
    return arrays


def _form(block: Block) -> dict[str, tuple[str, list[int]]]:
    """Types and shapes, but for the first axis, of the arrays of a block."""
    return {entry["name"]: (entry["dtype"], entry["shape"][1:]) for entry in block.header["arrays"]}


def _head(handle: BinaryIO, scan: Scan) -> tuple[dict[str, Any], dict[str, Array]]:
    """Meta data and static arrays, of the head or of its spare."""
    for block in (*scan.of("head"), *scan.of("spare")):
        arrays = _arrays(handle, block)
        if arrays is not None:
            if block.kind == "spare":
                scan.blame("damaged in its head")
            return block.header["meta"], {name: array.copy() for name, array in arrays.items()}
        scan.blame("damaged: wrong checksum in the head")
    scan.blame("the head is missing")
    raise HistoryError(scan.item, f"{scan.problem}; nothing can be recovered")


def _series(handle: BinaryIO, scan: Scan) -> dict[str, Array]:
    """Fill the series from all sound blocks; what is missing is taken down in the scan."""
    series: dict[str, Array] = {}
    form: dict[str, tuple[str, list[int]]] = {}
    done = at = 0
    for block in scan.of("rows"):
        first = block.header.get("first", at)
        if first < at:
            scan.blame(f"damaged: states {first} to {first + block.rows - 1} come twice")
            continue
        if first > at or (block.gap and "first" not in block.header):
            scan.missing.append((at, first))
        at = first + block.rows
        arrays = _arrays(handle, block)
        own = _form(block)
        if arrays is None or (form and own != form):
            what = "wrong checksum" if arrays is None else "other series"
            scan.blame(f"damaged: {what} in states {first} to {at - 1}")
            scan.missing.append((first, at))
            continue
        if not series:
            form = own
            series = {
                name: np.empty((scan.rows, *array.shape[1:]), array.dtype)
                for name, array in arrays.items()
            }
        for name, array in series.items():
            array[done : done + block.rows] = arrays[name]
        done += block.rows
    total = max((block.header.get("states", 0) for block in scan.of("tail")), default=0)
    if at < total:
        scan.blame(f"damaged: states {at} to {total - 1} are missing")
        scan.missing.append((at, total))
    return {name: array[:done] for name, array in series.items()}


def _sensors(handle: BinaryIO, scan: Scan) -> dict[str, Array]:
    """Instants and values of the sensors from all sound blocks."""
    parts: dict[str, list[Array]] = {}
    form: dict[str, tuple[str, list[int]]] = {}
    for block in scan.of("sensors"):
        arrays = _arrays(handle, block)
        if arrays is None or (form and _form(block) != form):
            scan.blame("damaged: wrong checksum in values of sensors")
            continue
        form = _form(block)
        for name, array in arrays.items():
            parts.setdefault(name, []).append(array)
    return {name: np.concatenate(each) for name, each in parts.items()}


def _finish(scan: Scan, head: dict[str, Any]) -> dict[str, Any]:
    """Meta data with the changes of the tail and the status."""
    meta = {**head, "status": "killed"}
    for block in scan.of("note"):
        meta |= block.header["meta"]
    rows = [block.header.get("first", 0) + block.rows for block in scan.of("rows")]
    if not scan.of("tail"):  # what followed the last states in the file has not happened
        for name, least in (("segments", 1), ("events", 2)):
            if name in meta:
                top = max(rows, default=0) - least
                meta[name] = [each for each in meta[name] if each["row"] <= top]
        if "segments" in meta and not meta["segments"]:
            del meta["segments"]
    for block in scan.of("tail"):
        meta |= {**block.header["meta"], "status": block.header["status"]}
    return meta


def _tell(scan: Scan, series: Mapping[str, Array], meta: dict[str, Any]) -> None:
    """Say what a damaged file has lost, and number rows in the meta data as they are now."""
    lost, t = [], series["t"]
    kept = np.ones(len(t) + sum(b - a for a, b in scan.missing), dtype=bool)
    for a, b in scan.missing:
        kept[a:b] = False
        before, after = int(kept[:a].sum()), int(kept[:b].sum())
        where = [f"after t = {t[before - 1]:.6g}"] if before else []
        where += [f"before t = {t[after]:.6g}"] if after < len(t) else []
        which = f"states {a} to {b - 1}" if b > a + 1 else f"state {a}"
        which = which if b > a else "an unknown number of states"
        lost.append(f"{which} ({' and '.join(where)})" if where else which)
    if not scan.of("tail"):
        lost.append("all after the last of them")
    text = f"{scan.problem}; {len(t)} states recovered"
    warn(scan.item, f"{text}, missing: {', '.join(lost)}" if lost else text, IncompleteWarning)
    if not scan.missing:
        return
    meta["missing"] = [[a, b - 1] for a, b in scan.missing]
    number = np.concatenate([[0], np.cumsum(kept)])  # of rows before
    top = len(kept)
    if all(b > a for a, b in scan.missing):
        for about in meta.get("segments", []):
            about["row"] = int(number[min(about["row"], top)])
        for event in meta.get("events", []):  # of one that is lost: the state before
            event["row"] = max(int(number[min(event["row"] + 1, top)]) - 1, 0)
    else:
        for name in ("segments", "events"):
            meta.pop(name, None)


def load_file(
    path: FilePath, recover: bool = False
) -> tuple[dict[str, Any], dict[str, Array], dict[str, Array], dict[str, Array]]:
    """Read ``meta``, static arrays, series, and arrays of sensors of a file.

    Parameters
    ----------
    path : path-like
        Name of the file.
    recover : bool
        Return all states that are sound instead of raising an error: those that are missing are
        told by an `IncompleteWarning` and listed in ``meta["missing"]``.

    Raises
    ------
    HistoryError
        If the file is no history, cut short or damaged (with the number of states that
        ``recover=True`` returns), or damaged in its head, where nothing can be recovered.
    """
    path, recover = file_path("argument path", path), switch("argument recover", recover)
    with _open(path) as handle:
        scan = _scan(handle, path)
        head, static = _head(handle, scan)
        series, sensors = _series(handle, scan), _sensors(handle, scan)
    meta = _finish(scan, head)
    empty = {"t": (0,), "step": (0,), "q": (0, 0), "p": (0, 0)}
    for name in BASIC if not series else ():
        series[name] = np.zeros(empty[name], np.int64 if name == "step" else np.float64)
    try:
        check_loaded(meta, static, series, sensors)
    except _WRONG as error:
        raise HistoryError(scan.item, f"is not as a history is written: {error}") from error
    if scan.problem:
        if not recover:
            text = f"{scan.problem}; recover=True gives {len(series['t'])} states"
            raise HistoryError(scan.item, text)
        _tell(scan, series, meta)
    return meta, static, series, sensors


@checked
def read_meta(path: FilePath) -> dict[str, Any]:
    """Meta data of a history file and the number of its ``states``, without reading the arrays.

    Parameters
    ----------
    path : path-like
        Name of the file; it may be one that is being written.

    Returns
    -------
    dict
        ``meta`` with ``status`` (``"killed"`` as long as the writer has not closed the file) and
        ``states``, the number of committed states.

    Raises
    ------
    HistoryError
        If the file is no history, cut short, or its headers are damaged.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "run.history"
    ...     writer = FileWriter(path)
    ...     writer.append({"kind": "head", "meta": {"step": 0.01}}, {})
    ...     writer.close()
    ...     read_meta(path)
    {'step': 0.01, 'status': 'killed', 'states': 0}
    """
    path = file_path("argument path", path)
    with _open(path) as handle:
        scan = _scan(handle, path)
    if scan.problem or not scan.blocks:
        raise HistoryError(scan.item, scan.problem or "the head is missing")
    return {**_finish(scan, scan.blocks[0].header["meta"]), "states": scan.rows}


def save_file(
    path: FilePath,
    meta: dict[str, Any],
    static: Mapping[str, Array],
    series: Mapping[str, Array],
    sensors: Mapping[str, Array],
) -> None:
    """Write a complete file under a temporary name, then give it its name.

    Parameters
    ----------
    path : path-like
        Name of the file; an older one is replaced.
    meta : dict
        JSON data.
    static, series : mapping of str to array
        Arrays; series have a common first axis.
    sensors : mapping of str to array
        NAME/t and NAME/x of each sensor.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written.
    StorageError
        If the disk is full, say; an older file is as it was.
    """
    path = file_path("argument path", path)
    if path.is_dir():
        raise InputError(f"history file {str(path)!r}", "cannot be written: it is a folder")
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        writer = FileWriter(temporary)
    except InputError as error:
        raise InputError(f"history file {str(path)!r}", str(error).partition(": ")[2]) from error
    try:
        _save_blocks(writer, meta, static, series, sensors)
        writer.sync()
        writer.close()
        temporary.replace(path)
    except OSError as error:
        time = float(series["t"][-1]) if len(series["t"]) else None
        advice = "; what was there before is as it was, the history is in .history of this error"
        raise StorageError(path, error, advice, time) from error
    finally:
        with contextlib.suppress(OSError):
            writer.close()
            temporary.unlink(missing_ok=True)


def _save_blocks(
    writer: FileWriter,
    meta: dict[str, Any],
    static: Mapping[str, Array],
    series: Mapping[str, Array],
    sensors: Mapping[str, Array],
) -> None:
    """All blocks of a complete file."""
    rows = len(series["t"])
    bytes_per_row = sum(array.nbytes for array in series.values()) // max(rows, 1)
    stride = max(1, min(_SAVE_ROWS, SAVE_BYTES // max(bytes_per_row, 1)))
    writer.append({"kind": "head", "meta": meta}, static)
    for first in range(0, max(rows, 1), stride):
        part = {name: array[first : first + stride] for name, array in series.items()}
        writer.append({"kind": "rows", "rows": len(part["t"]), "first": first}, part)
    instants = max((len(array) for array in sensors.values()), default=0)
    for first in range(0, max(instants, 1) if sensors else 0, _SAVE_INSTANTS):
        seen = {name: array[first : first + _SAVE_INSTANTS] for name, array in sensors.items()}
        writer.append({"kind": "sensors"}, seen)
    writer.finish(meta, static, meta.get("status", "completed"), {}, rows)
