"""Draws the pictures of the guide's first two pages: meshes, sections, bodies, joints, loads ...

Run ``python examples/guide/make_pictures.py`` (needs matplotlib); it writes ``pictures/*.png``
beside this file. With names, ``make_pictures.py joint_revolute``, it draws these alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from sketch import (
    AXIS,
    BEAM,
    BENT,
    BODY,
    GROUND,
    INK,
    LOAD,
    SENSOR,
    Sketch,
    circle,
    rectangle,
)

import skfem_cosserat as sc

FOLDER = Path(__file__).resolve().parent / "pictures"
TIP = BENT[-1]
ZERO, TOWARDS, RIGHT, UP = np.vstack([np.zeros(3), np.eye(3)])
Draw = Callable[[Sketch], Any]


def _line(elements: int, *ends: Any, name: str = "beam") -> sc.MeshCurve:
    return sc.MeshCurve.init_line(*ends, elements, name=name)


def _tee(s: Sketch) -> None:
    flange = _line(4, (0, -1.1, 0.45), (0, 1.1, 0.45), name="flange")
    web = _line(3, (0, 0, 0.45), (0, 0, -0.75), name="web")
    s.mesh(flange.joined(web))
    s.text((-0.75, 0.68), "flange", BEAM)
    s.text((0.32, -0.4), "web", BEAM)


def _apart(s: Sketch) -> None:
    s.mesh(_line(3, (0, -1.2, -0.4), (0, -0.02, 0.45)))
    s.mesh(_line(3, (0, 0.02, 0.45), (0, 1.2, -0.4)))
    s.ball((0, 0.45), 0.2, "#ffffff")
    s.ball((-0.07, 0.45), 0.06, BEAM)
    s.ball((0.07, 0.45), 0.06, BEAM)
    s.text((0, 0.8), "two nodes")


def _closed(s: Sketch) -> None:
    turn = 2 * np.pi
    s.mesh(sc.MeshCurve.init_arc((0.0, -0.75, 0), (0, 0, 1), (0, 1, 0), 0.75, turn, 16))


def _file(s: Sketch) -> None:
    s.fill([(-1.3, -0.7), (-1.3, 0.7), (-0.65, 0.7), (-0.4, 0.45), (-0.4, -0.7)], "white")
    s.line([(-0.65, 0.7), (-0.65, 0.45), (-0.4, 0.45)], lw=0.8)
    s.text((-0.85, 0), ".msh\n.vtu")
    s.arrow((-0.25, 0), (0.15, 0), INK)
    s.mesh(sc.MeshCurve.init_polyline([(0, 0.35, -0.6), (0, 0.35, 0.4), (0, 1.25, 0.4)], 3))
    s.text((0.8, 0.62), '"boom"', BEAM)
    s.text((0.8, -0.6), '"foot"')


def _triads(s: Sketch) -> None:
    """Triads along a curved beam, for two directors."""
    section = sc.Section([1.0] * 6, mass=1.0, inertia=(1, 1))
    for z, director in ((0.6, (0, 0, 1)), (-0.9, (1, 0, 0))):
        ends = (0, -1.3, z), (0, 0.93, 0.37), (0, 0.37, -0.93)
        mesh = sc.MeshCurve.init_arc(*ends, 5.0, 0.757, 6)
        beam = sc.Beam(mesh, section, director=director)
        s.line(beam_points(mesh), "#b9cdea", 9.0)
        for k in range(0, 7, 2):
            s.triad(mesh.p[:, k], beam.node(k).triad, 0.62, label=True)
        s.text((-2.8, z + (0.6 if z > 0 else -0.5)), f"director\n= {director}")
    for k, end in enumerate(0.4 * np.eye(3)):
        s.arrow((0, -2.8, -0.05), end + (0, -2.8, -0.05), INK)
        s.text(1.35 * end + (0, -2.8, -0.05), "xyz"[k])


def beam_points(mesh: sc.MeshCurve) -> np.ndarray:
    """Points of a mesh of one beam (k, 3)."""
    x = mesh.mapping().F(np.linspace(0, 1, 12)[None])
    return np.moveaxis(x, 0, 2).reshape(-1, 3)


def _orders(s: Sketch) -> None:
    for order in (1, 2, 3, 4):
        z = 0.8 - 0.4 * order + 0.2
        s.beam([(-0.9, z), (1.2, z)], 3.5)
        for xi in sc.InterpolationLobatto(order).nodes:
            s.ball((-0.9 + 2.1 * xi, z), 0.06, "#ffffff")
        s.text((-1.25, z), str(order))


def _twist(s: Sketch) -> None:
    y = np.linspace(-1.2, 1.2, 41)
    d1 = np.stack([np.sin(1.3 * (y + 1.2)), 0 * y, np.cos(1.3 * (y + 1.2))], axis=1) * 0.38
    x = np.stack([0 * y, y, 0 * y], axis=1)
    for k in range(40):
        s.fill([x[k] + d1[k], x[k + 1] + d1[k + 1], x[k + 1] - d1[k + 1], x[k] - d1[k]], "#9dbce8")
    s.beam(x, 3.0)


def _theory(s: Sketch) -> None:
    angles = np.radians(np.linspace(50, 130, 30))
    out = np.stack([1.6 * np.cos(angles), 1.6 * np.sin(angles) - 1.2], axis=1)
    s.line(out, "#b9cdea", 26.0, solid_capstyle="butt")
    s.beam(out, 2.5)
    for y, z in out[2::5]:
        normal = np.array([y, z + 1.2]) / 1.6
        s.line([(y, z) - 0.17 * normal, (y, z) + 0.17 * normal], INK, 1.5)


def _lumped(s: Sketch) -> None:
    s.beam([(-1.2, 0), (1.2, 0)], 2.5)
    for k in range(5):
        s.ball((0.6 * k - 1.2, 0), 0.1 if k in (0, 4) else 0.14, BEAM)


def _flying(s: Sketch) -> None:
    s.beam([(-0.9, -0.5), (0.9, -0.2)])
    for t in (0.0, 0.5, 1.0):
        foot = np.array([1.8 * t - 0.9, 0.3 * t - 0.5])
        s.arrow(foot + (0, 0.06), foot + (0, 0.3 + 0.6 * t))
    s.text((1.15, 0.5), "v", LOAD)


def _offset(s: Sketch) -> None:
    s.beam([(-1.2, -0.3), (0.2, -0.3)])
    s.ball((0.2, -0.3), 0.07, "#ffffff")
    s.line([(0.2, -0.3), (0.2, 0.45)], INK, 2.0)
    s.ball((0.2, 0.45), 0.07, BODY)
    s.text((0.75, 0.1), "offset")
    s.text((0.25, -0.58), "node")


def _parts(s: Sketch) -> None:
    s.beam([(-1.2, 0), (0, 0)], 11.0, solid_capstyle="butt")
    s.beam([(0, 0), (1.2, 0)], 4.0, solid_capstyle="butt")
    s.text((-0.6, 0.3), '"root"', BEAM)
    s.text((0.6, 0.3), '"tip"', BEAM)


def _body(s: Sketch) -> None:
    s.fill(circle(1.0) * (1.1, 0.8), BODY)
    s.ball((0.55, 0.2), 0.06, "#ffffff")
    s.text((0.55, 0.4), "center", size=9)
    s.triad((-0.3, -0.1), [(1, 0), (0, 1), (-0.6, -0.42)], 0.5, label=True)


def _on(s: Sketch) -> None:
    s.beam([(y, -0.2 * y**2) for y in np.linspace(-1.3, 1.3, 20)])


def _pin(s: Sketch, angle: float = 0.0) -> None:
    """A bar on a hinge."""
    c, n = np.cos(angle), np.sin(angle)
    s.ground((-0.75, -0.55))
    s.line([(-0.75, -0.55), (-0.75, 0)], GROUND, 7.0)
    bar = np.array([(-0.12, -0.13), (1.6, -0.13), (1.6, 0.13), (-0.12, 0.13)])
    s.fill(bar @ [[c, n], [-n, c]] + (-0.75, 0), BODY)
    s.ball((-0.75, 0), 0.08, "#ffffff")


def _hinge(s: Sketch) -> None:
    s.box((0, -0.85, 0), (0.5, 0.7, 0.3), GROUND)
    s.tube((-0.3, -0.35, 0), (0.3, -0.35, 0), 0.2, GROUND)
    s.box((0, 0.55, 0), (0.3, 1.5, 0.24))
    s.tube((0.0, -0.35, 0), (0.32, -0.35, 0), 0.2)
    s.axis((-1.3, -0.35, 0), (1.6, -0.35, 0))
    s.turn((0.4, -0.35, 0), TOWARDS, 0.5, (-200, 10))


def _spherical(s: Sketch) -> None:
    s.box((0, 0, -0.8), (0.7, 0.8, 0.1), GROUND)
    s.tube((0, 0, -0.75), (0, 0, -0.2), 0.1, GROUND)
    s.tube((0, 0.1, 0.1), (0, 1.1, 0.75), 0.13)
    s.ball((0, 0.0), 0.26)
    s.turn((0, -0.05, 0.35), UP, 0.32, (20, 330))
    s.turn((0, -0.45, -0.1), RIGHT, 0.3, (30, 330))
    s.turn((0.6, 0.85, 0.0), TOWARDS, 0.25, (30, 330))


def _universal(s: Sketch) -> None:
    s.tube((0, -1.3, 0), (0, -0.5, 0), 0.12, GROUND)
    for z in (-0.38, 0.38):
        s.box((0, -0.25, z), (0.22, 0.6, 0.08), GROUND)
    s.box((0, -0.5, 0), (0.22, 0.1, 0.7), GROUND)
    s.axis((0, 0, -0.95), (0, 0, 0.95))
    s.tube((-0.55, 0, 0), (0.55, 0, 0), 0.06, "#d9d9d9")
    s.tube((0, 0, -0.34), (0, 0, 0.34), 0.06, "#d9d9d9")
    s.box((-0.45, 0.25, 0), (0.1, 0.6, 0.22))
    s.tube((0, 0.6, 0), (0, 1.3, 0), 0.12)
    s.box((0, 0.5, 0), (0.8, 0.1, 0.22))
    s.box((0.45, 0.25, 0), (0.1, 0.6, 0.22))
    s.axis((0.5, 0, 0), (1.5, 0, 0))
    s.text((0.18, 0.85), "a", AXIS)
    s.text((-0.85, -0.35), "b", AXIS)


def _sleeve(s: Sketch, turning: bool) -> None:
    s.box((0, -1.18, 0), (0.5, 0.14, 0.8), GROUND)
    if turning:
        s.tube((0, -1.1, 0), (0, 0, 0), 0.12, GROUND)
        s.tube((0, -0.35, 0), (0, 0.4, 0), 0.3)
        s.tube((0, 0.4, 0), (0, 1.1, 0), 0.12, GROUND)
        s.turn((0, 0.75, 0), RIGHT, 0.42, (-60, 240))
    else:
        s.box((0, -0.6, 0), (0.26, 1.02, 0.26), GROUND)
        s.box((0, 0.03, 0), (0.6, 0.8, 0.55))
        s.box((0, 0.77, 0), (0.26, 0.68, 0.26), GROUND)
    s.axis((0, 1.1, 0), (0, 1.45, 0))
    s.both((0, -0.4, 0.62), (0, 0.55, 0.62))


def _planar(s: Sketch) -> None:
    s.box((0, 0, -0.45), (1.3, 1.9, 0.1), GROUND)
    s.tube((0, 0, -0.4), (0, 0, -0.15), 0.33)
    s.both((0.5, -0.75, -0.38), (0.5, 0.6, -0.38))
    s.both((-0.5, 0.72, -0.38), (0.5, 0.72, -0.38))
    s.axis((0, 0, -0.05), (0, 0, 0.95))
    s.turn((0, 0, 0.4), UP, 0.32, (-150, 150))


def _bead(s: Sketch) -> None:
    s.line([(-1.2, -0.27), (1.2, 0.27)], "#6b7280", 2.5)
    s.ground((-1.2, -0.27), (-1, -0.22))
    s.ground((1.2, 0.27), (1, 0.22))
    s.ball((0, 0), 0.22)
    s.both((-0.55, 0.22), (0.4, 0.43))
    s.turn((0, -0.05, -0.05), TOWARDS, 0.42, (100, 250))


def _distance(s: Sketch) -> None:
    s.ground((-0.9, 0.7), (0, 1))
    s.line([(-0.9, 0.7), (0.6, -0.5)], INK, 2.0)
    s.ball((-0.9, 0.7), 0.06, "#ffffff")
    s.ball((0.6, -0.5), 0.2)
    s.text((0.05, 0.25), "L")


def _bushing(s: Sketch) -> None:
    s.box((0, -1.0, 0), (0.9, 0.14, 1.0), GROUND)
    for z in (-0.35, 0.35):
        s.spring((0, -0.9, z), (0, 0.15, z), 5)
    s.spring((-0.4, -0.9, 0), (-0.4, 0.15, 0), 5)
    s.box((0, 0.6, 0), (0.7, 0.9, 0.9))
    s.text((-0.42, 0.85), "6 x 6")


def _foundation(s: Sketch) -> None:
    s.beam([(y, 0.25 - 0.14 * np.cos(1.2 * y) ** 2) for y in np.linspace(-1.3, 1.3, 30)])
    for y in np.linspace(-1.15, 1.15, 7):
        s.spring((y, 0.2 - 0.14 * np.cos(1.2 * y) ** 2), (y, -0.6), 4)
    s.ground((0, -0.6), width=2.7)
    s.arrow((0, 0.85), (0, 0.2))


def _follower(s: Sketch, moment: bool = False) -> None:
    for angle, pale in ((0.15, True), (0.95, False)):
        c, n = np.cos(angle), np.sin(angle)
        bar = np.array([(0, -0.1), (1.6, -0.1), (1.6, 0.1), (0, 0.1)]) @ [[c, n], [-n, c]]
        s.fill(bar + (-0.9, -0.7), "#fbdcbb" if pale else BODY)
        end = np.array([1.6 * c - 0.9, 1.6 * n - 0.7])
        s.arrow(end, end + 0.55 * np.array([-n, c]), "#8cc7a1" if pale else LOAD)
    s.ball((-0.9, -0.7), 0.07, "#ffffff")


def _dead(s: Sketch) -> None:
    s.cantilever()
    s.arrow(np.add(TIP, (0, 1.0)), np.add(TIP, (0, 0.06)))


def _moment(s: Sketch) -> None:
    s.cantilever()
    s.turn((0, TIP[0] - 0.1, TIP[1] + 0.1), TOWARDS, 0.38, (-100, 120), LOAD)


def _line_load(s: Sketch, follower: bool) -> None:
    s.cantilever()
    x = np.array(BENT)
    tangent = np.gradient(x, axis=0)
    for k in range(2, 30, 4):
        n = np.array([-tangent[k, 1], tangent[k, 0]]) / np.linalg.norm(tangent[k])
        back = n if follower else np.array([0, 1])  # dead loads keep their direction
        s.arrow(x[k] + 0.5 * back, x[k] + 0.05 * back)


def _gravity(s: Sketch) -> None:
    s.beam([(-1.2, 0.4), (0.1, 0.6)])
    s.ball((0.8, 0.4), 0.22)
    for y, z in ((-0.9, 0.38), (-0.2, 0.48), (0.8, 0.12)):
        s.arrow((y, z), (y, z - 0.7))
    s.text((0.3, -0.35), "g", LOAD)


def _own_load(s: Sketch) -> None:
    s.ball((-0.5, 0.2), 0.25)
    s.arrow((-0.2, 0.2), (0.5, 0.2), INK)
    s.arrow((-0.8, 0.2), (-1.35, 0.2))
    s.text((0.7, 0.2), "v")
    s.text((0, -0.5), "F(x, v, t)", LOAD)


def _motion(s: Sketch) -> None:
    s.ground((-0.3, -0.6), width=1.1)
    s.line([(-0.3, -0.58), (-0.3, 0.5)], BEAM, 5.0)
    s.both((-0.8, -0.85), (0.2, -0.85), LOAD)
    s.turn((0, -0.3, -0.6), TOWARDS, 1.35, (112, 68), LOAD)
    s.text((0.85, 0.0), "u(t), θ(t)", LOAD)


def _motion_turn(s: Sketch) -> None:
    s.tube((0, -0.3, -0.35), (0, -0.3, 0.0), 0.42, GROUND)
    s.beam([(0.0, 0.1, -0.1), (0.2, 1.35, -0.2)])
    s.axis((0, -0.3, 0), (0, -0.3, 0.95))
    s.turn((0, -0.3, 0.45), UP, 0.45, (-150, 130), LOAD)
    s.text((0.75, 0.5), "angle(t)", LOAD)


def _shake(s: Sketch) -> None:
    t = np.linspace(0, 1, 120)
    record = np.exp(-((t - 0.4) ** 2) / 0.05) * np.sin(45 * t + 4 * np.sin(17 * t))
    s.line(np.stack([-1.2 + 1.3 * t, 0.3 + 0.4 * record], axis=1), LOAD, 1.2)
    s.text((-0.55, -0.35), "a(t)", LOAD)
    s.ground((0.85, -0.6), width=0.9)
    s.line([(0.7, -0.6), (0.7, 0.1), (0.8, 0.7)], BEAM, 5.0)
    s.both((0.4, -0.87), (1.3, -0.87), LOAD)


def _decay(s: Sketch) -> None:
    t = np.linspace(0, 1, 300)
    s.line([(-1.3, 0), (1.3, 0)], lw=1.0)
    for sign in (1, -1):
        s.line(np.stack([-1.2 + 2.4 * t, 0.8 * sign * np.exp(-2.5 * t)], axis=1), AXIS, 1.0)
    s.line(np.stack([-1.2 + 2.4 * t, 0.8 * np.exp(-2.5 * t) * np.cos(32 * t)], axis=1), BEAM, 1.8)


def _viscous(s: Sketch) -> None:
    s.beam([(-1.3, 0.55), (1.3, 0.55)], 9.0, solid_capstyle="butt")
    s.line([(-0.7, 0.1), (-0.7, -0.7)])
    s.line([(0.7, 0.1), (0.7, -0.7)])
    s.spring((-0.7, -0.05), (0.7, -0.05))
    s.damper((-0.7, -0.55), (0.7, -0.55))
    s.line([(-1.2, -0.3), (-0.7, -0.3)])
    s.line([(0.7, -0.3), (1.2, -0.3)])
    s.text((0, 0.22), "each section", size=9)


def _probe(s: Sketch) -> None:
    s.cantilever()
    s.ball(TIP, 0.1, SENSOR)


def _sensor_position(s: Sketch) -> None:
    _probe(s)
    s.arrow((-1.1, -0.85), TIP, SENSOR)
    s.text((0.1, -0.75), "x", SENSOR)


def _sensor_velocity(s: Sketch, word: str) -> None:
    _probe(s)
    s.arrow(TIP, np.add(TIP, (0.25, 0.85)), SENSOR)
    if word == "a":
        s.arrow(TIP, np.add(TIP, (0.17, 0.6)), SENSOR)
    s.text(np.add(TIP, (-0.15, 0.5)), word, SENSOR)


def _cut(s: Sketch, force: bool) -> None:
    s.ground((-1.3, 0), (-1, 0))
    s.beam([(-1.3, 0), (0.1 if force else 1.3, 0)], 12.0, solid_capstyle="butt")
    if force:
        s.arrow((0.12, 0), (0.75, 0), SENSOR)
        s.arrow((0.18, 0), (0.18, 0.65), SENSOR)
        s.turn((0, 0.18, 0), TOWARDS, 0.42, (-130, -35), SENSOR)
        s.text((0.95, 0), "N", SENSOR)
        s.text((0.65, -0.55), "M", SENSOR)
    else:
        s.line([(-0.2, 0.22), (0.3, 0.22)], SENSOR, 4.0)
        s.text((0.05, 0.5), "Γ, K", SENSOR)


def _reaction(s: Sketch) -> None:
    _pin(s, 0.35)
    s.arrow((-0.75, 0), (-0.75, 0.8), SENSOR)
    s.arrow((-0.75, 0), (-1.35, 0), SENSOR)


def _quantity(s: Sketch) -> None:
    s.text((0, 0.3), "f(q, t)", SENSOR, 14)
    t = np.linspace(0, 1, 100)
    s.line(np.stack([-1.1 + 2.2 * t, -0.4 + 0.25 * np.sin(14 * t) * t], axis=1), SENSOR, 1.8)


def _events(s: Sketch) -> None:
    t = np.linspace(0, 1, 100)
    way = np.stack([-1.25 + 2.5 * t, 0.7 - 1.6 * t**1.6], axis=1)
    s.line([(-1.3, -0.1), (1.3, -0.1)], INK, 1.0, dashes=(4, 3))
    s.line(way, BEAM, 2.5)
    s.ball(way[np.argmin(abs(way[:, 1] + 0.1))], 0.1, AXIS)
    s.text((0.85, 0.12), "level")
    s.text((-0.35, -0.4), "action", AXIS)


def _velocity(s: Sketch) -> None:
    s.box((0, -0.3, 0), (0.5, 0.8, 0.5))
    s.arrow((0, 0.15, 0), (0, 1.1, 0), LOAD)
    s.text((0, 1.25, 0.05), "v", LOAD)
    s.turn((0, -0.3, 0.4), UP, 0.4, (-150, 130), LOAD)
    s.text((0.4, 0.68), "ω", LOAD)


def _rates(s: Sketch) -> None:
    _pin(s, 0.35)
    s.turn((0, -0.75, 0), TOWARDS, 1.85, (-5, 28), LOAD)
    s.text((0.75, -0.3), "rate", LOAD)


def _foot(s: Sketch) -> None:
    s.ground((-1.2, 0), (-1, 0))
    s.fill(rectangle(0.6, 0.6, (0.9, 0)), BODY)


def _spring(s: Sketch) -> None:
    _foot(s)
    s.line([(-1.2, 0.2), (-1.0, 0.2)])
    s.spring((-1.2, 0.17), (0.6, 0.17))
    s.damper((-1.2, -0.17), (0.6, -0.17))


def _cable(s: Sketch) -> None:
    s.ground((-0.9, 0.7), (0, 1))
    s.line([(-0.9, 0.7), (0.1, -0.5)], INK, 1.5)
    s.ball((0.1, -0.5), 0.2)
    y = np.linspace(-0.9, 0.75, 40)
    slack = 0.7 - 0.35 * (y + 0.9) / 1.65 - 0.9 * (y + 0.9) * (0.75 - y)
    s.line(np.stack([y, slack], axis=1), "#aaaaaa", 1.2)
    s.ball((0.75, 0.35), 0.2, "#fbdcbb")


def _joint_spring(s: Sketch) -> None:
    _pin(s, 0.35)
    t = np.linspace(0, 1, 200)[:, None]
    a = 0.5 + 5 * np.pi * t
    s.line((-0.75, 0) + (0.13 + 0.3 * t) * np.hstack([np.cos(a), np.sin(a)]), INK, 1.4)


def _actuator(s: Sketch) -> None:
    _pin(s, 0.35)
    s.turn((0, -0.75, 0), TOWARDS, 0.5, (-140, 80), LOAD)
    s.text((0.15, -0.4), "T(t)", LOAD)


def _servo(s: Sketch) -> None:
    _pin(s, 0.35)
    s.line([(-0.75, 0), (1.1, 0)], AXIS, 1.2, dashes=(4, 2.5))
    s.turn((0, -0.75, 0), TOWARDS, 1.0, (14, 2), LOAD)
    s.text((0.85, -0.25), "r(t)", AXIS)


def _limits(s: Sketch) -> None:
    _pin(s, 0.35)
    for sign in (1, -1):
        a = 0.35 + 0.55 * sign
        foot = np.array([-0.75 + 0.9 * np.cos(a), 0.9 * np.sin(a)])
        s.ground(foot, (-sign * np.sin(a), sign * np.cos(a)), 0.5)


def _obstacle(s: Sketch) -> None:
    s.ground((0, -0.4), (0, -1), 2.2)
    s.ball((-0.5, 0.0), 0.4)
    s.arrow((-0.5, -0.4), (-0.5, 0.75), LOAD)


def _drive(s: Sketch) -> None:
    _pin(s, 0.45)
    s.line([(-0.75, 0), (1.1, 0)], AXIS, 1.2, dashes=(4, 2.5))
    s.turn((0, -0.75, 0), TOWARDS, 1.1, (0, 17))
    s.text((0.75, 0.2), "θ(t)", AXIS)


def _weld(s: Sketch) -> None:
    s.ground((-0.7, 0), (-1, 0), 1.3)
    s.fill(rectangle(1.6, 0.36, (0.1, 0)), BODY)
    for sign in (1, -1):
        s.fill([(-0.7, 0.18 * sign), (-0.7, 0.42 * sign), (-0.46, 0.18 * sign)], INK)


def _profile(profile: Any) -> Draw:
    """A section of rectangles, each of its own colour."""

    def draw(s: Sketch) -> None:
        for color, (a, b), (c, d) in profile:
            s.profile([(a, c), (b, c), (b, d), (a, d)], color)
        s.cross()

    return draw


def _shape(points: Any, *holes: Any) -> Draw:
    return lambda s: (s.profile(points, BEAM, holes), s.cross())


def _rings(s: Sketch) -> None:
    for radius, color in ((0.75, BODY), (0.5, BEAM), (0.22, GROUND)):
        s.profile(circle(radius), color)
    s.cross()


def _any_mesh(s: Sketch) -> None:
    from skfem import MeshTri

    mesh = MeshTri.init_circle(2)
    x = mesh.p.T * (0.9, 0.55) + 0.25 * np.stack([0 * mesh.p[1], mesh.p[0] ** 2], axis=1)
    for corners in mesh.t.T:
        s.fill(x[corners], "#c4d6f2", BEAM, 0.6)
    s.cross()


def _stored(s: Sketch) -> None:
    e = np.linspace(-1, 1, 100)
    s.arrow((-1.2, -0.6), (1.25, -0.6), INK)
    s.arrow((0, -0.75), (0, 0.85), INK)
    s.line(np.stack([1.05 * e, -0.6 + 0.5 * e**2 + 0.8 * e**4], axis=1), BEAM, 2.5)
    s.text((0.2, 0.72), "W")
    s.text((1.05, -0.82), "strain")


SHAPES: dict[str, Draw] = {
    "section_circle": _shape(circle(0.7)),
    "section_tube": _shape(circle(0.75), circle(0.52)),
    "section_rectangle": _shape(rectangle(0.8, 1.3)),
    "section_i": _shape(
        [(-0.6, -0.75), (0.6, -0.75), (0.6, -0.55), (0.08, -0.55), (0.08, 0.55), (0.6, 0.55)]
        + [(0.6, 0.75), (-0.6, 0.75), (-0.6, 0.55), (-0.08, 0.55), (-0.08, -0.55), (-0.6, -0.55)]
    ),
    "section_channel": _shape(
        [(-0.1, -0.75), (0.75, -0.75), (0.75, -0.55), (0.1, -0.55)]
        + [(0.1, 0.55), (0.75, 0.55), (0.75, 0.75), (-0.1, 0.75)]
    ),
    "section_box": _shape(rectangle(1.5, 1.1), rectangle(1.2, 0.8)),
    "section_polygon": _shape(
        [(-0.8, -0.6), (0.7, -0.7), (0.85, 0.2), (0.1, 0.7), (-0.7, 0.45)],
        [(-0.4, -0.3), (0.3, -0.35), (0.1, 0.2)],
    ),
    "section_composite": _profile(
        [(BEAM, (-0.2, 0.2), (-0.8, 0.3)), (BODY, (-0.8, 0.8), (0.3, 0.55))]
    ),
    "section_rectangles": _profile(
        [(BEAM, (-0.9, 0.9), (-0.5, -0.38)), (BODY, (-0.9, 0.9), (-0.38, 0.38))]
        + [(BEAM, (-0.9, 0.9), (0.38, 0.5))]
    ),
    "section_rings": _rings,
    "section_mesh": _any_mesh,
    "section_hyperelastic": _stored,
    "section_constants": lambda s: s.text((0, 0), "EA, GA\nEI, GJ\nmass, inertia", BEAM, 12),
}

WAVE = [(0, -1.2, -0.5), (0, -0.3, 0.6), (0, 0.5, -0.3), (0, 1.2, 0.5)]
MESHES: dict[str, Draw] = {
    "mesh_line": lambda s: s.mesh(_line(5, (0, -1.1, -0.2), (0, 1.1, 0.2))),
    "mesh_arc": lambda s: s.mesh(
        sc.MeshCurve.init_arc((0, -1.0, -0.5), (0, 0, 1), (0, 1, 0), 1.0, 2.6, 8)
    ),
    "mesh_helix": lambda s: s.mesh(
        sc.MeshCurve.init_helix((0.55, 0, -0.65), (0, 0, -0.65), (0, 0, 1), 0.5, 2.5, 30)
    ),
    "mesh_polyline": lambda s: s.mesh(
        sc.MeshCurve.init_polyline(
            [(0, -1.2, -0.5), (0, -0.4, 0.6), (0, 0.4, -0.5), (0, 1.2, 0.5)], 3
        )
    ),
    "mesh_points": lambda s: s.mesh(
        sc.MeshCurve.init_points([(0, 0.5 * k - 1.25, 0.5 * np.sin(1.3 * k)) for k in range(6)])
    ),
    "mesh_curve": lambda s: s.mesh(sc.MeshCurve.init_curve(sc.mesh.CurveSpline(WAVE), 9)),
    "mesh_closed": _closed,
    "mesh_joined": _tee,
    "mesh_apart": _apart,
    "mesh_file": _file,
    "beam_orders": _orders,
    "beam_twist": _twist,
    "beam_offset": _offset,
    "beam_director": lambda s: (
        s.line([(0, -1.2, -0.45), (0, 1.2, -0.15)], "#b9cdea", 9.0),
        s.triad((0, -0.2, -0.3), sc.triad((0, 1, 0.125), (0, 0, 1)), 0.8, label=True),
    ),
    "beam_velocity": _flying,
    "beam_theory": _theory,
    "beam_lumped": _lumped,
    "beam_parts": _parts,
}

BODIES: dict[str, Draw] = {
    "body_general": _body,
    "body_box": lambda s: s.box(ZERO, (0.7, 1.5, 0.8)),
    "body_sphere": lambda s: s.ball((0, 0), 0.65),
    "body_cylinder": lambda s: s.tube((0, 0, -0.55), (0, 0, 0.55), 0.5),
    "body_rod": lambda s: s.tube((0, 0, -0.85), (0, 0, 0.85), 0.035),
    "body_pyramid": lambda s: (
        s.fill([(0.5, 0.5, -0.7), (-0.5, 0.5, -0.7), (0, 0, 0.8)], "#d98632"),
        s.fill([(0.5, -0.5, -0.7), (0.5, 0.5, -0.7), (0, 0, 0.8)], BODY),
    ),
    "body_point": lambda s: (s.ball((0, 0), 0.14), s.text((0.35, 0.0), "m")),
    "body_on": lambda s: (_on(s), s.box((0, 0, 0.1), (0.4, 0.5, 0.4))),
    "point_on": lambda s: (_on(s), s.ball((0, 0), 0.16), s.text((0.0, 0.4), "m")),
    "start_velocity": _velocity,
    "start_rates": _rates,
    "start_equilibrium": _dead,
}

JOINTS: dict[str, Draw] = {
    "joint_fixed": _weld,
    "joint_revolute": _hinge,
    "joint_spherical": _spherical,
    "joint_universal": _universal,
    "joint_cylindrical": lambda s: _sleeve(s, True),
    "joint_prismatic": lambda s: _sleeve(s, False),
    "joint_planar": _planar,
    "joint_point_on_line": _bead,
    "joint_distance": _distance,
    "joint_drive": _drive,
    "spring": _spring,
    "cable": _cable,
    "bushing": _bushing,
    "foundation": _foundation,
    "joint_spring": _joint_spring,
    "joint_actuator": _actuator,
    "joint_servo": _servo,
    "joint_limits": _limits,
    "obstacle": _obstacle,
}

PULSE, RAMP = sc.Table([0, 0.25, 0.6, 1], [0, 1, 0.3, 0.3]), sc.RampLinear(0.25, 0.65)
LOADS: dict[str, Draw] = {
    "load_force": _dead,
    "load_follower": _follower,
    "load_moment": _moment,
    "load_line": lambda s: _line_load(s, False),
    "load_pressure": lambda s: _line_load(s, True),
    "load_strain": lambda s: (s.cantilever(), s.text((0.3, 0.6), "ΔT", LOAD)),
    "load_gravity": _gravity,
    "load_own": _own_load,
    "time_callable": lambda s: (s.chart(lambda t: t**2), s.text((-0.5, 0.4), "f(t)", LOAD)),
    "time_table": lambda s: s.chart(PULSE.value),
    "time_ramp_linear": lambda s: s.chart(RAMP.value),
    "time_ramp_smooth": lambda s: s.chart(sc.RampSmooth(0.15, 0.75).value),
    "time_harmonic": lambda s: s.chart(lambda t: 0.45 + sc.Harmonic(0.4, 3.0).value(t)),
    "motion": _motion,
    "motion_turn": _motion_turn,
    "motion_shake": _shake,
    "damping_rayleigh": _decay,
    "damping_section": _viscous,
}

SENSORS: dict[str, Draw] = {
    "sensor_position": _sensor_position,
    "sensor_velocity": lambda s: _sensor_velocity(s, "v"),
    "sensor_acceleration": lambda s: _sensor_velocity(s, "a"),
    "sensor_strain": lambda s: _cut(s, False),
    "sensor_force": lambda s: _cut(s, True),
    "sensor_reaction": _reaction,
    "sensor_quantity": _quantity,
    "events": _events,
}

SMALL = SHAPES | MESHES | BODIES | JOINTS | LOADS | SENSORS


def first_steps(s: Sketch) -> None:
    """The rod of the first page at some instants."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 16, name="rod")
    rubber = sc.SectionCircle(radius=1e-2, material=sc.Material(E=5e6, nu=0.5, rho=1100))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, rubber, director=(0, 1, 0)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    model.add("ball", sc.RigidBody.sphere(0.05, radius=0.02, on=rod.node("rod.end")))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), step=2e-3, until=0.5)
    lines = history.position(rod, s=np.linspace(0, 1, 60))[:, :, :2] * 3.0 + (-1.7, 1.55)
    s.ground((-1.7, 1.55), (0, 1))
    for k, time in enumerate((0.0, 0.2, 0.3, 0.4, 0.5)):
        row = int(np.argmin(abs(history.times - time)))
        s.beam(lines[row], alpha=0.3 + 0.17 * k)
        s.ball(lines[row, -1], 0.09)
        s.text(lines[row, -1] + ((0.4, 0.05) if k < 2 else (0.0, -0.25)), f"{time:.1f} s")
    s.ball((-1.7, 1.55), 0.07, "#ffffff")


def draw(name: str, folder: Path = FOLDER) -> Path:
    """Draw one picture and return its file."""
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.png"
    if name in SMALL:
        sketch = Sketch()
        SMALL[name](sketch)
    else:
        sketch = Sketch(*LARGE[name][:2])
        LARGE[name][2](sketch)
    sketch.png(path)
    return path


#: width, height and drawing of the others
LARGE: dict[str, tuple[float, float, Draw]] = {
    "first_steps": (4.8, 4.0, first_steps),
    "beam_triads": (7.0, 3.8, _triads),
}
NAMES = [*SMALL, *LARGE]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="default: all")
    files = [draw(name) for name in parser.parse_args().names or NAMES]
    print(f"{len(files)} pictures, {sum(path.stat().st_size for path in files) / 1e3:.0f} kB")
