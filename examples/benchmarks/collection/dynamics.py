"""Problems in time: inputs by name, and the answers of the families' ``main``.

A family has a :class:`Problem`: its inputs, a builder of its :class:`.runs.Scene`, what is read
off an instant, and how fine it is computed unless told. Every stretch between two instants, of
output or where a load has a kink, is divided into equal steps, at most `step` long.

Without a `step` the answer is the limit of runs with steps halved (the error of both integrators
has even powers of the step only), until it changes by less than the problem's tolerance or the
levels that are affordable are through; ``estimated_error`` is the last change (m), of the step
alone. With a `step` it is the result of that one run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import skfem_cosserat as sc
from collection import common
from collection.runs import Motion, Run, Scene, framed, limit, quaternions, run
from skfem_cosserat.integrators.choice import choose_kernels

__all__ = ["COARSE", "Instant", "Problem", "all_of"]

Floats = NDArray[np.float64]
#: two digits, what the runs of others are good for that nobody has verified
COARSE = 1e-2


class Instant(NamedTuple):
    """What is known of an instant: time (s), places' placements and velocities, energy (J)."""

    t: float
    pos: dict[str, list[float]]
    quat: dict[str, list[float]]
    vel: dict[str, list[float]]
    energy: float


def all_of(now: Instant, data: Mapping[str, Any]) -> dict[str, Any]:
    """Positions, quaternions and energy, as most entries have them."""
    return {"pos": now.pos, "quat": now.quat, "energy": now.energy}


