"""Speed against accuracy: five scenes, all integrators of this package, and its peers.

The scenes: a rod on a hinge, the flying spaghetti, the three-bar swing, a four-bar linkage with an
elastic coupler, a stiff blade (scenes.py). The peers: all adapters of the folder peers. Those that
refuse a scene, or cannot be installed, are rows that say so.

Error: largest distance of a point from the reference at instants that all runs reach, relative to
the largest distance of that point from where it was at the start. The reference: elements of order
4, extrapolated from two steps (energy-momentum); its own error is its distance from an extrapolated
run of order 3 on another mesh with the variational integrator.

Ours: orders 1 to 4, meshes and steps with the two classic integrators, null space; the meshes on
their front with all other integrators, and with multipliers (explicit ones: with these alone); all
on compiled kernels. Setups whose steps or mesh have settled the error, which must be dearer than
what has reached all errors already, or take longer than a run may, are not run.

Cost of the steps: CPU time of the steps alone, without model, compilation and recording. Cost of
the whole process: CPU time of a Python that starts, imports, builds, takes the steps and writes the
positions, in plain numpy or by kernels compiled before, as simulate decides; measured for the
peers' runs and, in a process each, for the points of our front. Of what reaches an error cheapest
the smallest of some repeats.

Run ``python examples/benchmarks/speed_accuracy_chart.py --help`` for the choices.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import product
from math import inf, nan
from pathlib import Path
from typing import Any, NamedTuple
from warnings import catch_warnings, simplefilter

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parent / "peers"))

import measuring  # before numpy: one thread
import numpy as np
import own
import peer_calls
import scenes
from measuring import EXPLICIT, INTEGRATORS, METHODS, family_of

from skfem_cosserat import AccuracyWarning, CosseratError, IncompatibleError
from skfem_cosserat.accuracy import PrecisionTable, TimeLimit
from skfem_cosserat.accuracy.precision import ended, pareto
from skfem_cosserat.figures import write_figure

OURS, OWN = "skfem-cosserat", "own"
#: single steps are timed as those of a run of so many, which has compiled kernels; a whole process
#: has those that simulate takes for its own number of steps
LONG = 10**7
#: relative errors of the statements
TARGETS = (1e-2, 1e-4, 1e-6)
#: relative change of the error below which it is no matter of the step, or of the mesh
SETTLED = 0.1
#: relative error of what is off altogether
OFF = 0.1
#: why a run that got to its end has failed
FAR = "off by more than the point moves"
#: CPU time of the steps that a run may take (s): ours, a peer's
PATIENCE = {True: (0.3, 0.3), False: (6.0, 3.0)}
#: how many times as long as a run of the classic integrators for the smallest error others may take
DEARER = 3.0
#: short runs are repeated for so long (s), at most so many times
REPEATED = 0.015, 4
#: options of the peers that are tried; of others those that they have by themselves
OPTIONS: dict[str, list[dict[str, Any]]] = {
    "exudyn_beam": [{"tolerance": 1e-5}],  # cheaper than its default, 1e-8, and as accurate here
    "exudyn_cable": [{"tolerance": 1e-5}],
}
#: how many times less CPU time than Exudyn's exact beam the steps of the rod have to take
RATIO = 10.0
COLUMNS = (
    *("scene", "group", "label", "cost_s", "process_s", "error_position", "newton_iterations"),
    *("factorisations", "unknowns", "status", "reason"),
)
STATED = (
    *("scene", "error", "cheapest", "cpu_s", "reached", "second", "second_ratio"),
    *("peer", "peer_cpu_s", "peer_ratio", "process_s", "peer_process_s", "process_ratio", "ahead"),
)


class Grid(NamedTuple):
    """What is run: elements by order, halvings of the sample interval, the reference."""

    meshes: Mapping[int, Sequence[int]]
    halvings: Sequence[int]
    peer_meshes: Sequence[int]
    #: elements of orders 4 and 3, and the halvings of their steps
    reference: tuple[int, int, int]


MESHES = {
    1: (8, 16, 32, 64, 128, 256),
    2: (4, 8, 16, 32, 64),
    3: (2, 4, 8, 16, 32),
    4: (2, 4, 8, 16),
}
BLADE = {order: [n for n in (8, 16, 32, 64, 128) if n * order <= 128] for order in (1, 2, 3, 4)}
PEERS = (8, 16, 32, 64, 128, 256)
QUICK = Grid({1: (8,), 3: (8,)}, (0, 1), (8,), (8, 16, 2))  # the blade has eight sections
#: the waves of the swing take finer meshes
FINER = MESHES | {3: (4, 8, 16, 32, 64), 4: (4, 8, 16, 32)}
GRIDS = {
    "rod": Grid(MESHES, range(15), PEERS, (40, 70, 8)),
    "spaghetti": Grid(MESHES, range(12), PEERS, (24, 36, 7)),
    "swing": Grid(FINER, range(13), PEERS, (64, 128, 10)),
    "four-bar": Grid(MESHES, range(12), PEERS, (12, 20, 8)),
    "blade": Grid(BLADE, range(12), PEERS, (48, 72, 9)),
}


class Setup(NamedTuple):
    """A point of the grid; `kind`: our integrator, or a peer."""

    peer: str
    kind: str
    elements: int
    halvings: int
    options: tuple[tuple[str, Any], ...]

    @property
    def order(self) -> int:
        """Of the elements."""
        return dict(self.options).get("order", 1)

    @property
    def work(self) -> float:
        """What its cost is about proportional to: nodes times steps."""
        return float(self.order * self.elements * 2**self.halvings)

    def scene(self, name: str, until: float | None = None) -> dict[str, Any]:
        """The question for an adapter; `until`: another end (s)."""
        base = scenes.SCENES[name](self.elements)
        base |= {} if until is None else {"until": until}
        more = {"step": base["sample"] / 2**self.halvings, "options": dict(self.options)}
        return {**base, **more, "warm": 2}

    def label(self, name: str) -> str:
        """In words."""
        o = dict(self.options)
        own_words = (o.get("treatment"), f"order {self.order}") if self.peer == OWN else ()
        other = [f"{k} = {v:g}" for k, v in o.items() if isinstance(v, float)]
        step = f"step = {self.scene(name)['step']:.4g} s"
        words = [self.kind, *own_words, f"{self.elements} elements", *other, step]
        return ", ".join(str(word) for word in words)


Ask = Callable[[dict[str, Any]], dict[str, Any]]
Row = dict[str, Any]


class Runner(NamedTuple):
    """Runs of a scene; a row for each."""

    name: str
    asks: Mapping[str, Ask]
    names: Mapping[str, str]
    reference: np.ndarray
    until: float | None

    def row(self, setup: Setup) -> Row:
        """Cost and error of one run, or how it failed."""
        scene, group = setup.scene(self.name, self.until), self.names[setup.peer]
        start = np.array(scene["beams"][0]["nodes"][scene["watch"][2]])
        reach = np.linalg.norm(self.reference - start, axis=1).max()
        answer = self.asks[setup.peer](scene)
        done, found = answer["status"] == "completed", answer.get("positions")
        error = np.linalg.norm(np.subtract(found, self.reference), axis=1).max() if done else inf
        # a run that is as far off as the point moves tells nothing
        status = "ok" if error < reach else "diverged" if done else _status(answer["status"])
        good = status == "ok"
        return {
            "label": setup.label(self.name),
            "cost_s": answer["seconds"] if good else None,
            "process_s": answer.get("process_s") if good else None,
            **{f"newton_{k}" if k == "iterations" else k: answer.get(k) for k in COUNTS},
            "error_position": float(error / reach) if good else None,
            "status": status,
            "reason": "" if good else FAR if done else answer["status"],
            "group": group,
            "series": setup.label(self.name).rpartition(", ")[0],
            "kind": setup.kind,
            "spent_s": answer.get("seconds", nan),
            "kernels": answer.get("kernels", ""),
            "setup": setup,
        }

    def explored(self, setups: Iterable[Setup], patience: float) -> list[Row]:
        """A row for each setup, cheap ones first; those that cannot be of use are not run."""
        rows: list[Row] = []
        rates: dict[int, float] = {}
        errors: dict[Any, list[float]] = {}  # of a mesh with smaller steps, of a step by meshes
        last: dict[Setup, float] = {}
        wrong: set[Setup] = set()  # peers fail on finer meshes, too, at the same step
        for setup in sorted(setups, key=lambda each: each.work):
            # at least half as much by node and step as the cheapest, and 0.8 as on the same mesh
            half = 0.5 * last.get(setup._replace(halvings=-1), 0.0) * 2**setup.halvings
            expected = max(0.5 * rates.get(setup.order, 0.0) * setup.work, 1.6 * half)
            reached = [cheapest(rows, target) for target in TARGETS]
            enough = max((r["cost_s"] for r in reached if r), default=0.0) if all(reached) else inf
            keys = setup._replace(elements=0), setup._replace(halvings=-1)
            idle = any(settled(errors.get(key, [])) for key in keys)
            if expected > min(enough, patience) or idle or keys[0] in wrong:
                continue
            row = self.row(setup)
            rows.append(row)
            if row["status"] == "ok":
                rate = row["cost_s"] / setup.work
                rates[setup.order] = min(rates.get(setup.order, rate), rate)
                last[keys[1]] = row["cost_s"] / 2**setup.halvings
                for key in keys:
                    errors.setdefault(key, []).append(row["error_position"])
            elif row["reason"].startswith("refused") or row["status"] == "timeout":
                break  # those that follow take longer
            elif setup.peer != OWN:
                wrong.add(keys[0])
        return rows

    def again(self, row: Row, key: str) -> None:
        """Run it once more and keep the smaller cost; `key`: of the steps, or of the process."""
        setup = row["setup"]
        whole = key == "process_s" and setup.peer == OWN
        scene = setup.scene(self.name, self.until)
        if whole:
            del scene["options"]["planned"]
        answer = self.asks["process" if whole else setup.peer](scene)
        for name, given in (("cost_s", "seconds"), ("process_s", "process_s")):
            if answer["status"] == "completed" and given in answer and (name == key or not whole):
                row[name] = min(row[name] or inf, answer[given])


COUNTS = ("iterations", "factorisations", "unknowns")


def _status(words: str) -> str:
    """What the words of an adapter mean in the table."""
    known = {"no": "timeout", "stopped": "newton", "unstable": "diverged"}
    first = words.partition(" ")[0]
    return first if first in ("newton", "diverged", "timeout") else known.get(first, "error")


def settled(errors: Sequence[float]) -> bool:
    """Whether the last two of three refinements have changed nothing worth mentioning.

    Errors of the size of the motion say nothing: runs that are off, or not stable yet.
    """
    return len(errors) > 2 and bool(np.ptp(errors[-3:]) < SETTLED * errors[-1] < SETTLED * OFF)


def cheapest(rows: Iterable[Row], error: float, key: str = "cost_s") -> Row | None:
    """What reaches an error at the smallest cost."""
    done = [r for r in rows if r["status"] == "ok" and r["error_position"] <= error and r[key]]
    return min(done, key=lambda row: row[key], default=None)


def ask_own(scene: dict[str, Any], patience: float) -> dict[str, Any]:
    """A run in this process; short ones are repeated for the smallest time."""
    total, most = REPEATED
    best: dict[str, Any] = {}
    try:
        with TimeLimit(3 * patience + 10), catch_warnings():
            simplefilter("ignore", AccuracyWarning)  # errors are measured here
            for _ in range(most):
                found = own.run(scene)
                total -= found["seconds"]
                best = found if not best or found["seconds"] < best["seconds"] else best
                if total < 0:
                    break
    except IncompatibleError as error:
        return {"status": f"refused: {error}"}
    except (ArithmeticError, CosseratError, TimeoutError) as error:
        status, reason = ended(error)
        return {"status": f"{status} {' '.join(reason.split())[:160]}"}
    return best


def reference(name: str, grid: Grid, until: float | None, kernels: str) -> tuple[np.ndarray, float]:
    """Path of the point, and the distance of another run from it (m)."""
    fine, other, halvings = grid.reference
    paths = []
    for integrator, order, n in (("energy-momentum", 4, fine), ("variational", 3, other)):
        steps = grid._replace(halvings=(halvings, halvings + 1))
        pair = [
            np.array(own.run(setup.scene(name, until))["positions"])
            for setup in ours(steps, integrator, "null-space", [(order, n)], kernels)
        ]
        paths.append(pair[1] + (pair[1] - pair[0]) / 3)
    return paths[0], float(np.linalg.norm(paths[0] - paths[1], axis=1).max())


def ours(
    grid: Grid, integrator: str, treatment: str, meshes: Iterable[tuple[int, int]], kernels: str
) -> list[Setup]:
    """Setups of an integrator on meshes (order and elements)."""
    o = {"integrator": integrator, "treatment": treatment, "kernels": kernels, "planned": LONG}
    return [
        Setup(OWN, integrator, n, k, tuple((o | {"order": order}).items()))
        for (order, n), k in product(meshes, grid.halvings)
    ]


def compared(
    name: str,
    grid: Grid,
    integrators: Iterable[str],
    peers: Mapping[str, peer_calls.Peer],
    environments: str | Path | None,
    quick: bool,
    repeats: int,
    until: float | None,
    kernels: str,
) -> tuple[PrecisionTable, dict[str, str]]:
    """All rows of a scene, and the peers that could not be run, and why."""
    path, error = reference(name, grid, until, kernels)
    patience = PATIENCE[quick]
    asks: dict[str, Ask] = {OWN: lambda scene: ask_own(scene, patience[0])}
    myself = peer_calls.peers()[OWN]
    asks["process"] = lambda scene: peer_calls.ask(Path(sys.executable), myself, scene)
    missing = {}
    for key, peer in peers.items():
        try:
            python = peer_calls.prepare(peer, environments)
        except peer_calls.Unavailable as reason:
            missing[peer.name] = str(reason)
            continue
        asks[key] = partial(peer_calls.ask, python, peer, timeout=3 * patience[1] + 30)
    names = {OWN: OURS, **{key: peer.name for key, peer in peers.items()}}
    run = Runner(name, asks, names, path, until)
    chosen, every = list(integrators), list(product_of(grid.meshes))
    rows: list[Row] = []
    for each in (i for i in chosen if i in INTEGRATORS):
        rows += run.explored(ours(grid, each, "null-space", every, kernels), patience[0])
    best = [cheapest(rows, each) for each in (*TARGETS, 1e-1, 1e-3, 1e-5)]
    for key in (key for key in peers if key in asks):
        setups = [
            Setup(key, peers[key].name, n, k, tuple(o.items()))
            for n, k, o in product(grid.peer_meshes, grid.halvings, OPTIONS.get(key, [{}]))
        ]
        rows += run.explored(setups, patience[1])
    few = list(dict.fromkeys((r["setup"].order, r["setup"].elements) for r in best if r)) or every
    # what takes several times as long as the classic ones for all errors is of no use
    costs = [DEARER * r["cost_s"] for r in best[:3] if r]
    longest = min([patience[0], *([max(costs)] if len(costs) == 3 else [])])
    for each, treatment in product(chosen, measuring.TREATMENTS):
        if (treatment == "multipliers") == (each in INTEGRATORS or each in EXPLICIT):
            rows += run.explored(ours(grid, each, treatment, few, kernels), longest)
    _timed_again(run, rows, repeats)
    reach = np.linalg.norm(path - _start(name), axis=1).max()
    rows += [_absent(peer, why) for peer, why in missing.items()]
    notes = {"reference": f"order 4, {grid.reference[0]} elements, extrapolated"}
    return PrecisionTable(rows, {"position": error / float(reach)}, notes), missing


def product_of(meshes: Mapping[int, Sequence[int]]) -> list[tuple[int, int]]:
    """Orders and elements."""
    return [(order, n) for order, counts in meshes.items() for n in counts]


def _start(name: str) -> np.ndarray:
    scene = scenes.SCENES[name](8)
    return np.array(scene["beams"][0]["nodes"][scene["watch"][2]])


def _timed_again(run: Runner, rows: Sequence[Row], repeats: int) -> None:
    """Smallest costs of what is cheapest for an error, and of whole processes on our front."""
    kinds = dict.fromkeys(row["kind"] for row in rows)
    best = [cheapest((r for r in rows if r["kind"] == k), e) for k, e in product(kinds, TARGETS)]
    chosen = {id(row): row for row in best if row is not None}
    for row in chosen.values():
        for _ in range(repeats - 1):
            run.again(row, "cost_s")
    mine = [row for row in rows if row["group"] == OURS and row["status"] == "ok"]
    front: list[Row] = []
    for row in pareto(mine, "position"):  # neighbours are the same on a chart
        if not front or row["error_position"] < 0.4 * front[-1]["error_position"]:
            front.append(row)
    front += [row for e in TARGETS if (row := cheapest(mine, e)) and row not in front]
    for row, _ in product(front, range(min(repeats, 2))):
        run.again(row, "process_s")


def _absent(peer: str, why: str) -> Row:
    """The row of a peer that could not be run."""
    unknown = "cost_s", "process_s", "newton_iterations", "factorisations", "unknowns"
    row = {"label": peer, **dict.fromkeys((*unknown, "error_position")), "status": "error"}
    more = {"reason": why, "group": peer, "series": peer, "kind": peer, "spent_s": nan}
    return {**row, **more, "kernels": "", "setup": None}


# -- statements ------------------------------------------------------------------------------------


def statements(name: str, rows: Sequence[Row]) -> list[Row]:
    """What is cheapest for each error, and by how much: by its steps, and as a whole process."""
    mine, others = ([r for r in rows if (r["group"] == OURS) == own_] for own_ in (True, False))
    found = []
    for target in TARGETS:
        best, peer = cheapest(mine, target), cheapest(others, target)
        rest = [row for row in mine if best and row["kind"] != best["kind"]]
        second, whole = cheapest(rest, target), cheapest(mine, target, "process_s")
        there = cheapest(others, target, "process_s")
        ratio = _over(peer, best, "cost_s")
        process = _over(there, whole, "process_s")
        ahead = [
            f"{row['group']} ({what})"
            for row, number, what in ((peer, ratio, "steps"), (there, process, "process"))
            if row and (number is None or number < 1)
        ]
        found.append(
            {
                **{"scene": name, "error": target, "cheapest": best and best["label"]},
                **{"cpu_s": best and best["cost_s"], "reached": best and best["error_position"]},
                **{"second": second and second["label"]},
                **{"second_ratio": _over(second, best, "cost_s"), "peer": peer and peer["label"]},
                **{"peer_cpu_s": peer and peer["cost_s"], "peer_ratio": ratio},
                **{"process_s": whole and whole["process_s"]},
                **{"peer_process_s": there and there["process_s"], "process_ratio": process},
                "ahead": "; ".join(ahead),
            }
        )
    return found


def _over(row: Row | None, best: Row | None, key: str) -> float | None:
    return row[key] / best[key] if row and best else None


def sentence(s: Mapping[str, Any]) -> str:
    """A statement in words."""
    text = f"{s['scene']}, {s['error']:.0e}: "
    if s["cheapest"] is None:
        return text + (f"only {s['peer']} reaches it" if s["peer"] else "not reached")
    text += f"{s['cheapest']} in {1e3 * s['cpu_s']:.3g} ms"
    if s["second_ratio"]:
        text += f"; next {s['second']}, {s['second_ratio']:.2f} times"
    text += f"; {s['peer']}, {s['peer_ratio']:.3g} times" if s["peer"] else "; no peer reaches it"
    if s["process_ratio"]:
        text += f"; process {s['process_s']:.3g} s, a peer's {s['process_ratio']:.3g} times"
    return text + (f"; AHEAD: {s['ahead']}" if s["ahead"] else "")


def main(
    quick: bool = True,
    repeats: int = 3,
    environments: str | Path | None = None,
    out: str | Path | None = None,
    scenes_: Sequence[str] = tuple(GRIDS),
    peers: Mapping[str, peer_calls.Peer] | None = None,
    integrators: Iterable[str] = tuple(METHODS),
    kernels: str | None = None,
    grids: Mapping[str, Grid] | None = None,
) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    quick : bool
        Small grids, runs of a fifth of the time, plain kernels.
    repeats : int
        Timed runs of what is cheapest for an error.
    environments : path, optional
        Folder of the peers' environments; default: in the user's cache.
    out : path, optional
        Folder for speed_accuracy_SCENE.csv, speed_accuracy.csv (the statements) and, where
        matplotlib is there, speed_accuracy_SCENE.png and speed_accuracy_SCENE.process.png.
    scenes_ : sequence of str
        Only these.
    peers : mapping, optional
        By name; default: all adapters of the folder peers.
    integrators : iterable of str
        Of this package; default: all that measuring.py lists, METHODS.
    kernels : str, optional
        Default: "numpy" if quick, else "auto".
    grids : mapping, optional
        By scene; others than GRIDS.

    Returns
    -------
    dict
        ``tables`` by scene, ``rows`` of all, ``statements``, ``missing``, ``dgemm_gflops`` and
        where it was measured.
    """
    if peers is None:
        peers = {name: peer for name, peer in peer_calls.peers().items() if name != OWN}
    kind = ("numpy" if quick else "auto") if kernels is None else kernels
    result: dict[str, Any] = {"tables": {}, "rows": [], "statements": [], "missing": {}}
    result |= measuring.environment()
    for name in scenes_:
        grid = (grids or ({} if not quick else dict.fromkeys(GRIDS, QUICK))).get(name, GRIDS[name])
        scene = scenes.SCENES[name](8)
        until = 0.2 * scene["until"] if quick else None
        run = integrators, peers, environments, quick, repeats, until, kind
        table, missing = compared(name, grid, *run)
        result["tables"][name] = table
        result["rows"] += [{"scene": name, **row} for row in table.rows]
        result["statements"] += statements(name, table.rows)
        result["missing"] |= missing
        for row in (*table.rows, *result["rows"]):
            row.pop("setup", None)
        if out is not None:
            write(result, Path(out), name)
    return result


