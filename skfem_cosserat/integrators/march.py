"""The loop of the explicit schemes: kicks of elements and loads, drifts of nodes in between."""

from __future__ import annotations

import heapq
import logging
from collections.abc import Callable
from typing import Any

import numpy as np

from ..constraints import Multipliers, Treatment
from ..errors import Diverged, IncompatibleError
from ..kernels import BeamElements, beam_force, beam_strain, beam_stress, cross
from ..kinds import is_beam
from ..log import logger
from ..model import System
from ..types import Floats, IndexArray
from .base import March, Marched, State, StepWork
from .choice import STEPS, choose
from .limit import LimitWatch, check_lumped
from .nodal import Nodes, Unclosed

__all__ = ["Marching", "check_scene"]

Plan = Callable[[list[Floats]], list[IndexArray]]

#: way of a node in a step, by the extent of the scene, above which a run has blown up
FAR = 100.0

#: time (s) of an evaluation with the plain kernels: of a call, and of each node of an element
SECONDS = 3e-4, 3e-6


def check_scene(name: str, system: System, treatment: Treatment) -> None:
    """Raise IncompatibleError if there is something that the explicit schemes cannot do."""
    if not isinstance(treatment, Multipliers):
        reason = "its joints keep multipliers of their own, nothing else is eliminated"
        raise IncompatibleError(f"{name} with {treatment!r}", f"take Multipliers(): {reason}")
    if not treatment.scaled:
        reason = "its joints are closed by projection, there is no matrix to scale"
        raise IncompatibleError(f"{name} with {treatment!r}", f"take Multipliers(): {reason}")

    def refuse(what: str, reason: str) -> None:
        raise IncompatibleError(f"{name} with {what}", reason)

    if system.plane is not None:
        refuse(f"{system.plane!r}", "explicit steps move all nodes in space: freeze it without")
    check_lumped(name, system)
    for item in system.structures:
        if is_beam(item) and item.rung.held:
            refuse(f"the {item.rung!r} of {item.label}", "strains are held by implicit steps only")
    for coupling in system.couplings.items:
        refuse(coupling.label, "springs, dampers and actuators are not kicks of elements")
    for drive in system.drives:
        refuse(drive.label, "motion is not prescribed in explicit steps")
    if system.damped:
        refuse("damping", "viscous forces are not kicks: sections and items without damping")
    if system.moving:
        refuse("moving ground", "motion is not prescribed in explicit steps")
    if len(system.closure.rows):
        names = sorted(system.redundancies()) or ["a closed loop of joints"]
        refuse(f"closed loops ({names[0]})", "joints have to form a tree")
    slim = np.flatnonzero(Nodes(system).slimness < 1e-12)
    if len(slim):
        owner = system.owner[int(slim[0])].label
        refuse(owner, "drifts need inertia about all axes")


