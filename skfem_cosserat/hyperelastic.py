"""Sections of any stored energy, whose derivatives are checked when they are made."""

from __future__ import annotations

import warnings
from typing import Any, ClassVar

import numpy as np

from .errors import InputError
from .law import DIFFERENCE, EPS, ITEM, Law, LawStored, StrainFunction, difference, of_points
from .section import Section, check_stiffness
from .types import ArrayLike, Floats, numbers

STRESSES = ("N_1", "N_2", "N_3", "M_1", "M_2", "M_3")
#: of derivatives, relative to the largest entry, each measured by the stiffness at zero strain
TOLERANCE = 1e-6
#: stress at zero strain, as an axial strain
AT_REST = 1e-10
#: largest strains at which derivatives are checked, relative to those of an axial strain of one
AMPLITUDES = (1e-3, 1e-2, 3e-2)


class SectionHyperelastic(Section):
    """Section of any stored energy per length ``W(Gamma, K)``.

    Strains are material and vanish in the reference, so whatever function of them is stored is
    objective. Everything works as with :class:`Section`, whose energy is ``eps . D eps/2``: with
    :class:`EnergyMomentum` energy is kept exactly by a discrete derivative of W. What is linear
    about the reference (Rayleigh damping, ``damped(time=...)``, linear buckling) takes the second
    derivative at zero strain, which is its `stiffness`. Compiled kernels call the functions in each
    iteration, for all Gauss points at once, which takes most of the time of a step; less, if all
    of the functions are compiled by numba (``numba.njit``) for the strains (6,) of one point.

    Parameters
    ----------
    energy : callable
        Strains (..., 6), in the order ``(Gamma_1, Gamma_2, Gamma_3, K_1, K_2, K_3)``, to
        W (...) in J/m, vectorised: for any number of strains at once, each by itself; compiled by
        numba, of one point: (6,) to a number, and so with its derivatives. Zero at zero
        strain, without stress there, and with a positive definite second derivative.
    mass, inertia, outline, viscosity, centre
        As for :class:`Section`.
    gradient : callable, optional
        Strains to ``dW/d eps`` (..., 6), the resultants ``(N, M)``. Default: by the complex step
        through `energy`, exact to rounding, for which it has to take complex numbers and be
        analytic there (no ``abs``, no comparisons of moduli).
    hessian : callable, optional
        Strains to the second derivative (..., 6, 6). Default: by the complex step through
        `gradient`; where that is not given or takes real numbers only, by differences of fourth
        order, with errors of 4e-12 of the stiffness for ``exp(100 eps^2)`` and 4e-8 for
        ``exp(1e4 eps^2)``, axial strains. It enters tangents, not resultants.
    strains : (k, 6) array, optional
        Where derivatives are compared with differences; default: 12 strains of up to 3 % in the
        outer fibres of a homogeneous section. For energies that are not defined that far.

    Raises
    ------
    InputError
        Naming function, entry and both values: if a derivative does not match (by more than 1e-6
        of the largest entry); if a result has a wrong shape or is complex or not finite; if there
        is energy or stress at zero strain, or no positive definite second derivative; if two calls
        with the same strains, or one by itself and one among others, do not give the same; if the
        function cannot take such strains or changes them. As for :class:`Section` beside.

    Examples
    --------
    A rod that stiffens when it is bent:

    >>> D = np.array([2e3, 2e3, 5e3, 0.5, 0.5, 0.4])
    >>> def energy(eps):
    ...     return (D * eps**2).sum(-1) / 2 + 0.1 * (eps[..., 3] ** 2 + eps[..., 4] ** 2) ** 2
    >>> section = SectionHyperelastic(energy, mass=0.1, inertia=(1e-6, 1e-6))
    >>> section.stiffness.diagonal().round(6).tolist()
    [2000.0, 2000.0, 5000.0, 0.5, 0.5, 0.4]
    >>> bend = section.law.stress(np.array([0, 0, 0, 2.0, 0, 0]))
    >>> float(bend[3].round(9))   # 0.5 * 2 + 0.4 * 2^3
    4.2

    Thrown while it spins about an axis across itself, it keeps its energy:

    >>> from skfem_cosserat import Beam, EnergyMomentum, MeshCurve, Model, NullSpace, simulate
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 1), 2)
    >>> spin = {"velocity": lambda x: np.cross((40.0, 0, 0), x), "angular_velocity": (40.0, 0, 0)}
    >>> model = Model()
    >>> rod = model.add("rod", Beam(mesh, section, order=2, director=(1, 0, 0), **spin))
    >>> history = simulate(model.freeze(), EnergyMomentum(), NullSpace(), 1e-3, until=0.02)
    >>> energy = history["energy"]
    >>> bool(abs(energy - energy[0]).max() < 1e-12 * energy[0])
    True
    """

    quadratic: ClassVar[bool] = False

    def __init__(
        self,
        energy: StrainFunction,
        mass: float,
        inertia: ArrayLike,
        outline: ArrayLike | None = None,
        viscosity: ArrayLike | None = None,
        centre: ArrayLike = (0.0, 0.0),
        *,
        gradient: StrainFunction | None = None,
        hessian: StrainFunction | None = None,
        strains: ArrayLike | None = None,
    ):
        law = stored_law(energy, gradient, hessian, strains)
        super().__init__(law.stiffness, mass, inertia, outline, viscosity, centre)
        self._law = law

    @property
    def law(self) -> Law:
        """Energy per length, resultants and their derivative as functions of strains."""
        return self._law


