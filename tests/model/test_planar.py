"""Scenes confined to a plane: equal to those in space, and what leaves the plane is named."""

from __future__ import annotations

import importlib
import pickle
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers_kernels import assert_same, both, needs_numba
from helpers_scenes import chequered, swing, swing_model
from helpers_scenes import four_bar as bars
from helpers_scenes import rotation as random_rotation
from helpers_schemes import KINDS, compiled
from rounding import limits, nudged
from test_theories import swing as example

import skfem_cosserat as sc
from skfem_cosserat.diagnostics import momentum
from skfem_cosserat.model.plane import confine

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))

#: those whose own steps are compiled, and others: one of each class, and what else differs
BOTH = [sc.EnergyMomentum(), sc.Variational()]
INTEGRATORS = [
    *KINDS,
    sc.EnergyMomentum(stabilized=True),
    sc.GeneralizedAlpha(0.8, stabilized=False),
]
TREATMENTS = [sc.NullSpace(), sc.Multipliers()]
IDENTITY = np.eye(3)
#: turns scenes of the (e1, e2)-plane into any other plane
TURNED = random_rotation(np.random.default_rng(7), 2.0)
SIDEWAYS = IDENTITY[[1, 2, 0]]
PLANES = [IDENTITY, SIDEWAYS, TURNED]
D = (2e4, 2e4, 5e4, 40.0, 60.0, 30.0)


def section(**options: Any) -> sc.Section:
    return sc.Section(D, mass=1.3, inertia=(2e-3, 3e-3), **options)


def difference(a: sc.History, b: sc.History, name: str = "q") -> float:
    return float(abs(a[name] - b[name]).max())


# -- motion ----------------------------------------------------------------------------------------


# a coarse swing is quick: four elements where five could hold the tension
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize(
    ("integrator", "treatment", "kernels"),
    [(i, t, "numpy") for i in INTEGRATORS for t in TREATMENTS]
    + [
        pytest.param(i, t, "numba", marks=needs_numba)
        for i in INTEGRATORS
        for t in TREATMENTS
        if compiled(i)
    ],
    ids=str,
)
def test_swing_moves_as_in_space(integrator: Any, treatment: Any, kernels: str):
    system, plane = swing(4), swing(4)
    confine(plane, sc.Planar())
    assert plane.plane is not None
    assert plane.plane.normal.tolist() == [1, 0, 0]
    a, b = (
        sc.simulate(s, integrator, treatment, 1e-2, 0.1, kernels=kernels) for s in (system, plane)
    )
    assert abs(a["q"][-1] - a["q"][0]).max() > 1e-3
    beside = sc.simulate(
        system, integrator, treatment, 1e-2, 0.1, kernels="numpy",
        start=nudged(sc.initial_state(system)),
    )  # fmt: skip
    rounded = limits(a, beside, ("q", "p", "energy", "constraint_force"))
    for name, size in {"q": 1.0, "p": 100.0, "energy": 1e3, "constraint_force": 1e5}.items():
        assert difference(a, b, name) < max(1e-11 * size, rounded[name]), name
    # the kernels of a plane have other unknowns, and round as constraint forces do
    limit = 1e-8 if kernels == "numpy" else 1e-11 * 1e5
    assert difference(a, b, "joint/left support/force") < limit
    assert (b["q"].reshape(len(b), -1, 3)[:, system.origin_rows, 0] == 0).all()


def test_unknowns_of_the_swing():
    system, plane = swing(), swing()
    confine(plane, sc.Planar())
    assert (system.unknowns, plane.unknowns) == (122, 61)
    bounds = [sc.Multipliers().bind(s, 0.5) for s in (system, plane)]
    # 23 frames: 2 and 2 directors of 2 components, less 3 constraints each; joints take 2 each
    assert [b.unknowns for b in bounds] == [430, 23 * 6 + 23 * 3 + 8]
    assert [b.solver.pattern.shape[0] for b in bounds] == [430, 215]
    assert "215 with multipliers, 61 with the null space" in repr(plane)


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
@pytest.mark.parametrize("integrator", BOTH, ids=str)
def test_swing_is_that_in_space_to_5_s(integrator: Any, treatment: Any, kernels: str):
    system, plane = swing(), swing()
    confine(plane, sc.Planar())
    a, b = (
        sc.simulate(s, integrator, treatment, 1e-2, 5.0, kernels=kernels, derive=False)
        for s in (system, plane)
    )
    assert difference(a, b) < 1e-10
    assert (b["q"].reshape(len(b), -1, 3)[:, system.origin_rows, 0] == 0).all()


