"""ASCII gmsh files of points and lines: written in 4.1 and 2.2, read in 4.1.

meshio cannot read a 4.1 file in which only some of the lines are in a physical group, and loses a
name that a point and a line group share; hence an own reader for the ASCII form.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MeshError
from ..types import Array, Floats, IndexArray

__all__ = ["Groups", "group_name", "physical_names", "read_gmsh41", "write_gmsh"]

#: gmsh's numbers of cell types, and nodes a cell.
VERTEX, LINE = 15, 1
#: Section in which gmsh keeps the names of physical groups.
_NAMES = "PhysicalNames"


@dataclass(eq=False)
class Groups:
    """Cells of a file by type, with the physical groups each is in.

    Attributes
    ----------
    points : (n, 3)
        Points (m).
    lines, vertices : lists of (nodes, groups)
        Cells with the (dimension, tag) of their groups.
    other : dict of int to int
        Number of cells of any other type, by gmsh's number of the type.
    """

    points: Floats
    lines: list[tuple[list[int], list[int]]] = field(default_factory=list)
    vertices: list[tuple[list[int], list[int]]] = field(default_factory=list)
    other: dict[int, int] = field(default_factory=dict)


def physical_names(path: Path) -> dict[tuple[int, int], str]:
    """Names of physical groups by (dimension, tag); this section is text even in binary files."""
    names: dict[tuple[int, int], str] = {}
    text = path.read_bytes()
    start, end = text.find(b"$" + _NAMES.encode()), text.find(b"$End" + _NAMES.encode())
    if start < 0 or end < 0:
        return names
    for row in text[start:end].decode("utf-8", errors="replace").splitlines()[2:]:
        parts = row.split(None, 2)
        if len(parts) == 3:
            names[int(parts[0]), int(parts[1])] = (
                parts[2].strip().removeprefix('"').removesuffix('"')
            )
    return names


def group_name(names: Mapping[tuple[int, int], str], dim: int, tag: int) -> str:
    """Name of a physical group; groups without a name are called by their tag."""
    return names.get((dim, tag), f"physical-{tag}")


# ----------------------------------------------------------------------- reading 4.1
def _section(rows: list[str], name: str, path: Path) -> Iterator[str]:
    """Words of a section, one after the other."""
    try:
        start, end = rows.index(f"${name}"), rows.index(f"$End{name}")
    except ValueError:
        raise MeshError(f"file '{path}'", f"has no complete section ${name}") from None
    return iter(" ".join(rows[start + 1 : end]).split())


def _integers(words: Iterator[str], count: int) -> list[int]:
    """The next integers."""
    return [int(next(words)) for _ in range(count)]


def _entity_groups(rows: list[str], path: Path) -> dict[tuple[int, int], list[int]]:
    """Physical tags of each geometric entity (dimension, tag)."""
    if "$Entities" not in rows:
        return {}
    words = _section(rows, "Entities", path)
    groups: dict[tuple[int, int], list[int]] = {}
    for dim, count in enumerate(_integers(words, 4)):
        for _ in range(count):
            (tag,) = _integers(words, 1)
            for _ in range(3 if dim == 0 else 6):
                next(words)
            groups[dim, tag] = [abs(k) for k in _integers(words, int(next(words)))]
            if dim > 0:
                _integers(words, int(next(words)))
    return groups


def read_gmsh41(path: Path) -> Groups:
    """Points, vertices and lines of an ASCII file of version 4.1.

    Raises
    ------
    MeshError
        If a section is missing, cut short or not what the format says.
    """
    rows = [row.strip() for row in path.read_text(encoding="utf-8").splitlines()]
    try:
        return _read_rows(rows, path)
    except (StopIteration, ValueError, KeyError) as error:
        if isinstance(error, MeshError):
            raise
        raise MeshError(
            f"file '{path}'", f"is not a sound gmsh 4.1 file ({type(error).__name__}: {error})"
        ) from error


def _read_rows(rows: list[str], path: Path) -> Groups:
    """Contents of the sections."""
    entity = _entity_groups(rows, path)
    words = _section(rows, "Nodes", path)
    blocks, count, _, _ = _integers(words, 4)
    points = np.empty((count, 3))
    number: dict[int, int] = {}
    for _ in range(blocks):
        dim, _, parametric, size = _integers(words, 4)
        tags = _integers(words, size)
        for tag in tags:
            points[len(number)] = [float(next(words)) for _ in range(3)]
            number[tag] = len(number)
            for _ in range(dim if parametric else 0):
                next(words)
    out = Groups(points)
    cells = [row.split() for row in rows[rows.index("$Elements") + 1 : rows.index("$EndElements")]]
    k = 1
    for _ in range(int(cells[0][0])):
        dim, tag, kind, size = (int(word) for word in cells[k])
        groups = entity.get((dim, tag), [])
        part = cells[k + 1 : k + 1 + size]
        k += 1 + size
        if len(part) < size:
            raise MeshError(f"file '{path}'", "is cut short in section $Elements")
        if kind in (VERTEX, LINE):
            target = out.vertices if kind == VERTEX else out.lines
            target += [([number[int(v)] for v in row[1:]], groups) for row in part]
        else:
            out.other[kind] = out.other.get(kind, 0) + size
    return out


# ----------------------------------------------------------------------- writing
def write_gmsh(
    path: Path,
    points: Floats,
    t: Array,
    beams: Mapping[str, IndexArray],
    nodes: Mapping[str, IndexArray],
    version: str = "4.1",
) -> None:
    """Write an ASCII file; numbers are written with all their digits.

    Parameters
    ----------
    path : Path
        The file.
    points : (3, nv)
        Vertices (m).
    t : (2, ne)
        Elements.
    beams, nodes : dict
        Element and vertex numbers by name.
    version : {"4.1", "2.2"}
        Format. In 2.2 a cell has one group only: lines of several beams are written once a beam.
    """
    names = [(0, k + 1, name) for k, name in enumerate(nodes)]
    names += [(1, k + 1 + len(nodes), name) for k, name in enumerate(beams)]
    for _, _, name in names:
        if '"' in name or not name.isprintable() or name != name.strip() or not name:
            raise MeshError(f"name {name!r}", "cannot be written to a gmsh file: quotes or spaces")
    in_nodes = _members(nodes.values(), points.shape[1], 1)
    in_beams = _members(beams.values(), t.shape[1], 1 + len(nodes))
    rows = ["$MeshFormat", f"{version} 0 8", "$EndMeshFormat"]
    if names:
        rows += [f"${_NAMES}", str(len(names))]
        rows += [f'{dim} {tag} "{name}"' for dim, tag, name in names] + [f"$End{_NAMES}"]
    body = _rows41 if version == "4.1" else _rows22
    rows += body(points, t + 1, in_nodes, in_beams)
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def _members(groups: Any, count: int, first: int) -> list[tuple[int, ...]]:
    """Tags of the groups each item is in."""
    found: list[list[int]] = [[] for _ in range(count)]
    for tag, members in enumerate(groups, start=first):
        for k in members.tolist():
            found[k].append(tag)
    return [tuple(tags) for tags in found]


def _numbers(values: Any) -> str:
    """Numbers as text that reads back to the same values."""
    return " ".join(repr(float(v)) for v in values)


def _counted(tags: tuple[int, ...]) -> str:
    """Number of tags and the tags."""
    return " ".join(str(k) for k in (len(tags), *tags))


def _runs(tags: list[tuple[int, ...]]) -> list[tuple[tuple[int, ...], range]]:
    """Neighbours with equal tags."""
    cuts = [0, *(k for k in range(1, len(tags)) if tags[k] != tags[k - 1]), len(tags)]
    return [(tags[a], range(a, b)) for a, b in pairwise(cuts)]


def _rows41(
    points: Floats,
    t: Array,
    in_nodes: list[tuple[int, ...]],
    in_beams: list[tuple[int, ...]],
) -> list[str]:
    """Sections of a 4.1 file: one curve for each combination of beams."""
    named = [v for v, tags in enumerate(in_nodes) if tags]
    curves = {tags: k for k, tags in enumerate(dict.fromkeys(in_beams), start=1)}
    low, high = _numbers(points.min(axis=1)), _numbers(points.max(axis=1))
    rows = ["$Entities", f"{len(named)} {len(curves)} 0 0"]
    for k, v in enumerate(named, start=1):
        rows.append(f"{k} {_numbers(points[:, v])} {_counted(in_nodes[v])}")
    for tags, k in curves.items():
        rows.append(f"{k} {low} {high} {_counted(tags)} 0")
    nv, runs = points.shape[1], _runs(in_beams)
    rows += ["$EndEntities", "$Nodes", f"1 {nv} 1 {nv}", f"1 1 0 {nv}"]
    rows += [str(v + 1) for v in range(nv)]
    rows += [_numbers(point) for point in points.T]
    total = len(named) + t.shape[1]
    rows += ["$EndNodes", "$Elements", f"{len(named) + len(runs)} {total} 1 {total}"]
    for k, v in enumerate(named, start=1):
        rows += [f"0 {k} {VERTEX} 1", f"{k} {v + 1}"]
    for tags, run in runs:
        rows.append(f"1 {curves[tags]} {LINE} {len(run)}")
        rows += [f"{len(named) + e + 1} {t[0, e]} {t[1, e]}" for e in run]
    return [*rows, "$EndElements"]


def _rows22(
    points: Floats,
    t: Array,
    in_nodes: list[tuple[int, ...]],
    in_beams: list[tuple[int, ...]],
) -> list[str]:
    """Sections of a 2.2 file; tag 0 is no group."""
    rows = ["$Nodes", str(points.shape[1])]
    rows += [f"{v} {_numbers(point)}" for v, point in enumerate(points.T, start=1)]
    cells = [f"{VERTEX} 2 {tag} {v + 1} {v + 1}" for v, tags in enumerate(in_nodes) for tag in tags]
    cells += [
        f"{LINE} 2 {tag} 1 {t[0, e]} {t[1, e]}"
        for e, tags in enumerate(in_beams)
        for tag in (tags or (0,))
    ]
    rows += ["$EndNodes", "$Elements", str(len(cells))]
    rows += [f"{k} {cell}" for k, cell in enumerate(cells, start=1)]
    return [*rows, "$EndElements"]
