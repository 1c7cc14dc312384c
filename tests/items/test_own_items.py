"""Items, integrators and solvers written outside of the package, by public names alone.

Each is checked against something independent: the built-in item that does the same, a closed form,
or the balance of energy.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import skfem_cosserat as sc

GROUND = sc.ground((0, 0, 0))
Z = (0, 0, 1)
SECTION = sc.Section((2e4, 2e4, 5e4, 40.0, 60.0, 30.0), mass=1.3, inertia=(2e-3, 3e-3))
SCHEMES = {
    "variational": sc.Variational(),
    "energy-momentum": sc.EnergyMomentum(),
    "energy-decaying": sc.EnergyDecaying(rate=0.1),
    "generalized-alpha": sc.GeneralizedAlpha(0.9),
    "composed": sc.Composition(sc.EnergyMomentum(), 4),
}
TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
schemes = pytest.mark.parametrize("scheme", SCHEMES)
treatments = pytest.mark.parametrize("treatment", TREATMENTS)
BOTH = ("numba", "numpy")


# -- the items -------------------------------------------------------------------------------------


class LoadRotor(sc.Load):
    """Thrust along d3 of a place, and the torque of the rotor about it."""

    def __init__(self, place, thrust, torque, amplitude=None):
        super().__init__(amplitude=amplitude)
        self.place, self.thrust, self.torque = place, thrust, torque

    def terms(self):
        return [
            sc.TermForce(self.place, (0, 0, self.thrust), self.time, follower=True),
            sc.TermMoment(self.place, (0, 0, self.torque), self.time, follower=True),
        ]


class LoadStorm(sc.Load):
    """Wind on a whole beam, a pressure on its sections, a push on its end, and weight."""

    def __init__(self, beam, end, wind, pressure, push, weight, gusts):
        super().__init__()
        self.beam, self.end, self.gusts = beam, end, gusts
        self.wind, self.pressure, self.push, self.weight = wind, pressure, push, weight

    def terms(self):
        return [
            sc.TermLine(self.beam, self.wind, self.gusts),
            sc.TermLine(self.beam, self.pressure, follower=True),
            sc.TermForce(self.end, self.push),
            sc.TermAcceleration(self.weight, 2.0),
        ]


class LoadDrag(sc.Load):
    """Against the velocity of a place, with the square of the speed."""

    def __init__(self, place, factor, amplitude=None):
        super().__init__(amplitude=amplitude)
        self.place, self.factor = place, factor

    def terms(self):
        return [sc.TermFunction([self.place], self.force, self.time)]

    def force(self, x, v, t):
        return -self.factor * np.sqrt((v * v).sum()) * v


class LoadAttraction(sc.Load):
    """Two points attract each other as k/r^2, or as a spring k r."""

    def __init__(self, a, b, k, spring=False, slopes=None, amplitude=None):
        super().__init__(amplitude=amplitude)
        self.a, self.b, self.k, self.spring, self.slopes = a, b, k, spring, slopes

    def terms(self):
        return [sc.TermFunction([self.a, self.b], self.force, self.time, self.slopes)]

    def force(self, x, v, t):
        r = x[1] - x[0]
        pull = self.k * r if self.spring else self.k * r / (r @ r) ** 1.5
        return np.array([pull, -pull])


class JointPointOnPlane(sc.Joint):
    """A point of side b stays in a plane of side a."""

    type = "point on plane"
    framed_sides = ("a",)

    def __init__(self, a, b, normal):
        super().__init__(a, b)
        self.normal = np.array(normal, dtype=float)

    def gap(self, r):
        return (r @ self.normal) * self.normal

    def rows(self):
        return [sc.Product(sc.direction(self.a, self.normal), sc.point(self.b) - sc.point(self.a))]

    def freedom(self):
        first = sc.triad(self.normal)[0]
        second = np.cross(self.normal, first)
        slides = sc.Slide("u", self.normal, -second), sc.Slide("v", self.normal, first)
        return sc.Freedom(None, slides)


class SectionSquare(sc.Section):
    """A solid square."""

    def __init__(self, side, E, G, density):
        A, second = side**2, side**4 / 12
        EI, GJ = E * second, 0.1406 * G * side**4
        stiffness = (5 / 6 * G * A, 5 / 6 * G * A, E * A, EI, EI, GJ)
        super().__init__(stiffness, density * A, (density * second, density * second))
        self.side = side


class SensorDistance(sc.Sensor):
    """Between two mass points."""

    unit = "m"

    def __init__(self, a, b):
        self.a, self.b = a, b

    def items(self):
        return [self.a, self.b]

    def values(self, system, window):
        x, y = (window.q[:, system.dofs(item.place())] for item in (self.a, self.b))
        return np.linalg.norm(x - y, axis=1)


class IntegratorMidpoint(sc.Integrator):
    """Implicit midpoint rule: all forces, stresses and constraints at the midpoint of a step."""

    name, order, composed_to = "midpoint", 2, 6
    reference = "Hairer, Lubich & Wanner, Geometric Numerical Integration, II.1"

    def scheme(self, h):
        return sc.Scheme(2 / h, 2.0, h, weight=0.5, rate=1 / h, carry=(1.0, -1.0, 0.0))


class IntegratorTwoInstants(IntegratorMidpoint):
    """Stresses are the means of those at both ends: a balance that is more than numbers."""

    name, composed_to = "two instants", 0

    def balance(self, system, h):
        return BalanceOfBothEnds(system, self, h)


class BalanceOfBothEnds(sc.StepBalance):
    def evaluate(self, step, y1):
        e = super().evaluate(step, y1)
        strains = [self.system.strain(y) for y in (step.y0, y1)]
        groups = zip(self.system.beam_groups, e.strains, *strains, strict=True)
        more = [0.5 * (g.stress(a[0]) + g.stress(b[0])) - g.stress(eps) for g, eps, a, b in groups]
        force = self.system.internal_force(e.Bs, more)
        own = {"R": e.R + self.scheme.force * force, "forces": e.forces + force}
        stresses = [old + new for old, new in zip(e.stresses, more, strict=True)]
        return sc.Evaluation(**(vars(e) | own | {"stresses": stresses}))


class SolverInverse(sc.Solver):
    """Takes the inverse matrix."""

    name = "inverse"

    def bind(self, pattern):
        return FactorsInverse(pattern)


class FactorsInverse(sc.Factors):
    name = "inverse"

    def __init__(self, pattern):
        columns = np.repeat(np.arange(pattern.shape[1]), np.diff(pattern.indptr))
        self.at, self.shape = (pattern.indices, columns), pattern.shape

    def factor(self, data):
        A = np.zeros(self.shape)
        A[self.at] = data
        try:
            self.inverse = np.linalg.inv(A)
        except np.linalg.LinAlgError as error:
            raise sc.SingularMatrixError from error

    def solve(self, rhs):
        return self.inverse @ rhs


class LoadKept(sc.Load):
    """Terms that were made before."""

    def __init__(self, *kept):
        super().__init__()
        self.kept = kept

    def terms(self):
        return self.kept


class LoadOf(sc.Load):
    """Whatever terms a function gives."""

    def __init__(self, make):
        super().__init__()
        self.make = make

    def terms(self):
        return self.make(self)


def in_field(place, field):
    """A charge in a magnetic field, which does no work."""
    return LoadKept(sc.TermFunction([place], lambda x, v, t: np.cross(v, field)))


def test_only_public_names_are_imported():
    imports = re.findall(r"^(?:import|from) (\S+)", Path(__file__).read_text("utf-8"), re.MULTILINE)
    others = {"__future__", "re", "pathlib", "numpy", "pytest"}
    assert set(imports) == {"skfem_cosserat"} | others


# -- loads of data: the same as the built-in ones --------------------------------------------------

WIND, PRESSURE, PUSH, WEIGHT = (0.4, 3.0, 1.0), (0.0, -4.0, 2.0), (1.0, 2.0, -3.0), (0.3, -4.0, 0.1)
GUSTS = sc.Table([0, 0.05, 0.1], [0, 1, 0.5])


def arm(own):
    """A beam on a ball joint, a rotor on its end, in a storm."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="rod")
    beam = model.add("beam", sc.Beam(mesh, SECTION, director=Z))
    start, end = beam.node("rod.start"), beam.node("rod.end")
    model.add("joint", sc.JointSpherical(GROUND, start))
    box = model.add("box", sc.RigidBody.box(0.5, (0.2, 0.1, 0.1), position=(1.1, 0, 0)))
    model.add("weld", sc.JointFixed(end, box.at((1, 0, 0))))
    model.add("bob", sc.MassPoint(0.2, position=(1.1, -0.5, 0)))
    model.add("rope", sc.JointDistance(box.at((1.1, 0, 0)), model["bob"].place()))
    rotor, hum = box.at((1.2, 0.02, 0)), sc.Harmonic(1.0, 3.0)
    if own:
        model.add("rotor", LoadRotor(rotor, 3.0, -0.4, hum))
        model.add("storm", LoadStorm(beam, end, WIND, PRESSURE, PUSH, WEIGHT, GUSTS))
        return model
    for name, load in {
        "thrust": sc.LoadForce(rotor, (0, 0, 3.0), hum, follower=True),
        "torque": sc.LoadMoment(rotor, (0, 0, -0.4), hum, follower=True),
        "wind": sc.LoadLine(beam, WIND, GUSTS),
        "pressure": sc.LoadLine(beam, PRESSURE, follower=True),
        "push": sc.LoadForce(end, PUSH),
        "weight": sc.LoadGravity(2 * np.array(WEIGHT)),
    }.items():
        model.add(name, load)
    return model


