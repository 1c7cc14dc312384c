"""Modes and critical loads that are numbers of the mesh: told; those of fine meshes are not."""

import numpy as np
import pytest
from test_coarse_members import told
from test_statics import cantilever

import skfem_cosserat as sc

STEEL = sc.Material(210e9, 0.3, 7850.0)
LENGTH = 1.0


SQUARE = sc.SectionRectangle(0.01, 0.01, STEEL)


def rod(elements, order=1, theory=None, load=None):
    """A square steel rod of 1 m and 1 cm, clamped at its start, with a force along it."""
    about = {"order": order, "theory": theory, "director": (0, 0, 1)}
    model, tip = cantilever(SQUARE, elements=elements, **about)
    if load is not None:
        model.add("load", sc.LoadForce(tip, (load, 0, 0)))
    return model


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("order", "elements", "theory"),
    [
        (1, 4, None),
        (1, 8, sc.TheoryInextensible()),
        (2, 2, sc.TheoryKirchhoff()),
        (3, 1, None),
        (4, 1, sc.TheoryKirchhoff()),
    ],
)
def test_modes_that_are_off_are_named(theory, order, elements):
    """Bending modes of a clamped rod: (k l)^2 = 3.516, 22.03, 61.70; each comes twice.

    Named are those whose frequency is off by more than five percent, and no other.
    """
    model = rod(elements, order, theory)
    modes, texts = told(sc.modes, model, count=6)
    unit = np.sqrt(SQUARE.stiffness[3, 3] / SQUARE.mass) / LENGTH**2
    off = modes.omega / (unit * np.repeat([3.51602, 22.0345, 61.6972], 2)) - 1
    wrong = [str(k) for k in np.flatnonzero(off > np.sqrt(1.1) - 1)]
    named = texts[0].partition("mode ")[2].partition(":")[0].split(", ") if texts else []
    assert named == wrong
    assert modes.warnings or not wrong


def test_how_far_a_frequency_is_off_is_estimated():
    """Order 1, four elements: the third pair is 60 % too high by the closed form."""
    _, (text,) = told(sc.modes, rod(4), count=6)
    assert "order=3" in text
    share = float(text.partition("by some ")[2].partition(" %")[0])
    assert share == pytest.approx(58, abs=3)


def test_a_pulled_column_has_no_critical_load():
    """A rod under tension is stiffer than without; what is found are rotations of the mesh."""
    for elements in (4, 8):
        _, texts = told(sc.buckling, rod(elements, 3, load=100.0), 1)
        assert len(texts) == 1 and "critical factor" in texts[0]


@pytest.mark.parametrize(("order", "elements"), [(1, 1), (2, 1), (3, 1), (1, 8), (3, 4)])
def test_critical_factors_of_coarse_meshes(order, elements):
    """Euler: pi^2 EI/(4 L^2) and 9 times that, each twice; told if a tenth too high."""
    critical = np.pi**2 * SQUARE.stiffness[3, 3] / (4 * LENGTH**2)
    model = rod(elements, order, load=-critical)
    count = 2 if elements == order == 1 else 4
    found, texts = told(sc.buckling, model, count)
    off = found.factors / np.array([1.0, 1.0, 9.0, 9.0])[:count] - 1
    assert bool(texts) == bool((off > 0.1).any())


def test_modes_about_a_bent_beam():
    """Its weight stresses the rod: fine meshes say nothing, coarse ones do."""
    for elements, order in ((6, 3), (2, 1)):
        model = rod(elements, order)
        model.add("weight", sc.LoadGravity((0, 0, -9.81)))
        path, _ = told(sc.static, model, watch=False)
        _, texts = told(sc.modes, model, path, count=4)
        assert bool(texts) == (order == 1)
