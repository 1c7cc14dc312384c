"""Meshes of space curves for scikit-fem."""

from .curves import (
    Curve as Curve,
    CurveArc as CurveArc,
    CurveHelix as CurveHelix,
    CurveLine as CurveLine,
    CurveMoved as CurveMoved,
    CurveSpline as CurveSpline,
)
from .divide import divided as divided
from .mesh import (
    MappingCurve as MappingCurve,
    MeshCurve as MeshCurve,
    read_mesh as read_mesh,
    write_mesh as write_mesh,
)
