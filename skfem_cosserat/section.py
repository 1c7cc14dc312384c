"""Cross-sections: what a beam's constitutive law and inertia need, per unit of arc length.

Order of strains everywhere: ``(Gamma_1, Gamma_2, Gamma_3, K_1, K_2, K_3)``: shear along d1 and d2,
axial; bending about d1 and d2, torsion about d3 (the tangent of the reference line).
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from .errors import InputError, ModelWarning
from .frozen import Frozen, loosened, seal
from .law import Law, LawQuadratic
from .types import (
    Array,
    ArrayLike,
    Floats,
    check_kind,
    not_negative,
    numbers,
    positive,
    real,
    shaped,
    symmetric,
)
from .warn import warn

#: relative error of constants that were typed in
TYPED = 0.01


def all_positive(item: str, **values: float) -> None:
    """Check positive finite numbers, named."""
    for name, value in values.items():
        positive(item, name, value)


@dataclass(frozen=True, repr=False)
class Material(Frozen):
    """Isotropic linear elastic material.

    Parameters
    ----------
    E : float
        Young's modulus (N/m^2).
    nu : float
        Poisson's ratio, in (-1, 0.5].
    rho : float
        Density (kg/m^3).

    Examples
    --------
    >>> round(Material(E=210e9, nu=0.3, rho=7850).G / 1e9, 3)
    80.769
    """

    E: float
    nu: float
    rho: float

    def __post_init__(self) -> None:
        all_positive("material", E=self.E, rho=self.rho)
        if not -1 < real("material", "nu", self.nu, "-1 < nu <= 0.5") <= 0.5:
            raise InputError("material", f"nu = {self.nu!r}, expected -1 < nu <= 0.5")
        super().__post_init__()

    @property
    def G(self) -> float:
        """Shear modulus ``E / (2 (1 + nu))`` (N/m^2)."""
        return self.E / (2 * (1 + self.nu))


def _matrix(item: str, name: str, value: ArrayLike) -> Floats:
    """(6, 6), from six numbers its diagonal; finite."""
    out = shaped(item, name, value, (6,), (6, 6))
    return np.diag(out) if out.ndim == 1 else out


def check_stiffness(item: str, value: ArrayLike) -> Floats:
    """Symmetric positive definite (6, 6)."""
    D = _matrix(item, "stiffness", value)
    diagonal = np.diag(D)
    if (diagonal <= 0).any():
        names = ("GA_1", "GA_2", "EA", "EI_1", "EI_2", "GJ")
        k = int(diagonal.argmin())
        raise InputError(
            item,
            f"{names[k]} = {diagonal[k]:g}: a section without stiffness against one of its"
            " strains leaves the beam a mechanism; expected six positive stiffnesses",
        )
    D = symmetric(item, "stiffness", D)
    scale = 1 / np.sqrt(diagonal)
    lowest = float(np.linalg.eigvalsh(D * scale[:, None] * scale)[0])
    if lowest <= 1e-14:
        raise InputError(
            item, f"stiffness is not positive definite: lowest scaled eigenvalue {lowest:.3g}"
        )
    return D


def _viscosity(value: ArrayLike, D: Floats) -> Floats:
    """Symmetric positive semidefinite, measured in units of the stiffness D."""
    item = "section"
    eta = symmetric(item, "viscosity", _matrix(item, "viscosity", value))
    scale = 1 / np.sqrt(np.diag(D))
    times = np.linalg.eigvalsh(eta * scale[:, None] * scale)  # retardation times
    if times[0] < -1e-12 * max(times[-1], 0.0):
        raise InputError(
            item,
            f"viscosity = {eta.tolist()} is not positive semidefinite: lowest retardation time"
            f" {times[0]:.3g} s, it would feed energy",
        )
    return eta


def _inertia(item: str, value: ArrayLike, mass: float, centre: Floats) -> Floats:
    """(2,) or symmetric (2, 2), positive semidefinite about the centre of mass."""
    out = shaped(item, "inertia", value, (2,), (2, 2))
    out = symmetric(item, "inertia", out) if out.ndim == 2 else out
    moments = np.diag(out) if out.ndim == 1 else out
    steiner = mass * np.outer(centre, centre)
    own = moments - steiner
    scale = max(abs(moments).max(), abs(steiner).max())
    lowest = float(np.linalg.eigvalsh(own)[0])
    if lowest < -1e-12 * scale:
        raise InputError(
            item,
            f"inertia = {out.tolist()} is impossible: about the centre of mass at"
            f" {centre.tolist()} it is {own.tolist()}, with the eigenvalue {lowest:.3g}; inertia"
            " is taken about the reference line, where mass times centre squared belongs to it",
        )
    return out


class Section(Frozen):
    """Section given by its constants, up to a full 6x6 stiffness.

    Its stored energy is quadratic; :class:`SectionHyperelastic` takes any other. An own kind of
    section derives from it and gives its constructor the constants.

    Parameters
    ----------
    stiffness : (6, 6) or (6,) array
        Symmetric positive definite ``D`` with ``(N, M) = D (Gamma, K)``; six numbers are taken
        for its diagonal ``(GA_1, GA_2, EA, EI_1, EI_2, GJ)`` (N and N m^2).
    mass : float
        Mass per length ``A_rho`` (kg/m).
    inertia : (2,) or (2, 2) array
        ``(M_rho^1, M_rho^2)``, the inertia *along* d1 and d2: ``int rho X_k^2 dA`` (kg m). They
        multiply the rates of d1 and d2, equation (114) of Leyendecker, Marsden & Ortiz (2008).
        Or symmetric with the product of inertia, ``int rho X_i X_j dA``. About the reference
        line, wherever the centre of mass is.
    outline : (k, 2) array, optional
        Closed polygon ``(X_1, X_2)`` (m) used to draw the beam; it has no influence on results.
    viscosity : (6, 6) or (6,) array, optional
        Kelvin-Voigt damping: symmetric positive semidefinite ``eta`` (N s and N m^2 s) in
        ``(N, M) = D eps + eta deps/dt``, ``eps = (Gamma, K)``; six numbers are taken for its
        diagonal, default zero. See also :meth:`damped`.
    centre : (2,) array, optional
        Centre of mass ``(X_1, X_2)`` relative to the reference line (m), default on it. Gravity
        acts there; line loads act at the reference line.

    Raises
    ------
    InputError
        If a number is not finite, the stiffness is not symmetric positive definite, the inertia
        about the centre of mass not positive semidefinite, or the viscosity not symmetric
        positive semidefinite.

    Examples
    --------
    >>> s = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> s.stiffness.shape
    (6, 6)

    2 kg/m of which all is 0.1 m above the reference line:

    >>> s = Section(np.ones(6), 2.0, [[0.01, 0], [0, 0.03]], centre=(0, 0.1))
    >>> s.density.tolist()
    [[2.0, 0.0, 0.2], [0.0, 0.01, 0.0], [0.2, 0.0, 0.03]]
    """

    def __init__(
        self,
        stiffness: ArrayLike,
        mass: float,
        inertia: ArrayLike,
        outline: ArrayLike | None = None,
        viscosity: ArrayLike | None = None,
        centre: ArrayLike = (0.0, 0.0),
    ):
        item = "section"
        D = check_stiffness(item, stiffness)
        all_positive(item, mass=mass)
        offset = shaped(item, "centre", centre, (2,))
        moments = _inertia(item, inertia, float(mass), offset)
        shape = None
        if outline is not None:
            shape = numbers(item, "outline", outline)
            shape = shaped(item, "outline", shape, (*shape.shape[:1], 2))
        self.stiffness, self.mass, self.inertia = D, float(mass), moments
        self.outline = shape
        self.centre = offset
        self.viscosity = np.zeros((6, 6)) if viscosity is None else _viscosity(viscosity, D)
        self._warn_of_exchange()

    def _warn_of_exchange(self) -> None:
        """Say that both moments of inertia look like those about d1, d2, not along them.

        Of a homogeneous section EI_1 over the inertia along d2 is EA over the mass.
        """
        _, _, EA, *EI, _ = np.diag(self.stiffness)
        moments = np.diag(self.density)[1:]
        unit = EA / self.mass / np.array(EI)
        about = abs(unit * moments - 1)
        along = abs(unit * moments[::-1] - 1)
        if about.max() < TYPED and along.min() > 10 * TYPED:
            warn(
                "section",
                f"inertia = {moments.tolist()} looks like the moments about d1 and d2: those along"
                f" them, which are meant, are {moments[::-1].tolist()} if the section is"
                " homogeneous; exchange them",
                ModelWarning,
            )

    _remedy = "make another one, and a beam of it"

    #: arguments of the constructor by name: those that a :class:`SectionTaper` changes, all others
    dimensions: tuple[tuple[str, float], ...] = ()
    others: tuple[tuple[str, Any], ...] = ()

    def _parts(self) -> Iterator[tuple[str, Any]]:
        constants = np.diag(self.stiffness)
        yield from (("GA", constants[:2]), ("EA", constants[2]), ("EI", constants[3:5]))
        yield from (("GJ", constants[5]), ("mass", self.mass))

    _units: ClassVar[dict[str, str]] = {
        "GA": "N",
        "EA": "N",
        "EI": "N m²",
        "GJ": "N m²",
        "mass": "kg/m",
    }

    def summary(self) -> dict[str, Any]:
        """Stiffnesses, mass, damping."""
        times = np.diag(self.viscosity) / np.diag(self.stiffness)
        return super().summary() | {"retardation times in s": times if times.any() else None}

    def _loops(self) -> list[Floats]:
        return self.skin

    @property
    def density(self) -> Floats:
        """Mass (3, 3) per length of ``(phi, d1, d2)``, without the factor I_3 (kg/m, kg, kg m)."""
        out = np.empty((3, 3))
        out[0, 0] = self.mass
        out[0, 1:] = out[1:, 0] = self.mass * self.centre
        out[1:, 1:] = np.diag(self.inertia) if self.inertia.ndim == 1 else self.inertia
        return out

    #: whether the stored energy is that of the stiffness
    quadratic: ClassVar[bool] = True

    @property
    def law(self) -> Law:
        """Energy per length, resultants and their derivative as functions of strains."""
        return LawQuadratic(self.stiffness)

    #: closed polygons (k, 2) around the holes of a hollow section (m)
    holes: tuple[Floats, ...] = ()

    @property
    def skin(self) -> list[Floats]:
        """Closed polygons (k, 2) of its surface (m): outline and holes; none without an outline.

        With points between the corners, if there are few.
        """
        out = []
        for loop in () if self.outline is None else (self.outline, *self.holes):
            ends = loop, np.roll(loop, -1, axis=0)
            between = np.linspace(*ends, -(-AROUND // len(loop)), endpoint=False, axis=1)
            out.append(between.reshape(-1, 2))
        return out

    def skin_stresses(self) -> Floats | None:
        """Stresses at the points of the :attr:`skin`, for resultants of one.

        Returns
        -------
        (k, 3, 6) array or None
            ``(sigma_33, tau_13, tau_23)`` by ``(N_1, N_2, N_3, M_1, M_2, M_3)``
            (1/m^2, 1/m^3). Those of Saint-Venant's solutions: by closed forms and series of
            rectangles, circles and tubes, by the warping of a profile. None for sections that are
            given by numbers.

        Examples
        --------
        >>> bar = SectionRectangle(0.1, 0.2, Material(1.0, 0.3, 1.0))
        >>> sigma = bar.skin_stresses()[:, 0] @ [0, 0, 1.0, 0, 0, 0]
        >>> bool(np.allclose(sigma, 1 / 0.02))
        True
        """
        return None

    def damped(self, time: float | None = None, viscosity: ArrayLike | None = None) -> Self:
        """A copy with Kelvin-Voigt damping, in place of any it had.

        Parameters
        ----------
        time : float
            Retardation time tau (s), not negative: ``viscosity = tau * stiffness``, which damps a
            vibration of angular frequency omega by the ratio ``tau omega/2`` of critical damping.
        viscosity : (6, 6) or (6,) array
            In place of a time, see :class:`Section`.

        Returns
        -------
        Section
            Of the same kind.

        Raises
        ------
        InputError
            If not exactly one of both is given; if the time is negative or not finite, the
            viscosity not symmetric positive semidefinite.

        Examples
        --------
        >>> rubber = SectionCircle(0.005, Material(5e6, 0.5, 1100)).damped(time=2e-3)
        >>> bool(rubber.viscosity[2, 2] == 2e-3 * rubber.stiffness[2, 2])
        True
        """
        item = "section"
        if (time is None) == (viscosity is None):
            raise InputError(
                item, f"time = {time!r}, viscosity = {viscosity!r}, expected one of them"
            )
        if viscosity is None:
            viscosity = not_negative(item, "time", time) * self.stiffness
        out = loosened(copy(self))
        out.viscosity = _viscosity(viscosity, self.stiffness)
        return seal(out)

    @classmethod
    def from_constants(
        cls,
        *,
        EA: float,
        GA: float | tuple[float, float],
        EI: tuple[float, float],
        GJ: float,
        mass: float,
        inertia: ArrayLike,
        outline: ArrayLike | None = None,
        viscosity: ArrayLike | None = None,
        centre: ArrayLike = (0.0, 0.0),
    ) -> Section:
        """Section from engineering constants.

        Parameters
        ----------
        EA, GJ : float
            Axial (N) and torsional (N m^2) stiffness.
        GA : float or (GA_1, GA_2)
            Shear stiffness along d1 and d2 (N).
        EI : (EI_1, EI_2)
            Bending stiffness about d1 and d2 (N m^2).
        mass, inertia, outline, viscosity, centre
            As for :class:`Section`.

        Examples
        --------
        >>> s = Section.from_constants(EA=1e4, GA=5e3, EI=(2., 3.), GJ=1., mass=1., inertia=(0, 0))
        >>> s.stiffness.diagonal().tolist()
        [5000.0, 5000.0, 10000.0, 2.0, 3.0, 1.0]
        """
        shear = np.broadcast_to(shaped("section", "GA", GA, (), (2,)), 2)
        D = [*shear, EA, *shaped("section", "EI", EI, (2,)), GJ]
        return Section(D, mass, inertia, outline, viscosity, centre)


def _solid(
    material: Material,
    area: float,
    about: tuple[float, float],
    J: float,
    kappa: float,
) -> tuple[list[float], float, tuple[float, float]]:
    """Stiffness diagonal, mass and inertia of a homogeneous section.

    ``about = (int X_2^2 dA, int X_1^2 dA)``: second moments *about* d1 and d2.
    """
    E, G, rho = material.E, material.G, material.rho
    shear = kappa * G * area
    return (
        [shear, shear, E * area, E * about[0], E * about[1], G * J],
        rho * area,
        (rho * about[1], rho * about[0]),  # inertia along d1 is the second moment about d2
    )


#: points of an outline of few corners, for stresses between them
AROUND = 16


def _stresses(section: Section, E: float) -> tuple[Floats, Floats]:
    """Points (k, 2) of the skin, and stresses (k, 3, 6) of axial force and bending there."""
    x, (_, _, EA, *EI, _) = np.concatenate(section.skin), np.diag(section.stiffness)
    out = np.zeros((len(x), 3, 6))
    out[:, 0, 2] = E / EA
    out[:, 0, 3:5] = E * x[:, ::-1] / EI * (1, -1)
    return x, out


#: terms of series, whose rest is about 1/TERMS of the largest stress, and less off the corners
TERMS = 4000


def _series(n: Array, z: Array, end: float) -> Array:
    """Sum of ``cosh(n z) / (n^2 cosh(n end))`` over n (m,) at points z = x + i y (k,)."""
    n = n[:, None]
    falling = np.exp(n * (z - end)) + np.exp(-n * (z + end))
    return (falling / (1 + np.exp(-2 * n * end)) / n**2).sum(0)


def _twist(at: Floats, A: float, B: float) -> Floats:
    """Stress (k,) along x by twist and shear modulus of one, at points (2, k).

    In the rectangle |x| <= A, |y| <= B.

    Timoshenko & Goodier, Theory of Elasticity, section 109, with the series that falls off from
    the edges |x| = A.
    """
    (x, y), n = at, np.arange(1, 2 * TERMS, 2) * np.pi / (2 * B)
    return 4 / B * _series(n, x + 1j * (y - B), A).real - 2 * y


def _flexure(at: Floats, A: float, B: float, nu: float) -> Floats:
    """Stresses (k, 2) along x and y by a shear force of one along x, in the same rectangle.

    Timoshenko & Goodier, section 124.
    """
    x, y = at
    rest = _series(np.arange(1, TERMS) * np.pi / B, x + 1j * (y - B), A)
    warped = (3 * y**2 - B**2) / 6 - 2 * rest.real + 2j * rest.imag
    both = (A**2 - x**2) / 2 + nu / (1 + nu) * warped
    return np.column_stack([both.real, both.imag]) * 3 / (4 * A**3 * B)


class SectionRectangle(Section):
    """Solid rectangle.

    Parameters
    ----------
    a, b : float
        Edges along d1 and d2 (m).
    material : Material
    shear_factor : float
        Applied to both shear stiffnesses; 5/6 by default.

    Notes
    -----
    Torsion constant by the Saint-Venant series (Timoshenko & Goodier, Theory of Elasticity,
    section 109), summed to round-off.

    Examples
    --------
    >>> s = SectionRectangle(0.01, 0.02, Material(210e9, 0.3, 7850))
    >>> round(s.mass, 3)
    1.57
    """

    def __init__(self, a: float, b: float, material: Material, shear_factor: float = 5 / 6):
        all_positive("rectangle", a=a, b=b, shear_factor=shear_factor)
        check_kind("rectangle, material", material, Material)
        short = min(a, b)
        long = max(a, b)
        k = np.arange(1, 400, 2)
        series = (np.tanh(k * np.pi * long / (2 * short)) / k**5.0).sum()
        J = long * short**3 * (1 / 3 - 64 / np.pi**5 * short / long * series)
        moments = (a * b**3 / 12, b * a**3 / 12)
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (a / 2, b / 2)
        super().__init__(*_solid(material, a * b, moments, float(J), shear_factor), corners)
        self.dimensions = ("a", a), ("b", b)
        self.others = ("material", material), ("shear_factor", shear_factor)

    def skin_stresses(self) -> Floats:
        """See :meth:`Section.skin_stresses`."""
        ((_, a), (_, b)), ((_, material), _) = self.dimensions, self.others
        x, out = _stresses(self, material.E)
        rate = material.G / self.stiffness[5, 5]
        for k, one, A, B in (0, x.T, a / 2, b / 2), (1, x.T[::-1], b / 2, a / 2):
            out[:, 1 + k, 5] = (-1) ** k * rate * _twist(one, A, B)
            out[:, [1 + k, 2 - k], k] = _flexure(one, A, B, material.nu)
        return out


class SectionTube(Section):
    """Circular tube.

    Parameters
    ----------
    outer, inner : float
        Radii (m), ``0 <= inner < outer``.
    material : Material
    shear_factor : float, optional
        Default: Cowper's ``6 (1+nu)(1+m^2)^2 / ((7+6 nu)(1+m^2)^2 + (20+12 nu) m^2)``,
        ``m = inner/outer`` (J. Appl. Mech. 33 (1966) 335).

    Examples
    --------
    >>> s = SectionTube(0.05, 0.04, Material(70e9, 0.3, 2700))
    >>> bool(s.stiffness[3, 3] == s.stiffness[4, 4])
    True
    """

    def __init__(
        self, outer: float, inner: float, material: Material, shear_factor: float | None = None
    ):
        others = ("material", material), ("shear_factor", shear_factor)
        all_positive("tube", outer=outer)
        check_kind("tube, material", material, Material)
        if not 0 <= inner < outer:
            raise InputError("tube", f"inner = {inner!r}, expected 0 <= inner < outer = {outer!r}")
        if shear_factor is None:
            nu = material.nu
            m2 = (inner / outer) ** 2
            square = (1 + m2) ** 2
            shear_factor = 6 * (1 + nu) * square / ((7 + 6 * nu) * square + (20 + 12 * nu) * m2)
        all_positive("tube", shear_factor=shear_factor)
        area = np.pi * (outer**2 - inner**2)
        moments = np.pi / 4 * (outer**4 - inner**4)
        angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        circle = outer * np.column_stack([np.cos(angle), np.sin(angle)])
        constants = _solid(material, area, (moments, moments), 2 * moments, shear_factor)
        super().__init__(*constants, circle)
        self.dimensions = (("outer", outer), ("inner", inner))
        self.others = others

        self.holes = (circle[::-1] * (inner / outer),) if inner else ()
        self._radii = outer, inner

    def skin_stresses(self) -> Floats:
        """See :meth:`Section.skin_stresses`."""
        material, (a, b) = dict(self.others)["material"], self._radii
        x, out = _stresses(self, material.E)
        twice = 2 * self.stiffness[3, 3] / material.E
        nu = material.nu
        out[:, 1:, 5] = x[:, ::-1] / twice * (-1, 1)
        # Love, Mathematical Theory of Elasticity, chapter 15
        square = (x**2).sum(1)[:, None, None]
        size = (3 + 2 * nu) / 4
        hole = size * (a * b) ** 2 / square
        even = size * (a**2 + b**2 + square) - square + hole
        pairs = (1 - 2 * size - 2 * hole / square) * x[:, :, None] * x[:, None]
        out[:, 1:, :2] = (even * np.eye(2) + pairs) / (twice * (1 + nu))
        return out


class SectionCircle(SectionTube):
    """Solid circle: a tube without a hole.

    Parameters
    ----------
    radius : float
        Radius (m).
    material : Material
    shear_factor : float, optional
        Default: Cowper's ``6 (1+nu)/(7+6 nu)``.

    Examples
    --------
    >>> round(SectionCircle(0.005, Material(5e6, 0.5, 1100)).mass, 5)
    0.08639
    """

    def __init__(self, radius: float, material: Material, shear_factor: float | None = None):
        all_positive("circle", radius=radius)
        check_kind("circle, material", material, Material)
        if shear_factor is not None:
            all_positive("circle", shear_factor=shear_factor)
        super().__init__(radius, 0.0, material, shear_factor)
        self.dimensions = (("radius", radius),)
