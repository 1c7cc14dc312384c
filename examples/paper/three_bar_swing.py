"""The three-bar swing of Leyendecker, Marsden & Ortiz, ZAMM 88 (2008) 677, section 6.2.

A flexible beam with a mass at mid-span hangs by revolute joints on two rigid links, which hang on
spherical joints; a triangular pulse pushes the mass. Frame: e1 out of the plane of motion, the
beam from (0, 0, 0) to (0, 0.72, 0). All units SI.

Three sections: *published* takes the paper's constants with its labels as they stand (the director
in the plane of motion carries 1.5625 kg m), *physical* those of the real rectangle (0.1406 kg m),
*stiff* the aluminium strip of the problem's first appearance (Bauchau & Bottasso, Nonlinear Dyn.
20 (1999) 71); its mass 0.5 kg and its pulse of 2 N at 0.128 s are quoted from memory.

Run ``python examples/three_bar_swing.py --help`` for the choices.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.export import prepare_folder
from skfem_cosserat.run import derive_series

MESH = Path(__file__).resolve().parents[2] / "meshes" / "three_bar_swing.msh"
SPAN, HEIGHT = 0.72, 0.36
E1 = (1.0, 0.0, 0.0)

INTEGRATORS = {"variational": sc.Variational, "energy-momentum": sc.EnergyMomentum}
TREATMENTS = {"null-space": sc.NullSpace, "multipliers": sc.Multipliers}
#: constants printed in the paper; shear, axial (N), bending about d1 and d2, torsion (N m^2)
STIFFNESS = (175480.7692, 175480.7692, 547500.0, 114.0625, 10.2656, 13.7401)
#: inertia (kg m) along d1 (in the plane of motion) and d2 (parallel to e1)
INERTIA = {"published": (1.5625, 0.1406), "physical": (0.1406, 1.5625)}
#: mid mass (kg), end of the pulse (s), its peak (N)
PULSE = {
    "published": (5.0, 0.25, 1e4),
    "physical": (5.0, 0.25, 1e4),
    "stiff": (0.5, 0.256, 2.0),
}
#: steps whose median is the condition number, for h >= 1e-2 and below
CONDITION_STEPS = ((1, 10, 50, 100, 140, 146, 160, 200), (1, 10, 100, 200))


def _section(name: str, factor: float) -> sc.Section:
    if name == "stiff":  # 1 mm in the plane of motion, 5 mm out of it
        return sc.SectionRectangle(1e-3, 5e-3, sc.Material(factor * 73e9, 0.3, 2700.0))
    a, b = 0.015, 0.05
    outline = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (a / 2, b / 2)
    with warnings.catch_warnings():  # the published inertia is that about the axes: as printed
        warnings.simplefilter("ignore", sc.ModelWarning)
        return sc.Section(factor * np.array(STIFFNESS), 7500.0, INERTIA[name], outline)


def choose(name: str, value: str, choices: dict[str, Any]) -> Any:
    """One of the choices, or an error that lists them."""
    if not isinstance(value, str) or value not in choices:
        raise ValueError(f"{name} = {value!r}, expected one of {sorted(choices)}")
    return choices[value]


def _mesh(elements: int) -> sc.MeshCurve:
    if not isinstance(elements, int | np.integer) or elements < 2 or elements % 2:
        raise ValueError(f"elements = {elements!r}, expected an even number of at least 2")
    if elements == 20:
        return sc.read_mesh(MESH)
    ends = ((0.0, 0.0, 0.0), (0.0, SPAN, 0.0))
    names = {"left": 0.0, "mid": 0.5, "right": 1.0}
    return sc.MeshCurve.init_line(*ends, int(elements), name="beam", nodes=names)


def build(*args: Any, **options: Any) -> sc.System:
    """The scene of :func:`scene`, frozen."""
    return scene(*args, **options).freeze()


def scene(
    section: str = "published",
    elements: int = 20,
    rotation: NDArray[np.float64] | None = None,
    side_load: float = 0.0,
    mesh: sc.MeshCurve | None = None,
    order: int = 1,
    factor: float = 1.0,
    lumped: bool = False,
    theory: sc.Theory | None = None,
) -> sc.Model:
    """The scene.

    Parameters
    ----------
    section : {"published", "physical", "stiff"}
    elements : int
        Even number of linear beam elements.
    rotation : (3, 3) array, optional
        Turns the whole scene about the origin.
    side_load : float
        Fraction of the pulse that acts out of the plane, along e1.
    mesh : MeshCurve, optional
        Of the beam, with the nodes left, mid and right; instead of `elements`.
    order : int
        Of the elements.
    factor : float
        Of the beam's stiffness: smaller ones make it softer.
    lumped : bool
        Masses of the beam at its nodes.
    theory : Theory, optional
        Which of the beam's strains are modelled; default: all.
    """
    mass, end, peak = choose("section", section, PULSE)
    Q = np.eye(3) if rotation is None else np.asarray(rotation, dtype=float)
    mesh = _mesh(elements) if mesh is None else mesh
    if rotation is not None:
        mesh = mesh.moved(rotation=Q)
    model = sc.Model()
    director = Q @ (0.0, 0.0, 1.0)
    profile = _section(section, factor)
    kind = sc.Beam(mesh, profile, order=order, director=director, lumped=lumped, theory=theory)
    beam = model.add("beam", kind)
    axis = Q @ E1
    ends = {
        "left": ((0.0, 0.0, 0.0), (0.0, 0.0, HEIGHT)),
        "right": ((0.0, SPAN, 0.0), (0.0, SPAN + HEIGHT, HEIGHT)),
    }
    for side, pair in ends.items():
        low, high = (Q @ x for x in pair)
        length = float(np.linalg.norm(high - low))
        link = model.add(
            f"{side} link",
            sc.RigidBody.pyramid(
                0.01,
                edge=0.02,
                height=length,
                position=low + (high - low) / 4,
                triad=sc.triad(high - low, axis),
            ),
        )
        model.add(f"{side} hinge", sc.JointRevolute(link.at(low), beam.node(side), axis))
        model.add(f"{side} support", sc.JointSpherical(sc.ground(high), link.at(high)))
    model.add("mass", sc.MassPoint(mass, on=beam.node("mid")))
    pulse = sc.Table([0.0, end / 2, end], [0.0, peak, 0.0])
    model.add("pulse", sc.LoadForce(beam.node("mid"), Q @ (side_load, 1.0, 0.0), pulse))
    return model


def main(
    integrator: str = "variational",
    treatment: str = "null-space",
    step: float = 1e-2,
    until: float = 2.0,
    section: str = "published",
    elements: int = 20,
    out: str | Path | None = None,
) -> dict[str, Any]:
    """Run the swing; returns the quantities of the paper's figures.

    Parameters
    ----------
    integrator : {"variational", "energy-momentum"}
    treatment : {"null-space", "multipliers"}
    step, until : float
        Step size and end time (s).
    section : {"published", "physical", "stiff"}
    elements : int
        Even.
    out : path, optional
        Folder for the history, the ParaView files and charts; None: nothing is written.

    Returns
    -------
    dict
        Arrays over the N stored states, and numbers; a diverging run returns what it has, with
        ``diverged_at`` and ``divergence_reason``.
    """
    chosen = choose("integrator", integrator, INTEGRATORS)()
    constraints = choose("treatment", treatment, TREATMENTS)()
    system = build(section, elements)
    if out is not None:
        prepare_folder(Path(out))  # before the run, not after it
    history, reason = run(system, chosen, constraints, step, until, PULSE[section][1])
    result = evaluate(system, history)
    result["diverged_at"] = float(history.times[-1]) if reason else None
    result["divergence_reason"] = reason
    if out is not None:
        write(system, history, Path(out), PULSE[section][1])
    return result


def run(
    system: sc.System,
    integrator: Any,
    treatment: Any,
    step: float,
    until: float,
    pulse_end: float,
) -> tuple[sc.History, str | None]:
    """History, and why it ended early: a failed step, or ten times the energy after the pulse."""
    guard = _EnergyGuard(system, pulse_end)
    reason = None
    with warnings.catch_warnings():
        # that energy blows up is judged here, and told by the reason
        warnings.filterwarnings("ignore", "balance of energy", sc.AccuracyWarning)
        try:
            history = sc.simulate(
                system, integrator, treatment, step, until, callbacks=[guard], derive=False
            )
        except sc.Diverged as error:
            history, reason = error.history, str(error)
    energy = _energy(system, history["q"], history["p"])
    after = np.flatnonzero(history.times >= pulse_end * (1 - 1e-12))
    if len(after):
        above = after[energy[after] > 10 * energy[after[0]]]
        if len(above):
            reason = (
                f"the energy {energy[above[0]]:.6g} J exceeded 10 times its value just after the"
                f" pulse, {energy[after[0]]:.6g} J"
            )
            history = history.truncated(int(above[0]) + 1)
    return history, reason


class _EnergyGuard:
    """Ends a run that blows up; looked at every 20 steps, which costs next to nothing."""

    def __init__(self, system: sc.System, pulse_end: float) -> None:
        self.system, self.pulse_end = system, pulse_end
        self.limit: float | None = None

    def __call__(self, report: Any) -> bool:
        state = report.state
        if state.time < self.pulse_end * (1 - 1e-12):
            return False
        if self.limit is not None and state.index % 20:
            return False
        energy = float(_energy(self.system, state.q, state.p))
        if self.limit is None:  # the momentum is not the nodal one: leave a margin
            self.limit = 40 * energy
        return not energy < self.limit


def _energy(system: sc.System, q: Any, p: Any) -> NDArray[np.float64]:
    with np.errstate(over="ignore", invalid="ignore"):
        return diagnostics.kinetic_energy(system, p) + diagnostics.strain_energy(system, q)


def evaluate(system: sc.System, history: sc.History) -> dict[str, Any]:
    """The quantities of the paper's figures from a history."""
    q, p, t = history["q"], history["p"], history.times
    step = history.meta["step"]
    projected = sc.Projection(system).stack(q, p, t)[1]
    strain = diagnostics.strain_energy(system, q)
    mean = history.meta["integrator"] == "energy-momentum"
    angle = _link_angle(system, history)
    beam: Any = system.structures[0]
    forces = diagnostics.section_forces(system, beam, q)
    number = len(beam.elements.lengths) // 2
    return {
        "times": t,
        "mass_position": history.position(beam.node("mid")),
        "link_angle": angle,
        "energy": diagnostics.kinetic_energy(system, p) + strain,
        "energy_projected": diagnostics.kinetic_energy(system, projected) + strain,
        "energy_midpoint": diagnostics.midpoint_energy(system, q, step, mean),
        "angular_momentum": diagnostics.angular_momentum(system, q, p),
        "angular_momentum_projected": diagnostics.angular_momentum(system, q, projected),
        "angular_momentum_midpoint": diagnostics.midpoint_angular_momentum(system, q, step),
        "axial_force": forces[:, number, 0, 2],
        "bending_moment": _spatial_moment(beam, history, forces, number),
        "unknowns": history.meta["unknowns"],
        "n": system.n,
        "m": system.m,
        "newton_iterations": np.asarray(history["newton_iterations"][1:], dtype=int),
        "constraint_violation": diagnostics.constraint_violation(system, q, t),
        "event_x": _event_x(t, angle),
        "kernels": history.meta["kernels"],
    }


