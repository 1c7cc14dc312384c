"""The loop in time: a generator of steps, and a simulation with a history on top of it."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import skfem

from . import diagnostics, kernels
from .beam import Beam
from .body import MassPoint, RigidBody
from .constraints import Treatment
from .diagnostics import Projection
from .errors import Diverged, HistoryError, InputError
from .history import History, HistoryWriter
from .integrators import Integrator, State, Stepper, StepReport
from .log import logger
from .model import System
from .model.system import JointRows
from .newton import NewtonSettings
from .types import ArrayLike, Floats

__all__ = ["initial_state", "project", "restart", "simulate", "steps"]

VERSION = "0.1.0"
Callback = Callable[[StepReport], object]


def project(system: System, q: ArrayLike, v: ArrayLike, t: float = 0.0) -> Floats:
    """Velocity (n,) nearest to v (in the kinetic energy) that fulfils the hidden constraints."""
    v = np.asarray(v, dtype=float)
    p = (system.mass @ v.reshape(-1, 3)).reshape(-1)
    return Projection(system)(q, p, t)[0]


def initial_state(
    system: System,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    p: ArrayLike | None = None,
    time: float = 0.0,
    tolerance: float = 1e-8,
) -> State:
    """Start from (q, v) or (q, p); default: the reference and the items' initial velocities.

    Parameters
    ----------
    q, v, p : (n,) array, optional
        Configuration, and velocity *or* momentum.
    time : float
        Start (s).
    tolerance : float
        Largest relative violation of the constraints and the hidden constraints.

    Raises
    ------
    InputError
        If q violates the constraints, or v or p the hidden ones ``G v + g_t = 0``;
        :func:`project` gives the nearest velocity that does not.

    Examples
    --------
    >>> from skfem_cosserat import Model, MassPoint
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, velocity=(1.0, 0, 0)))
    >>> initial_state(model.freeze()).p.tolist()
    [2.0, 0.0, 0.0]
    """
    if v is not None and p is not None:
        raise InputError("initial state", "give v or p, not both")
    q = system.q0 if q is None else _checked(system, "q", q)
    if not np.isfinite(time):
        raise InputError("initial state", f"time = {time!r} is not finite")
    y = system.extend(q, time)
    g = abs(system.constraints.values(y))
    if g.max(initial=0.0) > tolerance * max(1.0, system.length**2):
        raise InputError(
            "initial state",
            f"q violates the constraints at t = {time:g} s by {g.max():.3g}"
            f" ({constraint_owner(system, int(g.argmax()))})",
        )
    if p is not None:
        p = _checked(system, "p", p)
        v_p, projected = Projection(system)(q, p, time)
        miss = float(abs(system.mass @ (v_p.reshape(-1, 3)) - p.reshape(-1, 3)).max())
        if miss > tolerance * max(float(abs(p).max()), 1e-300) and miss > 1e-13:
            raise InputError(
                "initial state",
                f"p violates the hidden constraints by {miss:.3g} kg m/s: project it with"
                " Projection(system)(q, p)",
            )
        return State(time, 0, q, p)
    v = system.v0 if v is None else _checked(system, "v", v)
    hidden = abs(
        system.constraints.jacobian(y) @ v + diagnostics.ground_part(system, y, time)
    )
    worst = float(hidden.max(initial=0.0))
    if worst > tolerance * max(1.0, float(abs(v).max())):
        raise InputError(
            "initial state",
            f"the velocity violates the hidden constraint of"
            f" {constraint_owner(system, int(hidden.argmax()))} at t = {time:g} s by {worst:.6g}"
            " (initial velocity against joints or prescribed motion): use project(system, q, v)",
        )
    return State(time, 0, q, (system.mass @ v.reshape(-1, 3)).reshape(-1))


def constraint_owner(system: System, row: int) -> str:
    """Which item a constraint row belongs to."""
    for jr in system.joint_rows:
        if jr.rows.start <= row < jr.rows.stop:
            return jr.joint.label
    frame = int(system.kinematics.frames[row // 6])
    return f"triad of {system.owner[frame].label}"


def _checked(system: System, name: str, value: ArrayLike) -> Floats:
    array = np.array(value, dtype=float)
    if array.shape != (system.n,):
        raise InputError("initial state", f"{name} has shape {array.shape}, expected ({system.n},)")
    if not np.isfinite(array).all():
        raise InputError(
            "initial state", f"{name} is not finite at {np.flatnonzero(~np.isfinite(array))[:5]}"
        )
    return array


def restart(system: System, history: History, integrator: Integrator, step: float) -> State:
    """State to go on from the last one of a history.

    With the integrator and step of the history the run continues as if it had not stopped; with
    another step or integrator it starts from (q, p) of the discrete Legendre transform, projected
    on the hidden constraints.

    Raises
    ------
    HistoryError
        If the history belongs to another model.
    """
    if history.meta.get("fingerprint") != fingerprint(system):
        raise HistoryError(
            "history",
            f"belongs to another model: {history.meta.get('fingerprint')} instead of"
            f" {fingerprint(system)}",
        )
    if len(history) == 0:
        raise HistoryError("history", "has no state to go on from")
    row = history.last()
    t, index = float(row["t"]), int(row["step"])
    q = np.array(row["q"])
    same = history.meta["integrator"] == integrator.name and history.meta["step"] == step
    if same:
        return State(t, index, q, np.array(row["carried"]), fresh=bool(row["fresh"]))
    p = np.array(row["p"])
    if not np.isfinite(p).all():
        p = np.array(row["carried"])
    return State(t, index, q, Projection(system)(q, p, t)[1])


def fingerprint(system: System) -> dict[str, Any]:
    """What makes a history belong to a system."""
    return {
        "n": system.n,
        "m": system.m,
        "items": [s.label for s in system.structures],
        "joints": [j.label for j in system.joints],
        "reference": [float(f"{abs(system.q0).sum():.12g}"), float(f"{system.mass.sum():.12g}")],
    }


def steps(
    system: System,
    integrator: Integrator,
    treatment: Treatment,
    step: float,
    start: State | None = None,
    settings: NewtonSettings | None = None,
) -> Iterator[StepReport]:
    """Solve step after step, for a loop of your own; stops only when you do.

    Parameters
    ----------
    system : System
    integrator : Integrator
        ``Variational()`` or ``EnergyMomentum()``.
    treatment : Treatment
        ``NullSpace()`` or ``Multipliers()``.
    step : float
        Step size (s).
    start : State, optional
        Default: :func:`initial_state`.

    Yields
    ------
    StepReport
        With the new state, and momentum and constraint force of the step that led to it.

    Raises
    ------
    Diverged
        When a step cannot be solved; the states yielded before remain valid.

    Examples
    --------
    >>> from skfem_cosserat import Model, MassPoint, NullSpace, Variational
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, velocity=(1.0, 0, 0)))
    >>> for report in steps(model.freeze(), Variational(), NullSpace(), 0.1):
    ...     if report.state.time > 0.45:
    ...         break
    >>> round(float(report.state.q[0]), 12)
    0.5
    """
    stepper = Stepper(system, integrator, treatment, step, settings)
    state = initial_state(system) if start is None else start
    origin, first = state.time, state.index
    while True:
        # t_n = t_0 + n h: no rounding adds up over many steps
        report = stepper.advance(state, origin + (state.index + 1 - first) * stepper.h)
        yield report
        state = report.state


def simulate(
    system: System,
    integrator: Integrator,
    treatment: Treatment,
    step: float,
    until: float,
    *,
    start: State | None = None,
    every: int = 1,
    at: Sequence[float] | None = None,
    callbacks: Sequence[Callback] = (),
    progress: bool | Callable[[float, float], object] = False,
    path: str | os.PathLike[str] | None = None,
    derive: bool = True,
    settings: NewtonSettings | None = None,
) -> History:
    """Integrate a scene and return its history.

    Parameters
    ----------
    system, integrator, treatment, step, start, settings
        See :func:`steps`.
    until : float
        End time (s); the last step ends at or before it (to rounding).
    every : int
        Record every k-th step (the first and the last state always).
    at : sequence of float, optional
        Record the states nearest to these times instead.
    callbacks : sequence of callable
        Called with each :class:`StepReport`; one that returns True ends the run.
    progress : bool or callable
        True: a line on the log at INFO every second; a callable gets (time, until).
    path : path, optional
        Stream the history to this file, block by block.
    derive : bool
        Add energies, velocities, section forces and reactions at the end (:func:`derive_series`).

    Returns
    -------
    History
        ``history.meta["status"]`` says whether it ran to the end, was interrupted (Ctrl-C) or
        stopped by a callback.

    Raises
    ------
    Diverged
        With ``error.history``, the history up to the failed step.
    InputError
        For bad arguments, before the first step.
    """
    state, count = _plan(system, start, step, until, every)
    stepper = Stepper(system, integrator, treatment, step, settings)
    recorder = _Recorder(system, stepper, state, count, every, at, path)
    report_progress = _progress(progress, until)
    status = "completed"
    failure: Diverged | None = None
    origin, first = state.time, state.index
    try:
        for k in range(1, count + 1):
            report = stepper.advance(state, origin + k * stepper.h)
            recorder.take(report)
            state = report.state
            report_progress(state.time)
            if any([callback(report) is True for callback in callbacks]):
                status = "stopped"
                break
        recorder.look_ahead(state, origin + (state.index - first + 1) * stepper.h)
    except KeyboardInterrupt:
        status = "interrupted"
        logger.warning("interrupted at t = %.6g s: the history up to there is kept", state.time)
    except Diverged as error:
        status, failure = "diverged", error
    history = recorder.close(status, failure)
    if derive:
        derive_series(system, history)
        if path is not None:
            history.save(path)
    logger.info("%s: %d states up to t = %.6g s", status, len(history), history.times[-1])
    if failure is not None:
        failure.history = history
        raise failure
    return history


def _plan(
    system: System, start: State | None, step: float, until: float, every: int
) -> tuple[State, int]:
    if not np.isfinite(step) or step <= 0:
        raise InputError("argument step", f"{step!r}, expected a positive number of seconds")
    if not np.isfinite(until) or until <= 0:
        raise InputError("argument until", f"{until!r}, expected a positive number of seconds")
    if not isinstance(every, int | np.integer) or every < 1:
        raise InputError("argument every", f"{every!r}, expected a positive integer")
    state = initial_state(system) if start is None else start
    count = int(np.floor((until - state.time) / step * (1 + 1e-12) + 1e-9))
    if count < 1:
        raise InputError(
            "argument until",
            f"{until!r} s is less than one step of {step!r} s after the start at {state.time!r} s",
        )
    return state, count


def _progress(progress: bool | Callable[[float, float], object], until: float) -> Any:
    if callable(progress):
        return lambda t: progress(t, until)
    if not progress:
        return lambda t: None
    import time

    last = [time.monotonic()]

    def log(t: float) -> None:
        now = time.monotonic()
        if now - last[0] >= 1:
            last[0] = now
            logger.info("t = %.6g s of %.6g s", t, until)

    return log


class _Recorder:
    """Decides what is recorded and writes it."""

    def __init__(
        self,
        system: System,
        stepper: Stepper,
        state: State,
        count: int,
        every: int,
        at: Sequence[float] | None,
        path: str | os.PathLike[str] | None,
    ) -> None:
        self.system, self.stepper = system, stepper
        self.wanted = _wanted(state, stepper.h, count, every, at)
        self.first = state.index
        self.open = False
        meta, static = describe(system)
        meta |= {
            "integrator": stepper.integrator.name,
            "treatment": stepper.treatment.name,
            "step": stepper.h,
            "solver": stepper.bound.solver.method,
            "unknowns": stepper.bound.unknowns,
            "kernels": kernels.NAME,
        }
        self.writer = HistoryWriter(meta, static, path)
        self.last: dict[str, Any] | None = None
        self._append(self._row(state, 0, 1, 0.0))

    def _row(self, state: State, iterations: int, attempts: int, residual: float) -> dict[str, Any]:
        nan = np.full(self.system.n, np.nan)
        row: dict[str, Any] = {
            "t": state.time,
            "step": state.index,
            "q": state.q,
            "p": state.p if state.fresh or self.stepper.integrator.constraint_weight else nan,
            "carried": state.p,
            "fresh": float(state.fresh),
            "constraint_force": nan,
            "newton_iterations": iterations,
            "attempts": attempts,
            "residual": residual,
        }
        if self.stepper.integrator.constraint_weight:
            row["constraint_point"] = np.full(3 * self.system.total, np.nan)
        return row

    def _append(self, row: dict[str, Any]) -> None:
        self.writer.append(row)
        self.open = True

    def _amend(self, report: StepReport) -> None:
        if self.open:
            fields = {"p": report.momentum, "constraint_force": report.constraint_force}
            if self.stepper.integrator.constraint_weight:
                fields["constraint_point"] = report.constraint_point.ravel()
            self.writer.amend(**fields)
            self.open = False

    def take(self, report: StepReport) -> None:
        """A step is done: complete the row of its start, record its end if wanted."""
        self._amend(report)
        state = report.state
        row = self._row(state, report.iterations, report.attempts, report.residual)
        if state.index - self.first in self.wanted:
            self._append(row)
            self.last = None
        else:
            self.last = row

    def look_ahead(self, state: State, time: float) -> None:
        """Momentum and constraint force of the last state belong to the step after it."""
        if self.last is not None:
            self._append(self.last)
            self.last = None
        try:
            self._amend(self.stepper.advance(state, time))
        except Diverged:
            logger.info("no step after t = %.6g s: its momentum is the projected one", state.time)

    def close(self, status: str, failure: Diverged | None) -> History:
        """Close the file and give the history."""
        if self.last is not None:
            self._append(self.last)
        if self.open:
            row = self.writer.history().last()
            if not np.isfinite(row["p"]).all():
                p = Projection(self.system)(row["q"], row["carried"], float(row["t"]))[1]
                self.writer.amend(p=p)
        extra: dict[str, Any] = {
            "factorisations": self.stepper.bound.solver.factorisations,
        }
        if failure is not None:
            extra["failure"] = str(failure)
        self.writer.close(status, **extra)
        return self.writer.history()


def _wanted(
    state: State, h: float, count: int, every: int, at: Sequence[float] | None
) -> set[int]:
    if at is None:
        return {*range(0, count + 1, int(every)), count}
    times = np.asarray(at, dtype=float)
    if times.ndim != 1 or not np.isfinite(times).all():
        raise InputError("argument at", f"{at!r}, expected a list of times")
    k = np.rint((times - state.time) / h).astype(int)
    if (k < 0).any() or (k > count).any():
        bad = times[(k < 0) | (k > count)][0]
        raise InputError("argument at", f"time {bad!r} s is outside of the run")
    return set(k.tolist())


def describe(system: System) -> tuple[dict[str, Any], dict[str, Floats]]:
    """Names and constant arrays of a system, as a history keeps them."""
    meta: dict[str, Any] = {
        "versions": {
            "skfem_cosserat": VERSION,
            "scikit-fem": skfem.__version__,
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "python": platform.python_version(),
        },
        "machine": f"{platform.system()} {platform.machine()}",
        "fingerprint": fingerprint(system),
        **system.counts(),
        "beams": [],
        "bodies": [],
        "points": [],
        "joints": [],
    }
    static: dict[str, Any] = {}
    for item in system.structures:
        if isinstance(item, Beam):
            meta["beams"].append(_describe_beam(system, item, static))
        elif id(item) in system.first and isinstance(item, RigidBody):
            meta["bodies"].append({"name": item.name, "shape": "surface"})
            static[f"body/{item.name}/offset"] = np.array(3 * system.first[id(item)][1])
            if item.surface is not None:
                static[f"body/{item.name}/points"] = np.array(item.surface[0], dtype=float)
                static[f"body/{item.name}/faces"] = np.array(item.surface[1], dtype=np.int64)
        elif id(item) in system.first and isinstance(item, MassPoint):
            meta["points"].append({"name": item.name})
            static[f"point/{item.name}/offset"] = np.array(3 * system.first[id(item)][1])
    for joint in system.joints:
        kind = type(joint).__name__[5:].lower()
        meta["joints"].append(
            {"name": joint.name, "type": kind, "a": joint.a.label, "b": joint.b.label}
        )
    return meta, static


def _describe_beam(system: System, beam: Beam, static: dict[str, Any]) -> dict[str, Any]:
    key = f"beam/{beam.name}/"
    row = system.first[id(beam)][1]
    nodes = len(beam.basis.nodes)
    names = sorted(beam.mesh.subdomains or {})
    part = np.full(len(beam.section_id), -1, dtype=np.int64)
    for k, name in enumerate(names):
        part[beam.mesh.elements_of(name)] = k
    static[key + "offsets"] = 3 * (row + 4 * np.arange(nodes, dtype=np.int64))
    static[key + "connectivity"] = np.asarray(beam.basis.connectivity, dtype=np.int64)
    static[key + "lengths"] = beam.elements.lengths
    static[key + "rotations"] = beam.rotations
    static[key + "part"] = part
    static[key + "section"] = beam.section_id
    static[key + "gauss"] = beam.elements.points
    for k, section in enumerate(beam.sections.values()):
        if section.outline is not None:
            static[key + f"outline/{k}"] = section.outline
    return {
        "name": beam.name,
        "order": beam.basis.order,
        "parts": names,
        "sections": list(beam.sections),
    }


def derive_series(system: System, history: History) -> None:
    """Add what follows from the states: velocities, energies, momenta, forces, reactions.

    Adds ``v, Qp`` (projected on the hidden constraints), ``kinetic, strain_energy, external,
    energy`` (kinetic + strain at (q, p)), ``energy_projected``, ``linear_momentum``,
    ``angular_momentum``, ``constraint_violation``, for each beam ``strain`` and ``resultant``, for
    each joint ``position``, ``force`` and ``moment``.
    """
    q, p, t = history["q"], history["p"], history.times
    v, projected = Projection(system).stack(q, p, t)
    kinetic = diagnostics.kinetic_energy(system, p)
    strain = diagnostics.strain_energy(system, q)
    series: dict[str, Floats] = {
        "v": v,
        "Qp": projected,
        "kinetic": kinetic,
        "strain_energy": strain,
        "external": diagnostics.external_energy(system, q, t),
        "energy": kinetic + strain,
        "energy_projected": diagnostics.kinetic_energy(system, projected) + strain,
        "linear_momentum": diagnostics.linear_momentum(system, p),
        "angular_momentum": diagnostics.angular_momentum(system, q, p),
        "angular_momentum_projected": diagnostics.angular_momentum(system, q, projected),
        "constraint_violation": diagnostics.constraint_violation(system, q, t),
        "hidden_violation": diagnostics.hidden_violation(system, q, v, t),
    }
    for beam in (s for s in system.structures if isinstance(s, Beam)):
        series[f"beam/{beam.name}/strain"] = diagnostics.section_strains(system, beam, q)
        series[f"beam/{beam.name}/resultant"] = diagnostics.section_forces(system, beam, q)
    y = diagnostics.constraint_points(system, history)
    lam = diagnostics.multipliers(system, y, history["constraint_force"])
    series["multipliers"] = lam
    for name, (force, moment) in diagnostics.reactions(system, y, lam).items():
        series[f"joint/{name}/force"], series[f"joint/{name}/moment"] = force, moment
    for jr in system.joint_rows:
        series[f"joint/{jr.joint.name}/position"] = _joint_positions(system, jr, q, t)
    for name, values in series.items():
        history.add_series(name, values)


def _joint_positions(system: System, jr: JointRows, q: Floats, t: Floats) -> Floats:
    """Where the joint's point on side A is, (N, 3)."""
    terms = system.kinematics.spot_terms(jr.a)
    y = np.array([system.extend(row, float(s)) for row, s in zip(q, t, strict=True)])
    return np.asarray(sum(c * y[:, a] for a, c in terms))


def results_folder(path: str | os.PathLike[str]) -> Path:
    """A folder that can be written to, made if necessary."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(f"folder {str(folder)!r}", f"cannot be written: {error}") from error
    return folder
