"""Closed loops: ranks, redundant rows, both treatments, conservation, singular positions."""

from __future__ import annotations

import logging
from functools import cache

import numpy as np
import pytest
from helpers_scenes import TENSOR, four_bar, full_section, random_state, rotation
from helpers_schemes import INTEGRATORS, TREATMENTS, integrators, treatments
from rounding import momentum_limits
from scipy.linalg import null_space, subspace_angles

import skfem_cosserat as sc
from skfem_cosserat import diagnostics

Z = (0, 0, 1.0)
R, S, U = sc.JointRevolute, sc.JointSpherical, sc.JointUniversal
HINGE, LEAN = {"axis": Z}, {"axis": (0, 0.6, 0.8)}
CARDAN = {"axis_a": (1.0, 0, 0), "axis_b": (0, 1.0, 0)}


# -- scenes ----------------------------------------------------------------------------------------


def body(model, name, x, seed=0):
    R0 = rotation(np.random.default_rng(seed)).T
    item = sc.RigidBody(1.2, TENSOR, center=(0.05, -0.02, 0.03), position=x, triad=R0)
    return model.add(name, item)


def ring(points, kinds, options, ground=None):
    """Bodies from each point to the next, joints at the points; one body may be the ground."""
    points, model = np.asarray(points, dtype=float), sc.Model()
    count = len(points)
    bodies = [
        None if k == ground else body(model, f"bar {k}", points[[k, (k + 1) % count]].mean(0), k)
        for k in range(count)
    ]
    for k, (x, kind, more) in enumerate(zip(points, kinds, options, strict=True)):
        sides = [sc.ground(x) if b is None else b.at(x) for b in (bodies[k - 1], bodies[k])]
        model.add(f"joint {k}", kind(*sides, **more))
    return model


FOUR = [(0, 0, 0), (0, 1, 0), (2, 1.5, 0), (2.2, 0, 0)]
FIVE = [(0, 0, 0), (-0.3, 1, 0), (1, 1.8, 0), (2, 1.5, 0), (2.2, 0, 0)]
SPACE = [(0, 0, 0), (0, 1, 0), (2, 1.5, 0.7), (2, 0, 0.3)]


def hinges(points, ground=None):
    return ring(points, [R] * len(points), [HINGE] * len(points), ground)


def three_cranks():
    """A bar on three equal parallel cranks: a redundant one, in the plane and out of it."""
    model = sc.Model()
    cranks = [body(model, f"crank {k}", (0.9 * k, 0.5, 0)) for k in range(3)]
    bar = body(model, "bar", (1, 1, 0))
    for k, crank in enumerate(cranks):
        x = np.array([0.9 * k, 0, 0])
        y = x + (0.3, 1, 0)
        model.add(f"low {k}", R(sc.ground(x), crank.at(x), Z))
        model.add(f"high {k}", R(crank.at(y), bar.at(y), Z))
    return model


