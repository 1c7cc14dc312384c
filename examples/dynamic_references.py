"""Three flexible problems in space and time, orders 1 to 4, against reference solutions.

D1, a rubber rod that swings down from its hinge; D2, the right-angle cantilever of Simo & Vu-Quoc
(1988); D3, a free rod that is thrown and spun, the "flying spaghetti" in space. The numbers to
reach are in tests/data/dynamic_references.json, with their origin. Three questions:

*Orders.* With the loads as given waves start at t = 0 and wherever the load has a kink, and no
derivative of the solution exists beyond some order: neither elements of high order nor a step
above the period of the fastest wave then show their order. Ramped smoothly, the same scenes show
2 p in space (two meshes against a finer one, all with the same step, so that the error in time
drops out) and 2 in time (the same mesh, steps halved).

*Errors with the loads as given*, of the limit of vanishing step: the error of both integrators has
even powers of h only, which Richardson extrapolation takes away, as kinks fall on ends of steps.

*Trusted digits*: the finest runs beside the uncertainty of the reference, and the energies that
stay constant after the loads have ended.

D3 is given with the inertia 10 about all three axes of the section. A plane section has the sum of
the other two about its normal, so 5 along each of d1, d2 and, which no plane section has, d3:
:class:`SolidBeam` adds that one.

Writes three tables and, where matplotlib is there, a chart; half an hour on one core, with --quick
one. All units SI. Run ``python examples/dynamic_references.py --help`` for the choices.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: small matrices

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc

sys.path.insert(0, str(Path(__file__).resolve().parent))

import dynamic_report
import paper_record

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.export import prepare_folder
from skfem_cosserat.kernels import rotation_matrix

Floats = NDArray[np.float64]

HERE = Path(__file__).resolve().parent
DATA = HERE.parent / "tests" / "data" / "dynamic_references.json"
INTEGRATORS = {"variational": sc.Variational, "energy-momentum": sc.EnergyMomentum}
ORDERS = (1, 2, 3, 4)


# -- scenes ----------------------------------------------------------------------------------------


class SolidBeam(sc.Beam):
    """A beam with inertia along d3 too.

    Parameters
    ----------
    third : float
        ``M_rho^3`` (kg m); the rest as for :class:`skfem_cosserat.Beam`.
    """

    def __init__(self, *args: Any, third: float, **options: Any) -> None:
        super().__init__(*args, **options)
        self.third = third

    def scalar_mass(self) -> Floats:
        """With the blocks of d3."""
        mass = super().scalar_mass()
        rows = 4 * np.arange(self.basis.order + 1) + 3
        mass[:, rows[:, None], rows] += self.third * self.basis.elemental_mass()
        return mass


class Scene(NamedTuple):
    """A frozen scene, and the places in it whose motion is compared."""

    system: sc.System
    places: dict[str, Any]

    @property
    def frames(self) -> NDArray[np.int64]:
        """Where the places' frames begin in q."""
        return np.array([self.system.offset(place) for place in self.places.values()])

    def positions(self, q: Floats) -> Floats:
        """(N, k, 3) of configurations (N, n), in m."""
        return q[:, self.frames[:, None] + np.arange(3)]

    def rotations(self, q: Floats) -> Floats:
        """(N, k, 3, 3): matrices that turn the reference triads into those of configurations."""
        now, start = (
            np.reshape(x, (-1, x.shape[-1]))[:, self.frames[:, None] + np.arange(3, 12)]
            for x in (q, self.system.q0)
        )
        shape = (-1, len(self.places), 3, 3)
        return np.einsum("nkij,kil->nkjl", now.reshape(shape), start.reshape(shape)[0])


def bump(peak: float, until: float) -> sc.FunctionOfTime:
    """``peak (4 x (1 - x))^6``, x = t/until: five derivatives vanish at both ends."""
    return sc.FunctionOfTime(
        lambda t: peak * (4 * t / until * (1 - t / until)) ** 6 if 0 < t < until else 0.0,
        kinks=(0.0, until),
    )


