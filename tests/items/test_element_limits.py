"""Limits of elements: bent too far, or drawn more than they can hold; where, and who says so."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest
from helpers_schemes import treatments
from scipy.optimize import brentq

import skfem_cosserat as sc
from skfem_cosserat.diagnostics import strain_energy
from skfem_cosserat.diagnostics.stacked import reduced_tangent
from skfem_cosserat.kernels import exp_quaternion, rotation_matrix
from skfem_cosserat.mesh import CurveSpline
from skfem_cosserat.mesh.triads import turns
from skfem_cosserat.model.balance import amplitudes_at
from skfem_cosserat.model.limits import (
    first_over_rotated,
    over_rotated,
    overstretched,
    tension_factor,
)

ORDERS = (1, 2, 3, 4)
SECTION = sc.Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
#: no stiffness against shear and extension to speak of, and unit bending stiffness
BENDING = sc.Section([1e-20, 1e-20, 1e-20, 1.0, 1.0, 1.0], mass=1.0, inertia=(1.0, 1.0))


def turned(theta: np.ndarray) -> np.ndarray:
    """Triads (.., 3, 3) turned by rotation vectors from e1, e2, e3."""
    return np.swapaxes(rotation_matrix(exp_quaternion(theta)), -1, -2)


# ----------------------------------------------------------------------- the angles themselves
class BentElement:
    """One straight element of length 1, its nodes at given angles about e1, nothing but bending.

    Of directors that are interpolated, curvature is sum_ij N_i N_j' sin(theta_j - theta_i).
    """

    def __init__(self, kind):
        mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 0, 1), 1)
        basis = sc.Beam(mesh, BENDING, order=kind, director=(1, 0, 0)).basis
        self.limit, self.nodes = basis.interpolation.turn_limit, basis.interpolation.nodes
        self.weights = basis.weights
        shapes, slopes = basis.shape(basis.points), basis.dshape(basis.points)
        forms = np.einsum("ig,jg->gij", shapes, slopes)
        self.forms = forms - forms.swapaxes(1, 2)

    def derivatives(self, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and Hessian of the energy by all angles but the first."""
        between = angles - angles[:, None]
        sines, cosines = self.forms * np.sin(between), self.forms * np.cos(between)
        moment = self.weights * 0.5 * sines.sum((1, 2))
        first = cosines.sum(1)
        second = sines - np.eye(len(angles)) * sines.sum(1)[:, None]
        hessian = (first.T * self.weights) @ first + np.einsum("g,gkl->kl", moment, second)
        return (moment @ first)[1:], hessian[1:, 1:]

    def bent(self, angle: float) -> np.ndarray:
        """Angles of the nodes, the inner ones in equilibrium."""
        angles = np.zeros(len(self.nodes))
        for part in np.arange(1, 12 + 1) / 12:
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
@pytest.mark.parametrize("p", range(1, 9))
def test_limits_are_where_an_element_gives_way(p):
    element = BentElement(p)
    limit = element.limit
    assert element.stiffness(0.05) > 0.25
    assert element.stiffness(0.998 * limit) > 1e-4
    assert element.stiffness(1.002 * limit) < -1e-4


def test_moment_of_a_linear_element_peaks_at_45_degrees():
    element = BentElement(1)
    angles = np.radians([1.0, 20.0, 45.0, 70.0, 89.0])
    moments = [element.derivatives(np.array([0, t]))[0][0] for t in angles]
    assert np.abs(moments - np.sin(2 * angles) / 2).max() < 1e-7


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("kind", "away"),
    [(sc.InterpolationLobatto(p, points=p + 1), 0.06) for p in (1, 2, 3, 4)]
    + [(sc.InterpolationEquidistant(p), 0.17) for p in (3, 4)],
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
    mesh = sc.MeshCurve.init_arc((0, 0, 0), (0, 0, 1), (0, -1, 0), 1 / angle, angle, 1)
    model = sc.Model()
    model.add("b", sc.Beam(mesh, BENDING, director=(1, 0, 0)))
    system = model.freeze()
    y = np.tile(system.q0.reshape(-1, 4, 3), (3, 1, 1, 1))
    h = 1e-3
    y[:, 1, 1:] = turned(np.array([angle - h, angle, angle + h])[:, None] * [1.0, 0, 0])
    energy = strain_energy(system, y.reshape(3, -1))
    assert abs(energy[1]) < 1e-18
    assert abs((energy[0] + energy[2]) / h**2 - np.cos(angle) ** 2) < 1e-5


