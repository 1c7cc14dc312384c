"""Profiles against closed forms of Saint-Venant's problems, other formulations and beams."""

from __future__ import annotations

import importlib.util
import inspect
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

OUTLINE = [(0, 0), (2, 0), (2.5, 1), (0, 1)]
HOLES = [[(0.2, 0.2), (0.8, 0.2), (0.5, 0.8)], [(1.2, 0.2), (1.8, 0.2), (1.8, 0.8)]]

general_mass = pytest.mark.skipif(
    "centre" not in inspect.signature(sc.Section).parameters,
    reason="sections of beams have their centre of mass on the line",
)


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
@pytest.mark.parametrize("ratio", [1.0, 2.0, 5.0, 10.0])
@pytest.mark.parametrize("nu", [0.0, 0.3])
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
def test_rectangle_shear_factor_without_contraction_is_five_sixths():
    found = ProfileRectangle(0.3, 0.2, isotropic(0.0)).constants()
    assert found.shear_factors == pytest.approx([5 / 6, 5 / 6], rel=1e-10)


@pytest.mark.slow
def test_existing_sections_agree():
    """All but the shear factors, for which they take Cowper's definition or 5/6."""
    for section, profile in (
        (sc.SectionRectangle(0.02, 0.03, STEEL), ProfileRectangle(0.02, 0.03, STEEL)),
        (sc.SectionCircle(0.02, STEEL), ProfileCircle(0.02, STEEL)),
        (sc.SectionTube(0.02, 0.015, STEEL), ProfileTube(0.02, 0.015, STEEL)),
    ):
        mine = profile.section()
        diagonal = mine.stiffness.diagonal()
        assert diagonal[2:] == pytest.approx(section.stiffness.diagonal()[2:], rel=1e-5)
        assert mine.mass == pytest.approx(section.mass, rel=2e-6)
        assert mine.inertia == pytest.approx(section.inertia, rel=4e-6)
        scale = np.sqrt(np.outer(diagonal, diagonal))
        assert abs(mine.stiffness - np.diag(diagonal)).max() < 1e-6 * scale.max()


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
@pytest.mark.parametrize("nu", [0.0, 0.3, pytest.param(0.49, marks=pytest.mark.slow)])
def test_circle(nu):
    found = ProfileCircle(1.0, isotropic(nu)).constants()
    assert found.area == pytest.approx(np.pi, rel=1e-6)
    assert found.torsion_constant == pytest.approx(np.pi / 2, rel=2e-6)
    wanted = 6 * (1 + nu) ** 2 / (7 + 14 * nu + 8 * nu**2)
    assert found.shear_factors == pytest.approx([wanted, wanted], rel=1e-5)


