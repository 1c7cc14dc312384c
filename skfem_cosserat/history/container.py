"""Recorded states of a run, read by name and by place."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arguments import checked
from ..errors import CosseratError, HistoryError, IncompleteWarning, InputError, StorageError
from ..frames import Place, is_beam
from ..kernels import nearest_rotations
from ..notebook import Shown
from ..types import (
    TOLERANCE,
    Array,
    ArrayLike,
    FilePath,
    Floats,
    IndexArray,
    names_known,
    numbers,
    whole,
)
from ..warn import Notices, counted, listed, logger, told, warn
from .file import (
    BASIC,
    ORIGINS,
    EventRecord,
    StoredArrays,
    check_basic,
    load_file,
    plain,
    save_file,
    series_numbers,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..beam import Beam

# -- what a sensor has recorded: a number or vector at every step, with its spectrum ---------------


@checked
class Spectrum(NamedTuple):
    """One-sided amplitude spectrum of K instants.

    Attributes
    ----------
    frequencies : (K // 2 + 1,) array
        In Hz.
    amplitudes : (K // 2 + 1, ...) array
        Of a sine that fits the window, its amplitude (half of its range), in the record's units.
    """

    frequencies: Floats
    amplitudes: Floats

    def __repr__(self) -> str:
        last = f" to {self.frequencies[-1]:g} Hz" if len(self.frequencies) else ""
        return f"<Spectrum: {len(self.frequencies)} lines{last}>"

    def peaks(self, count: int = 5) -> Floats:
        """Frequencies (Hz) of the largest local maxima, largest first.

        Between the lines of the spectrum by a parabola through the logarithms of three amplitudes;
        vectors count by their length.

        Parameters
        ----------
        count : int
            At most so many.
        """
        from scipy.signal import find_peaks  # slow to import, seldom needed

        size = self.amplitudes
        if size.ndim > 1:
            size = np.linalg.norm(size.reshape(len(size), -1), axis=1)
        places, _ = find_peaks(size)
        places = places[np.argsort(-size[places])][:count]
        with np.errstate(divide="ignore"):
            left, mid, right = (np.log(size[places + k]) for k in (-1, 0, 1))
        curvature = left - 2 * mid + right
        sound = np.isfinite(curvature) & (curvature < 0)
        shift = np.where(sound, (left - right) / np.where(sound, 2 * curvature, 1.0), 0.0)
        return (places + shift) * self.frequencies[1]


@checked
def spectrum(times: ArrayLike, values: ArrayLike, window: str = "hann") -> Spectrum:
    """Amplitude spectrum of equidistant values, their mean and trend taken off.

    Parameters
    ----------
    times : (K,) array
        Equidistant instants (s), at least eight.
    values : (K, ...) array
    window : str
        Name of a window of ``scipy.signal.get_window``; amplitudes are those of a sine in it.

    Returns
    -------
    Spectrum

    Raises
    ------
    InputError
        If instants are not equidistant, too few, something is not finite, or there is no such
        window.

    Examples
    --------
    >>> t = np.linspace(0, 10, 1001)
    >>> found = spectrum(t, 0.3 * np.sin(2 * np.pi * 4.0 * t) + 2.0)
    >>> found.peaks(1).round(3).tolist(), float(found.amplitudes.max().round(3))
    ([4.0], 0.3)
    """
    t = numbers("argument times", "times", times)
    y = numbers("argument values", "values", values)
    if t.ndim != 1 or len(t) < 8 or y.shape[:1] != t.shape:
        raise InputError(
            "argument times", f"has shape {t.shape} for values {y.shape}, expected (K,), K >= 8"
        )
    if not (np.isfinite(t).all() and np.isfinite(y).all()):
        raise InputError("argument values", "times or values are not finite")
    steps = np.diff(t)
    step = float((t[-1] - t[0]) / (len(t) - 1))
    if not step > 0 or abs(steps - step).max() > 1e-6 * step:
        raise InputError(
            "argument times", f"steps from {steps.min():.6g} to {steps.max():.6g}, expected equal"
        )
    from scipy.signal import periodogram  # slow to import, seldom needed

    try:
        asked = {"detrend": "linear", "scaling": "spectrum", "axis": 0}
        frequencies, power = periodogram(y, 1 / step, window, **asked)
    except ValueError as error:
        raise InputError("argument window", f"{window!r} is none that scipy knows") from error
    power[1 : (len(t) + 1) // 2] *= 2  # of an amplitude half the square; the highest is alone
    return Spectrum(frequencies, np.sqrt(power))


@checked
@dataclass(frozen=True)
class SensorRecord:
    """Values of a sensor at every step of a run.

    Attributes
    ----------
    times : (K,) array
        In s.
    values : (K, ...) array
    unit : str

    Examples
    --------
    >>> record = SensorRecord(np.arange(9) * 0.1, np.arange(9.0) ** 2, "m")
    >>> record.values.shape, record.unit
    ((9,), 'm')
    """

    times: Floats
    values: Floats
    unit: str = ""

    def __repr__(self) -> str:
        t = self.times
        unit = f" in {self.unit}" if self.unit else ""
        span = f", t = {t[0]:g} ... {t[-1]:g} s" if len(t) else ""
        return f"<SensorRecord: {len(t)} values of shape {self.values.shape[1:]}{unit}{span}>"

    def spectrum(self, window: str = "hann") -> Spectrum:
        """Amplitude spectrum, by :func:`spectrum`."""
        return spectrum(self.times, self.values, window)

    def derivative(self, order: int) -> SensorRecord:
        """First or second derivative by differences of second order, at the ends one-sided.

        Second derivatives where steps differ: of first order in their difference.
        """
        t = self.times
        x = self.values
        per = {1: "/s", 2: "/s^2"}[order]
        if len(t) < order + 2:
            return SensorRecord(t, np.full(x.shape, np.nan), self.unit + per)
        steps = np.diff(t)
        unit = float((t[-1] - t[0]) / (len(t) - 1))
        if abs(steps - unit).max() <= 1e-6 * unit:
            at = np.arange(len(t), dtype=float)  # differences of equal steps have no rounding
        else:
            at = t
            unit = 1.0
        with np.errstate(divide="ignore", invalid="ignore"):  # two instants of one time: NaN
            out = np.gradient(x, at, axis=0, edge_order=2)
        if order == 2:
            steps = np.diff(at).reshape(-1, *[1] * (x.ndim - 1))
            out[1:-1] = 2 * np.diff(np.diff(x, axis=0) / steps, axis=0) / (steps[1:] + steps[:-1])
            middle = (at[:-2] + at[1:-1] + at[2:]) / 3  # where these are, of cubic polynomials
            for end, to in ((0, 1), (-1, -1)):
                share = (at[end] - middle[end]) / (middle[end + to] - middle[end])
                out[end] = out[end + to] + share * (out[end + 2 * to] - out[end + to])
        out /= unit**order
        return SensorRecord(t, out, self.unit + per)


# -- material points in recorded states: rows of q, or of velocities, at places and along beams ----

#: how items are called in the static arrays of a history
_KEYS = ("beam/{}/offsets", "body/{}/offset", "point/{}/offset")
WHERE = "beam.node(name), body.at(x), point.place(), ground(x), or a Beam with an arc length s"


def rows_at(
    static: Mapping[str, Array], x: Array, where: Place | Beam, s: Any, part: str | None
) -> Floats:
    """Rows that series of coordinates (N, n) have at a point of an item.

    Parameters
    ----------
    static : mapping of str to array
        Of the history.
    x : (N, n) array
        ``q``, or velocities.
    where, s, part
        As for :meth:`History.position`; no place of the ground.

    Returns
    -------
    (N, 4, 3) array
        The point itself, then d1, d2, d3; (N, 1, 3) of a mass point, (N, k, 4, 3) of k arc
        lengths.
    """
    if not isinstance(where, Place):
        return _along(static, x, where, s, part)
    if s is not None or part is not None:
        name, value = ("s", s) if s is not None else ("part", part)
        raise InputError(f"argument {name}", f"{value!r} is for beams, not for the {where.label}")
    item: Any = where.item
    offsets = np.ravel(_offsets(static, item.name, where.label))
    if where.vertex >= len(offsets):
        text = f"is vertex {where.vertex}, the history has {len(offsets)} of them: another mesh"
        raise InputError(where.label, text)
    first = int(offsets[where.vertex])
    frame = where.origin[None] if where.triad is None else np.vstack([where.origin, where.triad])
    _check_reference(static, where.label, np.array([first]), frame[None])
    rows = x[:, first : first + frame.size].reshape(len(x), *frame.shape).copy()
    rows[:, 0] += np.einsum("i,nic->nc", where.offset[: len(frame) - 1], rows[:, 1:])
    return rows


def checked_point(where: Place | Beam, s: Any, part: str | None) -> None:
    """Raise InputError if it is neither a place nor a beam with an arc length."""
    if not is_beam(where) and not isinstance(where, Place):
        raise InputError("argument place", f"is of type {type(where).__name__}, expected {WHERE}")
    if part is not None and not isinstance(part, str):
        raise InputError("argument part", f"is of type {type(part).__name__}, expected a name")
    if is_beam(where) and s is None:
        raise InputError("argument s", f"is missing: the arc length (m) on the {where.label}")


def ground_rows(place: Place, times: Floats, rates: bool) -> Floats:
    """Frames (N, 4, 3) of a place on the ground, or their rates."""
    from ..model.ground import Ground  # imports much that histories do without

    own = Ground([place])
    if rates:
        return np.array([own.rate_and_error(t)[0][-4:] for t in times.tolist()]).reshape(-1, 4, 3)
    out = np.array([own.at(t)[-4:] for t in times.tolist()]).reshape(-1, 4, 3)
    if place.motion is None:
        out[:, 0] = place.position
    return out


def _along(static: Mapping[str, Array], x: Array, beam: Beam, s: Any, part: str | None) -> Floats:
    lengths = numbers(beam.label, "s", s)
    elements, xi = beam.along(np.atleast_1d(lengths), part)
    offsets = np.ravel(_offsets(static, beam.name, beam.label))
    frames = beam.reference.reshape(-1, 4, 3)
    if len(frames) != len(offsets):
        raise InputError(
            beam.label, f"has {len(frames)} nodes, that of the history {len(offsets)}: another mesh"
        )
    _check_reference(static, beam.label, offsets, frames)
    columns = offsets[beam.basis.connectivity[elements]][..., None] + np.arange(12)
    nodal = x[:, columns].reshape(len(x), *columns.shape[:2], 4, 3).copy()
    nodal[..., 1:, :] = beam.rotations[elements] @ nodal[..., 1:, :]
    rows = np.einsum("ka,nkaic->nkic", beam.basis.shape(xi).T, nodal)
    return rows if lengths.ndim else rows[:, 0]


def _offsets(static: Mapping[str, Array], name: str | None, label: str) -> IndexArray:
    """First numbers in q of an item's frames."""
    for key in _KEYS:
        if name is not None and key.format(name) in static:
            return static[key.format(name)]
    known = sorted(
        key.split("/", 1)[1].rpartition("/")[0]
        for key in static
        if key.endswith(("/offset", "/offsets"))
    )
    raise InputError(label, f"is not in this history, which has {', '.join(known) or 'no items'}")


def _check_reference(
    static: Mapping[str, Array], label: str, offsets: IndexArray, frames: Floats
) -> None:
    """Refuse items whose frames (k, 1 or 4, 3) are not those of the history."""
    reference = static.get("reference")
    if reference is None:
        return
    size = frames[0].size
    there = np.array([reference[k : k + size] for k in offsets if k + size <= len(reference)])
    here = frames.reshape(len(frames), size)
    scale = 1.0 + abs(reference).max(initial=0.0)
    if there.shape != here.shape or abs(there - here).max() > TOLERANCE * scale:
        raise InputError(
            label,
            "is another one than that of the history: the reference of its nodes differs (another"
            " mesh, or another model)",
        )


# -- series that follow from what is recorded, made when somebody asks for them --------------------

#: how a history without its system gets more series
ADVICE = "skfem_cosserat.run.derive_series(model, history) adds those that follow from the states"


#: how series follow from others of a history
Formula = Callable[["History"], Sequence[Floats]]
#: those of a system, by the names of series that come together
Formulas = dict[tuple[str, ...], Formula]
#: the formulas of a system, for histories of one kind
Kind = Callable[[Any], Formulas]

#: energy less all that explains its changes, of a whole run
BALANCE = "energy_balance"
#: series that a file has in any case, beside those of items: energies, and what pictures need
SAVED = (
    "v",
    "kinetic",
    "strain_energy",
    "external",
    "coupling_energy",
    "energy",
    BALANCE,
    "linear_momentum",
    "angular_momentum",
)


class _Available(Mapping[str, Array]):
    """Series of a history by name, derived when they are asked for; one state of them, copied."""

    def __init__(self, history: History, row: int | None = None):
        self._history = history
        self._row = row

    def __getitem__(self, name: str) -> Array:
        if name not in self._history:
            raise KeyError(name)
        values = self._history[name]
        return values if self._row is None else np.array(values[self._row])

    def __iter__(self) -> Iterator[str]:
        return iter(self._history)

    def __len__(self) -> int:
        return len(list(self._history))

    def __contains__(self, name: object) -> bool:
        return name in self._history

    def __repr__(self) -> str:
        of = "" if self._row is None else f" at state {self._row}"
        return f"<series{of}: {', '.join(self._history)}>"


# -- the container: constant arrays, series over the recorded states, and plain meta data ----------


@checked
class History(Shown):
    """Recorded states of a run.

    What was not recorded but follows from the states (energies, forces, velocities ...) is derived
    when it is first asked for, and kept: ``history["energy"]``.

    Parameters
    ----------
    meta : dict
        JSON data: integrator, treatment, step, versions, lists of beams, bodies, points and joints,
        ``warnings`` (dicts of category, item, text, time, and when: the time in words),
        ``status`` (``"running"``, ``"completed"``, ``"stopped"`` by a callback or an event,
        ``"diverged"``, ``"interrupted"``, ``"failed"`` by another error, and ``"killed"`` for a
        file whose writer never closed it).
    static : mapping of str to array
        Arrays that do not change in time (numbering, connectivity, outlines).
    series : mapping of str to array
        Arrays of shape ``(N, ...)``; the first axis is the recorded state. Always there: ``t (N,)``
        times in s, ``step (N,)`` integers, ``q (N, n)`` coordinates, ``p (N, n)`` momenta.
    sensors : mapping of str to array, optional
        Of each sensor its instants ``NAME/t (K,)`` and what it has seen, ``NAME/x (K, ...)``;
        ``meta["sensors"][NAME]`` has its unit and how often it is differentiated.
    systems : sequence of System, optional
        Of its segments; without them there are no series but `series`.
    kind : callable, optional
        Gives the formulas of a system, by which other series follow; a function of a module.

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
        systems: Sequence[Any] | bytes = (),
        kind: Kind = dict,
    ):
        self.meta = plain(meta, "meta")
        self.static = {
            name: series_numbers(value, f"static array {name!r}") for name, value in static.items()
        }
        check_basic(series, "series")
        self._length = len(np.atleast_1d(series["t"]))
        self._series: MutableMapping[str, Array] = {}
        if isinstance(series, StoredArrays):
            self._series = series
        for name, value in () if self._series else series.items():
            self._put(name, value)
        self._sensors = sensors or {}
        if not isinstance(sensors, StoredArrays):
            self._sensors = {
                name: series_numbers(value, f"sensor array {name!r}")
                for name, value in self._sensors.items()
            }
        self._segments: dict[int, History] = {}
        self.derive_by(systems, kind)

    def __getstate__(self) -> dict[str, Any]:
        """With its systems, which are read when they are asked for; without them all series."""
        packed = self._systems
        if not isinstance(packed, bytes) and packed:
            self._names()  # they are known where the systems are not read yet
            try:
                packed = pickle.dumps(packed)
            except Exception as error:  # noqa: BLE001, whatever a user's own items raise
                logger.info("the system of a history cannot be pickled: %s", error)
                self.derive()
                packed = ()
        return vars(self) | {"_systems": packed, "_made": None, "_segments": {}}

    def _put(self, name: str, value: Any) -> None:
        array = series_numbers(value, f"series {name!r}")
        if array.ndim == 0 or len(array) != self._length:
            raise InputError(
                f"series {name!r}",
                f"got shape {array.shape}, expected a first axis of {self._length} states",
            )
        if name in ORIGINS:
            array = array.view()
            array.flags.writeable = False
        self._series[name] = array

    @property
    def series(self) -> Mapping[str, Array]:
        """All series by name, derived when they are looked at; `add_series` adds one."""
        return _Available(self)

    @property
    def recorded(self) -> list[str]:
        """Names of the series that are there: recorded, added, or derived so far."""
        return list(self._series)

    def derive_by(self, systems: Sequence[Any] | bytes, kind: Kind) -> None:
        """Have what is not recorded derived by the formulas of its systems."""
        #: systems of the segments, pickled as long as nobody has asked for them
        self._systems, self._kind = systems, kind
        #: formulas of each system, and names of all, made when a series is first asked for
        self._made: list[Formulas] | None = None
        self._known: list[str] | None = None
        self._segments.clear()

    @property
    def systems(self) -> Sequence[Any]:
        """Systems of its segments; none where they are not known, as of a file."""
        if isinstance(self._systems, bytes):
            try:
                self._systems = pickle.loads(self._systems)
            except Exception as error:  # whatever modules of the user's raise
                text = f"its scene cannot be read here ({error}): derive its series before pickling"
                raise HistoryError("history", text) from error
        return self._systems

    def _formulas(self) -> list[Formulas]:
        """Formulas of each system; many runs are never asked for a series."""
        if self._made is None:
            self._made = [self._kind(system) for system in self.systems]
        return self._made

    def _names(self) -> list[str]:
        """Names of all series that follow from the states, in their order."""
        if self._known is None:
            each = (name for made in self._formulas() for names in made for name in names)
            self._known = list(dict.fromkeys(each))
        return self._known

    def derive(self, names: Sequence[str] | None = None) -> None:
        """Derive series now, not when they are first asked for; what fails is a warning.

        Parameters
        ----------
        names : sequence of str, optional
            Default: all.
        """
        failed: dict[str, list[str]] = {}
        for name in list(self) if names is None else names:
            try:
                self[name]
            except CosseratError as error:
                failed.setdefault(str(error), []).append(name)
        with self._noting():
            for reason, missing in failed.items():
                text = f"{', '.join(missing)} cannot be had: {reason}"
                warn("derived series", text, IncompleteWarning)

    def _derive(self, name: str) -> None:
        """Derive a series, with those that come with it.

        A series that a segment does not have, of a joint that is gone say, is NaN there.
        Multipliers are in the order of their own system's rows, behind them NaN.
        """
        if not len(self):
            raise HistoryError("history", f"has no state that {name!r} could follow from")
        first, *others = self._formulas()
        with self._noting(), np.errstate(all="ignore"):
            if not others or name == BALANCE:
                together = next(names for names in first if name in names)
                found = dict(zip(together, first[together](self), strict=True))
            else:
                found = {name: self._of_segments(name)}
        for each, values in found.items():
            if each not in self._series:
                self._put(each, values)

    def _of_segments(self, name: str) -> Floats:
        """A series by those of its segments."""
        parts = [self.segment(k) for k in range(len(self._formulas()))]
        own = [part[name] if len(part) and name in part else None for part in parts]
        shapes = [values.shape[1:] for values in own if values is not None]
        size = tuple(map(int, np.max(shapes, 0))) if shapes and shapes[0] else ()
        out = np.full((len(self), *size), np.nan)
        for (start, stop), values in zip(self.segments, own, strict=True):
            if values is not None:
                out[(slice(start, stop), *(slice(length) for length in values.shape[1:]))] = values
        return out

    @contextmanager
    def _noting(self) -> Iterator[None]:
        """Warnings that are given here stay with the history."""
        known = self.meta.get("warnings", ())
        with Notices(known) as notices:
            yield
        if len(notices.found) > len(known):
            self.meta["warnings"] = notices.kept()

    @property
    def sensors(self) -> dict[str, SensorRecord]:
        """Records of ``simulate(..., sensors=...)`` at every step, by name."""
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
        return list(zip(starts, [*starts[1:], len(self)], strict=False))

    def segment(self, k: int) -> History:
        """One of the segments, as a history of its own: of one system.

        Raises
        ------
        InputError
            If there is no segment `k`.
        """
        segments = self.segments
        k = whole("argument k", k, None)
        if not -len(segments) <= k < len(segments):
            raise InputError("argument k", f"got segment {k}, there are {len(segments)}")
        k %= len(segments)
        if k not in self._segments:  # made once: what is derived in it is kept there
            meta = dict(self.meta)
            about = meta.pop("segments", [{}])[k]
            if "fingerprint" in about:
                meta["fingerprint"] = about["fingerprint"]
            rows = slice(*segments[k])
            systems = self.systems[k : k + 1]
            part = {name: s[rows] for name, s in self._series.items()}
            if "turns" in part and systems:
                own = systems[0].couplings
                part["turns"] = own.named(meta["turns"], np.asarray(part["turns"]))
                meta["turns"] = own.turning
            self._segments[k] = History(meta, self.static, part, None, systems, self._kind)
        return self._segments[k]

    def states(self, chosen: Sequence[int]) -> History:
        """Some of the states, increasing, as a history of its own: derives series of these alone.

        Parameters
        ----------
        chosen : sequence of int
            Their numbers.
        """
        rows = np.asarray(chosen, np.int64)
        series = {name: values[rows] for name, values in self._series.items()}
        about = self.meta.get("segments", [])
        starts = [int(np.searchsorted(rows, min(s["row"], len(self)))) for s in about]
        moved = [each | {"row": row} for each, row in zip(about, starts, strict=True)]
        meta = self.meta | ({"segments": moved} if about else {})
        return History(meta, self.static, series, None, self._systems, self._kind)

    def check_one_system(self) -> None:
        """Refuse what takes one system where events changed the scene.

        Raises
        ------
        HistoryError
            If there are several segments.
        """
        if len(self.segments) > 1:
            text = "its joints or loads changed on the way: take history.segment(k), and the system"
            raise HistoryError("history", f"{text} of that segment")

    @property
    def times(self) -> Floats:
        """Times of the recorded states ``(N,)`` in s."""
        return self._series["t"]

    @property
    def abscissa(self) -> Floats:
        """What states are drawn over: times (s), or the load factors of a path of equilibria."""
        return self["load_factor" if "load_factor" in self else "t"]

    @property
    def instants(self) -> Floats:
        """Times ``(N,)`` in s at which loads and motions are taken that are functions of time.

        On a path of :func:`skfem_cosserat.static` these are its load factors, or the one instant
        that it holds, ``meta["time"]``; of a mode that at which it was found.
        """
        held = self.meta.get("time" if "load_factor" in self else "instant")
        return self.abscissa if held is None else np.full(len(self), float(held))

    @property
    def status(self) -> str:
        """Status: the way in which the run ended."""
        return str(self.meta.get("status", "completed"))

    def __len__(self) -> int:
        return self._length

    def summary(self) -> dict[str, Any]:
        """What it is of, how it ended, what is doubtful, and what there is to be read."""
        meta = self.meta
        times = self.abscissa[[0, -1][: len(self)]]
        names: dict[str, str] = {}
        for group, _, own in (name.rpartition("/") for name in self):
            names[group] = f"{names[group]}, {own}" if group in names else own
        known = np.array(self._series.get(BALANCE, 0.0))
        ended = ": the run did not end; series that follow are had by derive_series(model, history)"
        return {
            "scheme": meta.get("integrator"),
            "treatment": meta.get("treatment"),
            "step in s": meta.get("step") or None,
            "states": len(self),
            "load factor" if "load_factor" in self else "time in s": times,
            "status": self.status + ended * (self.status == "killed"),
            "energy lost in J": meta.get("energy_balance", {}).get("lost"),
            "largest balance of energy in J": np.nanmax(abs(known), initial=0.0) or None,
            "warnings": told(meta.get("warnings", ())) or "none",
            "sensors": {name: about["unit"] for name, about in meta.get("sensors", {}).items()},
            "series": names.pop("", ""),
            **names,
        }

    def __repr__(self) -> str:
        before, unit = (", load factor", "") if "load_factor" in self else (", t =", " s")
        x = self.abscissa
        span = f"{before} {x[0]:g} ... {x[-1]:g}{unit}" if len(self) else ""
        count = len(self.events)
        what = f", {count} event{'s' * (count > 1)}" if count else ""
        doubt = counted(self.meta.get("warnings", ()))
        return (
            f"<History: {len(self)} states{span}, {len(list(self))} series{what}, {self.status}"
            f"{doubt}>"
        )

    def __str__(self) -> str:
        return "\n".join([repr(self), *listed(self.meta.get("warnings", ()))])

    def __contains__(self, name: object) -> bool:
        return name in self._series or name in self._names()

    def __iter__(self) -> Iterator[str]:
        """Names of all series, of those that are still to be derived, too."""
        later = dict.fromkeys(self._names())
        return iter([*(name for name in self._series if name not in later), *later])

    def __getitem__(self, name: str) -> Array:
        """Series ``name`` of shape ``(N, ...)``; derived now, if it is the first time.

        Raises
        ------
        InputError
            If there is no such series; the error lists those that exist.
        CosseratError
            If it cannot be derived.
        """
        if name not in self._series:
            if name not in self:
                others = self.meta.get("sensors", {}).keys() - {name}  # charts and tables have both
                text = names_known(name, [*self, *others], "recorded", "list(history)")
                more = "" if self._systems else f"; {ADVICE}"
                raise InputError(f"series {name!r}", f"not recorded; {text}{more}")
            self._derive(name)
        return self._series[name]

    def field(self, beam: str, index: int) -> Floats:
        """Coordinates (12 nodes,) of a beam in a state, in the order of its basis.

        They are those of ``beam.basis``, for scikit-fem's forms and ``basis.interpolate``.

        Parameters
        ----------
        beam : str
            Its name.
        index : int
            Number of the state; negative ones count from the end.

        Raises
        ------
        InputError
            If there is no such beam or state.

        Examples
        --------
        >>> import skfem_cosserat as sc
        >>> mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
        >>> section = sc.Section([1e4, 1e4, 1e4, 5, 5, 5], mass=1.0, inertia=(1.0, 1.0))
        >>> model = sc.Model()
        >>> rod = model.add("rod", sc.Beam(mesh, section, velocity=(1.0, 0, 0)))
        >>> history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.1, until=0.2)
        >>> change = history.field("rod", -1) - rod.reference
        >>> change[rod.basis.get_dofs("rod.end").all("phi_1")].round(9).tolist()
        [0.2]
        """
        key = f"beam/{beam}/offsets"
        if key not in self.static:
            known = [entry["name"] for entry in self.meta.get("beams", [])]
            raise InputError("argument beam", f"got {beam!r}; {names_known(beam, known)}")
        if not -len(self) <= index < len(self):
            raise InputError("argument index", f"got {index}, there are {len(self)} states")
        return self["q"][index][(self.static[key][:, None] + np.arange(12)).ravel()]

    def position(
        self, place: Place | Beam, s: ArrayLike | None = None, part: str | None = None
    ) -> Floats:
        """Position of a material point in all states.

        Parameters
        ----------
        place : Place or Beam
            As from ``beam.node(name)``, ``body.at(x)``, ``point.place()``, ``ground(x)``; of the
            scene of this history, or of the same scene built anew for one read from a file.
        s : float or (k,) array, optional
            On a beam: arc length in the reference from the start of the part (m).
        part : str, optional
            On a beam: name of a part of the mesh; default: the whole beam.

        Returns
        -------
        (N, 3) array
            In space (m), N states; (N, k, 3) for k arc lengths.

        Raises
        ------
        InputError
            For an item that is not in this history, or has another mesh there.

        Examples
        --------
        >>> from skfem_cosserat import LoadGravity, Model, NullSpace, RigidBody, Variational
        >>> from skfem_cosserat import simulate
        >>> model = Model()
        >>> rod = model.add("rod", RigidBody.box(1.0, (0.1, 0.1, 2.0), velocity=(3.0, 0, 0)))
        >>> history = simulate(model, Variational(), NullSpace(), 0.1, until=0.2)
        >>> end = rod.local((0, 0, 1.0))
        >>> history.position(end).round(9).tolist()
        [[0.0, 0.0, 1.0], [0.3, 0.0, 1.0], [0.6, 0.0, 1.0]]
        >>> history.velocity(end)[-1].round(9).tolist()
        [3.0, 0.0, 0.0]
        >>> history.rotation(end)[-1][2].round(9).tolist()   # d3
        [0.0, 0.0, 1.0]
        """
        return self._rows(place, s, part)[..., 0, :]

    def rotation(
        self, place: Place | Beam, s: ArrayLike | None = None, part: str | None = None
    ) -> Floats:
        """Rotation of the frame that carries a material point in all states.

        Parameters
        ----------
        place, s, part
            See :meth:`position`; no mass point.

        Returns
        -------
        (N, 3, 3) array
            In row i the director d_{i+1} in space, as in all triads of this package: components
            in the frame are ``rotation @ vector``. It is the frame of the node or body, which need
            not be the unit matrix in the reference. (N, k, 3, 3) for k arc lengths: those of the
            sections, the rotations nearest to the interpolated directors.

        Raises
        ------
        InputError
            As :meth:`position`, and for a mass point, which does not rotate.
        """
        rows = self._rows(place, s, part)
        if rows.shape[-2] == 1:
            raise InputError(place.label, "a mass point has no directors: it does not rotate")
        return rows[..., 1:, :] if s is None else nearest_rotations(rows[..., 1:, :])

    def velocity(
        self, place: Place | Beam, s: ArrayLike | None = None, part: str | None = None
    ) -> Floats:
        """Velocity of a material point in all states.

        Parameters
        ----------
        place, s, part
            See :meth:`position`.

        Returns
        -------
        (N, 3) array
            In space (m/s), from the series ``"v"``; zero on the path of a static scene.

        Raises
        ------
        InputError
            As :meth:`position`, and if the run was asked for no derived series.
        """
        if "load_factor" in self or "instant" in self.meta:
            return np.zeros_like(self.position(place, s, part))
        return self._rows(place, s, part, rates=True)[..., 0, :]

    def _rows(
        self, place: Place | Beam, s: ArrayLike | None, part: str | None, rates: bool = False
    ) -> Floats:
        """Rows of a point and its directors in all states, or their rates."""
        checked_point(place, s, part)
        if isinstance(place, Place) and place.item is None:
            return ground_rows(place, self.instants, rates)
        if rates and "v" not in self:
            raise InputError("series 'v'", f"not recorded, as with derive=False; {ADVICE}")
        return rows_at(self.static, self["v" if rates else "q"], place, s, part)

    def picture(
        self,
        path: FilePath | None = None,
        frames: int | Sequence[int] = 5,
        *,
        camera: str | Sequence[Sequence[float]] = "iso",
        colour: str = "M",
        radius: float | None = None,
        names: bool = False,
        window: tuple[int, int] = (1600, 900),
    ) -> Any:
        """Picture of the scene at several instants, earlier ones paler.

        Beams have their sections, or are tubes without an outline. Joints are drawn by what they
        leave free, at the last instant; so are the ground, forces (red) and moments (two heads).
        The longest arrow of a load shows the largest it has at the instants shown. Gravity is an
        arrow beside the axes.

        Parameters
        ----------
        path : path-like, optional
            Image file (``.png``). Default: shown in the notebook, or in a window.
        frames : int or sequence of int
            Number of instants, equally spaced in time, or numbers of the states.
        camera : str or three points
            ``"xy"``, ``"xz"``, ``"yz"``, ``"iso"``, or position, focal point and up direction.
        colour : str
            Of beams: ``"M"`` or ``"N"``, the norm of the moment or force; ``""``: one colour.
        radius : float, optional
            Draw all beams as tubes of this radius (m).
        names : bool
            Write the names of items beside them.
        window : (2,) int
            Width and height in pixels.

        Returns
        -------
        Path
            The image file; without one what a notebook shows.

        Raises
        ------
        InputError
            If there is nothing to draw, the folder is missing or an argument is out of range.
        ImportError
            Without pyvista (extra ``view``).
        CosseratError
            Without OpenGL.

        Examples
        --------
        >>> history.picture("swing.png", frames=8, camera="xz")  # doctest: +SKIP
        """
        from ..picture import Look, picture

        return picture(self, path, frames, Look(camera, colour, radius, names, window))

    def animate(
        self,
        path: FilePath,
        *,
        colour: str = "M",
        fps: float = 25,
        speed: float = 1.0,
        camera: str | Sequence[Sequence[float]] = "iso",
        radius: float | None = None,
        names: bool = False,
        window: tuple[int, int] = (960, 540),
    ) -> Path:
        """Film of the scene, with a clock.

        Frames are equally spaced in time; each shows the recorded state nearest to its instant.
        Camera, colours and the lengths of arrows mean the same in all frames.

        Parameters
        ----------
        path : path-like
            ``.gif``, which loops, or ``.mp4`` (H.264; extra ``film``).
        fps : float
            Frames per second, of a GIF at most 50.
        speed : float
            Simulated seconds in a second of the film; of a path the control's parameter: load
            factor, displacement or arc length. The text shows the load factor then.
        colour, camera, radius, names, window
            As for :meth:`picture`; an odd size is one pixel smaller.

        Returns
        -------
        Path
            The film.

        Raises
        ------
        InputError
            For more than 5000 frames, another ending, and as :meth:`picture`.
        ImportError, CosseratError
            As :meth:`picture`.

        Examples
        --------
        >>> history.animate("swing.gif", speed=0.5, camera="xy")  # doctest: +SKIP
        """
        from ..picture import Look, animate

        return animate(self, path, fps, speed, Look(camera, colour, radius, names, window))

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
        if not isinstance(name, str) or not name:
            raise InputError("argument name", f"{name!r}, expected the name of a series")
        if name in BASIC:
            raise InputError(
                f"series {name!r}", "is recorded by the simulation, choose another name"
            )
        self._put(name, array)
        self._segments.clear()

    def row(self, i: int) -> Mapping[str, Array]:
        """All series at state ``i`` (negative: from the end), as copies.

        Raises
        ------
        InputError
            If there is no state ``i``.
        """
        i = whole("argument i", i, None)
        if not -self._length <= i < self._length:
            raise InputError("argument i", f"got state {i}, there are {self._length} states")
        return _Available(self, i)

    def last(self) -> Mapping[str, Array]:
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
        if not 0 <= whole("argument n", n, None) <= self._length:
            raise InputError("argument n", f"got {n}, expected 0 to {self._length} states")
        cut = {name: values[:n].copy() for name, values in self._series.items()}
        end = self.times[n - 1] if n else -np.inf
        seen = {
            name: values[self._sensors[f"{name[:-2]}/t"] <= end]
            for name, values in self._sensors.items()
        }
        return History(self.meta, self.static, cut, seen, self._systems, self._kind)

    def plot(self, *names: str, path: FilePath | None = None) -> Figure:
        """Chart over time, or over the load factor of a path of equilibria.

        Parameters
        ----------
        *names : str
            Each gets a panel: sensors, or else series of shape ``(N,)`` or ``(N, k)``.
            ``"energy"`` is always the chart of all energies, with their balance in a panel below.
            Default: the energies and the sensors; without any the work of the loads.
        path : path-like, optional
            Write the chart here (``.png``, ``.svg``, ``.pdf``).

        Returns
        -------
        matplotlib.figure.Figure
            A notebook shows it.

        Raises
        ------
        InputError
            If there is no such sensor or series, or it has more axes.
        ImportError
            Without matplotlib.

        Examples
        --------
        >>> from skfem_cosserat import EnergyMomentum, LoadGravity, MassPoint, Model, NullSpace
        >>> from skfem_cosserat import simulate
        >>> model = Model()
        >>> ball = model.add("ball", MassPoint(2.0, velocity=(1.0, 0, 3.0)))
        >>> gravity = model.add("gravity", LoadGravity((0, 0, -9.81)))
        >>> history = simulate(model, EnergyMomentum(), NullSpace(), 0.1, until=0.5)
        >>> energies, balance, momentum = history.plot("energy", "linear_momentum").axes
        >>> energies.get_ylabel(), momentum.get_ylabel()
        ('energy in J', 'linear_momentum in kg m/s')
        """
        from ..plot import plot  # a history does without charts

        return plot(self, names, path)

    def report(self, path: FilePath) -> Path:
        """Page about the run in one file (HTML), which any browser shows without a network.

        It has the scene, to be turned and moved through time by a slider, energies with their
        balance, sensors, warnings, settings and versions; of a path load factors in place of times.
        It is at most 10 MB large: of long runs or large scenes it shows fewer states, and says so.

        Parameters
        ----------
        path : path-like
            Name of the file; an older one is replaced.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        InputError
            If there are no states, or the file cannot be written.
        ImportError
            Without plotly or matplotlib.

        Examples
        --------
        >>> history.report("run.html")  # doctest: +SKIP
        """
        from ..report import write_report  # a history does without pages

        return write_report(self, path)

    def to_pandas(self, *names: str) -> Any:
        """Table of its states as a ``pandas.DataFrame``, its index the times (s).

        Parameters
        ----------
        *names : str
            Series and sensors, in columns as :func:`skfem_cosserat.write_csv` has them; the index
            is the load factor of a path of equilibria.

        Raises
        ------
        InputError
            As there.
        ImportError
            Without pandas.

        Examples
        --------
        >>> import numpy as np
        >>> series = {"t": [0.0, 0.1], "step": [0, 1], "q": np.eye(2, 3), "p": np.zeros((2, 3))}
        >>> frame = History({}, {}, series).to_pandas("q")
        >>> list(frame.columns), frame["q_x"].tolist()
        (['q_x', 'q_y', 'q_z'], [1.0, 0.0])
        """
        from ..export.table import to_pandas  # a history does without other formats

        return to_pandas(self, names)

    def save(self, path: FilePath) -> None:
        """Write it to one file; an older file is replaced only when the new is complete.

        Of series that follow from the states the file has those that were asked for so far, and
        in any case energies and what pictures need. Others are derived anew from what is in it:
        see :func:`skfem_cosserat.run.derive_series`.

        Parameters
        ----------
        path : path-like
            Name of the file.

        Raises
        ------
        InputError
            If the folder does not exist or cannot be written, or ``meta`` holds no JSON data.
        StorageError
            If the disk is full, say.
        """
        items = ("beam/", "joint/", "coupling/", "load/")
        self.derive([n for n in self._names() if n in SAVED or n.startswith(items)])
        meta = plain(self.meta, "meta")
        try:
            save_file(path, meta, self.static, self._series, self._sensors)
        except StorageError as error:
            error.history = self
            raise

    @classmethod
    def load(cls, path: FilePath, recover: bool = False) -> History:
        """Read a history, also one whose writer was killed (status ``"killed"``).

        Series are read when they are first asked for.

        Parameters
        ----------
        path : path-like
            Name of the file.
        recover : bool
            Return all states that are sound instead of raising an error. Damage takes blocks of
            at most 100 states: an :class:`IncompleteWarning` says which, and ``meta["missing"]``
            lists the first and last number of each range.

        Raises
        ------
        HistoryError
            If the file is not a history, of another version, cut short or damaged. The numbers of a
            series are checked when they are read.

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
        with Notices() as notices:
            meta, static, series, sensors = load_file(path, recover)
        if notices.found:
            meta["warnings"] = [*meta.get("warnings", ()), *notices.found]
        return cls(meta, static, series, sensors)
