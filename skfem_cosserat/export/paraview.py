"""Files for ParaView: layers of points, cells and data at each state."""

from __future__ import annotations

import os
import sys
import zlib
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from ..analysis.describe import WORKS
from ..arguments import checked
from ..errors import IncompleteWarning, InputError, writing
from ..history import History
from ..history.container import ADVICE, BALANCE
from ..model.quadratic import TOGETHER
from ..types import Array, ArrayLike, FilePath, Floats, IndexArray, switch, whole
from ..warn import logger, warn
from .geometry import BeamShape, beam_shapes, body_shapes, quaternions
from .script import SCRIPT

# -- the layers of a scene as grids with data: beams, swept surfaces, bodies, joints, springs ------

#: Names of the six numbers of a strain or resultant series.
_PAIRS = {"strain": ("Gamma", "K"), "resultant": ("N", "M")}

#: VTK's numbers of the kinds of cells
_VTK = {"vertex": 1, "line": 3, "triangle": 5, "polygon": 7, "quad": 9, "quadratic line": 21}

States = Mapping[str, Array]
Fields = dict[str, Array]


class Cells:
    """Cells of a layer and the data that they and their points have in all states.

    Parameters
    ----------
    blocks : sequence of (int, (m, k) array)
        VTK's number of a kind of cells, and the points of each cell.
    at_points, at_cells : mapping of str to array
        Data that never changes: numbers or names.
    """

    def __init__(
        self,
        blocks: Sequence[tuple[int, IndexArray]],
        at_points: Fields | None = None,
        at_cells: Fields | None = None,
    ):
        widths = [np.full(len(block), block.shape[1]) for _, block in blocks]
        kinds = [np.full(len(block), kind) for kind, block in blocks]
        self.count = sum(map(len, widths))
        topology = {
            "connectivity": np.concatenate([block.ravel() for _, block in blocks]),
            "offsets": np.concatenate(widths).cumsum(),
        }
        small = {name: values.astype(np.int32) for name, values in topology.items()}
        #: of three groups of arrays, see `_array`
        self.encoded = [
            [_array(name, values, 6) for name, values in (fields or {}).items()]
            for fields in (
                small | {"types": np.concatenate(kinds).astype(np.uint8)},
                at_points,
                at_cells,
            )
        ]


class Grid(NamedTuple):
    """A layer in k states: points ``(k, np, 3)``, data ``(k, np, ...)`` and ``(k, nc, ...)``."""

    points: Floats
    cells: Cells
    at_points: Fields
    at_cells: Fields


class Layer(ABC):
    """One series of files: turns states into grids with data.

    Attributes
    ----------
    name : str
        Name of the series of files.
    series : list of str
        What it reads of a state, as far as there, besides ``q``.
    wanted : list of str
        Those of them without which it has gaps.
    level : int
        How much its data are compressed, 0 to 9.
    """

    name: str
    series: list[str]
    wanted: Sequence[str] = ()
    level = 0

    @abstractmethod
    def grid(self, states: States, reference: Floats) -> Grid | None:
        """Grid of some states, None if they have nothing for this layer.

        Parameters
        ----------
        states : mapping of str to (k, ...) array
            ``q`` and what else was recorded, in k states.
        reference : (n,)
            Coordinates from which displacements ``u`` are counted.

        Raises
        ------
        InputError
            If an entry that the layer needs has a wrong shape.
        """


def entry(states: States, name: str, shape: tuple[int, ...]) -> Floats:
    """Entry ``name`` of all states ``(k, *shape)``, with the shape checked (-1: any)."""
    value = np.asarray(states[name], float)
    own = value.shape[1:]
    if len(own) != len(shape) or any(a not in (b, -1) for a, b in zip(shape, own, strict=True)):
        raise InputError(f"row entry {name!r}", f"got shape {own}, expected {shape}")
    return value


def _stack(parts: list[Fields], sizes: list[int]) -> Fields:
    """Join the fields of items of some sizes; a field that an item lacks is NaN there."""
    joined = {}
    for name in dict.fromkeys(name for part in parts for name in part):
        count, _, *rest = next(part[name] for part in parts if name in part).shape
        pieces = [
            part[name] if name in part else np.full((count, size, *rest), np.nan)
            for part, size in zip(parts, sizes, strict=True)
        ]
        joined[name] = pieces[0] if len(pieces) == 1 else np.concatenate(pieces, 1)
    return joined


