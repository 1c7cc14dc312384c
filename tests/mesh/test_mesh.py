import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import skfem
from scipy.integrate import quad
from skfem import Basis, BilinearForm, ElementLineP1, ElementLineP2, FacetBasis, Functional

import skfem_cosserat as sc
from skfem_cosserat import MeshCurve, MeshError
from skfem_cosserat.mesh import (
    CurveArc,
    CurveHelix,
    CurveLine,
    CurveMoved,
    CurveSpline,
    topology,
)

ARC = ((0, 0, 0), (1, 0, 0), (0, 1, 0), 2.0)  # start, tangent, normal, radius
CENTRE = np.array([0.0, 2.0, 0.0])


X, Y, Z = np.eye(3)


def rod(elements=4, **options):
    return MeshCurve.init_line((0, 0, 0), X, elements, name="a", **options)


def ring(elements=7):
    return MeshCurve.init_arc(*ARC, 2 * np.pi, elements, name="ring")


def tee():
    flange = MeshCurve.init_line((-1, 0, 0), (1, 0, 0), 4, name="flange")
    web = MeshCurve.init_line((0, 0, 0), (0, 0, -3), 3, name="web")
    return flange.joined(web)


def integral(mesh, function, degree=8):
    form = Functional(lambda w: function(w.x))
    return form.assemble(Basis(mesh, ElementLineP1(), intorder=degree))


CURVES = {
    "line": CurveLine((1, 2, 3), (-1, 0, 2)),
    "arc": CurveArc((1, 0, 0), (1, 1, 0), (0, 3, 1), 0.7, 5.0),
    "helix": CurveHelix((1, 1, 0), (0, 0, 0), (0, 0, 2), 0.4, 2.5),
    "left helix": CurveHelix((1, 1, 0), (0, 0, 0), (0, 0, 2), -0.4, 2.5),
    "spline": CurveSpline([(0, 0, 0), (1, 0.2, 0), (1.5, 1, 0.5), (2, 1, 2), (1, 3, 1)]),
    "closed spline": CurveSpline([(0, 0, 0), (1, 0.2, 0), (1.5, 1, 0.5), (0, 2, 1)], closed=True),
    "moved": CurveMoved(CurveArc(*ARC, 1.0), np.diag([1.0, -1.0, 1.0]), np.array([1.0, 2, 3])),
}


@pytest.mark.parametrize("name", CURVES)
def test_curves_are_parametrised_by_arc_length(name):
    curve = CURVES[name]
    s = np.linspace(0.03, 0.97, 23) * curve.length
    h = 1e-6 * curve.length
    slope = (curve.point(s + h) - curve.point(s - h)) / (2 * h)
    assert np.abs(slope - curve.tangent(s)).max() < 1e-8
    assert np.abs(np.linalg.norm(curve.tangent(s), axis=0) - 1).max() < 1e-14
    assert curve.point(0.3).shape == curve.tangent(0.3).shape == (3,)
    assert curve.point(np.ones((2, 5))).shape == curve.tangent(np.ones((2, 5))).shape == (3, 2, 5)


@pytest.mark.parametrize("name", ["spline", "closed spline"])
def test_spline_arc_length_to_1e_12(name):
    curve = CURVES[name]

    def speed(u):
        return np.linalg.norm(curve._spline(u, 1))

    lengths = [quad(speed, *ends, epsabs=0, epsrel=1e-13)[0] for ends in pairwise(curve._spline.x)]
    assert abs(sum(lengths) - curve.length) < 1e-12 * curve.length
    assert np.abs(curve.point(curve.knots[: len(curve.points)]).T - curve.points).max() < 1e-14


def test_spline_through_points_of_a_circle_approaches_it():
    errors = []
    for n in (16, 32):
        angle = 2 * np.pi * np.arange(n) / n
        points = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        errors.append(abs(CurveSpline(points, closed=True).length - 2 * np.pi))
    assert math.log2(errors[0] / errors[1]) > 3.7


def test_closed_spline_is_smooth_at_its_start():
    curve = CURVES["closed spline"]
    assert np.abs(curve.tangent(0.0) - curve.tangent(curve.length)).max() < 1e-12