def write(result: dict[str, Any], folder: Path, name: str) -> None:
    """Table and charts of a scene, and the statements so far."""
    folder.mkdir(parents=True, exist_ok=True)
    table = result["tables"][name]
    table.csv(folder / f"speed_accuracy_{name}.csv")
    measuring.write(folder / "speed_accuracy.csv", {**result, "rows": result["statements"]}, STATED)
    with suppress(ImportError):  # charts come with the extra "view"
        charts(table, folder / f"speed_accuracy_{name}.png")


def charts(table: PrecisionTable, path: Path) -> None:
    """Errors over the cost of the steps, and beside it over that of the whole process."""
    whole = [{**row, "cost_s": row["process_s"]} for row in table.rows if row["process_s"]]
    process = PrecisionTable(whole, table.reference_errors, table.notes)
    drawn = {"cost": "CPU seconds", "units": ""}
    kinds = {"kind": kind_of, "family": lambda row: family_of(kind_of(row))}
    for figure, file, what in (
        (table.chart(**kinds, **drawn), path, "steps"),
        (process.chart(**drawn), path.with_suffix(".process.png"), "whole process"),
    ):
        figure.axes[0].set_xlabel(f"CPU time of the {what} in s")
        write_figure(figure, file)


def kind_of(row: Mapping[str, Any]) -> str:
    """What has a line of its own: a peer, and each of our integrators."""
    return str(row["kind"])