def _gauss_fields(shape: BeamShape, states: States) -> Fields:
    """Strains and resultants averaged over the cells of the elements, as far as recorded."""
    fields: Fields = {}
    size = (len(shape.connectivity), len(shape.gauss), 6)
    for kind, names in _PAIRS.items():
        key = f"beam/{shape.name}/{kind}"
        pieces = shape.cell_pieces
        if key not in states:
            continue
        values = entry(states, key, size).reshape(-1, *size[:2], 2, 3)  # two vectors
        fields |= zip(names, np.moveaxis(shape.average(values, pieces), -2, 0), strict=True)
        if kind == "resultant":
            space = shape.average(shape.to_space(states["q"], values), pieces)
            fields |= zip("nm", np.moveaxis(space, -2, 0), strict=True)
    return fields


def _beam_series(shapes: list[BeamShape], *kinds: str) -> list[str]:
    return [f"beam/{shape.name}/{kind}" for shape in shapes for kind in kinds]


def _labels(meta: Mapping[str, Any], shapes: list[BeamShape], elements: list[IndexArray]) -> Fields:
    """Numbers and names of beam, part and section of cells, whose elements are given."""
    found: dict[str, list[Array]] = {}
    for number, (about, shape, own) in enumerate(zip(meta["beams"], shapes, elements, strict=True)):
        for kind, numbers, names in (
            ("beam", np.full(len(own), number), [each.name for each in shapes]),
            ("part", shape.part[own], about.get("parts", ())),
            ("section", shape.section[own], about.get("sections", ())),
        ):
            texts = np.array([*names, *[""] * (numbers.max(initial=0) + 2)])  # -1: none
            found.setdefault(f"{kind}_id", []).append(numbers)
            found.setdefault(kind, []).append(texts[numbers])
    return {name: np.concatenate(parts) for name, parts in found.items()}


def _at_ends(shape: BeamShape, states: States, kind: str) -> Floats | None:
    """Forces or strains (k, ne, 2, 6) at the ends of a beam's elements, if there are some."""
    key = f"beam/{shape.name}/nodal_{kind}"
    return entry(states, key, (len(shape.ends), 2, 6)) if key in states else None


class BeamLayer(Layer):
    """Beams as lines with numbers at points and cells."""

    name = "beams"

    def __init__(self, meta: Mapping[str, Any], static: Mapping[str, Array]):
        self._shapes = shapes = beam_shapes(meta, static)
        self.wanted = ["v", *_beam_series(shapes, "resultant", "nodal_resultant")]
        self.series = [*self.wanted, *_beam_series(shapes, "strain", "nodal_strain")]
        self._sizes = [len(shape.origin) for shape in shapes]
        blocks = [
            (
                _VTK["quadratic line" if shape.order == 2 else "line"],
                start + shape.cells,
            )
            for start, shape in zip(np.cumsum([0, *self._sizes[:-1]]), shapes, strict=True)
        ]
        at_points = {"node_id": np.concatenate([shape.node_id[shape.origin] for shape in shapes])}
        radii = [static.get(f"beam/{shape.name}/radius") for shape in shapes]
        known = [radius for radius in radii if radius is not None]
        if len(known) == len(radii):
            both = zip(shapes, known, strict=True)
            ends = [s.spread(r[None, :, :, None]).ravel() for s, r in both]
            at_points["radius"] = np.concatenate(ends)
        at_cells = _labels(meta, shapes, [shape.cell_element for shape in shapes])
        drawn = [
            [bool(shape.skin(k)) for k in shape.section[shape.cell_element]] for shape in shapes
        ]
        at_cells["outlined"] = np.concatenate(drawn) + 0
        self._cells = Cells(blocks, at_points, at_cells)

    def grid(self, states: States, reference: Floats) -> Grid:
        """Grid of some states, see `Layer.grid`."""
        points = [self._point_fields(shape, states, reference) for shape in self._shapes]
        at_points = _stack(points, self._sizes)
        cells = [len(shape.cells) for shape in self._shapes]
        at_cells = _stack([_gauss_fields(shape, states) for shape in self._shapes], cells)
        return Grid(at_points.pop("x"), self._cells, at_points, at_cells)

    @staticmethod
    def _point_fields(shape: BeamShape, states: States, reference: Floats) -> Fields:
        x = shape.points(states["q"])
        d = shape.directors(states["q"])
        fields = {"x": x, "u": x - shape.points(reference)}
        if "v" in states:
            fields["v"] = shape.points(states["v"])
        for i in range(3):
            fields[f"d{i + 1}"] = d[..., i, :]
        fields["q_wxyz"] = quaternions(d)
        fields = {name: values[:, shape.origin] for name, values in fields.items()}
        for kind, names in _PAIRS.items():
            six = _at_ends(shape, states, kind)
            if six is not None:
                fields |= zip(names, np.split(shape.spread(six), 2, axis=-1), strict=True)
        return fields


