"""Every scheme that compiled kernels have, against plain numpy: scenes of all kinds, whole runs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers_scenes import four_bar
from helpers_schemes import SCHEMES, compiled
from rounding import limits, nudged
from test_own_items import attraction, drag

import skfem_cosserat as sc

pytest.importorskip("numba")

GROUND, Z = sc.ground((0, 0, 0)), (0, 0, 1)
SECTION = sc.Section((2e4, 2e4, 5e4, 40.0, 60.0, 30.0), mass=1.3, inertia=(2e-3, 3e-3))
NULL, MULTIPLIERS = sc.NullSpace(), sc.Multipliers()
COMPILED = [
    *(scheme for scheme in SCHEMES if compiled(scheme)),
    sc.EnergyDecaying(0.1, velocity=False),
    sc.EnergyDecaying(rate=8.0, velocity=False, stabilized=True),
    sc.Composition(sc.EnergyMomentum()),
]
STEPS = 20


# -- scenes ----------------------------------------------------------------------------------------


def arm(
    theory: sc.Theory | None = None, section: sc.Section = SECTION, planar: bool = False
) -> tuple[sc.Model, sc.Place]:
    """A beam on a hinge, a box on its end, a bob on a rope; what is at the end."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="rod")
    beam = model.add("beam", sc.Beam(mesh, section, director=Z, theory=theory))
    axis = Z if planar else (0.6, 0.0, 0.8)
    model.add("hinge", sc.JointRevolute(GROUND, beam.node("rod.start"), axis))
    box = model.add("box", sc.RigidBody.box(0.5, (0.2, 0.1, 0.1), position=(1.1, 0, 0)))
    weld = sc.JointFixed if planar else sc.JointSpherical
    model.add("weld", weld(beam.node("rod.end"), box.at((1, 0, 0))))
    bob = model.add("bob", sc.MassPoint(0.2, position=(1.1, -0.5, 0)))
    model.add("rope", sc.JointDistance(box.at((1.1, 0, 0)), bob.place()))
    model.add("gravity", sc.LoadGravity((0.3, -9.81, 0.0 if planar else 0.2)))
    return model, box.at((1.2, 0.02, 0))


def tree() -> sc.System:
    model, tip = arm()
    end = model["beam"].node("rod.end")
    model.add("follower", sc.LoadForce(end, (1.0, 2.0, 0.5), sc.Harmonic(1.0, 3.0), follower=True))
    model.add("moment", sc.LoadMoment(tip, (0.3, -0.2, 0.1), lambda t: np.cos(20 * t)))
    return model.freeze()


def plane() -> sc.System:
    model, tip = arm(planar=True)
    model.add("push", sc.LoadForce(tip, (1.0, 2.0, 0.0), sc.Harmonic(1.0, 3.0)))
    return model.freeze(planar=sc.Planar())


def inextensible() -> sc.System:
    return arm(sc.TheoryInextensible())[0].freeze()


def loop() -> sc.System:
    """A four-bar linkage, as it falls, with a beam on its coupler."""
    model = four_bar()
    mesh = sc.MeshCurve.init_line((0, 1, 0), (-0.5, 1, 0.1), 2, name="mast")
    mast = model.add("mast", sc.Beam(mesh, SECTION, director=Z))
    model.add("foot", sc.JointFixed(model["coupler"].at((0, 1, 0)), mast.node("mast.start")))
    model.add("weight", sc.LoadGravity((1.0, -9.81, 0.2)))
    return model.freeze()


def driven_loop() -> sc.System:
    """A motor turns the crank, a spring holds the rocker."""
    model = four_bar()
    model.add("motor", sc.JointDrive(model["pin 0"], lambda t: 6 * t**2 / (1 + t)))
    model.add("spring", sc.JointSpringDamper(model["pin 3"], stiffness=2.0, damping=0.1))
    return model.freeze()


