"""The advisor keeps its tolerance, says when it cannot tell, and changes nothing."""

from __future__ import annotations

import csv
import dataclasses
import sys
import time
from contextlib import nullcontext
from functools import cache
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers_advice import random_scene, scene_of_kind
from scipy.integrate import solve_ivp

import skfem_cosserat as sc
from skfem_cosserat import InputError, SensorPosition, advise
from skfem_cosserat.accuracy.reading import Reading
from skfem_cosserat.advice import BeamFull, BeamRigid
from skfem_cosserat.advice import trials as advice_trials
from skfem_cosserat.advice.search import _between
from skfem_cosserat.advice.trials import Budget, CostMeter, RunningCost, Targets, Trials

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))

import model_ladder

STEEL = sc.SectionCircle(radius=5e-3, material=sc.Material(E=210e9, nu=0.3, rho=7850))


def pendulum() -> sc.Model:
    """A rod of steel that falls from the horizontal."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, STEEL, director=(0, 1, 0)))
    start = rod.node("rod.start")
    model.add("pin", sc.JointRevolute(sc.ground((0, 0, 0)), start, axis=(0, 1, 0)))
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    return model


def double_pendulum() -> sc.Model:
    """Two bobs let go high up: chaos."""
    model = sc.Model()
    one = model.add("one", sc.MassPoint(1.0, position=(0.0, 0, 1.0)))
    two = model.add("two", sc.MassPoint(1.0, position=(0.3, 0, 1.9)))
    model.add("upper", sc.JointDistance(sc.ground((0, 0, 0)), one.place()))
    model.add("lower", sc.JointDistance(one.place(), two.place()))
    model.add("gravity", sc.LoadGravity((0.1, 0, -9.81)))
    return model


def tip_of_rod(system, state):
    """Where the end of the rod is: from the angle of its first triad, whatever stands for it."""
    item = next(each for each in system.structures if each.name == "rod")
    first = system.first[id(item)][1]
    rows = state.q.reshape(-1, 3)[first : first + 4]
    start = np.concatenate([item.vertices().positions[:1], item.vertices().triads[0]])
    along = start[1:] @ np.array([1.0, 0, 0])
    return along @ rows[1:]


def frozen(model: sc.Model) -> tuple:
    """What must stay the same."""
    system = model.freeze()
    mass = system.mass.toarray().tobytes()
    return list(model), [id(model[name]) for name in model], system.q0.tobytes(), mass


def test_stiff_pendulum_is_rigid_and_as_exact_as_asked():
    model = pendulum()
    before = frozen(model)
    tip = SensorPosition(model["rod"].node("rod.end"))
    advice = advise(model, {"tip": tip}, 0.02, until=0.5)
    assert frozen(model) == before
    assert advice.confident, advice.reasons
    assert str(advice.proposal.theory["rod"]) == "rigid", str(advice)
    assert advice.true_error + advice.reference_error <= 0.02
    # a physical pendulum: theta'' = m g L/2 cos(theta) / J
    r, m = 5e-3, 7850 * np.pi * 25e-6
    inertia = m / 3 + m * r**2 / 4
    found = solve_ivp(
        lambda t, y: (y[1], m * 9.81 * 0.5 * np.cos(y[0]) / inertia), (0, 0.5), (0, 0),
        rtol=1e-10, atol=1e-12, dense_output=True,
    )  # fmt: skip
    proposal = advice.proposal
    made, replacements = proposal.rebuilt(model)
    history = sc.simulate(
        made.freeze(planar=proposal.planar), proposal.integrator, proposal.treatment,
        proposal.step, 0.5 * (1 + 1e-9), sensors={"tip": replacements.of(tip)}, kernels="numpy",
    )  # fmt: skip
    record = history.sensors["tip"]
    angle = found.sol(record.times)[0]
    exact = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=1)
    error = np.linalg.norm(record.values - exact, axis=1).max()
    assert error <= 0.02
    # both know the bending that is left out to 3e-4 m only, one of them not at all
    assert error == pytest.approx(advice.true_error, abs=advice.reference_error + 3.5e-4)
    assert "rigid" in advice.explanation
    assert "confident" in str(advice)


def test_functions_and_tolerances_by_name(tmp_path):
    model = pendulum()
    wanted = {
        "energy": lambda history: history["energy"] + history["external"],
        "tip": tip_of_rod,
    }
    methods = {"integrators": [sc.EnergyMomentum()], "treatments": [sc.NullSpace()], "base": 16}
    advice = advise(model, wanted, {"energy": 0.1, "tip": 0.05}, seed=3, until=0.3, **methods)
    assert advice.confident, advice.reasons
    for name, tolerance in (("energy", 0.1), ("tip", 0.05)):
        assert 0 <= advice.true_error[name] <= tolerance
        assert advice.reference_error[name] <= 0.2 * tolerance
    advice.csv(tmp_path / "candidates.csv")
    rows = list(csv.DictReader((tmp_path / "candidates.csv").open()))
    assert len(rows) == len(advice.candidates)
    assert [row["chosen"] for row in rows].count("True") == 1
    pytest.importorskip("matplotlib")
    advice.chart(tmp_path / "candidates.png")
    assert (tmp_path / "candidates.png").stat().st_size > 10_000
    assert "half the step" not in _legend(advice)
    next(row for row in advice.candidates if not row["chosen"])["robust"] = False
    assert "fails with half the step" in _legend(advice)


def _legend(advice):
    """All texts of the chart's legend."""
    from matplotlib.figure import Figure

    axis = Figure().subplots()
    advice.draw(axis)
    assert axis.get_legend() is None
    return " ".join(axis.get_legend_handles_labels()[1])


