"""Linear buckling against closed forms, and against the stiffness along the loaded path."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import static_scenes as scenes
from test_modes import bad, hung, straight

import skfem_cosserat as sc
from skfem_cosserat import Spin
from skfem_cosserat.model.balance import Amplitudes

REFERENCES = json.loads(
    (Path(__file__).parents[1] / "data" / "static_references.json").read_text(encoding="utf-8")
)
SQUARE = sc.SectionRectangle(0.05, 0.05, sc.Material(210e9, 0.3, 7850.0))
EI, GA = 109375.0, 210e9 / 2.6 * 5 / 6 * 0.05**2
CARDAN = {"axis_a": (0, 0, 1.0), "axis_b": (0, 1.0, 0)}


def column(elements, order, ends, section=SQUARE):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, nodes={"a": 0.0, "b": 1.0})
    model = sc.Model()
    beam = model.add("column", sc.Beam(mesh, section, director=(0, 1, 0), order=order))
    a, b = beam.node("a"), beam.node("b")
    if ends == "clamped-free":
        model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), a))
    else:  # pinned, but held against turning about its axis
        model.add("pin", sc.JointUniversal(sc.ground((0, 0, 0)), a, **CARDAN))
        model.add("slide", sc.JointPointOnLine(sc.ground((1, 0, 0)), b, axis=(1, 0, 0)))
    model.add("weight", sc.LoadForce(b, (-1.0, 0, 0)))
    return model.freeze()


ENDS = {"clamped-free": np.pi**2 / 4, "pinned-pinned": np.pi**2}


@pytest.mark.slow
@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_euler_columns(ends, order):
    """``P (1 + P/GA) = c EI/L^2``: exact for the linear theory with shear, errors of h^(2p).

    What S10 has more, ``- P^2/EA``, is the shortening before buckling.
    """
    critical = (np.sqrt(1 + 4 * ENDS[ends] * EI / GA) - 1) / 2 * GA
    counts = {1: (16, 32), 2: (8, 16), 3: (4, 8), 4: (2, 4)}[order]
    coarse, fine = (sc.buckling(column(n, order, ends), 2).factors / critical - 1 for n in counts)
    assert fine[0] > 1e-11
    assert abs(fine[1] / fine[0] - 1) < 1e-2  # both planes
    assert abs(np.log2(coarse[0] / fine[0]) - 2 * order) < 0.15
    exact = REFERENCES["S10"]["critical"][ends]
    assert 0 < exact / critical - 1 < 1.1 * exact / (210e9 * 0.05**2)


@pytest.mark.slow
def test_lateral_buckling_of_a_strip():
    """S9: Prandtl's 4.0126 with hugely stiff in-plane bending, orders 2p; both signs alike."""
    root = np.sqrt(scenes.STRIP["across"] * scenes.STRIP["GJ"]) / 240**2
    prandtl = 4.0125993435789008 * root

    def critical(elements, order, stiffening=1e6, count=1, sign="positive"):
        system = scenes.strip(elements, order, stiffening=stiffening).system
        return sc.buckling(system, count, sign=sign).factors

    for order, counts in {1: (8, 16), 2: (8, 16), 3: (4, 8), 4: (4, 8)}.items():
        coarse, fine = (critical(n, order)[0] / prandtl - 1 for n in counts)
        assert abs(np.log2(coarse / fine) - 2 * order) < 0.15
    found = critical(12, 4, count=2, sign="both")
    assert abs(abs(found) / prandtl - 1).max() < 1e-10
    assert found[0] * found[1] < 0
    # the real strip deflects before it buckles, which the linear theory does not know
    assert critical(12, 4, 1.0)[0] == pytest.approx(3.311299, abs=1e-6)
    assert REFERENCES["S9 strip"]["critical"] == pytest.approx(3.313278, abs=1e-6)


