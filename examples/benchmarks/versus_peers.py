"""Cost of a step and of a Newton iteration against other codes: same scene, mesh and step.

The scene: a rubber rod on a hinge, drawn out of its plane by gravity, linear elements, h = 1e-3 s.
Ours: energy-momentum and variational, null space, compiled kernels. The peers, each in an
environment of its own, called as a subprocess:

*exudyn-exact-beam*: Exudyn's ``ObjectBeamGeometricallyExact``, generalized-alpha, one thread, its
build without range checks, in the best of the settings :func:`candidates` lists (kind of node,
full or modified Newton, linear solver, pattern of the sparse factorisation reused). Its tolerance
is the default one, 1e-8, or the next power of ten its residual reaches in spite of rounding.
*exudyn-ancf-cable*: ``ObjectANCFCable`` (no shear, no torsion), modified Newton, 20 elements.
*pyelastica*: PyElastica, explicit, at its largest stable step.

*step*: the step; *iteration*: a full Newton iteration (residual, matrix, factorisation, solution
and a share of what a step costs beside them), from runs in which every iteration has its own
matrix; *second*: a simulated second. Medians of CPU times over `repeats` runs, ours and the peer's
in turns, after two steps.

Run ``python examples/benchmarks/versus_peers.py --help`` for the choices.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

import measuring  # before numpy: one thread
import numpy as np
import peer_calls
import scenes
from measuring import INTEGRATORS, LENGTH

import skfem_cosserat as sc
from skfem_cosserat.integrators import Stepper

STEP = 1e-3
WARM = 2
EXACT, CABLE, ELASTICA = "exudyn-exact-beam", "exudyn-ancf-cable", "pyelastica"
ADAPTERS = {EXACT: "exudyn_beam", CABLE: "exudyn_cable", ELASTICA: "pyelastica_rod"}
#: how many times faster a step has to be, up to as many elements, than Exudyn's exact beam
STEP_RATIOS = {20: 8.0, 200: 10.0, 2000: 30.0}
#: how many times faster than its full Newton iteration one of ours has to be, by kernels
ITERATION_RATIOS = {"numba": 12.0, "numpy": 1.0}
#: ends of the rods may lie as far apart as discretisations do, relative to its length
TIP = 1e-2
CABLE_ELEMENTS = 20
#: relative tolerances of Exudyn's residual, its default first
TOLERANCES = (1e-8, 1e-7, 1e-6, 1e-5)
#: meshes up to which dense matrices are tried
DENSE = 20
COLUMNS = (
    *("peer", "elements", "measure", "integrator", "kernels", "ours_ms", "peer_ms", "ratio"),
    *("required", "ours_iterations", "peer_iterations", "tip_difference", "steps", "setting"),
)
TRIED = (
    *("elements", "ms_per_step", "ms_per_iteration", "iterations_per_step"),
    *("factorisations_per_step", "status", "setting"),
)


def scene(elements: int, steps: int, step: float, **options: Any) -> dict[str, Any]:
    """The rod for the adapters: so many steps, the first ones not timed."""
    until = step * steps
    asked = {"step": step, "warm": WARM, "options": options}
    return {**scenes.rod(elements, until, until), **asked}


def window(elements: int) -> int:
    """Steps that are timed: some seconds of the slowest code."""
    return int(np.clip(100_000 // elements, 50, 300))


def candidates(elements: int, element: str = EXACT) -> Iterator[dict[str, Any]]:
    """Settings of Exudyn that are tried, as options of the adapter."""
    sparse = [("EigenSparse", False), ("EigenSparse", True), ("EigenSparseSymmetric", False)]
    dense = [("EXUdense", False), ("EigenDense", False)] if elements <= DENSE else []
    nodes = ("Rxyz", "EP", "RotVecLG") if element == EXACT else ("EP",)
    newtons = ("full", "modified") if element == EXACT else ("modified",)
    for node, newton, (solver, reuse) in product(nodes, newtons, (*sparse, *dense)):
        yield {"node": node, "newton": newton, "solver": solver, "reuse_pattern": reuse}


Ask = Callable[..., dict[str, Any]]


def reachable(ask: Ask) -> float:
    """The tightest of the tolerances with which full Newton runs converge."""
    for tolerance in TOLERANCES:
        if ask(newton="full", tolerance=tolerance)["status"] == "completed":
            return tolerance
    return TOLERANCES[-1]


def survey(ask: Ask, elements: int, element: str = EXACT) -> list[dict[str, Any]]:
    """One run of each setting: its cost, or why there is none."""
    tolerance = reachable(ask) if element == EXACT else TOLERANCES[0]
    found = []
    for options in candidates(elements, element):
        setting = {**options, "tolerance": tolerance}
        answer = ask(**setting)
        row = {"elements": elements, "setting": setting, "status": answer["status"]}
        if answer["status"] == "completed":
            factorisations = answer["factorisations_per_step"]
            row |= {"full": factorisations == answer["iterations_per_step"], **answer}
        found.append(row)
    return found


def best(found: Sequence[dict[str, Any]], measure: str) -> dict[str, Any] | None:
    """The fastest setting; for iterations, of those that factorise in each."""
    done = [r for r in found if r["status"] == "completed" and (measure == "step" or r["full"])]
    return min(done, key=lambda r: r[f"ms_per_{measure}"], default=None)


def ours(elements: int, integrator: str, kernels: str, full: bool, steps: int) -> dict[str, Any]:
    """One run of this package: cost, iterations, and where the free end is."""
    system = measuring.chain(elements, 1)
    settings = measuring.full_newton() if full else None
    own = INTEGRATORS[integrator](), sc.NullSpace(), STEP
    stepper = Stepper(system, *own, settings, kernels=kernels)
    run = measuring.advance(stepper, sc.initial_state(system), WARM)
    run = measuring.advance(stepper, run.state, steps)
    return {
        "ms_per_step": 1e3 * run.seconds / steps,
        "ms_per_iteration": 1e3 * run.seconds / run.iterations,
        "iterations_per_step": run.iterations / steps,
        "tip": measuring.tip(system, run.state),
    }


def required(peer: str, measure: str, elements: int, kernels: str) -> float | None:
    """How many times faster we have to be."""
    if peer == EXACT and measure == "step":
        return next((STEP_RATIOS[n] for n in STEP_RATIOS if n >= elements), STEP_RATIOS[2000])
    if peer == EXACT:
        return ITERATION_RATIOS[kernels]
    return 1.0 if peer == CABLE else None


def compared(
    peer: str, elements: int, measure: str, pairs: Sequence[tuple[str, str]], repeats: int, ask: Ask
) -> list[dict[str, Any]]:
    """Medians over the repeats, the peer's runs and ours in turns, a row for each of the pairs.

    `pairs`: integrator and kernels. `ask` runs the peer.
    """
    steps, full = window(elements), measure == "iteration"
    theirs: list[dict[str, Any]] = []
    mine: dict[tuple[str, str], list[dict[str, Any]]] = {pair: [] for pair in pairs}
    for _ in range(repeats):
        theirs.append(ask())
        for pair in pairs:
            mine[pair].append(ours(elements, *pair, full, steps))
    if any(answer["status"] != "completed" for answer in theirs):
        return []
    rows = []
    for (integrator, kernels), runs in mine.items():
        own = median(r[f"ms_per_{measure}"] for r in runs)
        cost = median(r[f"ms_per_{measure}"] for r in theirs)
        rows.append(
            {
                "peer": peer,
                "elements": elements,
                "measure": measure,
                "integrator": integrator,
                "kernels": kernels,
                "ours_ms": own,
                "peer_ms": cost,
                "ratio": cost / own,
                "required": required(peer, measure, elements, kernels),
                "ours_iterations": runs[0]["iterations_per_step"],
                "peer_iterations": theirs[0]["iterations_per_step"],
                "tip_difference": apart(runs[0]["tip"], theirs[0]["tip"]),
                "steps": steps,
            }
        )
    return rows


def apart(a: Any, b: Any) -> float:
    """Distance of two ends of the rod, relative to its length."""
    return float(np.linalg.norm(np.asarray(a) - np.asarray(b))) / LENGTH


def asked(python: Path, adapter: peer_calls.Peer, question: dict[str, Any]) -> dict[str, Any]:
    """The answer of an adapter, by step, and where the free end is."""
    answer = peer_calls.ask(python, adapter, question, timeout=600)
    if answer["status"] != "completed":
        return answer
    steps, iterations = answer["steps"], answer.get("iterations") or answer["steps"]
    return {
        "status": "completed",
        "ms_per_step": 1e3 * answer["seconds"] / steps,
        "ms_per_iteration": 1e3 * answer["seconds"] / iterations,
        "iterations_per_step": iterations / steps,  # one, if explicit
        "factorisations_per_step": answer.get("factorisations", 0) / steps,
        "tip": answer["positions"][-1],
    }


def exudyn(python: Path, elements: int, repeats: int, peer: str) -> dict[str, Any]:
    """Rows against one of Exudyn's beams, the settings tried, and what is missing."""

    def ask(**options: Any) -> dict[str, Any]:
        question = scene(elements, WARM + window(elements), STEP, **options)
        return asked(python, peer_calls.peers()[ADAPTERS[peer]], question)

    tried, rows, missing = survey(ask, elements, peer), [], {}
    for measure in ("step", "iteration") if peer == EXACT else ("step",):
        chosen = best(tried, measure)
        if chosen is None:
            missing[f"{peer}, {elements} elements, {measure}"] = tried[0]["status"]
            continue
        setting = chosen["setting"]
        kinds = ("numba", "numpy") if measure == "iteration" else ("numba",)
        pairs = list(product(INTEGRATORS, kinds))
        new = compared(peer, elements, measure, pairs, repeats, lambda s=setting: ask(**s))
        rows += [{**row, "setting": in_words(setting)} for row in new]
        if not new:
            missing[f"{peer}, {elements} elements, {measure}"] = "failed when run again"
    return {"rows": rows, "tried": tried, "missing": missing}


