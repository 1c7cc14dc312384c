"""Frequencies that limit steps: the highest of the elastic vibrations, that of the constraints."""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag, eigh
from scipy.sparse import identity, kron
from scipy.sparse.linalg import splu

from ..errors import InputError
from ..linear import SingularMatrixError
from ..model import System
from ..types import ArrayLike, Floats
from .stacks import as_stack
from .tangent import material_stiffness, null_space_matrix

__all__ = ["constraint_frequency", "highest_frequency"]


def highest_frequency(system: System, q: ArrayLike | None = None, iterations: int = 50) -> float:
    """Highest natural frequency of the elastic vibrations about a configuration.

    Largest eigenvalue of ``P^T K P`` against ``P^T M P``, with the material stiffness
    ``K = int B^T D B ds`` of the beams: stresses change the highest frequencies little.

    Parameters
    ----------
    system : System
        Springs and bushings are left out.
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
        If the shape of `q` does not fit the system or `iterations` is not a positive integer.
    SingularMatrixError
        If a motion has no inertia.

    Examples
    --------
    Axial waves in steel: ``2 sqrt(3)/l sqrt(E/rho)`` for elements of length l and, here, the
    highest of all:

    >>> from skfem_cosserat import Beam, Material, MeshCurve, Model, SectionRectangle
    >>> steel = Material(210e9, 0.3, 7850.0)
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 10)
    >>> model = Model()
    >>> bar = model.add("bar", Beam(mesh, SectionRectangle(0.5, 0.5, steel), director=(0, 1, 0)))
    >>> omega = highest_frequency(model.freeze())
    >>> bool(0.95 < omega / (2 * 3**0.5 / 0.1 * (210e9 / 7850) ** 0.5) <= 1)
    True
    """
    whole = isinstance(iterations, int | np.integer) and not isinstance(iterations, bool)
    if not whole or iterations < 1:
        raise InputError("argument iterations", f"{iterations!r}, expected a positive integer")
    where = as_stack(system, "q", system.q0 if q is None else q)[0][0]
    if not system.beam_groups or not system.unknowns:
        return 0.0
    y = system.extend(where, 0.0)
    P = null_space_matrix(system, y)
    K = (P.T @ material_stiffness(system, y) @ P).tocsr()
    M = (P.T @ kron(system.mass, identity(3)) @ P).tocsc()
    try:
        solve = splu(M).solve
    except RuntimeError as error:  # SuperLU: exactly singular
        raise SingularMatrixError("P^T M P is singular: a motion has no inertia") from error
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


def constraint_frequency(system: System, q: Floats, constraint_force: Floats) -> float:
    """The omega_c (rad/s) whose product with the step must stay below 2 (variational scheme).

    Rotations of nodes that alternate from step to step have no stress at midpoints, where that
    scheme looks. Inertia holds them, the constraint force of compressed beams drives them: above
    the limit they grow.

    Largest eigenvalue of ``K_c`` against M over the rotations of all frames, where
    ``theta.K_c theta = sum (f_i.theta)(d_i.theta) - |theta|^2 f_i.d_i`` is the second variation of
    the work that the constraint force -f does on the directors (compressed beams: positive).

    Parameters
    ----------
    system : System
    q, constraint_force : (n,) array
        At a node, the force as in :class:`skfem_cosserat.StepReport` (or in the history).

    Returns
    -------
    float
        Zero where nothing drives them.

    Examples
    --------
    A bar under tension; at its start, where nothing has been solved yet, there is no force:

    >>> from skfem_cosserat import Beam, Material, MeshCurve, Model, SectionRectangle
    >>> steel = Material(210e9, 0.3, 7850.0)
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2)
    >>> model = Model()
    >>> bar = model.add("bar", Beam(mesh, SectionRectangle(0.1, 0.1, steel), director=(0, 1, 0)))
    >>> system = model.freeze()
    >>> constraint_frequency(system, system.q0, np.zeros(system.n))
    0.0
    """
    rows = system.kinematics.director_rows
    d, f = q.reshape(-1, 3)[rows], -constraint_force.reshape(-1, 3)[rows]
    A = np.einsum("nia,nib->nab", f, d)
    blocks = (A + A.transpose(0, 2, 1)) / 2 - np.trace(A, 0, 1, 2)[:, None, None] * np.eye(3)
    # (omega x d).(eta x e) = (omega.eta)(d.e) - (omega.e)(eta.d)
    m = system.mass.toarray()[rows[:, :, None, None], rows]
    M = np.einsum("kilj,kic,ljc,ab->kalb", m, d, d, np.eye(3), optimize=True)
    M -= np.einsum("kilj,lja,kib->kalb", m, d, d, optimize=True)
    M = M.reshape(3 * len(rows), -1)
    top = len(M) - 1
    value = eigh(block_diag(*blocks), M, eigvals_only=True, subset_by_index=[top, top])
    return float(np.sqrt(max(value[0], 0.0)))
