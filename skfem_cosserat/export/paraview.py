"""Files for ParaView: layers of points, cells and data at each state."""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from ..errors import IncompleteWarning, InputError
from ..history import History
from ..history.file import write_at
from ..types import Array, ArrayLike, Floats, check_kind, switch
from ..warn import logger, warn
from .geometry import BeamShape, beam_shapes, body_shapes, quaternions

# -- the layers of a scene as meshes with data: beams, swept surfaces, bodies, joints, springs -----

#: Relative coordinates that joints have as numbers at their points.
_COORDINATES = ("angle", "displacement")

#: Names of the six numbers of a strain or resultant series.
_STRAIN = ("Gamma", "K")
_RESULTANT = ("N", "M")

Row = Mapping[str, Array]
Fields = dict[str, Array]


class Layer(ABC):
    """One series of files: turns a state into a mesh with data.

    Attributes
    ----------
    name : str
        Name of the series.
    """

    name: str

    @abstractmethod
    def mesh(self, row: Row, reference: Floats) -> meshio.Mesh | None:
        """Mesh of one state, None if the state has nothing for this layer.

        Parameters
        ----------
        row : mapping of str to array
            One state: ``q`` and what else was recorded.
        reference : (n,)
            Coordinates from which displacements ``u`` are counted.

        Raises
        ------
        InputError
            If an entry that the layer needs is missing.
        """


def entry(row: Row, name: str, shape: tuple[int, ...]) -> Floats:
    """Entry ``name`` of a row with its shape checked."""
    if name not in row:
        raise InputError(f"row entry {name!r}", "is missing; the export needs it")
    value = np.asarray(row[name], dtype=float)
    if value.shape != shape:
        raise InputError(f"row entry {name!r}", f"got shape {value.shape}, expected {shape}")
    return value


def _stack(parts: list[Fields]) -> Fields:
    """Join the fields of several items; a field that an item lacks is NaN there."""
    names = list(dict.fromkeys(name for part in parts for name in part))
    sizes = [len(next(iter(part.values()))) for part in parts]
    joined = {}
    for name in names:
        model = next(part[name] for part in parts if name in part)
        pieces = [
            part[name] if name in part else np.full((size, *model.shape[1:]), np.nan)
            for part, size in zip(parts, sizes, strict=True)
        ]
        joined[name] = np.concatenate(pieces)
    return joined


def _gauss_fields(shape: BeamShape, row: Row, pieces: int) -> Fields:
    """Strains and resultants averaged over the pieces of the elements, as far as recorded."""
    fields: Fields = {}
    size = (len(shape.connectivity), len(shape.gauss), 6)
    key = f"beam/{shape.name}/resultant"
    if key in row:
        values = entry(row, key, size)
        for k, (name, lower) in enumerate(zip(_RESULTANT, "nm", strict=True)):
            part = values[:, :, 3 * k : 3 * k + 3]
            fields[name] = shape.average(part, pieces)
            fields[lower] = shape.average(shape.to_space(row["q"], part), pieces)
    key = f"beam/{shape.name}/strain"
    if key in row:
        values = entry(row, key, size)
        for k, name in enumerate(_STRAIN):
            fields[name] = shape.average(values[:, :, 3 * k : 3 * k + 3], pieces)
    return fields


def _labels(shape: BeamShape, number: int, element: Array) -> Fields:
    return {
        "beam_id": np.full(len(element), number, dtype=np.int64),
        "part_id": shape.part[element],
        "section_id": shape.section[element],
    }


