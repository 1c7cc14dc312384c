"""Paths that cannot go on, motions that nothing holds, interruptions, bad arguments."""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest
from helpers_scenes import four_bar
from test_statics import cantilever, column, hinged, rod, stiff, treatments, truss

import skfem_cosserat as sc
from skfem_cosserat import Spin, equilibrium

NAN, INF = float("nan"), float("inf")


def scene():
    model, tip = cantilever(elements=2, order=2)
    model.add("force", sc.LoadForce(tip, (0, 1.0, 0)))
    return model.freeze(), tip


@pytest.mark.slow
def test_a_beam_that_is_far_too_soft_for_the_path_is_asked_for_its_units():
    """Steel of 210e3 in place of 210e9 Pa cannot carry itself."""
    soft = sc.SectionRectangle(0.02, 0.01, sc.Material(210e3, 0.3, 7850.0))
    model, _ = cantilever(soft, elements=4, order=3)
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    with pytest.raises(sc.Diverged, match=r"of beam 'rod' is 2e-05 of its weight .* E in Pa"):
        sc.static(model)


# -- free motions ----------------------------------------------------------------------------------


def beam_on_a_hinge(force=(0, 1.0, 0)):
    model = sc.Model()
    beam = rod(model)
    model.add("pin", sc.JointRevolute(sc.ground((0, 0, 0)), beam.node("rod.start"), (0, 0, 1)))
    model.add("force", sc.LoadForce(beam.node("rod.end"), force))
    return model


def slider():
    model = sc.Model()
    body = model.add("block", sc.RigidBody.box(1.0, (1, 1, 1)))
    guide = sc.JointPrismatic(sc.ground((0, 0, 0)), body.at((0, 0, 0)), axis=(0, 1, 0))
    model.add("guide", guide)
    model.add("force", sc.LoadForce(body.at((0, 0, 0)), (0, 2.0, 0)))
    return model


def hanging_without_weight():
    """A pendulum: before its weight grows, nothing holds it."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, (0, 0, -1)))
    model.add("string", sc.JointDistance(sc.ground((0, 0, 0)), ball.place()))
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    model.add("force", sc.LoadForce(ball.place(), (1.0, 0, 0)))
    return model


def fixed_to_each_other():
    """One of two such pairs is fixed to the ground as well, the other floats."""
    model = sc.Model()
    for k in range(2):
        bodies = [
            model.add(f"{name} {k}", sc.RigidBody.box(1.0, (1, 1, 1), position=(x, 3 * k, 0)))
            for x, name in ((0, "first"), (1, "second"))
        ]
        middle = (0.5, 3 * k, 0)
        model.add(f"weld {k}", sc.JointFixed(*(body.at(middle) for body in bodies)))
    model.add("clamp", sc.JointFixed(bodies[1].at((1, 3, 0)), sc.ground((1, 3, 0))))
    return model


FREE = {
    fixed_to_each_other: (r"'(first|second) 0': .*\(.*, with rigid body '(second|first) 0'", 6),
    beam_on_a_hinge: (r"beam 'rod': .*\(rotation about \(0, 0, 1\) through \(0, 0, 0\)", 1),
    slider: (r"rigid body 'block': .*\(translation along \(0, 1, 0\)", 1),
    four_bar: (r"'crank'.*\(rotation about \(0, 0, 1\)", 1),
    hanging_without_weight: (r"mass point 'ball': .*\(translation", 2),
}


@pytest.mark.one_quick
@treatments
@pytest.mark.parametrize("build", FREE, ids=lambda f: f.__name__)
def test_free_motions_are_named(build, treatment):
    text, count = FREE[build]
    with pytest.raises(sc.InputError, match=text) as caught:
        sc.static(build(), treatment)
    assert (f"one of {count} such motions" in str(caught.value)) == (count > 1)


@pytest.mark.slow
def test_free_motions_of_a_long_chain_are_named():
    """It ended in an error of a sparse factorisation."""
    with pytest.raises(sc.InputError, match=r"link.*: can move freely .* or more such"):
        sc.static(hanging_chain(links=401))


@pytest.mark.one_quick
@treatments
def test_stresses_hold_a_motion(treatment):
    """A string of prestressed springs; a pendulum whose weight is there from the start."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, (1, 0, 0)))
    for k in (0, 2):
        spring = sc.SpringDamper(sc.ground((k, 0, 0)), ball.place(), 10.0, length=0.5)
        model.add(f"spring {k}", spring)
    model.add("force", sc.LoadForce(ball.place(), (0, 1.0, 0)))
    y = sc.static(model, treatment)["q"][-1, 1]
    length = np.hypot(1, y)
    assert 20 * (length - 0.5) * y / length == pytest.approx(1.0, rel=1e-12)
    path = sc.static(hanging_without_weight(), treatment, factors={"weight": 1.0})
    assert path["q"][-1, 0] / -path["q"][-1, 2] == pytest.approx(1 / 9.81, rel=1e-12)


