import math
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
import skfem

from skfem_cosserat import (
    DirectorBasis,
    InputError,
    MeshCurve,
    MeshError,
    read_mesh,
    write_mesh,
)
from skfem_cosserat.basis import gauss_rule
from skfem_cosserat.element import ElementLineLobatto, lobatto_nodes
from skfem_cosserat.mesh import CurveSpline

ORDERS = (1, 2, 3, 4)
ARC = ((0, 0, 0), (1, 0, 0), (0, 1, 0), 2.0)


def arc(elements=3, angle=1.2):
    return MeshCurve.init_arc(*ARC, angle, elements, name="arc")


def helix(elements=4):
    return MeshCurve.init_helix((1, 0, 0), (0, 0, 0), (0, 0, 1), 0.7, 1.5, elements, name="h")


def network():
    a = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, "a")
    b = MeshCurve.init_line((1, 0, 0), (1, 2, 0), 2, "b")
    c = MeshCurve.init_line((1, 0, 0), (1, 0, 3), 3, "c")
    return a.joined(b, c)


MESHES = {"arc": arc, "helix": helix, "network": network}


def orthonormality(triads):
    gram = np.einsum("...ik,...jk->...ij", triads, triads) - np.eye(3)
    return max(np.abs(gram).max(), np.abs(np.linalg.det(triads) - 1).max())


# ----------------------------------------------------------------------- numbering
@pytest.mark.one_quick
@pytest.mark.parametrize("p", ORDERS)
@pytest.mark.parametrize("name", MESHES)
def test_numbering_is_that_of_scikit_fem(p, name):
    mesh = MESHES[name]()
    basis = DirectorBasis(mesh, p)
    assert basis.n_nodes == mesh.nvertices + mesh.nelements * (p - 1)
    assert 12 * basis.n_nodes == basis.N
    assert np.array_equal(basis.connectivity[:, [0, -1]], mesh.t.T)
    plain = skfem.Basis(mesh, basis.elem, quadrature=basis.quadrature)
    assert np.abs(plain.doflocs - basis.doflocs).max() < 1e-14
    nodes = basis.connectivity[:, basis.elem.elem.places, None]
    dofs = (12 * nodes + np.arange(12)).reshape(mesh.nelements, -1)
    assert np.array_equal(plain.element_dofs.T, dofs)
    assert np.array_equal(basis.element_dofs.T, dofs)
    assert np.array_equal(np.sort(basis.element_dof_rows, axis=1), np.sort(dofs, axis=1))


@pytest.mark.parametrize("p", ORDERS)
def test_nodes_lie_on_the_curve(p):
    basis = DirectorBasis(arc(), p)
    assert np.abs(np.linalg.norm(basis.nodes - (0, 2, 0), axis=1) - 2).max() < 1e-14
    angle = np.arctan2(basis.nodes[:, 0], 2 - basis.nodes[:, 1])[basis.connectivity]
    assert np.abs(2 * angle - basis.arc_lengths).max() < 1e-14


@pytest.mark.parametrize("p", ORDERS)
def test_default_quadrature_has_p_points(p):
    basis = DirectorBasis(arc(), p)
    assert basis.points.shape == (p,)
    assert np.allclose(basis.dx.sum(axis=1), basis.lengths, rtol=1e-15)
    for degree in range(2 * p):
        assert basis.weights @ basis.points**degree == pytest.approx(1 / (degree + 1), rel=1e-14)
    with pytest.raises(ValueError, match="read-only"):
        basis.weights[0] = 1.0


def test_own_quadrature():
    x, w = gauss_rule(5)
    basis = DirectorBasis(arc(), 2, quadrature=(x[None], w))
    assert len(basis.points) == 5
    for bad in ((x[None], w[:-1]), (x[None], 2 * w), (np.stack([x, x]), w)):
        with pytest.raises(InputError, match="argument quadrature"):
            DirectorBasis(arc(), 2, quadrature=bad)


