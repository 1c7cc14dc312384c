"""Files of histories: SQLite databases of blocks, and the plain data they take."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import sqlite3
import zlib
from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from math import prod
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np

from ..arguments import checked
from ..errors import HistoryError, IncompleteWarning, InputError, StorageError
from ..types import Array, FilePath, file_path, switch
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
# A run writes block after block, each in one transaction: a writer that is killed loses the block
# that it had begun, at most. Tables:
#
# ``notes`` (kind, value, crc): JSON objects of the metadata. ``head`` is what is known at the
# start, ``note`` what has changed on the way, ``tail`` what is known at the end, with the status
# and the number of states; it is missing while a run goes on, and after it was killed.
# ``arrays`` (kind, name, first, dtype, shape, crc, data): of ``static`` arrays, of ``series`` the
# states from number `first` on, and of ``sensors`` instants NAME/t and values NAME/x; `shape` is
# JSON, `data` are numbers in C order, little-endian, `dtype` as numpy names it.
# ``file`` (run, notes, arrays): a word that no other file has, and how many rows there are.
#
# `crc` is the CRC-32 of what else is in its row, see `_sum`: a row that is damaged is left out.

_START, _APPLICATION, _VERSION = b"SQLite format 3\0", 0x5C055E7A, 1
_ADVICE = "History.load(path, recover=True) leaves out what is damaged"
_TABLES = f"""
PRAGMA application_id = {_APPLICATION};
PRAGMA user_version = {_VERSION};
PRAGMA synchronous = OFF;  -- a killed process loses nothing that was handed to the system
CREATE TABLE notes (id INTEGER PRIMARY KEY, kind TEXT, value TEXT, crc INTEGER);
CREATE TABLE arrays (id INTEGER PRIMARY KEY, kind TEXT, name TEXT, first INTEGER, dtype TEXT,
    shape TEXT, crc INTEGER, data BLOB);