def rise(until: float) -> sc.FunctionOfTime:
    """From 0 to 1, five derivatives vanish at both ends."""
    return sc.FunctionOfTime(
        lambda t: float(betainc(6, 6, min(max(t / until, 0.0), 1.0))), kinks=(0.0, until)
    )


def pendulum(elements: int, order: int, smooth: bool = False) -> Scene:
    """D1: gravity is there at once, or rises within 0.2 s."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
    section = sc.SectionCircle(5e-3, sc.Material(E=5e6, nu=0.5, rho=1100), shear_factor=1.0)
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 1, 0)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    model.add("gravity", sc.LoadGravity((0, -9.81, 0), rise(0.2) if smooth else None))
    return Scene(model.freeze(), {"tip": rod.node("rod.end")})


def cantilever(elements: int, order: int, smooth: bool = False) -> Scene:
    """D2, elements in each leg: a triangle of 2 s and 50 N, or a bump of 4 s."""
    corners = [(0, 0, 0), (10, 0, 0), (10, 10, 0)]
    mesh = sc.MeshCurve.init_polyline(corners, elements, name="frame", nodes={"elbow": 0.5})
    section = sc.Section([1e6, 1e6, 1e6, 1e3, 1e3, 1e3], mass=1.0, inertia=(10.0, 10.0))
    model = sc.Model()
    frame = model.add("frame", sc.Beam(mesh, section, order=order, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), frame.node("frame.start")))
    pulse = bump(50.0, 4.0) if smooth else sc.Table([0, 1, 2], [0, 50, 0])
    model.add("force", sc.LoadForce(frame.node("elbow"), (0, 0, 1), pulse))
    return Scene(model.freeze(), {"elbow": frame.node("elbow"), "tip": frame.node("frame.end")})


def spaghetti(elements: int, order: int, smooth: bool = False) -> Scene:
    """D3: a triangle or a bump of 5 s; an even number of elements."""
    mesh = sc.MeshCurve.init_line((6, 0, 0), (0, 8, 0), elements, name="rod", nodes={"mid": 0.5})
    section = sc.Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(5.0, 5.0))
    model = sc.Model()
    beam = SolidBeam(mesh, section, order=order, director=(0, 0, 1), third=5.0)
    rod = model.add("rod", beam)
    start = rod.node("rod.start")
    pulse = bump(200.0, 5.0) if smooth else sc.Table([0, 2.5, 5], [0, 200, 0])
    model.add("force", sc.LoadForce(start, (0.1, 0, 0), pulse))
    model.add("moment", sc.LoadMoment(start, (0, 0.5, 1), pulse))
    return Scene(
        model.freeze(), {"loaded": start, "mid": rod.node("mid"), "free": rod.node("rod.end")}
    )


SCENES = {"D1": pendulum, "D2": cantilever, "D3": spaghetti}


# -- reference, runs and limits --------------------------------------------------------------------


class Reference(NamedTuple):
    """What is to be reached at times (T,): None where the reference has no such numbers.

    ``positions`` (T, k, 3), ``rotations`` (T, k, 3, 3), ``velocities`` (T, k, 3), ``energy`` and
    ``uncertainty`` (T,).
    """

    times: Floats
    positions: Floats
    rotations: Floats | None
    velocities: Floats | None
    energy: Floats | None
    uncertainty: Floats

    @classmethod
    def load(cls, name: str, until: float = np.inf) -> Reference:
        """That of a scene, up to a time (s)."""
        entry = json.loads(DATA.read_text())[name]
        which = np.flatnonzero(np.array(entry["t"]) <= until)

        def table(key: str) -> Floats | None:
            return np.array(entry[key], dtype=float)[which] if key in entry else None

        def in_space(key: str) -> Any:
            value = table(key)
            if value is None or value.shape[-1] == 3:
                return value
            return np.concatenate([value, np.zeros((*value.shape[:-1], 1))], axis=-1)

        quaternions = table("quaternion")
        return cls(
            times=np.array(entry["t"])[which],
            positions=in_space("position"),
            rotations=None if quaternions is None else rotation_matrix(quaternions),
            velocities=in_space("velocity"),
            energy=table("energy"),
            uncertainty=np.array(entry["uncertainty"])[which],
        )


class Motion(NamedTuple):
    """Positions, rotations and velocities of a scene's places, and the energy, at some times."""

    positions: Floats
    rotations: Floats
    velocities: Floats
    energy: Floats

    @property
    def placement(self) -> Floats:
        """Positions and rotations at the last time, in one row."""
        return np.concatenate([self.positions[-1].ravel(), self.rotations[-1].ravel()])


