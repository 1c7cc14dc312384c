"""Closed loops: rows of joints that are not in the spanning tree, in the tree's coordinates.

``C = G_loop P_tree`` (rows, K) is small: it couples the coordinates on the loops only and falls
into components. Of its rows, `rank` are independent; the others are redundant (a closed chain in
the plane built of spatial hinges has three). Which ones are kept is decided at the start of each
step by a QR factorisation with column pivoting of C^T, the *number* once: a loop may pass positions
where C loses rank, and must not change its mobility there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr, solve_triangular
from scipy.linalg.lapack import dgeqp3, dgeqrf, dorgqr
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..kernels import skew
from ..pattern import sum_at
from ..types import Array, Floats, IndexArray
from .kinematics import Kinematics
from .quadratic import QuadraticConstraints

RANK_TOLERANCE = 1e-9
#: smallest against largest diagonal entry of R below which a configuration counts as singular
SINGULAR = 1e-7


@dataclass(eq=False)
class CoupledLoops:
    """Rows and tree coordinates that are coupled with each other only."""

    rows: IndexArray  # among the loop rows
    columns: IndexArray  # tree coordinates
    twists: IndexArray  # among the columns of Closure.by_twists
    entries: tuple[IndexArray, IndexArray]  # of T: which, and where in (twists, columns)
    scale: Floats  # columns: translations count relative to the scene's extent
    rank: int = 0
    weakest: float = 1.0  # smallest pivot of the rows that count as independent

    @property
    def free(self) -> int:
        """Coordinates that the loops leave free."""
        return len(self.columns) - self.rank


@dataclass(eq=False)
class Selected:
    """Independent closure rows of one component at one configuration, factorised.

    ``C D = R^T Q1^T`` with the column scaling D; ``Z = D Q2`` spans the null space of C.
    """

    component: CoupledLoops
    local: IndexArray  # among the component's rows
    rows: IndexArray  # constraint row numbers
    R: Floats
    Q1: Floats
    Q2: Floats

    @property
    def pivots(self) -> Floats:
        """Sizes of the diagonal of R against the largest."""
        d = abs(np.diagonal(self.R))
        return np.asarray(d / d.max(initial=1e-300))

    @property
    def null(self) -> Floats:
        """Basis Z (columns, free)."""
        return self.component.scale[:, None] * self.Q2

    def correction(self, violation: Floats) -> Floats:
        """Shortest change (columns,) of the coordinates that removes a violation, to first order.

        Directions that a singular configuration does not see are left alone.
        """
        ok = self.pivots > SINGULAR
        if ok.all():
            step = self.Q1 @ solve_triangular(self.R, violation, trans="T")
        else:
            step = np.linalg.lstsq((self.Q1 @ self.R).T, violation, rcond=SINGULAR)[0]
        return np.asarray(-self.component.scale * step)

    def multipliers(self, force: Floats) -> Floats:
        """Mu (rank,) with ``C^T mu`` nearest to a force on the columns."""
        if not (self.pivots > SINGULAR).all():
            scaled = self.component.scale * force
            nearest = np.linalg.lstsq(self.Q1 @ self.R, scaled, rcond=SINGULAR)[0]
            return np.asarray(nearest, dtype=float)
        return np.asarray(solve_triangular(self.R, self.Q1.T @ (self.component.scale * force)))


class Closure:
    """Reduced rows of the joints that close loops.

    Parameters
    ----------
    kinematics : Kinematics
    constraints : QuadraticConstraints
    rows : (r,) int array
        Numbers of the loop joints' constraint rows.
    length : float
        Extent of the scene (m).

    Attributes
    ----------
    rank : int
        Independent rows; set by :meth:`decide`.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        constraints: QuadraticConstraints,
        rows: IndexArray,
        length: float,
    ) -> None:
        self.kin, self.constraints, self.rows = kinematics, constraints, rows
        number = np.full(constraints.size, -1)
        number[rows] = np.arange(len(rows))
        which = constraints.inside[number[constraints.rows[constraints.inside]] >= 0]
        position = np.searchsorted(constraints.inside, which)
        self._entries = position  # among the values of the Jacobian
        self._row = number[constraints.rows[which]]
        y_row, component = np.divmod(constraints.cols[which], 3)
        turning = kinematics.row_is_director[y_row]
        self._plain, self._turning = np.flatnonzero(~turning), np.flatnonzero(turning)
        base = kinematics.row_twist[y_row]
        plain_twist = base[self._plain] + component[self._plain]
        turning_twist = (base[self._turning][:, None] + np.arange(3)).ravel()
        #: twists of the vertices on loops: the only columns of :meth:`by_twists`
        self._twists = np.unique(np.concatenate([plain_twist, turning_twist]))
        #: translations count relative to the scene's extent, here and among the coordinates
        shifts = ~np.isin(self._twists, kinematics.frame_twist[:, 3:])
        self._twist_scale = np.where(shifts, length, 1.0)
        count = len(self._twists)
        self._plain_at = self._row[self._plain] * count + np.searchsorted(self._twists, plain_twist)
        turning_row = np.repeat(self._row[self._turning], 3)
        self._turning_at = turning_row * count + np.searchsorted(self._twists, turning_twist)
        self._director = y_row[self._turning]
        self._component = component[self._turning]
        scale = np.ones(kinematics.unknowns)
        for c in kinematics.tree.coordinates:
            if c.kind in ("translation", "slide"):
                scale[c.number] = length
        self.components = self._split(scale)
        self.magnitude: Floats = np.ones(len(rows))

    def _split(self, scale: Floats) -> list[CoupledLoops]:
        kin = self.kin
        r, K, nt = len(self.rows), kin.unknowns, kin.n_twist
        if not r:
            return []
        row, twist = np.divmod(
            np.concatenate([self._plain_at, self._turning_at]), max(1, len(self._twists))
        )
        twist = self._twists[twist]
        # bipartite graph of rows and coordinates
        ones = np.ones(len(row))
        B = coo_matrix((ones, (row, twist)), shape=(r, nt)).tocsr()
        T = kin.T.matrix(np.ones(len(kin.T.rows)))
        C = (B @ T).tocoo()
        graph = coo_matrix((np.ones(C.nnz), (C.row, r + C.col)), shape=(r + K, r + K))
        _, label = connected_components(graph, directed=False)
        out = []
        for name in np.unique(label[:r]):
            rows = np.flatnonzero(label[:r] == name)
            columns = np.flatnonzero(label[r:] == name)
            twists = np.unique(B[rows].indices)
            at_twist, at_column = np.full(nt, -1), np.full(K, -1)
            at_twist[twists], at_column[columns] = np.arange(len(twists)), np.arange(len(columns))
            i, j = at_twist[kin.T.rows], at_column[kin.T.cols]
            which = np.flatnonzero((i >= 0) & (j >= 0))
            where = i[which] * len(columns) + j[which]
            at = np.searchsorted(self._twists, twists)
            out.append(CoupledLoops(rows, columns, at, (which, where), scale[columns]))
        return out

    @property
    def rank(self) -> int:
        """Independent rows."""
        return sum(c.rank for c in self.components)

    # -- evaluation --------------------------------------------------------------------------------

    def by_twists(self, y: Array) -> Array:
        """``B = G_loop P_int`` (r, twists), dense, of the vertices on loops."""
        values = self.constraints.jacobian_values(y)[self._entries]
        # moment of a force e_c on a director: d x e_c
        arms = skew(y[self._director])[np.arange(len(self._director)), :, self._component]
        moments = arms * values[self._turning][:, None]
        where = np.concatenate([self._plain_at, self._turning_at])
        weights = np.concatenate([values[self._plain], moments.ravel()])
        shape = (len(self.rows), len(self._twists))
        return sum_at(where, weights, shape[0] * shape[1]).reshape(shape)

    def matrices(self, y: Array, T: Array) -> list[Array]:
        """C (rows, columns) of each component at y, columns scaled; T are the tree's values."""
        B = self.by_twists(y)
        out = []
        for c in self.components:
            which, where = c.entries
            flat = sum_at(where, T[which], len(c.twists) * len(c.columns))
            local = B[c.rows[:, None], c.twists] @ flat.reshape(len(c.twists), len(c.columns))
            out.append(local * c.scale / self.magnitude[c.rows][:, None])
        return out

    def decide(self, y: Array, T: Array) -> list[tuple[CoupledLoops, IndexArray, Floats]]:
        """Fix the rank at a configuration.

        Returns
        -------
        list of (component, rows, coefficients)
            Of each redundant row of the component: its number among the component's rows, and the
            combination of its rows that vanishes.
        """
        twist = np.linalg.norm(self.by_twists(y) * self._twist_scale, axis=1)
        self.magnitude = np.where(twist > 0, twist, 1.0)
        redundant = []
        for c, C in zip(self.components, self.matrices(y, T), strict=True):
            _, R, order = qr(C.T, mode="economic", pivoting=True)
            d = abs(np.diagonal(R))
            largest = max(1.0, d.max(initial=0.0))
            c.rank = int((d > RANK_TOLERANCE * largest).sum())
            c.weakest = float(d[c.rank - 1] / largest) if c.rank else 1.0
            dropped = order[c.rank :]
            if len(dropped):
                kept = order[: c.rank]
                combination = np.zeros((len(dropped), len(c.rows)))
                combination[np.arange(len(dropped)), dropped] = 1.0
                if c.rank:
                    combination[:, kept] = -np.linalg.lstsq(C[kept].T, C[dropped].T, rcond=None)[
                        0
                    ].T
                redundant.append((c, dropped, combination))
        return redundant

    def select(self, y: Array, T: Array) -> list[Selected]:
        """Independent rows of each component at the start of a step."""
        out = []
        for c, C in zip(self.components, self.matrices(y, T), strict=True):
            out.append(self._factor(c, C, _pivoted(C.T)[0][: c.rank]))
        return out

    def again(self, chosen: Sequence[Selected], y: Array, T: Array) -> list[Selected]:
        """The same rows at another configuration of the step."""
        out = []
        for s, C in zip(chosen, self.matrices(y, T), strict=True):
            out.append(self._factor(s.component, C, s.local))
        return out

    def _factor(self, c: CoupledLoops, C: Array, local: IndexArray) -> Selected:
        Q, R = _complete_qr(C[local].T)
        rows = self.rows[c.rows[local]]
        return Selected(c, local, rows, R[: c.rank], Q[:, : c.rank], Q[:, c.rank :])

    def independence(self, chosen: Sequence[Selected], y: Array, T: Array) -> float:
        """Smallest pivot of chosen rows at y, relative to the largest of their component."""
        least = 1.0
        for s, C in zip(chosen, self.matrices(y, T), strict=True):
            pivots = abs(_pivoted(C[s.local].T)[1])
            least = min(least, float(pivots.min(initial=1.0) / pivots.max(initial=1e-300)))
        return least

    def null_matrix(self, selected: list[Selected]) -> Floats:
        """Z (K, K - rank), dense, in the numbering of :meth:`null_pattern`."""
        rows, cols, ones = self.null_pattern()
        Z = np.zeros((self.kin.unknowns, self.kin.unknowns - self.rank))
        Z[rows, cols] = self.null_values(selected, ones)
        return Z

    def null_pattern(self) -> tuple[IndexArray, IndexArray, int]:
        """Rows and columns of the entries of Z, and how many of the first ones are 1."""
        apart = np.ones(self.kin.unknowns, dtype=bool)
        for c in self.components:
            apart[c.columns] = False
        single = np.flatnonzero(apart)
        rows, cols = [single], [np.arange(len(single))]
        start = len(single)
        for c in self.components:
            free = start + np.arange(c.free)
            rows.append(np.repeat(c.columns, c.free))
            cols.append(np.tile(free, len(c.columns)))
            start += c.free
        return np.concatenate(rows), np.concatenate(cols), len(single)

    def null_values(self, selected: list[Selected], ones: int) -> Floats:
        """Entries of Z at :meth:`null_pattern`."""
        return np.concatenate([np.ones(ones), *(s.null.ravel() for s in selected)])

    def violation(self, s: Selected, g: Floats) -> Floats:
        """G of the selected rows in the scaling of the factorisation."""
        return np.asarray(g[s.rows] / self.magnitude[s.component.rows[s.local]])

    def multipliers(self, s: Selected, force: Floats) -> tuple[IndexArray, Floats]:
        """Constraint rows and multipliers that balance a force (K,) of the tree best."""
        size = self.magnitude[s.component.rows[s.local]]
        return s.rows, s.multipliers(force[s.component.columns]) / size


