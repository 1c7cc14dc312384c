"""Every example is imported without side effects, and its numbers are checked."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples").glob("*.py"))


def load(name):
    path = EXAMPLES[0].parent / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"example_{name}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_import_has_no_side_effects(path, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert callable(load(path.stem).main)
    captured = capfd.readouterr()
    assert captured.out == ""
    assert list(tmp_path.iterdir()) == []


def test_cantilever_of_scikit_fem_alone():
    """Tip force, against Timoshenko's closed form: exact at the nodes."""
    result = load("skfem_alone").main()
    assert result["tip"] == pytest.approx(result["theory"], rel=1e-9)


def test_cantilever_on_an_elastic_foundation():
    """A form of the user's own adds to ours; closed form of Hetenyi without shear."""
    k, EI, P, L = 1e4, 210e9 * np.pi * 0.01**4 / 4, 100.0, 1.0
    b = (k / (4 * EI)) ** 0.25
    x = b * L
    shape = (np.sinh(x) * np.cosh(x) - np.sin(x) * np.cos(x)) / (np.cosh(x) ** 2 + np.cos(x) ** 2)
    tip = load("skfem_alone").main(elements=16, foundation=k)["tip"]
    assert tip == pytest.approx(2 * P * b / k * shape, rel=5e-4)


@pytest.mark.slow
def test_refinement_study(tmp_path):
    """Orders 2p in statics; a load that is there at once leaves none, one that grows does."""
    study = load("refinement_study")
    study.STEPS = (4e-3, 2e-3, 1e-3, 5e-4)
    result = study.main(out=tmp_path)
    for order in (1, 2, 3, 4):
        for name in ("tip", "energy"):
            assert abs(result["bend"]["orders"][f"{name}, order = {order}"] - 2 * order) < 0.1
    for name in ("ball", "strain energy"):
        assert "not in the asymptotic range" in result["swing_sudden"]["verdicts"][name]
        assert abs(result["swing_growing"]["orders"][name] - 2) < 0.1
        error, doubt = result["swing_growing"]["estimate"][name]
        assert 0 < doubt < 0.1 * error
    names = {path.name for path in tmp_path.iterdir()}
    assert {"bend.csv", "swing_sudden.csv", "swing_growing.csv"} <= names


@pytest.mark.slow
def test_events(tmp_path):
    """A chain that locks a joint and lets its ball go: energy and parabola to rounding."""
    result = load("events").main(out=tmp_path / "events.png")
    times, losses = result["times"], result["losses"]
    assert list(times) == ["motor off", "knee locks", "ball let go"]
    assert losses["knee locks"] > 0.1 > 1e6 * abs(losses["motor off"])
    assert result["balance"] < 1e-9 and result["parabola"] < 1e-11
    history = result["history"]
    row = history.events[1].row
    assert abs(history["joint/joint 2/angle"][row + 1 :]).max() < 1e-9
    assert abs(history["joint/joint 2/angle_rate"][row + 1 :]).max() < 1e-9
    fine = load("events").main(tolerance=1e-4)
    assert fine["times"]["ball let go"] == pytest.approx(times["ball let go"], abs=2e-3)
    assert (tmp_path / "events.png").stat().st_size > 1000