@pytest.mark.parametrize(("name", "quarter"), [("helix", (-1, 1)), ("left helix", (1, -1))])
def test_helix_advances_by_its_pitch_on_either_hand(name, quarter):
    """2.5 turns from (1, 1), of which a tenth is a quarter turn."""
    curve = CURVES[name]
    assert curve.point(curve.length)[2] == pytest.approx(2.5 * 0.4, abs=1e-14)
    assert curve.length == pytest.approx(2.5 * np.hypot(2 * np.pi * np.sqrt(2), 0.4), rel=1e-15)
    assert np.allclose(curve.point(curve.length / 10)[:2], quarter)


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: CurveLine((1, 2, 3), (1, 2, 3)), r"line.*\[1.0, 2.0, 3.0\]"),
        (lambda: CurveLine((1, 2, 3), (1, np.nan, 3)), "line end.*nan"),
        (lambda: CurveArc((0, 0, 0), (1, 0, 0), (2, 0, 0), 1, 1), r"arc normal.*\(2, 0, 0\)"),
        (lambda: CurveArc((0, 0, 0), (1, 0, 0), (0, 1, 0), -2.5, 1), "arc radius.*-2.5"),
        (lambda: CurveArc((0, 0, 0), (1, 0, 0), (0, 1, 0), 1, 7.0), "arc angle.*7.0"),
        (lambda: CurveHelix((0, 0, 3), (0, 0, 0), (0, 0, 1), 1, 1), "helix start.*axis"),
        (lambda: CurveHelix((1, 0, 3), (0, 0, 0), (0, 0, 1), np.inf, 1), "helix pitch.*inf"),
        (lambda: CurveHelix((1, 0, 3), (0, 0, 0), (0, 0, 1), 1, 0), "helix turns.*0"),
        (lambda: CurveSpline([(0, 0, 0)]), r"spline points.*\(1, 3\)"),
        (lambda: CurveSpline([(0, 0, 0), (1, 0, 0)], closed=True), r"spline points.*\(2, 3\)"),
        (lambda: CurveSpline([(0, 0, 0), (0, 0, 0), (1, 0, 0)]), "spline points.*0 and 1"),
    ],
)
def test_impossible_curves(make, words):
    with pytest.raises(MeshError, match=words):
        make()


# ----------------------------------------------------------------------- exact integrals


@pytest.mark.parametrize("elements", [2, 7])
def test_integrals_over_a_ring(elements):
    """Two elements between the same vertices are no duplicates."""
    mesh = ring(elements)
    assert integral(mesh, lambda x: 1 + 0 * x[0], 30) == pytest.approx(4 * np.pi, rel=1e-15)
    assert integral(mesh, lambda x: x[0] ** 2, 30) == pytest.approx(8 * np.pi, rel=1e-13)
    assert mesh.nvertices == elements
    assert list(mesh.nodes) == ["ring.start"]


def test_integrals_over_a_branching_network():
    mesh = tee()
    assert integral(mesh, lambda x: x[2]) == pytest.approx(-4.5, rel=1e-15)
    mass = BilinearForm(lambda u, v, w: u * v).assemble(Basis(mesh, ElementLineP1()))
    j = mesh.node("web.start")
    assert mass.sum() == pytest.approx(5.0, rel=1e-15)
    assert mass[j, j] == pytest.approx((0.5 + 0.5 + 1.0) / 3, rel=1e-15)  # all three elements


def test_laplacian_on_a_branching_network_gives_kirchhoff():
    """Fixed at all three ends: the potential of the junction is the mean weighted by 1/length."""
    mesh = tee()
    basis = Basis(mesh, ElementLineP1())
    stiffness = BilinearForm(lambda u, v, w: u.grad[0] * v.grad[0]).assemble(basis)
    x = np.zeros(basis.N)
    ends = [mesh.node(name) for name in ("flange.start", "flange.end", "web.end")]
    x[ends] = 1.0, 2.0, 6.0
    x = skfem.solve(*skfem.condense(stiffness, x=x, D=np.array(ends)))
    assert x[mesh.node("web.start")] == pytest.approx((1 + 2 + 6 / 3) / (1 + 1 + 1 / 3), rel=1e-14)


