"""Export: what is written is read back with VTK's own readers and compared number by number."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from conftest import BOX, LEG, OUTLINE, turn

from skfem_cosserat import (
    History,
    IncompleteWarning,
    InputError,
    MeshCurve,
    StorageError,
    write_csv,
    write_mesh,
    write_paraview,
)
from skfem_cosserat.export import ParaViewWriter, paraview, write_rows
from skfem_cosserat.export.geometry import BeamShape, quaternions
from skfem_cosserat.export.paraview import _Index

HERE = Path(__file__).resolve().parents[1]
LINE, QUADRATIC, VERTEX, TRIANGLE, POLYGON, QUAD = 3, 21, 1, 5, 7, 9


def read_vtu(path):
    """Points, cells (list of index arrays), types, point data, cell data by VTK's reader."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    assert reader.GetErrorCode() == 0
    grid = reader.GetOutput()
    cells = []
    for k in range(grid.GetNumberOfCells()):
        ids = grid.GetCell(k).GetPointIds()
        cells.append([ids.GetId(j) for j in range(ids.GetNumberOfIds())])
    data = [
        {part.GetArrayName(i): values_of(part.GetAbstractArray(i)) for i in range(len(part.keys()))}
        for part in (grid.GetPointData(), grid.GetCellData())
    ]
    types = [grid.GetCellType(k) for k in range(grid.GetNumberOfCells())]
    return vtk_to_numpy(grid.GetPoints().GetData()).copy(), cells, types, *data


