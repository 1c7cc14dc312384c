"""Copies of the items of a scene with some replaced: the copies refer to what stands for those.

What refers to items or places is :class:`Attached` and knows how to copy itself so. Attributes,
lists and tuples are gone through; functions, arrays, sections and motions are shared.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import Any, Self

from .frozen import Frozen, loosened, seal

__all__ = ["Attached", "Replacements"]


class Attached(Frozen):
    """What may refer to items or places of a model, directly or through others."""

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

    def __init__(self, replaced: Mapping[Any, Any]) -> None:
        # kept with the copies, or a number of identity might be taken again
        self._made = {id(old): (old, new) for old, new in replaced.items()}

    def of(self, value: Any) -> Any:
        """Its copy; what refers to nothing is given back."""
        if isinstance(value, Attached):
            if id(value) not in self._made:
                self._made[id(value)] = (value, seal(value.with_replacements(self)))
            return self._made[id(value)][1]
        if type(value) in (list, tuple):
            return type(value)(self.of(each) for each in value)
        if type(value) is dict:
            return {key: self.of(each) for key, each in value.items()}
        return value
