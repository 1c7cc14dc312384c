"""Random runs of twenty kinds: do warnings tell those that are wrong from those that are right?

    python tests/random_runs.py                 60 right runs, 30 wrong ones
    python tests/random_runs.py --right 5 --wrong 5

Ten kinds are those of examples/benchmarks/warned_runs.py, where little but gravity acts. In the ten
others something enters the run: shaken ground, drives, pulses, loads that vibrate. A number makes a
scene, an integrator, a treatment, a step from 200 to 1.6 parts of the shortest time of the scene,
runs of 6, 20 or 100 steps, of which each is recorded or each fifth.

The truth is the same run with halved steps, until two of them differ by less than a hundredth of
the range of the motion; what it warns of is not about steps, so it must not. *Right* is a run that
is off by less than a fiftieth, *wrong* one that is off by more than a tenth: in space, or relative
to ground that is shaken. Other runs, and those that are not solved, are drawn again. Numbers,
and with them kinds, are taken in turn, until there are at least as many right and wrong runs as
asked for. Ends with 1 if more than a twentieth of the right runs are warned, or more than a
fifteenth of the wrong ones are not. Runs that are warned though right, or silent though wrong, are
printed.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

sys.path.append(str(Path(__file__).parents[1] / "examples" / "benchmarks"))

import numpy as np
import warned_runs  # before numpy: one thread

import skfem_cosserat as sc

#: the first number, fixed before the checks were written
SEED = 38_011
RIGHT, WRONG, HALVINGS = 0.02, 0.1, 7
SCHEMES = (
    *(sc.EnergyMomentum(), sc.Variational(), sc.GeneralizedAlpha(0.8), sc.EnergyDecaying(0.1)),
    sc.Composition(sc.EnergyMomentum(), 4),
)
TREATMENTS = (sc.NullSpace(), sc.Multipliers())
Random = np.random.Generator
Built = tuple[sc.Model, float]


def mast(
    random: Random, foot: Callable[[float], sc.Place] = lambda period: sc.ground((0, 0, 0))
) -> tuple[sc.Model, sc.Beam, float, float]:
    """An upright rod whose foot is held: its first period (s), and a force that bends it far."""
    length = random.uniform(0.5, 2.0)
    section = warned_runs.rubber(random, length * 10 ** random.uniform(-2, -1.5))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 0, length), 4, name="mast")
    model, period = sc.Model(), warned_runs._bending(section, length)
    rod = model.add("mast", sc.Beam(mesh, section, director=(1, 0, 0), order=2))
    model.add("foot", sc.JointFixed(foot(period), rod.node("mast.start")))
    size = 0.3 * section.stiffness[3, 3] / length**2
    return model, rod, period, size


def _beside(random: Random, period: float, low: float = -0.7, high: float = 0.9) -> float:
    """A time from a fraction to a multiple of a period."""
    return float(period * 10 ** random.uniform(low, high))


def shaken(random: Random) -> Built:
    """A mast on ground that vibrates, from rest."""
    times = []

    def foot(period: float) -> sc.Place:
        time = _beside(random, period)
        times.append(time)
        start = sc.RampSmooth(0.0, time)
        motion = sc.Motion(lambda t: (0.1 * start.value(t) * np.sin(2 * np.pi * t / time), 0, 0))
        return sc.ground((0, 0, 0), motion)

    model, _, period, _ = mast(random, foot)
    return model, min(period, *times, period)


def quake(random: Random) -> Built:
    """A mast in an earthquake: noise, and a period that stands out."""

    def foot(period: float) -> sc.Place:
        times = np.linspace(0, 20 * period, 401)
        noise = random.normal(size=(401, 3)) + np.sin(2 * np.pi * times / period)[:, None]
        rise = np.minimum(1.0, times / period)[:, None]
        return sc.ground((0, 0, 0), sc.MotionShake(times, rise * noise / period**2 / 10, True))

    model, _, period, _ = mast(random, foot)
    return model, period


def crank(random: Random) -> Built:
    """A driven crank with a pendulum on its end."""
    reach, turn = random.uniform(0.1, 0.5), 10 ** random.uniform(-0.5, 1.0)
    model = sc.Model()
    arm = model.add("arm", sc.RigidBody.box(1.0, (reach, 0.1, 0.1), position=(reach / 2, 0, 0)))
    bob = model.add("bob", sc.RigidBody.box(1.0, (0.1, 0.5, 0.1), position=(reach, -0.25, 0)))
    place = sc.ground((0, 0, 0)), arm.at((0, 0, 0))
    pin = model.add("pin", sc.JointRevolute(*place, axis=(0, 0, 1)))
    end = arm.at((reach, 0, 0)), bob.at((reach, 0, 0))
    model.add("end", sc.JointRevolute(*end, axis=(0, 0, 1)))
    model.add("weight", sc.LoadGravity((0, -9.81, 0)))
    ramp = sc.RampSmooth(0.0, 2 / turn)
    model.add("motor", sc.JointDrive(pin, lambda t: 2 * np.pi * turn * t * ramp.value(t)))
    return model, min(1.2, 1 / turn)


def blade(random: Random) -> Built:
    """A rod on a hub that speeds up, or turns to and fro."""
    time, forth = [0.0], random.random() < 0.5
    angle = random.uniform(0.3, 1.0)

    def foot(period: float) -> sc.Place:
        time[0] = _beside(random, period, -0.3)
        ramp = sc.RampSmooth(0.0, 4 * time[0], last=20 * angle)

        def turn(t: float) -> float:
            return angle * np.sin(2 * np.pi * t / time[0]) ** 3 if forth else ramp.value(t)

        return sc.ground((0, 0, 0), sc.MotionTurn((0, 1, 0), turn))

    model, _, period, _ = mast(random, foot)
    return model, min(period, time[0] / (3 if forth else 1))


def blow(random: Random) -> Built:
    """A mast that a short pulse hits, longer or shorter than steps."""
    model, rod, period, size = mast(random)
    time = _beside(random, period, -2.0, 0.0)
    begin = random.uniform(0.1, 0.5) * period
    shape = sc.Table(begin + time * np.array([0, 0.5, 1]), [0, size * period / time, 0])
    pulse = shape if random.random() < 0.5 else sc.FunctionOfTime(shape.value, kinks=shape.times)
    model.add("blow", sc.LoadForce(rod.node("mast.end"), (0.2, 0.1, 0), pulse))
    return model, period


def hum(random: Random) -> Built:
    """A mast under a force that vibrates."""
    model, rod, period, size = mast(random)
    time = _beside(random, period)
    hum = sc.Harmonic(size, 1 / time, random.uniform(0, 6))
    load = hum if random.random() < 0.5 else hum.value
    model.add("hum", sc.LoadForce(rod.node("mast.end"), (1.0, 0.5, 0), load))
    return model, min(period, time)


def gust(random: Random) -> Built:
    """A mast under a follower load along it, in gusts, with damping."""
    model, rod, period, size = mast(random)
    time = _beside(random, period, -0.3)
    load = sc.FunctionOfTime(lambda t: size * (1 + np.sin(2 * np.pi * t / time) ** 3))
    model.add("gust", sc.LoadForce(rod.node("mast.end"), (0.5, 0.2, 0), load, follower=True))
    model.add("air", sc.RayleighDamping(mass=random.uniform(0, 2) / period))
    return model, min(period, time / 3)


def buffer(random: Random) -> Built:
    """A mass on a spring and a damper, pushed by a ramp."""
    model, stiffness = sc.Model(), 10 ** random.uniform(1, 5)
    ball = model.add("ball", sc.MassPoint(1.0, position=(1, 0, 0)))
    period = 2 * np.pi / np.sqrt(stiffness)
    place, damping = (sc.ground((0, 0, 0)), ball.place()), random.uniform(0, 0.5)
    damper = {"stiffness": stiffness, "damping": damping * np.sqrt(stiffness)}
    model.add("buffer", sc.SpringDamper(*place, **damper))
    time = _beside(random, period)
    ramp = random.choice((sc.RampLinear, sc.RampSmooth))(0.2 * period, 0.2 * period + time)
    model.add("push", sc.LoadForce(ball.place(), (0.1 * stiffness, 0, 0), ramp))
    return model, period


def hoist(random: Random) -> Built:
    """A body on a cable whose upper end moves up and down."""
    model, stiffness = sc.Model(), 10 ** random.uniform(2, 5)
    period = 2 * np.pi / np.sqrt(stiffness)
    time, size = _beside(random, period), random.uniform(0.02, 0.2)
    motion = sc.Motion(lambda t: (0, 0, size * np.sin(np.pi * t / time) ** 2))
    body = model.add("body", sc.RigidBody.box(1.0, (0.2, 0.2, 0.2), position=(0, 0, -1.0)))
    place = sc.ground((0, 0, 0), motion), body.at((0, 0, -0.9))
    model.add("cable", sc.Cable(*place, stiffness=stiffness, damping=0.05 * np.sqrt(stiffness)))
    model.add("weight", sc.LoadGravity((0.5, 0, -9.81)))
    return model, min(period, time)


def slider(random: Random) -> Built:
    """A closed loop: a crank with a torque, a rod, a slider on a spring."""
    model = sc.Model()
    arm = model.add("arm", sc.RigidBody.box(1.0, (0.3, 0.1, 0.1), position=(0, 0.15, 0)))
    rod = model.add("rod", sc.RigidBody.box(1.0, (0.1, 1.0, 0.1), position=(0.4, 0.15, 0)))
    load = model.add("slider", sc.RigidBody.box(2.0, (0.2, 0.2, 0.2), position=(0.8, 0, 0)))
    axis, base = (0, 0, 1), sc.ground((0, 0, 0))
    pin = model.add("pin", sc.JointRevolute(base, arm.at((0, 0, 0)), axis=axis))
    top, end = (0, 0.3, 0), (0.8, 0, 0)
    model.add("top", sc.JointRevolute(arm.at(top), rod.at(top), axis=axis))
    model.add("end", sc.JointRevolute(rod.at(end), load.at(end), axis=axis))
    model.add("way", sc.JointPrismatic(base, load.at(end), axis=(1, 0, 0)))
    rate = 10 ** random.uniform(1, 3)
    model.add("spring", sc.SpringDamper(sc.ground((2, 0, 0)), load.at(end), stiffness=rate))
    time = _beside(random, 2 * np.pi / np.sqrt(rate / 2.5))
    model.add("motor", sc.JointActuator(pin, lambda t: 0.2 * rate * np.sin(2 * np.pi * t / time)))
    return model, min(time, 2 * np.pi / np.sqrt(rate / 2.5))


KINDS: tuple[Callable[[Random], Built], ...] = (
    *warned_runs.SCENES,
    *(shaken, quake, crank, blade, blow, hum, gust, buffer, hoist, slider),
)


class Case(NamedTuple):
    """A random run of a number, with its step or parts of it."""

    system: sc.System
    integrator: sc.Integrator
    treatment: sc.Treatment
    step: float
    count: int
    every: int

    @classmethod
    def of(cls, number: int) -> Case:
        """That of a number."""
        random = np.random.default_rng([SEED, number])
        model, time = KINDS[number % len(KINDS)](random)
        scheme, treatment = (of[int(random.integers(len(of)))] for of in (SCHEMES, TREATMENTS))
        step, every = time / 10 ** random.uniform(0.2, 2.3), int(random.choice((1, 1, 1, 5)))
        count = int(random.choice((6, 20, 100) if every == 1 else (30, 100)))
        return cls(model.freeze(), scheme, treatment, step, count, every)

    def run(self, parts: int = 1) -> sc.History:
        """The run with so many steps instead of each."""
        own = {"every": self.every * parts, "derive": False}
        *scene, h, count, _ = self
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sc.CosseratWarning)
            return sc.simulate(*scene, h / parts, count * h, **own)


class Drawn(NamedTuple):
    """A run that is right or wrong, and what it says."""

    number: int
    case: Case
    off: float
    said: list[str]

    def __str__(self) -> str:
        kind, (_, scheme, treatment, *numbers) = KINDS[self.number % len(KINDS)], self.case
        about = f"{kind.__name__}, {scheme!r}, {treatment!r}, {numbers}"
        return f"{self.number}: {about}: off by {self.off:.2g}; {self.said or 'silent'}"


def drawn_run(number: int) -> Drawn | None:
    """That of a number; None if no step is short enough, or it is neither right nor wrong."""
    case = Case.of(number)
    try:
        rough, before = case.run(), case.run(2)
        for k in range(2, HALVINGS):
            fine = case.run(2**k)
            if _apart(case.system, before, fine) < RIGHT / 2:
                break
            before = fine
        else:
            return None
    except (sc.Diverged, sc.InputError):
        return None
    off = _apart(case.system, rough, fine)
    if RIGHT < off < WRONG or fine.meta["warnings"]:
        return None
    return Drawn(number, case, off, said(rough))


def said(history: sc.History) -> list[str]:
    """Warnings of a run."""
    return [f"{note['item']}: {note['text']}" for note in history.meta["warnings"]]


def _apart(system: sc.System, one: sc.History, other: sc.History) -> float:
    """Largest distance of a position, by the range of what moves most, in space or beside it."""
    a, b = (each["q"].reshape(len(each), -1, 3)[:, system.origin_rows] for each in (one, other))
    shaken = [p for p in system.moving if type(p.motion) in (sc.Motion, sc.MotionShake)]
    ways = [np.linalg.norm(np.ptp(b, axis=0), axis=-1).max()]
    for place in shaken:
        ground = np.array([place.motion.frame(place, t)[0] for t in other.times.tolist()])
        ways.append(np.linalg.norm(np.ptp(b - ground[:, None], axis=0), axis=-1).max())
    return float(np.linalg.norm(a - b, axis=-1).max() / max(min(ways), 1e-300))


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw, and count."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--right", type=int, default=60, help="how many right runs (60)")
    parser.add_argument("--wrong", type=int, default=30, help="how many wrong runs (30)")
    options = parser.parse_args(arguments)
    numbers = itertools.count()
    found: dict[bool, list[Drawn]] = {True: [], False: []}
    while len(found[False]) < options.right or len(found[True]) < options.wrong:
        each = drawn_run(next(numbers))
        if each is None:
            continue
        wrong = each.off > WRONG
        found[wrong].append(each)
        if bool(each.said) != wrong:
            sys.stdout.write(f"{each}\n")
            sys.stdout.flush()
    false = sum(bool(each.said) for each in found[False])
    silent = sum(not each.said for each in found[True])
    sys.stdout.write(f"{len(found[False])} right runs, {false} of them warned\n")
    sys.stdout.write(f"{len(found[True])} wrong runs, {silent} of them silent\n")
    return int(20 * false > len(found[False]) or 15 * silent > len(found[True]))


if __name__ == "__main__":
    sys.exit(main())
