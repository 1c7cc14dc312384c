"""From a system to the structures and parts that its kernels take."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from itertools import chain
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..law import DIFFERENCE, STEP, CompiledFunction, Law, LawStored
from ..model import System
from ..model.force_elements import Invariants
from ..model.groups import BeamGroup, Group
from ..model.parts import SeparateParts
from ..model.system import Coordinates
from ..model.tree import Coordinate, Edge, Spot
from ..strain import strain_factors
from ..theory import LawHeld
from ..types import Floats, IndexArray
from .kept import VECTOR, Key, Source, address, cold, helped
from .numbers import (
    BEAM_PARTS,
    COMPLEX_ENERGY,
    COMPLEX_GRADIENT,
    COUPLED,
    ENERGY,
    GRADIENT,
    HESSIAN,
    LOGGED,
    NEXT_LOADS,
    NUMBERS,
    RECORD,
    TREE_PARTS,
)
from .plan import Plan, RowBlock, following, places_of
from .structures import STEPS, Groups, flags, integers, structure
from .tables import (
    ABSOLUTE,
    ANGLE,
    AXIS,
    BLOCK,
    BORDER,
    COMPONENT,
    DAMPING,
    DISPLACEMENT,
    DISTANCE,
    DRIVE,
    FIRST,
    KIND,
    LAST,
    LEADING,
    LEFT,
    MOST_XI,
    NEUTRAL,
    OWN,
    RADIUS,
    RIGHT,
    ROTATION,
    ROW,
    ROWS,
    SHIFTS,
    SIDE,
    SIGN,
    SLACK,
    SLIDE,
    SLOTS,
    SPHERE,
    STIFFNESS,
    SUMS,
    TURNED,
)

# -- from force elements to the arrays of the compiled kernels -------------------------------------

COUPLING_KINDS = {
    **dict.fromkeys(("displacement", "position", "height"), DISPLACEMENT),
    "distance": DISTANCE,
    "radius": RADIUS,
    "angle": ANGLE,
    "rotation": ROTATION,
}


def bound_couplings(system: System, plan: Plan, static: bool) -> dict[str, Any]:
    """Force elements, but at rest those of own laws; see :mod:`.forces`."""
    items = system.couplings.items + ([] if static else system.couplings.called)
    places = np.zeros((len(items), ROW + ROWS), dtype=np.int64)
    laws = np.zeros((len(items), 3, MOST_XI, MOST_XI))
    entries, factors = [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0)]
    reference = system.extend(system.q0, 0.0)
    for c, item in enumerate(items):
        kinds = [coordinate.kind for coordinate in item.coordinates]
        own = [form for coordinate in item.coordinates for form in coordinate.forms]
        invariants = Invariants([tuple(own)], system.row_of)
        vertices = _place(system, plan, invariants.rows[0], places[c])
        forms = _forms(system, invariants, vertices)
        places[c, KIND] = COUPLING_KINDS[kinds[-1]]
        places[c, SLACK] = OWN if item.own_law else item.slack
        places[c, LEADING], places[c, FIRST] = len(kinds) - 1, sum(map(len, factors))
        entries.append(np.argwhere(forms))
        factors.append(forms[forms != 0])
        places[c, LAST] = places[c, FIRST] + len(factors[-1])
        origin, values = np.zeros(item.size), invariants.values(reference)[0]
        shifts = [k for k, kind in enumerate(kinds) if kind == "displacement"]
        origin[shifts] = values[shifts]
        m = slice(item.size)
        if not item.own_law:
            laws[c, STIFFNESS, m, m], laws[c, DAMPING, m, m] = item.stiffness, item.damping
        laws[c, NEUTRAL, 0, m], laws[c, NEUTRAL, SIGN, 0] = item.neutral + origin, item.sign
    return {
        "coupling": places,
        "coupling_law": laws,
        "coupling_entry": np.concatenate(entries),
        "coupling_factor": np.concatenate(factors),
        # address of what finds forces of own laws
        "called": np.zeros(1, dtype=np.int64),
    }


def _place(system: System, plan: Plan, rows: IndexArray, out: IndexArray) -> list[int]:
    """Slots and rows of the one or two vertices, which it gives."""
    vertices = np.unique(places_of(system)[0][rows]).tolist()
    known = np.array([v if v < len(system.origin_rows) else -1 for v in [*vertices, -1][:2]])
    out[SLOTS:ROW], out[ROW:] = plan.slots(known[:, None], known).ravel(), rows[0]
    for one, v in enumerate(vertices):
        first, k = system.vertex_rows[v], np.arange(SIDE)
        out[ROW + SIDE * one + k] = np.minimum(first + k, system.total - 1)
    return vertices


def _forms(system: System, invariants: Invariants, vertices: list[int]) -> Floats:
    """Matrices (k, 8, 8) of the invariants by the rows of both sides."""
    rows = invariants.rows[0][invariants.real[0]]
    owner, place = (each[rows] for each in places_of(system))
    local = SIDE * np.array([vertices.index(v) for v in owner]) + place
    out = np.zeros((invariants.A.shape[1], ROWS, ROWS))
    out[:, local[:, None], local] = invariants.A[0][:, : len(rows), : len(rows)]
    return out


# -- from a frozen system to the arrays of the compiled kernels ------------------------------------

_PLANNED = (
    "order",
    "diag",
    "ptr",
    "neighbour",
    "right",
    "down",
    "update_ptr",
    "update",
    "parent_at",
)
KINDS = {"rotation": ABSOLUTE, "axis": AXIS, "sphere": SPHERE, "slide": SLIDE}


def parts_of(
    coordinates: Coordinates,
    weight: float,
    ends: bool,
    static: bool = False,
    relative: bool = False,
) -> list[str]:
    """Names of all parts that a step takes.

    Parameters
    ----------
    weight, ends
        Of the integrator: where constraints act, and whether stresses are a mean of both ends.
    static : bool
        For a balance at rest: loads are evaluated in each iteration.
    relative : bool
        Relative velocities are damped.
    """
    system = coordinates.system
    unused = {"hold", "beam_energy"}
    if not relative:
        unused |= {name for name in TREE_PARTS if name.startswith("flow")}
    if not coordinates.tree.edges:
        unused |= {name for name in TREE_PARTS if name.startswith("joint")}
    if not len(coordinates.left_rows):
        unused |= {name for name in TREE_PARTS if name.startswith("row")}
    if coordinates.tree.edges is coordinates.joint_edges:
        unused.add("row_branch")
    if not weight:
        unused |= {"joint_curvature", "node_matrix"}
    if system.frame_group is None and system.point_group is None:
        unused.add("nodal_mass_matrix")
    if not ends:
        unused.add("beam_start")
    if not system.beam_groups:
        unused |= {*BEAM_PARTS, *(() if static else ("predict_changes",))}
    if not static and system.dead_only and system.drag is None:
        unused.add("load")
    if not (system.couplings.items or (system.couplings.called and not static)):
        unused.add("couple")
    return [name for name in (*TREE_PARTS, *BEAM_PARTS) if name not in unused]


def keys_of(names: Sequence[str], structures: Sequence[Any]) -> dict[str, list[Key]]:
    """Kernels of these parts, of beams one for each group; by the kinds of their structures."""
    *kinds, beams = *(each.kind for each in structures[:3]), structures[3]
    of_beams = [(g.kind, kinds[2], VECTOR, int) for g in beams.members]
    return {
        name: [("tree", name, own) for own in of_beams]
        if name in BEAM_PARTS
        else [("tree", name, (*kinds, VECTOR, int))]
        for name in names
    }


def compiling(
    coordinates: Coordinates,
    arrays: dict[str, Any],
    names: Sequence[str],
    structures: Sequence[Any],
    source: Source = Source.COMPILER,
) -> AbstractContextManager[None]:
    """While these parts are compiled, with help on an empty cache; the loop over a step, too.

    `arrays` are those of :func:`bound_work`, the others see :func:`addresses`.
    """
    if source < Source.COMPILER or not cold("tree", names[0]):
        return nullcontext()
    ends = np.zeros(len(NUMBERS)), np.zeros(len(RECORD)), bound_carried(coordinates, arrays)[0]
    given = dict(zip(STEPS, (integers([]), *structures, *ends), strict=True))
    loop = "step", "solve", (structure("steps", given).kind, int)
    return helped([loop, *reversed([*chain(*keys_of(names, structures).values())])])


def addresses(
    names: Sequence[str],
    structures: Sequence[Any],
    source: Source = Source.COMPILER,
) -> IndexArray:
    """Addresses of these parts, compiled if need be, at their places; 0 for all others.

    Parameters
    ----------
    structures : (tree, plan, work, beams)
        Each group of beams has parts of its own, whose addresses stand in rows of these.
    source : Source
        See :func:`.kept.address`.
    """
    found = {}
    for name, keys in keys_of(names, structures).items():
        own = [address(*key, source) for key in keys]
        found[name] = structures[3].place(name, own) if name in BEAM_PARTS else own[0]
    # the last ones are those of Python code, if some is called back
    each = [found.get(name, 0) for name in (*TREE_PARTS, *BEAM_PARTS)]
    return np.array([*each, *[0] * (1 + NEXT_LOADS - len(each))])


def _parents(coordinates: Coordinates) -> tuple[list[int], list[int]]:
    """Edge and parent of each vertex, -1 for none or the ground."""
    system = coordinates.system
    count = len(system.origin_rows)
    edge, parent = [-1] * count, [-1] * count
    for k, e in enumerate(coordinates.tree.edges):
        edge[e.child] = k
        parent[e.child] = e.parent if e.parent < count else -1
    return edge, parent


def _of_edges(coordinates: Coordinates) -> list[list[Coordinate]]:
    """Coordinates of each edge, driven ones included; hinges from the parent outwards."""
    tree = coordinates.tree
    each = {e.child: [tree.coordinate(k) for k in tree.own[e.child]] for e in tree.edges}
    for c in tree.driven:
        each[c.vertex].append(c)
    return [
        [c for c in each[e.child] if c.kind != "axis"] + tree.turns.get(e.child, [])
        for e in tree.edges
    ]


def bound_beams(
    system: System,
    group: BeamGroup,
    plan: Plan,
    stiffness: Floats | None = None,
) -> tuple[Any, dict[str, Any]]:
    """One group of elements; the structure, and its arrays by name.

    Parameters
    ----------
    stiffness : (ne, ng, 6, 6) array, optional
        Another one than that of the sections.
    """
    elements = group.elements
    ne, nn = group.vertices.shape
    ng = len(elements.points)
    N, dN = strain_factors(elements.table)
    scalar = group.scalar_mass.reshape(ne, nn, 4, nn, 4)
    mass = np.ascontiguousarray(scalar.transpose(0, 1, 3, 2, 4))
    rotations = np.zeros((0, nn, 3, 3))
    if elements.rotations is not None:
        # by section directors: those of the node are Q^T times them
        rotations = np.ascontiguousarray(elements.rotations)
        Q = np.zeros((ne, nn, 4, 4))
        Q[:, :, 0, 0], Q[:, :, 1:, 1:] = 1, rotations
        mass = np.ascontiguousarray(np.einsum("eaij,eabjk,eblk->eabil", Q, mass, Q))
    each = elements.stiffness if stiffness is None else stiffness
    stiffness, section = _kinds(each)
    S = np.zeros((ne, ng, 6))
    # lengths of tuples are known when kernels are compiled
    fields = {
        "N": _nested(N),
        "dN": _nested(dN),
        "weights": tuple(map(float, elements.weights)),
        # first rows of y of the nodes, and slots of the blocks
        "base": np.ascontiguousarray(system.origin_rows[group.vertices]),
        "slot": plan.slots(group.vertices[:, :, None], group.vertices[:, None]),
        "lengths": np.ascontiguousarray(elements.lengths),
        "section": section,
        "stiffness": np.ascontiguousarray(stiffness),
        "diagonal": not (each * (1 - np.eye(6))).any(),
        "reference": np.ascontiguousarray(elements.reference),
        "mass": mass,
        "rotations": rotations,
        "turned": elements.rotations is not None,
        "strains": np.zeros(0),  # those of stored energies
        "S0": S,
        "S": S.copy(),
        "predicted": S.copy(),
    }
    return structure("beams", fields), fields


def _kinds(each: Floats) -> tuple[Floats, IndexArray]:
    """Distinct values of elements (ne, ...), and the index of each element's value (ne,).

    Elements of one section share a value, so that kernels read less memory.
    """
    kinds, number = np.unique(each, axis=0, return_inverse=True)
    return kinds, number.reshape(len(each))


def bound_groups(
    system: System,
    plan: Plan,
    viscous: bool = False,
    source: Source = Source.COMPILER,
) -> tuple[Any, list[dict[str, Any]]]:
    """All groups of elements; the structure, and arrays by name of each.

    With `viscous`, which says that there are some, elements of viscous sections follow behind all
    others, with numbers of their own; their stiffness is the viscosity.
    """
    groups = system.beam_groups
    bound = [
        bound_by_law(system, group, plan, source)
        if group.elements.stored
        else bound_beams(system, group, plan)
        for group in groups
    ]
    numbers: list[Any] = [None] * len(bound)
    damped = [group for group in groups if viscous and group.elements.viscosity is not None]
    every = np.zeros((len(damped), len(NUMBERS)))
    for group, own in zip(damped, every, strict=True):
        g, fields = bound_beams(system, group, plan, stiffness=group.elements.viscosity)
        numbers.append(own)
        more = {"numbers": own, "all_numbers": every, "viscosity": fields["stiffness"].copy()}
        bound.append((g, fields | more))
    return Groups([g for g, _ in bound], numbers, BEAM_PARTS), [fields for _, fields in bound]


def bound_by_law(
    system: System,
    group: BeamGroup,
    plan: Plan,
    source: Source = Source.COMPILER,
) -> tuple[Any, dict[str, Any]]:
    """One group of elements of which some have a stored energy; as :func:`bound_beams`."""
    _, fields = bound_beams(system, group, plan)
    ne, ng, _ = fields["S"].shape
    moduli = np.ascontiguousarray(group.elements.stiffness)
    fields |= {"stiffness": moduli.copy(), "diagonal": False, "strains": np.zeros((ne, ng, 6))}
    fields["section"] = np.arange(ne)
    own = _law_points(group, fields)
    fields["points"] = structure("law_points", own)
    kinds = fields["points"].kind, VECTOR, int
    fields["law"] = integers([address("laws", "law_points", kinds, source)])
    return structure("beams_by_law", fields), fields | {"law_points": own}


def _functions(law: Law) -> list[int]:
    """Addresses of the functions of a law, in their places; zeros: they are not compiled."""
    own, out = law.law if isinstance(law, LawHeld) else law, [0] * 5
    if not isinstance(own, LawStored):
        return out
    energy, gradient, hessian = own.functions
    if not isinstance(energy, CompiledFunction):
        return out
    out[ENERGY] = energy.address(float)
    if gradient is None:
        out[COMPLEX_ENERGY] = energy.address(complex)
    elif isinstance(gradient, CompiledFunction):
        out[GRADIENT] = gradient.address(float)
        if hessian is None and own.complex_step:
            out[COMPLEX_GRADIENT] = gradient.address(complex)
    else:
        return [0] * 5
    if isinstance(hessian, CompiledFunction):
        out[HESSIAN] = hessian.address(float)
    return out if hessian is None or out[HESSIAN] else [0] * 5


def _law_points(group: BeamGroup, fields: dict[str, Any]) -> dict[str, Any]:
    """Gauss points of elements of which some have a stored energy, and their laws."""
    ne, ng, _ = fields["S"].shape
    count, each = ne * ng, group.elements.laws
    assert group.elements.law_of is not None
    stiffness = np.ascontiguousarray(group.elements.stiffness).reshape(count, 6, 6)
    scales = [law.law.scale if isinstance(law, LawHeld) else law.scale for law in each]
    return {
        # number of its law (-1: quadratic)
        "law": group.elements.law_of.ravel().astype(np.int64),
        "start": fields["S0"].reshape(count, 6),
        "strains": fields["strains"].reshape(count, 6),
        "stresses": fields["S"].reshape(count, 6),
        "moduli": fields["stiffness"].reshape(count, 36),
        "stiffness": stiffness,
        # energies at both ends, derivatives along increments; stresses in their middle, at the end
        **{name: np.zeros(count) for name in ("before", "after", "along")},
        **{name: np.zeros((count, 6)) for name in ("middle", "last")},
        # whether the moduli are those of these strains; what is called back
        **{name: np.zeros(1, dtype=np.int64) for name in ("known", "called")},
        "functions": np.array([_functions(law) for law in each], dtype=np.int64),
        "free": np.array([~np.isin(np.arange(6), law.held) for law in each], dtype=float),
        "metric": np.array([law.stiffness for law in each]),
        "steps": np.array([(STEP * scale, DIFFERENCE * scale) for scale in scales]),
        "noise": np.array([law.noise for law in each]),
    }


def _nested(table: Floats) -> tuple[tuple[float, ...], ...]:
    """A table as nested tuples, whose lengths are known when kernels are compiled."""
    return tuple(tuple(map(float, row)) for row in table)


def bound_plan(coordinates: Coordinates, plan: Plan) -> tuple[Any, dict[str, Any]]:
    """The elimination with the tree of joints; the structure, and its arrays by name."""
    edge, parent = _parents(coordinates)
    count, own = len(edge), coordinates.tree.own
    above = integers([e.parent if e.parent < count else -1 for e in coordinates.tree.edges])
    fields = {
        **{name: getattr(plan, name) for name in _PLANNED},
        "edge": integers([*edge, *([-1] * len(plan.rows))]),
        "parent": integers([*parent, *([-1] * len(plan.rows))]),
        "size": integers([*(len(own[v]) for v in range(count)), *(len(b.rows) for b in plan.rows)]),
        "to_parent": plan.slots(above, integers([e.child for e in coordinates.tree.edges])),
        # how many are eliminated in blocks, and what solves for the rest (0: none)
        "rest": integers([plan.blocks, 0]),
    }
    return structure("plan", fields), fields


def bound_tree(
    coordinates: Coordinates, plan: Plan, held: bool = False, static: bool = False
) -> tuple[Any, dict[str, Any]]:
    """Vertices, edges and coordinates; the structure, and its arrays by name."""
    system = coordinates.system
    kin, tree = coordinates.kinematics, coordinates.tree
    count = len(system.origin_rows)
    fields = {
        "row": np.ascontiguousarray(kin.row[:count]),
        "framed": np.array(system.is_frame, dtype=bool),
        "free": integers(tree.free),
        "loose": integers([v for v in tree.free if system.is_frame[v]]),
        "R": np.zeros((len(kin.row), 3, 3)),
        "triads": integers(np.flatnonzero(system.is_frame)),
        "turn": np.zeros((count, 4)),
        **_mass(system),
        **_edges(coordinates),
        **_coordinates(coordinates),
        **bound_rows(coordinates, plan, held),
        **bound_nodal_masses(system.frame_group, system.point_group),
        **bound_following(system, plan),
        **bound_couplings(system, plan, static),
        # normal of the plane in which a scene stays (zero: none), and the stiffness that holds it
        "hold": np.zeros(3),
        "held_by": np.zeros(1),
    }
    return structure("tree", fields), fields


def _mass(system: System) -> dict[str, Any]:
    """The mass matrix by rows of y."""
    mass = system.mass.tocsr()
    return {
        "mass_data": mass.data,
        "mass_indices": mass.indices.astype(np.int64),
        "mass_indptr": mass.indptr.astype(np.int64),
    }


def _edges(coordinates: Coordinates) -> dict[str, Any]:
    system, row, tree = coordinates.system, coordinates.kinematics.row, coordinates.tree
    edges, count = tree.edges, len(system.origin_rows)
    relative = [e.freedom.turns is not None and bool(system.is_frame[e.child]) for e in edges]
    fulcrums = [_fulcrum(e, r) for e, r in zip(edges, relative, strict=True)]
    followed = np.zeros(len(row), dtype=bool)  # vertices whose rotation a joint asks for
    followed[[v for e in edges for v in (e.parent, e.guide)]] = True
    return {
        "swing": np.zeros((len(edges), 4)),
        "followed": followed,
        "child": integers([e.child for e in edges]),
        "parent": integers([e.parent if e.parent < count else -1 for e in edges]),
        "child_row": integers([row[e.child] for e in edges]),
        "parent_row": integers([row[e.parent] for e in edges]),
        "parent_frame": integers([e.parent for e in edges]),
        "guide_frame": integers([e.guide for e in edges]),
        "relative": flags(relative),
        "sphere": flags([e.freedom.sphere for e in edges]),
        "open": flags([bool(tree.slides.get(e.child)) for e in edges]),
        "child_offset": _vectors([e.child_spot.offset for e in edges]),
        "parent_offset": _vectors([e.parent_spot.offset for e in edges]),
        "arm0": np.zeros((len(edges), 3)),
        **_spots("fulcrum", coordinates, fulcrums),
    }


def _spots(name: str, coordinates: Coordinates, spots: Sequence[Spot]) -> dict[str, Any]:
    """Points of the tree: rows of y, offsets, and vertices, -1 for the ground."""
    row, count = coordinates.kinematics.row, len(coordinates.system.origin_rows)
    return {
        f"{name}_row": integers([row[s.vertex] for s in spots]),
        f"{name}_offset": _vectors([s.offset for s in spots]),
        f"{name}_vertex": integers([s.vertex if s.vertex < count else -1 for s in spots]),
    }


def _fulcrum(edge: Edge, relative: bool) -> Spot:
    """The point of a child that moves as if fixed to its parent."""
    if relative:
        return Spot(edge.child)
    return edge.end.b if edge.freedom.slides else edge.parent_spot


def _coordinates(coordinates: Coordinates) -> dict[str, Any]:
    system, row, tree = coordinates.system, coordinates.kinematics.row, coordinates.tree
    count = len(system.origin_rows)
    each = _of_edges(coordinates)
    own = [c for cs in each for c in cs]
    edges = [e for e, cs in zip(tree.edges, each, strict=True) for _ in cs]
    targets = [
        e.child_spot if c.kind == "sphere" else Spot(e.child)
        for e, c in zip(edges, own, strict=True)
    ]
    centres = [Spot(c.vertex) if c.centre is None else c.centre for c in own]
    numbers = [-1 if c.drive is not None else tree.own[c.vertex].index(c.number) for c in own]
    turning = np.zeros((count, 6), dtype=bool)
    turning[[v for v in tree.free if system.is_frame[v]], 3:] = True
    for c, k in zip(own, numbers, strict=True):
        if k >= 0:
            turning[c.vertex, k] = c.kind != "slide"
    return {
        "value": np.zeros(len(own)),
        "drives": _drives(coordinates, own),
        "turning": turning,
        "triple": _triples(coordinates, each),
        "first": np.concatenate([[0], np.cumsum([len(cs) for cs in each])]).astype(np.int64),
        "kind": integers([KINDS[c.kind] for c in own]),
        "own": integers(numbers),
        "axis": _vectors([c.axis for c in own]),
        "right": _vectors([np.zeros(3) if c.right is None else c.right for c in own]),
        "axis0": np.zeros((len(own), 3)),
        "guide_row": integers([row[c.guide] if c.guide >= 0 else 0 for c in own]),
        "guide_vertex": integers([c.guide if c.guide < count else -1 for c in own]),
        **_spots("target", coordinates, targets),
        **_spots("centre", coordinates, centres),
    }


def _drives(coordinates: Coordinates, own: Sequence[Coordinate]) -> IndexArray:
    """Driven ones among all coordinates of edges, see :func:`.tree.prescribe`."""
    system = coordinates.system
    found = []
    for k, c in enumerate(own):
        if c.drive is not None:
            row = int(coordinates.kinematics.row[c.drive])
            found.append((k, c.kind == "slide", row, row - system.rows))
    return np.array(found, dtype=np.int64).reshape(-1, 4)


def _triples(coordinates: Coordinates, each: list[list[Coordinate]]) -> IndexArray:
    """First of three components of a rotation among each vertex's coordinates; -1: it has none."""
    system = coordinates.system
    triple = np.full(len(system.origin_rows), -1)
    for v in coordinates.tree.free:
        if system.is_frame[v]:
            triple[v] = 3
    for e, own in zip(coordinates.tree.edges, each, strict=True):
        places = [k for k, c in enumerate(own) if c.kind == "rotation"]
        if len(places) == 3:
            triple[e.child] = coordinates.tree.own[e.child].index(own[places[0]].number)
    return triple


