"""Several steps in one compiled call: the same ones, and only where nothing has to be looked at."""

from __future__ import annotations

import copy
import pickle
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import test_closed_loops

import skfem_cosserat as sc
from skfem_cosserat import Stepper
from skfem_cosserat.integrators.compiled_step import CompiledStep

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))

from paper import three_bar_swing as swing

pytest.importorskip("numba")


@pytest.fixture
def blocks(monkeypatch):
    """Steps of each block of steps that was solved."""
    counts, solve = [], CompiledStep.advance

    def counted(self, state, times, origin):
        found = solve(self, state, times, origin)
        if len(times) > 1 and found is not None:
            counts.append(len(found))
        return found

    monkeypatch.setattr(CompiledStep, "advance", counted)
    return counts


def run(system, integrator, treatment, step, until, **options):
    """A run with compiled kernels, to its end or where it fails; and its error."""
    given = system, integrator, treatment, step, until
    try:
        return sc.simulate(*given, kernels="numba", derive=False, **options), None
    except sc.Diverged as error:
        return error.history, error


def assert_the_same(a, b, rel=0.0):
    """All that was recorded, to the last bit; or to a share of the largest, without iterations."""
    assert sorted(a) == sorted(b) and {"q", "constraint_force", "work_loads", "fresh"} < set(a)
    for name in set(a) - ({"newton_iterations", "attempts", "residual"} if rel else set()):
        close = {"rtol": 0, "atol": rel * np.nanmax(abs(a[name]), initial=1.0), "err_msg": name}
        np.testing.assert_allclose(a[name], b[name], **close)
        assert a[name].dtype == b[name].dtype, name
    np.testing.assert_allclose(a.times, b.times, rtol=rel)
    assert a.meta.keys() == b.meta.keys()
    for name in set() if rel else a.meta.keys() - {"energy_balance"}:
        assert a.meta[name] == b.meta[name], name
    balance = b.meta.get("energy_balance") or {}
    rounding = 1e-11 * max(1.0, *map(abs, balance.values()))  # of sums of all steps
    assert (a.meta.get("energy_balance") or {}) == pytest.approx(
        balance, rel=max(rel, 1e-12), abs=rounding
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "integrator", "treatment", "theory"),
    [
        ("space", sc.GeneralizedAlpha(0.8), sc.NullSpace(), sc.TheoryReissner()),
        ("plane", sc.EnergyMomentum(stabilized=True), sc.NullSpace(), sc.TheoryReissner()),
        ("space", sc.Variational(), sc.Multipliers(), sc.TheoryReissner()),
        ("space", sc.EnergyMomentum(), sc.NullSpace(), sc.TheoryInextensible()),
        ("plane", sc.Variational(), sc.NullSpace(), sc.TheoryInextensible()),
    ],
)
def test_the_same_states_to_the_last_bit(blocks, where, integrator, treatment, theory):
    """Of the swing, with its pulse; with closed loops where the theory has them."""
    system = swing.scene("published", theory=theory)
    system = system.freeze(planar=sc.Planar() if where == "plane" else None)
    given = system, integrator, treatment, 1e-2, 2.0
    one, _ = run(*given, every=3, callbacks=[lambda report: None])
    assert not blocks
    many, _ = run(*given, every=3)
    assert_the_same(one, many)
    assert sum(blocks) > 50


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # fails
@pytest.mark.parametrize("planar", [None, sc.Planar()])
def test_a_failing_run_fails_at_the_same_step(blocks, planar):
    """The stiff swing with the variational scheme; with all that its attempts at steps say."""
    system = swing.scene("stiff").freeze(planar=planar)
    given = system, sc.Variational(), sc.NullSpace(), 1e-3, 1.0
    one, error = run(*given, every=50, callbacks=[lambda report: None])
    many, other = run(*given, every=50)
    assert_the_same(one, many)
    assert str(error) == str(other) and error.residuals == other.residuals
    assert sum(blocks) > 500 and many.meta["status"] == "diverged"


@pytest.mark.slow
def test_steps_of_the_general_way_in_between(blocks):
    """Where compiled kernels find none within the iterations they have."""
    system = swing.scene("stiff").freeze()
    settings = sc.NewtonSettings(iterations=8)
    given = system, sc.EnergyMomentum(), sc.NullSpace(), 5e-3, 1.0
    attempts = []
    one, _ = run(
        *given, every=200, settings=settings, callbacks=[lambda r: attempts.append(r.attempts)]
    )
    many, _ = run(*given, every=200, settings=settings)
    assert_the_same(one, many)
    assert attempts[60:].count(1) < len(attempts[60:]) and len(blocks) > 3