def linkage(Q: np.ndarray, roll: float = 0.0, rail: type = sc.JointPrismatic) -> sc.Model:
    """Beam, bodies and mass points on all kinds of joints, with loads and force elements."""
    n, along = Q[:, 2], Q[:, 0]

    def at(x: float, y: float) -> np.ndarray:
        return Q @ (x, y, 0.0)

    model = sc.Model()
    mesh = sc.MeshCurve.init_line(at(0, 0), at(1, 0), 2, name="arm")
    arm = model.add("arm", sc.Beam(mesh, section(), order=2, director=n))
    end = arm.node("arm.end")
    model.add("pin", sc.JointRevolute(sc.ground(at(0, 0)), arm.node("arm.start"), n))
    c, s = np.cos(roll), np.sin(roll)
    triad = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ sc.triad(along, n)
    inertia = {"euler": (0.01, 0.01, 0.2), "center": (0, 0, 0.1)}
    body = model.add("body", sc.RigidBody(2.0, position=at(1.5, 0), triad=triad, **inertia))
    model.add("elbow", sc.JointUniversal(end, body.at(at(1, 0)), n, along))
    slider = model.add("slider", sc.RigidBody.sphere(0.5, 0.1, position=at(1.5, 0.3)))
    model.add("rail", rail(body.at(at(1.5, 0.3)), slider.at(at(1.5, 0.3)), Q @ (0.6, 0.8, 0)))
    bob = model.add("bob", sc.MassPoint(0.7, position=at(2.0, -0.5)))
    model.add("rod", sc.JointDistance(body.at(at(1.8, 0)), bob.place()))
    bead = model.add("bead", sc.MassPoint(0.3, position=at(1.2, 0.0)))
    model.add("wire", sc.JointPointOnLine(body.at(at(1.5, 0)), bead.place(), along))
    model.add("weight", sc.LoadGravity(Q @ (1.0, -9.81, 0)))
    model.add("torque", sc.LoadMoment(end, 3.0 * n, lambda t: np.sin(5 * t)))
    model.add("blow", sc.LoadForce(end, (0, 2.0, 0), follower=True))
    model.add("wind", sc.LoadForce(bob.place(), lambda t: Q @ (t, 1.0, 0)))
    model.add("spring", sc.SpringDamper(sc.ground(at(2, 1)), bob.place(), 20.0, 0.3))
    K = np.diag([100.0, 100.0, 100.0, 5.0, 5.0, 5.0])
    model.add("mount", sc.Bushing(sc.ground(at(1.5, 0.3)), slider.at(at(1.5, 0.3)), K))
    model.add("drag", sc.RayleighDamping(mass=0.1, stiffness=1e-3))
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
    model = linkage(Q, roll, rail)
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


def held_body(coupling: str, Q: np.ndarray) -> sc.Model:
    """A body with oblique directors that spins in a plane, with one force element."""
    n, point = Q[:, 2], Q @ (0.3, 0.1, 0)
    triad = np.array([[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]]) @ Q.T
    model = sc.Model()
    body = model.add("body", sc.RigidBody(1.0, 0.1 * np.eye(3), triad=triad))
    here, there = body.at(point), sc.ground(point)
    if coupling in ("spring", "cable"):
        kind = sc.SpringDamper if coupling == "spring" else sc.Cable
        model.add("spring", kind(sc.ground(2 * point), here, 100.0, 0.1))
    elif coupling == "bushing":
        model.add("mount", sc.Bushing(there, here, 100.0, 0.1))
    else:
        hinge = coupling in ("angle", "torque")
        pin = sc.JointRevolute(there, here, n) if hinge else sc.JointSpherical(there, here)
        pin = model.add("pin", pin)
        if coupling == "torque":
            model.add("motor", sc.JointActuator(pin, 3.0))
        else:
            model.add("spring", sc.JointSpringDamper(pin, 10.0, 0.1))
    model.add("weight", sc.LoadGravity(Q @ (1.0, -9.81, 0)))
    return model


@pytest.mark.one_quick
@chequered(
    "coupling",
    ["spring", "bushing", "angle", "vector", "torque", "cable"],
    "integrator",
    [*INTEGRATORS, sc.Variational(stabilized=True)],
    ids=str,
)
def test_runs_with_force_elements_go_on(coupling: str, integrator: Any):
    """A momentum that constraints take back was said to leave the plane."""
    system = held_body(coupling, TURNED).freeze(planar=sc.Planar(TURNED[:, 2]))
    for treatment in TREATMENTS:
        own = system, integrator, treatment, 2e-2
        whole, half = (sc.simulate(*own, until, derive=False) for until in (0.08, 0.04))
        start = sc.restart(system, half, integrator, 2e-2)
        rest = sc.simulate(*own, 0.08, start=start, derive=False)
        assert abs(whole["q"][-1] - whole["q"][0]).max() > 1e-3
        assert abs(rest["q"][-1] - whole["q"][-1]).max() < 1e-9


def test_momenta_out_of_the_plane_are_refused():
    """A director that moves out of the plane does leave it, whatever holds the triad."""
    system = held_body("bushing", TURNED).freeze(planar=sc.Planar(TURNED[:, 2]))
    rows = np.zeros((system.rows, 3))
    rows[1] = TURNED[:, 2]
    with pytest.raises(sc.InputError, match="momentum leaves the plane"):
        sc.simulate(
            system,
            sc.Variational(),
            sc.NullSpace(),
            0.1,
            0.1,
            start=sc.State(0.0, 0, system.q0, rows.ravel()),
        )


