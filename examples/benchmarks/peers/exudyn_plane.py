"""Exudyn: an exact beam in the plane of the first two axes (linear), on a hinge."""

import common
import exudyn_common
import numpy as np
from exudyn_common import items

NAME = "Exudyn, exact beam in the plane"
REQUIREMENT = "exudyn==1.13.6"


def build(mbs, scene, o):
    """All items; gives the number of the node that is watched."""
    if scene["bodies"] + scene["points"] + scene["loads"] or len(scene["beams"]) != 1:
        raise common.Refused("more than one beam on a hinge")
    (beam,), (joint,) = scene["beams"], scene["joints"]
    frame, gravity = common.frame(beam), np.array(scene["gravity"])
    flat = [*np.ptp(beam["nodes"], axis=0)[2:], gravity[2], *frame[0, 2:]]
    hinge = joint["kind"] == "revolute" and not any(joint["axis"][:2])
    if any(flat) or not hinge or joint["b"] != ["beams", 0, 0]:
        raise common.Refused("not in the plane of the first two axes, on a hinge at its start")
    angle = np.arctan2(frame[2, 1], frame[2, 0])
    kind = items.NodeRigidBody2D  # bends about d2, which is the third axis
    nodes = [mbs.AddNode(kind(referenceCoordinates=[*x[:2], angle])) for x in beam["nodes"]]
    tables = [common.rows(beam, name) for name in ("mass", "inertia", "stiffness")]
    for k, (m, J, s, h) in enumerate(zip(*tables, common.lengths(beam), strict=True)):
        own = {"massPerLength": m[0], "crossSectionInertia": J[1], "bendingStiffness": s[4]}
        own |= {"axialStiffness": s[2], "shearStiffness": s[0], "length": h}
        own |= {"nodeNumbers": nodes[k : k + 2], "includeReferenceRotations": True}
        mbs.AddObject(items.ObjectBeamGeometricallyExact2D(**own))
        for node in nodes[k : k + 2]:  # as linear shape functions share the weight
            mark = mbs.AddMarker(items.MarkerNodePosition(nodeNumber=node))
            mbs.AddLoad(items.Force(markerNumber=mark, loadVector=m[0] * h / 2 * gravity))
    ground = mbs.AddNode(items.NodePointGround())
    for coordinate in (0, 1):
        ends = [
            mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=c))
            for node, c in ((ground, 0), (nodes[0], coordinate))
        ]
        mbs.AddObject(items.CoordinateConstraint(markerNumbers=ends))
    return nodes[scene["watch"][2]]


if __name__ == "__main__":
    common.answer(lambda scene: exudyn_common.solve(scene, build))
