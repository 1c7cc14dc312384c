"""Makes a notebook, or a program, of a page of the guide.

``python examples/guide/make_notebook.py 09_inside_scikit_fem`` writes the notebook beside the page;
with ``--program`` it writes ``09_inside_scikit_fem.py`` to the current folder instead. Blocks of
Python become cells. What the page shows as their output is left out: a notebook prints it itself.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any

#: a block of Python, with the output shown right under it
BLOCK = re.compile(r"^```python\n(.*?)^```\n(?:\n*```text\n.*?^```\n?)?", re.M | re.S)


def cells(page: str) -> list[tuple[str, str]]:
    """Pairs ("markdown" or "code", text) of a page, in its order."""
    parts = BLOCK.split(page)  # texts, and blocks between them
    found = [(("markdown", "code")[k % 2], part.strip("\n")) for k, part in enumerate(parts)]
    return [(kind, text) for kind, text in found if text]


def notebook(page: str) -> dict[str, Any]:
    """A notebook of a page, without outputs."""
    made = []
    for k, (kind, text) in enumerate(cells(page)):
        code = {"execution_count": None, "outputs": []} if kind == "code" else {}
        source = text.splitlines(keepends=True)
        made.append(
            {"cell_type": kind, "id": f"{kind}-{k}", "metadata": {}, "source": source, **code}
        )
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    about = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return {"cells": made, "metadata": about, "nbformat": 4, "nbformat_minor": 5}


def program(page: str) -> str:
    """All blocks of a page, one under the other."""
    return "\n\n".join(text for kind, text in cells(page) if kind == "code") + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page")
    parser.add_argument("--program", action="store_true")
    given = parser.parse_args()
    path = Path(__file__).with_name(given.page).with_suffix(".md")
    text = path.read_text(encoding="utf-8")
    if given.program:
        Path(f"{path.stem}.py").write_text(program(text), encoding="utf-8")
    else:
        made = json.dumps(notebook(text), indent=1, ensure_ascii=False) + "\n"
        path.with_suffix(".ipynb").write_text(made, encoding="utf-8")
