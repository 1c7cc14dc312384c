"""Benchmark problems of static beams, each as a function that builds the scene.

Roll-up, elastica, the 45-degree bend, snap-through frames, lateral buckling, a ring that folds to a
third of its radius: every scene has a closed form or a reference solution by other means. ``main``
follows all of them at moderate size and prints each number beside its reference.

The beams lie in the plane of x and y (e1, e2) where the problem is plane; d1 of their sections then
points along z, so that the first bending stiffness is that of the plane. Any consistent units.

Run ``python examples/benchmarks/static_scenes.py --json`` for the numbers as JSON.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import skfem_cosserat as sc

Floats = NDArray[np.float64]

#: reference numbers, with their origin
DATA = Path(__file__).resolve().parents[2] / "tests" / "data" / "static_references.json"
E1, E2, E3 = np.eye(3)
ORIGIN = (0.0, 0.0, 0.0)
FULL = sc.TheoryReissner()


@dataclass(frozen=True, eq=False)
class Scene:
    """A frozen scene and the place that is looked at.

    Attributes
    ----------
    system : System
    beam : Beam
    point : Place
        Node at which displacements and rotations are read.
    """

    system: sc.System
    beam: sc.Beam
    point: sc.Place

    def position(self, history: sc.History, index: Any = -1) -> Floats:
        """Where the point is (3,), or (N, 3) with a slice as index."""
        return np.asarray(history.position(self.point)[index])

    def displacement(self, history: sc.History, index: Any = -1) -> Floats:
        """Its displacement from the reference."""
        return self.position(history, index) - self.point.position

    def rotation(self, history: sc.History, index: Any = -1) -> Floats:
        """Rotation matrix of its section: images of e1, along the beam, e2 and e3 in columns."""
        d = history.rotation(self.point)[index]
        return np.column_stack([d[2], -d[1], d[0]])

    def rotations(self, history: sc.History, index: Any = -1) -> Floats:
        """Of all nodes from the beam's start up to the point, one after the other (N, 3, 3)."""
        connectivity = self.beam.basis.connectivity
        nodes = np.append(connectivity[:, :-1].ravel(), connectivity[-1, -1])
        nodes = nodes[: 1 + int(np.flatnonzero(nodes == self.point.vertex)[0])]
        d = np.array([history.rotation(self.beam.node(int(k)))[index] for k in nodes])
        return np.stack([d[:, 2], -d[:, 1], d[:, 0]], axis=2)

    def angle(self, history: sc.History, index: Any = -1) -> float:
        """Rotation of the point's section about z, turns counted from the beam's start (rad)."""
        R = self.rotations(history, index)
        x, y = R[:, 0, 0], R[:, 1, 0]
        steps = np.arctan2(x[:-1] * y[1:] - y[:-1] * x[1:], x[:-1] * x[1:] + y[:-1] * y[1:])
        return float(np.arctan2(y[0], x[0]) + steps.sum())

    def quaternion(self, history: sc.History, index: Any = -1) -> Floats:
        """Of the point's section (w, x, y, z); its sign is that from the beam's start on (4,)."""
        q = Rotation.from_matrix(self.rotations(history, index)).as_quat()[:, [3, 0, 1, 2]]
        wrong_branch = np.count_nonzero((q[1:] * q[:-1]).sum(axis=1) < 0) + (q[0, 0] < 0)
        return np.asarray(-q[-1] if wrong_branch % 2 else q[-1])


def flat_section(
    EI: float, EA: float, GA: float, across: float | None = None, GJ: float | None = None
) -> sc.Section:
    """Section of a beam in the plane of x and y.

    Parameters
    ----------
    EI : float
        Bending stiffness in the plane.
    EA, GA : float
    across, GJ : float, optional
        Bending stiffness out of the plane and torsional one; default: as EI.
    """
    return sc.Section.from_constants(
        EA=EA,
        GA=GA,
        EI=(EI, EI if across is None else across),
        GJ=EI if GJ is None else GJ,
        mass=1.0,
        inertia=(1.0, 1.0),
    )


def _cantilever(
    mesh: sc.MeshCurve,
    section: sc.Section,
    order: Any,
    loads: dict[str, Any],
    theory: sc.Theory = FULL,
) -> Scene:
    """Beam "rod" clamped at its start; loads at its end by name: a force or (kind, value)."""
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=E3, theory=theory))
    start, end = rod.node("rod.start"), rod.node("rod.end")
    model.add("clamp", sc.JointFixed(sc.ground(start.position), start))
    for name, (kind, value) in loads.items():
        model.add(name, kind(end, value))
    return Scene(model.freeze(), rod, end)


