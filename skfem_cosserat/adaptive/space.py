"""Meshes and orders of a scene, and which beam lies on which mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ..beam import Beam
from ..errors import InputError
from ..mesh import MeshCurve
from ..model import System
from .strategy import Change

__all__ = ["ALONE", "Meshes", "Space", "beams", "checked_space", "named", "owners", "whole"]

#: Name of a mesh that was given alone.
ALONE = "mesh"

Meshes: TypeAlias = MeshCurve | Mapping[str, MeshCurve]


@dataclass(eq=False)
class Space:
    """Meshes and their orders."""

    meshes: dict[str, MeshCurve]
    orders: dict[str, int]

    def richer(self, highest: int) -> Space:
        """One order more, or halved elements where there is none."""
        meshes = {
            k: m.refined() if self.orders[k] >= highest else m for k, m in self.meshes.items()
        }
        return Space(meshes, {k: min(p + 1, highest) for k, p in self.orders.items()})

    def richest(self, highest: int) -> Space:
        """Halved elements and one order more."""
        return Space({k: m.refined() for k, m in self.meshes.items()}, self.orders).richer(highest)

    def changed(self, change: Change) -> Space:
        """After a change."""
        meshes = {
            k: m.refined(change.marked[k]) if len(change.marked[k]) else m
            for k, m in self.meshes.items()
        }
        return Space(meshes, dict(change.orders))


def beams(system: System) -> list[Beam]:
    """Beams of a system."""
    return [item for item in system.structures if isinstance(item, Beam)]


def named(name: str) -> str:
    """How errors call a mesh."""
    return "mesh" if name == ALONE else f"mesh {name!r}"


def owners(system: System, meshes: Mapping[str, MeshCurve]) -> dict[str, str]:
    """The name of the mesh of each beam."""
    out = {}
    for beam in beams(system):
        names = [name for name, mesh in meshes.items() if beam.mesh is mesh]
        if not names:
            raise InputError(
                beam.label,
                "lies on a mesh of its own: build must put each beam on a mesh it is given, as it"
                " is, or its error would not be seen",
            )
        out[str(beam.name)] = names[0]
    return out


def whole(name: str, value: object, largest: int | None = None) -> None:
    """Refuse what is no positive integer up to a largest one."""
    integer = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not integer or value < 1 or (largest is not None and value > largest):  # type: ignore[operator]
        upto = "" if largest is None else f" up to {largest}"
        raise InputError(f"argument {name}", f"{value!r}, expected a positive integer{upto}")


def checked_space(mesh: Meshes, order: int | Mapping[str, int], highest: int) -> Space:
    """From the arguments of :func:`skfem_cosserat.adaptive.adapt`."""
    meshes = {ALONE: mesh} if not isinstance(mesh, Mapping) else dict(mesh)
    if not meshes:
        raise InputError("argument mesh", "there is none")
    for name, one in meshes.items():
        if not isinstance(one, MeshCurve):
            raise InputError(
                "argument mesh", f"{name!r} is {type(one).__name__}, expected MeshCurve: lines"
            )
    orders = dict(order) if isinstance(order, Mapping) else dict.fromkeys(meshes, order)
    if set(orders) != set(meshes):
        raise InputError("argument order", f"names {sorted(orders)}, expected {sorted(meshes)}")
    for value in orders.values():
        whole("order", value, highest)
    return Space(meshes, orders)
