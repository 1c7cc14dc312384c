"""Models of a beam from the cheapest to the full one, and the item each of them is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from ..beam import Beam
from ..body import RigidBody
from ..errors import InputError
from ..frames import StructuralItem
from ..mesh import divided
from ..types import Floats

__all__ = ["RUNGS", "BeamFull", "BeamModel", "BeamRigid", "rigid_body"]

#: Elements and reference coordinates of places that need a node.
Keep = Sequence[tuple[int, float]]


class BeamModel(ABC):
    """One way to model a beam; its text is the name used in tables."""

    #: whether there is a mesh to choose
    meshed = True

    @abstractmethod
    def item(self, beam: Beam, elements: int, order: int, keep: Keep) -> StructuralItem:
        """What stands for the beam in a model."""

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self)

    def __hash__(self) -> int:
        return hash(type(self))


class BeamRigid(BeamModel):
    """A rigid body of the same mass and inertia, with the same mean velocities.

    Examples
    --------
    >>> str(BeamRigid())
    'rigid'
    """

    meshed = False

    def __str__(self) -> str:
        return "rigid"

    def item(self, beam: Beam, elements: int, order: int, keep: Keep) -> StructuralItem:
        """See the base class."""
        return rigid_body(beam)


class BeamFull(BeamModel):
    """Shear, extension, bending and torsion.

    Examples
    --------
    >>> str(BeamFull())
    'full'
    """

    def __str__(self) -> str:
        return "full"

    def item(self, beam: Beam, elements: int, order: int, keep: Keep) -> StructuralItem:
        """See the base class."""
        return beam.on_mesh(divided(beam.mesh, elements, keep), order)


#: Cheapest first.
RUNGS: tuple[BeamModel, ...] = (BeamRigid(), BeamFull())


def rigid_body(beam: Beam) -> RigidBody:
    """The beam as a rigid body, in its reference configuration.

    Parameters
    ----------
    beam : Beam

    Returns
    -------
    RigidBody
        Its reference point is the centre of mass, its triad the axes of space; linear and angular
        momentum are those of the beam's initial velocities.

    Raises
    ------
    InputError
        If it has no inertia about some axis and turns.

    Examples
    --------
    >>> from skfem_cosserat import MeshCurve, Section
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.5, inertia=(0.1, 0.1))
    >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4), section, velocity=(1.0, 0, 0))
    >>> body = rigid_body(beam)
    >>> body.mass, body.position.round(9).tolist(), body.velocity.round(9).tolist()
    (3.0, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    >>> body.euler.round(9).diagonal().tolist()   # m L^2/12, and the section's
    [0.2, 1.0, 0.2]
    """
    nodes = len(beam.basis.nodes)
    rows = 4 * beam.basis.connectivity[..., None] + np.arange(4)
    rows = rows.reshape(len(rows), -1)
    place = beam.reference.reshape(-1, 3)
    one = np.zeros(4 * nodes)
    one[::4] = 1.0
    turning = np.cross(beam.angular_velocity[:, None], beam.triads)
    rate = np.concatenate([beam.velocity[:, None], turning], axis=1).reshape(-1, 3)
    mass = beam.scalar_mass()

    def product(left: Floats, right: Floats) -> Floats:
        return np.einsum("eia,eij,ejb->ab", left[rows], mass, right[rows])

    ones = one[:, None]
    m = float(product(ones, ones)[0, 0])
    center = product(ones, place)[0] / m
    euler = product(place, place) - m * np.outer(center, center)
    velocity = product(ones, rate)[0] / m
    moment = product(place, rate)
    moment = moment - moment.T
    spin = np.array([moment[1, 2], moment[2, 0], moment[0, 1]]) - m * np.cross(center, velocity)
    inertia = np.trace(euler) * np.eye(3) - euler
    omega = np.zeros(3)
    if abs(spin).max() > 0:
        omega, _ = np.linalg.lstsq(inertia, spin, rcond=1e-12)[:2]
        if not np.allclose(inertia @ omega, spin, rtol=1e-9, atol=1e-12 * abs(spin).max()):
            raise InputError(beam.label, "turns about an axis about which it has no inertia")
    return RigidBody(
        m,
        euler=0.5 * (euler + euler.T),
        position=center,
        velocity=velocity,
        angular_velocity=omega,
    )
