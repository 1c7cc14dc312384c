"""Springs, dampers, actuators and the like as arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix

from ..coupling import Coupling
from ..errors import AccuracyWarning, InputError
from ..force import INSTANT
from ..frames import Place
from ..relative import Expression, Form, RelativeCoordinate
from ..time_function import (
    Constant,
    TimeFunction,
    numbers_of,
)
from ..types import Array, ArrayLike, Floats, IndexArray
from ..warn import warn
from .coordinates import KINDS, MOST_XI, Joined, Kind
from .own_law import OwnLaw, apply

# -- laws of force elements: generalised force, stored energy, and what is dissipated in a step ----


class LinearLaw:
    """Generalised force ``K e + C de/dt`` of c couplings by their stretch e (..., c, m).

    The stretch is the coordinate less its neutral value. Numbers may be complex.

    Attributes
    ----------
    K, C : (c, m, m) array
        Stiffness and damping.
    """

    def __init__(self, members: Sequence[Coupling]) -> None:
        self.K = np.array([c.stiffness for c in members])
        self.C = np.array([c.damping for c in members])
        values, vectors = np.linalg.eigh(self.C)
        # so that what is dissipated is a sum of squares
        self._root = np.sqrt(values.clip(0))[..., None] * vectors.swapaxes(-1, -2)

    def energy(self, e: Array) -> Array:
        """Stored energy (..., c)."""
        return 0.5 * (e * apply(self.K, e)).sum(-1)

    force_of_load, period, due = False, 0.0, 0

    def force(self, e: Array, rate: Array, t: float = 0.0) -> Array:
        """Force (..., c, m) against a larger stretch: tension is positive."""
        return apply(self.K, e) + apply(self.C, rate)

    def slopes_at_rest(self, e: Array, taut: bool) -> tuple[Array, Array]:
        """Derivatives (c, m, m) of the force by stretch and rate; `taut`: also of slack cables."""
        acts = taut | self.acts(e)[..., None]
        return self.K * acts, self.C * acts

    def acts(self, e: Array) -> Array:
        """Mask (..., c, m) of the stretches e with a force: a cable may be slack."""
        return np.ones(e.shape, dtype=bool)

    def discrete(
        self, e0: Array, e1: Array, h: float, t: float, decay: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Force sigma (..., c, m), what is dissipated (..., c), numerically (..., c).

        ``sigma . (e_1 - e_0)`` is the change of energy plus what is dissipated. `decay` is for
        EnergyDecaying, which damps by the stiffness with the factor ``h decay/2``.
        """
        change = e1 - e0
        sigma = apply(self.K, 0.5 * (e0 + e1)) + apply(self.C, change) / h
        dissipated = (apply(self._root, change) ** 2).sum(-1) / h
        numerical = 0 * dissipated
        if decay:
            more = 0.5 * decay * apply(self.K, change)
            numerical = (more * change).sum(-1)
            sigma, dissipated = sigma + more, dissipated + numerical
        return sigma, dissipated, numerical

    def midpoint(
        self, e: Array, rate: Array, e0: Array, e1: Array, h: float, t: float
    ) -> tuple[Array, Array]:
        """Force sigma, and what is dissipated; e is that of the midpoint configuration."""
        return self.force(e, rate), h * (apply(self._root, rate) ** 2).sum(-1)


