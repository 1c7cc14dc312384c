"""Sections that vary along a beam: as functions of arc length, tables, tapers."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from copy import copy
from typing import Any, Literal

import numpy as np

from .along import BEYOND, Stations
from .errors import InputError
from .frozen import Frozen, loosened, seal
from .kernels import SectionPoints
from .section import Section
from .theory import LawHeld, released
from .types import SAME, Array, ArrayLike, Floats, IndexArray, not_negative, numbers, switch


class SectionField(Frozen):
    """Sections along the line of a beam or of a named part of it.

    Derive from it and write :meth:`at`; a function of the arc length does as well.
    """

    #: retardation time (s) of all sections, see :meth:`damped`
    time: float = 0.0

    @abstractmethod
    def at(self, s: float, length: float) -> Section:
        """The section at an arc length.

        Parameters
        ----------
        s : float
            Arc length from the start of the part (m).
        length : float
            That of the whole part (m).
        """

    def inside(self, e: int, xi: float, s: float, length: float) -> Section:
        """The section, damped, at xi of an element, which is at an arc length."""
        found = self.at(float(s), float(length))
        return found.damped(self.time) if self.time else found

    def damped(self, time: float) -> SectionField:
        """The same sections with Kelvin-Voigt damping, see :meth:`Section.damped`.

        Parameters
        ----------
        time : float
            Retardation time (s), not negative.
        """
        other = loosened(copy(self))
        other.time = not_negative("section", "time", time)
        return seal(other)

    def kinks(self, length: float) -> Floats:
        """Arc lengths (k,) where the section has a kink or a jump, of a part of this length (m)."""
        return np.zeros(0)


class SectionAlong(SectionField):
    """Sections by a function.

    Parameters
    ----------
    function : callable
        Gives a :class:`Section` for an arc length (m) from the start of the beam or of its part,
        or for the share of its length, 0 to 1.
    share : bool
        Whether it takes the share.

    Examples
    --------
    >>> from skfem_cosserat import Material, SectionCircle
    >>> material = Material(70e9, 0.3, 2700)
    >>> field = SectionAlong(lambda s: SectionCircle(0.02 - 0.005 * s, material))
    >>> float(field.at(2.0, 3.0).outline.max().round(6))
    0.01
    """

    def __init__(self, function: Callable[[float], Section], share: bool = False):
        if not callable(function):
            raise InputError("section", f"function = {function!r}, expected a callable")
        self.function = function
        self.share = switch("section", share, "share")

    def at(self, s: float, length: float) -> Section:
        """The section that the function gives; InputError if it gives something else."""
        place = s / length if self.share else s
        found = self.function(place)
        if not isinstance(found, Section):
            raise InputError("section", f"of {place:.6g} is {found!r}, not a Section")
        return found


class SectionTaper(SectionField):
    """Sections whose dimensions change evenly from the start of a beam, or part, to its end.

    Parameters
    ----------
    first, last : SectionRectangle, SectionTube or SectionCircle
        Both of the same kind and of one material. Own kinds name their `dimensions`.

    Raises
    ------
    InputError
        If they differ in more than their dimensions, or are damped: see :meth:`damped`.

    Examples
    --------
    >>> from skfem_cosserat import Material, SectionTube
    >>> material = Material(70e9, 0.3, 2700)
    >>> mast = SectionTaper(SectionTube(0.2, 0.19, material), SectionTube(0.1, 0.09, material))
    >>> float(mast.at(5.0, 10.0).outline.max().round(6))
    0.15
    """

    def __init__(self, first: Section, last: Section):
        item = "section taper"
        if type(first) is not type(last) or not getattr(first, "dimensions", ()):
            raise InputError(
                item,
                f"first = {first!r}, last = {last!r}, expected two of one kind that has dimensions,"
                " as SectionTube; others take a SectionTable, or a function of the arc length",
            )
        for (name, here), (_, there) in zip(first.others, last.others, strict=True):
            if here != there:
                raise InputError(item, f"{name} = {here!r} at the start, {there!r} at the end")
        if first.viscosity.any() or last.viscosity.any():
            raise InputError(item, "its ends are damped: damp the taper, by .damped(time)")
        self.first = first
        self.last = last

    def at(self, s: float, length: float) -> Section:
        """The section with the dimensions there."""
        x = s / length
        ends = zip(self.first.dimensions, self.last.dimensions, strict=True)
        own = {name: (1 - x) * a + x * b for (name, a), (_, b) in ends}
        return type(self.first)(**own, **dict(self.first.others))


class SectionTable(SectionField):
    """Sections by numbers at stations along a beam, or part, with what lies between.

    Parameters
    ----------
    s : (k,) array
        Arc lengths of the stations (m), increasing, from the start of the part to its end.
    stiffness : (k, 6, 6) or (k, 6) array
        As for :class:`Section`, of each station; of six numbers, their diagonals.
    mass : (k,) array
        Mass per length (kg/m).
    inertia : (k, 2) or (k, 2, 2) array
        About the reference line (kg m).
    centre : (k, 2) array, optional
        Centres of mass (m).
    viscosity : (k, 6, 6) or (k, 6) array, optional
        Kelvin-Voigt damping.
    outline : (k, m, 2) array, optional
        Polygons to draw (m).
    interpolation : "linear" or "pchip"
        Between stations; scipy's PchipInterpolator is smooth and keeps the order of its values.

    Raises
    ------
    InputError
        If an array has not the shape of the stations, these do not increase, or a station's
        numbers are no section. A beam says so where the table does not reach along it.

    Notes
    -----
    A linear table has a kink at each station: a beam converges with its full order only if it has
    nodes there, as :meth:`MeshCurve.at` makes them.

    Examples
    --------
    >>> table = SectionTable([0, 2], [[2e4] * 6, [1e4] * 6], [2.0, 1.0], [[0.1, 0.1]] * 2)
    >>> table.at(0.5, 2.0).mass
    1.75
    """

    def __init__(
        self,
        s: ArrayLike,
        stiffness: ArrayLike,
        mass: ArrayLike,
        inertia: ArrayLike,
        centre: ArrayLike | None = None,
        viscosity: ArrayLike | None = None,
        outline: ArrayLike | None = None,
        interpolation: Literal["linear", "pchip"] = "linear",
    ):
        item = "section table"
        if interpolation not in ("linear", "pchip"):
            text = f"interpolation = {interpolation!r}, expected 'linear' or 'pchip'"
            raise InputError(item, text)
        given = {
            "stiffness": stiffness,
            "mass": mass,
            "inertia": inertia,
            "centre": centre,
            "viscosity": viscosity,
            "outline": outline,
        }
        arrays = {k: numbers(item, k, value) for k, value in given.items() if value is not None}
        count = np.size(s)
        for name, array in arrays.items():
            if len(np.atleast_1d(array)) != count:
                text = f"{name} has shape {array.shape}, expected one entry for each of the"
                raise InputError(item, f"{text} {count} stations")
        self._shapes = {name: array.shape[1:] for name, array in arrays.items()}
        parts = [a.reshape((count, int(np.prod(a.shape[1:])))) for a in arrays.values()]
        self._ends = np.cumsum([part.shape[1] for part in parts])[:-1]
        flat = np.hstack(parts)
        self._stations = Stations(item, s, flat, interpolation == "pchip")
        self.s = self._stations.s
        self.interpolation = interpolation
        for k, place in enumerate(self.s):
            try:
                self.at(place, self.s[-1])
            except InputError as error:
                raise InputError(item, f"station {k} at s = {place:.6g} m: {error}") from error

    def at(self, s: float, length: float) -> Section:
        """The section between its stations; InputError if these do not reach along the part."""
        parts = np.split(self._stations.at(np.array(s), length), self._ends)
        shaped: dict[str, Any] = {
            name: part.reshape(shape) if shape else float(part[0])
            for (name, shape), part in zip(self._shapes.items(), parts, strict=True)
        }
        return Section(**shaped)

    def kinks(self, length: float) -> Floats:
        """Stations of a linear table at which a number has another slope."""
        if self.interpolation == "pchip":
            return np.zeros(0)
        values = self._stations.values
        slopes = np.diff(values, axis=0) / np.diff(self.s)[:, None]
        size = abs(values).max(0) / (self.s[-1] - self.s[0])
        return self.s[1:-1][(abs(np.diff(slopes, axis=0)) > BEYOND * size).any(1)]


class SectionSampled(SectionField):
    """Sections of the elements of a beam that came from another process, where functions stay.

    Parameters
    ----------
    xi : (k,) array
        Reference coordinates at which the sections of all elements are known.
    sections : (ne, k) array of Section
    """

    def __init__(self, xi: Floats, sections: Array):
        self.xi = xi
        self.sections = sections

    def at(self, s: float, length: float) -> Section:
        """InputError: arc lengths are not known here."""
        raise InputError("section", "came from another process, where its function is not known")

    def inside(self, e: int, xi: float, s: float, length: float) -> Section:
        """The section at xi of an element; between known places its numbers are polynomials."""
        from .element import lagrange  # imports scikit-fem

        row = self.sections[e]
        near = int(abs(self.xi - xi).argmin())
        if abs(self.xi[near] - xi) < SAME or not row[near].quadratic:
            return row[near]
        weights = lagrange(self.xi, xi)
        stiffness, viscosity, density = (
            np.tensordot(weights, [getattr(each, name) for each in row], 1)
            for name in ("stiffness", "viscosity", "density")
        )
        mass = float(density[0, 0])
        centre = density[0, 1:] / mass
        return Section(stiffness, mass, density[1:, 1:], row[near].outline, viscosity, centre)


def distinct(sections: Array) -> tuple[list[Section], IndexArray]:
    """The sections of an array (...) of objects, each once, and which of them is where."""
    kinds = {id(each): each for each in sections.flat}
    place = {key: k for k, key in enumerate(kinds)}
    number = np.array([place[id(each)] for each in sections.flat])
    return list(kinds.values()), number.reshape(sections.shape)


def section_points(sections: Array, held: tuple[int, ...]) -> SectionPoints:
    """What sections (...), an array of objects, resist with; `held`: strains that are held."""
    kinds, number = distinct(sections)
    stiffness, viscosity = (  # what resists held strains are constraint forces
        released(np.array([getattr(each, name) for each in kinds]), held)[number]
        for name in ("stiffness", "viscosity")
    )
    laws = tuple(each.law for each in kinds if not each.quadratic)
    general = np.array([not each.quadratic for each in kinds])
    return SectionPoints(
        stiffness=stiffness,
        viscosity=viscosity if viscosity.any() else None,
        laws=tuple(LawHeld(law, held) for law in laws) if held else laws,
        law_of=np.where(general, general.cumsum() - 1, -1)[number] if laws else None,
    )
