"""What a module of the package needs, and what none does; layers are checked by import-linter."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "skfem_cosserat"
OPTIONAL = ("pyvista", "matplotlib", "vtk", "vtkmodules", "numba", "llvmlite", "pypardiso")
OPTIONAL += ("shapely", "distributed", "h5py", "tqdm")
#: modules of kernels import numba; they are themselves imported in functions only
IMPORT_ALL = """
import importlib, pkgutil, sys
import skfem_cosserat
assert not [name for name in {optional} if name in sys.modules], "imported with the package"
sys.modules.update(dict.fromkeys({optional}))
for module in pkgutil.walk_packages(skfem_cosserat.__path__, "skfem_cosserat."):
    if ".compiled." not in module.name and "__main__" not in module.name:
        importlib.import_module(module.name)
"""


@pytest.mark.slow
def test_no_module_needs_an_optional_package() -> None:
    code = IMPORT_ALL.format(optional=OPTIONAL)
    result = subprocess.run(
        [sys.executable, "-c", code],
        cwd=PACKAGE.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr


@pytest.mark.slow
def test_what_a_user_should_know_is_no_log_message() -> None:
    """It is said by `warn`: nobody reads a log that he did not set up."""
    found = [
        f"{path}:{node.lineno}: {ast.unparse(node.func)}"
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and ast.unparse(node.func).startswith("logger.")
        if ast.unparse(node.func) not in {"logger.info", "logger.debug", "logger.addHandler"}
    ]
    assert not found
