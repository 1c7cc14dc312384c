"""The loop: what is recorded, streamed, derived, continued and interrupted."""

import io
import os
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest
from helpers_precision import struck

import skfem_cosserat as sc
from skfem_cosserat.run import derive_series

# the end of a rod of four soft elements is drawn somewhat farther than such ones can be
pytestmark = pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")

INTEGRATORS = (sc.Variational, sc.EnergyMomentum)


def pendulum():
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    section = sc.SectionCircle(5e-3, sc.Material(5e6, 0.5, 1100))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0)))
    model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), (0, 0, 1)))
    model.add("ball", sc.RigidBody.sphere(0.05, 0.02, on=rod.node("rod.end")))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    return model.freeze()


@pytest.fixture(scope="module", params=INTEGRATORS)
def full(request):
    system = pendulum()
    integrator = request.param
    return system, integrator, sc.simulate(system, integrator(), sc.NullSpace(), 5e-3, 0.1)


def test_times_are_multiples_of_the_step(full):
    _, _, history = full
    assert np.array_equal(history.times, np.arange(21) * 5e-3)
    assert np.array_equal(history["step"], np.arange(21))
    assert history.status == "completed"


@pytest.mark.slow
def test_thinned_histories_hold_the_same_states(full):
    """The momentum of a state needs the step after it, recorded or not."""
    system, integrator, history = full
    for choice, ids in (
        ({"every": 4}, [0, 4, 8, 12, 16, 20]),
        ({"every": 7}, [0, 7, 14, 20]),
        ({"at": [0.02, 0.05]}, [4, 10]),
    ):
        thin = sc.simulate(system, integrator(), sc.NullSpace(), 5e-3, 0.1, **choice)
        kept = [k for k in ids if k in thin["step"]]
        assert kept == ids
        rows = [list(thin["step"]).index(k) for k in ids]
        for name in ("q", "p", "v", "energy", "joint/hinge/force", "newton_iterations"):
            assert np.array_equal(thin[name][rows], history[name][ids]), name


@pytest.mark.one_quick
def test_the_last_state_is_known_without_the_step_after(full):
    """A longer run has the same; the last momentum of nodes is on the hidden constraints."""
    system, integrator, history = full
    longer, last = sc.simulate(system, integrator(), sc.NullSpace(), 5e-3, 0.2), len(history) - 1
    for name in ("q", "p", "constraint_force", "multipliers"):
        assert np.array_equal(history[name][:-1], longer[name][:last]), name
        size = abs(longer[name]).max()
        assert abs(history[name][-1] - longer[name][last]).max() < 0.05 * size, name
    assert np.array_equal(history["q"][-1], longer["q"][last])
    assert abs(history["Qp"][-1] - longer["Qp"][last]).max() < 1e-9 * abs(longer["p"]).max()


def test_steps_is_the_primitive(full):
    system, integrator, history = full
    for k, report in enumerate(sc.steps(system, integrator(), sc.NullSpace(), 5e-3), 1):
        assert np.array_equal(report.state.q, history["q"][k])
        assert np.array_equal(report.momentum, history["p"][k - 1])
        if k == 10:
            break


def test_streamed_history_equals_that_in_memory(full, tmp_path):
    system, integrator, history = full
    path = tmp_path / "run.history"
    streamed = sc.simulate(system, integrator(), sc.NullSpace(), 5e-3, 0.1, path=path)
    loaded = sc.History.load(path)
    assert {"q", "v", "energy", "energy_balance", "joint/hinge/force"} <= set(loaded)
    assert "Qp" not in loaded
    derive_series(system, loaded)
    for other in (streamed, loaded):
        assert set(other.series) == set(history.series)
        for name in history.series:
            assert np.array_equal(other[name], history[name], equal_nan=True), name


@pytest.mark.one_quick
def test_callbacks_and_progress(full, monkeypatch):
    system, integrator, _ = full
    seen, asked = [], []
    history = sc.simulate(
        system,
        integrator(),
        sc.NullSpace(),
        5e-3,
        0.1,
        callbacks=[lambda report: seen.append(report.state.index), lambda r: r.state.index == 7],
        progress=lambda t, until: asked.append((t, until)),
    )
    assert seen == list(range(1, 8))
    assert history.status == "stopped" and history["step"][-1] == 7
    assert asked[-1] == (pytest.approx(0.035), 0.1)
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    sc.simulate(system, integrator(), sc.NullSpace(), 5e-3, 0.1, progress=True)
    assert "of 0.1 s" in stream.getvalue()


def test_library_prints_nothing_unasked(full, capfd):
    system, integrator, _ = full
    sc.simulate(system, integrator(), sc.NullSpace(), 5e-3, 0.05)
    captured = capfd.readouterr()
    assert captured.out == "" and captured.err == ""


def test_interrupt_keeps_a_valid_history(full, tmp_path):
    system, integrator, history = full

    def press(report):
        if report.state.index == 5:
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    path = tmp_path / "run.history"
    cut = sc.simulate(system, integrator(), sc.NullSpace(), 5e-3, 0.1, callbacks=[press], path=path)
    assert signal.getsignal(signal.SIGINT) is before
    assert cut.status == "interrupted"
    loaded = sc.History.load(path)
    assert loaded.status == "interrupted"
    assert np.array_equal(loaded["q"], history["q"][: len(loaded)]) and len(loaded) >= 6


@pytest.mark.slow
def test_killed_run_is_readable_up_to_the_last_block(tmp_path):
    path = tmp_path / "killed.history"
    script = textwrap.dedent(f"""
        import os, signal, skfem_cosserat as sc
        model = sc.Model()
        model.add("ball", sc.MassPoint(1.0, velocity=(1, 0, 0)))
        def kill(report):
            if report.state.index == 130:
                os.kill(os.getpid(), signal.SIGKILL)
        sc.simulate(model.freeze(), sc.Variational(), sc.NullSpace(), 0.01, 10.0,
                    callbacks=[kill], path={str(path)!r})
    """)
    done = subprocess.run([sys.executable, "-c", script], check=False)
    assert done.returncode == -signal.SIGKILL
    history = sc.History.load(path)
    assert len(history) >= 100
    assert np.allclose(history["q"][:, 0], history.times, atol=1e-12)


def test_diverged_run_leaves_its_history(tmp_path):
    """A blow that a step does not resolve: the error says when, how far and what to try."""
    path = tmp_path / "run.history"
    with pytest.raises(sc.Diverged) as info:
        sc.simulate(*struck(), 0.1, 1.0, path=path)
    error = info.value
    assert f"step {error.step} from t" in str(error) and "Try a smaller step" in str(error)
    assert np.isfinite(error.residual) or error.residual == np.inf
    for history in (error.history, sc.History.load(path)):
        assert history.status == "diverged"
        assert history["step"][-1] == error.step - 1
        assert history.times[-1] == error.time
        assert np.isfinite(history["q"]).all() and np.isfinite(history["p"]).all()


def test_a_run_of_one_step_and_bad_recording(full):
    system, integrator, _ = full
    run = system, integrator(), sc.NullSpace()
    with pytest.raises(sc.InputError, match="only one"):
        sc.simulate(*run, 5e-3, 0.1, every=2, at=[0.05])
    with pytest.raises(sc.InputError, match=r"step: 0\.02 s is longer than the run, 0\.01 s"):
        sc.simulate(*run, 0.02, 0.01)
    short = sc.simulate(*run, 0.01, 0.01)
    assert short.times.tolist() == [0.0, 0.01]
    assert np.isfinite(short["p"]).all()
