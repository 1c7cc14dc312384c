"""Every joint between every pair of sides, either way round, in both treatments and integrators.

One scene for each kind of joint holds it between bodies, ground at rest and in motion, beam nodes
(also eccentric) and mass points, at random places and orientations.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from helpers_scenes import (
    JOINTS,
    POINT_JOINTS,
    SHAKE,
    TENSOR,
    assert_constraints,
    assert_null_space,
    fitting,
    full_section,
    random_tree,
    rotation,
    seen,
    two_states,
    unit,
)
from helpers_schemes import TREATMENTS, integrators, treatments
from scipy.spatial.transform import Rotation
from test_tangents import TOLERANCE, Step, worst

import skfem_cosserat as sc
from skfem_cosserat import diagnostics

kinds = pytest.mark.parametrize("kind", JOINTS, ids=lambda kind: kind.type)
GRAVITY = np.array([0.4, -0.3, -9.81])
PARTNERS = ("body", "ground", "moving", "node", "eccentric", "point")


# -- scenes ----------------------------------------------------------------------------------------


class Builder:
    """Pairs of items with one kind of joint between them."""

    def __init__(self, kind, seed=0):
        self.kind, self.rng, self.model = kind, np.random.default_rng(seed), sc.Model()
        self.sides = {}  # joint -> (item of side a or None, item of side b or None)

    def body(self, name):
        rng = self.rng
        body = sc.RigidBody(
            *(1.5, TENSOR),
            center=(0.1, -0.2, 0.15),
            position=rng.standard_normal(3),
            triad=rotation(rng).T,
        )
        return self.model.add(name, body)

    def partner(self, what, name):
        """A place on something else, and the item if its momentum can be told apart."""
        rng, x = self.rng, self.rng.standard_normal(3)
        if what == "body":
            item = self.body(name)
            return item.at(x), item
        if what in ("ground", "moving"):
            return sc.ground(x, SHAKE if what == "moving" else None), None
        if what == "point":
            item = self.model.add(name, sc.MassPoint(0.8, x))
            return item.place(), item
        mesh = sc.MeshCurve.init_line(x, x + unit(rng), 1, name)
        beam = self.model.add(name, sc.Beam(mesh, full_section()))
        offset = 0.3 * rng.standard_normal(3) if what == "eccentric" else np.zeros(3)
        return beam.node(f"{name}.end", offset), None

    def add(self, what, swap):
        """Body "two" on side b, the partner on side a; or the other way round."""
        name = f"{what} {'b-a' if swap else 'a-b'}"
        options, gap = fitting(self.kind, self.rng)
        place, item = self.partner(what, f"partner {name}")
        body = self.body(f"body {name}")
        sides = [(place, item), (body.at(place.position + gap), body)]
        if swap:
            sides.reverse()
        joint = self.kind(sides[0][0], sides[1][0], **options)
        self.model.add(name, joint)
        self.sides[name] = sides[0][1], sides[1][1]


def pairs(kind):
    """What a kind of joint may connect, and which way round."""
    out = [(what, swap) for what in PARTNERS[:-1] for swap in (False, True)]
    if kind in POINT_JOINTS:
        out.append(("point", True))  # the point is side b
        if kind is not sc.JointPointOnLine:
            out.append(("point", False))
    return out


@cache
def scene(kind):
    build = Builder(kind, list(JOINTS).index(kind))
    for what, swap in pairs(kind):
        build.add(what, swap)
    build.model.add("gravity", sc.LoadGravity(GRAVITY))
    return build.model.freeze(), build.sides


# -- null space ------------------------------------------------------------------------------------


@kinds
def test_null_space_at_nodes_and_midpoints(kind):
    """It spans what the rows leave free, as many as the joints have."""
    system, _ = scene(kind)
    assert {joint.size for joint in system.joints} == {6 - JOINTS[kind]}
    assert system.rank == system.m == system.n - system.unknowns
    y0, y1, nodal = two_states(system)
    assert abs(y1 - y0)[: system.rows].max() > 0.5
    for y in (y0, y1):
        assert_constraints(system, y)
    for y in (y0, 0.5 * (y0 + y1), y1):
        assert_null_space(system, y, nodal.fixed)


@kinds
def test_geometry(kind):
    """What each joint holds, written down by hand from positions and rotations."""
    system, _ = scene(kind)
    _, y, _ = two_states(system)
    for joint in system.joints:
        (xa, Ra), (xb, Rb) = (seen(system, place, y) for place in (joint.a, joint.b))
        r, r0 = xb - xa, joint.b.position - joint.a.position
        rounding = 1e-13 * (1 + abs(xb).max())
        if kind is sc.JointDistance:
            assert np.linalg.norm(r) == pytest.approx(np.linalg.norm(r0), rel=1e-13)
            continue
        if kind in (sc.JointSpherical, sc.JointRevolute, sc.JointUniversal, sc.JointFixed):
            assert abs(r).max() < rounding, joint.name
        if kind in (sc.JointCylindrical, sc.JointPrismatic, sc.JointPointOnLine):
            n = Ra @ joint.axis
            assert abs(np.cross(n, r)).max() < rounding, joint.name
            assert abs(n @ r - joint.axis @ r0) > 1e-3  # it slides
        if kind is sc.JointPlanar:
            assert abs(Ra @ joint.normal @ r) < rounding, joint.name
            assert abs(Ra.T @ r - r0).max() > 1e-3
        if kind in (sc.JointRevolute, sc.JointCylindrical):
            assert abs(Ra @ joint.axis - Rb @ joint.axis).max() < 1e-13, joint.name
        if kind is sc.JointPlanar:
            assert abs(Ra @ joint.normal - Rb @ joint.normal).max() < 1e-13, joint.name
        if kind in (sc.JointPrismatic, sc.JointFixed):
            assert abs(Ra - Rb).max() < 1e-13, joint.name
        elif Rb is not None and Ra is not None:
            assert abs(Ra - Rb).max() > 1e-2  # it turns
        if kind is sc.JointUniversal:
            assert abs((Ra @ joint.axis_a) @ (Rb @ joint.axis_b)) < 1e-13, joint.name


@pytest.mark.parametrize(
    ("kind", "options", "axes"),
    [
        (sc.JointRevolute, {"axis": (0, 0, 1)}, [(0, 1, 0)]),
        (sc.JointCylindrical, {"axis": (0, 0, 1)}, [(0, 1, 0)]),
        (sc.JointPlanar, {"normal": (0, 0, 1)}, [(0, 1, 0)]),
        (sc.JointPrismatic, {"axis": (0, 0, 1)}, [(0, 0, 1), (0, 1, 0)]),
        (sc.JointFixed, {}, [(1, 0, 0), (0, 1, 0), (0, 0, 1)]),
        (sc.JointUniversal, {"axis_a": (1, 0, 0), "axis_b": (0, 1, 0)}, []),
        (sc.JointSpherical, {}, []),
    ],
    ids=lambda value: getattr(value, "type", ""),
)
def test_half_a_turn_off_is_noticed(kind, options, axes):
    """Quadratic rows hold there, too; a step of multipliers that ends there is refused."""
    model = sc.Model()
    body = model.add("body", sc.RigidBody(1.0, TENSOR))
    model.add("joint", kind(sc.ground((0, 0, 0)), body.at((0, 0, 0)), **options))
    model.add("stone", sc.MassPoint(1.0, (5, 5, 5)))
    system = model.freeze()

    def turned(axis):
        y = system.extend(system.q0, 0.0)
        y[1:4] = Rotation.from_rotvec(np.pi * np.array(axis)).apply(y[1:4])
        return y

    for axis in axes:
        y = turned(axis)
        assert abs(system.constraints.values(y)).max() < 1e-14
        assert system.wrong_branch(y) == f"{kind.type} joint 'joint' by half a turn"
    assert system.wrong_branch(system.extend(system.q0, 0.0)) is None
    if kind not in (sc.JointFixed, sc.JointPrismatic, sc.JointUniversal):
        assert system.wrong_branch(turned((0, 0, 1))) is None  # about its own axis
    y = system.extend(system.q0, 0.0)
    y[3] *= -1  # a left-handed triad
    assert abs(system.constraints.values(y))[:6].max() < 1e-15
    assert system.wrong_branch(y) is not None


# -- steps -----------------------------------------------------------------------------------------


@pytest.mark.one_quick
@kinds
@integrators
@treatments
def test_tangent(kind, integrator, treatment):
    """Iteration matrix at a far trial state against the complex step."""
    system, _ = scene(kind)
    step = Step(system, integrator, treatment, seed=2)
    assert worst(step.matrix(), step.derivative()) < TOLERANCE


#: reports of the steps of each run
STEPS = {}
KINDS = "force", "moment"


@cache
def run(kind, integrator, treatment):
    """Reports of its steps are in STEPS."""
    system, _ = scene(kind)
    v = np.random.default_rng(4).standard_normal(system.n)
    start = sc.initial_state(system, v=sc.project(system, system.q0, v))
    reports = []
    options = {"start": start, "callbacks": [reports.append]}
    history = sc.simulate(system, integrator, treatment, 0.01, 0.06, **options)
    STEPS[kind, integrator, treatment] = reports
    return history


@pytest.mark.slow
@kinds
@integrators
def test_both_treatments_give_the_same_motion(kind, integrator):
    one, two = (run(kind, integrator, treatment) for treatment in TREATMENTS)
    assert abs(one["q"] - two["q"]).max() < 1e-10
    assert abs(one["q"][-1] - one["q"][0]).max() > 0.05
    assert one["constraint_violation"].max() < 1e-12
    assert two["constraint_violation"].max() < 1e-11
    for history in (one, two):
        assert (history["attempts"] == 1).all()
    size = abs(one["constraint_force"][:-1]).max()
    difference = abs(one["constraint_force"] - two["constraint_force"])[:-1]
    assert difference.max() < 1e-8 * size


def momenta(system, history, item):
    """Momentum and angular momentum about the origin (N, 3) of one body or point, and its q."""
    r = system.frame_place(item.name) // 3
    rows = slice(r, r + (1 if isinstance(item, sc.MassPoint) else 4))
    q, p = (history[k].reshape(len(history), -1, 3)[:, rows] for k in ("q", "p"))
    return p[:, 0], np.cross(q, p).sum(1), q


def weight(item, q):
    """Force and moment about the origin (N, 3) of gravity at configurations (N, rows, 3)."""
    force = item.mass * GRAVITY
    if isinstance(item, sc.MassPoint):
        return force, np.cross(q[:, 0], force)
    return force, np.cross(q[:, 0] + np.einsum("i,nij->nj", item.center, q[:, 1:]), force)


@pytest.mark.one_quick
@kinds
@integrators
@treatments
def test_reactions_balance_the_momenta_of_both_sides(kind, integrator, treatment):
    """Exact in the discrete motion: dp = h (F + m g), dL = h (x_B x F + M + moment of m g).

    Force and moment act on side B about its point of the joint, the opposite on side A about the
    same point. With the variational scheme half of them belongs to each end of a step.
    """
    system, sides = scene(kind)
    history = run(kind, integrator, treatment)
    h, worst_force, worst_moment = 0.01, 0.0, 0.0
    points = diagnostics.constraint_points(system, history)
    found = {j.name: [history[f"joint/{j.name}/{k}"] for k in KINDS] for j in system.joints}
    if integrator.name != "variational":  # the steps have theirs at their midpoints
        reports = STEPS[kind, integrator, treatment]
        points = np.array([report.constraint_point for report in reports])
        force = np.array([report.constraint_force for report in reports])
        lam = diagnostics.multipliers(system, points, force)
        found = diagnostics.reactions(system, points, lam)
    for joint in system.joints:
        F, M = found[joint.name]
        x = np.array([seen(system, joint.b, y)[0] for y in points])
        T = M + np.cross(x, F)
        if integrator.name == "variational":
            F, T = (0.5 * (f[1:-2] + f[2:-1]) for f in (F, T))
            steps = slice(1, -2), slice(2, -1)
        else:
            steps = slice(0, -1), slice(1, None)
        for item, sign in zip(sides[joint.name], (-1.0, 1.0), strict=True):
            if item is None:
                continue
            p, L, q = momenta(system, history, item)
            before, after = steps
            force, moment = weight(item, 0.5 * (q[before] + q[after]))
            size = 1 + abs(L).max()
            dp, dL = (k[after] - k[before] for k in (p, L))
            worst_force = max(worst_force, abs(dp - h * (sign * F + force)).max() / size)
            worst_moment = max(worst_moment, abs(dL - h * (sign * T + moment)).max() / size)
    assert worst_force < 1e-11
    assert worst_moment < 1e-11


@pytest.mark.slow
@integrators
@treatments
def test_free_joints_transmit_nothing_along_their_freedoms(integrator, treatment):
    """No moment about hinge axes, no force along slides, no moment of a rod or a point."""
    for kind in JOINTS:
        system, _ = scene(kind)
        history = run(kind, integrator, treatment)
        points = diagnostics.constraint_points(system, history)[:-1]
        for joint in system.joints:
            F, M = (history[f"joint/{joint.name}/{k}"][:-1] for k in ("force", "moment"))
            R = (
                np.array([seen(system, joint.a, y)[1] for y in points])
                if joint.a.triad is not None
                else None
            )
            tiny = 1e-9 * (1 + abs(F).max())
            if joint.freedom().turns is None:
                assert abs(M).max() < tiny, (kind, joint.name)
            for turn in joint.freedom().turns or ():
                place = joint.a if turn.side == "a" else joint.b
                axes = np.array([seen(system, place, y)[1] @ turn.axis for y in points])
                assert abs((M * axes).sum(1)).max() < tiny, (kind, joint.name)
            for slide in joint.freedom().slides:
                left, right = R @ slide.left, R @ slide.right
                assert abs((F * np.cross(left, right)).sum(1)).max() < tiny, (kind, joint.name)


# -- random trees ----------------------------------------------------------------------------------


def random_run(seed, integrator, treatment):
    system = random_tree(seed)
    v = np.random.default_rng(seed).standard_normal(system.n)
    start = sc.initial_state(system, v=sc.project(system, system.q0, v))
    run = system, integrator, treatment, 0.005, 0.1
    return sc.simulate(*run, start=start, derive=False)["q"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 104))
@integrators
def test_treatments_agree_on_random_trees(seed, integrator):
    one, two = (random_run(seed, integrator, treatment) for treatment in TREATMENTS)
    assert abs(one - two).max() < 1e-10 * (1 + abs(one).max())
    assert abs(one[-1] - one[0]).max() > 0.1


def test_random_trees_have_every_joint():
    found = {type(joint) for seed in range(100, 106) for joint in random_tree(seed).joints}
    assert found == set(JOINTS)


# -- half models: a planar joint holds what a mirror plane cuts ------------------------------------

#: mirrored at e1 = 0
MIRROR = (1.0, 0, 0)
FORCE = np.array([0.0, -6.0, 4.0])
SECTION = sc.Section([2e3, 2e3, 4e3, 10.0, 12.0, 8.0], mass=1.0, inertia=(1e-3, 2e-3))


def arch(whole):
    """Half a circle, pushed out of its plane; or its left half, held in the mirror plane.

    A half model takes half of what lies on the mirror plane, the weight on the crown.
    """
    share = 1.0 if whole else 0.5
    mesh = sc.MeshCurve.init_arc(
        (-1, 0, 0), (0, 1, 0), (1, 0, 0), 1.0, share * np.pi, round(6 * share), "arch"
    )
    model = sc.Model()
    beam = model.add("arch", sc.Beam(mesh, SECTION, order=2, director=(0, 0, 1)))
    clamp = sc.JointFixed(sc.ground((-1, 0, 0)), beam.node("arch.start"))
    model.add("clamp", clamp)
    crown, end = beam.node((0, 1, 0)), beam.node("arch.end")
    if whole:
        model.add("other clamp", sc.JointFixed(sc.ground((1, 0, 0)), end))
    else:
        model.add("mirror", sc.JointPlanar(sc.ground((0, 1, 0)), crown, MIRROR))
    model.add("weight", sc.RigidBody.sphere(0.4 * share, radius=0.2, on=crown))
    model.add("push", sc.LoadForce(crown, share * FORCE))
    return model


def left_half(model, history):
    """Frames (N, 7, 12) of the first 7 nodes along the arch."""
    basis = model["arch"].basis
    nodes = np.append(basis.connectivity[:3, :-1].ravel(), basis.connectivity[2, -1])
    return history["q"].reshape(len(history), -1, 12)[:, nodes]


@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore:path, load factor")  # one large step
@treatments
def test_the_joint_in_the_mirror_carries_what_the_other_half_would(treatment):
    """Axial force and both bending moments of the crown; no shear, no torsion there."""
    control = sc.LoadControl(until=1.0, steps=1)
    found = []
    for model in (arch(True), arch(False)):
        path = sc.static(model, treatment, control=control, watch=False)
        ends = sc.diagnostics.nodal_resultants(model, model["arch"], path["q"][-1])[2, 1]
        left = left_half(model, path)
        triad = left[-1, -1].reshape(4, 3)[1:]
        found.append((left, ends.reshape(2, 3) @ triad, path))
    (left, resultants, _), (half, other, halved) = found
    assert abs(left - half).max() < 1e-11
    assert other == pytest.approx(resultants, abs=1e-8)
    # on the face with the normal along the beam, here e1: what the joint gives is that on the rod
    force, moment = (halved[f"joint/mirror/{name}"][-1] for name in ("force", "moment"))
    assert abs(force[1:]).max() < 1e-9
    assert abs(moment[0]) < 1e-9
    assert force[0] == pytest.approx(resultants[0, 0], rel=1e-8)
    assert moment[1:] == pytest.approx(resultants[1, 1:], rel=1e-8, abs=1e-9)


# -- bad input -------------------------------------------------------------------------------------

BALL = sc.RigidBody.sphere(1.0, 1.0)
HERE, PLACE, POINT = sc.ground((0, 0, 0)), BALL.at((0, 0, 0)), sc.MassPoint(1.0).place()


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("call", "text"),
    [
        (
            lambda: sc.JointUniversal(HERE, PLACE, (1, 0, 0), (0.6, 0.8, 0)),
            r"universal joint.*axis_a = \[1.0, 0.0, 0.0\].*53.1301 degrees.*expected 90",
        ),
        (lambda: sc.JointUniversal(HERE, PLACE, (1, 0, 0), (0, 2, 0)), "axis_b.*length 2"),
        (lambda: sc.JointCylindrical(POINT, PLACE, (1, 0, 0)), "side a.*mass point"),
        (lambda: sc.JointPrismatic(HERE, PLACE, (0, 0, 0)), "prismatic joint.*length 0"),
        (lambda: sc.JointPrismatic(HERE, POINT, (1, 0, 0)), "side b.*mass point"),
        (
            lambda: sc.JointPlanar(HERE, PLACE, (0, 0, 1), (0.6, 0, 0.8)),
            "planar joint.*not normal.*x . n = 0.8",
        ),
        (lambda: sc.JointPointOnLine(HERE, POINT, (float("nan"), 0, 0)), "point-on-line.*nan"),
        (lambda: sc.JointPointOnLine(PLACE, BALL.at((1, 0, 0)), (1, 0, 0)), "both sides are"),
    ],
)
def test_bad_joints(call, text):
    with pytest.raises(sc.InputError, match=text):
        call()


def sliding(**options):
    """A box that slides on a plane."""
    model = sc.Model()
    box = model.add("box", sc.RigidBody.box(1.0, (1, 1, 1)))
    joint = sc.JointPlanar(sc.ground((0, 0, 0)), box.at((0, 0, 0)), (0, 0, 1), **options)
    return model, model.add("table", joint)


@pytest.mark.parametrize(
    "use",
    [
        lambda model, joint: sc.JointSpringDamper(joint, 1.0, coordinate="x"),
        lambda model, joint: sc.JointDrive(joint, np.sin, "x"),
        lambda model, joint: sc.initial_state(model.freeze(), rates={"table/x": 1.0}),
        lambda model, joint: sc.simulate(
            *(model, sc.Variational(), sc.NullSpace(), 0.1, 0.1),
            events=[sc.Event(sc.ConditionCoordinate("table", 0.4, "y"), sc.ActionStop())],
        ),
    ],
    ids=["spring", "drive", "rates", "event"],
)
def test_coordinates_along_no_given_direction(use):
    """A planar joint without `x` has an angle, but no x and y that would hang on our choice."""
    model, joint = sliding()
    with pytest.raises(sc.InputError, match=r"planar joint 'table'.*coordinate '[xy]'.*x=\.\.\."):
        use(model, joint)
    model, joint = sliding(x=(1, 0, 0))
    use(model, joint)


def test_a_planar_joint_without_directions_records_its_angle_only():
    for options, names in (({}, {"angle"}), ({"x": (0, 1, 0)}, {"angle", "x", "y"})):
        model, _ = sliding(**options)
        run = sc.simulate(model, sc.Variational(), sc.NullSpace(), 0.1, 0.1)
        assert {name for name in ("angle", "x", "y") if f"joint/table/{name}" in run} == names


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("kind", "options"),
    [
        (sc.JointCylindrical, {"axis": (1.0, 0, 0)}),
        (sc.JointPrismatic, {"axis": (1.0, 0, 0)}),
        (sc.JointPointOnLine, {"axis": (1.0, 0, 0)}),
        (sc.JointPlanar, {"normal": (0, 0.6, 0.8)}),
        (sc.JointUniversal, {"axis_a": (1.0, 0, 0), "axis_b": (0, 1.0, 0)}),
    ],
    ids=lambda value: getattr(value, "type", ""),
)
@pytest.mark.parametrize("swap", [False, True])
def test_joints_that_do_not_close(kind, options, swap):
    """0.05 m off; along a slide nothing is missing, as the scenes above show."""
    along = 0.0 if kind is sc.JointUniversal else 0.7
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (1, 2, 3), position=(1, 0, 0)))
    sides = [sc.ground((0, 0, 0)), body.at((along, 0.03, 0.04))]
    model.add("bad", kind(*(sides[::-1] if swap else sides), **options))
    with pytest.raises(sc.InputError, match=f"{kind.type} joint 'bad'.*not close.*0.05 m"):
        model.freeze()


def test_prescribed_rotation_must_start_from_zero():
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (1, 2, 3)))
    place = sc.ground((0, 0, 0), sc.Motion(rotation=lambda t: (0.1, 0, 0)))
    model.add("joint", sc.JointRevolute(place, body.at((0, 0, 0)), axis=(0, 0, 1)))
    with pytest.raises(sc.InputError, match=r"joint 'joint'.*rotation is not zero"):
        model.freeze()
