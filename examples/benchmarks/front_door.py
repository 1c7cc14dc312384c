"""Whole calls and whole processes: what a user waits for, beside bare steps and other programs.

One row a figure: *ours*, *other*, their *ratio* and the *unit*. Both are medians of at least five
runs, ours and the other in turns. Times are CPU times, child processes included, with one BLAS
thread; rows of two workers are by the clock. Kernels and bytecode are on disk unless a row says
otherwise, all options have their defaults, and all warnings are on.

*bare steps*: ``sc.steps(...)`` one by one, nothing recorded. *process*: from the start of Python to
the last position, which is the only state kept; Exudyn in the best settings found. Rows with the
unit of a time alone are scaled to a machine whose ``import skfem`` takes 0.35 s: it is their other,
and its memory that of rows in GB. A figure that would take too long is extrapolated from smaller
scenes, and its unit says from which ones; a peer that cannot be installed is named there, too.

Run ``python examples/benchmarks/front_door.py --help`` for the choices. Measure on an idle machine.
"""

from __future__ import annotations

import json
import math
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from importlib.util import find_spec
from itertools import chain as joined_rows
from itertools import count as counting
from itertools import pairwise
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import measuring  # before numpy: one thread
import memory
import numpy as np
import peer_calls
import scenes

import skfem_cosserat as sc
from paper import three_bar_swing

COLUMNS = ("name", "ours", "other", "ratio", "unit")
#: what `import skfem` takes on the machine that times are scaled to (s)
IMPORT = 0.35
SCALES = {"s": 1.0, "ms": 1e3, "us": 1e6}
#: largest ratios
RATIOS = {
    "import for a beam scene, to import skfem": 1.4,
    "simulate, one read of energy, to bare steps: swing": 1.6,
    "simulate, all series read, to bare steps: swing": 3,
    "simulate, all series read, to bare steps: rod of 200": 4,
    "simulate, all series read, to bare steps: four-bar": 8,
    "process, to Exudyn: hinged rod, 2000 steps": 1 / 1.7,
    "process, to Exudyn: hinged rod, 1000 steps": 1 / 1.3,
    "process, to Exudyn: hinged rod, 300 steps": 3,
    "process, to Exudyn: three-bar swing, 200 steps": 3.2,
    "process, to Exudyn: rod in its plane, 1000 steps": 4.5,
    "process, to Exudyn: 100 bars on ball joints, 100 steps": 3.2,
    "step, to Exudyn: ladder of 30 loops": 1 / 1.5,
    "step, to Exudyn: ladder of 60 loops": 1 / 1.5,
    "step, to Exudyn: ladder of 100 loops": 1 / 1.5,
    "step and four-bar: 1000 separate four-bars, to 10": 1.2,
    "freeze and set-up, in steps: lattice of 22 800 elements": 3,
    "first run ever, empty cache, 2000 steps of the rod, to numpy": 1,
    "event by energy, to event by time": 1.4,
    "twelve short jobs, two workers running, to one process": 1 / 1.5,
    "twelve short jobs, two workers to be started, to one process": 2.5,
}
#: largest values of ours, scaled, in the unit of the row: their other is the import of skfem
VALUES = {
    "freeze and set-up: chain of 2000 rigid bars": 1.5,
    "memory: chain of 2000 rigid bars": 0.6,
    "Beam with clamp and load, frozen, each of 1000": 1.5,
    "save with the default set, a state": 15,
    "gmsh file of 100 000 lines to its first step": 8,
    "memory: gmsh file of 100 000 lines": 1.5,
    "second scene of a known structure, to its first step": 4,
    "1000 runs of 100 steps of the swing, last state kept": 10,
    "static, 45-degree bend: 16 linear elements": 15,
    "static, 45-degree bend: 4 elements of order 4": 20,
}
#: CPU time (s) that a scene may take before smaller ones are extrapolated
PATIENCE = {True: 12.0, False: 120.0}
METHODS = sc.EnergyMomentum(), sc.NullSpace()
#: what has kernels on disk afterwards
COMPILED = "auto" if find_spec("numba") is None else "numba"
Measure = Callable[[], float]


# -- clocks ----------------------------------------------------------------------------------------


def cpu(function: Callable[..., Any], *args: Any, **options: Any) -> float:
    """CPU time of a call in this process (s)."""
    begun = time.process_time()
    function(*args, **options)
    return time.process_time() - begun


def wall(function: Callable[[], Any]) -> float:
    """Time of a call by the clock (s)."""
    begun = time.perf_counter()
    function()
    return time.perf_counter() - begun


class Process(NamedTuple):
    """A process that has ended: CPU time with that of its children (s), and what it printed."""

    seconds: float
    answer: str


