"""Structures of arrays for compiled kernels, and how kernels are compiled."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("numba")

from numba import njit

from skfem_cosserat.compiled.structures import Structure

NAMES = ("a", "count", "on", "off", "x", "N", "k")


def made() -> tuple[Structure, dict[str, Any]]:
    """A structure with fields of each kind."""
    fields = {
        "a": np.arange(24.0).reshape(2, 3, 4),
        "count": 5,
        "on": True,
        "off": False,
        "x": -0.1,
        "N": ((0.25, 0.75), (1.5, -2.0)),
        "k": np.array([3, 1], dtype=np.int64),
    }
    return Structure("sample", NAMES, tuple(fields.values())), fields


@njit
def read(s: Any, out: Any) -> None:
    """All fields into out; writes to a."""
    out[0], out[1], out[2] = s.a[1, 2, 3], s.a.shape[1], s.a.size
    out[3], out[4], out[5], out[6] = s.count, s.on, s.off, s.x
    for p in range(2):
        for q in range(2):
            out[7 + 2 * p + q] = s.N[p][q]
    out[11], out[12] = s.k[0], len(s.k)
    s.a[0, 0, 1] = 7.0


@pytest.mark.slow
def test_kernels_read_and_write_what_python_has() -> None:
    s, fields = made()
    out = np.zeros(13)
    read(s, out)
    a, k = fields["a"], fields["k"]
    wanted = [a[1, 2, 3], a.shape[1], a.size, 5, 1, 0, -0.1, 0.25, 0.75, 1.5, -2.0, k[0], len(k)]
    assert out.tolist() == wanted
    assert a[0, 0, 1] == 7.0  # shared, not copied


def test_arrays_with_gaps_and_other_fields_are_refused() -> None:
    with pytest.raises(TypeError, match=r"array a .* not contiguous"):
        Structure("sample", ("a",), (np.zeros((4, 4))[:, ::2],))
    with pytest.raises(TypeError, match="no field of type"):
        Structure("sample", ("a",), ("text",))