def beam_on_springs_with_its_weight():
    model = sc.Model()
    beam = rod(model, ends=((0, 0, -1), (1, 0, -1)))
    for k, name in enumerate(("start", "end")):
        spring = sc.SpringDamper(sc.ground((k, 0, 0)), beam.node(f"rod.{name}"), 1e3)
        model.add(name, spring)
    model.add("weight", sc.LoadGravity((0, 0, -0.1)))
    return model


@treatments
def test_what_a_weight_does_not_hold(treatment):
    """The advice to let loads act from the start is not given where they do."""
    model = beam_on_a_hinge()
    model.add("weight", sc.LoadGravity((0, 0, -0.5)))  # along the hinge
    with pytest.raises(sc.InputError, match=r"can move freely.*or start from a state") as caught:
        sc.static(model, treatment, factors={"weight": 1.0})
    assert "factors" not in str(caught.value)


@treatments
def test_a_beam_that_hangs_bent_may_turn_about_its_axis(treatment):
    """Which strains it, and takes no energy: it is no rigid motion that nothing holds."""
    model = beam_on_springs_with_its_weight()
    path = sc.static(model, treatment, factors={"weight": 1.0})
    assert path.status == "completed" and not path["unstable"].any()
    for name in ("rod.start", "rod.end"):
        sag = path.position(model["rod"].node(name))[-1, 2]
        assert sag == pytest.approx(-1 - 0.05 / 1e3, abs=1e-7)


def hanging_chain(on="universal", rod=False, off=0.0, links=2):
    """Some links; with `rod` a body on a massless rod at its end, beside its middle by `off`."""
    model = sc.Model()
    below, axes = sc.ground((0, 0, 0)), ((1, 0, 0), (0, 1, 0))
    for k in range(links):
        body = sc.RigidBody.box(1.0, (0.1, 0.1, 1.0), position=(0, 0, -k - 0.5))
        link = model.add(f"link {k}", body)
        ends = below, link.at((0, 0, -k))
        ball = on == "ball"
        joint = sc.JointSpherical(*ends) if ball else sc.JointUniversal(*ends, *axes)
        model.add(f"joint {k}", joint)
        below = link.at((0, 0, -k - 1))
    if rod:
        last = model.add("last", sc.RigidBody.box(1.0, (0.2, 0.2, 0.2), position=(off, 0, -3.1)))
        model.add("rod", sc.JointDistance(below, last.at((0, 0, -3))))
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    model.add("push", sc.LoadForce(below, (1.0, 0, 0)))
    return model


@treatments
def test_advice_is_enough(treatment):
    """Weight that acts from the start holds what is free."""
    for build in (hanging_chain, hanging_without_weight):
        with pytest.raises(sc.InputError, match=r"\(factors=\{name: 1.0\}\)"):
            sc.static(build(), treatment)
        path = sc.static(build(), treatment, factors={"weight": 1.0})
        assert path.status == "completed" and not path["unstable"].any()


@treatments
@pytest.mark.parametrize("rod", [False, True])
def test_weight_holds_not_all(rod, treatment):
    """Negative: links on balls may spin about their axes, a body about its rod."""
    model = hanging_chain("universal" if rod else "ball", rod)
    words = rf"rigid body '{'last' if rod else 'link .'}': .*\(rotation about \(0, 0, 1\)"
    with pytest.raises(sc.InputError, match=words):
        sc.static(model, treatment, factors={"weight": 1.0})


