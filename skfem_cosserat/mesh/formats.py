"""Plain data of lines in and out of files; the one place that calls meshio."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import meshio
import numpy as np

from ..errors import MeshError
from ..log import logger
from ..types import Array, Floats, IndexArray
from . import gmsh

__all__ = ["LineData", "read_lines", "write_lines"]

#: Prefixes of the arrays that carry names in VTU files.
BEAM, NODE = "beam:", "node:"
#: What meshio's readers raise on files that are broken or not what their name says.
_BROKEN = (
    AssertionError,
    EOFError,
    ElementTree.ParseError,
    ImportError,
    IndexError,
    KeyError,
    OSError,
    TypeError,
    ValueError,
    meshio.ReadError,
)


@dataclass(frozen=True, eq=False)
class LineData:
    """What a file holds of a line mesh.

    Attributes
    ----------
    points : (3, nv)
        Vertices (m).
    t : (2, ne)
        Elements.
    beams, nodes : dict of str to (n,)
        Element and vertex numbers by name.
    """

    points: Floats
    t: Array
    beams: dict[str, IndexArray]
    nodes: dict[str, IndexArray]


def read_lines(path: str | PathLike[str]) -> LineData:
    """Lines of a file; see :func:`skfem_cosserat.mesh.read_mesh`."""
    file = Path(path)
    if not file.is_file():
        raise MeshError(f"file '{file}'", "does not exist")
    if _is_gmsh41(file, b"0"):
        return _from_gmsh41(file)
    mesh = _meshio(file)
    kinds = {block.type: len(block.data) for block in mesh.cells}
    quadratic = [kind for kind in kinds if kind.startswith("line") and kind != "line"]
    if quadratic:
        raise MeshError(
            f"file '{file}'",
            f"has {kinds[quadratic[0]]} cells of type '{quadratic[0]}'; only lines with two nodes"
            " are read: mesh with order 1 (elements of any order are made by DirectorBasis)",
        )
    if "line" not in kinds:
        raise MeshError(f"file '{file}'", f"has no lines; cells found: {kinds or 'none'}")
    lines = np.vstack([block.data for block in mesh.cells if block.type == "line"])
    beams, nodes = _meshio_names(mesh, file)
    if _is_gmsh41(file, b"1"):
        for name, (_, dimension) in mesh.field_data.items():
            if dimension <= 1 and name not in beams and name not in nodes:
                raise MeshError(f"file '{file}'", f"group '{name}' cannot be read; {_AS_ASCII}")
    points = np.zeros((len(mesh.points), 3))
    points[:, : mesh.points.shape[1]] = mesh.points
    return _cleaned(file, points, lines, beams, nodes)


_AS_ASCII = "of a binary gmsh 4.1 file not all is understood: save it as ASCII (Mesh.Binary = 0)"


def _is_gmsh41(file: Path, kind: bytes) -> bool:
    """If a file starts like a gmsh file of version 4.1, ASCII (b"0") or binary (b"1")."""
    if file.suffix.lower() != ".msh":
        return False
    with file.open("rb") as stream:
        head = stream.read(4096).split(b"$MeshFormat", 1)[-1].split()
    return head[:2] == [b"4.1", kind]


def _meshio(file: Path) -> Any:
    """Read by meshio, which prints and leaves the interpreter when it fails."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            return meshio.read(file)
    except SystemExit:
        message = " ".join(said.getvalue().split()) or "no reason given"
        raise MeshError(f"file '{file}'", f"cannot be read ({message})") from None
    except _BROKEN as error:
        reason = f"{type(error).__name__}: {error}"
        if file.is_file() and _is_gmsh41(file, b"1"):
            reason += f"; {_AS_ASCII}"
        raise MeshError(f"file '{file}'", f"cannot be read ({reason})") from error


def _from_gmsh41(file: Path) -> LineData:
    """Lines of an ASCII gmsh 4.1 file."""
    names = gmsh.physical_names(file)
    found = gmsh.read_gmsh41(file)
    if not found.lines:
        quadratic = found.other.get(8, 0)
        why = f"has {quadratic} quadratic lines (line3)" if quadratic else "has no lines"
        raise MeshError(
            f"file '{file}'", f"{why}; only lines with two nodes are read: mesh with order 1"
        )
    if 8 in found.other:
        raise MeshError(
            f"file '{file}'",
            f"has {found.other[8]} quadratic lines (line3); only lines with two nodes are read",
        )
    beams: dict[str, list[int]] = {}
    for e, (_, tags) in enumerate(found.lines):
        for tag in tags:
            beams.setdefault(gmsh.group_name(names, 1, tag), []).append(e)
    nodes: dict[str, list[int]] = {}
    for vertices, tags in found.vertices:
        for tag in tags:
            nodes.setdefault(gmsh.group_name(names, 0, tag), []).append(vertices[0])
    lines = np.array([line for line, _ in found.lines])
    return _cleaned(file, found.points, lines, _arrays(beams), _arrays(nodes))


def _arrays(names: dict[str, list[int]]) -> dict[str, IndexArray]:
    """Lists as sorted arrays of different numbers."""
    return {name: np.unique(np.array(members, dtype=np.int64)) for name, members in names.items()}


