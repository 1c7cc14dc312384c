"""Errors and warnings: each says which item, which value came, and what was expected."""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import FrozenInstanceError
from typing import Any


class CosseratError(Exception):
    """Base of all errors raised by skfem_cosserat.

    Examples
    --------
    >>> issubclass(InputError, CosseratError), issubclass(Diverged, CosseratError)
    (True, True)
    """

    def __reduce__(self) -> tuple[Any, ...]:
        # its text is not what its constructor takes, which Python would call with it
        own = {"errno": self.errno} if isinstance(self, OSError) else {}  # in no __dict__
        return _error_again, (type(self), self.args), self.__dict__ | own


def _error_again(kind: type[CosseratError], args: tuple[Any, ...]) -> CosseratError:
    error = kind.__new__(kind, *args)
    error.args = args  # those that are OSError, too, forget them
    return error


class InputError(CosseratError, ValueError):
    """Bad input, found before any work starts.

    Parameters
    ----------
    item : str
        What the error is about, e.g. ``"beam 'boom'"`` or ``"argument step"``.
    message : str
        What came (the value), what was expected and, where possible, what to do.

    Attributes
    ----------
    item : str
        As given; the text of the error is ``"item: message"``.

    Examples
    --------
    It is a ``ValueError``, too:

    >>> from skfem_cosserat import MassPoint
    >>> try:
    ...     ball = MassPoint(-1.0)
    ... except InputError as error:
    ...     print(error)
    mass point: mass = -1.0, expected a positive finite number
    """

    def __init__(self, item: str, message: str):
        self.item = item
        super().__init__(f"{item}: {message}")


def failed(item: str, what: str, error: Exception, t: float | None = None) -> InputError:
    """Error for a function of a user that failed: it names item, function and time.

    Errors of this package keep their text.
    """
    text = str(error)
    if not isinstance(error, CosseratError):
        at = "" if t is None else f" at t = {t:.9g} s"
        text = f"{what} failed{at}: {type(error).__name__}: {error}"
    return InputError(item, text)


class MeshError(InputError):
    """A mesh that cannot carry beams (no lines, zero-length elements, unknown names).

    Examples
    --------
    >>> from skfem_cosserat import MeshCurve
    >>> try:
    ...     elements = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="boom").elements_of("mast")
    ... except MeshError as error:
    ...     print(error)
    beam 'mast': unknown; known beams: 'boom'
    """


class HistoryError(InputError):
    """A history file that is not ours, cut short, or does not belong to the model.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from skfem_cosserat import History
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "notes.txt"
    ...     size = path.write_text("no history")
    ...     try:
    ...         history = History.load(path)
    ...     except HistoryError as error:
    ...         print(type(error).__name__)
    HistoryError
    """


