"""Do warnings tell wrong runs from right ones? Random scenes with steps from short to far too long.

A run of fifty steps is *wrong* if a position leaves that of a run with a quarter of the step by
more than a tenth of the range of the position that moves most. It is *warned* if a warning said
that its steps are too long (others, about energies or bent elements, do not count). Runs in which a
step could not be solved are counted apart: they end with an error.

The limits of the warnings were set on the first ten, the third ten scenes, and so on; the others
count. The runs behind the map of stability (see stability_chart.py) count, too, each for its first
fifty steps; no limit was set on them.

Where a step has several solutions both treatments of the constraints may part: a run by multipliers
tells where they do, and whether that step was *doubted*.

Run ``python examples/benchmarks/warned_runs.py --help`` for the choices.
"""

from __future__ import annotations

import sys
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

import measuring  # before numpy: one thread
import numpy as np
import stability_chart

import skfem_cosserat as sc
from skfem_cosserat.diagnostics import doubtful_steps, resolution

COUNT, WRONG = 50, 0.1
#: distance of states by both treatments, relative, above which they have parted
PARTED = 1e-6
#: steps in the characteristic time of a scene
PARTS = (200, 60, 24, 10, 4, 1.5)
INTEGRATORS = (sc.EnergyMomentum(), sc.Variational(), sc.GeneralizedAlpha(0.8))
COLUMNS = (
    *("scene", "number", "integrator", "step_s", "parts", "status", "off", "estimate", "turn"),
    *("wrong", "warned", "parted", "doubted", "what"),
)
G = 9.81


def rubber(random: np.random.Generator, radius: float) -> sc.SectionCircle:
    """A circle of random stiffness."""
    E = 10 ** random.uniform(6, 10)
    return sc.SectionCircle(radius, sc.Material(E=E, nu=0.4, rho=1200.0))


def _bending(section: sc.Section, length: float) -> float:
    """Period (s) of a cantilever."""
    return float(2 * np.pi / 3.52 * length**2 * np.sqrt(section.mass / section.stiffness[3, 3]))


def _line(length: float, elements: int = 4) -> sc.MeshCurve:
    return sc.MeshCurve.init_line((0, 0, 0), (length, 0, 0), elements, name="rod")


def cantilever(random: np.random.Generator) -> tuple[sc.Model, float]:
    """Let go under its weight, with a force at its end."""
    length = random.uniform(0.5, 2.0)
    section = rubber(random, length * 10 ** random.uniform(-2, -1.5))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(_line(length), section, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    size = 0.3 * section.stiffness[3, 3] / length**2
    model.add("force", sc.LoadForce(rod.node("rod.end"), size * random.normal(size=3)))
    return model, _bending(section, length)


def hinged(random: np.random.Generator) -> tuple[sc.Model, float]:
    """A rod that falls about a hinge."""
    length = random.uniform(0.5, 2.0)
    section = rubber(random, length * 10 ** random.uniform(-2, -1.5))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(_line(length), section, director=(0, 0, 1)))
    place = sc.ground((0, 0, 0)), rod.node("rod.start")
    model.add("hinge", sc.JointRevolute(*place, axis=(0, 0, 1)))
    model.add("weight", sc.LoadGravity((0, -G, 0)))
    return model, 2 * np.pi * np.sqrt(2 * length / 3 / G)


def flying(random: np.random.Generator) -> tuple[sc.Model, float]:
    """A free rod that is pushed and turned."""
    length = random.uniform(0.5, 2.0)
    section = rubber(random, length * 10 ** random.uniform(-2, -1.5))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(_line(length, 6), section, director=(0, 0, 1)))
    period = _bending(section, length)
    size, pulse = section.stiffness[3, 3] / length**2, sc.Table([0, period, 2 * period], [0, 1, 0])
    model.add("push", sc.LoadForce(rod.node("rod.end"), 0.3 * size * random.normal(size=3), pulse))
    return model, period


def pendulum(random: np.random.Generator, bodies: int = 1) -> tuple[sc.Model, float]:
    """Rigid bodies on ball joints."""
    model, last, place = sc.Model(), np.zeros(3), sc.ground((0, 0, 0))
    lengths = random.uniform(0.3, 1.0, bodies)
    for k, length in enumerate(lengths):
        way = random.normal(size=3)
        end = last + length * way / np.linalg.norm(way)
        inertia = 0.05 * length**2 * random.uniform(1.0, 1.5, 3)
        body = model.add(f"body {k}", sc.RigidBody(1.0, tuple(inertia), position=(last + end) / 2))
        model.add(f"ball {k}", sc.JointSpherical(place, body.at(last)))
        place, last = body.at(end), end
    model.add("weight", sc.LoadGravity((0, 0, -G)))
    return model, 2 * np.pi * np.sqrt(2 * lengths.min() / 3 / G)


