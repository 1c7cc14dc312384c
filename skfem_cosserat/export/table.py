"""Tables: series of a history, rows of a study, and where they come from."""

from __future__ import annotations

import csv
import io
import json
import os
import platform
import subprocess
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ..arguments import checked
from ..errors import InputError, writing
from ..history import History, SensorRecord
from ..history.file import plain
from ..types import Array, FilePath, Floats, Meta
from ..version import VERSION

#: values of a row by the names of columns
TableRow: TypeAlias = dict[str, Any]
#: numbers per state above which a quantity is not in a table unless named
WIDE = 6
_PROVENANCE = ("integrator", "treatment", "step", "kernels", "versions", "status")


def default_names(history: History) -> list[str]:
    """Time first, then all series of few numbers that are no coordinates."""
    names = [
        name
        for name, array in history.series.items()
        if name not in ("t", "q", "p", "v") and array.ndim <= 2 and np.prod(array.shape[1:]) <= WIDE
    ]
    return ["t", *names]


def column_names(name: str, array: np.ndarray) -> list[str]:
    """Names of the columns of an array of numbers, or of rows of numbers."""
    if array.ndim == 1:
        return [name]
    ends = "xyz" if array.shape[1] == 3 else [str(k) for k in range(array.shape[1])]
    return [f"{name}_{end}" for end in ends]


def record_of(history: History, name: str) -> SensorRecord:
    """Numbers or vectors that a sensor saw at every step, or else those of a series.

    Series of one place ``(N, 1, k)``, as of a load, are vectors of it.

    Raises
    ------
    InputError
        If there is no such sensor or series, or it has more axes.
    """
    record = history.sensors.get(name)
    if record is None:
        values = history[name]
        one = values.shape[1:-1] == (1,)
        record = SensorRecord(history.abscissa, values[:, 0] if one else values)
    if record.values.ndim > 2:
        text = f"has shape {record.values.shape}, expected scalars and vectors: choose some of its"
        text += " numbers by history.add_series, or take sensors, as SensorForce(beam, s)"
        raise InputError(f"series {name!r}", text)
    return record


def columns_of(history: History, names: Sequence[str]) -> tuple[Floats, dict[str, Array]]:
    """Instants of the rows of a table, and its columns by name: see :func:`write_csv`."""
    sensors = history.sensors
    times = history.abscissa
    columns = {}
    if names and set(names) <= sensors.keys():
        columns["t"] = times = sensors[names[0]].times
    for name in names:
        record = record_of(history, name)
        rows = np.atleast_2d(record.values.T)
        for column, row in zip(column_names(name, record.values), rows, strict=True):
            # states are among the instants of sensors
            columns[column] = np.interp(times, record.times, row) if name in sensors else row
    return times, columns


