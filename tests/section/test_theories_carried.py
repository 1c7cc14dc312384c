"""States carried from one theory of beams to another, on the same mesh and on others."""

from __future__ import annotations

import numpy as np
import pytest
from test_theories import PULSE, SECTION, TIP, arc, branched, cantilever, flying, looped

import skfem_cosserat as sc
from skfem_cosserat import carry_state, diagnostics
from skfem_cosserat.diagnostics.nearest import nearest_configuration

INEXTENSIBLE = sc.TheoryInextensible()
THEORIES = {
    "full": None,
    "unshearable": sc.TheoryKirchhoff(),
    "inextensible": INEXTENSIBLE,
    "untwisted": sc.TheoryInextensible(torsion=False),
    "rigid": sc.TheoryRigid(),
}


def moved(scene, theory, step=2e-3, until=0.03):
    """A system after a while, and its state."""
    system = scene(theory).freeze()
    arguments = sc.EnergyMomentum(), sc.NullSpace(), step
    run = sc.simulate(system, *arguments, until, kernels="numpy", derive=False)
    return system, sc.restart(system, run, sc.EnergyMomentum(), step)


def violations(system, state):
    """Of constraints and hidden constraints."""
    y = system.extend(state.q, state.time)
    v = sc.Projection(system)(state.q, state.p, state.time)[0]
    p = diagnostics.momentum(system, v)
    assert abs(p - state.p).max() < 1e-12 * max(1.0, abs(p).max())  # on them already
    return abs(system.constraints.values(y)).max(), abs(
        diagnostics.hidden_violation(system, state.q, v, state.time)
    ).max()


def centre(system, q):
    """Of mass, times the mass."""
    return (system.mass @ q.reshape(-1, 3))[system.origin_rows].sum(axis=0)


def on_mesh(rod, mesh, order, theory):
    """A system of the rod alone, on another mesh."""
    model = sc.Model()
    model.add("rod", rod.on_mesh(mesh, order, theory or sc.TheoryReissner()))
    return model.freeze()


@pytest.mark.slow
@pytest.mark.parametrize("after", THEORIES)
@pytest.mark.parametrize("before", THEORIES)
def test_every_theory_takes_states_of_every_other(before, after):
    """A rod in free flight, on its mesh and on another: on all constraints, in the same place."""
    source, state = moved(flying, THEORIES[before])
    rod = source.structures[0]
    for mesh in (rod.mesh, rod.mesh.refined([1])):
        target = on_mesh(rod, mesh, 2, THEORIES[after])
        carried = carry_state(source, target, state)
        g, hidden = violations(target, carried)
        assert g < 5e-12
        assert hidden < 1e-10
        if mesh is rod.mesh:
            v = sc.Projection(source)(state.q, state.p)[0]
            p = diagnostics.linear_momentum(source, diagnostics.momentum(source, v))
            assert diagnostics.linear_momentum(target, carried.p) == pytest.approx(p, abs=1e-12)
            x = centre(source, state.q)
            assert centre(target, carried.q) == pytest.approx(x, abs=1e-12)
            if {*target.structures[0].theory.held} <= {*rod.theory.held}:  # nothing to be left out
                assert abs(carried.q - state.q).max() < 1e-12
        run = sc.simulate(
            target, sc.EnergyMomentum(), sc.NullSpace(), 2e-3, 0.04, start=carried, kernels="numpy"
        )
        assert np.ptp(run["energy"]) < 1e-9 * run["energy"][0]
        assert run["constraint_violation"].max() < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("scene", [branched, looped])
def test_scenes_with_joints_and_closed_loops(scene):
    source, state = moved(scene, None)
    for theory in (sc.TheoryKirchhoff(), sc.TheoryInextensible()):
        target = scene(theory).freeze()
        carried = carry_state(source, target, state)
        g, hidden = violations(target, carried)
        assert g < 1e-12
        assert hidden < 1e-9
        assert np.array_equal(carry_state(target, source, carried).q, carried.q)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["unshearable", "inextensible"])
def test_stiff_beams_hardly_move(name):
    """What is left out is the strain that forces give: of first order in the flexibility."""
    theory = THEORIES[name]
    changes = []
    for factor in (1e2, 1e3):
        stiffness = np.diag(SECTION.stiffness).copy()
        stiffness[list(theory.held)] *= factor
        section = sc.Section(stiffness, mass=1.0, inertia=(1e-3, 2e-3))
        source, target = (cantilever(r, 2, 4, section, TIP).freeze() for r in (None, theory))
        q = sc.static(source)["q"][-1]
        carried = carry_state(source, target, sc.initial_state(source, q=q))
        changes.append(abs(carried.q - q).max())
        energy = diagnostics.strain_energy(source, q)
        lost = energy - diagnostics.strain_energy(target, carried.q)
        assert 0 < lost < energy / factor
    assert changes[0] / changes[1] == pytest.approx(10, rel=0.02)


