"""Where runs may start: off the constraints is refused, momenta off the hidden ones are told."""

from __future__ import annotations

import logging
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers_scenes import four_bar

import skfem_cosserat as sc
from skfem_cosserat.diagnostics import momentum
from skfem_cosserat.statics import equilibrium

TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
SECTION = sc.SectionCircle(radius=0.02, material=sc.Material(E=2e5, nu=0.5, rho=1100))
RUNGS = {
    "inextensible": sc.RungInextensible(),
    "unshearable": sc.RungUnshearable(),
    "rigid": sc.RungRigid(),
}
SCHEMES = [
    sc.Variational(),
    sc.Variational(stabilized=True),
    sc.EnergyMomentum(),
    sc.EnergyMomentum(stabilized=True),
    sc.EnergyDecaying(chi=0.1),
    sc.GeneralizedAlpha(0.8),
    sc.Composition(sc.Variational(), 4),
]


def hinged(item, place, angle=0.0):
    """An item on a hinge, which may be driven."""
    model = sc.Model()
    structure = model.add("link", item)
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), place(structure), axis=(0, 1, 0))
    model.add("pin", hinge)
    model.add("gravity", sc.LoadGravity((0, 0, -10.0)))
    if angle:
        model.add("drive", sc.JointDrive(hinge, lambda t: angle * t))
    return model.freeze()


def beam(**more):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    return sc.Beam(mesh, SECTION, director=(0, 1, 0), **more)


@cache
def scene(name):
    if name == "body":
        box = sc.RigidBody.box(2.0, (1, 0.1, 0.1), position=(0.5, 0, 0))
        return hinged(box, lambda link: link.local((-0.5, 0, 0)))
    more = {} if name == "beam" else {"rung": RUNGS[name]}
    return hinged(beam(**more), lambda link: link.node("rod.start"))


NAMES = ["body", "beam", *RUNGS]


def moving(system):
    """Turning about the hinge."""
    return sc.initial_state(system, rates={"pin": 2.0})


def shifted(system, by):
    """Velocities that pull all off the hinge."""
    v = np.zeros((system.rows, 3))
    v[system.origin_rows] = by
    return v.ravel()


@pytest.mark.parametrize("treatment", TREATMENTS)
@pytest.mark.parametrize("name", NAMES)
def test_momenta_off_the_hidden_constraints_are_told(name, treatment, caplog):
    caplog.set_level(logging.WARNING, logger="skfem_cosserat")
    system = scene(name)
    good = moving(system)
    off = momentum(system, shifted(system, (0.3, 0, 0)))
    bad = replace(good, p=good.p + off)
    run = system, sc.Variational(), TREATMENTS[treatment], 1e-3
    quick = {"kernels": "numpy", "derive": False}
    miss = abs(sc.Projection(system)(bad.q, bad.p)[1] - bad.p).max()
    words = rf"argument start: p at t = 0 s violates the hidden constraints by {miss:.3g} kg m/s"
    words += r" at .* 'link'.*: project it with Projection\(system\)\(q, p, t\)\[1\].*restart"
    starts = (
        lambda: sc.simulate(*run, 2e-3, start=bad, **quick),
        lambda: next(sc.steps(*run, bad, kernels="numpy")),
    )
    for call in starts:
        caplog.clear()
        call()
        assert re.search(words.replace("+", r"\+"), caplog.text), caplog.text
    # what the message says helps; what rounding leaves is no reason
    mended = replace(bad, p=sc.Projection(system)(bad.q, bad.p, bad.time)[1])
    noisy = replace(good, p=good.p * (1 + 1e-12 * np.random.default_rng(0).standard_normal()))
    caplog.clear()
    for start in (good, mended, noisy):
        assert len(sc.simulate(*run, 2e-3, start=start, **quick)) == 3
    assert not caplog.text