def motion(
    scene: Scene, integrator: str, step: float, times: Sequence[float], treatment: Any = None
) -> Motion:
    """A run from rest, seen at times (s) that are ends of steps.

    The energy is kinetic plus stored energy at (q, p), which energy-momentum conserves; with the
    variational integrator at (q, Qp): what the constraints take out of its nodal p, of second
    order in the step, grows with the number of elements.
    """
    wanted = np.asarray(times, dtype=float)
    if abs(np.rint(wanted / step) * step - wanted).max() > 1e-9:
        raise ValueError(f"step = {step!r} does not divide the times {wanted.tolist()}")
    system = scene.system
    history = sc.simulate(
        system,
        INTEGRATORS[integrator](),
        sc.NullSpace() if treatment is None else treatment,
        step,
        float(wanted[-1]),
        at=wanted.tolist(),
        derive=False,
    )
    rows = np.searchsorted(history.times, wanted - 0.5 * step)
    q, p = history["q"][rows], history["p"][rows]
    v, projected = sc.Projection(system).stack(q, p, history.times[rows])
    carried = projected if integrator == "variational" else p
    energy = diagnostics.kinetic_energy(system, carried) + diagnostics.strain_energy(system, q)
    return Motion(scene.positions(q), scene.rotations(q), scene.positions(v), energy)


def limit(steps: Sequence[float], motions: Sequence[Motion]) -> Motion:
    """Limit of vanishing step of runs whose error has even powers of the step (Neville)."""
    values: list[tuple[Floats, ...]] = list(motions)
    for k in range(1, len(values)):
        ratios = [(steps[i] / steps[i + k]) ** 2 for i in range(len(values) - 1)]
        values = [
            tuple(y + (y - x) / (r - 1) for x, y in zip(a, b, strict=True))
            for (a, b), r in zip(pairwise(values), ratios, strict=True)
        ]
    return Motion(*values[0])


def errors(result: Motion, reference: Reference) -> dict[str, Floats]:
    """Norms (T,) over all places of the differences in what the reference has."""
    pairs = {
        "position": (result.positions, reference.positions),
        "rotation": (result.rotations, reference.rotations),
        "velocity": (result.velocities, reference.velocities),
        "energy": (result.energy, reference.energy),
    }
    return {
        name: np.linalg.norm((a - b).reshape(len(a), -1), axis=1)
        for name, (a, b) in pairs.items()
        if b is not None
    }


def slopes(x: Iterable[float], error: Iterable[float]) -> list[float]:
    """Observed orders between neighbours; x is proportional to the size of steps or elements."""
    logs = np.log(np.array(list(x))), np.log(np.array(list(error)))
    return list(np.diff(logs[1]) / np.diff(logs[0]))


# -- studies ---------------------------------------------------------------------------------------

