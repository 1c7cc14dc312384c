"""Description of a system in a history: names, constant arrays, derived series."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache, partial
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from ..body import MassPoint, RigidBody, ball_surface
from ..coupling import Coupling
from ..diagnostics import (
    Projection,
    angular_momentum,
    constraint_points,
    constraint_violation,
    coupling_energy,
    doubtful_steps,
    end_forces,
    external_energy,
    hidden_violation,
    kinetic_energy,
    linear_momentum,
    momentum,
    multipliers,
    reactions,
    section_strains,
    strain_energy,
)
from ..diagnostics.energy import potential, recorded_factors, resultants
from ..diagnostics.inputs import at_jumps
from ..diagnostics.joint_motion import relative_names, relative_series
from ..diagnostics.loads import acting, load_wrenches
from ..diagnostics.stacked import all_rows, at_place
from ..errors import HistoryError, IncompleteWarning, InputError, StorageError
from ..force import Force
from ..frames import is_beam, triad
from ..history import History
from ..history.container import BALANCE, Formulas, Kind
from ..joint import Joint, JointDistance
from ..model import System, takes_scene
from ..model.fingerprint import fingerprint, other_model
from ..model.groups import lumped
from ..model.theories import theory_of
from ..time_function import of_the_user
from ..types import Array, FilePath, Floats, IndexArray, Meta, names_known
from ..version import VERSION
from ..warn import Notices, warn

if TYPE_CHECKING:
    from ..beam import Beam
    from ..section import Section

#: version of a package, whose metadata it takes a millisecond to read
_installed = cache(version)


def describe(system: System) -> tuple[Meta, dict[str, Floats]]:
    """Names and constant arrays of a system, as a history keeps them."""
    meta: Meta = {
        "versions": {
            "skfem_cosserat": VERSION,
            "scikit-fem": _installed("scikit-fem"),
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
        "joints": [_tied(joint, joint.type) for joint in system.joints],
        "couplings": [_tied(each, each.kind) for each in shown(system)],
        "loads": [],
        "drives": [
            {"name": each.name, "type": each.coordinate.kind, "joint": each.joint.name}
            for each in system.drives
        ],
        #: force elements whose angles the series "turns" counts
        "turns": system.couplings.turning,
    }
    static: dict[str, Any] = {"reference": system.q0}
    for item in system.structures:
        if is_beam(item):
            meta["beams"].append(_describe_beam(system, item, static))
        else:
            _describe_lump(system, lumped(item), meta, static)
    carried = [int(array) for key, array in static.items() if key.endswith("/offset")]
    places = [end for joint in system.joints for end in (joint.a, joint.b)]
    places += [place for each in shown(system) for place in each.places()]
    places += [place for load in system.loads for place in load.places()]
    #: numbers in q of the frames on which joints, loads and couplings act
    acted = [system.offset(place) for place in places if place.item is not None]
    acted += carried
    for beam in system.beams:
        offsets = static[f"beam/{beam.name}/offsets"]
        static[f"beam/{beam.name}/acted"] = np.flatnonzero(np.isin(offsets, acted))
    for joint in system.joints:
        _describe_joint(joint, system, static)
    for load in system.loads:
        gravity = np.sum([term.acceleration() for term in load.made_of], 0)
        own = {"acceleration": gravity.tolist()} if gravity.any() else {}
        meta["loads"].append({"name": load.name, "type": type(load).__name__, **own})
    forces = (each for each in acting(system) if isinstance(each, Force))
    meta["loads"] += [{"name": each.name, "type": "Force"} for each in forces]
    return meta, static


def shown(system: System) -> list[Coupling]:
    """Force elements between two places: those of own laws at places are listed as loads."""
    return [c for c in system.couplings.all if not c.points]


def _tied(item: Any, kind: str) -> dict[str, Any]:
    """A joint or coupling, and what it ties; of an obstacle its surface."""
    own = {"surface": item.surface.described()} if kind == "obstacle" else {}
    return {"name": item.name, "type": kind, "a": item.a.label, "b": item.b.label, **own}


def _describe_joint(joint: Joint, system: System, static: dict[str, Any]) -> None:
    """Axes (3, 3) of what a joint leaves free, the first last, in the frame of side a."""
    key = f"joint/{joint.name}/"
    a = joint.a
    with suppress(NotImplementedError, InputError):  # own joints for multipliers have no freedom
        free = joint.freedom()
        slides = [np.cross(slide.left, slide.right) for slide in free.slides]
        ways = [turn.axis for turn in free.turns or ()] or slides or [np.eye(3)[2]]
        axes = triad(*ways[:2])
        if a.item is not None and a.triad is not None:
            axes = axes @ a.triad.T
            static[key + "frame"] = np.array(system.offset(a))
        static[key + "axes"] = axes


def recorded_turns(system: System, history: History, index: int = -1) -> IndexArray | None:
    """Full turns and memories of a system at a state; as at first if they are not recorded."""
    if "turns" not in history:
        return None
    return system.couplings.named(history.meta.get("turns", []), history["turns"][index])


def _describe_lump(
    system: System, item: RigidBody | MassPoint, meta: Meta, static: dict[str, Any]
) -> None:
    """A body or mass point, also one that is attached to a node: it moves with that frame."""
    if isinstance(item, RigidBody):
        place = item.at(item.position)
        surface = item.surface
    else:  # off the origin of its frame: a small ball that moves with it
        place = item.place()
        surface = ball_surface(0.01 * system.length) if place.offset.any() else None
    rigid = isinstance(item, RigidBody)
    key = f"{'body' if rigid or surface is not None else 'point'}/{item.name}/"
    static[key + "offset"] = np.array(system.offset(place))
    if key.startswith("point"):
        meta["points"].append({"name": item.name})
        return
    meta["bodies"].append({"name": item.name, "shape": "surface" if rigid else "ball"})
    if surface is not None:
        static[key + "points"] = np.array(surface[0], float) + place.offset
        static[key + "faces"] = np.array(surface[1], np.int64)


def _describe_beam(system: System, beam: Beam, static: dict[str, Any]) -> dict[str, Any]:
    key = f"beam/{beam.name}/"
    row = system.first[id(beam)][1]
    nodes = len(beam.basis.nodes)
    names = sorted(beam.mesh.subdomains or {})
    part = np.full(len(beam.section_id), -1, np.int64)
    for k, name in enumerate(names):
        part[beam.mesh.elements_of(name)] = k
    own = {
        "offsets": 3 * (row + 4 * np.arange(nodes, dtype=np.int64)),
        "connectivity": np.asarray(beam.basis.connectivity, np.int64),
        "lengths": beam.elements.lengths,
        "rotations": beam.rotations,
        "part": part,
        "section": beam.section_id,
        "gauss": beam.elements.points,
        "nodes": beam.basis.interpolation.nodes,
        **_described_sections(beam),
    }
    static.update({key + name: value for name, value in own.items()})
    return {
        "name": beam.name,
        "order": beam.basis.order,
        "parts": names,
        "sections": list(beam.sections),
    }


def _described_sections(beam: Beam) -> dict[str, Array]:
    """Radii (ne, 2) at the ends of elements; of each section its shapes, or those of the nodes."""
    from ..section_field import distinct

    radius = np.zeros((len(beam.section_id), 2))
    at = np.linspace(0.0, 1.0, beam.basis.order + 1)
    found = {"radius": radius}
    for k in range(len(beam.sections)):
        own = np.flatnonzero(beam.section_id == k)
        with suppress(InputError):  # as at the point of a cone, which is drawn as a line
            sections, number = distinct(beam.sections_at(own, at))
            radius[own] = np.array([*map(_radius, sections)])[number[:, [0, -1]]]
            for name, each in _shapes(sections).items():
                found[f"{name}/{k}"] = each[0] if len(each) == 1 else each[number]
    return found


def _radius(section: Section) -> float:
    """That of a beam drawn as a tube: to the farthest point of the outline.

    Without one that of a circle that bends as softly.
    """
    _, _, EA, *EI, _ = np.diag(section.stiffness)
    own = 2 * np.sqrt(min(EI) / EA) if section.outline is None else section.outline
    return float(np.linalg.norm(np.atleast_2d(own), axis=-1).max())


def _shapes(sections: Sequence[Section]) -> dict[str, Array]:
    """Outlines (k, m, 2), skins and their stresses likewise, as far as all of them have alike."""
    outlines = [each.outline for each in sections if each.outline is not None]
    if len(outlines) < len(sections):
        return {}
    found = {"outline": np.array(outlines)} if len(set(map(len, outlines))) == 1 else {}
    loops = {tuple(map(len, each.skin)) for each in sections}
    stresses = [each.skin_stresses() for each in sections]
    if len(loops) == 1 and not any(each is None for each in stresses):
        found["skin"] = np.array([np.concatenate(each.skin) for each in sections])
        found |= {"loops": np.array([*loops]), "stress": np.array(stresses)}
    return found


# -- series that follow from the states: energies, velocities, momenta, forces, reactions ----------

#: what is known at the ends of elements
NODAL = "resultant", "strain"
#: works since the start of a run, which explain changes of its energy
WORKS = "work_loads", "work_actuators", "work_drives"


@takes_scene
def derive_series(system: System, history: History) -> None:
    """Have a history give what follows from its states: energies, momenta, forces, reactions.

    ``simulate`` and ``static`` do so with theirs. Others, such as one from a file, get series of
    their model by this function. Nothing is computed here: each series is derived when it is first
    asked for.

    Of a run: ``v, Qp`` (projected on the hidden constraints), ``kinetic, strain_energy, external,
    coupling_energy, energy`` (kinetic + strain + coupling at (q, p)), ``energy_projected``,
    ``energy_balance``, ``linear_momentum``, ``angular_momentum``, ``constraint_violation``, for
    each beam ``strain`` and ``resultant`` at Gauss points, ``nodal_strain`` and ``nodal_resultant``
    at both ends of each element (the elastic part: that of damped sections is left to
    ``diagnostics.section_forces``), for each joint ``position``, ``force`` and ``moment``, its
    relative coordinates and their rates, for each spring, damper, cable and bushing
    ``coordinate``, ``force`` and ``ends``, for each load that acts at places ``position``,
    ``force`` and ``moment`` (N, k, 3), line loads in the middle of each element. Of a path: the
    same without momenta.

    Forces and moments of joints, ``multipliers`` and resultants of strains that a beam's theory
    holds belong to the states, like all series, and are of the order of the scheme up to the second
    (``simulate`` says how). They are not where a load, or the velocity or acceleration of a
    prescribed motion, jumps: next to it they mix both sides. ``at_jump`` (of runs) is 1 for the
    states within a step of a jump, 0 for all others.

    ``energy_balance`` is ``energy - work_loads - work_actuators - work_drives + dissipated`` less
    its first value: zero up to the solver's tolerance with energy-momentum, where all terms
    belong to the discrete equations; with the variational scheme an error of second order in the
    step that oscillates. ``external`` is the potential of gravity and dead loads: their work is in
    ``work_loads`` too, add one or the other.

    Raises
    ------
    HistoryError
        If the history is of another model, or its joints changed on the way: take
        ``history.segment(k)`` then.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from skfem_cosserat import EnergyMomentum, MassPoint, Model, NullSpace, simulate
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, velocity=(1.0, 0, 0)))
    >>> history = simulate(model, EnergyMomentum(), NullSpace(), 0.1, until=0.2)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "run.history"
    ...     history.save(path)
    ...     loaded = History.load(path)
    ...     derive_series(model, loaded)
    ...     loaded["Qp"][-1].tolist()  # the file is read where a series is asked for
    [2.0, 0.0, 0.0]
    """
    history.check_one_system()
    found = history.meta.get("fingerprint")
    if found is not None and (difference := other_model(system, found)):
        raise HistoryError("history", f"belongs to another model: {difference}")
    history.derive_by([system], kind_of(history))


#: what a run derives when it ends: all (True), some, nothing yet (None), or nothing ever (False)
Asked = bool | Sequence[str] | None


def checked_asked(derive: Asked, system: System, kind: Kind) -> Asked:
    """The argument `derive` of a run of this kind; InputError if it is none, or names no series."""
    if derive is None or isinstance(derive, (bool, np.bool_)):
        return derive
    item = "argument derive"
    if isinstance(derive, str) or not isinstance(derive, Sequence):
        raise InputError(item, f"{derive!r}, expected True, False or a list of names of series")
    known = [name for together in kind(system) for name in together]
    for name in derive:
        if name not in known:
            raise InputError(item, f"no series {name!r} is derived; {names_known(name, known)}")
    return list(derive)


def finish(
    history: History,
    systems: Sequence[System],
    derive: Asked,
    path: FilePath | None,
) -> None:
    """Let a history derive its series, derive those asked for, and save it.

    Nothing is lost by an interrupt: states are in the file already, series are derived later. What
    depends on functions of the user's own is derived now, while they are as they were.
    """
    history.derive_by([] if derive is False else systems, kind_of(history))
    if derive is False:
        return
    try:
        if derive is True or any(map(_moved_by_the_user, systems)):
            history.derive()
        elif derive:
            history.derive(derive)
        if any(of_the_user(time) for system in systems for time in system.loading.times):
            history.derive([name for name in ("external",) if name in history])
        if path is not None:
            history.save(path)
    except KeyboardInterrupt:
        text = "interrupted: what is not there yet is derived when it is asked for"
        where = "" if path is None else f"; {os.fspath(path)!r} has the recorded states alone"
        warn("derived series", text + where, IncompleteWarning)


def _moved_by_the_user(system: System) -> bool:
    """True if functions of the user's own move the ground: nobody knows what they give later."""
    driven = {id(drive.place) for drive in system.drives}
    places = [place for place in system.moving if id(place) not in driven]
    own = [value for p in places for value in vars(p.motion).values() if callable(value)]
    return any(map(of_the_user, [*own, *(drive.motion for drive in system.drives)]))


