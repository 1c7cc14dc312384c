"""Compiled steps against the plain ones: increments, whole runs, kept factors, what goes wrong.

Loads, couplings, damping, theories and planes are compared in the tests of those.
"""

from __future__ import annotations

import numpy as np
import pytest
import test_drives
import test_joints
import test_time_functions
from helpers_kernels import (
    INTEGRATORS,
    TREATMENTS,
    assert_same,
    assert_same_iteration,
    both,
    chain,
    corner,
    integrators,
    moving,
    tree,
    with_kept_factors,
)
from helpers_scenes import (
    JOINTS,
    four_bar,
    full_section,
    lattice,
    lattice_mesh,
    random_tree,
    swing,
)
from rounding import EPS, ROOM, nudged

import skfem_cosserat as sc
from skfem_cosserat import Stepper
from skfem_cosserat.compiled import plan
from skfem_cosserat.compiled.numbers import DONE, GUESS, KNOWN
from skfem_cosserat.compiled.plan import Plan, _Graph
from skfem_cosserat.integrators import stepper
from skfem_cosserat.integrators.compiled_step import CompiledStep
from skfem_cosserat.integrators.scheme import StepOrigin
from skfem_cosserat.linear import SingularMatrixError

pytest.importorskip("numba")
SLOW = pytest.mark.slow
makes = pytest.mark.parametrize("make", [tree, corner])
#: compiling takes most of the time: most orders are among the slow tests
orders = pytest.mark.parametrize(
    ("treatment", "order"),
    [
        pytest.param(treatment, order, marks=() if order in quick else SLOW)
        for treatment, quick in (("null space", (1, 3)), ("multipliers", (1,)))
        for order in (1, 2, 3, 4)
    ],
)


def each(function):
    """Both integrators with each treatment."""
    return pytest.mark.parametrize("treatment", TREATMENTS)(integrators(function))


def solved(fast, state):
    """Steps that compiled kernels solve from a state on, of one that is asked for."""
    found = fast.advance(state, np.array([fast.h]), StepOrigin(fast.integrator.name, fast.h))
    return 0 if found is None else len(found)


# -- one state -------------------------------------------------------------------------------------


@pytest.mark.slow
@makes
@orders
@integrators
def test_residual_and_increment_at_random_states(order, integrator, treatment, make):
    """Of one iteration far from the solution, with all parts of the tangent at work."""
    assert_same_iteration(make(order), integrator, treatment, order)


def spokes(count):
    """Beams of one element that all start at a vertex, the first one clamped at its end."""
    rng = np.random.default_rng(count)
    ends = rng.standard_normal((3, count))
    points = np.hstack([np.zeros((3, 1)), ends / np.linalg.norm(ends, axis=0)])
    t = np.array([np.zeros(count, dtype=int), np.arange(1, count + 1)])
    mesh = sc.MeshCurve(points, t, _subdomains={f"s{k}": np.array([k]) for k in range(count)})
    model = sc.Model()
    beam = model.add("beam", sc.Beam(mesh, full_section(), director=(0.36, 0.48, 0.8)))
    model.add("clamp", sc.JointFixed(sc.ground(points[:, 1]), beam.node(1)))
    model.add("gravity", sc.LoadGravity((0.5, -0.3, -9.81)))
    return model.freeze()


@pytest.mark.one_quick
@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 9])
@integrators
def test_groups_of_elements_that_meet_at_a_vertex(integrator, count):
    """Four elements at a time, and what is left, all add to the same block."""
    assert_same_iteration(spokes(count), integrator, "null space", count)


# -- runs ------------------------------------------------------------------------------------------


@pytest.mark.slow
@makes
@orders
@integrators
def test_runs(order, integrator, treatment, make):
    assert_same(*both(make(order), integrator, treatment, 2e-3, 0.04))


