"""What forces that see the motion add to a run: servos, obstacles and laws of one's own.

Each scene runs with the force and without it, in turns in one process, compiled; all states are
recorded, as by default. A row has the median of the CPU times of a step, and of their ratios; the
last one is the ratio where two states alone are recorded. Writes ``force_cost.csv`` with versions
and machine.

Run ``python examples/benchmarks/force_cost.py --help`` for the choices.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

import measuring  # before numpy: one thread
import numpy as np

import skfem_cosserat as sc

STEP = 1e-3
COLUMNS = (
    "force",
    "beside",
    "us",
    "us_without",
    "ratio",
    "iterations",
    "iterations_without",
    "ratio_unrecorded",
)
ALUMINIUM = sc.Material(E=70e9, nu=0.3, rho=2700)
SOFT = sc.SectionCircle(0.01, sc.Material(E=1e7, nu=0.3, rho=1000))


def arm(make: Callable[[sc.Joint], Any]) -> sc.System:
    """A tube of 1 m, 8 elements, on a hinge, and what acts on that."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 8, name="arm")
    tube = sc.SectionTube(0.02, 0.018, ALUMINIUM)
    beam = model.add("arm", sc.Beam(mesh, tube, director=(0, 0, 1)))
    foot = sc.ground((0, 0, 0)), beam.node("arm.start")
    hinge = model.add("hinge", sc.JointRevolute(*foot, axis=(0, 0, 1)))
    model.add("force", make(hinge))
    return model.freeze()


