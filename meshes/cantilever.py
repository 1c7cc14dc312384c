"""A straight cantilever of 1 m in 8 elements, nodes root and tip.

Writes cantilever.msh (gmsh ASCII 4.1) next to this script; ``main(path)`` writes elsewhere.
"""

from __future__ import annotations

from pathlib import Path

from skfem_cosserat.mesh import MeshCurve, write_mesh


def build() -> MeshCurve:
    """The mesh."""
    beam = MeshCurve.init_line((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), elements=8)
    return beam.with_nodes({"root": 0, "tip": 8})


def main(path: str | Path | None = None) -> Path:
    """Write the mesh and return the path of the file."""
    file = Path(__file__).with_suffix(".msh") if path is None else Path(path)
    write_mesh(file, build())
    return file


if __name__ == "__main__":
    print(main())
