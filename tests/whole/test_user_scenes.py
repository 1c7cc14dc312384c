"""Ramps, base motion, turning hubs, elastic foundations, pressure along a beam."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

import skfem_cosserat as sc
from skfem_cosserat import diagnostics

SECTION = sc.Section.from_constants(
    EA=1e6, GA=4e5, EI=(10, 20), GJ=8, mass=1.0, inertia=(1e-5, 1e-5)
)


def rod(elements, order, length=1.0, director=(0, 0, 1)):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (length, 0, 0), elements, name="rod")
    return sc.Beam(mesh, SECTION, order=order, director=director)


# -- functions of time -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "function",
    [
        sc.RampLinear(0.3, 0.9, 1.0, 4.0),
        sc.RampSmooth(0.3, 0.9, first=-2.0),
        sc.Harmonic(2.0, frequency=1.7, phase=0.3),
    ],
)
def test_averages_are_exact(function):
    """Forwards and backwards, with kinks and jumps inside and without."""
    for t0, t1 in ((0.0, 1.0), (0.25, 0.31), (0.4, 0.401), (0.85, 2.0)):
        kinks = [t for t in (0.3, 0.9) if t0 < t < t1]
        exact = quad(function.value, t0, t1, points=kinks or None, epsabs=1e-13, epsrel=1e-12)[0]
        mean = pytest.approx(exact / (t1 - t0), rel=1e-11, abs=1e-13)
        assert function.average(t0, t1) == mean
        assert function.average(t1, t0) == mean
    assert function(0.5) == function.value(0.5)


def test_smooth_ramp_starts_without_acceleration():
    ramp, h = sc.RampSmooth(0.0, 1.0), 1e-3
    for t in (0.0, 1.0):
        f = [ramp(t + k * h) for k in (-1, 0, 1)]
        assert abs(f[2] - f[0]) < 2e-8 and abs(f[2] - 2 * f[1] + f[0]) < 2e-8
    assert ramp(-1.0) == 0 and ramp(2.0) == 1


def test_bad_functions_of_time():
    for make, message in (
        (lambda: sc.RampLinear(1.0, 1.0), "expected it after"),
        (lambda: sc.RampSmooth(0.0, np.nan), "end = nan"),
        (lambda: sc.Harmonic("loud", 3.0), "amplitude"),
    ):
        with pytest.raises(sc.InputError, match=message):
            make()


# -- motions of the ground -------------------------------------------------------------------------


def test_record_of_accelerations_is_integrated():
    """Linear between the instants: the displacement is a cubic there, twice differentiable."""
    t = np.array([0.0, 0.1, 0.25, 0.6])
    a = np.array([[0, 0, 1.0], [2, 0, -1.0], [-3, 1, 0], [0, 0, 0]])
    shake = sc.MotionShake(t, a)
    place = sc.ground((1.0, 2.0, 3.0), shake)

    def displacement(s):
        return shake.frame(place, s)[0] - place.position

    for s in (0.05, 0.1, 0.3, 0.6):
        for c in range(3):
            kernel = lambda r, s=s, c=c: (s - r) * np.interp(r, t, a[:, c])  # noqa: E731
            exact = quad(kernel, 0, s, points=[k for k in t if 0 < k < s] or None)[0]
            assert displacement(s)[c] == pytest.approx(exact, abs=1e-12)
    end = displacement(0.6)
    assert displacement(1.6) - end == pytest.approx(displacement(2.6) - displacement(1.6))
    assert abs(displacement(-1.0)).max() == 0


def test_baseline():
    """With it the ground comes to rest where it was."""
    t = np.linspace(0, 2, 201)
    a = np.column_stack([np.sin(9 * t) + 0.1, np.cos(5 * t), 0 * t])
    shake = sc.MotionShake(t, a, baseline=True)
    place = sc.ground((0, 0, 0), shake)
    for s in (2.0, 2.5):
        assert abs(shake.frame(place, s)[0]).max() < 1e-12
    line = a - shake.accelerations
    assert abs(np.diff(line, 2, axis=0)).max() < 1e-12
    assert abs(sc.MotionShake(t, a).frame(place, 2.0)[0]).max() > 0.1


def test_bad_motions():
    for make, message in (
        (lambda: sc.MotionTurn((0, 0, 2.0), abs), "unit vector"),
        (lambda: sc.MotionTurn((0, 0, 1.0), 3.0), "expected a function"),
        (lambda: sc.MotionShake([0, 1], [[0, 0], [0, 0]]), "expected \\(k,\\) and"),
        (lambda: sc.MotionShake([0, 0], np.zeros((2, 3))), "do not increase"),
        (lambda: sc.MotionShake([0, 1], np.full((2, 3), np.nan)), "not finite"),
    ):
        with pytest.raises(sc.InputError, match=message):
            make()
    wild = sc.MotionTurn((0, 0, 1.0), lambda t: np.nan)
    with pytest.raises(sc.InputError, match="expected a finite number"):
        wild.frame(sc.ground((0, 0, 0), wild), 0.1)


# -- foundations -----------------------------------------------------------------------------------


def founded(elements, order, k, damping=0.0):
    """A beam pinned at both ends on a bed across it; it stays plane."""
    model = sc.Model()
    beam = model.add("beam", rod(elements, order))
    start, end = beam.node("rod.start"), beam.node("rod.end")
    model.add("left", sc.JointRevolute(sc.ground((0, 0, 0)), start, axis=(0, 0, 1)))
    model.add("right", sc.JointPointOnLine(sc.ground((1.0, 0, 0)), end, axis=(1, 0, 0)))
    model.add("bed", sc.Foundation(beam, (0, k, 0), damping))
    return model, beam


def test_frequencies_on_a_foundation():
    """A bed adds k/(A_rho) to the squares of the frequencies of bending in its direction."""
    k = 5e3
    model, _ = founded(4, 4, k)
    bare, _ = founded(4, 4, 1e-9)
    # plane modes: no motion along e3, and rotary inertia tells little
    with_bed, without = (sc.modes(m, count=8).frequencies for m in (model, bare))
    shift = (2 * np.pi) ** 2 * (with_bed[:, None] ** 2 - without**2)
    close = abs(shift - k / SECTION.mass) < 2e-3 * k
    assert close.any(axis=0).sum() >= 3


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2, 3])
def test_deflection_on_a_foundation(order):
    """A long rail under a load: P lambda/(2 k), lambda^4 = k/(4 EI); nodes converge with 2p."""
    k, P = 4e4, -1.0
    found = []
    for elements in (16, 32, 64):
        model, beam = founded(elements, order, k)
        model.add("load", sc.LoadForce(beam.node((0.5, 0, 0)), (0, P, 0)))
        history = sc.static(model, derive=False, watch=False)
        first = model.freeze().offset(beam.node((0.5, 0, 0)))
        found.append(history["q"][-1, first + 1])
    EI = 10.0  # about d1 = e3; shear is within a percent
    beta = (k / (4 * EI)) ** 0.25
    assert found[-1] == pytest.approx(P * beta / (2 * k), rel=2e-2)
    rate = np.log2((found[0] - found[1]) / (found[1] - found[2]))
    assert rate == pytest.approx(2 * order, abs=0.35)


def test_buckling_on_a_foundation():
    """Pinned column: min over m of ``m^2 pi^2 EI/L^2 + k L^2/(m^2 pi^2)``, Euler's less shear."""
    EI, k = 10.0, 6e3  # m = 2 is lower than m = 1
    model, beam = founded(6, 4, k)
    model.add("push", sc.LoadForce(beam.node("rod.end"), (-1.0, 0, 0)))
    expected = min(m**2 * np.pi**2 * EI + k / (m * np.pi) ** 2 for m in (1, 2, 3))
    factors = sc.buckling(model, 4).factors  # out of the plane of the bed as well
    assert min(abs(factors / expected - 1)) < 3e-3
    assert expected < np.pi**2 * EI + k / np.pi**2


