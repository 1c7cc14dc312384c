"""Which kernels step a scene: plain numpy, or compiled ones."""

from __future__ import annotations

from importlib.util import find_spec
from typing import NamedTuple

from ..compiled.plan import Plan, plan_of
from ..constraints import Multipliers, Treatment
from ..errors import InputError
from ..linear import Solver
from ..log import logger
from ..model import System
from .base import Integrator
from .refused import refusal

__all__ = ["Choice", "choose", "choose_kernels", "estimated_seconds"]

#: estimated time with the plain kernels (s) above which compiled ones are taken: compiling them on
#: an empty cache takes 7 to 12 s on two processors, 14 to 20 s on one
WORTHWHILE = 25.0
#: Newton iterations assumed for a step
ITERATIONS = 3
#: how much faster a step is with compiled kernels, for the warning where numba is missing: what
#: was measured for 20 and for 2000 elements lies on both sides
FACTOR = 15
#: how much slower plain kernels are where lines of beams are eliminated: 4 to 7 times as measured
#: for 20 elements, more for more
ELIMINATED = 5
LEAVES = (
    "there are no compiled kernels for multipliers, or in a plane, where elimination fills in or"
    " leaves something to a solver that is asked for"
)
SWITCHED_OFF = "numba does not compile: NUMBA_DISABLE_JIT is set"
#: versions of numba, from and below, whose passes compiled/pipeline.py is built on
VERSIONS = (0, 63), (0, 69)
#: number of steps taken for granted where none is given
STEPS = 1000


class Choice(NamedTuple):
    """Kernels, and why; for compiled ones, how they eliminate."""

    name: str
    why: str
    plan: Plan | None = None


def estimated_seconds(system: System, steps: int, iterations: int = ITERATIONS) -> float:
    """Time of as many steps or points with the plain kernels, to a factor of two or so (s)."""
    nodes = sum(g.vertices.size for g in system.beam_groups)
    entries = sum(g.vertices.size * g.vertices.shape[1] for g in system.beam_groups)
    vertices = len(system.origin_rows)
    each = 2e-4 + 7e-7 * (nodes + entries) + 1.5e-6 * vertices
    return steps * (1.5e-4 + iterations * each)


def choose_kernels(
    kernels: str,
    system: System,
    integrator: Integrator,
    treatment: Treatment,
    steps: int | None,
    solver: Solver | None = None,
) -> Choice:
    """See :func:`choose`; for a run of as many steps, each perhaps composed of others."""
    count = (STEPS if steps is None else steps) * max(1, len(integrator.shares))
    seconds = estimated_seconds(system, count)
    if system.kinematics.spans is not None and not isinstance(treatment, Multipliers):
        seconds *= ELIMINATED
    refused = refusal(system, integrator, treatment)
    return choose(kernels, system, refused, seconds, solver, isinstance(treatment, Multipliers))


def choose(
    kernels: str,
    system: System,
    refused: str | None,
    seconds: float,
    solver: Solver | None = None,
    multipliers: bool = False,
) -> Choice:
    """What ``kernels="auto" | "numpy" | "numba"`` means for a scene.

    Parameters
    ----------
    kernels : str
    system : System
    refused : str or None
        Why compiled kernels cannot be taken.
    seconds : float
        Estimated time with the plain ones (s).
    solver : Solver, optional
        That is asked for: elimination in blocks leaves all it can to it.
    multipliers : bool
        They are among the unknowns: compiled kernels eliminate all in blocks then.

    Raises
    ------
    InputError
        If it is none of these, or compiled kernels are asked for where there are none.
    ImportError
        If they are asked for and numba is not installed or cannot be imported.
    """
    if not isinstance(kernels, str) or kernels not in ("auto", "numpy", "numba"):
        raise InputError("argument kernels", f"{kernels!r}, expected 'auto', 'numpy' or 'numba'")
    if kernels == "numpy":
        return Choice("numpy", "asked for")
    if kernels == "numba":
        if refused:
            raise InputError("argument kernels", f"'numba': {refused}")
        hindrance = _hindrance()
        if hindrance == SWITCHED_OFF:
            raise InputError("argument kernels", f"'numba': {hindrance}")
        if hindrance:
            needs = "kernels='numba' needs numba: pip install 'skfem-cosserat[fast]'"
            raise ImportError(f"{needs} ({hindrance})")
        plan = _plan(system, solver, multipliers)
        if plan is None:
            raise InputError("argument kernels", f"'numba': {LEAVES}")
        return Choice("numba", "asked for", plan)
    if refused:
        return Choice("numpy", refused)
    if seconds < WORTHWHILE:
        return Choice("numpy", f"about {seconds:.2g} s of work, compiling would take longer")
    hindrance = _hindrance()
    if hindrance:
        logger.warning(
            "about %.0f s of work with numpy: with numba (pip install 'skfem-cosserat[fast]') some"
            " %d times faster; %s",
            *(seconds, FACTOR, hindrance),
        )
        return Choice("numpy", hindrance)
    plan = _plan(system, solver, multipliers)
    if plan is None:
        return Choice("numpy", LEAVES)
    return Choice("numba", f"about {seconds:.2g} s of work with numpy", plan)


def _hindrance() -> str | None:
    """Why nothing can be compiled here, whatever the scene; None: numba is there and works."""
    if find_spec("numba") is None:
        return "numba is not installed"
    try:
        from numba import __version__, config
    except (ImportError, OSError) as error:  # one that does not go with this numpy, say
        return f"numba cannot be imported: {error}"
    first, last = VERSIONS
    if not first <= tuple(map(int, __version__.split(".")[:2])) < last:
        span = " to below ".join(f"{major}.{minor}" for major, minor in VERSIONS)
        return f"numba {__version__} is installed, compiled kernels need {span}"
    return SWITCHED_OFF if config.DISABLE_JIT else None


def _plan(system: System, solver: Solver | None, multipliers: bool) -> Plan | None:
    """Elimination; None if it leaves to a sparse solver what compiled kernels do not give it."""
    plan = plan_of(system, solver is not None, multipliers)
    return None if (multipliers or system.plane is not None) and len(plan.rest) else plan
