"""Scenes: items by name, and systems with joints or loads taken out of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import wraps
from inspect import signature
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

import numpy as np

from ..arguments import checked
from ..body import MassPoint, RigidBody
from ..coupling import Composed, Coupling
from ..damping import RayleighDamping
from ..errors import IncompatibleError, InputError, ModelWarning
from ..frames import Item, Place, StructuralItem, is_beam
from ..frozen import Replacements, loosened, seal
from ..joint import Joint, JointDrive, JointLocked
from ..load import Load
from ..time_function import (
    Amplitude,
    Constant,
    FunctionOfTime,
    time_function,
)
from ..types import ArrayLike, Floats, names_known
from ..warn import Notices, warn
from .checks import check_inertia
from .ground import Placed
from .groups import Structure
from .loops import closure_rows
from .parts import warn_of_loose_parts
from .plane import Planar, Planarity, confine, inspect
from .system import Pictured, System, listed

ItemT = TypeVar("ItemT", bound=Item)

#: single ones, and items that are composed of them
FORCE_ELEMENTS = Coupling, Composed

# -- scenes that change while they move: joints locked, freed or taken away, loads switched --------
#
# A changed scene is a :class:`System` of its own with the same coordinates, ground frames and
# stress free beams; where joints change, all constraints are set up at the configuration of that
# instant.


def joint_of(system: System, joint: Joint | str) -> Joint:
    """A joint of a system as it is now, by its name or by the joint it was at first.

    Raises
    ------
    InputError
        If there is none; the message lists the names.
    """
    return _named(system.joints, joint, "joint")


def load_of(system: System, load: Load | str) -> Load:
    """A load of a system as it is now, by its name or by the load it was at first."""
    return _named(system.loads, load, "load")


def _named(items: Sequence[ItemT], asked: Item | str, kind: str) -> ItemT:
    """The item of a name, or what an item has become."""
    name = asked.name if isinstance(asked, Item) else asked
    if not isinstance(name, str):
        raise InputError(kind, f"is {asked!r}, expected a {kind} of the model or its name")
    found = {each.name: each for each in items}
    if name not in found:
        known = names_known(name, sorted(map(str, found)))
        raise InputError(kind, f"{name!r} is not in this system; {known}")
    return found[name]


def locked(system: System, joint: Joint | str, q: Floats, t: float) -> System:
    """The scene with the relative coordinates of a joint frozen at (q, t); its drives end.

    Raises
    ------
    IncompatibleError
        If a side has no directions, or is ground in prescribed motion.
    """
    old = joint_of(system, joint)
    if isinstance(old, JointLocked):
        raise InputError(old.label, "is locked already")
    for place in (old.a, old.b):
        if place.triad is None:
            reason = f"{place.label} is a mass point, which has no directions to hold"
            raise IncompatibleError(f"lock of the {old.label}", reason)
        if place.motion is not None:
            reason = f"{place.label} is in prescribed motion: attach a body to it, and lock that"
            raise IncompatibleError(f"lock of the {old.label}", reason)
    y = system.extend(q, t)
    x = _point(system, old.b, y)
    new = JointLocked(old, _described(system, old.a, y, x), _described(system, old.b, y, x))
    joints = [new if each is old else each for each in system.joints]
    return _changed(system, q, t, joints, _without(system, old))


def unlocked(system: System, joint: Joint | str, q: Floats, t: float) -> System:
    """The scene with a locked joint as it was before; drives that ended do not come back."""
    old = joint_of(system, joint)
    if not isinstance(old, JointLocked):
        raise InputError(old.label, "is not locked")
    joints = [old.joint if each is old else each for each in system.joints]
    return _changed(system, q, t, joints, system.drives)


def released(system: System, joint: Joint | str, q: Floats, t: float) -> System:
    """The scene without a joint and its drives."""
    old = joint_of(system, joint)
    joints = [each for each in system.joints if each is not old]
    return _changed(system, q, t, joints, _without(system, old))


def with_amplitude(system: System, load: Load | str, amplitude: Amplitude) -> System:
    """The scene with another amplitude (a number or a function of time) of a load.

    Raises
    ------
    InputError
        If the components of the load are functions of time and the amplitude is no number, or the
        terms of an own load do not have its amplitude.
    """
    old = load_of(system, load)
    time = time_function(old.label, amplitude)
    new = loosened(copy(old))
    if len(old.channels) < 2:
        new.channels = tuple((value, time) for value, _ in old.channels)
        new.time = time
    elif isinstance(time, Constant):
        factor = time.number
        new.time = time
        new.channels = tuple(
            (value, FunctionOfTime(lambda t, each=each: factor * each.value(t)))  # type: ignore[misc]
            for value, each in old.channels
        )
    else:
        raise InputError(old.label, "its components are functions of time: give a number")
    seal(new)
    own = {id(time), *(id(each) for _, each in new.channels)}
    if all(id(term.time) not in own for term in new.made_of):
        raise InputError(old.label, "its terms have no amplitude of the load: give them self.time")
    loads = [new if each is old else each for each in system.loads]
    return _anew(system, system.joints, loads, system.drives, system.placed)


def _changed(
    system: System, q: Floats, t: float, joints: Sequence[Joint], drives: Sequence[JointDrive]
) -> System:
    return _anew(system, joints, system.loads, drives, Placed(q.copy(), t, system.grounds))


def _checked(system: System) -> System:
    """Check that all that moves has inertia, and return the system.

    A system out of a pickle has been checked before.
    """
    check_inertia(system, system.spanned, lambda: closure_rows(system))
    return system


def _anew(
    system: System,
    joints: Sequence[Joint],
    loads: Sequence[Load],
    drives: Sequence[JointDrive],
    placed: Placed | None,
) -> System:
    items = (
        system.structures,
        joints,
        loads,
        drives,
        system.couplings.all,
        system.dampings,
    )
    with Notices(system.warnings) as notices:
        out = _checked(System(*items, placed, copies=system.copies))
        if system.plane is not None:
            out.confine(system.plane)
        if out.immovable is not None:  # a run goes on as far as it can
            warn(*out.immovable, ModelWarning)
    out.warnings = notices.found
    return out


def _without(system: System, joint: Joint) -> list[JointDrive]:
    """Drives of other joints."""
    return [drive for drive in system.drives if drive.joint is not joint]


def _point(system: System, place: Place, y: Floats) -> Floats:
    """Position of a place at y."""
    row = system.row_of(place)
    return y[row] if place.triad is None else y[row] + place.offset @ y[row + 1 : row + 4]


def _described(system: System, place: Place, y: Floats, x: Floats) -> Place:
    """The point of a place's frame that is at x now, as if this were the reference."""
    row = system.row_of(place)
    D = y[row + 1 : row + 4].copy()
    return replace(place, position=x.copy(), offset=D @ (x - y[row]), triad=D)


