"""Exudyn: exact beams (linear), rigid bodies, joints by constraints, generalized-alpha."""

import common
import exudyn_common
import numpy as np
from exudyn import rigidBodyUtilities
from exudyn_common import exu, items

NAME = "Exudyn, exact beam"
REQUIREMENT = "exudyn==1.13.6"
ANGLES = {"EP": "EulerParameters", "Rxyz": "RotXYZ", "RotVecLG": "RotationVector"}
HELD = {"fixed": [1] * 6, "spherical": [1, 1, 1, 0, 0, 0]}


def build(mbs, scene, o):  # noqa: PLR0912
    """All items; gives the number of the node that is watched."""
    ground = mbs.AddObject(items.ObjectGround())
    places = {None: (None, ground, np.zeros(3), np.eye(3))}  # node, body, position, x, y, z of it
    masses = []
    for i, beam in enumerate(scene["beams"]):
        turned = common.frame(beam)[[2, 0, 1]].T  # its x is along the beam
        kind = getattr(items, f"NodeRigidBody{o['node']}")
        angles = getattr(rigidBodyUtilities, f"RotationMatrix2{ANGLES[o['node']]}")(turned)
        for k, x in enumerate(beam["nodes"]):
            node = mbs.AddNode(kind(referenceCoordinates=[*x, *angles]))
            places["beams", i, k] = node, None, x, turned
        tables = [common.rows(beam, name) for name in ("mass", "inertia", "stiffness")]
        for k, (m, J, s, h) in enumerate(zip(*tables, common.lengths(beam), strict=True)):
            section, pair = exu.BeamSection(), [places["beams", i, j][0] for j in (k, k + 1)]
            section.stiffnessMatrix = np.diag(s[[2, 0, 1, 5, 3, 4]])
            section.inertia, section.massPerLength = np.diag(J[[2, 0, 1]]), m[0]
            exact = items.ObjectBeamGeometricallyExact
            mbs.AddObject(exact(nodeNumbers=pair, length=h, sectionData=section))
            masses += [(node, m[0] * h / 2) for node in pair]  # as linear shape functions share it
    for i, body in enumerate(scene["bodies"]):
        x, J = body["position"], np.array(body["inertia"])
        node = mbs.AddNode(items.NodeRigidBodyEP(referenceCoordinates=[*x, 1, 0, 0, 0]))
        own = {"mass": body["mass"], "inertia": [*J.diagonal(), J[1, 2], J[0, 2], J[0, 1]]}
        rigid = mbs.AddObject(items.ObjectRigidBody(nodeNumber=node, **own))
        places["bodies", i] = node, rigid, x, np.eye(3)
        masses.append((node, body["mass"]))
    for point in scene["points"]:
        node, mass = places[common.key(point["on"])][0], point["mass"]
        mbs.AddObject(items.ObjectRigidBody(nodeNumber=node, mass=mass))
        masses.append((node, mass))
    for node, mass in masses if any(scene["gravity"]) else ():
        mark = mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=node))
        mbs.AddLoad(items.Force(markerNumber=mark, loadVector=mass * np.array(scene["gravity"])))
    for joint in scene["joints"]:
        ends = [places[common.key(joint[side])] for side in ("a", "b")]
        joined = {"markerNumbers": [_marker(mbs, end, joint["position"]) for end in ends]}
        for k, end in enumerate(ends):
            joined[f"rotationMarker{k}"] = end[3].T @ common.axes(joint.get("axis", [0, 0, 1])).T
        if joint["kind"] == "revolute":
            mbs.AddObject(items.ObjectJointRevoluteZ(**joined))
        else:
            mbs.AddObject(items.GenericJoint(**joined, constrainedAxes=HELD[joint["kind"]]))
    for load in scene["loads"]:
        node, factor = places[common.key(load["on"])][0], common.factor(load)
        now = lambda mbs, t, v, factor=factor: [factor(t) * x for x in v]  # noqa: E731
        for kind, vector in ((items.Force, load["force"]), (items.Torque, load["moment"])):
            mark = mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=node))
            if any(vector):
                own = {"loadVector": vector, "loadVectorUserFunction": now}
                mbs.AddLoad(kind(markerNumber=mark, **own))
    return places[common.key(scene["watch"])][0]


def _marker(mbs, end, position):
    node, body, at, _ = end
    if body is None:
        return mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=node))
    arm = np.subtract(position, at)
    return mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=arm))


if __name__ == "__main__":
    common.answer(lambda scene: exudyn_common.solve(scene, build))
