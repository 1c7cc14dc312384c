"""Sections that vary along a beam: orders, closed forms, both kernels, bad input."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import iv, jv

import skfem_cosserat as sc

#: what is left of the bending stiffness at the end of the tapered cantilever
LEFT = 0.2


def tapered(s):
    """Rod of length 1 whose bending stiffness falls evenly; shear and tension nearly rigid."""
    share = 1 - (1 - LEFT) * s
    return sc.Section([1e6] * 3 + [share] * 3, mass=share, inertia=(1e-4 * share, 1e-4 * share))


def cantilever(section, order, elements, **more):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 1, 0), **more))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    return model, rod.node("rod.end")


def tip(order, elements, kernels="numpy"):
    model, end = cantilever(tapered, order, elements)
    model.add("push", sc.LoadForce(end, (0, 1.0, 0)))
    return sc.static(model, kernels=kernels, watch=False).position(end)[-1, :2]


@pytest.fixture(scope="module")
def exact_tip():
    """Reissner's equations in the plane, integrated from the clamp, its moment by bisection."""

    def rates(s, state):
        _, _, angle, moment = state
        stretch, shear = 1 + np.sin(angle) / 1e6, np.cos(angle) / 1e6
        dx = stretch * np.cos(angle) - shear * np.sin(angle)
        dy = stretch * np.sin(angle) + shear * np.cos(angle)
        return [dx, dy, moment / (1 - (1 - LEFT) * s), -dx]

    def end(moment):
        start = [0, 0, 0, moment]
        return solve_ivp(rates, (0, 1), start, "DOP853", rtol=3e-14, atol=1e-16).y[:, -1]

    return end(brentq(lambda m: end(m)[3], 0.0, 1.2, xtol=1e-16, rtol=1e-15))[:2]


@pytest.mark.parametrize(
    ("order", "elements", "least", "most"),
    [(1, 32, 1.6, 2.4), (2, 16, 3.6, 4.4), (3, 16, 5.6, 6.4), (4, 16, 7, 9)],
)
def test_a_tapered_cantilever_converges_with_twice_the_order(
    exact_tip, order, elements, least, most
):
    errors = [np.linalg.norm(tip(order, n) - exact_tip) for n in (elements // 2, elements)]
    assert least <= np.log2(errors[0] / errors[1]) <= most


@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
def test_a_staircase_of_sections_stays_of_second_order(exact_tip):
    """A section in the middle of each element: what a beam had to be given before."""

    def stairs(elements):
        names = [f"step {k}" for k in range(elements)]
        x = np.linspace(0, 1, elements + 1)
        mesh = sc.MeshCurve.init_polyline([(s, 0, 0) for s in x], 1, name="rod")
        mesh = mesh.with_beams({name: [k] for k, name in enumerate(names)})
        sections = {name: tapered((k + 0.5) / elements) for k, name in enumerate(names)}
        model = sc.Model()
        with pytest.warns(sc.ModelWarning, match=f"change in {elements - 1} steps"):
            beam = sc.Beam(mesh, sections, order=4, director=(0, 1, 0))
        rod = model.add("rod", beam)
        model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node((0, 0, 0))))
        model.add("push", sc.LoadForce(rod.node((1, 0, 0)), (0, 1.0, 0)))
        return sc.static(model, watch=False).position(rod.node((1, 0, 0)))[-1, :2]

    errors = [np.linalg.norm(stairs(n) - exact_tip) for n in (8, 16)]
    assert 1.8 < np.log2(errors[0] / errors[1]) < 2.2 and errors[0] > 1e-4


def test_eight_quartic_elements(exact_tip, kernels):
    assert np.linalg.norm(tip(4, 8, kernels) - exact_tip) < 1e-9


def test_an_exponentially_tapered_rod_vibrates_as_the_closed_form():
    """Axial motion of a rod with EA and mass exp(-2 s): tan(w) = -w, omega^2 = w^2 + 1."""

    def section(s):
        share = np.exp(-2 * s)
        return sc.Section([1e6, 1e6, share, 1e6, 1e6, 1e6], share, (1e-6, 1e-6))

    model, _ = cantilever(section, 6, 4)
    wave = brentq(lambda w: np.sin(w) + w * np.cos(w), 1.6, 3.1, xtol=1e-15)
    exact = np.sqrt(wave**2 + 1) / (2 * np.pi)
    assert sc.modes(model, count=1).frequencies[0] == pytest.approx(exact, rel=1e-9)


