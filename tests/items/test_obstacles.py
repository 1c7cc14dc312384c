"""Obstacles: impacts keep the energy, sliding has its closed forms, kernels and surfaces agree."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import skfem_cosserat as sc

KERNELS = "numpy", "numba"
FLOOR = sc.Plane((0, 0, 0), (0, 0, 1))
SECTION = sc.Section((1e4, 1e4, 1e4, 5.0, 5.0, 5.0), mass=1.0, inertia=(1e-3, 1e-3))


def fallen(item, obstacle, *others, gravity=(0, 0, -9.81)):
    """A scene of one item that meets an obstacle, ``obstacle(item)``."""
    model = sc.Model()
    model.add("item", item)
    model.add("gravity", sc.LoadGravity(gravity))
    model.add("floor", obstacle(item))
    return model


def total(run):
    return run["energy"] + run["external"]


def bouncing(scheme, kernels="numba", until=1.3):
    """A point that falls by 0.1 mm, again and again; impacts take three steps."""
    point = sc.MassPoint(0.5, position=(0, 0, 1e-4))
    model = fallen(point, lambda point: sc.Obstacle(FLOOR, point, 5e5))
    return sc.simulate(model, scheme, sc.NullSpace(), 1e-3, until=until, kernels=kernels)


@pytest.mark.parametrize("kernels", KERNELS)
def test_a_hundred_impacts_keep_the_energy(kernels):
    run = bouncing(sc.EnergyMomentum(), kernels)
    touches = run["coupling/floor/0/force"] < 0
    assert (np.diff(touches.astype(int)) == 1).sum() >= 100
    assert np.ptp(total(run)) < 1e-10 * 0.5 * 9.81 * 1e-4


def test_a_variational_scheme_errs_in_impacts():
    """Its error is no rounding: in each impact it is another."""
    with pytest.warns(sc.AccuracyWarning, match="balance of energy"):
        run = bouncing(sc.Variational(), until=0.2)
    assert np.ptp(total(run)) > 1e-3 * 0.5 * 9.81 * 1e-4


def test_a_rod_that_falls_and_bounces_keeps_the_energy():
    mesh = sc.MeshCurve.init_line((0, 0, 0.05), (0.98, 0, 0.25), 4)
    rod, found = sc.Beam(mesh, SECTION, director=(0, 1, 0)), []
    model = fallen(rod, lambda beam: sc.Obstacle(FLOOR, beam, 1e5))
    for treatment in (sc.NullSpace(), sc.Multipliers()):
        run = sc.simulate(model, sc.EnergyMomentum(), treatment, 1e-3, until=0.3, kernels="numba")
        assert np.ptp(total(run)) < 1e-10 * abs(total(run)[0])
        assert run["coupling_energy"].max() > 0.1
        found.append(run["q"])
    assert_allclose(*found, rtol=0, atol=1e-9)


def test_a_beam_presses_by_its_length_on_any_mesh():
    """It lies on the floor as deep as its weight per length asks for, also refined."""
    beam = sc.Beam(
        sc.MeshCurve.init_line((0, 0, -1e-3), (1, 0, -1e-3), 2, name="rod"),
        SECTION, order=2, director=(0, 1, 0),
    )  # fmt: skip
    model = fallen(beam, lambda beam: sc.Obstacle(FLOOR, [beam], 1e4, radius=1e-3))
    guide = sc.JointPrismatic(sc.ground((0, 0, 0)), beam.node("rod.start"), axis=(0, 0, 1))
    model.add("guide", guide)
    for scene in (model, model.with_items({"item": beam.refined(1)})):
        path = sc.static(scene, factors={"gravity": 1.0})
        depth = 1e-3 - path.position(scene["item"], s=[0, 0.3, 1])[-1, :, 2]
        assert_allclose(depth, 9.81 / 1e4, rtol=1e-9)


def away(x, axes=(0, 1, 2)):
    """Distance from the centre of the spheres below, or the axis of the cylinders."""
    r = (x - (0.1, 0.05, -1.0))[:, axes]
    return np.sqrt((r * r).sum(-1))


SLOPE, CENTRE, Y, XZ = np.array([0.6, 0.0, 0.8]), (0.1, 0.05, -1.0), (0, 1, 0), (0, 2)
SURFACES = {
    "plane": (sc.Plane((0, 0, -0.02), SLOPE), lambda x: (x - (0, 0, -0.02)) @ SLOPE),
    "ball": (sc.Sphere(CENTRE, 0.95), lambda x: away(x) - 0.95),
    "hollow": (sc.Sphere(CENTRE, 1.1, inside=True), lambda x: 1.1 - away(x)),
    "bar": (sc.Cylinder(CENTRE, Y, 0.95), lambda x: away(x, XZ) - 0.95),
    "tube": (sc.Cylinder(CENTRE, Y, 1.1, inside=True), lambda x: 1.1 - away(x, XZ)),
}


@pytest.mark.parametrize(
    ("kernels", "treatment"), [("numpy", sc.NullSpace()), ("numba", sc.Multipliers())], ids=KERNELS
)
@pytest.mark.parametrize("name", SURFACES)
def test_surfaces_are_those_of_their_gaps(name, treatment, kernels):
    """A point with a radius, with friction; a variational scheme has no part of its own in it."""
    up = 1.0 if SURFACES[name][0].radius != 1.1 else -1.0

    def run(surface, scheme):
        point = sc.MassPoint(0.5, position=(0, 0, 0.05), velocity=(0.5, 0.2, 0))
        model = fallen(
            point,
            lambda point: sc.Obstacle(
                surface, point, 1e3, friction=0.3, slip_speed=0.01, radius=0.01
            ),
            gravity=(0, 0, -10.0 * up),
        )
        return sc.simulate(model, scheme, treatment, 4e-3, until=0.16, kernels=kernels)

    runs = [run(surface, sc.Variational()) for surface in SURFACES[name]]
    assert abs(runs[0]["load/floor/friction/force"]).max() > 1.0
    assert_allclose(runs[0]["q"], runs[1]["q"], rtol=0, atol=1e-9)
    exact = run(SURFACES[name][1], sc.EnergyMomentum())
    assert_allclose(exact["energy_balance"], 0.0, rtol=0, atol=1e-11)


def test_places_and_bodies_have_their_points():
    ball = sc.RigidBody.sphere(1.0, radius=0.2, position=(0, 0, 1))
    (touch,) = sc.Obstacle(FLOOR, ball, 1e3, radius=0.01).pieces()
    assert touch.neutral[0] == pytest.approx(0.21)
    box = sc.RigidBody.box(1.0, (1, 2, 3))
    corners = [touch.b.position.tolist() for touch in sc.Obstacle(FLOOR, box, 1e3).pieces()]
    assert len(corners) == 8
    assert [0.5, -1.0, 1.5] in corners


@pytest.mark.parametrize("friction", [0.3, 0.9])
def test_a_block_on_a_slope_slides_or_creeps(friction):
    """With ``g (sin a - mu cos a)``, or the speed at which regularised friction holds it."""
    g, slow, k, c = 9.81, 0.01, 1e5, 300.0
    a = np.arctan(0.5)
    along, normal = np.array([np.cos(a), 0, -np.sin(a)]), np.array([np.sin(a), 0, np.cos(a)])
    depth = g * np.cos(a) / (4 * k)  # four corners of 1 kg
    block = sc.RigidBody.box(
        1.0, (0.2, 0.2, 0.01), position=(0.005 - depth) * normal,
        triad=[along, (0, 1, 0), normal],
    )  # fmt: skip
    law = {"damping": c, "friction": friction, "slip_speed": slow}
    model = fallen(block, lambda block: sc.Obstacle(sc.Plane((0, 0, 0), normal), block, k, **law))
    run = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 2e-3, until=0.6)
    speed = run.velocity(block.at(block.position)) @ along
    assert_allclose(run["energy_balance"], 0.0, rtol=0, atol=1e-10)
    if friction < 0.5:
        half = len(speed) // 2
        rate = (speed[-1] - speed[half]) / (run.times[-1] - run.times[half])
        assert rate == pytest.approx(g * (np.sin(a) - friction * np.cos(a)), rel=1e-3)
    else:
        s = 0.5 / friction
        assert speed[-1] == pytest.approx(slow * s / np.sqrt(1 - s * s), rel=1e-6)


def test_a_rope_slips_on_a_drum_with_the_ratio_of_euler_and_eytelwein():
    """A chain over half a turn, pulled slowly against a weight: tensions differ by e^(mu pi)."""
    mu, radius, weight = 0.3, 0.1, 10.0
    turn = np.linspace(0, np.pi, 25)
    arc = radius * np.column_stack([np.cos(turn), 0 * turn, np.sin(turn)])
    tail = np.array([3, 2, 1])[:, None] * (0, 0, -0.013)
    points = np.vstack([arc[0] + tail, arc, arc[-1] + tail[::-1]])
    model = sc.Model()
    chain = [model.add(f"bead {k}", sc.MassPoint(1e-3, x)).place() for k, x in enumerate(points)]
    for k in range(len(chain) - 1):
        model.add(f"link {k}", sc.SpringDamper(chain[k], chain[k + 1], 1e5, 5.0))
    load = sc.LoadForce(chain[0], (0, 0, -weight), sc.RampSmooth(0, 0.05))
    model.add("weight", load)
    pull = sc.Motion(displacement=lambda t: (0, 0, -0.05 * max(0.0, t - 0.05)))
    hand = sc.ground(points[-1] - (0, 0, 0.02), pull)
    model.add("pull", sc.SpringDamper(hand, chain[-1], 1e4, 5.0))
    drum = sc.Cylinder((0, 0, 0), (0, 1, 0), radius)
    model.add("drum", sc.Obstacle(drum, chain, 1e5, friction=mu, slip_speed=1e-3))
    run = sc.simulate(
        model, sc.GeneralizedAlpha(), sc.NullSpace(), 2e-3, until=0.3, kernels="numba"
    )
    ratio = run["coupling/pull/force"][-50:] / weight
    assert_allclose(ratio, np.exp(mu * np.pi), rtol=0.02)


def test_a_rod_pushed_through_a_tube_stays_inside():
    """It bends and rattles, and goes on as its mass and the push ask for."""
    tube = sc.Cylinder((0, 0, 0), (1, 0, 0), 0.02, inside=True)
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0.5, 0, 0.01), 6, name="rod")
    section = sc.Section((1e4, 1e4, 1e4, 1.0, 1.0, 1.0), mass=1.0, inertia=(1e-4, 1e-4))
    beam = sc.Beam(mesh, section, director=(0, 1, 0))
    model = fallen(beam, lambda beam: sc.Obstacle(tube, beam, 1e6, radius=0.005))
    model.add("push", sc.LoadForce(beam.node("rod.start"), (10.0, 0, 0)))
    run = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, until=0.3, kernels="numba")
    nodes = np.array([run.position(beam.node(k)) for k in range(7)])
    assert np.hypot(nodes[..., 1], nodes[..., 2]).max() < 0.0175
    assert nodes[:, -1, 0].mean() - nodes[:, 0, 0].mean() == pytest.approx(0.9, rel=0.02)
    assert np.ptp(total(run)) < 1e-9


def test_a_ball_lies_as_deep_as_its_weight_asks_for():
    for surface in (FLOOR, lambda x: x[:, 2], sc.Sphere((0, 0, 1), 1.0, inside=True)):
        point = sc.MassPoint(0.5, position=(0, 0, -1e-3))
        model = fallen(point, lambda point, on=surface: sc.Obstacle(on, point, 1e4))
        slide = sc.JointPointOnLine(sc.ground((0, 0, 0)), point.place(), axis=(0, 0, 1))
        model.add("slide", slide)
        path = sc.static(model, factors={"gravity": 1.0})
        assert path.position(point.place())[-1, 2] == pytest.approx(-0.5 * 9.81 / 1e4)


@pytest.mark.parametrize("kernels", KERNELS)
def test_the_middle_of_a_hollow_sphere_has_no_direction(kernels):
    """A point that rests there begins to fall, and is caught."""
    room = sc.Sphere((0, 0, 0), 0.1, inside=True)
    model = fallen(sc.MassPoint(1.0), lambda point: sc.Obstacle(room, point, 1e4))
    scheme, treatment = sc.EnergyMomentum(), sc.NullSpace()
    run = sc.simulate(model, scheme, treatment, 2e-3, until=0.3, kernels=kernels)
    assert -0.12 < run.position(model["item"].place())[:, 2].min() < -0.1


def test_planar_scenes_have_obstacles():
    """All points of a law are looked at together."""
    drum = sc.Cylinder((0, 0, -1.0 + 1e-4), (0, 1, 0), 1.0)
    beam = sc.Beam(
        sc.MeshCurve.init_line((-0.1, 0, 0), (0.1, 0, 0), 2), SECTION, director=(0, 0, 1)
    )
    model = fallen(beam, lambda beam: sc.Obstacle(drum, beam, 1e5, friction=0.3, slip_speed=0.01))
    setup = sc.EnergyMomentum(), sc.NullSpace(), 1e-3, 0.02
    runs = [sc.simulate(model.freeze(planar=flat), *setup) for flat in (None, sc.Planar())]
    assert_allclose(runs[0]["q"], runs[1]["q"], rtol=0, atol=1e-9)
    assert runs[0]["coupling_energy"].max() > 1e-4


POINT = sc.MassPoint(1.0)
HOLLOW = sc.Sphere((0, 0, 0), 1.0, inside=True)
BAD = [
    (lambda: sc.Plane((0, 0, 0), (0, 0, 0)), r"plane: normal = \[0.0, 0.0, 0.0\]"),
    (lambda: sc.Cylinder((0, 0, 0), (0, 0, 1), -1.0), "cylinder: radius = -1.0"),
    (lambda: sc.Obstacle(3, POINT, 1.0), "obstacle: surface = 3 failed: TypeError"),
    (lambda: sc.Obstacle(lambda x: x, POINT, 1.0), "obstacle: surface .* failed: ValueError"),
    (lambda: sc.Obstacle(FLOOR, POINT, 0.0), "obstacle: stiffness = 0.0"),
    (lambda: sc.Obstacle(FLOOR, POINT, 1.0, friction=-0.3), "obstacle: friction = -0.3"),
    (lambda: sc.Obstacle(FLOOR, POINT, 1.0, friction=0.3), "slip_speed = None, expected a pos"),
    (lambda: sc.Obstacle(FLOOR, [], 1.0), "obstacle: is against nothing"),
    (lambda: sc.Obstacle(HOLLOW, POINT, 1.0, radius=2.0), "no room for a radius of 2 m"),
    (lambda: sc.Obstacle(FLOOR, sc.ground((0, 0, 0)), 1.0), "obstacle: is against <Place: ground"),
    (lambda: sc.Obstacle(FLOOR, sc.RigidBody(1.0, (1, 1, 1)), 1.0), "the rigid body, expected a p"),
]


@pytest.mark.parametrize(("make", "text"), BAD, ids=[text for _, text in BAD])
def test_bad_input_is_named(make, text):
    with pytest.raises(sc.InputError, match=text):
        make()