def bound_nodal_masses(frames: Group | None, points: Group | None) -> dict[str, Any]:
    """Masses of single frames and of mass points."""
    none = integers([])
    return {
        "frame_vertex": none if frames is None else integers(frames.vertices[:, 0]),
        "frame_masses": np.zeros((0, 4, 4)) if frames is None else frames.scalar_mass,
        "point_vertex": none if points is None else integers(points.vertices[:, 0]),
        "point_masses": np.zeros(0) if points is None else points.scalar_mass[:, 0, 0].copy(),
    }


def bound_following(system: System, plan: Plan) -> dict[str, Any]:
    """Vertices of moments; rows of y and matrix blocks of forces that follow the motion."""
    moments, rows = system.loading.moments, system.origin_rows
    v, u = following(system).vertices.reshape(-1, 2).T
    return {
        "moment_vertex": integers(moments.vertices),
        "moment_follows": flags(moments.follows),
        "follower": np.stack([rows[v], rows[u], plan.slots(v, u)], axis=-1),
    }


def bound_work(
    coordinates: Coordinates,
    plan: Plan,
    late: bool = False,
    separate: SeparateParts | None = None,
) -> tuple[Any, dict[str, Any]]:
    """Structure of the arrays that change during a step, and these arrays by name.

    Dampers act by the way from `earlier` to `later`, whose middle is `mid`: from y0 to y1, or, if
    `late`, as far before and behind the end of a step as the velocity there goes; `drift` is what
    of that is known. Relative velocities of `separate` parts are damped.
    """
    system = coordinates.system
    total, rows, edges = system.total, system.rows, len(coordinates.tree.edges)
    count, each = len(system.origin_rows), len(plan.diag)
    shapes = {
        **dict.fromkeys(("y0", "y1", "mid"), (total, 3)),
        **dict.fromkeys(("p0", "external", "R", "momentum", "internal", "carried"), (rows, 3)),
        **dict.fromkeys(("R_mixed", "change"), (rows, 3)),
        "ground1": (total - rows, 3),
        **dict.fromkeys(("F", "F_mixed"), (count, 6)),
        **dict.fromkeys(("b", "x", "total", "last", "before", "extra", "twist"), (each, 6)),
        "found": (3,),
        "frames": (rows, 3),
        "A": (len(plan.ends), 6, 6),
        **dict.fromkeys(("lower", "upper"), (each, 6, 6)),
        **dict.fromkeys(
            ("S_left", "X_left", "S_right", "X_right", "S_kept", "X_kept"), (edges, 6, 6)
        ),
        **dict.fromkeys(("C_child", "C_parent"), (edges, 6, 6)),
        "closing": (rows, 3),
        "scratch": (2, 6, 6),
        "dead": (rows, 3),
        "moments": (len(system.loading.moments.vertices), 3),
        "followers": (len(following(system).vertices), 4, 4),
        "coupled": (system.couplings.count, COUPLED),
    }
    shapes |= dict.fromkeys(("earlier", "later", "drift"), shapes["y0"] if late else (0, 3))
    arrays = {name: np.zeros(shape) for name, shape in shapes.items()}
    if not late:
        arrays["earlier"], arrays["later"] = arrays["y0"], arrays["y1"]
    flow, own = bound_flow(plan, separate)
    work = structure("work", arrays | {"flow": flow})
    return work, arrays | {"flow": SimpleNamespace(structure=flow, **own)}


