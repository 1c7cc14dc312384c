"""Adapter: a hinged or a free rod in PyElastica (explicit), cost and tip as JSON on stdout.

Runs in an environment that has PyElastica and not this package: all numbers of the scene come on
the command line. With ``--step 0`` it looks for its largest stable step first: the largest of
``length / elements / wave speed`` times powers of the fourth root of two with which its ends stay
within 1.05 (a free rod: 1.2) of its length of each other. Its hinge holds the first element, not
the first node.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from importlib.metadata import version
from typing import Any


def parser() -> argparse.ArgumentParser:
    """Command line; the scene: as for Exudyn's adapter, and the radius."""
    out = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    out.add_argument("--scene", required=True, type=json.loads, help="numbers, as JSON")
    out.add_argument("--elements", type=int, required=True)
    out.add_argument("--step", type=float, default=0.0, help="0: the largest stable one")
    out.add_argument("--until", type=float, required=True, help="end of the run (s)")
    out.add_argument("--sample", type=float, default=0.0, help="interval of the tip path (s)")
    return out


def rod_of(a: argparse.Namespace) -> tuple[Any, Any]:
    """The simulator and the rod in it, at rest."""
    import elastica as ea
    import numpy as np

    class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing):
        """What takes part."""

    s = a.scene
    area = np.pi * s["radius"] ** 2
    start = np.array(s.get("start", [0.0, 0.0, 0.0]), dtype=float)
    along = np.array(s.get("end", [s["length"], 0.0, 0.0]), dtype=float) - start
    along /= np.linalg.norm(along)
    rod = ea.CosseratRod.straight_rod(
        a.elements,
        start,
        along,
        np.array([0.0, 1.0, 0.0]) if "pulse" not in s else np.array([0.0, 0.0, 1.0]),
        s["length"],
        s["radius"],
        s["mass"] / area,
        youngs_modulus=s["stiffness"][2] / area,
        shear_modulus=s["stiffness"][5] / s["polar"],
    )
    for k in range(3):  # shear, shear, axial; bending, bending, torsion: in the same order
        rod.shear_matrix[k, k, :] = s["stiffness"][k]
        rod.bend_matrix[k, k, :] = s["stiffness"][3 + k]
    simulator = Simulator()
    simulator.append(rod)
    if "pulse" in s:
        _push(simulator, rod, s)
        simulator.finalize()
        return simulator, rod
    simulator.constrain(rod).using(
        ea.GeneralConstraint,
        constrained_position_idx=(0,),
        constrained_director_idx=(0,),
        translational_constraint_selector=np.array([True, True, True]),
        rotational_constraint_selector=np.array([True, True, False]),
    )
    simulator.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=np.array(s["gravity"]))
    simulator.finalize()
    return simulator, rod


def _push(simulator: Any, rod: Any, s: dict[str, Any]) -> None:
    """Inertia of the section; force and moment on the start, which grow and fall with the pulse."""
    import elastica as ea
    import numpy as np

    sums = sum(s["inertia"]) if "rotary" not in s else s["rotary"][0]
    per_length = np.diag([*(s["rotary"][1:] if "rotary" in s else s["inertia"]), sums])
    for k, length in enumerate(rod.rest_lengths):
        rod.mass_second_moment_of_inertia[..., k] = per_length * length
        rod.inv_mass_second_moment_of_inertia[..., k] = np.linalg.inv(per_length * length)
    times, factors = s["pulse"]
    force, moment = np.array(s["force"]), np.array(s["moment"])

    class Push(ea.NoForces):
        """On the first node, and on the element there."""

        def apply_forces(self, system: Any, time: float = 0.0) -> None:
            """Add the force."""
            system.external_forces[:, 0] += np.interp(time, times, factors) * force

        def apply_torques(self, system: Any, time: float = 0.0) -> None:
            """Add the moment, in the element's frame."""
            frame = system.director_collection[..., 0]
            system.external_torques[:, 0] += np.interp(time, times, factors) * (frame @ moment)

    simulator.add_forcing_to(rod).using(Push)


def integrate(a: argparse.Namespace, step: float, until: float) -> dict[str, Any] | None:
    """Run; None if the tip gets where it cannot be."""
    import elastica as ea
    import numpy as np

    simulator, rod = rod_of(a)
    stepper, now, path = ea.PositionVerlet(), 0.0, []
    every = round(a.sample / step) if a.sample > 0 else 0
    for _ in range(2):
        now = stepper.step(simulator, now, step)
    steps = max(1, round(until / step) - 2)
    begun = time.process_time()
    for k in range(steps):
        now = stepper.step(simulator, now, step)
        if k % 200 == 199 and not np.isfinite(rod.position_collection[:, -1]).all():
            return None
        if every and (k + 3) % every == 0:
            path.append([float(now), *map(float, rod.position_collection[:, -1])])
    seconds = time.process_time() - begun
    tip = rod.position_collection[:, -1]
    apart = np.linalg.norm(tip - rod.position_collection[:, 0])
    if not apart < (1.2 if "pulse" in a.scene else 1.05) * a.scene["length"]:  # no number either
        return None
    return {
        "status": "completed",
        "version": version("pyelastica"),
        "ms_per_step": 1e3 * seconds / steps,
        "steps": steps,
        "step": step,
        "until": float(now),
        "tip": [float(x) for x in tip],
        "path": path or None,
    }


def largest_step(a: argparse.Namespace) -> float:
    """With which it is stable over a tenth of the time, at least 500 steps."""
    speed = (a.scene["stiffness"][2] / a.scene["mass"]) ** 0.5
    step = 2 * a.scene["length"] / a.elements / speed
    while integrate(a, step, max(500 * step, 0.1 * a.until)) is None:
        step /= 2**0.25
    return step


def run(a: argparse.Namespace) -> dict[str, Any]:
    """The run at the step asked for, or at the largest at which it stays stable to its end."""
    import numpy as np

    with np.errstate(all="ignore"):
        if a.step > 0:
            return integrate(a, a.step, a.until) or {"status": "unstable"}
        step = largest_step(a)
        if a.sample > 0:  # instants of the path are ends of steps
            step = a.sample / math.ceil(a.sample / step)
        while (found := integrate(a, step, a.until)) is None:
            step = step / 2**0.25 if a.sample == 0 else a.sample / (round(a.sample / step) + 1)
        return found


def main() -> None:
    """Keep stdout for the answer: the code may print to it as well."""
    answer = os.dup(1)
    os.dup2(2, 1)
    found = run(parser().parse_args())
    with os.fdopen(answer, "w") as file:
        json.dump(found, file)


if __name__ == "__main__":
    main()
