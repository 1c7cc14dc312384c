"""The report: every number the paper prints beside the one computed here, with a remark."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.record import Record
from paper import convergence, figures, tables

NOT_GIVEN = "not given"
ORDER_STEPS = (5e-4, 2.5e-4)  # between which orders are given
PRINTED = {"height of the right link": "0.36 √2 = "}
HEADER = ("quantity", "published", "computed", "run", "remark")
SOLVER_REMARK = {
    "dense": "dense factorisation",
    "own choice": "the package's own choice",
    "sparse": "general sparse factorisation (SuperLU)",
}


class Entry(NamedTuple):
    """A line of the report; numbers as text, `run` refers to the list of runs."""

    quantity: str
    published: str
    computed: str
    run: int
    remark: str = ""

    def cells(self) -> tuple[str, str, str, str, str]:
        """In the order of HEADER."""
        return self.quantity, self.published, self.computed, str(self.run), self.remark


def power(value: float) -> str:
    """As the paper prints condition numbers: 2e12; small ones plainly."""
    if value < 1e3:
        return f"{value:.3g}"
    mantissa, exponent = f"{value:.2e}".split("e")
    return f"{float(mantissa):g}e{int(exponent)}"


def _name(pair: tuple[str, str]) -> str:
    return ", ".join(pair)


def _conditions(result: dict[str, Any], published: Any, run: int, compare: bool) -> Iterator[Entry]:
    """Condition numbers by pair and step, unscaled and scaled, and how they grow."""
    conditions = result["condition"]
    for pair, by_step in conditions.items():
        for k, h in enumerate(tables.STEPS):
            label = f"condition number, {_name(pair)}, h = {h:g} s"
            plain = by_step[h]["unscaled"]
            said, remark = NOT_GIVEN, "the same scene in other coordinates"
            if pair in published:
                said, remark = power(published[pair][2][k]), "another geometry: compare slopes"
            if pair in published and published[pair][0] == 1:
                remark = "a matrix of one entry"
            elif pair in published and compare:
                remark = f"computed / published {plain / published[pair][2][k]:.2f}"
            yield Entry(label, said, power(plain), run, remark)
            if "scaled" not in by_step[h]:
                continue
            scaled = by_step[h]["scaled"]
            remark = "rows and columns of the constraints scaled"
            if pair in published:
                reduced = conditions[pair[0], "null-space"][h]["unscaled"]
                remark += f"; {scaled / reduced:.1f} times that with the null space"
            yield Entry(f"{label}, scaled", NOT_GIVEN, power(scaled), run, remark)
    for pair, values in result["slopes"].items():
        said = tables.slopes(published[pair][2]) if pair in published else []
        yield Entry(
            f"growth with h^s: s, {_name(pair)}",
            " and ".join(f"{s:.2f}" for s in said) or NOT_GIVEN,
            " and ".join(f"{s:.2f}" for s in values),
            run,
            "from 1e-2 to 1e-3 s, and on to 1e-4 s; unscaled; published: from the printed numbers",
        )


def _costs(result: dict[str, Any], published: Any, run: int) -> Iterator[Entry]:
    """Ratios of processor time by linear solver, step and pair."""
    for solver, by_step in result["cpu"].items():
        for h, by_pair in by_step.items():
            for pair, cost in by_pair.items():
                how = SOLVER_REMARK[solver]
                if solver == "own choice" and pair in result["solvers"]:
                    how += f": {result['solvers'][pair]}"
                if pair == tables.RELATIVE:
                    how = "plain numpy; the null space with this solver is 1"
                yield Entry(
                    f"CPU ratio, {solver}, {_name(pair)}, h = {h:g} s",
                    f"{published[pair][1]:g}" if pair in published else NOT_GIVEN,
                    f"{cost['ratio']:.2f}",
                    run,
                    f"{how}; rounds {cost['low']:.2f} to {cost['high']:.2f};"
                    f" {cost['milliseconds']:.2f} ms a step",
                )


def table_1(result: dict[str, Any]) -> list[Entry]:
    """The six-body linkage."""
    run, other = result["run"], _name(tables.RELATIVE)
    n, rank = tables.COUNTS_1
    redundant = f"{result['rows']} rows, {result['rows'] - result['rank']} of them redundant"
    entries = [
        Entry("n", str(n), str(result["n"]), run, "coordinates"),
        Entry("independent constraints", str(rank), str(result["rank"]), run, redundant),
    ]
    for pair, count in result["unknowns"].items():
        said = str(tables.TABLE_1[pair][0]) if pair in tables.TABLE_1 else NOT_GIVEN
        remark = "5 hinge angles, 4 multipliers" if pair == tables.RELATIVE else ""
        entries.append(Entry(f"unknowns, {_name(pair)}", said, str(count), run, remark))
    entries += _costs(result, tables.TABLE_1, run)
    entries += _conditions(result, tables.TABLE_1, run, compare=False)
    accuracy = result["relative accuracy"]
    errors = {f"h = {h:g} s": f"{error:.2e}" for h, error in accuracy["errors"].items()}
    errors["Richardson"] = f"{accuracy['richardson']:.2e}"
    remark = "in m, up to 2 s, against a reference by other means"
    for what, text in errors.items():
        entries.append(Entry(f"error of P3, {other}, {what}", NOT_GIVEN, text, run, remark))
    order = f"{accuracy['order']:.3f}"
    return [*entries, Entry(f"order of P3, {other}", NOT_GIVEN, order, run)]


def table_2(result: dict[str, Any]) -> list[Entry]:
    """The three-bar swing."""
    run = result["run"]
    n, m = tables.COUNTS_2
    entries = [
        Entry("n", str(n), str(result["n"]), run, "coordinates"),
        Entry("m", str(m), str(result["m"]), run, "constraints"),
    ]
    for pair, count in result["unknowns"].items():
        said = str(tables.TABLE_2[pair][0])
        entries.append(Entry(f"unknowns, {_name(pair)}", said, str(count), run))
    entries += _costs(result, tables.TABLE_2, run)
    entries += _conditions(result, tables.TABLE_2, run, compare=True)
    return entries


def scene(result: dict[str, Any]) -> list[Entry]:
    """Data of section 6.2, soft and stiff."""
    run = result["run"]
    entries = [
        Entry(
            name,
            PRINTED.get(name, "") + f"{said:.10g}",
            f"{result['scene'][name]:.10g}",
            run,
        )
        for name, said in figures.SCENE.items()
    ]
    remarks = {"E": "in N/m^2; the paper's N/mm^2 is a slip", "thickness": "in the plane of motion"}
    for name, said in figures.STIFF_SCENE.items():
        value = f"{result['stiff scene'][name]:.10g}"
        remark = remarks.get(name, "")
        entries.append(Entry(f"stiff scene: {name}", f"{said:.10g}", value, run, remark))
    return entries


def motion(result: dict[str, Any]) -> list[Entry]:
    """What the text says about figures 20 to 24, and about the stiff scene."""
    run = result["run"]
    entries = [
        Entry(
            f"event X in s, {integrator}, h = {h:g} s",
            f"{figures.EVENT_X:g}",
            f"{data['event_x']:.4f}",
            run,
            "the right link reverses",
        )
        for (integrator, h), data in result["runs"].items()
    ]
    entries += [
        Entry(
            f"figure 20: rate of the {name.replace('_', ' ')}, after event X / before",
            "high frequencies after X",
            f"{values['ratio']:.2f}",
            run,
            "root mean square over 0.5 s on both sides",
        )
        for name, values in result["vibration"].items()
    ]
    entries += [
        Entry(
            f"figure 20: angular momentum out of e1 / along e1, {term}",
            "0",
            f"{value:.3g}",
            run,
            "the motion takes place in the plane",
        )
        for term, value in result["momentum"].items()
    ]
    more = result["colour_max"] > figures.COLOUR_LIMIT
    entries.append(
        Entry(
            "figure 21: weighted norm of force and moment in N",
            f"0 to {figures.COLOUR_LIMIT:.0f}",
            f"0 to {result['colour_max']:.0f}",
            run,
            "over all states; red is 4000 and more" if more else "over all states",
        )
    )
    entries.append(
        Entry(
            "figures 20 to 24 with multipliers: relative difference of q, variational",
            "indistinguishable",
            f"{result['treatments apart']:.1e}",
            run,
            "both treatments are equivalent up to rounding",
        )
    )
    return [*entries, *_energies(result), *_stiff(result)]


def _energies(result: dict[str, Any]) -> Iterator[Entry]:
    """Figures 23 and 24: how much the energy changes after the pulse."""
    run, energy = result["run"], result["energy"]
    coarse, fine = figures.STEPS
    for integrator, figure in (("energy-momentum", 23), ("variational", 24)):
        for term in figures.TERMS:
            said = "oscillates" if integrator == "variational" else NOT_GIVEN
            if (integrator, term) == ("energy-momentum", "(q_n, p_n)"):
                said = "0 (conserved exactly)"
            for h in figures.STEPS:
                values = energy[integrator, h][term]
                yield Entry(
                    f"figure {figure}: range of the energy after the pulse / mean, {integrator},"
                    f" {term}, h = {h:g} s",
                    said,
                    f"{values['range']:.2e}",
                    run,
                    f"second half off the first in the mean: {values['drift']:.1e}",
                )
            if integrator == "variational":
                ratio = energy[integrator, coarse][term]["range"]
                ratio /= energy[integrator, fine][term]["range"]
                label = f"figure {figure}: range at h = {coarse:g} s / at {fine:g} s, {term}"
                yield Entry(label, "above 1", f"{ratio:.0f}", run, "100 is second order")


def _stiff(result: dict[str, Any]) -> Iterator[Entry]:
    """Where the runs of the stiff scene end."""
    for (integrator, h), found in result["stiff"].items():
        stop, event = found["diverged_at"], found["event_x"]
        remark = "X not reached" if event is None else f"X passed at {event:.4f} s"
        computed = f"runs on to {figures.STIFF_UNTIL:g} s"
        if stop is not None:
            energy = str(found["divergence_reason"]).startswith("the energy")
            computed = f"stops at {stop:.4g} s"
            remark += "; energy above 10 times that after the pulse" if energy else "; Newton fails"
        yield Entry(
            f"stiff scene: {integrator}, h = {h:g} s",
            "passes X" if integrator == "energy-momentum" else "blows up at X, 1e-1 to 1e-5 s",
            computed,
            result["run"],
            remark,
        )


def cross_convergence(result: dict[str, Any]) -> list[Entry]:
    """Figure 25."""
    run, (coarse, fine) = result["run"], ORDER_STEPS
    entries = []
    for treatment in ("multipliers", "null-space"):
        study = result[treatment]
        for kind, orders in study["orders"].items():
            for name, order in orders[coarse, fine].items():
                shifted = name == convergence.SHIFTED
                if shifted and kind not in (convergence.SAME_END, convergence.SAME):
                    continue  # says nothing: the other's instants are much closer
                remark = f"difference {study['errors'][kind][fine][name]:.1e} at h = {fine:g} s"
                if shifted:
                    remark += "; node against midpoint: first order"
                entries.append(
                    Entry(
                        f"order, energy-momentum with {treatment}, {kind}, {name}",
                        NOT_GIVEN if shifted else "not given (curves approach)",
                        f"{order:.3f}",
                        run,
                        remark,
                    )
                )
    for h, errors in result["rounding"].items():
        label = f"both treatments of energy-momentum apart, multipliers, h = {h:g} s"
        noise = max(errors["internal multipliers"], errors["external multipliers"])
        remark = f"rounding, grows as the step shrinks; of q: {errors['q']:.1e}"
        entries.append(Entry(label, NOT_GIVEN, f"{noise:.1e}", run, remark))
    for until, study in result["longer"].items():
        for name, order in study["orders"][convergence.SAME][coarse, fine].items():
            label = f"order up to {until:g} s, {convergence.SAME}, {name}"
            entries.append(Entry(label, NOT_GIVEN, f"{order:.3f}", run, "reported only"))
    return entries


def _stories(result: dict[str, Any]) -> str:
    """What the linear algebra does to the costs, in a sentence."""
    ratios = [
        f"{by_step[tables.STEPS[0]]['variational', 'multipliers']['ratio']:.2f} ({solver})"
        for solver, by_step in result["cpu"].items()
    ]
    said = tables.TABLE_2["variational", "multipliers"][1]
    return (
        "Multipliers against the null space, variational scheme, h = 1e-2 s: "
        f"{', '.join(ratios)}; published {said:g}."
    )


SECTIONS = (
    (
        "table_1",
        "Table 1: six-body linkage",
        """The paper's geometry is not in the paper. Computed is the cube-edge linkage of Bricard,
