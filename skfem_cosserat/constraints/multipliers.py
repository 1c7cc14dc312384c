"""Lagrange multipliers, and their systems restricted to a plane."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse.linalg import splu

from ..kernels import cross, exp_quaternion, rotation_matrix
from ..linear import LinearSolver
from ..model import System
from ..model.closure import SINGULAR, Selected
from ..model.groups import Blocks, Parts
from ..model.loops import coordinates_in_plane, rows_in_plane, way_off
from ..model.reparametrisation import Reparametrisation
from ..pattern import FrozenPattern, sum_at
from ..types import NO_INDICES, Array, Floats, switch
from .base import BoundTreatment, Congruence, Treatment, group_pairs, pair_numbers

# -- unknowns with multipliers in one plane: coordinates and constraint rows that act there --------
#
# The unknowns are the components along the plane of positions and directors, less those of
# directors along its normal, and the multipliers of constraint rows that are independent of each
# other there.


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

    def __init__(self, system: System, pattern: FrozenPattern):
        self.system = system
        #: coordinates (n, count) by those in the plane
        self.along, self.kept = coordinates_in_plane(system), rows_in_plane(system)
        self.count, along = self.along.shape[1], self.along.tocoo()
        along.eliminate_zeros()
        rows = np.concatenate([along.row, system.n + self.kept])
        columns = np.concatenate([along.col, self.count + np.arange(len(self.kept))])
        shape = system.n + system.m, self.count + len(self.kept)
        self._values = np.concatenate([along.data, np.ones(len(self.kept))])
        unknowns = FrozenPattern(rows, columns, shape)
        self._all = unknowns.matrix(self._values)
        self._back, self._to_plane = self._all.T.tocsr(), self.along.T.tocsr()
        self._reduction = Congruence(pattern, unknowns)
        self.pattern = self._reduction.pattern

    def data(self, full: Floats) -> Floats:
        """Entries in :attr:`pattern` from those of the full matrix."""
        return self._reduction.data(full, self._values, self._values)

    def restrict(self, residual: Array) -> Array:
        """``E^T r`` of (n + m,) or (n,) numbers."""
        return (self._to_plane if len(residual) == self.system.n else self._back) @ residual

    def expand(self, unknowns: Array) -> Array:
        """``E u`` (n + m,)."""
        return self._all @ unknowns

    def within(self, force: Array) -> Array:
        """Part in the plane of a force (n,)."""
        return self.along @ (self._to_plane @ force)


# -- lagrange multipliers: all coordinates and one multiplier for each constraint row --------------

#: how far (m, -) from a singular position the limit of the constraint Jacobian is taken
LIMIT = 1e-6


class Multipliers(Treatment):
    """Lagrange multipliers, n + m unknowns ``(q_{n+1}, lambda)``; equation (22).

    Of redundant constraint rows an independent set is chosen at the start of each step; the
    multipliers of the others are zero in that step, so that n + rank unknowns are left.

    Parameters
    ----------
    scaled : bool
        Scale constraint rows and columns by the largest entry of the dynamic block (Bottasso,
        Dopico & Trainelli, Multibody Syst. Dyn. 19 (2008) 3): the condition number then no longer
        grows as the step shrinks. Unscaled on request only, in full.
    full : bool
        Solve the system of all coordinates and multipliers, as the paper has it. Default: compiled
        kernels solve for six unknowns a frame and the multipliers of joints; the solution is the
        same.

    Examples
    --------
    >>> Multipliers().name
    'multipliers'
    """

    name = "multipliers"
    reference = "Leyendecker, Marsden & Ortiz, ZAMM 88 (2008) 677, equation (22)"

    def __init__(self, scaled: bool = True, full: bool = False):
        self.scaled = switch("argument scaled", scaled)
        self.full = switch("argument full", full) or not self.scaled

    def __repr__(self) -> str:
        if not self.scaled:
            return "Multipliers(scaled=False)"
        return "Multipliers(full=True)" if self.full else "Multipliers()"

    def bind(self, system: System, weight: float, large: bool = False) -> BoundMultipliers:
        """The treatment with the arrays and equations for `system`."""
        return BoundMultipliers(system, weight, self.scaled, large)


class BoundMultipliers(BoundTreatment):
    """The treatment :class:`Multipliers` at work on one system.

    Internally the unknown is the impulse ``h lambda``, scaled.
    """

    def __init__(self, system: System, weight: float, scaled: bool, large: bool):
        super().__init__(system, weight)
        n, m, g = system.n, system.m, system.constraints
        self.scaled = scaled
        self._large = large
        i, j = group_pairs(system, [group.dofs for group in system.groups])
        gi = g.G_rows
        gj = g.G_cols
        self._redundant = system.closure.rank < len(system.closure.rows)
        loop = n + system.closure.rows if self._redundant else NO_INDICES
        ci, cj = pair_numbers(system.coupled_rows, 3 * np.arange(system.rows))
        rows = [i, ci, gj, n + gi, loop]
        cols = [j, cj, n + gi, gj, loop]
        if weight:
            rows.append(g.curvature_rows)
            cols.append(g.curvature_cols)
        self._full = FrozenPattern(np.concatenate(rows), np.concatenate(cols), (n + m, n + m))
        self._inside = None if system.plane is None else Restriction(system, self._full)
        self.pattern = self._full if self._inside is None else self._inside.pattern
        #: how many of the solver's unknowns are coordinates
        self._coordinates = n if self._inside is None else self._inside.count
        self.unknowns = self._coordinates + system.rank
        self.solver = LinearSolver(self.pattern)
        size = g.magnitudes(system.extend(system.q0, 0.0))
        size = size if self._inside is None else size[self._inside.kept]
        self.gap_terms = np.where(size > 0, size, 1.0)
        self._q0 = np.zeros(n)
        self.sought = self._q0, np.zeros(m)
        self._keep = np.ones(m)
        if self._inside is not None:
            self._keep[np.setdiff1d(np.arange(m), self._inside.kept)] = 0
        self._away: Floats | None = None
        self._nodal = Reparametrisation(system.kinematics) if system.moving else None

    def begin(self, y0: Array, ground1: Array, h: float, momentum: Floats | None = None) -> None:
        """Start a step of size h from y0: choose independent rows of closed loops."""
        self.y0, self.ground1, self.h = y0, ground1, h
        if len(self.system.closure.rows):
            self._choose(y0, momentum)
        if self._redundant:  # the multipliers of rows that depend on others are not in use
            keep = self._keep if self._inside is None else self._keep[self._inside.kept]
            self.active = np.concatenate([np.ones(self._coordinates, bool), keep > 0])
        self._q0 = y0[: self.system.rows].reshape(-1)
        self._jacobian = self.system.constraints.jacobian_values(self._regular(y0))
        self._sized = False

    def _choose(self, y0: Array, momentum: Floats | None) -> None:
        """Independent rows of closed loops at the start of the step."""
        self._keep[self.system.closure.rows] = 0
        self._away = None
        for s in self._choose_rows(y0, self.system.kinematics.values_at(y0), momentum):
            self._keep[s.rows] = 1
            if (s.pivots <= SINGULAR).any():
                self._away = self._way(y0, s, momentum) + (
                    0.0 if self._away is None else self._away
                )

    def _way(self, y0: Array, s: Selected, momentum: Floats | None) -> Floats:
        """Increment (n,) that leads away from a singular position."""
        if momentum is None and self.last is not None:
            return self.last[: self.system.n]
        return way_off(self.system, y0, self.ground1, s, momentum, self.h)

    def _regular(self, y0: Array) -> Array:
        """y0; beside it, if y0 is singular: a limit where the rows are independent."""
        if self._away is None or not self._away.any():
            return y0
        out = y0.copy()
        out[: self.system.rows] += (LIMIT / abs(self._away).max() * self._away).reshape(-1, 3)
        return out

    @property
    def sought(self) -> tuple[Array, Array]:
        """Coordinates (n,) and impulses of the multipliers (m,) that are sought in the step."""
        return self._sought

    @sought.setter
    def sought(self, other: tuple[Array, Array]) -> None:
        self._sought = other
        self.moved = np.concatenate([other[0] - self._q0, other[1]])

    def guess(self, extrapolate: bool) -> None:
        """First guess: last step's increment again, or y0 after the prescribed motion.

        At a singular position, y0 after an increment that leads away from it.
        """
        n = self.system.n
        if extrapolate and self.last is not None:
            q = self._q0 + self.last[:n]
            multiplier = self.last[n:]
            self._turn_directors(q, self.last[:n])
        else:
            q = self._q0 + (self._following() if self._away is None else self._away)
            multiplier = self.sought[1] if self._large else np.zeros(self.system.m)
        if self._inside is not None:
            # turned on, rounding out of the plane would grow: no iteration takes it away
            q = self._q0 + self._inside.within(q - self._q0)
        self.sought = q, multiplier * self._keep

    def adopt(self, R: Array) -> None:
        """Take the multipliers that balance R (rows, 3) best at the start of the step."""
        self.sought = self.sought[0], self._balancing(R, self.y0)

    def _balancing(self, R: Array, y: Array) -> Array:
        """Multipliers that balance R at y best; zero for rows that depend on others."""
        kept = np.flatnonzero(self._keep)
        G = self.system.constraints.jacobian(y)[kept]
        force = R.reshape(-1)
        if self._inside is not None:
            G = G @ self._inside.along
            force = self._inside.restrict(force)
        out = np.zeros(self.system.m, R.dtype)
        if len(kept):
            out[kept] = -splu((G @ G.T).tocsc()).solve(G @ force)
        return out

    def _following(self) -> Array | float:
        """Increment with which the tree of joints follows the prescribed motion, else at rest."""
        if self._nodal is None:
            return 0.0
        self._nodal.begin(self.y0, self.ground1)
        return (self._nodal.configuration() - self.y0)[: self.system.rows].reshape(-1)

    def _turn_directors(self, q: Array, dq: Array) -> None:
        """Directors of the guess q, turned on in place by the last rotation.

        By the last increment they would get longer: an error that, near a singular position, has
        led to the wrong branch of the motion.
        """
        rows = self.system.kinematics.director_rows
        D = self.y0[rows]
        before = D - dq.reshape(-1, 3)[rows]
        q.reshape(-1, 3)[rows] = D @ before.transpose(0, 2, 1) @ D

    def configure(self) -> Array:
        """``y_1`` (all rows): the coordinates sought, and the ground at the end of the step."""
        q = self.sought[0]
        return np.concatenate([q.reshape(-1, 3), self.ground1.astype(q.dtype)])

    def reduce(self, R: Array, y1: Array) -> Array:
        """Residual: balance with constraint forces, then gaps of the constraints, not scaled."""
        constraints = self.system.constraints
        self._left = self._jacobian
        if self.weight:
            self._left = constraints.jacobian_values(self.constraint_point(y1))
        n = self.system.n
        force = self._left * self.sought[1].take(constraints.G_rows)
        summed = sum_at(constraints.G_cols, force, n)
        out = np.empty(n + self.system.m, np.result_type(R, force, y1))
        self._found = summed
        out[:n] = R.reshape(-1) + summed
        out[n:] = constraints.values(y1)
        if self._redundant:
            out[n:] *= self._keep
        return self._restricted(out)

    def _restricted(self, full: Array) -> Array:
        """Part of (n + m,) numbers that belongs to the solver's unknowns: in a plane fewer."""
        return full if self._inside is None else self._inside.restrict(full)

    def _expanded(self, increment: Array) -> Array:
        """All (n + m,) from the solver's unknowns."""
        return increment if self._inside is None else self._inside.expand(increment)

    def pull(self, gradient: Array) -> Array:
        """Derivative by the unknowns of what has this `gradient` by q_1; zero by multipliers."""
        return self._restricted(np.concatenate([gradient.reshape(-1), np.zeros(self.system.m)]))

    def matrix(self, blocks: Sequence[Blocks], R: Array, y1: Array, scaled: bool = True) -> Floats:
        """Entries of the iteration matrix, as solved (rows and columns scaled), or unscaled."""
        full = [b.blocks() if isinstance(b, Parts) else b for b in blocks]
        if self.scaled:
            self._scale_gaps(full)
        constraints = self.system.constraints
        size = self.gap_scale
        column, row = (size, size) if self.scaled and scaled else (self.h, 1.0)
        values = [b.ravel() for b in full]
        left = self._left
        right = constraints.jacobian_values(y1)
        dead = np.zeros(0)
        if self._redundant:
            keep = self._keep[constraints.G_rows]
            left = left * keep
            right = right * keep
            dead = 1.0 - self._keep[self.system.closure.rows]
        values += [column * left, row * right, row * dead]
        if self.weight:
            at = self.constraint_point(y1)
            # on a path those that balance the predicted stresses, at directors that have turned
            lam = self._balancing(R, y1) if self._large else self.sought[1]
            values.append(self.weight * constraints.curvature_values(lam, at))
        data = self._full.data(np.concatenate(values))
        return data if self._inside is None else self._inside.data(data)

    def displacement(self, increment: Array, y1: Array) -> Array:
        """Change (rows, 3) of the coordinates that an increment of the unknowns makes."""
        return self._expanded(increment)[: self.system.n].reshape(-1, 3)

    def move(self, increment: Array) -> None:
        """Add an increment of the unknowns to the coordinates and multipliers."""
        n = self.system.n
        increment = self._expanded(increment)
        factor = self.gap_scale if self.scaled else self.h
        q, multiplier = self.sought
        q = self._turned(increment[:n].reshape(-1, 3)) if self._large else q + increment[:n]
        self.sought = q, multiplier + factor * increment[n:]

    def _turned(self, change: Array) -> Array:
        """With an increment (rows, 3) of an equilibrium, that of directors as a finite rotation.

        Steps on a path may be large: added up, directors would get longer. The derivative is the
        same, a solution fulfils the constraints as before.
        """
        rows = self.system.kinematics.director_rows
        q = self.sought[0].reshape(-1, 3)
        D = q[rows]
        omega = 0.5 * cross(D, change[rows]).sum(1)
        if (plane := self.system.plane) is not None:
            omega = (omega @ plane.normal)[:, None] * plane.normal
        out = q + change
        out[rows] = D @ rotation_matrix(exp_quaternion(omega)).transpose(0, 2, 1)
        return out.reshape(-1)

    def impulse(self, R: Array) -> Array:
        """Constraint impulse ``h G^T lambda`` (rows, 3) at the solution.

        In a scene confined to a plane its part out of the plane is what balances R there.
        """
        force = self._found
        if self._inside is not None:
            other = -R.reshape(-1)
            force = other + self._inside.within(force - other)
        return force.reshape(-1, 3)

    @property
    def multipliers(self) -> Array:
        """``lambda`` (m,) of the step just solved."""
        return self.sought[1] / self.h
