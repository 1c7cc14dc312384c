"""What paths and runs tell of their elements: too coarse for bending, pressed to less than none.

A beam that only moves as one piece is left alone, a scene that falls is told as well.
"""

import warnings

import numpy as np
import pytest
from test_statics import cantilever

import skfem_cosserat as sc

STEEL = sc.Material(210e9, 0.3, 7850.0)
TUBE = sc.SectionTube(0.03, 0.025, STEEL)


def told(function, *args, **kwargs):
    """What is returned, and the texts about coarse elements."""
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        found = function(*args, **kwargs)
    return found, [str(each.message) for each in given if "too coarse" in str(each.message)]


def rod(elements, order, theory=None):
    """A model with a clamped rod of 1 m, and its end."""
    about = {"order": order, "theory": theory, "director": (0, 0, 1)}
    return cantilever(TUBE, elements=elements, **about)


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("elements", "order", "theory"),
    [
        (1, 1, None),
        (1, 1, sc.TheoryKirchhoff()),
        (2, 1, None),
        (1, 2, sc.TheoryKirchhoff()),
        (1, 3, None),
    ],
)
def test_a_cantilever_of_few_elements(elements, order, theory):
    """A linear element has a constant moment: of ``F^2 L^3/(6 EI)`` n of them lack ``1/(4 n^2)``.

    For one that is a quarter, for two a sixteenth, and none for orders above, whose moment may
    vary. Above a tenth it is told, with the order that helps.
    """
    model, tip = rod(elements, order, theory)
    model.add("load", sc.LoadForce(tip, (0, 0, -1.0)))
    _, texts = told(sc.static, model)
    if order == elements == 1:
        assert len(texts) == 1 and "25 %" in texts[0] and "order=3" in texts[0]
    else:
        assert not texts


def test_a_truss_bends_nowhere():
    """Bars with spherical joints at their ends carry tension only: linear elements are exact."""
    model = sc.Model()
    apex = np.array([0.0, 0.0, 1.0])
    mass = model.add("apex", sc.MassPoint(1.0, position=apex))
    for k, foot in enumerate([(1.0, 0, 0), (-0.5, 0.8, 0), (-0.5, -0.8, 0)]):
        mesh = sc.MeshCurve.init_line(foot, apex, 1, name=f"bar {k}")
        bar = model.add(f"bar {k}", sc.Beam(mesh, TUBE))
        start = bar.node(f"bar {k}.start")
        sides = np.linalg.qr((apex - foot)[:, None], "complete")[0]
        axes = {"axis_a": sides[:, 1], "axis_b": sides[:, 2]}
        model.add(f"foot {k}", sc.JointUniversal(sc.ground(foot), start, **axes))
        model.add(f"tip {k}", sc.JointSpherical(bar.node(f"bar {k}.end"), mass.place()))
    model.add("load", sc.LoadForce(mass.place(), (3.0, 2.0, -10.0)))
    assert not told(sc.static, model, watch=False)[1]


@pytest.mark.slow
def test_linear_members_in_motion():
    """A rod let go from rest under its weight: one linear element is told, four are not."""
    for elements, coarse in ((1, True), (4, False)):
        model, _ = rod(elements, 1)
        model.add("weight", sc.LoadGravity((0, 0, -9.81)))
        _, texts = told(sc.simulate, model, sc.EnergyMomentum(), sc.NullSpace(), 2e-3, 0.04)
        assert bool(texts) == coarse