which has the same structure: unknowns and slopes can be compared, absolute condition numbers not.
CPU ratios are to variational with the null space, as in the paper. A further column takes up the
question the paper ends with: the same linkage in the five hinge angles of its tree, the cut hinge
closed by four independent rows with multipliers. It is a plain implementation in numpy with
derivatives by complex steps, see relative_coordinates.py: its cost says what such a formulation
costs without compiled code or caching, not what it could cost.""",
    ),
    (
        "table_2",
        "Table 2: three-bar swing",
        """Condition numbers are medians over the steps that three_bar_swing.condition_number names,
in SI units. The growth with 1/h is a matter of scaling, which the paper does not say: compare the
lines "scaled", of the same matrices with constraint rows and columns in the units of the dynamic
block. The paper timed 1000 steps; here short runs of 50 steps, all variants one after the other,
repeated, each with three linear solvers: they tell different stories.""",
    ),
    ("scene", "Figure 19: the scene", "![the scene](figure_19.png)"),
    (
        "motion",
        "Figures 20 to 24: the motion, and the stiff scene",
        """![forces and momenta](figure_20.png)
![snapshots](figure_21.png)
![energy and orbit](figure_22.png)
![energies, energy-momentum](figure_23.png)
![energies, variational](figure_24.png)

The stiff scene is only touched here; failure_map.py follows it step by step over a full period.""",
    ),
    (
        "convergence",
        "Figure 25: cross-convergence",
        """![cross-convergence](figure_25.png)