def run(scene, scheme, treatment, step=2e-3, until=0.1, **options):
    return sc.simulate(scene, SCHEMES[scheme], TREATMENTS[treatment], step, until, **options)


@pytest.mark.slow
@schemes
@treatments
def test_own_loads_of_data_move_a_scene_as_the_built_in_ones(scheme, treatment):
    own, known = (
        run(arm(own), scheme, treatment, until=0.03, kernels="numpy") for own in (True, False)
    )
    assert np.abs(own["q"] - own["q"][0]).max() > 1e-3
    for name in ("q", "v", "work_loads"):
        size = np.abs(known[name]).max()
        assert own[name] == pytest.approx(known[name], abs=1e-11 * size, rel=0)


@pytest.mark.one_quick
@treatments
def test_own_loads_of_data_have_the_kernels(treatment):
    pytest.importorskip("numba")
    compiled, plain = (
        run(arm(True), "energy-momentum", treatment, kernels=kernels)
        for kernels in ("numba", "numpy")
    )
    assert compiled.meta["kernels"] == "numba"
    assert compiled["q"] == pytest.approx(plain["q"], abs=1e-9)


def test_own_loads_that_leave_a_plane_are_named():
    assert not sc.planarity(arm(True))
    found = "; ".join(sc.planarity(arm(True), normal=Z).out_of_plane)
    assert "load 'storm': [0.4, 3.0, 1.0] leaves the plane by 1" in found
    assert "load 'rotor': " in found


