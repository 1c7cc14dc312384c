"""A crane turns with a load on its rope: the load lags behind, and swings on when the crane stops.

Column and jib are one welded mesh, two stays and the rope are cables, which only pull. The crane
starts from its equilibrium under the load (``sc.static``, then ``sc.equilibrium``), so that the
rope is taut and nothing bounces. The drive turns the column by a smooth ramp. The load then swings
as a pendulum of the length of the rope.

Run ``python examples/slewing_crane.py``; compare the period of the swing with the pendulum's.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "slewing_crane.gif"
TOP, JIB, REACH, ROPE, LOAD, GRAVITY = 7.5, 6.0, 6.0, 4.0, 400.0, 9.81  # m, kg, m/s^2


def crane(angle: float, duration: float) -> sc.Model:
    """The crane, which turns by `angle` (rad) in `duration` (s)."""
    column = sc.MeshCurve.init_line((0, 0, 0), (0, 0, TOP), 5, name="column")
    jib = sc.MeshCurve.init_line((0, 0, JIB), (REACH, 0, JIB), 4, name="jib", nodes={"mid": 0.5})
    steel = sc.Material(E=210e9, nu=0.3, rho=7850)
    tubes = {"column": sc.SectionTube(0.25, 0.24, steel), "jib": sc.SectionTube(0.15, 0.144, steel)}
    model = sc.Model()
    frame = sc.Beam(column.joined(jib), tubes, order=2, director=(0, 1, 0))
    model.add("frame", frame)
    top, tip = frame.node("column.end"), frame.node("jib.end")
    base = sc.JointRevolute(sc.ground((0, 0, 0)), frame.node("column.start"), axis=(0, 0, 1))
    model.add("base", base)
    model.add("drive", sc.JointDrive(base, sc.RampSmooth(0.0, duration, last=angle)))
    for place in (frame.node("mid"), tip):
        length = np.linalg.norm(place.position - top.position)
        name = f"stay {len(model)}"
        model.add(name, sc.Cable(top, place, 3e7 / length, length=0.999 * length))
    hook = (REACH, 0, JIB - ROPE)
    load = model.add("load", sc.MassPoint(LOAD, position=hook))
    model.add("rope", sc.Cable(tip, load.place(), 5e5, damping=500.0, length=ROPE))
    model.add("weight", sc.LoadGravity((0, 0, -GRAVITY)))
    return model


def main(
    angle: float = 1.2,
    duration: float = 6.0,
    step: float = 2e-2,
    until: float = 14.0,
    out: str | Path | None = None,
) -> dict[str, Any]:
    """Tension of the rope (N) at rest, period (s) and amplitude (rad) of the swing at the end."""
    model = crane(angle, duration)
    path = sc.static(model, time=0.0, factors={"weight": 1.0})
    start = sc.equilibrium(model, path)
    run = model, sc.EnergyMomentum(), sc.NullSpace(), step, until
    history = sc.simulate(*run, start=start)
    load, frame = model["load"].place(), model["frame"]
    rope = history.position(load) - history.position(frame.node("jib.end"))
    after = history.times > duration
    t, swing = history.times[after], rope[after] @ (-np.sin(angle), np.cos(angle), 0)
    k = np.flatnonzero(swing[:-1] * swing[1:] < 0)
    zeros = t[k] + (t[k + 1] - t[k]) * swing[k] / (swing[k] - swing[k + 1])
    if out is not None:
        history.animate(out, fps=8, speed=2.0, window=(480, 270))
    return {
        "tension": float(path["coupling/rope/force"][-1].item()),
        "length": float(np.linalg.norm(rope[0])),
        "period": float(2 * np.diff(zeros).mean()),
        "amplitude": float(abs(swing).max() / ROPE),
    }


if __name__ == "__main__":
    result = main(out=PICTURE)
    pendulum = 2 * np.pi * np.sqrt(result["length"] / GRAVITY)
    print(f"tension of the rope at rest: {result['tension']:.1f} N, weight {LOAD * GRAVITY:.1f} N")
    print(f"the load swings by {np.degrees(result['amplitude']):.1f} degrees")
    print(f"period {result['period']:.3f} s, of a pendulum {pendulum:.3f} s\npicture: {PICTURE}")
