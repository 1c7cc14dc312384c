"""Proposals: beam theories, meshes, steps and methods to run a scene with."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..beam import Beam
from ..constraints import Treatment
from ..frames import StructuralItem
from ..frozen import Replacements
from ..integrators import Integrator
from ..mesh import divided
from ..model import Model, System, model_of
from ..model.plane import Planar
from ..theory import Theory, TheoryInextensible, TheoryKirchhoff, TheoryReissner, TheoryRigid

# -- models of a beam from the simplest to the full one, and the item each of them is --------------

#: Elements and reference coordinates of places that need a node.
Keep = Sequence[tuple[int, float]]


class BeamModel(ABC):
    """One way to model a beam; its text is the name used in tables."""

    #: whether there is a mesh to choose
    meshed = True

    #: numbers of the strains that are left out, see :class:`skfem_cosserat.Theory`
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
    held = TheoryRigid().held

    def __str__(self) -> str:
        return "rigid"

    def item(self, beam: Beam, elements: int, order: int, keep: Keep) -> StructuralItem:
        """See the base class."""
        return beam.rigid_body()


class BeamHeld(BeamModel):
    """A beam some of whose strains are held.

    Parameters
    ----------
    theory : Theory

    Examples
    --------
    >>> str(BeamHeld(TheoryInextensible())), str(BeamHeld(TheoryReissner(torsion=False)))
    ('inextensible', 'untwisted reissner')
    """

    def __init__(self, theory: Theory) -> None:
        self.theory = theory
        self.held = theory.held

    def __str__(self) -> str:
        if isinstance(self.theory, TheoryRigid):
            return "rigid beam"
        name = type(self.theory).__name__.removeprefix("Theory").lower()
        return name if self.theory.torsion else f"untwisted {name}"

    def item(self, beam: Beam, elements: int, order: int, keep: Keep) -> StructuralItem:
        """See the base class."""
        return beam.on_mesh(divided(beam.mesh, elements, keep), order, self.theory)

    def simpler(self, beam: Beam) -> bool:
        """See the base class: whether it holds more than the beam does as it is given."""
        return set(self.theory.held) > set(beam.theory.held)


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
THEORIES: tuple[BeamModel, ...] = (
    BeamRigid(),
    BeamHeld(TheoryRigid()),
    BeamHeld(TheoryInextensible(torsion=False)),
    BeamHeld(TheoryInextensible()),
    BeamHeld(TheoryKirchhoff(torsion=False)),
    BeamHeld(TheoryKirchhoff()),
    BeamHeld(TheoryReissner(torsion=False)),
    BeamFull(),
)


# -- A proposal: which model of each beam, which mesh, which integrator, treatment and step --------


@dataclass(frozen=True)
class Proposal:
    """A model of a scene, and how it is integrated in time.

    Attributes
    ----------
    theory : dict of str to BeamModel
        By beam; ``str(theory["rod"])`` is its name.
    order : int
        Of the elements of all beams.
    elements : dict of str to int
        By beam (none for rigid ones).
    integrator : Integrator
    treatment : Treatment
    steps : int
        Number of steps of the whole event.
    step : float
        (s)
    keep : dict of str to sequence of (int, float)
        By beam: places of its mesh that need a node, as something is attached there.
    planar : Planar or None
        The plane that the scene is confined to, if it stays there anyway.
    """

    theory: Mapping[str, BeamModel]
    order: int
    elements: Mapping[str, int]
    integrator: Integrator
    treatment: Treatment
    steps: int
    step: float
    keep: Mapping[str, Sequence[tuple[int, float]]] = field(repr=False)
    planar: Planar | None = None

    @property
    def scene(self) -> Hashable:
        """Equal for proposals of the same scene, however it is integrated."""
        meshes = tuple((name, self.count(name)) for name in self.theory)
        theories = tuple((name, str(theory)) for name, theory in self.theory.items())
        order = self.order if any(theory.meshed for theory in self.theory.values()) else 0
        return (theories, meshes, order, self.planar is None)

    @property
    def method(self) -> Hashable:
        """Equal for equal integrators and treatments."""
        return repr(self.integrator), repr(self.treatment)

    @property
    def kind(self) -> Hashable:
        """Equal for proposals that are stepped by the same code, whatever their meshes."""
        order = self.order if any(theory.meshed for theory in self.theory.values()) else 0
        return frozenset(str(theory) for theory in self.theory.values()), order, self.method

    @property
    def key(self) -> Hashable:
        """Equal for equal proposals."""
        return self.scene, self.method, self.steps

    def count(self, beam: str) -> int:
        """Elements of a beam; zero if it is rigid."""
        return self.elements[beam] if self.theory[beam].meshed else 0

    @property
    def nodes(self) -> int:
        """Nodes of all beams, one for a rigid one, branches not counted."""
        return sum(self.order * self.count(name) + 1 for name in self.theory)

    def build(self, model: Model | System) -> Model:
        """The scene with these beams; `model` does not change.

        Parameters
        ----------
        model : Model or System
            The one that was advised on.

        Raises
        ------
        InputError, MeshError
            If a beam cannot be had so.
        """
        return self.rebuilt(model)[0]

    def system(self, model: Model | System) -> System:
        """The scene with these beams, frozen: in its plane, if there is one."""
        return self.build(model).freeze(planar=self.planar)

    def rebuilt(self, model: Model | System) -> tuple[Model, Replacements]:
        """As :meth:`build`, with what finds the copies of sensors."""
        scene = model_of(model)
        items: dict[str, Any] = {}
        for name, theory in self.theory.items():
            beam = scene[name]
            assert isinstance(beam, Beam)
            keep = self.keep.get(name, ())
            items[name] = theory.item(beam, self.elements[name], self.order, keep)
        return scene.rebuilt(items)

    def __str__(self) -> str:
        """In one line."""
        beams = [
            f"{name}: {theory}" + (f", {self.elements[name]} elements" if theory.meshed else "")
            for name, theory in self.theory.items()
        ]
        text = "; ".join(beams)
        if any(theory.meshed for theory in self.theory.values()):
            text += f"; order {self.order}"
        text += "" if self.planar is None else "; in the plane"
        return (
            f"{text}; {self.integrator.name}, {self.treatment.name}, {self.steps} steps of"
            f" {self.step:.3g} s"
        ).lstrip("; ")
