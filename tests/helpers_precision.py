"""Problems and setups for studies of work and of stability; importable in other processes."""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np

import skfem_cosserat as sc
from skfem_cosserat.accuracy import FULL_PROTOCOL

STEP_COST = 1e-4


def euler(rate, step):
    """x' = rate x from 1 to t = 1 by the explicit Euler method: cost and error known."""
    count = round(1 / step)
    return {
        "x": (1 + rate * step) ** count,
        "cost_s": STEP_COST * count,
        "newton_iterations": 0,
        "factorisations": 0,
        "unknowns": 1,
    }


def midpoint(rate, step):
    """The same by the implicit midpoint rule, twice as expensive a step."""
    count = round(1 / step)
    x = ((1 + rate * step / 2) / (1 - rate * step / 2)) ** count
    return {"x": x, "cost_s": 2 * STEP_COST * count, "newton_iterations": count, "unknowns": 1}


def by(rate, method, step):
    """By one of these methods."""
    return method(rate, step)


def lost(rate):
    """A step that Newton's method could not solve."""
    raise sc.Diverged(0.5, 3, 0.1, "no convergence", "take a smaller step", [[1.0, 0.1]])


def wild(rate):
    """Numbers beyond all bounds."""
    return {"x": float("inf"), "cost_s": 1.0}


def broken(rate):
    """A mistake of the setup."""
    raise KeyError("beam")


def endless(rate):
    """It never ends."""
    while True:
        time.sleep(0.01)


def peer(rate, status, reason):
    """Another code that says how it failed."""
    return {"status": status, "reason": reason}


def counted(rate, step, log):
    """As `euler`; writes its calls down."""
    with (log / "calls").open("a") as handle:
        handle.write(f"{step}\n")
    return euler(rate, step)


# -- rubber rod ------------------------------------------------------------------------------------