def values_of(array):
    """Numbers or texts of VTK's array."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    if array.GetClassName() == "vtkStringArray":
        return np.array([array.GetValue(i) for i in range(array.GetNumberOfValues())])
    return vtk_to_numpy(array)


def read_index(path):
    """Times and files of an index."""
    sets = ET.parse(path).getroot().findall("Collection/DataSet")
    return [(float(one.attrib["timestep"]), one.attrib["file"]) for one in sets]


# -- series ----------------------------------------------------------------------------------


@pytest.mark.one_quick
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_beams(make_scene, tmp_path, order):
    scene = make_scene(order)
    history = scene.history(4)
    index = {path.stem: path for path in write_paraview(history, tmp_path)}
    assert list(index) == ["beams", "bodies", "joints", "scene"]
    frames = read_index(index["beams"])
    assert [t for t, _ in frames] == history.times.tolist()  # every digit
    line = np.arange(2 * order + 1) / order  # equidistant, also where the nodes are not
    reference, _, _, zero, _ = read_vtu(tmp_path / frames[0][1])
    np.testing.assert_array_equal(zero["u"], 0.0)
    for k, (t, name) in enumerate(frames):
        points, cells, types, at_points, at_cells = read_vtu(tmp_path / name)
        assert points.dtype == np.float64
        np.testing.assert_allclose(points - at_points["u"], reference, atol=1e-15)
        half = 2 * order + 1  # those of the boom; the angle has one more, at its corner
        np.testing.assert_allclose(
            np.sort(np.linalg.norm(points[:half], axis=1)), line * (1.0 + 0.1 * t), atol=1e-14
        )
        assert [len(cell) for cell in cells] == [3 if order == 2 else 2] * len(cells)
        assert set(types) == {QUADRATIC if order == 2 else LINE}
        assert len(cells) == (4 if order <= 2 else 4 * order)
        lengths = np.linalg.norm(np.diff(points[np.array(cells)[:, :2]], axis=1), axis=2)
        np.testing.assert_allclose(lengths, (1.0 + 0.1 * t) * 4.0 / len(cells), rtol=1e-13)
        check_beam_points(scene, order, t, points, at_points, half)
        check_beam_cells(scene, order, k, at_cells)
        if order <= 2:
            q = history["q"][k][: 12 * (2 * order + 1)].reshape(-1, 12)
            np.testing.assert_array_equal(points[:half], q[:, :3])  # exact
            np.testing.assert_array_equal(
                at_points["v"][:half, 0], history["v"][k][: 12 * half : 12]
            )


def check_beam_points(scene, order, t, points, at_points, half):
    R, rate = turn(t), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(
        at_points["v"], points @ (rate + np.eye(3) * 0.1 / (1.0 + 0.1 * t)).T, atol=1e-8
    )
    own = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]) @ R.T
    local = np.linalg.solve((1.0 + 0.1 * t) * R, points.T).T
    on_leg = (np.arange(len(points)) >= half) & (local[:, 1] > 1e-9)  # not at the corner
    assert on_leg.sum() == order
    wanted = np.where(on_leg[:, None, None], LEG @ own, own)
    for i in range(3):
        np.testing.assert_allclose(at_points[f"d{i + 1}"], wanted[:, i], atol=1e-14)
    turned = rotations(at_points["q_wxyz"])
    np.testing.assert_allclose(turned, np.swapaxes(wanted, 1, 2), atol=1e-14)
    ids = at_points["node_id"]
    assert ids.dtype == np.int64
    nodes = scene.nodes["boom"] @ ((1.0 + 0.1 * t) * R).T
    first = ids[:half]
    np.testing.assert_allclose(points[:half][first >= 0], nodes[first[first >= 0]], atol=1e-14)
    if order > 2:
        assert (ids == -1).sum() == 4 * (order - 1)


def check_beam_cells(scene, order, k, at_cells):
    row = scene.row(k)
    labels = {"beam", "part", "section", "beam_id", "part_id", "section_id", "outlined"}
    assert set(at_cells) == labels | {"Gamma", "K", "N", "M", "n", "m"}
    half = len(at_cells["N"]) // 2
    np.testing.assert_array_equal(at_cells["beam_id"], np.repeat([0, 1], half))
    np.testing.assert_array_equal(at_cells["part_id"], np.repeat([0, 0, 0, 1], half // 2))
    np.testing.assert_array_equal(at_cells["section_id"], np.repeat([0, 0, 0, 1], half // 2))
    own = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]) @ turn(row["t"]).T
    for b, name in enumerate(("boom", "angle")):
        values = row[f"beam/{name}/resultant"]
        strain = row[f"beam/{name}/strain"]
        if order <= 2:  # one cell an element, otherwise one Gauss point a cell
            values, strain = values.mean(1), strain.mean(1)
        values, strain = values.reshape(-1, 6), strain.reshape(-1, 6)
        part = slice(b * half, (b + 1) * half)
        np.testing.assert_allclose(at_cells["N"][part], values[:, :3], rtol=1e-14)
        np.testing.assert_allclose(at_cells["M"][part], values[:, 3:], rtol=1e-14)
        np.testing.assert_allclose(at_cells["Gamma"][part], strain[:, :3], rtol=1e-14)
        np.testing.assert_allclose(at_cells["K"][part], strain[:, 3:], rtol=1e-14)
        leg = np.repeat([False, b == 1], half // 2)
        d = np.where(leg[:, None, None], LEG @ own, own)
        for upper, lower in ("Nn", "Mm"):
            space = np.einsum("ci,cij->cj", at_cells[upper][part], d)
            np.testing.assert_allclose(at_cells[lower][part], space, rtol=1e-12, atol=1e-12)


def rotations(quaternion):
    w, x, y, z = quaternion.T
    R = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(R), 2, 0)


def test_bodies_and_joints(make_scene, tmp_path):
    scene = make_scene()
    history = scene.history(4)
    write_paraview(history, tmp_path)
    for k, (t, name) in enumerate(read_index(tmp_path / "bodies.pvd")):
        points, cells, types, at_points, at_cells = read_vtu(tmp_path / name)
        R, A = turn(t), scene.motion(t)
        np.testing.assert_allclose(points[:8], A @ [-0.5, 0, 0] + BOX @ R.T, atol=1e-14)
        np.testing.assert_allclose(points[8], A @ [2.5, 0, 0], atol=1e-14)
        assert types == [TRIANGLE] * 12 + [VERTEX]
        volume = np.linalg.det(points[np.array(cells[:12])] - points[:8].mean(0)).sum() / 6.0
        assert volume == pytest.approx(0.4**3)  # closed, normals outward
        assert at_cells["body_id"].tolist() == [0] * 12 + [1]
        np.testing.assert_allclose(
            at_points["v"][:8, :2].mean(0), history["v"][k][72:74], atol=1e-9
        )
        np.testing.assert_allclose(rotations(at_points["q_wxyz"][:1])[0], R, atol=1e-14)
        np.testing.assert_array_equal(at_points["q_wxyz"][8], [1, 0, 0, 0])
    for k, (t, name) in enumerate(read_index(tmp_path / "joints.pvd")):
        points, _, types, at_points, _ = read_vtu(tmp_path / name)
        assert types == [VERTEX, VERTEX]
        np.testing.assert_array_equal(points[1], history["joint/weld/position"][k])
        np.testing.assert_array_equal(at_points["force"][0], [1.0, t, 0.0])
        assert np.isnan(at_points["force"][1]).all()
        np.testing.assert_array_equal(at_points["type"], [0, 1])
    assert at_points["kind"].tolist() == ["revolute", "rigid"]
    assert at_cells["name"].tolist() == ["hub"] * 12 + ["ball"]


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_surfaces(make_scene, tmp_path, order):
    scene = make_scene(order)
    index = {path.stem: path for path in write_paraview(scene.history(3), tmp_path, surfaces=True)}
    for t, name in read_index(index["beam_surfaces"]):
        points, cells, types, at_points, at_cells = read_vtu(tmp_path / name)
        assert types.count(QUAD) == 3 * 4 * order  # the leg of the angle has no outline
        assert types.count(POLYGON) == 3  # ends of the boom, and of the angle
        assert len(points) == 4 * (2 * order + 1 + order + 1)  # elements share points
        np.testing.assert_array_equal(at_cells["section_id"], 0)
        quads, beam = np.array(cells[: 8 * order]), at_cells["beam_id"][: 8 * order]
        assert (beam == 0).all()
        corners = points[quads].astype(float)
        normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]) / 2.0
        area = np.linalg.norm(normal, axis=1).sum()
        assert area == pytest.approx(2.0 * (1.0 + 0.1 * t) * 0.6, rel=1e-6)
        back = (corners.mean(1)) @ turn(t) / (1.0 + 0.1 * t)  # to the reference place
        assert (np.einsum("ci,ci->c", normal @ turn(t), back * [0, 1, 1]) > 0.0).all()
        reference = points @ turn(t) / (1.0 + 0.1 * t)
        forces = at_points["N"][: 4 * (2 * order + 1)]  # linear along the boom
        place = np.round(reference[: len(forces), 0] * order) / order
        np.testing.assert_allclose(forces, place[:, None] * [1, 2, 3] + t, atol=1e-6)
        assert np.isnan(at_points["mises"]).all()  # of a section given by numbers
        if t == 0.0:
            np.testing.assert_array_equal(at_points["u"], 0.0)


def test_two_orders_and_missing_fields(make_scene, tmp_path):
    """A linear and a quadratic beam in one file; only one has resultants."""
    one, two = make_scene(1), make_scene(2)
    static = {k: v for k, v in one.static.items() if k.startswith("beam/boom")}
    static |= {k: v for k, v in two.static.items() if k.startswith("beam/angle")}
    meta = {"beams": [one.meta["beams"][0], two.meta["beams"][1]]}
    static["beam/angle/offsets"] = static["beam/angle/offsets"] - 12 * 5 + 12 * 3
    q = np.concatenate([one.row(0)["q"][:36], two.row(0)["q"][60:120]])
    row = {"q": q, "beam/boom/resultant": one.row(0)["beam/boom/resultant"]}
    writer = ParaViewWriter(tmp_path, meta, static)
    (path,) = writer.write(0.0, row)
    points, cells, types, at_points, at_cells = read_vtu(path)
    assert types == [LINE] * 2 + [QUADRATIC] * 2
    assert cells == [[0, 1], [1, 2], [3, 8, 4], [5, 7, 6]]  # the angle's corner is there twice
    assert len(points) == 9
    np.testing.assert_array_equal(np.isnan(at_cells["N"]).all(1), [False, False, True, True])
    assert "Gamma" not in at_cells
    assert "v" not in at_points


def test_reference_state(make_scene, tmp_path):
    """Displacements from a given reference, also when the first frame is not the reference."""
    scene = make_scene()
    history = scene.history(3)
    history.static["reference"] = scene.coordinates(-1.0)
    write_paraview(history, tmp_path)
    points, _, _, at_points, _ = read_vtu(tmp_path / "beams" / "000000.vtu")
    want = scene.coordinates(-1.0)[:36].reshape(-1, 12)[:, :3]
    np.testing.assert_allclose((points - at_points["u"])[:3], want, atol=1e-15)
    writer = ParaViewWriter(tmp_path / "b", scene.meta, scene.static)
    writer.write(0.1, scene.row(1))  # the first frame is the reference
    points, _, _, at_points, _ = read_vtu(writer.write(0.2, scene.row(2))[0])
    now = scene.row(1)["q"][:36].reshape(-1, 12)[:, :3]
    np.testing.assert_allclose((points - at_points["u"])[:3], now, atol=1e-15)


def test_many_states_at_once_are_those_one_by_one(make_scene, tmp_path, monkeypatch):
    scene = make_scene(3)
    history = scene.history(4)
    monkeypatch.setattr(paraview, "TOGETHER", 3 * history["q"].shape[1])  # blocks of three
    write_paraview(history, tmp_path / "all", surfaces=True)
    writer = ParaViewWriter(tmp_path / "each", scene.meta, scene.static, surfaces=True)
    for k in range(4):
        for path in writer.write(float(history.times[k]), history.row(k)):
            points, cells, types, *data = read_vtu(path)
            again, *same = read_vtu(tmp_path / "all" / path.relative_to(tmp_path / "each"))
            assert same[:2] == [cells, types]
            np.testing.assert_allclose(points, again, rtol=0, atol=1e-13)
            for one, two in zip(data, same[2:], strict=True):
                assert set(one) == set(two)
                for name, values in one.items():
                    if values.dtype.kind == "U":
                        assert (values == two[name]).all()
                    else:
                        np.testing.assert_allclose(values, two[name], rtol=0, atol=1e-12)


def test_frames_are_thinned(make_scene, tmp_path):
    history = make_scene().history(31)

    def times(**options):
        return [t for t, _ in read_index(write_paraview(history, tmp_path, **options)[0])]

    assert times(every=10) == [history.times[k] for k in (0, 10, 20, 30)]
    assert times(fps=1000.0) == history.times.tolist()
    assert times(fps=3.0) == [history.times[k] for k in (0, 3, 7, 10, 13, 17, 20, 23, 27, 30)]
    assert times(fps=0.1) == [0.0]
    for options in ({"every": 0}, {"fps": 0.0}, {"fps": -1.0}, {"every": 2, "fps": 1.0}):
        with pytest.raises(InputError, match=next(iter(options))):
            times(**options)
    for count in (0, 1):
        index = write_paraview(history.truncated(count), tmp_path / f"{count}", fps=5.0)
        assert [len(read_index(each)) for each in index] == [1, 1, 1, 3] * count


def test_bad_folder_and_rows(make_scene, tmp_path):
    scene = make_scene()
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match=r"file.more.*cannot be written"):
        write_paraview(scene.history(1), tmp_path / "file" / "more")
    writer = ParaViewWriter(tmp_path / "out", scene.meta, scene.static)
    row = scene.row(0)
    for key, value, words in [
        ("q", None, "'q'.*missing"),
        ("joint/pin/position", np.zeros(2), r"joint/pin/position.*\(2,\)"),
        ("beam/boom/strain", np.zeros((2, 7, 6)), r"beam/boom/strain.*\(2, 7, 6\)"),
    ]:
        bad = {k: v for k, v in {**row, key: value}.items() if v is not None}
        with pytest.raises(InputError, match=words):
            writer.write(0.0, bad)
    assert writer.indices == []  # nothing half done
    for key, words in [("beam/boom/gauss", "boom"), ("body/hub/offset", "hub")]:
        with pytest.raises(InputError, match=words):
            ParaViewWriter(
                tmp_path, scene.meta, {k: v for k, v in scene.static.items() if k != key}
            )


def test_joints_without_places_are_left_out(make_scene, tmp_path):
    """A run that was killed has coordinates only."""
    scene = make_scene()
    writer = ParaViewWriter(tmp_path, scene.meta, scene.static)
    row = scene.row(1)
    del row["joint/pin/position"]
    writer.write(0.0, row)
    points, _, _, at_points, _ = read_vtu(tmp_path / "joints" / "000000.vtu")
    np.testing.assert_array_equal(points, [row["joint/weld/position"]])
    np.testing.assert_array_equal(at_points["joint_id"], [1])
    assert "force" not in at_points
    writer = ParaViewWriter(tmp_path, scene.meta, scene.static)
    files = writer.write(0.0, {"q": row["q"]})
    assert len(files) == len(writer.write(0.1, {"q": row["q"]})) == 2
    assert [path.stem for path in writer.indices] == ["beams", "bodies", "scene"]
    assert len(read_index(tmp_path / "beams.pvd")) == 2
    states = {name: [row[name]] for name in ("t", "step", "q", "p")}
    killed = History(scene.meta, scene.static, states)
    with pytest.warns(
        IncompleteWarning, match=r"not recorded \(v, beam/boom/resultant.*derive_series"
    ):
        assert len(write_paraview(killed, tmp_path)) == 3


EXPORT = """
import sys
from conftest import Scene
from skfem_cosserat.export import ParaViewWriter
scene = Scene(2)
writer = ParaViewWriter(sys.argv[1], scene.meta, scene.static)
k = 0
while True:
    writer.write(0.1 * k, scene.row(k))
    k += 1
