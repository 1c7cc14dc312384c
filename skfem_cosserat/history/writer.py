"""Recording of a run, state by state, in memory or streamed to a file."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..arguments import checked
from ..errors import HistoryError, IncompleteWarning, InputError, StorageError
from ..types import Array, FilePath
from ..warn import Notices, warn
from .container import History
from .file import SAVE_BYTES, FileWriter, check_basic, load_file, plain, series_numbers

#: bytes of a block in memory at most: blocks grow up to that
_LARGE = 2**28


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
    expected : int, optional
        How many states there will be, about: memory for them is taken at once.

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
        expected: int | None = None,
    ) -> None:
        if block < 1:
            raise InputError("argument block", f"got {block}, expected at least 1")
        self._meta: dict[str, Any] = {**plain(meta, "meta"), "status": "running"}
        self._static = {k: series_numbers(v, f"static array {k!r}") for k, v in static.items()}
        self._block = block
        self._expected = expected
        self._buffer: dict[str, Array] = {}
        self._fill = 0
        self._rows = 0
        self._done: list[dict[str, Array]] = []
        self._sensed: list[dict[str, Array]] = []
        self._closed = False
        self._head = dict(self._meta)
        #: the file as long as it takes blocks; a full one; and what is to be said of that
        self._file: FileWriter | None = None
        self._full: Path | None = None
        self._failure: OSError | None = None
        if path is not None:
            self._file = FileWriter(path)
            try:
                self._file.append({"kind": "head", "meta": self._meta}, self._static)
            except OSError as error:
                self._file.close()
                raise InputError(
                    f"history file {str(self._file.path)!r}",
                    f"cannot be written: {error.strerror}",
                ) from error

    def __len__(self) -> int:
        return self._rows

    @property
    def closed(self) -> bool:
        """Whether `close` has been called."""
        return self._closed

    @property
    def meta(self) -> dict[str, Any]:
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
        self._check_open()
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
        if not self._rows:
            self._begin(rows)
        self._check(rows)
        done, count = 0, len(rows["t"])
        while done < count:
            if self._fill == self._block:
                self._flush()
            taken = min(count - done, self._block - self._fill)
            here, there = slice(self._fill, self._fill + taken), slice(done, done + taken)
            for name, values in rows.items():
                self._buffer[name][here] = values[there]
            self._fill += taken
            self._rows += taken
            done += taken
        if self._failure is not None:
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
        self._stored({"kind": "note", "meta": own}, {})
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
        if not self._stored({"kind": "sensors"}, values):
            self._sensed.append(values)
        self._say()

    def history(self) -> History:
        """History of all rows so far (read back from the file if streamed).

        Raises
        ------
        HistoryError
            If the file was changed by someone else.
        """
        parts, sensed = self._done, self._sensed
        path = self._full if self._file is None else self._file.path
        if path is not None:
            done, sensors = self._read(path)
            written = self._rows - self._fill - sum(len(part["t"]) for part in parts)
            done = {name: array[:written] for name, array in done.items()}
            parts = [done, *parts] if len(done["t"]) else parts
            sensed = [sensors, *sensed] if sensors else sensed
        sensors = {
            name: np.concatenate([part[name] for part in sensed])
            for name in (sensed[0] if sensed else {})
        }
        if self._fill or not parts:
            rest = {name: array[: self._fill] for name, array in self._buffer.items()}
            if self._file is not None and not self._closed:  # the next block goes there
                rest = {name: array.copy() for name, array in rest.items()}
            parts = [*parts, rest]
        if not self._rows:
            zero = {"t": np.zeros(0), "step": np.zeros(0, np.int64)}
            parts = [{**zero, "q": np.zeros((0, 0)), "p": np.zeros((0, 0))}]
        if len(parts) == 1:  # rows are not written twice
            series = {name: np.ascontiguousarray(array) for name, array in parts[0].items()}
        else:
            series = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        return History(self._meta, self._static, series, sensors)

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
        updates = plain(meta_updates, "meta")
        self._flush()
        self._closed = True
        self._meta |= {**updates, "status": status}
        if self._file is not None:
            try:
                self._file.finish(self._head, self._static, status, updates, self._rows)
                self._file.close()
            except OSError as error:
                self._give_up(error)
        self._say()

    def _stored(self, header: dict[str, Any], arrays: Mapping[str, Array]) -> bool:
        """Hand a block to the file; whether it is there now."""
        if self._file is None:
            return False
        try:
            self._file.append(header, arrays)
        except OSError as error:
            self._give_up(error)
            return False
        return True

    def _give_up(self, error: OSError) -> None:
        """The file takes no more: from now on all is kept in memory."""
        assert self._file is not None
        self._full, self._failure = self._file.path, error
        with contextlib.suppress(OSError):
            self._file.close()
        self._file = None

    def _say(self) -> None:
        """Raise, once, that the file takes no more."""
        if self._failure is None:
            return
        assert self._full is not None
        reason, self._failure = self._failure, None
        history = self.history()
        kept = len(history) - self._fill - sum(len(part["t"]) for part in self._done)
        advice = (
            f"; {kept} states are in the file, all states in .history of this error:"
            " error.history.save(another file) keeps them"
        )
        time = float(history.times[-1]) if len(history) else None
        error = StorageError(self._full, reason, advice, time)
        error.history = history
        raise error from reason

    def _read(self, path: Path) -> tuple[dict[str, Array], dict[str, Array]]:
        """What the file has: series, and arrays of sensors."""
        try:
            # of a file that takes no more the last words may be cut off
            with Notices(quiet=True, alone=True):  # what is missing there is in memory
                return load_file(path, recover=self._full is not None)[2:]
        except HistoryError as error:
            if self._full is None:
                raise
            text = f"{error}; the states before those in memory are missing"
            warn(f"history file {str(path)!r}", text, IncompleteWarning)
            return {"t": np.zeros(0)}, {}

    def _check_open(self) -> None:
        if self._closed:
            raise InputError("history writer", "is closed already")

    def _check(self, rows: Mapping[str, Array]) -> None:
        if rows.keys() != self._buffer.keys():
            odd = sorted(rows.keys() ^ self._buffer.keys())
            found = "is new" if odd[0] in rows else "is missing"
            text = f"{found}; all rows have the same entries"
            raise InputError(f"row entry {odd[0]!r}", text)
        for name, values in rows.items():
            first = self._buffer[name]
            if values.dtype != first.dtype or values.shape[1:] != first.shape[1:]:
                raise InputError(
                    f"row entry {name!r}",
                    f"got {values.dtype} of shape {values.shape[1:]}, expected {first.dtype} of"
                    f" shape {first.shape[1:]} as in the first row",
                )

    def _begin(self, values: Mapping[str, Array]) -> None:
        """Take memory for rows like the first one."""
        check_basic(values, "row")
        size = max(1, sum(value.nbytes for value in values.values()))
        most = max(1, (SAVE_BYTES if self._file is not None else _LARGE) // size)
        wanted = self._block if self._expected is None or self._file else self._expected
        self._block = min(wanted, most)
        self._grow = 1 if self._file is not None or self._expected is not None else 2
        self._most = most
        self._allocate(values)

    def _allocate(self, like: Mapping[str, Array]) -> None:
        shapes = {name: (self._block, *array.shape[1:]) for name, array in like.items()}
        self._buffer = {name: np.empty(shapes[name], like[name].dtype) for name in like}

    def _flush(self) -> None:
        if not self._fill:
            return
        part = {name: array[: self._fill] for name, array in self._buffer.items()}
        first = self._rows - self._fill
        if not self._stored({"kind": "rows", "rows": self._fill, "first": first}, part):
            self._done.append(part)
            if self._fill == self._block:  # the next ones are written elsewhere
                self._block = min(self._most, self._grow * self._block)
                self._allocate(self._buffer)
        self._fill = 0
