"""How simple a model do scenes need? The advisor on five of them.

The three-bar swing with its soft and its stiff beam, a slider-crank with a stiff rod, a slack cable
and the flying spaghetti of Simo & Vu-Quoc (J. Appl. Mech. 53 (1986) 849). For each: what every
candidate that was run through the whole event gave, at what cost, and which is proposed.

Run ``python examples/benchmarks/model_ladder.py --help`` for the choices.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import skfem_cosserat as sc
from skfem_cosserat.advice import Advice
from skfem_cosserat.export import prepare_folder
from skfem_cosserat.figures import PAGE, legend, panels, write_figure

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from paper.three_bar_swing import scene as swing

PICTURES = Path(__file__).resolve().parents[1] / "pictures"
GRAVITY = (0.0, 0.0, -9.81)


class Scene(NamedTuple):
    """A scene with what is asked of it.

    Attributes
    ----------
    model : Model
    quantities : dict of str to SensorPosition
    tolerance : float
        (m)
    until : float
        (s)
    """

    model: sc.Model
    quantities: dict[str, sc.SensorPosition]
    tolerance: float
    until: float


def soft_swing() -> Scene:
    """The published swing until its mass has turned back, 3.6 mm or half a per cent of the span."""
    model = swing("published")
    return Scene(model, {"mass": sc.SensorPosition(model["beam"].node("mid"))}, 3.6e-3, 0.5)


def stiff_swing() -> Scene:
    """The aluminium strip until beyond the reversal of the right link."""
    model = swing("stiff")
    return Scene(model, {"mass": sc.SensorPosition(model["beam"].node("mid"))}, 3.6e-3, 0.8)


def slider_crank() -> Scene:
    """A crank that is turned up to 10 rad/s, a steel rod of 0.5 m, a slider of 1 kg."""
    model = sc.Model()
    crank, length = 0.15, 0.5
    ends = np.array([[0.0, 0, 0], [crank, 0, 0], [crank + length, 0, 0]])
    arm = sc.RigidBody.box(
        0.3, (0.02, 0.02, crank), position=(crank / 2, 0, 0), triad=sc.triad((1.0, 0, 0))
    )
    model.add("crank", arm)
    steel = sc.SectionCircle(radius=6e-3, material=sc.Material(E=210e9, nu=0.3, rho=7850))
    mesh = sc.MeshCurve.init_line(ends[1], ends[2], 4, name="rod")
    rod = model.add("rod", sc.Beam(mesh, steel, director=(0.0, 1.0, 0.0)))
    slider = sc.RigidBody.box(1.0, (0.05, 0.05, 0.08), position=ends[2])
    model.add("slider", slider)
    axis = (0.0, 1.0, 0.0)
    shaft = model.add("shaft", sc.JointRevolute(sc.ground(ends[0]), arm.at(ends[0]), axis))
    model.add("pin", sc.JointRevolute(arm.at(ends[1]), rod.node("rod.start"), axis))
    model.add("wrist", sc.JointRevolute(rod.node("rod.end"), slider.at(ends[2]), axis))
    guide = sc.JointPrismatic(sc.ground(ends[2]), slider.at(ends[2]), axis=(1.0, 0.0, 0.0))
    model.add("guide", guide)
    model.add("motor", sc.JointDrive(shaft, lambda t: 10.0 * t**2 / (0.2 + t)))
    model.add("gravity", sc.LoadGravity(GRAVITY))
    quantities = {
        "slider": sc.SensorPosition(slider.at(ends[2])),
        "middle": sc.SensorPosition(rod, 0.25),
    }
    return Scene(model, quantities, 5e-4, 1.0)


def slack_cable() -> Scene:
    """A steel wire of 0.8 mm, 1.2 m long between two points 1 m apart, a ball on it, let go."""
    model = sc.Model()
    length, span = 1.2, 1.0
    # an arc of this length over this span: sin(x)/x = span/length for half its angle x
    half = 1.02673829137097
    radius = length / (2 * half)
    start = np.array([-span / 2, 0, 0])
    tangent = (np.cos(half), 0.0, -np.sin(half))
    normal = (np.sin(half), 0.0, np.cos(half))
    mesh = sc.MeshCurve.init_arc(
        start, tangent, normal, radius, 2 * half, 16, name="cable", nodes={"mid": 0.5}
    )
    wire = sc.SectionCircle(radius=0.4e-3, material=sc.Material(E=210e9, nu=0.3, rho=7850))
    cable = model.add("cable", sc.Beam(mesh, wire, director=(0.0, 1.0, 0.0)))
    axis = (0.0, 1.0, 0.0)
    for side in ("start", "end"):
        node = cable.node(f"cable.{side}")
        model.add(f"{side} hinge", sc.JointRevolute(sc.ground(node.position), node, axis))
    model.add("ball", sc.MassPoint(0.05, on=cable.node("mid")))
    model.add("gravity", sc.LoadGravity((4.0, 0.0, -9.0)))
    return Scene(model, {"ball": sc.SensorPosition(cable.node("mid"))}, 5e-3, 0.5)


def flying_spaghetti() -> Scene:
    """The plane flight of Simo & Vu-Quoc: force and moment on the lower end until 2.5 s."""
    mesh = sc.MeshCurve.init_line((6, 0, 0), (0, 8, 0), 10, name="rod")
    section = sc.Section.from_constants(
        EA=1e4, GA=1e4, EI=(100, 100), GJ=100, mass=1.0, inertia=(10, 10)
    )
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, director=(0, 0, 1)))
    low = rod.node("rod.start")
    pulse = sc.Table([0.0, 2.5, 2.5 + 1e-9], [1.0, 1.0, 0.0])
    model.add("force", sc.LoadForce(low, (8.0, 0, 0), pulse))
    model.add("moment", sc.LoadMoment(low, (0, 0, -80.0), pulse))
    ends = {"low": sc.SensorPosition(low), "high": sc.SensorPosition(rod.node("rod.end"))}
    return Scene(model, ends, 0.1, 5.0)


SCENES = {
    "soft swing": soft_swing,
    "stiff swing": stiff_swing,
    "slider-crank": slider_crank,
    "slack cable": slack_cable,
    "flying spaghetti": flying_spaghetti,
}


def main(
    scenes: tuple[str, ...] = tuple(SCENES),
    budget_s: float | None = 300.0,
    seed: int = 0,
    out: str | Path | None = None,
) -> dict[str, Any]:
    """Advise on scenes; returns by scene the proposal, errors, costs, and a row a theory.

    Parameters
    ----------
    scenes : tuple of str
        Of ``SCENES``.
    budget_s : float, optional
        Processor time for each (s).
    seed : int
    out : path-like, optional
        Folder for ``model_ladder.csv``, a table of the theories, and for ``model_ladder.png``.
    """
    advices = {}
    for name in scenes:
        own = SCENES[name]()
        advices[name] = sc.advise(
            own.model, own.quantities, own.tolerance, budget_s, seed, until=own.until
        )
        print(f"== {name}\n{advices[name]}\n")
    if out is not None:
        prepare_folder(Path(out))
        _write(advices, Path(out))
    return {name: _numbers(advice) for name, advice in advices.items()}


def _numbers(advice: Advice) -> dict[str, Any]:
    return {
        "proposal": str(advice.proposal),
        "confident": advice.confident,
        "reasons": advice.reasons,
        "predicted_error": advice.predicted_error,
        "true_error": advice.true_error,
        "reference_error": advice.reference_error,
        "predicted_cost_s": advice.predicted_cost_s,
        "true_cost_s": advice.true_cost_s,
        "theories": _theories(advice),
    }


def _theories(advice: Advice) -> dict[str, dict[str, Any]]:
    """By theory: how many candidates went through, the least error, the cheapest good one."""
    out: dict[str, dict[str, Any]] = {}
    for kind in sorted({row["theories"] for row in advice.candidates}):
        rows = [row for row in advice.candidates if row["theories"] == kind]
        done = [row for row in rows if row["status"] == "ok"]
        good = [row["cost_s"] for row in done if row["error"] <= 1.0]
        out[kind] = {
            "run": len(rows),
            "through": len(done),
            "least_error": min((row["error"] for row in done), default=np.inf),
            "cheapest_s": min(good, default=np.nan),
        }
    return out


def _write(advices: dict[str, Advice], folder: Path) -> None:
    import csv

    with (folder / "model_ladder.csv").open("w", newline="", encoding="utf-8") as handle:
        writer = csv.writer(handle)
        writer.writerow(
            ["scene", "theories", "run", "through", "least error/tolerance", "cheapest s"]
        )
        for name, advice in advices.items():
            for kind, row in _theories(advice).items():
                numbers = [f"{row[key]:.4g}" for key in ("least_error", "cheapest_s")]
                writer.writerow([name, kind, row["run"], row["through"], *numbers])
    down = -(-len(advices) // 2)
    figure, axes = panels(PAGE, 3.2 * down, down, min(len(advices), 2), len(advices))
    for axis, (name, advice) in zip(axes, advices.items(), strict=True):
        advice.draw(axis)
        axis.set_title(name)
    legend(figure)
    write_figure(figure, folder / "model_ladder.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--budget", type=float, default=300.0, help="processor time of each (s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", default=PICTURES)
    given = parser.parse_args()
    main(tuple(given.scenes), given.budget, given.seed, given.out)