@checked
def write_csv(history: History, path: FilePath, names: Sequence[str] | None = None) -> Path:
    """Write scalar and vector series, and what sensors saw, one line a state, all digits kept.

    Lines in front of the table start with ``#`` and say which versions and methods made the
    numbers. Vectors of three numbers become columns ``name_x, name_y, name_z``.

    Parameters
    ----------
    history : History
        Recorded states.
    path : path-like
        Name of the file; an older one is replaced.
    names : sequence of str, optional
        Series and sensors to be written. Of sensors, which see every step, the lines have what they
        saw at the recorded states; sensors alone have one line a step, with its time in front.
        Default: ``t`` and all series with at most six numbers per state.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If there is no such series or sensor, it is no scalar or vector, or the file cannot be
        written.

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
    _, columns = columns_of(history, default_names(history) if names is None else names)
    rows = zip(*(each.tolist() for each in columns.values()), strict=True)
    notes = {key: history.meta[key] for key in _PROVENANCE if key in history.meta}
    return write_rows(path, notes, list(columns), rows, "skfem-cosserat history")


def to_pandas(history: History, names: Sequence[str] = ()) -> Any:
    """Series and sensors as a ``pandas.DataFrame``, see :meth:`History.to_pandas`."""
    times, columns = columns_of(history, names or default_names(history)[1:])
    columns.pop("t", None)
    frame = data_frame(columns, {}, index=times)
    return frame.rename_axis("load_factor" if "load_factor" in history else "t")


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


# -- where numbers come from: versions, machine, commit, threads of the linear algebra -------------

COMMIT = ["git", "--no-optional-locks", "describe", "--always", "--dirty", "--abbrev=10"]


@checked
def provenance(folder: FilePath | None = None) -> Meta:
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
            **{name: version(name) for name in ("scikit-fem", "numpy", "scipy", *compiled)},
            "python": platform.python_version(),
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


def data_frame(data: Any, notes: Mapping[str, Any], **options: Any) -> Any:
    """A ``pandas.DataFrame`` with notes as its ``attrs``."""
    try:
        from pandas import DataFrame
    except ImportError as error:
        raise ImportError("pandas is needed here: pip install skfem-cosserat[pandas]") from error
    frame = DataFrame(data, **options)
    frame.attrs |= notes
    return frame


# -- rows with names, and where they come from -----------------------------------------------------


@checked
@dataclass(frozen=True, eq=False)
class ResultTable:
    """Rows of results under their names; what a row does not have stays empty.

    Attributes
    ----------
    rows : sequence of mappings
        Numbers and text.
    notes : mapping
        JSON data on where they come from.

    Examples
    --------
    >>> rows = [{"step": 0.5, "status": "diverged"}, {"step": 0.25, "status": "ok", "tip": 1.5}]
    >>> print(ResultTable(rows).to_markdown())
    | step | status | tip |
    | --- | --- | --- |
    | 0.5 | diverged |  |
    | 0.25 | ok | 1.5 |
    """

    rows: Sequence[Mapping[str, Any]]
    notes: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, path: FilePath) -> ResultTable:
        """A table that :meth:`to_csv` has written: numbers are numbers again, empty cells None.

        Raises
        ------
        InputError
            If the file cannot be read.

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = ResultTable([{"step": 0.5, "status": "ok"}], {"n": 1}).to_csv(f"{folder}/s")
        ...     again = ResultTable.read(path)
        >>> again.rows, again.notes
        ([{'step': 0.5, 'status': 'ok'}], {'n': 1})
        """
        try:
            text = Path(path).read_text(encoding="utf-8")
        except OSError as error:
            raise InputError(f"file {str(path)!r}", f"cannot be read: {error.strerror}") from error
        notes = {}
        table = io.StringIO(text, newline="")
        start = table.tell()
        while (line := table.readline()).startswith("# "):
            name, _, value = line[2:].partition(": ")
            with suppress(json.JSONDecodeError):
                notes[name] = json.loads(value)
            start = table.tell()
        table.seek(start)
        return cls([{k: _cell(v) for k, v in row.items()} for row in csv.DictReader(table)], notes)

    @property
    def columns(self) -> list[str]:
        """The names of all rows."""
        return list(dict.fromkeys(name for row in self.rows for name in row))

    @property
    def cells(self) -> list[list[Any]]:
        """By row and column; None where a row has nothing."""
        columns = self.columns
        return [[row.get(name) for name in columns] for row in self.rows]

    def to_csv(self, path: FilePath) -> Path:
        """Write rows with all digits, the notes in front of them; an older file is replaced.

        Raises
        ------
        InputError
            If the file cannot be written.

        Examples
        --------
        >>> import tempfile
        >>> table = ResultTable([{"step": 0.5}], {"problem": "bend"})
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = table.to_csv(f"{folder}/study.csv")
        ...     path.read_text().splitlines()
        ['# problem: "bend"', 'step', '0.5']
        """
        return write_rows(path, self.notes, self.columns, self.cells)

    def to_markdown(self) -> str:
        """The rows as text, numbers with six digits."""
        lines = [self.columns, ["---"] * len(self.columns), *self.cells]
        return "\n".join(f"| {' | '.join(map(_short, line))} |" for line in lines)

    def to_pandas(self) -> Any:
        """The rows as a ``pandas.DataFrame``, the notes as its ``attrs``.

        Raises
        ------
        ImportError
            Without pandas.
        """
        return data_frame(self.cells, self.notes, columns=self.columns)


def _cell(text: str) -> Any:
    """A number where the text is one, None if there is none."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return {"True": True, "False": False, "": None}.get(text, text)


def _short(cell: Any) -> str:
    if cell is None:
        return ""
    shown = f"{cell:.6g}" if isinstance(cell, float) else str(cell)
    return shown.replace("|", "\\|").replace("\n", " ")


class Report(ABC):
    """Base of the results of studies, which give their rows as a table."""

    @property
    @abstractmethod
    def table(self) -> ResultTable:
        """Its rows, with where they come from."""

    def csv(self, path: FilePath) -> Path:
        """Write the :attr:`table`.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        return self.table.to_csv(path)