def points_and_beam():
    """Loops through mass points, both ends of a free beam, and a wire."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 1, "bar")
    bar = model.add("bar", sc.Beam(mesh, full_section()))
    p, q = (
        model.add(n, sc.MassPoint(0.7, x)) for n, x in (("p", (0.5, 1, 0)), ("q", (1.2, 0.8, 0.4)))
    )
    start, end = bar.node("bar.start"), bar.node("bar.end")
    for k, (a, b) in enumerate(((start, p.place()), (p.place(), q.place()), (q.place(), end))):
        model.add(f"rod {k}", sc.JointDistance(a, b))
    model.add("rod 3", sc.JointDistance(q.place(), start))
    arm = body(model, "arm", (0.5, 0.1, -0.5))
    model.add("hinge", R(start, arm.at((0, 0, 0)), (0, 1, 0)))
    model.add("wire", sc.JointPointOnLine(arm.at((1, 0, 0)), end, (1, 0, 0)))
    return model


def stewart():
    """A platform on two legs of cardan, slide and ball joint, and a third without a slide."""
    model = sc.Model()
    top = body(model, "top", (0, 0, 1.2))
    for k in range(3):
        a, b = 2.1 * k + 0.2, 2.1 * k - 0.3
        x, y = (
            np.array([np.cos(a), np.sin(a), 0]),
            np.array([0.5 * np.cos(b), 0.5 * np.sin(b), 1.2]),
        )
        d = (y - x) / np.linalg.norm(y - x)
        e = np.cross(d, Z) / np.linalg.norm(np.cross(d, Z))
        low, high = (
            body(model, f"low {k}", 0.7 * x + 0.3 * y, k),
            body(model, f"high {k}", y, k + 1),
        )
        model.add(f"cardan {k}", U(sc.ground(x), low.at(x), e, np.cross(d, e)))
        if k < 2:
            model.add(f"slide {k}", sc.JointPrismatic(high.at(y), low.at(x + 0.4 * (y - x)), d))
        else:
            model.add(f"weld {k}", sc.JointFixed(low.at(y), high.at(y)))
        model.add(f"ball {k}", S(top.at(y), high.at(y)))
    return model


def slides():
    """Slides in one plane in a ring: some of their rows hold nothing at all that could move."""
    model = sc.Model()
    a, b, c = (body(model, n, x) for n, x in zip("abc", np.eye(3), strict=True))
    origin = np.zeros(3)
    places = [sc.ground(origin), a.at(origin), b.at(origin), c.at(origin), sc.ground(origin)]
    for k, axis in enumerate(((1, 0, 0), (0, 1, 0), (0.6, 0.8, 0), (0.8, -0.6, 0))):
        model.add(f"slide {k}", sc.JointPrismatic(places[k], places[k + 1], axis))
    return model


#: name: (scene, mobility, redundant rows, free of the ground)
SCENES = {
    "four-bar": (lambda: hinges(FOUR, 3), 1, 3, False),
    "free four-bar": (lambda: hinges(FOUR), 7, 3, True),
    "five-bar": (lambda: hinges(FIVE, 4), 2, 3, False),
    "free five-bar": (lambda: hinges(FIVE), 8, 3, True),
    "three cranks": (three_cranks, 1, 7, False),
    "slides": (slides, 2, 4, False),
    "free triangle of balls": (lambda: ring(SPACE[:3], [S] * 3, [{}] * 3), 9, 0, True),
    "free square of balls": (lambda: ring(SPACE, [S] * 4, [{}] * 4), 12, 0, True),
    "RSSR": (lambda: ring(SPACE, [R, S, S, R], [HINGE, {}, {}, LEAN], 3), 2, 0, False),
    "RSUR": (lambda: ring(SPACE, [R, S, U, R], [HINGE, {}, CARDAN, LEAN], 3), 1, 0, False),
    "slides and cardan": (
        lambda: ring(
            SPACE,
            [sc.JointCylindrical, S, U, sc.JointPrismatic],
            [HINGE, {}, CARDAN, LEAN],
            3,
        ),
        *(2, 0, False),
    ),
    "free with a planar joint": (
        lambda: ring(
            SPACE, [sc.JointPlanar, S, U, sc.JointCylindrical], [{"normal": Z}, {}, CARDAN, LEAN]
        ),
        *(10, 0, True),
    ),
    "points and beam": (points_and_beam, 13, 0, True),
    "stewart": (stewart, 5, 0, False),
}
scenes = pytest.mark.parametrize("scene", SCENES)
GRAVITY = (0.3, -9.81, 0.2)


@cache
def frozen(scene):
    model = SCENES[scene][0]()
    if not SCENES[scene][3]:
        model.add("gravity", sc.LoadGravity(GRAVITY))
    return model.freeze()


def started(system, seed=1, size=1.0):
    v = size * np.random.default_rng(seed).standard_normal(system.n)
    return sc.initial_state(system, v=sc.project(system, system.q0, v))


@cache
def run(scene, integrator, treatment):
    system = frozen(scene)
    return sc.simulate(system, integrator, treatment, 0.01, 0.25, start=started(system))


# -- ranks -----------------------------------------------------------------------------------------


@scenes
@pytest.mark.slow
def test_rank_and_null_space_along_the_motion(scene):
    """Of the whole Jacobian, by singular values: at nodes and at midpoints.

    Midpoints included where redundant rows meet a mobility above one, which no theorem promises.
    """
    _, mobility, redundant, _ = SCENES[scene]
    system = frozen(scene)
    assert system.unknowns == mobility
    assert system.rank == system.n - mobility == system.m - redundant
    assert len(system.redundant) == redundant
    q = run(scene, INTEGRATORS[1], TREATMENTS[0])["q"]
    for where, at_node in ((q[0], True), (q[20], True), (0.5 * (q[20] + q[21]), False)):
        y = system.extend(where, 0.0)
        G = system.constraints.jacobian(y).toarray()
        values = np.linalg.svd(G, compute_uv=False)
        assert values[system.rank - 1] > 1e-3
        assert values[system.rank :].max(initial=0.0) < 1e-13
        P = system.null_space(where)
        assert P.shape[1] == np.linalg.matrix_rank(P) == mobility
        assert abs(G @ P).max() <= 1e-12 * abs(G).max() * abs(P).max()
        if at_node:
            assert np.rad2deg(subspace_angles(P, null_space(G, rcond=1e-9))).max() < 1e-9


def test_redundant_rows_are_reported():
    """By joint: the four-bar's last hinge holds what others hold already."""
    system = four_bar().freeze()
    report = system.redundancies()
    assert report == {"pin 2": [2, 3, 4]}  # along the axis, and both directions of the axis
    assert frozen("RSSR").redundancies() == {}
    # dropped rows depend on the others, the others do not
    system = frozen("three cranks")
    starts = {jr.joint.name: jr.rows.start for jr in system.joint_rows}
    rows = [starts[n] + k for n, ks in system.redundancies().items() for k in ks]
    assert sorted(rows) == system.redundant.tolist() and len(rows) == 7
    G = system.constraints.jacobian(system.extend(system.q0, 0.0)).toarray()
    kept = np.setdiff1d(np.arange(system.m), system.redundant)
    assert np.linalg.matrix_rank(G[kept]) == len(kept) == system.rank == np.linalg.matrix_rank(G)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("scene", ["free five-bar", "slides and cardan"])