def test_uniform_bending_between_forks():
    """S9c: ``M = pi sqrt(EI GJ)/L``, and its multiples."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (240, 0, 0), 8, nodes={"a": 0.0, "b": 1.0})
    model = sc.Model()
    section = scenes.flat_section(**scenes.STRIP)
    beam = model.add("strip", sc.Beam(mesh, section, director=(0, 1, 0), order=4))
    a, b, end = beam.node("a"), beam.node("b"), (240.0, 0, 0)
    model.add("fork a", sc.JointUniversal(sc.ground((0, 0, 0)), a, **CARDAN))
    carriage = model.add("carriage", sc.RigidBody.sphere(1.0, 1.0, position=end))
    model.add("rail", sc.JointPrismatic(sc.ground(end), carriage.at(end), axis=(1, 0, 0)))
    model.add("fork b", sc.JointUniversal(carriage.at(end), b, **CARDAN))
    model.add("moment a", sc.LoadMoment(a, (0, 1.0, 0)))
    model.add("moment b", sc.LoadMoment(b, (0, -1.0, 0)))
    found = sc.buckling(model, 4, sign="both").factors
    wanted = REFERENCES["S9c"]["critical"]
    assert abs(abs(found) / (wanted * np.array([1, 1, 2, 2])) - 1).max() < 1e-8


def test_bars_on_springs():
    """Hinged bars in a line under a thrust, held by springs in the hinges: ``P = c/l`` times 2.

    Rigid bodies: all of K_1 comes from constraint forces.
    """
    model, axis = sc.Model(), (0, 0, 1.0)
    one, two = (model.add(name, sc.RigidBody.box(1.0, (1.0, 0.1, 0.1))) for name in ("one", "two"))
    root = model.add("root", sc.JointRevolute(sc.ground((0, 0, 0)), one.at((0, 0, 0)), axis))
    knee = model.add("knee", sc.JointRevolute(one.at((1, 0, 0)), two.at((1, 0, 0)), axis))
    for name, joint in (("root spring", root), ("knee spring", knee)):
        model.add(name, sc.JointSpringDamper(joint, 5.0))
    model.add("thrust", sc.LoadForce(two.at((2, 0, 0)), (-1.0, 0, 0)))
    found = sc.buckling(model, 2)
    wanted = 5.0 * np.linalg.eigvalsh([[2.0, -1.0], [-1.0, 1.0]])
    assert found.factors == pytest.approx(wanted, rel=1e-13)
    assert found.reduced.shape == (2, 2)


def test_a_mast_with_guys():
    """A hinged mast between inclined springs: the weight presses, the guys' forces count as well.

    Stretched guys hold the mast upright: half of the stiffness is that of their tension.
    """
    model = sc.Model()
    mast = model.add("mast", sc.RigidBody.rod(1.0, 2.0, position=(0, 0, 1.0)))
    model.add("foot", sc.JointRevolute(sc.ground((0, 0, 0)), mast.at((0, 0, 0)), (0, 1.0, 0)))
    top = mast.at((0, 0, 2.0))
    for side in (-1, 1):
        guy = sc.SpringDamper(sc.ground((side * 1.5, 0, 0)), top, 40.0, length=2.5)
        model.add(f"guy {side}", guy)
    model.add("weight", sc.LoadForce(top, (0, 0, -1.0)))
    found = sc.buckling(model, 1).factors[0]
    # turning by phi: guys' lengths change by -+ 1.5 * 2/2.5 phi, the weight comes down by phi^2
    assert found == pytest.approx(2 * 40 * (3.0 / 2.5) ** 2 / 2, rel=1e-13)


@pytest.mark.slow
def test_columns_of_many_elements():
    """Above 300 unknowns, where matrices are sparse: pairs, six factors, errors of h^4."""
    n, found = np.array([1, 1, 2, 2, 3, 3]), []
    exact = (np.sqrt(1 + 4 * n**2 * np.pi**2 * EI / GA) - 1) / 2 * GA
    for elements in (20, 60):
        system = column(elements, 2, "pinned-pinned")
        found.append(sc.buckling(system, 6).factors / exact - 1)
    assert system.unknowns > 300
    assert found[0][:2].max() < 5e-6 and found[1][:2].max() < 6e-8
    assert (found[0] / found[1]).min() > 70  # 3^4 = 81


def test_follower_loads():
    """Beck's column has no static buckling load: no real factor, or none of its size."""
    section = sc.Section([1e6, 1e6, 1e6, 1.0, 50.0, 40.0], mass=1.0, inertia=(1e-8, 1e-8))

    def push(beam):
        return sc.LoadForce(beam.node("b"), (0, 0, -1.0), follower=True)

    system = straight(8, 3, "CF", section, extra=[("push", push)])
    bad(lambda: sc.buckling(system, 1), "only 0 positive critical factor(s) exist")


def test_animation_of_a_buckling_mode():
    found = sc.buckling(column(4, 2, "pinned-pinned"), 1)
    history = found.animation(0, frames=8)
    assert history["constraint_violation"].max() < 1e-13
    nodes = history["q"].reshape(9, -1, 3)[:, found.system.origin_rows]
    assert np.linalg.norm(nodes[0, :, 1:], axis=1).max() > 0.05
    assert abs(nodes[2, :, 1:]).max() < 1e-12  # straight in between


def test_bad_input():
    system = column(2, 2, "clamped-free")
    bad(lambda: sc.buckling(system, 0), "count", "0")
    bad(lambda: sc.buckling(system, sign="up"), "sign", "'up'")
    bad(lambda: sc.buckling(system, t=np.inf), "argument t", "inf")
    bad(lambda: sc.buckling(straight(2, 2, "CF", SQUARE), 1), "the loads do nothing")
    bad(lambda: sc.buckling(system, amplitudes=Amplitudes(np.zeros(1), np.zeros(1))), "nothing")
    turning = Amplitudes(np.ones(1), np.zeros(1), Spin((1.0, 0, 0)))
    bad(lambda: sc.buckling(system, amplitudes=turning), "spin")
    bad(lambda: sc.buckling(hung((1.0, 1.0, 0.1)), 1), "bar 0", "without any stiffness")
    bad(lambda: sc.buckling(system, system.unknowns), "count", "positive critical factor(s) exist")


def test_results_are_shown_in_few_lines():
    """Printed, they gave all their arrays."""
    found = sc.buckling(column(4, 2, "clamped-free"), 2)
    a, b = found.factors
    assert repr(found) == f"<Buckling: 2 factors, {a:.6g}, {b:.6g}>"
    assert str(found).splitlines()[1].split() == ["0", f"{a:.7g}"]
