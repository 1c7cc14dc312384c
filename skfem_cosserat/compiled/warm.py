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
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .jit import address

__all__ = ["cold", "helped", "main"]


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
def helped(order: int, names: Sequence[str]) -> Iterator[None]:
    """While parts are compiled, in this order, a helper compiles them in reverse.

    Parameters
    ----------
    order : int
        Of the beam elements.
    names : sequence of str
        Of the parts.
    """
    code = f"from skfem_cosserat.compiled.warm import main; main({order}, {[*names]})"
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


def main(order: int, names: Sequence[str]) -> None:
    """Compile the loop over a step, then parts from the last to the first."""
    from numba import typeof

    from ..beam import Beam
    from ..frames import ground
    from ..joint import JointRevolute
    from ..mesh import MeshCurve
    from ..model.scene import Model
    from ..section import Material, SectionCircle
    from . import bind, layout, step
    from .plan import plan_of

    # only types are needed: the constructors take seconds to compile
    for name in ("beams", "plan", "tree", "work"):
        setattr(layout, name, partial(layout.kind, name))
    model = Model()
    mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 1, name="rod")
    rod = model.add("rod", Beam(mesh, SectionCircle(0.01, Material(1e6, 0.3, 1e3)), order=order))
    model.add("hinge", JointRevolute(ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1)))
    system = model.freeze()
    plan = plan_of(system)
    kinds = (
        bind.bound_tree(system, plan)[0],
        bind.bound_plan(system, plan)[0],
        bind.bound_work(system, plan)[0],
        bind.bound_beams(system, system.beam_groups[0], plan)[0],
    )
    numbers, places = typeof(np.zeros(0)), typeof(np.zeros(0, dtype=np.int64))
    compiled: Any = step.solve
    compiled.compile((places, *kinds, numbers, numbers))
    for name in reversed(names):
        address(bind.part_named(name), *bind.signature(name, kinds))
