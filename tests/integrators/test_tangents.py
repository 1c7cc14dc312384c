"""Iteration matrices of whole steps against the complex step through their residuals."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_scenes import everything, random_state, random_tree, rotation, swing, triangle

from skfem_cosserat import (
    EnergyMomentum,
    LoadGravity,
    LoadLine,
    LoadMoment,
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


@pytest.mark.one_quick
@pytest.mark.parametrize("treatment", TREATMENTS[:2], ids=lambda t: t.name)
@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda i: i.name)
def test_a_wrong_tangent_is_found(integrator, treatment, monkeypatch):
    """The comparison above notices an error of 1e-6 in the derivative of the loads."""
    system = everything(1)
    original = system.loading.add_tangent

    def wrong(blocks, y, amplitudes, factor):
        original(blocks, y, amplitudes, (1 + 1e-6) * factor)

    monkeypatch.setattr(system.loading, "add_tangent", wrong)
    step = Step(system, integrator, treatment)
    assert worst(step.matrix(), step.derivative()) > TOLERANCE


def test_loads_alone():
    """Derivative of every load that depends on the configuration, off the constraint set."""
    system = everything(2)
    loading, rng = system.loading, np.random.default_rng(5)
    amplitudes = rng.standard_normal(len(loading.times))
    y = system.extend(system.q0, 0.0)[: system.rows] + 0.2 * rng.standard_normal((system.rows, 3))
    blocks = [np.zeros_like(g.mass) for g in system.groups]
    loading.add_tangent(blocks, y, amplitudes, 1.0)
    K = np.zeros((system.n, system.n))
    for group, block in zip(system.groups, blocks, strict=True):
        for dofs, own in zip(group.dofs, block, strict=True):
            K[np.ix_(dofs, dofs)] += own
    wanted = np.empty_like(K)
    for k in range(system.n):
        z = y.astype(complex)
        z.reshape(-1)[k] += 1j * EPS
        wanted[:, k] = loading.force(z, amplitudes).ravel().imag / EPS
    assert abs(wanted).max() > 1
    assert abs(K - wanted).max() < 1e-12 * abs(wanted).max()


def virtual_power(system, y, amplitudes, q_rate):
    """Power of all loads at a velocity (rows, 3)."""
    f = system.loading.dead_force(amplitudes) + system.loading.force(y, amplitudes)
    return float((f * q_rate).sum())


def test_generalised_forces_do_the_work_of_forces_and_moments():
    """Rigid turn of a whole scene: power = resultant . v + moment about the origin . omega."""
    rng = np.random.default_rng(3)
    system = everything(2)
    R, t = rotation(rng), 0.7
    y = system.extend(system.q0, 0.0)[: system.rows] @ R.T  # about the origin
    a = system.loading.values(t)
    v, omega = rng.standard_normal((2, 3))
    rate = np.cross(omega, y)
    rate[system.origin_rows] += v
    force, moment = resultant(system, R, t)
    expected = force @ v + moment @ omega
    assert virtual_power(system, y, a, rate) == pytest.approx(expected, rel=1e-12)


def resultant(system, R, t):
    """Resultant of all loads and its moment about the origin, written down by hand."""
    force, moment = np.zeros(3), np.zeros(3)
    for load in system.loads:
        value = sum(unit * time.value(t) for unit, time in load.channels)
        if isinstance(load, LoadGravity):
            M = np.zeros((system.rows, 3))
            M[system.origin_rows] = value
            nodal = system.mass @ M
            y = system.extend(system.q0, 0.0)[: system.rows] @ R.T
            force += nodal[system.origin_rows].sum(0)
            moment += np.cross(y, nodal).sum(0)
        elif isinstance(load, LoadLine):
            basis = load.beam.basis
            x, w = np.polynomial.legendre.leggauss(8)
            N = basis.shape((x + 1) / 2)
            for e in load.elements:
                nodes = basis.connectivity[e]
                ds = basis.lengths[e] * w / 2
                triads = load.beam.rotations[e] @ load.beam.triads[nodes]
                for g in range(8):
                    axes = np.einsum("a,aij->ij", N[:, g], triads)
                    f = value @ axes @ R.T if load.follower else value
                    place = N[:, g] @ basis.nodes[nodes] @ R.T
                    force += ds[g] * f
                    moment += ds[g] * np.cross(place, f)
        else:
            turned = load.place.triad @ R.T if load.place.triad is not None else None
            f = value @ turned if load.follower else value
            if isinstance(load, LoadMoment):
                moment += f
            else:
                force += f
                moment += np.cross(load.place.position @ R.T, f)
    return force, moment
