"""Pictures and films of scenes, meshes, histories and modes (pyvista, optional).

A scene is drawn as layers: a mesh whose points follow the state, in one colour or coloured by a
resultant. A picture shows layers at some instants, a film moves their points, and a scene before a
run is a history of one state, its reference.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, partial
from io import BytesIO
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from .analysis.describe import describe, path_formulas
from .errors import CosseratError, InputError, writing
from .export.geometry import BeamShape, BodyShape, Surface, beam_shapes, body_shapes, frames
from .figures import MISSING, PALETTE, check_folder
from .history import History
from .model import system_of
from .types import Array, ArrayLike, FilePath, Floats, IndexArray, positive

if TYPE_CHECKING:
    from .mesh import MeshCurve

Row: TypeAlias = Mapping[str, Array]
#: position, focal point and upward direction of a camera, or the name of one
Camera: TypeAlias = str | Sequence[Sequence[float]]

#: colours of what is drawn, as the legend has them
COLOURS = {
    "beam": "steelblue",
    "body": "#99a8bf",
    "mass point": PALETTE["brown"],
    "joint": "#df8a00",
    "ground": "#50565e",
    "spring, cable": PALETTE["green"],
    "force": PALETTE["red"],
    "moment": PALETTE["magenta"],
    "d1": PALETTE["indigo"],
    "d2": PALETTE["sky"],
}
#: towards the camera, and up
_VIEWS: dict[str, tuple[ArrayLike, ArrayLike]] = {
    "xy": ((0, 0, 1), (0, 1, 0)),
    "xz": ((0, -1, 0), (0, 0, 1)),
    "yz": ((1, 0, 0), (0, 0, 1)),
    "iso": ((1, 1, 1), (0, 0, 1)),
}
#: arrows of a load along a beam
_ARROWS = 12
#: frames of a film, and those of a second in a GIF, which counts in hundredths of a second
_FRAMES, _GIF = 5000, 50

# -- a working driver, without which VTK ends the process ------------------------------------------

_PROBE = """
import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow
window = vtkRenderWindow()
window.SetOffScreenRendering(1)
window.SetSize(8, 8)
window.AddRenderer(vtkRenderer())
window.Render()
"""


def _opens(environment: Mapping[str, str]) -> bool:
    """True if another process could draw a picture: VTK without OpenGL ends its process."""
    command = [sys.executable, "-c", _PROBE]
    try:
        run = subprocess.run(
            command, env=dict(environment), capture_output=True, timeout=60, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return run.returncode == 0


@cache
def _driver() -> bool:
    """True if pictures can be drawn here; looked for once in a process."""
    key = "VTK_DEFAULT_OPENGL_WINDOW"
    if sys.platform == "linux" and not os.environ.get("DISPLAY") and key not in os.environ:
        direct = {key: "vtkEGLRenderWindow"}  # at once: VTK warns if it has to look for a display
        if _opens(os.environ | direct):
            os.environ |= direct
            return True
    return _opens(os.environ)


def _pyvista() -> Any:
    """The package, if there is one that can draw."""
    try:
        import pyvista
    except ImportError as error:
        raise ImportError(f"pyvista {MISSING}") from error
    if not _driver():
        text = "pictures need OpenGL, and no driver works here: on Linux without a graphics card"
        raise CosseratError(f"{text} install Mesa (libegl1 libgl1 libgl1-mesa-dri)")
    return pyvista


# -- layers: meshes whose points follow the state --------------------------------------------------


class Layer(NamedTuple):
    """Mesh of some items.

    Attributes
    ----------
    name : str
        What the legend calls it, if it is not plain.
    colour : str
    mesh : PolyData
    points : callable
        Points (k, 3) by the row of a state.
    values : callable, optional
        Numbers of the faces instead of the colour.
    fades : bool
        Whether it is drawn at earlier instants, too.
    """

    name: str
    colour: str
    mesh: Any
    points: Callable[[Row], Floats]
    values: Callable[[Row], Floats] | None = None
    fades: bool = False


def _mesh(pieces: Sequence[tuple[int, Iterable[IndexArray]]], kind: str = "faces") -> Any:
    """Mesh of pieces: their numbers of points, and their cells, arrays (m, k) or (k,)."""
    import pyvista

    cells = []
    starts = accumulate((count for count, _ in pieces), initial=0)
    for start, (_, own) in zip(starts, pieces, strict=False):
        for each in own:
            rows = np.atleast_2d(each) + start
            cells.append(np.insert(rows, 0, rows.shape[1], axis=1).ravel())
    total = sum(count for count, _ in pieces)
    return pyvista.PolyData(np.zeros((total, 3)), **{kind: np.concatenate(cells)})


def _frames(vectors: Floats, width: float | None = None) -> Floats:
    """Rows e1, e2 across vectors (n, 3), and the vectors; e1 and e2 are as long as they, or so."""
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    unit = vectors / np.where(size > 0, size, 1.0)
    e1 = np.cross(unit, np.eye(3)[np.argmin(abs(unit), axis=-1)])
    e1 /= np.maximum(np.linalg.norm(e1, axis=-1, keepdims=True), 1e-12)
    across = size if width is None else width
    return np.stack([across * e1, across * np.cross(unit, e1), vectors], axis=-2)


@cache
def _glyph(kind: str) -> tuple[Floats, IndexArray]:
    """Points and triangles of a shape of unit size along the third axis."""
    import pyvista

    def bar(radius: float, start: float, stop: float, axis: int = 2) -> Any:
        way = np.eye(3)[axis]
        size = {"radius": radius, "height": stop - start, "resolution": 20}
        return pyvista.Cylinder(center=0.5 * (start + stop) * way, direction=way, **size)

    def cone(tip: float, base: float, radius: float, resolution: int) -> Any:
        way = {"center": (0, 0, 0.5 * (tip + base)), "direction": (0, 0, tip - base)}
        size = {"height": abs(tip - base), "radius": radius, "resolution": resolution}
        return pyvista.Cone(**way, **size)

    shapes = {
        "arrow": lambda: [bar(0.025, 0.0, 0.75), cone(1.0, 0.72, 0.09, 20)],
        "double": lambda: [
            bar(0.025, 0.0, 0.75),
            cone(0.78, 0.5, 0.09, 20),
            cone(1.0, 0.72, 0.09, 20),
        ],
        "ball": lambda: [pyvista.Sphere(radius=1.0, theta_resolution=20, phi_resolution=20)],
        "box": lambda: [pyvista.Cube(x_length=1.7, y_length=1.7, z_length=1.7)],
        "pin": lambda: [bar(0.8, -1.7, 1.7)],
        "cross": lambda: [bar(0.6, -1.8, 1.8), bar(0.6, -1.8, 1.8, 0)],
        "slide": lambda: [bar(0.3, -4.0, 4.0)],
        "disc": lambda: [bar(2.6, -0.2, 0.2)],
        "ring": lambda: [pyvista.ParametricTorus(ringradius=2.0, crosssectionradius=0.35)],
        "ground": lambda: [cone(0.0, 2.6, 1.7, 4)],
    }
    first, *others = shapes[kind]()
    whole = first.append_polydata(*others).triangulate()
    return np.array(whole.points, dtype=float), whole.regular_faces


def _copies(name: str, kind: str, count: int, placed: Callable[[Row], Any]) -> Layer:
    """Layer of shapes; `placed` gives places (count, 3) and rows (count, 3, 3) of their axes."""
    points, triangles = _glyph(kind)

    def moved(row: Row) -> Floats:
        x, axes = placed(row)
        return np.reshape(np.asarray(x)[:, None] + points @ axes, (-1, 3))

    return Layer(name, COLOURS[name], _mesh([(len(points), [triangles])] * count), moved)


class Scene:
    """What is drawn of a history.

    Parameters
    ----------
    history : History
    instants : sequence of int
        Numbers of the states that are shown.
    colour : str
        "M", "N" or "".
    radius : float, optional
        Of tubes instead of sections (m).

    Attributes
    ----------
    size : float
        Extent of all that is shown (m).
    limits : (2,) float
        Range of the colours.
    """

    def __init__(
        self, history: History, instants: Sequence[int], colour: str, radius: float | None
    ) -> None:
        self.history, self.colour = history, colour
        some = np.linspace(0, len(instants) - 1, min(len(instants), 100)).round()
        self.rows = [history.row(instants[int(k)]) for k in some]
        self.shapes = beam_shapes(history.meta, history.static)
        self.bodies = list(body_shapes(history.meta, history.static))
        drawn = [*self.shapes, *self.bodies]
        if not drawn:
            raise InputError("history", "has no beams, bodies or mass points to be drawn")
        points = np.concatenate([each.points(row["q"]) for row in self.rows for each in drawn])
        loads = history.meta.get("loads", ())
        pulls = [load["acceleration"] for load in loads if "acceleration" in load]
        #: acceleration by gravity (3,), if there is any
        self.gravity = np.sum(pulls, axis=0) if np.any(pulls) else None
        self.size = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
        self.middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        self.outlines = [self._outlines(shape, radius) for shape in self.shapes]
        widths = [abs(each).max() for own in self.outlines for each in own.values()]
        #: unit of joints: they are seen around beams, unless these are very thick
        widest = 1.3 * max(widths, default=0.0) / self.size
        self.unit = self.size * float(np.clip(widest, 0.01, 0.025))
        tops = [self._forces(row, s).max() for s in self.shapes for row in self.rows if colour]
        self.limits = 0.0, float(max(tops, default=0.0)) or 1.0

    def series(self, list_name: str, kind: str, what: str) -> Iterator[tuple[Any, str]]:
        """Entries of the meta data whose series is there, with its name."""
        for entry in self.history.meta.get(list_name, ()):
            name = f"{kind}/{entry['name']}/{what}"
            if name in self.history:
                yield entry, name

    def _outlines(self, shape: BeamShape, radius: float | None) -> dict[int, Floats]:
        """Outline by section; a circle where there is none or a radius is given."""
        angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
        circle = np.column_stack([np.cos(angle), np.sin(angle)])
        tube = (0.006 * self.size if radius is None else radius) * circle
        found = {}
        for section in map(int, np.unique(shape.section)):
            own = shape.outline(section) if radius is None else None
            found[section] = tube if own is None else own
        return found

    def _forces(self, row: Row, shape: BeamShape) -> Floats:
        """Norm of the resultant on the pieces of a beam's elements; zero if it is not known."""
        key = f"beam/{shape.name}/resultant"
        if key not in row or not self.colour:
            return np.zeros(len(shape.connectivity) * shape.pieces)
        three = row[key][..., :3] if self.colour == "N" else row[key][..., 3:]
        mean = shape.average(three[..., None, :], shape.pieces)
        return np.asarray(np.linalg.norm(mean[:, 0], axis=1))

    def layers(self, directors: bool = False) -> list[Layer]:
        """All layers that the scene has something for."""
        made = [self._beams(), self._surfaces(), self._balls(), *self._lines(), *self._joints()]
        made += [self._ground(), *self._loads()]
        if directors:
            made += [self._directors(0), self._directors(1)]
        return [layer for layer in made if layer is not None]

    def _beams(self) -> Layer | None:
        if not self.shapes:
            return None
        sweeps = [s.surface(own) for s, own in zip(self.shapes, self.outlines, strict=True)]
        cells = [_cells(shape, sweep) for shape, sweep in zip(self.shapes, sweeps, strict=True)]

        def values(row: Row) -> Floats:
            own = [self._forces(row, s)[c] for s, c in zip(self.shapes, cells, strict=True)]
            return np.concatenate(own)

        keys = (f"beam/{shape.name}/resultant" for shape in self.shapes)
        known = self.colour and any(key in self.history for key in keys)
        return Layer(
            "beam",
            COLOURS["beam"],
            _mesh([(sweep.size, [sweep.quads, *sweep.caps]) for sweep in sweeps]),
            lambda row: np.concatenate([sweep.points(row["q"]) for sweep in sweeps]),
            values if known else None,
            fades=True,
        )

    def _surfaces(self) -> Layer | None:
        solid = [body for body in self.bodies if body.material is not None]
        if not solid:
            return None
        pieces = [(len(body.points(self.rows[0]["q"])), [body.faces]) for body in solid]
        return Layer(
            "body",
            COLOURS["body"],
            _mesh(pieces),
            lambda row: np.concatenate([body.points(row["q"]) for body in solid]),
            fades=True,
        )

    def _balls(self) -> Layer | None:
        points = [body for body in self.bodies if body.material is None]
        if not points:
            return None
        axes = 0.014 * self.size * np.eye(3)

        def placed(row: Row) -> Any:
            return np.concatenate([each.points(row["q"]) for each in points]), axes

        return _copies("mass point", "ball", len(points), placed)._replace(fades=True)

    def _lines(self) -> Iterator[Layer]:
        """Springs as coils, other lines straight; a ring where both ends are one point."""
        known = list(self.series("couplings", "coupling", "ends"))
        short = {key for _, key in known if self._length(key) < 0.01 * self.size}
        s = np.linspace(0.0, 1.0, 121)
        wound = 2 * np.pi * np.clip(10 * s - 1.5, 0, 7)
        out = self.unit * np.clip(np.minimum(10 * s - 1.5, 8.5 - 10 * s), 0, 1)
        coil = np.column_stack([out * np.cos(wound), out * np.sin(wound), s])
        straight = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        rods = [key for _, key in self.series("joints", "joint", "ends")]
        keys = {"coil": [], "line": [], "rod": rods}  # type: dict[str, list[str]]
        for entry, key in known:
            if key not in short:
                keys["coil" if entry["type"] == "spring" else "line"].append(key)
        for kind, own in keys.items():
            if own:
                name, form = ("joint" if kind == "rod" else "spring, cable"), straight
                form = coil if kind == "coil" else straight
                chain_of = [(len(form), [np.arange(len(form))])] * len(own)
                points = partial(_between, own, form)
                mesh = _mesh(chain_of, "lines")
                yield Layer(name, COLOURS[name], mesh, points, fades=True)
        if short:
            flat = 1.0 * self.unit * np.eye(3)
            places = lambda row: ([row[key][0] for key in sorted(short)], flat)  # noqa: E731
            yield _copies("spring, cable", "ring", len(short), places)

    def _length(self, key: str) -> float:
        return float(np.linalg.norm(np.ptp(self.rows[0][key], axis=0)))

    def _joints(self) -> Iterator[Layer]:
        """A shape for what is free: a ball, a pin, a box; with a bar or a disc for what slides."""
        for entry, key in self.series("joints", "joint", "position"):
            name, static = f"joint/{entry['name']}/", self.history.static
            turns, slides = (static.get(name + each) for each in ("turns", "slides"))
            slides = np.zeros((0, 3)) if slides is None else slides
            kinds = ["ball" if turns is None else ("box", "pin", "cross")[min(len(turns), 2)]]
            if len(slides):
                kinds = ["disc"] if len(slides) > 1 else [*kinds, "slide"]
            ways = np.concatenate([np.zeros((0, 3)) if turns is None else turns, slides])
            axes = _frames(ways[:1] if len(ways) else np.eye(3)[2:])[0]
            if "cross" in kinds:
                axes = np.array([ways[1], np.cross(ways[0], ways[1]), ways[0]])
            offset = int(static.get(name + "frame", -1))
            for kind in kinds:
                yield _copies("joint", kind, 1, partial(self._at_joint, key, axes, offset))

    def _at_joint(self, key: str, axes: Floats, offset: int, row: Row) -> Any:
        turned = axes if offset < 0 else axes @ frames(row["q"], [offset])[1][0]
        return row[key][None], self.unit * turned

    def _ground(self) -> Layer | None:
        """Pyramids under the places of joints and springs that belong to the ground."""
        at = []
        for entry, key in self.series("joints", "joint", "position"):
            at += [(key, None) for side in "ab" if entry[side].startswith("ground")]
        for entry, key in self.series("couplings", "coupling", "ends"):
            at += [(key, k) for k, side in enumerate("ab") if entry[side].startswith("ground")]
        if not at:
            return None
        down = np.array([0.0, 0.0, -1.0]) if self.gravity is None else self.gravity
        axes = self.unit * _frames(down[None] / np.linalg.norm(down))[0]

        def placed(row: Row) -> Any:
            return [row[key] if k is None else row[key][k] for key, k in at], axes

        return _copies("ground", "ground", len(at), placed)

    def _loads(self) -> Iterator[Layer]:
        """Arrows of forces and of moments, each load by its own largest."""
        for what, kind in (("force", "arrow"), ("moment", "double")):
            drawn = []
            for entry, key in self.series("loads", "load", what):
                top = max(np.linalg.norm(row[key], axis=-1).max(initial=0.0) for row in self.rows)
                if not top:
                    continue
                count = self.rows[0][key].shape[0]
                stride = -(-count // _ARROWS)
                some = np.arange((count - 1) % stride // 2, count, stride)
                place = f"load/{entry['name']}/position"
                row = max(self.rows, key=lambda row: float(np.linalg.norm(row[key])))
                outward = float(np.sum(row[key] * (row[place] - self.middle)))
                inside = any(self._inside(body, row, row[place][some[0]]) for body in self.bodies)
                tail = what == "moment" or inside or outward > 0.1 * top * self.size
                drawn.append((place, key, some, 0.15 * self.size / top, tail))
            if drawn:
                count = sum(len(each[2]) for each in drawn)
                yield _copies(what, kind, count, partial(_arrows, drawn))

    def _inside(self, body: BodyShape, row: Row, x: Floats) -> bool:
        """True if a body would hide the tip of an arrow at a place."""
        points = body.points(row["q"])
        middle = points.mean(axis=0)
        return (
            float(np.linalg.norm(x - middle)) < 0.9 * np.linalg.norm(points - middle, axis=1).max()
        )

    def _directors(self, which: int) -> Layer | None:
        """Arrows of a director at three places of each beam."""
        if not self.shapes:
            return None
        length = 0.05 * self.size

        def placed(row: Row) -> Any:
            x, axes = [], []
            for shape in self.shapes:
                centre, d = shape.axes(row["q"])
                ne = len(centre)
                for e in np.unique([0, ne // 2, ne - 1]):
                    x.append(centre[e].mean(axis=0))
                    axes.append(length * _frames(d[e, :, which].mean(axis=0)[None])[0])
            return np.array(x), np.array(axes)

        count = len(placed(self.rows[0])[0])
        return _copies(f"d{which + 1}", "arrow", count, placed)

    def names(self) -> Iterator[tuple[str, Callable[[Row], Floats]]]:
        """Names of items, and where they are."""
        for shape in self.shapes:
            yield shape.name, lambda row, shape=shape: _middle(shape.points(row["q"]))
        for body in self.bodies:
            yield body.name, lambda row, body=body: body.points(row["q"]).mean(axis=0)
        for entry, key in self.series("joints", "joint", "position"):
            yield entry["name"], lambda row, key=key: row[key]
        for entry, key in self.series("couplings", "coupling", "ends"):
            yield entry["name"], lambda row, key=key: row[key].mean(axis=0)
        for entry, key in self.series("loads", "load", "position"):
            if self.rows[0][key].size:
                yield entry["name"], lambda row, key=key: _middle(row[key])


def _middle(points: Floats) -> Floats:
    return np.asarray(points[len(points) // 2])


def _cells(shape: BeamShape, sweep: Surface) -> IndexArray:
    """Number of the piece of an element that each face of a swept beam belongs to."""
    own = sweep.element * shape.pieces + sweep.piece
    ends = [own[(sweep.quads == ring[0]).any(axis=1)][0] for ring in sweep.caps]
    return np.concatenate([own, np.array(ends, dtype=np.int64)])


def _between(keys: Sequence[str], form: Floats, row: Row) -> Floats:
    """Points of lines of a form from one end to the other."""
    ends = np.array([row[key] for key in keys])
    return np.reshape(ends[:, :1] + form @ _frames(ends[:, 1] - ends[:, 0], 1.0), (-1, 3))


def _arrows(drawn: Sequence[Any], row: Row) -> tuple[Floats, Floats]:
    """Tails of arrows, and their frames."""
    x, ways = [], []
    for place, key, some, scale, tail in drawn:
        way = scale * row[key][some]
        ways.append(way)
        x.append(row[place][some] - (0.0 if tail else way))
    return np.concatenate(x), _frames(np.concatenate(ways))


# -- the stage: a plotter with layers, a camera, names and a clock ---------------------------------


def _faded(colour: Any, strength: float) -> Floats:
    """Mix colours with white; opaque, as transparency needs sorted faces."""
    from matplotlib.colors import to_rgba_array

    return 1.0 - strength * (1.0 - to_rgba_array(colour)[..., :3])


class Stage:
    """A white window on layers.

    Parameters
    ----------
    window : (2,) int
        Width and height in pixels.
    off_screen : bool
    """

    def __init__(self, window: tuple[int, int], off_screen: bool = True) -> None:
        # drawn at twice the size: smooth edges in less time than OpenGL in software takes for them
        self.finer = 2 if off_screen else 1
        self.width, self.height = (self.finer * each for each in window)
        size = [self.width, self.height]
        self.plotter = _pyvista().Plotter(off_screen=off_screen, window_size=size)
        self.plotter.set_background("white")
        self.font = max(11 * self.finer, self.width // 70)
        self.layers: list[Layer] = []
        self.labels: list[tuple[Any, Callable[[Row], Floats], Floats]] = []

    def add(
        self, layer: Layer, row: Row, strength: float = 1.0, limits: Any = None, title: str = ""
    ) -> None:
        """Show a layer at a state; pale ones give way to others at the same place."""
        from matplotlib import colormaps
        from matplotlib.colors import ListedColormap

        mesh = layer.mesh.copy()
        mesh.points = layer.points(row)
        options: dict[str, Any] = {"color": _faded(layer.colour, strength)[0]}
        if layer.values is not None:
            mesh.cell_data[title] = layer.values(row)
            table = ListedColormap(_faded(colormaps["viridis"](np.linspace(0, 1, 256)), strength))
            bar = {"title": title, "fmt": "%.3g", "color": "black", "n_labels": 2}
            bar |= {"width": 0.3, "height": 0.07, "position_x": 0.35, "position_y": 0.02}
            bar |= {"title_font_size": self.font, "label_font_size": self.font}
            options = {"scalars": title, "cmap": table, "clim": limits, "scalar_bar_args": bar}
            options["show_scalar_bar"] = strength == 1.0
        options["line_width"] = max(2.0, self.width / 450)
        actor = self.plotter.add_mesh(mesh, ambient=0.25, reset_camera=False, **options)
        if strength == 1.0:
            self.layers.append(layer._replace(mesh=mesh))
        else:
            actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
            actor.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(4.0, 4.0)

    def move(self, row: Row, title: str = "") -> None:
        """Show the layers at another state."""
        for layer in self.layers:
            layer.mesh.points = layer.points(row)
            if layer.values is not None:
                layer.mesh.cell_data[title] = layer.values(row)
        self._place_names(row)

    def fit(self, points: Floats, camera: Camera, right_end: float = 0.92) -> None:
        """Look at points (k, 3), all of which are in the picture if the camera has a name.

        They take its middle, above the scale and the axes, up to `right_end` of its width.
        """
        if not isinstance(camera, str):
            self.plotter.camera_position = [tuple(map(float, each)) for each in camera]
            return
        out, up = (np.array(each, dtype=float) for each in _VIEWS[camera])
        out /= np.linalg.norm(out)
        right = np.cross(up, out) / np.linalg.norm(np.cross(up, out))
        plane = np.array([right, np.cross(out, right), out])
        low, high = (points @ plane.T).min(axis=0), (points @ plane.T).max(axis=0)
        wide, tall = (high - low)[:2] / (right_end - 0.08, 0.68)
        scale = 0.5 * max(tall, wide * self.height / self.width) or 1.0
        aside = (right_end - 0.92) * scale * self.width / self.height
        focus = 0.5 * (low + high) - (aside, 0.16 * scale, 0.0)
        away = float(np.linalg.norm(high - low)) + scale
        eye = focus + (0.0, 0.0, 2 * away)
        camera_ = [tuple(focus_ @ plane) for focus_ in (eye, focus)]
        self.plotter.camera_position = [*camera_, tuple(plane[1])]
        self.plotter.enable_parallel_projection()
        self.plotter.camera.parallel_scale = scale

    def axes(self, gravity: Floats | None = None) -> None:
        """The axes in a corner, and where gravity pulls."""
        from vtkmodules.vtkCommonTransforms import vtkTransform
        from vtkmodules.vtkRenderingAnnotation import vtkAxesActor
        from vtkmodules.vtkRenderingCore import vtkPropAssembly

        both = vtkPropAssembly()
        for vector in [None] if gravity is None else [None, gravity]:
            actor = vtkAxesActor()
            actor.SetTotalLength(1.0, 1.0, 1.0)
            actor.SetShaftTypeToCylinder()
            both.AddPart(actor)
            for axis, letter in zip("XYZ", "xyz", strict=True):
                getattr(actor, f"Set{axis}AxisLabelText")(letter if vector is None else "")
                caption = getattr(actor, f"Get{axis}AxisCaptionActor2D")()
                caption.GetCaptionTextProperty().SetColor(0.0, 0.0, 0.0)
            if vector is not None:
                unit = vector / np.linalg.norm(vector)
                e1, e2, e3 = _frames(unit[None])[0]
                matrix = np.eye(4)
                matrix[:3, :3] = np.column_stack([e3, e1, e2])
                turned = vtkTransform()
                turned.SetMatrix(matrix.ravel())
                actor.SetUserTransform(turned)
                actor.SetTotalLength(1.0, 1e-6, 1e-6)
                actor.SetXAxisLabelText("g")
                actor.GetXAxisShaftProperty().SetColor(0.3, 0.3, 0.3)
                actor.GetXAxisTipProperty().SetColor(0.3, 0.3, 0.3)
        self.plotter.add_orientation_widget(both)
        self.plotter.renderer.axes_widget.SetViewport(
            0.0, 0.0, 0.16, 0.16 * self.width / self.height
        )

    def shot(self) -> Array:
        """The picture (height, width, 3)."""
        from PIL import Image

        self.plotter.renderer.ResetCameraClippingRange()
        self.plotter.render()
        image = self.plotter.screenshot(return_img=True)
        return np.asarray(Image.fromarray(image[..., :3]).reduce(self.finer))

    def _projection(self) -> Floats:
        """Matrix (4, 4) from space to the window, from -1 to 1."""
        import pyvista

        camera = self.plotter.camera
        matrix = camera.GetCompositeProjectionTransformMatrix(self.width / self.height, -1, 1)
        return np.array(pyvista.array_from_vtkmatrix(matrix))

    def pixels(self, points: Floats) -> Floats:
        """Where points (k, 3) are in the window (k, 2), from its lower left corner."""
        seen = np.column_stack([points, np.ones(len(points))]) @ self._projection().T
        return 0.5 * (seen[:, :2] / seen[:, 3:] + 1.0) * (self.width, self.height)

    def write_names(self, names: Iterable[tuple[str, Callable[[Row], Floats]]], row: Row) -> None:
        """Names beside things; several at one place are one text."""
        import pyvista

        found: list[tuple[list[str], Callable[[Row], Floats], Floats]] = []
        for name, where in names:
            (at,) = self.pixels(where(row)[None])
            near = [texts for texts, _, other in found if abs(other - at).max() < 0.6 * self.font]
            if near:
                near[0].append(name)
            else:
                found.append(([name], where, at))
        drawn = (self.shot() < 250).any(axis=2)[::-1].repeat(self.finer, 0).repeat(self.finer, 1)
        taken: list[Floats] = []
        for texts, where, at in found:
            text = ", ".join(texts)
            box = np.array([0.56 * self.font * len(text), 1.25 * self.font])
            corner = self._room(at, box, drawn, taken)
            taken.append(np.array([corner, corner + box]))
            label = pyvista.Label(text.replace("$", r"\$"), size=self.font)
            label.prop.color = "black"
            self.plotter.add_actor(label, reset_camera=False)
            self.labels.append((label, where, corner - at))
        self._place_names(row)

    def _room(self, at: Floats, box: Floats, drawn: Array, taken: Sequence[Floats]) -> Floats:
        """Lower left corner (2,) of a text near a point of the window, where it covers least."""
        best, least = at, np.inf
        window = np.array([self.width, self.height])
        for k, way in enumerate(np.exp(2j * np.pi / 8 * np.arange(40))):
            out = np.array([way.real, way.imag])
            gap = (0.8 + 1.1 * (k // 8)) * self.font
            corner = at + gap * out + 0.5 * box * (out / abs(out).max()) - 0.5 * box
            corner = np.clip(corner, (0.01 * self.width, 0.15 * self.height), 0.99 * window - box)
            (left, low), (right, high) = corner.astype(int), (corner + box).astype(int)
            covered = float(drawn[low:high, left:right].mean())
            overlaps = [bool(((c[0] < corner + box) & (c[1] > corner)).all()) for c in taken]
            cost = 100.0 * sum(overlaps) + 20.0 * covered + k // 8
            if cost < least:
                best, least = corner, cost
        return np.asarray(best)

    def _place_names(self, row: Row) -> None:
        """Move names with what they belong to."""
        if not self.labels:
            return
        projection = self._projection()
        back = np.linalg.inv(projection)
        for label, where, shift in self.labels:
            seen = projection @ np.append(where(row), 1.0)
            seen /= seen[3]
            seen[:2] += 2.0 * shift / (self.width, self.height)
            space = back @ seen
            label.position = tuple(space[:3] / space[3])

    def legend(self) -> None:
        """What the colours mean, at the lower right."""
        shown = {layer.name: layer.colour for layer in self.layers if layer.values is None}
        entries = [[name, _faded(colour, 1.0)[0]] for name, colour in shown.items()]
        size = 0.12, 1.3 * self.font * len(entries) / self.height
        box = self.plotter.add_legend(entries, bcolor=None, face="rectangle", size=size)
        box.SetPosition(0.87, 0.05)

    def write(self, path: FilePath) -> Path:
        """Write the picture."""
        from PIL import Image

        with writing(path):
            Image.fromarray(self.shot()).save(path, "PNG")
        return Path(path)

    def show(self) -> Any:
        """Show it in a notebook, turned by the mouse if packages for that are there, or a window."""
        if not self.plotter.off_screen:
            return self.plotter.show()
        from IPython.display import HTML, Image
        from PIL import Image as Picture

        try:
            text = self.plotter.export_html(None).read().replace('"', "&quot;")
        except ImportError:
            data = BytesIO()
            Picture.fromarray(self.shot()).save(data, "PNG")
            return Image(data.getvalue())
        size = "width: 100%; height: 540px"
        return HTML(f'<iframe srcdoc="{text}" style="{size}; border: 0"></iframe>')


# -- what can be asked for -------------------------------------------------------------------------


def _check(
    path: FilePath | None,
    suffixes: Sequence[str],
    colour: str,
    camera: Camera,
    radius: float | None,
    window: tuple[int, int],
) -> None:
    """Refuse arguments before anything is drawn."""
    if colour not in ("", "M", "N"):
        raise InputError("argument colour", f"got {colour!r}, expected 'M', 'N' or ''")
    if isinstance(camera, str) and camera not in _VIEWS:
        known = f"one of {', '.join(map(repr, _VIEWS))} or three points"
        raise InputError("argument camera", f"got {camera!r}, expected {known}")
    if not isinstance(camera, str) and np.shape(camera) != (3, 3):
        text = f"got {camera!r}, expected position, focal point and upward direction"
        raise InputError("argument camera", text)
    if radius is not None:
        positive("argument radius", "radius", radius)
    if len(window) != 2 or not all(16 <= each <= 4096 for each in window):
        raise InputError(
            "argument window", f"got {window!r}, expected two numbers of pixels from 16 to 4096"
        )
    if path is not None:
        check_folder(path)
        if Path(path).suffix.lower() not in suffixes:
            text = f"ends with {Path(path).suffix!r}, expected {' or '.join(suffixes)}"
            raise InputError(f"file {str(path)!r}", text)


def _off_screen(path: FilePath | None) -> bool:
    """False if a window is to be opened."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if path is not None or hasattr(shell, "kernel"):
        return True
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        text = "is missing, and there is no display to open a window on: give the name of a picture"
        raise InputError("argument path", text)
    return False


def _instants(history: History, frames: int | Sequence[int]) -> list[int]:
    """Numbers of the states in a picture."""
    if not len(history):
        raise InputError("history", "has no states")
    if isinstance(frames, int):
        if frames < 1:
            raise InputError("argument frames", f"got {frames}, expected at least 1")
        times = np.linspace(history.times[0], history.times[-1], frames)
        return sorted({int(np.argmin(abs(history.times - t))) for t in times})
    for i in frames:
        if not -len(history) <= i < len(history):
            raise InputError("argument frames", f"got state {i}, there are {len(history)}")
    return [int(i) % len(history) for i in frames]


def _title(colour: str) -> str:
    return {"": "", "N": "norm of N in N", "M": "norm of M in N m"}[colour]


def _staged(
    scene: Scene,
    stage: Stage,
    strengths: Sequence[float],
    camera: Camera,
    names: bool,
    directors: bool = False,
) -> None:
    """Put a scene on a stage: its last state in full, earlier ones paler."""
    layers, title = scene.layers(directors), _title(scene.colour)
    for row, strength in zip(scene.rows, strengths, strict=False):
        for layer in layers:
            if layer.fades:
                stage.add(layer, row, strength, scene.limits, title)
    for layer in layers:
        stage.add(layer, scene.rows[-1], 1.0, scene.limits, title)
    pale = [layer for layer in layers if layer.fades]
    points = [layer.points(row) for row in scene.rows[:-1] for layer in pale]
    points += [layer.points(scene.rows[-1]) for layer in layers]
    stage.fit(np.concatenate(points), camera, 0.85 if directors else 0.92)
    stage.axes(scene.gravity)
    if directors:
        stage.legend()
    if names:
        stage.write_names(scene.names(), scene.rows[-1])


def picture(
    history: History,
    path: FilePath | None,
    frames: int | Sequence[int],
    camera: Camera,
    colour: str,
    radius: float | None,
    names: bool,
    window: tuple[int, int],
    directors: bool = False,
) -> Any:
    """See :meth:`History.picture`; `directors`: those of sections are drawn, as before a run."""
    _check(path, (".png",), colour, camera, radius, window)
    instants = _instants(history, frames)
    off_screen = _off_screen(path)
    _pyvista()
    scene = Scene(history, instants, colour, radius)
    stage = Stage(window, off_screen)
    count = len(instants)
    strengths = [1.0 - 0.75 * (count - 1 - k) / count for k in range(count - 1)]
    _staged(scene, stage, strengths, camera, names, directors)
    return stage.show() if path is None else stage.write(path)


def picture_of_scene(
    scene: object, path: FilePath | None, names: bool, camera: Camera, window: tuple[int, int]
) -> Any:
    """See :meth:`Model.plot`: a scene before a run is a history of its reference.

    Loads that are zero at the start are drawn by their values, for a factor of one.
    """
    system = system_of(scene, "model")
    meta, static = describe(system)
    factors = {"loads": system.loading, "actuators": system.couplings}
    series: dict[str, Any] = {"t": [0.0], "step": [0], "load_factor": [0.0]}
    series |= {"q": system.q0[None], "p": 0.0 * system.q0[None]}
    for name, each in factors.items():
        values = np.asarray(each.values(0.0), dtype=float)
        series[f"amplitudes/{name}"] = np.where(values == 0.0, 1.0, values)[None]
    series["constraint_force"] = np.full((1, system.n), np.nan)
    history = History(meta | {"time": 0.0}, static, series, None, [system], path_formulas)
    return picture(history, path, 1, camera, "", None, names, window, directors=True)


def picture_of_mesh(
    mesh: MeshCurve, path: FilePath | None, camera: Camera, names: bool, window: tuple[int, int]
) -> Any:
    """See :meth:`MeshCurve.plot`."""
    _check(path, (".png",), "", camera, None, window)
    off_screen = _off_screen(path)
    _pyvista()
    size = float(np.linalg.norm(np.ptp(mesh.p, axis=1)))
    lines = np.moveaxis(mesh.mapping().F(np.linspace(0.0, 1.0, 9)[None]), 0, -1)
    parts = {"": mesh.unnamed_elements(), **mesh.beams}
    colours = list(PALETTE.values())
    stage, texts, points = Stage(window, off_screen), [], lines.reshape(-1, 3)

    def held(values: Any) -> Callable[[Row], Any]:
        return lambda row: values

    for k, (name, elements) in enumerate(parts.items()):
        if len(elements):
            own = lines[elements].reshape(-1, 3)
            mesh_ = _mesh([(len(own), [np.arange(len(own)).reshape(len(elements), -1)])], "lines")
            stage.add(Layer(name, colours[(k - 1) % len(colours)], mesh_, held(own)), {})
            middle = lines[elements[len(elements) // 2], 4]
            texts.append((name, held(middle)))
    for radius, at in (
        (0.004, mesh.p.T),
        (0.007, mesh.p[:, [n[0] for n in mesh.nodes.values()]].T),
    ):
        if len(at):
            placed = held((at, radius * size * np.eye(3)))
            stage.add(_copies("joint" if radius > 0.005 else "ground", "ball", len(at), placed), {})
    texts += [(name, held(mesh.p[:, own[0]])) for name, own in mesh.nodes.items()]
    stage.fit(points, camera)
    stage.axes()
    if names:
        stage.write_names([each for each in texts if each[0]], {})
    return stage.show() if path is None else stage.write(path)


# -- films -----------------------------------------------------------------------------------------


def animate(
    history: History,
    path: FilePath,
    colour: str,
    fps: float,
    speed: float,
    camera: Camera,
    radius: float | None,
    names: bool,
    window: tuple[int, int],
) -> Path:
    """See :meth:`History.animate`."""
    rate = positive("argument fps", "fps", fps)
    step = positive("argument speed", "speed", speed) / rate
    if not len(history):
        raise InputError("history", "has no states")
    times = history.times
    count = int((times[-1] - times[0]) / step * (1 + 1e-9)) + 1
    if count > _FRAMES:
        text = f"{count} frames, more than {_FRAMES}: take a larger speed, or fewer frames a second"
        raise InputError("argument speed", f"got {speed:g}, which makes {text}")
    asked = times[0] + step * np.arange(count)
    after = np.clip(np.searchsorted(times, asked), 1, max(len(times) - 1, 1))
    near = [
        k - 1 if len(times) == 1 or t - times[k - 1] <= times[k] - t else k
        for k, t in zip(after.tolist(), asked, strict=True)
    ]
    digits = int(np.clip(np.ceil(-np.log10(step)), 0, 6))
    if "load_factor" in history:
        texts = [f"load factor {factor:.3f}" for factor in history["load_factor"][near]]
    else:
        texts = [f"t = {t:.{digits}f} s" for t in asked]
    return film(history, path, near, texts, None, colour, fps, camera, radius, names, window)


def film(
    history: History,
    path: FilePath,
    instants: Sequence[int],
    texts: Sequence[str],
    behind: Floats | None,
    colour: str,
    fps: float,
    camera: Camera,
    radius: float | None,
    names: bool,
    window: tuple[int, int],
) -> Path:
    """Film of some states with a text each, over a pale configuration (n,) `behind` it."""
    even = window[0] + window[0] % 2, window[1] + window[1] % 2  # as the codec of films has it
    _check(path, (".gif", ".mp4"), colour, camera, radius, even)
    rate = positive("argument fps", "fps", fps)
    if Path(path).suffix.lower() == ".gif" and rate > _GIF:
        text = f"got {fps:g}: browsers show at most {_GIF} frames of a GIF in a second, write .mp4"
        raise InputError("argument fps", text)
    _pyvista()
    scene = Scene(history, instants, colour, radius)
    stage = Stage(even)
    layers, title = scene.layers(), _title(colour)
    for layer in layers:
        if behind is not None and layer.name in ("beam", "body", "mass point"):
            stage.add(layer._replace(values=None), {"q": behind}, 0.3)
        stage.add(layer, scene.rows[0], 1.0, scene.limits, title)
    stage.fit(np.concatenate([layer.points(row) for row in scene.rows for layer in layers]), camera)
    stage.axes(scene.gravity)
    if names:
        stage.write_names(scene.names(), scene.rows[0])
    corner = 0.03 * stage.width, 0.93 * stage.height
    size = 0.75 * stage.font
    clock = stage.plotter.add_text(texts[0], position=corner, font_size=size, color="black")

    def pictures(numbers: Sequence[int]) -> Iterator[Array]:
        for k in numbers:
            stage.move(history.row(instants[k]), title)
            clock.input = texts[k]
            yield stage.shot()

    every = range(len(instants))
    with writing(path):
        if Path(path).suffix.lower() == ".mp4":
            _write_mp4(path, pictures(every), rate)
        else:
            _write_gif(path, list(pictures(every[:: len(every) // 3 + 1])), pictures(every), rate)
    return Path(path)


def _write_mp4(path: FilePath, images: Iterable[Array], fps: float) -> None:
    """H.264 in the colours that browsers play."""
    try:
        import imageio.v2
        import imageio_ffmpeg  # noqa: F401
    except ImportError as error:
        text = "imageio and imageio-ffmpeg are needed for .mp4: pip install skfem-cosserat[film]"
        raise ImportError(f"{text}; .gif needs neither") from error
    options = {"codec": "libx264", "pixelformat": "yuv420p", "macro_block_size": 2, "quality": 7}
    parameters = ["-movflags", "+faststart"]
    with imageio.v2.get_writer(path, fps=fps, output_params=parameters, **options) as writer:
        for image in images:
            writer.append_data(image)


def _write_gif(path: FilePath, some: Sequence[Array], images: Iterable[Array], fps: float) -> None:
    """A loop in the colours of some of its pictures."""
    from PIL import Image

    palette = Image.fromarray(np.concatenate(some)).quantize(128, dither=Image.Dither.NONE)
    colours = np.reshape(palette.getpalette(), (-1, 3))
    colours[colours.sum(axis=1).argmax()] = 255  # the white of the background
    palette.putpalette(colours.astype(np.uint8).tobytes())
    first, *others = (
        Image.fromarray(image).quantize(palette=palette, dither=Image.Dither.NONE)
        for image in images
    )
    ends = np.round(100.0 * np.arange(len(others) + 2) / fps)
    durations = (10 * np.diff(ends)).astype(int).tolist()
    first.save(path, save_all=True, append_images=others, duration=durations, loop=0)