def _line(length: float, elements: int) -> sc.MeshCurve:
    return sc.MeshCurve.init_line(ORIGIN, (length, 0, 0), elements, name="rod")


# -- S1 to S5, S14: cantilevers --------------------------------------------------------------------


def roll_up(
    elements: int = 8,
    order: int = 3,
    turns: float = 1.0,
    *,
    length: float = 10.0,
    EI: float = 100.0,
    slenderness: float = 100.0,
    section: sc.Section | None = None,
) -> Scene:
    """S1: a cantilever bent to full circles by an end moment ``2 pi turns EI/length``."""
    EA = EI * (slenderness / length) ** 2
    moment = (0.0, 0.0, 2 * np.pi * turns * EI / length)
    section = section or flat_section(EI, EA, EA / 2)
    return _cantilever(_line(length, elements), section, order, {"moment": (sc.LoadMoment, moment)})


def elastica(
    elements: int = 8,
    order: int = 3,
    load: float = 1.0,
    *,
    EA: float = 1e5,
    GA: float = 1e5,
    length: float = 1.0,
    EI: float = 1.0,
    theory: sc.Theory = FULL,
) -> Scene:
    """S2: a cantilever with a dead transverse tip force."""
    loads = {"force": (sc.LoadForce, (0.0, load, 0.0))}
    return _cantilever(_line(length, elements), flat_section(EI, EA, GA), order, loads, theory)


def arc(
    elements: int,
    order: Any,
    section: sc.Section,
    forces: Mapping[str, Sequence[float]],
    *,
    radius: float = 100.0,
    degrees: float = 45.0,
    theory: sc.Theory = FULL,
) -> Scene:
    """A clamped arc in the plane, centre (0, radius, 0), with dead forces at its tip, by name."""
    angle = np.radians(degrees)
    mesh = sc.MeshCurve.init_arc(ORIGIN, E1, E2, radius, angle, elements, name="rod")
    loads = {name: (sc.LoadForce, tuple(force)) for name, force in forces.items()}
    return _cantilever(mesh, section, order, loads, theory)


def bend(
    elements: int = 8,
    order: Any = 3,
    P: float = 600.0,
    *,
    shear_factor: float = 1.0,
    stiffening: float = 1.0,
) -> Scene:
    """S3: the 45-degree bend, radius 100, unit square, E = 1e7, G = 5e6, dead force out of plane.

    Parameters
    ----------
    shear_factor : float
        1 or 5/6.
    stiffening : float
        Factor of axial and shear stiffness: large for an inextensible rod.
    """
    E, G = 1e7, 5e6
    section = flat_section(E / 12, stiffening * E, stiffening * shear_factor * G, E / 12, G / 6)
    return arc(elements, order, section, {"force": (0.0, 0.0, P)})


def helix_roll_up(
    elements: int = 40,
    order: int = 4,
    *,
    length: float = 10.0,
    section: sc.Section | None = None,
    moment: float = 200 * np.pi,
    force: float = 50.0,
) -> Scene:
    """S4: ten turns by a spatially fixed end moment, drawn out sideways by a small force."""
    section = section or flat_section(1e2, 1e4, 1e4)
    loads = {
        "moment": (sc.LoadMoment, (0.0, 0.0, moment)),
        "force": (sc.LoadForce, (0.0, 0.0, force)),
    }
    return _cantilever(_line(length, elements), section, order, loads)


#: of the Princeton beam
PRINCETON = {
    "L": 0.508,
    "EA": 2841910.0,
    "GA_flap": 640131.0,
    "GA_chord": 903881.0,
    "GJ": 3.10338,
    "EI_chordwise": 36.2794,
    "EI_flapwise": 2.42873,
}


