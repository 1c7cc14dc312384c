"""Each bad input gets one clear error before the first step, naming the item and the value."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from helpers_scenes import four_bar

import skfem_cosserat as sc
from skfem_cosserat import (
    Beam,
    EnergyMomentum,
    FunctionOfTime,
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
    Material,
    MeshCurve,
    MeshError,
    Model,
    Motion,
    Multipliers,
    NullSpace,
    RigidBody,
    Section,
    SectionCircle,
    SectionRectangle,
    SectionTube,
    State,
    Stepper,
    Table,
    Variational,
    ground,
    initial_state,
    project,
    simulate,
    steps,
    triad,
)

NAN, INF = float("nan"), float("inf")
MATERIAL = Material(1.0, 0.3, 1.0)
SECTION = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
MESH = MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4, nodes={"mid": 0.5})
TWO = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="one").joined(
    MeshCurve.init_line((1, 0, 0), (1, 1, 0), 2, name="two")
)
BALL = RigidBody.sphere(1.0, 1.0)
POINT = MassPoint(1.0)


def beam(**options):
    return Beam(MESH, SECTION, **options)


def body(**options):
    return RigidBody(1.0, (1, 1, 1), **options)


def refused(call, words, kind=InputError):
    """One error of our own whose message has all the words."""
    with pytest.raises(kind) as caught:
        call()
    text = str(caught.value)
    missing = [word for word in words if word not in text]
    assert not missing, f"{missing} not in {text!r}"
    assert isinstance(caught.value, ValueError)


def cases(*rows):
    return pytest.mark.parametrize(
        ("call", "words"),
        [pytest.param(call, words, id=str(k)) for k, (call, words) in enumerate(rows)],
    )


# ----------------------------------------------------------------------- sections
@pytest.mark.one_quick
@cases(
    (lambda: Material(NAN, 0.3, 1.0), ["material", "E = nan"]),
    (lambda: Material(-1.0, 0.3, 1.0), ["material", "E = -1.0"]),
    (lambda: Material(1.0, 0.3, 0.0), ["material", "rho = 0.0"]),
    (lambda: Material(1.0, 0.6, 1.0), ["material", "nu = 0.6"]),
    (lambda: Material(1.0, NAN, 1.0), ["material", "nu = nan"]),
    (lambda: Material((1.0, 2.0), 0.3, 1.0), ["material", "E = (1.0, 2.0)"]),
    (lambda: Material(None, 0.3, 1.0), ["material", "E = None"]),
    (lambda: SectionRectangle(0.0, 1.0, MATERIAL), ["rectangle", "a = 0.0"]),
    (lambda: SectionRectangle(1.0, INF, MATERIAL), ["rectangle", "b = inf"]),
    (lambda: SectionRectangle(1.0, 1.0, MATERIAL, -0.5), ["rectangle", "shear_factor = -0.5"]),
    (lambda: SectionRectangle(1.0, 1.0, 210e9), ["rectangle", "material", "210000000000.0"]),
    (lambda: SectionTube(1.0, 2.0, MATERIAL), ["tube", "inner = 2.0", "outer = 1.0"]),
    (lambda: SectionTube(1.0, NAN, MATERIAL), ["tube", "inner = nan"]),
    (lambda: SectionTube(1.0, 0.5, None), ["tube", "material", "None"]),
    (lambda: SectionCircle(-0.01, MATERIAL), ["circle: radius = -0.01, expected a positive"]),
    (lambda: SectionCircle(1.0, MATERIAL, -1.0), ["circle", "shear_factor = -1.0"]),
    (lambda: SectionCircle(1.0, None), ["circle", "material", "None"]),
    (lambda: SectionCircle(-1.0, MATERIAL), ["-1.0"]),
    (lambda: Section(np.ones(5), 1.0, (1, 1)), ["section", "stiffness", "(5,)", "(6, 6)"]),
    (lambda: Section(np.full(6, NAN), 1.0, (1, 1)), ["section", "stiffness", "nan"]),
    (lambda: Section([1, 1, 0, 1, 1, 1], 1.0, (1, 1)), ["section", "EA = 0", "stiffness"]),
    (lambda: Section([1, 1, 1, 1, -3, 1], 1.0, (1, 1)), ["section", "EI_2 = -3"]),
    (lambda: Section(np.ones((6, 6)), 1.0, (1, 1)), ["section", "not positive definite"]),
    (lambda: Section(np.eye(6) + np.eye(6, k=1) / 9, 1.0, (1, 1)), ["not symmetric", "0.111"]),
    (lambda: Section(np.ones(6), -1.0, (1, 1)), ["section", "mass = -1.0"]),
    (lambda: Section(np.ones(6), NAN, (1, 1)), ["section", "mass = nan"]),
    (lambda: Section(np.ones(6), [1, 2], (1, 1)), ["section", "mass = [1, 2]"]),
    (lambda: Section(np.ones(6), 1.0, (1, -1)), ["section", "inertia = [1.0, -1.0]"]),
    (lambda: Section(np.ones(6), 1.0, (1, NAN)), ["section", "inertia", "nan"]),
    (lambda: Section(np.ones(6), 1.0, (1, 1, 1)), ["section", "inertia", "(3,)", "(2,)"]),
    (lambda: Section(np.ones(6), 1.0, (1, 1), [1, 2]), ["section", "outline", "(2,)"]),
    (lambda: Section(np.ones(6), 1.0, (1, 1), [[1, NAN]]), ["section", "outline", "nan"]),
    (lambda: Section(["a"] * 6, 1.0, (1, 1)), ["section", "stiffness", "'a'"]),
    (
        lambda: Section.from_constants(EA=1.0, GA=1.0, EI=(1.0,), GJ=1.0, mass=1.0, inertia=(1, 1)),
        ["section", "EI = (1.0,)"],
    ),
    (
        lambda: Section.from_constants(
            EA=1.0, GA=(1.0, 2.0, 3.0), EI=(1.0, 1.0), GJ=1.0, mass=1.0, inertia=(1, 1)
        ),
        ["section", "GA = (1.0, 2.0, 3.0)"],
    ),
)
def test_sections(call, words):
    refused(call, words)


# ----------------------------------------------------------------------- beams and meshes
@pytest.mark.one_quick
@cases(
    (lambda: Beam(None, SECTION), ["beam", "NoneType", "MeshCurve"]),
    (lambda: Beam(MESH, None), ["beam", "section = None"]),
    (lambda: Beam(MESH, {}), ["beam", "section = {}"]),
    (lambda: Beam(MESH, {"beam": 3.0}), ["beam", "part 'beam'", "3.0"]),
    (lambda: Beam(TWO, {"one": SECTION}), ["beam", "2 of 4 elements", "element 2", "one"]),
    (lambda: Beam(TWO, {"one": SECTION, "tow": SECTION}), ["'tow'", "'two'"]),
    (
        lambda: Beam(TWO.with_beams({"all": [0, 1, 2, 3]}), {"one": SECTION, "all": SECTION}),
        ["beam", "element 0", "'one'", "'all'"],
    ),
    (lambda: beam(order=0), ["order", "0"]),
    (lambda: beam(order=5), ["order", "5"]),
    (lambda: beam(order=1.5), ["order", "1.5"]),
    (lambda: beam(director=(0, 0, 2)), ["director", "[0.0, 0.0, 2.0]", "length 2"]),
    (lambda: beam(director=(0, 0, NAN)), ["director", "nan"]),
    (lambda: beam(director=(0, 1)), ["director", "(2,)"]),
    (lambda: beam(director=(0, 1, 0)), ["director", "parallel", "[0.0, 1.0, 0.0]", "element 0"]),
    (lambda: beam(director={"baem": (0, 0, 1)}), ["director", "'baem'", "'beam'"]),
    (lambda: beam(twist=NAN), ["twist", "nan"]),
    (lambda: beam(twist="a"), ["twist", "'a'"]),
    (lambda: beam(twist=lambda s: NAN), ["twist", "not finite"]),
    (lambda: beam(twist={"baem": 1.0}), ["twist", "'baem'"]),
    (lambda: beam(velocity=(1, 2)), ["beam", "velocity", "(2,)", "(3,)"]),
    (lambda: beam(velocity=(1, 2, NAN)), ["beam", "velocity", "nan"]),
    (lambda: beam(velocity=lambda x: x[0, 0]), ["beam", "velocity", "()"]),
    (lambda: beam(velocity="fast"), ["beam", "velocity", "'fast'"]),
    (lambda: beam(angular_velocity=np.ones((7, 3))), ["beam", "angular_velocity", "(7, 3)"]),
    (lambda: beam().node("midd"), ["'midd'", "'mid'"]),
    (lambda: beam().node(17), ["17", "0 .. 4"]),
    (lambda: beam().node((0, 0.3, 0)), ["[0.0, 0.3, 0.0]", "nearest"]),
    (lambda: LoadLine(beam(), (1, 0, 0), part="web"), ["'web'", "'beam'"]),
    (lambda: MeshCurve(np.array([[0, 0.0]] * 3), [[0], [1]]), ["element 0", "zero length"]),
    (lambda: MeshCurve.init_line((0, 0, 0), (0, 0, 0), 2), ["line", "same point"]),
    (lambda: MeshCurve.init_points([(0, 0, 0), (0, 0, 0), (1, 0, 0)]), ["0"]),
    (lambda: MeshCurve.init_line((0, 0, NAN), (0, 0, 1), 2), ["line start", "nan"]),
    (lambda: MeshCurve.init_line((0, 0, 0), (0, 0, 1), 0), ["'beam'", "0"]),
    (lambda: MeshCurve(np.eye(3), np.zeros((2, 0), dtype=int)), ["mesh", "no elements"]),
)
def test_beams_and_their_meshes(call, words):
    refused(call, words)


def test_a_mesh_of_other_cells_is_no_beam():
    import skfem

    refused(lambda: Beam(skfem.MeshTri(), SECTION), ["beam", "MeshTri1", "MeshCurve"])


# ----------------------------------------------------------------------- bodies
@pytest.mark.one_quick
@cases(
    (lambda: MassPoint(0.0), ["mass point", "mass = 0.0"]),
    (lambda: MassPoint(-1.0), ["mass point", "mass = -1.0"]),
    (lambda: MassPoint(NAN), ["mass point", "mass = nan"]),
    (lambda: MassPoint("heavy"), ["mass point", "mass = 'heavy'"]),
    (lambda: MassPoint([1.0, 2.0]), ["mass point", "mass = [1.0, 2.0]"]),
    (lambda: MassPoint(1.0, (0, 0)), ["mass point", "position", "(2,)"]),
    (lambda: MassPoint(1.0, (0, 0, NAN)), ["mass point", "position", "nan"]),
    (lambda: MassPoint(1.0, velocity=(0, INF, 0)), ["mass point", "velocity", "inf"]),
    (lambda: MassPoint(1.0, on=ground((0, 0, 0))), ["mass point", "attached", "ground"]),
    (lambda: MassPoint(1.0, on=POINT.place()), ["mass point", "attached", "triad"]),
    (lambda: MassPoint(1.0, on=BALL), ["mass point", "on", "rigid body", "place", "body.at"]),
    (lambda: RigidBody(INF, (1, 1, 1)), ["rigid body", "mass = inf"]),
    (lambda: RigidBody(1.0), ["rigid body", "inertia", "euler"]),
    (lambda: RigidBody(1.0, (1, 1, 1), euler=(1, 1, 1)), ["rigid body", "inertia", "euler"]),
    (lambda: RigidBody(1.0, (1, 1)), ["rigid body", "inertia", "(2,)"]),
    (lambda: RigidBody(1.0, (1, 1, NAN)), ["rigid body", "inertia", "nan"]),
    (lambda: RigidBody(1.0, (1, 1, -1)), ["rigid body", "inertia", "-1.0", "impossible"]),
    (lambda: RigidBody(1.0, (1, 1, 2.5)), ["rigid body", "inertia", "2.5", "impossible", "-0.25"]),
    (lambda: RigidBody(1.0, euler=(1, -0.1, 1)), ["rigid body", "euler", "-0.1", "impossible"]),
    (
        lambda: RigidBody(1.0, [[1, 0.1, 0], [0.2, 1, 0], [0, 0, 1]]),
        ["rigid body", "inertia", "symmetric", "0.1"],
    ),
    (
        lambda: RigidBody(1.0, 1e-9 * np.array([[1, 0.1, 0], [0.2, 1, 0], [0, 0, 1]])),
        ["rigid body", "inertia", "symmetric"],
    ),
    (lambda: body(position=(1, 2)), ["rigid body", "position", "(2,)"]),
    (lambda: body(center=(1, 2, NAN)), ["rigid body", "center", "nan"]),
    (lambda: body(center="x"), ["rigid body", "center", "'x'"]),
    (lambda: body(velocity=(1, 2, 3, 4)), ["rigid body", "velocity", "(4,)"]),
    (lambda: body(angular_velocity=(NAN, 0, 0)), ["rigid body", "angular_velocity", "nan"]),
    (lambda: body(triad=np.eye(2)), ["rigid body", "triad", "(2, 2)"]),
    (lambda: body(triad=2 * np.eye(3)), ["rigid body", "triad", "orthonormal", "error 3"]),
    (lambda: body(triad=np.diag([1, 1, -1.0])), ["rigid body", "triad", "right-handed"]),
    (lambda: body(triad=np.full((3, 3), NAN)), ["rigid body", "triad", "nan"]),
    (lambda: body(on=BALL), ["rigid body", "on is the rigid body", "body.at"]),
    (lambda: body(on=ground((0, 0, 0))), ["rigid body", "ground"]),
    (lambda: body(surface=([[0, 0]], [[0, 1, 2]])), ["rigid body", "surface", "(1, 2)"]),
    (lambda: body(surface=(np.eye(3), [[0, 1, 7]])), ["rigid body", "surface", "7"]),
    (lambda: RigidBody.box(1.0, (1, 2)), ["rigid body", "box", "(2,)"]),
    (lambda: RigidBody.box(1.0, (1, 2, -3)), ["rigid body", "box", "-3"]),
    (lambda: RigidBody.box(-1.0, (1, 2, 3)), ["rigid body", "mass = -1.0"]),
    (lambda: RigidBody.sphere(1.0, 0.0), ["rigid body", "sphere", "radius", "0.0"]),
    (lambda: RigidBody.sphere(1.0, (1, 2)), ["rigid body", "sphere", "radius", "(1, 2)"]),
    (lambda: RigidBody.box(1.0, (0.1, -0.06, 1)), ["rigid body (box)", "edges[1] = -0.06"]),
    (lambda: RigidBody.cylinder(1.0, 1.0, -2.0), ["rigid body (cylinder): length = -2.0"]),
    (lambda: RigidBody.sphere(NAN, 1.0), ["rigid body", "mass = nan"]),
    (lambda: RigidBody.cylinder(1.0, 0.1, NAN), ["rigid body", "cylinder", "length", "nan"]),
    (lambda: RigidBody.pyramid(1.0, -0.1, 1), ["rigid body", "pyramid", "edge", "-0.1"]),
    (lambda: RigidBody.rod(1.0, 0.0), ["rigid body", "rod", "length", "0.0"]),
    (lambda: BALL.at((1, 2)), ["rigid body", "position", "(2,)"]),
    (lambda: BALL.local((1, 2, NAN)), ["rigid body", "X", "nan"]),
    (lambda: ground((1, 2)), ["ground", "position", "(2,)"]),
    (lambda: ground((1, 2, NAN)), ["ground", "position", "nan"]),
    (lambda: ground((1, 2, 3), lambda t: t), ["ground", "motion", "Motion"]),
    (lambda: Motion((1, 0, 0)), ["motion", "displacement", "(1, 0, 0)"]),
    (lambda: Motion(rotation=3.0), ["motion", "rotation", "3.0"]),
    (lambda: triad((0, 0, 0)), ["triad", "d3", "zero"]),
    (lambda: triad((0, 0, 1), (0, 0, 2)), ["triad", "d1", "parallel", "[0.0, 0.0, 2.0]"]),
    (lambda: triad((0, NAN, 1)), ["triad", "d3", "nan"]),
    (lambda: triad((0, 0, 1), (0, 1)), ["triad", "d1", "(2,)"]),
)
def test_bodies_and_places(call, words):
    refused(call, words)


# ----------------------------------------------------------------------- joints
HERE = ground((0, 0, 0))


@pytest.mark.one_quick
@cases(
    (lambda: JointSpherical(BALL, HERE), ["spherical joint", "side a", "rigid body", "body.at"]),
    (lambda: JointSpherical(HERE, None), ["spherical joint", "side b", "None"]),
    (lambda: JointSpherical(HERE, HERE), ["spherical joint", "both sides are ground"]),
    (
        lambda: JointFixed(BALL.at((0, 0, 0)), BALL.at((1, 0, 0))),
        ["fixed joint", "both sides are rigid body"],
    ),
    (
        lambda: JointRevolute(HERE, POINT.place(), axis=(1, 0, 0)),
        ["revolute joint", "side b", "mass point", "spherical"],
    ),
    (lambda: JointFixed(POINT.place(), HERE), ["fixed joint", "side a", "mass point"]),
    (
        lambda: JointRevolute(HERE, BALL.at((0, 0, 0)), axis=(2, 0, 0)),
        ["revolute joint", "axis", "[2.0, 0.0, 0.0]", "length 2"],
    ),
    (
        lambda: JointRevolute(HERE, BALL.at((0, 0, 0)), axis=(0, 0, 0)),
        ["revolute joint", "axis", "length 0"],
    ),
    (
        lambda: JointRevolute(HERE, BALL.at((0, 0, 0)), axis=(NAN, 0, 0)),
        ["revolute joint", "axis", "nan"],
    ),
    (
        lambda: JointRevolute(HERE, BALL.at((0, 0, 0)), axis=(1, 0)),
        ["revolute joint", "axis", "(2,)"],
    ),
    (
        lambda: JointDistance(HERE, POINT.place(), length="long"),
        ["distance joint", "length = 'long'"],
    ),
    (lambda: JointDistance(HERE, POINT.place(), length=-1.0), ["distance joint", "length = -1.0"]),
    (lambda: JointDistance(HERE, POINT.place(), length=NAN), ["distance joint", "length = nan"]),
    (lambda: JointDistance(HERE, POINT.place()), ["distance joint", "length = 0.0"]),
)
def test_joints(call, words):
    refused(call, words)


def test_a_joint_between_names_of_one_node():
    """Meshes are welded where they meet."""
    frame = Beam(TWO, SECTION)
    ends = [frame.node(name) for name in ("one.end", "two.start")]
    refused(lambda: JointSpherical(*ends), ["both sides are beam", "weld=False"])


def arm_and_hand(**options):
    model = Model()
    arm = model.add("arm", body())
    model.add("hand", body(position=(0, 0, -1), **options))
    model.add("shoulder", JointSpherical(HERE, arm.at((0, 0, 0))))
    model.add("gravity", LoadGravity((0, 0, -9.81)))
    return model


def test_a_forgotten_joint():
    """What hangs on nothing beside a mechanism; what may be meant to fly is left out."""
    with pytest.warns(sc.ModelWarning, match="rigid body 'hand' is at rest, on no") as caught:
        system = arm_and_hand().freeze()
    assert len(caught) == 1 and len(system.warnings) == 1
    assert "2 separate parts, 1 of them tied" in str(system) and "; 1 joint" in str(system)
    assert "separate parts" not in repr(system)
    system = arm_and_hand(velocity=(1, 0, 0)).freeze()  # thrown
    assert system.warnings == [] and "2 separate parts" in str(system)
    model = arm_and_hand()
    model.add("push", LoadForce(model["hand"].at((0, 0, -1)), (1, 0, 0)))
    assert model.freeze().warnings == []
    model = arm_and_hand()
    ends = [model[name].at(model[name].position) for name in ("arm", "hand")]
    ends[1] = model["hand"].at((0, 0, -0.5))
    model.add("muscle", sc.SpringDamper(*ends, 10.0))
    with pytest.warns(sc.ModelWarning, match="'hand' is held by spring 'muscle' alone, .* is miss"):
        assert str(model.freeze()).endswith("1 connected part, tied to the ground; 1 joint")
    model.add("elbow", JointSpherical(*(model[name].at((0, 0, -0.5)) for name in ("arm", "hand"))))
    assert model.freeze().warnings == []
    crane = arm_and_hand()
    for k in range(3):  # as many hold what hangs on them
        shift = np.array((k, k % 2, 0.5))
        crane.add(f"rope {k}", sc.Cable(sc.ground(shift), crane["hand"].at((0, 0, -1)), 9.0))
    assert crane.freeze().warnings == []
    free = Model()
    for k in range(2):
        free.add(f"ball {k}", body(position=(k, 0, 0)))
    assert str(free.freeze()).endswith(
        "2 separate parts, none of them tied to the ground; no joints"
    )


def test_names_that_do_not_exist():
    """A similar name is asked for, long lists are cut."""
    words = ["node 'two.strat'", "in the mesh of beams 'one', 'two'", "did you mean 'two.start'?"]
    refused(lambda: TWO.node("two.strat"), words)
    for word, end in {"begin": "start", "first": "start", "last": "end", "stop": "end"}.items():
        refused(lambda word=word: TWO.node(f"two.{word}"), [f"did you mean 'two.{end}'?"])
    refused(
        lambda: TWO.node("two.tip"), ["'one', 'two'; known nodes: 'one.start'"]
    )  # none is like it
    refused(lambda: TWO.node("xyz"), ["known nodes: 'one.start', 'one.end', 'two.start'"])
    model = Model()
    arm = model.add("arm", body())
    model.add("elbow", JointRevolute(HERE, arm.at((0, 0, 0)), axis=(1, 0, 0)))
    refused(lambda: model["elbo"], ["did you mean 'elbow'?", "known: 'arm', 'elbow'"])
    history = simulate(model, EnergyMomentum(), NullSpace(), 0.1, 0.1)
    with pytest.raises(InputError, match="did you mean 'joint/elbow/angle'") as caught:
        history["joint/elbw/angle"]
    assert len(str(caught.value)) < 150 and str(caught.value).endswith("(all: list(history))")
    with pytest.raises(InputError, match=r"recorded: 't', .*, \.\.\. \(all: list\(history\)\)$"):
        history["zzzzz"]


def test_methods_of_a_run():
    model = Model()
    model.add("ball", MassPoint(1.0))
    one, two = EnergyMomentum(), NullSpace()
    run = partial(simulate, model, step=0.1, until=0.1)
    refused(lambda: run(two, one), ["integrator, treatment", "swapped", "the integrator first"])
    refused(lambda: run(EnergyMomentum, two), ["argument integrator", "EnergyMomentum()"])
    refused(lambda: run(one, NullSpace), ["argument treatment", "the class", "NullSpace()"])
    refused(lambda: run(one, "null"), ["argument treatment", "NullSpace() or Multipliers()"])


# ----------------------------------------------------------------------- loads
@pytest.mark.one_quick
@cases(
    (lambda: LoadGravity(-9.81), ["gravity", "LoadGravity((0, 0, -9.81))"]),
    (lambda: LoadForce(HERE, (1, 0, 0)), ["load", "ground"]),
    (lambda: LoadMoment(HERE, (1, 0, 0)), ["load", "ground"]),
    (lambda: LoadForce(BALL, (1, 0, 0)), ["load", "rigid body", "place", "body.at"]),
    (lambda: LoadForce(BALL.at((0, 0, 0)), (1, 0)), ["load", "value", "(2,)"]),
    (lambda: LoadForce(BALL.at((0, 0, 0)), (1, NAN, 0)), ["load", "value", "nan"]),
    (lambda: LoadForce(BALL.at((0, 0, 0)), "up"), ["load", "value", "'up'"]),
    (lambda: LoadForce(BALL.at((0, 0, 0)), lambda t: (1, 2)), ["load", "value(0)", "(2,)"]),
    (lambda: LoadForce(BALL.at((0, 0, 0)), lambda t: NAN), ["load", "value(0)", "()"]),
    (
        lambda: LoadForce(BALL.at((0, 0, 0)), lambda t: (1, 2, 3), 2.0),
        ["load", "amplitude"],
    ),
    (lambda: LoadForce(BALL.at((0, 0, 0)), (1, 0, 0), NAN), ["load", "amplitude = nan"]),
    (lambda: LoadForce(BALL.at((0, 0, 0)), (1, 0, 0), "ramp"), ["load", "amplitude = 'ramp'"]),
    (
        lambda: LoadForce(BALL.at((0, 0, 0)), (1, 0, 0), lambda t: (1, 2)),
        ["amplitude", "(1, 2)", "t = 0.0"],
    ),
    (lambda: LoadMoment(POINT.place(), (1, 0, 0)), ["load", "mass point", "directions"]),
    (lambda: LoadForce(POINT.place(), (1, 0, 0), follower=True), ["load", "mass point"]),
    (lambda: LoadLine(BALL, (1, 0, 0)), ["load", "rigid body", "beam"]),
    (lambda: LoadLine(beam(), (1, INF, 0)), ["load", "value", "inf"]),
    (lambda: LoadGravity((0, 0)), ["load", "value", "(2,)"]),
    (lambda: Table([0, 1], [0]), ["table", "(2,)", "(1,)"]),
    (lambda: Table([0, 0], [0, 1]), ["table", "increase", "[0.0, 0.0]"]),
    (lambda: Table([0, NAN], [0, 1]), ["table", "nan"]),
    (lambda: Table([], []), ["table", "(0,)"]),
    (lambda: FunctionOfTime(3.0), ["function of time", "3.0"]),
    (lambda: FunctionOfTime(np.sin, kinks=[NAN]), ["function of time", "kinks", "nan"]),
    (lambda: FunctionOfTime(lambda t: NAN).value(0.5), ["function of time", "nan", "0.5"]),
)
def test_loads(call, words):
    refused(call, words)


# ----------------------------------------------------------------------- models
def model_of(**items):
    model = Model()
    for name, item in items.items():
        model.add(name, item)
    return model


def freeze(**items):
    return model_of(**items).freeze()


def test_names():
    model = model_of(ball=MassPoint(1.0))
    refused(lambda: model.add("ball", MassPoint(1.0)), ["duplicate", "'ball'", "mass point"])
    refused(lambda: model.add("", MassPoint(1.0)), ["name = ''"])
    refused(lambda: model.add(3, MassPoint(1.0)), ["name = 3"])
    refused(lambda: model.add("other", model["ball"]), ["'other'", "already", "'ball'"])
    refused(lambda: Model().add("other", model["ball"]), ["'other'", "already", "'ball'"])
    refused(lambda: model.add("text", "ball"), ["'text'", "str"])
    refused(lambda: model["bal"], ["unknown name 'bal'", "'ball'"])
    refused(lambda: model.freeze().frame_place("bal"), ["unknown name 'bal'", "'ball'"])
    refused(lambda: Model().freeze(), ["model", "no beam, body or mass point"])


def test_items_that_are_not_in_the_model():
    def outside(item):
        return lambda: freeze(ball=RigidBody.sphere(1.0, 1.0), item=item)

    other = RigidBody.sphere(1.0, 1.0)
    lost = beam()
    refused(
        outside(JointSpherical(HERE, other.at((0, 0, 0)))),
        ["spherical joint 'item'", "rigid body", "not in the model"],
    )
    refused(outside(LoadForce(other.at((0, 0, 0)), (1, 0, 0))), ["load 'item'", "not in the model"])
    refused(outside(LoadLine(lost, (1, 0, 0))), ["load 'item'", "beam", "not in the model"])
    refused(outside(MassPoint(1.0, on=lost.node(0))), ["mass point 'item'", "not in the model"])
    refused(
        outside(JointSpherical(HERE, lost.node(0))),
        ["side b, beam node 0 at [0.0, 0.0, 0.0]", "from [0.0, 0.0, 0.0] to [0.0, 2.0, 0.0]"],
    )
    named = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="boom")
    boom = Beam(named, SECTION)
    joint = outside(JointSpherical(boom.node("boom.end"), ground((1, 0, 0))))
    refused(joint, ["side a, beam node 'boom.end'", "the mesh of 'boom'", "model: add it"])
    with pytest.raises(InputError) as caught:
        joint()
    assert "first" not in str(caught.value)
    mine = RigidBody.sphere(1.0, 1.0)
    model_of(theirs=mine)
    refused(
        outside(LoadForce(mine.at((0, 0, 0)), (1, 0, 0))),
        ["load 'item'", "rigid body 'theirs'", "not in the model"],
    )


@pytest.mark.parametrize("kind", [JointSpherical, JointRevolute, JointFixed])
def test_joints_that_do_not_close_say_by_how_much(kind):
    ball = RigidBody.sphere(1.0, 1.0)
    options = {"axis": (1, 0, 0)} if kind is JointRevolute else {}
    joint = kind(ground((0, 0, 0.03)), ball.at((0, 0.04, 0)), **options)
    refused(
        lambda: freeze(ball=ball, hinge=joint),
        ["joint 'hinge'", "does not close", "0.05 m", "[0.0, 0.04, -0.03]"],
    )


def test_a_distance_that_is_not_the_length():
    ball = MassPoint(1.0, (0, 0, 2.0))
    refused(
        lambda: freeze(ball=ball, rod=JointDistance(HERE, ball.place(), length=1.9)),
        ["distance joint 'rod'", "1.9", "2 m", "0.1"],
    )


# ----------------------------------------------------------------------- prescribed motion
def driven(displacement=None, rotation=None, kind=JointFixed, **options):
    ball = RigidBody.sphere(1.0, 1.0, **options)
    motion = Motion(displacement, rotation)
    return freeze(ball=ball, drive=kind(ground((0, 0, 0), motion), ball.at((0, 0, 0))))


def test_motion_that_contradicts_the_initial_position():
    words = ["fixed joint 'drive'", "t = 0", "0.2"]
    refused(lambda: driven(lambda t: (0.2, 0, 0)), [*words, "does not close"])
    refused(lambda: driven(rotation=lambda t: (0, 0, 0.2)), [*words[:2], "rotation", "contradicts"])


def test_motion_that_contradicts_the_initial_velocity():
    system = driven(lambda t: (0.5 * t, 0, 0))
    words = ["fixed joint 'drive'", "velocity", "0.5", "project"]
    refused(lambda: initial_state(system), words)
    for integrator in (Variational(), EnergyMomentum()):
        for treatment in (NullSpace(), Multipliers()):
            refused(lambda i=integrator, t=treatment: simulate(system, i, t, 0.1, 1.0), words)
            refused(lambda i=integrator, t=treatment: next(steps(system, i, t, 0.1)), words)
    spin = driven(rotation=lambda t: (0, 0, 0.25 * t))
    refused(lambda: initial_state(spin), ["fixed joint 'drive'", "0.25"])
    right = driven(lambda t: (0.5 * t, 0, 0), velocity=(0.5, 0, 0))
    assert initial_state(right).p[0] == pytest.approx(0.5)


def test_motion_that_returns_nonsense():
    refused(
        lambda: driven(lambda t: (NAN, 0, 0)), ["prescribed motion", "displacement(0.0)", "nan"]
    )
    refused(lambda: driven(lambda t: (0, 0)), ["prescribed motion", "displacement(0.0)", "(2,)"])
    refused(lambda: driven(rotation=lambda t: 1.0), ["prescribed motion", "rotation(0.0)", "()"])


def test_velocities_that_joints_do_not_allow():
    ball = RigidBody.sphere(1.0, 1.0, velocity=(0, 0.7, 0))
    system = freeze(ball=ball, hook=JointSpherical(HERE, ball.at((0, 0, 0))))
    refused(lambda: initial_state(system), ["spherical joint 'hook'", "0.7", "project"])
    v = project(system, system.q0, system.v0)
    assert abs(initial_state(system, v=v).p).max() < 1e-12


# ----------------------------------------------------------------------- initial states
def test_initial_states():
    ball = RigidBody.sphere(1.0, 1.0)
    system = freeze(ball=ball, hook=JointSpherical(HERE, ball.at((0, 0, 0))))
    q, zero = system.q0, np.zeros(12)
    item = "initial state"
    refused(lambda: initial_state(system, q=q[:5]), [item, "q", "(5,)", "(12,)"])
    refused(lambda: initial_state(system, q=q * NAN), [item, "q", "not finite"])
    refused(lambda: initial_state(system, v=zero[:3]), [item, "v", "(3,)"])
    refused(lambda: initial_state(system, p=zero + NAN), [item, "p", "not finite"])
    refused(lambda: initial_state(system, v=zero, p=zero), [item, "v or p"])
    refused(lambda: initial_state(system, time=NAN), [item, "time", "nan"])
    moved = q.copy()
    moved[1] = 0.3
    refused(lambda: initial_state(system, q=moved), [item, "0.3", "spherical joint 'hook'"])
    longer = q.copy()
    longer[3] = 1.1
    refused(lambda: initial_state(system, q=longer), [item, "0.105", "triad", "'ball'"])
    p = zero.copy()
    p[0] = 0.4
    refused(lambda: initial_state(system, p=p), [item, "p violates", "0.4", "Projection"])


# ----------------------------------------------------------------------- neither held nor with mass
def test_a_thin_rod_that_may_spin():
    rod = RigidBody.rod(1.0, 2.0)
    words = ["rigid body 'rod'", "rotation about [0.0, 0.0, 1.0]", "no inertia", "no joint holds"]
    refused(lambda: freeze(rod=rod), words)
    rod = RigidBody.rod(1.0, 2.0)
    hung = {"rod": rod, "hook": JointSpherical(ground((0, 0, 1)), rod.at((0, 0, 1)))}
    refused(lambda: freeze(**hung), words)
    rod = RigidBody.rod(1.0, 2.0)
    tied = {"rod": rod, "rope": JointDistance(ground((0, 0, 2)), rod.at((0, 0, 1)))}
    refused(lambda: freeze(**tied), ["rigid body 'rod'", "no inertia"])
    rod = RigidBody.rod(1.0, 2.0)
    along = {
        "rod": rod,
        "hinge": JointRevolute(HERE, rod.at((0, 0, 0)), axis=(0, 0, 1.0)),
    }
    refused(lambda: freeze(**along), ["rigid body 'rod'", "rotation about", "no inertia"])
    rod = RigidBody.rod(1.0, 2.0)
    across = {
        "rod": rod,
        "hinge": JointRevolute(HERE, rod.at((0, 0, 0)), axis=(1.0, 0, 0)),
    }
    assert freeze(**across).unknowns == 1


def test_a_thin_rod_askew_names_its_axis():
    rod = RigidBody.rod(1.0, 2.0, triad=triad((0, 0.6, 0.8)))
    refused(lambda: freeze(rod=rod), ["rigid body 'rod'", "rotation about", "no inertia"])


def test_a_chain_of_rods_that_spins_as_one():
    """Each rod is held by the other, both spin about their common line."""
    rods = {k: RigidBody.rod(1.0, 1.0, position=(0, 0, k)) for k in (0, 1)}
    items = {
        "low": rods[0],
        "high": rods[1],
        "weld": JointFixed(rods[0].at((0, 0, 0.5)), rods[1].at((0, 0, 0.5))),
    }
    refused(lambda: freeze(**items), ["rigid body", "no inertia"])


@pytest.mark.parametrize("first", ["rod", "box"])
def test_a_free_rod_that_a_weld_holds(first):
    """Whichever of the two is the root of the tree."""
    rod, box = RigidBody.rod(1.0, 2.0), RigidBody.box(1.0, (1, 1, 1), position=(0, 0, 1.5))
    items = {"rod": rod, "box": box} if first == "rod" else {"box": box, "rod": rod}
    items["weld"] = JointFixed(rod.at((0, 0, 1)), box.at((0, 0, 1)))
    assert freeze(**items).unknowns == 6


@pytest.mark.parametrize("kind", [JointRevolute, JointSpherical])
def test_a_rod_that_a_loop_holds(kind):
    """Hung by ball joints at both ends of a chain: a hinge in the middle holds the rod's spin."""
    rod, box = RigidBody.rod(1.0, 2.0), RigidBody.box(1.0, (1, 1, 1), position=(0.5, 0, 1))
    items = {
        "rod": rod,
        "box": box,
        "low": JointSpherical(ground((0, 0, -1)), rod.at((0, 0, -1))),
        "far": JointSpherical(ground((1, 0, 1)), box.at((1, 0, 1))),
    }
    options = {"axis": (0, 1.0, 0)} if kind is JointRevolute else {}
    items["mid"] = kind(rod.at((0, 0, 1)), box.at((0, 0, 1)), **options)
    if kind is JointRevolute:
        assert freeze(**items).unknowns == 1
    else:
        refused(lambda: freeze(**items), ["rigid body 'rod'", "[0.0, 0.0, 1.0]", "no inertia"])