def springs() -> sc.System:
    """And an actuator, and moving ground."""
    model, tip = arm()
    shake = sc.Motion(displacement=lambda t: (0.1 * np.sin(3 * t) ** 2, 0.0, 0.0))
    model.add("coil", sc.JointSpringDamper(model["hinge"], stiffness=5.0, damping=0.2))
    model.add("torque", sc.JointActuator(model["hinge"], sc.FunctionOfTime(np.sin)))
    model.add("strut", sc.SpringDamper(sc.ground((2, 1, 1), shake), tip, 20.0, damping=2.0))
    return model.freeze()


def own_load() -> sc.System:
    model, tip = arm()
    model.add("pull", attraction(sc.ground((1, 1, 0)), tip, 3.0, spring=True))
    model.add("drag", drag(tip, 0.2, sc.Harmonic(1.0, 3.0, np.pi / 3).value))
    return model.freeze()


def viscous() -> sc.System:
    return arm(section=SECTION.damped(time=1e-3))[0].freeze()


def loose() -> sc.System:
    """Two parts that nothing ties to the ground."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="rod")
    beam = model.add("beam", sc.Beam(mesh, SECTION, director=Z))
    box = model.add("box", sc.RigidBody.box(0.5, (0.2, 0.1, 0.1), position=(1.1, 0, 0)))
    model.add("ball", sc.JointSpherical(beam.node("rod.end"), box.at((1, 0, 0))))
    push = sc.LoadForce(beam.node("rod.start"), (10.0, 20.0, 5.0), sc.Harmonic(1.0, 3.0))
    model.add("push", push)
    moving = {"velocity": (1, 2, 0), "angular_velocity": (3, 5, 1)}
    other = sc.RigidBody.box(0.5, (0.2, 0.1, 0.3), position=(3, 0, 0), **moving)
    model.add("other", other)
    bob = model.add("bob", sc.MassPoint(0.2, position=(3, -0.5, 0)))
    model.add("spring", sc.SpringDamper(other.at((3, 0.1, 0)), bob.place(), 30.0, damping=0.2))
    return model.freeze()


TREES = [loose, tree, plane, springs, own_load, viscous]
NULL_SPACE_ONLY = [inextensible, loop, driven_loop]
PAIRS = [(scene, treatment) for scene in TREES for treatment in (NULL, MULTIPLIERS)]
PAIRS += [(scene, NULL) for scene in NULL_SPACE_ONLY]
#: each scheme with each treatment, and each scene with one scheme of each kind in turn
CASES = [(scheme, springs, treatment) for scheme in COMPILED for treatment in (NULL, MULTIPLIERS)]
CASES += [(COMPILED[k % len(COMPILED)], *pair) for k, pair in enumerate(PAIRS)]


# -- the same runs ---------------------------------------------------------------------------------

MOTION = ("q", "p", "constraint_force")
WORKS = ("work_loads", "work_actuators", "work_drives", "dissipated")


def assert_same(compiled: sc.History, plain: sc.History, beside: sc.History | None = None) -> None:
    """Motion and works, to 1e-10 of their sizes; or to what rounding does, as `beside` has it."""
    assert (compiled.meta["kernels"], plain.meta["kernels"]) == ("numba", "numpy")
    assert compiled.times == pytest.approx(plain.times, abs=1e-14)
    works = [name for name in WORKS if name in plain]
    most = max(np.nanmax(abs(plain[name])) for name in (*works, "energy"))
    allowed = {name: 1e-10 * np.nanmax(abs(plain[name])) for name in MOTION}
    allowed |= dict.fromkeys(works, 1e-10 * most)
    if beside is not None:
        rounded = limits(plain, beside, MOTION[1:])
        allowed |= {name: max(allowed[name], limit) for name, limit in rounded.items()}
    for name, limit in allowed.items():
        assert (np.isnan(compiled[name]) == np.isnan(plain[name])).all(), name
        assert np.nanmax(abs(compiled[name] - plain[name]), initial=0.0) <= limit, name
    if "turns" in plain:
        assert compiled["turns"].tolist() == plain["turns"].tolist()


def runs(*run: Any, **options: Any) -> tuple[sc.History, sc.History, sc.History]:
    """Compiled and plain, without kept factors: with the same iterates; and a nudged plain one."""
    own = {"settings": sc.NewtonSettings(reuse=0), "start": sc.initial_state(run[0])} | options
    beside = own | {"start": nudged(own["start"])}
    both = (sc.simulate(*run, kernels=kernels, **own) for kernels in ("numba", "numpy"))
    return *both, sc.simulate(*run, kernels="numpy", **beside)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scheme", "scene", "treatment"), CASES, ids=lambda each: getattr(each, "__name__", repr(each))
)
def test_kernels_agree(scheme, scene, treatment):
    system = scene()
    h = 2e-3
    compiled, plain, beside = runs(system, scheme, treatment, h, STEPS * h)
    assert abs(plain["q"][-1] - plain["q"][0]).max() > 1e-3
    assert_same(compiled, plain, beside)


def test_velocities_are_moved_at_the_instant_that_steps_end():
    """Not at a rounded one: rates of the ground are differences, of another rounding there.

    A damper takes the rates at the end, too.
    """
    model = sc.Model()
    shake = sc.Motion(displacement=lambda t: (0.3 * np.sin(7 * t) ** 2, t * t, 0.0))
    box = model.add("box", sc.RigidBody.box(4.0, (0.3, 0.2, 0.1), position=(0.3, -0.2, 0)))
    model.add("hook", sc.JointSpherical(sc.ground((0, 0, 0), shake), box.at((0, 0, 0))))
    damper = sc.SpringDamper(sc.ground((1, 0, 0), shake), box.at((0.5, 0, 0)), 2.0, damping=0.3)
    model.add("damper", damper)
    model.add("weight", sc.LoadGravity((0.5, -9.81, 0)))
    compiled, plain, beside = runs(model.freeze(), sc.GeneralizedAlpha(0.8), NULL, 0.01, 0.4)
    force = [run["constraint_force"] for run in (compiled, plain, beside)]
    moved = max(abs(force[1] - force[2]).max(), 1e-12 * abs(force[1]).max())
    off = abs(force[0] - force[1]).max()
    assert off < 10 * moved


@pytest.mark.slow
def test_velocities_are_moved_beside_rows_that_are_all_redundant():
    """A strut beside a fixed joint closes a loop whose row depends on the others."""
    model = sc.Model()
    a = model.add("a", sc.RigidBody.box(1.0, (0.1, 0.2, 0.3)))
    b = model.add("b", sc.RigidBody.box(2.0, (0.3, 0.2, 0.1), position=(1, 0, 0)))
    model.add("hook", sc.JointSpherical(GROUND, a.at((0, 0, 0))))
    model.add("weld", sc.JointFixed(a.at((0.5, 0, 0)), b.at((0.5, 0, 0))))
    model.add("strut", sc.JointDistance(a.at((0, 0.1, 0)), b.at((1, 0.1, 0))))
    model.add("weight", sc.LoadGravity((0.5, -9.81, 0.3)))
    assert_same(*runs(model.freeze(), sc.EnergyMomentum(stabilized=True), NULL, 2e-3, 0.04))


@pytest.mark.slow
@pytest.mark.parametrize("theory", [sc.TheoryInextensible(), sc.TheoryKirchhoff()], ids=repr)
def test_velocities_are_moved_where_curved_elements_hold_strains(theory):
    """Their tree does not give the line of such elements, nor its velocities."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    beam = model.add("beam", sc.Beam(mesh, SECTION, director=Z, order=2, theory=theory))
    model.add("hook", sc.JointSpherical(GROUND, beam.node("rod.start")))
    model.add("weight", sc.LoadGravity((0.5, -9.81, 0.3)))
    assert_same(*runs(model.freeze(), sc.EnergyMomentum(stabilized=True), NULL, 2e-3, 0.04))


