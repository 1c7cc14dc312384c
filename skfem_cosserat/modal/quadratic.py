"""Eigenvalues nearest to zero of ``(s^2 M + s C + K) x = 0``: gyroscopic, damped, circulatory."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eig
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackError, LinearOperator, eigs, splu

from ..errors import CosseratError
from ..types import Array
from .pencil import Pencil
from .symmetric import SPARE, TOLERANCE, lowest

__all__ = ["DENSE", "Spectrum", "spectrum"]

#: unknowns up to which all eigenvalues are computed, dense
DENSE = 150
#: relative change of an eigenvalue by its Rayleigh quotient up to which that is followed
STEADY = 1e-4
#: eigenvalues relative to the lowest elastic frequency that may be halves of a double zero
SLOW = 1e-2
#: modal mass ``x^T M x`` below which an eigenvector says little about its eigenvalue
WEAK = 0.1


class Spectrum:
    """Eigenvalues, one of each conjugate pair.

    Attributes
    ----------
    values : (k,) complex array
        s (1/s), ascending in modulus, imaginary part not negative.
    vectors : (u, k) complex array
        ``x^H M x = 1``.
    zero : (k,) bool array
        Motions without stiffness.
    factorisations : int
    """

    def __init__(self, values: Array, vectors: Array, zero: Array, factorisations: int) -> None:
        self.values, self.vectors, self.zero = values, vectors, zero
        self.factorisations = factorisations


def spectrum(pencil: Pencil, count: int, dense: int = DENSE) -> Spectrum:
    """The `count` eigenvalues of smallest modulus, motions without stiffness first.

    A linear pencil of twice the size is solved about a real shift, of the size of the lowest
    frequency: dense, or by Arnoldi's method. Where theory gives a Rayleigh quotient it follows.
    """
    K, M, C = pencil.K, pencil.M, pencil.C
    half = 0.5 * (K + K.T)
    still = lowest(half.tocsr(), M, min(K.shape[0], count + SPARE), pencil.energies)
    free = still.vectors[:, still.zero] if pencil.conservative else still.vectors[:, :0]
    elastic = abs(still.values[~still.zero])
    scale = float(np.sqrt(elastic.min())) if len(elastic) and elastic.min() else 1.0
    n = K.shape[0]
    wanted = 2 * (count + free.shape[1] + SPARE)
    if n <= dense or wanted > n // 2:
        values, X = _dense(K, M, C)
    else:
        values, X = _arnoldi(K, M, C, 0.5 * scale, wanted)
    keep = np.flatnonzero(np.isfinite(values) & (values.imag >= 0))  # one of each pair
    keep = keep[np.argsort(abs(values[keep]), kind="stable")][:wanted]
    values, X = values[keep], X[:, keep]
    X = X / np.sqrt(np.einsum("ik,ik->k", X.conj(), M @ X).real)
    values = _improved(pencil, C, values, X, scale)
    order = np.argsort(abs(values), kind="stable")
    order = order[values[order] != 0]  # those without stiffness are known already
    values = np.concatenate([np.zeros(free.shape[1]), values[order]])[:count]
    X = np.concatenate([free, X[:, order]], axis=1)[:, :count]
    zero = np.arange(len(values)) < free.shape[1]
    return Spectrum(values, X, zero, still.factorisations + 1)


def _dense(K: csr_matrix, M: csr_matrix, C: csr_matrix) -> tuple[Array, Array]:
    n = K.shape[0]
    scale = 1 / np.sqrt(M.diagonal())
    k, m, c = (scale[:, None] * A.toarray() * scale for A in (K, M, C))
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-k, -c]])
    B = np.block([[np.eye(n), np.zeros((n, n))], [np.zeros((n, n)), m]])
    values, Z = eig(A, B)
    return values, scale[:, None] * Z[:n]


def _arnoldi(
    K: csr_matrix, M: csr_matrix, C: csr_matrix, shift: float, k: int
) -> tuple[Array, Array]:
    """Eigenvalues nearest to a real shift: ``(A - shift B)^-1 B`` on ``z = (x, s x)``."""
    n = K.shape[0]
    try:
        solve = splu((K + shift * C + shift**2 * M).tocsc()).solve
    except RuntimeError as error:  # SuperLU: exactly singular
        raise CosseratError(f"the eigenvalue problem is singular at the shift {shift:g}") from error
    right = C + shift * M

    def apply(z: Array) -> Array:
        a, b = z[:n], z[n:] * shift
        x = -solve(right @ a + M @ b)
        return np.concatenate([x, (a + shift * x) / shift])

    inverse = LinearOperator((2 * n, 2 * n), matvec=apply, dtype=float)
    start = np.random.default_rng(0).standard_normal(2 * n)
    basis = min(2 * n, max(2 * k + 10, 40))
    try:
        theta, Z = eigs(inverse, k, which="LM", v0=start, ncv=basis, tol=TOLERANCE, maxiter=300)
    except ArpackError as error:
        raise CosseratError(
            f"the Arnoldi iteration for {k} eigenvalues did not converge"
        ) from error
    return shift + 1 / theta, Z[:n]


def _improved(pencil: Pencil, C: csr_matrix, values: Array, X: Array, scale: float) -> Array:
    """Roots of ``m s^2 + c s + k = 0`` with the forms m, c, k of each vector.

    ``Q(s)`` is Hermitian for imaginary s without damping, and symmetric for any s without
    gyroscopic terms: there errors of the vectors enter squared. Elsewhere values stay, but for
    motions without stiffness: zero or ``-c/m``.
    """
    if not pencil.conservative:
        return values
    out = values.copy()
    for i, (s, x) in enumerate(zip(values, X.T, strict=True)):
        parts = np.column_stack([x.real, x.imag])
        E, noise = pencil.energies(parts)
        k = E[0, 0] + E[1, 1]
        if abs(k) <= noise.sum():
            roots = np.array([0.0, -(x.conj() @ (C @ x))])
            near = SLOW * scale
        elif pencil.damping is None:
            roots = np.roots([1.0, 1j * (x.conj() @ (C @ x)).imag, k])
            roots = roots[abs(roots.real) <= STEADY * abs(roots)]
            roots, near = 1j * roots.imag, STEADY * abs(s)
        elif pencil.gyroscopic is None and abs(m := x @ (pencil.M @ x)) > WEAK:
            roots = np.roots([m, x @ (C @ x), E[0, 0] - E[1, 1] + 2j * E[0, 1]])
            near = STEADY * abs(s)
        else:
            continue
        if len(roots) and abs(roots - s).min() <= near:
            out[i] = roots[np.argmin(abs(roots - s))]
    return out
