"""Orders of convergence of elements of order 1 to 4, quantity by quantity, and what spoils them.

The 45-degree bend (curved reference, large rotations in space) under 600 N for displacements,
rotations, energy, reactions and resultants; the same arc for frequencies; a column for its critical
load. Then locking: an arc of slenderness 100 and 10^4 with p and with p + 1 Gauss points.
Needs matplotlib for the picture.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
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
from skfem_cosserat.element import Interpolation, InterpolationEquidistant, InterpolationLobatto
from skfem_cosserat.figures import PAGE, legend, panels, styles, write_figure

Floats = NDArray[np.float64]
FORCE = 600.0
#: of the second of two kinds of elements of the same order
BROKEN = {"linestyle": "--", "mfc": "none"}
FINE = 128
#: expected orders by quantity
EXPECTED = {
    "displacement at element ends": "2p",
    "rotation at element ends": "2p",
    "energy": "2p",
    "reactions": "2p",
    "resultants at nodes": "2p",
    "frequencies": "2p",
    "critical load": "2p",
    "displacement at interior nodes": "p+2",
    "displacement anywhere": "p+1",
    "resultants at Gauss points": "p+1",
}
#: errors relative to the quantity below which rounding decides
FLOOR = 1e-12
#: of eigenvalues, against the largest of the matrix; and of forces
FLOORS = {"frequencies": 1e-10, "critical load": 1e-9}
FLOORS |= dict.fromkeys(["resultants at nodes", "reactions"], 8e-12)


def _solved(elements: int, kind: Any) -> tuple[static_scenes.Scene, sc.History]:
    scene = static_scenes.bend(elements, kind, FORCE)
    path = sc.static(scene.system, control=sc.LoadControl(steps=2), watch=False)
    return scene, path


class _Reference:
    """The bend on a fine mesh of quartic elements: nodes good to rounding."""

    def __init__(self) -> None:
        scene, path = _solved(FINE, 4)
        self.system, self.beam, self.q = scene.system, scene.beam, path["q"][-1]
        self.energy = float(path["strain_energy"][-1])
        self.reaction = np.concatenate(
            [path[f"joint/clamp/{name}"][-1] for name in ("force", "moment")]
        )
        self.tip = path.position(scene.point)[-1]

    def at(self, s: Floats) -> tuple[Floats, Floats, Floats]:
        """Positions, triads and resultants (in the section frame) at arc lengths."""
        where = diagnostics.evaluate(
            self.system, self.beam, self.q, *self.beam.along(s), orthonormal=True
        )
        force = np.broadcast_to((0.0, 0.0, FORCE), where.position.shape)
        moment = np.cross(self.tip - where.position, force)
        local = [np.einsum("kij,kj->ki", where.triad, f) for f in (force, moment)]
        return where.position, where.triad, np.concatenate(local, axis=1)


def _angle(a: Floats, b: Floats) -> float:
    """Largest angle between triads (k, 3, 3), small or not."""
    return float(np.linalg.norm(a - b, axis=(1, 2)).max() / np.sqrt(2))


def bend_errors(elements: int, kind: Any, reference: _Reference) -> dict[str, float]:
    """Errors of the bend by quantity: displacements and moments relative to the largest."""
    scene, path = _solved(elements, kind)
    system, beam, q = scene.system, scene.beam, path["q"][-1]
    basis = beam.basis
    count = len(basis.nodes)
    x, d = (
        np.array([read(beam.node(k))[-1] for k in range(count)])
        for read in (path.position, path.rotation)
    )
    s = basis.arc_lengths
    ends, inner = basis.connectivity[:, [0, -1]], basis.connectivity[:, 1:-1]
    size = np.linalg.norm(reference.tip - beam.basis.nodes[scene.point.vertex])

    def displacement(nodes: NDArray[np.int64], at: Floats) -> float:
        if not nodes.size:
            return np.nan
        exact = reference.at(at.ravel())[0]
        return float(np.linalg.norm(x[nodes.ravel()] - exact, axis=1).max() / size)

    reaction = np.concatenate([path[f"joint/clamp/{name}"][-1] for name in ("force", "moment")])
    triads = reference.at(s[:, [0, -1]].ravel())[1]
    xi = np.linspace(0.05, 0.95, 7)
    count = len(basis.connectivity)
    where = np.repeat(np.arange(count), len(xi)), np.tile(xi, count)
    anywhere = diagnostics.evaluate(system, beam, q, *where).position
    exact = reference.at((basis.mesh.arc_starts[:, None] + basis.lengths[:, None] * xi).ravel())[0]
    gauss = (basis.mesh.arc_starts[:, None] + basis.lengths[:, None] * basis.points).ravel()
    moments = diagnostics.section_forces(system, beam, q).reshape(-1, 6)[:, 3:]
    at_gauss, at_nodes = (reference.at(at)[2][:, 3:] for at in (gauss, s[:, [0, -1]].ravel()))
    nodal = diagnostics.nodal_resultants(system, beam, q).reshape(-1, 6)[:, 3:]
    largest = float(abs(at_nodes).max())
    return {
        "displacement at element ends": displacement(ends, s[:, [0, -1]]),
        "rotation at element ends": _angle(d[ends.ravel()], triads),
        "energy": abs(float(path["strain_energy"][-1]) / reference.energy - 1),
        "reactions": float(
            np.linalg.norm(reaction - reference.reaction) / np.linalg.norm(reference.reaction)
        ),
        "resultants at nodes": float(abs(nodal - at_nodes).max() / largest),
        "displacement at interior nodes": displacement(inner, s[:, 1:-1]),
        "displacement anywhere": float(np.linalg.norm(anywhere - exact, axis=1).max() / size),
        "resultants at Gauss points": float(abs(moments - at_gauss).max() / largest),
    }


def frequencies(elements: int, kind: Any) -> Floats:
    """First three frequencies of the arc, clamped at one end, without loads (rad/s)."""
    return np.asarray(sc.modes(static_scenes.bend(elements, kind).system, count=3).omega)


def critical_load(elements: int, kind: Any) -> tuple[float, float]:
    """Critical load of a clamped column with shear and extension: found, and in closed form."""
    EI, EA, GA, length = 1.0, 4e3, 1e3, 1.0
    section = sc.Section.from_constants(
        EA=EA, GA=GA, EI=(EI, 4 * EI), GJ=EI, mass=1.0, inertia=(1.0, 1.0)
    )
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (length, 0, 0), elements, name="rod")
    rod = model.add("rod", sc.Beam(mesh, section, order=kind, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("push", sc.LoadForce(rod.node("rod.end"), (-1.0, 0, 0)))
    path = sc.static(model, control=sc.LoadControl(until=3.5, steps=1))
    euler = np.pi**2 / 4 * EI / length**2
    # P (1 - P/EA + P/GA) = pi^2 EI/(4 L^2)
    slope = 1 / GA - 1 / EA
    exact = (np.sqrt(1 + 4 * slope * euler) - 1) / (2 * slope)
    return float(path.meta["critical"][0]["load_factor"]), float(exact)


def order_of(elements: list[int], errors: list[float], floor: float = FLOOR) -> float:
    """Slope between the two finest meshes whose errors are above rounding."""
    good = [k for k, e in enumerate(errors) if np.isfinite(e) and e > floor]
    if len(good) < 2:
        return np.nan
    a, b = good[-2:]
    return float(np.log(errors[a] / errors[b]) / np.log(elements[b] / elements[a]))


def _meshes(order: int, quick: bool) -> list[int]:
    """Elements: fine enough for the slope, coarse enough to stay above rounding."""
    if order == 4:  # loses eight bits with each halving: one mesh between
        return [2, 4, 8] if quick else [2, 4, 8, 12, 16, 32, 64]
    coarsest = {1: 16, 2: 8, 3: 4}[order]
    return [coarsest * 2**k for k in range(3 if quick else 5)]


def table(kinds: list[Interpolation], quick: bool) -> list[dict[str, Any]]:
    """Rows (nodes, order, quantity, elements, errors, slope)."""
    reference = _Reference()
    exact = frequencies(FINE, 4)
    rows = []
    for kind in kinds:
        meshes = _meshes(kind.order, quick)
        errors: dict[str, list[float]] = {name: [] for name in EXPECTED}
        for ne in meshes:
            for name, value in bend_errors(ne, kind, reference).items():
                errors[name].append(value)
            errors["frequencies"].append(float(abs(frequencies(ne, kind) / exact - 1).max()))
            found, closed = critical_load(max(1, ne // 2), kind)
            errors["critical load"].append(abs(found / closed - 1))
        for name, values in errors.items():
            floor = FLOORS.get(name, FLOOR)
            rows.append(
                {
                    "nodes": type(kind).__name__.removeprefix("Interpolation").lower(),
                    "order": kind.order,
                    "points": kind.points,
                    "quantity": name,
                    "elements": meshes,
                    "errors": values,
                    "slope": order_of(meshes, values, floor),
                }
            )
    return rows


def costs(quick: bool, repeats: int = 3) -> list[dict[str, Any]]:
    """Tip error (m) and wall time of the bend in one load step, fastest of several runs."""
    exact = _solved(FINE, 4)
    tip = exact[1].position(exact[0].point)[-1]
    rows = []
    for order in (1, 2, 3, 4):
        for ne in _meshes(order, quick):
            scene = static_scenes.bend(ne, order, FORCE)
            seconds = []
            for _ in range(repeats):
                start = time.perf_counter()
                path = sc.static(
                    scene.system, control=sc.LoadControl(steps=1), watch=False, derive=False
                )
                seconds.append(time.perf_counter() - start)
            error = path.position(scene.point)[-1] - tip
            row = {"order": order, "elements": ne, "unknowns": scene.system.unknowns}
            row |= {"error": float(np.linalg.norm(error)), "seconds": min(seconds)}
            rows.append(row | {"newton_iterations": int(path["newton_iterations"][-1])})
    return rows


def locking(quick: bool) -> list[dict[str, Any]]:
    """Tip error of 8 elements on an arc of slenderness 100 and 10^4, with p and p + 1 points."""
    rows = []
    for slenderness in (100.0, 1e4):
        fine = static_scenes.slender_arc(32, 4, slenderness)
        exact = _tip(fine)
        for order in (1, 2, 3, 4):
            for points in (order, order + 1):
                kind = InterpolationLobatto(order, points=points)
                tip = _tip(static_scenes.slender_arc(8, kind, slenderness))
                error = float(np.linalg.norm(tip - exact))
                rows.append(
                    {"slenderness": slenderness, "order": order, "points": points, "error": error}
                )
    return rows


def _tip(scene: static_scenes.Scene) -> Floats:
    path = sc.static(scene.system, watch=False, derive=False)
    return np.asarray(path.position(scene.point)[-1])


def main(quick: bool = False, out: str | Path | None = None) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    quick : bool
        Meshes half as fine, and no equidistant nodes of order 1 and 2 (they are the same).
    out : path, optional
        Folder for element_orders.csv and .png.

    Returns
    -------
    dict
        ``orders``: rows of :func:`table`; ``costs``, ``locking``: of the functions of that name.
    """
    kinds: list[Interpolation] = [InterpolationLobatto(p) for p in (1, 2, 3, 4)]
    kinds += [InterpolationEquidistant(p) for p in (3, 4)]
    record = Record()
    with record.run("element orders") as run:
        result = {
            "orders": table(kinds, quick),
            "costs": costs(quick),
            "locking": locking(quick),
        }
    if out is not None:
        _write(result, record, run, Path(out))
    return result