@pytest.mark.parametrize("inertia", [(0, 0), (1, 0), (0, 1)])
def test_a_beam_without_rotary_inertia(inertia):
    section = Section(np.ones(6), mass=1.0, inertia=inertia)
    bar = Beam(MESH, section, director=(0, 0, 1))
    words = ["beam 'bar'", "no inertia", "rotation about"]
    if inertia == (0, 0):
        refused(lambda: freeze(bar=bar), words)
    else:
        # turning about d1 moves d2, about d2 moves d1: one inertia leaves one of them without
        refused(lambda: freeze(bar=bar), words)


def test_a_point_of_a_body_without_rotation_inertia():
    """A body whose triad nothing determines."""
    dot = RigidBody(1.0, euler=(0, 0, 0))
    refused(lambda: freeze(dot=dot), ["rigid body 'dot'", "no inertia"])


# ----------------------------------------------------------------------- loops and mobility
def test_a_model_that_cannot_move():
    """Welded twice, held by a triangle of hinges, or a redundant weld: mobility zero or less."""
    door, one, two = (RigidBody.box(1.0, (1, 2, 3), position=(k, 0, 0)) for k in (0, 0, 1))
    words = ["model", "mobility is zero", "12 coordinates", "12 independent", "free a joint"]
    refused(lambda: freeze(door=door, weld=JointFixed(HERE, door.at((0, 0, 0)))), words)
    door = RigidBody.box(1.0, (1, 2, 3))
    welds = {f"weld {k}": JointFixed(ground((k, 0, 0)), door.at((k, 0, 0))) for k in (0, 1)}
    refused(lambda: freeze(door=door, **welds), ["mobility is zero", "(18 rows)"])
    pins = {
        "low": JointRevolute(HERE, one.at((0, 0, 0)), axis=(0, 0, 1.0)),
        "mid": JointRevolute(one.at((0.5, 1, 0)), two.at((0.5, 1, 0)), axis=(0, 0, 1.0)),
        "far": JointRevolute(ground((1, 0, 0)), two.at((1, 0, 0)), axis=(0, 0, 1.0)),
    }
    refused(lambda: freeze(one=one, two=two, **pins), ["mobility is zero", "24 independent", "27"])


