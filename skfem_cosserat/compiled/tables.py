"""Columns of the tables that bind modules make and kernels read; numba is not imported here."""

from ..model.coordinates import MOST_XI

# -- force elements, see :mod:`.forces` ---------------------------------------------------------

#: kinds of the last coordinate
DISPLACEMENT, DISTANCE, RADIUS, ANGLE, ROTATION = range(5)
#: most invariants of an element
MOST_PI = MOST_XI + 1
#: rows of a side
SIDE = 4
ROWS = 2 * SIDE
#: columns of ``s.coupling``: kind of the last coordinate, number of displacements before it,
#: whether the element is slack under pressure, first and last of its entries, slots of the sides
#: (a, a), (a, b), (b, a), (b, b), -1 where one is ground, and rows of y. An entry is the number of
#: an invariant, a row and a column of its matrix
KIND, LEADING, SLACK, FIRST, LAST, SLOTS = range(6)
ROW = SLOTS + 4
#: ``s.coupling_law``: matrices, and rows: neutral coordinates, the sign. Of a law of Python, whose
#: mark in the column SLACK is OWN, the matrices are slopes of its forces by the coordinates and by
#: their rates; beside the sign is 1 if there is no potential, and rows are forces and what they
#: follow from: coordinates at the end and at the midpoint, their change
STIFFNESS, DAMPING, NEUTRAL = range(3)
OWN, SIGN, FORCES, FOUND = 2, 1, 2, 3

# -- damped relative velocities, see :mod:`.flow` --------------------------------------------------

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

# -- constraint rows, see :mod:`.rows` -------------------------------------------------------------

#: columns of the table of products ``c y_left . y_right``: block and place of the constraint row;
#: rows of y, their vertices (-1: ground) and places in them; slots of both pairs of vertices, and
#: of the block with each of them; where in y a number is that c is multiplied by (-1: nowhere)
BLOCK, PLACE, LEFT, RIGHT, LEFT_VERTEX, LEFT_PLACE, RIGHT_VERTEX, RIGHT_PLACE = range(8)
SLOT, SLOT_BACK, LEFT_SLOT, LEFT_BACK, RIGHT_SLOT, RIGHT_BACK, DRIVE, COMPONENT = range(8, 16)
#: columns of the table of linear terms ``c y_a``, one component of it: as above, row of y, its
#: component, vertex and place there, slots
TERM, TERM_COMPONENT, TERM_VERTEX, TERM_PLACE, TERM_SLOT, TERM_BACK = range(2, 8)

# -- coordinates of a tree of joints, see :mod:`.tree` ---------------------------------------------

#: kinds: absolute rotation, hinge, point on a sphere, slide
ABSOLUTE, AXIS, SPHERE, SLIDE = range(1, 5)
