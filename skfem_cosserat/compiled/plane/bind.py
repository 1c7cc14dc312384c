"""From a frozen system that is confined to a plane to the arrays of the compiled kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_matrix, coo_matrix, csr_matrix

from ...frames import TOLERANCE
from ...model import System
from ...model.groups import BeamGroup
from ...model.tree import Spot
from ...strain import FORMS, strain_factors
from ...types import Floats, IndexArray
from .. import structures
from ..bind import (
    KINDS,
    coordinates_of,
    drives_of,
    followed,
    fulcrum_of,
    kinds_of,
    nested,
    work_of,
)
from ..bind_rows import bound_held, first_held, numbered, of_blocks
from ..numbers import BEAM_PARTS, COUPLED
from ..plan import Plan
from ..structures import integers
from ..tables import plane as places

__all__ = ["Frames", "bound_beams", "bound_groups", "bound_space", "bound_tree", "bound_work"]
__all__ += ["bound_rows"]

ComplexArray = NDArray[np.complex128]


class Frames:
    """Vertices of a system in its plane, those of the ground last: directors by one unit vector.

    Parameters
    ----------
    system : System
        Confined to a plane.

    Attributes
    ----------
    first : (nv + ng,) int array
        First row of y of each vertex.
    framed : (nv + ng,) bool array
    director : (nv + ng, 3) complex array
        ``k_i`` of ``d_i = k_i e``; e is along the last director that lies in the plane.
    height : (total,) array
        Components of the rows of y along the normal, which never change.
    vertex, place : (total,) int arrays
        Vertex of each row of y, and where it is there: 0 the origin.
    """

    def __init__(self, system: System) -> None:
        plane = system.plane
        assert plane is not None
        self.plane, self.count = plane, len(system.origin_rows)
        self.first = np.ascontiguousarray(system.kinematics.row)
        size = len(self.first)
        self.framed = np.ones(size, dtype=bool)
        self.framed[: self.count] = system.is_frame
        y = system.extend(system.q0, system.since)
        self.height = y @ plane.normal
        self.vertex = np.zeros(system.total, dtype=np.int64)
        self.place = np.zeros(system.total, dtype=np.int64)
        self.director = np.zeros((size, 3), dtype=complex)
        for v, r in enumerate(self.first):
            for i in range(4 if self.framed[v] else 1):
                self.vertex[r + i], self.place[r + i] = v, i
            if self.framed[v]:
                d = self.flat(y[r + 1 : r + 4])
                inside = np.flatnonzero(abs(d) > abs(d).max() - 1e-9)[-1]
                self.director[v] = d * (d[inside] / abs(d[inside])).conj()

    def flat(self, vectors: Floats) -> ComplexArray:
        """Vectors (..., 3) in the plane (...)."""
        both = vectors @ self.plane.axes.T
        return np.asarray(both[..., 0] + 1j * both[..., 1])

    def factor(self, row: int) -> complex:
        """What the origin or the unit vector is multiplied with in a row of y."""
        i = int(self.place[row])
        return complex(self.director[self.vertex[row], i - 1]) if i else 1.0 + 0j

    def offset(self, spot: Spot) -> complex:
        """Of a material point from the origin, by the unit vector."""
        return complex(self.director[spot.vertex] @ np.array(spot.offset))

    def gather(self, rows: int) -> csr_matrix:
        """From origins and unit vectors (2 nv) to rows of y; transposed and conjugated: forces."""
        r = np.arange(rows)
        column = 2 * self.vertex[:rows] + (self.place[:rows] > 0)
        values = np.array([self.factor(int(k)) for k in r], dtype=np.complex128)
        return csr_matrix((values, (r, column)), shape=(rows, 2 * self.count))


def pairs(numbers: Any) -> Floats:
    """Complex numbers (...) as pairs (..., 2)."""
    z = np.array(numbers, dtype=complex)
    return np.ascontiguousarray(np.stack([z.real, z.imag], axis=-1))


def _masses(matrix: csr_matrix) -> dict[str, Any]:
    """A mass matrix by origins and unit vectors: blocks of pairs of vertices, by columns."""
    m = matrix.tocoo()
    rows = np.concatenate([2 * m.row, 2 * m.row, 2 * m.row + 1, 2 * m.row + 1])
    cols = np.concatenate([2 * m.col, 2 * m.col + 1, 2 * m.col, 2 * m.col + 1])
    data = np.concatenate([m.data.real, -m.data.imag, m.data.imag, m.data.real])
    real = coo_matrix((data, (rows, cols)), shape=(2 * m.shape[0], 2 * m.shape[1]))
    blocks = bsr_matrix(real, blocksize=(4, 4))
    return {
        "mass_blocks": np.ascontiguousarray(blocks.data.swapaxes(1, 2)),
        "mass_indices": blocks.indices.astype(np.int64),
        "mass_indptr": blocks.indptr.astype(np.int64),
    }


def bound_space(system: System, frames: Frames) -> tuple[Any, dict[str, Any]]:
    """What there is by rows of y in space; the structure, and its arrays by name."""
    total, rows, normal = system.total, system.rows, frames.plane.normal
    mass = system.mass.tocsr()
    shapes = {
        **dict.fromkeys(("y0", "y1"), (total, 3)),
        **dict.fromkeys(("p0", "external", "R", "momentum", "internal", "carried"), (rows, 3)),
        "ground1": (total - rows, 3),
    }
    fields: dict[str, Any] = {
        "first": frames.first,
        "framed": frames.framed,
        "director": pairs(frames.director),
        "axes": np.ascontiguousarray(frames.plane.axes),
        "rest": frames.height[:, None] * normal,
        **{name: np.zeros(shape) for name, shape in shapes.items()},
        "mass_data": mass.data,
        "mass_indices": mass.indices.astype(np.int64),
        "mass_indptr": mass.indptr.astype(np.int64),
    }
    return structures.structure("rows", fields), fields


def bound_tree(system: System, plan: Plan, frames: Frames, rows: Any) -> tuple[Any, dict[str, Any]]:
    """Vertices, edges and coordinates; the structure, and its arrays by name."""
    tree = system.tree
    gather = frames.gather(system.rows)
    mass = (gather.conj().T @ system.mass.tocsr() @ gather).tocsr()
    fields: dict[str, Any] = {
        "rows": rows,
        "framed": np.array(system.is_frame, dtype=bool),
        "free": integers(tree.free),
        "loose": integers([v for v in tree.free if system.is_frame[v]]),
        "followed": followed(system),
        "turn": np.zeros((len(frames.first), 2)),
        **_masses(mass),
        **_edges(system, frames),
        **_coordinates(system, frames),
        **_nodal_masses(system, frames),
        **bound_rows(system, plan, frames),
    }
    return structures.structure("plane_tree", fields), fields


def _edges(system: System, frames: Frames) -> dict[str, Any]:
    """Tables of joints, see :mod:`.complex_numbers`."""
    tree, count = system.tree, frames.count
    edges = np.zeros((len(tree.edges), len(places.EDGES)), dtype=np.int64)
    arms = np.zeros((len(tree.edges), len(places.ARMS)))
    last = 0
    for k, (e, own) in enumerate(zip(tree.edges, coordinates_of(system), strict=True)):
        relative = tree.freedom(e).turns is not None and bool(system.is_frame[e.child])
        fulcrum, inside = fulcrum_of(e, relative), e.parent < count
        first, last = last, last + len(own)
        edges[k] = (
            *(e.child, e.parent if inside else -1, e.parent, e.guide, fulcrum.vertex),
            *(first, last, system.is_frame[e.child], relative),
            *(bool(tree.slides.get(e.child)), inside and system.is_frame[e.parent]),
        )
        for column, spot in (
            (places.CHILD_SPOT, e.child_spot),
            (places.PARENT_SPOT, e.parent_spot),
            (places.FULCRUM_SPOT, fulcrum),
        ):
            put(arms, k, column, frames.offset(spot))
    both = [np.ascontiguousarray(edges[:, k]) for k in (places.CHILD, places.PARENT)]
    return {"edges": edges, "arms": arms, "child": both[0], "parent": both[1]}


def put(table: Floats, k: int, column: int, z: complex) -> None:
    """A complex number to two columns of a row."""
    table[k, column : column + 2] = z.real, z.imag


def _coordinates(system: System, frames: Frames) -> dict[str, Any]:
    """Tables of coordinates, see :mod:`.complex_numbers`."""
    tree = system.tree
    each = coordinates_of(system)
    both = [(e, c) for e, cs in zip(tree.edges, each, strict=True) for c in cs]
    turning = np.zeros((frames.count, 4), dtype=bool)
    turning[[v for v in tree.free if system.is_frame[v]], 2] = True
    coordinates = np.zeros((len(both), len(places.COORDINATES)), dtype=np.int64)
    along = np.zeros((len(both), len(places.ALONG)))
    y = system.extend(system.q0, system.since)
    for j, (e, c) in enumerate(both):
        target = e.child_spot if c.kind == "sphere" else Spot(e.child)
        centre = Spot(c.vertex) if c.centre is None else c.centre
        own = -1 if c.drive is not None else tree.own[c.vertex].index(c.number)
        if own >= 0:
            turning[c.vertex, own] = c.kind != "slide"
        guide = max(c.guide, 0)
        coordinates[j] = KINDS[c.kind], own, guide, target.vertex, centre.vertex
        axis, d = c.axis, y[frames.first[guide] + 1 : frames.first[guide] + 4]
        if c.kind in ("axis", "slide"):  # material
            axis = c.axis @ d
        along[j, places.SIGN] = axis @ frames.plane.normal
        if c.kind == "slide":
            e0 = (frames.director[guide].conj() @ frames.flat(d)) / 2
            direction = frames.flat(np.cross(axis, np.asarray(c.right) @ d))
            put(along, j, places.SLIDE, complex(direction * e0.conj()))
        put(along, j, places.TARGET_SPOT, frames.offset(target))
        put(along, j, places.CENTRE_SPOT, frames.offset(centre))
    tables = {"turning": turning, "coordinates": coordinates, "along": along}
    drives = drives_of(system, [c for _, c in both])
    return tables | {"value": np.zeros(len(both)), "drives": drives}


def _nodal_masses(system: System, frames: Frames) -> dict[str, Any]:
    """Masses of single frames, by origin and unit vector, and of mass points."""
    frame_masses, vertices = np.zeros((0, 4), dtype=complex), integers([])
    if (group := system.frame_group) is not None:
        vertices = integers(group.vertices[:, 0])
        scalar = group.scalar_mass
        frame_masses = _reduced(scalar, frames.director[vertices], frames.director[vertices])
    none, points = np.zeros(0), system.point_group
    return {
        "frame_vertex": vertices,
        "frame_masses": pairs(frame_masses),
        "point_vertex": integers([] if points is None else points.vertices[:, 0]),
        "point_masses": none if points is None else points.mass[:, 0, 0].copy(),
    }


def _reduced(scalar: Floats, left: ComplexArray, right: ComplexArray) -> ComplexArray:
    """Scalar masses (..., 4, 4) by origins and unit vectors (..., 4): xx, xe, ex, ee."""
    xe = (scalar[..., 0, 1:] * right).sum(-1)
    ex = (scalar[..., 1:, 0] * left.conj()).sum(-1)
    ee = (left.conj()[..., :, None] * scalar[..., 1:, 1:] * right[..., None, :]).sum((-1, -2))
    return np.stack([scalar[..., 0, 0] + 0j, xe, ex, ee], axis=-1)


def bound_rows(system: System, plan: Plan, frames: Frames) -> dict[str, Any]:
    """Constraint rows with multipliers, as lists of terms; see :mod:`.rows`."""
    count, blocks, width = frames.count, plan.rows, 3
    numbers, block, place = numbered(system, blocks, count, width)
    own, cosines = system.constraints.terms(), system.branch_cosines.terms()
    joints = first_held(system)
    constants = [np.array(each.constant, dtype=float) for each in (own, cosines)]
    tables: list[list[tuple[int, ...]]] = [[], []]
    factors: list[list[complex]] = [[], []]
    for which, terms in enumerate((own, cosines)):
        for k, a, b, c in zip(*terms[:4], strict=True):
            u, v = int(frames.vertex[a]), int(frames.vertex[b])
            constants[which][k] -= c * frames.height[a] * frames.height[b]
            e, n = (int(block[k]), int(place[k])) if which == 0 else (k, 0)
            if e < 0 or (which == 0 and k >= joints):
                continue
            ends = e, n, u, int(frames.place[a] > 0), v, int(frames.place[b] > 0)
            tables[which].append(ends)
            factors[which].append(c * frames.factor(a).conjugate() * frames.factor(b))
    linear, directions = [], []
    axes = frames.flat(np.eye(3))
    for k, a, c in zip(own.linear_row, own.linear, own.linear_factor, strict=True):
        v = int(frames.vertex[a])
        for component in range(3):
            e = int(block[k + component])
            if e < 0:
                continue
            constants[0][k + component] -= c * frames.height[a] * frames.plane.normal[component]
            linear.append((e, int(place[k + component]), v, int(frames.place[a] > 0)))
            directions.append(c * frames.factor(a).conjugate() * axes[component])
    products = np.array(tables[0], dtype=np.int64).reshape(-1, 6)
    held = np.array(linear, dtype=np.int64).reshape(-1, 4)
    of, *ends_of = products[:, ::2].T
    one, two = (np.where(each < count, each, -1) for each in ends_of)  # not those of the ground
    rows = np.stack([one, two, of, one, of, two], axis=-1)
    cols = np.stack([two, one, one, of, two, of], axis=-1)
    of_held = np.where(held[:, 2] < count, held[:, 2], -1)
    return {
        "products": np.column_stack([products, plan.slots(rows, cols)]),
        "factors": pairs(factors[0]).reshape(-1, 2),
        "linear": np.column_stack(
            [held, plan.slots(held[:, 0], of_held), plan.slots(of_held, held[:, 0])]
        ),
        "directions": pairs(directions).reshape(-1, 2),
        **of_blocks(system, plan, numbers, constants[0]),
        "cosines": np.array(tables[1], dtype=np.int64).reshape(-1, 6),
        "cosine_factors": pairs(factors[1]).reshape(-1, 2),
        "cosine_constant": constants[1],
        "cosine": np.zeros(len(constants[1])),
        "row_handed": _handed(system, numbers, axes),
    }


def _handed(system: System, numbers: IndexArray, axes: ComplexArray) -> Floats:
    """Of each block: whether its vector in space has two components in the plane, and their sense.

    1 or -1: to the left or to the right from the first to the second; 0: they are not alone.
    """
    out = np.zeros(len(numbers))
    place = {int(k) + i: i for k in system.constraints.terms().linear_row for i in range(3)}
    for k, own in enumerate(numbers.tolist()):
        along = [axes[place[n]] for n in own if n in place]
        if len(along) == 2 and own[0] in place and own[1] in place:
            turn = along[0].conjugate() * along[1]
            out[k] = np.sign(turn.imag) if abs(abs(turn.imag) - 1) < TOLERANCE else 0.0
    return out


def sections_of(rotations: Floats, director: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Unit vectors of sections at nodes (ne, nn) by those of the nodes, and ``k_i`` (ne, 3).

    From rotations (ne, nn, 3, 3) and directors of nodes (ne, nn, 3): sections of an element have
    the same constants at all of its nodes, as nothing of it leaves the plane.
    """
    own = (rotations @ director[..., None])[..., 0]
    turned = own[..., 2] / abs(own[..., 2])
    return turned, np.asarray((own * turned[..., None].conj())[:, 0])


