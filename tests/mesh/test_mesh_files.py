import re
import runpy
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

from skfem_cosserat import MeshCurve, MeshError, ModelWarning, read_mesh, write_mesh

MESHES = Path(__file__).parents[2] / "meshes"
FORMATS = [("a.msh", None), ("a.msh", "gmsh"), ("a.msh", "gmsh22"), ("a.vtu", None)]
HEAD = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
NODES = "$Nodes\n1 3 1 3\n1 1 0 3\n1\n2\n3\n0 0 0\n1 0 0\n2 0 0\n$EndNodes\n"


def network():
    """Irrational coordinates, a branch, a beam with a space in its name, lines in no beam."""
    a = MeshCurve.init_line((0, 0, 0), (np.pi, np.e / 7, -1 / 3), 3, "long boom", {"third": 1 / 3})
    b = MeshCurve.init_line((0, 0, 0), (1e-17, -(2.0**0.5), 1e5), 2, "web")
    c = MeshCurve.init_line((5, 5, 5), (6, 5, 5), 2, "c")
    mesh = a.joined(b, c)
    beams = {k: v for k, v in mesh.beams.items() if k != "c"}
    return replace(mesh, _subdomains={**beams, "ends": np.array([0, 4])})


def same(one, other):
    return one.keys() == other.keys() and all(np.array_equal(one[k], other[k]) for k in one)


@pytest.mark.parametrize(("name", "kind"), FORMATS)
def test_round_trip_is_exact(tmp_path, name, kind):
    mesh, path = network(), tmp_path / name
    write_mesh(path, mesh, kind)
    back = read_mesh(path)
    assert np.array_equal(back.p, mesh.p)
    assert np.array_equal(back.t, mesh.t)
    assert same(back.beams, mesh.beams) and same(back.nodes, mesh.nodes)
    assert back.unnamed_elements().tolist() == [5, 6]


@pytest.mark.parametrize(("name", "kind"), FORMATS)
def test_a_beam_and_a_node_may_share_a_name(tmp_path, name, kind):
    mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, "tip").with_nodes({"tip": 2})
    write_mesh(tmp_path / name, mesh, kind)
    back = read_mesh(tmp_path / name)
    assert back.node("tip") == 2
    assert back.elements_of("tip").tolist() == [0, 1]


def test_save_and_load_are_the_same(tmp_path):
    mesh = network()
    mesh.save(tmp_path / "a.vtu", point_data={"u": mesh.p.T}, cell_data={"k": mesh.lengths})
    data = meshio.read(tmp_path / "a.vtu")
    assert np.array_equal(data.point_data["u"], mesh.p.T)
    assert np.array_equal(data.cell_data["k"][0], mesh.lengths)
    assert list(MeshCurve.load(tmp_path / "a.vtu").beams) == list(mesh.beams)


def test_meshio_reads_what_we_write(tmp_path):
    mesh = MeshCurve.init_line((0, 0, 0), (1, 2, 3), 3, "boom")
    write_mesh(tmp_path / "a.msh", mesh)
    data = meshio.read(tmp_path / "a.msh")
    assert np.array_equal(data.points.T, mesh.p)
    assert np.array_equal(data.cells_dict["line"].T, mesh.t)
    assert {"boom", "boom.start", "boom.end"} <= set(data.cell_sets)


DATA = Path(__file__).parents[1] / "data"  # files written by gmsh itself


@pytest.mark.parametrize("name", ["4.1_ascii", "4.1_binary", "2.2_ascii", "2.2_binary"])
def test_files_of_gmsh_itself(name):
    mesh = read_mesh(DATA / f"gmsh_{name}.msh")
    assert set(mesh.beams) == {"sec:chord", "sec:brace"}
    assert mesh.lengths[mesh.elements_of("sec:chord")].sum() == pytest.approx(3, rel=1e-14)
    assert mesh.lengths[mesh.elements_of("sec:brace")].sum() == pytest.approx(np.sqrt(1.25))
    assert mesh.p[:, mesh.node("support:root")].tolist() == [0, 0, 0]
    assert len(mesh.elements_at("joint:k")) == 3
    assert len(mesh.chains) == 2  # opposing lines of one group were turned


