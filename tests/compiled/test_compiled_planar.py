"""Compiled kernels of scenes in a plane against the plain ones, and against those in space."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from helpers_scenes import four_bar, rotation, swing_model
from rounding import limits, nudged
from test_compiled import INTEGRATORS, called, integrators
from test_theories import swing as example

import skfem_cosserat as sc
from skfem_cosserat.compiled.numbers import ROTATION
from skfem_cosserat.integrators.choice import refusal
from skfem_cosserat.integrators.compiled_step import CompiledPlane
from skfem_cosserat.integrators.stepper import Stepper

pytest.importorskip("numba")
THEORIES = (sc.TheoryInextensible(), sc.TheoryKirchhoff())
TURNED = rotation(np.random.default_rng(7), 2.0)
#: turns scenes of the (e1, e2)-plane
PLANES = {"xy": np.eye(3), "zx": np.eye(3)[[1, 2, 0]], "any": TURNED}


def mechanism(Q: np.ndarray, roll: float = 0.0, order: int = 1, theory: Any = None) -> sc.Model:
    """A beam with a corner on a pin, a body at its end whose directors may be oblique, what slides.

    On the body a slider, a mass point on a rod and another one on a wire.
    """
    n, along = Q[:, 2], Q[:, 0]

    def at(x: float, y: float) -> np.ndarray:
        return Q @ (x, y, 0.0)

    model = sc.Model()
    mesh = sc.MeshCurve.init_polyline([at(0, 0), at(0.6, 0.2), at(1.0, 0)], 2, name="arm")
    section = sc.Section((2e4, 2e4, 5e4, 40.0, 60.0, 30.0), mass=1.3, inertia=(2e-3, 3e-3))
    beam = sc.Beam(mesh, section, order=order, director=n, theory=theory)
    arm = model.add("arm", beam)
    end = arm.node("arm.end")
    model.add("pin", sc.JointRevolute(sc.ground(at(0, 0)), arm.node("arm.start"), n))
    c, s = np.cos(roll), np.sin(roll)
    triad = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ sc.triad(along, n)
    inertia = {"euler": (0.01, 0.01, 0.2), "center": (0, 0, 0.1)}
    body = sc.RigidBody(2.0, position=at(1.5, 0), triad=triad, **inertia)
    body = model.add("body", body)
    model.add("elbow", sc.JointRevolute(end, body.at(at(1, 0)), n))
    slider = model.add("slider", sc.RigidBody.sphere(0.5, 0.1, position=at(1.5, 0.3)))
    rail = sc.JointPrismatic(body.at(at(1.5, 0.3)), slider.at(at(1.5, 0.3)), Q @ (0.6, 0.8, 0))
    model.add("rail", rail)
    bob = model.add("bob", sc.MassPoint(0.7, position=at(2.0, -0.5)))
    model.add("rod", sc.JointDistance(body.at(at(1.8, 0)), bob.place()))
    bead = model.add("bead", sc.MassPoint(0.3, position=at(1.2, 0.0)))
    model.add("wire", sc.JointPointOnLine(body.at(at(1.5, 0)), bead.place(), along))
    model.add("weight", sc.LoadGravity(Q @ (1.0, -9.81, 0)))
    model.add("wind", sc.LoadForce(bob.place(), lambda t: Q @ (t, 1.0, 0)))
    return model


def loop() -> sc.Model:
    """A four-bar linkage whose coupler carries a beam."""
    model = four_bar()
    mesh = sc.MeshCurve.init_line((0, 1, 0), (-0.5, 1, 0), 3, name="mast")
    section = sc.Section((2e4, 2e4, 5e4, 40.0, 60.0, 30.0), mass=1.3, inertia=(2e-3, 3e-3))
    mast = model.add("mast", sc.Beam(mesh, section, director=(0, 0, 1)))
    model.add("foot", sc.JointFixed(model["coupler"].at((0, 1, 0)), mast.node("mast.start")))
    model.add("weight", sc.LoadGravity((1.0, -9.81, 0)))
    return model


def stiff(theory: Any) -> sc.Model:
    return example().scene("stiff", elements=4, theory=theory)


TREES = {
    **{f"mechanism {name}": partial(mechanism, Q, 0.4) for name, Q in PLANES.items()},
    **{
        f"mechanism {theory!r}": partial(mechanism, TURNED, 0.4, theory=theory)
        for theory in THEORIES
    },
    "swing": partial(swing_model, 4),
}
LOOPS = {"linkage": loop} | {f"swing {theory!r}": partial(stiff, theory) for theory in THEORIES}


def started(system: sc.System) -> sc.State:
    """In motion, each frame with a twist of the plane."""
    assert system.plane is not None
    rng, y, n = np.random.default_rng(4), system.q0.reshape(-1, 3), system.plane.normal
    v = np.zeros_like(y)
    for r, framed in zip(system.origin_rows, system.is_frame, strict=True):
        v[r] = rng.standard_normal(2) @ system.plane.axes
        if framed:
            v[r + 1 : r + 4] = rng.standard_normal() * np.cross(n, y[r + 1 : r + 4])
    return sc.initial_state(system, v=sc.project(system, system.q0, v.ravel()))


def runs(system: sc.System, integrator: str, h: float, until: float, **options: Any) -> Any:
    """Plain and compiled, with the same iterates, and compiled from a nudged start."""
    start = options.pop("start", None) or started(system)
    common = {"settings": sc.NewtonSettings(reuse=0), "derive": False} | options
    pair = INTEGRATORS[integrator], sc.NullSpace()
    return [
        sc.simulate(system, *pair, h, until, start=begin, kernels=kernels, **common)
        for begin, kernels in ((start, "numpy"), (start, "numba"), (nudged(start), "numba"))
    ]


def assert_same(plain: sc.History, compiled: sc.History, beside: sc.History) -> None:
    assert (plain.meta["kernels"], compiled.meta["kernels"]) == ("numpy", "numba")
    assert compiled["attempts"].max() == 1
    for name, limit in limits(compiled, beside).items():
        assert np.nanmax(abs(compiled[name] - plain[name])) <= limit, name


# -- one state -------------------------------------------------------------------------------------


@integrators
@pytest.mark.parametrize("scene", TREES)
def test_increments_at_random_states(scene, integrator):
    """Of iterations far from a solution, the second one with predicted stresses."""
    system, h = TREES[scene]().freeze(planar=sc.Planar()), 0.02
    method, state = INTEGRATORS[integrator], started(system)
    stepper = Stepper(system, method, sc.NullSpace(), h, kernels="numpy")
    fast = CompiledPlane(system, method, h, sc.NewtonSettings())
    parts = fast._step.start, fast._step.evaluate, fast._step.matrix, fast._step.increment
    begin, evaluate, matrix, increment = map(called, parts)
    whole = *fast._all[:-1], fast._all[-1].copy()
    whole[-1][ROTATION] = np.inf  # as found: not scaled down for its rotations
    bound = stepper.bound
    bound.begin(system.extend(state.q, state.time), system.ground(state.time + h), h)
    guess = 0.1 * np.random.default_rng(1).standard_normal(system.unknowns)
    bound.resume(guess)
    fast.resume(guess)
    bound.guess(True)
    problem = stepper.problem(method.begin(system, state, h))
    problem.residual()
    fast._begin(state)
    begin(*fast._all, 1)
    for mixed in (0, 1):
        evaluate(*fast._all, 1)
        assert matrix(*fast._all, mixed)
        increment(*whole, 0)
        plain = problem.direction()
        found = fast._a.x.ravel()[fast._numbering]
        assert found == pytest.approx(plain, abs=1e-10 * abs(plain).max())
        problem.apply(plain)
        problem.residual()
        assert problem._stresses is not None
        assert fast._a.found[1] == 1


# -- runs ------------------------------------------------------------------------------------------


# a swing of four elements folds
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@integrators
@pytest.mark.parametrize("scene", TREES)
def test_runs_of_trees(scene, integrator):
    """All joints, in any plane, with directors that are oblique to it."""
    run = runs(TREES[scene]().freeze(planar=sc.Planar()), integrator, 5e-3, 0.1)
    plain, compiled, _ = run
    assert abs(plain["q"][-1] - plain["q"][0]).max() > 1e-2
    assert compiled["newton_iterations"].tolist() == plain["newton_iterations"].tolist()
    assert_same(*run)


@integrators
@pytest.mark.parametrize("scene", LOOPS)
def test_runs_of_closed_loops(scene, integrator):
    system = LOOPS[scene]().freeze(planar=sc.Planar())
    assert system.closure.rank > 0
    # the swing starts from rest
    options = {} if scene == "linkage" else {"start": sc.initial_state(system)}
    assert_same(*runs(system, integrator, 2e-3, 0.1, **options))


@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # large steps
@pytest.mark.slow
@integrators
def test_elements_of_higher_order(integrator):
    system = mechanism(TURNED, 0.4, 2).freeze(planar=sc.Planar())
    assert_same(*runs(system, integrator, 5e-3, 0.1))


@integrators
def test_kept_factors_lead_to_the_same_motion(integrator):
    """Turned with the frames, those of children as well."""
    system = mechanism(TURNED, 0.4, theory=sc.TheoryInextensible()).freeze(planar=sc.Planar())
    whole, kept = [
        sc.simulate(
            system, INTEGRATORS[integrator], sc.NullSpace(), 1e-3, 0.1, start=started(system),
            kernels="numba", settings=sc.NewtonSettings(reuse=reuse), derive=False,
        )
        for reuse in (0, 4)
    ]  # fmt: skip
    assert kept["q"][-1] == pytest.approx(whole["q"][-1], abs=1e-10)
    assert kept.meta["factorisations"] < 0.7 * whole.meta["factorisations"]


# a swing of four elements folds
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@integrators
@pytest.mark.parametrize(
    ("elements", "until"), [(4, 0.3), pytest.param(20, 5.0, marks=pytest.mark.slow)]
)
def test_swing_is_that_in_space(elements, until, integrator):
    model = swing_model(elements)
    a, b = (
        sc.simulate(
            model.freeze(planar=plane), INTEGRATORS[integrator], sc.NullSpace(), 1e-2, until,
            kernels="numba", derive=False,
        )
        for plane in (None, sc.Planar())
    )  # fmt: skip
    assert 2 * b.meta["unknowns"] == a.meta["unknowns"]
    assert (a.meta["kernels"], b.meta["kernels"]) == ("numba", "numba")
    assert abs(a["q"] - b["q"]).max() < 1e-10
    rows = b["q"].reshape(len(b), -1, 3)
    assert (rows[..., 0] == rows[0, :, 0]).all()  # nothing leaves the plane


def test_nothing_is_compiled_anew_for_other_sizes():
    from skfem_cosserat.compiled import step
    from skfem_cosserat.compiled.plane import elements, tree

    counts = []
    for scene in (swing_model(4), swing_model(6), mechanism(TURNED, 0.4)):
        system = scene.freeze(planar=sc.Planar())
        sc.simulate(
            system, sc.EnergyMomentum(), sc.NullSpace(), 5e-3, 0.01, kernels="numba", derive=False
        )
        parts = step.solve, elements.beam_force, tree.joint_move
        counts.append([len(part.signatures) for part in parts])
    assert counts[0] == counts[1] == counts[2]


# -- what there is none for ------------------------------------------------------------------------


def refused(model: sc.Model, treatment: Any = None) -> str:
    """The reason, or nothing."""
    system = model.freeze(planar=sc.Planar())
    return refusal(system, sc.Variational(), treatment or sc.NullSpace()) or ""


def test_what_there_are_no_kernels_for():
    assert refused(mechanism(TURNED)) == ""
    assert "confined to a plane with multipliers" in refused(mechanism(TURNED), sc.Multipliers())
    for name, item, what in (
        (
            "blow",
            lambda m: sc.LoadForce(m["arm"].node("arm.end"), (0, 2.0, 0), follower=True),
            "follow",
        ),
        ("drag", lambda m: sc.RayleighDamping(mass=0.1), "viscous sections and drag"),
        (
            "spring",
            lambda m: sc.SpringDamper(sc.ground((2, 1, 0)), m["bob"].place(), 20.0),
            "springs",
        ),
    ):
        model = mechanism(np.eye(3))
        model.add(name, item(model))
        assert what in refused(model), name
    model = mechanism(np.eye(3))
    model.add("motor", sc.JointDrive(model["pin"], lambda t: 0.1 * t))
    assert "prescribed motion" in refused(model)


def test_a_run_says_which_kernels_and_why():
    system = mechanism(np.eye(3)).freeze(planar=sc.Planar())
    pair = sc.Variational(), sc.Multipliers()
    run = sc.simulate(system, *pair, 5e-3, 0.01, derive=False)
    assert run.meta["kernels"] == "numpy"
    assert "confined to a plane with multipliers" in run.meta["kernels_why"]
    with pytest.raises(sc.InputError, match="confined to a plane with multipliers"):
        sc.simulate(system, *pair, 5e-3, 0.01, kernels="numba")
