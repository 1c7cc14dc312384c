"""Shapes in space from coordinates: shared by the ParaView export and the pictures.

A director frame at offset ``o`` of the coordinates has ``phi = q[o:o+3]`` and the directors
``d_i = q[o+3i:o+3i+3]``; arrays of directors here have the shape ``(..., 3, 3)`` with ``d_i`` in
row ``i``. Coordinates are those of one state ``(n,)`` or of many ``(..., n)``: results have the
same axes in front.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..element import lagrange, lobatto_nodes
from ..errors import InputError
from ..kernels import nearest_rotations
from ..types import Array, ArrayLike, Floats, IndexArray


def frames(q: ArrayLike, offsets: ArrayLike) -> tuple[Floats, Floats]:
    """Placements and directors of frames.

    Parameters
    ----------
    q : (..., n)
        Coordinates, or velocities: then rates come out.
    offsets : (k,)
        First coordinate of each frame.

    Returns
    -------
    phi : (..., k, 3)
        Placements in m.
    directors : (..., k, 3, 3)
        Director ``i`` in row ``i``.

    Examples
    --------
    >>> phi, d = frames(range(12), [0])
    >>> phi.tolist(), d[0, 2].tolist()
    ([[0.0, 1.0, 2.0]], [9.0, 10.0, 11.0])
    """
    values = np.asarray(q, float)[..., np.asarray(offsets, np.int64).reshape(-1, 1) + np.arange(12)]
    return values[..., :3], _triads(values[..., 3:])


def _triads(values: Floats) -> Floats:
    """Directors (..., 3, 3) of their numbers (..., 9)."""
    return values.reshape(*values.shape[:-1], 3, 3)


def quaternions(directors: ArrayLike) -> Floats:
    """Unit quaternions ``(w, x, y, z)`` of the rotations closest to the directors, with w >= 0.

    Parameters
    ----------
    directors : (..., 3, 3)
        Director ``i`` in row ``i``; interpolated ones need not be orthonormal.

    Returns
    -------
    (..., 4)
        They turn components in the body's frame into components in space.

    Examples
    --------
    >>> quarter = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]  # about the third axis
    >>> quaternions([quarter]).round(4).tolist()
    [[0.7071, 0.0, 0.0, 0.7071]]
    """
    from scipy.spatial.transform import Rotation  # slow to import, seldom needed

    d = np.asarray(directors, float)
    turned = Rotation.from_matrix(nearest_rotations(d.reshape(-1, 3, 3))).inv()
    return turned.as_quat(True, scalar_first=True).reshape(*d.shape[:-2], 4)


def piece_weights(gauss: Floats, pieces: int) -> Floats:
    """Weights ``(pieces, ng)`` that average Gauss point values over equal pieces of an element.

    A piece without a Gauss point takes the value of the point closest to its middle.
    """
    away = abs(gauss - (np.arange(pieces)[:, None] + 0.5) / pieces)
    own = away <= np.maximum(away.min(1, keepdims=True), 0.5 / pieces)
    return own / own.sum(axis=1, keepdims=True)


class BeamShape:
    """Constant data to evaluate one beam in space; made from the static arrays of a history.

    Points are the nodes for order 1 and 2. For higher orders, whose nodes are not equidistant, they
    are the ends of the elements followed by ``order - 1`` equidistant points in each element.

    Parameters
    ----------
    name : str
        Name of the beam.
    static : mapping of str to array
        With the entries ``beam/{name}/...``.

    Raises
    ------
    InputError
        If an array of the beam is missing.

    Attributes
    ----------
    cells : (nc, 2) or (nc, 3)
        Points of each cell in VTK's order (middle point last).
    cell_element : (nc,)
        Element of each cell.
    node_id : (np,)
        Node of each point, -1 between nodes.
    pieces : int
        Pieces of an element in a swept surface.
    ends, origin : (ne, 2) and (m,) array
        Points at the ends of elements, doubled where section forces may jump; the points, then
        those of which these are copies.
    """

    def __init__(self, name: str, static: Mapping[str, Array]):
        self.name = name
        self._static = static
        self.offsets = self._get("offsets").astype(np.int64)
        self.connectivity = self._get("connectivity").astype(np.int64)
        self.rotations = self._get("rotations")
        self.gauss = np.atleast_1d(self._get("gauss"))
        self.part = self._get("part").astype(np.int64)
        self.section = self._get("section").astype(np.int64)
        self.order = self.connectivity.shape[1] - 1
        self.pieces = self.order
        stations = np.arange(self.order + 1) / self.order
        self.linear = np.column_stack([1 - stations, stations])
        nodes = static.get(f"beam/{name}/nodes", lobatto_nodes(self.order))
        self._stations = lagrange(nodes, stations).T
        self._at_gauss = lagrange(nodes, self.gauss).T
        self._weights = {n: piece_weights(self.gauss, n) for n in (1, self.order)}
        self._number_points()

    def _get(self, key: str) -> Array:
        full = f"beam/{self.name}/{key}"
        if full not in self._static:
            raise InputError(f"beam {self.name!r}", f"the history has no static array {full!r}")
        return self._static[full]

    def _number_points(self) -> None:
        """Find the `ends`, with points of their own where forces may jump, and their `origin`."""
        conn = self.connectivity
        p = self.order
        flat = conn[:, [0, -1]].ravel()
        self._inner = conn[:, 1:-1]
        self.node_id = np.arange(len(self.offsets))
        section = self.section.repeat(2)
        own = self.rotations[:, [0, -1]].reshape(-1, 3, 3)
        other = np.zeros(len(self.node_id), np.int64)
        other[flat] = np.arange(len(flat))
        last = other[flat]
        differs = abs(own - own[last]).max((1, 2)) > 1e-12
        # of the section, or the triad of the node itself where those of sections differ
        self._node_rotation = np.empty((len(other), 3, 3))
        self._node_rotation[conn] = self.rotations
        self._node_rotation[flat[differs]] = np.eye(3)
        apart = np.bincount(flat, minlength=len(other)) > 2
        apart[flat[differs | (section != section[last])]] = True
        apart[self._static.get(f"beam/{self.name}/acted", [])] = True
        copied = apart[flat] & (np.arange(len(flat)) != last)
        self.origin = np.concatenate([np.arange(len(other)), flat[copied]])
        ends = flat.copy()
        ends[copied] = len(other) + np.arange(copied.sum())
        self.ends = ends.reshape(-1, 2)
        self.cells = np.hstack([self.ends, self._inner])  # of VTK's lines of order 1 and 2
        if p > 2:
            self.node_id[self._inner] = -1
            chain = self.cells[:, [0, *range(2, p + 1), 1]]
            self.cells = np.stack([chain[:, :-1], chain[:, 1:]], 2).reshape(-1, 2)
        self.cell_pieces = len(self.cells) // len(conn)
        self.cell_element = np.arange(len(conn)).repeat(self.cell_pieces)

    def spread(self, values: Floats) -> Floats:
        """Values (k, ne, 2, c) at ends as those of the points (k, m, c), linear between."""
        out = np.empty((len(values), len(self.origin), values.shape[-1]))
        out[:, self._inner] = self.linear[1:-1] @ values
        out[:, self.ends] = values
        return out

    def _evaluate(self, nodal: Floats, local: Floats) -> Floats:
        """Values at the points: ``nodal (..., Nb, c)`` at nodes, ``local (..., ne, p+1, c)``."""
        out = nodal.copy()
        out[..., self._inner, :] = self._stations[1:-1] @ local
        return out

    def points(self, q: ArrayLike) -> Floats:
        """Placements (or velocities, for rates of q) of the points ``(..., np, 3)``."""
        phi, _ = frames(q, self.offsets)
        return self._evaluate(phi, phi[..., self.connectivity, :])

    def directors(self, q: ArrayLike) -> Floats:
        """Section directors ``(..., np, 3, 3)``; where several sections meet the node's triad."""
        _, d = frames(q, self.offsets)
        nodal = (self._node_rotation @ d).reshape(*d.shape[:-2], 9)
        return _triads(self._evaluate(nodal, self._local(d)))

    def _local(self, d: Floats) -> Floats:
        """Directors of the sections at the nodes of the elements ``(..., ne, p+1, 9)``."""
        own = self.rotations @ d[..., self.connectivity, :, :]
        return own.reshape(*own.shape[:-2], 9)

    def to_space(self, q: ArrayLike, values: Floats) -> Floats:
        """Turn components in the section frame at Gauss points ``(..., ne, ng, c, 3)`` into space.

        ``c``: several vectors at each Gauss point.
        """
        return values @ _triads(self._at_gauss @ self._local(frames(q, self.offsets)[1]))

    def average(self, values: Floats, pieces: int) -> Floats:
        """Average Gauss point values ``(..., ne, ng, c, 3)`` over the pieces of all elements."""
        mean = np.einsum("pg,...egci->...epci", self._weights[pieces], values)
        return mean.reshape(*values.shape[:-4], -1, *values.shape[-2:])

    def outline(self, section: int) -> Floats | None:
        """Closed outline ``(k, 2)`` of a section in m, without the first point repeated.

        Of sections that vary ``(elements, p + 1, k, 2)``, at equidistant stations.
        """
        outline = self._static.get(f"beam/{self.name}/outline/{section}")
        if outline is None or outline.shape[-2] < 3:
            return None
        closed = np.array_equal(outline[..., 0, :], outline[..., -1, :])
        return outline[..., :-1, :] if closed else outline

    def skin(self, section: int) -> list[Floats]:
        """Outline, then holes, with points for stresses between the corners; none without one."""
        outline = self.outline(section)
        key = f"beam/{self.name}/{{}}/{section}"
        skin = self._static.get(key.format("skin"))
        if outline is None or skin is None:
            return [] if outline is None else [outline]
        return np.split(skin, self._static[key.format("loops")].cumsum()[:-1], axis=-2)

    def stress(self, section: int) -> Floats | None:
        """Stresses (..., k, 3, 6) at the points of the skin for resultants of one, if known."""
        return self._static.get(f"beam/{self.name}/stress/{section}")

    def surface(self, outlines: Mapping[int, Floats | Sequence[Floats]] | None = None) -> Surface:
        """Swept surface of all elements whose section has an outline.

        Parameters
        ----------
        outlines : mapping of int to (k, 2) array or list of them, optional
            Outline by section, or with holes behind it, instead of those of the history.

        Returns
        -------
        Surface
            Empty if no section has an outline.
        """
        if outlines is None:
            outlines = {int(k): self.skin(k) for k in np.unique(self.section)}
        return Surface(self, outlines)

    def axes(self, q: ArrayLike) -> tuple[Floats, Floats]:
        """Placements ``(..., ne, p+1, 3)`` and section directors at equidistant stations."""
        phi, d = frames(q, self.offsets)
        turned = _triads(self._stations @ self._local(d))
        return self._stations @ phi[..., self.connectivity, :], turned


