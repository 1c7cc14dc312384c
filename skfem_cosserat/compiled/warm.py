"""Compilation of the kernels of a scene by two processes on an empty cache.

Parts are compiled one by one, and kept on disk one by one. A helper does the same in reverse order,
for a small scene whose structures are of the same kinds; where both meet, the rest is read from the
disk. Whatever happens to the helper, nothing is lost but time.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .kept import entry
from .numbers import NUMBERS, RECORD
from .structures import STEPS, structure


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
    import subprocess

    arguments = f"{[*orders]}, {[*names]}"
    code = f"from skfem_cosserat.compiled.warm import main; main({arguments})"
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


def main(orders: Sequence[int], names: Sequence[str]) -> None:
    """Compile, as the helper, the loop over a step, then parts from the last to the first."""
    from ..beam import Beam
    from ..frames import ground
    from ..joint import JointRevolute
    from ..mesh import MeshCurve
    from ..model import Model
    from ..section import Material, SectionCircle
    from . import bind
    from .plan import plan_of

    model = Model()
    section = SectionCircle(0.01, Material(1e6, 0.3, 1e3))
    for k, order in enumerate(orders):
        mesh = MeshCurve.init_line((0, k, 0), (1, k, 0), 1, name=f"rod{k}")
        rod = model.add(f"rod {k}", Beam(mesh, section, order=order))
        hinge = JointRevolute(ground((0, k, 0)), rod.node(f"rod{k}.start"), axis=(0, 0, 1))
        model.add(f"hinge {k}", hinge)
    coordinates = model.freeze().joint_coordinates
    plan = plan_of(coordinates)
    w, work = bind.bound_work(coordinates, plan)
    s, m = bind.bound_tree(coordinates, plan)[0], bind.bound_plan(coordinates, plan)[0]
    given = s, m, w, bind.bound_groups(coordinates.system, plan)[0]
    numbers, places = np.zeros(len(NUMBERS)), np.zeros(0, dtype=np.int64)
    carried = bind.bound_carried(coordinates, work)[0]
    steps = places, *given, numbers, np.zeros(len(RECORD)), carried
    entry("step", "solve", structure("steps", dict(zip(STEPS, steps, strict=True))))
    for name in reversed(names):
        bind.addresses([name], given)
