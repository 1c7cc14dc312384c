"""Adaptive meshes against uniform ones: how many unknowns a tolerance takes.

Four problems, a point as quantity of interest in each (SI units):

*bend*: the 45-degree bend of Bathe & Bolourchi (1979), with its 600 N not at the end but halfway,
where the moment has a kink; beyond it nothing is bent; position of the end.

*frame*: the right-angle cantilever of Simo & Vu-Quoc (1988), at rest under 50 N at the elbow;
position of the end. *frame in time*: the same one swinging after the triangular pulse of 50 N,
positions of the end at 1, 1.5 and 2 s.

*lee*: Lee's frame under 15 kN, position of the loaded point, 24 m from the corner.

*swing*: the three-bar swing of Leyendecker, Marsden & Ortiz (2008), position of the mass at 0.25,
0.4 and 0.5 s; waves run through the beam, which is heavy.

Each is solved by elements that are halved where it matters or raised in order (starting from few
elements of order 2, the swing of order 1), by halving alone, and by uniform refinement of order 2
(the swing: 1) and of order 4. True errors are against elements of order 4 on a mesh 16 times as
fine, in time with the same step.

Run ``python examples/benchmarks/adaptive_mesh.py --help`` for the choices. Writes a table and,
where matplotlib is there, a chart.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: small matrices

import argparse
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

from record import Record

import skfem_cosserat as sc
from paper import three_bar_swing
from skfem_cosserat.accuracy.chart import draw_errors
from skfem_cosserat.adaptive import (
    Adapted,
    Halve,
    HalveOrRaise,
    NodePosition,
    RunInTime,
    RunStatic,
    Uniform,
    adapt,
)
from skfem_cosserat.export import prepare_folder
from skfem_cosserat.figures import PAGE, legend, panels, write_figure

Floats = NDArray[np.float64]
PICTURES = Path(__file__).resolve().parents[1] / "pictures"
E3 = (0.0, 0.0, 1.0)


class Case(NamedTuple):
    """A problem.

    ``build(mesh, order)`` gives its model, ``finer`` how often the mesh is halved for the
    reference, ``order`` the one to begin with.
    """

    build: Callable[[sc.MeshCurve, int], Any]
    mesh: sc.MeshCurve
    quantity: NodePosition
    run: Any
    finer: int
    order: int
    tolerance: float


def bend(mesh: sc.MeshCurve, order: int) -> sc.Model:
    """A quarter of a right angle, 1 x 1 m section, E = 1e7, G = 5e6."""
    E, G = 1e7, 5e6
    section = sc.Section([G, G, E, E / 12, E / 12, G / 6], mass=1.0, inertia=(1 / 12, 1 / 12))
    model = sc.Model()
    beam = model.add("bend", sc.Beam(mesh, section, order=order, director=E3))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("bend.start")))
    model.add("force", sc.LoadForce(beam.node("hook"), (0, 0, 600.0)))
    return model


def frame(mesh: sc.MeshCurve, order: int) -> sc.Model:
    """Two legs of 10 m, force at the elbow; grows with the load factor."""
    return _frame(mesh, order, (0, 0, 50.0), None)


def frame_in_time(mesh: sc.MeshCurve, order: int) -> sc.Model:
    """The same with a triangular pulse of 2 s."""
    return _frame(mesh, order, E3, sc.Table([0, 1, 2], [0, 50, 0]))


def _frame(mesh: sc.MeshCurve, order: int, force: Any, pulse: Any) -> sc.Model:
    section = sc.Section([1e6, 1e6, 1e6, 1e3, 1e3, 1e3], mass=1.0, inertia=(10.0, 10.0))
    model = sc.Model()
    beam = model.add("frame", sc.Beam(mesh, section, order=order, director=E3))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("frame.start")))
    model.add("force", sc.LoadForce(beam.node("elbow"), force, pulse))
    return model


def lee(mesh: sc.MeshCurve, order: int) -> sc.Model:
    """Lee's frame; out of its plane a hundred times as stiff."""
    E, EI = 7.2e6, 2 * 7.2e6
    section = sc.Section(
        [6 * E / 2.6, 6 * E / 2.6, 6 * E, EI, 100 * EI, 100 * EI], mass=1.0, inertia=(1.0, 1.0)
    )
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=E3))
    for end in ("start", "end"):
        node = rod.node(f"rod.{end}")
        model.add(f"hinge at {end}", sc.JointRevolute(sc.ground(node.position), node, E3))
    model.add("load", sc.LoadForce(rod.node("loaded"), (0, -1.0, 0)))
    return model


def swing(mesh: sc.MeshCurve, order: int) -> sc.System:
    """The three-bar swing."""
    return three_bar_swing.build(mesh=mesh, order=order)


_ARC = sc.MeshCurve.init_arc(
    (0, 0, 0), (1, 0, 0), (0, 1, 0), 100.0, np.pi / 4, 4, name="bend", nodes={"hook": 0.5}
)
_LEGS = sc.MeshCurve.init_polyline(
    [(0, 0, 0), (10, 0, 0), (10, 10, 0)], 2, name="frame", nodes={"elbow": 0.5}
)
_LEE = sc.MeshCurve.init_polyline(
    [(0, 0, 0), (0, 120, 0), (24, 120, 0), (120, 120, 0)], [2, 1, 2], name="rod"
).with_nodes({"loaded": (24, 120, 0)})
_SPAN = sc.MeshCurve.init_line(
    *((0, 0, 0), (0, three_bar_swing.SPAN, 0), 2),
    name="beam",
    nodes={"left": 0.0, "mid": 0.5, "right": 1.0},
)
_EM = sc.EnergyMomentum()
_UP = RunStatic(sc.LoadControl(until=15000.0))
_PULSE = RunInTime(_EM, 1 / 80, 2.0, times=[1.0, 1.5, 2.0])
_PUSH = RunInTime(_EM, 2.5e-3, 0.5, times=[0.25, 0.4, 0.5])

