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


def random_triplets(count, shape, rng):
    return rng.integers(0, shape[0], count), rng.integers(0, shape[1], count)


# ----------------------------------------------------------------------- frozen pattern
@pytest.mark.parametrize("shape", [(9, 9), (5, 13), (40, 3)])
@pytest.mark.parametrize("dtype", [float, complex])
def test_pattern_sums_what_coo_data_sums(shape, dtype):
    rng = np.random.default_rng(3)
    rows, cols = random_triplets(200, shape, rng)
    values = rng.standard_normal(200) + (1j * rng.standard_normal(200) if dtype is complex else 0)
    pattern = FrozenPattern(rows.reshape(8, 25), cols.reshape(8, 25), shape)
    matrix = pattern.matrix(values.reshape(8, 25))
    plain = COOData(np.array([rows, cols]), values, shape, None).tocsr()
    assert matrix.dtype == dtype
    assert np.abs(matrix.toarray() - plain.toarray()).max() < 1e-14
    assert isinstance(matrix, csc_matrix)
    assert pattern.nnz == len(set(zip(rows.tolist(), cols.tolist(), strict=True)))


def test_pattern_is_frozen_and_shared():
    pattern = FrozenPattern([0, 1, 1, 0], [0, 1, 1, 1], (3, 3))
    a, b = pattern.matrix([1.0, 2.0, -2.0, 0.0]), pattern.matrix([1.0, 1, 1, 1])
    assert a.nnz == b.nnz == 3  # explicit zeros are kept
    assert np.shares_memory(a.indices, b.indices)
    assert np.shares_memory(a.indptr, pattern.indptr)
    assert a.indices is not None
    assert a.has_sorted_indices
    assert pattern.slot.dtype == np.int64
    assert np.array_equal(pattern.data([1.0, 2, 3, 4]), [1, 4, 5])
    rebuilt = csc_matrix((pattern.data([1.0, 2, 3, 4]), pattern.indices, pattern.indptr), (3, 3))
    rebuilt.check_format(full_check=True)
    assert rebuilt[1, 1] == 5
    with pytest.raises(ValueError, match="read-only"):
        pattern.indices[0] = 2


def test_pattern_without_contributions():
    pattern = FrozenPattern([], [], (4, 2))
    assert pattern.nnz == 0
    assert pattern.matrix([]).shape == (4, 2)


def test_pattern_reproduces_the_assembly_of_a_basis():
    basis = DirectorBasis(network(), 2)
    dofs = basis.element_dof_rows
    rows, cols = np.broadcast_arrays(dofs[:, :, None], dofs[:, None, :])
    pattern = FrozenPattern(rows, cols, (basis.N, basis.N))
    local = np.random.default_rng(1).standard_normal(rows.shape)
    ours = pattern.matrix(local)
    theirs = ElementMatrix(lambda basis: local).assemble(basis)
    assert np.abs((ours - theirs).toarray()).max() < 1e-14


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: FrozenPattern([0, 5], [0, 0], (3, 3)), ["rows", "index 5", "0 .. 2"]),
        (lambda: FrozenPattern([0, 1], [0, -1], (3, 3)), ["cols", "index -1"]),
        (lambda: FrozenPattern([0, 1], [0], (3, 3)), ["cols", "(1,)", "(2,)"]),
        (lambda: FrozenPattern([0.0], [0], (3, 3)), ["rows", "float64"]),
        (lambda: FrozenPattern([0], [0], (3, 3)).matrix([1.0, 2.0]), ["2 numbers", "1 contrib"]),
        (lambda: FrozenPattern([0], [0], (3, 3)).assembled(np.ones(2)), ["data", "(2,)"]),
    ],
)
def test_pattern_errors(call, words):
    with pytest.raises(InputError) as caught:
        call()
    for word in words:
        assert word in str(caught.value)


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
    basis = DirectorBasis(network(), p)
    x, w = basis.scalar().quadrature
    full = skfem.Basis(basis.mesh, basis.elem, quadrature=(x, w))
    theirs = skfem.BilinearForm(lambda u, v, w: sum(u[i] * v[i] for i in range(12)))
    ours = ElementMatrix(mass_of)
    reference = theirs.assemble(full).toarray()
    for matrix in (ours.assemble(basis), skfem.asm(ours, basis)):
        assert matrix.format == "csr"
        assert np.abs(matrix.toarray() - reference).max() < 1e-15
    vector = skfem.LinearForm(lambda v, w: v[1]).assemble(full)
    assert np.abs(ElementLoad(load_of).assemble(basis) - vector).max() < 1e-15
    assert np.abs(skfem.asm(ElementLoad(load_of), basis) - vector).max() < 1e-15


