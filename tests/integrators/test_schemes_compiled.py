"""Every scheme that compiled kernels have, against plain numpy: scenes of all kinds, whole runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers_scenes import four_bar
from helpers_schemes import SCHEMES, compiled

import skfem_cosserat as sc

pytest.importorskip("numba")

GROUND, Z = sc.ground((0, 0, 0)), (0, 0, 1)
SECTION = sc.Section((2e4, 2e4, 5e4, 40.0, 60.0, 30.0), mass=1.3, inertia=(2e-3, 3e-3))
NULL, MULTIPLIERS = sc.NullSpace(), sc.Multipliers()
COMPILED = [
    *(scheme for scheme in SCHEMES if compiled(scheme)),
    sc.EnergyDecaying(0.1, velocity=False),
    sc.EnergyDecaying(rate=8.0, velocity=False, stabilized=True),
    sc.Composition(sc.EnergyMomentum()),
]
STEPS = 20


# -- scenes ----------------------------------------------------------------------------------------


class LoadPull(sc.Load):
    """Towards a point as a stiffening spring, with the square of the speed against the motion."""

    def __init__(self, place: sc.Place, fails: float = np.inf) -> None:
        super().__init__(amplitude=sc.Harmonic(1.0, 3.0, np.pi / 3))
        self.place, self.fails = place, fails

    def terms(self) -> list[sc.Term]:
        return [sc.TermFunction([sc.ground((1, 1, 0)), self.place], self.force, self.time)]

    def force(self, x: Any, v: Any, t: float) -> Any:
        if t > self.fails:
            raise RuntimeError("out of reach")
        r = x[1] - x[0]
        pull = 3.0 * (1 + r @ r) * r + 0.2 * np.sqrt((v[1] * v[1]).sum() + 1e-4) * v[1]
        return np.array([pull, -pull])


def arm(
    theory: sc.Theory | None = None, section: sc.Section = SECTION, planar: bool = False
) -> tuple[sc.Model, sc.Place]:
    """A beam on a hinge, a box on its end, a bob on a rope; what is at the end."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="rod")
    beam = model.add("beam", sc.Beam(mesh, section, director=Z, theory=theory))
    axis = Z if planar else (0.6, 0.0, 0.8)
    model.add("hinge", sc.JointRevolute(GROUND, beam.node("rod.start"), axis))
    box = model.add("box", sc.RigidBody.box(0.5, (0.2, 0.1, 0.1), position=(1.1, 0, 0)))
    weld = sc.JointFixed if planar else sc.JointSpherical
    model.add("weld", weld(beam.node("rod.end"), box.at((1, 0, 0))))
    bob = model.add("bob", sc.MassPoint(0.2, position=(1.1, -0.5, 0)))
    model.add("rope", sc.JointDistance(box.at((1.1, 0, 0)), bob.place()))
    model.add("gravity", sc.LoadGravity((0.3, -9.81, 0.0 if planar else 0.2)))
    return model, box.at((1.2, 0.02, 0))


def tree() -> sc.System:
    model, tip = arm()
    end = model["beam"].node("rod.end")
    model.add("follower", sc.LoadForce(end, (1.0, 2.0, 0.5), sc.Harmonic(1.0, 3.0), follower=True))
    model.add("moment", sc.LoadMoment(tip, (0.3, -0.2, 0.1), lambda t: np.cos(20 * t)))
    return model.freeze()


def plane() -> sc.System:
    model, tip = arm(planar=True)
    model.add("push", sc.LoadForce(tip, (1.0, 2.0, 0.0), sc.Harmonic(1.0, 3.0)))
    return model.freeze(planar=sc.Planar())


def plane_with_follower() -> sc.System:
    model, tip = arm(planar=True)
    model.add("push", sc.LoadForce(tip, (1.0, 2.0, 0.0), sc.Harmonic(1.0, 3.0), follower=True))
    return model.freeze(planar=sc.Planar())


def inextensible() -> sc.System:
    return arm(sc.TheoryInextensible())[0].freeze()


def unshearable() -> sc.System:
    return arm(sc.TheoryKirchhoff())[0].freeze()


def loop() -> sc.System:
    """A four-bar linkage, as it falls, with a beam on its coupler."""
    model = four_bar()
    mesh = sc.MeshCurve.init_line((0, 1, 0), (-0.5, 1, 0.1), 2, name="mast")
    mast = model.add("mast", sc.Beam(mesh, SECTION, director=Z))
    model.add("foot", sc.JointFixed(model["coupler"].at((0, 1, 0)), mast.node("mast.start")))
    model.add("weight", sc.LoadGravity((1.0, -9.81, 0.2)))
    return model.freeze()


