"""The verb: equilibrium paths with automatic steps."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..constraints import NullSpace, Treatment
from ..errors import CosseratError
from ..history import History
from ..integrators import State
from ..integrators.choice import choose, estimated_seconds
from ..integrators.refused import static_refusal
from ..linear import Solver
from ..load import Amplitude
from ..log import logger
from ..model import Model, System
from ..model.balance import Spin
from ..newton import NewtonSettings
from ..simulate.interrupt import Interrupt
from ..simulate.progress import Progress
from ..simulate.start import checked_start
from ..types import Floats
from .branch import Branch
from .checks import check_run, held_start
from .control import Control, LoadControl
from .point import Point
from .record import PathRecorder, derive_path
from .schedule import Schedule
from .solver import Equilibrium
from .walk import Callback, Walk

__all__ = ["STATIC", "static"]

#: Newton's method far from the solution: increments are not shortened, predicted stresses carry it
STATIC = NewtonSettings(iterations=25, rotation=1e3, mixed=1e-9, largest=100.0)
#: iterations assumed for a point, to estimate the work
ITERATIONS = 5


def static(
    model: Model | System,
    treatment: Treatment | None = None,
    control: Control | None = None,
    *,
    start: State | Branch | None = None,
    factors: Mapping[str, Amplitude] | None = None,
    spin: Spin | None = None,
    settings: NewtonSettings | None = None,
    kernels: str = "auto",
    watch: bool = True,
    callbacks: Sequence[Callback] = (),
    progress: bool | Callable[[float, float], object] = False,
    path: str | os.PathLike[str] | None = None,
    derive: bool = True,
    solver: Solver | None = None,
) -> History:
    """Equilibrium path of a scene.

    Loads that are constant in time are multiplied by the load factor; loads that depend on time,
    and prescribed motion, take the load factor for it.

    Parameters
    ----------
    model : Model or System
    treatment : Treatment, optional
        ``NullSpace()`` (default) or ``Multipliers()``.
    control : Control, optional
        :class:`LoadControl` (default: to load factor 1), :class:`DisplacementControl` or
        :class:`ArcLength`.
    start : State or Branch, optional
        Where the path starts, at the load factor ``start.time``; default: the reference at 0. If
        it is no equilibrium, the nearest one is sought first: where only the stress of loads that
        act there holds a motion, the others settle before that one. A :class:`Branch` leads off
        at a bifurcation. A state knows neither loads nor sections: one of another model with the
        same coordinates is a start like any other.
    factors : mapping of str to float, Table or callable, optional
        For loads and actuators by name, in place of the load factor: a number holds a load, a
        function of the load factor moves it on its own way.
    spin : Spin, optional
        Everything is seen from a frame that turns with this velocity times the load factor (or
        the factor ``"spin"``), the ground in it.
    settings : NewtonSettings, optional
        When Newton's method stops.
    kernels : {"auto", "numpy", "numba"}
        Plain numpy kernels, or those compiled by numba (extra ``fast``), an order of magnitude
        faster; "auto" takes these where the work ahead is worth their compilation. The points are
        the same to rounding. There are none for multipliers, closed loops, springs, a turning
        frame, beams of several orders and scenes confined to a plane. ``history.meta["kernels"]``
        and ``["kernels_why"]`` say what was taken, and why.
    watch : bool
        Look for limit and bifurcation points on the way; they are recorded as points.
    callbacks : sequence of callable
        Called with each :class:`Point` after a step that is recorded: with ``steps`` or ``at``
        those asked for, else all. Not with the start, nor with critical points, which are located
        between two of them. One that returns True ends the path.
    progress : bool or callable
        True: one line on stderr; a callable gets (parameter, load factor) after each point.
    path : path, optional
        Stream the history to this file.
    derive : bool
        Add energies, section forces and reactions at the end.
    solver : Solver, optional
        See :func:`skfem_cosserat.simulate`.

    Returns
    -------
    History
        One state a point. Its times are the parameter of the control, ``load_factor`` goes with
        them; ``unstable`` counts the negative eigenvalues of the stiffness (-1: not looked at),
        ``critical`` is 1 at limit and 2 at bifurcation points. The work of loads is a sum by the
        trapezoidal rule.

    Raises
    ------
    InputError
        For bad arguments and for motions that nothing holds, before the first step.
    Diverged
        With ``error.history``, the path up to where it could not be continued.

    Examples
    --------
    A cantilever rolled up to a full circle by an end moment:

    >>> import numpy as np
    >>> from skfem_cosserat import Beam, JointFixed, LoadMoment, MeshCurve, Model, Section, ground
    >>> section = Section([1e4, 1e4, 1e4, 100, 100, 100], mass=1.0, inertia=(1.0, 1.0))
    >>> model = Model()
    >>> mesh = MeshCurve.init_line((0, 0, 0), (10, 0, 0), 8, name="rod")
    >>> rod = model.add("rod", Beam(mesh, section, order=3))
    >>> clamp = model.add("clamp", JointFixed(ground((0, 0, 0)), rod.node("rod.start")))
    >>> end = rod.node("rod.end")
    >>> moment = model.add("moment", LoadMoment(end, (0, 0, 2 * np.pi * 100 / 10)))
    >>> path = static(model)
    >>> tip = path["q"][-1, 12 * end.vertex : 12 * end.vertex + 3]
    >>> bool(abs(tip).max() < 1e-3), float(path["load_factor"][-1])
    (True, 1.0)
    """
    system = model.freeze() if isinstance(model, Model) else model
    treatment = NullSpace() if treatment is None else treatment
    control = LoadControl() if control is None else control
    settings = STATIC if settings is None else settings
    switches = {"watch": watch, "derive": derive}
    check_run(system, treatment, control, settings, callbacks, start, switches)
    schedule = Schedule(system, factors, spin)
    first, direction = _start(system, start)
    if direction is None:
        first = held_start(system, schedule, first)
    choice = choose(
        kernels,
        system,
        static_refusal(system, treatment, spin),
        estimated_seconds(system, control.expected, ITERATIONS),
        solver,
    )
    points = Equilibrium(system, treatment, schedule, settings, choice, solver)
    walk = Walk(system, points, control, watch and system.unknowns > 0)
    show = Progress(progress, "parameter {:.6g}, load factor {:.6g}".format)
    recorder = PathRecorder(
        system,
        schedule,
        {
            "treatment": treatment.name,
            "parameter": control.parameter,
            "solver": points.method,
            "kernels": choice.name,
            "kernels_why": choice.why,
            "unknowns": points.bound.unknowns,
        },
        path,
    )
    with recorder, Interrupt() as interrupt:
        with show:
            status, failure = walk.run(first, direction, recorder, callbacks, show, interrupt)
        history = recorder.close(
            status,
            factorisations=points.factorisations,
            newton_iterations=points.iterations,
            attempts=points.attempts,
            rejected=walk.rejected,
            critical=walk.critical,
            **({} if failure is None else {"failure": str(failure)}),
        )
        if derive:
            interrupt.asked = True  # nothing is lost any more: end at once
            _derive(system, schedule, history, path)
    if failure is not None:
        failure.history = history
        raise failure
    return history


def _start(system: System, start: State | Branch | None) -> tuple[Point, Floats | None]:
    """First point, and the direction in which a branch leads off."""
    if isinstance(start, Branch):
        return start.point, start.direction
    if start is None:
        return Point(system.extend(system.q0, 0.0), 0.0), None
    state = checked_start(system, start)
    return Point(system.extend(state.q, state.time), state.time, state.turns), None


def _derive(
    system: System, schedule: Schedule, history: History, path: str | os.PathLike[str] | None
) -> None:
    try:
        with np.errstate(all="ignore"):
            derive_path(system, schedule, history)
    except CosseratError as error:
        logger.warning("energies and reactions could not be derived: %s", error)
    except KeyboardInterrupt:
        logger.warning("interrupted: energies and reactions are missing")
    if path is not None:
        history.save(path)
