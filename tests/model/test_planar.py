"""Scenes confined to a plane: equal to those in space, and what leaves the plane is named."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from helpers_kernels import assert_same, both, needs_numba, with_kept_factors
from helpers_scenes import IDENTITY, four_bar, lattice_mesh, swing, swing_model
from helpers_scenes import rotation as random_rotation
from helpers_schemes import KINDS, compiled
from rounding import limits, nudged
from test_theories import swing as example

import skfem_cosserat as sc
from skfem_cosserat.diagnostics import momentum
from skfem_cosserat.model.plane import confine

#: those whose own steps are compiled, and others: one of each class, and what else differs
BOTH = [sc.EnergyMomentum(), sc.Variational()]
INTEGRATORS = [
    *KINDS,
    sc.EnergyMomentum(stabilized=True),
    sc.GeneralizedAlpha(0.8, stabilized=False),
]
TREATMENTS = [sc.NullSpace(), sc.Multipliers()]
#: turns scenes of the (e1, e2)-plane into any other plane
TURNED = random_rotation(np.random.default_rng(7), 2.0)
SIDEWAYS = IDENTITY[[1, 2, 0]]
PLANES = [IDENTITY, SIDEWAYS, TURNED]
D = (2e4, 2e4, 5e4, 40.0, 60.0, 30.0)
PIN, BALL, END = sc.JointRevolute, sc.JointSpherical, "rod.end"


def section(**options: Any) -> sc.Section:
    return sc.Section(D, mass=1.3, inertia=(2e-3, 3e-3), **options)


def difference(a: sc.History, b: sc.History, name: str = "q") -> float:
    return float(abs(a[name] - b[name]).max())


# -- motion ----------------------------------------------------------------------------------------


# a coarse swing is quick: four elements where five could hold the tension
@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
@pytest.mark.parametrize(
    ("integrator", "kernels"),
    [
        *((each, "numpy") for each in INTEGRATORS),
        *(pytest.param(i, "numba", marks=needs_numba) for i in filter(compiled, INTEGRATORS)),
    ],
    ids=str,
)
def test_swing_moves_as_in_space(integrator: Any, treatment: Any, kernels: str):
    system, plane = swing(4), swing(4)
    confine(plane, sc.Planar())
    assert plane.plane is not None
    assert plane.plane.normal.tolist() == [1, 0, 0]
    run = integrator, treatment, 1e-2, 0.1
    a, b = (sc.simulate(s, *run, kernels=kernels) for s in (system, plane))
    assert abs(a["q"][-1] - a["q"][0]).max() > 1e-3
    start = nudged(sc.initial_state(system))
    beside = sc.simulate(system, *run, kernels="numpy", start=start)
    rounded = limits(a, beside, ("q", "p", "energy", "constraint_force"))
    for name, size in {"q": 1.0, "p": 100.0, "energy": 1e3, "constraint_force": 1e5}.items():
        assert difference(a, b, name) < max(1e-11 * size, rounded[name]), name
    # the kernels of a plane have other unknowns, and round as constraint forces do
    limit = 1e-8 if kernels == "numpy" else 1e-11 * 1e5
    assert difference(a, b, "joint/left support/force") < limit
    assert (b["q"].reshape(len(b), -1, 3)[:, system.origin_rows, 0] == 0).all()


def test_unknowns_of_the_swing():
    """Half of those in space; of 23 frames: 6 director components, 3 constraints, joints take 8."""
    system, plane = swing(), swing()
    confine(plane, sc.Planar())
    assert (system.unknowns, plane.unknowns) == (122, 61)
    assert "430 with multipliers, 122 with the null space" in repr(system)
    assert "215 with multipliers, 61 with the null space" in repr(plane)


def mechanism(
    Q: np.ndarray,
    roll: float = 0.0,
    order: int = 1,
    theory: Any = None,
    rail: type = sc.JointPrismatic,
    cardan: bool = False,
) -> sc.Model:
    """A beam with a corner on a pin, a body at its end whose directors may be oblique, what slides.

    On the body a slider, a mass point on a rod and another one on a wire.
    """
    n, along = Q[:, 2], Q[:, 0]

    def at(x: float, y: float) -> np.ndarray:
        return Q @ (x, y, 0.0)

    model = sc.Model()
    mesh = sc.MeshCurve.init_polyline([at(0, 0), at(0.6, 0.2), at(1.0, 0)], 2, name="arm")
    beam = sc.Beam(mesh, section(), order=order, director=n, theory=theory)
    arm = model.add("arm", beam)
    end = arm.node("arm.end")
    model.add("pin", sc.JointRevolute(sc.ground(at(0, 0)), arm.node("arm.start"), n))
    c, s = np.cos(roll), np.sin(roll)
    triad = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ sc.triad(along, n)
    inertia: dict[str, Any] = {"euler": (0.01, 0.01, 0.2), "center": (0, 0, 0.1)}
    body = sc.RigidBody(2.0, position=at(1.5, 0), triad=triad, **inertia)
    model.add("body", body)
    sides = end, body.at(at(1, 0))
    elbow = sc.JointUniversal(*sides, n, along) if cardan else sc.JointRevolute(*sides, n)
    model.add("elbow", elbow)
    slider = model.add("slider", sc.RigidBody.sphere(0.5, 0.1, position=at(1.5, 0.3)))
    slide = body.at(at(1.5, 0.3)), slider.at(at(1.5, 0.3))
    model.add("rail", rail(*slide, Q @ (0.6, 0.8, 0)))
    bob = model.add("bob", sc.MassPoint(0.7, position=at(2.0, -0.5)))
    model.add("rod", sc.JointDistance(body.at(at(1.8, 0)), bob.place()))
    bead = model.add("bead", sc.MassPoint(0.3, position=at(1.2, 0.0)))
    model.add("wire", sc.JointPointOnLine(body.at(at(1.5, 0)), bead.place(), along))
    model.add("weight", sc.LoadGravity(Q @ (1.0, -9.81, 0)))
    model.add("wind", sc.LoadForce(bob.place(), lambda t: Q @ (t, 1.0, 0)))
    return model


@pytest.mark.slow
@pytest.mark.parametrize(
    ("Q", "rail", "roll"),
    [
        pytest.param(IDENTITY, sc.JointPrismatic, 0.0, id="xy"),
        pytest.param(SIDEWAYS, sc.JointPlanar, 0.4, id="zx, oblique directors"),
        pytest.param(TURNED, sc.JointPlanar, 0.0, id="any"),
        pytest.param(TURNED, sc.JointPrismatic, 0.4, id="any, oblique directors"),
    ],
)
def test_all_joints_and_forces_in_any_plane(Q: np.ndarray, rail: type, roll: float):
    """Also with directors that are oblique to the plane (`roll`)."""
    model = mechanism(Q, roll, rail=rail, cardan=True)
    end, bob, slider = model["arm"].node("arm.end"), model["bob"].place(), model["slider"]
    mount = Q @ (1.5, 0.3, 0)
    model.add("torque", sc.LoadMoment(end, 3.0 * Q[:, 2], lambda t: np.sin(5 * t)))
    model.add("blow", sc.LoadForce(end, (0, 2.0, 0), follower=True))
    model.add("spring", sc.SpringDamper(sc.ground(Q @ (2, 1, 0)), bob, 20.0, 0.3))
    K = np.diag([100.0, 100.0, 100.0, 5.0, 5.0, 5.0])
    model.add("mount", sc.Bushing(sc.ground(mount), slider.at(mount), K))
    model.add("drag", sc.RayleighDamping(mass=0.1, stiffness=1e-3))
    system, plane = model.freeze(), model.freeze(planar=sc.Planar())
    assert plane.plane is not None
    assert abs(abs(plane.plane.normal @ Q[:, 2]) - 1) < 1e-12
    # 5 nodes on a pin; a turn; a slide; two points with one freedom each
    assert plane.unknowns == 5 * 3 - 2 + 1 + 1 + 1 + 1
    for treatment in TREATMENTS:
        for integrator in BOTH:
            a, b = (sc.simulate(s, integrator, treatment, 2e-2, 0.1) for s in (system, plane))
            assert abs(a["q"][-1] - a["q"][0]).max() > 1e-2
            assert difference(a, b) < 1e-12, (treatment, integrator)
            for name in ("p", "v", "energy", "energy_balance"):  # differences of q over steps
                assert difference(a, b, name) < 1e-9, (name, treatment, integrator)
            for name in ("joint/elbow/force", "joint/rail/moment", "multipliers"):
                assert difference(a, b, name) < 1e-7, (name, treatment, integrator)


def held_body(pin: type | None, Q: np.ndarray) -> sc.Model:
    """A body with oblique directors that spins in a plane, held by force elements, or on a pin."""
    n, point = Q[:, 2], Q @ (0.3, 0.1, 0)
    triad = np.array([[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]]) @ Q.T
    model = sc.Model()
    body = model.add("body", sc.RigidBody(1.0, 0.1 * np.eye(3), triad=triad))
    here, there = body.at(point), sc.ground(point)
    if pin is None:
        model.add("spring", sc.SpringDamper(sc.ground(2 * point), here, 100.0, 0.1))
        model.add("cable", sc.Cable(sc.ground(3 * point), here, 100.0, 0.1))
        model.add("mount", sc.Bushing(there, here, 100.0, 0.1))
    else:
        axis = (n,) if pin is sc.JointRevolute else ()
        joint = model.add("pin", pin(there, here, *axis))
        model.add("spring", sc.JointSpringDamper(joint, 10.0, 0.1))
        model.add("motor", sc.JointActuator(joint, 3.0 if axis else 3.0 * n))
    model.add("weight", sc.LoadGravity(Q @ (1.0, -9.81, 0)))
    return model


@pytest.mark.one_quick
@pytest.mark.parametrize("integrator", [*INTEGRATORS, sc.Variational(stabilized=True)], ids=str)
@pytest.mark.parametrize("pin", [None, sc.JointRevolute, sc.JointSpherical])
def test_runs_with_force_elements_go_on(pin: type | None, integrator: Any):
    """A momentum that constraints take back was said to leave the plane."""
    system = held_body(pin, TURNED).freeze(planar=sc.Planar(TURNED[:, 2]))
    for treatment in TREATMENTS:
        own = system, integrator, treatment, 2e-2
        whole, half = (sc.simulate(*own, until, derive=False) for until in (0.08, 0.04))
        start = sc.restart(system, half, integrator, 2e-2)
        rest = sc.simulate(*own, 0.08, start=start, derive=False)
        assert abs(whole["q"][-1] - whole["q"][0]).max() > 1e-3
        assert abs(rest["q"][-1] - whole["q"][-1]).max() < 1e-9


def linkage(Q: np.ndarray, *kinds: type) -> sc.Model:
    """A heavy four-bar linkage in the plane normal to Q e3, with pins of these kinds."""
    model = four_bar(kinds, turned=Q)
    model.add("weight", sc.LoadGravity(Q @ (0, -9.81, 0)))
    return model


def motor(model: sc.Model) -> sc.JointDrive:
    """Turns the crank."""
    return sc.JointDrive(model["pin 0"], lambda t: 6 * t**2 / (1 + t))


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
@pytest.mark.parametrize("inner", [PIN, BALL, sc.JointCylindrical])
@pytest.mark.parametrize("Q", [IDENTITY, TURNED], ids=["xy", "any"])
def test_driven_closed_loop(Q: np.ndarray, inner: type, treatment: Any):
    """Loops whose joints leave more or less freedom out of the plane are all the same in it."""
    model = linkage(Q, PIN, inner, PIN, PIN)
    model.add("motor", motor(model))
    model.add("spring", sc.JointSpringDamper(model["pin 3"], stiffness=2.0, damping=0.1))
    system, plane = model.freeze(), model.freeze(planar=sc.Planar())
    assert plane.unknowns == 0
    a, b = (sc.simulate(s, sc.EnergyMomentum(), treatment, 1e-2, 0.12) for s in (system, plane))
    assert abs(a["joint/pin 3/angle"][-1]) > 0.02
    for name in ("q", "energy", "joint/pin 3/angle", "work_drives"):
        assert difference(a, b, name) < 1e-11, name
    assert difference(a, b, "joint/motor/moment") < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
def test_free_closed_loop_of_spherical_joints(treatment: Any):
    """A ball and socket at each end: in space the coupler spins as well."""
    model = linkage(IDENTITY, PIN, BALL, BALL, PIN)
    system, plane = model.freeze(), model.freeze(planar=sc.Planar())
    assert (system.unknowns, plane.unknowns) == (2, 1)
    a, b = (sc.simulate(s, sc.Variational(), treatment, 1e-2, 0.12) for s in (system, plane))
    assert difference(a, b) < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
@pytest.mark.parametrize(
    ("theory", "unknowns"),
    [(sc.TheoryInextensible(), 7), (sc.TheoryKirchhoff(), 13), (sc.TheoryRigid(), 1)],
)
def test_theories_in_a_plane(theory: Any, unknowns: int, treatment: Any):
    """7 rotations, and 6 stretches; hung on a pin."""
    model, rod = on_ground(TURNED, 3, TURNED[:, 2], order=2, theory=theory)
    model.add("weight", sc.LoadGravity(TURNED @ (0, -9.81, 0)))
    model.add("push", sc.LoadForce(rod.node(END), TURNED @ (0, 5.0, 0), lambda t: t))
    system, plane = model.freeze(), model.freeze(planar=sc.Planar())
    assert plane.unknowns == unknowns
    for integrator in BOTH:
        a, b = (sc.simulate(s, integrator, treatment, 1e-2, 0.05) for s in (system, plane))
        assert difference(a, b) < 1e-12
        assert difference(a, b, "beam/rod/resultant") < 1e-7


# -- equilibria and vibrations ---------------------------------------------------------------------


def on_ground(
    Q: np.ndarray, elements: int = 4, axis: Any = None, begin: Any = (0, 0, 0), **options: Any
) -> tuple[sc.Model, sc.Beam]:
    """A straight beam along Q e1, clamped or on a hinge."""
    start = Q @ begin
    mesh = sc.MeshCurve.init_line(start, start + Q[:, 0], elements, name="rod")
    model = sc.Model()
    rod = sc.Beam(mesh, **{"section": section(), "director": Q[:, 2]} | options)
    model.add("rod", rod)
    sides = sc.ground(start), rod.node("rod.start")
    if axis is None:
        model.add("clamp", sc.JointFixed(*sides))
    else:
        model.add("pin", sc.JointRevolute(*sides, axis))
    return model, rod


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
@pytest.mark.parametrize("Q", PLANES, ids=["xy", "zx", "any"])
def test_roll_up(Q: np.ndarray, treatment: Any):
    """Rolled up to a circle by an end moment 2 pi EI/L; d1 is along the normal."""
    model, rod = on_ground(Q, 8, order=3)
    model.add("moment", sc.LoadMoment(rod.node(END), 2 * np.pi * D[3] * Q[:, 2]))
    system, plane = model.freeze(), model.freeze(planar=sc.Planar())
    a, b = (sc.static(s, treatment) for s in (system, plane))
    tip = 12 * rod.node(END).vertex
    assert abs(b["q"][-1, tip : tip + 3]).max() < 1e-4
    assert difference(a, b) < 1e-11
    for name in ("strain_energy", "work_loads", "beam/rod/resultant", "joint/clamp/moment"):
        assert difference(a, b, name) < 1e-8, name
    assert plane.unknowns == system.unknowns / 2


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
def test_what_is_free_out_of_the_plane_only_is_held(treatment: Any):
    """Between ball joints a beam can spin about its line: in space that is refused."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod", nodes={"mid": 0.5})
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section(), order=2, director=(0, 0, 1)))
    model.add("left", sc.JointSpherical(sc.ground((0, 0, 0)), rod.node("rod.start")))
    slide = sc.JointPointOnLine(sc.ground((1, 0, 0)), rod.node(END), (1, 0, 0))
    model.add("right", slide)
    model.add("load", sc.LoadForce(rod.node("mid"), (0, -1e-3, 0)))
    with pytest.raises(sc.InputError, match=r"beam 'rod': can move freely .*about \(1, 0, 0\)"):
        sc.static(model, treatment)
    path = sc.static(model.freeze(planar=sc.Planar()), treatment)
    sag = path["q"][-1, 12 * rod.node("mid").vertex + 1]
    exact = -1e-3 * (1 / (48 * D[3]) + 1 / (4 * D[1]))  # F L^3/(48 EI) + F L/(4 GA)
    assert sag == pytest.approx(exact, rel=1e-8)


