"""Limit and bifurcation points of a path: where stiffness is lost, and in which motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from ..model import System
from ..model.balance import Amplitudes
from ..types import Floats
from .point import Functional, Point
from .stability import Look, inspect

__all__ = ["Critical", "locate", "locate_all"]

#: critical points sought within one step
MOST = 20
#: slope of the load factor along the path, in steps of equal size, below which it is a limit point
LEVEL = 1e-2
#: how exactly a critical point is found, and the distance for that slope, as a share of the step
ROOT, NEAR = 1e-9, 1e-3
#: eigenvalue, against those at the ends of the step, below which it counts as zero
VANISHED = 1e-6
#: distances of the points, as shares of the step, between which one is interpolated, how often,
#: and the eigenvalue, against those at the ends, that such a point may have
AROUND, REFINED, SMALL = (0.02, 0.05, 0.09, 0.14, 0.2), 4, 1e-3
#: weight of the load factor against motions: it leads where nothing moves
RIGID = 1e-12


@dataclass(eq=False)
class Critical:
    """A critical point of a path.

    Attributes
    ----------
    kind : {"limit", "bifurcation"}
    look : Look
        At the point.
    constraint_force : (n,) array
    multiplicity : int
        Eigenvalues that change sign there.
    after : Look
        A little further.
    """

    kind: str
    look: Look
    constraint_force: Floats
    multiplicity: int
    after: Look


#: solves for the point that fulfils a functional from a start: point and constraint force, or None
Solve = Callable[[Point, Functional], tuple[Point, Floats] | None]


class _Between:
    """Points between two of a path, by their share s of the secant."""

    def __init__(
        self,
        system: System,
        solve: Solve,
        amplitudes: Callable[[float], Amplitudes],
        weights: Floats,
        ends: tuple[Look, Look],
    ) -> None:
        self.system, self._solve, self._amplitudes = system, solve, amplitudes
        self.ends = self.first, self.last = ends
        start, end = self.first.point, self.last.point
        dy = end.y[: len(weights)] - start.y[: len(weights)]
        dt = end.t - start.t
        share = RIGID / max(abs(start.t), abs(end.t)) ** 2
        self._secant = weights * dy, share * dt, float((weights * dy**2).sum()) + share * dt**2
        none = np.zeros(system.n)
        self._found: dict[float, tuple[Look, Floats]] = {
            0.0: (self.first, none),
            1.0: (self.last, none),
        }

    def at(self, s: float) -> Look:
        """Raises _LostError."""
        if s not in self._found:
            gradient, by_factor, size = self._secant
            solution = self._solve(self.first.point, Functional(gradient, by_factor, s * size))
            if solution is None:
                raise _LostError(s)
            self._found[s] = self.look(solution[0]), solution[1]
        return self._found[s][0]

    def look(self, point: Point) -> Look:
        return inspect(self.system, point, self._amplitudes(point.t))

    def force(self, s: float) -> Floats:
        return self._found[s][1]

    def value(self, s: float) -> float:
        """The eigenvalue nearest to zero, signed by the number of unstable motions."""
        look = self.at(s)
        return -look.smallest if look.unstable != self.first.unstable else look.smallest

    def middle(self) -> float:
        """A guess of the root from both ends alone."""
        a, b = (self.mean(look) for look in self.ends)
        return a / (a + b)

    def mean(self, look: Look) -> float:
        """Mean magnitude of as many eigenvalues as change their sign."""
        count = max(1, abs(self.last.unstable - self.first.unstable))
        return float(abs(look.nearest(count)[0]).mean())

    def sound(self, s: float) -> bool:
        """Whether an eigenvalue vanishes there, and not only the number changes."""
        ends = max(self.first.smallest, self.last.smallest)
        return self.at(s).smallest <= VANISHED * ends or self.at(s).neutral


def locate(
    system: System,
    solve: Solve,
    amplitudes: Callable[[float], Amplitudes],
    weights: Floats,
    ends: tuple[Look, Look],
) -> Critical | None:
    """The critical point between two points of a path with unlike numbers of unstable motions.

    The eigenvalue nearest to zero, signed by that number, is a continuous function along the
    secant; Brent's method finds its root. If several lie between, it is the first of them or, of
    several pairs, one of them. Where Newton's method does not come near enough, since the matrix
    is singular there, the point is interpolated between some around it.
    """
    if not ends[0].crossed(ends[1]):
        return None
    between = _Between(system, solve, amplitudes, weights, ends)
    try:
        s = float(brentq(between.value, 0.0, 1.0, xtol=ROOT, rtol=ROOT, maxiter=60))
        if between.sound(s):
            before, after = between.at(s - NEAR), between.at(s + NEAR)
            # a point that has slipped onto a branch may have a neutral motion
            if before.crossed(after) and not (before.neutral or after.neutral):
                slope = (after.point.t - before.point.t) / (2 * NEAR)
                sides = before, after
                return _classified(between, between.at(s), between.force(s), slope, sides)
    except _LostError as lost:
        s = lost.s
    return _interpolated(between, (s, between.middle()))


def _classified(
    between: _Between, look: Look, force: Floats, slope: float, sides: tuple[Look, Look]
) -> Critical:
    t, before, after = look.point.t, *sides
    scale = max(abs(t - between.first.point.t), abs(between.last.point.t - t))
    multiplicity = max(1, abs(after.unstable - before.unstable))
    level = multiplicity == 1 and abs(slope) <= LEVEL * scale
    return Critical("limit" if level else "bifurcation", look, force, multiplicity, after)


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
                if found.look.smallest <= SMALL * max(k.smallest for k in between.ends):
                    return found
                break
    return None


def _around(between: _Between, guess: float) -> list[tuple[float, Look]]:
    """Points on both sides, that are not on the branch: nearest first."""
    out = []
    slope = sum(between.mean(end) for end in between.ends)
    for d in AROUND:
        for s, end in zip((guess - d, guess + d), between.ends, strict=True):
            try:
                look = between.at(s)
            except _LostError:
                continue
            if look.unstable == end.unstable and between.mean(look) > 0.2 * d * slope:
                out.append((s, look))
    return out


def _root(between: _Between, samples: list[tuple[float, Look]], guess: float) -> float | None:
    """Where the mean of the eigenvalues that change their sign vanishes."""
    x = (np.array([s for s, _ in samples]) - guess) / AROUND[-1]
    if min((x < 0).sum(), (x > 0).sum()) < 2:
        return None
    f = np.array([between.mean(look) for _, look in samples]) * -np.sign(x)
    roots = np.roots(np.polyfit(x, f / abs(f).max(), len(x) - 1))
    real = np.real(roots[abs(np.imag(roots)) < 1e-9])
    if not len(real) or abs(real).min() > 1:
        return None
    return guess + AROUND[-1] * float(real[abs(real).argmin()])


def _mean(between: _Between, samples: list[tuple[float, Look]], s: float) -> Critical:
    """The point at s by the polynomial through the samples; its triads orthonormal to rounding."""
    shares, looks = np.array([k for k, _ in samples]), [look for _, look in samples]
    system = between.system
    weights = np.array(
        [
            np.prod((s - np.delete(shares, k)) / np.delete(x - shares, k))
            for k, x in enumerate(shares)
        ]
    )
    y = np.tensordot(weights, [look.point.y for look in looks], 1)
    times = np.array([look.point.t for look in looks])
    t = float(weights @ times)
    rows = system.kinematics.director_rows
    U, _, V = np.linalg.svd(y[rows])
    y[rows] = U @ V
    y[system.rows :] = system.ground(t)
    force = np.tensordot(weights, [between.force(k) for k in shares], 1)
    width = AROUND[-1]
    slope = float(np.polyder(np.polyfit((shares - s) / width, times, len(shares) - 1))[-1] / width)
    sides = (
        max((k for k in samples if k[0] < s), key=lambda k: k[0])[1],
        min((k for k in samples if k[0] > s), key=lambda k: k[0])[1],
    )
    look = between.look(Point(y, t, looks[0].point.turns))
    return _classified(between, look, force, slope, sides)


def locate_all(
    system: System,
    solve: Solve,
    amplitudes: Callable[[float], Amplitudes],
    weights: Floats,
    ends: tuple[Look, Look],
) -> list[Critical]:
    """All critical points between two points of a path, one after the other, see :func:`locate`."""
    out: list[Critical] = []
    first, last = ends
    while len(out) < MOST:
        found = locate(system, solve, amplitudes, weights, (first, last))
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
