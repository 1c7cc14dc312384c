"""Where the integrators fail: the three-bar swing from soft to stiff, steps from 1e-1 to 3e-5 s.

The swing with the strip of 1 mm (see paper/three_bar_swing.py: aluminium, factor 1), its stiffness
times a factor. Nothing but inertia drives it after the pulse, so that the energy at (q_n, p_n) just
after the pulse is the right one. A cell is *blowup* if it exceeds ten times that, *drift* if it
changed by more than 1 %, *newton* if a step could not be solved in four attempts of up to 100
iterations each, *timeout* if it took too long. One second, in which the right link
reverses (event X, 0.66 s).

Why a cell has failed its `mechanism` tells, as far as the steps of the run do: see
:data:`skfem_cosserat.accuracy.stability.MECHANISMS`.

Theory's lines: ``h omega = 2``, the limit of explicit methods for the highest frequency of the
beam; and ``h omega_c = 2``, with the frequency of the constraint force of compressed beams (see
paper/failure_mechanism.py), the largest one over the motion with energy-momentum: to the right of
it rotations that alternate from step to step grow in the variational scheme.

The explicit integrator, with nodal masses and multipliers, is run above its limit on purpose.

Run ``python examples/benchmarks/stability_chart.py --help`` for the choices.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import measuring  # before numpy: one thread
import numpy as np
from measuring import EXPLICIT, METHODS

import skfem_cosserat as sc
from paper import three_bar_swing as swing
from skfem_cosserat import diagnostics
from skfem_cosserat.accuracy import FULL_PROTOCOL, JudgeEnergy, Map, TimedOut, stability_map

STEPS = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5)
FACTORS = (1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0)
QUICK = {"steps": (3e-2, 1e-2), "factors": (1e-3, 1.0)}
UNTIL = {True: 0.7, False: 1.0}
PULSE_END = swing.PULSE["stiff"][1]
#: longest time of a cell (s)
PATIENCE = 300.0
#: states that are recorded, and looked at for the energy
LOOKS = 2000
#: step of the motion from which theory's line comes (s), if quick and else, and how many of its
#: states are looked at
FINE, SAMPLES = {True: 5e-3, False: 1e-3}, 200
TITLE = "Three-bar swing: where the integrators fail"
LABELS = {
    "factor": "stiffness of the strip over that of aluminium",
    "step": "step in s",
    "error": "joint not closed",  # the only other failure: of explicit runs
}
#: one or two of each family: as many as a page can show
SHOWN = (
    *("energy-momentum", "energy-momentum of order 4", "variational", "variational of order 4"),
    *("generalized-alpha 0", "generalized-alpha 0.8 stabilized", "energy-decaying 5/s"),
    "explicit",
)
COLUMNS = (
    *("integrator", "factor", "step", "status", "mechanism", "time_s", "energy_error"),
    *("newton_residual", "seconds", "kernels"),
)


ALL = {
    **{name: make for name, make in METHODS.items() if name not in EXPLICIT},
    "explicit": partial(sc.Explicit, checked=False),
}


@cache
def system(factor: float, lumped: bool = False) -> sc.System:
    """The swing with the strip, its stiffness times this; `lumped`: nodal masses."""
    return swing.build("stiff", factor=factor, lumped=lumped)


def whole_steps(until: float, step: float) -> float:
    """The last time up to `until` that a number of whole steps ends at (s)."""
    return step * int(until / step * (1 + 1e-12) + 1e-9)


def cell(
    integrator: str,
    factor: float,
    step: float,
    methods: Mapping[str, Callable[[], Any]],
    until: float,
    kernels: str,
) -> sc.History:
    """One run with the null space (explicit: multipliers); it ends where a step fails."""
    explicit = integrator in EXPLICIT
    scene = system(factor, explicit)
    try:
        history = sc.simulate(
            scene,
            methods[integrator](),
            sc.Multipliers() if explicit else sc.NullSpace(),
            step,
            whole_steps(until, step),
            every=max(1, round(until / step / LOOKS)),
            settings=FULL_PROTOCOL,
            derive=False,
            kernels="auto" if explicit else kernels,
        )
    except (sc.Diverged, TimedOut) as error:
        if error.history is not None:
            _add_energy(scene, error.history)
        raise
    _add_energy(scene, history)
    return history


def _add_energy(scene: sc.System, history: sc.History) -> None:
    history.add_series("energy", swing._energy(scene, history["q"], history["p"]))


def energy(history: sc.History) -> Any:
    """What the judge looks at."""
    return history["energy"]


def constraint_frequency(factor: float, step: float, until: float, kernels: str) -> float:
    """Largest omega_c (rad/s) over the motion."""
    scene = system(factor)
    run = {"every": max(1, round(until / step / SAMPLES)), "derive": False, "kernels": kernels}
    try:
        end = whole_steps(until, step)
        history = sc.simulate(scene, sc.EnergyMomentum(), sc.NullSpace(), step, end, **run)
    except sc.Diverged as error:
        history = error.history
    found = [
        diagnostics.constraint_frequency(scene, q, force)
        for q, force in zip(history["q"], history["constraint_force"], strict=True)
        if np.isfinite(force).all()
    ]
    return max(found)


def limits(
    factors: Sequence[float], step: float, until: float, kernels: str
) -> tuple[dict[str, Any], list[dict[str, float]]]:
    """Theory's lines for the chart, and the frequencies that they come from."""
    highest = {each: diagnostics.highest_frequency(system(each)) for each in factors}
    lumped = {each: sc.Explicit.limit(system(each, True)).seconds for each in factors}
    driven = {each: constraint_frequency(each, step, until, kernels) for each in factors}

    def explicit(integrator: str, factor: float, step: float) -> float:
        return step / lumped[factor] if integrator in EXPLICIT else step * highest[factor] / 2

    def resonance(integrator: str, factor: float, step: float) -> float:
        if not integrator.startswith("variational"):
            return float("nan")
        longest = max((abs(s) for s in ALL.get(integrator, sc.Variational)().shares), default=1.0)
        return longest * step * driven[factor] / 2

    lines = {r"explicit limit, $h\omega = 2$": explicit, r"variational, $h\omega_c = 2$": resonance}
    rows = [{"factor": f, "omega": highest[f], "omega_c": driven[f]} for f in factors]
    return lines, rows


