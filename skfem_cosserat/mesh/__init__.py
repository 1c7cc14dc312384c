"""Meshes of space curves for scikit-fem."""

from __future__ import annotations

from .curves import Curve, CurveArc, CurveHelix, CurveLine, CurveMoved, CurveSpline
from .divide import divided
from .files import read_mesh, write_mesh
from .mapping import MappingCurve
from .mesh import MeshCurve

__all__ = [
    "Curve",
    "CurveArc",
    "CurveHelix",
    "CurveLine",
    "CurveMoved",
    "CurveSpline",
    "MappingCurve",
    "MeshCurve",
    "divided",
    "read_mesh",
    "write_mesh",
]