def test_dofs_by_position_name_and_beam():
    mesh = tee()
    basis = Basis(mesh, ElementLineP1())
    tip = basis.get_dofs(lambda x: np.isclose(x[2], -3)).all()
    assert tip.tolist() == basis.get_dofs("web.end").all().tolist() == [mesh.node("web.end")]
    assert len(basis.get_dofs(elements="flange").all()) == 5


def test_point_load_by_a_facet_basis_is_exact():
    mesh = tee()
    for name in ("web.end", "web.start", "flange.start"):
        facet = FacetBasis(mesh, ElementLineP2(), facets=name)
        load = skfem.LinearForm(lambda v, w: 7.0 * v).assemble(facet)
        expected = np.zeros(facet.N)
        expected[mesh.node(name)] = 7.0
        assert np.array_equal(load, expected)


def test_normals_are_outward_tangents():
    mesh = MeshCurve.init_arc(*ARC, np.pi / 2, 4)
    start = FacetBasis(mesh, ElementLineP1(), facets="beam.start").normals
    end = FacetBasis(mesh, ElementLineP1(), facets="beam.end").normals
    assert np.allclose(start[:, 0, 0], (-1, 0, 0), atol=1e-15)
    assert np.allclose(end[:, 0, 0], (0, 1, 0), atol=1e-15)