def main(
    quick: bool = True,
    steps: Sequence[float] | None = None,
    factors: Sequence[float] | None = None,
    integrators: Mapping[str, Callable[[], Any]] | None = None,
    until: float | None = None,
    kernels: str | None = None,
    out: str | Path | None = None,
    resume: str | Path | None = None,
    timeout_s: float = PATIENCE,
) -> dict[str, Any]:
    """Run the map.

    Parameters
    ----------
    quick : bool
        Two steps, two factors, plain kernels, until event X only; else on all processors.
    steps, factors : sequence of float, optional
        Others.
    integrators : mapping, optional
        By name; default: ALL.
    until : float, optional
        End (s).
    kernels : str, optional
        Default: "numpy" if quick, else "numba"; of the explicit one always "auto".
    out : path, optional
        Folder for stability_chart.csv and, where matplotlib is there, stability_chart.png (SHOWN)
        and stability_chart.all.png.
    resume : path, optional
        Folder in which each cell is kept, to go on after an interruption.
    timeout_s : float
        Longest time of a cell (s).

    Returns
    -------
    dict
        ``map``, ``rows``, ``limits`` (frequencies by factor), ``dgemm_gflops`` and where it was
        measured.
    """
    methods = dict(ALL if integrators is None else integrators)
    end = UNTIL[quick] if until is None else until
    kind = ("numpy" if quick else "numba") if kernels is None else kernels
    sizes = steps or (QUICK["steps"] if quick else STEPS)
    scales = factors or (QUICK["factors"] if quick else FACTORS)
    axes = {"integrator": list(methods), "factor": sorted(scales), "step": sorted(sizes)}
    run = partial(cell, methods=ALL | methods, until=end, kernels=kind)
    workers = None if quick else sc.Processes()
    judge = JudgeEnergy(energy, since=PULSE_END)
    found = stability_map(run, axes, judge, workers, resume, timeout_s=timeout_s)
    lines, frequencies = limits(axes["factor"], FINE[quick], end, kind)
    result = {"map": found, "rows": found.rows, "limits": frequencies, **measuring.environment()}
    if out is not None:
        folder = Path(out)
        folder.mkdir(parents=True, exist_ok=True)
        found.csv(folder / "stability_chart.csv")
        with suppress(ImportError):  # charts come with the extra "view"
            told: dict[str, Any] = {"lines": lines, "title": TITLE, "labels": LABELS}
            found.chart(folder / "stability_chart.all.png", **told)
            some(found, SHOWN).chart(folder / "stability_chart.png", **told)
    return result


def some(found: Map, integrators: Sequence[str]) -> Map:
    """The map of those of the integrators that it has; of all if it has none."""
    names = found.axes["integrator"]
    kept = [k for k, name in enumerate(names) if name in integrators] or list(range(len(names)))
    axes = found.axes | {"integrator": [names[k] for k in kept]}
    return replace(found, axes=axes, cells=found.cells[kept], seconds=found.seconds[kept])


def missed(result: dict[str, Any]) -> list[str]:
    """Energy-momentum passes event X of the stiff swing with steps of 5e-3 s and less."""
    found: Map = result["map"]
    out = []
    for row in found.rows:
        if (row["integrator"], row["factor"]) != ("energy-momentum", 1.0) or row["step"] > 5e-3:
            continue
        if row["status"] != "ok" and not row["time_s"] > 0.66:
            out.append(f"energy-momentum, h = {row['step']:g} s: {row['status']}")
    return out


def report(result: dict[str, Any]) -> str:
    """The cells and theory's frequencies, as text."""
    parts = [measuring.table(result["rows"], COLUMNS), str(result["map"])]
    return "\n\n".join([*parts, measuring.table(result["limits"], ("factor", "omega", "omega_c"))])


if __name__ == "__main__":
    sys.exit(measuring.command(__doc__, main, report, missed, options=("resume",)))
