"""Measured orders of convergence, quantity by quantity, and what spoils them: see the example."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))

import element_orders as orders

pytestmark = pytest.mark.slow  # quickly, test_static_references sees orders


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("orders")
    return orders.main(out=folder) | {"folder": folder}


ENDS = [
    "displacement at element ends",
    "rotation at element ends",
    "energy",
    "reactions",
    "resultants at nodes",
    "frequencies",
    "critical load",
]


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("quantity", ENDS)
def test_two_p_at_element_ends(result, order, quantity):
    assert _row(result, "lobatto", order, quantity)["slope"] == pytest.approx(2 * order, abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("order", [2, 3, 4])
def test_p_plus_two_at_interior_nodes(result, order):
    row = _row(result, "lobatto", order, "displacement at interior nodes")
    assert row["slope"] == pytest.approx(order + 2, abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("quantity", ["displacement anywhere", "resultants at Gauss points"])
def test_p_plus_one_in_fields(result, order, quantity):
    row = _row(result, "lobatto", order, quantity)
    assert row["slope"] == pytest.approx(order + 1, abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize(("order", "left"), [(3, 4), (4, 6)])
@pytest.mark.parametrize("quantity", ["displacement at element ends", "energy", "critical load"])
def test_equidistant_nodes_lose_orders(result, order, left, quantity):
    row = _row(result, "equidistant", order, quantity)
    assert row["slope"] == pytest.approx(left, abs=0.15)
    good = _row(result, "lobatto", order, quantity)
    assert row["errors"][0] > 5 * good["errors"][0]


@pytest.mark.slow
def test_recovered_resultants_are_far_better_than_those_at_gauss_points(result):
    for order in (2, 3, 4):
        nodes, gauss = (
            _row(result, "lobatto", order, f"resultants at {where}")["errors"]
            for where in ("nodes", "Gauss points")
        )
        assert all(a < 0.1 * b for a, b in zip(nodes, gauss, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_slenderness_does_not_matter(result, order):
    thick, thin = (_locking(result, z, order, order) for z in (100.0, 1e4))
    assert thin == pytest.approx(thick, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("order", "factor"), [(1, 20), (2, 1000), (3, 1000), (4, 1000)])
def test_full_quadrature_locks(result, order, factor):
    """One Gauss point more, and the error grows with slenderness."""
    reduced, full = (_locking(result, 1e4, order, points) for points in (order, order + 1))
    assert full > factor * reduced
    if order > 1:  # linear elements are rigid in both cases
        assert full > 5 * _locking(result, 100.0, order, order + 1)


@pytest.mark.slow
def test_files_and_report(result):
    text = (result["folder"] / "element_orders.csv").read_text()
    assert text.startswith("# ") and "machine" in text
    report = orders.report(result)
    parts = ("orders", "costs", "locking")
    assert report.count("\n") + 1 == sum(len(result[name]) for name in parts)
    assert all((result["folder"] / f"element_{name}.csv").exists() for name in parts)


def test_slopes_are_taken_above_rounding():
    assert orders.order_of([1, 2, 4], [1e-2, 1e-3, 1e-16]) == pytest.approx(math.log2(10))
    assert math.isnan(orders.order_of([1, 2], [1e-2, 1e-15]))


def _row(result, nodes, order, quantity):
    wanted = nodes, order, quantity
    (row,) = (r for r in result["orders"] if (r["nodes"], r["order"], r["quantity"]) == wanted)
    return row


def _locking(result, slenderness, order, points):
    wanted = slenderness, order, points
    rows = result["locking"]
    (row,) = (r for r in rows if (r["slenderness"], r["order"], r["points"]) == wanted)
    return row["error"]