def _write(result: dict[str, Any], record: Any, run: int, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    header = ["nodes", "order", "points", "quantity", "elements", "relative_error", "slope"]
    rows = [
        [r["nodes"], r["order"], r["points"], r["quantity"], ne, error, r["slope"]]
        for r in result["orders"]
        for ne, error in zip(r["elements"], r["errors"], strict=True)
    ]
    record.write_csv(folder / "element_orders.csv", run, header, rows)
    for key in ("costs", "locking"):
        names = list(result[key][0])
        values = [[row[name] for name in names] for row in result[key]]
        record.write_csv(folder / f"element_{key}.csv", run, names, values)
    with suppress(ImportError):  # the picture comes with the extra "view"
        chart(result, folder / "element_orders.png")


def chart(result: dict[str, Any], path: Path) -> None:
    """Errors by elements and by time, and what full quadrature does to slender beams."""
    figure, (left, middle, right) = panels(PAGE, 8.5, 3, 1)
    looks = list(styles([f"order {order}" for order in (1, 2, 3, 4)]).values())
    for order, look in enumerate(looks, 1):
        chosen = [row for row in result["costs"] if row["order"] == order]
        x, y = ([row[name] for row in chosen] for name in ("seconds", "error"))
        middle.loglog(x, y, **look._asdict(), ms=4, label=f"order {order}")
    middle.set(xlabel="time in s", ylabel="error of the tip in m", title="One load step")
    for r in result["orders"]:
        if r["quantity"] == "displacement at element ends":
            nodes = r["nodes"].replace("lobatto", "Lobatto")
            label = f"order {r['order']}, {nodes} nodes: slope {r['slope']:.2f}"
            broken = {} if r["nodes"] == "lobatto" else BROKEN
            look = looks[r["order"] - 1]._asdict() | broken
            left.loglog(r["elements"], r["errors"], **look, ms=4, label=label)
    left.set(xlabel="elements", ylabel="relative error", title="45-degree bend, element ends")
    for points, broken in ((0, {}), (1, BROKEN)):
        for order, look in enumerate(looks, 1):
            chosen = [
                row
                for row in result["locking"]
                if row["order"] == order and row["points"] == order + points
            ]
            label = f"order {order}, {order + points} quadrature points"
            x, y = ([row[name] for row in chosen] for name in ("slenderness", "error"))
            right.loglog(x, y, **look._asdict() | broken, ms=4, label=label)
    right.set(xlabel="length over thickness", ylabel="relative error of the tip")
    right.set_title("Full quadrature locks: 8 elements")
    for axis in (left, middle, right):
        legend(axis)
    write_figure(figure, path)


def report(result: dict[str, Any]) -> str:
    """The slopes as text."""
    lines = []
    for r in result["orders"]:
        errors = " ".join(f"{e:.1e}" for e in r["errors"])
        expected = EXPECTED[r["quantity"]]
        lines.append(
            f"{r['nodes']:12s} p = {r['order']}  {r['quantity']:32s} {expected:4s}"
            f" {r['slope']:6.2f}   {errors}"
        )
    for r in result["costs"]:
        lines.append(
            f"order {r['order']}, {r['elements']:3d} elements, {r['unknowns']:5d} unknowns: tip"
            f" error {r['error']:.2e} m, {r['newton_iterations']} iterations, {r['seconds']:.4f} s"
        )
    for r in result["locking"]:
        lines.append(
            f"slenderness {r['slenderness']:7g}, order {r['order']}, {r['points']} points:"
            f" tip error {r['error']:.2e}"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--out", default=None)
    arguments = parser.parse_args()
    found = main(arguments.quick, arguments.out)
    print(json.dumps(found) if arguments.json else report(found))