@integrators
def test_the_order_of_joints_does_not_matter(scene, seed, integrator):
    """Another spanning tree and other redundant rows: the same motion."""
    model, other = SCENES[scene][0](), sc.Model()
    joints = [name for name in model if isinstance(model[name], sc.Joint)]
    items = {name: model[name] for name in model}
    for name in [
        *(k for k in items if k not in joints),
        *np.random.default_rng(seed).permutation(joints),
    ]:
        vars(items[name]).update(name=None)  # in no model any more
        other.add(str(name), items[name])
    if not SCENES[scene][3]:
        other.add("gravity", sc.LoadGravity(GRAVITY))
    system = other.freeze()
    assert system.unknowns == SCENES[scene][1]
    for treatment in TREATMENTS:
        scheme = integrator, treatment, 0.01, 0.1
        q = sc.simulate(system, *scheme, start=started(system), derive=False)["q"]
        assert abs(q - run(scene, integrator, TREATMENTS[1])["q"][:11]).max() < 1e-11


# -- motion ----------------------------------------------------------------------------------------


@pytest.mark.slow
@scenes
@integrators
def test_both_treatments_give_the_same_motion(scene, integrator):
    one, two = (run(scene, integrator, treatment) for treatment in TREATMENTS)
    assert abs(one["q"] - two["q"]).max() < 1e-10
    assert abs(one["q"] - one["q"][0]).max() > 0.05
    for history in (one, two):
        assert history["constraint_violation"].max() < 1e-12  # of all rows, redundant ones too
        assert (history["attempts"] == 1).all()
    force = [h["constraint_force"][:-1] for h in (one, two)]
    assert abs(force[0] - force[1]).max() < 1e-8 * abs(force[0]).max()


