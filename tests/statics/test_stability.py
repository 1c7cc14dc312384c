"""How unstable motions are counted: signs of pivots, and where eigenproblems are solved."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_kernels import needs_numba
from helpers_scenes import four_bar, full_section
from scipy.sparse import csr_matrix
from test_statics import column, truss

import skfem_cosserat as sc
from skfem_cosserat.checks.result import recorded_amplitudes
from skfem_cosserat.diagnostics.stacked import reduced_tangent
from skfem_cosserat.linear import negative_pivots
from skfem_cosserat.statics import critical

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
    model, point = truss(0.3)
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
    section = sc.Section([1e6, 1e6, 1e6, 1.0, 1.3, 1.0], mass=1.0, inertia=(1e-3, 1e-3))
    model, mesh = sc.Model(), sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 6, name="rod")
    rod = model.add("rod", sc.Beam(mesh, section, order=2, theory=sc.TheoryInextensible()))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("push", sc.LoadForce(rod.node("rod.end"), (-1.0, 0, 0)))
    return model, sc.LoadControl(8.0, steps=6)


def closed_loop():
    """A four-bar linkage whose springs lose to its load."""
    model = four_bar()
    system = model.freeze()
    joint = system.joints[0]
    model.add("spring", sc.JointSpringDamper(joint, stiffness=1.0))
    model.add("weight", sc.LoadGravity((0, 0, 20.0)))
    return model, sc.LoadControl(1.0, steps=6)


def redundant():
    """A beam held at both ends by the same joints twice over."""
    model, mesh = sc.Model(), sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    rod = model.add("rod", sc.Beam(mesh, full_section(), order=2))
    for k in range(2):
        for end, x in (("start", 0.0), ("end", 1.0)):
            place = rod.node(f"rod.{end}")
            model.add(f"{end} {k}", sc.JointFixed(sc.ground((x, 0, 0)), place))
    model.add("weight", sc.LoadGravity((0, 0, -10.0)))
    return model, sc.LoadControl(1.0, steps=2)


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
ways = pytest.mark.parametrize(
    ("treatment", "kernels"),
    [pytest.param(*way, marks=[needs_numba] * (way[1] == "numba")) for way in WAYS.values()],
    ids=WAYS,
)


@pytest.mark.slow
@ways
@pytest.mark.parametrize("scene", SCENES)
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


@pytest.mark.slow
@ways
@pytest.mark.parametrize("scene", ["buckling", "bent", "redundant"])
def test_eigenproblems_are_for_critical_points_alone(monkeypatch, scene, treatment, kernels):
    """Stable points take a factorisation of the stiffness; mostly no other matrix."""
    calls = {"eigen": 0, "tangent": 0}

    def counting(name, function):
        def counted(*args, **kwargs):
            calls[name] += 1
            return function(*args, **kwargs)

        return counted

    for owner, name, key in (
        (critical.Stability, "_eigen", "eigen"),
        (critical, "reduced_tangent", "tangent"),
    ):
        monkeypatch.setattr(owner, name, counting(key, getattr(owner, name)))
    if scene == "buckling":
        path = sc.static(column()[0], treatment, sc.LoadControl(8.0, steps=6), kernels=kernels)
        assert len(path.meta["critical"]) == 2
        assert calls["eigen"] > 0
        return
    if scene == "bent":
        model, tip = column(EA=1e4)
        model.add("across", sc.LoadForce(tip, (0, 3.0, 2.0)))
        control = sc.LoadControl(1.0)
    else:
        model, control = redundant()
    path = sc.static(model, treatment, control, kernels=kernels)
    assert not path["unstable"].any()
    assert calls["eigen"] == 0
    assert (calls["tangent"] == 0) == (kernels == "numba")


@pytest.mark.parametrize("kernels", ["numpy", pytest.param("numba", marks=needs_numba)])
def test_deep_trees_are_looked_at_too(kernels):
    """Their matrix in plain numpy has unknowns that only help: eigenvalues tell the count."""
    model, place, force = sc.Model(), sc.ground((0, 0, 0)), (-4.0, 0.0, 1e-3)
    for k in range(40):
        body = model.add(f"bar {k}", sc.RigidBody(1.0, (1.0, 1.0, 1.0), position=(k + 0.5, 0, 0)))
        joint = sc.JointRevolute(place, body.at((k, 0, 0)), axis=(0, 1, 0))
        model.add(f"hinge {k}", joint)
        model.add(f"spring {k}", sc.JointSpringDamper(joint, stiffness=1e4))
        place = body.at((k + 1, 0, 0))
    model.add("push", sc.LoadForce(place, force))
    path = sc.static(model, kernels=kernels)
    assert path.status == "completed"
    assert path["unstable"].max() == 0