class BeamLayer(Layer):
    """Beams as lines with numbers at points and cells."""

    name = "beams"

    def __init__(self, meta: Mapping[str, Any], static: Mapping[str, Array]) -> None:
        self._shapes = beam_shapes(meta, static)

    def mesh(self, row: Row, reference: Floats) -> meshio.Mesh:
        """Mesh of one state, see `Layer.mesh`."""
        at_points, at_cells, cells = [], [], []
        start = 0
        for number, shape in enumerate(self._shapes):
            fields = self._point_fields(shape, row, reference)
            at_points.append(fields)
            labels = _labels(shape, number, shape.cell_element)
            at_cells.append({**_gauss_fields(shape, row, shape.cell_pieces), **labels})
            cells.append(("line3" if shape.order == 2 else "line", start + shape.cells))
            start += len(fields["x"])
        point_data = _stack(at_points)
        stacked = _stack(at_cells)
        cuts = np.cumsum([len(block) for _, block in cells])[:-1]
        cell_data = {name: np.split(values, cuts) for name, values in stacked.items()}
        return meshio.Mesh(point_data.pop("x"), cells, point_data, cell_data)

    @staticmethod
    def _point_fields(shape: BeamShape, row: Row, reference: Floats) -> Fields:
        x, d = shape.points(row["q"]), shape.directors(row["q"])
        fields: Fields = {"x": x, "u": x - shape.points(reference)}
        if "v" in row:
            fields["v"] = shape.points(row["v"])
        for i in range(3):
            fields[f"d{i + 1}"] = np.ascontiguousarray(d[:, i])
        fields["q_wxyz"] = quaternions(d)
        fields["node_id"] = shape.node_id
        return fields


class SurfaceLayer(Layer):
    """Beams as swept sections, for those sections that have an outline."""

    name = "beam_surfaces"

    def __init__(self, meta: Mapping[str, Any], static: Mapping[str, Array]) -> None:
        self._shapes = beam_shapes(meta, static)
        if all(shape.outline(k) is None for shape in self._shapes for k in set(shape.section)):
            raise InputError("argument surfaces", "no section of the history has an outline")

    def mesh(self, row: Row, reference: Floats) -> meshio.Mesh:
        """Mesh of one state, see `Layer.mesh`."""
        at_points, at_cells, quads = [], [], []
        start = 0
        for number, shape in enumerate(self._shapes):
            sweep = shape.sweep(row["q"])
            u = sweep.points - shape.sweep(reference).points
            at_points.append({"x": sweep.points, "u": u})
            piece = sweep.element * shape.pieces + sweep.piece
            fields = _gauss_fields(shape, row, shape.pieces)
            fields = {name: values[piece] for name, values in fields.items()}
            at_cells.append({**fields, **_labels(shape, number, sweep.element)})
            quads.append(start + sweep.quads)
            start += len(sweep.points)
        point_data = _stack(at_points)
        cell_data = {name: [values] for name, values in _stack(at_cells).items()}
        cells = [("quad", np.concatenate(quads))]
        return meshio.Mesh(point_data.pop("x"), cells, point_data, cell_data)


class BodyLayer(Layer):
    """Rigid bodies as closed surfaces (or points) and mass points."""

    name = "bodies"

    def __init__(self, meta: Mapping[str, Any], static: Mapping[str, Array]) -> None:
        self._shapes = list(body_shapes(meta, static))

    def mesh(self, row: Row, reference: Floats) -> meshio.Mesh:
        """Mesh of one state, see `Layer.mesh`."""
        at_points, cells = [], []
        ids: list[Array] = []
        start = 0
        for number, shape in enumerate(self._shapes):
            x = shape.points(row["q"])
            fields: Fields = {"x": x, "u": x - shape.points(reference)}
            if "v" in row:
                fields["v"] = shape.points(row["v"])
            fields["q_wxyz"] = np.repeat(quaternions(shape.directors(row["q"])), len(x), axis=0)
            at_points.append(fields)
            block = shape.faces if shape.material is not None else np.zeros((1, 1), dtype=np.int64)
            cells.append(("triangle" if block.shape[1] == 3 else "vertex", start + block))
            ids.append(np.full(len(block), number, dtype=np.int64))
            start += len(x)
        point_data = _stack(at_points)
        cell_data = {"body_id": ids}
        return meshio.Mesh(point_data.pop("x"), cells, point_data, cell_data)