@pytest.mark.parametrize("last", [JointRevolute, JointSpherical])
def test_a_loop_that_cannot_close(last):
    """The last joint of the ring is named, with the gap that is left."""
    points = np.array([[0, 0, 0], [0, 1.0, 0], [2, 1.5, 0], [2, 0, 0]])
    bars = [RigidBody.box(1.0, (0.2, 0.3, 0.4), position=p) for p in points[:3]]
    axis = {"axis": (0, 0, 1.0)}
    items = dict(zip("abc", bars, strict=True))
    items["pin 0"] = JointRevolute(ground(points[0]), bars[0].at(points[0]), **axis)
    for k in (1, 2):
        items[f"pin {k}"] = JointRevolute(bars[k - 1].at(points[k]), bars[k].at(points[k]), **axis)
    end = points[3] + (0.03, 0, 0.04)
    options = axis if last is JointRevolute else {}
    items["last"] = last(bars[2].at(points[3]), ground(end), **options)
    words = [f"{last.type} joint 'last'", "does not close", "0.05 m", "ground at [2.03, 0.0, 0.04]"]
    refused(lambda: freeze(**items), words)


# ----------------------------------------------------------------------- redundant constraints
def agrees(model):
    """Both treatments with both integrators: the same motion, all rows fulfilled."""
    system = (model if isinstance(model, Model) else model_of(**model)).freeze()
    v = np.random.default_rng(1).standard_normal(system.n)
    start = initial_state(system, v=project(system, system.q0, v))
    for integrator in (Variational(), EnergyMomentum()):
        one, two = (
            simulate(system, integrator, treatment, 0.01, 0.2, start=start)
            for treatment in (NullSpace(), Multipliers())
        )
        assert abs(one["q"] - two["q"]).max() < 1e-11
        assert abs(one["q"][-1] - one["q"][0]).max() > 0.01
        assert max(h["constraint_violation"].max() for h in (one, two)) < 1e-12
    return system


