"""Only what is in a scene is paid for: imports, what is computed once, what is never called."""

from __future__ import annotations

import ast
import cProfile
import pstats
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers_scenes import swing

import skfem_cosserat as sc
from skfem_cosserat.model.loading import Loading
from skfem_cosserat.pattern import FrozenPattern
from skfem_cosserat.time_function import Constant

PACKAGE = Path(sc.__file__ or "").parent
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


def test_rigid_bodies_import_no_meshes_and_no_beams():
    """Motion in space and in a plane, both treatments, equilibria, vibrations."""
    found = modules_of(RIGID)
    meshed = [n for n in found if any(n == m or n.startswith(f"{m}.") for m in MESHED)]
    assert meshed == []
    assert "skfem_cosserat.statics.path" in found


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
    assert set(sc.__all__) <= set(dir(sc))
    assert [name for name in dir(sc) if not name.startswith("_")] == sorted(sc.__all__)
    for name in ("no_such_name", "sys", "Any"):
        with pytest.raises(AttributeError, match=f"No skfem_cosserat attribute {name}"):
            getattr(sc, name)


# -- computed once ---------------------------------------------------------------------------------


def counted(monkeypatch: pytest.MonkeyPatch, owner: Any, name: str, calls: Counter[str]) -> None:
    original = getattr(owner, name)

    def count(*args: Any, **kwargs: Any) -> Any:
        calls[name] += 1
        return original(*args, **kwargs)

    monkeypatch.setattr(owner, name, count)


@pytest.mark.parametrize("treatment", [sc.NullSpace(), sc.Multipliers()], ids=str)
@pytest.mark.parametrize("scheme", [sc.EnergyMomentum(), sc.Variational()], ids=str)
def test_constant_loads_masses_and_patterns_are_computed_once(
    scheme: Any, treatment: Any, monkeypatch: pytest.MonkeyPatch
):
    from skfem_cosserat.beam import Beam

    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="rod")
    section = sc.SectionCircle(5e-3, sc.Material(5e6, 0.5, 1100))
    rod = model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0)))
    model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), (0, 0, 1)))
    model.add("weight", sc.LoadGravity((0, -9.81, 0)))
    model.add("wind", sc.LoadLine(rod, (0, 0.1, 0.0)))
    model.add("moment", sc.LoadMoment(rod.node("rod.end"), (0, 0, 1e-4)))
    system = model.freeze()
    calls: Counter[str] = Counter()
    for owner, name in (
        (FrozenPattern, "__init__"),
        (Beam, "scalar_mass"),
        (Constant, "value"),
        (Constant, "average"),
        (Loading, "_dead"),
        (Loading, "_sum"),
    ):
        counted(monkeypatch, owner, name, calls)
    found = []
    for steps in (5, 25):
        calls.clear()
        sc.simulate(system, scheme, treatment, 1e-3, steps * 1e-3, kernels="numpy", derive=False)
        found.append(dict(calls))
    few, many = found
    # the first run makes what the system keeps
    assert few.get("__init__", 0) >= many.get("__init__", 0)
    assert "scalar_mass" not in few | many
    assert "_dead" not in few | many
    assert few.get("value") == 3  # of three loads
    assert few.get("_sum") == 1
    assert "average" not in few | many
    assert set(many) <= {"__init__"}  # and not even once in another run


def rods(count: int) -> sc.Model:
    """So many clamped rods, each with a force and a line load."""
    model, section = sc.Model(), sc.SectionCircle(5e-3, sc.Material(5e6, 0.5, 1100))
    for k in range(count):
        rod = sc.Beam(sc.MeshCurve.init_line((k, 0, 0), (k, 1, 0), 3, name=f"rod{k}"), section)
        model.add(f"rod{k}", rod)
        model.add(f"clamp{k}", sc.JointFixed(sc.ground((k, 0, 0)), rod.node(0)))
        model.add(f"tip{k}", sc.LoadForce(rod.node(3), (0, 0, 0.1)))
        model.add(f"wind{k}", sc.LoadLine(rod, (0, 0, 0.1)))
    return model