def test_a_cone_vibrates_as_bessel_functions_say():
    """Clamped at its base, free at its tip: Kirchhoff, J_2 I_3 + J_3 I_2 = 0 (Kirchhoff 1879)."""
    E, rho, radius, length = 1.0, 1.0, 1e-3, 1.0
    z = brentq(lambda z: jv(2, z) * iv(3, z) + jv(3, z) * iv(2, z), 5.0, 6.5, xtol=1e-15)
    # omega = (z/2)^2 radius/(2 length^2) sqrt(E/rho) of a cone with this radius at its base
    exact = (z / 2) ** 2 * radius / (2 * length**2) * np.sqrt(E / rho) / (2 * np.pi)

    def cone(s):
        r = radius * (1 - s)
        area, moment = np.pi * r**2, np.pi / 4 * r**4
        stiff = [1e3 * E * area, 1e3 * E * area, E * area, E * moment, E * moment, E * moment]
        return sc.Section(stiff, rho * area, (1e-12 * moment, 1e-12 * moment))

    model, _ = cantilever(cone, 8, 4, theory=sc.TheoryKirchhoff())
    assert sc.modes(model, count=2).frequencies == pytest.approx(exact, rel=1e-9)


def test_a_tapered_column_buckles_under_its_weight():
    """Greenhill's column as a cone without its top, by shooting: (EI t')' + weight above t = 0."""
    E, weight, radius, top = 1.0, 1.0, 0.1, 0.3

    def at(s):
        return radius * (1 - (1 - top) * s)

    def cone(s):
        area, moment = np.pi * at(s) ** 2, np.pi / 4 * at(s) ** 4
        stiff = [1e3 * E * area, 1e3 * E * area, E * area, E * moment, E * moment, E * moment]
        return sc.Section(stiff, area, (moment, moment))

    def end(factor):
        """Slope at the foot, of a head that is free; x from the head."""

        def rates(x, state):
            above = np.pi / 3 * weight * (at(1 - x) ** 3 - at(1) ** 3) / (radius * (1 - top))
            return [state[1] / (E * np.pi / 4 * at(1 - x) ** 4), -factor * above * state[0]]

        return solve_ivp(rates, (0, 1), [1.0, 0.0], "DOP853", rtol=1e-13, atol=1e-30).y[0, -1]

    mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 0, 1), 8, name="rod")
    model, theory = sc.Model(), sc.TheoryInextensible()
    rod = model.add("rod", sc.Beam(mesh, cone, order=6, director=(0, 1, 0), theory=theory))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("weight", sc.LoadGravity((0, 0, -weight)))
    critical = brentq(end, 0.03, 0.05, xtol=1e-17, rtol=1e-14)
    assert sc.buckling(model, 1).factors[0] == pytest.approx(critical, rel=1e-9)


SCHEMES = [
    sc.EnergyMomentum(),
    sc.Variational(),
    sc.GeneralizedAlpha(0.8),
    sc.EnergyDecaying(chi=0.1),
]
MATERIAL = sc.Material(5e6, 0.5, 1100)


@pytest.mark.parametrize("treatment", [sc.NullSpace(), sc.Multipliers()], ids=repr)
@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda s: type(s).__name__)
@pytest.mark.slow
def test_kernels_agree_and_the_energy_is_balanced(scheme, treatment):
    """A damped taper that swings on a hinge."""
    taper = sc.SectionTaper(sc.SectionCircle(0.01, MATERIAL), sc.SectionCircle(0.005, MATERIAL))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    model = sc.Model()
    beam = sc.Beam(mesh, taper.damped(1e-3), order=2, director=(0, 1, 0))
    rod = model.add("rod", beam)
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    model.add("weight", sc.LoadGravity((0, -9.81, 0)))
    plain, compiled = (
        sc.simulate(model, scheme, treatment, 2e-3, 0.06, kernels=kernels)
        for kernels in ("numpy", "numba")
    )
    assert compiled["q"][-1] == pytest.approx(plain["q"][-1], abs=1e-9)
    if isinstance(scheme, sc.EnergyMomentum | sc.EnergyDecaying):
        size = compiled.meta["energy_balance"]["scale"]
        assert abs(compiled["energy_balance"]).max() < 1e-11 * size


