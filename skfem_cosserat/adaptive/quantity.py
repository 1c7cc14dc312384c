"""Quantities of interest: what a mesh is refined for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ..beam import Beam
from ..errors import InputError
from ..model import System
from ..types import ArrayLike, Floats, VectorLike, numbers

__all__ = ["NodePosition", "Quantity", "gradient", "value_of"]

#: Function of a system and a configuration (n,): a number, or a row of numbers of one unit.
Quantity: TypeAlias = Callable[[System, Floats], ArrayLike]

#: step of difference quotients, relative to the extent of the scene for positions
SMALL = 1e-5


@dataclass(frozen=True)
class NodePosition:
    """Where a named node of a beam is (m).

    Parameters
    ----------
    beam : str
        Name of the beam in the model.
    node : str
        Name of the node in its mesh.
    direction : (3,) array, optional
        Only the component along it; default: all three.

    Raises
    ------
    InputError
        When asked, if the system has no such beam.
    MeshError
        If its mesh has no such node.

    Examples
    --------
    >>> from skfem_cosserat import Model, MeshCurve, Section
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> model = Model()
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4, name="rod")
    >>> rod = model.add("boom", Beam(mesh, section))
    >>> system = model.freeze()
    >>> NodePosition("boom", "rod.end")(system, system.q0).tolist()
    [0.0, 2.0, 0.0]
    """

    beam: str
    node: str
    direction: VectorLike | None = None

    def __call__(self, system: System, q: Floats) -> Floats:
        """The position (3,), or one component (1,)."""
        beams = {item.name: item for item in system.structures if isinstance(item, Beam)}
        if self.beam not in beams:
            raise InputError(
                "quantity", f"unknown beam {self.beam!r}; known: {sorted(map(str, beams))}"
            )
        at = system.offset(beams[self.beam].node(self.node))
        x = np.asarray(q, dtype=float)[at : at + 3]
        return x if self.direction is None else np.array([x @ np.asarray(self.direction)])


def value_of(quantity: Quantity, system: System, q: Floats) -> Floats:
    """The quantity (k,) at one configuration, checked."""
    found = numbers("quantity", "value", quantity(system, q))
    value = np.atleast_1d(found)
    if value.ndim != 1 or not value.size or not np.isfinite(value).all():
        raise InputError("quantity", f"gave {value!r}, expected one or more finite numbers")
    return value


def gradient(quantity: Quantity, system: System, q: Floats, along: Floats) -> Floats:
    """Derivative (n,) of the component of a quantity along a vector (k,), by differences.

    Central ones, coordinate by coordinate: their error is of second order, far below the parts of
    a sum of shares that matter.
    """
    out = np.empty(system.n)
    steps = np.full((system.rows, 3), SMALL)
    steps[system.origin_rows] *= system.length
    moved = np.array(q, dtype=float)
    for k, h in enumerate(steps.ravel()):
        ends = []
        for sign in (1.0, -1.0):
            moved[k] = q[k] + sign * h
            ends.append(along @ value_of(quantity, system, moved))
        moved[k] = q[k]
        out[k] = (ends[0] - ends[1]) / (2 * h)
    return out
