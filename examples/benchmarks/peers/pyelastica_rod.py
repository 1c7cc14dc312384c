"""PyElastica: a rod, free, clamped or hinged at its start; position Verlet, explicit.

Its joints between rods are springs and dampers of a stiffness that one has to choose: scenes with
such joints would be others, and are refused.
"""

from importlib.metadata import version

import common
import elastica as ea
import numpy as np

NAME = "PyElastica"
REQUIREMENT = "pyelastica==1.0.0"


class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing):
    """What takes part."""


class Push(ea.NoForces):
    """Force and moment on a node, in time."""

    def __init__(self, load, element):
        super().__init__()
        self.node, self.element, self.factor = load["on"][2], element, common.factor(load)
        self.force, self.moment = np.array(load["force"]), np.array(load["moment"])

    def apply_forces(self, system, time=0.0):
        """On the node."""
        system.external_forces[:, self.node] += self.factor(time) * self.force

    def apply_torques(self, system, time=0.0):
        """On the element there, in its frame."""
        frame = system.director_collection[..., self.element]
        system.external_torques[:, self.element] += self.factor(time) * (frame @ self.moment)


def run(scene):
    """Build and take all steps."""
    if len(scene["beams"]) > 1 or scene["bodies"] or scene["points"]:
        raise common.Refused("its joints are springs and dampers, not constraints")
    (beam,), d = scene["beams"], common.frame(scene["beams"][0])
    nodes, h, last = beam["nodes"], common.lengths(beam), len(beam["nodes"]) - 2
    m, J, s = (common.rows(beam, name) for name in ("mass", "inertia", "stiffness"))
    base = {"youngs_modulus": 1.0, "shear_modulus": 1.0, "density": 1.0}  # replaced below
    ends = np.array(nodes[0]), d[2], d[0], h.sum(), 0.01 * h.sum()
    rod = ea.CosseratRod.straight_rod(last + 1, *ends, **base)
    rod.mass[:] = 0.0
    rod.mass[:-1] += m[:, 0] * h / 2
    rod.mass[1:] += m[:, 0] * h / 2
    for k in range(3):  # about d1, d2, d3; shear along d1, d2, and axial
        rod.mass_second_moment_of_inertia[k, k] = J[:, k] * h
        rod.inv_mass_second_moment_of_inertia[k, k] = 1 / (J[:, k] * h)
        rod.shear_matrix[k, k] = s[:, k]
        pair = s[:-1, 3 + k], s[1:, 3 + k]  # one after the other over a node
        rod.bend_matrix[k, k] = (h[:-1] + h[1:]) / (h[:-1] / pair[0] + h[1:] / pair[1])
    simulator = Simulator()
    simulator.append(rod)
    for joint in scene["joints"]:
        if joint["a"] is not None or joint["b"] != ["beams", 0, 0]:
            raise common.Refused("a joint that does not hold the start of the rod")
        held = [True] * 3 if joint["kind"] == "fixed" else [not x for x in joint["axis"]]
        free = {"constrained_position_idx": (0,), "constrained_director_idx": (0,)}
        free["rotational_constraint_selector"] = np.array(held)
        simulator.constrain(rod).using(ea.GeneralConstraint, **free)
    if any(scene["gravity"]):
        gravity = {"acc_gravity": np.array(scene["gravity"])}
        simulator.add_forcing_to(rod).using(ea.GravityForces, **gravity)
    for load in scene["loads"]:
        simulator.add_forcing_to(rod).using(Push, load, min(load["on"][2], last))
    simulator.finalize()
    stepper, watched = ea.PositionVerlet(), scene["watch"][2]
    step = lambda t: stepper.step(simulator, np.float64(t), np.float64(scene["step"]))  # noqa: E731
    path = lambda: rod.position_collection[:, watched]  # noqa: E731
    return common.explicit(scene, step, path) | {"version": version("pyelastica")}


if __name__ == "__main__":
    common.answer(run)
