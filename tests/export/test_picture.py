"""Pictures and films: what is seen is where it is; errors come before work."""

from __future__ import annotations

import sys
from itertools import pairwise

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat import InputError, picture

SMALL = (480, 270)


def place(image, kind):
    """Centre of the pixels of a colour, x to the right and y up; light changes its brightness."""
    from matplotlib.colors import rgb_to_hsv, to_rgb

    hue, saturation, value = rgb_to_hsv(to_rgb(picture.COLOURS[kind]))
    h, s, v = np.moveaxis(rgb_to_hsv(image / 255), -1, 0)
    lit = (v > 0.5 * value) & (v < 1.3 * value + 0.05)
    y, x = np.nonzero((abs(h - hue) < 0.02) & (s > 0.75 * saturation) & lit)
    assert len(x) > 5, f"{kind}: {len(x)} pixels"
    return np.array([x.mean(), -y.mean()])


def hinged():
    """A bar on a hinge, with a ball on it, a spring, a mass point that falls, and loads."""
    model = sc.Model()
    section = sc.SectionRectangle(0.03, 0.03, sc.Material(E=1e8, nu=0.3, rho=1000))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="bar")
    bar = model.add("bar", sc.Beam(mesh, section, director=(0, 1, 0)))
    start, end = bar.node("bar.start"), bar.node("bar.end")
    model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), start, axis=(0, 0, 1)))
    model.add("ball", sc.RigidBody.sphere(0.5, radius=0.06, on=end))
    model.add("spring", sc.SpringDamper(sc.ground((0.5, 0.4, 0)), bar.node((0.5, 0, 0)), 50.0))
    model.add("drop $a$", sc.MassPoint(1.0, position=(0.5, -0.4, 0)))
    model.add("push", sc.LoadForce(bar.node((0.75, 0, 0)), (0, -1.0, 0), lambda t: 5 * t))
    model.add("turn", sc.LoadMoment(bar.node((0.25, 0, 0)), (0, 1.0, 0)))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    return model


def moving(velocity=(1.0, 0, 0)):
    """A ball that flies, beside a mass point at rest; 1 s."""
    model = sc.Model()
    model.add("ball", sc.RigidBody.sphere(1.0, radius=0.05, velocity=velocity))
    model.add("rest", sc.MassPoint(1.0, position=(0, 0.3, 0)))
    return sc.simulate(model, sc.Variational(), sc.NullSpace(), 0.05, 1.0)


def cantilever():
    """A bar, pressed at its end."""
    model = sc.Model()
    section = sc.SectionRectangle(0.03, 0.05, sc.Material(E=1e8, nu=0.3, rho=1000))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="bar")
    bar = model.add("bar", sc.Beam(mesh, section, director=(0, 0, 1), order=2))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), bar.node("bar.start")))
    model.add("push", sc.LoadForce(bar.node("bar.end"), (-1.0, 0, 0)))
    return model


@pytest.mark.render
@pytest.mark.usefixtures("renderer")
def test_a_scene_before_its_run(tmp_path):
    from matplotlib.image import imread

    model = hinged()
    look = {"camera": "xy", "window": SMALL}
    images = []
    for names in (False, True):
        path = model.plot(tmp_path / "scene.png", names=names, **look)
        images.append((255 * imread(path)[..., :3]).round().astype(int))
    image, named = images
    assert image.shape == (270, 480, 3)
    assert (image[[0, -1]] == 255).all()
    assert (image[:, [0, -1]] == 255).all()
    scene = image[:225, 70:400]  # above axes and legend
    kinds = ("joint", "mass point", "spring, cable", "force", "moment", "d1")
    at = {kind: place(scene, kind) for kind in kinds}
    ground = np.argwhere((abs(scene - (92, 97, 102)) < 12).all(axis=2))
    assert len(ground) > 20
    # places in the plane, in pixels per metre by two of them
    scale = (at["mass point"] - at["joint"]) / (0.5, -0.4)
    assert scale[0] == pytest.approx(scale[1], rel=0.03)
    for kind, x in (("force", 0.75), ("moment", 0.25), ("spring, cable", 0.5)):
        assert at[kind][0] == pytest.approx(at["joint"][0] + x * scale[0], abs=4), kind
    assert at["spring, cable"][1] - at["joint"][1] == pytest.approx(0.2 * scale[1], abs=6)
    black = (named.max(axis=2) < 60) & (image.max(axis=2) > 200)
    assert black.sum() > 100  # letters, beside what was there
    assert (abs(named - image).max(axis=2) > 60).sum() < 3 * black.sum() + 400


@pytest.mark.render
@pytest.mark.usefixtures("renderer")
# imageio, which reads the film, leaves a pipe open
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")
@pytest.mark.parametrize("ending", ["gif", "mp4"])
def test_a_film_moves_as_the_scene_does(tmp_path, ending):
    imageio = pytest.importorskip("imageio.v2")
    if ending == "mp4":
        pytest.importorskip("imageio_ffmpeg")
    path = moving().animate(
        tmp_path / f"film.{ending}", fps=5, speed=0.5, camera="xy", window=(401, 225), colour=""
    )
    with imageio.get_reader(path) as film:
        about, images = film.get_meta_data(), [np.asarray(f)[..., :3].astype(int) for f in film]
    assert len(images) == 11
    assert images[0].shape == (224, 400, 3)
    if ending == "gif":
        assert (about["duration"], about["loop"]) == (200, 0)
    else:
        assert (about["fps"], about["codec"], about["pix_fmt"][:7]) == (5, "h264", "yuv420p")
    white = [image[:, -3:].mean() for image in images]
    assert min(white) > 250
    grey = [np.argwhere(abs(im[60:150] - (153, 168, 191)).max(axis=2) < 40) for im in images]
    x = np.array([each.mean(axis=0)[1] for each in grey])
    way = np.diff(x)
    assert way.min() > 5
    np.testing.assert_allclose(way, way.mean(), atol=1.0)  # equal times, equal ways
    rest = [place(image, "mass point") for image in images]
    assert np.ptp(rest, axis=0).max() < 0.5
    clocks = [image[:25, :110] for image in images]
    assert all((abs(a - b) > 60).any() for a, b in pairwise(clocks))