@pytest.mark.slow
@pytest.mark.parametrize("kind", JOINTS, ids=lambda kind: kind.type)
@each
def test_every_joint(kind, integrator, treatment):
    """Between bodies, ground at rest and in motion, beam nodes and mass points."""
    assert_same(*both(test_joints.scene(kind)[0], integrator, treatment, 0.01, 0.1))


@pytest.mark.one_quick
@pytest.mark.parametrize("which", range(4))
@integrators
def test_each_joint_of_a_four_bar_driven(which, integrator, monkeypatch):
    """Also the one that closes the loop, whose row has the drive in it: kernels solve each step."""
    model = four_bar()
    model.add("motor", sc.JointDrive(model[f"pin {which}"], lambda t: 0.25 * np.sin(2 * t) ** 2))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    system = model.freeze()
    start = sc.initial_state(system)
    given = system, INTEGRATORS[integrator], sc.NullSpace(), 0.02
    plain = Stepper(*given, kernels="numpy")
    expected, state, beside = [start], start, nudged(start)
    for _ in range(20):
        expected.append(plain.advance(expected[-1]).state)
    monkeypatch.setattr(stepper, "newton", None)  # nothing else solves them
    found, other = (Stepper(*given, kernels="numba") for _ in range(2))
    for n in range(1, 21):
        state, beside = found.advance(state).state, other.advance(beside).state
        for name in ("q", "p"):
            a, b, c = (getattr(each, name) for each in (state, expected[n], beside))
            # each of a few iterations a step rounds in another order
            moved = max(3 * abs(a - c).max(), 15 * EPS * abs(b).max())
            assert abs(a - b).max() <= ROOM * n * moved, name


@pytest.mark.slow
@pytest.mark.parametrize("kind", test_drives.COORDINATES, ids=lambda kind: kind.type)
@each
def test_every_drive(kind, integrator, treatment):
    assert_same(*both(test_drives.scene(kind)[0], integrator, treatment, 0.01, 0.1))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 107))
@each
def test_random_trees(seed, integrator, treatment):
    assert_same(*both(random_tree(seed), integrator, treatment, 0.005, 0.05))


@pytest.mark.slow
@each
def test_deep_trees(integrator, treatment):
    system = chain(12)
    run = both(system, integrator, treatment, 2e-3, 0.04)
    assert_same(*run)
    if treatment == "multipliers":
        assert run[1].meta["solver"] == "blocks"
        assert run[1].meta["unknowns"] == system.n + system.m


def test_work_grows_with_the_length_of_a_chain():
    """The elimination of a tree fills in nothing, however deep."""
    works = []
    for count in (20, 40):
        system = chain(count)
        fast = CompiledStep(
            system.joint_coordinates, sc.EnergyMomentum(), 1e-3, sc.NewtonSettings()
        )
        works.append(fast.plan.work)
    assert works[1] <= 2 * works[0] + 1


# -- kept factors ----------------------------------------------------------------------------------


@pytest.mark.one_quick
@makes
@pytest.mark.parametrize(
    ("treatment", "order"),
    [
        *[("null space", 1), ("null space", 3), ("multipliers", 1)],
        *[pytest.param("multipliers", order, marks=SLOW) for order in (2, 3, 4)],
    ],
)
@integrators
def test_kept_factors_lead_to_the_same_motion(order, integrator, treatment, make):
    """With a fraction of the factorisations; energy is conserved as well as without."""
    runs = whole, kept = with_kept_factors(make(order), integrator, treatment, 1e-3, 0.1)
    assert kept["q"][-1] == pytest.approx(whole["q"][-1], abs=1e-9)
    iterations = [run["newton_iterations"].sum() for run in runs]
    factorisations = [run.meta["factorisations"] for run in runs]
    assert iterations[0] <= factorisations[0] <= iterations[0] + 3  # one look ahead
    assert factorisations[1] < 0.4 * factorisations[0] and iterations[1] < 3 * iterations[0]
    for run in runs:
        assert run["constraint_violation"].max() < 1e-12
        if integrator == "energy-momentum":
            assert abs(run["energy_balance"]).max() < 1e-10 * abs(run["energy"]).max()


