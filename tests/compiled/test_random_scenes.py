"""Compiled kernels against plain numpy in random scenes; random_scenes.py compares many more."""

from __future__ import annotations

import pytest
from random_scenes import compared, held_apart, main, random_scene

pytest.importorskip("numba")


def check(seed: int) -> None:
    scene = random_scene(seed)
    found = compared(scene)
    assert found.same, f"{found}; {scene}"


#: seeds whose kernels others take, too: compiling is what these tests cost
QUICK = 0, 1, 2, 3, 5, 7, 8, 9, 10, 11


@pytest.mark.parametrize("seed", [*QUICK, 75])  # 75: EnergyDecaying in a plane
def test_kernels_agree_in_random_scenes(seed: int):
    check(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", sorted({*range(72)} - {*QUICK}))
def test_kernels_agree_in_more_random_scenes(seed: int):
    check(seed)


@pytest.mark.parametrize("seed", range(6))
def test_held_strains_by_both_treatments(seed: int):
    off, scene = held_apart(seed)
    assert off <= 1e-9, scene


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6, 40))
def test_held_strains_by_both_treatments_in_more_scenes(seed: int):
    off, scene = held_apart(seed)
    assert off <= 1e-9, scene


def test_scenes_are_those_of_their_numbers():
    """Whoever runs them: a number names a scene in a report."""
    assert str(random_scene(3)) == str(random_scene(3)) != str(random_scene(4))


@pytest.mark.slow
def test_what_is_printed_of_held_strains(capsys: pytest.CaptureFixture[str]):
    assert main(["--seeds", "1", "--held", "--verbose"]) == 0
    first, *rest = capsys.readouterr().out.splitlines()
    assert first.startswith("0: ") and "1 scenes with held strains" in rest[0]


@pytest.mark.slow
def test_what_is_printed_of_random_scenes(capsys: pytest.CaptureFixture[str]):
    assert main(["--seeds", "1", "--first", "3", "--verbose"]) == 0
    first, *table = capsys.readouterr().out.splitlines()
    assert first.startswith("3: ") and str(random_scene(3)) in first
    assert any("differ by more than they may: []" in line for line in table)
    assert table[-1] == "0 scenes that plain numpy does not solve"


@pytest.mark.slow
def test_what_is_printed_of_steps(capsys: pytest.CaptureFixture[str]):
    assert main(["--seeds", "1", "--first", "2", "--steps", "--verbose"]) == 0
    first, head, *table = capsys.readouterr().out.splitlines()
    assert first.startswith("2: 1 x: ") and "warned of steps or energy" in head
    assert len(table) == 9 and table[0].split()[:3] == ["1", "right", "1"]