def _link_angle(system: sc.System, history: sc.History) -> NDArray[np.float64]:
    """Angle of the right link from its start about +e1, unwrapped."""
    link: Any = next(item for item in system.structures if item.name == "right link")
    d3 = history.rotation(link.local((0, 0, 0)))[:, 2]
    angle = np.unwrap(np.arctan2(d3[:, 2], d3[:, 1]))
    return angle - angle[0]


def _spatial_moment(
    beam: Any, history: sc.History, forces: NDArray[np.float64], e: int
) -> NDArray[np.float64]:
    """``e1 . sum M_i d_i`` in the middle of element e."""
    shape = beam.basis.shape(beam.elements.points)[:, 0]
    nodes = beam.basis.connectivity[e]
    frames = np.array([history.rotation(beam.node(int(a))) for a in nodes])
    directors = np.einsum("a,anij->nij", shape, frames)
    return np.einsum("ni,ni->n", forces[:, e, 0, 3:], directors[:, :, 0])


def _event_x(t: NDArray[np.float64], angle: NDArray[np.float64]) -> float | None:
    """First time after 0.3 s at which the link turns back, by a parabola through three states."""
    turn = np.sign(np.diff(angle))
    for i in range(1, len(turn)):
        if turn[i] == 0:
            turn[i] = turn[i - 1]  # a standstill is no reversal yet
    for i in np.flatnonzero(turn[1:] * turn[:-1] < 0) + 1:
        step = t[i + 1] - t[i]
        before, after = angle[i] - angle[i - 1], angle[i + 1] - angle[i]
        time = t[i] - step * (after + before) / (2 * (after - before))
        if time > 0.3:
            return float(time)
    return None


