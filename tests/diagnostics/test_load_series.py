"""Series of loads: where they act, with which forces and moments."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import skfem_cosserat as sc


class Drag(sc.Load):
    """A force that is a function of the motion."""

    def __init__(self, place: sc.Place) -> None:
        super().__init__()
        self.place = place

    def terms(self):
        return [sc.TermFunction([self.place], lambda x, v, t: -0.3 * v + t)]


def scene(order: int = 2):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="rod")
    rod = sc.SectionCircle(radius=2e-2, material=sc.Material(E=1e7, nu=0.3, rho=1000))
    model = sc.Model()
    beam = model.add("rod", sc.Beam(mesh, rod, director=(0, 1, 0), order=order))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("rod.start")))
    return model, beam, beam.node("rod.end")


def ramp(t):
    return 1.0 + t


@pytest.fixture(scope="module")
def run():
    model, beam, end = scene()
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    model.add("dead", sc.LoadForce(end, (0, 2.0, 0), ramp))
    model.add("thrust", sc.LoadForce(end, (0, 0, 3.0), follower=True))
    model.add("torque", sc.LoadMoment(end, (0, 1.0, 0), 0.1))
    model.add("wind", sc.LoadLine(beam, (0, 4.0, 0), ramp, moment=(0.5, 0, 0)))
    model.add("blow", sc.LoadLine(beam, (0, 5.0, 0), follower=True))
    model.add("drag", Drag(end))
    return model, sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 2e-3, until=0.02)


def test_forces_follow_the_motion(run):
    model, history = run
    end, t = model["rod"].node("rod.end"), history.times
    x, last = history.position(end), np.eye(3)[1]
    offset = history.static["beam/rod/offsets"][model["rod"].basis.connectivity[-1, -1]]
    directors = history["q"][:, offset + 3 : offset + 12].reshape(-1, 3, 3)
    assert [entry["name"] for entry in history.meta["loads"]][:2] == ["gravity", "dead"]
    assert history.meta["loads"][0]["acceleration"] == [0.0, 0.0, -9.81]
    assert "load/gravity/force" not in history
    for name in ("dead", "thrust", "torque", "drag"):
        assert_allclose(history[f"load/{name}/position"][:, 0], x, atol=1e-12)
    assert_allclose(history["load/dead/force"][:, 0], 2.0 * (1.0 + t)[:, None] * last)
    assert_allclose(history["load/thrust/force"][:, 0], 3.0 * directors[:, 2], atol=1e-12)
    assert_allclose(history["load/torque/moment"][:, 0], np.tile(0.1 * last, (len(t), 1)))
    v = history["v"][:, offset : offset + 3]
    assert_allclose(history["load/drag/force"][:, 0], -0.3 * v + t[:, None], atol=1e-12)


def test_line_loads_are_forces_of_elements(run):
    _, history = run
    force, moment = history["load/wind/force"], history["load/wind/moment"]
    total = 4.0 * (1.0 + history.times)
    assert_allclose(force.sum(1)[:, 1], total, rtol=1e-12)
    assert_allclose(force[:, 0, 1], total / 3, rtol=1e-12)
    assert_allclose(moment.sum(1)[:, 0], 0.5 * (1.0 + history.times), rtol=1e-12)
    assert_allclose(history["load/wind/position"][0, :3, 0], (1 / 6, 0.5, 5 / 6))
    directors = history["load/blow/force"] / (5.0 / 3.0)  # they turn with the sections
    assert directors[0] == pytest.approx(np.tile((0, 0, 1.0), (3, 1)), abs=1e-12)
    assert_allclose(np.linalg.norm(directors, axis=-1), 1.0, atol=3e-3)  # interpolated


def test_loads_of_a_path_have_its_factors():
    model, _, end = scene()
    model.add("push", sc.LoadForce(end, (0, 0, 2.0)))
    model.add("drag", Drag(end))
    path = sc.static(model, control=sc.LoadControl(steps=2))
    factor = path["load_factor"]
    assert_allclose(path["load/push/force"][:, 0, 2], 2.0 * factor)
    assert_allclose(path["load/drag/force"][:, 0, 2], factor**2)
    assert path.meta["factors"]["loads"] == [["push", False]]
