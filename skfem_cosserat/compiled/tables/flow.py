"""Tables of damped relative velocities, see :mod:`..flow`."""

from __future__ import annotations

#: columns and rows of a part: common shifts, and turns
BORDER, SHIFTS = 6, 3
#: rows of ``f.sums``, by parts: three of ``K = sum dq rest^T``, ``k = sum dq x rest``; sums of
#: ``mu . dq``, and over positions of b and of ``M dq/h``; the size of k, and that of rounding in it
TURN, SHIFT, MEAN, DRIFT, SIZES, SUMS = range(3, 9)
#: rows of ``f.turn``: s; three each of ``1 + s^ + s s^T``, of A, and cofactors of the slope of the
#: equations for s, divided by its determinant
S, PLAIN, A, COFACTORS, TURNED = range(0, 15, 3)
#: of ``f.scheme``
CHI, STEP = range(2)
