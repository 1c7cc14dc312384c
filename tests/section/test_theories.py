"""Theories of beams: strains that are held, against closed forms, full beams and each other."""

from __future__ import annotations

import importlib
import pickle
import re
from contextlib import nullcontext

import numpy as np
import pytest
from helpers_kernels import (
    assert_same,
    assert_same_iteration,
    both,
    integrators,
    moving,
    needs_numba,
    treatments,
    with_kept_factors,
)
from helpers_scenes import chequered, full_section, null_space, two_states
from helpers_schemes import KINDS

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.diagnostics.stacked import null_space_matrix

TREATMENTS = (sc.NullSpace(), sc.Multipliers())
THEORIES = (sc.TheoryKirchhoff(), sc.TheoryInextensible(), sc.TheoryRigid())
UNTWISTED = (sc.TheoryReissner(torsion=False), sc.TheoryInextensible(torsion=False))
SECTION = sc.Section([1e4, 1e4, 2e4, 100, 120, 80.0], mass=1.0, inertia=(1e-3, 2e-3))
TIP = np.array([0.0, 30.0, 50.0])
PULSE = sc.Table([0.0, 0.01, 0.02], [0.0, 1.0, 0.0])


def swing():
    """The example's module."""
    return importlib.import_module("paper.three_bar_swing")


def arc(theory, order=2, elements=4, section=SECTION, **options):
    """A model with a quarter of a circle of radius 1."""
    ends = (1, 0, 0), (0, 1, 0), (-1, 0, 0)
    mesh = sc.MeshCurve.init_arc(*ends, 1.0, np.pi / 2, elements, "rod")
    model = sc.Model()
    options = {"director": (0, 0, 1)} | options
    model.add("rod", sc.Beam(mesh, section, order=order, theory=theory, **options))
    return model


def cantilever(theory, order, elements, section=SECTION, load=(0, 0, 0), length=1.0):
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (length, 0, 0), elements, "rod")
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 0, 1), theory=theory))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("force", sc.LoadForce(rod.node("rod.end"), load))
    return model


def tip_of(model, q):
    """Of the rod, which is the first item."""
    first = 12 * model["rod"].node("rod.end").vertex
    return q[first : first + 3]


def branched(theory, order=2, section=SECTION):
    """Beams of one mesh with a rigid corner, bodies and another beam on joints, a spring.

    The first of them runs against the tree of joints.
    """
    model = sc.Model()
    post = sc.MeshCurve.init_line((0, 0, 1), (0, 0, 0), 3, "post")
    mesh = post.joined(
        sc.MeshCurve.init_line((0, 0, 1), (1, 0, 1), 2, "beam"),
        sc.MeshCurve.init_line((0, 0, 1), (0, 1, 1.2), 2, "arm"),
    )
    directors = {"post": (1, 0, 0), "beam": (0, 1, 0), "arm": (1, 0, 0)}
    options = {"order": order, "theory": theory}
    frame = model.add("frame", sc.Beam(mesh, section, director=directors, **options))
    turning = sc.MotionTurn((0, 0, 1.0), lambda t: np.sin(10 * t) ** 2)
    model.add("base", sc.JointFixed(sc.ground((0, 0, 0), turning), frame.node("post.end")))
    body = model.add("body", sc.RigidBody.box(0.5, (0.1, 0.2, 0.3), position=(1, 0, 0.7)))
    hinge = sc.JointRevolute(frame.node("beam.end"), body.at((1, 0, 1.0)), axis=(0, 1, 0))
    model.add("hinge", hinge)
    line = sc.MeshCurve.init_line((0, 1, 1.2), (0, 2, 1.2), 2, "rod")
    rod = model.add("rod", sc.Beam(line, SECTION, director=(0, 0, 1), theory=sc.TheoryKirchhoff()))
    model.add("ball", sc.JointSpherical(frame.node("arm.end"), rod.node("rod.start")))
    model.add("spring", sc.SpringDamper(body.at((1, 0, 0.7)), rod.node("rod.end"), 50.0, 1.0))
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    return model


def looped(theory):
    """A bent rod between a clamp and a ball joint, pushed in the middle."""
    model = arc(theory)
    rod = model["rod"]
    model.add("clamp", sc.JointFixed(sc.ground((1, 0, 0)), rod.node("rod.start")))
    model.add("ball", sc.JointSpherical(sc.ground((0, 1, 0)), rod.node("rod.end")))
    model.add("force", sc.LoadForce(rod.node(3), (20, 30, 40.0)))
    return model


