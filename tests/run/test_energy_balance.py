"""The balance of energy at the end of a run: kept with it, and a warning where it does not hold."""

import itertools
import pickle
import re
import warnings
from functools import partial

import numpy as np
import pytest
from helpers_scenes import ball_on_rod
from helpers_schemes import SCHEMES
from test_failure_map import column

import skfem_cosserat as sc

NULL, MULTIPLIERS = sc.NullSpace(), sc.Multipliers()
EXPLICIT = [sc.Explicit(rounds=20)]
EVERY = [
    *itertools.product(SCHEMES, (NULL, MULTIPLIERS)),
    *((scheme, MULTIPLIERS) for scheme in EXPLICIT),
]


@pytest.fixture
def silent():
    """No warning is given."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", sc.CosseratWarning)
        yield


def balance_of(*arguments, **options):
    history = sc.simulate(*arguments, derive=False, kernels="numpy", **options)
    return history.meta["energy_balance"]


def diverged(run):
    with pytest.raises(sc.Diverged) as caught:
        run()
    return caught.value


def top():
    """A free body that turns about its stable axis."""
    model = sc.Model()
    model.add("top", sc.RigidBody.box(1.0, (0.1, 0.2, 0.3), angular_velocity=(0, 0, 100.0)))
    return model.freeze()


def rod(gravity=9.81, **options):
    """A rubber rod, horizontal, with a body at its end."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="rod")
    section = sc.SectionCircle(0.05, sc.Material(5e6, 0.5, 1100))
    model = sc.Model()
    beam = model.add("rod", sc.Beam(mesh, section, **options))
    body = model.add("body", sc.RigidBody.box(1.0, (0.1, 0.1, 0.2), position=(1, 0, 0)))
    model.add("weld", sc.JointFixed(beam.node("rod.end"), body.at((1, 0, 0))))
    model.add("gravity", sc.LoadGravity((0, 0, -gravity)))
    return model, beam, body


def ordinary(scheme):
    """The rod; hinge with a spring and a damper, and driven where a scheme takes that."""
    explicit = scheme in EXPLICIT
    model, beam, body = rod(lumped=explicit)
    motion = sc.Motion(displacement=lambda t: (0.1 * np.sin(2 * t) ** 2, 0.0, 0.0))
    at = sc.ground if explicit else partial(sc.ground, motion=motion)
    hinge = model.add("hinge", sc.JointRevolute(at((0, 0, 0)), beam.node("rod.start"), (0, 1, 0)))
    model.add("angle", sc.JointSpringDamper(hinge, stiffness=5.0, damping=0.2))
    model.add("cord", sc.SpringDamper(at((2, 1, 0)), body.at((1, 0, 0)), 20.0, damping=1.0))
    return model.freeze()


@pytest.mark.parametrize(("scheme", "treatment"), EVERY[::2], ids=repr)
def test_an_ordinary_run_is_silent(scheme, treatment, silent):
    found = balance_of(ordinary(scheme), scheme, treatment, 0.01, 0.06)
    assert found["start"] == pytest.approx(0, abs=1e-12)
    works = found["loads"] + found["actuators"] + found["drives"] - found["dissipated"]
    assert found["lost"] == pytest.approx(works - found["end"], abs=1e-12)
    assert found["scale"] > 0.1
    exact = isinstance(scheme, sc.EnergyMomentum) and "stabilized" not in scheme.name
    if exact and not scheme.loses:
        assert abs(found["lost"]) < 1e-8 * found["scale"]
    if scheme.loses:
        assert 0 < found["lost"] < 0.1 * found["scale"]


@pytest.mark.one_quick
@pytest.mark.parametrize(("scheme", "treatment"), EVERY[1:-2:2] + EVERY[-2:], ids=repr)
def test_rest_is_silent(scheme, treatment, silent):
    """What rounding leaves of energies and works is not compared."""
    free, *_ = rod(gravity=0.0, lumped=scheme in EXPLICIT)
    assert balance_of(free.freeze(), scheme, treatment, 0.01, 0.03)["scale"] == 0
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (0.1, 0.1, 0.2), position=(3, 1, -1)))
    model.add("hook", sc.JointSpherical(sc.ground((3, 1, 0)), body.at((3, 1, 0))))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    assert balance_of(model.freeze(), scheme, treatment, 0.01, 0.03)["scale"] == 0