@dataclass(frozen=True)
class Problem:
    """A family in time.

    Parameters
    ----------
    entry : str
        Its name in ``reference.json``.
    inputs : dict
        Physical inputs by name.
    scene : callable
        ``(data, elements, order) -> Scene``.
    elements : tuple of int
        Of a beam, for orders 1 to 4, unless told.
    step : float
        Largest step of the ladder (s).
    levels : int
        Of the ladder, at most; each step is half of the one before.
    tolerance : float
        Of the limit's last change, largest of all positions (m).
    derived : dict of str to callable, optional
        Further inputs, ``data -> value``, which follow the others unless they are given.
    read : callable, optional
        ``(Instant, data) -> dict``, what an entry has of an instant.
    signed : tuple of str
        Inputs that may be zero or negative.
    """

    entry: str
    inputs: Mapping[str, Any]
    scene: Callable[[dict[str, Any], int, int], Scene]
    elements: tuple[int, int, int, int]
    step: float
    levels: int
    tolerance: float
    derived: Mapping[str, Callable[[dict[str, Any]], Any]] = field(default_factory=dict)
    read: Callable[[Instant, dict[str, Any]], dict[str, Any]] = all_of
    signed: tuple[str, ...] = ()

    def data(self, data: Mapping[str, Any] | None) -> dict[str, Any]:
        """All inputs, those of `data` in place of the entry's.

        Raises
        ------
        InputError
            If one is unknown, no number where one is expected, or not positive.
        """
        names = dict.fromkeys([*self.inputs, *self.derived])
        common.overridden(names, data)  # all of them known?
        given = dict(data or {})
        own = {name: value for name, value in given.items() if name in self.inputs}
        out = {
            name: _checked(name, default, own.get(name, default), self.signed)
            for name, default in self.inputs.items()
        }
        for name, rule in self.derived.items():
            default = rule(out)
            out[name] = _checked(name, default, given.get(name, default), self.signed)
        return out

    def build(self, data: Mapping[str, Any] | None, elements: int, order: int) -> Scene:
        """The scene alone, for a run of one's own."""
        return self.scene(self.data(data), elements, order)

    def keys(self) -> dict[str, float]:
        """All instants of the entry (s), by name."""
        values = common.entry(self.entry)["values"]
        nested = [inner for inner in values.values() if isinstance(inner, Mapping)]
        tracks = nested if _by_place(values) else [values]
        found = {key: float(key) for track in tracks for key in track}
        return dict(sorted(found.items(), key=lambda pair: pair[1]))

    def instant(self, case: Any) -> str:
        """The key of a case, given as text or number.

        Raises
        ------
        InputError
            If there is none.
        """
        for key, t in self.keys().items():
            try:
                if not isinstance(case, bool) and abs(float(case) - t) <= 1e-12 * max(t, 1.0):
                    return key
            except (TypeError, ValueError):
                break
        raise sc.InputError("case", f"{case!r} is unknown, expected one of {list(self.keys())}")

    def answer(self, case: Any = None, *arguments: Any) -> dict[str, Any]:
        """``main`` of a family whose cases are instants."""
        *most, times = arguments
        key = None if case is None else self.instant(case)
        known = {t: name for name, t in self.keys().items()}
        wanted = _instants(times) if times is not None else []
        if key is not None and float(key) not in wanted:
            wanted.append(float(key))
        wanted = wanted or list(known)
        moments, inputs, cost, taken = self.moments(wanted, *most)
        rows = [
            (known.get(t, f"{t:.12g}"), self.read(now, inputs))
            for t, now in zip(wanted, moments, strict=True)
        ]
        if key is not None and times is None:
            return {**common.instants(rows, wanted, key, cost), **taken}
        extra = {} if key is None else dict(rows)[key]
        return {**common.instants(rows, wanted, None, cost), **extra, **taken}

    def tracks(self, case: Any = None, *arguments: Any) -> dict[str, Any]:
        """``main`` of a family with lists of position and quaternion, by places and instants."""
        *most, times = arguments
        values = common.entry(self.entry)["values"]
        places = list(values) if _by_place(values) else []
        key = None
        if case is not None and not places:
            key = self.instant(case)
        elif case is not None and case not in places:
            raise sc.InputError("case", f"{case!r} is unknown, expected one of {places}")
        wanted = list(self.keys().values()) if key is None else [float(key)]
        if times is not None:
            wanted = _instants(times)
        moments, _, cost, taken = self.moments(wanted, *most)
        names = [f"{t:.4f}" for t in wanted]
        found = {
            place: {
                name: [*now.pos[place], *now.quat[place]]
                for name, now in zip(names, moments, strict=True)
            }
            for place in moments[0].pos
        }
        answer: dict[str, Any] = {"t": wanted, **found}
        if not places or case is not None:
            answer.update(found[case if places else next(iter(found))])
        return {**answer, **cost.fields(), **taken}

    def moments(
        self,
        times: Sequence[float],
        data: Mapping[str, Any] | None,
        order: int,
        elements: int | None,
        step: float | None,
        integrator: str,
        treatment: str,
    ) -> tuple[list[Instant], dict[str, Any], common.Cost, dict[str, Any]]:
        """Instants, all inputs, cost, and mesh and step as they were taken."""
        methods = common.choice(integrator, treatment)
        inputs = self.data(data)
        if order not in (1, 2, 3, 4):
            raise sc.InputError("order", f"{order!r}, expected 1, 2, 3 or 4")
        count = self.elements[order - 1] if elements is None else elements
        if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
            raise sc.InputError("elements", f"{elements!r}, expected a positive whole number")
        if step is not None and not (_is_number(step) and 0 < step < np.inf):
            raise sc.InputError("step", f"{step!r}, expected a positive number of seconds")
        scene = self.scene(inputs, int(count), order)
        system = scene.system
        with common.timed() as cost:
            cost.unknowns = system.unknowns
            if treatment == "multipliers":
                cost.unknowns = system.n + system.rank
            runs = self._ladder(scene, methods, step, times)
            good = [one for one in runs if one.converged] or runs[-1:]
            best, error = _extrapolated(good)
            cost.newton_iterations = sum(one.iterations for one in runs)
            cost.converged = good[-1].converged
        taken = {"order": order, "elements": _element_count(system), "step": good[-1].step}
        taken["estimated_error"] = error
        return _moments(scene, best, good[-1].turned, times), inputs, cost, taken

    def _ladder(
        self, scene: Scene, methods: tuple[Any, Any], step: float | None, times: Sequence[float]
    ) -> list[Run]:
        """One run with a given step, otherwise as many as are needed or affordable."""
        if step is not None:
            return [run(scene, *methods, step, times)]
        runs: list[Run] = []
        total = int(max(times) / self.step * (2**self.levels - 1))
        # seen as one piece of work, and compiled at a third of what a single run would be: other
        # families and cases take the same kernels
        kernels = choose_kernels("auto", scene.system, *methods, 3 * total).name
        for level in range(self.levels):
            runs.append(run(scene, *methods, self.step, times, 2**level, kernels))
            good = [one for one in runs if one.converged]
            if len(good) > 1 and _extrapolated(good)[1] < self.tolerance:
                break
        return runs

    def rows(
        self,
        family: str,
        times: Sequence[float] | None = None,
        elements: int | None = None,
        ladder: tuple[float, int] | None = None,
    ) -> list[dict[str, Any]]:
        """Rows of the table for all instants of one answer; `ladder`: other first step, levels."""
        if ladder is not None:
            step, levels = ladder
            return replace(self, step=step, levels=levels).rows(family, times, elements)
        most = (None, 3, elements, None, "energy-momentum", "null-space")
        values = common.entry(self.entry)["values"]
        listed = _by_place(values) or isinstance(next(iter(values.values())), list)
        result = (self.tracks if listed else self.answer)(None, *most, times)
        compared = [
            comparison
            for key in values
            if key in result
            for comparison in (_tracked if listed else _compared)(key, result[key], values[key])
        ]
        return common.tabled(family, result, compared)