@pytest.mark.slow
def test_two_fixed_joints_between_the_same_bodies():
    a, b = RigidBody.sphere(1.0, 1.0), RigidBody.sphere(1.0, 1.0, position=(1, 0, 0))
    items = {"a": a, "b": b}
    items["first weld"] = JointFixed(a.at((0.5, 0, 0)), b.at((0.5, 0, 0)))
    items["second weld"] = JointFixed(a.at((0.5, 1, 0)), b.at((0.5, 1, 0)))
    system = agrees(items)
    assert system.counts() == {"n": 24, "m": 24, "rank": 18, "unknowns": 6}
    assert system.redundant.tolist() == list(range(18, 24))  # all of the second one


@pytest.mark.slow
def test_a_planar_four_bar_of_revolutes():
    """Three of the last hinge's rows: the one along the axis, and the two of the axes."""
    system = agrees(four_bar())
    assert system.counts() == {"n": 36, "m": 38, "rank": 35, "unknowns": 1}
    assert len(system.redundant) == 3


@pytest.mark.slow
def test_two_hinges_of_a_door():
    door = RigidBody.box(1.0, (1, 2, 3))
    items = {"door": door}
    for name, z in (("lower", -1.0), ("upper", 1.0)):
        items[name] = JointRevolute(ground((0, 0, z)), door.at((0, 0, z)), axis=(0, 0, 1.0))
    system = agrees(items)
    assert system.counts() == {"n": 12, "m": 16, "rank": 11, "unknowns": 1}
    assert system.redundant.tolist() == list(range(11, 16))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_rod_beside_a_ball_joint(seed):
    """The distance to the centre of the ball joint cannot change: its row is round-off."""
    x, y, z = np.random.default_rng(seed).standard_normal((3, 3))
    ball = RigidBody.sphere(1.0, 1.0, position=z)
    items = {"ball": ball, "hook": JointSpherical(ground(x), ball.at(x))}
    items["strut"] = JointDistance(ground(x), ball.at(y))
    system = agrees(items)
    assert system.counts() == {"n": 12, "m": 10, "rank": 9, "unknowns": 3}
    assert system.redundant.tolist() == [9]


