"""Where runs and paths may start: off the constraints is refused, by rates, at an instant."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import cycle

import numpy as np
import pytest
from helpers_scenes import four_bar
from helpers_schemes import SCHEMES
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

import skfem_cosserat as sc
from skfem_cosserat import equilibrium
from skfem_cosserat.diagnostics import (
    angular_momentum,
    linear_momentum,
    momentum,
    section_strain_rates,
)
from skfem_cosserat.diagnostics.stacked import material_stiffness
from skfem_cosserat.integrators import StepOrigin

TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
SECTION = sc.SectionCircle(radius=0.02, material=sc.Material(E=2e5, nu=0.5, rho=1100))
THEORIES = {
    "inextensible": sc.TheoryInextensible(),
    "unshearable": sc.TheoryKirchhoff(),
    "rigid": sc.TheoryRigid(),
}


def hinged(item, place, angle=0.0):
    """An item on a hinge, which may be driven."""
    model = sc.Model()
    structure = model.add("link", item)
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), place(structure), axis=(0, 1, 0))
    model.add("pin", hinge)
    model.add("gravity", sc.LoadGravity((0, 0, -10.0)))
    if angle:
        model.add("drive", sc.JointDrive(hinge, lambda t: angle * t))
    return model.freeze()


def beam(**more):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    return sc.Beam(mesh, SECTION, director=(0, 1, 0), **more)


@cache
def scene(name):
    if name == "body":
        box = sc.RigidBody.box(2.0, (1, 0.1, 0.1), position=(0.5, 0, 0))
        return hinged(box, lambda link: link.local((-0.5, 0, 0)))
    more = {} if name == "beam" else {"theory": THEORIES[name]}
    return hinged(beam(**more), lambda link: link.node("rod.start"))


NAMES = ["body", "beam", *THEORIES]


def moving(system):
    """Turning about the hinge."""
    return sc.initial_state(system, rates={"pin": 0.5})


def shifted(system, by):
    """Velocities that pull all off the hinge."""
    v = np.zeros((system.rows, 3))
    v[system.origin_rows] = by
    return v.ravel()


# what a wrong momentum adds to the first multipliers is a tension of beams without extension
@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize("treatment", TREATMENTS)
@pytest.mark.parametrize("name", NAMES)
def test_momenta_off_the_hidden_constraints_are_told(name, treatment):
    system = scene(name)
    good = moving(system)
    off = momentum(system, shifted(system, (0.3, 0, 0)))
    bad = replace(good, p=good.p + off)
    run = system, sc.Variational(), TREATMENTS[treatment], 1e-3
    quick = {"kernels": "numpy", "derive": False}
    miss = abs(sc.Projection(system)(bad.q, bad.p)[1] - bad.p).max()
    words = rf"argument start: p at t = 0 s violates the hidden constraints by {miss:.3g} kg m/s"
    words += r" at .* 'link'.*: project it with Projection\(system\)\(q, p, t\)\[1\].*restart"
    with pytest.warns(sc.ModelWarning, match=words.replace("+", r"\+")):
        sc.simulate(*run, 2e-3, start=bad, **quick)
    # what the message says helps
    mended = replace(bad, p=sc.Projection(system)(bad.q, bad.p, bad.time)[1])
    for start in (good, mended):
        history = sc.simulate(*run, 2e-3, start=start, **quick)
        assert len(history) == 3 and history.meta["warnings"] == []


@pytest.mark.parametrize("name", ["body", "beam", "rigid"])
def test_configurations_off_the_constraints_are_refused(name):
    system = scene(name)
    q = system.q0 + shifted(system, (0, 0, 0.01))
    bad = sc.State(0.0, 0, q, np.zeros(system.n))
    words = r"argument start: q at t = 0 s violates .* revolute joint 'pin' by 0\.01"
    for start in (bad, replace(bad, made_by=StepOrigin("variational", 1e-3))):
        with pytest.raises(sc.InputError, match=words):
            sc.simulate(system, sc.Variational(), sc.NullSpace(), 1e-3, 2e-3, start=start)
    bent = system.q0.copy()
    bent[3:6] *= 1.1
    with pytest.raises(sc.InputError, match=r"constraint of the triad of .* 'link' by 0\.105"):
        next(sc.steps(system, sc.Variational(), sc.NullSpace(), 1e-3, replace(bad, q=bent)))


# two soft elements are drawn somewhat farther than such ones can be
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize(
    ("scheme", "treatment"), list(zip(SCHEMES, cycle(TREATMENTS.values()))), ids=repr
)
def test_states_of_runs_are_accepted(scheme, treatment):
    """Whatever their momenta are: those of the variational scheme are off by O(h)."""
    quick = {"kernels": "numpy", "derive": False}
    for system in (scene("beam"), four_bar().freeze()):
        start = moving(system) if system is scene("beam") else None
        run = system, scheme, treatment, 2e-2
        state = next(sc.steps(*run, start, kernels="numpy")).state
        for other in (sc.EnergyMomentum(), scheme):
            on = system, other, treatment, 2e-2
            assert sc.simulate(*on, 0.04, start=state, **quick).times[-1] == 0.04
        history = sc.simulate(*run, 0.04, start=start, **quick)
        for other, h in ((scheme, 2e-2), (scheme, 1e-2), (sc.Variational(), 2e-2)):
            on = system, other, treatment, h
            again = sc.restart(system, history, other, h)
            assert sc.simulate(*on, 0.06, start=again, **quick).times[-1] == pytest.approx(0.06)


def test_what_is_driven_has_to_move():
    """A state at rest is told of; an equilibrium as a start moves with the drive."""
    box = sc.RigidBody.box(2.0, (1, 0.1, 0.1), position=(0.5, 0, 0))
    system = hinged(box, lambda link: link.local((-0.5, 0, 0)), angle=0.5)
    run = system, sc.EnergyMomentum(), sc.NullSpace(), 1e-2, 0.02
    rest = sc.State(0.0, 0, system.q0, np.zeros(system.n))
    with pytest.warns(sc.ModelWarning, match=r"p at t = 0 s violates the hidden .* by 0\.5"):
        sc.simulate(*run, start=rest)
    fixed = sc.initial_state(system, v=sc.project(system, system.q0))
    assert len(sc.simulate(*run, start=fixed)) == 3
    path = sc.static(system, sc.NullSpace(), sc.LoadControl(steps=2))
    start = equilibrium(system, path, time=1.0)
    v = sc.project(system, start.q, t=start.time)
    assert start.p == pytest.approx(momentum(system, v), abs=1e-9)
    sc.simulate(*run[:-1], start.time + 0.02, start=start)


def test_states_that_actions_give_are_looked_at():
    system = scene("body")
    off = momentum(system, shifted(system, (0.3, 0, 0)))

    def kick(time, view):
        return sc.State(time, 0, view.state.q, off)

    event = sc.Event(sc.ConditionTime(0.02), sc.ActionFunction(kick), name="kick")
    run = system, sc.Variational(), sc.NullSpace(), 0.01, 0.05
    words = r"action: its state: p at t = 0\.02 s violates the hidden constraints"
    with pytest.warns(sc.ModelWarning, match=words):
        history = sc.simulate(*run, events=[event])
    (notice,) = history.meta["warnings"]
    assert notice["category"] == "ModelWarning" and notice["item"].endswith("its state")


# -- rates of joints take along what hangs on them -------------------------------------------------


def bar(model, name, a, b, order=2, elements=2):
    """A flexible beam from a to b, its ends."""
    section = sc.Section([2e4, 1e4, 4e4, 5, 8, 6], mass=1.0, inertia=(1e-2, 2e-2))
    mesh = sc.MeshCurve.init_line(a, b, elements, name=name)
    director = (0, 0, 1) if name != "mast" else (1, 0, 0)
    item = model.add(name, sc.Beam(mesh, section, order=order, director=director))
    return item.node(f"{name}.start"), item.node(f"{name}.end")


def worst_strain_rate(system, state):
    v = sc.View(system, state).v
    beams = [item for item in system.structures if isinstance(item, sc.Beam)]
    return max(abs(section_strain_rates(system, b, state.q, v)).max() for b in beams)


def rotor(motion=None, bearing=sc.JointRevolute):
    """A hub with three flexible blades on the flexible mast of a base, which may move."""
    model = sc.Model()
    foot, top = bar(model, "mast", (0, 0, 0), (0, 0, 1))
    model.add("base", sc.JointFixed(sc.ground((0, 0, 0), motion), foot))
    hub = model.add("hub", sc.RigidBody.sphere(2.0, radius=0.1, position=(0, 0, 1)))
    model.add("bearing", bearing(top, hub.at((0, 0, 1)), axis=(0, 0, 1)))
    tips = []
    for k, angle in enumerate((0.1, 2.2, 4.3)):
        way, centre = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([0, 0, 1.0])
        root, tip = bar(model, f"blade {k}", centre + 0.1 * way, centre + way)
        model.add(f"root {k}", sc.JointFixed(hub.at(centre + 0.1 * way), root))
        tips.append(tip)
    return model, tips


def test_blades_turn_with_their_hub():
    """A joint whose side a is no ground; it turned the hub alone."""
    model, tips = rotor()
    system = model.freeze()
    start = sc.initial_state(system, rates={"bearing": 1.2})
    view = sc.View(system, start)
    assert view.rate(model["bearing"]) == pytest.approx(1.2, rel=1e-12)
    for tip in tips:
        assert np.linalg.norm(view.velocity(tip)) == pytest.approx(1.2, rel=1e-11)
        assert view.velocity(tip) @ (tip.position - [0, 0, 1]) == pytest.approx(0, abs=1e-11)
    mast = model["mast"].node("mast.end")
    assert abs(view.velocity(mast)).max() < 1e-11
    assert worst_strain_rate(system, start) < 1e-11


def test_rates_on_moving_ground_and_of_two_coordinates():
    """The base moves and turns with all it carries; turn and shift of one joint, given or not."""
    motion = sc.Motion(
        displacement=lambda t: (0.5 * t, 0, 0.25 * t), rotation=lambda t: (0, 0, 0.75 * t)
    )
    model, tips = rotor(motion, sc.JointCylindrical)
    system = model.freeze()
    for shift in (0.0, -2.0):
        rates = {"bearing/angle": 1.5, "bearing/displacement": shift}
        start = sc.initial_state(system, rates=rates)
        view = sc.View(system, start)
        for tip in tips:
            arm = tip.position
            expected = [0.5 - 2.25 * arm[1], 2.25 * arm[0], 0.25 + shift]
            assert abs(view.velocity(tip) - expected).max() < 1e-7
        assert worst_strain_rate(system, start) < 1e-6


CORNERS = np.array([[0, 0, 0], [0, 0.3, 0], [1, 0.8, 0], [1, 0, 0.0]])


def linkage(last=sc.JointRevolute, elements=2):
    """Three beams in a loop with the ground."""
    model, ends = sc.Model(), [sc.ground(CORNERS[0])]
    for name, a, b in zip("abc", CORNERS, CORNERS[1:], strict=False):
        ends += bar(model, name, a, b, elements=elements)
    ends.append(sc.ground(CORNERS[3]))
    for k, kind in enumerate((*[sc.JointRevolute] * 3, last)):
        options = {"axis": (0, 0, 1)} if kind is sc.JointRevolute else {}
        model.add(f"pin {k}", kind(*ends[2 * k : 2 * k + 2], **options))
    return model


@pytest.mark.parametrize("planar", [None, sc.Planar()], ids=["space", "plane"])
def test_closed_loops_of_beams_start_as_rigid_ones(planar):
    """The velocity of the last corner vanishes: ``sum_k w_k e_z x (x_k+1 - x_k) = 0``."""
    model = linkage()
    system = model.freeze(planar=planar)
    start = sc.initial_state(system, rates={"pin 0": 2.0})
    assert worst_strain_rate(system, start) < 1e-10
    across = np.cross((0, 0, 1.0), np.diff(CORNERS, axis=0))[:, :2]
    spins = [2.0, *np.linalg.solve(across[1:].T, -2.0 * across[0])]
    rates = [sc.View(system, start).rate(model[f"pin {k}"]) for k in range(4)]
    assert rates == pytest.approx(np.diff([0.0, *spins, 0.0]), rel=1e-11)


def test_a_loop_that_has_to_bend_says_so():
    """Of all velocities with the rate that with the least strain rates, in their energy."""
    system = linkage(last=sc.JointFixed).freeze()
    with pytest.warns(sc.ModelWarning, match=r"'pin 0'.*beam 'a'.*beam 'c'.* strain rates up to"):
        start = sc.initial_state(system, rates={"pin 0": 2.0})
    v = sc.View(system, start).v
    P = system.null_space(system.q0)
    y = system.extend(system.q0, 0.0)
    slope = rates_of_pin(system, P)
    free = P @ null_space(slope[None])
    force = material_stiffness(system, y) @ v
    assert abs(free.T @ force).max() < 1e-9 * abs(force).max()
    assert slope @ np.linalg.lstsq(P, v, rcond=None)[0] == pytest.approx(2.0, rel=1e-10)


def test_supports_that_bend_a_beam_on_their_way_say_so():
    """Only what they bend lags: the pendulum beside it turns as a rigid one."""
    lift = sc.Motion(displacement=lambda t: (0, 0.1 * t, 0))
    model = sc.Model()
    left, right = bar(model, "girder", (0, 0, 0), (1, 0, 0))
    model.add("left", sc.JointFixed(sc.ground((0, 0, 0)), left))
    model.add("right", sc.JointFixed(sc.ground((1, 0, 0), lift), right))
    top, bottom = bar(model, "pendulum", (2, 0, 0), (2, -1, 0))
    model.add("pin", sc.JointRevolute(sc.ground((2, 0, 0)), top, axis=(0, 0, 1)))
    system = model.freeze()
    with pytest.warns(sc.ModelWarning, match=r"so beam 'girder' start with strain rates") as said:
        start = sc.initial_state(system, rates={"pin": 2.0})
    assert "pendulum" not in str(said[0].message)
    view = sc.View(system, start)
    assert view.velocity(bottom) == pytest.approx([2.0, 0, 0], abs=1e-9)
    assert view.velocity(right) == pytest.approx([0, 0.1, 0], abs=1e-8)


def rates_of_pin(system, P):
    """Rate of the joint at the ground with each column of P."""
    pin = next(j for j in system.joints if j.name == "pin 0")
    out = []
    for column in P.T:
        state = sc.State(0.0, 0, system.q0, momentum(system, column))
        out.append(sc.View(system, state).rate(pin))
    return np.array(out)


def test_several_rates_and_beams_on_both_sides():
    """In free flight; a branch whose rate is not given moves as little as that allows."""
    model = sc.Model()
    ends = [bar(model, name, (k, 0, 0), (k + 1, 0, 0)) for k, name in enumerate("abcd")]
    for k in range(3):
        hinge = sc.JointRevolute(ends[k][1], ends[k + 1][0], axis=(0, 0, 1))
        model.add(f"hinge {k}", hinge)
    system = model.freeze()
    rates = {"hinge 0": 1.0, "hinge 2": -2.0}
    start = sc.initial_state(system, rates=rates)
    view = sc.View(system, start)
    for name, rate in rates.items():
        assert view.rate(model[name]) == pytest.approx(rate, rel=1e-11)
    assert worst_strain_rate(system, start) < 1e-10
    # any rigid motion would add to the kinetic energy
    assert abs(linear_momentum(system, start.p)).max() < 1e-11
    assert abs(angular_momentum(system, start.q, start.p)).max() < 1e-11


@pytest.mark.slow
def test_rates_add_to_a_velocity_without_straining_more():
    """About a bent state in space, turned anyhow: as seen from there."""
    model, tips = rotor()
    model.add("push", sc.LoadForce(tips[0], (0, 1.0, 2.0)))
    model.add("spring", sc.JointSpringDamper(model["bearing"], stiffness=2.0))
    system = model.freeze()
    bent = equilibrium(system, sc.static(system, kernels="numpy", watch=False))
    rng = np.random.default_rng(1)
    v = sc.project(system, bent.q, rng.standard_normal(system.n))
    faster = sc.project(system, bent.q, v, rates={"bearing": 5.0})
    beams = [item for item in system.structures if isinstance(item, sc.Beam)]
    for each in beams:
        rates = [section_strain_rates(system, each, bent.q, w) for w in (v, faster)]
        assert abs(rates[1] - rates[0]).max() < 1e-11 * abs(rates[0]).max()
    state = sc.initial_state(system, q=bent.q, rates={"bearing": 5.0})
    assert worst_strain_rate(system, state) < 1e-10


# -- equilibria at an instant ----------------------------------------------------------------------


def rod(*loads, motion=None):
    """A clamped rod; what acts at its end: (name, force, amplitude)."""
    model = sc.Model()
    start, end = bar(model, "rod", (0, 0, 0), (1, 0, 0))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0), motion), start))
    for name, force, amplitude in loads:
        model.add(name, sc.LoadForce(end, force, amplitude))
    return model


QUICK = {"kernels": "numpy", "watch": False}
WEIGHT = ("weight", (0, 0, -1.0), None)


@pytest.mark.slow
def test_a_run_from_an_equilibrium_begins_at_zero():
    """A pulse between 0 and 0.2 s was over before the run had begun."""
    pulse = ("pulse", (0, 1.0, 0), sc.Table([0, 0.1, 0.2], [0, 1, 0]))
    model = rod(WEIGHT, pulse)
    for path in (sc.static(rod(WEIGHT), **QUICK), sc.static(model, **QUICK)):
        start = equilibrium(model, path)
        assert (start.time, start.load_factor) == (0.0, 1.0)
        history = sc.simulate(
            model.freeze(), sc.EnergyMomentum(), sc.NullSpace(), 0.01, 0.2, start=start
        )
        assert history["kinetic"].max() > 1e-3
    # a path goes on from the load factor of the point all the same
    on = sc.static(model, control=sc.LoadControl(2.0, steps=1), start=start, **QUICK)
    assert on["load_factor"].tolist() == [1.0, 2.0]


def test_loads_that_a_path_moved_in_time_are_asked_for_their_instant():
    model = rod(WEIGHT, ("wind", (0, 3.0, 0), lambda t: 1 - 0.5 * t))
    path = sc.static(model, **QUICK)
    with pytest.raises(
        sc.InputError, match=r"at 0\.0 s the load 'wind' is out of balance by 1\.5 N"
    ) as e:
        equilibrium(model, path)
    assert "time=1.0, the load factor of this point" in str(e.value)
    assert equilibrium(model, path, time=1.0).time == 1.0
    with pytest.raises(sc.InputError, match=r"'wind' .* starts at time=0\.[0-9]+"):
        equilibrium(model, path, 1, time=1.0)
    # not loads that the path left out, nor those of other models: they act in full at once
    assert equilibrium(model, sc.static(model, factors={"wind": 0.0}, **QUICK)).time == 0.0
    assert equilibrium(model, sc.static(rod(WEIGHT), **QUICK)).time == 0.0
    for value in (np.nan, "late", None, True):
        with pytest.raises(sc.InputError, match="argument time"):
            equilibrium(model, path, time=value)


def lifted():
    """On a support that moves."""
    return rod(WEIGHT, motion=sc.Motion(displacement=lambda t: (0, 0, 0.1 * t)))


def turned_by_a_motor():
    """Against a spring."""
    model = sc.Model()
    start, _ = bar(model, "rod", (0, 0, 0), (1, 0, 0))
    hinge = model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), start, axis=(0, 1, 0)))
    model.add("spring", sc.JointSpringDamper(hinge, stiffness=5.0))
    model.add("motor", sc.JointActuator(hinge, lambda t: 0.5 * t))
    return model


def pulled_by_a_spring():
    """No constraint is broken, but the spring on moving ground pulls."""
    model = rod()
    far = sc.ground((1, 0, 1), sc.Motion(displacement=lambda t: (0, 0, 0.5 * t)))
    end = model["rod"].node("rod.end")
    model.add("spring", sc.SpringDamper(far, end, stiffness=3.0, length=1.0))
    return model


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lifted, r"joint 'clamp' by 0\.1: .*time=1\.0, the load factor"),
        (turned_by_a_motor, r"'motor' is out of balance by 0\.5 N"),
        (pulled_by_a_spring, r"springs hold on moving ground is out of balance by 1\.5"),
    ],
)
def test_what_a_path_moved_is_asked_for_its_instant(make, words):
    model = make()
    path = sc.static(model, **QUICK)
    with pytest.raises(sc.InputError, match=words):
        equilibrium(model, path)
    start = equilibrium(model, path, time=1.0)
    assert start.time == 1.0 and start.p.any() == (make is lifted)  # what is driven moves


# -- paths that hold an instant --------------------------------------------------------------------


CONTROLS = {
    "load": lambda end: sc.LoadControl(steps=2),
    "displacement": lambda end: sc.DisplacementControl(end, (0, 0, -1), 0.05),
    "arc length": lambda end: sc.ArcLength(3),
}


@pytest.mark.one_quick
@pytest.mark.parametrize(("control", "treatment"), list(zip(CONTROLS, cycle(TREATMENTS))))
def test_functions_of_time_stand_still_while_loads_grow(control, treatment):
    model = rod(WEIGHT, ("wind", (0, 2.0, 0), lambda t: 1 - 0.5 * t))
    start, _ = bar(model, "crank", (0, 1, 0), (0.5, 1, 0))
    hinge = model.add("hinge", sc.JointRevolute(sc.ground((0, 1, 0)), start, axis=(0, 0, 1)))
    model.add("drive", sc.JointDrive(hinge, lambda t: 0.4 * t))
    model.add("more", sc.LoadForce(model["crank"].node("crank.end"), (0, 0, -1)))
    end, system = model["rod"].node("rod.end"), model.freeze()
    choice = CONTROLS[control](end)
    path = sc.static(system, TREATMENTS[treatment], choice, time=0.0, watch=False)
    assert path["load_factor"][0] == 0 and len(np.unique(path["load_factor"])) == len(path) > 1
    assert path.meta["time"] == 0.0 and not path.instants.any()
    assert (path["amplitudes/loads"][:, 1] == 1.0).all()
    assert (path["amplitudes/loads"][:, 0] == path["load_factor"]).all()
    assert abs(path["joint/hinge/angle"]).max() < 1e-14
    state = equilibrium(system, path)
    assert (state.time, state.load_factor) == (0.0, path["load_factor"][-1])
    with pytest.raises(sc.InputError, match=r"time=0\.0, the instant the path holds"):
        equilibrium(system, path, time=0.5)


@pytest.mark.one_quick
@pytest.mark.parametrize("treatment", TREATMENTS)
def test_an_equilibrium_of_a_held_instant_stays_at_rest(treatment):
    """A load and a support that stand still from there on."""
    lift = sc.Motion(displacement=lambda t: (0, 0, 0.1 * min(t, 0.5)))
    wind = ("wind", (0, 2.0, 0), lambda t: 1 + min(t, 0.5))
    model = rod(WEIGHT, wind, motion=lift)
    system, chosen = model.freeze(), TREATMENTS[treatment]
    with pytest.raises(sc.InputError, match=r"time = 0\.5 s, it violates .*joint 'clamp'"):
        sc.static(system, chosen, time=0.5)
    there = sc.static(
        system, chosen, sc.LoadControl(0.5), factors={"weight": 0.0, "wind": 0.0}, **QUICK
    )
    raised = sc.initial_state(system, there["q"][-1], time=0.5, rates={})
    path = sc.static(system, chosen, time=0.5, start=raised, watch=False)
    assert (path["amplitudes/loads"][:, 1] == 1.5).all()
    state = replace(equilibrium(system, path, time=0.5), p=np.zeros(system.n))
    again = sc.restart(system, path, sc.EnergyMomentum(), 0.01)
    assert (again.time, again.load_factor) == (0.5, 1.0)
    after = replace(state, time=0.51)  # past the kink of both functions
    run = sc.simulate(system, sc.EnergyMomentum(), chosen, 0.01, 0.61, start=after)
    assert abs(run["q"] - path["q"][-1]).max() < 1e-9


def test_what_makes_no_sense_with_a_held_instant():
    model = rod(WEIGHT, ("wind", (0, 2.0, 0), lambda t: 1 + t))
    end = model["rod"].node("rod.end")
    for value in (np.nan, "late", True):
        with pytest.raises(sc.InputError, match="argument time"):
            sc.static(model, time=value)
    late = equilibrium(model, sc.static(model, time=0.25, **QUICK), time=0.25)
    for time in (0.0, 1.0):
        with pytest.raises(sc.InputError, match=r"argument start: its time is 0\.25 s"):
            sc.static(model, time=time, start=late)
    held = {"time": 0.0, "factors": {"weight": 1.0}}
    for control in (sc.ArcLength(), sc.DisplacementControl(end, (0, 1, 0), 0.1)):
        with pytest.raises(sc.InputError, match="nothing grows with the load factor"):
            sc.static(model, control=control, **held)
    assert len(sc.static(model, control=sc.LoadControl(steps=1), **held, **QUICK)) == 2
    # factors go on by the load factor
    grown = sc.static(model, time=0.5, factors={"wind": lambda x: x}, **QUICK)
    assert grown["amplitudes/loads"][[0, -1], 1].tolist() == [0.0, 1.5]


def test_displacements_that_a_held_drive_holds_are_refused():
    model = rod(WEIGHT, motion=sc.Motion(displacement=lambda t: (0, 0, 0.1 * t)))
    held = sc.DisplacementControl(model["rod"].node("rod.start"), (0, 0, 1), 0.1)
    with pytest.raises(sc.InputError, match="joints hold"):
        sc.static(model, control=held, time=0.0)


@pytest.mark.slow
def test_branches_know_the_instant_of_their_path():
    model = rod(("push", (-1.0, 0, 0), None), ("pull", (1.0, 0, 0), lambda t: 1 + t))
    path = sc.static(model, control=sc.LoadControl(20.0), time=0.5, kernels="numpy")
    leads = sc.branch(model, path)
    with pytest.raises(sc.InputError, match=r"argument time: None, the Branch .* 0\.5"):
        sc.static(model, control=sc.ArcLength(2), start=leads)
    on = sc.static(model, control=sc.ArcLength(2), start=leads, time=0.5, **QUICK)
    assert (on["amplitudes/loads"][:, 1] == 1.5).all()


# -- runs without a step ---------------------------------------------------------------------------


@pytest.mark.parametrize("more", ["steps", "events", "control"])
def test_runs_without_a_step_are_refused(more):
    """They returned one state, and called it completed."""
    system = scene("body")
    step = sc.StepControl(1e-3) if more == "control" else 0.1
    run = system, sc.EnergyMomentum(), sc.NullSpace(), step
    options = {"derive": False, "events": [] if more == "events" else None}
    start = replace(sc.initial_state(system), time=1.0)
    for until in (1.0, 0.5):
        with pytest.raises(sc.InputError, match=rf"argument until: {until} s, expected .*1\.0 s"):
            sc.simulate(*run, until, start=start, **options)
    if more == "steps":
        with pytest.raises(
            sc.InputError, match=r"argument step: 0\.1 s is longer than the run, 0\.05"
        ):
            sc.simulate(*run, 1.05, start=start, **options)
    else:  # they end where they are to end, by a shorter step
        assert sc.simulate(*run, 1.05, start=start, **options).times[-1] == pytest.approx(1.05)


# -- another branch --------------------------------------------------------------------------------


class JointOwnWeld(sc.JointFixed):
    """Of a user, who writes rows and freedom only."""

    type = "own weld"


def two_bars(joint, **options):
    """A bar on a hinge of the ground, and one that a joint holds to its end."""
    model = sc.Model()
    bars = [
        model.add(name, sc.RigidBody.box(1.0, (0.1, 0.2, 0.3), position=(x, 0, 0)))
        for name, x in (("arm", 0.0), ("hand", 1.0))
    ]
    model.add("pin", sc.JointRevolute(sc.ground((0, 0, 0)), bars[0].at((0, 0, 0)), axis=(0, 0, 1)))
    places = [bar.at((0.5, 0, 0)) for bar in bars]
    model.add("joint", joint(*places, **options))
    return model


def turned(model, vector):
    """The reference with the hand turned by a rotation vector about its joint."""
    y = model.freeze().q0.reshape(-1, 4, 3).copy()
    y[1, 0] -= 0.5, 0, 0
    y[1] = Rotation.from_rotvec(vector).apply(y[1])
    y[1, 0] += 0.5, 0, 0
    return y.ravel()


@pytest.mark.parametrize(
    ("joint", "options", "vector", "text"),
    [
        (JointOwnWeld, {}, (0, 0, np.pi), "half a turn"),
        # d1 to d2, d2 to d3, d3 to d1: the three products of the weld vanish there as well
        (sc.JointFixed, {}, 2 * np.pi / 3 * np.ones(3) / np.sqrt(3), "a third of a turn"),
        (sc.JointRevolute, {"axis": (0, 0, 1)}, (np.pi, 0, 0), "half a turn"),
        (sc.JointCylindrical, {"axis": (1, 0, 0)}, (0, np.pi, 0), "half a turn"),
        (sc.JointPrismatic, {"axis": (1, 0, 0)}, (np.pi, 0, 0), "half a turn"),
        (sc.JointPlanar, {"normal": (0, 1, 0)}, (0, 0, np.pi), "half a turn"),
    ],
)
def test_starts_that_no_motion_leads_to_are_refused(joint, options, vector, text):
    """Products of directors also vanish after half a turn: the joint is named, wherever it is."""
    model = two_bars(joint, **options)
    system, q = model.freeze(), turned(model, vector)
    assert abs(system.constraints.values(system.extend(q, 0.0))).max() < 1e-14
    state = sc.State(0.0, 0, q, np.zeros(len(q)))
    run = sc.EnergyMomentum(), sc.NullSpace(), 0.01, 0.1
    for call in (
        lambda: sc.initial_state(model, q=q),
        lambda: sc.simulate(model, *run, start=state),
        lambda: sc.static(model, start=state),
        lambda: sc.modes(model, state, 1),
    ):
        with pytest.raises(sc.InputError, match=f"{joint.type} joint 'joint' by {text}"):
            call()


@pytest.mark.parametrize(
    ("joint", "options"),
    [
        (sc.JointRevolute, {"axis": (0, 0, 1)}),
        (sc.JointUniversal, {"axis_a": (1, 0, 0), "axis_b": (0, 1, 0)}),
        (sc.JointSpherical, {}),
    ],
)
def test_half_a_turn_that_the_joint_allows_is_a_start(joint, options):
    """A cardan joint gets there by half a turn about each of its axes."""
    model = two_bars(joint, **options)
    q = turned(model, (0, 0, np.pi))
    assert np.array_equal(sc.initial_state(model, q=q).q, q)


def test_both_branches_of_a_closed_loop_are_starts():
    """The joint of coupler and rocker mirrored at the line through their other ends: by turns."""
    model = four_bar()
    y = model.freeze().q0.reshape(-1, 4, 3).copy()
    crank, rocker, joint = np.array([[0.0, 1, 0], [2, 0, 0], [2, 1.5, 0]])
    along = (rocker - crank) / np.linalg.norm(rocker - crank)
    mirrored = 2 * (crank + (joint - crank) @ along * along) - joint
    for bar, end in ((1, crank), (2, rocker)):
        before, after = joint - end, mirrored - end
        angle = np.arctan2(np.cross(before, after)[2], before @ after)
        y[bar, 0] = (end + mirrored) / 2
        y[bar, 1:] = Rotation.from_rotvec((0, 0, angle)).apply(y[bar, 1:])
    assert np.array_equal(sc.initial_state(model, q=y.ravel()).q, y.ravel())


@pytest.mark.parametrize("distance", [0.0, 1e5])
def test_an_open_joint_is_refused_wherever_the_scene_is(distance):
    """A gap of a thousandth of the scene; the rounding of the coordinates, 1e-11 m, is none."""
    o = distance * np.array([1.0, 0.7, 0.1])
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (0.1, 0.2, 0.3), position=o + (0.5, 0, 0)))
    model.add("pin", sc.JointRevolute(sc.ground(o), body.at(o), axis=(0, 0, 1)))
    q = sc.initial_state(model).q.copy()
    q[2] += 1e-3
    with pytest.raises(sc.InputError, match=r"revolute joint 'pin' by 0\.001"):
        sc.initial_state(model, q=q)
