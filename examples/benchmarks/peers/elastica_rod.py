"""Adapter: the hinged rod in PyElastica (explicit), its cost and tip as JSON on stdout.

Runs in an environment that has PyElastica and not this package: all numbers of the scene come on
the command line. With ``--step 0`` it looks for its largest stable step first: the largest of
``length / elements / wave speed`` times powers of the fourth root of two with which the tip stays
within the rod's length of its hinge. Its hinge holds the first element, not the first node.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from importlib.metadata import version
from typing import Any


def parser() -> argparse.ArgumentParser:
    """Command line; the scene: length, stiffness (6, as a section of ours), mass, inertia, g."""
    out = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    out.add_argument("--scene", required=True, type=json.loads, help="numbers, as JSON")
    out.add_argument("--elements", type=int, required=True)
    out.add_argument("--step", type=float, default=0.0, help="0: the largest stable one")
    out.add_argument("--until", type=float, required=True, help="end of the run (s)")
    return out


def rod_on_hinge(a: argparse.Namespace) -> tuple[Any, Any]:
    """The simulator and the rod in it, at rest."""
    import elastica as ea
    import numpy as np

    class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing):
        """What takes part."""

    s = a.scene
    area = np.pi * s["radius"] ** 2
    rod = ea.CosseratRod.straight_rod(
        a.elements,
        np.zeros(3),
        np.array([1.0, 0.0, 0.0]),
        np.array([0.0, 1.0, 0.0]),
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


def integrate(a: argparse.Namespace, step: float, until: float) -> dict[str, Any] | None:
    """Run; None if the tip gets where it cannot be."""
    import elastica as ea
    import numpy as np

    simulator, rod = rod_on_hinge(a)
    stepper, now = ea.PositionVerlet(), 0.0
    for _ in range(2):
        now = stepper.step(simulator, now, step)
    steps = max(1, round(until / step) - 2)
    begun = time.process_time()
    for k in range(steps):
        now = stepper.step(simulator, now, step)
        if k % 200 == 199 and not np.isfinite(rod.position_collection[:, -1]).all():
            return None
    seconds = time.process_time() - begun
    tip = rod.position_collection[:, -1]
    if not np.linalg.norm(tip) < 1.05 * a.scene["length"]:  # not a number either
        return None
    return {
        "status": "completed",
        "version": version("pyelastica"),
        "ms_per_step": 1e3 * seconds / steps,
        "steps": steps,
        "step": step,
        "until": float(now),
        "tip": [float(x) for x in tip],
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
        while (found := integrate(a, step, a.until)) is None:
            step /= 2**0.25
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