def four_bar(Q: np.ndarray, kinds: tuple[type, ...]) -> sc.Model:
    points = np.array([[0, 0, 0], [0, 0.3, 0], [1.0, 0.8, 0], [1.0, 0, 0]]) @ Q.T
    n = Q[:, 2]
    model, ends = sc.Model(), [sc.ground(points[0])]
    for name, a, b in zip(("crank", "coupler", "rocker"), points, points[1:], strict=False):
        shape = (0.05, 0.08, float(np.linalg.norm(b - a)))
        bar = sc.RigidBody.box(1.0, shape, position=(a + b) / 2, triad=sc.triad(b - a, n))
        ends += [model.add(name, bar).at(a), bar.at(b)]
    ends.append(sc.ground(points[3]))
    for k, (kind, a, b) in enumerate(zip(kinds, ends[::2], ends[1::2], strict=True)):
        axis = () if kind is sc.JointSpherical else (n,)
        model.add(f"pin {k}", kind(a, b, *axis))
    model.add("motor", sc.JointDrive(model["pin 0"], lambda t: 6 * t**2 / (1 + t)))
    model.add("spring", sc.JointSpringDamper(model["pin 3"], stiffness=2.0, damping=0.1))
    model.add("weight", sc.LoadGravity(Q @ (0, -9.81, 0)))
    return model


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
@pytest.mark.parametrize(
    "inner",
    [sc.JointRevolute, sc.JointSpherical, sc.JointCylindrical],
    ids=lambda kind: kind.type,
)
@pytest.mark.parametrize("Q", [IDENTITY, TURNED], ids=["xy", "any"])
def test_driven_closed_loop(Q: np.ndarray, inner: type, treatment: Any):
    """Loops whose joints leave more or less freedom out of the plane are all the same in it."""
    outer = sc.JointRevolute
    model = four_bar(Q, (outer, inner, outer, outer))
    system, plane = model.freeze(), model.freeze(planar=sc.Planar())
    assert plane.unknowns == 0
    a, b = (sc.simulate(s, sc.EnergyMomentum(), treatment, 1e-2, 0.12) for s in (system, plane))
    assert abs(a["joint/pin 3/angle"][-1]) > 0.02
    for name in ("q", "energy", "joint/pin 3/angle", "work_drives"):
        assert difference(a, b, name) < 1e-11, name
    assert difference(a, b, "joint/motor/moment") < 1e-7


@pytest.mark.slow
def test_free_closed_loop_of_spherical_joints():
    """A ball and socket at each end: in space the bars spin as well."""
    model = four_bar(IDENTITY, (sc.JointRevolute, *(sc.JointSpherical,) * 2, sc.JointRevolute))
    model = undriven(model)
    system, plane = model.freeze(), model.freeze(planar=sc.Planar())
    assert (system.unknowns, plane.unknowns) == (2, 1)
    for treatment in TREATMENTS:
        a, b = (sc.simulate(s, sc.Variational(), treatment, 1e-2, 0.12) for s in (system, plane))
        assert difference(a, b) < 1e-11


def undriven(model: sc.Model) -> sc.Model:
    out = sc.Model()
    for name in model:
        if name != "motor":
            item = model[name]
            vars(item).update(name=None)  # in no model any more
            out.add(name, item)
    return out


@pytest.mark.slow
@pytest.mark.parametrize("Q", [IDENTITY, TURNED], ids=["xy", "any"])
@pytest.mark.parametrize(
    ("theory", "unknowns"),
    [(sc.TheoryInextensible(), 7), (sc.TheoryKirchhoff(), 13), (sc.TheoryRigid(), 1)],
)
def test_theories_in_a_plane(theory: Any, unknowns: int, Q: np.ndarray):
    """7 rotations, and 6 stretches; hung on a pin."""
    mesh = sc.MeshCurve.init_line(Q @ (0, 0, 0), Q @ (1.0, 0, 0), 3, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section(), order=2, director=Q[:, 2], theory=theory))
    model.add("pin", sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), Q[:, 2]))
    model.add("weight", sc.LoadGravity(Q @ (0, -9.81, 0)))
    model.add("push", sc.LoadForce(rod.node("rod.end"), Q @ (0, 5.0, 0), lambda t: t))
    system, plane = model.freeze(), model.freeze(planar=sc.Planar())
    assert plane.unknowns == unknowns
    for treatment in TREATMENTS:
        for integrator in BOTH:
            a, b = (sc.simulate(s, integrator, treatment, 1e-2, 0.05) for s in (system, plane))
            assert difference(a, b) < 1e-12
            assert difference(a, b, "beam/rod/resultant") < 1e-7


# -- equilibria and vibrations ---------------------------------------------------------------------