@pytest.mark.slow
@scenes
@treatments
def test_energy_is_kept(scene, treatment):
    """By energy-momentum, gravity included."""
    history = run(scene, INTEGRATORS[1], treatment)
    total = history["energy"] + history["external"]
    scale = history["kinetic"].max() + abs(history["external"]).max()
    assert np.ptp(total) < 1e-11 * scale
    if not SCENES[scene][3]:
        assert np.ptp(history["kinetic"]) > 4e-3 * scale


@pytest.mark.one_quick
@pytest.mark.parametrize("scene", [k for k, v in SCENES.items() if v[3]])
@integrators
@treatments
def test_free_loops_keep_their_momenta(scene, integrator, treatment):
    system, history = frozen(scene), run(scene, integrator, treatment)
    L = diagnostics.angular_momentum(system, history["q"], history["p"])
    p = diagnostics.linear_momentum(system, history["p"])
    for values, limit in zip((p, L), momentum_limits(system, history), strict=True):
        assert abs(values - values[0]).max() < limit < 1e-9 * np.linalg.norm(values[0])


def test_multipliers_of_separate_loops():
    """Of least norm in each, whatever there is beside it: by dense least squares of all rows."""
    model = sc.Model()
    for k, kinds in enumerate(((R, R, R, R), (R, S, S, R), (R, R, R, R), (R, R, S, R))):
        four_bar(kinds, model, 3.0 * k, f" {k}")
    model.add("gravity", sc.LoadGravity((0.3, -9.81, 0.2)))
    system = model.freeze()
    history = sc.simulate(system, sc.Variational(), sc.NullSpace(), 1e-2, 0.1)
    y = diagnostics.constraint_points(system, history)[2:9]
    force = history["constraint_force"][2:9]
    for at, f, lam in zip(y, force, diagnostics.multipliers(system, y, force), strict=True):
        G = system.constraints.jacobian(at).toarray()
        least = np.linalg.lstsq(G.T, f, rcond=1e-9)[0]
        assert abs(lam - least).max() < 1e-9 * abs(least).max()


@pytest.mark.slow
def test_units_of_length_do_not_matter():
    """A linkage of a tenth of a micron and one of ten kilometres are the same linkage."""
    found = []
    for scale in (1.0, 1e-7, 1e4):
        model = linkage((1.0, 2.06, 1.5, 2.2), 1.5, scale=scale)
        model.add("gravity", sc.LoadGravity((0, -9.81 * scale, 0)))
        system = model.freeze()
        assert system.counts() == {"n": 36, "m": 38, "rank": 35, "unknowns": 1}
        for scheme in ((i, t) for i in INTEGRATORS for t in TREATMENTS):
            history = sc.simulate(system, *scheme, 0.02, 0.4, kernels="numpy")
            found.append(history["joint/pin 0/angle"])
            assert abs(found[-1] - found[(len(found) - 1) % 4]).max() < 1e-11


# -- prescribed motion of the ground, small errors of the geometry ---------------------------------


#: of a frame, about an axis off the door's
FRAME = sc.MotionTurn((0.6, 0.8, 0), lambda t: 0.3 * t**2, (1.0, 0.2, 0.3))


def door(low=None, high=None, off=0.0):
    """A door on two hinges, each of which may move; one may be off the line of both axes."""
    model = sc.Model()
    item = model.add("door", sc.RigidBody(1.0, TENSOR, center=(0.3, 0.2, 0)))
    for name, x, motion in (("low", (0, 0, -1.0), low), ("high", (off, 0, 1.0), high)):
        model.add(name, R(sc.ground(x, motion), item.at(x), Z))
    model.add("gravity", sc.LoadGravity((1.0, -9.81, 0)))
    return model