# the cranks pass singular positions
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize("name", ["three cranks", "stewart"])
def test_closed_loops_are_looked_at_where_single_steps_do(name, blocks):
    """After so much motion, and closed by other rows where those there are have come close."""
    given = test_closed_loops.frozen(name), sc.EnergyMomentum(), sc.NullSpace(), 1e-2, 3.0
    one, _ = run(*given, every=300, callbacks=[lambda report: None])
    many, _ = run(*given, every=300)
    assert_the_same(one, many)
    assert sum(blocks) > 150


@pytest.mark.slow
@pytest.mark.parametrize("every", [1, 40])
def test_sensors_see_each_of_many_steps(blocks, every):
    """As many at a time as there are, and what they would see of single steps, but for rounding."""
    system = swing.scene("published").freeze(planar=sc.Planar())
    given = system, sc.EnergyMomentum(), sc.NullSpace(), 1e-2, 3.0
    beam = system.structures[0]
    mass = beam.node("mid")
    sensors = {
        "place": sc.SensorPosition(mass),
        "speed": sc.SensorVelocity(mass),
        "pull": sc.SensorAcceleration(mass),
        "bend": sc.SensorStrain(beam, 0.1),
        "force": sc.SensorReaction(system.joints[0]),
        "own": sc.SensorQuantity(lambda system, q, t: q[:, :2] * t[:, None]),
    }
    options = {"every": every, "sensors": sensors}
    one, _ = run(*given, **options, callbacks=[lambda report: None])
    assert not blocks
    many, _ = run(*given, **options)
    assert_the_same(one, many)
    assert max(blocks) > 100
    for name in sensors:
        np.testing.assert_array_equal(one.sensors[name].times, many.sensors[name].times)
        values = many.sensors[name].values
        rounding = 1e-13 * abs(values).max()
        np.testing.assert_allclose(one.sensors[name].values, values, rtol=0, atol=rounding)
    assert len(many.sensors["place"].values) == 301


def test_rows_are_kept_where_a_sensor_raises(blocks, tmp_path):
    def own(system, q, t):
        if t[-1] > 0.06:
            raise RuntimeError("out of range")
        return q[:, :1]

    given = scene(add_nothing), sc.EnergyMomentum(), sc.NullSpace(), 6e-4, 0.12
    path = tmp_path / "run.history"
    with pytest.raises(sc.InputError, match="out of range"):
        run(*given, sensors={"own": sc.SensorQuantity(own)}, path=path)
    assert blocks
    # all but the last row, which the step after it completes
    assert len(sc.History.load(path, recover=True)) >= sum(blocks) > 100


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("every", "integrator"), [(20, sc.EnergyMomentum()), (1, sc.Variational())], ids=repr
)
@pytest.mark.filterwarnings("ignore::skfem_cosserat.IncompleteWarning")  # no step after the end
def test_the_last_force_is_that_of_single_steps(blocks, integrator, every):
    """Where a load is not known beyond the end it follows from the three steps before."""

    def force(t):
        if t > 0.12 + 1e-9:
            raise RuntimeError("the record ends")
        return 1.0

    def add(model, rod, pin, end):
        model.add("f", sc.LoadForce(end, (1e-3, 0, 2e-3), force))
        model.add("s", sc.JointSpringDamper(pin, 0.02, 1e-3))

    given = scene(add), integrator, sc.NullSpace(), 6e-4, 0.12
    one, _ = run(*given, every=every, callbacks=[lambda report: None])
    assert not blocks
    assert_the_same(one, run(*given, every=every)[0])
    assert len(blocks) > 1


def test_states_that_are_asked_for(blocks):
    given = swing.scene("published").freeze(planar=sc.Planar()), sc.EnergyMomentum(), sc.NullSpace()
    history, _ = run(*given, 1e-2, 2.0, at=[0.5, 1.2, 1.21, 1.5])
    assert history["step"].tolist() == [0, 50, 120, 121, 150, 200]
    assert max(blocks) > 100


