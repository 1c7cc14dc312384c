import math

import numpy as np
import pytest
import skfem

from skfem_cosserat import InputError
from skfem_cosserat.element import (
    ElementDirector,
    ElementLineLobatto,
    lobatto_nodes,
    shape_derivatives,
    shape_functions,
)

ORDERS = (1, 2, 3, 4)
XI = np.array([0.0, 0.137, 0.5, 0.81, 1.0])


@pytest.mark.parametrize("p", ORDERS)
def test_nodes_are_the_gauss_lobatto_points(p):
    """Interior nodes are the roots of the derivative of the Legendre polynomial."""
    roots = np.polynomial.legendre.Legendre.basis(p).deriv().roots() if p > 1 else []
    expected = np.concatenate([[0.0], np.sort(0.5 * (np.real(roots) + 1)), [1.0]])
    assert np.abs(lobatto_nodes(p) - expected).max() < 1e-14


@pytest.mark.parametrize("p", ORDERS)
def test_shape_functions_are_nodal(p):
    assert np.array_equal(shape_functions(p, lobatto_nodes(p)), np.eye(p + 1))


@pytest.mark.parametrize("p", ORDERS)
def test_completeness(p):
    """Powers up to the order of the element, and no more; the zeroth: the sum is 1 everywhere."""
    N, dN, nodes = shape_functions(p, XI), shape_derivatives(p, XI), lobatto_nodes(p)
    assert np.abs(dN.sum(axis=0)).max() < 1e-13
    for k in range(p + 1):
        assert np.abs(nodes**k @ N - XI**k).max() < 1e-14
    for k in range(1, p + 1):
        assert np.abs(nodes**k @ dN - k * XI ** (k - 1)).max() < 1e-13
    assert np.abs(nodes ** (p + 1) @ N - XI ** (p + 1)).max() > 1e-4


@pytest.mark.parametrize("p", ORDERS)
def test_derivatives_by_the_complex_step(p):
    step = shape_functions(p, XI + 1e-30j).imag / 1e-30
    assert np.abs(step - shape_derivatives(p, XI)).max() < 1e-14 * max(1, p**3)
    assert shape_derivatives(p, XI + 1e-30j).dtype == complex


@pytest.mark.parametrize("p", ORDERS)
def test_element_in_scikit_fem(p):
    element = ElementLineLobatto(p)
    values = [element.lbasis(element.doflocs.T, i) for i in range(p + 1)]
    assert np.array_equal([value for value, _ in values], np.eye(p + 1))
    assert all(slope.shape == (1, p + 1) for _, slope in values)
    assert element.doflocs[:2, 0].tolist() == [0, 1]
    with pytest.raises(ValueError, match="Index"):
        element.lbasis(element.doflocs.T, p + 1)


@pytest.mark.parametrize("p", ORDERS)
def test_l2_and_h1_convergence_of_a_plain_line_problem(p):
    """-u'' = f on a 1-D scikit-fem mesh: orders p + 1 and p."""
    errors = []
    for refine in (2, 3):
        mesh = skfem.MeshLine().refined(refine)
        basis = skfem.Basis(mesh, ElementLineLobatto(p), intorder=2 * p + 8)
        A = skfem.BilinearForm(lambda u, v, w: u.grad[0] * v.grad[0]).assemble(basis)
        b = skfem.LinearForm(lambda v, w: np.pi**2 * np.sin(np.pi * w.x[0]) * v).assemble(basis)
        u = basis.interpolate(skfem.solve(*skfem.condense(A, b, D=basis.get_dofs())))
        x = np.pi * basis.global_coordinates()[0]
        misses = np.asarray(u) - np.sin(x), u.grad[0] - np.pi * np.cos(x)
        errors.append([math.sqrt((miss**2 * basis.dx).sum()) for miss in misses])
    l2, h1 = np.log2(np.divide(*errors))
    assert abs(l2 - (p + 1)) < 0.1
    assert abs(h1 - p) < 0.1


@pytest.mark.parametrize("p", [0, 5, 1.5, True, "2", None])
def test_impossible_orders(p):
    for make in (lobatto_nodes, ElementLineLobatto, ElementDirector):
        with pytest.raises(InputError, match="argument order: got") as caught:
            make(p)
        assert repr(p) in str(caught.value)


def test_director_element_names_its_components():
    names = ElementDirector(3).dofnames
    assert len(names) == 36
    assert names[:12] == names[12:24] == names[24:]
    assert names[0] == "phi_1"
    assert names[11] == "d3_3"
