"""Highest natural frequency of a scene, by power iteration."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, kron
from scipy.sparse.linalg import splu

from ..errors import InputError
from ..kernels import null_space_blocks
from ..model import System
from ..model.chart import Chart
from ..types import ArrayLike, Floats
from .stacks import as_stack

__all__ = ["highest_frequency"]


def highest_frequency(system: System, q: ArrayLike | None = None, iterations: int = 50) -> float:
    """Highest natural frequency of the elastic vibrations about a configuration.

    Largest eigenvalue of ``P^T K P`` against ``P^T M P``, with the material stiffness
    ``K = int B^T D B ds`` of the beams: stresses change the highest frequencies little.

    Parameters
    ----------
    system : System
        Joints that close a loop are left open, which can only raise the frequency.
    q : (n,) array, optional
        Configuration; default: the reference.
    iterations : int
        Power iterations. The frequency comes out too low, never too high: by some percent after
        50, as the highest frequencies of a mesh lie close together.

    Returns
    -------
    float
        Angular frequency (rad/s), zero without beams.

    Raises
    ------
    InputError
        If the shape of `q` does not fit the system, `iterations` is not positive, or a coordinate
        has inertia only through a joint that closes a loop.

    Examples
    --------
    Axial waves in steel: ``2 sqrt(3)/l sqrt(E/rho)`` for elements of length l and, here, the
    highest of all:

    >>> from skfem_cosserat import Beam, Material, MeshCurve, Model, SectionRectangle
    >>> steel = Material(210e9, 0.3, 7850.0)
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 10)
    >>> model = Model()
    >>> bar = model.add("bar", Beam(mesh, SectionRectangle(0.5, 0.5, steel), (0, 1, 0)))
    >>> omega = highest_frequency(model.freeze())
    >>> bool(0.95 < omega / (2 * 3**0.5 / 0.1 * (210e9 / 7850) ** 0.5) <= 1)
    True
    """
    if isinstance(iterations, bool) or not isinstance(iterations, int | np.integer):
        raise InputError("argument iterations", f"{iterations!r}, expected a positive integer")
    if iterations < 1:
        raise InputError("argument iterations", f"{iterations!r}, expected a positive integer")
    where = as_stack(system, "q", system.q0 if q is None else q)[0][0]
    if not system.beam_groups:
        return 0.0
    P = _null_space(system, where)
    K = (P.T @ _stiffness(system, where) @ P).tocsr()
    M = (P.T @ kron(system.mass, np.eye(3)) @ P).tocsc()
    try:
        solve = splu(M).solve
    except RuntimeError as error:  # SuperLU: exactly singular
        raise InputError(
            "system", "a coordinate has no inertia of its own while loops are open"
        ) from error
    x = np.random.default_rng(0).standard_normal(M.shape[0])
    square = 0.0
    for _ in range(int(iterations)):
        x /= np.sqrt(x @ (M @ x))
        force = K @ x
        square = float(x @ force)
        x = solve(force)
        if not x.any():
            break
    return float(np.sqrt(max(square, 0.0)))


def _null_space(system: System, q: Floats) -> csr_matrix:
    """``P(q) = P_int T`` (n, unknowns of the tree)."""
    kin = system.kinematics
    y = system.extend(q, 0.0)
    chart = Chart(kin)
    chart.begin(y, y[system.rows :])
    T = kin.T_matrix(kin.T_values(kin.locate(y, chart.fixed)))
    blocks = null_space_blocks(kin.directors(y))
    frames = (3 * kin.frame_rows[:, None] + np.arange(12))[:, :, None]
    points = 3 * kin.row[kin.points][:, None] + np.arange(3)
    rows = np.broadcast_to(frames, blocks.shape).ravel()
    cols = np.broadcast_to(kin.frame_twist[:, None, :], blocks.shape).ravel()
    P_int = coo_matrix(
        (
            np.concatenate([blocks.ravel(), np.ones(points.size)]),
            (
                np.concatenate([rows, points.ravel()]),
                np.concatenate([cols, kin.point_twist.ravel()]),
            ),
        ),
        shape=(system.n, kin.n_twist),
    )
    return (P_int.tocsr() @ T).tocsr()


def _stiffness(system: System, q: Floats) -> csr_matrix:
    """Material stiffness (n, n) of all beams."""
    y = system.extend(q, 0.0)
    rows, cols, values = [], [], []
    for group, (eps, B) in zip(system.beam_groups, system.strain(y), strict=True):
        block = group.tangent(B, B, np.zeros_like(eps), 1.0, 0.0)
        dofs = group.dofs
        rows.append(np.broadcast_to(dofs[:, :, None], block.shape).ravel())
        cols.append(np.broadcast_to(dofs[:, None, :], block.shape).ravel())
        values.append(block.ravel())
    ij = (np.concatenate(rows), np.concatenate(cols))
    return coo_matrix((np.concatenate(values), ij), shape=(system.n, system.n)).tocsr()
