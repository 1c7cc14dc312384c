"""Answers within a tolerance, what they say of themselves, and what a scene does not need."""

from __future__ import annotations

import os
import signal
import threading
import time

import numpy as np
import pytest
from helpers_scenes import ball_on_rod
from test_answer_scenes import ALUMINIUM, STEEL, Scene, clamp, drawn, rod, weight

import skfem_cosserat as sc
from skfem_cosserat.accuracy import Component, Maximum


def asked(scene, **options):
    model, quantities, tolerance, until, own, _ = scene
    return sc.answer(model, quantities, tolerance, until, **{**own, **options})


def thrown():
    """A mass point: x = v t - g t^2/2 is what the midpoint rule gives at its steps."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(2.0, velocity=(1.0, 0, 3.0)))
    weight(model)
    return model, ball


MODEL, BALL = thrown()
PLACE = sc.SensorPosition(BALL.place())
FOREIGN = sc.SensorPosition(sc.MassPoint(1.0).place())


# -- closed forms ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_thrown_ball():
    """Height and its maximum v^2/2g, the time of a level, the energy: by the parabola."""
    model, ball = thrown()
    place, g = sc.SensorPosition(ball.place()), 9.81
    quantities = {
        "place": place,
        "top": Maximum(place, 2),
        "down": sc.ConditionSensor(place, 0.2, component=2),
        "kinetic": "kinetic",
    }
    found = sc.answer(
        model, quantities, {"place": 1e-6, "top": 1e-6, "down": 1e-8, "kinetic": 1e-6}, 0.5
    )
    assert found.reached and not found.reason
    t = found.times
    exact = np.stack([t, 0 * t, 3 * t - g * t**2 / 2], axis=1)
    assert abs(found.values["place"] - exact).max() < 1e-9
    assert abs(found.values["top"] - 9 / (2 * g)) < 1e-9
    assert abs(found.values["down"] - (3 - np.sqrt(9 - 0.4 * g)) / g) < 1e-8
    assert t[-1] == pytest.approx(0.5, abs=1e-12)


@pytest.mark.slow
def test_a_pendulum_by_its_integral():
    """A rigid pendulum from 1 rad: the period is 4 K(sin^2(1/2)) sqrt(l/g), half of it a level."""
    from scipy.special import ellipk

    model, bob, _ = ball_on_rod((np.sin(1.0), 0, -np.cos(1.0)), g=9.81)
    quarter = ellipk(np.sin(0.5) ** 2) / np.sqrt(9.81)
    lowest = sc.ConditionSensor(sc.SensorPosition(bob.place()), 0.0, component=0)
    tolerance = 1e-4
    found = sc.answer(model, {"lowest": lowest}, tolerance, 0.8)
    assert found.reached
    error = abs(float(found.values["lowest"]) - quarter)
    assert error < tolerance and error < 2 * found.band["lowest"]
    assert found.band["lowest"] == found.band["lowest"].step


@pytest.mark.slow
def test_a_cantilever_at_rest():
    """Small deflection F l^3/3EI + F l/GA, first frequency 1.8751^2 sqrt(EI/m)/2 pi."""
    model = sc.Model()
    bar = rod(model, "bar", (0, 0, 0), (1, 0, 0), 0.002, STEEL)
    clamp(model, bar.node("bar.start"))
    section = bar.sections["section"]
    EI, GA, m = section.stiffness[3, 3], section.stiffness[0, 0], section.mass
    force = 1e-6 * EI
    model.add("push", sc.LoadForce(bar.node("bar.end"), (0, 0, force)))
    quantities = {
        "end": Component(sc.SensorPosition(bar.node("bar.end")), 2),
        "frequency": lambda model, path: sc.modes(model, path, count=1).frequencies[0],
        "root": sc.SensorForce(bar, 0.0),
    }
    first = 1.8751041**2 * np.sqrt(EI / m) / (2 * np.pi)
    tolerance = {"end": 1e-10, "frequency": 1e-3 * first, "root": 1e-9 * EI}
    found = sc.answer(model, quantities, tolerance, None)
    assert found.reached and np.isnan(found.step)
    assert float(found.values["end"]) == pytest.approx(force / 3 / EI + force / GA, abs=1e-10)
    assert float(found.values["frequency"]) == pytest.approx(first, rel=2e-3)
    assert np.linalg.norm(found.values["root"][3:]) == pytest.approx(force, abs=1e-9 * EI)


# -- what it refines -------------------------------------------------------------------------------


def pushed(force, integrator=None):
    """Position of a free ball of 1 kg under a force along x (N), a function of time, for 0.4 s."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0))
    model.add("push", sc.LoadForce(ball.place(), (1.0, 0, 0), force))
    place = Component(sc.SensorPosition(ball.place()), 0)
    return sc.answer(model, {"x": place}, 1e-3, 0.4, integrator=integrator)


