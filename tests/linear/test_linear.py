"""Linear solvers: solutions against dense ones, singular matrices, fallbacks, choice, force."""

from __future__ import annotations

import logging
import sys

import numpy as np
import pytest
from helpers_scenes import lattice
from scipy.sparse import coo_array, kron, kronsum

import skfem_cosserat as sc
from skfem_cosserat import PerformanceWarning, Stepper, linear
from skfem_cosserat.linear import LinearSolver, SingularMatrixError
from skfem_cosserat.pattern import FrozenPattern

SOLVERS = {
    "dense": sc.SolverDense(),
    "banded": sc.SolverBanded(),
    "superlu": sc.SolverSuperLU(),
    "superlu symmetric": sc.SolverSuperLU(symmetric=True),
    "superlu partial": sc.SolverSuperLU(symmetric=False),
    "pardiso": sc.SolverPardiso(),
}
TREATMENTS = {"null-space": sc.NullSpace(), "multipliers": sc.Multipliers()}


def needed(name):
    """The solver of this name, if its package is there."""
    if name == "pardiso":
        pytest.importorskip("pypardiso")
    return SOLVERS[name]


solvers = pytest.mark.parametrize("name", SOLVERS)


@pytest.fixture(scope="module", params=TREATMENTS)
def real(request):
    """Pattern, entries and right-hand side of a step of a lattice."""
    system, h, integrator = lattice(3), 1e-3, sc.EnergyMomentum()
    stepper = Stepper(system, integrator, TREATMENTS[request.param], h, kernels="numpy")
    state = stepper.advance(sc.initial_state(system)).state
    step, bound = stepper.balance.begin(state), stepper.bound
    bound.begin(step.y0, system.ground(state.time + h), h)
    bound.guess(True)
    problem = stepper.problem(step)
    problem.residual()
    blocks = stepper.balance.tangent(step, problem.evaluation)
    data = bound.matrix(blocks, problem.evaluation.R, problem.y1)
    return bound.solver.pattern, data, bound.scale_rows(problem._r)


def backward(pattern, data, x, b):
    """Largest residual against the terms of its row."""
    A = pattern.assembled(data)
    return abs(A @ x - b).max() / (abs(A) @ abs(x) + abs(b)).max()


@pytest.mark.one_quick
@solvers
def test_solutions(real, name):
    """One and several right-hand sides; entries that change; kept factors."""
    pattern, data, _ = real
    rng = np.random.default_rng(1)
    own = LinearSolver(pattern, needed(name))
    for scale in (1.0, 3.0):
        changed = data * (1 + 1e-3 * scale * rng.standard_normal(pattern.nnz))
        for shape in ((pattern.shape[0],), (pattern.shape[0], 3)):
            b = rng.standard_normal(shape)
            kept = b.copy()
            x = own.solve(changed, b)
            assert (b == kept).all() and x.shape == shape
            dense = np.linalg.solve(pattern.assembled(changed).toarray(), b)
            condition = np.linalg.cond(pattern.assembled(changed).toarray(), np.inf)
            assert condition < 1e9
            assert abs(x - dense).max() < 1e-17 * condition * 1e3 * abs(dense).max()
            assert backward(pattern, changed, x, b) < 1e-14
            again = own.solve_again(2 * b)
            assert again == pytest.approx(2 * x, rel=1e-9, abs=1e-11 * abs(x).max())
    assert own.factorisations == 4


def grid(count):
    """Blocks of six unknowns on the points of a cubic grid: pattern and entries."""
    chain = coo_array(2 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1))
    block = np.random.default_rng(0).integers(1, 4, (6, 6))
    block = coo_array(block + block.T + 12.0 * np.eye(6))
    matrix = kron(kronsum(kronsum(chain, chain), chain), block).tocoo()
    pattern = FrozenPattern(matrix.row, matrix.col, matrix.shape)
    return pattern, pattern.data(matrix.data)