def test_a_pendulum_that_has_come_back_to_rest_is_silent(silent):
    """Nothing is left of energy and work, but for an error that is small beside what there was."""
    model = sc.Model()
    bob = model.add("bob", sc.MassPoint(1.0, position=(0.1, 0, 0)))
    model.add("spring", sc.SpringDamper(sc.ground((0, 0, 0)), bob.place(), 100.0))
    model.add("push", sc.LoadForce(bob.place(), (5.0, 0, 0)))
    until = 2 * np.pi / 10
    found = balance_of(model.freeze(), sc.Variational(), NULL, until / 40, until)
    assert abs(found["end"]) < 0.01 * found["scale"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*may have several solutions")
def test_fast_rotation_that_is_destroyed_is_told(tmp_path):
    """The run is "completed" all the same, and each step has been solved."""
    plain = sc.GeneralizedAlpha(0.8, stabilized=False)
    told = r"balance of energy, t = 0\.25 s: the run lost 20\.8 J, 99\.9 % of .*stabilized=True"
    path = tmp_path / "top.sch"
    with pytest.warns(sc.AccuracyWarning, match=told):
        history = sc.simulate(top(), plain, NULL, 5e-3, 0.25, derive=False, path=path)
    assert history.status == "completed"
    found = history.meta["energy_balance"]
    assert found == sc.History.load(path).meta["energy_balance"]
    assert found["lost"] == pytest.approx(found["start"], rel=5e-3)
    assert found["start"] == found["scale"] == pytest.approx(125 / 6)


def test_stabilized_generalized_alpha_keeps_it_and_is_the_default(silent):
    found = balance_of(top(), sc.GeneralizedAlpha(), NULL, 5e-3, 0.25)
    assert 0 < found["lost"] < 0.01 * found["scale"]


@pytest.mark.parametrize("stabilized", [True, False])
def test_histories_are_continued_by_name(stabilized):
    """Rates are carried on by the scheme of this name alone."""
    scheme, other = (sc.GeneralizedAlpha(0.8, stabilized=s) for s in (stabilized, not stabilized))
    history = sc.simulate(top(), scheme, NULL, 1e-3, 0.004)
    assert (
        history.meta["integrator"]
        == "stabilized " * stabilized + "generalized-alpha, rho_inf = 0.8"
    )
    assert sc.restart(top(), history, scheme, 1e-3).rates is not None
    assert sc.restart(top(), history, other, 1e-3).rates is None


def spring(stiffness):
    """A body on a spring, along which it moves, and its start."""
    model = sc.Model()
    bob = model.add("bob", sc.MassPoint(1.0, position=(0.1, 0, 0), velocity=(1.0, 0, 0)))
    model.add("spring", sc.SpringDamper(sc.ground((0, 0, 0)), bob.place(), stiffness))
    return model.freeze()


def test_an_event_does_not_change_the_step_that_is_named():
    """The last step is shorter than the one asked for, which has lost the energy."""
    events = [sc.Event(sc.ConditionTime(1.97), sc.ActionStop(), name="end")]
    with pytest.warns(sc.AccuracyWarning, match=r"in steps of 0\.1 s"):
        history = sc.simulate(
            spring(100.0), sc.GeneralizedAlpha(0.0), NULL, 0.1, 2.0, events=events
        )
    assert history.times[-1] == pytest.approx(1.97)


@pytest.mark.slow
def test_what_a_scheme_is_meant_to_take_is_kept_and_told_above_a_tenth(silent):
    check_that_what_is_taken_is_kept_and_told(sc.GeneralizedAlpha(0.5))


def check_that_what_is_taken_is_kept_and_told(scheme):
    """Above a tenth a warning tells it, in the second run; the first one is silent."""
    history = sc.simulate(spring(100.0), scheme, NULL, 1e-2, 0.3)
    found = history.meta["energy_balance"]
    assert found["dissipated"] == 0 < found["lost"] < 0.1 * found["scale"]
    assert found["lost"] == pytest.approx(history["energy"][0] - history["energy"][-1], rel=1e-9)
    lost = pytest.warns(sc.AccuracyWarning, match=r"lost 0\.\d+ J, [\d.]+ % of 0\.5 J")
    with pytest.warns(sc.AccuracyWarning, match="do not resolve the motion"), lost:
        found = balance_of(spring(1e4), scheme, NULL, 1e-2, 0.3)
    assert found["lost"] > 0.1 * found["scale"]


def test_a_balance_that_is_off_in_between_only_is_told():
    """Where a pendulum turns back the energy of the variational scheme is back, too."""
    model, _, _ = ball_on_rod((1, 0, 0), g=9.81)
    with pytest.warns(sc.AccuracyWarning) as found:  # steps are too long for the motion, too
        history = sc.simulate(model, sc.Variational(), NULL, 0.1, 2.4)
    (notice,) = [each for each in history.meta["warnings"] if each["item"] == "balance of energy"]
    assert sum(str(each.message).startswith("balance of energy, t = ") for each in found) == 1
    balance = history.meta["energy_balance"]
    assert abs(balance["lost"]) < 1e-5 * balance["scale"]
    off = abs(history["energy_projected"] - history["work_loads"])
    assert notice["time"] == history.times[off.argmax()] < 1.0
    share = 100 * off.max() / balance["scale"]
    assert 3 < share < 6 and f"{share:.3g} % of" in notice["text"]


@pytest.fixture
def bursting():
    """A run up to a time: the variational scheme on a compressed column.

    It is above the limit of the alternating nodes.
    """
    system, q = column(400)
    start = sc.initial_state(system, q, nu=1e-3 * np.sin(np.arange(system.unknowns)))
    return partial(sc.simulate, system, sc.Variational(), NULL, 0.1, start=start, kernels="numpy")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*(do not resolve the motion|may have several solutions)")
def test_growing_alternations_are_told_with_what_they_lead_to(bursting):
    """Where the user looks: in the warning about the balance, and in the text of a failure."""
    resolve = r"ompression drives node rotations of beam 'beam' that alternate .* grow above 2"
    gained = rf"the run gained .* % of (.|\n)*EnergyMomentum(.|\n)*{resolve}"
    with pytest.warns(sc.AccuracyWarning, match=gained):
        found = bursting(until=4.0).meta["energy_balance"]
    assert found["lost"] < -0.01 * found["scale"]
    with pytest.warns(sc.AccuracyWarning, match=gained):
        error = diverged(partial(bursting, until=20.0))
    assert error.history.meta["energy_balance"]["lost"] < -0.01 * found["scale"]
    assert re.search(resolve, error.hint) and error.hint[1:] in str(error)
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error)


