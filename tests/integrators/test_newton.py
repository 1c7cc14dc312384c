"""The loop over the iterations: how it ends, and when factors are kept."""

from __future__ import annotations

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat import newton
from skfem_cosserat.linear import SingularMatrixError


class Script:
    """Increments and residuals that are written down beforehand, with fresh and kept factors."""

    def __init__(self, fresh, kept=(), size=0.0, regular=True, turn=0.0):
        self.fresh, self.kept, self.size = iter(fresh), iter(kept), size
        self.regular, self.turn, self.did = regular, turn, []

    def evaluate(self, sized):
        return self.size

    def factorise(self, mixed):
        self.did.append("factorise")
        return self.regular

    def direct(self, kept):
        self.did.append("kept" if kept else "fresh")
        return next(self.kept if kept else self.fresh), self.turn, 0

    def advance(self, sized, before):
        return self.size


LOOP = newton.newton_loop(Script.evaluate, Script.factorise, Script.direct, Script.advance)


def run(script, record=None, **changes):
    """How it ended, what was done, and the record."""
    settings = sc.NewtonSettings()
    own = {name: float(getattr(settings, name)) for name in newton.Limits._fields[:-2]}
    limits = newton.Limits(**own | {"worth": 5.0, "wrong": newton.WRONG} | changes)
    record = np.zeros(len(newton.RECORD)) if record is None else record
    return LOOP(script, limits, record), script.did, record


def kept_record(rate, first=1e-4):
    """Of a step before, whose factors are there."""
    record = np.zeros(len(newton.RECORD))
    record[[newton.KEPT, newton.RATE, newton.FIRST]] = 1.0, rate, first
    return record


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("script", "code"),
    [
        (Script([1e-2, 1e-5, 1e-13]), newton.SETTLED),
        (Script([1e-2], size=np.nan), newton.NOT_FINITE),
        (Script([1e-2], size=np.inf), newton.NOT_FINITE),
        (Script([1e-2], regular=False), newton.SINGULAR),
        (Script([np.nan]), newton.TOO_LONG),
        (Script([1e-2] * 50), newton.SPENT_ALL),
        (Script([1e-2, 1e-5, *[1e-13] * 30], size=1e-2), newton.SPENT_ALL),  # wrong all the same
        (Script([1e-2, 1e-5, *[1e-16] * 2], size=1.0), newton.SETTLED),  # rounding, as at rest
        (Script([1e-2, 1e-5, *[1e-16, 1e-2] * 30], size=1.0), newton.SPENT_ALL),  # a jump
        (Script([1e-2, 1e-5, *[1e-13] * 30], turn=2.0), newton.SPENT_ALL),  # scaled down each time
    ],
)
def test_how_it_ends(script, code):
    """A code for each way, and what is not finite never passes."""
    assert run(script, reuse=0.0)[0] == code


def test_increments_too_long_end_it():
    """Beyond what the settings allow."""
    assert run(Script([3.0]), largest=1.0)[0] == newton.TOO_LONG


def test_factors_of_the_step_before():
    """None is made as long as few iterations are expected with them."""
    script = Script([], [1e-4 * 1e-4**k for k in range(8)])
    code, did, record = run(script, kept_record(1e-4))
    assert code == newton.SETTLED and "factorise" not in did
    assert record[newton.STEPS] == 1 and record[newton.SPENT] == record[newton.ITERATIONS]


def test_stalled_increments_are_rounding_or_ask_for_new_factors():
    """Near rounding nothing shrinks any more; above, the factors are to blame."""
    code, did, _ = run(Script([], [1e-6, 1e-11, 2e-15, 1.9e-15]), kept_record(1e-5, 1e-6))
    assert code == newton.SETTLED and "factorise" not in did
    code, did, _ = run(Script([1e-6, 1e-14], [1e-6, 9e-7, 1e-17]), kept_record(1e-5, 1e-6))
    assert code == newton.SETTLED and did.count("factorise") >= 1


def test_not_a_number_with_kept_factors():
    """Asks for new ones, and ends there if these give no better."""
    code, did, _ = run(Script([np.nan], [np.nan]), kept_record(1e-5))
    assert code == newton.TOO_LONG and did == ["kept", "factorise", "fresh"]


class Root:
    """``x^3 = 2`` from a start, as a problem in Python."""

    def __init__(self, start):
        self.x = np.array([start])

    def residual(self):
        return float(abs(self.x[0] ** 3 - 2)) / max(2.0, abs(self.x[0]) ** 3)

    def direction(self):
        if self.x[0] == 0:
            raise SingularMatrixError("the slope is zero")
        return -(self.x**3 - 2) / (3 * self.x**2)

    def sizes(self, increment):
        return float(abs(increment[0])), 0.0

    def apply(self, increment):
        self.x = self.x + increment

    def save(self):
        return self.x

    def restore(self, saved):
        self.x = saved


@pytest.mark.parametrize("damped", [False, True])
def test_problems_in_python_take_the_same_loop(damped):
    """To the root, quadratically, and what happened is told."""
    problem = Root(1.0)
    report = newton.newton(problem, sc.NewtonSettings(), damped)
    assert report.converged and not report.reason and report.residual < 1e-15
    assert problem.x[0] == pytest.approx(2 ** (1 / 3), rel=1e-15)
    assert report.iterations == len(report.increments) == len(report.residuals) - 1
    report = newton.newton(Root(0.0), sc.NewtonSettings(), damped)
    assert not report.converged and report.reason == "the slope is zero"
    report = newton.newton(Root(1.0), sc.NewtonSettings(iterations=2, damped_iterations=2), damped)
    assert report.reason == "no convergence in 2 iterations"
