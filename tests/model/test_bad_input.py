"""Each bad input gets one clear error before the first step, naming the item and the value."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest
import skfem

import skfem_cosserat as sc
from skfem_cosserat import (
    Beam,
    InputError,
    JointDistance,
    JointFixed,
    JointRevolute,
    JointSpherical,
    LoadForce,
    LoadGravity,
    LoadLine,
    LoadMoment,
    MassPoint,
    MeshCurve,
    Model,
    RigidBody,
    Section,
    ground,
    initial_state,
    simulate,
)

NAN = float("nan")
X, Y, Z = np.eye(3)
MATERIAL = sc.Material(1.0, 0.3, 1.0)
SECTION = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
CONSTANTS = {"EA": 1, "GA": 1, "EI": (1, 1), "GJ": 1, "mass": 1, "inertia": (1, 1)}
MESH = MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4, nodes={"mid": 0.5})
TWO = MeshCurve.init_line((0, 0, 0), X, 2, name="one").joined(
    MeshCurve.init_line(X, (1, 1, 0), 2, name="two")
)
BALL = RigidBody.sphere(1.0, 1.0)
PLACE, POINT, HERE = BALL.at((0, 0, 0)), MassPoint(1.0).place(), ground((0, 0, 0))


def beam(**options):
    return Beam(MESH, SECTION, **options)


def body(**options):
    return RigidBody(1.0, (1, 1, 1), **options)


def refused(call, *words):
    """One error of our own whose message has all the words."""
    with pytest.raises(InputError) as caught:
        call()
    text = str(caught.value)
    missing = [word for word in words if word not in text]
    assert not missing, f"{missing} not in {text!r}"
    assert isinstance(caught.value, ValueError)


def cases(*rows):
    """Calls, and regular expressions that their errors match."""
    return pytest.mark.parametrize(("call", "text"), rows)


# ----------------------------------------------------------------------- sections
@pytest.mark.one_quick
@cases(
    (lambda: sc.Material(NAN, 0.3, 1.0), "material.*E = nan"),
    (lambda: sc.Material((1.0, 2.0), 0.3, 1.0), r"E = \(1.0, 2.0\)"),
    (lambda: sc.Material(1.0, 0.3, 0.0), "rho = 0.0"),
    (lambda: sc.Material(1.0, 0.6, 1.0), "nu = 0.6"),
    (lambda: sc.SectionRectangle(0.0, 1.0, MATERIAL), "rectangle.*a = 0.0"),
    (lambda: sc.SectionRectangle(1.0, np.inf, MATERIAL), "b = inf"),
    (lambda: sc.SectionRectangle(1.0, 1.0, MATERIAL, -0.5), "shear_factor = -0.5"),
    (lambda: sc.SectionRectangle(1.0, 1.0, 210e9), "rectangle.*material.*210000000000.0"),
    (lambda: sc.SectionTube(1.0, 2.0, MATERIAL), "tube.*inner = 2.0.*outer = 1.0"),
    (lambda: sc.SectionCircle(-0.01, MATERIAL), "circle: radius = -0.01, expected a positive"),
    (lambda: sc.SectionCircle(1.0, MATERIAL, -1.0), "shear_factor = -1.0"),
    (lambda: Section(np.ones(5), 1.0, (1, 1)), r"section.*stiffness.*\(5,\).*\(6, 6\)"),
    (lambda: Section([1, 1, 0, 1, 1, 1], 1.0, (1, 1)), "EA = 0: a section without stiffness"),
    (lambda: Section([1, 1, 1, 1, -3, 1], 1.0, (1, 1)), "EI_2 = -3"),
    (lambda: Section(np.eye(6) + np.eye(6, k=1) / 9, 1.0, (1, 1)), "not symmetric.*0.111"),
    (lambda: Section(np.ones(6), -1.0, (1, 1)), "section.*mass = -1.0"),
    (lambda: Section(np.ones(6), 1.0, (1, -1)), r"inertia = \[1.0, -1.0\]"),
    (lambda: Section(np.ones(6), 1.0, (1, 1, 1)), r"inertia.*\(3,\).*\(2,\)"),
    (lambda: Section(np.ones(6), 1.0, (1, 1), [1, 2]), r"outline.*\(2,\)"),
    (
        lambda: Section.from_constants(**{**CONSTANTS, "EI": (1.0,)}),
        r"EI has shape \(1,\), expected \(2,\)",
    ),
    (lambda: Section.from_constants(**{**CONSTANTS, "GA": (1, 2, 3)}), r"GA has shape \(3,\)"),
)
def test_sections(call, text):
    with pytest.raises(InputError, match=text):
        call()


# ----------------------------------------------------------------------- beams and meshes
@pytest.mark.one_quick
@cases(
    (lambda: Beam(None, SECTION), "beam.*NoneType.*MeshCurve"),
    (lambda: Beam(skfem.MeshTri(), SECTION), "beam.*MeshTri1.*MeshCurve"),
    (lambda: Beam(MESH, None), "beam.*section = None"),
    (lambda: Beam(MESH, {"beam": 3.0}), "part 'beam'.*3.0"),
    (lambda: Beam(TWO, {"one": SECTION}), "2 of 4 elements.*element 2.*one"),
    (lambda: Beam(TWO, {"one": SECTION, "tow": SECTION}), "'tow'.*'two'"),
    (
        lambda: Beam(TWO.with_beams({"all": [0]}), {"one": SECTION, "all": SECTION}),
        "beam.*element 0.*'one'.*'all'",
    ),
    (lambda: beam(order=9), "order.*9"),
    (lambda: beam(director=(0, 0, 2)), r"director.*\[0.0, 0.0, 2.0\].*length 2"),
    (lambda: beam(director=Y), r"director.*\[0.0, 1.0, 0.0\] is parallel.*element 0"),
    (lambda: beam(director={"baem": Z}), "'baem'.*'beam'"),
    (lambda: beam(twist="a"), "twist.*'a'"),
    (lambda: beam(twist=lambda s: NAN), "twist.*not finite"),
    (lambda: beam(twist={"baem": 1.0}), "twist.*'baem'"),
    (lambda: beam(velocity=(1, 2)), r"beam.*velocity.*\(2,\).*\(3,\)"),
    (lambda: beam(velocity=(1, 2, NAN)), "velocity.*nan"),
    (lambda: beam(velocity=lambda x: x[0, 0]), r"velocity.*\(\)"),
    (lambda: beam(angular_velocity=np.ones((7, 3))), r"angular_velocity.*\(7, 3\)"),
    (lambda: LoadLine(beam(), X, part="web"), "'web'.*'beam'"),
)
def test_beams(call, text):
    with pytest.raises(InputError, match=text):
        call()


# ----------------------------------------------------------------------- bodies
@pytest.mark.one_quick
@cases(
    (lambda: MassPoint(0.0), "mass point.*mass = 0.0"),
    (lambda: MassPoint("heavy"), "mass = 'heavy'"),
    (lambda: MassPoint(1.0, (0, 0)), r"mass point.*position.*\(2,\)"),
    (lambda: MassPoint(1.0, (1j, 0, 2)), "position.*real numbers"),
    (lambda: MassPoint(1.0, velocity=(0, np.inf, 0)), "mass point.*velocity.*inf"),
    (lambda: MassPoint(1.0, on=HERE), "mass point.*attached.*ground"),
    (lambda: MassPoint(1.0, on=POINT), "mass point.*attached.*triad"),
    (lambda: MassPoint(1.0, on=BALL), "mass point.*on.*rigid body.*place.*body.at"),
    (lambda: RigidBody(np.inf, (1, 1, 1)), "rigid body.*mass = inf"),
    (lambda: RigidBody(1.0), "rigid body.*inertia.*euler"),
    (lambda: RigidBody(1.0, (1, 1, 1), euler=(1, 1, 1)), "rigid body.*inertia.*euler"),
    (lambda: RigidBody(1.0, (1, 1)), r"inertia.*\(2,\)"),
    (lambda: RigidBody(1.0, (1, 1, -1)), "inertia.*-1.0.*impossible"),
    (lambda: RigidBody(1.0, (1, 1, 2.5)), "inertia.*2.5.*impossible.*-0.25"),
    (lambda: RigidBody(1.0, euler=(1, -0.1, 1)), "euler.*-0.1.*impossible"),
    (lambda: RigidBody(1.0, 1e-9 * (np.eye(3) + np.eye(3, k=1) / 9)), "inertia.*symmetric"),
    (lambda: body(position=(1, 2)), r"rigid body.*position.*\(2,\)"),
    (lambda: body(center=(1, 2, NAN)), "center.*nan"),
    (lambda: body(velocity=(1, 2, 3, 4)), r"rigid body.*velocity.*\(4,\)"),
    (lambda: body(angular_velocity=(NAN, 0, 0)), "angular_velocity.*nan"),
    (lambda: body(triad=2 * np.eye(3)), "triad.*orthonormal.*error 3"),
    (lambda: body(triad=np.diag([1, 1, -1.0])), "triad.*right-handed"),
    (lambda: body(on=BALL), "rigid body.*on is the rigid body.*body.at"),
    (lambda: body(on=HERE), "rigid body.*ground"),
    (lambda: body(surface=([[0, 0]], [[0, 1, 2]])), r"surface.*\(1, 2\)"),
    (lambda: body(surface=(np.eye(3), [[0, 1, 7]])), "surface.*7"),
    (lambda: RigidBody.box(1.0, (0.1, -0.06, 1)), r"rigid body \(box\): edges\[1\] = -0.06"),
    (lambda: RigidBody.sphere(1.0, 0.0), "sphere.*radius = 0.0"),
    (lambda: RigidBody.cylinder(1.0, 1.0, -2.0), r"rigid body \(cylinder\): length = -2.0"),
    (lambda: RigidBody.cylinder(1.0, NAN, 1.0), "cylinder.*radius = nan"),
    (lambda: RigidBody.pyramid(1.0, -0.1, 1), "pyramid.*edge = -0.1"),
    (lambda: RigidBody.rod(1.0, 0.0), "rod.*length = 0.0"),
    (lambda: BALL.at((1, 2)), r"rigid body.*position.*\(2,\)"),
    (lambda: BALL.local((1, 2, NAN)), "rigid body.*X.*nan"),
    (lambda: ground((1, 2)), r"ground.*position.*\(2,\)"),
    (lambda: ground(X, lambda t: t), "ground.*motion.*Motion"),
    (lambda: sc.Motion((1, 0, 0)), r"motion.*displacement.*\(1, 0, 0\)"),
    (lambda: sc.Motion(rotation=3.0), "motion.*rotation.*3.0"),
    (lambda: sc.triad((0, 0, 0)), "triad.*d3.*zero"),
    (lambda: sc.triad(Z, 2 * Z), r"triad.*d1 = \[0.0, 0.0, 2.0\] is parallel"),
    (lambda: sc.triad(Z, (0, 1)), r"triad.*d1.*\(2,\)"),
)
def test_bodies_and_places(call, text):
    with pytest.raises(InputError, match=text):
        call()


# ----------------------------------------------------------------------- joints
@pytest.mark.one_quick
@cases(
    (lambda: JointSpherical(BALL, HERE), "spherical joint.*side a.*rigid body.*body.at"),
    (lambda: JointSpherical(HERE, None), "spherical joint.*side b.*None"),
    (lambda: JointSpherical(HERE, HERE), "spherical joint.*both sides are ground"),
    (lambda: JointFixed(PLACE, BALL.at(X)), "fixed joint.*both sides are rigid body"),
    (lambda: JointRevolute(HERE, POINT, X), "revolute joint.*side b.*mass point.*spherical"),
    (lambda: JointFixed(POINT, HERE), "fixed joint.*side a.*mass point"),
    (lambda: JointRevolute(HERE, PLACE, 2 * X), r"axis.*\[2.0, 0.0, 0.0\].*length 2"),
    (lambda: JointRevolute(HERE, PLACE, (NAN, 0, 0)), "revolute joint.*axis.*nan"),
    (lambda: JointDistance(HERE, POINT, length=-1.0), "length = -1.0"),
    (lambda: JointDistance(HERE, POINT), "distance joint.*length = 0.0"),
)
def test_joints(call, text):
    with pytest.raises(InputError, match=text):
        call()


def test_a_joint_between_names_of_one_node():
    """Meshes are welded where they meet."""
    frame = Beam(TWO, SECTION)
    ends = [frame.node(name) for name in ("one.end", "two.start")]
    refused(lambda: JointSpherical(*ends), "both sides are beam", "weld=False")


def test_a_distance_that_is_not_the_length():
    model = Model()
    ball = model.add("ball", MassPoint(1.0, (0, 0, 2.0)))
    model.add("rod", JointDistance(HERE, ball.place(), length=1.9))
    refused(model.freeze, "distance joint 'rod'", "1.9", "2 m", "0.1")


def arm_and_hand(**options):
    model = Model()
    arm = model.add("arm", body())
    model.add("hand", body(position=-Z, **options))
    model.add("shoulder", JointSpherical(HERE, arm.at((0, 0, 0))))
    model.add("gravity", LoadGravity((0, 0, -9.81)))
    return model


def test_a_forgotten_joint():
    """What hangs on nothing beside a mechanism; what may be meant to fly is left out."""
    with pytest.warns(sc.ModelWarning, match="rigid body 'hand' is at rest, on no") as caught:
        system = arm_and_hand().freeze()
    assert len(caught) == 1 and len(system.warnings) == 1
    assert "2 separate parts, 1 of them tied" in str(system)
    assert arm_and_hand(velocity=X).freeze().warnings == []  # thrown
    model = arm_and_hand()
    model.add("push", LoadForce(model["hand"].at(-Z), X))
    assert model.freeze().warnings == []
    model = arm_and_hand()
    elbow = -Z / 2
    model.add("muscle", sc.SpringDamper(model["arm"].at(0 * Z), model["hand"].at(elbow), 10.0))
    with pytest.warns(sc.ModelWarning, match="'hand' is held by spring 'muscle' alone, .* is miss"):
        model.freeze()
    model.add("elbow", JointSpherical(model["arm"].at(elbow), model["hand"].at(elbow)))
    assert str(model.freeze()).endswith("1 connected part, tied to the ground; 2 joints")
    crane = arm_and_hand()
    for k in range(3):  # as many hold what hangs on them
        crane.add(f"rope {k}", sc.Cable(ground((k, k % 2, 0.5)), crane["hand"].at(-Z), 9.0))
    assert crane.freeze().warnings == []


# ----------------------------------------------------------------------- names
def test_names_that_do_not_exist():
    """A similar name is asked for, long lists are cut."""
    refused(lambda: TWO.node("two.strat"), "in the mesh of beams 'one', 'two'", "did you mean 'two")
    for word, end in {"begin": "start", "first": "start", "last": "end", "stop": "end"}.items():
        refused(lambda word=word: TWO.node(f"two.{word}"), f"did you mean 'two.{end}'?")
    refused(lambda: TWO.node("xyz"), "known nodes: 'one.start', 'one.end', 'two.start'")
    model = Model()
    arm = model.add("arm", body())
    model.add("elbow", JointRevolute(HERE, arm.at((0, 0, 0)), axis=X))
    refused(lambda: model["elbo"], "did you mean 'elbow'?", "known: 'arm', 'elbow'")
    history = simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.1, 0.1)
    with pytest.raises(InputError, match="did you mean 'joint/elbow/angle'") as caught:
        history["joint/elbw/angle"]
    assert len(str(caught.value)) < 150 and str(caught.value).endswith("(all: list(history))")


def test_names():
    model = Model()
    ball = model.add("ball", MassPoint(1.0))
    refused(lambda: model.add("ball", MassPoint(1.0)), "duplicate", "'ball'", "mass point")
    refused(lambda: model.add("", MassPoint(1.0)), "name = ''")
    refused(lambda: model.add(3, MassPoint(1.0)), "name = 3")
    refused(lambda: Model().add("other", ball), "'other'", "already", "'ball'")
    refused(lambda: model.add("text", "ball"), "'text'", "str")
    refused(lambda: model.freeze().frame_place("bal"), "unknown name 'bal'", "'ball'")
    refused(Model().freeze, "model", "no beam, body or mass point")


OTHER, LOST = RigidBody.sphere(1.0, 1.0), beam()


@pytest.mark.one_quick
@cases(
    (lambda: JointSpherical(HERE, OTHER.at((0, 0, 0))), "spherical joint 'item'.*rigid body"),
    (lambda: LoadForce(OTHER.at((0, 0, 0)), X), "load 'item'"),
    (lambda: LoadLine(LOST, X), "load 'item'.*beam"),
    (lambda: MassPoint(1.0, on=LOST.node(0)), "mass point 'item'"),
    (
        lambda: JointSpherical(HERE, LOST.node(0)),
        r"side b, beam node 0 .*from \[0.0, 0.0, 0.0\] to \[0.0, 2.0, 0.0\]",
    ),
    (
        lambda: JointSpherical(Beam(TWO, SECTION).node("one.end"), HERE),
        "side a, beam node 'one.end'.*the mesh of 'one', 'two'",
    ),
)
def test_items_that_are_not_in_the_model(call, text):
    model = Model()
    model.add("ball", RigidBody.sphere(1.0, 1.0))
    model.add("item", call())
    with pytest.raises(InputError, match=f"{text}.*not in the model|not in the model.*{text}"):
        model.freeze()


# ----------------------------------------------------------------------- loads
@pytest.mark.one_quick
@cases(
    (lambda: LoadGravity(-9.81), r"gravity.*LoadGravity\(\(0, 0, -9.81\)\)"),
    (lambda: LoadGravity(("1", "2", "3")), "'1'.*real numbers"),
    (lambda: LoadForce(HERE, X), "load.*ground"),
    (lambda: LoadMoment(HERE, X), "load.*ground"),
    (lambda: LoadForce(BALL, X), "load.*rigid body.*place.*body.at"),
    (lambda: LoadForce(PLACE, (1, NAN, 0)), "load.*value.*nan"),
    (lambda: LoadForce(PLACE, lambda t: (1, 2)), r"load.*value\(0\).*\(2,\)"),
    (lambda: LoadForce(PLACE, lambda t: X, 2.0), "load.*amplitude"),
    (lambda: LoadForce(PLACE, X, NAN), "load.*amplitude = nan"),
    (lambda: LoadForce(PLACE, X, lambda t: (1, 2)), r"amplitude.*\(1, 2\).*t = 0.0"),
    (lambda: LoadMoment(POINT, X), "load.*mass point.*directions"),
    (lambda: LoadForce(POINT, X, follower=True), "load.*mass point"),
    (lambda: LoadLine(BALL, X), "load.*rigid body.*beam"),
    (lambda: LoadLine(beam(), (1, np.inf, 0)), "load.*value.*inf"),
    (lambda: sc.Table([0, 1], [0]), r"table.*\(2,\).*\(1,\)"),
    (lambda: sc.Table([0, 0], [0, 1]), r"table.*increase.*\[0.0, 0.0\]"),
    (lambda: sc.Table([], []), r"table.*\(0,\)"),
    (lambda: sc.RampLinear("0", 1), "begin.*'0'"),
    (lambda: sc.FunctionOfTime(3.0), "function of time.*3.0"),
    (lambda: sc.FunctionOfTime(np.sin, kinks=[NAN]), "function of time.*kinks.*nan"),
    (lambda: sc.FunctionOfTime(lambda t: NAN).value(0.5), "function of time.*nan.*0.5|0.5.*nan"),
)
def test_loads(call, text):
    with pytest.raises(InputError, match=text):
        call()


# ----------------------------------------------------------------------- starts
def freeze(**items):
    model = Model()
    for name, item in items.items():
        model.add(name, item)
    return model.freeze()


def driven(displacement=None, rotation=None, **options):
    ball = RigidBody.sphere(1.0, 1.0, **options)
    place = ground((0, 0, 0), sc.Motion(displacement, rotation))
    return freeze(ball=ball, drive=JointFixed(place, ball.at((0, 0, 0))))


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        ({"displacement": lambda t: (0.2, 0, 0)}, ["fixed joint 'drive'", "0.2", "not close"]),
        ({"rotation": lambda t: 0.2 * Z}, ["fixed joint 'drive'", "rotation", "contradicts"]),
        (
            {"displacement": lambda t: (NAN, 0, 0)},
            ["prescribed motion", "displacement(0.0)", "nan"],
        ),
        ({"displacement": lambda t: (0, 0)}, ["displacement(0.0)", "(2,)"]),
        ({"rotation": lambda t: 1.0}, ["prescribed motion", "rotation(0.0)", "()"]),
    ],
)
def test_motion_that_contradicts_the_initial_position(motion, words):
    refused(lambda: driven(**motion), *words)


@pytest.mark.parametrize("integrator", [sc.Variational(), sc.EnergyMomentum()])
@pytest.mark.parametrize("treatment", [sc.NullSpace(), sc.Multipliers()])
def test_motion_that_contradicts_the_initial_velocity(integrator, treatment):
    system = driven(lambda t: t * X / 2)
    words = "fixed joint 'drive'", "velocity", "0.5", "project"
    refused(lambda: simulate(system, integrator, treatment, 0.1, 1.0), *words)
    refused(lambda: next(sc.steps(system, integrator, treatment, 0.1)), *words)
    spin = driven(rotation=lambda t: t * Z / 4)
    refused(lambda: initial_state(spin), "fixed joint 'drive'", "0.25")
    right = driven(lambda t: t * X / 2, velocity=X / 2)
    assert initial_state(right).p[0] == pytest.approx(0.5)


def hooked(**options):
    ball = RigidBody.sphere(1.0, 1.0, **options)
    return freeze(ball=ball, hook=JointSpherical(HERE, ball.at((0, 0, 0))))


def test_velocities_that_joints_do_not_allow():
    system = hooked(velocity=(0, 0.7, 0))
    refused(lambda: initial_state(system), "spherical joint 'hook'", "0.7", "project")
    v = sc.project(system, system.q0, system.v0)
    assert abs(initial_state(system, v=v).p).max() < 1e-12


HOOKED = hooked()
ZERO, SHIFT = np.zeros(12), np.eye(12)[1]


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"q": ZERO[:5]}, ["q", "(5,)", "(12,)"]),
        ({"q": ZERO * NAN}, ["q", "not finite"]),
        ({"q": HOOKED.q0 + 0.3 * SHIFT}, ["0.3", "spherical joint 'hook'"]),
        ({"q": HOOKED.q0 + 0.1 * np.eye(12)[3]}, ["0.105", "triad", "'ball'"]),
        ({"v": ZERO[:3]}, ["v", "(3,)"]),
        ({"p": ZERO + NAN}, ["p", "not finite"]),
        ({"p": 0.4 * SHIFT}, ["p violates", "0.4", "Projection"]),
        ({"v": ZERO, "p": ZERO}, ["v or p"]),
        ({"time": NAN}, ["time", "nan"]),
    ],
)
def test_initial_states(given, words):
    refused(lambda: initial_state(HOOKED, **given), "initial state", *words)


# ----------------------------------------------------------------------- neither held nor with mass
ROD = RigidBody.rod(1.0, 2.0)
LOW, TOP = RigidBody.rod(1.0, 1.0, position=-Z), RigidBody.rod(1.0, 1.0)


def thin(*inertia):
    section = Section(np.ones(6), mass=1.0, inertia=inertia)
    return Beam(MESH, section, director=Z)


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("items", "text"),
    [
        ([ROD], r"rigid body '0'.*rotation about \[0.0, 0.0, 1.0\].*no inertia.*no joint holds"),
        ([ROD, JointSpherical(ground(Z), ROD.at(Z))], "rigid body '0'.*no inertia.*no joint"),
        ([ROD, JointDistance(ground(2 * Z), ROD.at(Z))], "no inertia"),
        ([ROD, JointRevolute(HERE, ROD.at((0, 0, 0)), axis=Z)], "rotation about.*no inertia"),
        ([RigidBody.rod(1.0, 2.0, triad=sc.triad((0, 0.6, 0.8)))], "rotation about.*no inertia"),
        ([LOW, TOP, JointFixed(LOW.at(-Z / 2), TOP.at(-Z / 2))], "no inertia"),
        ([thin(0, 0)], "beam '0'.*rotation about.*no inertia"),
        # turning about d1 moves d2, about d2 moves d1: one inertia leaves one of them without
        ([thin(1, 0)], "beam '0'.*rotation about.*no inertia"),
        ([thin(0, 1)], "beam '0'.*rotation about.*no inertia"),
        ([RigidBody(1.0, euler=(0, 0, 0))], "rigid body '0'.*no inertia"),
    ],
)
def test_what_may_turn_without_inertia_is_named(items, text):
    model = Model()
    for k, item in enumerate(deepcopy(items)):
        model.add(str(k), item)
    with pytest.raises(InputError, match=text):
        model.freeze()


@pytest.mark.parametrize("first", ["rod", "box"])
def test_a_free_rod_that_a_weld_holds(first):
    """Whichever of the two is the root of the tree."""
    rod, box = RigidBody.rod(1.0, 2.0), RigidBody.box(1.0, (1, 1, 1), position=1.5 * Z)
    items = {"rod": rod, "box": box} if first == "rod" else {"box": box, "rod": rod}
    assert freeze(**items, weld=JointFixed(rod.at(Z), box.at(Z))).unknowns == 6
    rod = RigidBody.rod(1.0, 2.0)
    assert freeze(rod=rod, hinge=JointRevolute(HERE, rod.at((0, 0, 0)), axis=X)).unknowns == 1


@pytest.mark.parametrize("hinge", [True, False])
def test_a_rod_that_a_loop_holds(hinge):
    """Hung by ball joints at both ends of a chain: a hinge in the middle holds the rod's spin."""
    rod, box = RigidBody.rod(1.0, 2.0), RigidBody.box(1.0, (1, 1, 1), position=X / 2 + Z)
    sides = rod.at(Z), box.at(Z)
    items = {
        "rod": rod,
        "box": box,
        "low": JointSpherical(ground(-Z), rod.at(-Z)),
        "far": JointSpherical(ground(X + Z), box.at(X + Z)),
        "mid": JointRevolute(*sides, axis=Y) if hinge else JointSpherical(*sides),
    }
    if hinge:
        assert freeze(**items).unknowns == 1
    else:
        refused(lambda: freeze(**items), "rigid body 'rod'", "[0.0, 0.0, 1.0]", "no inertia")


