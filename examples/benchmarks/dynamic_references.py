"""Three flexible problems in space and time, orders 1 to 4, against reference solutions.

D1, a rubber rod that swings down from its hinge; D2, the right-angle cantilever of Simo & Vu-Quoc
(1988); D3, a free rod that is thrown and spun, the "flying spaghetti" in space. The numbers to
reach and the scenes are those of benchmarks/collection. Three questions:

*Orders.* With the loads as given waves start at t = 0 and wherever the load has a kink, and no
derivative of the solution exists beyond some order: neither elements of high order nor a step
above the period of the fastest wave then show their order. Ramped smoothly, the same scenes show
2 p in space (two meshes against a finer one, all with the same step, so that the error in time
drops out) and 2 in time (the same mesh, steps halved).

*Errors with the loads as given*, of the limit of vanishing step: the error of both integrators has
even powers of h only, which Richardson extrapolation takes away, as kinks fall on ends of steps.

*Trusted digits*: the finest runs beside the uncertainty of the reference, and the energies that
stay constant after the loads have ended.

Writes three tables and, where matplotlib is there, a chart; half an hour on one core, with --quick
one. All units SI. Run ``python examples/benchmarks/dynamic_references.py --help`` for the choices.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: small matrices

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent))

import dynamic_report
from record import Record

import skfem_cosserat as sc
from collection import d01_flexible_pendulum, d02_right_angle, d03_flying_spaghetti
from collection.common import entry
from collection.runs import Motion, Scene, limit, run
from skfem_cosserat.export import prepare_folder
from skfem_cosserat.kernels import rotation_matrix

Floats = NDArray[np.float64]

PICTURES = Path(__file__).resolve().parents[1] / "pictures"
INTEGRATORS = {"variational": sc.Variational, "energy-momentum": sc.EnergyMomentum}
ORDERS = (1, 2, 3, 4)


# -- scenes ----------------------------------------------------------------------------------------


def pendulum(elements: int, order: int, smooth: bool = False) -> Scene:
    """D1: gravity is there at once, or rises within 0.2 s."""
    data = {"rise": 0.2} if smooth else None
    return d01_flexible_pendulum.PROBLEM.build(data, elements, order)


def cantilever(elements: int, order: int, smooth: bool = False) -> Scene:
    """D2, elements in each leg: a triangle of 2 s and 50 N, or a bump of 4 s."""
    data = {"pulse": "bump", "t_end": 4.0} if smooth else None
    return d02_right_angle.PROBLEM.build(data, elements, order)


def spaghetti(elements: int, order: int, smooth: bool = False, lumped: bool = False) -> Scene:
    """D3: a triangle or a bump of 5 s; masses at the nodes if lumped."""
    data = d03_flying_spaghetti.PROBLEM.data({"pulse": "bump"} if smooth else None)
    return d03_flying_spaghetti.scene(data, elements, order, lumped)


SCENES = {"D1": pendulum, "D2": cantilever, "D3": spaghetti}
ENTRIES = {
    "D1": d01_flexible_pendulum.ENTRIES[0],
    "D2": d02_right_angle.ENTRIES[0],
    "D3": d03_flying_spaghetti.ENTRIES[0],
}


# -- reference, runs and limits --------------------------------------------------------------------


class Reference(NamedTuple):
    """What is to be reached at times (T,): None where the reference has no such numbers.

    ``positions`` (T, k, 3), ``rotations`` (T, k, 3, 3), ``velocities`` (T, k, 3), ``energy`` and
    ``uncertainty`` (T,).
    """

    times: Floats
    positions: Floats
    rotations: Floats | None
    velocities: Floats | None
    energy: Floats | None
    uncertainty: Floats

    @classmethod
    def load(cls, name: str, until: float = np.inf) -> Reference:
        """That of a scene, up to a time (s)."""
        values = entry(ENTRIES[name])["values"]
        rows = [row for t, row in values.items() if float(t) <= until]
        times = np.array([float(t) for t in values if float(t) <= until])
        uncertainty = np.array([row["unc"] for row in rows])
        if "tip" in rows[0]:  # one place, in its plane
            plane = np.array([[row["tip"], row["vel"]] for row in rows])
            x, v = np.pad(plane, ((0, 0), (0, 0), (0, 1))).transpose(1, 0, 2)[:, :, None]
            return cls(times, x, None, v, None, uncertainty)

        def places(key: str) -> Floats:
            return np.array([list(row[key].values()) for row in rows])

        energy = np.array([row["energy"] for row in rows])
        turned = rotation_matrix(places("quat"))
        return cls(times, places("pos"), turned, None, energy, uncertainty)


def motion(
    scene: Scene, integrator: str, step: float, times: Sequence[float], treatment: Any = None
) -> Motion:
    """A run from rest, seen at times (s) that are ends of steps."""
    wanted = np.asarray(times, dtype=float)
    if abs(np.rint(wanted / step) * step - wanted).max() > 1e-9:
        raise ValueError(f"step = {step!r} does not divide the times {wanted.tolist()}")
    rule = sc.NullSpace() if treatment is None else treatment
    return run(scene, INTEGRATORS[integrator](), rule, step, times).motion


def errors(result: Motion, reference: Reference) -> dict[str, Floats]:
    """Norms (T,) over all places of the differences in what the reference has."""
    pairs = {
        "position": (result.positions, reference.positions),
        "rotation": (result.rotations, reference.rotations),
        "velocity": (result.velocities, reference.velocities),
        "energy": (result.energy, reference.energy),
    }
    return {
        name: np.linalg.norm((a - b).reshape(len(a), -1), axis=1)
        for name, (a, b) in pairs.items()
        if b is not None
    }


def slopes(x: Iterable[float], error: Iterable[float]) -> list[float]:
    """Observed orders between neighbours; x is proportional to the size of steps or elements."""
    logs = np.log(np.array(list(x))), np.log(np.array(list(error)))
    return list(np.diff(logs[1]) / np.diff(logs[0]))


# -- studies ---------------------------------------------------------------------------------------

#: orders in space, smooth loads: step (s), time (s), elements for each order, mesh to compare with
SPACE: dict[str, tuple[float, float, dict[int, tuple[int, ...]], tuple[int, int]]] = {
    "D1": (
        *(0.01, 0.2),
        {1: (32, 64, 128), 2: (16, 32, 64), 3: (8, 16, 32), 4: (8, 16, 24)},
        (36, 4),
    ),
    "D2": (0.1, 4.0, {1: (8, 16, 32), 2: (4, 8, 16), 3: (3, 6, 12), 4: (4, 8, 12)}, (20, 4)),
    "D3": (0.05, 2.5, {1: (32, 64, 128), 2: (8, 16, 32), 3: (4, 8, 16), 4: (2, 4, 12)}, (24, 4)),
}
#: orders in time, smooth loads: first step (s), time (s), elements for each order
TIME: dict[str, tuple[float, float, dict[int, int]]] = {
    "D1": (1 / 400, 0.2, {1: 32, 2: 16, 3: 8, 4: 8}),
    "D2": (1 / 20, 2.0, {1: 8, 2: 4, 3: 3, 4: 2}),
    "D3": (1 / 20, 2.5, {1: 16, 2: 8, 3: 6, 4: 4}),
}
#: loads as given: steps (s), time (s), elements for each order
GIVEN: dict[str, tuple[tuple[float, ...], float, dict[int, tuple[int, ...]]]] = {
    "D1": ((1 / 6400,), 0.2, {1: (32, 64, 128), 2: (16, 32, 64), 3: (8, 16, 32), 4: (8, 16, 32)}),
    "D2": (
        (1 / 160, 1 / 320, 1 / 640),
        2.0,
        {1: (16, 32, 64), 2: (4, 8, 16, 32), 3: (2, 4, 8, 16), 4: (1, 2, 4, 8)},
    ),
    "D3": (
        (1 / 320, 1 / 640),
        3.0,
        {1: (32, 64, 128), 2: (8, 16, 32, 64), 3: (4, 8, 16, 32), 4: (4, 8, 16, 32)},
    ),
}
#: finest runs: order, elements, steps (s), time (s)
FINEST: dict[str, tuple[int, int, tuple[float, ...], float]] = {
    "D1": (4, 32, (1 / 12800,), 0.3),
    "D2": (4, 16, (1 / 320, 1 / 640), 3.0),
    "D3": (4, 32, (1 / 640, 1 / 1280), 6.0),
}


def order_in_space(name: str, integrator: str, meshes: int = 3, refine: int = 1) -> dict[int, Any]:
    """Errors of placements, velocities and energy with smooth loads, all runs with one step.

    Parameters
    ----------
    name : {"D1", "D2", "D3"}
    integrator : {"variational", "energy-momentum"}
    meshes : int
        The finest 2 or 3 of SPACE.
    refine : int
        Divides the step.

    Returns
    -------
    dict
        By order: ``elements``, ``error`` (m and -), ``velocity`` (m/s) and ``energy`` (J).
    """
    step, until, elements, (fine, highest) = SPACE[name]
    build = SCENES[name]

    def run(count: int, order: int) -> Motion:
        return motion(build(count, order, smooth=True), integrator, step / refine, [until])

    best = run(fine, highest)
    result = {}
    for order, counts in elements.items():
        used = counts[-meshes:]
        runs = [run(count, order) for count in used]
        result[order] = {
            "elements": used,
            "error": [float(np.linalg.norm(m.placement - best.placement)) for m in runs],
            "velocity": [float(np.linalg.norm(m.velocities - best.velocities)) for m in runs],
            "energy": [float(abs(m.energy - best.energy).max()) for m in runs],
        }
    return result


def order_in_time(
    name: str, integrator: str, levels: int = 4, orders: Sequence[int] = ORDERS
) -> dict[int, Any]:
    """Errors of placements, velocities and energy against the limit of vanishing step.

    Parameters
    ----------
    name, integrator
        As for :func:`order_in_space`.
    levels : int
        Steps, each half of the one before.
    orders : sequence of int
        Of the elements.

    Returns
    -------
    dict
        By order: ``steps`` (s), ``error``, ``velocity`` and ``energy``.
    """
    first, until, elements = TIME[name]
    steps = [first / 2**k for k in range(levels)]
    result = {}
    for order in orders:
        scene = SCENES[name](elements[order], order, smooth=True)
        runs = [motion(scene, integrator, step, [until]) for step in steps]
        best = limit(steps, runs)
        result[order] = {
            "steps": steps,
            "error": [float(np.linalg.norm(m.placement - best.placement)) for m in runs],
            "velocity": [float(np.linalg.norm(m.velocities - best.velocities)) for m in runs],
            "energy": [float(abs(m.energy - best.energy).max()) for m in runs],
        }
    return result


def as_given(
    name: str, integrator: str, order: int, count: int, steps: Sequence[float], until: float
) -> dict[str, Any]:
    """Errors against the reference, loads as given, of the limit of runs with some steps (s).

    Returns
    -------
    dict
        ``order``, ``elements`` and ``steps``; ``times`` and ``uncertainty`` (T,) of the reference,
        and (T,) of each of :func:`errors`.
    """
    reference = Reference.load(name, until)
    scene = SCENES[name](count, order)
    runs = [motion(scene, integrator, step, reference.times) for step in steps]
    found = errors(limit(steps, runs), reference)
    mesh = {"order": order, "elements": count, "steps": tuple(steps)}
    return {**mesh, "times": reference.times, "uncertainty": reference.uncertainty, **found}


def main(quick: bool = True, out: str | Path | None = None) -> dict[str, Any]:
    """Orders in space and time, errors with the loads as given, finest runs.

    Parameters
    ----------
    quick : bool
        Fewer meshes and steps, and none of the finest runs.
    out : path, optional
        Folder for the tables and the chart; None: nothing is written.

    Returns
    -------
    dict
        ``space`` and ``time`` by (scene, integrator), see :func:`order_in_space` and
        :func:`order_in_time`; ``given`` by (scene, order), with energy-momentum: ``elements``,
        ``until`` (s) and ``error``, the largest of positions up to then (m); ``finest`` by (scene,
        integrator), see :func:`as_given`; ``uncertainty`` (m) by scene: the reference's own, up to
        the time of ``given``; ``paths`` written.
    """
    if out is not None:
        prepare_folder(Path(out))  # before minutes of work, not after them
    record = Record()
    result: dict[str, Any] = {"space": {}, "time": {}, "given": {}, "finest": {}, "uncertainty": {}}
    title = f"dynamic references{', quick' if quick else ''}"
    with record.run(title) as number:
        for name in SCENES:
            for integrator in INTEGRATORS:
                key = (name, integrator)
                result["space"][key] = order_in_space(name, integrator, 2 if quick else 3)
                result["time"][key] = order_in_time(name, integrator, 3 if quick else 4)
                if not quick:
                    result["finest"][key] = as_given(name, integrator, *FINEST[name])
            _sweep(name, quick, result)
    if out is not None:
        result["paths"] = dynamic_report.main(result, Path(out), record, number)
    return result


def _sweep(name: str, quick: bool, result: dict[str, Any]) -> None:
    """Meshes with the loads as given."""
    steps, until, elements = GIVEN[name]
    if quick:
        steps = tuple(8 * h for h in steps)
    for order, counts in elements.items():
        used = counts[:2] if quick else counts
        runs = [as_given(name, "energy-momentum", order, n, steps, until) for n in used]
        result["given"][name, order] = {
            "elements": used,
            "until": until,
            "error": [float(run["position"].max()) for run in runs],
        }
        result["uncertainty"][name] = float(runs[0]["uncertainty"].max())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="coarser, without the finest runs")
    parser.add_argument("--out", default=str(PICTURES), help="folder for all files")
    parser.add_argument("--json", action="store_true", help="print all numbers as JSON")
    arguments = parser.parse_args()
    made = main(arguments.quick, arguments.out)
    if arguments.json:
        print(json.dumps(dynamic_report.plain(made), indent=1))
    else:
        print("\n".join(dynamic_report.lines(made)))
