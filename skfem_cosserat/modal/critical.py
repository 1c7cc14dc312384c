"""Critical loads of the linear theory: geometric stiffness of the linear solution's stresses."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from scipy.linalg import eig, eigh
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from .. import checks
from ..arguments import checked
from ..checks.coarseness import energies_of_motion
from ..diagnostics.stacked import balancing_multipliers, blocks_matrix, congruent, curvature_matrix
from ..errors import CosseratError, InputError
from ..law import STEP
from ..linear import EIGENVALUES, Factorised
from ..model import System, takes_scene
from ..model.balance import Amplitudes, amplitudes_at, balance
from ..model.force_elements import CoupledForce
from ..model.limits import owner
from ..types import SAME, Floats, finite, numbered
from ..warn import Notice, Notices, counted, told
from .eigen import SPARE, TOLERANCE, Pencil, arnoldi, lowest, make_pencil
from .state import Equilibrium, as_system, check_amplitudes, resting
from .vibration import Animated, checked_count, led

Sign = Literal["positive", "negative", "both"]
#: which eigenvalues 1/factor are sought first, by Lanczos' method
_WHICH = {"positive": "LA", "negative": "SA", "both": "LM"}
#: critical factors beyond this multiple of the smallest one found are rounding of infinite ones
INFINITE = 1e10
#: relative imaginary part above which a factor is no buckling load
REAL = 1e-6


@checked
@dataclass(eq=False)
class Buckling(Animated):
    """Critical load factors and buckling modes.

    Attributes
    ----------
    system : System
    factors : (count,) array
        The given loads times these are critical; by modulus.
    shapes : (count, n) array
        Changes of the coordinates q, of unit size in the metric of motions: lengths relative to
        the extent of the scene, turns in rad.
    reduced : (count, unknowns) array
        The same in the unknowns of the null space method.
    response : (n,) array
        Linear response to the given loads (m, -).
    factorisations : int
        Of sparse matrices.
    warnings : list of dict
        As in ``history.meta["warnings"]``.
    """

    system: System
    factors: Floats
    shapes: Floats
    reduced: Floats
    response: Floats
    factorisations: int
    _at: Equilibrium
    warnings: list[Notice] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.factors)

    def summary(self) -> dict[str, Any]:
        """Critical factors."""
        return {"modes": str(self), "warnings": told(self.warnings)}

    def __repr__(self) -> str:
        found = ", ".join(f"{factor:.6g}" for factor in self.factors[:3])
        more = ", ..." * (len(self) > 3)
        return f"<Buckling: {len(self)} factors, {found}{more}{counted(self.warnings)}>"

    def __str__(self) -> str:
        """A table."""
        rows = (f"{k:4d} {factor:15.7g}" for k, factor in enumerate(self.factors))
        return "\n".join(["mode critical factor", *rows])

    def called(self, index: int) -> str:
        """Its number and critical factor."""
        k = numbered("argument index", index, len(self), "modes")
        return f"mode {k}: factor {self.factors[k]:.4g}"


@takes_scene
def buckling(
    model: System,
    count: int = 3,
    *,
    sign: Sign = "positive",
    t: float = 0.0,
    amplitudes: Amplitudes | None = None,
    tolerance: float = 1e-6,
) -> Buckling:
    """Linear buckling about the unloaded reference: ``(K_0 + factor K_1) phi = 0``.

    Parameters
    ----------
    model : Model or System
        Supported so that nothing moves without a force.
    count : int
        How many critical factors.
    sign : {"positive", "negative", "both"}
        Which ones: of loads as given, of loads turned round, or both by modulus.
    t : float
        Time (s) at which loads and actuators are taken.
    amplitudes : Amplitudes, optional
        Factors of all loads and actuators instead.
    tolerance : float
        As for :func:`modes`: the reference must be in equilibrium without loads.

    Returns
    -------
    Buckling

    Raises
    ------
    InputError
        If there are no loads, a motion has no stiffness, or fewer factors of this sign exist than
        asked for.
    CosseratError
        If the eigenvalue iteration does not converge.

    Notes
    -----
    K_1 is the stiffness that the stresses, constraint forces and forces of the linear solution
    ``K_0 u = f`` add to the reference, and that of loads that follow the motion; of springs and
    bushings the derivative along that solution. The deflections before buckling are left out:
    where they matter (shallow arches, frames that bend at once) follow the path with ``static``.
    With loads that have no potential only real factors are given: flutter is not found so.

    Examples
    --------
    Euler's column, free at its head, of EI = 2 N m^2 and 1 m: pi^2 EI / 4 = 4.9348 N (here with
    a little shear, ``P (1 + P/GA) = pi^2 EI/4``):

    >>> from skfem_cosserat import Beam, JointFixed, LoadForce, MeshCurve, Model, Section, ground
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 1), 4, nodes={"foot": 0.0, "head": 1.0})
    >>> section = Section([1e6, 1e6, 1e6, 2.0, 3.0, 1.0], mass=1.0, inertia=(1e-3, 1e-3))
    >>> model = Model()
    >>> column = model.add("column", Beam(mesh, section, director=(1, 0, 0), order=3))
    >>> clamp = model.add("clamp", JointFixed(ground((0, 0, 0)), column.node("foot")))
    >>> weight = model.add("weight", LoadForce(column.node("head"), (0, 0, -1.0)))
    >>> [round(float(factor), 4) for factor in buckling(model, 2).factors]
    [4.9348, 7.4021]
    """
    system = as_system(model)
    count = checked_count(count, system.unknowns)
    if sign not in _WHICH:
        raise InputError("argument sign", f"{sign!r}, expected one of {list(_WHICH)}")
    loads = _loads(system, finite("argument t", "t", t), amplitudes)
    with Notices(system.warnings) as notices:
        at = resting(system, None, None, None, None, tolerance)
        pencil = make_pencil(at)
        tangent = at.tangent
        still = lowest(pencil.K, tangent.metric, 1, pencil.energies)
        if still.zero[0] or still.values[0] < 0:
            what = "moves without any stiffness" if still.zero[0] else "is unstable without loads"
            sizes = abs((tangent.P @ still.vectors[:, 0]).reshape(-1, 3)).max(1)
            sizes[system.origin_rows] /= system.length
            raise InputError(
                owner(system, int(sizes.argmax())).label,
                f"{what} in the reference: support it, there is no buckling load",
            )
        P = tangent.P
        applied = (tangent.balance.R - balance(system, at.y, loads).R).ravel()
        if not applied.any():
            raise InputError(
                "argument t", f"{t!r}: the loads do nothing then, there is no response"
            )
        factors = Factorised(pencil.K)
        u = _solve(pencil, factors, P.T @ applied)
        K1, stresses, multipliers = _geometric(at, loads, (P @ u).reshape(-1, 3))
        values, X = _critical(pencil, K1, factors, count, sign)
        X = led(X / np.sqrt(np.einsum("ik,ik->k", X, tangent.metric @ X)), tangent.metric)
        made = still.factorisations + 1
        if system.beam_groups:
            checks.apply(_shapes(pencil, stresses, multipliers, loads, values, X))
    return Buckling(system, values, (P @ X).T, X.T.copy(), P @ u, made, at, notices.found)


def _shapes(
    pencil: Pencil,
    stresses: list[Floats],
    multipliers: Floats,
    loads: Amplitudes,
    values: Floats,
    X: Floats,
) -> checks.Shapes:
    """Buckling modes for :mod:`checks`; stresses and multipliers are those of the given loads."""
    at = pencil.at
    found = []
    for factor, x in zip(values, X.T, strict=True):
        dq = (at.tangent.P @ x).reshape(-1, 3)
        state = [factor * each for each in stresses], factor * multipliers
        scaled = replace(loads, loads=factor * loads.loads)
        found.append(energies_of_motion(at.system, at.y, *state, scaled, dq, 0 * dq))
    energy = pencil.energies(X)[0].diagonal()
    return checks.Shapes(at.system, "critical factor", 1, np.array(found), energy)


def _loads(system: System, t: float, amplitudes: Amplitudes | None) -> Amplitudes:
    if amplitudes is None:
        return amplitudes_at(system, t)
    check_amplitudes(system, amplitudes)
    if amplitudes.spin is not None:
        raise InputError("argument amplitudes", "has a spin, expected loads that can be scaled")
    return amplitudes


def _geometric(
    at: Equilibrium, loads: Amplitudes, dq: Floats
) -> tuple[csr_matrix, list[Floats], Floats]:
    """K_1 (unknowns, unknowns) for the linear response dq (rows, 3), its stresses, multipliers."""
    system, y, P = at.system, at.y, at.tangent.P
    blocks = system.empty_tangent()
    Bs = at.tangent.balance.Bs
    stresses = []
    for k, (group, B, D) in enumerate(zip(system.beam_groups, Bs, at.moduli, strict=True)):
        local = dq[group.rows].reshape(len(group.rows), -1, 1)
        stresses.append(group.linear_stress(D, (B @ local).reshape(len(B), -1, 6)))
        none = np.zeros_like(B)
        blocks[k] += group.parts(none, none, stresses[k], 0.0, 1.0).blocks()
    R = system.internal_force(Bs, stresses) - system.loading.dead_force(loads.loads)
    if not system.loading.dead_only:
        R = R - system.loading.force(y[: system.rows], loads.loads)
        system.loading.add_tangent(blocks, y[: system.rows], loads.loads, -1.0)
    if system.couplings.count:

        def moved(step: complex) -> CoupledForce:
            factors = step * loads.actuators
            there = y + 0 * step
            there[: system.rows] += step * dq
            start = system.couplings.starting(y, None, factors, 1.0, loads.time)
            return system.couplings.static(start, there)

        # along the response: of forces by the complex step, of tangents by differences
        R = R + moved(1j * STEP).force[: system.rows].imag / STEP
        h = 1e-4 * min(1.0, system.length) / (float(abs(dq).max()) or 1.0)
        sides = (1, 8.0), (-1, -8.0), (2, -1.0), (-2, 1.0)
        tangents = [w * system.couplings.tangent(moved(k * h), 1.0) for k, w in sides]
        blocks.append(np.sum(tangents, 0) / (12 * h))
    multipliers = balancing_multipliers(system, y, R.ravel())
    A = blocks_matrix(system, blocks) + curvature_matrix(system, y, multipliers)
    return congruent(P, A), stresses, multipliers


def _critical(
    pencil: Pencil, K1: csr_matrix, factors: Factorised, count: int, sign: Sign
) -> tuple[Floats, Floats]:
    """Factors (count,) and vectors (unknowns, count): ``-K_1 x = (1/factor) K_0 x``."""
    size = float(abs(K1).max()) if K1.nnz else 0.0
    n = K1.shape[0]
    many = min(n, count + SPARE)
    if not size or bool(abs(K1 - K1.T).max() <= SAME * size):
        K1 = (0.5 * (K1 + K1.T)).tocsr()
        if n <= EIGENVALUES or many > n // 3:
            X = eigh(-K1.toarray(), pencil.K.toarray())[1]
        else:
            X = _lanczos(K1, pencil, factors, many, sign)
        energy = pencil.energies(X)[0]
        theta, turn = eigh(-(X.T @ (K1 @ X)), 0.5 * (energy + energy.T))
        X = X @ turn
    else:  # without a potential: the real ones of 1/factor
        k = 2 * many
        if n <= EIGENVALUES or k > n // 3:
            theta, X = eig(-K1.toarray(), pencil.K.toarray())
        else:
            theta, X = arnoldi(lambda x: -factors.solve(K1 @ x), n, k)
        real = abs(theta.imag) <= REAL * abs(theta)
        theta = theta[real].real
        X = X[:, real].real
    wanted = abs(theta) > abs(theta).max(initial=0.0) / INFINITE
    if sign != "both":
        wanted &= (theta > 0) == (sign == "positive")
    found = np.flatnonzero(wanted)
    found = found[np.argsort(-abs(theta[found]), kind="stable")]
    if len(found) < count:
        kind = "" if sign == "both" else f"{sign} "
        raise InputError(
            "argument count", f"{count!r}, but only {len(found)} {kind}critical factor(s) exist"
        )
    return 1 / theta[found[:count]], X[:, found[:count]]


def _solve(pencil: Pencil, factors: Factorised, force: Floats) -> Floats:
    """``K_0^-1 force``, refined: rounding of K_0 is more than its softest parts may be."""
    x = factors.solve(force)
    for _ in range(2):
        x = x + factors.solve(force - pencil.force(x))
    return x


def _lanczos(K1: csr_matrix, pencil: Pencil, factors: Factorised, k: int, sign: Sign) -> Floats:
    n = K1.shape[0]
    stiffness = LinearOperator((n, n), matvec=pencil.force, dtype=float)
    inverse = LinearOperator((n, n), matvec=lambda f: _solve(pencil, factors, f), dtype=float)
    start = np.random.default_rng(0).standard_normal(n)
    options = {"v0": start, "ncv": min(n, max(2 * k + 10, 40)), "tol": TOLERANCE, "maxiter": 300}
    try:
        found = eigsh(-K1, k, M=stiffness, Minv=inverse, which=_WHICH[sign], **options)[1]
    except ArpackError as error:
        raise CosseratError(f"the Lanczos iteration for {k} factors did not converge") from error
    return found
