"""A batch of eight runs, one after the other and side by side: the same numbers, half the time.

A rubber rod with a ball at its end swings down from its hinge, each time half as stiff again.
On its way the last one is hit harder than the step can resolve: it fails on purpose, and is an
outcome like the others, with its history up to the blow.

Run ``python examples/parallel_runs.py --help`` for the choices; ``--executor dask`` needs
``pip install distributed``.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

import skfem_cosserat as sc

#: Young's modulus of the softest rod (Pa)
SOFTEST = 1e7
#: the blow that is too hard (N), and when (s)
BLOW, BLOW_AT = 1e12, 0.5
STEP = 1e-3


def build(modulus: float, elements: int, until: float, blow: float = 0.0) -> sc.System:
    """A rod of 1 m, 10 mm thick, with a ball of 50 g."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
    rubber = sc.SectionCircle(radius=5e-3, material=sc.Material(E=modulus, nu=0.5, rho=1100))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, rubber, director=(0, 1, 0)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    model.add("ball", sc.RigidBody.sphere(0.05, radius=0.02, on=rod.node("rod.end")))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    if blow:  # a table of numbers can be sent anywhere, a lambda could not
        time = BLOW_AT * until
        pulse = sc.Table([time, time + 2 * STEP], [0, 1])
        model.add("blow", sc.LoadForce(rod.node("rod.end"), (0, blow, 0), pulse))
    return model.freeze()


def jobs(count: int, elements: int, until: float) -> list[sc.Job]:
    """The batch; what is called is the package's own `simulate`."""
    batch = []
    for k in range(count):
        modulus = SOFTEST * 1.5**k
        system = build(modulus, elements, until, BLOW if k == count - 1 else 0.0)
        scheme = sc.EnergyMomentum(), sc.NullSpace()
        run = {"step": STEP, "until": until, "kernels": "numpy"}
        batch.append(sc.Job(f"E = {modulus / 1e6:.0f} MPa", sc.simulate, system, *scheme, **run))
    return batch


@contextmanager
def opened(executor: str, workers: int) -> Iterator[Any]:
    """The executor of this name, ended afterwards."""
    if executor == "serial":
        yield None
    elif executor == "processes":
        with sc.Processes(workers) as processes:
            yield processes
    elif executor == "dask":  # a cluster on this machine; any other Client will do
        from distributed import Client, LocalCluster

        options = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": None}
        with LocalCluster(**options) as cluster, Client(cluster) as client:
            yield client.get_executor()
    else:
        raise ValueError(f"executor = {executor!r}, expected serial, processes or dask")


def history_of(outcome: sc.Outcome) -> sc.History:
    """What was computed, up to the failure if there was one."""
    return outcome.value if outcome.ok else outcome.error.history


def same(one: sc.Outcome, other: sc.Outcome) -> bool:
    """Whether two outcomes agree to the last bit, failures included."""
    a, b = history_of(one), history_of(other)
    equal = [np.array_equal(a[name], b[name], equal_nan=True) for name in a.series]
    return str(one.error) == str(other.error) and a.meta == b.meta and all(equal)


def main(
    executor: str = "processes",
    workers: int = 2,
    count: int = 8,
    elements: int = 20,
    until: float = 1.5,
    progress: bool = False,
) -> dict[str, Any]:
    """Run the batch serially and through an executor.

    Parameters
    ----------
    executor : {"processes", "dask", "serial"}
    workers : int
        Of the executor.
    count : int
        Number of runs; the last one fails.
    elements : int
        Of each rod.
    until : float
        End of each run (s).
    progress : bool
        Show a line.

    Returns
    -------
    dict
        ``rows`` (name, lowest point of the ball (m), when (s), failure or None), ``failed`` names,
        ``identical`` (to the last bit), times ``serial`` and ``parallel`` in s (the start of the
        workers included), ``speedup``.
    """
    batch = jobs(count, elements, until)
    start = time.perf_counter()
    alone = sc.run_all(batch, progress=progress)
    serial = time.perf_counter() - start
    start = time.perf_counter()
    with opened(executor, workers) as chosen:
        outcomes = sc.run_all(batch, chosen, progress=progress)
    parallel = time.perf_counter() - start
    rows = []
    rod: Any = build(SOFTEST, elements, until).structures[0]  # all are on the same mesh
    for outcome in outcomes:
        history = history_of(outcome)
        height = history.position(rod.node("rod.end"))[:, 1]
        lowest = int(height.argmin())
        failure = None if outcome.ok else str(outcome.error)
        rows.append((outcome.name, float(height[lowest]), float(history.times[lowest]), failure))
    return {
        "rows": rows,
        "failed": [outcome.name for outcome in outcomes if not outcome.ok],
        "identical": all(map(same, alone, outcomes)),
        "serial": serial,
        "parallel": parallel,
        "speedup": serial / parallel,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--executor", default="processes", choices=("serial", "processes", "dask"), help="by which"
    )
    parser.add_argument("--workers", type=int, default=2, help="how many")
    parser.add_argument("--count", type=int, default=8, help="number of runs")
    parser.add_argument("--elements", type=int, default=20, help="of each rod")
    parser.add_argument("--until", type=float, default=1.5, help="end of each run (s)")
    result = main(**vars(parser.parse_args()), progress=True)
    for name, height, when, failure in result["rows"]:
        print(f"{name:12s} lowest {height:8.4f} m at {when:.3f} s  {failure or ''}")
    print(
        f"one after the other {result['serial']:.2f} s, side by side {result['parallel']:.2f} s:"
        f" {result['speedup']:.2f} times; identical: {result['identical']}"
    )
