"""Limit and bifurcation points of a path: when stiffness is lost, where, and in which motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eig, eigh
from scipy.optimize import brentq
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackError, eigs, eigsh, splu

from ..diagnostics.tangent import ReducedTangent, reduced_tangent
from ..log import logger
from ..model import System
from ..model.balance import Amplitudes, balance
from ..types import Floats
from .equilibrium import Functional, Point

__all__ = ["Critical", "Look", "inspect", "locate"]

#: unknowns up to which eigenvalues are computed dense
DENSE = 300
#: relative difference of K and its transpose above which forces count as not conservative
SYMMETRIC = 1e-7
#: slope of the load factor along the path, in steps of equal size, below which it is a limit point
LEVEL = 1e-2
#: how exactly a critical point is found, and the distance for that slope, as a share of the step
ROOT, NEAR = 1e-9, 1e-3
#: weight of the load factor against motions: it leads where nothing moves
RIGID = 1e-12


@dataclass(eq=False)
class Look:
    """Stability of a point.

    Attributes
    ----------
    point : Point
    unstable : int
        Negative eigenvalues of the reduced stiffness; with forces that are not conservative, of
        its pivots.
    tangent : ReducedTangent
    symmetric : bool
        Whether the forces are conservative.
    """

    point: Point
    unstable: int
    tangent: ReducedTangent
    symmetric: bool

    def nearest(self, count: int = 1) -> tuple[Floats, Floats]:
        """Eigenvalues nearest to zero (count,) of K against the metric, and modes (unknowns, k)."""
        K, metric = self.tangent.K, self.tangent.metric
        if self.symmetric:
            K = 0.5 * (K + K.T)
        n = K.shape[0]
        if n <= max(DENSE, count + 2):
            if self.symmetric:
                values, vectors = eigh(K.toarray(), metric.toarray())
            else:
                values, vectors = eig(K.toarray(), metric.toarray())
            keep = np.argsort(abs(values))[:count]
            return np.real(values[keep]), np.real(vectors[:, keep])
        solver = eigsh if self.symmetric else eigs
        try:
            values, vectors = solver(K.tocsc(), k=count, M=metric.tocsc(), sigma=0.0, which="LM")
        except (RuntimeError, ArpackError):  # exactly singular: a shift that rounding sees
            shift = -1e-10 * float(abs(K.diagonal()).max() / metric.diagonal().max())
            values, vectors = solver(K.tocsc(), k=count, M=metric.tocsc(), sigma=shift, which="LM")
        order = np.argsort(abs(values))
        return np.real(values[order]), np.real(vectors[:, order])


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
    """

    kind: str
    look: Look
    constraint_force: Floats
    multiplicity: int


def inspect(system: System, point: Point, amplitudes: Amplitudes) -> Look:
    """Stability of an equilibrium."""
    at = balance(system, point.y, amplitudes, turns=point.turns)
    tangent = reduced_tangent(system, point.y, amplitudes, at)
    K = tangent.K
    size = float(abs(K.data).max(initial=0.0))
    difference = abs((K - K.T).data).max(initial=0.0)
    symmetric = bool(difference <= SYMMETRIC * size)
    return Look(
        point, _negative(0.5 * (K + K.T) if symmetric else K, symmetric), tangent, symmetric
    )


def _negative(K: csr_matrix, symmetric: bool) -> int:
    """Negative pivots of an elimination without exchange of rows (Sylvester's law of inertia)."""
    if K.shape[0] == 0:
        return 0
    options = {"SymmetricMode": True}
    try:
        factors = splu(
            K.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
        )
        if (factors.perm_r == factors.perm_c).all():
            return int((factors.U.diagonal() < 0).sum())
    except RuntimeError:  # a pivot vanishes
        pass
    dense = K.toarray()
    values = np.linalg.eigvalsh(dense) if symmetric else np.linalg.eigvals(dense).real
    return int((values < 0).sum())


#: solves for the point that fulfils a functional from a start: point and constraint force, or None
Solve = Callable[[Point, Functional], tuple[Point, Floats] | None]


def locate(
    system: System,
    solve: Solve,
    amplitudes: Callable[[float], Amplitudes],
    weights: Floats,
    ends: tuple[Look, Look],
) -> Critical | None:
    """The critical point between two points of a path with unlike numbers of unstable motions.

    The eigenvalue nearest to zero, signed by that number, is a continuous function along the
    secant; Brent's method finds its root. If several lie between, it is one of them.
    """
    first, last = ends
    rows = len(weights)
    dy = last.point.y[:rows] - first.point.y[:rows]
    dt = last.point.t - first.point.t
    share = RIGID / max(abs(first.point.t), abs(last.point.t)) ** 2
    size = float((weights * dy**2).sum()) + share * dt**2
    none = np.zeros(0)
    found: dict[float, tuple[Look, Floats]] = {0.0: (first, none), 1.0: (last, none)}

    def at(s: float) -> Look:
        if s not in found:
            solution = solve(first.point, Functional(weights * dy, share * dt, s * size))
            if solution is None:
                raise _LostError(f"no point at {s:.6g} of the step")
            found[s] = inspect(system, solution[0], amplitudes(solution[0].t)), solution[1]
        return found[s][0]

    def signed(s: float) -> float:
        value = float(abs(at(s).nearest()[0][0]))
        return value if at(s).unstable == first.unstable else -value

    try:
        s = float(brentq(signed, 0.0, 1.0, xtol=ROOT, rtol=ROOT, maxiter=60))
        look = at(s)
        slope = (at(s + NEAR).point.t - at(s - NEAR).point.t) / (2 * NEAR)
    except (_LostError, RuntimeError) as error:
        logger.warning(
            "a critical point between the load factors %.6g and %.6g was not located: %s",
            *(first.point.t, last.point.t, error),
        )
        return None
    scale = max(abs(look.point.t - first.point.t), abs(last.point.t - look.point.t))
    kind = "limit" if abs(slope) <= LEVEL * scale else "bifurcation"
    return Critical(kind, look, found[s][1], abs(last.unstable - first.unstable))


class _LostError(Exception):
    """Newton's method did not find a point between two others."""
