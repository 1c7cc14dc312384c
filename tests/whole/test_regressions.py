"""Faults that reviews found, one test each: what went wrong stands in the docstring."""

import importlib
import os
import signal

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat import write_paraview


def swing():
    return importlib.import_module("paper.three_bar_swing")


def driven(displacement, velocity=(0, 0, 0)):
    """A mass point held by a moving ground place."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, velocity=velocity))
    motion = sc.Motion(displacement)
    model.add("hand", sc.JointSpherical(sc.ground((0, 0, 0), motion), ball.place()))
    return model.freeze()


def rigid_pendulum(pivot=(0, 0, 0), gravity=9.81):
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (0.1, 0.2, 0.3), position=(0.5, 0, 0)))
    model.add("pivot", sc.JointSpherical(sc.ground(pivot), body.at(pivot)))
    model.add("gravity", sc.LoadGravity((0, 0, -gravity)))
    return model.freeze()


def run(system, until=0.1, **options):
    return sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 0.01, until, **options)


@pytest.mark.slow
def test_swing_whose_first_step_fails_returns():
    """An empty history of midpoints could not be reshaped."""
    result = swing().main(step=2.0, until=6.0, section="stiff")
    assert result["diverged_at"] == 0.0 and result["times"].tolist() == [0.0]
    assert result["energy_midpoint"].shape == (0,)
    assert result["angular_momentum_midpoint"].shape == (0, 3)


@pytest.mark.parametrize("frequency", [1.0, 1e3, 1e5])
def test_rate_of_a_fast_prescribed_motion(frequency):
    """The difference step was fixed at 1e-4 s."""
    system = driven(lambda t: (np.sin(frequency * t) / frequency, 0, 0), velocity=(1.0, 0, 0))
    assert sc.initial_state(system).p[0] == 1.0
    assert sc.project(system, system.q0, 0 * system.v0)[0] == pytest.approx(1.0, rel=1e-7)
    for t in (0.1, 1.0):
        rate = system.ground_rate(t)[4, 0]
        assert rate == pytest.approx(np.cos(frequency * t), abs=2e-6)


def test_motion_is_asked_for_inside_of_the_run_only():
    """Central differences called the user's function before the start."""

    def slide(t):
        assert 0 <= t <= 0.1 + 1e-12
        return (t**1.5, 0, 0)

    history = run(driven(slide))
    assert history.status == "completed"
    assert history["v"][5, 0] == pytest.approx(1.5 * np.sqrt(0.05), rel=1e-9)


def test_functions_of_time_may_end_with_the_run():
    """A step after the last one, for its momentum, let the user's error through: there is none."""

    def push(t):
        if t > 0.1 + 1e-12:
            raise ValueError("beyond the record")
        return t

    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0))
    model.add("push", sc.LoadForce(ball.place(), (1.0, 0, 0), push))
    history = run(model.freeze())
    assert len(history) == 11 and np.isfinite(history["p"]).all()


@pytest.mark.parametrize("other", [{"pivot": (0, 0, 1)}, {"pivot": (1, 0, 0)}])
def test_restart_compares_joints(other):
    """Sums of coordinates and masses were all that was compared."""
    history = run(rigid_pendulum())
    with pytest.raises(sc.HistoryError, match="another model"):
        sc.restart(rigid_pendulum(**other), history, sc.EnergyMomentum(), 0.01)
    # loads are no part of the state
    state = sc.restart(rigid_pendulum(gravity=1.62), history, sc.EnergyMomentum(), 0.01)
    assert np.array_equal(state.q, history["q"][-1])


def test_callbacks_may_answer_with_numpy():
    """A numpy True did not end the run."""
    history = run(rigid_pendulum(), callbacks=[lambda report: report.state.q[2] < -0.01])
    assert history.status == "stopped"


def test_error_of_a_callback_takes_the_history_along():
    """The history in memory was lost."""

    def fail(report):
        if report.state.index == 4:
            raise KeyError("mine")

    with pytest.raises(KeyError) as info:
        run(rigid_pendulum(), callbacks=[fail])
    assert len(info.value.history) == 5 and info.value.history.status == "failed"


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e3])
def test_gaps_are_measured_against_the_scene(size):
    """Tolerances were absolute: a joint of a tiny scene could be wide open."""
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (size, size, size)))
    corner = np.full(3, size / 2)
    model.add("pivot", sc.JointSpherical(sc.ground(corner + 5e-4 * size), body.at(corner)))
    with pytest.raises(sc.InputError, match="does not close"):
        model.freeze()