def test_what_is_free_in_the_plane_is_named():
    model = sc.Model()
    bar = model.add("bar", sc.RigidBody.box(2.0, (1.0, 0.1, 0.2), position=(0.5, 0, 0)))
    model.add("ball", sc.JointSpherical(sc.ground((0, 0, 0)), bar.at((0, 0, 0))))
    model.add("weight", sc.LoadGravity((0, -9.81, 0)))
    with pytest.raises(sc.InputError, match=r"body 'bar': can move freely .*about \(0, 0, 1\)"):
        sc.static(model.freeze(planar=sc.Planar()))


@pytest.mark.parametrize("verb", [sc.static, sc.modes, sc.buckling, sc.simulate])
def test_the_plane_is_asked_for_where_a_scene_is_frozen(verb):
    with pytest.raises(TypeError, match=rf"{verb.__name__}\(\) .* model.freeze\(planar=sc.Planar"):
        verb(on_ground(IDENTITY)[0], planar=sc.Planar())


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
def test_elastica_beyond_its_critical_load(treatment: Any):
    """The column's way out of the plane is stiffer: both see the same bifurcation and branch."""
    model, rod = on_ground(IDENTITY, 3, order=3)
    model.add("push", sc.LoadForce(rod.node(END), (-1.0, 0, 0)))
    critical, ends = np.pi**2 * D[3] / 4, []
    for s in (model.freeze(), model.freeze(planar=sc.Planar())):
        path = sc.static(s, treatment, sc.LoadControl(until=1.05 * critical))
        (point,) = path.meta["critical"]
        assert point["load_factor"] == pytest.approx(critical, rel=6e-3)
        start = sc.branch(s, path)
        bent = sc.static(s, treatment, sc.ArcLength(until=1.2 * critical), start=start)
        tip = 12 * rod.node(END).vertex
        ends.append((point["load_factor"], *abs(bent["q"][-1, tip : tip + 2])))
    assert abs(np.subtract(*ends)).max() < 1e-7 * critical
    assert ends[0][2] > 0.3