# -- the scene: items with names, collected first and numbered when frozen -------------------------

#: kinds that the arrays of a system know
MASSES = (RigidBody, MassPoint)

ParametersT = ParamSpec("ParametersT")
ReturnT = TypeVar("ReturnT")


@checked
class Model(Pictured):
    """A scene: beams, bodies, mass points; joints, drives; loads, force elements, damping.

    Add items with names, then :meth:`freeze` to arrays. Numbering follows the order of adding.

    Examples
    --------
    >>> from skfem_cosserat import JointSpherical, LoadGravity, MassPoint, JointDistance, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(1.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> gravity = model.add("gravity", LoadGravity((0, 0, -9.81)))
    >>> model.freeze().counts()
    {'n': 3, 'm': 1, 'rank': 1, 'unknowns': 2}
    """

    def __init__(self) -> None:
        self._items: dict[str, Item] = {}
        self._copies: Replacements | None = None
        self._system: System | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Without the system that was frozen last: it is the same anew."""
        return {**self.__dict__, "_system": None}

    def summary(self) -> dict[str, Any]:
        """Its items by name, each in a line."""
        return {item.label: item._shown() for item in self._items.values()}

    def __repr__(self) -> str:
        return f"<Model of {listed([i.label for i in self._items.values()])}>"

    def add(self, name: str, item: ItemT) -> ItemT:
        """Add an item under a new name and return it.

        Parameters
        ----------
        name : str
            Not empty and not in use.
        item : Beam, RigidBody, MassPoint, a joint, a drive, a load, a force element or a damping

        Raises
        ------
        InputError
            For a name in use, an item that is already in a model, or anything else than an item.

        Examples
        --------
        >>> from skfem_cosserat import MassPoint
        >>> model = Model()
        >>> ball = model.add("ball", MassPoint(1.0))
        >>> model["ball"] is ball, list(model), len(model)
        (True, ['ball'], 1)
        """
        if not isinstance(name, str) or not name:
            raise InputError("model", f"name = {name!r}, expected a non-empty string")
        if name in self._items:
            raise InputError(
                "model", f"duplicate name {name!r}: it is already the {self._items[name].label}"
            )
        if not isinstance(
            item,
            (StructuralItem, Joint, JointDrive, Load, RayleighDamping, *FORCE_ELEMENTS),
        ):
            raise InputError(
                f"model, item {name!r}",
                f"is {type(item).__name__}, expected a beam, body, mass point, joint, drive,"
                " load, force element, foundation or damping",
            )
        for attribute in vars(item):
            if callable(getattr(type(item), attribute, None)):
                text = f"its attribute {attribute!r} hides the method of that name: rename it"
                raise InputError(f"model, item {name!r}", text)
        _check_kind(name, item)
        if item.name is not None:
            raise InputError(f"model, item {name!r}", f"is already in a model as {item.name!r}")
        vars(item)["name"] = name  # what else it is was settled when it was made
        self._items[name] = item
        self._system = None
        return item

    def __getitem__(self, name: str) -> Item:
        if name not in self._items:
            known = names_known(name, sorted(self._items), ask="list(model)")
            raise InputError("model", f"unknown name {name!r}; {known}")
        return self._items[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def with_items(self, items: Mapping[str, StructuralItem]) -> Model:
        """Copy of the scene with other beams (or bodies) of some names; this one does not change.

        Everything that refers to them (joints, loads, masses on them, springs, dampings,
        foundations) is there again and refers to the new ones, at the same material points.

        Parameters
        ----------
        items : dict of str to Beam or RigidBody
            In no model yet, such as ``beam.on_mesh(divided(beam.mesh, 4), order=2)``. A rigid
            body may stand for a beam.

        Raises
        ------
        InputError
            For an unknown name, an item of another kind, or where a point that something is
            attached to is no node any more.

        Examples
        --------
        >>> from skfem_cosserat import Beam, JointRevolute, MeshCurve, Section, ground
        >>> from skfem_cosserat.mesh import divided
        >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
        >>> model = Model()
        >>> rod = model.add("rod", Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 20), section))
        >>> place = rod.node("beam.end")
        >>> pin = model.add("pin", JointRevolute(ground((0, 2, 0)), place, axis=(1, 0, 0)))
        >>> other = model.with_items({"rod": rod.on_mesh(divided(rod.mesh, 3), order=2)})
        >>> other["pin"].b.label, other.freeze().n, model.freeze().n
        ("beam 'rod' node 'beam.end' at [0.0, 2.0, 0.0]", 84, 252)
        """
        return self.rebuilt(items)[0]

    def rebuilt(self, items: Mapping[str, StructuralItem]) -> tuple[Model, Replacements]:
        """Copy as of :meth:`with_items`, with what finds the copies of sensors and the like.

        Systems of it know places of this model, too: functions of users go on to have them.
        """
        for name, item in items.items():
            old = self[name]
            if not all(is_beam(i) or isinstance(i, RigidBody) for i in (old, item)):
                raise InputError(
                    f"model, item {name!r}",
                    f"the {item!r} instead of the {old.label}: expected a"
                    " beam or rigid body instead of one",
                )
            if item.name is not None:
                raise InputError(f"model, item {name!r}", f"is already in a model: {item.label}")
        replacements = Replacements({self[name]: item for name, item in items.items()})
        other = type(self)()
        for name in self:
            other.add(name, replacements.of(self[name]))
        other._copies = replacements
        return other, replacements

    def freeze(self, planar: Planar | None = None) -> System:
        """Number everything and check it: the arrays that all methods work on.

        Parameters
        ----------
        planar : Planar, optional
            Confine everything to a plane: without unknowns out of it. Default: in space.

        Raises
        ------
        InputError
            Naming the item: references to items that are not in the model, joints that do not
            close, contradictory drives, no mobility at all, coordinates that have neither mass nor
            are held; what leaves the plane if there is to be one.

        Examples
        --------
        >>> from skfem_cosserat import MassPoint
        >>> model = Model()
        >>> ball = model.add("ball", MassPoint(1.0, position=(1, 2, 3)))
        >>> model.freeze().q0.tolist()
        [1.0, 2.0, 3.0]
        """
        items = list(self._items.values())
        structures = cast("list[Structure]", [i for i in items if isinstance(i, StructuralItem)])
        if not structures:
            raise InputError("model", "has no beam, body or mass point")
        known = {id(item) for item in items}
        for item in items:
            for other in item.references():
                if id(other) not in known:
                    raise InputError(item.label, _missing(item, other))
        drives = [i for i in items if isinstance(i, JointDrive)]
        for drive in drives:
            if id(drive.joint) not in known:
                raise InputError(
                    drive.label,
                    f"refers to the {drive.joint.label}, which is not in the model: add it",
                )
        before = [notice for i in structures if is_beam(i) for notice in i.warnings]
        with Notices(before) as notices:
            found = System(
                structures,
                [i for i in items if isinstance(i, Joint)],
                [i for i in items if isinstance(i, Load)],
                drives,
                _couplings(items),
                [i for i in items if isinstance(i, RayleighDamping)],
                scene=dict(self._items),
                copies=self._copies,
            )
            system = _checked(found)
            if planar is not None:
                confine(system, planar)
            if system.immovable is not None:
                raise InputError(*system.immovable)
            warn_of_loose_parts(system)
        system.warnings = notices.found
        return system


@checked
def planarity(scene: Model | System, normal: ArrayLike | None = None) -> Planarity:
    """Check if a scene stays in a plane; gives the plane, and what leaves it by how much.

    Geometry, inertia, sections, joints, loads, force elements and initial velocities are looked
    at; functions of time at a few first instants only (a run that leaves the plane later stops, or
    warns at its end of forces that are functions of the motion).

    Parameters
    ----------
    scene : Model or System
    normal : (3,) array, optional
        Unit vector normal to the plane; default: the one that fits best.

    Examples
    --------
    >>> from skfem_cosserat import LoadForce, MassPoint, RigidBody
    >>> model = Model()
    >>> body = model.add("body", RigidBody.box(1.0, (1, 2, 3)))
    >>> ball = model.add("ball", MassPoint(1.0, position=(4, 2, 0)))
    >>> force = model.add("force", LoadForce(body.local((1, 0, 0)), (0, 3.0, 0)))
    >>> planarity(model)
    <planar, normal [0.0, 0.0, 1.0]>
    >>> model.freeze(planar=planarity(model).planar).unknowns   # 3 and 2 instead of 6 and 3
    5
    >>> side = model.add("side", LoadForce(body.local((0, 0, 0)), (0, 3.0, 4.0)))
    >>> planarity(model).out_of_plane
    ("load 'side': [0.0, 3.0, 4.0] leaves the plane by 4",)
    """
    return inspect(system_of(scene, "argument scene"), Planar(normal).normal)


def system_of(scene: Model | System, item: str = "argument system") -> System:
    """The system of a scene: itself, or the model in space, frozen once for all that ask.

    Parameters
    ----------
    scene : Model or System
        A model is frozen again only after something has been added to it.
    item : str
        What errors call it.

    Raises
    ------
    InputError
        If it is neither; and as from :meth:`Model.freeze`.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(1.0))
    >>> system_of(model) is system_of(model)
    True
    """
    if isinstance(scene, System):
        return scene
    if not isinstance(scene, Model):
        raise InputError(item, f"is of type {type(scene).__name__}, expected a Model or a System")
    if scene._system is None:
        scene._system = scene.freeze()
    return scene._system


def model_of(scene: Model | System, item: str = "argument model") -> Model:
    """The model of a scene: itself, or one of the items that a system was frozen from.

    Raises
    ------
    InputError
        If it is neither, or a system that events have changed.
    """
    if isinstance(scene, Model):
        return scene
    items = system_of(scene, item).scene
    if items is None:
        raise InputError(item, "is a System that was changed in a run, expected a Model")
    model = Model()
    model._items.update(items)
    return model


def takes_scene(
    function: Callable[Concatenate[System, ParametersT], ReturnT],
) -> Callable[Concatenate[Model | System, ParametersT], ReturnT]:
    """Let a function of a system take a model as well, by :func:`system_of`."""
    parameters = signature(function).parameters
    name = next(iter(parameters))
    function = checked(function)

    @wraps(function)
    def taking(*args: Any, **kwargs: Any) -> ReturnT:
        if "planar" in kwargs and "planar" not in parameters:
            raise TypeError(
                f"{function.__name__}() got an unexpected keyword argument 'planar': give it a"
                " scene that is confined to its plane, model.freeze(planar=sc.Planar())"
            )
        if args:
            args = (system_of(args[0], f"argument {name}"), *args[1:])
        elif name in kwargs:
            kwargs[name] = system_of(kwargs[name], f"argument {name}")
        return function(*args, **kwargs)

    return cast("Callable[Concatenate[Model | System, ParametersT], ReturnT]", taking)


def _missing(item: Item, other: Item) -> str:
    """That an item refers to another one which is not in the model: which one, and where."""
    sides = {id(place.item): (side, place) for side, place in _sides(item)}
    where = ""
    if id(other) in sides:
        side, place = sides[id(other)]
        where = f"side {side}, {place.label}, "
    which = other.label
    if is_beam(other):
        names = sorted(other.mesh.subdomains or {})
        x = other.mesh.p
        called = f"of {', '.join(map(repr, names))} " if names else ""
        ends = " to ".join(str(np.round(x[:, k], 9).tolist()) for k in (0, -1))
        which += f" (on the mesh {called}from {ends})"
    elif isinstance(other, MASSES):
        which += f" (at {np.round(other.position, 9).tolist()})"
    return f"{where}refers to the {which}, which is not in the model: add it"


def _sides(item: Item) -> Iterator[tuple[str, Place]]:
    for side in ("a", "b"):
        if isinstance(place := getattr(item, side, None), Place):
            yield side, place


def _check_kind(name: str, item: Item) -> None:
    """Loads enter by their terms; what has mass in as many ways as there are classes here."""
    if isinstance(item, Load) and type(item).terms is Load.terms:
        known = "LoadForce, LoadMoment, LoadLine or LoadGravity, or write its method terms"
    elif isinstance(item, StructuralItem) and not (is_beam(item) or isinstance(item, MASSES)):
        known = "Beam, RigidBody or MassPoint"
    elif isinstance(item, Load):
        try:
            item.references()
        except InputError as error:  # it has no name yet
            raise InputError(f"model, item {name!r}", str(error).partition(": ")[2]) from error
        return
    else:
        return
    raise InputError(
        f"model, item {name!r}",
        f"is {type(item).__name__}, of which it is not known how it acts: derive it from {known}",
    )


def _couplings(items: Sequence[Item]) -> list[Coupling]:
    """Force elements, those that items are composed of included."""
    out: list[Coupling] = []
    for item in items:
        if isinstance(item, FORCE_ELEMENTS):
            out += item.pieces()
    return out