def test_evaluation():
    basis = DirectorBasis(arc(2), 4)
    xi = np.array([0.3, 0.9])
    exact = basis.mesh.mapping().F(xi[None, :, None], np.array([0, 1]))[:, :, 0]
    assert np.abs(basis.evaluate(basis.nodes, [0, 1], xi) - exact.T).max() < 1e-4  # of order 5
    q = np.arange(basis.N, dtype=float)
    assert np.allclose(basis.evaluate(q, [1], [1.0])[0], q.reshape(-1, 12)[2], rtol=1e-15)
    with pytest.raises(InputError, match=r"\(7, 3\)"):
        basis.evaluate(np.zeros((7, 3)), [0], [0.5])


def test_interpolate_agrees_with_the_block_product():
    basis = DirectorBasis(helix(), 3)
    q = np.sin(np.arange(basis.N, dtype=float))
    field = basis.interpolate(q)
    local = q.reshape(-1, 12)[basis.connectivity]
    assert np.allclose(field, np.einsum("aq,eac->ceq", basis.shape(basis.points), local))
    slope = np.einsum("aq,eac,e->ceq", basis.dshape(basis.points), local, 1 / basis.lengths)
    assert np.allclose(field.grad[:, 0], slope)


# ----------------------------------------------------------------------- integrals
@pytest.mark.parametrize("p", ORDERS)
def test_mass_and_load_are_exact(p):
    basis, (x, w) = DirectorBasis(arc(3), p), gauss_rule(12)
    N, lengths = basis.shape(x), basis.lengths[:, None]
    mass = lengths[:, :, None] * ((N * w) @ N.T)
    assert np.allclose(basis.elemental_mass(), mass, rtol=1e-13, atol=1e-16)
    assert np.allclose(basis.elemental_load(), lengths * (N @ w), rtol=1e-13, atol=1e-16)


def test_mass_with_coefficients():
    basis = DirectorBasis(network(), 2)
    plain = basis.elemental_mass()
    factors = np.arange(1.0, 8.0)
    assert np.allclose(basis.elemental_mass(3.0), 3 * plain)
    assert np.allclose(basis.elemental_mass(factors), factors[:, None, None] * plain)
    by_place = basis.elemental_mass(lambda x: 1 + x[2])
    assert by_place.sum() == pytest.approx(1 + 2 + 3 + 4.5, rel=1e-14)
    for bad in (np.ones(3), np.ones((2, 2))):
        with pytest.raises(InputError, match="argument coefficient"):
            basis.elemental_mass(bad)


def test_scalar_basis_shares_the_nodes():
    basis = DirectorBasis(helix(), 3)
    scalar = basis.scalar()
    assert np.abs(scalar.doflocs.T - basis.nodes).max() < 1e-14
    assert len(basis.scalar(intorder=0).W) == 1
    assert np.array_equal(basis.scalar(quadrature=basis.quadrature).W, basis.W)
    length = skfem.Functional(lambda w: 1 + 0 * w.x[0]).assemble(scalar)
    assert length == pytest.approx(basis.lengths.sum(), rel=1e-14)


def test_scikit_fem_copies_of_the_basis():
    basis = DirectorBasis(network(), 2)
    assert basis.n_nodes == basis.with_element(ElementLineLobatto(2)).N
    assert basis.with_elements("c").nelems == 3
    parts = basis.split(np.arange(basis.N, dtype=float))
    assert len(parts) == 12
    assert parts[4][0].tolist() == list(range(4, basis.N, 12))
    x, w = gauss_rule(3)
    full = DirectorBasis(network(), 2, quadrature=(x[None], w))
    found = full.project(lambda x: np.concatenate([x, x, x, x]))
    assert np.abs(found.reshape(-1, 12) - np.tile(basis.nodes, 4)).max() < 1e-12