def test_small_velocities_against_a_small_joint():
    """So were those of the hidden constraints."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, position=(1e-6, 0, 0), velocity=(9e-9, 0, 0)))
    model.add("rod", sc.JointDistance(sc.ground((0, 0, 0)), ball.place()))
    with pytest.raises(sc.InputError, match="distance joint 'rod'"):
        sc.initial_state(model.freeze())


def test_swing_looks_at_its_folder_before_it_runs(tmp_path):
    """The folder was found wanting after the whole run."""
    (tmp_path / "file").write_text("")
    with pytest.raises(sc.InputError, match="file"):
        swing().main(until=1e9, out=tmp_path / "file" / "results")


@pytest.mark.slow
def test_condition_number_of_a_run_that_fails():
    """It raised where a step could not be solved."""
    value = swing().condition_number("variational", "null-space", 0.1, section="stiff")
    assert value > 1
    for bad in (3, [1.5], "12", [], [0]):
        with pytest.raises(ValueError, match="steps"):
            swing().condition_number("variational", "null-space", 1e-2, steps=bad)


def test_event_over_a_standstill():
    """Two equal angles hid the reversal between them."""
    t = 0.2 * np.arange(5)
    assert swing()._event_x(t, np.array([0.0, 1, 2, 2, 1])) == pytest.approx(0.5)
    assert swing()._event_x(t, np.array([0.0, 1, 2, 2, 3])) is None


def test_shorter_export_leaves_no_frames_of_a_longer_one(tmp_path):
    """Stale frames stayed beside the index."""
    history = run(rigid_pendulum())
    write_paraview(history, tmp_path)
    write_paraview(history.truncated(3), tmp_path)
    assert len(list((tmp_path / "bodies").glob("*.vtu"))) == 3


def test_interrupt_while_series_are_derived(monkeypatch, tmp_path):
    """Ctrl-C after the loop lost the history in memory."""
    describe = importlib.import_module("skfem_cosserat.analysis.describe")

    def press(*states):
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(10**7):  # the signal arrives between two bytecodes
            pass

    with monkeypatch.context() as patch:
        patch.setattr(describe, "kinetic_energy", press)
        with pytest.warns(sc.IncompleteWarning, match="interrupted"):
            history = run(rigid_pendulum(), derive=True)
    assert history.status == "completed" and len(history) == 11
    assert np.isfinite(history["energy"]).all()  # it is derived later


def test_going_on_does_not_overwrite_the_history(tmp_path):
    """A run that went on from a file into the same file replaced it."""
    path = tmp_path / "run.history"
    system = rigid_pendulum()
    first = run(system, path=path)
    start = sc.restart(system, sc.History.load(path), sc.EnergyMomentum(), 0.01)
    with pytest.raises(sc.InputError, match=r"run\.history.*goes on from step 10"):
        run(system, until=0.2, start=start, path=path)
    assert len(sc.History.load(path)) == len(first)
    assert len(run(system, until=0.2, start=start, path=tmp_path / "rest.history")) == 11
    run(system, path=path)  # a fresh run may


def test_mass_off_the_origin_of_its_body_is_drawn(tmp_path):
    """It was left out of the pictures without a word."""
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (1, 1, 1)))
    model.add("weight", sc.MassPoint(1.0, on=body.at((0.5, 0, 0))))
    history = run(model.freeze())
    assert [b["name"] for b in history.meta["bodies"]] == ["body", "weight"]
    points = history.static["body/weight/points"]
    assert points.mean(0) == pytest.approx([0.5, 0, 0], abs=1e-6)


def test_ring_of_twelve_chords_is_smooth():
    """A turning angle equal to the feature angle was a corner, or not, by rounding."""
    angle = 2 * np.pi * np.arange(12) / 12
    p = np.array([np.cos(angle), np.sin(angle), 0 * angle])
    t = np.array([np.arange(12), (np.arange(12) + 1) % 12])
    mesh = sc.MeshCurve(p, t).with_beams({"ring": np.arange(12)})
    section = sc.Section([1.0] * 6, 1.0, (1.0, 1.0))
    beam = sc.Beam(mesh, section, director=(0, 0, 1))
    assert np.array_equal(beam.rotations, np.broadcast_to(np.eye(3), beam.rotations.shape))


def test_writing_a_mesh_to_a_missing_folder():
    """A bare FileNotFoundError came out."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2)
    for suffix in ("msh", "vtu"):
        with pytest.raises(sc.MeshError, match="no folder"):
            sc.write_mesh(f"/nowhere/at/all/mesh.{suffix}", mesh)


