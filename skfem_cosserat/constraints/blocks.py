"""Internal null space matrices of all elements of a group, straight from the rows of y."""

from __future__ import annotations

import numpy as np

from ..kernels import null_space_entries
from ..types import Array, IndexArray

__all__ = ["NullSpaceBlocks"]


class NullSpaceBlocks:
    """:func:`skfem_cosserat.kernels.null_space_blocks` of the same frames, again and again.

    Zeros and ones stay; where the other entries come from and go to is known beforehand.

    Parameters
    ----------
    rows : (ne, nn, 3) int array
        Rows of y of the directors of each element's nodes.
    total : int
        Rows of y.
    count : int
        How many configurations are asked for at once.
    """

    def __init__(self, rows: IndexArray, total: int, count: int) -> None:
        ne, nn = rows.shape[:2]
        ones, where, part, sign = null_space_entries(nn)
        self._shape = count, ne, 12 * nn, 6 * nn
        size = 72 * nn * nn
        numbers = (3 * rows[..., None] + np.arange(3)).reshape(ne, -1)[:, part]
        starts = size * np.arange(count * ne)[:, None]
        self._source = (3 * total * np.arange(count)[:, None, None] + numbers).ravel()
        self._where, self._ones = (starts + where).ravel(), (starts + ones).ravel()
        self._sign = np.tile(sign, count * ne)
        self._flat: Array = np.zeros(0)

    def at(self, y: Array) -> Array:
        """P_int (count, ne, 12 nn, 6 nn) of configurations one after the other, flat.

        Overwritten when asked for again.
        """
        if self._flat.dtype != y.dtype or not len(self._flat):
            self._flat = np.zeros(int(np.prod(self._shape)), dtype=y.dtype)
            self._flat[self._ones] = 1
        entries = y.take(self._source)
        entries *= self._sign
        self._flat[self._where] = entries
        return self._flat.reshape(self._shape)
