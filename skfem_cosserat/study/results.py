"""Tables of results with where they come from, in files of comma separated values."""

from __future__ import annotations

import csv
import json
import os
import platform
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import skfem

from ..errors import InputError
from ..history.file import plain
from ..version import VERSION

__all__ = ["provenance", "write_rows", "write_table"]


# -- where numbers come from: versions, machine, commit, threads of the linear algebra -------------

COMMIT = ["git", "--no-optional-locks", "describe", "--always", "--dirty", "--abbrev=10"]


def provenance(folder: str | os.PathLike[str] | None = None) -> dict[str, Any]:
    """Versions, machine, commit and threads, now.

    Parameters
    ----------
    folder : path-like, optional
        In the tree whose commit is wanted. Default: the working directory.

    Returns
    -------
    dict
        ``versions`` by package, that of numba if it is installed, ``commit`` (``-dirty`` with
        changes, ``unknown`` outside of a tree of git), ``machine``, ``blas_threads``. Which
        kernels a run took is in its history: tables have a column for it.

    Examples
    --------
    >>> list(provenance())
    ['versions', 'commit', 'machine', 'blas_threads']
    """
    compiled = () if find_spec("numba") is None else ("numba",)
    return {
        "versions": {
            "skfem-cosserat": VERSION,
            "scikit-fem": skfem.__version__,
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "python": platform.python_version(),
            **{name: version(name) for name in compiled},
        },
        "commit": _commit(Path.cwd() if folder is None else Path(folder)),
        "machine": f"{platform.system()} {platform.machine()}, {_processor()},"
        f" {os.cpu_count()} processors",
        "blas_threads": os.environ.get("OPENBLAS_NUM_THREADS", "not set"),
    }


def _commit(folder: Path) -> str:
    try:
        done = subprocess.run(
            COMMIT, cwd=folder, capture_output=True, text=True, timeout=20, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return done.stdout.strip()


def _processor() -> str:
    """Name of the processor, where the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown processor"
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else "unknown processor"


# -- rows with names, and where they come from: a file of comma separated values -------------------


def write_table(
    path: str | os.PathLike[str], notes: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]
) -> Path:
    """Write rows under the names of all of them; what a row does not have stays empty.

    Parameters
    ----------
    path : path-like
        Name of the file; an older one is replaced.
    notes : mapping
        JSON data, for the lines in front that start with ``#``.
    rows : sequence of mappings
        Numbers (all digits are written) and text.

    Raises
    ------
    InputError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> rows = [{"step": 0.5, "status": "diverged"}, {"step": 0.25, "status": "ok", "tip": 1.5}]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = write_table(Path(folder) / "study.csv", {"problem": "bend"}, rows)
    ...     path.read_text().splitlines()
    ['# problem: "bend"', 'step,status,tip', '0.5,diverged,', '0.25,ok,1.5']
    """
    header = list(dict.fromkeys(name for row in rows for name in row))
    return write_rows(path, notes, header, ([row.get(name) for name in header] for row in rows))


def write_rows(
    path: str | os.PathLike[str],
    notes: Mapping[str, Any],
    header: Sequence[str],
    rows: Iterable[Sequence[Any]],
) -> Path:
    """Write rows of cells under a header; `notes` and errors as in :func:`write_table`."""
    path = Path(path)
    try:
        with path.open("w", newline="", encoding="utf-8") as handle:
            for key, value in notes.items():
                handle.write(f"# {key}: {json.dumps(plain(value, f'note {key!r}'))}\n")
            writer = csv.writer(handle, lineterminator="\n")
            writer.writerow(header)
            writer.writerows(rows)
    except OSError as error:
        raise InputError(f"file {str(path)!r}", f"cannot be written: {error.strerror}") from error
    return path
