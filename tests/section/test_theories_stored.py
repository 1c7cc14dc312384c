"""Stored energies with theories of beams; resultants of what is held, wherever they are read."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_scenes import chequered
from test_export import read_index, read_vtu
from test_stored_energy import FULL, FUNG, QUARTIC
from test_tangents import Step
from test_theories import SECTION, TIP, arc, cantilever, flying, tip_of

import skfem_cosserat as sc
from skfem_cosserat import write_paraview
from skfem_cosserat.theory import LawHeld

THEORIES = (sc.TheoryInextensible(), sc.TheoryKirchhoff(), sc.TheoryInextensible(torsion=False))
theories = pytest.mark.parametrize("theory", THEORIES, ids=repr)
TREATMENTS = (sc.NullSpace(), sc.Multipliers())


def stored(energy=FUNG):
    return sc.SectionHyperelastic(energy, mass=1.0, inertia=(1e-3, 2e-3))


# -- stored energies -------------------------------------------------------------------------------


@pytest.mark.parametrize("energy", [QUARTIC, FUNG], ids=["quartic", "fung"])
@theories
def test_law_of_the_strains_that_are_left(energy, theory):
    """Stress and tangent of a theory's law by complex steps of its energy; none of what is held."""
    law = LawHeld(stored(energy).law, theory.held)
    eps = 0.2 * np.random.default_rng(2).uniform(-1, 1, (7, 6))
    held = list(theory.held)
    assert law.energy(eps) == pytest.approx(energy(np.where(np.isin(range(6), held), 0, eps)))
    stress, tangent = law.stress(eps), law.tangent(eps)
    for k in range(6):
        step = np.zeros(6, dtype=complex)
        step[k] = 1e-30j
        assert law.energy(eps + step).imag / 1e-30 == pytest.approx(stress[:, k], abs=1e-12)
        rate = law.stress(eps + step).imag / 1e-30
        assert abs(tangent[:, :, k] - rate).max() < 1e-8 * abs(tangent).max()
    assert (stress[:, held] == 0).all()
    assert (tangent[:, held] == 0).all()


@pytest.mark.slow
@theories
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
def test_free_flight_keeps_momenta_and_energy(theory, treatment):
    system = flying(theory, section=stored(), push=TIP).freeze()
    run = sc.simulate(system, sc.EnergyMomentum(), treatment, 0.01, 0.3, kernels="numpy")
    assert run["strain_energy"].max() > 0.03 * run["energy"].max()
    after = run.times > 0.0201
    for name in ("energy", "linear_momentum", "angular_momentum"):
        values = run[name][after]
        assert np.ptp(values, axis=0) == pytest.approx(0, abs=1e-10 * abs(values).max())


@pytest.mark.one_quick
@chequered("integrator", [sc.EnergyMomentum(), sc.Variational()], "treatment", TREATMENTS)
@pytest.mark.parametrize("theory", THEORIES[:2], ids=repr)
def test_tangent_of_a_step(theory, integrator, treatment):
    """By complex steps, at random states far from a solution."""
    system = arc(theory, 2, 2, stored(QUARTIC)).freeze()
    step = Step(system, integrator, treatment, size=0.1)
    assert abs(step.matrix() - step.derivative()).max() < 1e-8 * abs(step.matrix()).max()


@pytest.mark.slow
@theories
def test_full_beams_of_a_stored_energy_converge_to_the_theory(theory):
    """As what is held grows stiff, in first order; moments of both beside."""

    class Stiffened:
        def __init__(self, factor):
            self.factor = np.where(np.isin(range(6), theory.held), factor * FULL.diagonal(), 0.0)

        def __call__(self, eps):
            return QUARTIC(eps) + 0.5 * (eps**2 * self.factor).sum(-1)

    def solved(theory, energy):
        model = arc(theory, 2, 3, stored(energy))
        rod = model["rod"]
        model.add("clamp", sc.JointFixed(sc.ground((1, 0, 0)), rod.node("rod.start")))
        model.add("force", sc.LoadForce(rod.node("rod.end"), (0, 2.0, 3.0)))
        path = sc.static(model, watch=False)
        return tip_of(model, path["q"][-1]), path["beam/rod/resultant"][-1]

    place, resultant = solved(theory, QUARTIC)
    errors = []
    for factor in (1e3, 1e4):
        other, forces = solved(None, Stiffened(factor))
        errors.append((np.linalg.norm(other - place), abs(forces - resultant).max()))
    assert np.divide(*errors) == pytest.approx(10, rel=0.05)
    assert errors[1][1] < 5e-3 * abs(resultant).max()


