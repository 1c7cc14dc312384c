"""How large the package, its tests and the examples are, and whether that is within their budget.

    python tests/structure.py [--simulate]

The size is the number of nodes of the syntax tree without docstrings, so neither layout nor names
nor comments change it. Constants are the numbers, and tuples of numbers, that modules and classes
give an upper-case name. ``budget.txt`` has the largest size that each folder may have; the program
ends with 1 if one is larger. Also read from the syntax trees: classes and functions that project
velocities, and places that copy a system of a scene.

``--simulate`` counts in how many modules a call of ``simulate`` and a step in numpy run code, and
how often the step switches between modules.
"""

from __future__ import annotations

import argparse
import ast
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
#: what solves linear equations, and arguments that are projected
SOLVERS = {"LinearSolver", "solve", "splu", "cg", "lstsq"}
VELOCITIES = {"p", "pi", "nu", "v", "reduced"}
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


def name_of(node: ast.AST) -> str:
    """Name of a variable or attribute, else nothing."""
    return getattr(node, "attr", getattr(node, "id", ""))


def projects_velocities(definition: ast.ClassDef | ast.FunctionDef) -> bool:
    """Tell whether a class or function solves for a velocity: at a state, of what was one.

    A kernel has all it takes in structures, and sweeps in place of that.
    """
    nodes = [*ast.walk(definition)]
    names = {*map(name_of, nodes)}
    if definition.name == "velocity" and "SWEEP" in names:
        return True
    given = [{each.arg for each in node.args} for node in nodes if isinstance(node, ast.arguments)]
    return not SOLVERS.isdisjoint(names) and any(
        each & {"q", "y"} and each & VELOCITIES for each in given
    )


def formulations(package: Path) -> dict[str, list[str]]:
    """Places that project velocities, and that copy a system of a scene past its constructor."""
    found: dict[str, list[str]] = {"projections of velocities": [], "copies of a system": []}
    projections, copies = found.values()
    for path in sorted(package.rglob("*.py")):
        module = ".".join(path.relative_to(package).with_suffix("").parts)
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef):
                name = [f"{module}.{node.name}"]
                projections += name * projects_velocities(node)
                copies += name * ast.unparse(node).count("object.__new__(System)")
    return found


def budget() -> dict[str, int]:
    """Largest size of each folder, from budget.txt."""
    lines = (ROOT / "tests" / "budget.txt").read_text(encoding="utf-8").splitlines()
    rows = [line.split() for line in lines if line and not line.startswith("#")]
    return {name: int(number) for name, number in rows}


def modules_entered(action: Callable[[], object]) -> list[str]:
    """Modules of the package whose functions a call enters, in their order."""
    entered: list[str] = []

    def note(frame: FrameType, event: str, argument: object) -> None:
        file = frame.f_code.co_filename
        if event == "call" and file.startswith(str(ROOT / FOLDERS["package"])):
            entered.append(file)

    sys.setprofile(note)
    try:
        action()
    finally:
        sys.setprofile(None)
    return entered


def of_runs() -> dict[str, int]:
    """Modules of a call of simulate with kernels, and of the second step in numpy; switches there.

    The scene is the README's. A switch is a function that is called after one of another module.
    """
    import skfem_cosserat as sc

    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 16, name="rod")
    rubber = sc.SectionCircle(radius=1e-2, material=sc.Material(E=5e6, nu=0.5, rho=1100))
    rod: Any = model.add("rod", sc.Beam(mesh, rubber, director=(0, 1, 0)))
    start, end = rod.node("rod.start"), rod.node("rod.end")
    model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), start, axis=(0, 0, 1)))
    model.add("ball", sc.RigidBody.sphere(0.05, radius=0.02, on=end))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    system = model.freeze()
    run = system, sc.EnergyMomentum(), sc.NullSpace(), 2e-3, 1e-2
    sc.simulate(*run)
    stepper = sc.Stepper(*run[:4], kernels="numpy")
    state = stepper.advance(sc.initial_state(system)).state
    step = modules_entered(lambda: stepper.advance(state))
    return {
        "modules of a call of simulate": len({*modules_entered(lambda: sc.simulate(*run))}),
        "modules of a step in numpy": len({*step}),
        "switches between them": sum(one != other for one, other in pairwise(step)),
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
    for name, places in formulations(ROOT / FOLDERS["package"]).items():
        sys.stdout.write(f"{len(places):9d}  {name}: {', '.join(places)}\n")
    if options.simulate:
        for name, count in of_runs().items():
            sys.stdout.write(f"{count:9d}  {name}\n")
    return too_large


if __name__ == "__main__":
    sys.exit(main())