@pytest.mark.slow
def test_modes_are_those_in_the_plane():
    """Frequencies in the plane are a subset of all, their shapes have nothing out of it."""
    normal = TURNED[:, 2]
    model, rod = on_ground(TURNED, order=3)
    model.add("load", sc.LoadForce(rod.node(END), TURNED @ (0, 30.0, 0)))
    system, plane = model.freeze(), model.freeze(planar=sc.Planar())
    every = sc.modes(system, sc.static(system), count=24)
    few = sc.modes(plane, sc.static(plane), count=8)
    shapes = every.shapes.reshape(24, -1, 3)
    moves = abs(shapes[:, system.origin_rows])
    out = abs(shapes[:, system.origin_rows] @ normal).max(axis=1)
    turns = abs(np.cross(shapes, system.q0.reshape(-1, 3)) @ normal).max(axis=1)
    flat = out < 1e-6 * abs(shapes).max(axis=(1, 2))
    torsion = moves.max(axis=(1, 2)) < 1e-9 * turns
    inside = every.frequencies[flat & ~torsion]
    assert few.frequencies == pytest.approx(inside[:8], rel=1e-10)
    assert abs(few.shapes.reshape(8, -1, 3) @ normal).max() < 1e-12 * abs(few.shapes).max()


@pytest.mark.slow
def test_spin_about_the_normal():
    model, _ = on_ground(IDENTITY, order=3)
    system, plane = model.freeze(), model.freeze(planar=sc.Planar((0, 0, 1.0)))
    spin = sc.Spin((0, 0, 20.0))
    a, b = (sc.static(s, spin=spin) for s in (system, plane))
    assert difference(a, b) < 1e-12
    assert sc.modes(plane, b, count=3).frequencies.min() > 0
    for call in (sc.static, sc.modes):
        with pytest.raises(sc.InputError, match="is off the normal"):
            call(plane, spin=sc.Spin((0, 20.0, 1.0)))