def stored_law(
    energy: StrainFunction,
    gradient: StrainFunction | None = None,
    hessian: StrainFunction | None = None,
    strains: ArrayLike | None = None,
) -> LawStored:
    """The law of a stored energy, checked; arguments as for :class:`SectionHyperelastic`."""
    given = {"energy": energy, "gradient": gradient, "hessian": hessian}
    for name, function in given.items():
        if not (callable(function) or (function is None and name != "energy")):
            raise InputError(ITEM, f"{name} = {function!r}, expected a function of strains")
    energy = of_points(energy, ())
    gradient = None if gradient is None else of_points(gradient, (6,))
    hessian = None if hessian is None else of_points(hessian, (6, 6))
    law = LawStored(energy, gradient, hessian, np.eye(6))
    zero = np.zeros((1, 6))
    rest = float(_finite("energy", law.energy, zero)[0])
    stress = _finite("gradient" if gradient else "energy", law.stress, zero)[0]
    scale = _scale(law)
    law = LawStored(energy, gradient, hessian, np.diag(scale**-2))
    points = _points(scale, strains)
    _check_calls(law, given, points)
    _compare(law, "gradient", points, made=gradient is None)
    axial = float(np.diag(difference(law.stress, zero, DIFFERENCE * scale)[0])[2])
    sizes = axial / scale
    if abs(rest) > AT_REST * axial:
        raise InputError(ITEM, f"energy at zero strain is {rest:g}, expected 0: take it off")
    if (abs(stress) > AT_REST * sizes).any():
        i = np.argmax(abs(stress) / sizes)
        raise InputError(
            ITEM,
            f"{STRESSES[i]} = {stress[i]:g} at zero strain: strains count from the reference, which"
            " has to be free of stress (an equilibrium under load is found by static(...))",
        )
    complex_step = hessian is None and gradient is not None and _analytic(law, points)
    law = LawStored(energy, gradient, hessian, np.diag(scale**-2), complex_step)
    _compare(law, "hessian", points)
    D = check_stiffness(f"{ITEM}, second derivative at zero strain", law.tangent(zero)[0])
    return LawStored(energy, gradient, hessian, D, complex_step, _noise(law))


def _noise(law: LawStored) -> float:
    """Rounding error of energies near zero strain, found against the mean stress on the way."""
    size = np.geomspace(1e-8, 1e-6, 64)[:, None]
    eps = size * law.scale * np.random.default_rng(2).uniform(-1, 1, (64, 6))
    mean = law.mean_stress(np.zeros_like(eps), eps)
    return float(abs(law.energy(eps) - (mean * eps).sum(-1)).max())


def _finite(name: str, function: StrainFunction, eps: Floats) -> Floats:
    """Values of a function that a user gave; what it cannot do is named."""
    out = function(eps)
    if not np.isfinite(out).all():
        rows = eps.reshape(-1, 6)
        bad = rows[np.flatnonzero(~np.isfinite(out.reshape(len(rows), -1)).all(1))[0]]
        raise InputError(
            ITEM,
            f"{name} is not finite at strains {_text(bad)}; give `strains` within the range"
            " where it is defined",
        )
    return out


def _text(strains: Floats) -> str:
    return f"[{', '.join(f'{x:.6g}' for x in strains)}]"


def _scale(law: LawStored) -> Floats:
    """Strains (6,) that have the energy of an axial strain of one, by stiffnesses at zero.

    Those of bending and torsion have a unit, so the step they are found by is found with them.
    """
    steps = np.full(6, 1e-6)
    for _ in range(8):
        moved = np.diag(steps)
        change = _finite("gradient", law.stress, np.concatenate([moved, -moved]))
        D = np.diag(change[:6] - change[6:]) / (2 * steps)
        if (D <= 0).any():
            check_stiffness(f"{ITEM}, second derivative at zero strain", D)
        new = 1e-6 * np.sqrt(D[2] / D)
        new[:3] = 1e-6
        if (abs(np.log(new / steps)) < np.log(2)).all():
            break
        steps = new
    return np.sqrt(D[2] / D)