@pytest.mark.parametrize("kind", ["heavy", "hinged", "spins"])
def test_inertia_of_a_chain(kind):
    """A bar without inertia about its axis is held by a hinge, and spins on balls."""
    items, end = {}, HERE
    for k in range(12):
        inertia = (1.0, 1.0, 0.0 if kind != "heavy" and k == 7 else 0.1)
        items[f"bar {k}"] = bar = RigidBody(1.0, inertia, position=(k + 0.5) * Z)
        sides = end, bar.at(k * Z)
        held = kind == "hinged" and k == 7
        items[f"joint {k}"] = JointRevolute(*sides, X) if held else JointSpherical(*sides)
        end = bar.at((k + 1) * Z)
    if kind == "spins":
        refused(lambda: freeze(**items), "rigid body 'bar 7'", "rotation about", "no inertia")
    else:
        assert freeze(**items).unknowns == (34 if kind == "hinged" else 36)


@pytest.mark.parametrize("mass", [1e-3, 1e-14])
def test_a_light_body_on_a_heavy_one(mass):
    """Next to nothing is refused, however sound the body is by itself."""
    box, dust = RigidBody.box(1.0, (1, 1, 1)), RigidBody.box(mass, (1, 1, 1), position=X)
    items = {"dust": dust, "box": box, "ball": JointSpherical(dust.at(X / 2), box.at(X / 2))}
    if mass == 1e-3:
        assert freeze(**items).unknowns == 9
    else:
        refused(lambda: freeze(**items), "no inertia", "rotation about")