@treatments
def test_weight_that_tips_over(treatment):
    """An arch that stands on two balls is in equilibrium, but falls."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_arc((0, 0, 0), (0, 0, 1), (1, 0, 0), 0.5, np.pi, 4, name="rod")
    beam = model.add("arch", sc.Beam(mesh, stiff(), order=2, director=(0, 1, 0)))
    for x, end in ((0, "start"), (1, "end")):
        model.add(end, sc.JointSpherical(sc.ground((x, 0, 0)), beam.node(f"rod.{end}")))
    model.add("weight", sc.LoadGravity((0, 0, -0.1)))
    with pytest.raises(sc.InputError, match=r"'arch': can move freely.*about \(1, 0, 0\)"):
        sc.static(model, treatment)
    path = sc.static(model, treatment, factors={"weight": 1.0})
    assert (path["unstable"] == 1).all()


@treatments
def test_what_turns_about_its_rod_once_it_hangs(treatment):
    """A body that is not below its rod yet, so that its weight seems to hold it."""
    words = r"'last': can move freely in the equilibrium .*about \(0, 0, 1\)"
    with pytest.raises(sc.InputError, match=words):
        sc.static(hanging_chain(rod=True, off=0.05), treatment, factors={"weight": 1.0})


def slack_stay(fits=True):
    """A boom on a hinge, whose cable goes slack when half of a lift has grown."""
    model = sc.Model()
    boom = model.add("boom", sc.RigidBody.box(1.0, (1, 0.1, 0.1), position=(0.5, 0, 0)))
    pin = sc.JointRevolute(sc.ground((0, 0, 0)), boom.at((0, 0, 0)), axis=(0, 1, 0))
    model.add("joint", pin)
    length = None if fits else 1.4
    stay = sc.Cable(sc.ground((0, 0, 1)), boom.at((1, 0, 0)), 1e3, length=length)
    model.add("stay", stay)
    model.add("weight", sc.LoadForce(boom.at((0.5, 0, 0)), (0, 0, -10.0)))
    model.add("lift", sc.LoadForce(boom.at((1, 0, 0)), (0, 0, 10.0)))
    return model


@pytest.mark.slow
def test_arc_length_is_not_advised_where_a_cable_goes_slack():
    """It leads to no larger load either; what is known is said."""
    with pytest.raises(sc.Diverged, match=r"cable 'stay' is slack .* Hold by") as caught:
        sc.static(slack_stay(), factors={"weight": 1.0})
    assert caught.value.time == pytest.approx(0.5, abs=1e-5)
    assert "which pass limit points" not in str(caught.value)


def test_a_start_whose_cable_does_not_stay_taut():
    """Nothing pulls at it, and then nothing holds the boom."""
    with pytest.raises(sc.InputError, match="'boom': can move freely in the equilibrium"):
        sc.static(slack_stay(fits=False))


@treatments
def test_an_end_that_can_move_freely_is_told(treatment):
    """A lift takes the load off a cable: the ball may be anywhere within its length."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, (0, 0, -1)))
    model.add("cable", sc.Cable(sc.ground((0, 0, 0)), ball.place(), 1e3, length=0.99))
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    model.add("lift", sc.LoadForce(ball.place(), (0, 0, 9.81)))
    with pytest.warns(sc.AccuracyWarning, match="mass point 'ball'.*can move freely"):
        path = sc.static(model, treatment, factors={"weight": 1.0})
    assert path.status == "completed" and abs(path["energy"][-1]) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-6, 1e3])
def test_units_do_not_matter(scale):
    """Lengths in micrometres or kilometres."""
    section = sc.Section([1e4, 1e4, 1e4, *(np.array([1.0, 1.0, 2.0]) * scale**2)], 1.0, (1.0, 1.0))
    model = sc.Model()
    beam = rod(model, section, ends=((0, 0, 0), (scale, 0, 0)))
    start, end = beam.node("rod.start"), beam.node("rod.end")
    pin = model.add("pin", sc.JointRevolute(sc.ground((0, 0, 0)), start, axis=(0, 0, 1)))
    model.add("force", sc.LoadForce(end, (0, 0.5, 0)))
    with pytest.raises(sc.InputError, match=r"about \(0, 0, 1\)"):
        sc.static(model)
    model.add("spring", sc.JointSpringDamper(pin, 3.0 * scale))
    assert sc.static(model).status == "completed"


# -- paths that end --------------------------------------------------------------------------------


