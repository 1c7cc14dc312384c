"""Sections against tables and numerical integrals over their area."""

from __future__ import annotations

import numpy as np
import pytest

from skfem_cosserat import (
    InputError,
    Material,
    Section,
    SectionCircle,
    SectionRectangle,
    SectionTube,
)

STEEL = Material(E=210e9, nu=0.3, rho=7850)
G = 210e9 / 2.6
#: J = beta long short^3: Timoshenko & Goodier, Theory of Elasticity, table of section 109
TORSION = {1.0: 0.1406, 1.2: 0.166, 1.5: 0.196, 2.0: 0.229, 2.5: 0.249, 3: 0.263, 4: 0.281}
TORSION |= {5.0: 0.291, 10.0: 0.312}


def test_material():
    for material, shear in ((STEEL, 80769230769.23077), (Material(1.0, 0.5, 1.0), 1 / 3)):
        assert pytest.approx(shear) == material.G


@pytest.mark.parametrize("ratio", TORSION)
def test_rectangle_torsion_is_that_of_the_table(ratio):
    short, long = 0.01, 0.01 * ratio
    for edges in ((short, long), (long, short)):
        J = SectionRectangle(*edges, STEEL).stiffness[5, 5] / G
        assert J / (long * short**3) == pytest.approx(TORSION[ratio], abs=6e-4)


@pytest.mark.parametrize(("ratio", "beta"), [(1.0, 0.1405770), (2.0, 0.2286817)])
def test_rectangle_torsion_to_seven_digits(ratio, beta):
    J = SectionRectangle(1.0, ratio, STEEL).stiffness[5, 5] / G
    assert J / ratio == pytest.approx(beta, abs=6e-8)


def test_thin_rectangle_tends_to_a_third():
    ratio = 1e4
    J = SectionRectangle(ratio, 1.0, STEEL).stiffness[5, 5] / G
    assert J / ratio == pytest.approx((1 - 0.6302 / ratio) / 3, rel=1e-7)


@pytest.mark.parametrize("factor", [None, 0.7])
def test_rectangle(factor):
    """EI_1 = E int X_2^2 dA is bending about d1; M_rho^1 = rho int X_1^2 dA is inertia along d1."""
    more = {} if factor is None else {"shear_factor": factor}
    section = SectionRectangle(0.03, 0.01, STEEL, **more)
    A, about = 3e-4, 3e-4 * np.array([0.01**2, 0.03**2]) / 12
    shear = (factor or 5 / 6) * G * A
    D = section.stiffness.diagonal()
    assert (section.stiffness == np.diag(D)).all()
    assert D[:5] == pytest.approx([shear, shear, 210e9 * A, *(210e9 * about)], rel=1e-14)
    assert section.mass == pytest.approx(7850 * A)
    assert section.inertia == pytest.approx(7850 * about[::-1])


def test_circle_and_tube():
    R, r = 0.02, 0.013
    A, I = np.pi * (R**2 - r**2), np.pi * (R**4 - r**4) / 4  # noqa: E741 - the usual symbol
    tube = SectionTube(R, r, STEEL, shear_factor=0.53)
    wanted = [0.53 * G * A, 0.53 * G * A, 210e9 * A, 210e9 * I, 210e9 * I, G * 2 * I]
    assert tube.stiffness == pytest.approx(np.diag(wanted), rel=1e-14)
    assert [tube.mass, *tube.inertia] == pytest.approx([7850 * A, 7850 * I, 7850 * I])
    circle = SectionCircle(R, STEEL)
    assert circle.stiffness[5, 5] == pytest.approx(G * np.pi * R**4 / 2)
    assert circle.stiffness[0, 0] == pytest.approx(6 * 1.3 / 8.8 * G * np.pi * R**2)
    assert SectionTube(R, 0.0, STEEL).stiffness == pytest.approx(circle.stiffness)
    thin = SectionTube(1.0, 1 - 1e-9, STEEL)  # Cowper: 2 (1 + nu) / (4 + 3 nu)
    kappa = thin.stiffness[0, 0] / thin.stiffness[2, 2] * 2.6
    assert kappa == pytest.approx(2 * 1.3 / 4.9, rel=1e-6)


@pytest.mark.parametrize(
    ("section", "area"),
    [
        (SectionRectangle(0.03, 0.01, STEEL), 3e-4),
        (SectionCircle(0.01, STEEL), np.pi * 1e-4),
        (SectionTube(0.02, 0.01, STEEL), np.pi * 4e-4),
    ],
)
def test_outline_is_the_section(section, area):
    """A closed polygon, counter-clockwise, of about the section's outer size."""
    x, y = section.outline.T
    assert 0.9 * area < 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() < 1.001 * area


def test_full_stiffness_is_kept():
    A = np.random.default_rng(0).standard_normal((6, 6))
    D = A @ A.T + np.eye(6)
    section = Section(D, mass=1.0, inertia=(0.1, 0.0))
    assert section.stiffness == pytest.approx(D, rel=1e-15)
    assert (section.stiffness == section.stiffness.T).all()
    assert Section(np.ones(6), 1.0, (0, 0)).stiffness == pytest.approx(np.eye(6))


def test_constants_go_where_they_belong():
    section = Section.from_constants(
        EA=3.0, GA=(1.0, 2.0), EI=(4.0, 5.0), GJ=6.0, mass=7.0, inertia=(8.0, 9.0)
    )
    assert section.stiffness.diagonal().tolist() == [1, 2, 3, 4, 5, 6]
    assert (section.mass, section.inertia.tolist()) == (7, [8, 9])


def test_a_section_is_not_changed_by_its_arguments():
    D = np.eye(6)
    section = Section(D, 1.0, (1, 1))
    D[0, 0] = 5
    assert section.stiffness[0, 0] == 1


def test_a_negative_eigenvalue_is_refused_however_the_units_differ():
    D = np.diag([1e9, 1e9, 1e9, 1e-3, 1e-3, 1e-3])
    Section(D, 1.0, (1, 1))
    D[2, 3] = D[3, 2] = 1.001e3  # square root of the product is 1e3
    with pytest.raises(InputError, match="not positive definite"):
        Section(D, 1.0, (1, 1))
