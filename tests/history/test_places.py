"""Points are read by their places; public functions take a Model or a System, and look at both."""

from __future__ import annotations

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.model import model_of, system_of

SECTION = sc.Section([1e4, 1e4, 1e4, 50, 50, 50], mass=1.0, inertia=(0.1, 0.1))


def scene(elements: int = 2, motion: sc.Motion | None = None):
    """Two rods of order 2 in a row, with an eccentric body and a mass point, on a hinge."""
    model, items = sc.Model(), {}
    base = sc.ground((0, 0, 0), motion)
    first = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="first")
    second = sc.MeshCurve.init_line((1, 0, 0), (1, 1, 0), elements + 1, name="second")
    for name, mesh in (("first", first), ("second", second)):
        beam = sc.Beam(mesh, SECTION, order=2, director=(0, 0, 1))
        items[name] = model.add(name, beam)
    ends = items["first"].node("first.end"), items["second"].node("second.start")
    model.add("hinge", sc.JointSpherical(base, items["first"].node("first.start")))
    model.add("weld", sc.JointFixed(*ends))
    items["box"] = model.add("box", sc.RigidBody.box(1.0, (0.2, 0.2, 0.2), position=(1, 1.1, 0)))
    hook = items["box"].at((1, 1, 0)), items["second"].node("second.end")
    model.add("hook", sc.JointSpherical(*hook))
    items["ball"] = model.add("ball", sc.MassPoint(0.5, position=(2, 1, 0), velocity=(0, 0, 1.0)))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    items["base"] = base
    return model, items


@pytest.fixture(scope="module")
def run():
    model, items = scene()
    scheme = sc.EnergyMomentum(), sc.NullSpace()
    sensors = {
        "corner": sc.SensorPosition(items["box"].at((1.1, 1.2, 0.1))),
        "inside": sc.SensorPosition(items["second"], s=0.37),
    }
    history = sc.simulate(model, *scheme, 0.01, 0.1, sensors=sensors, kernels="numpy")
    return model, items, history


def test_positions_are_those_of_sensors(run):
    _, items, history = run
    corner = history.position(items["box"].at((1.1, 1.2, 0.1)))
    inside = history.position(items["second"], s=0.37)
    assert corner.shape == inside.shape == (11, 3)
    assert abs(corner - history.sensors["corner"].values).max() < 1e-14
    assert abs(inside - history.sensors["inside"].values).max() < 1e-14
    both = history.position(items["second"], s=[0.37, 1.0], part="second")
    assert both.shape == (11, 2, 3)
    assert np.array_equal(both[:, 0], inside)
    end = history.position(items["second"].node("second.end"))
    assert abs(both[:, 1] - end).max() < 1e-14
    assert abs(end[-1] - end[0]).max() > 1e-3
    assert history.position(items["ball"].place())[-1] == pytest.approx(
        [2, 1, 0.1 - 9.81 * 0.1**2 / 2], abs=1e-10
    )


def test_velocities_follow_the_positions(run):
    _, items, history = run
    for where in ((items["box"].at((1.1, 1.2, 0.1)),), (items["second"], 0.37)):
        x, v = history.position(*where), history.velocity(*where)
        between = np.diff(x, axis=0) / 0.01
        assert abs(between - (v[1:] + v[:-1]) / 2).max() < 1e-2 * abs(v).max()


def test_rows_of_rotations_are_directors(run):
    model, items, history = run
    end = items["second"].node("second.end")
    found = history.rotation(end)
    assert found.shape == (11, 3, 3)
    assert np.array_equal(found[0], end.triad)
    system = model.freeze()
    assert np.array_equal(found.reshape(11, 9), history["q"][:, system.dofs(end)[3:]])
    inside = history.rotation(items["second"], s=[0.2, 0.9])
    assert inside.shape == (11, 2, 3, 3)
    assert abs(inside @ np.swapaxes(inside, -1, -2) - np.eye(3)).max() < 1e-13
    beam = items["second"]
    want = diagnostics.evaluate(
        model, beam, history["q"], *beam.along([0.2, 0.9]), orthonormal=True
    )
    assert abs(inside - want.triad).max() < 1e-14


def test_a_view_reads_the_same(run):
    model, items, history = run
    corner = items["box"].at((1.1, 1.2, 0.1))
    view = sc.View(model, sc.initial_state(model))
    assert np.array_equal(view.position(corner), history.position(corner)[0])
    assert np.array_equal(view.rotation(corner), history.rotation(corner)[0])
    with pytest.raises(sc.InputError, match="a mass point has no directors"):
        view.rotation(items["ball"].place())


def test_files_are_read_with_the_scene_built_anew(run, tmp_path):
    _, items, history = run
    history.save(tmp_path / "run.history")
    loaded, (_, others) = sc.History.load(tmp_path / "run.history"), scene()
    for read in ("position", "rotation", "velocity"):
        for pick in (lambda i: (i["box"].at((1.1, 1.2, 0.1)),), lambda i: (i["second"], 0.3)):
            want = getattr(history, read)(*pick(items))
            assert np.array_equal(getattr(loaded, read)(*pick(others)), want)


