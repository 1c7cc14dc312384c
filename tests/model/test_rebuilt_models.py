"""A scene with other beams: the same one where nothing differs, and never a change of the first."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_scenes import model_of_everything, swing_model

from skfem_cosserat import (
    Beam,
    EnergyMomentum,
    Foundation,
    InputError,
    JointDrive,
    JointRevolute,
    JointSpringDamper,
    LoadForce,
    LoadGravity,
    LoadLine,
    Material,
    MeshCurve,
    Model,
    NullSpace,
    RayleighDamping,
    RigidBody,
    SectionCircle,
    SensorPosition,
    ground,
    initial_state,
    project,
    simulate,
)
from skfem_cosserat.mesh import divided

RUBBER = SectionCircle(5e-3, Material(E=5e6, nu=0.5, rho=1100))


def run(model: Model, steps: int = 5, step: float = 1e-3, **options):
    system = model.freeze()
    start = initial_state(system, v=project(system, system.q0, system.v0))
    run = system, EnergyMomentum(), NullSpace(), step, steps * step
    return simulate(*run, start=start, **options)


def driven(elements: int, order: int = 1) -> Model:
    """A curved rod in a bed, driven, damped, with a spring on its hinge and a ball on its end."""
    mesh = MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.0, 0.8, elements, "rod")
    model = Model()
    rod = model.add("rod", Beam(mesh, RUBBER, order=order, angular_velocity=(0, 0, 0)))
    pin = model.add("pin", JointRevolute(ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1)))
    model.add("motor", JointDrive(pin, lambda t: 3.0 * t**2))
    model.add("ball", RigidBody.sphere(0.05, radius=0.02, on=rod.node("rod.end")))
    end = rod.node("rod.end")
    tail = RigidBody.box(0.1, (0.1, 0.1, 0.1), position=end.position)
    model.add("tail", tail)
    hinge = model.add("hinge", JointRevolute(end, tail.local((0, 0, 0)), axis=(1, 0, 0)))
    model.add("spring", JointSpringDamper(hinge, stiffness=0.5, damping=0.01))
    model.add("bed", Foundation(rod, stiffness=20.0, damping=0.1, part="rod"))
    model.add("line", LoadLine(rod, (0, 0.3, 0.1), part="rod", follower=True))
    model.add("push", LoadForce(end, (0.1, 0, 0.2), follower=True))
    model.add("weight", LoadGravity((0, 0, -9.81)))
    model.add("damping", RayleighDamping(stiffness=1e-3, items=[rod]))
    return model


@pytest.mark.slow
@pytest.mark.parametrize("make", [lambda: model_of_everything(2), lambda: driven(3, 2)])
def test_nothing_replaced_is_the_same_scene(make):
    model = make()
    other = model.with_items({})
    assert list(other) == list(model)
    assert not any(other[name] is model[name] for name in model)
    first, second = run(model), run(other)
    for name in ("q", "p"):
        np.testing.assert_array_equal(first[name], second[name])


@pytest.mark.slow
@pytest.mark.parametrize(("elements", "order"), [(2, 1), (3, 2), (5, 3), (9, 1)])
def test_on_another_mesh_it_is_the_scene_built_there(elements, order):
    """Sensors go along."""
    model, built = driven(4, 2), driven(elements, order)
    rod = model["rod"]
    sensor, own = (SensorPosition(each["rod"], 0.3) for each in (model, built))
    finer = rod.on_mesh(divided(rod.mesh, elements), order)
    other, replacements = model.rebuilt({"rod": finer})
    made = run(other, sensors={"x": replacements.of(sensor)})
    expected = run(built, sensors={"x": own})
    scale = abs(expected["p"]).max()
    np.testing.assert_allclose(made["q"], expected["q"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(made["p"], expected["p"], rtol=0, atol=1e-8 * scale)
    seen, direct = (history.sensors["x"].values for history in (made, expected))
    np.testing.assert_allclose(seen, direct, atol=1e-10)
    assert rod.mesh.nelements == 4


@pytest.mark.slow
def test_swing_of_straight_chords_gets_coarser():
    model = swing_model(20)
    beam = model["beam"]
    other = model.with_items({"beam": beam.on_mesh(divided(beam.mesh, 8))})
    built, made = run(swing_model(8), 20, 1e-2), run(other, 20, 1e-2)
    for name in ("energy", "angular_momentum"):
        np.testing.assert_allclose(made[name], built[name], rtol=1e-7, atol=1e-7)


@pytest.mark.slow
def test_a_body_for_a_beam_moves_alike_in_whatever_triad():
    """Follower loads, lumps and joints on turned triads are at the same material points."""
    model, whole = Model(), model_of_everything(1).with_items({})
    for name in whole:
        if name not in ("line", "pressure"):  # no body has a line
            vars(whole[name]).update(name=None)  # in no model any more
            model.add(name, whole[name])
    middle = model["curved"].basis.nodes.mean(axis=0)
    results = []
    for triad, shift in ((np.eye(3), 0.0), (np.eye(3)[[1, 2, 0]], 0.3)):
        position = middle + (0, shift, 0)
        inertia = triad @ np.diag([0.3, 0.4, 0.5]) @ triad.T
        center = triad @ (middle - position)
        body = RigidBody(2.0, inertia, position=position, triad=triad, center=center)
        history = run(model.with_items({"curved": body}), 20)
        results.append(np.stack([history["energy"], history["joint/joint 1/angle"]]))
    np.testing.assert_allclose(*results, rtol=1e-9, atol=1e-10)


def test_division_keeps_corners_names_and_places():
    corner = [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
    mesh = MeshCurve.init_polyline(corner, 6, name="frame", nodes={"hook": 0.25})
    coarse, kept = divided(mesh, 2), divided(mesh, 2, keep=[(8, 0.5)])
    assert (coarse.nelements, kept.nelements) == (3, 4)
    np.testing.assert_allclose(coarse.p[:, coarse.node("hook")], (0.5, 0, 0), atol=1e-15)
    assert kept.node((1.0, 2.5 / 6, 0)) >= 0
    ring = MeshCurve.init_arc((1, 0, 0), (0, 1, 0), (-1, 0, 0), 1.0, 2 * np.pi, 24, "ring")
    assert divided(ring, 1).nelements == 3
    assert divided(ring, 48).lengths == pytest.approx(2 * np.pi / 48, rel=1e-12)


@pytest.mark.parametrize(
    ("replaced", "words"),
    [
        (lambda rod: {"bar": rod.refined(1)}, "unknown name 'bar'"),
        (lambda rod: {"rod": rod}, "'rod': is already in a model"),
        (lambda rod: {"pin": rod.refined(1)}, "'pin': the .* expected a beam or rigid body"),
        (
            lambda rod: {"rod": rod.on_mesh(divided(rod.mesh, 3))},
            "has no node at .*, where something is attached",
        ),
        (lambda rod: {"rod": rod.on_mesh(divided(rod.mesh, 0))}, "number of elements is 0"),
    ],
)
def test_bad_replacements_are_named(replaced, words):
    model = driven(4)
    rod = model["rod"]
    model.add("extra", LoadForce(rod.node(1), (0, 0, 1.0)))
    with pytest.raises(InputError, match=words):
        model.with_items(replaced(rod))
