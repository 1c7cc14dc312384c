"""The command line: what it says of files is in them, what it refuses it says in one line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat.__main__ import main
from skfem_cosserat.history import HistoryWriter

MESH = str(Path(__file__).resolve().parents[2] / "meshes" / "cantilever.msh")


@pytest.fixture
def file(tmp_path, monkeypatch):
    """A run in a file; the working directory is where it is."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(2.0, velocity=(1.0, 0, 3.0)))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    seen = {"where": sc.SensorPosition(ball.place())}
    monkeypatch.chdir(tmp_path)
    options = {"path": tmp_path / "run.history", "sensors": seen}
    sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.1, until=0.5, **options)
    return "run.history"


def said(capsys, *words):
    assert main(list(words)) == 0
    return capsys.readouterr().out


def test_info(file, capsys, tmp_path):
    lines = said(capsys, "info", file).splitlines()
    assert {"step in s: 0.1", "states: 6", "time in s: [0, 0.5]", "sensors: where: m"} <= {*lines}
    assert "length in m: 1" in said(capsys, "info", MESH).splitlines()
    writer = HistoryWriter({"step": 0.1}, {}, "killed.history", block=1)
    writer.append({"t": 0.0, "step": 0, "q": np.zeros(3), "p": np.zeros(3)})
    (line,) = (x for x in said(capsys, "info", "killed.history").splitlines() if "status" in x)
    assert line.startswith("status: killed: the run did not end") and "derive_series" in line
    writer.close()


def test_files_are_written(file, capsys, tmp_path):
    pytest.importorskip("matplotlib")
    assert said(capsys, "plot", file, "energy", "-o", "a.png", "where") == "a.png\n"
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    index = said(capsys, "paraview", file, "-o", "seen", "--every", "2").splitlines()
    times = re.findall(r'timestep="([0-9.]+)"', Path(index[0]).read_text())
    assert sorted({float(t) for t in times}) == [0.0, 0.2, 0.4]
    pytest.importorskip("plotly")
    assert said(capsys, "report", file, "-o", "a.html") == "a.html\n"
    assert "6 of 6 states" in (tmp_path / "a.html").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.usefixtures("renderer")
def test_a_film_and_the_picture_of_a_mesh(file, capsys, tmp_path):
    from PIL import Image

    assert said(capsys, "film", file, "-o", "a.gif", "--fps", "10", "--speed", "0.5") == "a.gif\n"
    with Image.open(tmp_path / "a.gif") as film:
        assert film.n_frames == 11  # 1 s of film for 0.5 s
    assert said(capsys, "plot", MESH, "-o", "mesh.png") == "mesh.png\n"
    with Image.open(tmp_path / "mesh.png") as picture:
        assert len(picture.getcolors(2**24)) > 10


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["info", "missing"], "no such file"),
        (["plot", ".", "-o", "a.png"], "no such file"),
        (["info", "empty"], "is empty"),
        (["info", "text"], "is not a history"),
        (["info", "text.msh"], "text.msh"),
        (["plot", "run.history", "were", "-o", "a.png"], "did you mean 'where'"),
        (["plot", "run.history", "-o", "no/a.png"], "folder 'no'"),
        (["plot", MESH, "tip", "-o", "a.png"], "is a mesh"),
        (["plot", MESH, "-o", "a.png", "tip"], "is a mesh"),
        (["film", MESH, "-o", "a.gif"], "is a mesh"),
        (["report", MESH, "-o", "a.html"], "is a mesh"),
        (["paraview", "run.history", "-o", "a", "--every", "0"], "every"),
    ],
)
def test_what_is_refused(file, capsys, tmp_path, words, reason):
    (tmp_path / "empty").touch()
    for name in ("text", "text.msh"):
        (tmp_path / name).write_text("a poem\n")
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"python -m skfem_cosserat {words[0]}: ") and reason in line