def bound_flow(plan: Plan, separate: SeparateParts | None) -> tuple[Any, dict[str, Any]]:
    """Velocities with a damped relative part; the structure, and its arrays by name.

    None: there are no such velocities.
    """
    none, each, count = np.zeros(0), 0, 0
    owner = holder = local = slot = integers([])
    free = total = lift = mu = ones = none
    if separate is not None:
        system, owner, free = separate.system, separate.part, separate.free
        total, lift, mu, ones = separate.total, separate.lift, separate.mu, separate.ones
        mass, first = system.mass.tocsr(), system.origin_rows
        each, count = len(plan.diag), len(first)
        vertex, local = (each[: len(owner)] for each in places_of(system))
        of_row = vertex[np.repeat(np.arange(len(owner)), np.diff(mass.indptr))]
        slot = plan.slots(of_row, vertex[mass.indices])
        holder = np.full(each, -1)
        holder[:count] = owner[first]
        rows, held = plan.ends[(plan.ends[:, 0] >= count) & (plan.ends[:, 1] < count)].T
        holder[rows] = holder[held]  # blocks of constraint rows go with what they hold
    rows, parts = len(owner), len(free)
    shapes = {
        "scheme": (2,),
        "sums": (parts * SUMS, 3),
        "turn": (parts * TURNED, 3),
        **dict.fromkeys(("rest", "mdq", "column"), (rows, 3)),
        "kept": (each, 6),
        "forms": (BORDER, count, 6),
        **dict.fromkeys(("motion", "twists"), (BORDER, each, 6)),
        "schur": (parts, BORDER, BORDER + 1),
    }
    fields = {
        "owner": owner,
        "runs": integers([0, *(np.flatnonzero(np.diff(owner)) + 1).tolist(), rows]),
        "holder": holder,
        "local": local,
        "slot": slot,
        "free": free,
        "total": total,
        "lift": lift,
        "mu": mu,
        "ones": ones,
        "begin": integers([0 if free.any() else SHIFTS]),
        **{name: np.zeros(shape) for name, shape in shapes.items()},
    }
    return structure("flow", fields), fields


