"""Which kernels step a scene, and why compiled ones are refused."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from typing import NamedTuple, TypeVar

from ..compiled.kept import NotKept, Source, compile_errors, loaded, promising
from ..compiled.plan import Plan, plan_of
from ..compiled.tables.couplings import MOST_XI
from ..constraints import Multipliers, NullSpace, Treatment
from ..constraints.gradients import is_lattice
from ..errors import InputError, PerformanceWarning
from ..linear import Solver
from ..model import System
from ..newton import NewtonSettings
from ..warn import warn
from .base import Integrator
from .compiled_scene import CompiledMotion
from .compiled_step import stepped
from .energy_decaying import DecayingBalance
from .step_balance import StepBalance

# -- what scenes compiled kernels refuse, and why --------------------------------------------------


#: what kernels know of
BALANCES = (StepBalance, DecayingBalance)


def refusal(system: System, integrator: Integrator, treatment: Treatment) -> str | None:
    """Why a scene cannot be stepped by compiled kernels; None: it can."""
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
        if (
            item.size > MOST_XI
            or set(kinds[:-1]) - {"displacement"}
            or len({system.row_of(place) for place in item.places()}) > 2
        ):
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

#: what kernels have to save (s) for a run to have them compiled: on an empty cache that takes 7 to
#: 12 s on two processors, 14 to 20 s on one
WORTHWHILE = 25.0
#: ... to have them read from the disk, which takes 0.04 to 0.05 s with the import of llvmlite; as
#: estimates are right to a factor of two, a single run may lose 0.025 s by that
READING = 0.05
#: ... to have further ones read where this process has some: 5 ms beside what `STARTING` is for
FURTHER = 0.015
#: ... to take those that this process has: to put arrays of a scene into structures for them takes
#: a few ms, and some time for each vertex
STARTING, STARTING_EACH = 0.01, 4e-5
#: how much faster a step is with compiled kernels, for the warning where numba is missing: what
#: was measured for 20 and for 2000 elements lies on both sides
FACTOR = 15
#: how much slower plain kernels are where lines of beams are eliminated: 4 to 7 times as measured
#: for 20 elements, more for more; and with multipliers: twice for 20 elements, more for more
ELIMINATED, MULTIPLIED = 5, 2
SWITCHED_OFF = "numba does not compile: NUMBA_DISABLE_JIT is set"
#: oldest version of numba that compiles the kernels
NUMBA = (0, 63)
#: number of steps taken for granted where none is given
STEPS = 1000


class Choice(NamedTuple):
    """Kernels, and why; how compiled ones eliminate.

    And how long all is estimated to take with plain ones (s), and where compiled ones may come
    from.
    """

    name: str
    why: str
    plan: Plan | None = None
    seconds: float = 0.0
    source: Source = Source.COMPILER


def estimated_seconds(system: System, steps: int, iterations: int = 3) -> float:
    """Time of as many steps or points with the plain kernels, to a factor of two or so (s)."""
    return steps * (1.5e-4 + iterations * _plain_iteration(system))


def _plain_iteration(system: System) -> float:
    """Time of an iteration with the plain kernels (s)."""
    couplings = system.couplings.items
    kinds = len({tuple(c.kind for c in item.coordinates) for item in couplings})
    vertices = 1.5e-6 * len(system.origin_rows)
    return 2e-4 + 7e-7 * _entries(system) + vertices + 3e-4 * kinds + 3e-6 * len(couplings)


def compiled_share(system: System) -> float:
    """Time of an iteration with compiled kernels, by that with plain ones.

    What both do alike is left out of both: sparse factorisations, functions that are called back.
    """
    items = 5e-7 * len(system.joints) + 1e-6 * len(system.couplings.items)
    return min(1.0, (3e-6 + 4e-8 * _entries(system) + items) / _plain_iteration(system))


def _entries(system: System) -> int:
    """Nodes of elements, and pairs of them."""
    shapes = [group.vertices.shape for group in system.beam_groups]
    return sum(count * nodes * (1 + nodes) for count, nodes in shapes)


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
    if isinstance(treatment, Multipliers):
        seconds *= MULTIPLIED
    elif system.kinematics.elements is not None:
        seconds *= ELIMINATED
    refused = refusal(system, integrator, treatment)
    if not integrator.solves:  # there is nothing to be compiled for the sake of
        seconds = 0.0
    chosen = choose(kernels, stepped(system, treatment), refused, seconds, solver)
    return chosen._replace(seconds=seconds)


def choose(
    kernels: str,
    system: System,
    refused: str | None,
    seconds: float,
    solver: Solver | None = None,
) -> Choice:
    """What ``kernels="auto" | "numpy" | "numba"`` means for a scene.

    Whether kernels are where the choice lets them come from turns out when they are made, see
    :func:`built`.

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
        return Choice("numpy", ASKED)
    if kernels == "numba":
        if refused:
            raise InputError("argument kernels", f"'numba': {refused}")
        hindrance = _hindrance()
        if hindrance == SWITCHED_OFF:
            raise InputError("argument kernels", f"'numba': {hindrance}")
        if hindrance:
            raise ImportError(f"{NEEDED} ({hindrance})")
        return Choice("numba", ASKED, plan_of(system, solver is not None))
    if refused:
        if seconds >= WORTHWHILE:
            text = (
                f"{refused}; about {seconds:.0f} s of work with numpy, some {FACTOR} times slower"
            )
            warn("argument kernels", text, PerformanceWarning)
        return Choice("numpy", refused)
    work = f"about {seconds:.2g} s of work"
    source = _source(system, seconds)
    if source is None:
        return Choice("numpy", f"{work}, {LONGER}")
    hindrance = _hindrance()
    if hindrance:
        if source == Source.COMPILER:
            warn(
                "argument kernels",
                f"about {seconds:.0f} s of work with numpy: with numba (pip install"
                f" 'skfem-cosserat[fast]') some {FACTOR} times faster; {hindrance}",
                PerformanceWarning,
            )
        return Choice("numpy", hindrance)
    compiled = ", and the kernels are compiled already" if source < Source.COMPILER else ""
    plan = plan_of(system, solver is not None)
    return Choice("numba", f"{work} with numpy{compiled}", plan, source=source)


