"""Elimination for many states at once: compiled against plain numpy, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat.constraints import stacked
from skfem_cosserat.diagnostics import Projection

pytest.importorskip("numba")

STATES = 20


@pytest.fixture
def system():
    """A beam on a hinge, with a body at its end that a distance holds to the ground: a loop."""
    section = sc.SectionCircle(0.05, sc.Material(5e6, 0.5, 1e3))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0)))
    body = model.add("body", sc.RigidBody.box(1.0, (0.1, 0.2, 0.3), position=(1.2, 0, 0)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    model.add("fixed", sc.JointFixed(rod.node("rod.end"), body.at((1, 0, 0))))
    rope = sc.JointDistance(sc.ground((1.2, 1.0, 0.3)), body.at((1.2, 0.1, 0)))
    model.add("rope", rope)
    return model.freeze()


def eliminated(system, compiled, monkeypatch):
    """Velocities and multipliers of many states, and whether kernels were asked for them."""
    calls, run = [], stacked._Kernels.run

    def counted(name, *given):
        calls.append(name)
        run(name, *given)

    if compiled:
        stacked.have_stacked(stacked.Source.COMPILER)
    monkeypatch.setattr(stacked._Kernels, "run", counted)
    monkeypatch.setattr(stacked._Kernels, "found", compiled)
    monkeypatch.setattr(stacked._Kernels, "tries", ())
    random = np.random.default_rng(3)
    q = system.q0 + 1e-3 * random.standard_normal((STATES, system.n))
    p, force = random.standard_normal((2, STATES, system.n))
    v = Projection(system).velocities(q, p, np.zeros(STATES))
    y = np.concatenate([q.reshape(STATES, -1, 3), [system.ground(0.0)] * STATES], axis=1)
    lam = stacked.stacked_multipliers(system, y, force)
    return v, lam, set(calls)


def test_both_give_the_same_bits(system, monkeypatch):
    v, lam, calls = eliminated(system, False, monkeypatch)
    assert not calls
    others = eliminated(system, True, monkeypatch)
    assert others[2] == {"factors", "solve"}
    assert np.isfinite(lam).all()
    np.testing.assert_array_equal(others[0], v)
    np.testing.assert_array_equal(others[1], lam)


def test_it_is_compiled_when_that_would_have_paid(monkeypatch):
    asked = []

    def have(source):
        asked.append(source)
        if source < stacked.Source.COMPILER:
            raise stacked.NotKept("factors")

    monkeypatch.setattr(stacked, "have_stacked", have)
    monkeypatch.setattr(stacked, "loaded", lambda: True)
    own = stacked._Kernels
    monkeypatch.setattr(own, "found", False)
    monkeypatch.setattr(own, "columns", 0)
    first = (0, stacked.Source.DISK), (stacked.COMPILING, stacked.Source.COMPILER)
    monkeypatch.setattr(own, "tries", first)
    assert not own.take(10) and not own.take(10)
    assert asked == [stacked.Source.DISK]
    assert own.take(stacked.COMPILING) and own.take(1)
    assert asked == [stacked.Source.DISK, stacked.Source.COMPILER]


def test_what_numba_does_not_compile_is_said(monkeypatch, capsys):
    from skfem_cosserat import __main__ as command

    def have(source):
        raise TypeError("no such type")

    monkeypatch.setattr(command, "_models", lambda order: ())
    monkeypatch.setattr(stacked, "have_stacked", have)
    with pytest.warns(sc.PerformanceWarning, match="does not compile those .* no such type"):
        assert command.main(["warm"]) == 0
