"""Models of a beam from the simplest to the full one, and the item each of them is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from ..beam import Beam
from ..frames import StructuralItem
from ..mesh import divided
from ..rung import Rung, RungFull, RungInextensible, RungRigid, RungUnshearable

__all__ = ["RUNGS", "BeamFull", "BeamHeld", "BeamModel", "BeamRigid"]

#: Elements and reference coordinates of places that need a node.
Keep = Sequence[tuple[int, float]]


class BeamModel(ABC):
    """One way to model a beam; its text is the name used in tables."""

    #: whether there is a mesh to choose
    meshed = True

    #: numbers of the strains that are left out, see :class:`skfem_cosserat.Rung`
    held: tuple[int, ...] = ()

    @property
    def untwisted(self) -> bool:
        """Whether it bends but does not twist."""
        return 5 in self.held and not {3, 4} & set(self.held)

    @abstractmethod
    def item(self, beam: Beam, elements: int, order: int, keep: Keep) -> StructuralItem:
        """What stands for the beam in a model."""

    def simpler(self, beam: Beam) -> bool:
        """Whether it leaves out something that the beam has."""
        return True

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and str(other) == str(self)

    def __hash__(self) -> int:
        return hash(str(self))

    def __repr__(self) -> str:
        return f"<{self}>"


class BeamRigid(BeamModel):
    """A rigid body of the same mass and inertia.

    Examples
    --------
    >>> str(BeamRigid())
    'rigid'
    """

    meshed = False
    held = RungRigid().held

    def __str__(self) -> str:
        return "rigid"

    def item(self, beam: Beam, elements: int, order: int, keep: Keep) -> StructuralItem:
        """See the base class."""
        return beam.rigid_body()


class BeamHeld(BeamModel):
    """A beam some of whose strains are held.

    Parameters
    ----------
    rung : Rung

    Examples
    --------
    >>> str(BeamHeld(RungInextensible())), str(BeamHeld(RungFull(torsion=False)))
    ('inextensible', 'untwisted full')
    """

    def __init__(self, rung: Rung) -> None:
        self.rung = rung
        self.held = rung.held

    def __str__(self) -> str:
        if isinstance(self.rung, RungRigid):
            return "rigid beam"
        name = type(self.rung).__name__.removeprefix("Rung").lower()
        return name if self.rung.torsion else f"untwisted {name}"

    def item(self, beam: Beam, elements: int, order: int, keep: Keep) -> StructuralItem:
        """See the base class."""
        return beam.on_mesh(divided(beam.mesh, elements, keep), order, self.rung)

    def simpler(self, beam: Beam) -> bool:
        """See the base class: whether it holds more than the beam does as it is given."""
        return set(self.rung.held) > set(beam.rung.held)


class BeamFull(BeamModel):
    """The beam as it is given: shear, extension, bending and torsion, if it has them.

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


#: Those with the fewest motions first.
RUNGS: tuple[BeamModel, ...] = (
    BeamRigid(),
    BeamHeld(RungRigid()),
    BeamHeld(RungInextensible(torsion=False)),
    BeamHeld(RungInextensible()),
    BeamHeld(RungUnshearable(torsion=False)),
    BeamHeld(RungUnshearable()),
    BeamHeld(RungFull(torsion=False)),
    BeamFull(),
)