class Surface:
    """Surface of one beam: quads between outlines, and where their corners are in space.

    Parameters
    ----------
    shape : BeamShape
    outlines : mapping of int to array (k, 2) or (elements, p + 1, k, 2), or to a list of such
        Closed outlines in m by section, or of its elements, and its holes; elements of other
        sections have no surface.

    Attributes
    ----------
    quads : (m, 4)
        Corners, outward orientation for counter-clockwise outlines.
    element, piece : (m,)
        Element, and piece of the element, of each quad.
    cap_element : (c,)
        Element of each cap.
    caps : list of (k,) arrays
        Polygons that close free ends: outlines, or quads around a hole of as many points. Sections
        with other holes stay open.
    swept : list of (elements, points)
        Elements of each section, and the points of their outlines as they were given, together.
    size : int
        Number of points.
    """

    def __init__(self, shape: BeamShape, outlines: Mapping[int, Floats | Sequence[Floats]]):
        self._shape, self.size, p = shape, 0, shape.order
        self.swept: list[tuple[IndexArray, Floats]] = []
        self.caps: list[IndexArray] = []
        uses = np.bincount(shape.connectivity.ravel(), minlength=len(shape.offsets))
        quads = [np.zeros((0, 4), np.int64)]
        places = [np.zeros((3, 0), np.int64)]
        for section, given in outlines.items():
            if not len(given):
                continue
            loops = [given] if isinstance(given, np.ndarray) else given
            own = np.flatnonzero(shape.section == section)
            skin = np.concatenate(loops, -2)
            self.swept.append((own, skin))
            element, *rest = np.indices((len(own), p + 1, skin.shape[-2]))
            places.append(np.reshape([own[element], *rest], (3, -1)))
            grid = self.size + np.arange(element.size).reshape(element.shape)
            rings = np.split(grid, np.cumsum([loop.shape[-2] for loop in loops])[:-1], axis=-1)
            quads += [_quads(ring[:, :-1], ring[:, 1:]) for ring in rings]
            conn = shape.connectivity[own]
            for end in (0, -1):
                self._close(loops, [ring[uses[conn[:, end]] == 1, end] for ring in rings], end)
            self.size += grid.size
        self.quads = np.concatenate(quads)
        #: element, station and number on the outline of each point
        self._places = np.concatenate(places, 1)
        self.element, self.piece = self._places[:2, self.quads[:, 0]]
        self.cap_element = self._places[0, [int(cap[0]) for cap in self.caps]]

    def _close(self, loops: Sequence[Floats], rims: list[IndexArray], end: int) -> None:
        """Caps at the start (0) or end (-1) of some elements."""
        outer, *holes = rims
        step = 1 if end else -1
        if not holes:
            self.caps += list(outer[:, ::step])
        elif len(holes) == 1 and holes[0].shape == outer.shape:
            first, hole = (loop.reshape(-1, outer.shape[1], 2)[0] for loop in loops)
            near = np.linalg.norm(hole[::-1] - first[0], axis=1).argmin()
            self.caps += list(_quads(outer, np.roll(holes[0][:, ::-1], -near, axis=1))[:, ::step])

    def shared(self) -> tuple[IndexArray, IndexArray]:
        """Points that stay, and the number of each point among them, if elements share `ends`."""
        ends = self._shape.ends
        element, station, number = self._places
        count = self._shape.order + 1
        rings = ends.max() + 1 + np.arange(len(ends) * count).reshape(-1, count)
        rings[:, [0, -1]] = ends
        keys = rings[element, station] * self.size + number
        return np.unique(keys, return_index=True, return_inverse=True)[1:]

    def points(self, q: ArrayLike) -> Floats:
        """Corners in space ``(..., size, 3)``."""
        center, axes = self._shape.axes(q)
        front = center.shape[:-3]
        parts = [
            center[..., own, :, None, :] + outline @ axes[..., own, :, :2, :]
            for own, outline in self.swept
        ]
        return np.concatenate(
            [np.zeros((*front, 0, 3)), *(part.reshape(*front, -1, 3) for part in parts)], -2
        )


