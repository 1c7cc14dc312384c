"""How unstable motions are counted: signs of pivots, and where eigenproblems are solved."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_kernels import needs_numba
from helpers_scenes import four_bar
from scipy.sparse import csr_matrix
from test_path_following import bars
from test_statics import cantilever, column, stiff, truss

import skfem_cosserat as sc
from skfem_cosserat.checks.result import recorded_amplitudes
from skfem_cosserat.diagnostics.stacked import reduced_tangent
from skfem_cosserat.linear import negative_pivots

# -- pivots of single matrices ---------------------------------------------------------------------

#: size, and how far from the diagonal there are entries: full, a band, and a wide one
SHAPES = {"full": (12, 12), "narrow": (80, 6), "wide": (240, 150)}


def banded(shape: str, negative: int, skew: float = 0.0):
    """A matrix with so many negative eigenvalues, but for its skew part."""
    n, width = SHAPES[shape]
    rng = np.random.default_rng(3)
    i, j = np.indices((n, n))
    A = np.where(abs(i - j) < width, rng.standard_normal((n, n)), 0.0)
    A = A + A.T
    values = np.linalg.eigvalsh(A)
    # halfway between two of its eigenvalues
    A -= np.eye(n) * (values[negative] + (values[negative - 1] if negative else values[0] - 2)) / 2
    return A + skew * np.triu(A, 1)


@pytest.mark.one_quick
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("negative", [0, 1, 2, 7])
def test_pivots_have_the_signs_of_eigenvalues(shape, negative):
    A = banded(shape, negative)
    assert (np.linalg.eigvalsh(A) < 0).sum() == negative
    found, smallest = negative_pivots(csr_matrix(A))
    assert found == negative
    if not negative:  # the last unknown of any order has its share of the smallest eigenvalue
        assert np.linalg.eigvalsh(A)[0] <= smallest <= A.diagonal().max()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("negative", [0, 1, 2])
def test_what_is_not_symmetric_has_the_sign_of_its_determinant(shape, negative):
    A = banded(shape, negative, skew=0.1)
    found, _ = negative_pivots(csr_matrix(A))
    assert found % 2 == (np.linalg.slogdet(A)[0] < 0)


def test_a_singular_matrix_has_no_pivot_to_rely_on():
    A = banded("narrow", 0)
    A[:, 0] = A[0] = 0
    assert negative_pivots(csr_matrix(A))[1] <= 1e-12 * abs(A).max()


# -- counts along paths ----------------------------------------------------------------------------


def snapping():
    model, point = truss()
    return model, sc.DisplacementControl(point.place(), (0, 0, -1), until=0.7)


def giving_way():
    """Sideways first, then down."""
    model, point = truss(2.2, (100.0, 130.0))
    return model, sc.DisplacementControl(point.place(), (0, 0, -1), until=1.9, longest=0.05)


def buckling():
    return column()[0], sc.LoadControl(8.0, steps=6)


def buckling_in_a_plane():
    """Only in it: one of the two motions is there."""
    return column()[0].freeze(planar=sc.Planar(normal=(0, 1, 0))), sc.LoadControl(8.0, steps=6)


def held_strains():
    theory = {"order": 2, "theory": sc.TheoryInextensible()}
    model, tip = cantilever(stiff(1e6, (1.0, 1.3), 1.0), elements=6, **theory)
    model.add("push", sc.LoadForce(tip, (-1.0, 0, 0)))
    return model, sc.LoadControl(8.0, steps=6)


def closed_loop():
    """A four-bar linkage whose springs lose to its load."""
    model = four_bar()
    model.add("spring", sc.JointSpringDamper(model["pin 0"], stiffness=1.0))
    model.add("weight", sc.LoadGravity((0, 0, 20.0)))
    return model, sc.LoadControl(1.0, steps=6)


SCENES = {
    f.__name__: f
    for f in (snapping, giving_way, buckling, buckling_in_a_plane, held_strains, closed_loop)
}
WAYS = {
    "null space": (sc.NullSpace(), "numpy"),
    "compiled": (sc.NullSpace(), "numba"),
    "multipliers": (sc.Multipliers(), "numpy"),
    "compiled multipliers": (sc.Multipliers(), "numba"),
    "full multipliers": (sc.Multipliers(full=True), "numpy"),
}
#: one scene in all ways, the others in some
CASES = [
    pytest.param(scene, *WAYS[way], marks=[needs_numba] * ("compiled" in way), id=f"{scene}-{way}")
    for i, scene in enumerate(SCENES)
    for j, way in enumerate(WAYS)
    if scene == "buckling" or (i + j) % 3 == 0
]


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "treatment", "kernels"), CASES)
def test_counts_are_those_of_eigenvalues(scene, treatment, kernels):
    """Of the stiffness along the constraints, whatever they were counted from."""
    model, control = SCENES[scene]()
    path = sc.static(model, treatment, control, kernels=kernels)
    system = model if isinstance(model, sc.System) else model.freeze()
    looked = 0
    for k in np.flatnonzero(path["critical"] == 0):
        y = system.extend(path["q"][k], float(path["load_factor"][k]))
        K = reduced_tangent(system, y, recorded_amplitudes(path, int(k))).K.toarray()
        values = np.linalg.eigvalsh(0.5 * (K + K.T))
        if abs(values).min() > 1e-9 * abs(values).max():
            assert path["unstable"][k] == (values < 0).sum()
            looked += 1
    assert looked >= 3
    if scene != "closed_loop":
        assert path["unstable"].max() > 0


def test_deep_trees_are_looked_at_too(kernels):
    """Their matrix in plain numpy has unknowns that only help: eigenvalues tell the count."""
    path = sc.static(bars(40 * [1e4]), kernels=kernels)
    assert path.status == "completed"
    assert path["unstable"].max() == 0
