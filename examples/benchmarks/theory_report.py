"""Figures, text, files and chart of the table of theories."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

import measuring  # before numpy: one thread
import numpy as np
from measuring import INTEGRATORS

from skfem_cosserat.accuracy.chart import STATUSES
from skfem_cosserat.figures import PAGE, legend, panels, styles, write_figure

Row = dict[str, Any]

#: what is asked of a theory, see `figures`: ranges of steps of the variational scheme (to the first
#: end, to a period), those without a repeated solve of energy-momentum, Newton iterations, time
#: errors, costs; all relative to the full beam
RANGE, PERIOD_RANGE, SOLVED_RANGE = 4.0, 5.0, 8.0
ITERATIONS, TIME_ERROR, COST = 0.6, 1.3, 0.5
COLOURS = {
    name: each.color
    for name, each in styles(("full", "unshearable", "inextensible", "rigid")).items()
}
MARKERS = {"ok": "o", "drift": "D", "blowup": "x", "newton": "v", "timeout": ">"}


def contiguous(rows: Iterable[Row]) -> float | None:
    """The longest step that is ok as all shorter ones are; None if the shortest is not.

    Parameters
    ----------
    rows : iterable of dict
        Of one theory, integrator and end.
    """
    return _longest(rows, lambda row: row["status"] == "ok")


def unrepeated(rows: Iterable[Row]) -> float | None:
    """The same of runs to the end, whatever their energy, of which no step was solved twice."""
    return _longest(rows, lambda row: ended(row) and not row["repeated"])


def ended(row: Row) -> bool:
    """Whether a run reached its end."""
    return row["status"] in ("ok", "drift")


def _longest(rows: Iterable[Row], good: Callable[[Row], bool]) -> float | None:
    longest = None
    for row in sorted(rows, key=lambda row: row["step_s"]):
        if not good(row):
            break
        longest = row["step_s"]
    return longest


def chosen(result: Row, **wanted: Any) -> list[Row]:
    """Rows with these values."""
    return [row for row in result["rows"] if all(row[k] == each for k, each in wanted.items())]


def ranges(result: Row) -> list[Row]:
    """Contiguous ranges by theory, integrator and end, and those without a repeated solve."""
    theories = list(dict.fromkeys(row["theory"] for row in result["rows"]))
    out = []
    for theory in theories:
        for integrator in INTEGRATORS:
            for end in result["ends"]:
                rows = chosen(result, theory=theory, integrator=integrator, until_s=end)
                fixed = {"theory": theory, "integrator": integrator, "until_s": end}
                limits = {"contiguous_s": contiguous(rows), "unrepeated_s": unrepeated(rows)}
                out.append({**fixed, **limits, "passed": sum(r["status"] == "ok" for r in rows)})
    return out


def figures(result: Row, theory: str) -> list[Row]:
    """What is asked of a theory, what came out, and whether that is met.

    Returns
    -------
    list of dict
        ``figure`` (text), ``value``, ``limit``, ``met``; the value is None where nothing was
        measured, which does not meet anything. Where not even the shortest step of the full beam
        counts, the value is a lower bound: relative to that step.
    """
    found = {(r["theory"], r["integrator"], r["until_s"]): r for r in ranges(result)}
    if not any(key[0] == theory for key in found):
        return []
    shortest = min(row["step_s"] for row in result["rows"])
    out = []

    def ratio(integrator: str, end: float, name: str) -> float | None:
        own, full = (found[each, integrator, end][name] for each in (theory, "full"))
        return None if own is None else own / (full or shortest)

    for k, end in enumerate(result["ends"]):
        where = f"to {end:g} s"
        value, least = ratio("variational", end, "contiguous_s"), PERIOD_RANGE if k else RANGE
        out.append(at_least(f"variational, contiguous range {where}", value, least))
        value = ratio("energy-momentum", end, "unrepeated_s")
        out.append(at_least(f"energy-momentum, steps without repeats {where}", value, SOLVED_RANGE))
        pairs = compared(result, theory, "energy-momentum", end)
        iterations = [r["iterations_per_step"] / f["iterations_per_step"] for r, f in pairs]
        out.append(at_most(f"energy-momentum, iterations {where}", iterations, ITERATIONS))
        for integrator in INTEGRATORS:
            pairs = compared(result, theory, integrator, end)
            excess = [(r["error_m"] - r["model_error_m"]) / f["error_m"] for r, f in pairs]
            calm = [r["status"] == f["status"] == "ok" for r, f in pairs]
            text = f"{integrator}, error less that of the model {where}"
            out.append(at_most(text, excess, TIME_ERROR, calm))
    for integrator in INTEGRATORS:
        ratios = [
            row["ratio"]
            for row in result["costs"]
            if (row["theory"], row["integrator"]) == (theory, integrator) and "ratio" in row
        ]
        out.append(at_most(f"{integrator}, cost of a step", ratios, COST))
    return out


def compared(result: Row, theory: str, integrator: str, end: float) -> list[tuple[Row, Row]]:
    """Rows of a theory and of the full beam at steps with which both reach the end."""
    own, full = (
        {r["step_s"]: r for r in chosen(result, theory=each, integrator=integrator, until_s=end)}
        for each in (theory, "full")
    )
    both = [(own[step], full[step]) for step in sorted(own) if step in full]
    return [(a, b) for a, b in both if ended(a) and ended(b)]


def at_least(text: str, value: float | None, limit: float) -> Row:
    """A figure that a value reaches."""
    met = value is not None and value >= limit
    return {"figure": text, "value": value, "limit": limit, "met": met, "of": "at least"}


def at_most(
    text: str, values: Sequence[float], limit: float, calm: Sequence[bool] | None = None
) -> Row:
    """A figure that the largest of some values, one a step, does not exceed.

    `calm`: those of steps with which both beams are ok, whose worst value is told as well.
    """
    worst = max(values, default=None)
    met = worst is not None and worst <= limit
    share = f"met at {sum(value <= limit for value in values)} of {len(values)} steps"
    more: Row = {"best": min(values, default=None), "steps": share}
    if calm is not None:
        more["ok"] = max((v for v, ok in zip(values, calm, strict=True) if ok), default=None)
    return {"figure": text, "value": worst, "limit": limit, "met": met, "of": "at most", **more}


def missed(result: Row) -> list[str]:
    """The figures that are missed, as text."""
    return [f"{_said(each)}: missed" for each in result["figures"] if not each["met"]]


def _said(each: Row) -> str:
    asked = f"asked {each['of']} {each['limit']}"
    if each["value"] is None:
        return f"{each['figure']}: not measured, {asked}"
    more = ""
    if each.get("best") is not None:
        calm = "" if each.get("ok") is None else f"; {each['ok']:.3g} where both are ok"
        more = f" (best {each['best']:.3g}{calm}; {each['steps']})"
    return f"{each['figure']}: {each['value']:.3g} of the full beam's{more}, {asked}"


def report(result: Row) -> str:
    """All but the rows, as text."""
    parts = [measuring.table(result[key], columns(result[key])) for key in ("errors", "costs")]
    parts += [measuring.table(rows, columns(rows)) for rows in (ranges(result), result["theory"])]
    lines = [f"{_said(each)}: {'met' if each['met'] else 'missed'}" for each in result["figures"]]
    return "\n\n".join([*parts, "\n".join(lines)])


def columns(rows: Sequence[Row]) -> list[str]:
    """All names of some rows."""
    return list(dict.fromkeys(name for row in rows for name in row))


def write(result: Row, path: Path) -> None:
    """The smaller tables beside the large one, and the chart where matplotlib is there."""
    for name in ("costs", "theory"):
        own = {**result, "rows": result[name]}
        measuring.write(path.with_suffix(f".{name}.csv"), own, columns(result[name]))
    own = {**result, "rows": ranges(result)}
    measuring.write(path.with_suffix(".ranges.csv"), own, columns(own["rows"]))
    with suppress(ImportError):  # charts come with the extra "view"
        chart(result, path.with_suffix(".png"))


def chart(result: Row, path: Path) -> None:
    """Time reached, with contiguous ranges, and errors, against the step; a column a scheme."""
    shape = 2, len(INTEGRATORS)
    figure, found = panels(PAGE, 8.6, *shape, sharex=True, sharey="row")
    axes = np.array(found).reshape(shape)
    end = result["ends"][0]
    for k, integrator in enumerate(INTEGRATORS):
        _chart_outcomes(axes[0, k], result, integrator)
        _chart_errors(axes[1, k], result, integrator, end)
        axes[0, k].set_title(integrator)
    axes[0, 0].set_ylabel("time reached in s")
    axes[1, 0].set_ylabel(f"error of the mass to {end:g} s in m")
    legend(figure, below=3, handles=_handles(result))
    write_figure(figure, path)


def _chart_outcomes(axis: Any, result: Row, integrator: str) -> None:
    last = result["ends"][-1]
    theories = [theory for theory in COLOURS if chosen(result, theory=theory)]
    for k, theory in enumerate(theories):
        rows = chosen(result, theory=theory, integrator=integrator, until_s=last)
        for status, marker in MARKERS.items():
            found = [r for r in rows if r["status"] == status]
            x = [r["step_s"] * (1 + 0.03 * (k - len(theories) / 2)) for r in found]
            axis.plot(x, [r["time_s"] for r in found], marker, color=COLOURS[theory], ms=5)
        for j, end in enumerate(result["ends"]):
            own = chosen(result, theory=theory, integrator=integrator, until_s=end)
            if (limit := contiguous(own)) is not None:
                low = min(r["step_s"] for r in own)
                y = last * (1.04 + 0.03 * k + 0.22 * j)
                axis.plot([low, limit], [y, y], color=COLOURS[theory], lw=4, solid_capstyle="butt")
    for j, end in enumerate(result["ends"]):
        axis.axhline(end, color="0.8", lw=0.8, zorder=0)
        text = f"no failure up to {end:g} s at any shorter step"
        where = (0.02, last * (1.155 + 0.22 * j))
        axis.annotate(text, where, xycoords=("axes fraction", "data"), size="small")
    axis.set(xscale="log", ylim=(0, last * (1.05 + 0.22 * len(result["ends"]))))


def _chart_errors(axis: Any, result: Row, integrator: str, end: float) -> None:
    for theory, colour in COLOURS.items():
        rows = chosen(result, theory=theory, integrator=integrator, until_s=end)
        rows = sorted((r for r in rows if ended(r)), key=lambda row: row["step_s"])
        if not rows:
            continue
        steps, errors = [r["step_s"] for r in rows], [r["error_m"] for r in rows]
        ok = [r["status"] == "ok" for r in rows]
        axis.plot(steps, errors, "D-", color=colour, ms=3, mfc="none")
        axis.plot(steps, errors, "o", color=colour, ms=5, markevery=ok)
        axis.plot(steps, [r["time_error_m"] for r in rows], ":", color=colour, lw=1)
        axis.axhline(rows[0]["mesh_error_m"], color=colour, ls="--", lw=0.8, zorder=1)
    axis.set(xscale="log", yscale="log", xlabel="step in s")


def _handles(result: Row) -> list[Any]:
    """Of the legend: theories by colour, ends of runs by mark, kinds of errors by line."""
    from matplotlib.lines import Line2D

    found = {row["status"] for row in result["rows"]}
    grey = {"color": "0.3", "lw": 0}
    return [
        *(Line2D([], [], color=c, lw=4, label=t) for t, c in COLOURS.items()),
        *(
            Line2D([], [], marker=mark, label=STATUSES[status].words, **grey)
            for status, mark in MARKERS.items()
            if status in found
        ),
        Line2D([], [], color="0.3", ls=":", lw=1, label="error in time alone"),
        Line2D([], [], color="0.3", ls="--", lw=0.8, label="error of the mesh"),
    ]
