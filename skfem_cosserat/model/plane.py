"""The plane in which a scene moves.

Nothing leaves the plane of a scene that equals its mirror image: an in-plane state has in-plane
forces only. So of every item it is asked whether its mirror image is itself (out_of_plane.py); with
the components ``nu`` of the plane's normal in a frame, what is material is reflected by
``S = 1 - 2 nu nu^T``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import InputError
from ..frames import TOLERANCE, Place, unit_vector
from ..frozen import Frozen
from ..relative import normals
from ..types import ArrayLike, Floats, IndexArray

__all__ = ["Planar", "Plane"]

#: components of a normal that count as zero
SNAP = 1e-12
#: of states against the plane, relative: they come from runs
OFF_PLANE = 1e-8


class Planar(Frozen):
    """Asks for a scene in which everything moves in one plane.

    For :meth:`Model.freeze`. Unknowns out of the plane are not there at all: two displacements and
    one rotation for each frame, and only the constraints that act in the plane. All results are
    those of the scene in space, to rounding; histories hold all coordinates. What is out of the
    plane cannot be found, however: no modes, no bifurcations there. Compiled kernels step it with
    the null space method, three unknowns a frame; where they do not (multipliers, loads that follow
    the motion, force elements, damping, prescribed motion), plain ones do. There are no explicit
    schemes for it.

    Scenes that are their own mirror image by pairs of items, on either side of a plane, are not
    meant here, where each item is its own image: they are halved by leaving one half out. What the
    mirror plane cuts is held by ``JointPlanar(ground(x), node, normal)``, with its normal: the node
    stays in the plane and turns about the normal only, and the joint's force and moment are what
    the other half passes on. Loads, masses and springs on the plane count half. Motions that are
    not symmetric, modes and bifurcations among them, cannot be found then.

    Parameters
    ----------
    normal : (3,) array, optional
        Unit vector normal to the plane; default: found from geometry, sections, loads, joints
        and velocities.

    Examples
    --------
    A pendulum has one coordinate in space, too; its bob on a rod alone has two:

    >>> from skfem_cosserat import JointDistance, LoadGravity, MassPoint, Model, Planar, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(1.0, position=(1.0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> weight = model.add("weight", LoadGravity((0, 0, -9.81)))
    >>> model.freeze().unknowns, model.freeze(planar=Planar()).unknowns
    (2, 1)
    """

    def __init__(self, normal: ArrayLike | None = None) -> None:
        self.normal = None if normal is None else unit_vector("planar scene", "normal", normal)

    def __repr__(self) -> str:
        return f"Planar({'' if self.normal is None else f'normal={self.normal.tolist()}'})"


@dataclass(frozen=True, eq=False, repr=False)
class Plane:
    """A plane in space.

    Attributes
    ----------
    normal : (3,) array
        Unit vector, of the two the one whose largest component is positive.
    point : (3,) array
        In the plane (m).
    length : float
        Extent of the scene (m), which distances from the plane are compared with.

    Examples
    --------
    >>> plane = Plane(np.array([0, 0, -1.0]), np.array([0, 0, 2.0]))
    >>> plane.normal.tolist(), plane.axes.tolist(), float(plane.height(np.array([5.0, 1, 2.5])))
    ([0.0, 0.0, 1.0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 0.5)
    """

    normal: Floats
    point: Floats
    length: float = 1.0

    def __post_init__(self) -> None:
        n = np.where(abs(self.normal) < SNAP, 0.0, self.normal) / np.linalg.norm(self.normal)
        n = n * np.sign(n[np.argmax(abs(n))])
        object.__setattr__(self, "normal", n + 0.0)

    def __repr__(self) -> str:
        return f"<plane normal to {self.normal.tolist()}>"

    @cached_property
    def axes(self) -> Floats:
        """Two unit vectors (2, 3) along the plane, with ``axes[0] x axes[1] = normal``."""
        k = np.flatnonzero(self.normal)
        if len(k) == 1:  # axes of space, in which each coordinate is in the plane or out of it
            return np.eye(3)[[(k[0] + 1) % 3, (k[0] + 2) % 3]]
        return normals(self.normal)

    def height(self, x: Floats) -> Floats:
        """Distance (...) of points (..., 3) from the plane (m)."""
        return np.asarray((x - self.point) @ self.normal)

    def moving(self, y0: Floats, origins: IndexArray) -> IndexArray:
        """Numbers of the rows of y that change: not of directors along the normal.

        Parameters
        ----------
        y0 : (rows, 3) array
            Reference configuration.
        origins : int array
            Rows that are positions.
        """
        moves = np.linalg.norm(y0 @ self.axes.T, axis=1) > TOLERANCE
        moves[origins] = True
        return np.flatnonzero(moves)

    def mirror(self, triad: Floats) -> Floats:
        """``S`` (..., 3, 3) of frames with these rows d1, d2, d3 (..., 3, 3)."""
        nu = triad @ self.normal
        return np.asarray(np.eye(3) - 2 * nu[..., :, None] * nu[..., None, :])

    def off_plane(self, place: Place, t: float) -> float:
        """How far a ground place in prescribed motion has left the plane: by the extent, or rad."""
        if place.motion is None:
            return 0.0
        frame = place.motion.frame(place, t)
        rise = abs(float((frame[0] - place.position) @ self.normal)) / self.length
        return max(rise, float(abs(frame[1:] @ self.normal - self.normal).max()))

    def check_ground(self, place: Place, t: float) -> None:
        """Raise InputError if a ground place in prescribed motion is out of the plane."""
        off = self.off_plane(place, t)
        if off > OFF_PLANE:
            raise InputError(
                place.label,
                f"its prescribed motion leaves the plane normal to {self.normal.tolist()} that the"
                f" scene is confined to, by {off:.6g} (of the extent, or rad) at t = {t:g} s",
            )

    def check(self, item: str, what: str, numbers: Floats, start: Floats | None = None) -> None:
        """A configuration (n,) is off the plane where the reference `start` is, rates are nowhere.

        Parameters
        ----------
        item, what : str
            Named by the error.
        numbers : (n,) array
            Configuration, velocity or momentum.
        start : (n,) array, optional
            Reference configuration; default: `numbers` are no configuration.

        Raises
        ------
        InputError
            If it leaves the plane.
        """
        rows = numbers.reshape(-1, 3)
        rise = (rows if start is None else rows - start.reshape(-1, 3)) @ self.normal
        worst = int(np.argmax(abs(rise)))
        size = float(abs(rows).max()) if start is None else max(1.0, self.length)
        if abs(rise[worst]) > OFF_PLANE * size:
            raise InputError(
                item,
                f"{what} leaves the plane normal to {self.normal.tolist()} that the scene is"
                f" confined to, by {float(rise[worst]):.6g} in numbers {3 * worst} to"
                f" {3 * worst + 2}: {rows[worst].tolist()}",
            )

    def check_momentum(self, item: str, p: Floats, start: Floats, triads: IndexArray) -> None:
        """Raise InputError if a momentum (n,) that steps carry on leaves the plane.

        Momenta that would stretch the directors along the normal do not: the mirror image of such a
        state is itself. The variational scheme carries on the half step of a force that constraints
        then hold, and rotation vectors have such forces, as their cosines see all three directors.

        Parameters
        ----------
        start : (n,) array
            Reference configuration.
        triads : (k, 3) int array
            Rows of y that are directors of one frame each.
        """
        rows = p.reshape(-1, 3).copy()
        nu = start.reshape(-1, 3)[triads] @ self.normal
        stretch = (nu * (rows[triads] @ self.normal)).sum(axis=1)
        rows[triads] -= (stretch[:, None] * nu)[..., None] * self.normal
        self.check(item, "its momentum", rows)

    def check_spin(self, velocity: Floats) -> None:
        """Raise InputError if the axis of a turning frame is not the normal."""
        across = float(np.linalg.norm(np.cross(velocity, self.normal)))
        if across > TOLERANCE * float(np.linalg.norm(velocity)):
            raise InputError(
                "spin",
                f"velocity = {velocity.tolist()} is off the normal {self.normal.tolist()} of the"
                f" plane that the scene is confined to, by {across:.6g} rad/s",
            )