CREATE TABLE file (run TEXT, notes INTEGER, arrays INTEGER);
"""
#: `save_file` cuts long series into blocks of at most so many states, and about so many bytes:
#: damage takes whole blocks
_SAVE_ROWS, SAVE_BYTES = 100, 2**22
#: of sensors, which have few numbers at each instant
_SAVE_INSTANTS = 4096
#: types of arrays
_DTYPE = re.compile(rf"[<|][{KINDS}][1-9]\d{{0,8}}")
#: what a file may raise that is not as we write it
_WRONG = (
    *(ArithmeticError, AttributeError, LookupError, MemoryError),
    *(RecursionError, TypeError, ValueError, sqlite3.Error),
)


def _sum(*parts: Any, data: bytes = b"") -> int:
    """CRC-32 of the columns of a row."""
    return zlib.crc32(data, zlib.crc32(json.dumps(parts).encode()))


class _Piece(NamedTuple):
    """A row of ``arrays``, but for its data."""

    id: int
    kind: str
    name: str
    first: int
    dtype: str
    shape: str
    crc: int

    @property
    def rows(self) -> int:
        """Length of its first axis."""
        return int(json.loads(self.shape)[0])

    @property
    def form(self) -> tuple[str, list[int]]:
        """Type and shape, but for the first axis."""
        return self.dtype, json.loads(self.shape)[1:]

    def fits(self, size: int) -> bool:
        """Whether it is as we write it, with so many bytes of data."""
        shape = json.loads(self.shape)
        counts = [self.first, *shape]
        return (
            all(type(k) is int and 0 <= k < 2**63 for k in counts)
            and bool(shape or self.kind == "static")
            and _DTYPE.fullmatch(self.dtype) is not None
            and np.dtype(self.dtype).itemsize * prod(shape) == size
        )

    def array(self, db: sqlite3.Connection) -> Array:
        """The numbers.

        Raises
        ------
        ValueError, sqlite3.Error
            If they are damaged.
        """
        ((data,),) = db.execute("SELECT data FROM arrays WHERE id = ?", [self.id])
        if _sum(*self[1:-1], data=data) != self.crc:
            raise ValueError("wrong checksum")
        array = np.frombuffer(data, self.dtype).reshape(json.loads(self.shape))
        if array.size and array.dtype.kind in "Ub":
            unit, top = (np.uint32, 0x10FFFF) if array.dtype.kind == "U" else (np.uint8, 1)
            if array.reshape(-1).view(unit).max() > top:
                raise ValueError("what is no value of its type")
        return array


def _cannot(path: Path, error: OSError | sqlite3.Error) -> InputError:
    reason = getattr(error, "strerror", None) or str(error)
    return InputError(f"history file {str(path)!r}", f"cannot be written: {reason}")


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
            self.path.open("wb").close()
            self._db = sqlite3.connect(self.path)
        except (OSError, sqlite3.Error) as error:
            raise _cannot(self.path, error) from error
        try:
            self._db.executescript(_TABLES)
            with self._db:
                self._db.execute("INSERT INTO file VALUES (?, 0, 0)", [uuid4().hex])
        except sqlite3.Error as error:
            self.close()
            if new:  # what was there before may be a device
                self.path.unlink(missing_ok=True)
            raise _cannot(self.path, error) from error

    def note(self, kind: str, value: Mapping[str, Any]) -> None:
        """Write JSON data of a kind; raises as :meth:`append`."""
        text = json.dumps(value)
        self._insert("notes", [(kind, text, _sum(kind, text))])

    def append(self, kind: str, first: int, arrays: Mapping[str, Array]) -> None:
        """Write a block of arrays in one transaction: all of it is in the file, or nothing.

        Parameters
        ----------
        kind : {"static", "series", "sensors"}
        first : int
            Number of its first state, or of the block among those of sensors.
        arrays : mapping of str to array
            Types as in `skfem_cosserat.history.file.KINDS`.

        Raises
        ------
        OSError
            If the system takes no more; the blocks before are sound.
        """
        rows = []
        for name, array in arrays.items():
            own = kind, name, first, array.dtype.str, json.dumps(array.shape)
            data = np.ascontiguousarray(array).tobytes()
            rows.append((*own, _sum(*own, data=data), data))
        self._insert("arrays", rows)

    def _insert(self, table: str, rows: Sequence[tuple[str | int | bytes, ...]]) -> None:
        places = ", ".join("?" * len(rows[0])) if rows else ""
        try:
            with self._db as db:
                if rows:
                    db.executemany(f"INSERT INTO {table} VALUES (NULL, {places})", rows)
                db.execute(f"UPDATE file SET {table} = {table} + ?", [len(rows)])
        except sqlite3.Error as error:
            full = error.sqlite_errorname == "SQLITE_FULL"
            raise OSError(errno.ENOSPC if full else errno.EIO, str(error)) from error

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._db.close()


# -- reading ---------------------------------------------------------------------------------------


class _Scan:
    """A history file but for its arrays of numbers; `problem` is empty if all is well.

    `missing` are ranges of states that a damage took, the end excluded.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.problem, self.item = path, "", f"history file {str(path)!r}"
        self.missing: list[tuple[int, int]] = []
        self.notes: dict[str, list[dict[str, Any]]] = {"head": [], "note": [], "tail": []}
        self.pieces: dict[str, dict[int, list[_Piece]]] = {
            "static": {},
            "series": {},
            "sensors": {},
        }
        with self.opened() as db:
            self.run, notes, arrays = db.execute("SELECT * FROM file").fetchone()
            for kind, value, crc in self._listed(db, "kind, value, crc FROM notes", notes):
                if _sum(kind, value) == crc:
                    self.notes[kind].append(json.loads(value))
                else:
                    self.blame("wrong checksum in the metadata")
            columns = "id, kind, name, first, dtype, shape, crc, length(data) FROM arrays"
            for *row, size in self._listed(db, columns, arrays):
                piece = _Piece(*row)
                if piece.fits(size):
                    self.pieces[piece.kind].setdefault(piece.first, []).append(piece)
                else:
                    self.blame("an array is not as it was written")
        if not self.notes["head"]:
            self.blame("the head is missing")
            raise HistoryError(self.item, f"damaged: {self.problem}; nothing can be recovered")

    @contextlib.contextmanager
    def opened(self) -> Iterator[sqlite3.Connection]:
        """The database; what is not as we write it is a HistoryError."""
        try:
            with self.path.open("rb") as handle:
                start = handle.read(len(_START))
        except OSError as error:
            raise HistoryError(self.item, f"cannot be read: {error.strerror}") from error
        if start != _START:
            old = start.startswith(b"SKFEM-COSSERAT")
            why = (
                " any more: version 0.2 and older wrote it"
                if old
                else f": it starts with {start!r}"
            )
            raise HistoryError(self.item, f"is not a history{why}" if start else "is empty")
        # not read-only: a writer that was killed in a transaction left what takes that back
        db = sqlite3.connect(f"{self.path.resolve().as_uri()}?mode=rw", uri=True)
        try:
            (application,) = db.execute("PRAGMA application_id").fetchone()
            (version,) = db.execute("PRAGMA user_version").fetchone()
            if application != _APPLICATION:
                raise HistoryError(self.item, "is not a history, but another SQLite database")
            if version != _VERSION:
                raise HistoryError(self.item, f"has format version {version}, not {_VERSION}")
            yield db
        except InputError:
            raise
        except _WRONG as error:
            raise HistoryError(self.item, f"damaged: {error}; {_ADVICE}") from error
        finally:
            db.close()

    def _listed(self, db: sqlite3.Connection, what: str, count: int) -> list[tuple[Any, ...]]:
        """Rows of a table in their order, as far as they can be read."""
        rows, at = {}, 0
        while at < min(count, self.path.stat().st_size):
            try:
                for row in db.execute(f"SELECT id, {what} WHERE id > ? ORDER BY id", [at]):
                    at = row[0]
                    rows[at] = row[1:]
                break
            except sqlite3.Error as error:  # perhaps of this row alone
                self.blame(str(error))
                at += 1
        if len(rows) != count:
            self.blame(f"{len(rows)} of {count} rows can be read")
        return list(rows.values())

    def blame(self, problem: str) -> None:
        """Take down what is wrong; of several things the first one is told."""
        self.problem = self.problem or problem

    def blocks(self, kind: str, read: sqlite3.Connection | None = None) -> list[list[_Piece]]:
        """Arrays of each block of a kind that is sound, as far as this is known.

        With `read` it is known of all: their numbers are read.
        """
        every = self.pieces[kind]
        names = {piece.name for block in every.values() for piece in block}
        out: list[list[_Piece]] = []
        at = 0
        for first, block in sorted(every.items()):
            lengths = {piece.rows for piece in block}
            whole = len(block) == len(names) and names == {piece.name for piece in block}
            whole &= not out or [p.form for p in out[0]] == [p.form for p in block]
            if kind == "series":
                whole &= len(lengths) == 1 and first >= at
                if first > at:
                    self.missing.append((at, first))
            if whole and read is not None:
                try:
                    for piece in block:
                        piece.array(read)
                except (ValueError, sqlite3.Error):
                    whole = False
            at = max(at, first + max(lengths))
            if whole:
                out.append(block)
                continue
            self.blame(f"{kind} from number {first} on")
            if kind == "series":
                self.missing.append((first, at))
        total = max((tail["states"] for tail in self.notes["tail"]), default=0)
        if kind == "series" and at < total:
            self.blame(f"states {at} to {total - 1} are missing")
            self.missing.append((at, total))
        return out


