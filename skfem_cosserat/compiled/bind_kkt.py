"""From a frozen system to the arrays of the compiled kernels for multipliers."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..joint import Joint
from ..model import System
from ..model.quadratic import Terms
from ..types import Floats, IndexArray
from . import structures
from .bind import bound_couplings, bound_following, bound_nodal_masses, bound_work
from .kkt import PIVOT, WIDE
from .numbers import BEAM_PARTS
from .plan import Plan

__all__ = ["bound_constraints", "bound_elimination", "bound_steps", "parts_of"]


def parts_of(system: System, ends: bool) -> list[str]:
    """Names of all parts that a step takes; `ends`: stresses are a mean of both."""
    names = ["begin", "move", "balance", "size", "clear", "cap", "finish", "better"]
    if system.frame_group is not None or system.point_group is not None:
        names.append("nodal_mass_matrix")
    names += ["factor", "sweep"]
    if not (system.loading.dead_only and system.drag is None):
        names.append("load")
    if system.couplings.count:
        names.append("couple")
    if system.beam_groups:
        unused = {"beam_finish"} if ends else {"beam_finish", "beam_start"}
        names += [name for name in BEAM_PARTS if name not in unused]
    return names


class _Rows:
    """Where rows of y and constraint rows are among the vertices.

    Attributes
    ----------
    owner : (m,) int array
        Vertex whose pivot block a constraint row is in: the child of its joint.
    vertex, column : (total,) int arrays
        Vertex of a row of y, -1 for the ground, and its first column in the vertex's blocks.
    """

    def __init__(self, system: System) -> None:
        child: dict[int, int] = {id(e.joint): e.child for e in system.tree.edges}
        self.owner = np.empty(system.m, dtype=np.int64)
        self.owner[: system.internal] = np.repeat(np.flatnonzero(system.is_frame), 6)
        for rows in system.joint_rows:
            joint = rows.joint if isinstance(rows.joint, Joint) else rows.joint.joint
            self.owner[rows.rows] = child[id(joint)]
        self.vertex = np.full(system.total, -1)
        self.column = np.zeros(system.total, dtype=np.int64)
        for v, (r, framed) in enumerate(zip(system.origin_rows, system.is_frame, strict=True)):
            size = 4 if framed else 1
            self.vertex[r : r + size] = v
            self.column[r : r + size] = 3 * np.arange(size)
        self._internal, self._joints = system.internal, system.m - system.internal

    def places(self, constraint: IndexArray, row: IndexArray) -> IndexArray:
        """Rows of joints by the owner's coordinates, or behind all these by its parent's; -1: none.

        Constraints behind the m-th have none.
        """
        inside = constraint < len(self.owner)
        owner = self.owner[np.where(inside, constraint, 0)]
        vertex = self.vertex[row]
        out = constraint - self._internal + np.where(vertex == owner, 0, self._joints)
        return np.where(inside & (vertex >= 0), out, -1)


def bound_constraints(
    system: System, plan: Plan, scaled: bool, h: float
) -> tuple[Any, dict[str, Any]]:
    """Constraints as lists of terms; the structure, and its arrays by name."""
    count, m, rows = len(system.origin_rows), system.m, system.rows
    mass = system.mass.tocsr()
    director = np.ones(rows, dtype=bool)
    director[system.origin_rows] = False
    magnitude = system.constraints.magnitudes(system.extend(system.q0, 0.0))
    steps: dict[str, tuple[int, ...]] = {
        **dict.fromkeys(("multiplier", "added", "last_one", "one_before"), (m,)),
        **dict.fromkeys(("start", "last", "before", "impulse"), (rows, 3)),
        **dict.fromkeys(("G_left", "G_right"), (2 * (m - system.internal), WIDE)),
    }
    fields: dict[str, Any] = {
        "row": np.ascontiguousarray(system.vertex_rows[:count]),
        "framed": system.is_frame.copy(),
        "director": director,
        "mass_data": mass.data,
        "mass_indices": mass.indices.astype(np.int64),
        "mass_indptr": mass.indptr.astype(np.int64),
        **bound_nodal_masses(system.frame_group, system.point_group),
        **_terms(system, plan),
        **bound_following(system, plan),
        **bound_couplings(system, plan),
        "magnitude": np.where(magnitude > 0, magnitude, 1.0),
        "scaled": scaled,
        "step": h,
        **{name: np.zeros(shape) for name, shape in steps.items()},
    }
    fields["g"] = np.zeros(len(fields["constant"]))
    return structures.constraints(tuple(fields[name] for name in structures.CONSTRAINTS)), fields


def _terms(system: System, plan: Plan) -> dict[str, Any]:
    """Products and linear terms of the constraints; behind them what tells how things lie."""
    places = _Rows(system)
    own, cosines = _joint_terms(system), system.branch_cosines.terms()
    both = {
        name: np.concatenate([getattr(own, name), getattr(cosines, name)])
        for name in ("left", "right", "factor", "drive_row", "drive_component", "constant")
    }
    number = np.concatenate([own.row, system.m + cosines.row])
    sides = [both["left"], both["right"]]
    vertex = [places.vertex[a] for a in sides]
    curved = np.full((len(number), 2), -1)
    for t in range(len(own.row)):
        a, b = int(vertex[0][t]), int(vertex[1][t])
        if a >= 0 and b >= 0:
            curved[t] = plan.slot[a, b], plan.slot[b, a]
    return {
        **both,
        "products": len(own.row),
        "product_row": number,
        "product_place": np.column_stack([places.places(number, a) for a in sides]),
        "product_column": np.column_stack([places.column[a] for a in sides]),
        "curved": curved,
        "linear_row": own.linear_row,
        "linear": own.linear,
        "linear_factor": own.linear_factor,
        "linear_place": places.places(own.linear_row, own.linear),
        "linear_column": places.column[own.linear],
    }


def _joint_terms(system: System) -> Terms:
    """Without those of triads, of which the kernels know."""
    terms = system.constraints.terms()
    joint = terms.row >= system.internal
    products = {name: getattr(terms, name)[joint] for name in Terms._fields[:6]}
    return terms._replace(**products)


def bound_elimination(system: System, plan: Plan) -> tuple[Any, dict[str, Any]]:
    """Blocks of the vertices, each with its multipliers; the structure, and its arrays by name."""
    places = _Rows(system)
    count = len(system.origin_rows)
    multipliers = np.argsort(places.owner, kind="stable")
    ptr = np.searchsorted(places.owner[multipliers], np.arange(count + 1))
    coordinates = np.where(system.is_frame, WIDE, 3)
    triple = np.full(count, -1)
    for k in system.constraints.terms().linear_row:
        v = places.owner[k]
        if system.is_frame[v]:  # the gap between two points, a vector in space
            triple[v] = WIDE + int(np.flatnonzero(multipliers[ptr[v] : ptr[v + 1]] == k)[0])
    near = len(plan.neighbour)
    most = int(np.diff(plan.ptr).max(initial=0))
    names = ("order", "diag", "ptr", "neighbour", "right", "down", "update_ptr", "update")
    fields: dict[str, Any] = {
        **{name: getattr(plan, name) for name in (*names, "parent_at")},
        "coordinates": coordinates,
        "multiplier_ptr": ptr,
        "multipliers": multipliers,
        "internal": system.internal,
        "triple": triple,
        "scale": np.ones(2),
        "T": np.zeros((count, PIVOT, PIVOT)),
        "X": np.zeros((near, WIDE, PIVOT)),
        "D": np.zeros((near, PIVOT, WIDE)),
        "inverse": np.zeros((count, PIVOT)),
        "pivots": np.zeros((count, PIVOT), dtype=np.int64),
        "panel": np.zeros((PIVOT, PIVOT + WIDE * most)),
        "x": np.zeros((count, PIVOT)),
        "scratch": np.zeros(PIVOT),
    }
    return structures.elimination(tuple(fields[name] for name in structures.ELIMINATION)), fields


def bound_steps(system: System, plan: Plan) -> tuple[Any, dict[str, Floats]]:
    """What changes during a step; the structure, and its arrays by name.

    The same structure as for the null space, so that parts of elements serve both: what multipliers
    do not need is empty.
    """
    total, rows = system.total, system.rows
    shapes: dict[str, tuple[int, ...]] = {
        **dict.fromkeys(("y0", "y1", "mid"), (total, 3)),
        **dict.fromkeys(("p0", "external", "R", "momentum", "internal", "carried"), (rows, 3)),
        **dict.fromkeys(("change", "frames", "dead"), (rows, 3)),
        "ground1": (total - rows, 3),
        "found": (3,),
        "A": (len(plan.slot), WIDE, WIDE),
    }
    _, others = bound_work(system, plan)
    shapes |= {name: others[name].shape for name in ("moments", "followers", "coupled")}
    arrays = {name: np.zeros(shapes.get(name, (0,) * array.ndim)) for name, array in others.items()}
    return structures.work(tuple(arrays.values())), arrays
