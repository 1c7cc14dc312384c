"""What compiled steps of beams that hold strains save: blocks, and looks at closed loops."""

from __future__ import annotations

import pytest
from test_theories import cantilever, swing

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.integrators.compiled_step import CompiledStep

pytest.importorskip("numba")


@pytest.mark.slow
@pytest.mark.filterwarnings(
    "ignore::skfem_cosserat.PerformanceWarning"
)  # full matrices, to compare with
def test_long_beams_cost_as_much_as_their_elements():
    """Blocks and products of blocks, not a full matrix; same motion as with multipliers."""
    made = {}
    for count in (100, 200):
        system = cantilever(sc.TheoryInextensible(), 1, count, load=(0, 30.0, 20.0)).freeze()
        fast = CompiledStep(
            system.joint_coordinates, sc.EnergyMomentum(), 1e-2, sc.NewtonSettings()
        )
        made[count] = fast.plan.work, fast._a.A.shape[0]
    for long, short in zip(made[200], made[100], strict=True):
        assert long == pytest.approx(2 * short, rel=0.02)
    runs = [
        sc.simulate(system, sc.EnergyMomentum(), treatment, 1e-2, 0.05, kernels=kernels)
        for treatment, kernels in ((sc.NullSpace(), "numba"), (sc.Multipliers(), "numpy"))
    ]
    assert abs(runs[0]["q"] - runs[1]["q"]).max() < 1e-10


@pytest.mark.slow
def test_closed_loops_are_looked_at_now_and_then():
    """Rows that close them are looked at when the motion asks for it, not in each step.

    And only chosen anew where they have come closer to each other, which they do not here.
    """
    system = swing().scene("stiff", theory=sc.TheoryInextensible()).freeze()
    stepper = sc.Stepper(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, kernels="numba")
    chosen, looks = [], []
    choose, clear = stepper._begin, stepper.bound.clear
    stepper._begin = lambda state, *more: (chosen.append(state.index), choose(state, *more))[1]
    stepper.bound.clear = lambda y: (looks.append(y), clear(y))[1]
    state = sc.initial_state(system)
    for _ in range(300):
        state = stepper.advance(state).state
    assert 0.02 < stepper.bound.clearance < 0.2
    assert chosen == [0] and 2 < len(looks) < 30
    violation = diagnostics.constraint_violation(system, state.q, state.time)
    assert violation < 1e-12
