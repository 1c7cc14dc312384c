"""Compiled kernels against the plain ones: states, increments, whole runs, and which are chosen."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
import states
import test_closed_loops
import test_drives
import test_joints
from helpers_scenes import (
    JOINTS,
    chequered,
    four_bar,
    full_section,
    lattice,
    lattice_mesh,
    random_tree,
    rotation,
)
from rounding import limits, nudged

import skfem_cosserat as sc
from skfem_cosserat.compiled import plan, warm
from skfem_cosserat.compiled.numbers import ROTATION
from skfem_cosserat.compiled.plan import Plan
from skfem_cosserat.integrators import choice
from skfem_cosserat.integrators.choice import refusal
from skfem_cosserat.integrators.compiled_step import CompiledStep
from skfem_cosserat.integrators.stepper import Stepper
from skfem_cosserat.linear import SingularMatrixError

numba = pytest.importorskip("numba")
TypingError = pytest.importorskip("numba.core.errors").TypingError
INTEGRATORS = {"variational": sc.Variational(), "energy-momentum": sc.EnergyMomentum()}
integrators = pytest.mark.parametrize("integrator", INTEGRATORS)
COMPARED = ("q", "p", "carried", "work_loads", "constraint_force")
SLOW = pytest.mark.slow
#: compiling takes most of the time: the even orders are among the slow tests
ORDERS = (1, pytest.param(2, marks=SLOW), 3, pytest.param(4, marks=SLOW))
FIRST = (1, *(pytest.param(order, marks=SLOW) for order in (2, 3, 4)))


# -- scenes ----------------------------------------------------------------------------------------


def tree(order, load=lambda model: None):
    """A pinned curved beam, a ball joint at its end to a body, and a mass point on a rope.

    `load` may add to the model.
    """
    rng = np.random.default_rng(order)
    model = sc.Model()
    mesh = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.2, 1.2, 3, name="arc")
    rod = model.add("rod", sc.Beam(mesh, full_section(), order=order, director=(0, 0, 1)))
    pin = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("arc.start"), axis=(0.6, 0.8, 0))
    model.add("pin", pin)
    tip = 1.2 * np.array([np.sin(1.2), 1 - np.cos(1.2), 0.0])
    inertia = np.array([[0.5, 0.06, -0.04], [0.06, 0.6, 0.09], [-0.04, 0.09, 0.45]])
    body = sc.RigidBody(
        1.5, inertia, center=(0.1, -0.2, 0.15), position=(1.6, 1.5, 0), triad=rotation(rng).T
    )
    model.add("body", body)
    model.add("ball", sc.JointSpherical(rod.node("arc.end"), body.at(tip)))
    point = model.add("point", sc.MassPoint(0.4, position=(1.6, 2.5, 0.1)))
    model.add("rope", sc.JointDistance(body.at((1.6, 1.6, 0)), point.place()))
    model.add("lump", sc.RigidBody.sphere(0.3, 0.1, on=rod.node("arc.end")))
    model.add("gravity", sc.LoadGravity((0.5, -0.3, -9.81)))
    model.add("push", sc.LoadForce(rod.node("arc.end"), (1.0, 2.0, 0.5), lambda t: np.sin(20 * t)))
    load(model)
    return model.freeze()


def crossing(order, load=lambda model: None):
    """Two beams rigidly connected at an angle: nodal triads that are not those of the section.

    `load` may add to the model.
    """
    points = [(0, 0, 0), (1, 0, 0), (1.3, 0.9, 0.2)]
    mesh = sc.MeshCurve.init_polyline(points, 2, name="c")
    model = sc.Model()
    beam = model.add("beam", sc.Beam(mesh, full_section(), order=order, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground(points[0]), beam.node("c.start")))
    model.add("gravity", sc.LoadGravity((0.5, -0.3, -9.81)))
    load(model)
    system = model.freeze()
    assert system.beam_groups[0].elements.rotations is not None
    return system


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


def moving(system, seed=4):
    """A start with some speed."""
    v = np.random.default_rng(seed).standard_normal(system.n)
    return sc.initial_state(system, v=sc.project(system, system.q0, v))


def both(system, integrator, h, until, **options):
    """Plain and compiled, which knows from a nudged start what is rounding."""
    start = moving(system)
    settings = sc.NewtonSettings(reuse=0)  # the same iterates
    plain, compiled, beside = (
        sc.simulate(
            system, INTEGRATORS[integrator], sc.NullSpace(), h, until, start=begin,
            derive=False, kernels=kernels, settings=settings, **options,
        )
        for begin, kernels in ((start, "numpy"), (start, "numba"), (nudged(start), "numba"))
    )  # fmt: skip
    compiled.meta["limits"] = limits(compiled, beside, COMPARED)
    return plain, compiled


def assert_same(plain, compiled, tolerance=1e-11):
    assert compiled.meta["kernels"] == "numba" and plain.meta["kernels"] == "numpy"
    assert compiled["newton_iterations"].tolist() == plain["newton_iterations"].tolist()
    assert compiled["attempts"].tolist() == plain["attempts"].tolist()
    assert_same_motion(plain, compiled, tolerance)


def assert_same_motion(plain, compiled, tolerance):
    if "limits" in compiled.meta:
        for name, limit in compiled.meta["limits"].items():
            assert np.nanmax(abs(compiled[name] - plain[name])) <= limit, name
        return
    for name in ("q", "p", "carried", "work_loads"):
        size = max(1.0, abs(plain[name]).max())
        assert abs(compiled[name] - plain[name]).max() < tolerance * size, name
    # stiff sections: forces are differences of large numbers
    force = plain["constraint_force"][:-1]
    difference = compiled["constraint_force"][:-1] - force
    assert abs(difference).max() < 1e4 * tolerance * abs(force).max()


@cache
def called(function):
    """What compiled code calls, for Python to call."""
    return numba.njit(lambda *arguments: function(*arguments))  # noqa: PLW0108


# -- one state -------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [tree, crossing])
@pytest.mark.parametrize("order", ORDERS)
@integrators
def test_residual_and_increment_at_random_states(order, integrator, make):
    """Of one iteration far from the solution, with all parts of the tangent at work."""
    assert_same_iteration(make(order), integrator, order)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 9])
@integrators
def test_groups_of_elements_that_meet_at_a_vertex(integrator, count):
    """Four elements at a time, and what is left, all add to the same block."""
    assert_same_iteration(spokes(count), integrator, count)


def assert_same_iteration(system, integrator, seed):
    h = 0.02
    method, settings = INTEGRATORS[integrator], sc.NewtonSettings()
    state = moving(system)
    stepper = Stepper(system, method, sc.NullSpace(), h, kernels="numpy")
    fast = CompiledStep(system, method, h, settings)
    begin, evaluate, matrix, increment = map(
        called, (fast._step.start, fast._step.evaluate, fast._step.matrix, fast._step.increment)
    )
    *rest, numbers = fast._all
    whole = *rest, numbers.copy()
    whole[-1][ROTATION] = np.inf  # as found: not scaled down for its rotations
    rng = np.random.default_rng(seed)
    for mixed in (False, True):
        guess = 0.1 * rng.standard_normal(system.unknowns)
        bound = stepper.bound
        bound.begin(system.extend(state.q, state.time), system.ground(state.time + h), h)
        bound.resume(guess)
        fast.resume(guess)
        bound.guess(True)
        problem = stepper.problem(method.begin(system, state, h))
        problem.residual()
        plain = problem.direction()
        assert bound.solver.solve is not None
        fast._begin(state)
        begin(*fast._all, 1)
        size = evaluate(*fast._all, 1)
        assert fast._a.y1 == pytest.approx(problem.y1, abs=1e-13)
        assert fast.balance == pytest.approx(
            problem.evaluation.R, abs=1e-12 * abs(problem.evaluation.R).max()
        )
        assert size == pytest.approx(bound.relative(problem._r, problem.evaluation.size), rel=1e-9)
        assert matrix(*fast._all, 0)
        increment(*whole, 0)
        found = fast._a.x.ravel()[fast._numbering]
        assert found == pytest.approx(plain, abs=1e-10 * abs(plain).max())
        if mixed:  # the next one with predicted stresses
            problem.apply(plain)
            problem.residual()
            assert problem._stresses is not None
            plain = problem.direction()
            assert fast._a.found[1] == 1
            evaluate(*fast._all, 1)
            assert matrix(*fast._all, 1)
            increment(*whole, 0)
            found = fast._a.x.ravel()[fast._numbering]
            assert found == pytest.approx(plain, abs=1e-9 * abs(plain).max())


# -- runs ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [tree, crossing])
@pytest.mark.parametrize("order", ORDERS)
@integrators
def test_runs(order, integrator, make):
    assert_same(*both(make(order), integrator, 2e-3, 0.06))


@pytest.mark.parametrize("kind", JOINTS, ids=lambda kind: kind.type)
@integrators
def test_every_joint(kind, integrator):
    """Between bodies, ground at rest and in motion, beam nodes and mass points."""
    assert_same(*both(test_joints.scene(kind)[0], integrator, 0.01, 0.1))


@pytest.mark.parametrize("kind", test_drives.COORDINATES, ids=lambda kind: kind.type)
@integrators
def test_every_drive(kind, integrator):
    assert_same(*both(test_drives.scene(kind)[0], integrator, 0.01, 0.1))


@pytest.mark.parametrize("seed", range(100, 108))
@integrators
def test_random_trees(seed, integrator):
    assert_same(*both(random_tree(seed), integrator, 0.005, 0.05))


def chain(count):
    """Links on ball joints and hinges in turn: a tree as deep as it is long."""
    model = sc.Model()
    previous = sc.ground((0, 0, 0))
    for k in range(count):
        link = sc.RigidBody.box(1.0, (0.05, 0.05, 0.3), position=(0.15 + 0.3 * k, 0, 0))
        model.add(f"link {k}", link)
        here = (0.3 * k, 0, 0)
        if k % 2:
            joint = sc.JointRevolute(previous, link.at(here), axis=(0, 1, 0))
        else:
            joint = sc.JointSpherical(previous, link.at(here))
        model.add(f"joint {k}", joint)
        previous = link.at((0.3 * (k + 1), 0, 0))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    return model.freeze()


@chequered("scene", test_closed_loops.SCENES, "integrator", INTEGRATORS)
def test_closed_loops_by_a_border(scene, integrator):
    """The same motion and forces, with the iterations of one Newton method for all equations."""
    system = test_closed_loops.frozen(scene)
    start = test_closed_loops.started(system)
    plain, *compiled = [
        sc.simulate(
            system, INTEGRATORS[integrator], sc.NullSpace(), 0.01, 0.1, start=start,
            derive=False, kernels=kernels, settings=sc.NewtonSettings(reuse=reuse),
        )
        for kernels, reuse in (("numpy", 0), ("numba", 0), ("numba", 4))
    ]  # fmt: skip
    for run in compiled:
        assert run.meta["kernels"] == "numba" and run["attempts"].max() == 1
        assert abs(run["q"] - plain["q"]).max() < 1e-12
        assert abs(run["p"] - plain["p"]).max() < 1e-10 * abs(plain["p"]).max()
        force = plain["constraint_force"][:-1]
        difference = run["constraint_force"][:-1] - force
        assert abs(difference).max() < 1e-8 * abs(force).max()


def test_a_step_with_closed_loops_that_flips_a_body_is_none():
    """At large steps forces of loops without bound turned a crank by 180 degrees in each step."""
    model = four_bar()
    model.add("gravity", sc.LoadGravity((1.0, -9.81, 0)))
    push = sc.Table([0, 0.03, 0.031, 1], [0, 5.0, 0, 1])
    model.add("push", sc.LoadForce(model["coupler"].at((1, 1.25, 0)), (0, 1.0, 0), push))
    system = model.freeze()
    v = 0.5 * system.length * np.random.default_rng(0).standard_normal(system.n)
    start = sc.initial_state(system, v=sc.project(system, system.q0, v))
    plain, *compiled = [
        sc.simulate(
            system, sc.EnergyMomentum(), sc.NullSpace(), 0.3, 6.0, start=start, derive=False,
            kernels=kernels, settings=sc.NewtonSettings(reuse=reuse),
        )
        for kernels, reuse in (("numpy", 0), ("numba", 0), ("numba", 4))
    ]  # fmt: skip
    for run in compiled:
        assert abs(run["q"] - plain["q"]).max() < 1e-10


@integrators
def test_deep_trees(integrator):
    assert_same(*both(chain(12), integrator, 2e-3, 0.05))


def test_work_grows_with_the_length_of_a_chain():
    """The elimination of a tree fills in nothing, however deep."""
    works = []
    for count in (20, 40):
        system = chain(count)
        fast = CompiledStep(system, sc.EnergyMomentum(), 1e-3, sc.NewtonSettings())
        works.append(fast.plan.work)
    assert works[1] <= 2 * works[0] + 1


@pytest.mark.parametrize("make", [tree, crossing])
@pytest.mark.parametrize("order", [1, 3])
@integrators
def test_kept_factors_lead_to_the_same_motion(order, integrator, make):
    """With a fraction of the factorisations; energy is conserved as well as without."""
    system = make(order)
    start = moving(system)
    runs = [
        sc.simulate(
            system, INTEGRATORS[integrator], sc.NullSpace(), 1e-3, 0.2, start=start,
            kernels="numba", settings=sc.NewtonSettings(reuse=reuse),
        )
        for reuse in (0, 4)
    ]  # fmt: skip
    whole, kept = runs
    assert kept["q"][-1] == pytest.approx(whole["q"][-1], abs=1e-9)
    iterations = [run["newton_iterations"].sum() for run in runs]
    factorisations = [run.meta["factorisations"] for run in runs]
    assert iterations[0] <= factorisations[0] <= iterations[0] + 3  # one look ahead
    assert factorisations[1] < 0.4 * factorisations[0] and iterations[1] < 3 * iterations[0]
    if integrator == "energy-momentum":
        for run in runs:
            assert abs(run["energy_balance"]).max() < 1e-10 * abs(run["energy"]).max()


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


@integrators
def test_a_step_that_fails_is_tried_again_the_general_way(integrator, monkeypatch):
    """With the same attempts, and the compiled kernels go on after it."""
    system = tree(1)
    solve = CompiledStep.solve
    calls = []

    def sometimes(self, state):
        calls.append(state.index)
        return None if state.index in (4, 5) else solve(self, state)

    monkeypatch.setattr(CompiledStep, "solve", sometimes)
    plain, compiled = both(system, integrator, 2e-3, 0.03)
    assert len(calls) == 32  # each step of both compiled runs, and the one after
    assert_same(plain, compiled)


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


@integrators
def test_restart(integrator, tmp_path):
    """Kernels are no part of what a history needs to go on."""
    system = tree(2)
    options = {"derive": False, "kernels": "numba"}
    pair = INTEGRATORS[integrator], sc.NullSpace()
    whole = sc.simulate(system, *pair, 2e-3, 0.04, start=moving(system), **options)
    first = sc.simulate(system, *pair, 2e-3, 0.02, start=moving(system), **options)
    rest = sc.simulate(
        system,
        *pair,
        2e-3,
        0.04,
        start=sc.restart(system, first, pair[0], 2e-3),
        derive=False,
        kernels="numpy",
    )
    assert rest["q"][-1] == pytest.approx(whole["q"][-1], abs=1e-11)


@pytest.mark.parametrize("treatment", [sc.NullSpace(), sc.Multipliers()], ids=lambda t: t.name)
@integrators
def test_the_iteration_matrix_is_that_of_the_plain_kernels(integrator, treatment):
    """It was asked of a treatment that compiled steps had left behind: an AttributeError."""
    system = tree(1)
    state, found = moving(system), []
    for kernels in ("numpy", "numba"):
        stepper = Stepper(system, INTEGRATORS[integrator], treatment, 1e-3, kernels=kernels)
        later = stepper.advance(stepper.advance(state).state).state
        matrix, report = stepper.iteration_matrix(later)
        found.append((matrix, report.state.q, stepper.advance(report.state).state.q))
    for plain, compiled in zip(*found, strict=True):
        assert compiled == pytest.approx(plain, rel=1e-9, abs=1e-10 * abs(plain).max())


# -- which kernels ---------------------------------------------------------------------------------


@pytest.mark.plain
def test_short_runs_take_numpy():
    system = tree(1)
    run = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-2, 0.05, derive=False)
    assert run.meta["kernels"] == "numpy"
    assert "compiling would take longer" in run.meta["kernels_why"]


def test_long_runs_take_numba():
    system = tree(1)
    pair = sc.EnergyMomentum(), sc.NullSpace()
    assert choice.choose_kernels("auto", system, *pair, 10**6).name == "numba"
    assert choice.estimated_seconds(system, 10**6) > choice.WORTHWHILE


def test_short_runs_take_kernels_that_are_compiled_already(monkeypatch):
    """In this process or on disk; a single one that is not decides for numpy."""
    monkeypatch.setattr(choice, "READING", 0.0)
    monkeypatch.setattr(choice, "WORTHWHILE", 25.0)
    run = partial(sc.simulate, tree(1), sc.EnergyMomentum(), sc.NullSpace(), 1e-2, 0.05)
    run(kernels="numba", derive=False)
    meta = run(derive=False).meta
    assert meta["kernels"] == "numba"
    assert "are compiled already" in meta["kernels_why"]

    def missing(function, kinds, kept_only=False):
        assert kept_only
        raise warm.NotKept

    monkeypatch.setattr("skfem_cosserat.compiled.jit.ready", missing)
    meta = run(derive=False).meta
    assert meta["kernels"] == "numpy"
    assert "not all of its kernels are on disk" in meta["kernels_why"]


def test_kernels_are_looked_for_and_not_compiled(monkeypatch):
    from numba import types

    from skfem_cosserat.compiled import jit

    def plain(x: float) -> float:
        return x + 1.0

    kinds = (types.float64,)
    monkeypatch.setattr(jit._Cache, "_load_overload", lambda *_: None)
    monkeypatch.setattr(jit._Cache, "holds", lambda *_: False)
    monkeypatch.setattr(jit._Cache, "_save_overload", lambda *_: None)
    kernel = jit.jit(plain)
    with pytest.raises(warm.NotKept):
        jit.ready(kernel, kinds, kept_only=True)
    assert not kernel.overloads
    jit.ready(kernel, kinds)
    assert jit.ready(kernel, kinds, kept_only=True).entry_point(2.0) == 3.0


def test_the_disk_is_looked_at_without_numba(monkeypatch, tmp_path):
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert not warm.promising()
    folder = tmp_path / "compiled_0a1b"
    folder.mkdir()
    index = folder / f"step.solve-1.py{sys.version_info.major}{sys.version_info.minor}.nbi"
    for text, there in (("other sources", False), (f"... {warm.stamp()} ...", True)):
        index.write_text(text)
        assert warm.promising() == there
    program = (
        "import sys, skfem_cosserat as sc; from skfem_cosserat.integrators import choice\n"
        "choice.READING = 0.0; model = sc.Model(); model.add('ball', sc.MassPoint(1.0))\n"
        "pair = sc.EnergyMomentum(), sc.NullSpace()\n"
        "run = sc.simulate(model.freeze(), *pair, 0.1, 0.5, derive=False)\n"
        "assert run.meta['kernels'] == 'numpy' and 'numba' not in sys.modules"
    )
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "none"))
    subprocess.run([sys.executable, "-c", program], check=True)


def test_compiling_is_said_when_progress_is_on(capsys):
    system = tree(1)
    pair = sc.EnergyMomentum(), sc.NullSpace()
    for on in (True, False):
        sc.simulate(*(system, *pair, 1e-2, 0.02), kernels="numba", derive=False, progress=on)
        assert ("kernels are compiled" in capsys.readouterr().err) == on


def test_threads_compile_one_after_the_other(monkeypatch):
    """Each started a helper process on an empty cache, and all compiled the same."""
    from skfem_cosserat.compiled import bind

    inside, most = [], []

    @contextmanager
    def compiling(*arguments, **options):
        inside.append(None)
        most.append(len(inside))
        time.sleep(0.05)
        yield
        inside.pop()

    monkeypatch.setattr(bind, "compiling", compiling)
    system, settings = tree(1), sc.NewtonSettings()
    with ThreadPoolExecutor(3) as threads:
        made = [
            threads.submit(CompiledStep, system, sc.EnergyMomentum(), 1e-3, settings)
            for _ in range(3)
        ]
    assert [each.result().method for each in made] == ["blocks"] * 3 and most == [1, 1, 1]


def test_versions_of_numba_are_those_of_the_package():
    """What pip installs is what the kernels are built on; newer ones may be tried."""
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text()
    assert f'"numba>={choice.NUMBA[0]}.{choice.NUMBA[1]};' in text


@pytest.mark.parametrize("error", [TypingError("no\nmore"), AttributeError("no more")])
def test_numpy_takes_over_where_numba_does_not_compile(error, monkeypatch):
    system, pair = tree(1), (sc.EnergyMomentum(), sc.NullSpace())
    plain = sc.simulate(system, *pair, 1e-3, 3e-3, kernels="numpy")

    def fails(*_, **__):
        raise error

    monkeypatch.setattr("skfem_cosserat.compiled.bind.addresses", fails)
    with pytest.warns(sc.PerformanceWarning, match=r"does not compile the kernels: no.*takes over"):
        run = sc.simulate(system, *pair, 1e-3, 3e-3, kernels="numba")
    assert np.array_equal(run["q"], plain["q"]) and run.meta["kernels"] == "numpy"
    assert "does not compile" in run.meta["kernels_why"]
    held = states.PARTS["cantilever"]()
    path = sc.static(held, kernels="numpy")
    with pytest.warns(sc.PerformanceWarning, match="takes over"):
        other = sc.static(held, kernels="numba")
    assert np.array_equal(other["q"], path["q"]) and other.meta["kernels"] == "numpy"


@pytest.mark.plain
def test_without_numba(monkeypatch):
    monkeypatch.setattr(choice, "find_spec", lambda name: None)
    system, pair = tree(1), (sc.EnergyMomentum(), sc.NullSpace())
    with pytest.warns(sc.PerformanceWarning, match="times faster"):
        taken = choice.choose_kernels("auto", system, *pair, 10**6)
    assert taken[:2] == ("numpy", "numba is not installed")
    with pytest.raises(ImportError, match=r"skfem-cosserat\[fast\]"):
        choice.choose_kernels("numba", system, *pair, 10)
    assert choice.choose_kernels("auto", system, *pair, 10).name == "numpy"


@pytest.mark.parametrize(
    ("code", "variables", "why"),
    [
        ("raise ImportError('numba needs an older numpy')", {}, "numba cannot be imported: numba "),
        (
            "__version__, config = '0.60.0', None",
            {},
            "numba 0.60.0 is installed, compiled kernels need 0.63 or newer",
        ),
        (None, {"NUMBA_DISABLE_JIT": "1"}, "numba does not compile: NUMBA_DISABLE_JIT is set"),
    ],
    ids=["broken", "too old", "switched off"],
)
def test_a_numba_that_does_not_work(code, variables, why, tmp_path):
    """Long runs, which did not ask for it, ended with its ImportError or a RecursionError."""
    if code is not None:
        (tmp_path / "numba.py").write_text(code)
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]); sys.path.insert(1, sys.argv[2])\n"
        "import skfem_cosserat as sc\n"
        "from skfem_cosserat.integrators import choice\n"
        "model = sc.Model(); model.add('a', sc.MassPoint(1.0)); system = model.freeze()\n"
        "run = sc.EnergyMomentum(), sc.NullSpace(), 1e-3\n"
        "stepper = sc.Stepper(system, *run, steps=10**9)\n"
        "print(stepper.choice.name, stepper.choice.why)\n"
        "try: sc.Stepper(system, *run, kernels='numba')\n"
        "except (ImportError, sc.InputError) as error: print(type(error).__name__, error)\n"
    )
    command = [sys.executable, "-c", script, str(tmp_path), str(Path(__file__).parents[2])]
    environment = {**os.environ, **variables}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    chosen, error = done.stdout.splitlines()
    assert chosen.startswith(f"numpy {why}")
    assert error.startswith("ImportError" if code else "InputError") and why in error
    assert ("skfem-cosserat[fast]" in error) == (code is not None)
    assert done.stderr.count("PerformanceWarning") == 1 and why in done.stderr


def test_what_is_not_compiled_is_refused_or_runs_plain():
    model = sc.Model()
    a = model.add("a", sc.RigidBody.sphere(1.0, 0.1))
    model.add("mount", sc.Bushing(sc.ground((0, 0, 0)), a.at((0, 0, 0)), stiffness=2.0))
    system = model.freeze()
    assert "bushings" in refusal(system, sc.EnergyMomentum(), sc.NullSpace())
    with pytest.raises(sc.InputError, match="springs on rotation vectors, bushings"):
        sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 0.1, 1.0, kernels="numba")
    run = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-6, 2e-6)
    assert "springs" in run.meta["kernels_why"]
    with pytest.raises(sc.InputError, match="'fortran', expected"):
        sc.simulate(tree(1), sc.EnergyMomentum(), sc.NullSpace(), 0.1, 1.0, kernels="fortran")


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
        near = [w for w in range(8**3) if (v, w) in plan.slot and w != v]
        assert 3 <= len(near) <= 6
    count, pairs = links(4, 3)  # a small one does not
    assert len(Plan(count, pairs, [-1] * count).rest) == 0
    assert len(Plan(count, pairs, [-1] * count, thin=True).rest) == 4**3


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


@pytest.mark.parametrize("thin", [-1, 0, 2])
@pytest.mark.parametrize("make", [tree, hung_lattice])
@integrators
def test_tangents_with_a_rest(integrator, make, thin, filled):
    """Increments as in the plain kernels, far from the solution, whatever is left."""
    filled(thin)
    test_residual_and_increment_at_random_states(2, integrator, make)
    fast = CompiledStep(make(2), INTEGRATORS[integrator], 1e-3, sc.NewtonSettings())
    if thin < 2 or make is hung_lattice:
        assert fast.method.startswith("blocks, ") and len(fast.plan.rest) > 1


@pytest.mark.parametrize("thin", [-1, 1])
@integrators
def test_all_kinds_of_joints_with_a_rest(integrator, thin, filled):
    """Whatever hangs on joints is turned into their coordinates before the solver gets it."""
    filled(thin)
    for kind in JOINTS:
        assert_same(*both(test_joints.scene(kind)[0], integrator, 0.01, 0.02))
    for kind in test_drives.COORDINATES:
        assert_same(*both(test_drives.scene(kind)[0], integrator, 0.01, 0.02))
    for seed in range(100, 103):
        assert_same(*both(random_tree(seed), integrator, 0.005, 0.02))


@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # fine meshes under tension
@pytest.mark.parametrize(
    ("count", "elements", "order"), [(5, 1, 1), (4, 4, 1), pytest.param(4, 2, 2, marks=SLOW)]
)
@integrators
def test_lattices(integrator, count, elements, order, filled):
    filled(2)
    system = lattice(count, elements, order)
    plain, compiled = both(system, integrator, 1e-4, 6e-4)
    assert_same(plain, compiled)
    assert compiled.meta["solver"].startswith("blocks, ")
    assert compiled.meta["factorisations"] == plain.meta["factorisations"]


# coarse struts, drawn too much
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
def test_solver_of_the_rest_is_forced():
    """Blocks alone would do here; with a solver that is asked for they leave all joints to it."""
    run = both(lattice(3), "energy-momentum", 1e-3, 4e-3, solver=sc.SolverDense())
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
        fast = CompiledStep(system, sc.EnergyMomentum(), 1e-3, settings)
        monkeypatch.setattr(fast.linear, method, raised(SingularMatrixError("singular")))
        assert fast.solve(state) is None
        for error in (MemoryError("too large"), KeyboardInterrupt()):
            monkeypatch.setattr(fast.linear, method, raised(error))
            with pytest.raises(type(error)):
                fast.solve(state)
        monkeypatch.undo()
        filled(-1)
        assert fast.solve(state) is not None


# coarse struts, drawn too much
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
    assert rest.meta["factorisations"] == blocks.meta["factorisations"]
    assert rest["newton_iterations"].tolist() == blocks["newton_iterations"].tolist()
    assert rest.meta["factorisations"] < 0.6 * whole.meta["factorisations"]


def test_nothing_is_compiled_at_import():
    code = (
        "import sys, skfem_cosserat.compiled.step as s;"
        "sys.exit(any(len(f.signatures) for f in vars(s).values() if hasattr(f, 'signatures')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_sizes_do_not_compile_again():
    """The same code serves every mesh, section and scene of one order."""
    from skfem_cosserat.compiled import elements, step

    both(crossing(1), "energy-momentum", 2e-3, 4e-3)
    before = len(step.solve.signatures), len(elements.beam_force.signatures)
    both(test_joints.scene(sc.JointRevolute)[0], "variational", 2e-3, 4e-3)
    both(chain(3), "variational", 2e-3, 4e-3)
    assert (len(step.solve.signatures), len(elements.beam_force.signatures)) == before


@pytest.mark.slow
def test_cold_and_warm_caches_give_the_same_numbers(tmp_path):
    """To the last bit; the second process compiles nothing."""
    code = (
        "import sys, hashlib; sys.path[:] = sys.argv[1:]\n"
        "import test_compiled as t, skfem_cosserat as sc\n"
        "s = t.tree(2); start = t.moving(s)\n"
        "h = sc.simulate(s, sc.EnergyMomentum(), sc.NullSpace(), 2e-3, 0.1, start=start,"
        " kernels='numba', derive=False)\n"
        "print(hashlib.sha256(h['q'].tobytes() + h['p'].tobytes()).hexdigest())"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    found, files = [], []
    for _ in range(2):
        run = subprocess.run(
            [sys.executable, "-c", code, *sys.path],
            env=environment, capture_output=True, text=True, check=True,
        )  # fmt: skip
        found.append(run.stdout)
        files.append(sorted(path.name for path in tmp_path.rglob("*.nbc")))
    assert found[0] == found[1] and len(found[0]) > 60
    assert files[0] == files[1]


def test_the_cache_knows_all_sources():
    """Code of one file is compiled into functions of another: all of them make up the key."""
    from skfem_cosserat.compiled import jit, step, tree

    both(crossing(1), "energy-momentum", 2e-3, 4e-3)
    for function in (step.solve, tree.joint_move):
        cache = function._cache
        assert type(cache).__name__ == "_Cache"
        codegen = function.targetctx.codegen()
        assert jit.STAMP in cache._index_key(function.signatures[0], codegen)
        assert list(Path(cache.cache_path).glob("*.nbi"))


@pytest.mark.slow
def test_damaged_cache_is_made_anew(tmp_path):
    """Cut files of the compile cache, as of a full disk or a killed process, cost time only."""
    pytest.importorskip("numba")
    code = """
import skfem_cosserat as sc
model = sc.Model()
model.add("ball", sc.MassPoint(1.0, velocity=(1.0, 0, 0)))
run = sc.Variational(), sc.NullSpace(), 0.1, 0.3
print(sc.simulate(model.freeze(), *run, kernels="numba")["q"][-1])
"""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", code]

    def run():
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True)

    first = run().stdout
    files = [path for path in tmp_path.rglob("*") if path.suffix in (".nbi", ".nbc")]
    assert files
    for path in files:
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert run().stdout == first
    assert run().stdout == first
    for path in tmp_path.rglob("*.nbi"):  # of a version with other modules
        path.write_bytes(path.read_bytes().replace(b"compiled.structures", b"compiled.structurez"))
    assert run().stdout == first


def test_kept_factors_that_grow_old():
    """At small steps one iteration a step seemed enough by the contraction of steps long ago.

    The errors added up to 1e-6 in a thousand steps, with a single factorisation. The rate has to
    be measured in each step.
    """
    pytest.importorskip("numba")
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
