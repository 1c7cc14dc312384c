"""Files of histories: SQLite databases of blocks, and the plain data they take."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import sqlite3
import zlib
from collections import UserDict
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..arguments import checked
from ..errors import FULL, HistoryError, IncompleteWarning, InputError, StorageError
from ..types import Array, FilePath, Meta, file_path, switch
from ..warn import warn

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

#: series that others follow from: not to be written to
ORIGINS = ("t", "step", "q", "p", "carried", "constraint_force", "turns")
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
    if isinstance(value, (np.generic, np.ndarray)):
        return plain(value.tolist(), item)
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, (list, tuple)):
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


# -- the file format: an SQLite database, which other programs read, too ---------------------------
#
# A row of the table ``blocks`` is an array:
#
# ``kind``  ``static`` arrays, ``series`` over the states, ``sensors`` with their instants NAME/t
#           and values NAME/x; JSON objects as arrays of bytes, which together are the metadata, a
#           later value in place of an earlier one: ``head`` is known at the start, a ``note`` has
#           happened on the way, ``tail`` is known at the end and has the status. It is missing
#           while a run goes on, and after it was killed.
# ``name``  of the array.
# ``first`` number of the block's first state; of sensors a growing number; of the tail, how many
#           states there are.
# ``rows``  length of the first axis: states, instants, 1 for static arrays.
# ``dtype``, ``shape``  type as numpy names it, little-endian, and shape without the first axis
#           (JSON); ``data`` are the numbers in C order.
# ``crc``   CRC-32 of all this, see `_crc`: a damaged row is never taken for numbers.
#
# A block of states is written in one transaction: a writer that is killed loses the block that it
# had begun. While it runs, and after it was killed, there is a file NAME-journal, too: if a block
# was half written, it says how the next reader takes that back. A reader keeps a writer waiting,
# and a writer a reader.

_APPLICATION = 0x5C055E7A
_VERSION = 1
_TABLES = f"""
PRAGMA page_size = 8192;  -- most arrays are larger than the usual 4096 bytes
PRAGMA synchronous = OFF;  -- a killed process loses nothing that was handed to the system
PRAGMA journal_mode = PERSIST;  -- to make and remove a file costs as much as to write a block
BEGIN;
PRAGMA application_id = {_APPLICATION};
PRAGMA user_version = {_VERSION};
CREATE TABLE blocks (id INTEGER PRIMARY KEY AUTOINCREMENT, kind TEXT, name TEXT, first INTEGER,
    rows INTEGER, dtype TEXT, shape TEXT, crc INTEGER, data BLOB);
"""
_LIST = """
SELECT id, kind, name, first, rows, dtype, shape, crc, length(data) FROM blocks
    WHERE id > ? ORDER BY id
