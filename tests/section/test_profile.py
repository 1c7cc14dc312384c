"""Profiles against closed forms of Saint-Venant's problems, other formulations and beams."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest
import skfem

import skfem_cosserat as sc
from skfem_cosserat import (
    MaterialAnisotropic,
    Profile,
    ProfileBox,
    ProfileChannel,
    ProfileCircle,
    ProfileComposite,
    ProfileI,
    ProfilePolygon,
    ProfileRectangle,
    ProfileRectangles,
    ProfileRings,
    ProfileTube,
    Region,
)
from skfem_cosserat.profile import ProfileConstants
from skfem_cosserat.profile.warping import elasticity, solve_warping

STEEL = sc.Material(210e9, 0.3, 7850.0)
ALUMINIUM = sc.Material(70e9, 0.3, 2700.0)
#: fibres along the beam, with different shear moduli in both planes
PLY = MaterialAnisotropic.orthotropic((9e9, 12e9, 140e9), (3e9, 6e9, 4e9), (0.02, 0.03, 0.4), 1600)
L_SHAPE = np.array([(0, 0), (0.1, 0), (0.1, 0.01), (0.01, 0.01), (0.01, 0.08), (0, 0.08)])


def polygon(*arguments):
    """A polygon; the test is skipped where the extra is not installed that polygons need."""
    pytest.importorskip("shapely")
    return ProfilePolygon(*arguments)


def part(*arguments):
    """A region; see `polygon`."""
    pytest.importorskip("shapely")
    return Region(*arguments)


def isotropic(nu):
    return sc.Material(2 * (1 + nu), nu, 1.0)  # G = 1


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


# -- rectangles --------------------------------------------------------------------------------


def rectangle_torsion(a, b, ratio=1.0):
    """GJ for G_13 = 1 and G_23 = ratio: Prandtl's function of the stretched rectangle."""
    a = a * np.sqrt(ratio)
    short, long = min(a, b), max(a, b)
    k = np.arange(1, 400, 2)
    series = (np.tanh(k * np.pi * long / (2 * short)) / k**5.0).sum()
    J = long * short**3 * (1 / 3 - 64 / np.pi**5 * short / long * series)
    return J / np.sqrt(ratio)


def rectangle_shear_factor(a, b, nu):
    """Energy of the flexure of Timoshenko & Goodier, section 124, for a force along the edge a."""
    a, b = a / 2, b / 2
    m, n = 2 * np.arange(400)[:, None] + 1, np.arange(1, 2000)
    squares = ((m * np.pi / (2 * a)) ** 2 + (n * np.pi / b) ** 2) * m**2 * n**2
    moment = 4 * b * a**3 / 3
    c = nu / ((1 + nu) * moment)
    return 1 / (6 / 5 + 4 * a * b * c**2 * a * b * 64 * b**2 / np.pi**4 * (1 / squares).sum())


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "nu"), [(1.0, 0.3), (2.0, 0.0), (5.0, 0.3), (10.0, 0.3)])
def test_rectangle(ratio, nu):
    found = ProfileRectangle(1.0, ratio, isotropic(nu)).constants()
    assert found.error <= 1e-4
    assert found.torsion_constant == pytest.approx(rectangle_torsion(1, ratio), rel=1e-5)
    wanted = rectangle_shear_factor(1, ratio, nu), rectangle_shear_factor(ratio, 1, nu)
    assert found.shear_factors == pytest.approx(wanted, rel=1e-4)
    assert [found.EA, *found.EI.diagonal()] == pytest.approx(
        2 * (1 + nu) * ratio * np.array([1, ratio**2 / 12, 1 / 12]), rel=1e-9
    )


@pytest.mark.slow
def test_existing_sections_agree():
    """All but the shear factors, for which they take Cowper's definition or 5/6."""
    for section, profile in (
        (sc.SectionRectangle(0.02, 0.03, STEEL), ProfileRectangle(0.02, 0.03, STEEL)),
        (sc.SectionCircle(0.02, STEEL), ProfileCircle(0.02, STEEL)),
        (sc.SectionTube(0.02, 0.015, STEEL), ProfileTube(0.02, 0.015, STEEL)),
    ):
        mine = profile.section()
        diagonal = section.stiffness.diagonal()
        difference = (mine.stiffness - section.stiffness) / np.sqrt(np.outer(diagonal, diagonal))
        assert abs(difference[2:]).max() < 1e-5
        assert mine.mass == pytest.approx(section.mass, rel=2e-6)
        assert mine.inertia == pytest.approx(section.inertia, rel=4e-6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [skfem.MeshTri, skfem.MeshQuad])
