"""A cantilever bent far by a force across its end: statics against Euler's elastica.

The force keeps its direction. The rod is modelled without shear and extension
(``TheoryInextensible``), as Euler's elastica is, so that the closed form with elliptic integrals is
the exact answer. Errors of the tip fall with the order 2p for elements of order p.

Run ``python examples/clamped_bend.py``; look at the slopes in the right half of the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "clamped_bend.png"
LENGTH, EI = 1.0, 2.0  # m, N m^2


def elastica(force: float) -> np.ndarray:
    """Tip (x, y) in m of the elastica that is clamped along x, under a force (N) along y."""
    load = force * LENGTH**2 / EI  # dimensionless

    def lengths(slope: float) -> tuple[float, float, float]:
        m = (1 + np.sin(slope)) / 2
        start = np.arcsin(1 / np.sqrt(2 * m))
        return m, start, ellipk(m) - ellipkinc(start, m)

    slope = brentq(lambda s: lengths(s)[2] - np.sqrt(load), 1e-6, np.pi / 2 - 1e-9, xtol=1e-15)
    m, start, _ = lengths(slope)
    y = 1 - 2 / np.sqrt(load) * (ellipe(m) - ellipeinc(start, m))
    return LENGTH * np.array([np.sqrt(2 * np.sin(slope) / load), y])


def bend(elements: int, order: int, force: float) -> tuple[sc.History, sc.Beam]:
    """Equilibria under a growing force."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (LENGTH, 0, 0), elements, name="rod")
    section = sc.Section.from_constants(
        EA=1e5, GA=4e4, EI=(EI, EI), GJ=1.5, mass=0.1, inertia=(1e-6, 1e-6)
    )
    theory = sc.TheoryInextensible()
    model = sc.Model()
    rod = sc.Beam(mesh, section, order=order, director=(0, 0, 1), theory=theory)
    model.add("rod", rod)
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("force", sc.LoadForce(rod.node("rod.end"), (0, force, 0)))
    return sc.static(model, control=sc.LoadControl(steps=4), watch=False), rod


def main(
    force: float = 10.0,
    orders: Sequence[int] = (1, 2, 3),
    elements: Sequence[int] = (8, 16, 32),
    out: str | Path | None = None,
) -> dict[str, Any]:
    """Errors (m) of the tip by order and mesh, the observed orders, and the tip itself (m)."""
    exact = elastica(force)
    errors, tip = {}, exact
    for order in orders:
        for count in elements:
            path, rod = bend(count, order, force)
            tip = path.position(rod.node("rod.end"))[-1, :2]
            errors[order, count] = float(np.linalg.norm(tip - exact))
    if out is not None:
        draw(path, rod, errors, out)
    last, finest = elements[-2:]
    return {
        "exact": exact,
        "tip": tip,
        "errors": errors,
        "observed": {
            p: float(np.log(errors[p, last] / errors[p, finest]) / np.log(finest / last))
            for p in orders
        },
    }


def draw(path: sc.History, rod: sc.Beam, errors: dict[Any, float], file: str | Path) -> None:
    """The rod under a quarter, half, ... of the force, and the errors of its tip."""
    figure, (left, right) = sc.figures.panels(9, 3.5, 1, 2)
    line = path.position(rod, np.linspace(0, LENGTH, 50))
    for k, factor in enumerate(path["load_factor"]):
        left.plot(*line[k, :, :2].T, label=f"{factor:.2f}")
    left.set(xlabel="x in m", ylabel="y in m", aspect="equal")
    sc.figures.legend(left, "load factor")
    orders = {f"order {p}": p for p in sorted({p for p, _ in errors})}
    for name, style in sc.figures.styles(list(orders)).items():
        order = orders[name]
        counts = [n for p, n in errors if p == order]
        own = [errors[order, n] for n in counts]
        right.loglog(counts, own, **style._asdict(), ms=4, label=name)
    right.set(xlabel="elements", ylabel="error of the tip in m")
    right.set_xticks(counts, counts)
    right.minorticks_off()
    sc.figures.legend(right)
    sc.figures.write_figure(figure, file)


if __name__ == "__main__":
    result = main(out=PICTURE)
    print("tip of the elastica:", result["exact"].round(6), "m; computed:", result["tip"].round(6))
    for (order, count), error in result["errors"].items():
        print(f"order {order}, {count:2d} elements: error {error:.1e} m")
    for order, slope in result["observed"].items():
        print(f"elements of order {order} converge with the order {slope:.2f}")
    print(f"picture: {PICTURE}")