def in_words(setting: dict[str, Any]) -> str:
    """Options of an adapter, for a table."""
    return " ".join(f"{name}={value}" for name, value in setting.items())


def pyelastica(python: Path, elements: int, repeats: int) -> dict[str, Any]:
    """Rows against PyElastica at its largest stable step: of a step, and of a simulated second."""
    until, adapter = (WARM + window(elements)) * STEP, peer_calls.peers()[ADAPTERS[ELASTICA]]
    stiffness = measuring.rubber().stiffness
    step = 2 * LENGTH / elements / (stiffness[2, 2] / measuring.rubber().mass) ** 0.5
    while True:  # a run that is unstable ends far away, or nowhere
        question = scene(elements, int(np.ceil(until / step)), until / np.ceil(until / step))
        answer = asked(python, adapter, question)
        if answer["status"] == "completed" and np.linalg.norm(answer["tip"]) < 1.05 * LENGTH:
            break
        if not answer["status"].startswith(("completed", "unstable")):
            missing = {f"{ELASTICA}, {elements} elements": answer["status"]}
            return {"rows": [], "missing": missing}
        step /= 2**0.25
    pairs = [(name, "numba") for name in INTEGRATORS]
    again = lambda: asked(python, adapter, question)  # noqa: E731
    rows = compared(ELASTICA, elements, "step", pairs, repeats, again)
    for row in list(rows):
        row["setting"] = f"PositionVerlet, step {question['step']:.3g} s"
        scaled = {
            "ours_ms": row["ours_ms"] / STEP,
            "peer_ms": row["peer_ms"] / question["step"],
        }
        ratio = scaled["peer_ms"] / scaled["ours_ms"]
        rows.append({**row, "measure": "second", **scaled, "ratio": ratio})
    return {"rows": rows, "missing": {}}


