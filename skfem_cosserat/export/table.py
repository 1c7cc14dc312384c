"""Files of comma separated values: series of a history, rows of a study."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..arguments import checked
from ..errors import InputError, writing
from ..history import History
from ..history.file import plain
from ..types import FilePath

#: numbers per state above which a quantity is not in a table unless named
WIDE = 6
_PROVENANCE = ("integrator", "treatment", "step", "kernels", "versions", "status")


def _default_names(history: History) -> list[str]:
    """Time first, then all series of few numbers that are no coordinates."""
    names = [
        name
        for name, array in history.series.items()
        if name not in ("t", "q", "p", "v") and (array.ndim == 1 or _columns(array) <= WIDE)
    ]
    return ["t", *(name for name in names if history[name].ndim <= 2)]


def _columns(array: np.ndarray) -> int:
    return int(np.prod(array.shape[1:]))


def column_names(name: str, array: np.ndarray) -> list[str]:
    """Names of the columns of an array of numbers, or of rows of numbers."""
    if array.ndim == 1:
        return [name]
    ends = "xyz" if array.shape[1] == 3 else [str(k) for k in range(array.shape[1])]
    return [f"{name}_{end}" for end in ends]


@checked
def write_csv(history: History, path: FilePath, names: Sequence[str] | None = None) -> Path:
    """Write scalar and vector series, one line a state, all digits kept.

    Lines in front of the table start with ``#`` and say which versions and methods made the
    numbers. Vectors of three numbers become columns ``name_x, name_y, name_z``.

    Parameters
    ----------
    history : History
        Recorded states.
    path : path-like
        Name of the file; an older one is replaced.
    names : sequence of str, optional
        Series to be written. Default: ``t`` and all series with at most six numbers per state.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If a series does not exist or is no scalar or vector, or the file cannot be written.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import numpy as np
    >>> zeros = np.zeros((2, 9))
    >>> series = {"t": [0.0, 0.1], "step": [0, 1], "q": zeros, "p": zeros, "energy": [2.0, 2.5]}
    >>> history = History({"status": "completed"}, {}, series)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = write_csv(history, pathlib.Path(folder) / "run.csv")
    ...     path.read_text().splitlines()[-3:]
    ['t,step,energy', '0.0,0,2.0', '0.1,1,2.5']
    """
    chosen = _default_names(history) if names is None else list(names)
    header = []
    columns = []
    for name in chosen:
        array = history[name]
        if array.ndim > 2:
            raise InputError(
                f"series {name!r}", f"has shape {array.shape}, a table takes scalars and vectors"
            )
        header += column_names(name, array)
        columns += (array[:, None] if array.ndim == 1 else array).T.tolist()
    notes = {key: history.meta[key] for key in _PROVENANCE if key in history.meta}
    return write_rows(path, notes, header, zip(*columns, strict=True), "skfem-cosserat history")


@checked
def write_rows(
    path: FilePath,
    notes: Mapping[str, Any],
    header: Sequence[str],
    rows: Iterable[Sequence[Any]],
    title: str = "",
) -> Path:
    """Write rows of cells under a header.

    Parameters
    ----------
    path : path-like
        Name of the file; an older one is replaced.
    notes : mapping
        JSON data, for the lines in front that start with ``#``.
    header : sequence of str
    rows : iterable of sequences
        Numbers (all digits are written) and text.
    title : str
        A line above the notes.

    Raises
    ------
    InputError
        If the file cannot be written.
    StorageError
        If the disk is full.
    """
    path = Path(path)
    with writing(path), path.open("w", newline="", encoding="utf-8") as handle:
        if title:
            handle.write(f"# {title}\n")
        for key, value in notes.items():
            handle.write(f"# {key}: {json.dumps(plain(value, f'note {key!r}'))}\n")
        writer = csv.writer(handle, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
    return path