# ----------------------------------------------------------------------- during a run
def scene(order: int):
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 0, 3), 3)
    beam = model.add("boom", sc.Beam(mesh, SECTION, order=order, director=(1, 0, 0)))
    return model.freeze(), beam


def bent(system, beam, rotation_at) -> np.ndarray:
    """Rows of y with triads turned by a rotation vector that depends on arc length."""
    y = system.q0.reshape(-1, 4, 3).copy()
    R = rotation_matrix(exp_quaternion(rotation_at(beam.basis.nodes[:, 2:])))
    first = system.first[id(beam)][0]
    own = slice(first, first + beam.basis.n_nodes)
    y[own, 1:] = y[own, 1:] @ np.swapaxes(R, 1, 2)
    return y.reshape(-1, 3)


@pytest.mark.one_quick
@pytest.mark.parametrize("p", range(1, 9))
@pytest.mark.parametrize("axis", [(1.0, 0, 0), (0.6, 0, -0.8)])
def test_bent_elements_are_named(p, axis):
    """Bending alone and with torsion, only in the middle of three elements."""
    system, beam = scene(p)
    limit = beam.basis.interpolation.turn_limit

    def middle(share):
        angle = share * limit
        return bent(system, beam, lambda s: np.clip(s - 1, 0, 1) * angle * np.array(axis))

    assert over_rotated(system, middle(0.98)) is None
    states = np.array([middle(0.98)] * 250 + [middle(1.04)] * 2)
    assert first_over_rotated(system, states) == 250
    assert first_over_rotated(system, states[:250]) is None
    text = over_rotated(system, middle(1.04))
    shown, bound = f"{np.degrees(1.04 * limit):.3g}", f"{np.degrees(limit):.3g}"
    assert text == (
        f"relative rotation between nodes 1 and 2 of beam 'boom' is {shown} degrees, beyond the"
        f" {bound} that an element of order {p} can be bent by: refine"
    )


def rolled_up(order: int, elements: int):
    """A cantilever on its way to a full circle."""
    section = sc.Section([1e4, 1e4, 1e4, 100, 100, 100], mass=1.0, inertia=(1.0, 1.0))
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (10, 0, 0), elements, "rod")
    beam = model.add("rod", sc.Beam(mesh, section, order=order))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("rod.start")))
    model.add("moment", sc.LoadMoment(beam.node("rod.end"), (0, 0, 2 * np.pi * 100 / 10)))
    return sc.static(model, watch=False)


@pytest.mark.slow
@pytest.mark.parametrize(("p", "elements"), [(1, 12), (3, 3)])
def test_a_full_circle_fails_where_elements_give_way(p, elements):
    """12 linear elements: 6/pi of the moment; 3 cubic ones; one element more, and it is done."""
    element = BentElement(p)
    angles = element.bent(element.limit)
    peak = element.derivatives(angles)[0][-1] * elements / (2 * np.pi)
    with pytest.raises(sc.Diverged) as caught:
        rolled_up(p, elements)
    assert f"that an element of order {p} can be bent by" in str(caught.value)
    reached = caught.value.history["load_factor"][-1]
    assert abs(reached - peak) < 1e-4
    assert rolled_up(p, elements + 1)["load_factor"][-1] == 1.0