def cantilever(Q: np.ndarray, order: int = 3, elements: int = 4) -> tuple[sc.Model, sc.Beam]:
    mesh = sc.MeshCurve.init_line(Q @ (0, 0, 0), Q @ (1.0, 0, 0), elements, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section(), order=order, director=Q[:, 2]))
    model.add("clamp", sc.JointFixed(sc.ground(Q @ (0, 0, 0)), rod.node("rod.start")))
    return model, rod


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
@pytest.mark.parametrize("Q", PLANES, ids=["xy", "zx", "any"])
def test_roll_up(Q: np.ndarray, treatment: Any):
    """Rolled up to a circle by an end moment 2 pi EI/L; d1 is along the normal."""
    model, rod = cantilever(Q, elements=8)
    moment = 2 * np.pi * D[3] / 1.0
    model.add("moment", sc.LoadMoment(rod.node("rod.end"), moment * Q[:, 2]))
    system, plane = model.freeze(), model.freeze(planar=sc.Planar())
    a, b = (sc.static(s, treatment) for s in (system, plane))
    tip = 12 * rod.node("rod.end").vertex
    assert abs(b["q"][-1, tip : tip + 3]).max() < 1e-4
    assert difference(a, b) < 1e-11
    for name in ("strain_energy", "work_loads", "beam/rod/resultant", "joint/clamp/moment"):
        assert difference(a, b, name) < 1e-8, name
    assert plane.unknowns == system.unknowns / 2


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
def test_what_is_free_out_of_the_plane_only_is_held(treatment: Any):
    """Between ball joints a beam can spin about its line: in space that is refused."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section(), order=2, director=(0, 0, 1)))
    model.add("left", sc.JointSpherical(sc.ground((0, 0, 0)), rod.node("rod.start")))
    slide = sc.JointPointOnLine(sc.ground((1, 0, 0)), rod.node("rod.end"), (1, 0, 0))
    model.add("right", slide)
    model.add("load", sc.LoadForce(rod.node((0.5, 0, 0)), (0, -1e-3, 0)))
    with pytest.raises(sc.InputError, match=r"beam 'rod': can move freely .*about \(1, 0, 0\)"):
        sc.static(model, treatment)
    plane = model.freeze(planar=sc.Planar())
    path = sc.static(plane, treatment)
    sag = path["q"][-1][12 * rod.node((0.5, 0, 0)).vertex :][1]
    exact = -1e-3 * (1 / (48 * D[3]) + 1 / (4 * D[1]))  # F L^3/(48 EI) + F L/(4 GA)
    assert sag == pytest.approx(exact, rel=1e-8)
    hanging = sc.Model()
    bar = sc.RigidBody.box(2.0, (1.0, 0.1, 0.2), position=(0.5, 0, 0))
    hanging.add("bar", bar)
    hanging.add("ball", sc.JointSpherical(sc.ground((0, 0, 0)), bar.at((0, 0, 0))))
    hanging.add("weight", sc.LoadGravity((0, -9.81, 0)))
    with pytest.raises(sc.InputError, match=r"body 'bar': can move freely .*about \(0, 0, 1\)"):
        sc.static(hanging.freeze(planar=sc.Planar()), treatment)


@pytest.mark.parametrize("verb", [sc.static, sc.modes, sc.buckling, sc.simulate])
def test_the_plane_is_asked_for_where_a_scene_is_frozen(verb):
    model, _ = cantilever(IDENTITY, elements=1)
    with pytest.raises(TypeError, match=rf"{verb.__name__}\(\) .* model.freeze\(planar=sc.Planar"):
        verb(model, planar=sc.Planar())


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
def test_elastica_beyond_its_critical_load(treatment: Any):
    """The column's way out of the plane is stiffer: both see the same bifurcation and branch."""
    Q = IDENTITY
    model, rod = cantilever(Q, elements=3)
    model.add("push", sc.LoadForce(rod.node("rod.end"), (-1.0, 0, 0)))
    critical = np.pi**2 * D[3] / 4
    ends = []
    for s in (model.freeze(), model.freeze(planar=sc.Planar())):
        path = sc.static(s, treatment, sc.LoadControl(until=1.05 * critical))
        (point,) = path.meta["critical"]
        assert point["load_factor"] == pytest.approx(critical, rel=6e-3)
        start = sc.branch(s, path)
        bent = sc.static(s, treatment, sc.ArcLength(until=1.2 * critical), start=start)
        tip = 12 * rod.node("rod.end").vertex
        ends.append((point["load_factor"], *abs(bent["q"][-1, tip : tip + 2])))
    assert abs(np.subtract(*ends)).max() < 1e-7 * critical
    assert ends[0][2] > 0.3


@pytest.mark.slow
def test_modes_are_those_in_the_plane():
    """Frequencies in the plane are a subset of all, their shapes have nothing out of it."""
    for Q in (IDENTITY, TURNED):
        model, rod = cantilever(Q)
        model.add("load", sc.LoadForce(rod.node("rod.end"), Q @ (0, 30.0, 0)))
        system, plane = model.freeze(), model.freeze(planar=sc.Planar())
        paths = [sc.static(s) for s in (system, plane)]
        every = sc.modes(system, paths[0], count=24)
        few = sc.modes(plane, paths[1], count=8)
        shapes = every.shapes.reshape(24, -1, 3)
        out = abs(shapes[:, system.origin_rows] @ Q[:, 2]).max(axis=1)
        turns = abs(np.cross(shapes, system.q0.reshape(-1, 3)) @ Q[:, 2]).max(axis=1)
        flat = out < 1e-6 * (abs(shapes).max(axis=(1, 2)))
        torsion = flat & (abs(shapes[:, system.origin_rows]).max(axis=(1, 2)) < 1e-9 * turns)
        inside = every.frequencies[flat & ~torsion]
        assert few.frequencies == pytest.approx(inside[:8], rel=1e-10)
        assert abs(few.shapes.reshape(8, -1, 3) @ Q[:, 2]).max() < 1e-12 * abs(few.shapes).max()


