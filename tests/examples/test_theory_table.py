"""The table of theories on the stiff swing: its parts, a small table, a part of the large one."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat import diagnostics

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))

import alternation
import theory_report
import theory_table

SMALL = ("full", "inextensible")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("theories")
    return theory_table.main(True, folder, folder / "kept", SMALL), folder


@pytest.mark.slow
def test_small_table(small):
    """Errors of second order in the step, next to those of model and mesh."""
    result, _ = small
    rows = {(r["theory"], r["integrator"], r["step_s"]): r for r in result["rows"]}
    assert len(rows) == len(result["rows"]) == 2 * 2 * 2
    for (theory, _, step), row in rows.items():
        assert set(row) == set(theory_table.COLUMNS)
        assert row["status"] == "ok" and row["time_s"] == pytest.approx(0.3)
        assert row["energy_error_midpoint"] < 1e-5
        # shear and extension of a strip so slender do not matter, its mesh does
        assert (
            (row["model_error_m"] == 0) if theory == "full" else (0 < row["model_error_m"] < 1e-7)
        )
        assert abs(row["error_m"] - row["time_error_m"]) <= row["model_error_m"]
        assert 1e-5 < row["mesh_error_m"] < 1e-3
        if step == 3e-2:
            finer = rows[theory, row["integrator"], 1e-2]
            assert row["time_error_m"] / finer["time_error_m"] == pytest.approx(9, rel=0.15)
    for error in result["errors"]:
        assert 0 < error["own_error_m"] < 1e-6
        assert 0 < error["own_error_of_mesh_m"] < 0.1 * error["mesh_error_m"]
    assert {row["theory"] for row in result["costs"]} == {"inextensible"}


@pytest.mark.slow
def test_files_of_the_small_table(small):
    result, folder = small
    text = (folder / "theory_table.csv").read_text()
    assert text.startswith("# versions") and "model_error_m" in text
    assert len(text.splitlines()) > len(result["rows"])
    for name in ("costs", "theory", "ranges"):
        assert "inextensible" in (folder / f"theory_table.{name}.csv").read_text()
    assert "contiguous_s" in theory_table.report(result)


def test_theories_that_are_not_there():
    with pytest.raises(ValueError, match=r"theories = 'soft', expected one of \['full'"):
        theory_table.main(True, theories=("full", "soft"))
    with pytest.raises(ValueError, match="expected the full beam among them"):
        theory_table.main(True, theories=("rigid",))


# -- what counts -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("statuses", "longest"),
    [
        (("ok", "ok", "ok", "ok"), 1e-1),
        (("ok", "ok", "ok", "drift"), 1e-2),
        (("ok", "newton", "ok", "ok"), 1e-4),  # some pass beyond a failure: they do not count
        (("blowup", "ok", "ok", "ok"), None),
    ],
)
def test_contiguous_range(statuses, longest):
    steps = (1e-4, 1e-3, 1e-2, 1e-1)
    rows = [{"step_s": step, "status": each} for step, each in zip(steps, statuses, strict=True)]
    assert theory_report.contiguous(rows) == theory_report.contiguous(rows[::-1]) == longest


# -- theory ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_fastest_vibrations_of_the_theories():
    """Shear; axial waves; without them rotations from node to node, just as fast."""
    tops = {}
    for theory in SMALL + ("unshearable", "rigid"):
        model = theory_table.swing.scene("stiff", 8, theory=theory_table.THEORIES[theory]())
        tops[theory] = alternation.highest(model.freeze(planar=sc.Planar()))
    length, E, G, rho = 0.72 / 8, 73e9, 73e9 / 2.6, 2700.0
    axial = 2 * 3**0.5 / length * (E / rho) ** 0.5
    assert tops["inextensible"]["omega_1"] == pytest.approx(axial, rel=1e-5)
    assert tops["inextensible"]["zigzag"] > 0.999 and tops["inextensible"]["rotary"] > 0.999
    assert tops["inextensible"]["omega_2"] < 0.1 * axial
    assert 0.9 * axial < tops["unshearable"]["omega_1"] < 1.001 * axial
    # shear of a rectangle: 5/6 GA against rho I, and more for linear elements
    shear = (5 / 6 * G * 12 / rho) ** 0.5 / 1e-3
    assert shear < tops["full"]["omega_1"] < 4 * shear and tops["full"]["rotary"] > 0.99
    assert all(np.isnan(tops["rigid"][name]) for name in ("omega_1", "rotary", "zigzag"))


def pushed(theory, force, elements=4):
    """A steel bar on a clamp, and its configuration under a force along it."""
    model = sc.Model()
    steel = sc.Material(210e9, 0.3, 7850.0)
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="bar")
    section = sc.SectionRectangle(0.01, 0.01, steel)
    bar = model.add("bar", sc.Beam(mesh, section, director=(0, 1, 0), theory=theory))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), bar.node("bar.start")))
    model.add("force", sc.LoadForce(bar.node("bar.end"), (force, 0, 0)))
    system = model.freeze()
    return system, sc.static(system, control=sc.LoadControl(steps=1))["q"][-1]


def grown(system, q, step, count=100):
    """How many times a disturbance of 1e-8 m in some steps of the variational scheme grows."""
    P = system.null_space(q)
    v = P @ np.random.default_rng(0).standard_normal(P.shape[1])
    state = sc.initial_state(system, q=q, v=1e-8 / step * v / abs(v).max())
    stepper = sc.Stepper(system, sc.Variational(), sc.NullSpace(), step, kernels="numpy")
    sizes = []
    for _ in range(count):
        state = stepper.advance(state).state
        sizes.append(abs(state.q - q).max())
    return max(sizes[-10:]) / max(sizes[:10])


@pytest.mark.slow
@pytest.mark.parametrize("theory", [sc.TheoryKirchhoff(), sc.TheoryInextensible()], ids=repr)
def test_rotations_that_alternate_from_step_to_step_grow_above_the_limit(theory):
    """``h omega_c = 2``, with all that the theory holds among the constraints."""
    system, q = pushed(theory, -300.0)
    limit = 2 / driven(system, q)
    assert grown(system, q, 0.95 * limit) < 10
    assert grown(system, q, 1.05 * limit) > 50  # until what is not linear ends it


def driven(system, q):
    """Frequency (rad/s) with which compression drives rotations at rest."""
    stepper = sc.Stepper(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-7, kernels="numpy")
    report = stepper.advance(sc.initial_state(system, q=q))
    point, force = report.constraint_point, report.constraint_force
    return alternation.alternation_frequency(system, point, force)[0]


def test_limit_of_full_beams_is_that_of_the_diagnostics():
    """Which looks at the rotations of all frames alone, clamped ones among them."""
    system, q = pushed(None, -300.0)
    stepper = sc.Stepper(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-7, kernels="numpy")
    force = stepper.advance(sc.initial_state(system, q=q)).constraint_force
    assert 0.95 < driven(system, q) / diagnostics.constraint_frequency(system, q, force) < 1


# -- a part of the large table ---------------------------------------------------------------------


@pytest.mark.slow
def test_the_theory_takes_longer_steps_of_the_variational_scheme():
    """To 1.5 s the full beam fails with 1e-4 s; the theory does where theory says it should."""
    pytest.importorskip("numba")
    plan, ends = theory_table.PLANS[False], (1.5,)
    limits = {}
    for theory in SMALL:
        system = theory_table.scene(theory, plan.meshes[0])
        limits[theory] = alternation.driven(system, 2e-4, ends, 700, "auto")["limit_s to 1.5 s"]
    assert limits["full"] < 0.5 * limits["inextensible"]
    for theory, step, passes in (
        ("inextensible", 0.7, True),
        ("inextensible", 2.0, False),
        ("full", 2.0, False),
    ):
        found = theory_table.cell(theory, "variational", step * limits[theory], ends, plan)
        (found,) = found["rows"]
        assert (found["status"] == "ok") == passes, (theory, step, found)
        assert found["kernels"] == "numba" and (found["time_s"] == 1.5) == passes
