"""Pictures of the guide's pages 08 and 11: embedded, small, made by their script."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

GUIDE = Path(__file__).resolve().parents[2] / "examples" / "guide"
PAGES = "08_paraview_and_pictures", "11_theory"


def embedded() -> set[str]:
    texts = [(GUIDE / f"{page}.md").read_text(encoding="utf-8") for page in PAGES]
    return {name for text in texts for name in re.findall(r"\]\(pictures/([\w.]+)\)", text)}


def script():
    path = GUIDE / "make_page_pictures.py"
    spec = importlib.util.spec_from_file_location("make_page_pictures", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_pictures_are_embedded_and_small():
    pictures = [
        path for path in (GUIDE / "pictures").glob("*.png") if path.stem[:2] in ("08", "11")
    ]
    assert {path.name for path in pictures} == embedded()
    assert all(path.stat().st_size < 60e3 for path in pictures)


@pytest.mark.slow
def test_the_blocks_of_a_page_give_its_scene(tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib")  # the script draws with it
    monkeypatch.chdir(tmp_path)
    history = script().scene(GUIDE / f"{PAGES[0]}.md", 2)["history"]
    assert history.status == "completed"
    assert (tmp_path / "swing" / "beam_surfaces" / "000060.vtu").is_file()
    assert "beams.pvd" in capsys.readouterr().out


@pytest.mark.slow
def test_the_picture_of_signs_is_made(tmp_path):
    pytest.importorskip("matplotlib")
    (path,) = script().page_11(tmp_path)
    assert path.name in embedded()
    assert path.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_positive_moments_bend_as_drawn():
    """The tangent d3 turns towards -d2 for M_1 > 0, towards d1 for M_2 > 0."""
    import skfem_cosserat as sc

    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    section = sc.Section((1e4, 1e4, 1e4, 1, 1, 1), mass=1.0, inertia=(1e-3, 1e-3))
    for axis, towards in (((0, 1, 0), (0, 0, -1)), ((0, 0, 1), (0, 1, 0))):  # d1 = y, d2 = z
        model = sc.Model()
        rod = model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0)))
        model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
        model.add("moment", sc.LoadMoment(rod.node("rod.end"), [0.3 * each for each in axis]))
        path = sc.static(model)
        moved = path.position(rod.node("rod.end"))[-1] - (1, 0, 0)
        assert moved @ towards > 0.1
        resultant = path["beam/rod/resultant"][-1, 0, 0]
        assert resultant[3:] == pytest.approx([0.3 * axis[1], 0.3 * axis[2], 0], abs=2e-3)
