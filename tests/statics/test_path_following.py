"""Paths stay on their branch: near critical points, over limit points, along neutral motions."""

from __future__ import annotations

import numpy as np
import pytest
from test_statics import at, cantilever, treatments, truss

import skfem_cosserat as sc


def slender(EI=(20.0, 25.0), GJ=15):
    return sc.Section.from_constants(EA=1e5, GA=4e4, EI=EI, GJ=GJ, mass=1.0, inertia=(1e-4, 1e-4))


def column(side=0.0, EI=(20.0, 25.0), order=4, elements=4, amplitude=None):
    """A clamped column under a load along it, with a share of it to the side; and its tip."""
    mesh = {"order": order, "elements": elements, "director": (0, 0, 1)}
    model, tip = cantilever(slender(EI), **mesh)
    model.add("push", sc.LoadForce(tip, (-1.0, side, 0), amplitude))
    return model, tip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "elements", "side", "until"),
    [(1, 16, 0.005, 60.0), (2, 8, 0.02, 80.0), (3, 4, 0.02, 60.0), (4, 4, 0.005, 60.0)],
)
def test_imperfect_column_bends_the_way_it_is_pushed(order, elements, side, until):
    """Past the critical load of the perfect one long steps can land on the other, unstable side."""
    model, end = column(side, order=order, elements=elements)
    path = sc.static(model, control=sc.LoadControl(until), derive=False)
    assert (path["unstable"] == 0).all()
    assert path.meta["critical"] == []
    assert (np.diff(at(path, end)[:, 1]) > 0).all()
    short = sc.static(model, control=sc.LoadControl(until, longest=0.05), derive=False)
    assert at(short, end)[-1] == pytest.approx(at(path, end)[-1], abs=1e-9)


@pytest.mark.slow
def test_soft_part_on_a_stiff_one_bends():
    """That a stiffness is rounding beside that of another part does not make it rounding."""

    def last(stiff, EI=1e-4):
        model, place = sc.Model(), sc.ground((0, 0, 0))
        for k, (EA, bending) in enumerate([(1e12, 1e10), (1e3, EI)][not stiff :]):
            section = sc.Section.from_constants(
                EA=EA, GA=EA / 2, EI=(bending, 1.2 * bending), GJ=bending, mass=1, inertia=(1, 1)
            )
            mesh = sc.MeshCurve.init_line((k, 0, 0), (k + 1, 0, 0), 2, name=f"m{k}")
            rod = model.add(f"rod {k}", sc.Beam(mesh, section, order=3, director=(0, 0, 1)))
            model.add(f"joint {k}", sc.JointFixed(place, rod.node(f"m{k}.start")))
            place = rod.node(f"m{k}.end")
        model.add("push", sc.LoadForce(place, (0, 0, EI)))
        path = sc.static(model, derive=False)
        nodes = path["q"][-1].reshape(-1, 4, 3)[:, 0]
        return nodes[nodes[:, 0].argmax()] - stiff * np.array([1.0, 0, 0])

    alone = last(False)
    assert alone[2] > 0.2
    assert last(True) == pytest.approx(alone, abs=1e-8)


#: where the shallow truss snaps through, ``l^3 = l0``: height, load
CREST = np.sqrt(1.09 ** (1 / 3) - 1)
MOST = 400 * CREST**3


@pytest.mark.slow
@treatments
@pytest.mark.parametrize("share", [0.999, 0.99999])
def test_the_end_of_a_path_may_lie_just_below_a_limit_point(treatment, share):
    """One step leads over the crest: the end is on this side of it."""
    model, _ = truss()
    control = sc.ArcLength(60, first=1.0, until=share * MOST)
    path = sc.static(model, treatment, control, derive=False)
    assert path["load_factor"][-1] == pytest.approx(share * MOST, rel=1e-12)
    assert path["q"][-1, 2] > CREST
    assert path.meta["critical"] == []


