"""Equilibrium paths: closed forms, generality in both treatments, tangents, critical points."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_kernels import needs_numba
from helpers_scenes import (
    TENSOR,
    _corner,
    _two_sections,
    everything,
    four_bar,
    full_section,
    random_state,
    random_tree,
    triangle,
)
from scipy.optimize import brentq
from scipy.special import ellipk
from test_couplings import zoo

import skfem_cosserat as sc
from skfem_cosserat import Spin, equilibrium
from skfem_cosserat.diagnostics.stacked import blocks_matrix
from skfem_cosserat.model.balance import Amplitudes, balance, balance_tangent
from skfem_cosserat.statics.control import Functional, Point
from skfem_cosserat.statics.path import STATIC
from skfem_cosserat.statics.problem import PathSolver, Problem, Schedule

EPS = 1e-40
TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
treatments = pytest.mark.parametrize("treatment", TREATMENTS.values(), ids=TREATMENTS)
#: compiled kernels are for the null space only
ways = pytest.mark.parametrize(
    ("treatment", "kernels"),
    [
        (sc.NullSpace(), "numpy"),
        pytest.param(sc.NullSpace(), "numba", marks=needs_numba),
        (sc.Multipliers(), "numpy"),
    ],
    ids=["null space", "compiled", "multipliers"],
)


def stiff(EA=1e4, EI=(1.0, 1.0), GJ=2.0):
    """Section with equal shear and axial stiffness."""
    return sc.Section([EA, EA, EA, *EI, GJ], mass=1.0, inertia=(1e-3, 1e-3))


def rod(model, section=None, elements=4, order=3, ends=((0, 0, 0), (1, 0, 0)), name="rod", **how):
    mesh = sc.MeshCurve.init_line(*ends, elements, name=name)
    return model.add(name, sc.Beam(mesh, section or stiff(), order=order, **how))


def cantilever(section=None, **options):
    """A rod along x, clamped at its start."""
    model = sc.Model()
    beam = rod(model, section, **options)
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("rod.start")))
    return model, beam.node("rod.end")


def at(history, place, k=slice(None)):
    """Position of a node or a body's origin."""
    first = 12 * place.vertex
    return history["q"][k, first : first + 3]


def criticals(history):
    return [(c["kind"], c["multiplicity"]) for c in history.meta["critical"]]


def loads_of(history):
    return np.array([c["load_factor"] for c in history.meta["critical"]])


# -- closed forms ----------------------------------------------------------------------------------


def on_a_line(*items):
    """A mass point on the x axis, with force elements between the ground and it."""
    model = sc.Model()
    point = model.add("point", sc.MassPoint(2.0, (1, 0, 0)))
    model.add("wire", sc.JointPointOnLine(sc.ground((0, 0, 0)), point.place(), axis=(1, 0, 0)))
    for k, (kind, options) in enumerate(items):
        model.add(f"item {k}", kind(sc.ground((0, 0, 0)), point.place(), **options))
    return model, point


@pytest.mark.one_quick
@treatments
def test_spring_and_cable(treatment):
    """F/k; a cable of 0.2 m slack joins in: the law has a kink."""
    spring = (sc.SpringDamper, {"stiffness": 10.0, "damping": 3.0})
    cable = (sc.Cable, {"stiffness": 90.0, "length": 1.2})
    model, point = on_a_line(spring, cable)
    model.add("pull", sc.LoadForce(point.place(), (12.0, 5.0, -4.0)))
    path = sc.static(model, treatment, sc.LoadControl(at=[0.1, 1 / 6, 0.5, 1.0]))
    wanted = [0.0, 0.12, 0.2, (6 + 18) / 100, (12 + 18) / 100]
    assert abs(path["q"][:, 0] - 1 - wanted).max() < 1e-12
    assert abs(path["coupling/item 0/force"] - 10 * np.array(wanted)).max() < 1e-11
    assert abs(path["joint/wire/force"][-1] - [0, -5, 4]).max() < 1e-11
    assert path.meta["critical"] == []


@pytest.mark.one_quick
@treatments
def test_bushing(treatment):
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (1, 1, 1)))
    K = np.diag([1e3, 2e3, 3e3, 50.0, 60.0, 70.0])
    model.add("mount", sc.Bushing(sc.ground((0, 0, 0)), body.at((0, 0, 0)), K))
    model.add("force", sc.LoadForce(body.at((0, 0, 0)), (5.0, 6.0, -3.0)))
    model.add("moment", sc.LoadMoment(body.at((0, 0, 0)), (0, 0, 140.0)))
    q = sc.static(model, treatment)["q"][-1]
    assert abs(q[:3] - [5e-3, 3e-3, -1e-3]).max() < 1e-14
    assert np.arctan2(q[4], q[3]) == pytest.approx(2.0, abs=1e-13)


def hinged(*items, axis=(0, 1, 0), position=(0, 0, 0.5)):
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (0.1, 0.1, 1.0), position=position))
    hinge = model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), body.at((0, 0, 0)), axis))
    model.add("spring", sc.JointSpringDamper(hinge, 2.0))
    return model, hinge, body