class SurfaceLayer(Layer):
    """Beams as swept sections with their stresses, for those sections that have an outline."""

    name = "beam_surfaces"
    level = 1

    def __init__(self, meta: Mapping[str, Any], static: Mapping[str, Array]):
        self._shapes = beam_shapes(meta, static)
        self._surfaces = [shape.surface() for shape in self._shapes]
        self.series = _beam_series(self._shapes, "nodal_resultant")
        if not any(surface.size for surface in self._surfaces):
            raise InputError("argument surfaces", "no section of the history has an outline")
        start, self._kept, blocks, elements = 0, [], [], []
        for surface in self._surfaces:
            kept, number = surface.shared()
            self._kept.append(kept)
            blocks += [(_VTK["quad"], start + number[surface.quads])]
            blocks += [(_VTK["polygon"], start + number[cap[None]]) for cap in surface.caps]
            elements.append(np.concatenate([surface.element, surface.cap_element]))
            start += len(kept)
        self._cells = Cells(blocks, at_cells=_labels(meta, self._shapes, elements))

    def grid(self, states: States, reference: Floats) -> Grid:
        """Grid of some states, see `Layer.grid`."""
        parts = []
        for shape, surface, kept in zip(self._shapes, self._surfaces, self._kept, strict=True):
            x = surface.points(states["q"])[:, kept]
            fields = {"x": x, "u": x - surface.points(reference)[kept]}
            values = _at_ends(shape, states, "resultant")
            if values is not None:
                six = shape.linear @ values
                found = [self._stresses(shape, own, each, six) for own, each in surface.swept]
                every = _stack(found, [0] * len(found))
                fields |= {name: each[:, kept] for name, each in every.items()}
            exact = "sigma", "tau"  # the others are for pictures
            parts.append({k: f if k in exact else f.astype(np.float32) for k, f in fields.items()})
        joined = _stack(parts, [len(kept) for kept in self._kept])
        return Grid(joined.pop("x"), self._cells, joined, {})

    @staticmethod
    def _stresses(shape: BeamShape, own: IndexArray, skin: Floats, six: Floats) -> Fields:
        """Fields (k, points, ...) of elements by forces (k, ne, p + 1, 6) of all; NaN: unknown."""
        forces = six[:, own]
        count = skin.shape[-2]
        operator = shape.stress(int(shape.section[own[0]]))
        if operator is None:
            operator = np.full((count, 3, 6), np.nan)
        flat = operator.reshape(*operator.shape[:-3], -1, 6)
        stress = (flat @ forces[..., None]).reshape(len(six), -1, 3)
        sigma = stress[..., 0]
        tau = np.linalg.norm(stress[..., 1:], axis=-1)
        fields = {"sigma": sigma, "tau": tau, "mises": np.sqrt(sigma**2 + 3 * tau**2)}
        rings = forces.reshape(len(six), -1, 6).repeat(count, 1)
        return fields | {"N": rings[..., :3], "M": rings[..., 3:]}