@pytest.mark.slow
@pytest.mark.parametrize(("integrator", "rate"), [(None, 1e3), (sc.GeneralizedAlpha(0.8), 2e2)])
def test_a_pulse_that_lies_between_what_steps_look_at(integrator, rate):
    """1 N s within less than a step of the first run: from then on the ball goes at 1 m/s."""
    middle = 0.3071
    found = pushed(lambda t: rate * np.exp(-np.pi * (rate * (t - middle)) ** 2), integrator)
    exact = np.maximum(found.times - middle, 0.0)
    assert found.reached
    assert abs(found.values["x"] - exact).max() < 1e-3


@pytest.mark.slow
@pytest.mark.usefixtures("kept_kernels")
def test_a_force_that_cancels_in_the_means_of_first_steps():
    """An oscillator near its resonance, driven by one period a step: x'' + w0^2 x = f cos(w t)."""
    model, w, f = sc.Model(), 2 * np.pi * 64, 1e3
    ball = model.add("ball", sc.MassPoint(1.0))
    wave = sc.Harmonic(1.0, frequency=64.0, phase=np.pi / 2)
    model.add("push", sc.LoadForce(ball.place(), (f, 0, 0), wave))
    spring = sc.SpringDamper(sc.ground((-1, 0, 0)), ball.place(), stiffness=1.05 * w**2)
    model.add("spring", spring)
    place = Component(sc.SensorPosition(ball.place()), 0)
    found = sc.answer(model, {"x": place}, 2e-3, 1.0)
    w0 = w * np.sqrt(1.05)
    exact = f / (w0**2 - w**2) * (np.cos(w * found.times) - np.cos(w0 * found.times))
    assert found.reached
    assert abs(found.values["x"] - exact).max() < 2e-3 < abs(exact).max() / 50


def falls_with(force, until):
    """A ball that is pushed from rest until it has gone 1 cm, and the time of that."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0))
    model.add("push", sc.LoadForce(ball.place(), (1.0, 0, 0), force))
    gone = sc.ConditionSensor(sc.SensorPosition(ball.place()), 0.01, component=0)
    return sc.answer(model, {"gone": sc.Event(gone, sc.ActionStop(), name="gone")}, 1e-4, until)


@pytest.mark.slow
def test_what_comes_after_the_end_of_a_motion_is_not_asked_for():
    """An event ends it after 0.14 s, far before `until`: x = t^2/2 of a force of 1 N."""
    end = np.sqrt(0.02)
    found = falls_with(lambda t: 1.0 if t < 1.0 else np.sin(1e9 * t), 1.05)
    assert found.reached and abs(found.values["gone"] - end) < 1e-4

    def until_a_second(t):
        if t > 1.0:
            raise ValueError("nobody knows")
        return 1.0

    found = falls_with(until_a_second, 50.0)
    assert found.reached and abs(found.values["gone"] - end) < 1e-4


@pytest.mark.slow
def test_what_no_step_sees_is_named():
    """A million periods: no run of a reasonable number of steps follows them."""
    with pytest.warns(sc.AccuracyWarning, match="do not see what it does"):
        found = pushed(sc.Harmonic(1.0, frequency=1e6))
    assert not found.reached and "do not see what load 'push' does" in found.reason


@pytest.mark.slow
def test_the_meshes_of_the_model_do_not_matter():
    """A model of 3 and of 30 elements: the same answer, and neither of them changes."""
    answers = []
    for count in (3, 30):
        model = sc.Model()
        mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), count, name="bar")
        bar = model.add("bar", sc.Beam(mesh, sc.SectionCircle(0.01, ALUMINIUM)))
        clamp(model, bar.node("bar.start"))
        weight(model)
        end = sc.SensorPosition(bar.node("bar.end"))
        answers.append(sc.answer(model, {"end": end}, 1e-3, 0.2))
        assert model["bar"].mesh.nelements == count
    np.testing.assert_allclose(*(a.values["end"] for a in answers), atol=1e-12)


@pytest.mark.slow
def test_a_smaller_tolerance_takes_shorter_steps_and_richer_meshes():
    scene = drawn("arm", 0)
    rough, good = (asked(scene._replace(tolerance=t)) for t in (2e-2, 5e-4))
    assert rough.reached and good.reached
    assert good.step < rough.step and good.cost_of_run_s > rough.cost_of_run_s
    near = np.array([abs(good.times - t).argmin() for t in rough.times])
    gap = np.linalg.norm(rough.values["tip"] - good.values["tip"][near], axis=1).max()
    assert gap < 2 * rough.band["tip"] + 2 * good.band["tip"] < 2e-2
    assert rough.band["tip"] == rough.band["tip"].step + rough.band["tip"].mesh


@pytest.mark.slow
def test_a_start_that_is_bent():
    """A cantilever let go from its equilibrium: the state is carried to each mesh."""
    model = sc.Model()
    bar = rod(model, "bar", (0, 0, 0), (1, 0, 0), 0.01, ALUMINIUM, order=3)
    clamp(model, bar.node("bar.start"))
    push = model.add("push", sc.LoadForce(bar.node("bar.end"), (0, 0, 20.0)))
    bent = sc.equilibrium(model, sc.static(model))
    assert push.name == "push"
    end = sc.SensorPosition(bar.node("bar.end"))
    found = sc.answer(model, {"end": end}, 1e-5, 0.1, start=bent)
    assert found.reached  # it stays there
    assert np.ptp(found.values["end"], axis=0).max() < 2e-5


@pytest.mark.slow
def test_functions_have_places_of_the_model_that_was_given():
    """A bar falls on a stop under its middle and bounces: by functions of the user's."""
    model = sc.Model()
    bar = rod(model, "bar", (0, 0, 1), (1, 0, 1), 0.05, STEEL)
    start, middle = bar.node("bar.start"), bar.node((0.5, 0, 1))
    model.add("hinge", sc.JointRevolute(sc.ground(start.position), start, axis=(0, 1, 0)))
    weight(model)

    def height(time, view):
        return view.position(middle)[2] - 0.8

    def bounce(time, view):
        return sc.initial_state(view.system, q=view.q, v=-0.5 * view.v)

    hit = sc.Event(height, bounce, direction=-1, name="hit")
    found = sc.answer(model, {"hit": hit}, 1e-3, 0.5)
    # a rigid bar: theta'' = 1.5 g cos(theta)/l from rest to sin(theta) = 0.4
    angle = np.linspace(0, 1, 20001)[1:] ** 2 * np.arcsin(0.4)  # without the root at the start
    rate = 1 / np.sqrt(3 * 9.81 * np.sin(angle))
    exact = np.diff(angle) @ (rate[1:] + rate[:-1]) / 2
    assert found.reached and float(found.values["hit"]) == pytest.approx(exact, abs=2e-3)