@pytest.mark.slow
@treatments
@pytest.mark.parametrize("control", [sc.LoadControl(), sc.LoadControl(steps=8)])
def test_actuator_against_a_torsion_spring(treatment, control):
    """Two turns: angles of springs are followed from point to point."""
    model, hinge, _ = hinged()
    model.add("motor", sc.JointActuator(hinge, 25.0))
    path = sc.static(model, treatment, control)
    assert path["joint/hinge/angle"][-1] == pytest.approx(12.5, abs=1e-12)
    assert path["coupling/spring/force"][-1] == pytest.approx(25.0, abs=1e-11)
    assert path["turns"][-1].tolist() == [2, 2]  # of spring and motor
    assert abs(path["joint/hinge/angle"] - 12.5 * path["load_factor"]).max() < 1e-11


@pytest.mark.slow
@treatments
def test_centrifugal_stretch_of_a_bar(treatment):
    """``L (tan(kL)/(kL) - 1)``, k^2 = rho A Omega^2/EA: element ends converge with h^8."""
    model, tip = cantilever(stiff(EI=(10.0, 10.0)), order=4)
    path = sc.static(model, treatment, spin=Spin((0, 0, 42.0)))
    k = 42.0 / 1e2
    wanted = np.tan(k) / k - 1
    assert at(path, tip, -1)[0] - 1 == pytest.approx(wanted, rel=1e-10)
    # u = sin(ks)/(k cos(k)) - s, so that the strain at the root is 1/cos(k) - 1
    root = path["joint/clamp/force"][-1]
    assert abs(root + [1e4 * (1 / np.cos(k) - 1), 0, 0]).max() < 1e-5


@pytest.mark.one_quick
@treatments
def test_spinning_mass_on_a_spring(treatment):
    """``k u = m Omega^2 (r + u)``; the axis need not pass through the origin."""
    model, _ = on_a_line((sc.SpringDamper, {"stiffness": 50.0}))
    spin = Spin((0, 0, 3.0), point=(-0.5, 4.0, 2.0))
    path = sc.static(model, treatment, spin=spin, factors={"spin": sc.Table([0, 1], [0, 1])})
    wanted = 2 * 9 * 1.5 / (50 - 2 * 9)
    assert path["q"][-1, 0] - 1 == pytest.approx(wanted, rel=1e-12)
    assert path["joint/wire/force"][-1, 1] == pytest.approx(2 * 9 * 4, rel=1e-12)


@pytest.mark.slow
def test_reactions_balance_the_loads():
    model, tip = cantilever(order=2, elements=6)
    model.add("line", sc.LoadLine(model["rod"], (0.2, 0.5, -0.4)))
    model.add("force", sc.LoadForce(tip, (0.3, 0.1, 0.2)))
    model.add("moment", sc.LoadMoment(tip, (0.1, -0.2, 0.3)))
    model.add("gravity", sc.LoadGravity((0, 0, -0.7)))
    path = sc.static(model)
    total = np.array([0.2 + 0.3, 0.5 + 0.1, -0.4 + 0.2 - 0.7])
    assert abs(path["joint/clamp/force"][-1] + total).max() < 1e-10
    beam = model["rod"]
    x = path["q"][-1].reshape(-1, 12)[:, :3]
    moment = np.array([0.1, -0.2, 0.3]) + np.cross(x[tip.vertex], [0.3, 0.1, 0.2])
    nodal = np.zeros(len(x))
    for e, nodes in enumerate(beam.basis.connectivity):
        nodal[nodes] += beam.basis.lengths[e] * np.array([1, 4, 1]) / 6  # Simpson
    moment += np.cross(nodal[:, None] * x, [0.2, 0.5, -1.1]).sum(0)
    assert abs(path["joint/clamp/moment"][-1] + moment).max() < 1e-11


# -- everything at once ----------------------------------------------------------------------------