def _points(scale: Floats, strains: ArrayLike | None) -> Floats:
    """Strains (k, 6) of the checks."""
    if strains is None:
        random = np.random.default_rng(1).uniform(-1, 1, (len(AMPLITUDES), 4, 6))
        return (np.array(AMPLITUDES)[:, None, None] * random * scale).reshape(-1, 6)
    points = numbers(ITEM, "strains", strains)
    if points.ndim != 2 or points.shape[1] != 6 or not len(points):
        raise InputError(ITEM, f"strains has shape {points.shape}, expected (k, 6)")
    if not np.isfinite(points).all():
        raise InputError(ITEM, f"strains = {points.tolist()} is not finite")
    return points


def _check_calls(law: LawStored, given: dict[str, Any], points: Floats) -> None:
    """Values depend on the strains and on nothing else: not on time, calls before, neighbours."""
    calls = {"energy": law.energy, "gradient": law.stress, "hessian": law.tangent}
    for name, function in calls.items():
        if given[name] is None:
            continue
        first = _finite(name, function, points)
        weight = _weight(name, law.scale)
        size = abs(first * weight).max()
        _finite(name, function, points[::-1].copy())
        others = {
            "called again": _finite(name, function, points),
            "called one by one": np.concatenate([_finite(name, function, p[None]) for p in points]),
            "called for a stack": _finite(name, function, np.stack([points, points]))[1],
            "called without a stack": np.stack([_finite(name, function, p) for p in points]),
        }
        for how, found in others.items():
            wrong = abs(found - first) * weight > 1e-9 * size
            if wrong.any():
                at = tuple(map(int, np.argwhere(wrong)[0]))
                raise InputError(
                    ITEM,
                    f"{name} at strains {_text(points[at[0]])} is {first[at]:.9g}, and"
                    f" {found[at]:.9g} when it is {how}: it may depend on these strains only",
                )


def _weight(name: str, scale: Floats) -> Floats:
    """Factors that give the entries of a function one unit."""
    if name == "energy":
        return np.ones(())
    return scale if name == "gradient" else np.outer(scale, scale)


def _differences(law: LawStored, name: str, points: Floats, found: Floats) -> Floats:
    """A derivative by differences; of those with several steps what is nearest to `found`.

    Where a higher derivative jumps large steps are wrong, where an energy has noise small ones.
    """
    function = law.energy if name == "gradient" else law.stress
    out = np.full_like(found, np.inf)
    for step in (DIFFERENCE, 0.1 * DIFFERENCE, 0.01 * DIFFERENCE):
        new = difference(function, points, step * law.scale)
        if name == "hessian":
            new = new.swapaxes(-1, -2)
        out = np.where(abs(new - found) < abs(out - found), new, out)
    return out


def _compare(law: LawStored, name: str, points: Floats, made: bool = False) -> None:
    """Name the worst entry of a derivative that is not that of the function it belongs to."""
    found = law.stress(points) if name == "gradient" else law.tangent(points)
    wanted = _differences(law, name, points, found)
    weight = _weight(name, law.scale)
    size = abs(wanted * weight).max(tuple(range(1, found.ndim)), keepdims=True)
    # what differences lose where the energy is large
    size = size + abs(law.energy(points)).max() * EPS / (DIFFERENCE * TOLERANCE)
    error = abs(found - wanted) * weight / size
    if error.max() <= TOLERANCE:
        return
    k, *entry = map(int, np.unravel_index(np.argmax(error), error.shape))
    of = "energy" if name == "gradient" else "gradient"
    if made:
        hint = (
            "energy is not analytic, as the complex step needs it to be (abs, comparisons,"
            " conversions to real numbers, with numba powers above 2?): give its gradient; worst"
        )
    else:
        hint = f"{name} is not the derivative of the {of}; worst"
    what = STRESSES[entry[0]] + (f" by strain {entry[1]}" if len(entry) == 2 else "")
    at = (k, *entry)
    raise InputError(
        ITEM,
        f"{hint} entry {entry if len(entry) == 2 else entry[0]} ({what}) at strains"
        f" {_text(points[k])}: {found[at]:.9g}, by differences of the {of} {wanted[at]:.9g}",
    )


def _analytic(law: LawStored, points: Floats) -> bool:
    """True if the complex step through a given gradient gives its derivative."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", np.exceptions.ComplexWarning)
        try:
            found = law.tangent(points)
        except (TypeError, ValueError, InputError):
            return False
    wanted = _differences(law, "hessian", points, found)
    weight = _weight("hessian", law.scale)
    error = abs(found - wanted) * weight
    return bool(error.max() <= TOLERANCE * abs(wanted * weight).max())
