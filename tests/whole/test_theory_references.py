"""Constrained theories against every reference number of Kirchhoff's and Euler's rods.

The elastica, the 45-degree bend and the rotating blade of the benchmark collection: beams without
shear and extension, elements of order 1 to 4. To the digits that are trusted, and with order 2p.
"""

from __future__ import annotations

import numpy as np
import pytest

import skfem_cosserat as sc
from collection import common, vibration

INEXTENSIBLE = sc.TheoryInextensible()
ELASTICA = common.entry("S2_elastica_inextensible")["values"]
CASES = common.entry("S3_bend45")["values"]["cases"]
BEND = {k.split("P=")[1]: v["tip"] for k, v in CASES.items() if k.startswith("Kirchhoff")}
BLADE = common.entry("M2_rotating_EB")["values"]
#: of 11 digits of a tip about 80 away, or of 17 of one about 1: rounding of large rotations
TRUSTED = {"bend": 5e-10, "elastica": 5e-12}


def tip(mesh: sc.MeshCurve, constants: list[float], order: int, force: tuple[float, ...]):
    """Of an inextensible rod that is clamped at the origin, under a dead force."""
    section = sc.Section([*[1e5] * 3, *constants], mass=1.0, inertia=(1e-3, 1e-3))
    model = sc.Model()
    beam = sc.Beam(mesh, section, order=order, director=(0, 0, 1), theory=INEXTENSIBLE)
    rod = model.add("rod", beam)
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("force", sc.LoadForce(rod.node("rod.end"), force))
    control = sc.LoadControl(steps=2)
    history = sc.static(model, control=control, watch=False, derive=False)
    first = 12 * rod.node("rod.end").vertex
    return history["q"][-1, first : first + 3]


def elastica(order: int, elements: int, load: str):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, "rod")
    reference = [float(ELASTICA[load][name]) for name in "xy"]
    return abs(tip(mesh, [1.0, 1.0, 1.0], order, (0, float(load), 0))[:2] - reference).max()


def bend(order: int, elements: int, load: str):
    ends = (0, 0, 0), (1, 0, 0), (0, 1, 0)
    mesh = sc.MeshCurve.init_arc(*ends, 100.0, np.pi / 4, elements, "rod")
    found = tip(mesh, [1e7 / 12, 1e7 / 12, 5e6 / 6], order, (0, 0, float(load)))
    return abs(found - BEND[load]).max()


#: coarse enough to stay above rounding, fine enough for the slope
MESHES = {
    (elastica, 1): (32, 64),
    (elastica, 2): (16, 32),
    (elastica, 3): (12, 16),
    (elastica, 4): (12, 16),
    (bend, 1): (32, 64),
    (bend, 2): (16, 32),
    (bend, 3): (8, 16),
    (bend, 4): (8, 12),
}


@pytest.mark.slow
@pytest.mark.parametrize(("problem", "order"), MESHES)
def test_tips_in_order_2p(problem, order):
    """Under the largest load."""
    load, meshes = {elastica: "10", bend: "600"}[problem], MESHES[problem, order]
    coarse, fine = (problem(order, count, load) for count in meshes)
    slope = np.log(coarse / fine) / np.log(meshes[1] / meshes[0])
    assert slope == pytest.approx(2 * order, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "load"), [*((elastica, load) for load in ELASTICA), *((bend, p) for p in BEND)]
)
def test_tips_to_the_trusted_digits(problem, load):
    assert problem(4, 24, load) < TRUSTED[problem.__name__]


def frequencies(case: str, order: int, elements: int):
    """Relative errors (2, 4) of flap and lag; the blade has no rotary inertia and no torsion."""
    hub, eta = (float(part.split("=")[1]) for part in case.split(","))
    section = sc.Section(np.ones(6), mass=1.0, inertia=(0.0, 0.0))
    mesh = sc.MeshCurve.init_line((hub, 0, 0), (hub + 1, 0, 0), elements, "rod")
    theory = sc.TheoryInextensible(torsion=False)
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 1, 0), theory=theory))
    model.add("root", sc.JointFixed(sc.ground((hub, 0, 0)), rod.node("rod.start")))
    wanted = np.array([BLADE[case]["flap"], BLADE[case]["lag"]], dtype=float)
    if not eta:  # all are double
        return abs(sc.modes(model, count=8).omega.reshape(4, 2).T / wanted - 1)
    spin = sc.Spin((0, 0, eta))
    path = sc.static(model, control=sc.LoadControl(steps=1), spin=spin, watch=False)
    found = sc.modes(model, path, 8, spin=spin)
    lag, flap = vibration.moving(found)[:, 1:].T
    return abs(np.array([found.omega[flap > lag], found.omega[lag > flap]]) / wanted - 1)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("case", ["hub=0,eta=2", "hub=0,eta=12"])
def test_rotating_blade_in_order_2p(case, order):
    """All eight frequencies that rounding does not reach."""
    meshes = {1: (64, 128), 2: (32, 64), 3: (24, 48), 4: (16, 32)}[order]
    coarse, fine = (frequencies(case, order, count) for count in meshes)
    above = fine > 3e-12
    assert above.any()
    assert np.log2(coarse / fine)[above] == pytest.approx(2 * order, abs=0.1)


# full matrices, as the theory has them
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.PerformanceWarning")
@pytest.mark.parametrize(
    "case", ["hub=0,eta=0", "hub=0,eta=4", "hub=1,eta=2", "hub=1,eta=5", "hub=1,eta=10"]
)
def test_rotating_blade_to_the_trusted_digits(case):
    """12 digits with 40 elements of order 4; 13 of the fastest blade with 64.

    Those of the other speeds are in the tests of the benchmark collection.
    """
    elements, error = (64, 3e-13) if case == "hub=1,eta=10" else (40, 5e-12)
    assert frequencies(case, 4, elements).max() < error
