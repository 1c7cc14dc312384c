"""Speed against accuracy: the three-bar swing and the flying spaghetti, all methods and peers.

*swing*: the published three-bar swing, its mass over the first half second (in full; the pulse ends
at 0.25 s). *spaghetti*: D3, a free rod of 10 m in space that is thrown and spun by a force and a
moment on its end, which grow and fall within 5 s; its other end over 5 s. In quick form 0.25 s and
1 s.

Error: largest distance of that point from the reference at instants that all runs reach, in m. The
reference: elements of order 4, extrapolated from two steps (energy-momentum); its own error is its
distance from an extrapolated run of another order on another mesh with the variational integrator.
Ours: all integrators, orders, meshes and steps, null space; on the coarsest mesh of orders 1 and 3
with multipliers, too; compiled kernels where there are some. The two classic integrators have the
full grid, the others (see measuring.py) fewer meshes: errors of the mesh are the same. Explicit
schemes have nodal masses, multipliers and steps of their own; those above their limit fail.
Peers: Exudyn's exact beam (linear, generalized-alpha, on the swing with two spectral radii,
modified Newton, one thread, build without range checks), which gets all numbers of a scene from
ours; on the spaghetti PyElastica, too, at its largest stable step. On the swing PyElastica is a row
that failed: its joints are springs and dampers of a stiffness that one has to choose, so its
hinges give way and what it solves is another scene.

Cost: CPU time of the steps alone, without model, compilation and recording, the smallest of some.
Setups that fail stay in the table, and so do peers that are not there. Where our front does not lie
below a peer's, the report says so.

Run ``python examples/benchmarks/speed_accuracy_chart.py --help`` for the choices.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple, cast

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import dynamic_references as dynamic
import measuring  # before numpy: one thread
import numpy as np
import peer_calls
from measuring import EXPLICIT, INTEGRATORS, METHODS, family_of

import skfem_cosserat as sc
from paper import three_bar_swing as swing
from skfem_cosserat.integrators import Stepper
from skfem_cosserat.study import AtInstants, PrecisionTable, ReferencePair, setup_grid

OURS = "skfem-cosserat"
EXUDYN, ELASTICA = "Exudyn, exact beam", "PyElastica"
TREATMENTS = {"null space": sc.NullSpace, "multipliers": sc.Multipliers}
TOLERANCES = (1e-8, 1e-5)
#: longest time of a run (s)
PATIENCE = {True: 60.0, False: 120.0}
WARM = 2
#: numbers of D3, for the adapters: the peers' radius has no part in it
SPAGHETTI = {
    "length": 10.0,
    "radius": 0.1,
    "polar": np.pi * 0.1**4 / 2,
    "stiffness": [1e4, 1e4, 1e4, 500.0, 500.0, 500.0],
    "mass": 1.0,
    "inertia": [5.0, 5.0],
    "rotary": [10.0, 10.0, 10.0],
    "start": [6.0, 0.0, 0.0],
    "end": [0.0, 8.0, 0.0],
    "force": [0.1, 0.0, 0.0],
    "moment": [0.0, 0.5, 1.0],
    "pulse": [[0.0, 2.5, 5.0], [0.0, 200.0, 0.0]],
}
#: why a peer has no part in a scene
ELSEWHERE = {
    ("swing", ELASTICA): "its joints are springs and dampers (FreeJoint, HingeJoint), not"
    " constraints: it would solve another scene"
}
#: axes of a scene, as the adapters number them: theirs move in the plane of the first two
AXES = {"swing": [1, 2, 0], "spaghetti": [0, 1, 2]}
COLUMNS = (
    *("scene", "group", "label", "cost_s", "error_point", "newton_iterations", "factorisations"),
    *("unknowns", "status", "reason"),
)


class Problem(NamedTuple):
    """A scene, as its setups get it."""

    name: str
    until: float
    sample: float

    @property
    def instants(self) -> np.ndarray:
        """At which errors are looked at (s)."""
        return self.sample * np.arange(1, round(self.until / self.sample) + 1)


class Grid(NamedTuple):
    """What is run: ours by order, with its meshes; the peers' meshes, steps and spectral radii.

    `others`: meshes of integrators other than the two classic ones; explicit ones have steps of
    their own.
    """

    steps: Sequence[float]
    meshes: Mapping[int, Sequence[int]]
    others: Mapping[int, Sequence[int]]
    explicit_steps: Sequence[float]
    peer_steps: Sequence[float]
    peer_meshes: Sequence[int]
    reference: tuple[tuple[int, int, float], tuple[int, int, float]]
    peer_radii: Sequence[float] = (0.9,)


PROBLEMS = {
    ("swing", True): Problem("swing", 0.25, 0.025),
    ("swing", False): Problem("swing", 0.5, 0.025),
    ("spaghetti", True): Problem("spaghetti", 1.0, 0.1),
    ("spaghetti", False): Problem("spaghetti", 5.0, 0.1),
}
GRIDS = {
    ("swing", True): Grid(
        *((2.5e-2, 6.25e-3), {1: (4,), 3: (2,)}, {3: (2,)}, (1.5625e-3,)),
        *((6.25e-3,), (4,), ((4, 2, 3.125e-3), (3, 4, 3.125e-3))),
    ),
    ("swing", False): Grid(
        [2.5e-2 / 2**k for k in range(7)],
        {1: (8, 16, 32), 2: (4, 8, 16), 3: (2, 4, 8, 16), 4: (2, 4, 8)},
        *({1: (16,), 2: (8,), 3: (8,), 4: (4, 8)}, [1.5625e-3 / 2**k for k in range(5)]),
        [2.5e-2 / 2**k for k in range(7)],
        (8, 16, 32, 64, 128),
        ((4, 12, 9.765625e-5), (3, 20, 9.765625e-5)),
        (0.9, 0.6),
    ),
    ("spaghetti", True): Grid(
        *((0.1, 0.05), {1: (8,), 3: (2,)}, {3: (2,)}, (0.00625,)),
        *((0.05,), (8,), ((4, 4, 0.025), (3, 6, 0.025))),
    ),
    ("spaghetti", False): Grid(
        [0.1 / 2**k for k in range(5)],
        {1: (8, 16, 32), 2: (4, 8, 16), 3: (2, 4, 8), 4: (2, 4)},
        {1: (16,), 2: (8,), 3: (4, 8), 4: (2, 4)},
        [0.0125 / 2**k for k in range(5)],
        [0.05 / 2**k for k in range(6)],
        (8, 16, 32, 64),
        ((4, 8, 3.125e-3), (3, 12, 3.125e-3)),
    ),
}


@cache
def scene(name: str, elements: int, order: int, lumped: bool = False) -> tuple[sc.System, sc.Place]:
    """The system, and the point that is looked at; `lumped`: nodal masses."""
    if name == "swing":
        system = swing.build(elements=elements, order=order, lumped=lumped)
        beam: Any = system.structures[0]
        return system, beam.node("mid")
    found = dynamic.spaghetti(elements, order, lumped=lumped)
    return found.system, found.places["free"]


def stepped(
    problem: Problem,
    integrator: Callable[[], Any],
    treatment: Callable[[], Any],
    mesh: tuple[int, int],
    step: float,
    kernels: str = "auto",
    lumped: bool = False,
) -> dict[str, Any]:
    """One run of this package: path of the point, and what its steps cost.

    `mesh`: order and elements.
    """
    order, elements = mesh
    system, place = scene(problem.name, elements, order, lumped)
    own = system, integrator(), treatment(), step
    many = {"kernels": kernels, "steps": 10**7}  # compiled where there are compiled ones
    warm, stepper = Stepper(*own, **many), Stepper(*own, **many)
    state, path = sc.initial_state(system), []
    measuring.advance(warm, state, WARM)
    seconds, iterations, factorisations = 0.0, 0, 0
    for _ in problem.instants:
        run = measuring.advance(stepper, state, round(problem.sample / step))
        state, seconds = run.state, seconds + run.seconds
        iterations += run.iterations
        factorisations += run.factorisations
        path.append(sc.View(system, state).position(place))
    return {
        "t": problem.instants,
        "point": np.array(path),
        "cost_s": seconds,
        "newton_iterations": iterations,
        "factorisations": factorisations,
        "unknowns": stepper.bound.unknowns,
        "kernels": stepper.choice.name,
    }


def extrapolated(
    problem: Problem, integrator: Callable[[], Any], setting: tuple[int, int, float], kernels: str
) -> dict[str, Any]:
    """Path of the point, the error in the step removed to leading order."""
    order, elements, step = setting
    coarse, fine = (
        stepped(problem, integrator, sc.NullSpace, (order, elements), step / k, kernels)
        for k in (1, 2)
    )
    return fine | {"point": fine["point"] + (fine["point"] - coarse["point"]) / 3}


# -- peers -----------------------------------------------------------------------------------------


@cache
def numbers(name: str) -> dict[str, Any]:
    """The scene for the adapters, their axes; those of the swing are read off our own system."""
    if name == "spaghetti":
        return SPAGHETTI
    system, _ = scene(name, 2, 1)
    beam, *links, lump = cast("list[Any]", system.structures)
    (section,), turned = beam.sections.values(), AXES[name]
    ends = [beam.node(side).position for side in ("left", "right")]
    _, end, peak = swing.PULSE["published"]
    along = section.inertia  # d1 and d2
    return {
        "length": swing.SPAN,
        "stiffness": section.stiffness.diagonal().tolist(),
        "mass": float(section.mass),
        "rotary": [float(along.sum()), float(along[1]), float(along[0])],
        "start": ends[0][turned].tolist(),
        "end": ends[1][turned].tolist(),
        "point": lump.mass,
        "links": [_link(link, low, turned) for link, low in zip(links, ends, strict=True)],
        "force": [1.0, 0.0, 0.0],
        "moment": [0.0, 0.0, 0.0],
        "pulse": [[0.0, end / 2, end], [0.0, peak, 0.0]],
    }


def _link(link: Any, low: np.ndarray, turned: list[int]) -> dict[str, Any]:
    """Numbers of a pyramid, whose d1 is out of the plane and whose d3 points to its apex."""
    high = link.position + 3 * (link.position - low)
    euler = link.euler.diagonal()
    inertia = euler.sum() - euler
    return {
        "mass": link.mass,
        "inertia": inertia[::-1].tolist(),
        "position": link.position[turned].tolist(),
        "low": low[turned].tolist(),
        "high": high[turned].tolist(),
    }


def exudyn(
    problem: Problem, python: Path, tolerance: float, radius: float, elements: int, step: float
) -> Any:
    """One run of Exudyn's exact beam; `radius`: spectral, of generalized-alpha."""
    steps = round(problem.until / step)
    options = ("--scene", json.dumps(numbers(problem.name)), "--elements", str(elements))
    options += ("--step", repr(step), "--spectral-radius", repr(radius))
    options += ("--warm", str(WARM), "--steps", str(steps - WARM), "--sample", repr(problem.sample))
    options += ("--node", "EP", "--reuse-pattern", "--tolerance", repr(tolerance))
    answer = peer_calls.ask(python, peer_calls.EXUDYN, *options, timeout=PATIENCE[False])
    if answer["status"] != "completed":
        return _failed(answer["status"])
    return _path(problem, answer["path"]) | {
        "cost_s": 1e-3 * answer["ms_per_step"] * steps,
        "newton_iterations": round(answer["iterations_per_step"] * steps),
        "factorisations": round(answer["factorisations_per_step"] * steps),
    }