def process(*arguments: str, given: str = "", **variables: str) -> Process:
    """Run Python on its own."""
    source = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, (source, os.environ.get("PYTHONPATH"))))
    new = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1", **variables}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, *arguments]
    done = subprocess.run(command, input=given, capture_output=True, text=True, env=new, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Process(spent, (done.stdout.splitlines() or [""])[-1])


#: import the modules that are named, in their order: CPU time (s), largest resident set (kB)
IMPORTS = """
import importlib, pathlib, sys, time
begun = time.process_time()
for name in sys.stdin.read().split():
    try:
        importlib.import_module(name)
    except ImportError:  # some packages name parts of themselves that cannot be imported alone
        pass
spent = time.process_time() - begun
lines = pathlib.Path("/proc/self/status").read_text().splitlines()
print(spent, next(line.split()[1] for line in lines if line.startswith("VmHWM")))
"""
#: a beam scene, and what has been imported when it is frozen
FREEZE = """
import sys
before = set(sys.modules)
import skfem_cosserat as sc
mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 20, name="rod")
section = sc.SectionCircle(radius=5e-3, material=sc.Material(E=5e6, nu=0.5, rho=1100))
model = sc.Model()
rod = model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0)))
hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
model.add("hinge", hinge)
model.add("gravity", sc.LoadGravity((0, -9.81, 0.5)))
model.freeze()
print(*(name for name in sys.modules if name not in before and name != "__mp_main__"))
"""


def import_skfem() -> float:
    """What scaled times are measured against (s)."""
    return float(process("-c", IMPORTS, given="skfem").answer.split()[0])


def skfem_memory() -> float:
    """Resident set of a process that has imported skfem (GB)."""
    return float(process("-c", IMPORTS, given="skfem").answer.split()[1]) * 1.024e-6


def import_scene() -> float:
    """Import all that a beam scene needs until it is frozen (s)."""
    return float(process("-c", IMPORTS, given=_needed()).answer.split()[0])


@cache
def _needed() -> str:
    return process("-c", FREEZE).answer


# -- figures ---------------------------------------------------------------------------------------


class Figure(NamedTuple):
    """A row to be: two measurements in turns; `told` says what is unusual about them."""

    name: str
    unit: str
    ours: Measure
    other: Measure
    told: str = ""


def row(figure: Figure, repeats: int) -> dict[str, Any]:
    """Medians, after a run that reads kernels and writes bytecode."""
    pairs = [(figure.ours(), figure.other()) for _ in range(repeats)]
    ours, other = (median(column) for column in zip(*pairs, strict=True))
    unit = figure.unit
    if unit in SCALES and figure.other is import_skfem:
        ours, other = (SCALES[unit] * value * IMPORT / other for value in (ours, other))
    elif unit in SCALES:
        ours, other = SCALES[unit] * ours, SCALES[unit] * other
    told = f"{unit} ({figure.told})" if figure.told else unit
    values = figure.name, ours, other, ours / other, told
    return dict(zip(COLUMNS, values, strict=True))


def absent(name: str, why: str) -> dict[str, Any]:
    """The row of a peer that cannot be run."""
    return dict(zip(COLUMNS, (name, None, None, None, f"not measured: {why}"), strict=True))


# -- scenes ----------------------------------------------------------------------------------------


def four_bar(model: sc.Model, z: float = 0.0, name: str = "") -> None:
    """Add a closed loop of crank, coupler and rocker, which swings by its weight."""
    corners = np.array([[0, 0, z], [0, 0.3, z], [1.0, 0.8, z], [1.0, 0, z]])
    ends = [sc.ground(corners[0])]
    for part, a, b in zip(("crank", "coupler", "rocker"), corners, corners[1:], strict=False):
        size = (0.05, 0.05, float(np.linalg.norm(b - a)))
        own = {"position": (a + b) / 2, "triad": sc.triad(b - a)}
        bar = model.add(name + part, sc.RigidBody.box(1.0, size, **own))
        ends += [bar.at(a), bar.at(b)]
    ends.append(sc.ground(corners[3]))
    for k, (a, b) in enumerate(zip(ends[::2], ends[1::2], strict=True)):
        model.add(f"{name}pin {k}", sc.JointRevolute(a, b, axis=(0, 0, 1)))


def four_bars(number: int) -> sc.Model:
    """Separate ones side by side."""
    model = sc.Model()
    for k in range(number):
        four_bar(model, 0.1 * k, f"{k} ")
    model.add("gravity", sc.LoadGravity((0.0, -9.81, 0.0)))
    return model


def chain(bars: int) -> dict[str, Any]:
    """Rigid bars on ball joints as plain numbers (see peers/README.md)."""
    points = np.c_[0.1 * np.arange(bars + 1), np.zeros((bars + 1, 2))]
    bodies = [_bar(a, b) for a, b in pairwise(points)]
    joints = [
        _ball(["bodies", k - 1] if k else None, ["bodies", k], points[k]) for k in range(bars)
    ]
    return _rigid(bodies, joints)


def ladder(loops: int) -> dict[str, Any]:
    """Two rails and a rung for each loop, of bars on ball joints."""
    bodies: list[dict[str, Any]] = []
    joints, below = [], [None, None]  # what the rails stand on
    for k in range(loops):
        corners = np.array([[0.1 * k, 0.1 * side, 0.0] for side in (0, 1)])
        rung = ["bodies", 3 * k + 2]
        for side, (low, high) in enumerate(zip(corners, corners + [0.1, 0, 0], strict=True)):
            rail = ["bodies", len(bodies)]
            bodies.append(_bar(low, high))
            joints += [_ball(below[side], rail, low), _ball(rail, rung, high)]
        bodies.append(_bar(*(corners + [0.1, 0, 0])))
        below = [rung, rung]
    return _rigid(bodies, joints)


def _bar(low: np.ndarray, high: np.ndarray) -> dict[str, Any]:
    along = (high - low) / np.linalg.norm(high - low)
    across = 0.1 / 12 * (0.1**2 + 0.02**2) * (np.eye(3) - np.outer(along, along))
    inertia = across + 0.1 / 6 * 0.02**2 * np.outer(along, along)
    return {"mass": 0.1, "position": ((low + high) / 2).tolist(), "inertia": inertia.tolist()}


def _ball(a: Any, b: Any, position: np.ndarray) -> dict[str, Any]:
    return {"kind": "spherical", "a": a, "b": b, "position": position.tolist()}


def _rigid(bodies: list[dict[str, Any]], joints: list[dict[str, Any]]) -> dict[str, Any]:
    parts = {"bodies": bodies, "joints": joints, "gravity": [0.0, -9.81, 0.5]}
    empty: dict[str, Any] = {"beams": [], "points": [], "loads": []}
    return {**empty, **parts, "watch": ["bodies", len(bodies) - 1]}


# -- a process of ours, as a user would write it: plain numbers in, the last position out ----------

SCRIPT = """
import json, sys
import numpy as np
import skfem_cosserat as sc
scene = json.load(sys.stdin)
model, places = sc.Model(), {}
for i, beam in enumerate(scene["beams"]):
    nodes = np.array(beam["nodes"])
    s, m, J = beam["stiffness"][0], beam["mass"][0], beam["inertia"][0]
    section = sc.Section(s, m, (sum(J) / 2 - J[0], sum(J) / 2 - J[1]))
    mesh = sc.MeshCurve.init_line(nodes[0], nodes[-1], len(nodes) - 1, name="rod")
    rod = model.add(f"beam {i}", sc.Beam(mesh, section, director=beam["director"]))
    places |= {("beams", i, k): rod.node(tuple(x)) for k, x in enumerate(nodes)}
for i, body in enumerate(scene["bodies"]):
    own = sc.RigidBody(body["mass"], body["inertia"], position=body["position"])
    places["bodies", i] = model.add(f"body {i}", own)
def place(key, position):
    if key is None:
        return sc.ground(position)
    found = places[tuple(key)]
    return found.at(position) if key[0] == "bodies" else found
for i, joint in enumerate(scene["joints"]):
    ends = [place(joint[side], joint["position"]) for side in "ab"]
    axis = [joint["axis"]] if joint["kind"] == "revolute" else []
    kind = {"revolute": sc.JointRevolute, "spherical": sc.JointSpherical}[joint["kind"]]
    model.add(f"joint {i}", kind(*ends, *axis))
for i, point in enumerate(scene["points"]):
    model.add(f"point {i}", sc.MassPoint(point["mass"], on=places[tuple(point["on"])]))
for i, load in enumerate(scene["loads"]):
    pulse = sc.Table(load["times"], load["factors"])
    model.add(f"load {i}", sc.LoadForce(places[tuple(load["on"])], load["force"], pulse))
model.add("gravity", sc.LoadGravity(scene["gravity"]))
h, n = scene["step"], round(scene["until"] / scene["step"])
pair = sc.EnergyMomentum(), sc.NullSpace()
history = sc.simulate(model, *pair, h, n * h, every=n, **scene.get("options", {}))
key = scene["watch"]
watched = places[tuple(key)]
if key[0] == "bodies":
    watched = watched.at(scene["bodies"][key[1]]["position"])
print(json.dumps(history.position(watched)[-1].tolist()))
"""


def own_process(scene: dict[str, Any], **variables: str) -> float:
    """CPU time of a process of ours (s)."""
    return process("-c", SCRIPT, given=json.dumps(scene), **variables).seconds


def timed(scene: dict[str, Any], steps: int, step: float, warm: int = 0) -> dict[str, Any]:
    """A scene with the steps that are asked for; the position is wanted at the end."""
    until = steps * step
    return {**scene, "until": until, "sample": until, "step": step, "warm": warm}


# -- peers -----------------------------------------------------------------------------------------

#: settings of Exudyn, varied one after the other from the first of each
SETTINGS: dict[str, Sequence[Any]] = {
    "tolerance": (1e-8, 1e-7, 1e-6, 1e-5),
    "newton": ("modified", "full"),
    "node": ("EP", "Rxyz", "RotVecLG"),
    "solver": ("EigenSparse", "EXUdense", "EigenSparseSymmetric"),
    "reuse_pattern": (True, False),
}


class Unanswered(Exception):
    """A peer that does not solve a scene, and why."""


def asked(adapter: str, folder: Any, scene: dict[str, Any]) -> dict[str, Any]:
    """What a peer answers."""
    peer = peer_calls.peers()[adapter]
    answer = peer_calls.ask(peer_calls.prepare(peer, folder), peer, scene)
    if answer["status"] != "completed":
        raise Unanswered(f"{peer.name}: {answer['status']}")
    return answer


def best(adapter: str, folder: Any, scene: dict[str, Any], steps: int) -> dict[str, Any]:
    """Settings with which a peer takes the first steps fastest, varied one by one."""
    chosen: dict[str, Any] = {name: values[0] for name, values in SETTINGS.items()}
    trial, costs = timed(scene, steps, scene["step"], 2), {}

    def cost(name: str, value: Any) -> float:
        options = {**chosen, name: value}
        text = json.dumps(options)
        if text not in costs:
            try:
                answer = asked(adapter, folder, {**trial, "options": options})
                costs[text] = float(answer["seconds"])
            except Unanswered:
                costs[text] = float("inf")
        return costs[text]

    tried = (each for each in SETTINGS["tolerance"] if cost("tolerance", each) < float("inf"))
    chosen["tolerance"] = next(tried, chosen["tolerance"])  # the tightest that rounding allows
    for name in ("newton", "node", "solver", "reuse_pattern"):
        if name != "node" or scene["beams"]:
            chosen[name] = min(SETTINGS[name], key=partial(cost, name))
    asked(adapter, folder, {**trial, "options": chosen})  # says why if there is no such setting
    return chosen


class Contest(NamedTuple):
    """A scene for both, and what is compared: whole processes, or steps alone."""

    name: str
    scene: dict[str, Any]
    adapter: str = "exudyn_beam"
    steps_alone: bool = False


def contests(quick: bool) -> list[Contest]:
    """All scenes that a peer solves, too."""
    rod, swing = scenes.rod(20), scenes.swing(20)
    rods = [
        Contest(f"process, to Exudyn: hinged rod, {n} steps", timed(rod, n, 1e-3))
        for n in (2000, 1000, 300)
    ]
    plane = timed({**rod, "gravity": [0.0, -9.81, 0.0]}, 1000, 1e-3)
    bars = timed(chain(100), 100, 1e-3)
    flat = Contest("process, to Exudyn: rod in its plane, 1000 steps", plane, "exudyn_plane")
    return [
        *rods,
        Contest("process, to Exudyn: three-bar swing, 200 steps", timed(swing, 200, 1e-3)),
        flat,
        Contest("process, to Exudyn: 100 bars on ball joints, 100 steps", bars),
        *(
            Contest(
                f"step, to Exudyn: ladder of {n} loops",
                timed(ladder(n), 30 if quick else 100, 1e-3, 2),
                steps_alone=True,
            )
            for n in (30, 60, 100)
        ),
    ]


def against(contest: Contest, folder: Any) -> Figure:
    """The figure of a contest; the settings of the peer are found first."""
    name, scene, adapter, alone = contest
    settings = best(adapter, folder, scene, min(60, round(scene["until"] / scene["step"])))
    question, key = {**scene, "options": settings}, "seconds" if alone else "process_s"
    ours = partial(stepped, json.dumps(scene)) if alone else partial(own_process, scene)

    own_process({**scene, "options": {"kernels": "numba"}})  # compiles
    ours()

    def other() -> float:
        found = asked(adapter, folder, question)
        return float(found[key]) / (found["steps"] if alone else 1)

    return Figure(name, "s", ours, other)


def stepped(text: str) -> float:
    """CPU time of a bare step of a scene of rigid bodies (s)."""
    scene = json.loads(text)
    n, warm = round(scene["until"] / scene["step"]), scene["warm"]
    return bare(rigid(text), scene["step"], n, warm) / (n - warm)


@cache
def rigid(text: str) -> sc.System:
    """The system of rigid bodies on ball joints, given as plain numbers."""
    return rigid_model(json.loads(text)).freeze()


def rigid_model(scene: dict[str, Any]) -> sc.Model:
    """The same before it is frozen."""
    model, bodies = sc.Model(), []
    for i, each in enumerate(scene["bodies"]):
        body = sc.RigidBody(each["mass"], each["inertia"], position=each["position"])
        bodies.append(model.add(f"body {i}", body))
    for i, joint in enumerate(scene["joints"]):
        x = joint["position"]
        ends = [sc.ground(x) if joint[s] is None else bodies[joint[s][1]].at(x) for s in "ab"]
        model.add(f"joint {i}", sc.JointSpherical(*ends))
    model.add("gravity", sc.LoadGravity(scene["gravity"]))
    return model


# -- calls of ours, each beside another one --------------------------------------------------------


def compiled(system: sc.System) -> sc.System:
    """The system, when the kernels that its steps take are on disk."""
    stepper = sc.Stepper(system, *METHODS, 1e-3, kernels="numba")
    measuring.advance(stepper, sc.initial_state(system), 2)
    return system


def bare(system: sc.System, step: float, number: int, warm: int = 1) -> float:
    """CPU time of compiled steps one by one, nothing recorded, without the first ones (s)."""
    begun = 0.0
    endless = sc.steps(system, *METHODS, step, kernels=COMPILED)
    for k, _ in zip(counting(1), endless, strict=False):
        if k == warm:
            begun = time.process_time()
        if k == number:
            break
    return time.process_time() - begun


def simulated(system: sc.System, step: float, number: int, every_series: bool) -> float:
    """CPU time of a default call that records all states, and of reading series (s)."""
    begun = time.process_time()
    history = sc.simulate(system, *METHODS, step, number * step)
    for name in list(history) if every_series else ["energy"]:
        _ = history[name]
    return time.process_time() - begun


def derived(quick: bool) -> Iterator[Figure]:
    """Recording and deriving, beside bare steps."""
    n = 2000
    swing, model = three_bar_swing.build(), sc.Model()
    four_bar(model)
    model.add("gravity", sc.LoadGravity((0.0, -9.81, 0.0)))
    few = n if not quick else 400
    for name, system, step, number, whole in (
        ("one read of energy, to bare steps: swing", swing, 1e-3, n, False),
        ("all series read, to bare steps: swing", swing, 1e-3, n, True),
        ("all series read, to bare steps: rod of 200", measuring.chain(200, 1), 1e-3, few, True),
        ("all series read, to bare steps: four-bar", model.freeze(), 1e-3, n, True),
    ):
        ours = partial(simulated, compiled(system), step, number, whole)
        yield Figure(f"simulate, {name}", "s", ours, partial(bare, system, step, number + 1))


def _with_loads(model: sc.Model, rod: sc.Beam, hinge: sc.Joint, what: str) -> None:
    """Put something more into a scene of a rod on a hinge."""
    end = rod.node("rod.end")
    if what == "a load by a Table":
        model.add("more", sc.LoadForce(end, (0.1, 0, 0), sc.Table([0, 1, 4], [0, 1, 0])))
    elif what == "a load by a Python function":
        model.add("more", sc.LoadForce(end, (0.1, 0, 0), lambda t: math.sin(3 * t)))
    elif what == "a spring and damper":
        model.add("more", sc.JointSpringDamper(hinge, stiffness=1.0, damping=0.01))
    elif what == "a motor by Harmonic":
        model.add("more", sc.JointActuator(hinge, sc.Harmonic(0.1, 1.0)))
    elif what == "a prescribed turn":
        model.add("more", sc.JointDrive(hinge, sc.RampSmooth(0, 4)))


def laden() -> Iterator[Figure]:
    """A run that keeps the last state, with one thing more, beside that without it."""
    steel = sc.SectionCircle(radius=5e-3, material=sc.Material(E=210e9, nu=0.3, rho=7850))

    def run(what: str = "") -> float:
        mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 20, name="rod")
        section = steel.damped(viscosity=[1.0] * 6) if what == "viscous sections" else steel
        model = sc.Model()
        rod = model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0)))
        start, end = rod.node("rod.start"), rod.node("rod.end")
        hinge = model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), start, axis=(0, 1, 0)))
        model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
        _with_loads(model, rod, hinge, what)
        sensors = {"tip": sc.SensorPosition(end)} if what == "a sensor" else None
        callbacks = [lambda report: None] if what == "a callback" else []
        own = (model.freeze(), *METHODS, 1e-3, 2.0)
        more: dict[str, Any] = {"every": 2000, "sensors": sensors, "callbacks": callbacks}
        return cpu(sc.simulate, *own, kernels=COMPILED, **more)

    for what in (
        *("a load by a Table", "a load by a Python function", "a spring and damper"),
        *("a motor by Harmonic", "viscous sections", "a sensor", "a prescribed turn", "a callback"),
    ):
        name = f"2000 steps of a rod with {what}, to the rod alone"
        yield Figure(name, "s", partial(run, what), run)


