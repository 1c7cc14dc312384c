"""Frequencies and shapes about deformed, prestressed and turning states; the tangent below them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers_scenes import everything, random_state, random_tree
from test_closed_loops import SCENES, frozen
from test_couplings import zoo

import skfem_cosserat as sc
from skfem_cosserat.diagnostics.tangent import null_space_matrix, reduced_tangent
from skfem_cosserat.model.balance import Spin, amplitudes_at, balance
from skfem_cosserat.model.chart import Chart
from skfem_cosserat.model.loops import closed, tree_values

# -- the tangent -----------------------------------------------------------------------------------


def held(system, y, amplitudes, seed=0):
    """Balance at y with a dead force that makes it an equilibrium, with constraint forces."""
    at = balance(system, y, amplitudes)
    multipliers = np.random.default_rng(seed).standard_normal(system.m)
    carried = system.constraints.jacobian(y).T @ multipliers
    dead = at.R + carried.reshape(-1, 3)
    return replace(at, R=at.R - dead), dead


def along_chart(system, y, amplitudes, dead):
    """Derivative of ``P(y)^T R(y)`` along the chart by the complex step; no closed loops."""
    bound = sc.NullSpace().bind(system, 1.0)
    bound.begin(y, y[system.rows :], 1.0)
    bound.guess(False)
    saved = bound.save()
    out = np.empty((system.unknowns,) * 2)
    for k in range(system.unknowns):
        increment = np.zeros(system.unknowns, dtype=complex)
        increment[k] = 1e-40j
        bound.apply(increment)
        y1 = bound.configuration()
        R = balance(system, y1, amplitudes, before=y).R - dead
        out[:, k] = bound.residual(R, y1).imag / 1e-40
        bound.restore(saved)
    return out


def along_loops(system, y, amplitudes, dead, step=1e-3):
    """The same by differences of fourth order, loops closed anew.

    P at the displaced configurations is the nearest to the old one there is: a basis of its own
    in each of them may jump.
    """
    P0 = null_space_matrix(system, y)
    chart = Chart(system.kinematics)
    chosen = system.closure.select(y, tree_values(system, y))
    Z = system.closure.null_matrix(chosen)

    def residual(increment):
        chart.begin(y, y[system.rows :])
        chart.add(Z @ increment)
        y1, _ = closed(system, chart, chosen)
        basis = np.linalg.qr(null_space_matrix(system, y1).toarray())[0]
        R = balance(system, y1, amplitudes, before=y).R - dead
        return P0.T @ (basis @ (basis.T @ R.ravel()))

    out = np.empty((system.unknowns,) * 2)
    for k, e in enumerate(step * np.eye(system.unknowns)):
        near, far = residual(e) - residual(-e), residual(2 * e) - residual(-2 * e)
        out[:, k] = (8 * near - far) / (12 * step)
    return out


TURNING = Spin((0.7, -1.1, 2.3), (0.2, 0.1, -0.4))
TREES = {
    "every item": (lambda: everything(2), None),
    "every item, turning": (lambda: everything(1), TURNING),
    "random tree": (lambda: random_tree(3), None),
    "random tree, turning": (lambda: random_tree(4), TURNING),
    "springs": (lambda: zoo(0), None),
    "springs, turning": (lambda: zoo(1, moving=True), TURNING),
}


@pytest.mark.parametrize("scene", TREES)
def test_reduced_tangent_on_trees(scene):
    """With couplings, follower loads and a turning frame, by the complex step along the chart."""
    make, spin = TREES[scene]
    system = make()
    y = system.extend(random_state(system, np.random.default_rng(2), 0.3, 0.2), 0.3)
    amplitudes = replace(amplitudes_at(system, 0.3), spin=spin)
    at, dead = held(system, y, amplitudes)
    tangent = reduced_tangent(system, y, amplitudes, at)
    wanted = along_chart(system, y, amplitudes, dead)
    assert abs(tangent.K.toarray() - wanted).max() < 1e-12 * abs(wanted).max()
    assert abs(tangent.residual).max() < 1e-11
    assert (null_space_matrix(system, y) != tangent.P).nnz == 0


@pytest.mark.parametrize("scene", SCENES)
def test_reduced_tangent_with_closed_loops(scene):
    """Redundant rows as well: whichever multipliers balance the forces give the same."""
    system = frozen(scene)
    y = system.extend(system.q0, 0.0)
    amplitudes = replace(amplitudes_at(system, 0.0), spin=TURNING)
    at, dead = held(system, y, amplitudes)
    tangent = reduced_tangent(system, y, amplitudes, at)
    wanted = along_loops(system, y, amplitudes, dead)
    assert abs(tangent.K.toarray() - wanted).max() < 1e-8 * abs(wanted).max()
    K = tangent.K
    assert abs(K - K.T).max() < 1e-12 * abs(K).max()


def test_metric_measures_motions():
    """A turn by one radian has the size 1, a shift by the extent of the scene too."""
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (1, 2, 3)))
    model.add("stone", sc.MassPoint(1.0, (0, 0, 4)))
    del body
    system = model.freeze()
    y = system.extend(system.q0, 0.0)
    metric = reduced_tangent(system, y, amplitudes_at(system, 0.0)).metric.toarray()
    assert abs(metric - np.diag([1 / 16] * 3 + [1.0] * 3 + [1 / 16] * 3)).max() < 1e-15
