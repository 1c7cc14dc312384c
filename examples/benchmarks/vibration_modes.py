"""Natural vibrations: supports and orders, a free ring, a rotating blade, a column under load.

Frequencies of a cantilever against the exact ones of Timoshenko's theory for elements of order 1
to 4; the first shapes of a free ring; the blade of a rotor over its speed, with centrifugal and
gyroscopic forces; a column whose first frequency goes down to zero at its buckling load. Writes a
picture, CSV tables and a shape of the ring as a series for ParaView. Needs matplotlib for the
picture. All units SI.
"""

from __future__ import annotations

import argparse
import csv
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.export import write_paraview
from skfem_cosserat.figures import PAGE, chart_style, legend, new_figure, styles, write_figure

Floats = NDArray[np.float64]

STEEL = sc.Material(210e9, 0.3, 7850.0)
#: cantilever of 1 m with the section 10 mm x 10 mm: exact to 14 digits (matrix exponential, 30
#: digits), in rad/s
CANTILEVER = (52.4928679225531, 328.810511862352, 919.971547889451)


def clamped(elements: int, order: int, section: sc.Section, root: float = 0.0) -> sc.Model:
    """A beam of 1 m along e1, held at its start."""
    ends = (root, 0, 0), (root + 1.0, 0, 0)
    mesh = sc.MeshCurve.init_line(*ends, elements, nodes={"root": 0.0, "tip": 1.0})
    model = sc.Model()
    beam = model.add("beam", sc.Beam(mesh, section, director=(0, 1, 0), order=order))
    model.add("clamp", sc.JointFixed(sc.ground(ends[0]), beam.node("root")))
    return model


def cantilever(quick: bool = False) -> list[dict[str, Any]]:
    """Errors of the first three frequencies for all orders, at about equal numbers of nodes.

    A warning tells of the coarsest linear mesh, whose third frequency is 5 % off, as is meant here.
    """
    rows = []
    for order, counts in {1: (12, 24, 48), 2: (6, 12, 24), 3: (4, 8, 16), 4: (3, 6, 12)}.items():
        for elements in counts[: 2 if quick else 3]:
            model = clamped(elements, order, sc.SectionRectangle(0.01, 0.01, STEEL))
            found = sc.modes(model, count=6)
            errors = found.omega[::2] / CANTILEVER - 1  # every one is double
            rows.append(
                {
                    "order": order,
                    "elements": elements,
                    "unknowns": found.reduced.shape[1],
                    "errors": errors.tolist(),
                }
            )
    return rows


def ring(quick: bool = False) -> sc.Modes:
    """A free ring of radius 1: six motions without stiffness, then pairs."""
    arc = (1, 0, 0), (0, 1, 0), (-1, 0, 0), 1.0, 2 * np.pi
    mesh = sc.MeshCurve.init_arc(*arc, 8 if quick else 16, "ring")
    model = sc.Model()
    section = sc.SectionRectangle(0.06, 0.1, STEEL)
    model.add("ring", sc.Beam(mesh, section, director=(0, 0, 1), order=4))
    return sc.modes(model, count=16)


def blade(quick: bool = False) -> dict[str, Floats]:
    """Frequencies (rad/s) of a rotating blade over its speed (rad/s), as seen from the rotor."""
    section = sc.SectionRectangle(0.02, 0.04, STEEL)  # stiffer in the plane of rotation
    system = clamped(4, 3, section, root=0.2).freeze()
    fastest, points = 400.0, 5 if quick else 17
    spin = sc.Spin((0, 0, fastest))
    control = sc.LoadControl(steps=points - 1)
    path = sc.static(system, control=control, spin=spin, watch=False)
    speeds = fastest * path["load_factor"]
    omega = [sc.modes(system, (path, k), 6).omega for k in range(len(path))]
    return {"speed": speeds, "omega": np.array(omega)}


def column(quick: bool = False) -> dict[str, Any]:
    """Square of the first frequency of a column over its load, up to the buckling load."""
    model = clamped(4, 3, sc.SectionRectangle(0.02, 0.03, STEEL))
    model.add("weight", sc.LoadForce(model["beam"].node("tip"), (-1.0, 0, 0)))
    system = model.freeze()
    critical = float(sc.buckling(system, 1).factors[0])
    control = sc.LoadControl(until=1.2 * critical, steps=6 if quick else 24)
    path = sc.static(system, control=control, watch=False)
    squares = [sc.modes(system, (path, k), 2).squares for k in range(len(path))]
    return {"critical": critical, "load": path["load_factor"], "squares": np.array(squares)}


