"""Random scenes of all items, and what compiled kernels make of them against plain numpy.

    python tests/random_scenes.py                     500 scenes, 20 steps each
    python tests/random_scenes.py --seeds 40 --first 7
    python tests/random_scenes.py --seeds 1 --first 7 --verbose
    python tests/random_scenes.py --seeds 300 --held   beams that hold strains, by both treatments

A number makes a scene, an integrator, a treatment and a step: in space or in a plane, trees and
closed loops, every item of the package, and some written outside of it. Scenes without kernels are
counted by reason, the others are compared; ends with 1 if one differs by more than it may. With
`--held` all beams hold strains, and compiled steps by null space and multipliers are compared.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

sys.path.append(str(Path(__file__).parent / "items"))  # for items that a user writes

import numpy as np
from helpers_kernels import holds_strains
from helpers_scenes import FULL, JOINTS, POINT_JOINTS, TENSOR, fitting, rotation, unit
from helpers_schemes import SCHEMES
from rounding import EPS, nudged
from test_own_items import IntegratorMidpoint, JointPointOnPlane, drag

import skfem_cosserat as sc
from skfem_cosserat.diagnostics import highest_frequency
from skfem_cosserat.newton import ROUNDING

STEPS = 20
STEEL = sc.Material(E=2.1e11, nu=0.3, rho=7850.0)
RUBBER = sc.Material(E=5e6, nu=0.5, rho=1100.0)
SLENDER = (2e4, 2.5e4, 5e4, 40.0, 60.0, 30.0)
ALL_SCHEMES = (
    *SCHEMES,
    sc.EnergyDecaying(0.1, velocity=False),
    sc.EnergyDecaying(rate=5.0, velocity=False, stabilized=True),
    sc.GeneralizedAlpha(0.3),
    IntegratorMidpoint(),
    sc.Composition(IntegratorMidpoint(), 4),
)
TREATMENTS = (sc.NullSpace(), sc.Multipliers())
#: what is compared of two runs; works and energies by the largest of them
MOTION = ("q", "p", "carried", "constraint_force", "multipliers")
ENERGIES = (
    *("kinetic", "strain_energy", "external", "coupling_energy", "energy"),
    *("work_loads", "work_actuators", "work_drives", "dissipated"),
)


class RandomScene(NamedTuple):
    """What a number made."""

    model: sc.Model
    system: sc.System
    integrator: sc.Integrator
    treatment: sc.Treatment
    step: float
    settings: sc.NewtonSettings
    start: sc.State
    every: int

    def run(self, kernels: str, start: sc.State | None = None) -> sc.History:
        """Some steps."""
        until = self.start.time + STEPS * self.step
        own = {"start": start or self.start, "every": self.every, "settings": self.settings}
        return sc.simulate(*self[1:4], self.step, until, kernels=kernels, **own)

    def __str__(self) -> str:
        items = Counter(type(self.model[name]).__name__ for name in self.model)
        plane = "" if self.system.plane is None else ", in a plane"
        what = ", ".join(f"{n} {kind}" if n > 1 else kind for kind, n in items.items())
        return f"{self.integrator!r}, {self.treatment!r}{plane}, h = {self.step:.2g}: {what}"


def random_scene(seed: int) -> RandomScene:
    """The scene of a number: of the first draw that the package does not refuse."""
    for draw in range(50):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", sc.CosseratWarning)
                return _drawn(np.random.default_rng([seed, draw]))
        except (sc.CosseratError, np.linalg.LinAlgError):
            continue
    raise RuntimeError(f"no scene of number {seed}")


def _drawn(rng: np.random.Generator, held: bool = False) -> RandomScene:
    flat = rng.random() < 0.3
    model = _Scene(rng, flat, held).model()
    system = model.freeze(planar=sc.Planar() if flat else None)
    schemes = (sc.EnergyMomentum(), sc.Variational()) if held else ALL_SCHEMES
    integrator = schemes[int(rng.integers(len(schemes)))]
    treatment = TREATMENTS[int(rng.integers(2))]
    speed = 1.0 if rng.random() < 0.9 else 0.0
    start = sc.initial_state(system, nu=speed * rng.standard_normal(system.unknowns))
    settings = sc.NewtonSettings() if rng.random() < 0.5 else sc.NewtonSettings(reuse=0)
    step = _step(rng, integrator, system)
    every = int(rng.choice((1, 1, 5)))  # what is not recorded may be done in one call
    return RandomScene(model, system, integrator, treatment, step, settings, start, every)


def _step(rng: np.random.Generator, integrator: sc.Integrator, system: sc.System) -> float:
    """It resolves all there is, or, with schemes that can, what moves slowly."""
    stiff = isinstance(integrator, sc.EnergyMomentum | sc.GeneralizedAlpha)
    resolved = 10 ** rng.uniform(-1.0, 2.0 if stiff else 0.1)
    step = resolved / max(highest_frequency(system), 1.0)
    return float(np.clip(step, 2e-5 if stiff else 0.0, 0.01))


# -- scenes ----------------------------------------------------------------------------------------


@dataclass
class _Scene:
    """A model that grows item by item; `flat`: in a plane; `held`: all beams hold strains."""

    rng: np.random.Generator
    flat: bool
    held: bool = False
    into: sc.Model = field(default_factory=sc.Model)
    count: int = 0
    #: where others are attached: with frames, and mass points
    places: list[sc.Place] = field(default_factory=list)
    joints: list[sc.Joint] = field(default_factory=list)
    beams: list[sc.Beam] = field(default_factory=list)

    def __post_init__(self) -> None:
        # the axes of space, or others
        self.axes = np.eye(3) if self.chance(0.5) else rotation(self.rng)
        self.normal = self.axes[2]

    def model(self) -> sc.Model:
        """All of it."""
        if self.chance(0.25):
            self.linkage()
        else:
            self.root()
        for _ in range(int(self.rng.integers(1, 4))):
            self.grow(self.pick(self.places))
        for chance, add in (
            (0.15, self.close),
            (0.3, self.lump),
            (0.25, self.damp),
            (0.7, lambda: self.add(sc.LoadGravity(9.81 * self.vector(), self.amplitude()))),
        ):
            if self.chance(chance):
                add()
        for _ in range(int(self.rng.integers(4))):
            self.pick((self.spring, self.mount, self.on_joint, self.on_joint, self.drive))()
        for _ in range(int(self.rng.integers(3))):
            self.load()
        return self.into

    # -- random numbers

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def pick(self, of: Sequence[Any]) -> Any:
        return of[int(self.rng.integers(len(of)))]

    def vector(self, size: float = 1.0) -> np.ndarray:
        """Any, or in the plane."""
        v = size * self.rng.standard_normal(3)
        return v - (v @ self.normal) * self.normal if self.flat else v

    def direction(self) -> np.ndarray:
        v = self.vector()
        return v / np.linalg.norm(v)

    def axis(self) -> np.ndarray:
        """Of a rotation."""
        return self.normal if self.flat else unit(self.rng)

    def triad(self) -> np.ndarray:
        if not self.flat:
            return rotation(self.rng).T
        axes = np.array(sc.triad(self.normal, self.direction()))
        return np.roll(axes, int(self.rng.integers(3)), axis=0)

    def amplitude(self) -> Any:
        """A factor of loads."""
        time = 10 ** self.rng.uniform(-2.5, 0)
        return self.pick((
            None, None, 2.0, sc.RampLinear(0.2 * time, time, 0.5, 2.0), sc.RampSmooth(0.0, time),
            sc.Harmonic(2.0, 1 / time, 0.3), lambda t: np.cos(t / time),
            sc.Table([0.0, 0.4 * time, 2 * time], [0.2, 1.0, 0.5]),
            sc.FunctionOfTime(lambda t: 1 + abs(t - 0.4 * time) / time, kinks=[0.4 * time]),
        ))  # fmt: skip

    def number(self) -> Callable[[float], float]:
        """Of a prescribed angle or displacement, from zero on."""
        size, rate = self.pick((0.3, -0.5)), 10 ** self.rng.uniform(0, 1.5)
        return self.pick((
            lambda t: size * (rate * t) ** 2, lambda t: size * np.sin(rate * t),
            sc.RampSmooth(0.0, 1 / rate, 0.0, size),
        ))  # fmt: skip

    def ground(self, x: np.ndarray) -> sc.Place:
        """At rest or moving."""
        if self.chance(0.65):
            return sc.ground(x)
        one, other = self.number(), self.number()
        shift, axis = self.vector(0.3), self.axis()
        times = np.linspace(0, 0.1, 11)
        record = np.sin(30 * times)[:, None] * self.vector(3.0)
        motion = self.pick((
            sc.Motion(displacement=lambda t: one(t) * shift),
            sc.Motion(lambda t: one(t) * shift, lambda t: other(t) * axis),
            sc.MotionTurn(axis, one, centre=x + self.vector(0.5)),
            sc.MotionShake(times, record),
        ))  # fmt: skip
        return sc.ground(x, motion)

    # -- beams, bodies, joints

    def add(self, item: Any) -> Any:
        self.count += 1
        return self.into.add(f"{type(item).__name__} {self.count}", item)

    def root(self) -> None:
        """What all others hang on: the ground, or something free."""
        x = self.vector()
        if self.chance(0.75):
            self.places = [self.ground(x)]
            self.grow(self.places[0])
        else:
            self.pick((self.beam, self.body))(x)

    def grow(self, at: sc.Place) -> None:
        """Something on a joint at a place."""
        make = self.pick((self.beam, self.beam, self.body, self.point))
        pointlike = at.triad is None, make == self.point
        kinds = list(POINT_JOINTS if any(pointlike) else JOINTS)
        if not any(pointlike):
            kinds.append(JointPointOnPlane)
        if pointlike == (True, True):
            kinds.remove(sc.JointPointOnLine)
        kind = self.pick(kinds)
        options, gap = self.fitting(kind)
        self.join(kind, at, make(at.position + gap), **options)

    def join(self, kind: type, a: sc.Place, b: sc.Place, **options: Any) -> None:
        ordered = kind in (sc.JointPointOnLine, JointPointOnPlane)
        swap = a.triad is None if ordered else self.chance(0.5)
        self.joints.append(self.add(kind(*((b, a) if swap else (a, b)), **options)))

    def fitting(self, kind: type) -> tuple[dict[str, Any], np.ndarray]:
        """Axes of a joint, and where its other point is."""
        if kind is JointPointOnPlane:
            n = self.direction()
            v = self.vector()
            return {"normal": n}, v - (v @ n) * n
        if not self.flat:
            return fitting(kind, self.rng)
        n, along, zero = self.normal, self.direction(), np.zeros(3)
        if kind is sc.JointUniversal:
            axes = (n, along) if self.chance(0.5) else (along, n)
            return dict(zip(("axis_a", "axis_b"), axes, strict=True)), zero
        if kind is sc.JointPlanar:
            return {"normal": n, "x": along}, self.vector()
        if kind is sc.JointRevolute:
            return {"axis": n}, zero
        if kind in (sc.JointCylindrical, sc.JointPrismatic, sc.JointPointOnLine):
            return {"axis": along}, self.rng.standard_normal() * along
        return {}, self.vector() if kind is sc.JointDistance else zero

    def body(self, x: np.ndarray) -> sc.Place:
        """A rigid body, and where it is held."""
        own: dict[str, Any] = {"position": x + self.vector(0.3), "triad": self.triad()}
        mass = self.pick((0.3, 1.0, 4.0))
        if self.flat or self.chance(0.4):
            shape = self.pick((
                lambda: sc.RigidBody.box(mass, (0.2, 0.3, 0.5), **own),
                lambda: sc.RigidBody.cylinder(mass, 0.2, 0.5, **own),
                lambda: sc.RigidBody.sphere(mass, 0.3, **own),
            ))  # fmt: skip
            body = self.add(shape())
        else:
            body = self.add(sc.RigidBody(mass, TENSOR, center=(0.1, -0.2, 0.15), **own))
        self.places.append(body.at(x + self.vector(0.5)))
        return body.at(x)

    def point(self, x: np.ndarray) -> sc.Place:
        point = self.add(sc.MassPoint(self.pick((0.2, 1.0)), x))
        self.places.append(point.place())
        return point.place()

    def beam(self, x: np.ndarray, end: np.ndarray | None = None) -> sc.Place:
        """A beam from a point, perhaps to another one; its start."""
        order = self.pick((1, 1, 1, 1, 2, 2, 3, 4))
        options: dict[str, Any] = {"order": order}
        count = int(self.rng.integers(1, 6 if order == 1 else 4))
        tangent, name = self.direction(), f"mesh {self.count}"
        bend = np.cross(self.axis(), tangent)
        bend /= np.linalg.norm(bend)
        shape = "line" if end is not None else self.pick(("line", "line", "arc", "bent", "spline"))
        if shape == "line":
            mesh = sc.MeshCurve.init_line(x, x + tangent if end is None else end, count, name)
            if end is not None:
                tangent = (end - x) / np.linalg.norm(end - x)
        elif shape == "arc":
            mesh = sc.MeshCurve.init_arc(x, tangent, bend, 0.8, 1.0, count + 1, name)
        elif shape == "bent":
            corners = [x, x + 0.6 * tangent, x + 0.9 * tangent + 0.5 * bend]
            mesh = sc.MeshCurve.init_polyline(corners, (count + 1) // 2, name)
        else:
            knots = [x, x + 0.4 * tangent + 0.1 * bend, x + 0.8 * tangent, x + 1.2 * tangent]
            mesh = sc.MeshCurve.init_points(knots, name)
        if self.flat:
            options["director"] = self.normal
        elif self.chance(0.5):
            options["director"] = np.array(sc.triad(tangent)[0])
        if not self.flat and self.chance(0.2):
            options["twist"] = 0.4
        if self.chance(0.1):
            options["order"] = self.pick((
                sc.InterpolationEquidistant(max(2, order)),
                sc.InterpolationLobatto(order, order + 1),
            ))  # fmt: skip
        elif self.chance(0.1):
            options["lumped"] = True
        options["theory"] = self.theory()
        beam = self.add(sc.Beam(mesh, self.section(), **options))
        self.beams.append(beam)
        self.places += [
            beam.node(f"{name}.end"),
            beam.node(int(self.rng.integers(mesh.p.shape[1]))),
        ]
        return beam.node(f"{name}.start")

    def theory(self) -> sc.Theory:
        if self.held:
            kind = self.pick((sc.TheoryKirchhoff, sc.TheoryInextensible))
            return kind(torsion=self.chance(0.7))
        if self.chance(0.65):
            return sc.TheoryReissner()
        kinds = (sc.TheoryKirchhoff, sc.TheoryKirchhoff, sc.TheoryInextensible)
        kind = self.pick((*kinds, sc.TheoryInextensible, sc.TheoryReissner, sc.TheoryRigid))
        return kind() if kind is sc.TheoryRigid else kind(torsion=self.chance(0.7))

    def section(self) -> sc.Section:
        inertia = {"mass": 1.3, "inertia": (0.11, 0.07)}
        small = {"mass": 1.3, "inertia": (2e-3, 3e-3)}
        full = sc.Section(np.diag(np.diag(FULL)) if self.flat else FULL, **inertia)
        made: Sequence[Callable[[], sc.Section]] = (
            lambda: full,
            lambda: full,
            lambda: full.damped(time=2e-2),
            lambda: sc.Section(SLENDER, **small),
            lambda: sc.Section(SLENDER, **small).damped(time=1e-3),
            lambda: sc.SectionCircle(0.02, STEEL),
            lambda: sc.SectionRectangle(0.02, 0.03, RUBBER),
            lambda: sc.SectionTube(0.03, 0.025, RUBBER),
            lambda: sc.Section(SLENDER, **small, centre=(0.0, 0.0) if self.flat else (0.01, 0.02)),
            self.stored,
            self.stored,
        )
        return self.pick(made)()

    def stored(self) -> sc.Section:
        """With the energy alone, or its derivatives, too."""
        D = np.array(SLENDER)

        def energy(eps: Any) -> Any:
            return 0.5 * (eps * eps) @ D + 3.0 * eps[..., 4] ** 4 + 2.0 * eps[..., 3] ** 4

        def gradient(eps: Any) -> Any:
            out = eps * D
            out[..., 3:5] += np.array([8.0, 12.0]) * eps[..., 3:5] ** 3
            return out

        def hessian(eps: Any) -> Any:
            more = np.zeros_like(eps)
            more[..., 3:5] = np.array([24.0, 36.0]) * eps[..., 3:5] ** 2
            return (more + D)[..., None] * np.eye(6)

        given = self.pick(({}, {"gradient": gradient}, {"gradient": gradient, "hessian": hessian}))
        section = sc.SectionHyperelastic(energy, 1.3, (2e-3, 3e-3), **given)
        return section.damped(time=1e-3) if self.chance(0.2) else section

    def linkage(self) -> None:
        """A four-bar linkage, its bars rigid or beams, driven, on springs or as it falls."""
        along = self.direction()
        across = np.cross(self.normal, along) if self.flat else np.cross(unit(self.rng), along)
        across /= np.linalg.norm(across)
        n, x = np.cross(along, across), self.vector()
        corners = [x, x + across, x + 2 * along + 1.5 * across, x + 2 * along]
        last = self.ground(corners[0]) if self.chance(0.3) else sc.ground(corners[0])
        for a, b in pairwise(corners):
            if self.chance(0.4):
                start = self.beam(a, b)
                after = self.beams[-1].node(b)
            else:
                start = self.body(a)
                after = start.item.at(b)
            self.join(sc.JointRevolute, last, start, axis=n)
            last = after
        end = sc.ground(corners[-1])
        kind = sc.JointRevolute if self.flat or self.chance(0.5) else sc.JointCylindrical
        if self.chance(0.25):
            self.join(sc.JointSpherical, last, end)
        else:
            self.join(kind, last, end, axis=n)

    def close(self) -> None:
        """A loop."""
        a, b = self.two_places()
        if self.chance(0.6) or b.triad is None or a.triad is None:
            self.join(sc.JointDistance, a, b)
        elif isinstance(b.item, sc.RigidBody):
            kind = self.pick((sc.JointSpherical, sc.JointPointOnLine))
            options, gap = self.fitting(kind)
            self.join(kind, a, b.item.at(a.position + gap), **options)

    def two_places(self) -> tuple[sc.Place, sc.Place]:
        """On different items."""
        a = self.pick(self.places)
        others = [b for b in self.places if b.item is not a.item]
        return a, self.pick(others) if others else self.ground(a.position + self.vector())

    def framed(self) -> sc.Place | None:
        places = [p for p in self.places if p.item is not None and p.triad is not None]
        return self.pick(places) if places else None

    def lump(self) -> None:
        at = self.framed()
        if at is None:
            return
        if self.flat or self.chance(0.5):
            self.add(sc.MassPoint(0.4, on=at))
        else:
            self.add(sc.RigidBody(0.7, TENSOR, center=(0.05, 0.1, -0.1), on=at))

    # -- forces

    def spring(self) -> None:
        kind, (a, b) = self.pick((sc.SpringDamper, sc.Cable)), self.two_places()
        length = float(np.linalg.norm(b.position - a.position))
        damping = self.pick((0.0, 0.3))
        self.add(kind(a, b, 10 ** self.rng.uniform(0, 3), damping, length=length * 0.9))

    def mount(self) -> None:
        """A bushing or a foundation."""
        if self.beams and self.chance(0.4):
            stiffness = self.pick((50.0, np.array([20.0, 20.0, 20.0])))
            self.add(sc.Foundation(self.pick(self.beams), stiffness, self.pick((0.0, 0.5))))
            return
        a, b = self.framed(), self.framed()
        if a is None or b is None:
            return
        if a.item is b.item:
            a = self.ground(b.position)
        K, C = np.diag([90.0, 90, 90, 5, 5, 5]), np.diag([1.0, 1, 1, 0.1, 0.1, 0.1])
        if not self.flat:
            K[0, 1] = K[1, 0] = 30.0
            K[2, 4] = K[4, 2] = 4.0
        self.add(sc.Bushing(a, b, K, self.pick((None, C))))

    def on_joint(self) -> None:
        """A spring, a damper or an actuator on a coordinate of a joint."""
        having = [joint for joint in self.joints if joint.coordinates()]
        if not having:
            return
        joint = self.pick(having)
        coordinate = self.pick(joint.coordinates())
        if self.chance(0.3):
            if coordinate.size == 1:
                self.add(sc.JointActuator(joint, self.amplitude() or 1.0, coordinate.name))
            else:
                value = self.axis()
                self.add(sc.JointActuator(joint, lambda t: np.cos(9 * t) * value, coordinate.name))
            return
        law = self.pick(((8.0, 0.0), (8.0, 0.3), (0.0, 0.3)))
        neutral = 0.0 if coordinate.size == 3 or law[0] == 0.0 else 0.2
        self.add(sc.JointSpringDamper(joint, *law, coordinate.name, neutral))

    def drive(self) -> None:
        if self.chance(0.5):
            return
        able = [
            (joint, c.name)
            for joint in self.joints
            for c in joint.coordinates()
            if c.kind in ("angle", "displacement")
        ]
        if able:
            joint, name = self.pick(able)
            self.add(sc.JointDrive(joint, self.number(), name))

    def damp(self) -> None:
        """Of everything, or of one item; viscous sections need beams."""
        of = None if self.chance(0.5) else self.framed()
        item = None if of is None else of.item
        beams = bool(self.beams) if item is None else isinstance(item, sc.Beam)
        stiffness = self.pick((0.0, 1e-3)) if beams else 0.0
        mass = self.pick((0.0, 0.5)) if stiffness else 0.5
        self.add(sc.RayleighDamping(mass, stiffness, item))

    def load(self) -> None:
        at = self.framed()
        follower, time = self.chance(0.4), self.amplitude()
        if at is None:
            return
        # components of those that follow a triad
        local = (lambda v: at.triad @ v) if follower else (lambda v: v)
        force, moment = local(self.vector(3.0)), local(self.axis())
        push, growth = self.vector(), self.vector(20.0)
        made: list[Callable[[], sc.Load]] = [
            lambda: sc.LoadForce(at, force, time, follower=follower),
            lambda: sc.LoadForce(at, lambda t: push + growth * t),
            lambda: sc.LoadMoment(at, moment, time, follower=follower),
            lambda: drag(at, 0.3, sc.time_function.time_function("drag", time).value),
        ]
        if self.beams:
            beam = self.pick(self.beams)
            whole = self.vector(2.0)
            if follower and self.flat:  # along the line, which is in the plane
                whole = np.array([0.0, 0.0, 2.0])
            made += [lambda: sc.LoadLine(beam, whole, time, follower=follower)] * 2
        self.add(self.pick(made)())


# -- compiled kernels against plain numpy ----------------------------------------------------------


class NotSolvedError(Exception):
    """Plain numpy finds no solution, however small the step."""


class Compared(NamedTuple):
    """A scene: why there are no kernels, or how far they are off numpy.

    Attributes
    ----------
    refused : str or None
    off : dict of str to (float, float)
        By series: how far, and how far it may be, both relative to its size.
    trouble : str
        A run that failed.
    """

    refused: str | None
    off: dict[str, tuple[float, float]]
    trouble: str = ""

    @property
    def worst(self) -> float:
        """How near a series comes to what it may be off: below one."""
        return max((found / allowed for found, allowed in self.off.values()), default=0.0)

    @property
    def same(self) -> bool:
        """Whether nothing differs by more than it may."""
        return not self.trouble and self.worst <= 1.0

    def __str__(self) -> str:
        if self.refused or self.trouble:
            return self.refused or self.trouble
        wrong = [
            f"{k} {off:.1e} of {most:.1e}" for k, (off, most) in self.off.items() if off > most
        ]
        return ", ".join(wrong) or f"{self.worst:.2g} of what it may be"


def solvable(scene: RandomScene) -> tuple[RandomScene, sc.History]:
    """The scene with a step that plain numpy can take, and its run."""
    for _ in range(6):
        try:
            return scene, scene.run("numpy")
        except sc.Diverged:
            scene = scene._replace(step=scene.step / 4)
    raise NotSolvedError(f"not solved with steps of {scene.step:.2g}: {scene}")


def compared(scene: RandomScene) -> Compared:
    """Run it with both kernels, and with numpy from two starts changed in the last place."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sc.CosseratWarning)
        scene, plain = solvable(scene)
        try:
            compiled = scene.run("numba")
        except sc.InputError as error:
            if "no compiled kernels" not in str(error):
                raise
            return Compared(str(error).split("compiled kernels for ")[1], {})
        except sc.Diverged as error:
            return Compared(None, {}, f"{error}")
        beside = [scene.run("numpy", nudged(scene.start, k)) for k in range(2)]
    return Compared(None, _off(scene, plain, compiled, beside))


