"""Problems for refinement studies; at the top level of a module, so that they reach processes."""

from __future__ import annotations

import os
import signal
import sys
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "examples"))

import element_orders
import static_scenes
import test_convergence as ramped

import skfem_cosserat as sc

INTEGRATORS = {"variational": sc.Variational, "energy-momentum": sc.EnergyMomentum}


# -- closed forms ----------------------------------------------------------------------------------


def trapezoid(elements):
    """Integral of exp from 0 to 1: order 2, with all even powers behind it."""
    return float(np.trapezoid(np.exp(np.linspace(0, 1, elements + 1)), dx=1 / elements))


def first_and_second(elements):
    """A vector with errors of first order, and those of second order in another direction."""
    h = 1 / elements
    return np.array([1.0, 2.0, -1.0]) + h * np.array([0.3, 0.1, 0.2]) + h**2 * np.array([0, 0.1, 0])


def fourth(step):
    """Runge-Kutta of fourth order for an oscillator, by name and over time."""
    count = round(2 / step)
    state, states = np.array([1.0, 0.0]), []

    def rate(x):
        return np.array([x[1], -x[0]])

    for _ in range(count + 1):
        states.append(state)
        a = rate(state)
        b = rate(state + step / 2 * a)
        c = rate(state + step / 2 * b)
        d = rate(state + step * c)
        state = state + step / 6 * (a + 2 * b + 2 * c + d)
    return {"t": step * np.arange(count + 1), "x": np.array(states)}


def kinked(elements):
    """Midpoint rule for a jump between the points: errors of first order at best, up and down."""
    x = (np.arange(elements) + 0.5) / elements
    return float((x > 1 / np.pi).mean())


# -- scenes ----------------------------------------------------------------------------------------


def bend(elements, order):
    """Tip of the 45-degree bend (m)."""
    scene = static_scenes.bend(elements, order)
    path = sc.static(scene.system, control=sc.LoadControl(steps=2), watch=False, derive=False)
    return scene.position(path)


def frequencies(elements, order):
    """First three frequencies of the bend without loads (rad/s)."""
    return element_orders.frequencies(elements, order)


def in_time(step, integrator="energy-momentum"):
    """A curved cantilever under smooth loads: the last state, and the reaction there."""
    until = ramped.UNTIL
    system = ramped.cantilever()
    at = [until - step, until]
    history = sc.simulate(system, INTEGRATORS[integrator](), sc.NullSpace(), step, until, at=at)
    return {
        "q": history["q"][-1],
        "v": history["v"][-1][ramped.massive(system)],
        "reaction": history["joint/clamp/force"][-1],
    }


