"""Kinds of items, told apart without importing what a scene does not have."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeGuard

from .frames import LineItem

if TYPE_CHECKING:
    from .beam import Beam

__all__ = ["is_beam"]


def is_beam(item: object) -> TypeGuard[Beam]:
    """Whether an item is a beam; scenes without one import neither beams nor meshes.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint
    >>> is_beam(MassPoint(1.0))
    False
    """
    return isinstance(item, LineItem)