class JointLayer(Layer):
    """Joints as points with type, reaction force and moment, as far as places are recorded."""

    name = "joints"

    def __init__(self, meta: Mapping[str, Any], static: Mapping[str, Array]) -> None:
        joints = meta.get("joints", [])
        self._names = [joint["name"] for joint in joints]
        self.types = sorted({str(joint["type"]) for joint in joints})
        codes = [self.types.index(str(joint["type"])) for joint in joints]
        self._labels = {
            "joint_id": np.arange(len(joints), dtype=np.int64),
            "type": np.array(codes, dtype=np.int64),
        }

    def mesh(self, row: Row, reference: Floats) -> meshio.Mesh | None:
        """Mesh of one state, see `Layer.mesh`."""
        known = [k for k, name in enumerate(self._names) if f"joint/{name}/position" in row]
        if not known:
            return None
        names = [self._names[k] for k in known]
        x = np.array([entry(row, f"joint/{name}/position", (3,)) for name in names])
        fields: Fields = {label: values[known] for label, values in self._labels.items()}
        for field in ("force", "moment"):
            keys = [f"joint/{name}/{field}" for name in names]
            if any(key in row for key in keys):
                nothing = np.full(3, np.nan)
                values = [entry(row, key, (3,)) if key in row else nothing for key in keys]
                fields[field] = np.array(values)
        for field in _COORDINATES:
            keys = [f"joint/{name}/{field}" for name in names]
            if any(key in row for key in keys):
                numbers = [entry(row, key, ()) if key in row else np.nan for key in keys]
                fields[field] = np.array(numbers, dtype=float)
        cells = [("vertex", np.arange(len(x), dtype=np.int64)[:, None])]
        return meshio.Mesh(x, cells, fields)


class CouplingLayer(Layer):
    """Springs, cables, bushings as lines between their ends, with length and force of scalars."""

    name = "couplings"

    def __init__(self, meta: Mapping[str, Any], static: Mapping[str, Array]) -> None:
        couplings = meta.get("couplings", [])
        self._names = [coupling["name"] for coupling in couplings]

    def mesh(self, row: Row, reference: Floats) -> meshio.Mesh | None:
        """Mesh of one state, see `Layer.mesh`."""
        known = [k for k, name in enumerate(self._names) if f"coupling/{name}/ends" in row]
        if not known:
            return None
        names = [self._names[k] for k in known]
        ends = [entry(row, f"coupling/{name}/ends", (2, 3)) for name in names]
        lines = np.arange(2 * len(known), dtype=np.int64).reshape(-1, 2)
        data: dict[str, list[Array]] = {"coupling_id": [np.array(known, dtype=np.int64)]}
        for field in ("coordinate", "force"):
            values = [np.asarray(row.get(f"coupling/{name}/{field}", np.nan)) for name in names]
            numbers = [float(v) if v.shape == () else np.nan for v in values]
            data[field] = [np.array(numbers)]
        return meshio.Mesh(np.concatenate(ends), [("line", lines)], cell_data=data)


# -- paraView series: an index (``.pvd``) for each layer and one file (``.vtu``) for each frame ----

_HEAD = b'<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
_TAIL = b"  </Collection>\n</VTKFile>\n"


