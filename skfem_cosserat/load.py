"""Loads, and the terms that they are made of."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from .along import Along
from .errors import InputError
from .frames import Item, Place, StructuralItem, check_beam, no_place, vector
from .frozen import Attached, Replacements
from .kernels import beam_geometric, cross, product
from .time_function import (
    Amplitude,
    Component,
    Constant,
    FunctionOfTime,
    TimeFunction,
    time_function,
)
from .types import ArrayLike, Floats, IndexArray, shaped, switch

if TYPE_CHECKING:
    from .beam import Beam

# -- terms: what loads are made of, as data --------------------------------------------------------


class Term(Attached):
    """Base of the terms of loads: a vector that acts somewhere, times a function of time.

    Attributes
    ----------
    value : (3,) array
        Components for a factor of one.
    time : TimeFunction
        The factor.
    follower : bool
        Components are taken in the moving triad instead of in space.
    axial : bool
        Whether the vector is that of a moment.
    """

    kind = "term of a load"
    axial = False
    follower = False
    value: Floats
    time: TimeFunction

    def _set(self, value: ArrayLike, amplitude: Amplitude, follower: bool = False) -> None:
        self.value = vector(self.kind, "value", value)
        self.time = time_function(self.kind, amplitude)
        self.follower = switch(self.kind, follower, "follower")

    def items(self) -> Sequence[StructuralItem]:
        """The items it acts on."""
        return [place.item for place in self.places() if place.item is not None]

    def places(self) -> Sequence[Place]:
        """The points it acts at, if it has any."""
        return ()

    @property
    def site(self) -> tuple[object, ...]:
        """Tells what it acts on from what others act on; empty: everything that has mass."""
        return ()

    @property
    def frame(self) -> Place | None:
        """Place of a single frame whose directors it depends on."""
        return None

    def vectors(self, value: Floats) -> Floats:
        """A value (3,) in space in the reference, (k, 3): for each triad that it follows."""
        return value[None]

    def acceleration(self) -> Floats:
        """Acceleration (3,) that it gives to everything that has mass (m/s^2)."""
        return np.zeros(3)

    def on_elements(self, beam: Beam, mass: Floats, nodal: Floats, factor: float) -> Floats | float:
        """Consistent nodal forces (ne, p + 1, 4, 3) on the elements of a beam, of what it spreads.

        Parameters
        ----------
        beam : Beam
        mass : (ne, n, n) array
            Mass matrices of its elements.
        nodal : (ne, p + 1, 4, 3) array
            Configuration.
        factor : float
            What the value is multiplied by.
        """
        return 0.0


def _checked_place(item: str, place: Place, framed: bool) -> Place:
    """The place, if a force or moment can act there; `framed`: its triad is needed."""
    if not isinstance(place, Place):
        raise InputError(item, f"acts on {no_place(place)}")
    if place.item is None:
        raise InputError(item, f"acts on {place.label}, expected the place of an item")
    if place.triad is None and framed:
        raise InputError(item, f"{place.label} is a mass point and has no directions")
    return place


class TermForce(Term):
    """Force (N) at a place, dead (fixed in space) or following the triad.

    Parameters
    ----------
    place : Place
        Of a beam node, body or mass point.
    value : (3,) array
        In space, or in the triad of the place if `follower` (N).
    amplitude : float, TimeFunction or callable, optional
        Factor in time.
    follower : bool

    Raises
    ------
    InputError
        If it acts on the ground, follows a mass point, or numbers are not finite.

    Examples
    --------
    >>> from skfem_cosserat import RigidBody
    >>> nozzle = RigidBody.box(1.0, (1, 1, 1)).local((0, 0, -0.5))
    >>> TermForce(nozzle, (0, 0, 5.0), follower=True).vectors(np.array([0, 0, 5.0])).tolist()
    [[0.0, 0.0, 5.0]]
    """

    def __init__(
        self,
        place: Place,
        value: ArrayLike,
        amplitude: Amplitude = None,
        follower: bool = False,
    ):
        self._set(value, amplitude, follower)
        self.place = _checked_place(self.kind, place, self.axial or self.follower)

    @property
    def site(self) -> tuple[object, ...]:
        """Identity of its place, which tells it from loads at other places."""
        return (id(self.place),)

    def places(self) -> Sequence[Place]:
        """Its place."""
        return (self.place,)

    @property
    def frame(self) -> Place | None:
        """Its place, if it follows the triad."""
        return self.place if self.follower else None

    def vectors(self, value: Floats) -> Floats:
        """Value in space in the reference (1, 3), by the triad of the place if it follows that."""
        triad = self.place.triad if self.follower else None
        return (value if triad is None else value @ triad)[None]

    def with_replacements(self, replacements: Replacements) -> Self:
        """Copy at another place; a value that follows a triad is turned into the new triad."""
        other = super().with_replacements(replacements)
        turn = self.place.turn_to(other.place) if self.follower else None
        if turn is not None:
            other.value = turn @ self.value
        return other


class TermMoment(TermForce):
    """Moment (N m) at a place, about axes fixed in space or following the triad.

    Parameters
    ----------
    place : Place
        Of a beam node or body.
    value : (3,) array
        In space, or in the triad of the place if `follower` (N m).
    amplitude, follower
        See :class:`TermForce`.

    Raises
    ------
    InputError
        If it acts on the ground or a mass point, or numbers are not finite.

    Examples
    --------
    >>> from skfem_cosserat import RigidBody
    >>> wheel = RigidBody.cylinder(2.0, radius=1.0, length=0.1)
    >>> TermMoment(wheel.local((0, 0, 0)), (0, 0, 3.0), amplitude=2.0).time.value(0.0)
    2.0
    """

    axial = True

    @property
    def frame(self) -> Place | None:
        """Its place: even a dead moment acts through the directors."""
        return self.place


class TermLine(Term):
    """Force per reference length (N/m) along a beam, dead or following the section triad.

    Parameters
    ----------
    beam : Beam
    value : (3,) array
        In space, or in the section triad if `follower` (N/m).
    amplitude, follower
        See :class:`TermForce`.
    elements : int array, optional
        Numbers of the elements, as of ``beam.part(name)``; default: all.

    Raises
    ------
    InputError
        If `beam` is no beam or numbers are not finite.

    Examples
    --------
    >>> from skfem_cosserat import Beam, MeshCurve, Section
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4, name="boom"), section)
    >>> TermLine(beam, (3.0, 0, 0)).elements.tolist()
    [0, 1, 2, 3]
    """

    def __init__(
        self,
        beam: Beam,
        value: ArrayLike,
        amplitude: Amplitude = None,
        follower: bool = False,
        elements: IndexArray | None = None,
    ):
        check_beam(self.kind, beam)
        self.beam = beam
        every = beam.part(None)
        self.elements = every if elements is None else np.asarray(elements)
        given = self.elements
        if (
            (given.ndim, given.size > 0, given.dtype.kind in "iu") != (1, True, True)
            or not np.isin(given, every).all()
            or len(np.unique(given)) < given.size
        ):
            text = f"elements = {elements!r}, expected numbers from 0 to {every[-1]}, each once"
            raise InputError(self.kind, text)
        self.value = shaped(self.kind, "value", value, (3,), self._shape(beam))
        self.time = time_function(self.kind, amplitude)
        self.follower = switch(self.kind, follower, "follower")

    def _shape(self, beam: Beam) -> tuple[int, int, int]:
        """That of a value at Gauss points."""
        return len(self.elements), len(beam.basis.interpolation.full.points), 3

    @property
    def site(self) -> tuple[object, ...]:
        """Identity of its beam and elements, which tells it from loads elsewhere."""
        return id(self.beam), self.elements.tobytes()

    def forces(self) -> Floats:
        """Nodal forces (ne, p + 1, 3) of a load that is fixed in space (N)."""
        return self.beam.basis.interpolation.full.values @ self._weighted()

    def matrices(self) -> Floats:
        """Scalars C (ne, 4 nn, 4 nn) of the nodal forces ``C y`` of a load that follows."""
        values = self.beam.basis.interpolation.full.values
        turned = self.beam.rotations
        shares = np.einsum("aq,bq,eqi->eabi", values, values, self._weighted())
        ne, nn = shares.shape[:2]
        out = np.zeros((ne, nn, 4, nn, 4))
        out[:, :, 0, :, 1:] = np.einsum("eabi,ebij->eabj", shares, turned[self.elements])
        return out.reshape(ne, 4 * nn, 4 * nn)

    def _weighted(self) -> Floats:
        """Values (ne, p + 1, 3) at Gauss points, times their weights (N)."""
        measure = self.beam.basis.interpolation.full.weights[:, None]
        return self.beam.basis.lengths[self.elements, None, None] * measure * self.value

    def items(self) -> Sequence[StructuralItem]:
        """The beam."""
        return (self.beam,)

    def with_replacements(self, replacements: Replacements) -> Self:
        """Copy on another beam: all elements stay all, some need the same number of elements."""
        other = super().with_replacements(replacements)
        check_beam(self.kind, other.beam)
        count = self.beam.mesh.nelements, other.beam.mesh.nelements
        if len(self.elements) == count[0] and self.value.ndim == 1:
            other.elements = other.beam.part(None)
        elif len(set(count)) > 1 or self.value.shape not in ((3,), self._shape(other.beam)):
            text = f"acts on some elements of {self.beam.label}, which are others on another mesh"
            raise InputError(self.kind, f"{text}: take them in terms(), from beam.part(name)")
        return other

    def vectors(self, value: Floats) -> Floats:
        """Values in space (k, 3); if it follows the sections, for each node of elements."""
        if not self.follower:
            return value.reshape(-1, 3)
        beam = self.beam
        triads = beam.rotations[self.elements] @ beam.triads[beam.basis.connectivity[self.elements]]
        return (value[..., None, None, :] @ triads[:, None]).reshape(-1, 3)

    def on_elements(self, beam: Beam, mass: Floats, nodal: Floats, factor: float) -> Floats | float:
        """Nodal forces (ne, p + 1, 4, 3) of the line load on a beam; zero on other beams."""
        if self.beam is not beam:
            return 0.0
        out = np.zeros_like(nodal)
        e = self.elements
        if self.follower:
            own = nodal[e]
            out[e] = factor * (self.matrices() @ own.reshape(len(e), -1, 3)).reshape(own.shape)
        else:
            out[e, :, 0] = factor * self.forces()
        return out


class TermStrain(TermLine):
    """Strain without stress along a beam: its sections are as if they had been made with it.

    Parameters
    ----------
    beam : Beam
    value : (3,) array
        Strains Gamma (-), or K (1/m) if `axial`.
    amplitude, elements
        See :class:`TermLine`.
    axial : bool

    Raises
    ------
    InputError
        See :class:`TermLine`; if the stored energy of a section is not quadratic, or the theory of
        the beam holds the strain.

    Examples
    --------
    >>> from skfem_cosserat import Beam, MeshCurve, Section
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4, name="boom"), section)
    >>> TermStrain(beam, (0, 0, 0.5), axial=True).strains()[0, 0].tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.5]
    """

    def __init__(
        self,
        beam: Beam,
        value: ArrayLike,
        amplitude: Amplitude = None,
        elements: IndexArray | None = None,
        axial: bool = False,
    ):
        super().__init__(beam, value, amplitude, True, elements)
        self.axial = axial
        if self.strains()[..., list(beam.theory.held)].any():
            text = f"changes a strain that {beam.label} does not have: theory = {beam.theory!r}"
            raise InputError(self.kind, text)
        if any(np.isin(self.elements, points[0]).any() for points, _ in beam.elements.stored):
            text = f"the stored energy of {beam.label} is not quadratic, strains without stress"
            raise InputError(self.kind, f"{text} are constant there: Beam(..., strain=...)")

    def _shape(self, beam: Beam) -> tuple[int, int, int]:
        """That of a value at Gauss points of strains."""
        return len(self.elements), len(beam.elements.points), 3

    @property
    def site(self) -> tuple[object, ...]:
        """Identity of what it acts on, see :class:`TermLine`, and which strains it has."""
        return (*super().site, self.axial)

    def strains(self) -> Floats:
        """Strains (k, ng, 6) at Gauss points of the elements."""
        out = np.zeros((*self._shape(self.beam)[:2], 6))
        out[..., 3 * self.axial : 3 * self.axial + 3] = self.value
        return out

    def matrices(self) -> Floats:
        """Scalars (ne, 4 nn, 4 nn): nodal forces of the stress that the strain would need."""
        own = self.beam.elements.taken(self.elements)
        return beam_geometric(own, product(self.strains(), own.stiffness))

    def on_elements(self, beam: Beam, mass: Floats, nodal: Floats, factor: float) -> Floats | float:
        """Zero: it is no force, it belongs to the stress."""
        return 0.0


class TermAcceleration(Term):
    """Acceleration (m/s^2) of everything that has mass, as by gravity.

    Parameters
    ----------
    value : (3,) array
        In space (m/s^2).
    amplitude
        See :class:`TermForce`.

    Raises
    ------
    InputError
        If numbers are not finite.

    Examples
    --------
    >>> TermAcceleration((0, 0, -9.81), amplitude=0.5).acceleration().tolist()
    [0.0, 0.0, -9.81]
    """

    def __init__(self, value: ArrayLike, amplitude: Amplitude = None):
        self._set(value, amplitude)

    def acceleration(self) -> Floats:
        """Acceleration (3,) of everything that has mass (m/s^2)."""
        return self.value

    def on_elements(self, beam: Beam, mass: Floats, nodal: Floats, factor: float) -> Floats | float:
        """Nodal forces (ne, p + 1, 4, 3) of the acceleration on a beam, by its mass matrices."""
        field = np.zeros_like(nodal)
        field[:, :, 0] = factor * self.value
        return (mass @ field.reshape(len(field), -1, 1)).reshape(field.shape)


# -- loads -----------------------------------------------------------------------------------------


class Load(Item):
    """Base of the loads. An own one gives its terms as data, by the method :meth:`terms`.

    Where a load acts, whether it leaves a plane, its work, its part in resultants and the kernels
    that step it all follow from its terms: :class:`TermForce`, :class:`TermMoment`,
    :class:`TermLine`, :class:`TermAcceleration`. Each load is asked once for its terms. Forces
    that depend on the motion are no loads: see :class:`Force`.

    Parameters
    ----------
    value : (3,) array or callable, optional
        Constant components, or ``t -> (3,)``; default: the load has no such value.
    amplitude : float, TimeFunction or callable, optional
        Factor in time; not with a callable `value`.
    follower : bool
        Components are taken in the moving triad instead of in space.

    Attributes
    ----------
    channels : tuple of ((3,) array, TimeFunction)
        The value as a sum of vectors and their factors: one, or three of a callable `value`.
    time : TimeFunction
        The amplitude.

    Examples
    --------
    A rotor pushes along the third director of a body, and turns it back:

    >>> from skfem_cosserat import EnergyMomentum, Model, NullSpace, RigidBody, simulate
    >>> class LoadRotor(Load):
    ...     def __init__(self, place, thrust, torque, amplitude=None):
    ...         super().__init__(amplitude=amplitude)
    ...         self.place, self.thrust, self.torque = place, thrust, torque
    ...
    ...     def terms(self):
    ...         push, turn = (0, 0, self.thrust), (0, 0, -self.torque)
    ...         return [
    ...             TermForce(self.place, push, self.time, follower=True),
    ...             TermMoment(self.place, turn, self.time, follower=True),
    ...         ]
    >>> model = Model()
    >>> drone = model.add("drone", RigidBody.cylinder(2.0, radius=1.0, length=0.1))
    >>> rotor = model.add("rotor", LoadRotor(drone.local((0, 0, 0)), 4.0, 0.5))
    >>> history = simulate(model.freeze(), EnergyMomentum(), NullSpace(), 0.1, until=1.0)
    >>> round(float(history.position(rotor.place)[-1, 2]), 9)   # thrust t^2/(2 m)
    1.0
    >>> round(float(history["angular_momentum"][-1, 2]), 9)
    -0.5
    """

    kind = "load"
    follower: bool = False
    channels: tuple[tuple[Floats, TimeFunction], ...] = ()
    time: TimeFunction = Constant(1.0)

    def __init__(self, value: Any = (), amplitude: Amplitude = None, follower: bool = False):
        self.follower = switch(self.label, follower, "follower")
        if callable(value):
            if amplitude is not None:
                raise InputError(self.label, "give value as a function of time or an amplitude")
            vector(self.label, "value(0)", value(0.0))
            self.channels = tuple(
                (np.eye(3)[i], FunctionOfTime(Component(value, i, "load", "value")))
                for i in range(3)
            )
            return
        own = None if isinstance(value, tuple) and not value else vector(self.label, "value", value)
        self.time = time_function(self.label, amplitude)
        if own is not None:
            self.channels = ((own, self.time),)

    def _parts(self) -> Iterator[tuple[str, Any]]:
        time = self.channels[0][1] if self.channels else self.time
        if isinstance(time, FunctionOfTime) and isinstance(time.function, Component):
            yield "value", time.function.function
        elif len(self.channels) < 2:
            if self.channels:
                yield "value", self.channels[0][0]
            if not (isinstance(time, Constant) and time.number == 1):
                yield "amplitude", time
        yield from super()._parts()

    def terms(self) -> Sequence[Term]:
        """Terms that the load is made of."""
        raise NotImplementedError

    @property
    def made_of(self) -> tuple[Term, ...]:
        """Its terms, asked for once, so that places made with them stay the same ones.

        Raises
        ------
        InputError
            If they are no terms.
        """
        if "_made_of" not in vars(self):
            made = self.terms()
            if isinstance(made, Term) or not isinstance(made, Iterable):
                raise InputError(self.label, f"terms() gives {made!r}, expected a list of terms")
            found = tuple(made)
            for term in found:
                if not isinstance(term, (TermForce, TermLine, TermAcceleration)):
                    text = f"has {term!r} among its terms, expected TermForce(...) or the like"
                    raise InputError(self.label, text)
            self._made_of = found
        return self._made_of

    def __getstate__(self) -> dict[str, Any]:
        """Copies and pickles ask for their own terms."""
        return {name: value for name, value in vars(self).items() if name != "_made_of"}

    def with_replacements(self, replacements: Replacements) -> Self:
        """Copy that refers to the replacements and makes its own terms."""
        return super(Load, copy(self)).with_replacements(replacements)

    def references(self) -> list[StructuralItem]:
        """The items it acts on."""
        return list({id(i): i for term in self.made_of for i in term.items()}.values())

    def places(self) -> Sequence[Place]:
        """The points it acts at, if it has any."""
        return list({id(p): p for term in self.made_of for p in term.places()}.values())

    @property
    def constant(self) -> bool:
        """True if no term has a factor that changes in time; functions of the motion may change."""
        return all(isinstance(term.time, Constant) for term in self.made_of)


class _NodalLoad(Load):
    _term: type[TermForce]

    def __init__(
        self, place: Place, value: Any, amplitude: Amplitude = None, follower: bool = False
    ):
        super().__init__(value, amplitude, follower)
        self.place = _checked_place(self.label, place, follower or self._term.axial)

    def with_replacements(self, replacements: Replacements) -> Self:
        """Copy at another place; values that follow a triad are turned into the new triad."""
        other = super().with_replacements(replacements)
        turn = self.place.turn_to(other.place) if self.follower else None
        if turn is not None:
            other.channels = tuple((turn @ value, time) for value, time in self.channels)
        return other

    def terms(self) -> Sequence[Term]:
        """Force or moment at the place, a term for each channel."""
        return [self._term(self.place, *channel, self.follower) for channel in self.channels]


class LoadForce(_NodalLoad):
    """Force (N) at a place, dead (fixed in space) or following the triad.

    Parameters
    ----------
    place : Place
        Of a beam node, body or mass point; off a node or a body's reference point the force has
        its moment there.
    value : (3,) array or callable of time
        In space, or in the triad of the place if `follower` (N).
    amplitude, follower
        See :class:`Load`.

    Raises
    ------
    InputError
        If it acts on the ground, follows a mass point, or numbers are not finite.

    Examples
    --------
    A pulse on a body, and thrust along its d3:

    >>> from skfem_cosserat import RigidBody, Table
    >>> body = RigidBody.box(1.0, (1, 1, 1))
    >>> push = LoadForce(body.local((0, 0, 0.5)), (0, 10.0, 0), Table([0, 1, 2], [0, 1, 0]))
    >>> thrust = LoadForce(body.local((0, 0, 0)), (0, 0, 5.0), follower=True)
    >>> push.constant, thrust.constant
    (False, True)
    """

    _term = TermForce


class LoadMoment(_NodalLoad):
    """Moment (N m) at a place, about axes fixed in space or following the triad.

    Enters as ``f_{d_i} = (1/2) m x d^i`` with the reciprocal basis ``d^i``, so that the angular
    momentum of a step changes by exactly its time integral. A moment about a spatially fixed axis
    is not conservative.

    Parameters
    ----------
    place : Place
        Of a beam node or body.
    value : (3,) array or callable of time
        In space, or in the triad of the place if `follower` (N m).
    amplitude, follower
        See :class:`Load`.

    Raises
    ------
    InputError
        If it acts on the ground or a mass point, or numbers are not finite.

    Examples
    --------
    From rest, a wheel gets the angular momentum ``m t``:

    >>> from skfem_cosserat import EnergyMomentum, Model, NullSpace, RigidBody, simulate
    >>> model = Model()
    >>> wheel = model.add("wheel", RigidBody.cylinder(2.0, radius=1.0, length=0.1))
    >>> drive = model.add("drive", LoadMoment(wheel.local((0, 0, 0)), (0, 0, 3.0)))
    >>> history = simulate(model.freeze(), EnergyMomentum(), NullSpace(), 0.1, until=0.2)
    >>> round(float(history["angular_momentum"][-1, 2]), 9)
    0.6
    """

    _term = TermMoment


class _ShareOfLine(TermMoment):
    """Moment (N m) at a node of an element, its share of what is spread over the element."""

    def __init__(self, share: tuple[int, int], *given: Any):
        super().__init__(*given)
        self.share = share

    def on_elements(self, beam: Beam, mass: Floats, nodal: Floats, factor: float) -> Floats | float:
        """The forces on directors that have this moment, and the least norm."""
        if self.place.item is not beam:
            return 0.0
        out = np.zeros_like(nodal)
        d = nodal[*self.share, 1:]
        moment = factor * (self.value @ d if self.follower else self.value)
        out[*self.share, 1:] = 0.5 * cross(moment, d)
        return out


class LoadLine(Load):
    """Force and moment per reference length along a beam, dead or following the section triad.

    It acts at the reference line, wherever the sections' centre of mass is.

    Parameters
    ----------
    beam : Beam
    value : (3,) array, callable or pair of arrays
        Force per length (N/m) in space, or in the section triad if `follower`: the same along the
        whole part, a function ``s -> (3,)`` of the arc length (m) from its start, or a table
        ``(s (k,), values (k, 3))`` that is linear in between. Resultants are exact for polynomials
        up to the order of the elements.
    amplitude, follower
        See :class:`Load`.
    part : str, optional
        Name of the part of the mesh; default: the whole beam.
    moment : (3,) array, callable or pair of arrays, optional
        Moment per length (N m/m), given in the same ways. It acts at the nodes.

    Raises
    ------
    InputError
        If `beam` is no beam, numbers are not finite, or a function gives no three numbers;
        MeshError for an unknown part.

    Examples
    --------
    >>> from skfem_cosserat import Beam, MeshCurve, Section
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4, name="boom"), section)
    >>> wind = LoadLine(beam, (3.0, 0, 0), amplitude=lambda t: 1 + t, part="boom")
    >>> wind.elements.tolist()
    [0, 1, 2, 3]

    Snow that lies 2 m deep at the end and ends at the start, and a torque:

    >>> snow = LoadLine(beam, lambda s: (0, 0, -300.0 * s), moment=(0, 5.0, 0))
    """

    _components = 3

    def __init__(
        self,
        beam: Beam,
        value: Any = (0.0, 0.0, 0.0),
        amplitude: Amplitude = None,
        follower: bool = False,
        part: str | None = None,
        moment: Any = None,
    ):
        super().__init__((), amplitude, follower)
        check_beam(self.label, beam)
        self.beam = beam
        self.part = part
        self.value = Along(self.label, "value", value, self._components)
        self.moment = None if moment is None else Along(self.label, "moment", moment, 3)
        self.terms()  # a function that gives no numbers is named here

    @property
    def elements(self) -> IndexArray:
        """Numbers of the elements of its part."""
        check_beam(self.label, self.beam)
        return self.beam.part(self.part)

    def terms(self) -> Sequence[Term]:
        """Forces along the elements, and moments at their nodes."""
        kind = self.beam.basis.interpolation
        rest = (self.time, self.follower)
        place = (self.beam, self.elements, self.part)
        force = self.value.on(*place, kind.full.points)
        out: list[Term] = [TermLine(self.beam, force, *rest, self.elements)]
        if self.moment is not None:
            weights = self.beam.basis.elemental_load(self.elements)
            values = weights[..., None] * self.moment.on(*place, kind.nodes)
            nodes = self.beam.basis.connectivity[self.elements]
            if self.follower:  # by the triads of the nodes
                values = np.einsum("eai,eaij->eaj", values, self.beam.rotations[self.elements])
            for (k, a), node in np.ndenumerate(nodes):
                share = int(self.elements[k]), a
                out.append(_ShareOfLine(share, self.beam.node(int(node)), values[k, a], *rest))
        return out


class LoadStrain(LoadLine):
    """Strain that a beam would take without load: heat, growth, swelling, prestress, actuation.

    The beam resists it where it is held. It changes in time by `amplitude`; in statics
    ``static(model, factors={"heat": 1.0})`` gives it a factor of its own, by the name of the load.
    One that is always there is ``Beam(..., strain=...)``.

    Parameters
    ----------
    beam : Beam
        Of sections whose stored energy is quadratic.
    value : (6,) array, callable or pair of arrays
        Strains ``(Gamma_1, Gamma_2, Gamma_3, K_1, K_2, K_3)`` (-, 1/m): the same along the whole
        part, a function ``s -> (6,)`` of the arc length (m) from its start, or a table
        ``(s (k,), values (k, 6))`` that is linear in between. Heat by dT: ``(0, 0, alpha dT, 0, 0,
        0)``; a force F (N) in a tendon along the line: ``(0, 0, -F/EA, 0, 0, 0)``.
    amplitude
        See :class:`Load`.
    part : str, optional
        Name of the part of the mesh; default: the whole beam.

    Raises
    ------
    InputError
        If `beam` is no beam or its stored energy is not quadratic, its theory holds a strain that
        would change, or numbers are not finite; MeshError for an unknown part.

    Notes
    -----
    The stress is ``D (eps - f(t) e)``, and the stored energy that of ``eps - f(t) e``. The power
    ``-int S . e df/dt ds`` is in ``work_loads``, so that the energy balance closes.

    Examples
    --------
    A rod that bends to a ring while its curvature grows:

    >>> import skfem_cosserat as sc
    >>> model, mesh = sc.Model(), sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 16, name="rod")
    >>> rod = model.add("rod", sc.Beam(mesh, sc.Section([1e4] * 6, 1.0, (10.0, 10.0)), order=3))
    >>> clamp = model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    >>> bend = model.add("bend", LoadStrain(rod, (0, 0, 0, 2 * np.pi, 0, 0)))
    >>> path = sc.static(model)
    >>> bool(abs(path.position(rod.node("rod.end"))[-1]).max() < 1e-6)
    True
    """

    _components = 6

    def __init__(
        self, beam: Beam, value: Any, amplitude: Amplitude = None, part: str | None = None
    ):
        super().__init__(beam, value, amplitude, True, part)

    def terms(self) -> Sequence[Term]:
        """Strains along the elements: those of the line, and those of its triads."""
        strains = self.value.on(self.beam, self.elements, self.part, self.beam.elements.points)
        return [
            TermStrain(self.beam, own, self.time, self.elements, axial)
            for axial, own in zip((False, True), np.split(strains, 2, axis=-1), strict=True)
        ]


class LoadGravity(Load):
    """Gravity on everything that has mass, of sections at their centre of mass.

    Parameters
    ----------
    value : (3,) array or callable of time
        Acceleration in space (m/s^2).
    amplitude
        See :class:`Load`.

    Raises
    ------
    InputError
        If numbers are not finite.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint, Model
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0))
    >>> gravity = model.add("gravity", LoadGravity((0, 0, -9.81)))
    >>> from skfem_cosserat.diagnostics import external_energy
    >>> float(external_energy(model.freeze(), [0, 0, 3.0], 0.0))   # J, at a height of 3 m
    58.86
    """

    def __init__(self, value: Any, amplitude: Amplitude = None):
        if isinstance(value, (int, float, np.number)):
            raise InputError(
                "gravity",
                f"value = {value!r} has no direction, expected a vector in space such as"
                f" LoadGravity((0, 0, {-abs(float(value))!r}))",
            )
        super().__init__(value, amplitude)

    def terms(self) -> Sequence[Term]:
        """Acceleration of everything that has mass, a term for each channel."""
        return [TermAcceleration(*channel) for channel in self.channels]