def princeton(
    elements: int = 4,
    order: int = 4,
    P: float = 13.345,
    degrees: float = 45.0,
    *,
    exchanged: bool = False,
    constants: Mapping[str, float] | None = None,
) -> Scene:
    """S5: Princeton beam, flap along y, chord along z; tip force at an angle from the chord.

    Parameters
    ----------
    exchanged : bool
        With both shear stiffnesses exchanged.
    constants : mapping, optional
        Others instead of those of :data:`PRINCETON`.
    """
    c = {**PRINCETON, **(constants or {})}
    shear = (c["GA_chord"], c["GA_flap"])  # along d1 = z and d2
    section = sc.Section.from_constants(
        EA=c["EA"],
        GA=shear[::-1] if exchanged else shear,
        EI=(c["EI_flapwise"], c["EI_chordwise"]),  # about z, about y
        GJ=c["GJ"],
        mass=1.0,
        inertia=(1.0, 1.0),
    )
    direction = np.radians(degrees)
    force = (0.0, P * np.sin(direction), P * np.cos(direction))
    return _cantilever(_line(c["L"], elements), section, order, {"force": (sc.LoadForce, force)})


def slender_arc(elements: int = 8, order: Any = 3, slenderness: float = 100.0) -> Scene:
    """S14: an arc of 45 degrees, length 1, circular section of any slenderness, tip force 5 e3."""
    EA = 4 * slenderness**2
    section = flat_section(1.0, EA, 0.9 * EA / 2.6, 1.0, 1 / 1.3)
    return arc(elements, order, section, {"force": (0.0, 0.0, 5.0)}, radius=4 / np.pi)


# -- S6 to S8: limit points ------------------------------------------------------------------------


def plane_section(EI: float, EA: float, GA: float) -> sc.Section:
    """Section of a beam that is to stay in its plane: a hundred times as stiff out of it."""
    return flat_section(EI, EA, GA, 100 * EI, 100 * EI)


def lee_frame(
    elements: int = 10,
    order: int = 3,
    *,
    leg: float = 120.0,
    at: float = 24.0,
    section: sc.Section | None = None,
) -> Scene:
    """S6: Lee's frame, two hinged legs, unit load down at a distance from the corner."""
    corners = [ORIGIN, (0, leg, 0), (at, leg, 0), (leg, leg, 0)]
    shares = (0.5, 0.5 * at / leg, 0.5 * (1 - at / leg))
    per_leg = [max(1, round(share * elements)) for share in shares]
    mesh = sc.MeshCurve.init_polyline(corners, per_leg, name="rod")
    section = section or plane_section(7.2e6 * 2, 7.2e6 * 6, 7.2e6 / 2.6 * 6)
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=E3))
    for end in ("start", "end"):
        node = rod.node(f"rod.{end}")
        model.add(f"hinge at {end}", sc.JointRevolute(sc.ground(node.position), node, E3))
    loaded = rod.node((at, leg, 0))
    model.add("load", sc.LoadForce(loaded, (0.0, -1.0, 0.0)))
    return Scene(model.freeze(), rod, loaded)


def toggle(
    elements: int = 4,
    order: int = 3,
    *,
    half: bool = True,
    rise: float = 0.386,
    half_span: float = 12.943,
    section: sc.Section | None = None,
) -> Scene:
    """S7: two flat clamped members that snap through; unit load (in all) down at the apex.

    Parameters
    ----------
    half : bool
        One member and a slide at the apex, by symmetry; else both, which may sway.
    """
    corners = [(-half_span, 0, 0), (0, rise, 0), (half_span, 0, 0)][: 2 if half else 3]
    mesh = sc.MeshCurve.init_polyline(corners, elements, name="rod")
    model = sc.Model()
    section = section or plane_section(9270.0, 1885000.0, 1885000.0 / 2.6 * 5 / 6)
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=E3))
    apex = rod.node((0, rise, 0))
    for end in ("start",) if half else ("start", "end"):
        node = rod.node(f"rod.{end}")
        model.add(f"clamp at {end}", sc.JointFixed(sc.ground(node.position), node))
    if half:
        model.add("symmetry", sc.JointPrismatic(sc.ground(apex.position), apex, E2))
    model.add("load", sc.LoadForce(apex, (0.0, -0.5 if half else -1.0, 0.0)))
    return Scene(model.freeze(), rod, apex)