def test_items_of_other_scenes_are_refused(run):
    _, items, history = run
    other = sc.Model().add("stranger", sc.MassPoint(1.0))
    with pytest.raises(sc.InputError, match=r"mass point 'stranger'.*not in this history.*ball"):
        history.position(other.place())
    _, finer = scene(elements=3)
    for place in (3, "second.end"):  # the number of the end is beyond that of the history
        with pytest.raises(sc.InputError, match=r"beam 'second'.*is another one|another mesh"):
            history.position(finer["second"].node(place))
    with pytest.raises(sc.InputError, match="argument s: is missing"):
        history.position(items["second"])
    with pytest.raises(sc.InputError, match=r"of type int, expected beam\.node"):
        history.position(3)
    with pytest.raises(sc.InputError, match="a mass point has no directors"):
        history.rotation(items["ball"].place())
    with pytest.raises(sc.InputError, match="is for beams"):
        history.position(items["ball"].place(), s=0.1)


def test_velocities_that_were_not_derived():
    model, items = scene()
    scheme = sc.EnergyMomentum(), sc.NullSpace()
    history = sc.simulate(model, *scheme, 0.01, 0.02, derive=False, kernels="numpy")
    with pytest.raises(sc.InputError, match=r"series .v.*derive=False"):
        history.velocity(items["ball"].place())
    v = sc.Projection(model).stack(history["q"], history["p"], history.times)[0]
    history.add_series("v", v)
    assert history.velocity(items["ball"].place())[0].tolist() == [0, 0, 1]


def test_places_of_the_ground():
    motion = sc.Motion(lambda t: (0.0, 0.0, t**2), lambda t: (0.0, 0.0, t))
    model, items = scene(motion=motion)
    scheme = sc.EnergyMomentum(), sc.NullSpace()
    history = sc.simulate(model, *scheme, 0.01, 0.05, kernels="numpy")
    t = history.times
    start = history.position(items["first"].node("first.start"))
    assert abs(history.position(items["base"]) - start).max() < 1e-9
    assert abs(history.position(items["base"])[:, 2] - t**2).max() < 1e-15
    assert abs(history.velocity(items["base"])[:, 2] - 2 * t).max() < 1e-9
    assert abs(history.rotation(items["base"])[:, 0, 1] - np.sin(t)).max() < 1e-15


def cantilever(motion: sc.Motion | None = None):
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    rod = model.add("rod", sc.Beam(mesh, SECTION, director=(0, 0, 1)))
    base = sc.ground((0, 0, 0), motion)
    model.add("clamp", sc.JointFixed(base, rod.node("rod.start")))
    model.add("push", sc.LoadForce(rod.node("rod.end"), (0, 0, 1.0)))
    return model, rod, base


def test_paths_and_modes_are_read_alike():
    model, rod, base = cantilever(sc.Motion(lambda t: (0.0, 0.5 * t, 0.0)))
    path = sc.static(model, control=sc.LoadControl(steps=2))
    factor = path["load_factor"]
    assert abs(path.position(base)[:, 1] - 0.5 * factor).max() < 1e-15
    assert abs(path.position(rod.node("rod.start")) - path.position(base)).max() < 1e-9
    end = rod.node("rod.end")
    assert path.position(end)[-1, 2] == pytest.approx(1 / (3 * 50), rel=0.05)
    assert not path.velocity(end).any()
    assert not path.velocity(base).any()
    model, rod, base = cantilever()
    shown = sc.modes(model, count=1).animation(0, frames=8)
    x = shown.position(rod.node("rod.end"))
    assert x.shape == (9, 3)
    assert np.linalg.norm(x - x[:1], axis=1).max() == pytest.approx(0.2, rel=0.1)
    assert not shown.position(base).any()


def test_numbers_of_places():
    model, items = scene()
    system = model.freeze()
    assert len(system.dofs(items["box"].at((1, 1, 1)))) == 12
    assert len(system.dofs(items["ball"].place())) == 3
    with pytest.raises(sc.InputError, match=r"ground at .* has no coordinates"):
        system.dofs(sc.ground((0, 0, 0)))
    with pytest.raises(sc.InputError, match="is not in this system, which has"):
        system.dofs(scene()[1]["ball"].place())
    with pytest.raises(sc.InputError, match="expected an object of type Place"):
        system.dofs(items["first"])


# -- a Model or a System -----------------------------------------------------------------------


def test_a_model_is_frozen_once_until_something_is_added():
    model, _ = scene()
    system = system_of(model)
    assert system_of(model) is system
    model.add("late", sc.MassPoint(1.0))
    assert system_of(model).n == system.n + 3


def test_the_model_of_a_system():
    model, items = scene()
    back = model_of(model.freeze())
    assert list(back) == list(model)
    assert back["ball"] is items["ball"]
    assert back.freeze().counts() == model.freeze().counts()


