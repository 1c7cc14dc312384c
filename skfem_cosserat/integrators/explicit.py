"""The explicit variational scheme: elements kick their nodes, which drift as free rigid bodies.

A node has a momentum P and an angular momentum L in space about its point phi, kept together as
``m`` (nodes, 2, 3). Between two kicks both are constant but for the way of phi, unless joints hold
the node: nodes that joints connect form a *cluster*, which drifts as one. A step of the run has
equal *rounds*, at whose ends all elements, loads and force elements kick by halves.

Rows of y are those of the system and a last one of zeros, which stands for the directors that mass
points do not have.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..constraints import Multipliers, Treatment
from ..errors import AccuracyWarning, Diverged, IncompatibleError, InputError
from ..frames import is_beam
from ..model import Model, System, system_of
from ..model.force_elements import CoupledForce
from ..types import Floats, IndexArray, switch, whole
from ..warn import logger, warn
from .base import Integrator, March, Marched
from .explicit_limit import LimitWatch, StepLimit, check_lumped
from .explicit_nodes import ITERATIONS, Nodes, Unclosed, checked_nodes
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
    """Half of the kicks at one end of a round.

    Attributes
    ----------
    impulse : (nv, 2, 3) array
        Of elements.
    lost : float
        In viscous sections (J).
    ends : Ends or None
        Of loads and force elements, if there are any.
    whole : (nv, 2, 3) array
        The impulse of everything.
    """

    impulse: Floats
    lost: float
    ends: Ends | None
    whole: Floats


# -- march -----------------------------------------------------------------------------------------


class Marching(March):
    """Marches a system.

    Forces that depend on velocities take that between both halves of a kick, found by fixed-point
    iteration: the first half ends with it, the second one starts from it, so that a kick, and with
    it a round, is symmetric in time. Joints hold this velocity, too.

    Parameters
    ----------
    scheme : Explicit
        Says how many rounds there are.
    system : System
    h : float
        Step of the run (s).
    watch : LimitWatch
    method : str

    Attributes
    ----------
    rounds : int
        Equal parts of a step.
    shortened : bool
        Whether there have been more of them since the start.
    """

    def __init__(
        self, scheme: Explicit, system: System, h: float, watch: LimitWatch, method: str
    ) -> None:
        self.system, self.h, self.method = system, h, method
        self._scheme, self._watch, self.nodes = scheme, watch, Nodes(system)
        self.shortened = False
        couplings = system.couplings
        viscous = system.drag is not None or any(c.damping.any() for c in couplings.items)
        viscous = viscous or bool(couplings.functions)
        self._viscous = viscous or any(g.viscous for g in system.beam_groups)
        self._loaded = bool(system.loading.times or couplings.count) or (system.drag is not None)
        self._last: tuple[State, Half] | None = None
        self._free = self.nodes.bodies.taken(np.flatnonzero(self.nodes.cluster_of < 0))
        self.rounds = 0
        self._divide()

    def _divide(self) -> bool:
        """Take as many rounds as the limits ask for; whether there are others than before."""
        rounds = self._scheme.rounds
        if self._scheme.checked:
            limit = self._watch.smallest.seconds
            rounds = max(rounds, int(np.ceil(self.h / limit * (1 - NEAR))))
        if rounds == self.rounds:
            return False
        self.rounds = rounds
        # changes shrink by -theta at most where theta is h gamma/2, by theta/(2 + theta) if relaxed
        theta = 0.5 * self.h / rounds * self._watch.decay
        self._relaxed = 1 / (1 + 0.5 * theta)
        return True

    def _shorten(self, time: float) -> None:
        """Shorter steps where limits have fallen."""
        if not self._divide():
            return
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
            self._shorten(state.time)
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
            drifts = self._drift(y, m, h)
            half, kicks = self._half(y, m, h, outer)
            lost, iterations = lost + half.lost, max(iterations, drifts, kicks)
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
            return self._impulses(y, m, h, outer)(m)
        if outer is None:
            return last
        ends = outer.at(y, self._velocities(y)(m))
        whole = last.impulse + 0.5 * h * self.nodes.momenta(y, ends.force)
        return Half(last.impulse, last.lost, ends, whole)

    def _impulses(
        self, y: Floats, m: Floats, h: float, outer: Outer | None
    ) -> Callable[[Floats], Half]:
        """Half of the kicks by the momenta that give the velocity."""
        system = self.system
        strains = [(group, *group.strain(y)) for group in system.beam_groups]
        Bs = [B for *_, B in strains]

        def kick(stresses: list[Floats]) -> Floats:
            """Impulses of stresses during half of a round."""
            force = system.internal_force(Bs, [0.5 * h * stress for stress in stresses])
            return self.nodes.momenta(y, force)

        elastic = -kick([group.stress(eps) for group, eps, _ in strains])
        velocities = self._velocities(y)

        def half(at: Floats) -> Half:
            impulse, lost, ends = elastic, 0.0, None
            rates = velocities(at)
            slowed = [np.zeros_like(eps) for _, eps, _ in strains]
            for k, (group, _, B) in enumerate(strains):
                if group.viscous:
                    rate = group.strain_rate(B, rates)
                    slowed[k] = group.viscous_stress(rate)
                    lost += 0.5 * h * group.dissipation(rate)
            if any(group.viscous for group, *_ in strains):
                impulse = elastic - kick(slowed)
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

    def _half(self, y: Floats, m: Floats, h: float, outer: Outer | None) -> tuple[Half, int]:
        """Kick by one half, in place, such that the velocity is that after it."""
        impulses = self._impulses(y, m, h, outer)
        half = impulses(m)
        if not self._viscous:
            m += half.whole
            return half, 0
        projections = [cluster.projection(y) for cluster in self.nodes.clusters]
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

    def _drift(self, y: Floats, m: Floats, h: float) -> int:
        """Bring all nodes to the end of a round; gives iterations."""
        found = [cluster.drift(y, m, h) for cluster in self.nodes.clusters]
        self._free.drift(y, m, h)
        return max(found, default=0)


# -- scheme ----------------------------------------------------------------------------------------


class Explicit(Integrator):
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
    There are no compiled kernels. Constraint forces are those of the continuous equations at the
    recorded states. Kick and drift: Verlet's method; joints: Leimkuhler & Reich, Simulating
    Hamiltonian dynamics (2004), ch. 7, 8.

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

    def __init__(self, rounds: int = 1, checked: bool = True) -> None:
        self.rounds = whole("argument rounds", rounds, 1)
        self.checked = switch("argument checked", checked)

    def __repr__(self) -> str:
        return f"Explicit(rounds={self.rounds}{'' if self.checked else ', checked=False'})"

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