def elastica(problem: Problem, python: Path, elements: int) -> Any:
    """One run of PyElastica at its largest stable step."""
    options = ("--scene", json.dumps(numbers(problem.name)), "--elements", str(elements))
    options += ("--until", repr(problem.until), "--sample", repr(problem.sample))
    answer = peer_calls.ask(python, peer_calls.ELASTICA, *options, timeout=PATIENCE[False])
    if answer["status"] != "completed":
        return _failed(answer["status"])
    cost = 1e-3 * answer["ms_per_step"] * problem.until / answer["step"]
    return _path(problem, answer["path"]) | {"cost_s": cost, "newton_iterations": 0}


def _failed(why: str) -> dict[str, Any]:
    """What a peer's words mean in the table."""
    if why.startswith("no answer within"):
        return {"status": "timeout", "reason": why}
    # Exudyn, whose Newton method gave up, stops; PyElastica becomes unstable
    state = {"stopped": "newton", "unstable": "diverged"}.get(why.partition(" ")[0], "error")
    return {"status": state, "reason": why}


def _path(problem: Problem, rows: Sequence[Sequence[float]]) -> dict[str, Any]:
    """Positions at the instants, from rows of time and position."""
    table = np.array(rows)
    near = abs(table[:, :1] - problem.instants).argmin(axis=0)
    if abs(table[near, 0] - problem.instants).max() > 1e-6:
        return _failed("its path has no values at the instants")
    path = np.empty((len(near), 3))
    path[:, AXES[problem.name]] = table[near, 1:4]
    return {"t": problem.instants, "point": path}


