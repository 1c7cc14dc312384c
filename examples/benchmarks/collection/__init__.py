"""Every benchmark problem with trusted numbers, one file a family, and one table of all.

``python -m collection`` in the folder above, or ``python examples/benchmarks/collection``, prints
the table; :mod:`.common` says what a family's file has.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

import skfem_cosserat as sc

_HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(_HERE.parent))

__all__ = ["chosen", "families", "run"]

COLUMNS = (
    *("id", "case", "quantity", "computed", "reference", "error", "trusted", "order", "elements"),
    *("step", "cost_s", "unknowns", "newton_iterations", "converged"),
)


def families() -> dict[str, Any]:
    """The families' modules by their ids, "S03" and so on."""
    names = sorted(path.stem for path in _HERE.glob("[smdr][0-9][0-9]_*.py"))
    return {name[:3].upper(): import_module(f"collection.{name}") for name in names}


def run(ids: str | Iterable[str] | None = None, quick: bool = True) -> list[dict[str, Any]]:
    """Compute cases and put them beside their references.

    Parameters
    ----------
    ids : str or iterable of str, optional
        Families ("S03", also "S3" or the name of an entry; "S": all of statics); default: all.
    quick : bool
        Only the cases that take a second or two.

    Returns
    -------
    list of dict
        A row for each number: ``id``, ``case``, ``quantity``, ``computed``, ``reference``,
        ``error``, ``trusted``; ``order``, ``elements``, ``step``; ``cost_s``, ``unknowns``,
        ``newton_iterations``, ``converged``.

    Raises
    ------
    InputError
        For a family that there is none of.
    """
    known = families()
    return [row for name in chosen(ids) for row in known[name].rows(quick)]


def chosen(ids: str | Iterable[str] | None = None) -> list[str]:
    """The families that `ids` of :func:`run` name, each once."""
    known = families()
    names = [ids] if isinstance(ids, str) else ids
    wanted = list(known) if names is None else [f for name in names for f in _families(name, known)]
    return list(dict.fromkeys(wanted))


def _families(name: str, known: dict[str, Any]) -> list[str]:
    if not isinstance(name, str) or not name:
        raise sc.InputError("argument ids", f"{name!r}, expected among {list(known)}")
    letter, digits = name[:1].upper(), "".join(c for c in name[1:3] if c.isdigit())
    found = [f for f in known if f.startswith(f"{letter}{digits.zfill(2) if digits else ''}")]
    if not found or (len(name) > 1 and not digits):
        raise sc.InputError("argument ids", f"{name!r} is no family, expected among {list(known)}")
    return found
