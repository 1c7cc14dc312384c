"""Columns of the tables of a tree in a plane.

Tables, and not an array for each: kernels take what they need at once, see :mod:`..elements`.
"""

from __future__ import annotations

__all__ = ["ALONG", "ARMS", "COORDINATES", "EDGES"]

#: of an edge: child, parent (-1: ground) and the same with numbers of the ground, frame of slides,
#: point of the child that moves as if fixed to the parent, number of the span (-1: none), its first
#: coordinate and the one behind its last; whether the child is a frame, whether it turns with its
#: parent, whether it slides, whether the parent is a frame that moves it
EDGES = (
    *("child", "parent", "parent_at", "guide", "fulcrum", "span", "first", "last"),
    *("framed", "relative", "open", "carried"),
)
CHILD, PARENT, PARENT_AT, GUIDE_AT, FULCRUM, SPAN, FIRST, LAST = range(8)
FRAMED, RELATIVE, OPEN, CARRIED = range(8, 12)
#: multiples of unit vectors, two numbers each: of the child's and the parent's point, of the
#: fulcrum, from the parent's to the child's point where a step starts (a vector); of a span its
#: reach (one number), its strain, the sections at parent and child
ARMS = (
    *("child", "child", "parent", "parent", "fulcrum", "fulcrum", "arm", "arm"),
    *("reach", "strain", "strain", "section_a", "section_a", "section_b", "section_b"),
)
CHILD_SPOT, PARENT_SPOT, FULCRUM_SPOT, ARM, REACH, STRAIN, SECTION_A = 0, 2, 4, 6, 8, 9, 11
SECTION_B = 13
#: of a coordinate: kind, place among its vertex' own (-1: driven), vertices of its frame, of the
#: point that it moves and of the one that it turns about
COORDINATES = ("kind", "own", "guide", "target", "centre")
KIND, OWN, GUIDE, TARGET, CENTRE = range(5)
#: its sign about the normal (one number), direction of a slide, both points, and that direction
#: where a step starts (a vector)
ALONG = (*("sign", "slide", "slide", "target", "target", "centre", "centre", "slide0", "slide0"),)
SIGN, SLIDE, TARGET_SPOT, CENTRE_SPOT, SLIDE0 = 0, 1, 3, 5, 7
