"""A closed circular ring of radius 1 m in 16 elements.

Writes closed_ring.msh (gmsh ASCII 4.1) next to this script; ``main(path)`` writes elsewhere.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skfem_cosserat.mesh import MeshCurve, write_mesh


def build() -> MeshCurve:
    """The mesh."""
    return MeshCurve.init_arc(
        (1.0, 0.0, 0.0),
        tangent=(0.0, 1.0, 0.0),
        normal=(-1.0, 0.0, 0.0),
        radius=1.0,
        angle=2.0 * np.pi,
        elements=16,
        name="ring",
        nodes={"opposite": 0.5},
    )


def main(path: str | Path | None = None) -> Path:
    """Write the mesh and return the path of the file."""
    file = Path(__file__).with_suffix(".msh") if path is None else Path(path)
    write_mesh(file, build())
    return file


if __name__ == "__main__":
    print(main())