def test_what_only_moves_as_one_piece_is_not_looked_at():
    """A free rod that spins strains by rounding and by its centrifugal force alone."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 1, name="rod")
    model = sc.Model()
    about = {"velocity": lambda x: np.cross((0, 0, 2.0), x), "angular_velocity": (0, 0, 2.0)}
    model.add("rod", sc.Beam(mesh, TUBE, director=(0, 0, 1), **about))
    assert not told(sc.simulate, model, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 0.2)[1]


def test_nothing_holds_a_scene_that_falls():
    """Gravity on a body at rest that nothing ties is told in motion; a thrown one is meant.

    So is one whose gravity is switched off.
    """
    for velocity, on, falls in ((0, 1, True), (3, 1, False), (0, 0, False)):
        model = sc.Model()
        model.add("body", sc.RigidBody.box(1.0, (0.1, 0.1, 0.1), velocity=(1.0 * velocity, 0, 0)))
        model.add("weight", sc.LoadGravity((0, 0, -9.81), amplitude=on))
        with warnings.catch_warnings(record=True) as given:
            warnings.simplefilter("always")
            sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 0.1)
        assert any("nothing ties it" in str(each.message) for each in given) == falls


# -- elements pressed to less than no length -------------------------------------------------------

EA = 1e3  # N


def guided_bar(share, order=1):
    """A bar that can only change its length, pressed by a share of EA; it stays straight."""
    section = sc.Section([EA, EA, EA, 1e4, 1e4, 1e4], mass=1.0, inertia=(1e-3, 1e-3))
    model, end = cantilever(section, order=order)
    model.add("guide", sc.JointPrismatic(sc.ground((1, 0, 0)), end, axis=(1, 0, 0)))
    model.add("push", sc.LoadForce(end, (-share * EA, 0, 0)))
    return model


@pytest.mark.one_quick
@pytest.mark.parametrize("order", [1, 3])
def test_a_path_says_where_a_bar_is_pressed_inside_out(order):
    """N = EA times the axial strain: at -1.5 EA the strain is -1.5, and it is -1 at two thirds."""
    control = sc.LoadControl(at=np.linspace(0.1, 1.0, 10))
    with pytest.warns(sc.AccuracyWarning, match="inside out") as given:
        path = sc.static(guided_bar(1.5, order), control=control)
    strain = path["beam/rod/strain"][..., 2].min(axis=(1, 2))
    assert strain == pytest.approx(-1.5 * path["load_factor"], rel=1e-9)
    (notice,) = (each for each in path.meta["warnings"] if "inside out" in each["text"])
    assert notice["item"] == "beam 'rod'" and notice["time"] == pytest.approx(0.7)
    assert sum("inside out" in str(each.message) for each in given) == 1


def test_a_bar_pressed_to_a_tenth_of_its_length_is_still_one():
    """At a strain of -0.9 nothing is inside out, and nothing is said."""
    assert not sc.static(guided_bar(0.9)).meta["warnings"]


@pytest.mark.slow
def test_a_run_says_it_too():
    """A force that sets in at once presses twice as far as at rest: 0.6 EA already to -1.2."""
    model = guided_bar(0.6, order=3)
    with pytest.warns(sc.AccuracyWarning, match="inside out"):
        run = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, 0.05)
    strain = run["beam/rod/strain"][..., 2]
    assert strain.min() < -1
    first = run.times[(strain <= -1).any(axis=(1, 2))][0]
    assert first in [each["time"] for each in run.meta["warnings"]]


@pytest.mark.slow
def test_sections_at_an_angle_to_their_node():
    """In a bent network the axis of a section is not d3 of the node that two members share."""
    section = sc.Section([1e6, 1e6, EA, 1e6, 1e6, 1e6], mass=1.0, inertia=(1e-3, 1e-3))
    mesh = sc.MeshCurve.init_polyline([(0, 0, 0), (0, 0, 1), (1, 0, 1)], 1, name="knee")
    model = sc.Model()
    knee = model.add("knee", sc.Beam(mesh, section, order=3))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), knee.node("knee.start")))
    model.add("push", sc.LoadForce(knee.node((0, 0, 1)), (0, 0, -EA)))
    assert not sc.static(model, control=sc.LoadControl(0.5)).meta["warnings"]
    with pytest.warns(sc.AccuracyWarning, match="element 0 is pressed inside out"):
        sc.static(model, control=sc.LoadControl(1.5))
