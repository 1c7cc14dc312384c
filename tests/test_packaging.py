"""The wheel holds the package and nothing else; the repository holds what the design names."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "skfem_cosserat"
TOP_LEVEL = {"pyproject.toml", "skfem_cosserat", "meshes", "examples", "tests", "README.md"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel from a copy: leftovers of an older build in the tree do not get in."""
    folder = tmp_path_factory.mktemp("wheel")
    leave_out = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "dist")
    shutil.copytree(ROOT, folder / "source", ignore=leave_out)
    build = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation"]
    subprocess.run([*build, "-w", str(folder), str(folder / "source")], check=True)
    (built,) = folder.glob("*.whl")
    return built


def test_wheel_holds_every_module_and_nothing_else(wheel: Path):
    names = {n for n in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in n}
    modules = {path.relative_to(ROOT).as_posix() for path in PACKAGE.rglob("*.py")}
    assert names == modules | {"skfem_cosserat/LICENSE", "skfem_cosserat/py.typed"}


def test_wheel_names_its_licence(wheel: Path):
    with zipfile.ZipFile(wheel) as archive:
        (metadata,) = [n for n in archive.namelist() if n.endswith(".dist-info/METADATA")]
        lines = archive.read(metadata).decode().splitlines()
    assert "License-Expression: BSD-3-Clause" in lines
    assert "License-File: skfem_cosserat/LICENSE" in lines


def test_wheel_imports_without_the_repository(wheel: Path, tmp_path: Path):
    """Imports the package from the wheel alone; tests and examples are not installed with it."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import skfem_cosserat as s"
    result = subprocess.run(
        [sys.executable, "-I", "-c", code + "; print(s.__file__)"],
        cwd=tmp_path,
        check=True,
        capture_output=True,
        text=True,
    )
    assert Path(result.stdout.strip()).is_relative_to(tmp_path)


def test_top_level_of_the_repository():
    if shutil.which("git") is None:
        pytest.skip("git is not installed")
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    tracked = {name.split("/")[0] for name in listed.stdout.split("\0") if name}
    if not tracked:
        pytest.skip("not a git clone")
    assert {name for name in tracked if not name.startswith(".")} == TOP_LEVEL