def constants(section):
    return np.concatenate([section.stiffness.ravel(), section.density.ravel()])


def test_an_answer_keeps_the_taper(exact_tip):
    model, end = cantilever(tapered, 1, 1)
    model.add("push", sc.LoadForce(end, (0, 1.0, 0)))
    found = sc.answer(model, {"tip": sc.SensorPosition(end)}, 1e-6, until=None)
    assert found.reached
    assert found.values["tip"][:2] == pytest.approx(exact_tip, abs=1e-6)


def test_explicit_steps_have_the_taper():
    """The motion is that of implicit steps; both are of second order."""
    found = []

    def soft(s):
        return sc.Section([50.0] * 3 + [1 - 0.8 * s] * 3, 1 - 0.8 * s, (0.1, 0.1))

    for scheme, step in ((sc.Explicit(), 1e-3), (sc.EnergyMomentum(), 2e-3)):
        model, end = cantilever(soft, 1, 4, lumped=True)
        model.add("push", sc.LoadForce(end, (0, 0.5, 0), sc.RampSmooth(0, 0.2)))
        run = sc.simulate(model, scheme, sc.Multipliers(), step, 0.2)
        found.append(run.position(end)[-1])
    assert found[0] == pytest.approx(found[1], abs=1e-5)


def test_tapers_and_functions_of_the_share_are_the_same_sections():
    first, last = (sc.SectionRectangle(b, 0.02, MATERIAL) for b in (0.04, 0.01))
    taper = sc.SectionTaper(first, last)
    along = sc.SectionAlong(
        lambda share: sc.SectionRectangle(0.04 - 0.03 * share, 0.02, MATERIAL), share=True
    )
    for s in (0.0, 0.7, 2.0):
        assert constants(taper.at(s, 2.0)) == pytest.approx(constants(along.at(s, 2.0)), rel=1e-14)
    mesh = sc.MeshCurve.init_line((0, 0, 0), (2, 0, 0), 3, name="rod")
    beams = [sc.Beam(mesh, each, order=2) for each in (taper, along)]
    assert beams[0].scalar_mass() == pytest.approx(beams[1].scalar_mass(), rel=1e-13)


@pytest.mark.parametrize("interpolation", ["linear", "pchip"])
def test_tables_meet_their_stations(interpolation):
    s = np.array([0.0, 0.5, 2.0])
    each = [sc.SectionCircle(r, MATERIAL) for r in (0.02, 0.015, 0.01)]
    table = sc.SectionTable(
        s,
        [one.stiffness for one in each],
        [one.mass for one in each],
        [one.inertia for one in each],
        outline=[one.outline for one in each],
        interpolation=interpolation,
    )
    for place, one in zip(s, each, strict=True):
        assert constants(table.at(place, 2.0)) == pytest.approx(constants(one), rel=1e-14)
    between = table.at(1.25, 2.0)
    assert each[2].mass < between.mass < each[1].mass
    if interpolation == "linear":
        assert between.mass == pytest.approx(0.5 * (each[1].mass + each[2].mass))


def test_parts_have_fields_of_their_own_arc_length():
    mesh = sc.MeshCurve.init_polyline([(0, 0, 0), (1, 0, 0), (3, 0, 0)], 2, name="rod")
    mesh = mesh.with_beams({"thick": [0, 1], "thin": [2, 3]})
    seen = []

    def section(s):
        seen.append(s)
        return tapered(s / 2)

    sc.Beam(mesh, {"thick": sc.SectionCircle(0.1, MATERIAL), "thin": section}, order=2)
    assert 0 <= min(seen) < 0.25 and 1.75 < max(seen) <= 2.0


def test_pictures_have_the_outline_of_each_place():
    taper = sc.SectionTaper(sc.SectionCircle(0.1, MATERIAL), sc.SectionCircle(0.05, MATERIAL))
    model, _ = cantilever(taper, 2, 2)
    history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 0.01)
    from skfem_cosserat.export.geometry import beam_shapes

    (shape,) = beam_shapes(history.meta, history.static)
    points = shape.surface().points(history["q"][0])
    radius = np.hypot(points[:, 1], points[:, 2])
    assert radius == pytest.approx(0.1 - 0.05 * points[:, 0], abs=1e-12)