class BodyLayer(Layer):
    """Rigid bodies as closed surfaces (or points) and mass points."""

    name = "bodies"

    def __init__(self, meta: Mapping[str, Any], static: Mapping[str, Array]):
        self._shapes = list(body_shapes(meta, static))
        self.series = self.wanted = ["v"]
        sizes = [1 if shape.material is None else len(shape.material) for shape in self._shapes]
        self._owner = np.arange(len(sizes)).repeat(sizes)
        blocks = [
            (_VTK["vertex"], np.array([[start]]))
            if shape.material is None
            else (_VTK["triangle"], start + shape.faces)
            for start, shape in zip(np.cumsum([0, *sizes[:-1]]), self._shapes, strict=True)
        ]
        ids = np.arange(len(blocks)).repeat([len(block) for _, block in blocks])
        names = np.array([shape.name for shape in self._shapes])[ids]
        self._cells = Cells(blocks, at_cells={"body_id": ids, "name": names})

    def grid(self, states: States, reference: Floats) -> Grid:
        """Grid of some states, see `Layer.grid`."""
        x = self._points(states["q"])
        fields = {"u": x - self._points(reference)}
        if "v" in states:
            fields["v"] = self._points(states["v"])
        turned = quaternions(np.stack([s.directors(states["q"]) for s in self._shapes], 1))
        fields["q_wxyz"] = turned[:, self._owner]
        return Grid(x, self._cells, fields, {})

    def _points(self, q: Floats) -> Floats:
        return np.concatenate([shape.points(q) for shape in self._shapes], -2)


class ItemLayer(Layer):
    """Items where their places are recorded: joints and loads as points, couplings as lines.

    Parameters
    ----------
    name : str
        Of the layer, and of its list in `meta`.
    kind : str
        The first part of the names of their series.
    meta : mapping
    places : str
        The series without which an item is left out: its places.
    shape : tuple of int
        Of the places in a state, or of both ends of lines; -1: of any number.
    vectors, scalars : sequence of str
        Further series: of the shape of the places, and of one number in a state.
    """

    def __init__(
        self,
        name: str,
        kind: str,
        meta: Mapping[str, Any],
        places: str,
        shape: tuple[int, ...],
        vectors: Sequence[str],
        scalars: Sequence[str] = (),
    ):
        self.name, self._places, self._shape = name, places, shape
        self._fields: dict[str, tuple[int, ...]] = {
            **dict.fromkeys(vectors, shape),
            **dict.fromkeys(scalars, ()),
        }
        self._last: dict[str, Floats] = {}
        # in older files of paths this names factors of loads
        items = meta[name] if isinstance(meta.get(name), list) else []
        self._items = [f"{kind}/{item['name']}/" for item in items]
        kinds = [str(item["type"]) for item in items]
        numbers = np.unique(kinds, return_inverse=True)[1]
        ids = np.arange(len(kinds))
        self._numbers = {f"{kind}_id": ids, "type": numbers, "kind": np.array(kinds)}
        self._numbers["name"] = np.array([str(item["name"]) for item in items])
        if name != "loads":  # not all act at places
            self.wanted = [item + places for item in self._items]
        self.series = [item + each for item in self._items for each in (places, *self._fields)]

    def grid(self, states: States, reference: Floats) -> Grid | None:
        """Grid of some states, see `Layer.grid`."""
        known, parts, counts, width = [], [], [], 2 if self._places == "ends" else 1
        for k, item in enumerate(self._items):
            if item + self._places not in states:
                continue
            x = entry(states, item + self._places, self._shape)
            x = self._held(item, x.reshape(len(x), -1, width, 3))
            known.append(k)
            counts.append(x.shape[1])
            fields = {"x": x}
            for name, shape in self._fields.items():
                key = item + name
                if key in states and (shape or states[key].ndim == 1):
                    fields[name] = entry(states, key, shape).reshape(*x.shape[:2], *shape[-1:])
            parts.append(fields)
        if not sum(counts):
            return None
        cells = np.arange(width * sum(counts)).reshape(-1, width)
        own = {name: values[known].repeat(counts) for name, values in self._numbers.items()}
        joined = _stack(parts, counts)
        x = joined.pop("x").reshape(len(states["q"]), -1, 3)
        if width == 1:
            return Grid(x, Cells([(_VTK["vertex"], cells)], own), joined, {})
        return Grid(x, Cells([(_VTK["line"], cells)], None, own), {}, joined)

    def _held(self, item: str, x: Floats) -> Floats:
        """Places (k, ...) of an item, the last known one where it is released."""
        x = np.concatenate([self._last.get(item, x[:1]), x])
        known = np.isfinite(x).reshape(len(x), -1).all(1)
        x = x[np.maximum.accumulate(np.where(known, np.arange(len(x)), 0))]
        self._last[item] = x[-1:]
        return x[1:]


# -- a grid as files of VTK's XML format for unstructured grids (``.vtu``) -------------------------

