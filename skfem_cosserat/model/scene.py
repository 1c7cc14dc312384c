"""The scene: items with names, collected first and numbered when frozen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TypeVar, cast

from ..body import RigidBody
from ..coupling import Coupling
from ..damping import RayleighDamping
from ..drive import JointDrive
from ..errors import InputError
from ..foundation import Foundation
from ..frames import Item, StructuralItem
from ..joint import Joint
from ..kinds import is_beam
from ..load import Load
from ..twin import Twins
from ..types import ArrayLike
from .inertia import Structure
from .planarity import Planarity, confined, inspect
from .plane import Planar
from .system import System

__all__ = ["Model", "planarity"]

ItemT = TypeVar("ItemT", bound=Item)


class Model:
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
            StructuralItem | Joint | JointDrive | Load | Coupling | Foundation | RayleighDamping,
        ):
            raise InputError(
                f"model, item {name!r}",
                f"is {type(item).__name__}, expected a beam, body, mass point, joint, drive,"
                " load, force element, foundation or damping",
            )
        if item.name is not None:
            raise InputError(f"model, item {name!r}", f"is already in a model as {item.name!r}")
        item.name = name
        self._items[name] = item
        return item

    def __getitem__(self, name: str) -> Item:
        if name not in self._items:
            raise InputError("model", f"unknown name {name!r}; known: {sorted(self._items)}")
        return self._items[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def with_items(self, items: Mapping[str, StructuralItem]) -> Model:
        """The same scene with other beams (or bodies) of some names; this one does not change.

        Everything that refers to them (joints, loads, lumps, springs, dampings, foundations) is
        there again and refers to the new ones, at the same material points.

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

    def rebuilt(self, items: Mapping[str, StructuralItem]) -> tuple[Model, Twins]:
        """As :meth:`with_items`, with what finds the twins of sensors and the like."""
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
        twins = Twins({self[name]: item for name, item in items.items()})
        other = type(self)()
        for name in self:
            other.add(name, twins.of(self[name]))
        return other, twins

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
                    raise InputError(
                        item.label,
                        f"refers to {other.label}, which is not in the model: add it first",
                    )
        drives = [i for i in items if isinstance(i, JointDrive)]
        for drive in drives:
            if not any(drive.joint is item for item in items):
                raise InputError(
                    drive.label,
                    f"refers to the {drive.joint.label}, which is not in the model: add it first",
                )
        system = System(
            structures,
            [i for i in items if isinstance(i, Joint)],
            [i for i in items if isinstance(i, Load)],
            drives,
            _couplings(items),
            [i for i in items if isinstance(i, RayleighDamping)],
        )
        return system if planar is None else confined(system, planar)


def planarity(scene: Model | System, normal: ArrayLike | None = None) -> Planarity:
    """Whether a scene stays in a plane, which one, and if not what leaves it, by how much.

    Geometry, inertia, sections, joints, loads, force elements and initial velocities are looked
    at; functions of time at a few first instants only (a run that leaves the plane later stops).

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
    >>> planarity(model).leaving
    ("load 'side': [0.0, 3.0, 4.0] leaves the plane by 4",)
    """
    system = scene.freeze() if isinstance(scene, Model) else scene
    if not isinstance(system, System):
        raise InputError("argument scene", f"{scene!r}, expected a Model or a System")
    wanted = Planar(normal).normal
    return inspect(system.spatial, wanted)


def _couplings(items: Sequence[Item]) -> list[Coupling]:
    """Force elements, those of foundations included."""
    out: list[Coupling] = []
    for item in items:
        if isinstance(item, Coupling):
            out.append(item)
        elif isinstance(item, Foundation):
            out += item.supports()
    return out
