"""Charts of stored tables drawn anew, without running anything again.

Run ``python examples/benchmarks/redraw.py`` after the style of the charts has changed. Charts that
show more than is stored (failure_map, load_paths, vibration_modes, the lines of
stability_chart) need their own programs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import dynamic_report
import element_orders
import speed_accuracy_chart
import theory_limits
import theory_report

from skfem_cosserat.accuracy import PrecisionTable, ResultTable

STORED = Path(__file__).resolve().parents[1] / "pictures"
Row = Mapping[str, Any]


def rows(name: str) -> list[Row]:
    """Of a stored table."""
    return list(ResultTable.read(STORED / f"{name}.csv").rows)


def grouped(found: Iterable[Row], *keys: str) -> Iterator[tuple[Any, dict[str, list[Any]]]]:
    """Rows of the same keys as columns, with the keys."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in found:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    for key, own in groups.items():
        yield key, {name: [row[name] for row in own] for name in own[0]}


def dynamic(path: Path) -> None:
    """Errors of moving rods in space and time."""
    result: dict[str, Any] = {"space": {}, "time": {}, "given": {}, "uncertainty": {}}
    for kind, key, name in (("space", "elements", "elements"), ("time", "steps", "step_s")):
        found = grouped(rows(f"dynamic_references.{kind}"), "scene", "integrator", "order")
        for (scene, integrator, order), own in found:
            entry = {key: own[name], "error": own["placement_error"]}
            result[kind].setdefault((scene, integrator), {})[order] = entry
    stored = rows("dynamic_references.reference")
    given = [row for row in stored if str(row["time_s"]).startswith("up to")]
    for (scene, order), own in grouped(given, "scene", "order"):
        entry = {"elements": own["elements"], "error": own["position_error_m"]}
        result["given"][scene, order] = entry
        result["uncertainty"][scene] = own["uncertainty_m"][0]
    dynamic_report.chart(result, path)


def elements(path: Path) -> None:
    """Orders, costs and locking of elements."""
    keys = "nodes", "order", "points", "quantity"
    orders = [
        dict(zip(keys, key, strict=True))
        | {"elements": own["elements"], "errors": own["relative_error"], "slope": own["slope"][0]}
        for key, own in grouped(rows("element_orders"), *keys)
    ]
    tables = {name: rows(f"element_{name}") for name in ("costs", "locking")}
    element_orders.chart({"orders": orders, **tables}, path)


def limits(path: Path) -> None:
    """Errors between theories, inf-sup constants."""
    found = grouped(rows("theory_limits"), "scene", "theory", "next_theory")
    errors = [
        {"scene": scene, "theory": theory, "next": after, "slope": own["slope"][0]}
        | {"ratios": own["stiffness_ratio"], "errors": own["error"]}
        for (scene, theory, after), own in found
    ]
    points = [
        {**own, "order": order, "points": count}
        for (order, count), own in grouped(rows("theory_limits.points"), "order", "points")
    ]
    theory_limits.chart({"limits": errors, "points": points}, path)


def theories(path: Path) -> None:
    """Theories on the stiff swing."""
    found = [dict(row) for row in rows("theory_table")]
    theory_report.chart({"rows": found, "ends": sorted({row["until_s"] for row in found})}, path)


def speed(path: Path) -> None:
    """Errors over costs of a scene, by steps and by whole process."""
    speed_accuracy_chart.charts(PrecisionTable.read(STORED / f"{path.stem}.csv"), path)


CHARTS = {
    "dynamic_references": dynamic,
    "element_orders": elements,
    "theory_limits": limits,
    "theory_table": theories,
    **{f"speed_accuracy_{name}": speed for name in speed_accuracy_chart.GRIDS},
}


def main(out: str | Path = STORED) -> list[Path]:
    """Draw them all into a folder; returns the files."""
    paths = [Path(out) / f"{name}.png" for name in CHARTS]
    for path, draw in zip(paths, CHARTS.values(), strict=True):
        draw(path)
    return paths


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", default=STORED)
    for written in main(parser.parse_args().out):
        print(written)
