"""CPU time to reach an error: each code with the cheapest order, mesh and step of a printed grid.

The scene of ``versus_peers.py``: a rubber rod on a hinge swings for half a second. Error: largest
distance of the free end from the reference at 50 instants, relative to the rod's length. Reference:
elements of order 4, extrapolated from two steps (energy-momentum); its own error is estimated as
its distance from an extrapolated run on another mesh, of another order, with the variational
integrator. Ours: both integrators, orders 1 to 4, compiled kernels. Exudyn: its exact beam, which
is linear, modified Newton, generalized-alpha, with its default tolerance and a looser one.

CPU times of the steps alone, without model, compilation and recording. The whole grid is run once,
but for setups that must take longer than what has reached all errors already, and for smaller steps
(finer meshes) where the last ones have changed nothing; what reaches an error cheapest is run
again, `repeats` times, for the median. Runs that fail stay in the table.

Run ``python examples/benchmarks/time_to_accuracy.py --help`` for the choices.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parent))

import measuring  # before numpy: one thread
import numpy as np
import peer_calls
import versus_peers
from measuring import INTEGRATORS, LENGTH

import skfem_cosserat as sc
from skfem_cosserat import CosseratError
from skfem_cosserat.integrators import Stepper

OURS, EXUDYN = "skfem-cosserat", "exudyn-exact-beam"
UNTIL, SAMPLE = 0.5, 1e-2
TARGETS = (1e-3, 1e-5)
#: how many times less CPU time than Exudyn each of them has to take
RATIO = 10.0
STEPS = (1e-2, 5e-3, 2.5e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4, 6.25e-5)
MESHES = {
    1: (10, 20, 40, 80, 160, 320, 640),
    2: (4, 8, 16, 32, 64),
    3: (2, 4, 8, 16, 32),
    4: (2, 4, 8, 16),
}
#: relative change of the error below which it is no matter of the step, or of the mesh
SETTLED = 0.1
TOLERANCES = (1e-8, 1e-5)
NODES = (("EP", "--reuse-pattern"),)  # what versus_peers.py finds best
#: a quick grid finds the first error only
QUICK = {"steps": (1e-2, 2.5e-3, 1e-3), "meshes": {1: (10, 20, 40, 80), 3: (4, 8)}}
COLUMNS = (
    *("code", "integrator", "order", "elements", "step", "error", "cpu_s", "status", "setting"),
)


class Setup(NamedTuple):
    """A point of the grid."""

    code: str
    integrator: str
    order: int
    elements: int
    step: float
    setting: tuple[str, ...] = ()

    @property
    def work(self) -> float:
        """What its cost is about proportional to: nodes times steps."""
        return self.order * self.elements / self.step


class Answer(NamedTuple):
    """The free end at the instants, the CPU time, and how the run ended."""

    path: np.ndarray | None
    seconds: float
    status: str = "completed"


def run_ours(setup: Setup, kernels: str = "numba", until: float = UNTIL) -> Answer:
    """One run of this package."""
    system = measuring.chain(setup.elements, setup.order)
    own = INTEGRATORS[setup.integrator](), sc.NullSpace(), setup.step
    warm = Stepper(system, *own, kernels=kernels)
    stepper = Stepper(system, *own, kernels=kernels)
    state, path, seconds = sc.initial_state(system), [], 0.0
    try:
        measuring.advance(warm, state, 2)
        for _ in range(round(until / SAMPLE)):
            run = measuring.advance(stepper, state, round(SAMPLE / setup.step))
            state, seconds = run.state, seconds + run.seconds
            path.append(measuring.tip(system, state))
    except CosseratError as error:
        return Answer(None, seconds, " ".join(str(error).split())[:120])
    return Answer(np.array(path), seconds)


def run_exudyn(python: Path, setup: Setup) -> Answer:
    """One run of Exudyn's exact beam."""
    warm, steps = 2, round(UNTIL / setup.step)
    scene = json.dumps(versus_peers.scene())
    options = ("--scene", scene, "--elements", str(setup.elements), "--step", str(setup.step))
    options += ("--warm", str(warm), "--steps", str(steps - warm), "--sample", str(SAMPLE))
    answer = peer_calls.ask(python, peer_calls.EXUDYN, *options, *setup.setting, timeout=600)
    if answer["status"] != "completed":
        return Answer(None, np.nan, answer["status"])
    rows = np.array(answer["path"])
    rows = rows[np.unique(rows[:, 0].round(9), return_index=True)[1]]
    times = SAMPLE * np.arange(1, round(UNTIL / SAMPLE) + 1)
    near = np.abs(rows[:, :1] - times).argmin(axis=0)
    if abs(rows[near, 0] - times).max() > 1e-6:
        return Answer(None, np.nan, "its path has no values at the instants")
    return Answer(rows[near, 1:4], 1e-3 * answer["ms_per_step"] * steps)


def extrapolated(setup: Setup, until: float = UNTIL) -> np.ndarray:
    """Path of the free end, with the error in the step removed to leading order."""
    coarse, fine = (run_ours(setup._replace(step=setup.step / k), until=until) for k in (1, 2))
    if coarse.path is None or fine.path is None:
        raise RuntimeError(f"the reference {setup} failed: {coarse.status}; {fine.status}")
    return np.asarray(fine.path + (fine.path - coarse.path) / 3)


