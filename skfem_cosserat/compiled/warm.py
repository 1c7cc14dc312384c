"""Kernels on disk: whether those of a scene are there, and how two processes put them there.

Whether a scene's kernels can be had without compiling is found by reading them (a
:class:`Source` of :func:`.jit.ready`), as only numba knows for which processor and types it has
what. :func:`promising` tells without numba, whose import takes as long as a short run, whether to
try.

Compiling with two processes: parts are compiled one by one, and kept on disk one by one. On an
empty cache a helper does the same in reverse order, for a small scene whose structures are of the
same types; where both meet, the rest is read from the cache. Whatever happens to the helper,
nothing is lost but time.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any

__all__ = ["NotKept", "Source", "cold", "helped", "loaded", "promising", "stamp"]


class Source(IntEnum):
    """Where kernels may come from: this process alone, the disk, too, or even the compiler."""

    PROCESS = 0
    DISK = 1
    COMPILER = 2


class NotKept(Exception):
    """A kernel is in none of the places that it may come from."""


@cache
def stamp() -> str:
    """Of all sources that are compiled."""
    digest = hashlib.sha256()
    folder = Path(__file__).parent
    others = [folder.parent / name for name in ("newton.py", "law.py", "model/coordinates.py")]
    for path in [*sorted(folder.rglob("*.py")), *others]:
        digest.update(path.read_bytes())
    return digest.hexdigest()


def loaded() -> bool:
    """Whether this process has kernels."""
    return f"{__package__}.step" in sys.modules


def promising() -> bool:
    """Whether kernels of these sources may be on disk; numba is not imported for that.

    The loop over a step, which all scenes take, is looked for where numba keeps it.
    """
    if "numba" in sys.modules:
        return True
    here, given = Path(__file__).parent, os.environ.get("NUMBA_CACHE_DIR")
    if not given and not os.access(here, os.W_OK):
        return True  # then it is somewhere in the user's folders
    folders = Path(given).glob(f"{here.name}_*") if given else [here / "__pycache__"]
    pattern = f"step.solve-*.py{sys.version_info.major}{sys.version_info.minor}*.nbi"
    mark = stamp().encode()
    return any(mark in path.read_bytes() for folder in folders for path in folder.glob(pattern))


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
def helped(orders: Sequence[int], names: Sequence[str], family: str = "tree") -> Iterator[None]:
    """While parts are compiled, in this order, a helper compiles them in reverse.

    Parameters
    ----------
    orders : sequence of int
        Of the beam elements.
    names : sequence of str
        Of the parts.
    family : str
        Of the parts, see :func:`.bind.addresses`.
    """
    arguments = f"{[*orders]}, {[*names]}, {family!r}"
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