@pytest.mark.parametrize(
    "integrator",
    [sc.EnergyMomentum(stabilized=True), sc.GeneralizedAlpha(0.8)],
    ids=repr,
)
def test_velocities_that_are_left_to_be_moved_end_a_block(integrator):
    """The general way moves them; a block that went on would record them unmoved."""
    system = scene(add_nothing)
    stepper = Stepper(system, integrator, sc.NullSpace(), 4e-3, kernels="numba")
    state = stepper.own(sc.initial_state(system))
    for _ in range(20):
        state = stepper.advance(state).state
    stepper._sized(stepper.h).fast._o.nearest[0] = 0  # as where it is singular
    single, block = stepper.advance(state), stepper.advance_block(state, 5)
    assert len(block) == 1
    np.testing.assert_allclose(block.state.p, single.state.p, rtol=1e-7, atol=1e-11)


def scene(add, planar=None):
    """A beam that hangs on a hinge, with more."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    rubber = sc.Material(E=5e6, nu=0.4, rho=1100)
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, sc.SectionCircle(5e-3, rubber), director=(0, 1, 0)))
    start, end = rod.node("rod.start"), rod.node("rod.end")
    pin = model.add("pin", sc.JointRevolute(sc.ground((0, 0, 0)), start, axis=(0, 1, 0)))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    add(model, rod, pin, end)
    return model.freeze(planar=planar)


EVERY_SCHEME = (
    *(sc.EnergyMomentum(), sc.EnergyMomentum(stabilized=True), sc.EnergyDecaying()),
    *(sc.Variational(), sc.Variational(stabilized=True), sc.Composition(sc.EnergyMomentum())),
    *(sc.GeneralizedAlpha(0.8), sc.GeneralizedAlpha(0.8, stabilized=False)),
)


def add_nothing(model, rod, pin, end):
    """Gravity is all there is."""


def add_changing(model, rod, pin, end):
    """Loads of all kinds, each by a time function of its own."""
    model.add("f", sc.LoadForce(end, (0, 0.1, 0), np.sin))
    model.add("g", sc.LoadForce(end, (0.01, 0, 0.005), sc.RampLinear(0.01, 0.05), follower=True))
    model.add("m", sc.LoadMoment(end, (1e-3, 0, 0), lambda t: t, follower=True))
    model.add("n", sc.LoadMoment(end, (0, 1e-3, 0), lambda t: t * t))


def add_known(model, rod, pin, end):
    """Loads by functions of time of ours, one of which is over before the others."""
    add_over(model, rod, pin, end)
    model.add("g", sc.LoadForce(end, (1e-3, 0, 5e-4), sc.RampLinear(0.01, 0.05), follower=True))
    model.add("m", sc.LoadMoment(end, (1e-4, 0, 0), sc.Harmonic(1.0, 20.0), follower=True))
    model.add("w", sc.LoadGravity((0, 0, -1.0)))


def add_over(model, rod, pin, end):
    """Loads by functions of time of ours that are over."""
    model.add("a", sc.LoadForce(end, (0, 0.01, 2e-3), sc.Table([0, 0.013, 0.04], [0, 1.0, 0])))
    model.add("b", sc.LoadForce(end, (3e-3, 0, 0), sc.RampSmooth(0.01, 0.05)))


def add_springs(model, rod, pin, end):
    """Force elements of all kinds that go through many steps; one winds up by some turns."""
    model.add("hinge spring", sc.JointSpringDamper(pin, stiffness=0.02, damping=1e-3))
    model.add("strut", sc.SpringDamper(sc.ground((0.5, 0, 1)), end, stiffness=0.05, damping=0.01))
    model.add("cable", sc.Cable(sc.ground((1, 0, 0.2)), end, 0.5, length=0.21))
    inertia, at = (1e-3, 2e-3, 2e-3), (0, 1, 0)
    body = sc.RigidBody(0.1, inertia, position=at, angular_velocity=(200.0, 0, 0))
    wheel = model.add("wheel", body)
    axle = sc.JointRevolute(sc.ground((0, 1, 0)), wheel.at(at), axis=(1, 0, 0))
    model.add("axle", axle)
    model.add("winding", sc.JointSpringDamper(axle, stiffness=0.05, damping=1e-3))


def add_motors(model, rod, pin, end):
    """Actuators: one by a function of a user, one beside a spring, two on one hinge."""
    add_springs(model, rod, pin, end)
    model.add("servo", sc.JointActuator(pin, lambda t: 1e-3 * np.sin(40 * t)))
    axle = model["axle"]
    model.add("motor", sc.JointActuator(axle, sc.Harmonic(0.5, 20.0)))
    model.add("brake", sc.JointActuator(axle, sc.RampSmooth(0.02, 0.07, last=-0.3)))


def add_known_motors(model, rod, pin, end):
    """Actuators whose forces are known ahead, without loads that change."""
    model.add("servo", sc.JointActuator(pin, sc.Table([0, 0.05, 0.1], [0, 2e-3, -1e-3])))


def add_driven(model, rod, pin, end):
    """Prescribed motion of all kinds: of a hinge, and of ground that a spring and a rope hold."""
    model.add("drive", sc.JointDrive(pin, lambda t: 5 * t**2))
    motion = sc.Motion(lambda t: (0, 0.1 * np.sin(30 * t) ** 2, 0.1 * t * t))
    support = sc.ground((0.5, 0, 1), motion)
    model.add("strut", sc.SpringDamper(support, end, stiffness=0.05, damping=0.01))
    bob = model.add("bob", sc.MassPoint(0.01, (0.5, 0, 0.5)))
    model.add("rope", sc.JointDistance(support, bob.place()))
    model.add("push", sc.LoadForce(end, (0, 1e-3, 0), sc.Harmonic(1.0, 20.0)))


def add_known_drive(model, rod, pin, end):
    """A hinge that turns by a function of ours, more than once."""
    body = sc.RigidBody(0.1, (1e-3, 2e-3, 2e-3), position=(0, 1, 0))
    wheel = model.add("wheel", body)
    axle = model.add(
        "axle", sc.JointRevolute(sc.ground((0, 1, 0)), wheel.at((0, 1, 0)), axis=(1, 0, 0))
    )
    model.add("drive", sc.JointDrive(axle, sc.RampSmooth(0, 0.1, last=5.0)))
    bob = model.add("bob", sc.MassPoint(0.01, (0, 1, 1)))
    model.add("strut", sc.SpringDamper(wheel.at((0, 1, 0.1)), bob.place(), 1.0, damping=0.01))


def add_viscous(model, rod, pin, end):
    """A second rod, whose sections are viscous."""
    mesh = sc.MeshCurve.init_line((0, 1, 0), (1, 1, 0), 5, name="other")
    section = sc.SectionCircle(5e-3, sc.Material(E=5e6, nu=0.4, rho=1100)).damped(
        viscosity=[0.1, 0.1, 0.1, 1e-5, 1e-5, 1e-5]
    )
    other = model.add("other", sc.Beam(mesh, section, director=(0, 1, 0)))
    hinge = sc.JointRevolute(sc.ground((0, 1, 0)), other.node("other.start"), axis=(0, 1, 0))
    model.add("hinge", hinge)
    model.add("damper", sc.JointSpringDamper(hinge, damping=1e-3))


#: what is added to a scene; until when the mesh allows it; a work that it does, and how much
WORKING = {
    "loads that change": (add_changing, 0.12, "work_loads", 1e-4),
    "known loads": (add_known, 0.12, "work_loads", 1e-6),
    "springs": (add_springs, 0.12, "dissipated", 1.0),
    "viscous sections": (add_viscous, 0.09, "dissipated", 1e-6),
    "motors": (add_motors, 0.078, "work_actuators", 1e-3),
    "known motors": (add_known_motors, 0.078, "work_actuators", 1e-6),
    "drives": (add_driven, 0.06, "work_drives", 1e-3),
    "a known drive": (add_known_drive, 0.06, "work_drives", 1e-3),
}
#: in the order of pairs of schemes and treatments: each twice, once with a scheme that has blocks
NAMES = [*WORKING, *list(WORKING)[4:], *list(WORKING)[:4]]
#: each scheme with each treatment, each in one of these scenes
CASES = [
    pytest.param(*pair, name, id=f"{name}-{pair[0]!r}-{pair[1]!r}")
    for pair, name in zip(
        product(EVERY_SCHEME, (sc.NullSpace(), sc.Multipliers())), NAMES, strict=True
    )
]


@pytest.mark.slow
@pytest.mark.parametrize(("integrator", "treatment", "name"), CASES)
def test_the_same_work_is_done(blocks, integrator, treatment, name, tmp_path):
    """Recorded, in a file, or not; schemes that need rates or loads at their ends go by steps."""
    add, until, work, least = WORKING[name]
    given = scene(add), integrator, treatment, 6e-4, until
    one, error = run(*given, callbacks=[lambda report: None])
    assert not blocks
    many, other = run(*given, path=tmp_path / "run.history")
    assert_the_same(one, many)
    assert_the_same(one, sc.History.load(tmp_path / "run.history"))
    assert str(error) == str(other)
    if type(integrator) in (sc.EnergyMomentum, sc.Variational) and not integrator.stabilized:
        assert blocks
    last, _ = run(*given, every=10**6)
    for series in {"q", "dissipated", work, *(("turns",) if "turns" in one else ())}:
        np.testing.assert_array_equal(last[series][-1], one[series][-1])
    assert np.nanmax(abs(many[work])) > least
    if name == "springs":
        assert many["turns"].max(axis=0).tolist() == [0, 3]


class Recorded(sc.Table):
    """A class of a user, though it derives from one of the library: it may raise, or be slow."""

    def average(self, t0, t1):
        if max(t0, t1) > 0.05:
            raise RuntimeError("no wind is known")
        return super().average(t0, t1)


@pytest.mark.one_quick
@pytest.mark.parametrize("of", ["a load", "an actuator", "a drive", "a class"])
def test_what_fails_does_so_in_its_step(blocks, of):
    """What a function of the user raises comes where the step comes that it is asked for."""

    def force(t):
        if t > 0.05:
            raise RuntimeError("no wind is known")
        return t * t

    def add(model, rod, pin, end):
        made = {
            "a load": lambda: sc.LoadForce(end, (0, 0.1, 0), force),
            "an actuator": lambda: sc.JointActuator(pin, force),
            "a drive": lambda: sc.JointDrive(pin, force),
            "a class": lambda: sc.LoadForce(end, (0, 1e-3, 0), Recorded([0, 1], [0, 1])),
        }
        model.add("f", made[of]())

    given = scene(add), sc.EnergyMomentum(), sc.NullSpace(), 1e-3, 0.1
    seen, found = [], []
    for more in ({"callbacks": [lambda report: seen.append(report.state.time)]}, {}):
        with pytest.raises(sc.InputError, match="no wind is known") as info:
            sc.simulate(*given, kernels="numba", derive=False, **more)
        found.append(str(info.value))
    assert found[0] == found[1]
    assert len(seen) == 50 and 45 < sum(blocks) <= 50


def test_steppers_are_not_copied():
    """A copy worked in the arrays of the first one, and did not move."""
    stepper = Stepper(scene(add_nothing), sc.EnergyMomentum(), sc.NullSpace(), 1e-2)
    for way in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="cannot be copied or pickled: make another one"):
            way(stepper)


@pytest.mark.parametrize("steps", [0, 2.5, True, np.nan])
def test_a_number_of_steps_is_a_positive_integer(steps):
    system = scene(add_nothing)
    stepper = Stepper(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-2, kernels="numpy")
    with pytest.raises(sc.InputError, match=f"argument steps: {steps!r}, expected an integer"):
        stepper.advance_block(sc.initial_state(system), steps)
    assert len(stepper.advance_block(sc.initial_state(system), 20)) == 1  # as plain kernels do


def test_a_block_has_the_reports_of_its_steps():
    """Momentum and constraint force, too."""
    system = swing.scene("published").freeze()
    steppers = [
        Stepper(system, sc.Variational(), sc.NullSpace(), 1e-2, kernels="numba") for _ in range(2)
    ]
    states = [sc.initial_state(system)] * 2
    for _ in range(120):
        states = [s.advance(state).state for s, state in zip(steppers, states, strict=True)]
    many = steppers[1].advance_block(states[1], 7)
    assert len(many) == 7
    for other in many:
        one = steppers[0].advance(states[0])
        states[0] = one.state
        for name in ("momentum", "constraint_force", "constraint_point", "iterations", "step"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        assert one.work == pytest.approx(other.work, rel=1e-12)
    assert many[0].start.index == 120 and many[3].state.index == 124
    np.testing.assert_array_equal(many[3].state.q, many[4].start.q)
    np.testing.assert_array_equal(many[-1].state.q, many.state.q)
