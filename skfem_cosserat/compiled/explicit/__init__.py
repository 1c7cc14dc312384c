"""Compiled loop of the explicit schemes, and its arrays; importing it imports numba."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ...model import System
from ...model.groups import BeamGroup
from ...strain import strain_factors
from ...types import Floats, IndexArray
from .loop import march

__all__ = ["bound"]


class Bodies(NamedTuple):
    """Nodes as rigid bodies."""

    row: IndexArray
    framed: IndexArray
    mass: Floats
    centre: Floats
    axes: Floats
    inverse: Floats


class Joints(NamedTuple):
    """Clusters of nodes one behind the other; ``x_start[c]``: where those of cluster c begin."""

    cluster_of: IndexArray
    vertex_start: IndexArray
    vertices: IndexArray
    row_start: IndexArray
    product_start: IndexArray
    product: IndexArray
    a: IndexArray
    b: IndexArray
    factor: Floats
    linear_start: IndexArray
    linear: IndexArray
    c: IndexArray
    linear_factor: Floats
    constant: Floats
    size: Floats
    local: IndexArray
    component: IndexArray


class Elements(NamedTuple):
    """Elements of one group, and how often each kicks in a round."""

    counts: IndexArray
    vertices: IndexArray
    lengths: Floats
    weights: Floats
    shape: Floats
    slope: Floats
    stiffness: Floats
    reference: Floats


class ClusterArrays(Protocol):
    """Nodes that joints connect, and the terms of the joints' rows."""

    vertices: IndexArray
    product: IndexArray
    a: IndexArray
    b: IndexArray
    factor: Floats
    linear: IndexArray
    c: IndexArray
    linear_factor: Floats
    constant: Floats
    size: Floats


class NodeArrays(Protocol):
    """Nodes as rigid bodies, in numbers."""

    row: IndexArray
    framed: NDArray[np.bool_]
    mass: Floats
    centre: Floats
    axes: Floats
    inverse: Floats
    cluster_of: IndexArray
    local: IndexArray
    slot: tuple[IndexArray, IndexArray]

    @property
    def clusters(self) -> Any:
        """Sequence of ClusterArrays."""


def bound(system: System, nodes: NodeArrays, counts: IndexArray) -> Callable[..., Any]:
    """The loop over the rounds of a step, with the arrays of a scene.

    Parameters
    ----------
    system : System
        With one group of beams.
    nodes : NodeArrays
    counts : (ne,) int array
        Kicks of each element in a round.

    Returns
    -------
    callable
        Of (y, P, L, KP, KL, dead, amplitudes, turning, h); gives (evaluations, work, iterations,
        gap), gap zero or that of a joint that could not be closed.
    """
    bodies = Bodies(
        nodes.row.astype(np.int64),
        nodes.framed.astype(np.int64),
        nodes.mass,
        np.ascontiguousarray(nodes.centre),
        np.ascontiguousarray(nodes.axes),
        np.ascontiguousarray(nodes.inverse),
    )
    fixed = _joints(system, nodes), _elements(system.beam_groups[0], counts)
    return partial(march, bodies, *fixed)


def _starts(sizes: list[int]) -> IndexArray:
    return np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)]).astype(np.int64)


def _joints(system: System, nodes: NodeArrays) -> Joints:
    clusters: list[ClusterArrays] = list(nodes.clusters)

    def joined(kind: type, *arrays: Any) -> Any:
        return np.concatenate([np.zeros(0, dtype=kind), *arrays]).astype(kind)

    component = np.zeros(system.total, dtype=np.int64)
    component[: system.rows] = nodes.slot[1]
    return Joints(
        nodes.cluster_of.astype(np.int64),
        _starts([len(c.vertices) for c in clusters]),
        joined(np.int64, *(c.vertices for c in clusters)),
        _starts([len(c.constant) for c in clusters]),
        _starts([len(c.product) for c in clusters]),
        joined(np.int64, *(c.product for c in clusters)),
        joined(np.int64, *(c.a for c in clusters)),
        joined(np.int64, *(c.b for c in clusters)),
        joined(np.float64, *(c.factor for c in clusters)),
        _starts([len(c.linear) for c in clusters]),
        joined(np.int64, *(c.linear for c in clusters)),
        joined(np.int64, *(c.c for c in clusters)),
        joined(np.float64, *(c.linear_factor for c in clusters)),
        joined(np.float64, *(c.constant for c in clusters)),
        joined(np.float64, *(c.size for c in clusters)),
        nodes.local.astype(np.int64),
        component,
    )


def _elements(group: BeamGroup, counts: IndexArray) -> Elements:
    e = group.elements
    shape, slope = strain_factors(e.table)
    return Elements(
        counts.astype(np.int64),
        np.ascontiguousarray(group.vertices, dtype=np.int64),
        e.lengths,
        e.weights,
        np.ascontiguousarray(shape),
        np.ascontiguousarray(slope),
        np.ascontiguousarray(e.stiffness),
        np.ascontiguousarray(e.reference),
    )
