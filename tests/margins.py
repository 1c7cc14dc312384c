"""How near to its limit each comparison of the tests comes, on this processor and on others.

A limit at the level of rounding that one processor just meets is missed by the next one. Run with
``--margins FILE`` the tests note what every assertion compares, found and allowed (``a < limit``,
``a == pytest.approx(b)``, ``assert_allclose``). What depends on rounding shows itself: it differs
from one processor to the next. As a script this module reads such files, of as many processors,

    python tests/margins.py FILE FILE ... [--csv TABLE]

and ends with 1 if anything that differs between them comes nearer to its limit than a factor 10.
"""

from __future__ import annotations

import argparse
import ast
import csv
import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np

#: the tests and what they import, by name
MODULES = {file.stem: file for file in Path(__file__).resolve().parent.rglob("*.py")}
#: found over allowed, by test, file, line and how often that was passed before
Ratios = dict[tuple[str, str, int, int], float]
#: what is found must differ by more than this share between processors to count as rounding
SAME = 5e-2
ROOM = 10.0
CLOCKS = "monotonic", "perf_counter", "process_time", "cost_s", "spent_s", "seconds"
#: names in the rewritten tests
BELOW, EQUAL, CLOSE = "__margin_below__", "__margin_equal__", "__margin_close__"
CHAIN = "__margin_chain__"


# -- noting ----------------------------------------------------------------------------------------


class _Rewriter(ast.NodeTransformer):
    """Comparisons with limits inside of assertions become calls that note them."""

    def __init__(self) -> None:
        self.depth = 0

    def visit_Assert(self, node: ast.Assert) -> ast.Assert:
        self.depth += 1
        self.generic_visit(node)
        self.depth -= 1
        return node

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.UnaryOp:
        if not isinstance(node.op, ast.Not):  # "not close" has no limit to stay below
            self.generic_visit(node)
        return node

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        self.generic_visit(node)
        if not self.depth or any(clock in ast.dump(node) for clock in CLOCKS):
            return node  # seconds are no rounding
        if len(node.ops) > 1 and all(isinstance(op, ast.Lt | ast.LtE) for op in node.ops):
            strict = ast.Tuple(
                [ast.Constant(isinstance(op, ast.Lt)) for op in node.ops], ast.Load()
            )
            literal = ast.Constant(isinstance(node.left, ast.Constant))
            return _called(CHAIN, node, literal, strict, node.left, *node.comparators)
        if len(node.ops) > 1:
            return node
        left, op, right = node.left, node.ops[0], node.comparators[0]
        if isinstance(op, ast.Lt | ast.LtE):
            return _called(BELOW, node, left, right, ast.Constant(isinstance(op, ast.LtE)))
        if isinstance(op, ast.Eq) and "approx" in ast.dump(right):
            return _called(EQUAL, node, left, right)
        return node

    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        name = getattr(node.func, "attr", "")
        if name not in ("assert_allclose", "allclose"):
            return node
        new = _called(CLOSE, node, node.func, *node.args)
        new.keywords = node.keywords
        return new


def _called(name: str, node: ast.expr, *arguments: ast.expr) -> ast.Call:
    line = ast.Constant(node.lineno)
    call = ast.Call(ast.Name(name, ast.Load()), [line, *arguments], [])
    return ast.fix_missing_locations(ast.copy_location(call, node))


class _Loader(importlib.machinery.SourceFileLoader):
    def get_code(self, fullname: str) -> CodeType:  # never from bytecode on disk
        path = self.get_filename(fullname)
        tree = _Rewriter().visit(ast.parse(Path(path).read_bytes(), path))
        return compile(ast.fix_missing_locations(tree), path, "exec")

    def exec_module(self, module: ModuleType) -> None:
        name = Path(str(module.__file__)).name
        vars(module)[BELOW] = lambda *a: _below(name, *a)
        vars(module)[CHAIN] = lambda *a: _chain(name, *a)
        vars(module)[EQUAL] = lambda *a: _equal(name, *a)
        vars(module)[CLOSE] = lambda *a, **k: _close(name, *a, **k)
        super().exec_module(module)


class _Finder(importlib.abc.MetaPathFinder):
    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        file = MODULES.get(fullname)
        if path is not None or file is None or fullname in ("conftest", "margins"):
            return None
        return importlib.util.spec_from_file_location(
            fullname, file, loader=_Loader(fullname, str(file))
        )


_file: Any = None


def note_margins(path: str) -> None:
    """Have all test modules that are imported from now on note their margins in a file."""
    global _file  # noqa: PLW0603
    worker = os.environ.get("PYTEST_XDIST_WORKER", "main")
    _file = open(f"{path}.{worker}", "w", buffering=1)  # noqa: SIM115
    sys.meta_path.insert(0, _Finder())


def _note(name: str, line: int, found: Any, allowed: Any) -> None:
    try:
        if np.min(np.asarray(allowed, dtype=float), initial=np.inf) <= 0.0:
            return  # a sign, no limit
        ratio = np.abs(np.asarray(found, dtype=float)) / np.asarray(allowed, dtype=float)
        worst = float(np.max(ratio)) if ratio.size else 0.0
    except (TypeError, ValueError):
        return  # no numbers
    test = os.environ.get("PYTEST_CURRENT_TEST", "").rsplit(" (", 1)[0]
    row = {"test": test, "file": name, "line": line, "ratio": worst}
    _file.write(json.dumps(row) + "\n")