CASES = {
    "bend": Case(bend, _ARC, NodePosition("bend", "bend.end"), RunStatic(), 4, 2, 1e-4),
    "frame": Case(frame, _LEGS, NodePosition("frame", "frame.end"), RunStatic(), 4, 2, 1e-4),
    "lee": Case(lee, _LEE, NodePosition("rod", "loaded"), _UP, 4, 2, 1e-3),
    "frame in time": Case(
        frame_in_time, _LEGS, NodePosition("frame", "frame.end"), _PULSE, 3, 2, 5e-4
    ),
    "swing": Case(swing, _SPAN, NodePosition("beam", "mid"), _PUSH, 4, 1, 1e-4),
}


def reference(case: Case) -> Floats:
    """The quantity (T, 3) on a mesh that is fine enough for all tolerances."""
    model = case.build(case.mesh.refined(case.finer), 4)
    system = model.freeze() if isinstance(model, sc.Model) else model
    return np.asarray(case.run.values(case.quantity, system, case.run.solve(system, None)))


def study(name: str, strategy: Any, order: int | None = None) -> Adapted:
    """One problem with one way to refine."""
    case = CASES[name]
    return adapt(
        case.build,
        case.mesh,
        case.quantity,
        case.tolerance,
        run=case.run,
        order=case.order if order is None else order,
        strategy=strategy,
    )


#: how it is refined, and the order to begin with (None: that of the case)
WAYS: dict[str, tuple[Any, int | None]] = {
    "adaptive": (HalveOrRaise(), None),
    "halved where it matters": (Halve(), None),
    "uniform": (Uniform(), None),
    "uniform, order 4": (Uniform(), 4),
}


def main(quick: bool = True, out: str | Path | None = None) -> dict[str, Any]:
    """Refine each problem in each way.

    Parameters
    ----------
    quick : bool
        The bend and the frame at rest only.
    out : path, optional
        Folder for the table and the chart; None: nothing is written.

    Returns
    -------
    dict
        By problem and way: ``reached``, ``tolerance`` (m), ``unknowns``, ``elements``, ``order``,
        ``error`` (true one, m) and ``estimate`` of the last mesh, and ``levels``: pairs of unknowns
        and true errors. ``paths`` written.
    """
    if out is not None:
        prepare_folder(Path(out))
    record = Record()
    result: dict[str, Any] = {}
    with record.run(f"adaptive meshes{', quick' if quick else ''}") as number:
        for name in list(CASES)[: 2 if quick else None]:
            exact = reference(CASES[name])
            result[name] = {way: _entry(study(name, *how), exact) for way, how in WAYS.items()}
    if out is not None:
        result["paths"] = _write(result, Path(out), record, number)
    return result


def _entry(found: Adapted, exact: Floats) -> dict[str, Any]:
    errors = [float(np.linalg.norm(x.value - exact, axis=1).max()) for x in found.levels]
    last = found.levels[-1]
    return {
        "reached": found.reached,
        "tolerance": found.tolerance,
        "unknowns": last.unknowns,
        "elements": last.elements,
        "order": last.order,
        "error": errors[-1],
        "estimate": found.estimate,
        "levels": [(x.unknowns, e) for x, e in zip(found.levels, errors, strict=True)],
    }


def _write(result: dict[str, Any], folder: Path, record: Record, number: int) -> list[Path]:
    """A table of all meshes, and a chart."""
    rows = [
        (name, way, *level, entry["tolerance"], k == len(entry["levels"]) - 1)
        for name, ways in result.items()
        for way, entry in ways.items()
        for k, level in enumerate(entry["levels"])
    ]
    header = ["problem", "refinement", "unknowns", "error_m", "tolerance_m", "last"]
    paths = [record.write_csv(folder / "adaptive_mesh.csv", number, header, rows)]
    with suppress(ImportError):  # charts come with the extra "view"
        paths.append(chart(result, folder / "adaptive_mesh.png"))
    return paths


def chart(result: dict[str, Any], path: Path) -> Path:
    """True errors against unknowns, a panel for each problem."""
    problems = {k: v for k, v in result.items() if k in CASES}
    down = -(-len(problems) // 3)
    figure, shown = panels(PAGE, 0.6 + 3.0 * down, down, min(len(problems), 3), len(problems))
    for axes, (name, ways) in zip(shown, problems.items(), strict=True):
        lines = {way: tuple(zip(*e["levels"], strict=True)) for way, e in ways.items()}
        draw_errors(axes, lines, CASES[name].tolerance, name, "m")
    legend(figure, below=3)
    write_figure(figure, path)
    return path


def lines(result: dict[str, Any]) -> list[str]:
    """A table to print."""
    out = [f"{'problem':14} {'refinement':24} unknowns elements order     error  tolerance"]
    for name, ways in result.items():
        if name in CASES:
            for way, e in ways.items():
                out.append(
                    f"{name:14} {way:24} {e['unknowns']:8} {e['elements']:8} {e['order']:5}"
                    f" {e['error']:9.2e} {e['tolerance']:9.0e}{'' if e['reached'] else ' missed'}"
                )
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="the two smallest problems only")
    parser.add_argument("--out", default=str(PICTURES), help="folder for all files")
    arguments = parser.parse_args()
    print("\n".join(lines(main(arguments.quick, arguments.out))))