# -- what cannot be reached ------------------------------------------------------------------------


@pytest.mark.slow
def test_chaos_is_named_with_the_time_up_to_which_it_can():
    found = asked(drawn("chaos", 0))
    assert not found.reached and "chaotic" in found.reason and "up to t = " in found.reason
    assert found.history is not None and found.runs < 10
    known = float(found.reason.rsplit("t = ", 1)[1].split(" s")[0])
    own = found.values["b"][found.times <= known]
    end = found.times[len(own) - 1]
    run = found.model, sc.EnergyMomentum(), sc.NullSpace(), found.step / 8, end
    place = sc.simulate(*run, every=8, derive=False).position(found.model["b"].place())
    assert np.linalg.norm(own - place, axis=1).max() < 1e-3


@pytest.mark.slow
def test_a_budget_that_is_spent():
    scene = drawn("rope", 0)._replace(tolerance=1e-7)
    with pytest.warns(sc.AccuracyWarning):  # of the rough run that is handed back
        found = asked(scene, budget_s=0.3)
    assert found.warnings
    assert not found.reached and found.reason.endswith("beyond the budget of 0.3 s")
    assert found.history is not None and np.isfinite(found.values["mass"]).all()


def test_no_run_comes_to_its_end():
    model = sc.Model()
    bar = rod(model, "bar", (0, 0, 0), (1, 0, 0), 0.01, STEEL)
    model.add("push", sc.LoadForce(bar.node("bar.end"), (0, 0, 1.0)))
    end = sc.SensorPosition(bar.node("bar.end"))
    found = sc.answer(model, {"end": end}, 1e-3, None)  # nothing holds it: no equilibrium
    assert not found.reached and found.reason.startswith("no run came to its end: ")
    assert found.history is None and not found.values and "not reached" in str(found)


@pytest.mark.slow
def test_an_event_that_does_not_happen():
    level = sc.ConditionSensor(PLACE, 100.0, component=2)
    found = sc.answer(MODEL, {"level": level, "place": PLACE}, 1e-3, 0.5)
    assert not found.reached and "'level' is not a number: an event that does not" in found.reason
    found = sc.answer(
        MODEL, {"level": level, "place": PLACE}, {"level": np.inf, "place": 1e-3}, 0.5
    )
    assert found.reached and np.isnan(found.values["level"])  # it had to act only


