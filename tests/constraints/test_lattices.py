"""Velocities of lattices."""

import numpy as np
import pytest
from helpers_scenes import lattice_mesh
from scipy.spatial.transform import Rotation

import skfem_cosserat as sc
from skfem_cosserat.constraints import saddle
from skfem_cosserat.constraints.saddle import hidden_rate
from skfem_cosserat.integrators import choice
from skfem_cosserat.model.loops import null_space_matrix

METHODS = sc.EnergyMomentum(), sc.NullSpace()
JOINTS = 7
FLAT = sc.SectionRectangle(2e-3, 2e-2, sc.Material(E=5e6, nu=0.3, rho=1e3))


def net(kind="clamped"):
    """A lattice of flat struts that hangs on its first face."""
    model, mesh = sc.Model(), lattice_mesh(JOINTS)
    beam = model.add("net", sc.Beam(mesh, FLAT))
    shaken = sc.Motion(displacement=lambda t: (0.01 * t, 0.0, 0.0)) if kind == "moved" else None
    for k in np.flatnonzero(mesh.p[0] == 0).tolist():
        end = sc.ground(mesh.p[:, k], shaken)
        model.add(f"clamp {k}", sc.JointFixed(end, beam.node(k)))
    far = np.flatnonzero(mesh.p[0] == mesh.p[0].max()).tolist()
    if kind == "closed":
        model.add("rod", sc.JointDistance(beam.node(far[0]), beam.node(far[-1])))
    for k in far if kind == "heavy bodies" else ():
        box = model.add(f"box {k}", sc.RigidBody.box(10.0, [0.1] * 3, position=mesh.p[:, k]))
        hinge = sc.JointRevolute(beam.node(k), box.at(mesh.p[:, k]), (0, 1.0, 0))
        model.add(f"hinge {k}", hinge)
    model.add("gravity", sc.LoadGravity((0, -9.81, 0.5)))
    return model.freeze()


def turned(system, rng):
    """All rows where every vertex without a joint is turned by any angle."""
    y = system.extend(system.q0, 0.1).copy()
    joined = {spot.vertex for jr in system.joint_rows for spot in (jr.a, jr.b)}
    free = [v for v in range(len(system.origin_rows)) if v not in joined]
    rows = system.origin_rows[free][:, None] + np.arange(1, 4)
    y[rows] = y[rows] @ Rotation.random(len(free), random_state=rng).as_matrix()
    return y


def sought(system):
    """Rows at which vertices are turned anyhow, and any momentum."""
    rng = np.random.default_rng(3)
    y = turned(system, rng)
    return y, rng.normal(size=system.n) * np.repeat(system.mass.diagonal(), 3)


@pytest.mark.one_quick
@pytest.mark.parametrize("kind", ["clamped", "moved", "closed", "heavy bodies"])
def test_velocities_leave_no_momentum_along_the_constraints(kind):
    """With flat sections, on moving ground, with a closed loop, with what hangs on hinges."""
    system = net(kind)
    y, p = sought(system)
    rate = hidden_rate(system, y, 0.1)
    assert rate.any() == (kind == "moved")
    found = saddle.nearest_velocity(system, y, p, 0.1)
    expected = saddle.saddle_point(system)(y, p, rate)[0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * abs(expected).max())
    P = null_space_matrix(system, y)
    rest = P.T @ (p - (system.mass @ found.reshape(-1, 3)).ravel())
    assert abs(rest).max() < 1e-11 * abs(P.T @ p).max()
    left = system.constraints.rate(y, found.reshape(-1)) - rate
    assert abs(left).max() < 1e-11 * abs(found).max()


@pytest.mark.slow
@pytest.mark.parametrize("kernels", ["numpy", "numba"])
def test_what_a_run_derives_of_a_lattice(kernels):
    """Kernels eliminate vertex by vertex, which is not for lattices: none are taken for series."""
    if kernels == "numba":
        pytest.importorskip("numba")
    system = net()
    assert choice.motion_by_kernels(system, choice.Source.COMPILER) is None
    event = sc.Event(sc.ConditionEnergy(1e9), sc.ActionStop(), name="never")
    history = sc.simulate(system, *METHODS, 1e-3, 4e-3, events=[event], kernels=kernels)
    p = history["Qp"] - history["p"]
    v, kinetic = history["v"], history["kinetic"]
    assert abs(np.einsum("nk,nk->n", v, p)).max() < 1e-10 * kinetic.max()  # what is lost is G^T mu
