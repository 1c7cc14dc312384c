"""Scenes in time, runs that hit all instants and kinks of loads, and the limit of their steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from measuring import full_newton
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import skfem_cosserat as sc
from collection import common
from skfem_cosserat import diagnostics

__all__ = ["Motion", "Run", "Scene", "framed", "limit", "quaternions", "run", "schedule"]

Floats = common.Floats


class Scene(NamedTuple):
    """A frozen scene, the places that are looked at, and instants (s) that must be ends of steps.

    ``start`` is a state to begin with (default: at rest as it was drawn); ``frames`` the sections'
    axes e1, e2, e3 (as rows) at the start where quaternions are not to be the identity there;
    ``part`` a system with the same coordinates, whose kinetic energy is meant (default: all).
    """

    system: sc.System
    places: dict[str, Any]
    kinks: tuple[float, ...] = ()
    start: Any = None
    frames: dict[str, Floats] | None = None
    part: Any = None

    @property
    def frames_in_q(self) -> NDArray[np.int64]:
        """Numbers in q of the places' frames (k, 12)."""
        return np.array([self.system.dofs(place) for place in self.places.values()])

    def positions(self, q: Floats) -> Floats:
        """(N, k, 3) of configurations (N, n), in m."""
        return q[:, self.frames_in_q[:, :3]]

    def rotations(self, q: Floats) -> Floats:
        """(N, k, 3, 3): matrices that turn the reference triads into those of configurations."""
        now, start = (
            np.reshape(x, (-1, x.shape[-1]))[:, self.frames_in_q[:, 3:]]
            for x in (q, self.system.q0)
        )
        shape = (-1, len(self.places), 3, 3)
        return np.einsum("nkij,kil->nkjl", now.reshape(shape), start.reshape(shape)[0])


class Motion(NamedTuple):
    """Positions, rotations and velocities of a scene's places, and the energy, at some times."""

    positions: Floats
    rotations: Floats
    velocities: Floats
    energy: Floats

    @property
    def placement(self) -> Floats:
        """Positions and rotations at the last time, in one row."""
        return np.concatenate([self.positions[-1].ravel(), self.rotations[-1].ravel()])


@dataclass
class Run:
    """What a run gave: motion at the instants asked for (nan where it did not get to).

    ``turned`` (N, k, 4) are quaternions followed from step to step, of which only the sign is
    used; ``step`` the largest step (s).
    """

    motion: Motion
    turned: Floats
    step: float
    iterations: int = 0
    converged: bool = True


def schedule(step: float, marks: Sequence[float], refine: int = 1) -> list[tuple[float, float]]:
    """Stretches (end, step): equal steps of at most `step`, divided by `refine`, up to each mark.

    >>> schedule(0.25, [0.5, 1.0, 1.125])
    [(1.0, 0.25), (1.125, 0.125)]
    """
    out: list[tuple[float, float]] = []
    begin = 0.0
    for end in marks:
        count = max(1, int(np.ceil((end - begin) / step * (1 - 1e-9))))
        h = (end - begin) / count / refine
        for known in (step / refine, *(one for _, one in out[-1:])):
            h = known if np.isclose(h, known, rtol=1e-9, atol=0) else h
        if out and h == out[-1][1]:
            out.pop()
        out.append((end, h))
        begin = end
    return out


class _Watch:
    """Follows the places' triads through a run, and counts iterations."""

    def __init__(self, scene: Scene, state: sc.State) -> None:
        self.columns = scene.frames_in_q[:, 3:].ravel()
        self.times, self.triads = [state.time], [state.q[self.columns]]
        self.state, self.iterations = state, 0

    def __call__(self, report: Any) -> bool:
        self.state = report.state
        self.iterations += report.iterations
        self.times.append(self.state.time)
        self.triads.append(self.state.q[self.columns])
        return False

    def quaternions(self) -> Floats:
        """(N, k, 4), scalar first, the identity at the start, without jumps of sign."""
        triads = np.array(self.triads).reshape(len(self.times), -1, 3, 3)
        matrices = np.einsum("nkij,kil->nkjl", triads, triads[0])
        return _continuous(quaternions(matrices))


def quaternions(matrices: Floats) -> Floats:
    """Scalar first, (..., 4) of the rotations nearest to (..., 3, 3)."""
    flat = matrices.reshape(-1, 3, 3)
    out = np.full((len(flat), 4), np.nan)
    good = np.isfinite(flat).all(axis=(1, 2))
    if good.any():
        out[good] = np.roll(Rotation.from_matrix(flat[good]).as_quat(), 1, axis=1)
    return out.reshape(*matrices.shape[:-2], 4)


