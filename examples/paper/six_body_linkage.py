"""The six-body linkage of Leyendecker, Marsden & Ortiz, ZAMM 88 (2008) 677, Table 1.

Six rigid rods in a ring of six revolute joints, one rod fixed to ground: 72 coordinates, 72
constraint rows of which 71 are independent, one degree of freedom. The paper's geometry is not
printed; here it is the Bricard linkage along the edges of a cube, P0 (0, 0, 0), P1 (1, 0, 0),
P2 (1, -1, 0), P3 (1, -1, 1), P4 (0, -1, 1), P5 (0, 0, 1), with rod P5P0 fixed: the mechanism A04 of
the IFToMM benchmark library. Uniform rods of 1 m x 0.1 m x 0.1 m and 1 kg, gravity 9.81 m/s^2
along -y, released from rest. All units SI.

With a *twist* the ring is a general linkage of Bricard's threefold-symmetric family: rods of 1 m,
neighbouring axes twisted by a, -a, a, ... about the rod between them, joint angles x, y, x, y, ...
(Denavit & Hartenberg). Its shape for a given x is found by closing the chain numerically. The
relation between neighbouring angles (Chen, You & Tarnai, Int. J. Solids Struct. 42 (2005) 2287)

    cos^2 a + sin^2 a (cos x + cos y) + (1 + cos^2 a) cos x cos y - 2 cos a sin x sin y = 0

enters nowhere but the result `closure`. The cube's edges are a = 90 degrees, x = y = -90 degrees.

Run ``python examples/six_body_linkage.py --help`` for the choices.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import skfem_cosserat as sc
from paper.three_bar_swing import INTEGRATORS, TREATMENTS, choose, median_condition_number
from skfem_cosserat import diagnostics
from skfem_cosserat.export import prepare_folder
from skfem_cosserat.run import derive_series

#: twist of neighbouring axes and joint angle of the linkage along the edges of a cube
CUBE = (np.pi / 2, -np.pi / 2)
LENGTH, WIDTH, MASS, GRAVITY = 1.0, 0.1, 1.0, (0.0, -9.81, 0.0)
#: gap (m, and rad) up to which a chain counts as closed
CLOSED = 1e-10
#: steps whose median is the condition number
CONDITION_STEPS = (1, 10, 20, 50, 100)

Floats = NDArray[np.float64]


def chain(twist: float, angles: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Joints, axes and rods of an open chain from P0 on.

    Parameters
    ----------
    twist : float
        From one axis to the next about the rod between them (rad), with alternating sign.
    angles : (6,) array
        From one rod to the next about the axis between them (rad); before P0 there is the rod P5P0
        along -z, and the axis at P0 is y.

    Returns
    -------
    points, axes : (7, 3) array
        The seventh ones are those of the first again if the chain closes.
    rods : (7, 3) array
        Directions; ``rods[k]`` ends at ``points[k]``.
    """
    points, axes, rods = [np.zeros(3)], [np.array([0.0, 1.0, 0.0])], [np.array([0.0, 0.0, -1.0])]
    for k, angle in enumerate(np.asarray(angles, dtype=float)):
        rods.append(Rotation.from_rotvec(angle * axes[-1]).apply(rods[-1]))
        points.append(points[-1] + LENGTH * rods[-1])
        axes.append(Rotation.from_rotvec((-1) ** k * twist * rods[-1]).apply(axes[-1]))
    return np.array(points), np.array(axes), np.array(rods)


def _gap(twist: float, x: float, y: float) -> Floats:
    """What is missing at the end of the chain: (3,) m, then (6,) of the two directions."""
    points, axes, rods = chain(twist, [x, y] * 3)
    return np.concatenate([points[6] - points[0], axes[6] - axes[0], rods[6] - rods[0]])


