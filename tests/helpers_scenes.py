"""Scenes that several tests share: the swing, one with every item, random trees of joints."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skfem_cosserat import (
    Beam,
    FunctionOfTime,
    JointCylindrical,
    JointDistance,
    JointFixed,
    JointPlanar,
    JointPointOnLine,
    JointPrismatic,
    JointRevolute,
    JointSpherical,
    JointUniversal,
    LoadForce,
    LoadGravity,
    LoadLine,
    LoadMoment,
    MassPoint,
    MeshCurve,
    Model,
    Motion,
    Place,
    RigidBody,
    Section,
    System,
    Table,
    ground,
)
from skfem_cosserat.kernels import exp_quaternion, null_space_blocks, rotation_matrix
from skfem_cosserat.model.reparametrisation import Reparametrisation

sys.path.append(str(Path(__file__).resolve().parents[1] / "examples"))

from benchmarks import lattice as lattices
from paper import three_bar_swing

#: Full 6x6 stiffness with every coupling, of moderate size.
_COUPLING = np.random.default_rng(8).standard_normal((6, 6))
FULL = np.diag([40.0, 50.0, 90.0, 12.0, 15.0, 8.0]) + _COUPLING @ _COUPLING.T
#: Products of inertia, about the centre of mass (kg m^2).
TENSOR = np.array([[0.5, 0.06, -0.04], [0.06, 0.6, 0.09], [-0.04, 0.09, 0.45]])

IDENTITY = np.eye(3)


def chequered(
    one: str, ones: Sequence[Any], other: str, others: Sequence[Any], **options: Any
) -> pytest.MarkDecorator:
    """Every second pair of two parameters, as on a chequerboard; those left out are slow tests.

    So each value is there about as often as any other. Names and values may be of several
    parameters each, separated by commas and as tuples.
    """
    given = [(_parameter(one, a) for a in ones), (_parameter(other, b) for b in others)]
    (first, second), rows = map(list, given), []
    for i, a in enumerate(first):
        for j, b in enumerate(second):
            marks = [*a.marks, *b.marks, *[pytest.mark.slow] * ((i + j) % 2)]
            rows.append(pytest.param(*a.values, *b.values, marks=marks))
    return pytest.mark.parametrize(f"{one}, {other}", rows, **options)


def _parameter(names: str, value: Any) -> Any:
    """A value of one or several parameters, perhaps with marks, as pytest has it."""
    if hasattr(value, "marks"):
        return value
    return pytest.param(*value) if "," in names else pytest.param(value)


#: integrators and treatments, each value once; the other two among the slow tests
pairs = chequered(
    "integrator", ["variational", "energy-momentum"], "treatment", ["null space", "multipliers"]
)


def shaking(t: float) -> tuple[float, float, float]:
    """A displacement."""
    return 0.1 * np.sin(2 * t), 0.2 * t**2, -0.05 * t


def rocking(t: float) -> tuple[float, float, float]:
    """A rotation vector."""
    return 0.3 * np.sin(t), 0.2 * t, -0.4 * t**2


def waving(t: float) -> float:
    """An amplitude."""
    return 1 + np.cos(3 * t)


def growing(t: float) -> tuple[float, float, float]:
    """A force."""
    return t, 1, t**2


def twisting(t: float) -> tuple[float, float, float]:
    """A moment."""
    return 1, t, 2


SHAKE = Motion(displacement=shaking, rotation=rocking)


def rotation(rng: np.random.Generator, size: float = 1.0) -> np.ndarray:
    """Rotation matrix by a random rotation vector with deviations `size` (rad)."""
    return rotation_matrix(exp_quaternion(size * rng.standard_normal((1, 3))))[0]


def unit(rng: np.random.Generator) -> np.ndarray:
    """Random unit vector."""
    v = rng.standard_normal(3)
    return v / np.linalg.norm(v)


#: Every joint, with the number of motions it leaves free between two bodies.
JOINTS: dict[type, int] = {
    JointSpherical: 3,
    JointRevolute: 1,
    JointCylindrical: 2,
    JointPrismatic: 1,
    JointPlanar: 3,
    JointUniversal: 2,
    JointFixed: 0,
    JointDistance: 5,
    JointPointOnLine: 4,
}
#: Those that hold a mass point; the last one only on side b.
POINT_JOINTS = (JointSpherical, JointDistance, JointPointOnLine)


def fitting(kind: type, rng: np.random.Generator) -> tuple[dict[str, Any], np.ndarray]:
    """Random axes of a joint, and where the other point may be seen from the first."""
    n, m = unit(rng), unit(rng)
    across = np.cross(n, m) / np.linalg.norm(np.cross(n, m))
    if kind is JointUniversal:
        return {"axis_a": n, "axis_b": across}, np.zeros(3)
    if kind is JointPlanar:
        return {"normal": n, "x": across}, rng.standard_normal() * np.cross(
            n, across
        ) + 0.3 * across
    if kind in (JointCylindrical, JointPrismatic, JointPointOnLine):
        return {"axis": n}, rng.standard_normal() * n
    if kind is JointRevolute:
        return {"axis": n}, np.zeros(3)
    return {}, rng.standard_normal(3) if kind is JointDistance else np.zeros(3)


def full_section() -> Section:
    """Section with a full stiffness and unequal inertias."""
    return Section(FULL, mass=1.3, inertia=(0.11, 0.07))


def swing(elements: int = 20) -> System:
    """The three-bar swing of Leyendecker, Marsden & Ortiz (2008), published section."""
    return swing_model(elements).freeze()


def swing_model(elements: int = 20) -> Model:
    """The scene of :func:`swing`, not frozen: that of examples/three_bar_swing.py."""
    return three_bar_swing.scene(elements=elements)


class _Builder:
    """Adds joints either way round."""

    def __init__(self, rng: np.random.Generator, swap: Callable[[], bool]) -> None:
        self.model, self.rng, self.swap, self.count = Model(), rng, swap, 0

    def join(self, kind: type, a: Place, b: Place, **options: Any) -> None:
        if self.swap():
            a, b = b, a
        self.count += 1
        self.model.add(f"joint {self.count}", kind(a, b, **options))

    def body(self, name: str, position: Any, full: bool = True) -> RigidBody:
        shape = {"inertia": TENSOR, "center": (0.1, -0.2, 0.15)} if full else {"euler": (1, 2, 3)}
        R = rotation(self.rng).T
        return self.model.add(name, RigidBody(1.5, position=position, triad=R, **shape))


def everything(order: int = 1, swapped: bool = False, loads: bool = True) -> System:
    """Every item: curved beam, network, bodies, points, lumps, all joints, all loads."""
    return model_of_everything(order, swapped, loads).freeze()


def model_of_everything(order: int = 1, swapped: bool = False, loads: bool = True) -> Model:
    """The scene of :func:`everything`, not frozen."""
    rng = np.random.default_rng(order)
    build = _Builder(rng, lambda: swapped)
    model = build.model
    arc = MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0.3), 1.5, 1.0, 2, "arc")
    curved = model.add("curved", Beam(arc, full_section(), order=order, twist=0.4))
    frame = model.add("frame", Beam(_corner(), _two_sections(), order=order))
    build.join(JointRevolute, ground((0, 0, 0), SHAKE), curved.node("arc.start"), axis=unit(rng))
    end = curved.node("arc.end")
    chain = _chain(build, end)
    _second_chain(build)
    model.add("lump", MassPoint(0.4, on=frame.node("leg.end")))
    hub = RigidBody(0.7, TENSOR, center=(0.05, 0.1, -0.1), on=frame.node("corner"))
    model.add("hub", hub)
    corner = frame.node("corner").position
    model.add("tool", MassPoint(0.3, on=hub.at(corner + np.array([0.2, 0.1, 0.3]))))
    model.add("cup", RigidBody.cylinder(0.2, 0.1, 0.3, on=chain.at((0.3, 0.1, 2.0))))
    if loads:
        _loads(model, curved, frame, chain, hub)
    return model


def _corner() -> MeshCurve:
    """Three beams that meet at a node under angles."""
    base = MeshCurve.init_line((0, 0, -1), (1, 0, -1), 2, "base")
    leg = MeshCurve.init_line((1, 0, -1), (1, 0.8, -1.4), 1, "leg")
    arm = MeshCurve.init_arc((1, 0, -1), (0, 0, -1), (1, 0, 0), 1.0, 0.7, 1, "arm")
    return base.joined(leg, arm).with_nodes({"corner": (1, 0, -1)})


def _two_sections() -> dict[str, Section]:
    slim = Section([30, 35, 60, 4, 5, 3], mass=0.8, inertia=(0.02, 0.03))
    return {"base": full_section(), "leg": slim, "arm": slim}


def _chain(build: _Builder, start: Place) -> RigidBody:
    """A chain of depth 6 that mixes all joints; gives its third body."""
    rng, model = build.rng, build.model
    x = start.position

    def at(*shift: float) -> np.ndarray:
        return x + np.array(shift)

    one = build.body("one", at(0.2, 0.1, 0))
    two = build.body("two", at(0.5, 0, 0.2))
    three = build.body("three", at(0.8, 0.3, 0), full=False)
    four = build.body("four", at(1.2, 0, 0))
    five = build.body("five", at(1.5, 0.2, 0.1))
    build.join(JointSpherical, start, one.at(x))
    build.join(JointRevolute, one.at(at(0.3, 0, 0)), two.at(at(0.3, 0, 0)), axis=unit(rng))
    build.join(JointFixed, two.at(at(0.6, 0, 0)), three.at(at(0.6, 0, 0)))
    build.join(JointDistance, three.at(at(0.9, 0, 0.2)), four.at(at(1.1, 0.3, 0)))
    build.join(JointRevolute, four.at(at(1.4, 0, 0)), five.at(at(1.4, 0, 0)), axis=unit(rng))
    point = model.add("point", MassPoint(0.6, at(1.9, 0, 0.3)))
    build.join(JointSpherical, five.at(point.position), point.place())
    bob = model.add("bob", MassPoint(0.5, at(2.1, 0.4, 0)))
    build.join(JointDistance, point.place(), bob.place())
    tail = build.body("tail", at(2.3, 0.4, 0))
    build.join(JointSpherical, bob.place(), tail.at(bob.position))
    return three


def _second_chain(build: _Builder) -> None:
    """From moving ground, from ground at rest, and a free tree."""
    rng, model = build.rng, build.model
    x = np.array([0.0, 0.0, 3.0])

    def at(*shift: float) -> np.ndarray:
        return x + np.array(shift)

    six = build.body("six", at(0.1, 0, 0))
    seven = build.body("seven", at(0.4, 0, 0))
    eight = build.body("eight", at(0.7, 0.1, 0.3))
    nine = build.body("nine", at(1.0, 0.1, 0))
    build.join(JointFixed, ground(x, SHAKE), six.at(x))
    build.join(JointRevolute, six.at(at(0.2, 0, 0)), seven.at(at(0.2, 0, 0)), axis=unit(rng))
    build.join(JointDistance, seven.at(at(0.5, 0, 0)), eight.at(at(0.6, 0.2, 0.2)))
    build.join(JointFixed, eight.at(at(0.8, 0, 0)), nine.at(at(0.8, 0, 0)))
    dangling = model.add("dangling", MassPoint(0.9, x - (0, 0, 0.7)))
    build.join(JointDistance, ground(x, SHAKE), dangling.place())
    door = build.body("door", (-1, 0.2, 0))
    build.join(JointRevolute, ground((-1, 0, 0)), door.at((-1, 0, 0)), axis=unit(rng))
    rod = model.add("rod", RigidBody.rod(1.0, 0.5, position=(-2, 0, 0)))
    build.join(JointRevolute, ground((-2, 0, 0.2)), rod.at((-2, 0, 0.2)), axis=(1.0, 0, 0))
    free = build.body("free", (-3, 0, 0))
    tied = build.body("tied", (-3, 0.4, 0))
    build.join(JointRevolute, free.at((-3, 0.1, 0)), tied.at((-3, 0.1, 0)), axis=unit(rng))
    sphere = build.body("pendulum", (-4, 0, 0))
    build.join(JointSpherical, ground((-4, 0, 0.5), SHAKE), sphere.at((-4, 0, 0.5)))
    kite = build.body("kite", (-5, 0, 0))
    build.join(JointDistance, ground((-5, 0.3, 1)), kite.at((-5, 0, 0.2)))
    model.add("stone", MassPoint(0.2, (5, 5, 5)))


def _loads(model: Model, curved: Beam, frame: Beam, body: RigidBody, hub: RigidBody) -> None:
    wave = FunctionOfTime(waving)
    ramp = Table([0.0, 0.4, 2.0], [0.2, 1.0, 0.5])
    place = body.at((0.4, 0.5, 2.1))
    node = curved.node("arc.end")
    model.add("gravity", LoadGravity((0.3, -0.2, -9.81), wave))
    model.add("dead force", LoadForce(place, (1, 2, 3), ramp))
    model.add("dead force on a node", LoadForce(frame.node("arm.end"), growing))
    model.add("follower force", LoadForce(place, (-2, 1, 3), wave, follower=True))
    model.add("follower on a node", LoadForce(node, (2, 1, -1), follower=True))
    model.add("follower on a lump", LoadForce(hub.at((1.2, 0, -1)), (0, 2, 1), follower=True))
    model.add("moment", LoadMoment(place, (1, -1, 2), ramp))
    model.add("moment on a node", LoadMoment(frame.node("corner"), (3, 1, 2)))
    model.add("follower moment", LoadMoment(node, (1, 2, -3), wave, follower=True))
    model.add("follower moment on a body", LoadMoment(place, twisting, follower=True))
    model.add("line", LoadLine(curved, (1, 0, -2), ramp))
    model.add("wind", LoadLine(frame, (0.5, 1, 0.3), wave, follower=True, part="leg"))
    model.add("pressure", LoadLine(curved, (2.0, -1.0, 0.5), follower=True))
    model.add("force on a point", LoadForce(model["point"].place(), (1, 1, 1)))


def random_tree(seed: int, depth: int = 6) -> System:
    """A random tree of bodies and points, at least `depth` joints deep, of all nine joints."""
    rng = np.random.default_rng(seed)
    build = _Builder(rng, lambda: bool(rng.integers(2)))
    model = build.model
    beam = MeshCurve.init_line((0, 0, 5), (1, 0, 5), 1)
    holder = model.add("beam", Beam(beam, full_section()))
    root = build.body("root", rng.standard_normal(3))
    levels: list[list[Any]] = [
        [
            root,
            holder.node("beam.end"),
            ground(rng.standard_normal(3), SHAKE),
            ground(rng.standard_normal(3)),
        ]
    ]
    for k in range(depth):
        below = []
        for i in range(3):
            parent = levels[-1][int(rng.integers(len(levels[-1])))]
            is_point = bool(rng.integers(4) == 0) and (k == depth - 1 or i > 0)
            below.append(_grow(build, parent, f"item {k}.{i}", is_point))
        levels.append(below)
    return model.freeze()


def _grow(build: _Builder, parent: Any, name: str, is_point: bool) -> Any:
    rng = build.rng
    x = rng.standard_normal(3)
    if isinstance(parent, Place):
        side, x = parent, parent.position
    elif isinstance(parent, MassPoint):
        side, x = parent.place(), parent.position
    else:
        side = parent.at(x)
    from_point = isinstance(parent, MassPoint)
    kinds = list(POINT_JOINTS if is_point or from_point else JOINTS)
    if is_point and from_point:
        kinds.remove(JointPointOnLine)
    kind = kinds[int(rng.integers(len(kinds)))]
    options, gap = fitting(kind, rng)
    if is_point:
        item = build.model.add(name, MassPoint(1.0, x + gap))
        other = item.place()
    else:
        item = build.body(name, rng.standard_normal(3))
        other = item.at(x + gap)
    if kind is JointPointOnLine and (is_point or from_point):
        frame, point = (side, other) if is_point else (other, side)
        build.model.add(f"line {name}", kind(frame, point, **options))
    else:
        build.join(kind, side, other, **options)
    return item


def random_state(
    system: System, rng: np.random.Generator, t: float = 0.0, size: float = 0.3
) -> Any:
    """A configuration (n,) at time t that fulfils all constraints, by random increments."""
    nodal = Reparametrisation(system.kinematics)
    nodal.begin(system.extend(system.q0, 0.0), system.ground(t))
    nodal.add(size * rng.standard_normal(system.kinematics.unknowns))
    return nodal.configuration()[: system.rows].ravel()


def null_space(system: System, y: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Dense ``P(y)`` (n, unknowns) with the axes `fixed` of a reparametrisation."""
    kin = system.kinematics
    T = kin.T.matrix(kin.values_at(y, fixed)).toarray()
    P = np.zeros((system.n, kin.unknowns))
    blocks = null_space_blocks(kin.directors(y))
    for k, row in enumerate(kin.frame_rows):
        P[3 * row : 3 * row + 12] = blocks[k] @ T[kin.frame_twist[k]]
    for k, v in enumerate(kin.points):
        P[3 * kin.row[v] : 3 * kin.row[v] + 3] = T[kin.point_twist[k]]
    return P


