"""What is built is built: items cannot be changed, their arrays are their own, and all pickle."""

from __future__ import annotations

import copy
import inspect
import pickle
from dataclasses import FrozenInstanceError, dataclass

import numpy as np
import pytest
from helpers_schemes import KINDS

import skfem_cosserat as sc
from skfem_cosserat.frozen import Frozen
from skfem_cosserat.mesh import CurveArc, CurveHelix, CurveLine, CurveSpline


def ramp(t):
    """A function of time that pickles."""
    return t


def rest(t):
    return 0.0 * t


def swing(t):
    return (0.0, 0.0, rest(t))


def round_section(s):
    return sc.SectionCircle(0.1 - 0.01 * s, STEEL)


def energy(eps):
    return (np.array([2e3, 2e3, 5e3, 0.5, 0.5, 0.4]) * eps**2).sum(-1) / 2


def height(x):
    return x[:, 2]


def seen(system, q, t):
    return t


def passing(t, view):
    return t - 1.0


STEEL = sc.Material(210e9, 0.3, 7850)
ROUND = sc.SectionCircle(5e-3, STEEL)
MESH = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, "rod", nodes={"mid": 0.5})
ROD = sc.Beam(MESH, ROUND, order=2, director=(0, 1, 0))
BODY = sc.RigidBody.box(1.0, (1, 1, 1))
BALL = sc.MassPoint(1.0, (0, 0, -1))
GROUND, PLACE = sc.ground((0, 0, 0)), BODY.at((0, 0, 0))
HINGE = sc.JointRevolute(GROUND, PLACE, axis=(1, 0, 0))
TABLE = sc.Table([0, 1], [0, 1])
X, Y, Z = np.eye(3)

