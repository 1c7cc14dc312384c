"""Four equilibrium paths to look at: snap-through, a folding ring, a buckled column, a helix.

Lee's frame through both limit points by arc length; a ring that a full turn folds to a third of its
radius; a column that goes on along the branch at its Euler load; a rod rolled up ten times and
drawn out by a small force. Writes a picture, CSV tables of the paths and the ring for ParaView.
Needs matplotlib for the picture.
"""

from __future__ import annotations

import argparse
import json
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent))

import static_scenes
from record import Record

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.export import write_paraview
from skfem_cosserat.figures import PAGE, PALETTE, chart_style, legend, new_figure, write_figure

Floats = NDArray[np.float64]


def displacement(scene: static_scenes.Scene, path: sc.History) -> Floats:
    """Displacements (points, 3) of the place that is looked at."""
    return np.asarray(path.position(scene.point) - scene.point.position)


def lee(quick: bool = False) -> dict[str, Any]:
    """Lee's frame: load against the deflection of the loaded point."""
    scene = static_scenes.lee_frame(10 if quick else 20, 3)
    control = sc.ArcLength(400, first=1000.0, until=25000.0, longest=0.02)
    path = sc.static(scene.system, control=control)
    return {"scene": scene, "path": path, "u": displacement(scene, path)}


def ring(quick: bool = False) -> dict[str, Any]:
    """The ring turned through 2 pi: torque and radius."""
    scene = static_scenes.deployable_ring(16, 4)
    path = sc.static(scene.system, control=sc.LoadControl(longest=0.05, first=0.02))
    return {"scene": scene, "path": path, "u": displacement(scene, path)}


def column(quick: bool = False) -> dict[str, Any]:
    """A clamped column and one side of its branch."""
    scene = static_scenes.column(4, 3, pinned=False)
    euler = np.pi**2 / 4 * 109375.0
    path = sc.static(scene.system, control=sc.LoadControl(until=1.1 * euler))
    start = sc.branch(scene.system, path)
    control = sc.ArcLength(60, until=2.2 * euler, longest=0.1)
    bent = sc.static(scene.system, control=control, start=start)
    return {"scene": scene, "path": path, "branch": bent, "u": displacement(scene, bent)}


def helix(quick: bool = False) -> dict[str, Any]:
    """Ten turns by an end moment; the tip swings in and out."""
    scene = static_scenes.helix_roll_up(40, 4)
    until = 0.3 if quick else 1.0
    path = sc.static(scene.system, control=sc.LoadControl(until=until, longest=0.005), watch=False)
    return {"scene": scene, "path": path, "u": displacement(scene, path)}


PATHS = {"lee": lee, "ring": ring, "column": column, "helix": helix}


def main(quick: bool = False, out: str | Path | None = None) -> dict[str, Any]:
    """Follow the paths.

    Parameters
    ----------
    quick : bool
        Coarser meshes, a third of the helix.
    out : path, optional
        Folder for load_paths.png, a CSV of each path, and ring/ for ParaView.

    Returns
    -------
    dict
        For each path: ``points``, ``newton_iterations`` a point, ``rejected``, ``critical`` (kind
        and load factor), ``displacement`` at its end (m).
    """
    record = Record()
    with record.run("load paths") as run:
        found = {name: follow(quick) for name, follow in PATHS.items()}
    result: dict[str, Any] = {}
    for name, each in found.items():
        path = each["path"]
        regular = path["newton_iterations"][1:][path["critical"][1:] == 0]
        result[name] = {
            "points": len(path),
            "newton_iterations": float(regular.mean()),
            "rejected": path.meta["rejected"],
            "critical": [(c["kind"], c["load_factor"]) for c in path.meta["critical"]],
            "displacement": each["u"][-1].tolist(),
        }
    scene, path = found["ring"]["scene"], found["ring"]["path"]
    x = scene.beam.basis.nodes
    last = np.array([path.position(scene.beam.node(k))[-1] for k in range(len(x))])
    result["ring"]["radius_ratio"] = float(np.ptp(last[:, 0]) / np.ptp(x[:, 0]))
    if out is not None:
        _write(found, record, run, Path(out))
    return result