class CountedClock:
    """Processor time as calls of functions, as many on every machine; a call takes 0.2 us.

    With a seed others slow the machine, by up to three times, now and then.
    """

    def __init__(self, seed: int | None = None) -> None:
        rng = np.random.default_rng(seed)
        spans = rng.exponential(0.1, 10_000)
        slower = np.where(rng.random(10_000) < 0.5, 1.0, rng.uniform(1.0, 3.0, 10_000))
        shown = spans if seed is None else slower * spans
        self.real, self.shown = (np.r_[0.0, np.cumsum(x)] for x in (spans, shown))
        self.calls = 0

    def process_time(self) -> float:
        return float(np.interp(2e-7 * self.calls, self.real, self.shown))

    def _count(self, frame: object, event: str, argument: object) -> None:
        self.calls += event in ("call", "c_call")

    def __enter__(self) -> CountedClock:
        advice_trials.time = self
        sys.setprofile(self._count)
        return self

    def __exit__(self, *raised: object) -> None:
        sys.setprofile(None)
        advice_trials.time = time


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_proposals_do_not_depend_on_what_else_a_machine_does(seed):
    model = pendulum()
    tip = SensorPosition(model["rod"].node("rod.end"))
    advices = []
    for clock in (CountedClock(), CountedClock(seed)):
        with clock:
            advices.append(advise(model, {"tip": tip}, 0.02, until=0.5))
    assert str(advices[1].proposal.theory["rod"]) == "rigid", str(advices[1])
    with CountedClock():
        event = Trials(model, Targets({"tip": tip}, 0.02), 0.5, None, "numpy", 32, Budget(None))
        plain, disturbed = (event.again(event.run(each.proposal)) for each in advices)
    assert disturbed <= 2.0 * plain


@pytest.mark.slow
def test_starts_are_carried_to_other_beams():
    """From a given rate, as a function of the system or as a state of the model's own one."""
    model = pendulum()
    sensor = {"tip": SensorPosition(model["rod"].node("rod.end"))}
    methods = {"integrators": [sc.EnergyMomentum()], "treatments": [sc.NullSpace()], "base": 16}

    def start(system):
        return sc.initial_state(system, rates={"pin": 5.0})

    advices = [
        advise(model, sensor, 0.02, until=0.2, start=each, **methods)
        for each in (start, start(model.freeze()))
    ]
    for advice in advices:
        assert advice.confident, advice.reasons
        assert advice.true_error <= 0.02


