"""How kernels are compiled: importing this module imports numba."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit
from numba.core.caching import FunctionCache

__all__ = ["STAMP", "inlined", "jit"]

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def _stamp() -> str:
    """Of all sources of this folder."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


#: numba's cache notices changes in a function's own file only, but code of others is compiled in
STAMP = _stamp()


class _Cache(FunctionCache):
    """Compiled code on disk that is valid as long as no file of this folder changes."""

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (*super()._index_key(sig, codegen), STAMP)


def jit(function: Kernel) -> Kernel:
    """Compile at the first call and keep the result on disk; IEEE arithmetic as in numpy.

    Loops are written out: assigning to slices takes numba seconds to compile. Short loops of fixed
    length are unrolled, those over ``a.shape`` are not.
    """
    compiled: Any = njit(function, error_model="numpy", boundscheck=False)
    with suppress(RuntimeError):  # no folder to write to: compiled in every process
        compiled._cache = _Cache(function)
    return cast(Kernel, compiled)


def inlined(function: Kernel) -> Kernel:
    """As :func:`jit`, for what is called in loops: a call of its own would take 20 ns an array."""
    return cast(Kernel, njit(function, error_model="numpy", boundscheck=False, forceinline=True))
