"""What beams come to as they grow stiff: each theory is the limit of the one before it.

A quarter of a circle on a hinge, held by a spring at its end and pushed there out of its plane. Of
a beam with shear, of one without and of one without extension either, the stiffness of what the
next theory holds grows, up to the rigid beam; the error against that theory falls with its inverse,
in equilibrium and in motion. Then why strains are held at the p Gauss points of an element of order
p: with one point more the inf-sup constant of what is held falls with the size of elements, they
lock; with one point fewer there are motions that strain nothing.

Needs matplotlib for the picture.
"""

from __future__ import annotations

import argparse
import sys
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent))

from record import Record

import skfem_cosserat as sc
from skfem_cosserat.basis import DirectorBasis
from skfem_cosserat.figures import PAGE, legend, panels, styles, write_figure

Floats = NDArray[np.float64]
RADIUS, FORCE, SPRING = 1.0, (-0.4, 0.2, 0.3), 2.0
#: (s): the force grows and fades within, the motion is followed as long
UNTIL, STEP = 1.0, 0.02
#: theories from the full beam on; each with strains that it holds and the one before it does not
LADDER: tuple[tuple[str, sc.Theory | None, tuple[int, ...]], ...] = (
    ("full", None, ()),
    ("unshearable", sc.TheoryKirchhoff(), (0, 1)),
    ("inextensible", sc.TheoryInextensible(), (2,)),
    ("rigid", sc.TheoryRigid(), (3, 4, 5)),
)
#: stiffness of shear and of extension against ``EI/R^2``, where it does not grow
SOFT = 20.0
RATIOS = tuple(10.0 ** np.arange(1.5, 5.1, 0.5))
MESHES = (2, 4, 8, 16, 32)