# ----------------------------------------------------------------------- arguments of a run
SYSTEM = freeze(ball=MassPoint(1.0, velocity=(1, 0, 0)))
PAIR = (Variational(), NullSpace())


@pytest.mark.parametrize("bad", [0, 0.0, -0.1, NAN, INF, None, "fast", (0.1, 0.2)])
def test_step(bad):
    words = ["step", repr(bad)]
    refused(lambda: simulate(SYSTEM, *PAIR, bad, 1.0), words)
    refused(lambda: Stepper(SYSTEM, *PAIR, bad), words)
    refused(lambda: next(steps(SYSTEM, *PAIR, bad)), words)


@pytest.mark.parametrize("bad", [0, -1.0, NAN, INF, None, "long"])
def test_until(bad):
    refused(lambda: simulate(SYSTEM, *PAIR, 0.1, bad), ["until", repr(bad)])


def test_runs_before_time_zero():
    start = initial_state(SYSTEM, time=-1.0)
    assert simulate(SYSTEM, *PAIR, 0.25, 0.0, start=start).times[-1] == 0.0


def test_until_before_the_start():
    late = State(5.0, 0, SYSTEM.q0, SYSTEM.v0)
    refused(lambda: simulate(SYSTEM, *PAIR, 0.1, 1.0, start=late), ["until", "1.0", "5.0"])