def assembly(order):
    """Crossing, lumps, joints, all force elements and all loads, held everywhere."""
    model = sc.Model()
    frame = model.add("frame", sc.Beam(_corner(), _two_sections(), order=order))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, -1)), frame.node("base.start")))
    model.add("hub", sc.RigidBody(0.7, TENSOR, center=(0.05, 0.1, -0.1), on=frame.node("corner")))
    model.add("lump", sc.MassPoint(0.4, on=frame.node("leg.end")))
    arc = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0.3), 1.5, 1.0, 2, "arc")
    curved = model.add("curved", sc.Beam(arc, full_section(), order=order, twist=0.4))
    foot = sc.JointUniversal(sc.ground((0, 0, 0)), curved.node("arc.start"), (1, 0, 0), (0, 0, 1))
    model.add("foot", foot)
    for c in foot.coordinates():
        model.add(f"spring {c.name}", sc.JointSpringDamper(foot, 8.0, coordinate=c.name))
    body = sc.RigidBody(1.5, TENSOR, center=(0.1, -0.2, 0.15), position=(2.0, 0.3, 0))
    model.add("body", body)
    K = np.diag([80.0, 90, 100, 20, 25, 30])
    model.add("mount", sc.Bushing(curved.node("arc.end"), body.at((1.8, 0.2, 0.1)), K))
    model.add("tie", sc.SpringDamper(sc.ground((3, 1, 1)), body.at((2.2, 0.4, 0.2)), 20.0))
    arm = frame.node("arm.end")
    model.add("cable", sc.Cable(arm, body.at((2.2, 0.4, -0.2)), 15.0, length=1.0))
    slider = model.add("slider", sc.RigidBody.box(0.5, (0.2, 0.2, 0.2), position=(2.5, 0.3, 0)))
    slide = sc.JointPrismatic(body.at((2.2, 0.3, 0)), slider.at((2.2, 0.3, 0)), axis=(1, 0, 0))
    model.add("slide", slide)
    model.add("slide spring", sc.JointSpringDamper(slide, 30.0))
    model.add("motor", sc.JointActuator(slide, 2.0))
    model.add("gravity", sc.LoadGravity((0.3, -0.2, -2.0)))
    follower = {"follower": True}
    end = curved.node("arc.end")
    model.add("dead", sc.LoadForce(body.at((2.0, 0.5, 0.1)), (1, 0.5, -0.5)))
    model.add("thrust", sc.LoadForce(arm, (0.5, 0.3, -0.4), **follower))
    model.add("push", sc.LoadForce(slider.at((2.6, 0.3, 0)), (0.2, 0.3, 0.1), **follower))
    model.add("moment", sc.LoadMoment(frame.node("corner"), (0.5, 0.2, -0.3)))
    model.add("torque", sc.LoadMoment(end, (0.3, -0.4, 0.2), **follower))
    model.add("line", sc.LoadLine(curved, (0.5, 0, -1)))
    model.add("wind", sc.LoadLine(frame, (0.3, 0.4, 0.1), part="leg", **follower))
    return model.freeze()


SPIN = Spin((0.2, 0.1, 0.4), (0, 1, 0))


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2])
def test_every_item_in_both_treatments(order):
    """Same equilibrium and constraint forces."""
    system = assembly(order)
    until = 0.3 if order == 1 else 1.0  # three linear elements carry no more than 0.34
    control = sc.LoadControl(until)
    ends = [sc.static(system, t, control, spin=SPIN) for t in TREATMENTS.values()]
    q, other = (path["q"][-1] for path in ends)
    assert abs(q - other).max() < 1e-12
    assert abs(q - system.q0).max() > 0.5 * until
    force, second = (path["constraint_force"][-1] for path in ends)
    assert abs(force - second).max() < 1e-10 * abs(force).max()
    assert ends[0].meta["critical"] == ends[1].meta["critical"] == []


def linkage():
    """Redundant rows: a spring and a motor turn the loop, a force lies across it."""
    model = four_bar()
    model.add("spring", sc.JointSpringDamper(model["pin 0"], 5.0))
    model.add("motor", sc.JointActuator(model["pin 2"], 4.0))
    model.add("push", sc.LoadForce(model["coupler"].at((1, 1.25, 0)), (10.0, 3, 4)))
    return model


def ring():
    """A closed loop of ball joints on springs."""
    model = triangle()
    for k in range(3):
        place = model[f"bar {k}"].at((0.0, 0, 0))
        model.add(f"mount {k}", sc.Bushing(sc.ground((0, 0, 1.0)), place, 30.0))
    return model


@pytest.mark.slow
@pytest.mark.parametrize("scene", [linkage, ring])
def test_closed_loops_in_both_treatments(scene):
    system = scene().freeze()
    ends = [sc.static(system, t) for t in TREATMENTS.values()]
    q, other = (path["q"][-1] for path in ends)
    assert abs(q - other).max() < 1e-10
    assert abs(q - system.q0).max() > 1e-4
    force, second = (path["constraint_force"][-1] for path in ends)
    assert abs(force - second).max() < 1e-9 * abs(force).max()
    assert ends[0]["constraint_violation"].max() < 1e-12


# -- controls --------------------------------------------------------------------------------------


