"""Pictures and films of scenes, meshes, histories and modes (pyvista, optional).

What is drawn comes in pieces whose points follow the state. A picture shows them at some instants,
a film moves them, and a scene before a run is a history of one state, its reference.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from .analysis.describe import describe, path_formulas
from .errors import CosseratError, InputError, writing
from .export.geometry import BeamShape, beam_shapes, body_shapes, frames
from .figures import MISSING, PALETTE, check_folder
from .history import History
from .model import system_of
from .types import Array, FilePath, Floats, IndexArray, positive

if TYPE_CHECKING:
    from .mesh import MeshCurve

Row: TypeAlias = Mapping[str, Array]
#: points (k, 3), or numbers of faces, by the row of a state
Points: TypeAlias = Callable[[Row], Array]

#: colours of what is drawn, by the names that the legend has for them
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
_LINES = "spring, cable"
_VIEWS = "xy", "xz", "yz", "iso"
#: arrows of a load along a beam; frames of a film; frames per second of a GIF in browsers
_ARROWS, _FRAMES, _GIF = 12, 5000, 50


class Look(NamedTuple):
    """How something is looked at: arguments of pictures and films."""

    camera: str | Sequence[Sequence[float]] = "iso"
    colour: str = ""
    radius: float | None = None
    names: bool = False
    window: tuple[int, int] = (1600, 900)

    def check(self, path: FilePath | None, *endings: str) -> None:
        """Refuse what cannot be drawn, or not be written, before anything is drawn."""
        named = isinstance(self.camera, str)
        known = self.camera in _VIEWS if named else np.shape(self.camera) == (3, 3)
        for name, right, expected in (
            ("colour", self.colour in ("", "M", "N"), "'M', 'N' or ''"),
            ("camera", known, f"one of {_VIEWS}, or position, focal point, up direction"),
            ("radius", self.radius is None or self.radius > 0, "a positive number"),
            ("window", 16 <= min(self.window) <= max(self.window) <= 4096, "16 to 4096 pixels"),
        ):
            if not right:
                text = f"got {getattr(self, name)!r}, expected {expected}"
                raise InputError(f"argument {name}", text)
        if path is not None:
            check_folder(path)
            if Path(path).suffix.lower() not in endings:
                raise InputError(f"file {str(path)!r}", f"expected it to end with {endings}")


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


def _opens(**more: str) -> bool:
    """True if another process can draw: VTK without OpenGL ends its process."""
    command = [sys.executable, "-c", _PROBE]
    try:
        return not subprocess.run(
            command, env=os.environ | more, capture_output=True, timeout=60, check=False
        ).returncode
    except subprocess.TimeoutExpired:
        return False


@cache
def _driver() -> bool:
    """True if pictures can be drawn here; looked for once in a process."""
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        # said at once: VTK warns if it has to look for a display
        direct = {"VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow"}
        if _opens(**direct):
            os.environ |= direct
            return True
    return _opens()


def _pyvista() -> Any:
    """The package, if it is there and can draw."""
    try:
        import pyvista
    except ImportError as error:
        raise ImportError(f"pyvista {MISSING}") from error
    if not _driver():
        text = "pictures need OpenGL, and no driver for it works here: without a graphics card"
        raise CosseratError(f"{text} install Mesa (libegl1 libgl1 libgl1-mesa-dri)")
    return pyvista


# -- pieces of a scene -----------------------------------------------------------------------------


class Piece(NamedTuple):
    """Faces (or lines) that follow the state, by name of its colour.

    Attributes
    ----------
    kind : str
        One of `COLOURS`.
    cells : sequence of (m, k) or (k,) int array
        Points of faces, or of a line.
    points : callable
    name : str
        Of the item; "" for what has none.
    values : callable, optional
        Numbers of the faces instead of the colour.
    """

    kind: str
    cells: Sequence[IndexArray]
    points: Points
    name: str = ""
    values: Points | None = None

    def anchor(self, row: Row) -> Floats:
        """Point (3,) that its name stands beside."""
        points = self.points(row)
        long = self.kind == "beam" or np.ndim(self.cells[0]) == 1
        return np.asarray(points[len(points) // 2] if long else points.mean(axis=0))


def _frames(vectors: Floats, width: float | None = None) -> Floats:
    """Rows e1, e2 across vectors (..., 3), and the vectors; e1, e2 as long as they, or so."""
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    unit = np.where(size > 0, vectors / np.maximum(size, 1e-300), np.eye(3)[2])
    e1 = np.cross(unit, np.eye(3)[np.argmin(abs(unit), axis=-1)])
    e1 /= np.linalg.norm(e1, axis=-1, keepdims=True)
    across = size if width is None else width
    return np.stack([across * e1, across * np.cross(unit, e1), vectors], axis=-2)


#: profiles (r, z) of shapes of revolution
_SHAPES = {
    "arrow": [(0, 0), (0.025, 0), (0.025, 0.72), (0.09, 0.72), (0, 1)],
    "double": [
        (0, 0),
        (0.025, 0),
        (0.025, 0.45),
        (0.09, 0.45),
        (0.025, 0.72),
        (0.09, 0.72),
        (0, 1),
    ],
    "ball": [(np.sin(a), np.cos(a)) for a in np.linspace(np.pi, 0, 13)],
    "ground": [(0, 0), (1.7, 2.6), (0, 2.6)],
    **{
        name: [(0, -z), (r, -z), (r, z), (0, z)]
        for name, r, z in (
            ("box", 1.2, 0.85),
            ("pin", 0.8, 1.7),
            ("slide", 0.3, 4),
            ("disc", 2.6, 0.2),
        )
    },
}
#: shapes of joints; others, as own ones, are balls
_JOINTS = {
    "revolute": ["pin"],
    "universal": ["ball", "pin"],
    "cylindrical": ["pin", "slide"],
    "prismatic": ["box", "slide"],
    "point-on-line": ["ball", "slide"],
    "planar": ["disc"],
    "fixed": ["box"],
    "locked": ["box"],
    "distance": [],
}


@cache
def _shape(kind: str) -> tuple[Floats, IndexArray]:
    """Points and quads of a shape along the third axis."""
    r, z = np.array(_SHAPES[kind], dtype=float).T
    count = 4 if kind in ("box", "ground") else 20
    ring = np.outer(r, np.exp(2j * np.pi / count * (np.arange(count) + 0.5)))
    points = np.stack([ring.real, ring.imag, z[:, None] + 0 * ring.real], axis=-1)
    number = np.arange(ring.size).reshape(ring.shape)
    after = np.roll(number, -1, axis=1)
    quads = np.stack([number[:-1], after[:-1], after[1:], number[1:]], axis=-1)
    return points.reshape(-1, 3), quads.reshape(-1, 4)


def _copies(
    kind: str, shape: str, placed: Callable[[Row], Any], name: str = "", count: int = 1
) -> Piece:
    """Shapes at places; `placed` gives the places (k, 3), and the axes there (k, 3, 3)."""
    points, quads = _shape(shape)

    def moved(row: Row) -> Floats:
        x, axes = placed(row)
        return np.reshape(np.reshape(x, (-1, 1, 3)) + points @ axes, (-1, 3))

    return Piece(kind, [quads + k * len(points) for k in range(count)], moved, name)


class Scene:
    """What is drawn of some states of a history.

    Attributes
    ----------
    size : float
        Extent of all that is shown (m).
    unit : float
        Size of joints (m).
    gravity : (3,) array
        Acceleration (m/s^2).
    limits : (2,) float
        Range of the colours; up to 0 if nothing is coloured.
    """

    def __init__(self, history: History, rows: Sequence[Row], look: Look) -> None:
        self.history, self.rows, self.colour = history, rows, look.colour
        self.shapes = beam_shapes(history.meta, history.static)
        self.bodies = list(body_shapes(history.meta, history.static))
        shapes: list[Any] = [*self.shapes, *self.bodies]
        if not shapes:
            raise InputError("history", "has no beams, bodies or mass points to be drawn")
        points = np.concatenate([each.points(row["q"]) for row in rows for each in shapes])
        self.size = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
        self.middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        self.radius = look.radius
        self.unit = 0.018 * self.size
        pulls = [load.get("acceleration", (0, 0, 0)) for load in history.meta.get("loads", ())]
        self.gravity = np.sum([(0.0, 0.0, 0.0), *pulls], axis=0)
        tops = [self._forces(shape, row).max() for shape in self.shapes for row in rows]
        self.limits = 0.0, float(max(tops, default=0.0))

    def _forces(self, shape: BeamShape, row: Row) -> Floats:
        """Norm of the resultant on the pieces of a beam's elements; zero if it is not known."""
        key = f"beam/{shape.name}/resultant"
        if not self.colour or key not in row:
            return np.zeros(len(shape.connectivity) * shape.pieces)
        three = row[key][..., :3] if self.colour == "N" else row[key][..., 3:]
        mean = shape.average(three[..., None, :], shape.pieces)
        return np.nan_to_num(np.linalg.norm(mean[:, 0], axis=1))

    def _series(self, kind: str, what: str) -> Iterator[tuple[Any, Points]]:
        """Items that have a series, and that."""
        for entry in self.history.meta.get(f"{kind}s", ()):
            key = f"{kind}/{entry['name']}/{what}"
            if key in self.history:
                yield entry, partial(lambda key, row: row[key], key)

    def pieces(self) -> Iterator[Piece]:
        """Pieces of all items."""
        yield from map(self._beam, self.shapes)
        for body in self.bodies:
            at = partial(lambda body, row: body.points(row["q"]), body)
            if body.material is None:
                ball = partial(lambda at, row: (at(row), 0.014 * self.size * np.eye(3)), at)
                yield _copies("mass point", "ball", ball, body.name)
            else:
                yield Piece("body", [body.faces], at, body.name)
        for kind in ("coupling", "joint"):
            for entry, ends in self._series(kind, "ends"):
                yield self._line(entry, ends)
                yield from self._ground(entry, ends)
        for entry, place in self._series("joint", "position"):
            forms = _JOINTS.get(entry["type"], ["ball"])
            joint = partial(self._joint, entry["name"], place)
            yield from (_copies("joint", form, joint, entry["name"]) for form in forms)
            yield from self._ground(entry, place) if forms else ()
        for what, form in (("force", "arrow"), ("moment", "double")):
            for entry, vectors in self._series("load", what):
                yield from self._load(entry["name"], what, form, vectors)

    def _beam(self, shape: BeamShape) -> Piece:
        turn = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False))
        tube = (self.radius or 0.006 * self.size) * np.column_stack([turn.real, turn.imag])
        skins = {int(k): [] if self.radius else shape.skin(k) for k in np.unique(shape.section)}
        sweep = shape.surface({k: loops or tube for k, loops in skins.items()})
        own = sweep.element * shape.pieces + sweep.piece
        points = sweep.points(self.rows[0]["q"])
        caps = [ring[_triangles(points[ring])] for ring in sweep.caps]
        ends = [
            np.repeat(own[(sweep.quads == cap[0, 0]).any(axis=1)][:1], len(cap)) for cap in caps
        ]
        cells = np.concatenate([own, *ends])
        return Piece(
            "beam",
            [sweep.quads, *caps],
            lambda row: sweep.points(row["q"]),
            shape.name,
            (lambda row: self._forces(shape, row)[cells]) if self.limits[1] else None,
        )

    def _line(self, entry: Any, ends: Points) -> Piece:
        """A spring as a coil, cables and rods straight; a ring where both ends are one point."""
        s = np.linspace(0.0, 1.0, 121)
        out = self.unit * (entry["type"] == "spring") * ((s > 0.15) & (s < 0.85))
        if np.linalg.norm(np.ptp(ends(self.rows[0]), axis=0)) < 0.01 * self.size:
            out = 2 * self.unit + 0 * s
        turn = out * np.exp(20j * np.pi * s)
        form = np.column_stack([turn.real, turn.imag, s])

        def points(row: Row) -> Floats:
            a, b = ends(row)
            return np.asarray(a + form @ _frames(b - a, 1.0))

        return Piece(_LINES, [np.arange(len(s))], points, entry["name"])

    def _joint(self, name: str, place: Points, row: Row) -> Any:
        static = self.history.static
        axes = self.unit * static.get(f"joint/{name}/axes", np.eye(3))
        if f"joint/{name}/frame" in static:
            axes = axes @ frames(row["q"], [static[f"joint/{name}/frame"]])[1][0]
        return place(row), axes

    def _ground(self, entry: Any, places: Points) -> Iterator[Piece]:
        """Pyramids under the sides that belong to the ground."""
        down = self.gravity if self.gravity.any() else np.array([0.0, 0.0, -1.0])
        axes = self.unit * _frames(_unit(down))
        for k in (0, 1):
            if entry["ab"[k]].startswith("ground"):
                at = partial(lambda k, row: (places(row).reshape(-1, 3)[-k], axes), k)
                yield _copies("ground", "ground", at)

    def _load(self, name: str, what: str, form: str, vectors: Points) -> Iterator[Piece]:
        """Arrows, the longest for what is largest; they end at their places, or begin there."""
        place, given = f"load/{name}/position", vectors
        vectors = lambda row: np.nan_to_num(given(row))  # noqa: E731
        top = max(self.rows, key=lambda row: float(abs(vectors(row)).max(initial=0.0)))
        if not vectors(top).any():
            return
        scale = 0.15 * self.size / np.linalg.norm(vectors(top), axis=-1).max()
        stride = -(-len(vectors(top)) // _ARROWS)
        some = slice((len(vectors(top)) - 1) % stride // 2, None, stride)
        # towards the middle it would be hidden by the scene
        inward = scale * np.sum(vectors(top) * (top[place] - self.middle)) < -0.01 * self.size**2
        back = scale * (inward and what == "force")

        def placed(row: Row) -> Any:
            ways = vectors(row)[some]
            return row[place][some] - back * ways, _frames(scale * ways)

        yield _copies(what, form, placed, name, len(vectors(top)[some]))

    def directors(self) -> Iterator[Piece]:
        """Arrows of section directors at some places of each beam."""
        for shape in self.shapes:
            stride = max(len(shape.connectivity) // 3, 1)
            x, d = (each[::stride].mean(axis=1) for each in shape.axes(self.rows[0]["q"]))
            for k in (0, 1):
                at = x, _frames(0.05 * self.size * d[:, k])
                yield _copies(f"d{k + 1}", "arrow", _held(at), "", len(x))


def _triangles(points: Floats) -> IndexArray:
    """Triangles (m, 3) of a polygon; OpenGL would fill the corners that point inwards."""
    import pyvista

    polygon = pyvista.PolyData(points, faces=[len(points), *range(len(points))])
    return np.asarray(polygon.triangulate().regular_faces)


def _held(values: Any) -> Callable[[Row], Any]:
    return lambda row: values


# -- the stage: a window with pieces, a camera, names ----------------------------------------------


def _faded(colour: Any, strength: float) -> Floats:
    """Mix colours with white; opaque, as transparency needs sorted faces."""
    from matplotlib.colors import to_rgba_array

    return 1.0 - strength * (1.0 - to_rgba_array(colour)[..., :3])


class Stage:
    """A white window on pieces.

    Parameters
    ----------
    look : Look
    off_screen : bool
    limits : (2,) float
        Range of the colours.
    """

    def __init__(self, look: Look, off_screen: bool, limits: tuple[float, float]) -> None:
        # drawn at twice the size: smooth edges in less time than OpenGL in software takes for them
        self.finer = 2 if off_screen else 1
        self.look, self.limits = look, limits
        self.size = self.finer * np.array(look.window)
        self.plotter = _pyvista().Plotter(off_screen=off_screen, window_size=self.size.tolist())
        self.plotter.set_background("white")
        if off_screen:
            self.plotter.disable_anti_aliasing()
        self.font = int(max(11 * self.finer, self.size[0] // 70))
        self.title = f"norm of {look.colour} in {'N m' if look.colour == 'M' else 'N'}"
        self.shown: list[tuple[Any, list[Piece]]] = []
        self.labels: list[tuple[Any, Piece, Floats]] = []

    def add(self, pieces: Sequence[Piece], row: Row, strength: float = 1.0) -> None:
        """Show pieces at a state; pale ones stay there, and give way to others at the place."""
        import pyvista
        from matplotlib import colormaps
        from matplotlib.colors import ListedColormap

        sorted_ = {kind: [p for p in pieces if p.kind == kind] for kind in COLOURS}
        table = ListedColormap(_faded(colormaps["viridis"](np.linspace(0, 1, 256)), strength))
        bar = {"title": self.title, "fmt": "%.3g", "color": "black", "n_labels": 2, "width": 0.3}
        bar |= {"height": 0.07, "position_x": 0.35, "position_y": 0.02}
        bar |= dict.fromkeys(("title_font_size", "label_font_size"), self.font)
        for kind, own in sorted_.items():
            if not own:
                continue
            parts = [piece.points(row) for piece in own]
            starts = np.cumsum([0, *map(len, parts)])
            cells = [
                np.insert(np.atleast_2d(each) + start, 0, np.shape(each)[-1], axis=1).ravel()
                for piece, start in zip(own, starts, strict=False)
                for each in piece.cells
            ]
            form = {"lines" if np.ndim(own[0].cells[0]) == 1 else "faces": np.concatenate(cells)}
            mesh = pyvista.PolyData(np.nan_to_num(np.concatenate(parts)), **form)
            style: dict[str, Any] = {"color": _faded(COLOURS[kind], strength)[0]}
            if self._colour(mesh, own, row):
                style = {"cmap": table, "clim": self.limits, "scalar_bar_args": bar}
                style["show_scalar_bar"] = strength == 1.0
            style |= {
                "ambient": 0.25,
                "line_width": self.size[0] / 450,
                "reset_camera": False,
                "render": False,
            }
            actor = self.plotter.add_mesh(mesh, **style)
            if strength == 1.0:
                self.shown.append((mesh, own))
            # towards the back: pale ones; to the front: what would be inside of thick beams
            fronts = {"joint": -1e6, **dict.fromkeys(("force", "moment", "d1", "d2"), -5e6)}
            front = fronts.get(kind, 8.0 * (1.0 - strength))
            mapper = actor.mapper
            mapper.SetResolveCoincidentTopologyToPolygonOffset()
            mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(front > 0, front)

    def move(self, row: Row) -> None:
        """Show the pieces and names at another state."""
        for mesh, own in self.shown:
            points = np.concatenate([piece.points(row) for piece in own])
            # what is not there at this state, as a joint that was released, has no size
            mesh.points = np.where(np.isfinite(points), points, self.focus)
            self._colour(mesh, own, row)
        for label, piece, shift in self.labels:
            at = piece.anchor(row) + shift
            label.SetVisibility(bool(np.isfinite(at).all()))
            label.position = tuple(np.nan_to_num(at))

    def _colour(self, mesh: Any, own: Sequence[Piece], row: Row) -> bool:
        """Give the faces numbers, if they have some."""
        found = [piece.values(row) for piece in own if piece.values is not None]
        if found:
            mesh.cell_data[self.title] = np.concatenate(found)
        return bool(found)

    def aim(self, points: Sequence[Floats], gravity: Floats) -> None:
        """Look at points (k, 3) of pieces, along parallel lines; axes and gravity are in a corner.

        The points are above the scale and the axes, if the camera has a name.
        """
        self.plotter.camera_position = self.look.camera
        camera = self.plotter.camera
        out = -np.array(camera.direction)
        right = _unit(np.cross(camera.up, out))
        self.plane = np.array([right, np.cross(out, right), out])
        self.focus, scale = np.array(camera.focal_point), 0.27 * camera.distance
        if isinstance(self.look.camera, str):
            ends = np.concatenate(points) @ self.plane.T
            ends = ends[np.isfinite(ends[:, 0])]
            extent = np.ptp(ends, axis=0)
            scale = 0.5 * max(*extent[:2] / (0.8 * self.size[0] / self.size[1], 0.68), 1e-9)
            middle = 0.5 * (ends.min(axis=0) + ends.max(axis=0))
            self.focus = (middle - (0, 0.16 * scale, 0)) @ self.plane
            camera.focal_point = self.focus
            camera.position = self.focus + 2 * (extent.sum() + scale) * out
        camera.enable_parallel_projection()
        camera.parallel_scale, self.pixel = scale, 2 * scale / self.size[1]
        self.plotter.add_axes(color="black", viewport=(0, 0, 0.16, 0.28))
        if gravity.any():
            aside = scale * np.array([-0.56 * self.size[0] / self.size[1], -0.75, 0.0])
            at = self.focus + aside @ self.plane, 0.2 * scale * _frames(_unit(gravity))
            self.add([_copies("ground", "arrow", _held(at), "gravity")], {})

    def name(self, row: Row) -> None:
        """Names beside things; several at one place are one text."""
        import pyvista

        groups: dict[Any, tuple[Floats, list[Piece]]] = {}
        for piece in (piece for _, own in self.shown for piece in own if piece.name):
            at = self.plane[:2] @ (piece.anchor(row) - self.focus) / self.pixel + 0.5 * self.size
            at = np.nan_to_num(at)
            groups.setdefault(tuple(at // self.font), (at, []))[1].append(piece)
        shot = self.shot() if self.plotter.off_screen else np.full((*self.size[::-1], 3), 255)
        drawn = (shot[::-1].min(axis=2) < 250).astype(float)
        ways = np.exp(0.25j * np.pi * np.arange(32)) * np.repeat([1.0, 2.0, 3.2, 5.0], 8)
        sides = np.column_stack([ways.real, ways.imag])
        for at, pieces in groups.values():
            text = ", ".join(dict.fromkeys(piece.name for piece in pieces))
            box = self.font * np.array([0.56 * len(text), 1.25])
            corners = at + self.font * sides + 0.5 * box * (np.sign(sides.round(3)) - 1)
            corners = np.clip(corners, 10, self.size - 10 - box)
            ends = [(each // self.finer).astype(int) for each in (corners, corners + box)]
            places = [(slice(y, v), slice(x, u)) for (x, y), (u, v) in zip(*ends, strict=True)]
            best = int(np.argmin([drawn[place].sum() for place in places]))
            drawn[places[best]] = 10
            label = pyvista.Label(text.replace("$", r"\$"), size=self.font)
            label.prop.color = "black"
            self.plotter.add_actor(label, reset_camera=False, render=False)
            shift = self.pixel * (corners[best] - at) @ self.plane[:2]
            self.labels.append((label, pieces[0], shift))

    def legend(self) -> None:
        """What the colours mean, at the lower right."""
        kinds = dict.fromkeys(own[0].kind for _, own in self.shown)
        entries = [[kind, _faded(COLOURS[kind], 1.0)[0]] for kind in kinds]
        size = 0.12, 1.3 * self.font * len(entries) / self.size[1]
        box = self.plotter.add_legend(entries, bcolor=None, face="rectangle", size=size)
        box.SetPosition(0.87, 0.05)

    def shot(self) -> Array:
        """The picture (height, width, 3)."""
        from PIL import Image

        self.plotter.renderer.ResetCameraClippingRange()
        self.plotter.render()
        image = self.plotter.screenshot(return_img=True)
        return np.asarray(Image.fromarray(image[..., :3]).reduce(self.finer))

    def show(self, path: FilePath | None) -> Any:
        """Write it, or show it in a notebook or a window."""
        if not self.plotter.off_screen:
            return self.plotter.show()
        from PIL import Image

        data = BytesIO()
        Image.fromarray(self.shot()).save(data, "PNG")
        self.plotter.close()
        if path is None:
            import IPython.display

            return IPython.display.Image(data.getvalue())
        with writing(path):
            Path(path).write_bytes(data.getvalue())
        return Path(path)


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))


# -- pictures --------------------------------------------------------------------------------------


def _off_screen(path: FilePath | None) -> bool:
    """False if a window is to be opened."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if path is not None or hasattr(shell, "kernel"):
        return True
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        text = "is missing, and there is no display to open a window on: give the name of a picture"
        raise InputError("argument path", text)
    return False


def _instants(history: History, frames: int | Sequence[int]) -> Sequence[int]:
    """Numbers of the states in a picture."""
    if not len(history):
        raise InputError("history", "has no states")
    if not isinstance(frames, int):
        return frames
    if frames < 1:
        raise InputError("argument frames", f"got {frames}, expected at least 1")
    times = np.linspace(history.times[0], history.times[-1], frames)
    return sorted({int(np.argmin(abs(history.times - t))) for t in times})


def _staged(
    history: History,
    rows: Sequence[Row],
    behind: Sequence[Row],
    look: Look,
    off_screen: bool = True,
    before: bool = False,
) -> Stage:
    """The last of some states, which all are in view, over paler ones."""
    scene = Scene(history, rows, look)
    stage = Stage(look, off_screen, scene.limits)
    pieces = [*scene.pieces(), *(scene.directors() if before else ())]
    for k, row in enumerate(behind):
        pale = [each for each in pieces if each.kind in ("beam", "body", "mass point", _LINES)]
        stage.add(pale, row, 0.4 + 0.5 * k / len(behind))
    stage.add(pieces, rows[-1])
    stage.aim([piece.points(row) for row in rows for piece in pieces], scene.gravity)
    if before:
        stage.legend()
    if look.names:
        stage.name(rows[-1])
    stage.move(rows[-1])
    return stage


def picture(
    history: History,
    path: FilePath | None,
    frames: int | Sequence[int],
    look: Look,
    before: bool = False,
) -> Any:
    """See :meth:`History.picture`; `before` a run directors and a legend are drawn, too."""
    look.check(path, ".png")
    rows = [history.row(i) for i in _instants(history, frames)]
    off_screen = _off_screen(path)
    _pyvista()
    return _staged(history, rows, rows[:-1], look, off_screen, before).show(path)


def picture_of_scene(scene: Any, path: FilePath | None, look: Look) -> Any:
    """See :meth:`Model.plot`: a history of one state, the reference; no load is zero."""
    system = system_of(scene, "model")
    meta, static = describe(system)
    series: dict[str, Any] = {"t": [0.0], "step": [0], "load_factor": [0.0]}
    series |= {"q": system.q0[None], "p": 0 * system.q0[None]}
    for name, channels in (("loads", system.loading), ("actuators", system.couplings)):
        factors = np.array(channels.values(0.0))
        series[f"amplitudes/{name}"] = np.where(factors == 0, 1.0, factors)[None]
    history = History(meta | {"time": 0.0}, static, series, None, [system], path_formulas)
    return picture(history, path, 1, look, before=True)


def picture_of_mesh(mesh: MeshCurve, path: FilePath | None, look: Look) -> Any:
    """See :meth:`MeshCurve.plot`."""
    look.check(path, ".png")
    stage = Stage(look, _off_screen(path), (0.0, 1.0))
    lines = np.moveaxis(mesh.mapping().F(np.linspace(0.0, 1.0, 9)[None]), 0, -1)
    parts = {"": mesh.unnamed_elements(), **mesh.beams}
    for kind, name in zip(("beam", "force", _LINES, "moment") * len(parts), parts, strict=False):
        own = lines[parts[name]].reshape(-1, 3)
        cells = list(np.arange(len(own)).reshape(-1, 9))
        stage.add([Piece(kind, cells, _held(own), name)] if len(own) else [], {})
    balls = [("ground", "", x, 0.004) for x in mesh.p.T]
    balls += [("joint", name, mesh.p[:, own[0]], 0.007) for name, own in mesh.nodes.items()]
    axes = np.linalg.norm(np.ptp(mesh.p, axis=1)) * np.eye(3)
    stage.add([_copies(k, "ball", _held((x, r * axes)), name) for k, name, x, r in balls], {})
    stage.aim([mesh.p.T, *lines], np.zeros(3))
    if look.names:
        stage.name({})
    stage.move({})
    return stage.show(path)


# -- films -----------------------------------------------------------------------------------------


def animate(history: History, path: FilePath, fps: float, speed: float, look: Look) -> Path:
    """See :meth:`History.animate`."""
    rate, pace = positive("argument fps", "fps", fps), positive("argument speed", "speed", speed)
    if not len(history):
        raise InputError("history", "has no states")
    times = history.times
    count = int((times[-1] - times[0]) * rate / pace * (1 + 1e-9)) + 1
    if count > _FRAMES:
        text = (
            f"makes {count} frames, expected at most {_FRAMES}: take a larger one, or a lower fps"
        )
        raise InputError("argument speed", f"got {speed:g}, which {text}")
    asked = times[0] + pace / rate * np.arange(count)
    near = [int(np.argmin(abs(times - t))) for t in asked]
    digits = int(np.clip(np.ceil(np.log10(rate / pace)), 0, 6))
    texts = [f"t = {t:.{digits}f} s" for t in asked]
    if "load_factor" in history:
        texts = [f"load factor {factor:.3f}" for factor in history["load_factor"][near]]
    return film(history, path, list(zip(near, texts, strict=True)), (), fps, look)


def film(
    history: History,
    path: FilePath,
    frames: Sequence[tuple[int, str]],
    behind: Sequence[Row],
    fps: float,
    look: Look,
) -> Path:
    """Film of states, by numbers and texts, over a pale one."""
    # the codec takes even sizes only
    look = look._replace(window=(look.window[0] // 2 * 2, look.window[1] // 2 * 2))
    look.check(path, ".gif", ".mp4")
    rate, loop = positive("argument fps", "fps", fps), Path(path).suffix.lower() == ".gif"
    if loop and rate > _GIF:
        text = f"got {fps:g}, expected at most {_GIF}: browsers show no more of a GIF, write .mp4"
        raise InputError("argument fps", text)
    _pyvista()
    some = np.linspace(0, len(frames) - 1, min(len(frames), 100)).astype(int)
    stage = _staged(history, [history.row(frames[k][0]) for k in some], behind, look)
    corner = tuple((0.03, 0.93) * stage.size)
    clock = stage.plotter.add_text(" ", position=corner, font_size=0.75 * stage.font, color="black")

    def pictures() -> Iterator[Array]:
        for number, clock.input in frames:
            stage.move(history.row(number))
            yield stage.shot()

    with writing(path):
        (_write_gif if loop else _write_mp4)(path, pictures(), rate)
    stage.plotter.close()
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
    options["output_params"] = ["-movflags", "+faststart"]
    with imageio.v2.get_writer(path, fps=fps, **options) as writer:
        for image in images:
            writer.append_data(image)


def _write_gif(path: FilePath, images: Iterable[Array], fps: float) -> None:
    """A loop."""
    from PIL import Image

    method = Image.Quantize.MAXCOVERAGE  # white stays white
    first, *others = (Image.fromarray(image).quantize(128, method) for image in images)
    ends = np.round(100.0 * np.arange(len(others) + 2) / fps)
    durations = (10 * np.diff(ends)).astype(int).tolist()
    first.save(path, save_all=True, append_images=others, duration=durations, loop=0)