def test_other_arguments_of_a_run():
    def run(**options):
        return lambda: simulate(SYSTEM, *PAIR, 0.1, 1.0, **options)

    refused(run(every=0), ["every", "0"])
    refused(run(every=1.5), ["every", "1.5"])
    refused(run(at=[0.2, 7.0]), ["at", "7.0", "outside"])
    refused(run(at=[NAN]), ["at", "nan"])
    refused(run(at="often"), ["at", "'often'"])
    refused(run(start=3.0), ["start", "3.0", "State"])
    bad = State(0.0, 0, SYSTEM.q0[:2], SYSTEM.v0)
    refused(run(start=bad), ["start", "q", "(2,)", "(3,)"])
    nan = State(0.0, 0, SYSTEM.q0 * NAN, SYSTEM.v0)
    refused(run(start=nan), ["start", "q", "finite"])
    refused(run(callbacks=[3]), ["callbacks", "3"])


def test_the_wrong_objects():
    refused(lambda: simulate(None, *PAIR, 0.1, 1.0), ["system", "NoneType", "Model"])
    refused(
        lambda: simulate(SYSTEM, "variational", NullSpace(), 0.1, 1.0),
        ["integrator", "variational"],
    )
    refused(
        lambda: simulate(SYSTEM, Variational(), "null-space", 0.1, 1.0), ["treatment", "null-space"]
    )
    refused(
        lambda: simulate(SYSTEM, Variational, NullSpace(), 0.1, 1.0), ["integrator", "Variational"]
    )
    refused(
        lambda: simulate(SYSTEM, NullSpace(), Variational(), 0.1, 1.0), ["integrator", "NullSpace"]
    )


