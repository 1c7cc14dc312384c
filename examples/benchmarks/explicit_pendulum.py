"""The soft pendulum D1, explicit: temporal error against time, beside PyElastica.

Errors are those in time alone: each code against itself at a much smaller step, on as many linear
elements. Times are processor times, the least of some repeats: of plain numpy here, PyElastica's
kernels are compiled before.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

import peer_calls

import skfem_cosserat as sc

#: rubber rod of the collection's D1: length (m), radius (m), E (Pa), density (kg/m^3)
LENGTH, RADIUS, YOUNG, DENSITY, G = 1.0, 5e-3, 5e6, 1100.0, 9.81
ELEMENTS, UNTIL = 32, 0.5
STEPS, FINEST = (4500, 8000, 16000, 32000), 128000


def rod() -> tuple[sc.System, sc.Section, sc.Place]:
    """The scene, its section, and where in q the tip is."""
    A, inertia = np.pi * RADIUS**2, np.pi * RADIUS**4 / 4
    shear = YOUNG / 3
    section = sc.Section.from_constants(
        EA=YOUNG * A,
        GA=shear * A,
        EI=(YOUNG * inertia, YOUNG * inertia),
        GJ=2 * shear * inertia,
        mass=DENSITY * A,
        inertia=(DENSITY * inertia, DENSITY * inertia),
    )
    mesh = sc.MeshCurve.init_line((0, 0, 0), (LENGTH, 0, 0), ELEMENTS, name="rod")
    model = sc.Model()
    beam = model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0), lumped=True))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), beam.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    model.add("gravity", sc.LoadGravity((0, -G, 0)))
    system = model.freeze()
    return system, section, beam.node("rod.end")


def own(steps: int, repeats: int) -> tuple[np.ndarray, float]:
    """Tip at the end, and processor time (s)."""
    system, _, end = rod()
    start, least = sc.initial_state(system), np.inf
    for _ in range(repeats):
        scheme = sc.Explicit(rounds=steps // 10)
        stepper = sc.Stepper(system, scheme, sc.Multipliers(), UNTIL / 10)
        state, begun = start, time.process_time()
        for _ in range(10):
            state = stepper.advance(state).state
        least = min(least, time.process_time() - begun)
    return sc.View(system, state).position(end), least


def peer(python: Any, steps: int, repeats: int) -> tuple[np.ndarray, float]:
    """The same of PyElastica."""
    section = rod()[1]
    scene = {
        "length": LENGTH,
        "stiffness": np.diag(section.stiffness).tolist(),
        "mass": section.mass,
        "radius": RADIUS,
        "polar": 2 * np.pi * RADIUS**4 / 4,
        "gravity": [0, -G, 0],
    }
    options = ["--scene", json.dumps(scene), "--elements", str(ELEMENTS)]
    options += ["--until", str(UNTIL), "--step", str(UNTIL / steps)]
    least = np.inf
    for _ in range(repeats):
        answer = peer_calls.ask(python, peer_calls.ELASTICA, *options)
        if answer["status"] != "completed":
            return np.full(3, np.nan), np.nan
        least = min(least, answer["ms_per_step"] * steps / 1e3)
    return np.array(answer["tip"]), least


def main(repeats: int = 3) -> dict[str, list[dict[str, float]]]:
    """For both codes, and each number of steps: temporal error of the tip (m), time (s).

    Each line is printed as soon as it is known.
    """
    calls = {"own": own}
    try:
        python = peer_calls.prepare(peer_calls.ELASTICA)
        calls["PyElastica"] = lambda steps, count: peer(python, steps, count)
    except peer_calls.Unavailable as reason:
        print(f"without PyElastica: {reason}", flush=True)
    out: dict[str, list[dict[str, float]]] = {name: [] for name in calls}
    finest = {}
    for name, call in calls.items():
        print(f"{name}: reference of {FINEST} steps, up to two minutes", flush=True)
        finest[name] = call(FINEST, 1)[0]
    for steps in STEPS:
        for name, call in calls.items():  # one after the other: the same load of the machine
            tip, seconds = call(steps, repeats)
            error = float(np.linalg.norm(tip - finest[name]))
            row = {"steps": steps, "error": error, "seconds": seconds}
            print(name, ", ".join(f"{k} {value:.4g}" for k, value in row.items()), flush=True)
            out[name].append(row)
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    main(parser.parse_args().repeats)