"""
#: how long (s) readers and writers wait for each other
_PATIENCE = 60.0
#: `save_file` cuts long series into blocks of at most so many states, and about so many bytes:
#: damage takes whole blocks
_SAVE_ROWS, SAVE_BYTES = 100, 2**22
#: of sensors, which have few numbers at each instant
_SAVE_INSTANTS = 4096
#: types of arrays
_DTYPE = re.compile(rf"[<|][{KINDS}][1-9]\d{{0,8}}")
#: what a file may raise that is not as we write it
_WRONG = (
    ArithmeticError,
    AttributeError,
    LookupError,
    MemoryError,
    RecursionError,
    TypeError,
    ValueError,
    sqlite3.Error,
)


def _item(path: FilePath) -> str:
    return f"history file {os.fspath(path)!r}"


def cannot_write(path: FilePath, error: OSError) -> InputError:
    """Error for a file that cannot be begun."""
    return InputError(_item(path), f"cannot be written: {error.strerror}")


def _crc(columns: tuple[Any, ...], data: bytes) -> int:
    """CRC-32 of the columns of a row from `kind` to `shape`, with spaces between, and its data."""
    return zlib.crc32(data, zlib.crc32(" ".join(map(str, columns)).encode()))


def json_array(value: Mapping[str, Any]) -> dict[str, Array]:
    """JSON data as an array that a file takes."""
    return {"json": np.frombuffer(json.dumps(value).encode(), np.uint8)[None]}


class FileWriter:
    """Append blocks to a history file.

    Parameters
    ----------
    path : path-like
        Name of the file; an older one is overwritten.
    meta : mapping
        JSON data that are known at the start.
    static : mapping of str to array
        Types as in `skfem_cosserat.history.file.KINDS`.

    Raises
    ------
    OSError
        If the file cannot be begun.
    """

    def __init__(self, path: FilePath, meta: Mapping[str, Any], static: Mapping[str, Array]):
        self.path = file_path(path)
        new = not self.path.exists()
        self.path.open("wb").close()
        self._db = sqlite3.connect(self.path, timeout=_PATIENCE)
        try:
            with _os_errors():
                self._db.executescript(_TABLES)
            self.append("static", 0, {name: array[None] for name, array in static.items()})
            self.append("head", 0, json_array(meta))
        except OSError:
            self.close()
            if new:  # what was there before may be a device
                self.path.unlink(missing_ok=True)
            raise

    def append(self, kind: str, first: int, arrays: Mapping[str, Array]) -> None:
        """Write a block of arrays in one transaction: all of it is in the file, or nothing.

        Parameters
        ----------
        kind : {"static", "series", "sensors", "head", "note", "tail"}
        first : int
            Number of its first state; of sensors a growing number.
        arrays : mapping of str to array
            With an axis for the states before all others.

        Raises
        ------
        OSError
            If the system takes no more; the blocks before are sound.
        """
        rows = []
        for name, array in arrays.items():
            shape = str([*array.shape[1:]])
            data = array.tobytes()
            columns = (kind, name, first, len(array), array.dtype.str, shape)
            rows.append((*columns, _crc(columns, data), data))
        with _os_errors(), self._db as db:
            db.executemany("INSERT INTO blocks VALUES (NULL, ?, ?, ?, ?, ?, ?, ?, ?)", rows)

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        with contextlib.suppress(sqlite3.Error):
            self._db.execute("PRAGMA journal_mode = DELETE")
        self._db.close()


@contextlib.contextmanager
def _os_errors() -> Iterator[None]:
    """Errors of the database as those of a system that takes no more."""
    try:
        yield
    except sqlite3.Error as error:
        if getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_FULL:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) from error
        raise OSError(errno.EIO, str(error)) from error


# -- reading ---------------------------------------------------------------------------------------


@contextlib.contextmanager
def _opened(path: Path, recover: bool = False) -> Iterator[sqlite3.Connection]:
    """A history file as it is now; what is not as we write it is a HistoryError."""
    item = _item(path)
    if not path.is_file():
        raise HistoryError(item, "cannot be read: there is no such file")
    if not path.stat().st_size:
        raise HistoryError(item, "is empty")
    # not read-only: a writer that was killed in a transaction left what takes that back
    address = f"{path.resolve().as_uri()}?mode=rw"
    try:
        with contextlib.closing(sqlite3.connect(address, timeout=_PATIENCE, uri=True)) as db:
            # opens a file that is cut short; nothing is written
            db.execute(f"PRAGMA writable_schema = {recover:d}")
            db.execute("BEGIN")  # a run may go on, and append blocks
            found = db.execute(
                "SELECT * FROM pragma_application_id, pragma_user_version"
            ).fetchone()
            if found != (_APPLICATION, _VERSION):
                text = f"is another SQLite database, or a history of another version: {found}"
                raise HistoryError(item, f"{text}, not {_APPLICATION, _VERSION}")
            yield db
    except HistoryError:
        raise
    except _WRONG as error:
        if getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_NOTADB:
            with path.open("rb") as file:
                old = file.read(14) == b"SKFEM-COSSERAT"
            text = "is not a history" + " any more: version 0.2 and older wrote it" * old
            raise HistoryError(item, text) from error
        problem = "cannot be read" if isinstance(error, sqlite3.OperationalError) else "damaged"
        advice = "History.load(path, recover=True) leaves out what is damaged"
        raise HistoryError(item, f"{problem}: {error}; {advice}") from error


@lru_cache
def _layout(dtype: str, shape: str) -> tuple[list[int], int]:
    """Axes of an array but for the first one, and its bytes at one state."""
    axes = json.loads(shape)
    if not _DTYPE.fullmatch(dtype) or any(type(length) is not int or length < 0 for length in axes):
        raise ValueError(f"type {dtype}, shape {shape}")
    return axes, np.dtype(dtype).itemsize * prod(axes)


class _Piece(NamedTuple):
    """An array of a block: a row of the table, but for its data."""

    id: int
    kind: str
    name: str
    first: int
    rows: int
    dtype: str
    shape: str
    crc: int

    @property
    def size(self) -> int:
        """Number of bytes."""
        return self.rows * _layout(self.dtype, self.shape)[1]

    def array(self, db: sqlite3.Connection) -> Array:
        """The numbers; ValueError if they are damaged."""
        (data,) = db.execute("SELECT data FROM blocks WHERE id = ?", [self.id]).fetchone() or [b""]
        if _crc(self[1:-1], data) != self.crc:
            where = f"{self.kind} {self.name!r} from number {self.first} on"
            raise ValueError(f"wrong checksum of {where}, or another file by now")
        axes, _ = _layout(self.dtype, self.shape)
        array = np.frombuffer(data, self.dtype).reshape(self.rows, *axes)
        if array.dtype.kind == "U" and array.view(np.uint32).max(initial=0) > 0x10FFFF:
            raise ValueError(f"no text in {self.name!r}")
        return array


class _Scan:
    """Contents of a history file, but for the numbers of its arrays.

    Parameters
    ----------
    path : pathlib.Path
    recover : bool
        Read all arrays, and leave out what is damaged instead of raising an error.

    Raises
    ------
    HistoryError
        If the file is no history, or damaged.
    """

    def __init__(self, path: Path, recover: bool = False):
        self.item, self._recover, self._problem = _item(path), recover, ""
        self._pieces: dict[int, _Piece] = {}
        with _opened(path, recover) as db:
            self._list(db, path.stat().st_size)
            self.series, self.sensors = self._blocks("series"), self._blocks("sensors")
            self.states = sum(block["t"].rows for block in self.series)
            self.meta = self._metadata(db)
            self._compare(db)

    def of(self, *kinds: str) -> list[_Piece]:
        """Arrays of some kinds, as they were written."""
        return [piece for piece in self._pieces.values() if piece.kind in kinds]

    def _blame(self, problem: object) -> None:
        """Take down what is wrong; of several things the first one is told."""
        if not self._recover:
            raise ValueError(problem)
        self._problem = self._problem or str(problem)

    def _list(self, db: sqlite3.Connection, limit: int) -> None:
        """Take down all arrays, as far as they can be read, of a file of so many bytes."""
        count = db.execute("SELECT max(seq) FROM sqlite_sequence").fetchone()[0] or 0
        at = 0
        while at < min(count, limit):
            try:
                for *row, size in db.execute(_LIST, [at]):
                    at = max(at, row[0])
                    self._take(db, _Piece(*row), size)
                break
            except sqlite3.Error as error:  # perhaps of this row alone
                self._blame(error)
                at += 1
        if limit % db.execute("PRAGMA page_size").fetchone()[0]:
            self._blame("the file is cut short")
        if len(self._pieces) != count:
            self._blame(f"{len(self._pieces)} of {count} arrays can be read")
        if sum(piece.size for piece in self._pieces.values()) > limit:
            raise ValueError("its arrays are larger than the file")

    def _take(self, db: sqlite3.Connection, piece: _Piece, size: int) -> None:
        """Take down an array of so many bytes, if it is sound."""
        try:
            if piece.size != size:
                raise ValueError("of another size than it was written")
            if self._recover:
                piece.array(db)
        except _WRONG as error:
            self._blame(f"array {piece.id}: {error}")
        else:
            self._pieces[piece.id] = piece

    def _blocks(self, kind: str) -> list[dict[str, _Piece]]:
        """Arrays by name of each block that has all of them."""
        blocks: dict[int, dict[str, _Piece]] = {}
        for piece in self.of(kind):
            blocks.setdefault(piece.first, {})[piece.name] = piece
        names = max((block.keys() for block in blocks.values()), key=len, default=())
        sound = []
        for first, block in sorted(blocks.items()):
            if block.keys() == names and _is_sound(kind, block):
                sound.append(block)
            else:
                self._blame(f"{kind} from number {first} on")
        return sound

    def _metadata(self, db: sqlite3.Connection) -> Meta:
        """Metadata of as many states as there are."""
        meta: Meta = {}
        if not self.of("head"):
            raise HistoryError(self.item, "damaged: its head is gone, nothing can be recovered")
        for piece in self.of("head", "note", "tail"):
            meta = {**meta, **json.loads(piece.array(db).tobytes())}
        segments = meta.get("segments", [])
        events = meta.get("events", [])
        if any(type(each["row"]) is not int for each in [*segments, *events]):
            raise ValueError("rows of segments and events")
        for event in events:
            EventRecord(**event)
        for about in meta.get("sensors", {}).values():
            if not isinstance(about["unit"], str) or about["derivative"] not in (0, 1, 2):
                raise ValueError("units and derivatives of sensors")
        if not self.of("tail"):  # what followed the last states in the file has not happened
            meta["status"] = "killed"
            for name, limit in (("segments", max(self.states, 1)), ("events", self.states - 1)):
                if name in meta:
                    meta[name] = [each for each in meta[name] if each["row"] < limit]
        return meta

    def _compare(self, db: sqlite3.Connection) -> None:
        """Say which states are missing, and number rows in the metadata as they are now."""
        times = [block["t"] for block in self.series]
        spans = [np.arange(piece.first, piece.first + piece.rows) for piece in times]
        numbers = np.concatenate([np.zeros(0), *spans])
        edges = np.concatenate([[-1], numbers, [piece.first for piece in self.of("tail")]])
        gaps = np.flatnonzero(np.diff(edges) > 1)
        missing = [[int(edges[k] + 1), int(edges[k + 1] - 1)] for k in gaps]
        if missing:
            self._blame(f"states {missing} are missing")
        if not self._problem:
            return
        t = np.concatenate([np.zeros(0), *(piece.array(db) for piece in times)])
        lost = []
        for k, (first, last) in zip(gaps, missing, strict=True):
            near = " and ".join(f"{time:.6g}" for time in t[max(k - 1, 0) : k + 1])
            lost.append(f"states {first} to {last} (next to t = {near or 'none'})")
        if self.meta["status"] == "killed":
            lost.append("all after the last of them")
        text = f"damaged: {self._problem}; {len(t)} states recovered, missing: "
        warn(self.item, text + (", ".join(lost) or "none"), IncompleteWarning)
        self.meta["missing"] = missing
        for segment in self.meta.get("segments", []):
            segment["row"] = int(np.searchsorted(numbers, segment["row"]))
        for event in self.meta.get("events", []):  # of one that is lost: the state before
            event["row"] = max(int(np.searchsorted(numbers, event["row"] + 1)) - 1, 0)


def _is_sound(kind: str, block: Mapping[str, _Piece]) -> bool:
    """True if arrays are those of states or of sensors, and fit their times."""
    needed = set(BASIC)
    if kind == "sensors":
        needed = {name[:-1] + end for name in block for end in "tx"}
    if not needed <= block.keys():
        return False
    for name, piece in block.items():
        times = block["t" if kind == "series" else name[:-1] + "t"]
        if piece.rows != times.rows or times.shape != "[]" or times.dtype[1] not in "fiu":
            return False
    return True


class StoredArrays(UserDict[str, Any]):
    """Arrays by name, each read from a file when it is first asked for.

    Parameters
    ----------
    path : pathlib.Path
    recover : bool
        The file may be cut short.
    blocks : list of dict
        Pieces by name.

    Raises
    ------
    HistoryError
        If an array is damaged, or the file is another one by then.
    """

    def __init__(self, path: Path, recover: bool, blocks: Sequence[Mapping[str, _Piece]]):
        super().__init__()
        self._file = path.absolute(), recover
        for name in blocks[0] if blocks else ():
            self.data[name] = [block[name] for block in blocks]

    def __getitem__(self, name: str) -> Array:
        if isinstance(self.data[name], list):
            with _opened(*self._file) as db:
                array = np.concatenate([piece.array(db) for piece in self.data[name]])
            array.flags.writeable = name not in ORIGINS
            self.data[name] = array
        return self.data[name]

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)


def empty_series() -> dict[str, Array]:
    """Basic series of no states."""
    none = np.zeros((0, 0))
    return {"t": np.zeros(0), "step": np.zeros(0, np.int64), "q": none, "p": none}


def load_file(
    path: FilePath, recover: bool = False
) -> tuple[Meta, dict[str, Array], Mapping[str, Array], Mapping[str, Array]]:
    """Read ``meta``, static arrays, series, and arrays of sensors of a file.

    Series and arrays of sensors are read when they are asked for.

    Parameters
    ----------
    path : path-like
        Name of the file.
    recover : bool
        Leave out what is damaged instead of raising an error: states that are missing are told by
        an `IncompleteWarning` and listed in ``meta["missing"]``. All arrays are read for that.

    Raises
    ------
    HistoryError
        If the file is no history, or damaged; and when a series is read that is damaged.
    """
    path = file_path(path)
    recover = switch("argument recover", recover)
    scan = _Scan(path, recover)
    with _opened(path, recover) as db:
        static = {piece.name: piece.array(db)[0].copy() for piece in scan.of("static")}
    series = StoredArrays(path, recover, scan.series) if scan.series else empty_series()
    return scan.meta, static, series, StoredArrays(path, recover, scan.sensors)


@checked
def read_meta(path: FilePath) -> Meta:
    """Metadata of a history file and the number of its ``states``, without reading the arrays.

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
    ...     FileWriter(path, {"step": 0.01}, {}).close()
    ...     read_meta(path)
    {'step': 0.01, 'status': 'killed', 'states': 0}
    """
    scan = _Scan(file_path(path))
    return {**scan.meta, "states": scan.states}


def save_file(
    path: FilePath,
    meta: Meta,
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
    path = file_path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    size = sum(array[:1].nbytes for array in series.values())
    stride = max(1, min(_SAVE_ROWS, SAVE_BYTES // max(size, 1)))
    try:
        with contextlib.closing(FileWriter(temporary, meta, static)) as writer:
            for kind, arrays, step in (
                ("series", series, stride),
                ("sensors", sensors, _SAVE_INSTANTS),
            ):
                longest = max(map(len, arrays.values()), default=0)
                for first in range(0, max(longest, 1), step):
                    block = {name: array[first : first + step] for name, array in arrays.items()}
                    writer.append(kind, first, block)
            status = meta.get("status", "completed")
            writer.append("tail", len(series["t"]), json_array({"status": status}))
        with temporary.open("rb+") as handle:
            os.fsync(handle.fileno())
        # of an older file whose writer was killed: it would be applied to this one
        Path(f"{path}-journal").unlink(missing_ok=True)
        temporary.replace(path)
    except OSError as error:
        if error.errno not in FULL:
            raise cannot_write(path, error) from error
        time = float(series["t"][-1]) if len(series["t"]) else None
        advice = "; what was there before is as it was, the history is in .history of this error"
        raise StorageError(path, error, advice, time) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
