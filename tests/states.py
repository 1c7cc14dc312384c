"""What some sixty scenes come to, bit by bit: to compare the code before a change and after it.

    python tests/states.py store FILE [WORD ...]     before the change
    python tests/states.py compare FILE [WORD ...]   after it; ends with 1 if one bit differs

A word picks the runs whose names hold it. Everything a run gives is stored: q, v, p, multipliers,
energies, momenta, sensors; the paths of statics, frequencies, load factors; the rows of studies; a
digest of files for ParaView. Only files that were made on the same machine can be compared to the
last bit; elsewhere read the largest differences.

The number before a name is the largest difference, relative to the largest number of the series or
to a floor, whichever is larger. The floor is for series that are nothing but rounding: residuals,
violations, strains of rigid beams, rates of what does not move. It is the number whose part `LIMIT`
is rounding, so that they differ by less than `LIMIT`. Rounding is, by the rule of rounding.py, that
of the largest number of all series of the kind (`KINDS`) in the run, once for each step; numbers
are at least 1, the length of directors. Forces, momenta and velocities are known to no more than
the balance of momenta: what the run has left of it (its residual) counts as rounding, too, and
decides where beams are stiff; residuals differ relative to the largest momentum. In series that are
more than rounding a change by 1e-8 is seen.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import re
import sys
import tempfile
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from helpers_schemes import SCHEMES, compiled
from rounding import EPS, ROOM

import skfem_cosserat as sc
from skfem_cosserat.integrators import choice

# runs that do not say which kernels they take have plain ones, whatever ran before them
choice.promising = lambda: False

#: what two codings of one formula may differ by
LIMIT = 1e-9
#: of series, by their names: the first that fits; other series are a kind each
KINDS = {
    "force": r"force$|moment$|resultant$|multipliers$|sensor [NR]$",
    "energy": r"^(kinetic|external|dissipated|work_|strain_energy|coupling_energy|energy)",
    "momentum": r"^(p|Qp|carried)$|_momentum",
    "velocity": r"^v$|_rate$|sensor v$|hidden_violation$",
    "number": r"^q$|violation$|strain$|sensor [ex]$|angle|rotation$|displacement$|/[xy]$"
    r"|coordinate$|ends$|position$|^(error|difference|uncertainty)_",
}
GROUND = sc.ground((0, 0, 0))
SECTION = sc.Section((2e4, 2e4, 5e4, 40.0, 60.0, 30.0), mass=1.3, inertia=(2e-3, 3e-3))
STEEL = sc.Material(E=2.1e11, nu=0.3, rho=7850.0)
Z, DOWN = (0, 0, 1), (0.3, -9.81, 0.2)
NONE = np.zeros(0)
#: series by the name of the run and their own
Table = dict[str, dict[str, np.ndarray]]
PARTS: dict[str, Callable[[], sc.Model]] = {}
_JOINTS: dict[str, Callable[[sc.Place, sc.Place], Any]] = {
    "ball": sc.JointSpherical,
    "hinge": lambda a, b: sc.JointRevolute(a, b, axis=Z),
    "cylinder": lambda a, b: sc.JointCylindrical(a, b, axis=(0.6, 0.8, 0)),
    "slide": lambda a, b: sc.JointPrismatic(a, b, axis=(0.6, -0.8, 0)),
    "table": lambda a, b: sc.JointPlanar(a, b, normal=Z, x=(1, 0, 0)),
    "cardan": lambda a, b: sc.JointUniversal(a, b, axis_a=(0, 1, 0), axis_b=Z),
    "line": lambda a, b: sc.JointPointOnLine(a, b, axis=(0.6, -0.8, 0)),
    "clamp": sc.JointFixed,
    "rod": lambda a, b: sc.JointDistance(sc.ground((0, 1, 0)), b),
}


def scene(function: Callable[[], sc.Model]) -> Callable[[], sc.Model]:
    """A scene, by the name of its function."""
    PARTS[function.__name__] = function
    return function


def line(elements: int = 3, length: float = 1.0, name: str = "rod") -> sc.MeshCurve:
    """A straight line along x."""
    return sc.MeshCurve.init_line((0, 0, 0), (length, 0, 0), elements, name=name)


def rod(
    model: sc.Model, section: Any = SECTION, elements: int = 3, gravity: Any = DOWN, **options: Any
) -> sc.Beam:
    """A beam along x, under gravity."""
    beam = sc.Beam(line(elements), section, director=Z, **options)
    model.add("beam", beam)
    model.add("gravity", sc.LoadGravity(gravity))
    return beam


def hinged(model: sc.Model, beam: sc.Beam) -> sc.JointRevolute:
    """Its start on a hinge."""
    hinge = sc.JointRevolute(GROUND, beam.node("rod.start"), axis=Z)
    model.add("hinge", hinge)
    return hinge


def weighted(model: sc.Model, beam: sc.Beam) -> sc.RigidBody:
    """A box at its end."""
    box = sc.RigidBody.box(0.5, (0.2, 0.1, 0.1), position=(1.1, 0, 0))
    model.add("box", box)
    model.add("weld", sc.JointFixed(beam.node("rod.end"), box.at((1, 0, 0))))
    return box


def on_joint(kind: str) -> Callable[[], sc.Model]:
    """A beam hung on a joint, a box on its end, and a mass point on a rope."""

    def build() -> sc.Model:
        model = sc.Model()
        beam = rod(model)
        model.add("joint", _JOINTS[kind](GROUND, beam.node("rod.start")))
        box = weighted(model, beam)
        bob = sc.MassPoint(0.2, position=(1.1, -0.5, 0))
        model.add("bob", bob)
        model.add("rope", sc.JointDistance(box.at((1.1, 0, 0)), bob.place()))
        return model

    return build


PARTS |= {f"on a {kind}": on_joint(kind) for kind in _JOINTS}


def beam_of(**options: Any) -> Callable[[], sc.Model]:
    """A beam on a hinge, with a box at its end."""

    def build() -> sc.Model:
        model = sc.Model()
        beam = rod(model, **options)
        hinged(model, beam)
        weighted(model, beam)
        return model

    return build


def _energy(eps: Any) -> Any:
    return 0.5 * (eps * eps) @ np.array([2e4, 2e4, 5e4, 40.0, 60.0, 30.0]) + 3.0 * eps[..., 4] ** 4


TAPER = sc.SectionTaper(sc.SectionTube(0.02, 0.015, STEEL), sc.SectionTube(0.01, 0.005, STEEL))
TABLE = [SECTION.stiffness, 0.5 * SECTION.stiffness], [1.3, 1.0], [(2e-3, 3e-3), (1e-3, 2e-3)]

PARTS |= {
    "plain": beam_of(),
    "order 2": beam_of(order=2),
    "order 3": beam_of(order=3),
    "order 4": beam_of(order=4, elements=2),
    "Lobatto": beam_of(order=sc.InterpolationLobatto(2)),
    "equidistant": beam_of(order=sc.InterpolationEquidistant(3)),
    "viscous": beam_of(section=SECTION.damped(time=1e-3)),
    "lumped": beam_of(lumped=True),
    "stored energy": beam_of(section=sc.SectionHyperelastic(_energy, 1.3, (2e-3, 3e-3))),
    "inextensible": beam_of(theory=sc.TheoryInextensible()),
    "unshearable": beam_of(theory=sc.TheoryKirchhoff(torsion=False)),
    "rigid": beam_of(theory=sc.TheoryRigid()),
    "tube": beam_of(section=sc.SectionTube(0.02, 0.015, STEEL)),
    "bar": beam_of(section=sc.SectionRectangle(0.02, 0.03, STEEL)),
    "taper": beam_of(section=TAPER, order=3),
    "along": beam_of(section=sc.SectionAlong(lambda s: SECTION.damped(time=1e-3 * (1 + s)))),
    "table": beam_of(section=sc.SectionTable([0, 1], *TABLE), strain=(0, 0, 1e-3, 0, 0.1, 0)),
}


@scene
def two_orders() -> sc.Model:
    model = sc.Model()
    beam = rod(model)
    hinged(model, beam)
    mesh = sc.MeshCurve.init_line((1, 0, 0), (1, 1, 0), 2, name="leg")
    leg = sc.Beam(mesh, sc.SectionCircle(0.02, STEEL), order=2, director=Z)
    model.add("leg", leg)
    model.add("elbow", sc.JointFixed(beam.node("rod.end"), leg.node("leg.start")))
    model.add("damping", sc.RayleighDamping(0.1, 1e-4, leg))
    return model


@scene
def loads() -> sc.Model:
    model = sc.Model()
    beam = rod(model)
    hinged(model, beam)
    box = weighted(model, beam)
    end, corner = beam.node("rod.end"), box.at((1.2, 0.05, 0))
    table = sc.Table([0, 0.01, 0.1], [0.0, 1.0, 3.0])
    function = sc.FunctionOfTime(lambda t: 1.0 + np.cos(30 * t), kinks=[0.01])
    model.add("push", sc.LoadForce(corner, (1, 2, 3), sc.Harmonic(2.0, 10.0)))
    model.add("follow", sc.LoadForce(end, (1, 2, 3), table, follower=True))
    model.add("twist", sc.LoadMoment(corner, (0.1, 0.2, 0.3), sc.RampLinear(0, 0.02, 1, 2)))
    model.add("turn", sc.LoadMoment(end, (0.1, 0.2, 0.3), sc.RampSmooth(0, 0.02), follower=True))
    model.add("snow", sc.LoadLine(beam, (0, -2, 1), function))
    model.add("wind", sc.LoadLine(beam, (0.5, 1, 0), follower=True))
    return model


@scene
def heated() -> sc.Model:
    model = sc.Model()
    beam = rod(model)
    hinged(model, beam)
    weighted(model, beam)
    model.add("heat", sc.LoadStrain(beam, (0, 0, 1e-3, 0.2, 0, 0), sc.RampSmooth(0, 0.02)))
    return model


@scene
def springs() -> sc.Model:
    model = sc.Model()
    beam = rod(model)
    hinge = hinged(model, beam)
    box = weighted(model, beam)
    end, above = beam.node("rod.end"), sc.ground((0.5, 1, 0))
    model.add("coil", sc.JointSpringDamper(hinge, stiffness=5.0, damping=0.1, neutral=0.2))
    model.add("motor", sc.JointActuator(hinge, sc.Harmonic(2.0, 5.0)))
    model.add("spring", sc.SpringDamper(above, end, 30.0, 0.2, length=0.8))
    model.add("rope", sc.Cable(above, box.at((1.2, 0, 0)), 50.0, 0.1))
    return model


@scene
def bushings() -> sc.Model:
    model = sc.Model()
    beam = rod(model)
    box = weighted(model, beam)
    stiffness, damping = np.diag([3e3, 2e3, 1e3, 20, 30, 40.0]), np.diag([1, 2, 3, 0.1, 0.2, 0.3])
    model.add("bushing", sc.Bushing(GROUND, beam.node("rod.start"), stiffness, damping))
    model.add("other", sc.Bushing(sc.ground((1.1, 0, 0)), box.at((1.1, 0, 0)), 10.0))
    model.add("soil", sc.Foundation(beam, 50.0, 0.5))
    return model


@scene
def laws() -> sc.Model:
    """Forces, forms and potentials of own functions, and end stops."""
    model = sc.Model()
    beam = rod(model)
    hinge = hinged(model, beam)
    model.add("stops", sc.JointLimits(hinge, -0.01, 0.5, 1e3, 0.1))
    model.add("servo", sc.JointServo(hinge, 5.0, 0.1, ki=3.0, reference=0.2, limit=2.0))
    sampled = sc.Controller(4e-3, lambda x, v, t: 0.5 - 0.2 * v)
    model.add("sampled", sc.Force(hinge, sampled))
    box = weighted(model, beam)
    model.add("wind", sc.LoadForm(beam, lambda v, w: -0.3 * (w.velocity * v[:3]).sum(0)))
    model.add("bed", sc.EnergyForm(beam, lambda w: 20.0 * ((w.phi - w.x) ** 2).sum(0)))
    model.add("drag", sc.Force(box.at((1.2, 0, 0)), lambda x, v, t: -0.2 * v))
    return model


@scene
def obstacles() -> sc.Model:
    """A beam and a box in three of them from the start, with friction."""
    model = sc.Model()
    beam = rod(model)
    hinged(model, beam)
    box = weighted(model, beam)
    rough = {"damping": 0.1, "friction": 0.3, "slip_speed": 0.01}
    model.add("floor", sc.Obstacle(sc.Plane((0, -0.051, 0), (0, 1, 0)), box, 1e3, **rough))
    model.add("ball", sc.Obstacle(sc.Sphere((0.5, -0.2, 0), 0.201), beam, 1e3, **rough))
    tube = sc.Cylinder((0, 0, 0), (1, 0, 0), 0.03, inside=True)
    model.add("tube", sc.Obstacle(tube, beam, 1e3, radius=0.031, **rough))
    return model


@scene
def driven() -> sc.Model:
    model = sc.Model()
    beam = rod(model)
    hinge = hinged(model, beam)
    box = weighted(model, beam)
    model.add("drive", sc.JointDrive(hinge, sc.RampSmooth(0, 0.05, 0, 0.5)))
    flap = sc.RigidBody.box(0.1, (0.1, 0.1, 0.1), position=(1.3, 0, 0))
    model.add("flap", flap)
    model.add("free", sc.JointUniversal(box.at((1.2, 0, 0)), flap.at((1.2, 0, 0)), (0, 1, 0), Z))
    return model


@scene
def shaken() -> sc.Model:
    model = sc.Model()
    beam = rod(model)
    times = np.linspace(0, 0.1, 21)
    shake = sc.MotionShake(times, np.sin(40 * times)[:, None] * np.array([3.0, 1.0, 0.5]))
    turn = sc.MotionTurn(Z, lambda t: 2 * t * t, centre=(1, 0, 0))
    model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0), shake), beam.node("rod.start"), Z))
    bob = sc.MassPoint(0.2, position=(1, 0.5, 0))
    model.add("bob", bob)
    model.add("rope", sc.JointDistance(sc.ground((1, 0, 0), turn), bob.place()))
    return model


@scene
def four_bar() -> sc.Model:
    """Closed, with redundant rows in space."""
    model = sc.Model()
    beam = rod(model)
    crank = sc.RigidBody.box(0.5, (0.1, 0.4, 0.1), position=(0, -0.2, 0))
    rocker = sc.RigidBody.box(0.5, (0.1, 0.4, 0.1), position=(1, -0.2, 0))
    model.add("crank", crank)
    model.add("rocker", rocker)
    model.add("A", sc.JointRevolute(sc.ground((0, -0.4, 0)), crank.at((0, -0.4, 0)), Z))
    model.add("B", sc.JointRevolute(crank.at((0, 0, 0)), beam.node("rod.start"), Z))
    model.add("C", sc.JointRevolute(beam.node("rod.end"), rocker.at((1, 0, 0)), Z))
    model.add("D", sc.JointRevolute(rocker.at((1, -0.4, 0)), sc.ground((1, -0.4, 0)), Z))
    model.add("push", sc.LoadForce(crank.at((0, 0, 0)), (5, 0, 0)))
    return model


@scene
def flying() -> sc.Model:
    """Free, with a spin; mass on the beam itself."""
    model = sc.Model()
    beam = sc.Beam(line(), SECTION, director=Z, angular_velocity=(0.3, 1, 4), velocity=(1, 0, 0))
    model.add("beam", beam)
    model.add("lump", sc.MassPoint(0.3, on=beam.node("rod.end")))
    model.add("hub", sc.RigidBody(0.2, (1e-3, 2e-3, 3e-3), on=beam.node("rod.start")))
    return model


@scene
def rigid_only() -> sc.Model:
    model = sc.Model()
    last, x = GROUND, 0.0
    for k, axis in enumerate(((0, 0, 1), (0, 1, 0), (0.36, 0.48, 0.8))):
        body = sc.RigidBody(1.0, (0.1, 0.2, 0.15), position=(x + 0.5, 0, 0))
        model.add(f"body {k}", body)
        model.add(f"hinge {k}", sc.JointRevolute(last, body.at((x, 0, 0)), axis))
        x += 1.0
        last = body.at((x, 0, 0))
    model.add("gravity", sc.LoadGravity(DOWN))
    return model


@scene
def cantilever() -> sc.Model:
    """For statics: a column with a small side load and a dead load at its end."""
    model = sc.Model()
    beam = sc.Beam(line(4), SECTION, director=Z, order=2)
    model.add("beam", beam)
    model.add("clamp", sc.JointFixed(GROUND, beam.node("rod.start")))
    model.add("axial", sc.LoadForce(beam.node("rod.end"), (-80.0, 0.5, 0.2)))
    return model


@scene
def held() -> sc.Model:
    """For statics: strains held, a hinge with a spring, an inclined load."""
    model = sc.Model()
    beam = rod(model, theory=sc.TheoryInextensible())
    hinge = hinged(model, beam)
    model.add("coil", sc.JointSpringDamper(hinge, stiffness=50.0))
    return model


H = 2e-3
VARIATIONAL, MOMENTUM = sc.Variational(), sc.EnergyMomentum()
NULL, FULL = sc.NullSpace(), sc.Multipliers()
OTHERS = [s for s in SCHEMES if repr(s) not in map(repr, (VARIATIONAL, MOMENTUM))]
IN_PLANE = {
    "plain": beam_of(gravity=(0.3, -9.81, 0)),
    "inextensible": beam_of(gravity=(0.3, -9.81, 0), theory=sc.TheoryInextensible()),
    "rigid": beam_of(gravity=(0.3, -9.81, 0), theory=sc.TheoryRigid()),
}


def simulated(build: Callable[[], sc.Model], *setup: Any, **options: Any) -> Any:
    """Five steps, with sensors."""
    model = build()
    sensors: dict[str, Any] = {}
    joints = [model[name] for name in model if name in ("hinge", "joint", "A")]
    if "beam" in list(model):
        beam: Any = model["beam"]
        where = beam.node("rod.end")
        sensors = {
            "x": sc.SensorPosition(where), "v": sc.SensorVelocity(where),
            "a": sc.SensorAcceleration(where), "N": sc.SensorForce(beam, 0.4),
            "e": sc.SensorStrain(beam, 0.4),
        }  # fmt: skip
    if joints and isinstance(setup[0], sc.EnergyMomentum):
        sensors["R"] = sc.SensorReaction(joints[0])
    planar = options.pop("planar", False)
    system = model.freeze(planar=sc.Planar()) if planar else model.freeze()
    step, until = options.pop("step", H), options.pop("until", 5 * H)
    return sc.simulate(system, *setup, step, until, sensors=sensors, **options)


def runs() -> Iterator[tuple[str, Callable[[], Any]]]:
    """Names and what is run."""
    both = ("numpy", "numba")
    setups = [((MOMENTUM, NULL), both), ((VARIATIONAL, FULL), both)]
    for name, build in PARTS.items():
        yield from _each(name, build, setups)
    setups = [
        ((scheme, treatment), both if compiled(scheme) else both[:1])
        for scheme in OTHERS
        for treatment in (NULL, FULL)
    ]
    for name in ("springs", "four_bar"):
        yield from _each(name, PARTS[name], setups)
    setups = [((MOMENTUM, NULL), both), ((VARIATIONAL, NULL), both), ((MOMENTUM, FULL), both)]
    for name, build in IN_PLANE.items():
        yield from _each(f"{name} in its plane", build, setups, planar=True)
    schemes = (sc.Explicit(), sc.Explicit(rounds=2))
    setups = [((scheme, FULL), both[:1]) for scheme in schemes]
    yield from _each("explicit", _explicit, setups, step=1e-4, until=3e-3)
    for solver in (sc.SolverBanded(), sc.SolverDense(), sc.SolverSuperLU()):
        setups = [((MOMENTUM, NULL), both[:1])]
        yield from _each(f"{solver!r}", PARTS["four_bar"], setups, solver=solver)
    control = {"step": sc.StepControl(1e-5, first=1e-3), "until": 0.05}
    yield "step control", _run(simulated, PARTS["plain"], MOMENTUM, NULL, **control)
    yield "events", _run(_events)
    for name in ("cantilever", "held", "springs", "bushings"):
        for treatment in (NULL, FULL):
            yield f"statics, {name}, {treatment!r}", _run(_static, PARTS[name], treatment)
    yield "statics, arc length", _run(_static, _arch, NULL, sc.ArcLength(12, first=0.2))
    yield "statics, displacement", _run(_displaced)
    for name in ("cantilever", "held", "inextensible", "flying"):
        yield f"modes, {name}", _run(lambda build: sc.modes(build().freeze(), count=4), PARTS[name])
    yield "buckling", _run(lambda: sc.buckling(PARTS["cantilever"]().freeze(), 2))
    for name in ("plain", "springs", "rigid_only"):
        yield f"refine, {name}", _run(_refined, PARTS[name])
        yield f"work_precision, {name}", _run(_measured, PARTS[name])
        yield f"stability_map, {name}", _run(_mapped, PARTS[name])
        yield f"ParaView, {name}", _run(_written, PARTS[name])


def _each(
    name: str, build: Callable[[], sc.Model], setups: Sequence[Any], **options: Any
) -> Iterator[tuple[str, Callable[[], Any]]]:
    for setup, kinds in setups:
        for kernels in kinds:
            label = f"{name}, {setup[0]!r}, {setup[1]!r}, {kernels}"
            yield label, _run(simulated, build, *setup, kernels=kernels, **options)


def _run(function: Callable[..., Any], *arguments: Any, **options: Any) -> Callable[[], Any]:
    return lambda: function(*arguments, **options)


def _explicit() -> sc.Model:
    model = sc.Model()
    beam = rod(model, lumped=True, elements=4)
    hinged(model, beam)
    return model


def _events() -> Any:
    model = PARTS["rigid_only"]()
    events = [
        sc.Event(sc.ConditionCoordinate("hinge 0", -0.05), sc.ActionLock("hinge 1"), name="lock"),
        sc.Event(sc.ConditionTime(0.15), sc.ActionRelease("hinge 2"), name="release"),
        sc.Event(sc.ConditionTime(0.2), sc.ActionStop(), name="stop"),
    ]
    return sc.simulate(model.freeze(), MOMENTUM, NULL, 0.01, 1.0, events=events)


def _static(build: Callable[[], sc.Model], treatment: Any, control: Any = None) -> Any:
    return sc.static(build(), treatment, control or sc.LoadControl(steps=3))


def _arch() -> sc.Model:
    model = sc.Model()
    points = [(x, 0.3 * (1 - x * x), 0) for x in np.linspace(-1, 1, 7)]
    beam = sc.Beam(sc.MeshCurve.init_polyline(points, 1, name="rod"), SECTION, director=Z)
    model.add("beam", beam)
    for name in ("start", "end"):
        node = beam.node(f"rod.{name}")
        model.add(name, sc.JointRevolute(sc.ground(node.position), node, axis=Z))
    model.add("push", sc.LoadForce(beam.node((0, 0.3, 0)), (0.0, -60.0, 0)))
    return model


def _displaced() -> Any:
    model = _arch()
    beam: Any = model["beam"]
    control = sc.DisplacementControl(beam.node((0, 0.3, 0)), (0, -1, 0), until=0.1, steps=4)
    return sc.static(model, NULL, control)


def _end(history: sc.History) -> Any:
    return history["q"][-1]


def _refined(build: Callable[[], sc.Model]) -> Any:
    def problem(step: float) -> Any:
        return sc.simulate(build(), MOMENTUM, NULL, step, 0.016, kernels="numpy")

    quantities = {"end": _end, "energy": lambda history: history["energy"][-1]}
    return sc.refine(problem, step=(4e-3, 2e-3, 1e-3), quantities=quantities)


def _measured(build: Callable[[], sc.Model]) -> Any:
    def setup(step: float, scheme: sc.Integrator) -> Callable[[sc.System], Any]:
        return lambda system: sc.simulate(system, scheme, NULL, step, 0.016, kernels="numpy")

    steps = list(itertools.product((4e-3, 2e-3), (MOMENTUM, VARIATIONAL)))
    setups = [(f"{scheme!r}, step = {step} s", setup(step, scheme)) for step, scheme in steps]
    clock = itertools.count().__next__  # a second a look
    return sc.work_precision(
        build().freeze(), setups, setup(5e-4, MOMENTUM), {"end": _end}, 1, clock=clock
    )


def _mapped(build: Callable[[], sc.Model]) -> Any:
    def problem(step: float, scheme: sc.Integrator) -> Any:
        return sc.simulate(build(), scheme, NULL, step, 20 * step, kernels="numpy")

    return sc.stability_map(problem, {"scheme": (MOMENTUM, VARIATIONAL), "step": (2e-3, 0.05)})


def _written(build: Callable[[], sc.Model]) -> dict[str, np.ndarray]:
    """Digests of files, by their names."""
    history = simulated(build, MOMENTUM, NULL, kernels="numpy")
    with tempfile.TemporaryDirectory() as folder:
        sc.write_paraview(history, folder)
        return {
            str(file.relative_to(folder)): np.asarray(hashlib.sha256(file.read_bytes()).hexdigest())
            for file in sorted(Path(folder).rglob("*.*"))
        }


# -- storing and comparing -------------------------------------------------------------------------


def numbers(found: Any) -> Iterator[tuple[str, np.ndarray]]:
    """All arrays of numbers of a result, with names."""
    if isinstance(found, sc.History):
        for name in found:
            yield name, found[name]
        for name, record in found.sensors.items():
            yield f"sensor {name}", record.values
    elif isinstance(found, dict):
        yield from found.items()
    elif hasattr(found, "table"):
        for name in {name: None for row in found.table.rows for name in row}:
            if name not in ("seconds", "spent_s"):
                yield name, np.array([row.get(name, "") for row in found.table.rows])
    else:
        for name, value in vars(found).items():
            if isinstance(value, np.ndarray) and value.dtype.kind in "fc":
                yield name, value


def compute(words: Sequence[str]) -> dict[str, np.ndarray]:
    """What the runs give; the kind of its error where one fails."""
    table = {}
    for name, run in runs():
        if not all(word in name for word in words):
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                found = dict(numbers(run()))
            except sc.CosseratError as error:
                found = {"error": np.asarray(type(error).__name__)}
        table |= {f"{name} | {series}": values for series, values in found.items()}
    return table


def kind_of(series: str) -> str:
    """Name of the kind of a series; its own where no pattern fits."""
    return next((kind for kind, names in KINDS.items() if re.search(names, series)), series)


def largest(values: np.ndarray) -> float:
    """Largest number of a series; 0 if it has none."""
    return float(np.nanmax(abs(values), initial=0.0)) if values.dtype.kind in "fc" else 0.0


def floors(run: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Numbers whose part `LIMIT` is rounding, by the kinds of series of a run."""
    size = defaultdict(float, number=1.0)
    for series, values in run.items():
        kind = kind_of(series)
        size[kind] = max(size[kind], largest(values))
    left = largest(run.get("residual", NONE))  # N s
    share = left / (size["momentum"] or 1.0)
    unknown = {kind: share * size[kind] for kind in ("momentum", "velocity")}
    if left:
        h = np.diff(run["t"])
        unknown["force"] = left / h[h > 0].min()  # an event repeats its instant
    steps = max((len(values) for values in run.values() if values.ndim), default=0)
    found = {
        kind: (ROOM * steps * EPS * size[kind] + unknown.get(kind, 0.0)) / LIMIT for kind in KINDS
    }
    return found | {"residual": size["momentum"]}


