"""Each trap of scikit-fem and meshio we work around: a failure here means it was mended."""

import logging

import meshio
import numpy as np
import pytest
import skfem
from scipy.sparse import csr_array
from skfem import Basis, ElementLineP1, ElementVector, MeshLine1
from skfem.assembly.form.coo_data import COOData

from skfem_cosserat import DirectorBasis, MeshCurve, read_mesh

SPACE = np.array([[0.0, 1, 2, 2], [0, 0, 0, 0], [0, 0, 0, 1.0]])
CHAIN = np.array([[0, 1, 2], [1, 2, 3]])
TEE = np.array([[0, 1, 1], [1, 2, 3]])


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_three_rows_with_the_default_mapping_are_garbage_with_a_log_line_only(caplog):
    mesh = MeshLine1(SPACE, CHAIN)
    with caplog.at_level(logging.WARNING):
        basis = Basis(mesh, ElementLineP1(), intorder=1)
    x = np.asarray(basis.global_coordinates())
    assert x.shape[0] != 3 or not np.allclose(x.mean(axis=2), SPACE[:, CHAIN].mean(axis=1))
    length = skfem.Functional(lambda w: 1.0 + 0 * w.x[0]).assemble(basis)
    assert length != pytest.approx(3.0)
    ours = Basis(MeshCurve(SPACE, CHAIN), ElementLineP1())
    assert skfem.Functional(lambda w: 1.0 + 0 * w.x[0]).assemble(ours) == pytest.approx(3.0)


def test_refined_tags_subdomains_wrongly():
    mesh = MeshLine1(np.array([[0.0, 1, 2, 3]]), CHAIN)
    fine = mesh.with_subdomains({"first": np.array([0])}).refined(1)
    middle = fine.p[0, fine.t[:, fine.subdomains["first"]]].mean(axis=0)
    assert not (middle < 1).all()
    ours = MeshCurve(SPACE, CHAIN).with_beams({"first": [0]}).refined(1)
    assert (ours.p[0, ours.t[:, ours.elements_of("first")]].mean(axis=0) < 1).all()


def test_with_defaults_raises_on_lines():
    with pytest.raises((AttributeError, NotImplementedError, TypeError, ValueError, IndexError)):
        MeshLine1().with_defaults()
    assert "left" in MeshCurve(SPACE, CHAIN).with_defaults().boundaries


def test_f2t_drops_the_third_element_at_a_branch():
    mesh = MeshCurve(SPACE, TEE)
    assert mesh.f2t.shape[0] == 2
    assert len(mesh.elements_at(1)) == 3


def test_a_mesh_subclass_cannot_be_saved(tmp_path):
    class MeshOwn(MeshLine1):
        pass

    with pytest.raises(KeyError):
        MeshOwn().save(tmp_path / "a.vtu")
    MeshCurve(SPACE, CHAIN).save(tmp_path / "a.vtu")


def test_loading_a_line_file_keeps_x_only(tmp_path):
    MeshCurve(SPACE, CHAIN).save(tmp_path / "a.vtu")
    assert skfem.Mesh.load(tmp_path / "a.vtu").p.shape[0] == 1
    assert np.array_equal(MeshCurve.load(tmp_path / "a.vtu").p, SPACE)


def test_refinterp_fails_for_twelve_components():
    basis = Basis(MeshLine1().refined(1), ElementVector(ElementLineP1(), 12))
    with pytest.raises((ValueError, IndexError, NotImplementedError)):
        basis.refinterp(np.zeros(basis.N))


def test_orders_0_and_1_give_two_points():
    for order in (0, 1):
        basis = Basis(MeshLine1(), ElementLineP1(), intorder=order)
        assert len(basis.W) == 2
    assert len(DirectorBasis(MeshCurve(SPACE, CHAIN)).weights) == 1


def test_coo_data_eliminates_zeros():
    data = COOData(np.array([[0, 1], [0, 1]]), np.array([0.0, 1.0]), (2, 2), None)
    assert data.tocsr().nnz == 1