@pytest.mark.slow
def test_limit_point_under_load_control():
    """The path up to the limit is kept; reason and a way on are given."""
    model, _ = truss()
    with pytest.raises(sc.Diverged, match=r"ArcLength\(\)|DisplacementControl") as caught:
        sc.static(model, control=sc.LoadControl(10.0))
    error = caught.value
    limit = 400 * (1.09 ** (1 / 3) - 1) ** 1.5
    path = error.history
    assert path.status == "diverged"
    assert error.time == path["load_factor"][-1] and error.step == len(path)
    assert 0.99 * limit < error.time < limit
    assert str(error) == path.meta["failure"]


@pytest.mark.slow
def test_start_without_an_equilibrium_near():
    """Held far above the limit load of linear elements."""
    model, tip = cantilever(elements=1, order=1)
    model.add("moment", sc.LoadMoment(tip, (0, 0, 5.0)))  # EI/(2 l) = 0.5 is the most it carries
    with pytest.raises(sc.Diverged, match="the start is no equilibrium") as caught:
        sc.static(model, factors={"moment": 1.0})
    assert caught.value.history is not None
    assert caught.value.history.status == "diverged"


def test_interrupt_keeps_the_path():
    system, _ = scene()

    def press(point):
        if point.t > 0.3:
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    path = sc.static(system, callbacks=[press])
    assert path.status == "interrupted"
    assert 0.3 < path["load_factor"][-1] < 1
    assert "energy" in path
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.slow
def test_callbacks():
    """All are called with each point; True ends the path."""
    system, _ = scene()
    seen, others = [], []

    def watch(point):
        seen.append(point.t)
        return point.t > 0.4

    path = sc.static(system, callbacks=[watch, lambda point: others.append(point.t)])
    assert path.status == "stopped"
    assert seen == others == path["load_factor"][1:].tolist()
    assert sum(t > 0.4 for t in seen) == 1
    lines = []
    sc.static(system, progress=lambda parameter, factor: lines.append((parameter, factor)))
    assert lines[-1] == (1.0, 1.0)


def test_a_callback_that_fails(tmp_path):
    """Its error comes out; the file holds what was recorded before."""
    system, _ = scene()

    def fail(point):
        if point.t > 0.3:
            raise ZeroDivisionError("in the callback")

    with pytest.raises(ZeroDivisionError, match="in the callback"):
        sc.static(system, callbacks=[fail], path=tmp_path / "path.history")
    kept = sc.History.load(tmp_path / "path.history", recover=True)
    assert kept.status in ("interrupted", "killed", "diverged", "failed")
    assert len(kept) >= 3
    assert equilibrium(system, kept).load_factor == kept["load_factor"][-1]


@pytest.mark.parametrize("where", ["load", "factor", "drive"])
def test_functions_that_fail_on_the_way_are_named(where):
    def bad(t):
        return NAN if t > 0.5 else 0.1 * t

    model, hinge, body = hinged()
    place = body.at((0, 0, 1))
    if where == "load":
        model.add("push", sc.LoadForce(place, (1.0, 0, 0), bad))
    elif where == "drive":
        model.add("motor", sc.JointDrive(hinge, bad))
    else:
        model.add("push", sc.LoadForce(place, (1.0, 0, 0)))
    factors = {"push": bad} if where == "factor" else None
    with pytest.raises(sc.InputError, match=r"'(push|motor)'.*nan"):
        sc.static(model, factors=factors)


# -- arguments -------------------------------------------------------------------------------------


def _state(system, **changes):
    values = {"time": 0.0, "index": 0, "q": system.q0, "p": 0 * system.q0} | changes
    return sc.State(**values)


ARGUMENTS = {
    "model": [None],
    "treatment": ["null space", sc.NullSpace],
    "control": ["load", sc.ArcLength],
    "start": ["end"],
    "factors": [3, {"other": 1.0}, {3: 1.0}, {"spin": 1.0}],
    "spin": [(0, 0, 1.0)],
    "settings": [{"iterations": 3}],
    "watch": ["yes"],
    "callbacks": [print, [1]],
    "progress": [3],
    "path": [3.5],
    "derive": ["no", ["enrgy"]],
}


@pytest.mark.one_quick
@pytest.mark.parametrize("name", ARGUMENTS)
def test_bad_arguments_are_named(name):
    system, _ = scene()
    for value in ARGUMENTS[name]:
        arguments = {"model": system} | {name: value}
        with pytest.raises(sc.InputError) as caught:
            sc.static(**arguments)
        assert caught.value.item == f"argument {name}", value


