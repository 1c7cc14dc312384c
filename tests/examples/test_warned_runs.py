"""The count of warned runs: its scenes, and what it counts."""

from __future__ import annotations

import numpy as np
import pytest
import warned_runs


@pytest.mark.parametrize("number", range(len(warned_runs.SCENES)))
def test_scenes_with_short_steps_are_right_and_not_warned(number):
    row = warned_runs.case(number, 200)
    assert row["status"] == "completed" and not row["wrong"] and not row["warned"]
    assert 0.2 * row["off"] < row["estimate"] < 20 * row["off"] + 1e-3


def test_a_pendulum_with_long_steps_is_wrong_and_warned():
    row = warned_runs.case(3, 10)
    assert row["wrong"] and row["warned"] and "do not resolve the motion" in row["what"]


def test_counts():
    def row(wrong, warned, status="completed"):
        return {"wrong": wrong, "warned": warned, "status": status}

    rows = [row(True, True), row(True, False), row(False, False), row(False, False, "not solved")]
    found = warned_runs.counted(rows)
    assert (found["wrong_warned"], found["right_warned"], found["not_solved"]) == (0.5, 0.0, 1)
    assert np.isnan(warned_runs.counted(rows[3:])["wrong_warned"])
