"""Lines that cross without a common vertex, and sections thicker than their beam is long."""

import numpy as np
import pytest

import skfem_cosserat as sc


def cross(n, height=0.0):
    a = sc.MeshCurve.init_line((-1, 0, 0), (1, 0, 0), n, name="a")
    return a, sc.MeshCurve.init_line((0, -1, height), (0, 1, height), n, name="b")


def test_a_join_that_finds_no_vertex_says_where_the_lines_cross():
    """An odd number of elements has no vertex in the middle."""
    a, b = cross(5)
    with pytest.warns(sc.ModelWarning, match=r"elements . and . meet at \[0.0, 0.0, 0.0\]"):
        a.joined(b)


def test_lines_that_share_a_vertex_or_pass_each_other_are_as_meant():
    """So are those that are joined without welding: they get a joint."""
    a, b = cross(4)
    assert a.joined(b).nvertices == 9
    a, b = cross(5, height=1e-3)
    assert a.joined(b).nvertices == 12
    a, b = cross(5)
    assert a.joined(b, weld=False).nvertices == 12


def test_an_end_on_the_middle_of_an_element():
    """A web on a flange: it has a vertex there, the flange has none."""
    flange = sc.MeshCurve.init_line((0, 0, 0), (2, 0, 0), 3, "flange")
    web = sc.MeshCurve.init_line((1, 0, 0), (1, 1, 0), 2, "web")
    with pytest.warns(sc.ModelWarning, match=r"meet at \[1.0, 0.0, 0.0\]"):
        flange.joined(web)


def test_a_file_whose_lines_cross(tmp_path):
    """Two diagonals of a square, and all pairs of a lattice that is long in one direction."""
    points = np.array([(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 0), (0, 0.25, 0), (90, 0.25, 0)])
    mesh = sc.MeshCurve(points.T.astype(float), np.array([[0, 2, 4], [1, 3, 5]]))
    sc.mesh.write_mesh(tmp_path / "square.msh", mesh)
    with pytest.warns(sc.ModelWarning, match=r"\(2 more like it\)"):
        sc.mesh.read_mesh(tmp_path / "square.msh")


def test_a_section_thicker_than_its_beam_is_long():
    """A radius in mm beside a length in m."""
    steel, line = sc.Material(210e9, 0.3, 7850.0), sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 1)
    with pytest.warns(sc.ModelWarning, match="20 m thick, more than its whole length of 1 m"):
        beam = sc.Beam(line, sc.SectionCircle(10.0, steel))
    assert beam.warnings
    assert not sc.Beam(line, sc.SectionCircle(0.01, steel)).warnings


def test_inertia_about_the_axes_in_place_of_along_them():
    """``int rho X_2^2 dA`` belongs to d2, EI_1 is ``int E X_2^2 dA``: exchanged numbers show."""
    good = sc.SectionRectangle(0.02, 0.12, sc.Material(70e9, 0.3, 2700.0))
    D = good.stiffness.diagonal()
    about = {"EA": D[2], "GA": D[0], "EI": D[3:5], "GJ": D[5], "mass": good.mass}
    sc.Section.from_constants(**about, inertia=good.inertia)
    with pytest.warns(sc.ModelWarning, match="exchange"):
        sc.Section.from_constants(**about, inertia=good.inertia[::-1])