def test_terms_that_a_load_keeps_go_along_with_replaced_items():
    """A force that follows starts in the same direction of space, whatever the new triad."""
    model = sc.Model()
    body = model.add("body", sc.RigidBody.sphere(1.0, 0.1))
    push = sc.TermForce(body.local((0, 0, 0)), (1.0, 0, 0), follower=True)
    load = model.add("push", LoadKept(push))
    assert load.references() == [body]
    turned = sc.RigidBody(4.0, np.eye(3), triad=((0, 1, 0), (-1, 0, 0), (0, 0, 1)))
    other = model.with_items({"body": turned})
    assert other["push"].references() == [other["body"]]
    history = run(other, "energy-momentum", "null space", 0.1, 1.0)
    assert history["v"][-1, :3] == pytest.approx([0.25, 0, 0])


def test_an_own_load_on_some_elements():
    mesh = sc.MeshCurve.init_line((0, 0, 0), (3, 0, 0), 3, name="rod")
    model = sc.Model()
    beam = model.add("beam", sc.Beam(mesh, SECTION, director=Z))
    model.add("band", LoadKept(sc.TermLine(beam, (0, 1.0, 0), elements=[1, 2])))
    model.add("foot", sc.JointFixed(GROUND, beam.node("rod.start")))
    path = sc.static(model, control=sc.LoadControl(until=1e-3))
    reaction = path["joint/foot/force"][-1]
    assert reaction == pytest.approx([0, -2e-3, 0], abs=1e-9)
    for wrong in (2, [], [0, 0], [3]):
        with pytest.raises(sc.InputError, match="expected numbers from 0 to 2, each once"):
            sc.TermLine(beam, (1.0, 0, 0), elements=wrong)


def test_an_event_switches_an_own_load():
    model = sc.Model()
    drone = model.add("drone", sc.RigidBody.box(2.0, (1, 1, 0.1)))
    rotor = model.add("rotor", LoadRotor(drone.local((0, 0, 0)), 4.0, 0.0))
    off = sc.Event(sc.ConditionTime(0.5), sc.ActionLoad(rotor, 0.0))
    history = run(model, "energy-momentum", "null space", 0.05, 1.0, events=[off])
    assert history["v"][-1, 2] == pytest.approx(1.0)  # 4 N / 2 kg for half a second
    field = model.add("field", in_field(drone.local((0, 0, 0)), Z))  # knows no amplitude
    calm = sc.Event(sc.ConditionTime(0.5), sc.ActionLoad(field, 0.0))
    with pytest.raises(sc.InputError, match=r"load 'field': its terms have no amplitude"):
        run(model, "energy-momentum", "null space", 0.05, 1.0, events=[calm])


# -- loads that are functions of the motion --------------------------------------------------------


def ball(load=None, velocity=(2.0, 0, 0)):
    model = sc.Model()
    item = model.add("ball", sc.MassPoint(1.5, velocity=velocity))
    if load is not None:
        model.add("load", load(item.place()))
    return model


