"""What README.md shows works: its two commands, its links, its examples."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from readme_commands import README, readme_commands

ROOT = README.parent
_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\(<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\)|(?:src|href)=\"([^\"]+)\"")
_EXAMPLE = re.compile(r"^<!-- example -->\n+```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def readme() -> str:
    return README.read_text(encoding="utf-8")


def relative_targets(text: str) -> list[str]:
    """Targets of links and pictures outside code that are files, without their anchors."""
    found = [markdown or html for markdown, html in _LINK.findall(_FENCE.sub("", text))]
    found = [target for target in found if not re.match(r"[a-z]+:|#|//", target)]
    return [target.split("#")[0] for target in found]


def examples(text: str) -> list[tuple[int, str]]:
    """Line number and source of each python block right under ``<!-- example -->``."""
    return [(text[: m.start(1)].count("\n") + 1, m[1]) for m in _EXAMPLE.finditer(text)]


def test_both_commands_are_there():
    assert set(readme_commands(readme())) == {"run", "test"}


@pytest.mark.parametrize("key", ["run", "test"])
def test_command_makes_its_own_environment(key: str):
    """A command must work in a fresh clone, so it may use no environment but its own."""
    assert readme_commands(readme())[key].startswith("python3 -m venv .venv && ")


def test_run_command_runs_an_example_that_exists():
    scripts = re.findall(r"examples/\S+\.py", readme_commands(readme())["run"])
    assert len(scripts) == 1
    assert (ROOT / scripts[0]).is_file()


def test_links_and_pictures_exist():
    missing = [target for target in relative_targets(readme()) if not (ROOT / target).exists()]
    assert not missing


def test_every_marked_example_is_found():
    assert readme().count("<!-- example -->") == len(examples(readme()))


@pytest.mark.parametrize("number", range(len(examples(readme()))))
def test_example_runs_as_written(
    number: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    line, source = examples(readme())[number]  # each alone: a reader copies one block
    monkeypatch.chdir(tmp_path)
    code = compile("\n" * (line - 1) + source, str(README), "exec")
    exec(code, {"__name__": "__main__"})
    drift = float(capsys.readouterr().out.split()[0])
    assert 0 <= drift < 1e-10  # "the energy is conserved to rounding"
    assert (tmp_path / "rod" / "beams.pvd").is_file()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<!-- command: run -->\n```sh\na\nb\n```\n", "2 lines"),
        ("<!-- command: run -->\n```sh\n```\n", "0 lines"),
        ("<!-- command: run -->\n```sh\na\n```\n" * 2, "twice"),
        ("<!-- command: run -->\nwords between\n```sh\na\n```\n", "marks the commands"),
        ("<!-- command: run -->\n```\na\n```\n", "marks the commands"),
    ],
)
def test_malformed_commands_are_refused(text: str, words: str):
    with pytest.raises(ValueError, match=words):
        readme_commands(text)


def test_commands_are_read_as_written():
    text = "# T\n\n<!-- command: run -->\n\n```sh\na && b '.[x]'\n```\n\n```sh\nnot this\n```\n"
    assert readme_commands(text) == {"run": "a && b '.[x]'"}


def test_targets_and_examples_are_found():
    text = (
        '[a](b.md#part) ![c](d/e.png "title") [x](https://host/y) [z](#here) <img src="f.svg">\n'
        "```python\nq[0](1)\n```\n<!-- example -->\n```python\nx = 1\n```\n"
    )
    assert relative_targets(text) == ["b.md", "d/e.png", "f.svg"]
    assert examples(text) == [(7, "x = 1\n")]
