"""Faults seeded into a copy of the package, one after the other: how many do quick tests find?

    python tests/seeded_faults.py                      40 faults, in turn: it takes long
    python tests/seeded_faults.py --seed 3 --count 20 --kind schemes
    python tests/seeded_faults.py --list               only say which faults these are
    python tests/seeded_faults.py --root FOLDER        of another checkout
    python tests/seeded_faults.py --csv FILE           a line for each fault, too

A fault is a sign (an addition made a subtraction and the reverse, a minus dropped), a factor (3/2
times the number), or two indices of an entry exchanged. Faults are drawn from the syntax trees of
functions: each place has a number that follows from the seed, the name of its function and its
expression alone, and the places of the least numbers are taken. Code that moves or stays takes
its faults along, so that the share of faults that are found can be compared across a refactoring.

Faults that change no result are left out where that can be read: in errors, warnings and texts, in
comparisons and checks, in numbers below 1e-3 (tolerances), sizes and positions of arrays.

Each fault runs the tests of its kind in ``TESTS``: kernels and what calls them with kernels, the
others without. It is found if a test fails or the tests take far longer than without it.
"""

from __future__ import annotations

import argparse
import ast
import builtins
import csv
import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

PACKAGE = "skfem_cosserat"
#: shares of all faults, and files in which faults of a kind are seeded
KINDS = {
    "kernels": (14, r"compiled/|integrators/(called_back|compiled_)"),
    "constraints": (13, r"constraints/|model/|(relative|joint|coupling)\.py"),
    "schemes": (13, r"integrators/(?!called_back|compiled_)|diagnostics/(energy|momenta)\.py"),
}
#: options of pytest: quick tests of the subject, those that fail first at the beginning
TESTS = {
    "kernels": """--kernels=numba tests/compiled/test_rows.py tests/compiled/test_compiled.py
        tests/items/test_couplings.py tests/section/test_stored_energy.py
        tests/compiled/test_compiled_statics.py tests/integrators/test_schemes_compiled.py""",
    "constraints": """-k 'not numba' tests/constraints/test_null_space.py
        tests/items/test_joints.py tests/run/test_starts.py tests/items/test_couplings.py
        tests/constraints/test_closed_loops.py tests/model/test_planar.py
        tests/items/test_own_items.py tests/section/test_theories.py
        tests/statics/test_path_following.py""",
    "schemes": """-k 'not numba' tests/whole/test_regressions.py
        tests/integrators/test_discrete_mechanics.py tests/integrators/test_integrators.py
        tests/integrators/test_tangents.py tests/integrators/test_explicit.py
        tests/whole/test_treatments.py tests/run/test_energy_balance.py
        tests/run/test_constraint_forces.py tests/items/test_damping.py
        tests/run/test_step_control.py tests/project/test_doctests.py""",
}
#: files and functions that judge, describe and choose, and compute nothing of a motion
APART = re.compile(r"check|limit|describe|choice|choose|warn|hint|explain|refuse|__repr__|__str__")
#: calls whose arguments are sizes and positions, or texts
SIZES = {"range", "arange", "zeros", "empty", "ones", "eye", "reshape", "len", "warn"}
LEFT_OUT = ast.Raise | ast.Assert | ast.Compare | ast.JoinedStr
OPPOSITE: dict[type, type] = {ast.Add: ast.Sub, ast.Sub: ast.Add}


class Fault(NamedTuple):
    """A place of a module, in the order of its tree, and what is changed there."""

    path: Path
    place: int
    function: str
    sort: str
    before: str
    after: str

    def __str__(self) -> str:
        return f"{self.path} {self.function}: {self.before} -> {self.after}"


def is_factor(node: ast.expr) -> bool:
    """Tell whether a number is a factor of formulas: no tolerance, no stride of an array."""
    if not isinstance(node, ast.Constant) or not isinstance(node.value, int | float):
        return False
    return abs(node.value) >= 1e-3 and (isinstance(node.value, float) or node.value == 2)


def is_position(node: ast.expr) -> bool:
    """Tell whether a term is a list, a count, or a position in an array."""
    match node:
        case ast.Constant(int()) | ast.List() | ast.ListComp() | ast.Tuple():
            return True
        case ast.Name(name):
            return len(name) > 1 and name.isupper()
        case ast.BinOp(left, ast.Mult(), right):
            stride = (each for each in (left, right) if isinstance(each, ast.Constant))
            return not all(map(is_factor, stride)) or is_position(left) or is_position(right)
        case ast.BinOp(left, ast.Add() | ast.Sub(), right):
            return is_position(left) or is_position(right)
        case ast.Subscript(array):
            return is_position(array)
        case ast.Call(ast.Name(name) | ast.Attribute(attr=name)):
            return name in {"len", "list", "tuple", "arange"}
    return False


