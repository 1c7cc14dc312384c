"""Eigenvalue problems: symmetric ones, pencils with constraints, those of damping and spin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import eig, eigh
from scipy.sparse import csr_matrix, identity, kron
from scipy.sparse.linalg import (
    ArpackError,
    ArpackNoConvergence,
    LinearOperator,
    eigs,
    eigsh,
    splu,
)

from ..diagnostics.stacked import blocks_matrix, congruent, curvature_matrix
from ..errors import CosseratError, IncompleteWarning, InputError
from ..kernels import skew
from ..linear import EIGENVALUES, Factorised
from ..model import System
from ..model.balance import balance_tangent
from ..types import SAME, Array, Floats
from ..warn import warn
from .state import Equilibrium

# -- lowest eigenvalues of symmetric pencils: dense, or Lanczos about a shift below all of them ----

#: first shift, relative to the largest quotient of diagonals
FIRST = 1e-9
#: of Lanczos vectors: their squares are what counts, after a Rayleigh-Ritz step
TOLERANCE = 1e-10
#: vectors beyond those asked for: they keep rigid motions and close pairs apart
SPARE = 6

#: accurate ``X^T K X`` (k, k) and the noise (k,) of its diagonal
Energies = Callable[[Array], tuple[Array, Floats]]


@dataclass(eq=False)
class Eigenpairs:
    """Eigenvalues and their vectors, motions without stiffness first or where they are.

    Attributes
    ----------
    values : (k,) array
        Ascending; zero where only rounding is left of the energy.
    vectors : (u, k) array
        ``x^H M x = 1``.
    zero : (k,) bool array
        Motions without stiffness.
    factorisations : int
        Of sparse matrices.
    """

    values: Array
    vectors: Array
    zero: Array
    factorisations: int = 0


def lowest(
    K: csr_matrix, M: csr_matrix, count: int, energies: Energies, dense: int = EIGENVALUES
) -> Eigenpairs:
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
        factors = Factorised(K - shift * M)
        made += 1
        X = vectors()
    if X is None:
        raise CosseratError(
            f"the Lanczos iteration for {wanted} modes did not converge: stiffnesses that differ"
            " by more than 14 digits, as of very slender beams, are lost in rounding"
        )
    found = ritz(X, M, energies, shift)
    elastic = found.values[~found.zero]
    if len(elastic) and 0 < elastic[0] < -0.1 * shift:  # nearer to what is sought: more digits
        far = (shift, factors)
        shift = -float(elastic[0])
        factors = Factorised(K - shift * M)
        made += 1
        X = vectors()
        if X is None:
            shift, factors = far
        else:
            found = ritz(X, M, energies, shift)
    for seed in range(1, 4 if not whole else 1):
        missing = _missing(K, M, found, count)
        made += 1
        if missing <= 0:
            break
        wanted = min(n // 3, wanted + missing + SPARE)
        X = vectors(seed)
        found = found if X is None else ritz(X, M, energies, shift)
    else:
        if not whole:
            warn("modes", f"{missing} of the lowest eigenvalues may be missing", IncompleteWarning)
    return Eigenpairs(found.values[:count], found.vectors[:, :count], found.zero[:count], made)


def _dense(K: csr_matrix, M: csr_matrix, shift: float, k: int) -> Floats:
    """Vectors of the k lowest eigenvalues, as the largest ones of ``(K - shift M)^-1 M``."""
    n = M.shape[0]
    A = (K - shift * M).toarray()
    scale = 1 / np.sqrt(np.diagonal(A))
    A, B = (scale[:, None] * S * scale for S in (A, M.toarray()))
    return scale[:, None] * eigh(B, A, subset_by_index=(n - k, n - 1))[1][:, ::-1]


def _below(K: csr_matrix, M: csr_matrix) -> tuple[float, Factorised, int]:
    """A shift below all eigenvalues, ``K - shift M`` factorised, and how many were."""
    top = float((abs(K.diagonal()) / M.diagonal()).max()) or 1.0
    shift = -FIRST * top
    made = 0
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
    return vectors


def _missing(K: csr_matrix, M: csr_matrix, found: Eigenpairs, count: int) -> int:
    """Number of eigenvalues that were missed, counted by the signs of pivots.

    Below a value in the widest gap behind those asked for.
    """
    gaps = np.diff(found.values[count - 1 :])
    k = int(gaps.argmax())
    try:
        negative = Factorised(K - (found.values[count - 1 + k] + 0.5 * gaps[k]) * M).negative
    except RuntimeError:  # a pivot vanishes: by chance the value is an eigenvalue of a part
        return 0
    return negative - (count + k) if negative >= 0 else 0


def ritz(X: Floats, M: csr_matrix, energies: Energies, shift: float) -> Eigenpairs:
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
        values = energy.diagonal().copy()
        zero = abs(values) <= noise + SAME * abs(shift)
        elastic = values[~zero & (values > 0)]
        if not len(elastic) or elastic.min() < -10 * shift:
            break
        shift = -float(elastic.min())  # nearer: vectors are orthogonal to more digits
    values[zero] = 0.0
    order = values.argsort(kind="stable")
    return Eigenpairs(values[order], X[:, order], zero[order])


# -- mass, damping and stiffness of small vibrations about a state of rest -------------------------

EPS = float(np.finfo(float).eps)
#: what counts as rounding, in units of it
NOISE = 100.0
#: the same for energies of beams: what the rounding of K leaves after a Rayleigh-Ritz step
FAINT = 1e-9


@dataclass(eq=False)
class Pencil:
    """``M u'' + C u' + K u = 0``, with ``dq = P u``.

    From Lagrange's equations of ``q = F(u)`` in a frame that turns with Omega: kinetic energy
    ``1/2 |P u' + Omega x q|^2_M``. The terms linear in u' give ``2 P^T M Omega^ P``, in which the
    derivatives of P cancel; those without u' are the potential of the centrifugal force. So about
    a state of rest it does not matter that P moves, but for the constraint forces in K.

    Attributes
    ----------
    at : Equilibrium
    K : (u, u) csr_matrix
        Stiffness; symmetric if `conservative`.
    M : (u, u) csr_matrix
    gyroscopic : (u, u) csr_matrix or None
        Skew.
    damping : (u, u) csr_matrix or None
        Symmetric.
    rest, rest_size : (u, u) csr_matrix
        K without the material stiffness of beams, and the sums of the moduli of its terms.
    conservative : bool
    """

    at: Equilibrium
    K: csr_matrix
    M: csr_matrix
    gyroscopic: csr_matrix | None
    damping: csr_matrix | None
    rest: csr_matrix
    rest_size: csr_matrix
    conservative: bool

    @property
    def simple(self) -> bool:
        """True if squares of frequencies are eigenvalues of symmetric K and M."""
        return self.conservative and self.gyroscopic is None and self.damping is None

    @property
    def C(self) -> csr_matrix:
        """All terms by velocity."""
        out = csr_matrix(self.K.shape)
        for part in (self.gyroscopic, self.damping):
            if part is not None:
                out = out + part
        return out

    @cached_property
    def _size(self) -> csr_matrix:
        return abs(self.K)

    def force(self, x: Floats) -> Floats:
        """``K x`` (u,) for a vector, with strains differentiated first, see :meth:`energies`."""
        system = self.at.system
        tangent = self.at.tangent
        dq = tangent.P @ x
        nodal = np.zeros(system.n)
        for group, B, D in zip(system.beam_groups, tangent.balance.Bs, self.at.moduli, strict=True):
            strain = (B @ dq[group.dofs][:, :, None]).reshape(len(B), -1, 6)
            np.add.at(nodal, group.dofs, group.force(B, group.linear_stress(D, strain)))
        return tangent.P.T @ nodal + self.rest @ x

    def energies(self, X: Array) -> tuple[Array, Floats]:
        """``X^H K X`` (k, k), and what rounding can make of its diagonal (k,).

        The strains of beams are differentiated first and squared then: stretching and shear, much
        stiffer than bending, cancel in strains of order one and not in energies. So frequencies
        keep their digits at any slenderness, and rigid motions have no energy at all.
        """
        system = self.at.system
        tangent = self.at.tangent
        out = X.conj().T @ (self.rest @ X)
        noise = NOISE * EPS * np.einsum("ik,ik->k", abs(X), self.rest_size @ abs(X))
        noise += self.at.error * np.einsum("ik,ik->k", abs(X), abs(tangent.metric) @ abs(X))
        noise += FAINT * EPS * np.einsum("ik,ik->k", abs(X), self._size @ abs(X))
        dq = tangent.P @ X
        for group, B, D in zip(system.beam_groups, tangent.balance.Bs, self.at.moduli, strict=True):
            local = dq[group.dofs]
            ne = len(B)
            ng = len(group.elements.points)
            strain = (B @ local).reshape(ne, ng, 6, -1)
            out = out + np.einsum("egik,egil->kl", strain.conj(), D @ strain, optimize=True)
            lost = NOISE * EPS * (abs(B) @ abs(local)).reshape(ne, ng, 6, -1)
            noise += np.einsum("egik,egik->k", lost, abs(D) @ lost, optimize=True)
        return out, noise


def make_pencil(at: Equilibrium) -> Pencil:
    """Matrices about an equilibrium.

    Raises
    ------
    InputError
        If a motion has no inertia.
    """
    system = at.system
    tangent = at.tangent
    P = tangent.P
    balance = tangent.balance
    still = replace(balance, Bs=[np.zeros_like(B) for B in balance.Bs])
    blocks = balance_tangent(system, still, at.amplitudes)
    curved = curvature_matrix(system, balance.y, tangent.multipliers)
    rest = blocks_matrix(system, blocks) + curved
    rest_size = blocks_matrix(system, [abs(block) for block in blocks]) + abs(curved)
    rest_size = congruent(abs(P), rest_size)
    rest = congruent(P, rest)
    K = tangent.K
    size = float(abs(rest).max()) if rest.nnz else 0.0
    conservative = bool(abs(rest - rest.T).max() <= SAME * size) if size else True
    if conservative:
        K, rest = (0.5 * (A + A.T) for A in (K, rest))
    M = congruent(P, kron(system.mass, identity(3)))
    M = (0.5 * (M + M.T)).tocsr()
    inertia = M.diagonal() / tangent.metric.diagonal()
    worst = int(np.argmin(inertia))
    if not inertia[worst] > 0:
        if len(system.closure.rows):
            raise InputError("model", f"unknown {worst} of the null space has no inertia")
        coordinate = system.kinematics.tree.coordinate(worst)
        raise InputError(
            system.owner[coordinate.vertex].label,
            f"its motion {coordinate.kind!r} has no inertia: give it mass",
        )
    gyroscopic = None
    if at.amplitudes.spin is not None:
        G = congruent(P, kron(system.mass, skew(at.amplitudes.spin.velocity)))
        gyroscopic = (G - G.T).tocsr()
        if not gyroscopic.count_nonzero():
            gyroscopic = None
    return Pencil(
        at,
        K.tocsr(),
        M,
        gyroscopic,
        _damping(system, balance.y, P, balance.Bs),
        rest.tocsr(),
        rest_size,
        conservative,
    )


def _damping(system: System, y: Floats, P: csr_matrix, Bs: list[Array]) -> csr_matrix | None:
    """Viscous sections, drag, dampers."""
    blocks = system.empty_tangent()
    for k, (group, B) in enumerate(zip(system.beam_groups, Bs, strict=True)):
        if group.viscous:
            blocks[k] += group.damping(B)
    for block, each in zip(blocks, system.groups, strict=True):
        if each.drag is not None:
            block += each.drag
    if system.couplings.count:
        blocks.append(system.couplings.damping(y))
    if not any(block.any() for block in blocks):
        return None
    C = congruent(P, blocks_matrix(system, blocks))
    return (0.5 * (C + C.T)).tocsr()


# -- eigenvalues nearest to zero of ``(s^2 M + s C + K) x = 0``: gyroscopic, damped, circulatory ---

#: relative change of an eigenvalue by its Rayleigh quotient up to which that is followed
STEADY = 1e-4
#: eigenvalues relative to the lowest elastic frequency that may be halves of a double zero
SLOW = 1e-2
#: the same for squares: energies of motions without stiffness, as eigenvectors have them
FREE = 1e-8
#: modal mass ``x^T M x`` below which an eigenvector says little about its eigenvalue
WEAK = 0.1


def spectrum(pencil: Pencil, count: int, dense: int = EIGENVALUES // 2) -> Eigenpairs:
    """The `count` eigenvalues of smallest modulus, one of each conjugate pair.

    They are complex s (1/s), imaginary parts not negative, motions without stiffness first.

    A linear pencil of twice the size is solved about a real shift, of the size of the lowest
    frequency: dense, or by Arnoldi's method. Where theory gives a Rayleigh quotient it follows.
    """
    K, M, C = pencil.K, pencil.M, pencil.C
    still = lowest((0.5 * (K + K.T)).tocsr(), M, min(K.shape[0], count + SPARE), pencil.energies)
    free = still.vectors[:, still.zero] if pencil.conservative else still.vectors[:, :0]
    elastic = abs(still.values[~still.zero])
    scale = float(np.sqrt(elastic.min())) if len(elastic) and elastic.min() else 1.0
    n = K.shape[0]
    wanted = 2 * (count + SPARE)
    many = None if n <= dense or wanted > n // 2 else wanted
    values, X = _Inverse(K, M, C, 0.5 * scale).largest(many)
    # equal real ones are pairs to rounding, of which none is to be left out
    values = np.where(abs(values.imag) <= FREE * abs(values), values.real, values)
    keep = np.flatnonzero(np.isfinite(values) & (values.imag >= 0))  # one of each pair
    keep = keep[abs(values[keep]).argsort(kind="stable")][:wanted]
    values = values[keep]
    X = X[:, keep]
    X = X / np.sqrt(np.einsum("ik,ik->k", X.conj(), M @ X).real)
    values = _improved(pencil, C, values, X, scale)
    order = abs(values).argsort(kind="stable")
    order = order[values[order] != 0]  # those without stiffness are known already
    values = np.concatenate([np.zeros(free.shape[1]), values[order]])[:count]
    X = np.concatenate([free, X[:, order]], 1)[:, :count]
    if len(values) < count:
        raise CosseratError(
            f"{len(values)} eigenvalues converged, {count} are wanted: real ones crowd together, as"
            " those of strong damping do"
        )
    return Eigenpairs(values, X, np.arange(len(values)) < free.shape[1], still.factorisations + 1)


class _Inverse:
    """``(A - shift B)^-1 B`` on ``z = (x, s x / shift)`` about a real shift.

    Its eigenvalues are ``1/(s - shift)``: those sought are the largest, in what is computed dense
    as well.
    """

    def __init__(self, K: csr_matrix, M: csr_matrix, C: csr_matrix, shift: float):
        self.n, self.M, self.shift = K.shape[0], M, shift
        self._right = C + shift * M
        try:
            self._solve = splu((K + shift * C + shift**2 * M).tocsc()).solve
        except RuntimeError as error:  # SuperLU: exactly singular
            raise CosseratError(
                f"the eigenvalue problem is singular at the shift {shift:g}"
            ) from error

    def __call__(self, z: Array) -> Array:
        a = z[: self.n]
        x = -self._solve(self._right @ a + self.M @ (z[self.n :] * self.shift))
        return np.concatenate([x, a / self.shift + x])

    def largest(self, k: int | None) -> tuple[Array, Array]:
        """The k eigenvalues nearest to the shift, or all, and vectors x."""
        size = 2 * self.n
        theta, Z = eig(self(np.eye(size))) if k is None else arnoldi(self, size, k)
        kept = abs(theta) > 1e-14 * abs(theta).max()
        return self.shift + 1 / theta[kept], Z[: self.n, kept]


def arnoldi(operator: Callable[[Array], Array], n: int, k: int) -> tuple[Array, Array]:
    """The k largest eigenvalues of an operator on vectors (n,), and vectors (n, k).

    Raises
    ------
    CosseratError
        If less than half of them converge.
    """
    options = {
        "v0": np.random.default_rng(0).standard_normal(n),
        "ncv": min(n, max(2 * k + 10, 40)),
        "tol": TOLERANCE,
        "maxiter": 100,
    }
    try:
        theta, Z = eigs(LinearOperator((n, n), matvec=operator, dtype=float), k, **options)
    except ArpackNoConvergence as error:
        theta, Z = error.eigenvalues, error.eigenvectors  # the largest ones come first
        if len(theta) < k // 2:
            raise CosseratError(
                f"the Arnoldi iteration for {k} eigenvalues did not converge, {len(theta)} did"
            ) from error
    return theta, Z


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
        E, noise = pencil.energies(np.column_stack([x.real, x.imag]))
        k = E[0, 0] + E[1, 1]
        if abs(k) <= max(noise.sum(), FREE * scale**2):
            roots = np.array([0.0, -(x.conj() @ (C @ x))])
            near = SLOW * scale
        elif pencil.damping is None:
            roots = np.roots([1.0, 1j * (x.conj() @ (C @ x)).imag, k])
            roots = roots[abs(roots.real) <= STEADY * abs(roots)]
            roots = 1j * roots.imag
            near = STEADY * abs(s)
        elif pencil.gyroscopic is None and abs(m := x @ (pencil.M @ x)) > WEAK:
            roots = np.roots([m, x @ (C @ x), E[0, 0] - E[1, 1] + 2j * E[0, 1]])
            near = STEADY * abs(s)
        else:
            continue
        if len(roots) and abs(roots - s).min() <= near:
            out[i] = roots[np.argmin(abs(roots - s))]
    return out