def falling(make: Callable[[Any], Any] | None = None) -> sc.System:
    """A soft rod of 20 nodes that falls from 2 cm, and what it touches or what slows it down."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0.02), (1, 0, 0.02), 19, name="rod")
    rod = model.add("rod", sc.Beam(mesh, SOFT, director=(0, 0, 1), velocity=(0, 0.5, 0)))
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    if make is not None:
        model.add("force", make(rod))
    return model.freeze()


def drag(x: Any, v: Any, t: float) -> Any:
    """Of the air, at n places."""
    return -0.05 * v * np.sqrt((v * v).sum(-1, keepdims=True) + 1e-8)


def compiled_drag() -> Any:
    """The same for numba."""
    from numba import njit

    def law(x: Any, v: Any, t: float) -> Any:
        out = np.empty_like(v)
        for k in range(len(v)):
            speed = np.sqrt(v[k, 0] ** 2 + v[k, 1] ** 2 + v[k, 2] ** 2 + 1e-8)
            for i in range(3):
                out[k, i] = -0.05 * speed * v[k, i]
        return out

    return njit(law)


def on_nodes(law: Any) -> sc.System:
    """The rod with a law at each node."""
    return falling(lambda rod: sc.Force([rod.node(k) for k in range(20)], law, each=True))


def touching(surface: Any, **options: Any) -> sc.System:
    """The rod on an obstacle."""
    return falling(lambda rod: sc.Obstacle(surface, rod, stiffness=2e4, **options))


def spring() -> sc.System:
    """The arm on a spring with its damper."""
    return arm(lambda hinge: sc.JointSpringDamper(hinge, 100.0, 1.0, neutral=0.5))


def servo(**options: Any) -> sc.System:
    """The arm on a servo."""
    given = {"reference": 0.5, **options}
    return arm(lambda hinge: sc.JointServo(hinge, 100.0, 1.0, **given))


FLOOR, BAR = sc.Plane((0, 0, 0), (0, 0, 1)), sc.Cylinder((0.5, 0, -1), (0, 1, 0), 1.0)
#: force -> what it is compared with, the scene with it and that without it
FORCES: dict[str, tuple[str, Callable[[], sc.System], Callable[[], sc.System]]] = {
    "servo": ("a spring", servo, spring),
    "servo, a function of time": (
        *("a spring", lambda: servo(reference=lambda t: 0.5 * np.sin(3 * t) ** 2), spring),
    ),
    "servo, a ramp": (
        *("a spring", lambda: servo(reference=sc.RampSmooth(0.0, 0.5, last=0.5)), spring),
    ),
    "servo with a limit": ("a spring", lambda: servo(limit=1e3), spring),
    "servo with an integral": ("a spring", lambda: servo(ki=50.0), spring),
    "20 nodes on a plane": ("none", lambda: touching(FLOOR), falling),
    "20 nodes on a sphere": ("none", lambda: touching(sc.Sphere((0.5, 0, -1), 1.0)), falling),
    "20 nodes on a cylinder": ("none", lambda: touching(BAR), falling),
    "20 nodes on a plane, friction": (
        *("none", lambda: touching(FLOOR, friction=0.3, slip_speed=0.01), falling),
    ),
    "20 nodes, a law in numpy": ("none", lambda: on_nodes(drag), falling),
    "20 nodes, a law by numba": ("none", lambda: on_nodes(compiled_drag()), falling),
}


#: ratios that were aimed at
MOST = {
    **dict.fromkeys(("servo", "servo, a ramp", "servo, a function of time"), 1.4),
    **dict.fromkeys(("servo with a limit", "servo with an integral"), 1.4),
    **{name: 3.0 for name in FORCES if name.startswith("20 nodes on")},
    "20 nodes, a law in numpy": 10.0,
    "20 nodes, a law by numba": 2.0,
}


def run(system: sc.System, steps: int, every: int = 1) -> tuple[float, float]:
    """CPU time of a step (us), and its iterations; every so many states are recorded."""
    begun = measuring.time.process_time()
    given = system, sc.EnergyMomentum(), sc.NullSpace(), STEP, STEP * steps
    history = sc.simulate(*given, every=every, kernels="numba", derive=False)
    used = 1e6 * (measuring.time.process_time() - begun) / steps
    return used, float(history["newton_iterations"].mean())


def measured(names: Sequence[str], turns: int, steps: int) -> Iterator[dict[str, Any]]:
    """A row for each force."""
    for name in names:
        beside, with_it, without = FORCES[name]
        systems = with_it(), without()
        for system in systems:
            run(system, 20)  # kernels are read
        found = np.array([[run(system, steps) for system in systems] for _ in range(turns)])
        times, iterations = found[..., 0], found[..., 1]
        bare = np.array(
            [[run(system, steps, steps)[0] for system in systems] for _ in range(turns)]
        )
        row = (
            *(name, beside, *map(median, times.T.tolist())),
            *(median((times[:, 0] / times[:, 1]).tolist()), *map(median, iterations.T.tolist())),
            median((bare[:, 0] / bare[:, 1]).tolist()),
        )
        yield dict(zip(COLUMNS, row, strict=True))


def main(
    quick: bool = True, forces: Sequence[str] = tuple(FORCES), out: str | Path | None = None
) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    quick : bool
        Three turns of 300 steps; otherwise seven of 1000.
    forces : sequence of str
        Only these.
    out : path, optional
        Folder for force_cost.csv.

    Returns
    -------
    dict
        ``rows``, ``dgemm_gflops`` and where it was measured.
    """
    path = None if out is None else Path(out) / "force_cost.csv"
    rows = measured(forces, *((3, 300) if quick else (7, 1000)))
    return measuring.collected(rows, path, COLUMNS)


def missed(result: dict[str, Any]) -> list[str]:
    """What does not come up to the figures."""
    return [
        f"{r['force']}: {r['ratio']:.2f} of {r['beside']}, aimed at {MOST[r['force']]:g}"
        for r in result["rows"]
        if r["ratio"] > MOST[r["force"]]
    ]


def report(result: dict[str, Any]) -> str:
    """The table as text."""
    return measuring.table(result["rows"], COLUMNS)


if __name__ == "__main__":
    sys.exit(measuring.command(__doc__, main, report, missed))
