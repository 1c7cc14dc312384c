"""Theories of beams: strains that are held, against closed forms, full beams and each other."""

from __future__ import annotations

import importlib
import pickle
import re
from contextlib import nullcontext
from itertools import pairwise

import numpy as np
import pytest
from helpers_kernels import (
    assert_same,
    assert_same_iteration,
    both,
    integrators,
    moving,
    needs_numba,
    with_kept_factors,
)
from helpers_scenes import chequered, full_section
from helpers_schemes import KINDS
from scipy.linalg import eigh, null_space
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.diagnostics.stacked import null_space_matrix
from skfem_cosserat.model.plane import confine
from skfem_cosserat.model.reparametrisation import Reparametrisation

TREATMENTS = (sc.NullSpace(), sc.Multipliers())
THEORIES = (sc.TheoryKirchhoff(), sc.TheoryInextensible(), sc.TheoryRigid())
UNTWISTED = (sc.TheoryReissner(torsion=False), sc.TheoryInextensible(torsion=False))
SECTION = sc.Section([1e4, 1e4, 2e4, 100, 120, 80.0], mass=1.0, inertia=(1e-3, 2e-3))
#: Kirchhoff's inextensible rod bent out of its plane (R = 100, EI = 1e7/12, GJ = 5e6/6, 45 degrees)
#: by 600: tip by shooting, eleven digits (benchmark S3 of the collection)
BEND45 = (47.15129440030512, 15.685078162157822, 53.46859844232327)
TIP = np.array([0.0, 30.0, 50.0])


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


def branched(theory):
    """Beams of one mesh with a rigid corner, bodies and another beam on joints, a spring."""
    model = sc.Model()
    post = sc.MeshCurve.init_line((0, 0, 0), (0, 0, 1), 3, "post")
    mesh = post.joined(
        sc.MeshCurve.init_line((0, 0, 1), (1, 0, 1), 2, "beam"),
        sc.MeshCurve.init_line((0, 0, 1), (0, 1, 1.2), 2, "arm"),
    )
    directors = {"post": (1, 0, 0), "beam": (0, 1, 0), "arm": (1, 0, 0)}
    frame = model.add("frame", sc.Beam(mesh, SECTION, order=2, director=directors, theory=theory))
    turning = sc.MotionTurn((0, 0, 1.0), lambda t: np.sin(10 * t) ** 2)
    model.add("base", sc.JointFixed(sc.ground((0, 0, 0), turning), frame.node("post.start")))
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


def ring(theory):
    mesh = sc.MeshCurve.init_arc((1, 0, 0), (0, 1, 0), (-1, 0, 0), 1.0, 2 * np.pi, 6)
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, SECTION, order=2, director=(0, 0, 1), theory=theory))
    model.add("force", sc.LoadForce(rod.node(3), (20, 30, 40.0)))
    return model


# -- statics ---------------------------------------------------------------------------------------