def kind_of(history: History) -> Kind:
    """Formulas that fit a history: of a run, of a path of equilibria, or of a mode."""
    if "load_factor" in history:
        return path_formulas
    if "instant" in history.meta:
        return configuration_formulas
    return run_formulas if set(WORKS) <= set(history.recorded) else state_formulas


def take_along(
    error: BaseException, so_far: Callable[[], History], systems: Sequence[System]
) -> None:
    """Give an error of the user's own code, or of a full disk, the history as ``error.history``.

    `so_far` closes what is still open, which may meet a full disk in its turn; series follow from
    the `systems`.
    """
    history: History
    try:
        with Notices(quiet=True):  # the error is said, its history has the warnings
            history = so_far()
    except StorageError as full:
        history = full.history
        if full is not error:
            error.add_note(str(full))
    history.derive_by(systems, kind_of(history))
    error.history = history  # type: ignore[attr-defined]
    if not isinstance(error, StorageError):
        error.add_note(f"the history up to t = {history.times[-1]:.6g} is in .history")


def run_formulas(system: System) -> Formulas:
    """Formulas of a run, which has recorded works."""
    return state_formulas(system) | {
        (BALANCE,): _balance,
        ("at_jump",): lambda h: [at_jumps(system, h)],
        ("doubtful_step",): lambda h: [doubtful_steps(system, h).astype(float)],
    }


