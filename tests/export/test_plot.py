"""Charts: the numbers drawn are those of the history; errors come before work."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat import InputError
from skfem_cosserat.plot import plot_energy, plot_orbit

matplotlib = pytest.importorskip("matplotlib")


@pytest.mark.slow
def test_energies_are_those_of_the_history(make_scene, tmp_path):
    history = make_scene().history(20)
    upper, lower = plot_energy(history, tmp_path / "energy.png").axes
    assert (tmp_path / "energy.png").read_bytes()[:4] == b"\x89PNG"
    lines = {line.get_label(): line for line in upper.get_lines()}
    np.testing.assert_array_equal(lines["kinetic"].get_ydata(), history["kinetic"])
    drift = lower.get_lines()[0].get_ydata()
    np.testing.assert_allclose(drift, 1e-9 * np.arange(20), rtol=1e-6)  # largest energy is 1
    assert (upper.get_ylabel(), lower.get_xlabel()) == ("energy in J", "time in s")


@pytest.mark.slow
def test_a_perfect_run_with_gravity_and_a_spring(tmp_path):
    """The total changes by the work of gravity: what is wrong is in the balance."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, position=(1, 0, 0)))
    model.add("spring", sc.SpringDamper(sc.ground((0, 0, 0)), ball.place(), 100.0))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 0.5)
    upper, lower = plot_energy(history, tmp_path / "energy.png").axes
    lines = {line.get_label(): line for line in upper.get_lines()}
    assert set(lines) == {"kinetic", "strain", "springs", "total"}
    np.testing.assert_array_equal(lines["springs"].get_ydata(), history["coupling_energy"])
    assert abs(lower.get_lines()[0].get_ydata()).max() < 1e-10
    assert lower.get_ylabel() == "balance of energy\n/ largest energy"
    (only,) = plot_energy(history, names=["energy_balance"]).axes
    assert only.get_ylabel() == lower.get_ylabel()


def test_series_have_units_where_they_are_known():
    """Of a spring between two points N, of one on a joint's angle not: it is a moment."""
    model = sc.Model()
    rod = model.add("rod", sc.RigidBody.rod(1.0, 1.0, triad=sc.triad((1.0, 0, 0))))
    pin = model.add("pin", sc.JointRevolute(sc.ground((0, 0, 0)), rod.at((0, 0, 0)), (0, 1, 0)))
    model.add("on", sc.JointSpringDamper(pin, 1.0))
    model.add("spring", sc.SpringDamper(sc.ground((0, 0, 1)), rod.at((0.5, 0, 0)), 1.0))
    history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 0.05)
    names = ["joint/pin/angle", "coupling/spring/force", "coupling/on/force", "energy_balance"]
    labels = [axis.get_ylabel() for axis in history.plot(*names).axes]
    assert labels == [
        *(f"{n} in {u}" for n, u in zip(names, ("rad", "N"), strict=False)),
        *(names[2], "energy_balance in J"),
    ]


def test_energy_with_gaps_and_without_total(make_scene):
    history = make_scene().history(5)
    history.add_series("energy_midpoint", np.array([np.nan, 2.0, 2.0, 2.0, 3.0]))
    lower = plot_energy(history).axes[1]
    drift = lower.get_lines()[1].get_ydata()
    np.testing.assert_allclose(drift, np.array([np.nan, 0.0, 0.0, 0.0, 1.0]) / 3.0)
    for name in ("energy", "energy_midpoint", "kinetic", "strain_energy"):
        history._series.pop(name)
    with pytest.raises(InputError, match="energy series"):
        plot_energy(history)


@pytest.mark.slow
def test_orbit_and_series(make_scene, tmp_path):
    history = make_scene().history(20)
    what = ["body/hub", "point/ball", "beam/boom/-1", "beam/angle/0", "joint/pin"]
    axis = plot_orbit(history, what, tmp_path / "orbit.svg", axes="yx").axes[0]
    lines = {line.get_label(): line for line in axis.get_lines()}
    np.testing.assert_array_equal(
        lines["joint/pin"].get_xdata(), history["joint/pin/position"][:, 1]
    )
    np.testing.assert_array_equal(lines["beam/boom/-1"].get_ydata(), history["q"][:, 24])
    assert axis.get_xlabel() == "y in m"
    assert (tmp_path / "orbit.svg").stat().st_size > 1000
    axes = history.plot("momentum", "kinetic").axes
    assert [len(axis.get_lines()) for axis in axes] == [3, 1]


def test_charts_leave_no_global_state(make_scene):
    plot_energy(make_scene().history(3))
    if "matplotlib.pyplot" in sys.modules:
        assert not sys.modules["matplotlib.pyplot"].get_fignums()


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda h, p: plot_orbit(h, "body/none"), "body/none"),
        (lambda h, p: plot_orbit(h, "beam/boom"), "beam/boom"),
        (lambda h, p: plot_orbit(h, "beam/boom/3"), "3 vertices"),
        (lambda h, p: plot_orbit(h, "body/hub", axes="xx"), "axes"),
        (lambda h, p: h.plot("nothing"), "nothing"),
        (lambda h, p: h.plot("beam/boom/strain"), "beam/boom/strain"),
        (lambda h, p: plot_energy(h, p / "no" / "a.png"), "no"),
        (lambda h, p: plot_energy(h, names=["momentum"]), "momentum"),
    ],
)
def test_bad_arguments(make_scene, tmp_path, call, words):
    with pytest.raises(InputError, match=words):
        call(make_scene().history(3), tmp_path)


@pytest.mark.parametrize(
    ("package", "call"),
    [
        ("matplotlib.figure", lambda h, p: plot_energy(h)),
        ("pyvista", lambda h, p: h.picture(p / "a.png")),
    ],
)
def test_missing_package_names_the_extra(make_scene, tmp_path, monkeypatch, package, call):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=r"skfem-cosserat\[view\]"):
        call(make_scene().history(2), tmp_path)