@pytest.mark.one_quick
@integrators
def test_kept_factors_of_the_swing_with_multipliers(integrator):
    """Through kept factors and from better starts the same motion, with few factorisations."""
    system = swing(20)
    plain, compiled = both(system, integrator, "multipliers", 1e-2, 0.3, sc.initial_state(system))
    assert_same(plain, compiled)
    kept = sc.simulate(
        system, INTEGRATORS[integrator], sc.Multipliers(), 1e-2, 0.3, derive=False, kernels="numba"
    )
    assert abs(kept["q"] - plain["q"]).max() < 1e-10
    force = plain["constraint_force"][:-1]
    assert abs(kept["constraint_force"][:-1] - force).max() < 1e-6 * abs(force).max()
    assert kept.meta["factorisations"] < 0.8 * compiled.meta["factorisations"]


@integrators
def test_kept_factors_know_no_rotation_of_the_whole(integrator):
    """A ball that spins freely, 4 degrees a step: few factorisations serve for all orientations."""
    model = sc.Model()
    spin = (3.0, 4.0, 5.0)
    model.add("ball", sc.RigidBody.sphere(1.0, 0.2, angular_velocity=spin))
    system = model.freeze()
    run = sc.simulate(
        system, INTEGRATORS[integrator], sc.Multipliers(), 1e-2, 2.0, derive=False, kernels="numba"
    )
    assert abs(run["q"][-1] - run["q"][0]).max() > 0.5
    assert len(run) == 201 and run.meta["factorisations"] < 201 / 8


@integrators
def test_factors_that_do_not_do_are_given_up(integrator):
    """Steps so large that kept factors do not contract take as many iterations as without."""
    system = tree(1)
    start = moving(system)
    whole, kept = [
        sc.simulate(
            system, INTEGRATORS[integrator], sc.NullSpace(), 0.02, 0.4, start=start,
            kernels="numba", settings=sc.NewtonSettings(reuse=reuse), derive=False,
        )
        for reuse in (0, 4)
    ]  # fmt: skip
    assert kept["attempts"].max() == 1
    assert kept["q"][-1] == pytest.approx(whole["q"][-1], abs=1e-9)
    assert kept.meta["factorisations"] <= 1.2 * whole.meta["factorisations"]


@pytest.mark.slow
def test_kept_factors_that_grow_old():
    """At small steps one iteration a step seemed enough by the contraction of steps long ago.

    The errors added up to 1e-6 in a thousand steps, with a single factorisation. The rate has to
    be measured in each step.
    """
    section = sc.Section.from_constants(
        EA=1e6, GA=1e6, EI=(1e3, 1e3), GJ=1e3, mass=1.0, inertia=(10.0, 10.0)
    )
    model = sc.Model()
    corners = [(0, 0, 0), (10.0, 0, 0), (10.0, 10.0, 0)]
    mesh = sc.MeshCurve.init_polyline(corners, 4, name="frame", nodes={"elbow": 0.5})
    frame = model.add("frame", sc.Beam(mesh, section, order=1, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), frame.node("frame.start")))
    push = sc.Table([0, 1, 2], [0, 50.0, 0])
    model.add("push", sc.LoadForce(frame.node("elbow"), (0, 0, 1.0), push))
    run = model.freeze(), sc.EnergyMomentum(), sc.NullSpace(), 1 / 640, 1.5
    options = {"every": 96, "derive": False, "kernels": "numba"}
    kept, full = (
        sc.simulate(*run, settings=sc.NewtonSettings(reuse=reuse), **options) for reuse in (4, 0)
    )
    assert kept.meta["factorisations"] < 0.1 * full.meta["factorisations"]
    assert abs(kept["q"] - full["q"]).max() < 1e-9


# -- what may go wrong, and what goes on -----------------------------------------------------------