ITEMS = [
    *(STEEL, ROUND, MESH, ROD, BODY, BALL, GROUND, PLACE, HINGE, TABLE),
    sc.MassPoint(1.0, on=PLACE),
    sc.SectionRectangle(0.1, 0.2, STEEL),
    sc.SectionTube(0.1, 0.05, STEEL).damped(time=1e-3),
    sc.Section(np.ones(6), 1.0, (1.0, 1.0)),
    sc.SectionHyperelastic(energy, 0.1, (1e-6, 1e-6)),
    sc.SectionAlong(round_section),
    sc.SectionTaper(sc.SectionCircle(0.1, STEEL), sc.SectionCircle(0.05, STEEL)),
    sc.SectionTable([0, 1], np.ones((2, 6)), np.ones(2), np.ones((2, 2))),
    sc.MaterialAnisotropic(1e9 * np.eye(6), 1000.0),
    sc.Region([(0, 0), (1, 0), (0, 1)], STEEL),
    sc.Profile(sc.ProfileRectangle(0.1, 0.2, STEEL).mesh, STEEL),
    sc.ProfileRectangle(0.1, 0.2, STEEL),
    sc.ProfileRectangles([((0, 0.1), (0, 0.1), STEEL)]),
    sc.ProfileI(0.1, 0.2, 0.01, 0.02, STEEL),
    sc.ProfileChannel(0.1, 0.2, 0.01, 0.02, STEEL),
    sc.ProfileBox(0.1, 0.2, 0.01, STEEL),
    sc.ProfileCircle(0.1, STEEL),
    sc.ProfileTube(0.1, 0.05, STEEL),
    sc.ProfileRings((0.0, 0.1), (STEEL,)),
    sc.ProfilePolygon([(0, 0), (1, 0), (0, 1)], STEEL),
    sc.ProfileComposite([sc.Region([(0, 0), (1, 0), (0, 1)], STEEL)]),
    sc.InterpolationLobatto(2),
    sc.InterpolationEquidistant(3),
    CurveLine((0, 0, 0), (1, 0, 0)),
    CurveArc((0, 0, 0), (1, 0, 0), (0, 1, 0), 2.0, 1.0),
    CurveHelix((1, 0, 0), (0, 0, 0), (0, 0, 1), 0.5, 2.0),
    CurveSpline(np.array([(0, 0, 0), (1, 0, 0), (2, 1, 0.0)])),
    sc.TheoryReissner(),
    sc.TheoryKirchhoff(torsion=False),
    sc.TheoryInextensible(),
    sc.TheoryRigid(),
    sc.JointFixed(GROUND, PLACE),
    sc.JointSpherical(GROUND, PLACE),
    sc.JointUniversal(GROUND, PLACE, X, Y),
    sc.JointCylindrical(GROUND, PLACE, X),
    sc.JointPrismatic(GROUND, PLACE, X),
    sc.JointPlanar(GROUND, PLACE, Z),
    sc.JointPointOnLine(GROUND, PLACE, X),
    sc.JointDistance(GROUND, BALL.place()),
    sc.Turn("angle", X),
    sc.Slide("shift", Y, Z),
    sc.Freedom((sc.Turn("angle", X),)),
    sc.Product(sc.direction(PLACE, X), sc.point(PLACE)),
    sc.point(PLACE),
    sc.Zero(sc.point(PLACE)),
    sc.JointDrive(HINGE, rest),
    sc.JointSpringDamper(HINGE, 2.0),
    sc.JointLimits(HINGE, 0.0, 1.0, 2.0),
    sc.JointActuator(HINGE, ramp),
    sc.SpringDamper(GROUND, BALL.place(), 3.0, force=TABLE),
    sc.Cable(GROUND, BALL.place(), 3.0),
    sc.Bushing(GROUND, PLACE, 3.0),
    sc.Foundation(ROD, 2.0),
    sc.RayleighDamping(0.5, items=[ROD]),
    sc.LoadForce(PLACE, Z, TABLE, follower=True),
    sc.LoadForce(PLACE, swing),
    sc.LoadMoment(PLACE, Z, ramp),
    sc.LoadLine(ROD, Z, part="rod"),
    sc.LoadGravity((0, 0, -9.81)),
    sc.TermForce(PLACE, Z, TABLE, follower=True),
    sc.TermMoment(PLACE, Z, ramp),
    sc.TermLine(ROD, Z),
    sc.TermStrain(ROD, Z),
    sc.LoadStrain(ROD, (0, 0, 1e-3, 0, 0, 0)),
    sc.TermAcceleration((0, 0, -9.81)),
    sc.Force([PLACE, BALL.place()], passing),
    sc.LoadForm(ROD, seen),
    sc.EnergyForm(ROD, ramp),
    sc.JointServo(HINGE, 2.0, 1.0, reference=ramp),
    sc.Controller(1.0, passing),
    sc.Plane((0, 0, 0), Z),
    sc.Sphere((0, 0, 0), 1.0),
    sc.Cylinder((0, 0, 0), Z, 1.0),
    sc.Obstacle(height, [BODY, BALL, ROD.node("mid")], 10.0, friction=0.1, slip_speed=0.1),
    sc.FunctionOfTime(ramp),
    sc.RampLinear(0.0, 1.0),
    sc.RampSmooth(0.0, 1.0, last=3.0),
    sc.Harmonic(1.0, 2.0),
    sc.Motion(displacement=swing),
    sc.MotionTurn(Z, rest),
    sc.MotionShake([0, 1, 2], np.zeros((3, 3))),
    sc.SensorPosition(ROD, 0.5),
    sc.SensorVelocity(PLACE),
    sc.SensorAcceleration(PLACE, frame=ROD.node("mid")),
    sc.SensorStrain(ROD, 0.5, "rod"),
    sc.SensorForce(ROD, 0.5),
    sc.SensorReaction(HINGE),
    sc.SensorQuantity(seen),
    sc.ConditionTime(1.0),
    sc.ConditionCoordinate(HINGE, 1.0),
    sc.ConditionSensor(sc.SensorPosition(PLACE), 1.0),
    sc.ConditionReaction("hinge", 1.0),
    sc.ConditionEnergy(1.0),
    sc.ActionFunction(passing),
    sc.ActionLoad("push", 2.0),
    sc.ActionLock("hinge"),
    sc.ActionRelease(HINGE),
    sc.ActionStop(),
    sc.ActionUnlock("hinge"),
    sc.Event(passing, sc.ActionStop()),
    *KINDS,
    sc.Explicit(),
    sc.NullSpace(),
    sc.Multipliers(),
    sc.SolverDense(),
    sc.SolverBanded(),
    sc.SolverSuperLU(),
    sc.SolverPardiso(),
    sc.LoadControl(),
    sc.LoadControl(at=[0.5, 1.0]),
    sc.DisplacementControl(ROD.node("mid"), Z, 0.1),
    sc.ArcLength(),
    sc.NewtonSettings(),
    sc.StepControl(1e-3),
    sc.Planar(Z),
    sc.Spin(Z),
]


