"""Random scenes for the advisor: pendulums of beams and bodies, stiff and soft ones in one."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from skfem_cosserat import (
    Beam,
    JointFixed,
    JointRevolute,
    JointSpherical,
    LoadForce,
    LoadGravity,
    MassPoint,
    Material,
    MeshCurve,
    Model,
    Place,
    RigidBody,
    SectionCircle,
    SensorPosition,
    Table,
    ground,
)

__all__ = ["KINDS", "RandomScene", "random_scene", "scene_of_kind"]

#: Young's moduli (Pa): six decades
SOFTEST, STIFFEST = 1e5, 1e11
RADIUS, DENSITY = 8e-3, 1200.0


class RandomScene(NamedTuple):
    """A scene and what is asked of it.

    Attributes
    ----------
    model : Model
    quantities : dict of str to SensorPosition
    tolerance : float
        (m)
    until : float
        (s)
    """

    model: Model
    quantities: dict[str, SensorPosition]
    tolerance: float
    until: float


def random_scene(seed: int) -> RandomScene:
    """One to four beams, none to three bodies, in a plane or not, hung up and let go.

    Each beam hangs at an end of what was there before, by a hinge, a ball or a weld; bodies hang
    at ends, too, or are lumps there. Gravity acts, and often a pulse. Asked for is the position of
    the last end within one per cent of the length of all beams.
    """
    rng = np.random.default_rng(seed)
    planar = bool(rng.random() < 0.5)
    model = Model()
    ends: list[tuple[Place, np.ndarray]] = [(ground((0.0, 0.0, 0.0)), np.array([1.0, 0.0, 0.0]))]
    total = 0.0
    for k in range(int(rng.integers(1, 5))):
        place, along = ends[-1]
        length = float(rng.uniform(0.3, 0.6))
        total += length
        tangent = _turned(rng, along, planar)
        start = place.position
        mesh = MeshCurve.init_line(start, start + length * tangent, 4, name=f"rod {k}")
        modulus = float(np.exp(rng.uniform(np.log(SOFTEST), np.log(STIFFEST))))
        section = SectionCircle(RADIUS, Material(modulus, 0.3, DENSITY))
        rod = model.add(f"rod {k}", Beam(mesh, section, director=(0.0, 1.0, 0.0)))
        _join(rng, model, f"joint {k}", place, rod.node(f"rod {k}.start"), first=k == 0)
        ends.append((rod.node(f"rod {k}.end"), tangent))
    tip = ends[-1][0]
    for k in range(int(rng.integers(0, 4))):
        _body(rng, model, f"body {k}", ends[int(rng.integers(1, len(ends)))][0])
    model.add("gravity", LoadGravity((0.0, 0.0, -9.81)))
    if rng.random() < 0.5:
        force = rng.uniform(-0.3, 0.3, 3) * (1.0, 0.0 if planar else 1.0, 1.0)
        model.add("pulse", LoadForce(tip, force, Table([0.0, 0.1, 0.2], [0.0, 1.0, 0.0])))
    return RandomScene(model, {"tip": SensorPosition(tip)}, 0.01 * total, 0.5)


def _turned(rng: np.random.Generator, along: np.ndarray, planar: bool) -> np.ndarray:
    """A direction near another one."""
    step = rng.uniform(-0.5, 0.5, 3) * (1.0, 0.0 if planar else 1.0, 1.0)
    return (along + step) / np.linalg.norm(along + step)


def _join(
    rng: np.random.Generator, model: Model, name: str, a: Place, b: Place, first: bool
) -> None:
    kind = int(rng.integers(0, 2 if first else 3))
    if kind == 2:
        model.add(name, JointFixed(a, b))
    elif kind == 1:
        model.add(name, JointSpherical(a, b))
    else:
        model.add(name, JointRevolute(a, b, axis=(0.0, 1.0, 0.0)))


def _body(rng: np.random.Generator, model: Model, name: str, place: Place) -> None:
    mass = float(rng.uniform(0.02, 0.2))
    if rng.random() < 0.5:
        model.add(name, MassPoint(mass, on=place))
        return
    edges = (0.03, 0.03, 0.1)
    body = RigidBody.box(mass, edges, position=place.position - (0.0, 0.0, 0.05))
    model.add(name, body)
    model.add(f"{name} hinge", JointRevolute(place, body.at(place.position), axis=(0.0, 1.0, 0.0)))


#: of scenes by :func:`scene_of_kind`
KINDS = ("cantilever", "pendulum", "free flight", "closed loop")


def scene_of_kind(seed: int) -> RandomScene:
    """Clamped, hung up, flying or closing a loop, from 0.1 to 10 m in size, materials of all kinds.

    One to four beams, joined by hinges, balls and welds, in the loop three by hinges; masses and
    welded bodies at their ends. Asked for is the position of the last end (of the loop's second
    beam) within 0.7 per cent of the scene's size for each beam, over 1.5 times the root of its size
    over g.
    """
    kind = KINDS[seed % len(KINDS)]
    rng = np.random.default_rng(1000 + seed)
    planar = bool(rng.random() < 0.5)
    size = float(10 ** rng.uniform(-1, 1))
    time = float(np.sqrt(size / 9.81))
    count = 3 if kind == "closed loop" else int(rng.integers(1, 5))
    model, at, along = Model(), np.zeros(3), np.array([1.0, 0.0, 0.0])
    rods: list[Beam] = []
    last = ground(at)
    for k in range(count):
        if kind == "closed loop":
            along = np.array([(0, 0, -1.0), (1.0, 0, 0), (0, 0, 1.0)])[k]
            length = size * (1.0 if k == 1 else 0.6)
        else:
            along = _turned(rng, along, planar)
            length = size * float(rng.uniform(0.4, 1.0))
        rod = model.add(f"rod {k}", _rod(rng, f"rod {k}", at, length * along, size))
        rods.append(rod)
        start, end = rod.node(f"rod {k}.start"), rod.node(f"rod {k}.end")
        if k or kind != "free flight":
            model.add(f"joint {k}", _joint(rng, kind, k, last, start))
        at, last = at + length * along, end
        if kind != "closed loop" and rng.random() < 0.4:
            _lump(rng, model, k, last, size)
    if kind == "closed loop":
        axis = {"axis": (0.0, 1.0, 0.0)}
        close = (
            JointRevolute(ground(at), last, **axis) if planar else JointSpherical(ground(at), last)
        )
        model.add("close", close)
        last = rods[1].node("rod 1.end")
    if kind == "free flight":
        weight = 1e3 * np.pi * (0.01 * size) ** 2 * size * 9.81
        pulse = Table([0.0, 0.3 * time, 0.6 * time], [0.0, 1.0, 0.0])
        push = LoadForce(rods[0].node("rod 0.start"), (0.0, 0.0, 2 * weight), pulse)
        model.add("push", push)
    else:
        model.add("gravity", LoadGravity((2.9, 0.0, -9.81)))
    quantities = {"end": SensorPosition(last)}
    return RandomScene(model, quantities, 0.007 * size * count, 1.5 * time)


def _rod(
    rng: np.random.Generator, name: str, start: np.ndarray, span: np.ndarray, size: float
) -> Beam:
    mesh = MeshCurve.init_line(start, start + span, int(rng.integers(1, 6)), name=name)
    modulus, density = (float(10 ** rng.uniform(*each)) for each in ((5.5, 11.5), (2.8, 3.9)))
    radius = 0.01 * size * float(rng.uniform(0.7, 2.0))
    section = SectionCircle(radius, Material(modulus, 0.3, density))
    return Beam(mesh, section, director=(0.0, 1.0, 0.0))


def _joint(rng: np.random.Generator, kind: str, k: int, a: Place, b: Place) -> Any:
    """Of the k-th beam: to the ground or to the beam before it."""
    which = int(rng.integers(0, 3)) if k and kind != "closed loop" else 0
    if (kind == "cantilever" and not k) or which == 1:
        return JointFixed(a, b)
    return JointSpherical(a, b) if which == 2 else JointRevolute(a, b, axis=(0.0, 1.0, 0.0))


def _lump(rng: np.random.Generator, model: Model, k: int, end: Place, size: float) -> None:
    """A mass or a welded body at an end."""
    mass = float(rng.uniform(0.2, 3.0)) * 1e3 * np.pi * (0.01 * size) ** 2 * size
    if rng.random() < 0.5:
        model.add(f"ball {k}", MassPoint(mass, on=end))
        return
    edge = 0.05 * size
    body = RigidBody.box(mass, (edge, edge, 2 * edge), position=end.position - (0.0, 0.0, edge))
    model.add(f"body {k}", body)
    model.add(f"weld {k}", JointFixed(end, body.at(end.position)))