def condition_number(
    integrator: str,
    treatment: str,
    step: float,
    scaled: bool = False,
    section: str = "published",
    elements: int = 20,
    steps: Any = None,
) -> float:
    """Median 2-norm condition number of the iteration matrix over some steps.

    Parameters
    ----------
    scaled : bool
        Of the matrix that is actually factorised, where multipliers are scaled.
    steps : sequence of int, optional
        Step numbers; default: 1, 10, 50, 100, 140, 146, 160, 200 for steps of 1e-2 and above,
        1, 10, 100, 200 below. At the converged state of each step, SI units, massless rows kept.
        Steps after one that cannot be solved are left out; NaN if none is left.
    """
    default = CONDITION_STEPS[0 if step > 5e-3 else 1]
    scene = build(section, elements)
    numbers = default if steps is None else steps
    return median_condition_number(scene, integrator, treatment, step, scaled, numbers)


def median_condition_number(
    system: sc.System, integrator: str, treatment: str, step: float, scaled: bool, steps: Any
) -> float:
    """Median 2-norm condition number over the steps with these numbers; NaN if none is solved."""
    chosen = choose("integrator", integrator, INTEGRATORS)()
    constraints = choose("treatment", treatment, TREATMENTS)()
    if (
        isinstance(steps, str)
        or not np.iterable(steps)
        or not (numbers := list(steps))
        or not all(isinstance(k, int | np.integer) and k >= 1 for k in numbers)
    ):
        raise ValueError(f"steps = {steps!r}, expected positive step numbers")
    stepper = sc.Stepper(system, chosen, constraints, step)
    state = sc.initial_state(system)
    values = []
    try:
        for number in range(1, max(numbers) + 1):
            if number in numbers:
                matrix, report = stepper.iteration_matrix(state, scaled)
                values.append(np.linalg.cond(matrix))
            else:
                report = stepper.advance(state)
            state = report.state
    except sc.Diverged:  # the median of the steps that could be solved
        if not values:
            return float("nan")
    return float(np.median(values))


