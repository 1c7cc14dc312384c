"""Eigenvalues nearest to zero of ``(s^2 M + s C + K) x = 0``: gyroscopic, damped, circulatory."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eig, eigh
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, splu

from ..errors import CosseratError
from ..types import Array, Floats
from .pencil import Pencil
from .symmetric import SPARE, TOLERANCE, lowest

__all__ = ["DENSE", "Spectrum", "spectrum"]

#: unknowns up to which all eigenvalues are computed, dense
DENSE = 150
#: relative change of an eigenvalue by its Rayleigh quotient up to which that is followed
STEADY = 1e-4
#: eigenvalues relative to the lowest elastic frequency that may be halves of a double zero
SLOW = 1e-2
#: the same for squares: energies of motions without stiffness, as eigenvectors have them
FREE = 1e-8
#: relative force beyond those motions by which damping couples them with others
ALONE = 1e-10
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
    wanted = 2 * (count + SPARE)
    apart = _apart(pencil, C, free)
    deflated = free if apart else free[:, :0]
    inverse = _Inverse(K, M, C, 0.5 * scale, deflated)
    many = wanted - 2 * min(count, deflated.shape[1])
    values, X = inverse.dense() if n <= dense or wanted > n // 2 else inverse.arnoldi(many)
    if deflated.shape[1]:
        own, turn = eigh(free.T @ (C @ free))
        values = np.concatenate([-own, values])
        X = np.concatenate([free @ turn, X], axis=1)
    keep = np.flatnonzero(np.isfinite(values) & (values.imag >= 0))  # one of each pair
    keep = keep[np.argsort(abs(values[keep]), kind="stable")][:wanted]
    values, X = values[keep], X[:, keep]
    X = X / np.sqrt(np.einsum("ik,ik->k", X.conj(), M @ X).real)
    values = _improved(pencil, C, values, X, scale)
    order = np.argsort(abs(values), kind="stable")
    order = order[values[order] != 0]  # those without stiffness are known already
    values = np.concatenate([np.zeros(free.shape[1]), values[order]])[:count]
    X = np.concatenate([free, X[:, order]], axis=1)[:, :count]
    if len(values) < count:
        raise CosseratError(
            f"{len(values)} eigenvalues converged, {count} are wanted: real ones crowd together, as"
            " those of strong damping do"
        )
    zero = np.arange(len(values)) < free.shape[1]
    return Spectrum(values, X, zero, still.factorisations + 1)


def _apart(pencil: Pencil, C: csr_matrix, free: Floats) -> bool:
    """Whether damping leaves motions without stiffness to themselves: ``C N = M N (N^T C N)``."""
    if pencil.gyroscopic is not None or not free.shape[1]:
        return False
    force = C @ free
    rest = force - pencil.M @ free @ (free.T @ force)
    return bool(abs(rest).max() <= ALONE * abs(abs(C) @ abs(free)).max())


class _Inverse:
    """``(A - shift B)^-1 B`` on ``z = (x, s x / shift)`` about a real shift.

    Among vectors without the motions N (u, j), ``N^T M N = I``. Its eigenvalues are
    ``1/(s - shift)``: those sought are the largest, in what is computed dense as well.
    """

    def __init__(
        self, K: csr_matrix, M: csr_matrix, C: csr_matrix, shift: float, N: Floats
    ) -> None:
        self.n, self.M, self.N, self.shift = K.shape[0], M, N, shift
        self._right = C + shift * M
        try:
            self._solve = splu((K + shift * C + shift**2 * M).tocsc()).solve
        except RuntimeError as error:  # SuperLU: exactly singular
            raise CosseratError(
                f"the eigenvalue problem is singular at the shift {shift:g}"
            ) from error

    def without(self, x: Array) -> Array:
        """Without the part along N."""
        return x - self.N @ (self.N.T @ (self.M @ x)) if self.N.shape[1] else x

    def __call__(self, z: Array) -> Array:
        a, b = z[: self.n], z[self.n :] * self.shift
        x = self.without(-self._solve(self._right @ a + self.M @ b))
        return np.concatenate([x, self.without(a) / self.shift + x])

    def dense(self) -> tuple[Array, Array]:
        """All eigenvalues and vectors x."""
        theta, Z = eig(self(np.eye(2 * self.n)))
        kept = abs(theta) > 1e-14 * abs(theta).max()
        return self.shift + 1 / theta[kept], Z[: self.n, kept]

    def arnoldi(self, k: int) -> tuple[Array, Array]:
        """The k eigenvalues nearest to the shift.

        Raises
        ------
        CosseratError
            If less than half of them converge.
        """
        n = self.n
        inverse = LinearOperator((2 * n, 2 * n), matvec=self.__call__, dtype=float)
        start = np.random.default_rng(0).standard_normal((2, n))
        options = {
            "v0": np.concatenate([self.without(half) for half in start]),
            "ncv": min(2 * n, max(2 * k + 10, 40)),
            "tol": TOLERANCE,
            "maxiter": 100,
        }
        try:
            theta, Z = eigs(inverse, k, which="LM", **options)
        except ArpackNoConvergence as error:
            theta, Z = error.eigenvalues, error.eigenvectors  # the nearest ones come first
            if len(theta) < k // 2:
                raise CosseratError(
                    f"the Arnoldi iteration for {k} eigenvalues did not converge, {len(theta)} did"
                ) from error
        return self.shift + 1 / theta, Z[:n]


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
        if abs(k) <= max(noise.sum(), FREE * scale**2):
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
