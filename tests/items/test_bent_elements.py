"""Elements bent too far: named at construction and during a run; the angles are those measured."""

from __future__ import annotations

import numpy as np
import pytest

from skfem_cosserat import (
    Beam,
    Diverged,
    InterpolationEquidistant,
    InterpolationLobatto,
    JointFixed,
    LoadMoment,
    Material,
    MeshCurve,
    MeshError,
    Model,
    ModelWarning,
    Section,
    SectionCircle,
    ground,
    static,
)
from skfem_cosserat.diagnostics import strain_energy
from skfem_cosserat.kernels import exp_quaternion, rotation_matrix
from skfem_cosserat.mesh import CurveSpline
from skfem_cosserat.mesh.bends import turns
from skfem_cosserat.model.limits import first_over_rotated, over_rotated

ORDERS = (1, 2, 3, 4)
SECTION = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
#: no stiffness against shear and extension to speak of, and unit bending stiffness
BENDING = Section([1e-20, 1e-20, 1e-20, 1.0, 1.0, 1.0], mass=1.0, inertia=(1.0, 1.0))


def turned(theta: np.ndarray) -> np.ndarray:
    """Triads (.., 3, 3) turned by rotation vectors from e1, e2, e3."""
    return np.swapaxes(rotation_matrix(exp_quaternion(theta)), -1, -2)