def _write(found: dict[str, Any], record: Any, run: int, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    header = ["load_factor", "u_x", "u_y", "u_z", "unstable", "critical", "newton_iterations"]
    for name, each in found.items():
        path = each.get("branch", each["path"])
        series = [path[k] for k in ("load_factor", "unstable", "critical", "newton_iterations")]
        rows = [
            [factor, *u, *rest]
            for factor, *rest, u in zip(*series, each["u"].tolist(), strict=True)
        ]
        record.write_csv(folder / f"path_{name}.csv", run, header, rows)
    write_paraview(found["ring"]["path"], folder / "ring")
    with suppress(ImportError), chart_style():  # the picture comes with the extra "view"
        figure = new_figure(PAGE, 7.6)
        _draw_lee(figure.add_subplot(2, 2, 1), found["lee"])
        _draw_ring(figure.add_subplot(2, 2, 2, projection="3d"), found["ring"])
        _draw_column(figure.add_subplot(2, 2, 3), found["column"])
        _draw_helix(figure.add_subplot(2, 2, 4), found["helix"])
        write_figure(figure, folder / "load_paths.png")


def _draw_lee(axis: Any, each: dict[str, Any]) -> None:
    path, down = each["path"], -each["u"][:, 1]
    load = 1e-3 * path["load_factor"]
    axis.plot(down, load, label="down")
    axis.plot(each["u"][:, 0], load, "--", label="sideways")
    limits = path["critical"] == 1
    axis.plot(down[limits], load[limits], "s", color=PALETTE["brown"], label="limit points")
    axis.set(title="Lee's frame", xlabel="displacement in m", ylabel="load in kN")
    legend(axis, below=3)


def _draw_column(axis: Any, each: dict[str, Any]) -> None:
    straight, bent = each["path"], each["branch"]
    load, on = 1e-3 * straight["load_factor"], 1e-3 * bent["load_factor"]
    axis.plot(0 * load, load, label="straight")
    axis.plot(abs(each["u"][:, 1]), on, "--", label="bent")
    critical = 1e-3 * straight.meta["critical"][0]["load_factor"]
    axis.axhline(critical, color="0.6", linewidth=0.8, zorder=1, label="critical load")
    axis.set(xlabel="displacement of the tip sideways in m", ylabel="load in kN")
    axis.set_title("Column beyond its critical load")
    legend(axis, below=3)


def _draw_ring(axis: Any, each: dict[str, Any]) -> None:
    """Centre lines at some points of the path, evaluated inside the elements."""
    scene, path = each["scene"], each["path"]
    beam = scene.beam
    ne = len(beam.basis.connectivity)
    where = np.repeat(np.arange(ne), 8), np.tile(np.linspace(0, 1, 8), ne)
    for k in np.linspace(0, len(path) - 1, 6).round().astype(int):
        x = diagnostics.evaluate(scene.system, beam, path["q"][k], *where).position
        axis.plot(*x.T, label=f"{path['load_factor'][k]:.2f}")
    axis.set(title="Ring folded by a full turn of one point")
    axis.set_aspect("equal")
    axis.set(xlabel="x in m", ylabel="y in m", zlabel="z in m")
    axis.tick_params(labelsize="x-small")
    legend(axis, "turns", below=3)


def _draw_helix(axis: Any, each: dict[str, Any]) -> None:
    axis.plot(each["path"]["load_factor"], each["u"][:, 2])
    axis.set(xlabel="part of the load", ylabel="displacement of the tip out of plane in m")
    axis.set_title("Rod rolled up ten times")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--out", default="load_paths_results")
    arguments = parser.parse_args()
    numbers = main(arguments.quick, arguments.out)
    if arguments.json:
        print(json.dumps(numbers))
    else:
        for key, value in numbers.items():
            print(key, value)