def test_inverse_mapping():
    mesh = ring(5)
    s = np.array([0.1, 2.0, 6.3, 12.5])
    x = mesh.curves[0].point(s)
    elements = mesh.element_finder()(*x)
    assert elements.tolist() == (s // mesh.lengths[0]).astype(int).tolist()
    xi = mesh.mapping().invF(x[:, :, None], elements)
    assert np.abs(xi[0, :, 0] - (s % mesh.lengths[0]) / mesh.lengths[0]).max() < 1e-13
    with pytest.raises(MeshError, match=r"\[9.0, 0.0, 0.0\]"):
        mesh.element_finder()(*np.array([[9.0], [0], [0]]))


def test_values_at_points_and_projections():
    mesh = ring(5)
    basis = Basis(mesh, ElementLineP2())
    y = basis.project(lambda x: x[0] - 2 * x[1])
    x = mesh.curves[0].point(np.array([0.1, 2.0, 6.3, 12.5]))
    assert np.array_equal(basis.probes(x) @ y, basis.interpolator(y)(x))
    assert np.abs(basis.probes(x) @ y - x[0] + 2 * x[1]).max() < 0.05  # of quadratic elements


# ----------------------------------------------------------------------- refinement
@pytest.mark.parametrize("how", [1, 3, np.int64(2), [1, 2], np.array([True] + 6 * [False])])
def test_refinement_stays_on_the_curve_and_keeps_names(how):
    mesh = ring().with_nodes({"n3": 3}).with_beams({"part": [1, 2, 5]})
    fine = mesh.refined(how)
    assert np.abs(np.linalg.norm(fine.p - CENTRE[:, None], axis=0) - 2).max() < 1e-14
    assert fine.lengths.sum() == pytest.approx(4 * np.pi, rel=1e-15)
    assert len(fine.elements_of("ring")) == fine.nelements > mesh.nelements
    assert fine.lengths[fine.elements_of("part")].sum() == pytest.approx(12 * np.pi / 7, rel=1e-14)
    assert np.array_equal(fine.p[:, fine.node("n3")], mesh.p[:, 3])
    assert integral(fine, lambda x: x[0] ** 2, 20) == pytest.approx(8 * np.pi, rel=1e-13)
    chain = fine.chains[0].elements
    assert np.array_equal(chain, np.arange(fine.nelements))  # children in their parent's place


def test_refinement_of_a_network_by_beam_name():
    fine = tee().refined("web")
    assert len(fine.elements_of("web")) == 6
    assert len(fine.elements_of("flange")) == 4
    assert len(fine.elements_at("web.start")) == 3
    assert (fine.p[2, fine.t[1, fine.elements_of("web")]] < 0).all()
    assert integral(fine.refined(2).refined(0), lambda x: x[2]) == pytest.approx(-4.5, rel=1e-15)


@pytest.mark.parametrize(
    ("bad", "words"),
    [([99], "99"), ([0.5], "float"), ("boom", "'flange', 'web'"), (np.ones(2, bool), r"\(2,\)")],
)
def test_refining_nothing_or_nonsense(bad, words):
    assert tee().refined([]).nelements == 7
    with pytest.raises(MeshError, match=words):
        tee().refined(bad)


# ----------------------------------------------------------------------- factories and names
def test_polyline_with_named_corner():
    corners = np.array([(0, 0, 0), (0, 3, 0), (4, 3, 0)])
    mesh = MeshCurve.init_polyline(corners, [3, 2], name="frame", nodes={"elbow": 3 / 7})
    assert np.allclose(mesh.p[:, mesh.node("elbow")], corners[1])
    assert mesh.nelements == mesh.node("frame.end") == mesh.node(corners[2]) == 5
    triangle = MeshCurve.init_polyline(corners, 2, closed=True)
    assert triangle.nvertices == 6
    assert triangle.chains[0].closed


@pytest.mark.parametrize("closed", [False, True])
def test_points_are_the_vertices(closed):
    points = np.array([(0, 0, 0), (1, 0.1, 0.0), (2, 0.5, 0.3), (2.5, 1.5, 1)])
    mesh = MeshCurve.init_points(points, closed=closed)
    assert np.array_equal(mesh.p.T, points)
    assert np.array_equal(mesh.refined(2).p.T[:4], points)
    assert (mesh.lengths[:3] > np.linalg.norm(np.diff(points, axis=0), axis=1)).all()
    assert mesh.nelements == 3 + closed
    assert mesh.chains[0].closed == closed


def test_names_and_lookup():
    mesh = rod(nodes={"mid": 0.5, "begin": 0})
    assert [mesh.node(k) for k in ("a.start", "begin", "mid", "a.end")] == [0, 0, 2, 4]
    assert mesh.node(3) == mesh.node((0.75, 0, 0)) == 3
    assert mesh.with_nodes({"hook": (0.25, 0, 0), "eye": 3}).node("hook") == 1
    assert mesh.elements_of("a").tolist() == [0, 1, 2, 3]
    assert mesh.unnamed_elements().size == 0
    bare = replace(mesh, _subdomains=None).with_beams({"left": [0, 1]})
    assert bare.unnamed_elements().tolist() == [2, 3]


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda m: m.node("tipp"), "node 'tipp'.*'flange.start'.*'web.end'"),
        (lambda m: m.node(77), "node 77.*0 .. 7"),
        (lambda m: m.node((5, 0, 0)), r"\[5.0, 0.0, 0.0\].*nearest.*4 m"),
        (lambda m: m.node((5, 0)), r"\(5, 0\).*position"),
        (lambda m: m.elements_of("webb"), "beam 'webb'.*'flange', 'web'"),
        (lambda m: m.with_nodes({"web.end": 0}), "node 'web.end'.*taken"),
        (lambda m: m.with_nodes({"x": "web.end"}), "node 'x'.*'web.end'"),
        (lambda m: m.with_beams({"web": [0]}), "beam 'web'.*taken"),
        (lambda m: m.with_beams({"x": [70]}), "beam 'x'.*70"),
        (lambda m: replace(m, feature_angle=-1.0), "feature_angle.*-1.0"),
        (lambda m: replace(m, curve_ids=m.curve_ids[:-1]), r"curve_ids.*\(6,\)"),
        (lambda m: replace(m, curve_ids=m.curve_ids + 5), "curve_ids.*number 5"),
        (lambda m: replace(m, spans=m.spans + 1.5), r"element 1.*\[2.0, 2.5\].*2.0 m"),
        (lambda m: replace(m, doflocs=m.p + 1.0), "element 0.*off its curve"),
        (lambda m: m.moved(2 * np.eye(3)), "rotation.*orthogonal"),
        (lambda m: m.translated((1, 2)), r"shift.*\(1, 2\)"),
        (lambda m: m.joined(m), "element 7: duplicates element 0"),
        (lambda m: rod(0), "beam 'a'.*0"),
        (
            lambda m: rod(nodes={"m": 0.3}),
            "node 'm'.*0.3.*0.25",
        ),
        (
            lambda m: rod(nodes={"m": np.nan}),
            "node 'm'.*nan",
        ),
        (
            lambda m: rod(nodes={"a.end": 0}),
            "node 'a.end'.*given",
        ),
        (lambda m: MeshCurve.init_polyline([(0, 0, 0)], 2), r"beam 'beam'.*\(1, 3\)"),
        (
            lambda m: MeshCurve.init_polyline([(0, 0, 0), (1, 0, 0)], [2, 3]),
            "beam 'beam'.*2 numbers.*1 legs",
        ),
    ],
)
def test_errors_name_the_item_and_the_value(call, words):
    with pytest.raises(MeshError, match=words):
        call(tee())


