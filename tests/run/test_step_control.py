"""Step control: what is asked for against what comes out, and what must not be controlled."""

from __future__ import annotations

from itertools import cycle

import numpy as np
import pytest
from helpers_scenes import ball_on_rod
from helpers_schemes import SCHEMES
from scipy.special import ellipj, ellipk

import skfem_cosserat as sc
from skfem_cosserat.history import SensorRecord

G = 10.0
TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
RUBBER = sc.SectionCircle(radius=0.02, material=sc.Material(E=2e5, nu=0.5, rho=1100))


def pendulum():
    """A ball on a rod of 1 m, let go horizontally."""
    return ball_on_rod((1, 0, 0), g=G)[0].freeze()


def swung(t):
    """Where it is: Jacobi's elliptic functions."""
    sn = ellipj(ellipk(0.5) - np.sqrt(G) * t, 0.5)[0]
    angle = 2 * np.arcsin(np.sqrt(0.5) * sn)
    return np.array([np.sin(angle), 0.0, -np.cos(angle)])


def rubber():
    """A soft rod that flies off turning."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    model = sc.Model()
    motion = {"velocity": (0.5, 0.1, 0.2), "angular_velocity": (0, 0.5, 2.0)}
    beam = sc.Beam(mesh, RUBBER, order=2, director=(0, 1, 0), **motion)
    model.add("rod", beam)
    return model.freeze()


def caught():
    """A ball that flies into a cable of 632 rad/s: within five milliseconds it is thrown back."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, position=(0.5, 0, 0), velocity=(1.0, 0, 0)))
    model.add("cable", sc.Cable(sc.ground((0, 0, 0)), ball.place(), stiffness=4e5, length=1.0))
    return model.freeze()


# -- what comes out --------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    "scheme", [sc.EnergyMomentum(), sc.GeneralizedAlpha(0.8, stabilized=False)], ids=repr
)
def test_true_error_follows_the_tolerance(scheme):
    """Over two decades in proportion, and of the same size (closed form)."""
    errors, tolerances = [], [1e-2, 1e-3, 1e-4]
    for tolerance in tolerances:
        control = sc.StepControl(tolerance)
        run = pendulum(), scheme, sc.NullSpace(), control, 1.0
        history = sc.simulate(*run, every=10**6, derive=False)
        errors.append(float(np.linalg.norm(history["q"][-1] - swung(1.0))))
    slope = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert 0.85 < slope < 1.0
    ratio = np.array(errors) / tolerances
    assert ratio.min() > 0.2 and ratio.max() < 3


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS)
def test_varying_steps_keep_energy_and_momenta(treatment):
    """Energy-momentum: to rounding in each step, of whatever size."""
    run = rubber(), sc.EnergyMomentum(), TREATMENTS[treatment], sc.StepControl(1e-2), 0.1
    history = sc.simulate(*run)
    sizes = history["step_size"][1:]
    assert sizes.max() > 1.5 * sizes.min()
    energy = history["energy"]
    assert abs(np.diff(energy)).max() < 1e-11 * energy[0]
    for name in ("linear_momentum", "angular_momentum"):
        values = history[name]
        assert abs(np.diff(values, axis=0)).max() < 1e-11 * abs(values[0]).max()


@pytest.mark.slow
def test_cheaper_than_equal_steps_where_something_is_short():
    """Closed form: free flight, half a vibration on the cable, free flight back."""
    end, still = 1.5, 0.5 + np.pi / np.sqrt(4e5)
    exact, run = 1.0 - (end - still), (caught(), sc.EnergyMomentum(), sc.NullSpace())
    history = sc.simulate(*run, sc.StepControl(1e-2), end, every=10**6, derive=False)
    error = abs(history["q"][-1, 0] - exact)
    fixed = sc.simulate(*run, end / 1600, end, every=10**6, derive=False)
    assert error < 2e-5 < abs(fixed["q"][-1, 0] - exact)
    assert history.meta["step_control"]["iterations"] < fixed.meta["newton_iterations"] / 5


@pytest.mark.slow
def test_times_asked_for_are_met():
    """Output times and the end, exactly; `every` counts steps."""
    at = [0.1, 0.3000001, 0.31, 0.7]
    run = pendulum(), sc.EnergyMomentum(), sc.NullSpace(), sc.StepControl(1e-3)
    history = sc.simulate(*run, until=0.77, at=at)
    assert history.times.tolist() == [0.0, *at, 0.77]
    control = history.meta["step_control"]
    assert control["accepted"] == history["step"][-1]
    every = sc.simulate(*run, until=0.77, every=7)
    assert (every["step"][:-1] % 7 == 0).all() and every.times[-1] == 0.77


@pytest.mark.slow
def test_steps_that_cannot_be_solved_are_made_smaller():
    """Two iterations are not enough for a long step."""
    run = pendulum(), sc.EnergyMomentum(), sc.NullSpace()
    settings = sc.NewtonSettings(iterations=2, damped_iterations=2)
    with pytest.raises(sc.Diverged):
        sc.simulate(*run, 0.2, until=1.0, settings=settings)
    control = sc.StepControl(0.1, first=0.1, largest=0.1)
    counts = sc.simulate(*run, control, until=0.2, settings=settings).meta["step_control"]
    assert counts["unsolved"] >= 1 and counts["smallest"] < 0.05


