"""Beams and loads in time by the names that the reference file gives their constants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc

import skfem_cosserat as sc

__all__ = ["SolidBeam", "beam", "bump", "halves", "pulse", "rise"]

Floats = NDArray[np.float64]


class SolidBeam(sc.Beam):
    """A beam with inertia along d3 too, which no plane section has.

    Parameters
    ----------
    third : float
        ``M_rho^3`` (kg m); the rest as for :class:`skfem_cosserat.Beam`.
    """

    def __init__(self, *args: Any, third: float, **options: Any) -> None:
        super().__init__(*args, **options)
        self.third = third

    def scalar_mass(self) -> Floats:
        """With the blocks of d3."""
        mass = super().scalar_mass()
        rows = 4 * np.arange(self.basis.order + 1) + 3
        shape = self.basis.elemental_mass()
        if self.lumped:
            shape = self.basis.elemental_load()[:, :, None] * np.eye(len(rows))
        mass[:, rows[:, None], rows] += self.third * shape
        return mass


def beam(
    mesh: sc.MeshCurve,
    data: Mapping[str, Any],
    order: int,
    e2: Sequence[float],
    **options: Any,
) -> sc.Beam:
    """A beam with the constants ``EA, GA, EI, GJ, A_rho, J_rho`` of `data`, and other options.

    There e1 is along the beam, here d3 is: (d1, d2, d3) = (e2, e3, e1). ``GA`` and ``EI`` are one
    number or those of e2 and e3; ``J_rho`` holds the moments of inertia about e1, e2, e3, or about
    e1 and both others, or all equal.
    """
    J1, J2, J3 = _inertia(data["J_rho"])
    along = ((J1 + J3 - J2) / 2, (J1 + J2 - J3) / 2)
    third = (J2 + J3 - J1) / 2
    section = sc.Section.from_constants(
        EA=data["EA"],
        GA=_pair(data["GA"]),
        EI=_pair(data["EI"]),
        GJ=data["GJ"],
        mass=data["A_rho"],
        inertia=along,
    )
    if abs(third) <= 1e-9 * max(J1, J2, J3):
        return sc.Beam(mesh, section, order=order, director=tuple(e2), **options)
    if third < 0:
        raise sc.InputError("data", f"J_rho = {data['J_rho']!r}: no section has it, J2 + J3 < J1")
    return SolidBeam(mesh, section, order=order, director=tuple(e2), third=third, **options)


def _pair(value: Any) -> tuple[float, float]:
    first, second = np.broadcast_to(np.asarray(value, dtype=float), 2)
    return float(first), float(second)


def _inertia(value: Any) -> tuple[float, float, float]:
    J = np.atleast_1d(np.asarray(value, dtype=float))
    J = np.diag(J) if J.shape == (3, 3) else J
    if J.shape not in ((1,), (2,), (3,)):
        raise sc.InputError("data", f"J_rho = {value!r}, expected one, two or three numbers")
    J1, J2, J3 = (J[0], J[-1], J[-1]) if len(J) < 3 else J
    return float(J1), float(J2), float(J3)


def halves(start: Sequence[float], end: Sequence[float], elements: int, order: int) -> sc.MeshCurve:
    """A line of any number of elements with a node ``mid`` in its middle."""
    whole = isinstance(elements, int | np.integer) and elements > 1 and elements % 2 == 1
    if whole:
        mid = (np.array(start, dtype=float) + np.array(end, dtype=float)) / 2
        counts = ((elements + 1) // 2, elements // 2)
        corners = np.array([start, mid, end], dtype=float)
        return sc.MeshCurve.init_polyline(corners, counts, name="rod")
    if elements == 1 and order % 2:
        raise sc.InputError("elements", f"1 of order {order} has no node in its middle, take two")
    return sc.MeshCurve.init_line(start, end, elements, name="rod")


def bump(peak: float, until: float) -> sc.FunctionOfTime:
    """``peak (4 x (1 - x))^6``, x = t/until: five derivatives vanish at both ends."""
    return sc.FunctionOfTime(
        lambda t: peak * (4 * t / until * (1 - t / until)) ** 6 if 0 < t < until else 0.0,
        kinks=(0.0, until),
    )


def rise(until: float) -> sc.FunctionOfTime:
    """From 0 to 1, five derivatives vanish at both ends."""
    return sc.FunctionOfTime(
        lambda t: float(betainc(6, 6, min(max(t / until, 0.0), 1.0))), kinks=(0.0, until)
    )


def pulse(data: Mapping[str, Any]) -> tuple[Any, tuple[float, ...]]:
    """``pulse``: a triangle with ``peak`` at ``t_peak`` up to ``t_end``, or a bump; its kinks."""
    peak, middle, end = data["peak"], data["t_peak"], data["t_end"]
    if data["pulse"] == "bump":
        return bump(peak, end), (end,)
    if data["pulse"] != "triangle":
        raise sc.InputError("data", f"pulse = {data['pulse']!r}, expected 'triangle' or 'bump'")
    if not 0 < middle < end:
        raise sc.InputError("data", f"t_peak = {middle} is not before t_end = {end}")
    return sc.Table([0, middle, end], [0, peak, 0]), (middle, end)
