"""Static problems S1 to S5, S11, S13 and S14 against closed forms and reference solutions.

The numbers in data/static_references.json are own computations with other methods (shooting) and
closed forms; the scenes are those of examples/benchmarks/static_scenes.py. Snap-through and
buckling are in test_stability_references.py.
"""

import json
from pathlib import Path

import numpy as np
import pytest
import static_scenes as scenes
from scipy.spatial.transform import Rotation

import skfem_cosserat as sc
from collection import s13_objectivity as s13
from collection.statics import regular
from skfem_cosserat.kernels import rotation_matrix

DATA = json.loads((Path(__file__).parents[1] / "data" / "static_references.json").read_text())
treatments = pytest.mark.parametrize("treatment", [sc.NullSpace, sc.Multipliers])


def follow(scene, treatment=sc.NullSpace, control=None, *, average=8.0, **options):
    """A path; with automatic steps at most so many Newton iterations an accepted one."""
    history = sc.static(scene.system, treatment(), control, **options)
    assert history.status == "completed"
    assert history.meta["rejected"] >= 0
    if control is None or control.all_points:
        assert history["newton_iterations"][regular(history)].mean() <= average
    return history


def matrix(quaternion):
    return rotation_matrix(np.array(quaternion)[None])[0]


# -- S1: roll-up -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_roll_up_converges_with_order_two_p():
    errors = []
    for elements in (8, 16, 32):
        scene = scenes.roll_up(elements, 3, 1)
        history = follow(scene, derive=False, watch=False)
        errors.append(abs(scene.position(history)).max())
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(6, abs=0.3)


@pytest.mark.slow
def test_roll_up_on_the_way():
    """Tip at shares of two circles."""
    scene = scenes.roll_up(24, 4, 2)
    control = sc.LoadControl(at=np.arange(1, 9) / 8)
    history = follow(scene, control=control, derive=False, watch=False)
    f = 4 * np.pi * history["load_factor"][1:]
    expected = 10 * np.column_stack([np.sin(f) / f, (1 - np.cos(f)) / f, 0 * f])
    assert abs(scene.position(history, slice(1, None)) - expected).max() < 5e-8


# -- S2: elastica ----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("row", DATA["S2 Reissner"]["values"])
def test_elastica(row):
    """To the eleven digits of the reference; the root moment is force times lever arm."""
    thickness, load, x, y, theta, moment = row
    EA = 12 / thickness**2
    scene = scenes.elastica(16, 4, load, EA=EA, GA=5 / 6 * EA / 2.6)
    history = follow(scene, derive=True)
    assert scene.position(history) == pytest.approx([x, y, 0], abs=3e-11)
    assert scene.angle(history) == pytest.approx(theta, abs=1e-11)
    root = -history["joint/clamp/moment"][-1, 2]  # on the rod
    assert abs(root) == pytest.approx(moment, rel=4e-11)
    assert abs(root) == pytest.approx(load * scene.position(history)[0], rel=1e-12)


# -- S3: 45-degree bend ----------------------------------------------------------------------------

BEND = {(case["section"], case["P"]): case for case in DATA["S3"]["cases"]}
SHEAR_FACTOR = {"plain": 1.0, "shear factor 5/6": 5 / 6}
ENERGY = dict(DATA["S3"]["strain_energy"])


def bend_error(elements, order):
    scene = scenes.bend(elements, order)
    history = follow(scene, derive=False, watch=False)
    return float(np.linalg.norm(scene.position(history) - BEND["plain", 600]["tip"]))


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("elements", "order", "limit"),
    [(16, 1, 0.4), (8, 2, 8e-3), (16, 2, 5e-4), (8, 3, 2e-5), (16, 3, 1e-6), (8, 4, 1e-7)],
)
def test_bend_error(elements, order, limit):
    assert bend_error(elements, order) <= limit


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "elements"), [(1, (16, 32)), (2, (16, 32)), (3, (8, 16)), (4, (8, 16))]
)
def test_bend_order(order, elements):
    """2 p at the tip, on the finest meshes whose error is above the reference's."""
    errors = [bend_error(n, order) for n in elements]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2 * order, abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in BEND if name[0] in SHEAR_FACTOR])
