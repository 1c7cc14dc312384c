"""Jobs and their outcomes, how both travel, and what stands in the way."""

from __future__ import annotations

import hashlib
import io
import pickle
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import BuiltinFunctionType, FunctionType, MethodType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arguments import checked
from ..errors import InputError, JobError
from ..frames import Attached, Item
from ..model import Model, System
from ..warn import Notices, counted

# -- jobs and their outcomes, and how both travel: as pickled data, functions by reference ---------


@checked
class Job:
    """A call to make, under a name.

    Parameters
    ----------
    name : str
        Of the job, in progress and errors; not empty.
    function : callable
        To reach another process it must be importable there: at the top level of a module.
        ``simulate``, ``static`` and ``modes`` are.
    *args, **kwargs
        What it is called with. To reach another process all must be data: models, systems, states
        and histories are. A beam takes some 1 kB an element; a function that builds the model where
        it is needed takes nothing.

    Raises
    ------
    InputError
        If the name is empty or the function cannot be called.

    Examples
    --------
    >>> import math
    >>> Job("two", math.hypot, 3.0, 4.0)
    <Job 'two': hypot>
    """

    def __init__(
        self, name: str, function: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> None:
        if not isinstance(name, str) or not name:
            raise InputError("job", f"name = {name!r}, expected a non-empty string")
        if not callable(function):
            raise InputError(f"job {name!r}", f"{function!r} cannot be called")
        self.name, self.function, self.args, self.kwargs = name, function, args, kwargs

    def __repr__(self) -> str:
        called = getattr(self.function, "__name__", repr(self.function))
        return f"<Job {self.name!r}: {called}>"


@dataclass(frozen=True, eq=False, repr=False)
class Outcome:
    """What came of a job: a value or an error.

    Attributes
    ----------
    name : str
        Of the job.
    value : object
        What its function gave; None if it failed.
    error : Exception or None
        What it raised, with its attributes (``Diverged`` with ``history``, ``residuals``, ...), or
        a :class:`JobError` if its worker ended, it called ``sys.exit`` or raised what is no
        ``Exception``, it was cancelled, or something could not travel.
    seconds : float
        How long its function ran (s); NaN if that is not known.
    traceback : str
        Where it failed, as text; empty if it did not.
    warnings : sequence of dict
        Given on the way, as in ``history.meta["warnings"]``.

    Examples
    --------
    >>> import math
    >>> from skfem_cosserat import run_all
    >>> good, bad = run_all([Job("4", math.sqrt, 4.0), Job("-1", math.sqrt, -1.0)])
    >>> good.result(), bad.ok, type(bad.error).__name__
    (2.0, False, 'ValueError')
    """

    name: str
    value: Any = None
    error: Exception | None = None
    seconds: float = float("nan")
    traceback: str = ""
    warnings: Sequence[dict[str, Any]] = ()

    @property
    def ok(self) -> bool:
        """Whether there is a value."""
        return self.error is None

    def result(self) -> Any:
        """The value; raises the error if there is none."""
        if self.error is not None:
            raise self.error
        return self.value

    def __repr__(self) -> str:
        if self.error is None:
            what = f"{type(self.value).__name__} in {self.seconds:.3g} s"
        else:
            what = in_words(self.error)
        return f"<Outcome {self.name!r}: {what}{counted(self.warnings)}>"


class Caught:
    """A context that keeps what a job raises: its error is its outcome, and not ours.

    Ctrl-C goes through; a job that calls ``sys.exit`` has failed, but ends nobody else, and so has
    one with an error that is no ``Exception``, as asyncio's for what was cancelled.
    """

    def __init__(self) -> None:
        self.error: BaseException | None = None

    def __enter__(self) -> Caught:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        if error is None or isinstance(error, KeyboardInterrupt):
            return False
        self.error = error
        return True


class _Call(NamedTuple):
    """How a call ended."""

    value: Any
    error: Exception | None
    seconds: float
    traceback: str
    warnings: list[dict[str, Any]]


def call(
    name: str, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]
) -> _Call:
    """Do the job of this name, and keep what it raises and warns of."""
    value, caught, start = None, Caught(), time.perf_counter()
    with Notices(quiet=True, alone=True) as notices, caught:
        value = function(*args, **kwargs)
    seconds, error = time.perf_counter() - start, caught.error
    text = "" if error is None else _text(error)
    if isinstance(error, SystemExit):
        error = JobError(name, f"it called sys.exit({error.code!r})")
    elif error is not None and not isinstance(error, Exception):
        error = JobError(name, f"it raised {in_words(error)}")
    return _Call(value, error, seconds, text, notices.kept())


