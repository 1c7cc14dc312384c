"""Exudyn: ANCF cables (neither shear nor torsion) on a hinge, generalized-alpha."""

import common
import exudyn_common
from exudyn_common import items

NAME = "Exudyn, ANCF cable"
REQUIREMENT = "exudyn==1.13.6"


def build(mbs, scene, o):
    """All items; gives the number of the node that is watched."""
    held = [(joint["kind"], joint["b"]) for joint in scene["joints"]]
    other = scene["bodies"] + scene["points"] + scene["loads"]
    if other or len(scene["beams"]) > 1 or held != [("revolute", ["beams", 0, 0])]:
        raise common.Refused("anything but a cable on a hinge, under gravity")
    (beam,), (joint,) = scene["beams"], scene["joints"]
    along, ground = common.frame(beam)[2], mbs.AddNode(items.NodePointGround())
    kind = items.NodePointSlope1
    nodes = [mbs.AddNode(kind(referenceCoordinates=[*x, *along])) for x in beam["nodes"]]
    tables = [common.rows(beam, name) for name in ("mass", "stiffness")]
    for k, (m, s, h) in enumerate(zip(*tables, common.lengths(beam), strict=True)):
        own = {"physicsMassPerLength": m[0], "physicsBendingStiffness": s[3]}
        own |= {"physicsAxialStiffness": s[2], "physicsLength": h, "nodeNumbers": nodes[k : k + 2]}
        marker = items.MarkerBodyMass(bodyNumber=mbs.AddObject(items.Cable(**own)))
        load = {"markerNumber": mbs.AddMarker(marker), "loadVector": scene["gravity"]}
        mbs.AddLoad(items.LoadMassProportional(**load))
    # the slope may not leave the plane of the hinge, whose axis is that of a coordinate
    for k in (0, 1, 2, 3 + max(range(3), key=lambda i: abs(joint["axis"][i]))):
        ends = [
            mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=c))
            for node, c in ((ground, 0), (nodes[0], k))
        ]
        mbs.AddObject(items.CoordinateConstraint(markerNumbers=ends))
    return nodes[-1]


if __name__ == "__main__":
    common.answer(lambda scene: exudyn_common.solve(scene, build))