def ring(theory, order=2):
    """A closed ring, pushed in space."""
    mesh = sc.MeshCurve.init_arc((1, 0, 0), (0, 1, 0), (-1, 0, 0), 1.0, 2 * np.pi, 8)
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, SECTION, order=order, director=(0, 0, 1), theory=theory))
    model.add("force", sc.LoadForce(rod.node(3), (20, 30, 40.0)))
    return model


def clamped_at_both_ends(theory, order, elements=4):
    """A straight rod."""
    model = cantilever(theory, order, elements)
    model.add("end", sc.JointFixed(sc.ground((1, 0, 0)), model["rod"].node("rod.end")))
    return model


# -- statics ---------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("theory", THEORIES)
@pytest.mark.parametrize(("order", "treatment"), [(3, sc.NullSpace()), (1, sc.Multipliers())])
def test_section_forces_of_a_cantilever_are_multipliers(theory, order, treatment):
    """The force in every element, and its moment about each node."""
    model = cantilever(theory, order, 6, load=TIP)
    rod = model["rod"]
    if isinstance(theory, sc.TheoryRigid):  # something must move
        other = model.add("other", sc.Beam(rod.mesh, SECTION, director=(0, 0, 1)))
        model.add("root", sc.JointFixed(sc.ground((0, 0, 0)), other.node("rod.start")))
    system = model.freeze()
    path = sc.static(system, treatment)
    q, lam = path["q"][-1], path["multipliers"][-1]
    at_ends = diagnostics.nodal_resultants(system, rod, q, 1.0, multipliers=lam)
    frames = q[: 12 * len(rod.triads)].reshape(-1, 4, 3)
    for side in (0, 1):
        for element, node in enumerate(rod.basis.connectivity[:, -side]):
            turned = at_ends[element, side].reshape(2, 3) @ frames[node, 1:]
            moment = np.cross(tip_of(model, q) - frames[node, 0], TIP)
            assert turned == pytest.approx(np.array([TIP, moment]), abs=1e-9)
    # what histories export, and values at the Gauss points
    recorded = path["beam/rod/resultant"][-1]
    again = diagnostics.section_forces(system, rod, q, multipliers=lam)
    assert recorded == pytest.approx(again, abs=1e-9)
    points = np.repeat(np.arange(6), order), np.tile(rod.elements.points, 6)
    between = diagnostics.evaluate(system, rod, q, *points, multipliers=lam)
    assert between.resultant == pytest.approx(recorded.reshape(-1, 6), abs=1e-8)
    unknown = diagnostics.section_forces(system, rod, q)
    assert np.isnan(unknown[..., list(theory.held)]).all()


