"""Stability of equilibria and critical points of a path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import eig, eigh, get_lapack_funcs
from scipy.sparse import coo_matrix, csr_matrix, identity
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import ArpackError, eigs, eigsh, splu

from ..diagnostics.stacked import ReducedTangent, reduced_tangent
from ..linear import BAND, EIGENVALUES, Band
from ..model import System
from ..model.balance import Amplitudes, balance
from ..pattern import FrozenPattern, sum_at
from ..types import Array, Floats, IndexArray
from .schedule import Functional, Neutral, Point, Schedule, weights

# -- stability of an equilibrium: eigenvalues of its stiffness, or the pivots of an elimination ----

#: relative difference of K and its transpose above which forces count as not conservative: with
#: conservative ones it is rounding, below one unit of it (measured)
SYMMETRIC = 1e-14
#: relative difference of a block left in an elimination and its transpose above which forces are
#: certainly not conservative: rounding was below 1e-13 (measured)
SKEW = 1e-8
#: eigenvalue, relative to the largest entry of K, below which a motion counts as neutral: of a
#: section bent in one of its equivalent directions it was below 0.6 units of rounding (measured)
NEUTRAL = 1e-15
#: smallest pivot, against that eigenvalue, above which none is looked for: where a motion is small
#: at the last unknown, the pivot is larger than the eigenvalue by its square
SUSPECT = 1e8
#: how much larger the smallest pivot of an elimination in blocks must be to do without: the largest
#: entry of K may be larger than the largest pivot
FIRM = 4.0
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
    """

    point: Point
    unstable: int
    symmetric: bool
    pivot: float
    assemble: Callable[[], ReducedTangent]

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
        return NEUTRAL * float(abs(self.tangent.K.data).max(initial=0.0))

    @property
    def neutral(self) -> bool:
        """Whether the smallest one cannot be told from zero."""
        return self.pivot <= SUSPECT * self.floor and self.smallest <= self.floor

    @property
    def firmly_unstable(self) -> int:
        """Unstable motions without neutral ones, whose sign is an accident of rounding."""
        if not (self.symmetric and self.unstable and self.neutral):
            return self.unstable
        K, metric = self.tangent.K, self.tangent.metric
        return _negative(0.5 * (K + K.T) + 2 * self.floor * metric)[0]

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
        motions = [(W * (self.tangent.P @ m).reshape(-1, 3)).ravel() for m in modes.T]
        if beside is not None:
            motions = [(W * beside).ravel(), *motions]
        Q, R = np.linalg.qr(np.column_stack(motions))
        keep = abs(np.diag(R)) > 1e-6 * abs(R).max()
        if beside is not None:
            keep[0] = False
        kept = [q.reshape(-1, 3) / W for q in Q[:, keep].T]
        # the metric here is a sum over the nodes, there a mean
        return Neutral(kept, LOOSE * self.floor * len(system.origin_rows))

    def crossed(self, later: Stability) -> bool:
        """Whether an eigenvalue has changed its sign between two points of a path."""
        change = later.unstable - self.unstable
        both = self.symmetric and later.symmetric
        if not (change if both else change % 2):
            return False
        return not (self.neutral and later.neutral)

    def nearest(self, count: int = 1) -> tuple[Floats, Floats]:
        """Eigenvalues nearest to zero (count,) of K against the metric, and modes (unknowns, k)."""
        values, modes = self._eigen(count)
        return np.real(values), np.real(modes)

    def _eigen(self, count: int) -> tuple[Array, Array]:
        K, metric = self.tangent.K, self.tangent.metric
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
        options = {"k": count, "M": metric.tocsc(), "which": "LM", "v0": _start(n)}
        try:
            values, vectors = solver(K.tocsc(), sigma=0.0, **options)
        except (RuntimeError, ArpackError):  # exactly singular: a shift that rounding sees
            shift = -1e-10 * float(abs(K.diagonal()).max() / metric.diagonal().max())
            values, vectors = solver(K.tocsc(), sigma=shift, **options)
        order = np.argsort(abs(values))
        return values[order], vectors[:, order]


class FirmStability(Stability):
    """Of a point whose pivots leave no room for neutral motions: no stiffness for that."""

    @property
    def neutral(self) -> bool:
        """There is none."""
        return False


