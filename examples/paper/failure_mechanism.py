"""How the variational scheme fails in stiff scenes, and which numbers tell it beforehand.

The variational scheme sees stresses at midpoints only. A rotation of a node that alternates,
``(-1)^n b``, has none there: elastic forces do not hold it, they only make b slow to change, as a
mass ``h^2 K/4`` would. The inertia ``4 M/h^2`` holds it. The constraint force of the directors,
which acts at the nodes as in the leapfrog scheme, drives it: its stiffness ``K_c`` is the
compression N times the length of beam that a node carries. Once ``K_c > 4 M/h^2``, i.e. ``h
omega_c > 2``, b grows exponentially (the tests compare its rate with the linear analysis). The
energy of the midpoints does not see it; that of the nodes does. When the triads of the nodes have
turned so far that their mean is noticeably shorter than 1, steps cannot be solved any more.

With a slender solid section shear gives the highest frequency omega, and ``h omega_c = 2`` is a
compressive strain of ``0.4/(h omega)^2``: 0.4 % for h omega = 10, the limit of
`Variational`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.accuracy import FULL_PROTOCOL
from skfem_cosserat.diagnostics import constraint_frequency

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from paper import three_bar_swing as swing

Floats = NDArray[np.float64]

SETTINGS = FULL_PROTOCOL
BLOW_UP = 10.0  # times the energy just after the pulse


def alternating_rotations(system: sc.System, q: Floats) -> Floats:
    """Part of the rotation of each frame that changes sign from step to step.

    ``-(q_{n+1} - 2 q_n + q_{n-1})/4`` of ``q_n = s + (-1)^n a`` is ``(-1)^n a`` (and
    ``-h^2 s''/4``); the rotation in it is ``sum d_i x a_i / 2``.

    Parameters
    ----------
    q : (N, n) array
        Configurations of consecutive steps.

    Returns
    -------
    (N-2, frames, 3) array
        (rad)
    """
    d = q.reshape(len(q), -1, 3)[:, system.kinematics.director_rows]
    part = -(d[2:] - 2 * d[1:-1] + d[:-2]) / 4
    return 0.5 * np.cross(d[1:-1], part).sum(2)


def mechanism(step: float = 5e-4, section: str = "stiff") -> dict[str, Any]:
    """A failing run of the variational scheme, looked at closely.

    Returns
    -------
    dict
        Arrays over the steps from the end of the pulse to the blow-up: ``times``,
        ``alternation`` (largest alternating rotation of a node, rad), ``energy`` and
        ``energy_midpoint`` (both relative to just after the pulse), ``h_omega_c``. Over the last
        100 steps before the blow-up (``window``, s): ``growth`` of the alternation,
        ``energy_growth`` and ``midpoint_change`` (largest relative change); over the last 50
        ``sign_changes``, the share of steps in which the alternating rotation of the node that
        moves most in the end changes its sign.
    """
    system = swing.build(section)
    history, _ = swing.run(
        system, sc.Variational(), sc.NullSpace(), step, 10.0, swing.PULSE[section][1]
    )
    t, q = history.times, history["q"]
    with np.errstate(all="ignore"):
        nodal = swing._energy(system, q, history["p"])
        middle = diagnostics.midpoint_energy(system, q, step, mean=False)
    first = int(np.searchsorted(t, swing.PULSE[section][1] * (1 - 1e-12)))
    theta = alternating_rotations(system, q)
    size = abs(theta).max((1, 2))
    force = history["constraint_force"]
    keep = slice(first, len(t) - 1)
    omega = [
        constraint_frequency(system, q[k], force[k]) if np.isfinite(force[k]).all() else np.nan
        for k in range(first, len(t) - 1)
    ]
    result: dict[str, Any] = {
        "step": step,
        "section": section,
        "times": t[keep],
        "alternation": size[first - 1 :],
        "energy": nodal[keep] / nodal[first],
        "energy_midpoint": middle[keep] / middle[first],
        "h_omega_c": step * np.array(omega),
    }
    blown = result["energy"] > BLOW_UP
    stop = int(np.argmax(blown)) if blown.any() else len(omega)
    window = slice(max(0, stop - 100), stop)
    a = result["alternation"][window]
    spin = theta[first - 1 :][window]
    node, axis = np.unravel_index(np.argmax(abs(spin[-1])), spin.shape[1:])
    signs = np.sign(spin[:, node, axis])
    e, m = result["energy"][window], result["energy_midpoint"][window]
    return result | {
        "window": (float(result["times"][window][0]), float(result["times"][window][-1])),
        "growth": float(np.median(a[-10:]) / np.median(a[:10])),
        "sign_changes": float((signs[1:] * signs[:-1] < 0)[-50:].mean()),
        "energy_growth": float(e.max() / e[:10].mean()),
        "midpoint_change": float(np.ptp(m) / m.mean()),
    }


# -- which runs does h omega tell from which? ------------------------------------------------------


def rubber_rod() -> sc.System:
    """The scene of the README: a rubber rod with a ball swings down from its hinge."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 16, name="rod")
    rubber = sc.SectionCircle(radius=5e-3, material=sc.Material(E=5e6, nu=0.5, rho=1100))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, rubber, director=(0, 1, 0)))
    model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), (0, 0, 1)))
    model.add("ball", sc.RigidBody.sphere(0.05, radius=0.02, on=rod.node("rod.end")))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    return model.freeze()


