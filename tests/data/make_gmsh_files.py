"""Writes the files of this folder with gmsh's Python API (made with gmsh 4.15.2).

They are kept so that the tests read what gmsh itself writes without needing it.
"""

from __future__ import annotations

from pathlib import Path

import gmsh


def write(
    name: str, version: float, binary: int, groups: dict[str, list[int]], save_all: int
) -> None:
    """Three lines that meet in a point, one drawn against the others."""
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        for tag, x in enumerate([(0, 0, 0), (2, 0, 0), (2, 1, 0), (2, -1, 0.5)], start=1):
            gmsh.model.geo.addPoint(*x, meshSize=0.5, tag=tag)
        gmsh.model.geo.addLine(1, 2, 1)
        gmsh.model.geo.addLine(3, 2, 2)
        gmsh.model.geo.addLine(2, 4, 3)
        gmsh.model.geo.synchronize()
        for group, lines in groups.items():
            gmsh.model.addPhysicalGroup(1, lines, name=group)
        gmsh.model.addPhysicalGroup(0, [1], name="support:root")
        gmsh.model.addPhysicalGroup(0, [2], name="joint:k")
        gmsh.model.mesh.generate(1)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.option.setNumber("Mesh.SaveAll", save_all)
        gmsh.write(str(Path(__file__).with_name(f"{name}.msh")))
    finally:
        gmsh.finalize()


if __name__ == "__main__":
    full = {"sec:chord": [1, 2], "sec:brace": [3]}
    for binary, kind in ((0, "ascii"), (1, "binary")):
        for version in (4.1, 2.2):
            write(f"gmsh_{version}_{kind}", version, binary, full, 0)
        write(f"gmsh_4.1_{kind}_partly", 4.1, binary, {"sec:chord": [1, 2]}, 1)
        write(f"gmsh_4.1_{kind}_twice", 4.1, binary, {"all": [1, 2, 3], "second": [2]}, 0)