def arch(
    elements: int = 16,
    order: int = 4,
    *,
    slenderness: float = 1e3,
    radius: float = 100.0,
    degrees: float = 215.0,
    section: sc.Section | None = None,
    theory: sc.Theory = FULL,
) -> Scene:
    """S8: clamped-hinged arch, EI = 1e6, unit load down at the crown.

    The clamp is at the left. Axial and shear stiffness are ``EI (slenderness/radius)^2``. The
    number of elements must be even: the crown is a node.
    """
    R, half = radius, np.radians(degrees / 2)
    start = R * np.array([-np.sin(half), np.cos(half), 0.0])
    tangent = np.array([np.cos(half), np.sin(half), 0.0])
    inward = -start / R
    mesh = sc.MeshCurve.init_arc(start, tangent, inward, R, 2 * half, elements, name="rod")
    EA = 1e6 * (slenderness / R) ** 2
    model = sc.Model()
    section = section or plane_section(1e6, EA, EA)
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=E3, theory=theory))
    left, right, crown = rod.node("rod.start"), rod.node("rod.end"), rod.node((0, R, 0))
    model.add("clamp", sc.JointFixed(sc.ground(left.position), left))
    model.add("hinge", sc.JointRevolute(sc.ground(right.position), right, E3))
    model.add("load", sc.LoadForce(crown, (0.0, -1.0, 0.0)))
    return Scene(model.freeze(), rod, crown)


# -- S9, S10: bifurcations -------------------------------------------------------------------------

#: strip 30 x 0.6, E = 71240, nu = 0.31: in the plane, across it, torsion, axial, shear
STRIP = {
    "EI": 96174000.0,
    "across": 38469.6,
    "GJ": 58732.213740458006,
    "EA": 1282320.0,
    "GA": 407862.59541984723,
}


def strip(
    elements: int = 8,
    order: int = 3,
    *,
    stiffening: float = 1.0,
    length: float = 240.0,
    constants: Mapping[str, float] = STRIP,
) -> Scene:
    """S9: a cantilever strip, unit tip force in its stiff plane.

    Parameters
    ----------
    stiffening : float
        Factor of all stiffnesses but the bending across and the torsion of it: large for no
        displacements before it buckles, as in Prandtl's solution.
    """
    section = flat_section(**_stiffened(constants, stiffening))
    force = (0.0, -1.0, 0.0)
    return _cantilever(_line(length, elements), section, order, {"force": (sc.LoadForce, force)})


def _stiffened(constants: Mapping[str, float], factor: float) -> dict[str, float]:
    return {k: v if k in ("across", "GJ") else factor * v for k, v in constants.items()}


def right_angle(
    elements: int = 6,
    order: int = 3,
    *,
    length: float = 240.0,
    constants: Mapping[str, float] = STRIP,
    load: float = 1.0,
) -> Scene:
    """S9b: two legs at a right angle, clamped, a force along x at the free end."""
    corners = [ORIGIN, (length, 0, 0), (length, -length, 0)]
    mesh = sc.MeshCurve.init_polyline(corners, elements, name="rod")
    force = (load, 0.0, 0.0)
    return _cantilever(mesh, flat_section(**constants), order, {"force": (sc.LoadForce, force)})


def hinged_frame(
    elements: int = 6,
    order: int = 3,
    *,
    stiffening: float = 1.0,
    length: float = 240.0,
    constants: Mapping[str, float] = STRIP,
) -> Scene:
    """S9c: two legs at a right angle under opposite unit end moments about z.

    Both ends are hinges about z, one of them on a slide along x; `stiffening` as for
    :func:`strip`.
    """
    a = length / np.sqrt(2)
    corners = [(-a, 0, 0), (0, a, 0), (a, 0, 0)]
    mesh = sc.MeshCurve.init_polyline(corners, elements, name="rod")
    model = sc.Model()
    section = flat_section(**_stiffened(constants, stiffening))
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=E3))
    left, right = rod.node("rod.start"), rod.node("rod.end")
    model.add("hinge", sc.JointRevolute(sc.ground(left.position), left, E3))
    block = model.add("block", sc.RigidBody.box(1.0, (1, 1, 1), position=right.position))
    place = block.at(right.position)
    model.add("slide", sc.JointPrismatic(sc.ground(right.position), place, E1))
    model.add("pin", sc.JointRevolute(place, right, E3))
    model.add("left", sc.LoadMoment(left, (0.0, 0.0, 1.0)))
    model.add("right", sc.LoadMoment(right, (0.0, 0.0, -1.0)))
    return Scene(model.freeze(), rod, rod.node((0, a, 0)))