@pytest.mark.slow
def test_spin_about_the_normal():
    model, _ = cantilever(IDENTITY)
    system, plane = model.freeze(), model.freeze(planar=sc.Planar((0, 0, 1.0)))
    spin = sc.Spin((0, 0, 20.0))
    a, b = (sc.static(s, spin=spin) for s in (system, plane))
    assert difference(a, b) < 1e-12
    assert sc.modes(plane, b, count=3).frequencies.min() > 0
    for call in (sc.static, sc.modes):
        with pytest.raises(sc.InputError, match="is off the normal"):
            call(plane, spin=sc.Spin((0, 20.0, 1.0)))


# -- what leaves the plane -------------------------------------------------------------------------


def arm(**options: Any) -> tuple[sc.Model, sc.Beam, sc.RigidBody]:
    """A beam along e1 on a pin, with a body at its end."""
    mesh = options.pop("mesh", None) or sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    given = {"director": (0, 0, 1), "section": section()} | options.pop("beam", {})
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, given.pop("section"), **given))
    inertia = {"euler": (0.01, 0.02, 0.03), "triad": sc.triad((1, 0, 0), (0, 0, 1))}
    end = rod.node("rod.end").position
    body = model.add("tip", sc.RigidBody(1.0, position=end, **inertia | options.pop("body", {})))
    model.add("weld", sc.JointFixed(rod.node("rod.end"), body.at(end)))
    axis = options.pop("axis", (0, 0, 1.0))
    model.add("pin", sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis))
    model.add("weight", sc.LoadGravity(options.pop("gravity", (0, -9.81, 0))))
    assert not options
    return model, rod, body


def product_section() -> sc.Section:
    stiffness = np.diag(D)
    stiffness[3, 4] = stiffness[4, 3] = 3.0
    return sc.Section(stiffness, mass=1.0, inertia=(1e-3, 2e-3))


def tilted() -> tuple[float, float, float]:
    return (0.0, float(np.sin(0.3)), float(np.cos(0.3)))


HELIX = sc.MeshCurve.init_helix((1, 0, 0), (0, 0, 0), (0, 0, 1), 0.4, 0.5, 6, name="rod")
BUILDS: dict[str, tuple[Callable[[], sc.Model], str]] = {
    "section turned": (
        lambda: arm(beam={"director": tilted()})[0],
        "beam 'rod': of its section 'section' the stiffness couples motion in the plane with motion"
        " out of it: the plane's normal is 17.1887 degrees off d1 and d2",
    ),
    "section coupled": (
        lambda: arm(beam={"section": product_section()})[0],
        r"beam 'rod': of its section 'section' the stiffness couples .* M_1 with M_2 = 3 ",
    ),
    "section's centre": (
        lambda: arm(beam={"section": section(centre=(0.01, 0.02))})[0],
        "beam 'rod': of its section 'section' the centre of mass is 0.01 m off the plane",
    ),
    "section's viscosity": (
        lambda: arm(beam={"section": section(viscosity=product_section().stiffness)})[0],
        "beam 'rod': of its section 'section' the viscosity couples",
    ),
    "pre-twist": (
        lambda: arm(beam={"twist": 0.5})[0],
        "beam 'rod': its sections turn about its axis",
    ),
    "inertia": (
        lambda: (
            arm(body={"euler": [[0.01, 0, 0], [0, 0.02, 0.004], [0, 0.004, 0.03]]})[0]
            if False
            else arm(body={"euler": np.diag([0.01, 0.02, 0.03]) + 0.004 * (np.eye(3)[[2, 1, 0]])})[
                0
            ]
        ),
        "rigid body 'tip': its inertia has no principal axis along the normal of the plane:"
        " product of inertia 0.004 ",
    ),
    "centre of mass": (
        lambda: arm(body={"center": (0.05, 0, 0)})[0],
        "rigid body 'tip': its centre of mass is 0.05 m off the plane",
    ),
    "axis": (
        lambda: arm(axis=tilted())[0],
        r"revolute joint 'pin': its axis \[.*\] is 17.1887 degrees off the normal",
    ),
    "gravity": (
        lambda: arm(gravity=(0, -9.0, 0.5))[0],
        r"load 'weight': \[0.0, -9.0, 0.5\] leaves the plane by 0.5",
    ),
    "velocity": (
        lambda: arm(beam={"velocity": (0, 0, 2.0)})[0],
        "beam 'rod': its initial velocity leaves the plane by 2 m/s",
    ),
    "angular velocity": (
        lambda: arm(body={"angular_velocity": (0, 3.0, 1.0)})[0],
        "rigid body 'tip': its initial angular velocity is off the normal by 3 rad/s",
    ),
}


def added(name: str, make: Callable[[sc.Model, sc.Beam, sc.RigidBody], Any]) -> sc.Model:
    model, rod, body = arm()
    model.add(name, make(model, rod, body))
    return model


END = "rod.end"
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
    model = sc.Model()
    mesh = sc.MeshCurve.init_line(Q @ (2, 1, 0), Q @ (3, 1, 0), 2, name="rod")
    rod = model.add("rod", sc.Beam(mesh, section(), director=Q[:, 2]))
    model.add("pin", sc.JointRevolute(sc.ground(Q @ (2, 1, 0)), rod.node("rod.start"), Q[:, 2]))
    system = model.freeze(planar=sc.Planar(Q[:, 2]))
    start = sc.initial_state(system, nu=0.5 * np.ones(system.unknowns))
    plain, compiled = (
        sc.simulate(
            *(system, sc.EnergyMomentum(), sc.NullSpace(), 7e-5, 7e-5 * 100),
            start=start, kernels=kernels, settings=sc.NewtonSettings(reuse=0),
        )
        for kernels in ("numpy", "numba")
    )  # fmt: skip
    drift = [abs(run["energy_balance"]).max() for run in (plain, compiled)]
    assert drift[1] < 40 * drift[0]  # it was 66 times that


