"""Compilation of kernels in the process that :mod:`.warm` starts as its helper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..beam import Beam
from ..frames import ground
from ..joint import JointRevolute
from ..mesh import MeshCurve
from ..model import Model
from ..model.system import Coordinates
from ..section import Material, SectionCircle
from . import bind
from .kept import entry
from .numbers import NUMBERS, RECORD
from .plan import Plan, plan_of
from .structures import STEPS, structure


def main(orders: Sequence[int], names: Sequence[str]) -> None:
    """Compile the loop over a step, then parts from the last to the first."""
    model = Model()
    section = SectionCircle(0.01, Material(1e6, 0.3, 1e3))
    for k, order in enumerate(orders):
        mesh = MeshCurve.init_line((0, k, 0), (1, k, 0), 1, name=f"rod{k}")
        rod = model.add(f"rod {k}", Beam(mesh, section, order=order))
        hinge = JointRevolute(ground((0, k, 0)), rod.node(f"rod{k}.start"), axis=(0, 0, 1))
        model.add(f"hinge {k}", hinge)
    coordinates = model.freeze().joint_coordinates
    plan = plan_of(coordinates)
    given = structures_of(coordinates, plan)
    work = bind.bound_work(coordinates, plan)[1]
    numbers, places = np.zeros(len(NUMBERS)), np.zeros(0, dtype=np.int64)
    carried = bind.bound_carried(coordinates, work)[0]
    steps = places, *given, numbers, np.zeros(len(RECORD)), carried
    entry("step", "solve", structure("steps", dict(zip(STEPS, steps, strict=True))))
    for name in reversed(names):
        bind.addresses([name], given)


def structures_of(coordinates: Coordinates, plan: Plan) -> list[Any]:
    """Structures of a system that the parts are given."""
    s, w = bind.bound_tree(coordinates, plan)[0], bind.bound_work(coordinates, plan)[0]
    g = bind.bound_groups(coordinates.system, plan)[0]
    return [s, bind.bound_plan(coordinates, plan)[0], w, g]