@pytest.mark.parametrize("name", ["body", "beam", "rigid"])
def test_configurations_off_the_constraints_are_refused(name):
    system = scene(name)
    q = system.q0 + shifted(system, (0, 0, 0.01))
    bad = sc.State(0.0, 0, q, np.zeros(system.n))
    for start in (bad, replace(bad, maker=("variational", 1e-3))):
        with pytest.raises(
            sc.InputError,
            match=r"argument start: q at t = 0 s violates .* revolute joint 'pin' by 0\.01",
        ):
            sc.simulate(system, sc.Variational(), sc.NullSpace(), 1e-3, 2e-3, start=start)
    bent = system.q0.copy()
    bent[3:6] *= 1.1
    with pytest.raises(sc.InputError, match=r"constraint of the triad of .* 'link' by 0\.105"):
        next(sc.steps(system, sc.Variational(), sc.NullSpace(), 1e-3, replace(bad, q=bent)))


@pytest.mark.parametrize("treatment", TREATMENTS)
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_states_of_runs_are_accepted(scheme, treatment, caplog):
    """Whatever their momenta are: those of the variational scheme are off by O(h)."""
    caplog.set_level(logging.WARNING, logger="skfem_cosserat")
    quick = {"kernels": "numpy", "derive": False}
    for system in (scene("beam"), four_bar().freeze()):
        start = moving(system) if system is scene("beam") else None
        run = system, scheme, TREATMENTS[treatment], 2e-2
        state = next(sc.steps(*run, start, kernels="numpy")).state
        for other in (sc.EnergyMomentum(), scheme):
            on = system, other, TREATMENTS[treatment], 2e-2
            assert sc.simulate(*on, 0.04, start=state, **quick).times[-1] == 0.04
        history = sc.simulate(*run, 0.04, start=start, **quick)
        for other, h in ((scheme, 2e-2), (scheme, 1e-2), (sc.Variational(), 2e-2)):
            on = system, other, TREATMENTS[treatment], h
            again = sc.restart(system, history, other, h)
            assert sc.simulate(*on, 0.06, start=again, **quick).times[-1] == pytest.approx(0.06)
    assert "hidden constraints" not in caplog.text


def test_what_is_driven_has_to_move(caplog):
    """A state at rest is told of, and an equilibrium as a start moves with the drive."""
    caplog.set_level(logging.WARNING, logger="skfem_cosserat")
    box = sc.RigidBody.box(2.0, (1, 0.1, 0.1), position=(0.5, 0, 0))
    system = hinged(box, lambda link: link.local((-0.5, 0, 0)), angle=0.5)
    run = system, sc.EnergyMomentum(), sc.NullSpace(), 1e-2, 0.02
    rest = sc.State(0.0, 0, system.q0, np.zeros(system.n))
    sc.simulate(*run, start=rest)
    assert "p at t = 0 s violates the hidden constraints by 0.5" in caplog.text
    caplog.clear()
    fixed = sc.initial_state(system, v=sc.project(system, system.q0))
    assert len(sc.simulate(*run, start=fixed)) == 3
    path = sc.static(system, sc.NullSpace(), sc.LoadControl(steps=2))
    start = equilibrium(system, path)
    v = sc.project(system, start.q, t=start.time)
    assert start.p == pytest.approx(momentum(system, v), abs=1e-9)
    sc.simulate(*run[:-1], start.time + 0.02, start=start)
    assert not caplog.text


def test_states_that_actions_give_are_looked_at(caplog):
    caplog.set_level(logging.WARNING, logger="skfem_cosserat")
    system = scene("body")
    off = momentum(system, shifted(system, (0.3, 0, 0)))

    def kick(time, view):
        return sc.State(time, 0, view.state.q, off)

    event = sc.Event(sc.ConditionTime(0.02), sc.ActionFunction(kick), name="kick")
    sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, 0.05, events=[event])
    assert "action: its state: p at t = 0.02 s violates the hidden constraints" in caplog.text
