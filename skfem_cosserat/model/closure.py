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
from scipy.linalg.lapack import dgeqp3, dgeqrf, dorgqr, dpstrf
from scipy.sparse import coo_matrix, csr_matrix, issparse
from scipy.sparse.csgraph import connected_components

from ..kernels import skew
from ..pattern import FULL_ROWS, sum_at
from ..types import Array, Floats, IndexArray
from .kinematics import Kinematics
from .quadratic import QuadraticConstraints

#: pivot or singular value, against the largest, below which rows or motions depend on others
RANK_TOLERANCE = 1e-9
#: smallest against largest diagonal entry of R below which a configuration counts as singular
SINGULAR = 1e-7


@dataclass(eq=False)
class CoupledLoops:
    """Rows and tree coordinates that are coupled with each other only."""

    rows: IndexArray  # among the loop rows
    columns: IndexArray  # tree coordinates
    twists: IndexArray  # those of the vertices on its loops
    scale: Floats  # columns: translations count relative to the scene's extent
    rank: int = 0
    weakest: float = 1.0  # smallest pivot of the rows that count as independent

    @property
    def free(self) -> int:
        """Coordinates that the loops leave free."""
        return len(self.columns) - self.rank


@dataclass(eq=False)
class _Stack:
    """Components of one shape, whose matrices are made at once.

    Attributes
    ----------
    members : (count,) int array
        Numbers of the components.
    shape : (int, int, int)
        Rows, twists and columns of each.
    entries, where : int arrays
        Entries of ``G_loop P_int``, and where they go in (count, rows, twists).
    of_tree, there : int arrays
        Entries of T, and where they go in (count, twists, columns).
    rows : (count, rows) int array
    scale, twist_scale : (count, columns), (count, twists) array
    """

    members: IndexArray
    shape: tuple[int, int, int]
    entries: IndexArray
    where: IndexArray
    of_tree: IndexArray
    there: IndexArray
    rows: IndexArray
    scale: Floats
    twist_scale: Floats

    def by_twists(self, weights: Array) -> csr_matrix | Array:
        """``G_loop P_int`` from its entries; of many twists sparse, on a diagonal."""
        count, (a, b, _) = len(self.members), self.shape
        values = weights[self.entries]
        if b <= FULL_ROWS:
            return sum_at(self.where, values, count * a * b).reshape(count, a, b)
        row, twist = np.divmod(self.where, b)
        ends = row, row // a * b + twist
        return csr_matrix((values, ends), shape=(count * a, count * b))

    def product(self, weights: Array, T: Array) -> Array:
        """``G_loop P_int T`` (count, rows, columns), columns scaled, from the entries."""
        count, (a, b, c) = len(self.members), self.shape
        right = sum_at(self.there, T[self.of_tree], count * b * c)
        left = self.by_twists(weights)
        right = right.reshape(-1, c) if issparse(left) else right.reshape(count, b, c)
        return np.asarray(left @ right).reshape(count, a, c) * self.scale[:, None]

    def sizes(self, weights: Array) -> Floats:
        """Of the rows of ``G_loop P_int`` (count, rows), translations relative to the scene."""
        left = self.by_twists(weights)
        if not issparse(left):
            return np.linalg.norm(left * self.twist_scale[:, None], axis=2)
        square = csr_matrix(left).power(2) @ np.square(self.twist_scale).ravel()
        return np.sqrt(square).reshape(self.rows.shape)


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
        return d / d.max(initial=1e-300)

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
        return -self.component.scale * step

    def multipliers(self, force: Floats) -> Floats:
        """Mu (rank,) with ``C^T mu`` nearest to a force on the columns."""
        if not (self.pivots > SINGULAR).all():
            scaled = self.component.scale * force
            nearest = np.linalg.lstsq(self.Q1 @ self.R, scaled, rcond=SINGULAR)[0]
            return np.asarray(nearest, dtype=float)
        return solve_triangular(self.R, self.Q1.T @ (self.component.scale * force))


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
        self._entries = np.searchsorted(constraints.inside, which)  # of the Jacobian's values
        row = number[constraints.rows[which]]
        y_row, component = np.divmod(constraints.cols[which], 3)
        turning = kinematics.row_is_director[y_row]
        self._plain, self._turning = np.flatnonzero(~turning), np.flatnonzero(turning)
        base = kinematics.row_twist[y_row]
        twist = [
            base[self._plain] + component[self._plain],
            (base[self._turning][:, None] + np.arange(3)).ravel(),
        ]
        self._director = y_row[self._turning]
        self._component = component[self._turning]
        #: translations count relative to the scene's extent
        scale = np.ones(len(kinematics.vertex))
        for kind in ("translation", "slide"):
            scale[kinematics.numbers[kind]] = length
        self.components: list[CoupledLoops] = []
        self._stacks: list[_Stack] = []
        self.magnitude = np.ones(len(rows))
        self._length = length
        if len(rows):
            row = np.concatenate([row[self._plain], np.repeat(row[self._turning], 3)])
            self._split(row, np.concatenate(twist), scale[: kinematics.unknowns])

    def _split(self, row: IndexArray, twist: IndexArray, scale: Floats) -> None:
        """Into components, from the rows and twists of the entries of ``G_loop P_int``."""
        kin = self.kin
        T, r, K, nt = kin.T, len(self.rows), kin.unknowns, kin.n_twist
        # graph of rows, coordinates and the twists between them
        moved = np.zeros(nt, dtype=bool)
        moved[T.rows] = True
        on, met = np.zeros(nt, dtype=bool), moved[twist]
        on[twist] = True
        of_tree = np.flatnonzero(on[T.rows])
        ends = (
            np.concatenate([row[met], r + T.cols[of_tree]]),
            np.concatenate([r + K + twist[met], r + K + T.rows[of_tree]]),
        )
        graph = coo_matrix((np.ones(len(ends[0])), ends), shape=(r + K + nt,) * 2)
        _, label = connected_components(graph, directed=False)
        _, found, label = np.unique(label, return_index=True, return_inverse=True)
        label = np.argsort(np.argsort(found))[label]  # rows come first, so do their components
        count = int(label[:r].max()) + 1
        # twists of each component, in order; where they are in it
        keys = np.unique(label[row] * nt + twist)
        of_key, twists = np.divmod(keys, nt)
        first = np.searchsorted(of_key, np.arange(count + 1))

        def place(component: IndexArray, twist: IndexArray) -> IndexArray:
            """Among the twists of the component; -1: not there."""
            at = np.minimum(np.searchsorted(keys, component * nt + twist), len(keys) - 1)
            return np.where(keys[at] == component * nt + twist, at - first[component], -1)

        local_row, rows = _grouped(label[:r], count)
        local_column, columns = _grouped(label[r : r + K], count)
        for k in range(count):
            own = columns[k]
            part = CoupledLoops(rows[k], own, twists[first[k] : first[k + 1]], scale[own])
            self.components.append(part)
        self._find_vertices()
        of_tree = of_tree[label[r + T.cols[of_tree]] < count]
        of_column = label[r + T.cols[of_tree]]
        twist_place = place(of_column, T.rows[of_tree])
        inside = twist_place >= 0
        of_tree, of_column, twist_place = of_tree[inside], of_column[inside], twist_place[inside]
        shapes: dict[tuple[int, int, int], list[int]] = {}
        for k, part in enumerate(self.components):
            size = len(part.rows), len(part.twists), len(part.columns)
            shapes.setdefault(size, []).append(k)
        shift = ~np.isin(np.arange(nt), kin.frame_twist[:, 3:])
        row_place = place(label[row], twist)
        for (a, b, c), numbers in shapes.items():
            at = np.full(count, -1)
            at[numbers] = np.arange(len(numbers))
            mine = np.flatnonzero(at[label[row]] >= 0)
            of_T = np.flatnonzero(at[of_column] >= 0)
            column = local_column[T.cols[of_tree[of_T]]]
            parts = [self.components[k] for k in numbers]
            self._stacks.append(
                _Stack(
                    np.array(numbers),
                    (a, b, c),
                    mine,
                    (at[label[row[mine]]] * a + local_row[row[mine]]) * b + row_place[mine],
                    of_tree[of_T],
                    (at[of_column[of_T]] * b + twist_place[of_T]) * c + column,
                    np.array([part.rows for part in parts]),
                    np.array([part.scale for part in parts]),
                    np.array([np.where(shift[part.twists], self._length, 1.0) for part in parts]),
                )
            )

    def _find_vertices(self) -> None:
        """Vertices that the loops of each component move."""
        kin = self.kin
        of_twist = np.repeat(
            np.arange(len(kin.twist_of)), np.diff(kin.twist_of, append=kin.n_twist)
        )
        self._vertices = [
            np.union1d(of_twist[c.twists], kin.vertex[c.columns]) for c in self.components
        ]
        self._every = np.concatenate(self._vertices)
        self._first = np.cumsum([0, *map(len, self._vertices)])[:-1]

    @property
    def rank(self) -> int:
        """Independent rows."""
        return sum(c.rank for c in self.components)

    # -- evaluation --------------------------------------------------------------------------------

    def _weights(self, y: Array) -> Array:
        """Entries of ``G_loop P_int``, of the vertices on loops."""
        values = self.constraints.jacobian_values(y)[self._entries]
        # moment of a force e_c on a director: d x e_c
        arms = skew(y[self._director])[np.arange(len(self._director)), :, self._component]
        moments = arms * values[self._turning][:, None]
        return np.concatenate([values[self._plain], moments.ravel()])

    def matrices(self, y: Array, T: Array) -> list[Array]:
        """C (rows, columns) of each component at y, columns scaled; T are the tree's values."""
        out = [y[:0]] * len(self.components)
        weights = self._weights(y)
        for each in self._stacks:
            C = each.product(weights, T) / self.magnitude[each.rows][:, :, None]
            for k, own in zip(each.members.tolist(), C, strict=True):
                out[k] = own
        return out

    def decide(self, y: Array, T: Array) -> IndexArray:
        """Fix the rank at a configuration; gives the constraint rows that depend on others."""
        weights = self._weights(y)
        for each in self._stacks:
            size = each.sizes(weights)
            self.magnitude[each.rows] = np.where(size > 0, size, 1.0)
        redundant = [np.zeros(0, dtype=np.int64)]
        for c, C in zip(self.components, self.matrices(y, T), strict=True):
            order, diagonal = _pivoted(C.T)
            d = abs(diagonal)
            largest = max(1.0, d.max(initial=0.0))
            c.rank = int((d > RANK_TOLERANCE * largest).sum())
            c.weakest = float(d[c.rank - 1] / largest) if c.rank else 1.0
            redundant.append(self.rows[c.rows[order[c.rank :]]])
        return np.sort(np.concatenate(redundant))

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

    def independence(
        self, chosen: Sequence[Selected], y: Array, T: Array, which: IndexArray
    ) -> Floats:
        """Smallest pivot of chosen rows at y against the largest, of these components (k,)."""
        C = self.matrices(y, T)
        pivots = [_pivots(C[k][chosen[k].local]) for k in which.tolist()]
        return np.array([p.min(initial=1.0) / p.max(initial=1e-300) for p in pivots])

    def motion(self, y0: Array, y1: Array) -> Floats:
        """How far the vertices of each component are from y0 at y1 (components,).

        The largest rotation (rad) or displacement relative to the scene.
        """
        kin, count = self.kin, len(self.kin.row_twist)
        square = np.square(y1 - y0).sum(axis=1)
        ground = square[count:].max(initial=0.0) / min(1.0, self._length) ** 2
        turn = 0.5 * square[kin.director_rows].sum(axis=1)
        square = square[kin.row[: len(kin.twist_of)]] / self._length**2
        square[kin.frames] = np.maximum(square[kin.frames], turn)
        most = np.maximum.reduceat(square[self._every], self._first)
        return np.sqrt(np.maximum(most, ground))

    def rows_of(self, which: IndexArray) -> IndexArray:
        """Rows of y of the vertices of these components."""
        kin = self.kin
        vertices = np.concatenate([self._vertices[k] for k in which.tolist()])
        frames = vertices[kin.frame_row[vertices] >= 0]
        return np.concatenate([kin.row[vertices], *(kin.row[frames] + k for k in (1, 2, 3))])

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
        return g[s.rows] / self.magnitude[s.component.rows[s.local]]

    def multipliers(self, s: Selected, force: Floats) -> tuple[IndexArray, Floats]:
        """Constraint rows and multipliers that balance a force (K,) of the tree best."""
        size = self.magnitude[s.component.rows[s.local]]
        return s.rows, s.multipliers(force[s.component.columns]) / size