def attributes(item):
    return {name: value for name, value in vars(item).items() if not name.startswith("_")}


def arrays_in(value):
    if isinstance(value, np.ndarray):
        yield value
    elif type(value) is tuple:
        for each in value:
            yield from arrays_in(each)


def test_all_public_kinds_are_here():
    kinds = {getattr(sc, name) for name in sc.__all__ if isinstance(getattr(sc, name), type)}
    bases = {sc.Theory, sc.Joint, sc.Load, sc.Sensor, sc.Solver, sc.Integrator, sc.Treatment}
    bases |= {sc.Action, sc.Condition, sc.SectionField}
    frozen = {kind for kind in kinds - bases if issubclass(kind, Frozen)}
    assert frozen <= set(map(type, ITEMS))


each_kind = pytest.mark.parametrize("item", ITEMS, ids=lambda item: type(item).__name__)


@pytest.mark.one_quick
@each_kind
def test_items_and_their_copies_cannot_be_changed(item):
    for one in (item, copy.copy(item), pickle.loads(pickle.dumps(item))):
        assert type(one) is type(item)
        assert attributes(one).keys() == attributes(item).keys()
        for name in [*attributes(item), "velocty"]:
            before = getattr(one, name, None)
            with pytest.raises(
                FrozenInstanceError, match=f"{name} cannot be set: .*; make|'{name}'"
            ):
                setattr(one, name, np.nan)
            with pytest.raises(FrozenInstanceError, match=f"{name} cannot be deleted|'{name}'"):
                delattr(one, name)
            assert getattr(one, name, None) is before
        for value in attributes(one).values():
            assert not isinstance(value, list | dict | set)
            assert not any(array.flags.writeable for array in arrays_in(value))


@pytest.mark.one_quick
@each_kind
def test_items_say_in_one_line_what_they_are(item):
    text, kind = repr(item), type(item)
    assert kind.__name__ in text and len(text) < 400
    assert "\n" not in text and " at 0x" not in text
    if kind.__init__ is not object.__init__:  # help() and editors show the arguments
        wanted = list(inspect.signature(kind.__init__).parameters)[1:]
        assert list(inspect.signature(kind).parameters) == wanted


def test_names_of_functions_and_items_are_shown():
    assert repr(sc.LoadForce(PLACE, Z, lambda t: t)) == (
        "<LoadForce: value=[0, 0, 1], amplitude=<lambda>, place=rigid body at [0.0, 0.0, 0.0]>"
    )
    assert "motion=rest" in repr(sc.JointDrive(HINGE, rest))
    assert repr(sc.SensorPosition(ROD, 0.5)) == "SensorPosition(where=beam, s=0.5)"
    assert repr(sc.Model().add("ball", sc.MassPoint(2.0))).startswith("<MassPoint 'ball': mass=2")


# ----------------------------------------------------------------- what users did without effect
def cantilever():
    model = sc.Model()
    rod = sc.Beam(MESH, sc.SectionCircle(5e-3, sc.Material(5e6, 0.45, 1100)), director=(0, 1, 0))
    model.add("rod", rod)
    model.add("clamp", sc.JointFixed(GROUND, rod.node("rod.start")))
    return model, rod, model.add("force", sc.LoadForce(rod.node("rod.end"), (0, 1e-3, 0)))


def test_late_assignments_are_refused():
    _, rod, load = cantilever()
    section = rod.sections["section"]
    with pytest.raises(sc.FrozenError, match=r"value .*make another one, and a model with it"):
        load.value = (0, 2e-3, 0)
    with pytest.raises(sc.FrozenError, match=r"beam 'rod': section .*model.with_items"):
        rod.section = ROUND
    with pytest.raises(sc.FrozenError, match="name cannot be set"):
        rod.name = "boom"
    with pytest.raises(TypeError):
        rod.sections["section"] = ROUND
    for array in (section.stiffness, rod.elements.stiffness, rod.basis.nodes):
        with pytest.raises(ValueError, match="read-only"):
            array[:] = 0


