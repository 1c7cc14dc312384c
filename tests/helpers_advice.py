"""Random scenes for the advisor: pendulums of beams and bodies, stiff and soft ones in one."""

from __future__ import annotations

from typing import NamedTuple

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

__all__ = ["RandomScene", "random_scene"]

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