@pytest.mark.slow
@integrators
def test_redundant_hinges_on_a_moving_frame(integrator):
    """They move as one body: taken, and the work of the frame is what the door gains."""
    system = door(FRAME, FRAME).freeze()
    assert system.counts() == {"n": 12, "m": 16, "rank": 11, "unknowns": 1}
    one, two = (sc.simulate(system, integrator, treatment, 0.02, 0.3) for treatment in TREATMENTS)
    assert abs(one["q"] - two["q"]).max() < 1e-12
    for history in (one, two):
        assert history["constraint_violation"].max() < 1e-13
        if integrator.name == "energy-momentum":
            assert abs(history["energy_balance"]).max() < 1e-12 * abs(history["energy"]).max()


def test_a_frame_that_tears_its_door_apart():
    with pytest.raises(sc.InputError, match=r"'high'.*cannot follow the prescribed motion"):
        door(None, sc.Motion(lambda t: (0.1 * t**2, 0, 0))).freeze()


def test_geometry_with_too_few_digits():
    """A hinge beside the line of the other one locks the door; by how little is said."""
    assert door(off=1e-11).freeze().unknowns == 1
    refused = pytest.raises(sc.InputError, match=r"mobility is zero.*e-08 only.*more digits")
    with pytest.warns(sc.ModelWarning, match="more digits"), refused:
        door(off=1e-7).freeze()
    with pytest.raises(sc.InputError, match="mobility is zero") as caught:
        door(off=1e-2).freeze()
    assert "digits" not in str(caught.value)


# -- tangents --------------------------------------------------------------------------------------


@pytest.mark.one_quick
@pytest.mark.parametrize(
    "scene", ["five-bar", "free four-bar", "slides and cardan", "points and beam"]
)
@integrators
def test_tangent_at_the_solution(scene, integrator):
    """Reduced matrix against central differences of the reduced residual, loops closed anew.

    At the solution, where the directions left free may turn without changing a residual of zero.
    """
    system = frozen(scene)
    stepper = sc.Stepper(system, integrator, sc.NullSpace(), 0.02, kernels="numpy")
    state = started(system)
    for _ in range(3):
        state = stepper.advance(state).state
    matrix, _ = stepper.iteration_matrix(state)
    bound, scheme = stepper.bound, stepper.integrator
    balance = scheme.balance(system, 0.02)
    step = balance.begin(state)
    sought = bound.sought

    def residual(increment):
        bound.move(increment)
        y1 = bound.configure()
        r = bound.reduce(balance.evaluate(step, y1).R, y1)
        bound.sought = sought
        return r

    wanted, e = np.empty_like(matrix), 3e-5
    for k in range(bound.unknowns):
        increment = np.zeros(bound.unknowns)
        increment[k] = e
        wanted[:, k] = (residual(increment) - residual(-increment)) / (2 * e)
    assert abs(matrix - wanted).max() < 1e-7 * abs(wanted).max()


# -- singular positions ----------------------------------------------------------------------------


def linkage(lengths, theta, bend=1.0, scale=1.0):
    """Four-bar in the plane by its lengths (crank, coupler, rocker, base) and the crank's angle."""
    a, b, c, base = lengths
    A, D = np.zeros(3), np.array([base, 0.0, 0])
    B = a * np.array([np.cos(theta), np.sin(theta), 0])
    d = np.linalg.norm(D - B)
    along = (b**2 - c**2 + d**2) / (2 * d)
    e = (D - B) / d
    across = np.sqrt(max(b**2 - along**2, 0.0))
    C = B + along * e + bend * across * np.array([-e[1], e[0], 0])
    x, model = scale * np.array([A, B, C, D]), sc.Model()
    places = [sc.ground(x[0])]
    for k, name in enumerate(("crank", "coupler", "rocker")):
        size, mass = scale * np.array((1, 0.1, 0.1)), scale**3 * (1.0 + k)
        bar = model.add(name, sc.RigidBody.box(mass, size, position=x[k : k + 2].mean(0)))
        places += [bar.at(x[k]), bar.at(x[k + 1])]
    places.append(sc.ground(x[3]))
    for k in range(4):
        model.add(f"pin {k}", R(places[2 * k], places[2 * k + 1], Z))
    return model