def test_a_hinge_behind_another_of_the_same_axis_needs_a_mass_between():
    """The rod between them spins alone: each pivot by itself is no measure."""
    rod, box = (RigidBody.rod(1.0, 1.0, position=Z / 2), RigidBody.box(1.0, (1, 1, 1)))
    low, high = JointRevolute(HERE, rod.at(0 * Z), axis=Z), JointRevolute(rod.at(Z), box.at(Z), Z)
    refused(lambda: freeze(rod=rod, box=box, low=low, high=high), "no inertia", "rotation about")


# ----------------------------------------------------------------------- loops and mobility
def test_a_model_that_cannot_move():
    """Welded, or welded twice."""
    for count, words in (
        (1, ["12 coordinates", "12 independent", "free a joint"]),
        (2, ["18 rows"]),
    ):
        door = RigidBody.box(1.0, (1, 2, 3))
        welds = {f"weld {k}": JointFixed(ground(k * X), door.at(k * X)) for k in range(count)}
        refused(lambda d=door, w=welds: freeze(door=d, **w), "mobility is zero", *words)


@pytest.mark.parametrize("last", [JointRevolute, JointSpherical])
def test_a_loop_that_cannot_close(last):
    """The last joint of the ring is named, with the gap that is left."""
    points = np.array([[0, 0, 0], [0, 1.0, 0], [2, 1.5, 0]])
    end, items = HERE, {}
    for k, name in enumerate("abc"):
        items[name] = bar = RigidBody.box(1.0, (0.2, 0.3, 0.4), position=points[k])
        items[f"pin {k}"] = JointRevolute(end, bar.at(points[k]), axis=Z)
        end = bar.at(points[(k + 1) % 3] if k < 2 else 2 * X)
    axis = {"axis": Z} if last is JointRevolute else {}
    items["last"] = last(end, ground((2.03, 0, 0.04)), **axis)
    words = f"{last.type} joint 'last'", "does not close", "0.05 m", "ground at [2.03, 0.0, 0.04]"
    refused(lambda: freeze(**items), *words)