@pytest.mark.slow
@pytest.mark.parametrize("twist", [0.0, 0.02])
def test_beams_go_without_torsion_only_where_nothing_twists_them(twist):
    """An arm that is bent both ways at once, and turned about its line or not."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0.5, 0, 0), 2, name="arm")
    section = sc.SectionCircle(radius=8e-3, material=sc.Material(E=1e8, nu=0.3, rho=1200))
    arm = model.add("arm", sc.Beam(mesh, section, director=(0, 1, 0)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), arm.node("arm.start")))
    tip, pulse = arm.node("arm.end"), sc.Table([0.0, 0.1, 0.2], [0.0, 1.0, 0.0])
    model.add("push", sc.LoadForce(tip, (0, 0.05, 0), pulse))
    model.add("gravity", sc.LoadGravity((0, 0, -1.0)))
    if twist:
        model.add("twist", sc.LoadMoment(tip, (twist, 0, 0), pulse))
    methods = {"integrators": [sc.EnergyMomentum()], "treatments": [sc.NullSpace()], "base": 16}
    advice = advise(model, {"tip": SensorPosition(tip)}, 2e-3, until=0.2, **methods)
    assert advice.confident, advice.reasons
    untwisted = [row["error"] for row in advice.candidates if "untwisted" in row["theories"]]
    if twist:
        assert not untwisted
        assert "of its strain energy in torsion" in advice.explanation
    else:
        assert untwisted
        assert min(untwisted) <= 0.5


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # candidates in large steps
def test_compiled_kernels_are_asked_in_space_without_the_time_they_take_to_compile():
    pytest.importorskip("numba")
    model = pendulum()
    tip = SensorPosition(model["rod"].node("rod.end"))
    advice = advise(model, {"tip": tip}, 0.02, until=0.3, kernels="numba", base=16)
    assert advice.confident, advice.reasons
    assert not any(row["planar"] for row in advice.candidates)
    costs = [row["cost_s"] for row in advice.candidates if row["status"] == "ok"]
    assert max(costs) < 2.0


def test_chaos_is_told():
    model = double_pendulum()
    sensor = {"two": SensorPosition(model["two"].place())}
    # for 3 s a fast machine follows it within the tolerance, and rightly says so; nobody for 20 s
    advice = advise(model, sensor, 0.05, until=20.0, budget_s=4)
    assert not advice.confident
    assert advice.proposal is None
    assert "chaotic" in " ".join(advice.reasons)


def test_without_budget_it_cannot_tell():
    model = pendulum()
    advice = advise(model, {"tip": SensorPosition(model["rod"].node("rod.end"))}, 1e-4, 1e-3)
    assert not advice.confident
    assert "budget" in " ".join(advice.reasons)
    if advice.proposal is None:
        with pytest.raises(InputError, match="has no proposal"):
            advice.build(model)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": 3}, "argument model: is of type int, expected a Model or a System"),
        ({"quantities": {}}, "argument quantities"),
        ({"quantities": {"tip": 3}}, "quantity 'tip': is 3, expected a sensor"),
        ({"quantities": {"tip": lambda a, b, c: 0}}, "takes 3 arguments"),
        ({"tolerance": -1.0}, "argument tolerance"),
        ({"tolerance": {"other": 1.0}}, "is for .*, expected"),
        ({"budget_s": 0}, "argument budget_s"),
        ({"seed": -1}, "argument seed"),
        ({"until": 0.0}, "argument until"),
        ({"start": 3}, "argument start: 3, expected a State"),
        ({"integrators": ()}, "argument integrators"),
        ({"base": 3}, "argument base"),
    ],
)
def test_bad_arguments(change, message):
    model = pendulum()
    given = {"model": model, "tolerance": 0.1, "until": 0.1}
    given["quantities"] = {"tip": SensorPosition(model["rod"].node("rod.end"))}
    with pytest.raises(InputError, match=message):
        advise(**given | change)


def test_sensors_of_other_scenes_are_refused():
    with pytest.raises(InputError, match="is not in this system"):
        advise(pendulum(), {"tip": SensorPosition(pendulum()["rod"].node("rod.end"))}, 0.1)


def test_readings_are_compared_at_instants_of_both():
    fine, coarse = (np.linspace(0, 1, n + 1) for n in (16, 4))
    a, b = Reading(np.sin(fine), fine), Reading(np.sin(coarse) + 0.1, coarse)
    assert a.distance(b) == pytest.approx(0.1, abs=1e-14)
    middles = fine[:-1] + 0.5 * fine[1]
    assert Reading(np.sin(middles), middles).distance(b) == pytest.approx(0.1, abs=2e-6)
    both = Targets({"x": lambda h: 0, "y": lambda h: 0}, {"x": 1.0, "y": 0.1})
    one = {"x": Reading(np.array(1.0)), "y": Reading(np.array(1.0))}
    other = {"x": Reading(np.array(1.5)), "y": Reading(np.array(1.2))}
    assert both.distance(one, other) == pytest.approx(2.0)


def test_predictions_follow_powers():
    known = {1: 16.0, 2: 1.0, 4: 1 / 16}
    for m in (1, 2, 3, 4, 8):
        assert _between(known, m, 4) == pytest.approx(16.0 / m**4, rel=1e-12)
    assert _between({1: np.inf}, 2, 4) == np.inf


def test_a_random_scene():
    scene = random_scene(3)
    before = frozen(scene.model)
    advice = advise(scene.model, scene.quantities, scene.tolerance, until=scene.until)
    assert frozen(scene.model) == before
    assert advice.confident, advice.reasons
    assert true_error(scene, advice) <= scene.tolerance


def true_error(scene, advice) -> float:
    """Of the proposal, against fine elements of another order and half the reference's step."""
    best, reference = advice.proposal, advice.reference
    readings = []
    for proposal in (best, reference):
        made, replacements = proposal.rebuilt(scene.model)
        step, planar = proposal.step, proposal.planar
        if proposal is reference:
            elements = {}
            for name, count in proposal.elements.items():
                beam = scene.model[name]
                mesh = sc.mesh.divided(beam.mesh, 2 * count)
                elements[name] = beam.on_mesh(mesh, 2)
            made, replacements = scene.model.rebuilt(elements)
            step, planar = step / 2, None
        sensors = {name: replacements.of(each) for name, each in scene.quantities.items()}
        history = sc.simulate(
            made.freeze(planar=planar), proposal.integrator, proposal.treatment, step,
            scene.until * (1 + 1e-9), sensors=sensors, derive=False, kernels="numpy",
            every=10**6,
        )  # fmt: skip
        readings.append({k: Reading(r.values, r.times) for k, r in history.sensors.items()})
    return max(readings[0][name].distance(readings[1][name]) for name in scene.quantities)


