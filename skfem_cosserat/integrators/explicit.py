"""Explicit variational schemes: elements kick their nodes, which drift as free rigid bodies.

A node has a momentum P and an angular momentum L in space about its point phi, kept together as
``m`` (nodes, 2, 3). Between two kicks both are constant but for the way of phi, unless joints hold
the node: nodes that joints connect form a *cluster*, which drifts as one. A step of the run has
equal *rounds*, at whose ends all elements, loads and force elements kick by halves; within a round
every element kicks at equal distances, as often as its *count* says. ``Explicit`` gives all
elements the count one, ``Asynchronous`` to each one what its own limit needs.

Rows of y are those of the system and a last one of zeros, which stands for the directors that mass
points do not have.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..constraints import Multipliers, Treatment
from ..errors import AccuracyWarning, Diverged, IncompatibleError, InputError
from ..frames import is_beam
from ..kernels import (
    BeamElements,
    beam_dissipation,
    beam_force,
    beam_strain,
    beam_strain_rate,
    beam_stress,
    beam_viscous_stress,
    director_force,
)
from ..model import Model, System, system_of
from ..model.force_elements import CoupledForce
from ..model.ground import KEPT
from ..model.groups import BeamGroup
from ..types import Floats, IndexArray, numbers, positive, real, switch
from ..warn import logger, warn
from .base import Integrator, March, Marched
from .explicit_limit import LimitWatch, StepLimit, check_lumped
from .explicit_nodes import ITERATIONS, Bodies, Cluster, Nodes, Unclosed, checked_nodes
from .scheme import State, StepWork

#: steps above a limit that has fallen by as much are not made shorter: the bound is not that sharp
NEAR = 0.01
#: way of a node in a step, by the extent of the scene, above which a run has blown up
FAR = 100.0
#: change of the momenta, relative to the largest, by velocities that are those after the kick; what
#: does not become less any more is accepted up to the second number
SETTLED = 1e-12, 1e-9


# -- what explicit steps cannot do -----------------------------------------------------------------


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
        if is_beam(item) and item.theory.held:
            refuse(
                f"the {item.theory!r} of {item.label}", "strains are held by implicit steps only"
            )
    for drive in system.drives:
        refuse(drive.label, "motion is not prescribed in explicit steps")
    if system.moving:
        refuse("moving ground", "motion is not prescribed in explicit steps")
    if len(system.closure.rows):
        names = sorted(system.redundancies()) or ["a closed loop of joints"]
        refuse(f"closed loops ({names[0]})", "joints have to form a tree")
    checked_nodes(name, system)


# -- kicks -----------------------------------------------------------------------------------------


@dataclass(eq=False)
class Kick:
    """Elements of a group that kick their nodes at one instant.

    Attributes
    ----------
    elements : BeamElements
    rows : (ne, 4 nn) int array
        Of y.
    share : (ne, 1, 1) array
        Half of the time between two of their kicks, by that of a round.
    v, parts : (k,), (k, 4) int arrays
        Their nodes, and rows of these.
    where : (12 ne nn,) int array
        Where forces on the nodes of elements are added up, (k, 4, 3).
    """

    elements: BeamElements
    rows: IndexArray
    share: Floats
    v: IndexArray
    parts: IndexArray
    where: IndexArray

    @classmethod
    def of(cls, group: BeamGroup, ids: IndexArray, counts: IndexArray, nodes: Nodes) -> Kick:
        """Elements `ids` of a group that kick as often as their counts say in a round."""
        v, local = np.unique(group.vertices[ids], return_inverse=True)
        where = 12 * local.reshape(-1, 1) + np.arange(12)
        share = 0.5 / counts[ids][:, None, None]
        own = group.elements.taken(ids), group.rows[ids], share
        return cls(*own, v, nodes.rows[v], where.ravel())

    def local(self, y: Floats) -> Floats:
        """Rows of y, or of velocities, of each element (ne, 12 nn)."""
        return y.take(self.rows, axis=0).reshape(len(self.rows), -1)

    def add(self, out: Floats, y: Floats, B: Floats, stress: Floats, h: float) -> None:
        """Add the impulses of stresses during half of the time between two kicks to momenta."""
        f = beam_force(self.elements, B, (h * self.share) * stress)
        own = np.bincount(self.where, f.ravel(), 12 * len(self.v)).reshape(-1, 4, 3)
        own[:, 1] = director_force(y[self.parts[:, 1:]], own[:, 1:])
        out[self.v] -= own[:, :2]


class Instant(NamedTuple):
    """What happens at one instant of a round.

    Attributes
    ----------
    free, ways : Bodies, (k,) array
        Nodes without joints that come here, and times since they were moved last, by the round.
    clusters : list of (Cluster, float)
        The same of nodes with joints.
    kicks : list of Kick
    last : bool
        Whether it is the end of the round.
    """

    free: Bodies
    ways: Floats
    clusters: list[tuple[Cluster, float]]
    kicks: list[Kick]
    last: bool


def planned(system: System, nodes: Nodes, counts: list[IndexArray]) -> Iterator[Instant]:
    """All instants of a round; at its end all nodes have come and all elements kick."""
    groups, clock = system.beam_groups, np.zeros(len(nodes.rows))
    known: dict[tuple[int, bytes], Kick] = {}
    each = [np.arange(1, n) / n for n in {int(n) for c in counts for n in c}]
    for now in [*np.unique(np.concatenate([np.zeros(0), *each])), 1.0]:
        kicks = []
        for k, (group, count) in enumerate(zip(groups, counts, strict=True)):
            # fractions are rounded alike wherever they are equal
            ids = np.flatnonzero(np.rint(now * count) / count == now)
            if len(ids):
                key = k, ids.tobytes()
                if key not in known:
                    if len(known) > KEPT:
                        known.clear()
                    known[key] = Kick.of(group, ids, count, nodes)
                kicks.append(known[key])
        touched = [kick.v for kick in kicks] if now < 1 else [np.arange(len(clock))]
        v = np.unique(np.concatenate(touched))
        of = nodes.cluster_of[v]
        clusters = [nodes.clusters[number] for number in np.unique(of[of >= 0])]
        free = v[of < 0]
        spans = [(c, float(now - clock[c.bodies.number[0]])) for c in clusters]
        yield Instant(nodes.bodies.taken(free), now - clock[free], spans, kicks, bool(now == 1))
        for moved in (free, *(c.bodies.number for c in clusters)):
            clock[moved] = now


class Outer:
    """Loads, force elements and drag of a round, all but constant numbers in time by their means.

    Parameters
    ----------
    system : System
    y : array
        At the start.
    turns : (k,) int array or None
        Of angles there.
    t0, h : float
        Start and length (s).
    """

    def __init__(
        self, system: System, y: Floats, turns: IndexArray | None, t0: float, h: float
    ) -> None:
        self._system, couplings = system, system.couplings
        self._amplitudes = system.loading.averages(t0, t0 + h)
        self._dead = system.loading.dead_force(self._amplitudes)
        self.start = couplings.begin(y[:-1], turns, t0, h) if couplings.count else None

    def at(self, y: Floats, rates: Floats) -> Ends:
        """Forces at a configuration of all rows, and their rates."""
        system, loading = self._system, self._system.loading
        loads = self._dead
        if not loading.dead_only:
            loads = loads + loading.force(y[: system.rows], self._amplitudes)
        force, power, coupled = loads, 0.0, None
        if self.start is not None:
            coupled = system.couplings.static(self.start, y[:-1], rates[:-1])
            force = force - coupled.force[: system.rows]
            power = sum(float(r.dissipated.sum()) for r in coupled.responses)
        if system.drag is not None:
            v = rates[: system.rows]
            drag = system.drag @ v
            force = force - drag
            power += max(0.0, float((v * drag).sum()))  # of either sign at rounding level
        return Ends(loads, force, power, coupled)


class Ends(NamedTuple):
    """Forces (rows, 3) at an end of a round: loads, all; power that is lost; force elements."""

    loads: Floats
    force: Floats
    power: float
    coupled: CoupledForce | None


class Half(NamedTuple):
    """Half of the kicks of an instant.

    Attributes
    ----------
    impulse : (nv, 2, 3) array
        Of elements.
    lost : float
        In viscous sections (J).
    ends : Ends or None
        At the end of a round.
    whole : (nv, 2, 3) array
        The impulse of everything.
    """

    impulse: Floats
    lost: float
    ends: Ends | None
    whole: Floats


# -- march -----------------------------------------------------------------------------------------


class Marching(March):
    """Marches a system; each element with steps of its own.

    Forces that depend on velocities take that between both halves of a kick, found by fixed-point
    iteration: the first half ends with it, the second one starts from it, so that a kick, and with
    it a round, is symmetric in time. Joints hold this velocity, too.

    Parameters
    ----------
    scheme : ExplicitScheme
        Says how many rounds and steps there are.
    system : System
    h : float
        Step of the run (s).
    watch : LimitWatch
    method : str

    Attributes
    ----------
    rounds : int
        Equal parts of a step.
    evaluations : int
        Of elements so far.
    shortened : bool
        Whether elements have been given shorter steps since the start.
    """

    def __init__(
        self, scheme: ExplicitScheme, system: System, h: float, watch: LimitWatch, method: str
    ) -> None:
        self.system, self.h, self.method = system, h, method
        self._scheme, self._watch, self.nodes = scheme, watch, Nodes(system)
        self.evaluations, self.shortened = 0, False
        couplings = system.couplings
        viscous = system.drag is not None or any(c.damping.any() for c in couplings.items)
        viscous = viscous or bool(couplings.functions)
        self._viscous = viscous or any(g.viscous for g in system.beam_groups)
        self._loaded = bool(system.loading.times or couplings.count) or (system.drag is not None)
        self._last: tuple[State, Half] | None = None
        self._plan(*scheme.plan(system, h, watch))

    def _plan(self, rounds: int, counts: list[IndexArray]) -> None:
        self.rounds, self._counts = rounds, counts
        most = sum({int(n) for each in counts for n in each})
        self._kept = [*self._instants()] if most <= KEPT else None
        pairs = [(g, n) for g, n in zip(self.system.beam_groups, counts, strict=True) if len(n)]
        self._ends = [Kick.of(g, np.arange(len(n)), n, self.nodes) for g, n in pairs]
        # changes shrink by -theta at most where theta is h gamma/2, by theta/(2 + theta) if relaxed
        theta = 0.5 * self.h / rounds * self._watch.decay(counts)
        self._relaxed = 1 / (1 + 0.5 * theta)

    def _instants(self) -> Iterator[Instant]:
        return planned(self.system, self.nodes, self._counts)

    @property
    def counts(self) -> list[IndexArray]:
        """Steps (ne,) of the elements of each beam group in a step of the run."""
        return [self.rounds * each for each in self._counts]

    def _replan(self, time: float) -> None:
        """Shorter steps where limits have fallen."""
        rounds, counts = self._scheme.plan(self.system, self.h, self._watch)
        same = zip(counts, self._counts, strict=True)
        if rounds == self.rounds and all((a == b).all() for a, b in same):
            return
        self._plan(rounds, counts)
        self._last = None
        smallest = self._watch.smallest
        attached = smallest.kind in ("springs", "damping")
        what = "springs and dampers have moved" if attached else "elements are bent"
        to = f"{smallest.seconds:.3g} s of {smallest.where}"
        text = f"{what} so far that their limits fall, to {to}: shorter steps"
        if not self.shortened:
            warn(f"integrator {self._scheme.name!r}", text, AccuracyWarning, time)
        logger.debug("t = %.6g s: %s", time, text)
        self.shortened = True

    def advance(self, state: State, time: float) -> Marched:
        """See the base class."""
        system = self.system
        y = np.concatenate([system.extend(state.q, state.time), np.zeros((1, 3))])
        if self._scheme.checked and self._watch.lowered(y[:-1]):
            self._replan(state.time)
        m = self.nodes.momenta(y, state.p.reshape(-1, 3))
        try:
            with np.errstate(all="ignore"):  # what has blown up is looked at below
                new, work, iterations = self._rounds(state, y, m, time)
        except Unclosed as error:
            advice = f"try a smaller step than {self.h:g} s"
            where = state.time, state.index + 1, error.gap
            raise Diverged(*where, error.what, advice) from error
        way = float(abs(y[: system.rows] - state.q.reshape(-1, 3)).max(initial=0.0))
        if not (way < FAR * system.length and np.isfinite(m).all()):
            reason = f"the motion has blown up: nodes move by {way:.3g} m in a step"
            raise Diverged(state.time, state.index + 1, np.inf, reason, self.method)
        gap = max((float(abs(c.gaps(y)).max()) for c in self.nodes.clusters), default=0.0)
        return Marched(new, iterations, gap, work)

    def _rounds(
        self, state: State, y: Floats, m: Floats, time: float
    ) -> tuple[State, StepWork, int]:
        """All rounds of a step, in place."""
        h, turns, rows = self.h / self.rounds, state.turns, self.system.rows
        half = self._half_at(state)
        loads = actuators = lost = 0.0
        iterations = 0
        for k in range(self.rounds):
            t0, y0 = state.time + k * h, y[:rows].copy()
            outer = Outer(self.system, y, turns, t0, h) if self._loaded else None
            first = half = self._first(half, outer, y, m, h)
            m += half.whole
            lost += first.lost
            for instant in self._instants() if self._kept is None else self._kept:
                drifts = self._drift(instant, y, m, h)
                half, kicks = self._half(instant, y, m, h, outer if instant.last else None)
                lost, iterations = lost + half.lost, max(iterations, drifts, kicks)
                if not instant.last:
                    m += half.whole
                    lost += half.lost
            if outer is not None:
                assert first.ends is not None
                assert half.ends is not None
                both = first.ends.loads + half.ends.loads
                loads += 0.5 * float((both * (y[:rows] - y0)).sum())
                lost += 0.5 * h * (first.ends.power + half.ends.power)
                if outer.start is not None and half.ends.coupled is not None:
                    couplings = self.system.couplings
                    actuators += couplings.work(outer.start, half.ends.coupled, y[:-1]).actuators
                    turns = couplings.turns(outer.start, y[:-1], t0 + h)
                    assert first.ends.coupled is not None
                    change = y[:-1].copy()
                    change[:rows] -= y0
                    change[rows:] = 0.0
                    pushed = first.ends.coupled, half.ends.coupled
                    loads += 0.5 * sum(coupled.work_of_loads(change) for coupled in pushed)
        self.nodes.tidy(y)
        for cluster in self.nodes.clusters:
            cluster.projection(y)(m)
        p = self.system.mass @ self.nodes.velocities(y)(m)[:rows]
        q = y[:rows].flatten()
        new = State(time, state.index + 1, q, p.reshape(-1), fresh=False, turns=turns)
        assert half is not None
        self._last = new, half
        return new, StepWork(loads, actuators, lost), iterations

    def _half_at(self, state: State) -> Half | None:
        """Half of the kicks that the last step found at its end; None if this is another state."""
        if self._last is None:
            return None
        end, half = self._last
        before, now = (0 if each.turns is None else each.turns for each in (end, state))
        same = end.time == state.time and np.array_equal(before, now)
        return half if same and (end.q == state.q).all() and (end.p == state.p).all() else None

    def _first(
        self, last: Half | None, outer: Outer | None, y: Floats, m: Floats, h: float
    ) -> Half:
        """The first half of the kicks of a round; elements kick as in the `last`."""
        if last is None:
            return self._impulses(self._ends, y, m, h, outer)(m)
        if outer is None:
            return last
        ends = outer.at(y, self._velocities(y)(m))
        whole = last.impulse + 0.5 * h * self.nodes.momenta(y, ends.force)
        return Half(last.impulse, last.lost, ends, whole)

    def _impulses(
        self, kicks: list[Kick], y: Floats, m: Floats, h: float, outer: Outer | None
    ) -> Callable[[Floats], Half]:
        """Half of some kicks by the momenta that give the velocity."""
        elastic, strained = np.zeros_like(m), []
        for kick in kicks:
            self.evaluations += len(kick.rows)
            eps, B = beam_strain(kick.elements, kick.local(y))
            kick.add(elastic, y, B, beam_stress(kick.elements, eps), h)
            if kick.elements.viscosity is not None:
                strained.append((kick, B))

        velocities = self._velocities(y)

        def half(at: Floats) -> Half:
            impulse, lost, ends = elastic, 0.0, None
            rates = velocities(at)
            for kick, B in strained:
                rate = beam_strain_rate(B, kick.local(rates))
                impulse = impulse.copy()
                kick.add(impulse, y, B, beam_viscous_stress(kick.elements, rate), h)
                power = beam_dissipation(kick.elements, rate)
                lost += h * float((kick.share[:, 0, 0] * power).sum())
            whole = impulse
            if outer is not None:
                ends = outer.at(y, rates)
                whole = impulse + 0.5 * h * self.nodes.momenta(y, ends.force)
            return Half(impulse, lost, ends, whole)

        return half

    def _velocities(self, y: Floats) -> Callable[[Floats], Floats]:
        """Velocities of momenta; zero where nothing asks for them."""
        none = np.zeros_like(y)
        return self.nodes.velocities(y) if self._viscous else lambda _: none

    def _half(
        self, instant: Instant, y: Floats, m: Floats, h: float, outer: Outer | None
    ) -> tuple[Half, int]:
        """Kick by one half, in place, such that the velocity is that after it."""
        impulses = self._impulses(instant.kicks, y, m, h, outer)
        half = impulses(m)
        if not self._viscous:
            m += half.whole
            return half, 0
        projections = [cluster.projection(y) for cluster, _ in instant.clusters]
        after, last = m + half.whole, np.inf
        for k in range(1, ITERATIONS + 1):
            for project in projections:
                project(after)
            half = impulses(after)
            change = m + half.whole - after
            for project in projections:
                project(change)
            size = np.maximum(abs(after).max((0, 2), initial=0.0), 1e-300)
            left = float((abs(change).max((0, 2), initial=0.0) / size).max())
            if left <= SETTLED[0] or 0.5 * last < left <= SETTLED[1]:
                m[:] = after + change
                return half, k
            after, last = after + self._relaxed * change, left
        raise Unclosed("the velocity that dampers leave after a kick was not found", last)

    @staticmethod
    def _drift(instant: Instant, y: Floats, m: Floats, h: float) -> int:
        """Bring nodes, with all that joints connect to them, to an instant; gives iterations."""
        found = [cluster.drift(y, m, h * way) for cluster, way in instant.clusters]
        if len(instant.ways):
            instant.free.drift(y, m, h * instant.ways)
        return max(found, default=0)


# -- schemes ---------------------------------------------------------------------------------------


class ExplicitScheme(Integrator):
    """What the explicit schemes have in common: no balance, no tangent, p = M v."""

    order = 2
    fixed_step = (
        "symplectic for steps of one size only (with steps that follow the motion its energy"
        " drifts), and bound to the limit of its elements"
    )
    solves = False
    constraint_weight = 0.0
    carries_node_momentum = True
    remembered = 0
    advice = "a step below the limit"
    conserves = "symplectic form, momentum maps; energy oscillates within a bound"
    checked: bool

    @staticmethod
    def limit(system: Model | System) -> StepLimit:
        """Step (s) up to which all elements and springs are stable, and what sets it.

        ``min(2/omega, 2/gamma)`` about the reference. omega is not below any frequency of the
        scene: its square is that of the highest one of an element on its own share of the mass,
        and a bound of the springs on its nodes (Gershgorin's). gamma bounds the rates at which
        viscous sections, dampers and drag take velocities alike. Stresses and forces of springs
        are left out, cables count as taut.

        Raises
        ------
        InputError
            If it is neither a model nor a system.
        IncompatibleError
            If the mass of a beam is not lumped.
        """
        return LimitWatch(system_of(system)).smallest

    @abstractmethod
    def plan(self, system: System, h: float, watch: LimitWatch) -> tuple[int, list[IndexArray]]:
        """Rounds of a step (s), and counts of the elements of each beam group in a round."""


class Explicit(ExplicitScheme):
    """Explicit, symplectic, of second order: for soft or finely meshed beams.

    Beams have their mass at the nodes (``Beam(..., lumped=True)``). A step is half a kick by the
    elastic forces, force elements and loads (their mean over the step), the drift of every node as
    a free rigid body, and half a kick. Nodes and bodies that joints connect drift together, with
    impulses along the constraints at the start such that these hold at the end; velocities are
    projected at the end of the step. Triads stay orthonormal, momentum maps and joints exact, to
    rounding. Viscous forces kick along: with the velocity between two half kicks, of second order.

    The step is limited by the highest frequency of elements and springs, and by damping;
    ``Explicit.limit(system)`` says where and what vibrates there. At each step of the run it is
    looked at again, and there are more rounds if it has fallen, with a warning.

    Parameters
    ----------
    rounds : int
        A step of the run consists of as many equal steps, at whose end nothing is recorded.
    checked : bool
        Refuse steps above the limit, and shorten them where it falls; False: to see what happens
        there.

    Raises
    ------
    InputError
        If `rounds` is not a positive integer; for a step above the limit, before the run.
    IncompatibleError
        Before the run, for what the scheme cannot do: beams with consistent mass or held strains,
        drives, prescribed motion, closed loops of joints, scenes in a plane, treatments other than
        ``Multipliers()``, also unscaled ones, nodes without inertia about some axis, solvers of
        linear systems, of which there are none.

    Notes
    -----
    It is :class:`Asynchronous` with one step for all elements. There are no compiled kernels.
    Constraint forces are those of the continuous equations at the recorded states. Kick and drift:
    Verlet's method; joints: Leimkuhler & Reich, Simulating Hamiltonian dynamics (2004), ch. 7, 8.

    Examples
    --------
    >>> from skfem_cosserat import (
    ...     Beam, LoadGravity, Material, MeshCurve, Model, Multipliers, SectionCircle, simulate
    ... )
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 8, name="rod")
    >>> rubber = SectionCircle(0.02, Material(5e6, 0.5, 1100))
    >>> model = Model()
    >>> rod = model.add("rod", Beam(mesh, rubber, lumped=True, angular_velocity=(1.0, 0, 0)))
    >>> system = model.freeze()
    >>> print(Explicit.limit(system))
    0.000535 s (element 0 of beam 'rod': shear with rotary inertia)
    >>> history = simulate(system, Explicit(rounds=50), Multipliers(), step=0.02, until=0.1)
    >>> bool(abs(history["angular_momentum"] - history["angular_momentum"][0]).max() < 1e-15)
    True
    """

    name = "explicit"
    reference = "Verlet, Phys. Rev. 159 (1967) 98; Leimkuhler & Reich (2004)"

    def __init__(self, rounds: int = 1, checked: bool = True) -> None:
        whole = isinstance(rounds, int | np.integer) and not isinstance(rounds, bool)
        if not whole or rounds < 1:
            raise InputError("argument rounds", f"{rounds!r}, expected a positive integer")
        self.rounds, self.checked = int(rounds), switch("argument checked", checked)

    def __repr__(self) -> str:
        return f"Explicit(rounds={self.rounds}{'' if self.checked else ', checked=False'})"

    def plan(self, system: System, h: float, watch: LimitWatch) -> tuple[int, list[IndexArray]]:
        """See the base class."""
        least = np.ceil(h / watch.smallest.seconds * (1 - NEAR)) if self.checked else 1
        ones = [np.ones(len(g.vertices), dtype=np.int64) for g in system.beam_groups]
        return max(self.rounds, int(least)), ones

    def march(self, system: System, treatment: Treatment, h: float) -> Marching:
        """See the base class."""
        check_scene(repr(self), system, treatment)
        watch = LimitWatch(system)
        limit = watch.smallest
        if self.checked and h / self.rounds > limit.seconds:
            least = int(np.ceil(h / limit.seconds))
            raise InputError(
                "argument step",
                f"{h:g} s in {self.rounds} rounds is above the limit of the explicit scheme,"
                f" {limit}: at least rounds={least}, or a smaller step",
            )
        logger.info("explicit steps of %.3g s, limit %s", h / self.rounds, limit)
        return Marching(self, system, h, watch, f"explicit, limit {limit}")


class Asynchronous(ExplicitScheme):
    """The explicit scheme with a step of its own for every element.

    Elements that are due at one instant kick their nodes together; in between, every node drifts as
    a free rigid body from one kick of its elements to the next. Elements take the fewest equal
    parts of the run's step that are below `safety` times their own limit, so that all meet at its
    end, where loads and force elements kick and states are recorded. Momentum maps are exact;
    energy stays within a bound, short of resonances: where the fast vibrations next to a slow
    element meet its rhythm, it feeds them. Steps that change little by little prevent that. The
    limits of elements are looked at again as these bend, and steps are made shorter where they have
    fallen, with a warning: the energy may change a little there.

    Of second order if `safety` gets smaller with the step: all elements then keep their numbers of
    steps. With the same `safety` only the longest steps get shorter, those of the fast elements
    stay, and so does what they leave of the error.

    Parameters
    ----------
    safety : float
        Largest step of an element by its limit, in (0, 1].
    grading : float
        Largest ratio of the steps of two elements that share a node; infinite: any.
    checked : bool
        False: `safety` may be above one, to see what happens there.

    Raises
    ------
    InputError
        If `safety` or `grading` is not in its range.
    IncompatibleError
        As :class:`Explicit`, before the run.

    Notes
    -----
    Loads, springs, dampers and drag kick at the ends of the run's steps only: choose these
    accordingly. Where springs and dampers need shorter ones, a step consists of equal rounds, at
    whose ends they kick.

    Examples
    --------
    A rod of which a quarter is meshed eight times as finely:

    >>> from skfem_cosserat import Beam, Material, MeshCurve, Model, SectionCircle
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0.75, 0, 0), 3, name="coarse")
    >>> mesh = mesh + MeshCurve.init_line((0.75, 0, 0), (1, 0, 0), 8, name="fine")
    >>> section = SectionCircle(0.2, Material(5e6, 0.5, 1100))
    >>> model = Model()
    >>> rod = model.add("rod", Beam(mesh, section, director=(0, 1, 0), lumped=True))
    >>> Asynchronous(safety=1.0).counts(model.freeze(), 3.7e-3)[0].tolist()
    [1, 2, 4, 8, 8, 8, 8, 8, 8, 8, 8]
    """

    name = "asynchronous"
    reference = "Lew, Marsden, Ortiz & West, Arch. Ration. Mech. Anal. 167 (2003) 85"

    def __init__(self, safety: float = 0.9, grading: float = 2.0, checked: bool = True) -> None:
        self.checked = switch("argument checked", checked)
        expected = "a number in (0, 1]" if checked else "a positive finite number"
        self.safety = real("argument safety", "safety", safety, expected)
        if not 0 < self.safety <= (1 if checked else np.finfo(float).max):
            raise InputError("argument safety", f"{safety!r}, expected {expected}")
        expected = "a number of one or more"
        self.grading = real("argument grading", "grading", grading, expected)
        if not self.grading >= 1:
            raise InputError("argument grading", f"{grading!r}, expected {expected}")

    def __repr__(self) -> str:
        more = "" if self.checked else ", checked=False"
        return f"Asynchronous(safety={self.safety:g}, grading={self.grading:g}{more})"

    @staticmethod
    def limits(system: Model | System) -> list[Floats]:
        """Largest stable step (ne,) in s of the elements of each beam group.

        With springs and dampers on their nodes, see :meth:`limit`.

        Raises
        ------
        InputError
            If it is neither a model nor a system.
        IncompatibleError
            If the mass of a beam is not lumped.
        """
        return LimitWatch(system_of(system)).limits

    def counts(
        self, system: Model | System, step: float, limits: list[Floats] | None = None
    ) -> list[IndexArray]:
        """Steps (ne,) of the elements of each beam group in a step (s) of the run.

        Parameters
        ----------
        limits : list of arrays, optional
            Default: :meth:`limits`.

        Raises
        ------
        InputError
            For other arguments.
        IncompatibleError
            If the mass of a beam is not lumped.
        """
        system = system_of(system)
        step = positive("argument step", "step", step, " of seconds")
        chosen = self.limits(system) if limits is None else _checked(system, limits)
        counts = [
            np.maximum(1, np.ceil(step / (self.safety * each) * (1 - 1e-12))).astype(np.int64)
            for each in chosen
        ]
        while True:
            most = np.zeros(len(system.origin_rows), dtype=np.int64)
            for group, own in zip(system.beam_groups, counts, strict=True):
                np.maximum.at(most, group.vertices, own[:, None])
            pairs = zip(system.beam_groups, counts, strict=True)
            graded = [
                np.maximum(own, np.ceil(most[g.vertices].max(1) / self.grading).astype(np.int64))
                for g, own in pairs
            ]
            if all((a == b).all() for a, b in zip(graded, counts, strict=True)):
                return counts
            counts = graded

    def plan(self, system: System, h: float, watch: LimitWatch) -> tuple[int, list[IndexArray]]:
        """See the base class."""
        rounds = max(1, int(np.ceil(h / (self.safety * watch.ends) * (1 - 1e-9))))
        return rounds, self.counts(system, h / rounds, watch.limits)

    def march(self, system: System, treatment: Treatment, h: float) -> Marching:
        """See the base class."""
        check_scene(repr(self), system, treatment)
        watch = LimitWatch(system)
        rounds, counts = self.plan(system, h, watch)
        every = rounds * np.concatenate([*counts, np.ones(1, dtype=np.int64)])
        low, high = int(every[:-1].min(initial=every[-1])), int(every.max())
        limit = watch.smallest
        logger.info("steps of elements: %d to %d a step, smallest limit %s", low, high, limit)
        method = f"explicit, {low} to {high} steps of each element, smallest limit {limit}"
        return Marching(self, system, h, watch, method)


def _checked(system: System, limits: object) -> list[Floats]:
    """Limits of the elements of each beam group, as given."""
    check_lumped("steps of the elements", system)
    sizes = [len(group.vertices) for group in system.beam_groups]
    expected = f"expected positive numbers (s) of {sizes} elements, as limits(system) gives them"
    if not isinstance(limits, Sequence) or len(limits) != len(sizes):
        raise InputError("argument limits", f"{limits!r}, {expected}")
    out = [numbers("argument limits", "limits", each) for each in limits]
    if any(each.shape != (n,) or not (each > 0).all() for each, n in zip(out, sizes, strict=True)):
        raise InputError("argument limits", f"{limits!r}, {expected}")
    return out