LINE = np.array([[0.0, 1.0, 2.0], [0, 0, 0], [0, 0, 0]])


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("points", "t", "words"),
    [
        (LINE, np.zeros((2, 0), int), r"no elements.*\(2, 0\)"),
        (LINE[:2], [[0, 1], [1, 2]], r"\(2, 3\).*expected \(3, nv\)"),
        (LINE, [[0, 1, 2]], r"connectivity.*\(1, 3\)"),
        (LINE, [[0, 1], [1, 3]], r"element 1.*\[1, 3\]"),
        (LINE, [[0], [1]], r"node 2.*\[2.0, 0.0, 0.0\].*no element"),
        (LINE, [[0, 1, 2], [1, 2, 2]], "element 2.*nodes 2 and 2"),
        (LINE, [[0, 1, 2], [1, 2, 1]], r"element 2.*duplicates element 1.*\[1, 2\]"),
        (LINE * [[1], [np.nan], [1]], [[0, 1], [1, 2]], "node 0.*nan"),
        (LINE[:, [0, 1, 1]], [[0, 1], [1, 2]], "element 1.*1 and 2.*zero length"),
    ],
)
def test_bad_arrays_are_refused_at_construction(points, t, words):
    with pytest.raises(MeshError, match=words):
        MeshCurve(points, np.array(t))


def test_a_name_of_two_nodes_is_no_node():
    mesh = replace(tee(), _boundaries={"both": np.array([0, 1])})
    with pytest.raises(MeshError, match="'both': names 2 nodes"):
        mesh.node("both")


# ----------------------------------------------------------------------- networks
def test_joined_merges_and_keeps_both_automatic_names():
    b = MeshCurve.init_arc(X, X, Y, 1.0, np.pi, 4, "b")
    c = MeshCurve.init_line((1, 2, 0), (0, 0, 0), 3, "c")
    mesh = rod().joined(b, c)
    assert mesh.nvertices == 5 + 3 + 3 == (rod() + b + c).nvertices
    for end, start in ("ab", "bc", "ca"):
        assert mesh.node(f"{end}.end") == mesh.node(f"{start}.start")
    assert mesh.lengths.sum() == pytest.approx(1 + np.pi + np.sqrt(5), rel=1e-15)
    assert len(mesh.chains) == 3
    assert mesh.arc_starts[mesh.elements_of("c")][0] == 0


def test_unwelded_beams_keep_their_own_nodes():
    b, c = (MeshCurve.init_line(X, X + end, 2, name) for end, name in ((Y, "b"), (Z, "c")))
    mesh = rod().joined(b, weld=False)
    assert mesh.nvertices == 8
    assert mesh.node("a.end") != mesh.node("b.start")
    with pytest.raises(MeshError, match=r"several nodes there: \[4, 5\]"):
        mesh.node(X)
    with pytest.raises(MeshError, match=r"several nodes \[4, 5\]"):
        mesh.joined(c)
    with pytest.raises(MeshError, match="merged into one"):
        c.joined(mesh)


def test_tolerance_of_joining():
    b = MeshCurve.init_line((1 + 1e-7, 0, 0), (1, 1, 0), 2, "b")
    assert (rod() + b).nvertices == 8
    assert rod().joined(b, tol=1e-6).nvertices == 7
    with pytest.raises(MeshError, match=r"tol: 0.6 m would collapse|several nodes"):
        rod().joined(b, tol=0.6)