@pytest.mark.slow
def test_nothing_is_left_of_a_stored_energy_that_is_rigid():
    """The rigid theory moves as the one of a plain section does."""
    first, second = (
        sc.simulate(
            flying(sc.TheoryRigid(), section=section).freeze(),
            *(sc.EnergyMomentum(), sc.NullSpace(), 2e-3, 0.02),
            kernels="numpy",
        )["q"][-1]
        for section in (stored(), SECTION)
    )
    assert abs(first - second).max() < 1e-13


# -- resultants of what is held --------------------------------------------------------------------


def swinging(theory, held=(), factor=1.0):
    """A cantilever that a smooth force sets in motion; strains `held` are `factor` as stiff."""
    stiffness = np.array([30.0, 30.0, 60.0, 1.0, 1.2, 0.8])
    stiffness[list(held)] *= factor
    section = sc.Section(stiffness, mass=1.0, inertia=(1e-3, 2e-3))
    model = cantilever(theory, 2, 3, section)
    pulse = sc.FunctionOfTime(pulsing)
    model.add("pulse", sc.LoadForce(model["rod"].node("rod.end"), (0.3, 0.2, 0.1), pulse))
    return model.freeze()


def pulsing(t):
    return np.sin(np.pi * t) ** 4


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
@theories
def test_resultants_in_motion_are_those_of_stiff_beams(theory, treatment):
    """To first order in the flexibility; constraint forces are means of both steps at a state."""

    def resultants(*scene):
        arguments = sc.EnergyMomentum(), treatment, 0.02
        history = sc.simulate(swinging(*scene), *arguments, 0.4, kernels="numpy")
        return history["beam/rod/resultant"]

    held, others = list(theory.held), [k for k in range(6) if k not in theory.held]
    found, errors = resultants(theory), []
    for factor in (1e2, 1e3):
        stiff = resultants(None, held, factor)
        middle = (0.25 * stiff[:-2] + 0.5 * stiff[1:-1] + 0.25 * stiff[2:])[..., held]
        errors.append(
            [
                abs(found[1:-1][..., held] - middle).max() / abs(middle).max(),
                abs((found - stiff)[1:-1][..., others]).max() / abs(stiff[..., others]).max(),
            ]
        )
    # a mean of both steps is not quite a force of multipliers, which adds an error of the step
    of_held, of_others = np.divide(*errors)
    assert of_others == pytest.approx(10, rel=0.05) and 5 < of_held < 10.5
    assert max(errors[1]) < 1e-3


@pytest.mark.one_quick
@theories
def test_resultants_of_what_is_held_reach_paraview(tmp_path, theory):
    arguments = sc.EnergyMomentum(), sc.NullSpace(), 0.02
    history = sc.simulate(swinging(theory), *arguments, 0.4, kernels="numpy")
    write_paraview(history, tmp_path)
    frames = read_index(tmp_path / "beams.pvd")
    assert len(frames) == len(history)
    cells = read_vtu(tmp_path / frames[12][1])[4]
    written = np.concatenate([cells["N"], cells["M"]], axis=1)
    assert (abs(written[:, list(theory.held)]).max(axis=0) > 1e-9).any()
    means = history["beam/rod/resultant"][12].mean(axis=1)
    found = written.reshape(3, -1, 6).mean(axis=1)
    assert found == pytest.approx(means, rel=1e-9, abs=1e-12)