class SlackLaw(LinearLaw):
    """Tension only: ``k e + c de/dt`` while e > 0, never negative.

    The damper takes the part of a step in which the cable is taut.
    """

    def __init__(self, members: Sequence[Coupling]) -> None:
        super().__init__(members)
        self.k, self.c = self.K[:, 0], self.C[:, 0]

    def energy(self, e: Array) -> Array:
        """Stored energy ``k e^2/2`` (..., c) of a taut cable, 0 of a slack one."""
        return 0.5 * (self.k * _positive(e) ** 2).sum(-1)

    def force(self, e: Array, rate: Array, t: float = 0.0) -> Array:
        """Tension (..., c, m), 0 of a slack cable."""
        return np.where(e.real > 0, _positive(self.k * e + self.c * rate), 0.0)

    def acts(self, e: Array) -> Array:
        """Mask (..., c, m) of the cables that are taut: e > 0."""
        return e.real > 0

    def discrete(
        self, e0: Array, e1: Array, h: float, t: float, decay: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Tension with the discrete derivative of the energy, what is dissipated."""
        up0, up1 = _positive(e0), _positive(e1)
        taut0, taut1 = e0.real > 0, e1.real > 0
        # (V_1 - V_0)/(e_1 - e_0); without cancellation where only one end is taut
        change = np.where(taut1 ^ taut0, e1 - e0, 1.0)
        squares = 0.5 * (up1 * up1 - up0 * up0) / change
        spring = self.k * np.where(taut1 & taut0, 0.5 * (up0 + up1), squares)
        own = 0.5 * h * decay * self.k
        c = self.c + own
        sigma = _positive(spring + c * (up1 - up0) / h)
        lost = (sigma - spring) * (e1 - e0)
        return sigma, lost.sum(-1), (lost * own / np.where(c > 0, c, 1.0)).sum(-1)

    def midpoint(
        self, e: Array, rate: Array, e0: Array, e1: Array, h: float, t: float
    ) -> tuple[Array, Array]:
        """Tension, and what is dissipated.

        The damper acts by the change of the positive parts of e_0 and e_1.
        """
        spring = self.k * _positive(e)
        sigma = _positive(spring + self.c * (_positive(e1) - _positive(e0)) / h)
        return sigma, h * ((sigma - spring) * rate).sum(-1)


def _positive(e: Array) -> Array:
    return np.where(e.real > 0, e, 0.0)


# -- all force elements of a scene as arrays: forces, tangents, energy and work of a step ----------
#
# Couplings whose coordinates and law are of one kind are evaluated together. A coupling's force on
# the rows of y is ``sum_k s_k grad pi_k(y_mid)``: its invariants ``pi`` are quadratic, so that this
# does the work ``s . (pi_1 - pi_0)`` in a step, exactly, and leaves the momentum of free systems
# alone. Schemes differ in s, see :meth:`Couplings.midpoint` and :meth:`Couplings.discrete`.

#: first row of y of a place's vertex
RowOf = Callable[[Place], int]


class Invariants:
    """Quadratic invariants ``pi_k = y . A_k y / 2`` of several couplings on their local rows of y.

    Parameters
    ----------
    forms : list of tuple of Form
        k forms for each of the c couplings.
    row_of : callable
        First row of y of a place's vertex.

    Attributes
    ----------
    rows : (c, R) int array
        Rows of y; couplings of fewer rows repeat their first one, with zeros in A.
    real : (c, R) bool array
        Which of them are no repetition.
    A : (c, k, R, R) array
        Symmetric.
    """

    def __init__(self, forms: Sequence[tuple[Form, ...]], row_of: RowOf) -> None:
        tables = [[_table(form, row_of) for form in each] for each in forms]
        owned = [sorted({a for table in each for ab in table for a in ab}) for each in tables]
        self.rows, self.real = _padded(owned)
        R = self.rows.shape[1]
        self.A = np.zeros((len(forms), len(forms[0]), R, R))
        for c, (each, rows) in enumerate(zip(tables, owned, strict=True)):
            local = {row: i for i, row in enumerate(rows)}
            for k, table in enumerate(each):
                for (a, b), factor in table.items():
                    self.A[c, k, local[a], local[b]] += factor
                    self.A[c, k, local[b], local[a]] += factor

    def gradients(self, y: Array) -> Array:
        """``A_k y`` (..., c, k, R, 3) for y (..., total, 3)."""
        return self.A @ y[..., self.rows, :][..., None, :, :]

    def values(self, y: Array) -> Array:
        """``pi`` (..., c, k)."""
        local = y[..., self.rows, :][..., None, :, :]
        return 0.5 * ((self.A @ local) * local).sum((-2, -1))

    def rates(self, y: Array, ydot: Array) -> Array:
        """``dpi/dt`` (..., c, k) for rates ydot of all rows."""
        return (self.gradients(y) * ydot[..., self.rows, :][..., None, :, :]).sum((-2, -1))


class Positions:
    """Points of several couplings, and other vectors that are linear in y, in place of invariants.

    Parameters
    ----------
    vectors : list of sequences of Expression
        k vectors for each of the c couplings.
    row_of : callable
        First row of y of a place's vertex.

    Attributes
    ----------
    rows, real
        See :class:`Invariants`.
    A : (1, 1, 1, 1) array
        Zero: they have no curvature.
    """

    A = np.zeros((1, 1, 1, 1))

    def __init__(self, vectors: Sequence[Sequence[Expression]], row_of: RowOf) -> None:
        tables = [
            [[(row_of(place) + i, x) for place, i, x in vector.terms] for vector in each]
            for each in vectors
        ]
        owned = [sorted({row for table in each for row, _ in table}) for each in tables]
        self.rows, self.real = _padded(owned)
        R, k = self.rows.shape[1], len(tables[0])
        #: weights (c, k, R) of the rows
        self._weights = np.zeros((len(tables), k, R))
        for c, (each, rows) in enumerate(zip(tables, owned, strict=True)):
            for j, table in enumerate(each):
                for row, x in table:
                    self._weights[c, j, rows.index(row)] += x
        eye = np.eye(3)[:, None]
        self._gradients = (self._weights[:, :, None, :, None] * eye).reshape(-1, 3 * k, R, 3)

    def gradients(self, y: Array) -> Array:
        """Derivatives (c, 3 k, R, 3) of the components by the rows."""
        return self._gradients

    def values(self, y: Array) -> Array:
        """Components (..., c, 3 k)."""
        found = self._weights @ y[..., self.rows, :]
        return found.reshape(*found.shape[:-2], -1)

    def rates(self, y: Array, ydot: Array) -> Array:
        """Their rates for rates ydot of all rows."""
        return self.values(ydot)


def _padded(owned: list[list[int]]) -> tuple[IndexArray, Array]:
    """Rows (c, R) of couplings, the first one again where there are fewer, and which are real."""
    R = max(map(len, owned))
    rows = np.array([each + each[:1] * (R - len(each)) for each in owned])
    return rows, np.arange(R) < np.array([[len(each)] for each in owned])


def _table(form: Form, row_of: RowOf) -> dict[tuple[int, int], float]:
    """Factor of each product of rows."""
    out: dict[tuple[int, int], float] = {}
    for product in form:
        for p, i, left in product.left.terms:
            for q, j, right in product.right.terms:
                key = row_of(p) + i, row_of(q) + j
                out[key] = out.get(key, 0.0) + product.factor * left * right
    return out


def angle_names(item: Coupling) -> list[str]:
    """Names of the angles of a force element, see :class:`Couplings`."""
    names = [c.name for c in item.coordinates if c.kind == "angle"]
    return [f"{item.name}/{name}" for name in names] if len(names) > 1 else [str(item.name)]


def _prescribed(item: Coupling, times: Floats) -> Array:
    """Forces (..., m) of the channels of a force element at times (...); 0 if it has none."""
    own = [[time.value(t) for time in item.channels] for t in times.ravel().tolist()]
    return np.reshape(own, (*times.shape, -1)) if item.channels else np.zeros(1)


def fits_kernels(item: Coupling, row_of: RowOf) -> bool:
    """Whether kernels have its coordinates: displacements before one of any kind, on two sides."""
    shifts = {c.kind for c in item.coordinates[:-1]} <= {"displacement", "position"}
    return shifts and item.size <= MOST_XI and len({row_of(p) for p in item.places()}) <= 2


def kind_of(coordinates: Sequence[RelativeCoordinate]) -> Kind:
    """The kind of one coordinate, or of several side by side."""
    kinds = tuple(KINDS[c.kind] for c in coordinates)
    return kinds[0] if len(kinds) == 1 else Joined(kinds)


# -- groups ----------------------------------------------------------------------------------------


@dataclass(eq=False)
class _Start:
    """A group at the start of a step."""

    pi: Floats
    xi: Floats
    amplitude: Array
    #: at which laws are taken (s)
    time: float
    law: LinearLaw | OwnLaw


#: of the complex steps that give slopes: without differences, any that is small enough
TINY = 1e-40


class _Forces(NamedTuple):
    """Forces of a group as a function of invariants.

    `s` (c, k) are the factors of their gradients, `travel` (c, m) is what the forces sigma do work
    on; `numerical` is what the scheme has of what is dissipated, `damped` (c, m) the part of
    dampers in the forces where these are of one instant.
    """

    s: Array
    travel: Array
    dissipated: Array
    numerical: Array | None = None
    damped: Array | None = None


@dataclass(eq=False)
class _Response:
    """A group at a trial configuration.

    Its forces depend on invariants `at` (c, K), of derivatives `by_end` (c, K, R, 3) by the end;
    `share` is the factor of the end in the configuration at which the force acts.
    """

    group: _Group
    function: Callable[[Array], _Forces]
    at: Array
    gradients: Array
    by_end: Array
    share: float = 0.5

    def __post_init__(self) -> None:
        self.forces = self.function(self.at)

    def nodal(self) -> Array:
        """Forces (c, R, 3) on the rows."""
        return (self.forces.s[:, :, None, None] * self.gradients).sum(1)

    def slopes(self) -> Array:
        """Derivatives (c, k, K) of s by the invariants, by complex steps: exact to round-off."""
        steps = 1j * TINY * np.eye(self.at.shape[-1])[:, None]
        return (self.function(self.at.real + steps).s.imag / TINY).transpose(1, 2, 0)


class _Group:
    """Couplings of one kind of coordinates and one law."""

    def __init__(
        self,
        members: list[Coupling],
        row_of: RowOf,
        reference: Floats,
        free: int,
        channel: int,
        length: float,
    ) -> None:
        self.members = members
        self.kind = kind_of(members[0].coordinates)
        self.invariants: Invariants | Positions
        if {c.kind for c in members[0].coordinates} == {"position"}:
            vectors = [[c.forms[0][0].right for c in m.coordinates[::3]] for m in members]
            self.invariants = Positions(vectors, row_of)
        else:
            forms = [tuple(f for c in m.coordinates for f in c.forms) for m in members]
            self.invariants = Invariants(forms, row_of)
        self.law: LinearLaw | OwnLaw
        if members[0].own_law:
            turning = {c.kind for c in members[0].coordinates} & {"angle", "rotation"}
            self.law = OwnLaw(members, 1.0 if turning else length)
        else:
            self.law = SlackLaw(members) if members[0].slack else LinearLaw(members)
        self.neutral = np.array([m.neutral for m in members])
        #: of each member at first
        self.memory = np.array([m.memory.ravel() for m in members])
        #: of the law's stretch: -1 where it grows with a smaller coordinate
        self.sign = np.array([[m.sign] for m in members])
        kinds = np.array([c.kind for c in members[0].coordinates for _ in range(c.size)])
        #: components that are angles, whose full turns count, and those of rotation vectors
        self.angles, self.vectors = (np.flatnonzero(kinds == k) for k in ("angle", "rotation"))
        # displacements count from the reference
        self.origin = (kinds == "displacement") * self.at(reference)[1]
        self.neutral += self.origin
        #: numbers of the actuators' channels, -1 for none
        self.channels = np.full((len(members), self.kind.size), -1)
        for i, member in enumerate(members):
            if member.channels:
                self.channels[i] = np.arange(channel, channel + self.kind.size)
                channel += self.kind.size
        inside = self.invariants.real & (self.invariants.rows < free)
        self.kept = inside[:, :, None] & inside[:, None, :]
        a = np.broadcast_to(self.invariants.rows[:, :, None], self.kept.shape)
        self.pairs = np.stack([a[self.kept], a.swapaxes(1, 2)[self.kept]], axis=-1)

    def at(self, y: Array) -> tuple[Array, Array]:
        """Invariants (..., c, k), and coordinates (..., c, m) of them."""
        pi = self.invariants.values(y)
        return pi, self.kind.value(pi)

    def stretch(self, xi: Array) -> Array:
        return self.sign * (xi - self.neutral)

    def rate(self, y: Array, ydot: Array, pi: Array) -> Array:
        return apply(self.kind.slope(pi), self.invariants.rates(y, ydot))

    def discrete(self, start: _Start, h: float, mid: Array, y1: Array, decay: float) -> _Response:
        """``s = Psi^T sigma`` with the discrete derivatives of coordinates and energy."""

        def forces(pi1: Array) -> _Forces:
            xi1 = self.kind.continued(pi1, start.xi)
            Psi = self.kind.discrete(start.pi, start.xi, pi1, xi1)
            ends = self.stretch(start.xi), self.stretch(xi1)
            law, dissipated, numerical = start.law.discrete(*ends, h, start.time, decay)
            s = apply(Psi.swapaxes(-1, -2), self.sign * law - start.amplitude)
            return _Forces(s, xi1 - start.xi, dissipated, numerical)

        gradients, by_end = (self.invariants.gradients(y) for y in (mid, y1))
        return _Response(self, forces, self.invariants.values(y1), gradients, by_end)

    def midpoint(self, start: _Start, h: float, mid: Array, y1: Array) -> _Response:
        """``s = xi'(pi_mid)^T sigma`` of the coordinates of the midpoint configuration."""
        count = self.kind.invariants

        def forces(both: Array) -> _Forces:
            pi, pi1 = both[..., :count], both[..., count:]
            xi, xi1 = (self.kind.continued(each, start.xi) for each in (pi, pi1))
            J = self.kind.slope(pi)
            travel = apply(J, pi1 - start.pi)
            ends = self.stretch(start.xi), self.stretch(xi1)
            now = self.stretch(xi), self.sign * travel / h
            law, dissipated = start.law.midpoint(*now, *ends, h, start.time)
            sigma = self.sign * law - start.amplitude
            return _Forces(apply(J.swapaxes(-1, -2), sigma), travel, dissipated)

        both = np.concatenate([self.invariants.values(y) for y in (mid, y1)], axis=-1)
        gradients = self.invariants.gradients(mid)
        by_end = np.concatenate([0.5 * gradients, self.invariants.gradients(y1)], axis=1)
        return _Response(self, forces, both, gradients, by_end)

    def static(self, start: _Start, y: Array, ydot: Array, share: float) -> _Response:
        """``s = xi'(pi)^T sigma`` at y, angles counted on from `start`; see the caller."""
        count = self.kind.invariants

        def forces(both: Array) -> _Forces:
            pi, flow = both[..., :count], both[..., count:]
            xi, J = self.kind.continued(pi, start.xi), self.kind.slope(pi)
            e, rate = self.stretch(xi), self.sign * apply(J, flow)
            law = start.law.force(e, rate, start.time)
            rest = law if self.law.force_of_load else start.law.force(e, 0 * rate, start.time)
            damped = law - rest
            s = apply(J.swapaxes(-1, -2), self.sign * law - start.amplitude)
            lost = (damped * rate).sum(-1)
            return _Forces(s, xi - start.xi, lost, damped=self.sign * damped)

        values = self.invariants.values(y), self.invariants.rates(y, ydot)
        gradients = self.invariants.gradients(y)
        faster = share * gradients
        if isinstance(self.invariants, Invariants):
            faster = faster + self.invariants.gradients(ydot)
        by_end = np.concatenate([gradients, faster], axis=1)
        return _Response(self, forces, np.concatenate(values, axis=-1), gradients, by_end, 1.0)

    def forces(self, xi: Array, rate: Array, memory: Array, times: Floats) -> Array:
        """Forces of the law at coordinates (..., c, m) of states at times (...), or at one time."""
        e, law = self.stretch(xi), self.law
        if not isinstance(law, OwnLaw):
            return self.sign * law.force(e, self.sign * rate)
        if not times.ndim:
            return law.within(memory).force(e, rate, float(times))
        memories = np.broadcast_to(memory, (*xi.shape[:-1], memory.shape[-1]))
        states = zip(e, rate, memories, times.tolist(), strict=True)
        return np.array([law.within(z).force(x, v, t) for x, v, z, t in states])

    def within(self, xi: Floats, memory: Floats, half: float, ends: bool) -> LinearLaw | OwnLaw:
        """The law in a step that starts with coordinates and memories (c, m or k)."""
        if not (memory.size and isinstance(self.law, OwnLaw)):
            return self.law
        return self.law.within(memory, half, self.stretch(xi) if ends else None)

    def slopes_at_rest(self, y: Array, taut: bool) -> list[Array]:
        """``B^T K B`` and ``B^T C B`` with ``delta xi = B delta y``, at :attr:`pairs`."""
        (pi, xi), gradients = self.at(y), self.invariants.gradients(y)
        c, k, R, _ = gradients.shape
        B = self.kind.slope(pi) @ gradients.reshape(c, k, 3 * R)
        both = self.law.slopes_at_rest(self.stretch(xi), taut)
        blocks = [(B.swapaxes(1, 2) @ each @ B).reshape(c, R, 3, R, 3) for each in both]
        return [each.swapaxes(2, 3)[self.kept] for each in blocks]

    def tangent(self, response: _Response) -> Array:
        """Derivative of the force on row a by row b of y_1, at :attr:`pairs`; (k, 3, 3)."""
        r = response
        c, k, R, _ = r.gradients.shape
        right = r.slopes() @ r.by_end.reshape(c, -1, 3 * R)
        K = r.gradients.reshape(c, k, 3 * R).swapaxes(1, 2) @ right
        K = K.reshape(c, R, 3, R, 3).swapaxes(2, 3)
        curved = r.share * (r.forces.s[:, :, None, None] * self.invariants.A).sum(1)
        for i in range(3):
            K[..., i, i] += curved
        return K[self.kept]


# -- all -------------------------------------------------------------------------------------------


def warn_of_jump(item: Coupling, time: float | None) -> None:
    """Warn of a rotation vector that passed a turn of pi, where it jumps."""
    text = "the relative rotation passed pi, where its rotation vector jumps"
    warn(item.label, text, AccuracyWarning, time)


@dataclass(eq=False)
class CoupledStart:
    """All couplings at the start of a step of size h."""

    h: float
    y0: Floats
    groups: list[_Start]


@dataclass(eq=False)
class CoupledForce:
    """All couplings at a trial configuration.

    Attributes
    ----------
    force : (total, 3) array
        On all rows of y, the ground included, in the sense of an internal force.
    """

    force: Array
    responses: list[_Response]

    def work_of_loads(self, change: Floats) -> float:
        """Work (J) of laws without a potential along a change (total, 3) of the rows."""
        out = 0.0
        for r in self.responses:
            if r.group.law.force_of_load:
                out -= float((r.nodal() * change[r.group.invariants.rows]).sum())
        return out


@dataclass(frozen=True)
class CouplingWork:
    """Work in a step (J): by actuators, lost in dampers, done by moving ground on couplings.

    What is lost has a part by the scheme itself, `numerical`; `loads` is the work of loads that are
    functions of the motion.
    """

    actuators: float
    dissipated: float
    ground: float
    numerical: float = 0.0
    loads: float = 0.0


class Couplings:
    """Springs, dampers, cables, bushings, actuators and forces of own laws of a scene.

    Parameters
    ----------
    items : list of Coupling
    row_of : callable
        First row of y of a place's vertex.
    reference : (total, 3) array
        Reference configuration, all rows: displacements count from there.
    free : int
        Rows of y that are unknowns; the rest is ground.
    length : float
        Extent of the scene (m).

    Attributes
    ----------
    items, own, all : list of Coupling
        Those that compiled kernels know, forces by laws of the user's own, and both.
    called, without_kernels : list of Coupling
        Those of own laws: kernels have the coordinates of the former, and nothing of the latter.
    count : int
        Number of all.
    pairs : (k, 2) int array
        Rows (a, b) of y, both unknowns, at which :meth:`tangent` has blocks.
    angles : list of Coupling or None
        Those on an angle, whose full turns are part of the state: once for each angle; None for
        each number of a memory.
    turning : list of str
        Names of the angles: that of the force element, with the angle's where there are several;
        and of the numbers of memories.
    """

    def __init__(
        self,
        items: Sequence[Coupling],
        row_of: RowOf,
        reference: Floats,
        free: int,
        length: float,
    ) -> None:
        self.items = [item for item in items if not item.own_law]
        own = [item for item in items if item.own_law]
        unfit = {id(item.whole) for item in own if not fits_kernels(item, row_of)}
        self.called = [item for item in own if id(item.whole) not in unfit]
        self.without_kernels = [item for item in own if id(item.whole) in unfit]
        self.own = [*self.called, *self.without_kernels]
        self.all = [*self.items, *self.own]
        self._free, self.count = free, len(items)
        families: dict[tuple[object, ...], list[Coupling]] = {}
        for item in self.all:
            law = id(item.whole) if item.own_law else item.slack
            key = (law, *(c.kind for c in item.coordinates))
            families.setdefault(key, []).append(item)
        self.times: list[TimeFunction] = []
        #: whose times they are
        self.owners: list[Coupling] = []
        #: those of one kind of coordinates and one law
        self.groups: list[_Group] = []
        for members in families.values():
            given = reference, free, len(self.times), length
            self.groups.append(_Group(members, row_of, *given))
            for member in members:
                self.times += member.channels
                self.owners += [member] * len(member.channels)
        #: those of own laws, by law
        self.laws = [g.members for g in self.groups if isinstance(g.law, OwnLaw)]
        #: whether no actuator depends on time
        self.constant = all(isinstance(time, Constant) for time in self.times)
        none = np.zeros((0, 2), dtype=np.int64)
        self.pairs = np.concatenate([none, *(g.pairs for g in self.groups)])
        self.angles: list[Coupling | None] = []
        self.turning: list[str] = []
        first = [np.zeros(0, dtype=np.int64)]
        for g in self.groups:
            for m in g.members if len(g.angles) else ():
                self.turning += angle_names(m)
                self.angles += [m] * len(g.angles)
            self.turning += [
                f"{m.name}/memory/{k}" for m in g.members for k in range(m.memory.size)
            ]
            first.append(np.zeros(len(g.members) * len(g.angles), dtype=np.int64))
            first += [g.memory.ravel()] * bool(g.memory.size)
            self.angles += [None] * g.memory.size
        #: full turns and memories of a state that has none
        self.untouched = np.concatenate(first)
        self._total = len(reference)

    @cached_property
    def _scatter(self) -> csr_matrix:
        """From the rows of y that the invariants take to all of them."""
        none = np.zeros(0, dtype=np.int64)
        rows = np.concatenate([none, *(g.invariants.rows.ravel() for g in self.groups)])
        entries = np.ones(len(rows)), (rows, np.arange(len(rows)))
        return csr_matrix(entries, shape=(self._total, len(rows)))

    def check(self, y: Floats) -> None:
        """Check derivatives of own laws near a configuration (total, 3).

        Raises
        ------
        InputError
            If they are wrong.
        """
        for g in self.groups:
            if isinstance(g.law, OwnLaw):
                g.law.check(g.stretch(g.at(y)[1]))

    # -- a step ----------------------------------------------------------------------------------

    def begin(self, y0: Floats, turns: IndexArray | None, t0: float, h: float) -> CoupledStart:
        """Couplings at the start of a step; `turns` as in a state."""
        middle = t0 + 0.5 * h, 0.5 * h
        return self.starting(y0, turns, self.averages(t0, t0 + h), h, *middle)

    def starting(
        self,
        y0: Floats,
        turns: Array | None,
        amplitudes: Array,
        h: float,
        time: float,
        half: float = 0.0,
        ends: bool = False,
    ) -> CoupledStart:
        """Couplings at the start of a step with given amplitudes of actuators, and a zero.

        Laws are taken at a time (s). Memories go on over a step of twice `half` (s), at whose end
        the forces are, if `ends`, else in its middle.
        """
        starts = [
            _Start(pi, xi, amplitudes[g.channels], time, g.within(xi, memory, half, ends))
            for g, (pi, xi, memory) in zip(self.groups, self._values(y0, turns), strict=True)
        ]
        return CoupledStart(h, y0, starts)

    def discrete(
        self, start: CoupledStart, mid: Array, y1: Array, decay: float = 0.0
    ) -> CoupledForce:
        """Forces that do the work ``V_1 - V_0``, but for dampers, actuators and `decay`."""
        return self._assemble(start, lambda g, s: g.discrete(s, start.h, mid, y1, decay))

    def midpoint(self, start: CoupledStart, mid: Array, y1: Array) -> CoupledForce:
        """Forces of the midpoint configuration: springs have the potential ``V(y_mid)``."""
        return self._assemble(start, lambda g, s: g.midpoint(s, start.h, mid, y1))

    def static(
        self, start: CoupledStart, y: Array, ydot: Array | None = None, share: float = 0.0
    ) -> CoupledForce:
        """Forces at y, at rest or at rates `ydot` of derivative `share` by y (both (total, 3)).

        What is dissipated is a power then (W).
        """
        rates = np.zeros_like(y) if ydot is None else ydot
        return self._assemble(start, lambda g, s: g.static(s, y, rates, share))

    def pushed(self, y: Array, time: float) -> Array:
        """Forces (free rows, 3) of laws without a potential, at rest at y."""
        out = np.zeros_like(y)
        for g in self.groups:
            if g.law.force_of_load:
                start = _Start(*g.at(y), np.zeros(1), time, g.law)
                found = g.static(start, y, np.zeros_like(y), 0.0)
                np.subtract.at(out, g.invariants.rows, found.nodal())
        return out[: self._free]

    def _assemble(
        self, start: CoupledStart, response: Callable[[_Group, _Start], _Response]
    ) -> CoupledForce:
        responses = [response(g, s) for g, s in zip(self.groups, start.groups, strict=True)]
        if responses:
            force = self._scatter @ np.concatenate([r.nodal().reshape(-1, 3) for r in responses])
        else:
            force = np.zeros((self._total, 3))
        return CoupledForce(force, responses)

    def tangent(self, force: CoupledForce, factor: float) -> Array:
        """``factor`` times the derivative of the force on row a by row b of y_1, (k, 3, 3)."""
        blocks = [np.zeros((0, 3, 3))]  # there may be none
        blocks += [g.tangent(r) for g, r in zip(self.groups, force.responses, strict=True)]
        return factor * np.concatenate(blocks)

    def work(self, start: CoupledStart, force: CoupledForce, y1: Floats) -> CouplingWork:
        """Work of actuators, dampers, moving ground and loads in a solved step."""
        pairs = [(s, r.forces) for s, r in zip(start.groups, force.responses, strict=True)]
        moved = y1[self._free :] - start.y0[self._free :]
        return CouplingWork(
            sum(float((s.amplitude * r.travel).sum()) for s, r in pairs),
            sum(float(r.dissipated.sum()) for _, r in pairs),
            float((force.force[self._free :] * moved).sum()),
            sum(float(r.numerical.sum()) for _, r in pairs if r.numerical is not None),
            force.work_of_loads(y1 - start.y0),
        )

    def turns(
        self, start: CoupledStart, y1: Floats, time: float | None = None
    ) -> IndexArray | None:
        """Full turns of :attr:`angles` at the end of a step, at a time; None if there are none.

        Warns of a rotation vector that passed a turn of pi, where it jumps.
        """
        out: list[Array] = []
        for g, s in zip(self.groups, start.groups, strict=True):
            pi, xi = g.at(y1)
            end = g.kind.continued(pi, s.xi)
            turned = (end - xi)[:, g.angles] / (2 * np.pi)
            out.append(np.rint(turned).astype(np.int64).ravel())
            if g.memory.size and isinstance(s.law, OwnLaw):
                ends = g.stretch(s.xi), g.stretch(end)
                out.append(s.law.remembered(*ends, s.time).ravel())
            jump = (abs(xi - s.xi)[:, g.vectors] > np.pi).any(1)
            for i in np.flatnonzero(jump):
                warn_of_jump(g.members[i], time)
        return np.concatenate(out) if self.angles else None

    # -- states ------------------------------------------------------------------------------------

    def energy(self, y: Floats, turns: IndexArray | None = None) -> Floats:
        """Stored energy (...) of states y (..., total, 3) with `turns` (..., angles)."""
        out = np.zeros(y.shape[:-2])
        for g, (_, xi, _) in zip(self.groups, self._values(y, turns), strict=True):
            out += g.law.energy(g.stretch(xi)).sum(-1)
        return out

    def stiffness(self, y: Array, taut: bool = False) -> Array:
        """Material stiffness of springs by row b on row a, at :attr:`pairs`; (k, 3, 3).

        `taut`: also of cables that are slack at y.
        """
        return self._slopes_at_rest(y, taut)[0]

    def damping(self, y: Array, taut: bool = False) -> Array:
        """Damping of force elements by velocity b on row a, likewise."""
        return self._slopes_at_rest(y, taut)[1]

    def _slopes_at_rest(self, y: Array, taut: bool) -> Array:
        """Both, (2, k, 3, 3)."""
        own = [g.slopes_at_rest(y, taut) for g in self.groups]
        return np.concatenate([np.zeros((2, 0, 3, 3)), *own], axis=1)

    @property
    def passive(self) -> list[Coupling]:
        """All but actuators and forces at places, in the order of :meth:`forces`."""
        return [m for g in self.groups for m in g.members if not (m.actuator or m.points)]

    def forces(
        self, y: Floats, ydot: Floats, turns: IndexArray | None = None, times: ArrayLike = 0.0
    ) -> list[tuple[Coupling, Floats, Floats]]:
        """Coordinates and forces (..., m) of each coupling but actuators, at y and its rate.

        The force is that of spring and damper; where it is positive it pulls the coordinate back.
        """
        out = []
        for g, (pi, xi, memory) in zip(self.groups, self._values(y, turns), strict=True):
            rate = g.rate(y, ydot, pi)
            force = g.forces(xi, rate, memory, np.asarray(times))
            shown = xi - g.origin
            out += [
                (m, shown[..., i, :], force[..., i, :] - _prescribed(m, np.asarray(times)))
                for i, m in enumerate(g.members)
                if not m.actuator
            ]
        return out

    def check_turns(self, turns: IndexArray | None) -> None:
        """Raises InputError if there are not as many as angles."""
        count = len(self.angles)
        if turns is not None and np.shape(turns)[-1:] != (count,):
            raise InputError("turns of angles", f"shape {np.shape(turns)}, expected (..., {count})")

    def named(self, names: Sequence[str], turns: Array) -> Array:
        """Full turns and memories (..., k) of those of other names; without one, as at first."""
        known = dict(zip(names, np.moveaxis(turns, -1, 0), strict=True))
        out = np.empty((*np.shape(turns)[:-1], len(self.turning)), self.untouched.dtype)
        for k, name in enumerate(self.turning):
            out[..., k] = known.get(name, self.untouched[k])
        return out

    def due(self, turns: Array | None) -> float:
        """Instant (s) at which a law is sampled next; infinite if none is."""
        kept = zip(self.groups, self.kept(turns), strict=True)
        found = [float(z[:, g.law.due].min()) for g, (_, z) in kept if g.law.period]
        return min(found, default=np.inf)

    def sampled(self, y: Floats, ydot: Floats, turns: Array | None, t: float) -> Array:
        """Full turns and memories of a state at a time (s), at which laws are sampled that are due.

        Parameters
        ----------
        y, ydot : (total, 3) array
            All rows and their rates.
        """
        out = np.array(self.untouched if turns is None else turns)
        kept = zip(self.groups, self._values(y, turns), self.kept(out), strict=True)
        for g, (pi, xi, z), (_, memory) in kept:
            late = t + INSTANT * g.law.period
            if isinstance(g.law, OwnLaw) and g.law.period and z[:, g.law.due].min() <= late:
                memory[:] = g.law.sampled(g.stretch(xi), g.rate(y, ydot, pi), z, t)
        return out

    def kept(self, turns: Array | None) -> list[tuple[Array, Array]]:
        """Full turns (..., c, angles) and memories (..., c, k) of each group: views."""
        out, first = [], 0
        every = self.untouched if turns is None else np.asarray(turns)
        for g in self.groups:
            both = []
            for count in (len(g.angles), g.memory.shape[1]):
                shape = len(g.members), count
                own = every[..., first : first + len(g.members) * count]
                both.append(own.reshape(*own.shape[:-1], *shape))
                first += own.shape[-1]
            out.append((both[0], both[1]))
        return out

    def _values(self, y: Floats, turns: Array | None) -> list[tuple[Floats, Floats, Floats]]:
        """(pi, xi, memory) of each group."""
        self.check_turns(turns)
        out = []
        for g, (own, memory) in zip(self.groups, self.kept(turns), strict=True):
            pi, xi = g.at(y)
            if own.size:
                xi[..., g.angles] += 2 * np.pi * own
            out.append((pi, xi, memory))
        return out

    def averages(self, t0: float, t1: float) -> Floats:
        """Means of all channels over a step, and a zero for who has none."""
        return self._each(lambda time: time.average(t0, t1), t1)

    def values(self, t: float) -> Floats:
        """Values of all channels at time `t` (s), and a zero for elements without a channel."""
        return self._each(lambda time: time.value(t), t)

    def _each(self, number: Callable[[TimeFunction], float], t: float) -> Floats:
        return np.array([*numbers_of(self.times, self.owners, number, t), 0.0])