def is_index(node: ast.expr) -> bool:
    """Tell whether an expression is one index, no slice."""
    kinds = ast.Name | ast.BinOp | ast.Constant
    return isinstance(node, kinds) and ast.unparse(node) not in {"None", "..."}


def faulty(node: ast.AST) -> tuple[str, ast.AST] | None:
    """An expression or statement with a fault, and its sort; None: there is nothing to change."""
    match node:
        case ast.BinOp(left, ast.Add() | ast.Sub() as op, right):
            if not is_position(node):
                return "sign", ast.BinOp(left, OPPOSITE[type(op)](), right)
        case ast.AugAssign(target, ast.Add() | ast.Sub() as op, value):
            if not is_position(value):
                return "sign", ast.AugAssign(target, OPPOSITE[type(op)](), value)
        case ast.UnaryOp(ast.USub(), operand) if not isinstance(operand, ast.Constant):
            return "sign", operand
        case ast.BinOp(ast.Constant(number) as left, ast.Mult() as op, right) if is_factor(left):
            if not is_position(right):
                return "factor", ast.BinOp(larger(number), op, right)
        case ast.BinOp(left, ast.Mult() | ast.Div() as op, ast.Constant(number) as right):
            if is_factor(right) and not is_position(left):
                return "factor", ast.BinOp(left, op, larger(number))
        case ast.Subscript(array, ast.Tuple([a, b]), context):
            if is_index(a) and is_index(b):
                return "index", ast.Subscript(array, ast.Tuple([b, a], ast.Load()), context)
    return None


def larger(number: Any) -> ast.Constant:
    """A number by a half larger."""
    return ast.Constant(type(number)(1.5 * number))


class Seeding(ast.NodeTransformer):
    """A walk over a module that collects all faults, and makes the one of a place."""

    def __init__(self, path: Path, place: int = -1) -> None:
        self.path, self.place = path, place
        self.kernels = path.parts[0] == "compiled"
        self.faults: list[Fault] = []
        self.classes: list[str] = []
        self.functions: list[str] = []
        self.parts: set[str] = set()

    def visit(self, node: Any) -> Any:
        return node if isinstance(node, LEFT_OUT) else super().visit(node)

    def visit_ImportFrom(self, node: Any) -> Any:
        if node.module == "jit":
            self.parts |= {alias.name for alias in node.names}
        return node

    def visit_ClassDef(self, node: Any) -> Any:
        self.classes.append(node.name)
        self.generic_visit(node)
        self.classes.pop()
        return node

    def visit_AnnAssign(self, node: Any) -> Any:
        if node.value is not None:
            node.value = self.visit(node.value)
        return node

    def visit_FunctionDef(self, node: Any) -> Any:
        marks = {*map(ast.unparse, node.decorator_list)}
        text = node.returns and ast.unparse(node.returns) == "str"
        if text or APART.search(node.name) or (self.kernels and not marks & self.parts):
            return node
        self.functions.append(node.name)
        node.body = [*map(self.visit, node.body)]
        self.functions.pop()
        return node

    def visit_Subscript(self, node: Any) -> Any:
        node.value = self.visit(node.value)
        return node if ast.unparse(node.value) in dir(builtins) else self.seeded(node)

    def visit_Call(self, node: Any) -> Any:
        name = ast.unparse(node.func).split(".")[-1]
        return node if name in SIZES else self.generic_visit(node)

    def generic_visit(self, node: Any) -> Any:
        return self.seeded(super().generic_visit(node))

    def seeded(self, node: Any) -> Any:
        """The node, or that with its fault if it is the place."""
        found = faulty(node) if self.functions else None
        if found is None:
            return node
        sort, other = found
        before, after = ast.unparse(node), ast.unparse(other)
        if before == after:
            return node
        place, function = len(self.faults), ".".join([*self.classes, *self.functions])
        self.faults.append(Fault(self.path, place, function, sort, before, after))
        return other if place == self.place else node


def all_faults(package: Path, kind: str) -> Iterator[Fault]:
    """All faults that can be seeded of a kind."""
    for file in sorted(package.rglob("*.py")):
        path = file.relative_to(package)
        if re.match(KINDS[kind][1], path.as_posix()) and not APART.search(path.stem):
            walk = Seeding(path)
            walk.visit(ast.parse(file.read_text(encoding="utf-8")))
            yield from walk.faults


