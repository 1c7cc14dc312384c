"""Forces that are linear in the configuration, pair by pair of vertices, for compiled kernels."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from ..model import System
from ..model.loading import Followers
from ..types import Floats, IndexArray

__all__ = ["following"]


def following(system: System) -> Followers:
    """Forces fixed in bodies and sections, and behind them drag per velocity, in channel -1."""
    loads = system.loading.followers
    if system.drag is None:
        return loads
    vertices, values = _pairs(system.drag, system.origin_rows)
    return Followers(
        np.concatenate([loads.vertices, vertices]),
        np.concatenate([loads.channels, np.full(len(vertices), -1)]),
        np.concatenate([loads.values, values]),
    )


def _pairs(matrix: csr_matrix, first: IndexArray) -> tuple[IndexArray, Floats]:
    """Pairs of vertices (k, 2) and their entries (k, 4, 4) of a matrix by rows of y."""
    entries = matrix.tocoo()
    rows = np.stack([entries.row, entries.col], -1)
    order = np.argsort(first)
    vertex = order[np.searchsorted(first[order], rows, side="right") - 1]
    pairs, number = np.unique(vertex, axis=0, return_inverse=True)
    values = np.zeros((len(pairs), 4, 4))
    component = rows - first[vertex]
    np.add.at(values, (number.reshape(-1), component[:, 0], component[:, 1]), entries.data)
    return pairs, values