LINE = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
ONES = [[1e4] * 6] * 2, [1.0, 1.0], [[0.1, 0.1]] * 2
ROUND, SQUARE = sc.SectionCircle(0.1, MATERIAL), sc.SectionRectangle(0.1, 0.1, MATERIAL)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: sc.Beam(LINE, lambda s: 3.0), "section.* is 3.0, not a Section"),
        (lambda: sc.SectionTaper(ROUND, SQUARE), "two of one kind"),
        (lambda: sc.SectionTaper(ROUND.damped(1e-3), ROUND), "damp the taper"),
        (
            lambda: sc.SectionTaper(ROUND, sc.SectionCircle(0.1, sc.Material(1e6, 0.3, 1.0))),
            "material = .* at the start",
        ),
        (
            lambda: sc.SectionTable([0, 0], *ONES),
            "s = .*, expected two or more arc lengths that increase",
        ),
        (lambda: sc.SectionTable([0, 0.5, 1], *ONES), "stiffness has shape .* 3 stations"),
        (
            lambda: sc.SectionTable([0, 1], [[1e4] * 6, [1e4, 1e4, -1, 1, 1, 1]], *ONES[1:]),
            "station 1 at s = 1 m: .*EA",
        ),
        (lambda: sc.SectionTable([0, 1], *ONES, interpolation="cubic"), "'linear' or 'pchip'"),
        (lambda: sc.Beam(LINE, sc.SectionTable([0, 0.9], *ONES)), "from 0 to 0.9 m, .* to 1 m"),
    ],
)
def test_bad_fields_are_named(make, text):
    with pytest.raises(sc.InputError, match=text):
        make()


def test_sections_that_fail_are_named_with_their_place():
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="a")
    mesh = mesh + sc.MeshCurve.init_line((1, 0, 0), (1, 1, 0), 2, name="b")
    sections = {"a": tapered(0), "b": lambda s: 1 / 0}
    with pytest.raises(sc.InputError, match=r"beam: its 'b' at s = 0.25 m: division by zero"):
        sc.Beam(mesh, sections)


def test_parts_that_point_against_each_other_have_their_sections():
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="a")
    mesh = mesh + sc.MeshCurve.init_line((2, 0, 0), (1, 0, 0), 2, name="b")
    beam = sc.Beam(mesh, {"a": tapered, "b": tapered(0.0)})
    assert beam.rigid_body().mass == pytest.approx(0.6 + 1.0)


def test_a_cone_to_a_point_is_computed_and_drawn_as_a_line():
    steel = sc.Material(2e11, 0.3, 7800.0)
    model, end = cantilever(lambda s: sc.SectionCircle(0.05 * (1 - s), steel), 3, 4)
    model.add("push", sc.LoadForce(end, (0, 1e-3, 0)))
    history = sc.static(model, watch=False)
    assert "beam/rod/outline/0" not in history.static


def test_answers_have_vertices_at_kinks_of_tables():
    """A tie of half the stiffness in its middle: 2 log(2) times the strain of one of even kind."""
    even = [tapered(0.0).stiffness * share for share in (1, 0.5, 1)]
    table = sc.SectionTable([0, 0.3, 1], even, [1.0] * 3, [(1e-4, 1e-4)] * 3)
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 1, name="rod").at(0.3)
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, table))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("pull", sc.LoadForce(rod.node("rod.end"), (1.0, 0, 0)))
    found = sc.answer(model, {"end": sc.SensorPosition(rod.node("rod.end"))}, 1e-12, until=None)
    assert found.reached
    assert found.values["end"][0] == pytest.approx(1 + 1e-6 * 2 * np.log(2), abs=1e-12)


def test_functions_need_not_reach_other_processes():
    """A pickled beam has the same mass and elements, and sections in between to rounding."""

    model, end = cantilever(lambda s: tapered(0.9 * s), 3, 3)
    rod = end.item
    copy = pickle.loads(pickle.dumps(model))["rod"]
    assert copy.scalar_mass() == pytest.approx(rod.scalar_mass(), rel=1e-12)
    for each in (rod, copy):
        assert each.section_points(np.array([1]), np.array([0.123])).stiffness[0, 0, 3, 3] == (
            pytest.approx(1 - (1 - LEFT) * 0.9 * (1 + 0.123) / 3, rel=1e-12)
        )
    with pytest.raises(sc.InputError, match="came from another process"):
        copy.refined(1)