def bound_carried(
    coordinates: Coordinates,
    arrays: dict[str, Any],
    rates: tuple[int, int, int] = (0, 0, 0),
    nearest: Sequence[Any] | None = None,
    normal: Floats | None = None,
    most: int = 1,
    viscous: Floats | None = None,
) -> tuple[Any, dict[str, Any]]:
    """Structure of the arrays that are carried from step to step, and these arrays by name.

    Parameters
    ----------
    arrays : dict
        Of :func:`bound_work`.
    rates : (int, int, int)
        How many a scheme has, how many are taken off the balance, and how many are moved.
    nearest : sequence, optional
        Addresses of what moves velocities and of its structure; the configuration (total, 3) and
        momentum (rows, 3) that it takes, the velocity (rows, 3) that it gives.
    normal : (3,) array, optional
        Of the plane in which all stays.
    most : int
        Most steps in one go.
    viscous : (k, numbers) array, optional
        Numbers of groups of viscous elements.
    """
    system = coordinates.system
    rows = system.rows
    count, before, moved = rates
    none = np.zeros((0, 3))
    function, taken, *near = (0, 0, none, none, none) if nearest is None else nearest
    fields = {
        **{name: arrays[name] for name in ("y0", "y1", "p0", "carried")},
        "drift": arrays["drift"],
        "of_drift": np.zeros(count),
        **_mass(system),
        "rates": np.zeros((count * rows, 3)),
        "after": np.zeros((count * rows, 3)),
        "table": np.zeros((count, 1 + count)),
        "before": np.zeros(before),
        "moved": np.zeros(moved),
        "scratch": np.zeros((rows, 3)),
        "nearest": integers([function, taken]),
        **dict(zip(("near_y", "near_p", "velocity"), near, strict=True)),
        "change": np.zeros((rows, 3)),
        "flow": arrays["flow"].structure,
        "normal": np.zeros(0) if normal is None else np.array(normal),
        "limit": np.zeros(1),
        "size": np.zeros(1),  # of the step (s)
        "R": arrays["R"],
        # where the iteration has impulses of constraint rows in R
        "closing": arrays["closing"] if len(coordinates.left_rows) else none,
        "moved_force": np.zeros(1),
        **{f"log_{name}": np.empty((most, rows, 3)) for name in ("q", "p", "impulse")},
        "log_rates": np.empty((most, count * rows, 3)),
        "log_turns": np.empty((most, len(arrays["coupled"]))),
        "log_numbers": np.empty((most, len(LOGGED))),
        "viscous": np.zeros((0, len(NUMBERS))) if viscous is None else viscous,
    }
    return structure("carried", fields), fields