def test_bend_values(name):
    """Tip, rotation, root moment and strain energy to the digits of the reference."""
    section, P = name
    case = BEND[name]
    scene = scenes.bend(16, 4, P, shear_factor=SHEAR_FACTOR[section])
    history = follow(scene)
    assert scene.position(history) == pytest.approx(case["tip"], abs=2e-10)
    assert abs(scene.rotation(history) - matrix(case["quat"])).max() < 2e-12
    on_the_clamp = history["joint/clamp/moment"][-1]
    assert -on_the_clamp == pytest.approx(case["root_moment"], abs=5e-8)  # 1e-12 of it
    if section == "plain":
        assert history["strain_energy"][-1] == pytest.approx(ENERGY[P], rel=1e-9)


@pytest.mark.slow
def test_equidistant_nodes_lose_orders():
    """Negative: of the sixth order of cubic elements four are left, of the eighth six."""
    for order, left in ((3, 4), (4, 6)):
        errors = [bend_error(n, sc.InterpolationEquidistant(order)) for n in (8, 16)]
        assert np.log2(errors[0] / errors[1]) == pytest.approx(left, abs=0.3)
        assert errors[1] > 100 * bend_error(16, order)


# -- S4: helicoidal roll-up ------------------------------------------------------------------------

HELIX = np.array(DATA["S4"]["values"])


def helix_errors(elements, order, rows, treatment=sc.NullSpace):
    """Of the tip and of its rotation matrix, at the load factors of the reference."""
    scene = scenes.helix_roll_up(elements, order)
    table = HELIX[:rows]
    control = sc.LoadControl(at=table[:, 0])
    history = follow(scene, treatment, control, derive=False, watch=False)
    tips = abs(scene.position(history, slice(1, None)) - table[:, 1:4]).max(1)
    turns = [
        abs(scene.rotation(history, k + 1) - matrix(row[4:])).max() for k, row in enumerate(table)
    ]
    return tips, np.array(turns)


@pytest.mark.slow
def test_helix_for_three_turns():
    tips, turns = helix_errors(40, 4, 6)
    assert tips.max() < 2e-8
    assert turns.max() < 2e-7


@pytest.mark.slow
def test_helix_with_multipliers():
    tips, turns = helix_errors(32, 4, 2, sc.Multipliers)
    assert tips.max() < 1e-9
    assert turns.max() < 1e-9


# -- S5: Princeton beam ----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("row", DATA["S5"]["values"])
def test_princeton_beam(row):
    P, degrees = row[:2]
    scene = scenes.princeton(4, 4, P, degrees)
    history = follow(scene, derive=False, watch=False)
    assert scene.displacement(history) == pytest.approx(row[2:5], abs=1e-9)
    assert Rotation.from_matrix(scene.rotation(history)).as_rotvec() == pytest.approx(
        row[5:8], abs=1e-9
    )
    scene = scenes.princeton(8, 4, P, degrees, exchanged=True)
    history = follow(scene, derive=False, watch=False)
    assert scene.displacement(history) == pytest.approx(row[8:], abs=1e-11)


# -- S11: deployable ring --------------------------------------------------------------------------

RING = np.array(DATA["S11"]["values"])


@pytest.mark.slow
def test_deployable_ring_to_nine_digits():
    """After a full turn: a third of the radius, no torque."""
    scene = scenes.deployable_ring(64, 4)
    control = sc.LoadControl(at=RING[:, 0] / 360)
    history = follow(scene, control=control, watch=False)
    torque = history["joint/drive/moment"][1:, 0]
    assert torque == pytest.approx(RING[:, 1], rel=1e-8, abs=1e-5)
    shift = scene.displacement(history, slice(1, None))[:, 0]
    assert shift == pytest.approx(RING[:, 2], abs=2e-9)
    assert shift[-1] == pytest.approx(-80 / 3, rel=1e-10)
    assert abs(torque[-1]) < 1e-9 * RING[:, 1].max()