PARALLELOGRAM = (1.0, 2.0, 1.0, 2.0)
CHANGE_POINT = (1.0, 2.0, 1.5, 2.5)  # straight at theta = pi, where two branches cross
#: angles from which ten steps of 0.02 s at 3 rad/s end in the crossing
CROSSED = {"variational": 2.5466687344504857, "energy-momentum": 2.5470645697435272}


def rates(system, speed):
    """Velocities with a speed of the crank, on the branch of the configuration."""
    v = system.null_space(system.q0)[:, 0]
    return speed / v[system.frame_place("crank") + 4] * v  # d1 is e1 in the reference


def spinning(system, speed):
    return sc.initial_state(system, v=rates(system, speed))


def turn(system, history, name):
    i = system.frame_place(name)
    return np.unwrap(np.arctan2(history["q"][:, i + 4], history["q"][:, i + 3]))


def passages(caplog):
    """Each of them is logged; a warning says the first one."""
    return [r.getMessage() for r in caplog.records if "singular position" in r.getMessage()]


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.01, 0.07])
@integrators
@treatments
def test_a_parallelogram_passes_its_flat_positions(integrator, treatment, step, caplog):
    """It stays one; a warning for the first passage, and each is logged with time and joints."""
    caplog.set_level(logging.INFO, logger="skfem_cosserat")
    system = linkage(PARALLELOGRAM, 1.0).freeze()
    pair = integrator, treatment
    with pytest.warns(sc.AccuracyWarning, match="has passed a singular position"):
        history = sc.simulate(system, *pair, step, 2.1, start=spinning(system, -3.0))
    assert len(history.meta["warnings"]) == 1
    assert history["joint/pin 0/angle"][-1] == pytest.approx(-6.3, rel=1e-2)
    i = system.frame_place("coupler")
    assert abs(history["q"][:, i + 3 : i + 6] - (1, 0, 0)).max() < 1e-9
    assert history["constraint_violation"].max() < 1e-12
    assert np.ptp(history["energy"]) < 1e-9 * history["energy"][0]  # each bar's own is constant
    texts = passages(caplog)
    assert len(texts) == 2, texts
    for text, angle in zip(texts, (1.0, 1.0 + np.pi), strict=True):
        time = float(text.split("t = ")[1].split(" s")[0])
        assert 0 <= time - angle / 3 < 1.05 * step


# passes singular positions, or stops in one
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize("off", [0.0, 3e-8, -5e-6, 3e-4])
@integrators
@treatments
def test_a_crossing_of_branches_is_passed_smoothly(integrator, treatment, off):
    """Also where a step ends in it, or so near that the two branches can hardly be told apart.

    The one it came along goes on: rocker and crank keep their speeds. Exactly there, constraints
    that meet at a point of both branches say where it is to the root of round-off only.
    """
    theta = CROSSED[integrator.name]
    system = linkage(CHANGE_POINT, theta + off).freeze()
    pair = integrator, treatment
    start = spinning(system, 3.0)
    history = sc.simulate(system, *pair, 0.02, 0.4, start=start)
    crank = theta + off + turn(system, history, "crank") - np.pi
    assert crank[9] < -0.04  # before,
    assert abs(crank[10]) < 1e-6 + 7 * abs(off)  # in, to the root of rounding,
    assert crank[11] > 0.04  # and behind the crossing
    for name in ("crank", "rocker"):
        bend = abs(np.diff(turn(system, history, name), 2))[7:13]
        assert bend.max() < 1.5e-3, (name, bend)
    # with multipliers and the variational scheme the position may come to lie on the other branch
    by_rows = treatment.name == "multipliers"
    bound = 1e-4 if by_rows and abs(off) < 1e-6 else 1e-6
    assert abs(np.diff(history["energy"])).max() < bound * history["energy"][0]
    assert history["constraint_violation"].max() < 1e-12