def double(random: np.random.Generator) -> tuple[sc.Model, float]:
    """Two of them."""
    return pendulum(random, 2)


def thrown(random: np.random.Generator) -> tuple[sc.Model, float]:
    """A rigid body that spins and tumbles, held by a spring."""
    model = sc.Model()
    spin = random.uniform(2, 20) * random.normal(size=3)
    body = model.add(
        "body",
        sc.RigidBody(1.0, tuple(0.02 * random.uniform(1, 1.8, 3)), angular_velocity=tuple(spin)),
    )
    place = sc.ground((0.5, 0.2, 0)), body.at((0.2, 0, 0))
    model.add("spring", sc.SpringDamper(*place, stiffness=10 ** random.uniform(1, 3)))
    return model, float(2 * np.pi / np.linalg.norm(spin))


def top(random: np.random.Generator) -> tuple[sc.Model, float]:
    """A heavy top."""
    model, spin = sc.Model(), random.uniform(20, 80)
    triad = sc.triad((0.4, 0.2, 0.9))
    axis = np.asarray(triad)[:, 2]
    body = model.add(
        "top",
        sc.RigidBody(
            *(2.0, (0.02, 0.02, 0.01)),
            position=0.2 * axis,
            triad=triad,
            angular_velocity=tuple(spin * axis),
        ),
    )
    model.add("tip", sc.JointSpherical(sc.ground((0, 0, 0)), body.at((0, 0, 0))))
    model.add("weight", sc.LoadGravity((0, 0, -G)))
    return model, 2 * np.pi / spin


def sprung(random: np.random.Generator) -> tuple[sc.Model, float]:
    """A mass between two springs."""
    model, stiffness = sc.Model(), 10 ** random.uniform(1, 5)
    ball = model.add("ball", sc.MassPoint(1.0, velocity=tuple(random.normal(size=3))))
    for k, at in enumerate(((1, 0, 0), (-0.5, 1, 0))):
        place = sc.ground(at), ball.place()
        model.add(f"spring {k}", sc.SpringDamper(*place, stiffness=stiffness))
    return model, 2 * np.pi / np.sqrt(stiffness)


def carried(random: np.random.Generator) -> tuple[sc.Model, float]:
    """A heavy ball at the end of a stiff rod that swings."""
    model, length = hinged(random)
    rod = model["rod"]
    model.add("ball", sc.MassPoint(random.uniform(0.5, 5.0), on=rod.node("rod.end")))
    return model, length


def portal(random: np.random.Generator) -> tuple[sc.Model, float]:
    """A frame of three beams that is shaken."""
    section = rubber(random, 0.02)
    points = [(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0)]
    model = sc.Model()
    mesh = sc.MeshCurve.init_polyline(points, [3, 3, 3], "frame")
    frame = model.add("frame", sc.Beam(mesh, section, director=(0, 1, 0)))
    for end in ("start", "end"):
        place = frame.node(f"frame.{end}")
        at = points[0] if end == "start" else points[-1]
        model.add(end, sc.JointFixed(sc.ground(at), place))
    period = _bending(section, 1.0)
    model.add("weight", sc.LoadGravity(tuple(5.0 * random.normal(size=3))))
    return model, period


SCENES: tuple[Callable[[np.random.Generator], tuple[sc.Model, float]], ...] = (
    *(cantilever, hinged, flying, pendulum, double, thrown, top, sprung, carried, portal),
)


def off(model: sc.System, rough: sc.History, fine: sc.History) -> float:
    """Largest distance of a position, relative to the range of the one that moves most."""
    origins = model.origin_rows
    a, b = (run["q"].reshape(len(run), -1, 3)[:, origins] for run in (rough, fine))
    reach = np.linalg.norm(b.max(0) - b.min(0), axis=-1).max()
    return float(np.linalg.norm(a - b, axis=-1).max() / reach)


def case(number: int, parts: float) -> dict[str, Any]:
    """A random scene, with so many steps in its characteristic time."""
    random = np.random.default_rng(number)
    build = SCENES[number % len(SCENES)]
    model, time = build(random)
    integrator = INTEGRATORS[int(random.integers(len(INTEGRATORS)))]
    about = {"scene": build.__name__, "number": number, "parts": parts}
    return about | compared(model.freeze(), integrator, time / parts)


def swing(factor: float, integrator: sc.Integrator, step: float) -> dict[str, Any]:
    """A cell of the map of stability."""
    about = {"scene": f"swing {factor:g}", "number": None, "parts": None}
    return about | compared(stability_chart.system(factor), integrator, step)