#: why a run takes what it takes; what an error says
ASKED = "asked for"
NEEDED = "kernels='numba' needs numba: pip install 'skfem-cosserat[fast]'"
#: why a run goes without kernels
LONGER = "reading or compiling kernels would take longer"


class _Missed:
    """What runs of this process would have saved with kernels, as each alone was too short (s)."""

    seconds = 0.0


def _source(system: System, seconds: float) -> Source | None:
    """Where kernels may come from to save more time than that takes; None: nowhere.

    `seconds` is the time without kernels. Kernels are also looked for on the disk where many short
    runs together would have paid for it.
    """
    saved = seconds * (1 - compiled_share(system))
    if saved >= WORTHWHILE:
        return Source.COMPILER
    _Missed.seconds += saved
    if _Missed.seconds >= (min(READING, FURTHER) if loaded() else READING):
        _Missed.seconds = 0.0
        if promising():
            return Source.DISK
    vertices = STARTING_EACH * len(system.origin_rows)
    return Source.PROCESS if loaded() and saved >= STARTING + vertices else None


def built(choice: Choice, make: Callable[[], MadeT]) -> tuple[Choice, MadeT | None]:
    """What `make` makes of compiled kernels; nothing where numpy is chosen, or numba fails.

    Nor where kernels would have to be compiled, and the run does not pay for that. They are written
    for numba as it is: a newer one may refuse what older ones compile. Then a warning says so, and
    plain numpy takes over.
    """
    if choice.name != "numba":
        return choice, None
    try:
        return choice, make()
    except NotKept:
        missing = ", not all of its kernels are on disk" if choice.source == Source.DISK else ""
        work = choice.why.partition(" with numpy")[0]
        return Choice("numpy", f"{work}{missing}, {LONGER}", seconds=choice.seconds), None
    except compile_errors() as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        said = lines[0][:200] if lines else type(error).__name__
        why = f"numba {version('numba')} does not compile the kernels: {said}"
        if isinstance(error, (ImportError, OSError)):  # some kernels on disk had raised hopes
            why = f"numba cannot be imported: {said}"
            if choice.why == ASKED:
                raise ImportError(f"{NEEDED} ({why})") from error
        if choice.source < Source.COMPILER:  # warned of where it is worth while
            return Choice("numpy", why, seconds=choice.seconds), None
        text = f"{why}; plain numpy takes over, some {FACTOR} times slower"
        warn("argument kernels", text, PerformanceWarning)
        return Choice("numpy", why), None


def motion_by_kernels(system: System, choice: Choice) -> CompiledMotion | None:
    """Velocities and energies of states by the kernels of a run; None: there are none.

    They are compiled only where the run is long enough for it. Large lattices do without them.
    """
    own = system.tied
    if choice.name != "numba" or not CompiledMotion.serves(own) or is_lattice(system):
        return None
    try:
        return CompiledMotion(own, NewtonSettings(), choice.source)
    except NotKept:
        return None
    except compile_errors():  # plain numpy takes over: nothing but time is lost
        return None


@cache
def installed() -> bool:
    """Whether numba is; looking for it takes a third of a millisecond."""
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