def truss(height=0.3, stiffness=(100.0, 100.0)):
    """A mass point on two pairs of springs, at right angles: a shallow one snaps through."""
    model = sc.Model()
    point = model.add("point", sc.MassPoint(1.0, (0, 0, height)))
    for k, x in enumerate([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)]):
        spring = sc.SpringDamper(sc.ground(x), point.place(), stiffness[k // 2])
        model.add(f"spring {k}", spring)
    model.add("load", sc.LoadForce(point.place(), (0, 0, -1.0)))
    return model, point


def pushed_down(z):
    """Load of the shallow truss at height z."""
    return 400 * (np.hypot(1, 0.3) / np.hypot(1, z) - 1) * z


def bow():
    """A flat arch between two hinges, pushed at its top, and that node."""
    points = [(x, 0.3 * (1 - x * x), 0) for x in np.linspace(-1, 1, 7)]
    mesh, model = sc.MeshCurve.init_polyline(points, 1, name="rod"), sc.Model()
    section = sc.Section([2e4, 2e4, 5e4, 40.0, 60.0, 30.0], mass=1.0, inertia=(1e-3, 1e-3))
    beam = model.add("bow", sc.Beam(mesh, section, director=(0, 0, 1)))
    for end in ("start", "end"):
        node = beam.node(f"rod.{end}")
        model.add(end, sc.JointRevolute(sc.ground(node.position), node, axis=(0, 0, 1)))
    top = beam.node((0, 0.3, 0))
    model.add("push", sc.LoadForce(top, (0.0, -60.0, 0)))
    return model, top


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # of few elements
def test_critical_points_do_not_hang_on_the_steps():
    """Two bifurcations of a flat arch, which lie in one step where the steps are long."""
    (model, top), found = bow(), []
    for steps in (4, 5, 24):
        path = sc.static(model, control=sc.DisplacementControl(top, (0, -1, 0), 0.1, steps=steps))
        found.append(loads_of(path))
    assert len(found[0]) > 1
    for loads in found:
        assert loads == pytest.approx(found[-1], rel=1e-8)


@pytest.mark.slow
def test_a_bifurcation_of_a_bow_is_symmetric():
    """It lies on the path that goes on, where the bow does not lean to a side."""
    path = sc.static(bow()[0], control=sc.ArcLength(12, first=0.2))
    (found,) = path.meta["critical"]
    x = path["q"][found["state"]].reshape(-1, 12)[:, :2]
    assert found["kind"] == "bifurcation"
    assert x == pytest.approx(x[::-1] * [-1, 1], abs=1e-10)


@pytest.mark.slow
@treatments
def test_controls_agree(treatment):
    """By displacement, by arc length and by load: the same loads at the same places."""
    model, point = truss()
    stops = [0.05, 0.1, 0.2, 0.4, 0.65]
    control = sc.DisplacementControl(point.place(), (0, 0, -2.0), at=stops)
    path = sc.static(model, treatment, control)
    asked = path["critical"] == 0
    assert path.times[asked] == pytest.approx([0, *stops], abs=1e-14)
    assert abs(0.3 - path["q"][asked, 2] - path.times[asked]).max() < 1e-13
    assert abs(path["load_factor"] - pushed_down(path["q"][:, 2])).max() < 1e-10
    until = float(path["load_factor"][1])
    by_arc = sc.static(model, treatment, sc.ArcLength(50, until=until))
    by_load = sc.static(model, treatment, sc.LoadControl(until))
    for other in (by_arc, by_load):
        assert other["load_factor"][-1] == pytest.approx(until, abs=1e-12)
        assert other["q"][-1] == pytest.approx(path["q"][1], abs=1e-11)


def test_a_step_that_jumps_over_a_limit_point_is_told():
    """Ends of all steps are stable: only the tangents tell. Shorter ones on one branch do not."""
    model, _ = truss()
    crest = pushed_down(np.linspace(0, 0.3, 10001)).max()
    beyond = rf"path, load factor {2 * crest:.6g}: from load factor 0 on .* jumped .*ArcLength"
    with pytest.warns(sc.AccuracyWarning, match=beyond):
        path = sc.static(model, control=sc.LoadControl(until=4 * crest, steps=2))
    assert (path["unstable"] == 0).all() and path["q"][-1, 2] < 0
    assert [each["item"] for each in path.meta["warnings"]] == ["path"]
    for steps in (1, 3):
        assert not sc.static(model, control=sc.LoadControl(0.9 * crest, steps=steps)).meta[
            "warnings"
        ]


@pytest.mark.slow
def test_arc_length_comes_back_to_its_first_load_factor():
    """``until`` at the start: the path ends where it crosses that load again."""
    model, _ = truss()
    path = sc.static(model, control=sc.ArcLength(100, first=0.9, until=0.0))
    assert path["load_factor"][-1] == pytest.approx(0.0, abs=1e-12)
    assert path["q"][-1, 2] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
@ways
def test_end_does_not_depend_on_the_steps(treatment, kernels):
    model, tip = cantilever(stiff(1e5))
    model.add("load", sc.LoadForce(tip, (-1.0, 3.0, 2.0)))
    reference = sc.static(model)
    for steps in (1, 7):
        path = sc.static(model, treatment, sc.LoadControl(steps=steps), kernels=kernels)
        assert path["load_factor"] == pytest.approx(np.linspace(0, 1, steps + 1), abs=1e-15)
        assert abs(path["q"][-1] - reference["q"][-1]).max() < 1e-10


# -- tangents --------------------------------------------------------------------------------------

SCENES = {
    "everything 1": lambda: everything(1),
    "tree": lambda: random_tree(0),
    "moving springs": lambda: zoo(1, moving=True),
    "assembly": lambda: assembly(2),
    "linkage": lambda: linkage().freeze(),
    "ring": lambda: ring().freeze(),
}


def trial(system, seed=0, t=0.35, size=0.2):
    """Random configuration on the tree's constraints, amplitudes with a spin."""
    rng = np.random.default_rng(seed)
    y = system.extend(random_state(system, rng, t, size), t)
    loads = rng.standard_normal(len(system.loading.times))
    motors = np.append(rng.standard_normal(len(system.couplings.times)), 0.0)
    spin = Spin(rng.standard_normal(3), rng.standard_normal(3))
    return rng, y, Amplitudes(loads, motors, spin)


@pytest.mark.one_quick
@pytest.mark.parametrize("scene", SCENES)
def test_tangent_of_the_balance(scene):
    """dR/dy by the complex step, of all rows of y, off the constraints too."""
    system = SCENES[scene]()
    rng, y, amplitudes = trial(system)
    y[: system.rows] += 0.05 * rng.standard_normal((system.rows, 3))
    start = y + 0.01
    found = balance(system, y, amplitudes, start)
    K = blocks_matrix(system, balance_tangent(system, found, amplitudes)).toarray()
    wanted = np.empty_like(K)
    for k in range(system.n):
        z = y.astype(complex)
        z.reshape(-1)[k] += 1j * EPS
        wanted[:, k] = balance(system, z, amplitudes, start).R.ravel().imag / EPS
    assert abs(wanted).max() > 1
    assert abs(K - wanted).max() < 1e-13 * abs(wanted).max()


@pytest.mark.one_quick
@treatments
@pytest.mark.parametrize("scene", ["moving springs", "assembly"])
def test_derivative_by_the_load_factor(scene, treatment):
    """Of residual and configuration, moving ground included, by a formula of sixth order."""
    system = SCENES[scene]()
    schedule = Schedule(system, None, SPIN)
    solver = PathSolver(system, treatment, schedule, STATIC)
    t = 0.35
    y = system.extend(random_state(system, np.random.default_rng(3), t, 0.1), t)
    point = Point(y, t)
    gradient = np.random.default_rng(4).standard_normal((system.rows, 3))
    target = Functional(gradient, 0.3, 0.1)
    problem = Problem(solver.plain, STATIC, point, target)
    problem.residual()
    found, by_t = problem.derivative()
    total, moved = 0.0, 0.0
    for k, c in ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60)):
        for sign in (1, -1):
            end = t + sign * k * 2e-3
            solver.plain.evaluate(end)
            z = solver.plain.y
            total = total + sign * c * solver.plain.residual / 2e-3
            moved = moved + sign * c * z[: system.rows] / 2e-3
    assert abs(found - total).max() < 1e-7 * abs(total).max()
    if system.moving and treatment.name == "null-space":
        assert abs(by_t - moved).max() < 1e-8 * abs(moved).max()