@pytest.mark.one_quick
@pytest.mark.parametrize("treatment", TREATMENTS)
@pytest.mark.parametrize("scheme", [*SCHEMES, "explicit"])
def test_drag_slows_a_ball_as_it_should(scheme, treatment):
    """v = v_0/(1 + c v_0 t/m), of second order in the step; its work is the change of energy."""
    if scheme == "explicit" and treatment == "null space":
        pytest.skip("has multipliers alone")
    exact = 2.0 / (1 + 0.6 * 2.0 / 1.5)
    errors = []
    for step in (0.1, 0.05):
        integrator = {**SCHEMES, "explicit": sc.Explicit()}[scheme]
        model = ball(lambda place: LoadDrag(place, 0.6))
        history = sc.simulate(model, integrator, TREATMENTS[treatment], step, 1.0)
        errors.append(abs(history["v"][-1, 0] - exact))
        work, energy = history["work_loads"], history["kinetic"]
        assert work[-1] == pytest.approx(0.75 * (exact**2 - 4), rel=0.02)
        if scheme == "energy-momentum":
            assert energy - energy[0] == pytest.approx(work, abs=1e-10)
    assert errors[1] < (0.1 if scheme == "composed" else 0.3) * errors[0]
    assert errors[1] < 1e-3


@pytest.mark.slow
@treatments
def test_a_magnetic_field_turns_a_charge_and_does_no_work(treatment):
    model = ball(lambda place: in_field(place, (0, 0, 3.0)))
    history = run(model, "energy-momentum", treatment, 5e-3, 1.0)
    assert history["kinetic"] == pytest.approx(3.0, rel=1e-9)
    assert history["work_loads"] == pytest.approx(0.0, abs=1e-9)
    angle = -3.0 / 1.5 * 1.0
    expected = 2 * np.array([np.cos(angle), np.sin(angle), 0])
    assert history["v"][-1] == pytest.approx(expected, abs=1e-4)


def two(link):
    """Two bodies, one of them held by a joint at some distance."""
    model = sc.Model()
    a = model.add("a", sc.RigidBody.box(1.0, (0.2, 0.3, 0.1)))
    b = model.add("b", sc.RigidBody.box(2.0, (0.1, 0.2, 0.3), position=(1.5, 0.2, 0)))
    model.add("hinge", sc.JointSpherical(sc.ground((0.3, 0, 0.1)), a.at((0.3, 0, 0.1))))
    model.add("link", link(a.at((0.1, 0, 0)), b.at((1.4, 0.3, 0.1))))
    return model


def by_hand(x, v, t):
    eye = np.einsum("kl,ij->kilj", [[-7.0, 7.0], [7.0, -7.0]], np.eye(3))
    return eye, np.zeros((2, 3, 2, 3))


@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore:model. .* is held by spring 'link':skfem_cosserat.ModelWarning")
@schemes
@treatments
@pytest.mark.parametrize("slopes", [None, by_hand], ids=["complex step", "slopes"])
def test_a_function_pulls_as_a_spring_of_no_length(scheme, treatment, slopes):
    """f = k (x_b - x_a), which a spring of vanishing length has as well."""
    own = run(
        two(lambda a, b: LoadAttraction(a, b, 7.0, True, slopes)), scheme, treatment, 0.02, 0.3
    )
    spring = two(lambda a, b: sc.SpringDamper(a, b, 7.0, length=1e-9))
    near = run(spring, scheme, treatment, 0.02, 0.3)
    assert np.abs(near["q"] - near["q"][0]).max() > 0.2
    # the energy-decaying scheme damps springs, but not loads
    assert own["q"] == pytest.approx(near["q"], abs=5e-3 if scheme == "energy-decaying" else 1e-6)
    assert own["newton_iterations"].max() <= near["newton_iterations"].max() + 1


@treatments
def test_functions_in_statics_grow_with_the_load_factor(treatment):
    """Weight against f = -k x at load factor s: x = -g m/k at each, and work of both loads."""

    growing = sc.Table([0], [1])
    model = ball(
        lambda place: LoadKept(sc.TermFunction([place], lambda x, v, t: -30.0 * x, growing)),
        velocity=(0, 0, 0),
    )
    model.add("weight", sc.LoadGravity((0, 0, -10.0)))
    path = sc.static(model, TREATMENTS[treatment], control=sc.LoadControl(steps=4))
    assert path["q"][:, 2] == pytest.approx(-path["load_factor"] * 15.0 / 30.0, abs=1e-9)
    modes = sc.modes(model, path, count=1)
    assert modes.frequencies[0] == pytest.approx(np.sqrt(30.0 / 1.5) / (2 * np.pi), rel=1e-9)


def test_a_column_buckles_under_a_function_as_under_a_force():
    """Constant, so dead; and towards a point far away, which is nearly that."""

    def critical(load):
        mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 0, 1), 6, name="rod")
        model = sc.Model()
        beam = model.add("column", sc.Beam(mesh, SECTION, order=2))
        model.add("foot", sc.JointFixed(GROUND, beam.node("rod.start")))
        model.add("load", load(beam.node("rod.end")))
        return sc.buckling(model, count=2).factors

    def by(force):
        return critical(lambda place: LoadKept(sc.TermFunction([place], force)))

    expected = critical(lambda place: sc.LoadForce(place, (0, 0, -1.0)))
    assert by(lambda x, v, t: 0 * x + [0, 0, -1.0]) == pytest.approx(expected, rel=1e-9)
    assert by(lambda x, v, t: np.array([0, 0, -1.0]) - x / 1e6) == pytest.approx(expected, rel=1e-4)


