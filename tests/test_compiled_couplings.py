"""Compiled springs, dampers, cables and actuators against the plain ones; what they conserve."""

from __future__ import annotations

import pytest
import test_compiled
import test_compiled_multipliers
from test_couplings import INTEGRATORS, zoo

pytest.importorskip("numba")
integrators = pytest.mark.parametrize("integrator", INTEGRATORS)
COMPARED = {"null space": test_compiled, "multipliers": test_compiled_multipliers}
treatments = pytest.mark.parametrize("treatment", COMPARED)
SERIES = ("work_actuators", "dissipated", "work_drives", "turns", "coupling_energy")


@treatments
@integrators
def test_residual_and_increment_at_random_states(integrator, treatment):
    """Far from the solution: the tangent is that of the plain path."""
    compared = COMPARED[treatment].test_residual_and_increment_at_random_states
    compared(1, integrator, lambda order: zoo(scalar=True))


@pytest.mark.parametrize("shaken", [False, True])
@treatments
@integrators
def test_runs(integrator, treatment, shaken):
    """Fifty steps with all elements on all kinds of places; what they do in them is the same."""
    compared = COMPARED[treatment]
    system = zoo(3, moving=shaken, scalar=True)
    run = compared.both(system, integrator, 2e-3, 0.1)
    compared.assert_same(*run)
    plain, compiled = run
    for name in SERIES[:3]:
        size = max(1e-3, abs(plain[name]).max())
        assert abs(compiled[name] - plain[name]).max() < 1e-9 * size, name
    assert compiled["turns"].tolist() == plain["turns"].tolist()
