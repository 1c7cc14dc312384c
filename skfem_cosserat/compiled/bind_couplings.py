"""From force elements to the arrays of the compiled kernels."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..coupling import Coupling
from ..model import System
from ..model.couplings import Invariants
from ..types import Floats, IndexArray
from .coupling_laws import ANGLE, DISPLACEMENT, DISTANCE
from .couplings import KIND, ROW, SIDE, SLACK, SLOT
from .plan import Plan

__all__ = ["bound_couplings"]

KINDS = {"displacement": DISPLACEMENT, "distance": DISTANCE, "angle": ANGLE}


def bound_couplings(system: System, plan: Plan) -> dict[str, Any]:
    """Force elements on one scalar coordinate each; see :mod:`.couplings`.

    Others (with statics, which take none) are left out: see ``refusal``.
    """
    items = system.couplings.items
    count = len(items)
    places = np.zeros((count, ROW + 2 * SIDE), dtype=np.int64)
    laws, forms = np.zeros((count, 3)), np.zeros((count, 2, 2 * SIDE, 2 * SIDE))
    reference = system.extend(system.q0, 0.0)
    for c, item in enumerate(items):
        coordinate = item.coordinates[0]
        if coordinate.kind not in KINDS:
            continue
        invariants = Invariants([coordinate.forms], system.row_of)
        vertices = _place(system, plan, item, invariants.rows[0], places[c])
        _fill(system, invariants, vertices, forms[c])
        places[c, KIND], places[c, SLACK] = KINDS[coordinate.kind], item.slack
        origin = invariants.values(reference)[0, 0] if coordinate.kind == "displacement" else 0.0
        laws[c] = item.stiffness[0, 0], item.damping[0, 0], item.neutral[0] + origin
    return {"coupling": places, "coupling_law": laws, "coupling_forms": forms}


def _vertices(system: System, rows: IndexArray) -> IndexArray:
    """Vertex of each row of y, those of the ground included."""
    first = np.asarray(system.vertex_rows)
    order = np.argsort(first, kind="stable")
    return np.asarray(order[np.searchsorted(first[order], rows, side="right") - 1])


def _place(
    system: System, plan: Plan, item: Coupling, rows: IndexArray, out: IndexArray
) -> list[int]:
    """Slots and rows of the one or two vertices, which it gives."""
    vertices = np.unique(_vertices(system, rows)).tolist()
    assert len(vertices) <= 2, item.label
    known = [v < len(system.origin_rows) for v in vertices]
    out[SLOT:ROW], out[ROW:] = -1, rows[0]
    for one, v in enumerate(vertices):
        own = rows[_vertices(system, rows) == v]
        out[ROW + SIDE * one + own - system.vertex_rows[v]] = own
        for two, u in enumerate(vertices):
            if known[one] and known[two]:
                out[SLOT + 2 * one + two] = plan.slot[v, u]
    return vertices


def _fill(system: System, invariants: Invariants, vertices: list[int], out: Floats) -> None:
    """Matrices of the invariants by the rows of both sides."""
    rows = invariants.rows[0][invariants.real[0]]
    owner = _vertices(system, rows)
    side = np.array([vertices.index(v) for v in owner])
    local = SIDE * side + rows - np.asarray(system.vertex_rows)[owner]
    for k, A in enumerate(invariants.A[0][:, : len(rows), : len(rows)]):
        out[k][np.ix_(local, local)] = A