@pytest.mark.parametrize("name", ["4.1_binary_partly", "4.1_binary_twice"])
def test_binary_files_that_lose_a_group_are_refused(name):
    """What meshio drops from them is not dropped in silence."""
    with pytest.raises(MeshError, match=rf"gmsh_{name}.*save it as ASCII"):
        read_mesh(DATA / f"gmsh_{name}.msh")


def test_lines_in_two_groups():
    mesh = read_mesh(DATA / "gmsh_4.1_ascii_twice.msh")
    assert set(mesh.beams) == {"all", "second"}
    assert mesh.lengths[mesh.elements_of("second")].sum() == pytest.approx(1, rel=1e-14)
    assert len(mesh.unnamed_elements()) == 0


def test_lines_in_no_group_are_kept():
    mesh = read_mesh(DATA / "gmsh_4.1_ascii_partly.msh")
    assert mesh.lengths[mesh.unnamed_elements()].sum() == pytest.approx(np.sqrt(1.25), rel=1e-14)
    assert list(mesh.beams) == ["sec:chord"]


def test_groups_without_a_name_are_called_by_their_tag(tmp_path):
    elements = "$Elements\n1 2 1 2\n1 1 1 2\n1 1 2\n2 2 3\n$EndElements\n"
    entities = "$Entities\n0 1 0 0\n1 0 0 0 2 0 0 1 12 0\n$EndEntities\n"
    (tmp_path / "a.msh").write_text(HEAD + entities + NODES + elements)
    assert list(read_mesh(tmp_path / "a.msh").beams) == ["physical-12"]


#: models of Abaqus and Nastran, which say more than a mesh
ABAQUS = """*HEADING
a frame
*NODE
1, 0., 0., 0.
2, 1., 0., 0.
3, 2., 0., 0.
*ELEMENT, TYPE=T3D2, ELSET=boom
1, 1, 2
2, 2, 3
*NSET, NSET=root
1
** a remark
*Beam  Section, ELSET=boom, MATERIAL=steel, SECTION=CIRC
0.1
0., 0., 1.
*MATERIAL, NAME=steel
*ELASTIC
2.1e11, 0.3
"""
NASTRAN = """SOL 101
CEND
BEGIN BULK
GRID,1,,0.0,0.0,0.0
GRID,2,,1.0,0.0,0.0
GRID,3,,2.0,0.0,0.0
CBAR,1,7,1,2,0.0,0.0,1.0
CBAR,2,8,2,3,0.0,0.0,1.0
$ a remark
PBAR,7,1,1.0,1.0,1.0
PBAR,8,1,1.0,1.0,1.0
MAT1,1,2.1+11,,0.3
ENDDATA
"""
DECKS = {".inp": ABAQUS, ".bdf": NASTRAN}


def test_what_is_left_out_of_a_model_is_named(tmp_path):
    (tmp_path / "a.inp").write_text(ABAQUS)
    words = r"a\.inp.*not \*BEAM SECTION \(1\), \*MATERIAL \(1\), \*ELASTIC \(1\): add what matters"
    with pytest.warns(ModelWarning, match=words):
        mesh = read_mesh(tmp_path / "a.inp")
    assert mesh.elements_of("boom").tolist() == [0, 1] and mesh.node("root") == 0
    (tmp_path / "a.bdf").write_text(NASTRAN)
    words = r"property ids \(2\), orientations of CBAR and CBEAM \(2\), PBAR \(2\), MAT1 \(1\)"
    with pytest.warns(ModelWarning, match=words):
        assert read_mesh(tmp_path / "a.bdf").nelements == 2


