"""From the elements of the tree whose lines follow from directors to arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..model import System
from ..model.tree import Span
from .plan import Plan

__all__ = ["bound_spans"]


def bound_spans(system: System, plan: Plan) -> dict[str, Any]:
    """Elements whose lines follow from their directors."""
    number = np.full(len(system.tree.edges), -1)
    reach: list[float] = []
    strain, turned, slots = [], [], []
    for k, edge in enumerate(system.tree.edges):
        span = edge.joint
        if not edge.spans or not isinstance(span, Span):
            continue
        number[k] = len(reach)
        places = [span.vertices.index(v) for v in (edge.parent, edge.child)]
        elements = span.item.elements
        reach.append((places[1] - places[0]) * elements.lengths[span.element])
        strain.append(elements.reference[span.element, 0, :3])
        turned.append(span.item.rotations[span.element][places])
        both = edge.parent, edge.child
        slots.append([[plan.slot[a, b] for b in both] for a in both])
    rotations = np.array(turned, dtype=float).reshape(-1, 2, 3, 3)
    return {
        "span": number,
        "span_reach": np.array(reach, dtype=float),
        "span_strain": np.array(strain, dtype=float).reshape(-1, 3),
        "span_rotation": rotations,
        "span_turned": (rotations != np.eye(3)).any((1, 2, 3)),
        "span_slot": np.array(slots, dtype=np.int64).reshape(-1, 2, 2),
    }