@pytest.mark.parametrize("component", [-1, 1.5])
def test_components_that_there_are_not(component):
    with pytest.raises(sc.InputError, match=r"component"):
        Component(PLACE, component)


def column(load):
    """A clamped column of aluminium of 1 m under a part of Euler's load, E I (pi/2)^2."""
    model, radius = sc.Model(), 0.01
    beam = rod(model, "rod", (0, 0, 0), (0, 0, 1), radius, ALUMINIUM)
    clamp(model, beam.node("rod.start"))
    euler = ALUMINIUM.E * np.pi * radius**4 / 4 * (np.pi / 2) ** 2
    model.add("press", sc.LoadForce(beam.node("rod.end"), (0, 0, -load * euler)))
    return model, sc.SensorPosition(beam.node("rod.end"))


@pytest.mark.slow
def test_a_function_that_fails_on_the_poorest_meshes():
    """Finer ones are tried; what fails on all of them ends with its error."""
    model, _ = column(0.5)

    def fourth(model, path):
        return 0.0 * model["rod"].mesh.lengths[3]

    found = sc.answer(model, {"fourth": fourth}, 1e-3, None)
    assert found.reached and found.model["rod"].mesh.nelements >= 4
    with pytest.raises(sc.InputError, match="quantity 'never': it failed: IndexError"):
        sc.answer(model, {"never": lambda path: path.times[10**6]}, 1e-3, None)


@pytest.mark.one_quick
@pytest.mark.parametrize("value", ["q", lambda path: path["q"][-1]], ids=["name", "last"])
def test_values_whose_shape_hangs_on_the_mesh(value):
    with pytest.raises(sc.InputError, match=r"'all': has shape \(.*\) on one mesh and .* another"):
        sc.answer(column(0.5)[0], {"all": value}, 1e-3, None)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.ModelWarning")
@pytest.mark.parametrize("load", [0.5, 1.6])
def test_an_unstable_equilibrium_is_said(load):
    model, top = column(load)
    found = sc.answer(model, {"top": top}, 1e-4, None)
    said = [each for each in found.warnings if "it is unstable" in each["text"]]
    assert found.reached and len(said) == (load > 1)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # of the rough runs
@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_ctrl_c_hands_back_the_best_so_far():
    scene = drawn("rope", 1)._replace(tolerance=1e-9)

    def press(runs, error):
        if runs > 1:
            threading.Thread(target=os.kill, args=(os.getpid(), signal.SIGINT)).start()
            time.sleep(0.1)

    found = asked(scene, progress=press)
    assert not found.reached and "interrupted" in found.reason and found.history is not None


# -- words -----------------------------------------------------------------------------------------


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (({}, 1.0, 1.0), "argument quantities: {}, expected a dict"),
        (({"a/b": PLACE}, 1.0, 1.0), "'a/b', expected a name without slashes"),
        (({"a": 3}, 1.0, 1.0), "quantity 'a': 3, expected a sensor"),
        (({"a": PLACE}, 0.0, 1.0), "argument tolerance: value = 0.0, expected a positive"),
        (({"a": PLACE}, {"b": 1.0}, 1.0), r"argument tolerance: is for \['b'\], expected \['a'\]"),
        (({"a": PLACE}, 1.0, -1.0), "argument until: -1.0, expected a time after the start at 0 s"),
        (({"a": "nonsense"}, 1.0, 1.0), "quantity 'a': series 'nonsense' is unknown"),
        (({"a": lambda history: 1 / 0}, 1.0, 1.0), "quantity 'a': .*ZeroDivisionError"),
        (({"a": lambda history: np.inf}, 1.0, 1.0), "quantity 'a': inf, expected finite"),
        (({"a": sc.ConditionSensor(FOREIGN, 0.0, component=0)}, 1.0, 1.0), "sensor is not here"),
        (({"a": sc.ConditionSensor(PLACE, 0.0, component=0)}, 1.0, None), "'a' needs a motion"),
        (({"a": Component(PLACE, 7)}, 1.0, 1.0), "quantity 'a': component = 7, of a sensor that"),
        (({"a": FOREIGN}, 1.0, 1.0), "of 'a' is not in this"),
    ],
)
def test_bad_arguments(arguments, message):
    with pytest.raises(sc.InputError, match=message):
        sc.answer(MODEL, *arguments)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"integrator": sc.LoadControl()}, "argument integrator: .*or until=None for equilibria"),
        ({"budget_s": 0.0}, "argument budget_s"),
        ({"start": lambda system: 5}, "argument start: what it gave"),
        ({"start": lambda system: 1 / 0}, "argument start: it failed: ZeroDivisionError"),
        ({"progress": 3}, "argument progress: 3"),
    ],
)
def test_bad_options(options, message):
    with pytest.raises(sc.InputError, match=message):
        sc.answer(MODEL, {"a": PLACE}, 1.0, 1.0, **options)


