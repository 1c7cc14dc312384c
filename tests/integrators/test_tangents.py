"""Iteration matrices of whole steps against the complex step through their residuals."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_scenes import everything, random_state, random_tree, swing, triangle

from skfem_cosserat import (
    EnergyDecaying,
    EnergyMomentum,
    Multipliers,
    NullSpace,
    State,
    System,
    Variational,
)

INTEGRATORS = [Variational(), EnergyMomentum()]
TREATMENTS = [NullSpace(), Multipliers(), Multipliers(scaled=False)]
EPS = 1e-40
TOLERANCE = 1e-10


class Step:
    """A step of a scene at a random trial state."""

    def __init__(
        self, system: System, integrator, treatment, seed=0, h=0.05, t=0.35, size=0.3, q=None
    ):
        rng = np.random.default_rng(seed)
        self.system = system
        self.bound = treatment.bind(system, integrator.constraint_weight)
        q = random_state(system, rng, t, size) if q is None else q
        state = State(t, 0, q, rng.standard_normal(system.n))
        self.balance = integrator.balance(system, h)
        self.step = self.balance.begin(state)
        self.bound.begin(self.step.y0, system.ground(t + h), h)
        self.bound.guess(False)
        self.matrix()  # multipliers take their scale from the first matrix of a step
        self.bound.move(size * rng.standard_normal(self.bound.unknowns))
        self.residual()

    def residual(self):
        y1 = self.bound.configure()
        evaluation = self.balance.evaluate(self.step, y1)
        return self.bound.reduce(evaluation.R, y1), evaluation, y1

    def matrix(self, scaled=True):
        _, evaluation, y1 = self.residual()
        blocks = self.balance.tangent(self.step, evaluation)
        data = self.bound.matrix(blocks, evaluation.R, y1, scaled)
        return self.bound.solver.full(data)

    def derivative(self):
        """The same by the complex step, column by column."""
        out = np.empty((self.bound.unknowns,) * 2)
        sought = self.bound.sought
        for k in range(self.bound.unknowns):
            increment = np.zeros(self.bound.unknowns, dtype=complex)
            increment[k] = 1j * EPS
            self.bound.move(increment)
            out[:, k] = self.bound.scale_rows(self.residual()[0]).imag / EPS
            self.bound.sought = sought
        return out


def worst(found, wanted):
    """Largest error of a column against the largest entry of that column."""
    size = abs(wanted).max(0)
    assert (size > 0).all()
    return (abs(found - wanted).max(0) / size).max()


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("order", "swapped", "treatment"),
    [
        (1, False, NullSpace()),
        (1, True, Multipliers()),
        (2, True, NullSpace()),
        (2, False, Multipliers()),
        (3, False, NullSpace()),
        (4, True, NullSpace()),
    ],
)
@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda i: i.name)
def test_tangent_of_a_step_with_every_item(integrator, treatment, order, swapped):
    """Of beams of each order; the two sides of joints in either order."""
    step = Step(everything(order, swapped), integrator, treatment, seed=order)
    assert worst(step.matrix(), step.derivative()) < TOLERANCE


@pytest.mark.parametrize("integrator", [*INTEGRATORS, EnergyDecaying(0.3)], ids=lambda i: i.name)
def test_predicted_stresses_are_those_of_the_complex_step(integrator):
    """Those that the mixed iteration takes the geometric stiffness with, for any increment."""
    step = Step(everything(1), integrator, NullSpace(), seed=1)
    _, now, y1 = step.residual()
    change = np.random.default_rng(1).standard_normal((step.system.rows, 3))
    found = step.balance.predicted(step.step, now, change)
    y1 = y1.astype(complex)
    y1[: step.system.rows] += 1j * EPS * change
    later = step.balance.evaluate(step.step, y1)
    for S, before, moved in zip(found, now.stresses, later.stresses, strict=True):
        slope = moved.imag / EPS
        assert abs(S - before - slope).max() < TOLERANCE * abs(slope).max()


@pytest.mark.one_quick
@pytest.mark.parametrize("treatment", TREATMENTS, ids=["null-space", "scaled", "unscaled"])
@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda i: i.name)
@pytest.mark.parametrize("seed", [0, 1])
def test_tangent_of_random_trees(integrator, treatment, seed):
    step = Step(random_tree(seed), integrator, treatment, seed=seed)
    assert worst(step.matrix(), step.derivative()) < TOLERANCE


@pytest.mark.parametrize("treatment", TREATMENTS, ids=["null-space", "scaled", "unscaled"])
@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda i: i.name)
def test_tangent_of_the_swing(integrator, treatment):
    """Stiffness and mass differ by six powers of ten; the matrix is banded or sparse."""
    step = Step(swing(4), integrator, treatment, t=0.1, h=0.01, size=0.05)
    assert worst(step.matrix(), step.derivative()) < TOLERANCE


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda i: i.name)
def test_tangent_of_a_closed_loop(integrator):
    system = triangle().freeze()
    step = Step(system, integrator, Multipliers(), q=system.q0)
    assert worst(step.matrix(), step.derivative()) < TOLERANCE


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda i: i.name)
def test_unscaled_matrix_is_that_of_unscaled_multipliers(integrator):
    """The state is that of zero multipliers: their unit differs between the two."""
    system = everything(1)
    found = []
    for treatment in (Multipliers(), Multipliers(scaled=False)):
        step = Step(system, integrator, treatment)
        step.bound.sought = step.bound.sought[0], np.ones(system.m)
        found.append(step.matrix(scaled=False))
    assert abs(found[0] - found[1]).max() < 1e-12 * abs(found[1]).max()