def done_here(job: Job) -> Outcome:
    """Do a job in this process, with its own arguments."""
    return Outcome(job.name, *call(job.name, job.function, job.args, job.kwargs))


# -- there and back --------------------------------------------------------------------------------


#: bytes of an array from which on it is apart from what has it
LARGE = 4096


class Pickled(NamedTuple):
    """A pickled object, large arrays apart: within the bytes they would be copied at each turn."""

    data: bytes
    arrays: list[NDArray[np.uint8]]

    @classmethod
    def of(cls, thing: Any) -> Pickled:
        """Pickle a thing; its arrays are copied."""
        arrays = []

        def within(buffer: pickle.PickleBuffer) -> bool:
            numbers = np.frombuffer(buffer.raw(), np.uint8)
            if numbers.size >= LARGE:
                arrays.append(numbers.copy())
            return numbers.size < LARGE

        return cls(pickle.dumps(thing, pickle.HIGHEST_PROTOCOL, buffer_callback=within), arrays)

    def load(self) -> Any:
        """The thing again; its arrays are these."""
        return pickle.loads(self.data, buffers=self.arrays)


class Answer(NamedTuple):
    """What comes back from a worker: plain data, whatever the job gave or raised.

    `content` is the value, or the error if `failed`, None if it cannot be pickled; `what` says in
    words what it is, for the case that it cannot be read.
    """

    failed: bool
    content: Pickled | None
    what: str
    seconds: float
    traceback: str
    warnings: list[dict[str, Any]]


class Packed(NamedTuple):
    """A job that travels: its call, and the systems that are apart from it, by their digests."""

    call: bytes
    systems: Mapping[str, bytes]


class _Packer(pickle.Pickler):
    """Leaves out systems, and notes whether anything else belongs to a model."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self.systems: dict[int, System] = {}
        self.attached = False

    def persistent_id(self, obj: object) -> int | None:
        """Of a system its number, of other objects None: they are pickled as usual."""
        self.attached = self.attached or isinstance(obj, Attached)
        if not isinstance(obj, System):
            return None
        self.systems[id(obj)] = obj
        return id(obj)


class _Unpacker(pickle.Unpickler):
    """Puts systems back."""

    def __init__(self, file: io.BytesIO, systems: Mapping[int, System]) -> None:
        super().__init__(file)
        self._systems = systems

    def persistent_load(self, pid: Any) -> System:
        """The system of a number."""
        return self._systems[pid]


class Packer:
    """Packs jobs; a system that several of them have is pickled once.

    A system goes apart from its call, so that a worker freezes it once for all jobs that have it.
    It goes with the call where other arguments, as places, belong to the same model.
    """

    def __init__(self) -> None:
        self._known: dict[int, tuple[System, str, bytes]] = {}

    def pack(self, job: Job) -> Packed:
        """A job's call as bytes, functions by reference."""
        content = job.name, job.function, job.args, job.kwargs
        file = io.BytesIO()
        packer = _Packer(file)
        packer.dump(content)
        if packer.attached or not packer.systems:
            return Packed(pickle.dumps((content, {}), pickle.HIGHEST_PROTOCOL), {})
        found = {number: self._apart(system) for number, system in packer.systems.items()}
        digests = {number: digest for number, (digest, _) in found.items()}
        call = pickle.dumps((file.getvalue(), digests), pickle.HIGHEST_PROTOCOL)
        return Packed(call, dict(found.values()))

    def _apart(self, system: System) -> tuple[str, bytes]:
        if id(system) not in self._known:
            data = pickle.dumps(system, pickle.HIGHEST_PROTOCOL)
            digest = hashlib.blake2b(data, digest_size=16).hexdigest()
            self._known[id(system)] = system, digest, data
        return self._known[id(system)][1:]


#: systems of jobs that were done in this process, by digest; a job takes out those it works with
_KEPT: dict[str, System] = {}
#: how many are kept
_MOST = 4


def _unpacked(packed: Packed) -> tuple[tuple[Any, ...], dict[str, System]]:
    """The call of a job, and its systems by digest."""
    call, digests = pickle.loads(packed.call)
    if not digests:
        return call, {}
    systems = {}
    for digest, data in packed.systems.items():
        kept = _KEPT.pop(digest, None)
        systems[digest] = pickle.loads(data) if kept is None else kept
    numbered = {number: systems[digest] for number, digest in digests.items()}
    return _Unpacker(io.BytesIO(call), numbered).load(), systems


def _keep(systems: Mapping[str, System]) -> None:
    """For jobs that have the same ones."""
    _KEPT.update(systems)
    for digest in list(_KEPT)[:-_MOST]:
        _KEPT.pop(digest, None)


