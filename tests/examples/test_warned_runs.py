"""The count of warned runs: its scenes, and what it counts."""

from __future__ import annotations

import numpy as np
import pytest
import warned_runs

import skfem_cosserat as sc


@pytest.mark.one_quick
@pytest.mark.parametrize("number", range(len(warned_runs.SCENES)))
def test_scenes_with_short_steps_are_right_and_not_warned(number):
    row = warned_runs.case(number, 200)
    assert row["status"] == "completed" and not row["wrong"] and not row["warned"]
    assert 0.2 * row["off"] < row["estimate"] < 20 * row["off"] + 1e-3


@pytest.mark.slow
def test_a_pendulum_with_long_steps_is_wrong_and_warned():
    row = warned_runs.case(3, 10)
    assert row["wrong"] and row["warned"] and "do not resolve the motion" in row["what"]


@pytest.mark.slow
def test_a_step_at_which_the_treatments_part_is_doubted():
    """Whatever rounding is: of other scenes it decides whether they part."""
    row = warned_runs.case(18, 10)
    assert row["parted"] and row["doubted"] and row["warned"]


@pytest.mark.slow
def test_cells_of_the_map_of_stability():
    row = warned_runs.swing(1.0, sc.EnergyMomentum(), 1e-3)
    assert row["scene"] == "swing 1" and not (row["wrong"] or row["warned"] or row["parted"])


def test_counts():
    def row(wrong, warned, status="completed", parted=None, doubted=False):
        found = {"wrong": wrong, "warned": warned, "status": status}
        return found | {"parted": parted, "doubted": doubted}

    rows = [row(True, True, parted=3, doubted=True), row(True, False, parted=4)]
    rows += [row(False, False), row(False, False, "not solved")]
    found = warned_runs.counted(rows)
    assert (found["wrong_warned"], found["right_warned"], found["not_solved"]) == (0.5, 0.0, 1)
    assert (found["parted"], found["parted_doubted"]) == (2, 0.5)
    assert np.isnan(warned_runs.counted(rows[3:])["wrong_warned"])
