"""A T junction: a flange of 2 m and a web of 1 m that meets its middle.

Writes t_junction.msh (gmsh ASCII 4.1) next to this script; ``main(path)`` writes elsewhere.
"""

from __future__ import annotations

from pathlib import Path

from skfem_cosserat.mesh import MeshCurve, write_mesh


def build() -> MeshCurve:
    """The mesh."""
    flange = MeshCurve.init_line((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), 8, name="flange")
    web = MeshCurve.init_line((0.0, 0.0, 0.0), (0.0, -1.0, 0.0), 4, name="web")
    return flange.joined(web).with_nodes({"junction": (0.0, 0.0, 0.0)})


def main(path: str | Path | None = None) -> Path:
    """Write the mesh and return the path of the file."""
    file = Path(__file__).with_suffix(".msh") if path is None else Path(path)
    write_mesh(file, build())
    return file


if __name__ == "__main__":
    print(main())