@needs_numba
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
def test_kernels_keep_forces_along_directors_out_of_the_plane(treatment: Any):
    """What they give to a momentum was taken for rounding, if it was below 1e-9 of the momentum."""
    system, h = held_body("bushing", TURNED).freeze(planar=sc.Planar(TURNED[:, 2])), 1e-4
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
    kinds = (sc.JointRevolute,) * 3 + (sc.JointSpherical,)
    system = four_bar(TURNED, kinds).freeze(planar=sc.Planar())
    own = system, sc.EnergyMomentum(), treatment, 1e-2, 0.1
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
    make, message = BUILDS[name]
    model = make()
    model.freeze()
    with pytest.raises(sc.InputError, match=message) as caught:
        model.freeze(planar=sc.Planar((0, 0, 1.0)))
    assert "the plane is normal to [0.0, 0.0, 1.0], through the middle" in str(caught.value)
    assert str(caught.value).count("beam 'rod'") < 2
    found = sc.planarity(model, (0, 0, 1.0))
    assert not found
    assert found.planar is None
    assert len(found.out_of_plane) == 1, found


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
    model = sc.Model()
    model.add("rod", sc.Beam(arc, section(), order=2, director=(0, -0.8, 0.6)))
    found = sc.planarity(model)
    assert found
    assert abs(found.plane.normal - (0, 0.8, -0.6)).max() < 1e-12
    assert repr(found) == "<planar, normal [0.0, 0.8, -0.6]>"
    model = sc.Model()
    model.add("rod", sc.Beam(HELIX, section(), director=(0, 0, 1)))
    with pytest.raises(sc.InputError, match=r"beam 'rod': node \d+ at .* m off the plane"):
        model.freeze(planar=sc.Planar())


def test_a_straight_rod_has_the_plane_of_what_acts_on_it():
    for kind, value, normal in (
        (sc.LoadForce, (0, 0, 1.0), [0, 1, 0]),
        (sc.LoadForce, (0, 2.0, 0), [0, 0, 1]),
        (sc.LoadMoment, (0, 1.0, 0), [0, 1, 0]),
    ):
        model, rod = cantilever(IDENTITY)
        model.add("load", kind(rod.node("rod.end"), value))
        assert sc.planarity(model).plane.normal.tolist() == normal
    model, rod = cantilever(IDENTITY)
    for k, value in enumerate([(0, 1.0, 0), (0, 0, 1.0)]):
        model.add(f"load {k}", sc.LoadForce(rod.node("rod.end"), value))
    assert not sc.planarity(model)


@pytest.mark.slow
def test_prescribed_motion_out_of_the_plane():
    """At the start it is refused, later on the run stops with its time."""

    def pendulum(motion: Callable[[float], tuple[float, float, float]]) -> sc.Model:
        model = sc.Model()
        bob = model.add("bob", sc.MassPoint(1.0, position=(1.0, 0, 0)))
        ground = sc.ground((0, 0, 0), sc.Motion(displacement=motion))
        model.add("rod", sc.JointDistance(ground, bob.place()))
        model.add("weight", sc.LoadGravity((0, -9.81, 0)))
        return model

    with pytest.raises(sc.InputError, match=r"ground at .* leaves the plane at t = 0.001 s, by"):
        pendulum(lambda t: (0, 0, 0.1 * t)).freeze(planar=sc.Planar((0, 0, 1.0)))
    late = pendulum(lambda t: (0, 0, 0.1 * max(0.0, t - 0.2))).freeze(planar=sc.Planar())
    with pytest.raises(sc.InputError, match=r"leaves the plane .* at t = 0.2\d* s"):
        sc.simulate(late, sc.EnergyMomentum(), sc.NullSpace(), 0.05, 1.0)
    good = pendulum(lambda t: (0.1 * t**3, t**2, 0))
    a, b = (
        sc.simulate(good.freeze(planar=p), sc.EnergyMomentum(), sc.NullSpace(), 0.02, 0.5)
        for p in (None, sc.Planar())
    )
    assert difference(a, b) < 1e-12


@pytest.mark.parametrize(
    ("name", "leaves"),
    [
        ("d01_flexible_pendulum", None),
        ("d02_right_angle", "load 'force': [0.0, 0.0, 1.0] leaves the plane by 1"),
        ("d03_flying_spaghetti", "load 'moment': [0.0, 0.5, 1.0] is off the normal by 0.5"),
        ("d04_flying_spaghetti_2d", None),
        (
            "d06_fourbar",
            "revolute joint 'C': its axis [0.0, -0.087155743, 0.996194698] is 5 ",
        ),
        ("d07_lateral_buckling", "beam 'link': node 0 at [1.0, 0.0001, 0.0] is "),
        ("d08_rotating_shaft", "its prescribed motion leaves the plane at t = 0.001 s"),
        ("d09_blade_spinup", None),
    ],
)
def test_scenes_of_the_collection(name: str, leaves: str | None):
    problem = importlib.import_module(f"collection.{name}").PROBLEM
    found = sc.planarity(problem.build(None, 2, 1).system)
    assert bool(found) == (leaves is None)
    assert leaves is None or any(leaves in text for text in found.out_of_plane), found


