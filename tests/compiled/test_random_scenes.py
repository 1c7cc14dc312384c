"""Compiled kernels against plain numpy in random scenes; random_scenes.py compares many more."""

from __future__ import annotations

import pytest
from random_scenes import compared, held_apart, main, random_scene

pytest.importorskip("numba")

#: seeds whose kernels others take, too: compiling is what these tests cost; 75 decays in a plane
QUICK = 0, 1, 2, 3, 5, 7, 8, 9, 75
MORE = 4, 6, *range(12, 24)


@pytest.mark.parametrize(
    "seed", [*QUICK, *(pytest.param(seed, marks=pytest.mark.slow) for seed in MORE)]
)
def test_kernels_agree_in_random_scenes(seed: int):
    scene = random_scene(seed)
    found = compared(scene)
    assert found.same, f"{found}; {scene}"


@pytest.mark.parametrize(
    "seed", [0, 1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 9))]
)
def test_held_strains_by_both_treatments(seed: int):
    off, scene = held_apart(seed)
    assert off <= 1e-9, scene


def test_scenes_are_those_of_their_numbers():
    """Whoever runs them: a number names a scene in a report."""
    assert str(random_scene(3)) == str(random_scene(3)) != str(random_scene(4))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("--held", "1 scenes with held strains"),
        ("--verbose", "differ by more than they may: []"),
    ],
)
def test_what_is_printed(option: str, said: str, capsys: pytest.CaptureFixture[str]):
    assert main(["--seeds", "1", "--first", "3", "--verbose", option]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("3: ") and said in printed
