"""Twins: the items of a scene once more, some of them replaced and the others referring to those.

What refers to items or places is :class:`Attached` and knows how to make its twin. The walk goes
through attributes, lists and tuples; functions, arrays, sections and motions are shared.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import Any, Self

__all__ = ["Attached", "Twins"]


class Attached:
    """What may refer to items or places of a model, directly or through others."""

    def twin(self, twins: Twins) -> Self:
        """The same thing on the twins of what it refers to.

        Parameters
        ----------
        twins : Twins
            Gives them.

        Raises
        ------
        InputError
            If there is no such place any more.
        """
        other = copy(self)
        vars(other).update({name: twins.of(value) for name, value in vars(self).items()})
        return other


class Twins:
    """Twins of everything that refers to items, made when they are asked for.

    Parameters
    ----------
    replaced : mapping of object to object
        Items that are replaced, by others that stand for them.

    Examples
    --------
    >>> from skfem_cosserat import JointSpherical, RigidBody, ground
    >>> body, heavy = (RigidBody.sphere(mass, 0.1) for mass in (1.0, 5.0))
    >>> joint = JointSpherical(ground((0, 0, 0.1)), body.at((0, 0, 0.1)))
    >>> other = Twins({body: heavy}).of(joint)
    >>> other.b.item is heavy, joint.b.item is body
    (True, True)
    """

    def __init__(self, replaced: Mapping[Any, Any]) -> None:
        # kept with the twins, or a number of identity might be taken again
        self._made = {id(old): (old, new) for old, new in replaced.items()}

    def of(self, value: Any) -> Any:
        """Its twin; what refers to nothing is given back."""
        if isinstance(value, Attached):
            if id(value) not in self._made:
                self._made[id(value)] = (value, value.twin(self))
            return self._made[id(value)][1]
        if type(value) in (list, tuple):
            return type(value)(self.of(each) for each in value)
        if type(value) is dict:
            return {key: self.of(each) for key, each in value.items()}
        return value