def assert_null_space(system: System, y: np.ndarray, fixed: np.ndarray) -> None:
    """``P(y)`` spans all rates that the rows leave free: G P = 0, and ranks add up to n."""
    G, P = system.constraints.jacobian(y).toarray(), null_space(system, y, fixed)
    assert abs(G @ P).max() <= 1e-12 * abs(G).max() * abs(P).max()
    assert np.linalg.matrix_rank(P) == P.shape[1] == system.unknowns
    assert np.linalg.matrix_rank(G) == system.n - system.unknowns == system.rank


def two_states(
    system: System, seed: int = 3, size: float = 0.7
) -> tuple[np.ndarray, np.ndarray, Reparametrisation]:
    """Two configurations far from the reference and from each other, and the way between."""
    rng = np.random.default_rng(seed)
    nodal = Reparametrisation(system.kinematics)
    nodal.begin(system.extend(system.q0, 0.0), system.ground(0.3))
    for _ in range(3):
        nodal.add(size * rng.standard_normal(system.kinematics.unknowns))
    y0 = nodal.configuration()
    nodal.begin(y0, system.ground(0.5))
    for _ in range(2):
        nodal.add(0.5 * size * rng.standard_normal(system.kinematics.unknowns))
    return y0, nodal.configuration(), nodal