def test_a_function_in_a_plane_and_out_of_it():
    def scene(load):
        model = ball(load)
        model.add("wall", sc.MassPoint(1.0, position=(1, 1, 0)))
        return model

    drag = scene(lambda place: LoadDrag(place, 0.6))
    flat, space = (
        run(drag.freeze(planar=planar), "energy-momentum", "null space", 0.1, 1.0)
        for planar in (sc.Planar(Z), None)
    )
    assert flat["q"] == pytest.approx(space["q"], abs=1e-12)
    field = scene(lambda place: in_field(place, (0, 1.0, 0)))
    with pytest.raises(sc.InputError, match=r"load 'load': pushes out of the plane"):
        field.freeze(planar=sc.Planar(Z))


def test_a_function_that_leaves_the_plane_late_is_told():
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (1, 1, 1)))

    def force(x, v, t):
        return -x + np.array([0, 0, 1.0]) * (t > 0.5)

    model.add("pull", LoadKept(sc.TermFunction([body.local((0.5, 0, 0))], force)))
    with pytest.warns(sc.AccuracyWarning, match="load 'pull', .*pushed out of the plane"):
        history = run(model.freeze(planar=sc.Planar(Z)), "energy-momentum", "null space", 0.1, 1.0)
    assert history.meta["warnings"][0]["time"] > 0.5


@pytest.mark.slow
@schemes
@treatments
def test_own_loads_that_are_functions_beside_the_kernels(scheme, treatment):
    """Drag and an attraction between two places of a beam and a box; they are called back."""
    pytest.importorskip("numba")
    if scheme == "energy-decaying":
        pytest.skip("its balance is more than numbers")
    model = arm(own=False)
    end, box = model["beam"].node("rod.end"), model["box"].at((1.2, 0.1, 0))
    model.add("drag", LoadDrag(box, 0.6, sc.Harmonic(1.0, 3.0, np.pi / 3)))
    model.add("pull", LoadAttraction(sc.ground((0.5, 0.5, 0)), end, 2.0))
    compiled, plain = (
        run(model, scheme, treatment, until=0.04, kernels=kernels) for kernels in BOTH
    )
    assert (compiled.meta["kernels"], plain.meta["kernels"]) == BOTH
    for name in ("q", "p", "constraint_force", "work_loads"):
        size = np.nanmax(np.abs(plain[name]))
        assert compiled[name] == pytest.approx(plain[name], abs=1e-9 * size, nan_ok=True), name
    lost = compiled["dissipated"], plain["dissipated"]
    assert lost[0] == pytest.approx(lost[1], abs=1e-10 * np.abs(plain["work_loads"]).max())


@pytest.mark.slow
@pytest.mark.parametrize("kept", [True, False], ids=["place kept", "place made with the terms"])
def test_a_function_of_time_and_of_the_moving_ground(kept):
    """A spring to a platform that moves, and a force that grows with time."""
    motion = sc.Motion(displacement=lambda t: (0.5 * t**2, 0, 0))
    moving = sc.ground((0, 0, 0), motion)

    def tow(x, v, t):
        pull = 3.0 * (x[1] - x[0]) + np.array([0, 6.0 * t, 0])
        return np.array([pull, -pull])

    def load(place):
        other = moving if kept else sc.ground((0, 0, 0), motion)
        return [sc.TermFunction([other, place], tow)]

    model = ball(lambda place: LoadOf(lambda _load: load(place)), (0, 0, 0))
    history = run(model, "energy-momentum", "null space", 5e-3, 1.0)
    w, t = np.sqrt(2.0), 1.0  # m x'' = -3 (x - t^2/2), m y'' = -3 y - 6 t
    x = t**2 / 2 - (1 - np.cos(w * t)) / w**2
    y = -2 * (t - np.sin(w * t) / w)
    assert history["q"][-1] == pytest.approx([x, y, 0], abs=2e-5)