def _vectors(values: Sequence[Any]) -> Floats:
    return np.array(values, dtype=float).reshape(len(values), 3)


# -- constraint rows with multipliers --------------------------------------------------------------


def bound_rows(coordinates: Coordinates, plan: Plan, held: bool = False) -> dict[str, Any]:
    """Constraint rows with multipliers, as lists of terms; see :mod:`.rows`.

    `held`: the part `hold` is called, all rows have weights.
    """
    system = coordinates.system
    count = len(system.origin_rows)
    vertex, component = places_of(system)
    vertex = np.where(vertex < count, vertex, -1)
    numbers, block, place = _numbered(system, plan.rows)
    terms, cosines = system.constraints.terms(), system.branch_cosines.terms()
    own = np.flatnonzero(block[terms.row] >= 0)
    k, a, b = terms.row[own], terms.left[own], terms.right[own]
    e, u, v = block[k], vertex[a], vertex[b]
    products = [e, place[k], a, b, u, component[a], v, component[b]]
    products += [plan.slots(*ends) for ends in ((u, v), (v, u), (e, u), (u, e), (e, v), (v, e))]
    products += [terms.drive_row[own], terms.drive_component[own]]
    each = (terms.linear_row[:, None] + np.arange(3)).ravel()
    n, linear = np.tile(np.arange(3), len(terms.linear_row)), np.repeat(terms.linear, 3)
    of_vectors = np.flatnonzero(block[each] >= 0)
    k, a, n = each[of_vectors], linear[of_vectors], n[of_vectors]
    e, v = block[k], vertex[a]
    vectors = [e, place[k], a, n, v, component[a], plan.slots(e, v), plan.slots(v, e)]
    turned = np.zeros((len(cosines.row), 16), dtype=np.int64)
    turned[:, [BLOCK, LEFT, RIGHT]] = np.column_stack(cosines[:3])
    turned[:, [DRIVE, COMPONENT]] = np.column_stack(cosines[4:6])
    return {
        "row_products": np.stack(products, axis=-1),
        "row_factors": terms.factor[own],
        "row_linear": np.stack(vectors, axis=-1),
        "row_linear_factors": np.repeat(terms.linear_factor, 3)[of_vectors],
        **_of_blocks(coordinates, plan, numbers, terms.constant, held),
        "cosines": turned,
        "cosine_factors": np.array(cosines.factor, dtype=float),
        "cosine_constant": np.array(cosines.constant, dtype=float),
        "cosine": np.zeros(len(cosines.constant)),
    }