def missed(result: dict[str, Any]) -> list[str]:
    """Errors that a peer reaches cheaper, and what could not be measured or judged."""
    out = [f"{peer}: not measured: {why}" for peer, why in result["missing"].items()]
    for name, table in result["tables"].items():
        off = table.reference_errors["position"]
        out += [f"{name}: the reference is off by {off:.1e}"] if off > 0.2 * min(TARGETS) else []
    for each in result["statements"]:
        what = f"{each['scene']}, {each['error']:.0e}"
        if each["ahead"]:
            out.append(f"{what}: ahead: {each['ahead']}")
        elif each["scene"] == "rod" and (each["peer_ratio"] or inf) < RATIO:
            out.append(f"{what}: {each['peer_ratio']:.2f} times less CPU, required {RATIO:g}")
    return out


def report(result: dict[str, Any]) -> str:
    """The rows and the statements, as text."""
    lines = [measuring.table(result["rows"], COLUMNS), ""]
    for name, table in result["tables"].items():
        lines.append(
            f"{name}: relative error of the reference {table.reference_errors['position']:.1e}"
        )
    return "\n".join([*lines, *map(sentence, result["statements"])])


if __name__ == "__main__":
    sys.exit(measuring.command(__doc__, main, report, missed, options=("environments",)))
