"""Decks of Abaqus and Nastran: what is read is right, what may change the mesh is refused."""

import numpy as np
import pytest

from skfem_cosserat import MeshError, ModelWarning, read_mesh

NODES = "*NODE\n1, 0., 0., 0.\n2, 0., 1., 0.\n3, 0., 2., 0.\n4, 1., 2., 0.\n5, 2., 2., 0.\n"
BARS = "*ELEMENT, TYPE=B31, ELSET=Column\n1, 1, 2\n2, 2, 3\n"
GIRDER = "*ELEMENT, TYPE=B31, ELSET=Girder\n3, 3, 4\n4, 4, 5\n"
FOOT = "*NSET, NSET=Foot\n1\n"
#: One portal in many ways of writing: a column of two elements, and a girder of two at its top.
PORTALS = {
    "plain": NODES + BARS + GIRDER + FOOT,
    "small letters": (NODES + BARS + GIRDER + FOOT).lower(),
    "own letters of a name": NODES
    + BARS
    + GIRDER.replace("Girder", "other")
    + "*ELSET, ELSET=Girder\nOTHER\n"
    + FOOT,
    "sets on keywords": NODES.replace("2, 0.,", "*NODE, NSET=others\n2, 0.,").replace(
        "*NODE\n1", "*NODE, NSET=Foot\n1"
    )
    + BARS
    + GIRDER,
    "elements first": BARS + GIRDER + NODES + FOOT,
    "sets of sets, ranges": NODES
    + "*ELEMENT, TYPE=PIPE31\n1, 1, 2\n2, 2, 3\n3, 3, 4\n4, 4, 5\n"
    + "*ELSET, ELSET=Low, GENERATE\n1, 2, 1\n*ELSET, ELSET=Column\nLOW,\n"
    + "*ELSET, ELSET=Girder, GENERATE\n3, 999999999999\n*NSET, NSET=Foot\n1,\n",
    "keyword in two lines": NODES + BARS.replace("TYPE", "\nTYPE") + GIRDER + FOOT,
    "numbers of Fortran": NODES.replace("2., 0.", "2.D+0, 0.").replace("1.,", "1.0+0,")
    + BARS
    + GIRDER
    + FOOT,
    "node for orientation": NODES + BARS.replace("1, 2\n", "1, 2, 5\n") + GIRDER + FOOT,
    "other files": "*INCLUDE, INPUT=nodes.txt\n" + BARS + GIRDER + FOOT,
    "a part": "*PART, NAME=A\n"
    + NODES
    + BARS
    + GIRDER
    + "*END PART\n*ASSEMBLY, NAME=B\n*INSTANCE, NAME=A-1, PART=A\n*END INSTANCE\n"
    + "*NSET, NSET=Foot, INSTANCE=A-1\n1,\n*END ASSEMBLY\n",
}


@pytest.mark.one_quick
@pytest.mark.parametrize("name", PORTALS)
def test_one_portal_however_it_is_written(tmp_path, name):
    (tmp_path / "nodes.txt").write_text(NODES)
    (tmp_path / "a.inp").write_text(PORTALS[name])
    mesh = read_mesh(tmp_path / "a.inp")
    assert mesh.p.T.tolist() == [[0, 0, 0], [0, 1, 0], [0, 2, 0], [1, 2, 0], [2, 2, 0]]
    assert mesh.t.T.tolist() == [[0, 1], [1, 2], [2, 3], [3, 4]]
    sets = {key.lower(): members.tolist() for key, members in (mesh.beams | mesh.nodes).items()}
    assert (sets["column"], sets["girder"], sets["foot"]) == ([0, 1], [2, 3], [0])


@pytest.mark.parametrize("kind", ["B21", "B23H", "B31OS", "B31R", "B33", "PIPE31H", "T3D2T"])
def test_elements_with_two_nodes(tmp_path, kind):
    (tmp_path / "a.inp").write_text(NODES + BARS.replace("B31", kind) + GIRDER)
    assert read_mesh(tmp_path / "a.inp").nelements == 4


def test_beams_beside_shells(tmp_path):
    """Nodes of shells alone are dropped, also from sets, which is said; sets of lines stay."""
    shells = "*ELEMENT, TYPE=S3, ELSET=Skin\n9, 1, 2, 4\n10, 2, 4, 5\n"
    sets = "*ELSET, ELSET=All\nColumn, Skin\n*NSET, NSET=Every, GENERATE\n1, 5\n"
    sets += "*NSET, NSET=Rim\n4, 5\n"
    (tmp_path / "a.inp").write_text(NODES + BARS + shells + sets + "*STEP\n*STATIC\n*END STEP\n")
    with pytest.warns(ModelWarning, match=r"of type S3 \(1\), nodes of no line, in sets too \(2\)"):
        mesh = read_mesh(tmp_path / "a.inp")
    assert mesh.p[1].tolist() == [0, 1, 2]
    assert list(mesh.beams) == ["Column", "All"] and list(mesh.nodes) == ["Every"]


