"""Closed loops: rows of joints that are not in the spanning tree, in the tree's coordinates.

``C = G_loop P_tree`` (rows, K) is small: it couples the coordinates on the loops only and falls
into components. Of its rows, `rank` are independent; the others are redundant (a closed chain in
the plane built of spatial hinges has three). Which ones are kept is decided at the start of each
step by a QR factorisation with column pivoting of C^T, the *number* once: a loop may pass positions
where C loses rank, and must not change its mobility there.

Beams on loops may hold strains. Their rows come first in C, all of them: they are independent, and
rows of joints count as far as motions go that these leave free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import qr, solve_triangular
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..kernels import skew
from ..pattern import FrozenPattern, sum_at
from ..types import NO_INDICES, TOLERANCE, Array, Floats, IndexArray
from .kinematics import Kinematics
from .quadratic import QuadraticConstraints

#: smallest against largest diagonal entry of R below which a configuration counts as singular
SINGULAR = 1e-7


class RowsByTwists:
    """Constraint rows by the twists of vertices, ``G P_int``, entry by entry.

    Parameters
    ----------
    kinematics : Kinematics
    constraints : QuadraticConstraints
    rows : (r,) int array

    Attributes
    ----------
    row, twist : int arrays
        Where the entries are: `row` among those given.
    """

    def __init__(self, kinematics: Kinematics, constraints: QuadraticConstraints, rows: IndexArray):
        self._constraints = constraints
        self._shape = (len(rows), kinematics.n_twist)
        number = np.full(constraints.size, -1)
        number[rows] = np.arange(len(rows))
        which = constraints.inside[number[constraints.rows[constraints.inside]] >= 0]
        self._entries = np.searchsorted(constraints.inside, which)  # of the Jacobian's values
        row = number[constraints.rows[which]]
        y_row, component = np.divmod(constraints.cols[which], 3)
        turning = kinematics.row_is_director[y_row]
        self._plain = np.flatnonzero(~turning)
        self._turning = np.flatnonzero(turning)
        base = kinematics.row_twist[y_row]
        shifts = base[self._plain] + component[self._plain]
        turns = base[self._turning][:, None] + np.arange(3)
        self.row = np.concatenate([row[self._plain], np.repeat(row[self._turning], 3)])
        self.twist = np.concatenate([shifts, turns.ravel()])
        self._director = y_row[self._turning]
        self._component = component[self._turning]

    def values(self, y: Array) -> Array:
        """Entries at y (total, 3)."""
        if not len(self.row):
            return np.zeros(0, y.dtype)
        values = self._constraints.jacobian_values(y)[self._entries]
        # moment of a force e_c on a director: d x e_c
        arms = skew(y[self._director])[np.arange(len(self._director)), :, self._component]
        moments = arms * values[self._turning][:, None]
        return np.concatenate([values[self._plain], moments.ravel()])

    @cached_property
    def pattern(self) -> FrozenPattern:
        """Sparsity pattern of the matrix (r, twists) of the entries."""
        return FrozenPattern(self.row, self.twist, self._shape)


@dataclass(eq=False)
class CoupledLoops:
    """Rows and tree coordinates that are coupled with each other only."""

    rows: IndexArray  # among the loop rows
    columns: IndexArray  # tree coordinates
    scale: Floats  # columns: translations count relative to the scene's extent
    held: int = 0  # strains: the first rows, which are independent in any configuration
    rank: int = 0
    weakest: float = 1.0  # smallest pivot of the rows that count as independent

    @property
    def free(self) -> int:
        """Coordinates that the loops leave free."""
        return len(self.columns) - self.rank


@dataclass(eq=False)
class Selected:
    """Independent rows of one component at one configuration, factorised.

    ``C D = R^T Q1^T`` with the column scaling D; ``Z = D Q2`` spans the null space of C.
    """

    component: CoupledLoops
    local: IndexArray  # among the component's rows
    rows: IndexArray  # constraint row numbers
    R: Floats
    Q1: Floats
    _Q2: Floats | None = None  # None: whatever is normal to Q1

    @cached_property
    def Q2(self) -> Floats:
        """Orthonormal basis (columns, free) of what the rows leave free, scaled."""
        if self._Q2 is not None:
            return self._Q2
        return np.linalg.qr(self.Q1, mode="complete")[0][:, self.component.rank :]

    @property
    def pivots(self) -> Floats:
        """Sizes of the diagonal of R, of all rows but strains, against the largest of all."""
        d = abs(self.R.diagonal())
        return d[self.component.held :] / d.max(initial=1e-300)

    @property
    def independent(self) -> IndexArray:
        """Rows that are independent in this configuration, too: fewer in a singular one."""
        held = self.component.held
        return np.concatenate([self.rows[:held], self.rows[held:][self.pivots > SINGULAR]])

    @property
    def null(self) -> Floats:
        """Basis Z (columns, free)."""
        return self.component.scale[:, None] * self.Q2

    def correction(self, violation: Floats) -> Floats:
        """Shortest change (columns,) of the coordinates that removes a violation, to first order.

        Directions that a singular configuration does not see are left alone.
        """
        if (self.pivots > SINGULAR).all():
            step = self.Q1 @ solve_triangular(self.R, violation, trans="T")
        else:
            step = np.linalg.lstsq((self.Q1 @ self.R).T, violation, rcond=SINGULAR)[0]
        return -self.component.scale * step

    def multipliers(self, force: Floats) -> Floats:
        """Mu (rank,) with ``C^T mu`` nearest to a force on the columns."""
        if not (self.pivots > SINGULAR).all():
            scaled = self.component.scale * force
            nearest = np.linalg.lstsq(self.Q1 @ self.R, scaled, rcond=SINGULAR)[0]
            return np.asarray(nearest, float)
        return solve_triangular(self.R, self.Q1.T @ (self.component.scale * force))


class Closure:
    """Reduced rows of the joints that close loops.

    Parameters
    ----------
    kinematics : Kinematics
    constraints : QuadraticConstraints
    rows : (r,) int array
        Constraint rows of joints, and of elements of beams, that close loops.
    length : float
        Extent of the scene (m).
    strains : (s,) int array
        Rows of the other elements on loops that hold strains.

    Attributes
    ----------
    rows : (s + r,) int array
        Of strains, then the others.
    rank : int
        Independent rows; set by :meth:`decide`.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        constraints: QuadraticConstraints,
        rows: IndexArray,
        length: float,
        strains: IndexArray,
    ):
        self.kin = kinematics
        self._length = length
        self.rows = np.concatenate([strains, rows])
        self.components: list[CoupledLoops] = []
        self.magnitude = np.ones(len(self.rows))
        self._by_twists = RowsByTwists(kinematics, constraints, self.rows)
        if len(self.rows):
            self._split(len(strains))

    def _split(self, strains: int) -> None:
        """Into components: rows and coordinates that entries of ``G_loop P_int T`` connect."""
        kin, G, count = self.kin, self._by_twists.pattern, len(self.rows)
        order, cols, begin = kin.T.structure
        size = np.diff(begin)[self._twist]
        #: each entry of ``G_loop P_int`` with each of T in the row of its twist
        self._of_G = np.arange(G.nnz).repeat(size)
        place = np.arange(len(self._of_G)) + np.repeat(
            begin[self._twist] - size.cumsum() + size, size
        )
        self._of_T, row, col = order[place], G.indices[self._of_G], cols[place]
        graph = coo_matrix(
            (np.ones(len(row)), (row, count + col)), shape=(count + kin.unknowns,) * 2
        )
        _, label = connected_components(graph, directed=False)
        _, found, label = np.unique(label, return_index=True, return_inverse=True)
        label = found.argsort().argsort()[label]  # rows come first, so do their components
        of_row = label[:count]
        parts = int(label[:count].max()) + 1
        place, rows = _grouped(of_row, parts)
        column, columns = _grouped(label[count:], parts)
        scale = kin.scale(self._length)
        for own, among in zip(rows, columns, strict=True):
            held = int((own < strains).sum())
            self.components.append(CoupledLoops(own, among, scale[among], held))
        width = np.array([len(each) for each in columns])
        self._ends = np.cumsum([len(c.rows) * len(c.columns) for c in self.components])
        first = (self._ends - width * np.bincount(of_row))[of_row] + place * width[of_row]
        #: where their products go among the entries of all components' matrices
        self._where = first[row] + column[col]

    @property
    def rank(self) -> int:
        """Independent rows."""
        return sum(c.rank for c in self.components)

    # -- evaluation --------------------------------------------------------------------------------

    @property
    def _twist(self) -> IndexArray:
        """Twist of each entry of ``G_loop P_int``."""
        return self._by_twists.pattern.columns

    def _entries(self, y: Array) -> Array:
        return self._by_twists.pattern.data(self._by_twists.values(y))

    def matrices(self, y: Array, T: Array) -> list[Array]:
        """C (rows, columns) of each component at y, columns scaled; T are the tree's values."""
        if not self.components:
            return []
        every = sum_at(self._where, self._entries(y)[self._of_G] * T[self._of_T], self._ends[-1])
        return [
            part.reshape(len(c.rows), -1) * c.scale / self.magnitude[c.rows][:, None]
            for c, part in zip(self.components, np.split(every, self._ends[:-1]), strict=True)
        ]

    def decide(self, y: Array, T: Array) -> IndexArray:
        """Fix the rank at a configuration; gives the constraint rows that depend on others."""
        square = np.full(self.kin.n_twist, self._length**2)
        square[self.kin.frame_twist[:, 3:]] = 1.0
        terms = self._entries(y) ** 2 * square[self._twist]  # translations relative to the scene
        size = np.sqrt(np.bincount(self._by_twists.pattern.indices, terms, len(self.rows)))
        self.magnitude = np.where(size > 0, size, 1.0)
        redundant = [NO_INDICES]
        for c, C in zip(self.components, self.matrices(y, T), strict=True):
            order, d = pivoted(C, c.held)
            largest = max(1.0, d.max(initial=0.0))
            # rows with smaller pivots depend on others
            independent = int((d > TOLERANCE * largest).sum())
            c.rank = c.held + independent
            c.weakest = float(d[independent - 1] / largest) if independent else 1.0
            redundant.append(self.rows[c.rows[order[c.rank :]]])
        return np.sort(np.concatenate(redundant))

    def select(self, y: Array, T: Array) -> list[Selected]:
        """Independent rows of each component at the start of a step."""
        matrices = zip(self.components, self.matrices(y, T), strict=True)
        return [self._factor(c, C, pivoted(C, c.held)[0][: c.rank]) for c, C in matrices]

    def again(self, chosen: Sequence[Selected], y: Array, T: Array) -> list[Selected]:
        """Factors of the chosen rows at another configuration of the step."""
        matrices = zip(chosen, self.matrices(y, T), strict=True)
        return [self._factor(s.component, C, s.local) for s, C in matrices]

    def _factor(self, c: CoupledLoops, C: Array, local: IndexArray) -> Selected:
        rows = self.rows[c.rows[local]]
        if c.held:  # of many rows, which most callers ask for no more
            Q, R = np.linalg.qr(C[local].T)
            return Selected(c, local, rows, R, Q)
        Q, R = np.linalg.qr(C[local].T, mode="complete")
        return Selected(c, local, rows, R[: c.rank], Q[:, : c.rank], Q[:, c.rank :])

    def null_pattern(self) -> tuple[IndexArray, IndexArray, int]:
        """Rows and columns of the entries of Z, and how many of the first ones are 1."""
        apart = np.ones(self.kin.unknowns, bool)
        for c in self.components:
            apart[c.columns] = False
        single = np.flatnonzero(apart)
        rows = [single]
        cols = [np.arange(len(single))]
        start = len(single)
        for c in self.components:
            free = start + np.arange(c.free)
            rows.append(c.columns.repeat(c.free))
            cols.append(np.tile(free, len(c.columns)))
            start += c.free
        return np.concatenate(rows), np.concatenate(cols), len(single)

    def null_values(self, selected: list[Selected], ones: int) -> Floats:
        """Entries of Z at :meth:`null_pattern`."""
        return np.concatenate([np.ones(ones), *(s.null.ravel() for s in selected)])

    def violation(self, s: Selected, g: Floats) -> Floats:
        """G of the selected rows in the scaling of the factorisation."""
        return g[s.rows] / self.magnitude[s.component.rows[s.local]]

    def multipliers(self, s: Selected, force: Floats) -> tuple[IndexArray, Floats]:
        """Constraint rows and multipliers that balance a force (K,) of the tree best."""
        size = self.magnitude[s.component.rows[s.local]]
        return s.rows, s.multipliers(force[s.component.columns]) / size