def test_critical_load_is_eulers():
    """Nothing of shear or compression is in it, as in ``pi^2 EI/(4 L^2)``."""
    stiffness = np.array([1e4, 1e4, 2e4, 1.3, 1.0, 0.8])
    section = sc.Section(stiffness, mass=1.0, inertia=(1e-3, 1e-3))
    model = cantilever(sc.TheoryInextensible(), 4, 6, section, (-1.0, 0, 0))
    found = sc.buckling(model, count=2).factors
    assert found == pytest.approx(np.pi**2 / 4 * np.array([1.0, 1.3]), rel=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("theory", THEORIES[:2])
@pytest.mark.parametrize("treatment", TREATMENTS)
def test_controls_of_paths_take_theories_in_both_treatments(theory, treatment):
    """A column past its critical load: by its tip's displacement, and by arc length."""
    section = sc.Section([1e4, 1e4, 2e4, 1, 1.3, 0.8], mass=1.0, inertia=(1e-3, 2e-3))
    model, full = (cantilever(each, 2, 6, section, (-1.0, 0.1, 0)) for each in (theory, None))

    def factor(model, until, *treatment):
        end = model["rod"].node("rod.end")
        control = sc.DisplacementControl(end, (0, 1.0, 0), until)
        return sc.static(model, *treatment, control=control)["load_factor"][-1]

    assert factor(model, 0.5, treatment) == pytest.approx(factor(full, 0.5), rel=1e-3)
    path = sc.static(model, treatment, control=sc.ArcLength(6, first=0.5, length=0.05))
    expected = factor(model, tip_of(model, path["q"][-1])[1])
    assert path["load_factor"][-1] == pytest.approx(expected, rel=1e-8)


# -- counts: p points are right --------------------------------------------------------------------


def theory_jacobian(system):
    """Rows that hold strains by ``(phi, omega)`` of all nodes but the clamped first one.

    Rows are scaled so that their norm is that of strains in L2.
    """
    (rows,) = system.theory_rows
    G = system.constraints.jacobian(system.extend(system.q0, 0.0)).toarray()
    P = np.zeros((system.n, 6 * len(rows.beam.triads)))
    for a, triad in enumerate(rows.beam.triads):
        P[12 * a : 12 * a + 3, 6 * a : 6 * a + 3] = np.eye(3)
        for k, d in enumerate(triad):
            row = slice(12 * a + 3 * k + 3, 12 * a + 3 * k + 6)
            P[row, 6 * a + 3 : 6 * a + 6] = np.cross(np.eye(3), d).T
    weights = np.broadcast_to(rows.beam.elements.measure, rows.numbers.shape).ravel()
    return np.sqrt(weights)[:, None] * (G[rows.numbers.ravel()] @ P)[:, 6:]


def energy_norm(rod):
    """Square of the norm in H1 of ``(phi, omega)``, by all nodes but the first one."""
    points, weights = np.polynomial.legendre.leggauss(6)
    shape, slope = rod.basis.shape(0.5 + 0.5 * points), rod.basis.dshape(0.5 + 0.5 * points)
    count = len(rod.triads)
    K = np.zeros((count, count))
    for nodes, length in zip(rod.basis.connectivity, rod.basis.lengths, strict=True):
        K[np.ix_(nodes, nodes)] += (slope * (0.5 * weights)) @ slope.T / length
        K[np.ix_(nodes, nodes)] += (shape * (0.5 * weights)) @ shape.T * length
    return np.kron(K, np.eye(6))[6:, 6:]


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_inf_sup_constant_does_not_depend_on_the_mesh(order):
    """With p points for an element of order p; that of Gamma on a clamped rod of length 1."""
    constants = []
    for elements in (4, 16):
        system = cantilever(sc.TheoryInextensible(), order, elements).freeze()
        B = theory_jacobian(system)
        S = B @ np.linalg.solve(energy_norm(system.structures[0]), B.T)
        constants.append(np.sqrt(np.linalg.eigvalsh(S)[0]))
    assert constants == pytest.approx([0.84356, 0.84356], rel=2e-3)
    assert abs(constants[1] / constants[0] - 1) < (2e-3 if order == 1 else 1e-5)


# -- modes -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("theory", [*THEORIES[:2], *UNTWISTED])
@pytest.mark.parametrize("order", [1, 3])
def test_modes_are_as_many_as_unknowns_and_six_are_rigid(theory, order):
    elements = 5
    system = arc(theory, order, elements).freeze()
    unknowns = 6 + order * elements * (6 - len(theory.held))
    assert system.unknowns == unknowns
    assert system.counts()["rank"] == system.m
    found = sc.modes(system, count=unknowns)
    assert found.rigid == 6
    assert len(found) == unknowns
    assert (found.omega[6:] > 1).all()
    full = sc.modes(arc(None, order, elements), count=9)
    both = slice(6, 9 if theory.torsion else 8)  # the third one twists
    assert found.omega[both] == pytest.approx(full.omega[both], rel=0.1)
    assert (found.omega[6:9] >= full.omega[6:9] * (1 - 1e-9)).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("theory", "order", "limit"),
    [(sc.TheoryKirchhoff(), 1, 4.0), (sc.TheoryInextensible(), 2, 24.0)],
)
def test_taut_beams_give_way_where_full_ones_do(theory, order, limit):
    """At ``limit EI/h^2``: rotations of nodes that the Gauss points do not see."""
    section = sc.Section([1e6, 1e6, 1e6, 1, 1, 1.0], mass=1.0, inertia=(1e-3, 1e-3))
    for share in (0.95, 1.03):
        tension = share * limit * 12**2
        system = cantilever(theory, order, 12, section, (tension, 0, 0)).freeze()
        q = system.q0.copy().reshape(-1, 12)
        if 2 not in theory.held:
            q[:, 0] *= 1 + tension / 1e6
        words = re.escape(f"tension {tension:.3g} N between nodes")
        taut = pytest.warns(sc.AccuracyWarning, match=words)
        with taut if share > 1 else nullcontext():
            found = sc.modes(system, q.ravel(), 3, t=0.0)
        assert (found.growth.max() > 1) == (share > 1)
    start = sc.initial_state(system, q=q.ravel())
    arguments = sc.EnergyMomentum(), sc.NullSpace(), 1e-5
    with pytest.warns(sc.AccuracyWarning, match="elements in place of 12"):
        sc.simulate(system, *arguments, until=3e-5, start=start, kernels="numpy")