class StorageError(CosseratError, OSError):
    """A file that takes no more, as on a full disk; what was computed is kept.

    Attributes
    ----------
    path : str
        Name of the file; of a history file what was written before is sound.
    time : float or None
        Time (s), or load factor, of the last state that was computed; None for other files.
    history : History or None
        All states, those in a history file included; None for other files.

    Examples
    --------
    >>> error = StorageError("run.history", OSError(28, "No space left on device"), "", 0.5)
    >>> error.path, error.time, isinstance(error, OSError)
    ('run.history', 0.5, True)

    What was computed goes to another disk: ``error.history.save("/other/run.history")``.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        reason: OSError,
        advice: str,
        time: float | None = None,
    ):
        self.path = os.fspath(path)
        self.time = time
        self.history: Any = None
        when = "" if time is None else f" at t = {time:.6g}"
        why = reason.strerror or type(reason).__name__
        super().__init__(f"file {self.path!r}: cannot be written{when}: {why}{advice}")
        self.errno = reason.errno


#: what a system says when there is no room, or the disk fails
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


@contextmanager
def writing(path: str | os.PathLike[str], what: str = "file") -> Iterator[None]:
    """Tell of what cannot be written inside: StorageError on a full disk, else InputError."""
    try:
        yield
    except CosseratError:
        raise
    except OSError as error:
        name = os.fspath(error.filename or path)
        if error.errno in FULL:
            raise StorageError(name, error, "") from error
        raise InputError(f"{what} {name!r}", f"cannot be written: {error.strerror}") from error


class IncompatibleError(InputError):
    """Two choices that do not work together; both are named.

    Examples
    --------
    Discrete Legendre transforms compare a step with the next one, and a history of every fifth step
    does not have both.

    >>> from skfem_cosserat import JointDistance, MassPoint, Model, NullSpace, Variational
    >>> from skfem_cosserat import ground, simulate
    >>> from skfem_cosserat.diagnostics import legendre_transforms
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(1.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> system = model.freeze()
    >>> history = simulate(system, Variational(), NullSpace(), 0.1, until=1.0, every=5)
    >>> try:
    ...     minus, plus = legendre_transforms(system, history)
    ... except IncompatibleError as error:
    ...     print(error.item)
    discrete Legendre transforms
    """


class FrozenError(InputError, FrozenInstanceError):
    """An attribute of something built was to be set; the text says what to do instead.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint
    >>> ball = MassPoint(1.0)
    >>> try:
    ...     ball.mass = 2.0
    ... except FrozenError as error:
    ...     print(error)   # doctest: +NORMALIZE_WHITESPACE
    mass point: mass cannot be set: what is built does not change; make another one, and a model
    with it
    """


class Diverged(CosseratError, RuntimeError):
    """A step in time or on a path could not be solved; everything computed up to it is kept.

    Attributes
    ----------
    time : float
        Time (s), or load factor, at the start of the failed step: the last state that is valid.
    step : int
        Number of the failed step (the first step has number 1).
    residual : float
        Smallest scaled residual that was reached.
    reason, advice : str
        Why Newton's method stopped, and what to try, the most promising first.
    hint : str
        What else the run knows about the step; empty, or a sentence of the text.
    residuals : list of lists of float
        Scaled residuals of each attempt at the step, iteration by iteration.
    settings : NewtonSettings or None
        Of these attempts; None where it was not Newton's method that failed.
    history : History or None
        The history up to the failed step, filled in by ``simulate``; None from ``steps``.
    warnings : list of dict
        What was doubtful before, as in ``history.meta["warnings"]``; the text says it too.

    Examples
    --------
    A blow that the step does not resolve; what was computed before it is kept:

    >>> from skfem_cosserat import JointDistance, LoadForce, MassPoint, Model, Multipliers
    >>> from skfem_cosserat import Table, Variational, ground, simulate
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(1.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> blow = model.add("blow", LoadForce(bob.place(), (1e4, 0, 0), Table([0.3, 0.4], [0, 1])))
    >>> try:
    ...     history = simulate(model.freeze(), Variational(), Multipliers(), 0.1, until=1.0)
    ... except Diverged as error:
    ...     history = error.history
    ...     print(f"step {error.step} from t = {error.time:.1f} s")
    step 4 from t = 0.3 s
    >>> len(history), history.status
    (4, 'diverged')
    """

    def __init__(
        self,
        time: float,
        step: int,
        residual: float,
        reason: str,
        advice: str,
        residuals: list[list[float]] | None = None,
        at: str | None = None,
        settings: Any = None,
        effort: str = "",
    ):
        self.time = time
        self.step = step
        self.residual = residual
        self.reason = reason
        self.advice = advice
        self.residuals = [] if residuals is None else residuals
        self.history: Any = None
        self.settings = settings
        self.warnings: list[dict[str, Any]] = []
        self.warned = self.hint = ""
        where = f"t = {time:.9g} s" if at is None else at
        known = math.isfinite(residual) and residual > 0
        details = ", ".join([effort] * bool(effort) + [f"scaled residual {residual:.3g}"] * known)
        super().__init__(
            f"step {step} from {where} could not be solved: {reason}."
            f" {advice[:1].upper()}{advice[1:]}" + (f" ({details})" if details else "")
        )

    def __str__(self) -> str:
        text = super().__str__()
        text = f"{text}. {self.hint[:1].upper()}{self.hint[1:]}" if self.hint else text
        return f"{text}; warned before: {self.warned}" if self.warned else text


class JobError(CosseratError, RuntimeError):
    """A job of :func:`run_all` has no outcome of its own: its worker ended, or it was cancelled.

    Attributes
    ----------
    job : str
        Name of the job.
    reason : str
        What happened.

    Examples
    --------
    A lock cannot be handed from one process to another:

    >>> import threading
    >>> from skfem_cosserat import Job, Processes, run_all
    >>> with Processes(1) as executor:
    ...     (outcome,) = run_all([Job("lock", threading.Lock)], executor)
    >>> print(type(outcome.error).__name__, outcome.error)  # doctest: +ELLIPSIS
    JobError job 'lock': its value, of type lock, cannot travel between processes: TypeError: ...
    """

    def __init__(self, job: str, reason: str):
        self.job = job
        self.reason = reason
        super().__init__(f"job {job!r}: {reason}")


class CosseratWarning(UserWarning):
    """Base of all warnings: what the program knows about a doubtful result.

    Runs, paths and studies keep the warnings that were given in ``meta["warnings"]``. To end at
    the first one: ``warnings.simplefilter("error", CosseratWarning)``.

    Examples
    --------
    >>> kinds = AccuracyWarning, ModelWarning, IncompleteWarning, PerformanceWarning
    >>> all(issubclass(kind, CosseratWarning) for kind in kinds)
    True
    """


class AccuracyWarning(CosseratWarning):
    """A result that may be wrong: elements bent too far, energy out of balance, another branch."""


class ModelWarning(CosseratWarning):
    """A scene, mesh or start that is taken, but may not be what was meant."""


class IncompleteWarning(CosseratWarning):
    """Something that was asked for is missing from a result."""


class PerformanceWarning(CosseratWarning):
    """Results are right, but cost more than they need to."""