@pytest.mark.parametrize("value", [NAN, "a", True, [1, 2], lambda t: (1, 2)])
def test_bad_factors(value):
    system, _ = scene()
    with pytest.raises(sc.InputError, match=r"argument factors.*'force'"):
        sc.static(system, factors={"force": value})


def test_bad_starts():
    system, _ = scene()
    bent = system.q0.copy()
    bent[3] += 0.1
    bad = [
        *({"q": q} for q in (np.zeros(3), NAN * system.q0, bent)),
        {"time": NAN},
        {"turns": np.array([1, 2])},
    ]
    for changes in bad:
        with pytest.raises(sc.InputError, match="argument start"):
            sc.static(system, start=_state(system, **changes))


@pytest.mark.parametrize(
    "arguments",
    [("abc",), ((0, 0),), ((0, 0, NAN),), ((0, 0, 1), (1, 2))],
    ids=str,
)
def test_bad_spins(arguments):
    with pytest.raises(sc.InputError, match=r"spin: (velocity|point)"):
        Spin(*arguments)


STEERED = {
    "until": [NAN, "1", 1j],
    "steps": [0, 1.5, "a"],
    "at": [[], [NAN], ["0.5", "1"], 0.5, [[0.1, 0.2]]],
    "first": [0, NAN, None],
    "longest": [0, "a"],
    "turn": [0, NAN],
}


@pytest.mark.parametrize("name", STEERED)
def test_bad_controls(name):
    _, tip = scene()
    for value in STEERED[name]:
        with pytest.raises(sc.InputError, match=f"LoadControl: {name}"):
            sc.LoadControl(**{name: value})
        arguments = ({} if name == "at" else {"until": 1.0}) | {name: value}
        with pytest.raises(sc.InputError, match=f"DisplacementControl: {name}"):
            sc.DisplacementControl(tip, (0, 1, 0), **arguments)


ARC = {
    "points": [0, 1.5, None],
    "until": [NAN, "1"],
    "first": [0, NAN],
    "length": [-1, "a"],
    "longest": [0, NAN],
    "turn": [0, "a"],
}


@pytest.mark.parametrize("name", ARC)
def test_bad_arc_lengths(name):
    for value in ARC[name]:
        with pytest.raises(sc.InputError, match=f"ArcLength: {name}"):
            sc.ArcLength(**{name: value})


def test_controls_that_lead_nowhere():
    system, tip = scene()
    for values in ([0.1, 0.1], [0.1, 0.3, 0.2]):
        for control in (
            sc.LoadControl(at=values),
            sc.DisplacementControl(tip, (0, 1, 0), at=values),
        ):
            with pytest.raises(sc.InputError, match="one way"):
                sc.static(system, control=control)
    with pytest.raises(sc.InputError, match="expected one of them"):
        sc.LoadControl(at=[0.5, 1.0], steps=2)
    with pytest.raises(sc.InputError, match="expected one of them"):
        sc.DisplacementControl(tip, (0, 1, 0), until=1.0, at=[0.5, 1.0])
    with pytest.raises(sc.InputError, match="where the path starts"):
        sc.static(system, control=sc.LoadControl(0.0))
    with pytest.raises(sc.InputError, match="DisplacementControl: until"):
        sc.DisplacementControl(tip, (0, 1, 0))


@pytest.mark.slow
def test_values_to_record_may_begin_with_the_start():
    system, tip = scene()
    wanted = [0.0, 0.25, 0.5, 0.75, 1.0]
    path = sc.static(system, control=sc.LoadControl(at=np.linspace(0, 1, 5)))
    assert path["load_factor"].tolist() == wanted
    control = sc.DisplacementControl(tip, (0, 1, 0), at=np.linspace(0, 0.02, 3))
    assert sc.static(system, control=control).times.tolist() == [0.0, 0.01, 0.02]


def test_first_steps_are_cut_to_the_longest():
    system, _ = scene()
    path = sc.static(system, control=sc.LoadControl(first=2.0, longest=0.125))
    assert path["load_factor"].tolist() == np.linspace(0, 1, 9).tolist()


def test_an_arc_length_path_may_end_behind_its_start():
    """Only a path that turns back gets there; this one does not."""
    system, _ = scene()
    for until in (0.0, -1.0):
        path = sc.static(system, control=sc.ArcLength(3, until=until))
        assert len(path) == 4 and (np.diff(path["load_factor"]) > 0).all()


