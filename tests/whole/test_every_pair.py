"""Each integrator with each treatment and each family of kernels, in three steps of one scene.

Among the quick tests whatever it costs (``quick``): what is thorough is elsewhere, and may be slow.
"""

from __future__ import annotations

import numpy as np
import pytest
from helpers_schemes import SCHEMES
from rounding import limits, nudged

import skfem_cosserat as sc

H = 2e-3
SECTION = sc.Section((2e4, 2e4, 5e4, 40.0, 60.0, 30.0), mass=1.3, inertia=(2e-3, 3e-3))
TREATMENTS = (sc.NullSpace(), sc.Multipliers())


def scene(order: int = 1, spring: bool = True, damped: bool = False) -> sc.Model:
    """A beam on a hinge, a body on its end, a mass point on a rope, in the (x, y)-plane."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="rod")
    section = SECTION.damped(time=1e-3) if damped else SECTION
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 0, 1)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    if spring:
        model.add("spring", sc.JointSpringDamper(hinge, stiffness=5.0, damping=0.1))
    box = model.add("box", sc.RigidBody.box(0.5, (0.2, 0.1, 0.1), position=(1.1, 0, 0)))
    model.add("weld", sc.JointFixed(rod.node("rod.end"), box.at((1, 0, 0))))
    bob = model.add("bob", sc.MassPoint(0.2, position=(1.1, -0.5, 0)))
    model.add("rope", sc.JointDistance(box.at((1.1, 0, 0)), bob.place()))
    model.add("gravity", sc.LoadGravity((0.3, -9.81, 0)))
    return model


@pytest.mark.parametrize("treatment", TREATMENTS, ids=repr)
@pytest.mark.parametrize("integrator", SCHEMES, ids=repr)
def test_three_steps(integrator: sc.Variational, treatment: sc.NullSpace) -> None:
    """They agree with the shortest steps of another scheme to what steps of this size leave."""
    system = scene(damped=True).freeze()
    run = sc.simulate(system, integrator, treatment, H, 3 * H, kernels="numpy")
    fine = sc.simulate(
        system, sc.EnergyMomentum(), sc.NullSpace(), H / 8, 3 * H, every=24, kernels="numpy"
    )
    moved = abs(fine["q"][-1] - fine["q"][0]).max()
    assert abs(run["q"][-1] - fine["q"][-1]).max() < 0.1 * moved


@pytest.mark.parametrize("integrator", [sc.Explicit()], ids=repr)
def test_three_steps_of_explicit_schemes(integrator: sc.Explicit) -> None:
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="rod")
    rod = model.add("rod", sc.Beam(mesh, SECTION, director=(0, 0, 1), lumped=True))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    model.add("gravity", sc.LoadGravity((0.3, -9.81, 0)))
    system = model.freeze()
    h = 0.5 * sc.Explicit.limit(system)[0]
    run = sc.simulate(system, integrator, sc.Multipliers(), h, 30 * h, kernels="numpy")
    same = sc.simulate(
        system, sc.Variational(), sc.Multipliers(), h, 30 * h, every=30, kernels="numpy"
    )
    moved = abs(same["q"][-1] - same["q"][0]).max()
    assert abs(run["q"][-1] - same["q"][-1]).max() < 0.1 * moved


@pytest.mark.parametrize("integrator", [sc.Variational(), sc.EnergyMomentum()], ids=repr)
@pytest.mark.parametrize("name", ["null space", "multipliers", "plane", "springs, damping"])
def test_compiled_kernels(name: str, integrator: sc.Variational) -> None:
    pytest.importorskip("numba")
    model = scene(spring=name == "springs, damping", damped=name == "springs, damping")
    system = model.freeze(planar=sc.Planar()) if name == "plane" else model.freeze()
    treatment = sc.Multipliers() if name == "multipliers" else sc.NullSpace()
    start = sc.initial_state(system)
    plain, compiled, beside = (
        sc.simulate(
            system, integrator, treatment, H, 3 * H, start=begin, kernels=kernels, derive=False,
            settings=sc.NewtonSettings(reuse=0),
        )
        for begin, kernels in ((start, "numpy"), (start, "numba"), (nudged(start), "numba"))
    )  # fmt: skip
    for series, limit in limits(compiled, beside).items():
        assert np.nanmax(abs(compiled[series] - plain[series])) <= limit, series


@pytest.mark.parametrize("treatment", TREATMENTS, ids=repr)
def test_rest(treatment: sc.NullSpace) -> None:
    """A cantilever under a small force at its end bends as the closed form says."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 1, name="rod")
    rod = model.add("rod", sc.Beam(mesh, SECTION, order=3, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("force", sc.LoadForce(rod.node("rod.end"), (0, 1e-3, 0)))
    path = sc.static(model, treatment=treatment)
    # directors d1 = z, d2 = y: bending about z, shear along y
    tip = 1e-3 / (3 * 40.0) + 1e-3 / 2e4
    moved = (path["q"][-1] - path["q"][0]).reshape(-1, 12)[:, 1]
    assert abs(moved).max() == pytest.approx(tip, rel=1e-6)
