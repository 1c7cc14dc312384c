"""Rows with names, and where they come from: a file of comma separated values."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..history.data import plain

__all__ = ["write_rows", "write_table"]


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
