"""Static problems S6 to S10 and S12: limit points and bifurcations against reference solutions.

As test_static_references.py, whose means they share.
"""

import numpy as np
import pytest
import static_scenes as scenes
from scipy.special import ellipe, ellipk
from test_static_references import DATA, follow, treatments

import skfem_cosserat as sc
from collection import s08_arch as s08
from collection.statics import extrapolated, regular


def criticals(history, kind):
    """Critical points of a kind; all there are must be of it."""
    found = history.meta["critical"]
    assert {entry["kind"] for entry in found} == {kind}
    rows = np.flatnonzero(history["critical"])
    assert [entry["state"] for entry in found] == rows.tolist()
    return found


def bifurcation(scene, until, treatment=sc.NullSpace):
    """First bifurcation load of a path with automatic load steps."""
    history = follow(scene, treatment, sc.LoadControl(until=until), derive=False)
    assert history["unstable"][-1] >= 1
    return criticals(history, "bifurcation")[0]["load_factor"]


# -- S6: Lee's frame -------------------------------------------------------------------------------


@pytest.mark.slow
def test_lee_frame():
    """Both limit points: load and both displacements."""
    scene = scenes.lee_frame(20, 4)
    control = sc.ArcLength(100, until=20000.0, first=2000.0)
    history = follow(scene, control=control, derive=False)
    limits = criticals(history, "limit")
    assert len(limits) == 2
    for entry, (P, u, v) in zip(limits, DATA["S6"]["values"], strict=True):
        found = [entry["load_factor"], *scene.displacement(history, entry["state"])[:2]]
        assert found == pytest.approx([P, u, v], rel=3e-8)
    assert history["load_factor"][-1] == pytest.approx(20000.0, rel=1e-10)


# -- S7: toggle ------------------------------------------------------------------------------------

CURVE = np.array(DATA["S7"]["curve"])


@pytest.mark.slow
@treatments
def test_toggle_limit_points(treatment):
    scene = scenes.toggle(6, 4)
    control = sc.ArcLength(60, until=60.0, first=5.0)
    history = follow(scene, treatment, control, derive=False)
    limits = criticals(history, "limit")
    assert len(limits) == 2
    for entry, (w, P) in zip(limits, DATA["S7"]["limit_points"], strict=True):
        assert entry["load_factor"] == pytest.approx(P, rel=5e-9)
        assert -scene.displacement(history, entry["state"])[1] == pytest.approx(w, rel=1e-8)


#: the same members without shear, GA = 1e12: shooting with DOP853, rtol 1e-13
WITHOUT_SHEAR = [(0.23205486225, 33.861233003), (0.39168957119, 31.262583109)]


@pytest.mark.slow
@pytest.mark.parametrize(("treatment", "arc"), [(sc.NullSpace, False), (sc.Multipliers, True)])
def test_toggle_limit_points_beside_a_far_stiffer_motion(treatment, arc):
    """Rounding of its stiffness hides where the small eigenvalue vanishes, not where P is level."""
    scene = scenes.toggle(8, 4, section=scenes.plane_section(9270.0, 1885000.0, 1e12))
    down = sc.DisplacementControl(scene.point, (0, -1, 0), 0.6)
    control = sc.ArcLength(60, until=60.0, first=5.0) if arc else down
    history = follow(scene, treatment, control, derive=False)
    limits = criticals(history, "limit")
    for entry, (w, P) in zip(limits, WITHOUT_SHEAR, strict=True):
        assert entry["load_factor"] == pytest.approx(P, rel=2e-9)
        assert -scene.displacement(history, entry["state"])[1] == pytest.approx(w, rel=1e-8)


@pytest.mark.slow
def test_toggle_curve():
    """By displacement control; with both members the symmetric path is kept."""
    scene = scenes.toggle(8, 4, half=False)
    control = sc.DisplacementControl(scene.point, (0, -1, 0), at=CURVE[:, 0])
    history = follow(scene, control=control, derive=False)
    rows = regular(history)
    assert history["load_factor"][rows] == pytest.approx(CURVE[:, 1], rel=5e-9)
    assert abs(scene.displacement(history, rows)[:, 0]).max() < 1e-9
    assert len(criticals(history, "limit")) == 2


# -- S8: arch --------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("treatment", ["null-space", "multipliers"])
def test_arch(treatment):
    """With compliance; that of its theory is in the tests of the benchmark collection."""
    found = s08.main(data={"EA": 4e6, "GA": 4e6}, order=4, elements=16, treatment=treatment)
    assert found["Pcr"] == pytest.approx(896.811, abs=2e-3)


# -- S9: lateral buckling --------------------------------------------------------------------------

