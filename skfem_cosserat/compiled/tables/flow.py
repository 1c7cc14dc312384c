"""Tables of damped relative velocities, see :mod:`..flow`."""

from __future__ import annotations

#: columns and rows of a part: common shifts, and turns
BORDER, SHIFTS = 6, 3
#: columns of ``f.sums``, by parts: ``K = sum dq rest^T``, ``k = sum dq x rest``, its size, that of
#: rounding in it; sums of ``mu . dq``, and over positions of b and of ``M dq/h``
K_SUM, TURN, SIZE, NOISE_SIZE, SHIFT, MEAN, DRIFT, SUMS = 0, 9, 12, 13, 14, 17, 20, 23
#: columns of ``f.turn``: s, rows of ``1 + s^ + s s^T``, those of A, and cofactors of the slope of
#: the equations for s, divided by its determinant
S, PLAIN, A, COFACTORS, TURNED = 0, 3, 12, 21, 30
#: of ``f.scheme``
CHI, STEP = 0, 1