@pytest.mark.slow
@treatments
def test_beyond_the_load_of_a_limit_point_is_no_step(treatment):
    """That load is reached; what is found beyond it lies on the side that it snaps through to."""
    model, _ = truss()
    with pytest.raises(sc.Diverged, match=r"a limit point is near.*ArcLength") as found:
        sc.static(model, treatment, sc.LoadControl(at=[MOST / 2, MOST, 1.2 * MOST]))
    path = found.value.history
    assert np.allclose(path["load_factor"], [0.0, MOST / 2, MOST])
    assert abs(path["q"][-1, 2] - CREST) < 1e-6


@pytest.mark.slow
def test_lengths_of_critical_points_in_the_first_step():
    """The first step of an arc length goes by the load factor where nothing moves at first."""
    model, _ = column(amplitude=lambda t: t * t)
    path = sc.static(model, control=sc.ArcLength(6, first=9.0), derive=False)
    assert len(path.meta["critical"]) >= 2
    assert (np.diff(path.times) > 0).all()


@pytest.mark.slow
@treatments
def test_a_displacement_that_the_loads_do_not_move(treatment):
    """Named with place and direction; no finer mesh helps."""
    along, across = (0.8, -0.6, 0.0), (0.6, 0.8, 0.0)
    mesh = {"ends": ((0, 0, 0), along), "director": (0, 0, 1)}
    model, tip = cantilever(slender(), elements=2, order=2, **mesh)
    model.add("pull", sc.LoadForce(tip, along))
    control = sc.DisplacementControl(tip, across, until=0.1)
    with pytest.raises(sc.Diverged, match=r"The loads do not move beam 'rod'.* along") as caught:
        sc.static(model, treatment, control)
    assert "finer mesh" not in str(caught.value)
    assert len(caught.value.history) == 1


def cable(elements, EI):
    """Of cubic elements, its own weight from the start, when it is straight; its end moves in."""
    section = sc.Section.from_constants(
        EA=1e3, GA=1e3, EI=(EI, EI), GJ=EI, mass=1.0, inertia=(1e-9, 1e-9)
    )
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1.2, 0, 0), elements, name="line")
    model = sc.Model()
    beam = model.add("cable", sc.Beam(mesh, section, order=3, director=(0, 0, 1)))
    slide = sc.Motion(displacement=lambda t: (-0.2 * t, 0, 0))
    for end, place in (("start", sc.ground((0, 0, 0))), ("end", sc.ground((1.2, 0, 0), slide))):
        joint = sc.JointRevolute(place, beam.node(f"line.{end}"), axis=(0, 0, 1))
        model.add(end, joint)
    model.add("weight", sc.LoadGravity((0, -1.0, 0)))
    return model


def hung(elements, EI, **options):
    """Path of the cable, its sag in the end, what is warned of it."""
    model = cable(elements, EI)
    path = sc.static(model, factors={"weight": 1.0}, **options)
    low = path["q"][-1].reshape(-1, 12)[:, 1].min()
    return path, -low, [notice["text"] for notice in path.meta["warnings"]]


taut = pytest.mark.filterwarnings(
    "ignore::skfem_cosserat.AccuracyWarning", "ignore::skfem_cosserat.IncompleteWarning"
)


@pytest.mark.slow
@taut
@pytest.mark.parametrize("watch", [True, False])
def test_a_cable_taut_beyond_its_elements_is_told_of(watch):
    """The motions of the mesh that lose their stiffness are not located.

    With 24 elements these took 3374 factorisations, and the path failed.
    """
    path, _, texts = hung(4, 1e-3, watch=watch)
    assert any("refine: it takes 9 elements in place of 4" in text for text in texts)
    assert any("critical points are not looked for" in text for text in texts) == watch
    assert path.meta["critical"] == [] and path.meta["factorisations"] < 300


@taut
@pytest.mark.slow
def test_a_cable_has_the_elements_that_a_warning_advised():
    """They are enough; what was warned of was wrong."""
    _, fine, texts = hung(10, 1e-3)  # even: with a node in the middle
    exact = hung(18, 1e-3)[1]
    assert texts == [] and fine == pytest.approx(exact, rel=1e-4)
    assert abs(hung(4, 1e-3)[1] - exact) > 0.01 * exact


