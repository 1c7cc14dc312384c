"""Three sizes of tests, by what they cost: quick (the README's command), slow, long.

``sizes.csv`` holds the CPU time of each test, and of each fixture that several tests share, as
measured by ``--measure FILE`` (then ``python tests/sizes.py FILE`` brings the table up to date). A
test is slow if it costs more than `QUICK`, unless it is the cheapest case of its function and
costs no more than `CASE`, or is marked ``quick``; it is long above `LONG`, the cheapest case of its
function above `LONG_CASE`. A test may say itself that it is slow or long. What is not in the table
is quick.
"""

from __future__ import annotations

import csv
import json
import os
import platform
import re
import resource
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import pytest

TABLE = Path(__file__).resolve().parent / "sizes.csv"
#: of the long tests: which was run when
RECORD = TABLE.with_name("long_runs.csv")
#: CPU seconds, see above
QUICK, CASE, LONG, LONG_CASE = 0.1, 0.3, 3.0, 20.0
#: cheaper ones are not in the table
LEAST = 0.08


def stored() -> dict[str, float]:
    """CPU seconds by name of the test or fixture."""
    if not TABLE.exists():
        return {}
    with TABLE.open(newline="", encoding="utf-8") as file:
        return {row["name"]: float(row["seconds"]) for row in csv.DictReader(file)}


def name_of(item: pytest.Item) -> str:
    """Of a test: file, function and case, whatever folder pytest was started in."""
    return f"{item.path.name}::{item.nodeid.split('::', 1)[-1]}"


def shared(item: pytest.Item) -> list[str]:
    """Names of the fixtures that a test shares with others."""
    return [f"{item.path.name}::fixture {name}" for name in getattr(item, "fixturenames", ())]


def give_sizes(items: Sequence[pytest.Item]) -> None:
    """Mark tests as slow or long."""
    cost = stored()
    functions = defaultdict(list)
    for item in items:
        functions[name_of(item).split("[")[0]].append(item)

    def seconds(item: pytest.Item) -> float:
        return cost.get(name_of(item), 0.0)

    for cases in functions.values():
        first = min(cases, key=seconds)
        for item in cases:
            if item.get_closest_marker("long"):
                continue
            most = CASE if item is first else QUICK
            awaited = sum(cost.get(name, 0.0) for name in shared(item))
            if item.get_closest_marker("quick"):
                continue
            if seconds(item) > (LONG_CASE if item is first else LONG):
                item.own_markers[:] = [mark for mark in item.own_markers if mark.name != "slow"]
                item.add_marker("long")
            elif seconds(item) > most or awaited > CASE:
                item.add_marker("slow")


# -- measuring -------------------------------------------------------------------------------------


def _cpu() -> float:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


class Measure:
    """A plugin that writes the CPU seconds of tests and of shared fixtures to a file."""

    def __init__(self, path: str) -> None:
        worker = os.environ.get("PYTEST_XDIST_WORKER", "main")
        self.file = open(f"{path}.{worker}", "w", buffering=1, encoding="utf-8")  # noqa: SIM115
        self.fixtures = 0.0

    def _write(self, name: str, seconds: float) -> None:
        self.file.write(json.dumps([name, round(seconds, 3)]) + "\n")

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any, request: Any) -> Iterator[Any]:
        before, inner = _cpu(), self.fixtures
        result = yield
        if fixturedef.scope != "function":
            spent = _cpu() - before - (self.fixtures - inner)
            self.fixtures += spent
            if fixturedef.scope == "module":  # those of a session serve all files
                self._write(f"{request.path.name}::fixture {fixturedef.argname}", spent)
        return result

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[Any]:
        before, self.fixtures = _cpu(), 0.0
        result = yield
        self._write(name_of(item), _cpu() - before - self.fixtures)
        return result


# -- long ones -------------------------------------------------------------------------------------


class Record:
    """A plugin that keeps when each long test was run last, on which commit, and how it ended."""

    FIELDS = ("test", "outcome", "seconds", "date", "commit", "processor")

    def __init__(self) -> None:
        self.rows: dict[str, dict[str, str]] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        name = report.nodeid.rsplit("/", 1)[-1]
        row = self.rows.setdefault(name, {"test": name, "outcome": "passed", "seconds": "0"})
        row["seconds"] = f"{float(row['seconds']) + report.duration:.1f}"
        if report.outcome != "passed":
            row["outcome"] = report.outcome

    def pytest_sessionfinish(self) -> None:
        if not self.rows:
            return
        git = ["git", "-C", str(TABLE.parent), "rev-parse", "--short", "HEAD"]
        commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
        today = datetime.now(UTC).date().isoformat()
        for row in self.rows.values():
            row |= {"date": today, "commit": commit, "processor": _processor()}
        if RECORD.exists():
            with RECORD.open(newline="", encoding="utf-8") as file:
                self.rows = {row["test"]: row for row in csv.DictReader(file)} | self.rows
        with RECORD.open("w", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, self.FIELDS, lineterminator="\n")
            table.writeheader()
            table.writerows(self.rows[name] for name in sorted(self.rows))


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


@cache
def _functions(file: str) -> set[str]:
    """Names of the functions of a file of tests."""
    found = [path.read_text(encoding="utf-8") for path in TABLE.parent.rglob(file)]
    return set(re.findall(r"def (\w+)\(", "".join(found)))


def _exists(name: str) -> bool:
    """Whether a test or fixture of the table is still there."""
    file, _, rest = name.partition("::")
    function = rest.removeprefix("fixture ").split("[")[0].split("::")[-1]
    return function in _functions(file) or function in _functions("conftest.py")


def main(paths: Sequence[str]) -> None:
    """Bring the table up to date with files that were written by ``--measure``."""
    cost = stored()
    for path in paths:
        for part in Path(path).parent.glob(f"{Path(path).name}.*"):
            for line in part.read_text(encoding="utf-8").splitlines():
                name, seconds = json.loads(line)
                cost[name] = seconds
    cost = {name: seconds for name, seconds in cost.items() if _exists(name)}
    with TABLE.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["name", "seconds"])
        rows = sorted((name, value) for name, value in cost.items() if value >= LEAST)
        table.writerows([name, f"{value:.2g}"] for name, value in rows)


if __name__ == "__main__":
    main(sys.argv[1:])
