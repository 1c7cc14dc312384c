"""A right-angled L frame: one beam of two legs of 10 m each.

Writes l_frame.msh (gmsh ASCII 4.1) next to this script; ``main(path)`` writes elsewhere.
"""

from __future__ import annotations

from pathlib import Path

from skfem_cosserat.mesh import MeshCurve, write_mesh


def build() -> MeshCurve:
    """The mesh."""
    corners = [(0.0, 0.0, 0.0), (0.0, 10.0, 0.0), (10.0, 10.0, 0.0)]
    return MeshCurve.init_polyline(corners, 5, name="frame", nodes={"elbow": 0.5})


def main(path: str | Path | None = None) -> Path:
    """Write the mesh and return the path of the file."""
    file = Path(__file__).with_suffix(".msh") if path is None else Path(path)
    write_mesh(file, build())
    return file


if __name__ == "__main__":
    print(main())
