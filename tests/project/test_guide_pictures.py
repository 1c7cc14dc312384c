"""The pictures of the guide: embedded, small, made by their scripts."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

import pytest

import skfem_cosserat as sc

GUIDE = Path(__file__).resolve().parents[2] / "examples" / "guide"
FIRST = "01_first_steps", "02_scenes"
LATER = "08_paraview_and_pictures", "11_theory"


def embedded(pages: tuple[str, ...]) -> set[str]:
    """Names of the pictures of some pages."""
    texts = [(GUIDE / f"{page}.md").read_text(encoding="utf-8") for page in pages]
    return {name for text in texts for name in re.findall(r"\]\(pictures/(\w+)\.png\)", text)}


@pytest.fixture
def first(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Script of the first pages' pictures."""
    pytest.importorskip("matplotlib")
    monkeypatch.syspath_prepend(GUIDE)
    import make_pictures

    return make_pictures


@pytest.fixture
def later(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Script of the pictures of pages 08 and 11."""
    pytest.importorskip("matplotlib")
    monkeypatch.syspath_prepend(GUIDE)
    import make_page_pictures

    return make_page_pictures


def test_pages_embed_what_the_script_makes(first: ModuleType):
    assert embedded(FIRST) == set(first.NAMES)


def test_all_pictures_are_there_and_small():
    def size(name: str) -> int:
        return (GUIDE / "pictures" / f"{name}.png").stat().st_size

    assert sum(map(size, embedded(FIRST))) < 600e3
    assert all(size(name) < 60e3 for name in embedded(LATER))


@pytest.mark.one_quick
@pytest.mark.parametrize("name", ["joint_revolute", "mesh_helix"])
def test_a_picture_is_made(first: ModuleType, tmp_path: Path, name: str):
    path = first.draw(name, tmp_path)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert path.stat().st_size > 1000


@pytest.mark.slow
def test_the_blocks_of_a_page_give_its_scene(
    later: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    assert later.scene(GUIDE / f"{LATER[0]}.md", 2)["history"].status == "completed"
    assert (tmp_path / "swing" / "beam_surfaces" / "000060.vtu").is_file()


@pytest.mark.slow
def test_the_picture_of_signs_is_made(later: ModuleType, tmp_path: Path):
    (path,) = later.page_11(tmp_path)
    assert path.stem in embedded(LATER)
    assert path.read_bytes().startswith(b"\x89PNG")


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("moment", "towards"), [((0, 0.3, 0), (0, 0, -1)), ((0, 0, 0.3), (0, 1, 0))]
)
def test_positive_moments_bend_as_drawn(moment, towards):
    """The tangent d3 turns towards -d2 for M_1 > 0, towards d1 for M_2 > 0; d1 is y, d2 is z."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    section = sc.Section((1e4, 1e4, 1e4, 1, 1, 1), mass=1.0, inertia=(1e-3, 1e-3))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("moment", sc.LoadMoment(rod.node("rod.end"), moment))
    path = sc.static(model)
    moved = path.position(rod.node("rod.end"))[-1] - (1, 0, 0)
    assert moved @ towards > 0.1
    resultant = path["beam/rod/resultant"][-1, 0, 0]
    assert resultant[3:] == pytest.approx([moment[1], moment[2], 0], abs=2e-3)
