"""Strains at which sections are free of stress: heat, growth, prestress."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat.diagnostics import evaluate, forces_along, nodal_resultants, section_forces
from skfem_cosserat.modal import buckling

SECTION = sc.Section([1e5, 1e5, 2e5, 30.0, 30.0, 20.0], 1.0, (1e-3, 1e-3))
THEORIES = pytest.mark.parametrize("theory", [None, sc.TheoryKirchhoff()], ids=repr)


HARDENING = sc.SectionHyperelastic(
    lambda e: 0.5 * (SECTION.stiffness.diagonal() * e**2).sum(-1) + 1e5 * e[..., 3] ** 4,
    1.0,
    (1e-3, 1e-3),
)


def cantilever(strain, theory=None, order=4, elements=3, section=SECTION):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
    more = {"order": order, "director": (0, 1, 0), "theory": theory, "strain": strain}
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, **more))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    return model, rod


@THEORIES
def test_a_heated_bar_that_is_held_pushes(theory, kernels):
    model, rod = cantilever((0, 0, 1e-3, 0, 0, 0), theory)
    model.add("wall", sc.JointFixed(rod.node("rod.end"), sc.ground((1, 0, 0))))
    path = sc.static(model, kernels=kernels, watch=False)
    assert path["beam/rod/resultant"][-1, :, :, 2] == pytest.approx(-200.0, rel=1e-10)
    assert path["joint/clamp/force"][-1] == pytest.approx([200.0, 0, 0], abs=1e-9)
    assert evaluate(model, rod, path["q"][-1], 1, 0.3).resultant[0, 2] == pytest.approx(-200.0)


@THEORIES
def test_a_bimetal_strip_bends_to_an_arc(theory):
    """Of curvature 0.7 about d1 along d1 x d2, without any stress."""
    model, rod = cantilever((0, 0, 0, 0.7, 0, 0), theory)
    path = sc.static(model, watch=False)
    end = path.position(rod.node("rod.end"))[-1]
    assert end[[0, 2]] == pytest.approx([np.sin(0.7) / 0.7, (np.cos(0.7) - 1) / 0.7], abs=1e-7)
    assert abs(path["beam/rod/resultant"][-1]).max() < 1e-6


def test_strains_grow_along_a_line(kernels):
    """The end moves by the integral of the axial strain, given in three ways."""
    ways = [
        lambda s: (0, 0, 0.01 * s, 0, 0, 0),
        ([0, 1], [np.zeros(6), (0, 0, 0.01, 0, 0, 0)]),
    ]
    for strain in ways:
        model, rod = cantilever(strain)
        path = sc.static(model, kernels=kernels, watch=False)
        assert path.position(rod.node("rod.end"))[-1, 0] == pytest.approx(1.005, rel=1e-12)


def test_a_strip_swings_with_the_energy_of_its_curvature():
    """Let go straight: EI k^2 L/2 is conserved, and a finer copy knows the strain."""
    model, rod = cantilever((0, 0, 0, 0.7, 0, 0), order=2)
    history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, 0.02)
    assert history["energy"] == pytest.approx(0.5 * 30 * 0.7**2, rel=1e-11)
    finer = rod.refined(1)
    assert (finer.elements.reference[:, :, 3] == 0.7).all()


@pytest.mark.parametrize("strain", [(1, 2), lambda s: "x", ([0, 0.5], np.zeros((2, 6)))])
def test_strains_that_are_none(strain):
    with pytest.raises(sc.InputError, match="strain"):
        cantilever(strain)


def test_strains_that_a_theory_holds_are_refused():
    with pytest.raises(sc.InputError, match="strain is of what TheoryInextensible"):
        cantilever((0, 0, 1e-3, 0, 0, 0), theory=sc.TheoryInextensible())


# -- strains that change: in statics by a factor, in motion with their power ---------------------

HEAT = (0, 0, 1e-3, 0, 0, 0)


def heated(strain, amplitude=None, **more):
    model, rod = cantilever(None, **more)
    model.add("heat", sc.LoadStrain(rod, strain, amplitude))
    return model, rod


def forces_in_all_ways(model, rod, path):
    q, lam = path["q"][-1], path["multipliers"][-1]
    yield path["beam/rod/resultant"][-1]
    yield section_forces(model, rod, q, multipliers=lam)
    yield nodal_resultants(model, rod, q, multipliers=lam)
    yield forces_along(model, path, rod, [0.2, 0.7])[-1]
    yield evaluate(model, rod, q, [0, 1], [0.3, 0.6], multipliers=lam).resultant


@THEORIES
def test_heat_has_a_factor_of_its_own(theory, kernels):
    """A bar that is held pushes by EA alpha dT, and stores the energy of that."""
    model, rod = heated(HEAT, theory=theory)
    model.add("wall", sc.JointFixed(rod.node("rod.end"), sc.ground((1, 0, 0))))
    heats = {"heat": sc.Table([0, 1], [0, 3])}
    path = sc.static(model, kernels=kernels, factors=heats, watch=False)
    assert path["joint/clamp/force"][-1] == pytest.approx([600.0, 0, 0], abs=1e-9)
    assert path["strain_energy"][-1] == pytest.approx(0.5 * 2e5 * 3e-3**2, rel=1e-10)
    assert path["beam/rod/resultant"][-1, :, :, 2] == pytest.approx(-600.0, rel=1e-10)
    assert path["work_loads"] == pytest.approx(path["strain_energy"], abs=1e-10)
    loads = path["amplitudes/loads"]
    found = section_forces(model, rod, path["q"], multipliers=path["multipliers"], amplitudes=loads)
    assert found == pytest.approx(path["beam/rod/resultant"], abs=1e-8)
    once = sc.static(model, kernels=kernels, watch=False)
    for found in forces_in_all_ways(model, rod, once):
        expected = np.broadcast_to([0, 0, -200.0, 0, 0, 0], found.shape)
        assert found == pytest.approx(expected, abs=1e-8)


def test_heat_buckles_a_column_that_is_held():
    """At P (1 + P/GA) = 4 pi^2 EI/L^2 with P = EA alpha dT: no strain comes before it."""
    model, rod = heated(HEAT, elements=16)
    model.add("wall", sc.JointFixed(rod.node("rod.end"), sc.ground((1, 0, 0))))
    P = 0.5e5 * (np.sqrt(1 + 16 * np.pi**2 * 30 / 1e5) - 1)
    assert buckling(model, 1).factors[0] * 200 == pytest.approx(P, rel=1e-9)


@pytest.mark.one_quick
@pytest.mark.parametrize(
    "integrator",
    [sc.EnergyMomentum(), sc.EnergyDecaying(), sc.Variational(), sc.GeneralizedAlpha()],
)
@pytest.mark.parametrize("treatment", [sc.NullSpace(), sc.Multipliers()], ids=repr)
def test_the_power_of_a_growing_curvature_is_in_the_balance(integrator, treatment, kernels):
    """To rounding where stresses are discrete derivatives, else to second order of the step."""
    model, _ = heated((0, 0, 0, 0.4, 0, 0.3), sc.RampSmooth(0, 1.0), order=2)
    off = []
    for step in (0.005, 0.0025):
        run = sc.simulate(model, integrator, treatment, step, 0.4, kernels=kernels)
        off.append(abs(run["energy_balance"]).max() / abs(run["work_loads"]).max())
    if integrator.numbers.ends:
        assert max(off) < 1e-10
    else:
        assert np.log2(off[0] / off[1]) == pytest.approx(2.0, abs=0.15)
        assert off[1] < 1e-4


def test_a_strain_that_ends_leaves_its_energy_to_the_motion(kernels):
    """Heat that goes at an event: what is stored then is work, the balance closes."""
    model, rod = heated(HEAT, order=2)
    model.add("wall", sc.JointFixed(rod.node("rod.end"), sc.ground((1, 0, 0))))
    events = [sc.Event(sc.ConditionTime(0.005), sc.ActionLoad("heat", 0.0))]
    run = sc.simulate(
        model, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, 0.01, events=events, kernels=kernels
    )
    assert abs(run["energy_balance"]).max() < 1e-12
    assert run["work_loads"][-1] == pytest.approx(-0.1, rel=1e-9)
    assert run["dissipated"][-1] == pytest.approx(0.0, abs=1e-12)


def test_curvature_in_a_rest_state_closes_a_ring():
    model, rod = heated((0, 0, 0, 2 * np.pi, 0, 0), order=8)
    path = sc.static(model, watch=False)
    assert path.position(rod.node("rod.end"))[-1] == pytest.approx(np.zeros(3), abs=1e-10)
    assert path["strain_energy"][-1] < 1e-18


def test_a_bow_string_sounds_by_the_force_in_it():
    """Drawn by -F/EA between hinges: a string with a little stiffness in bending and in shear."""
    F, EI, GA, k = 2e3, 1.0, 1e6, np.pi
    section = sc.Section([GA, GA, 1e6, EI, EI, EI], 0.1, (1e-10, 1e-10))
    model, mesh = sc.Model(), sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    string = model.add("string", sc.Beam(mesh, section, order=4, director=(0, 0, 1)))
    for end, x in (("start", 0), ("end", 1)):
        hinge = sc.JointRevolute(sc.ground((x, 0, 0)), string.node(f"rod.{end}"), (0, 0, 1))
        model.add(end, hinge)
    model.add("force", sc.LoadStrain(string, (0, 0, -F / 1e6, 0, 0, 0)))
    shear = EI * k**2 / (GA - F)
    squared = (F + GA * shear) / (1 + shear) * k**2 / 0.1
    found = sc.modes(model, sc.static(model, watch=False), count=1)
    assert found.frequencies[0] == pytest.approx(np.sqrt(squared) / (2 * np.pi), rel=1e-6)


@pytest.mark.parametrize("held", [False, True])
def test_tension_is_that_of_what_is_held(held):
    """A free rod that grows is not drawn; one that is held and cooled is, beyond its limit."""
    model, rod = heated((0, 0, -0.02 if held else 0.5, 0, 0, 0), order=1)
    if held:
        model.add("wall", sc.JointFixed(rod.node("rod.end"), sc.ground((1, 0, 0))))
    told = pytest.warns(sc.AccuracyWarning, match="tension .* is above") if held else nullcontext()
    with told:
        sc.static(model, watch=False)


def test_answers_keep_loads_that_vary():
    """A strain and a force by functions of the arc length, on finer meshes than the given one."""
    model, rod = cantilever(None, order=1, elements=1)
    model.add("heat", sc.LoadStrain(rod, lambda s: (0, 0, 0.01 * s, 0, 0, 0)))
    model.add("pull", sc.LoadLine(rod, lambda s: (1e3 * s, 0, 0), part="rod"))
    place = sc.SensorPosition(rod.node("rod.end"))
    found = sc.answer(model, {"end": place}, 1e-6, until=None)
    assert found.values["end"][0] == pytest.approx(1.005 + 1e3 / (3 * 2e5), abs=1e-6)


def test_actuation_leaves_a_plane():
    """A plane scene refuses a strain that bends out of it, constant or in time, and names it."""
    for label in ("beam 'rod'", "load 'heat'"):
        strain = (0, 0, 0, 0.1, 0, 0.1)
        model, _ = cantilever(strain) if label[0] == "b" else heated(strain)
        with pytest.raises(sc.InputError, match=f"{label}.*plane"):
            model.freeze(planar=sc.Planar())


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"theory": sc.TheoryInextensible()}, "changes a strain that .* does not have"),
        ({"section": HARDENING}, "not quadratic"),
    ],
)
def test_strains_in_time_that_cannot_be(more, words):
    with pytest.raises(sc.InputError, match=words):
        heated(HEAT, **more)