# ----------------------------------------------------------------------- the angles themselves
class BentElement:
    """One straight element of length 1, its nodes at given angles about e1, nothing but bending."""

    def __init__(self, kind):
        model = Model()
        mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 1), 1)
        self.beam = model.add("b", Beam(mesh, BENDING, order=kind, director=(1, 0, 0)))
        self.system = model.freeze()
        self.along = self.beam.basis.connectivity[0]
        self.nodes = self.beam.basis.interpolation.nodes

    def energy(self, angles: np.ndarray) -> np.ndarray:
        """Of nodes at angles (k, p + 1)."""
        y = np.tile(self.system.q0.reshape(-1, 4, 3), (len(angles), 1, 1, 1))
        for a, node in enumerate(self.along):
            y[:, node, 1:] = turned(angles[:, a, None] * [1.0, 0, 0])
        return strain_energy(self.system, y.reshape(len(angles), -1))

    def derivatives(self, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and Hessian by all angles but the first, by differences of fourth order."""
        p, h = len(angles) - 1, 1e-2
        c, w = np.array([-2, -1, 1, 2]), np.array([1, -8, 8, -1]) / 12
        e = h * np.eye(p + 1)[1:]
        steps = angles + c[:, None, None] * e
        gradient = w @ self.energy(steps.reshape(-1, p + 1)).reshape(4, p) / h
        grid = angles + (
            c[:, None, None, None, None] * e[:, None] + c[:, None, None, None] * e
        )  # (4, 4, p, p, p + 1): k, l, i, j
        values = self.energy(grid.reshape(-1, p + 1)).reshape(4, 4, p, p)
        return gradient, np.einsum("k,l,klij->ij", w, w, values) / h**2

    def bent(self, angle: float) -> np.ndarray:
        """Angles of the nodes, the inner ones in equilibrium."""
        angles = np.zeros(len(self.nodes))
        for part in np.linspace(0.1, 1.0, 10):
            angles[1:-1] += angle * part * self.nodes[1:-1] - angles[-1] * self.nodes[1:-1]
            angles[-1] = angle * part
            for _ in range(6):
                gradient, hessian = self.derivatives(angles)
                if len(angles) > 2:
                    angles[1:-1] -= np.linalg.solve(hessian[:-1, :-1], gradient[:-1])
        return angles

    def stiffness(self, angle: float) -> float:
        """Lowest eigenvalue; clamped at the start, with a moment at the end."""
        return float(np.linalg.eigvalsh(self.derivatives(self.bent(angle))[1])[0])


@pytest.mark.one_quick
@pytest.mark.parametrize("p", ORDERS)
def test_limits_are_where_an_element_gives_way(p):
    element = BentElement(p)
    limit = element.beam.basis.interpolation.turn_limit
    assert element.stiffness(0.05) > 0.4
    assert element.stiffness(0.998 * limit) > 1e-4
    assert element.stiffness(1.002 * limit) < -1e-4


def test_moment_of_a_linear_element_peaks_at_45_degrees():
    element = BentElement(1)
    angles = np.radians([1.0, 20.0, 45.0, 70.0, 89.0])
    moments = [element.derivatives(np.array([0, t]))[0][0] for t in angles]
    assert np.abs(moments - np.sin(2 * angles) / 2).max() < 1e-7
    fold = element.energy(np.array([[0, np.pi]]))
    assert abs(fold[0]) < 1e-15  # a fold costs nothing


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("kind", "away"),
    [(InterpolationLobatto(p, points=p + 1), 0.06) for p in ORDERS]
    + [(InterpolationEquidistant(p), 0.17) for p in (3, 4)],
)
def test_limits_of_variants_are_near(kind, away):
    element = BentElement(kind)
    assert element.stiffness((1 - away) * kind.turn_limit) > 0
    assert element.stiffness((1 + away) * kind.turn_limit) < 0


# beyond 45 degrees the reference is warned of, and that is what is looked at here
@pytest.mark.filterwarnings("ignore::skfem_cosserat.ModelWarning")
@pytest.mark.parametrize("degrees", [30.0, 45.0, 60.0, 80.0])
def test_a_linear_element_bent_in_the_reference_is_soft(degrees):
    """Its bending stiffness is EI cos^2(t)/l: half at 45 degrees, nothing at 90."""
    angle = np.radians(degrees)
    mesh = MeshCurve.init_arc((0, 0, 0), (0, 0, 1), (0, -1, 0), 1 / angle, angle, 1)
    model = Model()
    model.add("b", Beam(mesh, BENDING, director=(1, 0, 0)))
    system = model.freeze()
    y = np.tile(system.q0.reshape(-1, 4, 3), (3, 1, 1, 1))
    h = 1e-3
    y[:, 1, 1:] = turned(np.array([angle - h, angle, angle + h])[:, None] * [1.0, 0, 0])
    energy = strain_energy(system, y.reshape(3, -1))
    assert abs(energy[1]) < 1e-18
    assert abs((energy[0] + energy[2]) / h**2 - np.cos(angle) ** 2) < 1e-5


# ----------------------------------------------------------------------- during a run
def scene(order: int, elements: int = 3, **options):
    model = Model()
    mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 3), elements)
    beam = model.add("boom", Beam(mesh, SECTION, order=order, director=(1, 0, 0), **options))
    return model.freeze(), beam


def bent(system, beam, rotation_at) -> np.ndarray:
    """Rows of y with triads turned by a rotation vector that depends on arc length."""
    y = system.q0.reshape(-1, 4, 3).copy()
    R = rotation_matrix(exp_quaternion(rotation_at(beam.basis.nodes[:, 2:])))
    first = system.first[id(beam)][0]
    own = slice(first, first + beam.basis.n_nodes)
    y[own, 1:] = y[own, 1:] @ np.swapaxes(R, 1, 2)
    return y.reshape(-1, 3)


NAMES = ("linear", "quadratic", "cubic", "quartic")


@pytest.mark.one_quick
@pytest.mark.parametrize("p", ORDERS)
@pytest.mark.parametrize("axis", [(1.0, 0, 0), (0, 0, 1.0), (0.6, 0, -0.8)])
def test_bent_elements_are_named(p, axis):
    """Bending, torsion and both, only in the middle of three elements."""
    system, beam = scene(p)
    limit = beam.basis.interpolation.turn_limit

    def middle(share):
        angle = share * limit
        return bent(system, beam, lambda s: np.clip(s - 1, 0, 1) * angle * np.array(axis))

    assert over_rotated(system, middle(0.98)) is None
    text = over_rotated(system, middle(1.04))
    shown, bound = f"{np.degrees(1.04 * limit):.3g}", f"{np.degrees(limit):.3g}"
    assert text == (
        f"relative rotation between nodes 1 and 2 of beam 'boom' is {shown} degrees, beyond the"
        f" {bound} that a {NAMES[p - 1]} element can be bent by: refine"
    )


@pytest.mark.parametrize("p", ORDERS)
def test_the_first_of_many_states_is_found(p):
    """The same as one by one; in a curved and twisted reference, too."""
    arc = MeshCurve.init_arc((0, 0, 0), (0, 0, 1), (0, -1, 0), 1.0, np.radians(70), 3)
    model = Model()
    curved = model.add("arc", Beam(arc, SECTION, order=p, twist=0.3))
    straight = scene(p)
    for system, beam in (straight, (model.freeze(), curved)):
        limit = beam.basis.interpolation.turn_limit
        for axis in ((1.0, 0, 0), (-0.6, 0, 0.8)):
            states = [
                bent(system, beam, lambda s, turn=turn: 3 * s / s.max() * turn)
                for turn in limit * np.linspace(0, 1.6, 18)[:, None] * np.array(axis)
            ]
            each = [over_rotated(system, y) is not None for y in states]
            assert any(each) and not each[0]
            assert first_over_rotated(system, np.array(states)) == each.index(True)
            assert first_over_rotated(system, np.array(states[: each.index(True)])) is None


@pytest.mark.parametrize("p", ORDERS)
def test_what_rules_states_out_never_hides_a_bent_element(p):
    """Random states about the limit, in pieces that meet in any order, each looked at alone."""
    rng = np.random.default_rng(p)
    nodes = np.array([(0, 0, 0), (0, 0, 1), (0, 0, 2), (0, 0, 3), (0, 1, 1)], dtype=float)
    mesh = MeshCurve(nodes.T, np.array([[2, 3], [0, 1], [1, 2], [1, 4]]).T)
    model = Model()
    branched = model.add("tree", Beam(mesh, SECTION, order=p, director=(1, 0, 0)))
    found = []
    for system, beam in (scene(p), (model.freeze(), branched)):
        limit = beam.basis.interpolation.turn_limit
        for share in rng.uniform(0.1, 1.0, 40):
            theta = share * limit / p * rng.normal(size=(beam.basis.n_nodes, 3))
            y = bent(system, beam, lambda s, theta=theta: theta)
            alone = over_rotated(system, y) is not None
            assert (first_over_rotated(system, y[None]) == 0) == alone
            found.append(alone)
    assert 5 < sum(found) < len(found) - 5


def rolled_up(order: int, elements: int):
    """A cantilever on its way to a full circle."""
    section = Section([1e4, 1e4, 1e4, 100, 100, 100], mass=1.0, inertia=(1.0, 1.0))
    model = Model()
    mesh = MeshCurve.init_line((0, 0, 0), (10, 0, 0), elements, "rod")
    beam = model.add("rod", Beam(mesh, section, order=order))
    model.add("clamp", JointFixed(ground((0, 0, 0)), beam.node("rod.start")))
    model.add("moment", LoadMoment(beam.node("rod.end"), (0, 0, 2 * np.pi * 100 / 10)))
    return static(model, watch=False)


@pytest.mark.slow
@pytest.mark.parametrize(("p", "elements"), [(1, 12), (3, 3)])
def test_a_full_circle_fails_where_elements_give_way(p, elements):
    """12 linear elements: 6/pi of the moment; 3 cubic ones; one element more, and it is done."""
    element = BentElement(p)
    angles = element.bent(element.beam.basis.interpolation.turn_limit)
    peak = element.derivatives(angles)[0][-1] * elements / (2 * np.pi)
    with pytest.raises(Diverged) as caught:
        rolled_up(p, elements)
    assert f"that a {NAMES[p - 1]} element can be bent by" in str(caught.value)
    reached = caught.value.history["load_factor"][-1]
    assert abs(reached - peak) < 1e-4
    assert rolled_up(p, elements + 1)["load_factor"][-1] == 1.0


def test_rigid_motion_and_curved_references_do_not_count():
    model = Model()
    arc = MeshCurve.init_arc((0, 0, 0), (0, 0, 1), (0, -1, 0), 1.0, np.radians(80), 2)
    model.add("arc", Beam(arc, SECTION, twist=0.3))
    line = MeshCurve.init_line((0, 0, 0), (0, 0, 3), 3, "line")
    other = model.add("line", Beam(line, SECTION, order=2))
    system = model.freeze()
    y = system.q0.reshape(-1, 3)
    R = rotation_matrix(exp_quaternion(np.array([[1.0, 2.0, -0.5]])))[0]
    assert over_rotated(system, y @ R.T) is None
    # unbent, and bent the other way: 70 degrees less than the reference
    triads = y.reshape(-1, 4, 3).copy()
    for k, node in enumerate((1, 2)):
        turn = turned(np.radians([-35.0 * (k + 1), 0, 0]))
        triads[node, 1:] = triads[node, 1:] @ turn
    assert over_rotated(system, triads.reshape(-1, 3)) is None
    for k, node in enumerate((1, 2)):
        triads[node, 1:] = triads[node, 1:] @ turned(np.radians([-20.0 * (k + 1), 0, 0]))
    text = over_rotated(system, triads.reshape(-1, 3))
    assert "beam 'arc' is 55 degrees, beyond the 45 that a linear" in text
    # the worst of all beams, by the share of its limit
    z = bent(system, other, lambda s: s * np.radians([120.0, 0, 0]))
    text = over_rotated(system, z)
    assert "beam 'line' is 120 degrees, beyond the 87.5 that a quadratic" in text
    assert text.endswith("(2 more like it): refine")


def test_turns_are_exact_at_small_and_at_large_angles():
    angles = np.array([0.0, 1e-9, 1e-3, 1.0, 3.0, np.pi])
    found = turns(np.tile(np.eye(3), (6, 1, 1)), turned(angles[:, None] * [0.0, 0.6, 0.8]))
    assert np.abs(found - angles)[:-1].max() < 2e-13
    assert abs(found[-1] - np.pi) < 1e-7


# ----------------------------------------------------------------------- at construction
def ring(elements: int) -> MeshCurve:
    return MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.0, 2 * np.pi, elements)


def quarter(elements: int) -> MeshCurve:
    return MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.0, np.pi / 2, elements)


LINE = MeshCurve.init_line((0, 0, 0), (2, 0, 0), 4)
HINT = (np.cos(0.9), np.sin(0.9), 0.0)  # in the plane of the arc, along its tangent at 0.9 rad
LOOP = CurveSpline([(0, 0, 0), (1, 0, 0), (1.2, 0.2, 0), (1, 0.4, 0), (0.5, 0.2, 0), (2, 0, 0)])


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("make", "words"),
    [
        # a given director that the line becomes parallel to between two nodes
        (
            lambda: Beam(quarter(8), SECTION, director=HINT),
            ["180 degrees about the tangent", "nodes 4 and 5 of element 4", "director", "parallel"],
        ),
        (
            lambda: Beam(quarter(2), SECTION, order=4, director=HINT),
            ["180 degrees about the tangent", "element 1", "director"],
        ),
        (
            lambda: Beam(LINE, SECTION, twist=np.pi),
            ["90 degrees about the tangent", "nodes 0 and 1 of element 0", "twist too fast"],
        ),
        (
            lambda: Beam(LINE, SECTION, order=3, twist=lambda s: 2.5 * (s > 1.2)),
            ["143 degrees about the tangent", "element 2", "less than 90"],
        ),
        # elements that turn too far
        (lambda: Beam(ring(4), SECTION), ["turns by 90 degrees", "element 0", "refine"]),
        (lambda: Beam(ring(2), SECTION, order=2), ["turns by 90 degrees", "element 0", "refine"]),
        (lambda: Beam(ring(3), SECTION), ["turns by 120 degrees", "nodes 0 and 1 of element 0"]),
        # lines that fold back
        (
            lambda: Beam(MeshCurve.init_helix((1, 0, 0), (0, 0, 0), (0, 0, 1), 0.5, 3, 3), SECTION),
            ["folds back inside element", "refine"],
        ),
        (
            lambda: Beam(MeshCurve.init_curve(LOOP, 1), SECTION, order=2),
            ["element 0", "refine"],
        ),
        (
            lambda: Beam(
                MeshCurve.init_points([(0, 0, 0), (1, 0, 0), (0.3, 0, 1e-3), (2, 0, 0)]), SECTION
            ),
            ["element", "refine"],
        ),
    ],
)
def test_lines_that_elements_cannot_follow(make, words):
    with pytest.raises(MeshError) as caught:
        make()
    text = str(caught.value)
    assert text.startswith("beam: ")
    assert not [word for word in words if word not in text], text


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: Beam(ring(6), SECTION),
            [
                "beam: element 0",
                "its ends, the nodes 0 and 1,",
                "60 degrees",
                "the 45",
                "5 more like it",
            ],
        ),
        (
            lambda: Beam(ring(4), SECTION, order=2),
            ["90 degrees", "87.5", "quadratic", "3 more like it"],
        ),
        (
            lambda: Beam(ring(2), SECTION, order=4),
            ["180 degrees", "141", "quartic", "1 more like it"],
        ),
        (lambda: Beam(LINE, SECTION, twist=2.0), ["57.3 degrees", "the 45", "3 more like it"]),
        (
            lambda: Beam(
                MeshCurve.init_polyline([(0, 0, 0), (1, 0, 0), (1, 1, 0)], 2),
                SECTION,
                director=(0.6, 0.8, 0.0),
            ),
            ["180 degrees about the line at node 2", "elements 1 and 2", "director"],
        ),
    ],
)
def test_what_is_possible_but_doubtful_is_said(make, words):
    with pytest.warns(ModelWarning) as given:
        beam = make()
    (text,) = (str(each.message) for each in given)
    assert not [word for word in words if word not in text], text
    assert [each["text"] in text for each in beam.warnings] == [True]


@pytest.mark.one_quick
@pytest.mark.parametrize(
    "make",
    [
        lambda: Beam(ring(9), SECTION),
        lambda: Beam(ring(8), SECTION),  # 45 degrees, to round-off
        lambda: Beam(ring(5), SECTION, order=2),
        lambda: Beam(ring(4), SECTION, order=3),
        lambda: Beam(ring(3), SECTION, order=4),
        lambda: Beam(LINE, SECTION, twist=1.5, order=1),
        lambda: Beam(quarter(8), SECTION, director=(0.6, 0.0, 0.8)),
        # corners of any angle, and chords that approximate a smooth curve
        lambda: Beam(MeshCurve.init_polyline([(0, 0, 0), (1, 0, 0), (0, 0.1, 0)], 2), SECTION),
        lambda: Beam(MeshCurve(quarter(8).p, quarter(8).t), SECTION),
        lambda: Beam(
            MeshCurve.init_polyline([(0, 0, 0), (1, 0, 0), (1, 1, 0)], 2),
            SECTION,
            director=(0, 0, 1.0),
        ),
    ],
)
def test_what_is_right_is_not_mentioned(make):
    assert make().warnings == ()


def test_a_beam_too_soft_for_its_own_weight_asks_for_the_unit():
    """E = 210 GPa, given in MPa."""
    for E, asked in ((210e3, True), (210e9, False)):
        model = Model()
        wire = SectionCircle(2e-3, Material(E, 0.3, 7850))
        mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="wire")
        beam = model.add("wire", Beam(mesh, wire))
        y = model.freeze().q0.reshape(-1, 3).copy()
        y[9:12] = turned(np.array([0, 0, 1.2]))
        text = over_rotated(model.freeze(), y)
        assert f"of {beam.label} is" in text and text.endswith("and E in Pa?") == asked
