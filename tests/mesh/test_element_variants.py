"""Other nodes and Gauss points, as a comparison: they lock, or lose orders, as theory says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

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
from skfem_cosserat.element import ElementLineLobatto, Interpolation, interpolation
from skfem_cosserat.export.geometry import BeamShape
from skfem_cosserat.kernels import null_space_blocks

ORDERS = (1, 2, 3, 4)
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
    P = np.zeros((len(K), len(K) // 2))
    for k, block in enumerate(null_space_blocks(beam.triads)):
        P[12 * k : 12 * k + 12, 6 * k : 6 * k + 6] = block
    tip = 6 * beam.node("beam.end").vertex
    free = np.setdiff1d(np.arange(P.shape[1]), np.arange(6))
    A = (P.T @ K @ P)[np.ix_(free, free)]
    load = np.zeros(len(free))
    load[tip - 6] = 1.0
    shear, axial, bending = section.stiffness[[0, 2, 3], [0, 2, 3]]
    curved = len(mesh.curves) and mesh.curves[0].length == 1.5
    if curved:
        density = lambda s: (  # noqa: E731
            (np.sin(1.5) - np.sin(s)) ** 2 / bending
            + np.sin(s) ** 2 / axial
            + np.cos(s) ** 2 / shear
        )
        exact = quad(density, 0, 1.5, epsabs=0, epsrel=2e-14)[0]
    else:
        exact = 1 / (3 * bending) + 1 / shear
    return float(np.linalg.solve(A, load)[tip - 6] / exact)


# ----------------------------------------------------------------------- objects
def test_default_is_lobatto_with_p_points():
    mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 1), 2)
    for p in ORDERS:
        beam = Beam(mesh, SECTION, order=p)
        assert beam.basis.interpolation == InterpolationLobatto(p) == interpolation(p)
        assert beam.basis.order == p
        assert type(beam.basis.order) is int
        assert np.array_equal(beam.reference, Beam(mesh, SECTION, order=interpolation(p)).reference)
    assert InterpolationLobatto(3) != InterpolationEquidistant(3)
    assert len({InterpolationLobatto(3), InterpolationLobatto(3, points=3)}) == 1
    assert len({InterpolationLobatto(3), InterpolationLobatto(3, points=4)}) == 2


@pytest.mark.parametrize("p", ORDERS)
def test_equidistant_nodes_everywhere(p):
    kind = InterpolationEquidistant(p, points=p + 1)
    basis = DirectorBasis(arc(2), order=kind)
    along = np.arange(p + 1) / p
    assert np.abs(basis.arc_lengths - 0.75 * (np.array([[0], [1]]) + along)).max() < 1e-15
    assert len(basis.points) == p + 1
    assert np.abs(basis.shape(along) - np.eye(p + 1)).max() < 1e-14
    # consistent mass and load of any nodes integrate powers of xi exactly
    mass, load = basis.elemental_mass()[0], basis.elemental_load()[0]
    assert np.abs(load @ along**p - 0.75 / (p + 1)).max() < 1e-14
    assert abs(along**p @ mass @ along**p - 0.75 / (2 * p + 1)) < 1e-15
    element = ElementLineLobatto(kind)
    at_nodes = [element.lbasis(element.doflocs.T, i)[0] for i in range(p + 1)]
    assert np.abs(np.array(at_nodes) - np.eye(p + 1)).max() < 1e-14


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: InterpolationLobatto(5), "argument order.*5"),
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
    kinds = (
        InterpolationLobatto(3),
        InterpolationEquidistant(3),
        InterpolationLobatto(3, points=4),
        InterpolationLobatto(3),
    )
    together = Model()
    beams = [
        together.add(f"b{k}", Beam(arc(2), SECTION, order=kind)) for k, kind in enumerate(kinds)
    ]
    system = together.freeze()
    assert len(system.beam_groups) == 3
    q = system.q0 + 0.1 * np.random.default_rng(3).standard_normal(system.n)
    total = 0.0
    for k, kind in enumerate(kinds):
        model = Model()
        beam = model.add(f"b{k}", Beam(arc(2), SECTION, order=kind))
        alone = model.freeze()
        start = 3 * system.first[id(beams[k])][1]
        own = q[start : start + alone.n]
        expected = section_forces(alone, beam, own)
        assert np.array_equal(section_forces(system, beams[k], q), expected)
        total += strain_energy(alone, own)
    assert abs(strain_energy(system, q) - total) < 1e-12 * total


@pytest.mark.one_quick
@pytest.mark.parametrize("p", [2, 3, 4])
@pytest.mark.parametrize("kind", [InterpolationLobatto, InterpolationEquidistant])
def test_export_draws_a_variant_where_it_is(kind, p):
    model = Model()
    beam = model.add("b", Beam(arc(2), SECTION, order=kind(p, points=p + 1)))
    system = model.freeze()
    q = system.q0 + 0.1 * np.random.default_rng(3).standard_normal(system.n)
    _, static = describe(system)
    shape = BeamShape("b", static)
    s = np.linspace(0, 1.5, 2 * p + 1)
    expected = evaluate(system, beam, q, *beam.along(s))
    x = shape.points(q)
    if p == 2:
        order = [0, 3, 1, 4, 2]  # nodes
    else:  # ends of the elements, then p - 1 points in each
        inner = 3 + np.arange(2 * (p - 1))
        order = [0, *inner[: p - 1], 1, *inner[p - 1 :], 2]
    assert np.abs(x[order] - expected.position).max() < 1e-14
    assert np.abs(shape.directors(q)[order] - expected.triad).max() < 1e-14
    forces = section_forces(system, beam, q)[..., :3]
    at_gauss = evaluate(system, beam, q, np.repeat([0, 1], p + 1), np.tile(shape.gauss, 2))
    spatial = np.einsum("mi,mij->mj", at_gauss.resultant[:, :3], at_gauss.triad)
    turned = shape.to_space(q, forces[..., None, :])
    assert np.abs(turned.reshape(-1, 3) - spatial).max() < 1e-9
    # a history written before there were variants has no places of nodes: Lobatto
    del static["beam/b/nodes"]
    old = BeamShape("b", static).points(q)
    same = kind is InterpolationLobatto or p == 2
    assert (np.abs(old - x).max() < 1e-14) == same


def test_dynamics_conserve_with_any_interpolation_and_histories_know_it():
    runs = {}
    for kind in (InterpolationEquidistant(3), InterpolationLobatto(3), InterpolationLobatto(3, 4)):
        model = Model()
        model.add("b", Beam(arc(1), SECTION, order=kind, angular_velocity=(0, 1.0, 2.0)))
        model.add("gravity", LoadGravity((0, 0, -9.81)))
        system = model.freeze()
        history = simulate(system, EnergyMomentum(), NullSpace(), 0.01, until=0.05)
        total = history["energy"] + history["external"]
        assert np.abs(total - total[0]).max() < 1e-9 * abs(total[0])
        runs[kind] = (system, history)
    for kind, (system, _) in runs.items():
        for other, (_, history) in runs.items():
            if kind == other:
                continue
            with pytest.raises(HistoryError):
                restart(system, history, EnergyMomentum(), 0.01)


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