def _off(
    scene: RandomScene, plain: sc.History, compiled: sc.History, beside: Sequence[sc.History]
) -> dict[str, tuple[float, float]]:
    """Differences of series, and what they may be: see :class:`Compared`."""
    if "turns" in plain and not np.array_equal(plain["turns"], compiled["turns"]):
        return {"turns": (np.inf, 1.0)}
    energies = max(abs(plain[name]).max() for name in ENERGIES if name in plain)
    # what momenta and forces are differences of, and the part of it that is left over: rounding,
    # or increments that are left out with kept factors
    q = plain["q"]
    inertia = (abs(scene.system.mass) @ abs(q).max(axis=0).reshape(-1, 3)).max()
    left = EPS if scene.settings.reuse == 0 else ROUNDING
    h = scene.step * min(map(abs, scene.integrator.shares), default=1.0)
    force, momentum = 10 * left * inertia / h**2, 10 * left * inertia / h
    way, speed = abs(q - q[0]).max(), abs(plain["v"]).max()
    terms = {"constraint_force": force, "multipliers": force, "p": momentum, "carried": momentum}
    terms |= {"kinetic": momentum * speed, "energy": momentum * speed, "work_drives": force * way}
    out = {}
    for name in (*MOTION, *ENERGIES):
        if name not in plain or plain[name].size == 0:
            continue
        a, b, *others = (run[name] for run in (plain, compiled, *beside))
        known = np.isfinite(a)
        if not np.array_equal(known, np.isfinite(b)):
            return {name: (np.inf, 1.0)}
        size = energies if name in ENERGIES else abs(a[known]).max(initial=0.0)
        size = max(size, 1e-300)
        nudge = max(abs(a - other)[known].max(initial=0.0) for other in others)
        allowed = max(1e-11 * size, 10 * nudge, terms.get(name, 0.0))
        out[name] = abs(a - b)[known].max(initial=0.0) / size, allowed / size
    return out


