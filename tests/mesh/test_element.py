import math

import numpy as np
import pytest
import skfem
from scipy.integrate import quad
from scipy.linalg import block_diag

from skfem_cosserat import (
    Beam,
    DirectorBasis,
    EnergyMomentum,
    HistoryError,
    InputError,
    InterpolationEquidistant,
    InterpolationLobatto,
    LoadGravity,
    Material,
    MeshCurve,
    Model,
    NullSpace,
    Section,
    SectionRectangle,
    restart,
    simulate,
)
from skfem_cosserat.analysis.describe import describe
from skfem_cosserat.diagnostics import evaluate, section_forces, strain_energy
from skfem_cosserat.element import (
    ElementDirector,
    ElementLineLobatto,
    Interpolation,
    interpolation,
    lobatto_nodes,
    shape_derivatives,
    shape_functions,
)
from skfem_cosserat.export.geometry import BeamShape
from skfem_cosserat.kernels import null_space_blocks

ORDERS = (1, 2, 3, 4)
XI = np.array([0.0, 0.137, 0.5, 0.81, 1.0])


@pytest.mark.parametrize("p", ORDERS)
def test_nodes_are_the_gauss_lobatto_points(p):
    """Interior nodes are the roots of the derivative of the Legendre polynomial."""
    roots = np.polynomial.legendre.Legendre.basis(p).deriv().roots() if p > 1 else []
    expected = np.concatenate([[0.0], np.sort(0.5 * (np.real(roots) + 1)), [1.0]])
    assert np.abs(lobatto_nodes(p) - expected).max() < 1e-14


@pytest.mark.parametrize("p", ORDERS)
def test_shape_functions_are_nodal(p):
    assert np.array_equal(shape_functions(p, lobatto_nodes(p)), np.eye(p + 1))


@pytest.mark.parametrize("p", ORDERS)
def test_completeness(p):
    """Powers up to the order of the element, and no more; the zeroth: the sum is 1 everywhere."""
    N, dN, nodes = shape_functions(p, XI), shape_derivatives(p, XI), lobatto_nodes(p)
    assert np.abs(dN.sum(axis=0)).max() < 1e-13
    for k in range(p + 1):
        assert np.abs(nodes**k @ N - XI**k).max() < 1e-14
    for k in range(1, p + 1):
        assert np.abs(nodes**k @ dN - k * XI ** (k - 1)).max() < 1e-13
    assert np.abs(nodes ** (p + 1) @ N - XI ** (p + 1)).max() > 1e-4


@pytest.mark.parametrize("p", ORDERS)
def test_derivatives_by_the_complex_step(p):
    step = shape_functions(p, XI + 1e-30j).imag / 1e-30
    assert np.abs(step - shape_derivatives(p, XI)).max() < 1e-14 * max(1, p**3)
    assert shape_derivatives(p, XI + 1e-30j).dtype == complex


@pytest.mark.parametrize("p", ORDERS)
def test_element_in_scikit_fem(p):
    element = ElementLineLobatto(p)
    values = [element.lbasis(element.doflocs.T, i) for i in range(p + 1)]
    assert np.array_equal([value for value, _ in values], np.eye(p + 1))
    assert all(slope.shape == (1, p + 1) for _, slope in values)
    assert element.doflocs[:2, 0].tolist() == [0, 1]
    with pytest.raises(ValueError, match="Index"):
        element.lbasis(element.doflocs.T, p + 1)


@pytest.mark.parametrize("p", ORDERS)
def test_l2_and_h1_convergence_of_a_plain_line_problem(p):
    """-u'' = f on a 1-D scikit-fem mesh: orders p + 1 and p."""
    errors = []
    for refine in (2, 3):
        mesh = skfem.MeshLine().refined(refine)
        basis = skfem.Basis(mesh, ElementLineLobatto(p), intorder=2 * p + 8)
        A = skfem.BilinearForm(lambda u, v, w: u.grad[0] * v.grad[0]).assemble(basis)
        b = skfem.LinearForm(lambda v, w: np.pi**2 * np.sin(np.pi * w.x[0]) * v).assemble(basis)
        u = basis.interpolate(skfem.solve(*skfem.condense(A, b, D=basis.get_dofs())))
        x = np.pi * basis.global_coordinates()[0]
        misses = np.asarray(u) - np.sin(x), u.grad[0] - np.pi * np.cos(x)
        errors.append([math.sqrt((miss**2 * basis.dx).sum()) for miss in misses])
    l2, h1 = np.log2(np.divide(*errors))
    assert abs(l2 - (p + 1)) < 0.1
    assert abs(h1 - p) < 0.1


@pytest.mark.parametrize("p", [0, 9, 1.5, True, "2", None])
def test_impossible_orders(p):
    for make in (lobatto_nodes, ElementLineLobatto, ElementDirector):
        with pytest.raises(InputError, match="argument order: got") as caught:
            make(p)
        assert repr(p) in str(caught.value)