def test_torsion_constant_converges(kind):
    """Warping has r^2 log r at a corner: h^4 with order 3, and h^4 (c - log h) with order 2."""
    counts = np.array([4, 8, 16])
    errors = {2: [], 3: []}
    for n in counts:
        mesh = kind.init_tensor(np.linspace(-0.5, 0.5, n + 1), np.linspace(-1, 1, 2 * n + 1))
        index = np.zeros(mesh.nelements, dtype=int)
        for order, row in errors.items():
            found = solve_warping(mesh, order, index, elasticity(isotropic(0.3))[None])
            row.append(1 / found.compliance[5, 5] / rectangle_torsion(1, 2) - 1)
    assert np.min(errors[2]) > 0 and np.min(errors[3]) > 0  # from above
    assert np.log2(np.divide(errors[3][:-1], errors[3][1:])) == pytest.approx([4, 4], abs=0.02)
    steps = np.diff(errors[2] * counts**4)
    assert steps[1] == pytest.approx(steps[0], rel=0.02)


@pytest.mark.slow
def test_corners_slow_down_uniform_meshes_and_not_refined_ones():
    """At a corner of 270 degrees the energy converges with 4/3; the default mesh knows."""
    energies = []
    for n in (16, 32, 64):
        mesh = skfem.MeshTri.init_tensor(*2 * (np.linspace(-1, 1, n + 1),))
        right = mesh.p[:, mesh.t].mean(axis=1) > 0
        mesh = mesh.remove_elements(np.flatnonzero(right.all(axis=0)))
        index = np.zeros(mesh.nelements, dtype=int)
        found = solve_warping(mesh, 2, index, elasticity(isotropic(0.0))[None])
        energies.append(1 / found.compliance[5, 5])
    steps = -np.diff(energies)
    assert np.log2(steps[0] / steps[1]) == pytest.approx(4 / 3, abs=0.1)
    limit = energies[-1] - steps[-1] / (2 ** (4 / 3) - 1)
    parts = ((-1, 0), (-1, 1)), ((0, 1), (-1, 0))
    refined = ProfileRectangles([(*ends, isotropic(0.0)) for ends in parts]).constants()
    assert limit * (1 - 1e-5) < refined.GJ < limit * (1 + 3e-5)
    assert energies[-1] > refined.GJ and refined.elements < mesh.nelements / 4


# -- round sections ----------------------------------------------------------------------------


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("inner", "nu"), [(0.0, 0.3), (0.0, 0.0), (0.0, 0.49), (0.3, 0.0), (0.3, 0.3), (0.98, 0.3)]
)
def test_circle_and_tube(inner, nu):
    """Shear factors by the energy of Love's flexure (Theory of Elasticity, section 231)."""
    profile = ProfileTube(1.0, inner, isotropic(nu)) if inner else ProfileCircle(1.0, isotropic(nu))
    found = profile.constants()
    assert found.area == pytest.approx(np.pi * (1 - inner**2), rel=1e-6)
    assert found.torsion_constant == pytest.approx(np.pi / 2 * (1 - inner**4), rel=5e-6)
    squares = (1 + inner**2) ** 2
    wanted = 6 * (1 + nu) ** 2 * squares
    wanted /= (7 + 14 * nu + 8 * nu**2) * squares + 4 * (5 + 10 * nu + 4 * nu**2) * inner**2
    assert found.shear_factors == pytest.approx([wanted, wanted], rel=1e-4 if inner else 1e-5)


def half_disk():
    """The elements of a disk above its middle, in the order of nodes of mesh files."""
    disk = ProfileCircle(1.0, isotropic(0.3)).mesh
    nodes = disk.dofs.element_dofs[:, disk.p[1, disk.t].mean(axis=0) > 0]
    used, t = np.unique(nodes, return_inverse=True)
    return skfem.MeshTri2(disk.doflocs[:, used], t.reshape(nodes.shape))


