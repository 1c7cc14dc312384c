"""The discrete null space method with nodal reparametrisation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..errors import PerformanceWarning
from ..kernels import add_scalar, beam_geometric, null_space_blocks, skew, spin_gradient
from ..linear import LinearSolver
from ..model import System
from ..model.closure import Selected, continued
from ..model.groups import Blocks, Parts
from ..model.kinematics import Located, Recursion, TwistMap
from ..model.loops import Passages, way_on
from ..model.reparametrisation import Reparametrisation
from ..pattern import FrozenPattern, shared, sum_at
from ..types import Array, Floats, IndexArray
from ..warn import warn
from .base import BoundTreatment, Treatment, group_pairs, pair_numbers

# -- products ``T^T A T`` with matrices of a fixed pattern: from coordinates to unknowns -----------

#: products of single entries above which parts that are full enough are multiplied as full matrices
MANY = 40_000
#: operations with full matrices, for each of these products, above which parts are not full enough:
#: 60 to 90 take as long as a product (measured), and a full result takes a dense solver
FULL = 30
_UNIT = np.ones(1)


@dataclass(eq=False)
class _Full:
    """Rows and columns of T that hang together, as full matrices.

    Attributes
    ----------
    rows, cols : int
        How many.
    sources, places : int arrays
        Entries of A, and where they go in (rows, rows).
    entries, where : int arrays
        Entries of T, and where they go in (rows, cols).
    """

    rows: int
    cols: int
    sources: IndexArray
    places: IndexArray
    entries: IndexArray
    where: IndexArray

    def product(self, A: Floats, left: Floats, right: Floats) -> Floats:
        """``T_left^T A T_right`` (cols, cols), flat."""
        both = self.rows, self.cols
        inner = sum_at(self.places, A[self.sources], self.rows**2).reshape(self.rows, -1)
        T_left, T_right = (
            sum_at(self.where, values[self.entries], self.rows * self.cols).reshape(both)
            for values in (left, right)
        )
        return np.asarray(T_left.T @ (inner @ T_right)).ravel()


class Congruence:
    """``T_left^T A T_right + C T_right`` through a frozen pattern.

    A is given by contributions at pairs of twists, T by its entries, C by entries at (unknown,
    twist). Twists of free vertices are unknowns themselves, so most contributions pass straight
    through. Where rows of T have many entries, such as those along a beam without extension, full
    matrices take the place of products of single entries.
    """

    def __init__(
        self,
        pairs: tuple[IndexArray, IndexArray],
        extra: tuple[IndexArray, IndexArray],
        T: tuple[IndexArray, IndexArray, IndexArray],
        shape: tuple[int, int],
    ) -> None:
        T_rows, T_cols, ones = T
        order = np.argsort(T_rows, kind="stable")
        start = np.searchsorted(T_rows[order], np.arange(shape[0] + 1))
        count = np.diff(start)
        identity = np.zeros(shape[0], dtype=bool)
        one = np.flatnonzero(count == 1)
        identity[one] = np.isin(order[start[one]], ones)
        I, J = pairs  # noqa: E741
        plain = identity[I] & identity[J]
        passed = np.flatnonzero(plain)
        rest = np.flatnonzero(~plain & (count[I] > 0) & (count[J] > 0))
        self._full: list[_Full] = []
        columns: list[IndexArray] = []
        products = count[I[rest]] * count[J[rest]]
        if products.sum() > MANY:
            ends = I[rest], J[rest]
            found = _full_parts(*ends, rest, products, T_rows, T_cols, shape)
            self._full, columns, rest = found
        self._source, self._left, self._right = _expand(I[rest], J[rest], rest, start, order)
        k, J2 = extra
        self._extra, _, self._extra_right = _expand(None, J2, np.arange(len(J2)), start, order)
        # products of both kinds as one: entries of A, then of C; of T left, T right, then one
        self._products = np.concatenate([self._source, len(I) + self._extra])
        ones = np.full(len(self._extra), 2 * len(T_rows))
        rights = len(T_rows) + np.concatenate([self._right, self._extra_right])
        self._factors = np.stack([np.concatenate([self._left, ones]), rights])
        col = T_cols[order[start[:-1][identity]]] if identity.any() else np.zeros(0, dtype=int)
        number = np.full(shape[0], -1)
        number[identity] = col
        rows = [number[I[passed]], T_cols[self._left], k[self._extra]]
        cols = [number[J[passed]], T_cols[self._right], T_cols[self._extra_right]]
        rows += [np.repeat(each, len(each)) for each in columns]
        cols += [np.tile(each, len(each)) for each in columns]
        self.pattern = FrozenPattern(
            np.concatenate(rows).astype(np.int64),
            np.concatenate(cols).astype(np.int64),
            (shape[1], shape[1]),
        )
        slot, nnz = self.pattern.slot, self.pattern.nnz
        # contributions that pass, then products: one sum of both
        given = len(I) + len(J2)
        products = given + np.arange(len(slot) - len(passed))
        sources = np.concatenate([passed, products])
        self._places = np.full(given + len(products), nnz)  # the last one: what is not used
        self._places[sources] = slot

    def data(self, A: Sequence[Floats], C: Floats, left: Floats, right: Floats) -> Floats:
        """Entries of the product in :attr:`pattern`; A in one piece or more."""
        every = np.concatenate([*A, C])
        values = [every]
        if len(self._products):
            factors = np.concatenate([left, right, _UNIT]).take(self._factors)
            values.append(every.take(self._products) * factors[0] * factors[1])
        values += [full.product(every, left, right) for full in self._full]
        if len(values) > 1:
            every = np.concatenate(values)
        return sum_at(self._places, every, self.pattern.nnz + 1)[:-1]


def _expand(
    I: IndexArray | None,  # noqa: E741
    J: IndexArray,
    source: IndexArray,
    start: IndexArray,
    order: IndexArray,
) -> tuple[IndexArray, IndexArray, IndexArray]:
    """All pairs of T entries in rows I and J of each contribution."""
    count = np.diff(start)
    nI = np.ones(len(J), dtype=np.int64) if I is None else count[I]
    nJ = count[J]
    total = nI * nJ
    which = np.repeat(np.arange(len(J)), total)
    local = np.arange(int(total.sum())) - np.repeat(np.cumsum(total) - total, total)
    a, b = np.divmod(local, nJ[which]) if len(which) else (local, local)
    right = order[start[J[which]] + b] if len(which) else np.zeros(0, dtype=np.int64)
    if I is None:
        return source[which], which, right
    left = order[start[I[which]] + a] if len(which) else np.zeros(0, dtype=np.int64)
    return source[which], left, right


def _full_parts(
    I: IndexArray,  # noqa: E741
    J: IndexArray,
    source: IndexArray,
    products: IndexArray,
    T_rows: IndexArray,
    T_cols: IndexArray,
    shape: tuple[int, int],
) -> tuple[list[_Full], list[IndexArray], IndexArray]:
    """Rows that contributions couple, with their columns, in parts; columns of each part.

    And the contributions of parts with few `products` for their size, as of a row of short beams.
    """
    rows, cols = shape
    used = np.zeros(rows, dtype=bool)
    used[I] = used[J] = True
    mine = np.flatnonzero(used[T_rows])
    ends = np.concatenate([np.stack([I, J]), np.stack([T_rows[mine], rows + T_cols[mine]])], axis=1)
    graph = coo_matrix((np.ones(ends.shape[1]), ends), shape=(rows + cols, rows + cols))
    label = connected_components(graph, directed=False)[1]
    found, columns, few = [], [], [source[:0]]
    local = np.zeros(rows + cols, dtype=np.int64)
    for name in np.unique(label[I]):
        r = np.flatnonzero((label[:rows] == name) & used)
        c = np.flatnonzero(label[rows:] == name)
        which = np.flatnonzero(label[I] == name)
        if len(r) * len(c) * (len(r) + len(c)) > FULL * products[which].sum():
            few.append(source[which])
            continue
        local[r], local[rows + c] = np.arange(len(r)), np.arange(len(c))
        entries = mine[label[T_rows[mine]] == name]
        places = local[I[which]] * len(r) + local[J[which]]
        where = local[T_rows[entries]] * len(c) + local[rows + T_cols[entries]]
        found.append(_Full(len(r), len(c), source[which], places, entries, where))
        columns.append(c)
    return found, columns, np.concatenate(few)


class JointByJoint:
    """The same as :class:`Congruence` for a deep tree, whose T is full: joint by joint.

    ``T = (1 - X)^-1 S``, see :class:`Recursion`. With the twists t of vertices and the forces s at
    joints as unknowns that help,

    ``(1 - X) t - S nu = 0``, ``A t - (1 - X)^T s = 0``, ``S^T s + C t = b``,

    nothing is full. Twists that are coordinates, as those of free vertices, need none that help.
    """

    def __init__(
        self,
        recursion: Recursion,
        pairs: tuple[IndexArray, IndexArray],
        extra: tuple[IndexArray, IndexArray],
    ) -> None:
        S = recursion.own
        twists, unknowns = S.shape
        alone = np.bincount(S.rows, minlength=twists) == 1
        alone &= np.isin(np.arange(twists), S.rows[S.ones])
        alone[recursion.below] = False
        helped = np.flatnonzero(~alone)
        count = len(helped)
        twist, force = np.full((2, twists), -1)
        twist[helped], force[helped] = np.arange(count), count + np.arange(count)
        coordinate = 2 * count + np.arange(unknowns)
        own = np.flatnonzero(alone[S.rows])
        twist[S.rows[own]] = coordinate[S.cols[own]]
        self._joints = np.flatnonzero(~alone[S.rows])
        at, of = S.rows[self._joints], coordinate[S.cols[self._joints]]
        i, j = recursion.transport
        self._moved = np.flatnonzero(~alone[i])
        i, j = i[self._moved], j[self._moved]
        k, other = extra
        both = [
            (twist[pairs[0]], twist[pairs[1]]),
            (coordinate[k], twist[other]),
            (force[i], twist[j]),
            (twist[j], force[i]),
            (force[at], of),
            (of, force[at]),
        ]
        rows, cols = (np.concatenate([each[n] for each in both]) for n in (0, 1))
        size = 2 * count + unknowns
        self.pattern = FrozenPattern(rows, cols, (size, size))
        self._recursion = recursion

    def data(self, A: Sequence[Floats], C: Floats, left: Floats, right: Floats) -> Floats:
        """Entries in :attr:`pattern`; A in one piece or more."""
        S_left, X_left = self._recursion.split(left)
        S_right, X_right = self._recursion.split(right)
        moved, joints = self._moved, self._joints
        parts = [*A, C, X_right[moved], -X_left[moved], -S_right[joints], S_left[joints]]
        return self.pattern.data(np.concatenate(parts))


# -- discrete null space method with nodal reparametrisation: n - m unknowns, no multipliers -------

#: iterations to close the loops of one Newton iterate
CLOSING = 30
#: violation, relative to the size of the rows' terms, below which a loop counts as closed
CLOSED = 4e-16
#: a correction (rad, or relative to the scene) this small needs no other
QUADRATIC = 3e-8
#: the same for the first guess of a step
GUESSED = 1e-2
#: entries of a matrix of elements without extension above which multipliers are far faster
CROWDED = 90_000
#: a correction this large means that the loop does not close near here
FAR = 3.0
_ZERO = np.zeros(1)


class NullSpace(Treatment):
    """Null space method with nodal reparametrisation, equations (25), (61), (68), (69).

    Constraints are fulfilled to round-off by construction. The null space matrix comes from the
    tree of joints, without a factorisation of the constraint Jacobian. Joints that close a loop
    are eliminated as well: their rows are factorised in the tree's coordinates, and the loops are
    closed in every Newton iterate.

    Examples
    --------
    >>> NullSpace().name
    'null-space'
    """

    name = "null-space"
    reference = (
        "Betsch & Leyendecker, IJNME 67 (2006) 499; Leyendecker, Marsden & Ortiz, ZAMM 88 (2008)"
        " 677, equation (25)"
    )

    def bind(self, system: System, weight: float, large: bool = False) -> BoundNullSpace:
        """See the base class; directors are always turned."""
        return BoundNullSpace(system, weight)


class BoundNullSpace(BoundTreatment):
    """See :class:`NullSpace`.

    With loops ``P = P_int T Z``, where Z spans what the closure rows leave free of the K
    coordinates of the tree; it is evaluated where P is, with the rows chosen at the step's start.
    """

    by_motion = True

    def __init__(self, system: System, weight: float) -> None:
        super().__init__(system, weight)
        kin = self.kin = system.kinematics
        self.closure = system.closure
        self.unknowns = system.unknowns
        number = np.zeros(len(system.origin_rows), dtype=np.int64)
        number[kin.frames] = np.arange(len(kin.frames))
        rows = [kin.director_rows[number[g.vertices]] if g.framed else None for g in system.groups]
        #: of each group, first rows of directors of each element's nodes; none of points
        self._directors = rows
        self._loops = len(self.closure.rows) > 0
        self._curved, loop_pairs = system.constraints.curvature_of(self.closure.rows)
        curved = self._loops and weight > 0
        #: pairs of rows of y with 3x3 blocks: couplings, then curvature of loop rows
        self._row_pairs = np.vstack([system.coupled_rows, loop_pairs[: len(loop_pairs) * curved]])
        *self._Z, self._ones = self.closure.null_pattern()
        self.moved: Array = np.zeros(kin.unknowns)
        self._enough = QUADRATIC
        self._direction: list[Floats] | None = None
        self._passages = Passages(system)
        self._P_left: list[Array | None] | None = None
        self._known: tuple[Array, Located, Array] | None = None
        #: of each kind of elements whose lines follow from directors: group, and which of its own
        self._constrained = [
            (k, np.array([g.slices[id(s.item)].start + s.number for s in each.elements]))
            for each in (() if kin.elements is None else kin.elements.groups)
            for k, g in enumerate(system.beam_groups)
            if id(each.elements[0].item) in g.slices
        ]

    # compiled steps take none of what follows

    @cached_property
    def nodal(self) -> Reparametrisation:
        """From increments to configurations."""
        return Reparametrisation(self.kin)

    @cached_property
    def _kinds(self) -> tuple[IndexArray, list[int]]:
        """Numbers of shifts, then of rotations, and where they begin."""
        count = self.kin.unknowns
        turning = np.zeros(count, dtype=bool)
        turning[self.nodal.rotating] = True
        shifts = [*np.flatnonzero(~turning), count]
        return np.array([*shifts, *np.flatnonzero(turning), count]), [0, len(shifts)]

    @cached_property
    def _map(self) -> TwistMap | Recursion:
        """Twists by the tree's coordinates."""
        kin = self.kin
        return kin.recursion if kin.deep and not len(self.closure.rows) else kin.T

    @cached_property
    def solver(self) -> LinearSolver:  # type: ignore[override]
        """Of the reduced matrix, which is full for chains."""
        pattern, kin = self._congruence.pattern, self.kin
        if isinstance(self._map, Recursion):
            return LinearSolver(pattern, self.asked, self.unknowns)
        if self._loops:
            pattern = self._reduction.pattern
        if kin.elements is not None and pattern.nnz > CROWDED:
            warn(
                " and ".join(sorted({element.label for element, _ in self.system.tree.elements})),
                "all of its rotations move what hangs on them, which makes a full matrix of"
                f" {self.unknowns} unknowns; Multipliers() has a sparse one",
                PerformanceWarning,
            )
        return LinearSolver(pattern, self.asked)

    @cached_property
    def _congruence(self) -> Congruence | JointByJoint:
        """From blocks by twists to the tree's coordinates."""
        system, kin = self.system, self.kin
        dofs = [
            (kin.twist_of[g.vertices][:, :, None] + np.arange(6 if g.framed else 3)).reshape(
                len(g.vertices), -1
            )
            for g in system.groups
        ]
        i, j = group_pairs(system, dofs)
        ci, cj = pair_numbers(self._row_pairs, kin.row_twist)
        i, j = np.concatenate([i, ci]), np.concatenate([j, cj])
        extra = (np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
        if self.weight:  # derivative of P: moments on each frame, and the tree's
            omega = kin.frame_twist[:, 3:]
            i = np.concatenate([i, np.repeat(omega, 3, axis=1).ravel()])
            j = np.concatenate([j, np.tile(omega, (1, 3)).ravel()])
            if len(kin.tree.edges):
                extra = self._map.curvature_pattern()
        if isinstance(self._map, Recursion):
            if self.weight:
                more = self._map.moment_pattern()
                i, j = np.concatenate([i, more[0]]), np.concatenate([j, more[1]])
            return JointByJoint(self._map, (i, j), extra)
        T = self._map.rows, self._map.cols, self._map.ones
        return shared(Congruence, (i, j), extra, T, self._map.shape)

    @cached_property
    def _reduction(self) -> Congruence:
        """From the tree's coordinates to those that closed loops leave free."""
        tree = self._congruence.pattern
        cols = np.repeat(np.arange(tree.shape[1]), np.diff(tree.indptr))
        none = np.zeros(0, dtype=np.int64)
        Z = self._Z[0], self._Z[1], np.arange(self._ones)
        pairs = (tree.indices, cols), (none, none)
        return shared(Congruence, *pairs, Z, (self.kin.unknowns, self.unknowns))

    # -- a step ----------------------------------------------------------------------------------

    def begin(self, y0: Array, ground1: Array, h: float, momentum: Floats | None = None) -> None:
        """See the base class."""
        self.y0, self.ground1, self._known = y0, ground1, None
        self._ground: Array | None = ground1
        self.nodal.begin(y0, ground1)
        if self._loops:
            self._choose(y0, momentum)
        if self.weight == 0:
            self._set_left(y0)

    def _choose(self, y0: Array, momentum: Floats | None) -> None:
        """Independent closure rows at the start of the step."""
        T = self._tree_at(y0)[1]
        chosen = self.closure.select(y0, T)
        self._take(chosen, y0)
        if momentum is not None:
            self._passages, self._direction = Passages(self.system), None
        self.doubts = self._passages.look(y0, T, chosen)
        before = self._direction
        self._chosen = [
            way_on(self.system, y0, s, None if before is None else before[k], momentum)
            for k, s in enumerate(chosen)
        ]
        self._direction = [s.Q2 for s in self._chosen]

    def _selected(self, y: Array, T: Array) -> list[Selected]:
        if y is self.y0:
            return self._chosen
        again = self.closure.again(self._chosen, y, T)
        return [continued(s, c.Q2) for s, c in zip(again, self._chosen, strict=True)]

    def _tree_at(self, y: Array) -> tuple[Located, Array]:
        """The tree at y, and the values of its T; known if y was asked for last."""
        known = self._known
        if known is None or known[0] is not y:
            at = self._map.locate(y, self.nodal.fixed)
            known = self._known = y, at, self._map.values(at)
        return known[1:]

    def _set_left(self, y: Array) -> None:
        """P^T is evaluated at y."""
        self._left, self._T_left = self._tree_at(y)
        self._P_left = None
        if self._loops:
            self._selected_left = self._selected(y, self._T_left)
            self._Z_left = self.closure.null_values(self._selected_left, self._ones)

    @property
    def sought(self) -> tuple[Array, ...]:
        """See the base class."""
        return *self.nodal.save(), self.moved

    @sought.setter
    def sought(self, before: tuple[Array, ...]) -> None:
        self.nodal.restore(before[:-1])
        self.moved, self._ground = before[-1], None  # what is driven follows anew

    def guess(self, extrapolate: bool) -> None:
        """See the base class."""
        self.nodal.reset()
        self.moved = np.zeros(self.kin.unknowns)
        self._enough = GUESSED
        if extrapolate and self.last is not None:
            self._add(self.last)

    def _add(self, increment: Array) -> None:
        self.nodal.add(increment)
        self.moved = self.moved + increment

    def configure(self) -> Array:
        """See the base class; loops are closed first."""
        if self._ground is not self.ground1:
            self._ground = self.ground1
            self.nodal.move_ground(self.ground1)
        y1 = self.nodal.configuration()
        return self._close(y1) if self._loops else y1

    def _close(self, y1: Array) -> Array:
        """Shortest changes of the tree's coordinates until the loops close.

        A step's first guess is moved once only: an iteration follows.
        """
        self.trouble = None
        kin, closure = self.kin, self.closure
        enough, self._enough = self._enough, QUADRATIC
        for _ in range(CLOSING):
            g = self.system.constraints.values(y1)
            gaps = [closure.violation(s, g) for s in self._chosen]
            if max(float(abs(gap).max(initial=0.0)) for gap in gaps) <= CLOSED:
                return y1
            T = kin.T.values(kin.T.locate(y1, self.nodal.fixed))
            step = np.zeros(kin.unknowns, dtype=y1.dtype)
            for s, gap in zip(closure.again(self._chosen, y1, T), gaps, strict=True):
                step[s.component.columns] = s.correction(gap)
            size = self._size(step)[0]
            if not np.isfinite(size) or size > FAR:
                break
            self._add(step)
            y1 = self.nodal.configuration()
            if size < enough:  # what is left is the square of it
                return y1
        names = ", ".join(joint.label for joint in self.system.tree.loops)
        self.trouble = f"the loop through the {names} does not close"
        return y1

    def reduce(self, R: Array, y1: Array) -> Array:
        """``P(y_c)^T R``."""
        if self.weight:
            self._set_left(self.constraint_point(y1))
        self._twist_force = self.kin.twist_force(self._left.y, R)
        self._tree_force = self._map.reduce(self._T_left, self._twist_force)
        return self._by_unknowns(self._tree_force)

    def _by_unknowns(self, tree_force: Array) -> Array:
        """``Z^T f`` at the configuration of P^T."""
        if not self._loops:
            return tree_force
        rows, cols = self._Z
        return sum_at(cols, self._Z_left * tree_force[rows], self.unknowns)

    def displacement(self, increment: Array, y1: Array) -> Array:
        """See the base class."""
        T1 = self._tree_at(y1)[1]
        return self.kin.rates(y1, self._map.expand(T1, self._by_tree(increment)))

    def pull(self, gradient: Array) -> Array:
        """See the base class."""
        force = self.kin.twist_force(self._left.y, gradient)
        return self._by_unknowns(self._map.reduce(self._T_left, force))

    def _null_spaces(self, y: Array) -> list[Array | None]:
        """``P_int(y)`` of the blocks of each group (ne, 12 nn, 6 nn), none of points."""
        rows = self._directors
        return [None if r is None else null_space_blocks(y.take(r, axis=0)) for r in rows]

    def _project(self, blocks: Sequence[Blocks], y1: Array) -> list[Array]:
        """Blocks by coordinates -> by twists, ``P_int(y_c)^T K P_int(y_1)``."""
        P_right = self._null_spaces(y1)
        if self._P_left is None:
            self._P_left = self._null_spaces(self._left.y)
        P_left = self._P_left
        out = []
        for block, left, right in zip(blocks, P_left, P_right, strict=True):
            if left is None or right is None:
                K = block.blocks() if isinstance(block, Parts) else block
            elif isinstance(block, Parts):
                K = block.between(left, right)
            else:
                K = left.transpose(0, 2, 1) @ (block @ right)
            out.append(K.ravel())
        return out

    def _project_pairs(self, blocks: Array, y1: Array) -> Array:
        """3x3 blocks at pairs of rows of y -> by twists; the rate of a director is omega x d."""
        a, b = self._row_pairs.T
        out = np.array(blocks)
        left, right = (np.flatnonzero(self.kin.row_is_director[k]) for k in (a, b))
        out[left] = skew(self._left.y[a[left]]) @ out[left]
        out[right] = out[right] @ -skew(y1[b[right]])
        return out.ravel()

    def _balanced(self, R: Array) -> tuple[Array, Array, Array]:
        """Balance and twist force without the forces that close the loops, and their curvature.

        Derivative of ``Z^T f`` at a solution: as if the closure's multipliers mu, which balance f
        best, acted as forces.
        """
        constraints = self.system.constraints
        mu = np.zeros(constraints.size)
        for s in self._selected_left:
            rows, values = self.closure.multipliers(s, self._tree_force)
            mu[rows] = values
        y = self._left.y
        entries = constraints.jacobian_values(y) * mu[constraints.G_rows]
        force = sum_at(constraints.G_cols, entries, constraints.n)
        balanced = R - force.reshape(-1, 3)
        curvature = -self.weight * constraints.curvature_factors(self._curved, mu, y)
        blocks = curvature[:, None, None] * np.eye(3)
        return balanced, self.kin.twist_force(y, balanced), blocks

    def _carried(self, blocks: Sequence[Blocks], R: Array) -> tuple[list[Blocks], Array]:
        """Blocks with the curvature of strains that are held, balance without their forces.

        ``P^T G^T mu = 0`` for any mu, wherever P is: its derivative trades that of the lines for
        geometric stiffness, with the stresses that carry the balance.
        """
        assert self.kin.elements is not None
        carried, stresses = self.kin.elements.carried(self._left.y, R)
        out = list(blocks)
        for (k, which), own in zip(self._constrained, stresses, strict=True):
            elements, block = self.system.beam_groups[k].elements, out[k]
            stress = np.zeros((len(elements.lengths), *own.shape[1:]), dtype=own.dtype)
            stress[which] = -self.weight * own
            more = beam_geometric(elements, stress)
            if isinstance(block, Parts):
                out[k] = replace(block, scalar=block.scalar + more)
            else:
                out[k] = add_scalar(block.copy(), more)
        return out, R - carried

    def matrix(self, blocks: Sequence[Blocks], R: Array, y1: Array, scaled: bool = True) -> Floats:
        """See the base class."""
        kin = self.kin
        count = len(self.system.groups)
        force, curvature = self._twist_force, None
        if self.weight and self._loops:
            R, force, curvature = self._balanced(R)
        if self.weight and kin.elements is not None:
            blocks, R = self._carried(blocks, R)
            force = kin.twist_force(self._left.y, R)
        values = self._project(blocks[:count], y1)
        pairs = [np.asarray(block) for block in blocks[count:]]
        extra = np.zeros(0)
        right, T1 = self._tree_at(y1)
        if curvature is not None:
            pairs.append(curvature)
        if pairs:
            values.append(self._project_pairs(np.concatenate(pairs), y1))
        if self.weight:
            # derivative of P_int^T R
            W = spin_gradient(kin.directors(y1), kin.directors(R))
            values.append((self.weight * W).ravel())
            if isinstance(self._map, Recursion):
                force = self._map.carry(self._T_left, force)
                values.append(self.weight * self._map.moment_values(y1, force))
            if len(kin.tree.edges):
                extra = self.weight * self._map.curvature_values(self._left, right, force)
        out = self._congruence.data(values, extra, self._T_left, T1)
        if not self._loops:
            return out
        self._Z1 = self.closure.null_values(self._selected(y1, T1), self._ones)
        return self._reduction.data([out], np.zeros(0), self._Z_left, self._Z1)

    def _by_tree(self, increment: Array) -> Array:
        """Increment of the unknowns -> of the tree's coordinates, at the last matrix."""
        if not self._loops:
            return increment
        rows, cols = self._Z
        return sum_at(rows, self._Z1 * increment[cols], self.kin.unknowns)

    def move(self, increment: Array) -> None:
        """See the base class."""
        self._add(self._by_tree(increment))

    def _size(self, increment: Array) -> tuple[float, float]:
        # zeros at the end of both, so that there are some
        numbers, starts = self._kinds
        d = abs(np.concatenate([increment, _ZERO])).take(numbers)
        shift, turn = np.maximum.reduceat(d, starts).tolist()
        return max(shift / self.system.length, turn), turn

    def sizes(self, increment: Floats, y1: Array) -> tuple[float, float]:
        """Of the coordinates of the tree."""
        return self._size(self._by_tree(increment))

    def impulse(self, R: Array) -> Array:
        """All of the balance that the null space does not see."""
        return -R
