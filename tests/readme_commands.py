"""The shell lines README.md shows, by key: used by .ci/run and by test_readme.

A line stands alone in a fenced ``sh`` block right under ``<!-- command: KEY -->``.
As a script: ``python tests/readme_commands.py KEY`` prints the line.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

README = Path(__file__).resolve().parent.parent / "README.md"

_BLOCK = re.compile(r"^<!-- command: (\S+) -->\n+```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def readme_commands(text: str) -> dict[str, str]:
    """Return the marked shell lines of a README, by key.

    Raises
    ------
    ValueError
        If a key stands twice, a mark has no ``sh`` block under it, or a block has not one line.
    """
    commands: dict[str, str] = {}
    for key, block in _BLOCK.findall(text):
        lines = block.splitlines()
        if len(lines) != 1 or not lines[0].strip():
            raise ValueError(f"README.md, command {key!r}: {len(lines)} lines, expected one")
        if key in commands:
            raise ValueError(f"README.md, command {key!r}: marked twice")
        commands[key] = lines[0]
    marks = re.findall(r"<!-- command: (\S+) -->", text)
    if len(marks) != len(commands):
        raise ValueError(
            f"README.md marks the commands {marks}, but ```sh blocks right under a mark were found"
            f" for {list(commands)}"
        )
    return commands


if __name__ == "__main__":
    found = readme_commands(README.read_text(encoding="utf-8"))
    if len(sys.argv) != 2 or sys.argv[1] not in found:
        sys.exit(f"usage: readme_commands.py KEY, with a KEY of README.md: {', '.join(found)}")
    sys.stdout.write(found[sys.argv[1]] + "\n")
