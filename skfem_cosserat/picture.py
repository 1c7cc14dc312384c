"""Pictures and films of scenes, meshes, histories and modes (pyvista, optional).

What is drawn comes in pieces whose points follow the state. A picture shows them at some instants,
a film moves them, and a scene before a run is a history of one state, its reference.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from .analysis.describe import describe, path_formulas
from .errors import CosseratError, InputError, writing
from .export.geometry import BeamShape, BodyShape, beam_shapes, body_shapes, frames
from .figures import MISSING, PALETTE, check_folder
from .history import History
from .model import system_of
from .types import Array, FilePath, Floats, positive, spread

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
        known = str(self.camera) in _VIEWS or np.shape(self.camera) == (3, 3)
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


def _headless() -> bool:
    return sys.platform == "linux" and not os.environ.get("DISPLAY")


@cache
def _driver() -> bool:
    """True if another process can draw: VTK without OpenGL ends its process."""
    # VTK warns if it has to look for a display
    direct = {"VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow"} if _headless() else {}
    for more in (direct, {}):
        environment = os.environ | more
        command = [sys.executable, "-c", _PROBE]
        try:
            subprocess.run(command, env=environment, capture_output=True, timeout=60, check=True)
        except subprocess.SubprocessError:
            continue
        os.environ |= more
        return True
    return False


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
    """Faces or lines that follow the state, by name of its colour.

    Attributes
    ----------
    kind : str
        One of `COLOURS`.
    form : pyvista.PolyData
        Faces, or lines.
    points : callable
        Where its points are.
    name : str
        Of the item; "" for what has none.
    values : callable, optional
        Numbers of the faces instead of the colour.
    """

    kind: str
    form: Any
    points: Points
    name: str = ""
    values: Points | None = None

    def anchor(self, row: Row) -> Floats:
        """Point (3,) that its name stands beside."""
        points = self.points(row)
        long = self.kind == "beam" or self.form.n_lines
        return np.asarray(points[len(points) // 2] if long else points.mean(0))


def _axes(vectors: Floats) -> Floats:
    """Three orthonormal axes, the last along vectors (..., 3): e3 is mirrored."""
    unit = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)
    normal = unit - np.eye(3)[2]
    outer = normal[..., None] * normal[..., None, :]
    return np.eye(3) - outer / np.maximum(1.0 - unit[..., 2:, None], 1e-12)


#: shapes of joints and couplings; others are balls, or lines if they have two ends
_LINKS = {
    "revolute": "pin",
    "universal": "ball pin",
    "cylindrical": "pin slide",
    "prismatic": "box slide",
    "point-on-line": "ball slide",
    "planar": "disc",
    "fixed": "box",
    "locked": "box",
    "joint spring": "ring",
    "joint actuator": "ring",
    "bushing": "ring",
    "foundation": "",
}


@cache
def _shapes() -> dict[str, Any]:
    """Shapes along the third axis; those of joints for a unit of one."""
    import pyvista

    up = {"direction": (0, 0, 1)}
    arrow = pyvista.Arrow(**up, tip_length=0.28, tip_radius=0.09, shaft_radius=0.025)
    head = pyvista.Cone(**up, center=(0, 0, 0.585), height=0.27, radius=0.09, resolution=20)
    down = {"center": (0, 0, 1.3), "direction": (0, 0, -1), "height": 2.6, "radius": 1.7}
    return {
        "arrow": arrow,
        "force": arrow,
        "moment": arrow.append_polydata(head),
        "ball": pyvista.Sphere(radius=1.0),
        "ground": pyvista.Cone(**down, resolution=4).rotate_z(45.0),
        "ring": pyvista.ParametricTorus(ringradius=2.0, crosssectionradius=0.1, u_res=40, v_res=9),
        "box": pyvista.Cube(x_length=1.7, y_length=1.7, z_length=1.7),
        "pin": pyvista.Cylinder(**up, radius=0.8, height=3.4, resolution=20),
        "slide": pyvista.Cylinder(**up, radius=0.3, height=8.0, resolution=20),
        "disc": pyvista.Cylinder(**up, radius=2.6, height=0.4),
    }


def _copies(
    kind: str, shape: str, placed: Callable[[Row], Any], name: str = "", count: int = 1
) -> Piece:
    """Shapes at places; `placed` gives the places (k, 3), and the axes there (k, 3, 3)."""
    form = _shapes()[shape]
    corners = np.array(form.points)

    def moved(row: Row) -> Floats:
        x, axes = placed(row)
        return np.reshape(np.reshape(x, (-1, 1, 3)) + corners @ axes, (-1, 3))

    return Piece(kind, form.append_polydata(*[form] * (count - 1)), moved, name)


class Scene:
    """What is drawn of some states of a history.

    Attributes
    ----------
    size : float
        Extent of all that is shown (m).
    unit : float
        Size of joints (m), smaller if they are many.
    gravity : (3,) array
        Acceleration (m/s^2).
    limits : (2,) float
        Range of the colours; up to 0 if nothing is coloured.
    """

    def __init__(self, history: History, rows: Sequence[Row], look: Look):
        self.history, self.rows, self.look = history, rows, look
        self.shapes = beam_shapes(history.meta, history.static)
        self.bodies = list(body_shapes(history.meta, history.static))
        shapes: list[Any] = [*self.shapes, *self.bodies]
        if not shapes:
            raise InputError("history", "has no beams, bodies or mass points to be drawn")
        points = np.concatenate([each.points(row["q"]) for row in rows for each in shapes])
        self.size = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
        self.middle = 0.5 * (points.min(0) + points.max(0))
        self.unit = 0.018 * self.size * (12 / max(len(history.meta.get("joints", ())), 12)) ** 0.5
        loads = history.meta.get("loads", ())
        self.gravity = np.sum([load.get("acceleration", (0, 0, 0)) for load in loads], 0)
        tops = (self._forces(shape, row).max() for shape in self.shapes for row in rows)
        self.limits = 0.0, float(max(tops, default=0.0))

    def _forces(self, shape: BeamShape, row: Row) -> Floats:
        """Norm of the resultant on the pieces of a beam's elements; zero if it is not known."""
        key = f"beam/{shape.name}/resultant"
        if not self.look.colour or key not in row:
            return np.zeros(len(shape.connectivity) * shape.pieces)
        three = row[key][..., :3] if self.look.colour == "N" else row[key][..., 3:]
        mean = shape.average(three[..., None, :], shape.pieces)
        return np.nan_to_num(np.linalg.norm(mean[:, 0], axis=1))

    def pieces(self) -> Iterator[Piece]:
        """Pieces of all items."""
        yield from map(self._beam, self.shapes)
        yield from map(self._body, self.bodies)
        for kind, drawn in (("coupling", self._link), ("joint", self._link), ("load", self._load)):
            for entry in self.history.meta.get(f"{kind}s", ()):
                yield from drawn(entry, f"{kind}/{entry['name']}")

    def _beam(self, shape: BeamShape) -> Piece:
        import pyvista

        turn = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False))
        radius = self.look.radius
        tube = (radius or 0.006 * self.size) * np.column_stack([turn.real, turn.imag])
        sections = map(int, np.unique(shape.section))
        sweep = shape.surface({k: (not radius and shape.skin(k)) or tube for k in sections})
        own = sweep.element * shape.pieces + sweep.piece
        ends = [own[(sweep.quads == cap[0]).any(1)][:1] for cap in sweep.caps]
        points = sweep.points(self.rows[0]["q"])
        form = pyvista.PolyData.from_irregular_faces(points, [*sweep.quads, *sweep.caps])
        form["piece"] = np.concatenate([own, *ends])
        form = form.triangulate()  # OpenGL would fill the corners of caps that point inwards
        values = lambda row: self._forces(shape, row)[form["piece"]]  # noqa: E731
        at = lambda row: sweep.points(row["q"])  # noqa: E731
        return Piece("beam", form, at, shape.name, values if self.limits[1] else None)

    def _body(self, body: BodyShape) -> Piece:
        import pyvista

        at = lambda row: body.points(row["q"])  # noqa: E731
        if body.material is None:
            axes = 0.014 * self.size * np.eye(3)
            return _copies("mass point", "ball", lambda row: (at(row), axes), body.name)
        form = pyvista.PolyData.from_regular_faces(body.material, body.faces)
        return Piece("body", form, at, body.name)

    def _link(self, entry: Any, key: str) -> Iterator[Piece]:
        """What is between two places, and pyramids under those that belong to the ground."""
        static = self.history.static
        ends = f"{key}/ends"
        if "surface" in entry:
            yield from self._surface(entry)
            return
        place, usual = (ends, "line") if ends in self.history else (f"{key}/position", "ball")
        if place not in self.history:
            return
        name = entry["name"]
        unit = self.unit
        bed = entry["type"] == "foundation"
        if bed:  # it has many nodes
            name = name.rpartition("/")[0]
            unit = 0.7 * unit
        kind = "joint" if key.startswith("joint") else _LINES
        # a spring on a joint is about the joint's axis
        sides = entry["a"], entry["b"]
        same = [each for each in self.history.meta["joints"] if (each["a"], each["b"]) == sides]
        owner = f"joint/{same[0]['name']}" if same and kind == _LINES else key

        def placed(row: Row) -> Any:
            axes = unit * static.get(f"{owner}/axes", np.eye(3))
            if f"{owner}/frame" in static:
                axes = axes @ frames(row["q"], [static[f"{owner}/frame"]])[1][0]
            return np.atleast_2d(row[place])[0], axes

        for form in _LINKS.get(entry["type"], usual).split():
            yield _copies(kind, form, placed, name) if form != "line" else self._line(entry, ends)
        axes = unit * _axes(self.gravity if self.gravity.any() else -np.eye(3)[2])
        for k, side in enumerate(sides):
            if side.startswith("ground"):
                at = lambda row, k=k: (np.atleast_2d(row[place])[-k], axes)  # noqa: E731
                yield _copies("ground", "ground", at, name if bed else "")

    def _surface(self, entry: Any) -> Iterator[Piece]:
        """The surface of an obstacle, once, unless the scene is inside."""
        import pyvista

        name, _, number = entry["name"].rpartition("/")
        shape = entry["surface"]
        if number != "0" or shape["inside"]:
            return
        axis, radius = np.array(shape["axis"]), shape["radius"]
        way = ((self.middle - shape["point"]) @ axis) * axis
        size = self.size
        if shape["kind"] == "Plane":
            form = pyvista.Plane(center=self.middle - way, direction=axis, i_size=size, j_size=size)
        elif shape["kind"] == "Sphere":
            form = pyvista.Sphere(radius=radius, center=shape["point"])
        else:
            form = pyvista.Cylinder(
                center=shape["point"] + way, direction=axis, radius=radius, height=size
            )
        form = form.triangulate()
        yield Piece("ground", form, _held(form.points), name)

    def _line(self, entry: Any, ends: str) -> Piece:
        """A spring as a coil, cables and rods straight."""
        import pyvista

        s = np.linspace(0.0, 1.0, 121)[:, None]
        out = self.unit * (entry["type"] == "spring") * ((s > 0.15) & (s < 0.85))
        turn = out * np.exp(20j * np.pi * s)
        coil = np.hstack([turn.real, turn.imag, 0 * s])

        def points(row: Row) -> Floats:
            a, b = row[ends]
            return a + s * (b - a) + coil @ _axes(b - a)

        return Piece(_LINES, pyvista.MultipleLines(coil), points, entry["name"])

    def _load(self, entry: Any, key: str) -> Iterator[Piece]:
        """Arrows, the longest for what is largest."""
        for kind in ("force", "moment"):
            series = f"{key}/{kind}"
            vectors = np.nan_to_num([row[series] for row in self.rows if series in row])
            if vectors.any():
                yield self._arrows(kind, f"{key}/position", series, vectors, entry["name"])

    def _arrows(self, kind: str, place: str, series: str, vectors: Floats, name: str) -> Piece:
        """They end at their places, or begin there: inwards they would be hidden by the scene."""
        some = spread(vectors.shape[1], _ARROWS)
        scale = 0.15 * self.size / np.linalg.norm(vectors, axis=-1).max()
        arms = [row[place] - self.middle for row in self.rows]
        inward = kind == "force" and scale * np.nansum(vectors * arms) < -0.01 * self.size**2

        def placed(row: Row) -> Any:
            ways = scale * np.nan_to_num(row[series])[some]
            length = np.linalg.norm(ways, axis=-1)[:, None, None]
            return row[place][some] - inward * ways, length * _axes(ways)

        return _copies(kind, kind, placed, name, len(some))

    def directors(self) -> Iterator[Piece]:
        """Arrows of section directors at some places of each beam."""
        for shape in self.shapes:
            stride = max(len(shape.connectivity) // 3, 1)
            x, d = (each[::stride].mean(1) for each in shape.axes(self.rows[0]["q"]))
            for k in (0, 1):
                at = _held((x, 0.05 * self.size * _axes(d[:, k])))
                yield _copies(f"d{k + 1}", "arrow", at, "", len(x))


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
    path : path-like or None
        Where it will be written.
    limits : (2,) float
        Range of the colours.
    """

    def __init__(self, look: Look, path: FilePath | None, limits: tuple[float, float]):
        off_screen = _off_screen(path)
        # drawn at twice the size: smooth edges in less time than OpenGL in software takes for them
        self.finer = 2 if off_screen else 1
        self.look = look
        self.limits = limits
        size = [self.finer * each for each in look.window]
        self.plotter = _pyvista().Plotter(off_screen=off_screen, window_size=size)
        self.plotter.set_background("white")
        # room for what comes to the front: in front of the near plane all would be at one depth
        self.plotter.renderer.SetClippingRangeExpansion(0.5)
        if off_screen:
            self.plotter.disable_anti_aliasing()
        self.font = max(11 * self.finer, size[0] // 70)
        self.wide = size[0] / size[1]
        self.title = f"norm of {look.colour} in {'N m' if look.colour == 'M' else 'N'}"
        self.focus = np.zeros(3)
        self.shown: list[tuple[Any, list[Piece]]] = []
        self.labels: list[tuple[Any, Piece, Floats]] = []

    def add(self, pieces: Sequence[Piece], row: Row, strength: float = 1.0) -> None:
        """Show pieces at a state; pale ones stay there, and give way to others at the place."""
        from matplotlib import colormaps
        from matplotlib.colors import ListedColormap

        table = ListedColormap(_faded(colormaps["viridis"](np.linspace(0, 1, 256)), strength))
        bar = {"title": self.title, "fmt": "%.3g", "color": "black", "n_labels": 2, "width": 0.3}
        bar |= dict.fromkeys(("title_font_size", "label_font_size"), self.font)
        for kind, colour in COLOURS.items():
            own = [piece for piece in pieces if piece.kind == kind]
            if not own:
                continue
            mesh = own[0].form.append_polydata(*(piece.form for piece in own[1:])).copy()
            mesh.clear_data()  # normals would stay as they are
            self._place(mesh, own, row)
            style = {"ambient": 0.25, "line_width": self.font / 6, "label": kind}
            style |= {"color": _faded(colour, strength)[0], "reset_camera": False, "render": False}
            if self.title in mesh.cell_data:
                style |= {"scalars": self.title, "cmap": table, "clim": self.limits}
                style |= {"scalar_bar_args": bar, "show_scalar_bar": strength == 1.0}
            mapper = self.plotter.add_mesh(mesh, **style).mapper
            if strength == 1.0:
                self.shown.append((mesh, own))
            # towards the back: pale ones; to the front: what would be inside of thick beams
            fronts = {"joint": -4e3, **dict.fromkeys(("force", "moment", "d1", "d2"), -12e3)}
            front = fronts.get(kind, 8.0 * (1.0 - strength))
            mapper.SetResolveCoincidentTopologyToPolygonOffset()
            mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(front > 0, front)

    def _place(self, mesh: Any, own: Sequence[Piece], row: Row) -> None:
        """Where the points of pieces are, and the numbers of their faces."""
        points = np.concatenate([piece.points(row) for piece in own])
        # what is not there at this state, as a joint that was released, has no size
        mesh.points = np.where(np.isfinite(points), points, self.focus)
        found = [piece.values(row) for piece in own if piece.values is not None]
        if found:
            mesh.cell_data[self.title] = np.concatenate(found)

    def move(self, row: Row) -> None:
        """Show the pieces and names at another state."""
        for mesh, own in self.shown:
            self._place(mesh, own, row)
        for label, piece, shift in self.labels:
            at = piece.anchor(row) + shift
            label.SetVisibility(bool(np.isfinite(at).all()))
            label.position = tuple(np.nan_to_num(at))

    def aim(self, row: Row, points: Sequence[Floats], gravity: Floats) -> None:
        """Look at points (k, 3) of pieces, along parallel lines; axes and gravity are in a corner.

        The points are above the scale and the axes, if the camera has a name.
        """
        import pyvista

        self.plotter.camera_position = self.look.camera
        camera = self.plotter.camera
        camera.enable_parallel_projection()
        self.plane = pyvista.array_from_vtkmatrix(camera.GetViewTransformMatrix())[:3, :3]
        self.focus = np.array(camera.focal_point)
        scale = 0.27 * camera.distance
        if isinstance(self.look.camera, str):
            ends = np.concatenate(points) @ self.plane.T
            low = np.nanmin(ends, axis=0)
            high = np.nanmax(ends, axis=0)
            scale = 0.5 * max(*(high - low)[:2] / (0.8 * self.wide, 0.68), 1e-9)
            self.focus = (0.5 * (low + high) - (0, 0.16 * scale, 0)) @ self.plane
            camera.focal_point = self.focus
            camera.position = self.focus + 2 * (np.sum(high - low) + scale) * self.plane[2]
        camera.parallel_scale = scale
        self.plotter.add_axes(color="black", viewport=(0, 0, 0.16, 0.28))
        if gravity.any():
            corner = self.focus + scale * np.array([-0.56 * self.wide, -0.75]) @ self.plane[:2]
            at = _held((corner, 0.2 * scale * _axes(gravity)))
            self.add([_copies("ground", "arrow", at, "gravity")], {})
        if self.look.names:
            self._name(row)
        self.move(row)

    def _name(self, row: Row) -> None:
        """Names beside things, where little is drawn; several at one place are one text."""
        import pyvista
        from scipy.ndimage import uniform_filter

        # upwards and to the right from the middle, in letters
        across = self.plane[1::-1]
        width, height = (size // self.finer for size in self.plotter.window_size)
        letter = 2.0 * self.plotter.camera.parallel_scale * self.font / (self.finer * height)
        groups: dict[Any, tuple[Floats, list[Piece]]] = {}
        named = {each.name: each for _, own in self.shown for each in own if each.name}
        for piece in named.values():
            at = np.nan_to_num(across @ (piece.anchor(row) - self.focus) / letter)
            groups.setdefault(tuple(at.round()), (at, []))[1].append(piece)
        drawn = np.zeros((height, width))
        if self.plotter.off_screen:  # a window is still empty
            drawn += np.asarray(self.shot())[::-1].min(2) < 250
        drawn = drawn[::3, ::3].copy()
        pitch = 3 * self.finer / self.font
        grid = pitch * (np.argwhere(drawn >= 0.0) - 0.5 * np.array(drawn.shape))
        for at, pieces in groups.values():
            text = ", ".join(piece.name for piece in pieces)
            box = np.array([1.7, 0.56 * len(text) + 0.5])
            filled = uniform_filter(drawn, (box / pitch).astype(int), mode="constant", cval=1.0)
            away = np.linalg.norm(np.maximum(abs(grid - at) - 0.5 * box, 0.0), axis=1)
            best = grid[np.argmin(20.0 * filled.ravel() + away)]
            drawn.ravel()[(abs(grid - best) < 0.5 * box).all(1)] = 10.0
            label = pyvista.Label(text.replace("$", r"\$"), size=self.font)
            label.prop.color = "black"
            label.prop.justification_horizontal = label.prop.justification_vertical = "center"
            self.plotter.add_actor(label, reset_camera=False, render=False)
            self.labels.append((label, pieces[0], letter * (best - at) @ across))

    def shot(self) -> Any:
        """The picture, as Pillow has it, which notebooks show."""
        from PIL import Image

        self.plotter.renderer.ResetCameraClippingRange()
        self.plotter.render()
        return Image.fromarray(self.plotter.screenshot(return_img=True)[..., :3]).reduce(self.finer)

    def show(self, path: FilePath | None) -> Any:
        """Write it, or show it in a notebook or a window."""
        if not self.plotter.off_screen:
            return self.plotter.show()
        image = self.shot()
        self.plotter.close()
        if path is None:
            return image
        with writing(path):
            image.save(path, "PNG")
        return Path(path)


# -- pictures --------------------------------------------------------------------------------------


def _off_screen(path: FilePath | None) -> bool:
    """False if a window is to be opened."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if path is not None or hasattr(shell, "kernel"):
        return True
    if _headless():
        text = "is missing, and there is no display to open a window on: give the name of a picture"
        raise InputError("argument path", text)
    return False


def _times(history: History) -> Floats:
    if not len(history):
        raise InputError("history", "has no states")
    return history.times


def _nearest(times: Floats, asked: Floats) -> list[int]:
    """Numbers of the states nearest to instants."""
    return [int(np.argmin(abs(times - t))) for t in asked]


def _rows(history: History, frames: int | Sequence[int]) -> list[Row]:
    """States in a picture."""
    numbers = frames
    times = _times(history)
    if isinstance(numbers, int):
        numbers = sorted(set(_nearest(times, np.linspace(times[0], times[-1], max(numbers, 0)))))
    if len(numbers) == 0 or not all(-len(times) <= i < len(times) for i in numbers):
        text = f"got {frames}, expected at least 1, or numbers of states: there are {len(times)}"
        raise InputError("argument frames", text)
    return [history.row(i) for i in numbers]


def _staged(
    history: History,
    rows: Sequence[Row],
    behind: Sequence[Row],
    look: Look,
    path: FilePath | None,
    before: bool = False,
) -> Stage:
    """The last of some states, which all are in view, over paler ones."""
    scene = Scene(history, rows, look)
    stage = Stage(look, path, scene.limits)
    pieces = [*scene.pieces(), *(scene.directors() if before else ())]
    for k, row in enumerate(behind):
        pale = [each for each in pieces if each.kind in ("beam", "body", "mass point", _LINES)]
        stage.add(pale, row, 0.4 + 0.5 * k / len(behind))
    stage.add(pieces, rows[-1])
    if before:
        size = 0.12, 1.3 * stage.font * len(stage.shown) / stage.plotter.window_size[1]
        stage.plotter.add_legend(bcolor=None, face="rectangle", size=size).SetPosition(0.87, 0.05)
    stage.aim(rows[-1], [piece.points(row) for row in rows for piece in pieces], scene.gravity)
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
    rows = _rows(history, frames)
    _pyvista()
    return _staged(history, rows, rows[:-1], look, path, before).show(path)


def picture_of_scene(scene: Any, path: FilePath | None, look: Look) -> Any:
    """See :meth:`Model.plot`: a history of one state, the reference; no load is zero."""
    system = system_of(scene, "model")
    meta, static = describe(system)
    rest = system.q0[None]
    series = {"t": [0], "step": [0], "load_factor": [0], "q": rest, "p": 0 * rest}
    for name, channels in (("loads", system.loading), ("actuators", system.couplings)):
        factors = np.array(channels.values(0.0))
        series[f"amplitudes/{name}"] = np.where(factors == 0, 1.0, factors)[None]
    history = History(meta | {"time": 0.0}, static, series, None, [system], path_formulas)
    return picture(history, path, 1, look, before=True)


def picture_of_mesh(mesh: MeshCurve, path: FilePath | None, look: Look) -> Any:
    """See :meth:`MeshCurve.plot`."""
    look.check(path, ".png")
    stage = Stage(look, path, (0.0, 1.0))
    import pyvista

    lines = np.moveaxis(mesh.mapping().F(np.linspace(0.0, 1.0, 9)[None]), 0, -1)
    parts = {"": mesh.unnamed_elements(), **mesh.beams}
    pieces = []
    for kind, (name, part) in zip(cycle(("beam", "force", _LINES, "moment")), parts.items()):
        own = lines[part].reshape(-1, 3)
        cells = np.insert(np.arange(len(own)).reshape(-1, 9), 0, 9, axis=1)
        if len(own):
            pieces.append(Piece(kind, pyvista.PolyData(own, lines=cells), _held(own), name))
    axes = mesh.size * np.eye(3)
    pieces.append(_copies("ground", "ball", _held((mesh.p.T, 0.004 * axes)), "", mesh.p.shape[1]))
    for name, node in mesh.nodes.items():
        pieces.append(_copies("joint", "ball", _held((mesh.p[:, node[0]], 0.007 * axes)), name))
    stage.add(pieces, {})
    stage.aim({}, [mesh.p.T, *lines], np.zeros(3))
    return stage.show(path)


# -- films -----------------------------------------------------------------------------------------


def animate(history: History, path: FilePath, fps: float, speed: float, look: Look) -> Path:
    """See :meth:`History.animate`."""
    rate = positive("argument fps", "fps", fps)
    pace = positive("argument speed", "speed", speed)
    times = _times(history)
    count = int(np.ptp(times) * rate / pace * (1 + 1e-9)) + 1
    if count > _FRAMES:
        text = f"makes {count} frames, expected at most {_FRAMES}: take a larger one"
        raise InputError("argument speed", f"got {speed:g}, which {text}, or a lower fps")
    asked = times[0] + pace / rate * np.arange(count)
    near = _nearest(times, asked)
    digits = max(int(np.ceil(np.log10(rate / pace))), 0)
    texts = [f"t = {t:.{digits}f} s" for t in asked]
    if "load_factor" in history:
        texts = [f"load factor {factor:.3f}" for factor in history["load_factor"][near]]
    return film(history, path, near, texts, (), fps, look)


def film(
    history: History,
    path: FilePath,
    numbers: Sequence[int],
    texts: Sequence[str],
    behind: Sequence[Row],
    fps: float,
    look: Look,
) -> Path:
    """Film of states, by numbers, with texts, over a pale one."""
    # the codec takes even sizes only
    look = look._replace(window=(look.window[0] // 2 * 2, look.window[1] // 2 * 2))
    look.check(path, ".gif", ".mp4")
    rate = positive("argument fps", "fps", fps)
    if rate > _GIF and Path(path).suffix.lower() == ".gif":
        text = f"got {fps:g}, expected at most {_GIF}: browsers show no more of a GIF, write .mp4"
        raise InputError("argument fps", text)
    _pyvista()
    rows = [history.row(numbers[k]) for k in spread(len(numbers), 100)]
    stage = _staged(history, rows, behind, look, path)
    corner = tuple(np.multiply(stage.plotter.window_size, (0.03, 0.93)))
    clock = stage.plotter.add_text(" ", position=corner, font_size=0.75 * stage.font, color="black")

    def pictures() -> Iterator[Any]:
        for number, clock.input in zip(numbers, texts, strict=True):
            stage.move(history.row(number))
            yield stage.shot()

    with writing(path):
        _write(path, pictures(), rate)
    stage.plotter.close()
    return Path(path)


def _write(path: FilePath, images: Iterable[Any], fps: float) -> None:
    """A GIF that loops, or H.264 in the colours that browsers play, as imageio has it."""
    from PIL import Image

    if Path(path).suffix.lower() == ".gif":
        method = Image.Quantize.MAXCOVERAGE  # white stays white
        first, *others = (image.quantize(128, method) for image in images)
        ends = (100.0 * np.arange(len(others) + 2) / fps).round().astype(int)
        durations = (10 * np.diff(ends)).tolist()
        first.save(path, save_all=True, append_images=others, duration=durations, loop=0)
        return
    try:
        import imageio.v2
        import imageio_ffmpeg  # noqa: F401
    except ImportError as error:
        text = "imageio and imageio-ffmpeg are needed for .mp4: pip install skfem-cosserat[film]"
        raise ImportError(f"{text}; .gif needs neither") from error
    with imageio.v2.get_writer(path, fps=fps, macro_block_size=2, quality=7) as writer:
        for image in images:
            writer.append_data(np.asarray(image))