def column(
    elements: int = 4,
    order: int = 3,
    *,
    pinned: bool = True,
    stiffening: float = 1.0,
    length: float = 1.0,
    EI: float = 109375.0,
    EA: float = 525e6,
    GA: float = 525e6 / 2.6 * 5 / 6,
) -> Scene:
    """S10: a column along x under unit load: pinned at both ends, or a cantilever.

    Across its plane it is four times as stiff, so that it buckles in one plane only. `stiffening`
    is a factor of axial and shear stiffness.
    """
    model = sc.Model()
    section = flat_section(EI, stiffening * EA, stiffening * GA, 4 * EI, EI)
    rod = model.add("rod", sc.Beam(_line(length, elements), section, order=order, director=E3))
    start, end = rod.node("rod.start"), rod.node("rod.end")
    if pinned:
        model.add("hinge", sc.JointRevolute(sc.ground(start.position), start, E3))
        model.add("roller", sc.JointPointOnLine(sc.ground(end.position), end, E1))
    else:
        model.add("clamp", sc.JointFixed(sc.ground(start.position), start))
    model.add("load", sc.LoadForce(end, (-1.0, 0.0, 0.0)))
    return Scene(model.freeze(), rod, end)


# -- S11, S12: rings -------------------------------------------------------------------------------


def deployable_ring(
    elements: int = 16,
    order: int = 4,
    *,
    radius: float = 20.0,
    section: sc.Section | None = None,
) -> Scene:
    """S11: a ring, clamped at A, turned at the opposite point B about AB.

    The angle is 2 pi times the load factor; B slides along AB. After a full turn the ring is one
    of a third of the radius, three times round. The number of elements must be even.
    """
    R = radius
    mesh = sc.MeshCurve.init_arc((-R, 0, 0), -E2, E1, R, 2 * np.pi, elements, name="ring")
    EI, across = 64814.8148148148, 583333.3333333334
    section = section or flat_section(EI, 7e6, 2243589.7435897435, across, 78774.23076923077)
    model = sc.Model()
    ring = model.add("ring", sc.Beam(mesh, section, order=order, director=E3))
    A, B = ring.node((-R, 0, 0)), ring.node((R, 0, 0))
    model.add("clamp", sc.JointFixed(sc.ground(A.position), A))
    guide = model.add("guide", sc.JointCylindrical(sc.ground(B.position), B, E1))
    model.add("drive", sc.JointDrive(guide, lambda t: 2 * np.pi * t, "angle"))
    return Scene(model.freeze(), ring, B)


#: of a ring with EI = 1, GJ = 1.5
RING_LIMIT = 2 * np.pi * np.sqrt(3) / 1.5


def twisted_ring(
    elements: int = 12,
    order: int = 4,
    *,
    GJ: float = 1.5,
    slenderness: float = 100.0,
    radius: float = 1.0,
    EI: float = 1.0,
) -> Scene:
    """S12: a straight rod bent to a ring and then twisted.

    Up to load factor 1 its end is led along circular arcs; then it is turned about its tangent by
    an angle of ``t - 1``, held in a hinge at the place of the clamped start. A straight rod of
    equal bending stiffnesses may bend to a ring in any plane, at no cost: a spring keeps a quarter
    point from leaving the plane. It has no influence on when the ring buckles, for there, too, all
    turns about the tangent are equal.
    """
    length = 2 * np.pi * radius
    model = sc.Model()
    EA = EI * (slenderness / radius) ** 2
    section = flat_section(EI, EA, EA, EI, GJ)
    mesh = _line(length, elements)
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=E3))
    start, end = rod.node("rod.start"), rod.node("rod.end")

    def displacement(t: float) -> tuple[float, float, float]:
        f = 2 * np.pi * min(t, 1.0)
        if f < 1e-8:
            return (0.0, 0.5 * length * f, 0.0)
        return (length * (np.sin(f) / f - 1), length * (1 - np.cos(f)) / f, 0.0)

    def rotation(t: float) -> tuple[float, float, float]:
        return (0.0, 0.0, 2 * np.pi * min(t, 1.0))

    model.add("clamp", sc.JointFixed(sc.ground(ORIGIN), start))
    led = sc.ground(end.position, sc.Motion(displacement, rotation))
    hinge = model.add("hinge", sc.JointRevolute(led, end, E1))
    model.add("twist", sc.JointDrive(hinge, lambda t: max(0.0, t - 1.0)))
    quarter = rod.node((length / 4, 0, 0))
    spring = np.diag([0.0, 0.0, EI / radius**3, 0.0, 0.0, 0.0])
    model.add("spring", sc.Bushing(sc.ground(quarter.position), quarter, spring))
    return Scene(model.freeze(), rod, rod.node((length / 2, 0, 0)))