@pytest.mark.slow
def test_slider_crank_of_the_collection():
    """D10: two beams, the crank is turned by a moving ground."""
    problem = importlib.import_module("collection.d10_slider_crank").PROBLEM
    system, plane = (problem.build(None, 2, 2).system for _ in range(2))
    confine(plane, sc.Planar())
    assert (system.unknowns, plane.unknowns) == (47, 24)
    for treatment in TREATMENTS:
        a, b = (sc.simulate(s, sc.EnergyMomentum(), treatment, 1e-2, 0.3) for s in (system, plane))
        assert difference(a, b) < 1e-11
        assert difference(a, b, "joint/motor/moment") < 1e-9 * abs(a["joint/motor/moment"]).max()


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
    q, up = plane.q0, np.array([0, 0, 1.0, *(0,) * 9])
    turn = np.concatenate([np.zeros(3), *np.cross((1.0, 0, 0), np.eye(3))])
    for v in (up, turn):
        with pytest.raises(sc.InputError, match="initial state: the velocity leaves the plane"):
            sc.initial_state(plane, v=v)
        p = momentum(plane, v)
        with pytest.raises(sc.InputError, match="initial state: p leaves the plane"):
            sc.initial_state(plane, p=p)
        moving = sc.State(0.0, 0, q, p)
        with pytest.raises(sc.InputError, match="argument start: its momentum leaves the plane"):
            next(sc.steps(plane, sc.Variational(), sc.NullSpace(), 0.1, moving))
    with pytest.raises(sc.InputError, match=r"initial state: q leaves the plane .* by 0.01 "):
        sc.initial_state(plane, q=q + 0.01 * up)
    away = sc.State(0.0, 0, q + 0.01 * up, 0 * q)
    with pytest.raises(sc.InputError, match="argument start: its configuration leaves the plane"):
        sc.static(plane, start=away)
    with pytest.raises(sc.InputError, match="argument state: its configuration leaves the plane"):
        sc.modes(plane, q + 0.01 * up, count=2)


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
    assert plane.unknowns == model.freeze(planar=sc.Planar()).unknowns
    scheme, step = sc.EnergyMomentum(), 1e-2
    whole = sc.simulate(system, scheme, sc.NullSpace(), step, 0.2)
    first = sc.simulate(plane, scheme, sc.NullSpace(), step, 0.1)
    start = sc.restart(system, first, scheme, step)
    second = sc.simulate(system, scheme, sc.NullSpace(), step, 0.15, start=start)
    start = sc.restart(plane, second, scheme, step)
    third = sc.simulate(plane, scheme, sc.NullSpace(), step, 0.2, start=start)
    assert abs(third["q"][-1] - whole["q"][-1]).max() < 1e-12


# -- compiled kernels ------------------------------------------------------------------------------

KIND = {"variational": BOTH[1], "energy-momentum": BOTH[0]}
HOLD = (sc.TheoryInextensible(), sc.TheoryKirchhoff())


def mechanism(Q: np.ndarray, roll: float = 0.0, order: int = 1, theory: Any = None) -> sc.Model:
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
    model.add("elbow", sc.JointRevolute(end, body.at(at(1, 0)), n))
    slider = model.add("slider", sc.RigidBody.sphere(0.5, 0.1, position=at(1.5, 0.3)))
    rail = sc.JointPrismatic(body.at(at(1.5, 0.3)), slider.at(at(1.5, 0.3)), Q @ (0.6, 0.8, 0))
    model.add("rail", rail)
    bob = model.add("bob", sc.MassPoint(0.7, position=at(2.0, -0.5)))
    model.add("rod", sc.JointDistance(body.at(at(1.8, 0)), bob.place()))
    bead = model.add("bead", sc.MassPoint(0.3, position=at(1.2, 0.0)))
    model.add("wire", sc.JointPointOnLine(body.at(at(1.5, 0)), bead.place(), along))
    model.add("weight", sc.LoadGravity(Q @ (1.0, -9.81, 0)))
    model.add("wind", sc.LoadForce(bob.place(), lambda t: Q @ (t, 1.0, 0)))
    return model


def loop() -> sc.Model:
    """A four-bar linkage whose coupler carries a beam."""
    model = bars()
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
    "swing": partial(swing_model, 4),
}
LOOPS = {"linkage": loop} | {f"swing {theory!r}": partial(stiff_swing, theory) for theory in HOLD}


def started_in_plane(system: sc.System) -> sc.State:
    """In motion, each frame with a twist of the plane."""
    assert system.plane is not None
    rng, y, n = np.random.default_rng(4), system.q0.reshape(-1, 3), system.plane.normal
    v = np.zeros_like(y)
    for r, framed in zip(system.origin_rows, system.is_frame, strict=True):
        v[r] = rng.standard_normal(2) @ system.plane.axes
        if framed:
            v[r + 1 : r + 4] = rng.standard_normal() * np.cross(n, y[r + 1 : r + 4])
    return sc.initial_state(system, v=sc.project(system, system.q0, v.ravel()))


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


