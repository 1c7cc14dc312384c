"""All constraints of a scene as one set of quadratic forms of the coordinate vectors.

Coordinates are handled as rows of three numbers, ``y`` (nv, 3): phi, d1, d2, d3 of each frame,
phi of each mass point, then the ground's frames. Every constraint is a sum of terms
``c y_a . y_b`` plus linear terms and a constant, so that its Jacobian is linear in y and the
midpoint Jacobian its exact discrete derivative. Where a drive prescribes an angle, c is a number
of a ground row (the cosine or sine of the angle) and thus prescribed in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix

from ..frozen import lock_arrays
from ..pattern import FrozenPattern, sum_at
from ..types import Array, Floats, IndexArray

#: numbers of a stack that are worked on together: they stay in the processor's cache
TOGETHER = 2**16


def _table(
    terms: Sequence[tuple[float, ...]], count: int, begun: Floats | None = None
) -> tuple[list[IndexArray], Floats]:
    """Columns of numbers, and the factors in the last one; those `begun` with come first."""
    array = np.array(terms, float).reshape(-1, count + 1)
    if begun is not None:
        array = np.concatenate([begun, array])
    return [array[:, k].astype(np.int64) for k in range(count)], array[:, count].copy()


#: rows (56) of a frame: which two directors, and half their product or all of it
_INTERNAL = ((1, 1, 0.5), (2, 2, 0.5), (3, 3, 0.5), (1, 2, 1.0), (1, 3, 1.0), (2, 3, 1.0))


class ConstraintBuilder:
    """Collects terms; rows are numbered in the order they are added.

    Parameters
    ----------
    frames : (k,) int array, optional
        First rows of y of the frames whose directors are orthonormal: the first six rows each.
    """

    def __init__(self, frames: IndexArray | None = None):
        #: rows, both vectors and factor (k, 4) of the products that were there at first
        self.begun = np.zeros((0, 4))
        if frames is not None:
            vectors = frames[:, None, None] + np.array([each[:2] for each in _INTERNAL])
            self.begun = np.empty((6 * len(frames), 4))
            self.begun[:, 0] = np.arange(6 * len(frames))
            self.begun[:, 1:3] = vectors.reshape(-1, 2)
            self.begun[:, 3] = np.tile([each[2] for each in _INTERNAL], len(frames))
        self.size = len(self.begun)
        self.linear: list[tuple[int, int, float]] = []
        self.products: list[tuple[int, int, int, float]] = []
        #: number of a product -> (row of y, component) that it is multiplied by
        self.amplitudes: dict[int, tuple[int, int]] = {}

    def zero(self, terms: list[tuple[int, float]]) -> None:
        """Three rows ``sum c_a y_a = 0``."""
        self.linear += [(self.size, a, c) for a, c in terms]
        self.size += 3

    def add(
        self,
        left: list[tuple[int, float]],
        right: list[tuple[int, float]],
        factor: float,
        amplitude: tuple[int, int] | None = None,
    ) -> None:
        """Add ``factor (sum c_a y_a) . (sum c_b y_b)`` to the row under construction."""
        for a, c in left:
            for b, d in right:
                if amplitude is not None:
                    self.amplitudes[len(self.begun) + len(self.products)] = amplitude
                self.products.append((self.size, a, b, factor * c * d))

    def end_row(self) -> None:
        """The row, ``sum of products = const``, is complete."""
        self.size += 1


class Terms(NamedTuple):
    """Terms of quadratic constraints.

    Attributes
    ----------
    row, left, right : (p,) int arrays
        Products ``factor y_left . y_right`` and the constraint rows they are in.
    factor : (p,) array
    drive_row, drive_component : (p,) int arrays
        Where in y there is a number that the factor is multiplied by; -1: none.
    linear_row, linear : (l,) int arrays
        Linear terms ``factor y_linear``: in this row and the next two, x, y and z.
    linear_factor : (l,) array
    constant : (m,) array
        What the products add up to.
    """

    row: IndexArray
    left: IndexArray
    right: IndexArray
    factor: Floats
    drive_row: IndexArray
    drive_component: IndexArray
    linear_row: IndexArray
    linear: IndexArray
    linear_factor: Floats
    constant: Floats


class QuadraticConstraints:
    """Constraints ``g(y)`` (m,) and their Jacobian by the n free coordinates.

    Parameters
    ----------
    builder : ConstraintBuilder
    reference : (nv_all, 3) array
        Where all constraints hold: fixes the constants.
    free : int
        Rows of y that are unknowns; the rest is ground.
    """

    def __init__(self, builder: ConstraintBuilder, reference: Floats, free: int):
        m = builder.size
        n = 3 * free
        self.size = m
        self.n = n
        linear, lc = _table(builder.linear, 2)
        products, pc = _table(builder.products, 3, builder.begun)
        self._lk = (linear[0][:, None] + np.arange(3)).ravel()
        self._la = linear[1]
        self._lc = lc[:, None]
        self._pk, self._pa, self._pb = products
        self._pc = pc[:, None]
        self._driven = np.array(sorted(builder.amplitudes), np.int64)
        where = [builder.amplitudes[k] for k in sorted(builder.amplitudes)]
        self._drive_row = np.array([w[0] for w in where], np.int64)
        self._drive_component = np.array([w[1] for w in where], np.int64)
        dots = (self._factors(reference) * reference[self._pa] * reference[self._pb]).sum(1)
        self._constant = np.bincount(self._pk, dots, m)
        self._other = np.concatenate([self._pb, self._pa])
        self._linear_values = lc.repeat(3)
        # rows and columns never change
        xyz = np.arange(3)
        each = self._pk.repeat(3)
        self.rows = np.concatenate([self._lk, each, each])
        self.cols = (3 * np.concatenate([self._la, self._pa, self._pb])[:, None] + xyz).ravel()
        self.inside = np.flatnonzero(self.cols < n)
        #: rows and columns of the contributions to G
        self.G_rows, self.G_cols = self.rows[self.inside], self.cols[self.inside]
        self._curved = np.flatnonzero((self._pa < free) & (self._pb < free))  # both are unknown
        lock_arrays(self)

    @cached_property
    def _pattern(self) -> FrozenPattern:
        return FrozenPattern(self.G_rows, self.G_cols, (self.size, self.n))

    @cached_property
    def curvature_rows(self) -> IndexArray:
        """Rows of y by component, of :meth:`curvature_values`."""
        return self._curved_ends(self._pa, self._pb)

    @cached_property
    def curvature_cols(self) -> IndexArray:
        """Their columns."""
        return self._curved_ends(self._pb, self._pa)

    def _curved_ends(self, a: IndexArray, b: IndexArray) -> IndexArray:
        ends = np.concatenate([a[self._curved], b[self._curved]])
        return (3 * ends[:, None] + np.arange(3)).ravel()

    def terms(self) -> Terms:
        """All terms, for loops over them."""
        row, component = np.full((2, len(self._pk)), -1)
        row[self._driven], component[self._driven] = self._drive_row, self._drive_component
        products = self._pk, self._pa, self._pb, self._pc[:, 0].copy(), row, component
        linear = self._lk[::3].copy(), self._la, self._lc[:, 0].copy()
        return Terms._make((*products, *linear, self._constant))

    def _factors(self, y: Array) -> Array:
        """Factors (products, 1), some prescribed in time by ground rows of y."""
        if not len(self._driven):
            return self._pc
        out = np.array(self._pc, y.dtype)
        out[self._driven, 0] *= y[self._drive_row, self._drive_component]
        return out

    def values(self, y: Array) -> Array:
        """``g(y)`` (m,)."""
        products = (self._factors(y) * (y.take(self._pa, 0) * y.take(self._pb, 0))).sum(1)
        out = sum_at(self._pk, products, self.size) - self._constant
        if not len(self._lk):
            return out
        return out + sum_at(self._lk, (self._lc * y.take(self._la, 0)).ravel(), self.size)

    def magnitudes(self, y: Floats, rates: Floats | None = None) -> Floats:
        """Sizes (m,) of the terms of g(y), or of ``dg/dt`` for rates of y: what its error means."""
        size = np.linalg.norm(y, axis=1)
        if rates is None:
            products = size[self._pa] * size[self._pb]
            linear = size[self._la]
        else:
            rate = np.linalg.norm(rates, axis=1)
            products = size[self._pa] * rate[self._pb] + rate[self._pa] * size[self._pb]
            linear = rate[self._la]
        out = np.bincount(self._pk, abs(self._pc[:, 0]) * products, self.size)
        terms = np.repeat(abs(self._lc[:, 0]) * linear, 3)
        return np.asarray(out + np.bincount(self._lk, terms, self.size), float)

    def jacobian_values(self, y: Array) -> Array:
        """Contributions to G at ``(G_rows, G_cols)``, ground columns left out."""
        factors = self._factors(y)
        scaled = np.concatenate([factors, factors]) * y.take(self._other, 0)
        return np.concatenate([self._linear_values, scaled.ravel()]).take(self.inside)

    def contributions(self, which: IndexArray, y: Floats) -> Floats:
        """Contributions to G at ``(rows, cols)[which]`` (N, k), for a stack y (N, total, 3)."""
        plain = len(self._linear_values)
        count = len(self._pk)
        out = np.empty((len(y), len(which)))
        product = which >= plain
        out[:, ~product] = self._linear_values[which[~product]]
        each, component = np.divmod(which[product] - plain, 3)
        factor = np.broadcast_to(self._pc[:, 0], (len(y), count))
        if len(self._driven):
            factor = factor.copy()
            factor[:, self._driven] *= y[:, self._drive_row, self._drive_component]
        out[:, product] = factor[:, each % count] * y[:, self._other[each], component]
        return out

    def rate(self, y: Array, v: Array) -> Array:
        """``G(y) v`` (m,)."""
        return sum_at(self.G_rows, self.jacobian_values(y) * v.take(self.G_cols), self.size)

    def stacked_values(self, y: Floats, rates: Floats | None = None) -> Floats:
        """``g(y)`` (N, m) of a stack y (N, total, 3); with `rates` of all its rows ``dg/dt``."""
        out = np.empty((len(y), self.size))
        states = int(np.clip(TOGETHER // max(1, 3 * len(self._pa)), 32, 256))
        for first in range(0, len(y), states):
            some = slice(first, first + states)
            out[some] = self._values(y[some], None if rates is None else rates[some]).T
        return out

    def _values(self, y: Floats, rates: Floats | None) -> Floats:
        """``g(y)`` or ``dg/dt`` (m, N): states come last, each operation is one on all of them."""
        a = np.ascontiguousarray(y.transpose(1, 2, 0))
        v = a if rates is None else np.ascontiguousarray(rates.transpose(1, 2, 0))
        pa = self._pa
        pb = self._pb
        factor = np.broadcast_to(self._pc, (len(pa), len(y)))
        dots = (a[pa] * v[pb]).sum(1)
        if rates is not None:
            dots += (v[pa] * a[pb]).sum(1)
        if len(self._driven):
            factor = factor.copy()
            own = self._driven
            where = self._drive_row, self._drive_component
            factor[own] *= a[where]
            if rates is not None:  # the factor changes, too
                more = self._pc[own] * v[where] * (a[pa[own]] * a[pb[own]]).sum(1)
        dots *= factor
        if len(self._driven) and rates is not None:
            dots[self._driven] += more
        out = self._sums[0] @ dots
        if rates is None:
            out -= self._constant[:, None]
        if len(self._lk):
            out += self._sums[1] @ (self._lc[:, :, None] * v[self._la]).reshape(-1, len(y))
        return out

    @cached_property
    def _sums(self) -> list[csr_matrix]:
        """Matrices that sum up products, and linear terms, in the rows they belong to."""
        return [
            csr_matrix((np.ones(len(k)), (k, np.arange(len(k)))), shape=(self.size, len(k)))
            for k in (self._pk, self._lk)
        ]

    def jacobian(self, y: Array) -> csc_matrix:
        """``G(y)`` (m, n) by the free coordinates."""
        return self._pattern.matrix(self.jacobian_values(y))

    def ground_rate(self, y: Array, ydot: Array) -> Array:
        """``g_t`` (m,): rate of g from the motion of the ground rows alone."""
        rates = np.zeros_like(ydot)
        free = self.n // 3
        rates[free:] = ydot[free:]
        return self.stacked_values(y[None], rates[None])[0]

    def curvature_values(self, multipliers: Array, y: Array) -> Array:
        """``sum_k lambda_k H_k(y)`` at ``(curvature_rows, curvature_cols)``.

        H depends on y only through numbers prescribed in time.
        """
        each = multipliers[self._pk[self._curved]] * self._factors(y)[self._curved, 0]
        return np.concatenate([each, each]).repeat(3)

    def curvature_of(self, rows: IndexArray) -> tuple[IndexArray, IndexArray]:
        """Products (p,) with both vectors unknown in some rows, and pairs (2 p, 2) of rows of y.

        For :meth:`curvature_factors`; each pair stands for a block ``value * I_3``.
        """
        which = self._curved[np.isin(self._pk[self._curved], rows)]
        a = self._pa[which]
        b = self._pb[which]
        return which, np.concatenate([np.column_stack([a, b]), np.column_stack([b, a])])

    def curvature_factors(self, which: IndexArray, multipliers: Array, y: Array) -> Array:
        """``sum_k lambda_k H_k(y)`` (2 p,) at the pairs of :meth:`curvature_of`."""
        each = multipliers[self._pk[which]] * self._factors(y)[which, 0]
        return np.concatenate([each, each])
