"""What the families in time share: scenes, runs that hit all instants, limits, answers.

A family has a :class:`Problem`: its inputs by name, a builder of its :class:`Scene`, what is read
off an instant, and how fine it is computed unless told. Every stretch between two instants, of
output or where a load has a kink, is divided into equal steps, at most `step` long.

Without a `step` the answer is the limit of runs with steps halved (the error of both integrators
has even powers of the step only), until it changes by less than the problem's tolerance or the
levels that are affordable are through; ``estimated_error`` is the last change (m). With a `step`
it is the result of that one run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import betainc

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.integrators.choice import choose_kernels

from . import common

__all__ = ["Instant", "Problem", "Scene", "SolidBeam", "beam", "bump", "limit", "rise", "run"]

Floats = NDArray[np.float64]
#: two digits, what the runs of others are good for that nobody has verified
COARSE = 1e-2


# -- beams and loads by the names of the reference file --------------------------------------------


class SolidBeam(sc.Beam):
    """A beam with inertia along d3 too, which no plane section has.

    Parameters
    ----------
    third : float
        ``M_rho^3`` (kg m); the rest as for :class:`skfem_cosserat.Beam`.
    """

    def __init__(self, *args: Any, third: float, **options: Any) -> None:
        super().__init__(*args, **options)
        self.third = third

    def scalar_mass(self) -> Floats:
        """With the blocks of d3."""
        mass = super().scalar_mass()
        rows = 4 * np.arange(self.basis.order + 1) + 3
        mass[:, rows[:, None], rows] += self.third * self.basis.elemental_mass()
        return mass


def beam(
    mesh: sc.MeshCurve,
    data: Mapping[str, Any],
    order: int,
    e2: Sequence[float],
    **options: Any,
) -> sc.Beam:
    """A beam with the constants ``EA, GA, EI, GJ, A_rho, J_rho`` of `data`, and other options.

    There e1 is along the beam, here d3 is: (d1, d2, d3) = (e2, e3, e1). ``GA`` and ``EI`` are one
    number or those of e2 and e3; ``J_rho`` holds the moments of inertia about e1, e2, e3, or about
    e1 and both others, or all equal.
    """
    J1, J2, J3 = _inertia(data["J_rho"])
    along = ((J1 + J3 - J2) / 2, (J1 + J2 - J3) / 2)
    third = (J2 + J3 - J1) / 2
    section = sc.Section.from_constants(
        EA=data["EA"],
        GA=_pair(data["GA"]),
        EI=_pair(data["EI"]),
        GJ=data["GJ"],
        mass=data["A_rho"],
        inertia=along,
    )
    if abs(third) <= 1e-9 * max(J1, J2, J3):
        return sc.Beam(mesh, section, order=order, director=tuple(e2), **options)
    if third < 0:
        raise sc.InputError("data", f"J_rho = {data['J_rho']!r}: no section has it, J2 + J3 < J1")
    return SolidBeam(mesh, section, order=order, director=tuple(e2), third=third, **options)


def _pair(value: Any) -> tuple[float, float]:
    first, second = np.broadcast_to(np.asarray(value, dtype=float), 2)
    return float(first), float(second)


def _inertia(value: Any) -> tuple[float, float, float]:
    J = np.atleast_1d(np.asarray(value, dtype=float))
    if J.shape not in ((1,), (2,), (3,)):
        raise sc.InputError("data", f"J_rho = {value!r}, expected one, two or three numbers")
    J1, J2, J3 = (J[0], J[-1], J[-1]) if len(J) < 3 else J
    return float(J1), float(J2), float(J3)


def halves(start: Sequence[float], end: Sequence[float], elements: int, order: int) -> sc.MeshCurve:
    """A line of any number of elements with a node ``mid`` in its middle."""
    whole = isinstance(elements, int | np.integer) and elements > 1 and elements % 2 == 1
    if whole:
        mid = (np.array(start, dtype=float) + np.array(end, dtype=float)) / 2
        counts = ((elements + 1) // 2, elements // 2)
        corners = np.array([start, mid, end], dtype=float)
        return sc.MeshCurve.init_polyline(corners, counts, name="rod")
    if elements == 1 and order % 2:
        raise sc.InputError("elements", f"1 of order {order} has no node in its middle, take two")
    return sc.MeshCurve.init_line(start, end, elements, name="rod")


def bump(peak: float, until: float) -> sc.FunctionOfTime:
    """``peak (4 x (1 - x))^6``, x = t/until: five derivatives vanish at both ends."""
    return sc.FunctionOfTime(
        lambda t: peak * (4 * t / until * (1 - t / until)) ** 6 if 0 < t < until else 0.0,
        kinks=(0.0, until),
    )


def rise(until: float) -> sc.FunctionOfTime:
    """From 0 to 1, five derivatives vanish at both ends."""
    return sc.FunctionOfTime(
        lambda t: float(betainc(6, 6, min(max(t / until, 0.0), 1.0))), kinks=(0.0, until)
    )


def pulse(data: Mapping[str, Any]) -> tuple[Any, tuple[float, ...]]:
    """``pulse``: a triangle with ``peak`` at ``t_peak`` up to ``t_end``, or a bump; its kinks."""
    peak, middle, end = data["peak"], data["t_peak"], data["t_end"]
    if data["pulse"] == "bump":
        return bump(peak, end), (end,)
    if data["pulse"] != "triangle":
        raise sc.InputError("data", f"pulse = {data['pulse']!r}, expected 'triangle' or 'bump'")
    if not 0 < middle < end:
        raise sc.InputError("data", f"t_peak = {middle} is not before t_end = {end}")
    return sc.Table([0, middle, end], [0, peak, 0]), (middle, end)


# -- scenes and runs -------------------------------------------------------------------------------


class Scene(NamedTuple):
    """A frozen scene, the places that are looked at, and instants (s) that must be ends of steps.

    ``start`` is a state to begin with (default: at rest as it was drawn); ``frames`` the sections'
    axes e1, e2, e3 (as rows) at the start where quaternions are not to be the identity there;
    ``part`` a system with the same coordinates, whose kinetic energy is meant (default: all).
    """

    system: sc.System
    places: dict[str, Any]
    kinks: tuple[float, ...] = ()
    start: Any = None
    frames: dict[str, Floats] | None = None
    part: Any = None

    @property
    def rows(self) -> NDArray[np.int64]:
        """Where the places' frames begin in q."""
        return np.array([self.system.offset(place) for place in self.places.values()])

    def positions(self, q: Floats) -> Floats:
        """(N, k, 3) of configurations (N, n), in m."""
        return q[:, self.rows[:, None] + np.arange(3)]

    def rotations(self, q: Floats) -> Floats:
        """(N, k, 3, 3): matrices that turn the reference triads into those of configurations."""
        now, start = (
            np.reshape(x, (-1, x.shape[-1]))[:, self.rows[:, None] + np.arange(3, 12)]
            for x in (q, self.system.q0)
        )
        shape = (-1, len(self.places), 3, 3)
        return np.einsum("nkij,kil->nkjl", now.reshape(shape), start.reshape(shape)[0])