def _by_place(values: Mapping[str, Any]) -> bool:
    """Whether an entry's values are dicts of instants, by places."""
    return not next(iter(values))[0].isdigit()


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def _checked(name: str, default: Any, value: Any, signed: Sequence[str]) -> Any:
    """A value of the kind that the default has; numbers that may not be zero are positive."""
    if isinstance(default, Mapping):
        if not isinstance(value, Mapping):
            raise sc.InputError("data", f"{name} = {value!r}, expected a dict")
        for key in value:
            if key not in default:
                known = list(default)
                raise sc.InputError("data", f"{name}: {key!r} is unknown, expected among {known}")
        return {
            key: _checked(f"{name}: {key}", one, value.get(key, one), signed)
            for key, one in default.items()
        }
    if isinstance(default, str) or not (np.ndim(default) or _is_number(default)):
        return value
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        numbers = np.array(np.nan)
    if not np.isfinite(numbers).all():
        raise sc.InputError("data", f"{name} = {value!r}, expected finite numbers")
    free = name.rsplit(": ", maxsplit=1)[-1] in signed
    if not free and not ((numbers > 0) | (np.ndim(default) > 0)).all():
        raise sc.InputError("data", f"{name} = {value!r}, expected a positive number")
    return value


def _instants(times: Any) -> list[float]:
    try:
        wanted = np.atleast_1d(np.asarray(times, dtype=float))
    except (TypeError, ValueError):
        wanted = np.array([np.nan])
    if wanted.ndim != 1 or not len(wanted) or not (np.isfinite(wanted) & (wanted >= 0)).all():
        raise sc.InputError("times", f"{times!r}, expected instants from 0 s on")
    return [float(t) for t in wanted]


def _element_count(system: sc.System) -> int:
    return sum(s.mesh.t.shape[1] for s in system.structures if isinstance(s, sc.Beam))


def _extrapolated(runs: Sequence[Run]) -> tuple[Motion, float]:
    """The limit, and by how much the last run changed it in any position."""
    steps, motions = [one.step for one in runs], [one.motion for one in runs]
    best = limit(steps, motions)
    if len(runs) == 1:
        return best, float("nan")
    before = limit(steps[:-1], motions[:-1])
    return best, float(abs(best.positions - before.positions).max())


def _moments(scene: Scene, motion: Motion, turned: Floats, times: Sequence[float]) -> list[Instant]:
    """By instants and places; the signs of quaternions are those of the run's."""
    turns = quaternions(motion.rotations)
    turns[(turns * turned).sum(-1) < 0] *= -1
    if scene.frames:
        turns = framed(turns, [scene.frames[name] for name in scene.places])
    names = list(scene.places)

    def places(values: Floats) -> dict[str, list[float]]:
        return dict(zip(names, values.tolist(), strict=True))

    return [
        Instant(float(t), places(x), places(r), places(v), float(energy))
        for t, x, r, v, energy in zip(
            times, motion.positions, turns, motion.velocities, motion.energy, strict=True
        )
    ]


def _compared(
    key: str, computed: Mapping[str, Any], reference: Mapping[str, Any]
) -> list[common.Comparison]:
    """Nested numbers under joined names, quaternions up to their sign."""
    mine, theirs = _flat(computed), _flat(reference)
    for name, value in theirs.items():
        if name.startswith("quat") and name in mine and np.dot(mine[name], value) < 0:
            mine[name] = [-x for x in mine[name]]
    return common.compare(key, mine, theirs, float(reference["unc"]))


def _tracked(key: str, computed: Any, reference: Any) -> list[common.Comparison]:
    """Positions and quaternions (up to sign) of one place, at one instant or by instants."""
    rows = {key: reference} if isinstance(reference, list) else reference
    mine = {key: computed} if isinstance(reference, list) else computed
    out = []
    for name, row in rows.items():
        if name not in mine:
            continue
        ours, case = list(mine[name]), key if name == key else f"{key}, {name}"
        sign = -1.0 if np.dot(ours[3:], row[3:]) < 0 else 1.0
        pair = ({"pos": ours[:3], "quat": [sign * x for x in ours[3:]]}, row)
        theirs = {"pos": pair[1][:3], "quat": pair[1][3:]}
        out += common.compare(case, pair[0], theirs, COARSE)
    return out


def _flat(fields: Mapping[str, Any]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for name, value in fields.items():
        if isinstance(value, Mapping):
            out.update({f"{name} {inner}": x for inner, x in value.items()})
        else:
            out[name] = value
    return out
