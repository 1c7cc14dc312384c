"""Small pictures in one style, which ``make_pictures.py`` draws for the guide.

Points are (right, up), or (towards the viewer, right, up) in drawings in space. A picture shows
3 units across and 2 units up, the origin in its middle. The ground is grey, beams are blue, bodies
golden, axes and free motions red, loads green, and what is measured magenta.
"""

from __future__ import annotations

import io
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import skfem_cosserat as sc
from skfem_cosserat.figures import PALETTE, new_figure

GROUND, INK = "#9aa0a8", "#333333"
BEAM, BODY, AXIS, LOAD, SENSOR = (
    PALETTE[name] for name in ("blue", "gold", "red", "green", "magenta")
)
VIEW = np.array([[-0.5, 1.0, 0.0], [-0.32, 0.0, 1.0]])  # (towards, right, up) -> picture
TOWARDS = np.array([1.0, 0.5, 0.32])  # what the view leaves out
BENT = [(y, -0.16 * (y + 1.1) ** 2 + 0.35) for y in np.linspace(-1.1, 1.0, 30)]


def flat(points: ArrayLike) -> np.ndarray:
    """Points of the picture (..., 2) from points in it or in space."""
    x = np.asarray(points, dtype=float)
    return x @ VIEW.T if x.shape[-1] == 3 else x