def _start(n: int) -> Floats:
    return np.random.default_rng(0).standard_normal(n)


def tangent_at(
    system: System, point: Point, amplitudes: Amplitudes, relief: Floats | None = None
) -> ReducedTangent:
    """Stiffness and metric at an equilibrium, see :func:`inspect`."""
    at = balance(system, point.y, amplitudes, turns=point.turns)
    if relief is not None:
        at.R = at.R - relief
    return reduced_tangent(system, point.y, amplitudes, at)


def inspect(
    system: System, point: Point, amplitudes: Amplitudes, relief: Floats | None = None
) -> Stability:
    """Stability of an equilibrium, `relief` (rows, 3) are forces left out of the balance."""
    tangent = tangent_at(system, point, amplitudes, relief)
    K = tangent.K
    size = float(abs(K.data).max(initial=0.0))
    difference = abs((K - K.T).data).max(initial=0.0)
    symmetric = system.loading.dead_only or bool(difference <= SYMMETRIC * size)
    unstable, pivot = _negative(0.5 * (K + K.T)) if symmetric else _determinant(K)
    return Stability(point, unstable, symmetric, pivot, lambda: tangent)


class Pivots(NamedTuple):
    """Of an elimination of the stiffness along the constraints, without exchange of rows.

    Attributes
    ----------
    negative : int
        How many, of the symmetric part.
    smallest, largest : float
        In magnitude; the largest may be that of an entry.
    skew : float
        Largest difference of entries, or of those of blocks left, and their mirror images.
    odd : bool
        Whether the determinant is negative.
    """

    negative: int
    smallest: float
    largest: float
    skew: float
    odd: bool


class Elimination:
    """Finds the pivots of matrices of one pattern.

    Most equilibria are stable. Their pivots are those of a Cholesky factorisation, which costs a
    small part of an elimination that counts signs: this one is left to where it fails.

    Parameters
    ----------
    pattern : FrozenPattern
        Square.
    """

    def __init__(self, pattern: FrozenPattern) -> None:
        self._pattern, n = pattern, pattern.shape[0]
        band = Band(pattern)
        i = band.position[pattern.indices]
        j = band.position[np.repeat(np.arange(n), np.diff(pattern.indptr))]
        width = 1 + max(band.lower, band.upper)
        self._narrow, self._shape = width <= BAND, (width, n)
        #: of each entry: its place in the lower triangle, its share of that of the symmetric part
        self._where = abs(i - j) + width * np.minimum(i, j)
        self._share, self._side = np.where(i == j, 1.0, 0.5), np.sign(i - j)
        self._pbtrf = get_lapack_funcs("pbtrf", dtype=np.float64)

    def pivots(self, data: Floats, symmetric: bool) -> Pivots:
        """Of the matrix with these entries; `symmetric`: it is so, but for rounding."""
        largest, skew = float(abs(data).max(initial=0.0)), 0.0
        size = self._shape[0] * self._shape[1]
        if not symmetric:
            skew = float(abs(sum_at(self._where, data * self._side, size)).max(initial=0.0))
        if not symmetric and skew > SKEW * largest:
            odd, smallest = _determinant(self._pattern.assembled(data))
            return Pivots(0, smallest, largest, skew, bool(odd))
        if self._narrow:
            band = sum_at(self._where, data * self._share, size).reshape(self._shape, order="F")
            factors, failed = self._pbtrf(band, lower=1, overwrite_ab=True)
            if not failed:
                smallest = float(np.square(factors[0]).min(initial=np.inf))
                return Pivots(0, smallest, largest, skew, False)
        K = self._pattern.assembled(data)
        negative, smallest = _negative(0.5 * (K + K.T))
        return Pivots(negative, smallest, largest, skew, bool(negative % 2))


def counted(
    system: System, point: Point, amplitudes: Amplitudes, pivots: Pivots | None
) -> Stability:
    """Stability of an equilibrium from the pivots of its stiffness.

    Where they do not tell, since the smallest may be that of a neutral motion, or forces may be
    conservative or not, all is done again as in :func:`inspect`.
    """
    symmetric = system.loading.dead_only
    firm = pivots is not None and pivots.smallest > FIRM * SUSPECT * NEUTRAL * pivots.largest
    if pivots is None or not firm or not (symmetric or pivots.skew > SKEW * pivots.largest):
        return inspect(system, point, amplitudes)
    assemble = partial(tangent_at, system, point, amplitudes)
    unstable = pivots.negative if symmetric else int(pivots.odd)
    return FirmStability(point, unstable, symmetric, pivots.smallest, assemble)


