"""Static problems S6, S7, S9, S10 and S12: limit points and bifurcations against references.

As test_static_references.py, whose means they share. S8, an arch, is in test_collection_statics.py.
"""

import numpy as np
import pytest
import static_scenes as scenes
from test_static_references import DATA, follow, treatments

import skfem_cosserat as sc
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