def difference(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two arrays; 0 if every bit is the same."""
    if a.shape != b.shape or a.dtype != b.dtype:
        return float("inf")
    if a.tobytes() == b.tobytes():
        return 0.0
    if a.dtype.kind not in "fc":
        return float("inf")
    apart = np.where(np.isnan(a) & np.isnan(b), 0.0, abs(a - b))
    return float(np.max(np.nan_to_num(apart, nan=np.inf)))


def compared(before: Table, after: Table) -> Iterator[tuple[str, float]]:
    """Names of series that differ, and by how much."""
    for name in sorted({*before, *after}):
        run, other = before.get(name, {}), after.get(name, {})
        floor = floors(run)
        for series in sorted({*run, *other}):
            apart = np.inf
            if series in run and series in other:
                apart = difference(run[series], other[series])
            if apart:
                size = max(largest(run.get(series, NONE)), floor.get(kind_of(series), 0.0))
                yield f"{name} | {series}", apart / size if size else np.inf


def by_run(table: Mapping[str, np.ndarray]) -> Table:
    """Series by the name of the run and their own."""
    found: Table = defaultdict(dict)
    for name, values in table.items():
        run, series = name.rsplit(" | ", 1)
        found[run][series] = values
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Store or compare."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("what", choices=("store", "compare"))
    parser.add_argument("file")
    parser.add_argument("words", nargs="*", help="of the names of runs")
    options = parser.parse_args(arguments)
    table = compute(options.words)
    if options.what == "store":
        np.savez_compressed(options.file, **table)
        sys.stdout.write(f"{len(table)} series\n")
        return 0
    with np.load(options.file) as stored:
        before = {name: stored[name] for name in stored.files}
    before = {name: a for name, a in before.items() if all(word in name for word in options.words)}
    differing = [*compared(by_run(before), by_run(table))]
    for name, apart in differing:
        sys.stdout.write(f"{apart:8.1e}  {name}\n")
    above = sum(apart > LIMIT for _, apart in differing)
    counts = f"{len(before)} series, {len(differing)} differ, {above} by more than {LIMIT}"
    sys.stdout.write(f"{counts}\n")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