def _numbered(
    system: System, blocks: Sequence[RowBlock]
) -> tuple[IndexArray, IndexArray, IndexArray]:
    """Constraint rows of blocks (k, 6), -1 for none; of each row block and place, or -1.

    Blocks are numbered behind the vertices.
    """
    numbers = np.full((len(blocks), 6), -1)
    for own, each in zip(numbers, blocks, strict=True):
        own[: len(each.rows)] = each.rows
    block, place = np.full((2, system.m), -1)
    k, n = np.nonzero(numbers >= 0)
    block[numbers[k, n]], place[numbers[k, n]] = len(system.origin_rows) + k, n
    return numbers, block, place


def _of_blocks(
    coordinates: Coordinates, plan: Plan, numbers: IndexArray, constant: Floats, held: bool
) -> dict[str, Any]:
    """Constants, sizes and weights of constraint rows by block; the frame a block turns with."""
    system = coordinates.system
    magnitude = system.constraints.magnitudes(system.extend(system.q0, system.since))
    none, size = numbers < 0, np.where(magnitude > 0, magnitude, 1.0)
    first = [[v for v in (*b.waits, *b.vertices) if v in b.vertices] for b in plan.rows]
    count = len(system.origin_rows)
    framed = [[v for v in own if v < count and system.is_frame[v]] for own in first]
    weight = np.ones(numbers.shape) if held else _weights(system, numbers, plan.rows)
    weighted = []
    for k in np.flatnonzero(weight.any(1)).tolist():
        own = [v for v in plan.rows[k].vertices if v < count]
        weighted += [(k, u, v) for u in own for v in own]
    of, u, v = np.array(weighted, dtype=np.int64).reshape(-1, 3).T
    slots = of, plan.slots(u, count + of), plan.slots(count + of, v), plan.slots(u, v)
    return {
        "row_constant": np.where(none, 0.0, constant[numbers]) if numbers.size else 0.0 * numbers,
        "row_size": np.where(none, 1.0, size[numbers]) if numbers.size else 0.0 * numbers,
        "row_on": (~none & ~np.isin(numbers, coordinates.closure.rows)).astype(float),
        "row_weight": weight,
        "row_weighted": np.stack(slots, axis=-1),
        "row_triple": np.full(len(plan.rows), -1),
        "row_owner": integers([own[0] if own else -1 for own in framed]),
        "row_numbers": numbers,
    }


