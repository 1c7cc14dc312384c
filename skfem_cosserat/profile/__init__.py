"""Cross-sections by their shape and materials: Saint-Venant's problems on a mesh of the section.

``Profile...`` says what a section looks like; its ``constants()`` are the full stiffness, centres,
torsion constant, shear factors and mass; its ``section()`` is what a beam takes.
"""

from .polygon import ProfileComposite, ProfilePolygon, Region
from .profile import Profile
from .shapes import (
    ProfileBox,
    ProfileChannel,
    ProfileCircle,
    ProfileI,
    ProfileRectangle,
    ProfileRectangles,
    ProfileRings,
    ProfileTube,
)
from .warping import MaterialAnisotropic, ProfileConstants

__all__ = [
    "MaterialAnisotropic",
    "Profile",
    "ProfileBox",
    "ProfileChannel",
    "ProfileCircle",
    "ProfileComposite",
    "ProfileConstants",
    "ProfileI",
    "ProfilePolygon",
    "ProfileRectangle",
    "ProfileRectangles",
    "ProfileRings",
    "ProfileTube",
    "Region",
]
