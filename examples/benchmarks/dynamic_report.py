"""Tables, chart and text of the dynamic references."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from record import Record

from skfem_cosserat.figures import PAGE, legend, panels, styles, write_figure

#: of a run: rotations (-), velocities (m/s) and energy (J), where the reference has them
OTHERS = ("rotation", "velocity", "energy")
ORDERS = dict(enumerate(styles([f"order {k}" for k in (1, 2, 3, 4)]).values(), 1))


def main(result: dict[str, Any], folder: Path, record: Record, number: int) -> list[Path]:
    """Write three tables and, where matplotlib is there, a chart.

    Parameters
    ----------
    result : dict
        Of ``dynamic_references.main``.
    folder : Path
        It exists.
    record, number
        The session, and the run in it that made the numbers.
    """
    head = ["scene", "integrator", "order"]
    with_error = ["placement_error", "velocity_error_m_s", "energy_error_J"]
    tables = {
        "space": ([*head, "elements", *with_error], _rows(result["space"], "elements")),
        "time": ([*head, "step_s", *with_error], _rows(result["time"], "steps")),
        "reference": (
            [*head, "elements", "time_s", "position_error_m", "rotation_error"]
            + ["velocity_error_m_s", "energy_error_J", "uncertainty_m"],
            _reference_rows(result),
        ),
    }
    paths = [
        record.write_csv(folder / f"dynamic_references.{name}.csv", number, header, rows)
        for name, (header, rows) in tables.items()
    ]
    with suppress(ImportError):  # charts come with the extra "view"
        paths.append(chart(result, folder / "dynamic_references.png"))
    return paths


def chart(result: dict[str, Any], path: Path) -> Path:
    """Errors in space above, in time below, a column for each scene."""
    figure, axes = panels(PAGE, 7.2, 2, 3)
    for column, name in enumerate(result["uncertainty"]):
        _draw_space(axes[column], result, name)
        _draw_time(axes[3 + column], result, name)
    axes[0].set_ylabel("error in space, positions in m")
    axes[3].set_ylabel("error in time, positions in m")
    for row, texts in (
        (0, ("above: smooth loads", "above: loads as given")),
        (3, ("below: energy-momentum", "below: variational")),
    ):
        for text, style in zip(texts, ("-", "--"), strict=True):
            axes[row].plot([], [], style, color="0.4", label=text)
    legend(figure, below=3)
    write_figure(figure, path)
    return path


def _rows(tables: dict[Any, Any], key: str) -> Iterator[Sequence[Any]]:
    """Of the orders with smooth loads."""
    for (name, integrator), table in tables.items():
        for order, entry in table.items():
            columns = (entry[key], entry["error"], entry["velocity"], entry["energy"])
            for values in zip(*columns, strict=True):
                yield name, integrator, order, *values


def _reference_rows(result: dict[str, Any]) -> Iterator[Sequence[Any]]:
    """Of the meshes with the loads as given, then of the finest runs."""
    for (name, order), entry in result["given"].items():
        tail = ("", "", "", result["uncertainty"][name])
        for count, error in zip(entry["elements"], entry["error"], strict=True):
            yield name, "energy-momentum", order, count, f"up to {entry['until']}", error, *tail
    for (name, integrator), run in result["finest"].items():
        for k, t in enumerate(run["times"]):
            others = [run[key][k] if key in run else "" for key in OTHERS]
            head = (name, integrator, run["order"], run["elements"], t)
            yield *head, run["position"][k], *others, run["uncertainty"][k]


def _draw_space(axis: Any, result: dict[str, Any], name: str) -> None:
    """Against the number of elements: smooth loads full, loads as given broken."""
    for order, entry in result["space"][name, "energy-momentum"].items():
        look = {"color": ORDERS[order].color, "marker": ORDERS[order].marker, "ms": 4}
        axis.loglog(entry["elements"], entry["error"], **look, label=f"order {order}")
        given = result["given"][name, order]
        axis.loglog(given["elements"], given["error"], "--", **look, mfc="none")
    limit = result["uncertainty"][name]
    axis.axhline(limit, color="grey", lw=1, zorder=1, label="uncertainty of the reference")
    axis.set(title=name, xlabel="elements in each leg" if name == "D2" else "elements")


def _draw_time(axis: Any, result: dict[str, Any], name: str) -> None:
    """Against the step, smooth loads: energy-momentum full, variational broken."""
    for integrator, style in (("energy-momentum", "-"), ("variational", "--")):
        for order, entry in result["time"][name, integrator].items():
            look = {"color": ORDERS[order].color, "marker": ORDERS[order].marker, "ms": 4}
            mfc = look["color"] if style == "-" else "none"
            axis.loglog(entry["steps"], entry["error"], style, **look, mfc=mfc)
    axis.set_xticks(entry["steps"], [f"1/{round(1 / h)}" for h in entry["steps"]])
    axis.tick_params(axis="x", which="minor", bottom=False, labelbottom=False)
    axis.set(xlabel="step in s")


def _order(key: str, sizes: Sequence[float], error: Sequence[float]) -> float:
    """Between the last two meshes; steps: the two before, as the limit is made of the last too."""
    which = slice(-2, None) if key == "elements" else slice(-3, -1)
    return float(abs(np.diff(np.log(error[which]))[0] / np.diff(np.log(sizes[which]))[0]))


def lines(result: dict[str, Any]) -> Iterable[str]:
    """Orders between the two finest meshes and steps, and what was reached."""
    for kind, key in (("space", "elements"), ("time", "steps")):
        yield f"orders in {kind}, smooth loads (placement, velocity, energy):"
        for (name, integrator), table in result[kind].items():
            for order, entry in table.items():
                found = [_order(key, entry[key], entry[x]) for x in ("error", "velocity", "energy")]
                text = ", ".join(f"{x:.2f}" for x in found)
                yield f"  {name} {integrator:16s} p = {order}: {text}; {entry['error'][-1]:.1e}"
    yield "largest position error with the loads as given, against the reference:"
    for (name, order), entry in result["given"].items():
        pairs = zip(entry["elements"], entry["error"], strict=True)
        text = ", ".join(f"{n}: {e:.1e}" for n, e in pairs)
        yield f"  {name} p = {order}: {text} (reference {result['uncertainty'][name]:.0e})"
    for (name, integrator), run in result["finest"].items():
        mesh = f"order {run['order']}, {run['elements']} elements, steps {run['steps']}"
        yield f"finest run of {name}, {integrator}: {mesh}"
        for key in ("times", "uncertainty", "position", *OTHERS):
            if key in run:
                yield f"  {key:12s}" + " ".join(f"{x:9.2g}" for x in run[key])


def plain(value: Any) -> Any:
    """For JSON: keys joined, arrays as lists."""
    if isinstance(value, dict):
        return {
            " ".join(map(str, k)) if isinstance(k, tuple) else str(k): plain(v)
            for k, v in value.items()
        }
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    return str(value) if isinstance(value, Path) else value