@pytest.mark.parametrize(
    ("force", "slopes", "text"),
    [
        (lambda x, v, t: -np.linalg.norm(v) * v, None, "slopes of its force differ"),
        (
            lambda x, v, t: -np.interp(x, [0, 1], [0, 1]),
            None,
            "its force at complex numbers, .* failed .* TypeError",
        ),
        (lambda x, v, t: v[0], None, r"gives an array \(3,\) of float64, expected \(1, 3\)"),
        (lambda x, v, t: v + np.nan, None, "not finite"),
        (lambda x, v: v, None, r"its force failed at t = 0 s: TypeError: .* positional"),
        (lambda x, v, t: -x, lambda x, v, t: 1 // 0, "its slopes function failed at t = 0 s"),
        (
            lambda x, v, t: -x,
            lambda x, v, t: (np.full((1, 3, 1, 3), np.nan),) * 2,
            "slopes are not finite",
        ),
        (  # a drag that is not there
            lambda x, v, t: -x,
            lambda x, v, t: (-np.eye(3).reshape(1, 3, 1, 3),) * 2,
            "slopes of its force differ",
        ),
    ],
)
def test_functions_that_fail_or_give_no_slopes_are_named(force, slopes, text):
    model = ball(lambda place: LoadKept(sc.TermFunction([place], force, slopes=slopes)))
    with pytest.raises(sc.InputError, match=rf"load 'load': .*{text}"):
        model.freeze()


@pytest.mark.one_quick
@treatments
def test_a_force_that_fails_in_a_run_is_named_and_the_history_kept(treatment, kernels):
    wind = [2.0, 2.0, 2.0]  # by tenths of a second, too few

    def force(x, v, t):
        return 0 * x + np.array([0, 0, wind[int(10 * t)]])

    model = sc.Model()
    drone = model.add("drone", sc.MassPoint(2.0))
    model.add("wind", LoadKept(sc.TermFunction([drone.place()], force)))
    failed = r"load 'wind': its force failed at t = 0.35 s: IndexError: list index"
    with pytest.raises(sc.InputError, match=failed) as caught:
        run(model, "energy-momentum", treatment, 0.1, 1.0, kernels=kernels)
    history = caught.value.history
    assert isinstance(caught.value.__cause__, IndexError)
    assert history.times == pytest.approx([0, 0.1, 0.2, 0.3])
    assert history.status == "failed"
    assert history["q"][-1, 2] == pytest.approx(0.5 * 0.3**2)


@pytest.mark.slow
def test_a_kink_and_slopes_of_its_own_are_allowed():
    """A floor that pushes back, with the slope of the side it is on."""

    def floor(x, v, t):
        depth = np.where(x[0, 2].real < 0, -x[0, 2], 0.0)
        return np.array([[0, 0, 1.0]]) * 500.0 * depth

    model = ball(lambda place: LoadKept(sc.TermFunction([place], floor)), (0, 0, -1.0))
    history = run(model, "energy-momentum", "multipliers", 1e-3, 0.4)
    assert history["v"][-1, 2] == pytest.approx(1.0, abs=1e-3)


def test_terms_are_checked():
    point, body = sc.MassPoint(1.0).place(), sc.RigidBody.box(1.0, (1, 1, 1)).at((0, 0, 0))

    def force(x, v, t):
        return -x

    for make, text in (
        (lambda: sc.TermForce(GROUND, Z), "expected the place of an item"),
        (lambda: sc.TermMoment(point, Z), "is a mass point and has no directions"),
        (lambda: sc.TermFunction([], force), "points is empty"),
        (lambda: sc.TermFunction(body, force), "a sequence of places"),
        (lambda: sc.TermFunction([point], 3.0), r"force = 3.0, expected a function"),
        (lambda: sc.TermLine(point, Z), "acts on Place, expected a beam"),
        (lambda: sc.direction(body, 0), "axis has shape"),
    ):
        with pytest.raises(sc.InputError, match=text):
            make()
    assert sc.TermFunction((each for each in [body]), force).points == (body,)  # any iterable


# -- an own joint, section and sensor --------------------------------------------------------------


@pytest.mark.one_quick
@schemes
@treatments
def test_an_own_joint_lets_a_bead_slide_down(scheme, treatment):
    model = sc.Model()
    bead = model.add("bead", sc.MassPoint(0.7, position=(0.1, 0, 0)))
    normal = np.array([-0.6, 0, 0.8])
    foot = sc.ground(np.array([0.1, 0, 0]))
    model.add("slope", JointPointOnPlane(foot, bead.place(), normal))
    model.add("weight", sc.LoadGravity((0, 0, -10.0)))
    history = run(model, scheme, treatment, 0.02, 0.5)
    moved = history["q"][-1] - history["q"][0]
    close = 1e-4 if scheme == "energy-decaying" else 1e-9  # t^2 g sin(alpha)/2
    assert moved @ normal == pytest.approx(0.0, abs=1e-12)
    assert moved @ (0.8, 0, 0.6) == pytest.approx(-0.75, rel=close)


def test_an_own_joint_has_coordinates_a_plane_and_statics():
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (0.1, 0.1, 0.1)))
    place = body.at((0, 0, 0))
    joint = model.add("table", JointPointOnPlane(GROUND, place, (0, 1, 0)))
    assert [c.name for c in joint.coordinates()] == ["u", "v", "rotation"]
    assert model.freeze().unknowns == 5
    for name in ("u", "v", "rotation"):
        model.add(f"spring {name}", sc.JointSpringDamper(joint, 2.0, coordinate=name))
    model.add("push", sc.LoadForce(place, (0, 3.0, 0.4)))
    assert sc.planarity(model, normal=(1, 0, 0))
    path = sc.static(model)
    assert path["q"][-1, :3] == pytest.approx([0, 0, 0.2], abs=1e-9)


