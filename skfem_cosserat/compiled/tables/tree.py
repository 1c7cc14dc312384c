"""Tables of a tree of joints, see :mod:`..tree`."""

from __future__ import annotations

#: kinds of coordinates: absolute rotation, hinge, point on a sphere, slide
ROTATION, AXIS, SPHERE, SLIDE = 1, 2, 3, 4