def test_rigid_motion_and_curved_references_do_not_count():
    model = sc.Model()
    arc = sc.MeshCurve.init_arc((0, 0, 0), (0, 0, 1), (0, -1, 0), 1.0, np.radians(80), 2)
    model.add("arc", sc.Beam(arc, SECTION, twist=0.3))
    line = sc.MeshCurve.init_line((0, 0, 0), (0, 0, 3), 3, "line")
    other = model.add("line", sc.Beam(line, SECTION, order=2))
    system = model.freeze()
    y = system.q0.reshape(-1, 3)
    R = rotation_matrix(exp_quaternion(np.array([[1.0, 2.0, -0.5]])))[0]
    assert over_rotated(system, y @ R.T) is None
    # unbent and bent the other way, by more than the reference: 55 degrees
    triads = y.reshape(-1, 4, 3).copy()
    for node, angle in ((1, -55.0), (2, -110.0)):
        triads[node, 1:] = triads[node, 1:] @ turned(np.radians([angle, 0, 0]))
    text = over_rotated(system, triads.reshape(-1, 3))
    assert "beam 'arc' is 55 degrees, beyond the 45 that an element of order 1" in text
    # the worst of all beams, by the share of its limit
    z = bent(system, other, lambda s: s * np.radians([120.0, 0, 0]))
    text = over_rotated(system, z)
    assert "beam 'line' is 120 degrees, beyond the 87.5 that an element of order 2" in text
    assert text.endswith("(2 more like it): refine")


def test_turns_are_exact_at_small_and_at_large_angles():
    angles = np.array([0.0, 1e-9, 1e-3, 1.0, 3.0])
    found = turns(np.tile(np.eye(3), (5, 1, 1)), turned(angles[:, None] * [0.0, 0.6, 0.8]))
    assert np.abs(found - angles).max() < 2e-13


# ----------------------------------------------------------------------- at construction
def ring(elements: int) -> sc.MeshCurve:
    return sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.0, 2 * np.pi, elements)


def quarter(elements: int) -> sc.MeshCurve:
    return sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.0, np.pi / 2, elements)


LINE = sc.MeshCurve.init_line((0, 0, 0), (2, 0, 0), 4)
CORNER = sc.MeshCurve.init_polyline([(0, 0, 0), (1, 0, 0), (1, 1, 0)], 2)
HINT = (np.cos(0.9), np.sin(0.9), 0.0)  # in the plane of the arc, along its tangent at 0.9 rad
LOOP = CurveSpline([(0, 0, 0), (1, 0, 0), (1.2, 0.2, 0), (1, 0.4, 0), (0.5, 0.2, 0), (2, 0, 0)])


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("make", "text"),
    [
        # a given director that the line becomes parallel to between two nodes
        (
            lambda: sc.Beam(quarter(8), SECTION, director=HINT),
            "180 degrees about the tangent.*nodes 4 and 5 of element 4.*director.*parallel",
        ),
        (
            lambda: sc.Beam(LINE, SECTION, twist=np.pi),
            "90 degrees about the tangent.*nodes 0 and 1 of element 0.*twist too fast",
        ),
        (
            lambda: sc.Beam(LINE, SECTION, order=3, twist=lambda s: 2.5 * (s > 1.2)),
            "143 degrees about the tangent.*element 2.*less than 90",
        ),
        # elements that turn too far
        (lambda: sc.Beam(ring(4), SECTION), "turns by 90 degrees.*element 0.*refine"),
        # lines that fold back
        (
            lambda: sc.Beam(
                sc.MeshCurve.init_helix((1, 0, 0), (0, 0, 0), (0, 0, 1), 0.5, 3, 3), SECTION
            ),
            "folds back inside element.*refine",
        ),
        (lambda: sc.Beam(sc.MeshCurve.init_curve(LOOP, 1), SECTION, order=2), "element 0.*refine"),
    ],
)
def test_lines_that_elements_cannot_follow(make, text):
    with pytest.raises(sc.MeshError, match=f"^beam: .*{text}"):
        make()


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (
            lambda: sc.Beam(ring(6), SECTION),
            "beam: element 0.* its ends, the nodes 0 and 1,.*60 degrees.*the 45.*5 more like it",
        ),
        (lambda: sc.Beam(ring(2), SECTION, order=4), "180 degrees.*141.*order 4.*1 more like it"),
        (lambda: sc.Beam(LINE, SECTION, twist=2.0), "57.3 degrees.*the 45.*3 more like it"),
        (
            lambda: sc.Beam(CORNER, SECTION, director=(0.6, 0.8, 0.0)),
            "180 degrees about the line at node 2.*elements 1 and 2.*director",
        ),
    ],
)
def test_what_is_possible_but_doubtful_is_said(make, text):
    with pytest.warns(sc.ModelWarning, match=text) as given:
        beam = make()
    assert [each["text"] in str(given[0].message) for each in beam.warnings] == [True]


