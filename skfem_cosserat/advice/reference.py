"""A reference: refined in space and time until what is left of its error is small and known."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .proposals import Proposal
from .trials import Trial, Trials

#: order of the elements of references
ORDER = 3
#: error of the reference that is aimed at, in tolerances
AIM = 0.1
#: differences below this part of the tolerance need no observed order
SMALL = 0.02
#: a doubling of steps or elements must reduce differences by this factor at least
FALLING = 1.5
#: or by this one, if all that are still to come, each smaller by it, add up to so many tolerances
SLOWLY, REST = 1.2, 0.2
#: refinements beyond the aim to see an order
AGAIN = 3
#: levels of refinement at most
MOST = 10
#: steps are doubled so often to find a run that goes through
TRIES = 8


@dataclass
class FinestRun:
    """The finest run, and how the way there went.

    Attributes
    ----------
    trial : Trial or None
        None: no run goes through the event, and `doubts` says why.
    error : float
        Estimate of its own error, in tolerances.
    coarse : dict of str to int
        By beam: level of the mesh before the last refinement, on which the rest is compared.
    steps : int
        Steps before the last refinement.
    time : dict of int to float
        By number of steps: difference from the run with twice as many, in tolerances.
    space : dict of (str, int) to float
        By beam and level: difference from the run with the next level, in tolerances.
    falling : dict of str to float
        Observed factors by which the last differences in "time" and "space" fell; infinite where
        they are too small to matter.
    doubts : list of str
        Why it is not to be trusted.
    """

    trial: Trial | None
    error: float
    coarse: dict[str, int]
    steps: int
    time: dict[int, float] = field(default_factory=dict)
    space: dict[tuple[str, int], float] = field(default_factory=dict)
    falling: dict[str, float] = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)


def find_reference(event: Trials) -> FinestRun:
    """Refine full beams until the estimated error is below a tenth of the tolerance."""
    return _Refiner(event).find()


class _Refiner:
    def __init__(self, event: Trials) -> None:
        self.event = event
        self.level = dict.fromkeys(event.beams, 1)
        self.steps = event.base
        self.time: dict[int, float] = {}
        self.space: dict[tuple[str, int], float] = {}
        self.doubts: list[str] = []
        self.last_cost, self.tries = 0.0, 0

    def proposal(self, level: dict[str, int], steps: int) -> Proposal:
        elements = {name: self.event.pieces[name] * 2**k for name, k in level.items()}
        return self.event.proposal(elements, ORDER, steps)

    def run(self, level: dict[str, int], steps: int) -> Trial:
        trial = self.event.run(self.proposal(level, steps))
        self.last_cost = trial.cost_s if trial.ok else self.last_cost
        return trial

    def up(self, *names: str, by: int = 1) -> dict[str, int]:
        """Levels with some beams refined (all without names)."""
        chosen = names or tuple(self.level)
        return {name: k + by * (name in chosen) for name, k in self.level.items()}

    def find(self) -> FinestRun:
        found = self._refine() if self._start() else None
        if found is None:
            return FinestRun(None, np.inf, dict(self.level), self.steps, doubts=self.doubts)
        while bad := self._orders(found):
            left = self.event.budget.allows(10 * self.last_cost) and not self._at_limit()
            if self.doubts or not left or self.tries == AGAIN:
                self.doubts += bad.values()
                break
            self.tries += 1
            if "time" in bad:
                self.steps *= 2
            if "space" in bad:
                self.level = self.up()
            found = self._refine() or found
        found.doubts = self.doubts
        return found

    def _start(self) -> bool:
        """The first mesh and step that go through."""
        for _ in range(TRIES):
            trial = self.run(self.level, self.steps)
            if trial.ok:
                return True
            if trial.status == "stopped":
                self.doubts.append("the budget ran out in the first run")
                return False
            if trial.status == "diverged":
                self.steps *= 2
            elif "bent" in trial.reason or "turns by" in trial.reason or "flip" in trial.reason:
                self.level = self.up()
            else:
                self.doubts.append(trial.reason)
                return False
        self.doubts.append(f"no run of up to {self.steps // 2} steps went through: {trial.reason}")
        return False

    def _refine(self) -> FinestRun | None:
        """One axis at a time, the one with the larger difference."""
        best: FinestRun | None = None
        for _ in range(2 * MOST):
            base = self.run(self.level, self.steps)
            finer = self.run(self.level, 2 * self.steps)
            if not (base.ok and finer.ok):
                if (
                    "stopped" in (base.status, finer.status)
                    or self.steps >= self.event.base * 2**MOST
                ):
                    break
                self.steps *= 2
                continue
            gap = self.time[self.steps] = self.event.distance(base, finer)
            for name in self.level:
                key = (name, self.level[name])
                if key not in self.space:
                    refined = self.run(self.up(name), self.steps)
                    self.space[key] = self.event.distance(base, refined)
            spaces = {name: self.space[name, self.level[name]] for name in self.level}
            width = sum(spaces.values())
            if not self.event.budget.allows(4 * self.last_cost):
                self.doubts.append("the budget ran out before the reference was fine enough")
                return best or self._final(finer, gap, width)
            if gap / 3 + width / 3 <= AIM:
                best = self._final(finer, gap, None)
                if best is not None and best.error <= AIM:
                    return best
                if best is not None:
                    width = self._misjudged(best, spaces)
            if (
                self.steps >= self.event.base * 2**MOST
                or max(self.level.values(), default=0) >= MOST
            ):
                break
            if gap >= width:
                self.steps *= 2
            else:
                most = max(spaces.values())
                self.level = self.up(*(name for name, d in spaces.items() if d >= 0.3 * most))
        self.doubts.append(
            f"refined to {self.steps} steps and meshes {self.level} without the differences"
            " becoming small enough"
        )
        return best

    def _at_limit(self) -> bool:
        most = max(self.level.values(), default=0)
        return self.steps >= self.event.base * 2**MOST or most >= MOST

    def _misjudged(self, best: FinestRun, spaces: dict[str, float]) -> float:
        """What the last refinement of all beams changed counts, not that of each at fewer steps."""
        total = sum(spaces.values()) or 1.0
        width = best.falling["space difference"]
        for name, d in spaces.items():
            self.space[name, self.level[name]] = d / total * width
        return width

    def _final(self, finer: Trial, gap: float, width: float | None) -> FinestRun | None:
        """The reference: refined in everything."""
        trial = finer
        if width is None and self.level:
            trial = self.run(self.up(), 2 * self.steps)
            if not trial.ok:
                return None
            width = self.event.distance(finer, trial)
        width = width or 0.0
        return FinestRun(
            trial,
            gap / 3 + width / 3,
            dict(self.level),
            self.steps,
            dict(self.time),
            dict(self.space),
            {"space difference": width},
        )

    def _orders(self, found: FinestRun) -> dict[str, str]:
        """Axes on which differences do not fall as they should, with what was seen."""
        gap = found.time[found.steps]
        falling = {"time": np.inf, "space": np.inf}
        if gap > SMALL:
            half = found.steps // 2
            if half not in self.time:
                coarse, base = self.run(self.level, half), self.run(self.level, found.steps)
                self.time[half] = self.event.distance(coarse, base)
            falling["time"] = _factor(self.time[half], gap)
            found.time[half] = self.time[half]
        width = found.falling["space difference"]
        if width > SMALL:
            coarse = self.run(self.up(by=-1), 2 * found.steps)
            base = self.run(self.level, 2 * found.steps)
            falling["space"] = _factor(self.event.distance(coarse, base), width)
        sizes = {"time": gap, "space": width}
        bad = {
            axis: f"no order observed in {axis}: the last refinement changed the quantities by"
            f" {size:.2g} tolerances, the one before by {falling[axis]:.2g} times that"
            for axis, size in sizes.items()
            if not (falling[axis] >= FALLING or _rest(size, falling[axis]) <= REST)
        }
        rest = [(_rest(size, falling[axis]), size) for axis, size in sizes.items()]
        found.error = max(found.error, sum(r if np.isfinite(r) else 2 * d for r, d in rest))
        found.falling |= falling
        return bad


def _factor(before: float, last: float) -> float:
    """By how much a difference fell; unknown if the run before failed."""
    return before / last if np.isfinite(before) else np.nan


def _rest(last: float, factor: float) -> float:
    """Sum of all differences after the last one, if each is smaller by this factor, four at most.

    Infinite where they hardly fall, or nothing is known of that.
    """
    return last / (min(factor, 4.0) - 1.0) if factor >= SLOWLY else np.inf