def test_dofs_by_name_and_component():
    basis = DirectorBasis(network(), 3)
    v = basis.node("b.end")
    assert basis.get_dofs("b.end").all().tolist() == list(range(12 * v, 12 * v + 12))
    assert basis.get_dofs("b.end").all(["phi_2", "d3_3"]).tolist() == [12 * v + 1, 12 * v + 11]
    assert basis.get_dofs(lambda x: np.isclose(x[2], 3)).all()[0] == 12 * basis.node("c.end")


def test_node_lookup_includes_interior_nodes():
    basis = DirectorBasis(network(), 2)
    inner = basis.connectivity[0, 1]
    assert basis.node(tuple(basis.nodes[inner])) == basis.node(int(inner)) == inner
    assert basis.node("a.end") == basis.node("c.start") == 2
    for bad, words in [(999, "999"), ((9, 9, 9), "nearest")]:
        with pytest.raises(MeshError, match=words):
            basis.node(bad)


def test_other_meshes_are_refused():
    with pytest.raises(MeshError, match="MeshLine1, expected a MeshCurve"):
        DirectorBasis(skfem.MeshLine1())


# ----------------------------------------------------------------------- triads
@pytest.mark.one_quick
@pytest.mark.parametrize("p", ORDERS)
@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("twist", [None, 0.7, math.sin])
def test_triads_are_orthonormal_with_the_tangent_third(p, name, twist):
    basis = DirectorBasis(MESHES[name](), p)
    triads = basis.triads(twist=twist)
    assert triads.shape == (basis.mesh.nelements, p + 1, 3, 3)
    assert orthonormality(triads) < 2e-14
    exact = basis.mesh.mapping().tangent(lobatto_nodes(p)[None])
    assert np.abs(triads[:, :, 2] - np.moveaxis(exact, 0, -1)).max() < 1e-14


@pytest.mark.parametrize("directors", [None, (0, 0, 1), {"h": (0, 0, 1)}])
@pytest.mark.parametrize("twist", [None, 2.0, {"h": 2.0}])
def test_neighbours_in_a_smooth_beam_share_their_triads(directors, twist):
    basis = DirectorBasis(helix(), 3)
    triads = basis.triads(directors, twist)
    assert np.array_equal(triads[:-1, -1], triads[1:, 0])
    rotations = basis.relative_rotations(triads)
    assert np.array_equal(rotations, np.broadcast_to(np.eye(3), rotations.shape))


def test_hint_gives_the_first_director():
    basis = DirectorBasis(helix(), 2)
    d1, _, d3 = np.moveaxis(basis.triads(directors=(0, 0, 1)), 2, 0)
    radial = np.cross(d1, d3)
    assert np.abs(radial[..., 2]).max() < 1e-15  # hint, d1 and tangent are in one plane
    assert (d1[..., 2] > 0.9).all()


def test_transport_is_planar_on_an_arc():
    triads = DirectorBasis(arc(5), 3).triads()
    normal = triads[0, 0, 0]
    assert np.abs(normal - (0, 1, 0)).max() < 1e-15  # first of x, y, z farthest from the tangent
    assert np.abs(triads[:, :, 1] - triads[0, 0, 1]).max() < 1e-14  # the plane's normal stays


def test_transport_on_a_helix_does_not_rotate():
    """The frame turns by minus the torsion against Frenet's: angle tau * length, to order 4."""
    rise = 0.7 / (2 * np.pi)
    rate, errors = 1 / np.hypot(1, rise), []
    for ne in (8, 16):
        basis = DirectorBasis(helix(ne), 1)
        d1, _, d3 = np.moveaxis(basis.triads(), 2, 0)
        turn = rate * basis.arc_lengths
        normal = -np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=-1)
        binormal = np.cross(d3, normal)
        angle = np.unwrap(np.arctan2((d1 * binormal).sum(-1), (d1 * normal).sum(-1)).ravel())
        torsion = rise * rate**2
        errors.append(abs(angle[-1] - angle[0] + torsion * basis.arc_lengths[-1, -1]))
    assert 3.7 < math.log2(errors[0] / errors[1]) < 4.3


