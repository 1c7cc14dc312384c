"""Solvers written of scikit-fem's verbs agree with the package's own analyses."""

import inspect

import numpy as np
import own_loops
import pytest
from numpy.testing import assert_allclose
from skfem import asm

import skfem_cosserat as sc


def clamped(beam: sc.Beam, at: str = "rod.start") -> sc.Model:
    model = sc.Model()
    model.add("beam", beam)
    model.add("clamp", sc.JointFixed(sc.ground(beam.node(at).position), beam.node(at)))
    return model


def test_each_solver_has_at_most_25_lines():
    for solver in ("frame", "frequencies", "buckling", "bend", "motion"):
        text = inspect.getsource(getattr(own_loops, solver))
        assert len(text.splitlines()) <= 30, solver  # 25 and the blank ones


def test_frequencies_and_critical_load_are_those_of_the_package():
    beam = own_loops.cantilever()
    model = clamped(beam)
    assert_allclose(own_loops.frequencies(), sc.modes(model, count=4).frequencies, rtol=1e-8)
    model.add("push", sc.LoadForce(beam.node("rod.end"), (-1.0, 0, 0)))
    assert own_loops.buckling() == pytest.approx(sc.buckling(model, count=1).factors[0], rel=1e-4)


def test_the_bend_is_that_of_a_shooting_method():
    """GA = 5e6, GJ = EI, 600: integrated along the line to 11 digits, an own computation."""
    exact = 15.684800534038827, 47.150438573629096, 53.474858791825085
    assert_allclose(own_loops.bend(), exact, rtol=2e-6)


@pytest.mark.slow
def test_the_motion_is_of_second_order():
    beam = own_loops.cantilever(4)
    model = clamped(beam)
    weight = sc.LoadGravity((0, 0, -80 * 9.81), lambda t: (t / 0.05) ** 3)
    model.add("weight", weight)
    history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.05 / 1600, until=0.05)
    exact = history.position(beam.node("rod.end"))[-1]
    errors = [np.linalg.norm(own_loops.motion(n) - exact) for n in (50, 100, 200)]
    assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.05)


def test_the_reduced_matrix_is_the_derivative():
    """By updates of its own: far from the reference, and from equilibrium."""
    beam = own_loops.cantilever(2)
    n, rng = beam.basis.N, np.random.default_rng(0)
    start = beam.update(beam.reference, 0.1 * rng.standard_normal(n // 2))

    def reduced(du):
        q = beam.update(start, du)
        force = asm(beam.internal_force_form(), beam.basis, q=q)
        return beam.reduce(asm(beam.tangent_form(), beam.basis, q=q), force, q)

    K = reduced(np.zeros(n // 2))[0].toarray()
    ends = [[reduced(sign * 1e-6 * e)[1] for e in np.eye(n // 2)] for sign in (1, -1)]
    slopes = (np.array(ends[0]) - ends[1]).T / 2e-6
    assert_allclose(K, slopes, atol=1e-8 * abs(K).max())


def test_fields_of_a_system_and_a_history_are_those_of_the_basis():
    model, beams = sc.Model(), []
    for k in range(2):
        mesh = sc.MeshCurve.init_line((0, 0, k), (1, 0, k), 2 + k, name="rod")
        section = sc.SectionCircle(0.01, own_loops.STEEL)
        beams.append(model.add(f"rod {k}", sc.Beam(mesh, section, order=2, velocity=(k, 0, 0))))
    system = model.freeze()
    for k, beam in enumerate(beams):
        assert (system.split(system.q0)[f"rod {k}"] == beam.reference).all()
    history = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 0.1, until=0.2)
    moved = history.field("rod 1", -1) - beams[1].reference
    assert_allclose(moved.reshape(-1, 12)[:, :3], [[0.2, 0, 0]] * 7, atol=1e-12)
    with pytest.raises(sc.InputError, match="rod 3"):
        history.field("rod 3", 0)
    with pytest.raises(sc.InputError, match="index"):
        history.field("rod 1", 3)


def test_held_strains_and_wrong_shapes_are_refused():
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    section = sc.SectionCircle(0.01, own_loops.STEEL)
    held = sc.Beam(mesh, section, theory=sc.TheoryKirchhoff())
    with pytest.raises(sc.InputError, match="Model"):
        held.linear()
    with pytest.raises(sc.InputError, match="du"):
        sc.Beam(mesh, section).update(held.reference, np.zeros(5))
