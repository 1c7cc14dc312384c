"""Charts and tables by name: each curve has the numbers of the sensor or series it names."""

from __future__ import annotations

import csv
import sys

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat.export import write_csv
from skfem_cosserat.plot import plot_orbit
from skfem_cosserat.run import derive_series

pytest.importorskip("matplotlib")
SECTION = sc.SectionCircle(0.01, sc.Material(5e6, 0.5, 1100))


def rod_with_tip(model, order=1):
    """A clamped rod whose vertices are not numbered along it, and its tip."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod").refined([1])
    rod = model.add("rod", sc.Beam(mesh, SECTION, order=order, director=(0, 1, 0)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    return rod.node("rod.end")


@pytest.fixture(scope="module")
def run():
    """A run with a sensor called as the chart of energies is, and its history."""
    model = sc.Model()
    tip = rod_with_tip(model, order=3)
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    seen = {"tip": sc.SensorPosition(tip), "energy": sc.SensorVelocity(tip)}
    scheme = sc.EnergyMomentum(), sc.NullSpace()
    return model, tip, sc.simulate(model, *scheme, 2e-3, 0.02, every=5, sensors=seen)


def test_a_chart_by_names(run, tmp_path):
    """Energies with their balance, a sensor at every step, a series at the recorded states."""
    _, tip, history = run
    figure = history.plot("energy", "tip", "joint/clamp/force", path=tmp_path / "a.png")
    energies, _, sensor, series = figure.axes
    labels = [axis.get_ylabel() for axis in figure.axes]
    assert labels[:3:2] == ["energy in J", "tip in m"]  # not the sensor "energy": as documented
    assert labels[3] == "joint/clamp/force in N"
    total = next(line for line in energies.get_lines() if line.get_label() == "total")
    np.testing.assert_array_equal(total.get_ydata(), history["energy"])
    across = sensor.get_lines()[1]
    np.testing.assert_array_equal(across.get_ydata(), history.sensors["tip"].values[:, 1])
    assert len(across.get_xdata()) == 11 and len(series.get_lines()[0].get_xdata()) == 3
    assert figure._repr_png_()[:4] == (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    assert [axis.get_ylabel() for axis in history.plot().axes][:3] == labels[:3]
    (way,) = plot_orbit(history, "beam/rod/-1").axes
    np.testing.assert_array_equal(way.get_lines()[0].get_ydata(), history.position(tip)[:, 1])
    single = history.truncated(1).plot("energy", "tip")
    assert all(axis.get_lines()[0].get_marker() == "o" for axis in single.axes)


def test_a_path_has_its_load_factor_below(tmp_path):
    model = sc.Model()
    model.add("push", sc.LoadForce(rod_with_tip(model), (0, 1e-3, 0)))
    path = sc.static(model, control=sc.ArcLength(points=4), derive=False)
    (axis,) = path.plot().axes  # the work of the loads, without energies
    assert axis.get_xlabel() == "load factor" and axis.get_ylabel() == "work_loads in J"
    np.testing.assert_array_equal(axis.get_lines()[0].get_xdata(), path["load_factor"])
    derive_series(model, path)
    (axis,) = path.plot("load/push/force").axes  # of a load of one place: a vector
    np.testing.assert_allclose(axis.get_lines()[1].get_ydata(), 1e-3 * path["load_factor"])
    assert ", load factor 0 ... " in repr(path)
    frame = pytest.importorskip("pandas") and path.to_pandas("work_loads", "load/push/force")
    assert frame.index.name == "load_factor"
    np.testing.assert_array_equal(frame["work_loads"], path["work_loads"])
    np.testing.assert_allclose(frame["load/push/force_y"], 1e-3 * path["load_factor"])


def test_tables_of_sensors_and_series(run, tmp_path):
    """At the recorded states beside series; at every step alone."""
    history, seen = run[2], run[2].sensors["tip"]
    for names, values in ((["t", "tip", "kinetic"], seen.values[::5]), (["tip"], seen.values)):
        lines = write_csv(history, tmp_path / "a.csv", names).read_text().splitlines()
        rows = list(csv.DictReader(line for line in lines if line[0] != "#"))
        got = [[float(row[f"tip_{x}"]) for x in "xyz"] for row in rows]
        np.testing.assert_array_equal(got, values)
        assert [float(row["t"]) for row in rows] == (
            history.times if "kinetic" in names else seen.times
        ).tolist()
    frame = pytest.importorskip("pandas") and history.to_pandas("tip", "kinetic")
    np.testing.assert_array_equal(frame["tip_y"], seen.values[::5, 1])
    np.testing.assert_array_equal(frame["kinetic"], history["kinetic"])
    np.testing.assert_array_equal(frame.index, history.times)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda h: h.plot("tpi"), "series 'tpi': .*did you mean 'tip'"),
        (lambda h: h.plot("beam/rod/resultant"), r"history\.add_series.*SensorForce\(beam, s\)"),
        (lambda h: h.plot("constraint_violation"), r"run\.derive_series\(model, history\)"),
        (lambda h: h.to_pandas("kinetc"), "did you mean 'kinetic'"),
        (lambda h: write_csv(h, "never.csv", ["tpi"]), "did you mean 'tip'"),
    ],
)
def test_names_that_are_none(run, tmp_path, call, words):
    run[2].save(tmp_path / "a.history")
    with pytest.raises(sc.InputError, match=words):
        call(sc.History.load(tmp_path / "a.history"))


def test_without_pandas_the_extra_is_named(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match=r"skfem-cosserat\[pandas\]"):
        run[2].to_pandas()