def model(theory: sc.Theory | None, stiff: tuple[int, ...], ratio: float) -> sc.Model:
    """The scene; strains of the numbers `stiff` have `ratio` times the stiffness of bending."""
    stiffness = np.array([SOFT, SOFT, SOFT, 1.0, 1.2, 0.8])
    stiffness[list(stiff)] = ratio * (stiffness[list(stiff)] if min(stiff) > 2 else 1.0)
    section = sc.Section(stiffness, mass=1.0, inertia=(1e-3, 2e-3))
    ends = (RADIUS, 0, 0), (0, 1, 0), (-1, 0, 0)
    mesh = sc.MeshCurve.init_arc(*ends, RADIUS, np.pi / 2, 3, "rod")
    scene = sc.Model()
    rod = scene.add("rod", sc.Beam(mesh, section, order=2, director=(0, 0, 1), theory=theory))
    end = rod.node("rod.end")
    hinge = sc.JointRevolute(sc.ground((RADIUS, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    scene.add("hinge", hinge)
    scene.add("spring", sc.SpringDamper(sc.ground((0, 2 * RADIUS, 0)), end, SPRING))
    scene.add("force", sc.LoadForce(end, FORCE, sc.FunctionOfTime(swelling)))
    return scene


def swelling(time: float) -> float:
    """From 0 to 1 and back, smooth three times; one for equilibria, which are at t = 0.5 s."""
    return float(np.sin(np.pi * time / UNTIL) ** 4)


def at_rest(scene: sc.Model) -> Floats:
    """Where the end is in equilibrium with the whole force (1, 3)."""
    control = sc.LoadControl(until=UNTIL / 2, steps=2)
    return _ends(scene, sc.static(scene, control=control, watch=False, derive=False))[-1:]


def in_motion(scene: sc.Model) -> Floats:
    """Where the end is over time (N, 3)."""
    scheme = sc.EnergyMomentum(), sc.NullSpace()
    run = sc.simulate(scene.freeze(), *scheme, STEP, UNTIL, kernels="numpy", derive=False)
    return _ends(scene, run)


def _ends(scene: sc.Model, history: sc.History) -> Floats:
    beam = scene["rod"]
    assert isinstance(beam, sc.Beam)
    return history.position(beam.node("rod.end"))


def limits(ratios: tuple[float, ...]) -> list[dict[str, Any]]:
    """Rows (scene, theory, next, ratios, errors, slope): errors against the extent."""
    rows = []
    for name, follow in (("equilibrium", at_rest), ("motion", in_motion)):
        for (before, theory, _), (after, held, stiff) in pairwise(LADDER):
            wanted = follow(model(held, stiff, 1.0))
            errors = [
                float(np.linalg.norm(follow(model(theory, stiff, r)) - wanted, axis=1).max())
                for r in ratios
            ]
            slope = np.log(errors[-2] / errors[-1]) / np.log(ratios[-2] / ratios[-1])
            rows.append(
                {
                    "scene": name,
                    "theory": before,
                    "next": after,
                    "ratios": list(ratios),
                    "errors": [e / RADIUS for e in errors],
                    "slope": float(slope),
                }
            )
    return rows


# -- Gauss points ----------------------------------------------------------------------------------


class Strained:
    """Linear strains of a straight rod of length 1 along e3 at Gauss points, weighted as in L2.

    ``Gamma = phi' + e3 x omega``, ``K = omega'``: what the rows that hold strains are where the rod
    is straight. (:class:`skfem_cosserat.InterpolationLobatto` takes p points and more.)

    Parameters
    ----------
    order, points, elements : int

    Attributes
    ----------
    B : (elements * points, 6, 6 * nodes) array
        By ``(phi, omega)`` of all nodes.
    norm : (6 * nodes, 6 * nodes) array
        Square of the norm in H1.
    """

    def __init__(self, order: int, points: int, elements: int) -> None:
        mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 0, 1), elements)
        basis = DirectorBasis(mesh, order)
        at, weights = np.polynomial.legendre.leggauss(points)
        count, length = len(basis.nodes), 1 / elements
        shape, slope = basis.shape(0.5 + 0.5 * at), basis.dshape(0.5 + 0.5 * at) / length
        turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])  # e3 x
        B = np.zeros((elements, points, 6, count, 6))
        for own, part in zip(basis.connectivity, B, strict=True):
            for k, node in enumerate(own):
                for g in range(points):
                    part[g, :3, node, :3] += slope[k, g] * np.eye(3)
                    part[g, :3, node, 3:] += shape[k, g] * turned
                    part[g, 3:, node, 3:] += slope[k, g] * np.eye(3)
        B *= np.sqrt(0.5 * length * weights)[:, None, None, None]
        self.B = B.reshape(elements * points, 6, 6 * count)
        self.norm = np.kron(_of_functions(basis, length), np.eye(6))

    def inf_sup(self, held: tuple[int, ...] = (0, 1)) -> float:
        """Of strains that are held, clamped at the start: least force that motions feel, in H1."""
        B = self.B[:, list(held)].reshape(-1, self.B.shape[-1])[:, 6:]
        S = B @ np.linalg.solve(self.norm[6:, 6:], B.T)
        return float(np.sqrt(max(np.linalg.eigvalsh(S)[0], 0.0)))

    def loose(self) -> int:
        """Motions that strain nothing, beside the six rigid ones."""
        B = self.B.reshape(-1, self.B.shape[-1])
        return int(B.shape[1] - np.linalg.matrix_rank(B)) - 6


def _of_functions(basis: DirectorBasis, length: float) -> Floats:
    """``int f'^2 + f^2 ds`` of functions by their nodal values (nodes, nodes)."""
    at, weights = np.polynomial.legendre.leggauss(basis.interpolation.order + 1)
    shape, slope = basis.shape(0.5 + 0.5 * at), basis.dshape(0.5 + 0.5 * at) / length
    own = 0.5 * length * ((slope * weights) @ slope.T + (shape * weights) @ shape.T)
    out = np.zeros((len(basis.nodes),) * 2)
    for nodes in basis.connectivity:
        out[np.ix_(nodes, nodes)] += own
    return out


def gauss_points(meshes: tuple[int, ...]) -> list[dict[str, Any]]:
    """Rows (order, points, elements, inf_sup, loose) for p - 1, p and p + 1 points."""
    rows = []
    for order in (1, 2, 3, 4):
        for points in range(max(order - 1, 1), order + 2):
            found = [Strained(order, points, count) for count in meshes]
            rows.append(
                {
                    "order": order,
                    "points": points,
                    "elements": list(meshes),
                    "inf_sup": [each.inf_sup() for each in found],
                    "loose": [each.loose() for each in found],
                }
            )
    return rows