_ORDER = "LittleEndian" if sys.byteorder == "little" else "BigEndian"
_HEADER = f'version="0.1" byte_order="{_ORDER}" compressor="vtkZLibDataCompressor"'
_UNIT = '<InformationKey name="UNITS_LABEL" location="vtkDataArray">{}</InformationKey>'
_UNITS = {
    **dict.fromkeys(("Points", "u", "radius", "displacement"), "m"),
    **dict.fromkeys(("N", "n", "force"), "N"),
    **dict.fromkeys(("M", "m", "moment"), "N m"),
    **dict.fromkeys(("sigma", "tau", "mises"), "N/m^2"),
    **{"v": "m/s", "K": "1/m", "angle": "rad"},
}
#: series of a state as a whole, by their units
_OF_THE_SCENE = {
    **dict.fromkeys(("kinetic", "strain_energy", "coupling_energy", "external", "energy"), "J"),
    **dict.fromkeys((*WORKS, "dissipated", BALANCE), "J"),
    **{"linear_momentum": "kg m/s", "angular_momentum": "kg m^2/s", "load_factor": "1"},
}


#: bytes of an array that are packed in less time than it takes to open a file
PACKED = 8192


def _array(name: str, values: Array, level: int) -> tuple[str, bytes]:
    """Attributes and unit of an array (n, ...) in a file, and its packed bytes."""
    if values.dtype.kind == "U":
        size = f' NumberOfTuples="{len(values)}"'
        kind = "String"
        data = "".join(f"{text}\0" for text in values.tolist()).encode()
    else:
        size = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
        kind = {"f": "Float", "i": "Int", "u": "UInt"}[values.dtype.kind]
        kind = f"{kind}{8 * values.itemsize}"
        data = values.tobytes()
    packed = zlib.compress(data, level or int(len(data) < PACKED))
    # one block, the last of whose numbers is that of bytes
    header = np.array([1, len(data), 0, len(packed)], np.uint32).tobytes()
    unit = _UNIT.format(_UNITS[name]) if name in _UNITS else ""
    tag = f'<DataArray type="{kind}" Name="{name}"{size} format="appended" offset="{{}}">{unit}'
    return f"{tag}</DataArray>\n", header + packed


def _text(grid: Grid, k: int, about: str, level: int) -> bytes:
    """Contents of the file of a layer in one of its states."""
    cells, at_points, at_cells = grid.cells.encoded
    changing = [
        [_array(name, values[k], level) for name, values in fields.items()]
        for fields in ({"Points": grid.points}, grid.at_points, grid.at_cells)
    ]
    groups = {
        "Points": changing[0],
        "Cells": cells,
        "PointData": at_points + changing[1],
        "CellData": at_cells + changing[2],
    }
    text = [
        f'<VTKFile type="UnstructuredGrid" {_HEADER}>\n<UnstructuredGrid>\n'
        f"<FieldData>\n{about}</FieldData>\n<Piece"
        f' NumberOfPoints="{grid.points.shape[1]}" NumberOfCells="{grid.cells.count}">\n'
    ]
    data = []
    offset = 0
    for group, arrays in groups.items():
        text.append(f"<{group}>\n")
        for tag, packed in arrays:
            text.append(tag.format(offset))
            data.append(packed)
            offset += len(packed)
        text.append(f"</{group}>\n")
    text.append('</Piece>\n</UnstructuredGrid>\n<AppendedData encoding="raw">_')
    return b"".join(["".join(text).encode(), *data, b"</AppendedData>\n</VTKFile>\n"])


def _field(name: str, unit: str, value: Array) -> str:
    """An array of a state as a whole."""
    own = np.ravel(value)
    size = 'NumberOfTuples="1"' + f' NumberOfComponents="{len(own)}"' * (len(own) > 1)
    text = " ".join(map(repr, own.tolist()))
    tag = f'<DataArray type="Float64" Name="{name}" {size} format="ascii">'
    return f"{tag}{text}{_UNIT.format(unit)}</DataArray>\n"


def _time_of(meta: Mapping[str, Any]) -> str:
    """What the times of a history are: of runs the unit, else the parameter they stand for."""
    if meta.get("integrator") == "static":
        return str(meta.get("parameter", "parameter of the path"))
    if meta.get("integrator") == "mode" and not any(meta.get("eigenvalue", ())):
        return "share of a cycle"
    return "s"


# -- paraView series: an index (``.pvd``) for each layer and one file (``.vtu``) for each frame ----