class Motion(NamedTuple):
    """Positions, rotations and velocities of a scene's places, and the energy, at some times."""

    positions: Floats
    rotations: Floats
    velocities: Floats
    energy: Floats

    @property
    def placement(self) -> Floats:
        """Positions and rotations at the last time, in one row."""
        return np.concatenate([self.positions[-1].ravel(), self.rotations[-1].ravel()])


@dataclass
class Run:
    """What a run gave: motion at the instants asked for (nan where it did not get to).

    ``turned`` (N, k, 4) are quaternions followed from step to step, of which only the sign is
    used; ``step`` the largest step (s).
    """

    motion: Motion
    turned: Floats
    step: float
    iterations: int = 0
    converged: bool = True


def schedule(step: float, marks: Sequence[float], refine: int = 1) -> list[tuple[float, float]]:
    """Stretches (end, step): equal steps of at most `step`, divided by `refine`, up to each mark.

    >>> schedule(0.25, [0.5, 1.0, 1.125])
    [(1.0, 0.25), (1.125, 0.125)]
    """
    out: list[tuple[float, float]] = []
    begin = 0.0
    for end in marks:
        count = max(1, int(np.ceil((end - begin) / step * (1 - 1e-9))))
        h = (end - begin) / count / refine
        for known in (step / refine, *(one for _, one in out[-1:])):
            h = known if np.isclose(h, known, rtol=1e-9, atol=0) else h
        if out and h == out[-1][1]:
            out.pop()
        out.append((end, h))
        begin = end
    return out