def elastica(alpha):
    """Tip (x, y)/L of an inextensible cantilever under ``P L^2/EI = alpha`` across it."""

    def moduli(angle):
        k = np.sqrt((1 + np.sin(angle)) / 2)
        return k, np.arcsin(1 / (k * np.sqrt(2)))

    def excess(angle):
        k, phi = moduli(angle)
        return ellipk(k * k) - ellipkinc(phi, k * k) - np.sqrt(alpha)

    angle = brentq(excess, 1e-9, np.pi / 2 - 1e-9, xtol=1e-15)
    k, phi = moduli(angle)
    down = 1 - 2 * (ellipe(k * k) - ellipeinc(phi, k * k)) / np.sqrt(alpha)
    return np.array([np.sqrt(2 * np.sin(angle) / alpha), down])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "elements"), [(1, (16, 32, 64)), (2, (8, 16, 32)), (3, (8, 12, 16)), (4, (8, 10))]
)
def test_elastica_in_order_2p(order, elements):
    section = sc.Section(np.ones(6), mass=1.0, inertia=(1e-3, 1e-3))
    errors = []
    for count in elements:
        model = cantilever(sc.TheoryInextensible(), order, count, section, (0, 4.0, 0))
        path = sc.static(model, control=sc.LoadControl(steps=2))
        tip = tip_of(model, path["q"][-1])
        assert abs(tip[2]) < 1e-14
        errors.append(abs(tip[:2] - elastica(4.0)).max())
    slopes = -np.diff(np.log(errors)) / np.diff(np.log(elements))
    assert slopes == pytest.approx(2 * order, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    "treatment", [TREATMENTS[0], pytest.param(TREATMENTS[1], marks=pytest.mark.slow)]
)
def test_bend_of_45_degrees_to_the_trusted_digits(treatment):
    section = sc.Section([1e5, 1e5, 1e5, 1e7 / 12, 1e7 / 12, 5e6 / 6], 1.0, (1e-3, 1e-3))
    errors = []
    for elements in (4, 8, 16):
        arc45 = sc.MeshCurve.init_arc(
            (0, 0, 0), (1, 0, 0), (0, 1, 0), 100.0, np.pi / 4, elements, "rod"
        )
        model = sc.Model()
        theory = sc.TheoryInextensible()
        rod = model.add("rod", sc.Beam(arc45, section, order=4, director=(0, 0, 1), theory=theory))
        model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
        model.add("force", sc.LoadForce(rod.node("rod.end"), (0, 0, 600.0)))
        x, y, z = tip_of(model, sc.static(model, treatment)["q"][-1])
        # the reference bends the arc towards the other axis
        errors.append(abs(np.sort([x, y, z]) - np.sort(BEND45)).max())
    assert errors[-1] < 5e-10
    assert np.log2(errors[0] / errors[1]) == pytest.approx(8, abs=0.5)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(8, abs=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_error_of_coarse_meshes_does_not_depend_on_slenderness(order):
    """Nothing locks: with EI = 1 the section's other stiffnesses do not count."""
    tips = []
    for slender in (1e1, 1e3, 1e5):
        section = sc.Section([slender**2] * 3 + [1, 1, 1], mass=1.0, inertia=(1e-3, 1e-3))
        model = cantilever(sc.TheoryInextensible(), order, 4, section, (0, 1.0, 0))
        tips.append(tip_of(model, sc.static(model)["q"][-1]))
    assert np.array_equal(tips[0], tips[1])
    assert np.array_equal(tips[0], tips[2])
    full = cantilever(None, order, 4, section, (0, 1.0, 0))
    assert tips[0] == pytest.approx(tip_of(full, sc.static(full)["q"][-1]), abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("theory", [*THEORIES[:2], *UNTWISTED[1:]])
def test_full_beams_converge_to_the_theory_in_first_order(theory):
    """As the stiffness of what is held grows."""
    model = arc(theory)

    def tip(model):
        rod = model["rod"]
        model.add("clamp", sc.JointFixed(sc.ground((1, 0, 0)), rod.node("rod.start")))
        model.add("force", sc.LoadForce(rod.node("rod.end"), TIP))
        return tip_of(model, sc.static(model)["q"][-1])

    held = tip(model)
    errors = []
    for factor in (1e2, 1e3, 1e4):
        stiffness = np.diag(SECTION.stiffness).copy()
        stiffness[list(theory.held)] *= factor
        section = sc.Section(stiffness, mass=1.0, inertia=(1e-3, 2e-3))
        errors.append(np.linalg.norm(tip(arc(None, section=section)) - held))
    for coarse, fine in pairwise(errors):
        assert coarse / fine == pytest.approx(10, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 3])
@pytest.mark.parametrize("theory", THEORIES)
@pytest.mark.parametrize("treatment", TREATMENTS)
def test_section_forces_of_a_cantilever_are_multipliers(theory, order, treatment):
    model = cantilever(theory, order, 6, load=TIP)
    if isinstance(theory, sc.TheoryRigid):  # something must move
        body = model.add("body", sc.MassPoint(1.0, position=(0, 0, 1)))
        model.add("spring", sc.SpringDamper(sc.ground((0, 0, 2)), body.place(), 1.0))
        for direction in np.eye(3)[:2]:
            model.add(f"stay {direction}", sc.SpringDamper(sc.ground(direction), body.place(), 1.0))
    system = model.freeze()
    rod = model["rod"]
    path = sc.static(system, treatment)
    q, lam = path["q"][-1], path["multipliers"][-1]
    at_ends = diagnostics.nodal_resultants(system, rod, q, 1.0, multipliers=lam)
    triads = q[: 12 * len(rod.triads)].reshape(-1, 4, 3)[:, 1:]
    for side in (0, 1):
        nodes = rod.basis.connectivity[:, -side]
        assert np.einsum("eij,ei->ej", triads[nodes], at_ends[:, side, :3]) == pytest.approx(
            np.tile(TIP, (6, 1)), abs=1e-9
        )
    # moments balance from node to node, and are the force's about each of them
    x = q[: 12 * len(rod.triads)].reshape(-1, 12)[:, :3]
    tip = tip_of(model, q)
    for e, nodes in enumerate(rod.basis.connectivity):
        moment = triads[nodes[0]].T @ at_ends[e, 0, 3:]
        assert moment == pytest.approx(np.cross(tip - x[nodes[0]], TIP), abs=1e-9)
    # what histories export, and values between the Gauss points
    recorded = path["beam/rod/resultant"][-1]
    again = diagnostics.section_forces(system, rod, q, multipliers=lam)
    assert recorded == pytest.approx(again, abs=1e-9)
    points = np.tile(rod.elements.points, 6), np.repeat(np.arange(6), order)
    between = diagnostics.evaluate(system, rod, q, points[1], points[0], multipliers=lam)
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
def test_controls_of_paths_take_theories_in_both_treatments(theory):
    """A column past its critical load: by arc length, and by its tip's displacement."""
    section = sc.Section([1e4, 1e4, 2e4, 1, 1.3, 0.8], mass=1.0, inertia=(1e-3, 2e-3))
    model, full = (cantilever(each, 2, 6, section, (-1.0, 0.1, 0)) for each in (theory, None))

    def by_tip(model, until=0.5):
        return sc.DisplacementControl(model["rod"].node("rod.end"), (0, 1.0, 0), until)

    path, other = (sc.static(model, each, control=by_tip(model)) for each in TREATMENTS)
    assert abs(path["q"] - other["q"]).max() < 1e-9
    assert path["load_factor"] == pytest.approx(other["load_factor"], rel=1e-8)
    expected = sc.static(full, control=by_tip(full))["load_factor"][-1]
    assert path["load_factor"][-1] == pytest.approx(expected, rel=1e-3)
    for treatment in TREATMENTS:  # its steps are its own, the curve is not
        path = sc.static(model, treatment, control=sc.ArcLength(6, first=0.5, length=0.05))
        again = sc.static(model, control=by_tip(model, tip_of(model, path["q"][-1])[1]))
        assert again["load_factor"][-1] == pytest.approx(path["load_factor"][-1], rel=1e-8)


# -- counts: p points are right --------------------------------------------------------------------


def theory_jacobian(system, points=None):
    """Rows that hold strains by ``(phi, omega)`` of all nodes but the clamped first one.

    Rows are scaled so that their norm is that of strains in L2; `points` are the Gauss points kept.
    """
    (rows,) = system.theory_rows
    y = system.extend(system.q0, 0.0)
    G = system.constraints.jacobian(y).toarray()
    numbers = rows.numbers if points is None else rows.numbers[:, points]
    measure = rows.beam.elements.measure
    weights = np.broadcast_to(measure, rows.shape) if points is None else measure[:, points]
    weights = np.broadcast_to(weights, numbers.shape).ravel()
    P = np.zeros((system.n, 6 * len(rows.beam.triads)))
    for a, triad in enumerate(rows.beam.triads):
        P[12 * a : 12 * a + 3, 6 * a : 6 * a + 3] = np.eye(3)
        for k, d in enumerate(triad):
            row = slice(12 * a + 3 * k + 3, 12 * a + 3 * k + 6)
            P[row, 6 * a + 3 : 6 * a + 6] = np.cross(np.eye(3), d).T
    return np.sqrt(weights)[:, None] * (G[numbers.ravel()] @ P)[:, 6:]


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


@pytest.mark.slow
def test_one_point_more_locks():
    """All motion is lost in linear elements; others approach the solution slowly."""
    one_more = sc.InterpolationLobatto(1, points=2)
    with pytest.raises(sc.InputError, match="mobility is zero"):
        cantilever(sc.TheoryInextensible(torsion=False), one_more, 8).freeze()
    section = sc.Section(np.ones(6), mass=1.0, inertia=(1e-3, 1e-3))
    errors = {2: [], 3: []}
    for points, own in errors.items():
        for elements in (4, 8):
            quadratic = sc.InterpolationLobatto(2, points=points)
            model = cantilever(sc.TheoryInextensible(), quadratic, elements, section, (0, 4.0, 0))
            path = sc.static(model, control=sc.LoadControl(steps=2))
            own.append(abs(tip_of(model, path["q"][-1])[:2] - elastica(4.0)).max())
    assert errors[3][0] > 9 * errors[2][0]
    assert errors[3][1] > 25 * errors[2][1]
    assert np.log2(errors[3][0] / errors[3][1]) == pytest.approx(2.34, abs=0.1)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_one_point_fewer_leaves_motions_that_strain_nothing(order):
    """Beside the rigid ones: in shapes with p - 1 points, none with p."""
    system = arc(sc.TheoryInextensible(), order, 5).freeze()
    K = system_stiffness(system)
    counts = []
    for kept in (list(range(order)), list(range(order - 1))):
        (rows,) = system.theory_rows
        G = system.constraints.jacobian(system.extend(system.q0, 0.0)).toarray()
        internal = G[: system.internal]
        free = null_space(np.vstack([internal, G[rows.numbers[:, kept].ravel()]]))
        values = eigh(free.T @ K @ free, eigvals_only=True)
        counts.append(int((values < 1e-9 * values[-1]).sum()))
    assert counts[0] == 6
    assert counts[1] == 6 + 3 * 5


def system_stiffness(system):
    y = system.extend(system.q0, 0.0)
    return diagnostics.stacked.material_stiffness(system, y).toarray()


# -- modes -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("theory", [*THEORIES, *UNTWISTED])
@pytest.mark.parametrize("order", [1, 3])
def test_modes_are_as_many_as_unknowns_and_six_are_rigid(theory, order):
    elements = 5
    model = arc(theory, order, elements)
    system = model.freeze()
    nodes = order * elements
    unknowns = 6 + nodes * (6 - len(theory.held))
    assert system.unknowns == unknowns
    assert system.counts()["rank"] == system.m
    if isinstance(theory, sc.TheoryRigid):
        return
    found = sc.modes(system, count=unknowns)
    assert found.rigid == 6
    assert len(found) == unknowns
    assert (found.omega[6:] > 1).all()
    full = sc.modes(arc(None, order, elements), count=9)
    bending = 3 if theory.torsion else 2  # the third one twists
    both = slice(6, 6 + bending)
    assert found.omega[both] == pytest.approx(full.omega[both], rel=0.1)
    assert (found.omega[6:9] >= full.omega[6:9] * (1 - 1e-9)).all()


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("eta", "flap", "lag"),
    [
        (0.0, "3.5160152685002 22.034491564667", "3.5160152685002 22.034491564667"),
        (2.0, "4.1373195730254 22.614921956504", "3.6217969641241 22.526311173798"),
    ],
)
def test_rotating_blade_to_the_trusted_digits(eta, flap, lag):
    """Inextensible Euler-Bernoulli blade (M2 of the collection: determinants to 13 digits).

    What is left of rotary inertia is that of a slenderness of 1e5.
    """
    rotary = 1e-10 / 12
    section = sc.Section([1, 1, 1, 1, 1, 100.0], mass=1.0, inertia=(rotary, rotary))
    model = cantilever(sc.TheoryInextensible(), 4, 12, section)
    spin = sc.Spin((0, 0, eta))
    if eta:
        path = sc.static(model, control=sc.LoadControl(steps=1), spin=spin, watch=False)
        found = sc.modes(model, path, 4, spin=spin)
    else:
        found = sc.modes(model, count=4)
    expected = np.sort(np.array((flap + " " + lag).split(), dtype=float))
    assert found.omega == pytest.approx(expected, rel=2e-8)


