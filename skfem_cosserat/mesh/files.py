"""Lines in and out of files, as plain data: gmsh by ourselves, all else by meshio."""

from __future__ import annotations

import contextlib
import io
import lzma
import re
import struct
import warnings
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, MeshError, ModelWarning
from ..types import (
    NO_INDICES,
    Array,
    ArrayLike,
    FilePath,
    Floats,
    IndexArray,
    file_path,
    names_known,
)
from ..warn import logger, warn
from .decks import DECKS, Deck
from .topology import element_numbers

# -- ASCII gmsh files of points and lines: written in 4.1 and 2.2, read in 4.1 ---------------------
#
# meshio cannot read a 4.1 file in which only some of the lines are in a physical group, and loses a
# name that a point and a line group share; hence an own reader for the ASCII form.

#: gmsh's numbers of cell types, and nodes a cell.
VERTEX = 15
LINE = 1
#: Names of its lines, by their number; those of more nodes than two are refused.
_KINDS = {
    **{LINE: "line", 8: "line3", 26: "line4", 27: "line5", 28: "line6"},
    **{62: "line7", 63: "line8", 64: "line9", 65: "line10", 66: "line11"},
}
#: Sections that are read, and those that leave nodes and cells as they are.
_SECTIONS = re.compile(
    r"MeshFormat|PhysicalNames|Entities|Nodes|Elements|Comments|Periodic|Parametrizations|"
    r"GhostElements|InterpolationScheme|(Node|Element|ElementNode)Data"
)
#: Section in which gmsh keeps the names of physical groups.
_NAMES = "PhysicalNames"


@dataclass(eq=False)
class Groups:
    """Cells of a file and its physical groups.

    Attributes
    ----------
    points : (n, 3)
        Points (m).
    lines : list of (n, 2)
        Nodes of lines.
    beams, nodes : dict of str to list of (n,)
        Numbers of lines and of points in groups, by name.
    other : list of (n, k)
        Nodes of other cells.
    cells : Counter of str
        Number of cells of each type.
    """

    points: Floats
    lines: list[IndexArray] = field(default_factory=list)
    beams: dict[str, list[Any]] = field(default_factory=dict)
    nodes: dict[str, list[Any]] = field(default_factory=dict)
    other: list[IndexArray] = field(default_factory=list)
    cells: Counter[str] = field(default_factory=Counter)


def physical_names(text: bytes) -> dict[tuple[int, int], str]:
    """Names of physical groups by (dimension, tag); this section is text even in binary files."""
    names: dict[tuple[int, int], str] = {}
    start = text.find(b"$" + _NAMES.encode())
    end = text.find(b"$End" + _NAMES.encode())
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
def _section(rows: list[str], name: str) -> Iterator[str]:
    """Words of a section, one after the other."""
    try:
        start = rows.index(f"${name}")
        end = rows.index(f"$End{name}")
    except ValueError:
        raise ValueError(f"has no complete section ${name}") from None
    return iter(" ".join(rows[start + 1 : end]).split())


def _integers(words: Iterator[str], count: int) -> list[int]:
    """The next integers."""
    return [int(next(words)) for _ in range(count)]


def _entity_groups(rows: list[str]) -> dict[tuple[int, int], list[int]]:
    """Physical tags of each geometric entity (dimension, tag)."""
    if "$Entities" not in rows:
        return {}
    words = _section(rows, "Entities")
    groups = {}
    for dim, count in enumerate(_integers(words, 4)):
        for _ in range(count):
            (tag,) = _integers(words, 1)
            for _ in range(3 if dim == 0 else 6):
                next(words)
            groups[dim, tag] = [abs(k) for k in _integers(words, int(next(words)))]
            if dim > 0:
                _integers(words, int(next(words)))
    return groups


