"""Beams inside a scikit-fem script: a cantilever on an elastic foundation, without a model.

The displacements are small. The tangent of the director beam and a form of your own (the
foundation) are assembled, condensed and solved by scikit-fem.

Run ``python examples/skfem_alone.py``. Without a foundation the tip is exactly where the theory of
Timoshenko has it; the foundation then holds it back.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import block_diag, csr_matrix
from skfem import BilinearForm, asm, condense, solve

import skfem_cosserat as sc
from skfem_cosserat.kernels import null_space_blocks

PICTURE = Path(__file__).with_name("pictures") / "skfem_alone.png"
FORCE = 100.0  # N


def main(
    elements: int = 8, order: int = 2, foundation: float = 0.0, out: str | Path | None = None
) -> dict[str, float]:
    """Displacement of the tip (m) with a foundation (N/m^2), and by closed form without one."""
    section = sc.SectionCircle(0.01, sc.Material(E=210e9, nu=0.3, rho=7850.0))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="boom")
    beam = sc.Beam(mesh, section, order=order, director=(0, 1, 0))
    basis = beam.basis

    @BilinearForm
    def winkler(u: Any, v: Any, w: Any) -> Any:
        return foundation * (u[1] * v[1])  # u holds twelve components; 1 is the placement's y

    K = asm(beam.tangent_form(), basis, q=beam.reference) + asm(winkler, basis)
    tip, root = (basis.node(name) for name in ("boom.end", "boom.start"))
    f = np.zeros(basis.N)
    f[12 * tip + 1] = FORCE
    # The directors of a node turn together: qdot = P (phidot, omega), 6 unknowns for each node.
    P = block_diag([csr_matrix(block) for block in null_space_blocks(beam.triads)], format="csr")
    clamp = 6 * root + np.arange(6)
    u = P @ solve(*condense(P.T @ K @ P, P.T @ f, D=clamp))
    EI, GA = section.stiffness[3, 3], section.stiffness[0, 0]
    if out is not None:
        figure, (axes,) = sc.figures.panels(6.5, 3)
        axes.plot(basis.nodes[:, 0], 1e3 * u[1::12], "o")
        axes.set(xlabel="x in m", ylabel="deflection in mm")
        sc.figures.write_figure(figure, out)
    return {"tip": float(u[12 * tip + 1]), "theory": FORCE / (3 * EI) + FORCE / GA}


if __name__ == "__main__":
    result = main()
    print(f"tip {result['tip']:.9f} m, Timoshenko's theory {result['theory']:.9f} m")
    print(f"with a foundation of 10 kN/m^2: {main(16, foundation=1e4, out=PICTURE)['tip']:.9f} m")
