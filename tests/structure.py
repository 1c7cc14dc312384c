"""How the package is built, in numbers: a report, no aim by itself.

    python tests/structure.py [--simulate]

``--simulate`` also counts in how many modules a call of ``simulate`` and a step in numpy run code.
"""

from __future__ import annotations

import argparse
import ast
import io
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from itertools import combinations
from pathlib import Path
from types import FrameType
from typing import Any

PACKAGE = Path(__file__).resolve().parents[1] / "skfem_cosserat"
#: identical lines in a row that make a passage
PASSAGE = 6
_LAYOUT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
_LAYOUT |= {tokenize.ENCODING, tokenize.ENDMARKER}


def sources() -> dict[Path, str]:
    """Text of each file of the package."""
    return {path: path.read_text(encoding="utf-8") for path in sorted(PACKAGE.rglob("*.py"))}


def code_lines(text: str) -> int:
    """Lines that hold code: no docstrings, comments, blanks."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in _LAYOUT:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        if not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            continue
        if isinstance(node.value.value, str):
            lines.difference_update(range(node.lineno, (node.end_lineno or 0) + 1))
    return len(lines)


def name_of(path: Path) -> str:
    """Dotted, below the package."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def importers(texts: dict[Path, str]) -> dict[str, set[str]]:
    """Which modules import each one; those of `__init__` files and for annotations count not."""
    known = {name_of(path) for path in texts}
    found: dict[str, set[str]] = defaultdict(set)
    for path, text in texts.items():
        own = name_of(path)
        if path.name == "__init__.py":
            continue
        for node in _run(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and node.level:
                base = own.split(".")[: -node.level]
                base += node.module.split(".") if node.module else []
                for alias in node.names:
                    name = ".".join([*base, alias.name])
                    name = name if name in known else ".".join(base)
                    if name and name != own:
                        found[name].add(own)
    return found


def _run(node: ast.AST) -> Iterable[ast.AST]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            continue
        yield child
        yield from _run(child)


def passages(texts: dict[Path, str]) -> int:
    """Pairs of files that share a passage; imports are none."""
    where: dict[tuple[str, ...], set[Path]] = defaultdict(set)
    for path, text in texts.items():
        lines = [line.strip() for line in text.splitlines()]
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Import | ast.ImportFrom):
                for k in range(node.lineno - 1, node.end_lineno or node.lineno):
                    lines[k] = ""
        lines = [line for line in lines if line and not line.startswith("#")]
        for k in range(len(lines) - PASSAGE + 1):
            where[tuple(lines[k : k + PASSAGE])].add(path)
    return len({pair for paths in where.values() for pair in combinations(sorted(paths), 2)})


def reasons(texts: dict[Path, str]) -> int:
    """Reasons to refuse compiled kernels."""
    found: set[str] = set()
    for path, text in texts.items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Dict) and path.name == "choice.py":
                found |= {ast.unparse(key) for key in node.keys if key is not None}
            if isinstance(node, ast.Constant | ast.JoinedStr):
                said = ast.unparse(node)
                if "compiled" in said and ("no compiled" in said or "gives no scheme" in said):
                    found.add(said)
                if "there are compiled" in said:
                    found.add(said)
    parts = {one for one in found for other in found if one != other and one.strip("'f") in other}
    return len(found - parts) - 1  # the sentence that lists the reasons


def methods(texts: dict[Path, str], name: str, abstract: bool) -> int:
    """Public methods of a class; properties do not count, or with `abstract` all but those."""
    found = 0
    for text in texts.values():
        for node in ast.walk(ast.parse(text)):
            if not (isinstance(node, ast.ClassDef) and node.name == name):
                continue
            for each in node.body:
                if isinstance(each, ast.FunctionDef) and not each.name.startswith("_"):
                    marks = [ast.unparse(mark) for mark in each.decorator_list]
                    found += "abstractmethod" in marks if abstract else not marks
    return found


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
    return sum(name.startswith(str(PACKAGE)) for name in seen)


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


def counts(run: bool = False) -> dict[str, int]:
    """The table."""
    texts = sources()
    files = Counter(path.name for path in texts if path.name != "__init__.py")
    classes = Counter(
        node.name
        for text in texts.values()
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ClassDef)
    )
    single = [name for name, by in importers(texts).items() if len(by) == 1]
    table = {
        "files": len(texts),
        "lines of code": sum(map(code_lines, texts.values())),
        "modules with one importer": len(single),
        "names of files and classes used twice": sum(
            count > 1 for names in (files, classes) for count in names.values()
        ),
        "pairs of files that share six lines": passages(texts),
        "reasons to refuse kernels": reasons(texts),
        "methods a treatment of one's own has to give": methods(texts, "BoundTreatment", True),
        "methods an integrator of one's own may give": methods(texts, "Integrator", False),
    }
    if run:
        table |= modules_of_runs()
    return table


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("--simulate", action="store_true", help="count modules of a run, too")
    options = parser.parse_args(arguments)
    for name, count in counts(options.simulate).items():
        sys.stdout.write(f"{count:7d}  {name}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
