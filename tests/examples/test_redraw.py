"""Charts of the stored tables: fit for a page, axes named, legends beside them, plain words."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))

import redraw

from skfem_cosserat.figures import PAGE, write_figure

#: words of the code, which no reader of a chart knows
CODE = re.compile(r"newton|blowup|factor\b|_|\bpoint\b")


@pytest.mark.slow
@pytest.mark.parametrize("name", redraw.CHARTS)
def test_charts_of_stored_tables(name, tmp_path, monkeypatch):
    figures = []

    def keep(figure, path):
        figures.append(write_figure(figure, path))

    for module in (redraw.dynamic_report, redraw.element_orders):
        monkeypatch.setattr(module, "write_figure", keep)
    for module in (redraw.theory_limits, redraw.theory_report, redraw.speed_accuracy_chart):
        monkeypatch.setattr(module, "write_figure", keep)
    redraw.CHARTS[name](tmp_path / f"{name}.png")
    assert (tmp_path / f"{name}.png").stat().st_size > 10_000
    assert len(figures) == 1 + name.startswith("speed_accuracy")
    for figure in figures:
        fit_for_a_page(figure)


def fit_for_a_page(figure):
    """Not too wide, axes named in plain words, legends beside them."""
    assert figure.get_figwidth() <= PAGE  # else the letters are too small on a page
    figure.draw_without_rendering()
    shown = [axis for axis in figure.axes if axis.axison]
    assert any(axis.get_ylabel() for axis in shown) and any(axis.get_xlabel() for axis in shown)
    legends = [*figure.legends, *(axis.get_legend() for axis in shown if axis.get_legend())]
    assert legends
    for legend in legends:
        for axis in shown:
            assert not legend.get_window_extent().overlaps(axis.get_window_extent())
        for text in (each.get_text() for each in legend.get_texts()):
            assert not CODE.search(text), text
    for axis in shown:
        assert not CODE.search(axis.get_xlabel() + axis.get_ylabel())
        low, high = axis.get_xlim()
        assert low < high  # steps grow to the right
