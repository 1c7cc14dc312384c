"""Null space against multipliers, repeatability, effort, and what happens when a step fails."""

from functools import cache

import numpy as np
import pytest
from helpers_scenes import TENSOR, everything, random_tree, swing

import skfem_cosserat as sc

INTEGRATORS = {"variational": sc.Variational(), "energy-momentum": sc.EnergyMomentum()}
TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
treatments = pytest.mark.parametrize("treatment", TREATMENTS)
#: each integrator and each treatment once
straight = pytest.mark.parametrize(
    ("integrator", "treatment"), [("variational", "null space"), ("energy-momentum", "multipliers")]
)


def pair_of_bodies(kind, **options):
    """A driven body carrying another one and a beam, by one kind of joint; follower loads."""

    def make():
        model = sc.Model()
        shake = sc.Motion(
            lambda t: (0.2 * np.sin(3 * t) - 0.6 * t, 0, t**2), lambda t: (t**2, 0, 0)
        )
        one = model.add("one", sc.RigidBody(1.0, TENSOR, center=(0.1, 0, 0.1)))
        two = model.add("two", sc.RigidBody(1.5, TENSOR, position=(1, 0.2, 0)))
        mesh = sc.MeshCurve.init_line((1.5, 0, 0), (2.5, 0, 0), 2, "beam")
        section = sc.Section([60, 60, 80, 3, 4, 2.5], mass=0.8, inertia=(0.05, 0.06))
        beam = model.add("beam", sc.Beam(mesh, section))
        model.add("drive", sc.JointFixed(sc.ground((0, 0, 0), shake), one.at((0, 0, 0))))
        x, y = np.array([0.5, 0, 0.1]), np.array([1.5, 0, 0])
        gap = np.array([0.2, 0.1, 0]) if kind is sc.JointDistance else np.zeros(3)
        model.add("first", kind(one.at(x), two.at(x + gap), **options))
        model.add("second", kind(beam.node("beam.start"), two.at(y + gap), **options))
        model.add("push", sc.LoadForce(two.at((1, 1, 0)), (1.0, 2, -1), follower=True))
        model.add("wind", sc.LoadLine(beam, (0.5, 1.0, 0), follower=True))
        model.add("twist", sc.LoadMoment(beam.node("beam.end"), (0.1, 0.1, -0.2), follower=True))
        model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
        return model.freeze()

    return make


SCENES = {
    "spherical": pair_of_bodies(sc.JointSpherical),
    "revolute": pair_of_bodies(sc.JointRevolute, axis=(0, 0.6, 0.8)),
    "fixed": pair_of_bodies(sc.JointFixed),
    "distance": pair_of_bodies(sc.JointDistance),
    "everything": everything,
    "everything swapped": lambda: everything(swapped=True),
    "tree 1": lambda: random_tree(1),
    "tree 4": lambda: random_tree(4),
    "swing": lambda: swing(6),
}


@cache
def run(scene, integrator, treatment, again=0):
    system = SCENES[scene]()
    v = system.v0
    if scene.startswith("tree"):  # has no loads
        v = np.random.default_rng(3).standard_normal(system.n)
    v = sc.project(system, system.q0, v)
    start = sc.initial_state(system, v=v)
    pair = INTEGRATORS[integrator], TREATMENTS[treatment]
    return sc.simulate(system, *pair, 0.004, 0.12, start=start, derive=scene == "distance")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # tension in the coarse swing
@pytest.mark.parametrize(
    ("scene", "integrator"),
    [(scene, [*INTEGRATORS][k % 2]) for k, scene in enumerate(SCENES)],
)
def test_both_treatments_give_the_same_motion(scene, integrator):
    one, two = [run(scene, integrator, name) for name in TREATMENTS]
    size = abs(one["q"]).max()
    assert len(one) == 31
    assert abs(one["q"] - two["q"]).max() < 1e-10 * size
    assert abs(one["p"] - two["p"]).max() < 1e-8 * (1 + abs(one["p"]).max())
    assert abs(one["q"][-1] - one["q"][0]).max() > 1e-3  # it moves
    for history in (one, two):
        assert (history["attempts"] == 1).all()


