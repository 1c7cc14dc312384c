"""Damping of whole items in proportion to their mass and stiffness."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from .errors import InputError
from .frames import Item, StructuralItem, is_beam
from .types import ArrayLike, not_negative, numbers


class RayleighDamping(Item):
    """Rayleigh damping: forces ``-alpha M v`` on masses, and viscosity ``beta D`` of sections.

    A vibration of angular frequency omega is damped by the ratio
    ``alpha/(2 omega) + beta omega/2`` of critical damping. The two parts are not alike:

    - *Stiffness part*: Kelvin-Voigt damping of the beams with the retardation time beta, as
      ``section.damped(time=beta)`` gives it (D: the stiffness at zero strain). It acts on strain
      rates of the section: it takes nothing from rigid motions and momenta. Springs and bushings
      have damping of their own.
    - *Mass part*: a drag against space on everything that has mass. It damps rigid motions, too:
      linear and angular momentum of a free body decay as ``exp(-alpha t)``.

    At rest both vanish: equilibria are those of the undamped scene.

    Parameters
    ----------
    mass : float
        alpha (1/s), not negative.
    stiffness : float
        beta (s), not negative.
    items : Beam, RigidBody, MassPoint or list of them, optional
        What is damped; default: all of the model. Several dampings of an item add up, also to the
        viscosity of its sections. What is lumped on a node is an item of its own.

    Raises
    ------
    InputError
        If a number is negative or not finite, both are zero, an item is no beam, body or mass
        point or is named twice, or the stiffness part gets no beam.

    Examples
    --------
    >>> from skfem_cosserat import EnergyMomentum, MassPoint, Model, NullSpace, simulate
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, velocity=(1.0, 0, 0)))
    >>> drag = model.add("drag", RayleighDamping(mass=0.5))
    >>> history = simulate(model.freeze(), EnergyMomentum(), NullSpace(), 0.01, until=1.0)
    >>> round(float(history["v"][-1, 0]), 4)   # exp(-0.5)
    0.6065
    >>> round(float(history["dissipated"][-1]), 4)   # J
    0.6321
    """

    kind = "damping"

    def __init__(
        self,
        mass: float = 0.0,
        stiffness: float = 0.0,
        items: Item | Iterable[Item] | None = None,
    ):
        self.mass = not_negative(self.label, "mass", mass)
        self.stiffness = not_negative(self.label, "stiffness", stiffness)
        if self.mass == self.stiffness == 0:
            raise InputError(self.label, "mass and stiffness are both zero: it does nothing")
        self.items = None if items is None else self._checked(items)

    @classmethod
    def from_ratios(
        cls,
        frequencies: ArrayLike,
        ratios: ArrayLike,
        items: Item | Iterable[Item] | None = None,
    ) -> RayleighDamping:
        """From the damping ratios wanted at two frequencies.

        Parameters
        ----------
        frequencies : (2,) array
            Two different angular frequencies (rad/s).
        ratios : (2,) array
            Ratios of critical damping there.
        items
            As above.

        Raises
        ------
        InputError
            If numbers are not positive, or no factors that are not negative give the ratios.

        Examples
        --------
        >>> damping = RayleighDamping.from_ratios((10.0, 40.0), (0.02, 0.02))
        >>> round(damping.mass, 12), round(damping.stiffness, 12)
        (0.32, 0.0008)
        """
        values = []
        for name, value in (("frequencies", frequencies), ("ratios", ratios)):
            pair = numbers(cls.kind, name, value)
            if pair.shape != (2,) or not np.isfinite(pair).all() or (pair <= 0).any():
                raise InputError(
                    cls.kind, f"{name} = {value!r}, expected two positive finite numbers"
                )
            values.append(pair)
        omega, zeta = values
        if omega[0] == omega[1]:
            raise InputError(cls.kind, f"frequencies = {frequencies!r} are equal")
        spread = omega[1] ** 2 - omega[0] ** 2
        alpha = 2 * omega[0] * omega[1] * (zeta[0] * omega[1] - zeta[1] * omega[0]) / spread
        beta = 2 * (zeta[1] * omega[1] - zeta[0] * omega[0]) / spread
        # ratios in proportion to omega or 1/omega leave a zero, known to rounding only
        alpha = 0.0 if abs(alpha) < 1e-12 * (zeta * omega).max() else float(alpha)
        beta = 0.0 if abs(beta) < 1e-12 * (zeta / omega).max() else float(beta)
        if alpha < 0 or beta < 0:
            raise InputError(
                cls.kind,
                f"ratios {zeta.tolist()} at {omega.tolist()} rad/s need mass = {alpha:.6g} 1/s and"
                f" stiffness = {beta:.6g} s: negative, it would feed energy",
            )
        return cls(alpha, beta, items)

    def references(self) -> Sequence[Item]:
        """The items it is restricted to."""
        return () if self.items is None else self.items

    def _checked(self, items: Item | Iterable[Item]) -> tuple[Item, ...]:
        out = [items] if isinstance(items, Item) else items
        if not isinstance(out, Iterable) or isinstance(out, str):
            raise InputError(self.label, f"items = {items!r}, expected items of the model")
        out = list(out)
        for k, item in enumerate(out):
            if not isinstance(item, StructuralItem):
                what = item.label if isinstance(item, Item) else repr(item)
                raise InputError(
                    self.label, f"items: {what}, expected a beam, rigid body or mass point"
                )
            if any(item is other for other in out[:k]):
                raise InputError(self.label, f"items: {item.label} is named twice")
        if not out:
            raise InputError(self.label, "items is empty: it does nothing; leave it out for all")
        if self.stiffness and not any(map(is_beam, out)):
            raise InputError(
                self.label,
                f"stiffness = {self.stiffness:g} s damps beams, and items has none:"
                f" {', '.join(item.label for item in out)}",
            )
        return tuple(out)