@pytest.mark.one_quick
@pytest.mark.parametrize(
    "call",
    [
        lambda x: sc.simulate(x, sc.Variational(), sc.NullSpace(), 0.1, 1.0),
        sc.initial_state,
        lambda x: sc.Stepper(x, sc.Variational(), sc.NullSpace(), 0.1),
        sc.Explicit.limit,
        sc.static,
        sc.modes,
        lambda x: sc.answer(x, {"energy": "energy"}, 0.1, 1.0),
        lambda x: diagnostics.strain_energy(x, [0.0]),
        lambda x: sc.carry_state(x, x, None),
    ],
)
def test_anything_else_is_named(call):
    with pytest.raises(sc.InputError, match="is of type dict, expected a Model or a System"):
        call({})


# -- arguments ---------------------------------------------------------------------------------


def hinged():
    model = sc.Model()
    link = model.add("link", sc.RigidBody.box(1.0, (0.1, 0.1, 1.0)))
    model.add("pin", sc.JointRevolute(sc.ground((0, 0, 0)), link.at((0, 0, 0)), axis=(1, 0, 0)))
    return model, link


HINGED, LINK = hinged()
Q0 = HINGED.freeze().q0
RUN = sc.simulate(HINGED, sc.EnergyMomentum(), sc.NullSpace(), 0.1, 0.2, kernels="numpy")
BENT = Q0 + 0.1
NAN = float("nan")


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: HINGED.freeze().null_space(Q0[:7]), "argument q: has shape"),
        (lambda: sc.initial_state(HINGED, BENT, tolerance=NAN), "tolerance = nan"),
        (lambda: sc.initial_state(HINGED, rates=np.zeros(3)), "argument rates"),
        (lambda: sc.restart(HINGED, RUN, sc.EnergyMomentum(), NAN), "step = nan"),
        (lambda: sc.Projection(HINGED)(Q0, Q0, NAN), "t = nan"),
        (lambda: sc.Projection(HINGED, method=[]), "argument method"),
        (lambda: sc.Projection(HINGED).stack(RUN["q"], RUN["p"][:1], 0.0), "argument p"),
        (lambda: sc.View(HINGED, None), "argument state"),
        (lambda: sc.View(HINGED, sc.initial_state(HINGED)).position(3), "argument place"),
        (lambda: RUN.segment(None), "argument k"),
        (lambda: RUN.add_series(None, RUN.times), "argument name"),
        (lambda: sc.after_events(HINGED, RUN, [3]), "argument events"),
        (lambda: diagnostics.section_strains(HINGED, LINK, Q0), "expected a Beam"),
        (lambda: diagnostics.constraint_points(HINGED, "x"), "expected History"),
        (
            lambda: diagnostics.multipliers(
                HINGED, [HINGED.freeze().extend(Q0, 0.0)] * 3, [Q0] * 2
            ),
            "of 2 states, y of 3",
        ),
        (lambda: diagnostics.midpoint_energy(HINGED, RUN["q"], NAN, True), "step = nan"),
        (lambda: diagnostics.angular_momentum(HINGED, RUN["q"], RUN["p"][0]), "argument p"),
        (lambda: diagnostics.external_energy(HINGED, RUN["q"], [0.0, 1.0]), "argument t"),
        (lambda: diagnostics.strain_energy(HINGED, "x"), "expected real numbers"),
        (lambda: diagnostics.constraint_frequency(HINGED, Q0, Q0 * NAN), "is not finite"),
    ],
)
def test_arguments_are_looked_at(call, words):
    with pytest.raises(sc.InputError, match=words):
        call()


@pytest.mark.slow
def test_each_thing_is_one_line():
    state = sc.initial_state(HINGED)
    report = next(sc.steps(HINGED, sc.EnergyMomentum(), sc.NullSpace(), 0.1, kernels="numpy"))
    record = sc.simulate(
        *(HINGED, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 0.2),
        sensors={"end": sc.SensorPosition(LINK.at((0, 0, 0.5)))},
        kernels="numpy",
    ).sensors["end"]
    many = sc.Model()
    for k in range(200):
        many.add(f"ball {k}", sc.MassPoint(1.0, position=(k, 0, 0)))
    things = [HINGED, many, many.freeze(), state, report, record, RUN, record.spectrum()]
    things += [sc.View(HINGED, state), sc.Projection(HINGED)]
    for thing in things:
        text = repr(thing)
        assert "\n" not in text, text
        assert " at 0x" not in text, text
        assert len(text) < 300, text
    assert repr(HINGED) == "<Model of rigid body 'link', revolute joint 'pin'>"
    assert "and 194 more" in repr(many)


def test_sets_of_a_mesh_cannot_be_written_to():
    """Nodes moved silently, also those of models that were built already."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="a")
    for sets in (mesh.boundaries, mesh.subdomains):
        for numbers in sets.values():
            with pytest.raises(ValueError, match="read-only"):
                numbers[0] = 0
