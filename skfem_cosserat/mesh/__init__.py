"""Meshes of space curves for scikit-fem."""

from __future__ import annotations

from .curves import Curve, CurveArc, CurveHelix, CurveLine, CurveMoved, CurveSpline
from .divide import divided
from .mesh import MappingCurve, MeshCurve, read_mesh, write_mesh

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
