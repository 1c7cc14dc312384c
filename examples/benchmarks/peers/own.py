"""skfem-cosserat itself: any order, integrator and treatment of the constraints."""

from __future__ import annotations

import json
import sys
from functools import cache
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import common
import measuring  # before numpy: one thread
import numpy as np

import skfem_cosserat as sc
from collection.members import SolidBeam
from skfem_cosserat.integrators import Stepper

NAME = "skfem-cosserat"
REQUIREMENT = ""  # this Python has it
OPTIONS = {"integrator": "energy-momentum", "treatment": "null-space", "order": 1}
OPTIONS |= {"kernels": "auto"}


@cache
def system(text: str, order: int, lumped: bool) -> tuple[sc.System, sc.Place]:
    """The system of a scene (as JSON), and the point that is watched."""
    scene, model, places = json.loads(text), sc.Model(), {}
    for i, beam in enumerate(scene["beams"]):
        nodes, rows = (
            np.array(beam["nodes"]),
            np.hstack([common.rows(beam, name) for name in ("stiffness", "mass", "inertia")]),
        )
        new = 1 + np.flatnonzero(np.diff(rows, axis=0).any(axis=1))  # another section
        pairs = [(int(a), int(b)) for a, b in zip([0, *new], [*new, len(rows)], strict=True)]
        parts = [sc.MeshCurve.init_line(nodes[a], nodes[b], b - a, name=f"{a}") for a, b in pairs]
        sections = {}
        for a, _ in pairs:  # moments of inertia about d1, d2, d3; along d1, d2 and d3
            J, mass = rows[a, 7:], rows[a, 6]
            along = J.sum() / 2 - J
            sections[f"{a}"] = sc.Section(rows[a, :6], mass, along[:2])
        mesh = parts[0].joined(*parts[1:]) if parts[1:] else parts[0]
        kind = {"order": order, "director": beam["director"], "lumped": lumped}
        third = along[2] > 1e-9 * abs(along).max()
        make = (
            (lambda *a, k=float(along[2]), **o: SolidBeam(*a, third=k, **o)) if third else sc.Beam
        )
        rod = model.add(f"beam {i}", make(mesh, sections, **kind))
        places |= {("beams", i, k): rod.node(tuple(x)) for k, x in enumerate(nodes)}
    for i, each in enumerate(scene["bodies"]):
        body = sc.RigidBody(each["mass"], each["inertia"], position=each["position"])
        places["bodies", i] = model.add(f"body {i}", body)
    for i, joint in enumerate(scene["joints"]):
        a, b = (_place(places, joint[side], joint["position"]) for side in ("a", "b"))
        axis = [joint["axis"]] if joint["kind"] == "revolute" else []
        model.add(f"joint {i}", getattr(sc, f"Joint{joint['kind'].title()}")(a, b, *axis))
    for i, point in enumerate(scene["points"]):
        model.add(f"point {i}", sc.MassPoint(point["mass"], on=places[common.key(point["on"])]))
    for i, load in enumerate(scene["loads"]):
        at, pulse = (
            scene["bodies"][load["on"][1]]["position"] if load["on"][0] == "bodies" else None,
            sc.Table(load["times"], load["factors"]),
        )
        for kind, name in ((sc.LoadForce, "force"), (sc.LoadMoment, "moment")):
            if any(load[name]):
                model.add(f"{name} {i}", kind(_place(places, load["on"], at), load[name], pulse))
    if any(scene["gravity"]):
        model.add("gravity", sc.LoadGravity(scene["gravity"]))
    return model.freeze(), places[common.key(scene["watch"])]


def _place(places: dict[Any, Any], key: Any, position: Any) -> sc.Place:
    """A point of a body, a node of a beam, or one of the ground."""
    if key is None:
        return sc.ground(position)
    found = places[common.key(key)]
    return found.at(position) if key[0] == "bodies" else found


def run(scene: dict[str, Any]) -> dict[str, Any]:
    """Take all steps, as many at once as there are between two samples."""
    o = OPTIONS | scene["options"]
    text = json.dumps(
        {k: v for k, v in scene.items() if k not in ("step", "options", "until", "warm")}
    )
    built, place = system(text, o["order"], o["integrator"] in measuring.EXPLICIT)
    make, treatment = measuring.METHODS[o["integrator"]], measuring.TREATMENTS[o["treatment"]]
    own = built, make(), treatment(), scene["step"]
    # for so many steps kernels are chosen, as simulate does
    ahead = {"steps": o.get("planned", round(scene["until"] / scene["step"]))}
    ahead |= {"kernels": o["kernels"]}
    warm, stepper = Stepper(*own, **ahead), Stepper(*own, **ahead)
    state, path, seconds, counted = sc.initial_state(built), [], 0.0, np.zeros(3)
    if scene["warm"]:
        measuring.advance(warm, state, scene["warm"])
    for _ in range(round(scene["until"] / scene["sample"])):
        block = measuring.advance(stepper, state, round(scene["sample"] / scene["step"]))
        state, counted = block.state, counted + block[:3]
        path.append(sc.View(built, state).position(place).tolist())
    seconds, iterations, factorisations = counted
    more = {"unknowns": stepper.bound.unknowns, "kernels": stepper.choice.name}
    counts = {"iterations": iterations, "factorisations": factorisations}
    return common.solved(scene | {"warm": 0}, seconds, path, counts, version=sc.__version__, **more)


if __name__ == "__main__":
    common.answer(run)
