"""Forces of a user's own laws, at places of a scene or on coordinates of its joints."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from typing import Any, Self, TypeAlias

import numpy as np

from .coupling import Coupling
from .errors import InputError
from .frames import Item, Place, no_place
from .frozen import Replacements, loosened
from .joint import Joint
from .relative import ORIGIN, Expression, RelativeCoordinate, position
from .types import ArrayLike, switch

#: ``(x, v, t)`` to forces of the shape of x
ForceFunction: TypeAlias = Callable[[Any, Any, float], ArrayLike]
#: ``x`` to a potential in J
EnergyFunction: TypeAlias = Callable[[Any], ArrayLike]
Where: TypeAlias = Place | Expression | Joint | RelativeCoordinate


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
        ``joint.coordinate("angle")``. Vectors such as :func:`direction` count as places; the force
        does work on their change.
    law : callable, optional
        ``law(x, v, t)`` gives the forces for places x (k, 3) in m, their velocities v in m/s and
        the time t in s: (k, 3) in N. Of one place, not in a list, x has the shape (3,). Of joints
        x, v and the forces are (m,) in rad or m, or numbers.
    energy : callable, optional
        ``energy(x)`` gives a potential in J instead.
    derivative : callable, optional
        Of a law ``derivative(x, v, t)``: its derivatives by x and by v, two arrays of the shape of
        x twice, as (k, 3, k, 3). Of a potential ``derivative(x)``: its gradient, of the shape of x.
        By default they come from complex steps: the functions must be made of what can be
        differentiated, ``np.sqrt((v * v).sum())`` instead of ``abs`` or ``np.linalg.norm``.
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
    ) -> None:
        alone = isinstance(at, Place | Expression | Joint | RelativeCoordinate)
        if not alone and not isinstance(at, Iterable):
            raise InputError(self.label, f"acts on {no_place(at)}")
        where = [at] if alone else list(at)  # type: ignore[arg-type]
        if not where:
            raise InputError(self.label, "has no places, expected one or more")
        for name, function in (("law", law), ("energy", energy), ("derivative", derivative)):
            if not (function is None or callable(function)):
                raise InputError(self.label, f"{name} = {function!r}, expected a function")
        if (law is None) == (energy is None):
            raise InputError(self.label, "takes either law or energy")
        self.law, self.energy, self.derivative = law, energy, derivative
        self.each = switch(self.label, each, "each")
        self.points = tuple(p for p in where if isinstance(p, Place | Expression))
        if self.points and len(self.points) < len(where):
            raise InputError(self.label, "acts on places and on joints: take two forces")
        self.joints = tuple(j for j in where if isinstance(j, Joint))
        found = [self._coordinates(k, each) for k, each in enumerate(where)]
        self.coordinates = tuple(c for coordinates in found for c in coordinates)
        inner = (
            (3,) if self.points else () if self.size == len(where) else (self.size // len(where),)
        )
        #: shape of x in one call, or of each place
        self.shape = inner if alone or self.each else (len(where), *inner)
        if self.together > 1:
            self.shape = self.together, *inner
        self.a, self.b = self.sides()[0], self.sides()[-1]
        if self.joints:
            self.a, self.b = self.joints[0].a, self.joints[0].b
        self._set_law(0.0, 0.0, 0.0)
        #: of one place each, made when the scene is frozen
        self._parts_of_it: list[Coupling] = []

    def _coordinates(self, k: int, where: Any) -> Sequence[RelativeCoordinate]:
        if isinstance(where, Place | Expression):
            return position(str(k), where)
        try:
            return [where.coordinate(None) if isinstance(where, Joint) else where]
        except (InputError, AttributeError) as error:
            why = str(error) if isinstance(error, InputError) else f"acts on {no_place(where)}"
            raise InputError(self.label, why) from error

    def _set_law(self, stiffness: Any, damping: Any, neutral: Any) -> None:
        """Springs of force elements: it has none."""
        self.stiffness = self.damping = np.zeros((0, 0))
        self.neutral = np.zeros(self.size)

    def with_replacements(self, replacements: Replacements) -> Self:
        """Copy that acts on the replacements."""
        other = super().with_replacements(replacements)
        other._parts_of_it = []
        return other

    def sides(self) -> Sequence[Place]:
        """All places of its coordinates, each once, but for the axes of space."""
        return list({id(p): p for p in self.places() if p is not ORIGIN}.values())

    @property
    def shown(self) -> Sequence[int]:
        """Numbers of the vectors that are places, for the record of its forces."""
        return [k for k, each in enumerate(self.points) if isinstance(each, Place)]

    def where(self, piece: int) -> str:
        """What an error says of one of its pieces."""
        return f" of place {piece}" if self.each else ""

    def references(self) -> Sequence[Item]:
        """The joints and items it acts on."""
        if not self.points:
            return list(self.joints)
        return list({id(p.item): p.item for p in self.places() if p.item is not None}.values())

    def pieces(self) -> list[Coupling]:
        """Force elements that it is made of: one, or one for each place."""
        if not self.each:
            return [self]
        if not self._parts_of_it:
            step = self.together * (3 if self.points else 1)
            for k in range(0, self.size, step):
                piece = loosened(copy(self))
                piece.coordinates, piece.whole = self.coordinates[k : k + step], self
                piece._set_law(0.0, 0.0, 0.0)
                vars(piece)["name"] = f"{self.name}/{k // step}"
                self._parts_of_it.append(piece)
        return self._parts_of_it