def main(
    quick: bool = True,
    elements: Sequence[int] | None = None,
    repeats: int = 3,
    environments: str | Path | None = None,
    out: str | Path | None = None,
    peers: Sequence[str] = (EXACT, CABLE, ELASTICA),
) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    quick : bool
        20 and 200 elements, otherwise 2000, too.
    elements : sequence of int, optional
        These instead (the cable: 20 always).
    repeats : int
        Runs of which the median is taken.
    environments : path, optional
        Folder of the peers' environments; default: in the user's cache.
    out : path, optional
        Folder for versus_peers.csv and versus_peers.settings.csv.
    peers : sequence of str
        Only these.

    Returns
    -------
    dict
        ``rows``, ``tried`` (settings of Exudyn), ``missing`` (what could not be measured, and why),
        ``dgemm_gflops`` and where it was measured.
    """
    sizes = tuple(elements or ((20, 200) if quick else (20, 200, 2000)))
    result: dict[str, Any] = {"rows": [], "tried": [], "missing": {}}
    for peer in peers:
        try:
            python = peer_calls.prepare(peer_calls.peers()[ADAPTERS[peer]], environments)
        except peer_calls.Unavailable as error:
            result["missing"][peer] = str(error)
            continue
        for size in (CABLE_ELEMENTS,) if peer == CABLE else sizes:
            if peer == ELASTICA:
                found = pyelastica(python, size, repeats)
            else:
                found = exudyn(python, size, repeats, peer)
            result["rows"] += found["rows"]
            result["tried"] += found.get("tried", [])
            result["missing"] |= found["missing"]
    result |= measuring.environment()
    known = {peer_calls.peers()[ADAPTERS[peer]].requirement for peer in peers}
    result["notes"] = {"missing": result["missing"], "peers": sorted(known)}
    if out is not None:
        measuring.write(Path(out) / "versus_peers.csv", result, COLUMNS)
        tried = [{**row, "setting": in_words(row["setting"])} for row in result["tried"]]
        settings = {**result, "rows": tried}
        measuring.write(Path(out) / "versus_peers.settings.csv", settings, TRIED)
    return result


def missed(result: dict[str, Any]) -> list[str]:
    """What does not come up to the figures."""
    out = [f"{what}: not measured: {why}" for what, why in result["missing"].items()]
    for row in result["rows"]:
        name = f"{row['peer']}, {row['elements']} elements, {row['measure']}"
        name = f"{name}, {row['integrator']}, {row['kernels']}"
        if row["required"] is not None and not row["ratio"] >= row["required"]:
            out.append(f"{name}: {row['ratio']:.2f} times faster, required {row['required']:g}")
        if not row["tip_difference"] <= TIP:
            out.append(f"{name}: ends are {row['tip_difference']:.2e} lengths apart, at most {TIP}")
    return out


def report(result: dict[str, Any]) -> str:
    """The settings tried and the rows, as text."""
    tried = [{**row, "setting": in_words(row["setting"])} for row in result["tried"]]
    parts = [measuring.table(tried, TRIED), measuring.table(result["rows"], COLUMNS)]
    return "\n\n".join(parts)


if __name__ == "__main__":
    sys.exit(measuring.command(__doc__, main, report, missed, options=("environments",)))
