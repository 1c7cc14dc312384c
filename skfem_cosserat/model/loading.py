"""All loads of a scene as arrays: dead loads, follower forces, moments."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..frames import Place
from ..kernels import cross
from ..load import (
    Load,
    Term,
    TermAcceleration,
    TermForce,
    TermLine,
    TermMoment,
    TermStrain,
)
from ..pattern import product_form
from ..time_function import (
    Constant,
    TimeFunction,
    constant_after,
    numbers_of,
)
from ..types import NO_INDICES, Array, Floats, IndexArray
from .groups import BeamGroup, Group

#: of the complex step
TINY = 1e-20


class Followers(NamedTuple):
    """Forces fixed in bodies and sections: ``f_v = C y_u`` for pairs of frames.

    Attributes
    ----------
    vertices : (k, 2) int array
        Frame on which a force acts, and that whose directors it has components in.
    channels : (k,) int array
    values : (k, 4, 4) array
        Scalars C for amplitudes of one.
    """

    vertices: IndexArray
    channels: IndexArray
    values: Floats


class Moments(NamedTuple):
    """Moments on single frames.

    Attributes
    ----------
    vertices, channels : (k,) int arrays
    follows : (k,) bool array
        Whether the values are components in the triad.
    values : (k, 3) array
        For amplitudes of one.
    """

    vertices: IndexArray
    channels: IndexArray
    follows: NDArray[np.bool_]
    values: Floats


class Loading:
    """Generalised forces ``f(y, amplitudes)`` of the terms of all loads, and their derivative.

    Parameters
    ----------
    loads : list of Load
    first : dict
        ``id(item) -> (first vertex, first row)``.
    rows : int
        Rows of y that are unknowns.
    mass : csr_matrix
        Scalar mass matrix, for gravity.
    origins : (k,) int array
        Rows of y that are positions phi.
    beam_groups : list of BeamGroup
    frame_group : Group or None
        Group that holds single frames; places of moments and follower forces are among them.

    Attributes
    ----------
    terms, times, owners : list
        For each channel its term, function of time and load.
    """

    def __init__(
        self,
        loads: list[Load],
        first: dict[int, tuple[int, int]],
        rows: int,
        mass: csr_matrix,
        origins: IndexArray,
        beam_groups: list[BeamGroup],
        frame_group: Group | None,
    ):
        self._rows = rows
        self._first, self._mass, self._origins = first, mass, origins
        self._beam_groups = beam_groups
        self._frame_group = frame_group
        self.times: list[TimeFunction] = []
        self.owners = []
        self.terms = []
        dead = []
        self._dead_times = []
        #: (channel, group number or -1 for frames, element ids, (e, r, r) scalar blocks)
        self._followers: list[tuple[int, int, IndexArray, Floats]] = []
        #: strains without stress, likewise (e, ng, 6)
        self._strains: list[tuple[int, int, IndexArray, Floats]] = []
        moments = []
        for load in loads:
            for term in load.made_of:
                channel = len(self.times)
                self.times.append(term.time)
                self.owners.append(load)
                self.terms.append(term)
                if isinstance(term, TermMoment):
                    moments.append((channel, self._block_of(term.place), term.follower, term.value))
                elif term.follower:
                    self._add_follower(term, channel)
                else:
                    dead.append(self._dead(term))
                    self._dead_times.append(channel)
        #: dead loads (loads, 3 rows) for amplitudes of one, in the form that costs least
        self.dead = product_form(self._stacked(dead))
        self.constant = all(isinstance(t, Constant) for t in self.times)
        #: time (s) from which no channel changes
        self.constant_after = max(map(constant_after, self.times), default=-np.inf)
        #: whether no load depends on the motion
        self.dead_only = not self._followers and not moments
        #: whether some load is a strain, whose energy is not that of the strain seen
        self.strained = bool(self._strains)
        #: what looks at the factors of all channels at a time (s): whether they leave a plane
        self.guard: Callable[[Floats, float], None] | None = None
        self._moment_channel = np.array([m[0] for m in moments], np.int64)
        self._moment_block = np.array([m[1] for m in moments], np.int64)
        self._moment_follows = np.array([m[2] for m in moments], bool)
        self._moment_value = np.array([m[3] for m in moments]).reshape(-1, 3)
        if moments:
            assert self._frame_group is not None
            self._moment_rows = self._frame_group.rows[self._moment_block][:, 1:]

    def _block_of(self, place: Place) -> int:
        """Number of a place's frame in the group of single frames."""
        assert self._frame_group is not None  # the system puts all such frames there
        vertex = self._first[id(place.item)][0] + place.vertex
        return int(np.searchsorted(self._frame_group.vertices[:, 0], vertex))

    def _dead(self, term: Term) -> tuple[IndexArray, Floats]:
        """Rows (k,) of y on which a term acts, and its forces (k, 3) on them."""
        value = term.value
        if isinstance(term, TermAcceleration):
            out = np.zeros((self._rows, 3))
            out[self._origins] = value
            return np.arange(self._rows), self._mass @ out
        if isinstance(term, TermLine):
            _, r = self._first[id(term.beam)]
            nodes = term.beam.basis.connectivity[term.elements]
            loaded, place = np.unique(nodes, return_inverse=True)
            out = np.zeros((len(loaded), 3))
            np.add.at(out, place.reshape(nodes.shape), term.forces())
            return r + 4 * loaded, out
        assert isinstance(term, TermForce)
        _, r = self._first[id(term.place.item)]
        if term.place.triad is None:
            return np.array([r + term.place.vertex]), value[None]
        arms = np.concatenate([[1.0], term.place.offset])
        return r + 4 * term.place.vertex + np.arange(4), arms[:, None] * value

    def _stacked(self, dead: list[tuple[IndexArray, Floats]]) -> csr_matrix:
        """Dead loads, each in a row (loads, 3 rows)."""
        shape = len(dead), 3 * self._rows
        if not dead:
            return csr_matrix(shape)
        rows, forces = zip(*dead, strict=True)
        ends = np.cumsum([0, *(3 * len(each) for each in rows)])
        column = (3 * np.concatenate(rows)[:, None] + np.arange(3)).ravel()
        out = csr_matrix((np.concatenate(forces).ravel(), column, ends), shape=shape)
        out.eliminate_zeros()
        return out

    def _add_follower(self, term: Term, channel: int) -> None:
        """f_a = sum_b L_ab y_b with constant L: components times directors."""
        value = term.value
        if isinstance(term, TermLine):
            beam = term.beam
            number = next(k for k, g in enumerate(self._beam_groups) if id(beam) in g.slices)
            ids = term.elements + self._beam_groups[number].slices[id(beam)].start
            self._followers.append((channel, number, ids, term.matrices()))
            if isinstance(term, TermStrain):
                self._strains.append((channel, number, ids, term.strains()))
            return
        assert isinstance(term, TermForce)
        block = np.zeros((1, 4, 4))
        block[0, :, 1:] = np.outer(np.concatenate([[1.0], term.place.offset]), value)
        self._followers.append((channel, -1, np.array([self._block_of(term.place)]), block))

    def sites(self) -> list[list[int]]:
        """Channels whose vectors add up: those of one load that act on one thing in one way."""
        found: dict[tuple[object, ...], list[int]] = {}
        for k, (owner, term) in enumerate(zip(self.owners, self.terms, strict=True)):
            key = id(owner), type(term), term.site, term.follower
            found.setdefault(key, []).append(k)
        return list(found.values())

    def _group(self, number: int) -> Group:
        if number >= 0:
            return self._beam_groups[number]
        assert self._frame_group is not None
        return self._frame_group

    @property
    def moments(self) -> Moments:
        """Moments on single frames."""
        vertices = NO_INDICES
        if self._frame_group is not None:
            vertices = self._frame_group.vertices[self._moment_block, 0]
        return Moments(vertices, self._moment_channel, self._moment_follows, self._moment_value)

    @cached_property
    def dead_channels(self) -> IndexArray:
        """Channels of the dead loads."""
        return np.array(self._dead_times, np.int64)

    def strains(self, group: BeamGroup, factors: Floats) -> Floats:
        """Strains without stress (N, ne, ng, 6) of beams, for factors (N, channels)."""
        shape = len(factors), *group.elements.reference.shape
        own = [each for each in self._strains if self._beam_groups[each[1]] is group]
        out = np.zeros(shape) if own else np.broadcast_to(0.0, shape)
        for channel, _, ids, strains in own:
            out[:, ids] += factors[:, channel, None, None, None] * strains
        return out

    @property
    def followers(self) -> Followers:
        """Forces fixed in bodies and sections, frame by frame."""
        vertices = [np.zeros((0, 2), np.int64)]
        channels = [NO_INDICES]
        values = [np.zeros((0, 4, 4))]
        for channel, number, ids, block in self._followers:
            own = self._group(number).vertices[ids]
            ne, nn = own.shape
            each = block.reshape(ne, nn, 4, nn, 4).transpose(0, 1, 3, 2, 4)
            values.append(each.reshape(-1, 4, 4))
            vertices.append(np.stack([own.repeat(nn, 1), np.tile(own, (1, nn))], -1))
            vertices[-1] = vertices[-1].reshape(-1, 2)
            channels.append(np.full(len(values[-1]), channel))
        return Followers(np.concatenate(vertices), np.concatenate(channels), np.concatenate(values))

    # -- evaluation ------------------------------------------------------------------------------

    def averages(self, t0: float, t1: float) -> Floats:
        """Exact means of all channels over a step."""
        return self._checked_each(lambda time: time.average(t0, t1), t1)

    def values(self, t: float) -> Floats:
        """All channels at time `t`."""
        return self._checked_each(lambda time: time.value(t), t)

    def checked(self, factors: Floats, t: float) -> Floats:
        """The factors of all channels at a time `t` (s), if nothing is wrong with them."""
        if self.guard is not None:
            self.guard(factors, t)
        return factors

    def _checked_each(self, number: Callable[[TimeFunction], float], t: float) -> Floats:
        return self.checked(np.array(numbers_of(self.times, self.owners, number, t)), t)

    def dead_force(self, amplitudes: Floats) -> Floats:
        """Generalised force (..., rows, 3) of the loads that do not depend on y.

        `amplitudes` (..., channels) are those of one step, or of several.
        """
        factors = amplitudes.take(self.dead_channels, -1)
        if factors.ndim > 1 and isinstance(self.dead, np.ndarray):
            factors = factors[:, None]  # products of vectors, whose rounding is that of one step
        return (factors @ self.dead).reshape(*amplitudes.shape[:-1], -1, 3)

    def force(self, y: Array, amplitudes: Floats) -> Array:
        """Generalised force (rows, 3) of the loads that depend on y (follower forces, moments)."""
        out = np.zeros((self._rows, 3), y.dtype)
        for channel, number, ids, block in self._followers:
            rows = self._group(number).rows[ids]
            np.add.at(out, rows, amplitudes[channel] * (block @ y[rows]))
        if len(self._moment_block):
            np.add.at(out, self._moment_rows, self._moments(y[self._moment_rows], amplitudes))
        return out

    def _moments(self, D: Array, amplitudes: Floats) -> Array:
        """``m x d^j/2`` (..., k, 3, 3) on directors D, with the reciprocal ones d^j."""
        value = amplitudes[self._moment_channel][:, None] * self._moment_value
        m = np.where(self._moment_follows[:, None], (value[:, :, None] * D).sum(-2), value)
        return 0.5 * cross(m[..., None, :], np.linalg.inv(D).swapaxes(-1, -2))

    def add_tangent(self, blocks: list[Array], y: Array, amplitudes: Floats, factor: float) -> None:
        """Add ``factor * df/dy`` to the groups' blocks (beam groups first, then frames)."""
        for channel, number, ids, block in self._followers:
            k = number if number >= 0 else len(self._beam_groups)
            scaled = factor * amplitudes[channel] * np.kron(block, np.eye(3)[None])
            np.add.at(blocks[k], ids, scaled)
        if len(self._moment_block):
            D = y[self._moment_rows]
            steps = 1j * TINY * np.eye(9).reshape(9, 1, 3, 3)
            slopes = self._moments(D + steps, amplitudes).imag.reshape(9, -1, 9) / TINY
            derivative = np.zeros((len(D), 12, 12))
            derivative[:, 3:, 3:] = slopes.transpose(1, 2, 0)
            np.add.at(blocks[len(self._beam_groups)], self._moment_block, factor * derivative)
