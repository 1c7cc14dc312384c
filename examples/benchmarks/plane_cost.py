"""Cost of a compiled step of the three-bar swing, in space and confined to its plane.

Prints the CPU time of a step (ms) in space and in the plane, and the first over the second. The
start of a run is not counted: times are those of a long run less those of a short one, each the
least of some repeats. With a spring a plane scene takes the kernels of space.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import measuring  # noqa: F401, before numpy: one thread

import skfem_cosserat as sc
from paper import three_bar_swing as swing

STEP, SHORT, LONG = 1e-2, 2.0, 8.0


def scene(spring: bool) -> sc.Model:
    """The published swing; with a soft spring on its mass."""
    model = swing.scene("published")
    if spring:
        beam: Any = model["beam"]
        ground = sc.ground((0.0, 5.0, -5.0))
        model.add("spring", sc.SpringDamper(ground, beam.node("mid"), stiffness=1.0))
    return model


def step_ms(
    system: sc.System, integrator: sc.Integrator, treatment: sc.Treatment, repeats: int
) -> float:
    """CPU time of a step (ms)."""
    least = []
    for until in (SHORT, LONG):
        times = []
        for _ in range(repeats):
            start = time.process_time()
            run = system, integrator, treatment, STEP, until
            sc.simulate(*run, kernels="numba", derive=False, every=100)
            times.append(time.process_time() - start)
        least.append(min(times))
    return 1e3 * (least[1] - least[0]) / round((LONG - SHORT) / STEP)


def main() -> None:
    """Print a line for each pair of treatment and integrator."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=5)
    repeats = parser.parse_args().repeats
    warnings.simplefilter("ignore", sc.CosseratWarning)
    for spring, treatment in (
        (False, sc.NullSpace()),
        (False, sc.Multipliers()),
        (True, sc.NullSpace()),
    ):
        model = scene(spring)
        systems = model.freeze(), model.freeze(planar=sc.Planar())
        for integrator in (sc.EnergyMomentum(), sc.Variational()):
            space, plane = (step_ms(each, integrator, treatment, repeats) for each in systems)
            name = f"{'with a spring, ' if spring else ''}{treatment.name}, {integrator.name}"
            print(f"{name:48} {space:.4f} {plane:.4f} {space / plane:.2f}", flush=True)


if __name__ == "__main__":
    main()
