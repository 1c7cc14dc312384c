"""Pictures of the guide's pages 08, 11 and 14; ``python examples/guide/make_page_pictures.py``.

Page 08 shows its own scene: the first blocks of the page are run, and ParaView shows the files by
the script beside them, where it is installed. Page 11 shows the signs of a beam's resultants. Needs
the extra ``view`` and, for page 08, an OpenGL library.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from skfem_cosserat.figures import PAGE, PALETTE, new_figure, write_figure

HERE = Path(__file__).resolve().parent
PICTURES = HERE / "pictures"
STEEL, FORCE, MOMENT = "#4682b4", PALETTE["red"], PALETTE["green"]


def scene(page: Path, blocks: int) -> dict[str, Any]:
    """Names that the first python blocks of a page define, run in an empty folder."""
    sources = re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)
    names: dict[str, Any] = {"__name__": "page"}
    for source in sources[:blocks]:
        exec(source, names)
    return names


def shrunk(path: Path, width: int) -> None:
    """The picture at this width, with a palette: a tenth of the size."""
    from PIL import Image

    with Image.open(path) as image:
        height = round(image.height * width / image.width)
        small = image.convert("RGB").resize((width, height), Image.Resampling.LANCZOS)
        small.quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)


def paraview(folder: Path, path: Path) -> None:
    """What ParaView shows of the last state; without ``pvpython`` the picture stays as it is."""
    if (program := shutil.which("pvpython")) is not None:
        subprocess.run([program, str(folder / "paraview.py"), str(path)], check=True)
        shrunk(path, 700)


def page_08(out: Path) -> list[Path]:
    """Steps in ParaView, a chart, the scene, several instants of its motion, and a film."""
    paths = [out / f"08_{name}.png" for name in ("paraview", "series", "render", "scene")]
    home = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            names = scene(HERE / "08_paraview_and_pictures.md", 2)
        finally:
            os.chdir(home)
        history = names["history"]
        paraview(Path(folder) / "swing", paths[0])
    history.plot("joint/hinge/angle", "coupling/spring/force", path=paths[1])
    shrunk(paths[1], 700)
    history.picture(paths[2], frames=5, camera="xy", window=(1400, 900))
    names["model"].plot(paths[3], names=True, camera="xy", window=(1400, 800))
    shrunk(paths[2], 700)
    shrunk(paths[3], 900)
    film = history.animate(out / "08_film.gif", speed=0.25, camera="xy", window=(480, 300))
    return [*paths, film]


def page_14(out: Path) -> list[Path]:
    """The hose on its drum: the recipe of an obstacle."""
    page = (HERE / "14_cookbook.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    exec(page.partition("## An obstacle")[2].split("```")[1].removeprefix("python"), names)
    path = out / "14_drum.png"
    names["run"].picture(path, frames=2, window=(1400, 900))
    shrunk(path, 700)
    return [path]


def _arrow(axis: Any, start: Any, way: Any, text: str, color: str, double: bool = False) -> None:
    """A vector with a label at its tip; a moment has two heads."""
    start, way = np.array(start, dtype=float), np.array(way, dtype=float)
    axis.quiver(*start, *way, color=color, arrow_length_ratio=0.16, linewidth=2)
    if double:
        axis.quiver(*start, *(0.8 * way), color=color, arrow_length_ratio=0.2, linewidth=2)
    axis.text(*(start + 1.16 * way), text, color=color, fontsize=12, ha="center", va="center")


def _face(axis: Any) -> None:
    """A piece of a beam, cut open at the face with outward normal d3."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    a, b, length = 0.35, 0.5, 1.9  # half edges along d1 and d2; drawn are (d3, d1, d2)
    corners = np.array([(x, y) for x, y in ((-a, -b), (a, -b), (a, b), (-a, b))])
    near, far = (np.column_stack([np.full(4, s), corners]) for s in (0.0, -length))
    sides = [[near[i], near[i - 1], far[i - 1], far[i]] for i in range(4)]
    axis.add_collection3d(Poly3DCollection(sides, facecolor=STEEL, edgecolor="k", alpha=0.25))
    axis.add_collection3d(Poly3DCollection([near], facecolor=STEEL, edgecolor="k", alpha=0.6))
    for way, k in (((0, 1, 0), 1), ((0, 0, 1), 2), ((1, 0, 0), 3)):
        way = np.array(way, dtype=float)
        _arrow(axis, (0, 0, 0), 1.25 * way, f"$N_{k}$", FORCE)
        _arrow(axis, 1.75 * way, 0.7 * way, f"$M_{k}$", MOMENT, double=True)
    axis.set_title("positive $N_k$ and $M_k$ point along $d_k$", fontsize=12)
    axis.set_box_aspect((4.9, 3.4, 3.4), zoom=1.25)
    axis.set(xlim=(-2.2, 2.7), ylim=(-0.9, 2.5), zlim=(-0.9, 2.5))
    axis.view_init(elev=22, azim=-52)
    axis.set_axis_off()


def _bent(axis: Any, sign: float, moment: str, up: str) -> None:
    """A bent piece: tension on one side, compression on the other."""
    s = np.linspace(-0.6, 0.6, 61)
    x, y = np.sin(s), sign * (1 - np.cos(s))
    normal = np.column_stack([-sign * np.sin(s), np.cos(s)])
    upper, lower = (np.column_stack([x, y]) + k * 0.11 * normal for k in (1, -1))
    axis.fill(*np.vstack([upper, lower[::-1]]).T, color=STEEL, alpha=0.3)
    for line, stretched in ((upper, sign < 0), (lower, sign > 0)):
        text, color = ("tension", FORCE) if stretched else ("compression", PALETTE["blue"])
        axis.plot(*line.T, color=color, linewidth=2.5)
        away = 0.13 if line is upper else -0.13
        axis.text(*(line[30] + (0, away)), text, color=color, ha="center", va="center")
    end, along = np.array([x[-1], y[-1]]), np.array([np.cos(s[-1]), sign * np.sin(s[-1])])
    arrow = {"arrowstyle": "-|>", "color": "k", "linewidth": 1.6}
    for way, name in ((along, "$d_3$"), (normal[-1], up)):
        axis.annotate("", end + 0.33 * way, end, arrowprops=arrow)
        axis.text(*(end + 0.42 * way), name, fontsize=12, ha="center", va="center")
    axis.set_title(moment, fontsize=12, color=MOMENT)
    axis.set_aspect("equal")
    axis.set(xlim=(-0.85, 1.15), ylim=(-0.62, 0.62))
    axis.set_axis_off()


def page_11(out: Path) -> list[Path]:
    """Positive resultants at a face, and the bending that goes with positive moments."""
    path = out / "11_signs.png"
    figure = new_figure(PAGE, 4.2)
    left, right = figure.subfigures(1, 2, width_ratios=(1.15, 1))
    _face(left.add_subplot(projection="3d"))
    top, bottom = right.subplots(2)
    _bent(top, -1.0, "$M_1 > 0$, seen along $d_1$", "$d_2$")
    _bent(bottom, 1.0, "$M_2 > 0$, seen against $d_2$", "$d_1$")
    write_figure(figure, path)
    shrunk(path, 900)
    return [path]


def main(out: str | os.PathLike[str] = PICTURES) -> list[Path]:
    """Write all pictures; returns their paths."""
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    return [*page_08(folder), *page_11(folder), *page_14(folder)]


if __name__ == "__main__":
    for path in main():
        print(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)