def _determinant(K: csr_matrix) -> tuple[int, float]:
    """1 if the determinant is negative, else 0, and the smallest pivot."""
    try:
        factors = splu(K.tocsc())
    except RuntimeError:  # a pivot vanishes
        return 0, 0.0
    pivots = factors.U.diagonal()
    sign = float(np.prod(np.sign(pivots))) * _parity(factors.perm_r) * _parity(factors.perm_c)
    return int(sign < 0), float(abs(pivots).min(initial=np.inf))


def _parity(order: IndexArray) -> int:
    """Sign of a permutation, from the number of its cycles."""
    n = len(order)
    steps = coo_matrix((np.ones(n), (np.arange(n), order)), shape=(n, n))
    cycles, _ = connected_components(steps, directed=False)
    return 1 if (n - cycles) % 2 == 0 else -1


def _negative(K: csr_matrix) -> tuple[int, float]:
    """Negative and smallest pivots of an elimination without exchange of rows.

    The former are as many as the negative eigenvalues (Sylvester's law of inertia).
    """
    if K.shape[0] == 0:
        return 0, np.inf
    options = {"SymmetricMode": True}
    none = NEUTRAL * float(abs(K.data).max(initial=0.0)) or 1.0
    # a large one that is exactly singular: motions without stiffness get one that counts as none
    for shift in (0.0, none) if K.shape[0] > EIGENVALUES else (0.0,):
        try:
            factors = splu(
                (K + shift * identity(K.shape[0])).tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options=options,
            )
        except RuntimeError:  # a pivot vanishes
            continue
        if (factors.perm_r == factors.perm_c).all():
            pivots = factors.U.diagonal()
            return int((pivots < 0).sum()), 0.0 if shift else float(abs(pivots).min())
    values = np.linalg.eigvalsh(K.toarray())
    return int((values < 0).sum()), float(abs(values).min())


# -- limit and bifurcation points of a path: where stiffness is lost, and in which motion ----------

#: critical points sought within one step
MOST = 20
#: slope of the load factor along the path, in steps of equal size, below which it is a limit point
LEVEL = 1e-2
#: how exactly a critical point is found, and the distance for that slope, as a share of the step
ROOT, NEAR = 1e-9, 1e-3
#: eigenvalue, against those at the ends of the step, below which it counts as zero
VANISHED = 1e-5
#: distances of the points, as shares of the step, between which one is interpolated, how often,
#: and the eigenvalue, against those at the ends, that such a point may have
AROUND, REFINED, SMALL = (0.02, 0.05, 0.09, 0.14, 0.2), 4, 1e-3
#: how much farther away from a root than by an eigenvalue that cannot be told from zero the load
#: factor may be level: for a toggle without shear it was about as far (measured)
BLURRED = 100.0
#: weight of the load factor against motions: it leads where nothing moves
RIGID = 1e-12


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


#: solves for the point that fulfils a functional from a start: point and constraint force, or None
Solve = Callable[[Point, Functional], tuple[Point, Floats] | None]