def mutated(data, rng):
    """One file with flipped bits, cut short, without lines, or with words changed."""
    kind, out = rng.integers(6), bytearray(data)
    first, count = rng.integers(len(out)), rng.integers(1, 20)
    if kind == 0:
        for place in rng.integers(len(out), size=rng.integers(1, 4)):
            out[place] ^= 1 << int(rng.integers(8))
    elif kind == 1:
        del out[first:]
    elif kind == 2:
        rows = data.split(b"\n")
        first = rng.integers(len(rows))
        return b"\n".join([*rows[:first], *rows[first + rng.integers(1, 4) :]])
    elif kind == 3:
        out[first : first + count] = rng.bytes(count)
    else:
        words = re.split(rb"(\s+|,)", data)
        one, two = rng.integers(len(words), size=2)
        odd = b"-1", b"9" * 12, b"nan", b"x", b"0", b"1e400", b"9" * 400
        words[one], words[two] = words[two], words[one] if kind == 4 else rng.choice(odd)
        return b"".join(words)
    return bytes(out)


@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore::skfem_cosserat.ModelWarning")
@pytest.mark.parametrize(
    "source",
    [
        *("41.msh", "22.msh", "zlib.vtu", "raw.vtu", "lzma.vtu", "ascii.vtu", "a.vtk", "a.mesh"),
        *("a.ply", "a.avs", "frame.inp", "frame.bdf", "gmsh_2.2_binary.msh"),
        *("gmsh_4.1_binary.msh", "gmsh_4.1_ascii_partly.msh"),
    ],
)
def test_damaged_files_give_one_kind_of_error(tmp_path, source):
    """Or a mesh, where the damage is one that no reader can see."""
    path, mesh = tmp_path / source, network()
    options = {"raw.vtu": {"compression": None}, "lzma.vtu": {"compression": "lzma"}}
    options["ascii.vtu"] = {"binary": False}
    if path.suffix in DECKS:
        path.write_text(DECKS[path.suffix])
    elif source.startswith("gmsh_"):
        path.write_bytes((DATA / source).read_bytes())
    elif path.suffix == ".msh":
        write_mesh(path, mesh, "gmsh22" if source == "22.msh" else "gmsh")
    else:
        lines = meshio.Mesh(mesh.p.T, [("line", mesh.t.T)])
        meshio.write(path, lines, **options.get(source, {}))
    assert read_mesh(path).nelements > 1
    rng, data, texts = np.random.default_rng(7), path.read_bytes(), []
    for _ in range(40):
        path.write_bytes(mutated(data, rng))
        try:
            read_mesh(path)
        except MeshError as error:  # no other one
            texts.append(str(error))
    assert sum(source in text for text in texts) > 10
    assert not re.search(r"\w(Error|Exit|Iteration)\b", " ".join(texts))  # words for a user


BROKEN = {
    "no.msh": None,
    "empty.msh": "",
    "head.msh": HEAD,
    "cut.msh": HEAD + NODES + "$Elements\n1 2 1 2\n1 1 1 2\n1 1 2\n$EndElements\n",
    "words.msh": HEAD + NODES.replace("2 0 0", "2 x 0") + "$Elements\n0 0 0 0\n$EndElements\n",
    "gone.msh": HEAD + NODES + "$Elements\n1 1 1 1\n1 1 1 1\n1 1 9\n$EndElements\n",
    "v9.msh": "$MeshFormat\n9.9 0 8\n$EndMeshFormat\n",
    "bad.vtu": "<VTKFile",
    "other.vtu": "<VTKFile></VTKFile>",
    "what.xyz": "1 2 3",
}


@pytest.mark.one_quick
@pytest.mark.parametrize("name", BROKEN)
def test_broken_files_give_one_kind_of_error(tmp_path, name, capsys):
    if BROKEN[name] is not None:
        (tmp_path / name).write_text(BROKEN[name])
    with pytest.raises(MeshError, match=name):
        read_mesh(tmp_path / name)
    captured = capsys.readouterr()
    assert captured.out == captured.err == ""


def test_a_named_point_of_no_line_is_refused(tmp_path):
    points = np.array([(0, 0, 0), (1, 0, 0), (7.0, 1, 0)])
    mesh = meshio.Mesh(points, [("line", [[0, 1]])], {"node:body:door": np.array([0, 0, 1])})
    meshio.write(tmp_path / "a.vtu", mesh)
    with pytest.raises(MeshError, match=r"node 'body:door': at \[7.0, 1.0, 0.0\]"):
        read_mesh(tmp_path / "a.vtu")


