"""Elements that are pressed to less than no length: said by paths and by runs."""

import numpy as np
import pytest

import skfem_cosserat as sc

EA = 1e3  # N


def guided_bar(share, order=1, curved=False):
    """A bar that can only change its length, pressed by a share of EA; it stays straight."""
    section = sc.Section.from_constants(
        EA=EA, GA=EA, EI=(1e4, 1e4), GJ=1e4, mass=1.0, inertia=(1e-3, 1e-3)
    )
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="bar")
    model = sc.Model()
    bar = model.add("bar", sc.Beam(mesh, section, order=order, director=(0, 0, 1)))
    end = bar.node("bar.end")
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), bar.node("bar.start")))
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
    strain = path["beam/bar/strain"][..., 2].min(axis=(1, 2))
    assert strain == pytest.approx(-1.5 * path["load_factor"], rel=1e-9)
    (notice,) = (each for each in path.meta["warnings"] if "inside out" in each["text"])
    assert notice["item"] == "beam 'bar'" and notice["time"] == pytest.approx(0.7)
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
    strain = run["beam/bar/strain"][..., 2]
    assert strain.min() < -1
    first = run.times[(strain <= -1).any(axis=(1, 2))][0]
    assert first in [each["time"] for each in run.meta["warnings"]]


@pytest.mark.slow
def test_sections_at_an_angle_to_their_node():
    """In a bent network the axis of a section is not d3 of the node that two members share."""
    section = sc.Section.from_constants(
        EA=EA, GA=1e6, EI=(1e6, 1e6), GJ=1e6, mass=1.0, inertia=(1e-3, 1e-3)
    )
    corners = [(0, 0, 0), (0, 0, 1), (1, 0, 1)]
    mesh = sc.MeshCurve.init_polyline(corners, 1, name="knee")
    for share, doubtful in ((0.5, False), (1.5, True)):
        model = sc.Model()
        knee = model.add("knee", sc.Beam(mesh, section, order=3))
        model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), knee.node("knee.start")))
        model.add("push", sc.LoadForce(knee.node((0, 0, 1)), (0, 0, -share * EA)))
        if not doubtful:
            assert not sc.static(model).meta["warnings"]
            continue
        with pytest.warns(sc.AccuracyWarning, match="element 0 is pressed inside out"):
            sc.static(model)
