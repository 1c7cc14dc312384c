"""The discrete null space method with nodal reparametrisation."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ..errors import PerformanceWarning
from ..kernels import null_space_blocks, skew, spin_gradient
from ..linear import LinearSolver
from ..model import System
from ..model.closure import Closure, RowsByTwists, Selected, continued
from ..model.groups import Blocks, Parts
from ..model.kinematics import Located, Recursion
from ..model.loops import way_on
from ..model.reparametrisation import Reparametrisation
from ..pattern import FrozenPattern, sum_at
from ..types import NO_INDICES, Array, Floats, IndexArray
from ..warn import warn
from .base import BoundTreatment, Congruence, RowSpace, Treatment, group_pairs, pair_numbers

# -- matrices: from blocks by twists to the tree's coordinates, and from these to the unknowns -----


class JointByJoint:
    """``T_left^T A T_right + C T_right`` of a tree, whose T may be full, joint by joint.

    ``T = (1 - X)^-1 S``, see :class:`Recursion`. With the twists t of vertices and the forces s at
    joints as unknowns that help, and multipliers mu of rows H,

    ``(1 - X) t - S nu = 0``, ``A t - (1 - X)^T s + H^T mu = 0``, ``S^T s + C t = b``, ``H t = c``,

    nothing is full. Twists that are coordinates, as those of free vertices, need none that help.

    Parameters
    ----------
    recursion : Recursion
    pairs, extra : (int array, int array)
        Twists of the contributions to A; coordinates and twists of those to C.
    rows : RowsByTwists
        H.
    count : int
        How many rows.

    Attributes
    ----------
    pattern : FrozenPattern
        Of t and s, then nu, then mu.
    helping : int
        How many unknowns are t or s.
    """

    def __init__(
        self,
        recursion: Recursion,
        pairs: tuple[IndexArray, IndexArray],
        extra: tuple[IndexArray, IndexArray],
        rows: RowsByTwists,
        count: int,
    ):
        S = recursion.own
        twists, unknowns = S.shape
        alone = np.bincount(S.rows, minlength=twists) == 1
        alone &= np.isin(np.arange(twists), S.rows[S.ones])
        alone[recursion.below] = False
        helped = np.flatnonzero(~alone)
        twist, force = np.full((2, twists), -1)
        twist[helped], force[helped] = np.arange(2 * len(helped)).reshape(2, -1)
        self.helping = 2 * len(helped)
        coordinate = self.helping + np.arange(unknowns)
        own = np.flatnonzero(alone[S.rows])
        twist[S.rows[own]] = coordinate[S.cols[own]]
        self._joints = np.flatnonzero(~alone[S.rows])
        at = S.rows[self._joints]
        of = coordinate[S.cols[self._joints]]
        i, j = recursion.transport
        self._moved = np.flatnonzero(~alone[i])
        i = i[self._moved]
        j = j[self._moved]
        k, other = extra
        held = self.helping + unknowns + rows.row
        moved = twist[rows.twist]
        ends = [
            (twist[pairs[0]], twist[pairs[1]]),
            (coordinate[k], twist[other]),
            (force[i], twist[j]),
            (twist[j], force[i]),
            (force[at], of),
            (of, force[at]),
            (moved, held),
            (held, moved),
        ]
        size = self.helping + unknowns + count
        rows_of, columns_of = map(np.concatenate, zip(*ends, strict=True))
        self.pattern = FrozenPattern(rows_of, columns_of, (size, size))
        self._recursion = recursion

    def data(
        self,
        A: Sequence[Floats],
        C: Floats,
        T: tuple[Floats, Floats],
        rows: tuple[Floats, Floats],
        scale: float,
    ) -> Floats:
        """Entries in :attr:`pattern`; A in pieces, T and the rows at the left and at the right.

        `scale`: size of A, which equations and forces that help are given.
        """
        (S_left, X_left), (S_right, X_right) = map(self._recursion.split, T)
        moved = self._moved
        joints = self._joints
        tree = [X_right[moved], -X_left[moved], -S_right[joints], S_left[joints]]
        return self.pattern.data(np.concatenate([*A, C, scale * np.concatenate(tree), *rows]))


class LoopReduction(Congruence):
    """``Z_left^T A Z_right`` with what loops leave free of the tree's coordinates.

    Parameters
    ----------
    full : FrozenPattern
        Of A: coordinates stand between unknowns that stay as they are.
    closure : Closure
    before, behind : int
        How many of these.
    """

    def __init__(self, full: FrozenPattern, closure: Closure, before: int, behind: int):
        rows, cols, self._ones = closure.null_pattern()
        free = len(cols) and int(cols.max()) + 1
        first = np.arange(before)
        last = np.arange(behind)
        rows = np.concatenate([first, before + rows, full.shape[0] - behind + last])
        cols = np.concatenate([first, before + cols, before + free + last])
        super().__init__(full, FrozenPattern(rows, cols, (full.shape[0], before + free + behind)))
        self._closure = closure
        self._apart = (np.ones(before), np.ones(behind))

    def values(self, chosen: list[Selected]) -> Floats:
        """Entries of Z for rows at one configuration."""
        return self._closure.null_values(chosen, self._ones)

    def data(self, A: Floats, left: Floats, right: Floats) -> Floats:
        """Entries in :attr:`pattern` from those of A and of Z."""
        before, behind = self._apart
        both = (np.concatenate([before, values, behind]) for values in (left, right))
        return super().data(A, *both)


# -- discrete null space method with nodal reparametrisation: multipliers of held strains only -----

#: iterations to close the loops of one Newton iterate
CLOSING = 30
#: violation, relative to the size of the rows' terms, below which a loop counts as closed
CLOSED = 4e-16
#: a correction (rad, or relative to the scene) this small needs no other
QUADRATIC = 3e-8
#: the same for the first guess of a step
GUESSED = 1e-2
#: entries of a matrix with strains on loops above which multipliers are far faster
CROWDED = 90_000
#: a correction this large means that the loop does not close near here
FAR = 3.0


class NullSpace(Treatment):
    """Null space method with nodal reparametrisation, equations (25), (61), (68), (69).

    Constraints of joints are fulfilled to round-off by construction. The null space matrix comes
    from the tree of joints, without a factorisation of the constraint Jacobian. Joints that close a
    loop are eliminated as well: their rows are factorised in the tree's coordinates, and the loops
    are closed in every Newton iterate. Strains that a beam holds have multipliers; on closed loops
    they are eliminated, too.

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
        """The treatment with the arrays and equations for `system`; directors are always turned."""
        return BoundNullSpace(system, weight, large)


