"""Programs of the paper and of the benchmarks: where they start, what importing them does."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import skfem

import skfem_cosserat as sc

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
FOLDERS = ("paper", "benchmarks")
PROGRAMS = [path for folder in FOLDERS for path in sorted((EXAMPLES / folder).glob("*.py"))]
FRONTS = ("three_bar_swing", "six_body_linkage", "reproduce_paper")


def load(path: Path) -> Any:
    """A file as a module of its own, whatever is in sys.path."""
    spec = importlib.util.spec_from_file_location(f"loaded_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def elsewhere(code: str, folder: Path) -> str:
    """What a fresh interpreter prints that knows the package, but not the examples."""
    places = {Path(m.__file__ or "").parents[1] for m in (sc, skfem)}
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(str(p) for p in places)}
    command = [sys.executable, "-c", code]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=True
    ).stdout


@pytest.mark.one_quick
@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_import_has_no_side_effects(path, tmp_path, monkeypatch, capfd):
    if path.stem == "charts":
        pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    load(path)
    assert capfd.readouterr().out == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_fronts_load_from_another_folder(tmp_path):
    """By their path alone, each in a fresh interpreter's empty ``sys.path``."""
    pytest.importorskip("matplotlib")
    code = (
        "import importlib.util as u\n"
        f"for name in {FRONTS}:\n"
        f"    spec = u.spec_from_file_location(name, {str(EXAMPLES)!r} + '/' + name + '.py')\n"
        "    module = u.module_from_spec(spec)\n"
        "    spec.loader.exec_module(module)\n"
        "    print(module.main.__module__)\n"
    )
    modules = ["paper.three_bar_swing", "paper.six_body_linkage", "reproduce_paper"]
    assert elsewhere(code, tmp_path).split() == modules


@pytest.mark.slow
@pytest.mark.parametrize("name", FRONTS)
def test_front_tells_its_choices(name, tmp_path):
    pytest.importorskip("matplotlib")
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), "--help"]
    found = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "--out" in found.stdout and name in found.stdout
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_program_has_a_line_in_its_readme(folder):
    text = (EXAMPLES / folder / "README.md").read_text(encoding="utf-8")
    missing = [p.name for p in PROGRAMS if p.parent.name == folder and f"`{p.name}`" not in text]
    assert missing == ["__init__.py"]
