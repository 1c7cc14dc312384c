"""What both adapters of Exudyn share: its solver."""

import sys
import time

import common
import numpy as np

sys.exudynFast = True  # the build without range checks

import exudyn as exu  # noqa: E402
from exudyn import itemInterface as items  # noqa: E402, N813

#: solver, relative tolerance of the residual, spectral radius
OPTIONS = {"node": "EP", "newton": "modified", "solver": "EigenSparse", "reuse_pattern": True}
OPTIONS |= {"tolerance": 1e-8, "radius": 0.9}


def solve(scene, build):
    """Run the system that `build` makes: cost, iterations, positions of the node it gives."""
    o = OPTIONS | scene["options"]
    mbs, position = exu.SystemContainer().AddSystem(), exu.OutputVariableType.Position
    watched = {"nodeNumber": build(mbs, scene, o), "outputVariableType": position}
    sensor = mbs.AddSensor(items.SensorNode(**watched, storeInternal=True, writeToFile=False))
    mbs.Assemble()
    settings, solver, stamps = exu.SimulationSettings(), exu.MainSolverImplicitSecondOrder(), []
    t = settings.timeIntegration
    t.numberOfSteps, t.endTime = round(scene["until"] / scene["step"]), scene["until"]
    t.newton.useModifiedNewton = o["newton"] == "modified"
    t.newton.relativeTolerance, t.generalizedAlpha.spectralRadius = o["tolerance"], o["radius"]
    t.adaptiveStep = False  # steps of the size asked for, or none
    t.verboseMode, settings.parallel.numberOfThreads = 0, 1
    settings.linearSolver.solverType = getattr(exu.LinearSolverType, o["solver"])
    settings.linearSolver.reuseAnalyzedPattern = o["reuse_pattern"]
    settings.solution.file.write, settings.solution.sensors.writePeriod = False, scene["sample"]

    def counts():
        it = solver.it
        return np.array([time.process_time(), it.newtonStepsCount, it.newtonJacobiCount])

    def started(system, now):  # `now`: the end of the step
        if round(now / scene["step"]) == scene["warm"] + 1:
            stamps.append(counts())
        return True

    mbs.SetPreStepUserFunction(started)
    if not solver.InitializeSolver(mbs, settings):
        return {"status": "stopped: the solver could not be set up"}
    done = solver.SolveSteps(mbs, settings)
    stamps.append(counts())
    solver.FinalizeSolver(mbs, settings)
    if not done:
        return {"status": f"stopped at {solver.it.currentTime:.6g} s"}
    path = mbs.GetSensorStoredData(sensor)
    instants = scene["sample"] * np.arange(1, round(scene["until"] / scene["sample"]) + 1)
    near = abs(path[:, :1] - instants).argmin(axis=0)
    if abs(path[near, 0] - instants).max() > 1e-6:
        return {"status": "failed: no positions at the instants"}
    seconds, iterations, factorisations = stamps[-1] - stamps[0]
    counted = {"iterations": iterations, "factorisations": factorisations}
    more = {"version": exu.config.Version()}
    return common.solved(scene, seconds, path[near, 1:4].tolist(), counted, **more)
