"""Files for ParaView: layers of points, cells and data at each state."""

from __future__ import annotations

import json
import os
import sys
import zlib
from abc import ABC, abstractmethod
from binascii import b2a_base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from ..arguments import checked
from ..errors import IncompleteWarning, InputError, writing
from ..history import History
from ..model.quadratic import TOGETHER
from ..types import Array, ArrayLike, FilePath, Floats, IndexArray, switch, whole
from ..warn import logger, warn
from .geometry import BeamShape, beam_shapes, body_shapes, quaternions

# -- the layers of a scene as grids with data: beams, swept surfaces, bodies, joints, springs ------

#: Names of the six numbers of a strain or resultant series.
_STRAIN = ("Gamma", "K")
_RESULTANT = ("N", "M")

#: VTK's numbers of the kinds of cells
_VTK = {"vertex": 1, "line": 3, "triangle": 5, "quad": 9, "quadratic line": 21}

States = Mapping[str, Array]
Fields = dict[str, Array]


class Cells:
    """Cells of a layer and the data that they and their points have in all states.

    Parameters
    ----------
    blocks : sequence of (int, (m, k) array)
        VTK's number of a kind of cells, and the points of each cell.
    at_points, at_cells : mapping of str to array
        Data that never changes.
    """

    def __init__(
        self,
        blocks: Sequence[tuple[int, IndexArray]],
        at_points: Fields | None = None,
        at_cells: Fields | None = None,
    ) -> None:
        widths = [np.full(len(block), block.shape[1]) for _, block in blocks]
        kinds = [np.full(len(block), kind) for kind, block in blocks]
        self.count = sum(map(len, widths))
        self.topology = {
            "connectivity": np.concatenate([block.ravel() for _, block in blocks]),
            "offsets": np.cumsum(np.concatenate(widths)),
            "types": np.concatenate(kinds),
        }
        self.at_points, self.at_cells = at_points or {}, at_cells or {}
        #: texts of these three, made for the first file
        self.encoded: list[bytes] = []


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
    """

    name: str
    series: list[str]

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
    """Entry ``name`` of all states ``(k, *shape)``, with the shape checked."""
    value = np.asarray(states[name], dtype=float)
    if value.shape[1:] != shape:
        raise InputError(f"row entry {name!r}", f"got shape {value.shape[1:]}, expected {shape}")
    return value


def _stack(parts: list[Fields], sizes: list[int]) -> Fields:
    """Join the fields of items of some sizes; a field that an item lacks is NaN there."""
    joined = {}
    for name in dict.fromkeys(name for part in parts for name in part):
        model = next(part[name] for part in parts if name in part)
        count, _, *rest = model.shape
        pieces = [
            part[name] if name in part else np.full((count, size, *rest), np.nan)
            for part, size in zip(parts, sizes, strict=True)
        ]
        joined[name] = pieces[0] if len(pieces) == 1 else np.concatenate(pieces, axis=1)
    return joined


def _several(
    states: States, items: Sequence[str], field: str, shape: tuple[int, ...]
) -> Floats | None:
    """A field of items ``(k, items, *shape)``, NaN where one has none, or no number; None: all."""
    known = [
        k
        for k, item in enumerate(items)
        if item + field in states and (shape or states[item + field].ndim == 1)
    ]
    if not known:
        return None
    found = np.full((len(states["q"]), len(items), *shape), np.nan)
    for k in known:
        found[:, k] = entry(states, items[k] + field, shape)
    return found


def _gauss_fields(shape: BeamShape, states: States, pieces: int) -> Fields:
    """Strains and resultants averaged over the pieces of the elements, as far as recorded."""
    fields: Fields = {}
    size = (len(shape.connectivity), len(shape.gauss), 6)
    count = (len(states["q"]), *size[:2], 2, 3)  # a force and a moment, or two kinds of strains
    key = f"beam/{shape.name}/resultant"
    if key in states:
        values = entry(states, key, size).reshape(count)
        space = shape.to_space(states["q"], values)
        fields |= zip(_RESULTANT, _pair(shape.average(values, pieces)), strict=True)
        fields |= zip("nm", _pair(shape.average(space, pieces)), strict=True)
    key = f"beam/{shape.name}/strain"
    if key in states:
        values = entry(states, key, size).reshape(count)
        fields |= zip(_STRAIN, _pair(shape.average(values, pieces)), strict=True)
    return fields


def _pair(values: Floats) -> tuple[Floats, Floats]:
    return values[..., 0, :], values[..., 1, :]


def _beam_series(shapes: list[BeamShape]) -> list[str]:
    return [f"beam/{shape.name}/{kind}" for shape in shapes for kind in ("resultant", "strain")]


def _labels(shapes: list[BeamShape], elements: list[IndexArray]) -> Fields:
    """Numbers of beam, part and section of cells, whose elements are given."""
    numbers = [np.full(len(element), number) for number, element in enumerate(elements)]
    pairs = list(zip(shapes, elements, strict=True))
    return {
        "beam_id": np.concatenate(numbers),
        "part_id": np.concatenate([shape.part[element] for shape, element in pairs]),
        "section_id": np.concatenate([shape.section[element] for shape, element in pairs]),
    }


class BeamLayer(Layer):
    """Beams as lines with numbers at points and cells."""

    name = "beams"

    def __init__(self, meta: Mapping[str, Any], static: Mapping[str, Array]) -> None:
        self._shapes = beam_shapes(meta, static)
        self.series = ["v", *_beam_series(self._shapes)]
        self._sizes = [len(shape.node_id) for shape in self._shapes]
        starts = np.cumsum([0, *self._sizes[:-1]])
        blocks = [
            (_VTK["quadratic line" if shape.order == 2 else "line"], start + shape.cells)
            for start, shape in zip(starts, self._shapes, strict=True)
        ]
        ids = np.concatenate([shape.node_id for shape in self._shapes])
        labels = _labels(self._shapes, [shape.cell_element for shape in self._shapes])
        self._cells = Cells(blocks, {"node_id": ids}, labels)

    def grid(self, states: States, reference: Floats) -> Grid:
        """Grid of some states, see `Layer.grid`."""
        points = [self._point_fields(shape, states, reference) for shape in self._shapes]
        fields = [_gauss_fields(shape, states, shape.cell_pieces) for shape in self._shapes]
        at_points = _stack(points, self._sizes)
        at_cells = _stack(fields, [len(shape.cells) for shape in self._shapes])
        return Grid(at_points.pop("x"), self._cells, at_points, at_cells)

    @staticmethod
    def _point_fields(shape: BeamShape, states: States, reference: Floats) -> Fields:
        x, d = shape.points(states["q"]), shape.directors(states["q"])
        fields = {"x": x, "u": x - shape.points(reference)}
        if "v" in states:
            fields["v"] = shape.points(states["v"])
        for i in range(3):
            fields[f"d{i + 1}"] = d[..., i, :]
        fields["q_wxyz"] = quaternions(d)
        return fields


class SurfaceLayer(Layer):
    """Beams as swept sections, for those sections that have an outline."""

    name = "beam_surfaces"

    def __init__(self, meta: Mapping[str, Any], static: Mapping[str, Array]) -> None:
        self._shapes = beam_shapes(meta, static)
        self._surfaces = [shape.surface() for shape in self._shapes]
        self.series = _beam_series(self._shapes)
        self._sizes = [surface.size for surface in self._surfaces]
        if not any(self._sizes):
            raise InputError("argument surfaces", "no section of the history has an outline")
        starts = np.cumsum([0, *self._sizes[:-1]])
        quads = [
            start + surface.quads for start, surface in zip(starts, self._surfaces, strict=True)
        ]
        labels = _labels(self._shapes, [surface.element for surface in self._surfaces])
        self._cells = Cells([(_VTK["quad"], np.concatenate(quads))], at_cells=labels)

    def grid(self, states: States, reference: Floats) -> Grid:
        """Grid of some states, see `Layer.grid`."""
        at_points, at_cells = [], []
        for shape, surface in zip(self._shapes, self._surfaces, strict=True):
            x = surface.points(states["q"])
            at_points.append({"x": x, "u": x - surface.points(reference)})
            piece = surface.element * shape.pieces + surface.piece
            found = _gauss_fields(shape, states, shape.pieces)
            at_cells.append({name: values[:, piece] for name, values in found.items()})
        joined = _stack(at_points, self._sizes)
        fields = _stack(at_cells, [len(surface.quads) for surface in self._surfaces])
        return Grid(joined.pop("x"), self._cells, joined, fields)


class BodyLayer(Layer):
    """Rigid bodies as closed surfaces (or points) and mass points."""

    name = "bodies"

    def __init__(self, meta: Mapping[str, Any], static: Mapping[str, Array]) -> None:
        self._shapes = list(body_shapes(meta, static))
        self.series = ["v"]
        sizes = [1 if shape.material is None else len(shape.material) for shape in self._shapes]
        self._owner = np.repeat(np.arange(len(sizes)), sizes)
        blocks = [
            (_VTK["vertex"], np.array([[start]]))
            if shape.material is None
            else (_VTK["triangle"], start + shape.faces)
            for start, shape in zip(np.cumsum([0, *sizes[:-1]]), self._shapes, strict=True)
        ]
        ids = np.repeat(np.arange(len(blocks)), [len(block) for _, block in blocks])
        self._cells = Cells(blocks, at_cells={"body_id": ids})

    def grid(self, states: States, reference: Floats) -> Grid:
        """Grid of some states, see `Layer.grid`."""
        x = self._points(states["q"])
        fields = {"u": x - self._points(reference)}
        if "v" in states:
            fields["v"] = self._points(states["v"])
        turned = quaternions(np.stack([s.directors(states["q"]) for s in self._shapes], axis=1))
        fields["q_wxyz"] = turned[:, self._owner]
        return Grid(x, self._cells, fields, {})

    def _points(self, q: Floats) -> Floats:
        return np.concatenate([shape.points(q) for shape in self._shapes], axis=-2)


class ItemLayer(Layer):
    """Items where their places are recorded: joints as points, couplings as lines.

    Parameters
    ----------
    name, kind : str
        Of the layer in `meta`, and of its items: the first part of the names of their series.
    meta : mapping
    places : str
        The series without which an item is left out: its place, or both of its ends.
    shapes : mapping of str to tuple
        Of further series; those of no shape are read where they are numbers.
    numbers : mapping of str to array
        Of all items.
    """

    def __init__(
        self,
        name: str,
        kind: str,
        meta: Mapping[str, Any],
        places: str,
        shapes: Mapping[str, tuple[int, ...]],
        numbers: Fields,
    ) -> None:
        self.name, self._places, self._shapes, self._numbers = name, places, shapes, numbers
        self._items = [f"{kind}/{item['name']}/" for item in meta[name]]
        self.series = [item + each for item in self._items for each in (places, *shapes)]
        self._known: list[int] = []
        self._cells: Any = None

    def grid(self, states: States, reference: Floats) -> Grid | None:
        """Grid of some states, see `Layer.grid`."""
        known = [k for k, item in enumerate(self._items) if item + self._places in states]
        items = [self._items[k] for k in known]
        width = 2 if self._places == "ends" else 1
        x = _several(states, items, self._places, (2, 3)[2 - width :])
        if x is None:
            return None
        if known != self._known:
            cells = np.arange(width * len(known)).reshape(-1, width)
            own = {name: values[known] for name, values in self._numbers.items()}
            at = (own, None) if width == 1 else (None, own)
            kind = _VTK["vertex" if width == 1 else "line"]
            self._known, self._cells = known, Cells([(kind, cells)], *at)
        found = {name: _several(states, items, name, each) for name, each in self._shapes.items()}
        fields = {name: values for name, values in found.items() if values is not None}
        at_points, at_cells = (fields, {}) if width == 1 else ({}, fields)
        return Grid(x.reshape(len(x), -1, 3), self._cells, at_points, at_cells)


# -- a grid as files of VTK's XML format for unstructured grids (``.vtu``) -------------------------

_KINDS = {"f": "Float64", "i": "Int64"}
_ORDER = "LittleEndian" if sys.byteorder == "little" else "BigEndian"


def _texts(grid: Grid, compress: bool) -> list[bytes]:
    """Contents of the files of a layer, one a state; by zlib if they are to be compressed."""
    cells, count = grid.cells, len(grid.points)
    if not cells.encoded:
        for fields in (cells.topology, cells.at_points, cells.at_cells):
            once = _arrays({name: values[None] for name, values in fields.items()}, compress)
            cells.encoded.append(b"".join(text for texts in once for text in texts))
    topology, at_points, at_cells = cells.encoded
    packed = ' compressor="vtkZLibDataCompressor"' if compress else ""
    head = (
        f'<VTKFile type="UnstructuredGrid" version="0.1" byte_order="{_ORDER}"{packed}>\n'
        f'<UnstructuredGrid>\n<Piece NumberOfPoints="{grid.points.shape[1]}"'
        f' NumberOfCells="{cells.count}">\n<Points>\n'
    )
    parts = [
        [head.encode()],
        *_arrays({"Points": grid.points}, compress),
        [b"</Points>\n<Cells>\n"],
        [topology],
        [b"</Cells>\n<PointData>\n"],
        [at_points],
        *_arrays(grid.at_points, compress),
        [b"</PointData>\n<CellData>\n"],
        [at_cells],
        *_arrays(grid.at_cells, compress),
        [b"</CellData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n"],
    ]
    return [b"".join(part[min(k, len(part) - 1)] for part in parts) for k in range(count)]


def _arrays(fields: Fields, compress: bool) -> list[list[bytes]]:
    """Elements of data arrays ``(k, n, ...)``: for each field its text in all states."""
    found = []
    for name, values in fields.items():
        kind = _KINDS[values.dtype.kind]
        size = f' NumberOfComponents="{values.shape[2]}"' if values.ndim == 3 else ""
        head = f'<DataArray type="{kind}" Name="{name}"{size} format="binary">\n'.encode()
        data = np.ascontiguousarray(values, dtype=kind.lower())
        texts = (_encoded(one.tobytes(), compress) for one in data)
        found.append([b"".join((head, text, b"\n</DataArray>\n")) for text in texts])
    return found


def _encoded(data: bytes, compress: bool) -> bytes:
    """Behind its length; compressed in one block, the last of whose numbers is that of bytes."""
    if not compress:
        return b2a_base64(len(data).to_bytes(4, sys.byteorder) + data, newline=False)
    packed = zlib.compress(data)
    header = np.array([1, len(data), 0, len(packed)], dtype=np.uint32).tobytes()
    return b2a_base64(header, newline=False) + b2a_base64(packed, newline=False)


# -- paraView series: an index (``.pvd``) for each layer and one file (``.vtu``) for each frame ----

_HEAD = b'<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
_TAIL = b"  </Collection>\n</VTKFile>\n"


def _write_at(handle: BinaryIO, offset: int, data: bytes) -> None:
    """Write all of it at an offset: a full disk takes a part and says no more than how much."""
    handle.seek(offset)
    view = memoryview(data)
    while view:
        view = view[handle.write(view) :]


class _Index:
    """A ``.pvd`` file that is complete after each frame: the closing tags are overwritten."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._end = len(_HEAD)
        path.write_bytes(_HEAD + _TAIL)

    def add(self, times: Sequence[float], names: Sequence[str]) -> None:
        """Append frames; names are relative to the index."""
        line = "".join(
            f'    <DataSet timestep="{float(time)!r}" part="0" file="{name}"/>\n'
            for time, name in zip(times, names, strict=False)
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

    For each layer of the scene there is an index ``beams.pvd``, ``bodies.pvd`` (rigid bodies and
    mass points), ``joints.pvd``, ``couplings.pvd`` (springs, cables, bushings as lines) and, on
    request, ``beam_surfaces.pvd``; open these in ParaView. An index is complete after each frame,
    so a run that was killed can be looked at. Names that belong to the numbers ``beam_id``,
    ``part_id``, ``section_id``, ``body_id``, ``joint_id``, ``coupling_id`` and joint ``type`` are
    in ``names.json``.

    **The points are written where they are (deformed).** ``u`` is for colours: the filter *Warp By
    Vector* with ``u`` would show the motion twice.

    Beams have at points ``u, v`` (m, m/s), section directors ``d1, d2, d3`` in space (at a node
    where several sections meet the triad of the node), the quaternion ``q_wxyz`` from the section's
    frame to space, and ``node_id`` (-1 between nodes); at cells the resultants ``N, M`` in the
    section's frame and ``n, m`` in space (N, N m), the strains ``Gamma, K`` (-, 1/m), averaged over
    the Gauss points of the cell, and ``beam_id, part_id, section_id``. Elements of order 1 are
    2-node lines, of order 2 quadratic lines; those of higher order are cut into ``order`` equal
    2-node lines.

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
    compress : bool
        Compress with zlib: a quarter smaller, several times slower.

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
    ['bodies.pvd']
    """

    def __init__(
        self,
        folder: FilePath,
        meta: Mapping[str, Any],
        static: Mapping[str, Array],
        *,
        reference: ArrayLike | None = None,
        surfaces: bool = False,
        compress: bool = False,
    ) -> None:
        self.folder = Path(folder)
        compress = switch("argument compress", compress)
        if reference is None:
            reference = static.get("reference")
        self._reference: Floats | None = None
        if reference is not None:
            self._reference = np.array(reference, dtype=float)
        self._layers = _layers(meta, static, switch("argument surfaces", surfaces))
        read = ["q", *(name for layer in self._layers for name in layer.series)]
        self._names = list(dict.fromkeys(read))
        prepare_folder(self.folder)
        self._indices, self._compress = [], compress
        self._frame = 0
        names = json.dumps(_names(meta), indent=1)
        with writing(self.folder, "folder"):
            for layer in self._layers:
                (self.folder / layer.name).mkdir(exist_ok=True)
                for frame in (self.folder / layer.name).glob("[0-9]" * 6 + ".vtu"):
                    frame.unlink()  # of a longer earlier export: the index would not name it
                self._indices.append(_Index(self.folder / f"{layer.name}.pvd"))
            (self.folder / "names.json").write_text(names, encoding="utf-8")

    @property
    def indices(self) -> list[Path]:
        """The index files, to be opened in ParaView."""
        return [index.path for index in self._indices]

    def write(self, time: float, row: Mapping[str, ArrayLike]) -> list[Path]:
        """Write one frame.

        Parameters
        ----------
        time : float
            In s.
        row : mapping of str to array
            ``q (n,)`` and, as far as known, ``v``, ``beam/{name}/strain``,
            ``beam/{name}/resultant``, ``joint/{name}/position`` (joints without it are left out),
            ``joint/{name}/force`` and ``joint/{name}/moment``.

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
        (written,) = self._write([time], states)
        return written

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
        names = [name for name in self._names if name in history]
        history.derive(names)  # what cannot be had is told, and left out
        series = {name: history[name] for name in names if name in history.recorded}
        size = max(1, TOGETHER // max(1, series["q"].shape[1]))  # states that are written at once
        for start in range(0, len(chosen), size):
            part = np.array(chosen[start : start + size])
            states = {name: values[part] for name, values in series.items()}
            self._write(history.times[part].tolist(), states)

    def _write(self, times: Sequence[float], states: States) -> list[list[Path]]:
        """Write a frame for each of some states: of each series an array ``(k, ...)``."""
        if "q" not in states:
            raise InputError("row entry 'q'", "is missing; the export needs it")
        if self._reference is None:
            self._reference = np.array(states["q"][0], dtype=float)
        reference = self._reference
        written: list[list[Path]] = [[] for _ in times]
        grids = [layer.grid(states, reference) for layer in self._layers]
        for layer, index, grid in zip(self._layers, self._indices, grids, strict=True):
            if grid is None:
                if not self._frame:
                    reason = "nothing is recorded for this layer"
                    warn(f"layer {str(index.path)!r}", reason, IncompleteWarning)
                continue
            names: list[str] = []
            try:
                for k, text in enumerate(_texts(grid, self._compress)):
                    name = f"{layer.name}/{self._frame + k:06d}.vtu"
                    path = self.folder / name
                    with writing(path):
                        path.write_bytes(text)
                    names.append(name)
                    written[k].append(path)
            finally:  # also of those before one that found no room
                with writing(index.path):
                    index.add(times, names)
        self._frame += len(times)
        return written


def _layers(meta: Mapping[str, Any], static: Mapping[str, Array], surfaces: bool) -> list[Layer]:
    """Layers that have something to show."""
    layers: list[Layer] = []
    if meta.get("beams"):
        layers.append(BeamLayer(meta, static))
        if surfaces:
            layers.append(SurfaceLayer(meta, static))
    if meta.get("bodies") or meta.get("points"):
        layers.append(BodyLayer(meta, static))
    if joints := meta.get("joints"):
        types = _types(meta)
        numbers = {
            "joint_id": np.arange(len(joints)),
            "type": np.array([types.index(str(joint["type"])) for joint in joints]),
        }
        shapes = {"force": (3,), "moment": (3,), "angle": (), "displacement": ()}
        layers.append(ItemLayer("joints", "joint", meta, "position", shapes, numbers))
    if couplings := meta.get("couplings"):
        shapes = {"coordinate": (), "force": ()}
        numbers = {"coupling_id": np.arange(len(couplings))}
        layers.append(ItemLayer("couplings", "coupling", meta, "ends", shapes, numbers))
    return layers


def _types(meta: Mapping[str, Any]) -> list[str]:
    """Types of the joints, in the order of their numbers."""
    return sorted({str(joint["type"]) for joint in meta.get("joints", [])})


def _names(meta: Mapping[str, Any]) -> dict[str, Any]:
    """Names behind the numbers in the files."""
    beams = meta.get("beams", [])
    bodies = [*meta.get("bodies", []), *meta.get("points", [])]
    return {
        "beam_id": [beam["name"] for beam in beams],
        "part_id": {beam["name"]: list(beam.get("parts", [])) for beam in beams},
        "section_id": {beam["name"]: list(beam.get("sections", [])) for beam in beams},
        "body_id": [body["name"] for body in bodies],
        "joint_id": [joint["name"] for joint in meta.get("joints", [])],
        "coupling_id": [coupling["name"] for coupling in meta.get("couplings", [])],
        "type": _types(meta),
    }


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
    count = int(np.floor((times[-1] - times[0]) * fps * (1.0 + 1e-12))) + 1
    wanted = times[0] + np.arange(count) / fps
    nearest = np.searchsorted((times[1:] + times[:-1]) / 2, wanted)
    return [int(i) for i in np.unique(nearest)]


@checked
def write_paraview(
    history: History,
    folder: FilePath,
    every: int = 1,
    fps: float | None = None,
    surfaces: bool = False,
    compress: bool = False,
) -> list[Path]:
    """Write a history as ParaView series; see `ParaViewWriter` for what is in the files.

    Parameters
    ----------
    history : History
        Recorded states.
    folder : path-like
        Created if needed.
    every : int
        Write each ``every``-th state.
    fps : float, optional
        Write so many frames per second of simulated time instead (the states closest in time, with
        their own times).
    surfaces : bool
        Write the swept section surfaces too.
    compress : bool
        Compress the files.

    Returns
    -------
    list of Path
        The index files, to be opened in ParaView.

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
    >>> series = {"t": [0.0, 0.1], "step": [0, 1], "q": q, "p": q}
    >>> meta, static = {"points": [{"name": "tip"}]}, {"point/tip/offset": np.array(0)}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in write_paraview(History(meta, static, series), folder)]
    ['bodies.pvd']
    """
    chosen = _selection(history.times, every, fps)
    data = history.meta, history.static
    writer = ParaViewWriter(folder, *data, surfaces=surfaces, compress=compress)
    writer.write_states(history, chosen)
    logger.info("%d frames written to %s", len(chosen), folder)
    return writer.indices