def ring_limits(scene: Scene, expected: float, treatment: Any = None) -> tuple[sc.History, Floats]:
    """Path of a :func:`twisted_ring` and its two critical twists, as shares of `expected`.

    The squares of the two lowest frequencies vanish there: found from six twists nearby.
    """
    shares = np.array([0.991, 0.993, 0.996, 0.998, 1.001, 1.003])
    control = sc.LoadControl(at=[1.0, *(1 + expected * shares)])
    history = sc.static(scene.system, treatment, control, watch=False, derive=False)
    squares = np.array(
        [sc.modes(scene.system, (history, k), 2).squares for k in range(2, len(history))]
    )
    beyond = squares[:, 0] < 0
    squares[beyond] = squares[beyond, ::-1]  # each goes on smoothly: nearer to zero, or farther
    return history, np.array([zero(column, shares) for column in squares.T])


def zero(values: Any, at: Any) -> float:
    """Where a function of these values at these places vanishes: its inverse, a polynomial."""
    scaled = np.asarray(values) / np.max(np.abs(values))
    return float(np.linalg.solve(np.vander(scaled, increasing=True), at)[0])


# -- all of them -----------------------------------------------------------------------------------


class Table:
    """Rows of (scene, quantity, computed, reference)."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []

    def add(self, scene: str, quantity: str, computed: Any, reference: Any) -> None:
        """A number, or several whose largest difference counts."""
        a, b = np.atleast_1d(computed).astype(float), np.atleast_1d(reference).astype(float)
        k = int(abs(a - b).argmax())
        row = {"scene": scene, "quantity": quantity, "computed": a[k], "reference": b[k]}
        self.rows.append(row | {"difference": a[k] - b[k]})

    def text(self) -> str:
        """For reading."""
        lines = [f"{'scene':22}{'quantity':32}{'computed':>20}{'reference':>20}{'difference':>13}"]
        for row in self.rows:
            numbers = f"{row['computed']:20.11g}{row['reference']:20.11g}{row['difference']:13.1e}"
            lines.append(f"{row['scene']:22}{row['quantity']:32}{numbers}")
        return "\n".join(lines)


def critical_loads(scene: Scene, control: Any) -> tuple[sc.History, list[dict[str, Any]]]:
    """A path with its critical points."""
    history = sc.static(scene.system, control=control, derive=False)
    return history, history.meta["critical"]


def _cantilevers(table: Table, data: dict[str, Any]) -> None:
    scene = roll_up(16, 4, 2)
    history = sc.static(scene.system, watch=False, derive=False)
    table.add("S1 roll-up, 2 circles", "tip", scene.position(history), np.zeros(3))
    thickness, load, x, y = data["S2 Reissner"]["values"][5][:4]
    EA = 12 / thickness**2
    scene = elastica(8, 4, load, EA=EA, GA=5 / 6 * EA / 2.6)
    history = sc.static(scene.system, derive=False)
    table.add("S2 elastica", f"tip at load {load:g}", scene.position(history), [x, y, 0])
    case = next(c for c in data["S3"]["cases"] if c["P"] == 600)
    for elements, order in ((16, 1), (16, 2), (16, 3), (8, 4)):
        scene = bend(elements, order)
        history = sc.static(scene.system, derive=False)
        what = f"tip, {elements} elements, order {order}"
        table.add("S3 45-degree bend", what, scene.position(history), case["tip"])
    rows = np.array(data["S4"]["values"])[:6]
    scene = helix_roll_up(40, 4)
    history = sc.static(
        scene.system, control=sc.LoadControl(at=rows[:, 0]), watch=False, derive=False
    )
    table.add("S4 helix", "tip after three turns", scene.position(history), rows[-1, 1:4])
    for P, degrees, *expected in data["S5"]["values"][-3:]:
        scene = princeton(4, 4, P, degrees)
        history = sc.static(scene.system, derive=False)
        what = f"tip at {degrees:g} degrees"
        table.add("S5 Princeton beam", what, scene.displacement(history), expected[:3])
    case = data["S14"]["cases"]["1000"]
    scene = slender_arc(8, 4, 1000.0)
    history = sc.static(scene.system, derive=False)
    table.add("S14 slender arc", "tip", scene.position(history), case["tip"])


def _limits(table: Table, data: dict[str, Any]) -> None:
    scene = lee_frame(20, 4)
    control = sc.ArcLength(100, until=20000.0, first=2000.0)
    history, found = critical_loads(scene, control)
    for entry, (P, u, _) in zip(found, data["S6"]["values"], strict=True):
        table.add("S6 Lee's frame", "limit load", entry["load_factor"], P)
        table.add("S6 Lee's frame", "u", scene.displacement(history, entry["state"])[0], u)
    scene = toggle(4, 4)
    history, found = critical_loads(scene, sc.ArcLength(60, until=60.0, first=5.0))
    for entry, (_, P) in zip(found, data["S7"]["limit_points"], strict=True):
        table.add("S7 toggle", "limit load", entry["load_factor"], P)
    loads = []
    for slenderness in (1e3, 1e3 * np.sqrt(2)):  # an error of its -2nd power
        scene = arch(24, 4, slenderness=slenderness)
        control = sc.DisplacementControl(scene.point, -E2, until=115.0)
        loads.append(critical_loads(scene, control)[1][0]["load_factor"])
    table.add("S8 arch", "limit load, inextensible", 2 * loads[1] - loads[0], data["S8"]["P"])


def _bifurcations(table: Table, data: dict[str, Any]) -> None:
    euler = data["S10"]["critical"]
    cases = [
        ("S9 strip", strip(8, 3), data["S9 strip"]["critical"]),
        ("S9b right-angle frame", right_angle(6, 3), data["S9b"]["critical"]),
        ("S10 pinned column", column(8, 4), euler["pinned-pinned"]),
        ("S10 cantilever column", column(8, 4, pinned=False), euler["clamped-free"]),
    ]
    for name, scene, expected in cases:
        control = sc.LoadControl(until=1.1 * expected)
        found = critical_loads(scene, control)[1][0]["load_factor"]
        table.add(name, "bifurcation load", found, expected)
    rigid = hinged_frame(8, 4, stiffening=1e4).system
    expected = data["S9c"]["critical"]
    table.add("S9c hinged frame", "linear buckling", sc.buckling(rigid, 1).factors[0], expected)
    rigid = strip(8, 4, stiffening=1e4).system
    prandtl = data["S9 Prandtl"]["c"] * np.sqrt(STRIP["across"] * STRIP["GJ"]) / 240**2
    table.add("S9 Prandtl", "linear buckling", sc.buckling(rigid, 1).factors[0], prandtl)


def _rings(table: Table, data: dict[str, Any]) -> None:
    scene = deployable_ring(24, 4)
    rows = np.array(data["S11"]["values"])[[9, 33, -1]]
    control = sc.LoadControl(at=rows[:, 0] / 360)
    history = sc.static(scene.system, control=control, watch=False)
    for k, (degrees, torque, shift) in enumerate(rows, 1):
        at = f"at {degrees:g} degrees"
        moment = history["joint/drive/moment"][k, 0]
        table.add("S11 deployable ring", f"torque {at}", moment, torque)
        table.add("S11 deployable ring", f"shift {at}", scene.displacement(history, k)[0], shift)
    scenes = [twisted_ring(16, 4, slenderness=k * 60.0) for k in (1.0, np.sqrt(2))]
    once, twice = (ring_limits(scene, RING_LIMIT)[1].mean() for scene in scenes)
    limit = (2 * twice - once) * RING_LIMIT
    table.add("S12 twisted ring", "critical twist, inextensible", limit, RING_LIMIT)


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """All scenes at moderate size.

    Returns
    -------
    dict
        ``rows``: scene, quantity, computed, reference, difference; ``seconds``.
    """
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print all numbers as JSON")
    arguments = parser.parse_args(argv)
    data = json.loads(DATA.read_text())
    table, begin = Table(), time.perf_counter()
    for follow in (_cantilevers, _limits, _bifurcations, _rings):
        follow(table, data)
    result = {"rows": table.rows, "seconds": time.perf_counter() - begin}
    print(json.dumps(result, indent=1) if arguments.json else table.text())
    return result


if __name__ == "__main__":
    main()
