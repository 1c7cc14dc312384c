"""The explicit variational scheme: elements kick their nodes, which drift as free rigid bodies.

A node has a momentum P and an angular momentum L in space about its point phi, kept together as
``m`` (nodes, 2, 3). Between two kicks both are constant but for the way of phi, unless joints hold
the node. A step of the run has equal *rounds*, at whose ends all elements, loads and force elements
kick by halves.

Rows of y are those of the system and a last one of zeros, which stands for the directors that mass
points do not have.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from ..constraints import Multipliers, Treatment
from ..errors import AccuracyWarning, Diverged, IncompatibleError, InputError
from ..frames import is_beam
from ..model import Model, System, system_of
from ..model.balance import Amplitudes, external_force
from ..model.force_elements import CoupledForce, CoupledStart
from ..types import SAME, TOLERANCE, Floats, largest, switch, whole
from ..warn import logger, warn
from .base import Integrator
from .called_back import trapezoidal_work
from .explicit_nodes import (
    ITERATIONS,
    LimitWatch,
    Nodes,
    StepLimit,
    Unclosed,
    check_lumped,
    checked_nodes,
)
from .scheme import State, StepWork

#: steps above a limit that has fallen by as much are not made shorter: the bound is not that sharp
NEAR = 0.01
#: way of a node in a step, by the extent of the scene, above which a run has blown up
FAR = 100.0


# -- what explicit steps cannot do -----------------------------------------------------------------


def _refused(system: System, treatment: Treatment) -> Iterator[tuple[str, str]]:
    """Parts of a scene and of a treatment that explicit schemes cannot do, and why."""
    if not (isinstance(treatment, Multipliers) and treatment.scaled):
        reason = "joints are closed by projection, nothing is eliminated and no matrix scaled"
        yield repr(treatment), f"take Multipliers(): {reason}"
    if system.plane is not None:
        yield repr(system.plane), "explicit steps move all nodes in space: freeze it without"
    for item in system.structures:
        if is_beam(item) and item.theory.held:
            said = f"the {item.theory!r} of {item.label}"
            yield said, "strains are held by implicit steps only"
    moving = [drive.label for drive in system.drives] + ["moving ground"] * bool(system.moving)
    for label in moving:
        yield label, "motion is not prescribed in explicit steps"
    if len(system.closure.rows):
        names = sorted(system.redundancies()) or ["a closed loop of joints"]
        yield f"closed loops ({names[0]})", "joints have to form a tree"


# -- march -----------------------------------------------------------------------------------------


class Ends(NamedTuple):
    """Forces at an end of a round.

    Attributes
    ----------
    elements : ((rows, 3) array, float)
        Their forces, and the power that they lose (W).
    loads, force : (rows, 3) array
        Loads, and the sum of all forces.
    power : float
        That is lost in elements, dampers and drag (W).
    coupled : CoupledForce or None
        Of force elements.
    """

    elements: tuple[Floats, float]
    loads: Floats
    force: Floats
    power: float
    coupled: CoupledForce | None


class Marching:
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

    Attributes
    ----------
    method : str
    rounds : int
        Equal parts of a step.
    shortened : bool
        Whether there have been more of them since the start.
    """

    def __init__(self, scheme: Explicit, system: System, h: float, watch: LimitWatch) -> None:
        self.system, self.h, self.method = system, h, f"explicit, limit {watch.smallest}"
        self._scheme, self._watch, self.nodes = scheme, watch, Nodes(system)
        self.shortened = False
        couplings = system.couplings
        viscous = any(c.damping.any() for c in couplings.items) or bool(couplings.functions)
        self._viscous = viscous or system.damped
        #: q and p of the last state, and forces of elements there
        self._last: tuple[Floats, Floats, tuple[Floats, float]] | None = None
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
        """Say that steps are shorter, where limits have fallen."""
        smallest = self._watch.smallest
        attached = smallest.kind in ("springs", "damping")
        what = "springs and dampers have moved" if attached else "elements are bent"
        to = f"{smallest.seconds:.3g} s of {smallest.where}"
        text = f"{what} so far that their limits fall, to {to}: shorter steps"
        if not self.shortened:
            warn(f"integrator {self._scheme.name!r}", text, AccuracyWarning, time)
        logger.debug("t = %.6g s: %s", time, text)
        self.shortened = True

    def advance(self, state: State, time: float) -> tuple[State, int, float, StepWork]:
        """The step after a state, to a time (s): its end, iterations, residual and work."""
        system = self.system
        y = np.concatenate([system.extend(state.q, state.time), np.zeros((1, 3))])
        if self._scheme.checked and self._watch.lowered(y[:-1]) and self._divide():
            self._shorten(state.time)
        m = self.nodes.momenta(y, state.p.reshape(-1, 3))
        try:
            with np.errstate(all="ignore"):  # what has blown up is looked at below
                new, work, iterations = self._rounds(state, y, m, time)
        except Unclosed as error:
            advice, (what, gap) = f"try a smaller step than {self.h:g} s", error.args
            raise Diverged(state.time, state.index + 1, gap, what, advice) from error
        way = largest(y[: system.rows] - state.q.reshape(-1, 3))
        if not (way < FAR * system.length and np.isfinite(m).all()):
            reason = f"the motion has blown up: nodes move by {way:.3g} m in a step"
            raise Diverged(state.time, state.index + 1, np.inf, reason, self.method)
        joints = self.nodes.joints
        return new, iterations, 0.0 if joints is None else largest(joints.gaps(y)), work

    def _rounds(
        self, state: State, y: Floats, m: Floats, time: float
    ) -> tuple[State, StepWork, int]:
        """All rounds of a step, in place."""
        system, h, turns = self.system, self.h / self.rounds, state.turns
        couplings, rows, iterations, works = system.couplings, system.rows, 0, []
        elements = None
        if self._last is not None and self._last[0] is state.q and self._last[1] is state.p:
            elements = self._last[2]
        for k in range(self.rounds):
            t0, y0 = state.time + k * h, y[:-1].copy()
            loads = Amplitudes(system.loading.averages(t0, t0 + h), np.zeros(0))
            start = couplings.begin(y0, turns, t0, h) if couplings.count else None
            rates = self._velocities(y)(m)
            own = self._elements(y)(rates) if elements is None else elements
            first = self._ends(y, rates, own, loads, start)
            m += 0.5 * h * self.nodes.momenta(y, first.force)
            drifts = self.nodes.drift(y, m, h)
            last, kicks = self._kick(y, m, h, loads, start)
            elements, iterations = last.elements, max(iterations, drifts, kicks)
            moved = float(((first.loads + last.loads) * (y[:rows] - y0[:rows])).sum())
            lost = 0.5 * h * (first.power + last.power)
            works.append(StepWork(0.5 * moved, dissipated=lost))
            if start is not None and first.coupled is not None and last.coupled is not None:
                forces = first.coupled, last.coupled
                works.append(trapezoidal_work(couplings, (start, start), forces, y[:-1], rows))
                turns = couplings.turns(start, y[:-1], t0 + h)
        self.nodes.tidy(y)
        self.nodes.projection(y)(m)
        p = (system.mass @ self.nodes.velocities(y)(m)[:rows]).reshape(-1)
        new = State(time, state.index + 1, y[:rows].flatten(), p, fresh=False, turns=turns)
        assert elements is not None
        self._last = new.q, new.p, elements
        return new, StepWork(*np.sum(works, axis=0).tolist()), iterations

    def _elements(self, y: Floats) -> Callable[[Floats], tuple[Floats, float]]:
        """Forces (rows, 3) of elements by the rates of all rows, and the power that they lose."""
        system = self.system
        strains = [(group, *group.strain(y)) for group in system.beam_groups]
        elastic = [group.stress(eps) for group, eps, _ in strains]

        def at(rates: Floats) -> tuple[Floats, float]:
            stresses, power = list(elastic), 0.0
            for k, (group, _, B) in enumerate(strains):
                if group.viscous:
                    rate = group.strain_rate(B, rates)
                    stresses[k] = elastic[k] + group.viscous_stress(rate)
                    power += group.dissipation(rate)
            return -system.internal_force([B for *_, B in strains], stresses), power

        return at

    def _ends(
        self,
        y: Floats,
        rates: Floats,
        elements: tuple[Floats, float],
        amplitudes: Amplitudes,
        start: CoupledStart | None,
    ) -> Ends:
        """All forces at an end of a round, loads by their means over it."""
        system, (internal, power), coupled = self.system, elements, None
        loads = external_force(system, y[:-1], amplitudes)
        force, v = internal + loads, rates[: system.rows]
        if start is not None:
            coupled = system.couplings.static(start, y[:-1], rates[:-1])
            force = force - coupled.force[: system.rows]
            power += sum(float(r.forces.dissipated.sum()) for r in coupled.responses)
        if system.drag is not None:
            drag = system.drag @ v
            force = force - drag
            power += max(0.0, float((v * drag).sum()))  # of either sign at rounding level
        return Ends(elements, loads, force, power, coupled)

    def _velocities(self, y: Floats) -> Callable[[Floats], Floats]:
        """Velocities of momenta; zero where nothing asks for them."""
        none = np.zeros_like(y)
        return self.nodes.velocities(y) if self._viscous else lambda _: none

    def _kick(
        self, y: Floats, m: Floats, h: float, loads: Amplitudes, start: CoupledStart | None
    ) -> tuple[Ends, int]:
        """Kick by one half, in place, such that the velocity is that after it."""
        elements, velocities = self._elements(y), self._velocities(y)

        def kicked(at: Floats) -> tuple[Ends, Floats]:
            rates = velocities(at)
            ends = self._ends(y, rates, elements(rates), loads, start)
            return ends, m + 0.5 * h * self.nodes.momenta(y, ends.force)

        ends, after = kicked(m)
        if not self._viscous:
            m[:] = after
            return ends, 0
        project, last = self.nodes.projection(y), np.inf
        for k in range(1, ITERATIONS + 1):
            project(after)
            ends, new = kicked(after)
            change = new - after
            project(change)
            size = np.maximum(abs(after).max((0, 2), initial=0.0), 1e-300)
            left = float((abs(change).max((0, 2), initial=0.0) / size).max())
            # what does not become less any more is accepted, if it is little
            if left <= SAME or 0.5 * last < left <= TOLERANCE:
                m[:] = after + change
                return ends, k
            after, last = after + self._relaxed * change, left
        raise Unclosed("the velocity that dampers leave after a kick was not found", last)


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
        """Explicit steps of size h (s), after checks of scene, treatment and step size."""
        for what, reason in _refused(system, treatment):
            raise IncompatibleError(f"{self!r} with {what}", reason)
        check_lumped(repr(self), system)
        checked_nodes(repr(self), system)
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
        return Marching(self, system, h, watch)
