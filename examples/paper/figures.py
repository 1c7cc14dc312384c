"""Figures 19 to 24 of the paper: the data of the scene, and what the two integrators make of it.

Figure 19 is the scene; 20 to 22 show a run of the variational scheme with a step of 1e-2 s; 23 and
24 the energies of both integrators with 1e-2 and 1e-3 s, here each in terms of ``(q_n, q_{n+1})``,
``(q_n, p_n)`` and ``(q_n, Q p_n)``. The numbers the text says about them are computed as well.
Drawn by ``charts.py``.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from paper import three_bar_swing as swing
from skfem_cosserat import diagnostics

Floats = NDArray[np.float64]

PULSE_END = swing.PULSE["published"][1]
STEPS = (1e-2, 1e-3)
INTEGRATORS = ("variational", "energy-momentum")
#: times (s) of the snapshots, and the factor and limit of their colours
SNAPSHOTS = (0.0, 0.12, 0.25, 0.5, 0.75, 1.0, 1.25, 1.4, 1.5, 1.6, 1.8, 2.0)
MOMENT_FACTOR, COLOUR_LIMIT = 100.0, 4000.0
#: energy and angular momentum in each of the terms, by the names of three_bar_swing.main
TERMS = {"(q_n, q_n+1)": "_midpoint", "(q_n, p_n)": "", "(q_n, Q p_n)": "_projected"}
#: numbers of the text: geometry (m), masses (kg), section, pulse
SCENE = {
    "mass of a link": 0.01,
    "edge of a link's base": 0.02,
    "height of the left link": 0.36,
    "height of the right link": 0.36 * 2**0.5,
    "mid mass M": 5.0,
    "beam elements": 20,
    "GA": 175480.7692,
    "EA": 547500.0,
    "EI1": 114.0625,
    "EI2": 10.2656,
    "GJ": 13.7401,
    "A_rho": 7500.0,
    "M_rho^1": 1.5625,
    "M_rho^2": 0.1406,
    "peak of the pulse": 10000.0,
    "time of the peak": 0.125,
    "end of the pulse": 0.25,
}
#: the stiffer material of the text, in SI units (the paper's N/mm^2 is a slip), its section (m)
STIFF_SCENE = {"E": 73e9, "nu": 0.3, "rho": 2700.0, "width": 5e-3, "thickness": 1e-3}
EVENT_X = 1.4
UNTIL = {True: 2.0, False: 5.0}  # s; quick or not
#: steps (s) of the stiff scene in a quick and in a full run, and how far it runs
STIFF_STEPS, STIFF_UNTIL = {True: (1e-2,), False: (1e-1, 1e-2, 1e-3, 1e-4)}, 1.0


def scene() -> dict[str, float]:
    """What the program computes with, for each of SCENE; the beam and the bodies as built."""
    system = swing.build()
    beam: Any = system.structures[0]
    links = {s.name: s for s in system.structures if str(s.name).endswith("link")}
    mass = next(s for s in system.structures if s.name == "mass")
    section = next(iter(beam.sections.values()))
    left, right = (links[name].surface[0] for name in ("left link", "right link"))
    stiffness = np.diag(section.stiffness)
    _, end, peak = swing.PULSE["published"]
    return {
        "mass of a link": float(links["left link"].mass),
        "edge of a link's base": float(np.ptp(left[:, 0])),
        "height of the left link": float(np.ptp(left[:, 2])),
        "height of the right link": float(np.ptp(right[:, 2])),
        "mid mass M": float(mass.mass),
        "beam elements": len(beam.elements.lengths),
        "GA": float(stiffness[0]),
        "EA": float(stiffness[2]),
        "EI1": float(stiffness[3]),
        "EI2": float(stiffness[4]),
        "GJ": float(stiffness[5]),
        "A_rho": float(section.mass),
        "M_rho^1": float(section.inertia[0]),
        "M_rho^2": float(section.inertia[1]),
        "peak of the pulse": peak,
        "time of the peak": end / 2,
        "end of the pulse": end,
    }


def stiff_scene() -> dict[str, float]:
    """What the program computes with, for each of STIFF_SCENE, from the built section."""
    beam: Any = swing.build("stiff").structures[0]
    section = next(iter(beam.sections.values()))
    thickness, width = np.ptp(section.outline, axis=0)
    shear, _, axial = np.diag(section.stiffness)[:3] / (width * thickness)
    return {
        "E": float(axial),
        "nu": float(axial / (2 * shear * 6 / 5) - 1),  # shear factor 5/6
        "rho": float(section.mass / (width * thickness)),
        "width": float(width),
        "thickness": float(thickness),
    }


def run(
    integrator: str, step: float, until: float, treatment: str = "null-space"
) -> dict[str, Any]:
    """A run of the swing: its figures' data, and ``q`` and ``resultant``."""
    system = swing.build()
    methods = swing.INTEGRATORS[integrator](), swing.TREATMENTS[treatment]()
    history, reason = swing.run(system, *methods, step, until, PULSE_END)
    beam: Any = system.structures[0]
    result = swing.evaluate(system, history)
    result |= {
        "diverged": reason,
        "q": history["q"],
        "resultant": diagnostics.section_forces(system, beam, history["q"])[:, :, 0],
        "nodes": np.array([system.offset(beam.node(k)) for k in range(len(beam.basis.nodes))]),
        "connectivity": np.asarray(beam.basis.connectivity),
    }
    return result