class _Watch:
    """Follows the places' triads through a run, and counts iterations."""

    def __init__(self, scene: Scene, state: sc.State) -> None:
        self.columns = (scene.rows[:, None] + np.arange(3, 12)).ravel()
        self.times, self.triads = [state.time], [state.q[self.columns]]
        self.state, self.iterations = state, 0

    def __call__(self, report: Any) -> bool:
        self.state = report.state
        self.iterations += report.iterations
        self.times.append(self.state.time)
        self.triads.append(self.state.q[self.columns])
        return False

    def quaternions(self) -> Floats:
        """(N, k, 4), scalar first, the identity at the start, without jumps of sign."""
        triads = np.array(self.triads).reshape(len(self.times), -1, 3, 3)
        matrices = np.einsum("nkij,kil->nkjl", triads, triads[0])
        return _continuous(_quaternions(matrices))


def _quaternions(matrices: Floats) -> Floats:
    """Scalar first, (..., 4) of the rotations nearest to (..., 3, 3)."""
    flat = matrices.reshape(-1, 3, 3)
    out = np.full((len(flat), 4), np.nan)
    good = np.isfinite(flat).all(axis=(1, 2))
    if good.any():
        out[good] = np.roll(Rotation.from_matrix(flat[good]).as_quat(), 1, axis=1)
    return out.reshape(*matrices.shape[:-2], 4)


def _continuous(quaternions: Floats) -> Floats:
    """With the signs that leave no jump along the first axis, the first scalar positive."""
    steps = np.sign((quaternions[1:] * quaternions[:-1]).sum(-1))
    first = np.where(quaternions[:1, ..., 0] < 0, -1.0, 1.0)
    signs = np.concatenate([first, first * np.cumprod(np.where(steps < 0, -1.0, 1.0), axis=0)])
    return quaternions * signs[..., None]


def run(
    scene: Scene,
    integrator: Any,
    treatment: Any,
    step: float,
    times: Sequence[float],
    refine: int = 1,
    kernels: str = "auto",
) -> Run:
    """A run seen at some instants (s), with steps of at most ``step / refine``.

    The energy is kinetic plus stored energy at (q, p), which energy-momentum conserves; with the
    variational integrator, and where motions are prescribed, at (q, Qp): what the constraints take
    out of its nodal p, of second order in the step, grows with the number of elements.
    `kernels` are as in :func:`skfem_cosserat.simulate`.
    """
    system, wanted = scene.system, np.asarray(times, dtype=float)
    until = wanted.max()
    state = sc.initial_state(system) if scene.start is None else scene.start
    watch, converged, largest = _Watch(scene, state), True, 0.0
    q, p = (np.full((len(wanted), system.n), np.nan) for _ in range(2))
    at_start = abs(wanted) <= 1e-12 * until
    q[at_start], p[at_start] = state.q, state.p
    for end, h in schedule(step, _marks(scene, wanted), refine):
        largest = max(largest, h)
        options: dict[str, Any] = {"start": watch.state, "callbacks": [watch]}
        options.update(derive=False, kernels=kernels)
        inside = wanted[(wanted > watch.state.time) & (wanted < end + h / 2)].tolist()
        try:
            history = sc.simulate(
                system, integrator, treatment, h, end + 1e-6 * h, at=[*inside, end], **options
            )
        except sc.Diverged as failure:
            history, converged = failure.history, False
        miss = abs(history.times - wanted[:, None])
        found = miss.min(axis=1) < 1e-6 * h
        q[found], p[found] = (history[x][miss.argmin(axis=1)[found]] for x in ("q", "p"))
        if not converged:
            break
    motion = _motion(scene, q, p, wanted, integrator)
    nearest = np.searchsorted(watch.times, wanted - 1e-9 * until).clip(max=len(watch.times) - 1)
    turned = watch.quaternions()[nearest]
    return Run(motion, turned, largest, watch.iterations, converged)