# -- what leaves the plane -------------------------------------------------------------------------


def arm(
    axis: Any = (0, 0, 1.0), gravity: Any = (0, -9.81, 0), tip: Any = (), **options: Any
) -> tuple[sc.Model, sc.Beam, sc.RigidBody]:
    """A beam along e1 on a pin, with a body at its end."""
    model, rod = on_ground(IDENTITY, axis=axis, **options)
    end, triad = rod.node(END), sc.triad((1, 0, 0), (0, 0, 1))
    given = {"position": end.position, "triad": triad, "euler": (0.01, 0.02, 0.03)} | dict(tip)
    body = model.add("tip", sc.RigidBody(1.0, **given))
    model.add("weld", sc.JointFixed(end, body.at(end.position)))
    model.add("weight", sc.LoadGravity(gravity))
    return model, rod, body


COUPLED = np.diag(D)
COUPLED[3, 4] = COUPLED[4, 3] = 3.0
TILTED = 0.0, np.sin(0.3), np.cos(0.3)
SKEW = np.diag([0.01, 0.02, 0.03]) + 0.004 * np.eye(3)[[2, 1, 0]]


BUILDS: dict[str, tuple[dict[str, Any], str]] = {
    "section turned": (
        {"director": TILTED},
        "beam 'rod': of its section 'section' the stiffness couples motion in the plane with motion"
        " out of it: the plane's normal is 17.1887 degrees off d1 and d2",
    ),
    "section coupled": (
        {"section": sc.Section(COUPLED, mass=1.0, inertia=(1e-3, 2e-3))},
        "beam 'rod': of its section 'section' the stiffness couples .* M_1 with M_2 = 3 ",
    ),
    "section's centre": (
        {"section": section(centre=(0.01, 0.02))},
        "beam 'rod': of its section 'section' the centre of mass is 0.01 m off the plane",
    ),
    "section's viscosity": (
        {"section": section(viscosity=COUPLED)},
        "beam 'rod': of its section 'section' the viscosity couples",
    ),
    "pre-twist": ({"twist": 0.5}, "beam 'rod': its sections turn about its axis"),
    "inertia": (
        {"tip": {"euler": SKEW}},
        "rigid body 'tip': its inertia has no principal axis along the normal of the plane:"
        " product of inertia 0.004 ",
    ),
    "centre of mass": (
        {"tip": {"center": (0.05, 0, 0)}},
        "rigid body 'tip': its centre of mass is 0.05 m off the plane",
    ),
    "axis": (
        {"axis": TILTED},
        r"revolute joint 'pin': its axis \[.*\] is 17.1887 degrees off the normal",
    ),
    "gravity": (
        {"gravity": (0, -9.0, 0.5)},
        r"load 'weight': \[0.0, -9.0, 0.5\] leaves the plane by 0.5",
    ),
    "velocity": (
        {"velocity": (0, 0, 2.0)},
        "beam 'rod': its initial velocity leaves the plane by 2 m/s",
    ),
    "angular velocity": (
        {"tip": {"angular_velocity": (0, 3.0, 1.0)}},
        "rigid body 'tip': its initial angular velocity is off the normal by 3 rad/s",
    ),
}