def test_states_and_clock_of_a_film(monkeypatch):
    monkeypatch.setattr(picture, "film", lambda history, path, *frames: frames[:2])
    numbers, texts = moving().animate("film.gif", fps=10, speed=0.8)
    assert numbers == [0, 2, 3, 5, 6, 8, 10, 11, 13, 14, 16, 18, 19]
    assert texts[:3] == ["t = 0.00 s", "t = 0.08 s", "t = 0.16 s"]
    path = sc.static(cantilever(), control=sc.LoadControl(steps=4))
    numbers, texts = path.animate("film.gif", fps=2)
    assert (numbers[-1], texts[-1]) == (4, "load factor 1.000")
    with pytest.raises(InputError, match=r"speed.*10001 frames"):
        moving().animate("film.gif", speed=25e-4)


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.usefixtures("renderer")
@pytest.mark.parametrize("kind", ["modes", "buckling"])
def test_a_mode_moves_about_its_state(tmp_path, kind):
    imageio = pytest.importorskip("imageio.v2")
    model = cantilever()
    found = sc.modes(model, count=1) if kind == "modes" else sc.buckling(model, count=1)
    path = found.animate(0, tmp_path / "mode.gif", camera="xz", window=SMALL)
    images = [np.asarray(image)[..., :3] for image in imageio.mimread(path)]
    height = np.array([place(image[:200], "beam")[1] for image in images])
    assert len(height) == 28
    wave = height - height.mean()
    cycle = wave[0] * np.cos(2 * np.pi * np.arange(28) / 28)
    assert abs(wave[0]) > 4
    np.testing.assert_allclose(wave, cycle, atol=1.5)


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.usefixtures("renderer")
@pytest.mark.parametrize(
    "options",
    [
        {"frames": 3},
        {"frames": [0, -1], "camera": "xy", "colour": "N", "names": True},
        {"frames": 1, "colour": "", "radius": 0.05, "camera": "xz"},
        {"frames": 1, "camera": [(5.0, 5.0, 5.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]},
    ],
)
def test_pictures_of_a_history(make_scene, tmp_path, options):
    from matplotlib.image import imread

    history = make_scene(2).history(11)
    released = np.where(history.times[:, None] < 0.5, history["joint/pin/position"], np.nan)
    history.add_series("joint/pin/position", released)
    path = history.picture(tmp_path / "a.png", window=SMALL, **options)
    drawn = (imread(path)[..., :3] < 0.95).any(axis=2)
    assert drawn.shape == (270, 480)
    assert 0.02 < drawn.mean() < 0.6
    assert not drawn[[0, -1]].any()  # everything is in the picture
    assert not drawn[:, [0, -1]].any()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="bar")
    lines = imread(mesh.plot(tmp_path / "mesh.png", window=SMALL, camera="xy"))[..., :3]
    assert 300 < np.ptp(np.argwhere((lines[:190, 60:420] < 0.9).any(axis=2))[:, 1]) < 400


def test_without_a_driver_there_is_an_error(make_scene, tmp_path, monkeypatch):
    pytest.importorskip("pyvista")
    monkeypatch.setattr(sys, "executable", "false")  # the process that tries to draw fails
    monkeypatch.setattr(picture, "_driver", picture._driver.__wrapped__)
    with pytest.raises(sc.CosseratError, match="libgl1-mesa-dri"):
        make_scene().history(2).picture(tmp_path / "a.png")


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda h, p: h.picture(p / "no" / "a.png"), "no"),
        (lambda h, p: h.picture(p / "a.jpg"), "'.png'"),
        (lambda h, p: h.picture(p / "a.png", frames=0), "frames"),
        (lambda h, p: h.picture(p / "a.png", frames=[0, 3]), "frames: got .0, 3., .* are 3"),
        (lambda h, p: h.picture(p / "a.png", camera="up"), "camera"),
        (lambda h, p: h.picture(p / "a.png", camera=[(0, 0, 1)]), "camera"),
        (lambda h, p: h.picture(p / "a.png", colour="Q"), "colour"),
        (lambda h, p: h.picture(p / "a.png", radius=-1.0), "radius"),
        (lambda h, p: h.picture(p / "a.png", window=(0, 10)), "window"),
        (lambda h, p: h.truncated(0).picture(p / "a.png"), "no states"),
        (lambda h, p: h.truncated(0).animate(p / "a.gif"), "no states"),
        (lambda h, p: h.animate(p / "a.avi"), "'.gif', '.mp4'"),
        (lambda h, p: h.animate(p / "a.gif", fps=0), "fps"),
        (lambda h, p: h.animate(p / "a.gif", fps=60), "fps"),
        (lambda h, p: h.animate(p / "a.gif", speed=-1), "speed"),
        (lambda h, p: sc.MeshCurve().plot(p / "a.png", camera="up"), "camera"),
    ],
)
def test_bad_arguments(make_scene, tmp_path, call, words):
    with pytest.raises(InputError, match=words):
        call(make_scene().history(3), tmp_path)