def tube_shear_factor(b, nu):
    """Energy of Love's flexure of a tube of outer radius 1 (Theory of Elasticity, section 231)."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    r = (1 + b) / 2 + (1 - b) / 2 * nodes[:, None]
    angle = 2 * np.pi * np.arange(64) / 64
    x, y = r * np.cos(angle), r * np.sin(angle)

    def shear(x, y):
        r, angle = np.hypot(x, y), np.arctan2(y, x)
        g = 0.75 + nu / 2
        # chi = -g ((1 + b^2) r + b^2/r) cos(angle) + r^3 cos(3 angle)/4, by x and by y
        u = -g * ((1 + b**2) - b**2 / r**2 * np.cos(2 * angle)) + 0.75 * r**2 * np.cos(2 * angle)
        v = g * b**2 / r**2 * np.sin(2 * angle) - 0.75 * r**2 * np.sin(2 * angle)
        moment = np.pi / 4 * (1 - b**4)
        factor = -1 / (2 * (1 + nu) * moment)
        return (
            factor * (u + nu / 2 * x**2 + (1 - nu / 2) * y**2),
            factor * (v + (2 + nu) * x * y),
        )

    for radius in (b, 1):  # no traction on the surfaces
        n = np.array([np.cos(angle), np.sin(angle)])
        stress = shear(*radius * n)
        assert abs(stress[0] * n[0] + stress[1] * n[1]).max() < 1e-13
    dA = (1 - b) / 2 * weights[:, None] * r * 2 * np.pi / 64
    s, t = shear(x, y)
    assert (s * dA).sum() == pytest.approx(1)
    return 1 / ((s**2 + t**2) * dA).sum() / (np.pi * (1 - b**2))


@pytest.mark.slow
@pytest.mark.parametrize("inner", [0.3, 0.8, 0.98])
@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_tube(inner, nu):
    found = ProfileTube(1.0, inner, isotropic(nu)).constants()
    assert found.torsion_constant == pytest.approx(np.pi / 2 * (1 - inner**4), rel=5e-6)
    wanted = tube_shear_factor(inner, nu)
    assert found.shear_factors == pytest.approx([wanted, wanted], rel=1e-4)


@pytest.mark.slow
def test_ellipse_is_a_mesh_of_the_users():
    disk = ProfileCircle(1.0, isotropic(0.3)).mesh
    ellipse = replace(disk, doflocs=disk.doflocs * [[2.0], [1.0]])
    found = Profile(ellipse, isotropic(0.3)).constants()
    assert found.torsion_constant == pytest.approx(np.pi * 8 / 5, rel=5e-6)


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
def test_equilateral_triangle_is_exact():
    corners = [(0, 0), (1, 0), (0.5, np.sqrt(0.75))]
    found = polygon(corners, isotropic(0.3)).constants()
    assert found.torsion_constant == pytest.approx(np.sqrt(3) / 80, rel=1e-12)
    assert found.shear_centre == pytest.approx([0.5, np.sqrt(3) / 6], rel=1e-10)


def classical(profile, refinements=2):
    """Torsion constant and Trefftz's shear centre by the scalar warping function."""
    mesh = profile.mesh.refined(refinements)
    basis = skfem.Basis(mesh, skfem.ElementTriP2())
    centre = profile.constants(0.5).centroid
    x, y = basis.doflocs - centre[:, None]
    stiffness = skfem.BilinearForm(lambda u, v, _: u.grad[0] * v.grad[0] + u.grad[1] * v.grad[1])
    source = skfem.LinearForm(
        lambda v, w: (w.x[1] - centre[1]) * v.grad[0] - (w.x[0] - centre[0]) * v.grad[1]
    )
    A, f = stiffness.assemble(basis), source.assemble(basis)
    phi = skfem.solve(*skfem.condense(A, f, D=np.array([0])))
    mass = skfem.BilinearForm(lambda u, v, _: u * v).assemble(basis)
    X = np.stack([x, y])
    moments, sectorial = X @ mass @ X.T, X @ mass @ (phi - (phi @ mass).sum() / mass.sum())
    minus_y, x_s = -np.linalg.solve(moments, sectorial)
    return np.trace(moments) - phi @ f, centre + [x_s, -minus_y]


@pytest.mark.slow
@pytest.mark.parametrize(
    "make",
    [
        lambda: polygon(L_SHAPE, STEEL),
        lambda: ProfileChannel(0.1, 0.06, 0.008, 0.006, STEEL),
        pytest.param(lambda: polygon(OUTLINE, STEEL, HOLES), marks=pytest.mark.slow),
    ],
    ids=["angle", "channel", "holes"],
)
def test_torsion_and_shear_centre_by_the_scalar_problem(make):
    profile = make()
    found = profile.constants()
    J, centre = classical(profile, 3)
    size = np.sqrt(found.area)
    assert found.torsion_constant == pytest.approx(J, rel=5e-3)
    assert found.torsion_constant < J * (1 + 1e-5)  # its uniform mesh is the stiffer one
    assert found.shear_centre == pytest.approx(centre, abs=2e-3 * size)


