"""Meshes of scikit-fem and meshio, scaled ones, and pieces of one beam."""

import meshio
import numpy as np
import pytest
import skfem
from numpy.testing import assert_allclose

import skfem_cosserat as sc
from skfem_cosserat.errors import MeshError


def test_lines_of_scikit_fem_keep_their_names():
    line = skfem.MeshLine(np.linspace(0.0, 2.0, 5)).with_subdomains({"left": lambda x: x[0] < 1})
    line = line.with_boundaries({"tip": lambda x: x[0] == 2.0})
    mesh = sc.MeshCurve.from_mesh(line)
    assert mesh.beams["left"].tolist() == [0, 1]
    assert mesh.p[:, mesh.node("tip")].tolist() == [2.0, 0.0, 0.0]
    assert mesh.lengths.sum() == pytest.approx(2.0)


def test_edges_of_a_mesh_are_curves():
    square = skfem.MeshTri().refined(2).with_boundaries({"top": lambda x: x[1] == 1.0})
    every = sc.MeshCurve.from_mesh(square)
    assert every.nelements == square.facets.shape[1]
    top = sc.MeshCurve.from_mesh(square, "top")
    assert top.beams["top"].size == top.nelements == 4
    assert_allclose(top.p[1], 1.0)
    box = skfem.MeshHex()
    assert sc.MeshCurve.from_mesh(box).lengths.tolist() == [1.0] * 12
    assert sc.MeshCurve.from_mesh(box, [0, 3]).nelements == 2
    for edges in ("left", [12]):
        with pytest.raises(MeshError, match=r"left|12"):
            sc.MeshCurve.from_mesh(square if edges == "left" else box, edges)


def test_a_meshio_mesh_has_its_groups():
    cells = [("line", [[0, 1], [1, 2]]), ("vertex", [[2]])]
    tags = {"gmsh:physical": [np.array([7, 7]), np.array([3])]}
    names = {"mast": np.array([7, 1]), "top": np.array([3, 0])}
    given = meshio.Mesh(np.eye(3), cells, cell_data=tags, field_data=names)
    mesh = sc.MeshCurve.from_meshio(given)
    assert mesh.beams["mast"].tolist() == [0, 1]
    assert mesh.p[:, mesh.node("top")].tolist() == [0.0, 0.0, 1.0]
    with pytest.raises(MeshError, match="no lines"):
        sc.MeshCurve.from_meshio(meshio.Mesh(np.eye(3), [("triangle", [[0, 1, 2]])]))


def test_a_scaled_curve_has_scaled_arc_lengths():
    arc = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 2.0, 1.5, 3, name="arc")
    large = arc.scaled(1e3)
    assert_allclose(large.lengths, 1e3 * arc.lengths, rtol=1e-14)
    assert_allclose(np.linalg.norm(large.refined(2).p.T - (0, 2e3, 0), axis=1), 2e3, rtol=1e-13)
    assert list(large.beams) == ["arc"]
    with pytest.raises(sc.InputError, match="factors"):
        arc.scaled(-1.0)


def test_pieces_of_one_name_are_one_beam():
    first = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod", nodes={"middle": 1.0 / 2})
    second = sc.MeshCurve.init_line((3, 0, 0), (1, 0, 0), 2, name="rod")  # against the first
    mesh = first + second
    assert mesh.beams["rod"].size == 4
    ends = [mesh.p[0, mesh.node(f"rod.{end}")] for end in ("start", "end")]
    assert ends == [0.0, 3.0]
    assert mesh.p[0, mesh.node("middle")] == 0.5
    section = sc.SectionCircle(0.01, sc.Material(1e9, 0.3, 1000))
    assert sc.Beam(mesh, section).basis.arc_lengths.max() == pytest.approx(3.0)


def test_vtk_files_keep_names(tmp_path):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="boom", nodes={"third": 1 / 3})
    sc.write_mesh(tmp_path / "boom.vtk", mesh)
    again = sc.read_mesh(tmp_path / "boom.vtk")
    assert list(again.beams) == ["boom"]
    assert again.node("third") == mesh.node("third")
    assert_allclose(again.p, mesh.p)
    other = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="my boom")
    with pytest.raises(MeshError, match="space"):
        sc.write_mesh(tmp_path / "b.vtk", other)
