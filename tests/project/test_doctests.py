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
    "plot": "pyvista",
    "profile.polygon": "shapely",
    "study.charts": "matplotlib",
}


def imported(name):
    """A module; those that need an extra are left out where it is not installed."""
    for module, extra in NEEDS.items():
        if f"{name}.".startswith(f"skfem_cosserat.{module}."):
            pytest.importorskip(extra)
    return importlib.import_module(name)


@pytest.mark.one_quick
@pytest.mark.parametrize("name", MODULES)
def test_examples_of_a_module(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # examples that write files leave nothing behind
    result = doctest.testmod(imported(name), report=True)
    assert result.failed == 0


@pytest.mark.slow
def test_there_are_examples():
    pytest.importorskip("numba")
    finder = doctest.DocTestFinder()
    count = sum(
        bool(test.examples)
        for name in MODULES
        for test in finder.find(importlib.import_module(name))
    )
    assert count > 60


@pytest.mark.one_quick
@pytest.mark.parametrize("name", skfem_cosserat.__all__)
def test_public_names_are_documented(name):
    doc = getattr(skfem_cosserat, name).__doc__
    assert doc
    assert len(doc.strip()) > 15
