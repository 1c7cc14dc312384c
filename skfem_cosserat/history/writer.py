"""Recording of a run, state by state, in memory or streamed to a file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from types import TracebackType
from typing import Any

import numpy as np

from ..errors import InputError
from ..types import Array
from .container import History
from .data import check_basic, numbers, plain
from .file import FileWriter, load_file

#: types of single numbers in rows as they are
_PLAIN = {float: np.dtype(np.float64), int: np.dtype(np.int64)}


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
        Number of states that are written together. A killed run loses the current block, at most
        ``block`` states.

    Raises
    ------
    InputError
        If the file cannot be written, ``block`` is not positive or ``meta`` is no JSON data.

    Notes
    -----
    The last row can be changed by `amend` until the next `append` or `close`. Used as a context
    manager it closes with ``"completed"``, or with ``"interrupted"`` when an exception passes.

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
        path: str | os.PathLike[str] | None = None,
        block: int = 50,
    ) -> None:
        if block < 1:
            raise InputError("argument block", f"got {block}, expected at least 1")
        self._meta: dict[str, Any] = {**plain(meta, "meta"), "status": "running"}
        self._static = {k: numbers(v, f"static array {k!r}") for k, v in static.items()}
        self._block = block
        self._buffer: dict[str, Array] = {}
        self._fill = 0
        self._rows = 0
        self._done: list[dict[str, Array]] = []
        self._sensed: list[dict[str, Array]] = []
        self._closed = False
        self._file: FileWriter | None = None
        if path is not None:
            self._file = FileWriter(path)
            self._file.append({"kind": "head", "meta": self._meta}, self._static)

    def __len__(self) -> int:
        return self._rows

    def __enter__(self) -> HistoryWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if not self._closed:
            self.close("completed" if kind is None else "interrupted")

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
        values = row
        if not self._fit(row) or row.keys() != self._buffer.keys():
            values = {name: numbers(value, f"row entry {name!r}") for name, value in row.items()}
            if not self._rows:
                self._allocate(values)
            if values.keys() != self._buffer.keys():
                odd = sorted(values.keys() ^ self._buffer.keys())
                found = "is new" if odd[0] in values else "is missing"
                text = f"{found}; all rows have the same entries"
                raise InputError(f"row entry {odd[0]!r}", text)
            for name, value in values.items():
                self._check(name, value)
        if self._fill == self._block:
            self._flush()
        for name, value in values.items():
            self._buffer[name][self._fill] = value
        self._fill += 1
        self._rows += 1

    def amend(self, **fields: Any) -> None:
        """Overwrite entries of the last row, e.g. a force that is known one step later.

        Parameters
        ----------
        **fields : array or number
            Values as in `append`; use ``amend(**{"joint/hinge/force": value})`` for names that are
            no identifiers.

        Raises
        ------
        InputError
            If there is no row, no such entry, or shape or data type differ.
        """
        self._check_open()
        if not self._rows:
            raise InputError("history writer", "there is no row to amend yet")
        values = fields
        if not self._fit(fields):
            values = {name: numbers(value, f"row entry {name!r}") for name, value in fields.items()}
            for name, value in values.items():
                if name not in self._buffer:
                    raise InputError(f"row entry {name!r}", "is not in the row to be amended")
                self._check(name, value)
        for name, value in values.items():
            self._buffer[name][self._fill - 1] = value

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
            name: numbers(value, f"sensor array {name!r}").copy() for name, value in arrays.items()
        }
        if self._file is not None:
            self._file.append({"kind": "sensors"}, values)
        else:
            self._sensed.append(values)

    def history(self) -> History:
        """History of all rows so far (read back from the file if streamed).

        Raises
        ------
        HistoryError
            If the file was changed by someone else.
        """
        parts = self._done
        sensors = {
            name: np.concatenate([part[name] for part in self._sensed])
            for name in (self._sensed[0] if self._sensed else {})
        }
        if self._file is not None:
            done, sensors = load_file(self._file.path)[2:]
            parts = [done] if len(done["t"]) else []
        if self._fill or not parts:
            parts = [*parts, {name: array[: self._fill] for name, array in self._buffer.items()}]
        if not self._rows:
            zero = {"t": np.zeros(0), "step": np.zeros(0, np.int64)}
            parts = [{**zero, "q": np.zeros((0, 0)), "p": np.zeros((0, 0))}]
        series = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        return History(self._meta, self._static, series, sensors)

    def close(self, status: str = "completed", **meta_updates: Any) -> None:
        """Write what is left and the status; a second call is an error.

        Parameters
        ----------
        status : str
            ``"completed"``, ``"diverged"`` or ``"interrupted"``.
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
            self._file.append({"kind": "tail", "status": status, "meta": updates}, {})
            self._file.close()

    def _check_open(self) -> None:
        if self._closed:
            raise InputError("history writer", "is closed already")

    def _fit(self, row: Mapping[str, Any]) -> bool:
        """Whether all entries are plainly as in the first row: what else may do takes longer."""
        for name, value in row.items():
            model, kind = self._buffer.get(name), type(value)
            if model is None:
                return False
            if kind is np.ndarray:
                fits = value.dtype is model.dtype and value.shape == model.shape[1:]
            else:
                fits = model.ndim == 1 and _PLAIN.get(kind) is model.dtype
            if not fits:
                return False
        return True

    def _check(self, name: str, value: Array) -> None:
        model = self._buffer[name]
        if value.shape != model.shape[1:]:
            raise InputError(
                f"row entry {name!r}",
                f"got shape {value.shape}, expected {model.shape[1:]} as in the first row",
            )
        if value.dtype != model.dtype:
            raise InputError(
                f"row entry {name!r}",
                f"got data type {value.dtype}, expected {model.dtype} as in the first row",
            )

    def _allocate(self, values: Mapping[str, Array]) -> None:
        check_basic(values, "row")
        self._buffer = {
            name: np.empty((self._block, *value.shape), value.dtype)
            for name, value in values.items()
        }

    def _flush(self) -> None:
        if not self._fill:
            return
        part = {name: array[: self._fill] for name, array in self._buffer.items()}
        if self._file is not None:
            self._file.append({"kind": "rows", "rows": self._fill}, part)
        else:
            self._done.append({name: array.copy() for name, array in part.items()})
        self._fill = 0