def _grouped(label: IndexArray, count: int) -> tuple[IndexArray, list[IndexArray]]:
    """Place of each in its group, and the members of the groups 0 to count - 1, in order."""
    order = label.argsort(kind="stable")
    starts = np.searchsorted(label[order], np.arange(count + 1))
    place = np.zeros(len(label), np.int64)
    known = order[: starts[-1]]
    place[known] = np.arange(len(known)) - starts[label[known]]
    return place, np.split(order, starts[1:])[:count]


def pivoted(C: Array, held: int) -> tuple[IndexArray, Array]:
    """Order of the rows of C by QR of C^T with pivoting, and sizes of the pivots.

    The first ones, as many as are held, stay first; the pivots are those of the others.
    """
    if held:
        Q, _ = np.linalg.qr(C[:held].T)
        order, pivots = pivoted(C[held:] - (C[held:] @ Q) @ Q.T, 0)
        return np.concatenate([np.arange(held), held + order]), pivots
    R, order = qr(C.T, mode="r", pivoting=True, check_finite=False)
    return order, abs(np.diagonal(R))


def continued(selected: Selected, before: Floats) -> Selected:
    """In a singular configuration: with the null directions nearest to those of `before`.

    C has more null directions there than the mechanism has degrees of freedom; the motion goes on
    along the branch it came from.
    """
    bad = int((selected.pivots <= SINGULAR).sum())
    if not bad:
        return selected
    c = selected.component
    _, _, V = np.linalg.svd((selected.Q1 @ selected.R).T)
    N = V[c.rank - bad :].T  # all null directions
    U, _, _ = np.linalg.svd(N.T @ before)
    return directed(selected, N @ U[:, : c.free])


def directed(selected: Selected, Q2: Floats) -> Selected:
    """Factors of selected rows with other null directions (columns, free), orthonormal."""
    c = selected.component
    Q1 = np.linalg.qr(np.column_stack([Q2, selected.Q1]), mode="complete")[0][:, c.free :]
    return Selected(c, selected.local, selected.rows, Q1.T @ selected.Q1 @ selected.R, Q1, Q2)