"""


@pytest.mark.slow
def test_killed_export_can_be_read(make_scene, tmp_path):
    path = os.pathsep.join([str(HERE), str(HERE.parent), os.environ.get("PYTHONPATH", "")])
    process = subprocess.Popen(
        [sys.executable, "-c", EXPORT, str(tmp_path)], env={**os.environ, "PYTHONPATH": path}
    )
    try:
        limit = time.monotonic() + 30.0
        while not (tmp_path / "beams" / "000030.vtu").exists():
            assert process.poll() is None
            assert time.monotonic() < limit
            time.sleep(0.01)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    scene = make_scene(2)
    for name in ("beams", "bodies", "joints"):
        frames = read_index(tmp_path / f"{name}.pvd")
        assert len(frames) >= 30
        for k in (0, len(frames) - 1):
            assert frames[k][0] == 0.1 * k
            points = read_vtu(tmp_path / frames[k][1])[0]
            if name == "beams":
                np.testing.assert_array_equal(points[1], scene.row(k)["q"][12:15])


# -- geometry --------------------------------------------------------------------------------


def test_quaternions_of_all_rotations():
    rng = np.random.default_rng(1)
    r = rng.normal(size=(200, 4))
    r[:8] = np.vstack([np.eye(4), [[1e-9, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1], [1, 1, 1, 1]]])
    r /= np.linalg.norm(r, axis=1, keepdims=True)
    directors = np.swapaxes(rotations(r), 1, 2)
    got = quaternions(directors)
    assert (got[:, 0] >= 0.0).all()
    np.testing.assert_allclose(rotations(got), rotations(r), atol=1e-14)
    np.testing.assert_allclose(quaternions(1.2 * directors), got, atol=1e-14)


def test_outline_may_repeat_its_first_point(make_scene):
    scene = make_scene()
    before = BeamShape("boom", scene.static).surface()
    scene.static["beam/boom/outline/0"] = np.vstack([OUTLINE, OUTLINE[:1]])
    after = BeamShape("boom", scene.static).surface()
    q = scene.row(1)["q"]
    np.testing.assert_array_equal(before.points(q), after.points(q))
    assert len(before.caps) == 2


# -- tables ----------------------------------------------------------------------------------


def test_csv_keeps_every_digit(make_scene, tmp_path):
    history = make_scene().history(5)
    history.add_series("gap", np.array([np.nan, np.inf, 0.1, 1e-300, -0.0]))
    path = write_csv(history, tmp_path / "run.csv")
    lines = path.read_text(encoding="utf-8").splitlines()
    comments = [line for line in lines if line.startswith("#")]
    assert any("versions" in line and np.__version__ in line for line in comments)
    assert any("Synthetic" in line for line in comments)
    table = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert next(iter(table[0])) == "t"
    assert not any(name.startswith(("q", "p_", "v", "beam/")) for name in table[0])
    for name in ("t", "energy", "gap"):
        np.testing.assert_array_equal([float(row[name]) for row in table], history[name])
    columns = [[float(row[f"momentum_{axis}"]) for row in table] for axis in "xyz"]
    np.testing.assert_array_equal(np.array(columns).T, history["momentum"])
    write_csv(history, path, ["energy", "q"])
    assert "\nenergy,q_0,q_1" in path.read_text()
    write_csv(history.truncated(0), path)


def test_csv_refuses(make_scene, tmp_path):
    history = make_scene().history(2)
    with pytest.raises(InputError, match="nothing"):
        write_csv(history, tmp_path / "a.csv", ["nothing"])
    with pytest.raises(InputError, match="scalars and vectors"):
        write_csv(history, tmp_path / "a.csv", ["beam/boom/strain"])
    with pytest.raises(InputError, match="cannot be written"):
        write_csv(history, tmp_path / "no" / "a.csv")


@pytest.mark.skipif(sys.platform == "win32", reason="limits of a process are POSIX")
def test_an_index_that_finds_no_room_stays_complete(tmp_path):
    """A full disk takes a part of a line, and of what closes the file."""
    import resource

    path = tmp_path / "beams.pvd"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    for room in range(500, 580, 3):
        path.unlink(missing_ok=True)
        index, frames = _Index(path), [(float(k), Path(f"beams/{k:06d}.vtu")) for k in range(100)]
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, limits[1]))
        try:
            with pytest.raises(OSError, match="too large"):
                [index.add(time, [path]) for time, path in frames]
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        frames = [each.get("file") for each in ET.parse(path).findall(".//DataSet")]
        assert frames == [f"beams/{k:06d}.vtu" for k in range(len(frames))]
        assert len(frames) >= 3


@pytest.mark.skipif(sys.platform == "win32", reason="limits of a process are POSIX")
def test_a_frame_that_finds_no_room_is_not_in_the_index(make_scene, tmp_path):
    import resource

    scene = make_scene()
    writer = ParaViewWriter(tmp_path, scene.meta, scene.static)
    writer.write(0.0, scene.row(0))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1500, limits[1]))
    try:
        with pytest.raises(StorageError, match=r"cannot be written: .* too large") as full:
            writer.write(0.1, scene.row(1))
        assert Path(full.value.path).parent.parent == tmp_path
        with pytest.raises(StorageError, match=r"rows\.csv"):
            write_rows(tmp_path / "rows.csv", {}, ["t"], [[0.1]] * 1000)
        with pytest.raises(StorageError, match=r"line\.msh"):
            write_mesh(tmp_path / "line.msh", MeshCurve.init_line((0, 0, 0), (1, 0, 0), 100))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    for name in ("beams", "bodies", "joints"):
        assert [t for t, _ in read_index(tmp_path / f"{name}.pvd")] == [0.0]
    writer.write(0.1, scene.row(1))  # there is room again
    assert [t for t, _ in read_index(tmp_path / "beams.pvd")] == [0.0, 0.1]