def _grouped(label: IndexArray, count: int) -> tuple[IndexArray, list[IndexArray]]:
    """Place of each in its group, and the members of the groups 0 to count - 1, in order."""
    order = np.argsort(label, kind="stable")
    starts = np.searchsorted(label[order], np.arange(count + 1))
    place = np.zeros(len(label), dtype=np.int64)
    known = order[: starts[-1]]
    place[known] = np.arange(len(known)) - starts[label[known]]
    return place, np.split(order, starts[1:])[:count]


def _pivoted(A: Array) -> tuple[IndexArray, Array]:
    """Order of the columns of A by QR with pivoting, and diagonal of R, by LAPACK as below."""
    if np.iscomplexobj(A) or not A.size:
        R, order = qr(A, mode="r", pivoting=True)
        return order, np.diagonal(R)
    factored, order, _, _, failed = dgeqp3(A)
    assert failed == 0
    return np.asarray(order - 1), np.diagonal(factored)


def _pivots(C: Floats) -> Floats:
    """Sizes of the diagonal of R, of `_pivoted` of C^T.

    Of many rows by Cholesky's factorisation of C C^T with pivoting, which has the same R: as rows
    are sparse, that product is cheap. Pivots are zero below 1e-8 times the root of their number of
    the largest: 1e-7 for a hundred.
    """
    if len(C) <= FULL_ROWS:
        return abs(_pivoted(C.T)[1])
    rows = csr_matrix(C)
    factored, _, rank, _ = dpstrf((rows @ rows.T).toarray(), overwrite_a=True)
    pivots = np.diagonal(factored).copy()
    pivots[rank:] = 0.0
    return pivots


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