@pytest.mark.slow
@each
def test_a_step_that_fails_is_tried_again_the_general_way(integrator, treatment, monkeypatch):
    """With the same attempts, and the compiled kernels go on after it."""
    solved = CompiledStep._solved
    calls = []

    def sometimes(self, state, steps):
        calls.append(state.index)
        self._record[DONE] = 0
        return state.index not in (4, 5) and solved(self, state, steps)

    monkeypatch.setattr(CompiledStep, "_solved", sometimes)
    monkeypatch.setattr(CompiledStep, "takes_blocks", lambda self, time: False)
    run = both(tree(1), integrator, treatment, 2e-3, 0.03)
    assert len(calls) == 30  # each step of both compiled runs
    assert_same(*run)


@integrators
def test_solutions_that_have_turned_over_are_none(integrator):
    """A hinge's rows are fulfilled half a turn off as well: left to the general way."""
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (1, 0.3, 0.2)))
    model.add("pin", sc.JointRevolute(sc.ground((0, 0, 0)), body.at((0, 0, 0)), axis=(0, 0, 1)))
    system = model.freeze()
    method = INTEGRATORS[integrator]
    fast = CompiledStep(system.vertex_coordinates, method, 1e-2, sc.NewtonSettings(reuse=0))
    state = sc.initial_state(system)
    assert solved(fast, state)
    fast._a.last[0] = 0, 0, 0, np.pi, 0, 0  # about x: the axis points the other way
    fast._record[[KNOWN, GUESS]] = 1  # begin there
    assert not solved(fast, state)
    assert system.wrong_branch(fast.y1) is not None


@pytest.mark.slow
def test_a_run_that_diverges_keeps_its_history():
    system = tree(1)
    errors = []
    for kernels in ("numpy", "numba"):
        with pytest.raises(sc.Diverged) as caught:
            sc.simulate(
                system, sc.EnergyMomentum(), sc.NullSpace(), 0.6, 60.0, start=moving(system),
                kernels=kernels, derive=False, settings=sc.NewtonSettings(damped_iterations=20),
            )  # fmt: skip
        errors.append(caught.value)
    assert len(errors[0].history) == len(errors[1].history)
    assert errors[0].step == errors[1].step


@pytest.mark.slow
@each
def test_restart(integrator, treatment, kernels):
    """Kernels are no part of what a history needs to go on."""
    system = tree(1)
    run = system, INTEGRATORS[integrator], TREATMENTS[treatment], 2e-3
    options = {"derive": False, "kernels": "numba"}
    whole = sc.simulate(*run, 0.04, start=moving(system), **options)
    first = sc.simulate(*run, 0.02, start=moving(system), **options)
    again = sc.restart(system, first, run[1], 2e-3)
    rest = sc.simulate(*run, 0.04, start=again, derive=False, kernels=kernels)
    assert rest["q"][-1] == pytest.approx(whole["q"][-1], abs=1e-11)


@pytest.mark.one_quick
@each
def test_the_iteration_matrix_is_that_of_the_plain_kernels(integrator, treatment):
    """It was asked of a treatment that compiled steps had left behind: an AttributeError."""
    system = tree(1)
    state, found = moving(system), []
    run = system, INTEGRATORS[integrator], TREATMENTS[treatment], 1e-3
    for kernels in ("numpy", "numba"):
        stepper = sc.Stepper(*run, kernels=kernels)
        later = stepper.advance(stepper.advance(state).state).state
        matrix, report = stepper.iteration_matrix(later)
        found.append((matrix, report.state.q, stepper.advance(report.state).state.q))
    for plain, compiled in zip(*found, strict=True):
        assert compiled == pytest.approx(plain, rel=1e-9, abs=1e-10 * abs(plain).max())


# -- lattices: what elimination in blocks leaves is solved by a sparse solver ----------------------


def links(count, elements):
    """Vertices and pairs of a lattice."""
    mesh = lattice_mesh(count, elements)
    return mesh.p.shape[1], [tuple(pair) for pair in mesh.t.T.tolist()]