# -- prescribed motion -----------------------------------------------------------------------------


def torsion_bar(turns, driven):
    """A bar twisted at its end, which may shift along x: by the ground, or by a drive."""
    model, end = cantilever(stiff(EI=(50.0, 50.0)), elements=18, order=4)
    if driven:
        disc = model.add("disc", sc.RigidBody.box(1.0, (0.1, 0.1, 0.1), position=(1, 0, 0)))
        pin = model.add("pin", sc.JointRevolute(disc.at((1, 0, 0)), end, axis=(1, 0, 0)))
        guide = sc.JointPrismatic(sc.ground((1, 0, 0)), disc.at((1, 0, 0)), axis=(1, 0, 0))
        model.add("guide", guide)
        model.add("end", sc.JointDrive(pin, lambda t: 2 * np.pi * turns * t))
    else:
        motion = sc.Motion(rotation=lambda t: (2 * np.pi * turns * t, 0, 0))
        model.add("end", sc.JointPrismatic(sc.ground((1, 0, 0), motion), end, axis=(1, 0, 0)))
    return model


@pytest.mark.slow
@pytest.mark.parametrize(
    ("treatment", "driven", "control"),
    [
        (sc.Multipliers(), False, sc.LoadControl(steps=2)),
        (sc.NullSpace(), True, sc.LoadControl(steps=2)),
        (sc.NullSpace(), True, sc.LoadControl()),
    ],
    ids=["ground-2", "drive-2", "drive-auto"],
)
def test_torsion_by_three_turns(treatment, driven, control):
    """Moment GJ phi/L: whole turns are not lost, however long the step asked for."""
    path = sc.static(torsion_bar(3, driven), treatment, control, watch=False)
    wanted = 2.0 * 6 * np.pi
    assert path["joint/end/moment"][-1] == pytest.approx([wanted, 0, 0], rel=1e-6, abs=1e-9)
    if control.steps:
        assert len(path) == 3
        assert path["joint/end/moment"][1, 0] == pytest.approx(wanted / 2, rel=1e-6)
    if driven:
        assert path["joint/pin/angle"][-1] == pytest.approx(6 * np.pi, abs=1e-12)


