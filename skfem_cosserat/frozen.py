"""Objects that refuse to be changed once they are built, and describe themselves in one line."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from copy import copy
from functools import wraps
from types import MethodType
from typing import Any, ClassVar, Self, TypeVar

import numpy as np

from .arguments import checked
from .errors import FrozenError
from .notebook import Shown, brief

T = TypeVar("T")


def _sealing(make: Callable[..., None]) -> Callable[..., None]:
    """A constructor that seals what it has made, unless that of a subclass goes on."""

    @wraps(make)
    def making(self: Any, *args: Any, **kwargs: Any) -> None:
        make(self, *args, **kwargs)
        if type(self).__init__ is making:
            seal(self)

    return making


class Frozen(Shown):
    """Base of what does not change once it is built.

    A constructor sets attributes as it likes, before and after that of its base class. Then no
    attribute can be set, and arrays are copies that cannot be written to. Names that begin with an
    underscore are notes of the class itself, such as what it has computed once, and stay free. A
    subclass may be a dataclass; one with a ``__post_init__`` of its own calls that of its base.

    Examples
    --------
    >>> class Wheel(Frozen):
    ...     def __init__(self, radius, axis):
    ...         self.radius, self.axis = radius, axis
    >>> wheel = Wheel(0.3, np.array([0, 0, 1.0]))
    >>> wheel
    Wheel(radius=0.3, axis=[0, 0, 1])
    >>> wheel.radius = 0.4
    Traceback (most recent call last):
        ...
    skfem_cosserat.errors.FrozenError: Wheel: radius cannot be set: what is built does not change;\
 make a new one
    """

    #: what to do instead of setting an attribute
    _remedy: ClassVar[str] = "make a new one"

    @_sealing
    def __init__(self) -> None:
        """Nothing to set."""

    def __post_init__(self) -> None:
        """Seal a dataclass, whose constructor is made after the class."""
        if not hasattr(type(self).__init__, "__wrapped__"):
            seal(self)

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        checked(cls)
        if "__init__" in vars(cls):
            cls.__init__ = _sealing(cls.__init__)  # type: ignore[method-assign]

    @property
    def _called(self) -> str:
        """Name in errors that refuse a change."""
        return type(self).__name__

    def _refuse(self, name: str, what: str) -> None:
        if "_sealed" in vars(self) and not name.startswith("_"):
            text = f"{name} cannot be {what}: what is built does not change; {self._remedy}"
            if not type(self).__module__.startswith(__package__):
                text += f", or call it _{name}: notes of an own class stay free"
            raise FrozenError(self._called, text)

    def __setattr__(self, name: str, value: Any) -> None:
        self._refuse(name, "set")
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        self._refuse(name, "deleted")
        super().__delattr__(name)

    def __setstate__(self, state: Any) -> None:
        # arrays out of a pickle or a deep copy could be written to
        own, slots = state if isinstance(state, tuple) else (state, {})
        vars(self).update(own or {})
        for name, value in slots.items():
            object.__setattr__(self, name, value)
        seal(self)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._shown()})"

    def _parts(self) -> Iterator[tuple[str, Any]]:
        """Arguments given to the constructor, as far as they are known and not the default."""
        for name, parameter in inspect.signature(type(self)).parameters.items():
            value = getattr(self, name, parameter.default)
            if not (isinstance(value, MethodType) or _same(value, parameter.default)):
                yield name, value

    #: of what :meth:`_parts` gives
    _units: ClassVar[dict[str, str]] = {
        **{"length": "m", "radius": "m", "position": "m", "E": "N/m²", "rho": "kg/m³"},
        **{"velocity": "m/s", "angular_velocity": "rad/s", "mass": "kg", "inertia": "kg m²"},
    }

    def summary(self) -> dict[str, Any]:
        """What it was made of, as far as it is known and not the default, with units."""
        parts = dict(self._parts())
        return {f"{n} in {self._units[n]}" if n in self._units else n: parts[n] for n in parts}

    def _shown(self) -> str:
        return ", ".join(f"{name}={brief(value)}" for name, value in self._parts())


def _same(value: Any, default: Any) -> bool:
    if value is default or value is inspect.Parameter.empty:
        return True
    if isinstance(value, np.ndarray) or isinstance(default, np.ndarray):
        return default is not None and np.array_equal(value, default)
    plain = (bool, int, float, str, tuple)
    return isinstance(value, plain) and isinstance(default, plain) and value == default


def _read_only(value: Any) -> Any:
    """Arrays, also in tuples, as copies that cannot be written to: the user keeps the original."""
    if type(value) is tuple and any(isinstance(each, _HELD) for each in value):
        return tuple(map(_read_only, value))
    if isinstance(value, np.ndarray) and value.flags.writeable:
        value = value.copy(order="K")
        value.flags.writeable = False
    return value


#: what may have to be copied
_HELD = (np.ndarray, tuple)


def seal(item: T) -> T:
    """From now on it cannot be changed; gives it back."""
    own = vars(item)
    for name, value in own.items():
        if isinstance(value, _HELD) and not name.startswith("_"):
            own[name] = _read_only(value)
    own["_sealed"] = True
    return item


def loosened(item: T) -> T:
    """A copy that nobody else has yet, which may be changed until it is sealed."""
    vars(item).pop("_sealed", None)
    return item


def lock_arrays(thing: object) -> None:
    """Arrays of what is no item, and belong to nobody else, cannot be written to any more."""
    for value in vars(thing).values():
        if isinstance(value, np.ndarray):
            value.flags.writeable = False


# --------------------------------------------------------------------------------------------------
# Copies of the items of a scene with some replaced: the copies refer to what stands for those.
#
# What refers to items or places is :class:`Attached` and knows how to copy itself so. Attributes,
# lists and tuples are gone through; functions, arrays, sections and motions are shared.


class Attached(Frozen):
    """Base of all that may refer to items or places of a model, directly or through others."""

    def with_replacements(self, replacements: Replacements) -> Self:
        """A copy that refers to the copies of what it refers to; :class:`Replacements` seals it.

        Parameters
        ----------
        replacements : Replacements
            Gives them.

        Raises
        ------
        InputError
            If there is no such place any more.
        """
        other = copy(self)
        vars(other).update({name: replacements.of(value) for name, value in vars(self).items()})
        return loosened(other)


class Replacements:
    """Copies of everything that refers to items, made when they are asked for.

    Parameters
    ----------
    replaced : mapping of object to object
        Items that are replaced, by others that stand for them.

    Examples
    --------
    >>> from skfem_cosserat import JointSpherical, RigidBody, ground
    >>> body, heavy = (RigidBody.sphere(mass, 0.1) for mass in (1.0, 5.0))
    >>> joint = JointSpherical(ground((0, 0, 0.1)), body.at((0, 0, 0.1)))
    >>> other = Replacements({body: heavy}).of(joint)
    >>> other.b.item is heavy, joint.b.item is body
    (True, True)
    """

    def __init__(self, replaced: Mapping[Any, Any]):
        # kept with the copies, or a number of identity might be taken again
        self._made = {id(old): (old, new) for old, new in replaced.items()}

    def of(self, value: Any) -> Any:
        """Its copy; what refers to nothing is given back."""
        if isinstance(value, Attached):
            if id(value) not in self._made:
                self._made[id(value)] = (value, seal(value.with_replacements(self)))
            return self._made[id(value)][1]
        if type(value) in (list, tuple):
            return type(value)(map(self.of, value))
        if type(value) is dict:
            return {key: self.of(each) for key, each in value.items()}
        return value
