"""Balance of forces at rest: internal forces, springs and loads at one configuration.

What statics solves and modal analysis linearises: ``R(y) = f_int + f_couplings - f_loads`` without
constraint forces, and its derivative as blocks of the system's groups, the form in which both
treatments of the constraints take them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..frames import vector
from ..frozen import Frozen
from ..kernels import cross, skew
from ..types import Array, Floats, IndexArray, VectorLike
from .force_elements import CoupledForce
from .system import System


@dataclass(frozen=True, eq=False, repr=False)
class Spin(Frozen):
    """A frame that turns steadily, with the ground in it: everything is seen from there.

    Parameters
    ----------
    velocity : (3,) array
        Angular velocity (rad/s).
    point : (3,) array
        On the axis (m).

    Raises
    ------
    InputError
        If they are not three finite numbers each.

    Examples
    --------
    >>> Spin((0, 0, 20.0)).velocity.tolist()
    [0.0, 0.0, 20.0]
    """

    velocity: Floats
    point: Floats

    def __init__(self, velocity: VectorLike, point: VectorLike = (0.0, 0.0, 0.0)):
        for name, value in (("velocity", velocity), ("point", point)):
            object.__setattr__(self, name, vector("spin", name, value))

    @property
    def square(self) -> Floats:
        """``Omega^ Omega^`` (3, 3), symmetric."""
        S = skew(self.velocity)
        return S @ S

    def rates(self, system: System, y: Array) -> Array:
        """Velocities (rows, 3) against space of what rests in the frame at configuration y."""
        arms = np.array(y[: system.rows])
        arms[system.origin_rows] -= self.point
        return cross(self.velocity, arms)

    def centrifugal(self, system: System, y: Array) -> Array:
        """Generalised centrifugal force (rows, 3)."""
        return -cross(self.velocity, system.mass @ self.rates(system, y))


@dataclass(frozen=True, eq=False)
class Amplitudes:
    """Present factors of all loads and actuators.

    Attributes
    ----------
    loads : (k,) array
        One for each channel of ``system.loading``.
    actuators : (k + 1,) array
        One for each channel of ``system.couplings``, and a zero.
    spin : Spin or None
        A turning frame, whose centrifugal forces are loads.
    time : float
        At which loads that are functions of the motion are taken (s).
    """

    loads: Floats
    actuators: Floats
    spin: Spin | None = None
    time: float = 0.0

    @property
    def turning(self) -> Floats:
        """Velocity and point (2, 3) of the spin, zeros without one."""
        spin = Spin(np.zeros(3)) if self.spin is None else self.spin
        return np.array([spin.velocity, spin.point])


@dataclass(eq=False)
class Balance:
    """Forces at a configuration.

    Attributes
    ----------
    R : (rows, 3) array
        Internal forces and springs less loads (N; N m on directors), no constraint forces.
    size : float
        Largest entry of its terms: what a residual is compared with.
    y : (total, 3) array
        Configuration.
    strains, Bs, stresses : list of arrays
        For each beam group.
    coupled : CoupledForce or None
        Springs and actuators, if there are any.
    external : (rows, 3) array
        Loads.
    """

    R: Array
    size: float
    y: Array
    strains: list[Array]
    Bs: list[Array]
    stresses: list[Array]
    coupled: CoupledForce | None
    external: Array


def amplitudes_at(system: System, t: float) -> Amplitudes:
    """Factors of all loads and actuators as they are at time t (s)."""
    return Amplitudes(system.loading.values(t), system.couplings.values(t), time=t)


def balance(
    system: System,
    y: Array,
    amplitudes: Amplitudes,
    before: Floats | None = None,
    turns: IndexArray | None = None,
    ydot: Array | None = None,
    share: float = 0.0,
    viscous: bool = True,
) -> Balance:
    """Forces at configuration y (all rows), at rest or in motion; without inertia.

    Parameters
    ----------
    system : System
    y : (total, 3) array
        Real, or complex for a complex step.
    amplitudes : Amplitudes
    before : (total, 3) array, optional
        Configuration from which the angles of springs are counted on; default: y.
    turns : (k,) int array, optional
        Full turns of these angles at `before`.
    ydot : (total, 3) array, optional
        Rates of all rows; default: rest.
    share : float
        Their derivative by y (1/s), for the tangent of force elements.
    viscous : bool
        With the viscous forces of sections.
    """
    groups = system.beam_groups
    both = system.strain(y)
    strains = [eps for eps, _ in both]
    Bs = [B for _, B in both]
    stresses = [g.stress(eps) for g, eps in zip(groups, strains, strict=True)]
    if viscous and ydot is not None and system.damped:
        stresses = [
            S + g.viscous_stress(g.strain_rate(B, ydot)) if g.viscous else S
            for g, B, S in zip(groups, Bs, stresses, strict=True)
        ]
    internal = system.internal_force(Bs, stresses)
    if ydot is not None and system.drag is not None:
        internal = internal + system.drag @ ydot[: system.rows]
    coupled = None
    if system.couplings.count:
        now = amplitudes.actuators, 1.0, amplitudes.time
        start = system.couplings.starting(np.real(y) if before is None else before, turns, *now)
        coupled = system.couplings.static(start, y, ydot, share)
        internal = internal + coupled.force[: system.rows]
    external = external_force(system, y, amplitudes)
    size = max(float(abs(term).max(initial=0.0)) for term in (internal, external))
    return Balance(internal - external, size, y, strains, Bs, stresses, coupled, external)


def external_force(system: System, y: Array, amplitudes: Amplitudes) -> Array:
    """Loads (rows, 3) at configuration y (all rows)."""
    external = system.loading.dead_force(amplitudes.loads)
    if not system.loading.dead_only:
        external = external + system.loading.force(y[: system.rows], amplitudes.loads)
    if amplitudes.spin is not None:
        external = external + amplitudes.spin.centrifugal(system, y)
    return external


def balance_tangent(
    system: System, at: Balance, amplitudes: Amplitudes, stresses: Sequence[Array] | None = None
) -> list[Array]:
    """``dR/dy`` as blocks of the system's groups, then of its couplings if it has any.

    Parameters
    ----------
    at : Balance
    amplitudes : Amplitudes
    stresses : list of arrays, optional
        Stresses of the geometric part instead of those at y, see :func:`predicted`.
    """
    blocks = system.empty_tangent()
    used = at.stresses if stresses is None else stresses
    for k, g in enumerate(system.beam_groups):
        B = at.Bs[k]
        blocks[k] += g.parts(B, B, used[k], 1.0, 1.0, g.moduli(at.strains[k])).blocks()
    if not system.loading.dead_only:
        system.loading.add_tangent(blocks, at.y[: system.rows], amplitudes.loads, -1.0)
    if amplitudes.spin is not None:
        for k, group in enumerate(system.groups):
            blocks[k] += group.mass @ np.kron(np.eye(group.rows.shape[1]), amplitudes.spin.square)
    if at.coupled is not None:
        blocks.append(system.couplings.tangent(at.coupled, 1.0))
    return blocks


def predicted(system: System, at: Balance, change: Array) -> list[Array]:
    """Stresses ``S + D B dq`` after a change (rows, 3) of the coordinates, to first order.

    As geometric part of the next tangent they make Newton's method converge from far away: the
    mixed (MIP) iteration of Magisano, Leonetti & Garcea, Comput. Methods Appl. Mech. Engrg 313
    (2017) 986, where stresses are unknowns of their own.
    """
    out = []
    for g, eps, S, B in zip(system.beam_groups, at.strains, at.stresses, at.Bs, strict=True):
        local = change[g.rows].reshape(len(g.rows), -1, 1)
        out.append(S + g.linear_stress(g.moduli(eps), (B @ local).reshape(eps.shape)))
    return out