def closing_angle(twist: float, x: float) -> float:
    """Joint angle y (rad) that closes the ring x, y, x, y, x, y; of several the nearest to x.

    By least squares from the lowest points of a grid.

    Raises
    ------
    InputError
        If the ring cannot close, with the smallest gap that was found.
    """
    grid = np.linspace(-np.pi, np.pi, 72, endpoint=False)
    gaps = np.array([np.linalg.norm(_gap(twist, x, y)) for y in grid])
    lowest = np.flatnonzero((gaps <= np.roll(gaps, 1)) & (gaps <= np.roll(gaps, -1)))
    exact = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}
    fits = [
        least_squares(lambda y: _gap(twist, x, float(y[0])), start, **exact)
        for start in grid[lowest]
    ]
    found = [float(fit.x[0]) for fit in fits if np.linalg.norm(fit.fun) < CLOSED]
    if not found:
        miss = min((fit.fun for fit in fits), key=np.linalg.norm)
        raise sc.InputError(
            "linkage",
            f"cannot close with twist = {twist:.6g} rad and angle = {x:.6g} rad: its ends stay"
            f" {np.linalg.norm(miss[:3]):.3g} m apart, with directions that differ by"
            f" {np.linalg.norm(miss[3:]):.3g}",
        )
    return min(found, key=lambda y: 1 - np.cos(y - x))


def _number(name: str, value: Any, default: float) -> float:
    if value is None:
        return default
    if isinstance(value, bool | str) or not np.isscalar(value) or not np.isfinite(value):
        raise sc.InputError(f"argument {name}", f"{value!r}, expected a finite number of rad")
    return float(value)


def _geometry(twist: float | None, angle: float | None) -> tuple[Floats, Floats]:
    """Joints and their axes (6, 3)."""
    if twist is None and angle is None:
        points, axes, _ = chain(*CUBE[:1], [CUBE[1]] * 6)
        return np.rint(points[:6]) + 0.0, np.rint(axes[:6]) + 0.0  # the cube's corners and edges
    a, x = _number("twist", twist, CUBE[0]), _number("angle", angle, CUBE[1])
    if abs(np.sin(a)) < 1e-3:
        raise sc.InputError(
            "argument twist", f"{a:.6g} rad, its axes are parallel: a planar ring, not this linkage"
        )
    points, axes, _ = chain(a, [x, closing_angle(a, x)] * 3)
    return points[:6], axes[:6]


def build(twist: float | None = None, angle: float | None = None) -> sc.System:
    """The scene; links 0 (fixed) to 5, joints P0 to P5, link k from P(k-1) to Pk.

    Parameters
    ----------
    twist, angle : float, optional
        (rad) See :func:`main`.
    """
    return linkage(*_geometry(twist, angle))


def linkage(
    points: ArrayLike,
    axes: ArrayLike,
    mass: float = MASS,
    width: float = WIDTH,
    gravity: ArrayLike = GRAVITY,
) -> sc.System:
    """A ring of square rods with revolute joints between them, the first rod fixed.

    Parameters
    ----------
    points, axes : (6, 3) array
        Joints P0 to P5 (m) and their axes, unit vectors; link 0 reaches from P5 to P0.
    mass, width : float
        Of each rod (kg, m).
    gravity : (3,) array
        (m/s^2)
    """
    points, axes = np.asarray(points, dtype=float), np.asarray(axes, dtype=float)
    model = sc.Model()
    links = []
    for k in range(6):
        a, b = points[k - 1], points[k]
        length = float(np.linalg.norm(b - a))
        rod = sc.RigidBody.box(
            mass,
            (width, width, length),
            position=(a + b) / 2,
            triad=sc.triad((b - a) / length, axes[k]),
        )
        links.append(model.add(f"link {k}", rod))
    model.add("base", sc.JointFixed(sc.ground(points[0]), links[0].at(points[0])))
    for k in range(6):
        sides = links[k].at(points[k]), links[(k + 1) % 6].at(points[k])
        model.add(f"P{k}", sc.JointRevolute(*sides, axes[k]))
    model.add("gravity", sc.LoadGravity(gravity))
    return model.freeze()


