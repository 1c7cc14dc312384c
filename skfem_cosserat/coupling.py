"""Springs, dampers, actuators, bushings, cables and foundations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from functools import partial
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np

from .errors import InputError
from .frames import Item, Place, check_beam, check_sides, ground, vector
from .frozen import Replacements, loosened
from .joint import Joint
from .relative import RelativeCoordinate, displacement, distance, rotation
from .time_function import (
    Amplitude,
    Component,
    Constant,
    FunctionOfTime,
    Table,
    TimeFunction,
    time_function,
)
from .types import ArrayLike, Floats, finite, numbers, positive, shaped, shown, symmetric

if TYPE_CHECKING:
    from .beam import Beam

# --------------------------------------------------------------------------------------------------
# Force elements between places and on joint coordinates: springs, dampers, actuators, bushings.
#
# Each acts on relative coordinates ``xi`` of two places with a generalised force: a spring and
# damper ``K (xi - neutral) + C dxi/dt`` against the motion, an actuator with a prescribed one. All
# are internal forces: what one side gets, the other loses.


#: ``(e, v, t)`` to a tension, or a Table of stretches and tensions
SpringForce: TypeAlias = Callable[[Any, Any, float], ArrayLike] | Table | None


class Coupling(Item):
    """Base of the force elements.

    Attributes
    ----------
    a, b : Place
        Its sides.
    coordinates : tuple of RelativeCoordinate
        What it acts on, m components in all.
    stiffness, damping : (m, m) array
        Symmetric and positive semidefinite; (0, 0) of a :class:`Force`.
    neutral : (m,) array
        Coordinates without spring force.
    channels : tuple of TimeFunction
        Generalised forces of an actuator, m or none.
    slack : bool
        Whether it carries tension only.
    """

    kind = "coupling"
    slack = False
    #: -1 if it acts where its coordinate is smaller than the neutral one, not larger
    sign = 1.0
    channels: tuple[TimeFunction, ...] = ()
    #: whether its law is a user's own: compiled steps call it back
    own_law = False
    #: whether it is nothing but a prescribed force
    actuator = False
    #: its functions, see :class:`Force`
    law: Any = None
    energy: Any = None
    derivative: Any = None
    each = False
    #: of a spring, beside its stiffness and damping
    force: SpringForce = None
    #: at which it acts, if these are no sides of a coupling
    points: tuple[object, ...] = ()
    a: Place
    b: Place
    coordinates: tuple[RelativeCoordinate, ...]
    stiffness: Floats = np.zeros((0, 0))
    damping: Floats = np.zeros((0, 0))
    neutral: Floats
    #: of which it is a piece, if it is one
    part_of: Coupling | None = None
    #: numbers that a law remembers, at first
    memory: Floats = np.zeros(0)
    #: of a law that is sampled (s)
    period = 0.0

    def _parts(self) -> Iterator[tuple[str, Any]]:
        yield from super()._parts()
        if self.channels:
            yield "amplitude", self.channels

    @property
    def whole(self) -> Coupling:
        """The item of the model that it is, or is a piece of."""
        return self if self.part_of is None else self.part_of

    @property
    def size(self) -> int:
        """Number m of components."""
        return sum(c.size for c in self.coordinates)

    def places(self) -> list[Place]:
        """All places whose motion its coordinates take."""
        forms = [form for coordinate in self.coordinates for form in coordinate.forms]
        ends = [end for form in forms for product in form for end in (product.left, product.right)]
        return [place for end in ends for place, _, _ in end.terms]

    def pieces(self) -> Sequence[Coupling]:
        """Force elements that it is made of: a force beside stiffness and damping is one more."""
        if self.force is None or self.own_law:
            return [self]
        own = loosened(copy(self))
        own.own_law = True
        own.part_of = self
        vars(own)["name"] = f"{self.name}/force"
        return [self, own]

    def _coordinate_of(self, joint: Joint, name: str | None) -> RelativeCoordinate:
        try:
            return joint.coordinate(name)
        except InputError as error:
            raise InputError(self.label, str(error)) from error

    def sides(self) -> Sequence[Place]:
        """The places that it connects."""
        return self.a, self.b

    def references(self) -> Sequence[Item]:
        """The items of both sides."""
        return [place.item for place in (self.a, self.b) if place.item is not None]

    def _set_law(
        self, stiffness: Any, damping: Any, neutral: Any, force: SpringForce = None
    ) -> None:
        self.force = force
        self.shape = (self.size,) * (self.size > 1)
        if isinstance(force, Table) and self.size == 1:
            self.energy = force.integral
            self.derivative = force.extended
        elif callable(force) and not isinstance(force, TimeFunction):
            self.law = partial(_against, force)
        elif force is not None:
            raise InputError(
                self.label,
                f"force = {shown(force)}, expected a function force(e, v, t) or, of a stretch that"
                " is a number, a Table",
            )
        self.stiffness = self._matrix("stiffness", stiffness)
        self.damping = self._matrix("damping", damping)
        if not (self.stiffness.any() or self.damping.any()):
            if force is None:
                raise InputError(self.label, "stiffness and damping are both zero: it does nothing")
            self.own_law = True
        value = numbers(self.label, "neutral", neutral)
        if value.shape not in ((), (self.size,)) or not np.isfinite(value).all():
            expected = "a finite number" if self.size == 1 else f"({self.size},) finite numbers"
            raise InputError(self.label, f"neutral = {value.tolist()}, expected {expected}")
        self.neutral = np.broadcast_to(value, (self.size,)).astype(float)

    def _matrix(self, name: str, value: Any) -> Floats:
        """(m, m) from a number for all components or a matrix."""
        array = numbers(self.label, name, value)
        m = self.size
        if array.shape not in ((), (m, m)):
            expected = "a number" + ("" if m == 1 else f" or ({m}, {m})")
            raise InputError(self.label, f"{name} has shape {array.shape}, expected {expected}")
        if array.ndim == 0 and np.isfinite(array):
            if array < 0:
                raise InputError(
                    self.label, f"{name} = {float(array)!r}, expected a number that is not negative"
                )
            return float(array) * np.eye(m)
        return semidefinite(self.label, name, array)


def _against(force: Callable[..., Any], *motion: Any) -> Any:
    """A tension as a force along the coordinate."""
    return np.negative(force(*motion))


class Composed(Item):
    """Base of items that are made of force elements, kept by the ends of their names."""

    _made: dict[str, Coupling]

    def pieces(self) -> list[Coupling]:
        """Its force elements, named after it."""
        out: list[Coupling] = []
        for end, piece in self._made.items():
            vars(piece)["name"] = f"{self.name}{end}"
            out += piece.pieces()
        return out

    def references(self) -> Sequence[Item]:
        """The items that its force elements refer to."""
        return [item for piece in self._made.values() for item in piece.references()]

    def with_replacements(self, replacements: Replacements) -> Self:
        """Made again, on the items that replace its own."""
        return type(self)(**{name: replacements.of(value) for name, value in self._parts()})


def semidefinite(item: str, name: str, array: Floats) -> Floats:
    """The array, if it is a finite, symmetric, positive semidefinite matrix."""
    if not np.isfinite(array).all():
        raise InputError(item, f"{name} = {array.tolist()} is not finite")
    size = float(abs(array).max())
    out = symmetric(item, name, array)
    lowest = float(np.linalg.eigvalsh(array)[0])
    if lowest < -1e-12 * size:
        raise InputError(
            item,
            f"{name} is not positive semidefinite (eigenvalue {lowest:.6g}): {array.tolist()}",
        )
    return out


class _OnJoint(Coupling):
    def __init__(self, joint: Joint, coordinate: str | None) -> None:
        if not isinstance(joint, Joint):
            raise InputError(self.label, f"joint is {joint!r}, expected a joint of the model")
        self.joint = joint
        self.a = joint.a
        self.b = joint.b
        self.coordinates = (self._coordinate_of(joint, coordinate),)

    def references(self) -> Sequence[Item]:
        """The joint."""
        return [self.joint]


class JointSpringDamper(_OnJoint):
    """Spring and damper on a relative coordinate of a joint.

    Against the motion of side b it acts with ``K e + C de/dt + force(e, de/dt, t)`` (N or N m),
    ``e = xi - neutral``.

    Parameters
    ----------
    joint : Joint
        Of the same model.
    stiffness : float, or (3, 3) array on a rotation vector
        K (N/m or N m/rad), symmetric, positive semidefinite.
    damping : float, or (3, 3) array on a rotation vector
        C (N s/m or N m s/rad), likewise.
    coordinate : str, optional
        Its name, see :meth:`Joint.coordinates`; needed if the joint has several.
    neutral : float, or (3,) array on a rotation vector
        Coordinate without spring force (m or rad). Angles are followed over several turns.
    force : callable or Table, optional
        See :class:`SpringDamper`. On a rotation vector a function, of e and v (3,).

    Raises
    ------
    InputError
        If there is no such coordinate, it has neither coefficients nor a force, or a coefficient is
        negative, not symmetric or not finite; of a force see :class:`SpringDamper`.

    Examples
    --------
    >>> from skfem_cosserat import JointRevolute, RigidBody, ground
    >>> body = RigidBody.box(1.0, (1, 1, 1))
    >>> hinge = JointRevolute(ground((0, 0, 0)), body.at((0, 0, 0)), axis=(1, 0, 0))
    >>> spring = JointSpringDamper(hinge, stiffness=20.0, damping=0.5, neutral=np.pi / 2)
    >>> spring.coordinates[0].name, spring.stiffness.tolist()
    ('angle', [[20.0]])
    """

    kind = "joint spring"

    def __init__(
        self,
        joint: Joint,
        stiffness: float | ArrayLike = 0.0,
        damping: float | ArrayLike = 0.0,
        coordinate: str | None = None,
        neutral: float | ArrayLike = 0.0,
        force: SpringForce = None,
    ) -> None:
        super().__init__(joint, coordinate)
        self._set_law(stiffness, damping, neutral, force)


class _Stop(JointSpringDamper):
    kind = "joint limit"
    slack = True

    def __init__(
        self, joint: Joint, sign: float, end: float, k: float, c: float, coordinate: str | None
    ) -> None:
        super().__init__(joint, k, c, coordinate, end)
        self.sign = sign
        if self.size > 1:
            raise InputError(self.label, "limits a rotation vector, expected an angle or a length")


class JointLimits(Composed):
    """End stops of a joint: springs and dampers beyond the ends of its range.

    Below `lower` and above `upper` a stop pushes back with ``k e + c de/dt``, e being how far the
    coordinate is beyond, and never pulls. In histories the stops are ``coupling/NAME/lower`` and
    ``coupling/NAME/upper``.

    Parameters
    ----------
    joint : Joint
        Of the same model.
    lower, upper : float or None
        Ends of the range (rad or m); None: there is no end.
    stiffness, damping : float
        k (N/m or N m/rad), positive, and c (the same times s).
    coordinate : str, optional
        Its name, see :meth:`Joint.coordinates`; needed if the joint has several.

    Raises
    ------
    InputError
        If there is no end, the lower one is above the upper one, a number is negative or not
        finite, or the coordinate is a rotation vector.

    Examples
    --------
    >>> from skfem_cosserat import JointRevolute, RigidBody, ground
    >>> body = RigidBody.box(1.0, (1, 1, 1))
    >>> hinge = JointRevolute(ground((0, 0, 0)), body.at((0, 0, 0)), axis=(1, 0, 0))
    >>> [stop.neutral.tolist() for stop in JointLimits(hinge, -0.5, 0.5, 1e4).pieces()]
    [[-0.5], [0.5]]
    """

    kind = "joint limits"

    def __init__(
        self,
        joint: Joint,
        lower: float | None,
        upper: float | None,
        stiffness: float,
        damping: float = 0.0,
        coordinate: str | None = None,
    ) -> None:
        if lower is None and upper is None:
            raise InputError(self.label, "has no end: give lower, upper or both")
        if lower is not None and upper is not None and not lower < upper:
            raise InputError(self.label, f"lower = {lower}, expected less than upper = {upper}")
        positive(self.label, "stiffness", stiffness, " (N/m or N m/rad)")
        self.joint, self.lower, self.upper, self.coordinate = joint, lower, upper, coordinate
        self.stiffness = stiffness
        self.damping = damping
        self._made = {}
        for name, sign, end in (("lower", -1.0, lower), ("upper", 1.0, upper)):
            if end is not None:
                at = finite(self.label, name, end)
                self._made[f"/{name}"] = _Stop(joint, sign, at, stiffness, damping, coordinate)


class JointActuator(_OnJoint):
    """Prescribed torque or force on a relative coordinate of a joint.

    Positive values push side b towards larger coordinates, and side a back. As with loads the
    average of each step acts.

    Parameters
    ----------
    joint : Joint
        Of the same model.
    amplitude : float, TimeFunction or callable
        Force (N) or torque (N m), also as a function of time (s). On a rotation vector: (3,) array
        or callable with such a value, the generalised force that does work on its components.
    coordinate : str, optional
        Its name, see :meth:`Joint.coordinates`; needed if the joint has several.

    Raises
    ------
    InputError
        If there is no such coordinate, or the amplitude is no finite number or function.

    Examples
    --------
    >>> from skfem_cosserat import JointRevolute, RigidBody, ground
    >>> body = RigidBody.box(1.0, (1, 1, 1))
    >>> hinge = JointRevolute(ground((0, 0, 0)), body.at((0, 0, 0)), axis=(1, 0, 0))
    >>> motor = JointActuator(hinge, lambda t: 5.0 * np.sin(t))
    >>> motor.channels[0].value(0.0)
    0.0
    """

    kind = "joint actuator"
    actuator = True

    def __init__(
        self,
        joint: Joint,
        amplitude: Amplitude | ArrayLike | Callable[[float], ArrayLike],
        coordinate: str | None = None,
    ) -> None:
        super().__init__(joint, coordinate)
        m = self.size
        self.stiffness = self.damping = np.zeros((m, m))
        self.neutral = np.zeros(m)
        if m == 1:
            if amplitude is None:
                raise InputError(self.label, "amplitude is None, expected a force or torque")
            self.channels = (time_function(self.label, amplitude),)  # type: ignore[arg-type]
        elif callable(amplitude):
            vector(self.label, "amplitude(0)", amplitude(0.0))
            self.channels = tuple(
                FunctionOfTime(Component(amplitude, i, self.label, "amplitude")) for i in range(m)
            )
        else:
            values = vector(self.label, "amplitude", amplitude)  # type: ignore[arg-type]
            self.channels = tuple(Constant(float(value)) for value in values)


class _BetweenPlaces(Coupling):
    framed_sides = ""

    def __init__(self, a: Place, b: Place) -> None:
        check_sides(self.label, a, b, self.framed_sides, "SpringDamper")
        self.a = a
        self.b = b


class SpringDamper(_BetweenPlaces):
    """Spring and damper along the line between two points.

    Pulls both together with ``k e + c de/dt + force(e, de/dt, t)`` (N), e being the stretch
    ``l - length`` (m); pushes if this is negative.

    Parameters
    ----------
    a, b : Place
        Of beam nodes, bodies, mass points or the ground, at rest or in prescribed motion.
    stiffness, damping : float
        k (N/m) and c (N s/m), not negative.
    length : float, optional
        Unstressed length (m); default: the distance in the reference configuration.
    force : callable or Table, optional
        Tension (N) that comes on top: ``force(e, v, t)`` of the stretch, its rate v (m/s) and the
        time t (s), or a table of it over the stretch. A table has a potential: with
        :class:`EnergyMomentum` its work is its change of energy, exactly, and it counts as
        ``coupling_energy``. The work of a function is part of ``work_loads``; its slopes come from
        complex steps: ``np.where(e.real > 0, k * e, 0)``, not ``k * abs(e)``. Beside stiffness or
        damping it has results of its own, those of ``NAME/force``.

    Raises
    ------
    InputError
        If the points coincide in the reference configuration, are on the same body or node, a
        number is negative or not finite, there are no coefficients and no force, or this is no
        function or Table; when a scene is frozen, if its values or derivatives are wrong.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint, Table, ground
    >>> bob = MassPoint(1.0, position=(0, 0, -2))
    >>> SpringDamper(ground((0, 0, 0)), bob.place(), stiffness=50.0).neutral.tolist()
    [2.0]

    One that gets stiffer, and one with a gap of 0.1 m on both sides:

    >>> hard = SpringDamper(ground((0, 0, 0)), bob.place(), 50.0, force=lambda e, v, t: 900 * e**3)
    >>> table = Table([-1, -0.1, 0.1, 1], [-900, 0, 0, 900])
    >>> loose = SpringDamper(ground((0, 0, 0)), bob.place(), force=table)
    """

    kind = "spring"

    def __init__(
        self,
        a: Place,
        b: Place,
        stiffness: float = 0.0,
        damping: float = 0.0,
        length: float | None = None,
        force: SpringForce = None,
    ) -> None:
        super().__init__(a, b)
        if self.slack:
            positive(self.label, "stiffness", stiffness, " (N/m)")
            if force is not None:
                raise InputError(self.label, "takes no force, unlike a SpringDamper")
        self.coordinates = (distance("distance", a, b),)
        ends = a.at(0.0), b.at(0.0)
        span = float(np.linalg.norm(ends[1] - ends[0]))
        if span == 0:
            raise InputError(
                self.label,
                f"both points are at {ends[0].tolist()} in the reference configuration: it has no"
                " direction, use a Bushing (between frames), or springs to points beside it",
            )
        rest = positive(self.label, "length", span if length is None else length, " (m)")
        self._set_law(stiffness, damping, np.array(rest), force)


class Cable(SpringDamper):
    """Cable between two points: tension ``k (l - length) + c dl/dt`` (N) while it is longer.

    It never pushes: shorter than `length` it is slack, and the damper does not push either. Where
    it becomes taut inside of a step the energy balance of a variational scheme keeps an error that
    does not fall regularly with the step; energy-momentum balances exactly.

    Parameters
    ----------
    a, b, damping, length
        See :class:`SpringDamper`.
    stiffness : float
        k (N/m), positive.

    Raises
    ------
    InputError
        See :class:`SpringDamper`.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint, ground
    >>> bob = MassPoint(1.0, position=(0, 0, -2))
    >>> Cable(ground((0, 0, 0)), bob.place(), stiffness=1e3, length=2.5).neutral.tolist()
    [2.5]
    """

    kind = "cable"
    slack = True


class Bushing(_BetweenPlaces):
    """Elastic connection in all six directions, with full 6x6 stiffness and damping.

    Acts on ``(u, psi)``: u are the components of ``x_b - x_a`` less its reference value along
    axes that move with side a and are those of space in the reference, psi is the rotation vector
    from a to b in these axes (below a turn of pi).

    Parameters
    ----------
    a, b : Place
        Of beam nodes, bodies or the ground; mass points do not rotate.
    stiffness : float or (6, 6) array
        K (N/m, N/rad, N m/rad), symmetric, positive semidefinite.
    damping : float or (6, 6) array, optional
        C (the same times s), likewise.

    Raises
    ------
    InputError
        If a side is a mass point, both are on the same body or node, or a matrix is not
        symmetric, not positive semidefinite or not finite.

    Examples
    --------
    >>> from skfem_cosserat import RigidBody, ground
    >>> engine = RigidBody.box(100.0, (0.6, 0.5, 0.4))
    >>> K = np.diag([1e6, 1e6, 5e5, 2e3, 2e3, 1e3])
    >>> mount = Bushing(ground((0.3, 0, 0)), engine.at((0.3, 0, 0)), K, damping=1e-3 * K)
    >>> mount.size
    6
    """

    kind = "bushing"
    framed_sides = "ab"

    def __init__(
        self,
        a: Place,
        b: Place,
        stiffness: float | ArrayLike,
        damping: float | ArrayLike | None = None,
    ) -> None:
        super().__init__(a, b)
        self.coordinates = (*_shifts(a, b), rotation("psi", a, b))
        self._set_law(stiffness, 0.0 if damping is None else damping, 0.0)


def _shifts(a: Place, b: Place) -> tuple[RelativeCoordinate, ...]:
    return tuple(displacement(f"u_{k + 1}", a, b, axis) for k, axis in enumerate(np.eye(3)))


# -- elastic foundations: springs and dampers along a beam -----------------------------------------


class _Support(Coupling):
    """Springs and dampers in space on a node of a beam."""

    kind = "foundation"

    def __init__(self, place: Place, stiffness: Floats, damping: Floats) -> None:
        self.a = ground(place.position)
        self.b = place
        self.coordinates = _shifts(self.a, self.b)
        self._set_law(stiffness, damping, 0.0)


class Foundation(Composed):
    """Elastic (Winkler) foundation of a beam: it is held everywhere along its axis.

    A displacement u of the axis from its reference is resisted by ``k u + c du/dt`` per reference
    length, in space. In the model it is one spring and damper on each node, with the node's weight
    of the Gauss-Lobatto rule: displacements at nodes keep their order 2p. Node k of the beam is
    ``coupling/NAME/k/...`` in histories; the energy is in ``coupling_energy``.

    Parameters
    ----------
    beam : Beam
    stiffness : float, (3,) or (3, 3) array
        k (N/m^2): in all directions, along e1, e2 and e3, or a symmetric positive semidefinite
        matrix.
    damping : float, (3,) or (3, 3) array
        c (N s/m^2), likewise.
    part : str, optional
        Name of a part of the mesh; default: the whole beam.

    Raises
    ------
    InputError
        If `beam` is no beam, both coefficients are zero, or one is negative, not symmetric or not
        finite; MeshError for an unknown part.

    Examples
    --------
    A guided rail that lies on its bed:

    >>> from skfem_cosserat import Beam, JointPrismatic, LoadGravity, MeshCurve, Model
    >>> from skfem_cosserat import Section, static
    >>> section = Section([1e6, 1e6, 1e6, 50, 50, 50], mass=2.0, inertia=(1e-3, 1e-3))
    >>> model = Model()
    >>> mesh = MeshCurve.init_line((0, 0, 0), (3, 0, 0), 4)
    >>> rail = model.add("rail", Beam(mesh, section, director=(0, 0, 1)))
    >>> start = rail.node((0, 0, 0))
    >>> guide = model.add("guide", JointPrismatic(ground((0, 0, 0)), start, axis=(0, 0, 1)))
    >>> bed = model.add("bed", Foundation(rail, stiffness=1e3))
    >>> weight = model.add("weight", LoadGravity((0, 0, -10.0)))
    >>> path = static(model)
    >>> path.position(rail, s=[0, 1.5, 3])[-1, :, 2].round(9).tolist()   # -20 N/m over 1000 N/m^2
    [-0.02, -0.02, -0.02]
    """

    kind = "foundation"

    def __init__(
        self,
        beam: Beam,
        stiffness: float | ArrayLike,
        damping: float | ArrayLike = 0.0,
        part: str | None = None,
    ) -> None:
        check_beam(self.label, beam)
        self.beam = beam
        self.part = part
        self.tensors = tuple(
            self._tensor(name, value)
            for name, value in (("stiffness", stiffness), ("damping", damping))
        )
        k, c = self.tensors
        elements = beam.part(part)
        nodes = beam.basis.connectivity[elements]
        lengths = beam.basis.elemental_load(elements)
        weights = np.bincount(nodes.ravel(), lengths.ravel())
        # springs on nodes, in proportion to their lengths
        self._made = {
            f"/{node}": _Support(beam.node(int(node)), weights[node] * k, weights[node] * c)
            for node in np.flatnonzero(weights)
        }

    def _parts(self) -> Iterator[tuple[str, Any]]:
        yield from super()._parts()
        yield from zip(("stiffness", "damping"), self.tensors, strict=True)

    def _tensor(self, name: str, value: float | ArrayLike) -> Floats:
        """(3, 3) of a number, three or nine."""
        array = shaped(self.label, name, value, (), (3,), (3, 3))
        return semidefinite(self.label, name, array if array.ndim == 2 else array * np.eye(3))
