"""Constraint rows with multipliers as blocks of the elimination.

Blocks of vertices are not regular by themselves where bodies leave a rotation to their joints.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from helpers_kernels import (
    TREATMENTS,
    assert_same,
    assert_same_iteration,
    both,
    integrators,
)

import skfem_cosserat as sc
from skfem_cosserat.integrators.compiled_step import CompiledStep

pytest.importorskip("numba")
CORNERS = np.array([(0, 0, 0), (0.3, 0, 1), (1.3, 0.4, 1.2), (1.2, 0.3, 0)])
FLAT = CORNERS * (1, 0, 1)


def rods(model: sc.Model, corners: Any) -> list[sc.RigidBody]:
    """Thin rods from one corner to the next."""
    found = []
    for k, (a, b) in enumerate(pairwise(corners)):
        place = {"position": (a + b) / 2, "triad": sc.triad(b - a)}
        body = sc.RigidBody.rod(1.0 + k, float(np.linalg.norm(b - a)), **place)
        found.append(model.add(f"rod {k}", body))
    model.add("gravity", sc.LoadGravity((0.3, 0.0, -9.81)))
    return found


def pendulum() -> sc.System:
    """On a hinge across it."""
    model = sc.Model()
    (rod,) = rods(model, FLAT[:2])
    model.add("pin", sc.JointRevolute(sc.ground(FLAT[0]), rod.at(FLAT[0]), axis=(0, 1, 0)))
    return model.freeze()


def four_bar() -> sc.System:
    """Hinges alone: three rows of the last one depend on others."""
    model = sc.Model()
    bars = rods(model, FLAT)
    ends = [sc.ground(FLAT[0]), *(bar.at(x) for bar, x in zip(bars, FLAT[1:], strict=True))]
    others = [*(bar.at(x) for bar, x in zip(bars, FLAT, strict=False)), sc.ground(FLAT[3])]
    for k, (a, b) in enumerate(zip(ends, others, strict=True)):
        model.add(f"hinge {k}", sc.JointRevolute(a, b, axis=(0, 1, 0)))
    return model.freeze()


def coupler() -> sc.System:
    """Only the row that closes the loop keeps the coupler from turning about its axis."""
    model = sc.Model()
    first, middle, last = rods(model, CORNERS)
    A, B, C, D = CORNERS
    along = (C - B) / np.linalg.norm(C - B)
    across = np.cross(along, (0, 1, 0)) / np.linalg.norm(np.cross(along, (0, 1, 0)))
    axes = {"axis_a": across, "axis_b": np.cross(across, along)}
    model.add("crank", sc.JointRevolute(sc.ground(A), first.at(A), axis=(0, 1, 0)))
    model.add("ball", sc.JointSpherical(first.at(B), middle.at(B)))
    model.add("rocker", sc.JointRevolute(sc.ground(D), last.at(D), axis=(0, 1, 0)))
    model.add("cross", sc.JointUniversal(middle.at(C), last.at(C), **axes))
    return model.freeze()


@pytest.mark.one_quick
@integrators
@pytest.mark.parametrize("treatment", TREATMENTS)
@pytest.mark.parametrize("make", [pendulum, four_bar, coupler])
def test_rods_without_inertia_about_their_axis(make, treatment, integrator, monkeypatch):
    """No step is left to the general way."""
    advance, solved = CompiledStep.advance, []

    def counted(self, state, times, origin):
        found = advance(self, state, times, origin)
        solved.extend([False] if found is None else [True] * len(found) + [False] * found.stuck)
        return found

    monkeypatch.setattr(CompiledStep, "advance", counted)
    system = make()
    run = both(system, integrator, treatment, 5e-3, 0.1, start=sc.initial_state(system))
    assert_same(*run, iterates=False)
    assert len(solved) >= 40 and all(solved)


@integrators
def test_an_iteration_of_a_thin_rod(integrator):
    """That of the matrix with rows and multipliers, by dense linear algebra."""
    assert_same_iteration(pendulum(), integrator, "multipliers", 3)