def state_formulas(system: System) -> Formulas:
    """Formulas that take configurations, momenta and constraint forces."""
    return _stored_formulas(system) | {
        ("v",): lambda h: [Projection(system).velocities(h["q"], h["p"], h.times)],
        ("Qp",): lambda h: [np.where(np.isnan(h["v"]), np.nan, momentum(system, h["v"]))],
        ("kinetic",): lambda h: [kinetic_energy(system, h["p"])],
        ("external",): lambda h: [external_energy(system, h["q"], h.times)],
        ("energy",): lambda h: [h["kinetic"] + h["strain_energy"] + h["coupling_energy"]],
        ("energy_projected",): lambda h: [
            0.5 * (h["v"] * h["Qp"]).sum(1) + h["strain_energy"] + h["coupling_energy"]
        ],
        ("linear_momentum",): lambda h: [linear_momentum(system, h["p"])],
        ("angular_momentum",): lambda h: [angular_momentum(system, h["q"], h["p"])],
        ("angular_momentum_projected",): lambda h: [angular_momentum(system, h["q"], h["Qp"])],
        ("hidden_violation",): lambda h: [hidden_violation(system, h["q"], h["v"], h.times)],
        **configuration_formulas(system),
    }


def path_formulas(system: System) -> Formulas:
    """Formulas of the equilibria along a path."""
    return _stored_formulas(system) | {
        ("v",): lambda h: [np.zeros_like(h["q"])],
        ("energy",): lambda h: [h["strain_energy"] + h["coupling_energy"]],
        ("external",): lambda h: [potential(system, h["q"], h["amplitudes/loads"])],
        **configuration_formulas(system),
    }