def test_director_element_names_its_components():
    names = ElementDirector(3).dofnames
    assert len(names) == 36
    assert names[:12] == names[12:24] == names[24:]
    assert names[0] == "phi_1"
    assert names[11] == "d3_3"


# -- other nodes and Gauss points: they lock, or lose orders, as theory says -----------------------

SECTION = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))


def arc(elements: int) -> MeshCurve:
    """Arc of radius 1 m and 1.5 rad from the origin, first along z, bending towards x."""
    return MeshCurve.init_arc((0, 0, 0), (0, 0, 1), (1, 0, 0), 1.0, 1.5, elements)


def compliance(mesh: MeshCurve, kind: int | Interpolation, slenderness: float) -> float:
    """Deflection along x under a unit tip load along x, over the exact one; clamped at z = 0.

    Linear, about the stress-free reference: exact is ``int M^2/EI + N^2/EA + Q^2/GA ds``.
    """
    section = SectionRectangle(1 / slenderness, 1 / slenderness, Material(1.0, 0.3, 1.0))
    beam = Beam(mesh, section, order=kind, director=(0, 1, 0))
    K = beam.tangent_form().assemble(beam.basis, q=beam.reference).toarray()
    P = block_diag(*null_space_blocks(beam.triads))[:, 6:]
    load = np.zeros(P.shape[1])
    tip = 6 * beam.node("beam.end").vertex - 6
    load[tip] = 1.0
    shear, axial, bending = section.stiffness[[0, 2, 3], [0, 2, 3]]
    exact = 1 / (3 * bending) + 1 / shear
    if mesh.curves and mesh.curves[0].length == 1.5:

        def density(s):
            moment = np.sin(1.5) - np.sin(s)
            return moment**2 / bending + np.sin(s) ** 2 / axial + np.cos(s) ** 2 / shear

        exact = quad(density, 0, 1.5, epsabs=0, epsrel=2e-14)[0]
    return float(np.linalg.solve(P.T @ K @ P, load)[tip] / exact)


# ----------------------------------------------------------------------- objects
@pytest.mark.parametrize("p", ORDERS)
def test_default_is_lobatto_with_p_points(p):
    basis = DirectorBasis(arc(2), order=p)
    assert basis.interpolation == InterpolationLobatto(p) == interpolation(p)
    assert basis.interpolation == InterpolationLobatto(p, points=p)
    others = InterpolationEquidistant(p), InterpolationLobatto(p, points=p + 1)
    assert basis.interpolation not in others and len({basis.interpolation, *others}) == 3


@pytest.mark.parametrize("p", ORDERS)
def test_equidistant_nodes_everywhere(p):
    kind, along = InterpolationEquidistant(p, points=p + 1), np.arange(p + 1) / p
    basis, element = DirectorBasis(arc(2), order=kind), ElementLineLobatto(kind)
    assert np.abs(basis.arc_lengths - 0.75 * (np.array([[0], [1]]) + along)).max() < 1e-15
    assert len(basis.points) == p + 1
    assert np.abs(basis.shape(along) - np.eye(p + 1)).max() < 1e-14
    at_nodes = [element.lbasis(element.doflocs.T, i)[0] for i in range(p + 1)]
    assert np.abs(np.array(at_nodes) - np.eye(p + 1)).max() < 1e-14
    # consistent mass and load of any nodes integrate powers of xi exactly
    mass, load = basis.elemental_mass()[0], basis.elemental_load()[0]
    assert np.abs(load @ along**p - 0.75 / (p + 1)).max() < 1e-14
    assert abs(along**p @ mass @ along**p - 0.75 / (2 * p + 1)) < 1e-15


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: InterpolationLobatto(9), "argument order.*9"),
        (lambda: InterpolationEquidistant(0), "argument order.*0"),
        (lambda: InterpolationLobatto(3, points=2), "argument points.*2 Gauss.*mechanisms"),
        (lambda: InterpolationLobatto(1, points=True), "argument points.*True"),
        (lambda: InterpolationLobatto(2, points=2.5), "argument points.*2.5"),
        (lambda: Beam(arc(2), SECTION, order="lobatto"), "argument order.*'lobatto'"),
    ],
)
def test_impossible_interpolations(make, words):
    with pytest.raises(InputError, match=words):
        make()


# ----------------------------------------------------------------------- in a system
@pytest.mark.slow
def test_different_interpolations_are_not_mixed():
    """One system with four kinds of one order gives each beam the energy it has alone."""
    lobatto = InterpolationLobatto(3)
    kinds = lobatto, InterpolationEquidistant(3), InterpolationLobatto(3, points=4), lobatto
    together = Model()
    beams = [together.add(f"b{k}", Beam(arc(2), SECTION, order=i)) for k, i in enumerate(kinds)]
    system = together.freeze()
    q = system.q0 + 0.1 * np.random.default_rng(3).standard_normal(system.n)
    total = 0.0
    for each, kind, own in zip(beams, kinds, np.split(q, 4), strict=True):
        model = Model()
        beam = model.add("beam", Beam(arc(2), SECTION, order=kind))
        alone = model.freeze()
        assert np.array_equal(section_forces(system, each, q), section_forces(alone, beam, own))
        total += strain_energy(alone, own)
    assert abs(strain_energy(system, q) - total) < 1e-12 * total