def test_freezing_costs_as_much_as_there_is(monkeypatch: pytest.MonkeyPatch):
    """Masses of each beam once, a row of a load as long as what it acts on, no full mass blocks."""
    from skfem_cosserat.beam import Beam

    calls: Counter[str] = Counter()
    counted(monkeypatch, Beam, "scalar_mass", calls)
    entries = []
    for count in (40, 80):
        model = rods(count)
        calls.clear()
        system = model.freeze()
        assert calls == {"scalar_mass": count}
        assert all("mass" not in vars(group) for group in system.groups)
        entries.append(system.loading.dead.nnz)
    assert entries == [40 * 5, 80 * 5]


# -- never called ----------------------------------------------------------------------------------


def growing(run: Callable[[int], object]) -> set[str]:
    """Modules of the package of which more functions are called the longer a run is."""
    found = []
    run(4)  # what is imported then is imported
    for steps in (24, 48):  # longer than the looks at some states at the end of a run
        profile = cProfile.Profile()
        profile.enable()
        run(steps)
        profile.disable()
        calls: Counter[str] = Counter()
        for (file, _, _), (count, *_) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
            if file.startswith(str(PACKAGE)):
                calls[str(Path(file).relative_to(PACKAGE).with_suffix(""))] += count
        found.append(calls)
    return {name for name, count in found[1].items() if count > found[0][name]}


def body(**parts: bool) -> sc.System:
    model = sc.Model()
    box = sc.RigidBody.box(2.0, (0.1, 0.2, 1.0), angular_velocity=(1.0, 2.0, 3.0))
    place = model.add("box", box).local((0, 0, 0.5))
    if parts.get("spring"):
        model.add("spring", sc.SpringDamper(sc.ground((0, 0, 2.0)), place, 10.0))
    return model.freeze()


NEVER = {
    *("law", "strain", "load", "relative", "model/force_elements", "model/coordinates"),
    *("model/out_of_plane", "model/limits", "replacement"),
}


@pytest.mark.parametrize("treatment", [sc.NullSpace(), sc.Multipliers()], ids=str)
@pytest.mark.parametrize("scheme", [sc.EnergyMomentum(), sc.Variational()], ids=str)
def test_steps_call_nothing_that_is_not_there(scheme: Any, treatment: Any):
    """A body in space: no force elements, loops, sensors; and no diagnostics that nobody asked."""

    def run(system: sc.System, steps: int) -> None:
        sc.simulate(system, scheme, treatment, 1e-2, steps * 1e-2, kernels="numpy", derive=False)

    alone = growing(lambda steps: run(body(), steps))
    assert not alone & NEVER
    # the balance of energy is judged at recorded states, a hundred at most
    alone -= {"diagnostics/momenta", "diagnostics/stacked", "diagnostics/energy"}
    assert not {name for name in alone if name.startswith(("diagnostics", "export", "modal"))}
    assert {"integrators/stepper", "newton"} < alone
    spring = growing(lambda steps: run(body(spring=True), steps))
    assert "model/force_elements" in spring - alone


# a coarse swing, drawn too much
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
def test_a_profile_of_the_swing_has_no_diagnostics_in_it():
    """Time of a run without derived series is spent in steps: nothing else grows with them."""
    system = swing(4)
    scheme, treatment = sc.EnergyMomentum(), sc.NullSpace()

    def run(steps: int) -> None:
        sc.simulate(system, scheme, treatment, 1e-2, steps * 1e-2, kernels="numpy", derive=False)

    assert not {
        name
        for name in growing(run)
        if name.startswith(("diagnostics", "export", "statics", "modal", "mesh", "basis"))
    }
    profile = cProfile.Profile()
    profile.enable()
    run(40)
    profile.disable()
    stats = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    share = {
        name: sum(t[3] for (_, _, function), t in stats.items() if function == name)
        for name in ("advance", "simulate", "take")
    }
    assert share["advance"] + share["take"] > 0.8 * share["simulate"]
    assert np.isfinite(list(share.values())).all()