def drawn(package: Path, kind: str, seed: int, count: int) -> list[Fault]:
    """Faults of the least numbers, of signs, factors and indices in turn."""
    sorts: dict[str, dict[str, Fault]] = {"sign": {}, "factor": {}, "index": {}}
    for fault in all_faults(package, kind):
        numbers = sorts[fault.sort]
        key = f"{seed} {fault.function.split('.')[-1]}: {fault.before} -> {fault.after}"
        number = hashlib.sha256(key.encode()).hexdigest()
        while number in numbers:  # an equal one of the function comes earlier
            number = hashlib.sha256(number.encode()).hexdigest()
        numbers[number] = fault
    in_turn = zip_longest(*([each[number] for number in sorted(each)] for each in sorts.values()))
    return [fault for turn in in_turn for fault in turn if fault is not None][:count]


class Copy:
    """A copy of a checkout, in which faults are seeded and tests are run."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.folder, self.package = folder, folder / PACKAGE
        leave = shutil.ignore_patterns(".*", "__pycache__")
        shutil.copytree(root, folder, ignore=leave, dirs_exist_ok=True)

    def failure(self, kind: str, most: float | None = None) -> str:
        """Names of tests of a kind that fail, in at most so many seconds; empty if none does."""
        environment = {**os.environ, "PYTHONPATH": str(self.folder)}
        environment.pop("NUMBA_CACHE_DIR", None)  # kernels are kept beside their sources
        options = shlex.split("-m pytest -x -q -n0 -p no:cacheprovider " + TESTS[kind])
        try:
            run = subprocess.run(
                [sys.executable, *options], cwd=self.folder, env=environment, timeout=most,
                capture_output=True, text=True, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return "no end"
        failed = re.findall(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", run.stdout, re.MULTILINE)
        return " ".join(failed) or f"status {run.returncode}" * bool(run.returncode)

    def failure_with(self, kind: str, fault: Fault, most: float) -> str:
        """Names of tests that fail with a fault; see :meth:`failure`."""
        path = self.package / fault.path
        text = path.read_text(encoding="utf-8")
        tree = Seeding(fault.path, fault.place).visit(ast.parse(text))
        path.write_text(ast.unparse(ast.fix_missing_locations(tree)), encoding="utf-8")
        try:
            return self.failure(kind, most)
        finally:
            path.write_text(text, encoding="utf-8")


def rows(copy: Copy, seed: int, counts: dict[str, int]) -> Iterator[dict[str, object]]:
    """Rows of a table: each fault, and which test has found it."""
    for kind, count in counts.items():
        begun = time.monotonic()
        failure = copy.failure(kind)
        if failure:
            raise SystemExit(f"without a fault the tests of {kind} fail: {failure}")
        alone = time.monotonic() - begun
        for fault in drawn(copy.package, kind, seed, count):
            begun = time.monotonic()
            failure = copy.failure_with(kind, fault, 3 * alone)
            yield {
                "seed": seed,
                "kind": kind,
                **fault._asdict(),
                "found": failure or "-",
                "seconds": round(time.monotonic() - begun),
            }


def main(arguments: Sequence[str] | None = None) -> int:
    """Print what becomes of each fault, and how many are found."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("--seed", type=int, default=40)
    parser.add_argument("--count", type=int, default=40, help="of all kinds, or of the one")
    parser.add_argument("--kind", choices=KINDS)
    parser.add_argument("--list", action="store_true", help="run no tests")
    parser.add_argument("--root", type=Path, default=Path(__file__).parents[1])
    parser.add_argument("--csv", type=Path, help="a file that gets a line for each fault")
    options = parser.parse_args(arguments)
    kinds = [options.kind] if options.kind else list(KINDS)
    shares = {kind: KINDS[kind][0] for kind in kinds}
    counts = {k: round(options.count * n / sum(shares.values())) for k, n in shares.items()}
    if options.list:
        for kind, count in counts.items():
            for fault in drawn(options.root / PACKAGE, kind, options.seed, count):
                sys.stdout.write(f"{kind}, {fault}\n")
        return 0
    found = Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        for row in rows(Copy(options.root, Path(folder)), options.seed, counts):
            found[str(row["kind"])] += row["found"] != "-"
            sys.stdout.write("{path} {function}: {before} -> {after}: {found}\n".format(**row))
            sys.stdout.flush()
            if options.csv:
                new = not options.csv.exists()
                with options.csv.open("a", newline="", encoding="utf-8") as file:
                    writer = csv.DictWriter(file, list(row))
                    if new:
                        writer.writeheader()
                    writer.writerow(row)
    for kind, count in counts.items():
        sys.stdout.write(f"{kind}: {found[kind]} of {count} found\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