# -- dynamics --------------------------------------------------------------------------------------

SCENES = [
    *[(branched, theory) for theory in (*THEORIES[:2], UNTWISTED[0])],
    *[(looped, theory) for theory in (*THEORIES[:2], UNTWISTED[1])],
    *[(ring, theory) for theory in THEORIES[:2]],
]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # large steps
@chequered("scene, theory", SCENES, "integrator", [sc.EnergyMomentum(), sc.Variational()])
def test_both_treatments_agree(scene, theory, integrator):
    system = scene(theory).freeze()
    runs = [
        sc.simulate(system, integrator, treatment, 2e-3, until=0.012, kernels="numpy")
        for treatment in TREATMENTS
    ]
    q, other = (run["q"] for run in runs)
    assert abs(q - system.q0).max() > 1e-3
    assert abs(q - other).max() < 5e-13
    assert abs(runs[0]["constraint_violation"]).max() < 1e-13
    forces = [run["constraint_force"][1:-1] for run in runs]
    assert forces[0] == pytest.approx(forces[1], abs=1e-6 * abs(forces[0]).max())


OTHERS = (
    sc.EnergyMomentum(stabilized=True),
    *(s for s in KINDS if type(s) not in (sc.Variational, sc.EnergyMomentum)),
)


@pytest.mark.one_quick
@pytest.mark.parametrize("integrator", OTHERS)
@pytest.mark.parametrize("theory", [*THEORIES, pytest.param(UNTWISTED[1], marks=pytest.mark.slow)])
def test_every_implicit_integrator_takes_every_theory(theory, integrator):
    system = flying(theory).freeze()
    q, other = (
        sc.simulate(system, integrator, treatment, 2e-3, until=0.01, kernels="numpy")["q"]
        for treatment in TREATMENTS
    )
    assert abs(q - other).max() < 1e-12


def flying(theory, order=2, elements=3, section=SECTION, push=10 * TIP):
    """A rod in free flight, turning, pushed for a while."""
    spin = (3.0, 2.0, 1.0)
    options = {"velocity": lambda x: np.cross(spin, x), "angular_velocity": spin}
    model = arc(theory, order, elements, section, **options)
    model.add("push", sc.LoadForce(model["rod"].node("rod.end"), push, PULSE))
    return model


# energy is not followed in steps of this size
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize("theory", [*THEORIES, *UNTWISTED])
@chequered("integrator", [sc.EnergyMomentum(), sc.Variational()], "treatment", TREATMENTS)
def test_momenta_and_energy_are_conserved(theory, integrator, treatment):
    """Of a rod in free flight; energy by one of both integrators."""
    run = sc.simulate(flying(theory).freeze(), integrator, treatment, 4e-3, 0.08, kernels="numpy")
    after = run.times > 0.0201
    for name in ("linear_momentum", "angular_momentum"):
        values = run[name][after]
        assert np.ptp(values, axis=0) == pytest.approx(0, abs=2e-12 * abs(values).max())
    if isinstance(integrator, sc.EnergyMomentum):
        energy = run["energy"][after]
        assert np.ptp(energy) < 2e-11 * energy.max()
        assert abs(run["energy_balance"]).max() < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("integrator", [sc.EnergyMomentum(), sc.Variational()])
def test_second_order_in_the_step(integrator):
    system = flying(sc.TheoryInextensible(), 1, 2).freeze()
    q = [
        sc.simulate(system, integrator, sc.NullSpace(), h, until=0.02, kernels="numpy")["q"][-1]
        for h in (4e-4, 2e-4, 1e-4)
    ]
    ratio = abs(q[0] - q[1]).max() / abs(q[1] - q[2]).max()
    assert np.log2(ratio) == pytest.approx(2, abs=0.1)