def _below(name: str, line: int, left: Any, right: Any, equal: bool) -> Any:
    with np.errstate(all="ignore"):
        try:
            if np.asarray(left).dtype.kind not in "biu":  # no counts
                _note(name, line, np.maximum(np.asarray(left, dtype=float), 0.0), right)
        except (TypeError, ValueError):
            pass  # no numbers
    return left <= right if equal else left < right


def _chain(name: str, line: int, literal: bool, strict: Sequence[bool], *values: Any) -> Any:
    """``a < b < c``: a number found below its limit; a literal given first bounds from below."""
    result: Any = True
    for k, (less, left, right) in enumerate(zip(strict, values, values[1:], strict=False)):
        if literal and k == 0:
            result = (left < right if less else left <= right) and result
        else:
            result = _below(name, line, left, right, not less) and result
    return result


def _equal(name: str, line: int, left: Any, right: Any) -> Any:
    with np.errstate(all="ignore"):
        expected = getattr(right, "expected", None)
        try:
            b = np.asarray(expected, dtype=float)
            rel = right.rel if right.rel is not None else (1e-6 if right.abs is None else 0.0)
            least = right.abs if right.abs is not None else 1e-12
            _note(name, line, np.asarray(left, dtype=float) - b, np.maximum(rel * abs(b), least))
        except (TypeError, ValueError, AttributeError):
            pass  # no numbers
    return left == right


def _close(name: str, line: int, function: Any, a: Any, b: Any, *more: Any, **options: Any) -> Any:
    rtol = more[0] if more else options.get("rtol", 1e-7 if "assert" in function.__name__ else 1e-5)
    atol = options.get("atol", 0.0 if "assert" in function.__name__ else 1e-8)
    with np.errstate(all="ignore"):
        try:
            x, y = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
            _note(name, line, x - y, np.maximum(atol + rtol * abs(y), 1e-300))
        except (TypeError, ValueError):
            pass  # no numbers
    return function(a, b, *more, **options)


# -- reading ---------------------------------------------------------------------------------------


def read(path: str) -> Ratios:
    """What a run with ``--margins`` noted, of all its workers."""
    rows: Ratios = {}
    for part in sorted(Path(path).parent.glob(f"{Path(path).name}.*")):
        passed: dict[tuple[str, str, int], int] = defaultdict(int)
        for text in part.read_text().splitlines():
            row = json.loads(text)
            key = row["test"], row["file"], row["line"]
            if not np.isfinite(row["ratio"]):
                continue
            rows[(*key, passed[key])] = row["ratio"]
            passed[key] += 1
    return rows


def near(
    runs: Sequence[dict[tuple[str, str, int, int], float]],
) -> Iterator[tuple[Any, list[float]]]:
    """What differs between runs, and comes nearer to its limit than the room asked for."""
    for key in sorted(set().union(*runs)):
        ratios = [run[key] for run in runs if key in run]
        most, least = max(ratios), min(ratios)
        if most * ROOM > 1.0 and most - least > SAME * most:
            yield key, ratios


def _differing(run: Ratios, first: Ratios) -> bool:
    return any(run[key] != first[key] for key in run.keys() & first.keys())


def features() -> str:
    """Parts of this processor that numpy uses and can be told not to."""
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

    return " ".join(name for name in __cpu_dispatch__ if __cpu_features__.get(name))


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare files; say what is too near to its limit."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("files", nargs="*", metavar="FILE")
    parser.add_argument("--features", action="store_true", help="print what numpy may do without")
    parser.add_argument("--tests", action="store_true", help="print the tests that compare")
    parser.add_argument("--csv", metavar="TABLE", help="largest ratio of each file of tests")
    options = parser.parse_args(arguments)
    if options.features:
        sys.stdout.write(features())
        return 0
    runs = [read(path) for path in options.files]
    for path, run in zip(options.files, runs, strict=True):
        if not run:
            sys.stdout.write(f"{path}: no comparisons\n")
            return 1
    if options.tests:
        sys.stdout.writelines(sorted({f"{test}\n" for run in runs for test, *_ in run}))
        return 0
    if len(runs) > 1 and not any(map(_differing, runs[1:], [runs[0]] * len(runs))):
        sys.stdout.write("no run differs from the first one: they rounded alike\n")
        return 1
    found = list(near(runs))
    for (test, file, line, _), ratios in found:
        shown = ", ".join(f"{ratio:.2g}" for ratio in ratios)
        sys.stdout.write(f"{test}, {file}:{line}: found over allowed {shown}\n")
    sys.stdout.write(f"{len(runs[0])} comparisons, {len(found)} with less room than {ROOM:g}\n")
    if options.csv:
        _table(runs, options.files, options.csv)
    return 1 if found else 0


def _table(runs: Sequence[Ratios], files: Sequence[str], path: str) -> None:
    worst: dict[str, list[float]] = defaultdict(lambda: [0.0] * len(runs))
    for key in set.intersection(*map(set, runs)):
        ratios = [run[key] for run in runs]
        if max(ratios) - min(ratios) <= SAME * max(ratios):
            continue  # no rounding
        for k, ratio in enumerate(ratios):
            worst[key[1]][k] = max(worst[key[1]][k], ratio)
    with open(path, "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["tests", *(Path(name).name for name in files)])
        for name in sorted(worst):
            table.writerow([name, *(f"{ratio:.2g}" for ratio in worst[name])])


if __name__ == "__main__":
    sys.exit(main())
