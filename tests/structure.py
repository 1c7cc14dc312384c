"""How large the package, its tests and the examples are, and whether that is within their budget.

    python tests/structure.py [--simulate]

The size is the number of nodes of the syntax tree without docstrings, so neither layout nor names
nor comments change it. Constants are the numbers, and tuples of numbers, that modules and classes
give an upper-case name. ``budget.txt`` has the largest size that each folder may have; the program
ends with 1 if one is larger. ``--simulate`` also counts in how many modules a call of ``simulate``
and a step in numpy run code.
"""

from __future__ import annotations

import argparse
import ast
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
#: folders by their names in budget.txt
FOLDERS = {"package": "skfem_cosserat", "tests": "tests", "examples": "examples"}
_DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def docstring(node: ast.AST) -> list[ast.AST]:
    """The nodes of the docstring of a module, class or function."""
    if isinstance(node, _DOCUMENTED) and node.body and isinstance(node.body[0], ast.Expr):
        value = node.body[0].value
        if isinstance(value, ast.Constant) and isinstance(value.value, str):
            return [node.body[0], value]
    return []


def size(tree: ast.Module) -> int:
    """Number of nodes of a syntax tree, without docstrings and the contexts of names."""
    nodes = [node for node in ast.walk(tree) if not isinstance(node, ast.expr_context)]
    return len(nodes) - sum(len(docstring(node)) for node in nodes)


def is_number(value: ast.expr) -> bool:
    """Tell whether an expression is a number or a sequence of numbers."""
    match value:
        case ast.Constant(value=bool()):
            return False
        case ast.Constant(value=int() | float()):
            return True
        case ast.UnaryOp(operand=operand):
            return is_number(operand)
        case ast.BinOp(left=left, right=right):
            return is_number(left) or is_number(right)
        case ast.Tuple(elts=parts) | ast.List(elts=parts):
            return bool(parts) and all(map(is_number, parts))
    return False


def assigned(node: ast.stmt) -> Iterable[tuple[ast.expr, ast.expr]]:
    """Targets and values of an assignment, those of a tuple one by one."""
    match node:
        case ast.Assign(targets=[ast.Tuple(elts=names), *_], value=ast.Tuple(elts=values)):
            return zip(names, values, strict=True)
        case ast.Assign(targets=[ast.Tuple(elts=names), *_], value=value):
            return [(name, value) for name in names]
        case ast.Assign(targets=[name, *_], value=value):
            return [(name, value)]
        case ast.AnnAssign(target=name, value=ast.expr() as value):
            return [(name, value)]
    return []


def constants(body: Iterable[ast.stmt]) -> int:
    """Number of constants of a module or class, those of its classes included."""
    found = 0
    for node in body:
        if isinstance(node, ast.ClassDef):
            found += constants(node.body)
        found += sum(
            isinstance(name, ast.Name) and name.id == name.id.upper() and is_number(value)
            for name, value in assigned(node)
        )
    return found


def measured(folder: Path) -> tuple[Counter[str], Counter[str]]:
    """Numbers of a folder, and the sizes of what it contains."""
    total, parts = Counter[str](), Counter[str]()
    for path in sorted(folder.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        classes = sum(isinstance(node, ast.ClassDef) for node in ast.walk(tree))
        own = size(tree)
        total.update(files=1, size=own, constants=constants(tree.body), classes=classes)
        inside = path.relative_to(folder).parts
        parts[inside[0] if len(inside) > 1 else "."] += own
    return total, parts


def budget() -> dict[str, int]:
    """Largest size of each folder, from budget.txt."""
    lines = (ROOT / "tests" / "budget.txt").read_text(encoding="utf-8").splitlines()
    rows = [line.split() for line in lines if line and not line.startswith("#")]
    return {name: int(number) for name, number in rows}


def modules_of(action: Callable[[], object]) -> int:
    """Modules of the package in which a call runs code."""
    seen = set()

    def note(frame: FrameType, event: str, argument: object) -> None:
        seen.add(frame.f_code.co_filename)

    sys.setprofile(note)
    try:
        action()
    finally:
        sys.setprofile(None)
    return sum(name.startswith(str(ROOT / FOLDERS["package"])) for name in seen)


def modules_of_runs() -> dict[str, int]:
    """Modules of a call of simulate with compiled kernels, and of a step in numpy, after others."""
    import skfem_cosserat as sc

    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 5, name="rod")
    section = sc.Section((2e4, 2e4, 5e4, 40.0, 60.0, 30.0), mass=1.3, inertia=(2e-3, 3e-3))
    beam: Any = model.add("rod", sc.Beam(mesh, section, director=(0, 0, 1)))
    model.add("pin", sc.JointSpherical(sc.ground((0, 0, 0)), beam.node("rod.start")))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    system = model.freeze()
    run = system, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, 5e-3
    sc.simulate(*run)
    stepper = sc.Stepper(*run[:4], kernels="numpy")
    state = stepper.advance(sc.initial_state(system)).state
    return {
        "modules of a call of simulate": modules_of(lambda: sc.simulate(*run)),
        "modules of a step in numpy": modules_of(lambda: stepper.advance(state)),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the numbers; return 1 if a folder is larger than its budget."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("--simulate", action="store_true", help="count modules of a run, too")
    options = parser.parse_args(arguments)
    too_large = 0
    for name, most in budget().items():
        total, parts = measured(ROOT / FOLDERS[name])
        over = total["size"] > most
        too_large |= over
        numbers = ", ".join(f"{key} {total[key]}" for key in ("files", "classes", "constants"))
        verdict = "TOO LARGE" if over else "within"
        sys.stdout.write(f"{name}: size {total['size']}, {verdict} {most}; {numbers}\n")
        for part, number in sorted(parts.items()):
            sys.stdout.write(f"{number:9d}  {part}\n")
    if options.simulate:
        for name, count in modules_of_runs().items():
            sys.stdout.write(f"{count:9d}  {name}\n")
    return too_large


if __name__ == "__main__":
    sys.exit(main())