def held_apart(seed: int) -> tuple[float, str]:
    """How far compiled runs by both treatments are apart, by the size of q; what the scene is."""
    for draw in range(1000):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", sc.CosseratWarning)
                scene = _drawn(np.random.default_rng([seed, draw, 1]), held=True)
                if not holds_strains(scene.system):
                    continue
                scene, _ = solvable(scene)
        except (sc.CosseratError, np.linalg.LinAlgError, NotSolvedError):
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sc.CosseratWarning)
            one, other = (scene._replace(treatment=each).run("numba") for each in TREATMENTS)
        told = [notice for notice in one.meta["warnings"] if notice["time"] is not None]
        if any("in a singular position" in notice["text"] for notice in told):
            continue  # from there the motion is not determined
        off = abs(one["q"] - other["q"]).max() / abs(one["q"]).max()
        return float(off), str(scene)
    raise RuntimeError(f"no scene of number {seed}")


def _held(seeds: Sequence[int], verbose: bool) -> int:
    """All of these; 1 if treatments differ by more than 1e-9, or one of them fails."""
    found, failed = [], []
    for seed in seeds:
        try:
            off, scene = held_apart(seed)
        except Exception as error:  # noqa: BLE001  # the others are to be run, too
            failed.append(f"{seed}: {type(error).__name__}: {error}")
            continue
        found.append(off)
        if verbose or not off <= 1e-9:
            _say(f"{seed}: {off:.1e}; {scene}")
    far = sum(not off <= 1e-9 for off in found)
    _say(f"{len(found)} scenes with held strains by both treatments, {far} more than 1e-9 apart")
    _say(f"median {np.median(found):.1e}, largest {max(found):.1e}; {len(failed)} failed", *failed)
    return int(far + len(failed) > 0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare many, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--seeds", type=int, default=500, help="how many scenes (500)")
    parser.add_argument("--first", type=int, default=0, help="number of the first one (0)")
    parser.add_argument("--verbose", action="store_true", help="a line for each scene")
    parser.add_argument("--held", action="store_true", help="held strains, by both treatments")
    options = parser.parse_args(arguments)
    seeds = range(options.first, options.first + options.seeds)
    if options.held:
        return _held(seeds, options.verbose)
    results: list[tuple[int, Compared]] = []
    unsolved = []
    for seed in seeds:
        scene = random_scene(seed)
        try:
            found = compared(scene)
        except NotSolvedError as error:
            unsolved.append(f"{seed}: {error}")
            continue
        except Exception as error:  # noqa: BLE001  # the others are to be run, too
            found = Compared(None, {}, f"{type(error).__name__}: {error}")
        results.append((seed, found))
        if options.verbose or not found.same:
            _say(f"{seed}: {found}; {scene}")
    for line in _table(results):
        _say(line)
    _say(f"{len(unsolved)} scenes that plain numpy does not solve", *unsolved)
    return 0 if all(found.same for _, found in results) else 1


def _table(results: Sequence[tuple[int, Compared]]) -> Iterator[str]:
    """How many are compared, and reasons why others are not."""
    bad = [seed for seed, found in results if not found.same]
    count = sum(bool(found.off) for _, found in results)
    yield f"\n{count} scenes compared, {len(bad)} differ by more than they may: {bad}"
    yield f"nearest to it: {max((found.worst for _, found in results), default=0.0):.2g} of that"
    reasons = Counter(found.refused for _, found in results if found.refused)
    yield f"{reasons.total()} scenes without compiled kernels"
    for reason, number in reasons.most_common():
        yield f"{number:6d}  {reason}"


def _say(*lines: str) -> None:
    sys.stdout.write("\n      ".join(lines) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