class BoundNullSpace(BoundTreatment):
    """The treatment :class:`NullSpace` at work on one system.

    With loops ``P = P_int T Z``, where Z spans what the closure rows leave free of the K
    coordinates of the tree; it is evaluated where P is, with the rows chosen at the step's start.
    Internally the multiplier of a strain that is held is its impulse ``h lambda``, scaled.
    """

    by_motion = True

    def __init__(self, system: System, weight: float, large: bool = False):
        super().__init__(system, weight)
        kin = self.kin = system.kinematics
        self.closure = system.closure
        self._large = large
        self._held = held = system.held_rows
        self.unknowns = kin.unknowns - self.closure.rank + len(held)
        number = np.zeros(len(system.origin_rows), np.int64)
        number[kin.frames] = np.arange(len(kin.frames))
        rows = [kin.director_rows[number[g.vertices]] if g.framed else None for g in system.groups]
        #: of each group, first rows of directors of each element's nodes; none of points
        self._directors = rows
        self._loops = len(self.closure.rows) > 0
        self._curved, pairs = system.constraints.curvature_of(system.left_rows)
        #: whether constraint forces turn with the configuration sought
        self._turning = weight > 0 and len(system.left_rows) > 0
        #: pairs of rows of y with 3x3 blocks: couplings, then curvature of rows
        self._row_pairs = np.vstack([system.coupled_rows, pairs[: len(pairs) * self._turning]])
        size = system.constraints.magnitudes(system.extend(system.q0, 0.0))[held]
        self.gap_terms = np.where(size > 0, size, 1.0)
        self._Z = self.closure.null_pattern()[:2]
        self._multipliers: Array = np.zeros(len(held))
        self.moved: Array = np.zeros(kin.unknowns + len(held))
        self._enough = QUADRATIC
        self._direction: list[Floats] | None = None
        self._P_left: list[Array | None] | None = None
        self._known: tuple[Array, Located, Array] | None = None

    # compiled steps take none of what follows

    @cached_property
    def nodal(self) -> Reparametrisation:
        """From increments to configurations."""
        return Reparametrisation(self.kin)

    @cached_property
    def _by_twists(self) -> RowsByTwists:
        """Rows of strains that have multipliers."""
        return RowsByTwists(self.kin, self.system.constraints, self._held)

    @cached_property
    def solver(self) -> LinearSolver:  # type: ignore[override]
        """Solver of the reduced matrix, with unknowns that only help in front."""
        pattern = self._reduction.pattern if self._loops else self._tree_matrix.pattern
        beams = [
            each.beam.label
            for each in self.system.theory_rows
            if np.isin(each.numbers, self.closure.rows).any()
        ]
        if beams and pattern.nnz > CROWDED:
            warn(
                " and ".join(sorted(beams)),
                "its strains are held on a closed loop, which makes a full matrix of"
                f" {self.unknowns} unknowns; Multipliers() has a sparse one",
                PerformanceWarning,
            )
        return LinearSolver(pattern, self.asked, self.unknowns)

    @cached_property
    def _tree_matrix(self) -> JointByJoint:
        """From blocks by twists to the tree's coordinates."""
        system = self.system
        kin = self.kin
        dofs = [
            (kin.twist_of[g.vertices][:, :, None] + np.arange(6 if g.framed else 3)).reshape(
                len(g.vertices), -1
            )
            for g in system.groups
        ]
        ends = [group_pairs(system, dofs), pair_numbers(self._row_pairs, kin.row_twist)]
        extra = (NO_INDICES, NO_INDICES)
        if self.weight:  # derivative of P: moments on each frame, and the tree's
            omega = kin.frame_twist[:, 3:]
            ends.append((omega.repeat(3, 1).ravel(), np.tile(omega, (1, 3)).ravel()))
            ends.append(kin.recursion.moment_pattern())
            extra = kin.recursion.own.curvature_pattern()
        pairs = np.concatenate([i for i, _ in ends]), np.concatenate([j for _, j in ends])
        return JointByJoint(kin.recursion, pairs, extra, self._by_twists, len(self._held))

    @cached_property
    def _reduction(self) -> LoopReduction:
        """From the tree's coordinates to those that closed loops leave free."""
        tree = self._tree_matrix
        return LoopReduction(tree.pattern, self.closure, tree.helping, len(self._held))

    # -- a step ----------------------------------------------------------------------------------

    def begin(self, y0: Array, ground1: Array, h: float, momentum: Floats | None = None) -> None:
        """Start a step of size h from y0: choose independent rows of closed loops."""
        self.y0, self.ground1, self.h, self._known = y0, ground1, h, None
        self._sized = False
        self._ground: Array | None = ground1
        self.nodal.begin(y0, ground1)
        if self._loops:
            self._choose(y0, momentum)
        if self.weight == 0:
            self._set_left(y0)

    def _choose(self, y0: Array, momentum: Floats | None) -> None:
        """Independent closure rows at the start of the step."""
        T = self._entries_of_tree(y0)
        before = self._direction if momentum is None else None
        self._chosen = [
            way_on(self.system, y0, s, None if before is None else before[k], momentum)
            for k, s in enumerate(self._choose_rows(y0, T, momentum))
        ]
        self._direction = [s.Q2 for s in self._chosen]

    def _selected(self, y: Array) -> list[Selected]:
        if y is self.y0:
            return self._chosen
        again = self.closure.again(self._chosen, y, self._entries_of_tree(y))
        return [continued(s, c.Q2) for s, c in zip(again, self._chosen, strict=True)]

    def _entries_of_tree(self, y: Array) -> Array:
        """Entries of T at y, of which loops need few."""
        return self.system.kinematics.values_at(y, self.nodal.fixed)

    def _tree_at(self, y: Array) -> tuple[Located, Array]:
        """The tree at y, and what its recursion is made of; known if y was asked for last."""
        known = self._known
        if known is None or known[0] is not y:
            at = self.kin.recursion.own.locate(y, self.nodal.fixed)
            known = self._known = y, at, self.kin.recursion.values(at)
        return known[1:]

    def _set_left(self, y: Array) -> None:
        """P^T is evaluated at y."""
        self._left, self._T_left = self._tree_at(y)
        self._P_left = None
        if self._loops:
            self._selected_left = self._selected(y)
            self._Z_left = self._reduction.values(self._selected_left)

    @property
    def sought(self) -> tuple[Array, ...]:
        """Configuration sought: the tree's increments, all increments so far, and multipliers."""
        return *self.nodal.save(), self.moved, self._multipliers

    @sought.setter
    def sought(self, before: tuple[Array, ...]) -> None:
        *nodal, self.moved, self._multipliers = before
        self.nodal.restore(tuple(nodal))
        self._ground = None  # what is driven follows anew

    def guess(self, extrapolate: bool) -> None:
        """First guess: last step's increment again, or only the prescribed motion."""
        self.nodal.reset()
        if not self._large:
            self._multipliers = np.zeros(len(self._held))
        self.moved = np.concatenate([np.zeros(self.kin.unknowns), self._multipliers])
        self._enough = GUESSED
        if extrapolate and self.last is not None:
            increment, multipliers = self._parted(self.last)
            self._add(increment, multipliers - self._multipliers)

    def adopt(self, R: Array) -> None:
        """Take the multipliers of strains that balance R (rows, 3) best at y0."""
        self._add(np.zeros(self.kin.unknowns), self._balancing(R, self.y0) - self._multipliers)

    def _parted(self, unknowns: Array) -> tuple[Array, Array]:
        """Coordinates and multipliers."""
        first = len(unknowns) - len(self._held)
        return unknowns[:first], unknowns[first:]

    def _balancing(self, R: Array, y: Array) -> Array:
        """Multipliers of strains that balance R at y best."""
        if not len(self._held):
            return self._multipliers
        return RowSpace(self.system, y).multipliers(-R.reshape(-1))[self._held]

    def _add(self, increment: Array, multipliers: Array | float = 0.0) -> None:
        """Move the tree's coordinates (K,), and add to the multipliers of strains."""
        self.nodal.add(increment)
        self._multipliers = self._multipliers + multipliers
        self.moved = np.concatenate([self.moved[: len(increment)] + increment, self._multipliers])

    def configure(self) -> Array:
        """``y_1`` (all rows) sought, after its loops are closed."""
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
        kin = self.kin
        closure = self.closure
        enough = self._enough
        self._enough = QUADRATIC
        for _ in range(CLOSING):
            g = self.system.constraints.values(y1)
            gaps = [closure.violation(s, g) for s in self._chosen]
            if max(float(abs(gap).max(initial=0.0)) for gap in gaps) <= CLOSED:
                return y1
            T = self._entries_of_tree(y1)
            step = np.zeros(kin.unknowns, y1.dtype)
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
        """``P(y_c)^T (R + h G^T lambda)``, and gaps of strains that have multipliers."""
        if self.weight:
            self._set_left(self.constraint_point(y1))
        if not len(self._held):
            return self._reduced(R)
        balance = self._reduced(R + self._constraint_force(self._all_multipliers()))
        return np.concatenate([balance, self.system.constraints.values(y1)[self._held]])

    def _reduced(self, force: Array) -> Array:
        """``P(y_c)^T f`` of forces (rows, 3)."""
        tree_force = self._by_tree_transposed(force)
        if not self._loops:
            return tree_force
        rows, cols = self._Z
        return sum_at(cols, self._Z_left * tree_force[rows], self.unknowns - len(self._held))

    def _by_tree_transposed(self, force: Array) -> Array:
        """``T^T P_int^T f`` (K,) of forces (rows, 3)."""
        return self.kin.recursion.reduce(self._T_left, self.kin.twist_force(self._left.y, force))

    def _all_multipliers(self) -> Array:
        """Multipliers of all constraint rows (m,): zero of those that have none."""
        out = np.zeros(self.system.m, self._multipliers.dtype)
        out[self._held] = self._multipliers
        return out

    def _constraint_force(self, multipliers: Array) -> Array:
        """``G^T lambda`` (rows, 3) of all rows (m,), where P^T is evaluated."""
        g = self.system.constraints
        entries = g.jacobian_values(self._left.y) * multipliers[g.G_rows]
        return sum_at(g.G_cols, entries, g.n).reshape(-1, 3)

    def displacement(self, increment: Array, y1: Array) -> Array:
        """Change (rows, 3) of the coordinates that an increment makes at y_1, to first order."""
        T1 = self._tree_at(y1)[1]
        coordinates = self._by_tree(self._parted(increment)[0])
        return self.kin.rates(y1, self.kin.recursion.expand(T1, coordinates))

    def pull(self, gradient: Array) -> Array:
        """Derivative by the unknowns of what has this `gradient` by q_1; zero by multipliers."""
        return np.concatenate([self._reduced(gradient), np.zeros(len(self._held))])

    def _null_spaces(self, y: Array) -> list[Array | None]:
        """``P_int(y)`` of the blocks of each group (ne, 12 nn, 6 nn), none of points."""
        rows = self._directors
        return [None if r is None else null_space_blocks(y.take(r, 0)) for r in rows]

    def _project(self, blocks: Sequence[Blocks], y1: Array) -> list[Array]:
        """Blocks by coordinates -> by twists, ``P_int(y_c)^T K P_int(y_1)``."""
        P_right = self._null_spaces(y1)
        if self._P_left is None:
            self._P_left = self._null_spaces(self._left.y)
        out = []
        for block, left, right in zip(blocks, self._P_left, P_right, strict=True):
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

    def _balanced(self, R: Array, y1: Array) -> tuple[Array, Array]:
        """Balance with all constraint forces that multipliers give, and their curvature.

        Derivative of ``Z^T f`` at a solution: as if the closure's multipliers, which balance f
        best, acted as forces. On a path strains have those that balance the predicted stresses.
        """
        multipliers = self._all_multipliers()
        if self._large:
            multipliers[self._held] = self._balancing(R, y1)
        if self._loops:
            force = self._by_tree_transposed(R + self._constraint_force(multipliers))
            for s in self._selected_left:
                rows, values = self.closure.multipliers(s, force)
                multipliers[rows] = -values
        factors = self.system.constraints.curvature_factors(self._curved, multipliers, self._left.y)
        blocks = self.weight * factors[:, None, None] * np.eye(3)
        return R + self._constraint_force(multipliers), blocks

    def matrix(self, blocks: Sequence[Blocks], R: Array, y1: Array, scaled: bool = True) -> Floats:
        """Entries of the iteration matrix, as solved (rows and columns scaled), or unscaled."""
        kin = self.kin
        tree = self.kin.recursion
        count = len(self.system.groups)
        pairs = [np.asarray(block) for block in blocks[count:]]
        if self._turning:
            R, curvature = self._balanced(R, y1)
            pairs.append(curvature)
        values = self._project(blocks[:count], y1)
        self._scale_gaps(values)
        extra = np.zeros(0)
        right, T1 = self._tree_at(y1)
        if pairs:
            values.append(self._project_pairs(np.concatenate(pairs), y1))
        if self.weight:
            # derivative of P_int^T R
            W = spin_gradient(kin.directors(y1), kin.directors(R))
            values.append((self.weight * W).ravel())
            force = tree.carry(self._T_left, kin.twist_force(self._left.y, R))
            values.append(self.weight * tree.moment_values(y1, force))
            extra = self.weight * tree.own.curvature_values(self._left, right, force)
        column, row = (self.gap_scale, self.gap_scale) if scaled else (self.h, 1.0)
        rows = column * self._by_twists.values(self._left.y), row * self._by_twists.values(y1)
        out = self._tree_matrix.data(values, extra, (self._T_left, T1), rows, self.gap_scale)
        if not self._loops:
            return out
        self._Z1 = self._reduction.values(self._selected(y1))
        return self._reduction.data(out, self._Z_left, self._Z1)

    def _by_tree(self, increment: Array) -> Array:
        """Increment of the unknowns -> of the tree's coordinates, at the last matrix."""
        if not self._loops:
            return increment
        rows, cols = self._Z
        return sum_at(rows, self._Z1 * increment[cols], self.kin.unknowns)

    def move(self, increment: Array) -> None:
        """Move the tree's coordinates by an increment, and add to the multipliers of strains."""
        coordinates, multipliers = self._parted(increment)
        self._add(self._by_tree(coordinates), self.gap_scale * multipliers)

    def _size(self, increment: Array) -> tuple[float, float]:
        d = abs(increment)
        rotating = self.nodal.rotating
        turn = float(d[rotating].max(initial=0.0))
        return max(float(np.delete(d, rotating).max(initial=0.0)) / self.system.length, turn), turn

    def sizes(self, increment: Floats, y1: Array) -> tuple[float, float]:
        """Size of an increment in the tree's coordinates, and of its largest rotation."""
        return self._size(self._by_tree(self._parted(increment)[0]))

    def impulse(self, R: Array) -> Array:
        """All of the balance that the null space does not see."""
        return -R
