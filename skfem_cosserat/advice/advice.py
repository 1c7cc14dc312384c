"""What the advisor gives: a proposal, its errors and costs, all candidates, and why."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..figures import check_folder, new_figure, write_figure
from ..model import Model
from .pilot import Pilot
from .proposal import Proposal

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Advice"]

ErrorSize = float | dict[str, float]


@dataclass
class Advice:
    """Result of :func:`advise`.

    Attributes
    ----------
    proposal : Proposal or None
        The cheapest that was seen to be within the tolerance; None: none was.
        ``proposal.build(model)`` is the scene of it.
    predicted_error, true_error : float, or dict of str to float
        The largest of the quantities' errors as they were predicted before the proposal was run,
        and as measured against the reference; by quantity if the tolerance was so.
    reference_error : float, or dict of str to float
        Estimated error of the reference itself.
    predicted_cost_s, true_cost_s : float
        Processor time of the whole event (s); the true one is the least that its first step and
        an iteration have taken in all runs of that scene with that method.
    confident : bool
        Whether true error and that of the reference together are within the tolerance, and
        nothing speaks against both.
    reasons : list of str
        What does.
    candidates : list of dict
        A row for each proposal that was run: rungs, order, elements, integrator, treatment, step,
        unknowns, error, cost, status; not "robust": it goes through, with half the step it fails.
    explanation : str
        All that as a table and sentences.
    spent_s : float
        Processor time of the advice (s).
    until : float
        How long the event is (s).
    reference : Proposal or None
        What errors were measured against.
    pilot : Pilot
        Energies, frequencies and bending of a pilot run.
    """

    proposal: Proposal | None
    predicted_error: ErrorSize
    true_error: ErrorSize
    reference_error: ErrorSize
    predicted_cost_s: float
    true_cost_s: float
    confident: bool
    reasons: list[str]
    candidates: list[dict[str, Any]]
    explanation: str = ""
    spent_s: float = 0.0
    until: float = np.nan
    reference: Proposal | None = None
    pilot: Pilot = field(default_factory=Pilot, repr=False)

    def __str__(self) -> str:
        return self.explanation

    def build(self, model: Model) -> Model:
        """The scene of the proposal; `model` does not change.

        Raises
        ------
        InputError
            If there is no proposal, or it is not the model that was advised on.
        """
        if self.proposal is None:
            raise InputError("advice", "has no proposal: " + "; ".join(self.reasons))
        return self.proposal.build(model)

    def csv(self, path: str | os.PathLike[str]) -> None:
        """Write the candidates, one a line.

        Raises
        ------
        InputError
            If the folder does not exist.
        """
        check_folder(path)
        with open(path, "w", newline="", encoding="utf-8") as handle:
            writer = csv.DictWriter(
                handle, list(self.candidates[0]) if self.candidates else ["status"]
            )
            writer.writeheader()
            writer.writerows(self.candidates)

    def chart(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Errors over costs of all candidates, the proposal marked; see :meth:`csv`.

        Raises
        ------
        ImportError
            Without matplotlib.
        """
        figure = new_figure(6.4, 4.8)
        self.draw(figure.subplots())
        return write_figure(figure, path)

    def draw(self, axis: Any) -> None:
        """Draw the chart on axes of matplotlib."""
        axis.set(xscale="log", yscale="log", xlabel="cost in s", ylabel="error / tolerance")
        axis.xaxis.set_minor_formatter(_few)  # costs seldom span a decade
        done = [row for row in self.candidates if row["status"] == "ok" and row["error"] > 0]
        for k, kind in enumerate(sorted({row["rungs"] for row in done})):
            own = [row for row in done if row["rungs"] == kind]
            for row in own:
                fill = {} if row["robust"] else {"mfc": "none"}
                style = "osD^v<>p"[k % 8]
                axis.plot(row["cost_s"], row["error"], style, color=f"C{k}", ms=4, **fill)
            axis.plot([], [], "osD^v<>p"[k % 8], color=f"C{k}", label=kind or "bodies")
        if not all(row["robust"] for row in done):
            axis.plot([], [], "o", mfc="none", color="grey", label="fails with half the step")
        failed = [row["cost_s"] for row in self.candidates if row["status"] != "ok"]
        failed = [cost for cost in failed if np.isfinite(cost)]
        if failed:
            top = axis.get_xaxis_transform()
            axis.plot(failed, [0.97] * len(failed), "xk", transform=top, label="failed")
        axis.axhline(1.0, color="black", linewidth=0.8)
        for row in self.candidates:
            if row["chosen"]:
                axis.plot(
                    row["cost_s"],
                    row["error"],
                    "o",
                    mfc="none",
                    mec="red",
                    ms=13,
                    mew=2,
                    label="proposal",
                )
        axis.grid(which="major", alpha=0.3)
        axis.tick_params(axis="x", which="both", labelsize="x-small", rotation=45)
        axis.legend(fontsize="x-small")


def explained(advice: Advice, lines: Sequence[str], tolerance: dict[str, float]) -> str:
    """The table of the best candidates of each kind, and what was found."""
    columns = ("rungs", "p", "elements", "steps", "method", "error/tol", "cost s")
    head = "{:<28} {} {:>14} {:>6} {:<28} {:>9} {:>8}".format(*columns)
    rows = [head, "-" * len(head)]
    for row in _worth_telling(advice.candidates):
        mark = " <-" if row["chosen"] else "" if row["robust"] else " fails with half the step"
        error = f"{row['error']:.3g}" if row["status"] == "ok" else row["status"]
        rows.append(
            f"{row['rungs'][:28]:<28} {row['order']:>1} {row['elements'][:14]:>14}"
            f" {row['steps']:>6} {(row['integrator'] + ', ' + row['treatment'])[:28]:<28}"
            f" {error:>9} {row['cost_s']:>8.3g}{mark}"
        )
    wanted = ", ".join(f"{name} to {each:.3g}" for name, each in tolerance.items())
    what = [f"{wanted} until {advice.until:.4g} s"]
    if advice.proposal is not None:
        what += [f"proposal: {advice.proposal}"]
        what += [
            f"error {_sizes(advice.true_error)} (predicted {_sizes(advice.predicted_error)}),"
            f" of the reference {_sizes(advice.reference_error)};"
            f" cost {advice.true_cost_s:.3g} s (predicted {advice.predicted_cost_s:.3g} s)"
        ]
    what += ["confident" if advice.confident else "not confident: " + "; ".join(advice.reasons)]
    return "\n".join(
        [
            *what,
            *lines,
            f"{len(advice.candidates)} candidates run in {advice.spent_s:.3g} s:",
            *rows,
        ]
    )


def _sizes(error: ErrorSize) -> str:
    if isinstance(error, dict):
        return ", ".join(f"{name} {each:.3g}" for name, each in error.items())
    return f"{error:.3g}"


def _worth_telling(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those that no other one beats in both error and cost, and failures."""
    done = sorted((row for row in rows if row["status"] == "ok"), key=lambda row: row["cost_s"])
    out, least = [], np.inf
    for row in done:
        if row["error"] < least or row["chosen"]:
            out.append(row)
            least = min(least, row["error"])
    return out + [row for row in rows if row["status"] != "ok"][:5]


def _few(value: float, _place: object = None) -> str:
    """Labels of ticks between powers of ten, those that have room."""
    return f"{value:g}" if round(value / 10.0 ** np.floor(np.log10(value))) in (2, 5) else ""