ADDED: dict[str, tuple[Callable[[sc.Model, sc.Beam, sc.RigidBody], Any], str]] = {
    "force": (
        lambda m, rod, b: sc.LoadForce(rod.node(END), (0, 1.0, 0.25)),
        r"load 'force': \[0.0, 1.0, 0.25\] leaves the plane by 0.25",
    ),
    "follower": (
        lambda m, rod, b: sc.LoadForce(rod.node(END), (0.25, 1.0, 0), follower=True),
        r"load 'follower': \[0.25, 1.0, 0.0\] leaves the plane by 0.25",
    ),
    "line": (
        lambda m, rod, b: sc.LoadLine(rod, (0.25, 1.0, 0), follower=True),
        "load 'line': .* leaves the plane by 0.25",
    ),
    "moment": (
        lambda m, rod, b: sc.LoadMoment(rod.node(END), (0, 1.5, 2.0)),
        r"load 'moment': \[0.0, 1.5, 2.0\] is off the normal by 1.5",
    ),
    "in time": (
        lambda m, rod, b: sc.LoadForce(rod.node(END), lambda t: (0, 1.0, 3 * t)),
        r"load 'in time': \[.*\] at t = 0.001 s leaves the plane by 0.003",
    ),
    "aside": (
        lambda m, rod, b: sc.LoadForce(b.at((1, 0, 0.3)), (0, 1.0, 0)),
        "load 'aside': rigid body 'tip' at .* is 0.3 m off the plane",
    ),
    "spring": (
        lambda m, rod, b: sc.SpringDamper(sc.ground((1, 1, 0.5)), rod.node(END), 5.0),
        "spring 'spring': ground at .* is 0.5 m off the plane",
    ),
    "mount": (
        lambda m, rod, b: sc.Bushing(
            sc.ground((1, 0, 0)), b.at((1, 0, 0)), np.eye(6) + 0.5 * np.eye(6)[[3, 1, 2, 0, 4, 5]]
        ),
        "bushing 'mount': pushes out of the plane where all is in it",
    ),
    "bed": (
        lambda m, rod, b: sc.Foundation(rod, np.array([[1.0, 0, 0.2], [0, 1, 0], [0.2, 0, 1]])),
        "foundation 'bed/0': pushes out of the plane",
    ),
    "motor": (
        lambda m, rod, b: sc.JointActuator(m["ball"], (0.0, 1.0, 2.0)),
        "joint actuator 'motor': pushes out of the plane",
    ),
    "turn": (
        lambda m, rod, b: sc.JointSpringDamper(m["cardan"], 2.0, 0, "angle_b", neutral=0.1),
        "joint spring 'turn': acts on the angle_b, which leaves the plane",
    ),
    "drive": (
        lambda m, rod, b: sc.JointDrive(m["cardan"], lambda t: t, "angle_b"),
        "drive 'drive': prescribes the angle_b, which leaves the plane",
    ),
}


@pytest.mark.slow
@needs_numba
def test_energy_does_not_drift_in_a_plane_whose_axes_are_rounded():
    """Each step moved all points by what is missing to axes of length one, always the same way."""
    Q = random_rotation(np.random.default_rng(0), 2.0)
    model, _ = on_ground(Q, 2, Q[:, 2], begin=(2, 1, 0))
    system = model.freeze(planar=sc.Planar(Q[:, 2]))
    start = sc.initial_state(system, nu=0.5 * np.ones(system.unknowns))
    run = system, sc.EnergyMomentum(), sc.NullSpace(), 7e-5, 7e-5 * 100
    options = {"start": start, "settings": sc.NewtonSettings(reuse=0)}
    plain, compiled = (sc.simulate(*run, kernels=k, **options) for k in ("numpy", "numba"))
    drift = [abs(run["energy_balance"]).max() for run in (plain, compiled)]
    assert drift[1] < 40 * drift[0]  # it was 66 times that


@needs_numba
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
def test_kernels_keep_forces_along_directors_out_of_the_plane(treatment: Any):
    """What they give to a momentum was taken for rounding, if it was below 1e-9 of the momentum."""
    system, h = held_body(None, TURNED).freeze(planar=sc.Planar(TURNED[:, 2])), 1e-4
    own = system, sc.Variational(stabilized=True), treatment, h, 12 * h
    start = sc.initial_state(system, nu=0.3 * np.ones(system.unknowns))
    a, b = (sc.simulate(*own, start=start, kernels=kernels) for kernels in ("numpy", "numba"))
    rounding = np.finfo(float).eps / h**2  # of M q/h^2
    assert difference(a, b, "constraint_force") < 10 * rounding


@pytest.mark.parametrize("law", [{"stiffness": 5.0}, {"damping": 0.3}], ids=repr)
def test_springs_along_slides_that_are_oblique_to_the_plane(law: dict[str, float]):
    """They were taken for springs on what does not move."""
    for x, leaves in (((0, 0.6, 0.8), True), ((0, 1.0, 0), False), ((0, 0, 1.0), False)):
        model = sc.Model()
        body = model.add("body", sc.RigidBody.box(1.0, (0.1, 0.2, 0.3)))
        table = sc.JointPlanar(sc.ground((0, 0, 0)), body.at((0, 0, 0)), (1.0, 0, 0), x=x)
        model.add("spring", sc.JointSpringDamper(model.add("table", table), **law, coordinate="x"))
        if leaves:
            with pytest.raises(
                sc.InputError, match="joint spring 'spring': pushes out of the plane"
            ):
                model.freeze(planar=sc.Planar((0, 0, 1.0)))
        else:
            assert model.freeze(planar=sc.Planar((0, 0, 1.0))).unknowns == 1