class _Index:
    """A ``.pvd`` file that is complete after each frame: the closing tags are overwritten."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._end = len(_HEAD)
        path.write_bytes(_HEAD + _TAIL)

    def add(self, time: float, name: str) -> None:
        """Append a frame; ``name`` is relative to the index."""
        line = f'    <DataSet timestep="{float(time)!r}" part="0" file="{name}"/>\n'.encode()
        with self.path.open("r+b", buffering=0) as handle:
            try:
                write_at(handle, self._end, line + _TAIL)
            except OSError:  # a full disk: there was room for this
                write_at(handle, self._end, _TAIL)
                handle.truncate()
                raise
        self._end += len(line)


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
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".probe.{os.getpid()}.tmp"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"folder {str(folder)!r}", f"cannot be written: {error.strerror}"
        ) from error


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
        folder: str | os.PathLike[str],
        meta: Mapping[str, Any],
        static: Mapping[str, Array],
        *,
        reference: ArrayLike | None = None,
        surfaces: bool = False,
        compress: bool = False,
    ) -> None:
        self.folder = Path(folder)
        self._compression = "zlib" if switch("argument compress", compress) else None
        if reference is None:
            reference = static.get("reference")
        self._reference: Floats | None = None
        if reference is not None:
            self._reference = np.array(reference, dtype=float)
        self._layers = _layers(meta, static, switch("argument surfaces", surfaces))
        prepare_folder(self.folder)
        self._indices = []
        for layer in self._layers:
            (self.folder / layer.name).mkdir(exist_ok=True)
            for frame in (self.folder / layer.name).glob("[0-9]" * 6 + ".vtu"):
                frame.unlink()  # of a longer earlier export: the index would not name it
            self._indices.append(_Index(self.folder / f"{layer.name}.pvd"))
        self._frame = 0
        names = json.dumps(_names(meta, self._layers), indent=1)
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
        """
        arrays = {name: np.asarray(value) for name, value in row.items()}
        if "q" not in arrays:
            raise InputError("row entry 'q'", "is missing; the export needs it")
        if self._reference is None:
            self._reference = np.array(arrays["q"], dtype=float)
        meshes = [layer.mesh(arrays, self._reference) for layer in self._layers]
        written = []
        for layer, index, mesh in zip(self._layers, self._indices, meshes, strict=True):
            if mesh is None:
                if not self._frame:
                    text = "nothing is recorded for this layer"
                    warn(f"layer {str(index.path)!r}", text, IncompleteWarning)
                continue
            name = f"{layer.name}/{self._frame:06d}.vtu"
            path = self.folder / name
            mesh.write(path, file_format="vtu", binary=True, compression=self._compression)
            index.add(time, name)
            written.append(path)
        self._frame += 1
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
    if meta.get("joints"):
        layers.append(JointLayer(meta, static))
    if meta.get("couplings"):
        layers.append(CouplingLayer(meta, static))
    return layers


def _names(meta: Mapping[str, Any], layers: list[Layer]) -> dict[str, Any]:
    """Names behind the numbers in the files."""
    beams = meta.get("beams", [])
    bodies = [*meta.get("bodies", []), *meta.get("points", [])]
    types = [name for layer in layers if isinstance(layer, JointLayer) for name in layer.types]
    return {
        "beam_id": [beam["name"] for beam in beams],
        "part_id": {beam["name"]: list(beam.get("parts", [])) for beam in beams},
        "section_id": {beam["name"]: list(beam.get("sections", [])) for beam in beams},
        "body_id": [body["name"] for body in bodies],
        "joint_id": [joint["name"] for joint in meta.get("joints", [])],
        "coupling_id": [coupling["name"] for coupling in meta.get("couplings", [])],
        "type": types,
    }


def _selection(times: Floats, every: int, fps: float | None) -> list[int]:
    """Numbers of the states to be written."""
    if isinstance(every, bool) or not isinstance(every, int | np.integer) or every < 1:
        raise InputError("argument every", f"got {every!r}, expected an integer of at least 1")
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
    right = np.clip(np.searchsorted(times, wanted), 1, max(1, len(times) - 1))
    left = right - 1
    right = np.minimum(right, len(times) - 1)
    nearest = np.where(wanted - times[left] <= times[right] - wanted, left, right)
    return [int(i) for i in np.unique(nearest)]


def write_paraview(
    history: History,
    folder: str | os.PathLike[str],
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
    check_kind("argument history", history, History)
    chosen = _selection(history.times, every, fps)
    reference = history.static.get("reference")
    if reference is None and len(history):
        reference = history["q"][0]
    writer = ParaViewWriter(
        folder,
        history.meta,
        history.static,
        reference=reference,
        surfaces=surfaces,
        compress=compress,
    )
    for i in chosen:
        writer.write(float(history.times[i]), history.row(i))
    logger.info("%d frames written to %s", len(chosen), folder)
    return writer.indices