@pytest.mark.slow
def test_rigid_theory_is_the_body_with_the_beams_inertia(kernels):
    beam = flying(sc.TheoryRigid())
    body = sc.Model()
    alone = body.add("body", flying(None)["rod"].rigid_body())
    place = alone.at(beam["rod"].node("rod.end").position)
    body.add("push", sc.LoadForce(place, 10 * TIP, PULSE))
    rigid, expected = (
        sc.simulate(
            model, sc.EnergyMomentum(), sc.NullSpace(), 2e-3, until=0.03, kernels=kernels
        )["q"][:, :12]
        for model in (beam, body)
    )  # fmt: skip
    assert abs(rigid - expected).max() < 1e-12
    assert beam.freeze().unknowns == 6


# -- the tree --------------------------------------------------------------------------------------


# an inextensible ring without torsion is refused, see below
@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore::skfem_cosserat.ModelWarning")
@pytest.mark.parametrize(
    ("scene", "theory"),
    [*SCENES, (branched, THEORIES[2]), (branched, UNTWISTED[1]), (ring, UNTWISTED[0])],
)
def test_null_space_annihilates_the_jacobian_at_nodes_and_midpoints(scene, theory):
    system = scene(theory).freeze()
    y = system.extend(system.q0, 0.0)
    P = null_space_matrix(system, y)
    assert abs(system.constraints.jacobian(y) @ P).max() < 1e-13
    assert np.linalg.matrix_rank(P.toarray()) == system.unknowns
    # rows that the tree fulfils by itself hold after any finite motion
    own = np.setdiff1d(np.arange(system.m), system.left_rows)
    before, after, nodal = two_states(system, size=0.2)
    assert abs(system.constraints.values(after))[own].max() < 2e-13
    mid = 0.5 * (before + after)
    G = system.constraints.jacobian(mid).toarray()[own]
    assert abs(G @ null_space(system, mid, nodal.fixed)).max() < 1e-12


def four_bar_with_a_beam(theory, elements, hung):
    """Four-bar linkage whose coupler is a beam; another beam may hang on the rocker."""
    points = np.array([[0, 0, 0], [0, 0.3, 0], [1, 0.8, 0], [1, 0, 0]])
    model, own = sc.Model(), {"director": (0, 0, 1), "theory": theory}
    crank, rocker = (
        model.add(name, sc.RigidBody.box(1.0, (0.3, 0.05, 0.8), position=points[k : k + 2].mean(0)))
        for k, name in ((0, "crank"), (2, "rocker"))
    )
    mesh = sc.MeshCurve.init_line(points[1], points[2], elements, "coupler")
    coupler = model.add("coupler", sc.Beam(mesh, SECTION, **own))
    before = [sc.ground(points[0]), crank.at(points[1]), coupler.node("coupler.end")]
    after = [crank.at(points[0]), coupler.node("coupler.start"), rocker.at(points[2])]
    before.append(rocker.at(points[3]))
    after.append(sc.ground(points[3]))
    for k, (a, b) in enumerate(zip(before, after, strict=True)):
        model.add(f"pin {k}", sc.JointRevolute(a, b, (0, 0, 1)))
    if hung:
        mesh = sc.MeshCurve.init_line(points[2], points[2] + (0.5, 0.3, 0), 2, "arm")
        arm = model.add("arm", sc.Beam(mesh, SECTION, **own))
        model.add("weld", sc.JointFixed(rocker.at(points[2]), arm.node("arm.start")))
    return model


@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore:.*singular position.*")
@pytest.mark.parametrize("hung", [False, True])
@pytest.mark.parametrize("elements", [2, 3, 4])
@pytest.mark.parametrize("theory", [*THEORIES[:2], *UNTWISTED], ids=repr)
def test_rows_of_loops_with_held_strains_are_as_many_as_their_rank(theory, elements, hung):
    """By singular values of the constraint Jacobian, in singular positions, too."""
    system = four_bar_with_a_beam(theory, elements, hung).freeze()
    y = system.extend(system.q0, 0.0)
    G = system.constraints.jacobian(y).toarray()
    keep = system.independent_rows(y)
    assert keep.sum() == np.linalg.matrix_rank(G[keep], 1e-9) == np.linalg.matrix_rank(G, 1e-9)
    P = system.null_space(system.q0)
    assert abs(G @ P).max() < 1e-12
    assert np.linalg.matrix_rank(P) == system.unknowns