@pytest.mark.one_quick
@pytest.mark.parametrize("scheme", COMPILED, ids=repr)
def test_works_of_steps_that_are_not_recorded(scheme):
    """Those of blocks of steps, taken in one call: an energy-decaying scheme lost what it took."""
    system = arm()[0].freeze()
    every, seldom = (
        sc.simulate(system, scheme, NULL, 2e-3, 0.04, kernels="numba", every=count)
        for count in (1, 10)
    )
    most = max(abs(every["energy"]).max(), abs(every["external"]).max())
    for name in (*WORKS, "energy_balance"):
        assert seldom[name] == pytest.approx(every[name][::10], abs=1e-10 * most), name


# -- what goes on around a step --------------------------------------------------------------------

ALPHA = [sc.GeneralizedAlpha(0.8), sc.GeneralizedAlpha(0.8, stabilized=False)]
alphas = pytest.mark.parametrize(
    ("scheme", "treatment"), [(ALPHA[0], NULL), (ALPHA[1], MULTIPLIERS)], ids=repr
)


@pytest.mark.slow
@alphas
def test_kernels_agree_in_steps_of_varying_sizes(scheme, treatment):
    """The same steps are chosen: their errors are the same, and what is carried on fits each."""
    control = sc.StepControl(1e-3, first=1e-3)
    compiled, plain, _ = runs(springs(), scheme, treatment, control, 0.04)
    sizes = np.diff(plain.times)
    assert len(plain) > 5 and sizes.max() > 1.1 * sizes.min()
    assert compiled.times == pytest.approx(plain.times, rel=1e-7)
    size = abs(plain["q"]).max()
    assert compiled["q"][-1] == pytest.approx(plain["q"][-1], abs=1e-8 * size)
    lost = max(abs(plain["dissipated"]).max(), abs(plain["energy"]).max())
    assert compiled["dissipated"][-1] == pytest.approx(plain["dissipated"][-1], abs=1e-8 * lost)