def assert_constraints(system: System, y: np.ndarray) -> None:
    """All rows hold, compared with the sizes of their terms."""
    size = np.maximum(system.constraints.magnitudes(y), 1.0)
    assert (abs(system.constraints.values(y)) / size).max() < 1e-13


def seen(system: System, place: Place, y: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Position of a place at a configuration (rows, 3), and its rotation since the reference."""
    r = system.row_of(place)
    if place.triad is None:
        return y[r], None
    directors = y[r + 1 : r + 4]
    return y[r] + place.offset @ directors, directors.T @ place.triad


def ball_on_rod(
    position: Sequence[float] = (0, 0, -1), velocity: Sequence[float] = (0, 0, 0), g: float = 10.0
) -> tuple[Model, MassPoint, JointDistance]:
    """A pendulum: a ball of 1 kg on a rod without mass, hung at the origin; the ball, the rod."""
    model = Model()
    bob = model.add("bob", MassPoint(1.0, position=position, velocity=velocity))
    rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    model.add("gravity", LoadGravity((0, 0, -g)))
    return model, bob, rod


def triangle(last: type = JointSpherical, **options: Any) -> Model:
    """Three bodies in a ring, hung at one corner: all joints spherical but the last."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0.2], [0.3, 1, 0]])
    model = Model()
    bodies = [
        model.add(
            f"bar {k}",
            RigidBody.box(1.0, (0.2, 0.3, 1.0), position=(corners[k] + corners[k - 1]) / 2),
        )
        for k in range(3)
    ]
    for k in range(3):
        kind = last if k == 2 else JointSpherical
        model.add(
            f"corner {k}",
            kind(
                bodies[k].at(corners[k]),
                bodies[(k + 1) % 3].at(corners[k]),
                **(options if k == 2 else {}),
            ),
        )
    model.add("hook", JointSpherical(ground(corners[0]), bodies[0].at(corners[0])))
    model.add("gravity", LoadGravity((0, 0, -9.81)))
    return model


def four_bar(
    kinds: tuple[type, ...] = (JointRevolute,) * 4,
    model: Model | None = None,
    z: float = 0.0,
    name: str = "",
    turned: np.ndarray = IDENTITY,
) -> Model:
    """A planar four-bar linkage in or above the xy plane: ground, crank, coupler, rocker.

    Or in the plane to which the rotation matrix `turned` takes it.
    """
    points = np.array([[0.0, 0, z], [0, 1, z], [2, 1.5, z], [2, 0, z]]) @ turned.T
    model = Model() if model is None else model
    shape: dict[str, Any] = {"edges": (0.2, 0.3, 0.4), "triad": turned.T}
    bars = [
        model.add(f"{own}{name}", RigidBody.box(1.0, position=points[k : k + 2].mean(0), **shape))
        for k, own in enumerate(("crank", "coupler", "rocker"))
    ]
    before = [ground(points[0]), *(bar.at(x) for bar, x in zip(bars, points[1:], strict=True))]
    after = [*(bar.at(x) for bar, x in zip(bars, points[:3], strict=True)), ground(points[3])]
    for k, (kind, a, b) in enumerate(zip(kinds, before, after, strict=True)):
        options = {} if kind is JointSpherical else {"axis": turned[:, 2]}
        model.add(f"pin {k}{name}", kind(a, b, **options))
    return model


def lattice_mesh(count: int, elements: int = 1, size: float = 0.1) -> MeshCurve:
    """That of examples/benchmarks/lattice.py."""
    return lattices.mesh(count, elements, size)


def lattice(count: int, elements: int = 1, order: int = 1) -> System:
    """That of examples/benchmarks/lattice.py: rubber rods, rigidly connected, clamped at a face."""
    return lattices.scene(count, elements, order)