def test_changed_copies_carry_their_curves():
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    mesh = tee().joined(ring())
    for other in (
        mesh.moved(turn, (1, 2, 3)),
        mesh.translated((1, 2, 3)),
        mesh.mirrored((0, 3, 0), (0, 1, 0)),
        mesh.copy(),
    ):
        assert other.refined().lengths.sum() == pytest.approx(mesh.lengths.sum(), rel=1e-14)
        assert list(other.beams) == ["flange", "web", "ring"]
    assert np.allclose(mesh.mirrored((0, 1, 0), (0, 1, 0)).p[1], 2 - mesh.p[1])


def test_restrict_keeps_curves_and_names():
    mesh = tee().joined(ring())
    part, vertices = mesh.restrict("ring", return_mapping=True)
    assert part.lengths.sum() == pytest.approx(4 * np.pi, rel=1e-15)
    assert list(part.beams) == ["ring"]
    assert np.array_equal(part.p, mesh.p[:, vertices])
    assert mesh.remove_elements(mesh.elements_of("ring")).nelements == tee().nelements
    bare = mesh.restrict("web", skip_boundaries=True, skip_subdomains=True)
    assert bare.beams == bare.nodes == {}


def test_directed_turns_opposing_elements():
    mesh = MeshCurve(LINE, np.array([[0, 2], [1, 1]]), _subdomains={"b": np.array([0, 1])})
    with pytest.raises(MeshError, match=r"beam 'b': elements 0 and 1 point against .* node 1"):
        _ = mesh.chains
    turned = mesh.directed()
    assert turned.t.tolist() == [[0, 1], [1, 2]]
    assert turned.arc_starts.tolist() == [0.0, 1.0]


def test_a_turned_element_on_a_curve_runs_backwards():
    mesh = MeshCurve.init_arc(*ARC, 1.0, 2)
    back = replace(mesh, t=mesh.t[::-1], spans=mesh.spans[::-1])
    X = np.array([[0.0, 0.3, 1.0]])
    assert np.allclose(back.mapping().F(X), mesh.mapping().F(1 - X)[:, :, :], atol=1e-15)
    assert np.allclose(back.mapping().tangent(X), -mesh.mapping().tangent(1 - X), atol=1e-15)
    assert [chain.elements.tolist() for chain in back.chains] == [[1, 0]]


def test_branches_inside_one_beam_end_chains():
    mesh = replace(tee(), _subdomains={"all": np.arange(7)})
    assert sorted(len(chain.elements) for chain in mesh.chains) == [2, 2, 3]
    assert mesh.boundary_facets().tolist() == sorted(
        mesh.node(n) for n in ("flange.start", "flange.end", "web.end")
    )


def test_defaults_and_parameters():
    mesh = tee()
    named = mesh.with_defaults()
    assert named.node("left") == mesh.node("flange.start")
    assert mesh.param() == 1.0
    assert mesh.is_valid(raise_=True)
    assert mesh.elements_satisfying(lambda x: x[2] < 0).tolist() == [4, 5, 6]
    assert isinstance(MeshCurve.init_refdom(), skfem.MeshLine1)


@pytest.mark.one_quick
@pytest.mark.parametrize("number", [10**400, 10**15], ids=["float overflows", "huge"])
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda number: tee().refined(number), "refinement: 1000.* times, expected at most 20"),
        (ring, "number of elements is 10000"),
        (lambda number: MeshCurve.init_polyline(np.eye(3), number), "beam': number of elements is"),
        (lambda number: tee().restrict([number]), "elements? "),
    ],
)
def test_huge_numbers_are_refused_at_once(call, words, number):
    with pytest.raises(MeshError, match=words) as caught:
        call(number)
    assert len(str(caught.value)) < 200
    with pytest.raises(MeshError, match="line start"):
        MeshCurve.init_line((0, 0, 10**400), (1, 0, 0), 2)


