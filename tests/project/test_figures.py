"""Charts: colours apart in grey, legends beside the axes, numbered axes, files."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from skfem_cosserat.accuracy.chart import OTHERS, STATUSES
from skfem_cosserat.errors import InputError
from skfem_cosserat.figures import (
    NAMED,
    PALETTE,
    legend,
    panels,
    styles,
    write_figure,
)

pytest.importorskip("matplotlib")
APART = 8.0


def lightness(colour: str) -> float:
    """L* of CIELAB (D65) of a colour of sRGB; the luminance is that of the standard IEC 61966."""
    rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    y = float(linear @ (0.2126, 0.7152, 0.0722))
    return 116 * y ** (1 / 3) - 16 if y > (6 / 29) ** 3 else y * (29 / 3) ** 3


def test_colours_are_apart_in_grey():
    assert lightness("#777777") == pytest.approx(50.03, abs=0.01)  # a known value
    for a, b in combinations(PALETTE.values(), 2):
        assert abs(lightness(a) - lightness(b)) > APART - 0.5, (a, b)
    kinds = [*STATUSES.values(), *(type(STATUSES["ok"])("", *each) for each in OTHERS)]
    for a, b in combinations(kinds, 2):
        far = abs(lightness(a.color) - lightness(b.color)) > APART
        assert far or a.hatch != b.hatch, (a, b)


def test_no_two_of_a_chart_look_alike():
    """Named, variants, families and names that nobody knows: lightness, or mark and dashes."""
    odd = ["variational 2", "energy-momentum, multipliers", "Exudyn, exact beam", "mine", "yours"]
    integrators = list(NAMED)[: list(NAMED).index("skfem-cosserat")]
    peers = ["exudyn", "pyelastica", "mujoco"]
    for names in ([*integrators, *peers], [*integrators, *odd], [f"order {k}" for k in range(9)]):
        found = styles(names)
        assert list(found) == names
        for a, b in combinations(found.values(), 2):
            far = abs(lightness(a.color) - lightness(b.color)) > APART - 0.5
            assert far or (a.marker, a.linestyle) != (b.marker, b.linestyle), (a, b)
    found = styles(odd)
    for name, family in zip(odd, ("variational", "energy-momentum", "exudyn"), strict=False):
        assert found[name].color == NAMED[family].color


def numbered(axis, limits):
    """Texts of the ticks within the limits."""
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    near = [each for each in ticks if limits[0] <= each.get_loc() <= limits[1]]
    return [text for each in near if (text := each.label1.get_text())]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("low", "high", "least"),
    [(1.1e-3, 8e-3, 3), (2.0, 90.0, 3), (1e-9, 1e3, 4), (1.2, 1.9, 2), (3e-7, 4e-5, 2)],
)
def test_logarithmic_axes_have_numbers(low, high, least):
    figure, (axis,) = panels(6.0, 4.0)
    axis.loglog([low, high], [low, high])
    write_figure(figure, None)
    figure.draw_without_rendering()
    for each, limits in ((axis.xaxis, axis.get_xlim()), (axis.yaxis, axis.get_ylim())):
        texts = numbered(each, limits)
        assert len(set(texts)) == len(texts) >= least, texts
        assert len(texts) <= 16


@pytest.mark.one_quick
@pytest.mark.parametrize("below", [0, 2])
@pytest.mark.parametrize("whole", [True, False])
def test_legends_are_beside_the_axes(below, whole):
    figure, axes = panels(8.0, 4.0, 1, 2)
    for axis in axes:
        axis.plot([0, 1], [0, 1], label="a long label of a line")
        axis.set_xlabel("time in s")
    owner = figure if whole else axes[0]
    legend(owner, below=below)
    figure.draw_without_rendering()
    shown = figure.legends[0] if whole else axes[0].get_legend()
    assert len(shown.get_texts()) == 1
    box = shown.get_window_extent()
    for axis in axes:
        assert not box.overlaps(axis.get_window_extent())


def test_files_that_cannot_be_written(tmp_path):
    figure, _ = panels(5.0, 4.0)
    with pytest.raises(InputError, match=r"\.html, expected one of .*svg"):
        write_figure(figure, tmp_path / "chart.html")
    with pytest.raises(InputError, match="does not exist"):
        write_figure(figure, tmp_path / "nowhere" / "chart.svg")