def peers(
    name: str, grid: Grid, environments: str | Path | None
) -> tuple[list[Any], dict[str, str]]:
    """Setups of the peers that have a part in a scene, and why some cannot be run."""
    found, missing = [], {}
    for group, code in ((EXUDYN, peer_calls.EXUDYN), (ELASTICA, peer_calls.ELASTICA)):
        if (name, group) in ELSEWHERE:
            continue
        try:
            python = peer_calls.prepare(code, environments)
        except peer_calls.Unavailable as error:
            missing[group] = str(error)
            continue
        named: dict[str, Any] = {"python": {group: python}, "group": group}
        if group == EXUDYN:
            named |= {"tolerance": TOLERANCES, "radius": grid.peer_radii}
            found += setup_grid(exudyn, **named, elements=grid.peer_meshes, step=grid.peer_steps)
        else:
            found += setup_grid(elastica, **named, elements=grid.peer_meshes)
    return found, missing


def absent(reasons: Mapping[str, str]) -> list[dict[str, Any]]:
    """Rows of peers that were not run; not kept for a later one, which may have them."""
    unknown = "cost_s", "newton_iterations", "factorisations", "unknowns", "error_point"
    return [
        {"label": peer, **dict.fromkeys(unknown), "status": "error", "reason": why}
        | {"group": peer, "series": peer, "spent_s": float("nan")}
        for peer, why in reasons.items()
    ]