@pytest.mark.one_quick
@treatments
def test_an_own_section_bends_as_its_constants_say(treatment):
    """1 m long, under 1 N at its end."""
    side, E, G = 0.02, 2e11, 8e10
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 8, name="rod")
    section = SectionSquare(side, E, G, 7800.0)
    beam = model.add("beam", sc.Beam(mesh, section, director=Z, order=2))
    model.add("clamp", sc.JointFixed(GROUND, beam.node("rod.start")))
    model.add("push", sc.LoadForce(beam.node("rod.end"), (0, 0, 1.0)))
    path = sc.static(model, TREATMENTS[treatment])
    bending, shear = 1 / (3 * E * side**4 / 12), 1 / (5 / 6 * G * side**2)
    moved = path.position(beam.node("rod.end"))[-1]
    assert moved[2] == pytest.approx(bending + shear, rel=1e-4)


def test_an_own_sensor_sees_every_step():
    model = sc.Model()
    a = model.add("a", sc.MassPoint(1.0))
    b = model.add("b", sc.MassPoint(1.0, position=(1, 0, 0), velocity=(0, 2.0, 0)))
    sensors = {"gap": SensorDistance(a, b)}
    history = run(model, "variational", "multipliers", 0.1, 1.0, every=10, sensors=sensors)
    assert len(history) == 2
    record = history.sensors["gap"]
    assert record.values == pytest.approx(np.sqrt(1 + (2 * np.arange(11) * 0.1) ** 2))


def test_an_event_may_close_a_loop_of_a_compiled_run():
    """A second hinge on the axis of the first one, with multipliers: its rows are redundant."""
    pytest.importorskip("numba")

    def scene(count):
        model = sc.Model()
        body = model.add("body", sc.RigidBody(1.0, np.diag((0.1, 0.2, 0.3)), position=(1, 0, 0)))
        for k in range(count):
            place = (0, 0.2 * k, 0)
            model.add(f"hinge {k}", sc.JointRevolute(sc.ground(place), body.at(place), (0, 1, 0)))
        model.add("weight", sc.LoadGravity((0, 0, -9.81)))
        return model

    other = scene(2)
    event = sc.Event(sc.ConditionTime(0.1), lambda t, view: other, name="second hinge")
    fast, plain = (
        run(scene(1), "energy-momentum", "multipliers", 0.01, 0.2, events=[event], kernels=kernels)
        for kernels in BOTH
    )
    assert np.allclose(fast["q"], plain["q"], rtol=0, atol=1e-10)
    assert fast.meta["kernels"] == "numba"


def test_kept_terms_go_along_with_another_mesh():
    def boom(elements):
        mesh = sc.MeshCurve.init_line((0, 0, 0), (2, 0, 0), elements, name="boom")
        return sc.Beam(mesh, SECTION, director=Z)

    model = sc.Model()
    beam = model.add("beam", boom(4))
    model.add("line", LoadKept(sc.TermLine(beam, (1.0, 0, 0))))
    loading = model.with_items({"beam": boom(16)}).freeze().loading
    assert loading.dead_force(loading.values(0.0))[::4].sum(axis=0) == pytest.approx((2.0, 0, 0))
    model.add("part", LoadKept(sc.TermLine(beam, (1.0, 0, 0), elements=np.array([0, 1]))))
    with pytest.raises(sc.InputError, match="take them in terms"):
        model.with_items({"beam": boom(16)})


def test_what_is_no_term_is_named_when_it_is_added():
    body = sc.RigidBody.box(1.0, (1, 1, 1))
    push = sc.TermForce(body.at((0, 0, 0)), (1.0, 0, 0))
    for wrong, text in (
        (None, "gives None, expected a list of terms"),
        (push, "expected a list of terms"),
        ([push, 3], "has 3 among its terms"),
    ):
        with pytest.raises(sc.InputError, match=f"model, item 'push': .*{text}"):
            sc.Model().add("push", LoadOf(lambda load, wrong=wrong: wrong))


def test_a_load_without_its_base_constructor_works():
    class LoadBare(sc.Load):
        def __init__(self, place):
            self.place = place

        def terms(self):
            return [sc.TermForce(self.place, (3.0, 0, 0), self.time)]

    model = ball(LoadBare, (0, 0, 0))
    assert "LoadBare" in repr(model["load"])
    history = run(model, "energy-momentum", "null space", 0.1, 1.0)
    assert history["q"][-1, 0] == pytest.approx(1.0)


def test_a_force_may_be_the_same_array_each_time():
    room = {}

    def force(x, v, t):
        out = room.setdefault(np.iscomplexobj(x), np.empty_like(x))
        out[:] = -x
        return out

    model = ball(lambda place: LoadKept(sc.TermFunction([place], force)))
    assert model.freeze().unknowns == 3


# -- an own integrator and linear solver (a treatment: test_own_treatment.py) ----------------------


