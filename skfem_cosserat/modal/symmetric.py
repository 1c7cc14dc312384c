"""Lowest eigenvalues of symmetric pencils: dense, or Lanczos about a shift below all of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackError, LinearOperator, SuperLU, eigsh, splu

from ..errors import CosseratError
from ..log import logger
from ..types import Array, Floats

__all__ = ["DENSE", "Factorised", "Lowest", "lowest", "ritz"]

#: unknowns up to which all eigenvalues are computed, dense
DENSE = 300
#: first shift, relative to the largest quotient of diagonals
FIRST = 1e-9
#: of Lanczos vectors: their squares are what counts, after a Rayleigh-Ritz step
TOLERANCE = 1e-10
#: values against the distance of the shift that are nothing but rounding
FAINT = 1e-12
#: vectors beyond those asked for: they keep rigid motions and close pairs apart
SPARE = 6

#: accurate ``X^T K X`` (k, k) and the noise (k,) of its diagonal
Energies = Callable[[Array], tuple[Array, Floats]]


class Factorised:
    """``A`` factorised without exchange of rows, so that its negative pivots can be counted.

    Attributes
    ----------
    negative : int
        Negative eigenvalues, by Sylvester's law of inertia; -1 if rows were exchanged.
    """

    def __init__(self, A: csr_matrix) -> None:
        options = {"SymmetricMode": True}
        self.lu: SuperLU = splu(
            A.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
        )
        straight = bool((self.lu.perm_r == self.lu.perm_c).all())
        self.negative = int((self.lu.U.diagonal() < 0).sum()) if straight else -1

    def solve(self, rhs: Array) -> Array:
        """Real or complex right sides."""
        if np.iscomplexobj(rhs):
            return self.lu.solve(rhs.real.copy()) + 1j * self.lu.solve(rhs.imag.copy())
        return self.lu.solve(rhs)


class Lowest:
    """Lowest eigenpairs.

    Attributes
    ----------
    values : (k,) array
        Ascending; zero where only rounding is left of the energy.
    vectors : (u, k) array
        ``x^T M x = 1``.
    zero : (k,) bool array
    factorisations : int
        Of sparse matrices.
    """

    def __init__(
        self, values: Floats, vectors: Floats, zero: Array, factorisations: int = 0
    ) -> None:
        self.values, self.vectors, self.zero = values, vectors, zero
        self.factorisations = factorisations

    def first(self, count: int) -> Lowest:
        """The first of them."""
        keep = slice(0, count)
        return Lowest(
            self.values[keep], self.vectors[:, keep], self.zero[keep], self.factorisations
        )


def lowest(
    K: csr_matrix, M: csr_matrix, count: int, energies: Energies, dense: int = DENSE
) -> Lowest:
    """The `count` lowest eigenpairs of ``K x = lambda M x``; M positive, K of any sign.

    Parameters
    ----------
    energies : callable
        Accurate ``X^T K X``, see :meth:`Pencil.energies`: the last step is a Rayleigh-Ritz one.
    dense : int
        Unknowns up to which everything is dense.

    Raises
    ------
    CosseratError
        If the Lanczos iteration does not converge.
    """
    n = K.shape[0]
    wanted = min(n, count + SPARE)
    whole = n <= dense or wanted > n // 3
    shift, factors, made = _below(K, M)

    def vectors(seed: int = 0) -> Floats | None:
        if whole:
            return _dense(K, M, shift, wanted)
        return _lanczos(factors, M, shift, wanted, seed)

    X = vectors()
    while X is None and made < 8:  # farther away rounding does less harm
        shift *= 10.0
        factors, made = Factorised(K - shift * M), made + 1
        X = vectors()
    if X is None:
        raise CosseratError(
            f"the Lanczos iteration for {wanted} modes did not converge: stiffnesses that differ"
            " by more than 14 digits, as of very slender beams, are lost in rounding"
        )
    found = ritz(X, M, energies, shift)
    elastic = found.values[~found.zero]
    if len(elastic) and 0 < elastic[0] < -0.1 * shift:  # nearer to what is sought: more digits
        far, shift = (shift, factors), -float(elastic[0])
        factors, made = Factorised(K - shift * M), made + 1
        X = vectors()
        if X is None:
            shift, factors = far
        else:
            found = ritz(X, M, energies, shift)
    for seed in range(1, 4 if not whole else 1):
        missing, made = _missing(K, M, found, count), made + 1
        if missing <= 0:
            break
        wanted = min(n // 3, wanted + missing + SPARE)
        X = vectors(seed)
        found = found if X is None else ritz(X, M, energies, shift)
    else:
        if not whole:
            logger.warning("modes: %d of the lowest eigenvalues may be missing", missing)
    found.factorisations = made
    return found.first(count)


def _dense(K: csr_matrix, M: csr_matrix, shift: float, k: int) -> Floats:
    """Vectors of the k lowest eigenvalues, as the largest ones of ``(K - shift M)^-1 M``."""
    n = M.shape[0]
    A = (K - shift * M).toarray()
    scale = 1 / np.sqrt(np.diagonal(A))
    A, B = (scale[:, None] * S * scale for S in (A, M.toarray()))
    vectors = eigh(B, A, subset_by_index=(n - k, n - 1))[1]
    return np.asarray(scale[:, None] * vectors[:, ::-1])


def _below(K: csr_matrix, M: csr_matrix) -> tuple[float, Factorised, int]:
    """A shift below all eigenvalues, ``K - shift M`` factorised, and how many were."""
    top = float((abs(K.diagonal()) / M.diagonal()).max()) or 1.0
    shift, made = -FIRST * top, 0
    while True:
        made += 1
        try:
            factors = Factorised(K - shift * M)
        except RuntimeError:  # a pivot vanishes: the shift is an eigenvalue by chance
            shift *= 1.1
            continue
        if factors.negative == 0 or -shift > 1e3 * top:
            return shift, factors, made
        shift *= 7.3


def _lanczos(
    factors: Factorised, M: csr_matrix, shift: float, k: int, seed: int = 0
) -> Floats | None:
    """Vectors of the k eigenvalues nearest to the shift; None: no convergence."""
    n = M.shape[0]
    inverse = LinearOperator((n, n), matvec=factors.solve, dtype=float)
    options = {
        "v0": M @ np.random.default_rng(seed).standard_normal(n),
        "ncv": min(n, max(2 * k + 10, 30)),
        "tol": TOLERANCE,
        "maxiter": 100,
    }
    try:
        vectors = eigsh(inverse, k, M=M, sigma=shift, OPinv=inverse, **options)[1]
    except ArpackError:
        return None
    return np.asarray(vectors)


def _missing(K: csr_matrix, M: csr_matrix, found: Lowest, count: int) -> int:
    """How many eigenvalues were missed, counted by the signs of pivots.

    Below a value in the widest gap behind those asked for.
    """
    gaps = np.diff(found.values[count - 1 :])
    k = int(np.argmax(gaps))
    try:
        negative = Factorised(K - (found.values[count - 1 + k] + 0.5 * gaps[k]) * M).negative
    except RuntimeError:  # a pivot vanishes: by chance the value is an eigenvalue of a part
        return 0
    return negative - (count + k) if negative >= 0 else 0


def ritz(X: Floats, M: csr_matrix, energies: Energies, shift: float) -> Lowest:
    """Rayleigh-Ritz in the span of X (u, k), with accurate energies; `shift` is below all values.

    The largest ``1/(value - shift)`` are computed: the lowest values keep their digits whatever
    the highest are.
    """
    X = X / np.sqrt(np.einsum("ik,ik->k", X, M @ X))
    for _ in range(2):
        energy, _ = energies(X)
        mass = X.T @ (M @ X)
        above = 0.5 * (energy + energy.T) - shift * mass
        scale = 1 / np.sqrt(np.diagonal(above))
        turn = eigh(scale[:, None] * mass * scale, scale[:, None] * above * scale)[1]
        X = X @ (scale[:, None] * turn)
        X /= np.sqrt(np.einsum("ik,ik->k", X, M @ X))
        energy, noise = energies(X)
        values = np.diagonal(energy).copy()
        zero = abs(values) <= noise + FAINT * abs(shift)
        elastic = values[~zero & (values > 0)]
        if not len(elastic) or elastic.min() < -10 * shift:
            break
        shift = -float(elastic.min())  # nearer: vectors are orthogonal to more digits
    values[zero] = 0.0
    order = np.argsort(values, kind="stable")
    return Lowest(values[order], X[:, order], zero[order])