@pytest.mark.slow
@alphas
def test_a_restart_goes_on_as_if_nothing_had_been(scheme, treatment):
    """With the memory of the scheme, from kernels of either kind to the other."""
    run = springs(), scheme, treatment, 2e-3
    options = {"settings": sc.NewtonSettings(reuse=0)}
    whole = sc.simulate(*run, 0.04, kernels="numpy", **options)
    for first, second in (("numpy", "numba"), ("numba", "numpy")):
        begun = sc.simulate(*run, 0.02, kernels=first, **options)
        start = sc.restart(run[0], begun, scheme, 2e-3)
        rest = sc.simulate(*run, 0.04, kernels=second, start=start, **options)
        for name in ("q", "p"):
            size = abs(whole[name]).max()
            assert rest[name][-1] == pytest.approx(whole[name][-1], abs=1e-10 * size), name
        assert rest["constraint_force"][0] == pytest.approx(
            whole["constraint_force"][10], abs=1e-7 * np.nanmax(abs(whole["constraint_force"]))
        )


@pytest.mark.slow
@pytest.mark.parametrize(("chi", "treatment"), [(0.1, NULL), (1.0, MULTIPLIERS)], ids=repr)
def test_what_stresses_take_is_counted(chi, treatment, kernels):
    """Beside what dampers take: nothing is left of the energy balance, and it is in `numerical`."""
    system, scheme = tree(), sc.EnergyDecaying(chi, velocity=False)
    history = sc.simulate(system, scheme, treatment, 2e-3, 0.04, kernels=kernels)
    assert history.meta["kernels"] == kernels
    size = abs(history["energy"]).max()
    assert np.nanmax(abs(history["energy_balance"])) < 1e-10 * size
    assert history["dissipated"][-1] > 1e-6 * size
    stepper = sc.Stepper(system, scheme, treatment, 2e-3, kernels=kernels)
    report = stepper.advance(sc.initial_state(system))
    assert report.work.numerical > 0
    assert report.work.numerical == pytest.approx(report.work.dissipated, rel=1e-12)