@treatments
def test_an_own_integrator_moves_a_spring_as_its_closed_form_says(treatment):
    """x_n = cos(n phi), tan(phi/2) = h w/2: the midpoint rule's own frequency."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(2.0, position=(1.0, 0, 0)))
    model.add("spring", LoadAttraction(GROUND, ball.place(), 8.0, spring=True))
    history = sc.simulate(model, IntegratorMidpoint(), TREATMENTS[treatment], 0.1, 2.0)
    phi = 2 * np.arctan(0.5 * 0.1 * 2.0)
    assert history["q"][:, 0] == pytest.approx(np.cos(phi * np.arange(21)), abs=1e-9)
    assert history["v"][:, 0] == pytest.approx(-2 * np.sin(phi * np.arange(21)), abs=1e-9)


def pulled():
    """The arm with a damped section, and a spring with a damper on its end."""
    model = arm(own=False)
    foot, end = sc.ground((1, 0, 0.5)), model["beam"].node("rod.end")
    model.add("strut", sc.SpringDamper(foot, end, 40.0, 2.0))
    beam = model["beam"]
    return model.with_items({"beam": sc.Beam(beam.mesh, SECTION.damped(0.01), director=Z)})


@pytest.mark.one_quick
@treatments
def test_an_own_integrator_in_numbers_has_the_kernels(treatment):
    pytest.importorskip("numba")
    own = arm(True), IntegratorMidpoint(), TREATMENTS[treatment], 2e-3, 0.1
    compiled, plain = (sc.simulate(*own, kernels=kernels) for kernels in ("numba", "numpy"))
    assert compiled.meta["kernels"] == "numba"
    assert compiled["q"] == pytest.approx(plain["q"], abs=1e-9)


@pytest.mark.one_quick
@treatments
def test_a_balance_that_is_more_than_numbers(treatment):
    """Stresses of quadratic energies at both ends are the discrete derivative."""
    known, own = (
        sc.simulate(pulled(), scheme, TREATMENTS[treatment], 1e-3, 0.02)
        for scheme in (sc.EnergyMomentum(), IntegratorTwoInstants())
    )
    assert own["q"] == pytest.approx(known["q"], abs=1e-6)  # the spring's force is at the midpoint
    with pytest.raises(sc.InputError, match="two instants integrator, whose balance is its own"):
        sc.simulate(arm(True), IntegratorTwoInstants(), sc.NullSpace(), 1e-3, 0.1, kernels="numba")


@pytest.mark.slow
@treatments
def test_an_own_integrator_can_be_composed(treatment):
    scheme = sc.Composition(IntegratorMidpoint(), 4)
    errors = []
    for step in (0.2, 0.1):
        model = sc.Model()
        ball = model.add("ball", sc.MassPoint(2.0, position=(1.0, 0, 0)))
        model.add("spring", LoadAttraction(GROUND, ball.place(), 8.0, spring=True))
        history = sc.simulate(model, scheme, TREATMENTS[treatment], step, 2.0)
        errors.append(abs(history["q"][-1, 0] - np.cos(4.0)))
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.1)


@pytest.mark.slow
def test_an_own_solver_gives_the_same_motion():
    known = sc.simulate(arm(True), sc.EnergyMomentum(), sc.NullSpace(), 2e-3, 0.02)
    own = sc.simulate(
        arm(True), sc.EnergyMomentum(), sc.NullSpace(), 2e-3, 0.02, solver=SolverInverse()
    )
    assert own.meta["solver"] == "inverse"
    assert own["q"] == pytest.approx(known["q"], abs=1e-9)


@pytest.mark.parametrize("metre", [1e-9, 1.0, 1e3])
def test_slopes_are_compared_by_the_size_of_the_scene(metre):
    """A force that changes over the extent of the scene; drag beside it is checked by itself."""

    def force(x, v, t):
        return np.sin(3 * x / metre) - 0.1 * v

    def scene(drag):
        def slopes(x, v, t):
            by_x = np.diag(3 / metre * np.cos(3 * x / metre)[0])
            return by_x.reshape(1, 3, 1, 3), (-drag * np.eye(3)).reshape(1, 3, 1, 3)

        model = sc.Model()
        ball = model.add("ball", sc.MassPoint(1.0, position=(metre, 0, 0)))
        model.add("other", sc.MassPoint(1.0))
        model.add("waves", LoadKept(sc.TermFunction([ball.place()], force, slopes=slopes)))
        return model

    scene(0.1).freeze()
    with pytest.raises(sc.InputError, match="load 'waves': slopes of its force differ"):
        scene(0.2).freeze()


def test_an_attribute_may_not_hide_a_method():
    class Pull(sc.Load):
        def __init__(self, places: list[sc.Place]) -> None:
            super().__init__()
            self.places = places

        def terms(self) -> list[sc.TermForce]:
            return [sc.TermForce(place, (1.0, 0, 0)) for place in self.places]

    with pytest.raises(sc.InputError, match=r"item 'pull': its attribute 'places' hides"):
        sc.Model().add("pull", Pull([]))
