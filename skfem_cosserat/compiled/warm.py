"""Compilation of the kernels of a scene by two processes on an empty cache.

Parts are compiled one by one, and kept on disk one by one. A helper does the same in reverse order,
for a small scene whose structures are of the same kinds; where both meet, the rest is read from the
disk. Whatever happens to the helper, nothing is lost but time.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path


def processors() -> int:
    """Number of processors that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def helped(orders: Sequence[int], names: Sequence[str]) -> Iterator[None]:
    """While parts are compiled, in this order, a helper compiles them in reverse.

    Parameters
    ----------
    orders : sequence of int
        Of the beam elements.
    names : sequence of str
        Of the parts.
    """
    arguments = f"{[*orders]}, {[*names]}"
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