@pytest.mark.slow
def test_damped_foundation():
    """What its dampers take is accounted for."""
    model, beam = founded(3, 2, 2e3, damping=20.0)
    push = sc.Table([0, 0.05, 0.1], [0, 50.0, 0])
    model.add("push", sc.LoadForce(beam.node((2 / 3, 0, 0)), (0, 1.0, 0), push))
    run = sc.EnergyMomentum(), sc.NullSpace(), 2e-3, 0.5
    history = sc.simulate(model.freeze(), *run)
    assert abs(history["energy_balance"]).max() < 1e-12 * history["energy"].max()
    assert history["energy"][-1] < 0.5 * history["energy"].max()


def test_foundation_of_a_part():
    first = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="a")
    mesh = first.joined(sc.MeshCurve.init_line((1, 0, 0), (1, 1, 0), 2, name="b"))
    beam = sc.Beam(mesh, SECTION, order=2, director=(0, 0, 1))
    bed = sc.Foundation(beam, 3.0, part="b")
    total = sum(s.stiffness[0, 0] for s in bed.pieces())
    assert total == pytest.approx(3.0) and len(bed.pieces()) == 5


def test_bad_foundations():
    beam = rod(2, 1)
    for make, message in (
        (lambda: sc.Foundation("beam", 1.0), "expected a beam"),
        (lambda: sc.Foundation(beam, 0.0), "does nothing"),
        (lambda: sc.Foundation(beam, -1.0), r"not positive semidefinite \(eigenvalue -1\)"),
        (lambda: sc.Foundation(beam, np.ones(4)), r"expected \(\) or \(3,\)"),
        (lambda: sc.Foundation(beam, (1, np.nan, 1)), "not finite"),
        (lambda: sc.Foundation(beam, 1.0, part="wing"), "wing"),
    ):
        with pytest.raises(sc.CosseratError, match=message):
            make()


# -- pressure --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_pressure_rolls_up_a_ring():
    """Pressure along d2 on a clamped-free strip: a third of a closed form, by its end moment.

    The load per reference length stays across the beam: its resultant on the clamp is
    ``p (x_end - x_start)`` turned by a right angle when the beam does not stretch.
    """
    model = sc.Model()
    beam = model.add("beam", rod(8, 3))
    clamp = model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("rod.start")))
    p = 40.0
    model.add("pressure", sc.LoadLine(beam, (0, p, 0), follower=True))
    history = sc.static(model)
    system = model.freeze()
    across = beam.triads[0][1]
    end = history["q"][-1][system.offset(beam.node("rod.end")) :][:3]
    turned = np.cross(np.cross(across, (1, 0, 0)), end)  # by the angle from e1 to d2
    sign = np.sign(turned @ across)
    force = history[f"joint/{clamp.name}/force"][-1]
    # reaction on the beam against the whole pressure
    assert force == pytest.approx(-p * sign * turned, rel=2e-3, abs=2e-2)
    assert diagnostics.strain_energy(system, history["q"][-1]) > 1.0
