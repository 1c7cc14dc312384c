"""Compiling with two processes: a helper fills the cache on disk from the other end.

Parts are compiled one by one, and kept on disk one by one. On an empty cache a second process does
the same in reverse order, for a small scene whose structures are of the same types; where both
meet, the rest is read from the cache. Whatever happens to the helper, nothing is lost but time.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

__all__ = ["cold", "helped"]


def processors() -> int:
    """As many as this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def cold(functions: Sequence[Any]) -> bool:
    """Whether there is a cache on disk, and none of these functions is in it."""
    files = [getattr(f._cache, "_cache_file", None) for f in functions]
    return all(f is not None and not Path(f._index_path).exists() for f in files)


@contextmanager
def helped(order: int, names: Sequence[str], family: str = "tree") -> Iterator[None]:
    """While parts are compiled, in this order, a helper compiles them in reverse.

    Parameters
    ----------
    order : int
        Of the beam elements.
    names : sequence of str
        Of the parts.
    family : str
        Of the parts, see :func:`.bind.addresses`.
    """
    arguments = f"{order}, {[*names]}, {family!r}"
    code = f"from skfem_cosserat.compiled.helper import main; main({arguments})"
    helper = None
    # embedded in another program, the executable may be anything
    if processors() > 1 and Path(sys.executable).stem.lower().startswith(("python", "pypy")):
        path = os.pathsep.join(filter(None, sys.path))
        none = subprocess.DEVNULL
        try:
            helper = subprocess.Popen(
                [sys.executable, "-c", code],
                env={**os.environ, "PYTHONPATH": path},
                stdin=none,
                stdout=none,
                stderr=none,
            )
        except OSError:
            helper = None
    try:
        yield
    finally:
        if helper is not None:
            helper.kill()  # files get into the cache whole or not at all
            helper.wait()