_HEAD = b'<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
#: numbers of the layers as blocks
_PARTS = "beams", "beam_surfaces", "bodies", "joints", "drives", "loads", "couplings"
_TAIL = b"  </Collection>\n</VTKFile>\n"


def _write_at(handle: BinaryIO, offset: int, data: bytes) -> None:
    """Write all of it at an offset: a full disk takes a part and says no more than how much."""
    handle.seek(offset)
    view = memoryview(data)
    while view:
        view = view[handle.write(view) :]


class _Index:
    """A ``.pvd`` file that is complete after each frame: the closing tags are overwritten."""

    def __init__(self, path: Path):
        self.path = path
        self._end = 0

    def add(self, time: float, files: Sequence[Path]) -> None:
        """Append files of a time, as blocks; the first ones make the index."""
        if not self._end:
            self.path.write_bytes(_HEAD + _TAIL)
            self._end = len(_HEAD)
        line = "".join(
            f'    <DataSet timestep="{float(time)!r}" part="{_PARTS.index(path.parent.name)}"'
            f' name="{path.parent.name}" file="{path.parent.name}/{path.name}"/>\n'
            for path in files
        ).encode()
        with self.path.open("r+b", buffering=0) as handle:
            try:
                _write_at(handle, self._end, line + _TAIL)
            except OSError:  # a full disk: there was room for this
                _write_at(handle, self._end, _TAIL)
                handle.truncate()
                raise
        self._end += len(line)


@checked
def prepare_folder(folder: Path) -> None:
    """Make the folder and try to write into it: to be called before long work.

    Parameters
    ----------
    folder : pathlib.Path
        Made with its parents if there is none; what is in it stays.

    Raises
    ------
    InputError
        If it cannot be made or written; the message names the folder.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as parent:
    ...     prepare_folder(Path(parent) / "runs" / "swing")
    ...     (Path(parent) / "runs" / "swing").is_dir()
    True
    """
    with writing(folder, "folder"):
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".probe.{os.getpid()}.tmp"
        probe.touch()
        probe.unlink()


