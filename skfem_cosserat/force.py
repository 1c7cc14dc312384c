"""Forces of a user's own laws, at places of a scene or on coordinates of its joints."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from typing import Any, TypeAlias

import numpy as np

from .coupling import Coupling
from .errors import InputError
from .frames import Item, Place, no_place
from .frozen import Frozen, loosened
from .joint import Joint
from .relative import ORIGIN, Expression, RelativeCoordinate, position
from .types import ArrayLike, numbers, positive, switch

#: ``(x, v, t)``, and a memory if there is one, to forces of the shape of x, and its rate
ForceFunction: TypeAlias = Callable[..., Any]
#: ``x`` to a potential in J
EnergyFunction: TypeAlias = Callable[[Any], ArrayLike]
#: share of a period by which an instant is known
INSTANT = 1e-9
Where: TypeAlias = Place | Expression | Joint | RelativeCoordinate


class Controller(Frozen):
    """A law that is sampled: its forces are held from one instant to the next.

    For the argument `law` of :class:`Force`. The instants are the multiples of a period, and the
    start of a run; :func:`simulate` cuts steps there. In loops of your own, as with :func:`steps`,
    a law is sampled at the first step that begins then or later. :class:`Explicit` takes periods
    that are multiples of its step. At rest the forces are those that are held: zero at first.

    Parameters
    ----------
    period : float
        Time (s) between two instants.
    function : callable
        ``function(x, v, t)`` gives the forces, as a law of :class:`Force`; if that has a memory z,
        ``function(x, v, t, z)`` gives them and the memory up to the next instant.

    Raises
    ------
    InputError
        If the period is not positive, or the function cannot be called.

    Examples
    --------
    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> arm = model.add("arm", sc.RigidBody.box(1.0, (1, 0.1, 0.1), position=(0.5, 0, 0)))
    >>> foot = sc.ground((0, 0, 0)), arm.at((0, 0, 0))
    >>> hinge = model.add("hinge", sc.JointRevolute(*foot, axis=(0, 0, 1)))
    >>> control = sc.Controller(0.01, lambda x, v, t: 50.0 * (0.5 - x) - 8.0 * v)
    >>> motor = model.add("motor", sc.Force(hinge, control))
    >>> history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.005, until=2.0)
    >>> round(float(history["joint/hinge/angle"][-1]), 3)
    0.5
    """

    def __init__(self, period: float, function: ForceFunction) -> None:
        self.period = positive("controller", "period", period, " of seconds")
        if not callable(function):
            raise InputError("controller", f"function = {function!r}, expected a function")
        self.function = function

    def __call__(self, x: Any, v: Any, t: float, z: Any) -> tuple[Any, Any]:
        """The forces that are held, and rates of the memory, which stays."""
        return z[..., : x.size // z[..., 0].size].reshape(x.shape), np.zeros_like(z)


class Force(Coupling):
    """Forces as a function of places, or of coordinates of joints, their rates and the time.

    Newton's method of each step takes the law and its slopes, so that stiff laws need no short
    steps. They are taken at the midpoint of a step with the mean velocity, by generalized-alpha at
    its end, in equilibria at rest. A potential takes the place of a law where there is one: with
    :class:`EnergyMomentum` its work in a step is its change of energy, exactly, and it counts as
    ``coupling_energy``. The work of a law is part of ``work_loads``. In statics without `time` t is
    the load factor; forces do not grow with it by themselves.

    Parameters
    ----------
    at : Place, Joint, or a sequence of them
        Places, also of the ground; or joints, each for its only coordinate, which others name by
        ``joint.coordinate("angle")``. Vectors such as :func:`direction`, or the difference of two
        points (:class:`Expression`), count as places; the force does work on their change.
    law : callable, optional
        ``law(x, v, t)`` gives the forces for places x (k, 3) in m, their velocities v in m/s and
        the time t in s: (k, 3) in N. Of one place, not in a list, x has the shape (3,). Of joints
        x, v and the forces are (m,) in rad or m, or numbers.
    energy : callable, optional
        ``energy(x)`` gives a potential in J instead.
    derivative : callable, optional
        Of a law ``derivative(x, v, t)``: its derivatives by x and by v, two arrays of the shape of
        x twice, as (k, 3, k, 3). Of a potential ``derivative(x)``: its gradient, of the shape of x;
        where it takes no complex numbers, its slopes are differences.
        By default they come from complex steps: the functions must be made of what can be
        differentiated, ``np.sqrt((v * v).sum())`` instead of ``abs`` or ``np.linalg.norm``.
    memory : float or array, optional
        Of a law, at first: integral terms, hysteresis. ``law(x, v, t, z)`` then gives the forces
        and the rate of the memory z, an array of its shape; with `each` one for each place, (n,
        ...). Steps take its mean, it is part of states and histories (``history["turns"]``, whose
        columns ``history.meta["turns"]`` names), and stays as it is in equilibria.
    each : bool
        The functions are for one place, or coordinate, but take many at once along a leading axis:
        x (n, 3), or (n,) of joints. All are evaluated together.

    Raises
    ------
    InputError
        If there are no places, functions are missing or cannot be called; when a scene is frozen,
        if derivatives are wrong; in a run, if a force is not finite or its function fails, with the
        states so far as ``error.history``.

    Examples
    --------
    A charge in a magnetic field moves on a circle:

    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.MassPoint(1.0, velocity=(1.0, 0, 0)))
    >>> field = np.array([0, 0, 2.0])
    >>> force = model.add("field", Force(ball.place(), lambda x, v, t: np.cross(v, field)))
    >>> history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.01, until=1.0)
    >>> speed = np.linalg.norm(history.velocity(ball.place())[-1])
    >>> round(float(speed), 9)
    1.0
    """

    kind = "force"
    own_law = True
    #: vectors that one call of a law for each takes together
    together = 1

    def __init__(
        self,
        at: Where | Iterable[Where],
        law: ForceFunction | None = None,
        energy: EnergyFunction | None = None,
        derivative: Callable[..., Any] | None = None,
        each: bool = False,
        memory: float | ArrayLike | None = None,
    ) -> None:
        alone = not isinstance(at, Iterable)
        where = [at] if alone else list(at)  # type: ignore[arg-type]
        if not where:
            raise InputError(self.label, "has no places, expected one or more")
        for name, function in (("law", law), ("energy", energy), ("derivative", derivative)):
            if not (function is None or callable(function)):
                raise InputError(self.label, f"{name} = {function!r}, expected a function")
        if (law is None) == (energy is None):
            raise InputError(self.label, "takes either law or energy")
        self.law, self.energy, self.derivative = law, energy, derivative
        self._own_memory = memory is not None
        remembers = isinstance(law, Controller) or self._own_memory
        if remembers and (energy or derivative):
            raise InputError(self.label, "has a memory: it takes a law without derivative")
        self.each = switch(self.label, each, "each")
        self.points = tuple(p for p in where if isinstance(p, Place | Expression))
        if self.points and len(self.points) < len(where):
            raise InputError(self.label, "acts on places and on joints: take two forces")
        self.joints = tuple(j for j in where if isinstance(j, Joint))
        found = [self._coordinates(k, each) for k, each in enumerate(where)]
        self.coordinates = tuple(c for coordinates in found for c in coordinates)
        numbers_each = self.size // len(where)
        inner = (numbers_each,) * (numbers_each > 1)
        #: shape of x in one call, or of each place
        self.shape = inner if alone or self.each else (len(where), *inner)
        if self.together > 1:
            self.shape = self.together, *inner
        self.memory = numbers(self.label, "memory", () if memory is None else memory)
        if not np.isfinite(self.memory).all():
            raise InputError(self.label, f"memory = {memory!r}, expected finite numbers")
        #: shape of the user's memory in one call
        self._kept = self.memory.shape
        if isinstance(law, Controller):
            self.period, size = law.period, int(np.prod(self.shape, dtype=int))
            # forces, the next instant, and what the user's function keeps
            self.memory = np.concatenate([np.zeros(size), [-np.inf], self.memory.ravel()])
        self.a, self.b = self.sides()[0], self.sides()[-1]
        if self.joints:
            self.a, self.b = self.joints[0].a, self.joints[0].b
        self.neutral = np.zeros(self.size)

    def _coordinates(self, k: int, where: Any) -> Sequence[RelativeCoordinate]:
        if isinstance(where, Place | Expression):
            return position(str(k), where)
        if isinstance(where, Joint):
            return [self._coordinate_of(where, None)]
        if not isinstance(where, RelativeCoordinate):
            raise InputError(self.label, f"acts on {no_place(where)}")
        return [where]

    def _sample(self, x: Any, v: Any, t: float, z: Any) -> Any:
        """Memory of a :class:`Controller` after it was sampled."""
        assert isinstance(self.law, Controller)
        out, size, function = z.copy(), x.size // z[..., 0].size, self.law.function
        before, kept = z.shape[:-1], z[..., size + 1 :]
        if self._own_memory:
            forces, kept = function(x, v, t, kept.reshape((*before, *self._kept)))
        else:
            forces = function(x, v, t)
        out[..., :size] = np.reshape(forces, (*before, size))
        out[..., size] = (np.floor(t / self.period + INSTANT) + 1) * self.period
        out[..., size + 1 :] = np.reshape(kept, (*before, -1))
        return out

    def sides(self) -> Sequence[Place]:
        """All places of its coordinates, each once, but for the axes of space."""
        return list({id(p): p for p in self.places() if p is not ORIGIN}.values())

    @property
    def shown(self) -> Sequence[int]:
        """Numbers of the vectors that are places, for the record of its forces."""
        return [k for k, each in enumerate(self.points) if isinstance(each, Place)]

    def where(self, piece: int) -> str:
        """What an error says of one of its pieces."""
        return f" of place {piece}"

    def references(self) -> Sequence[Item]:
        """The joints and items it acts on."""
        if not self.points:
            return list(self.joints)
        return list({id(p.item): p.item for p in self.places() if p.item is not None}.values())

    def pieces(self) -> list[Coupling]:
        """Force elements that it is made of: one, or one for each place."""
        if not self.each:
            return [self]
        out: list[Coupling] = []
        step = self.together * (3 if self.points else 1)
        for k in range(0, len(self.coordinates), step):
            piece = loosened(copy(self))
            piece.coordinates, piece.part_of = self.coordinates[k : k + step], self
            piece.neutral = np.zeros(piece.size)
            vars(piece)["name"] = f"{self.name}/{k // step}"
            out.append(piece)
        return out