def write(system: sc.System, history: sc.History, folder: Path, pulse_end: float) -> list[Path]:
    """History, ParaView files and, where matplotlib is installed, charts."""
    from skfem_cosserat.export import write_paraview

    derive_series(system, history)
    paths = write_paraview(history, folder, surfaces=True)
    history.save(folder / "three_bar_swing.history")
    try:
        from skfem_cosserat.plot import plot_energy, plot_orbit

        names = "kinetic", "strain_energy", "energy", "energy_midpoint"
        plot_energy(history, folder / "energy.png", names, since=pulse_end)
        beam: Any = system.structures[0]
        mid = beam.node("mid").vertex
        plot_orbit(history, f"beam/beam/{mid}", folder / "orbit.png", axes="yz")
    except ImportError:
        pass  # charts come with the extra "view"
    return paths


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--integrator", default="variational", choices=sorted(INTEGRATORS))
    parser.add_argument("--treatment", default="null-space", choices=sorted(TREATMENTS))
    parser.add_argument("--step", type=float, default=1e-2)
    parser.add_argument("--until", type=float, default=2.0)
    parser.add_argument("--section", default="published", choices=sorted(PULSE))
    parser.add_argument("--elements", type=int, default=20)
    parser.add_argument("--out", default="three_bar_swing_results")
    return parser


def command_line() -> None:
    """Run what the command line asks for and print the outcome."""
    arguments = vars(_parser().parse_args())
    result = main(**arguments)
    energy = result["energy"]
    print(f"three-bar swing: {arguments['integrator']}, {arguments['treatment']}")
    print(f"  n = {result['n']}, m = {result['m']}, unknowns = {result['unknowns']}")
    print(f"  {len(result['times']) - 1} steps, {result['newton_iterations'].sum()} iterations")
    print(f"  energy at the end {energy[-1]:.6g} J, event X at {result['event_x']} s")
    if result["diverged_at"] is not None:
        print(f"  diverged at {result['diverged_at']:.6g} s: {result['divergence_reason']}")
    print(f"open {Path(arguments['out']) / 'beams.pvd'} (and bodies.pvd, joints.pvd) in ParaView")


if __name__ == "__main__":
    command_line()