def test_a_system_cannot_be_written_to():
    system = cantilever()[0].freeze()
    public = {k: v for k, v in vars(system).items() if isinstance(v, np.ndarray)}
    for array in (*public.values(), system.q0, system.v0, system.mass.data):
        assert not array.flags.writeable
    state = sc.initial_state(system)  # is one's own
    state.q[0] += 0.0


def test_arrays_of_users_stay_theirs():
    value, axis, stiffness = np.ones(3), np.array([0, 0, 1.0]), np.ones(6)
    points, t = np.array([[0, 0, 0], [1, 0, 0], [2, 1, 0.0]]), np.array([[0, 1], [1, 2]])
    doflocs = points.T.copy()
    items = [
        sc.RigidBody(1.0, np.ones(3), position=value),
        *(sc.LoadForce(PLACE, value), sc.Table(value.cumsum(), value), sc.ground(value)),
        *(sc.JointRevolute(GROUND, PLACE, axis), sc.Spin(axis), sc.Section(stiffness, 1.0, (1, 1))),
    ]
    meshes = [sc.MeshCurve.init_points(points), sc.MeshCurve(doflocs, t)]
    before = [*map(repr, items)], [(mesh.p.tolist(), mesh.t.tolist()) for mesh in meshes]
    for array in (value, axis, stiffness, points, t, doflocs):
        array[:] = 0  # writable still
    assert before == (
        [*map(repr, items)],
        [(mesh.p.tolist(), mesh.t.tolist()) for mesh in meshes],
    )


def test_what_makes_others_still_does():
    model, rod, _ = cantilever()
    fine = rod.refined(1, order=2)
    other = model.with_items({"rod": fine})
    assert fine.mesh.nelements == 8
    assert other["force"].place.item is fine
    assert model["force"].place.item is rod
    for each in (fine, other["force"], ROUND.damped(time=1e-3), MESH.with_nodes({"hook": 1})):
        with pytest.raises(sc.FrozenError):
            each.mass = 1.0


# ------------------------------------------------------------------------- classes of users
class Screw(sc.JointSpherical):
    """A joint of one's own, with attributes set before and after those of its base."""

    def __init__(self, a, b, axis):
        self.given = axis
        super().__init__(a, b)
        self.axis = axis
        self.turned, self._seen = 2 * self.axis, 0

    def with_replacements(self, replacements):
        other = super().with_replacements(replacements)
        other.turned = 3 * self.axis
        return other


@dataclass(frozen=True, eq=False)
class Tide(sc.Motion):
    """A motion of one's own that is a dataclass."""

    height: float = 1.0

    def frame(self, place, t):
        return np.vstack([place.position + (0, 0, self.height * t), np.eye(3)])


def test_own_classes_are_frozen_when_their_constructor_is_through():
    axis = np.array([0, 0, 1.0])
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (1, 1, 1)))
    screw = model.add("screw", Screw(GROUND, body.at((0, 0, 0)), axis))
    model.freeze()
    axis[:] = 0
    assert screw.turned.tolist() == [0, 0, 2]
    assert screw.given.tolist() == [0, 0, 1]
    screw._seen += 1  # notes of its own stay free
    other = model.with_items({"body": sc.RigidBody.box(2.0, (1, 1, 1))})["screw"]
    assert other.turned.tolist() == [0, 0, 3]
    for item, name in ((screw, "axis"), (Tide(height=2.0), "height"), (other, "turned")):
        with pytest.raises(FrozenInstanceError):
            setattr(item, name, 1.0)


def test_a_load_of_an_unknown_kind_is_named():
    class Wind(sc.Load):
        pass

    model = sc.Model()
    with pytest.raises(sc.InputError, match=r"item 'wind': is Wind, .*derive it from LoadForce"):
        model.add("wind", Wind((1.0, 0, 0)))