def _pivoted(A: Array) -> tuple[IndexArray, Array]:
    """Order of the columns of A by QR with pivoting, and diagonal of R, by LAPACK as below."""
    if np.iscomplexobj(A) or not A.size:
        R, order = qr(A, mode="r", pivoting=True)
        return order, np.diagonal(R)
    factored, order, _, _, failed = dgeqp3(A)
    assert failed == 0
    return np.asarray(order - 1), np.diagonal(factored)


def _complete_qr(A: Array) -> tuple[Array, Array]:
    """Q (k, k) and R of A (k, r), by LAPACK without what numpy does around it."""
    k, r = A.shape
    if np.iscomplexobj(A) or not 0 < r <= k:
        return np.linalg.qr(A, mode="complete")
    factored, tau, _, failed = dgeqrf(A)
    Q = np.zeros((k, k), order="F")
    Q[:, :r] = factored
    Q, _, wrong = dorgqr(Q, tau, overwrite_a=True)
    assert failed == 0
    assert wrong == 0
    return Q, np.triu(factored)


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
    """The same rows with other null directions (columns, free), orthonormal."""
    c = selected.component
    Q1 = np.linalg.qr(np.column_stack([Q2, selected.Q1]), mode="complete")[0][:, c.free :]
    R = Q1.T @ selected.Q1 @ selected.R
    return Selected(c, selected.local, selected.rows, R, Q1, Q2)
