"""Beams inside a scikit-fem script: a cantilever on an elastic foundation, without a model.

The displacements are small. The stiffness of the beam and a form of your own (the foundation) are
added, condensed and solved by scikit-fem.

Run ``python examples/skfem_alone.py``. Without a foundation the tip is exactly where the theory of
Timoshenko has it; the foundation then holds it back.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from skfem import BilinearForm, asm, condense, solve

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "skfem_alone.png"
FORCE = 100.0  # N


def main(
    elements: int = 8, order: int = 2, foundation: float = 0.0, out: str | Path | None = None
) -> dict[str, float]:
    """Displacement of the tip (m) with a foundation (N/m^2), and by closed form without one."""
    section = sc.SectionCircle(0.01, sc.Material(E=210e9, nu=0.3, rho=7850.0))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="boom")
    beam = sc.Beam(mesh, section, order=order, director=(0, 1, 0))
    basis = beam.basis.linear()  # displacement and rotation of each node

    @BilinearForm
    def winkler(u: Any, v: Any, w: Any) -> Any:
        return foundation * (u[1] * v[1])  # component 1 is the displacement along y

    K, _ = beam.linear()
    f, tip = basis.zeros(), basis.get_dofs("boom.end").all("u_2")
    f[tip] = FORCE
    u = solve(*condense(K + asm(winkler, basis), f, D=basis.get_dofs("boom.start")))
    EI, GA = section.stiffness[3, 3], section.stiffness[0, 0]
    if out is not None:
        figure, (axes,) = sc.figures.panels(6.5, 3)
        axes.plot(beam.basis.nodes[:, 0], 1e3 * u[basis.nodal_dofs[1]], "o")
        axes.set(xlabel="x in m", ylabel="deflection in mm")
        sc.figures.write_figure(figure, out)
    return {"tip": float(u[tip][0]), "theory": FORCE / (3 * EI) + FORCE / GA}


if __name__ == "__main__":
    result = main()
    print(f"tip {result['tip']:.9f} m, Timoshenko's theory {result['theory']:.9f} m")
    print(f"with a foundation of 10 kN/m^2: {main(16, foundation=1e4, out=PICTURE)['tip']:.9f} m")
