"""The glossary of the guide: each name in the code that it gives is there, the old ones are not."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import skfem_cosserat
import skfem_cosserat as sc

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "examples" / "guide" / "13_glossary.md").read_text(encoding="utf-8")
COLUMN = "name in the code"


def tables(text: str) -> list[list[dict[str, str]]]:
    """Rows of all tables that have a column of names in the code."""
    found = []
    for block in re.findall(r"(?:^\|.*\n)+", text, re.M):
        lines = block.splitlines()
        header, _, *rows = ([cell.strip() for cell in line.split("|")[1:-1]] for line in lines)
        if COLUMN in header:
            found.append([dict(zip(header, row, strict=True)) for row in rows])
    return found


def names(cell: str) -> list[str]:
    """What is in backticks."""
    return re.findall(r"`([^`]+)`", cell)


ROWS = [row for table in tables(TEXT) for row in table]


@pytest.fixture(scope="module")
def objects():
    """One of each kind that the glossary speaks of, by its name there."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    section = sc.SectionCircle(0.02, sc.Material(E=5e6, nu=0.5, rho=1100))
    model = sc.Model()
    beam = model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0)))
    place = beam.node("rod.end")
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), beam.node("rod.start"), axis=(0, 0, 1))
    joint = model.add("hinge", hinge)
    body = model.add("body", sc.RigidBody.sphere(0.1, 0.05, on=place))
    model.add("load", sc.LoadForce(place, (0, 0.01, 0)))
    history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 0.02)
    held = sc.Model()
    rod = held.add("rod", sc.Beam(mesh, section, director=(0, 1, 0)))
    held.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    held.add("load", sc.LoadForce(rod.node("rod.end"), (0, 0.01, 0)))
    return {
        "sc": sc,
        "skfem_cosserat": skfem_cosserat,
        **{"model": model, "system": model.freeze(), "beam": beam, "section": section},
        **{"place": place, "joint": joint, "body": body, "history": history},
        "state": next(sc.steps(model, sc.EnergyMomentum(), sc.NullSpace(), 0.01)).state,
        "stepper": sc.Stepper(model.freeze(), sc.EnergyMomentum(), sc.NullSpace(), 0.01),
        "path": sc.static(held),
        "modes": sc.modes(held, count=2),
    }


def test_the_tables_are_found():
    assert len(tables(TEXT)) == 6
    assert len(ROWS) > 100
    assert all(names(row[COLUMN]) for row in ROWS)


def test_each_name_is_in_the_code(objects):
    for name in {name for row in ROWS for name in names(row[COLUMN])}:
        assert eval(name, dict(objects)) is not None, name
    with pytest.raises(sc.InputError, match="no such series"):
        eval('history["no such series"]', dict(objects))


def test_old_names_are_gone():
    for name in (n for row in ROWS for n in names(row.get("older name", ""))):
        if name.startswith("sc."):
            owner, _, attribute = name.rpartition(".")
            assert not hasattr(eval(owner, {"sc": sc}), attribute), name


def test_modules_exist():
    modules = set(re.findall(r"`([\w/]+\.py)`", TEXT))
    assert modules and all((ROOT / "skfem_cosserat" / module).is_file() for module in modules)