@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # what clocks let it choose
@pytest.mark.slow
@pytest.mark.parametrize("name", ["soft swing", "slider-crank", "slack cable", "flying spaghetti"])
def test_named_scenes_keep_their_tolerance(name):
    scene = model_ladder.SCENES[name]()
    advice = advise(scene.model, scene.quantities, scene.tolerance, 300.0, until=scene.until)
    assert advice.confident, advice.reasons
    assert true_error(scene, advice) <= scene.tolerance
    kind = {"slider-crank": "rigid"}.get(name)
    assert kind is None or {str(theory) for theory in advice.proposal.theory.values()} == {kind}


#: random scenes whose proposals are compared with a grid
COMPARED = 3, 5, 8


@cache
def advised(seed):
    """A random scene and the advice on it, where costs are compared on every machine the same."""
    scene = random_scene(seed)
    with CountedClock() if seed in COMPARED else nullcontext():
        kept = advise(
            scene.model, scene.quantities, scene.tolerance, 300.0, seed, until=scene.until
        )
    return scene, kept


@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # candidates in large steps
@pytest.mark.slow
def test_random_scenes_keep_their_tolerance():
    confident = 0
    for seed in range(10):
        scene, advice = advised(seed)
        if advice.confident:
            confident += 1
            assert true_error(scene, advice) <= scene.tolerance, f"seed {seed}"
    assert confident >= 8


@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # candidates in large steps
@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_other_kinds_of_scenes_keep_their_tolerance(seed):
    """Clamped, hung up, flying, closing a loop; of other sizes than those above."""
    scene = scene_of_kind(seed)
    advice = advise(scene.model, scene.quantities, scene.tolerance, 120.0, until=scene.until)
    assert advice.confident, advice.reasons
    assert true_error(scene, advice) <= scene.tolerance