@pytest.mark.slow
@pytest.mark.parametrize(("order", "limit"), [(1, 4.0), (2, 24.0)])
@pytest.mark.parametrize("theory", THEORIES[:2])
def test_taut_beams_give_way_where_full_ones_do(theory, order, limit):
    """At ``limit EI/h^2``: rotations of nodes that the Gauss points do not see."""
    section = sc.Section([1e6, 1e6, 1e6, 1, 1, 1.0], mass=1.0, inertia=(1e-3, 1e-3))
    grows = []
    for share in (0.95, 1.03):
        tension = share * limit * 12**2
        model = cantilever(theory, order, 12, section, (tension, 0, 0))
        system = model.freeze()
        q = system.q0.copy().reshape(-1, 12)
        if 2 not in theory.held:
            q[:, 0] *= 1 + tension / 1e6
        words = re.escape(f"tension {tension:.3g} N between nodes")
        taut = pytest.warns(sc.AccuracyWarning, match=words)
        with taut if share > 1 else nullcontext():
            found = sc.modes(system, q.ravel(), 3, t=0.0)
        grows.append(bool(found.growth.max() > 1))
    assert grows == [False, True]
    with taut:
        path = sc.static(model, control=sc.LoadControl(steps=1), watch=False)
    start = sc.initial_state(system, q=path["q"][-1])
    arguments = sc.EnergyMomentum(), sc.NullSpace(), 1e-5
    with pytest.warns(sc.AccuracyWarning, match="elements in place of 12"):
        sc.simulate(system, *arguments, until=3e-5, start=start, kernels="numpy")


