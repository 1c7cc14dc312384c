"""Unknowns with multipliers in one plane: coordinates and constraint rows that act there.

The unknowns are the components along the plane of positions and directors, less those of directors
along its normal, and the multipliers of constraint rows that are independent of each other there.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import qr
from scipy.sparse import coo_matrix, csr_matrix

from ..drive import JointDrive
from ..errors import InputError
from ..frames import TOLERANCE
from ..kernels import cross
from ..model import System
from ..pattern import FrozenPattern
from ..types import Array, Floats, IndexArray

__all__ = ["Restriction"]

#: numbers of a triad's rows 11, 22, 33, 12, 13, 23 in which a director does not occur
_WITHOUT = np.array([[1, 2, 5], [0, 2, 4], [0, 1, 3]])
#: of rows that count as independent in the plane, relative
RANK = 1e-9


class Restriction:
    """Map from the unknowns in the plane to all n + m.

    Parameters
    ----------
    system : System
        Confined to a plane.
    pattern : FrozenPattern
        Of the matrix of all n + m unknowns.

    Attributes
    ----------
    count : int
        Coordinates in the plane, the first of the unknowns.
    kept : (k,) int array
        Constraint rows that act in the plane; those that close loops are all there.
    pattern : FrozenPattern
        Of the matrix of the unknowns in the plane.
    """

    def __init__(self, system: System, pattern: FrozenPattern) -> None:
        self.system = system
        n, plane = system.n, system.plane
        assert plane is not None
        rows = plane.moving(system.q0.reshape(-1, 3), system.origin_rows)
        self.count = 2 * len(rows)
        number = np.full((n + system.m, 2), -1)
        weight = np.zeros((n + system.m, 2))
        places = 3 * rows[:, None] + np.arange(3)
        number[places] = 2 * np.arange(len(rows))[:, None, None] + np.arange(2)
        weight[places] = plane.axes.T
        #: coordinates (n, count) by those in the plane
        self.along = _matrix(number[:n], weight[:n], self.count)
        self.kept = self._independent_rows()
        number[n + self.kept, 0] = self.count + np.arange(len(self.kept))
        weight[n + self.kept, 0] = 1.0
        size = self.count + len(self.kept)
        self._all = _matrix(number, weight, size)
        self._back, self._to_plane = self._all.T.tocsr(), self.along.T.tocsr()
        self._reduce(pattern, number, weight, size)

    def _reduce(self, full: FrozenPattern, number: IndexArray, weight: Floats, size: int) -> None:
        """Pattern of ``E^T A E``, and the matrix that takes the entries of A to it."""
        i, j = full.indices, np.repeat(np.arange(full.shape[1]), np.diff(full.indptr))
        rows, cols, source, factor = [], [], [], []
        for a in range(2):
            for b in range(2):
                both = weight[i, a] * weight[j, b]
                there = np.flatnonzero(both)
                rows.append(number[i[there], a])
                cols.append(number[j[there], b])
                source.append(there)
                factor.append(both[there])
        self.pattern = FrozenPattern(np.concatenate(rows), np.concatenate(cols), (size, size))
        places = self.pattern.slot, np.concatenate(source)
        shape = self.pattern.nnz, full.nnz
        self._data = csr_matrix((np.concatenate(factor), places), shape=shape)

    def data(self, full: Floats) -> Floats:
        """Entries in :attr:`pattern` from those of the full matrix."""
        return np.asarray(self._data @ full)

    def restrict(self, residual: Array) -> Array:
        """``E^T r`` of (n + m,) or (n,) numbers."""
        back = self._to_plane if len(residual) == self.system.n else self._back
        return np.asarray(back @ residual)

    def expand(self, unknowns: Array) -> Array:
        """``E u`` (n + m,)."""
        return np.asarray(self._all @ unknowns)

    def within(self, force: Array) -> Array:
        """Part in the plane of a force (n,)."""
        return np.asarray(self.along @ (self._to_plane @ force))

    # -- rows --------------------------------------------------------------------------------------

    def _independent_rows(self) -> IndexArray:
        """Of triads and joints of the tree one by one, where the reference is; then those of loops.

        They stay independent: all turns about the normal of the plane.
        """
        system = self.system
        y = system.extend(system.q0, 0.0)
        G = (system.constraints.jacobian(y) @ self.along).tocsr()
        kept = self._of_triads(G, y)
        held = (G @ self._rigid(y)).tocsr()
        loops = {id(joint) for joint in system.tree.loops}
        rows: dict[int, list[IndexArray]] = {}
        for jr in system.joint_rows:
            joint = jr.joint.joint if isinstance(jr.joint, JointDrive) else jr.joint
            rows.setdefault(id(joint), []).append(np.arange(jr.rows.start, jr.rows.stop))
        for joint_id, numbers in rows.items():
            if joint_id not in loops:
                kept.append(_pick(held, np.concatenate(numbers)))
        for each in system.rung_rows:
            open_rows = np.setdiff1d(each.numbers, system.closure.rows)
            elements = (open_rows - each.rows.start) // (each.shape[1] * each.shape[2])
            kept += [_pick(held, open_rows[elements == e]) for e in np.unique(elements)]
        out = np.sort(np.concatenate([np.zeros(0, dtype=np.int64), *kept]))
        if self.count - len(out) != system.kinematics.unknowns:
            raise InputError(
                "planar scene",
                f"{self.count} coordinates less {len(out)} constraints in the plane are not the"
                f" {system.kinematics.unknowns} unknowns of its joints: use NullSpace()",
            )
        return np.union1d(out, system.closure.rows)

    def _of_triads(self, G: csr_matrix, y: Floats) -> list[IndexArray]:
        """Rows of triads: those without the director along the normal, if one is."""
        kin, plane = self.system.kinematics, self.system.plane
        assert plane is not None
        still = np.linalg.norm(kin.directors(y) @ plane.axes.T, axis=2) <= TOLERANCE
        first = 6 * np.arange(len(still))
        kept = [(first[still[:, k]][:, None] + others).ravel() for k, others in enumerate(_WITHOUT)]
        oblique = first[~still.any(axis=1)]
        return [*kept, *(_pick(G, np.arange(k, k + 6)) for k in oblique)]

    def _rigid(self, y: Floats) -> csr_matrix:
        """Rates (count, 3 a frame or 2 a point) of each vertex by itself, rotations by length."""
        system = self.system
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
        return self.along.T @ coo_matrix((np.concatenate(values), ij), shape=shape).tocsr()


def _pick(matrix: csr_matrix, rows: IndexArray) -> IndexArray:
    """Some of the rows that are independent and span all of them."""
    part = matrix[rows]
    columns = np.unique(part.indices)
    if not len(columns):
        return rows[:0]
    dense = part[:, columns].toarray()
    _, R, order = qr(dense.T, mode="economic", pivoting=True)
    d = abs(np.diagonal(R))
    return np.sort(rows[order[: int((d > RANK * max(1.0, d.max())).sum())]])


def _matrix(number: IndexArray, weight: Floats, columns: int) -> csr_matrix:
    """Matrix of weights (rows, 2) at columns of these numbers."""
    i, k = np.nonzero(weight)
    shape = len(weight), columns
    return csr_matrix((weight[i, k], (i, number[i, k])), shape=shape)