def events() -> Figure:
    """Events that do not happen, by two conditions."""
    system, level = three_bar_swing.build(), 1e9

    def run(condition: sc.Condition) -> float:
        watched = [sc.Event(condition, sc.ActionStop(), name="never")]
        own = (system, *METHODS, 1e-3, 1.0)
        return cpu(sc.simulate, *own, every=1000, events=watched)

    by = sc.ConditionEnergy(level), sc.ConditionTime(level)
    return Figure("event by energy, to event by time", "s", *(partial(run, each) for each in by))


def beam_scene(elements: int, stiffness: float = 1.0, length: float = 1.0, z: float = 0.0) -> Any:
    """A clamped rod under a force at its end."""
    mesh = sc.MeshCurve.init_line((0, 0, z), (length, 0, z), elements, name="rod")
    rubber = sc.SectionCircle(radius=5e-3, material=sc.Material(E=5e6 * stiffness, nu=0.5, rho=1e3))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, rubber, director=(0, 1, 0)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, z)), rod.node("rod.start")))
    model.add("force", sc.LoadForce(rod.node("rod.end"), (0, -1e-3, 0)))
    return model


def built(number: int) -> float:
    """CPU time of building and freezing a scene, the mean of many (s)."""
    return cpu(lambda: [beam_scene(20).freeze() for _ in range(number)]) / number


