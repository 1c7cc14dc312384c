"""Simpler beams on the stiff three-bar swing: every theory, both integrators, steps 1e-1 to 1e-5 s.

The swing with the strip of 1 mm (see paper/three_bar_swing.py and paper/failure_map.py), 20 linear
elements, null space, to 1.5 s and over a *full period*: until the mass passes the e2 coordinate of
its start again, moving as at the start. Its length is that of the reference: the full beam with
energy-momentum at 2e-5 s.

*Outcomes.* ``newton``: a step could not be solved in four attempts of up to 100 iterations each;
``blowup``: the energy at (q_n, p_n) exceeds ten times that just after the pulse; ``drift``: the
energy at midpoints has changed by more than 1 % since the pulse; ``timeout``; else ``ok``. Single
steps of the variational scheme say little, as one may pass where its neighbours fail. What counts
is the *contiguous range*: a step belongs to it if it and all smaller ones that were tried are ok.
(Energy-momentum keeps the energy at nodes to rounding with all steps. That at midpoints, from
differences of positions, then tells how well the motion is resolved.)

*Errors*, all largest distances of the mass (m) up to the end. ``error_m`` is against the full beam
with the same mesh, extrapolated from two small steps; ``model_error_m`` is that of the theory's own
extrapolated motion, ``time_error_m`` is against this. ``mesh_error_m``: motions on meshes with two,
four and eight times as many elements, extrapolated, against that on the mesh, all at one small
step. Each comes with an error of its own, from a coarser pair of steps or meshes.

*Costs.* Table: CPU time of the steps alone. What is compared with the full beam is measured apart,
in turns (theory_table.costs.csv): ratios of short stretches of steps, of which the median counts.

*Theory*, theory_table.theory.csv: see alternation.py.

Run ``python examples/benchmarks/theory_table.py --help`` for the choices.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise, product
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import alternation
import measuring  # before numpy: one thread
import numpy as np
import theory_report
from measuring import INTEGRATORS
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

import skfem_cosserat as sc
from paper import failure_map
from paper import three_bar_swing as swing
from skfem_cosserat.integrators.choice import choose_kernels
from skfem_cosserat.newton import NewtonSettings

Floats = NDArray[np.float64]

THEORIES = {
    "full": sc.TheoryReissner,
    "unshearable": sc.TheoryKirchhoff,
    "inextensible": sc.TheoryInextensible,
    "rigid": sc.TheoryRigid,
}
#: the theory that the figures are about: neither shear nor extension
THEORY = "inextensible"
#: midpoint energy (relative) beyond which a run has drifted
DRIFT = 0.01
STATUS = {
    "Newton failed": "newton",
    "energy blow-up": "blowup",
    "stopped, still running": "timeout",
}
#: steps that are worth compiling for: there are many cells
MANY = 10**7
WARM = 2
#: steps that are timed together
SHORTEST = 10
COLUMNS = (
    *("theory", "integrator", "until_s", "step_s", "status", "time_s", "energy_error_midpoint"),
    *("energy_error", "repeated", "iterations_per_step", "ms_per_step", "kernels", "error_m"),
    *("time_error_m", "model_error_m", "mesh_error_m"),
)


class Plan(NamedTuple):
    """What is run.

    Attributes
    ----------
    steps : tuple of float
        (s)
    ends : tuple of float
        (s); a full period is added if `period`.
    period : bool
    beyond : float
        Where the reference ends (s).
    fine : tuple of float
        Steps of the reference (s), each half of the one before; the last two are extrapolated.
    meshes : tuple of int
        Elements of which the first is the mesh of the table; the last two are extrapolated.
    mesh_step : float
    cost_steps, cost_until, cost_chunks : tuple of float, float, int
        Steps (s) at which costs are compared, up to when (s), on how many stretches at most.
    looks : int
        States whose energies and errors are looked at.
    kernels : str
    patience : float
        Longest time of a run (s).
    """

    steps: tuple[float, ...]
    ends: tuple[float, ...]
    period: bool
    beyond: float
    fine: tuple[float, ...]
    meshes: tuple[int, ...]
    mesh_step: float
    cost_steps: tuple[float, ...]
    cost_until: float
    cost_chunks: int
    looks: int
    kernels: str
    patience: float


def decades(first: int, last: int, number: int = 6) -> tuple[float, ...]:
    """Steps from 10**first to 10**last (s), as many a decade, to four digits."""
    return tuple(
        float(f"{10 ** (first - k / number):.4g}") for k in range(number * (first - last) + 1)
    )


PLANS = {
    True: Plan(
        *((3e-2, 1e-2), (0.3,), False, 0.31, (1e-2, 5e-3, 2.5e-3), (4, 8, 16), 1e-2),
        *((1e-2,), 0.1, 2, 1000, "numpy", 60.0),
    ),
    False: Plan(
        *(decades(-1, -5), (1.5,), True, 3.0, (8e-5, 4e-5, 2e-5), (20, 40, 80, 160), 5e-4),
        *((1e-2, 3.162e-3, 1e-3, 1e-4), 0.6, 60, 3000, "auto", 3600.0),
    ),
}


def scene(theory: str, elements: int) -> sc.System:
    """The swing with a beam on this theory."""
    return swing.build("stiff", elements=elements, theory=THEORIES[theory]())


def marched(
    theory: str, integrator: str, step: float, count: int, every: int, elements: int, plan: Plan
) -> failure_map.Passage:
    """A run of as many steps, after some that warm the kernels up."""
    system, method = scene(theory, elements), INTEGRATORS[integrator]
    chosen = choose_kernels(plan.kernels, system, method(), sc.NullSpace(), MANY).name
    failure_map.march(system, method(), step, WARM, kernels=chosen)
    return failure_map.march(
        system, method(), step, count, plan.patience, every, beyond=0, kernels=chosen
    )


# -- motions that others are compared with ---------------------------------------------------------


def motion(theory: str, step: float, elements: int, every: int, plan: Plan) -> dict[str, Any]:
    """The mass with energy-momentum, after each `every` steps; NaN after a failure."""
    count = round(plan.beyond / step / every) * every
    looks = max(1, count // plan.looks)
    run = marched(theory, "energy-momentum", step, count, looks, elements, plan)
    path = np.full((count, 3), np.nan)
    path[: len(run.path)] = run.path
    found = failure_map.find_events(run.watch.series)
    return {"path": path[every - 1 :: every], "spacing": every * step, "period": found["period_s"]}


class Reference(NamedTuple):
    """An extrapolated motion of the mass.

    Attributes
    ----------
    spacing : float
        Time between its points (s).
    path, coarse : (N, 3) array
        The mass (m), from the last two of some motions and from the two before.
    period : float or None
        Of the last one (s).
    """

    spacing: float
    path: Floats
    coarse: Floats
    period: float | None

    @classmethod
    def of(cls, motions: Sequence[dict[str, Any]]) -> Reference:
        """Extrapolated; errors of the motions fall as those of second order."""
        extrapolated = [b["path"] + (b["path"] - a["path"]) / 3 for a, b in pairwise(motions)]
        last = motions[-1]
        return cls(last["spacing"], extrapolated[-1], extrapolated[-2], last["period"])

    def error(self, until: float) -> float:
        """Its own: the distance of the coarser pair."""
        return self.distance(self.coarse, until)

    def distance(self, path: Floats, until: float) -> float:
        """Largest distance (m) of another path at the same instants."""
        last = int(until / self.spacing * (1 + 1e-12))
        return float(np.linalg.norm(path - self.path, axis=1)[:last].max())

    def away(self, times: Floats, path: Floats, until: float) -> float:
        """Largest distance (m) of a path at instants up to an end; NaN without any."""
        own = self.spacing * np.arange(1, len(self.path) + 1)
        near = (times >= own[0]) & (times <= until * (1 + 1e-12))
        if not near.any():
            return float("nan")
        there = CubicSpline(own, self.path)(times[near])
        return float(np.linalg.norm(path[near] - there, axis=1).max())


# -- cells -----------------------------------------------------------------------------------------


def cell(
    theory: str, integrator: str, step: float, ends: tuple[float, ...], plan: Plan
) -> dict[str, Any]:
    """A run to the last end: what is in the table for each end, and where the mass was."""
    counts = [int(np.ceil(end / step * (1 - 1e-12))) for end in ends]
    every = max(1, counts[-1] // plan.looks)
    run = marched(theory, integrator, step, counts[-1] + 1, every, plan.meshes[0], plan)
    fixed = {"theory": theory, "integrator": integrator, "step_s": step, "kernels": run.kernels}
    rows = [
        {**fixed, "until_s": end, **outcome(run, step, end, count)}
        for end, count in zip(ends, counts, strict=True)
    ]
    times = step * np.arange(1, len(run.path) + 1)
    if run.watch.blown:
        times = times[times <= run.watch.series[0, -1]]
    return {"rows": rows, "times": times[::every], "path": run.path[: len(times) : every]}


def outcome(run: failure_map.Passage, step: float, end: float, count: int) -> dict[str, Any]:
    """Of a run up to an end, which it reaches with as many steps."""
    series, solved = run.watch.series, min(count, len(run.path))
    blown = run.watch.blown and series[0, -1] <= end * (1 + 1e-12)
    after = (series[0] >= failure_map.PULSE_END * (1 - 1e-12)) & (
        series[0] <= solved * step * 1.001
    )
    errors = [float("nan")] * 2
    if after.sum() > 1:
        nodal, middle = series[1, after], series[2, after][1:]
        errors = [float(abs(e / e[0] - 1).max()) for e in (middle, nodal)]
    if blown:
        status = "blowup"
    elif solved < count:
        status = STATUS[run.outcome]
    else:
        status = "drift" if errors[0] > DRIFT else "ok"
    return {
        "status": status,
        "time_s": float(series[0, -1]) if blown else min(solved * step, end),
        "energy_error_midpoint": errors[0],
        "energy_error": errors[1],
        "repeated": int((run.attempts[:solved] > 1).sum()),
        "iterations_per_step": float(run.iterations[:solved].sum() / max(1, solved)),
        "ms_per_step": float(1e3 * run.seconds[:solved].sum() / max(1, solved)),
    }


def cost(theory: str, integrator: str, step: float, plan: Plan) -> dict[str, Any]:
    """A step of a theory against one of the full beam, in turns; iterations of full Newton, too."""
    method = INTEGRATORS[integrator]
    size = max(SHORTEST, round(plan.cost_until / step / plan.cost_chunks))
    number = max(1, int(plan.cost_until / step / size * (1 + 1e-12)))

    def runs(settings: NewtonSettings) -> list[list[measuring.Run]]:
        steppers, states = [], []
        for name in ("full", theory):
            system = scene(name, plan.meshes[0])
            chosen = choose_kernels(plan.kernels, system, method(), sc.NullSpace(), MANY).name
            args = (system, method(), sc.NullSpace(), step, settings, chosen)
            measuring.advance(sc.Stepper(*args), sc.initial_state(system), WARM)
            steppers.append(sc.Stepper(*args))
            states.append(sc.initial_state(system))
        done = []
        for _ in range(number):
            both = zip(steppers, states, strict=True)
            done.append([measuring.advance(stepper, state, size) for stepper, state in both])
            states = [run.state for run in done[-1]]
        return done

    chunks, newton = runs(failure_map.SETTINGS), runs(measuring.full_newton())
    steps = size * number
    row = {"theory": theory, "integrator": integrator, "step_s": step, "until_s": steps * step}
    for k, name in enumerate(("full", "theory")):
        row[f"ms_{name}"] = median(1e3 * both[k].seconds / size for both in chunks)
        row[f"iterations_{name}"] = sum(both[k].iterations for both in chunks) / steps
        row[f"factorisations_{name}"] = sum(both[k].factorisations for both in chunks) / steps
        row[f"newton_{name}"] = sum(both[k].iterations for both in newton) / steps
    row["ratio"] = median(both[1].seconds / both[0].seconds for both in chunks)
    return row


# -- the table -------------------------------------------------------------------------------------


class Study:
    """What is measured, each part kept in a folder as soon as it is there."""

    def __init__(self, plan: Plan, theories: Sequence[str], resume: str | Path | None) -> None:
        self.plan, self.theories, self.resume = plan, tuple(theories), resume

    def kept(self, function: Callable[..., Any], *args: Any) -> Any:
        """The value of a function of these arguments and the plan."""
        name = " ".join(map(str, (function.__name__, *args)))
        (found,) = sc.run_all([sc.Job(name, function, *args, self.plan)], folder=self.resume)
        if found.error is not None:
            raise found.error
        return found.value

    def in_time(self, theory: str) -> Reference:
        """Of the mesh of the table."""
        fine = self.plan.fine
        return Reference.of(
            [self.kept(motion, theory, h, self.plan.meshes[0], round(fine[0] / h)) for h in fine]
        )

    def in_space(self, theory: str) -> dict[str, Any]:
        """Motions by the number of elements; the last two extrapolated are the reference."""
        step, meshes = self.plan.mesh_step, self.plan.meshes
        motions = [self.kept(motion, theory, step, n, 1) for n in meshes]
        return {"reference": Reference.of(motions), "path": motions[0]["path"]}

    def prepare(self) -> dict[str, Any]:
        """References, and errors of models and meshes, by theory and end."""
        self.references = {theory: self.in_time(theory) for theory in ("full", *self.theories)}
        full = self.references["full"]
        ends = self.plan.ends
        if self.plan.period:
            if full.period is None:
                raise ValueError(
                    f"the reference does not complete a period in {self.plan.beyond} s"
                )
            ends = (*ends, round(full.period, 4))
        self.ends = ends
        errors = []
        for theory in self.theories:
            space, own = self.in_space(theory), self.references[theory]
            for end in ends:
                error = {
                    "theory": theory,
                    "until_s": end,
                    "model_error_m": full.distance(own.path, end),
                    "mesh_error_m": space["reference"].distance(space["path"], end),
                    "own_error_m": own.error(end),
                    "own_error_of_mesh_m": space["reference"].error(end),
                }
                errors.append(error)
        return {"period": full.period, "ends": ends, "errors": errors}

    def rows(self, errors: Sequence[dict[str, Any]]) -> Iterator[dict[str, Any]]:
        """A row for each theory, integrator, step and end; the long steps first."""
        of = {(each["theory"], each["until_s"]): each for each in errors}
        steps = sorted(self.plan.steps, reverse=True)
        for step, theory, integrator in product(steps, self.theories, INTEGRATORS):
            found = self.kept(cell, theory, integrator, step, self.ends)
            for row in found["rows"]:
                end, where = row["until_s"], (found["times"], found["path"])
                yield {
                    **row,
                    "error_m": self.references["full"].away(*where, end),
                    "time_error_m": self.references[theory].away(*where, end),
                    **{key: of[theory, end][key] for key in ("model_error_m", "mesh_error_m")},
                }

    def costs(self) -> list[dict[str, Any]]:
        """Theories against the full beam."""
        others = [theory for theory in self.theories if theory != "full"]
        cases = product(others, INTEGRATORS, self.plan.cost_steps)
        return [self.kept(cost, *each) for each in cases]

    def frequencies(self) -> list[dict[str, Any]]:
        """See alternation.py."""
        return [self.kept(frequencies, theory, self.ends) for theory in self.theories]


def frequencies(theory: str, ends: tuple[float, ...], plan: Plan) -> dict[str, Any]:
    """Frequencies of a theory, see alternation.py."""
    system = scene(theory, plan.meshes[0])
    plane = swing.scene("stiff", elements=plan.meshes[0], theory=THEORIES[theory]())
    found = alternation.highest(plane.freeze(planar=sc.Planar()))
    driven = alternation.driven(system, plan.fine[0], ends, plan.looks, plan.kernels)
    return {"theory": theory, "unknowns": system.unknowns, **found, **driven}


def main(
    quick: bool = True,
    out: str | Path | None = None,
    resume: str | Path | None = None,
    theories: Sequence[str] = tuple(THEORIES),
    plan: Plan | None = None,
) -> dict[str, Any]:
    """Run the table.

    Parameters
    ----------
    quick : bool
        Two steps, the first 0.3 s, few elements, plain kernels.
    out : path, optional
        Folder for theory_table.csv, .costs.csv, .ranges.csv, .theory.csv and, where matplotlib is
        there, .png.
    resume : path, optional
        Folder in which each part is kept, to go on after an interruption.
    theories : sequence of str
        Of THEORIES, the full beam among them.
    plan : Plan, optional
        Another than PLANS[quick].

    Returns
    -------
    dict
        ``rows``; ``errors`` of models and meshes, ``costs`` and ``theory`` by theory of beams;
        ``figures``, none without a full period; ``period`` (s) and ``ends`` (s); ``dgemm_gflops``
        and where it was measured.
    """
    for theory in theories:
        swing.choose("theories", theory, THEORIES)
    if "full" not in theories:
        raise ValueError(f"theories = {tuple(theories)!r}, expected the full beam among them")
    chosen = PLANS[quick] if plan is None else plan
    study = Study(chosen, theories, resume)
    known = study.prepare()
    path = None if out is None else Path(out) / "theory_table.csv"
    notes = {"full period of the mass in s": known["period"], "errors": known["errors"]}
    result = measuring.collected(study.rows(known["errors"]), path, COLUMNS, notes=notes, **known)
    result |= {"costs": study.costs(), "theory": study.frequencies()}
    result["figures"] = theory_report.figures(result, THEORY) if chosen.period else []
    if path is not None:
        theory_report.write(result, path)
    return result


missed = theory_report.missed


def report(result: dict[str, Any]) -> str:
    """The rows, costs, theory and figures, as text."""
    return f"{measuring.table(result['rows'], COLUMNS)}\n\n{theory_report.report(result)}"


if __name__ == "__main__":
    sys.exit(measuring.command(__doc__, main, report, missed, options=("resume",)))
