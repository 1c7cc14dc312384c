"""Second order of configuration, velocity, momentum and constraint forces under a ramped load."""

from itertools import pairwise

import numpy as np
import pytest
from helpers_scenes import TENSOR

import skfem_cosserat as sc

INTEGRATORS = {"variational": sc.Variational(), "energy-momentum": sc.EnergyMomentum()}
TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
SECTION = sc.Section([60, 60, 80, 3, 4, 2.5], mass=0.8, inertia=(0.05, 0.06))
UNTIL = 0.6


def ramp(t):
    """Smooth from 0 to 1 in 0.5 s, with four derivatives."""
    x = min(max(t / 0.5, 0.0), 1.0)
    return x**5 * (126 - 420 * x + 540 * x**2 - 315 * x**3 + 70 * x**4)


def cantilever():
    """Clamped curved beam with a body at its tip, forces and moments of both kinds."""
    mesh = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0.3), 1.5, 1.0, 3, "arc")
    model = sc.Model()
    beam = model.add("beam", sc.Beam(mesh, SECTION))
    tip = beam.node("arc.end")
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("arc.start")))
    body = model.add("body", sc.RigidBody(0.5, TENSOR, position=(1.5, 0.6, 0.2)))
    model.add("hinge", sc.JointRevolute(tip, body.at(tip.position), (0, 0.6, 0.8)))
    load = sc.FunctionOfTime(ramp, kinks=(0.5,))
    model.add("force", sc.LoadForce(tip, (0, 3.0, -4.0), load))
    model.add("thrust", sc.LoadForce(body.at(body.position), (1, 2, 0), load, follower=True))
    model.add("moment", sc.LoadMoment(tip, (2.0, 0, 1), load))
    model.add("line", sc.LoadLine(beam, (0, 0, -3.0), load))
    return model.freeze()


def pendulum():
    """Beam, body and bob under gravity that is switched on smoothly, from a moving support."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, "beam")
    beam = model.add("beam", sc.Beam(mesh, SECTION))
    body = model.add("body", sc.RigidBody(0.8, TENSOR, position=(1.2, 0, 0)))
    bob = model.add("bob", sc.MassPoint(0.7, (2.0, 0.3, 0)))
    shake = sc.Motion(displacement=lambda t: (0, 0.1 * ramp(t), 0))
    model.add("hook", sc.JointSpherical(sc.ground((0, 0, 0), shake), beam.node("beam.start")))
    model.add("hinge", sc.JointRevolute(beam.node("beam.end"), body.at((1, 0, 0)), (0, 1, 0)))
    model.add("string", sc.JointDistance(body.at((1.5, 0, 0)), bob.place()))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81), sc.FunctionOfTime(ramp, kinks=(0.5,))))
    return model.freeze()


SCENES = {"cantilever": (cantilever, 60), "pendulum": (pendulum, 80)}


def levels(scene, integrator, treatment):
    make, steps = SCENES[scene]
    system = make()
    runs = []
    for level in range(4):
        h = UNTIL / (steps * 2**level)
        pair = INTEGRATORS[integrator], TREATMENTS[treatment]
        # a step further: forces of the last state follow from one side, see test_constraint_forces
        runs.append(sc.simulate(system, *pair, h, UNTIL + h, at=[UNTIL - h, UNTIL]))
        assert runs[-1].times[-3:-1] == pytest.approx([UNTIL - h, UNTIL])
    return system, runs


def order(values):
    """Of the finest three of four levels, by the ratio of successive differences."""
    differences = [np.linalg.norm(b - a) for a, b in pairwise(values)]
    assert differences[0] > differences[1] > differences[2] > 0
    return np.log2(differences[1] / differences[2])


def massive(system):
    """Coordinates that have mass: the velocity of the others means nothing."""
    return np.repeat(system.mass.diagonal() > 0, 3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "integrator", "treatment"),
    [
        ("cantilever", "variational", "null space"),
        ("cantilever", "energy-momentum", "multipliers"),
        ("pendulum", "variational", "multipliers"),
        ("pendulum", "energy-momentum", "null space"),
    ],
)
def test_second_order(scene, integrator, treatment):
    """Of configurations, velocities and momenta; of reactions at the states."""
    system, runs = levels(scene, integrator, treatment)
    own = {"v": massive(system)}
    for name in ("q", "v", "Qp", "p"):
        values = [run[name][-2][own.get(name, slice(None))] for run in runs]
        assert np.isfinite(values).all()
        assert abs(order(values) - 2) < 0.1, name
    for joint in system.joints:
        for name in ("force", "moment"):
            values = [run[f"joint/{joint.name}/{name}"][-2] for run in runs]
            if abs(values[-1]).max() >= 1e-9:  # else a moment that the joint does not take
                assert abs(order(values) - 2) < 0.1, (joint.name, name)