def test_what_a_format_cannot_hold(tmp_path):
    mesh = network().with_nodes({'a "b"': 0})
    for name in ("a.msh", "a.vtu"):
        with pytest.raises(MeshError, match='a "b"'):
            write_mesh(tmp_path / name, mesh)
    with pytest.raises(MeshError, match="data"):
        network().save(tmp_path / "a.msh", point_data={"u": np.zeros(3)})
    with pytest.raises(MeshError, match=r"a\.stl.*\.stl"):
        write_mesh(tmp_path / "a.stl", network())
    with pytest.raises(MeshError, match="'xdmf'"):
        write_mesh(tmp_path / "a.vtu", network(), "xdmf")


@pytest.mark.parametrize("script", sorted(MESHES.glob("*.py")), ids=lambda p: p.stem)
def test_scripts_reproduce_the_files(tmp_path, script):
    path = runpy.run_path(str(script))["main"](tmp_path / "again.msh")
    new, kept = read_mesh(path), read_mesh(script.with_suffix(".msh"))
    assert np.abs(new.p - kept.p).max() <= 4e-16 * new.size
    assert np.array_equal(new.t, kept.t)
    assert same(new.beams, kept.beams) and same(new.nodes, kept.nodes)


def test_every_mesh_has_its_script():
    assert {p.stem for p in MESHES.glob("*.msh")} == {p.stem for p in MESHES.glob("*.py")}


VTK = """# vtk DataFile Version {}
a
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 3 float
0 0 0 1 0 0 2 0 0
"""
PIECE = """<Piece NumberOfPoints="3" NumberOfCells="{0}"><Points><DataArray type="Float64"
NumberOfComponents="3" format="ascii">0 0 0 1 0 0 2 0 0</DataArray></Points><Cells>
<DataArray type="Int64" Name="connectivity" format="ascii">{1}</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">{2}</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">{3}</DataArray></Cells></Piece>"""
VTU = """<VTKFile type="UnstructuredGrid" version="0.1">
<UnstructuredGrid>{}</UnstructuredGrid></VTKFile>"""
LINES = PIECE.format(2, "0 1 1 2", "2 4", "3 3")
XDMF = """<Xdmf Version="3.0"><Domain><Grid><Topology Type="Polyline" BaseOffset="1"><DataItem
Dimensions="2 2" Format="XML">1 2 2 3</DataItem></Topology></Grid></Domain></Xdmf>"""
ZONE = "ZONE N=2, E=1, DATAPACKING=POINT, ZONETYPE=FELINESEG\n0 0\n1 0\n1 2\n"
#: Files of which meshio reads a part, or nothing, without an error.
PARTS = {
    ("polyline.vtu", "no polylines"): VTU.format(PIECE.format(2, "0 1 0 1 2", "2 5", "3 4")),
    ("pieces.vtu", "several pieces"): VTU.format(LINES + LINES),
    ("curve.vtu", "VTK_LAGRANGE_CURVE"): VTU.format(PIECE.format(2, "0 1 0 2 1", "2 5", "3 68")),
    ("polyline.vtk", "no polylines"): VTK.format("5.1")
    + "CELLS 3 5\nOFFSETS vtktypeint64\n0 2 5\nCONNECTIVITY vtktypeint64\n0 1 0 1 2\n"
    + "CELL_TYPES 2\n3\n4\n",
    ("old.vtk", "no polylines"): VTK.format("3.0") + "CELLS 1 4\n3 0 1 2\nCELL_TYPES 1\n4\n",
    ("a.obj", "has lines in an .obj file"): "v 0 0 0\nv 1 0 0\nl 1 2\n",
    ("a.vtp", "of suffix '.vtp' are not read: save its lines as .msh"): VTU.format(""),
    ("other.vtu", "read: it is damaged, or not what its name says;"): "no file of VTK",
    # meshio says more of it, by version
    ("surface.vtu", "cannot be read: .*only unstructured grids of lines"): VTU.format("").replace(
        "UnstructuredGrid", "PolyData"
    ),
    ("a.xdmf", "BaseOffset"): XDMF,
    ("a.tec", "several zones"): 'VARIABLES = "X", "Y"\n' + ZONE + ZONE,
    ("cubic.msh", "2 cells of type 'line4'"): HEAD
    + NODES
    + "$Elements\n2 3 1 3\n1 1 1 1\n1 1 2\n1 2 26 2\n2 1 2 3 1\n3 1 2 3 1\n$EndElements\n",
    ("split.msh", "section \\$PartitionedEntities"): HEAD
    + "$PartitionedEntities\n$EndPartitionedEntities\n"
    + NODES
    + "$Elements\n1 1 1 1\n1 1 1 1\n1 1 2\n$EndElements\n",
    ("blank.vtk", "is empty"): "\n",
    ("quadratic.vtu", "1 cells of type 'line3'"): VTU.format(PIECE.format(1, "0 1 2", "3", "21")),
    ("triangle.vtu", "no lines"): VTU.format(PIECE.format(1, "0 1 2", "3", "5")),
    ("quadratic.msh", "1 (cells of type 'line3'|quadratic lines)"): HEAD
    + NODES
    + "$Elements\n1 1 1 1\n1 1 8 1\n1 1 2 3\n$EndElements\n",
    ("triangle.msh", "no lines"): HEAD
    + NODES
    + "$Elements\n1 1 1 1\n2 1 2 1\n1 1 2 3\n$EndElements\n",
}


