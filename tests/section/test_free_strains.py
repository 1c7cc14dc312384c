"""Strains at which sections are free of stress: heat, growth, prestress."""

from __future__ import annotations

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat.diagnostics import evaluate

SECTION = sc.Section([1e5, 1e5, 2e5, 30.0, 30.0, 20.0], 1.0, (1e-3, 1e-3))
THEORIES = pytest.mark.parametrize("theory", [None, sc.TheoryKirchhoff()], ids=repr)


def cantilever(strain, theory=None, order=4, elements=3):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
    more = {"order": order, "director": (0, 1, 0), "theory": theory, "strain": strain}
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, SECTION, **more))
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
