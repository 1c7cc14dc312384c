"""All loads of a scene as arrays: dead loads, follower forces, moments."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..errors import InputError
from ..kernels import cross, skew
from ..load import (
    Constant,
    Load,
    LoadForce,
    LoadGravity,
    LoadLine,
    LoadMoment,
    TimeFunction,
    settled,
)
from ..types import Array, Floats, IndexArray
from .groups import BeamGroup, Group

__all__ = ["Followers", "Loading", "Moments"]


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
    """Generalised forces ``f(y, amplitudes)`` and their derivative.

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
    ) -> None:
        self._rows = rows
        self._first, self._mass, self._origins = first, mass, origins
        self._beam_groups, self._frame_group = beam_groups, frame_group
        self.times: list[TimeFunction] = []
        #: whose times they are
        self.owners: list[Load] = []
        dead: list[Floats] = []
        self._dead_times: list[int] = []
        #: (channel, group number or -1 for frames, element ids, (e, r, r) scalar blocks)
        self._followers: list[tuple[int, int, IndexArray, Floats]] = []
        moments: list[tuple[int, int, bool, Floats]] = []
        for load in loads:
            for value, time in load.channels:
                channel = len(self.times)
                self.times.append(time)
                self.owners.append(load)
                if isinstance(load, LoadMoment):
                    v, _ = first[id(load.place.item)]
                    block = self._frame_block(v + load.place.vertex)
                    moments.append((channel, block, load.follower, value))
                elif load.follower:
                    self._add_follower(load, value, channel)
                else:
                    dead.append(self._dead(load, value))
                    self._dead_times.append(channel)
        self.dead = np.array(dead).reshape(len(dead), rows, 3)
        self.constant = all(isinstance(t, Constant) for t in self.times)
        #: time (s) from which no channel changes
        self.settled = max(map(settled, self.times), default=-np.inf)
        self.dead_only = not self._followers and not moments
        #: what looks at the factors of all channels at a time (s): whether they leave a plane
        self.guard: Callable[[Floats, float], None] | None = None
        self._set_moments(moments)

    def _frame_block(self, vertex: int) -> int:
        assert self._frame_group is not None  # the system puts all such frames there
        return int(np.flatnonzero(self._frame_group.vertices[:, 0] == vertex)[0])

    def _set_moments(self, moments: list[tuple[int, int, bool, Floats]]) -> None:
        self._moment_channel = np.array([m[0] for m in moments], dtype=np.int64)
        self._moment_block = np.array([m[1] for m in moments], dtype=np.int64)
        self._moment_follows = np.array([m[2] for m in moments], dtype=bool)
        self._moment_value = np.array([m[3] for m in moments]).reshape(-1, 3)
        if moments:
            assert self._frame_group is not None
            self._moment_rows = self._frame_group.rows[self._moment_block][:, 1:]

    def _dead(self, load: Load, value: Floats) -> Floats:
        out = np.zeros((self._rows, 3))
        if isinstance(load, LoadGravity):
            field = np.zeros((self._rows, 3))
            field[self._origins] = value
            return self._mass @ field
        if isinstance(load, LoadLine):
            _, r = self._first[id(load.beam)]
            nodes = load.beam.basis.connectivity[load.elements]
            weights = load.beam.line_weights(load.elements)
            np.add.at(out, r + 4 * nodes, weights[:, :, None] * value)
            return out
        assert isinstance(load, LoadForce)
        _, r = self._first[id(load.place.item)]
        if load.place.triad is None:
            out[r + load.place.vertex] = value
        else:
            base = r + 4 * load.place.vertex
            out[base] = value
            out[base + 1 : base + 4] = load.place.offset[:, None] * value
        return out

    def _add_follower(self, load: Load, value: Floats, channel: int) -> None:
        """f_a = sum_b L_ab y_b with constant L: components times directors."""
        if isinstance(load, LoadLine):
            beam = load.beam
            number = next(k for k, g in enumerate(self._beam_groups) if id(beam) in g.slices)
            ids = load.elements + self._beam_groups[number].slices[id(beam)].start
            shape = beam.basis.elemental_mass()[load.elements]
            ne, nn = shape.shape[:2]
            block = np.zeros((ne, nn, 4, nn, 4))
            turned = np.einsum("i,ebij->ebj", value, beam.rotations[load.elements])
            block[:, :, 0, :, 1:] = shape[:, :, :, None] * turned[:, None]
            self._followers.append((channel, number, ids, block.reshape(ne, 4 * nn, 4 * nn)))
            return
        assert isinstance(load, LoadForce)
        v, _ = self._first[id(load.place.item)]
        block = np.zeros((1, 4, 4))
        block[0, :, 1:] = np.outer(np.concatenate([[1.0], load.place.offset]), value)
        ids = np.array([self._frame_block(v + load.place.vertex)])
        self._followers.append((channel, -1, ids, block))

    def _group(self, number: int) -> Group:
        if number >= 0:
            return self._beam_groups[number]
        assert self._frame_group is not None
        return self._frame_group

    @property
    def moments(self) -> Moments:
        """Moments on single frames."""
        vertices = np.zeros(0, dtype=np.int64)
        if self._frame_group is not None:
            vertices = self._frame_group.vertices[self._moment_block, 0]
        values = self._moment_channel, self._moment_follows, self._moment_value
        return Moments(vertices, *values)

    @property
    def dead_channels(self) -> IndexArray:
        """Channels of the dead loads."""
        return np.array(self._dead_times, dtype=np.int64)

    @property
    def followers(self) -> Followers:
        """Forces fixed in bodies and sections, frame by frame."""
        vertices: list[IndexArray] = [np.zeros((0, 2), dtype=np.int64)]
        channels: list[IndexArray] = [np.zeros(0, dtype=np.int64)]
        values = [np.zeros((0, 4, 4))]
        for channel, number, ids, block in self._followers:
            own = self._group(number).vertices[ids]
            ne, nn = own.shape
            each = block.reshape(ne, nn, 4, nn, 4).transpose(0, 1, 3, 2, 4)
            values.append(each.reshape(-1, 4, 4))
            vertices.append(np.stack([np.repeat(own, nn, 1), np.tile(own, (1, nn))], -1))
            vertices[-1] = vertices[-1].reshape(-1, 2)
            channels.append(np.full(len(values[-1]), channel))
        return Followers(np.concatenate(vertices), np.concatenate(channels), np.concatenate(values))

    # -- evaluation ------------------------------------------------------------------------------

    def averages(self, t0: float, t1: float) -> Floats:
        """Exact means of all channels over a step; computed once where nothing changes."""
        if self.constant:
            return self._numbers
        if min(t0, t1) >= self.settled:  # a pulse that is over: the same array each time
            return self._last
        return self.checked(self._each(lambda time: time.average(t0, t1)), t1)

    def values(self, t: float) -> Floats:
        """All channels at time `t`."""
        return self.checked(self._each(lambda time: time.value(t)), t)

    def checked(self, factors: Floats, t: float) -> Floats:
        """The factors of all channels at a time `t` (s), if nothing is wrong with them."""
        if self.guard is not None:
            self.guard(factors, t)
        return factors

    def _each(self, number: Callable[[TimeFunction], float]) -> Floats:
        """A number of each channel; an error of a function names its load."""
        out = np.empty(len(self.times))
        for k, time in enumerate(self.times):
            try:
                out[k] = number(time)
            except InputError as error:
                raise InputError(self.owners[k].label, str(error)) from error
        return out

    def dead_force(self, amplitudes: Floats) -> Floats:
        """Generalised force (rows, 3) of the loads that do not depend on y."""
        return self._constant_force if amplitudes is self._numbers else self._sum(amplitudes)

    @cached_property
    def _numbers(self) -> Floats:
        """All channels where none depends on time."""
        out = self.checked(self._each(lambda time: time.value(0.0)), 0.0)
        out.setflags(write=False)
        return out

    @cached_property
    def _last(self) -> Floats:
        """All channels from where they are settled on."""
        t = self.settled
        return self.checked(self._each(lambda time: time.value(t)), t)

    @cached_property
    def _constant_force(self) -> Floats:
        out = self._sum(self._numbers)
        out.setflags(write=False)
        return out

    def _sum(self, amplitudes: Floats) -> Floats:
        channels, flat = self._flat
        return (amplitudes.take(channels) @ flat).reshape(-1, 3)

    @cached_property
    def _flat(self) -> tuple[IndexArray, Floats]:
        """Channels of the dead loads, and each load in a row."""
        return self.dead_channels, self.dead.reshape(len(self.dead), 3 * self._rows)

    def force(self, y: Array, amplitudes: Floats) -> Array:
        """Generalised force (rows, 3) of the loads that depend on y (follower forces, moments)."""
        out = np.zeros((self._rows, 3), dtype=y.dtype)
        for channel, number, ids, block in self._followers:
            rows = self._group(number).rows[ids]
            np.add.at(out, rows, amplitudes[channel] * (block @ y[rows]))
        if len(self._moment_block):
            reciprocal, m = self._moments(y, amplitudes)
            np.add.at(out, self._moment_rows, 0.5 * cross(m[:, None, :], reciprocal))
        return out

    def _moments(self, y: Array, amplitudes: Floats) -> tuple[Array, Array]:
        D = y[self._moment_rows]
        reciprocal = np.linalg.inv(D).transpose(0, 2, 1)
        value = amplitudes[self._moment_channel][:, None] * self._moment_value
        spatial = (value[:, :, None] * D).sum(1)
        return reciprocal, np.where(self._moment_follows[:, None], spatial, value)

    def add_tangent(self, blocks: list[Array], y: Array, amplitudes: Floats, factor: float) -> None:
        """Add ``factor * df/dy`` to the groups' blocks (beam groups first, then frames)."""
        for channel, number, ids, block in self._followers:
            k = number if number >= 0 else len(self._beam_groups)
            scaled = factor * amplitudes[channel] * np.kron(block, np.eye(3)[None])
            np.add.at(blocks[k], ids, scaled)
        if len(self._moment_block):
            reciprocal, m = self._moments(y, amplitudes)
            f = 0.5 * cross(m[:, None, :], reciprocal)
            derivative = np.zeros((len(m), 4, 3, 4, 3), dtype=y.dtype)
            # d f_i / d d_j = -(1/2)(m x d^j) (x) d^i, and the follower's own turning
            derivative[:, 1:, :, 1:, :] = -np.einsum("ejc,eid->eicjd", f, reciprocal)
            value = amplitudes[self._moment_channel][:, None] * self._moment_value
            value = value * self._moment_follows[:, None]
            derivative[:, 1:, :, 1:, :] -= 0.5 * np.einsum(
                "eicd,ej->eicjd", skew(reciprocal), value
            )
            np.add.at(
                blocks[len(self._beam_groups)],
                self._moment_block,
                factor * derivative.reshape(-1, 12, 12),
            )
