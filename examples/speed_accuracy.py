"""Error against cost of both integrators and both treatments on the three-bar swing.

Error: position of the mid mass at t = 1.2 s against the Richardson value of two fine runs, whose
difference to the finer one is the reference's own error estimate. Cost: minimum wall time of
`repeats` runs after a warm-up, recorded states only. Writes ``speed_accuracy.csv`` and, where
matplotlib is there, ``speed_accuracy.png``.
"""

from __future__ import annotations

import argparse
import csv
import importlib.util
import platform
import time
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import skfem

import skfem_cosserat as sc

HERE = Path(__file__).resolve().parent
UNTIL = 1.2


def _swing() -> Any:
    spec = importlib.util.spec_from_file_location("swing", HERE / "three_bar_swing.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _position(system: sc.System, integrator: Any, treatment: Any, step: float) -> tuple[Any, float]:
    start = time.perf_counter()
    history = sc.simulate(
        system,
        integrator,
        treatment,
        step,
        UNTIL,
        derive=False,
        at=[UNTIL],
        kernels="numpy",
    )
    cost = time.perf_counter() - start
    beam: Any = system.structures[0]
    return history["q"][-1, system.offset(beam.node("mid")) + np.arange(3)], cost


def main(quick: bool = True, repeats: int = 3, out: str | Path | None = None) -> dict[str, Any]:
    """Rows (integrator, treatment, step, error, cost) and the reference's error estimate.

    Parameters
    ----------
    quick : bool
        Four step sizes instead of six, a coarser reference.
    repeats : int
        Timed runs of each setup.
    out : path, optional
        Folder for CSV and chart; None: nothing is written.
    """
    swing = _swing()
    system = swing.build()
    count = 4 if quick else 6
    steps = [2.5e-2 / 2**k for k in range(count)]  # kinks of the pulse on step ends
    fine = [steps[-1] / 4, steps[-1] / 8]
    coarse, finer = (_position(system, sc.EnergyMomentum(), sc.NullSpace(), h)[0] for h in fine)
    reference = finer + (finer - coarse) / 3
    rows = []
    for name, integrator in swing.INTEGRATORS.items():
        for label, treatment in swing.TREATMENTS.items():
            for step in steps:
                runs = [_position(system, integrator(), treatment(), step) for _ in range(repeats)]
                error = float(np.linalg.norm(runs[0][0] - reference))
                cost = min(cost for _, cost in runs)
                rows.append((name, label, step, error, cost))
    result = {"rows": rows, "reference_error": float(np.linalg.norm(finer - reference))}
    if out is not None:
        _write(result, Path(out))
    return result


def _write(result: dict[str, Any], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "speed_accuracy.csv").open("w", newline="") as file:
        file.write(
            f"# skfem-cosserat {sc.__version__}, numpy {np.__version__}, scipy {scipy.__version__},"
            f" scikit-fem {skfem.__version__}, Python {platform.python_version()},"
            f" {platform.machine()}; reference error {result['reference_error']:.2e} m\n"
        )
        writer = csv.writer(file)
        writer.writerow(["integrator", "treatment", "step_s", "error_m", "cost_s"])
        writer.writerows(result["rows"])
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return
    figure = Figure(figsize=(6, 4), layout="constrained")
    axis = figure.subplots()
    for pair in dict.fromkeys(row[:2] for row in result["rows"]):
        points = np.array([row[3:] for row in result["rows"] if row[:2] == pair])
        axis.loglog(points[:, 1], points[:, 0], "o-", label=", ".join(pair), markersize=4)
    axis.set_xlabel("wall time in s")
    axis.set_ylabel("error of the mass position at 1.2 s in m")
    axis.grid(which="both", alpha=0.3)
    axis.legend(fontsize="small")
    figure.savefig(folder / "speed_accuracy.png", dpi=120)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--out", default=str(HERE / "pictures"))
    arguments = parser.parse_args()
    for row in main(quick=not arguments.full, out=arguments.out)["rows"]:
        print(f"{row[0]:16s} {row[1]:12s} h = {row[2]:.5f} s  {row[3]:.2e} m  {row[4]:.3f} s")
