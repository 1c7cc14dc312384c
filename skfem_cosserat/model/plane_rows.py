"""Constraint rows of a scene in a plane: which act there, and which of them are independent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix

from ..errors import InputError
from ..joint import JointDrive
from ..kernels import cross
from ..types import TOLERANCE, Floats, IndexArray
from .closure import pivoted
from .theories import HeldElement, rows_of

if TYPE_CHECKING:
    from .system import System

#: numbers of a triad's rows 11, 22, 33, 12, 13, 23 in which a director does not occur
_WITHOUT = np.array([[1, 2, 5], [0, 2, 4], [0, 1, 3]])


def coordinates_in_plane(system: System) -> csr_matrix:
    """Matrix (n, count): all coordinates by those that change in the plane, two for a row of y."""
    plane = system.plane
    assert plane is not None
    rows = plane.moving(system.q0.reshape(-1, 3), system.origin_rows)
    count = 2 * len(rows)
    places = 3 * rows[:, None] + np.arange(3)
    i = np.repeat(places[:, :, None], 2, axis=2).ravel()
    j = np.repeat(np.arange(count).reshape(-1, 1, 2), 3, axis=1).ravel()
    values = np.broadcast_to(plane.axes.T, (len(rows), 3, 2)).ravel()
    return csr_matrix((values, (i, j)), shape=(system.n, count))


def rows_in_plane(system: System) -> IndexArray:
    """Constraint rows that act in the plane, independent of each other; of closed loops all.

    Of triads and joints of the tree one by one, where the reference is. They stay independent: all
    turns about the normal of the plane.

    Raises
    ------
    InputError
        If they do not leave what the joints leave free.
    """
    along = coordinates_in_plane(system)
    count = along.shape[1]
    y = system.extend(system.q0, 0.0)
    G = (system.constraints.jacobian(y) @ along).tocsr()
    kept = _of_triads(system, G, y)
    held = (system.constraints.jacobian(y) @ _rigid(system, y)).tocsr()
    loops = {id(joint) for joint in system.tree.loops}
    rows: dict[int, list[IndexArray]] = {}
    for jr in system.joint_rows:
        joint = jr.joint.joint if isinstance(jr.joint, JointDrive) else jr.joint
        rows.setdefault(id(joint), []).append(np.arange(jr.rows.start, jr.rows.stop))
    for joint_id, numbers in rows.items():
        if joint_id not in loops:
            kept.append(_pick(held, np.concatenate(numbers)))
    for each in system.theory_rows:
        open_rows = np.setdiff1d(each.numbers, system.closure.rows)
        elements = (open_rows - each.rows.start) // (each.shape[1] * each.shape[2])
        kept += [_pick(held, open_rows[elements == e]) for e in np.unique(elements)]
    out = np.sort(np.concatenate([np.zeros(0, dtype=np.int64), *kept]))
    free = system.kinematics.unknowns - len(system.held_rows)
    if count - len(out) != free:
        raise InputError(
            "planar scene",
            f"{count} coordinates less {len(out)} constraints in the plane are not the"
            f" {free} unknowns of its joints: use NullSpace()",
        )
    return np.union1d(out, system.closure.rows)


def acting(system: System, elements: Sequence[HeldElement]) -> IndexArray:
    """Constraint rows of elements that hold strains; of a scene in a plane those that act in it."""
    rows = rows_of(elements)
    if system.plane is None or not len(rows):
        return rows
    y = system.spanned
    held = (system.constraints.jacobian(y) @ _rigid(system, y)).tocsr()
    return np.concatenate([_pick(held, each.numbers[e].ravel()) for each, e in elements])


def _of_triads(system: System, G: csr_matrix, y: Floats) -> list[IndexArray]:
    """Rows of triads: those without the director along the normal, if one is."""
    kin, plane = system.kinematics, system.plane
    assert plane is not None
    still = np.linalg.norm(kin.directors(y) @ plane.axes.T, axis=2) <= TOLERANCE
    first = 6 * np.arange(len(still))
    kept = [(first[still[:, k]][:, None] + others).ravel() for k, others in enumerate(_WITHOUT)]
    oblique = first[~still.any(axis=1)]
    return [*kept, *(_pick(G, np.arange(k, k + 6)) for k in oblique)]


def _rigid(system: System, y: Floats) -> csr_matrix:
    """Rates (n, 3 a frame or 2 a point) of each vertex by itself, rotations by length."""
    kin, plane = system.kinematics, system.plane
    assert plane is not None
    first = 3 * np.arange(len(system.origin_rows))
    rows, cols, values = [], [], []

    def add(row: IndexArray, column: IndexArray, rate: Floats) -> None:
        rows.append((3 * row[:, None] + np.arange(3)).ravel())
        cols.append(np.repeat(column, 3))
        values.append(np.broadcast_to(rate, (len(row), 3)).ravel())

    for k, axis in enumerate(plane.axes):
        add(system.origin_rows, first + k, system.length * axis)
    for i in range(3):
        row = kin.director_rows[:, i]
        add(row, first[kin.frames] + 2, cross(plane.normal, y[row]))
    ij = np.concatenate(rows), np.concatenate(cols)
    shape = (system.n, 3 * len(first))
    return coo_matrix((np.concatenate(values), ij), shape=shape).tocsr()


def _pick(matrix: csr_matrix, rows: IndexArray) -> IndexArray:
    """Some of the rows that are independent and span all of them."""
    part = matrix[rows]
    columns = np.unique(part.indices)
    if not len(columns):
        return rows[:0]
    order, d = pivoted(part[:, columns].toarray(), 0)
    return np.sort(rows[order[: int((d > TOLERANCE * max(1.0, d.max())).sum())]])