@taut
@pytest.mark.slow
def test_a_cable_too_taut_to_go_on_is_to_be_refined():
    """Negative: ArcLength() does not help, and is not advised."""
    with pytest.raises(sc.Diverged, match=r"it takes 8 elements.*Refine the mesh") as caught:
        sc.static(cable(4, 3e-4), factors={"weight": 1.0})
    assert "ArcLength" not in str(caught.value)


def bars(stiffness, load=-1.0):
    """Upright rigid bars of 1 m, one on the other, on hinges with springs, and a load along them.

    Of absolute angles ``K = [[k_1 + k_2, -k_2], [-k_2, k_2]] - P I``, or ``k_1 - P`` of one bar.
    """
    model, below = sc.Model(), sc.ground((0, 0, 0))
    for n, k in enumerate(stiffness):
        size = (0.1, 0.1, 1.0)
        bar = model.add(f"bar {n}", sc.RigidBody.box(1.0, size, position=(0, 0, n + 0.5)))
        foot = sc.JointRevolute(below, bar.at((0, 0, n)), axis=(0, 1, 0))
        model.add(f"spring {n}", sc.JointSpringDamper(model.add(f"hinge {n}", foot), k))
        below = bar.at((0, 0, n + 1))
    model.add("push", sc.LoadForce(below, (0, 0, load)))
    return model


@pytest.mark.slow
@treatments
@pytest.mark.parametrize(
    ("stiffness", "at", "critical"),
    [
        ([10.0], [5.0, 10.0, 10.001, 12.0], [10.0]),
        ([7.3], [7.3, 12.0], [7.3]),  # not a power of two times a small number
        ([3.0, 2.0], [0.5, 1.0, 3.0, 6.0, 8.0], [1.0, 6.0]),  # eigenvalues of [[5, -2], [-2, 2]]
    ],
)
def test_load_factors_that_are_critical(stiffness, at, critical, treatment):
    """The straight equilibrium is there, and its reaction the load, whatever loses stiffness."""
    path = sc.static(bars(stiffness), treatment, sc.LoadControl(at=at))
    found = [each["load_factor"] for each in path.meta["critical"]]
    assert np.allclose(found, critical, rtol=1e-7)
    asked = path["critical"] == 0
    assert np.allclose(path["load_factor"][asked], [0.0, *at], rtol=1e-12)
    assert np.allclose(path["joint/hinge 0/force"][asked, 2], [0.0, *at], rtol=1e-9)


@treatments
def test_a_path_starts_at_a_critical_load(treatment):
    """Its first step is not solved from where the stiffness is singular."""
    model = bars([10.0])
    system = model.freeze()
    start = sc.State(10.0, 0, system.q0, np.zeros(system.n))
    path = sc.static(model, treatment, sc.LoadControl(at=[11.0, 12.0]), start=start, watch=False)
    assert np.allclose(path["joint/hinge 0/force"][:, 2], [10.0, 11.0, 12.0])


@pytest.mark.slow
def test_a_critical_point_at_the_end_of_a_step_has_reactions():
    """A strip rolled up by its end to exactly a full turn: M = EI angle / L in every row."""
    EI = 10.0
    model, tip = cantilever(slender((EI, EI), 8), elements=8, director=(0, 0, 1))
    plane = sc.JointPlanar(sc.ground((1, 0, 0)), tip, normal=(0, 0, 1))
    model.add("hold", plane)
    model.add("drive", sc.JointDrive(plane, lambda t: 2 * np.pi * t, "angle"))
    path = sc.static(model, control=sc.LoadControl(at=[0.5, 1.0, 1.1]))
    assert [round(each["load_factor"], 9) for each in path.meta["critical"]] == [1.0]
    assert len(path) == 5
    right = 2 * np.pi * EI * path["load_factor"]
    assert abs(path["joint/drive/moment"][:, 2] - right).max() < 1e-3 * right.max()
    assert abs(path["joint/clamp/moment"][:, 2] + right).max() < 1e-3 * right.max()