def test_transport_closes_on_a_spatial_loop():
    points = [(0, 0, 0), (2, 0, 1), (2, 2, -1), (0, 3, 2), (-1, 1, 0)]
    mesh = MeshCurve.init_curve(CurveSpline(points, closed=True), 400, closed=True)
    basis = DirectorBasis(mesh, 1)
    triads = basis.triads()
    assert np.array_equal(triads[:, -1], np.roll(triads[:, 0], -1, axis=0))
    assert orthonormality(triads) < 2e-14
    # the spread rotation is the same everywhere: rate d2.d1' is constant along the loop
    (a1, a2), (b1, b2) = (np.moveaxis(triads[:, end, :2], 1, 0) for end in (0, -1))
    rate = ((a2 * b1).sum(-1) - (a1 * b2).sum(-1)) / (2 * basis.lengths)
    assert abs(rate.mean()) > 0.01
    assert np.ptp(rate) < 0.02 * abs(rate.mean())


@pytest.mark.parametrize("twist", [0.4, lambda s: 0.4 * s, {"a": 0.4}], ids=["rate", "f", "dict"])
def test_twist_turns_about_the_axis(twist):
    basis = DirectorBasis(MeshCurve.init_line((0, 0, 0), (0, 0, 5), 4, "a"), 2)
    d1, d2, _ = np.moveaxis(basis.triads((1, 0, 0), twist), 2, 0)
    angle = 0.4 * basis.arc_lengths
    exact = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    assert np.abs(d1 - exact).max() < 1e-14
    assert np.abs(d2 - np.cross((0, 0, 1), exact)).max() < 1e-14


def test_hints_and_twists_by_beam():
    basis = DirectorBasis(network(), 1)
    mesh = basis.mesh
    triads = basis.triads({"b": (0, 0, 1), "c": (1, 0, 0)}, {"c": np.pi / 2})
    assert np.allclose(triads[mesh.elements_of("b"), :, 0], (0, 0, 1), atol=1e-15)
    assert np.allclose(triads[mesh.elements_of("c")[0], 0, 0], (1, 0, 0), atol=1e-15)
    assert np.allclose(triads[mesh.elements_of("c")[-1], 1, 0], (0, -1, 0), atol=1e-14)


def test_relative_rotations_at_a_branch():
    basis = DirectorBasis(network(), 3)
    triads = basis.triads({"a": (0, 0, 1), "b": (0, 0, 1), "c": (0.6, 0.8, 0)})
    nodal, rotations = basis.nodal_triads(triads), basis.relative_rotations(triads)
    assert np.abs(rotations @ nodal[basis.connectivity] - triads).max() < 2e-15
    junction = basis.node("a.end")
    assert np.array_equal(nodal[junction], triads[1, -1])  # first element there
    other = (rotations != np.eye(3)).any(axis=(-1, -2))
    assert basis.connectivity[other].tolist() == [junction, junction]


def test_corners_of_a_polyline_stay_corners_at_any_angle():
    corners = [(0, 0, 0), (1, 0, 0), (2, 0.1, 0), (2, 1, 1)]
    triads = DirectorBasis(MeshCurve.init_polyline(corners, 2), 2).triads()
    differs = (triads[:-1, -1] != triads[1:, 0]).any(axis=(-1, -2))
    assert differs.tolist() == [False, True, False, True, False]


def test_transport_over_a_corner_is_the_smallest_rotation():
    frame = MeshCurve.init_polyline([(0, 0, 0), (1, 0, 0), (1, 1, 0)], 1)
    triads = DirectorBasis(frame).triads()
    assert np.allclose(triads[0, 0, 0], (0, 1, 0))
    assert np.allclose(triads[1, 0, 0], (-1, 0, 0))  # turned by 90 degrees about z


def chords(tmp_path, mesh):
    write_mesh(tmp_path / "m.msh", mesh)
    return read_mesh(tmp_path / "m.msh")