def _quads(one: IndexArray, two: IndexArray) -> IndexArray:
    """Quads (m, 4) between closed rings of points (..., k)."""
    after = np.roll(one, -1, axis=-1), np.roll(two, -1, axis=-1)
    return np.stack([one, *after, two], -1).reshape(-1, 4)


@dataclass(frozen=True)
class BodyShape:
    """A rigid body (a closed surface, or a point without one) or a mass point.

    Attributes
    ----------
    name : str
        Name of the item.
    offset : int
        First coordinate.
    material : (nv, 3) or None
        Material coordinates of the corners in m; None: drawn as one point.
    faces : (nf, 3)
        Triangles.
    is_point : bool
        A mass point, without directors.
    """

    name: str
    offset: int
    material: Floats | None
    faces: IndexArray
    is_point: bool = False

    def points(self, q: ArrayLike) -> Floats:
        """Corners ``(..., nv, 3)`` (velocities for rates of q), or the place ``(..., 1, 3)``."""
        if self.material is None:
            return np.array(q, float)[..., None, self.offset : self.offset + 3]
        phi, d = frames(q, [self.offset])
        return phi + self.material @ d[..., 0, :, :]

    def directors(self, q: ArrayLike) -> Floats:
        """Directors ``(..., 3, 3)``; of a mass point those of space."""
        if self.is_point:
            return np.broadcast_to(np.eye(3), (*np.shape(q)[:-1], 3, 3))
        return frames(q, [self.offset])[1][..., 0, :, :]


def beam_shapes(meta: Mapping[str, Any], static: Mapping[str, Array]) -> list[BeamShape]:
    """All beams of a history."""
    return [BeamShape(entry["name"], static) for entry in meta.get("beams", [])]


def body_shapes(meta: Mapping[str, Any], static: Mapping[str, Array]) -> Iterator[BodyShape]:
    """All bodies, then all mass points of a history."""
    none = np.zeros((0, 3), np.int64)
    for kind, list_name in (("body", "bodies"), ("point", "points")):
        for entry in meta.get(list_name, []):
            name = entry["name"]
            prefix = f"{kind}/{entry['name']}"
            if f"{prefix}/offset" not in static:
                raise InputError(
                    f"{kind} {name!r}", f"the history has no static array '{prefix}/offset'"
                )
            offset = int(static[f"{prefix}/offset"])
            faces = static.get(f"{prefix}/faces", none).astype(np.int64)
            material = static.get(f"{prefix}/points") if len(faces) else None
            yield BodyShape(name, offset, material, faces, kind == "point")
