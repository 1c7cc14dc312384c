"""Tension that elements cannot hold: the limit itself, a taut wire beyond it, and who says so."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest
from scipy.optimize import brentq

from skfem_cosserat import (
    AccuracyWarning,
    Beam,
    Diverged,
    EnergyMomentum,
    IncompleteWarning,
    InterpolationEquidistant,
    InterpolationLobatto,
    JointFixed,
    JointPrismatic,
    LoadForce,
    Material,
    MeshCurve,
    Model,
    Multipliers,
    NewtonSettings,
    NullSpace,
    Section,
    SectionCircle,
    Table,
    Variational,
    ground,
    initial_state,
    modes,
    project,
    simulate,
    static,
)
from skfem_cosserat.diagnostics.stacked import reduced_tangent
from skfem_cosserat.model.balance import amplitudes_at
from skfem_cosserat.model.limits import overstretched, tension_factor

ORDERS = (1, 2, 3, 4)
#: Smallest N h^2/EI at which EI int theta'^2 + N (2 Gauss(theta^2) - Lobatto(theta^2)) vanishes.
#: By hand, in Legendre polynomials: P_1; P_2; P_1 and P_3; P_2 and P_4. Without the lower ones
#: it is 2 p^2 (p + 1) = 4, 24, 72, 160.
LIMITS = {1: 4.0, 2: 24.0, 3: 30 + 18 * np.sqrt(5), 4: 50 + 2 * np.sqrt(2305)}
STEEL = Material(210e9, 0.3, 7850.0)
RADIUS, TENSION = 5e-4, 100.0
EI, MASS = 210e9 * np.pi * RADIUS**4 / 4, 7850 * np.pi * RADIUS**2
STRETCH = 1 + TENSION / (210e9 * np.pi * RADIUS**2)


def section(EI=(1.0, 1.5), GA=1e6, EA=1e7):
    return Section.from_constants(EA=EA, GA=GA, EI=EI, GJ=1.0, mass=1.0, inertia=(1e-3, 1e-3))


def wire(kind, elements, force, length=1.0, part=None, amplitude=None):
    """A wire along x, clamped; one end slides and is drawn."""
    model = Model()
    mesh = MeshCurve.init_line((0, 0, 0), (length, 0, 0), elements, "line")
    own = SectionCircle(RADIUS, STEEL) if part is None else part
    beam = model.add("wire", Beam(mesh, own, order=kind, director=(0, 1, 0)))
    end = beam.node("line.end")
    model.add("clamp", JointFixed(ground((0, 0, 0)), beam.node("line.start")))
    model.add("slide", JointPrismatic(ground((length, 0, 0)), end, axis=(1, 0, 0)))
    model.add("pull", LoadForce(end, (force, 0, 0), amplitude))
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


# ----------------------------------------------------------------------- the limit
@pytest.mark.slow
@pytest.mark.parametrize("p", [1, 2, *(pytest.param(p, marks=pytest.mark.slow) for p in (3, 4))])
def test_stability_is_lost_at_the_limit(p):
    """Clamped ends raise the limit by 1 % at 16 elements and about a quarter of that at 32."""
    found = {}
    for elements in (16, 32):
        found[elements] = brentq(
            lambda x, n=elements: lowest(p, n, x * LIMITS[p], section()), 0.9, 1.1, xtol=1e-5
        )
    assert 1.0 < found[32] < found[16] < 1.011
    assert abs((found[16] - 1) / (found[32] - 1) - 4) < 0.2
    assert abs(tension_factor(InterpolationLobatto(p)) / LIMITS[p] - 1) < 1e-12
    assert LIMITS[p] <= 2 * p**2 * (p + 1)


@pytest.mark.one_quick
@pytest.mark.parametrize("p", [3, 4])
def test_equidistant_nodes_have_a_limit_of_their_own(p):
    kind = InterpolationEquidistant(p)
    limit = tension_factor(kind)
    assert abs(limit - {3: 61.2697, 4: 155.9809}[p]) < 1e-4
    assert lowest(kind, 16, limit, section()) > 0
    assert lowest(kind, 16, 1.02 * limit, section()) < 0


@pytest.mark.one_quick
@pytest.mark.parametrize("p", [1, 2, 3])
def test_more_gauss_points_see_these_rotations_as_shear(p):
    """What is left is a limit of p/(2 p + 1) of the shear stiffness, whatever the mesh."""
    kind, part = InterpolationLobatto(p, points=p + 1), section(GA=1e4, EA=1e8)
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
    model = Model()
    nodes = [(0, 0, 0), (1, 0, 0), (3, 0, 0), (4, 0, 0)]
    mesh = MeshCurve.init_polyline(nodes, [1, 1, 1], "line")
    model.add("rope", Beam(mesh, section(), order=p))
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
    assert "between nodes 1 and 2" in text
    assert f"{limit:.3g} N (2 more like it):" in text
    assert text.endswith("it takes 6 elements in place of 3")


def test_coupled_stiffness_counts_as_it_is_free_to_bend():
    """The smaller bending stiffness about skew axes, softened by twist that is free."""
    D = np.diag([1e6, 1e6, 1e6, 2.0, 2.0, 4.0])
    D[3, 4] = D[4, 3] = 0.5
    D[3, 5] = D[5, 3] = D[4, 5] = D[5, 4] = -1.0
    soft = 1.5  # about (1, -1)/sqrt(2), without twist; about (1, 1)/sqrt(2) it is 2.5 less 2/4
    model = Model()
    mesh = MeshCurve.init_line((0, 0, 0), (4, 0, 0), 4, "line")
    model.add("rope", Beam(mesh, Section(D, mass=1.0, inertia=(1.0, 1.0))))
    system = model.freeze()
    assert overstretched(system, drawn(system, 1 + 3.99e-6 * soft)) is None
    assert "= 6 N (3 more" in overstretched(system, drawn(system, 1 + 4.01e-6 * soft))


# ----------------------------------------------------------------------- a taut steel wire
def string_frequency(length, mass):
    """First frequency (Hz) of a clamped string with bending stiffness EI, by its equation."""
    half = TENSION / (2 * EI)

    def equation(omega):
        root = np.sqrt(half**2 + mass * omega**2 / EI)
        a, b = np.sqrt(root + half) * length, np.sqrt(root - half) * length
        e = np.exp(-a)  # all divided by cosh a + sinh a
        cosh, sinh = (1 + e * e) / 2, (1 - e * e) / 2
        return 2 * a * b * (e - cosh * np.cos(b)) + (a * a - b * b) * sinh * np.sin(b)

    omega = np.pi / length * np.sqrt(TENSION / mass)
    return brentq(equation, omega, 1.1 * omega, xtol=1e-12, rtol=1e-14) / (2 * np.pi)


@pytest.mark.slow
@pytest.mark.parametrize(("p", "error"), [(1, 2.9e-3), (2, 1e-3), (3, 5e-4), (4, 1.5e-4)])
def test_twice_the_elements_needed_vibrate_as_a_string(p, error):
    """1 m of 1 mm steel under 100 N: 50, 21, 12, 9 elements are needed."""
    needed = int(np.ceil(np.sqrt(TENSION / (LIMITS[p] * EI))))
    assert needed == (50, 21, 12, 9)[p - 1]
    exact = string_frequency(STRETCH, MASS / STRETCH)
    for elements, stable in ((needed - 2, False), (needed, True), (2 * needed, True)):
        model = wire(p, elements, TENSION)
        system = model.freeze()
        state = drawn(system, STRETCH)[: system.rows]
        with nullcontext() if stable else pytest.warns(AccuracyWarning, match="do not see"):
            found = modes(system, state.reshape(-1), count=2, t=0.0)
        assert found.stable == stable
        of_tension = [each for each in found.warnings if each["text"].startswith("tension")]
        assert len(of_tension) == (not stable)
        if not stable:
            assert "1 warning>" in repr(found)
            said = of_tension[0]
            assert said["item"] == "beam 'wire'" and said["time"] == 0.0
            assert said["text"].startswith("tension 100 N between nodes 0 and 1")
            assert f"takes {needed} elements in place of {elements}" in said["text"]
    assert np.abs(found.frequencies / exact - 1).max() < error


@pytest.mark.parametrize("treatment", [NullSpace(), Multipliers()], ids=["nullspace", "multiplier"])
@pytest.mark.parametrize("force", [TENSION, 20.0, -TENSION])
def test_a_run_says_it_once(treatment, force):
    system = wire(2, 12, force).freeze()
    q = drawn(system, 1 + force / (210e9 * np.pi * RADIUS**2))[: system.rows].reshape(-1)
    start = initial_state(system, q=q)
    taut = force == TENSION
    with pytest.warns(AccuracyWarning) if taut else nullcontext() as given:
        history = simulate(system, EnergyMomentum(), treatment, 1e-4, until=1e-3, start=start)
    assert history.meta["status"] == "completed"
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
    system = wire(2, 12, TENSION, amplitude=Table([0, 0.02], [0, 1])).freeze()
    with pytest.warns(AccuracyWarning, match="Gauss points do not see"):
        history = simulate(system, EnergyMomentum(), NullSpace(), 2e-4, until=0.02)
    (said,) = history.meta["warnings"]
    assert 6e-3 < said["time"] < 9e-3


@pytest.mark.slow
def test_a_run_folds_up_as_fast_as_modes_grow():
    """Noise of 1e-9 rad doubles every 20 microseconds until nodes have turned; it is told first."""
    system = wire(1, 12, TENSION).freeze()
    q = drawn(system, STRETCH)[: system.rows].reshape(-1)
    with pytest.warns(AccuracyWarning, match="do not see"):
        found = modes(system, q, 6)
    assert not found.stable
    v = np.zeros(system.n)
    inner = system.origin_rows[1:-1]
    v[3 * inner + 2] = 1e-6 * np.random.default_rng(0).standard_normal(len(inner))
    start = initial_state(system, q=q, v=project(system, q, v))
    run = system, EnergyMomentum(), NullSpace(), 2e-6, 8e-4
    with pytest.warns(AccuracyWarning, match="do not see"):
        history = simulate(*run, start=start, derive=False, kernels="numpy")
    tangents = history["q"].reshape(len(history), -1, 4, 3)[:, :, 3]
    turned = np.linalg.norm(tangents - tangents[0], axis=2).max(1)
    linear = (turned > 1e-7) & (turned < 1e-3)
    rate = np.polyfit(history.times[linear], np.log(turned[linear]), 1)[0]
    assert rate == pytest.approx(found.growth.max(), rel=0.02)
    assert turned[-1] > 0.05
    said = [each for each in history.meta["warnings"] if "do not see" in each["text"]]
    assert len(said) == 1 and said[0]["time"] == 0.0
    assert said[0]["text"].startswith("tension 100 N between nodes ")


@pytest.mark.parametrize("treatment", [NullSpace(), Multipliers()], ids=["nullspace", "multiplier"])
def test_a_failed_step_names_it(treatment):
    system = wire(2, 12, TENSION).freeze()
    q = drawn(system, STRETCH)[: system.rows].reshape(-1)
    v = np.zeros(system.n)
    v[3 * system.origin_rows[1:-1] + 2] = 10.0
    start = initial_state(system, q=q, v=project(system, q, v))
    few = NewtonSettings(iterations=1, damped_iterations=1)
    with pytest.raises(Diverged) as caught:
        simulate(system, Variational(), treatment, 1e-3, until=1e-2, start=start, settings=few)
    assert "tension 100 N between nodes 0 and 1 of beam 'wire'" in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    "treatment", [NullSpace(), Multipliers()], ids=["null space", "multipliers"]
)
def test_a_path_warns_once(treatment):
    """Where it gets beyond the limit; the run itself is what the elements make of it."""
    model = wire(2, 12, TENSION)
    unlooked = pytest.warns(IncompleteWarning, match="critical points are not looked for")
    with pytest.warns(AccuracyWarning, match="beam 'wire', load factor .*: tension"), unlooked:
        path = static(model, treatment, derive=False)
    missing, said = path.meta["warnings"]
    assert missing["item"] == "path"
    assert said["when"] == f"load factor {said['time']:.6g}" and "tension" in said["text"]
