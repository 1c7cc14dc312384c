"""Compiled kernels of equilibria: an iteration, pivots and determinants, against the plain ones."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_kernels import corner
from test_couplings import zoo
from test_own_items import attraction
from test_static_kernels import linkage_in_plane, mobile
from test_statics import SPIN, assembly
from test_theories import cantilever

import skfem_cosserat as sc
from skfem_cosserat.integrators.choice import choose
from skfem_cosserat.integrators.compiled_step import kernel_coordinates
from skfem_cosserat.statics import problem as solver
from skfem_cosserat.statics.control import Functional, Point
from skfem_cosserat.statics.critical import inspect
from skfem_cosserat.statics.path import STATIC
from skfem_cosserat.statics.problem import CompiledEquations, PlainEquations, Problem, Schedule

pytest.importorskip("numba")


def attracted(order):
    """Two points of a frame pull at each other, and one at a place that goes away."""

    def add(model):
        nodes = model["beam"].node("c.end"), model["beam"].node("c.start")
        motion = sc.Motion(lambda t: (0.1 * t, 0.2 * t, 0.0))
        away = sc.ground((3, 0, 0), motion)
        model.add("pull", attraction(*nodes, 4.0, amplitude=lambda t: 1 + t))
        model.add("far", attraction(nodes[0], away, 3.0))

    return corner(order, add)


SCENES = {
    "mobile": mobile,
    "corner": corner,
    "springs": lambda order: zoo(1, moving=True),
    "assembly": assembly,
    "functions": attracted,
}


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("make", "spin"), [*((make, None) for make in SCENES.values()), (mobile, SPIN)]
)
def test_residual_and_increments_at_a_random_state(make, spin):
    """Far from equilibrium: loads, ground and target in the border, then predicted stresses."""
    system, t = make(2), 0.7
    rng = np.random.default_rng(1)
    schedule = Schedule(system, None, spin)
    start = Point(system.extend(system.q0, 0.0), 0.0)
    gradient = rng.standard_normal((system.rows, 3))
    target = Functional(gradient, 0.3, 0.1)
    bound = sc.NullSpace().bind(system, 1.0)
    rest = CompiledEquations(schedule, sc.NullSpace(), STATIC)
    plain, compiled = (
        Problem(equations, STATIC, start, target)
        for equations in (PlainEquations(bound, schedule), rest)
    )
    guess = 0.1 * rng.standard_normal(system.unknowns)
    bound.move(guess)
    rest._a.x.ravel()[rest._numbering] = guess
    for problem in (plain, compiled):
        problem.t = t
    exact = 1e-7  # derivatives are difference quotients: rounding over their step
    for tolerance in (1e-13, exact):
        sizes = [problem.residual() for problem in (plain, compiled)]
        assert sizes[1] == pytest.approx(sizes[0], rel=1e5 * tolerance)
        R = plain.equations.R
        assert compiled.equations.y == pytest.approx(plain.equations.y, abs=10 * tolerance)
        assert pytest.approx(R, abs=100 * tolerance * abs(R).max()) == rest.R
        r, y_t = plain.derivative()
        found, by_t = compiled.derivative()
        found = found.ravel()[rest._numbering]
        assert found == pytest.approx(r, abs=10 * exact * abs(r).max())
        assert by_t == pytest.approx(y_t, abs=10 * exact)
        one, other = plain.direction(), compiled.direction()
        size = abs(one).max()
        assert other[-1] == pytest.approx(one[-1], abs=50 * exact * size)
        assert other[:-1][rest._numbering] == pytest.approx(one[:-1], abs=50 * exact * size)
        assert compiled.sizes(other) == pytest.approx(plain.sizes(one), rel=50 * exact)
        for problem, increment in ((plain, one), (compiled, other)):
            problem.residual()
            problem.apply(increment)
        assert compiled.predicted == pytest.approx(plain.predicted, abs=10 * exact * size)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "theory"), [(1, sc.TheoryKirchhoff()), (2, sc.TheoryInextensible(torsion=False))]
)
def test_equilibria_with_held_strains(theory, order):
    """Their rows are among the unknowns of kernels, those of numpy fulfil them by themselves."""
    model = cantilever(theory, order, 4, load=(0, 30.0, 20.0))
    for treatment in (sc.NullSpace(), sc.Multipliers()):
        plain, compiled = (
            sc.static(model, treatment, sc.LoadControl(steps=3), kernels=kernels)
            for kernels in ("numpy", "numba")
        )
        assert compiled["q"] == pytest.approx(plain["q"], abs=1e-11)
        force, other = plain["constraint_force"], compiled["constraint_force"]
        assert other == pytest.approx(force, abs=1e-7 * abs(force).max())


def looks(system, treatment, schedule, t=0.0):
    """What is said of the stability of an equilibrium by pivots of kernels, and without them."""
    choice = choose("numba", kernel_coordinates(system, treatment), None, 0.0)
    path = solver.PathSolver(system, treatment, schedule, STATIC, choice)
    start = Point(system.extend(system.q0, 0.0), 0.0)
    point = path.solve(start, Functional(None, 1.0, t))[0].point
    return [inspect(system, point, schedule.at(t), *by) for by in ((path.pivots(point),), ())]


@pytest.mark.parametrize("turned", [False, True])
def test_pivots_against_eigenvalues(turned):
    """Of a body on a joint at the end of a beam, hanging or upside down."""
    section = sc.Section([2e3, 1e3, 3e3, 200.0, 300.0, 150.0], mass=1.0, inertia=(1e-3, 1e-3))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=2, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    place = np.array([1.0, 0.5 if turned else -0.5, 0])
    body = model.add("body", sc.RigidBody.box(1.5, (0.1, 0.2, 0.3), position=place))
    end, axes = rod.node("rod.end"), {"axis_a": (1, 0, 0), "axis_b": (0, 0, 1)}
    model.add("joint", sc.JointUniversal(end, body.at(end.position), **axes))
    model.add("weight", sc.LoadGravity((0, -9.81, 0)))
    system = model.freeze()
    look, again = looks(system, sc.NullSpace(), Schedule(system, {"weight": 1.0}))
    assert look.firm
    K = look.tangent.K.toarray()
    assert look.unstable == (np.linalg.eigvalsh(0.5 * (K + K.T)) < 0).sum() == 2 * turned
    assert (look.unstable, look.neutral) == (again.unstable, again.neutral)
    assert look.smallest == pytest.approx(again.smallest, rel=1e-9)


@pytest.mark.parametrize("push", [-20.0, 20.0])
@pytest.mark.parametrize("scene", ["loop", "loop in plane"])
@pytest.mark.parametrize("treatment", [sc.NullSpace(), sc.Multipliers()], ids=lambda t: t.name)
def test_pivots_of_closed_loops(scene, push, treatment):
    """Of a linkage on a spring, pulled up or pushed down: as many as without the loops' motions."""
    system = linkage_in_plane((0, push, 0)).freeze(planar=None if scene == "loop" else sc.Planar())
    look, again = looks(system, treatment, Schedule(system, {"push": 1.0}))
    assert look.firm and look.unstable == again.unstable == (push < 0)


@pytest.mark.parametrize("push", [2.0, 3.0])
@pytest.mark.parametrize("follower", [False, True])
def test_sign_of_the_determinant(push, follower):
    """Of a rod below and above its critical push 2.47, with a moment that is not conservative."""
    section = sc.Section.from_constants(
        EA=1e4, GA=1e4, EI=(20, 1.0), GJ=1.0, mass=1.0, inertia=(1e-4, 1e-4)
    )
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=2, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    end = rod.node("rod.end")
    model.add("push", sc.LoadForce(end, (-push, 0, 0)))
    model.add("twist", sc.LoadMoment(end, (0.01, 0.001, 0.0), follower=follower))
    system = model.freeze()
    look, again = looks(system, sc.NullSpace(), Schedule(system), 1.0)
    assert look.firm and not again.firm
    assert look.unstable == again.unstable == (push > 2.5)
    assert not look.symmetric and not again.symmetric