def main(quick: bool = False, out: str | None = None) -> dict[str, Any]:
    """Compute everything; write tables, picture and ParaView files into `out` if given.

    Parameters
    ----------
    quick : bool
        Fewer elements and points.
    out : str, optional
        Folder.

    Returns
    -------
    dict
        Errors of the cantilever, frequencies of ring and blade, of the column the load of linear
        buckling and the load at which the first frequency becomes zero.
    """
    rows, shapes, turning, loaded = cantilever(quick), ring(quick), blade(quick), column(quick)
    squares, load = loaded["squares"][:, 0], loaded["load"]
    k = int(np.flatnonzero(squares < 0)[0])
    zero = load[k - 1] + (load[k] - load[k - 1]) * squares[k - 1] / (squares[k - 1] - squares[k])
    if out is not None:
        folder = Path(out)
        folder.mkdir(parents=True, exist_ok=True)
        write(folder, rows, shapes, turning, loaded)
    return {
        "cantilever": rows,
        "ring": {"rigid": shapes.rigid, "hertz": shapes.frequencies.tolist()},
        "blade": {"speed": turning["speed"].tolist(), "omega": turning["omega"].tolist()},
        "column": {"buckling": loaded["critical"], "zero_frequency": float(zero)},
    }


def write(
    folder: Path,
    rows: list[dict[str, Any]],
    shapes: sc.Modes,
    turning: dict[str, Floats],
    loaded: dict[str, Any],
) -> None:
    """Tables, a shape for ParaView and, where matplotlib is installed, the picture."""
    with (folder / "cantilever.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["order", "elements", "unknowns", "error 1", "error 2", "error 3"])
        for row in rows:
            table.writerow([row["order"], row["elements"], row["unknowns"], *row["errors"]])
    with (folder / "blade.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["speed rad/s", *(f"omega {k} rad/s" for k in range(6))])
        table.writerows(np.column_stack([turning["speed"], turning["omega"]]).tolist())
    write_paraview(shapes.animation(shapes.rigid), folder / "ring", surfaces=True)
    with suppress(ImportError), chart_style():  # the picture comes with the extra "view"
        figure = new_figure(PAGE, 7.6)
        _draw_errors(figure.add_subplot(2, 2, 1), rows)
        _draw_ring(figure.add_subplot(2, 2, 2, projection="3d"), shapes)
        _draw_blade(figure.add_subplot(2, 2, 3), turning)
        _draw_column(figure.add_subplot(2, 2, 4), loaded)
        write_figure(figure, folder / "vibration_modes.png")


def _draw_errors(axis: Any, rows: list[dict[str, Any]]) -> None:
    orders = [f"order {row['order']}" for row in rows]
    for name, style in styles(dict.fromkeys(orders)).items():
        own = [row for row, order in zip(rows, orders, strict=True) if order == name]
        errors = [abs(row["errors"][2]) for row in own]
        axis.loglog([r["unknowns"] for r in own], errors, **style._asdict(), ms=4, label=name)
    axis.set(xlabel="unknowns", ylabel="relative error", title="Cantilever, third frequency")
    legend(axis, below=2)


def _draw_ring(axis: Any, shapes: sc.Modes) -> None:
    """Centre lines of four shapes, evaluated inside the elements."""
    system = shapes.system
    beam: Any = system.structures[0]
    ne = len(beam.basis.connectivity)
    where = np.repeat(np.arange(ne), 8), np.tile(np.linspace(0, 1, 8), ne)
    rest = diagnostics.evaluate(system, beam, shapes.q, *where).position
    axis.plot(*rest.T, color="0.7", linewidth=0.8)
    for k in range(shapes.rigid, shapes.rigid + 8, 2):
        q = shapes.animation(k, amplitude=0.06, frames=4)["q"][0]
        x = diagnostics.evaluate(system, beam, q, *where).position
        axis.plot(*x.T, label=f"{shapes.frequencies[k]:.1f} Hz")
    axis.set(title="Free ring, one of each pair of shapes")
    axis.set_aspect("equal")
    axis.set_zticks([])
    axis.set(xlabel="x in m", ylabel="y in m")
    axis.tick_params(labelsize="x-small")
    legend(axis, below=4)


def _draw_blade(axis: Any, turning: dict[str, Floats]) -> None:
    axis.plot(turning["speed"], turning["omega"])
    for k in (1, 2, 4):
        label = "1, 2, 4 times the speed" if k == 1 else None
        axis.plot(turning["speed"], k * turning["speed"], ":", color="0.4", lw=1, label=label)
    axis.set_ylim(0, 1.1 * turning["omega"][:, 3].max())
    axis.set(
        title="Rotating blade",
        xlabel="speed of the rotor in rad/s",
        ylabel="angular frequency in rad/s",
    )
    legend(axis, below=1)


def _draw_column(axis: Any, loaded: dict[str, Any]) -> None:
    axis.plot(loaded["load"] / 1e3, loaded["squares"], "o-", ms=3, label="square of the frequency")
    critical = loaded["critical"] / 1e3
    axis.axvline(critical, color="0.4", ls=":", zorder=1, label="linear buckling")
    axis.axhline(0.0, color="black", lw=0.8, zorder=1)
    axis.set(xlabel="load in kN", ylabel="square of the frequency in (rad/s)²")
    axis.set_title("Column under a weight")
    legend(axis, below=2)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--out", default="vibration_modes_results")
    arguments = parser.parse_args()
    numbers = main(arguments.quick, arguments.out)
    if arguments.json:
        print(json.dumps(numbers))
    else:
        for key, value in numbers.items():
            print(key, value)