def reference(quick: bool, until: float = UNTIL) -> tuple[np.ndarray, float]:
    """Path of the free end, and its estimated error relative to the rod's length."""
    step = 2.5e-4 if quick else 1e-4
    path = extrapolated(Setup(OURS, "energy-momentum", 4, 16 if quick else 32, step), until)
    other = extrapolated(Setup(OURS, "variational", 3, 24 if quick else 60, step), until)
    return path, distance(path, other)


def distance(path: np.ndarray, other: np.ndarray) -> float:
    """Largest one of two paths, relative to the rod's length."""
    return float(np.linalg.norm(path - other, axis=1).max()) / LENGTH


def grid_ours(steps: Sequence[float], meshes: dict[int, Sequence[int]]) -> list[Setup]:
    """All setups of this package."""
    mesh = [(order, n) for order, sizes in meshes.items() for n in sizes]
    found = product(INTEGRATORS, mesh, steps)
    return [Setup(OURS, name, order, n, step) for name, (order, n), step in found]


def grid_exudyn(steps: Sequence[float], meshes: Sequence[int]) -> list[Setup]:
    """All setups of Exudyn."""
    return [
        Setup(
            *(EXUDYN, "generalized-alpha", 1, n, step),
            ("--node", *node, "--tolerance", str(tolerance)),
        )
        for n, step, node, tolerance in product(meshes, steps, NODES, TOLERANCES)
    ]


def explored(
    grid: Sequence[Setup], run: Callable[[Setup], Answer], path: np.ndarray
) -> list[dict[str, Any]]:
    """A row for each setup, cheap ones first; those that come too late are not run."""
    rows: list[dict[str, Any]] = []
    rates: dict[int, float] = {}
    errors: dict[Any, list[float]] = {}  # of a mesh with smaller steps, of a step on finer meshes
    for setup in sorted(grid, key=lambda s: s.work):
        row = {**setup._asdict(), "setting": " ".join(setup.setting), "setup": setup}
        reached = [cheapest(rows, target) for target in TARGETS]
        enough = max((r["cpu_s"] for r in reached if r is not None), default=np.inf)
        # a larger mesh costs no less than half as much a node as the cheapest seen
        if all(reached) and 0.5 * rates.get(setup.order, 0.0) * setup.work > enough:
            rows.append({**row, "error": None, "cpu_s": None, "status": "skipped: takes longer"})
            continue
        same = {"step": setup._replace(elements=0), "mesh": setup._replace(step=0.0)}
        limits = [name for name, key in same.items() if settled(errors.get(key, []))]
        if limits:
            why = f"skipped: its {limits[0]} limits the error"
            rows.append({**row, "error": None, "cpu_s": None, "status": why})
            continue
        answer = run(setup)
        error = None if answer.path is None else distance(answer.path, path)
        if error is not None:
            rate = answer.seconds / setup.work
            rates[setup.order] = min(rates.get(setup.order, rate), rate)
            for key in same.values():
                errors.setdefault(key, []).append(error)
        rows.append({**row, "error": error, "cpu_s": answer.seconds, "status": answer.status})
    return rows


def settled(errors: Sequence[float]) -> bool:
    """Whether the last two of three refinements have changed nothing worth mentioning."""
    return len(errors) > 2 and bool(np.ptp(errors[-3:]) < SETTLED * errors[-1])


def cheapest(rows: Sequence[dict[str, Any]], target: float) -> dict[str, Any] | None:
    """What reaches an error in the shortest time."""
    done = [r for r in rows if r["error"] is not None and r["error"] <= target]
    return min(done, key=lambda r: r["cpu_s"], default=None)


def winners(
    rows: Sequence[dict[str, Any]], runs: dict[str, Callable[[Setup], Answer]], repeats: int
) -> list[dict[str, Any]]:
    """The cheapest of each code for each error, timed again, in turns."""
    out = []
    for target in TARGETS:
        best = {c: cheapest([r for r in rows if r["code"] == c], target) for c in runs}
        times: dict[str, list[float]] = {code: [] for code in runs}
        for _, (code, row) in product(range(repeats), best.items()):
            if row is not None:
                times[code].append(runs[code](row["setup"]).seconds)
        cpu = {code: median(t) if t else None for code, t in times.items()}
        mine, theirs = cpu.get(OURS), cpu.get(EXUDYN)
        ratio = None if mine is None or theirs is None else theirs / mine
        out.append({"target": target, "best": best, "cpu_s": cpu, "ratio": ratio})
    return out


