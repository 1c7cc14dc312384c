"""Products and inverses of blocks in vector registers against numpy's."""

import numpy as np
import pytest

numba = pytest.importorskip("numba")
blocks = pytest.importorskip("skfem_cosserat.compiled.blocks")
algebra = pytest.importorskip("skfem_cosserat.compiled.simd")
EPS = np.finfo(float).eps


def called(function):
    """For Python to call."""
    return numba.njit(lambda *arguments: function(*arguments))  # noqa: PLW0108


def random_blocks(seed, count):
    return np.random.default_rng(seed).standard_normal((count, 6, 6))


@pytest.fixture(scope="module")
def inverses():
    """Transposed inverse without and with exchange of rows; what each says of the block."""
    plain, exchanging = called(algebra.triangles), called(blocks.triangles_exchanging)

    def both(M):
        A, lower, upper = np.array([np.zeros((6, 6)), M]), *np.zeros((2, 2, 6, 6))
        stable = plain(A, 1, lower, upper, 0)
        sign = exchanging(A, 1, np.zeros((1, 6, 6)), lower, upper, 1)
        assert np.array_equal(A[1], M, equal_nan=True)  # left as it is
        with np.errstate(invalid="ignore"):  # where a pivot vanishes
            return stable, sign, *(lower @ upper).transpose(0, 2, 1)

    return both


PRODUCTS = {
    "put_times": lambda P, Q, R: P @ Q,
    "put_turned": lambda P, Q, R: P @ Q.T,
    "put_crossed": lambda P, Q, R: P.T @ Q,
    "add_times": lambda P, Q, R: R + P @ Q,
    "add_crossed": lambda P, Q, R: R + P.T @ Q,
    "subtract_crossed": lambda P, Q, R: R - P.T @ Q,
}


@pytest.mark.one_quick
@pytest.mark.parametrize("name", PRODUCTS)
def test_products(name):
    product, expected = called(getattr(algebra, name)), PRODUCTS[name]
    for place in range(3):  # in the place of a factor as well
        X = random_blocks(0, 3)
        wanted = expected(X[0], X[1], X[place])
        others = [k for k in range(3) if k != place]
        kept = X[others]
        product(X, 0, X, 1, X, place)
        np.testing.assert_allclose(X[place], wanted, rtol=0, atol=200 * EPS)
        assert np.array_equal(X[others], kept)


@pytest.mark.slow
def test_positive_definite_blocks_take_no_exchange(inverses):
    """With small skew parts, in any units of rows and columns."""
    rng = np.random.default_rng(1)
    for M in random_blocks(2, 50):
        M = M @ M.T + 0.02 * rng.standard_normal((6, 6)) + 0.1 * np.eye(6)
        units = 10.0 ** rng.uniform(-5, 5, 6)
        stable, sign, plain, _ = inverses(units[:, None] * M * units)
        assert stable and sign == 1
        wanted = np.linalg.inv(M)
        allowed = 10 * EPS * np.linalg.cond(M) * abs(wanted).max()
        np.testing.assert_allclose(units[:, None] * plain * units, wanted, rtol=0, atol=allowed)


@pytest.mark.slow
def test_what_is_stable_is_accurate_and_all_else_takes_exchanges(inverses):
    stables = 0
    for M in random_blocks(3, 500):
        stable, sign, plain, exchanged = inverses(M)
        wanted = np.linalg.inv(M)
        allowed = 10 * EPS * np.linalg.cond(M) * abs(wanted).max()
        np.testing.assert_allclose(exchanged, wanted, rtol=0, atol=allowed)
        assert sign == np.sign(np.linalg.det(M))
        stables += stable
        if stable:
            np.testing.assert_allclose(plain, wanted, rtol=0, atol=30 * allowed)
    assert 50 < stables < 250


@pytest.mark.slow
def test_what_nearly_singular_pivots_pass_on():
    """Of a pivot A beside B = A X it is B^T A^-1 B = X^T A X, which nothing of 1/A is left in.

    Triangular factors U^-1 and L^-1 keep all its digits, as (B^T U^-1)(L^-1 B); the inverse loses
    them by the condition of A, here 1e11.
    """
    plain, exchanging = called(algebra.triangles), called(blocks.triangles_exchanging)
    lost = 0.0
    for turn, X in zip(random_blocks(4, 20), random_blocks(5, 20), strict=True):
        root = np.linalg.qr(turn)[0] * 10.0 ** -np.linspace(0, 5.5, 6)
        A, B = np.array([root @ root.T]), root @ (root.T @ X)
        lower, upper = np.zeros((2, 2, 6, 6))
        assert plain(A, 0, lower, upper, 0)
        assert exchanging(A, 0, np.zeros((1, 6, 6)), lower, upper, 1)
        wanted = X.T @ A[0] @ X
        for P, Q in zip(lower, upper, strict=True):
            np.testing.assert_allclose((B.T @ Q.T) @ (P.T @ B), wanted, rtol=0, atol=1e-12)
            lost = max(lost, abs(B.T @ (Q.T @ P.T) @ B - wanted).max())
    assert lost > 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    ("block", "sign"),
    [
        (np.fliplr(np.eye(6)), -1),
        (np.diag([1.0, 1, 1, 1, 1, 0]), 0),
        (np.diag([0.0, 1, 1, 1, 1, 1]), 0),
        (np.diag([1.0, 1, np.nan, 1, 1, 1]), 0),
        (np.zeros((6, 6)), 0),
    ],
)
def test_vanishing_pivots(inverses, block, sign):
    stable, found, _, exchanged = inverses(block)
    assert not stable and found == sign
    if sign:
        assert np.array_equal(exchanged, block)
