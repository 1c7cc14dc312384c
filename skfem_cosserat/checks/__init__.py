"""Doubts about results: a table of checks that look at what is finished, once, at its end.

To add one, write a function that yields the :class:`Doubt` s that it finds in a result, in the
module of its subject, and name it in :data:`CHECKS`; the guide's list names them, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from operator import attrgetter
from typing import Any, NamedTuple

from ..arguments import checked
from ..errors import (
    AccuracyWarning,
    CosseratWarning,
    HistoryError,
    IncompleteWarning,
    InputError,
    ModelWarning,
)
from ..history import History
from ..model import Model, System, system_of
from ..model.fingerprint import other_model
from ..warn import CLOCK_OF_PATHS, CLOCK_OF_RUNS, Notice, Notices, warn
from . import elements, motion, scene
from .motion import Run as Run
from .result import Doubt as Doubt, Path as Path, Recorded as Recorded, Shapes as Shapes


class Check(NamedTuple):
    """A row of the table.

    Attributes
    ----------
    finds : callable
        Gives the doubts about a result.
    of : type
        Kind of results that it looks at.
    about, says, remedy : str
        What it is about, the cause, and what to do, as the guide lists it; a doubt may have a
        remedy of its own.
    category : type
        Of its warnings.
    failed : bool
        Whether it looks at runs that failed, too. Others would say what the failure says.
    """

    finds: Callable[[Any], Iterable[Doubt]]
    of: type
    about: str
    says: str
    remedy: str
    category: type[CosseratWarning] = AccuracyWarning
    failed: bool = False


SMALLER = "take smaller steps, and compare"
FINER = "give it order=3, or take more elements"

#: looked through in this order
CHECKS: tuple[Check, ...] = (
    Check(
        scene.falls,
        Run,
        "the model",
        "nothing ties it to the ground, and gravity pulls it away",
        "add a joint to the ground, as JointFixed(ground(x), beam.node(name))",
        ModelWarning,
    ),
    Check(
        motion.early_end,
        Run,
        "argument until",
        "the run ends before `until`, which is no multiple of the step",
        "give the step that the warning names",
    ),
    Check(
        motion.several_solutions,
        Run,
        "argument step",
        "a step may have several solutions",
        SMALLER,
        failed=True,
    ),
    Check(
        motion.unresolved,
        Run,
        "argument step",
        "steps do not resolve the motion, or a frame turns by more than half a radian in each",
        SMALLER,
        failed=True,
    ),
    Check(
        motion.unseen_inputs,
        Run,
        "a load, a drive, the moving ground",
        "steps do not see what it does: it is between their ends, or cancels in their means",
        SMALLER,
    ),
    Check(
        attrgetter("bent"),
        Recorded,
        "a beam",
        "the relative rotation of two nodes is beyond what an element can be bent by",
        "refine the mesh there",
    ),
    Check(
        attrgetter("drawn"),
        Recorded,
        "a beam",
        "the tension is above a multiple of EI/h²",
        "take the number of elements that the warning names",
    ),
    Check(
        elements.inside_out,
        Recorded,
        "a beam",
        "an element is pressed inside out, its axial strain is below -1",
        "look for a wrong unit in its stiffness or its loads",
    ),
    Check(
        elements.coarse,
        Recorded,
        "a beam",
        "its elements are too coarse for this bending: a tenth of the energy is missing",
        FINER,
    ),
    Check(
        elements.coarse_shapes,
        Shapes,
        "a beam",
        "its elements are too coarse for modes that the warning names",
        FINER,
    ),
    Check(
        scene.open_constraints,
        Run,
        "argument settings",
        "a recorded state violates a constraint by more than rounding",
        "let Newton's method go on by NewtonSettings",
    ),
    Check(
        scene.off_plane,
        Run,
        "a load that is a function",
        "it pushed out of the plane of a plane scene",
        "freeze the model without planar=",
    ),
    Check(
        scene.free_end,
        Path,
        "a beam or body",
        "it can move freely in the equilibrium at the end of a path",
        "hold it with a joint or a spring",
    ),
    Check(
        motion.unbalanced,
        Run,
        "balance of energy",
        "the run lost or gained energy that nothing explains",
        "take smaller steps, or EnergyMomentum()",
        failed=True,
    ),
    Check(
        motion.no_balance,
        Run,
        "balance of energy",
        "energies of the run cannot be had",
        "look at the reason",
        IncompleteWarning,
        failed=True,
    ),
)


def apply(result: Recorded | Shapes) -> None:
    """Warn of all that is doubtful about a finished result."""
    failed = isinstance(result, Recorded) and result.failed
    for each in CHECKS:
        if isinstance(result, each.of) and (each.failed or not failed):
            for doubt in each.finds(result):
                remedy = each.remedy if doubt.remedy is None else doubt.remedy
                text = ": ".join(filter(None, (doubt.cause, remedy)))
                warn(doubt.item, text, each.category, doubt.time)


@checked
def check(history: History, model: Model | System | None = None) -> list[Notice]:
    """Doubts about a run or a path of equilibria, at any time after it.

    A run or path has warned of this at its end, the scene, as of loose parts, when it was frozen.
    What a run met on its way, as a closed loop in a singular position, is in
    ``history.meta["warnings"]`` only.

    Parameters
    ----------
    history : History
    model : Model or System, optional
        The scene, of a history from a file; others know theirs.

    Returns
    -------
    list of dict
        As in ``history.meta["warnings"]``: "category", "item", "text", "time" (s, or load factor;
        None without one) and "when". Empty if nothing is.

    Raises
    ------
    InputError
        If the history is neither of a run nor of a path, or its scene is not known.
    HistoryError
        If it is of another model.

    Examples
    --------
    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.MassPoint(1.0, velocity=(1.0, 0, 0)))
    >>> run = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.1, until=1.0)
    >>> sc.check(run)
    []
    """
    systems = history.systems
    if model is not None:
        systems = [system_of(model, "argument model")]
        history.check_one_system()
        if difference := other_model(systems[0], history.meta.get("fingerprint", {})):
            raise HistoryError("history", f"belongs to another model: {difference}")
    if not systems:
        raise InputError("argument model", "None, but the history does not know its scene: give it")
    path = "load_factor" in history
    if not path and "scheme" not in history.meta:
        raise InputError("argument history", "is neither of simulate nor of static")
    clock, kind = (CLOCK_OF_PATHS, Path) if path else (CLOCK_OF_RUNS, Run)
    with Notices(systems[-1].warnings, clock, quiet=True, alone=True) as notices:
        apply(kind(systems, history))
    return notices.kept()