@pytest.mark.slow
@needs_numba
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
def test_kernels_agree_where_rows_that_close_loops_are_oblique_to_the_plane(treatment: Any):
    """Two of the rows are enough in the plane, but their forces lead out of it."""
    model = linkage(TURNED, PIN, PIN, PIN, BALL)
    model.add("motor", motor(model))
    own = model.freeze(planar=sc.Planar()), sc.EnergyMomentum(), treatment, 1e-2, 0.1
    a, b = (sc.simulate(*own, kernels=kernels) for kernels in ("numpy", "numba"))
    assert abs(a["q"][-1] - a["q"][0]).max() > 1e-2
    assert difference(a, b) < 1e-11
    assert b["constraint_violation"].max() < 1e-12  # it was 1e-3


def with_more() -> tuple[sc.Model, sc.Beam, sc.RigidBody]:
    """With a ball and a body on a Cardan joint, for what acts on joints."""
    model, rod, body = arm()
    at = (0.5, 0, 0)
    for name, kind, axes in (
        ("ball", sc.JointSpherical, ()),
        ("cardan", sc.JointUniversal, ((0, 0, 1.0), (1.0, 0, 0))),
    ):
        other = model.add(f"{name} body", sc.RigidBody.sphere(1.0, 0.1, position=at))
        model.add(name, kind(rod.node(at), other.at(at), *axes))
    return model, rod, body


@pytest.mark.one_quick
@pytest.mark.parametrize("name", BUILDS)
def test_what_leaves_the_plane_is_named(name: str):
    options, message = BUILDS[name]
    model = arm(**options)[0]
    model.freeze()
    with pytest.raises(sc.InputError, match=message) as caught:
        model.freeze(planar=sc.Planar((0, 0, 1.0)))
    assert "the plane is normal to [0.0, 0.0, 1.0], through the middle" in str(caught.value)
    found = sc.planarity(model, (0, 0, 1.0))
    assert not found and found.planar is None
    assert len(found.out_of_plane) == 1, found


def test_sections_of_all_parts_of_a_beam_are_looked_at():
    """Those of the second part, with nodes of its own: its stiffness alone leads out."""
    parts = [sc.MeshCurve.init_line((k, 0, 0), (k + 1.0, 0, 0), 4, "ab"[k]) for k in (0, 1)]
    mesh = parts[0].joined(parts[1])
    for other, leaves in ((section(), False), (sc.Section(COUPLED, 1.0, (1e-3, 2e-3)), True)):
        model = sc.Model()
        model.add("rod", sc.Beam(mesh, {"a": section(), "b": other}, director=(0, 0, 1.0)))
        found = sc.planarity(model, (0, 0, 1.0))
        assert bool(found) is not leaves
        assert ("of its section 'b' the stiffness couples" in str(found.out_of_plane)) is leaves


@pytest.mark.one_quick
@pytest.mark.parametrize("name", ADDED)
def test_forces_that_leave_the_plane_are_named(name: str):
    make, message = ADDED[name]
    model, rod, body = with_more()
    assert sc.planarity(model)
    model.add(name, make(model, rod, body))
    model.freeze()
    with pytest.raises(sc.InputError, match=message):
        model.freeze(planar=sc.Planar((0, 0, 1.0)))


def test_curved_beams():
    """An arc lies in a plane, a helix in none; it is found without being told."""
    arc = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 0.6, 0.8), 2.0, 1.5, 4, name="rod")
    helix = sc.MeshCurve.init_helix((1, 0, 0), (0, 0, 0), (0, 0, 1), 0.4, 0.5, 6, name="rod")
    model, other = sc.Model(), sc.Model()
    model.add("rod", sc.Beam(arc, section(), order=2, director=(0, -0.8, 0.6)))
    assert repr(sc.planarity(model)) == "<planar, normal [0.0, 0.8, -0.6]>"
    other.add("rod", sc.Beam(helix, section(), director=(0, 0, 1)))
    with pytest.raises(sc.InputError, match=r"beam 'rod': node \d+ at .* m off the plane"):
        other.freeze(planar=sc.Planar())


def test_a_straight_rod_has_the_plane_of_what_acts_on_it():
    for kind, value, normal in (
        (sc.LoadForce, (0, 0, 1.0), [0, 1, 0]),
        (sc.LoadForce, (0, 2.0, 0), [0, 0, 1]),
        (sc.LoadMoment, (0, 1.0, 0), [0, 1, 0]),
    ):
        model, rod = on_ground(IDENTITY)
        model.add("load", kind(rod.node(END), value))
        assert sc.planarity(model).plane.normal.tolist() == normal
    model.add("aside", sc.LoadForce(rod.node(END), (0, 1.0, 0)))
    assert not sc.planarity(model)


def pendulum(motion: Callable[[float], tuple[float, float, float]]) -> sc.Model:
    """A mass point on a rod that hangs on moving ground."""
    model = sc.Model()
    bob = model.add("bob", sc.MassPoint(1.0, position=(1.0, 0, 0)))
    ground = sc.ground((0, 0, 0), sc.Motion(displacement=motion))
    model.add("rod", sc.JointDistance(ground, bob.place()))
    model.add("weight", sc.LoadGravity((0, -9.81, 0)))
    return model


def test_prescribed_motion_out_of_the_plane():
    """At the start it is refused, later on the run stops with its time."""
    with pytest.raises(sc.InputError, match=r"ground at .* leaves the plane at t = 0.001 s, by"):
        pendulum(lambda t: (0, 0, 0.1 * t)).freeze(planar=sc.Planar((0, 0, 1.0)))
    late = pendulum(lambda t: (0, 0, 0.1 * max(0.0, t - 0.2))).freeze(planar=sc.Planar())
    with pytest.raises(sc.InputError, match=r"leaves the plane .* at t = 0.2\d* s"):
        sc.simulate(late, sc.EnergyMomentum(), sc.NullSpace(), 0.05, 1.0)


@pytest.mark.slow
def test_prescribed_motion_in_the_plane():
    model, planes = pendulum(lambda t: (0.1 * t**3, t**2, 0)), (None, sc.Planar())
    run = sc.EnergyMomentum(), sc.NullSpace(), 0.02, 0.5
    assert difference(*(sc.simulate(model.freeze(planar=each), *run) for each in planes)) < 1e-12