def test_blocks_add_to_scikit_fem_forms_and_to_bodies():
    basis = DirectorBasis(network(), 1)
    x, w = basis.scalar().quadrature
    full = skfem.Basis(basis.mesh, basis.elem, quadrature=(x, w))
    theirs = skfem.BilinearForm(lambda u, v, w: sum(u[i] * v[i] for i in range(12)))
    body = COOData(np.array([[basis.N], [basis.N]]), np.array([3.0]), (basis.N + 1,) * 2, None)
    total = (ElementMatrix(mass_of).elemental(basis) + theirs.elemental(full) + body).tocsr()
    assert total.shape == (basis.N + 1, basis.N + 1)
    assert total[-1, -1] == 3.0
    twice = 2 * theirs.assemble(full).toarray()
    assert np.abs(total[:-1, :-1].toarray() - twice).max() < 1e-14


def test_elemental_returns_the_arrays_of_the_function():
    basis = DirectorBasis(network(), 2)
    local = np.random.default_rng(0).standard_normal((7, 36, 36))
    data = ElementMatrix(lambda basis: local).elemental(basis)
    assert np.array_equal(data.tolocal(), local)
    assert np.array_equal(data.fromlocal(2 * local).data, 2 * data.data)
    vector = ElementLoad(lambda basis: local[:, 0]).elemental(basis)
    assert np.array_equal(vector.tolocal(), local[:, 0])


def test_unsymmetric_matrices_have_rows_first():
    basis = DirectorBasis(MeshCurve.init_line((0, 0, 0), (1, 0, 0), 1))
    local = np.arange(576.0).reshape(1, 24, 24)
    assert np.array_equal(ElementMatrix(lambda basis: local).assemble(basis).toarray(), local[0])


def test_parameters_are_passed_on_untouched():
    basis = DirectorBasis(network(), 2)
    q = np.arange(basis.N, dtype=float)

    def gather(basis, q, factor, data):
        assert q.shape == (basis.N,)
        assert data == {"any": "thing"}
        return factor * q[basis.element_dof_rows]

    form = ElementLoad(gather)
    vector = form.assemble(basis, q=q, factor=2.0, data={"any": "thing"})
    again = skfem.asm(form, basis, q=q, factor=2.0, data={"any": "thing"})
    assert np.array_equal(vector, again)
    count = np.bincount(basis.element_dof_rows.ravel())
    assert np.array_equal(vector, 2 * q * count)


def test_use_as_a_decorator():
    @ElementLoad
    def ones(basis):
        return np.ones((basis.nelems, 12 * (basis.order + 1)))

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
    basis = skfem.Basis(skfem.MeshTri().refined(1), skfem.ElementTriP1())
    laplace = skfem.BilinearForm(lambda u, v, w: u.grad[0] * v.grad[0] + u.grad[1] * v.grad[1])
    local = laplace.elemental(basis).tolocal()
    ours = ElementMatrix(lambda basis: np.swapaxes(local, 1, 2)).assemble(basis)
    assert np.abs((ours - laplace.assemble(basis)).toarray()).max() < 1e-15


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
    errors = []
    for ne in (4, 8):
        mesh = MeshCurve.init_arc((2, 0, 0), (0, 1, 0), (-1, 0, 0), 2.0, 2.0, ne)
        basis = DirectorBasis(mesh, p)
        angle = np.arctan2(basis.nodes[:, 1], basis.nodes[:, 0])
        field = np.stack([np.sin(3 * angle), np.cos(angle)], axis=1)

        def phi(x):
            return np.arctan2(x[1], x[0]) if by == "position" else x / 2

        def exact(x, phi=phi):
            return np.stack([np.sin(3 * phi(x)), np.cos(phi(x))])

        def slope(x, phi=phi):
            return np.stack([1.5 * np.cos(3 * phi(x)), -0.5 * np.sin(phi(x))])

        errors.append(norms(basis, field, exact, slope, by=by))
    l2, h1 = (math.log2(a / b) for a, b in zip(*errors, strict=True))
    assert abs(l2 - (p + 1)) < 0.15
    assert abs(h1 - p) < 0.15


def test_error_norm_of_a_constant_offset():
    basis = DirectorBasis(network(), 2)
    l2, h1 = norms(basis, basis.nodes + np.array([0, 0, 2]), lambda x: x)
    assert l2 == pytest.approx(2 * math.sqrt(6), rel=1e-14)
    assert h1 is None
    q = np.zeros(basis.N)
    assert norms(basis, q, lambda x: np.ones((12, *x.shape[1:])))[0] == pytest.approx(
        math.sqrt(72), rel=1e-14
    )
    assert norms(basis, np.zeros(basis.n_nodes), lambda s: s, by="arc")[0] == pytest.approx(
        math.sqrt((1 + 8 + 27) / 3), rel=1e-14
    )


@pytest.mark.parametrize(
    ("field", "exact", "by", "words"),
    [
        (np.zeros(5), lambda x: x, "position", ["field", "5 rows"]),
        (None, lambda x: x[:2], "position", ["exact", "(2, 7, 6)"]),
        (None, lambda x: x, "time", ["'time'", "'position' or 'arc'"]),
    ],
)
def test_error_norm_errors(field, exact, by, words):
    basis = DirectorBasis(network(), 2)
    with pytest.raises(InputError) as caught:
        norms(basis, basis.nodes if field is None else field, exact, by=by)
    for word in words:
        assert word in str(caught.value)