@pytest.mark.one_quick
@pytest.mark.parametrize(
    "make",
    [
        lambda: sc.Beam(ring(8), SECTION),  # 45 degrees, to round-off
        lambda: sc.Beam(ring(5), SECTION, order=2),
        lambda: sc.Beam(ring(3), SECTION, order=4),
        lambda: sc.Beam(LINE, SECTION, twist=1.5, order=1),
        # corners of any angle, and chords that approximate a smooth curve
        lambda: sc.Beam(CORNER, SECTION, director=(0, 0, 1.0)),
        lambda: sc.Beam(sc.MeshCurve(quarter(8).p, quarter(8).t), SECTION),
    ],
)
def test_what_is_right_is_not_mentioned(make):
    assert make().warnings == ()


def test_a_beam_too_soft_for_its_own_weight_asks_for_the_unit():
    """E = 210 GPa, given in MPa."""
    for E, asked in ((210e3, True), (210e9, False)):
        model = sc.Model()
        wire = sc.SectionCircle(2e-3, sc.Material(E, 0.3, 7850))
        mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="wire")
        beam = model.add("wire", sc.Beam(mesh, wire))
        y = model.freeze().q0.reshape(-1, 3).copy()
        y[9:12] = turned(np.array([0, 0, 1.2]))
        text = over_rotated(model.freeze(), y)
        assert f"of {beam.label} is" in text and text.endswith("and E in Pa?") == asked


# ----------------------------------------------------------------------- tension: the limit
#: Smallest N h^2/EI at which EI int theta'^2 + N (2 Gauss(theta^2) - Lobatto(theta^2)) vanishes.
#: By hand, in Legendre polynomials: P_1; P_2; P_1 and P_3; P_2 and P_4. Without the lower ones
#: it is 2 p^2 (p + 1) = 4, 24, 72, 160.
LIMITS = {1: 4.0, 2: 24.0, 3: 30 + 18 * np.sqrt(5), 4: 50 + 2 * np.sqrt(2305)}
STEEL = sc.Material(210e9, 0.3, 7850.0)
RADIUS, TENSION = 5e-4, 100.0
EI = 210e9 * np.pi * RADIUS**4 / 4
STRETCH = 1 + TENSION / (210e9 * np.pi * RADIUS**2)


def section(EI=(1.0, 1.5), GA=1e6, EA=1e7):
    return sc.Section.from_constants(EA=EA, GA=GA, EI=EI, GJ=1.0, mass=1.0, inertia=(1e-3, 1e-3))


