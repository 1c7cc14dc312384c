"""What was run when, on what, and how long it took; tables that carry this along."""

from __future__ import annotations

import csv
import json
import os
import platform
import subprocess
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import skfem

import skfem_cosserat as sc
from skfem_cosserat import kernels

HERE = Path(__file__).resolve().parent


def main() -> dict[str, Any]:
    """Provenance of numbers made now: versions, machine, commit, threads of the linear algebra."""
    return {
        "versions": {
            "skfem-cosserat": sc.__version__,
            "scikit-fem": skfem.__version__,
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "python": platform.python_version(),
        },
        "kernels": kernels.NAME,
        "commit": _commit(),
        "machine": f"{platform.system()} {platform.machine()}, {_processor()},"
        f" {os.cpu_count()} processors",
        "blas_threads": os.environ.get("OPENBLAS_NUM_THREADS", "not set"),
    }


def _commit() -> str:
    """Commit of the tree this file is in, ``-dirty`` with changes; unknown outside of one."""
    command = ["git", "--no-optional-locks", "describe", "--always", "--dirty", "--abbrev=10"]
    try:
        done = subprocess.run(
            command, cwd=HERE, capture_output=True, text=True, timeout=20, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return done.stdout.strip()


def _processor() -> str:
    """Name of the processor, where the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or "unknown processor"
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else "unknown processor"


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
        with path.open("w", newline="", encoding="utf-8") as handle:
            for key, value in (self.provenance | {"run": self.runs[run - 1]}).items():
                handle.write(f"# {key}: {json.dumps(value)}\n")
            writer = csv.writer(handle, lineterminator="\n")
            writer.writerow(header)
            writer.writerows(rows)
        return path


def read_csv(path: Path) -> tuple[dict[str, Any], list[str], list[list[str]]]:
    """Provenance, header and rows of a table of :class:`Record`."""
    lines = path.read_text(encoding="utf-8").splitlines()
    notes = [line[2:].partition(": ") for line in lines if line.startswith("# ")]
    table = list(csv.reader(line for line in lines if not line.startswith("# ")))
    return {key: json.loads(value) for key, _, value in notes}, table[0], table[1:]