# -- the swing -------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("integrator", [sc.EnergyMomentum(), sc.Variational()])
@pytest.mark.parametrize(
    ("theory", "unknowns"),
    [
        (sc.TheoryKirchhoff(), 82),
        (sc.TheoryInextensible(), 62),
        (sc.TheoryInextensible(torsion=False), 42),
        (sc.TheoryRigid(), 2),
    ],
)
def test_three_bar_swing_on_each_theory(theory, unknowns, integrator):
    system, full = (swing().build("physical", theory=each) for each in (theory, None))
    assert (system.unknowns, full.unknowns) == (unknowns, 122)
    q, other, expected = (
        sc.simulate(scene, integrator, treatment, 1e-2, until=0.1, kernels="numpy")["q"][-1]
        for scene, treatment in [*((system, each) for each in TREATMENTS), (full, TREATMENTS[0])]
    )
    assert abs(q - other).max() < 1e-10
    mid = system.frame_place("beam") + 12 * 10
    error = np.linalg.norm((q - expected)[mid : mid + 3])
    assert error < (5e-2 if theory == sc.TheoryRigid() else 1e-3)


# -- bad input and limits --------------------------------------------------------------------------


def test_bad_theories_are_refused():
    with pytest.raises(sc.InputError, match=r"theory = 'rigid', expected a Theory"):
        arc("rigid")
    with pytest.raises(sc.InputError, match=r"torsion = 1, expected True or False"):
        sc.TheoryInextensible(torsion=1)
    system = arc(sc.TheoryInextensible()).freeze()
    with pytest.raises(sc.InputError, match=r"multipliers.*shape \(3,\)"):
        diagnostics.section_forces(system, system.structures[0], system.q0, multipliers=[1, 2, 3])
    start = np.zeros(system.n)
    start[12] = 1.0
    with pytest.raises(sc.InputError, match=r"beam 'rod', TheoryInextensible\(\)"):
        sc.initial_state(system, v=start)


def test_explicit_steps_take_no_theories():
    model = arc(sc.TheoryInextensible(), lumped=True)
    with pytest.raises(sc.IncompatibleError, match="TheoryInextensible"):
        sc.simulate(model.freeze(), sc.Explicit(), sc.Multipliers(), 1e-5, until=2e-5)


@pytest.mark.one_quick
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    ("build", "theory"),
    [
        (clamped_at_both_ends, sc.TheoryInextensible()),
        (clamped_at_both_ends, sc.TheoryKirchhoff(torsion=False)),
        (clamped_at_both_ends, sc.TheoryReissner(torsion=False)),
        (ring, sc.TheoryKirchhoff(torsion=False)),
        (ring, sc.TheoryInextensible(torsion=False)),
    ],
)
def test_beams_that_no_small_motion_leaves_as_they_are_are_refused(build, theory, order):
    """Treatments gave a sag of 3 mm by motions of the mesh, or diverged; the advice works."""
    extensible = not isinstance(theory, sc.TheoryInextensible)
    advice = "Take a theory" if extensible else r"theory=TheoryKirchhoff\(\),"
    with pytest.raises(sc.InputError, match=f"singular position.*{advice} with torsion$"):
        build(theory, order).freeze()
    system = build(type(theory)() if extensible else sc.TheoryKirchhoff(), order).freeze()
    assert not system.warnings


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS)
def test_arches_that_can_move_do(treatment):
    """Inextensible ones, and without torsion in their plane: the same equilibrium."""
    found = []
    for theory, planar in ((THEORIES[1], None), (UNTWISTED[1], sc.Planar((0, 0, 1)))):
        model = arc(theory)
        rod = model["rod"]
        for end in ("rod.start", "rod.end"):
            place = rod.node(end)
            model.add(f"clamp {end}", sc.JointFixed(sc.ground(place.position), place))
        model.add("force", sc.LoadForce(rod.node(3), (20.0, 30.0, 0)))
        system = model.freeze(planar=planar)
        found.append(sc.static(system, treatment, kernels="numpy")["q"][-1])
    assert abs(found[0] - found[1]).max() < 1e-9
    assert abs(found[0] - system.q0).max() > 1e-4


