"""The wheel holds the package and nothing else; the repository holds what the design names."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
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


@pytest.mark.slow
def test_wheel_holds_every_module_and_nothing_else(wheel: Path):
    names = {n for n in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in n}
    modules = {path.relative_to(ROOT).as_posix() for path in PACKAGE.rglob("*.py")}
    assert names == modules | {
        f"skfem_cosserat/{name}"
        for name in ("CHANGES", "LICENSE", "__init__.pyi", "py.typed", "report.html")
    }


@pytest.mark.slow
def test_wheel_names_its_licence(wheel: Path):
    with zipfile.ZipFile(wheel) as archive:
        (metadata,) = [n for n in archive.namelist() if n.endswith(".dist-info/METADATA")]
        lines = archive.read(metadata).decode().splitlines()
    assert "License-Expression: BSD-3-Clause" in lines
    assert "License-File: skfem_cosserat/LICENSE" in lines


#: what is run with the installed wheel: a scene, its file, and where the package lies
SCENE = """
import pathlib
import skfem_cosserat as sc
mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
sc.write_mesh("rod.msh", mesh)
model = sc.Model()
section = sc.SectionCircle(0.02, sc.Material(1e7, 0.3, 1e3))
rod = model.add("rod", sc.Beam(sc.read_mesh("rod.msh"), section, director=(0, 1, 0)))
model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 1, 0)))
model.add("weight", sc.LoadGravity((0, 0, -9.81)))
run = sc.EnergyMomentum(), sc.NullSpace(), 0.01
history = sc.simulate(model.freeze(), *run, until=0.1, path="run.history")
assert sc.History.load("run.history")["q"].tolist() == history["q"].tolist()
print(history.status, pathlib.Path(sc.__file__).parent)
"""


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Python of an environment of its own with the wheel; its dependencies are those of ours."""
    folder = tmp_path_factory.mktemp("installed")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    found = folder / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    install = ["pip", "--python", str(found), "install", "-q", "--no-deps", "--no-index"]
    subprocess.run([sys.executable, "-m", *install, str(wheel)], check=True)
    where = [str(found), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
    run = subprocess.run(where, check=True, capture_output=True, text=True)
    ours = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    (Path(run.stdout.strip()) / "dependencies.pth").write_text("\n".join(sorted(ours)))
    return found


@pytest.mark.slow
def test_installed_wheel_runs_a_scene(python: Path, tmp_path: Path):
    """Away from the repository, whose tests and examples are not installed."""
    run = subprocess.run(
        [str(python), "-I", "-c", SCENE],
        cwd=tmp_path,
        check=True,
        capture_output=True,
        text=True,
    )
    status, place = run.stdout.split(maxsplit=1)
    assert status == "completed"
    assert Path(place.strip()).is_relative_to(python.parent.parent)


@pytest.mark.slow
def test_installed_wheel_shows_its_changes(python: Path, tmp_path: Path):
    run = [str(python), "-I", "-m", "skfem_cosserat"]
    shown = subprocess.run([*run, "changes"], cwd=tmp_path, check=True, capture_output=True)
    assert shown.stdout == (PACKAGE / "CHANGES").read_bytes()
    wrong = subprocess.run([*run, "changed"], cwd=tmp_path, capture_output=True, check=False)
    assert wrong.returncode == 2 and b"choose from" in wrong.stderr


def test_a_reader_that_has_enough_ends_the_command_line_quietly():
    """As ``head`` does."""
    run = [sys.executable, "-m", "skfem_cosserat", "changes"]
    with subprocess.Popen(run, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0


def test_minimum_versions_are_pinned():
    """What .ci/minimum-versions can read: each of the hard dependencies and tools has one."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    tools = [each for each in project["optional-dependencies"]["test"] if "[" not in each]
    for each in project["dependencies"] + tools:
        assert re.fullmatch(r"[\w-]+>=[\d.]+", each)


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