def test_loads_that_leave_the_plane_later():
    model, rod, _ = arm()
    model.add("gust", sc.LoadForce(rod.node(END), lambda t: (0, 1.0, max(0.0, t - 0.2))))
    plane = model.freeze(planar=sc.Planar())
    with pytest.raises(sc.InputError, match=r"load 'gust': leaves the plane .* by "):
        sc.simulate(plane, sc.EnergyMomentum(), sc.NullSpace(), 0.05, 1.0)
    with pytest.raises(sc.InputError, match=r"load 'gust': leaves the plane .* by "):
        sc.static(plane, start=sc.initial_state(plane), control=sc.LoadControl(until=1.0))


def test_states_that_leave_the_plane():
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(2.0, (1, 2, 3)))
    model.add("push", sc.LoadForce(body.local((1, 0, 0)), (0, 1.0, 0)))
    plane = model.freeze(planar=sc.Planar())
    assert plane.unknowns == 3
    q, up = plane.q0, np.eye(12)[2]
    turn = np.concatenate([np.zeros(3), *np.cross((1.0, 0, 0), IDENTITY)])
    for v in (up, turn):
        with pytest.raises(sc.InputError, match="initial state: the velocity leaves the plane"):
            sc.initial_state(plane, v=v)
        p = momentum(plane, v)
        with pytest.raises(sc.InputError, match="initial state: p leaves the plane"):
            sc.initial_state(plane, p=p)
        moving = sc.State(0.0, 0, q, p)
        with pytest.raises(sc.InputError, match="argument start: its momentum leaves the plane"):
            next(sc.steps(plane, sc.Variational(), sc.NullSpace(), 0.1, moving))
    off = q + 0.01 * up
    with pytest.raises(sc.InputError, match=r"initial state: q leaves the plane .* by 0.01 "):
        sc.initial_state(plane, q=off)
    with pytest.raises(sc.InputError, match="argument start: its configuration leaves the plane"):
        sc.static(plane, start=sc.State(0.0, 0, off, 0 * q))
    with pytest.raises(sc.InputError, match="argument state: its configuration leaves the plane"):
        sc.modes(plane, off, count=2)


def test_arguments():
    model, _, _ = arm()
    with pytest.raises(sc.InputError, match=r"expected Planar\(\)"):
        model.freeze(planar=True)  # type: ignore[arg-type]
    with pytest.raises(sc.InputError, match="expected a unit vector"):
        sc.Planar((0, 0, 2.0))
    with pytest.raises(sc.InputError, match="expected a Model or a System"):
        sc.planarity("scene")  # type: ignore[arg-type]
    assert repr(sc.Planar((0, 0, 1.0))) == "Planar(normal=[0.0, 0.0, 1.0])"


def test_what_there_is_none_of_in_a_plane():
    model, _, _ = arm()
    plane = model.freeze(planar=sc.Planar())
    with pytest.raises(sc.IncompatibleError, match="plane normal to"):
        sc.simulate(plane, sc.Explicit(), sc.Multipliers(), 1e-4, 1e-3)


@pytest.mark.slow
def test_runs_go_on_and_travel():
    """A run in the plane goes on in space and the other way round; systems reach processes."""
    model, _, _ = arm()
    system, plane = model.freeze(), pickle.loads(pickle.dumps(model.freeze(planar=sc.Planar())))
    scheme, step = sc.EnergyMomentum(), 1e-2
    whole = sc.simulate(system, scheme, sc.NullSpace(), step, 0.2)
    part = sc.simulate(plane, scheme, sc.NullSpace(), step, 0.1)
    for other, until in ((system, 0.15), (plane, 0.2)):
        start = sc.restart(other, part, scheme, step)
        part = sc.simulate(other, scheme, sc.NullSpace(), step, until, start=start)
    assert abs(part["q"][-1] - whole["q"][-1]).max() < 1e-12


# -- compiled kernels ------------------------------------------------------------------------------

KIND = "variational", "energy-momentum"
HOLD = (sc.TheoryInextensible(), sc.TheoryKirchhoff())


def loop() -> sc.Model:
    """A four-bar linkage whose coupler carries a beam."""
    model = four_bar()
    mesh = sc.MeshCurve.init_line((0, 1, 0), (-0.5, 1, 0), 3, name="mast")
    mast = model.add("mast", sc.Beam(mesh, section(), director=(0, 0, 1)))
    model.add("foot", sc.JointFixed(model["coupler"].at((0, 1, 0)), mast.node("mast.start")))
    model.add("weight", sc.LoadGravity((1.0, -9.81, 0)))
    return model


def stiff_swing(theory: Any) -> sc.Model:
    return example().scene("stiff", elements=4, theory=theory)


TREES = {
    **{f"mechanism {k}": partial(mechanism, Q, 0.4) for k, Q in enumerate(PLANES)},
    **{f"mechanism {theory!r}": partial(mechanism, TURNED, 0.4, theory=theory) for theory in HOLD},
    "mechanism of order 2": partial(mechanism, TURNED, 0.4, 2),
    "swing": partial(swing_model, 4),
}
LOOPS = {"linkage": loop} | {f"swing {theory!r}": partial(stiff_swing, theory) for theory in HOLD}


def started_in_plane(system: sc.System) -> sc.State:
    """In motion, by random rates."""
    nu = np.random.default_rng(4).standard_normal(system.unknowns)
    return sc.initial_state(system, nu=nu)


# a swing of four elements folds
@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize("integrator", KIND)
@pytest.mark.parametrize("scene", TREES)
def test_kernels_agree_on_trees(scene: str, integrator: str):
    """All joints, in any plane, with directors that are oblique to it."""
    system = TREES[scene]().freeze(planar=sc.Planar())
    plain, fast = both(system, integrator, "null space", 5e-3, 0.1, started_in_plane(system))
    assert abs(plain["q"][-1] - plain["q"][0]).max() > 1e-2
    assert_same(plain, fast, iterates=False)


