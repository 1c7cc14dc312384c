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


def torsion_constant(a, b, n=400):
    """Prandtl's stress function of a rectangle by finite differences and a sine transform."""
    from scipy.fft import dstn, idstn

    k = np.arange(1, n)
    eigen_a = 4 * (n / a) ** 2 * np.sin(np.pi * k / (2 * n)) ** 2
    eigen_b = 4 * (n / b) ** 2 * np.sin(np.pi * k / (2 * n)) ** 2
    load = np.full((n - 1, n - 1), 2.0)
    phi = idstn(dstn(load, type=1) / (eigen_a[:, None] + eigen_b), type=1)
    return 2 * phi.sum() * (a / n) * (b / n)


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


@pytest.mark.parametrize("ratio", [1.0, 1.7, 6.0])
def test_rectangle_torsion_solves_prandtls_problem(ratio):
    coarse, fine = (torsion_constant(1.0, ratio, n) for n in (200, 400))
    wanted = fine + (fine - coarse) / 3  # second order
    found = SectionRectangle(1.0, ratio, STEEL).stiffness[5, 5] / G
    assert found == pytest.approx(wanted, rel=1e-6)


def test_thin_rectangle_tends_to_a_third():
    ratio = 1e4
    J = SectionRectangle(ratio, 1.0, STEEL).stiffness[5, 5] / G
    assert J / ratio == pytest.approx((1 - 0.6302 / ratio) / 3, rel=1e-7)


def area_integrals(inside, a, b, n=2000):
    """A, int X_1^2 dA, int X_2^2 dA by counting cells of a box a x b."""
    x1 = ((np.arange(n) + 0.5) / n - 0.5) * a
    x2 = ((np.arange(n) + 0.5) / n - 0.5) * b
    X1, X2 = np.meshgrid(x1, x2, indexing="ij")
    w = inside(X1, X2) * (a / n) * (b / n)
    return w.sum(), (w * X1**2).sum(), (w * X2**2).sum()


CASES = {
    "rectangle": (
        SectionRectangle(0.03, 0.01, STEEL),
        lambda x, y: (abs(x) <= 0.015) & (abs(y) <= 0.005),
        5 / 6,
    ),
    "tall rectangle": (
        SectionRectangle(0.01, 0.03, STEEL, shear_factor=0.7),
        lambda x, y: (abs(x) <= 0.005) & (abs(y) <= 0.015),
        0.7,
    ),
    "circle": (SectionCircle(0.01, STEEL), lambda x, y: x**2 + y**2 <= 1e-4, 7.8 / 8.8),
    "tube": (
        SectionTube(0.02, 0.015, STEEL, shear_factor=0.53),
        lambda x, y: (x**2 + y**2 <= 4e-4) & (x**2 + y**2 >= 2.25e-4),
        0.53,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_stiffness_and_inertia_are_the_area_integrals(name):
    """EI_1 = E int X_2^2 dA is bending about d1; M_rho^1 = rho int X_1^2 dA is inertia along d1."""
    section, inside, kappa = CASES[name]
    A, I11, I22 = area_integrals(inside, 0.05, 0.05)
    D = section.stiffness.diagonal()
    near = {"rel": 1e-3}
    assert D[0] == D[1] == pytest.approx(kappa * G * A, **near)
    assert D[2] == pytest.approx(210e9 * A, **near)
    assert D[3] == pytest.approx(210e9 * I22, **near)
    assert D[4] == pytest.approx(210e9 * I11, **near)
    assert section.mass == pytest.approx(7850 * A, **near)
    assert section.inertia == pytest.approx([7850 * I11, 7850 * I22], **near)


@pytest.mark.parametrize("name", CASES)
def test_labels_of_stiffness_and_inertia_belong_together(name):
    """EI_1 / E = M_rho^2 / rho and the other way round; off-diagonal terms are zero."""
    section = CASES[name][0]
    about = section.stiffness.diagonal()[3:5] / 210e9
    assert about == pytest.approx(section.inertia[::-1] / 7850, rel=1e-14)
    assert (section.stiffness == np.diag(section.stiffness.diagonal())).all()


def test_circle_and_tube_closed_forms():
    R, r = 0.02, 0.013
    tube = SectionTube(R, r, STEEL)
    D = tube.stiffness.diagonal()
    A, I = np.pi * (R**2 - r**2), np.pi * (R**4 - r**4) / 4  # noqa: E741 - the usual symbol
    assert D[2] == pytest.approx(210e9 * A, rel=1e-14)
    assert D[3] == D[4] == pytest.approx(210e9 * I, rel=1e-14)
    assert D[5] == pytest.approx(G * 2 * I, rel=1e-14)
    assert tube.mass == pytest.approx(7850 * A)
    circle = SectionCircle(R, STEEL)
    assert circle.stiffness[5, 5] == pytest.approx(G * np.pi * R**4 / 2)
    assert circle.stiffness[0, 0] == pytest.approx(6 * 1.3 / 8.8 * G * np.pi * R**2)
    thin = SectionTube(1.0, 1 - 1e-9, STEEL)  # Cowper: 2 (1 + nu) / (4 + 3 nu)
    kappa = thin.stiffness[0, 0] / thin.stiffness[2, 2] * 2.6
    assert kappa == pytest.approx(2 * 1.3 / 4.9, rel=1e-6)
    none = SectionTube(R, 0.0, STEEL)
    assert none.stiffness == pytest.approx(circle.stiffness)


@pytest.mark.parametrize(
    "section",
    [
        SectionRectangle(0.03, 0.01, STEEL),
        SectionCircle(0.01, STEEL),
        SectionTube(0.02, 0.01, STEEL),
    ],
)
def test_outline_is_the_section(section):
    """A closed polygon, counter-clockwise, of about the section's outer size."""
    x, y = section.outline.T
    area = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    assert 0.9 * section.stiffness[2, 2] / 210e9 < area < 1.5 * section.stiffness[2, 2] / 210e9


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