@pytest.mark.slow
@straight
def test_repeated_runs_are_identical(integrator, treatment):
    one, two = (run("distance", integrator, treatment, again) for again in (0, 1))
    assert one is not two
    for name in one.series:
        assert np.array_equal(one[name], two[name], equal_nan=True), name


@pytest.mark.slow
def test_unscaled_multipliers_solve_the_same():
    one = run("spherical", "variational", "multipliers")
    system = SCENES["spherical"]()
    unscaled = sc.Multipliers(scaled=False)
    two = sc.simulate(system, INTEGRATORS["variational"], unscaled, 0.004, 0.12)
    assert abs(one["q"] - two["q"]).max() < 1e-10


# -- failures --------------------------------------------------------------------------------------


def stiff_whip():
    """A steel-like thin beam hit hard: no step of a second can follow it."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 8, "beam")
    section = sc.SectionRectangle(0.01, 0.002, sc.Material(7e10, 0.3, 2700))
    beam = model.add("beam", sc.Beam(mesh, section))
    model.add("hook", sc.JointSpherical(sc.ground((0, 0, 0)), beam.node("beam.start")))
    blow = sc.Table([0, 2.0, 2.5, 3.0], [0, 0, 2e4, -2e4])
    model.add("blow", sc.LoadForce(beam.node("beam.end"), (0.1, 1, 0.3), blow))
    return model.freeze()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # a step far too large
@straight
def test_a_step_far_too_large_says_so(integrator, treatment, tmp_path):
    system = stiff_whip()
    path = tmp_path / "whip.history"
    with pytest.raises(sc.Diverged) as caught:
        sc.simulate(system, INTEGRATORS[integrator], TREATMENTS[treatment], 0.5, 20.0, path=path)
    error = caught.value
    history = error.history
    assert error.step == len(history)  # the state before it is the last
    assert error.time == pytest.approx(history.times[-1])
    assert error.time >= 1.5  # at rest until the blow
    assert 0 < error.residual < 1
    for words in (f"step {error.step}", f"t = {error.time:.9g} s", "residual", "smaller step"):
        assert words in str(error)
    assert ("EnergyMomentum()" in error.advice) == (integrator == "variational")
    assert history.status == "diverged"
    assert str(error).startswith(history.meta["failure"])  # then what was warned of
    assert np.isfinite(history["q"]).all() and np.isfinite(history["p"]).all()
    loaded = sc.History.load(path)
    assert loaded.status == "diverged"
    for key in ("t", "q", "p", "carried"):
        assert np.array_equal(loaded[key], history[key]), key


@straight
def test_residual_of_a_load_on_a_scene_at_rest(integrator, treatment):
    """Regression: its size counts the load, else the line search starts from a residual of 0."""
    system = stiff_whip()
    stepper = sc.Stepper(system, INTEGRATORS[integrator], TREATMENTS[treatment], 0.5)
    balance = stepper.balance
    step = balance.begin(sc.initial_state(system, time=2.0))
    evaluation = balance.evaluate(step, step.y0)
    assert evaluation.size > 0.4 * 0.5 * 1e4
    assert abs(evaluation.R).max() <= evaluation.size


@treatments
def test_overflow_is_not_a_small_residual(treatment):
    """Regression: terms that overflow give no residual of 0."""
    system = stiff_whip()
    bound = TREATMENTS[treatment].bind(system, 0.0)
    residual = np.ones(bound.unknowns)
    assert bound.relative(residual, np.inf) == np.inf
    assert bound.relative(np.zeros(bound.unknowns), 0.0) == 0
    residual[0] = np.nan
    for largest in (1.0, np.nan, 0.0):
        assert not np.isfinite(bound.relative(residual, largest))