def springs() -> sc.System:
    """And an actuator, and moving ground."""
    model, tip = arm()
    shake = sc.Motion(displacement=lambda t: (0.1 * np.sin(3 * t) ** 2, 0.0, 0.0))
    model.add("coil", sc.JointSpringDamper(model["hinge"], stiffness=5.0, damping=0.2))
    model.add("torque", sc.JointActuator(model["hinge"], sc.FunctionOfTime(np.sin)))
    model.add("strut", sc.SpringDamper(sc.ground((2, 1, 1), shake), tip, 20.0, damping=2.0))
    return model.freeze()


def cable() -> sc.System:
    """It gets slack and tight."""
    model, tip = arm()
    model.add("cable", sc.Cable(sc.ground((1, 1, -1)), tip, 30.0, damping=0.5))
    return model.freeze()


def bushing() -> sc.System:
    model, tip = arm()
    shake = sc.Motion(displacement=lambda t: (0.1 * np.sin(3 * t) ** 2, 0.0, 0.0))
    model.add("mount", sc.Bushing(sc.ground((1.2, 0.02, 0), shake), tip, 5.0, 0.2))
    model.add("coil", sc.JointSpringDamper(model["hinge"], stiffness=5.0, damping=0.2))
    return model.freeze()


def own_load() -> sc.System:
    model, tip = arm()
    model.add("pull", LoadPull(tip))
    return model.freeze()


def drag() -> sc.System:
    model, _ = arm()
    model.add("drag", sc.RayleighDamping(mass=0.5))
    return model.freeze()


def viscous() -> sc.System:
    return arm(section=SECTION.damped(time=1e-3))[0].freeze()


TREES = [tree, plane, plane_with_follower, springs, cable, bushing, own_load, drag, viscous]
NULL_SPACE_ONLY = [inextensible, unshearable, loop]
DAMPED = [drag, viscous]
PAIRS = [(scene, treatment) for scene in TREES for treatment in (NULL, MULTIPLIERS)]
PAIRS += [(scene, NULL) for scene in NULL_SPACE_ONLY]


def missing(scene: Callable[[], sc.System], scheme: sc.Integrator) -> bool:
    """Dampers at the ends of steps that are not there as force elements."""
    return scene in DAMPED and isinstance(scheme, sc.GeneralizedAlpha)


# -- the same runs ---------------------------------------------------------------------------------

MOTION = ("q", "p", "constraint_force")
WORKS = ("work_loads", "work_actuators", "work_drives", "dissipated")


def assert_same(compiled: sc.History, plain: sc.History, limit: float = 1e-10) -> None:
    """Motion and works, to a share of their sizes."""
    assert (compiled.meta["kernels"], plain.meta["kernels"]) == ("numba", "numpy")
    assert compiled.times == pytest.approx(plain.times, abs=1e-14)
    energies = [np.nanmax(abs(plain[name])) for name in (*WORKS, "energy") if name in plain]
    sizes = {name: np.nanmax(abs(plain[name])) for name in MOTION}
    sizes |= {name: max(energies) for name in WORKS if name in plain}
    for name, size in sizes.items():
        apart = abs(compiled[name] - plain[name])
        assert (np.isnan(compiled[name]) == np.isnan(plain[name])).all(), name
        assert np.nanmax(apart, initial=0.0) <= limit * size, name
    if "turns" in plain:
        assert compiled["turns"].tolist() == plain["turns"].tolist()


def pair_of_runs(*run: Any, **options: Any) -> tuple[sc.History, sc.History]:
    """Compiled and plain, without kept factors: with the same iterates."""
    options = {"settings": sc.NewtonSettings(reuse=0)} | options
    return tuple(sc.simulate(*run, kernels=kernels, **options) for kernels in ("numba", "numpy"))


@pytest.mark.parametrize(
    ("scene", "treatment"), PAIRS, ids=lambda each: getattr(each, "__name__", repr(each))
)
@pytest.mark.parametrize("scheme", COMPILED, ids=repr)
def test_kernels_agree(scheme, scene, treatment):
    system = scene()
    if missing(scene, scheme):
        with pytest.raises(sc.InputError, match="damped beams at the ends of steps"):
            sc.simulate(system, scheme, treatment, 2e-3, 0.04, kernels="numba")
        return
    h = 2e-3
    compiled, plain = pair_of_runs(system, scheme, treatment, h, STEPS * h)
    assert abs(plain["q"][-1] - plain["q"][0]).max() > 1e-3
    assert_same(compiled, plain)