class Marching(March):
    """Marches a system; each element with steps of its own.

    Parameters
    ----------
    name : str
        Of the integrator.
    system : System
    h : float
        Step of the run (s).
    rounds : int
        Equal parts of it, at whose ends all elements and loads kick.
    counts : list of int arrays
        Steps of each element of each beam group in such a part.
    method : str
    kernels : str
    steps : int or None
        Intended number of steps.
    plan : callable, optional
        Counts for limits of the elements that have fallen as these bend; without it counts stay.
    """

    def __init__(
        self,
        name: str,
        system: System,
        h: float,
        rounds: int,
        counts: list[IndexArray],
        method: str,
        kernels: str,
        steps: int | None,
        plan: Plan | None = None,
    ) -> None:
        self.plan = plan
        self._watch = None if plan is None else LimitWatch(system)
        self.system, self.h, self.rounds, self.counts = system, h, rounds, counts
        self.nodes = Nodes(system)
        self.method = method
        #: evaluations of elements so far
        self.evaluations = 0
        #: whether elements have been given shorter steps since the start
        self.shortened = False
        self._name = name
        each = rounds * sum(
            float(c.max(initial=1)) * SECONDS[0] + SECONDS[1] * float(c.sum()) * g.vertices.shape[1]
            for c, g in zip(counts, system.beam_groups, strict=True)
        )
        seconds = each * (STEPS if steps is None else steps)
        chosen = choose(kernels, system, _not_compiled(system), seconds)
        self.kernels = chosen.name, chosen.why
        self._impulses: tuple[Floats, Floats, Floats] | None = None
        self._some: dict[tuple[int, bytes], BeamElements] = {}
        self._compiled: Callable[..., Any] | None = None
        if chosen.name == "numba":
            self._compile()

    def _compile(self) -> None:
        from ..compiled.explicit import bound  # compiles

        self._compiled = bound(self.system, self.nodes, self.counts[0])

    def _replan(self, time: float) -> None:
        """Shorter steps for the elements whose limits have fallen."""
        assert self.plan is not None
        assert self._watch is not None
        counts = self.plan(self._watch.limits)
        both = list(zip(counts, self.counts, strict=True))
        if all((new <= old).all() for new, old in both):
            return
        self.counts = [np.maximum(new, old) for new, old in both]
        self._impulses = None
        text = "t = %.6g s: elements are bent so far that their limits fall, to %s: shorter steps"
        level = logging.DEBUG if self.shortened else logging.WARNING
        logger.log(level, text, time, self._watch.smallest)
        self.shortened = True
        if self._compiled is not None:
            self._compile()

    def advance(self, state: State, time: float) -> Marched:
        """See the base class."""
        system = self.system
        y = system.extend(state.q, state.time).copy()
        if self._watch is not None and self._watch.lowered(y):
            self._replan(state.time)
        P, L = self.nodes.momenta(y, state.p.reshape(-1, 3))
        if self._impulses is None or not np.array_equal(self._impulses[0], y):
            K = self._kicks(y)
        else:
            K = self._impulses[1:]
        h = self.h / self.rounds
        starts: Floats = state.time + h * np.arange(self.rounds, dtype=float)
        try:
            march = self._plain if self._compiled is None else self._fast
            K, work, iterations = march(y, P, L, K, starts, h)
        except Unclosed as error:
            advice = f"try a smaller step than {self.h:g} s"
            reason = "a joint could not be closed"
            raise Diverged(state.time, state.index + 1, error.gap, reason, advice) from error
        self.nodes.tidy(y)
        self.nodes.project(y, P, L)
        way = float(abs(y[: system.rows] - state.q.reshape(-1, 3)).max(initial=0.0))
        if not (way < FAR * system.length and np.isfinite(P).all() and np.isfinite(L).all()):
            reason = f"the motion has blown up: nodes move by {way:.3g} m in a step"
            raise Diverged(state.time, state.index + 1, np.inf, reason, self.method)
        self._impulses = (y, *K)
        p = self.nodes.director_momenta(y, P, L)
        new = State(time, state.index + 1, y[: system.rows].flatten(), p.reshape(-1), fresh=False)
        return Marched(new, iterations, self._gap(y), StepWork(work))

    def _gap(self, y: Floats) -> float:
        """Largest gap of the joints, relative to the size of their terms."""
        gaps = [abs(c.values(y) / c.size).max(initial=0.0) for c in self.nodes.clusters]
        return float(max(gaps, default=0.0))

    # -- plain loop ------------------------------------------------------------------------------

    def _plain(
        self, y: Floats, P: Floats, L: Floats, K: tuple[Floats, Floats], starts: Floats, h: float
    ) -> tuple[tuple[Floats, Floats], float, int]:
        loading, work, iterations = self.system.loading, 0.0, 0
        for t0 in starts:
            amplitudes = loading.averages(t0, t0 + h)
            dead = loading.dead_force(amplitudes)
            force = dead if loading.dead_only else dead + loading.force(y, amplitudes)
            before = y[: self.system.rows].copy()
            self._apply(y, P, L, K, force, h)
            iterations = max(iterations, self._between(y, P, L, h))
            K = self._kicks(y)
            end = dead if loading.dead_only else dead + loading.force(y, amplitudes)
            self._apply(y, P, L, K, end, h)
            work += 0.5 * float(((force + end) * (y[: self.system.rows] - before)).sum())
        return K, work, iterations

    def _apply(
        self, y: Floats, P: Floats, L: Floats, K: tuple[Floats, Floats], force: Floats, h: float
    ) -> None:
        """Half kicks of all elements, and of the loads (rows, 3)."""
        F, M = self.nodes.momenta(y, force)
        P += K[0] + 0.5 * h * F
        L += K[1] + 0.5 * h * M

    def _kicks(self, y: Floats) -> tuple[Floats, Floats]:
        """Impulses and moments (nv, 3) of half a kick of all elements."""
        P, L = np.zeros((2, len(self.nodes.row), 3))
        h = self.h / self.rounds
        for k, counts in enumerate(self.counts):
            self._kick(k, np.arange(len(counts)), 0.5 * h / counts, y, P, L)
        return P, L

    def _kick(
        self, k: int, ids: IndexArray, times: Floats, y: Floats, P: Floats, L: Floats
    ) -> None:
        """Kick by elements `ids` of a group for times (s), in place."""
        self.evaluations += len(ids)
        group = self.system.beam_groups[k]
        key = k, ids.tobytes()
        if key not in self._some:
            self._some[key] = group.elements.taken(ids)
        elements, rows = self._some[key], group.rows[ids]
        eps, B = beam_strain(elements, y[rows].reshape(len(ids), -1))
        f = beam_force(elements, B, beam_stress(elements, eps))
        impulse = -(times[:, None] * f).reshape(len(ids), -1, 4, 3)
        directors = y[rows].reshape(impulse.shape)[:, :, 1:]
        v = group.vertices[ids]
        np.add.at(P, v, impulse[:, :, 0])
        np.add.at(L, v, cross(directors, impulse[:, :, 1:]).sum(2))

    def _between(self, y: Floats, P: Floats, L: Floats, h: float) -> int:
        """Drift of all nodes over h, and what elements kick on the way; gives iterations."""
        clock, iterations = np.zeros(len(P)), 0
        queue = [
            (1 / n, k, e, 1) for k, c in enumerate(self.counts) for e, n in enumerate(c) if n > 1
        ]
        heapq.heapify(queue)
        while queue:
            now = queue[0][0]
            due: dict[int, list[int]] = {}
            while queue and queue[0][0] == now:
                _, k, e, done = heapq.heappop(queue)
                due.setdefault(k, []).append(e)
                if done + 1 < (n := int(self.counts[k][e])):
                    heapq.heappush(queue, ((done + 1) / n, k, e, done + 1))
            touched = [self.system.beam_groups[k].vertices[e].ravel() for k, e in due.items()]
            v = np.unique(np.concatenate(touched))
            iterations = max(iterations, self._drift(v, now, clock, y, P, L, h))
            for k, numbers in due.items():
                ids = np.array(sorted(numbers))
                self._kick(k, ids, h / self.counts[k][ids], y, P, L)
        return max(iterations, self._drift(np.arange(len(P)), 1.0, clock, y, P, L, h))

    def _drift(
        self,
        v: IndexArray,
        now: float,
        clock: Floats,
        y: Floats,
        P: Floats,
        L: Floats,
        h: float,
    ) -> int:
        """Move nodes, with all that joints connect to them, to a time ``now h`` of the round."""
        of, iterations = self.nodes.cluster_of, 0
        for number in np.unique(of[v[of[v] >= 0]]):
            cluster = self.nodes.clusters[number]
            dt = h * (now - clock[cluster.vertices[0]])
            iterations = max(iterations, self.nodes.drift_joined(y, P, L, cluster, dt))
            clock[cluster.vertices] = now
        free = v[of[v] < 0]
        self.nodes.drift(y, P, L, free, h * (now - clock[free]))
        clock[free] = now
        return iterations

    # -- compiled loop ---------------------------------------------------------------------------

    def _fast(
        self, y: Floats, P: Floats, L: Floats, K: tuple[Floats, Floats], starts: Floats, h: float
    ) -> tuple[tuple[Floats, Floats], float, int]:
        assert self._compiled is not None
        loading = self.system.loading
        if loading.constant:
            dead = loading.dead_force(loading.averages(starts[0], starts[0] + h))[None]
            amplitudes = np.ones((len(starts), 1))
        else:
            means = np.array([loading.averages(t, t + h) for t in starts])
            dead, amplitudes = loading.dead, means[:, loading.dead_channels]
        directors = np.ones(self.system.rows, dtype=bool)
        directors[self.nodes.row] = False
        loads = dead, amplitudes, bool(dead[:, directors].any())
        K = K[0].copy(), K[1].copy()
        evaluations, work, iterations, gap = self._compiled(y, P, L, *K, *loads, h)
        self.evaluations += evaluations
        if gap > 0:
            raise Unclosed(gap)
        return K, work, iterations


def _not_compiled(system: System) -> str | None:
    """Why there are no compiled kernels; None: there are."""
    if len(system.beam_groups) != 1:
        return "there are compiled explicit kernels for beams of one order only"
    elements = system.beam_groups[0].elements
    if not system.loading.dead_only:
        return "there are no compiled explicit kernels for moments and forces that follow"
    if elements.rotations is not None:
        return "there are no compiled explicit kernels for rigid crossings"
    if elements.stored:
        return "there are no compiled explicit kernels for stored energies that are not quadratic"
    return None
