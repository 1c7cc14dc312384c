"""Compiled kernels against the plain ones: scenes, an iteration far from a solution, whole runs."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
from helpers_scenes import full_section, rotation
from rounding import limits, nudged

import skfem_cosserat as sc
from skfem_cosserat import Stepper
from skfem_cosserat.model.system import Coordinates

INTEGRATORS = {"variational": sc.Variational(), "energy-momentum": sc.EnergyMomentum()}
TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
integrators = pytest.mark.parametrize("integrator", INTEGRATORS)
treatments = pytest.mark.parametrize("treatment", TREATMENTS)
needs_numba = pytest.mark.skipif(find_spec("numba") is None, reason="numba is not installed")
#: what is compared of runs
SERIES = ("q", "p", "carried", "work_loads", "constraint_force")


# -- scenes ----------------------------------------------------------------------------------------


def nothing(model: sc.Model) -> None:
    """What is added to a scene that is complete."""


def tree(order: int, add: Callable[[sc.Model], None] = nothing) -> sc.System:
    """A pinned curved beam, a ball joint at its end to a body, and a mass point on a rope.

    `add` may add to the model.
    """
    rng = np.random.default_rng(order)
    model = sc.Model()
    mesh = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.2, 1.2, 3, name="arc")
    rod = model.add("rod", sc.Beam(mesh, full_section(), order=order, director=(0, 0, 1)))
    pin = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("arc.start"), axis=(0.6, 0.8, 0))
    model.add("pin", pin)
    tip = 1.2 * np.array([np.sin(1.2), 1 - np.cos(1.2), 0.0])
    inertia = np.array([[0.5, 0.06, -0.04], [0.06, 0.6, 0.09], [-0.04, 0.09, 0.45]])
    body = sc.RigidBody(
        1.5, inertia, center=(0.1, -0.2, 0.15), position=(1.6, 1.5, 0), triad=rotation(rng).T
    )
    model.add("body", body)
    model.add("ball", sc.JointSpherical(rod.node("arc.end"), body.at(tip)))
    point = model.add("point", sc.MassPoint(0.4, position=(1.6, 2.5, 0.1)))
    model.add("rope", sc.JointDistance(body.at((1.6, 1.6, 0)), point.place()))
    model.add("lump", sc.RigidBody.sphere(0.3, 0.1, on=rod.node("arc.end")))
    model.add("gravity", sc.LoadGravity((0.5, -0.3, -9.81)))
    model.add("push", sc.LoadForce(rod.node("arc.end"), (1.0, 2.0, 0.5), lambda t: np.sin(20 * t)))
    add(model)
    return model.freeze()


def corner(order: int, add: Callable[[sc.Model], None] = nothing) -> sc.System:
    """Two beams rigidly connected at an angle: nodal triads that are not those of the section.

    `add` may add to the model.
    """
    points = [(0, 0, 0), (1, 0, 0), (1.3, 0.9, 0.2)]
    mesh = sc.MeshCurve.init_polyline(points, 2, name="c")
    model = sc.Model()
    beam = model.add("beam", sc.Beam(mesh, full_section(), order=order, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground(points[0]), beam.node("c.start")))
    model.add("gravity", sc.LoadGravity((0.5, -0.3, -9.81)))
    add(model)
    system = model.freeze()
    assert system.beam_groups[0].elements.rotations is not None
    return system


def chain(count: int) -> sc.System:
    """Links on ball joints and hinges in turn: a tree as deep as it is long."""
    model = sc.Model()
    previous = sc.ground((0, 0, 0))
    for k in range(count):
        link = sc.RigidBody.box(1.0, (0.05, 0.05, 0.3), position=(0.15 + 0.3 * k, 0, 0))
        model.add(f"link {k}", link)
        here = (0.3 * k, 0, 0)
        if k % 2:
            joint: sc.Joint = sc.JointRevolute(previous, link.at(here), axis=(0, 1, 0))
        else:
            joint = sc.JointSpherical(previous, link.at(here))
        model.add(f"joint {k}", joint)
        previous = link.at((0.3 * (k + 1), 0, 0))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    return model.freeze()


def moving(system: sc.System, seed: int = 4) -> sc.State:
    """A start with some speed."""
    v = np.random.default_rng(seed).standard_normal(system.n)
    return sc.initial_state(system, v=sc.project(system, system.q0, v))


# -- whole runs ------------------------------------------------------------------------------------


def both(
    system: sc.System,
    integrator: str,
    treatment: str | sc.Multipliers,
    h: float,
    until: float,
    start: sc.State | None = None,
    **options: Any,
) -> tuple[sc.History, sc.History]:
    """Plain and compiled, which knows from a nudged start what is rounding.

    Without kept factors, so with the same iterates.
    """
    pytest.importorskip("numba")
    from skfem_cosserat.integrators.compiled_step import kernel_coordinates

    start = moving(system) if start is None else start
    how = TREATMENTS[treatment] if isinstance(treatment, str) else treatment
    settings = sc.NewtonSettings(reuse=0)
    options = {"derive": False, "settings": settings} | options
    plain, compiled, beside = (
        sc.simulate(
            system, INTEGRATORS[integrator], how, h, until, start=begin, kernels=kernels, **options
        )
        for begin, kernels in ((start, "numpy"), (start, "numba"), (nudged(start), "numba"))
    )
    compiled.meta["limits"] = limits(compiled, beside, SERIES)
    along_joints = kernel_coordinates(system, how) is system.joint_coordinates
    others = not along_joints or system.plane is not None or holds_strains(system)
    compiled.meta["other unknowns"] = others
    return plain, compiled


def assert_same(plain: sc.History, compiled: sc.History, iterates: bool = True) -> None:
    """Two runs of :func:`both`: the same motion, and the way to it if there are `iterates`.

    With multipliers, and where beams hold strains, kernels go another way than numpy.
    """
    assert compiled.meta["kernels"] == "numba" and plain.meta["kernels"] == "numpy"
    if iterates and not compiled.meta["other unknowns"]:
        assert compiled["newton_iterations"].tolist() == plain["newton_iterations"].tolist()
        assert compiled["attempts"].tolist() == plain["attempts"].tolist()
    for name, limit in compiled.meta["limits"].items():
        assert np.nanmax(abs(compiled[name] - plain[name])) <= limit, name


def with_kept_factors(
    system: sc.System,
    integrator: str,
    treatment: str,
    h: float,
    until: float,
    start: sc.State | None = None,
) -> tuple[sc.History, sc.History]:
    """Compiled, with a factorisation in each iteration, and with those that are kept."""
    pytest.importorskip("numba")
    start = moving(system) if start is None else start
    whole, kept = (
        sc.simulate(
            system, INTEGRATORS[integrator], TREATMENTS[treatment], h, until, start=start,
            kernels="numba", settings=sc.NewtonSettings(reuse=reuse),
        )
        for reuse in (0, 4)
    )  # fmt: skip
    return whole, kept


def assert_same_in_steps_of_other_sizes(system: sc.System, integrator: str, treatment: str) -> None:
    """Steps of three sizes in turns; some energy is lost in them."""
    pytest.importorskip("numba")
    exact = sc.NewtonSettings(reuse=0)
    found = []
    for kernels in ("numpy", "numba"):
        own = system, INTEGRATORS[integrator], TREATMENTS[treatment], 1e-3, exact
        stepper = sc.Stepper(*own, kernels=kernels)
        state, lost = moving(system), []
        for k in range(12):
            report = stepper.advance(state, h=(1 + k % 3) * 1e-3)
            state = report.state
            lost.append(report.work.dissipated)
        found.append((state, lost))
    (a, lost), (b, other) = found
    assert abs(a.q - b.q).max() < 1e-11 * abs(a.q).max()
    assert abs(a.p - b.p).max() < 1e-10 * abs(a.p).max()
    assert max(lost) > 0 and other == pytest.approx(lost, abs=1e-9 * max(lost))


# -- one iteration ---------------------------------------------------------------------------------


@cache
def called(function: Any) -> Any:
    """What compiled code calls, for Python to call."""
    import numba

    return numba.njit(lambda *arguments: function(*arguments))  # noqa: PLW0108


def balance_of(fast: Any) -> Any:
    """R (rows, 3) as evaluated, without the impulses of constraint rows in the iteration."""
    closing = fast._o.closing
    return fast._a.R - closing if len(closing) else fast._a.R


def holds_strains(system: sc.System) -> bool:
    """Whether beams hold strains by rows, which the tree of joints leaves."""
    return any(np.isin(each.numbers, system.left_rows).any() for each in system.theory_rows)


def assert_same_iteration(
    system: sc.System, integrator: str, treatment: str, seed: int, start: sc.State | None = None
) -> None:
    """At a random state far from the solution, with all parts of the tangent at work.

    Then once more, the next iteration with predicted stresses. The step begins at `start`, or in
    motion.
    """
    pytest.importorskip("numba")
    start = moving(system) if start is None else start
    if treatment == "multipliers":
        _same_with_rows(system.vertex_coordinates, integrator, seed, start)
    elif holds_strains(system):
        _same_with_rows(system.joint_coordinates, integrator, seed, start)
    else:
        _same_in_null_space(system, integrator, seed, start)


def _same_in_null_space(system: sc.System, integrator: str, seed: int, state: sc.State) -> None:
    from skfem_cosserat.compiled import step
    from skfem_cosserat.compiled.numbers import ROTATION
    from skfem_cosserat.integrators.compiled_step import CompiledStep

    h = 0.02
    method = INTEGRATORS[integrator]
    stepper = Stepper(system, method, sc.NullSpace(), h, kernels="numpy")
    fast: Any = CompiledStep(system.joint_coordinates, method, h, sc.NewtonSettings())
    begin, evaluate, matrix, increment = map(
        called, (step.start, step.evaluate, step.matrix, step.increment)
    )
    *rest, numbers = fast._all
    whole = *rest, numbers.copy()
    whole[-1][ROTATION] = np.inf  # as found: not scaled down for its rotations
    rng = np.random.default_rng(seed)
    for mixed in (False, True):
        guess = 0.1 * rng.standard_normal(system.unknowns)
        bound: Any = stepper.bound
        bound.begin(system.extend(state.q, state.time), system.ground(state.time + h), h)
        bound.last = guess
        fast.resume(guess)
        bound.guess(True)
        problem: Any = stepper.problem(stepper.balance.begin(state))
        problem.residual()
        plain = problem.direction()
        assert bound.solver.solve is not None
        fast._begin(state, fast.h)
        begin(fast._all, 1)
        size = evaluate(fast._all, True)
        assert fast._a.y1 == pytest.approx(problem.y1, abs=1e-13)
        assert balance_of(fast) == pytest.approx(
            problem.evaluation.R, abs=1e-12 * abs(problem.evaluation.R).max()
        )
        relative = bound.relative(problem._r, problem.evaluation.size)
        assert size == pytest.approx(relative, rel=1e-9)
        assert matrix(fast._all, 0)
        increment(whole, False)
        found = fast._a.x.ravel()[fast._numbering]
        assert found == pytest.approx(plain, abs=1e-10 * abs(plain).max())
        if mixed:  # the next one with predicted stresses
            problem.apply(plain)
            problem.residual()
            assert problem._stresses is not None
            plain = problem.direction()
            assert fast._a.found[1] == 1
            evaluate(fast._all, True)
            assert matrix(fast._all, 1)
            increment(whole, False)
            found = fast._a.x.ravel()[fast._numbering]
            # an increment that leads anywhere came before: what it amplified, two ways of rounding
            assert found == pytest.approx(plain, abs=1e-8 * abs(plain).max())


def _same_with_rows(free: Coordinates, integrator: str, seed: int, state: sc.State) -> None:
    """Against ``[[A, P^T G^T], [G P, 0]]`` of dense matrices, G the rows that its tree leaves."""
    from skfem_cosserat.compiled import step
    from skfem_cosserat.compiled.numbers import GUESS, KNOWN, MASS, ROTATION
    from skfem_cosserat.constraints.null_space import BoundNullSpace
    from skfem_cosserat.integrators.compiled_step import CompiledStep

    h, system, g = 0.02, free.system, free.system.constraints
    method: Any = INTEGRATORS[integrator]
    fast: Any = CompiledStep(free, method, h, sc.NewtonSettings())
    begin, evaluate, matrix, increment = map(
        called, (step.start, step.evaluate, step.matrix, step.increment)
    )
    rng, unknowns, a = np.random.default_rng(seed), free.kinematics.unknowns, fast._a
    balance = method.balance(system, h)
    bare = object.__new__(sc.System)  # all rows that are left are put in below
    none = {"held_rows": system.held_rows[:0], "left_rows": system.held_rows[:0]}
    vars(bare).update(vars(system), tree=free.tree, kinematics=free.kinematics, **none)
    bound: Any = BoundNullSpace(bare, method.scheme(h).weight)
    size = abs(method.scheme(h).mass * system.mass).max() * 0.1
    numbers = fast._tree["row_numbers"]
    rows, where = numbers[numbers >= 0], (*np.nonzero(numbers >= 0),)
    where = where[0] + len(system.origin_rows), where[1]
    mu = np.zeros(system.m)
    guess, mu[rows] = 0.1 * rng.standard_normal(unknowns), size * rng.standard_normal(len(rows))
    bound.begin(system.extend(state.q, state.time), system.ground(state.time + h), h)
    bound.last = guess
    fast._record[[KNOWN, GUESS]] = 1.0
    a.last[where] = mu[rows]
    a.last.ravel()[fast._numbering] = guess
    bound.guess(True)
    fast._begin(state, fast.h)
    begin(fast._all, 1)
    residual = evaluate(fast._all, True)
    y1 = bound.configure()
    data = balance.begin(state)
    found = balance.evaluate(data, y1)
    assert a.y1 == pytest.approx(y1, abs=1e-13)
    assert balance_of(fast) == pytest.approx(found.R, abs=1e-12 * abs(found.R).max())
    yc = bound.constraint_point(y1)
    G, G1 = (g.jacobian(y).toarray()[rows] for y in (yc, y1))
    # rows with weights act with what they gape by, too
    gaps, weights = g.values(y1)[rows], fast._all[-1][MASS] * fast._tree["row_weight"][numbers >= 0]
    mu[rows] += weights * gaps
    R = found.R + (G.T @ mu[rows]).reshape(-1, 3)
    r = np.concatenate([bound.reduce(R, y1), gaps])
    size = g.magnitudes(system.extend(system.q0, system.since))[rows]
    size[size == 0] = 1  # of terms that vanish at the start
    largest = max(abs(r[:unknowns]).max() / found.size, (abs(gaps) / size).max(initial=0))
    assert residual == pytest.approx(largest, rel=1e-7)
    P1 = np.array([bound.displacement(e, y1).ravel() for e in np.eye(unknowns)]).T
    P = np.array([bound.pull(e.reshape(-1, 3)) for e in np.eye(system.n)])
    blocks = balance.tangent(data, found)
    A = bound.solver.full(bound.matrix(blocks, R, y1))
    H = np.zeros((system.n, system.n))
    np.add.at(H, (g.curvature_rows, g.curvature_cols), g.curvature_values(mu, yc))
    A += bound.weight * P.T @ H @ P1 + P.T @ G.T @ (weights[:, None] * (G1 @ P1))
    none = np.zeros((len(rows), len(rows)))
    expected = -np.linalg.solve(np.block([[A, P.T @ G.T], [G1 @ P1, none]]), r)
    assert matrix(fast._all, 0)
    whole = *fast._all[:-1], fast._all[-1].copy()
    whole[-1][ROTATION] = np.inf  # as found: not scaled down for its rotations
    increment(whole, False)
    assert_near = a.x.ravel()[fast._numbering], a.x[where]
    for part, own in zip((expected[:unknowns], expected[unknowns:]), assert_near, strict=True):
        assert own == pytest.approx(part, abs=1e-9 * abs(part).max(initial=0))