def test_area_and_moments_of_a_polygon_with_a_hole():
    hole = [(0.2, 0.2), (0.7, 0.3), (0.3, 0.6)]
    profile = polygon([(0, 0), (2, 0), (2, 1), (0, 1)], STEEL, [hole])
    found = profile.constants(1e-2)
    a = (0.5 * 0.4 - 0.1 * 0.1) / 2  # of the hole, by hand
    centre, corners = np.mean(hole, axis=0), np.array(hole)
    own = a / 12 * ((corners.T @ corners) + 9 * np.outer(centre, centre))
    assert found.area == pytest.approx(2 - a, rel=1e-12)
    assert found.centroid == pytest.approx((2 * np.array([1, 0.5]) - a * centre) / (2 - a))
    assert found.second_moments == pytest.approx([[8 / 3, 1], [1, 2 / 3]] - own, rel=1e-10)
    assert [each.shape for each in profile.holes] == [(3, 2)]
    assert profile.outline.shape == (4, 2)


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
def test_polygon_and_rectangles_of_one_shape_agree():
    x, y = 0.05, 0.1
    outline = [(-x, -y), (x, -y), (x, y), (-x, y)]
    hole = [(-0.04, -0.08), (0.04, -0.08), (0.04, 0.08), (-0.04, 0.08)]
    one = polygon(outline, STEEL, [hole]).constants(1e-3)
    two = ProfileBox(0.1, 0.2, (0.01, 0.02), STEEL).constants(1e-3)
    scale = np.sqrt(np.outer(*2 * (two.stiffness.diagonal(),)))
    assert one.stiffness / scale == pytest.approx(two.stiffness / scale, abs=1e-3)


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
    half, web, flange, r = (0.05, 0.1), 0.0028, 0.0085, 0.012
    angle = np.linspace(0, np.pi / 2, 17)
    fillet = [web + r - r * np.sin(angle), half[1] - flange - r + r * np.cos(angle)]
    quarter = np.vstack([[half, (half[0], half[1] - flange)], np.transpose(fillet)])
    turns = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    outline = np.vstack([(quarter * turn)[:: turn[0] * turn[1]] for turn in turns])
    found = polygon(outline, STEEL).constants(1e-3)
    assert found.area == pytest.approx(28.48e-4, rel=1e-3)
    assert found.EI.diagonal() / STEEL.E == pytest.approx([1943e-8, 142.4e-8], rel=1e-3)
    assert found.torsion_constant == pytest.approx(6.98e-8, rel=0.03)


@pytest.mark.slow
def test_quadrilaterals():
    """Straight ones are refined all over; curved ones are taken as they are."""
    mesh = skfem.MeshQuad.init_tensor(np.linspace(0, 1, 2), np.linspace(0, 2, 3))
    found = Profile(mesh, isotropic(0.3)).constants()
    assert found.elements > 2 and found.elements % 2 == 0
    assert found.torsion_constant == pytest.approx(rectangle_torsion(1, 2), rel=3e-5)
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
    halves = [((0, 1), (0, 1), STEEL), ((1, 2), (0, 1), sc.Material(210e9, 0.3, 7850.0))]
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


@pytest.mark.slow
def test_layers_of_rectangles_and_of_polygons_agree():
    def region(low, high, material):
        return part([(-0.01, low), (0.01, low), (0.01, high), (-0.01, high)], material)

    one = ProfileComposite([region(-0.01, 0, STEEL), region(0, 0.016, ALUMINIUM)]).constants()
    two = two_rectangles(ALUMINIUM).constants()
    scale = np.sqrt(np.outer(*2 * (two.stiffness.diagonal(),)))
    assert one.stiffness / scale == pytest.approx(two.stiffness / scale, abs=2e-5)


@pytest.mark.slow
def test_region_in_a_hole_and_corners_on_edges():
    """A core in a shell, cut so that corners of one region lie on edges of the others."""
    outer = [(0, 0), (3, 0), (3, 2), (0, 2)]
    hole = [(1, 0.5), (2, 0.5), (2, 1.5), (1, 1.5)]
    lower = [(1, 0.5), (2, 0.5), (2, 1.1), (1, 0.9)]
    upper = [(1, 0.9), (2, 1.1), (2, 1.5), (1, 1.5)]
    shell = part(outer, STEEL, [hole])
    parts = ProfileComposite([shell, part(lower, STEEL), part(upper, STEEL)]).constants()
    whole = polygon(outer, STEEL).constants()
    scale = np.sqrt(np.outer(*2 * (whole.stiffness.diagonal(),)))
    assert parts.stiffness / scale == pytest.approx(whole.stiffness / scale, abs=5e-5)


# -- anisotropic materials ---------------------------------------------------------------------


@pytest.mark.slow
def test_orthotropic_rectangle():
    found = ProfileRectangle(1.0, 2.0, PLY).constants()
    assert pytest.approx(140e9 * 2, rel=1e-9) == found.EA
    assert found.EI.diagonal() == pytest.approx([140e9 * 8 / 12, 140e9 * 2 / 12], rel=1e-9)
    # G_13 = 6e9, G_23 = 3e9
    wanted = 6e9 * rectangle_torsion(1.0, 2.0, 0.5)
    assert pytest.approx(wanted, rel=1e-5) == found.GJ


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