@pytest.mark.slow
@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_shear_centre_of_a_half_disk(nu):
    """8/(5 pi): Timoshenko & Goodier, section 125, where nu = 0; Trefftz's for all nu."""
    found = Profile(half_disk(), isotropic(nu)).constants(3e-5)
    assert found.area == pytest.approx(np.pi / 2, rel=2e-5)
    assert found.centroid == pytest.approx([0, 4 / (3 * np.pi)], abs=1e-5)
    assert found.shear_centre == pytest.approx([0, 8 / (5 * np.pi)], abs=5e-5)
    # torsion constant of Saint-Venant's table (Roark): 0.2976 r^4
    assert found.torsion_constant == pytest.approx(0.2976, abs=1e-4)


# -- polygons and walls ------------------------------------------------------------------------


@pytest.mark.slow
def test_thin_angle():
    """Its shear centre is where both legs meet, with an error of order t^2; sum of b t^3/3."""
    wrong = []
    for t in (0.005, 0.0025):
        corners = np.array([(0, 0), (0.1, 0), (0.1, t), (t, t), (t, 0.08), (0, 0.08)])
        found = polygon(corners - t / 2, STEEL).constants(1e-3)
        J = t**3 / 3 * (0.18 - t)
        wrong.append([*found.shear_centre, 1 - found.torsion_constant / J])
    assert np.log2(np.divide(*wrong)) == pytest.approx([2, 2, 1], abs=0.1)


def test_area_and_moments_of_a_polygon_with_a_hole():
    hole = np.array([(0.2, 0.2), (0.7, 0.3), (0.3, 0.6)])
    profile = polygon([(0, 0), (2, 0), (2, 1), (0, 1), (0, 0)], STEEL, [hole])
    found = profile.constants(1e-2)
    a, centre = (0.5 * 0.4 - 0.1 * 0.1) / 2, hole.mean(0)  # of the hole, by hand
    own = a / 12 * ((hole.T @ hole) + 9 * np.outer(centre, centre))
    assert found.area == pytest.approx(2 - a, rel=1e-12)
    assert found.centroid == pytest.approx(([2, 1] - a * centre) / (2 - a))
    assert found.second_moments == pytest.approx([[8 / 3, 1], [1, 2 / 3]] - own, rel=1e-10)
    assert profile.outline.shape == (4, 2)  # closed by itself
    assert profile.holes[0].shape == (3, 2)


@pytest.mark.slow
def test_thin_walls_open():
    """I and channel: sum of b t^3/3 with an error of order t, shear centre with t^2."""
    wrong_J, wrong_e = [], []
    for t in (0.04, 0.02, 0.01):
        beam = ProfileI(1 + t, 1.0, t, t, isotropic(0.0)).constants(1e-3)
        wrong_J.append(beam.torsion_constant / (3 * t**3 / 3) - 1)
        channel = ProfileChannel(1 + t, 0.5 + t / 2, t, t, isotropic(0.0)).constants(1e-3)
        wrong_e.append(channel.shear_centre[0] / -(3 * 0.5**2 / (1 + 6 * 0.5)) - 1)
    assert abs(wrong_J[-1]) < 0.005 and abs(wrong_e[-1]) < 0.01
    assert np.log2(np.divide(wrong_J[:-1], wrong_J[1:])) == pytest.approx([1, 1], abs=0.3)
    assert np.log2(np.divide(wrong_e[:-1], wrong_e[1:])) == pytest.approx([2, 2], abs=0.05)


@pytest.mark.slow
def test_thin_walls_closed():
    """A box by Bredt's second formula, with an error of order t."""
    wrong = []
    for t in (0.08, 0.04, 0.02):
        box = ProfileBox(1 + t, 0.5 + t, t, isotropic(0.3)).constants(1e-3)
        wrong.append(box.torsion_constant / (4 * 0.5**2 * t / 3) - 1)
    assert 0 < wrong[-1] < 0.02
    assert np.log2(np.divide(wrong[:-1], wrong[1:])) == pytest.approx([1.5, 1.5], abs=0.6)


@pytest.mark.slow
def test_tolerance_bounds_the_error():
    best = polygon(L_SHAPE, STEEL).constants()
    for tolerance in (1e-1, 1e-2, 1e-3):
        found = polygon(L_SHAPE, STEEL).constants(tolerance)
        true = abs(np.linalg.eigvals(found.compliance @ best.stiffness) - 1).max()
        assert true < found.error <= tolerance