def gripped(**motion):
    """A rod along x whose end is held by a moving support, and that end."""
    model, end = cantilever()
    model.add("grip", sc.JointSpherical(sc.ground((1, 0, 0), sc.Motion(**motion)), end))
    return model, end


@pytest.mark.slow
@treatments
def test_motion_under_the_other_controls(treatment):
    """The load factor moves the ground there too."""
    model, _ = gripped(displacement=lambda t: (0, -0.6 * t, 0))
    middle = sc.Place(model["rod"], 6, np.array([0.5, 0, 0]), np.zeros(3), np.eye(3))
    by_load, by_arc = (
        sc.static(model, treatment, control)
        for control in (sc.LoadControl(0.5), sc.ArcLength(60, until=0.5))
    )
    control = sc.DisplacementControl(middle, (0, 1, 0), until=float(at(by_load, middle, -1)[1]))
    by_place = sc.static(model, treatment, control)
    for other, tolerance in ((by_arc, 1e-11), (by_place, 1e-9)):
        assert other["load_factor"][-1] == pytest.approx(0.5, abs=1e-9)
        assert abs(other["q"][-1] - by_load["q"][-1]).max() < tolerance


@treatments
def test_mechanism_moved_by_a_drive(treatment):
    """Kinematics alone: nothing has a stiffness."""
    model = four_bar()
    model.add("drive", sc.JointDrive(model["pin 0"], lambda t: 0.4 * t))
    path = sc.static(model, treatment)
    assert path["joint/pin 0/angle"] == pytest.approx(0.4 * path["load_factor"], abs=1e-13)
    assert path["constraint_violation"].max() < 1e-13


# -- several loads, starts, files ------------------------------------------------------------------


def two_loads(amplitude=None):
    model, tip = cantilever()
    model.add("force", sc.LoadForce(tip, (0, 2.0, 1.0), amplitude))
    model.add("weight", sc.LoadGravity((0, 0, -3.0)))
    return model.freeze(), tip


@pytest.mark.slow
@treatments
def test_order_of_loading_does_not_matter(treatment):
    system, _ = two_loads()
    early, late = sc.Table([0, 0.5], [0, 1]), sc.Table([0.5, 1], [0, 1])
    q = sc.static(system, treatment)["q"][-1]
    one = sc.static(system, treatment, factors={"weight": early, "force": late})
    two = sc.static(system, treatment, factors={"weight": late, "force": early})
    half = equilibrium(system, one, len(one) // 2)
    both = sc.static(system, treatment, start=half, factors={"weight": 1, "force": lambda t: 1.0})
    for path in (one, two, both):
        assert abs(path["q"][-1] - q).max() < 1e-12
    assert both["load_factor"][0] == half.load_factor not in (0, 1)


@pytest.mark.slow
def test_start_from_a_moving_state():
    """From within a run in time: the velocity is dropped, the nearest equilibrium sought."""
    system, _ = two_loads()
    run = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-2, until=0.37)
    state = sc.restart(system, run, sc.EnergyMomentum(), 1e-2)
    path = sc.static(system, start=state)
    assert path["load_factor"][0] == pytest.approx(0.37)
    assert abs(path["q"][-1] - sc.static(system)["q"][-1]).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(
    ("treatment", "scheme"),
    [(sc.NullSpace(), sc.Variational()), (sc.Multipliers(), sc.EnergyMomentum())],
)
@pytest.mark.filterwarnings("ignore:argument history.*by its load factor")  # it is meant
def test_end_of_a_path_starts_a_run(treatment, scheme):
    """At rest it stays at rest; restart() gives the same start."""
    system, _ = two_loads(sc.Table([0, 1], [0, 1]))
    path = sc.static(system, treatment, factors={"weight": 1.0})
    for start in (equilibrium(system, path, time=1.0), sc.restart(system, path, scheme, 1e-2)):
        assert start.time == 1.0
        run = sc.simulate(system, scheme, treatment, 1e-2, until=1.5, start=start, derive=False)
        assert len(run) == 51
        assert abs(run["q"] - path["q"][-1]).max() < 1e-10


@pytest.mark.slow
def test_energy_is_the_work_of_the_loads():
    """Stored energy against the trapezoidal sum: second order in the step."""
    system, _ = two_loads()
    errors = []
    for steps in (6, 12, 24):
        path = sc.static(system, control=sc.LoadControl(steps=steps), watch=False)
        errors.append(path["work_loads"][-1] - path["energy"][-1])
        assert path["energy"][-1] == pytest.approx(path["strain_energy"][-1], rel=1e-14)
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert abs(orders - 2).max() < 0.05