#: rotary inertia of a frame, by its largest, below which rows have to hold it for its block to be
#: regular
THIN = 1e-6


def _weights(system: System, numbers: IndexArray, blocks: Sequence[RowBlock]) -> Floats:
    """Weights of rows (k, 6) of blocks that hold a frame which lacks rotary inertia, else zero.

    Any positive ones do. Of vectors the frame's mass (kg), of others its inertia (kg m^2).
    """
    weight = np.zeros(numbers.shape)
    if (group := system.frame_group) is None:
        return weight
    scalar = group.scalar_mass
    first, mass = scalar[:, 1:, 0], scalar[:, 0, 0]
    some = np.where(mass > 0, mass, 1.0)  # forces act on nodes of beams without masses, too
    euler = scalar[:, 1:, 1:] - first[:, :, None] * first[:, None] / some[:, None, None]
    values = np.linalg.eigvalsh(euler)
    least, inertia = values[:, 0] + values[:, 1], values.sum(1)
    thin = {int(group.vertices[k, 0]): k for k in np.flatnonzero(least < THIN * inertia)}
    vectors = _of_vectors(system) if thin else set()
    for own, row, block in zip(weight, numbers.tolist(), blocks, strict=True):
        for k in (thin[v] for v in block.vertices if v in thin):
            sizes = [0.0 if n < 0 else mass[k] if n in vectors else inertia[k] for n in row]
            own[:] = np.maximum(own, sizes)
    return weight


def _of_vectors(system: System) -> set[int]:
    """Constraint rows that are components of vectors in space."""
    return {int(k) + i for k in system.constraints.terms().linear_row for i in range(3)}


def choose_rows(coordinates: Coordinates, fields: dict[str, Any], chosen: IndexArray) -> None:
    """Take these rows (r,) of closed loops, and none of the others.

    Those that are a vector in space turn with the frame of a vertex while factors are kept: then
    all of them have to be there.
    """
    system = coordinates.system
    numbers, on = fields["row_numbers"], fields["row_on"]
    there = np.ones(system.m + 1, dtype=bool)
    there[coordinates.closure.rows] = there[-1] = False
    there[chosen] = True
    on[:] = there[numbers]
    vectors = _of_vectors(system)
    for k, own in enumerate(numbers.tolist()):
        places = [i for i, number in enumerate(own) if number in vectors]
        whole = len(places) > 1 and fields["row_owner"][k] >= 0 and on[k, places].all()
        fields["row_triple"][k] = places[0] if whole else -1