class _Between:
    """Points between two of a path, by their share s of the secant."""

    def __init__(self, solve: Solve, schedule: Schedule, ends: tuple[Stability, Stability]) -> None:
        self.system, self._solve, self.schedule = schedule.system, solve, schedule
        self.ends = self.first, self.last = ends
        start, end = self.first.point, self.last.point
        dy, dt = (end.y - start.y)[: self.system.rows], end.t - start.t
        W = weights(self.system)
        share = RIGID / max(abs(start.t), abs(end.t)) ** 2
        self._secant = W * dy, share * dt, float((W * dy**2).sum()) + share * dt**2
        self._found = {0.0: self.first, 1.0: self.last}
        self._forces: dict[float, Floats] = {}

    def at(self, s: float) -> Stability:
        """Raises _LostError."""
        if s not in self._found:
            self._found[s] = self.stability(self._solved(self.first.point, s, s))
        return self._found[s]

    def _solved(self, start: Point, way: float, s: float) -> Point:
        """The point at s, which is a way further than the start; its force is kept."""
        gradient, by_factor, size = self._secant
        solution = self._solve(start, Functional(gradient, by_factor, way * size))
        if solution is None:
            raise _LostError(s)
        self._forces[s] = solution[1]
        return solution[0]

    def stability(self, point: Point) -> Stability:
        return inspect(self.system, point, self.schedule.at(point.t))

    def force(self, s: float) -> Floats:
        """Constraint force (n,); that of an end is solved for there. Raises _LostError."""
        if s not in self._forces:
            self._solved(self._found[s].point, 0.0, s)
        return self._forces[s]

    def value(self, s: float) -> float:
        """The eigenvalue nearest to zero, signed by the number of unstable motions."""
        stability = self.at(s)
        return (
            -stability.smallest if stability.unstable != self.first.unstable else stability.smallest
        )

    def middle(self) -> float:
        """A guess of the root from both ends alone."""
        a, b = (self.mean(stability) for stability in self.ends)
        return a / (a + b)

    def mean(self, stability: Stability) -> float:
        """Mean magnitude of as many eigenvalues as change their sign."""
        count = max(1, abs(self.last.unstable - self.first.unstable))
        return float(abs(stability.nearest(count)[0]).mean())

    @property
    def blur(self) -> float:
        """What rounding of eigenvalues, which comes from the stiffest parts, leaves open of s.

        Zero if that is so much that no point is told from others.
        """
        ends = max(self.first.smallest, self.last.smallest)
        blur = BLURRED * max(self.first.floor, self.last.floor) / ends
        return blur if blur < AROUND[2] else 0.0

    def levelled(self, s: float) -> float:
        """Where the load factor, which has no such rounding, is level if that is s by all we know.

        Else s: a bifurcation, or eigenvalues without much rounding.
        """
        if self.blur <= ROOT or not (self.first.symmetric and self.last.symmetric):
            return s
        shares = np.array([s + side * d for d in AROUND for side in (-1, 1)])
        times = np.array([self.at(k).point.t for k in shares.tolist()])
        x = (shares - s) / AROUND[-1]
        roots = np.roots(np.polyder(np.polyfit(x, times - times.mean(), len(x) - 1)))
        real = np.real(roots[abs(np.imag(roots)) < 1e-9])
        found = s + AROUND[-1] * real[abs(real).argmin()] if len(real) else s
        return float(found if abs(found - s) <= self.blur else s)

    def sound(self, s: float) -> bool:
        """Whether an eigenvalue vanishes there, and not only the number changes."""
        ends = max(self.first.smallest, self.last.smallest)
        return self.at(s).smallest <= max(VANISHED, self.blur) * ends or self.at(s).neutral


def locate(solve: Solve, schedule: Schedule, ends: tuple[Stability, Stability]) -> Critical | None:
    """The critical point between two points of a path with unlike numbers of unstable motions.

    The eigenvalue nearest to zero, signed by that number, is a continuous function along the
    secant; Brent's method finds its root. If several lie between, it is the first of them or, of
    several pairs, one of them. Where Newton's method does not come near enough, since the matrix
    is singular there, the point is interpolated between some around it.
    """
    if not ends[0].crossed(ends[1]):
        return None
    from scipy.optimize import brentq  # slow to import, seldom needed

    between = _Between(solve, schedule, ends)
    try:
        s = float(brentq(between.value, 0.0, 1.0, xtol=ROOT, rtol=ROOT, maxiter=60))
        s = between.levelled(s)
        if between.sound(s):
            near = max(NEAR, between.blur)
            before, after = between.at(s - near), between.at(s + near)
            # a point that has slipped onto a branch may have a neutral motion
            if before.crossed(after) and not (before.neutral or after.neutral):
                slope = (after.point.t - before.point.t) / (2 * near)
                sides = before, after
                return _classified(between, between.at(s), between.force(s), slope, sides)
    except _LostError as lost:
        s = lost.s
    return _interpolated(between, (s, between.middle()))


def _classified(
    between: _Between,
    stability: Stability,
    force: Floats,
    slope: float,
    sides: tuple[Stability, Stability],
) -> Critical:
    t, before, after = stability.point.t, *sides
    scale = max(abs(t - between.first.point.t), abs(between.last.point.t - t))
    multiplicity = max(1, abs(after.unstable - before.unstable))
    level = multiplicity == 1 and abs(slope) <= LEVEL * scale
    return Critical("limit" if level else "bifurcation", stability, force, multiplicity, after)