#: orders in space, smooth loads: step (s), time (s), elements for each order, mesh to compare with
SPACE: dict[str, tuple[float, float, dict[int, tuple[int, ...]], tuple[int, int]]] = {
    "D1": (
        *(0.01, 0.2),
        {1: (32, 64, 128), 2: (16, 32, 64), 3: (8, 16, 32), 4: (8, 16, 24)},
        (36, 4),
    ),
    "D2": (0.1, 4.0, {1: (8, 16, 32), 2: (4, 8, 16), 3: (3, 6, 12), 4: (4, 8, 12)}, (20, 4)),
    "D3": (0.05, 2.5, {1: (32, 64, 128), 2: (8, 16, 32), 3: (4, 8, 16), 4: (2, 4, 12)}, (24, 4)),
}
#: orders in time, smooth loads: first step (s), time (s), elements for each order
TIME: dict[str, tuple[float, float, dict[int, int]]] = {
    "D1": (1 / 400, 0.2, {1: 32, 2: 16, 3: 8, 4: 8}),
    "D2": (1 / 20, 2.0, {1: 8, 2: 4, 3: 3, 4: 2}),
    "D3": (1 / 20, 2.5, {1: 16, 2: 8, 3: 6, 4: 4}),
}
#: loads as given: steps (s), time (s), elements for each order
GIVEN: dict[str, tuple[tuple[float, ...], float, dict[int, tuple[int, ...]]]] = {
    "D1": ((1 / 6400,), 0.2, {1: (32, 64, 128), 2: (16, 32, 64), 3: (8, 16, 32), 4: (8, 16, 32)}),
    "D2": (
        (1 / 160, 1 / 320, 1 / 640),
        2.0,
        {1: (16, 32, 64), 2: (4, 8, 16, 32), 3: (2, 4, 8, 16), 4: (1, 2, 4, 8)},
    ),
    "D3": (
        (1 / 320, 1 / 640),
        3.0,
        {1: (32, 64, 128), 2: (8, 16, 32, 64), 3: (4, 8, 16, 32), 4: (4, 8, 16, 32)},
    ),
}
#: finest runs: order, elements, steps (s), time (s)
FINEST: dict[str, tuple[int, int, tuple[float, ...], float]] = {
    "D1": (4, 32, (1 / 12800,), 0.3),
    "D2": (4, 16, (1 / 320, 1 / 640), 3.0),
    "D3": (4, 32, (1 / 640, 1 / 1280), 6.0),
}


def order_in_space(name: str, integrator: str, meshes: int = 3, refine: int = 1) -> dict[int, Any]:
    """Errors of placements, velocities and energy with smooth loads, all runs with one step.

    Parameters
    ----------
    name : {"D1", "D2", "D3"}
    integrator : {"variational", "energy-momentum"}
    meshes : int
        The finest 2 or 3 of SPACE.
    refine : int
        Divides the step.

    Returns
    -------
    dict
        By order: ``elements``, ``error`` (m and -), ``velocity`` (m/s) and ``energy`` (J).
    """
    step, until, elements, (fine, highest) = SPACE[name]
    build = SCENES[name]

    def run(count: int, order: int) -> Motion:
        return motion(build(count, order, smooth=True), integrator, step / refine, [until])

    best = run(fine, highest)
    result = {}
    for order, counts in elements.items():
        used = counts[-meshes:]
        runs = [run(count, order) for count in used]
        result[order] = {
            "elements": used,
            "error": [float(np.linalg.norm(m.placement - best.placement)) for m in runs],
            "velocity": [float(np.linalg.norm(m.velocities - best.velocities)) for m in runs],
            "energy": [float(abs(m.energy - best.energy).max()) for m in runs],
        }
    return result


def order_in_time(
    name: str, integrator: str, levels: int = 4, orders: Sequence[int] = ORDERS
) -> dict[int, Any]:
    """Errors of placements, velocities and energy against the limit of vanishing step.

    Parameters
    ----------
    name, integrator
        As for :func:`order_in_space`.
    levels : int
        Steps, each half of the one before.
    orders : sequence of int
        Of the elements.

    Returns
    -------
    dict
        By order: ``steps`` (s), ``error``, ``velocity`` and ``energy``.
    """
    first, until, elements = TIME[name]
    steps = [first / 2**k for k in range(levels)]
    result = {}
    for order in orders:
        scene = SCENES[name](elements[order], order, smooth=True)
        runs = [motion(scene, integrator, step, [until]) for step in steps]
        best = limit(steps, runs)
        result[order] = {
            "steps": steps,
            "error": [float(np.linalg.norm(m.placement - best.placement)) for m in runs],
            "velocity": [float(np.linalg.norm(m.velocities - best.velocities)) for m in runs],
            "energy": [float(abs(m.energy - best.energy).max()) for m in runs],
        }
    return result