def main(
    integrator: str = "variational",
    treatment: str = "null-space",
    step: float = 1e-2,
    until: float = 10.0,
    twist: float | None = None,
    angle: float | None = None,
    out: str | Path | None = None,
) -> dict[str, Any]:
    """Run the linkage.

    Parameters
    ----------
    integrator : {"variational", "energy-momentum"}
    treatment : {"null-space", "multipliers"}
    step, until : float
        Step size and end time (s).
    twist : float, optional
        Twist a of a threefold-symmetric linkage (rad); default: the edges of a cube, 90 degrees.
    angle : float, optional
        Joint angle x at the start (rad), at P0, P2 and P4; default: -90 degrees.
    out : path, optional
        Folder for the history, the ParaView files and charts; None: nothing is written.

    Returns
    -------
    dict
        Arrays over the N stored states: ``times``, ``P3`` (N, 3), ``joint_angles`` (N, 6) in rad
        from rod to rod, continued over whole turns, ``closure`` the largest residual of the
        relation between the six pairs of neighbouring angles, ``energy`` at (q, p) and
        ``energy_midpoint`` (N-1,), both with the potential of gravity, ``constraint_violation``,
        ``newton_iterations`` (N-1,); and numbers. A diverging run returns what it has, with
        ``diverged_at`` and ``divergence_reason``.

    Raises
    ------
    ValueError
        For bad choices, and if the linkage cannot close at this angle.
    """
    chosen = choose("integrator", integrator, INTEGRATORS)()
    constraints = choose("treatment", treatment, TREATMENTS)()
    system = build(twist, angle)
    if out is not None:
        prepare_folder(Path(out))  # before the run, not after it
    reason = None
    try:
        history = sc.simulate(system, chosen, constraints, step, until, derive=False)
    except sc.Diverged as error:
        history, reason = error.history, str(error)
    result = evaluate(system, history, CUBE[0] if twist is None else float(twist))
    result["diverged_at"] = float(history.times[-1]) if reason else None
    result["divergence_reason"] = reason
    if out is not None:
        write(system, history, Path(out))
    return result


def evaluate(system: sc.System, history: sc.History, twist: float) -> dict[str, Any]:
    """Results of a history."""
    q, p, t = history["q"], history["p"], history.times
    step = history.meta["step"]
    angles = joint_angles(system, history)
    mean = history.meta["integrator"] == "energy-momentum"
    middle = (q[1:] + q[:-1]) / 2
    return {
        "times": t,
        "P3": history.position(_link(system, 3).local((0, 0, LENGTH / 2))),  # its far end
        "joint_angles": angles,
        "closure": abs(relation(twist, angles, np.roll(angles, -1, axis=1))).max(1),
        "energy": diagnostics.kinetic_energy(system, p) + diagnostics.external_energy(system, q, t),
        "energy_midpoint": diagnostics.midpoint_energy(system, q, step, mean)
        + diagnostics.external_energy(system, middle, (t[1:] + t[:-1]) / 2),
        "unknowns": history.meta["unknowns"],
        "n": system.n,
        "m_rows": system.m,
        "rank": system.rank,
        "newton_iterations": np.asarray(history["newton_iterations"][1:], dtype=int),
        "constraint_violation": diagnostics.constraint_violation(system, q, t),
    }


def relation(twist: float, x: ArrayLike, y: ArrayLike) -> Floats:
    """Residual of the closed form between neighbouring joint angles x and y (rad)."""
    c, s2 = np.cos(twist), np.sin(twist) ** 2
    both = (1 + c**2) * np.cos(x) * np.cos(y) - 2 * c * np.sin(x) * np.sin(y)
    return np.asarray(c**2 + s2 * (np.cos(x) + np.cos(y)) + both)


