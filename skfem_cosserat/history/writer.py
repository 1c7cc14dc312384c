"""Recording of a run, state by state, in memory or streamed to a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..arguments import checked
from ..errors import HistoryError, IncompleteWarning, InputError, StorageError
from ..types import Array, FilePath, Meta
from ..warn import warn
from .container import History
from .file import (
    SAVE_BYTES,
    FileWriter,
    cannot_write,
    check_basic,
    empty_series,
    json_array,
    load_file,
    plain,
    series_numbers,
)


@checked
class HistoryWriter:
    """Record states one after the other.

    Parameters
    ----------
    meta : mapping
        JSON data, see `History`.
    static : mapping of str to array
        Arrays that do not change in time.
    path : path-like, optional
        Stream to this file (an older one is overwritten); only the current block is kept in memory.
        The file is opened here, so a bad path is found before any work.
    block : int
        Number of states that are written together, fewer where they are large. A killed run loses
        the current block, at most ``block`` states.

    Raises
    ------
    InputError
        If the file cannot be written, ``block`` is not positive or ``meta`` is no JSON data.
    StorageError
        By any later call, if the file takes no more, as on a full disk: with the history so far.
        The file keeps the blocks before; what comes after is kept in memory.

    Notes
    -----
    Used as a context manager it closes with ``"completed"``, or with ``"interrupted"`` when an
    exception passes.

    Examples
    --------
    >>> import numpy as np
    >>> with HistoryWriter({"step": 0.1}, {}) as writer:
    ...     for k in range(3):
    ...         writer.append({"t": 0.1 * k, "step": k, "q": np.zeros(3), "p": np.zeros(3)})
    >>> writer.history()
    <History: 3 states, t = 0 ... 0.2 s, 4 series, completed>
    """

    def __init__(
        self,
        meta: Mapping[str, Any],
        static: Mapping[str, Any],
        path: FilePath | None = None,
        block: int = 50,
    ):
        if block < 1:
            raise InputError("argument block", f"got {block}, expected at least 1")
        self._meta = {**plain(meta, "meta"), "status": "running"}
        self._static = {k: series_numbers(v, f"static array {k!r}") for k, v in static.items()}
        self._block = block
        #: states and blocks of sensors that are not in the file
        self._parts: list[Mapping[str, Array]] = []
        self._sensed: list[Mapping[str, Array]] = []
        #: number of states, of those in the file, of blocks of sensors
        self._rows = self._stored = self._seen = 0
        #: type and shape of each entry of the rows
        self._like: dict[str, tuple[Any, ...]] = {}
        self._closed = False
        #: the file as long as it takes blocks, its name, and why it takes no more
        self._file: FileWriter | None = None
        self._path: Path | None = None
        self._failure: OSError | None = None
        if path is not None:
            try:
                self._file = FileWriter(path, self._meta, self._static)
            except OSError as error:
                raise cannot_write(path, error) from error
            self._path = self._file.path

    def __len__(self) -> int:
        return self._rows

    @property
    def closed(self) -> bool:
        """True after `close`."""
        return self._closed

    @property
    def meta(self) -> Meta:
        """A copy of the meta data so far, with the status."""
        return dict(self._meta)

    def __enter__(self) -> HistoryWriter:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if not self._closed:
            self.close("completed" if error is None else "interrupted")

    def append(self, row: Mapping[str, Any]) -> None:
        """Record one state (copied).

        Parameters
        ----------
        row : mapping of str to array or number
            Same names, shapes and data types in every call; ``t, step, q, p`` always.

        Raises
        ------
        InputError
            Naming the entry that does not fit the first row, or if the writer is closed.
        """
        values = {k: series_numbers(value, f"row entry {k!r}")[None] for k, value in row.items()}
        self.extend(values)

    def extend(self, rows: Mapping[str, Array]) -> None:
        """Record several states (copied).

        Parameters
        ----------
        rows : mapping of str to array
            As for :meth:`append`, with an axis for the states before all others.

        Raises
        ------
        InputError
            Naming the entry that does not fit the first row, or if the writer is closed.
        """
        self._check_open()
        like = {name: (values.dtype, values.shape[1:]) for name, values in rows.items()}
        if not self._rows:
            check_basic(rows, "row")
            size = sum(array[:1].nbytes for array in rows.values())
            self._block = max(1, min(self._block, SAVE_BYTES // max(size, 1)))
            self._like = like
        self._check(like)
        self._parts.append({name: values.copy() for name, values in rows.items()})
        self._rows += len(rows["t"])
        self._flush(self._block)
        self._say()

    def note(self, **meta: Any) -> None:
        """Add to ``meta`` what has happened, in the file at once: a killed run keeps it.

        Parameters
        ----------
        **meta : object
            JSON data; entries given again replace those before.

        Raises
        ------
        InputError
            If it is no JSON data, or the writer is closed.
        """
        self._check_open()
        own = plain(meta, "meta")
        self._meta |= own
        self._write("note", 0, json_array(own))
        self._say()

    def sense(self, arrays: Mapping[str, Any]) -> None:
        """Record what sensors saw at the steps since the last call (copied).

        Parameters
        ----------
        arrays : mapping of str to array
            Of each sensor its instants ``NAME/t (k,)`` and values ``NAME/x (k, ...)``.

        Raises
        ------
        InputError
            If something is no array of numbers, or the writer is closed.
        """
        self._check_open()
        values = {
            name: series_numbers(value, f"sensor array {name!r}").copy()
            for name, value in arrays.items()
        }
        if not self._write("sensors", self._seen, values):
            self._sensed.append(values)
        self._seen += 1
        self._say()

    def history(self) -> History:
        """History of all rows so far (read back from the file if streamed).

        Raises
        ------
        HistoryError
            If the file was changed by someone else.
        """
        stored: Mapping[str, Array] = {}
        seen: Mapping[str, Array] = {}
        if self._path is not None:
            try:
                _, _, stored, seen = load_file(self._path)
            except HistoryError as error:
                if self._file is not None:
                    raise
                text = f"{error}; the states before those in memory are missing"
                warn(error.item, text, IncompleteWarning)
        series = [part for part in (stored, *self._parts) if len(part.get("t", ()))]
        sensors = [part for part in (seen, *self._sensed) if part]
        return History(self._meta, self._static, joined(series) or empty_series(), joined(sensors))

    def close(self, status: str = "completed", **meta_updates: Any) -> None:
        """Write what is left and the status; a second call is an error.

        Parameters
        ----------
        status : str
            ``"completed"``, ``"stopped"``, ``"diverged"``, ``"interrupted"`` or ``"failed"``.
        **meta_updates : object
            JSON data that is added to ``meta``.

        Raises
        ------
        InputError
            If the writer is closed already, or an update is no JSON data.
        """
        self._check_open()
        updates = {**plain(meta_updates, "meta"), "status": status}
        self._flush(1)
        self._closed = True
        self._meta |= updates
        self._write("tail", self._rows, json_array(updates))
        if self._file is not None:
            self._file.close()
        self._say()

    def _write(self, kind: str, first: int, arrays: Mapping[str, Array]) -> bool:
        """Hand a block to the file; False if it does not take it."""
        if self._file is not None:
            try:
                self._file.append(kind, first, arrays)
            except OSError as error:  # from now on all is kept in memory
                self._file.close()
                self._file = None
                self._failure = error
        return self._file is not None

    def _say(self) -> None:
        """Raise, once, that the file takes no more."""
        if self._failure is None:
            return
        assert self._path is not None
        reason = self._failure
        self._failure = None
        history = self.history()
        advice = (
            f"; {self._stored} states are in the file, all states in .history of this error:"
            " error.history.save(another file) keeps them"
        )
        time = float(history.times[-1]) if len(history) else None
        error = StorageError(self._path, reason, advice, time)
        error.history = history
        raise error from reason

    def _check_open(self) -> None:
        if self._closed:
            raise InputError("history writer", "is closed already")

    def _check(self, given: dict[str, tuple[Any, ...]]) -> None:
        for name in sorted(given.keys() ^ self._like.keys()):
            text = "is new" if name in given else "is missing"
            raise InputError(f"row entry {name!r}", f"{text}; all rows have the same entries")
        for name, entry in given.items():
            if entry != self._like[name]:
                text = "got {} of shape {}, expected {} of shape {} as in the first row"
                raise InputError(f"row entry {name!r}", text.format(*entry, *self._like[name]))

    def _flush(self, least: int) -> None:
        """Hand blocks to the file as long as so many states are left for it."""
        while self._file is not None and self._rows - self._stored >= least:
            rows = joined(self._parts)
            block = {name: values[: self._block] for name, values in rows.items()}
            if self._write("series", self._stored, block):
                self._stored += len(block["t"])
                self._parts = [{name: values[self._block :] for name, values in rows.items()}]


def joined(parts: Sequence[Mapping[str, Array]]) -> Mapping[str, Array]:
    """Arrays of several blocks one after the other; of a single one they are not copied."""
    if len(parts) == 1:
        return parts[0]
    names = parts[0] if parts else ()
    return {name: np.concatenate([part[name] for part in parts]) for name in names}