def test_only_insides_of_struts_are_eliminated_in_lattices():
    """A full elimination fills in: it is given up before it takes long."""
    count, pairs = links(8, 3)
    plan = Plan(count, pairs, [-1] * count)
    assert set(plan.rest) == set(range(8**3)) and plan.blocks == count - 8**3
    assert plan.work <= 4 * plan.blocks
    for v in plan.rest[:5]:  # joints are coupled with joints, through their struts
        near = plan.ends[plan.ends[:, 0] == v, 1]
        assert 3 <= ((near < 8**3) & (near != v)).sum() <= 6
    count, pairs = links(4, 3)  # a small one does not
    assert len(Plan(count, pairs, [-1] * count).rest) == 0
    assert len(Plan(count, pairs, [-1] * count, thin=True).rest) == 4**3


@pytest.mark.parametrize("seed", range(5))
def test_an_elimination_is_given_up_exactly_where_it_takes_too_much(seed):
    """It is stopped as soon as it does: never where there is just enough."""
    rng = np.random.default_rng(seed)
    count, pairs = links(7, 1) if seed == 0 else (300, rng.integers(0, 300, (700, 2)).tolist())
    whole, enough, less, early = (_Graph(count, pairs, [-1] * count, (), {}) for _ in range(4))
    assert whole.eliminate(count)
    work = sum(len(near) ** 2 for near in whole.later)
    assert enough.eliminate(count, work) and enough.order == whole.order
    assert not less.eliminate(count, work - 1)
    assert not early.eliminate(count, work // 4)
    assert sum(len(near) ** 2 for near in early.later) <= work // 4


def hung_lattice(order):
    """Two lattices and a body on hinges, in a row: joints of the tree are left to the solver."""
    model = sc.Model()
    section = full_section()
    previous = sc.ground((0, 0, 0))
    for k in range(2):
        mesh = lattice_mesh(2, 2, 0.5).translated((0.5 * k, 0.5 * k, 0.5 * k))
        beam = model.add(f"l{k}", sc.Beam(mesh, section, order=order, director=(0.36, 0.48, 0.8)))
        pin = sc.JointRevolute(previous, beam.node(0), axis=(0, 0.6, 0.8))
        model.add(f"pin{k}", pin)
        previous = beam.node(7)
    body = model.add("body", sc.RigidBody.sphere(0.5, 0.1, position=(1.2, 1.0, 1.0)))
    model.add("ball", sc.JointSpherical(previous, body.at((1.0, 1.0, 1.0))))
    point = model.add("point", sc.MassPoint(0.4, position=(1.2, 1.5, 1.0)))
    model.add("rope", sc.JointDistance(body.at((1.2, 1.1, 1.0)), point.place()))
    model.add("gravity", sc.LoadGravity((0.5, -0.3, -9.81)))
    return model.freeze()


@pytest.fixture
def filled(monkeypatch):
    """As if every network filled in too much; with nothing eliminated in blocks for `thin` -1."""

    def change(thin):
        monkeypatch.setattr(plan, "FILLED", 0)
        monkeypatch.setattr(plan, "THIN", thin)

    return change


@pytest.mark.slow
@pytest.mark.parametrize("thin", [-1, 0, 2])
@pytest.mark.parametrize("make", [tree, hung_lattice])
@integrators
def test_tangents_with_a_rest(integrator, make, thin, filled):
    """Increments as in the plain kernels, far from the solution, whatever is left."""
    filled(thin)
    assert_same_iteration(make(2), integrator, "null space", 2)
    fast = CompiledStep(
        make(2).joint_coordinates, INTEGRATORS[integrator], 1e-3, sc.NewtonSettings()
    )
    if thin < 2 or make is hung_lattice:
        assert fast.method.startswith("blocks, ") and len(fast.plan.rest) > 1


@pytest.mark.slow
@pytest.mark.parametrize("thin", [-1, 1])
@integrators
def test_all_kinds_of_joints_with_a_rest(integrator, thin, filled):
    """Whatever hangs on joints is turned into their coordinates before the solver gets it."""
    filled(thin)
    for kind in JOINTS:
        assert_same(*both(test_joints.scene(kind)[0], integrator, "null space", 0.01, 0.02))
    for kind in test_drives.COORDINATES:
        assert_same(*both(test_drives.scene(kind)[0], integrator, "null space", 0.01, 0.02))
    for seed in range(100, 103):
        assert_same(*both(random_tree(seed), integrator, "null space", 0.005, 0.02))


@pytest.mark.slow
@pytest.mark.parametrize("thin", [-1, 1])
@integrators
def test_loads_with_a_rest(integrator, thin, filled):
    filled(thin)
    system = tree(2, test_time_functions.everything)
    assert_same(*both(system, integrator, "null space", 1e-3, 0.02))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # fine meshes under tension
@pytest.mark.parametrize(
    ("count", "elements", "order"), [(5, 1, 1), (4, 4, 1), pytest.param(4, 2, 2, marks=SLOW)]
)
@integrators
def test_lattices(integrator, count, elements, order, filled):
    filled(2)
    system = lattice(count, elements, order)
    plain, compiled = both(system, integrator, "null space", 1e-4, 6e-4)
    assert_same(plain, compiled)
    assert compiled.meta["solver"].startswith("blocks, ")
    assert compiled.meta["factorisations"] == plain.meta["factorisations"]


# coarse struts, drawn too much
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
def test_solver_of_the_rest_is_forced():
    """Blocks alone would do here; with a solver that is asked for they leave all joints to it."""
    run = both(lattice(3), "energy-momentum", "null space", 1e-3, 4e-3, solver=sc.SolverDense())
    assert [history.meta["solver"] for history in run] == ["dense", "blocks, dense"]
    assert_same(*run)


def test_what_goes_wrong_in_the_rest(filled, monkeypatch):
    """Singular: left to the stepper, as a step that does not converge. Else: raised after it."""
    filled(-1)
    system, settings = tree(1), sc.NewtonSettings()
    state = moving(system)

    def raised(error):
        def fail(*arguments):
            raise error

        return fail

    for method in ("factor", "solve_again"):
        fast = CompiledStep(system.joint_coordinates, sc.EnergyMomentum(), 1e-3, settings)
        monkeypatch.setattr(fast.linear, method, raised(SingularMatrixError("singular")))
        assert not solved(fast, state)
        for error in (MemoryError("too large"), KeyboardInterrupt()):
            monkeypatch.setattr(fast.linear, method, raised(error))
            with pytest.raises(type(error)):
                solved(fast, state)
        monkeypatch.undo()
        filled(-1)
        assert solved(fast, state)


# coarse struts, drawn too much
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@integrators
def test_kept_factors_of_the_rest(integrator):
    """Kept over steps and given up just as those of an elimination of all in blocks."""
    system, h = lattice(3, 3), 2e-4
    start = moving(system)

    def run(reuse, solver):
        return sc.simulate(
            system, INTEGRATORS[integrator], sc.NullSpace(), h, 40 * h, start=start, derive=False,
            kernels="numba", settings=sc.NewtonSettings(reuse=reuse), solver=solver,
        )  # fmt: skip

    whole, blocks, rest = run(0, None), run(4, None), run(4, sc.SolverSuperLU())
    assert [each.meta["solver"] for each in (blocks, rest)] == [
        "blocks",
        "blocks, superlu-symmetric",
    ]
    assert rest["q"][-1] == pytest.approx(whole["q"][-1], abs=1e-11)
    assert rest.meta["factorisations"] == pytest.approx(blocks.meta["factorisations"], abs=2)
    # where what is left is the limit to rounding, an increment more is taken, or none
    apart = abs(rest["newton_iterations"] - blocks["newton_iterations"])
    assert apart.sum() <= 10
    assert rest.meta["factorisations"] < 0.6 * whole.meta["factorisations"]
