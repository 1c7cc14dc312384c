"""How the parts of the explicit loop are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

__all__ = ["close", "plain"]

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def _compiled(function: Kernel, **options: bool) -> Kernel:
    """IEEE arithmetic, except that products may be fused with sums."""
    kind: Any = {"error_model": "numpy", "no_cpython_wrapper": True, "fastmath": {"contract"}}
    made: Any = njit(function, **kind, **options)
    return cast(Kernel, made)


def plain(function: Kernel) -> Kernel:
    """For compiled code to call."""
    return _compiled(function)


def close(function: Kernel) -> Kernel:
    """The same, compiled into its callers: passing all arrays takes as long as the work."""
    return _compiled(function, forceinline=True)