@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # large steps
@pytest.mark.slow
@pytest.mark.parametrize("integrator", KIND)
def test_kernels_agree_on_elements_of_higher_order(integrator: str):
    system = mechanism(TURNED, 0.4, 2).freeze(planar=sc.Planar())
    run = both(system, integrator, "null space", 5e-3, 0.1, started_in_plane(system))
    assert_same(*run, iterates=False)


@pytest.mark.slow
@pytest.mark.parametrize("integrator", BOTH, ids=str)
def test_kept_factors_lead_to_the_same_motion(integrator: Any):
    """Turned with the frames, those of children as well."""
    pytest.importorskip("numba")
    system = mechanism(TURNED, 0.4, theory=HOLD[0]).freeze(planar=sc.Planar())
    run = system, integrator, sc.NullSpace(), 1e-3, 0.1
    options = {"start": started_in_plane(system), "kernels": "numba", "derive": False}
    whole, kept = (
        sc.simulate(*run, settings=sc.NewtonSettings(reuse=reuse), **options) for reuse in (0, 4)
    )
    assert kept["q"][-1] == pytest.approx(whole["q"][-1], abs=1e-10)
    assert kept.meta["factorisations"] < 0.7 * whole.meta["factorisations"]


def follow(model: sc.Model) -> sc.LoadForce:
    return sc.LoadForce(model["arm"].node("arm.end"), (0, 2.0, 0), follower=True)


def spring(model: sc.Model) -> sc.SpringDamper:
    return sc.SpringDamper(sc.ground((2, 1, 0)), model["bob"].place(), 20.0)


BESIDE = {
    "follower": follow,
    "drag": lambda model: sc.RayleighDamping(mass=0.1),
    "spring": spring,
    "drive": lambda model: sc.JointDrive(model["pin"], lambda t: 0.5 * t**2),
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
@pytest.mark.parametrize("treatment", TREATMENTS)
def test_grids_of_which_a_solver_takes_a_part(treatment):
    """In a plane, too."""
    pytest.importorskip("numba")
    number = np.arange(16).reshape(4, 4)
    ends = [np.stack(each).reshape(2, -1) for each in ((number[:-1], number[1:]),
            (number[:, :-1], number[:, 1:]))]  # fmt: skip
    points = np.vstack([0.1 * np.argwhere(number >= 0).T, np.zeros(16)])
    mesh = sc.MeshCurve(points, np.hstack(ends), _subdomains={"grid": np.arange(24)}).directed()
    model = sc.Model()
    rubber = sc.SectionCircle(5e-3, sc.Material(5e6, 0.5, 1100))
    beam = model.add("grid", sc.Beam(mesh, rubber, director=(0, 0, 1)))
    for k in range(4):
        model.add(f"clamp {k}", sc.JointFixed(sc.ground(points[:, k]), beam.node(k)))
    model.add("weight", sc.LoadGravity((0.1, -2.0, 0)))
    system = model.freeze(planar=sc.Planar())
    run = system, sc.EnergyMomentum(), treatment, 2e-3, 0.04
    found = [
        sc.simulate(*run, kernels=kernels, solver=solver, derive=False)
        for kernels, solver in (("numpy", None), ("numba", None), ("numba", sc.SolverSuperLU()))
    ]
    assert "superlu" in found[2].meta["solver"]
    for fast in found[1:]:
        assert abs(fast["q"] - found[0]["q"]).max() < 1e-12


def test_a_run_says_which_kernels_and_why():
    pytest.importorskip("numba")
    system = loop().freeze(planar=sc.Planar())
    pair = sc.Variational(), sc.Multipliers(full=True)
    run = sc.simulate(system, *pair, 5e-3, 0.01, derive=False)
    assert run.meta["kernels"] == "numpy"
    assert "the full system of multipliers" in run.meta["kernels_why"]
    with pytest.raises(sc.InputError, match="the full system of multipliers"):
        sc.simulate(system, *pair, 5e-3, 0.01, kernels="numba")


@pytest.mark.parametrize("metre", [1e-6, 1e-3, 1.0, 1e3])
def test_states_are_judged_by_the_size_of_the_scene(metre):
    """The same share of the extent off the plane, whatever the unit of length is."""
    section = sc.SectionCircle(radius=0.01 * metre, material=sc.Material(E=5e6, nu=0.5, rho=1e3))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (metre, 0, 0), 2, name="rod")
    model = sc.Model()
    model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0)))
    system = model.freeze(planar=sc.Planar((0, 0, 1)))
    turning, tip = 2.0 * np.cross((0, 0, 1), system.q0.reshape(-1, 3)), system.origin_rows[-1]

    def started(rise=0.0, speed=0.0):
        q, v = system.q0.reshape(-1, 3).copy(), turning.copy()
        q[tip, 2] += rise * metre
        v[tip, 2] += speed * metre
        sc.initial_state(system, v=v.ravel())
        p = (system.mass @ v).ravel()
        return next(
            sc.steps(
                system, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, sc.State(0.0, 0, q.ravel(), p)
            )
        )

    started(1e-9, 1e-9)
    with pytest.raises(sc.InputError, match="its configuration leaves the plane"):
        started(rise=1e-6)
    with pytest.raises(sc.InputError, match="the velocity leaves the plane"):
        started(speed=1e-6)