@pytest.mark.slow
def test_rolled_beam_of_the_tables():
    """IPE 200 with its fillets, by the tables of EN 10365 (torsion there is an approximation)."""
    web, flange, r = 0.0028, 0.0085, 0.012
    angle = np.linspace(0, np.pi / 2, 17)
    fillet = [web + r - r * np.sin(angle), 0.1 - flange - r + r * np.cos(angle)]
    quarter = np.vstack([[(0.05, 0.1), (0.05, 0.1 - flange)], np.transpose(fillet)])
    half = np.vstack([quarter, (quarter * (1, -1))[::-1]])
    found = polygon(np.vstack([half, -half]), STEEL).constants(1e-3)
    assert found.area == pytest.approx(28.48e-4, rel=1e-3)
    assert found.EI.diagonal() / STEEL.E == pytest.approx([1943e-8, 142.4e-8], rel=1e-3)
    assert found.torsion_constant == pytest.approx(6.98e-8, rel=0.03)


@pytest.mark.slow
def test_meshes_of_the_users():
    """Straight quadrilaterals are refined all over; curved elements are taken as they are."""
    mesh = skfem.MeshQuad.init_tensor(np.linspace(0, 1, 2), np.linspace(0, 2, 3))
    found = Profile(mesh, isotropic(0.3)).constants()
    assert found.elements > 2 and found.elements % 2 == 0
    assert found.torsion_constant == pytest.approx(rectangle_torsion(1, 2), rel=3e-5)
    disk = ProfileCircle(1.0, isotropic(0.3)).mesh
    ellipse = Profile(replace(disk, doflocs=disk.doflocs * [[2.0], [1.0]]), isotropic(0.3))
    assert ellipse.constants().torsion_constant == pytest.approx(np.pi * 8 / 5, rel=5e-6)
    bent = skfem.MeshQuad2.from_mesh(mesh)
    bent = replace(bent, doflocs=bent.doflocs + [[0.1], [0]] * np.sin(bent.doflocs[1]))
    assert Profile(bent, isotropic(0.3)).constants(0.2).error < 0.2
    with pytest.raises(sc.InputError, match="tolerance = 1e-06 is not reached with 2 elements"):
        Profile(bent, isotropic(0.3)).constants(1e-6)


# -- several materials -------------------------------------------------------------------------


@pytest.mark.slow
def test_concentric_layers():
    """Modulus of composite cylinders (Hill, J. Mech. Phys. Solids 12 (1964) 199), sum of GJ."""
    core, coat = sc.Material(3.0, 0.45, 1.0), sc.Material(1.0, 0.1, 2.0)
    found = ProfileRings((0, 0.6, 1.0), (core, coat)).constants()
    f = 0.36
    bulk = [each.E / (2 * (1 + each.nu) * (1 - 2 * each.nu)) for each in (core, coat)]
    lateral = 4 * f * (1 - f) * (core.nu - coat.nu) ** 2
    lateral /= (1 - f) / bulk[0] + f / bulk[1] + 1 / coat.G
    assert found.EA / np.pi == pytest.approx(f * core.E + (1 - f) * coat.E + lateral, rel=1e-5)
    assert lateral > 1e-2  # not a sum of bars
    assert found.GJ / (np.pi / 2) == pytest.approx(
        core.G * 0.6**4 + coat.G * (1 - 0.6**4), rel=1e-5
    )
    assert found.mass == pytest.approx(np.pi * (0.36 + 2 * 0.64), rel=1e-5)


def test_equal_materials_in_parts_are_one():
    halves = [((0, 1), (0, 1), STEEL), ((1, 2), (0, 1), replace(STEEL))]
    assert len(ProfileRectangles(halves).materials) == 1


def two_rectangles(top):
    """Of width 0.02: E and G of two layers under and over the line."""
    x = (-0.01, 0.01)
    return ProfileRectangles([(x, (-0.01, 0.0), STEEL), (x, (0.0, 0.016), top)])