def test_path_is_a_history_like_any_other(tmp_path):
    system, _ = two_loads()
    file = tmp_path / "path.history"
    path = sc.static(system, path=file)
    again = sc.History.load(file)
    assert again.meta == path.meta
    assert {"q", "energy", "external", "v"} <= set(again.series) <= set(path.series)
    for name in again.series:
        assert np.array_equal(again[name], path[name]), name
    assert np.array_equal(equilibrium(system, again, 2).q, path["q"][2])
    short = again.truncated(3)
    assert equilibrium(system, short).load_factor == path["load_factor"][2]


# -- critical points -------------------------------------------------------------------------------


def column(EI=(1.0, 1.3), EA=1e6, elements=4):
    """A cantilever pushed at its end; about d1 it bends with EI[0]."""
    model, tip = cantilever(stiff(EA, EI, 1.0), elements=elements)
    model.add("push", sc.LoadForce(tip, (-1.0, 0, 0)))
    return model, tip


CONTROLS = {
    "load": lambda tip: sc.LoadControl(8.0),
    "arc": lambda tip: sc.ArcLength(60, until=8.0, first=0.5),
    "displacement": lambda tip: sc.DisplacementControl(tip, (-1, 0, 0), until=8e-6),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("control", "treatment", "kernels"),
    [
        ("load", sc.Multipliers(), "numpy"),
        pytest.param("arc", sc.NullSpace(), "numba", marks=needs_numba),
        ("displacement", sc.NullSpace(), "numpy"),
    ],
    ids=CONTROLS,
)
def test_buckling_of_a_column_in_all_controls(treatment, kernels, control):
    """``pi^2 EI/4`` about both axes, shortened by P/EA and softened by P/GA, 1e-6 each."""
    model, tip = column()
    path = sc.static(model, treatment, CONTROLS[control](tip), kernels=kernels)
    assert criticals(path) == [("bifurcation", 1)] * 2
    wanted = np.pi**2 / 4 * np.array([1.0, 1.3])
    assert loads_of(path) == pytest.approx(wanted, rel=2e-6)
    for c in path.meta["critical"]:
        assert path["load_factor"][c["state"]] == c["load_factor"]
        assert path["critical"][c["state"]] == 2
    assert int(path["unstable"][-1]) == 2
    for which, axis in enumerate((2, 1)):  # bending about d1, then about d2
        end = abs(sc.branch(model, path, which).direction[4 * tip.vertex])
        assert end[axis] > 10 * end[3 - axis]


@pytest.mark.slow
@pytest.mark.parametrize(("treatment", "mode"), [(sc.NullSpace(), 0), (sc.Multipliers(), 1)])
def test_equal_stiffness_about_both_axes(treatment, mode):
    """Two motions at once; each branch is the plane elastica, turned about the column."""
    model, tip = column(EI=(1.0, 1.0))
    path = sc.static(model, treatment, sc.LoadControl(3.0))
    assert criticals(path) == [("bifurcation", 2)]
    one, two = (sc.branch(model, path, mode=k).direction for k in (mode, 1 - mode))
    sideways = [d[4 * tip.vertex, 1:] for d in (one, two)]
    assert abs(np.linalg.det(sideways)) > 0.1 * np.prod(np.linalg.norm(sideways, axis=1))
    start = sc.branch(model, path, mode=mode)
    side = sc.static(model, treatment, sc.ArcLength(8, length=0.05), start=start)
    assert side.meta["critical"] == []  # the plane of bending is free to turn: no crossing
    where = at(side, tip)
    away = np.linalg.norm(where[:, 1:], axis=1)
    assert abs(where @ np.cross(where[-1], (1.0, 0, 0))).max() < 1e-6 * away[-1]  # in a plane
    assert away[-1] > 0.1
    assert abs(side["load_factor"] - elastica(away)).max() < 1e-5


def elastica(deflection):
    """Load of a unit cantilever by the deflection ``2 k/K(k)`` of its end, P = K(k)^2."""

    def load(w):
        k = brentq(lambda k: 2 * k / ellipk(k**2) - w, 0.0, 0.9) if w > 1e-9 else 0.0
        return ellipk(k**2) ** 2

    return np.array([load(float(w)) for w in deflection])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("treatment", "controlled"), [(sc.NullSpace(), "arc"), (sc.Multipliers(), "displacement")]
)
def test_limit_points_of_a_truss(treatment, controlled):
    """Where ``l^3 = l0``: 4 k z^3 down; and the same up again."""
    model, point = truss()
    control = sc.ArcLength(100, until=20.0, first=0.5)
    if controlled == "displacement":
        control = sc.DisplacementControl(point.place(), (0, 0, -1), until=0.7)
    path = sc.static(model, treatment, control)
    z = np.sqrt(np.hypot(1, 0.3) ** (2 / 3) - 1)
    wanted = 400 * z**3
    assert criticals(path) == [("limit", 1)] * 2
    assert loads_of(path) == pytest.approx([wanted, -wanted], rel=1e-9)
    assert path["unstable"][0] == path["unstable"][-1] == 0
    assert path["unstable"].max() == 1