At 0.1 s, orders between h = 5e-4 and 2.5e-4 s. With the same step the two schemes are much closer
to each other than to the solution: the differences to the other one's fine trajectory are larger
and show the error of the scheme itself. The reference step bounds what the latter can show.""",
    ),
)


def entries(result: dict[str, Any]) -> dict[str, list[Entry]]:
    """All lines, by section."""
    return {
        "table_1": table_1(result["table 1"]),
        "table_2": table_2(result["table 2"]),
        "scene": scene(result["figures"]),
        "motion": motion(result["figures"]),
        "convergence": cross_convergence(result["convergence"]),
    }


def _table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [header, ("---",) * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def main(result: dict[str, Any], out: str | Path, record: Record) -> list[Path]:
    """Write ``report.md`` and a CSV of each section's lines; returns the paths.

    Parameters
    ----------
    result : dict
        Of ``reproduce_paper.main``: ``table 1``, ``table 2``, ``figures``, ``convergence``.
    out : path
        An existing folder.
    record : Record
        Of the session.
    """
    out = Path(out)
    provenance = record.provenance
    versions = ", ".join(f"{name} {value}" for name, value in provenance["versions"].items())
    parts = [
        "# Published and computed",
        "Leyendecker, Marsden & Ortiz, *Variational integrators for constrained dynamical systems*,"
        " ZAMM 88 (2008) 677: tables 1 and 2, figures 19 to 25, and the numbers of the text about"
        " them. Each computed number refers to one of the runs at the end"
        ", with its date, time and versions.",
    ]
    paths = []
    for (name, title, text), lines in zip(SECTIONS, entries(result).values(), strict=True):
        cells = [line.cells() for line in lines]
        parts += [f"## {title}", text, _table(HEADER, cells)]
        if name == "table_2":
            parts.append(_stories(result["table 2"]))
        paths.append(record.write_csv(out / f"{name}.csv", lines[0].run, HEADER, cells))
    runs = [
        (str(k), run["title"], run["date"], f"{run['seconds']:.1f}", versions, provenance["commit"])
        for k, run in enumerate(record.runs, start=1)
    ]
    parts += [
        "## Runs",
        f"On {provenance['machine']}, {provenance['blas_threads']} thread of the linear algebra."
        " CPU ratios are of this machine and this moment.",
        _table(("run", "what", "date", "wall time in s", "versions", "commit"), runs),
    ]
    path = out / "report.md"
    path.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return [path, *paths]
