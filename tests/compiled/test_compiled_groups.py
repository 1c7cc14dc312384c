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
)
from helpers_scenes import full_section

import skfem_cosserat as sc

pytest.importorskip("numba")


def joined(orders=(1, 2), damped=()):
    """Beams of these orders, one after the other at angles, the last one with a body at its end.

    Those of the numbers `damped` are viscous. They hang from a pin, the body from a hinge.
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
        else:
            model.add("pin", sc.JointRevolute(node, beam.node("m0.start"), axis=(0, 0, 1)))
        node = beam.node(f"m{k}.end")
    body = model.add("body", sc.RigidBody.box(0.7, (0.2, 0.1, 0.1), position=end))
    model.add("hinge", sc.JointRevolute(node, body.at(end), axis=(0, 0, 1)))
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
@pytest.mark.parametrize(
    ("integrator", "treatment", "damped"),
    [("variational", "multipliers", (0, 1)), ("energy-momentum", "null space", (1,))],
)
def test_viscous_sections(integrator, treatment, damped):
    """Of all groups, or of some; what they take is counted."""
    system = joined(damped=damped)
    assert_same(*both(system, integrator, treatment, 2e-3, 0.04))
    assert_same_in_steps_of_other_sizes(system, integrator, treatment)


@pytest.mark.slow
def test_all_orders():
    assert_same(*both(joined((3, 1, 4, 2)), "energy-momentum", "null space", 2e-3, 0.04))