def bound_beams(
    system: System,
    group: BeamGroup,
    plan: Plan,
    frames: Frames,
    outside: dict[str, Any],
    rows: dict[str, Any] | None = None,
) -> tuple[Any, dict[str, Any]]:
    """One group of elements; the structure, and its arrays by name.

    Parameters
    ----------
    outside, rows : dict
        Arrays of :func:`bound_space`, and of :func:`bound_tree`, if strains are held.
    """
    hold = bound_held(system, group, plan, rows)
    common = {"axes": outside["axes"], "out": outside["internal"], **hold}
    elements = group.elements
    ne, nn = group.vertices.shape
    ng = len(elements.points)
    N, dN = strain_factors(elements.table)
    turned = elements.rotations is not None
    triads = np.broadcast_to(np.eye(3), (ne, nn, 3, 3))
    if elements.rotations is not None:
        triads = elements.rotations
    rotations, k = sections_of(triads, frames.director[group.vertices])
    scalar = group.scalar_mass.reshape(ne, nn, 4, nn, 4)
    Q = np.zeros((ne, nn, 4, 4))  # by section directors: those of the node are Q^T times them
    Q[:, :, 0, 0], Q[:, :, 1:, 1:] = 1, triads
    mass = np.einsum("eaij,eajbk,eblk->eabil", Q, scalar, Q)
    left = np.broadcast_to(k[:, None, None], (ne, nn, nn, 3))
    strain = np.zeros((ne, 6, 3))  # Gamma and K by gamma and kappa
    for i, form in enumerate(FORMS):
        for a, b, factor in form:
            if b == 0:  # d_a . phi' = Re(conj(k_a) gamma)
                strain[:, i, 0], strain[:, i, 1] = k[:, a - 1].real, k[:, a - 1].imag
            else:  # d_a . d_b' = Re(conj(k_a) k_b conj(e) e'), of which Re(conj(e) e') cancels
                strain[:, i, 2] -= factor * (k[:, a - 1].conj() * k[:, b - 1]).imag
    forces = elements.stiffness @ strain
    stiffness = strain.swapaxes(1, 2) @ forces
    reference = np.einsum("egi,eij->egj", elements.reference, strain)
    sections = np.concatenate(
        [stiffness.reshape(ne, 9), (forces @ inverse(stiffness)).reshape(ne, 18)]
        + [pairs(k).reshape(ne, 6)],
        axis=1,
    )
    kinds, section = kinds_of(sections)
    fields = {
        "N": nested(N),
        "dN": nested(dN),
        "weights": tuple(map(float, elements.weights)),
        "base": np.ascontiguousarray(group.vertices),
        "slot": plan.slots(group.vertices[:, :, None], group.vertices[:, None]),
        "lengths": np.ascontiguousarray(elements.lengths),
        "section": section,
        "stiffness": np.ascontiguousarray(kinds[:, :9]).reshape(-1, 3, 3),
        "resultants": np.ascontiguousarray(kinds[:, 9:27]).reshape(-1, 6, 3),
        "director": np.ascontiguousarray(kinds[:, 27:]).reshape(-1, 3, 2),
        "reference": np.ascontiguousarray(reference),
        "mass": pairs(_reduced(mass, left, left)),
        "rotations": pairs(rotations),
        "turned": turned,
        "frames": np.ascontiguousarray(system.origin_rows[group.vertices]),
        "triads": np.ascontiguousarray(triads),
        **{name: np.zeros((ne, ng, 3)) for name in ("S0", "S", "predicted")},
        "held_stress": np.zeros((len(hold["held"]), ng, 3)),
        "held_form": np.ascontiguousarray(strain[: len(hold["held"]), hold["holds"]]),
        **common,
    }
    return structures.structure("plane_beams", fields), fields


