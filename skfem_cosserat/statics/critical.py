"""Stability of equilibria, motions that nothing holds, and critical points of a path."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from scipy.linalg import eig, eigh
from scipy.sparse.linalg import ArpackError, eigs, eigsh

from ..diagnostics.nearest import free_motion
from ..diagnostics.stacked import ReducedTangent, reduced_tangent, weights
from ..kernels import nearest_rotations
from ..linear import EIGENVALUES, NEUTRAL, negative_pivots
from ..model import System
from ..model.balance import Amplitudes, balance
from ..types import Array, Floats, largest
from .control import Functional, Point
from .problem import Neutral, PathSolver, Pivots

# -- stability of an equilibrium: eigenvalues of its stiffness, or the pivots of an elimination ----

#: relative difference of K and its transpose above which forces count as not conservative: with
#: conservative ones it is rounding, below one unit of it (measured)
SYMMETRIC = 1e-14
#: relative difference of a block left in an elimination and its transpose above which forces are
#: certainly not conservative: rounding was below 1e-13 (measured)
SKEW = 1e-8
#: smallest pivot, against that eigenvalue, above which none is looked for: where a motion is small
#: at the last unknown, the pivot is larger than the eigenvalue by its square; the largest entry may
#: be larger than the largest pivot of an elimination in blocks
SUSPECT = 4e8
#: eigenvalue, relative to the terms of its own motion, above which the stiffness is a true one,
#: however small beside the largest entry of K: of neutral motions it was below 5e-16, of a soft
#: beam on a stiff one above 3e-11 (measured)
OWN = 1e-13
#: of such motions at most as many are sought: turns about axes of symmetry are few
MOST_NEUTRAL = 6
#: how much larger the eigenvalue may be after a step, to count as neutral still
LOOSE = 100.0


@dataclass(eq=False)
class Stability:
    """Stability of a point.

    Attributes
    ----------
    point : Point
    unstable : int
        Negative eigenvalues of the reduced stiffness. With forces that are not conservative they
        may pass zero in pairs without any equilibrium near: then 1 if its determinant is
        negative, else 0.
    symmetric : bool
        Whether the forces are conservative.
    pivot : float
        Smallest pivot of an elimination, in magnitude: a neutral motion makes it small.
    assemble : callable
        Gives the :class:`ReducedTangent` there, for what more is asked.
    firm : bool
        Whether the pivots leave no room for neutral motions.
    """

    point: Point
    unstable: int
    symmetric: bool
    pivot: float
    assemble: Callable[[], ReducedTangent]
    firm: bool = False

    @cached_property
    def tangent(self) -> ReducedTangent:
        """Stiffness and metric."""
        return self.assemble()

    @property
    def smallest(self) -> float:
        """Magnitude of the eigenvalue nearest to zero."""
        return float(abs(self._eigen(1)[0][0]))

    @property
    def floor(self) -> float:
        """Eigenvalue that cannot be told from zero."""
        return NEUTRAL * largest(self.tangent.K.data)

    @property
    def neutral(self) -> bool:
        """True if the smallest eigenvalue cannot be told from zero."""
        if self.firm or self.pivot > SUSPECT * self.floor:
            return False
        return self.smallest <= self.floor

    @property
    def firmly_unstable(self) -> int:
        """Unstable motions without neutral ones, whose sign is an accident of rounding."""
        if not (self.symmetric and self.unstable and self.neutral):
            return self.unstable
        K = self.tangent.K
        return negative_pivots(0.5 * (K + K.T) + 2 * self.floor * self.tangent.metric)[0]

    def neutral_motions(self, system: System, beside: Floats | None = None) -> Neutral:
        """Motions that nothing holds, normal to the one (rows, 3) that a branch sets off along.

        Small beside the stiffness of other parts is not enough: a soft part is no free one.
        """
        if not self.neutral:
            return Neutral()
        W = np.sqrt(weights(system))
        values, modes = self.nearest(min(MOST_NEUTRAL, self.tangent.K.shape[0]))
        own = (abs(modes) * (abs(self.tangent.K) @ abs(modes))).sum(0)
        modes = modes[:, abs(values) <= np.minimum(self.floor, OWN * own)]
        if not modes.shape[1]:
            return Neutral()
        moved = W.repeat(3)[:, None] * (self.tangent.P @ modes)
        if beside is not None:
            moved = np.column_stack([(W * beside).ravel(), moved])
        Q, R = np.linalg.qr(moved)
        keep = abs(np.diag(R)) > 1e-6 * abs(R).max()
        keep[: beside is not None] = False
        kept = [q.reshape(-1, 3) / W for q in Q[:, keep].T]
        # the metric here is a sum over the nodes, there a mean
        return Neutral(kept, LOOSE * self.floor * len(system.origin_rows))

    def free_motion(self, system: System) -> tuple[str, str] | None:
        """The item that moves most in a motion that nothing holds, and the motion in words."""
        if self.firm or self.pivot > SUSPECT * self.floor:
            return None
        return free_motion(system, self.tangent)

    def crossed(self, later: Stability) -> bool:
        """True if an eigenvalue has changed its sign between two points of a path."""
        change = later.unstable - self.unstable
        if not (change if self.symmetric and later.symmetric else change % 2):
            return False
        return not (self.neutral and later.neutral)

    def nearest(self, count: int = 1) -> tuple[Floats, Floats]:
        """Eigenvalues nearest to zero (count,) of K against the metric, and modes (unknowns, k)."""
        values, modes = self._eigen(count)
        return np.real(values), np.real(modes)

    def _eigen(self, count: int) -> tuple[Array, Array]:
        K = self.tangent.K
        metric = self.tangent.metric
        if self.symmetric:
            K = 0.5 * (K + K.T)
        n = K.shape[0]
        if not K.data.any():
            return np.zeros(min(count, n)), np.eye(n, count)[:, :n]
        if n <= max(EIGENVALUES, count + 2):
            if self.symmetric:
                values, vectors = eigh(K.toarray(), metric.toarray())
            else:
                values, vectors = eig(K.toarray(), metric.toarray())
            keep = np.argsort(abs(values))[:count]
            return values[keep], vectors[:, keep]
        solver = eigsh if self.symmetric else eigs
        # the same start each time: modes of equal eigenvalues would be others each time
        start = np.random.default_rng(0).standard_normal(n)
        options = {"k": count, "M": metric.tocsc(), "which": "LM", "v0": start}
        try:
            values, vectors = solver(K.tocsc(), sigma=0.0, **options)
        except (RuntimeError, ArpackError):  # exactly singular: a shift that rounding sees
            shift = -1e-10 * (abs(K.diagonal()).max() / metric.diagonal().max())
            values, vectors = solver(K.tocsc(), sigma=shift, **options)
        order = np.argsort(abs(values))
        return values[order], vectors[:, order]


def _tangent(system: System, point: Point, amplitudes: Amplitudes) -> ReducedTangent:
    """Stiffness and metric at an equilibrium."""
    at = balance(system, point.y, amplitudes, turns=point.turns)
    return reduced_tangent(system, point.y, amplitudes, at)


def inspect(
    system: System, point: Point, amplitudes: Amplitudes, pivots: Pivots | None = None
) -> Stability:
    """Stability of an equilibrium.

    Pivots of its stiffness, if they are known, do where they tell: the smallest one is not small
    enough to be that of a neutral motion, and forces are conservative, or certainly not.
    """
    dead = system.dead_only
    assemble = partial(_tangent, system, point, amplitudes)
    firm = pivots is not None and pivots.smallest > SUSPECT * NEUTRAL * pivots.largest
    if pivots is not None and firm and (dead or pivots.skew > SKEW * pivots.largest):
        unstable = pivots.negative if dead else int(pivots.odd)
        return Stability(point, unstable, dead, pivots.smallest, assemble, firm)
    tangent = assemble()
    K = tangent.K
    symmetric = dead or bool(abs((K - K.T).data).max(initial=0.0) <= SYMMETRIC * largest(K.data))
    unstable, pivot = negative_pivots(0.5 * (K + K.T) if symmetric else K)
    count = unstable if symmetric else unstable % 2
    return Stability(point, count, symmetric, pivot, lambda: tangent)


# -- limit and bifurcation points of a path: where stiffness is lost, and in which motion ----------

#: critical points sought within one step
MOST = 20
#: slope of the load factor along the path, in steps of equal size, below which it is a limit point
LEVEL = 1e-2
#: distances of points, as shares of the step, between which a critical one is interpolated, and
#: how much closer they are tried where others are near, or it is not in the middle
AROUND = (0.02, 0.05, 0.09, 0.14, 0.2)
CLOSER = (1.0, 0.8, 0.2, 0.1, 0.04)
#: eigenvalue, against those at the ends of the step, below which it counts as zero
VANISHED = 1e-3
#: how exactly a change of the number of unstable motions is found, as a share of the step
ROOT = 1e-9
#: weight of the load factor against motions: it leads where nothing moves
LEADING = 1e-12


@dataclass(eq=False)
class Critical:
    """A critical point of a path.

    Attributes
    ----------
    kind : {"limit", "bifurcation"}
    stability : Stability
        At the point.
    constraint_force : (n,) array
    multiplicity : int
        Eigenvalues that change sign there.
    after : Stability
        A little further.
    """

    kind: str
    stability: Stability
    constraint_force: Floats
    multiplicity: int
    after: Stability


class _Between:
    """Points between two of a path, by their share s of the secant."""

    def __init__(self, solver: PathSolver, first: Stability, last: Stability):
        self.system = solver.system
        self.solver = solver
        self.first = first
        self.last = last
        start = first.point
        end = last.point
        dy = (end.y - start.y)[: self.system.rows]
        dt = end.t - start.t
        W = weights(self.system)
        share = LEADING / max(abs(start.t), abs(end.t)) ** 2
        self._secant = W * dy, share * dt, float((W * dy**2).sum()) + share * dt**2
        #: stability and constraint force of points that were solved for
        self._found: dict[float, tuple[Stability, Floats]] = {}

    def at(self, s: float) -> tuple[Stability, Floats]:
        """Stability of a point and its constraint force (n,). Raises _LostError."""
        if s not in self._found:
            gradient, by_factor, size = self._secant
            target = Functional(gradient, by_factor, s * size)
            solution, _ = self.solver.solve(self.first.point, target)
            if solution is None:
                raise _LostError(s)
            self._found[s] = self.stability(solution.point), solution.constraint_force
        return self._found[s]

    def stability(self, point: Point) -> Stability:
        """Stability of a point, without what its solution tells."""
        return inspect(self.system, point, self.solver.schedule.at(point.t))

    def value(self, s: float) -> float:
        """The eigenvalue nearest to zero, signed by the number of unstable motions."""
        stability = {0.0: self.first, 1.0: self.last}.get(s) or self.at(s)[0]
        return (
            -stability.smallest if stability.unstable != self.first.unstable else stability.smallest
        )

    def around(
        self, guess: float, closer: float
    ) -> tuple[dict[float, tuple[Stability, Floats]], Floats]:
        """Points on both sides of a guess by their shares, and what vanishes between them.

        That is the mean of the eigenvalues that change their sign.
        """
        found = {}
        for share in (guess + closer * np.array([*(-np.array(AROUND[::-1])), *AROUND])).tolist():
            with suppress(_LostError):
                found[share] = self.at(share)
        start = self.first.unstable
        later = [k.unstable for s, (k, _) in found.items() if s > guess and k.unstable != start]
        counts = start, *later[:1]
        change = counts[-1] - counts[0]

        def mean(stability: Stability, sign: int) -> float:
            values = stability.nearest(abs(change) + 2)[0]
            # of others that are near the sign is another one
            own = values[values * sign > 0] if stability.symmetric else sign * abs(values)
            return float(own[: max(1, abs(change))].mean()) if len(own) else 0.0

        values = {
            s: mean(stability, int(np.sign(change if s < guess else -change)))
            for s, (stability, _) in found.items()
            if stability.unstable == counts[-1 if s > guess else 0]
        }
        kept = {s: value for s, value in values.items() if value}
        return {s: found[s] for s in kept}, np.array([*kept.values()])


def locate(solver: PathSolver, first: Stability, last: Stability) -> Critical | None:
    """The critical point between two points of a path with unlike numbers of unstable motions.

    The eigenvalue nearest to zero, signed by that number, is a continuous function along the
    secant; Brent's method finds its root, as pivots tell the number to more digits than it has. If
    several lie between, it is the first of them or, of several pairs, one of them. The matrix is
    singular there: the point is interpolated between some around it, and so is the root where
    Newton's method does not come near enough.
    """
    if not first.crossed(last):
        return None
    from scipy.optimize import brentq  # slow to import, seldom needed

    between = _Between(solver, first, last)
    lost = False
    try:
        s = float(brentq(between.value, 0.0, 1.0, xtol=ROOT, rtol=ROOT))
    except _LostError as error:
        s = error.s
        lost = True
    for closer in CLOSER:
        samples, values = between.around(s, closer)
        shares = np.array([*samples])
        root = np.inf
        before = int((shares < s).sum())
        if min(before, len(shares) - before) >= 2:
            scaled = _polynomial(shares, values / abs(values).max(), s)
            root = np.ptp(shares) * _nearest_root(scaled)
        if abs(root) < closer * AROUND[0] / 4:
            found = _classified(between, s + root if lost else s, samples)
            if found is not None:
                return found
        if abs(root) <= AROUND[-1]:
            s = s + root
            lost = True
    return None


def _polynomial(shares: Floats, values: Floats, s: float) -> Floats:
    """Coefficients of that through values, of the distance from s over the width of all shares."""
    return np.polyfit((shares - s) / np.ptp(shares), values, len(shares) - 1)


def _nearest_root(polynomial: Array) -> float:
    """The real root nearest to zero; infinite: there is none."""
    roots = np.roots(polynomial)
    real = np.real(roots[abs(np.imag(roots)) < 1e-9])
    return float(real[abs(real).argmin()]) if len(real) else np.inf


def _classified(
    between: _Between, s: float, samples: dict[float, tuple[Stability, Floats]]
) -> Critical | None:
    """The point at s by the polynomial through the samples; its triads are orthonormal.

    A limit point is where the load factor is level: that has no rounding of the stiffest parts,
    as eigenvalues have.
    """
    shares = np.array([*samples])
    schedule = between.solver.schedule
    each, forces = zip(*samples.values(), strict=True)
    before, after = (each[int((shares < s).sum()) + k] for k in (-1, 0))
    times = np.array([stability.point.t for stability in each])
    width = float(np.ptp(shares))
    slopes = np.polyder(_polynomial(shares, times - times.mean(), s)) / width
    middle = 0.5 * (before.point.t + after.point.t)
    scale = max(abs(middle - between.first.point.t), abs(between.last.point.t - middle))
    multiplicity = max(1, abs(after.unstable - before.unstable))
    level = multiplicity == 1 and abs(slopes[-1]) <= LEVEL * scale
    crest = s + width * _nearest_root(slopes) if level else np.inf
    if certain := abs(crest - s) < AROUND[0]:
        s = crest
    others = [np.delete(shares, k) for k in range(len(shares))]
    factors = np.array([np.prod((s - x) / (a - x)) for a, x in zip(shares, others, strict=True)])
    y = np.tensordot(factors, [stability.point.y for stability in each], 1)
    t = float(factors @ times)
    rows = between.system.kinematics.director_rows
    y[rows] = nearest_rotations(y[rows])
    y[between.system.rows :] = schedule.ground(t)
    stability = between.stability(Point(y, t, before.point.turns))
    small = VANISHED * max(between.first.smallest, between.last.smallest)
    if not certain and stability.smallest > small:
        return None
    kind = "limit" if level else "bifurcation"
    return Critical(kind, stability, np.tensordot(factors, forces, 1), multiplicity, after)


def locate_all(solver: PathSolver, first: Stability, last: Stability) -> list[Critical]:
    """All critical points between two points of a path, one after the other, see :func:`locate`."""
    out: list[Critical] = []
    while len(out) < MOST and (found := locate(solver, first, last)) is not None:
        out.append(found)
        first = found.after
    return out


class _LostError(Exception):
    """Newton's method did not find a point between two others, at the share s."""

    def __init__(self, s: float):
        self.s = s
        super().__init__(f"no point at {s:.6g} of the step")
