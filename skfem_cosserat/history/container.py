"""The container: constant arrays, series over the recorded states, and plain meta data."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..errors import InputError
from ..types import Array, Floats
from .data import BASIC, check_basic, numbers, plain
from .event import EventRecord
from .file import load_file, save_file
from .sensor import SensorRecord


class History:
    """Recorded states of a run.

    Parameters
    ----------
    meta : dict
        JSON data: integrator, treatment, step, versions, lists of beams, bodies, points and joints,
        ``status`` (``"running"``, ``"completed"``, ``"diverged"``, ``"interrupted"``, and
        ``"killed"`` for a file whose writer never closed it).
    static : mapping of str to array
        Arrays that do not change in time (numbering, connectivity, outlines).
    series : mapping of str to array
        Arrays of shape ``(N, ...)``; the first axis is the recorded state. Always there: ``t (N,)``
        times in s, ``step (N,)`` integers, ``q (N, n)`` coordinates, ``p (N, n)`` momenta.
    sensors : mapping of str to array, optional
        Of each sensor its instants ``NAME/t (K,)`` and what it has seen, ``NAME/x (K, ...)``;
        ``meta["sensors"][NAME]`` has its unit and how often it is differentiated.

    Raises
    ------
    InputError
        If a basic series is missing, lengths differ, or something is neither number nor text.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.linspace(0.0, 1.0, 5)
    >>> series = {"t": t, "step": np.arange(5), "q": np.zeros((5, 3)), "p": np.zeros((5, 3))}
    >>> history = History({"status": "completed"}, {}, series)
    >>> len(history), float(history.times[-1])
    (5, 1.0)
    >>> history.add_series("energy", 0.5 * t**2)
    >>> float(history.last()["energy"])
    0.5
    """

    def __init__(
        self,
        meta: Mapping[str, Any],
        static: Mapping[str, Any],
        series: Mapping[str, Any],
        sensors: Mapping[str, Any] | None = None,
    ) -> None:
        self.meta: dict[str, Any] = plain(meta, "meta")
        self.static: dict[str, Array] = {
            name: numbers(value, f"static array {name!r}") for name, value in static.items()
        }
        check_basic(series, "series")
        self._length = len(np.atleast_1d(series["t"]))
        self._series: dict[str, Array] = {}
        for name, value in series.items():
            self._put(name, value)
        self._sensors: dict[str, Array] = {
            name: numbers(value, f"sensor array {name!r}")
            for name, value in ({} if sensors is None else sensors).items()
        }

    def _put(self, name: str, value: Any) -> None:
        array = numbers(value, f"series {name!r}")
        if array.ndim == 0 or len(array) != self._length:
            raise InputError(
                f"series {name!r}",
                f"got shape {array.shape}, expected a first axis of {self._length} states",
            )
        self._series[name] = array

    @property
    def series(self) -> Mapping[str, Array]:
        """All series by name; `add_series` adds one."""
        return self._series

    @property
    def sensors(self) -> dict[str, SensorRecord]:
        """What ``simulate(..., sensors=...)`` recorded at every step, by name."""
        out = {}
        for name, about in self.meta.get("sensors", {}).items():
            if f"{name}/t" in self._sensors:
                arrays = self._sensors[f"{name}/t"], self._sensors[f"{name}/x"]
                record = SensorRecord(*arrays, about["unit"])
                out[name] = (
                    record.derivative(about["derivative"]) if about["derivative"] else record
                )
        return out

    @property
    def events(self) -> list[EventRecord]:
        """Events of a run, in the order in which they happened."""
        return [EventRecord(**event) for event in self.meta.get("events", [])]

    @property
    def segments(self) -> list[tuple[int, int]]:
        """First row, and that after the last one, of each part with joints or loads of its own."""
        starts = [min(s["row"], len(self)) for s in self.meta.get("segments", [{"row": 0}])]
        return list(zip(starts, [*starts[1:], len(self)], strict=True))

    def segment(self, k: int) -> History:
        """One of the segments, as a history of its own: of one system.

        Raises
        ------
        InputError
            If there is no segment `k`.
        """
        segments = self.segments
        if not -len(segments) <= k < len(segments):
            raise InputError("argument k", f"got segment {k}, there are {len(segments)}")
        meta = dict(self.meta)
        about = meta.pop("segments", [{}])[k]
        meta |= {name: about[name] for name in ("fingerprint",) if name in about}
        rows = slice(*segments[k])
        return History(meta, self.static, {name: s[rows] for name, s in self._series.items()})

    @property
    def times(self) -> Floats:
        """Times of the recorded states ``(N,)`` in s."""
        return self._series["t"]

    @property
    def status(self) -> str:
        """How the run ended."""
        return str(self.meta.get("status", "completed"))

    def __len__(self) -> int:
        return self._length

    def __repr__(self) -> str:
        span = f", t = {self.times[0]:g} ... {self.times[-1]:g} s" if len(self) else ""
        count = len(self.events)
        what = f", {count} event{'s' * (count > 1)}" if count else ""
        return (
            f"<History: {len(self)} states{span}, {len(self._series)} series{what}, {self.status}>"
        )

    def __contains__(self, name: object) -> bool:
        return name in self._series

    def __iter__(self) -> Iterator[str]:
        return iter(self._series)

    def __getitem__(self, name: str) -> Array:
        """Series ``name`` of shape ``(N, ...)``.

        Raises
        ------
        InputError
            If there is no such series; the error lists those that exist.
        """
        if name not in self._series:
            raise InputError(
                f"series {name!r}", f"not recorded; there are {', '.join(self.series)}"
            )
        return self._series[name]

    def add_series(self, name: str, array: Any) -> None:
        """Add a derived series, or replace one that was added before.

        Parameters
        ----------
        name : str
            Any name but ``t, step, q, p``.
        array : array_like
            Shape ``(N, ...)``.

        Raises
        ------
        InputError
            If the first axis does not have one entry per state, or a basic series would change.
        """
        if name in BASIC:
            raise InputError(
                f"series {name!r}", "is recorded by the simulation, choose another name"
            )
        self._put(name, array)

    def row(self, i: int) -> dict[str, Array]:
        """All series at state ``i`` (negative: from the end), as copies.

        Raises
        ------
        InputError
            If there is no state ``i``.
        """
        if not -self._length <= i < self._length:
            raise InputError("argument i", f"got state {i}, there are {self._length} states")
        return {name: np.array(values[i]) for name, values in self._series.items()}

    def last(self) -> dict[str, Array]:
        """All series at the last recorded state, as copies.

        Raises
        ------
        InputError
            If nothing was recorded.
        """
        return self.row(-1)

    def truncated(self, n: int) -> History:
        """Return a history of the first ``n`` states, and what sensors saw up to the last of them.

        Parameters
        ----------
        n : int
            From 0 to ``len(self)``.

        Raises
        ------
        InputError
            If ``n`` is outside this range.
        """
        if not 0 <= n <= self._length:
            raise InputError("argument n", f"got {n}, expected 0 to {self._length} states")
        cut = {name: values[:n].copy() for name, values in self._series.items()}
        end = self.times[n - 1] if n else -np.inf
        seen = {
            name: values[self._sensors[f"{name[:-2]}/t"] <= end].copy()
            for name, values in self._sensors.items()
        }
        return History(self.meta, self.static, cut, seen)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write everything to one file; an older file is replaced only when the new is complete.

        Parameters
        ----------
        path : path-like
            Name of the file.

        Raises
        ------
        InputError
            If the folder does not exist or cannot be written, or ``meta`` holds no JSON data.
        """
        meta = plain(self.meta, "meta")
        save_file(path, meta, self.static, self._series, self._sensors)

    @classmethod
    def load(cls, path: str | os.PathLike[str], recover: bool = False) -> History:
        """Read a history, also one whose writer was killed (status ``"killed"``).

        Parameters
        ----------
        path : path-like
            Name of the file.
        recover : bool
            Return what is sound in front of the damage instead of raising an error.

        Raises
        ------
        HistoryError
            If the file is not a history, of another version, cut short or damaged.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> import numpy as np
        >>> zeros = np.zeros((2, 3))
        >>> series = {"t": [0.0, 0.1], "step": [0, 1], "q": zeros, "p": zeros}
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder) / "run.history"
        ...     History({}, {}, series).save(path)
        ...     len(History.load(path))
        2
        """
        return cls(*load_file(path, recover))
