"""Schemes of order 4 and 6, composed of steps of a symmetric scheme of order 2."""

from __future__ import annotations

import numpy as np

from ..errors import IncompatibleError, InputError
from .base import Integrator

#: half of Suzuki's palindrome and of that of Kahan & Li, middle last; no partial sum leaves [0, 1]:
#: loads and motions are never asked for beyond the step
_SUZUKI = 1 / (4 - 4 ** (1 / 3))
_HALVES = {
    4: (_SUZUKI, _SUZUKI, 1 - 4 * _SUZUKI),
    6: (
        0.39216144400731413928,
        0.33259913678935943860,
        -0.70624617255763935981,
        0.082213596293550800230,
        0.79854399093482996340,
    ),
}


class Composition(Integrator):
    """A symmetric palindrome of 5 or 9 steps of another scheme, of order 4 or 6.

    What the steps conserve exactly the composition conserves: the variational scheme its momenta
    and the symplectic form, energy-momentum energy and momenta. Some of the steps go backwards in
    time (loads and motions are taken inside the step only). Constraint forces, which the steps
    give to second order, are those of the continuous equations at the composed states. Momenta of
    the variational scheme are recorded without their part along ``G^T``, of second order, too;
    those of energy-momentum keep it, as they belong to the energy that is conserved. The work of
    drives is the sum of that of the steps, to second order.

    Energy-momentum is composed to order 4 only: its velocities are off the hidden constraints by a
    part of O(h^2) that changes sign in each step, so a step is no smooth map close to the identity,
    and the expansion in even powers of h ends there (composed to order 6 it was measured to be of
    order 4.0, at nearly twice the cost). Stabilized energy-momentum is not symmetric.

    Dampers give energy back in the backward steps, and take more in the others. Where one is so
    strong that ``c |h_k|/m`` gets to 2 in a backward step h_k (0.66 h and 0.71 h), that step is
    singular, and close to there energy grows: take a smaller step, or no composition.

    Pays below an error, see the README's chart; where high frequencies are not resolved no order
    is seen, and what makes its steps fail makes it fail: its longest one has 0.66 (order 4) or 0.8
    (order 6) times the size of the whole.

    Parameters
    ----------
    part : Integrator
        ``Variational()`` or ``EnergyMomentum()``: symmetric, without dissipation of its own.
    order : {4, 6}

    Raises
    ------
    InputError
        For another order.
    IncompatibleError
        If `part` is not symmetric, explicit or composed itself, or energy-momentum is to be of
        order 6.

    Examples
    --------
    >>> from skfem_cosserat import Variational
    >>> scheme = Composition(Variational(), order=6)
    >>> scheme.name, scheme.order, len(scheme.shares)
    ('variational composed to order 6', 6, 9)
    """

    part: Integrator
    constraint_weight = 0.0  # its force is that of the continuous equations at the nodes

    def __init__(self, part: Integrator, order: int = 4):
        if not isinstance(order, (int, np.integer)) or order not in _HALVES:
            raise InputError("argument order", f"{order!r}, expected one of {list(_HALVES)}")
        if not isinstance(part, Integrator):
            raise InputError("argument part", f"{part!r}, expected an integrator")
        if part.composed_to < 4:
            raise IncompatibleError(
                f"Composition of {part!r}",
                "only symmetric implicit schemes of one step are composed",
            )
        if part.composed_to < order:
            raise IncompatibleError(
                f"Composition of {part!r}",
                f"order {order} is for Variational() only: velocities of energy-momentum are off"
                " the hidden constraints by a part that changes sign each step, and order 4 comes"
                " out",
            )
        half = _HALVES[int(order)]
        self.part = part
        self.order = int(order)
        self.shares = (*half, *half[-2::-1])
        self.name = f"{part.name} composed to order {order}"
        # it is the longest of the steps that has to resolve the frequencies
        limit = part.frequency_limit
        longest = max(map(abs, half))
        self.frequency_limit = None if limit is None else limit / longest
        self.fixed_step = part.fixed_step
        self.advice = part.advice
        self.conserves = part.conserves
        self.keeping = part.keeping
        source = {
            4: "Suzuki, Phys. Lett. A 146 (1990) 319",
            6: "Kahan & Li, Math. Comput. 66 (1997) 1089",
        }
        self.reference = f"{part.reference}; {source[order]}"

    def __repr__(self) -> str:
        return f"Composition({self.part!r}, order={self.order})"
