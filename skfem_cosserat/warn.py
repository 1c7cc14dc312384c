"""Warnings about doubtful results: said by :mod:`warnings`, and kept with the run they belong to.

What a user should know about a result is said by :func:`warn`. It goes to Python's own warnings,
at the line of the user's code that led to it, and to every :class:`Notices` that is open, which is
how a run, a path, a study or a worker process gets its list. What is informative only is logged.
"""

from __future__ import annotations

import logging
import re
import sys
import warnings
from collections.abc import Iterable, Mapping, Sequence
from contextvars import ContextVar, Token
from typing import Any, Self

from .errors import (
    AccuracyWarning,
    CosseratWarning,
    Diverged,
    IncompleteWarning,
    ModelWarning,
    PerformanceWarning,
)

# -- the logger of the package: silent until the user configures :mod:`logging` --------------------

logger = logging.getLogger("skfem_cosserat")
logger.addHandler(logging.NullHandler())


# --------------------------------------------------------------------------------------------------
# Warnings about doubtful results: said by :mod:`warnings`, and kept with the run they belong to.
#
# What a user should know about a result is said by :func:`warn`. It goes to Python's own warnings,
# at the line of the user's code that led to it, and to every :class:`Notices` that is open, which
# is how a run, a path, a study or a worker process gets its list. Logging is for what is
# informative only (:mod:`skfem_cosserat.warn`).

#: a warning as it is kept: "category", "item", "text", "time" (s, or load factor; None without)
#: and "when", the same in words
Notice = dict[str, Any]
#: how a time, and a load factor, is put into words
CLOCK_OF_RUNS, CLOCK_OF_PATHS = "t = {:.6g} s", "load factor {:.6g}"

#: of several kinds the first one is the gravest
GRAVE: tuple[type[CosseratWarning], ...] = (
    AccuracyWarning,
    ModelWarning,
    IncompleteWarning,
    PerformanceWarning,
)

_PACKAGE = __name__.partition(".")[0]
#: names in quotes, which tell warnings apart, or numbers, which do not
_NAME_OR_NUMBER = re.compile(r"(?<!\w)'[^']*'|[-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?", re.IGNORECASE)
_open: ContextVar[tuple[Notices, ...]] = ContextVar("open notices", default=())


class Notices:
    """Keeps the warnings given while it is open, each once for an item.

    Texts about one item that differ in numbers only are one warning: the first one is kept. It may
    be opened again and again, as a loop does around each of its steps.

    Parameters
    ----------
    known : sequence of dict
        Warnings from before, as of the system that a run is about: kept, and not said again.
    clock : str
        How a time is put into words.
    quiet : bool
        Keep warnings, do not say them: of one trial among many, or in a worker process.
    alone : bool
        Those that were open before do not get them.

    Attributes
    ----------
    found : list of dict
        With "category", "item", "text", "time" (s, or load factor; None without one) and "when"
        (the time in words).

    Examples
    --------
    >>> with Notices(quiet=True) as notices:
    ...     warn("beam 'rod'", "bent by 50 degrees", CosseratWarning, time=0.5)
    ...     warn("beam 'rod'", "bent by 60 degrees", CosseratWarning, time=0.6)
    >>> [(notice["time"], notice["text"]) for notice in notices.found]
    [(0.5, 'bent by 50 degrees')]
    """

    def __init__(
        self,
        known: Iterable[Notice] = (),
        clock: str = CLOCK_OF_RUNS,
        quiet: bool = False,
        alone: bool = False,
    ):
        self.found = [dict(notice) for notice in known]
        self.clock, self.quiet, self.alone = clock, quiet, alone
        #: whether what is to come is an error, whose text says what was found
        self.failing = False
        self._keys = {_key(notice) for notice in self.found}
        self._tokens: list[Token[tuple[Notices, ...]]] = []

    def __enter__(self) -> Self:
        self._tokens.append(_open.set((self,) if self.alone else (*_open.get(), self)))
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        _open.reset(self._tokens.pop())

    def take(self, notice: Notice) -> bool:
        """Keep a warning; says whether it is new."""
        key = _key(notice)
        if key in self._keys:
            return False
        self._keys.add(key)
        self.found.append(notice)
        return True

    def kept(self) -> list[Notice]:
        """A copy of what was found, for the meta data of a result."""
        return [dict(notice) for notice in self.found]

    def tell(self, error: Diverged) -> None:
        """Let a failure say what was doubtful before it; its list replaces one told before.

        Warnings that the user made errors do not take its place from here on.
        """
        self.failing = True
        error.warnings = self.kept()
        error.warned = told(self.found)


