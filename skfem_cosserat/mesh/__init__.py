"""Meshes of space curves for scikit-fem."""

from __future__ import annotations

from .curves import Curve, CurveArc, CurveHelix, CurveLine, CurveMoved, CurveSpline
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
    "read_mesh",
    "write_mesh",
]
