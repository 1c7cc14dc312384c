"""The 45-degree bend: an arc of radius 100 m in the plane z = 0, 8 elements.

Writes arc_45.msh (gmsh ASCII 4.1) next to this script; ``main(path)`` writes elsewhere.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skfem_cosserat.mesh import MeshCurve, write_mesh


def build() -> MeshCurve:
    """The mesh."""
    return MeshCurve.init_arc(
        (0.0, 0.0, 0.0),
        tangent=(1.0, 0.0, 0.0),
        normal=(0.0, 1.0, 0.0),
        radius=100.0,
        angle=0.25 * np.pi,
        elements=8,
        name="bend",
    )


def main(path: str | Path | None = None) -> Path:
    """Write the mesh and return the path of the file."""
    file = Path(__file__).with_suffix(".msh") if path is None else Path(path)
    write_mesh(file, build())
    return file


if __name__ == "__main__":
    print(main())
