"""Solvers of your own, of scikit-fem's verbs: a frame, frequencies, buckling, a bend, a motion.

A beam gives matrices and forces on its basis. ``asm``, ``condense`` and ``solve`` are scikit-fem's;
the loops are written here, without a model. Each is compared with the package's own analysis in
the tests.

Run ``python examples/own_loops.py``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse.linalg import eigsh
from skfem import LinearForm, asm, condense, solve

import skfem_cosserat as sc

STEEL = sc.Material(E=210e9, nu=0.3, rho=7850.0)


def frame() -> float:
    """Sway (m) of a portal of two columns and a girder under 2 kN at its corner."""
    corners = np.array([[0, 0, 0], [0, 0, 3], [4, 0, 3], [4, 0, 0]], dtype=float)
    mesh = sc.MeshCurve.init_polyline(corners, 4, name="portal", nodes={"corner": 3 / 10})
    beam = sc.Beam(mesh, sc.SectionRectangle(0.2, 0.1, STEEL), order=2, director=(0, 1, 0))
    basis = beam.basis.linear()
    K, _ = beam.linear()
    f = basis.zeros()
    f[basis.get_dofs("corner").all("u_1")] = 2e3
    feet = basis.get_dofs(["portal.start", "portal.end"])
    u = solve(*condense(K, f, D=feet))
    return float(u[basis.get_dofs("corner").all("u_1")][0])


def cantilever(elements: int = 8) -> sc.Beam:
    """A slender rod of 1 m along x, to be clamped at its start."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
    return sc.Beam(mesh, sc.SectionRectangle(0.02, 0.01, STEEL), order=2, director=(0, 1, 0))


def frequencies(count: int = 4) -> np.ndarray:
    """Lowest frequencies (Hz) of the clamped rod."""
    beam = cantilever()
    basis = beam.basis.linear()
    K, M = beam.linear()
    free = basis.complement_dofs(basis.get_dofs("rod.start"))
    squares = eigsh(K[free][:, free], count, M[free][:, free], sigma=0.0)[0]
    return np.sqrt(squares) / (2 * np.pi)


def buckling() -> float:
    """Critical axial force (N) of the clamped rod: where K - F (K - K_1) becomes singular."""
    beam = cantilever()
    basis, linear = beam.basis, beam.basis.linear()
    free = linear.complement_dofs(linear.get_dofs("rod.start"))
    K, _ = beam.linear()
    f = linear.zeros()
    f[linear.get_dofs("rod.end").all("u_1")] = -1.0
    u = solve(*condense(K, f, I=free))
    q = beam.update(beam.reference, u)
    force = asm(beam.internal_force_form(), basis, q=q)
    pressed, _ = beam.reduce(asm(beam.tangent_form(), basis, q=q), force, q)
    change = (K - pressed)[free][:, free]
    # K v = F change v: the largest 1/F of change v = 1/F K v
    return float(1 / eigsh(change, 1, K[free][:, free], which="LA")[0][0])


def bend(force: float = 600.0) -> np.ndarray:
    """Tip (3,) of the 45-degree bend (radius 100) under a force across its plane."""
    mesh = sc.MeshCurve.init_arc((0, 0, 0), (0, 1, 0), (1, 0, 0), 100.0, np.pi / 4, 8, name="bend")
    section = sc.Section([5e6, 5e6, 1e7, 1e7 / 12, 1e7 / 12, 1e7 / 12], mass=1.0, inertia=(1, 1))
    beam = sc.Beam(mesh, section, order=3, director=(0, 0, 1))
    basis = beam.basis
    q, end = beam.reference, basis.get_dofs("bend.end")
    clamp = basis.linear().get_dofs("bend.start")
    f = basis.zeros()
    for load in np.linspace(0.0, force, 13)[1:]:
        f[end.all("phi_3")] = load
        for _ in range(30):
            r = asm(beam.internal_force_form(), basis, q=q) - f
            K, r = beam.reduce(asm(beam.tangent_form(), basis, q=q), r, q)
            du = solve(*condense(K, -r, D=clamp))
            q = beam.update(q, du)
            if abs(du).max() < 1e-10:
                break
    return q[end.all(["phi_1", "phi_2", "phi_3"])]


def motion(steps: int = 50, until: float = 0.05) -> np.ndarray:
    """Tip (3,) of the rod while its own weight grows to its 80-fold, with t^3: BDF2."""
    beam = cantilever(4)
    basis, h, q = beam.basis, until / steps, beam.reference
    clamp = basis.linear().get_dofs("rod.start")
    M = asm(beam.mass_form(), basis)
    f = -80 * 9.81 * beam.sections["section"].mass * asm(LinearForm(lambda v, w: v[2]), basis)
    old, v, v_old = q, 0.0 * q, 0.0 * q
    for k in range(1, steps + 1):
        q0, v0 = q, v
        for _ in range(30):
            v = (3 * q - 4 * q0 + old) / (2 * h)
            a = (3 * v - 4 * v0 + v_old) / (2 * h)
            r = M @ a + asm(beam.internal_force_form(), basis, q=q) - (k / steps) ** 3 * f
            K = 9 / (4 * h**2) * M + asm(beam.tangent_form(), basis, q=q)
            K, r = beam.reduce(K, r, q)
            du = solve(*condense(K, -r, D=clamp))
            q = beam.update(q, du)
            if abs(du).max() < 1e-10:
                break
        v, old, v_old = (3 * q - 4 * q0 + old) / (2 * h), q0, v0
    return q[basis.get_dofs("rod.end").all(["phi_1", "phi_2", "phi_3"])]


def main() -> dict[str, Any]:
    """Results of the five solvers."""
    return {
        "sway": frame(),
        "frequencies": frequencies(),
        "critical": buckling(),
        "bend": bend(),
        "tip": motion(),
    }


if __name__ == "__main__":
    for name, value in main().items():
        print(name, np.round(value, 6))
