import math

import numpy as np
import pytest
import skfem
from scipy.sparse import csc_matrix
from skfem.assembly.form.coo_data import COOData
from test_basis import network

from skfem_cosserat import DirectorBasis, InputError, MeshCurve
from skfem_cosserat.basis import ElementForm, ElementLoad, ElementMatrix
from skfem_cosserat.basis import error_norms as norms
from skfem_cosserat.pattern import FrozenPattern


# ----------------------------------------------------------------------- frozen pattern
@pytest.mark.parametrize("shape", [(9, 9), (5, 13), (40, 3)])
@pytest.mark.parametrize("dtype", [float, complex])
def test_pattern_sums_what_coo_data_sums(shape, dtype):
    rng = np.random.default_rng(3)
    rows, cols = (rng.integers(0, size, 200) for size in shape)
    values = rng.standard_normal(200).astype(dtype) * (1j if dtype is complex else 1)
    pattern = FrozenPattern(rows.reshape(8, 25), cols.reshape(8, 25), shape)
    matrix = pattern.matrix(values.reshape(8, 25))
    plain = COOData(np.array([rows, cols]), values, shape, None).tocsr()
    assert matrix.dtype == dtype
    assert np.abs(matrix.toarray() - plain.toarray()).max() < 1e-14
    assert isinstance(matrix, csc_matrix)
    assert pattern.nnz == len(set(zip(rows.tolist(), cols.tolist(), strict=True)))


def test_pattern_is_frozen_and_shared():
    pattern = FrozenPattern([0, 1, 1, 0], [0, 1, 1, 1], (3, 3))
    a, b = pattern.matrix([1.0, 2.0, -2.0, 0.0]), pattern.matrix([1.0, 2, 3, 4])
    assert a.nnz == b.nnz == 3  # explicit zeros are kept
    assert np.shares_memory(a.indices, b.indices)
    b.check_format(full_check=True)
    assert a.has_sorted_indices and b[1, 1] == 5
    with pytest.raises(ValueError, match="read-only"):
        pattern.indices[0] = 2
    assert FrozenPattern([], [], (4, 2)).matrix([]).shape == (4, 2)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: FrozenPattern([0, 5], [0, 0], (3, 3)), "rows.*index 5.*0 .. 2"),
        (lambda: FrozenPattern([0, 1], [0, -1], (3, 3)), "cols.*index -1"),
        (lambda: FrozenPattern([0, 1], [0], (3, 3)), r"cols.*\(1,\).*\(2,\)"),
        (lambda: FrozenPattern([0.0], [0], (3, 3)), "rows.*float64"),
        (lambda: FrozenPattern([0], [0], (3, 3)).matrix([1.0, 2.0]), "2 numbers.*1 contrib"),
        (lambda: FrozenPattern([0], [0], (3, 3)).assembled(np.ones(2)), r"data.*\(2,\)"),
    ],
)
def test_pattern_errors(call, words):
    with pytest.raises(InputError, match=words):
        call()


# ----------------------------------------------------------------------- forms
def mass_of(basis):
    """Consistent mass of phi and directors alike, in the documented local order."""
    shape = basis.elemental_mass()
    ne, n = shape.shape[:2]
    return np.einsum("eab,cd->eacbd", shape, np.eye(12)).reshape(ne, 12 * n, 12 * n)


def load_of(basis):
    """Load of 1 N/m along phi_2."""
    unit = np.eye(12)[1]
    return (basis.elemental_load()[:, :, None] * unit).reshape(len(basis.lengths), -1)


@pytest.mark.one_quick
@pytest.mark.parametrize("p", [1, 2, 3, 4])
def test_element_forms_agree_with_scikit_fem(p):
    basis, ours = DirectorBasis(network(), p), ElementMatrix(mass_of)
    full = skfem.Basis(basis.mesh, basis.elem, quadrature=basis.scalar().quadrature)
    theirs = skfem.BilinearForm(lambda u, v, w: sum(u[i] * v[i] for i in range(12)))
    reference = theirs.assemble(full).toarray()
    for matrix in (ours.assemble(basis), skfem.asm(ours, basis)):
        assert matrix.format == "csr"
        assert np.abs(matrix.toarray() - reference).max() < 1e-15
    vector = skfem.LinearForm(lambda v, w: v[1]).assemble(full)
    assert np.abs(ElementLoad(load_of).assemble(basis) - vector).max() < 1e-15
    assert np.abs(skfem.asm(ElementLoad(load_of), basis) - vector).max() < 1e-15