def test_chains_of_random_networks():
    """Head to tail within one beam, each element in one chain, ended by branches and free ends."""
    rng, closed = np.random.default_rng(1), 0
    for _ in range(200):
        count = int(rng.integers(3, 9))
        t = np.array([rng.choice(count, 2, replace=False) for _ in range(rng.integers(1, 11))]).T
        owner = rng.integers(-1, 2, t.shape[1])
        t = np.where(topology.directed_flips(t, owner), t[::-1], t)
        order = topology.find_chains(t, owner, ["a", "b"])
        chains, follows = order.chains(), []
        assert sorted(np.concatenate([c.elements for c in chains])) == list(range(t.shape[1]))
        for chain in chains:
            e = chain.elements.tolist()
            pairs = list(pairwise([*e, e[0]] if chain.closed else e))
            assert all(t[1, one] == t[0, other] for one, other in pairs)
            assert (owner[e] == chain.owner).all()
            there = np.bincount(t[:, owner == chain.owner].ravel(), minlength=count)
            assert (there[t[1, e[:-1]]] == 2).all()
            assert chain.closed or 2 not in there[[t[0, e[0]], t[1, e[-1]]]]
            closed += chain.closed
            follows += pairs
        assert list(zip(order.before.tolist(), order.after.tolist(), strict=True)) == follows
    assert closed > 10


# ----------------------------------------------------------------------- lines that cross
def cross(n, height=0.0):
    a = MeshCurve.init_line((-1, 0, 0), (1, 0, 0), n, name="a")
    return a, MeshCurve.init_line((0, -1, height), (0, 1, height), n, name="b")


def test_a_join_that_finds_no_vertex_says_where_the_lines_cross():
    """An odd number of elements has no vertex in the middle."""
    a, b = cross(5)
    with pytest.warns(sc.ModelWarning, match=r"elements . and . meet at \[0.0, 0.0, 0.0\]"):
        a.joined(b)


def test_lines_that_share_a_vertex_or_pass_each_other_are_as_meant():
    """So are those that are joined without welding: they get a joint."""
    a, b = cross(4)
    assert a.joined(b).nvertices == 9
    a, b = cross(5, height=1e-3)
    assert a.joined(b).nvertices == 12
    a, b = cross(5)
    assert a.joined(b, weld=False).nvertices == 12


def test_an_end_on_the_middle_of_an_element():
    """A web on a flange: it has a vertex there, the flange has none."""
    flange = MeshCurve.init_line((0, 0, 0), (2, 0, 0), 3, "flange")
    web = MeshCurve.init_line((1, 0, 0), (1, 1, 0), 2, "web")
    with pytest.warns(sc.ModelWarning, match=r"meet at \[1.0, 0.0, 0.0\]"):
        flange.joined(web)


def test_a_file_whose_lines_cross(tmp_path):
    """Two diagonals of a square, and all pairs of a lattice that is long in one direction."""
    points = np.array([(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 0), (0, 0.25, 0), (90, 0.25, 0)])
    mesh = MeshCurve(points.T.astype(float), np.array([[0, 2, 4], [1, 3, 5]]))
    sc.mesh.write_mesh(tmp_path / "square.msh", mesh)
    with pytest.warns(sc.ModelWarning, match=r"\(2 more like it\)"):
        sc.mesh.read_mesh(tmp_path / "square.msh")


def test_a_section_thicker_than_its_beam_is_long():
    """A radius in mm beside a length in m."""
    steel, line = sc.Material(210e9, 0.3, 7850.0), rod(1)
    with pytest.warns(sc.ModelWarning, match="20 m thick, more than its whole length of 1 m"):
        beam = sc.Beam(line, sc.SectionCircle(10.0, steel))
    assert beam.warnings
    assert not sc.Beam(line, sc.SectionCircle(0.01, steel)).warnings


def test_inertia_about_the_axes_in_place_of_along_them():
    """``int rho X_2^2 dA`` belongs to d2, EI_1 is ``int E X_2^2 dA``: exchanged numbers show."""
    good = sc.SectionRectangle(0.02, 0.12, sc.Material(70e9, 0.3, 2700.0))
    D = good.stiffness.diagonal()
    about = {"EA": D[2], "GA": D[0], "EI": D[3:5], "GJ": D[5], "mass": good.mass}
    sc.Section.from_constants(**about, inertia=good.inertia)
    with pytest.warns(sc.ModelWarning, match="exchange"):
        sc.Section.from_constants(**about, inertia=good.inertia[::-1])
