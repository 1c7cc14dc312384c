"""A batch of eight runs, one after the other and side by side: the same numbers in less time.

A rubber rod with a ball at its end swings down from its hinge, in each run half as stiff again.
The last rod is hit by a blow that the step cannot resolve. That run fails on purpose: a failure is
an outcome like the others, with the history up to the blow.

Run ``python examples/parallel_runs.py``; ``--executor dask`` takes Dask (extra ``cluster``).
"""

from __future__ import annotations

import argparse
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "parallel_runs.png"
SOFTEST, STEP = 1e7, 1e-3  # Young's modulus of the softest rod (Pa), step (s)
BLOW, BLOW_AT = 1e12, 0.5  # the blow that is too hard (N), and when, as a share of the run


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
    if blow:  # a table can be sent to another process, a lambda cannot
        pulse = sc.Table([BLOW_AT * until, BLOW_AT * until + 2 * STEP], [0, 1])
        model.add("blow", sc.LoadForce(rod.node("rod.end"), (0, blow, 0), pulse))
    return model.freeze()


def jobs(count: int, elements: int, until: float) -> list[sc.Job]:
    """The batch: names, and calls of ``sc.simulate`` that are made later."""
    batch = []
    for k in range(count):
        modulus = SOFTEST * 1.5**k
        system = build(modulus, elements, until, BLOW if k == count - 1 else 0.0)
        call = sc.simulate, system, sc.EnergyMomentum(), sc.NullSpace(), STEP, until
        batch.append(sc.Job(f"E = {modulus / 1e6:.0f} MPa", *call, kernels="numpy"))
    return batch


def run(batch: list[sc.Job], executor: str, workers: int) -> list[sc.Outcome]:
    """All of them by "serial" (here), "processes", or "dask" (a cluster on this machine)."""
    with ExitStack() as stack:  # ends the workers
        if executor == "serial":
            return sc.run_all(batch)
        if executor == "processes":
            return sc.run_all(batch, stack.enter_context(sc.Processes(workers)))
        from distributed import Client, LocalCluster

        cluster = LocalCluster(workers, threads_per_worker=1, dashboard_address=None)
        client = stack.enter_context(Client(stack.enter_context(cluster)))
        return sc.run_all(batch, client.get_executor())


def history_of(outcome: sc.Outcome) -> sc.History:
    """What was computed, up to the failure if there was one."""
    return outcome.value if outcome.ok else outcome.error.history


def main(
    executor: str = "processes",
    workers: int = 2,
    count: int = 8,
    elements: int = 20,
    until: float = 1.5,
    out: str | Path | None = None,
) -> dict[str, Any]:
    """Run the batch in this process, and through an executor with so many workers.

    Gives ``rows`` (name, lowest point of the ball (m), when (s), failure or None), the names of
    those that ``failed``, whether both batches are ``identical`` to the last bit, and the times
    ``serial`` and ``parallel`` in s (the start of the workers included).
    """
    batch, seconds, found = jobs(count, elements, until), [], []
    for each in ("serial", executor):
        start = time.perf_counter()
        found.append(run(batch, each, workers))
        seconds.append(time.perf_counter() - start)
    rows = []
    for job, outcome in zip(batch, found[1], strict=True):
        rod: Any = job.args[0].structures[0]
        history = history_of(outcome)
        height = history.position(rod.node("rod.end"))[:, 1]
        lowest = int(height.argmin())
        failure = None if outcome.ok else str(outcome.error)
        rows.append((outcome.name, float(height[lowest]), float(history.times[lowest]), failure))
    if out is not None:  # the softest rod
        history_of(found[0][0]).picture(out, frames=7, camera="xy", window=(960, 540))
    pairs = [[history_of(outcome)["q"] for outcome in pair] for pair in zip(*found, strict=True)]
    return {
        "rows": rows,
        "failed": [outcome.name for outcome in found[1] if not outcome.ok],
        "identical": all(np.array_equal(a, b) for a, b in pairs),
        "serial": seconds[0],
        "parallel": seconds[1],
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--executor", choices=("serial", "processes", "dask"), default="processes")
    parser.add_argument("--workers", type=int, default=2)
    result = main(**vars(parser.parse_args()), out=PICTURE)
    for name, height, when, failure in result["rows"]:
        print(f"{name:12s} lowest {height:8.4f} m at {when:.3f} s  {(failure or '').split(';')[0]}")
    print(f"one after the other {result['serial']:.1f} s, side by side {result['parallel']:.1f} s")
    print(f"identical: {result['identical']}\npicture: {PICTURE}")
