"""A treatment of the constraints written outside of the package: what it has to give is enough."""

import numpy as np
import pytest
from test_statics import cantilever

import skfem_cosserat as sc
from skfem_cosserat.constraints import BoundTreatment
from skfem_cosserat.linear import LinearSolver
from skfem_cosserat.pattern import FrozenPattern

Z = (0, 0, 1)
SECTION = sc.Section((2e4, 2e4, 5e4, 40.0, 60.0, 30.0), mass=1.3, inertia=(2e-3, 3e-3))


class TreatmentFull(sc.Treatment):
    """All coordinates, and impulses of the constraint forces, by one full matrix."""

    name, reference = "full", "none"

    def bind(self, system, weight, large=False):
        return BoundFull(system, weight)


class BoundFull(BoundTreatment):
    def __init__(self, system, weight):
        super().__init__(system, weight)
        self.n, self.unknowns = system.n, system.n + system.m
        i, j = np.indices((self.unknowns, self.unknowns))
        self.solver = LinearSolver(FrozenPattern(i, j, i.shape))
        self.gap_terms = np.ones(system.m)

    def begin(self, y0, ground1, h, momentum=None):
        self.y0, self.ground1 = y0, ground1
        self.start = np.concatenate([y0[: self.system.rows].ravel(), np.zeros(self.system.m)])

    def guess(self, extrapolate):
        again = extrapolate and self.last is not None
        self.sought = self.start + (self.last if again else 0.0)

    @property
    def moved(self):
        return self.sought - self.start

    def configure(self):
        return np.concatenate([self.sought[: self.n].reshape(-1, 3), self.ground1])

    def reduce(self, R, y1):
        constraints = self.system.constraints
        self.left = constraints.jacobian(self.constraint_point(y1)).toarray()
        return np.concatenate([R.ravel() + self._forces(), constraints.values(y1)])

    def _forces(self):
        return self.left.T @ self.sought[self.n :]

    def pull(self, gradient):
        return np.concatenate([gradient.ravel(), np.zeros(self.system.m)])

    def matrix(self, blocks, R, y1, scaled=True):
        n, constraints = self.n, self.system.constraints
        out = np.zeros((self.unknowns, self.unknowns))
        for group, block in zip(self.system.groups, blocks, strict=False):
            full = block if isinstance(block, np.ndarray) else block.blocks()
            np.add.at(out, (group.dofs[:, :, None], group.dofs[:, None, :]), full)
        if len(blocks) > len(self.system.groups):
            a, b = (3 * self.system.coupled_rows.T)[..., None, None]
            xyz = np.arange(3)
            np.add.at(out, (a + xyz[:, None], b + xyz), blocks[-1])
        point = self.constraint_point(y1)
        curvature = constraints.curvature_values(self.sought[n:], point)
        where = constraints.curvature_rows, constraints.curvature_cols
        np.add.at(out, where, self.weight * curvature)
        out[:n, n:], out[n:, :n] = self.left.T, constraints.jacobian(y1).toarray()
        return self.solver.pattern.data(out.ravel())

    def displacement(self, increment, y1):
        return increment[: self.n].reshape(-1, 3)

    def move(self, increment):
        self.sought = self.sought + increment

    def impulse(self, R):
        return self._forces().reshape(-1, 3)


def arm():
    """A beam on a driven hinge, with a ball on a rod at its end, and a spring."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="rod")
    model = sc.Model()
    beam = model.add("beam", sc.Beam(mesh, SECTION, director=Z))
    model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), beam.node("rod.start"), axis=Z))
    ball = model.add("ball", sc.MassPoint(0.5, position=(1.5, 0, 0)))
    model.add("link", sc.JointDistance(beam.node("rod.end"), ball.place()))
    far = sc.ground((1.5, 0.4, 0.3))
    model.add("spring", sc.SpringDamper(far, ball.place(), stiffness=50.0, length=0.4))
    model.add("gravity", sc.LoadGravity((0.3, -9.81, 0.2)))
    return model.freeze()


@pytest.mark.one_quick
@pytest.mark.parametrize(
    "scheme",
    [sc.Variational(), sc.EnergyMomentum(), sc.EnergyDecaying(rate=0.1), sc.GeneralizedAlpha(0.8)],
    ids=lambda scheme: scheme.name,
)
def test_an_own_treatment_gives_the_motion_and_the_forces_of_the_built_in_ones(scheme):
    run = {"step": 5e-3, "until": 0.1, "kernels": "numpy"}
    own, *known = (
        sc.simulate(arm(), scheme, treatment, **run)
        for treatment in (TreatmentFull(), sc.NullSpace(), sc.Multipliers())
    )
    for other in known:
        assert own["q"] == pytest.approx(other["q"], abs=1e-10)
        force = other["constraint_force"]
        assert own["constraint_force"] == pytest.approx(force, abs=1e-7 * abs(force).max())


def test_an_own_treatment_finds_equilibria():
    model, tip = cantilever(SECTION, elements=3, order=1, director=Z)
    model.add("push", sc.LoadForce(tip, (0.0, -20.0, 5.0)))
    own, known = (
        sc.static(model, treatment, sc.LoadControl(steps=3))
        for treatment in (TreatmentFull(), sc.NullSpace())
    )
    assert own["q"] == pytest.approx(known["q"], abs=1e-10)


def test_what_a_treatment_has_to_give_is_little():
    assert len(BoundTreatment.__abstractmethods__) <= 9
    assert {name for name in vars(BoundFull) if callable(getattr(BoundFull, name))} >= set(
        BoundTreatment.__abstractmethods__
    )