def test_parameters_are_passed_on_untouched():
    basis = DirectorBasis(network(), 2)
    q = np.arange(basis.N, dtype=float)

    def gather(basis, q, factor, data):
        assert data == {"any": "thing"}
        return factor * q[basis.element_dof_rows]

    form, given = ElementLoad(gather), {"q": q, "factor": 2.0, "data": {"any": "thing"}}
    vector = form.assemble(basis, **given)
    assert np.array_equal(vector, skfem.asm(form, basis, **given))
    assert np.array_equal(vector, 2 * q * np.bincount(basis.element_dof_rows.ravel()))


def test_use_as_a_decorator():
    @ElementLoad
    def ones(basis):
        return np.ones((basis.nelems, 24))

    @ElementMatrix()
    def zeros(basis):
        return np.zeros((basis.nelems, 24, 24))

    basis = DirectorBasis(network())
    assert ones.form.__name__ == "ones"
    assert ones.assemble(basis).sum() == 7 * 24
    assert zeros.assemble(basis).nnz == 0


def test_complex_element_arrays():
    basis = DirectorBasis(network())
    matrix = ElementMatrix(lambda basis: mass_of(basis) * (1 + 1e-30j)).assemble(basis)
    assert np.abs(matrix.toarray().imag / 1e-30 - matrix.toarray().real).max() < 1e-14


def test_forms_on_any_scikit_fem_basis():
    """Element matrices have rows first, those of scikit-fem have the trial function first."""
    basis = skfem.Basis(skfem.MeshTri().refined(1), skfem.ElementTriP1())
    slope = skfem.BilinearForm(lambda u, v, w: u.grad[0] * v)
    local = slope.elemental(basis).tolocal()
    ours = ElementMatrix(lambda basis: np.swapaxes(local, 1, 2)).assemble(basis)
    assert np.abs((ours - slope.assemble(basis)).toarray()).max() < 1e-15


def test_wrong_shapes_are_named():
    basis = DirectorBasis(network())

    def careless(basis):
        return np.zeros((7, 24))

    with pytest.raises(InputError, match=r"form 'careless': .*\(7, 24\), expected \(7, 24, 24\)"):
        ElementMatrix(careless).assemble(basis)
    with pytest.raises(InputError, match=r"expected \(7,\)"):
        ElementForm(careless).assemble(basis)


# ----------------------------------------------------------------------- error norms
@pytest.mark.one_quick
@pytest.mark.parametrize("p", [1, 2, 3, 4])
@pytest.mark.parametrize("by", ["position", "arc"])
def test_error_norms_converge_at_the_order_of_interpolation(p, by):
    def angle(x):
        return np.arctan2(x[1], x[0]) if by == "position" else x / 2

    def exact(x):
        return np.stack([np.sin(3 * angle(x)), np.cos(angle(x))])

    def slope(x):
        return np.stack([1.5 * np.cos(3 * angle(x)), -0.5 * np.sin(angle(x))])

    errors = []
    for ne in (4, 8):
        mesh = MeshCurve.init_arc((2, 0, 0), (0, 1, 0), (-1, 0, 0), 2.0, 2.0, ne)
        basis = DirectorBasis(mesh, p)
        at_nodes = np.arctan2(basis.nodes[:, 1], basis.nodes[:, 0])
        field = np.stack([np.sin(3 * at_nodes), np.cos(at_nodes)], axis=1)
        errors.append(norms(basis, field, exact, slope, by=by))
    l2, h1 = np.log2(np.divide(*errors))
    assert abs(l2 - (p + 1)) < 0.15
    assert abs(h1 - p) < 0.15


def test_error_norm_of_a_constant_offset():
    basis = DirectorBasis(network(), 2)
    l2, h1 = norms(basis, basis.nodes + np.array([0, 0, 2]), lambda x: x)
    assert l2 == pytest.approx(2 * math.sqrt(6), rel=1e-14)
    assert h1 is None
    l2, _ = norms(basis, np.zeros(basis.N), lambda x: np.ones((12, *x.shape[1:])))
    assert l2 == pytest.approx(math.sqrt(72), rel=1e-14)
    l2, _ = norms(basis, np.zeros(basis.n_nodes), lambda s: s, by="arc")
    assert l2 == pytest.approx(math.sqrt((1 + 8 + 27) / 3), rel=1e-14)


@pytest.mark.parametrize(
    ("field", "exact", "by", "words"),
    [
        (np.zeros(5), lambda x: x, "position", "field.*5 rows"),
        (None, lambda x: x[:2], "position", r"exact.*\(2, 7, 6\)"),
        (None, lambda x: x, "time", "'time'.*'position' or 'arc'"),
    ],
)
def test_error_norm_errors(field, exact, by, words):
    basis = DirectorBasis(network(), 2)
    with pytest.raises(InputError, match=words):
        norms(basis, basis.nodes if field is None else field, exact, by=by)