@pytest.mark.slow
def test_long_beams_on_loops_are_for_multipliers():
    system = clamped_at_both_ends(sc.TheoryKirchhoff(), 1, 110).freeze()
    sc.Stepper(system, sc.EnergyMomentum(), sc.Multipliers(), 1e-3)
    words = r"full matrix of 434 unknowns; Multipliers\(\) has a sparse one"
    with pytest.warns(sc.PerformanceWarning, match=words):
        sc.Stepper(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-3)


def test_refined_beams_and_other_processes_keep_the_theory():
    rod = arc(sc.TheoryKirchhoff(torsion=False))["rod"]
    assert rod.refined(1).theory == sc.TheoryKirchhoff(torsion=False)
    system = arc(sc.TheoryKirchhoff()).freeze()
    again = pickle.loads(pickle.dumps(system))
    assert again.counts() == system.counts()


# -- compiled kernels ------------------------------------------------------------------------------


def hinged_frame(theory, order=1):
    """The branched scene with a full stiffness."""
    return branched(theory, order, full_section()).freeze()


@pytest.mark.slow
@integrators
@pytest.mark.parametrize("theory", THEORIES, ids=repr)
def test_kernels_agree_on_trees(theory, integrator):
    """An iteration far from a solution, and a run."""
    system = hinged_frame(theory)
    assert_same_iteration(system, integrator, "null space", 1)
    assert_same(*both(system, integrator, "null space", 2e-3, 0.06))


@pytest.mark.slow
@integrators
@pytest.mark.parametrize("theory", [*THEORIES, UNTWISTED[1]], ids=repr)
def test_kernels_agree_on_the_swing(theory, integrator):
    """A closed loop through the beam, out of its plane, too; the forces that hold strains."""
    system = swing().scene("stiff", elements=4, theory=theory, side_load=0.3).freeze()
    assert system.closure.rank > 0
    start = sc.initial_state(system)
    assert_same(*both(system, integrator, "null space", 2e-3, 0.05, start), iterates=False)


@pytest.mark.slow
@integrators
def test_kept_factors(integrator):
    """Over steps, turned with the frames: fewer matrices than iterations, the same motion."""
    system = hinged_frame(sc.TheoryInextensible())
    whole, kept = with_kept_factors(system, integrator, "null space", 5e-4, 0.05)
    assert abs(kept["q"][-1] - whole["q"][-1]).max() < 1e-11 * abs(whole["q"][-1]).max()
    assert 2 * kept.meta["factorisations"] < whole.meta["factorisations"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:balance of energy")
@treatments
@integrators
@pytest.mark.parametrize("scene", ["higher order", "rigid", "torsion held"])
def test_kernels_agree_where_strains_are_rows_with_multipliers(scene, integrator, treatment):
    """Of higher order, beside others that hold torsion, and with multipliers all."""
    if scene == "torsion held":
        system = swing().scene("stiff", elements=20, theory=UNTWISTED[1]).freeze()
        start = sc.initial_state(system)
    else:
        system = hinged_frame(THEORIES[2 if scene == "rigid" else 1], 2)
        start = moving(system)
    plain, compiled = both(system, integrator, treatment, 1e-3, 0.01, start)
    for name in compiled.meta["limits"]:  # kernels go another way: with multipliers
        compiled.meta["limits"][name] *= 4
    assert_same(plain, compiled, iterates=False)


@pytest.mark.one_quick
@needs_numba
@pytest.mark.parametrize("order", [1, 2])
def test_oblique_sections_in_a_plane(order):
    """Both directors lean out of the plane."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    section = sc.SectionCircle(0.02, sc.Material(5e6, 0.5, 1100.0))
    options = {"order": order, "director": (0, 0.5**0.5, 0.5**0.5), "theory": THEORIES[0]}
    beam = model.add("rod", sc.Beam(mesh, section, **options))
    model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), beam.node("rod.start"), (0, 0, 1)))
    model.add("weight", sc.LoadGravity((0, -9.81, 0)))
    system = model.freeze(planar=sc.Planar((0, 0, 1)))
    rest = sc.initial_state(system)
    assert_same(*both(system, "energy-momentum", "null space", 1e-3, 0.02, rest))