# -- table and chart -------------------------------------------------------------------------------


def ours(grid: Grid, integrators: Mapping[str, Callable[[], Any]], kernels: str) -> list[Any]:
    """Setups of this package: integrator x treatment x order x mesh x step."""
    found = []
    for name, make in integrators.items():
        run = partial(stepped, kernels=kernels, lumped=name in EXPLICIT)
        steps = grid.explicit_steps if name in EXPLICIT else grid.steps
        for kind, treatment in TREATMENTS.items():
            meshes = _meshes(grid, name, kind)
            axes = {"integrator": {name: make}, "treatment": {kind: treatment}, "mesh": meshes}
            if meshes:
                found += setup_grid(run, group=OURS, **axes, step=steps)
    return found


def _meshes(grid: Grid, integrator: str, treatment: str) -> dict[str, tuple[int, int]]:
    """Order and elements, by their words in a label."""
    explicit, second = integrator in EXPLICIT, treatment == "multipliers"
    sizes = grid.meshes if integrator in INTEGRATORS else grid.others
    return {
        f"order {p}, {n} elements": (p, n)
        for p, counts in sizes.items()
        for n in counts
        if second == explicit or (second and p in (1, 3) and n == counts[0])
    }


def compared(
    problem: Problem,
    grid: Grid,
    setups: Sequence[Any],
    kernels: str,
    repeats: int,
    timeout_s: float,
    folder: Path | None,
) -> PrecisionTable:
    """The table of a scene."""
    fine, other = grid.reference
    pair = ReferencePair(
        partial(extrapolated, integrator=sc.EnergyMomentum, setting=fine, kernels=kernels),
        partial(extrapolated, integrator=sc.Variational, setting=other, kernels=kernels),
    )
    return sc.work_precision(
        problem,
        setups,
        pair,
        ["point"],
        repeats,
        norm=AtInstants(problem.instants),
        folder=folder,
        timeout_s=timeout_s,
    )


