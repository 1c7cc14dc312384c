"""The pictures of the guide's first pages: the script makes them, and all that are embedded."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

import pytest

GUIDE = Path(__file__).resolve().parents[2] / "examples" / "guide"
PAGES = [GUIDE / "01_first_steps.md", GUIDE / "02_scenes.md"]
_PICTURE = re.compile(r"\]\(pictures/(\w+)\.png\)")


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    pytest.importorskip("matplotlib")
    monkeypatch.syspath_prepend(GUIDE)
    import make_pictures

    return make_pictures


def embedded() -> set[str]:
    return {name for page in PAGES for name in _PICTURE.findall(page.read_text(encoding="utf-8"))}


def test_pages_embed_what_the_script_makes(script: ModuleType):
    assert embedded() == set(script.NAMES)


def test_all_pictures_are_there_and_small():
    files = [GUIDE / "pictures" / f"{name}.png" for name in embedded()]
    assert sum(file.stat().st_size for file in files) < 600e3


@pytest.mark.one_quick
@pytest.mark.parametrize("name", ["joint_revolute", "mesh_helix"])
def test_a_picture_is_made(script: ModuleType, tmp_path: Path, name: str):
    path = script.draw(name, tmp_path)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert path.stat().st_size > 1000


def test_unknown_pictures_are_refused(script: ModuleType, tmp_path: Path):
    with pytest.raises(KeyError, match="joint_of_cheese"):
        script.draw("joint_of_cheese", tmp_path)
