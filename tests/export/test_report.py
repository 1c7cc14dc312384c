"""The page of a run: its numbers are those of the history, and a browser draws them."""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

import skfem_cosserat as sc

pytest.importorskip("plotly")
pytest.importorskip("matplotlib")

EVIL = "</script><b>"


@pytest.fixture(scope="module")
def scene():
    """A swinging rod with a ball and a box; names that would end the page's script."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    section = sc.SectionCircle(0.02, sc.Material(5e6, 0.5, 1100))
    rod = model.add(EVIL, sc.Beam(mesh, section, order=3, director=(0, 1, 0)))
    model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), (0, 0, 1)))
    box = model.add("box", sc.RigidBody.box(0.1, (0.1, 0.1, 0.1), position=(0, 0.5, 0)))
    ball = model.add("ball", sc.MassPoint(0.1, position=(0, -0.5, 0), velocity=(1, 0, 0)))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    seen = {"tip <!--": sc.SensorPosition(rod.node("rod.end"))}
    scheme = sc.EnergyMomentum(), sc.NullSpace()
    return rod, box, ball, sc.simulate(model, *scheme, 5e-3, 0.2, every=4, sensors=seen)


def data_of(page):
    """What the page's script reads."""
    found = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page)
    return json.loads(found[0])


def unpacked(packed):
    return np.frombuffer(base64.b64decode(packed["base64"]), "<f4").reshape(packed["shape"])


def test_numbers_of_the_page(scene, tmp_path):
    rod, box, ball, history = scene
    path = history.report(tmp_path / "a.html")
    page = path.read_text(encoding="utf-8")
    assert path.stat().st_size < 10e6 and "http-equiv" not in page
    assert not re.search(r"<(script|link|img)[^>]*(src|href)=", page)  # nothing from a network
    assert EVIL not in page and "&lt;/script&gt;&lt;b&gt;" in page
    data = data_of(page)
    rod_frames, box_frames, ball_frames = (unpacked(item["frames"]) for item in data["items"])
    assert data["over"] == "time in s" and data["at"] == history.times.tolist()
    assert [item["name"] for item in data["items"]] == [EVIL, "box", "ball"]
    places = rod_frames.reshape(len(history), 16, 4, 3)
    s = (np.arange(4)[:, None] + np.arange(4) / 3).ravel() / 4
    np.testing.assert_allclose(places[:, :, 0], history.position(rod, s), atol=1e-6)
    turned = history.rotation(rod.node("rod.end"))
    np.testing.assert_allclose(places[:, -1, 1:], turned, atol=1e-6)
    for frames, place in ((box_frames, box.at((0, 0.5, 0))), (ball_frames, ball.place())):
        np.testing.assert_allclose(frames[:, 0], history.position(place), atol=1e-6)
    labels = [chart["label"] for chart in data["charts"]]
    assert labels == ["energy in J", "balance of energy\n/ largest energy", "tip <!-- in m"]
    total = unpacked(data["charts"][0]["curves"]["total"])
    np.testing.assert_allclose(total, [history.times, history["energy"]], rtol=1e-6)
    height = unpacked(data["charts"][2]["curves"]["y"])[1]
    np.testing.assert_allclose(height, history.sensors["tip <!--"].values[:, 1], atol=1e-6)


def test_long_runs_are_thinned(make_scene, tmp_path):
    history = make_scene().history(1500)
    page = history.report(tmp_path / "a.html").read_text(encoding="utf-8")
    data = data_of(page)
    states = unpacked(data["items"][0]["frames"])
    assert len(states) == len(data["at"]) == 1000 and "1000 of 1500 states are shown" in page
    assert data["at"][:: len(states) - 1] == history.times[:: len(history) - 1].tolist()
    with pytest.raises(sc.InputError, match="no states"):
        history.truncated(0).report(tmp_path / "a.html")


def test_a_path_has_load_factors(tmp_path):
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, position=(1, 0, 0)))
    model.add("spring", sc.SpringDamper(sc.ground((0, 0, 0)), ball.place(), 100.0))
    model.add("pull", sc.LoadForce(ball.place(), (5.0, 0, 0)))
    for way in (None, (0, 1, 0), (0, 0, 1)):
        if way is not None:
            model.add(f"guide {way}", sc.SpringDamper(sc.ground((1, *way[1:])), ball.place(), 10.0))
    path = sc.static(model)
    data = data_of(path.report(tmp_path / "a.html").read_text(encoding="utf-8"))
    assert data["over"] == "load factor" and data["at"] == path["load_factor"].tolist()
    places = unpacked(data["items"][0]["frames"])[:, 0]
    np.testing.assert_allclose(places, path.position(ball.place()), atol=1e-6)
    assert data["charts"][0]["label"] == "energy in J"


def test_without_plotly_the_extra_is_named(scene, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(ImportError, match=r"skfem-cosserat\[report\]"):
        scene[-1].report(tmp_path / "a.html")


BROWSERS = ("chromium-headless-shell", "chromium", "google-chrome")
#: what a user does: moves the slider; what is drawn then goes where a test can read it
MOVED = """<script>
{
  const last = () => ["x", "y"].map(c => document.getElementById("scene").data[0][c].at(-1));
  const before = last();
  slider.value = slider.max;
  slider.dispatchEvent(new Event("input"));
  document.body.dataset.seen = JSON.stringify({before, after: last(), now: now.textContent});
}
</script>"""


def browse(page, *options):
    """Output and messages of a browser that has opened the page."""
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        message = "no browser is installed: " + ", ".join(BROWSERS)
        if os.environ.get("SKFEM_COSSERAT_BROWSER") == "require":
            pytest.fail(message)
        pytest.skip(message)
    always = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"]
    always += ["--virtual-time-budget=20000", "--enable-logging=stderr", "--window-size=1000,800"]
    command = [browser, *always, *options, page.as_uri()]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)


@pytest.mark.slow
def test_a_browser_draws_it(scene, tmp_path):
    """The scene is drawn where the state is, the slider moves it, the script has no error."""
    from html import unescape

    from matplotlib.image import imread

    rod, *_, history = scene
    page = history.report(tmp_path / "a.html")
    shots = []
    for k, more in enumerate(["", MOVED]):
        moved = tmp_path / f"{k}.html"
        moved.write_text(page.read_text(encoding="utf-8") + more, encoding="utf-8")
        run = browse(moved, f"--screenshot={tmp_path / 'a.png'}")
        assert "Uncaught" not in run.stderr and "Error" not in run.stderr
        shots.append(imread(tmp_path / "a.png")[..., :3])
    blue = [
        np.argwhere((shot[..., 2] - shot[..., 0] > 0.3) & (shot[..., 1] < 0.5)) for shot in shots
    ]
    assert min(map(len, blue)) > 100  # corners of the rod's surface
    assert abs(blue[0][:, 0].mean() - blue[1][:, 0].mean()) > 5  # it has swung down
    dom = browse(moved, "--dump-dom").stdout
    seen = json.loads(unescape(re.search(r'data-seen="(.*?)"', dom)[1]))
    end = history.position(rod.node("rod.end"))
    for name, k in (("before", 0), ("after", -1)):
        assert np.hypot(*(seen[name] - end[k, :2])) < 0.021  # the radius
    assert seen["now"] == "time 0.20000 s"
