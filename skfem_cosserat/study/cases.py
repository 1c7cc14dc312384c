"""Independent cases, each kept in a folder once it is done, so that a killed study goes on."""

from __future__ import annotations

import json
import os
import pickle
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from ..errors import Diverged, InputError, JobError
from ..export import prepare_folder
from ..history import History
from ..log import logger
from ..parallel import Executor, Job, Outcome, run_all
from ..parallel.jobs import Caught
from ..parallel.run import CANCELLED
from ..simulate.progress import Progress
from .fingerprint import digest, token

__all__ = ["OnOutcome", "run_cases", "status"]

OnOutcome = Callable[[int, int, Outcome], object]
INDEX = "study.json"
FORMAT = 1


def run_cases(
    jobs: Iterable[Job],
    executor: Executor | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    identity: Mapping[str, str] | None = None,
    progress: bool | OnOutcome = False,
    check: Callable[[Outcome], object] | None = None,
    retry: bool = False,
) -> list[Outcome]:
    """Run jobs as `run_all` does; with a folder only those that are not in it yet.

    Parameters
    ----------
    jobs : iterable of Job
        With different names.
    executor : executor, optional
        See :func:`run_all`.
    folder : path-like, optional
        Made if needed. Each outcome is written as soon as it is there, failures too; not written
        are jobs that did not run, lost their worker or were interrupted by Ctrl-C. A case is
        recognised by its name and arguments.
    identity : mapping of str to str, optional
        What all cases in the folder share, see :func:`~skfem_cosserat.study.fingerprint.identity`.
    progress : bool or callable
        See :func:`run_all`; cases that the folder holds are counted as done.
    check : callable, optional
        Gets each outcome first, also those from the folder; what it raises ends the study.
    retry : bool
        Run cases again that have failed.

    Returns
    -------
    list of Outcome
        In the order of the jobs.

    Raises
    ------
    InputError
        If the folder holds cases of another identity: the error names what differs; if it cannot
        be written, or a result cannot be pickled.

    Notes
    -----
    Files in the folder are pickled: read only what you wrote.

    Examples
    --------
    >>> import math, tempfile
    >>> jobs = [Job(f"x = {x}", math.sqrt, x) for x in (1.0, 4.0, -1.0)]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     first = run_cases(jobs, folder=folder)
    ...     again = run_cases(jobs, folder=folder)  # nothing is computed
    >>> [outcome.value for outcome in again], status(again[2])
    ([1.0, 2.0, None], 'error')
    """
    jobs = list(jobs)
    store = None if folder is None else _Store(Path(folder), dict(identity or {}))
    kept: dict[str, Outcome] = {}
    if store is not None:
        found = {job.name: store.read(job) for job in jobs}
        kept = {name: each for name, each in found.items() if each and (each.ok or not retry)}
    missing = [job for job in jobs if job.name not in kept]
    by_name = {job.name: job for job in jobs}
    with Progress(progress, _line) as show:

        def keep(done: int, _count: int, outcome: Outcome) -> None:
            if store is not None:
                store.write(by_name[outcome.name], outcome)
            if check is not None:
                check(outcome)
            show(len(kept) + done, len(jobs), outcome)

        if check is not None:
            for outcome in kept.values():
                check(outcome)
        new = {each.name: each for each in run_all(missing, executor, progress=keep)}
    return [kept.get(job.name) or new[job.name] for job in jobs]


def status(outcome: Outcome) -> str:
    """In a word: ``ok``, ``diverged``, ``interrupted``, ``not run`` or ``error``."""
    if outcome.ok:
        return "interrupted" if _interrupted(outcome.value) else "ok"
    if isinstance(outcome.error, Diverged):
        return "diverged"
    if isinstance(outcome.error, JobError) and outcome.error.reason == CANCELLED:
        return "not run"
    return "error"


def _line(done: int, count: int, outcome: Outcome) -> str:
    return f"{done} of {count} cases done, last {outcome.name!r}"


def _interrupted(value: Any) -> bool:
    return isinstance(value, History) and value.status == "interrupted"


class _Store:
    """A folder of outcomes, one file each."""

    def __init__(self, folder: Path, identity: dict[str, str]) -> None:
        prepare_folder(folder)
        self.folder = folder
        index = folder / INDEX
        if not index.exists():
            content = {"format": FORMAT, "identity": identity}
            self._replace(index, json.dumps(content, indent=1).encode())
        found = self._index(index)
        for name in found | identity:
            if found.get(name) != identity.get(name):
                raise InputError(
                    self.label,
                    f"holds cases of another study: {name} was {found.get(name)}, is now"
                    f" {identity.get(name)}; choose another folder or delete this one",
                )

    @property
    def label(self) -> str:
        return f"folder {str(self.folder)!r}"

    def _index(self, path: Path) -> dict[str, str]:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(self.label, f"its {INDEX} cannot be read: {error}") from error
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise InputError(self.label, f"its {INDEX} is not of a study of format {FORMAT}")
        return dict(content["identity"])

    def path(self, job: Job) -> Path:
        """File of a case: its name, made readable, and a sum of its arguments."""
        what = token([job.name, job.args, job.kwargs], f"case {job.name!r}")
        readable = re.sub(r"[^\w.+-]+", "_", job.name)[:80]
        return self.folder / f"{readable}.{digest(what)}.case"

    def read(self, job: Job) -> Outcome | None:
        """The outcome that is kept, if there is one that can be read."""
        path, outcome, reading = self.path(job), None, Caught()
        if not path.exists():
            return None
        with reading:
            outcome = pickle.loads(path.read_bytes())
        if isinstance(outcome, Outcome):
            return outcome
        logger.warning("%s cannot be read (%s): the case is run again", path, reading.error)
        return None

    def write(self, job: Job, outcome: Outcome) -> None:
        """Keep an outcome that another run would have too."""
        if isinstance(outcome.error, JobError) or _interrupted(outcome.value):
            return
        pickling, data = Caught(), b""
        with pickling:
            data = pickle.dumps(outcome, pickle.HIGHEST_PROTOCOL)
        if pickling.error is not None:
            raise InputError(
                f"case {job.name!r}",
                f"gave what cannot be kept in a file ({pickling.error}): give numbers, arrays or"
                " a History, or take folder=None",
            ) from pickling.error
        self._replace(self.path(job), data)

    def _replace(self, path: Path, data: bytes) -> None:
        """Write at once or not at all."""
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            part.write_bytes(data)
            part.replace(path)
        except OSError as error:
            raise InputError(self.label, f"cannot be written: {error.strerror}") from error