def warn(item: str, text: str, category: type[CosseratWarning], time: float | None = None) -> None:
    """Say what is doubtful about a result, once for each open :class:`Notices`.

    Parameters
    ----------
    item : str
        What it is about, as in errors: ``"beam 'boom'"``.
    text : str
        What was found, and what to do.
    category : type
        One of the kinds of :class:`CosseratWarning`.
    time : float, optional
        When (s), or at which load factor.
    """
    listeners = _open.get()
    clock = listeners[-1].clock if listeners else CLOCK_OF_RUNS
    notice = {
        "category": category.__name__,
        "item": item,
        "text": text,
        "time": None if time is None else float(time),
        "when": "" if time is None else clock.format(time),
    }
    _give(notice, category)


def listening() -> bool:
    """True if something keeps the warnings that are given now."""
    return bool(_open.get())


def repeat(notices: Iterable[Notice], prefix: str = "") -> None:
    """Give warnings again that were kept elsewhere, as those of a worker process."""
    categories = {kind.__name__: kind for kind in _kinds(CosseratWarning)}
    for notice in notices:
        category = categories.get(notice["category"], CosseratWarning)
        _give(notice | {"item": prefix + notice["item"]}, category)


def _give(notice: Notice, category: type[CosseratWarning]) -> None:
    listeners = _open.get()
    new = [listener.take(dict(notice)) for listener in listeners]
    if all(new) and not any(listener.quiet for listener in listeners):
        try:
            warnings.warn(in_words(notice), category, stacklevel=_level())
        except CosseratWarning:  # made an error by the user: a failure has it in its text
            if not any(listener.failing for listener in listeners):
                raise


def in_words(notice: Notice) -> str:
    """One line: item, time and text."""
    when = f", {notice['when']}" if notice["when"] else ""
    return f"{notice['item']}{when}: {notice['text']}"


def told(notices: Iterable[Notice]) -> str:
    """All in one line, for a table; empty if there are none."""
    return "; ".join(map(in_words, notices))


def listed(notices: Iterable[Notice], width: int = 100) -> list[str]:
    """One line each, cut to a width, for the end of a printed result."""
    lines = [f"  {notice['category']}: {in_words(notice)}" for notice in notices]
    return [
        line if len(line) <= width else f"{line[: width - 4].rpartition(' ')[0]} ..."
        for line in lines
    ]


def sum_up(item: str, kind: str, cases: Mapping[str, Sequence[Notice]], where: str) -> None:
    """Say once how many of several cases, by name, warned, with the gravest one, and where all are.

    Parameters
    ----------
    item : str
        The study.
    kind : str
        What its cases are: ``"levels"``.
    cases : mapping of str to sequence of dict
    where : str
        Where they can be read.
    """
    found = [(name, notice) for name, notices in cases.items() for notice in notices]
    if not found:
        return
    rank = {kind.__name__: k for k, kind in enumerate(GRAVE)}
    name, worst = min(found, key=lambda each: rank.get(each[1]["category"], len(rank)))
    category = GRAVE[rank[worst["category"]]] if worst["category"] in rank else CosseratWarning
    count = sum(map(bool, cases.values()))
    text = f"{count} of {len(cases)} {kind} gave warnings, such as {name!r}: {in_words(worst)}"
    warn(item, f"{text} (all: {where})", category)


def counted(notices: Sequence[Notice] | int) -> str:
    """Text with the number of warnings, for the end of a ``repr``; empty if there are none."""
    count = notices if isinstance(notices, int) else len(notices)
    return f", {count} warning{'s' * (count > 1)}" if count else ""


def _kinds(kind: type[CosseratWarning]) -> list[type[CosseratWarning]]:
    return [kind, *(deeper for below in kind.__subclasses__() for deeper in _kinds(below))]


def _key(notice: Notice) -> tuple[str, str, str]:
    text = _NAME_OR_NUMBER.sub(lambda m: m[0] if m[0].startswith("'") else "#", notice["text"])
    return notice["category"], notice["item"], text


def _level() -> int:
    """Frames from `_give` to the user's line: neither of the package nor of Python's own modules.

    By their names: what a dataclass generates, or doctest runs, is in no file of the package.
    """
    frame = sys._getframe(1)
    level = 1
    while frame.f_back is not None and _inside(frame.f_globals.get("__name__", "")):
        frame = frame.f_back
        level += 1
    return level


def _inside(module: str) -> bool:
    top = module.partition(".")[0]
    return top == _PACKAGE or top in sys.stdlib_module_names