@pytest.mark.slow
def test_layers_with_one_poisson_ratio_add_up():
    found = two_rectangles(ALUMINIUM).constants()
    areas, heights = 0.02 * np.array([0.01, 0.016]), np.array([0.01, 0.016])
    E, y = np.array([210e9, 70e9]), np.array([-0.005, 0.008])
    EA, ES = (E * areas).sum(), (E * areas * y).sum()
    about = (E * areas * (heights**2 / 12 + y**2)).sum()
    D = found.stiffness
    assert [D[2, 2], D[2, 3], D[3, 3]] == pytest.approx([EA, ES, about], rel=1e-9)
    assert found.elastic_centre == pytest.approx([0, ES / EA], abs=1e-12)
    assert found.EI[0, 0] == pytest.approx(about - ES**2 / EA, rel=1e-9)
    assert found.EI[1, 1] == pytest.approx((E * areas).sum() * 0.02**2 / 12, rel=1e-9)


def assert_same_stiffness(one, two, tolerance):
    """Entries against the diagonal."""
    scale = np.sqrt(np.outer(one.stiffness.diagonal(), one.stiffness.diagonal()))
    assert abs((one.stiffness - two.stiffness) / scale).max() < tolerance


@pytest.mark.slow
def test_layers_of_rectangles_and_of_polygons_agree():
    layers = [
        part([(-0.01, low), (0.01, low), (0.01, high), (-0.01, high)], material)
        for low, high, material in ((-0.01, 0, STEEL), (0, 0.016, ALUMINIUM))
    ]
    polygons = ProfileComposite(layers).constants()
    assert_same_stiffness(polygons, two_rectangles(ALUMINIUM).constants(), 2e-5)


@pytest.mark.slow
def test_region_in_a_hole_and_corners_on_edges():
    """A core in a shell, cut so that corners of one region lie on edges of the others."""
    outer = [(0, 0), (3, 0), (3, 2), (0, 2)]
    lower = [(1, 0.5), (2, 0.5), (2, 1.1), (1, 0.9)]
    upper = [(1, 0.9), (2, 1.1), (2, 1.5), (1, 1.5)]
    shell = part(outer, STEEL, [[*lower[:2], *upper[2:]]])
    parts = ProfileComposite([shell, part(lower, STEEL), part(upper, STEEL)]).constants()
    assert_same_stiffness(parts, polygon(outer, STEEL).constants(), 5e-5)


# -- anisotropic materials ---------------------------------------------------------------------


@pytest.mark.slow
def test_orthotropic_rectangle():
    found = ProfileRectangle(1.0, 2.0, PLY).constants()
    assert pytest.approx(140e9 * 2, rel=1e-9) == found.EA
    assert found.EI.diagonal() == pytest.approx([140e9 * 8 / 12, 140e9 * 2 / 12], rel=1e-9)
    # G_13 = 6e9, G_23 = 3e9
    assert pytest.approx(6e9 * rectangle_torsion(1.0, 2.0, 0.5), rel=1e-5) == found.GJ


@pytest.mark.slow
def test_isotropic_is_a_case_of_anisotropic():
    same = MaterialAnisotropic.orthotropic(3 * [210e9], 3 * [STEEL.G], 3 * [0.3], STEEL.rho)
    turned = same.rotated(np.linalg.qr(np.vander([1.0, 2, 4]))[0])
    plain, other = (ProfileRectangle(0.01, 0.02, each).constants() for each in (STEEL, turned))
    assert_same_stiffness(plain, other, 1e-7)