def second(turn: Iterator[int]) -> float:
    """CPU time from nothing to the first step of a scene of a known structure (s)."""
    k = next(turn)
    numbers = 1 + 0.1 * k, 1 + 0.01 * k, 0.1 * k
    return cpu(lambda: next(sc.steps(beam_scene(20, *numbers), *METHODS, 1e-3)))


def many(number: int, turn: Iterator[int]) -> float:
    """CPU time of a thousand short runs with other stiffnesses, from some of them (s)."""
    shift = 1e-3 * next(turn)

    def runs() -> None:
        for k in range(number):
            system = three_bar_swing.build(factor=1 + 0.01 * k + shift)
            sc.simulate(system, *METHODS, 1e-3, 0.1, every=100)

    return cpu(runs) * 1000 / number


def bend(elements: int, order: int, kernels: str = "auto") -> float:
    """CPU time of the 45-degree bend under its tip force, by default (s)."""
    angle, radius = np.pi / 4, 100.0
    start = (0, 0, 0), (1, 0, 0), (0, 1, 0)
    mesh = sc.MeshCurve.init_arc(*start, radius, angle, elements, name="rod")
    section = sc.SectionRectangle(1.0, 1.0, sc.Material(E=1e7, nu=0.0, rho=1.0))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("force", sc.LoadForce(rod.node("rod.end"), (0, 0, 600.0)))
    return cpu(partial(sc.static, model, kernels=kernels))