def test_two_fixed_joints_between_the_same_bodies():
    a, b = RigidBody.sphere(1.0, 1.0), RigidBody.sphere(1.0, 1.0, position=X)
    one, two = (JointFixed(a.at(place), b.at(place)) for place in (X / 2, X / 2 + Y))
    system = freeze(a=a, b=b, one=one, two=two)
    assert system.counts() == {"n": 24, "m": 24, "rank": 18, "unknowns": 6}
    assert system.redundant.tolist() == list(range(18, 24))  # all of the second one


@pytest.mark.parametrize("seed", range(4))
def test_a_rod_beside_a_ball_joint(seed):
    """The distance to the centre of the ball joint cannot change: its row is round-off."""
    x, y, z = np.random.default_rng(seed).standard_normal((3, 3))
    ball = RigidBody.sphere(1.0, 1.0, position=z)
    hook, strut = JointSpherical(ground(x), ball.at(x)), JointDistance(ground(x), ball.at(y))
    system = freeze(ball=ball, hook=hook, strut=strut)
    assert system.counts() == {"n": 12, "m": 10, "rank": 9, "unknowns": 3}
    assert system.redundant.tolist() == [9]


# ----------------------------------------------------------------------- arguments of a run
SYSTEM = freeze(ball=MassPoint(1.0, velocity=X))
PAIR = (sc.Variational(), sc.NullSpace())