def test_a_folder_that_cannot_be_written(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    target = blocked / "run.h"
    seen = []
    refused(
        lambda: simulate(SYSTEM, *PAIR, 0.1, 1.0, path=target, callbacks=[seen.append]),
        [str(target.name)],
    )
    assert not seen  # before the first step


def test_all_errors_are_ours_and_value_errors():
    for kind in (sc.InputError, sc.MeshError, sc.HistoryError, sc.IncompatibleError):
        assert issubclass(kind, sc.CosseratError)
        assert issubclass(kind, ValueError)
    error = MeshError("beam 'a'", "is odd")
    assert (error.item, str(error)) == ("beam 'a'", "beam 'a': is odd")


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: sc.read_mesh(5), ["argument path", "5"]),
        (lambda: sc.History.load(5), ["argument path", "5"]),
        (lambda: sc.write_mesh("x.msh", 5), ["argument mesh", "5", "MeshCurve"]),
        (lambda: SYSTEM.extend(np.zeros(99), 0.0), ["argument q", "(99,)"]),
        (lambda: initial_state(SYSTEM, rates={"j": "1"}), ["argument rates", "'1'"]),
        (lambda: initial_state(SYSTEM, tolerance=True), ["tolerance", "True"]),
        (lambda: MassPoint(1.0, position=np.array([1j, 0, 2])), ["position", "real numbers"]),
        (lambda: MassPoint(1.0, position=[True, False, "3"]), ["position", "real numbers"]),
        (lambda: LoadGravity(("1", "2", "3")), ["'1'", "real numbers"]),
        (lambda: sc.RampLinear("0", 1), ["begin", "'0'"]),
        (lambda: simulate(SYSTEM, *PAIR, 0.1, b".1"), ["until", "b'.1'"]),
        (lambda: simulate(SYSTEM, *PAIR, 0.1, 1.0, path="a\0b"), ["argument path", "zero"]),
        (lambda: sc.History.load("a\0b"), ["argument path", "zero"]),
    ],
)
def test_what_is_no_name_of_a_file_no_number_and_no_mesh(call, words):
    refused(call, words)


