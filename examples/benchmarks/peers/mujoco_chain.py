"""MuJoCo: a beam, free, clamped or hinged at its start, as a chain of rigid segments.

Three hinges with springs between two segments: bending and torsion, neither shear nor extension.
Constraints that close a loop are damped springs there, whose times are twice the step or more:
scenes with loops would be others, and are refused.
"""

import common
import mujoco as mj
import numpy as np

NAME = "MuJoCo, rigid chain"
REQUIREMENT = "mujoco==3.3.7"
OPTIONS = {"integrator": "RK4"}
FREE, BALL, HINGE = mj.mjtJoint.mjJNT_FREE, mj.mjtJoint.mjJNT_BALL, mj.mjtJoint.mjJNT_HINGE


def chain(scene):
    """The model, and its segments; all axes are those of space in the reference."""
    (beam,), spec = scene["beams"], mj.MjSpec()
    nodes, d, h = np.array(beam["nodes"]), common.frame(beam), common.lengths(beam)
    m, J, s = (common.rows(beam, name) for name in ("mass", "inertia", "stiffness"))
    held = [joint["kind"] for joint in scene["joints"]]
    soft, body, segments = h[:, None] / 2 / s[:, 3:], spec.worldbody, []
    for k, x in enumerate(nodes[:-1]):
        body = body.add_body(name=f"{k}", pos=x - (nodes[k - 1] if k else 0.0))
        turned = m[k] * h[k] ** 3 / 12 * np.array([1, 1, 0]) + J[k] * h[k]  # about d1, d2, d3
        I = d.T * turned @ d  # noqa: E741
        body.mass, body.ipos, body.explicitinertial = m[k, 0] * h[k], d[2] * h[k] / 2, True
        body.fullinertia = [I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]
        segments.append(body)
        if k or held == ["fixed"]:
            for axis, c in zip(d, soft[k] + (soft[k - 1] if k else 0.0), strict=True):
                body.add_joint(type=HINGE, axis=axis, stiffness=1 / c)
        elif not held:
            body.add_joint(type=FREE)
        elif held == ["revolute"]:
            body.add_joint(type=HINGE, axis=scene["joints"][0]["axis"])
        else:
            body.add_joint(type=BALL)
    return spec, segments, h[-1] * d[2]


def run(scene):
    """Build and take all steps."""
    wrong = any(joint["a"] or joint["b"] != ["beams", 0, 0] for joint in scene["joints"])
    if wrong or len(scene["beams"]) > 1 or scene["bodies"] + scene["points"]:
        raise common.Refused("its constraints that close loops are springs and dampers")
    spec, segments, last = chain(scene)
    spec.option.timestep, spec.option.gravity = scene["step"], scene["gravity"]
    spec.option.disableflags |= mj.mjtDisableBit.mjDSBL_AUTORESET  # what is unstable fails
    name = (OPTIONS | scene["options"])["integrator"].upper()
    spec.option.integrator = getattr(mj.mjtIntegrator, f"mjINT_{name}")
    model = spec.compile()
    data, loads = mj.MjData(model), [(load, common.factor(load)) for load in scene["loads"]]
    numbers = [segment.id for segment in segments]

    def where(node):
        if node < len(numbers):
            return data.xpos[numbers[node]]
        return data.xpos[numbers[-1]] + data.xmat[numbers[-1]].reshape(3, 3) @ last

    def step(t):
        if loads:
            mj.mj_kinematics(model, data)
            mj.mj_comPos(model, data)
            data.xfrc_applied[:] = 0.0
        for load, factor in loads:
            node, now = load["on"][2], factor(t + scene["step"] / 2)
            body, force = numbers[min(node, len(numbers) - 1)], np.array(load["force"])
            moment = load["moment"] + np.cross(where(node) - data.xipos[body], force)
            data.xfrc_applied[body] += now * np.r_[force, moment]
        mj.mj_step(model, data)

    path = lambda: mj.mj_kinematics(model, data) or where(scene["watch"][2])  # noqa: E731
    return common.explicit(scene, step, path) | {"version": mj.__version__}


if __name__ == "__main__":
    common.answer(run)