# -- S13: objectivity and path independence --------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("treatment", "turns"), [(sc.NullSpace, 10), (sc.Multipliers, 2)])
def test_strains_do_not_see_turns_on_the_way(treatment, turns):
    """Found anew at every point of the path, while the clamp turns."""
    control = sc.LoadControl(at=[1.0, *(1 + np.arange(1, turns + 1) / 10)])
    history = sc.static(s13.turning_bend().system, treatment(), control, watch=False)
    strain = history["beam/rod/strain"]
    assert abs(strain[1]).max() > 0.02
    assert abs(strain[2:] - strain[1]).max() < 1e-12


def test_strains_do_not_see_superposed_turns():
    """A deformed state, turned by 0 to 10 turns about a random axis, step by step."""
    scene = scenes.bend(8, 3)
    q = follow(scene, derive=False, watch=False)["q"][-1]
    axis = np.random.default_rng(5).standard_normal(3)
    assert s13.superposed(scene, q, 10, axis) < 1e-12


@pytest.mark.slow
def test_load_and_unload():
    """The way back ends in the reference."""
    scene = scenes.bend(8, 3)
    there = follow(scene, derive=False)
    back = sc.static(
        scene.system,
        control=sc.LoadControl(until=0.0),
        start=sc.equilibrium(scene.system, there),
    )
    assert abs(back["q"][-1] - scene.system.q0).max() < 1e-12 * 100
    assert abs(back["beam/rod/strain"][-1]).max() < 1e-12


# -- S14: slenderness ------------------------------------------------------------------------------


def slender_references():
    """Tips by slenderness; at 10^4 from the others: the tip is a linear function of its -2nd power.

    The next term of that series is 10^-11 (a mesh of 32 quartic elements is 7e-11 off).
    """
    tips = {float(z): np.array(case["tip"]) for z, case in DATA["S14"]["cases"].items()}
    slope = (tips[100.0] - tips[1000.0]) / (1e-4 - 1e-6)
    return tips | {1e4: tips[1000.0] + slope * (1e-8 - 1e-6)}


TIPS = slender_references()


def slender_error(elements, order, slenderness):
    scene = scenes.slender_arc(elements, order, slenderness)
    history = follow(scene, derive=False, watch=False)
    return np.linalg.norm(scene.position(history) - TIPS[slenderness])


@pytest.mark.slow
@pytest.mark.parametrize("slenderness", ["100", "1000"])
def test_slender_arc(slenderness):
    case = DATA["S14"]["cases"][slenderness]
    scene = scenes.slender_arc(16, 4, float(slenderness))
    history = follow(scene)
    assert scene.position(history) == pytest.approx(case["tip"], abs=1e-11)
    assert abs(scene.rotation(history) - matrix(case["quat"])).max() < 1e-11
    assert -history["joint/clamp/moment"][-1] == pytest.approx(case["root_moment"], abs=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(("order", "elements"), [(1, 16), (2, 8), (3, 8), (4, 4)])
def test_error_does_not_grow_with_slenderness(order, elements):
    thick, *slender = [slender_error(elements, order, z) for z in (100.0, 1000.0, 1e4)]
    assert slender == pytest.approx(2 * [thick], rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("order", "elements"), [(1, 16), (2, 8), (3, 8), (4, 4)])
def test_full_quadrature_locks(order, elements):
    """Negative: one Gauss point more, and the error grows with slenderness."""
    full = sc.InterpolationLobatto(order, points=order + 1)
    thick, slender = (slender_error(elements, full, z) for z in (100.0, 1e4))
    least = {1: (50, 1.3), 2: (100, 10), 3: (100, 10), 4: (50, 4)}[order]
    assert thick > least[0] * slender_error(elements, order, 100.0)
    assert slender > least[1] * thick


# -- all together ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_example_follows_all_scenes(capsys):
    rows = scenes.main(["--json"])["rows"]
    assert json.loads(capsys.readouterr().out)["rows"] == rows
    assert {row["scene"].split()[0] for row in rows} >= {f"S{k}" for k in range(1, 13)}
    for row in rows:
        coarse = "order 1" in row["quantity"] or "order 2" in row["quantity"]
        size = max(abs(row["reference"]), 1.0)
        assert abs(row["difference"]) < (5e-3 if coarse else 1e-6) * size, row