def _interpolated(between: _Between, guesses: Sequence[float]) -> Critical | None:
    """The critical point from some around it, with eigenvalues that go smoothly through zero."""
    for guess in guesses:
        for _ in range(REFINED):
            samples = _around(between, guess)
            root = _root(between, samples, guess)
            if root is None:
                break
            moved, guess = abs(root - guess), root
            if moved < AROUND[0] / 4:
                found = _mean(between, samples, root)
                if found.stability.smallest <= SMALL * max(k.smallest for k in between.ends):
                    return found
                break
    return None


def _around(between: _Between, guess: float) -> list[tuple[float, Stability]]:
    """Points on both sides, that are not on the branch: nearest first."""
    out = []
    slope = sum(between.mean(end) for end in between.ends)
    for d in AROUND:
        for s, end in zip((guess - d, guess + d), between.ends, strict=True):
            try:
                stability = between.at(s)
            except _LostError:
                continue
            if stability.unstable == end.unstable and between.mean(stability) > 0.2 * d * slope:
                out.append((s, stability))
    return out


def _root(between: _Between, samples: list[tuple[float, Stability]], guess: float) -> float | None:
    """Where the mean of the eigenvalues that change their sign vanishes."""
    x = (np.array([s for s, _ in samples]) - guess) / AROUND[-1]
    if min((x < 0).sum(), (x > 0).sum()) < 2:
        return None
    f = np.array([between.mean(stability) for _, stability in samples]) * -np.sign(x)
    roots = np.roots(np.polyfit(x, f / abs(f).max(), len(x) - 1))
    real = np.real(roots[abs(np.imag(roots)) < 1e-9])
    if not len(real) or abs(real).min() > 1:
        return None
    return guess + AROUND[-1] * float(real[abs(real).argmin()])


def _mean(between: _Between, samples: list[tuple[float, Stability]], s: float) -> Critical:
    """The point at s by the polynomial through the samples."""
    shares, reports = np.array([k for k, _ in samples]), [stability for _, stability in samples]
    points = [stability.point for stability in reports]
    forces = [between.force(k) for k in shares]
    point, force = interpolated(between.schedule, s, shares, points, forces)
    times, width = np.array([each.t for each in points]), AROUND[-1]
    slope = float(np.polyder(np.polyfit((shares - s) / width, times, len(shares) - 1))[-1] / width)
    sides = (
        max((k for k in samples if k[0] < s), key=lambda k: k[0])[1],
        min((k for k in samples if k[0] > s), key=lambda k: k[0])[1],
    )
    return _classified(between, between.stability(point), force, slope, sides)


def interpolated(
    schedule: Schedule, s: float, shares: Floats, points: Sequence[Point], forces: Sequence[Floats]
) -> tuple[Point, Floats]:
    """Point and constraint force at s by the polynomial through those at other shares.

    Its triads are orthonormal to rounding.
    """
    others = [np.delete(shares, k) for k in range(len(shares))]
    factors = np.array([np.prod((s - x) / (a - x)) for a, x in zip(shares, others, strict=True)])
    y = np.tensordot(factors, [point.y for point in points], 1)
    t = float(factors @ np.array([point.t for point in points]))
    rows = schedule.system.kinematics.director_rows
    U, _, V = np.linalg.svd(y[rows])
    y[rows] = U @ V
    y[schedule.system.rows :] = schedule.ground(t)
    return Point(y, t, points[0].turns), np.tensordot(factors, forces, 1)


def locate_all(
    solve: Solve, schedule: Schedule, ends: tuple[Stability, Stability]
) -> list[Critical]:
    """All critical points between two points of a path, one after the other, see :func:`locate`."""
    out: list[Critical] = []
    first, last = ends
    while len(out) < MOST:
        found = locate(solve, schedule, (first, last))
        if found is None:
            break
        out.append(found)
        first = found.after
    return out


class _LostError(Exception):
    """Newton's method did not find a point between two others, at the share s."""

    def __init__(self, s: float) -> None:
        self.s = s
        super().__init__(f"no point at {s:.6g} of the step")