# -- dynamics --------------------------------------------------------------------------------------

SCENES = [
    *[(branched, theory) for theory in THEORIES[:2]],
    *[pytest.param(branched, theory, marks=pytest.mark.slow) for theory in UNTWISTED],
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


def flying(theory, order=2, elements=3):
    """A rod in free flight, turning, pushed for a while."""
    spin = np.array([3.0, 2.0, 1.0])
    model = arc(
        theory, order, elements, velocity=lambda x: np.cross(spin, x), angular_velocity=tuple(spin)
    )
    pulse = sc.Table([0.0, 0.01, 0.02], [0.0, 1.0, 0.0])
    model.add("push", sc.LoadForce(model["rod"].node("rod.end"), 10 * TIP, pulse))
    return model


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*may have several solutions")
@pytest.mark.parametrize("order", [1, pytest.param(3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("theory", [*THEORIES, *UNTWISTED])
@pytest.mark.parametrize("treatment", TREATMENTS)
def test_energy_momentum_conserves(theory, order, treatment):
    run = sc.simulate(
        flying(theory, order).freeze(),
        sc.EnergyMomentum(),
        treatment,
        4e-3,
        until=0.1,
        kernels="numpy",
    )
    after = run.times > 0.0201
    for name in ("energy", "linear_momentum", "angular_momentum"):
        values = run[name][after]
        assert np.ptp(values, axis=0) == pytest.approx(0, abs=2e-11 * abs(values).max())
    assert abs(run["energy_balance"]).max() < 1e-10


# energy is not followed in steps of this size
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize("theory", [*THEORIES, *UNTWISTED])
@pytest.mark.parametrize("treatment", TREATMENTS)
def test_variational_conserves_momenta(theory, treatment):
    run = sc.simulate(
        flying(theory).freeze(), sc.Variational(), treatment, 4e-3, until=0.06, kernels="numpy"
    )
    after = run.times > 0.0201
    for name in ("linear_momentum", "angular_momentum"):
        values = run[name][after]
        assert np.ptp(values, axis=0) == pytest.approx(0, abs=2e-12 * abs(values).max())


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
    def run(theory):
        system = flying(theory).freeze()
        return sc.simulate(
            system, sc.EnergyMomentum(), sc.NullSpace(), 2e-3, until=0.03, kernels=kernels
        )["q"][:, :12]

    rigid = run(sc.TheoryRigid())
    rod = flying(None)["rod"]
    model = sc.Model()
    body = model.add("body", rod.rigid_body())
    place = body.at(rod.node("rod.end").position)
    pulse = sc.Table([0.0, 0.01, 0.02], [0.0, 1.0, 0.0])
    model.add("push", sc.LoadForce(place, 10 * TIP, pulse))
    alone = sc.simulate(
        model.freeze(), sc.EnergyMomentum(), sc.NullSpace(), 2e-3, until=0.03, kernels=kernels
    )["q"]
    assert abs(alone - rigid).max() < 1e-12
    assert flying(sc.TheoryRigid()).freeze().unknowns == 6


@pytest.mark.slow
def test_stiffer_beams_converge_to_the_rigid_one_in_first_order():
    def tip(theory, factor=1.0):
        """Of a rod on a hinge that hangs on a spring."""
        section = sc.Section(factor * SECTION.stiffness, mass=1.0, inertia=(1e-3, 2e-3))
        model = arc(theory, section=section)
        rod = model["rod"]
        hinge = sc.JointRevolute(sc.ground((1, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
        model.add("hinge", hinge)
        model.add("spring", sc.SpringDamper(sc.ground((0, 2, 0)), rod.node("rod.end"), 300.0))
        model.add("force", sc.LoadForce(rod.node("rod.end"), (-40.0, 0, 30.0)))
        return tip_of(model, sc.static(model)["q"][-1])

    rigid = tip(sc.TheoryRigid())
    errors = [np.linalg.norm(tip(None, factor) - rigid) for factor in (1e2, 1e3, 1e4)]
    for coarse, fine in pairwise(errors):
        assert coarse / fine == pytest.approx(10, rel=0.02)


# -- the tree --------------------------------------------------------------------------------------


# an inextensible ring without torsion is refused, see below
@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore::skfem_cosserat.ModelWarning")
@pytest.mark.parametrize(
    ("scene", "theory"),
    [
        *[(branched, theory) for theory in (*THEORIES, *UNTWISTED)],
        *[(looped, theory) for theory in (*THEORIES[:2], *UNTWISTED)],
        *[(ring, theory) for theory in (*THEORIES[:2], UNTWISTED[0])],
    ],
)
def test_null_space_annihilates_the_jacobian_at_nodes_and_midpoints(scene, theory):
    system = scene(theory).freeze()
    y = system.extend(system.q0, 0.0)
    P = null_space_matrix(system, y)
    assert abs(system.constraints.jacobian(y) @ P).max() < 1e-13
    assert np.linalg.matrix_rank(P.toarray()) == system.unknowns
    # rows that the tree fulfils by itself hold after any finite motion
    own = np.ones(system.m, dtype=bool)
    own[system.left_rows] = False
    nodal = Reparametrisation(system.kinematics)
    nodal.begin(y, y[system.rows :])
    nodal.add(0.2 * np.random.default_rng(3).standard_normal(system.kinematics.unknowns))
    moved = nodal.configuration()
    assert abs(system.constraints.values(moved))[own].max() < 2e-13
    mid = 0.5 * (y + moved)
    kin = system.kinematics
    values = kin.values_at(mid, nodal.fixed)
    G = system.constraints.jacobian(mid)[own]
    random = np.random.default_rng(4)
    for _ in range(3):
        rates = kin.T.expand(values, random.standard_normal(kin.unknowns))
        assert abs(G @ kin.rates(mid, rates).ravel()).max() < 1e-12


def four_bar_with_a_beam(theory, elements, hung=False):
    """Four-bar linkage whose coupler is a beam; another beam may hang on the rocker."""
    points = np.array([[0, 0, 0], [0, 0.3, 0], [1, 0.8, 0], [1, 0, 0]])
    model, ends = sc.Model(), [sc.ground(points[0])]
    for name, a, b in zip(("crank", "coupler", "rocker"), points, points[1:], strict=False):
        if name == "coupler":
            mesh = sc.MeshCurve.init_line(a, b, elements, name)
            beam = model.add(name, sc.Beam(mesh, SECTION, director=(0, 0, 1), theory=theory))
            ends += [beam.node("coupler.start"), beam.node("coupler.end")]
            continue
        size = (0.05, 0.05, float(np.linalg.norm(b - a)))
        bar = sc.RigidBody.box(1.0, size, position=(a + b) / 2, triad=sc.triad(b - a))
        model.add(name, bar)
        ends += [bar.at(a), bar.at(b)]
    ends.append(sc.ground(points[3]))
    for k, (a, b) in enumerate(zip(ends[::2], ends[1::2], strict=True)):
        model.add(f"pin {k}", sc.JointRevolute(a, b, (0, 0, 1)))
    if hung:
        mesh = sc.MeshCurve.init_line(points[2], points[2] + (0.5, 0.3, 0), 2, "arm")
        arm = model.add("arm", sc.Beam(mesh, SECTION, director=(0, 0, 1), theory=theory))
        model.add("weld", sc.JointFixed(model["rocker"].at(points[2]), arm.node("arm.start")))
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

SWING = {
    "full": (None, 122),
    "unshearable": (sc.TheoryKirchhoff(), 82),
    "inextensible": (sc.TheoryInextensible(), 62),
    "untwisted": (sc.TheoryInextensible(torsion=False), 42),
    "rigid": (sc.TheoryRigid(), 2),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "integrator",
    [sc.EnergyMomentum(), pytest.param(sc.Variational(), marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("name", list(SWING)[1:])
def test_three_bar_swing_on_each_theory(name, integrator):
    theory, unknowns = SWING[name]
    system = swing().build("physical", theory=theory)
    assert system.unknowns == unknowns
    q = [
        sc.simulate(system, integrator, treatment, 1e-2, until=0.1, kernels="numpy")["q"][-1]
        for treatment in TREATMENTS
    ]
    assert abs(q[0] - q[1]).max() < 1e-10
    full = swing().build("physical")
    expected = sc.simulate(full, integrator, sc.NullSpace(), 1e-2, until=0.1, kernels="numpy")["q"]
    mid = system.frame_place("beam") + 12 * 10
    error = np.linalg.norm(q[0][mid : mid + 3] - expected[-1, mid : mid + 3])
    assert error < (5e-2 if name == "rigid" else 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["inextensible"]
    + [pytest.param(n, marks=pytest.mark.slow) for n in SWING if n != "inextensible"],
)
def test_planar_swing_on_each_theory(name):
    """The same motion by half of the unknowns or less."""
    theory, _ = SWING[name]
    space, plane = (swing().build("physical", theory=theory) for _ in range(2))
    confine(plane, sc.Planar())
    assert plane.unknowns == {"full": 61, "unshearable": 41, "rigid": 1}.get(name, 21)
    expected = None
    for treatment in TREATMENTS:
        for system in (space, plane):
            arguments = sc.EnergyMomentum(), treatment, 1e-2
            q = sc.simulate(system, *arguments, until=0.05, kernels="numpy", derive=False)["q"]
            expected = q if expected is None else expected
            assert abs(q - expected).max() < 1e-12


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


def held_at_both_ends(theory, order, turn=0.0):
    """A clamped beam of length 1 with its weight, straight or an arc."""
    model = sc.Model()
    if turn:
        mesh = sc.MeshCurve.init_arc((0, 0, 0), (0, 0, 1), (1, 0, 0), 1 / turn, turn, 4, name="rod")
    else:
        mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    section = sc.SectionCircle(0.01, sc.Material(5e6, 0.45, 1100))
    beam = sc.Beam(mesh, section, order=order, director=(0, 1, 0), theory=theory)
    rod = model.add("rod", beam)
    for end in ("start", "end"):
        node = rod.node(f"rod.{end}")
        model.add(end, sc.JointFixed(sc.ground(node.position), node))
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    return model


def closed_ring(theory, order):
    model = sc.Model()
    mesh = sc.MeshCurve.init_arc((0, 0, 0), (0, 1, 0), (1, 0, 0), 0.25, 2 * np.pi, 8, name="rod")
    section = sc.SectionCircle(0.01, sc.Material(5e6, 0.45, 1100))
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 0, 1), theory=theory))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    return model


@pytest.mark.one_quick
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    ("build", "theory"),
    [
        (held_at_both_ends, sc.TheoryInextensible()),
        (held_at_both_ends, sc.TheoryKirchhoff(torsion=False)),
        (held_at_both_ends, sc.TheoryReissner(torsion=False)),
        (closed_ring, sc.TheoryKirchhoff(torsion=False)),
        (closed_ring, sc.TheoryInextensible(torsion=False)),
    ],
)
def test_beams_that_no_small_motion_leaves_as_they_are_are_refused(build, theory, order):
    """Treatments gave a sag of 3 mm by motions of the mesh, or diverged; the advice works."""
    with pytest.raises(sc.InputError, match="singular position") as caught:
        build(theory, order).freeze()
    extensible = not isinstance(theory, sc.TheoryInextensible)
    advice = (
        "Take a theory with torsion" if extensible else "theory=TheoryKirchhoff(), with torsion"
    )
    assert str(caught.value).endswith(advice)
    system = build(type(theory)() if extensible else sc.TheoryKirchhoff(), order).freeze()
    assert not system.warnings


@pytest.mark.slow
@pytest.mark.parametrize("order", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_arches_that_can_move_do(order):
    """Inextensible ones, and without torsion in their plane: as the extensible one does."""
    expected = None
    for treatment in TREATMENTS:
        for theory in (sc.TheoryInextensible(), sc.TheoryInextensible(torsion=False)):
            planar = None if theory.torsion else sc.Planar((0, 1, 0))
            model = held_at_both_ends(theory, order, turn=2.0)
            system = model.freeze(planar=planar) if planar else model.freeze()
            z = sc.static(system, treatment, kernels="numpy")["q"][-1]
            expected = z if expected is None else expected
            assert abs(z - expected).max() < 1e-9
    assert abs(expected - system.q0).max() > 1e-4


@pytest.mark.slow
def test_long_beams_on_loops_are_for_multipliers():
    model = cantilever(sc.TheoryKirchhoff(), 1, 110)
    model.add("end", sc.JointFixed(sc.ground((1, 0, 0)), model["rod"].node("rod.end")))
    system = model.freeze()
    sc.Stepper(system, sc.EnergyMomentum(), sc.Multipliers(), 1e-3)
    words = r"full matrix of 434 unknowns; Multipliers\(\) has a sparse one"
    with pytest.warns(sc.PerformanceWarning, match=words):
        stepper = sc.Stepper(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-3)
    assert len(stepper.notices.found) == 1


def test_refined_beams_and_other_processes_keep_the_theory():
    rod = arc(sc.TheoryKirchhoff(torsion=False))["rod"]
    assert rod.refined(1).theory == sc.TheoryKirchhoff(torsion=False)
    system = arc(sc.TheoryKirchhoff()).freeze()
    again = pickle.loads(pickle.dumps(system))
    assert again.counts() == system.counts()


# -- compiled kernels ------------------------------------------------------------------------------

COMPILED = (sc.TheoryInextensible(), sc.TheoryKirchhoff(), sc.TheoryRigid())
theories = pytest.mark.parametrize("theory", COMPILED, ids=repr)


def crooked(theory, order=1):
    """A beam with corners that the tree runs along against its elements, and what hangs on it.

    On a hinge a body, on that by a ball joint another beam, all in space.
    """
    points = [(0, 0, 0), (1, 0, 0), (1.3, 0.9, 0.2)]
    model = sc.Model()
    mesh = sc.MeshCurve.init_polyline(points, 2, name="c")
    first = sc.Beam(mesh, full_section(), order=order, director=(0, 0, 1), theory=theory)
    first = model.add("first", first)
    model.add("clamp", sc.JointFixed(sc.ground(points[2]), first.node("c.end")))
    inertia = np.array([[0.5, 0.06, -0.04], [0.06, 0.6, 0.09], [-0.04, 0.09, 0.45]])
    body = sc.RigidBody(1.5, inertia, center=(0.1, -0.2, 0.15), position=(-0.2, 0.1, 0))
    body = model.add("body", body)
    axis = (0.0, 0.6, 0.8)
    model.add("hinge", sc.JointRevolute(first.node("c.start"), body.at(points[0]), axis))
    end = np.array([-0.4, 0.0, 0.1])
    mesh = sc.MeshCurve.init_line(end, end + (0, 0.5, 0), 3, name="tail")
    other = sc.Beam(mesh, full_section(), order=order, director=(0, 0, 1), theory=theory)
    other = model.add("tail", other)
    model.add("ball", sc.JointSpherical(body.at(end), other.node("tail.start")))
    model.add("gravity", sc.LoadGravity((0.5, -0.3, -9.81)))
    return model.freeze()


@pytest.mark.slow
@integrators
@theories
def test_kernels_agree_far_from_a_solution(theory, integrator):
    assert_same_iteration(crooked(theory), integrator, "null space", 1)


@pytest.mark.slow
@integrators
@theories
def test_kernels_agree_on_trees(theory, integrator):
    assert_same(*both(crooked(theory), integrator, "null space", 2e-3, 0.06))


@pytest.mark.slow
@integrators
@pytest.mark.parametrize("theory", [*COMPILED, sc.TheoryInextensible(torsion=False)], ids=repr)
def test_kernels_agree_on_the_swing(theory, integrator):
    """A closed loop through the beam, out of its plane, too; the forces that hold strains."""
    system = swing().scene("stiff", elements=4, theory=theory, side_load=0.3).freeze()
    assert system.closure.rank > 0
    start = sc.initial_state(system)
    assert_same(*both(system, integrator, "null space", 2e-3, 0.1, start), iterates=False)


@pytest.mark.slow
@integrators
def test_kept_factors(integrator):
    """Over steps, turned with the frames: fewer matrices than iterations, the same motion."""
    system = crooked(sc.TheoryInextensible())
    whole, kept = with_kept_factors(system, integrator, "null space", 1e-3, 0.1)
    assert abs(kept["q"][-1] - whole["q"][-1]).max() < 1e-11 * abs(whole["q"][-1]).max()
    assert 2 * kept.meta["factorisations"] < whole.meta["factorisations"]


@pytest.mark.slow
@pytest.mark.parametrize("treatment", ["null space", "multipliers"])
@pytest.mark.parametrize("integrator", ["energy-momentum", "variational"])
@pytest.mark.parametrize(
    ("make", "begin"),
    [
        pytest.param(lambda: crooked(sc.TheoryInextensible(), 2), moving, id="higher order"),
        pytest.param(
            lambda: swing().scene("stiff", elements=20, theory=UNTWISTED[1]).freeze(),
            sc.initial_state,
            id="torsion held",
            marks=[pytest.mark.slow, pytest.mark.filterwarnings("ignore:balance of energy")],
        ),
        pytest.param(lambda: crooked(sc.TheoryRigid(), 2), moving, id="rigid"),
    ],
)
def test_kernels_agree_where_strains_are_rows_with_multipliers(make, begin, integrator, treatment):
    """Of higher order, beside others that hold torsion, and with multipliers all."""
    system = make()
    plain, compiled = both(system, integrator, treatment, 1e-3, 0.01, begin(system))
    for name in compiled.meta["limits"]:  # kernels go another way: with multipliers
        compiled.meta["limits"][name] *= 4
    assert_same(plain, compiled, iterates=False)


@pytest.mark.one_quick
@needs_numba
@pytest.mark.parametrize("order", [1, 2])
def test_oblique_sections_in_a_plane(order):
    """Both directors lean out of the plane."""
    mesh, model = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod"), sc.Model()
    section = sc.SectionCircle(0.02, sc.Material(5e6, 0.5, 1100.0))
    oblique, theory = np.array((0, 1, 1)) / 2**0.5, sc.TheoryKirchhoff()
    own = sc.Beam(mesh, section, order=order, director=oblique, theory=theory)
    beam = model.add("rod", own)
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), beam.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    model.add("weight", sc.LoadGravity((0, -9.81, 0)))
    system = model.freeze(planar=sc.Planar((0, 0, 1)))
    rest = sc.initial_state(system)
    assert_same(*both(system, "energy-momentum", "null space", 1e-3, 0.02, rest))