def steel_bar(axial: float, lateral: float, rise: float) -> sc.System:
    """A cantilever of 1 m, 10 x 10 mm; loads (N) at its end grow within `rise` (s) and stay."""
    steel = sc.Material(210e9, 0.3, 7850.0)
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 10, name="bar")
    model = sc.Model()
    bar = model.add(
        "bar", sc.Beam(mesh, sc.SectionRectangle(0.01, 0.01, steel), director=(0, 1, 0))
    )
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), bar.node("bar.start")))
    load = sc.LoadForce(bar.node("bar.end"), (axial, lateral, 0), sc.Table([0, rise], [0, 1]))
    model.add("load", load)
    return model.freeze()


EULER = np.pi**2 * 210e9 * 0.01**4 / 12 / 4  # N, buckling load of the cantilever
SIDE = partial(swing.build, side_load=1e-3)
_column = partial(steel_bar, -EULER / 2, 1e-3, 0.05)
_tie = partial(steel_bar, EULER / 2, 1e-3, 0.05)
#: scene, how to build it, steps (s), end (s), steps of the full mode
SCENES: tuple[tuple[str, Callable[[], sc.System], tuple[float, ...], float, tuple[float, ...]], ...]
SCENES = (
    ("swing, published, exactly plane", swing.build, (1e-2,), 8.0, (3e-2, 5e-3)),
    ("swing, published, side load 1e-3", SIDE, (1e-2,), 8.0, (5e-3, 3e-3)),
    ("swing, physical", partial(swing.build, "physical"), (1e-2,), 4.0, (2e-2, 5e-3, 2e-3)),
    ("swing, stiff", partial(swing.build, "stiff"), (1e-2,), 1.0, (1e-3, 1e-4)),
    ("rubber rod and ball", rubber_rod, (1e-2,), 1.5, (2e-3, 1e-3, 2e-4)),
    ("steel cantilever, 1 mm", partial(steel_bar, 0.0, 1.7, 0.01), (1e-3,), 0.5, (1e-4,)),
    ("steel column, half of Euler", _column, (1e-3,), 0.5, (1e-4,)),
    ("steel tie, the same in tension", _tie, (1e-3,), 0.5, (1e-4,)),
)


def judge(build: Callable[[], sc.System], step: float, until: float) -> dict[str, Any]:
    """Whether the variational scheme fails, and whether its step is above what is advised.

    Returns
    -------
    dict
        ``h_omega``, ``warned`` (it is above the scheme's limit), ``failed_at`` (s or None: the
        energy exceeds ten times the largest one with energy-momentum, or a step cannot be
        solved), ``h_omega_c`` (largest of 200 states) and ``compression``, the largest compressive
        strain with energy-momentum until then.
    """
    system = build()
    beam: Any = system.structures[0]
    h_omega = step * diagnostics.highest_frequency(system)
    kept = {"every": max(1, round(until / step / 2000)), "derive": False}
    try:
        history = sc.simulate(
            system, sc.EnergyMomentum(), sc.NullSpace(), step, until, settings=SETTINGS, **kept
        )
    except sc.Diverged as error:
        history = error.history
    largest = float(np.nanmax(swing._energy(system, history["q"], history["p"])))
    omega_c, failed, last = 0.0, None, None
    count = round(until / step)
    try:
        for report in sc.steps(system, sc.Variational(), sc.NullSpace(), step, settings=SETTINGS):
            k = report.state.index
            if last is not None and k % max(1, count // 2000) == 0:
                energy = float(swing._energy(system, last.q, report.momentum))
                if not energy <= BLOW_UP * largest:
                    failed = last.time
                    break
                if k % max(1, count // 200) == 0:
                    force = report.constraint_force
                    omega_c = max(omega_c, constraint_frequency(system, last.q, force))
            last = report.state
            if k >= count:
                break
    except sc.Diverged as error:
        failed = error.time
    before = history["q"][history.times <= (until if failed is None else failed)]
    strain = -float(diagnostics.section_strains(system, beam, before)[..., 2].min())
    return {
        "h_omega": h_omega,
        "warned": h_omega > (sc.Variational.frequency_limit or np.inf),
        "failed_at": failed,
        "h_omega_c": step * omega_c,
        "compression": max(0.0, strain),
    }


def criterion(quick: bool = True) -> list[dict[str, Any]]:
    """All scenes and steps; see :func:`judge`."""
    rows = []
    for name, build, steps, until, more in SCENES:
        for step in sorted(steps + (() if quick else more), reverse=True):
            rows.append({"scene": name, "step_s": step, "until_s": until})
            rows[-1] |= judge(build, step, until)
    return rows


def main(quick: bool = True) -> dict[str, Any]:
    """The mechanism and the table of scenes, see :func:`mechanism` and :func:`criterion`."""
    return {"mechanism": mechanism(), "criterion": criterion(quick)}
