"""Stability of an equilibrium: eigenvalues of its stiffness, or the pivots of an elimination."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import eig, eigh
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import ArpackError, eigs, eigsh, splu

from ..diagnostics.tangent import ReducedTangent, reduced_tangent
from ..model import System
from ..model.balance import Amplitudes, balance
from ..types import Array, Floats, IndexArray
from .point import Neutral, Point, weights

__all__ = ["LOOSE", "FirmLook", "Look", "Pivots", "counted", "inspect"]

#: unknowns up to which eigenvalues are computed dense
DENSE = 300
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
class Look:
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

    def crossed(self, later: Look) -> bool:
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
        if n <= max(DENSE, count + 2):
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


class FirmLook(Look):
    """Of a point whose pivots leave no room for neutral motions: no stiffness for that."""

    @property
    def neutral(self) -> bool:
        """There is none."""
        return False


def _start(n: int) -> Floats:
    return np.random.default_rng(0).standard_normal(n)


def inspect(system: System, point: Point, amplitudes: Amplitudes) -> Look:
    """Stability of an equilibrium."""
    at = balance(system, point.y, amplitudes, turns=point.turns)
    tangent = reduced_tangent(system, point.y, amplitudes, at)
    K = tangent.K
    size = float(abs(K.data).max(initial=0.0))
    difference = abs((K - K.T).data).max(initial=0.0)
    symmetric = system.loading.dead_only or bool(difference <= SYMMETRIC * size)
    unstable, pivot = _negative(0.5 * (K + K.T)) if symmetric else _determinant(K)
    return Look(point, unstable, symmetric, pivot, lambda: tangent)


class Pivots(NamedTuple):
    """Of an elimination in blocks that was done already.

    Attributes
    ----------
    negative : int
        How many, of the symmetric part of each block left.
    smallest, largest : float
        In magnitude.
    skew : float
        Largest difference of a block and its transpose.
    odd : bool
        Whether the determinant is negative.
    """

    negative: int
    smallest: float
    largest: float
    skew: float
    odd: bool


def counted(system: System, point: Point, amplitudes: Amplitudes, pivots: Pivots | None) -> Look:
    """Stability of an equilibrium from the pivots of an elimination that was done already.

    Where they do not tell, since the smallest may be that of a neutral motion, or forces may be
    conservative or not, all is done again as in :func:`inspect`.
    """
    symmetric = system.loading.dead_only
    firm = pivots is not None and pivots.smallest > FIRM * SUSPECT * NEUTRAL * pivots.largest
    if pivots is None or not firm or not (symmetric or pivots.skew > SKEW * pivots.largest):
        return inspect(system, point, amplitudes)

    def assemble() -> ReducedTangent:
        at = balance(system, point.y, amplitudes, turns=point.turns)
        return reduced_tangent(system, point.y, amplitudes, at)

    unstable = pivots.negative if symmetric else int(pivots.odd)
    return FirmLook(point, unstable, symmetric, pivots.smallest, assemble)


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
    try:
        factors = splu(
            K.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
        )
        if (factors.perm_r == factors.perm_c).all():
            pivots = factors.U.diagonal()
            return int((pivots < 0).sum()), float(abs(pivots).min())
    except RuntimeError:  # a pivot vanishes
        pass
    values = np.linalg.eigvalsh(K.toarray())
    return int((values < 0).sum()), float(abs(values).min())