def run_packed(packed: Packed) -> Answer:
    """Do a packed job; in the worker. Nothing that the job is or does makes this fail."""
    reading = Caught()
    with reading:
        (name, function, args, kwargs), systems = _unpacked(packed)
    if reading.error is not None:
        what = (
            f"it cannot be read in the worker process ({in_words(reading.error)}): what it refers"
            " to must be importable there"
        )
        return Answer(True, None, what, float("nan"), _text(reading.error), [])
    value, error, seconds, text, warned = call(name, function, args, kwargs)
    sending, content = Caught(), None
    with sending:
        content = Pickled.of(value if error is None else error)
    _keep(systems)
    if error is not None:
        return Answer(True, content, f"it raised {in_words(error)}", seconds, text, warned)
    what = f"its value, of type {type(value).__name__}"
    if sending.error is not None:
        what += f", cannot travel between processes: {in_words(sending.error)}"
        return Answer(True, None, what, seconds, _text(sending.error), warned)
    return Answer(False, content, what, seconds, "", warned)


def read(name: str, answer: Answer) -> Outcome:
    """The outcome that an answer holds."""
    told = answer.seconds, answer.traceback, answer.warnings
    if answer.content is None:
        error = JobError(name, answer.what)
        return Outcome(name, None, error, *told)
    content, reading = None, Caught()
    with reading:
        content = answer.content.load()
    wrong = None
    if reading.error is not None:
        wrong = in_words(reading.error)
    elif answer.failed and not isinstance(content, Exception):
        wrong = f"its pickled form gives {content!r}"
    if wrong is not None:
        error = JobError(name, f"{answer.what}, which cannot be read back: {wrong}")
        return Outcome(name, None, error, *told)
    if answer.failed:
        return Outcome(name, None, content, *told)
    return Outcome(name, content, None, *told)


def in_words(error: BaseException) -> str:
    """Kind and text of an error, whatever its text does."""
    text, asking = "(it has no text)", Caught()
    with asking:
        text = str(error)
    return f"{type(error).__name__}: {text}".rstrip(": ")


def _text(error: BaseException) -> str:
    return "".join(traceback.format_exception(error))


# -- why a job cannot travel: the load, drive or argument that holds what cannot be pickled --------

#: what to do about a function
ADVICE = (
    "write functions with def at the top level of an importable module (parameters by"
    " functools.partial), give loads a Table, or run with executor=None"
)


def refusal(job: Job, error: BaseException) -> InputError:
    """The error for a job that cannot be pickled: names all that stands in the way."""
    label = f"job {job.name!r}"
    named = {"function": job.function}
    named |= {f"argument {k + 1}": value for k, value in enumerate(job.args)}
    named |= {f"argument {name}": value for name, value in job.kwargs.items()}
    found: list[tuple[str, str]] = []
    seen: set[int] = set()
    for where, value in named.items():
        found += _culprits(value, where, seen)
    if not found:  # each can go alone, but not all together
        return InputError(label, f"cannot be sent to another process: {error}; {ADVICE}")
    (where, first), *others = found
    what = "; ".join([first, *(f"{place}: {each}" for place, each in others)])
    return InputError(f"{label}, {where}", f"{what} cannot be sent to another process: {ADVICE}")


def _culprits(value: Any, where: str, seen: set[int]) -> Iterator[tuple[str, str]]:
    """Where the smallest parts are that cannot be pickled, and what, each once."""
    if id(value) in seen or _travels(value):
        return
    seen.add(id(value))
    if isinstance(value, Item) and not isinstance(value, type):
        where = value.label
    parts = [part for part in _parts(value) if not _travels(part)]
    if not parts:
        yield where, _named(value)
    for part in parts:
        yield from _culprits(part, where, seen)


def _travels(value: Any) -> bool:
    trial = Caught()
    with trial:
        pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
    return trial.error is None


def _parts(value: Any) -> list[Any]:
    """What an object is pickled with, as far as it is ours or a container."""
    if isinstance(value, System):
        return list(value.__reduce__()[1])
    if isinstance(value, Model):
        return [value[name] for name in value]
    if isinstance(value, list | tuple | set | frozenset):
        return list(value)
    if isinstance(value, dict):
        return [*value.keys(), *value.values()]
    if isinstance(value, MethodType):
        return [value.__self__]
    if isinstance(value, partial):
        return [value.func, *value.args, *value.keywords.values()]
    if type(value).__module__.split(".")[0] == __name__.split(".")[0]:
        return list(getattr(value, "__dict__", {}).values())
    return []


def _named(value: Any) -> str:
    if isinstance(value, FunctionType | BuiltinFunctionType | type):
        return f"{value.__qualname__!r} of module {value.__module__!r}"
    return f"an object of type {type(value).__name__!r}"
