"""Compiling with two processes: a helper fills the cache on disk from the other end.

Parts are compiled one by one, and kept on disk one by one. On an empty cache a second process does
the same in reverse order, for a small scene whose structures are of the same types; where both
meet, the rest is read from the cache. Whatever happens to the helper, nothing is lost but time.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

__all__ = ["cold", "help_compiling", "main"]


def processors() -> int:
    """As many as this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def cold(functions: Sequence[Any]) -> bool:
    """Whether the cache on disk holds none of these, and there is one."""
    caches = [f._cache for f in functions]
    files = [getattr(c, "_cache_file", None) for c in caches]
    return all(f is not None and not Path(f._index_path).exists() for f in files)


def help_compiling(order: int, weight: float, ends: bool, names: Sequence[str]) -> Any:
    """Start the helper, if there is a processor for it; None: there is not.

    Parameters
    ----------
    order : int
        Of the beam elements.
    weight, ends
        See :func:`.bind.addresses`.
    names : sequence of str
        Of the parts, in the order in which they are compiled here.
    """
    if processors() < 2:
        return None
    code = f"from skfem_cosserat.compiled.warm import main; main({order}, {weight}, {ends}, {[*names]})"
    with suppress(OSError):
        return subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
    return None