def wire(kind, elements, force, length=1.0, part=None, amplitude=None):
    """A wire along x, clamped; one end slides and is drawn."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (length, 0, 0), elements, "line")
    own = sc.SectionCircle(RADIUS, STEEL) if part is None else part
    beam = model.add("wire", sc.Beam(mesh, own, order=kind, director=(0, 1, 0)))
    end = beam.node("line.end")
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("line.start")))
    model.add("slide", sc.JointPrismatic(sc.ground((length, 0, 0)), end, axis=(1, 0, 0)))
    model.add("pull", sc.LoadForce(end, (force, 0, 0), amplitude))
    return model


def drawn(system, stretch):
    """Configuration that is drawn evenly along x."""
    y = system.extend(system.q0, 0.0).copy()
    y[system.origin_rows, 0] *= stretch
    return y


def lowest(kind, elements, force, part):
    """Lowest eigenvalue of the stiffness of a drawn wire of elements of length 1."""
    system = wire(kind, elements, force, float(elements), part).freeze()
    y = drawn(system, 1 + force / part.stiffness[2, 2])
    tangent = reduced_tangent(system, y, amplitudes_at(system, 0.0))
    assert abs(tangent.residual).max() < 1e-7 * force
    return np.linalg.eigvalsh(tangent.K.toarray())[0]


@pytest.mark.slow
@pytest.mark.parametrize("p", ORDERS)
def test_stability_is_lost_at_the_limit(p):
    """Clamped ends raise the limit by 1 % at 16 elements and about a quarter of that at 32."""
    found = {}
    for elements in (16, 32):
        found[elements] = brentq(
            lambda x, n=elements: lowest(p, n, x * LIMITS[p], section()), 0.9, 1.1, xtol=1e-5
        )
    assert 1.0 < found[32] < found[16] < 1.011
    assert abs((found[16] - 1) / (found[32] - 1) - 4) < 0.2
    assert abs(tension_factor(sc.InterpolationLobatto(p)) / LIMITS[p] - 1) < 1e-12
    assert LIMITS[p] <= 2 * p**2 * (p + 1)


@pytest.mark.one_quick
@pytest.mark.parametrize("p", [3, 4])
def test_equidistant_nodes_have_a_limit_of_their_own(p):
    kind = sc.InterpolationEquidistant(p)
    limit = tension_factor(kind)
    assert abs(limit - {3: 61.2697, 4: 155.9809}[p]) < 1e-4
    assert lowest(kind, 16, limit, section()) > 0
    assert lowest(kind, 16, 1.02 * limit, section()) < 0


@pytest.mark.one_quick
@pytest.mark.parametrize("p", [1, 2, 3])
def test_more_gauss_points_see_these_rotations_as_shear(p):
    """What is left is a limit of p/(2 p + 1) of the shear stiffness, whatever the mesh."""
    kind, part = sc.InterpolationLobatto(p, points=p + 1), section(GA=1e4, EA=1e8)
    limit = 1e4 * p / (2 * p + 1) + LIMITS[p]
    assert lowest(kind, 16, 0.99 * limit, part) > 0
    assert lowest(kind, 16, 1.02 * limit, part) < 0
    system = wire(kind, 16, 0.0, 16.0, part).freeze()
    assert overstretched(system, drawn(system, 1 + 10 * LIMITS[p] / 1e8)) is None


# ----------------------------------------------------------------------- what is said
@pytest.mark.one_quick
@pytest.mark.parametrize("p", ORDERS)
def test_overstretched_elements_are_named(p):
    """Of three elements of length 1, 2 and 1 m the middle one, then all; never in compression."""
    model = sc.Model()
    nodes = [(0, 0, 0), (1, 0, 0), (3, 0, 0), (4, 0, 0)]
    mesh = sc.MeshCurve.init_polyline(nodes, [1, 1, 1], "line")
    model.add("rope", sc.Beam(mesh, section(), order=p))
    system = model.freeze()

    def at(force):
        return drawn(system, 1 + force / 1e7)

    limit = LIMITS[p] / 4
    assert overstretched(system, at(0.999 * limit)) is None
    assert overstretched(system, at(-10 * limit)) is None
    assert overstretched(system, at(1.001 * limit)) == (
        f"tension {1.001 * limit:.3g} N between nodes 1 and 2 of beam 'rope' is above"
        f" {LIMITS[p]:.3g} EI/h^2 = {limit:.3g} N: node rotations that its Gauss points do not see"
        " can grow; refine: it takes 4 elements in place of 3"
    )
    # twice the limit of the short ones: 2 sqrt(2) parts of the long one, sqrt(2) of the others
    text = overstretched(system, at(8 * limit))
    assert f"{limit:.3g} N (2 more like it):" in text
    assert text.endswith("it takes 6 elements in place of 3")


def test_coupled_stiffness_counts_as_it_is_free_to_bend():
    """The smaller bending stiffness about skew axes, softened by twist that is free."""
    D = np.diag([1e6, 1e6, 1e6, 2.0, 2.0, 4.0])
    D[3, 4] = D[4, 3] = 0.5
    D[3, 5] = D[5, 3] = D[4, 5] = D[5, 4] = -1.0
    soft = 1.5  # about (1, -1)/sqrt(2), without twist; about (1, 1)/sqrt(2) it is 2.5 less 2/4
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (4, 0, 0), 4, "line")
    model.add("rope", sc.Beam(mesh, sc.Section(D, mass=1.0, inertia=(1.0, 1.0))))
    system = model.freeze()
    assert overstretched(system, drawn(system, 1 + 3.99e-6 * soft)) is None
    assert "= 6 N (3 more" in overstretched(system, drawn(system, 1 + 4.01e-6 * soft))


# ----------------------------------------------------------------------- a taut steel wire
@pytest.mark.one_quick
@pytest.mark.parametrize("p", ORDERS)
def test_vibrations_of_a_wire_need_so_many_elements(p):
    """1 m of 1 mm steel under 100 N: 50, 21, 12, 9 elements are needed."""
    needed = int(np.ceil(np.sqrt(TENSION / (LIMITS[p] * EI))))
    assert needed == (50, 21, 12, 9)[p - 1]
    for elements, stable in ((needed - 2, False), (needed, True)):
        system = wire(p, elements, TENSION).freeze()
        state = drawn(system, STRETCH)[: system.rows].reshape(-1)
        with nullcontext() if stable else pytest.warns(sc.AccuracyWarning, match="do not see"):
            found = sc.modes(system, state, count=2, t=0.0)
        said = [each["text"] for each in found.warnings if each["text"].startswith("tension")]
        assert found.stable == stable == (not said)
        assert stable or f"takes {needed} elements in place of {elements}" in said[0]


@treatments
@pytest.mark.parametrize("force", [TENSION, 20.0, -TENSION])
def test_a_run_says_it_once(treatment, force):
    system = wire(2, 12, force).freeze()
    q = drawn(system, 1 + force / (210e9 * np.pi * RADIUS**2))[: system.rows].reshape(-1)
    start = sc.initial_state(system, q=q)
    taut = force == TENSION
    with pytest.warns(sc.AccuracyWarning) if taut else nullcontext() as given:
        history = sc.simulate(system, sc.EnergyMomentum(), treatment, 1e-4, until=1e-3, start=start)
    assert len(history.meta["warnings"]) == taut
    assert ("1 warning>" in repr(history)) is taut
    if taut:
        (said,) = (str(each.message) for each in given)
        assert given[0].filename == __file__  # the line of the one who can do something about it
        assert said.startswith("beam 'wire', t = 0 s: tension 100 N between nodes ")
        assert "of beam 'wire' is above 24 EI/h^2 = 35.6 N (11 more" in said


@pytest.mark.slow
def test_a_run_that_draws_too_much_later_says_when():
    """The pull grows to 100 N in 20 ms, a hundred times what a wave takes: 35.6 N at 7.1 ms."""
    system = wire(2, 12, TENSION, amplitude=sc.Table([0, 0.02], [0, 1])).freeze()
    with pytest.warns(sc.AccuracyWarning, match="Gauss points do not see"):
        history = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 2e-4, until=0.02)
    (said,) = history.meta["warnings"]
    assert 6e-3 < said["time"] < 9e-3


@pytest.mark.slow
@treatments
def test_a_path_warns_once(treatment):
    """Where it gets beyond the limit; the run itself is what the elements make of it."""
    model = wire(2, 12, TENSION)
    unlooked = pytest.warns(sc.IncompleteWarning, match="critical points are not looked for")
    with pytest.warns(sc.AccuracyWarning, match="beam 'wire', load factor .*: tension"), unlooked:
        path = sc.static(model, treatment, derive=False)
    missing, said = path.meta["warnings"]
    assert missing["item"] == "path"
    assert said["when"] == f"load factor {said['time']:.6g}" and "tension" in said["text"]