def test_controls_and_treatments_show_their_arguments():
    _, tip = scene()
    for shown, made in {
        "LoadControl(at=[0.5, 1], turn=0.2)": sc.LoadControl(at=[0.5, 1], turn=0.2),
        "ArcLength(points=9, until=2, first=-0.1)": sc.ArcLength(9, until=2, first=-0.1),
        "Multipliers(scaled=False)": sc.Multipliers(scaled=False),
    }.items():
        assert repr(made) == shown
        assert repr(eval(shown, vars(sc))) == shown
    control = sc.DisplacementControl(tip, (0, -2, 0), 0.1, longest=0.5)
    assert repr(control).endswith("direction=[0, -1, 0], until=0.1, longest=0.5)")


def test_arguments_in_the_wrong_place_are_told_theirs():
    system, _ = scene()
    with pytest.raises(sc.InputError, match=r"treatment: LoadControl\(.*type Treatment"):
        sc.static(system, sc.LoadControl())
    with pytest.raises(sc.InputError, match=r"control: NullSpace\(\).*type Control"):
        sc.static(system, control=sc.NullSpace())


def test_the_line_of_progress_is_ended(capfd):
    system, _ = scene()
    sc.static(system, progress=True)
    text = capfd.readouterr().err
    assert text.endswith("parameter 1, load factor 1\n")
    assert text.count("\n") == 1

    def stop(point):
        raise KeyboardInterrupt

    sc.static(system, progress=True, callbacks=[stop], derive=False)
    assert capfd.readouterr().err.endswith("parameter 0.1, load factor 0.1\n")


def test_places_of_displacement_control():
    system, tip = scene()
    for place in ("tip", sc.ground((0, 0, 0))):
        with pytest.raises(sc.InputError, match="DisplacementControl: place"):
            sc.DisplacementControl(place, (0, 1, 0), 0.1)
    for direction in ("y", (0, 0, 0), (NAN, 0, 1), (1, 2)):
        with pytest.raises(sc.InputError, match="DisplacementControl: direction"):
            sc.DisplacementControl(tip, direction, 0.1)
    _, other = scene()
    with pytest.raises(sc.InputError, match="not in the model"):
        sc.static(system, control=sc.DisplacementControl(other, (0, 1, 0), 0.1))
    root = system.structures[0].node("rod.start")
    with pytest.raises(sc.InputError, match="joints hold"):
        sc.static(system, control=sc.DisplacementControl(root, (0, 1, 0), 0.1))


@pytest.mark.slow
def test_bad_branches_and_equilibria():
    model, tip = column()
    path = sc.static(model, control=sc.LoadControl(3.0))
    for name, values in {
        "which": ["a", 1, -2],
        "sign": [NAN, 0],
        "mode": [1.5, 999],
        "factors": [{"other": 1.0}],
        "spin": [3.0],
        "model": ["column"],
    }.items():
        for value in values:
            arguments = {"model": model, "history": path} | {name: value}
            with pytest.raises(sc.InputError, match=f"argument {name}"):
                sc.branch(**arguments)
    for value in ("a", 99):
        with pytest.raises(sc.InputError, match="argument index"):
            equilibrium(model, path, value)
    run = sc.simulate(model.freeze(), sc.EnergyMomentum(), sc.NullSpace(), 0.01, 0.02)
    for history in ("path", run):
        for verb in (sc.branch, equilibrium):
            with pytest.raises(sc.HistoryError, match="no path of static"):
                verb(model, history)
    system, _ = scene()
    for verb in (sc.branch, equilibrium):
        with pytest.raises(sc.HistoryError, match="another model"):
            verb(system, path)
    start = sc.branch(model, path)
    for control in (sc.LoadControl(), sc.DisplacementControl(tip, (1, 0, 0), 0.1)):
        with pytest.raises(sc.InputError, match="expected ArcLength"):
            sc.static(model, control=control, start=start)
    with pytest.raises(sc.InputError, match="another model"):
        sc.static(system, control=sc.ArcLength(3), start=start)


def test_paths_without_critical_points_have_no_branches():
    system, _ = scene()
    with pytest.raises(sc.InputError, match=r"0 critical point\(s\)"):
        sc.branch(system, sc.static(system))
