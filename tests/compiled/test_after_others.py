"""Runs after those of other scenes: the same bits as in a process of their own."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from random_scenes import MOTION

import skfem_cosserat as sc
from skfem_cosserat.compiled import plan


def rod(elements=6, order=1, joint=sc.JointRevolute, E=5e6, length=1.0, x=(0, 0, 0), spring=False):
    """A rod on a joint: numbers first, then what makes another structure of it."""
    x = np.array(x, dtype=float)
    mesh = sc.MeshCurve.init_line(x, x + (length, 0, 0), elements, name="rod")
    model = sc.Model()
    section = sc.SectionCircle(0.01, sc.Material(E, 0.5, 1e3))
    beam = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 1, 0)))
    axis = {} if joint is sc.JointSpherical else {"axis": (0, 0, 1)}
    model.add("joint", joint(sc.ground(x), beam.node("rod.start"), **axis))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0.5)))
    if spring:
        place = sc.ground(x + (length, 1.0, 0))
        model.add("spring", sc.SpringDamper(place, beam.node("rod.end"), stiffness=1.0))
    return model


#: of the same structure, and of others that are nearly the same
SAME = ({"E": 7e6}, {"length": 1.3}, {"x": (0.2, 0.1, -0.3)})
OTHERS = (
    *({"elements": 7}, {"order": 2}, {"joint": sc.JointSpherical}, {"spring": True}),
    {"joint": sc.JointCylindrical},
)


def moved(model, kernels, treatment):
    """Some steps: all that is compared."""
    run = sc.simulate(model, sc.EnergyMomentum(), treatment, 1e-3, 4e-3, kernels=kernels)
    return [run[name] for name in MOTION if name in run]


def test_places_of_blocks_in_a_plan():
    pytest.importorskip("numba")
    known = plan.plan_of(rod().freeze().joint_coordinates)
    with pytest.raises(KeyError, match="no such block"):
        known.slots([0], [6])
    u, v = known.ends.T
    assert known.slots(u, v).tolist() == list(range(len(known.ends)))
    assert known.slots([-1, 0], [0, -1]).tolist() == [-1, -1]


@pytest.mark.slow
def test_a_process_of_its_own_gives_the_same_bits(kernels):
    code = (
        "import sys, hashlib; sys.path[:] = sys.argv[2:]\n"
        "import test_after_others as t, skfem_cosserat as sc\n"
        "found = t.moved(t.rod(**t.SAME[1]), sys.argv[1], sc.NullSpace())\n"
        "print(hashlib.sha256(b''.join(a.tobytes() for a in found)).hexdigest())"
    )
    path = [str(Path(__file__).parent), *sys.path]
    command = [sys.executable, "-c", code, kernels, *path]
    alone = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    for options in ({}, *OTHERS):
        moved(rod(**options), kernels, sc.NullSpace())
    found = moved(rod(**SAME[1]), kernels, sc.NullSpace())

    assert hashlib.sha256(b"".join(a.tobytes() for a in found)).hexdigest() == alone
