"""Half models: what a mirror plane cuts is held in it, and the half moves as the whole does."""

from __future__ import annotations

import numpy as np
import pytest

import skfem_cosserat as sc

TREATMENTS = (sc.NullSpace(), sc.Multipliers())
#: mirrored at e1 = 0
MIRROR = (1.0, 0, 0)
FORCE = np.array([0.0, -6.0, 4.0])
SECTION = sc.Section([2e3, 2e3, 4e3, 10.0, 12.0, 8.0], mass=1.0, inertia=(1e-3, 2e-3))


def pulse(t):
    return np.sin(np.pi * t) ** 2


def whole(theory):
    """Half a circle from clamp to clamp with a weight on its crown, pushed out of its plane."""
    ends = (-1, 0, 0), (0, 1, 0), (1, 0, 0)
    mesh = sc.MeshCurve.init_arc(*ends, 1.0, np.pi, 6, "arch")
    model = sc.Model()
    arch = model.add("arch", sc.Beam(mesh, SECTION, order=2, director=(0, 0, 1), theory=theory))
    for name, end in (("start", ends[0]), ("end", (1.0, 0, 0))):
        model.add(f"clamp {name}", sc.JointFixed(sc.ground(end), arch.node(f"arch.{name}")))
    return loaded(model, arch.node((0, 1, 0)), 1.0)


def half(theory):
    """Its left half, of which the crown is held in the mirror plane."""
    ends = (-1, 0, 0), (0, 1, 0), (1, 0, 0)
    mesh = sc.MeshCurve.init_arc(*ends, 1.0, np.pi / 2, 3, "arch")
    model = sc.Model()
    arch = model.add("arch", sc.Beam(mesh, SECTION, order=2, director=(0, 0, 1), theory=theory))
    model.add("clamp start", sc.JointFixed(sc.ground(ends[0]), arch.node("arch.start")))
    crown = arch.node("arch.end")
    model.add("mirror", sc.JointPlanar(sc.ground((0, 1, 0)), crown, MIRROR))
    return loaded(model, crown, 0.5)


def loaded(model, crown, share):
    """With what lies on the mirror plane, of which a half model takes half."""
    model.add("weight", sc.RigidBody.sphere(0.4 * share, radius=0.2, on=crown))
    model.add("push", sc.LoadForce(crown, share * FORCE, sc.FunctionOfTime(pulse)))
    model.add("spring", sc.SpringDamper(sc.ground((0, 2, 0)), crown, 20.0 * share, 0.1 * share))
    return model


def left_half(model, history):
    """Frames (N, 7, 12) of the first 7 nodes along the arch."""
    basis = model["arch"].basis
    nodes = np.append(basis.connectivity[:3, :-1].ravel(), basis.connectivity[2, -1])
    return history["q"].reshape(len(history), -1, 12)[:, nodes]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("theory", "treatment"),
    [
        (None, TREATMENTS[0]),
        (sc.TheoryInextensible(), TREATMENTS[1]),
        pytest.param(None, TREATMENTS[1], marks=pytest.mark.slow),
        pytest.param(sc.TheoryInextensible(), TREATMENTS[0], marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_half_an_arch_moves_as_the_whole(theory, treatment):
    both = []
    for model in (whole(theory), half(theory)):
        arguments = sc.EnergyMomentum(), treatment, 0.02
        history = sc.simulate(model.freeze(), *arguments, 0.4, kernels="numpy")
        both.append((left_half(model, history), history))
    (q, run), (other, halved) = both
    assert abs(q[-1, -1] - q[0, -1]).max() > 0.03
    assert abs(q - other).max() < 1e-11
    for name in ("energy", "strain_energy", "work_loads"):
        assert 2 * halved[name] == pytest.approx(run[name], abs=1e-9)
    reaction = "joint/clamp start/moment"
    # of means of two midpoints each mesh gives its nearest multipliers, held strains' among them
    limit = 1e-8 if theory is None else 1e-5
    assert abs(run[reaction] - halved[reaction])[1:-1].max() < limit * abs(run[reaction]).max()


@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore:path, load factor")  # one large step
@pytest.mark.parametrize("treatment", TREATMENTS, ids=str)
def test_the_joint_in_the_mirror_carries_what_the_other_half_would(treatment):
    """Axial force and both bending moments of the crown; no shear, no torsion there."""
    control = sc.LoadControl(until=0.5, steps=1)
    found = []
    for model in (whole(None), half(None)):
        system = model.freeze()
        path = sc.static(system, treatment, control=control, watch=False)
        arch, q = model["arch"], path["q"][-1]
        ends = sc.diagnostics.nodal_resultants(system, arch, q, 0.5)[2, 1]
        triad = left_half(model, path)[-1, -1].reshape(4, 3)[1:]
        found.append((q, ends.reshape(2, 3) @ triad, path))
    (_, resultants, path), (_, other, halved) = found
    assert abs(left_half(whole(None), path) - left_half(half(None), halved)).max() < 1e-11
    assert other == pytest.approx(resultants, abs=1e-8)
    # on the face with the normal along the beam, here e1: what the joint gives is that on the rod
    force, moment = (halved[f"joint/mirror/{name}"][-1] for name in ("force", "moment"))
    assert abs(force[1:]).max() < 1e-9
    assert abs(moment[0]) < 1e-9
    assert force[0] == pytest.approx(resultants[0, 0], rel=1e-8)
    assert moment[1:] == pytest.approx(resultants[1, 1:], rel=1e-8, abs=1e-9)