def test_elemental_of_a_bilinear_form_has_the_trial_function_first():
    basis = Basis(MeshLine1(), ElementLineP1())
    form = skfem.BilinearForm(lambda u, v, w: u.grad[0] * v * w.x[0])
    local = form.elemental(basis).tolocal()[0]
    assert np.array_equal(local.T, form.assemble(basis).toarray())
    assert not np.array_equal(local, local.T)


def test_the_hierarchic_element_has_no_nodes():
    assert np.isnan(skfem.ElementLinePp(3).doflocs[2:]).all()


def test_sparse_arrays_are_refused_as_second_matrix_of_an_eigenproblem():
    """As the first matrix with a vector they work; pairs need ``csr_matrix``."""
    basis = Basis(MeshLine1().refined(2), ElementLineP1())
    form = skfem.BilinearForm(lambda u, v, w: u.grad[0] * v.grad[0])
    matrix = csr_array(form.assemble(basis))
    skfem.condense(matrix, np.ones(basis.N), D=basis.get_dofs())
    with pytest.raises(Exception, match="second arg not supported"):
        skfem.condense(matrix, matrix, D=basis.get_dofs())


def test_join_rounds_to_eight_decimals():
    x = 1 / 3
    mesh = MeshLine1(np.array([[0.0, x]]), np.array([[0], [1]]))
    other = MeshLine1(np.array([[x, 1.0]]), np.array([[0], [1]]))
    assert x not in (mesh + other).p
    ours = MeshCurve.init_line((0, 0, 0), (x, 0, 0), 1, "a")
    assert x in (ours + MeshCurve.init_line((x, 0, 0), (1, 0, 0), 1, "b")).p


# ----------------------------------------------------------------------- meshio
def test_meshio_leaves_the_interpreter(tmp_path, capsys):
    (tmp_path / "a.vtu").write_text('<VTKFile type="ImageData"></VTKFile>')
    with pytest.raises(SystemExit):
        meshio.read(tmp_path / "a.vtu")
    assert "read" in capsys.readouterr().err


def test_meshio_points_of_one_column_cannot_be_read_back(tmp_path):
    points = np.array([[0.0], [1.0]])
    meshio.Mesh(points, [("line", [[0, 1]])]).write(tmp_path / "a.vtk")
    with pytest.raises((SystemExit, ValueError, meshio.ReadError)):
        meshio.read(tmp_path / "a.vtk")


def _gmsh(tmp_path, version, mesh):
    path = tmp_path / "a.msh"
    mesh.save(path, file_format={"4.1": "gmsh", "2.2": "gmsh22"}[version])
    return path


def test_meshio_cannot_read_41_files_with_some_lines_in_no_group(tmp_path):
    mesh = MeshCurve(SPACE, CHAIN).with_beams({"first": [0]})
    path = _gmsh(tmp_path, "4.1", mesh)
    with pytest.raises(ValueError, match="Incompatible cell data"):
        meshio.read(path)
    assert read_mesh(path).unnamed_elements().tolist() == [1, 2]


@pytest.mark.parametrize("version", ["4.1", "2.2"])
def test_meshio_loses_a_name_shared_by_a_point_and_a_line_group(tmp_path, version):
    mesh = MeshCurve(SPACE, CHAIN).with_beams({"tip": [0, 1, 2]}).with_nodes({"tip": 3})
    path = _gmsh(tmp_path, version, mesh)
    assert len(meshio.read(path).field_data) == 1
    back = read_mesh(path)
    assert back.node("tip") == 3
    assert len(back.elements_of("tip")) == 3


def test_meshio_has_no_cell_sets_in_22(tmp_path):
    mesh = MeshCurve(SPACE, CHAIN).with_beams({"all": [0, 1, 2]})
    assert "all" not in meshio.read(_gmsh(tmp_path, "2.2", mesh)).cell_sets
    assert "all" in read_mesh(tmp_path / "a.msh").beams


def test_meshio_writes_names_of_vtu_arrays_unescaped(tmp_path):
    data = {'a "b"': [np.zeros(3)]}
    meshio.Mesh(SPACE.T, [("line", CHAIN.T)], cell_data=data).write(tmp_path / "a.vtu")
    with pytest.raises(SystemExit):
        meshio.read(tmp_path / "a.vtu")
