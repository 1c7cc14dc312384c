"""Which fast motions theories of a beam keep, and how long steps of the variational scheme can be.

*Vibrations* of the scene in its plane about the reference, where nothing is stressed. Of the full
beam the fastest are shear: rotations of nodes against the line, ``sqrt(GA/(rho I))`` and more.
Without shear they are axial waves, ``2 sqrt(3)/l sqrt(E/rho)`` for linear elements of length l.
Without extension one remains at just that frequency: rotations that alternate from *node to node*.
The strains are held at the Gauss point of an element, where such rotations have no mean: the line
does not feel them, bending alone holds them, ``EI (2/l)^2``, and their inertia is that of the
sections, ``rho I/3``. It is the same number, as both are those of one bar of the material.

*What limits the variational scheme* are rotations that alternate from *step to step* (see
paper/failure_mechanism.py). They have no stress at midpoints, the constraint forces drive them,
inertia holds them: they grow while ``h omega_c > 2``. With ``b = P nu`` along the constraints,
alternating,

``P^T (4/h^2 M - sum_k lambda_k H_k) P nu = 0``

where H_k is the second derivative of constraint k: omega_c^2 is the largest eigenvalue of
``P^T sum lambda H P`` against ``P^T M P``. For the full beam that is
:func:`skfem_cosserat.diagnostics.constraint_frequency`; with strains that are held, their
multipliers are among the lambda, and b moves the line as well.

On the stiff swing what is driven the most alternates from node to node, too, whatever is held: no
theory but the rigid one takes it away. Holding shear leaves it nearly as it is. Without extension
it moves the line a little (the share of rotations in its kinetic energy falls from 1 to 0.6 until
1.5 s, 0.8 until a full period), and omega_c is 2.9 and 5 times smaller than the full beam's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.sparse import identity, kron

import skfem_cosserat as sc
from skfem_cosserat.diagnostics import stacked
from skfem_cosserat.integrators.choice import choose_kernels

Floats = NDArray[np.float64]

#: how many of the highest frequencies are listed
COUNT = 3


def highest(system: sc.System) -> dict[str, Any]:
    """The highest frequencies of a scene about its reference, and what the fastest motion is.

    Returns
    -------
    dict
        ``omega_1``, ``omega_2``, ... (rad/s), the highest first; of the first ``rotary``, the share
        of rotations in its kinetic energy, and ``zigzag``, 1 where rotations alternate from node to
        node along the beam, -1 where they are all the same. NaN where there are no vibrations.
    """
    found = sc.modes(system, count=system.unknowns)
    omega = np.full(COUNT, np.nan)
    top = found.omega[::-1][:COUNT]
    omega[: len(top)] = top
    omega[omega == 0] = np.nan
    out = {f"omega_{k + 1}": float(each) for k, each in enumerate(omega)}
    if np.isnan(omega[0]):
        return out | {"rotary": float("nan"), "zigzag": float("nan")}
    return out | kind(system, system.q0.reshape(-1, 3), found.shapes[-1].real.reshape(-1, 3))


def kind(system: sc.System, q: Floats, shape: Floats) -> dict[str, float]:
    """What a motion is, by its shape (rows, 3) at a configuration (rows, 3): see `highest`."""
    turning = shape.copy()
    turning[system.origin_rows] = 0
    energy, rotary = (float((x * (system.mass @ x)).sum()) for x in (shape, turning))
    beam: Any = system.structures[0]
    first = system.offset(beam.node(0)) // 3
    frames = slice(first, first + 4 * len(beam.triads))
    spin = np.cross(q[frames], turning[frames]).reshape(-1, 4, 3)[:, 1:].sum(1)[:, 0]
    pairs = float((spin[1:] ** 2 + spin[:-1] ** 2).sum())
    return {
        "rotary": rotary / energy,
        "zigzag": -2 * float((spin[1:] * spin[:-1]).sum()) / (pairs or 1.0),
    }


def alternation_frequency(system: sc.System, y: Floats, force: Floats) -> tuple[float, Floats]:
    """The omega_c (rad/s) whose product with the step must stay below 2, whatever is held.

    Parameters
    ----------
    y : (total, 3) array
    force : (n,) array
        Of the constraints there, as in :class:`skfem_cosserat.StepReport`.

    Returns
    -------
    float, (rows, 3) array
        And the motion that is driven the most.
    """
    multipliers = stacked.balancing_multipliers(system, y, -force)
    P = stacked.null_space_matrix(system, y)
    H = (P.T @ stacked.curvature_matrix(system, y, multipliers) @ P).toarray()
    M = (P.T @ kron(system.mass, identity(3)) @ P).toarray()
    top = len(M) - 1
    values, vectors = eigh((H + H.T) / 2, M, subset_by_index=[top, top])
    return float(np.sqrt(max(values[0], 0.0))), (P @ vectors[:, 0]).reshape(-1, 3)


def driven(
    system: sc.System, step: float, ends: Sequence[float], looks: int, kernels: str
) -> dict[str, Any]:
    """Largest omega_c (rad/s) over the motion with energy-momentum, and ``2/omega_c``, by ends.

    With the time (s) when it is that large, and what is driven then: see :func:`kind`.
    """
    method = sc.EnergyMomentum(), sc.NullSpace()
    chosen = choose_kernels(kernels, system, *method, 10**7).name
    count = int(np.ceil(max(ends) / step))
    stepper, state = sc.Stepper(system, *method, step, kernels=chosen), sc.initial_state(system)
    found: list[tuple[float, float, dict[str, float]]] = []
    for k in range(count):
        try:
            report = stepper.advance(state, (k + 1) * step)
        except sc.Diverged:
            break
        if k % max(1, count // looks) == 0:
            y = report.constraint_point
            omega, shape = alternation_frequency(system, y, report.constraint_force)
            found.append((omega, state.time, kind(system, y[: system.rows], shape)))
        state = report.state
    out: dict[str, Any] = {}
    for end in ends:
        omega, at, what = max((each for each in found if each[1] <= end), key=lambda each: each[0])
        limit = 2 / omega if omega else float("inf")
        values = {"omega_c": omega, "at_s": at, "limit_s": limit, **what}
        out |= {f"{name} to {end:g} s": value for name, value in values.items()}
    return out