def test_a_smallest_step_that_is_too_large_is_an_error():
    """With the history so far, and what would help."""
    control = sc.StepControl(1e-9, smallest=1e-2, first=1e-2)
    with pytest.raises(
        sc.Diverged, match=r"a smaller one than 0\.01 s, or take a larger tol"
    ) as caught:
        sc.simulate(pendulum(), sc.EnergyMomentum(), sc.NullSpace(), control, until=1.0)
    assert caught.value.history.meta["step_control"]["rejected"] == 1


@pytest.mark.slow
def test_a_controlled_run_goes_on_from_its_history():
    """The state as it was: momentum and accelerations are carried on."""
    system, scheme = rubber(), sc.GeneralizedAlpha(0.5)
    control = sc.StepControl(1e-2, first=2e-3, largest=2e-3)
    run = system, scheme, sc.NullSpace(), control
    whole = sc.simulate(*run, until=0.04, derive=False)
    half = whole.truncated(11)
    start = sc.restart(system, half, scheme, control)
    again = sc.simulate(*run, until=0.04, start=start, derive=False)
    assert np.allclose(again["q"][-1], whole["q"][-1], rtol=0, atol=1e-10)


# -- steps of other sizes --------------------------------------------------------------------------


ALTERNATING = [
    sc.GeneralizedAlpha(0.3, stabilized=False),  # its rates depend on the last step
    *(scheme for scheme in SCHEMES if scheme.order == 2 and scheme.part is None),
]


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("scheme", "treatment"), list(zip(ALTERNATING, cycle(TREATMENTS.values()))), ids=repr
)
def test_order_with_alternating_steps(scheme, treatment):
    """Second order although each step is half or twice as long as the one before it."""
    errors = []
    for n in (100, 200):
        stepper = sc.Stepper(pendulum(), scheme, treatment, 1.0 / n)
        state = sc.initial_state(stepper.system)
        for k in range(2 * n // 3):
            state = stepper.advance(state, h=(1 + k % 2) / n).state
        errors.append(np.linalg.norm(state.q - swung(state.time)))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.15)


@pytest.mark.slow
def test_symplectic_energy_drifts_with_varied_steps_only():
    """Steps that follow the motion: the energy of the variational scheme goes away with time."""

    def energies(varied, scheme):
        stepper, out = sc.Stepper(pendulum(), scheme, sc.NullSpace(), 0.02), []
        state, h = sc.initial_state(stepper.system), None
        for _ in range(500):
            x, before = state.q[0], state.q
            state = stepper.advance(state, h=h).state
            if varied:  # longer steps on the way out
                out_of = x * (state.q[0] - x) > 0
                h = 0.03 if out_of else 0.015
            v = (state.q - before) / (state.time - out[-1][0] if out else 0.02)
            out.append((state.time, v @ v / 2 + G * (state.q[2] + before[2]) / 2))
        return np.array(out)[:, 1]

    def drift(e):
        return abs(np.polyfit(np.arange(len(e)), e, 1)[0]) * len(e)

    fixed, varied = (drift(energies(each, sc.Variational())) for each in (False, True))
    assert varied > 20 * fixed
    assert drift(energies(True, sc.EnergyMomentum())) < varied / 3


def test_rates_of_sensors_with_varying_steps():
    """Exact for parabolas wherever the instants are."""
    t = np.cumsum([0, 0.1, 0.2, 0.05, 0.3, 0.1, 0.15])
    record = SensorRecord(t, 3 * t**2 - 2 * t, "m")
    assert record.derivative(1).values == pytest.approx(6 * t - 2, abs=1e-12)
    assert record.derivative(2).values == pytest.approx(6.0, abs=1e-10)


# -- what is refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "scheme",
    [
        *(sc.Variational(), sc.Variational(stabilized=True)),
        *(sc.Composition(sc.Variational()), sc.Composition(sc.Variational(stabilized=True))),
        sc.Explicit(),
    ],
    ids=repr,
)
def test_symplectic_schemes_are_refused(scheme):
    """Both are named, why, and what to do instead."""
    with pytest.raises(sc.IncompatibleError) as caught:
        sc.simulate(pendulum(), scheme, sc.Multipliers(), sc.StepControl(1e-3), until=1.0)
    text = str(caught.value)
    for word in (repr(scheme), "StepControl(tolerance=0.001)", "energy drifts", "sc.answer"):
        assert word in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"tolerance": 0.0}, "tolerance"),
        ({"tolerance": "1e-3"}, "tolerance"),
        ({"tolerance": 1e-3, "first": -1.0}, "first"),
        ({"tolerance": 1e-3, "smallest": 1e-2, "largest": 1e-3}, "ascending"),
        ({"tolerance": 1e-3, "first": 1e-2, "largest": 1e-3}, "ascending"),
        ({"tolerance": 1e-3, "span": np.inf}, "span"),
    ],
)
def test_bad_control(arguments, words):
    with pytest.raises(sc.InputError, match=words):
        sc.StepControl(**arguments)


@pytest.mark.slow
def test_composition_of_energy_momentum_is_controlled():
    """Of order four, energy kept."""
    scheme = sc.Composition(sc.EnergyMomentum())
    history = sc.simulate(pendulum(), scheme, sc.NullSpace(), sc.StepControl(1e-4), until=1.0)
    assert np.linalg.norm(history["q"][-1] - swung(1.0)) < 1e-4
    total = history["energy"] + history["external"]
    assert abs(total - total[0]).max() < 1e-11