@pytest.mark.one_quick
@pytest.mark.parametrize(("name", "words"), PARTS)
def test_a_part_of_a_file_is_never_taken_for_the_whole(tmp_path, name, words):
    (tmp_path / name).write_text(PARTS[name, words])
    with pytest.raises(MeshError, match=rf"{name}'.*{words}"):
        read_mesh(tmp_path / name)


MEDIT = "MeshVersionFormatted 2\nDimension 3\nVertices\n3\n{}\nEdges\n2\n1 2 0\n2 3 0\n{}\nEnd\n"
WHOLE = {
    "a.vtu": VTU.format(LINES),
    "a.mesh": MEDIT.format("0 0 0 0\n1 0 0 0\n2 0 0 0", "Ridges\n1\n1"),
}


@pytest.mark.parametrize("name", WHOLE)
def test_the_whole_is_read_where_it_is_lines(tmp_path, name):
    """Tests above refuse what they name, and nothing else; ridges say how to draw a surface."""
    (tmp_path / name).write_text(WHOLE[name])
    assert read_mesh(tmp_path / name).t.T.tolist() == [[0, 1], [1, 2]]


@pytest.mark.parametrize("kind", ["41", "22"])
def test_lines_beside_a_triangle(tmp_path, kind):
    """A point that belongs to the triangle alone is dropped, with its name; the line stays."""
    groups = '$PhysicalNames\n3\n0 1 "root"\n0 2 "rim"\n1 3 "rod"\n$EndPhysicalNames\n'
    points = "1 0 0 0\n2 1 0 0\n3 0 1 0\n"
    cells = "15 2 1 1 1\n2 15 2 2 2 3\n3 1 2 3 1 1 2\n4 2 2 4 1 1 2 3\n"
    text = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n{groups}$Nodes\n3\n{points}$EndNodes\n"
    text += f"$Elements\n4\n1 {cells}$EndElements\n"
    if kind == "41":
        box = "0 0 0 1 1 0"
        text = HEAD + groups + "$Entities\n2 1 1 0\n1 0 0 0 1 1\n2 0 1 0 1 2\n"
        text += f"1 {box} 1 3 0\n1 {box} 0 0\n$EndEntities\n" + NODES.replace("2 0 0", "0 1 0")
        text += "$Elements\n4 4 1 4\n0 1 15 1\n1 1\n0 2 15 1\n2 3\n1 1 1 1\n3 1 2\n2 1 2 1\n"
        text += "4 1 2 3\n$EndElements\n"
    (tmp_path / "a.msh").write_text(text)
    mesh = read_mesh(tmp_path / "a.msh")
    assert mesh.p.T.tolist() == [[0, 0, 0], [1, 0, 0]]
    assert list(mesh.beams) == ["rod"] and mesh.node("root") == 0
