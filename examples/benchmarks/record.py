"""What was run when, on what, and how long it took; tables that carry this along."""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import skfem_cosserat as sc

HERE = Path(__file__).resolve().parent


def main() -> dict[str, Any]:
    """Provenance of numbers made now: versions, machine, commit, threads of the linear algebra."""
    return sc.accuracy.provenance(HERE)


class Record:
    """The runs of a session, numbered from 1.

    Attributes
    ----------
    provenance : dict
        See :func:`main`.
    runs : list of dict
        ``title``, ``date`` (UTC, at the start) and ``seconds`` (wall time) of each.
    """

    def __init__(self) -> None:
        self.provenance = main()
        self.runs: list[dict[str, Any]] = []

    @contextmanager
    def run(self, title: str) -> Iterator[int]:
        """Time what is inside; gives the number of the run."""
        entry: dict[str, Any] = {
            "title": title,
            "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S UTC"),
        }
        self.runs.append(entry)
        start = time.perf_counter()
        yield len(self.runs)
        entry["seconds"] = time.perf_counter() - start

    def write_csv(
        self, path: Path, run: int, header: Sequence[str], rows: Iterable[Sequence[Any]]
    ) -> Path:
        """Table with comma separated values; lines in front of it that start with # say whence."""
        notes = self.provenance | {"run": self.runs[run - 1]}
        return sc.accuracy.write_rows(path, notes, header, rows)


def read_csv(path: Path) -> tuple[dict[str, Any], list[str], list[list[str]]]:
    """Provenance, header and rows of a table of :class:`Record`."""
    lines = path.read_text(encoding="utf-8").splitlines()
    notes = [line[2:].partition(": ") for line in lines if line.startswith("# ")]
    table = list(csv.reader(line for line in lines if not line.startswith("# ")))
    return {key: json.loads(value) for key, _, value in notes}, table[0], table[1:]
