"""What notebooks show: names of users escaped, numbers with their units, outlines with holes."""

from __future__ import annotations

import re
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import pytest

import skfem_cosserat as sc

STEEL = sc.Material(210e9, 0.3, 7850.0)


class Table(HTMLParser):
    """Rows of a table by name, as a browser reads them; no other tags than these."""

    def __init__(self, thing):
        super().__init__()
        self.rows, self.tag, self.tags = {}, "", set()
        self.feed(thing._repr_html_())
        assert self.tags <= {"b", "table", "tr", "th", "td", "pre", "svg", "path"}

    def handle_starttag(self, tag, attrs):
        self.tag = tag
        self.tags.add(tag)

    def handle_data(self, data):
        if self.tag == "th":
            self.name = data
        elif self.tag == "pre":
            self.rows[self.name] = data


@pytest.fixture(scope="module")
def scene():
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (2, 0, 0), 4, name="<b>rod</b>", nodes={"tip": 1.0})
    taper = sc.SectionTaper(sc.SectionTube(0.05, 0.04, STEEL), sc.SectionTube(0.03, 0.02, STEEL))
    rod = model.add("<i>", sc.Beam(mesh, taper, order=2, director=(0, 1, 0)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node((0, 0, 0))))
    model.add("push", sc.LoadForce(rod.node("tip"), (0, 5.0, 0)))
    return model, rod


def test_sections_have_numbers_and_outlines():
    tube = sc.SectionTube(0.05, 0.04, STEEL)
    rows = Table(tube.damped(time=2e-3)).rows
    assert float(rows["EA in N"]) == pytest.approx(210e9 * np.pi * (0.05**2 - 0.04**2), rel=1e-5)
    assert float(rows["mass in kg/m"]) == pytest.approx(tube.mass, rel=1e-5)
    assert rows["retardation times in s"] == "[0.002, 0.002, 0.002, 0.002, 0.002, 0.002]"
    box = sc.ProfileBox(0.1, 0.05, 0.005, STEEL)
    assert float(Table(box).rows["area in m²"]) == pytest.approx(0.1 * 0.05 - 0.09 * 0.04)
    for thing, ratio in ((tube, 0.8), (box, 0.9)):
        loops = re.search(r'd="M([^"]*)Z"', thing._repr_html_())[1].split("ZM")
        outer, inner = (np.array([p.split(",") for p in way.split("L")], float) for way in loops)
        assert np.ptp(outer[:, 0]) == pytest.approx(0.1, rel=1e-5)
        assert np.ptp(inner[:, 0]) == pytest.approx(ratio * np.ptp(outer[:, 0]), rel=1e-5)


def test_scenes_and_what_varies(scene):
    model, rod = scene
    rows = Table(rod).rows
    assert [rows[name] for name in ("length in m", "elements", "order")] == ["2", "4", "2"]
    mass = 7850 * np.pi * 0.01 * (0.09 + 0.05) / 2 * 2  # (outer - inner)(outer + inner)
    assert float(rows["mass in kg"]) == pytest.approx(mass, rel=1e-5)
    ends = [float(x) for x in re.findall(r"mass in kg/m: ([0-9.]+)", rows["section"])]
    np.testing.assert_allclose(ends, [7850 * np.pi * 0.01 * x for x in (0.09, 0.05)], rtol=1e-5)
    assert Table(model).rows["beam '<i>'"].startswith("elements=4, order=2, ")
    assert float(Table(model.freeze()).rows["mass in kg"]) == pytest.approx(mass, rel=1e-5)
    assert Table(rod.mesh).rows["beams"] == "<b>rod</b>"
    assert sc.Model()._repr_html_() == "<b>Model</b> (empty)"


def test_results(scene):
    model, rod = scene
    path = sc.static(model)
    rows = Table(path).rows
    assert rows["load factor"] == "[0, 1]" and not any("time" in name for name in rows)
    modes = sc.modes(model, path, 2)
    rows = Table(modes).rows
    assert rows["about"] == "load factor 1" and "about load factor 1, " in repr(modes)
    assert rows["modes"] == str(modes) and f"{modes.frequencies[0]:.7g}" in rows["modes"]
    assert Table(sc.modes(model, None, 1)).rows["about"] == "t = 0 s"
    seen = {"tip": sc.SensorPosition(rod.node("tip"))}
    run = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, 3e-3, sensors=seen)
    rows = Table(run).rows
    assert (rows["step in s"], rows["time in s"]) == ("0.001", "[0, 0.003]")
    assert rows["sensors"] == "tip: m" and rows["beam/<i>"].startswith("strain, resultant")
    found = sc.answer(model, {"<tip>": seen["tip"]}, 1e-4, None)
    assert re.match(r"within the tolerance\n<tip>: \[", Table(found).rows["answer"])


def test_nothing_is_drawn_with_other_packages():
    """No matplotlib, no VTK is imported."""
    code = "import skfem_cosserat as sc, sys; sc.SectionCircle(1, sc.Material(1, 0, 1))"
    code += (
        "._repr_html_(); sys.exit(len({'matplotlib', 'vtkmodules', 'pyvista'} & {*sys.modules}))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_citation():
    text = sc.citation()
    assert f"version = {{{sc.__version__}}}" in text and "10.1002/zamm.200700173" in text
    assert text.count("{") == text.count("}")