def _tagged(
    mesh: Any, kind: str, tags: Iterable[Array]
) -> Iterable[tuple[int, IndexArray, IndexArray]]:
    """(tag, cell numbers among all of the kind, nodes) of physical groups of one kind of cell."""
    first = 0
    for block, values in zip(mesh.cells, tags, strict=True):
        if block.type != kind:
            continue
        for tag in np.unique(values[values != 0]).tolist():
            members = np.flatnonzero(values == tag)
            yield tag, first + members, np.unique(block.data[members])
        first += len(block.data)


def _meshio_names(mesh: Any, file: Path) -> tuple[dict[str, IndexArray], dict[str, IndexArray]]:
    """Named elements and points of whatever convention the file follows."""
    beams: dict[str, list[int]] = {}
    nodes: dict[str, list[int]] = {}
    tags = mesh.cell_data.get("gmsh:physical")
    if tags is not None:
        names = gmsh.physical_names(file)
        for tag, members, _ in _tagged(mesh, "line", tags):
            beams.setdefault(gmsh.group_name(names, 1, tag), []).extend(members)
        for tag, _, points in _tagged(mesh, "vertex", tags):
            nodes.setdefault(gmsh.group_name(names, 0, tag), []).extend(points)
    else:
        for name, parts in mesh.cell_sets_dict.items():
            if "line" in parts and not name.startswith("gmsh:"):
                beams.setdefault(name, []).extend(parts["line"])
    for name, index in mesh.point_sets.items():
        nodes.setdefault(name, []).extend(index)
    for name, values in (mesh.cell_data_dict or {}).items():
        if name.startswith(BEAM) and "line" in values:
            beams[name.removeprefix(BEAM)] = np.flatnonzero(values["line"]).tolist()
    for name, values in mesh.point_data.items():
        if name.startswith(NODE):
            nodes[name.removeprefix(NODE)] = np.flatnonzero(values).tolist()
    return _arrays(beams), _arrays(nodes)


def _cleaned(
    file: Path,
    points: Floats,
    lines: Array,
    beams: dict[str, IndexArray],
    nodes: dict[str, IndexArray],
) -> LineData:
    """Without points that belong to no line and without repetitions of a line for each group."""
    used = np.unique(lines)
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    if len(used) < len(points):
        logger.info("%s: dropped %d points that belong to no line", file, len(points) - len(used))
    for name, index in nodes.items():
        if (number[index] < 0).any():
            place = points[index[number[index] < 0][0]].tolist()
            raise MeshError(
                f"node '{name}'", f"at {place} in file '{file}' belongs to no line of the mesh"
            )
    keep = np.arange(len(lines))
    owners: list[set[str]] = [set() for _ in lines] if beams else []
    for name, index in beams.items():
        for e in index.tolist():
            owners[e].add(name)
    seen: dict[tuple[int, ...], int] = {}
    for e, line in enumerate(lines.tolist()):
        first = seen.setdefault(tuple(line), e)
        if first != e and owners and owners[e] and owners[first] and not owners[e] & owners[first]:
            owners[first] |= owners[e]
            keep[e] = first
    kept = np.flatnonzero(keep == np.arange(len(lines)))
    place = np.searchsorted(kept, keep)
    return LineData(
        points=points[used].T.copy(),
        t=number[lines[kept]].T,
        beams={name: np.unique(place[index]) for name, index in beams.items()},
        nodes={name: number[index] for name, index in nodes.items()},
    )


def write_lines(
    path: str | PathLike[str],
    lines: LineData,
    point_data: dict[str, Any] | None = None,
    cell_data: dict[str, Any] | None = None,
    file_format: str | None = None,
) -> None:
    """Write lines; see :func:`skfem_cosserat.mesh.write_mesh`."""
    file = Path(path)
    default = {".msh": "gmsh", ".vtu": "vtu"}.get(file.suffix.lower())
    kind = default if file_format is None else file_format
    if kind not in {"gmsh", "gmsh22", "vtu"}:
        raise MeshError(
            f"file '{file}'", f"format {kind!r} of suffix '{file.suffix}' is not .msh or .vtu"
        )
    if not file.parent.is_dir():
        raise MeshError(f"file '{file}'", f"cannot be written: no folder '{file.parent}'")
    if kind == "vtu":
        _write_vtu(file, lines, point_data or {}, cell_data or {})
        return
    if point_data or cell_data:
        raise MeshError(f"file '{file}'", "data on points or cells are written to .vtu only")
    version = "2.2" if kind == "gmsh22" else "4.1"
    gmsh.write_gmsh(file, lines.points, lines.t, lines.beams, lines.nodes, version)


def _write_vtu(
    file: Path, lines: LineData, point_data: dict[str, Any], cell_data: dict[str, Any]
) -> None:
    """Write VTU with 0/1 arrays for the names."""
    for name in [*lines.beams, *lines.nodes]:  # meshio writes names unescaped
        if not name.isprintable() or set(name) & set('"<>&'):
            raise MeshError(f"name {name!r}", "cannot be written to a VTU file: quotes, <, > or &")
    ne, nv = lines.t.shape[1], lines.points.shape[1]
    cells = {BEAM + k: np.isin(np.arange(ne), v).astype(np.int32) for k, v in lines.beams.items()}
    points = {NODE + k: np.isin(np.arange(nv), v).astype(np.int32) for k, v in lines.nodes.items()}
    mesh = meshio.Mesh(
        np.ascontiguousarray(lines.points.T),
        [("line", lines.t.T)],
        point_data={**points, **point_data},
        cell_data={k: [np.asarray(v)] for k, v in {**cells, **cell_data}.items()},
    )
    meshio.write(file, mesh, file_format="vtu")