PRANDTL = DATA["S9 Prandtl"]["c"] * np.sqrt(scenes.STRIP["across"] * scenes.STRIP["GJ"]) / 240**2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("elements", "order", "treatment"), [(12, 3, sc.NullSpace), (8, 4, sc.Multipliers)]
)
def test_strip(elements, order, treatment):
    load = bifurcation(scenes.strip(elements, order), 3.5, treatment)
    assert load == pytest.approx(DATA["S9 strip"]["critical"], rel=1e-6)
    assert load == pytest.approx(
        DATA["S9 strip"]["again"]["critical"], rel=5e-8 if order == 3 else 5e-9
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("elements", "order", "treatment"), [(8, 3, sc.Multipliers), (6, 4, sc.NullSpace)]
)
def test_right_angle_frame(elements, order, treatment):
    load = bifurcation(scenes.right_angle(elements, order), 1.2, treatment)
    assert load == pytest.approx(DATA["S9b"]["critical"], rel=1e-6)
    assert load == pytest.approx(DATA["S9b"]["again"]["critical"], rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("build", "until", "expected"),
    [
        (scenes.strip, 3.5, PRANDTL),
        (scenes.hinged_frame, 660.0, DATA["S9c"]["critical"]),
    ],
)
def test_without_deflections_before_buckling(build, until, expected):
    """Closed forms of Prandtl and of the hinged frame: on the path by extrapolation, and linear.

    Not with stiffer rods: rounding of the largest stiffness hides the smallest.
    """
    found = [bifurcation(build(6, 4, stiffening=2.0**k), until) for k in (-1, 0, 1)]
    assert extrapolated(found, 2) == pytest.approx(expected, rel=5e-8)
    linear = sc.buckling(build(8, 4, stiffening=1e4).system, 1).factors[0]
    assert linear == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
def test_hinged_frame():
    """With deflections before buckling it is 2.2e-5 above the closed form."""
    load = bifurcation(scenes.hinged_frame(8, 3), 660.0)
    assert load / DATA["S9c"]["critical"] - 1 == pytest.approx(2.182e-5, rel=5e-3)


# -- S10: Euler's columns --------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ends", "treatment"), [("pinned-pinned", sc.NullSpace), ("clamped-free", sc.Multipliers)]
)
def test_column(ends, treatment):
    """With shear and extension: 1e-9 with 8 quartic elements, order 2 p."""
    P, pinned = DATA["S10"]["critical"][ends], ends == "pinned-pinned"
    assert bifurcation(scenes.column(8, 4, pinned=pinned), 1.2 * P, treatment) == pytest.approx(
        P, rel=5e-10
    )
    errors = [bifurcation(scenes.column(n, 3, pinned=pinned), 1.2 * P) / P - 1 for n in (4, 8)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(6, abs=0.3)


@pytest.mark.slow
def test_postbuckling_branch():
    """Both sides of the fork; P = P_cr (2 K(k) / pi)^2 with k = sin(theta/2), theta at the tip.

    The closed form is that of an inextensible rod: compliance is made small.
    """
    scene = scenes.column(8, 4, pinned=False, stiffening=1e4)
    P = np.pi**2 / 4 * 109375
    path = follow(scene, control=sc.LoadControl(until=1.1 * P), derive=False)
    assert criticals(path, "bifurcation")[0]["load_factor"] == pytest.approx(P, rel=1e-6)
    sides = []
    for sign in (1.0, -1.0):
        start = sc.branch(scene.system, path, 0, sign)
        control = sc.ArcLength(30, longest=0.1)
        history = follow(scene, control=control, start=start)
        assert (history["unstable"][1:] == 0).all()
        theta = np.array([scene.angle(history, k) for k in range(2, len(history))])
        ratio = history["load_factor"][2:] / P
        assert abs(theta[-1]) > 1.5
        assert ratio == pytest.approx((2 * ellipk(np.sin(theta / 2) ** 2) / np.pi) ** 2, rel=1e-6)
        tip = scene.displacement(history, slice(None))
        moment = history["joint/clamp/moment"][2:, 2]
        assert abs(moment) == pytest.approx(abs(history["load_factor"] * tip[:, 1])[2:], rel=1e-8)
        sides.append(np.sign(tip[2:, 1]))
        k2 = np.sin(theta / 2) ** 2
        K, E = ellipk(k2), ellipe(k2)
        assert abs(tip[2:, 1]) == pytest.approx(2 * np.sqrt(k2) / K, rel=1e-5)
        assert tip[2:, 0] == pytest.approx(2 * E / K - 2, rel=1e-5, abs=1e-7)  # compliance
        assert abs(tip[:, 2]).max() < 1e-12
    assert (sides[0] == sides[0][0]).all() and (sides[1] == -sides[0][0]).all()


# -- S12: twisted ring -----------------------------------------------------------------------------


def ring_limits(elements, slenderness, treatment):
    """Total twists, as shares of the closed form, where squares of two frequencies vanish."""
    GJ = 1.5
    scene = scenes.twisted_ring(elements, 4, GJ=GJ, slenderness=slenderness)
    expected = 2 * np.pi * np.sqrt(3) / GJ
    return scenes.ring_limits(scene, expected, treatment())[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("elements", "treatment", "tolerance"), [(12, sc.NullSpace, 1.5e-6), (20, sc.Multipliers, 5e-8)]
)
def test_twisted_ring(elements, treatment, tolerance):
    """Twice, at 2 pi sqrt(3) EI/GJ, compliance extrapolated to zero."""
    found = [ring_limits(elements, 20 * 2 ** (k / 2), treatment) for k in range(3)]
    assert (found[0] < 1 - 1e-3).all()
    assert extrapolated(found, 2) == pytest.approx([1.0, 1.0], abs=tolerance)