def cheapest_of_grid(scene, advice) -> tuple[float, float]:
    """Costs (s) of the proposal and of the cheapest good one of a grid.

    Rigid or full beams in all combinations, orders 1 to 3, equal numbers of elements, steps and
    both integrators. What cannot come out as the cheapest is left out: beams that are worse than
    two tolerances off as rigid ones by themselves, what would cost more than 1.2 times the
    cheapest so far, the proposal among them, and fewer steps where more of them are worse than
    four tolerances off. The second cost is infinite if nothing is left.
    """
    event = Trials(
        scene.model,
        Targets(scene.quantities, scene.tolerance),
        *(scene.until, None, "numpy", 32, Budget(None)),
    )
    reference, own = event.run(advice.reference), event.run(advice.proposal)
    least, good, bound = own.cost_s, [], _bound(advice.candidates)
    kinds = [_kinds(event, name, advice.reference, reference) for name in event.beams]
    for theories, order, per in product(product(*kinds), (1, 2, 3), (1, 2, 4, 8, 12)):
        models = dict(zip(event.beams, theories, strict=True))
        if (order, per) != (1, 1) and not any(theory.meshed for theory in theories):
            continue
        elements = {name: per * pieces for name, pieces in event.pieces.items()}
        for steps in (256, 128, 64, 32, 16, 8):
            near = False
            for scheme in (sc.EnergyMomentum(), sc.Variational()):
                proposal = event.proposal(elements, order, steps, models, scheme)
                if bound(proposal) > 1.2 * least:
                    near = True
                    continue
                trial = event.run(proposal, 1.2 * least)
                error = event.distance(trial, reference)
                near |= trial.status == "stopped" or error <= 4.0
                if error <= 1.0:
                    good.append(trial)
                    least = min(least, trial.cost_s)
            if not near:
                break
    good.sort(key=lambda each: each.cost_s)
    return event.again(own), min(map(event.again, good[:4]), default=np.inf)


def _bound(rows):
    """A function of a proposal: what it costs (s) at least, from what others have cost."""
    done = [row for row in rows if row["status"] == "ok"]
    nodes = [
        sum(int(n) * int(row["order"] or 0) + 1 for n in row["elements"].split(",")) for row in done
    ]
    each = [row["cost_s"] / row["steps"] / row["iterations"] for row in done]
    slope = max(0.0, np.polyfit(nodes, each, 1)[0])
    base = min(cost - slope * n for cost, n in zip(each, nodes, strict=True))
    fewest = min(row["iterations"] for row in done)
    return lambda own: 0.8 * own.steps * fewest * max(base + slope * own.nodes, 0.5 * min(each))


def _kinds(event, name, finest, reference):
    rigid = dataclasses.replace(finest, theory=dict(finest.theory) | {name: BeamRigid()})
    near = event.distance(event.run(rigid), reference) <= 2.0
    return (BeamRigid(), BeamFull()) if near else (BeamFull(),)


@pytest.mark.slow
@pytest.mark.parametrize("seed", COMPARED)
def test_proposals_cost_at_most_twice_the_cheapest_of_a_grid(seed):
    found = advised(seed)
    with CountedClock():
        own, least = cheapest_of_grid(*found)
    assert own <= 2.0 * least


def test_costs_are_iterations_times_the_least_that_one_took():
    """Slow runs change nothing, nor do those of a single step; steps without iterations count."""
    cost = RunningCost()
    for first, spent, later in (
        (0.2, 5.2, 100),
        (0.1, 12.1, 100),
        (0.3, 1.3, 10),
        (0.1, 0.1001, 0),
    ):
        watch = CostMeter(np.inf)
        watch.first_s, watch.spent_s, watch.later = first, spent, later
        cost.add(watch)
    assert (cost.first_s, cost.iteration_s) == pytest.approx((0.1, 0.05))
    assert cost.cost(40) == pytest.approx(2.1)
    assert RunningCost(0.1).cost(0) == 0.1
    watch = CostMeter(np.inf)
    for iterations in (3, 2, 0):
        assert not watch(SimpleNamespace(iterations=iterations))
    assert (watch.steps, watch.iterations, watch.later) == (3, 5, 3)
    assert CostMeter(-1.0)(SimpleNamespace(iterations=1))
