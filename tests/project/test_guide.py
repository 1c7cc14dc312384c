"""The pages of the guide: each code block runs, each shown output comes out, each link leads on.

The ``python`` blocks of a page run in order, in one namespace and an empty folder. A ``text``
block right under one shows what it prints: the words have to be the same, numbers may differ by
2 % or be rounding alike (both below 1e-7).
"""

from __future__ import annotations

import base64
import json
import os
import re
from io import BytesIO
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
from test_readme import relative_targets

ROOT = Path(__file__).resolve().parents[2]
GUIDE = ROOT / "examples" / "guide"
PAGES = sorted(GUIDE.glob("*.md"))
#: pages whose code runs in a few seconds; that of the others is slow
QUICK = ("02", "08", "09", "11", "12", "13")
CASES = [
    pytest.param(page, marks=[] if page.stem.startswith(QUICK) else pytest.mark.slow)
    for page in PAGES
]
_BLOCK = re.compile(r"^```python\n(.*?)^```\n(?:\n*```text\n(.*?)^```$)?", re.M | re.S)
_NUMBER = re.compile(r"[-+]?\b\d+\.?\d*(?:e[-+]?\d+)?\b")
_COMMAND = re.compile(r"`(?:\.venv/bin/)?python ((?:examples|tests)/\S+?\.py)[^`]*`")


def blocks(text: str) -> list[tuple[int, str, str | None]]:
    """Line, source and shown output (or None) of each python block."""
    return [(text[: m.start(1)].count("\n") + 1, m[1], m[2]) for m in _BLOCK.finditer(text)]


def check_output(shown: str, printed: str, where: str) -> None:
    """Same words; numbers to 2 %, or both rounding."""
    words = [" ".join(_NUMBER.sub("#", text).split()) for text in (shown, printed)]
    assert words[0] == words[1], f"{where}: printed is\n{printed}"
    pairs = zip(_NUMBER.findall(shown), _NUMBER.findall(printed), strict=True)
    for a, b in ((float(x), float(y)) for x, y in pairs):
        alike = np.isclose(a, b, rtol=0.02, atol=1e-12) or max(abs(a), abs(b)) < 1e-7
        assert alike, f"{where}: shown {a}, printed {b}"


@pytest.mark.parametrize("page", CASES, ids=lambda page: page.stem)
def test_code_runs_and_prints_what_is_shown(
    page: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    request: pytest.FixtureRequest,
) -> None:
    if ".animate(" in "".join(source for _, source, _ in blocks(page.read_text("utf-8"))):
        request.getfixturevalue("renderer")
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__main__"}
    for line, source, shown in blocks(page.read_text(encoding="utf-8")):
        capsys.readouterr()
        exec(compile("\n" * (line - 1) + source, str(page), "exec"), names)
        if shown is not None:
            check_output(shown, capsys.readouterr().out, f"{page.name}, line {line}")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_and_commands_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    missing = [target for target in relative_targets(text) if not (GUIDE / target).exists()]
    missing += [path for path in _COMMAND.findall(text) if not (ROOT / path).is_file()]
    assert not missing


def executed(name: str, folder: Path) -> list[Any]:
    """Cells of code of a notebook, run in a folder; before it has no outputs."""
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    book = nbformat.read(GUIDE / name, 4)
    cells = [cell for cell in book.cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in cells)
    where = {"metadata": {"path": str(folder)}}
    client = nbclient.NotebookClient(book, timeout=300, kernel_name="python3", resources=where)
    with mock.patch.dict(os.environ):
        os.environ.pop("PYTHONWARNINGS", None)  # as errors they would end Jupyter's kernel
        client.execute()
    return cells


def test_page_09_as_a_notebook_and_as_a_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both are made of the page by a command, and show what it shows."""
    monkeypatch.syspath_prepend(GUIDE)
    import make_notebook

    page, book = (GUIDE / f"09_inside_scikit_fem.{kind}" for kind in ("md", "ipynb"))
    text, made = page.read_text("utf-8"), json.loads(book.read_text("utf-8"))
    assert made == make_notebook.notebook(text), "python examples/guide/make_notebook.py makes it"
    cells = executed(book.name, tmp_path)
    for cell, (line, _, shown) in zip(cells, blocks(text), strict=True):
        printed = "".join(output.text for output in cell.outputs if output.name == "stdout")
        check_output(shown or "", printed, f"cell of line {line}")
    sources = "".join(source for _, source, _ in blocks(text))
    assert make_notebook.program(text).split() == sources.split()


@pytest.mark.slow
def test_notebook_runs_and_shows_what_it_says(renderer: None, tmp_path: Path) -> None:
    """Pictures are not blank, the film has its frames; a frequency is that of Rayleigh."""
    cells = executed("15_notebook.ipynb", tmp_path)
    from PIL import Image

    written = [output.text for cell in cells for output in cell.outputs if "text" in output]
    assert not [text for text in written if "PyVista" not in text]
    shown = {}
    for cell in cells:
        (data,) = (output.data for output in cell.outputs if "data" in output)
        shown[cell.source.splitlines()[-1].split("(window")[0].split("  #")[0]] = data
    for name in ("strip", "model", "history", "modes", "table.describe()"):
        assert "<table" in shown[name]["text/html"]
    for name in ("model.plot", "history.picture", "history.plot"):
        for data in (each for last, each in shown.items() if last.startswith(name)):
            picture = Image.open(BytesIO(base64.b64decode(data["image/png"])))
            assert np.asarray(picture.convert("L")).std() > 8
    film = Image.open(tmp_path / "swing.gif")
    assert (film.n_frames, film.size) == (31, (480, 270))
    mass = 0.1 + 33 / 140 * 1100 * 0.02 * 0.06
    rayleigh = np.sqrt(3 * 2e8 * 0.06 * 0.02**3 / 12 / mass) / (2 * np.pi)
    numbers = np.array(re.findall(r"\d+\.\d+", shown["modes"]["text/html"]), dtype=float)
    assert abs(numbers / rayleigh - 1).min() < 0.04  # bent by its weight
    assert (tmp_path / "swing" / "beams.pvd").is_file() and (tmp_path / "swing.html").is_file()


def test_outputs_are_compared():
    check_output("error 1.00e-12 of 3\n", "error 4.1e-15  of 3\n", "here")
    with pytest.raises(AssertionError, match="shown 3"):
        check_output("of 3.0\n", "of 3.2\n", "here")
    with pytest.raises(AssertionError, match="printed is"):
        check_output("of 3.0\n", "off 3.0\n", "here")


def test_blocks_are_found_with_their_output():
    text = "# T\n```python\nx = 1\n```\n\n```text\n1\n```\n```python\ny = 2\n```\nwords\n"
    assert blocks(text) == [(3, "x = 1\n", "1\n"), (10, "y = 2\n", None)]


def test_scripts_inside_scikit_fem_take_public_names_alone():
    """Page 09 and its programs import the package, nothing from inside it."""
    pages = [GUIDE / f"09_inside_scikit_fem.{kind}" for kind in ("md", "ipynb")]
    pages += [GUIDE.parent / name for name in ("skfem_alone.py", "own_loops.py")]
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert "import skfem_cosserat as sc" in text
        assert not re.search(r"skfem_cosserat\.|from skfem_cosserat", text), page.name
        assert not re.search(r"\[(12|6) \*", text), page.name