@pytest.mark.parametrize("name", ["adapt", "Asynchronous"])
def test_names_of_older_versions_say_what_to_take(name):
    with pytest.raises(AttributeError, match=rf"{name} is gone: take "):
        getattr(sc, name)


# -- what a scene does not need --------------------------------------------------------------------


def pendulum_on_a_rope():
    """100 kg on 2 m of steel rope."""
    model = sc.Model()
    rope = rod(model, "rope", (0, 0, 0), (2, 0, 0), 0.004, STEEL)
    model.add("hook", sc.JointSpherical(sc.ground((0, 0, 0)), rope.node("rope.start")))
    model.add("load", sc.MassPoint(100.0, on=rope.node("rope.end")))
    weight(model)
    return Scene(model, {"load": sc.SensorPosition(rope.node("rope.end"))}, 2e-2, 0.5)


def proposed(found):
    return {row["left_out"] for row in found.rows if row["proposed"]}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # of one element
def test_a_heavy_load_on_a_steel_rope_has_a_rigid_rope():
    scene = pendulum_on_a_rope()
    found = asked(scene)
    lines = str(found).splitlines()
    assert len(lines) <= 8 and lines[0] == "within the tolerance"
    assert repr(found) == f"<Answer: reached, {found.runs} runs>"
    less = found.simpler()
    assert "strains of rope" in proposed(less)
    assert less.model is not None and isinstance(less.model["rope"].theory, sc.TheoryRigid)
    own = sc.simulate(
        *(less.model, sc.EnergyMomentum(), sc.NullSpace(), less.step, 0.5), derive=False
    )
    end = own.position(less.model["rope"].node("rope.end"))
    exact = np.array([found.values["load"][abs(found.times - t).argmin()] for t in own.times])
    gap = np.linalg.norm(end - exact, axis=1).max() / 2e-2
    assert gap == pytest.approx(less.change, rel=1e-6) and gap < 1
    assert isinstance(scene.model["rope"].theory, sc.TheoryReissner)  # nothing is applied


@pytest.mark.slow
def test_a_slow_press_is_statics():
    less = asked(drawn("slow", 0)).simpler()
    assert "inertia (statics)" in proposed(less) and less.statics and np.isnan(less.step)
    energies = less.notes["energy of bar (J)"]
    assert less.notes["kinetic energy (J)"] < 1e-4 * sum(energies.values())


@pytest.mark.slow
def test_energies_by_kind_of_strain():
    """A bar pulled, pushed aside and twisted: N^2 l/2EA, Q^2 l/2GA, F^2 l^3/6EI, M^2 l/2GJ."""
    model = sc.Model()
    bar = rod(model, "bar", (0, 0, 0), (1, 0, 0), 0.02, STEEL)
    clamp(model, bar.node("bar.start"))
    ramp = sc.RampSmooth(0, 1.0)
    N, Q, M = 100.0, 10.0, 20.0
    model.add("force", sc.LoadForce(bar.node("bar.end"), (N, 0, Q), ramp))
    model.add("moment", sc.LoadMoment(bar.node("bar.end"), (M, 0, 0), ramp))
    found = sc.answer(model, {"end": sc.SensorPosition(bar.node("bar.end"))}, 1e-5, 2.0)
    energies = found.simpler().notes["energy of bar (J)"]
    GA, _, EA, EI, _, GJ = np.diag(bar.sections["section"].stiffness)
    exact = {
        "shear": Q**2 / 2 / GA,
        "extension": N**2 / 2 / EA,
        "bending": Q**2 / 6 / EI,
        "torsion": M**2 / 2 / GJ,
    }
    for kind, energy in exact.items():
        assert energies[kind] == pytest.approx(energy, rel=0.05), kind


@pytest.mark.slow
def test_nothing_where_nothing_may_go():
    """A spinning body, with a tolerance that its step just meets."""
    scene = drawn("rigid", 0)
    first = asked(scene)
    found = asked(scene._replace(tolerance=2.05 * first.band["box"]))
    assert found.reached and found.step == first.step
    less = found.simpler()
    assert [row["left_out"] for row in less.rows] == ["every second step"]
    assert not proposed(less) and less.model is None
    assert str(less).startswith("every second step stays: ")
