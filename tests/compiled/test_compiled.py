"""Compiled steps against the plain ones: increments, whole runs, kept factors, what goes wrong.

Loads, couplings, damping, theories and planes are compared in the tests of those.
"""

from __future__ import annotations

from itertools import cycle

import numpy as np
import pytest
import test_drives
import test_joints
from helpers_kernels import (
    INTEGRATORS,
    TREATMENTS,
    assert_same,
    assert_same_iteration,
    both,
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
)

import skfem_cosserat as sc
from skfem_cosserat.compiled import plan

pytest.importorskip("numba")

PAIRS = [(integrator, treatment) for integrator in INTEGRATORS for treatment in TREATMENTS]


def each(function):
    """Both integrators with each treatment."""
    return pytest.mark.parametrize(("integrator", "treatment"), PAIRS)(function)


def paired(name, cases):
    """Each of these cases with one pair of integrator and treatment, in turn."""
    chosen = [(case, *pair) for case, pair in zip(cases, cycle(PAIRS), strict=False)]
    return pytest.mark.parametrize((name, "integrator", "treatment"), chosen)


# -- one state -------------------------------------------------------------------------------------


#: each pair with each kind of scene; the higher orders with one of them
ORDERS = [
    *((make, 1, *pair) for make in (tree, corner) for pair in PAIRS),
    (corner, 2, "variational", "null space"),
    (tree, 2, "energy-momentum", "multipliers"),
    (tree, 3, "variational", "null space"),
    (corner, 4, "energy-momentum", "null space"),
]
in_orders = pytest.mark.parametrize(("make", "order", "integrator", "treatment"), ORDERS)


@pytest.mark.slow
@in_orders
def test_residual_and_increment_at_random_states(make, order, integrator, treatment):
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
@pytest.mark.parametrize("count", [1, 3, 5, 9])
@integrators
def test_groups_of_elements_that_meet_at_a_vertex(integrator, count):
    """Four elements at a time, and what is left, all add to the same block."""
    assert_same_iteration(spokes(count), integrator, "null space", count)


# -- runs ------------------------------------------------------------------------------------------


@pytest.mark.slow
@in_orders
def test_runs(make, order, integrator, treatment):
    assert_same(*both(make(order), integrator, treatment, 2e-3, 0.04))


@pytest.mark.slow
@paired("kind", JOINTS)
def test_every_joint(kind, integrator, treatment):
    """Between bodies, ground at rest and in motion, beam nodes and mass points."""
    assert_same(*both(test_joints.scene(kind)[0], integrator, treatment, 0.01, 0.05))


@pytest.mark.one_quick
@pytest.mark.parametrize("which", range(4))
@integrators
def test_each_joint_of_a_four_bar_driven(which, integrator):
    """Also the one that closes the loop, whose row has the drive in it."""
    model = four_bar()
    model.add("motor", sc.JointDrive(model[f"pin {which}"], lambda t: 0.25 * np.sin(2 * t) ** 2))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    system = model.freeze()
    run = both(system, integrator, "null space", 0.02, 0.4, sc.initial_state(system))
    assert_same(*run, iterates=False)


@pytest.mark.slow
@paired("kind", test_drives.COORDINATES)
def test_every_drive(kind, integrator, treatment):
    assert_same(*both(test_drives.scene(kind)[0], integrator, treatment, 0.01, 0.1))


@pytest.mark.slow
@paired("seed", range(100, 108))
def test_random_trees(seed, integrator, treatment):
    assert_same(*both(random_tree(seed), integrator, treatment, 0.005, 0.05))


# -- kept factors ----------------------------------------------------------------------------------


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("make", "order", "integrator", "treatment"),
    [
        (tree, 1, "energy-momentum", "null space"),
        (corner, 3, "variational", "null space"),
        (tree, 2, "variational", "multipliers"),
        (corner, 4, "energy-momentum", "multipliers"),
    ],
)
def test_kept_factors_lead_to_the_same_motion(make, order, integrator, treatment):
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
def test_restart(integrator, treatment):
    """Kernels are no part of what a history needs to go on."""
    system = tree(1)
    run = system, INTEGRATORS[integrator], TREATMENTS[treatment], 2e-3
    first = sc.simulate(*run, 0.02, start=moving(system), derive=False, kernels="numba")
    again = sc.restart(system, first, run[1], 2e-3)
    whole = sc.simulate(*run, 0.04, start=moving(system), derive=False, kernels="numpy")
    for kernels in ("numpy", "numba"):
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
@pytest.mark.parametrize(
    ("make", "thin", "integrator"),
    [
        (tree, -1, "variational"),
        (tree, 0, "energy-momentum"),
        (hung_lattice, 0, "variational"),
        (hung_lattice, 2, "energy-momentum"),
    ],
)
def test_tangents_with_a_rest(integrator, make, thin, filled):
    """Increments as in the plain kernels, far from the solution, whatever is left."""
    filled(thin)
    assert_same_iteration(make(2), integrator, "null space", 2)


@pytest.mark.slow
@pytest.mark.parametrize(("thin", "integrator"), [(-1, "variational"), (1, "energy-momentum")])
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
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # fine meshes under tension
@pytest.mark.parametrize(
    ("count", "elements", "order", "integrator"),
    [(4, 1, 1, "energy-momentum"), (3, 4, 1, "variational"), (3, 2, 2, "energy-momentum")],
)
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
    assert rest.meta["solver"] == "blocks, superlu-symmetric"
    assert rest["q"][-1] == pytest.approx(whole["q"][-1], abs=1e-11)
    assert rest.meta["factorisations"] == pytest.approx(blocks.meta["factorisations"], abs=2)
    assert rest.meta["factorisations"] < 0.6 * whole.meta["factorisations"]