@checked
class ParaViewWriter:
    """Write frames one by one, also while a simulation runs.

    For each layer of the scene there is an index: ``beams.pvd``, ``bodies.pvd`` (rigid bodies and
    mass points), ``joints.pvd``, ``drives.pvd``, ``loads.pvd``, ``couplings.pvd`` (springs, cables,
    bushings as lines) and, on request, ``beam_surfaces.pvd``. ``scene.pvd`` has them all as blocks
    with these names. An index is complete after each frame, so a run that was killed can be looked
    at; there is none for a layer that has nothing. ``paraview.py`` shows them, see
    `write_paraview`.

    **The points are written where they are (deformed).** ``u`` is for colours: the filter *Warp By
    Vector* with ``u`` would show the motion twice.

    Arrays have their units as metadata, and items their names as arrays of strings: ``beam, part,
    section`` of the cells of beams, ``name`` (and ``kind``) of all others, with
    numbers beside them for filters that take no text.

    Beams have at points ``u, v`` (m, m/s), section directors ``d1, d2, d3`` in space (at a node
    where several sections meet the triad of the node), the quaternion ``q_wxyz`` from the section's
    frame to space, ``node_id`` (-1 between nodes), ``radius`` (m) for tubes; the resultants ``N,
    M`` (N, N m) and strains ``Gamma, K`` (-, 1/m) in the section's frame, those of the series
    ``nodal_resultant`` and ``nodal_strain`` at the ends of elements, linear between. Points are
    doubled where these may jump: where a joint, load, body or coupling acts, where sections or
    their triads differ, and where more than two elements meet; elements share all others. At cells
    they have ``N, M, Gamma, K``, and ``n, m`` in space, averaged over the Gauss points of the cell.
    Elements of order 1 are 2-node lines, of order 2 quadratic lines; those of higher order are cut
    into ``order`` equal 2-node lines.

    Surfaces have at points the stresses ``sigma`` (axial, tension positive), ``tau`` (shear) and
    ``mises`` (N/m^2) by the forces at the ends of elements, linear between, of sections that know
    them (:meth:`skfem_cosserat.Section.skin_stresses`), else NaN; ``mises, u, N, M`` and the points
    themselves are in single precision.

    ``beams`` (without beams ``bodies``) have the energies and momenta of each state as field data.

    Parameters
    ----------
    folder : path-like
        Created if needed. Files of an earlier export are overwritten.
    meta, static : mapping
        As in `skfem_cosserat.History`.
    reference : (n,), optional
        Coordinates from which ``u`` is counted. Default: the static array ``reference`` if there is
        one, otherwise the first state that is written.
    surfaces : bool
        Write the swept section surfaces too.

    Raises
    ------
    InputError
        If the folder cannot be written or a static array is missing.
    StorageError
        If the disk is full.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> meta, static = {"points": [{"name": "tip"}]}, {"point/tip/offset": np.array(0)}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     writer = ParaViewWriter(folder, meta, static)
    ...     files = writer.write(0.0, {"q": np.zeros(3)})
    ...     [path.name for path in writer.indices]
    ['bodies.pvd', 'scene.pvd']
    """

    def __init__(
        self,
        folder: FilePath,
        meta: Mapping[str, Any],
        static: Mapping[str, Array],
        *,
        reference: ArrayLike | None = None,
        surfaces: bool = False,
    ):
        self.folder = Path(folder)
        self._reference = static.get("reference") if reference is None else np.asarray(reference)
        self._layers = _layers(meta, static, switch("argument surfaces", surfaces))
        self._time = _time_of(meta)
        read = ["q", *_OF_THE_SCENE, *(name for layer in self._layers for name in layer.series)]
        self._names = list(dict.fromkeys(read))
        prepare_folder(self.folder)
        self._indices = [
            _Index(self.folder / f"{name}.pvd")
            for name in (*(layer.name for layer in self._layers), "scene")
        ]
        self._frame = 0
        with writing(self.folder, "folder"):
            for index in self._indices:
                index.path.unlink(missing_ok=True)
                for frame in index.path.with_suffix("").glob("[0-9]" * 6 + ".vtu"):
                    frame.unlink()  # of a longer earlier export: the index would not name it
            script = SCRIPT.replace("UNIT", repr(self._time))
            (self.folder / "paraview.py").write_text(script, encoding="utf-8")

    @property
    def indices(self) -> list[Path]:
        """The index files so far, to be opened in ParaView: of each layer, then of the scene."""
        return [index.path for index in self._indices if index.path.exists()]

    def write(self, time: float, row: Mapping[str, ArrayLike]) -> list[Path]:
        """Write one frame.

        Parameters
        ----------
        time : float
            In s; of a path of equilibria its parameter.
        row : mapping of str to array
            ``q (n,)`` and, as far as known, ``v``, ``beam/{name}/strain``,
            ``beam/{name}/resultant`` and those with ``nodal_`` in front,
            ``joint/{name}/position`` (joints without it are left out), ``joint/{name}/force`` and
            ``joint/{name}/moment``, for loads likewise; energies and momenta.

        Returns
        -------
        list of Path
            The ``.vtu`` files of this frame.

        Raises
        ------
        InputError
            If an entry of the row is missing or has a wrong shape.
        StorageError
            If the disk is full; the frames before are sound.
        """
        states = {name: np.asarray(row[name])[None] for name in self._names if name in row}
        return self._write([time], states)

    def write_states(self, history: History, chosen: Sequence[int]) -> None:
        """Write the states of these numbers of a history.

        Parameters
        ----------
        history : History
        chosen : sequence of int

        Raises
        ------
        InputError, StorageError
            As `write`.
        """
        wanted = [name for layer in self._layers for name in layer.wanted]
        missing = [name for name in dict.fromkeys(wanted) if name not in history]
        if missing:
            text = f"files lack what is not recorded ({', '.join(missing[:3])} ...); {ADVICE}"
            warn("history", text, IncompleteWarning)
        names = [name for name in self._names if name in history]
        part = history if len(chosen) == len(history) else history.states(chosen)
        part.derive(names)  # what cannot be had is told, and left out
        series = {name: part[name] for name in names if name in part.recorded}
        size = max(1, TOGETHER // max(1, series["q"].shape[1]))  # states that are written at once
        for start in range(0, len(chosen), size):
            states = {name: values[start : start + size] for name, values in series.items()}
            self._write(part.times[start : start + size].tolist(), states)

    def _write(self, times: Sequence[float], states: States) -> list[Path]:
        """Write a frame for each of some states ``(k, ...)``; gives the files of the last one."""
        if "q" not in states:
            raise InputError("row entry 'q'", "is missing; the export needs it")
        if self._reference is None:
            self._reference = states["q"][0]
        grids = [layer.grid(states, self._reference) for layer in self._layers]
        written: list[Path] = []
        for k, time in enumerate(times):
            about = _field("TimeValue", self._time, np.array(time))
            written = []
            whole = [
                _field(n, unit, states[n][k]) for n, unit in _OF_THE_SCENE.items() if n in states
            ]
            for layer, index, grid in zip(self._layers, self._indices, grids, strict=False):
                if grid is None:
                    continue
                path = index.path.with_suffix("") / f"{self._frame:06d}.vtu"
                with writing(path):
                    path.parent.mkdir(exist_ok=True)
                    path.write_bytes(_text(grid, k, "".join([about, *whole]), layer.level))
                with writing(index.path):
                    index.add(time, [path])
                whole = []
                written.append(path)
            with writing(self._indices[-1].path):
                self._indices[-1].add(time, written)
            self._frame += 1
        return written


def _layers(meta: Mapping[str, Any], static: Mapping[str, Array], surfaces: bool) -> list[Layer]:
    """Layers that have something to show."""
    layers: list[Layer] = []
    if meta.get("beams"):
        layers.append(BeamLayer(meta, static))
        if surfaces:
            layers[0].level = SurfaceLayer.level
            layers.append(SurfaceLayer(meta, static))
    if meta.get("bodies") or meta.get("points"):
        layers.append(BodyLayer(meta, static))
    wrench = "force", "moment"
    items = (
        ItemLayer("joints", "joint", meta, "position", (3,), wrench, ("angle", "displacement")),
        ItemLayer("drives", "joint", meta, "position", (3,), wrench),
        ItemLayer("loads", "load", meta, "position", (-1, 3), wrench),
        ItemLayer("couplings", "coupling", meta, "ends", (2, 3), (), ("coordinate", "force")),
    )
    return [*layers, *(layer for layer in items if layer.series)]


def _selection(times: Floats, every: int, fps: float | None) -> list[int]:
    """Numbers of the states to be written."""
    whole("argument every", every, 1)
    if fps is None:
        return list(range(0, len(times), every))
    if every != 1:
        raise InputError("arguments every, fps", f"got {every} and {fps}, expected only one")
    if not fps > 0.0:
        raise InputError("argument fps", f"got {fps}, expected a positive number of frames per s")
    if not len(times):
        return []
    count = np.floor((times[-1] - times[0]) * fps * (1.0 + 1e-12)) + 1
    wanted = times[0] + np.arange(count) / fps
    return [*np.unique(np.searchsorted((times[1:] + times[:-1]) / 2, wanted))]


@checked
def write_paraview(
    history: History,
    folder: FilePath,
    every: int = 1,
    fps: float | None = None,
    surfaces: bool = False,
) -> list[Path]:
    """Write a history as ParaView series; see `ParaViewWriter` for what is in the files.

    ``paraview.py`` in the folder shows them: *File > Load State* or *Tools > Python Shell > Run
    Script* in ParaView, or ``pvpython paraview.py picture.png``.

    Parameters
    ----------
    history : History
        Recorded states: of a run, a path of equilibria (its times are the parameter of the path),
        or ``modes.animation(k)``.
    folder : path-like
        Created if needed.
    every : int
        Write each ``every``-th state.
    fps : float, optional
        Write so many frames per second of simulated time instead (the states closest in time, with
        their own times).
    surfaces : bool
        Write the swept section surfaces too.

    Returns
    -------
    list of Path
        The index files, to be opened in ParaView: one for each layer that has something, and
        ``scene.pvd`` with all of them.

    Raises
    ------
    InputError
        If the folder cannot be written or an argument is out of range.
    StorageError
        If the disk is full; the frames before are sound.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> q = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    >>> series = {"t": [0.0, 0.1], "step": [0, 1], "q": q, "p": q, "v": q}
    >>> meta, static = {"points": [{"name": "tip"}]}, {"point/tip/offset": np.array(0)}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in write_paraview(History(meta, static, series), folder)]
    ['bodies.pvd', 'scene.pvd']
    """
    chosen = _selection(history.times, every, fps)
    writer = ParaViewWriter(folder, history.meta, history.static, surfaces=surfaces)
    if chosen:
        writer.write_states(history, chosen)
    logger.info("%d frames written to %s", len(chosen), folder)
    return writer.indices