@pytest.mark.slow
def test_a_failure_wins_over_warnings_that_are_errors(silent, bursting):
    error = diverged(partial(bursting, until=20.0))
    assert "balance of energy" in str(error) and error.history.status == "diverged"
    told = [notice["item"] for notice in error.history.meta["warnings"]]
    assert "balance of energy" in told and "kinetic" in error.history


def test_interrupted_runs_and_those_that_end_with_an_error_have_it(silent):
    def stop(report):
        if report.state.index == 3:
            raise error

    for error in (KeyboardInterrupt(), ZeroDivisionError()):
        if isinstance(error, KeyboardInterrupt):
            history = sc.simulate(top(), sc.EnergyMomentum(), NULL, 1e-3, 0.1, callbacks=[stop])
        else:
            with pytest.raises(ZeroDivisionError) as caught:
                sc.simulate(top(), sc.EnergyMomentum(), NULL, 1e-3, 0.1, callbacks=[stop])
            history = caught.value.history
        found = history.meta["energy_balance"]
        assert found["start"] == pytest.approx(found["end"]) == pytest.approx(125 / 6)
        assert history.meta["steps"]["turn"] == pytest.approx(0.1, abs=0.01)


def falling_arm(damped):
    """A light arm falls about its hinge; something viscous in it that steps do not resolve."""
    alu = sc.SectionRectangle(4e-3, 3e-2, sc.Material(E=70e9, nu=0.33, rho=2700))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0.8, 0, 0), 3, name="arm")
    model = sc.Model()
    section = alu.damped(time=2e-4) if damped == "section" else alu
    arm = model.add("arm", sc.Beam(mesh, section, order=3, director=(0, 0, 1)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), arm.node("arm.start"), axis=(0, -1, 0))
    model.add("hinge", hinge)
    if damped == "damper":
        model.add("damper", sc.JointSpringDamper(hinge, damping=0.05))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    return model


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rho", "stabilized", "damped", "kernels"),
    [
        (0.5, True, "section", "numpy"),
        (0.8, False, "damper", "numpy"),
        (0.5, False, "damper", "numba"),
        (0.8, True, "section", "numba"),
    ],
)
def test_what_dampers_take_is_told_by_the_way_they_go(rho, stabilized, damped, kernels):
    """As by energy-momentum, whose motion is the same.

    Velocities at the ends of steps have vibrations that the way of the steps has not: the power at
    both ends would be up to 130 times as much, the forces there along the way are not.
    """
    scheme = sc.GeneralizedAlpha(rho, stabilized=stabilized)
    taken = [
        sc.simulate(falling_arm(damped), own, sc.NullSpace(), 1e-3, 0.1, kernels=kernels).meta[
            "energy_balance"
        ]["dissipated"]
        for own in (sc.EnergyMomentum(), scheme)
    ]
    assert taken[1] == pytest.approx(taken[0], rel=0.03)