def read_gmsh41(content: bytes) -> Groups:
    """Points, vertices and lines of an ASCII file of version 4.1, given its content."""
    rows = [row.strip() for row in content.decode("utf-8").splitlines()]
    names = physical_names(content)
    sections = Counter(row[1:] for row in rows if row.startswith("$") and row[:4] != "$End")
    for name, times in sections.items():
        if not _SECTIONS.fullmatch(name) or (times > 1 and name in ("Nodes", "Elements")):
            raise ValueError(f"section ${name} is not understood, or there twice")
    entity = _entity_groups(rows)
    words = _section(rows, "Nodes")
    blocks, count, _, _ = _integers(words, 4)
    if not 0 <= 3 * count <= sum(map(len, rows)):
        raise ValueError(f"says that it has {count} nodes, which do not fit in it")
    tags = [NO_INDICES]
    points = [np.zeros((0, 3))]
    for _ in range(blocks):
        dim, _, parametric, size = _integers(words, 4)
        tags.append(np.array(_integers(words, size), np.int64))
        width = 3 + (dim if parametric else 0)
        numbers = np.array(list(islice(words, width * size)), float)
        points.append(numbers.reshape(size, width)[:, :3])
    known = np.concatenate(tags)
    order = known.argsort(kind="stable")
    if len(known) != count or (np.diff(known[order]) == 0).any():
        raise ValueError(f"{len(known)} nodes, some of them twice, or not {count} as it says")
    out = Groups(np.concatenate(points))
    cells = rows[rows.index("$Elements") + 1 : rows.index("$EndElements")]
    k = 1
    for _ in range(int(cells[0].split()[0])):
        dim, tag, kind, size = map(int, cells[k].split())
        part = cells[k + 1 : k + 1 + size]
        k += 1 + size
        if len(part) < size:
            raise ValueError("is cut short in section $Elements")
        width = {VERTEX: 2, LINE: 3}.get(kind, -1)
        each = np.array(" ".join(part).split(), np.int64).reshape(size, width)[:, 1:]
        nodes = order[np.minimum(np.searchsorted(known, each, sorter=order), count - 1)]
        if (known[nodes] != each).any():
            raise KeyError(f"node {each[known[nodes] != each][0]}")
        sets = out.nodes
        members = nodes[:, 0]
        if kind == LINE:
            sets = out.beams
            members = out.cells["line"] + np.arange(size)
            out.lines.append(nodes)
        elif kind != VERTEX:
            sets = {}
            out.other.append(nodes)
        for group in entity.get((dim, tag), []):
            sets.setdefault(group_name(names, dim, group), []).append(members)
        out.cells[_KINDS.get(kind, f"type {kind}")] += size
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
    rows += (_rows41 if version == "4.1" else _rows22)(points, t + 1, in_nodes, in_beams)
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
    return " ".join(map(str, (len(tags), *tags)))


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
    low = _numbers(points.min(1))
    high = _numbers(points.max(1))
    rows = ["$Entities", f"{len(named)} {len(curves)} 0 0"]
    for k, v in enumerate(named, start=1):
        rows.append(f"{k} {_numbers(points[:, v])} {_counted(in_nodes[v])}")
    for tags, k in curves.items():
        rows.append(f"{k} {low} {high} {_counted(tags)} 0")
    nv = points.shape[1]
    runs = _runs(in_beams)
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


# -- plain data of lines in and out of files; the one place that calls meshio ----------------------

#: Prefixes of the arrays that carry names in VTU files.
BEAM = "beam:"
NODE = "node:"
#: What readers raise on files that are broken or not what their name says.
_BROKEN = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    ImportError,
    LookupError,
    MemoryError,
    NameError,
    OSError,
    RuntimeError,
    StopIteration,
    SyntaxError,
    TypeError,
    ValueError,
    lzma.LZMAError,
    struct.error,
    zlib.error,
)