def main(
    quick: bool = True,
    repeats: int = 3,
    environments: str | Path | None = None,
    out: str | Path | None = None,
    steps: Sequence[float] | None = None,
    meshes: dict[int, Sequence[int]] | None = None,
    peers: Sequence[str] = (EXUDYN,),
) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    quick : bool
        A small grid and a coarse reference, good for the first error only.
    repeats : int
        Runs of the cheapest setups of which the median is taken.
    environments : path, optional
        Folder of the peers' environments; default: in the user's cache.
    out : path, optional
        Folder for time_to_accuracy.csv and, where matplotlib is there, time_to_accuracy.png.
    steps, meshes : sequence and dict, optional
        Another grid: steps, elements by order.
    peers : sequence of str
        Empty: this package alone.

    Returns
    -------
    dict
        ``rows``, ``winners`` for each error, ``targets``, ``reference_error``, ``missing``,
        ``dgemm_gflops`` and where it was measured.
    """
    sizes = meshes or (QUICK["meshes"] if quick else MESHES)
    lengths = steps or (QUICK["steps"] if quick else STEPS)
    path, own_error = reference(quick)
    runs: dict[str, Callable[[Setup], Answer]] = {OURS: run_ours}
    rows, missing = explored(grid_ours(lengths, sizes), run_ours, path), {}
    if EXUDYN in peers:
        try:
            python = peer_calls.prepare(peer_calls.EXUDYN, environments)
        except peer_calls.Unavailable as error:
            missing[EXUDYN] = str(error)
        else:
            runs[EXUDYN] = lambda setup: run_exudyn(python, setup)
            rows += explored(grid_exudyn(lengths, sizes[1]), runs[EXUDYN], path)
    result = {
        "rows": rows,
        "winners": winners(rows, runs, repeats),
        "targets": TARGETS[:1] if quick else TARGETS,
        "reference_error": own_error,
        "missing": missing,
        **measuring.environment(),
    }
    for row in rows:
        del row["setup"]
    result["notes"] = {"reference error": own_error, "cheapest": summary(result)}
    if out is not None:
        measuring.write(Path(out) / "time_to_accuracy.csv", result, COLUMNS)
        chart(result, Path(out) / "time_to_accuracy.png")
    return result


def summary(result: dict[str, Any]) -> list[str]:
    """What reached the errors cheapest."""
    lines = []
    for entry in result["winners"]:
        for code, row in entry["best"].items():
            text = f"{entry['target']:g} L: {code}: "
            if row is None:
                lines.append(text + "not reached")
                continue
            lines.append(
                f"{text}{row['integrator']}, order {row['order']}, {row['elements']} elements,"
                f" h = {row['step']:g} s {row['setting']}: {row['error']:.2e} L in"
                f" {entry['cpu_s'][code]:.4g} s"
            )
        if entry["ratio"] is not None:
            lines.append(f"{entry['target']:g} L: {entry['ratio']:.1f} times less CPU time")
    return lines


def missed(result: dict[str, Any]) -> list[str]:
    """What does not come up to the figures."""
    out = [f"{code}: not measured: {why}" for code, why in result["missing"].items()]
    for entry in result["winners"]:
        target = entry["target"]
        if target not in result["targets"]:
            continue
        if not result["reference_error"] <= 0.2 * target:
            out.append(f"{target:g} L: the reference is off by {result['reference_error']:.1e}")
        if entry["cpu_s"].get(OURS) is None:
            out.append(f"{target:g} L: not reached")
        elif entry["ratio"] is None and not result["missing"]:
            out.append(f"{target:g} L: not reached by {EXUDYN} on its grid: nothing to compare")
        elif entry["ratio"] is not None and not entry["ratio"] >= RATIO:
            out.append(f"{target:g} L: {entry['ratio']:.2f} times less CPU, required {RATIO:g}")
    return out


def report(result: dict[str, Any]) -> str:
    """The grid and what was cheapest, as text."""
    lines = [measuring.table(result["rows"], COLUMNS), ""]
    lines += [f"error of the reference: {result['reference_error']:.2e} L", *summary(result)]
    return "\n".join(lines)


def chart(result: dict[str, Any], path: Path) -> None:
    """Error against CPU time, where matplotlib is there."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.subplots()
    for code, colour in ((OURS, "tab:blue"), (EXUDYN, "tab:red")):
        points = [
            (r["cpu_s"], r["error"], r["order"])
            for r in result["rows"]
            if r["code"] == code and r["error"] is not None
        ]
        for order, marker in zip((1, 2, 3, 4), "o^sD", strict=True):
            own = [(t, e) for t, e, p in points if p == order]
            if own:
                style = {"color": colour, "marker": marker, "s": 10, "alpha": 0.35, "lw": 0}
                axes.scatter(*zip(*own, strict=True), label=f"{code}, order {order}", **style)
        front = [(t, e) for t, e, _ in sorted(points)]
        front = [
            (t, e) for k, (t, e) in enumerate(front) if e < min([9, *(f[1] for f in front[:k])])
        ]
        if front:
            axes.plot(*zip(*front, strict=True), color=colour, lw=1.2)
    for target in TARGETS:
        axes.axhline(target, color="0.6", lw=0.6)
    axes.set(xscale="log", yscale="log", xlabel="CPU time of the steps in s")
    axes.set_ylabel("largest error of the free end, relative to the length")
    axes.legend(fontsize="x-small")
    axes.grid(which="major", alpha=0.3)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    sys.exit(measuring.command(__doc__, main, report, missed, options=("environments",)))