@pytest.mark.parametrize("rows", [1, 300, 2**40], ids=str)
def test_patterns_sort_their_entries(rows):
    """Some twice, none."""
    rng = np.random.default_rng(rows)
    for count in (0, 1, 400):
        i = rng.choice(rng.integers(0, rows, max(count // 2, 1)), count)
        j = rng.integers(0, 3, count)
        pattern = FrozenPattern(i, j, (rows, 3))
        keys, slot = np.unique(j * rows + i, return_inverse=True)
        assert np.array_equal(pattern.slot, slot.reshape(-1)) and pattern.nnz == len(keys)
        assert np.array_equal(pattern.indices, keys % rows)
        assert pattern.indptr.tolist() == np.searchsorted(keys, rows * np.arange(4)).tolist()


@solvers
def test_singular_matrices_raise(name):
    """A row and column of zeros; and after it the next matrix is solved as if nothing had been."""
    pattern, data = grid(3)
    cols = np.repeat(np.arange(pattern.shape[1]), np.diff(pattern.indptr))
    singular = np.where((pattern.indices == 7) | (cols == 7), 0.0, data)
    own = LinearSolver(pattern, needed(name))
    b = np.random.default_rng(3).standard_normal(pattern.shape[0])
    method = own.method
    with pytest.raises(SingularMatrixError, match="singular"):
        own.solve(singular, b)
    with pytest.raises(SingularMatrixError, match="singular"):
        own.solve(np.zeros(pattern.nnz), b)
    with pytest.raises(SingularMatrixError):  # numbers that are not finite
        own.solve(np.where(cols == 5, np.nan, data), b)
    dense = np.linalg.solve(pattern.assembled(data).toarray(), b)
    assert own.solve(data, b) == pytest.approx(dense, abs=1e-12 * abs(dense).max())
    assert own.method == method  # nothing else would have helped


@pytest.mark.parametrize("name", ["superlu symmetric", "pardiso"])
def test_pivots_off_the_diagonal(name):
    """Zeros and tiny numbers on the diagonal: found out, and solved by partial pivoting."""
    count = 60
    i = np.arange(count)
    rows = np.concatenate([i, i[:-1], i[1:], i, i])
    cols = np.concatenate([i, i[1:], i[:-1], i[::-1], (i + 7) % count])
    rows, cols = np.concatenate([rows, cols]), np.concatenate([cols, rows])
    pattern = FrozenPattern(rows, cols, (count, count))
    rng = np.random.default_rng(4)
    data = rng.standard_normal(pattern.nnz)
    columns = np.repeat(np.arange(count), np.diff(pattern.indptr))
    diagonal = pattern.indices == columns
    assert linear.balanced(pattern)
    for size in (0.0, 1e-25, 1e-17):
        entries = np.where(diagonal, size, data)
        own = LinearSolver(pattern, needed(name))
        b = rng.standard_normal(count)
        x = own.solve(entries, b)
        assert backward(pattern, entries, x, b) < 1e-13
        dense = np.linalg.solve(pattern.assembled(entries).toarray(), b)
        assert x == pytest.approx(dense, abs=1e-10 * abs(dense).max())


@pytest.mark.parametrize(("factor", "method"), [(1.1, "superlu"), (1 + 1e-9, "superlu-symmetric")])
def test_an_inaccurate_solution_is_not_taken(factor, method, monkeypatch, caplog):
    """Factors of another matrix: partial pivoting takes over; almost right ones are corrected."""
    pattern, data = grid(3)
    own = LinearSolver(pattern, sc.SolverSuperLU(symmetric=True))
    factorise = own._factors.factor
    monkeypatch.setattr(own._factors, "factor", lambda data: factorise(factor * data))
    b = np.ones(pattern.shape[0])
    with caplog.at_level(logging.INFO, logger="skfem_cosserat"):
        x = own.solve(data, b)
    assert abs(pattern.assembled(data) @ x - b).max() < 1e-11
    replaced = method == "superlu"
    assert own.method == method and own.factorisations == 1 + replaced
    assert ("partial pivoting" in caplog.text) == replaced


def test_choice():
    """By size, bandwidth and pattern; multipliers leave zeros on the diagonal."""
    small, _ = grid(1)
    assert LinearSolver(small).method == "dense"
    n = 200
    i = np.arange(n - 1)
    rows, cols = np.concatenate([i, i + 1, i]), np.concatenate([i, i, i + 1])
    chain = FrozenPattern(rows, cols, (n, n))
    assert LinearSolver(chain).method == "banded"
    assert LinearSolver(grid(4)[0]).method == "superlu-symmetric"
    bound = sc.Multipliers().bind(lattice(3), 0.5)
    assert not linear.balanced(bound.solver.pattern)
    assert bound.solver.method == "superlu"


def test_missing_packages(monkeypatch):
    """Forced: an error that names the extra. Broken, not forced: a warning, and the next one."""
    monkeypatch.setitem(sys.modules, "pypardiso", None)
    pattern, _ = grid(7)
    with pytest.raises(ImportError, match=r"skfem-cosserat\[solvers\]"):
        assert LinearSolver(pattern, sc.SolverPardiso()).method
    monkeypatch.setattr(linear, "find_spec", lambda name: name == "pypardiso" or None)
    with pytest.warns(PerformanceWarning, match="is not used"):
        assert LinearSolver(pattern).method == "superlu-symmetric"


@pytest.mark.one_quick
@solvers
@pytest.mark.parametrize("treatment", TREATMENTS)
def test_forced_in_runs(name, treatment):
    """Every back end gives the same motion, and the history says which it was."""
    system, pair = lattice(3), (sc.EnergyMomentum(), TREATMENTS[treatment])
    options = {"derive": False, "kernels": "numpy"}
    plain = sc.simulate(system, *pair, 1e-3, 5e-3, solver=sc.SolverDense(), **options)
    run = sc.simulate(system, *pair, 1e-3, 5e-3, solver=needed(name), **options)
    assert run["q"] == pytest.approx(plain["q"], abs=1e-11)
    assert run.meta["solver"].startswith(SOLVERS[name].name)


@pytest.mark.slow
@pytest.mark.plain
def test_forced_on_paths():
    first, second = (
        sc.static(lattice(3), solver=each, derive=False, watch=False)
        for each in (sc.SolverDense(), sc.SolverSuperLU(symmetric=True))
    )
    assert (first.meta["solver"], second.meta["solver"]) == ("dense", "superlu-symmetric")
    assert second["q"][-1] == pytest.approx(first["q"][-1], abs=1e-11)


def test_what_is_no_solver_is_refused():
    system = lattice(2)
    with pytest.raises(sc.InputError, match="argument solver: 'pardiso', expected a Solver"):
        sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, 1e-2, solver="pardiso")
    with pytest.raises(sc.InputError, match="argument solver"):
        sc.static(system, solver=sc.SolverDense)


# -- unknowns that only help -----------------------------------------------------------------------


@pytest.mark.parametrize("columns", [(), (2,)])
def test_unknowns_that_help_are_not_asked_for(columns):
    """Their equations have no right-hand sides; what is left is a Schur complement."""
    rng = np.random.default_rng(4)
    A, n = rng.standard_normal((9, 9)), 4
    i, j = np.indices(A.shape)
    solver = LinearSolver(FrozenPattern(i.ravel(), j.ravel(), A.shape), n=n)
    data = solver.pattern.data(A.ravel())
    left = A[5:, 5:] - A[5:, :5] @ np.linalg.inv(A[:5, :5]) @ A[:5, 5:]
    assert solver.n == n
    assert solver.full(data) == pytest.approx(left, rel=1e-11, abs=1e-11)
    rhs = rng.standard_normal((n, *columns))
    assert solver.solve(data, rhs) == pytest.approx(np.linalg.solve(left, rhs), rel=1e-10)
