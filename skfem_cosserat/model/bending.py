"""Elements bent so far that they give way: why Newton's method fails on a mesh too coarse."""

from __future__ import annotations

import numpy as np

from ..kinds import is_beam
from ..types import Floats
from .system import System

__all__ = ["bent_elements"]


def bent_elements(system: System, y: Floats) -> str | None:
    """Elements that turn, against the reference, by more than they can be bent on their own.

    The directors are interpolated, so the bending of a linear element between nodes at an angle t
    is sin(t)/l: its moment EI sin(2 t)/(2 l) peaks at 45 degrees, and a fold of 180 costs nothing.
    Higher orders give way later, see :attr:`skfem_cosserat.element.Interpolation.turn_limit`.
    Torsion counts like bending. The angle of an element is the sum of those between its
    neighbouring nodes, each below 180 degrees.

    Parameters
    ----------
    y : (rows or more, 3) array
        Configuration: the rows of a state q, or all rows from ``system.extend``.

    Returns
    -------
    str or None
        The worst element with its nodes and the angle; None if all are within their limits.

    Examples
    --------
    A straight beam of two linear elements, bent to a right angle by its end:

    >>> from skfem_cosserat import Beam, MeshCurve, Model, Section
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> model = Model()
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 2), 2)
    >>> beam = model.add("boom", Beam(mesh, section, director=(1, 0, 0)))
    >>> system = model.freeze()
    >>> y = system.q0.reshape(-1, 3)
    >>> print(bent_elements(system, y))
    None
    >>> y[9:12] = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])
    >>> bent_elements(system, y).partition(",")[0]
    "relative rotation between nodes 1 and 2 of beam 'boom' is 90 degrees"
    """
    beams = [item for item in system.structures if is_beam(item)]
    if not beams:
        return None
    from ..mesh.bends import gives_way, turns

    worst, text = 1.0, None
    for beam in beams:
        basis = beam.basis
        row = system.first[id(beam)][1]
        nodal = y[row : row + 4 * basis.n_nodes].reshape(-1, 4, 3)[:, 1:]
        now, then = (_steps(triads[basis.connectivity]) for triads in (nodal, beam.triads))
        angle = turns(then, now).sum(axis=1).round(9)
        ratio = float(angle.max()) / basis.interpolation.turn_limit
        if ratio > worst:
            a, b = basis.connectivity[int(angle.argmax())][[0, -1]]
            worst = ratio
            text = (
                f"relative rotation between nodes {a} and {b} of {beam.label} is"
                f" {gives_way(basis.interpolation, angle)}"
            )
    return text


def _steps(triads: Floats) -> Floats:
    """Rotations from node to node (ne, p, 3, 3) in the nodes' own frames: (ne, p + 1, 3, 3)."""
    return np.asarray(triads[:, 1:] @ np.swapaxes(triads[:, :-1], -1, -2))