@pytest.mark.parametrize("bad", [0, 0.0, -0.1, NAN, np.inf, None, "fast", (0.1, 0.2)])
def test_step(bad):
    refused(lambda: simulate(SYSTEM, *PAIR, bad, 1.0), "step", repr(bad))
    refused(lambda: sc.Stepper(SYSTEM, *PAIR, bad), "step", repr(bad))
    refused(lambda: next(sc.steps(SYSTEM, *PAIR, bad)), "step", repr(bad))


@pytest.mark.parametrize("bad", [0, -1.0, NAN, np.inf, None, "long", b".1"])
def test_until(bad):
    refused(lambda: simulate(SYSTEM, *PAIR, 0.1, bad), "until", repr(bad))


def test_runs_before_time_zero():
    start = initial_state(SYSTEM, time=-1.0)
    assert simulate(SYSTEM, *PAIR, 0.25, 0.0, start=start).times[-1] == 0.0


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"every": 0}, ["every", "0"]),
        ({"every": 1.5}, ["every", "1.5"]),
        ({"at": [0.2, 7.0]}, ["at", "7.0", "outside"]),
        ({"at": [NAN]}, ["at", "nan"]),
        ({"at": "often"}, ["at", "'often'"]),
        ({"start": 3.0}, ["start", "3.0", "State"]),
        ({"start": sc.State(0.0, 0, ZERO, SYSTEM.v0)}, ["start", "q", "(12,)", "(3,)"]),
        ({"start": sc.State(0.0, 0, NAN * SYSTEM.q0, SYSTEM.v0)}, ["start", "q", "finite"]),
        ({"start": sc.State(5.0, 0, SYSTEM.q0, SYSTEM.v0)}, ["until", "1.0", "5.0"]),
        ({"callbacks": [3]}, ["callbacks", "3"]),
        ({"path": "a\0b"}, ["argument path", "zero"]),
    ],
)
def test_other_arguments_of_a_run(options, words):
    refused(lambda: simulate(SYSTEM, *PAIR, 0.1, 1.0, **options), *words)


