"""Choice of the kernels that step a scene, and reasons why compiled ones are refused."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache, lru_cache
from importlib.metadata import version
from importlib.util import find_spec
from threading import get_ident
from typing import NamedTuple, TypeVar

from ..compiled.kept import NotKept, Source, compile_errors, promising
from ..compiled.plan import Plan, plan_of
from ..compiled.tables import MOST_XI
from ..constraints import Multipliers, NullSpace, Treatment
from ..constraints.saddle import is_lattice
from ..errors import InputError, PerformanceWarning
from ..linear import Solver
from ..model import System
from ..model.force_elements import fits_kernels
from ..model.system import Coordinates
from ..newton import NewtonSettings
from ..warn import warn
from .base import Integrator
from .compiled_step import CompiledMotion, kernel_coordinates
from .energy_momentum import DecayingBalance
from .step_balance import StepBalance

# -- what scenes compiled kernels refuse, and why --------------------------------------------------


#: what kernels know of
BALANCES = (StepBalance, DecayingBalance)


def refusal(system: System, integrator: Integrator, treatment: Treatment) -> str | None:
    """Reason why a scene cannot be stepped by compiled kernels; None: it can."""
    if not integrator.solves:
        return "there are no compiled kernels for explicit steps"
    scheme = integrator.single.scheme(1.0)
    if scheme is None or type(integrator.single.balance(system, 1.0)) not in BALANCES:
        name = integrator.name
        return f"there are no compiled kernels for the {name} integrator, whose balance is its own"
    return static_refusal(system, treatment)


def static_refusal(system: System, treatment: Treatment) -> str | None:
    """Why equilibria cannot be found by compiled kernels; None: they can."""
    for item in system.couplings.items:
        kinds = [c.kind for c in item.coordinates]
        if not fits_kernels(item, system.row_of):
            return (
                f"there are no compiled kernels for {item.label}, whose coordinates are {kinds}:"
                f" they take at most {MOST_XI} components, displacements before one coordinate of"
                " any kind, and two places on different nodes, bodies or the ground"
            )
    if not isinstance(treatment, (NullSpace, Multipliers)):
        return f"there are no compiled kernels for {treatment.name}"
    whole = isinstance(treatment, Multipliers) and treatment.full
    return "there are no compiled kernels for the full system of multipliers" if whole else None


# -- which kernels step a scene: plain numpy, or compiled ones -------------------------------------

MadeT = TypeVar("MadeT")

#: steps of a run for which kernels are compiled: that takes 7 to 12 s on two processors, 14 to 20 s
#: on one, and as many steps of a small scene take as long with plain ones
LONG_RUN = 10_000
#: how much faster a step is with compiled kernels, for the warning where numba is missing: what
#: was measured for 20 and for 200 elements lies on both sides
FACTOR = 50
#: oldest version of numba that compiles the kernels
NUMBA = (0, 63)
SWITCHED_OFF = "numba does not compile: NUMBA_DISABLE_JIT is set"
#: why a run takes what it takes; what an error says
ASKED = "asked for"
NEEDED = "kernels='numba' needs numba: pip install 'skfem-cosserat[fast]'"
NOT_ON_DISK = "not all kernels of the scene are on disk, and compiling them takes longer"


class Choice(NamedTuple):
    """Kernels, and why.

    Attributes
    ----------
    name, why : str
    plan : Plan or None
        How compiled ones eliminate.
    source : Source
        Where compiled ones may come from.
    long : bool
        Whether a run is so long that kernels are compiled for it.
    """

    name: str
    why: str
    plan: Plan | None = None
    source: Source = Source.COMPILER
    long: bool = False


def choose_kernels(
    kernels: str,
    system: System,
    integrator: Integrator,
    treatment: Treatment,
    steps: int | None,
    solver: Solver | None = None,
) -> Choice:
    """Choice of kernels, as of :func:`choose`, for a run of so many steps.

    Each step of a composed integrator counts as the steps that it is made of.
    """
    count = (steps or 0) * max(1, len(integrator.shares))
    refused = refusal(system, integrator, treatment)
    if not integrator.solves:  # there is nothing to be compiled for the sake of
        count = 0
    return choose(kernels, kernel_coordinates(system, treatment), refused, count, solver)


def choose(
    kernels: str,
    coordinates: Coordinates,
    refused: str | None,
    steps: int = 0,
    solver: Solver | None = None,
) -> Choice:
    """Kernels that ``kernels="auto" | "numpy" | "numba"`` stands for in a scene.

    Whether all kernels are where the choice lets them come from turns out when they are made, see
    :func:`built`.

    Parameters
    ----------
    kernels : str
    coordinates : Coordinates
    refused : str or None
        Why compiled kernels cannot be taken.
    steps : int
        Of the run.
    solver : Solver, optional
        That is asked for: elimination in blocks leaves all it can to it.

    Raises
    ------
    InputError
        If it is none of these, or compiled kernels are asked for where there are none.
    ImportError
        If they are asked for and numba is not installed or cannot be imported.
    """
    if not isinstance(kernels, str) or kernels not in ("auto", "numpy", "numba"):
        raise InputError("argument kernels", f"{kernels!r}, expected 'auto', 'numpy' or 'numba'")
    long = steps >= LONG_RUN
    if kernels == "numpy":
        return Choice("numpy", ASKED)
    if kernels == "numba":
        if refused:
            raise InputError("argument kernels", f"'numba': {refused}")
        hindrance = _hindrance()
        if hindrance == SWITCHED_OFF:
            raise InputError("argument kernels", f"'numba': {hindrance}")
        if hindrance:
            raise ImportError(f"{NEEDED} ({hindrance})")
        return Choice("numba", ASKED, plan_of(coordinates, solver is not None), long=long)
    if not (refused or long or promising()):
        return Choice("numpy", NOT_ON_DISK if installed() else "numba is not installed")
    if hindrance := refused or _hindrance():
        if long:
            remedy = "" if refused else " (pip install 'skfem-cosserat[fast]')"
            text = f"{hindrance}{remedy}; {steps} steps with numpy take some {FACTOR} times as long"
            warn("argument kernels", text, PerformanceWarning)
        return Choice("numpy", hindrance)
    source = Source.DISK
    why = "the kernels of the scene are on disk"
    if long:
        source = Source.COMPILER
        why = f"the run has {LONG_RUN} steps or more"
    return Choice("numba", why, plan_of(coordinates, solver is not None), source, long)


def built(choice: Choice, make: Callable[[], MadeT]) -> tuple[Choice, MadeT | None]:
    """Choice that remains, and what `make` builds of compiled kernels; None: numpy takes over.

    It does if it is chosen, if numba fails, or if kernels would have to be compiled and the run
    does not pay for that. They are written for numba as it is: a newer one may refuse what older
    ones compile. Then a warning says so.
    """
    if choice.name != "numba":
        return choice, None
    try:
        return choice, make()
    except NotKept:
        return Choice("numpy", NOT_ON_DISK), None
    except compile_errors() as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        said = lines[0][:200] if lines else type(error).__name__
        why = f"numba {version('numba')} does not compile the kernels: {said}"
        if isinstance(error, (ImportError, OSError)):  # some kernels on disk had raised hopes
            why = f"numba cannot be imported: {said}"
            if choice.why == ASKED:
                raise ImportError(f"{NEEDED} ({why})") from error
        if choice.source < Source.COMPILER:  # warned of where it is worth while
            return Choice("numpy", why), None
        text = f"{why}; plain numpy takes over, some {FACTOR} times slower"
        warn("argument kernels", text, PerformanceWarning)
        return Choice("numpy", why), None


def motion_by_kernels(system: System, source: Source) -> CompiledMotion | None:
    """Velocities and energies of states by compiled kernels; None: there are none.

    Nor are there for prescribed motion, closed loops, and large lattices, in which an elimination
    vertex by vertex is filled in.
    """
    if not CompiledMotion.serves(system) or is_lattice(system):
        return None
    try:
        return CompiledMotion(system, NewtonSettings(), source)
    except NotKept:
        return None
    except compile_errors():  # plain numpy takes over: nothing but time is lost
        return None


@lru_cache(maxsize=4)
def _motion(system: System, thread: int) -> CompiledMotion:
    made = motion_by_kernels(system, Source.DISK)
    if made is None:  # not remembered: they may be there later
        raise NotKept
    return made


def kept_motion(system: System) -> CompiledMotion | None:
    """Velocities by kernels that are on disk; each thread has its own."""
    if not promising():
        return None
    try:
        return _motion(system, get_ident())
    except NotKept:
        return None


@cache
def installed() -> bool:
    """True if numba is installed; looking for it takes a third of a millisecond."""
    return find_spec("numba") is not None


def _hindrance() -> str | None:
    """Why nothing can be compiled here, whatever the scene; None: nothing is known against it."""
    if not installed():
        return "numba is not installed"
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return SWITCHED_OFF
    if promising():  # it has compiled some: those are taken without it, as its import takes long
        return None
    try:
        from numba import __version__
    except (ImportError, OSError) as error:  # one that does not go with this numpy, say
        return f"numba cannot be imported: {error}"
    if tuple(map(int, __version__.split(".")[:2])) < NUMBA:
        needed = ".".join(map(str, NUMBA))
        return f"numba {__version__} is installed, compiled kernels need {needed} or newer"
    return None
