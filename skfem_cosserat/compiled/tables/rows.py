"""Tables of constraint rows, see :mod:`..rows`."""

from __future__ import annotations

#: columns of the table of products ``c y_left . y_right``: block and place of the constraint row;
#: rows of y, their vertices (-1: ground) and places in them; slots of both pairs of vertices, and
#: of the block with each of them; where in y a number is that c is multiplied by (-1: nowhere)
BLOCK, PLACE, LEFT, RIGHT, LEFT_VERTEX, LEFT_PLACE, RIGHT_VERTEX, RIGHT_PLACE = range(8)
SLOT, SLOT_BACK, LEFT_SLOT, LEFT_BACK, RIGHT_SLOT, RIGHT_BACK, DRIVE, COMPONENT = range(8, 16)
#: columns of the table of linear terms ``c y_a``, one component of it: as above, row of y, its
#: component, vertex and place there, slots
TERM, TERM_COMPONENT, TERM_VERTEX, TERM_PLACE, TERM_SLOT, TERM_BACK = range(2, 8)