def swing_up(elements, step):
    """History of a soft cantilever of linear elements under a smooth load."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
    section = sc.Section([400, 400, 400, 1, 1, 1], mass=1.0, inertia=(0.01, 0.01))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=1, director=(0, 1, 0)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    load = sc.FunctionOfTime(ramped.ramp, kinks=(0.5,))
    model.add("force", sc.LoadForce(rod.node("rod.end"), (0, 1.5, -1.0), load))
    scheme = sc.EnergyMomentum(), sc.NullSpace()
    at = np.arange(0.1, 0.61, 0.1).tolist()
    return sc.simulate(model.freeze(), *scheme, step, 0.6, at=at, kernels="numpy")


def tip(history):
    """Position of the last node over time, (N, 3)."""
    last = history.static["beam/rod/offsets"][-1]
    return history["q"][:, last : last + 3]


def last_tip(history):
    """The same at the end."""
    return tip(history)[-1]


def spaghetti(elements, order, step, until=1.0):
    """D4, a flying beam in a plane: force and moment are there at once. Ends at the end (m)."""
    mesh = sc.MeshCurve.init_line((6, 0, 0), (0, 8, 0), elements, name="rod")
    section = sc.Section.from_constants(
        EA=1e4, GA=1e4, EI=(100, 100), GJ=100, mass=1.0, inertia=(10, 10)
    )
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 0, 1)))
    on = sc.FunctionOfTime(lambda t: float(t < 2.5), kinks=(2.5,))
    model.add("force", sc.LoadForce(rod.node("rod.start"), (8, 0, 0), on))
    model.add("moment", sc.LoadMoment(rod.node("rod.start"), (0, 0, -80), on))
    system, scheme = model.freeze(), (sc.EnergyMomentum(), sc.NullSpace())
    run = {"every": 10**6, "derive": False, "kernels": "numpy"}
    q = sc.simulate(system, *scheme, step, until, **run)["q"][-1]
    return q[[0, 1, 12 * elements, 12 * elements + 1]]


def fails_at_16(elements):
    """As `trapezoid`, but one level cannot be solved."""
    if elements == 16:
        raise sc.Diverged(0.5, 7, 1.0, "no solution", "take a smaller step")
    return trapezoid(elements)


def noted(elements, log, fatal=()):
    """As `trapezoid`; writes its call down, and dies at some levels while there is no file "on"."""
    with (log / "calls").open("a") as handle:
        handle.write(f"{elements}\n")
    if elements in fatal and not (log / "on").exists():
        raise KeyboardInterrupt
    return trapezoid(elements)


def stopped(elements, log):
    """As `noted`; Ctrl-C arrives at 8 elements, once."""
    if elements == 8 and not (log / "on").exists():
        os.kill(os.getpid(), signal.SIGINT)
    return noted(elements, log)


# -- random scenes, to count how often bands cover the error ---------------------------------------


def random_run(elements, step, order, seed):
    """A random cantilever under a load that sets in smoothly: its tip and root moment."""
    random = np.random.default_rng(seed)
    length, radius = random.uniform(0.5, 2.0), 10 ** random.uniform(-2.2, -1.5)
    material = sc.Material(E=10 ** random.uniform(6.0, 9.0), nu=0.4, rho=1100)
    section = sc.SectionCircle(radius * length, material)
    mesh = sc.MeshCurve.init_line((0, 0, 0), (length, 0, 0), elements, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    EI, direction = section.stiffness[3, 3], random.normal(size=3)
    size = EI / length**2 * random.uniform(0.3, 1.5) / np.linalg.norm(direction)
    # of the first mode, about
    period = 2 * np.pi / 3.52 * length**2 * np.sqrt(section.mass / EI)
    until = float(random.uniform(0.5, 1.5) * period)
    load = sc.RampSmooth(0, until) if step is not None else 1.0
    model.add("force", sc.LoadForce(rod.node("rod.end"), size * direction, load))
    if step is None:
        path = sc.static(model, watch=False)
        return {"tip": path.position(rod.node("rod.end"))[-1] / length}
    run = sc.simulate(
        model, sc.EnergyMomentum(), sc.NullSpace(), step * until, until, kernels="numpy"
    )
    return {
        "tip": run.position(rod.node("rod.end"))[-1] / length,
        "moment": run["joint/clamp/moment"][-2] / (size * length),
    }


def covered(count, first=0):
    """How many bands of extrapolated values cover the error, of how many that were given."""
    good = total = 0
    for seed in range(first, first + count):
        random = np.random.default_rng(1000 + seed)
        kind, order = ("mesh", "step", "static")[seed % 3], int(random.integers(1, 3))
        levels = {"elements": (2, 4, 8, 16), "step": 1 / random.choice([20, 40, 80])}
        if kind == "step":
            levels = {
                "elements": int(random.choice([3, 6])),
                "step": (1 / 20, 1 / 40, 1 / 80, 1 / 160),
            }
        if kind == "static":
            levels = {"elements": (4, 8, 16, 32), "step": None}
        problem = partial(random_run, order=order, seed=seed)
        if levels["step"] is None:
            study = sc.refine(partial(problem, step=None), elements=levels["elements"])
            true = random_run(32, None, 4, seed)
        else:
            study = sc.refine(problem, **levels)
            fine = [random_run(12, 1 / n, 3, seed) for n in (320, 640)]
            true = {k: fine[1][k] + (fine[1][k] - fine[0][k]) / 3 for k in fine[0]}
        for name, found in study.orders.items():
            if found.extrapolated is None or not np.isfinite(found.uncertainty):
                continue
            total += 1
            inside = np.linalg.norm(found.extrapolated - true[name]) <= found.uncertainty
            good += bool(inside)
    return good, total