class StoredArrays(MutableMapping[str, Array]):
    """Arrays by name, each read from a file when it is first asked for.

    Raises
    ------
    HistoryError
        If an array is damaged, or the file is another one by then.
    """

    def __init__(self, scan: _Scan, blocks: Sequence[Sequence[_Piece]]) -> None:
        self._scan, self._arrays = scan, dict[str, Array]()
        self._pieces: dict[str, list[_Piece]] = {}
        for piece in (piece for block in blocks for piece in block):
            self._pieces.setdefault(piece.name, []).append(piece)

    def __getitem__(self, name: str) -> Array:
        if name not in self._arrays:
            pieces = self._pieces[name]
            with self._scan.opened() as db:
                if db.execute("SELECT run FROM file").fetchone() != (self._scan.run,):
                    raise HistoryError(self._scan.item, "has been replaced by another history")
                dtype, shape = pieces[0].form
                out = np.empty((sum(piece.rows for piece in pieces), *shape), dtype)
                done = 0
                for piece in pieces:
                    out[done : done + piece.rows] = piece.array(db)
                    done += piece.rows
            if name in ORIGINS:
                out.flags.writeable = False
            self._arrays[name] = out
        return self._arrays[name]

    def __setitem__(self, name: str, array: Array) -> None:
        self._arrays[name] = array

    def __delitem__(self, name: str) -> None:
        self._arrays.pop(name, None)
        self._pieces.pop(name, None)

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys([*self._pieces, *self._arrays]))

    def __len__(self) -> int:
        return len(self._pieces.keys() | self._arrays.keys())

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)

    @property
    def length(self) -> int:
        """Number of states."""
        return sum(piece.rows for piece in self._pieces["t"])


def _metadata(scan: _Scan, states: int) -> dict[str, Any]:
    """Meta data with all changes and the status, of a file with so many states."""
    meta = {**scan.notes["head"][0], "status": "killed"}
    for note in scan.notes["note"]:
        meta |= note
    for tail in scan.notes["tail"]:
        meta |= {name: value for name, value in tail.items() if name != "states"}
    for number in [about["row"] for about in meta.get("segments", [])]:
        if type(number) is not int or number < 0:
            raise ValueError(f"segment from row {number!r}")
    for event in meta.get("events", []):
        if type(EventRecord(**event).row) is not int or event["row"] < 0:
            raise ValueError(f"event at row {event['row']!r}")
    for name, about in meta.get("sensors", {}).items():
        if not isinstance(about["unit"], str) or about["derivative"] not in (0, 1, 2):
            raise ValueError(f"unit and derivative of sensor {name!r}")
    if not scan.notes["tail"]:  # what followed the last states in the file has not happened
        for name, least in (("segments", 1), ("events", 2)):
            if name in meta:
                meta[name] = [each for each in meta[name] if each["row"] <= max(states, 0) - least]
        if "segments" in meta and not meta["segments"]:
            del meta["segments"]
    return meta


