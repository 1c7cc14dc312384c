"""Where numbers come from: versions, machine, commit, threads of the linear algebra."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import skfem

from ..version import VERSION

__all__ = ["provenance"]

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