def test_a_run_in_a_plane_is_asked_of_the_model():
    model = model_of(ball=MassPoint(1.0))
    with pytest.raises(TypeError, match=r"model\.freeze\(planar=sc\.Planar\(\)\)"):
        simulate(model, EnergyMomentum(), NullSpace(), 0.1, 1.0, planar=sc.Planar())


@pytest.mark.parametrize("kind", ["heavy", "hinged", "spins"])
def test_inertia_of_a_chain(kind):
    """A bar without inertia about its axis is held by a hinge, and spins on balls."""
    items, end = {}, HERE
    for k in range(12):
        a, b = np.array([0, 0, k + 0.0]), np.array([0, 0, k + 1.0])
        inertia = (1.0, 1.0, 0.0 if kind != "heavy" and k == 7 else 0.1)
        items[f"bar {k}"] = bar = RigidBody(1.0, inertia, position=(a + b) / 2)
        held = kind == "hinged" and k == 7
        joint = (
            JointRevolute(end, bar.at(a), (1.0, 0, 0)) if held else JointSpherical(end, bar.at(a))
        )
        items[f"joint {k}"] = joint
        end = bar.at(b)
    if kind == "spins":
        refused(lambda: freeze(**items), ["rigid body 'bar 7'", "rotation about", "no inertia"])
        return
    assert "T" not in vars(freeze(**items).kinematics)  # not all in one matrix


@pytest.mark.parametrize("mass", [1e-3, 1e-14])
def test_a_light_body_on_a_heavy_one(mass):
    """Next to nothing is refused, however sound the body is by itself."""
    box = RigidBody.box(1.0, (1, 1, 1))
    dust = RigidBody.box(mass, (1, 1, 1), position=(1.0, 0, 0))
    ball = JointSpherical(dust.at((0.5, 0, 0)), box.at((0.5, 0, 0)))
    items = {"dust": dust, "box": box, "ball": ball}
    if mass == 1e-3:
        assert freeze(**items).unknowns == 9
    else:
        refused(lambda: freeze(**items), ["no inertia", "rotation about"])


def test_a_hinge_behind_another_of_the_same_axis_needs_a_mass_between():
    """The rod between them spins alone: each pivot by itself is no measure."""
    rod = RigidBody.rod(1.0, 1.0, position=(0, 0, 0.5))
    box = RigidBody.box(1.0, (1, 1, 1), position=(0, 0, 1.5))
    items = {
        "rod": rod,
        "box": box,
        "low": JointRevolute(HERE, rod.at((0, 0, 0)), axis=(0, 0, 1.0)),
        "high": JointRevolute(rod.at((0, 0, 1)), box.at((0, 0, 1)), axis=(0, 0, 1.0)),
    }
    refused(lambda: freeze(**items), ["no inertia", "rotation about"])