@pytest.mark.parametrize(
    ("pair", "words"),
    [
        (PAIR[::-1], ["integrator, treatment", "swapped", "the integrator first"]),
        ((sc.Variational, PAIR[1]), ["argument integrator", "Variational()"]),
        ((PAIR[0], sc.NullSpace), ["argument treatment", "the class", "NullSpace()"]),
        ((PAIR[0], "null"), ["argument treatment", "NullSpace() or Multipliers()"]),
        (("variational", PAIR[1]), ["integrator", "variational"]),
    ],
)
def test_methods_of_a_run(pair, words):
    refused(lambda: simulate(SYSTEM, *pair, 0.1, 1.0), *words)
    refused(lambda: simulate(None, *PAIR, 0.1, 1.0), "system", "NoneType", "Model")


def test_a_folder_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("not a folder")
    seen = []
    options = {"path": tmp_path / "file" / "run.h", "callbacks": [seen.append]}
    refused(lambda: simulate(SYSTEM, *PAIR, 0.1, 1.0, **options), "run.h")
    assert not seen  # before the first step


@pytest.mark.parametrize("kind", [sc.MeshError, sc.HistoryError, sc.IncompatibleError])
def test_all_errors_are_ours_and_value_errors(kind):
    assert issubclass(kind, sc.CosseratError) and issubclass(kind, ValueError)
    error = kind("beam 'a'", "is odd")
    assert (error.item, str(error)) == ("beam 'a'", "beam 'a': is odd")


@pytest.mark.one_quick
@cases(
    (lambda: sc.read_mesh(5), "argument path.*5"),
    (lambda: sc.History.load("a\0b"), "argument path.*zero"),
    (lambda: sc.write_mesh("x.msh", 5), "argument mesh.*5.*MeshCurve"),
    (lambda: SYSTEM.extend(np.zeros(99), 0.0), r"argument q.*\(99,\)"),
    (lambda: initial_state(SYSTEM, rates={"j": "1"}), "argument rates.*'1'"),
    (lambda: initial_state(SYSTEM, tolerance=True), "tolerance.*True"),
)
def test_what_is_no_name_of_a_file_no_number_and_no_mesh(call, text):
    with pytest.raises(InputError, match=text):
        call()