def load_measure(resultant: Floats) -> Floats:
    """Norm of the section force plus 100 times that of the moment, (N, elements)."""
    force = np.linalg.norm(resultant[..., :3], axis=-1)
    return force + MOMENT_FACTOR * np.linalg.norm(resultant[..., 3:], axis=-1)


def nodal(values: Floats) -> Floats:
    """Element values (N, elements) of a chain at its nodes: the mean of both sides."""
    padded = np.concatenate([values[:, :1], values, values[:, -1:]], axis=1)
    return 0.5 * (padded[:, 1:] + padded[:, :-1])


def energy_statistics(result: dict[str, Any]) -> dict[str, dict[str, float]]:
    """After the pulse, in each of the terms, relative to the mean energy there.

    Returns
    -------
    dict
        ``range`` (largest less smallest) and ``drift`` (mean of the second half less that of the
        first) by term.
    """
    out = {}
    for term, ending in TERMS.items():
        values = result["energy" + ending]
        after = values[result["times"][: len(values)] >= PULSE_END - 1e-12]
        half = len(after) // 2
        mean = after.mean()
        out[term] = {
            "range": float(np.ptp(after) / mean),
            "drift": float((after[half:].mean() - after[:half].mean()) / mean),
        }
    return out


def momentum_statistics(result: dict[str, Any]) -> dict[str, float]:
    """Largest component of the angular momentum out of e1, relative to the largest along e1."""
    out = {}
    for term, ending in TERMS.items():
        L = abs(result["angular_momentum" + ending])
        out[term] = float(L[:, 1:].max() / L[:, 0].max())
    return out


def vibration(result: dict[str, Any], name: str) -> dict[str, float]:
    """Root mean square rate of a series in windows before and after event X, and their ratio."""
    t, x = result["times"], result["event_x"]
    rate = np.diff(result[name]) / np.diff(t)
    middle = 0.5 * (t[1:] + t[:-1])
    before = rate[(middle > x - 0.5) & (middle < x)]
    after = rate[(middle > x) & (middle < x + 0.5)]
    values = [float(np.sqrt((part**2).mean())) for part in (before, after)]
    return {"before": values[0], "after": values[1], "ratio": values[1] / values[0]}


def treatments_apart(result: dict[str, Any], step: float) -> float:
    """Largest relative difference of q to the run with multipliers."""
    other = run("variational", step, float(result["times"][-1]), "multipliers")
    return float((abs(result["q"] - other["q"]).max(1) / abs(result["q"]).max(1)).max())


def stiff(steps: tuple[float, ...]) -> dict[tuple[str, float], dict[str, Any]]:
    """The stiff scene up to 1 s, event X included: where each integrator stops, if it does."""
    out = {}
    for integrator in INTEGRATORS:
        for step in steps:
            result = swing.main(integrator, "null-space", step, STIFF_UNTIL, section="stiff")
            names = ("diverged_at", "divergence_reason", "event_x")
            out[integrator, step] = {name: result[name] for name in names}
    return out


def main(quick: bool = True) -> dict[str, Any]:
    """Data and numbers of all figures.

    Parameters
    ----------
    quick : bool
        Runs to 2 s instead of 5 s, fewer steps of the stiff scene.

    Returns
    -------
    dict
        ``scene``; ``runs`` by (integrator, step), see :func:`run`; ``energy`` (by the same) and
        ``momentum`` statistics; ``vibration``; ``colour_max`` of all states of the snapshots' run;
        ``stiff scene`` and ``stiff``.
    """
    until = UNTIL[quick]
    runs = {(i, h): run(i, h, until) for i in INTEGRATORS for h in STEPS}
    first = runs["variational", STEPS[0]]
    return {
        "scene": scene(),
        "runs": runs,
        "energy": {key: energy_statistics(result) for key, result in runs.items()},
        "momentum": momentum_statistics(first),
        "vibration": {name: vibration(first, name) for name in ("axial_force", "bending_moment")},
        "treatments apart": treatments_apart(first, STEPS[0]),
        "colour_max": float(load_measure(first["resultant"]).max()),
        "stiff scene": stiff_scene(),
        "stiff": stiff(STIFF_STEPS[quick]),
    }