def saved() -> Measure:
    """CPU time of writing a history, by state (s)."""
    history = sc.simulate(three_bar_swing.build(), *METHODS, 1e-3, 2.0)

    def save() -> float:
        with TemporaryDirectory() as folder:
            return cpu(history.save, Path(folder) / "swing.history") / len(history)

    return save


def twelve(turn: Iterator[int]) -> list[sc.Job]:
    """Short runs of the swing with other stiffnesses."""
    shift = 1e-3 * next(turn)
    systems = [three_bar_swing.build(factor=1 + 0.1 * k + shift) for k in range(12)]
    return [
        sc.Job(f"{k}", sc.simulate, system, *METHODS, 1e-3, 0.2) for k, system in enumerate(systems)
    ]


def jobs(quick: bool, repeats: int, folder: Any) -> Iterator[dict[str, Any]]:
    """Twelve short jobs by the clock, with two workers and here."""
    turn = counting()

    def done(batch: list[sc.Job], executor: sc.Processes | None = None) -> None:
        for outcome in sc.run_all(batch, executor):
            outcome.result()

    def here() -> float:
        return wall(partial(done, twelve(turn)))

    def first() -> float:
        batch = twelve(turn)

        def run() -> None:
            with sc.Processes(2) as executor:
                done(batch, executor)

        return wall(run)

    here()
    name = "twelve short jobs, two workers"
    with sc.Processes(2) as executor:
        running = lambda: wall(partial(done, twelve(turn), executor))  # noqa: E731
        running()
        yield row(Figure(f"{name} running, to one process", "s", running, here), repeats)
    yield row(Figure(f"{name} to be started, to one process", "s", first, here), repeats)


