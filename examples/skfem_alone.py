"""The scikit-fem side alone: a cantilever on an elastic foundation, without the multibody layer.

Small displacements of a straight cantilever with a tip force: the tangent of the director beam and
a form of the user's own, assembled, condensed and solved by scikit-fem.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import block_diag
from skfem import BilinearForm, asm, condense, solve

import skfem_cosserat as sc
from skfem_cosserat.kernels import null_space_blocks


def main(
    elements: int = 8, order: int = 2, foundation: float = 0.0, out: Any = None
) -> dict[str, float]:
    """Tip displacement (m) with foundation stiffness (N/m^2), and that of beam theory without."""
    section = sc.SectionCircle(0.01, sc.Material(E=210e9, nu=0.3, rho=7850.0))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="boom")
    beam = sc.Beam(mesh, section, order=order, director=(0, 1, 0))
    basis = beam.basis

    @BilinearForm
    def winkler(u: Any, v: Any, w: Any) -> Any:
        return foundation * (u[1] * v[1])  # component 1 of the twelve is phi_y

    K = asm(beam.tangent_form(), basis, q=beam.reference) + asm(winkler, basis)
    tip, root = (basis.node(name) for name in ("boom.end", "boom.start"))
    f = np.zeros(basis.N)
    f[12 * tip + 1] = 100.0
    # directors turn with their node: qdot = P (phidot, omega), 6 unknowns a node
    P = block_diag(list(null_space_blocks(beam.triads)), format="csr")
    clamp = 6 * root + np.arange(6)
    u = P @ solve(*condense(P.T @ K @ P, P.T @ f, D=clamp))
    EI, GA = section.stiffness[3, 3], section.stiffness[0, 0]
    return {"tip": float(u[12 * tip + 1]), "theory": 100.0 / (3 * EI) + 100.0 / GA}


if __name__ == "__main__":
    print(main())