@dataclass(frozen=True, eq=False)
class LineData:
    """Contents of a file with a line mesh.

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


@contextlib.contextmanager
def read_errors(path: FilePath) -> Iterator[None]:
    """Whatever goes wrong with what a file says is one error that names the file."""
    item = f"file '{file_path(path)}'"
    try:
        yield
    except InputError as error:
        if isinstance(error, MeshError) and item in str(error):
            raise
        raise MeshError(item, str(error)) from error
    except _BROKEN as error:
        raise MeshError(item, f"cannot be read: {reason(error)}") from error


def read_lines(path: FilePath) -> LineData:
    """Lines of a file; see :func:`skfem_cosserat.mesh.read_mesh`."""
    file = file_path(path)
    if not file.is_file():
        raise ValueError("does not exist, or is no file")
    lines = _read_lines(file)
    if not np.isfinite(lines.points).all() or abs(lines.points).max() > 1e150:
        raise ValueError("has coordinates that are not finite or too large")
    return lines


def _read_lines(file: Path) -> LineData:
    """Lines of a file of any kind."""
    if read := DECKS.get(file.suffix.lower()):
        return _from_deck(file, read(file))
    content = file.read_bytes()
    if _is_gmsh41(content, b"0"):
        found = read_gmsh41(content)
        _check_cells(found.cells)
        beams = _arrays(found.beams)
        nodes = _arrays(found.nodes)
        return _cleaned(found.points, np.concatenate(found.lines), beams, nodes, found.other)
    mesh = _meshio(file, content)
    lines = lines_of(mesh, physical_names(content))
    if _is_gmsh41(content, b"1"):
        for name, (_, dimension) in mesh.field_data.items():
            if dimension <= 1 and name not in lines.beams and name not in lines.nodes:
                raise ValueError(f"group '{name}' cannot be read; {_AS_ASCII}")
    return lines


def lines_of(mesh: Any, names: Mapping[tuple[int, int], str] | None = None) -> LineData:
    """Lines of a meshio.Mesh; names of its physical groups, if they are not all in the mesh."""
    _check_cells(Counter({block.type: len(block.data) for block in mesh.cells}))
    lines = np.vstack([block.data for block in mesh.cells if block.type == "line"])
    if lines.shape[1] != 2:
        raise ValueError(f"has polylines of {lines.shape[1]} nodes: split them")
    if names is None:
        names = {(int(dim), int(tag)): name for name, (tag, dim) in mesh.field_data.items()}
    beams, nodes = _meshio_names(mesh, names)
    others = [block.data for block in mesh.cells if block.type not in ("line", "vertex")]
    return _cleaned(_in_space(mesh.points), lines, beams, nodes, others)


def _in_space(points: Array) -> Floats:
    """Points (n, 3), what is missing is zero."""
    out = np.zeros((len(points), 3))
    out[:, : points.shape[1]] = points
    return out


def lines_of_skfem(mesh: Any, edges: str | ArrayLike | None) -> LineData:
    """Lines, or edges, of a mesh of scikit-fem."""
    dimension = mesh.dim()
    named = mesh.boundaries or {}
    beams, nodes = (dict(mesh.subdomains or {}), named) if dimension == 1 else (named, {})
    if dimension == 3:
        beams = {}
    lines = (mesh.t[:2], mesh.facets, mesh.edges)[dimension - 1].T
    if isinstance(edges, str):
        if edges not in beams:
            raise MeshError("argument edges", f"got {edges!r}; {names_known(edges, beams)}")
        edges = beams[edges]
    chosen = element_numbers(np.arange(len(lines)) if edges is None else edges, len(lines))
    beams = {name: np.flatnonzero(np.isin(chosen, own)) for name, own in beams.items()}
    beams = {name: own for name, own in beams.items() if len(own)}
    return _cleaned(_in_space(mesh.p.T), lines[chosen], beams, nodes)


def _from_deck(file: Path, deck: Deck) -> LineData:
    """Lines of a deck, with a warning of what is not read."""
    ends = {node for nodes in deck.lines.values() for node in nodes}
    for missing in ends - deck.nodes.keys():
        raise MeshError(f"node {missing}", "belongs to an element, and is not given")
    deck.left["nodes of no line, in sets too"] = len(deck.nodes.keys() - ends)
    said = ", ".join(f"{name} ({count})" for name, count in deck.left.items() if count)
    if not ends:
        raise ValueError(f"has no lines; found: {said or 'none'}")
    if said:
        text = (
            f"only nodes, lines and sets are read, not {said}:"
            " add what matters of these to the model, such as sections, joints and loads"
        )
        warn(f"file '{file}'", text, ModelWarning)
    place = {node: k for k, node in enumerate(deck.nodes)}
    lines = np.array([[place[node] for node in pair] for pair in deck.lines.values()])
    beams = {
        name: np.flatnonzero(np.isin([*deck.lines], [*members]))
        for name, members in deck.line_sets.items()
        if name and members & deck.lines.keys()
    }
    nodes = {
        name: np.array(sorted(place[node] for node in members & ends))
        for name, members in deck.node_sets.items()
        if name and members & ends
    }
    return _cleaned(np.array([*deck.nodes.values()]), lines, beams, nodes)


def _check_cells(cells: Counter[str]) -> None:
    """Refuse a file without lines, or with lines of more nodes than two."""
    expected = "only lines with two nodes are read: mesh with order 1"
    for kind, count in cells.items():
        if (kind.startswith("line") and kind != "line") or kind.endswith("_CURVE"):
            raise ValueError(f"has {count} cells of type '{kind}'; {expected}")
    if not cells["line"]:
        raise ValueError(f"has no lines; cells found: {dict(cells) or 'none'}")


_AS_ASCII = "of a binary gmsh 4.1 file not all is understood: save it as ASCII (Mesh.Binary = 0)"


def _is_gmsh41(content: bytes, kind: bytes) -> bool:
    """If a file starts like a gmsh file of version 4.1, ASCII (b"0") or binary (b"1")."""
    return content[:4096].split(b"$MeshFormat", 1)[-1].split()[:2] == [b"4.1", kind]


#: What meshio drops in silence or reads on for ever: suffix, pattern, what to say.
_BEFORE = (
    (".ply", rb"\A(?!.*^end_header\s*$)", "its header has no end"),
    (".obj", rb"^l\s", "has lines in an .obj file, which are not read: save it as .msh or .vtu"),
    (".vtu", rb"<Piece.*<Piece", "has several pieces, of which one would be read: merge them"),
    ((".xdmf", ".xmf"), rb"BaseOffset|<xi:", "has BaseOffset or xi:include, which are not read"),
    ((".tec", ".dat"), rb"^\s*ZONE.*^\s*ZONE", "has several zones, of which one would be read"),
)


#: What meshio may say of a file that it reads as a whole.
_HARMLESS = re.compile(
    r"tag data that couldn't|tags of string type|some time data|"
    r"keyword (RequiredVertices|TangentAtVertices|Tangents|Ridges)\."
)


def reason(error: Exception) -> str:
    """Words for a user about an error of a reader."""
    if isinstance(error, KeyError):
        return f"{' '.join(map(str, error.args))} is unknown or missing"
    if isinstance(error, ImportError):
        return f"the package {error.name} is needed, and is not installed"
    return " ".join(str(error).split()) or "it is damaged, or not what its name says"


def _meshio(file: Path, content: bytes) -> Any:
    """Read by meshio, which prints what it drops, and leaves the interpreter when it fails."""
    import meshio  # slow to import: gmsh files do without
    from meshio._exceptions import CorruptionError

    said = io.StringIO()
    name = file.name.lower()
    if not name.endswith(tuple(meshio.extension_to_filetypes)):
        raise ValueError(
            f"files of suffix '{file.suffix}' are not read: save its lines as .msh or .vtu"
        )
    for suffix, pattern, text in _BEFORE:
        if name.endswith(suffix) and re.search(pattern, content, re.MULTILINE | re.DOTALL):
            raise ValueError(text)
    why = f"; {_AS_ASCII}" if _is_gmsh41(content, b"1") else ""
    if name.endswith((".vtk", ".vtu")):
        why = "; only unstructured grids of lines with two nodes are read, no polylines"
    if not content.strip():
        raise ValueError("is empty")
    try:
        with (
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
            warnings.catch_warnings(),
            np.errstate(all="ignore"),
        ):
            warnings.simplefilter("ignore")
            mesh = meshio.read(file)
    except SystemExit as error:  # it says why, or nothing but that it cannot
        because = said.getvalue().partition("Error: Couldn't")[0]
        raise ValueError(f"{reason(ValueError(because))}{why}") from error
    except (*_BROKEN, CorruptionError, meshio.ReadError) as error:
        raise ValueError(f"{reason(error)}{why}") from error
    for text in " ".join(said.getvalue().split()).split("Warning: "):
        if text and not _HARMLESS.search(text):
            raise ValueError(f"not as a whole: {text}{why}")
    return mesh


def _arrays(names: dict[str, list[Any]]) -> dict[str, IndexArray]:
    """Lists of arrays, each as a sorted array of different numbers."""
    return {
        name: np.unique(np.concatenate([np.asarray(part, np.int64) for part in parts]))
        for name, parts in names.items()
    }


def _meshio_names(
    mesh: Any, names: Mapping[tuple[int, int], str]
) -> tuple[dict[str, IndexArray], dict[str, IndexArray]]:
    """Named elements and points of whatever convention the file follows."""
    beams: dict[str, list[Any]] = {}
    nodes: dict[str, list[Any]] = {}
    if "gmsh:physical" in mesh.cell_data:
        tags = mesh.cell_data_dict["gmsh:physical"]
        for dim, (kind, sets) in enumerate((("vertex", nodes), ("line", beams))):
            cells = [block.data for block in mesh.cells if block.type == kind]
            for tag in set(tags.get(kind, ())) - {0}:
                members = np.flatnonzero(tags[kind] == tag)
                own = members if dim else np.concatenate(cells)[members, 0]
                sets.setdefault(group_name(names, dim, tag), []).append(own)
    else:
        for name, parts in mesh.cell_sets_dict.items():
            if "line" in parts and not name.startswith("gmsh:"):
                beams.setdefault(name, []).append(parts["line"])
    for name, index in mesh.point_sets.items():
        nodes.setdefault(name, []).append(index)
    for name, values in (mesh.cell_data_dict or {}).items():
        if name.startswith(BEAM) and "line" in values:
            beams[name.removeprefix(BEAM)] = [np.flatnonzero(values["line"])]
    for name, values in mesh.point_data.items():
        if name.startswith(NODE):
            nodes[name.removeprefix(NODE)] = [np.flatnonzero(values)]
    return _arrays(beams), _arrays(nodes)


def _cleaned(
    points: Floats,
    lines: Array,
    beams: dict[str, IndexArray],
    nodes: dict[str, IndexArray],
    others: Sequence[IndexArray] = (),
) -> LineData:
    """Without points that belong to no line and without repetitions of a line for each group."""
    used = np.unique(lines)
    number = np.full(len(points), -1)
    for cells in others:
        number[cells] = -2
    number[used] = np.arange(len(used))
    if len(used) < len(points):
        logger.info("dropped %d points that belong to no line", len(points) - len(used))
    for name, index in nodes.items():
        if (number[index] == -1).any():
            place = points[index[number[index] == -1][0]].tolist()
            raise MeshError(f"node '{name}'", f"at {place} belongs to no line of the mesh")
    keep = np.arange(len(lines))
    key = lines.astype(np.int64) @ np.array([len(points), 1])
    if len(np.unique(key)) < len(key):
        owners: list[set[str]] = [set() for _ in key]
        for name, index in beams.items():
            for e in index.tolist():
                owners[e].add(name)
        seen: dict[int, int] = {}
        for e, (line, own) in enumerate(zip(key.tolist(), owners, strict=True)):
            first = seen.setdefault(line, e)
            if first != e and own and owners[first] and not own & owners[first]:
                owners[first] |= own
                keep[e] = first
    kept = np.flatnonzero(keep == np.arange(len(lines)))
    place = np.searchsorted(kept, keep)
    found = LineData(
        points=points[used].T.copy(),
        t=number[lines[kept]].T.copy(),
        beams={name: np.unique(place[index]) for name, index in beams.items()},
        nodes={name: number[index[number[index] >= 0]] for name, index in nodes.items()},
    )
    for array in (found.points, found.t, *found.beams.values(), *found.nodes.values()):
        array.flags.writeable = False  # who reads the file again has the same
    return found


def write_lines(
    path: FilePath,
    lines: LineData,
    point_data: dict[str, Any] | None = None,
    cell_data: dict[str, Any] | None = None,
    file_format: str | None = None,
) -> None:
    """Write lines; see :func:`skfem_cosserat.mesh.write_mesh`."""
    file = file_path(path)
    default = {".msh": "gmsh", ".vtu": "vtu", ".vtk": "vtk"}.get(file.suffix.lower())
    kind = default if file_format is None else file_format
    if kind not in {"gmsh", "gmsh22", "vtu", "vtk"}:
        raise MeshError(
            f"file '{file}'", f"format {kind!r} of suffix '{file.suffix}' is not .msh, .vtu or .vtk"
        )
    if not file.parent.is_dir():
        raise MeshError(f"file '{file}'", f"cannot be written: no folder '{file.parent}'")
    if kind in ("vtu", "vtk"):
        _write_vtk(file, kind, lines, point_data or {}, cell_data or {})
        return
    if point_data or cell_data:
        raise MeshError(f"file '{file}'", "data on points or cells are written to .vtu only")
    version = "2.2" if kind == "gmsh22" else "4.1"
    write_gmsh(file, lines.points, lines.t, lines.beams, lines.nodes, version)


def _write_vtk(
    file: Path, kind: str, lines: LineData, point_data: dict[str, Any], cell_data: dict[str, Any]
) -> None:
    """Write VTU, or legacy VTK, with 0/1 arrays for the names."""
    import meshio  # slow to import: gmsh files do without

    for name in [*lines.beams, *lines.nodes]:  # meshio writes names unescaped
        if not name.isprintable() or set(name) & set('"<>&'):
            raise MeshError(f"name {name!r}", "cannot be written to a VTU file: quotes, <, > or &")
        if kind == "vtk" and " " in name:
            raise MeshError(f"name {name!r}", "has a space, which a .vtk file cannot hold: .vtu")
    ne = lines.t.shape[1]
    nv = lines.points.shape[1]
    cells = {BEAM + k: np.isin(np.arange(ne), v).astype(np.int32) for k, v in lines.beams.items()}
    points = {NODE + k: np.isin(np.arange(nv), v).astype(np.int32) for k, v in lines.nodes.items()}
    mesh = meshio.Mesh(
        np.ascontiguousarray(lines.points.T),
        [("line", lines.t.T)],
        point_data={**points, **point_data},
        cell_data={k: [np.asarray(v)] for k, v in {**cells, **cell_data}.items()},
    )
    meshio.write(file, mesh, file_format=kind)