def _continuous(quaternions: Floats) -> Floats:
    """With the signs that leave no jump along the first axis, the first scalar positive."""
    steps = np.sign((quaternions[1:] * quaternions[:-1]).sum(-1))
    first = np.where(quaternions[:1, ..., 0] < 0, -1.0, 1.0)
    signs = np.concatenate([first, first * np.cumprod(np.where(steps < 0, -1.0, 1.0), axis=0)])
    return quaternions * signs[..., None]


def run(
    scene: Scene,
    integrator: Any,
    treatment: Any,
    step: float,
    times: Sequence[float],
    refine: int = 1,
    kernels: str = "auto",
) -> Run:
    """A run seen at some instants (s), with steps of at most ``step / refine``.

    The energy is kinetic plus stored energy at (q, p), which energy-momentum conserves; with the
    variational integrator, and where motions are prescribed, at (q, Qp): what the constraints take
    out of its nodal p, of second order in the step, grows with the number of elements.
    `kernels` are as in :func:`skfem_cosserat.simulate`.
    """
    system, wanted = scene.system, np.asarray(times, dtype=float)
    until = wanted.max()
    state = sc.initial_state(system) if scene.start is None else scene.start
    watch, converged, largest = _Watch(scene, state), True, 0.0
    q, p = (np.full((len(wanted), system.n), np.nan) for _ in range(2))
    at_start = abs(wanted) <= 1e-12 * until
    q[at_start], p[at_start] = state.q, state.p
    for end, h in schedule(step, _marks(scene, wanted), refine):
        largest = max(largest, h)
        options: dict[str, Any] = {"start": watch.state, "callbacks": [watch]}
        # extrapolation would magnify what kept factors leave
        options.update(derive=False, kernels=kernels, settings=full_newton())
        inside = wanted[(wanted > watch.state.time) & (wanted < end + h / 2)].tolist()
        try:
            history = sc.simulate(
                system, integrator, treatment, h, end + 1e-6 * h, at=[*inside, end], **options
            )
        except sc.Diverged as failure:
            history, converged = failure.history, False
        miss = abs(history.times - wanted[:, None])
        found = miss.min(axis=1) < 1e-6 * h
        q[found], p[found] = (history[x][miss.argmin(axis=1)[found]] for x in ("q", "p"))
        if not converged:
            break
    motion = _motion(scene, q, p, wanted, integrator)
    nearest = np.searchsorted(watch.times, wanted - 1e-9 * until).clip(max=len(watch.times) - 1)
    turned = watch.quaternions()[nearest]
    return Run(motion, turned, largest, watch.iterations, converged)


def _marks(scene: Scene, times: Floats) -> list[float]:
    """Instants and kinks that must be ends of steps."""
    until = max(times)
    return sorted({float(f"{t:.12g}") for t in (*times, *scene.kinks) if 0 < t <= until})


def _motion(scene: Scene, q: Floats, p: Floats, times: Floats, integrator: Any) -> Motion:
    """Where q and p are known; nan elsewhere."""
    system, good = scene.system, np.isfinite(q).all(axis=1)
    k = len(scene.places)
    shapes = ((k, 3), (k, 3, 3), (k, 3), ())
    out = Motion(*(np.full((len(q), *shape), np.nan) for shape in shapes))
    if not good.any():
        return out
    q, p = q[good], p[good]
    v, projected = sc.Projection(system).stack(q, p, times[good])
    keeps = isinstance(integrator, sc.EnergyMomentum) and not system.moving
    if scene.part is None:
        energy = diagnostics.kinetic_energy(system, p if keeps else projected)
    else:
        energy = diagnostics.kinetic_energy_of_velocity(scene.part, v)
    energy = energy + diagnostics.strain_energy(system, q)
    found = (scene.positions(q), scene.rotations(q), scene.positions(v), energy)
    for array, value in zip(out, found, strict=True):
        array[good] = value
    return out


def limit(steps: Sequence[float], motions: Sequence[Motion]) -> Motion:
    """Limit of vanishing step of runs whose error has even powers of the step (Neville)."""
    squares = [step**2 for step in steps]
    fields = zip(*motions, strict=True)
    return Motion(*(common.neville(field, squares)[-1][-1] for field in fields))


def framed(turns: Floats, frames: Sequence[Floats]) -> Floats:
    """Body to space for bodies whose axes at the start are the rows of `frames`."""
    start = _continuous(quaternions(np.array([np.transpose(f) for f in frames]))[None])[0]
    w, x = turns[..., :1], turns[..., 1:]
    w0, x0 = start[:, :1], start[:, 1:]
    scalar = w * w0 - (x * x0).sum(-1, keepdims=True)
    return np.concatenate([scalar, w * x0 + w0 * x + np.cross(x, x0)], axis=-1)