def bound_groups(
    system: System, plan: Plan, frames: Frames, outside: dict[str, Any], rows: dict[str, Any]
) -> tuple[Any, list[dict[str, Any]]]:
    """All groups of elements; the structure, and arrays by name of each."""
    groups = system.beam_groups
    bound = [bound_beams(system, group, plan, frames, outside, rows) for group in groups]
    members, fields = [g for g, _ in bound], [own for _, own in bound]
    return structures.Groups(members, [None] * len(bound), BEAM_PARTS), fields


def inverse(D: Floats) -> Floats:
    """Pseudoinverses of stiffness matrices (ne, 3, 3): stresses of held strains stay zero."""
    size = np.sqrt(np.einsum("eii->ei", D))
    f = 1 / np.where(size > 0, size, 1.0)
    scaled = f[:, :, None] * D * f[:, None, :]
    return np.asarray(f[:, :, None] * np.linalg.pinv(scaled, hermitian=True) * f[:, None, :])


def bound_work(system: System, plan: Plan, frames: Frames) -> tuple[Any, dict[str, Floats]]:
    """What changes during a step; the structure, and its arrays by name."""
    size, count, edges = len(frames.first), frames.count, len(system.tree.edges)
    each = len(plan.diag)
    shapes: dict[str, tuple[int, ...]] = {
        **dict.fromkeys(("y0", "y1", "mid"), (size, 4)),
        **dict.fromkeys(("p0", "external", "R", "momentum", "internal", "carried"), (count, 4)),
        **dict.fromkeys(("R_mixed", "change", "closing", "frames"), (count, 4)),
        "ground1": (size - count, 4),
        **dict.fromkeys(("F", "F_mixed"), (count, 4)),
        **dict.fromkeys(("b", "x", "total", "last", "before", "extra", "twist"), (each, 4)),
        "found": (3,),
        "A": (len(plan.ends), 12),
        "inverse": (each, 12),
        **dict.fromkeys(
            ("S_left", "X_left", "S_right", "X_right", "S_kept", "X_kept"), (edges, 12)
        ),
        **dict.fromkeys(("C_child", "C_parent"), (edges, 12)),
        "corrections": (each,),
        "scratch": (2, 12),
        **dict.fromkeys(("dead", "moments"), (0, 3)),
        "followers": (0, 4, 4),
        "coupled": (0, COUPLED),
    }
    return work_of(shapes)