def shade(color: str, factor: float) -> tuple[float, ...]:
    """A colour, darker (below 1) or lighter."""
    rgb = np.array([int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    return tuple(rgb * factor if factor <= 1 else 1 - (1 - rgb) * (2 - factor))


class Sketch:
    """A small picture, and what it is made of."""

    def __init__(self, width: float = 3.0, height: float = 2.0) -> None:
        self.figure = new_figure(0.8 * width, 0.8 * height)
        self.figure.set_layout_engine("none")
        self.axes = self.figure.add_axes((0, 0, 1, 1))
        self.axes.set(xlim=(-width / 2, width / 2), ylim=(-height / 2, height / 2))
        self.axes.axis("off")
        self.order = itertools.count(1)  # what is drawn later lies above

    def line(self, points: ArrayLike, color: str = INK, lw: float = 1.5, **style: Any) -> None:
        """A line through points."""
        x = flat(points)
        style = {"solid_capstyle": "round", "solid_joinstyle": "round"} | style
        self.axes.plot(*x.T, color=color, lw=lw, zorder=next(self.order), **style)

    def beam(self, points: ArrayLike, lw: float = 5.0, **style: Any) -> None:
        """A beam along points."""
        self.line(points, BEAM, lw, **style)

    def ghost(self, points: ArrayLike) -> None:
        """The same in the reference: pale."""
        self.line(points, "#b9cdea", 3.0)

    def axis(self, a: ArrayLike, b: ArrayLike) -> None:
        """An axis, dashed."""
        self.line([a, b], AXIS, 1.2, dashes=(4, 2.5))

    def text(self, where: ArrayLike, words: str, color: str = INK, size: float = 11.0) -> None:
        """Words around a point."""
        style = {"color": color, "fontsize": size, "ha": "center", "va": "center"}
        self.axes.text(*flat(where), words, zorder=next(self.order), **style)

    def arrow(self, a: ArrayLike, b: ArrayLike, color: str = LOAD, head: str = "-|>") -> None:
        """An arrow from a to b."""
        style = {"arrowstyle": f"{head},head_length=0.35,head_width=0.2", "lw": 1.8}
        style |= {"color": color, "shrinkA": 0, "shrinkB": 0}
        self.axes.annotate("", flat(b), flat(a), arrowprops=style, zorder=next(self.order))

    def both(self, a: ArrayLike, b: ArrayLike, color: str = AXIS) -> None:
        """An arrow to both sides: a free motion."""
        self.arrow(a, b, color, "<|-|>")

    def turn(
        self, centre: ArrayLike, normal: ArrayLike, radius: float, span: Any, color: str = AXIS
    ) -> None:
        """An arrow on a circle about an axis, from an angle to another one (degrees)."""
        d1, d2, _ = sc.triad(normal)
        angles = np.radians(np.linspace(*span, 30))[:, None]
        x = flat(centre) + flat(radius * (np.cos(angles) * d1 + np.sin(angles) * d2))
        self.line(x[:-1], color, 1.8)
        self.arrow(x[-4], x[-1], color)

    def fill(self, points: ArrayLike, color: Any, edge: Any = INK, lw: float = 0.8) -> None:
        """A filled polygon."""
        style = {"facecolor": color, "edgecolor": edge, "lw": lw, "zorder": next(self.order)}
        self.axes.fill(*flat(points).T, joinstyle="round", **style)

    def solid(self, base: ArrayLike, vector: ArrayLike, color: str, smooth: bool = False) -> None:
        """A polygon (counter-clockwise about the vector), drawn out along the vector."""
        low = np.asarray(base, dtype=float)
        high = low + vector
        for a, b, c, d in zip(low, np.roll(low, -1, 0), np.roll(high, -1, 0), high, strict=True):
            normal = np.cross(b - a, d - a)
            if normal @ TOWARDS > 0:
                bright = 0.72 + 0.28 * normal @ (0.3, 0.5, 0.8) / np.linalg.norm(normal)
                face = shade(color, float(bright))
                self.fill([a, b, c, d], face, face if smooth else INK)
        near = high if np.dot(vector, TOWARDS) > 0 else low
        self.fill(near, shade(color, 1.25))

    def box(self, centre: ArrayLike, edges: ArrayLike, color: str = BODY) -> None:
        """A box with edges along the axes."""
        a, b, c = np.diag(np.asarray(edges, dtype=float))
        corner = np.asarray(centre) - (a + b + c) / 2
        self.solid([corner, corner + a, corner + a + b, corner + b], c, color)

    def tube(self, a: ArrayLike, b: ArrayLike, radius: float, color: str = BODY) -> None:
        """A cylinder from a to b."""
        start, vector = np.asarray(a, dtype=float), np.subtract(b, a)
        d1, d2, _ = sc.triad(vector)
        angles = np.linspace(0, 2 * np.pi, 49)[:-1, None]
        circle = start + radius * (np.cos(angles) * d1 + np.sin(angles) * d2)
        self.solid(circle, vector, color, smooth=True)

    def ball(self, centre: ArrayLike, radius: float, color: str = BODY) -> None:
        """A ball."""
        angles = np.linspace(0, 2 * np.pi, 60)[:, None]
        ring = np.hstack([np.cos(angles), np.sin(angles)])
        self.fill(flat(centre) + radius * ring, color)
        if radius > 0.06:
            self.fill(flat(centre) + 0.3 * radius * (ring + (-0.9, 1.0)), shade(color, 1.7), "none")

    def ground(self, at: ArrayLike, into: Sequence[float] = (0, -1), width: float = 0.5) -> None:
        """The ground, on the side `into` of a point."""
        n = np.array(into, dtype=float) / np.linalg.norm(into)
        along = np.array([-n[1], n[0]]) * width / 2
        x = flat(at)
        self.fill(
            [x - along, x + along, x + along + 0.14 * n, x - along + 0.14 * n], GROUND, "none"
        )
        self.line([x - along, x + along], INK, 1.5)

    def spring(self, a: ArrayLike, b: ArrayLike, turns: int = 6) -> None:
        """A spring between two points."""
        a, b = flat(a), flat(b)
        side = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a) * 0.1
        s = np.concatenate([[0, 0.15], 0.15 + 0.7 * (np.arange(2 * turns) + 0.5) / (2 * turns)])
        s = np.append(s, [0.85, 1.0])
        sign = np.array([0, 0, *([1, -1] * turns), 0, 0])
        self.line(a + np.outer(s, b - a) + np.outer(sign, side), INK, 1.4)

    def damper(self, a: ArrayLike, b: ArrayLike) -> None:
        """A damper between two points."""
        a, b = flat(a), flat(b)
        side = np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a) * 0.09
        p, q, r = a + 0.38 * (b - a), a + 0.66 * (b - a), a + 0.52 * (b - a)
        self.line([a, p], INK, 1.4)
        self.line([q + side, p + side, p - side, q - side], INK, 1.4)
        self.line([r + 0.8 * side, r - 0.8 * side], INK, 2.2)
        self.line([r, b], INK, 1.4)

    def mesh(self, mesh: Any) -> None:
        """A mesh: its elements on their curves, and its vertices."""
        for e in range(mesh.nelements):
            x = mesh.mapping().F(np.linspace(0, 1, 12)[None], tind=np.array([e]))[:, 0].T
            self.beam(x, 3.0)
        for x in mesh.p.T:
            self.ball(x, 0.045, "#ffffff")

    def triad(self, at: ArrayLike, triad: ArrayLike, size: float, label: bool = False) -> None:
        """A triad of directors: d1 red, d2 green, d3 blue."""
        for k, (d, color) in enumerate(zip(np.asarray(triad), (AXIS, LOAD, BEAM), strict=True)):
            end = np.asarray(at) + size * d
            self.arrow(at, end, color)
            if label:
                self.text(end + 0.13 * d, f"d{k + 1}", color)

    def profile(self, points: ArrayLike, color: Any = BEAM, holes: Any = ()) -> None:
        """A section, d1 to the right and d2 up."""
        self.fill(points, color if isinstance(color, tuple) else shade(color, 1.45))
        for hole in holes:
            self.fill(hole, "white")

    def cross(self) -> None:
        """The axes of a section."""
        self.arrow((0, 0), (1.15, 0), AXIS)
        self.arrow((0, 0), (0, 0.9), LOAD)
        self.text((1.3, 0), "d1", AXIS)
        self.text((0.17, 0.87), "d2", LOAD)

    def chart(self, function: Callable[[float], float], top: float = 1.0) -> None:
        """A function over [0, 1]."""
        t = np.linspace(0, 1, 400)
        self.arrow((-1.2, -0.6), (1.25, -0.6), INK)
        self.arrow((-1.2, -0.75), (-1.2, 0.85), INK)
        self.text((1.3, -0.78), "t")
        points = [(-1.2 + 2.2 * s, -0.6 + 1.2 * function(float(s)) / top) for s in t]
        self.line(points, LOAD, 2.5)

    def cantilever(self) -> None:
        """A bent cantilever."""
        self.ghost([(-1.1, 0.35), (1.1, 0.35)])
        self.ground((-1.1, 0.35), (-1, 0))
        self.beam(BENT)

    def png(self, path: Path, colors: int = 64) -> None:
        """Write a small file of few colours."""
        from PIL import Image

        memory = io.BytesIO()
        self.figure.savefig(memory, dpi=100)
        picture = Image.open(memory).convert("RGB")
        picture.quantize(colors, dither=Image.Dither.NONE).save(path, optimize=True)


def circle(radius: float, centre: ArrayLike = (0, 0)) -> np.ndarray:
    """Points of a circle."""
    angles = np.linspace(0, 2 * np.pi, 60)
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1) + centre


def rectangle(a: float, b: float, centre: ArrayLike = (0, 0)) -> np.ndarray:
    """Corners of a rectangle."""
    return np.array([(-a, -b), (a, -b), (a, b), (-a, b)]) / 2 + centre
