"""Tables of force elements, see :mod:`..couplings`."""

from __future__ import annotations

#: kinds of the last coordinate
DISPLACEMENT, DISTANCE, ANGLE, ROTATION = range(4)
#: most components and invariants of an element
MOST_XI, MOST_PI = 6, 7
#: rows of a side
SIDE = 4
ROWS = 2 * SIDE
#: columns of ``s.coupling``: kind of the last coordinate, number of displacements before it,
#: whether the element is slack under pressure, first and last of its entries, slots of the sides
#: (a, a), (a, b), (b, a), (b, b), -1 where one is ground, and rows of y. An entry is the number of
#: an invariant, a row and a column of its matrix
KIND, LEADING, SLACK, FIRST, LAST, SLOT, ROW = 0, 1, 2, 3, 4, 5, 9
#: ``s.coupling_law``: matrices, and the row of the neutral coordinates
STIFFNESS, DAMPING, NEUTRAL = range(3)