def main(quick: bool = False, out: str | Path | None = None) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    quick : bool
        Fewer stiffnesses and meshes.
    out : path, optional
        Folder for ``theory_limits.csv``, ``theory_limits.points.csv`` and a picture
        ``theory_limits.png``.

    Returns
    -------
    dict
        ``limits``: rows of :func:`limits`; ``points``: of :func:`gauss_points`.
    """
    record = Record()
    with record.run("limits of theories") as run:
        result = {
            "limits": limits(RATIOS[3::2] if quick else RATIOS),
            "points": gauss_points(MESHES[1:4] if quick else MESHES),
        }
    if out is not None:
        _write(result, record, run, Path(out))
    return result


def _write(result: dict[str, Any], record: Any, run: int, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    header = ["scene", "theory", "next_theory", "stiffness_ratio", "error", "slope"]
    rows = [
        [r["scene"], r["theory"], r["next"], ratio, error, r["slope"]]
        for r in result["limits"]
        for ratio, error in zip(r["ratios"], r["errors"], strict=True)
    ]
    record.write_csv(folder / "theory_limits.csv", run, header, rows)
    header = ["order", "points", "elements", "inf_sup", "motions_without_strain"]
    rows = [
        [r["order"], r["points"], *numbers]
        for r in result["points"]
        for numbers in zip(r["elements"], r["inf_sup"], r["loose"], strict=True)
    ]
    record.write_csv(folder / "theory_limits.points.csv", run, header, rows)
    with suppress(ImportError):  # the picture comes with the extra "view"
        chart(result, folder / "theory_limits.png")


def chart(result: dict[str, Any], path: Path) -> None:
    """Errors against the next theory in equilibrium and in motion, and inf-sup constants."""
    figure, axes = panels(PAGE, 8.5, 3, 1)
    for axis, scene in zip(axes, ("equilibrium", "motion"), strict=False):
        own = [r for r in result["limits"] if r["scene"] == scene]
        _draw_limits(axis, own)
        axis.set(title=f"Errors against the next theory, in {scene}")
    _draw_points(axes[2], result["points"])
    for axis in axes:
        legend(axis)
    write_figure(figure, path)


def _draw_limits(axis: Any, rows: list[dict[str, Any]]) -> None:
    looks = styles([r["theory"] for r in rows])
    for r in rows:
        label = f"{r['theory']} to {r['next']}: slope {r['slope']:.3f}"
        axis.loglog(r["ratios"], r["errors"], **looks[r["theory"]]._asdict(), label=label, ms=4)
    ratios = np.array(rows[0]["ratios"])
    start = 3 * max(r["errors"][0] for r in rows)
    axis.loglog(ratios, start * ratios[0] / ratios, "k--", label="slope -1", linewidth=1, zorder=1)
    axis.set(xlabel="stiffness that the next theory makes rigid, as a multiple")
    axis.set_ylabel("error / radius")


def _draw_points(axis: Any, rows: list[dict[str, Any]]) -> None:
    for order, look in enumerate(styles([f"order {k}" for k in (1, 2, 3, 4)]).values(), 1):
        for more, style in ((0, {}), (1, {"linestyle": "--", "mfc": "none"})):
            (r,) = (r for r in rows if (r["order"], r["points"]) == (order, order + more))
            label = f"order {order}, strains held at {order + more}"
            axis.loglog(r["elements"], r["inf_sup"], **look._asdict() | style, label=label, ms=4)
    elements = np.array(rows[0]["elements"])
    axis.set_ylim(bottom=1e-4)
    axis.loglog(elements, 0.4 / elements, "k--", label="slope -1", linewidth=1, zorder=1)
    axis.set(xlabel="elements", ylabel="inf-sup constant")
    axis.set_title("Strains held at one place more in each element: it locks")
    axis.set_xticks(elements, [str(n) for n in elements], minor=False)
    axis.minorticks_off()


def report(result: dict[str, Any]) -> str:
    """Slopes, inf-sup constants and motions that strain nothing as text."""
    lines = []
    for r in result["limits"]:
        errors = " ".join(f"{e:.2e}" for e in r["errors"])
        pair = f"{r['theory']} to {r['next']}"
        lines.append(f"{r['scene']:12s} {pair:28s} slope {r['slope']:7.4f}   {errors}")
    for r in result["points"]:
        constants = " ".join(f"{c:.5f}" for c in r["inf_sup"])
        lines.append(
            f"order {r['order']}, {r['points']} points, {r['elements']} elements: inf-sup constant"
            f" {constants}; {r['loose']} motions without strain"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", default=None)
    arguments = parser.parse_args()
    print(report(main(arguments.quick, arguments.out)))