@pytest.mark.slow
def test_isotropic_is_a_case_of_anisotropic():
    same = MaterialAnisotropic(elasticity(STEEL), STEEL.rho)
    plain = ProfileRectangle(0.01, 0.02, STEEL).constants()
    turned = ProfileRectangle(
        0.01, 0.02, same.rotated(np.linalg.qr(np.vander([1.0, 2, 4]))[0])
    ).constants()
    scale = np.sqrt(np.outer(*2 * (plain.stiffness.diagonal(),)))
    assert turned.stiffness / scale == pytest.approx(plain.stiffness / scale, abs=1e-7)
    direct = MaterialAnisotropic.orthotropic(3 * [210e9], 3 * [STEEL.G], 3 * [0.3], 1.0)
    assert direct.elasticity == pytest.approx(same.elasticity, rel=1e-12)


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
    back = moved.moved(shift, angle)
    scale = np.sqrt(np.outer(*2 * (plain.stiffness.diagonal(),)))
    assert back.stiffness / scale == pytest.approx(plain.stiffness / scale, abs=1e-4)
    for name in ("centroid", "centre", "elastic_centre"):
        assert getattr(back, name) == pytest.approx(getattr(plain, name), abs=1e-9)
    assert back.shear_centre == pytest.approx(plain.shear_centre, abs=1e-6)
    assert back.inertia == pytest.approx(plain.inertia, rel=1e-9)
    assert back.second_moments == pytest.approx(plain.second_moments, rel=1e-9)
    assert back.shear_moduli == pytest.approx(plain.shear_moduli, rel=1e-9, abs=1e-3)
    assert back.outline[np.lexsort(back.outline.round(9).T)] == pytest.approx(
        plain.outline[np.lexsort(plain.outline.round(9).T)], abs=1e-12
    )
    assert moved.shear_centre == pytest.approx(turned @ plain.shear_centre + shift, abs=1e-6)


def test_moving_composes():
    plain = polygon(L_SHAPE, STEEL).constants(1e-2)
    twice = plain.moved((0.1, 0.2), 0.3).moved((-0.2, 0.1), 0.4)
    once = plain.moved((0.1, 0.2) + rotation(0.3) @ (-0.2, 0.1), 0.7)
    assert twice.stiffness == pytest.approx(once.stiffness, rel=1e-9, abs=1e-3)
    assert twice.inertia == pytest.approx(once.inertia, rel=1e-12)
    load = np.arange(6.0)
    for a, b in zip(twice.stresses(load), once.stresses(load), strict=True):
        assert a == pytest.approx(b, rel=1e-9, abs=1e-6)
    assert plain.principal_EI[0] == pytest.approx(once.principal_EI[0], rel=1e-9)
    assert plain.principal_EI[1] - 0.7 == pytest.approx(once.principal_EI[1], abs=1e-9)


@pytest.mark.one_quick
@pytest.mark.parametrize(("tolerance", "same"), [(0.5, 2e-9), (1e-3, 1e-3)])
def test_units(tolerance, same):
    """Metres and newtons, or millimetres, newtons and tonnes; ties of refinement fall anyhow."""
    metres = ProfileI(0.2, 0.1, 0.01, 0.008, STEEL).constants(tolerance)
    other = sc.Material(210e3, 0.3, 7.85e-9)
    tonnes = ProfileI(200, 100, 10, 8, other).constants(tolerance)
    unit = 1e3 ** np.array([0, 0, 0, 1, 1, 1])
    wanted = metres.stiffness * np.outer(unit, unit)
    scale = np.sqrt(np.outer(*2 * (wanted.diagonal(),)))
    assert tonnes.stiffness / scale == pytest.approx(wanted / scale, abs=same)
    assert tonnes.shear_factors == pytest.approx(metres.shear_factors, rel=same)
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
    found = ProfileCircle(0.1, STEEL).constants()
    x, stress = found.stresses((0, 0, 0, 0, 0, 50.0))
    J = np.pi / 2 * 1e-4
    wanted = 50 / J * np.array([0 * x[0], 0 * x[0], 0 * x[0], x[0], -x[1], 0 * x[0]])
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
@general_mass
def test_composite_beam_is_parallel_beams_joined():
    """Bent to an arc of 0.6 rad and stretched by 1.5e-3: one beam and two, against theory."""
    for row in example().composite(elements=8):
        assert row["error"] < (3e-7 if row["load"] == "moment" else 1e-14)
    coarse = max(row["error"] for row in example().composite(elements=4))
    fine = max(row["error"] for row in example().composite(elements=8))
    assert np.log2(coarse / fine) == pytest.approx(4, abs=0.2)


@pytest.mark.slow
def test_examples_closed_forms():
    for row in example().closed_forms():
        assert row["computed"] == pytest.approx(row["exact"], rel=1e-5), row["name"]


