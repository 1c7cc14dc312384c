"""Equilibria with plain and with compiled kernels: the same paths, and which are taken.

Closed forms that hold with both are in test_statics.py.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import static_scenes as scenes
from helpers_scenes import SHAKE
from test_static_inputs import hanging_without_weight
from test_statics import SPIN, assembly, bow, cantilever, linkage, ring, treatments

import skfem_cosserat as sc


def both(system, *arguments, **options):
    """Paths with plain and with compiled kernels."""
    pytest.importorskip("numba")
    options = {"derive": False, **options}
    paths = [sc.static(system, *arguments, kernels=each, **options) for each in ("numpy", "numba")]
    assert [path.meta["kernels"] for path in paths] == ["numpy", "numba"]
    return paths


def assert_same(one, other):
    """As many iterations, which take another linear solver to other rounding; the points.

    Next to critical points rounding decides how many iterations it takes.
    """
    assert one["critical"].tolist() == other["critical"].tolist()
    regular = one["critical"] == 0
    for name in ("newton_iterations", "attempts", "unstable"):
        assert one[name][regular].tolist() == other[name][regular].tolist(), name
    size = max(1.0, abs(one["q"]).max())
    assert abs(other["q"] - one["q"])[regular].max() < 1e-11 * size
    difference, t = abs(other["load_factor"] - one["load_factor"]), one["load_factor"]
    assert difference[regular].max() < 1e-11 * abs(t).max()
    assert difference.max() < 1e-9 * abs(t).max()  # critical points are found less exactly
    force = one["constraint_force"]
    difference = abs(other["constraint_force"] - force)[regular]
    assert difference.max() < 1e-8 * abs(force).max()


def mobile(order):
    """A curved beam whose clamp moves; bodies and a point hang from it, one turned by a drive.

    All is held: by the beam, by gravity and by the drive.
    """
    model = sc.Model()
    mesh = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.2, 1.2, 3, name="arc")
    stiffness = [2e3, 1e3, 3e3, 200.0, 300.0, 150.0]
    section = sc.Section(stiffness, mass=1.0, inertia=(1e-3, 1e-3))
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0), SHAKE), rod.node("arc.start")))
    end = rod.node("arc.end")
    below = end.position - (0, 0.5, 0)
    hanging = model.add("hanging", sc.RigidBody.box(1.5, (0.1, 0.2, 0.3), position=below))
    axes = {"axis_a": (1, 0, 0), "axis_b": (0, 0, 1)}
    model.add("ball", sc.JointUniversal(end, hanging.at(end.position), **axes))
    crank = model.add("crank", sc.RigidBody.box(0.5, (0.1, 0.1, 0.1), position=below - (0, 0.4, 0)))
    pin = model.add("pin", sc.JointRevolute(hanging.at(below), crank.at(below), axis=(0, 1, 0)))
    low = below - (0, 0.4, 0)
    point = model.add("point", sc.MassPoint(0.4, position=low - (0, 0.6, 0)))
    model.add("rope", sc.JointDistance(crank.at(low), point.place()))
    model.add("drive", sc.JointDrive(pin, lambda t: 0.5 * t))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    model.add("dead", sc.LoadMoment(end, (0.3, 0.5, -0.4)))
    model.add("follows", sc.LoadMoment(crank.at(below), (0.2, -0.3, 0.6), follower=True))
    model.add("push", sc.LoadForce(crank.at(below), (0.3, 1.0, 0.2), lambda t: t**2))
    model.add("thrust", sc.LoadForce(hanging.at(below), (0.5, 0.2, -0.4), follower=True))
    model.add("wind", sc.LoadLine(rod, (0.2, 0.3, -0.5), follower=True))
    return model.freeze()


def column():
    """A rod along x, pushed back and sideways at its end; critical push 49.3."""
    section = sc.Section.from_constants(
        EA=1e5, GA=4e4, EI=(20, 80), GJ=15, mass=1.0, inertia=(1e-4, 1e-4)
    )
    model, end = cantilever(section, elements=6, director=(0, 0, 1))
    model.add("push", sc.LoadForce(end, (-1.0, 0, 0)))
    model.add("side", sc.LoadForce(end, (0, 1.0, 0)))
    return model.freeze(), end


def snap(system):
    """A buckled column on one side, and loads that push it through to the other."""
    bent = sc.static(
        system, control=sc.LoadControl(until=60.0), factors={"side": 1.0}, kernels="numpy"
    )
    factors = {"push": 60.0, "side": lambda t: 61.0 - t}
    return sc.equilibrium(system, bent), factors


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("scene", "order", "options"),
    [
        ("bend", 1, {}),
        ("roll_up", 2, {"turns": 0.5}),
        ("right_angle", 3, {}),
        ("bend", 4, {}),
    ],
)
def test_kernels_agree_on_cantilevers(scene, order, options):
    """A tip force out of the plane, an end moment, a rigid corner."""
    system = getattr(scenes, scene)(8, order, **options).system
    assert_same(*both(system, control=sc.LoadControl(until=1.0, steps=2)))


def test_kernels_agree_with_joints_and_moving_ground():
    control = sc.LoadControl(until=0.3, steps=3)
    assert_same(*both(mobile(2), control=control, factors={"gravity": 1.0}))


@pytest.mark.slow
def test_snap_through_by_arc_length():
    """Through both limit points, where the side push overcomes the column and where it is over."""
    system, _ = column()
    start, factors = snap(system)
    plain, compiled = both(system, control=sc.ArcLength(29), start=start, factors=factors)
    assert_same(plain, compiled)
    assert [c["kind"] for c in compiled.meta["critical"]] == ["limit", "limit"]


def test_a_held_instant(kernels):
    """The clamp and the drive stand still."""
    system = mobile(2)
    factors = {"gravity": lambda x: 1 + x}
    path = sc.static(
        system, control=sc.LoadControl(steps=2), factors=factors, time=0.0, kernels=kernels
    )
    rows = [system.extend(q, 0.0) for q in path["q"]]
    assert max(abs(system.constraints.values(y)).max() for y in rows) < 1e-12


@pytest.mark.slow
def test_snap_through_by_displacement(kernels):
    """To the mirror image of the start, under the mirrored push."""
    system, end = column()
    start, factors = snap(system)
    row = 3 * system.row_of(end)
    control = sc.DisplacementControl(end, (0, 1, 0), until=-2.0 * start.q[row + 1], steps=12)
    path = sc.static(system, control=control, start=start, factors=factors, kernels=kernels)
    assert path["q"][-1, row + 1] == pytest.approx(-start.q[row + 1], abs=1e-12)
    assert 61.0 - path["load_factor"][-1] == pytest.approx(-1.0, abs=1e-8)


# -- springs, closed loops, scenes in a plane ------------------------------------------------------


def linkage_in_plane(force=(0.4, 5.0, 0)):
    """Three bars on hinges about z, the first one on a spring; a force on the second."""
    points = np.array([[0, 0, 0], [0, 0.3, 0], [1.0, 0.8, 0], [1.0, 0, 0]])
    model = sc.Model()
    ends = [sc.ground(points[0])]
    for k, (a, b) in enumerate(itertools.pairwise(points)):
        bar = model.add(f"bar {k}", sc.RigidBody.box(1.0, (0.1, 0.1, 0.1), position=(a + b) / 2))
        ends += [bar.at(a), bar.at(b)]
    ends.append(sc.ground(points[3]))
    for k in range(4):
        pin = sc.JointRevolute(ends[2 * k], ends[2 * k + 1], axis=(0, 0, 1))
        model.add(f"pin {k}", pin)
    model.add("spring", sc.JointSpringDamper(model["pin 0"], 2.0, damping=3.0))
    model.add("push", sc.LoadForce(model["bar 1"].at((0.5, 0.55, 0)), force))
    return model


KINDS = {
    "springs and motors": (lambda: assembly(2), {"spin": SPIN}),
    "motors and loop": (linkage, {}),
    "loop of ball joints": (ring, {}),
    "loop": (linkage_in_plane, {}),
    "loop in plane": (lambda: linkage_in_plane().freeze(planar=sc.Planar()), {}),
    "arch in plane": (
        lambda: bow()[0].freeze(planar=sc.Planar()),
        {"control": sc.LoadControl(0.2)},
    ),
}


@pytest.mark.slow
@treatments
@pytest.mark.parametrize("kind", KINDS)
def test_kernels_agree_on_equilibria(kind, treatment):
    """Points and forces; how many iterations it takes is another matter where loops are closed."""
    make, options = KINDS[kind]
    model = make()
    system = model if isinstance(model, sc.System) else model.freeze()
    one, other = both(system, treatment, **{"control": sc.LoadControl(steps=3), **options})
    assert abs(one["q"][-1] - one["q"][0]).max() > 1e-4
    assert abs(other["q"] - one["q"]).max() < 1e-11 * max(1.0, abs(one["q"]).max())
    force = one["constraint_force"]
    assert abs(other["constraint_force"] - force).max() < 1e-8 * abs(force).max()
    assert other["unstable"].tolist() == one["unstable"].tolist()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "bending", "treatment"), [(3, 1e-6, sc.NullSpace()), (4, 1e-5, sc.Multipliers())]
)
def test_bent_thin_rods_of_higher_order_take_as_many_iterations(order, bending, treatment):
    """``GA h^2/EI`` of 6e8 and 6e9, which is the condition of a pivot: the block of a node.

    Elimination by inverses of pivots loses digits by the condition of each of them, by their
    triangular factors only by that of the whole matrix, as entry by entry in positive definite ones
    (Higham, Accuracy and Stability of Numerical Algorithms, chapter 13). Increments without right
    digits still lead to the solution, but not quadratically.
    """
    section = sc.Section([4e5, 4e5, 1e6, *[bending] * 3], 1.0, (1e-9, 1e-9))
    model, tip = cantilever(section, elements=8, director=(0, 0, 1), order=order)
    model.add("force", sc.LoadForce(tip, bending * np.array([0.0, -5.0, 2.0])))
    one, other = both(model, treatment, watch=False)
    # rounding decides about the last iteration of a point, and by that about the next point
    assert len(other) <= len(one) + 1
    total, found = (path["newton_iterations"].sum() for path in (one, other))
    assert found <= 1.2 * total
    assert abs(other["q"][-1] - one["q"][-1]).max() < 1e-11


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # of few elements
@pytest.mark.parametrize("make", [linkage_in_plane, lambda: bow()[0]], ids=["linkage", "arch"])
def test_kernels_agree_along_the_arc(make):
    """The load factor is an unknown: springs and gaps in the border."""
    system = make().freeze(planar=sc.Planar())
    one, other = both(system, control=sc.ArcLength(6))
    assert len(one) == len(other) == 7
    assert abs(other["q"] - one["q"]).max() < 1e-10 * max(1.0, abs(one["q"]).max())
    assert other["load_factor"] == pytest.approx(one["load_factor"], rel=1e-9)
    # rounding does not lead out of the plane
    rows = (other["q"] - other["q"][0]).reshape(len(other), -1, 3)
    assert abs(rows @ system.plane.normal).max() < 1e-15


@treatments
def test_forces_of_joints_are_known_at_the_start(treatment):
    """Those of a rope hold what hangs on it: without them the first matrix is singular."""
    pytest.importorskip("numba")
    system, weight = hanging_without_weight(), {"weight": 1.0}
    path = sc.static(system, treatment, factors=weight, kernels="numba")
    assert path["q"][-1, 0] / -path["q"][-1, 2] == pytest.approx(1 / 9.81, rel=1e-12)


# -- which kernels ---------------------------------------------------------------------------------


# bent beyond what its elements follow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
def test_paths_take_kernels_that_are_on_disk(kept_kernels):
    pytest.importorskip("numba")
    system = scenes.bend(4, 1).system
    sc.static(system, derive=False, kernels="numba")
    path = sc.static(system, derive=False)
    assert path.meta["kernels"] == "numba"
    assert path.meta["solver"] == "blocks"
    assert path.meta["factorisations"] > path.meta["newton_iterations"]


def test_what_is_not_compiled_is_refused():
    pytest.importorskip("numba")
    system = scenes.bend(4, 1).system
    with pytest.raises(sc.InputError, match="the full system of multipliers"):
        sc.static(system, sc.Multipliers(full=True), kernels="numba")