def compared(system: sc.System, integrator: sc.Integrator, h: float) -> dict[str, Any]:
    """One run, that with a quarter of its step, and that by the other treatment."""
    row: dict[str, Any] = dict.fromkeys(COLUMNS[3:])
    row |= {"integrator": integrator.name, "step_s": h, "status": "completed"}
    del row["parts"]
    row |= {"wrong": False, "warned": False, "doubted": False, "what": ""}
    own = {"kernels": "numpy", "derive": False}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sc.CosseratWarning)
            rough = sc.simulate(system, integrator, sc.NullSpace(), h, COUNT * h, **own)
            fine = sc.simulate(system, integrator, sc.NullSpace(), h / 4, COUNT * h, every=4, **own)
            other = _so_far(system, integrator, sc.Multipliers(), h, COUNT * h, **own)
    except sc.Diverged as error:
        return row | {"status": "not solved", "what": str(error)[:200]}
    said = [n["text"] for n in rough.meta["warnings"] if n["item"] == "argument step"]
    if (found := resolution(system, rough)) is not None:
        row |= {"estimate": found.error, "turn": found.turn}
    distance = off(system, rough, fine)
    apart = abs(rough["q"][: len(other)] - other["q"]).max(1) / abs(rough["q"]).max()
    if (apart > PARTED).any():
        row["parted"] = parted = int(np.argmax(apart > PARTED))
        row["doubted"] = bool(doubtful_steps(system, rough)[parted])
    return row | {
        "off": distance,
        "wrong": distance > WRONG,
        "warned": bool(said),
        "what": said[0][:200] if said else "",
    }


def _so_far(*arguments: Any, **options: Any) -> sc.History:
    """A run, up to a step that could not be solved."""
    try:
        return sc.simulate(*arguments, **options)
    except sc.Diverged as error:
        return error.history


def counted(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Shares of wrong and of right runs that were warned, and of parted ones that were doubted.

    Of those in which both treatments have parted the step where they did counts.
    """
    solved = [row for row in rows if row["status"] == "completed"]
    wrong = [row["warned"] for row in solved if row["wrong"]]
    right = [row["warned"] for row in solved if not row["wrong"]]
    parted = [row["doubted"] for row in solved if row["parted"] is not None]
    return {
        "runs": len(rows),
        "not_solved": len(rows) - len(solved),
        "wrong": len(wrong),
        "wrong_warned": float(np.mean(wrong)) if wrong else np.nan,
        "right": len(right),
        "right_warned": float(np.mean(right)) if right else np.nan,
        "parted": len(parted),
        "parted_doubted": float(np.mean(parted)) if parted else np.nan,
    }


def main(
    quick: bool = True, numbers: int | None = None, out: str | Path | None = None
) -> dict[str, Any]:
    """Run.

    Parameters
    ----------
    quick : bool
        Twenty scenes and one swing, otherwise sixty and six.
    numbers : int, optional
        So many instead.
    out : path, optional
        Folder for warned_runs.csv.

    Returns
    -------
    dict
        ``rows``, ``set`` and ``counted``: what was found on either half of the scenes, ``swings``:
        on the runs behind the map of stability; and where it was measured.
    """
    count = numbers or (20 if quick else 60)
    rows = [case(number, parts) for number in range(count) for parts in PARTS]
    factors = stability_chart.FACTORS[:1] if quick else stability_chart.FACTORS
    swings = [
        swing(factor, integrator, step)
        for factor in factors
        for integrator in INTEGRATORS
        for step in stability_chart.STEPS
    ]
    path = None if out is None else Path(out) / "warned_runs.csv"
    result = measuring.collected([*rows, *swings], path, COLUMNS)
    halves = [[row for row in rows if row["number"] // len(SCENES) % 2 == k] for k in (0, 1)]
    found = {"set": counted(halves[0]), "counted": counted(halves[1]), "swings": counted(swings)}
    return result | found


def missed(result: dict[str, Any]) -> list[str]:
    """Nine of ten wrong runs are to be warned, one of ten right ones at most."""
    found = result["counted"]
    out = []
    if found["wrong_warned"] < 0.9:
        out.append(f"wrong runs warned: {found['wrong_warned']:.2f}, at least 0.9")
    if found["right_warned"] > 0.1:
        out.append(f"right runs warned: {found['right_warned']:.2f}, at most 0.1")
    return out


def report(result: dict[str, Any]) -> str:
    """Counts, by scene too."""
    lines = []
    for half in ("set", "counted", "swings"):
        lines.append(f"{half}: " + ", ".join(f"{k} {v:.3g}" for k, v in result[half].items()))
    silent = Counter(r["scene"] for r in result["rows"] if r["wrong"] and not r["warned"])
    false = Counter(r["scene"] for r in result["rows"] if r["warned"] and not r["wrong"])
    lines += [f"wrong and not warned: {dict(silent)}", f"right and warned: {dict(false)}"]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(measuring.command(__doc__, main, report, missed))
