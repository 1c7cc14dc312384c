"""How large the package, its tests and the examples are, and whether that is within their budget.

    python tests/structure.py

The size is the number of nodes of the syntax tree without docstrings, so neither layout nor names
nor comments change it. ``budget.txt`` has the largest size that each folder may have; the program
ends with 1 if one is larger.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: folders by their names in budget.txt
FOLDERS = {"package": "skfem_cosserat", "tests": "tests", "examples": "examples"}
_DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def size(tree: ast.Module) -> int:
    """Number of nodes of a syntax tree, without docstrings and the contexts of names."""
    count = 0
    for node in ast.walk(tree):
        count += not isinstance(node, ast.expr_context)
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            count -= 2  # the statement and its text
    return count


def measured(folder: Path) -> Counter[str]:
    """Sizes of the folders and of the files in a folder."""
    parts = Counter[str]()
    for path in sorted(folder.rglob("*.py")):
        inside = path.relative_to(folder).parts
        tree = ast.parse(path.read_text(encoding="utf-8"))
        parts[inside[0] if len(inside) > 1 else "."] += size(tree)
    return parts


def budget() -> dict[str, int]:
    """Largest size of each folder, from budget.txt."""
    lines = (ROOT / "tests" / "budget.txt").read_text(encoding="utf-8").splitlines()
    rows = [line.split() for line in lines if line and not line.startswith("#")]
    return {name: int(number) for name, number in rows}


def main() -> int:
    """Print the numbers; return 1 if a folder is larger than its budget."""
    too_large = False
    for name, most in budget().items():
        parts = measured(ROOT / FOLDERS[name])
        over = parts.total() > most
        too_large |= over
        verdict = "TOO LARGE" if over else "within"
        sys.stdout.write(f"{name}: size {parts.total()}, {verdict} {most}\n")
        for part, number in sorted(parts.items()):
            sys.stdout.write(f"{number:9d}  {part}\n")
    return int(too_large)


if __name__ == "__main__":
    sys.exit(main())
