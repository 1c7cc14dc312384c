"""What is imported when, and names that the package has; layers are checked by import-linter."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import skfem_cosserat as sc

PACKAGE = Path(sc.__file__ or "").parent
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
#: packages and modules for meshes, elements, beams and sections
MESHED = (
    *("skfem", "meshio", "skfem_cosserat.mesh", "skfem_cosserat.basis", "skfem_cosserat.element"),
    *("skfem_cosserat.basis", "skfem_cosserat.beam", "skfem_cosserat.section"),
    *("skfem_cosserat.hyperelastic", "skfem_cosserat.profile"),
)
RIGID = """
import sys
import skfem_cosserat as sc
model = sc.Model()
link = model.add("link", sc.RigidBody.box(2.0, (0.1, 0.1, 1.0)))
hinge = sc.JointRevolute(sc.ground((0, 0, 0.5)), link.local((0, 0, 0.5)), axis=(1, 0, 0))
model.add("hinge", hinge)
model.add("spring", sc.JointSpringDamper(hinge, stiffness=3.0, damping=0.1))
model.add("ball", sc.MassPoint(1.0, on=link.local((0, 0, -0.5))))
model.add("weight", sc.LoadGravity((0, 1.0, -9.81)))
model.add("drag", sc.RayleighDamping(mass=0.1))
for planar in (None, sc.Planar()):
    system = model.freeze(planar=planar)
    for scheme in (sc.EnergyMomentum(), sc.Variational(), sc.GeneralizedAlpha(0.8)):
        for treatment in (sc.NullSpace(), sc.Multipliers()):
            sc.simulate(system, scheme, treatment, 1e-2, 0.05)
    path = sc.static(system)
    sc.modes(system, path, count=1)
print([name for name in sys.modules])
"""
#: packages that a scene of beams does without: files, splines, welding, kernels, equilibria
HEAVY = (
    *("meshio", "rich", "numba", "llvmlite", "scipy.interpolate", "scipy.optimize"),
    *("scipy.spatial", "scipy.special", "scipy.fft", "scipy.signal", "matplotlib", "pyvista"),
)
BEAM = """
import os, sys, tempfile
import skfem_cosserat as sc
model = sc.Model()
section = sc.SectionCircle(5e-3, sc.Material(5e6, 0.5, 1100))
mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4)
path = os.path.join(tempfile.mkdtemp(), "rod.msh")
sc.write_mesh(path, mesh)
rod = model.add("rod", sc.Beam(sc.read_mesh(path), section, order=2))
model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("beam.start")))
model.add("tip", sc.LoadForce(rod.node("beam.end"), (0, 0, 1.0)))
system = model.freeze()
frozen = list(sys.modules)
sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, 5e-3, kernels="numpy")
import skfem_cosserat.export
print([frozen, list(sys.modules)])
"""


def modules_of(code: str) -> list[Any]:
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=PACKAGE.parent, capture_output=True, text=True, check=True
    )
    return list(ast.literal_eval(run.stdout.splitlines()[-1]))


@pytest.mark.slow
def test_rigid_bodies_import_no_meshes_and_no_beams():
    """Motion in space and in a plane, both treatments, equilibria, vibrations."""
    found = modules_of(RIGID)
    meshed = [n for n in found if any(n == m or n.startswith(f"{m}.") for m in MESHED)]
    assert meshed == []
    assert "skfem_cosserat.statics.path" in found


@pytest.mark.slow
def test_beams_import_nothing_that_is_heavy_and_seldom_needed():
    """Neither building and freezing a scene, gmsh files, steps of plain kernels, nor exports.

    Before a run nothing of its layers is imported either.
    """
    frozen, run = modules_of(BEAM)
    for found in (frozen, run):
        assert [n for n in found if any(n == m or n.startswith(f"{m}.") for m in HEAVY)] == []
    own = {n.split(".")[1] for n in frozen if n.startswith("skfem_cosserat.")}
    layers = {"compiled", "newton", "constraints", "integrators", "history", "diagnostics", "run"}
    assert not own & (layers | {"linear", "statics", "modal", "study", "export"})
    assert "skfem_cosserat.run.loop" in run


def test_the_package_imports_nothing_of_its_own_before_it_is_asked():
    found = modules_of("import sys, skfem_cosserat; print([name for name in sys.modules])")
    own = [n for n in found if n.startswith("skfem_cosserat")]
    assert own == ["skfem_cosserat.version", "skfem_cosserat"]
    assert "numpy" not in found


def test_names_are_where_they_are_said_to_be():
    """What the stub says is what there is, and what ``*`` and completion bring."""
    seen = {
        alias.name: node.module
        for node in ast.parse((PACKAGE / "__init__.pyi").read_text(encoding="utf-8")).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert sorted(seen) == sorted(sc.__all__) == sorted(set(sc.__all__))
    for name, module in seen.items():
        if module is None:
            assert getattr(sc, name) is sys.modules[f"skfem_cosserat.{name}"]
        else:
            assert getattr(sc, name) is getattr(sys.modules[f"skfem_cosserat.{module}"], name)
    assert [name for name in dir(sc) if not name.startswith("_")] == sorted(sc.__all__)
    with pytest.raises(AttributeError, match="No skfem_cosserat attribute sys"):
        sc.sys  # noqa: B018


@pytest.mark.slow
def test_no_module_needs_an_optional_package():
    run = [sys.executable, "-c", IMPORT_ALL.format(optional=OPTIONAL)]
    result = subprocess.run(run, cwd=PACKAGE.parent, capture_output=True, text=True, check=False)
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
