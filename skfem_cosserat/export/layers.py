"""The layers of a scene as meshes with data: beams, swept surfaces, bodies, joints, springs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import meshio
import numpy as np

from ..errors import InputError
from ..types import Array, Floats
from .geometry import BeamShape, beam_shapes, body_shapes, quaternions

__all__ = ["BeamLayer", "BodyLayer", "CouplingLayer", "JointLayer", "Layer", "SurfaceLayer"]

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