@pytest.mark.slow
@general_mass
def test_mass_goes_along():
    profile = two_rectangles(ALUMINIUM)
    section = profile.section(tolerance=1e-2, origin=(0.01, 0.0))
    constants = profile.constants(1e-2).moved((0.01, 0.0))
    assert section.centre == pytest.approx(constants.centre)
    assert section.inertia == pytest.approx(constants.inertia)
    weights = np.array([7850 * 0.01, 2700 * 0.016]) * 0.02
    assert section.mass == pytest.approx(weights.sum())
    assert section.centre == pytest.approx(
        [-0.01, (weights @ [-0.005, 0.008]) / weights.sum()], rel=1e-9
    )
    assert section.inertia[0, 1] == pytest.approx(-0.01 * weights @ [-0.005, 0.008], rel=1e-9)


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


def broken_mesh(**changes):
    return replace(skfem.MeshTri().refined(1), **changes)


BAD = {
    "two corners": (
        lambda: polygon(SQUARE[:2], STEEL),
        r"polygon: outline has shape \(2, 2",
    ),
    "bow tie": (
        lambda: polygon([(0, 0), (1, 1), (1, 0), (0, 2)], STEEL),
        "outline crosses or touches itself: Self-intersection",
    ),
    "bow tie of no area": (
        lambda: polygon([(0, 0), (1, 1), (1, 0), (0, 1)], STEEL),
        "outline crosses or touches itself: Self-intersection",
    ),
    "repeated": (
        lambda: polygon([*SQUARE[:2], *SQUARE[1:]], STEEL),
        r"corner 1 at \[1.0, 0.0\] is repeated",
    ),
    "flat": (lambda: polygon([(0, 0), (1, 1), (2, 2)], STEEL), "has no area"),
    "not a number": (
        lambda: polygon([*SQUARE[:3], (np.nan, 1)], STEEL),
        "outline is not finite at corner 3",
    ),
    "hole outside": (
        lambda: polygon(SQUARE, STEEL, [np.array(SQUARE) + 2]),
        "region 0: hole 0 is not inside",
    ),
    "hole on edge": (
        lambda: polygon(SQUARE, STEEL, [np.array(SQUARE) / 2]),
        "region 0: hole 0 is not inside the outline, or touches",
    ),
    "holes overlap": (
        lambda: polygon(SQUARE, STEEL, [np.array(SQUARE) / 4 + 0.3, np.array(SQUARE) / 4 + 0.4]),
        "holes 0 and 1 overlap",
    ),
    "regions overlap": (
        lambda: ProfileComposite([part(SQUARE, STEEL), part(np.array(SQUARE) + 0.5, STEEL)]),
        "regions 0 and 1 overlap by an area of 0.25",
    ),
    "apart": (
        lambda: ProfileComposite([part(SQUARE, STEEL), part(np.array(SQUARE) + 3, STEEL)]),
        "falls into 2 parts",
    ),
    "corner to corner": (
        lambda: ProfileComposite([part(SQUARE, STEEL), part(np.array(SQUARE) + 1, STEEL)]),
        "falls into 2 parts that share no edge",
    ),
    "no regions": (lambda: ProfileComposite([]), "no regions"),
    "no region": (lambda: ProfileComposite([SQUARE]), "region 0 = .* expected a Region"),
    "no material": (lambda: ProfileRectangle(1, 1, "steel"), "material = 'steel'"),
    "incompressible": (
        lambda: ProfileRectangle(1, 1, sc.Material(1.0, 0.5, 1.0)),
        "nu = 0.5: .*0.495",
    ),
    "negative": (lambda: ProfileRectangle(1, -1, STEEL), "rectangle: b = -1"),
    "negative radius": (lambda: ProfileCircle(-1, STEEL), "circle: radius = -1"),
    "tube": (lambda: ProfileTube(1, 1, STEEL), "tube: inner = 1, expected inner < outer"),
    "rings": (lambda: ProfileRings((0, 2, 1), (STEEL, STEEL)), "rings: radii"),
    "segments": (lambda: ProfileRings((0, 1), (STEEL,), segments=20), "segments = 20"),
    "flanges": (lambda: ProfileI(0.1, 0.1, 0.05, 0.01, STEEL), "I: height = 0.1"),
    "web": (lambda: ProfileChannel(0.1, 0.01, 0.01, 0.01, STEEL), "channel: flange = 0.01"),
    "walls": (lambda: ProfileBox(0.1, 0.1, 0.05, STEEL), "box: thickness = 0.05"),
    "pair": (lambda: ProfileI(1, (1, 2, 3), 0.1, 0.1, STEEL), "I: width"),
    "overlap": (
        lambda: ProfileRectangles([((0, 2), (0, 1), STEEL), ((1, 3), (0, 1), STEEL)]),
        "rectangles 0 and 1 overlap",
    ),
    "backwards": (
        lambda: ProfileRectangles([((2, 0), (0, 1), STEEL)]),
        r"rectangle 0: ends .* expected a < b",
    ),
    "gap": (
        lambda: ProfileRectangles([((0, 1), (0, 1), STEEL), ((2, 3), (0, 1), STEEL)]),
        "falls into 2 parts",
    ),
    "line": (lambda: Profile(skfem.MeshLine(), STEEL), "mesh is a MeshLine1, expected"),
    "empty": (
        lambda: Profile(broken_mesh(t=np.zeros((3, 0), dtype=int)), STEEL),
        "mesh has no elements",
    ),
    "nan": (lambda: Profile(broken_mesh(doflocs=FAR.p * np.nan), STEEL), "not two finite numbers"),
    "flat elements": (lambda: Profile(broken_mesh(doflocs=FAR.p * [[1.0], [0]]), STEEL), "no area"),
    "three elements": (
        lambda: Profile(broken_mesh(t=np.hstack([FAR.t, FAR.t[:, :1], FAR.t[:, :1]])), STEEL),
        "an edge of the mesh belongs to",
    ),
    "unknown subdomain": (lambda: Profile(FAR, {"web": STEEL}), "subdomain 'web' is unknown"),
    "uncovered": (
        lambda: Profile(FAR.with_subdomains({"web": np.array([0])}), {"web": STEEL}),
        "7 of 8 elements are in none of",
    ),
    "covered twice": (
        lambda: Profile(
            FAR.with_subdomains({"a": np.arange(8), "b": np.array([3])}), {"a": STEEL, "b": PLY}
        ),
        "subdomains 'a' and 'b' share elements",
    ),
    "tolerance": (lambda: ProfileRectangle(1, 1, STEEL).constants(0.0), "tolerance = 0.0"),
    "too fine": (
        lambda: ProfileI(0.2, 0.1, 0.01, 0.01, STEEL).constants(1e-6, max_elements=200),
        r"tolerance = 1e-06 is not reached with \d+ elements: error",
    ),
    "origin": (
        lambda: ProfileRectangle(1, 1, STEEL).constants(0.1).moved((1, 2, 3)),
        r"origin has shape \(3,\), expected \(2,\)",
    ),
    "resultants": (
        lambda: ProfileRectangle(1, 1, STEEL).constants(0.1).stresses((1, 2)),
        r"resultants has shape \(2,\), expected \(6,\)",
    ),
    "elasticity": (lambda: MaterialAnisotropic(np.eye(5), 1.0), r"has shape \(5, 5\)"),
    "unsymmetric": (lambda: MaterialAnisotropic(np.eye(6, k=1) + np.eye(6), 1.0), "not symmetric"),
    "indefinite": (lambda: MaterialAnisotropic(-np.eye(6), 1.0), "not positive definite"),
    "ratios": (
        lambda: MaterialAnisotropic.orthotropic((1, 1, 1), (1, 1, 1), (0.9, 0.9, 0.9), 1.0),
        "nu = .* is too large",
    ),
    "moduli": (
        lambda: MaterialAnisotropic.orthotropic((1, -1, 1), (1, 1, 1), (0, 0, 0), 1.0),
        "E = .* expected positive",
    ),
    "no rotation": (lambda: PLY.rotated(2 * np.eye(3)), "is no .* rotation"),
}


@pytest.mark.one_quick
@pytest.mark.parametrize("case", BAD)
def test_bad_input(case):
    call, message = BAD[case]
    with pytest.raises(sc.InputError, match=message):
        call()


def test_a_closed_outline_is_taken_as_closed():
    one, two = (polygon(corners, STEEL) for corners in (SQUARE, [*SQUARE, SQUARE[0]]))
    assert len(one.outline) == len(two.outline) == 4


def test_points_of_construction_lines_do_no_harm():
    mesh = skfem.MeshTri().refined(2)
    loose = replace(mesh, doflocs=np.hstack([mesh.p, [[5.0], [5.0]]]))
    one, two = (Profile(each, STEEL).constants(1e-2) for each in (mesh, loose))
    assert isinstance(one, ProfileConstants)
    assert two.stiffness == pytest.approx(one.stiffness, rel=1e-10, abs=1e-3)