# ----------------------------------------------------------------------------- arguments
FLAGS = {
    "follower": lambda flag: sc.LoadForce(PLACE, Z, follower=flag),
    "lumped": lambda flag: sc.Beam(MESH, ROUND, lumped=flag),
    "torsion": lambda flag: sc.TheoryReissner(torsion=flag),
    "baseline": lambda flag: sc.MotionShake([0, 1], np.zeros((2, 3)), baseline=flag),
    "scaled": lambda flag: sc.Multipliers(scaled=flag),
    "stabilized": lambda flag: sc.Variational(stabilized=flag),
    "checked": lambda flag: sc.Explicit(checked=flag),
    "rate": lambda flag: sc.ConditionCoordinate(HINGE, 1.0, rate=flag),
    "once": lambda flag: sc.Event(passing, once=flag),
    "symmetric": lambda flag: sc.SolverSuperLU(symmetric=flag),
    "weld": lambda flag: MESH.joined(weld=flag),
    "closed curve": lambda flag: sc.MeshCurve.init_curve(
        CurveLine((0, 0, 0), (1, 0, 0)), 4, closed=flag
    ),
    "closed spline": lambda flag: sc.MeshCurve.init_points(np.eye(3), closed=flag),
    "recover": lambda flag: sc.History.load("nowhere.npz", recover=flag),
}


@pytest.mark.one_quick
@pytest.mark.parametrize("name", FLAGS)
@pytest.mark.parametrize("value", ["no", 1, 2.0, [False]])
def test_flags_are_true_or_false(name, value):
    with pytest.raises(sc.InputError, match="expected True or False") as error:
        FLAGS[name](value)
    assert name.split()[0] in str(error.value)
    assert repr(value) in str(error.value)


@pytest.mark.parametrize("make", [sc.JointDistance, lambda a, b: sc.SpringDamper(a, b, 1.0)])
@pytest.mark.parametrize(
    ("side", "words"),
    [
        (BALL, r"is the mass point, .*: point.place\(\)"),
        (BODY, r"is the rigid body, .*: body.at\(x\)"),
        (ROD, r"is the beam, .*: beam.node\('tip'\)"),
        (3, r"is 3, .*point.place\(\)"),
    ],
)
def test_places_are_asked_for_as_the_item_gives_them(make, side, words):
    with pytest.raises(sc.InputError, match=f"side b {words}"):
        make(GROUND, side)


@pytest.mark.parametrize("kind", [sc.RampLinear, sc.RampSmooth])
def test_values_of_ramps_have_names(kind):
    words = rf"order is begin, end \(s\), first, last.*{kind.__name__}\(0, 0.8, last=1.5\)"
    with pytest.raises(sc.InputError, match=words):
        kind(0, 0.8, 1.5)
    with pytest.raises(sc.InputError, match="name them"):
        kind(0, 0.8, 1, 2, 3)
    assert kind(0, 0.8, 2.0, 5.0)(0.8) == kind(0, 0.8, first=2.0, last=5.0)(1.0) == 5.0


@pytest.mark.parametrize(
    "shifted",
    [
        (X, Z, 0.5, 2, 20, "spring"),
        (X, 0 * X, Z, 0.5, 2, "spring"),
        (X, 0 * X, Z, 0.5, "2", 20),
        (X, 0 * X, Z, True, 2, 20),
        (X, 0 * X, Z, 0.5, 2, 20, {"mid": 0.5}),
        (X, 0 * X, Z, 0.5, 2, 20, "spring", "mid"),
        (X, 0 * X, Z, 0.5, 2, 20, "spring", {"mid": "half"}),
        (X, 0 * X, Z, 0.5, 2, 20, "spring", {3: 0.5}),
    ],
)
def test_arguments_of_a_helix_out_of_order(shifted):
    with pytest.raises(sc.MeshError, match="expected"):
        sc.MeshCurve.init_helix(*shifted)
    assert sc.MeshCurve.init_helix(X, 0 * X, axis=Z, pitch=1, turns=2, elements=8).nelements == 8


@pytest.mark.parametrize("name", [3, None, ("a",), b"rod"])
def test_names_of_meshes_are_texts(name):
    with pytest.raises(sc.MeshError, match=r"got .*expected a text"):
        sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name)
    with pytest.raises(sc.MeshError, match=r"name of a node: got .*expected a text"):
        MESH.with_nodes({name: 1})
    with pytest.raises(sc.MeshError, match=r"name of a beam: got .*expected a text"):
        MESH.with_beams({name: [0]})
    with pytest.raises(sc.MeshError, match="expected a name"):
        MESH.elements_of(name)