def as_given(
    name: str, integrator: str, order: int, count: int, steps: Sequence[float], until: float
) -> dict[str, Any]:
    """Errors against the reference, loads as given, of the limit of runs with some steps (s).

    Returns
    -------
    dict
        ``order``, ``elements`` and ``steps``; ``times`` and ``uncertainty`` (T,) of the reference,
        and (T,) of each of :func:`errors`.
    """
    reference = Reference.load(name, until)
    scene = SCENES[name](count, order)
    runs = [motion(scene, integrator, step, reference.times) for step in steps]
    found = errors(limit(steps, runs), reference)
    mesh = {"order": order, "elements": count, "steps": tuple(steps)}
    return {**mesh, "times": reference.times, "uncertainty": reference.uncertainty, **found}


def main(quick: bool = True, out: str | Path | None = None) -> dict[str, Any]:
    """Orders in space and time, errors with the loads as given, finest runs.

    Parameters
    ----------
    quick : bool
        Fewer meshes and steps, and none of the finest runs.
    out : path, optional
        Folder for the tables and the chart; None: nothing is written.

    Returns
    -------
    dict
        ``space`` and ``time`` by (scene, integrator), see :func:`order_in_space` and
        :func:`order_in_time`; ``given`` by (scene, order), with energy-momentum: ``elements``,
        ``until`` (s) and ``error``, the largest of positions up to then (m); ``finest`` by (scene,
        integrator), see :func:`as_given`; ``uncertainty`` (m) by scene: the reference's own, up to
        the time of ``given``; ``paths`` written.
    """
    if out is not None:
        prepare_folder(Path(out))  # before minutes of work, not after them
    record = paper_record.Record()
    result: dict[str, Any] = {"space": {}, "time": {}, "given": {}, "finest": {}, "uncertainty": {}}
    title = f"dynamic references{', quick' if quick else ''}"
    with record.run(title) as number:
        for name in SCENES:
            for integrator in INTEGRATORS:
                key = (name, integrator)
                result["space"][key] = order_in_space(name, integrator, 2 if quick else 3)
                result["time"][key] = order_in_time(name, integrator, 3 if quick else 4)
                if not quick:
                    result["finest"][key] = as_given(name, integrator, *FINEST[name])
            _sweep(name, quick, result)
    if out is not None:
        result["paths"] = dynamic_report.main(result, Path(out), record, number)
    return result


def _sweep(name: str, quick: bool, result: dict[str, Any]) -> None:
    """Meshes with the loads as given."""
    steps, until, elements = GIVEN[name]
    if quick:
        steps = tuple(8 * h for h in steps)
    for order, counts in elements.items():
        used = counts[:2] if quick else counts
        runs = [as_given(name, "energy-momentum", order, n, steps, until) for n in used]
        result["given"][name, order] = {
            "elements": used,
            "until": until,
            "error": [float(run["position"].max()) for run in runs],
        }
        result["uncertainty"][name] = float(runs[0]["uncertainty"].max())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="coarser, without the finest runs")
    parser.add_argument("--out", default=str(HERE / "pictures"), help="folder for all files")
    parser.add_argument("--json", action="store_true", help="print all numbers as JSON")
    arguments = parser.parse_args()
    made = main(arguments.quick, arguments.out)
    if arguments.json:
        print(json.dumps(dynamic_report.plain(made), indent=1))
    else:
        print("\n".join(dynamic_report.lines(made)))
