"""Figure 25: the trajectories of both integrators approach each other as the step shrinks.

The variational scheme (null space) is compared with energy-momentum in both treatments, at the
same 25 instants for all steps: both with the same step, and each with the other one's trajectory of
a much finer step. Errors are the largest difference of any component, relative to the largest
component. A history has the multipliers of both at its states. Those of a step of energy-momentum
belong to its midpoint: compared at different instants (a state against the midpoint after it) the
difference is of first order only, which is shown as such.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import skfem_cosserat as sc
from paper import three_bar_swing as swing
from skfem_cosserat import diagnostics
from skfem_cosserat.integrators import StepReport

Floats = NDArray[np.float64]

INSTANTS = 25
#: at 0.1 s; every step ends at the instants, and (further on) at the kinks 0.125 and 0.25 s
STEPS = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4)
REFERENCE_STEPS = {True: 6.25e-5, False: 3.125e-5}  # quick or not
LONG_STEPS = {True: (1e-3, 5e-4, 2.5e-4), False: (1e-3, 5e-4, 2.5e-4, 1.25e-4)}
HORIZONS = {True: (0.5,), False: (0.25, 0.5, 1.0, 2.0)}  # s
QUANTITIES = ("q", "v", "p", "Qp", "internal multipliers", "external multipliers")
SHIFTED = "multipliers at different instants"
SAME_END, SAME = "same step, at the end", "same step, all instants"
TO_VARIATIONAL, TO_MOMENTUM = "energy-momentum to variational", "variational to energy-momentum"

Trajectory = dict[str, Floats]
Trajectories = dict[float, Trajectory]


def trajectory(
    system: sc.System, integrator: str, treatment: str, step: float, until: float
) -> Trajectory:
    """Each of QUANTITIES at 25 instants, (25, k), and SHIFTED: multipliers of the step after them.

    ``v`` and ``Qp`` are those of the saddle point, p of the discrete Legendre transform (``M v_n``
    with energy-momentum).
    """
    times = until * np.arange(1, INSTANTS + 1) / INSTANTS
    number = np.rint(times / step).astype(int)
    if abs(number * step - times).max() > 1e-9 * until:
        raise ValueError(f"step = {step!r} does not divide the instants up to {until!r} s")
    steps: dict[int, tuple[Floats, Floats]] = {}
    after = set(number.tolist())

    def collect(report: StepReport) -> None:
        if report.start.index in after:
            steps[report.start.index] = report.constraint_point, report.constraint_force

    history = sc.simulate(
        system,
        swing.INTEGRATORS[integrator](),
        swing.TREATMENTS[treatment](),
        step,
        until + step,
        derive=False,
        at=times.tolist(),
        callbacks=[collect],
    )
    row = np.searchsorted(history["step"], number)
    q, p = history["q"][row], history["p"][row]
    v, projected = sc.Projection(system).stack(q, p, history.times[row])
    points = diagnostics.constraint_points(system, history)[row]
    same = diagnostics.multipliers(system, points, history["constraint_force"][row])
    points, force = (np.array(each) for each in zip(*(steps[k] for k in number), strict=True))
    return {
        "q": q,
        "v": v,
        "p": p,
        "Qp": projected,
        "internal multipliers": same[:, : system.internal],
        "external multipliers": same[:, system.internal :],
        SHIFTED: diagnostics.multipliers(system, points, force),
    }


def trajectories(
    integrator: str, treatment: str, steps: Sequence[float], until: float
) -> Trajectories:
    """One for each step (s)."""
    system = swing.build()
    return {h: trajectory(system, integrator, treatment, h, until) for h in steps}


def difference(a: Trajectory, b: Trajectory, instants: slice = slice(None)) -> dict[str, float]:
    """Relative errors of a against b in each quantity."""
    return {
        name: float(abs(a[name] - b[name])[instants].max() / abs(b[name][instants]).max())
        for name in a
    }


def orders(errors: dict[float, dict[str, float]]) -> dict[tuple[float, float], dict[str, float]]:
    """Observed orders between neighbouring steps, by (coarse, fine)."""
    steps = sorted(errors, reverse=True)
    return {
        (h, k): {
            name: float(np.log(errors[h][name] / errors[k][name]) / np.log(h / k))
            for name in errors[h]
        }
        for h, k in pairwise(steps)
    }


def compare(
    variational: Trajectories, momentum: Trajectories, reference: float | None = None
) -> dict[str, Any]:
    """Errors and orders between trajectories of the two integrators.

    Parameters
    ----------
    variational, momentum : dict
        Trajectories by step (s), of the same steps.
    reference : float, optional
        One of the steps, much finer than all others: each integrator is also compared with the
        other one's trajectory of this step.

    Returns
    -------
    dict
        ``errors`` by kind, step and quantity; ``orders`` by kind, pair of steps and quantity.
        Kinds: SAME_END (the last instant only), SAME, and with a reference TO_VARIATIONAL and
        TO_MOMENTUM.
    """
    A, B = variational, momentum
    steps = [h for h in A if h != reference]
    end = slice(-1, None)
    errors = {
        SAME_END: {h: difference(B[h], A[h], end) for h in steps},
        SAME: {h: difference(B[h], A[h]) for h in steps},
    }
    if reference is not None:
        errors[TO_VARIATIONAL] = {h: difference(B[h], A[reference]) for h in steps}
        errors[TO_MOMENTUM] = {h: difference(A[h], B[reference]) for h in steps}
    return {"errors": errors, "orders": {kind: orders(e) for kind, e in errors.items()}}


def main(quick: bool = True) -> dict[str, Any]:
    """All of figure 25.

    Parameters
    ----------
    quick : bool
        A coarser reference, and one longer horizon only.

    Returns
    -------
    dict
        ``multipliers`` and ``null-space`` (treatment of energy-momentum): at 0.1 s, see
        :func:`compare`; ``rounding``: differences between the two treatments, by step, which are
        noise alone; ``longer``: by horizon (s), with the null space, to be reported only.
    """
    reference = REFERENCE_STEPS[quick]
    steps = (*STEPS, reference)
    variational = trajectories("variational", "null-space", steps, 0.1)
    result: dict[str, Any] = {"reference_step": reference, "longer": {}}
    momentum = {
        treatment: trajectories("energy-momentum", treatment, steps, 0.1)
        for treatment in ("multipliers", "null-space")
    }
    for treatment, paths in momentum.items():
        result[treatment] = compare(variational, paths, reference)
    both = momentum["multipliers"], momentum["null-space"]
    result["rounding"] = {h: difference(both[0][h], both[1][h]) for h in steps}
    for until in HORIZONS[quick]:
        pair = (
            trajectories(integrator, "null-space", LONG_STEPS[quick], until)
            for integrator in ("variational", "energy-momentum")
        )
        result["longer"][until] = compare(*pair)
    return result