# passes singular positions, or stops in one
@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@integrators
@treatments
def test_a_run_goes_on_from_a_singular_position(integrator, treatment):
    """Stopped in the crossing and started again: along the branch of its momentum."""
    system = linkage(CHANGE_POINT, CROSSED[integrator.name]).freeze()
    pair = integrator, treatment
    whole = sc.simulate(system, *pair, 0.02, 0.4, start=spinning(system, 3.0))
    first = whole.truncated(11)
    rest = sc.simulate(*(system, *pair, 0.02, 0.4), start=sc.restart(system, first, pair[0], 0.02))
    assert rest["step"][0] == 10
    assert abs(rest["q"] - whole["q"][10:]).max() < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("lengths", [PARALLELOGRAM, CHANGE_POINT], ids=["parallelogram", "change"])
@integrators
@treatments
def test_a_reference_in_a_singular_position(lengths, integrator, treatment):
    """Its rank is that of the positions beside it; it starts along the branch of its momentum."""
    theta = 0.0 if lengths is PARALLELOGRAM else np.pi
    with pytest.warns(sc.ModelWarning, match="is a singular position"):
        system = linkage(lengths, theta).freeze()
    (said,) = system.warnings
    assert "1 of its constraint rows are independent there, 2 beside it" in said["text"]
    assert system.counts() == {"n": 36, "m": 38, "rank": 35, "unknowns": 1}
    assert sum(map(len, system.redundancies().values())) == 3
    # the velocity of the regular linkage beside it, which is on one of the two branches
    ends = []
    for bend in (1.0, -1.0):
        near = linkage(lengths, theta + 1e-3, bend=bend).freeze()
        wanted = sc.project(system, system.q0, rates(near, 3.0))
        start = sc.initial_state(system, v=wanted)
        with pytest.warns(sc.AccuracyWarning, match="is in a singular position"):
            history = sc.simulate(system, integrator, treatment, 0.01, 0.3, start=start)
        assert history.meta["warnings"][0] == said  # that of the scene
        assert np.ptp(history["energy"]) < 2e-3 * history["energy"][0]
        assert history["constraint_violation"].max() < 1e-12
        for name in ("crank", "rocker"):
            rate = np.diff(turn(system, history, name))[0] / 0.01
            assert rate == pytest.approx(wanted[system.frame_place(name) + 4], rel=0.05)
        ends.append(history["q"][-1])
    assert abs(ends[0] - ends[1]).max() > 0.1  # two branches


# its reference is a singular position
@pytest.mark.filterwarnings("ignore::skfem_cosserat.ModelWarning")
def test_a_straight_chain_that_only_seems_to_move():
    """Two bars between supports as far apart as they are long: no motion, whatever rows say."""
    model = hinges([(0, 0, 0), (1, 0, 0), (2, 0, 0)], 2)
    with pytest.raises(sc.InputError, match=r"mobility is zero: 24 coordinates and 24 independent"):
        model.freeze()


def test_an_open_configuration_is_refused():
    """The tree's joints hold, the loop is open: the joint that closes it is named."""
    system = frozen("slides and cardan")
    q = random_state(system, np.random.default_rng(0))
    words = r"q at t = 0 s violates the constraint of the .*'joint"
    with pytest.raises(sc.InputError, match=words):
        sc.initial_state(system, q=q)


# -- compiled kernels ------------------------------------------------------------------------------


@pytest.mark.slow
@scenes
@integrators
def test_kernels_agree(scene, integrator):
    """The same motion and forces, with the iterations of one Newton method for all equations."""
    pytest.importorskip("numba")
    system = frozen(scene)
    start = started(system)
    plain, *compiled = [
        sc.simulate(
            system, integrator, sc.NullSpace(), 0.01, 0.1, start=start,
            derive=False, kernels=kernels, settings=sc.NewtonSettings(reuse=reuse),
        )
        for kernels, reuse in (("numpy", 0), ("numba", 0), ("numba", 4))
    ]  # fmt: skip
    for run in compiled:
        assert run.meta["kernels"] == "numba" and run["attempts"].max() == 1
        assert abs(run["q"] - plain["q"]).max() < 1e-12
        assert abs(run["p"] - plain["p"]).max() < 1e-10 * abs(plain["p"]).max()
        force = plain["constraint_force"][:-1]
        difference = run["constraint_force"][:-1] - force
        assert abs(difference).max() < 1e-8 * abs(force).max()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:argument step")
