"""Blades read from files of BeamDyn: the IEA 15 MW blade, and files that are wrong."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh

import skfem_cosserat as sc

#: IEA-15-240-RWT of IEA Wind Task 37 (github.com/IEAWindTask37/IEA-15-240-RWT), Apache 2.0
FOLDER = Path(__file__).parents[1] / "data" / "iea15"
PRIMARY, BLADE = "IEA-15-240-RWT_BeamDyn.dat", "IEA-15-240-RWT_BeamDyn_blade.dat"


def frequencies(order):
    return sc.modes(sc.read_beamdyn(FOLDER / PRIMARY, order).model, count=3).frequencies


def test_what_the_files_say():
    blade = sc.read_beamdyn(FOLDER / PRIMARY)
    assert blade.mesh.lengths.sum() == pytest.approx(117.149, abs=1e-3)
    assert len(blade.section.s) == 26 and "rhoinf" in blade.left
    assert blade.twist(0.0) == pytest.approx(-np.pi / 2 - np.radians(15.5946))
    root = blade.section.at(0.0, 1.0)
    assert root.mass == 3.1274021155424143e3 and root.stiffness[3, 3] == 1.4962901263796594e11
    assert root.viscosity[3, 3] == pytest.approx(0.00218775 * root.stiffness[3, 3])
    # M_46 of the file is m X_cm, M_16 is -m Y_cm
    assert root.mass * root.centre == pytest.approx([-0.23227931035313248, -73.931954710604941])
    assert blade.beam.node("blade.end").position == pytest.approx([-4, 0, 117])


def linear_elements(count):
    """Frequencies by two-node Timoshenko elements of their own, constant sections in each."""
    lines = (FOLDER / PRIMARY).read_text().splitlines()
    first = next(k for k, line in enumerate(lines) if "kp_total" in line) + 4
    points = np.array([line.split() for line in lines[first : first + 50]], dtype=float)
    words = (FOLDER / BLADE).read_text().partition("PROPERTIES")[2].split("\n", 1)[1].split()
    table = np.array(words[: 26 * 73], dtype=float).reshape(26, 73)
    z, line = points[:, 2], CubicSpline(points[:, 2], points[:, :2])
    fine = np.linspace(0, z[-1], 20001)
    way = np.linalg.norm(np.diff(np.column_stack([line(fine), fine]), axis=0), axis=1)
    s = np.append(0, np.cumsum(way))
    stops = np.interp(np.linspace(0, s[-1], count + 1), s, fine)
    x = np.column_stack([line(stops), stops])
    K, M = (np.zeros((6 * count + 6, 6 * count + 6)) for _ in range(2))
    for e, (a, b) in enumerate(pairwise(x)):
        h = np.linalg.norm(b - a)
        d3 = (b - a) / h
        d1 = np.cross([0, 1, 0], d3) / np.linalg.norm(np.cross([0, 1, 0], d3))
        angle = -np.radians(CubicSpline(z, points[:, 3])(stops[e : e + 2].mean()))
        d1 = np.cos(angle) * d1 + np.sin(angle) * np.cross(d3, d1)
        R = np.array([d1, np.cross(d3, d1), d3])
        own = [np.interp((e + 0.5) / count, table[:, 0], column) for column in table[:, 1:].T]
        D, mass = np.reshape(own, (2, 6, 6))
        cross = np.array([[0, -d3[2], d3[1]], [d3[2], 0, -d3[0]], [-d3[1], d3[0], 0]])
        B = np.zeros((6, 12))
        B[:3, :3], B[:3, 6:9], B[3:, 3:6], B[3:, 9:] = -R / h, R / h, -R / h, R / h
        B[:3, 3:6] = B[:3, 9:] = 0.5 * R @ cross
        turned, rows = np.kron(np.eye(2), R), np.arange(6 * e, 6 * e + 12)
        K[np.ix_(rows, rows)] += h * B.T @ D @ B
        weights = np.array([[2, 1], [1, 2]]) / 6
        M[np.ix_(rows, rows)] += h * np.kron(weights, turned.T @ mass @ turned)
    squares = eigh(K[6:, 6:], M[6:, 6:], eigvals_only=True, subset_by_index=[0, 2])
    return np.sqrt(squares) / (2 * np.pi)


@pytest.mark.slow
def test_frequencies_against_elements_of_another_kind():
    """The files give 0.507 and 0.693 Hz; 0.555 and 0.642 of the report are of another revision."""
    assert frequencies(3) == pytest.approx(linear_elements(100), rel=4e-4)


@pytest.mark.slow
def test_frequencies_converge():
    assert frequencies(4) == pytest.approx(frequencies(5), rel=1e-8)


@pytest.mark.parametrize(
    ("name", "old", "new", "text"),
    [
        (PRIMARY, "1.83726e-02", "here", "line 26: .*here.*, expected 4 numbers"),
        (
            PRIMARY,
            "         50   kp_total",
            "         51   kp_total",
            "line 75: .* expected 4 numbers",
        ),
        (PRIMARY, "kp_total  ", "kp_totals ", "has no entry kp_total"),
        (PRIMARY, "_BeamDyn_blade.dat", "_missing.dat", "_missing.dat.*cannot be read"),
        (BLADE, "26   station_total", "27   station_total", "line 401: nothing, expected"),
        (BLADE, "0.010000 ", "0.000000 ", "line 26: station at 0, expected to increase"),
        (BLADE, "6.7290887653959208e+09", "-1.0", "line 11: station at 0: .*GA_2 = -1"),
        (BLADE, "7.3931954710604941e+01", "70.0", "line 11: .* not that of a flat section"),
        (
            BLADE,
            "2.6537385919261174e+06",
            "3.0e+06",
            "line 11: station at 0: a matrix: is not symmetric: entry 1, 2",
        ),
    ],
)
def test_wrong_files_are_named_by_the_line(tmp_path, name, old, new, text):
    for each in (PRIMARY, BLADE):
        content = (FOLDER / each).read_text()
        (tmp_path / each).write_text(content.replace(old, new, 1) if each == name else content)
    with pytest.raises(sc.MeshError, match=text):
        sc.read_beamdyn(tmp_path / PRIMARY)


def rotor(blade, shaft):
    """A hub, held or on a shaft, with three blades."""
    model = sc.Model()
    hub = model.add("hub", sc.RigidBody.cylinder(1e5, radius=4.0, length=6.0))
    axis = sc.ground((0, 0, 0)), hub.local((0, 0, 0))
    model.add("shaft", sc.JointRevolute(*axis, (1, 0, 0)) if shaft else sc.JointFixed(*axis))
    for k, angle in enumerate((0, 2 * np.pi / 3, 4 * np.pi / 3)):
        c, s = np.cos(angle), np.sin(angle)
        R = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        root = R @ (0, 0, 4)
        more = {"order": 1, "director": R @ (0, 1, 0), "twist": blade.twist}
        each = sc.Beam(blade.mesh.moved(R, root), blade.section, **more)
        model.add(f"blade {k}", each)
        model.add(f"root {k}", sc.JointFixed(hub.at(root), each.node("blade.start")))
    return model.freeze()


@pytest.mark.slow
@pytest.mark.parametrize("treatment", [sc.NullSpace(), sc.Multipliers()], ids=repr)
def test_a_rotor_started_without_transients_turns_steadily(treatment):
    """At 7.55 rpm from its equilibrium in the turning frame: nothing but the angle changes."""
    blade, spin = sc.read_beamdyn(FOLDER / PRIMARY, 1), sc.Spin((7.55 * np.pi / 30, 0, 0))
    q = sc.static(rotor(blade, shaft=False), spin=spin)["q"][-1]
    system = rotor(blade, shaft=True)
    start = sc.initial_state(system, q, spin.rates(system, q.reshape(-1, 3)).ravel())
    run = sc.simulate(system, sc.EnergyMomentum(), treatment, 0.02, 2.0, start=start)
    tip = run.position(system.beams[0].node("blade.end"))
    assert np.ptp(np.hypot(tip[:, 1], tip[:, 2])) < 1e-10 and np.ptp(tip[:, 0]) < 1e-10
    assert abs(run["energy_balance"]).max() < 1e-12 * run["energy"][0]
