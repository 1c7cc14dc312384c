"""The command line: ``python -m skfem_cosserat changes``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from importlib.resources import files

from .version import VERSION

__all__ = ["main"]


def _changes() -> str:
    """What a user of an older version has to change."""
    return files(__package__).joinpath("CHANGES").read_text(encoding="utf-8")


#: words, and what each gives to be written
VERBS: dict[str, Callable[[], str]] = {"changes": _changes}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Default: those of the process.

    Returns
    -------
    int
        Exit code; a word that is none of `VERBS` ends the process with 2.

    Examples
    --------
    >>> main(["changes"])  # doctest: +ELLIPSIS
    Changes of skfem-cosserat
    ...
    """
    parser = argparse.ArgumentParser(prog="python -m skfem_cosserat")
    parser.add_argument("--version", action="version", version=VERSION)
    verbs = parser.add_subparsers(dest="verb", required=True)
    for verb, run in VERBS.items():
        verbs.add_parser(verb, help=(run.__doc__ or "").strip())
    sys.stdout.write(VERBS[parser.parse_args(arguments).verb]())
    return 0


if __name__ == "__main__":
    sys.exit(main())