def _link(system: sc.System, k: int) -> Any:
    return next(item for item in system.structures if item.name == f"link {k}")


def joint_angles(system: sc.System, history: sc.History) -> Floats:
    """Angles (N, 6) from rod to rod about the axis between them (rad), continued over turns.

    Link k carries its rod as d3 and the axis of its far end as d1.
    """
    triads = [history.rotation(_link(system, k).local((0, 0, 0))) for k in range(6)]
    out = np.empty((len(history), 6))
    for k in range(6):
        rod, axis, following = triads[k][:, 2], triads[k][:, 0], triads[(k + 1) % 6][:, 2]
        sine = (np.cross(rod, following) * axis).sum(1)
        out[:, k] = np.arctan2(sine, (rod * following).sum(1))
    return np.unwrap(out, axis=0)


def condition_number(
    integrator: str,
    treatment: str,
    step: float,
    scaled: bool = False,
    steps: Any = None,
) -> float:
    """Median 2-norm condition number of the iteration matrix over some steps.

    Parameters
    ----------
    scaled : bool
        Of the matrix that is actually factorised, where multipliers are scaled.
    steps : sequence of int, optional
        Step numbers; default: 1, 10, 20, 50, 100. At the converged state of each step, SI units.
        Steps after one that cannot be solved are left out; NaN if none is left.
    """
    numbers = CONDITION_STEPS if steps is None else steps
    return median_condition_number(build(), integrator, treatment, step, scaled, numbers)


def write(system: sc.System, history: sc.History, folder: Path) -> list[Path]:
    """History, ParaView files and, where matplotlib is installed, charts."""
    from skfem_cosserat.export import write_paraview

    derive_series(system, history)
    paths = write_paraview(history, folder, surfaces=True)
    history.add_series("joint_angles", joint_angles(system, history))
    history.save(folder / "six_body_linkage.history")
    try:
        from skfem_cosserat.plot import plot_energy, plot_orbit

        plot_energy(history, folder / "energy.png", names=("kinetic", "external", "energy"))
        plot_orbit(history, "joint/P3", folder / "orbit.png", axes="yz")
        history.plot("joint_angles", path=folder / "angles.png")
    except ImportError:
        pass  # charts come with the extra "view"
    return paths


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--integrator", default="variational", choices=sorted(INTEGRATORS))
    parser.add_argument("--treatment", default="null-space", choices=sorted(TREATMENTS))
    parser.add_argument("--step", type=float, default=1e-2)
    parser.add_argument("--until", type=float, default=10.0)
    parser.add_argument("--twist", type=float, help="twist of neighbouring axes (rad)")
    parser.add_argument("--angle", type=float, help="first joint angle at the start (rad)")
    parser.add_argument("--out", default="six_body_linkage_results")
    return parser


def command_line() -> None:
    """Run what the command line asks for and print the outcome."""
    parser = _parser()
    arguments = vars(parser.parse_args())
    try:
        result = main(**arguments)
    except ValueError as error:  # InputError is one
        parser.error(str(error))
    energy = result["energy"]
    print(f"six-body linkage: {arguments['integrator']}, {arguments['treatment']}")
    print(f"  n = {result['n']}, {result['m_rows']} constraint rows of rank {result['rank']}")
    print(f"  {result['unknowns']} unknowns", end="")
    print(f", {len(result['times']) - 1} steps, {result['newton_iterations'].sum()} iterations")
    print(f"  P3 at the end {np.round(result['P3'][-1], 6).tolist()} m")
    print(f"  energy between {energy.min():.9g} and {energy.max():.9g} J", end="")
    print(f", closed form fulfilled to {result['closure'].max():.3g}")
    if result["diverged_at"] is not None:
        print(f"  diverged at {result['diverged_at']:.6g} s: {result['divergence_reason']}")
    print(f"open {Path(arguments['out']) / 'bodies.pvd'} (and joints.pvd) in ParaView")


if __name__ == "__main__":
    command_line()
