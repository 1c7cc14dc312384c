"""Beams of several orders in one scene: compiled steps and equilibria against the plain ones."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_kernels import (
    assert_same,
    assert_same_in_steps_of_other_sizes,
    assert_same_iteration,
    both,
    integrators,
    treatments,
    with_kept_factors,
)
from helpers_scenes import full_section

import skfem_cosserat as sc
from skfem_cosserat.integrators.compiled_step import CompiledStep

pytest.importorskip("numba")


def joined(orders=(1, 2), damped=(), held=False):
    """Beams of these orders, one after the other at angles, the last one with a body at its end.

    Those of the numbers `damped` are viscous. They hang from a pin, the body from a hinge; `held`:
    both are fixed.
    """
    plain = full_section()
    model, end = sc.Model(), np.zeros(3)
    node: sc.Place = sc.ground(end)
    for k, order in enumerate(orders):
        start = end
        end = start + (0.8, 0.5 * (-1) ** k, 0.2 * k)
        section = plain.damped(time=2e-3) if k in damped else plain
        mesh = sc.MeshCurve.init_line(start, end, 2 + k, name=f"m{k}")
        beam = model.add(f"b{k}", sc.Beam(mesh, section, order=order, director=(0, 0, 1)))
        if k:
            model.add(f"joint {k}", sc.JointFixed(node, beam.node(f"m{k}.start")))
        elif held:
            model.add("clamp", sc.JointFixed(node, beam.node("m0.start")))
        else:
            model.add("pin", sc.JointRevolute(node, beam.node("m0.start"), axis=(0, 0, 1)))
        node = beam.node(f"m{k}.end")
    body = model.add("body", sc.RigidBody.box(0.7, (0.2, 0.1, 0.1), position=end))
    hinge = sc.JointRevolute(node, body.at(end), axis=(0, 0, 1))
    model.add("hinge", sc.JointFixed(node, body.at(end)) if held else hinge)
    model.add("gravity", sc.LoadGravity((0.5, -9.81, -0.3)))
    system = model.freeze()
    assert len(system.beam_groups) == len(set(orders))
    return system


@pytest.mark.slow
@treatments
@integrators
def test_residual_and_increment_at_random_states(integrator, treatment):
    assert_same_iteration(joined(), integrator, treatment, 7)


@pytest.mark.one_quick
@treatments
@integrators
def test_runs(integrator, treatment):
    assert_same(*both(joined(), integrator, treatment, 2e-3, 0.04))


@pytest.mark.slow
@pytest.mark.parametrize("damped", [(0, 1), (1,)])
@treatments
@integrators
def test_viscous_sections(integrator, treatment, damped):
    """Of all groups, or of some; what they take is counted."""
    system = joined(damped=damped)
    assert_same(*both(system, integrator, treatment, 2e-3, 0.04))
    assert_same_in_steps_of_other_sizes(system, integrator, treatment)


@integrators
def test_kept_factors(integrator):
    whole, kept = with_kept_factors(joined((1, 2)), integrator, "null space", 1e-3, 0.05)
    assert kept["q"][-1] == pytest.approx(whole["q"][-1], abs=1e-9)
    assert kept.meta["factorisations"] < 0.4 * whole.meta["factorisations"]


@pytest.mark.slow
def test_equilibria():
    system = joined(held=True)
    plain, compiled = (
        sc.static(system, control=sc.LoadControl(0.2, longest=0.05), kernels=kernels)
        for kernels in ("numpy", "numba")
    )
    assert (plain.meta["kernels"], compiled.meta["kernels"]) == ("numpy", "numba")
    assert plain["newton_iterations"].tolist() == compiled["newton_iterations"].tolist()
    assert abs(plain["q"] - compiled["q"]).max() < 1e-11


@pytest.mark.slow
def test_all_orders():
    assert_same(*both(joined((3, 1, 4, 2)), "energy-momentum", "null space", 2e-3, 0.04))


@pytest.mark.parametrize("tied", [True, False])
def test_steps_are_compiled_once_for_whatever_groups(tied):
    """Their loop knows no orders: the type of what it takes is the same."""
    from numba import typeof

    scenes = joined((1, 2)), joined((2, 1), damped=(0,)), joined((1, 2, 1))
    own = sc.EnergyMomentum(), 1e-3, sc.NewtonSettings()
    kinds = [s.joint_coordinates if tied else s.vertex_coordinates for s in scenes]
    made = [CompiledStep(each, *own) for each in kinds]
    assert len({typeof(fast._all[-2]) for fast in made}) == 1