def configuration_formulas(system: System) -> Formulas:
    """Formulas that take configurations, constraint forces and the velocities "v"."""
    items = [jr.joint for jr in system.joint_rows]
    couplings = shown(system)
    rods = [item for item in items if isinstance(item, JointDistance)]
    tied: list[Any] = [*couplings, *rods]

    def coordinates(h: History) -> list[Floats]:
        given = h["q"], h["v"], h.instants, h.series.get("turns")
        return list(relative_series(system, *given).values())

    def wrenches(h: History) -> list[Floats]:
        found = reactions(system, constraint_points(system, h), h["multipliers"])
        return [each for pair in found.values() for each in pair]

    def places(h: History) -> list[Floats]:
        y = all_rows(system, h["q"], h.instants)
        ends = [[at_place(system, y, end) for end in (item.a, item.b)] for item in tied]
        return [*(at_place(system, y, item.a) for item in items), *(np.stack(e, 1) for e in ends)]

    def ends(h: History) -> list[Floats]:
        found = end_forces(system, h)
        return [each for beam in system.beams for each in found[str(beam.name)]]

    formulas: Formulas = {
        ("constraint_violation",): lambda h: [constraint_violation(system, h["q"], h.instants)],
        tuple(relative_names(system)): coordinates,
        ("multipliers",): lambda h: [
            multipliers(system, constraint_points(system, h), h["constraint_force"])
        ],
    }
    for beam in system.beams:
        formulas |= _beam_formulas(system, beam)
    if system.beams:
        both = [f"beam/{b.name}/nodal_{each}" for b in system.beams for each in NODAL]
        formulas[tuple(both)] = ends
    wrench_names = [f"joint/{item.name}/{each}" for item in items for each in ("force", "moment")]
    for load in acting(system):
        names = tuple(f"load/{load.name}/{each}" for each in ("position", "force", "moment"))
        formulas[names] = partial(load_wrenches, system, load)
    place_names = [f"joint/{item.name}/position" for item in items]
    end_names = [f"coupling/{item.name}/ends" for item in couplings]
    end_names += [f"joint/{item.name}/ends" for item in rods]
    return formulas | {tuple(wrench_names): wrenches, (*place_names, *end_names): places}


def _beam_formulas(system: System, beam: Beam) -> Formulas:
    """Strains and section forces of a beam."""
    strain = f"beam/{beam.name}/strain"
    holds = theory_of(system.theory_rows, beam) is not None

    def resultant(h: History) -> list[Floats]:
        lam = h["multipliers"] if holds else None
        return [resultants(system, beam, h[strain], recorded_factors(system, h), lam)]

    return {
        (strain,): lambda h: [section_strains(system, beam, h["q"])],
        (f"beam/{beam.name}/resultant",): resultant,
    }


def _stored_formulas(system: System) -> Formulas:
    """Formulas of the energies of all beams and of all springs."""
    return {
        ("strain_energy",): lambda h: [
            strain_energy(system, h["q"], amplitudes=recorded_factors(system, h))
        ],
        ("coupling_energy",): lambda h: [
            coupling_energy(system, h["q"], h.instants, h.series.get("turns"))
        ],
    }


def _balance(history: History) -> list[Floats]:
    """Energy less all work done since the start, and what was dissipated."""
    balance = history["energy"] - sum(history[name] for name in WORKS) + history["dissipated"]
    return [balance - balance[:1]]
