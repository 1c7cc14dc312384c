"""Whether a scene stays in a plane, which one, and what leaves it by how much."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..frames import TOLERANCE
from ..load import LoadMoment
from ..types import Floats
from .leaving import leaving, places, turned
from .plane import Planar, Plane

if TYPE_CHECKING:
    from .system import System

__all__ = ["Planarity", "confined", "inspect"]


#: cosine above which an axis of space may be what is meant by a normal
NEARLY = 0.99


@dataclass(frozen=True, eq=False)
class Planarity:
    """Whether a scene stays in a plane; true if it does.

    Attributes
    ----------
    plane : Plane
        The one that comes nearest.
    leaving : tuple of str
        What leaves it, and by how much; empty if nothing does.
    """

    plane: Plane
    leaving: tuple[str, ...] = field(default=())

    def __bool__(self) -> bool:
        return not self.leaving

    @property
    def planar(self) -> Planar | None:
        """For :meth:`Model.freeze`; None if the scene is not planar."""
        return Planar(self.plane.normal) if self else None

    def __repr__(self) -> str:
        normal = self.plane.normal.round(9).tolist()
        if self:
            return f"<planar, normal {normal}>"
        return f"<not planar; out of the plane normal to {normal}: {'; '.join(self.leaving)}>"


def inspect(system: System, normal: Floats | None = None) -> Planarity:
    """Look for the plane of a scene, or at that with a given normal; see :func:`planarity`."""
    normals = _candidates(system) if normal is None else [normal]
    best: Planarity | None = None
    for n in normals:
        plane = Plane(n, system.q0.reshape(-1, 3)[system.origin_rows].mean(axis=0), system.length)
        found = Planarity(plane, tuple(f"{item}: {text}" for item, text in leaving(system, plane)))
        if found:
            return found
        if best is None or len(found.leaving) < len(best.leaving):
            best = found
    assert best is not None
    return best


def confined(system: System, planar: Planar) -> System:
    """The scene confined to its plane.

    Raises
    ------
    InputError
        Naming what leaves the plane, and by how much.
    """
    if not isinstance(planar, Planar):
        raise InputError("argument planar", f"{planar!r}, expected Planar()")
    found = inspect(system.spatial, planar.normal)
    if not found:
        more = len(found.leaving) - 1
        raise InputError(
            "planar scene",
            f"{found.leaving[0]}; the plane is normal to {found.plane.normal.round(9).tolist()}"
            + (f" ({more} more: see planarity(model))" if more else ""),
        )
    return system.spatial.within(found.plane)


# -- which plane -----------------------------------------------------------------------------------


def _candidates(system: System) -> list[Floats]:
    """Normals: of the points, if they span a plane; else of all that points or turns somewhere."""
    x = np.array([place.position for _, place in places(system)])
    _, sizes, V = np.linalg.svd((x - x.mean(axis=0)) / system.length, full_matrices=False)
    sizes = np.append(sizes, np.zeros(3))[:3] / np.sqrt(len(x))
    if sizes[1] > 1e-6:
        axis = np.eye(3)[np.argmax(abs(V[2]))]
        return [V[2], axis] if abs(axis @ V[2]) > NEARLY else [V[2]]
    line = V[:1] if sizes[0] > 1e-6 else np.zeros((0, 3))
    along, about = [*np.zeros((0, 3))], [*np.eye(3)]
    for item in system.structures:
        vertices = item.vertices()
        if vertices is None:
            continue
        along.append(vertices.velocities[0])
        about.append(vertices.angular_velocities[0])
        if vertices.triads is not None:
            about = [*vertices.triads[0], *about]
    for load in system.loads:
        if len(load.channels) == 1:
            vectors = turned(load, load.channels[0][0])
            (about if isinstance(load, LoadMoment) else along).extend(vectors)
    for joint in system.joints:
        free = joint.freedom()
        about += [turn.axis for turn in free.turns or ()]
        along += [np.cross(s.left, s.right) for s in free.slides]
    ways = [*line, *along]
    normals = [*about, *(np.cross(a, b) for a, b in product(line, along))]
    normals += [np.cross(a, b) for a, b in product(ways, repeat=2)] if len(ways) < 8 else []
    out: list[Floats] = []
    for n in normals:
        size = float(np.linalg.norm(n))
        if size <= TOLERANCE or (len(line) and abs(line @ n).max() > 1e-6 * size):
            continue
        n = n / size
        if not any(abs(n @ other) > 1 - 1e-12 for other in out):
            out.append(n)
    return out or [np.array([0.0, 0, 1])]