@pytest.mark.slow
def test_fibres_across_couple_tension_and_shear():
    """A homogeneous bar under tension: uniform stress, strains of the material's compliance."""
    c, s = np.cos(0.4), np.sin(0.4)
    off = PLY.rotated([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    found = ProfileRectangle(0.3, 0.2, off).constants()
    S = np.linalg.inv(off.elasticity)
    assert found.compliance[2, 2] == pytest.approx(S[2, 2] / 0.06, rel=1e-9)
    assert found.compliance[0, 2] == pytest.approx(S[4, 2] / 0.06, rel=1e-9)
    assert abs(found.compliance[1, 2]) < 1e-9 * S[2, 2] / 0.06


# -- frames and units --------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("material", [STEEL, PLY], ids=["isotropic", "orthotropic"])
def test_moved_and_turned(material):
    """The constants of a moved and turned shape are the moved and turned constants."""
    angle, shift = 0.6, np.array([0.3, -0.2])
    turned = rotation(angle)
    other = material
    if material is PLY:
        full = np.eye(3)
        full[:2, :2] = turned
        other = material.rotated(full)
    plain = polygon(L_SHAPE, material).constants()
    moved = polygon(L_SHAPE @ turned.T + shift, other).constants()
    # in two steps back
    back = moved.moved(shift, 0.2).moved((0, 0), angle - 0.2)
    assert_same_stiffness(back, plain, 1e-4)
    for name in ("centroid", "centre", "elastic_centre", "inertia"):
        assert getattr(back, name) == pytest.approx(getattr(plain, name), rel=1e-9, abs=1e-9)
    assert back.second_moments == pytest.approx(plain.second_moments, rel=1e-9)
    assert back.shear_moduli == pytest.approx(plain.shear_moduli, rel=1e-9, abs=1e-3)
    corners, wanted = (each[np.lexsort(each.round(9).T)] for each in (back.outline, plain.outline))
    assert corners == pytest.approx(wanted, abs=1e-12)
    assert back.shear_centre == pytest.approx(plain.shear_centre, abs=1e-6)
    assert moved.shear_centre == pytest.approx(turned @ plain.shear_centre + shift, abs=1e-6)
    assert moved.principal_EI[0] == pytest.approx(plain.principal_EI[0], rel=1e-4)


def test_units():
    """Metres and newtons, or millimetres, newtons and tonnes."""
    metres = ProfileI(0.2, 0.1, 0.01, 0.008, STEEL).constants(0.5)
    other = sc.Material(210e3, 0.3, 7.85e-9)
    tonnes = ProfileI(200, 100, 10, 8, other).constants(0.5)
    unit = 1e3 ** np.array([0, 0, 0, 1, 1, 1])
    wanted = metres.stiffness * np.outer(unit, unit)
    scale = np.sqrt(np.outer(wanted.diagonal(), wanted.diagonal()))
    assert tonnes.stiffness / scale == pytest.approx(wanted / scale, abs=2e-9)
    assert tonnes.shear_factors == pytest.approx(metres.shear_factors, rel=2e-9)
    assert tonnes.mass == pytest.approx(metres.mass * 1e-6, rel=1e-12)


# -- stresses ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_stresses_have_the_resultants_and_their_energy():
    found = two_rectangles(sc.Material(70e9, 0.2, 2700.0)).constants(1e-3).moved((0.1, 0.3), 0.5)
    dA = found.warping.basis.dx.ravel()
    for k, load in enumerate(np.eye(6)):
        x, (_, _, s33, s23, s13, _) = found.stresses(load)
        parts = (s13, s23, s33, x[1] * s33, -x[0] * s33, x[0] * s23 - x[1] * s13)
        assert [(part * dA).sum() for part in parts] == pytest.approx(load, abs=1e-10)
        energy = found.warping.energies(found.warping.strains)
        assert energy.shape == (6, found.elements), k


@pytest.mark.slow
def test_stresses_of_a_twisted_circle():
    x, stress = ProfileCircle(0.1, STEEL).constants().stresses((0, 0, 0, 0, 0, 50.0))
    wanted = np.zeros_like(stress)
    wanted[3:5] = 50 / (np.pi / 2 * 1e-4) * np.array([x[0], -x[1]])
    assert abs(stress - wanted).max() < 2e-4 * abs(wanted).max()


@pytest.mark.slow
def test_stresses_of_a_sheared_rectangle():
    """Parabola over the height where nu = 0."""
    found = ProfileRectangle(0.01, 0.02, isotropic(0.0)).constants()
    x, stress = found.stresses((0, 7.0, 0, 0, 0, 0))
    assert stress[3] == pytest.approx(1.5 * 7 / 2e-4 * (1 - (x[1] / 0.01) ** 2), rel=1e-8)
    assert abs(stress[[0, 1, 2, 4, 5]]).max() < 1e-6 * abs(stress[3]).max()


# -- beams -------------------------------------------------------------------------------------


def example():
    return importlib.import_module("cross_sections")


@pytest.mark.slow
def test_composite_beam_is_parallel_beams_joined():
    """Bent to an arc of 0.6 rad and stretched by 1.5e-3: one beam and two, against theory."""
    largest = []
    for elements in (4, 8):
        errors = {"moment": [], "pull": []}
        for row in example().composite(elements=elements):
            errors[row["load"]].append(row["error"])
        assert max(errors["pull"]) < 1e-14
        largest.append(max(errors["moment"]))
    assert largest[1] < 3e-7
    assert np.log2(largest[0] / largest[1]) == pytest.approx(4, abs=0.2)


@pytest.mark.slow
def test_examples_closed_forms():
    for row in example().closed_forms():
        assert row["computed"] == pytest.approx(row["exact"], rel=1e-5), row["name"]


@pytest.mark.slow
def test_mass_goes_along():
    section = two_rectangles(ALUMINIUM).section(tolerance=1e-2, origin=(0.01, 0.0))
    weights = np.array([7850 * 0.01, 2700 * 0.016]) * 0.02
    moment = weights @ [-0.005, 0.008]
    assert section.mass == pytest.approx(weights.sum())
    assert section.centre == pytest.approx([-0.01, moment / weights.sum()], rel=1e-9)
    heights = weights @ np.array([0.01**2, 0.016**2]) / 3
    widths = weights.sum() * (0.01**2 + 0.02**2 / 12)
    wanted = np.array([[widths, -0.01 * moment], [-0.01 * moment, heights]])
    assert section.inertia == pytest.approx(wanted, rel=1e-9)


def test_shows_itself():
    text = str(ProfileRectangle(0.01, 0.02, STEEL).constants(1e-2))
    assert "torsion constant" in text and "shear factors" in text
    assert all(len(line) <= 70 for line in text.splitlines())
    assert (
        repr(ProfileBox(0.1, 0.1, 0.01, STEEL)) == "ProfileBox(32 elements, 1 materials, 1 holes)"
    )


@pytest.mark.slow
def test_plots():
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    ax = two_rectangles(ALUMINIUM).plot()
    assert len(ax.collections) == 1 and len(ax.patches) == 1


# -- bad input ---------------------------------------------------------------------------------

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
FAR = skfem.MeshTri().refined(1)


#: of polygons: outline, holes
BAD_POLYGONS = {
    r"polygon: outline has shape \(2, 2": (SQUARE[:2],),
    "outline crosses or touches itself": ([(0, 0), (1, 1), (1, 0), (0, 1)],),
    r"corner 1 at \[1.0, 0.0\] is repeated": ([*SQUARE[:2], *SQUARE[1:]],),
    "has no area": ([(0, 0), (1, 1), (2, 2)],),
    "outline is not finite at corner 3": ([*SQUARE[:3], (np.nan, 1)],),
    "hole 0 is not inside the outline, or touches": (SQUARE, [np.array(SQUARE) / 2]),
    "holes 0 and 1 overlap": (SQUARE, [np.array(SQUARE) / 4 + s for s in (0.3, 0.4)]),
}


@pytest.mark.parametrize("message", BAD_POLYGONS)
def test_bad_polygons(message):
    outline, *holes = BAD_POLYGONS[message]
    with pytest.raises(sc.InputError, match=message):
        polygon(outline, STEEL, *holes)


#: of two squares, the second one shifted
@pytest.mark.parametrize(
    ("shift", "message"),
    [(0.5, "regions 0 and 1 overlap by an area of 0.25"), (1, "falls into 2 parts.* no edge")],
)
def test_regions_that_overlap_or_fall_apart(shift, message):
    with pytest.raises(sc.InputError, match=message):
        ProfileComposite([part(SQUARE, STEEL), part(np.array(SQUARE) + shift, STEEL)])


#: of meshes: what is changed, and materials
BAD_MESHES = {
    "mesh has no elements": {"t": np.zeros((3, 0), dtype=int)},
    "not two finite numbers": {"doflocs": FAR.p * np.nan},
    "no area": {"doflocs": FAR.p * [[1.0], [0]]},
    "an edge of the mesh belongs to": {"t": np.hstack([FAR.t, FAR.t[:, :1], FAR.t[:, :1]])},
}


@pytest.mark.parametrize("message", BAD_MESHES)
def test_bad_meshes(message):
    with pytest.raises(sc.InputError, match=message):
        Profile(replace(FAR, **BAD_MESHES[message]), STEEL)


WEB = FAR.with_subdomains({"web": np.array([0]), "all": np.arange(8)})
SOFT = sc.Material(1.0, 0.5, 1.0)
#: what is called with which arguments
BAD = {
    "no regions": (ProfileComposite, []),
    "region 0 = .* expected a Region": (ProfileComposite, [SQUARE]),
    "material = 'steel'": (ProfileRectangle, 1, 1, "steel"),
    "nu = 0.5: .*0.495": (ProfileRectangle, 1, 1, SOFT),
    "rectangle: b = -1": (ProfileRectangle, 1, -1, STEEL),
    "circle: radius = -1": (ProfileCircle, -1, STEEL),
    "tube: inner = 1, expected inner < outer": (ProfileTube, 1, 1, STEEL),
    "rings: radii": (ProfileRings, (0, 2, 1), (STEEL, STEEL)),
    "segments = 20": (ProfileRings, (0, 1), (STEEL,), 20),
    "I: height = 0.1": (ProfileI, 0.1, 0.1, 0.05, 0.01, STEEL),
    "channel: flange = 0.01": (ProfileChannel, 0.1, 0.01, 0.01, 0.01, STEEL),
    "box: thickness = 0.05": (ProfileBox, 0.1, 0.1, 0.05, STEEL),
    "I: width": (ProfileI, 1, (1, 2, 3), 0.1, 0.1, STEEL),
    "rectangles 0 and 1 overlap": (
        ProfileRectangles,
        [((0, 2), (0, 1), STEEL), ((1, 3), (0, 1), STEEL)],
    ),
    "rectangle 0: ends .* expected a < b": (ProfileRectangles, [((2, 0), (0, 1), STEEL)]),
    "falls into 2 parts": (
        ProfileRectangles,
        [((0, 1), (0, 1), STEEL), ((2, 3), (0, 1), STEEL)],
    ),
    "mesh is a MeshLine1, expected": (Profile, skfem.MeshLine(), STEEL),
    "subdomain 'flange' is unknown": (Profile, WEB, {"flange": STEEL}),
    "7 of 8 elements are in none of": (Profile, WEB, {"web": STEEL}),
    "subdomains 'all' and 'web' share": (Profile, WEB, {"all": STEEL, "web": PLY}),
    "tolerance = 0.0": (ProfileRectangle(1, 1, STEEL).constants, 0.0),
    r"tolerance = 1e-06 is not reached with \d+ elements: error": (
        ProfileI(0.2, 0.1, 0.01, 0.01, STEEL).constants,
        1e-6,
        200,
    ),
    r"elasticity has shape \(5, 5\)": (MaterialAnisotropic, np.eye(5), 1.0),
    "not symmetric": (MaterialAnisotropic, np.eye(6, k=1) + np.eye(6), 1.0),
    "not positive definite": (MaterialAnisotropic, -np.eye(6), 1.0),
    "nu = .* is too large": (MaterialAnisotropic.orthotropic, 3 * [1], 3 * [1], 3 * [0.9], 1.0),
    "E = .* expected positive": (
        MaterialAnisotropic.orthotropic,
        (1, -1, 1),
        3 * [1],
        3 * [0],
        1.0,
    ),
    "is no .* rotation": (PLY.rotated, 2 * np.eye(3)),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_input(message):
    function, *arguments = BAD[message]
    with pytest.raises(sc.InputError, match=message):
        function(*arguments)


def test_bad_calls_of_constants():
    constants = ProfileRectangle(1, 1, STEEL).constants(0.1)
    with pytest.raises(sc.InputError, match=r"origin has shape \(3,\), expected \(2,\)"):
        constants.moved((1, 2, 3))
    with pytest.raises(sc.InputError, match=r"resultants has shape \(2,\), expected \(6,\)"):
        constants.stresses((1, 2))


def test_points_of_construction_lines_do_no_harm():
    mesh = skfem.MeshTri().refined(2)
    loose = replace(mesh, doflocs=np.hstack([mesh.p, [[5.0], [5.0]]]))
    one, two = (Profile(each, STEEL).constants(1e-2) for each in (mesh, loose))
    assert isinstance(one, ProfileConstants)
    assert two.stiffness == pytest.approx(one.stiffness, rel=1e-10, abs=1e-3)
