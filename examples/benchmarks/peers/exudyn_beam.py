"""Adapter: a beam in Exudyn, one run, its cost and tip as JSON on stdout.

Runs in an environment that has Exudyn and not this package: all numbers of the scene come on the
command line. Exudyn's build without range checks is taken (``sys.exudynFast``), one thread, its
default tolerances. CPU time is that of the steps after `warm` ones, without setting the solver up.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from importlib import import_module
from itertools import pairwise
from typing import Any

NODES = ("Rxyz", "EP", "RotVecLG")
SOLVERS = ("EXUdense", "EigenDense", "EigenSparse", "EigenSparseSymmetric")


def parser() -> argparse.ArgumentParser:
    """Command line; the scene: length, stiffness (6, as a section of ours), mass, inertia.

    And gravity, for a rod along the first axis on a hinge about the third; or, for a free rod in
    the plane of the first two axes, start and end, force and moment on its start, and the pulse,
    times and factors, that both follow. `rotary`: inertia of the section about its axis and about
    its two directors, instead of inertia.

    With links, too, force and moment push the middle of the rod, which has a point mass there. Each
    holds an end (low) by a hinge about the third axis, and hangs on a ball joint (high): mass,
    position of its centre, inertia about it (along the link, across it in the plane, out of it).
    """
    out = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    out.add_argument("--scene", required=True, type=json.loads, help="numbers, as JSON")
    out.add_argument("--element", choices=("exact", "cable"), default="exact")
    out.add_argument("--elements", type=int, required=True)
    out.add_argument("--node", choices=NODES, default="EP")
    out.add_argument("--newton", choices=("full", "modified"), default="modified")
    out.add_argument("--solver", choices=SOLVERS, default="EigenSparse")
    out.add_argument("--tolerance", type=float, default=1e-8, help="of the residual, relative")
    out.add_argument("--spectral-radius", type=float, default=0.9, help="of generalized-alpha")
    out.add_argument("--reuse-pattern", action="store_true", help="of the sparse factorisation")
    out.add_argument("--checked", action="store_true", help="the build with range checks")
    out.add_argument("--step", type=float, default=1e-3)
    out.add_argument("--warm", type=int, default=2, help="steps that are not timed")
    out.add_argument("--steps", type=int, required=True, help="that are timed")
    out.add_argument("--sample", type=float, default=0.0, help="interval of the tip path (s)")
    return out


def exact_beam(mbs: Any, a: argparse.Namespace) -> int:
    """Geometrically exact beams: hinged, free, or on links; the node that is looked at."""
    items: Any = import_module("exudyn.itemInterface")

    s = a.scene
    nodes = _beams(mbs, a)
    marks = [mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=node)) for node in nodes]
    if "links" in s:
        middle = len(nodes) // 2
        _hung(mbs, a, marks)
        _pushed(mbs, marks[middle], s)
        mbs.AddObject(items.ObjectRigidBody(nodeNumber=nodes[middle], mass=s["point"]))
        return nodes[middle]
    if "pulse" in s:
        _pushed(mbs, marks[0], s)
        return nodes[-1]
    ground = mbs.AddObject(items.ObjectGround())
    sides = [
        mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=[0, 0, 0])),
        marks[0],
    ]
    mbs.AddObject(items.GenericJoint(markerNumbers=sides, constrainedAxes=[1, 1, 1, 1, 1, 0]))
    for k, marker in enumerate(marks):  # gravity, as the linear shape functions share it out
        weight = s["mass"] * s["length"] / a.elements * (0.5 if k in (0, a.elements) else 1.0)
        force = [weight * g for g in s["gravity"]]
        mbs.AddLoad(items.Force(markerNumber=marker, loadVector=force))
    return nodes[-1]


def _beams(mbs: Any, a: argparse.Namespace) -> list[int]:
    """The rod, without anything that holds or pushes it; its nodes."""
    import exudyn as exu

    items: Any = import_module("exudyn.itemInterface")

    s, n = a.scene, a.elements
    shear1, shear2, axial, bend1, bend2, twist = s["stiffness"]
    section = exu.BeamSection()
    section.stiffnessMatrix = _diagonal([axial, shear1, shear2, twist, bend1, bend2])
    section.inertia = _diagonal(s.get("rotary") or [sum(s["inertia"]), *s["inertia"]])
    section.massPerLength = s["mass"]
    start, end = s.get("start", [0, 0, 0]), s.get("end", [s["length"], 0, 0])
    places = [[p + (q - p) * k / n for p, q in zip(start, end, strict=True)] for k in range(n + 1)]
    nodes = [_node(mbs, a, x, _turn(start, end)) for x in places]
    for pair in pairwise(nodes):
        beam = items.ObjectBeamGeometricallyExact(
            nodeNumbers=list(pair), length=s["length"] / n, sectionData=section
        )
        mbs.AddObject(beam)
    return nodes


def _turn(start: list[float], end: list[float]) -> float:
    """Angle of the way from one to the other about the third axis."""
    return math.atan2(end[1] - start[1], end[0] - start[0])


def _node(mbs: Any, a: argparse.Namespace, place: list[float], turn: float) -> int:
    """A node of the kind asked for, turned about the third axis."""
    kind = getattr(import_module("exudyn.itemInterface"), f"NodeRigidBody{a.node}")
    rotation = [0, 0, turn]
    if a.node == "EP":
        rotation = [math.cos(turn / 2), 0, 0, math.sin(turn / 2)]
    return int(mbs.AddNode(kind(referenceCoordinates=[*place, *rotation])))


def _hung(mbs: Any, a: argparse.Namespace, marks: list[int]) -> None:
    """Links: rigid, hinged about the third axis to an end of the rod, and on a ball joint above."""
    items: Any = import_module("exudyn.itemInterface")

    ground = mbs.AddObject(items.ObjectGround())
    for link, own in zip(a.scene["links"], (marks[0], marks[-1]), strict=True):
        turn = _turn(link["low"], link["high"])
        node = _node(mbs, a, link["position"], turn)
        body = mbs.AddObject(
            items.ObjectRigidBody(
                nodeNumber=node, mass=link["mass"], inertia=[*link["inertia"], 0, 0, 0]
            )
        )
        below, above = (math.dist(link["position"], link[end]) for end in ("low", "high"))
        low, high = (
            mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=[x, 0, 0]))
            for x in (-below, above)
        )
        held = items.MarkerBodyRigid(bodyNumber=ground, localPosition=link["high"])
        mbs.AddObject(items.ObjectJointRevoluteZ(markerNumbers=[low, own]))
        mbs.AddObject(items.ObjectJointSpherical(markerNumbers=[mbs.AddMarker(held), high]))


def _pushed(mbs: Any, marker: int, s: dict[str, Any]) -> None:
    """Force and moment on a marker, which grow and fall with the pulse."""
    items: Any = import_module("exudyn.itemInterface")

    def factor(t: float) -> float:
        for (t0, f0), (t1, f1) in pairwise(zip(*s["pulse"], strict=True)):
            if t0 <= t <= t1:
                return float(f0 + (f1 - f0) * (t - t0) / (t1 - t0))
        return 0.0

    def now(mbs: Any, t: float, vector: list[float]) -> list[float]:
        scale = factor(t)
        return [scale * x for x in vector]

    for kind, vector in ((items.Force, s["force"]), (items.Torque, s["moment"])):
        mbs.AddLoad(kind(markerNumber=marker, loadVector=vector, loadVectorUserFunction=now))


def cable(mbs: Any, a: argparse.Namespace) -> int:
    """ANCF cables (neither shear nor torsion) on a hinge; the node that is looked at."""
    items: Any = import_module("exudyn.itemInterface")

    s, n = a.scene, a.elements
    nodes = [
        mbs.AddNode(
            items.NodePointSlope1(referenceCoordinates=[s["length"] * k / n, 0, 0, 1, 0, 0])
        )
        for k in range(n + 1)
    ]
    for pair in pairwise(nodes):
        body = mbs.AddObject(
            items.ObjectANCFCable(
                length=s["length"] / n,
                massPerLength=s["mass"],
                bendingStiffness=s["stiffness"][3],
                axialStiffness=s["stiffness"][2],
                nodeNumbers=list(pair),
            )
        )
        marker = mbs.AddMarker(items.MarkerBodyMass(bodyNumber=body))
        mbs.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=s["gravity"]))
    ground = mbs.AddMarker(
        items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0)
    )
    for k in (0, 1, 2, 5):  # place, and the slope out of the plane of the hinge
        end = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=k))
        mbs.AddObject(items.CoordinateConstraint(markerNumbers=[ground, end]))
    return int(nodes[-1])


def _diagonal(values: list[float]) -> list[list[float]]:
    return [[v if i == k else 0.0 for k in range(len(values))] for i, v in enumerate(values)]


def settings(a: argparse.Namespace, steps: int) -> Any:
    """Of the solver, to the end of as many steps."""
    import exudyn as exu

    out = exu.SimulationSettings()
    t = out.timeIntegration
    t.numberOfSteps, t.endTime = steps, a.step * steps
    t.newton.useModifiedNewton = a.newton == "modified"
    t.newton.relativeTolerance = a.tolerance
    t.generalizedAlpha.spectralRadius = a.spectral_radius
    t.adaptiveStep = False  # steps of the size asked for, or none
    t.verboseMode = 0
    out.linearSolver.solverType = getattr(exu.LinearSolverType, a.solver)
    out.linearSolver.reuseAnalyzedPattern = a.reuse_pattern
    out.parallel.numberOfThreads = 1
    out.solution.file.write = False
    if a.sample > 0:
        out.solution.sensors.writePeriod = a.sample
    return out


def _mass(mbs: Any, solver: Any) -> float:
    """All mass that moves along the first axis (kg): a check of the scene."""
    solver.ComputeMassMatrix(mbs)
    matrix = solver.GetSystemMassMatrix()
    first = [mbs.GetNodeODE2Index(k) for k in range(mbs.systemData.NumberOfNodes())]
    return float(sum(matrix[i, k] for i in first for k in first))


def run(a: argparse.Namespace) -> dict[str, Any]:
    """Time of a step and of a Newton iteration, their numbers, the tip."""
    if not a.checked:
        sys.exudynFast = True  # type: ignore[attr-defined]
    import exudyn as exu

    items: Any = import_module("exudyn.itemInterface")

    mbs = exu.SystemContainer().AddSystem()
    watched = {"exact": exact_beam, "cable": cable}[a.element](mbs, a)
    position = exu.OutputVariableType.Position
    if a.sample > 0:
        tip = {"nodeNumber": watched, "outputVariableType": position}
        sensor = mbs.AddSensor(items.SensorNode(**tip, storeInternal=True, writeToFile=False))
    mbs.Assemble()
    stamps: list[tuple[float, int, int]] = []
    solver = exu.MainSolverImplicitSecondOrder()

    def started(system: Any, now: float) -> bool:
        k = round(now / a.step)  # time at the end of the step
        if k == a.warm + 1:
            count = solver.it.newtonStepsCount, solver.it.newtonJacobiCount
            stamps.append((time.process_time(), *count))
        return True

    mbs.SetPreStepUserFunction(started)
    own = settings(a, a.warm + a.steps)
    if not solver.InitializeSolver(mbs, own):
        return {"status": "the solver could not be set up"}
    done = solver.SolveSteps(mbs, own)
    end = time.process_time()
    mass = _mass(mbs, solver) if a.element == "exact" else None
    solver.FinalizeSolver(mbs, own)
    if not done or not stamps:
        return {"status": f"stopped at {solver.it.currentTime:.6g} s"}
    begun, iterations, jacobians = stamps[0]
    iterations = solver.it.newtonStepsCount - iterations
    jacobians = solver.it.newtonJacobiCount - jacobians
    path = mbs.GetSensorStoredData(sensor).tolist() if a.sample > 0 else None
    return {
        "status": "completed",
        "version": exu.config.Version(),
        "ms_per_step": 1e3 * (end - begun) / a.steps,
        "cpu_s": end - begun,
        "iterations_per_step": iterations / a.steps,
        "factorisations_per_step": jacobians / a.steps,
        "steps": a.steps,
        "mass": mass,
        "tip": [float(x) for x in mbs.GetNodeOutput(watched, position)],
        "path": path,
    }


def main() -> None:
    """Keep stdout for the answer: the code prints to it as well."""
    answer = os.dup(1)
    os.dup2(2, 1)
    arguments = parser().parse_args()
    try:
        found = run(arguments)
    except (RuntimeError, ValueError) as error:  # what its solvers raise
        found = {"status": " ".join(str(error).split())[:200] or "failed"}
    with os.fdopen(answer, "w") as file:
        json.dump(found, file)


if __name__ == "__main__":
    main()
