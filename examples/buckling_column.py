"""A column under a growing weight: its critical load, the branch beyond it, and how it vibrates.

The column is clamped at its foot and free at its top. ``sc.static`` follows the straight path and
locates the bifurcation on it, ``sc.branch`` and ``sc.ArcLength`` lead on to bent states. The square
of the first frequency falls to zero at the critical load and grows again along the branch: the
straight column is stable below the load, the bent one above it.

Run ``python examples/buckling_column.py``; look at the right half of the picture.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "buckling_column.png"
LENGTH, EA, GA, EI = 1.0, 1e5, 4e4, (20.0, 25.0)  # m, N, N, N m^2


def critical_load() -> float:
    """Smallest P > 0 (N) with ``P (1 - P/EA + P/GA) = pi^2 EI/(4 L^2)``: with all strains."""
    euler = np.pi**2 * min(EI) / (4 * LENGTH**2)
    c = 1 / GA - 1 / EA
    return float(2 * euler / (1 + np.sqrt(1 + 4 * c * euler)))


def main(
    elements: int = 4, order: int = 4, until: float = 60.0, out: str | Path | None = None
) -> dict[str, Any]:
    """Follow both paths: critical load (N), tip (m), slope of the tip (rad), squares of omega."""
    section = sc.Section.from_constants(
        EA=EA, GA=GA, EI=EI, GJ=15.0, mass=1.0, inertia=(1e-4, 1e-4)
    )
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 0, LENGTH), elements, name="column")
    model = sc.Model()
    column = model.add("column", sc.Beam(mesh, section, order=order, director=(1, 0, 0)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), column.node("column.start")))
    top = column.node("column.end")
    model.add("weight", sc.LoadForce(top, (0, 0, -1.0)))  # times the load factor

    straight = sc.static(model, control=sc.LoadControl(until=until, steps=12))
    bent = sc.static(
        model, control=sc.ArcLength(until=until, longest=0.1), start=sc.branch(model, straight)
    )
    squares = {
        name: np.array([sc.modes(model, (path, k), count=1).squares[0] for k in range(len(path))])
        for name, path in (("straight", straight), ("bent", bent))
    }
    side = np.linalg.norm(bent.position(top)[:, :2], axis=1)
    d3 = bent.rotation(top)[:, 2]
    result = {
        "critical": straight.meta["critical"][0]["load_factor"],
        "theory": critical_load(),
        "straight_load": straight["load_factor"],
        "bent_load": bent["load_factor"],
        "side": side,
        "slope": np.arccos(d3[:, 2]),
        "squares": squares,
    }
    if out is not None:
        draw(result, out)
    return result


def draw(result: dict[str, Any], path: str | Path) -> None:
    """Load against the tip's displacement, and square of the first frequency against the load."""
    figure, (left, right) = sc.figures.panels(8.5, 3.8, 1, 2)
    loads, bent = result["straight_load"], result["bent_load"]
    left.plot(0 * loads, loads, ".-", label="straight")
    left.plot(result["side"], bent, ".-", label="bent")
    left.axhline(result["theory"], color="0.6", lw=0.8, zorder=1, label="closed form")
    left.set(xlabel="top sideways in m", ylabel="weight in N")
    right.plot(loads, result["squares"]["straight"], ".-", label="straight")
    right.plot(bent, result["squares"]["bent"], ".-", label="bent")
    right.axhline(0, color="black", lw=0.8, zorder=1)
    right.set(xlabel="weight in N", ylabel="first omega squared in (rad/s)²")
    sc.figures.legend(figure)
    sc.figures.write_figure(figure, path)


if __name__ == "__main__":
    result = main(out=PICTURE)
    print(f"critical load: {result['critical']:.6f} N, closed form {result['theory']:.6f} N")
    print(f"at {result['bent_load'][-1]:g} N the top has moved sideways {result['side'][-1]:.4f} m")
    for name in ("straight", "bent"):
        square = result["squares"][name][-1]
        print(f"{name} there: omega squared {square:.2f}, {'un' * bool(square < 0)}stable")
    print(f"picture: {PICTURE}")