def main(
    quick: bool = True,
    repeats: int = 2,
    environments: str | Path | None = None,
    out: str | Path | None = None,
    scenes: Sequence[str] = ("swing", "spaghetti"),
    with_peers: bool = True,
    integrators: Mapping[str, Callable[[], Any]] | None = None,
    kernels: str | None = None,
    grids: Mapping[tuple[str, bool], Grid] | None = None,
    resume: str | Path | None = None,
) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    quick : bool
        Small grids, short runs, plain kernels.
    repeats : int
        Timed runs of each setup.
    environments : path, optional
        Folder of the peers' environments; default: in the user's cache.
    out : path, optional
        Folder for speed_accuracy_SCENE.csv and, where matplotlib is there, .png.
    scenes : sequence of str
        Only these.
    with_peers : bool
        False: this package alone.
    integrators : mapping, optional
        Of this package, by name; default: all that measuring.py lists, METHODS.
    kernels : str, optional
        Default: "numpy" if quick, else "auto".
    grids : mapping, optional
        Others than GRIDS.
    resume : path, optional
        Folder in which each run is kept, to go on after an interruption.

    Returns
    -------
    dict
        ``tables`` by scene, ``rows`` of all, ``standing`` (our front against the peers'),
        ``missing``, ``dgemm_gflops`` and where it was measured.
    """
    chosen = METHODS if integrators is None else integrators
    kind = ("numpy" if quick else "auto") if kernels is None else kernels
    result: dict[str, Any] = {"tables": {}, "rows": [], "standing": {}, "missing": {}}
    for name in scenes:
        key, without = (name, quick), {}
        grid = (GRIDS if grids is None else grids)[key]
        setups = ours(grid, chosen, kind)
        if with_peers and grid.peer_meshes:
            more, missing = peers(name, grid, environments)
            setups += more
            result["missing"] |= missing
            without = {peer: why for (where, peer), why in ELSEWHERE.items() if where == name}
            without |= missing
        folder = None if resume is None else Path(resume) / name
        run = compared(PROBLEMS[key], grid, setups, kind, repeats, PATIENCE[quick], folder)
        run.rows.extend(absent(without))
        result["tables"][name] = run
        result["rows"] += [{"scene": name, **row} for row in run.rows]
        result["standing"][name] = run.standing("point", OURS)
    result |= measuring.environment()
    if out is not None:
        write(result, Path(out))
    return result


def write(result: dict[str, Any], folder: Path) -> None:
    """Tables, and charts where matplotlib is there."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, run in result["tables"].items():
        run.csv(folder / f"speed_accuracy_{name}.csv")
        with suppress(ImportError):  # charts come with the extra "view"
            run.chart(folder / f"speed_accuracy_{name}.png", kind=kind_of, family=colour_of)


def kind_of(row: Mapping[str, Any]) -> str:
    """What has a line of its own: a peer, and each of our integrators."""
    return str(row["group"] if row["group"] != OURS else row["series"].split(", ")[0])


def colour_of(row: Mapping[str, Any]) -> str:
    """What has a colour of its own: a peer, and each family of our integrators."""
    return family_of(kind_of(row))


def missed(result: dict[str, Any]) -> list[str]:
    """Where our front does not lie below a peer's, and what could not be measured."""
    out = [f"{peer}: not measured: {why}" for peer, why in result["missing"].items()]
    for name, standing in result["standing"].items():
        behind = standing.behind
        out += [f"{name}: {line}" for line in standing.lines if behind and ": behind at" in line]
    return out


def report(result: dict[str, Any]) -> str:
    """The rows, fronts and our standing, as text."""
    lines = [measuring.table(result["rows"], COLUMNS), ""]
    for name, run in result["tables"].items():
        lines.append(f"{name}: error of the reference {run.reference_errors['point']:.1e} m")
        lines += [f"{name}: {line}" for line in run.front("point").lines]
        lines += [f"{name}: {line}" for line in result["standing"][name].lines]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(measuring.command(__doc__, main, report, missed, options=("environments", "resume")))