@pytest.mark.slow
@treatments
def test_twisted_rod_buckles(treatment):
    """Greenhill: both ends clamped, M = 2 * 4.4934 EI/L (tan x = x); the end may come nearer."""
    model, end = cantilever(stiff(1e6, (1.0, 1.0), 2.0), elements=8, order=4)
    motion = sc.Motion(rotation=lambda t: (t, 0, 0))
    model.add("end", sc.JointPrismatic(sc.ground((1, 0, 0), motion), end, axis=(1, 0, 0)))
    path = sc.static(model, treatment, sc.LoadControl(4.8))
    x = brentq(lambda x: np.tan(x) - x, 4.4, 4.6)
    assert [c["kind"] for c in path.meta["critical"]] == ["bifurcation"]
    assert 2 * loads_of(path)[0] == pytest.approx(2 * x, rel=1e-5)


@pytest.mark.one_quick
@ways
def test_follower_force_has_no_static_buckling(treatment, kernels):
    """Beck's column is straight and alone up to its flutter load 20.05 EI/L^2, and beyond."""
    model, tip = cantilever(stiff(1e6, GJ=1.0))
    model.add("thrust", sc.LoadForce(tip, (0, 0, -1.0), follower=True))
    path = sc.static(model, treatment, sc.LoadControl(25.0), kernels=kernels)
    assert path.meta["critical"] == []
    assert not path["unstable"].any()
    assert abs(at(path, tip)[:, 1:]).max() < 1e-12


@pytest.mark.slow
@ways
def test_moment_about_a_fixed_axis_is_not_conservative(treatment, kernels):
    """Its tangent is not symmetric: no critical point on the way to a full circle."""
    model, tip = cantilever(stiff(1e6, GJ=1.0))
    model.add("moment", sc.LoadMoment(tip, (0, 0, 2 * np.pi)))
    path = sc.static(model, treatment, kernels=kernels)
    assert path.meta["critical"] == []


@pytest.mark.slow
@treatments
def test_moment_about_a_hinge_is_conservative(treatment):
    """There the same kind of load has a potential: its limit is found as such."""
    model, _, body = hinged(position=(0, 0, -0.5))
    model.add("weight", sc.LoadGravity((0, 0, -10.0)))
    model.add("moment", sc.LoadMoment(body.at((0, 0, 0)), (0, 6.0, 0)))
    control = sc.ArcLength(24, longest=0.4, first=0.2, length=0.4)
    path = sc.static(model, treatment, control, factors={"weight": 1.0})
    angle, load = path["joint/hinge/angle"], path["load_factor"]
    assert abs(2 * angle + 5 * np.sin(angle) - 6 * load).max() < 1e-11
    first = np.arccos(-0.4)
    assert criticals(path)[:2] == [("limit", 1)] * 2
    wanted = [(2 * a + 5 * np.sin(a)) / 6 for a in (first, 2 * np.pi - first)]
    assert loads_of(path)[:2] == pytest.approx(wanted, rel=1e-9)


def test_unwatched_paths_are_not_looked_at():
    model, _ = column()
    path = sc.static(model, control=sc.LoadControl(4.0), watch=False)
    assert path.meta["critical"] == []
    assert (path["unstable"] == -1).all()


@pytest.mark.slow
def test_large_systems_find_the_same_critical_load():
    """Above 300 unknowns eigenvalues are found by shift and invert."""
    model, _ = column(elements=20)
    path = sc.static(model, control=sc.LoadControl(3.0))
    assert model.freeze().unknowns > 300
    assert loads_of(path) == pytest.approx([np.pi**2 / 4], rel=2e-6)
    one, two = (sc.branch(model, path).direction for _ in range(2))
    assert np.array_equal(one, two)


@pytest.mark.slow
@treatments
def test_branch_with_loads_held(treatment):
    """Part of the load stays: k theta = (m g l/2 + F l) sin(theta)."""
    model, _, body = hinged()
    model.add("weight", sc.LoadGravity((0, 0, -10.0)))
    model.add("push", sc.LoadForce(body.at((0, 0, 1)), (0, 0, -1.0)))
    held = {"factors": {"weight": 0.3}}
    path = sc.static(model, treatment, sc.LoadControl(2.0), **held)
    assert loads_of(path) == pytest.approx([0.5], rel=1e-9)
    assert abs(path["q"] - path["q"][0]).max() < 1e-14  # nothing moves before it buckles
    beyond = path["load_factor"] > 0.5 * (1 + 1e-9)  # a state is where it buckles
    assert path["unstable"].tolist() == beyond.astype(int).tolist()
    ends = []
    for sign in (1, -1):
        start = sc.branch(model, path, sign=sign, **held)
        side = sc.static(model, treatment, sc.ArcLength(10), start=start, **held)
        angle = side["joint/hinge/angle"]
        assert abs(2 * angle - (1.5 + side["load_factor"]) * np.sin(angle)).max() < 1e-12
        assert side.meta["critical"] == []
        ends.append(angle[-1])
    assert ends[0] == pytest.approx(-ends[1], abs=1e-10)
    assert abs(ends[0]) > 0.1