@pytest.mark.one_quick
@pytest.mark.parametrize("p", [2, 3, 4])
@pytest.mark.parametrize("kind", [InterpolationLobatto, InterpolationEquidistant])
def test_export_draws_a_variant_where_it_is(kind, p):
    model = Model()
    beam = model.add("b", Beam(arc(1), SECTION, order=kind(p, points=p + 1)))
    system = model.freeze()
    q = system.q0 + 0.1 * np.random.default_rng(3).standard_normal(system.n)
    _, static = describe(system)
    shape = BeamShape("b", static)
    expected = evaluate(system, beam, q, *beam.along(np.linspace(0, 1.5, p + 1)))
    x, order = shape.points(q), [0, *range(2, p + 1), 1]  # both ends first
    assert np.abs(x[order] - expected.position).max() < 1e-14
    assert np.abs(shape.directors(q)[order] - expected.triad).max() < 1e-14
    at_gauss = evaluate(system, beam, q, [0] * (p + 1), shape.gauss)
    forces = section_forces(system, beam, q)[..., :3]
    spatial = np.einsum("mi,mij->mj", at_gauss.resultant[:, :3], at_gauss.triad)
    assert np.abs(shape.to_space(q, forces[..., None, :]).reshape(-1, 3) - spatial).max() < 1e-9
    # a history written before there were variants has no places of nodes: Lobatto
    del static["beam/b/nodes"]
    old = BeamShape("b", static).points(q)
    same = kind is InterpolationLobatto or p == 2
    assert (np.abs(old - x).max() < 1e-14) == same


KINDS = InterpolationEquidistant(3), InterpolationLobatto(3), InterpolationLobatto(3, 4)


@pytest.mark.parametrize("kind", KINDS, ids=repr)
def test_dynamics_conserve_with_any_interpolation_and_histories_know_it(kind):
    systems = []
    for each in KINDS:
        model = Model()
        model.add("b", Beam(arc(1), SECTION, order=each, angular_velocity=(0, 1.0, 2.0)))
        model.add("gravity", LoadGravity((0, 0, -9.81)))
        systems.append(model.freeze())
    here = KINDS.index(kind)
    history = simulate(systems.pop(here), EnergyMomentum(), NullSpace(), 0.01, until=0.05)
    total = history["energy"] + history["external"]
    assert np.abs(total - total[0]).max() < 1e-9 * abs(total[0])
    for other in systems:
        with pytest.raises(HistoryError):
            restart(other, history, EnergyMomentum(), 0.01)


# ----------------------------------------------------------------------- locking
@pytest.mark.parametrize("elements", [1, 8])
def test_full_quadrature_of_linear_elements_locks(elements):
    """Slenderness 1000: p points err by 1/(4 ne^2), p + 1 are too stiff by 1e5/ne^2 and more."""
    mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 1), elements)
    reduced = compliance(mesh, 1, 1000.0)
    assert abs((1 - reduced) * 4 * elements**2 - 1) < 1e-4
    full = compliance(mesh, InterpolationLobatto(1, points=2), 1000.0)
    assert full < 4e-6 * elements**2


@pytest.mark.parametrize(
    ("p", "elements", "reduced", "full"),
    # relative errors with p points, and the compliance with p + 1 of which nothing may be left
    [(1, 8, 0.05, 1e-4), (2, 1, 0.18, 1e-5), (2, 8, 4e-5, 0.02), (3, 1, 5e-3, 0.65)],
)
def test_full_quadrature_of_curved_elements_locks(p, elements, reduced, full):
    mesh = arc(elements)
    assert abs(compliance(mesh, p, 1000.0) - 1) < reduced
    assert compliance(mesh, InterpolationLobatto(p, points=p + 1), 1000.0) < full


@pytest.mark.parametrize(("p", "elements"), [(1, 4), (2, 4), (3, 1), (4, 1)])
def test_p_points_do_not_know_the_slenderness(p, elements):
    """The error at 10^4 is within 5 % of that at 100."""
    errors = [compliance(arc(elements), p, slenderness) - 1 for slenderness in (100.0, 1e4)]
    assert abs(errors[1] / errors[0] - 1) < 0.05


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("kind", "elements", "order"),
    [
        (InterpolationLobatto(2), (8, 16), 4),
        (InterpolationLobatto(3), (4, 8), 6),
        (InterpolationLobatto(4), (2, 4), 8),
        (InterpolationEquidistant(3), (4, 8), 4),
        (InterpolationEquidistant(4), (4, 8), 6),
    ],
)
def test_equidistant_nodes_lose_orders(kind, elements, order):
    """Tip of an arc, slenderness 10: 2p on Lobatto nodes, 4 and 6 for p = 3 and 4 on others."""
    coarse, fine = (abs(compliance(arc(ne), kind, 10.0) - 1) for ne in elements)
    assert abs(np.log2(coarse / fine) - order) < 0.1