# -- large scenes, each in a process of its own: numbers that it prints ----------------------------


def alone_chain(bars: int) -> dict[str, float]:
    """Freeze and set-up of a chain; the largest resident set."""
    model = rigid_model(chain(bars))
    return _set_up(model)


def alone_lattice(joints: int) -> dict[str, float]:
    """Freeze and set-up of a lattice, and a step."""
    import lattice

    begun = time.process_time()
    system = lattice.scene(joints, 1)
    frozen = time.process_time() - begun
    found = _set_up(system, steps=3)
    return {**found, "seconds": found["seconds"] + frozen}


def alone_four_bars(number: int) -> dict[str, float]:
    """A step of separate four-bars, by four-bar."""
    found = _set_up(four_bars(number), steps=30)
    return {"seconds": found["step"] / number}


def alone_gmsh(lines: int) -> dict[str, float]:
    """From a file of gmsh to the first step."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "rod.msh"
        end = (0.01 * lines, 0, 0)
        sc.write_mesh(path, sc.MeshCurve.init_line((0, 0, 0), end, lines, name="rod"))
        memory.forget_peak()
        begun = time.process_time()
        model = sc.Model()
        rod = sc.Beam(sc.read_mesh(path), measuring.rubber(), director=(0, 1, 0))
        model.add("rod", rod)
        model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
        model.add("gravity", sc.LoadGravity((0, -9.81, 0.5)))
        next(sc.steps(model, *METHODS, 1e-4))
        return {"seconds": time.process_time() - begun, "memory": memory.peak() / 1e3}


def _set_up(scene: sc.Model | sc.System, steps: int = 0) -> dict[str, float]:
    begun = time.process_time()
    system = scene.freeze() if isinstance(scene, sc.Model) else scene
    stepper = sc.Stepper(system, *METHODS, 1e-3)
    found = {"seconds": time.process_time() - begun, "memory": memory.peak() / 1e3}
    state, spent = sc.initial_state(system), []
    for _ in range(steps + 2 if steps else 0):
        begun = time.process_time()
        state = stepper.advance(state).state
        spent.append(time.process_time() - begun)
    return {**found, "step": median(spent[2:])} if steps else found


ALONE = {
    "chain": alone_chain,
    "lattice": alone_lattice,
    "four-bars": alone_four_bars,
    "gmsh": alone_gmsh,
}


class Large:
    """A scene of growing size: measured at its full size, or extrapolated where that is too dear.

    Parameters
    ----------
    kind : str
        Of ALONE.
    sizes : sequence of (int, float)
        Arguments of it, and what they count as; the last one is wanted.
    patience : float
        CPU time of a run (s) above which larger ones are not tried.
    """

    def __init__(self, kind: str, sizes: Sequence[tuple[int, float]], patience: float) -> None:
        self.kind, self.full = kind, sizes[-1][1]
        self.taken: list[tuple[int, float]] = []
        spent: list[float] = []
        for k, (argument, size) in enumerate(sizes):
            spent = [*spent[-1:], self._process(argument).seconds]
            self.taken = [*self.taken[-1:], (argument, size)]
            following = sizes[min(k + 1, len(sizes) - 1)][1]
            if spent[-1] * (following / size) ** max(1.0, self._power(spent)) > patience:
                break
        exact = self.taken[-1][1] == self.full
        self.taken = self.taken[-1:] if exact else self.taken
        known = " and ".join(f"{size:g}" for _, size in self.taken)
        self.told = "" if exact else f"extrapolated from {known}"
        self.found: dict[str, float] = {}

    def _power(self, values: Sequence[float]) -> float:
        """Of the growth between the sizes taken."""
        if len(values) < 2:
            return 1.0
        (_, low), (_, high) = self.taken
        return float(np.log(values[1] / values[0]) / np.log(high / low))

    def _process(self, argument: int) -> Process:
        return process(str(Path(__file__).resolve()), "--alone", json.dumps([self.kind, argument]))

    def measure(self, key: str) -> float:
        """A new run; the others of its numbers are in `found`."""
        runs = [json.loads(self._process(argument).answer) for argument, _ in self.taken]
        self.found = {name: self._extrapolated([run[name] for run in runs]) for name in runs[0]}
        return self.found[key]

    def _extrapolated(self, values: Sequence[float]) -> float:
        factor = self.full / self.taken[-1][1]
        return float(values[-1] * factor ** max(0.0, self._power(values)))


def large(quick: bool, repeats: int, folder: Any) -> Iterator[dict[str, Any]]:
    """Rows of large scenes."""
    patience = PATIENCE[quick]
    numbers = [(n, float(n)) for n in (10, 30, 100, 300, 1000)]
    bars = Large("four-bars", numbers, patience)
    ten = lambda: float(json.loads(bars._process(10).answer)["seconds"])  # noqa: E731
    ours = partial(bars.measure, "seconds")
    name = "step and four-bar: 1000 separate four-bars, to 10"
    yield row(Figure(name, "s", ours, ten, bars.told), repeats)
    sizes = [(n, float(n)) for n in (25, 50, 100, 200, 500, 1000, 2000)]
    what = "chain of 2000 rigid bars"
    scene = Large("chain", sizes, patience)
    yield from _with_memory(f"freeze and set-up: {what}", what, scene, repeats)
    struts = [(n, float(3 * n * n * (n - 1))) for n in (6, 9, 13, 20)]
    cube = Large("lattice", struts, patience)
    name = "freeze and set-up, in steps: lattice of 22 800 elements"
    ours, step = partial(cube.measure, "seconds"), lambda: cube.found["step"]
    yield row(Figure(name, "s", ours, step, cube.told), repeats)
    lines = [(n, float(n)) for n in (3000, 10_000, 30_000, 100_000)]
    what = "gmsh file of 100 000 lines"
    scene = Large("gmsh", lines, patience)
    yield from _with_memory(f"{what} to its first step", what, scene, repeats)


def _with_memory(name: str, what: str, scene: Large, repeats: int) -> Iterator[dict[str, Any]]:
    """The rows of a time, and of the memory of the same runs."""
    kept: list[float] = []

    def ours() -> float:
        seconds = scene.measure("seconds")
        kept.append(scene.found["memory"])
        return seconds

    yield row(Figure(name, "s", ours, import_skfem, scene.told), repeats)
    again = iter(kept)
    figure = Figure(f"memory: {what}", "GB", lambda: next(again), skfem_memory, scene.told)
    yield row(figure, repeats)


# -- all of them -----------------------------------------------------------------------------------


def first_run() -> Figure:
    """The first run on a machine, by default, and with plain kernels."""
    scene = timed(scenes.rod(20), 2000, 1e-3)

    def empty() -> float:
        with TemporaryDirectory() as folder:
            return own_process(scene, NUMBA_CACHE_DIR=folder)

    plain = partial(own_process, {**scene, "options": {"kernels": "numpy"}})
    name = "first run ever, empty cache, 2000 steps of the rod, to numpy"
    return Figure(name, "s", empty, plain)


def calls(quick: bool) -> Iterator[Figure]:
    """Figures that need no peer and no large scene."""
    yield Figure("import for a beam scene, to import skfem", "s", import_scene, import_skfem)
    yield from derived(quick)
    name = "Beam with clamp and load, frozen, each of 1000"
    count = 40 if quick else 1000
    yield Figure(name, "ms", partial(built, count), import_skfem, f"mean of {count}")
    yield first_run()
    yield Figure("save with the default set, a state", "us", saved(), import_skfem)
    name = "second scene of a known structure, to its first step"
    yield Figure(name, "ms", partial(second, counting()), import_skfem)
    name = "1000 runs of 100 steps of the swing, last state kept"
    count = 20 if quick else 1000
    yield Figure(name, "s", partial(many, count, counting()), import_skfem, f"from {count} runs")
    for elements, order in ((16, 1), (4, 4)):
        size = f"{elements} linear elements" if order == 1 else f"{elements} elements of order 4"
        bend(elements, order, COMPILED)
        yield Figure(
            f"static, 45-degree bend: {size}", "ms", partial(bend, elements, order), import_skfem
        )
    yield events()
    yield from laden()


def rows_of_calls(quick: bool, repeats: int, folder: Any) -> Iterator[dict[str, Any]]:
    """Rows of calls of ours."""
    for figure in calls(quick):
        figure.ours()  # reads kernels, writes bytecode
        yield row(figure, repeats)


def against_peers(quick: bool, repeats: int, folder: Any) -> Iterator[dict[str, Any]]:
    """Rows against other programs; where one cannot be run, the row says why."""
    for contest in contests(quick):
        try:
            yield row(against(contest, folder), repeats)
        except (peer_calls.Unavailable, Unanswered) as error:
            yield absent(contest.name, str(error))


#: by name: rows, measured one after the other
PARTS = {"calls": rows_of_calls, "peers": against_peers, "large": large, "jobs": jobs}


def main(
    quick: bool = True,
    repeats: int = 5,
    environments: str | Path | None = None,
    out: str | Path | None = None,
    parts: Sequence[str] = tuple(PARTS),
) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    quick : bool
        Fewer repetitions within a run, and large scenes extrapolated where they are dear.
    repeats : int
        Runs of which the median is taken.
    environments : path, optional
        Folder of the peers' environments; default: in the user's cache.
    out : path, optional
        Folder for front_door.csv.
    parts : sequence of str
        Only these of PARTS.

    Returns
    -------
    dict
        ``rows``, ``dgemm_gflops`` and where it was measured.
    """
    path = None if out is None else Path(out) / "front_door.csv"
    rows = joined_rows.from_iterable(PARTS[part](quick, repeats, environments) for part in parts)
    return measuring.collected(rows, path, COLUMNS)


def missed(result: dict[str, Any]) -> list[str]:
    """What does not come up to the figures, and what was not measured."""
    out = []
    for each in result["rows"]:
        name, unit = each["name"], each["unit"]
        if each["ratio"] is None:
            out.append(f"{name}: {unit}")
        elif name in VALUES and each["ours"] > VALUES[name]:
            out.append(f"{name}: {each['ours']:.3g} {unit}, at most {VALUES[name]:g}")
        elif name in RATIOS and each["ratio"] > RATIOS[name]:
            out.append(f"{name}: {each['ratio']:.3g}, at most {RATIOS[name]:.3g}")
    return out


def report(result: dict[str, Any]) -> str:
    """The rows as text."""
    return measuring.table(result["rows"], COLUMNS)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--alone"]:
        name, size = json.loads(sys.argv[2])
        print(json.dumps(ALONE[name](size)))
        sys.exit(0)
    sys.exit(measuring.command(__doc__, main, report, missed, options=("environments",)))
