"""Which kernels a run takes and why, and what it does where numba is missing or fails."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import states
from helpers_kernels import tree
from test_closed_loops import PARALLELOGRAM, linkage

import skfem_cosserat as sc
from skfem_cosserat.compiled import kept
from skfem_cosserat.compiled.kept import Source
from skfem_cosserat.integrators import choice
from skfem_cosserat.integrators.choice import refusal

pytest.importorskip("numba")
TypingError = pytest.importorskip("numba.core.errors").TypingError


RUN = sc.EnergyMomentum(), sc.NullSpace(), 1e-2, 0.05


@pytest.mark.plain
def test_runs_take_numpy_where_no_kernels_are_on_disk():
    run = sc.simulate(tree(1), *RUN, derive=False)
    assert run.meta["kernels"] == "numpy"
    assert run.meta["kernels_why"] == choice.NOT_ON_DISK


def test_long_runs_have_kernels_compiled():
    for steps, source in ((choice.LONG_RUN, Source.COMPILER), (choice.LONG_RUN - 1, None)):
        taken = choice.choose_kernels("auto", tree(1), *RUN[:2], steps)
        assert (taken.source if taken.name == "numba" else None) == source
    # a step of order four is made of three
    fourth = sc.Composition(sc.EnergyMomentum())
    assert choice.choose_kernels("auto", tree(1), fourth, RUN[1], choice.LONG_RUN // 3 + 1).long


@pytest.mark.plain
def test_runs_take_kernels_that_are_compiled_already(kept_kernels):
    """In this process or on disk."""
    sc.simulate(tree(1), *RUN, kernels="numba", derive=False)
    meta = sc.simulate(tree(1), *RUN, derive=False).meta
    assert meta["kernels"] == "numba" and meta["kernels_why"].endswith("are on disk")


@pytest.mark.slow
def test_the_disk_is_looked_at_without_numba(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert not kept.promising()
    kept.folder().mkdir()
    for stamp, there in (("0123456789abcdef", False), (kept.stamp(), True)):
        (kept.folder() / f"step.solve-{stamp}-0123456789abcdef.kernel").write_bytes(b"")
        assert kept.promising() == there
    program = (
        "import sys, skfem_cosserat as sc; model = sc.Model()\n"
        "model.add('ball', sc.MassPoint(1.0))\n"
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


def test_versions_of_numba_are_those_of_the_package():
    """What pip installs is what the kernels are built on; newer ones may be tried."""
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text()
    assert f'"numba>={choice.NUMBA[0]}.{choice.NUMBA[1]};' in text


def test_numpy_takes_over_where_numba_does_not_compile(monkeypatch):
    system, pair = tree(1), (sc.EnergyMomentum(), sc.NullSpace())
    plain = sc.simulate(system, *pair, 1e-3, 3e-3, kernels="numpy")

    def fails(*_, **__):
        raise TypingError("no\nmore")

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


@pytest.mark.slow
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
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), **variables}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    chosen, error = done.stdout.splitlines()
    assert chosen.startswith(f"numpy {why}")
    assert error.startswith("ImportError" if code else "InputError") and why in error
    assert ("skfem-cosserat[fast]" in error) == (code is not None)
    assert done.stderr.count("PerformanceWarning") == 1 and why in done.stderr


class OwnBalance(sc.EnergyMomentum):
    """As energy-momentum, by a balance of its own."""

    name = "own"

    def balance(self, system, h):
        return type("Balance", (sc.StepBalance,), {})(system, self, h)


def test_what_is_not_compiled_is_refused_or_runs_plain():
    system, pair = states.PARTS["viscous"]().freeze(), (OwnBalance(), sc.NullSpace())
    why = "there are no compiled kernels for the own integrator, whose balance is its own"
    assert refusal(system, *pair) == why
    with pytest.raises(sc.InputError, match=why):
        sc.simulate(system, *pair, 0.1, 1.0, kernels="numba")
    run = sc.simulate(system, *pair, 1e-6, 2e-6)
    assert run.meta["kernels"] == "numpy" and run.meta["kernels_why"] == why
    with pytest.raises(sc.InputError, match="'fortran', expected"):
        sc.simulate(tree(1), *pair, 0.1, 1.0, kernels="fortran")


def test_long_runs_are_told_that_they_are_not_compiled():
    """At their start; short ones have it in their meta data. No kernels would do explicit steps."""
    system, treatments = tree(1), (sc.NullSpace(), sc.Multipliers(full=True))
    for pair in zip((OwnBalance(), sc.Variational()), treatments, strict=True):
        with pytest.warns(sc.PerformanceWarning, match=r"; 1000000 steps with numpy take"):
            sc.Stepper(system, *pair, 1e-3, steps=10**6)
        sc.Stepper(system, *pair, 1e-3, steps=10)
        sc.Stepper(system, *pair, 1e-3, kernels="numpy", steps=10**6)
    ball = sc.Model()
    ball.add("ball", sc.MassPoint(1.0))
    sc.Stepper(ball, sc.Explicit(), sc.Multipliers(), 1e-6, steps=10**9)


NULL, MULTIPLIERS = sc.NullSpace(), sc.Multipliers()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*singular:skfem_cosserat.ModelWarning")
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.filterwarnings("ignore::skfem_cosserat.PerformanceWarning")
def test_steps_that_compiled_kernels_leave_to_numpy_are_told():
    system = linkage(PARALLELOGRAM, 0.0).freeze()  # flat, and at rest: a singular position
    for steps, told in ((10**6, 1), (30, 0)):
        run = system, sc.EnergyMomentum(), sc.NullSpace(), 1e-3
        stepper, state = sc.Stepper(*run, kernels="numba", steps=steps), sc.initial_state(system)
        for _ in range(25):
            state = stepper.advance(state).state
        found = [each for each in stepper.notices.found if each["category"] == "PerformanceWarning"]
        assert len(found) == told
        if told:
            assert found[0]["time"] == pytest.approx(19e-3)
            assert "left the last 20 steps to plain numpy" in found[0]["text"]
            assert "singular position" in found[0]["text"]


@pytest.mark.parametrize(
    ("scheme", "treatment"),
    [(sc.EnergyMomentum(), MULTIPLIERS), (sc.GeneralizedAlpha(0.8), NULL)],
    ids=repr,
)
def test_a_scene_at_rest_is_left_to_nobody(scheme, treatment):
    """All terms of its balance are rounding, and the residual is as large as they are."""
    section = sc.SectionCircle(radius=0.01, material=sc.Material(E=5e6, nu=0.5, rho=1e3))
    mesh = sc.MeshCurve.init_line((0.1, 0.2, 0.7), (1.0, 0.3, 0.2), 20, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0)))
    base = sc.ground((0.1, 0.2, 0.7)), rod.node("rod.start")
    model.add("hinge", sc.JointRevolute(*base, axis=(0, 0.6, 0.8)))
    model.add("blow", sc.LoadForce(rod.node("rod.end"), (0, 0, 1.0), sc.Table([1, 2], [0, 1])))
    system = model.freeze()
    stepper = sc.Stepper(system, scheme, treatment, 1e-3, kernels="numba")
    state = sc.initial_state(system)
    for _ in range(5):
        state = stepper.advance(state).state
        assert stepper._left_in_a_row == 0
    assert abs(state.q - system.q0).max() < 1e-12