def _marks(scene: Scene, times: Floats) -> list[float]:
    """Instants and kinks that must be ends of steps."""
    until = max(times)
    return sorted({float(f"{t:.12g}") for t in (*times, *scene.kinks) if 0 < t <= until})


def _motion(scene: Scene, q: Floats, p: Floats, times: Floats, integrator: Any) -> Motion:
    """Where q and p are known; nan elsewhere."""
    system, good = scene.system, np.isfinite(q).all(axis=1)
    k = len(scene.places)
    shapes = ((k, 3), (k, 3, 3), (k, 3), ())
    out = Motion(*(np.full((len(q), *shape), np.nan) for shape in shapes))
    if not good.any():
        return out
    q, p = q[good], p[good]
    v, projected = sc.Projection(system).stack(q, p, times[good])
    keeps = isinstance(integrator, sc.EnergyMomentum) and not system.moving
    if scene.part is None:
        energy = diagnostics.kinetic_energy(system, p if keeps else projected)
    else:
        energy = diagnostics.kinetic_energy_of_velocity(scene.part, v)
    energy = energy + diagnostics.strain_energy(system, q)
    found = (scene.positions(q), scene.rotations(q), scene.positions(v), energy)
    for array, value in zip(out, found, strict=True):
        array[good] = value
    return out


def limit(steps: Sequence[float], motions: Sequence[Motion]) -> Motion:
    """Limit of vanishing step of runs whose error has even powers of the step (Neville)."""
    values: list[tuple[Floats, ...]] = list(motions)
    for k in range(1, len(values)):
        ratios = [(steps[i] / steps[i + k]) ** 2 for i in range(len(values) - 1)]
        values = [
            tuple(y + (y - x) / (r - 1) for x, y in zip(a, b, strict=True))
            for (a, b), r in zip(pairwise(values), ratios, strict=False)
        ]
    return Motion(*values[0])


# -- problems and answers --------------------------------------------------------------------------


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
        given = dict(data or {})
        for name in given:
            if name not in self.inputs and name not in self.derived:
                known = [*self.inputs, *self.derived]
                raise sc.InputError("data", f"{name!r} is unknown, expected among {known}")
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
                if abs(float(case) - t) <= 1e-12 * max(t, 1.0):
                    return key
            except (TypeError, ValueError):
                break
        known = list(self.keys())
        raise sc.InputError("case", f"{case!r} is unknown, expected one of {known}")

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
        rows = {
            known.get(t, f"{t:.12g}"): self.read(now, inputs)
            for t, now in zip(wanted, moments, strict=True)
        }
        if key is not None and times is None:
            return {**common.instants(rows, key, cost), **taken}
        extra = {} if key is None else rows[key]
        return {**common.instants(rows, None, cost), **extra, **taken}

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
                cost.unknowns = system.n + system.m
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
        coarse = max(times) / self.step
        total = int(coarse * (2**self.levels - 1))
        kernels = choose_kernels("auto", scene.system, *methods, total).name
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
    quaternions = _quaternions(motion.rotations)
    flipped = (quaternions * turned).sum(-1) < 0
    quaternions[flipped] *= -1
    if scene.frames:
        quaternions = _framed(quaternions, [scene.frames[name] for name in scene.places])
    names = list(scene.places)

    def places(values: Floats) -> dict[str, list[float]]:
        return dict(zip(names, values.tolist(), strict=True))

    return [
        Instant(float(t), places(x), places(r), places(v), float(energy))
        for t, x, r, v, energy in zip(
            times, motion.positions, quaternions, motion.velocities, motion.energy, strict=True
        )
    ]


def _framed(quaternions: Floats, frames: Sequence[Floats]) -> Floats:
    """Body to space for bodies whose axes at the start are the rows of `frames`."""
    start = _continuous(_quaternions(np.array([np.transpose(f) for f in frames]))[None])[0]
    w, x = quaternions[..., :1], quaternions[..., 1:]
    w0, x0 = start[:, :1], start[:, 1:]
    scalar = w * w0 - (x * x0).sum(-1, keepdims=True)
    return np.concatenate([scalar, w * x0 + w0 * x + np.cross(x, x0)], axis=-1)


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
