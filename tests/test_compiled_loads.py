"""Compiled loads that follow the motion against the plain ones, and what they do to momenta."""

from __future__ import annotations

import numpy as np
import pytest
import test_compiled
import test_compiled_multipliers
from test_compiled import INTEGRATORS, tree

import skfem_cosserat as sc

pytest.importorskip("numba")
integrators = pytest.mark.parametrize("integrator", INTEGRATORS)
COMPARED = {"null space": test_compiled, "multipliers": test_compiled_multipliers}
treatments = pytest.mark.parametrize("treatment", COMPARED)


def dead_moments(model):
    """On a beam's end with a joint, on a body and inside a beam, one of them in time."""
    end = model["rod"].node("arc.end")
    model.add("m1", sc.LoadMoment(end, (0.9, -0.5, 1.4), sc.Table([0, 0.02, 1], [1, -2, 3])))
    model.add("m2", sc.LoadMoment(model["body"].at((1.6, 1.5, 0)), (0.7, 1.1, -0.4)))
    model.add("m3", sc.LoadMoment(model["rod"].node(1), (-0.3, 0.8, 1.0)))


def body_moments(model):
    """With components in the triad."""
    end = model["rod"].node("arc.end")
    model.add("m4", sc.LoadMoment(end, (0.5, 1.2, -0.7), follower=True))
    body = model["body"].at((1.6, 1.5, 0))
    model.add("m5", sc.LoadMoment(body, lambda t: (np.sin(30 * t), 1.0, 2.0), follower=True))


def body_forces(model):
    """At an offset, and at a beam's node."""
    body = model["body"].at((1.2, 1.9, 0.3))
    model.add("f1", sc.LoadForce(body, (2.0, -1.0, 1.5), lambda t: np.cos(9 * t), follower=True))
    model.add("f2", sc.LoadForce(model["rod"].node("arc.end"), (1.0, 3.0, -2.0), follower=True))


def section_forces(model):
    """A wind that turns with the sections."""
    table = sc.Table([0, 0.03, 1], [1, 4, 0])
    model.add("f3", sc.LoadLine(model["rod"], (0.5, 2.0, -1.0), table, follower=True))


def everything(model):
    for add in (dead_moments, body_moments, body_forces, section_forces):
        add(model)


LOADS = {
    each.__name__: each
    for each in (dead_moments, body_moments, body_forces, section_forces, everything)
}
loads = pytest.mark.parametrize("name", LOADS)


def loaded(name, order=2):
    return tree(order, LOADS[name])


@pytest.mark.parametrize("order", [1, 3])
@treatments
@integrators
def test_residual_and_increment_at_random_states(integrator, treatment, order):
    """Far from the solution: the tangent is that of the plain path."""
    compared = COMPARED[treatment].test_residual_and_increment_at_random_states
    compared(order, integrator, lambda order: loaded("everything", order))


@loads
@treatments
@integrators
def test_runs(integrator, treatment, name):
    """Fifty steps; reactions and work among what is compared."""
    compared = COMPARED[treatment]
    compared.assert_same(*compared.both(loaded(name), integrator, 1e-3, 0.05))
