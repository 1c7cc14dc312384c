"""Memory against the size of the mesh and the number of steps.

*mesh*: how much more memory a fresh process needs at its peak (resident set) for model, stepper and
two steps of the rod on a hinge, the code being loaded. *steps*: resident set of the three-bar swing
(energy-momentum, null space, h = 1e-2 s) after more and more steps of a ``Stepper``; *streamed*:
the same of ``simulate(path=..., every=1000)``, whose history goes to a file.

Run ``python examples/benchmarks/memory.py --help`` for the choices.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import measuring  # before numpy: one thread
import numpy as np

import skfem_cosserat as sc
from paper import three_bar_swing
from skfem_cosserat.integrators import Stepper

STEP = 1e-2
#: largest exponent with which memory may grow with the elements
EXPONENT = 1.05
#: scenes below which what is allocated for single elements does not matter
LARGE = 2000
#: what may be added after the first steps (MB): what the allocator keeps for later
GROWTH = 2.0
#: steps after which everything has been allocated once
SETTLED = 1000
#: steps that take an hour with plain kernels
MANY = 100_000
COLUMNS = ("measure", "kernels", "elements", "steps", "megabytes", "kilobytes_per_element")


def resident() -> float:
    """Resident set of this process (MB); where the system does not tell it, its peak."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return peak()
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def peak() -> float:
    """Largest resident set so far, or since :func:`forget_peak` (MB)."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        import resource

        unit = 1e6 if sys.platform == "darwin" else 1e3
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
    return next(int(line.split()[1]) * 1.024e-3 for line in lines if line.startswith("VmHWM"))


def forget_peak() -> None:
    """Start :func:`peak` anew, where the system can."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return


def needed(elements: int, kernels: str) -> float:
    """Of this process, for a rod of as many elements (MB)."""
    _two_steps(4, kernels)  # code and tables that every run needs
    before = resident()
    forget_peak()
    _two_steps(elements, kernels)
    return peak() - before


def _two_steps(elements: int, kernels: str) -> None:
    system = measuring.chain(elements, 1)
    own = sc.EnergyMomentum(), sc.NullSpace(), 1e-3
    measuring.advance(Stepper(system, *own, kernels=kernels), sc.initial_state(system), 2)


def alone(*arguments: Any) -> Any:
    """What this file answers in a fresh process."""
    command = [sys.executable, str(Path(__file__).resolve()), "--alone", json.dumps(arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def kernels_for(steps: int) -> str:
    """Compiled ones where plain ones would take an hour."""
    return "numba" if steps >= MANY and find_spec("numba") else "numpy"


def instants(steps: int) -> list[int]:
    """Numbers of steps at which memory is looked at: powers of ten, and ten times in between."""
    even = np.linspace(0, steps, 11)[1:].astype(int)
    powers = [10**k for k in range(3, 10) if 10**k <= steps]
    return sorted({int(k) for k in (*even, *powers) if k >= min(SETTLED, steps)})


def after_steps(steps: int) -> tuple[str, list[tuple[int, float]]]:
    """Kernels that ran, and memory of the swing at some numbers of steps."""
    when, found = set(instants(steps)), []
    system, own = three_bar_swing.build(), (sc.EnergyMomentum(), sc.NullSpace(), STEP)
    stepper = Stepper(system, *own, kernels=kernels_for(steps), steps=steps)
    state = sc.initial_state(system)
    for k in range(1, steps + 1):
        state = stepper.advance(state).state
        if k in when:
            found.append((k, resident()))
    return stepper.choice.name, found


def streamed(steps: int) -> tuple[str, list[tuple[int, float]]]:
    """The same, with a history that is written to a file."""
    when, found = set(instants(steps)), []

    def look(report: Any) -> None:
        if report.state.index in when:
            found.append((report.state.index, resident()))

    own = sc.EnergyMomentum(), sc.NullSpace(), STEP, steps * STEP
    with TemporaryDirectory() as folder:
        path = Path(folder) / "swing.history"
        options = {"every": 1000, "derive": False, "kernels": kernels_for(steps)}
        history = sc.simulate(three_bar_swing.build(), *own, path=path, callbacks=[look], **options)
    return history.meta["kernels"], found


def main(
    quick: bool = True,
    elements: Sequence[int] | None = None,
    steps: int | None = None,
    kernels: Sequence[str] = ("numba", "numpy"),
    out: str | Path | None = None,
) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    quick : bool
        Up to 6000 elements and 20 000 steps, otherwise 20 000 and a million.
    elements, steps : sequence and int, optional
        Others.
    kernels : sequence of str
        For the meshes.
    out : path, optional
        Folder for memory.csv.

    Returns
    -------
    dict
        ``rows``, ``exponents`` of memory in the number of elements by kernels, ``growth`` since the
        first thousand steps (MB), ``dgemm_gflops`` and where it was measured.
    """
    sizes = tuple(elements or ((200, 2000, 6000) if quick else (200, 2000, 6000, 20000)))
    count = (20_000 if quick else 1_000_000) if steps is None else steps
    rows: list[dict[str, Any]] = []
    for kind in kernels:
        for size in sizes:
            megabytes = alone("needed", size, kind)
            row = {"measure": "mesh", "kernels": kind, "elements": size, "steps": 2}
            per_element = 1e3 * megabytes / size
            rows.append({**row, "megabytes": megabytes, "kilobytes_per_element": per_element})
    growth = {}
    for measure in ("after_steps", "streamed") if count else ():
        ran, found = alone(measure, count)
        name = measure.removeprefix("after_")
        row = {"measure": name, "kernels": ran, "elements": 20}
        rows += [{**row, "steps": k, "megabytes": megabytes} for k, megabytes in found]
        growth[name] = max(m for _, m in found) - found[0][1]
    result = {"rows": rows, "exponents": exponents(rows), "growth": growth}
    result |= measuring.environment()
    if out is not None:
        measuring.write(Path(out) / "memory.csv", result, COLUMNS)
    return result


def exponents(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Slopes of log(memory) against log(elements) of large meshes."""
    out = {}
    for kind in {row["kernels"] for row in rows}:
        own = [
            (row["elements"], row["megabytes"])
            for row in rows
            if row["measure"] == "mesh" and row["kernels"] == kind and row["elements"] >= LARGE
        ]
        if len(own) > 1:
            x, y = np.log(np.array(own)).T
            out[kind] = float(np.polyfit(x, y, 1)[0])
    return dict(sorted(out.items()))


def missed(result: dict[str, Any]) -> list[str]:
    """What does not come up to the figures."""
    out = [
        f"{kind}: memory grows with exponent {value:.3f} in the elements, above {EXPONENT}"
        for kind, value in result["exponents"].items()
        if not value <= EXPONENT
    ]
    out += [
        f"{measure}: {value:.2f} MB more than after {SETTLED} steps, at most {GROWTH:g}"
        for measure, value in result["growth"].items()
        if not value <= GROWTH
    ]
    return out


def report(result: dict[str, Any]) -> str:
    """The table as text."""
    lines = [measuring.table(result["rows"], COLUMNS)]
    lines += [f"exponent {value:.3f}  {kind}" for kind, value in result["exponents"].items()]
    lines += [f"growth {value:.2f} MB  {name}" for name, value in result["growth"].items()]
    return "\n".join(lines)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--alone"]:
        name, *rest = json.loads(sys.argv[2])
        called = {"needed": needed, "after_steps": after_steps, "streamed": streamed}[name]
        print(json.dumps(called(*rest)))
        sys.exit(0)
    sys.exit(measuring.command(__doc__, main, report, missed))