@pytest.mark.slow
@pytest.mark.parametrize("integrator", KIND)
@pytest.mark.parametrize("scene", LOOPS)
def test_kernels_agree_on_closed_loops(scene: str, integrator: str):
    system = LOOPS[scene]().freeze(planar=sc.Planar())
    assert system.closure.rank > 0
    # the swing starts from rest
    start = started_in_plane(system) if scene == "linkage" else sc.initial_state(system)
    run = both(system, integrator, "null space", 2e-3, 0.1, start)
    assert run[1]["attempts"].max() == 1
    assert_same(*run, iterates=False)


@pytest.mark.slow
@pytest.mark.parametrize("integrator", KIND)
def test_kept_factors_lead_to_the_same_motion(integrator: str):
    """Turned with the frames, those of children as well."""
    system = mechanism(TURNED, 0.4, theory=HOLD[0]).freeze(planar=sc.Planar())
    run = system, integrator, "null space", 1e-3, 0.1, started_in_plane(system)
    whole, kept = with_kept_factors(*run)
    assert kept["q"][-1] == pytest.approx(whole["q"][-1], abs=1e-10)
    assert kept.meta["factorisations"] < 0.7 * whole.meta["factorisations"]


BESIDE: dict[str, Callable[[sc.Model], Any]] = {
    "follower": lambda m: sc.LoadForce(m["arm"].node("arm.end"), (0, 2.0, 0), follower=True),
    "drag": lambda m: sc.RayleighDamping(mass=0.1),
    "spring": lambda m: sc.SpringDamper(sc.ground((2, 1, 0)), m["bob"].place(), 20.0),
    "drive": lambda m: sc.JointDrive(m["pin"], lambda t: 0.5 * t**2),
}


@pytest.mark.slow
@pytest.mark.parametrize("treatment", ["null space", "multipliers"])
@pytest.mark.parametrize("integrator", KIND)
@pytest.mark.parametrize("name", BESIDE)
def test_kernels_keep_scenes_in_their_plane(name, integrator, treatment):
    """They step them in space."""
    model = mechanism(IDENTITY, 0.4)
    model.add("more", BESIDE[name](model))
    system = model.freeze(planar=sc.Planar())
    plain, fast = both(system, integrator, treatment, 5e-3, 0.1, sc.initial_state(system))
    assert abs(plain["q"][-1] - plain["q"][0]).max() > 1e-2
    assert_same(plain, fast, iterates=False)
    out = fast["q"].reshape(len(fast), -1, 3) @ system.plane.normal
    assert abs(out - out[0]).max() < 1e-13


@pytest.mark.slow
@pytest.mark.parametrize("treatment", ["null space", "multipliers"])
def test_kernels_agree_on_closed_loops_under_follower_loads(treatment):
    """In space their rows depend on others: those that are independent in the plane do."""
    model = loop()
    model.add("push", sc.LoadForce(model["mast"].node("mast.end"), (0, 1.0, 0), follower=True))
    system = model.freeze(planar=sc.Planar())
    start = sc.initial_state(system)
    plain, fast = both(system, "variational", treatment, 5e-3, 0.05, start)
    assert_same(plain, fast, iterates=False)


@pytest.mark.slow
@pytest.mark.parametrize("solver", [None, sc.SolverSuperLU()], ids=["as found", "superlu"])
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
def test_grids_of_which_a_solver_takes_a_part(treatment, solver):
    """In a plane, too."""
    pytest.importorskip("numba")
    cubes = lattice_mesh(4)
    mesh = cubes.restrict(cubes.elements_satisfying(lambda x: x[2] < 1e-9)).directed()
    model = sc.Model()
    rubber = sc.SectionCircle(5e-3, sc.Material(5e6, 0.5, 1100))
    beam = model.add("grid", sc.Beam(mesh, rubber, director=(0, 0, 1)))
    for k in np.flatnonzero(mesh.p[0] == 0).tolist():
        model.add(f"clamp {k}", sc.JointFixed(sc.ground(mesh.p[:, k]), beam.node(k)))
    model.add("weight", sc.LoadGravity((0.1, -2.0, 0)))
    run = model.freeze(planar=sc.Planar()), sc.EnergyMomentum(), treatment, 2e-3, 0.04
    plain = sc.simulate(*run, kernels="numpy", derive=False)
    fast = sc.simulate(*run, kernels="numba", derive=False, solver=solver)
    assert ("superlu" in fast.meta["solver"]) or solver is None
    assert difference(plain, fast) < 1e-12


@pytest.mark.parametrize("metre", [1e-6, 1e-3, 1.0, 1e3])
def test_states_are_judged_by_the_size_of_the_scene(metre):
    """The same share of the extent off the plane, whatever the unit of length is."""
    round_ = sc.SectionCircle(radius=0.01 * metre, material=sc.Material(E=5e6, nu=0.5, rho=1e3))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (metre, 0, 0), 2, name="rod")
    model = sc.Model()
    model.add("rod", sc.Beam(mesh, round_, director=(0, 1, 0)))
    system = model.freeze(planar=sc.Planar((0, 0, 1)))
    turning = 2.0 * np.cross((0, 0, 1), system.q0.reshape(-1, 3)).ravel()
    up = metre * np.eye(system.n)[3 * system.origin_rows[-1] + 2]

    def started(rise=0.0, speed=0.0):
        v = turning + speed * up
        sc.initial_state(system, v=v)
        p = (system.mass @ v.reshape(-1, 3)).ravel()
        start = sc.State(0.0, 0, system.q0 + rise * up, p)
        next(sc.steps(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, start))

    started(1e-9, 1e-9)
    with pytest.raises(sc.InputError, match="its configuration leaves the plane"):
        started(rise=1e-6)
    with pytest.raises(sc.InputError, match="the velocity leaves the plane"):
        started(speed=1e-6)