def _tell(scan: _Scan, t: Array, meta: dict[str, Any]) -> None:
    """Say what a damaged file has lost, and number rows in the meta data as they are now."""
    lost = []
    kept = np.ones(len(t) + sum(b - a for a, b in scan.missing), dtype=bool)
    for a, b in scan.missing:
        kept[a:b] = False
        before, after = int(kept[:a].sum()), int(kept[:b].sum())
        where = [f"after t = {t[before - 1]:.6g}"] if before else []
        where += [f"before t = {t[after]:.6g}"] if after < len(t) else []
        which = f"states {a} to {b - 1}" if b > a + 1 else f"state {a}"
        lost.append(f"{which} ({' and '.join(where)})" if where else which)
    if not scan.notes["tail"]:
        lost.append("all after the last of them")
    text = f"damaged: {scan.problem}; {len(t)} states recovered"
    warn(scan.item, f"{text}, missing: {', '.join(lost)}" if lost else text, IncompleteWarning)
    if not scan.missing:
        return
    meta["missing"] = [[a, b - 1] for a, b in scan.missing]
    number = np.concatenate([[0], np.cumsum(kept)])  # of rows before
    top = len(kept)
    for about in meta.get("segments", []):
        about["row"] = int(number[min(about["row"], top)])
    for event in meta.get("events", []):  # of one that is lost: the state before
        event["row"] = max(int(number[min(event["row"] + 1, top)]) - 1, 0)


def load_file(
    path: FilePath, recover: bool = False
) -> tuple[
    dict[str, Any], dict[str, Array], MutableMapping[str, Array], MutableMapping[str, Array]
]:
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
    path, recover = file_path("argument path", path), switch("argument recover", recover)
    scan = _Scan(path)
    with scan.opened() as db:
        static = {}
        for piece in scan.pieces["static"].get(0, ()):
            try:
                static[piece.name] = piece.array(db).copy()
            except (ValueError, sqlite3.Error):
                scan.blame(f"static array {piece.name!r}")
        blocks = scan.blocks("series", db if recover else None)
        seen = scan.blocks("sensors", db if recover else None)
        series, sensors = StoredArrays(scan, blocks), StoredArrays(scan, seen)
        if not blocks:
            empty = {"t": (0,), "step": (0,), "q": (0, 0), "p": (0, 0)}
            for name, shape in empty.items():
                series[name] = np.zeros(shape, np.int64 if name == "step" else np.float64)
        meta = _metadata(scan, series.length if blocks else 0)
        check_basic(series, "series")
    if scan.problem:
        if not recover:
            raise HistoryError(scan.item, f"damaged: {scan.problem}; {_ADVICE}")
        _tell(scan, series["t"], meta)
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
    ...     writer.note("head", {"step": 0.01})
    ...     writer.close()
    ...     read_meta(path)
    {'step': 0.01, 'status': 'killed', 'states': 0}
    """
    scan = _Scan(file_path("argument path", path))
    states = sum(block[0].rows for block in scan.blocks("series"))
    if scan.problem:
        raise HistoryError(scan.item, f"damaged: {scan.problem}; {_ADVICE}")
    return {**_metadata(scan, states), "states": states}


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
        try:
            _save_blocks(writer, meta, static, series, sensors)
        finally:
            writer.close()
        with temporary.open("rb+") as handle:
            os.fsync(handle.fileno())
        temporary.replace(path)
    except OSError as error:
        time = float(series["t"][-1]) if len(series["t"]) else None
        advice = "; what was there before is as it was, the history is in .history of this error"
        raise StorageError(path, error, advice, time) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def _save_blocks(
    writer: FileWriter,
    meta: dict[str, Any],
    static: Mapping[str, Array],
    series: Mapping[str, Array],
    sensors: Mapping[str, Array],
) -> None:
    """All blocks of a complete file."""
    rows, instants = len(series["t"]), max(map(len, sensors.values()), default=0)
    size = sum(array.nbytes for array in series.values()) // max(rows, 1)
    stride = max(1, min(_SAVE_ROWS, SAVE_BYTES // max(size, 1)))
    writer.append("static", 0, static)
    writer.note("head", meta)
    for first in range(0, max(rows, 1), stride):
        some = slice(first, first + stride)
        writer.append("series", first, {name: array[some] for name, array in series.items()})
    for k, first in enumerate(range(0, instants, _SAVE_INSTANTS)):
        some = slice(first, first + _SAVE_INSTANTS)
        writer.append("sensors", k, {name: array[some] for name, array in sensors.items()})
    writer.note("tail", {"status": meta.get("status", "completed"), "states": rows})
