"""Tables of a tree of joints in a plane, see :mod:`..plane.tree`.

Tables, and not an array for each: kernels take what they need at once, see :mod:`..elements`.
"""

from __future__ import annotations

#: of an edge: child, parent (-1: ground) and the same with numbers of the ground, frame of slides,
#: point of the child that moves as if fixed to the parent, its first coordinate and the one behind
#: its last; whether the child is a frame, whether it
#: turns with its parent, whether it slides, whether the parent is a frame that moves it
EDGES = (
    *("child", "parent", "parent_at", "guide", "fulcrum", "first", "last"),
    *("framed", "relative", "open", "carried"),
)
CHILD, PARENT, PARENT_AT, GUIDE_AT, FULCRUM, FIRST, LAST = range(7)
FRAMED, RELATIVE, OPEN, CARRIED = range(7, 11)
#: multiples of unit vectors, two numbers each: of the child's and the parent's point, of the
#: fulcrum, from the parent's to the child's point where a step starts (a vector)
ARMS = ("child", "child", "parent", "parent", "fulcrum", "fulcrum", "arm", "arm")
CHILD_SPOT, PARENT_SPOT, FULCRUM_SPOT, ARM = 0, 2, 4, 6
#: of a coordinate: kind, place among its vertex' own (-1: driven), vertices of its frame, of the
#: point that it moves and of the one that it turns about
COORDINATES = ("kind", "own", "guide", "target", "centre")
KIND, OWN, GUIDE, TARGET, CENTRE = range(5)
#: its sign about the normal (one number), direction of a slide, both points, and that direction
#: where a step starts (a vector)
ALONG = (*("sign", "slide", "slide", "target", "target", "centre", "centre", "slide0", "slide0"),)
SIGN, SLIDE, TARGET_SPOT, CENTRE_SPOT, SLIDE0 = 0, 1, 3, 5, 7
