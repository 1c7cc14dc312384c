"""Discrete null space method with nodal reparametrisation: n - m unknowns, no multipliers."""

from __future__ import annotations

import numpy as np

from ..assembly import FrozenPattern
from ..errors import IncompatibleError
from ..kernels import null_space_blocks
from ..linear import LinearSolver
from ..model import System
from ..model.kinematics import Chart
from ..types import Array, Floats, IndexArray
from .base import BoundTreatment, Treatment, group_pairs, relative_size

__all__ = ["NullSpace"]


class NullSpace(Treatment):
    """Null space method with nodal reparametrisation, equations (25), (61), (68), (69).

    Constraints are fulfilled to round-off by construction. The null space matrix comes from the
    tree of joints, without a factorisation of the constraint Jacobian; joints that close a loop
    are refused.

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

    def bind(self, system: System, weight: float) -> BoundNullSpace:
        """See the base class."""
        if system.tree.loops:
            names = ", ".join(joint.label for joint in system.tree.loops)
            raise IncompatibleError(
                "null space treatment",
                f"does not take the {names}, which closes a loop of joints: use Multipliers()",
            )
        return BoundNullSpace(system, weight)


class Congruence:
    """``T_left^T A T_right + C T_right`` through a frozen pattern.

    A is given by contributions at pairs of twists, T by its entries, C by entries at (unknown,
    twist). Twists of free vertices are unknowns themselves, so most contributions pass straight
    through.
    """

    def __init__(
        self,
        pairs: tuple[IndexArray, IndexArray],
        extra: tuple[IndexArray, IndexArray],
        T: tuple[IndexArray, IndexArray, int],
        shape: tuple[int, int],
    ) -> None:
        T_rows, T_cols, fixed = T
        order = np.argsort(T_rows, kind="stable")
        start = np.searchsorted(T_rows[order], np.arange(shape[0] + 1))
        count = np.diff(start)
        identity = np.zeros(shape[0], dtype=bool)
        one = np.flatnonzero(count == 1)
        identity[one] = order[start[one]] < fixed
        # fixed entries can be shifts of a tree as well, but those rows have other entries too, or
        # are constant translations whose factor must be 0 or 1
        I, J = pairs  # noqa: E741
        plain = identity[I] & identity[J]
        self._plain = np.flatnonzero(plain)
        rest = np.flatnonzero(~plain)
        self._source, self._left, self._right = _expand(I[rest], J[rest], rest, start, order)
        k, J2 = extra
        self._extra, _, self._extra_right = _expand(None, J2, np.arange(len(J2)), start, order)
        col = T_cols[order[start[:-1][identity]]] if identity.any() else np.zeros(0, dtype=int)
        number = np.full(shape[0], -1)
        number[identity] = col
        rows = [number[I[self._plain]], T_cols[self._left], k[self._extra]]
        cols = [number[J[self._plain]], T_cols[self._right], T_cols[self._extra_right]]
        self.pattern = FrozenPattern(
            np.concatenate(rows).astype(np.int64),
            np.concatenate(cols).astype(np.int64),
            (shape[1], shape[1]),
        )

    def data(self, A: Floats, C: Floats, left: Floats, right: Floats) -> Floats:
        """Entries of the product in :attr:`pattern`."""
        values = [A[self._plain]]
        if len(self._source):
            values.append(A[self._source] * left[self._left] * right[self._right])
        if len(self._extra):
            values.append(C[self._extra] * right[self._extra_right])
        return self.pattern.data(np.concatenate(values))


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


class BoundNullSpace(BoundTreatment):
    """See :class:`NullSpace`."""

    def __init__(self, system: System, weight: float) -> None:
        super().__init__(system, weight)
        kin = self.kin = system.kinematics
        self.unknowns = kin.unknowns
        self.chart = Chart(kin)
        number = np.zeros(len(system.origin_rows), dtype=np.int64)
        number[kin.frames] = np.arange(len(kin.frames))
        self._frames = [number[g.vertices] if g.framed else None for g in system.groups]
        dofs = [
            (kin.twist_of[g.vertices][:, :, None] + np.arange(6 if g.framed else 3)).reshape(
                len(g.vertices), -1
            )
            for g in system.groups
        ]
        i, j = group_pairs(system, dofs)
        extra = (np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
        if weight:  # derivative of P: moments on each frame, and the tree's
            omega = kin.frame_twist[:, 3:]
            i = np.concatenate([i, np.repeat(omega, 3, axis=1).ravel()])
            j = np.concatenate([j, np.tile(omega, (1, 3)).ravel()])
            if len(kin.pair_number):
                extra = kin.curvature_pattern()
        self._congruence = Congruence(
            (i, j), extra, (kin.T_rows, kin.T_cols, kin.n_fixed), (kin.n_twist, kin.unknowns)
        )
        self.pattern = self._congruence.pattern
        self.solver = LinearSolver(self.pattern)
        turning = np.zeros(kin.unknowns, dtype=bool)
        turning[self.chart.rotating] = True
        self._turning = np.flatnonzero(turning)
        self._shifting = np.flatnonzero(~turning)
        self._total: Array = np.zeros(kin.unknowns)
        self._last: Array | None = None

    def begin(self, y0: Array, ground1: Array, h: float) -> None:
        """See the base class."""
        self.y0, self.h = y0, h
        self.chart.begin(y0, ground1)
        if self.weight == 0:
            self._set_left(y0)

    def _set_left(self, y: Array) -> None:
        """P^T is evaluated at y."""
        self._left = self.kin.locate(y, self.chart.fixed)
        self._T_left = self.kin.T_values(self._left)

    def guess(self, extrapolate: bool) -> None:
        """See the base class."""
        self.chart.reset()
        self._total = np.zeros(self.unknowns)
        if extrapolate and self._last is not None:
            self.apply(self._last)

    def configuration(self) -> Array:
        """See the base class."""
        return self.chart.configuration()

    def residual(self, R: Array, y1: Array) -> Array:
        """``P(y_c)^T R``."""
        if self.weight:
            self._set_left(self.constraint_point(y1))
        self._twist_force = self.kin.twist_force(self._left.y, R)
        return self.kin.reduce(self._T_left, self._twist_force)

    def relative(self, residual: Array, largest: float) -> float:
        """See the base class."""
        return relative_size(float(abs(residual).max(initial=0.0)), largest)

    def _project(self, blocks: list[Array], right: Array) -> list[Array]:
        """Blocks by coordinates -> by twists, ``P_int(y_c)^T K P_int(y_1)``."""
        left = null_space_blocks(self.kin.directors(self._left.y)).transpose(0, 2, 1)
        out = []
        for block, frames in zip(blocks, self._frames, strict=True):
            if frames is None:
                out.append(block.ravel())
                continue
            ne, nn = frames.shape
            k = block.shape[1]
            half = left[frames] @ block.reshape(ne, nn, 12, k)
            full = half.reshape(ne, 6 * nn, nn, 12).swapaxes(1, 2) @ right[frames]
            out.append(full.swapaxes(1, 2).ravel())
        return out

    def data(self, blocks: list[Array], R: Array, y1: Array, scaled: bool = True) -> Floats:
        """See the base class."""
        kin = self.kin
        D1 = kin.directors(y1)
        values = self._project(blocks, null_space_blocks(D1))
        extra = np.zeros(0)
        right = kin.locate(y1, self.chart.fixed)
        T1 = kin.T_values(right)
        if self.weight:
            # w d(P_int^T R): sum_i R_i^ d_i^ = D^T R - tr(D^T R) I with d_i of y_1
            W = D1.transpose(0, 2, 1) @ R[kin.director_rows]
            trace = W[:, 0, 0] + W[:, 1, 1] + W[:, 2, 2]
            W[:, (0, 1, 2), (0, 1, 2)] -= trace[:, None]
            values.append((self.weight * W).ravel())
            if len(kin.pair_number):
                extra = kin.curvature_values(self._left, right, self._twist_force)
                extra *= self.weight
        return self._congruence.data(np.concatenate(values), extra, self._T_left, T1)

    def scale_rows(self, residual: Array) -> Array:
        """No scaling."""
        return residual

    def apply(self, increment: Array) -> None:
        """See the base class."""
        self.chart.add(increment)
        self._total = self._total + increment

    def sizes(self, increment: Floats) -> tuple[float, float]:
        """See the base class."""
        d = abs(increment)
        shift = d[self._shifting].max(initial=0.0) / self.system.length
        turn = d[self._turning].max(initial=0.0)
        return float(max(shift, turn)), float(turn)

    def constraint_impulse(self, R: Array) -> Array:
        """All of the balance that the null space does not see."""
        return -R

    def save(self) -> tuple[Array, ...]:
        """See the base class."""
        return *self.chart.save(), self._total

    def restore(self, saved: tuple[Array, ...]) -> None:
        """See the base class."""
        self.chart.restore(saved[:-1])
        self._total = saved[-1]

    def finish(self) -> None:
        """See the base class."""
        self._last = self._total