def spinning(theory, order, elements):
    """A straight rod in free flight, pushed for a while."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, "rod")
    spin = (3.0, 2.0, 1.0)
    options = {"velocity": lambda x: np.cross(spin, x), "angular_velocity": spin}
    options |= {"director": (0, 0, 1), "order": order, "theory": theory}
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, SECTION, **options))
    model.add("push", sc.LoadForce(rod.node("rod.end"), 10 * TIP, PULSE))
    return model


@pytest.mark.slow
@pytest.mark.parametrize("name", ["unshearable", "inextensible"])
@pytest.mark.parametrize("order", [2, 3])
def test_finer_meshes_take_over_in_order_2p(order, name):
    """Strain energy and place of the end of a rod, on a mesh of twice the elements."""
    theory, changes = THEORIES[name], []
    for count in (8, 16):
        source, state = moved(lambda own, n=count: spinning(own, order, n), theory)
        rod = source.structures[0]
        target = on_mesh(rod, rod.mesh.refined(), order, theory)
        q = carry_state(source, target, state).q
        before, after = (diagnostics.strain_energy(*at) for at in ((source, state.q), (target, q)))
        end = 12 * rod.node("rod.end").vertex
        shift = abs(q[end : end + 3] - state.q[end : end + 3]).max()
        changes.append((abs(after / before - 1), shift))
    assert np.log2(np.divide(*changes)) == pytest.approx(2 * order, abs=0.1)


@pytest.mark.slow
def test_an_equilibrium_goes_on_on_another_theory():
    """It is carried near to that of the theory, nearer than it was, and the path goes on there."""
    stiffness = np.diag(SECTION.stiffness) * np.repeat([1e3, 1.0], 3)
    section = sc.Section(stiffness, mass=1.0, inertia=(1e-3, 2e-3))
    source, target = (cantilever(t, 2, 4, section, TIP).freeze() for t in (None, INEXTENSIBLE))
    path, own = (sc.static(system) for system in (source, target))
    start = carry_state(source, target, sc.equilibrium(source, path))
    before, after = (abs(q - own["q"][-1]).max() for q in (path["q"][-1], start.q))
    assert after < 0.1 * before
    control = sc.LoadControl(until=1.5, steps=1)
    on, anew = (sc.static(target, control=control, start=each)["q"][-1] for each in (start, None))
    assert abs(on - anew).max() < 1e-12


@pytest.mark.slow
def test_what_cannot_be_held_is_refused():
    """Of a bent rod one end is drawn beyond what is its length without extension."""
    away = sc.Motion(displacement=lambda t: (-0.3 * t**2, 0.3 * t**2, 0))

    def drawn(theory):
        model = arc(theory)
        rod = model["rod"]
        model.add("clamp", sc.JointFixed(sc.ground((1, 0, 0)), rod.node("rod.start")))
        model.add("support", sc.JointSpherical(sc.ground((0, 1, 0), away), rod.node("rod.end")))
        return model

    source, state = moved(drawn, None, 0.05, 1.0)
    words = r"beam 'rod': its state with TheoryReissner.* cannot be carried .* TheoryInextensible"
    with pytest.raises(sc.InputError, match=words):
        carry_state(source, drawn(INEXTENSIBLE).freeze(), state)
    assert carry_state(source, drawn(sc.TheoryKirchhoff()).freeze(), state).time == state.time


def test_nearest_configuration_is_the_least_motion():
    """Bars of a pendulum pulled apart: back along constraint forces, but for the second order."""
    model = sc.Model()
    bobs = [model.add(f"m{k}", sc.MassPoint(1.0 + k, position=(0, 0, -1.0 - k))) for k in (0, 1)]
    model.add("a", sc.JointDistance(sc.ground((0, 0, 0)), bobs[0].place()))
    model.add("b", sc.JointDistance(bobs[0].place(), bobs[1].place()))
    system = model.freeze()
    masses = np.repeat([1.0, 2.0], 3)
    left = []
    for size in (1e-2, 1e-3):
        y = system.extend(system.q0, 0.0)
        y[:2] = (0.6, 0.0, -0.8), (0.6, 0.6, -1.6)
        y[:2] += size * np.array([(1.0, 0.5, -1.0), (0.3, -0.2, -1.0)])
        found = nearest_configuration(system, y)
        assert abs(system.constraints.values(found)).max() < 1e-13
        back = (y - found)[:2].ravel()
        assert abs(back).max() > 0.5 * size
        left.append(abs(system.null_space(found[:2].ravel()).T @ (masses * back)).max())
    assert left[0] / left[1] == pytest.approx(100, rel=0.1)