def test_progress_of_a_run_that_ends_before_until(capfd):
    """Its last line never came."""
    with pytest.warns(sc.AccuracyWarning, match="ends at t = 0.1 s, 0.005 s before"):
        run(rigid_pendulum(), until=0.105, progress=True)
    assert capfd.readouterr().err.endswith("t = 0.1 s of 0.105 s\n")
    with pytest.raises(sc.InputError, match="yes"):
        run(rigid_pendulum(), progress="yes")


def test_swing_shorter_than_a_step():
    """It raised a bare error; a run without a step is refused, one of a single step is none."""
    with pytest.raises(sc.InputError, match=r"argument step: 0\.01 s is longer than the run"):
        swing().main(until=1e-3)
    result = swing().main(until=1e-2)
    assert result["times"].tolist() == [0.0, 0.01] and result["diverged_at"] is None


@pytest.mark.one_quick
@pytest.mark.parametrize(
    "wrong",
    [
        {"reuse": "four"}, {"reuse": 2.5}, {"reuse": -1}, {"iterations": True}, {"iterations": 0},
        {"increment": np.nan}, {"mixed": np.array([1.0, 2.0])}, {"rotation": np.inf},
    ],
    ids=repr,
)  # fmt: skip
def test_newton_settings_of_a_wrong_kind(wrong):
    """They gave a TypeError, or were taken."""
    (name,) = wrong
    with pytest.raises(sc.InputError, match=rf"Newton settings: {name} = "):
        sc.NewtonSettings(**wrong)
    assert sc.NewtonSettings(mixed=np.inf, largest=np.inf, reuse=np.int64(0)).reuse == 0


@pytest.mark.parametrize("value", [np.nan, np.ones(5)], ids=["nan", "shape"])
def test_a_sensor_that_sees_nothing_ends_the_run_before_its_first_step(value, tmp_path):
    """Runs of less than 128 steps were "completed", and the records of all sensors were missing."""
    sensors = {"it": sc.SensorQuantity(lambda system, q, t: np.full(len(t), 1.0) * value)}
    if np.ndim(value):
        sensors = {"it": sc.SensorQuantity(lambda system, q, t: value)}
    with pytest.raises(sc.InputError, match="sensor: its function gave shape"):
        run(rigid_pendulum(), until=0.05, sensors=sensors, path=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_study_of_a_function_that_calls_itself(tmp_path):
    """A RecursionError came out, if it was made inside another function."""

    def total(elements):
        return 0.0 if elements == 0 else elements**-2.0 + total(elements - 1)

    study = sc.refine(total, elements=(4, 8, 16, 32), folder=tmp_path / "study")
    assert study.values["value"]["elements = 4"] == pytest.approx(205 / 144)


def test_a_negative_number_of_refinements():
    """It gave the mesh as it was: refined(-1) is not the last element."""
    with pytest.raises(sc.MeshError, match="-1 times, expected 0 or more"):
        sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2).refined(-1)


# elements are folded on purpose
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
def test_no_step_by_half_turns(kernels):
    """Nodes turned by 180 degrees in a step: the energy went from 0.06 to 611 J, "converged".

    Their directors vanish at the midpoint, where energy-momentum asks for the constraints, so such
    a step solves the equations whatever its energy is.
    """
    system = swing().build("stiff", factor=0.01)
    system = getattr(system, "system", system)
    history = sc.simulate(
        system,
        sc.EnergyMomentum(),
        sc.NullSpace(),
        1e-2,
        0.8,
        settings=sc.NewtonSettings(iterations=100),
        kernels=kernels,
    )
    energy = history["energy"][history.times > 0.26]
    assert abs(energy - energy[0]).max() < 1e-9 * energy[0]