@pytest.mark.parametrize("p", [1, 2, 4])
def test_chords_from_a_file_share_mean_tangents(tmp_path, p):
    triads = DirectorBasis(chords(tmp_path, arc(6)), p).triads()
    assert np.array_equal(triads[:-1, -1], triads[1:, 0])
    exact = np.moveaxis(arc(6).mapping().tangent(np.array([[0.0, 1.0]])), 0, -1)
    assert np.abs(triads[1:-1, [0, -1], 2] - exact[1:-1]).max() < 1e-14  # equal chords of a circle
    assert orthonormality(triads) < 2e-14


def test_chords_at_a_feature_stay_a_corner(tmp_path):
    bent = [(0, 0, 0), (1, 0, 0), (1 + math.cos(0.5), math.sin(0.5), 0)]
    mesh = chords(tmp_path, MeshCurve.init_polyline(bent, 1))
    assert mesh.feature_angle == pytest.approx(math.radians(30))
    smooth = DirectorBasis(mesh).triads()
    assert np.array_equal(smooth[0, 1], smooth[1, 0])
    sharp = DirectorBasis(replace(mesh, feature_angle=0.4)).triads()
    assert np.allclose(sharp[0, 1, 2], (1, 0, 0))
    assert np.allclose(sharp[1, 0, 2], (math.cos(0.5), math.sin(0.5), 0))


def test_a_closed_chord_ring_is_smooth_where_it_closes(tmp_path):
    mesh = chords(tmp_path, MeshCurve.init_arc(*ARC, 2 * np.pi, 16, "ring"))
    triads = DirectorBasis(mesh, 2).triads()
    assert np.array_equal(triads[-1, -1], triads[0, 0])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"directors": {"arc": (0, 0, 2)}}, r"beam 'arc'.*\[0.0, 0.0, 2.0\].*length 2"),
        ({"directors": (0, np.nan, 1)}, "'arc'.*nan"),
        ({"directors": (0, 1)}, r"'arc'.*\(2,\)"),
        ({"directors": {"ark": (0, 0, 1)}}, "beam 'ark'.*known beams: 'arc'"),
        ({"twist": np.nan}, "twist of beam 'arc'.*nan"),
        ({"twist": lambda s: np.inf}, "twist of beam 'arc'.*0 m"),
        ({"twist": {"arc": [1, 2, 3]}}, r"twist of beam 'arc'.*\[1, 2, 3\]"),
    ],
)
def test_errors_of_triads(options, words):
    with pytest.raises(InputError, match=words):
        DirectorBasis(arc(), 2).triads(**options)


def test_hint_parallel_at_an_interior_node_only():
    mesh = MeshCurve.init_arc(*ARC, np.pi, 1)
    hint = (0, 1, 0)  # the tangent in the middle of the half circle
    assert DirectorBasis(mesh, 1).triads(directors=hint).shape == (1, 2, 3, 3)
    with pytest.raises(MeshError, match=r"parallel .* arc length 3.14159 m"):
        DirectorBasis(mesh, 2).triads(directors=hint)


# ----------------------------------------------------------------------- attributes


@pytest.mark.one_quick
@pytest.mark.parametrize(
    "name", ["basis", "dx", "dofs", "doflocs", "elem", "mapping", "Nbfun", "nelems", "X", "W"]
)
def test_each_attribute_of_a_basis_is_there_when_it_is_the_first_to_be_asked_for(name: str):
    fresh, full = (DirectorBasis(helix(), 3) for _ in range(2))
    assert full.element_dofs.shape == (48, full.mesh.nelements)
    found, known = getattr(fresh, name), getattr(full, name)
    assert type(found) is type(known)
    if isinstance(known, np.ndarray):
        assert np.array_equal(found, known) and not found.flags.writeable


def test_a_basis_says_what_it_does_not_have():
    basis = copy(DirectorBasis(helix(), 1))
    with pytest.raises(AttributeError, match="no attribute 'no_such_name'"):
        _ = basis.no_such_name
