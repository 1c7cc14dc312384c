"""Every example in a docstring runs."""

from __future__ import annotations

import doctest
import importlib
import pkgutil

import pytest

import skfem_cosserat

MODULES = sorted(
    ["skfem_cosserat"]
    + [m.name for m in pkgutil.walk_packages(skfem_cosserat.__path__, "skfem_cosserat.")]
)


#: modules whose examples need an extra, or that need it themselves
NEEDS = {
    "compiled": "numba",
    "figures": "matplotlib",
    "history.container": "pandas",
    "plot": "pyvista",
    "profile.polygon": "shapely",
    "study.charts": "matplotlib",
}


#: modules whose examples take more than half a second
DEAR = {
    f"skfem_cosserat.{name}"
    for name in (
        *("accuracy.asked", "accuracy.chart", "accuracy.refinement", "accuracy.run"),
        *("accuracy.scene", "accuracy.tolerance", "damping", "diagnostics.inputs", "errors"),
        *("figures", "history.container", "load", "plot", "profile.polygon"),
        *("profile.profile", "profile.shapes", "statics.branch"),
    )
}
CASES = [pytest.param(name, marks=pytest.mark.slow if name in DEAR else ()) for name in MODULES]


def imported(name):
    """A module; those that need an extra are left out where it is not installed."""
    for module, extra in NEEDS.items():
        if f"{name}.".startswith(f"skfem_cosserat.{module}."):
            pytest.importorskip(extra)
    return importlib.import_module(name)


@pytest.mark.parametrize("name", CASES)
def test_examples_of_a_module(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # examples that write files leave nothing behind
    result = doctest.testmod(imported(name), report=True)
    assert result.failed == 0


def test_public_names_are_documented():
    for name in skfem_cosserat.__all__:
        doc = getattr(skfem_cosserat, name).__doc__
        assert doc and len(doc.strip()) > 15, name