def test_a_step_with_closed_loops_that_flips_a_body_is_none():
    """At large steps forces of loops without bound turned a crank by 180 degrees in each step."""
    pytest.importorskip("numba")
    model = four_bar()
    model.add("gravity", sc.LoadGravity((1.0, -9.81, 0)))
    push = sc.Table([0, 0.03, 0.031, 1], [0, 5.0, 0, 1])
    model.add("push", sc.LoadForce(model["coupler"].at((1, 1.25, 0)), (0, 1.0, 0), push))
    system = model.freeze()
    v = 0.5 * system.length * np.random.default_rng(0).standard_normal(system.n)
    start = sc.initial_state(system, v=sc.project(system, system.q0, v))
    plain, *compiled = [
        sc.simulate(
            system, sc.EnergyMomentum(), sc.NullSpace(), 0.3, 6.0, start=start, derive=False,
            kernels=kernels, settings=sc.NewtonSettings(reuse=reuse),
        )
        for kernels, reuse in (("numpy", 0), ("numba", 0), ("numba", 4))
    ]  # fmt: skip
    for run in compiled:
        assert abs(run["q"] - plain["q"]).max() < 1e-10


SPEED = 30.0


def outcome(system, start, integrator, turn, kernels):
    """History, why it ended, and what was warned of."""
    step = turn / SPEED
    run = integrator, sc.NullSpace(), step, round(6.5 / turn) * step
    try:
        history, end = sc.simulate(system, *run, start=start, kernels=kernels), None
    except sc.Diverged as error:
        history, end = error.history, (error.time, error.step)
    assert history.meta["kernels"] == kernels
    # which of several bodies that turn alike is named is a matter of rounding
    told = [each for each in history.meta["warnings"] if each["item"] != "argument step"]
    return history, end, [(each["when"], each["text"]) for each in told]


# large steps over singular positions
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize(
    ("lengths", "scheme", "turn", "ends"),
    [
        *((PARALLELOGRAM, INTEGRATORS[1], turn, True) for turn in (0.2, 1.3)),
        (CHANGE_POINT, INTEGRATORS[1], 0.2, True),
        (PARALLELOGRAM, INTEGRATORS[0], 0.2, True),
        (PARALLELOGRAM, INTEGRATORS[0], 1.3, False),
        *((CHANGE_POINT, INTEGRATORS[0], turn, turn < 0.4) for turn in (0.2, 0.9)),
    ],
)
def test_kernels_agree_in_large_steps_over_singular_positions(lengths, scheme, turn, ends):
    """Steps of `turn` rad of the crank: the same motion, the same warnings, the same failure.

    Compiled steps choose the rows that close a loop only after some motion: whatever a step jumps
    over must be met, told and survived as it is by plain kernels, which choose them in every step.
    """
    pytest.importorskip("numba")
    theta, speed = (1.0, -SPEED) if lengths is PARALLELOGRAM else (np.pi - 0.3, SPEED)
    system = linkage(lengths, theta).freeze()
    run = system, spinning(system, speed), scheme, turn
    plain, compiled = (outcome(*run, kernels) for kernels in ("numpy", "numba"))
    assert len(compiled[0]) == len(plain[0])
    assert abs(compiled[0]["q"] - plain[0]["q"]).max() < 1e-10
    assert compiled[1] == plain[1]
    assert compiled[2] == plain[2]
    assert (plain[1] is None) is ends
    if ends:
        assert any("singular position" in text for _, text in plain[2])
        assert compiled[0]["constraint_violation"].max() < 1e-11