def rubber_rod(elements=4):
    """A rod with a ball swings down from its hinge."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
    rubber = sc.SectionCircle(radius=5e-3, material=sc.Material(E=5e6, nu=0.5, rho=1100))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, rubber, director=(0, 1, 0)))
    model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), (0, 0, 1)))
    model.add("ball", sc.RigidBody.sphere(0.05, radius=0.02, on=rod.node("rod.end")))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    return model.freeze()


def swing_down(elements, integrator, step):
    """A run of the rod over 0.08 s."""
    run = {"derive": False, "kernels": "numpy"}
    return sc.simulate(rubber_rod(elements), integrator, sc.NullSpace(), step, 0.08, **run)


def tip(history):
    """Position of the free end at the end (m)."""
    last = history.static["beam/rod/offsets"][-1]
    return history["q"][-1, last : last + 3]


# -- oscillators, for maps -------------------------------------------------------------------------


def history_of(x, v, step, status="completed"):
    """A history of an oscillator: q = (x, v/omega, 0)."""
    q = np.stack([x, v, np.zeros(len(x))], axis=1)
    count = np.arange(len(x))
    return sc.History({"status": status}, {}, {"t": step * count, "step": count, "q": q, "p": q})


def amplitude(history):
    """Energy of the oscillator, relative to its stiffness."""
    with np.errstate(over="ignore"):
        return (history["q"] ** 2).sum(axis=1)


def leapfrog(step, omega, log=None):
    """Explicit: stable below step omega = 2, exactly; energies at the middle of kicks."""
    if log is not None:
        with (log / "calls").open("a") as handle:
            handle.write(f"{step} {omega}\n")
    x, v, states = 1.0, 0.0, []
    for _ in range(400):
        states.append((x, v / omega))
        half = v - step / 2 * omega**2 * x
        x = x + step * half
        v = half - step / 2 * omega**2 * x
    return history_of(*np.array(states).T, step)


def judged(result):
    """Blown up or not, with a number of its own."""
    from skfem_cosserat.accuracy import JudgeEnergy, Verdict

    found = JudgeEnergy(amplitude, drift=3.0)(result)
    if isinstance(result, Exception):
        return found
    last = float(amplitude(result)[-1])
    return Verdict(found.status, found.time, found.energy_error, numbers={"last": last})


def every_kind(step, kind):
    """One outcome of each kind."""
    if kind == "newton":
        error = sc.Diverged(0.25, 3, 0.125, "no convergence", "smaller", [[1.0, 0.125]] * 4)
        error.settings = FULL_PROTOCOL
        raise error
    if kind == "half-hearted":
        error = sc.Diverged(0.25, 3, 0.125, "no convergence", "smaller", [[1.0, 0.125]] * 4)
        error.settings = sc.NewtonSettings()
        raise error
    if kind == "timeout":
        endless(None)
    if kind == "error":
        raise LookupError("no such section")
    growth = {"ok": 0.004, "drift": 0.02, "blowup": 2.0}[kind]
    x = 1 + growth * np.linspace(0, 1.5, 7)
    return history_of(np.sqrt(x), np.zeros(7), step) if kind != "blowup" else _later(step)


def _later(step):
    """Ten times the energy at the fourth state, and a step that fails after that."""
    x = np.sqrt([1.0, 2.0, 9.99, 10.01, 50.0])
    error = sc.Diverged(4 * step, 5, 0.5, "no convergence", "smaller", [[1.0]] * 4)
    error.settings = FULL_PROTOCOL
    error.history = history_of(x, np.zeros(5), step, "diverged")
    raise error


def struck():
    """A blow on a pendulum that a step of 0.1 s does not resolve, from 0.3 s on."""
    model = sc.Model()
    bob = model.add("bob", sc.MassPoint(1.0, position=(0, 0, -1)))
    model.add("rod", sc.JointDistance(sc.ground((0, 0, 0)), bob.place()))
    ramp = sc.Table([0.3, 0.4], [0, 1])
    model.add("blow", sc.LoadForce(bob.place(), (1e4, 0, 0), ramp))
    return model.freeze(), sc.Variational(), sc.Multipliers()


def blow(iterations, settings=None):
    """A run of it, with this many iterations each attempt (None: it does not say)."""
    if iterations:
        settings = sc.NewtonSettings(iterations, damped_iterations=iterations)
    return sc.simulate(*struck(), step=0.1, until=1.0, settings=settings)


def sleeping_process(step=None):
    """Another program, which does not answer in time."""
    subprocess.run([sys.executable, "-c", "import time; time.sleep(9)"], timeout=0.1, check=True)


def free_rubber(times_limit):
    """A free rubber rod that turns and is bent, by explicit steps of so many times their limit."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    motion = {"velocity": lambda X: np.column_stack([0 * X[:, 0], X[:, 0], X[:, 0] ** 2])}
    flat = sc.SectionRectangle(0.06, 0.02, sc.Material(5e6, 0.4, 1100))
    model = sc.Model()
    model.add("rod", sc.Beam(mesh, flat, director=(0, 1, 0), lumped=True, **motion))
    system = model.freeze()
    step = times_limit * sc.Explicit.limit(system).seconds
    scheme = sc.Explicit(checked=False), sc.Multipliers()
    return sc.simulate(system, *scheme, step, 600 * step, kernels="numpy", every=20)


# -- a stiff scene ---------------------------------------------------------------------------------

#: the end of the push (s)
PUSHED = 0.02


def stiff_bar(step, integrator):
    """A steel cantilever, pressed with twice its Euler load and a little to the side."""
    steel = sc.Material(210e9, 0.3, 7850.0)
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="bar")
    model = sc.Model()
    bar = model.add(
        "bar", sc.Beam(mesh, sc.SectionRectangle(0.01, 0.01, steel), director=(0, 1, 0))
    )
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), bar.node("bar.start")))
    euler_load = np.pi**2 * 210e9 * 0.01**4 / 12 / 4
    ramp = sc.Table([0, PUSHED], [0, 1])
    load = sc.LoadForce(bar.node("bar.end"), (-2 * euler_load, 5.0, 0), ramp)
    model.add("load", load)
    scheme = {"variational": sc.Variational, "energy-momentum": sc.EnergyMomentum}[integrator]
    return sc.simulate(
        model.freeze(),
        scheme(),
        sc.NullSpace(),
        step,
        0.15,
        settings=FULL_PROTOCOL,
        kernels="numpy",
    )


def slow_rod(step):
    """A run that takes longer than anybody waits."""
    system, scheme = rubber_rod(2), (sc.EnergyMomentum(), sc.NullSpace())
    return sc.simulate(system, *scheme, step, 1000.0, kernels="numpy")