MOVED = PORTALS["a part"].replace("PART=A\n*END", "PART=A\n{}\n*END")
ABAQUS = {
    r"line 7: \*NGEN: is not understood": NODES + "*NGEN\n1, 3, 1\n" + BARS,
    r"line 10: \*ELGEN: is not": NODES + BARS + "*ELGEN\n1, 2\n",
    r"line 7: \*NCOPY: is not": NODES + "*NCOPY, SHIFT\n" + BARS,
    r"line 1: \*SYSTEM: is not": "*SYSTEM\n1., 0., 0.\n" + NODES + BARS,
    r"line 1: \*NODE, SYSTEM: is not": NODES.replace("*NODE", "*NODE, SYSTEM=C") + BARS,
    r"line 10: \*IMPERFECTION: is": NODES + BARS + "*IMPERFECTION, FILE=a, STEP=1\n",
    r"line 16: \*INSTANCE: moves its part": MOVED.format("0., 2., 0."),
    r"\*INSTANCE: moves its part.": MOVED.format("0., 0., 0.\n0., 0., 0., 0., 0., 1., 90."),
    r"2 parts, 1 instances": "*PART, NAME=C\n*END PART\n" + PORTALS["a part"],
    r"\*ASSEMBLY: has no \*END ASSEMBLY: .* cut short": PORTALS["a part"][:-14],
    r"line 7: \*NODE: number 1 is given twice": NODES + NODES + BARS,
    r"node 9: belongs to an element": NODES + BARS.replace("2, 3", "2, 9"),
    r"line 7: \*ELEMENT: TYPE=B32 is a quadratic line": NODES + "*ELEMENT, TYPE=B32\n1, 1, 2, 3\n",
    r"line 7: \*ELEMENT: element 1 has 3 nodes": NODES + "*ELEMENT, TYPE=B33\n1, 1, 3, 2\n",
    r"line 7: \*ELEMENT: element 2 has 1": NODES + BARS[:-2],
    r"line 1: '3 2 0 0 0' stands before": "3 2 0 0 0\n",
    r"lost\.inp": "*INCLUDE, INPUT=lost.inp\n" + BARS,
    r"has no lines; found: \*ELEMENT of type S3 \(1\)": NODES + BARS.replace("B31", "S3"),
}


@pytest.mark.one_quick
@pytest.mark.parametrize("words", ABAQUS)
def test_what_may_change_the_mesh_of_abaqus_is_refused(tmp_path, words):
    (tmp_path / "a.inp").write_text(ABAQUS[words])
    with pytest.raises(MeshError, match=rf"a\.inp': .*{words}"):
        read_mesh(tmp_path / "a.inp")


FREE = """GRID,1,,0.,0.,0.
GRID,2,0,1.,0.,0.
GRID,3,,2.,1.5-1,0.
CROD,1,1,1,2
CBAR,2,1,2,3
+,46
"""
FIXED = """$ a remark
GRID    1               0.0             0.0
GRID    2               1.0     0.0     0.0
GRID    3               2.0     .15     0.0     $ a remark
CONROD  1       1       2       1       0.1
CBAR    2       1       2       3       0.      0.      1.              +A
+A              46      0.      0.      0.      0.      0.      0.
"""
LARGE = """GRID*   1                               0.0             0.0
*       0.0
GRID*   2                               1.0D+0          0.0
*       0.0
GRID*,3,,2.,.15
*,0.
CTUBE*  1               1               1               2
CBEAM   2       1       2       3       0.      0.      1.
                46
"""


@pytest.mark.parametrize("head", ["", "SOL 101\nCEND\nbegin bulk\n"])
@pytest.mark.parametrize("bulk", [FREE, FIXED, LARGE, FREE.lower()])
def test_one_deck_of_nastran_in_all_its_formats(tmp_path, head, bulk):
    """What the fields mean is told by the format, whatever comes before the bulk data."""
    (tmp_path / "a.bdf").write_text(head + bulk + "CORD2C,1,,0.,0.,0.,0.,0.,1.\n,1.\nENDDATA\n")
    with pytest.warns(ModelWarning, match=r"pins of CBAR and CBEAM \(1\), CORD2C \(1\)"):
        mesh = read_mesh(tmp_path / "a.bdf")
    assert np.allclose(mesh.p.T, [[0, 0, 0], [1, 0, 0], [2, 0.15, 0]], rtol=0, atol=1e-15)
    assert mesh.t.T.tolist() == [[0, 1], [1, 2]]


def test_fields_of_a_node_that_are_not_read_are_named(tmp_path):
    """Its system of displacements and its supports leave a GRID where it is."""
    (tmp_path / "a.bdf").write_text(FREE.replace("1.5-1,0.", "1.5-1,0.,7,1246") + "ENDDATA\n")
    with pytest.warns(ModelWarning, match=r"CD or PS of GRID \(1\)"):
        read_mesh(tmp_path / "a.bdf")


NASTRAN = {
    r"line 2: GRID: node 9 is given in the system 1": "GRID,9,1,1.,45.,0.\n",
    r"line 2: GRDSET: is not understood": "GRDSET,,1\n",
    r"line 2: CBAR: element 9 has offsets": "CBAR,9,1,1,2,0.,0.,1.\n,,,0.,0.,.1,0.,0.,.1\n",
    r"line 2: CBEAM3: is a quadratic line": "CBEAM3,9,1,1,3,2\n",
    r"line 2: CBEND: is not": "CBEND,9,1,1,3,0.,0.,1.\n",
    r"line 2: =: is not": "=,*(1),=,*(1.),==\n",
    r"line 2: INCLUDE: is not": "INCLUDE 'more.bdf'\n",
    r"line 2: BEGIN SU: is not": "BEGIN SUPER=1\n",
    r"line 2: GRID: number 1 is given twice": "GRID,1,,5.,0.,0.\n",
    r"line 2: 11 fields, expected": "CBAR,9,1,1,2,0.,0.,1.,,,,1.\n",
    r"ENDDATA: is missing": None,
}


@pytest.mark.one_quick
@pytest.mark.parametrize("words", NASTRAN)
def test_what_may_change_the_mesh_of_nastran_is_refused(tmp_path, words):
    added = NASTRAN[words]
    head, tail = FREE.split("\n", 1)
    text = FREE if added is None else f"{head}\n{added}{tail}ENDDATA\n"
    (tmp_path / "a.nas").write_text(text)
    with pytest.raises(MeshError, match=rf"a\.nas': .*{words}"):
        read_mesh(tmp_path / "a.nas")
