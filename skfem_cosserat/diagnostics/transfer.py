"""Configurations and velocities carried over to a system of the same scene on other meshes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..kinds import is_beam
from ..model import System
from ..types import ArrayLike, Floats, IndexArray
from .stacks import as_stack

if TYPE_CHECKING:
    from ..beam import Beam

__all__ = ["new_rows", "spins", "transfer"]

#: reference frames closer than this are the same, and their values are copied
SAME = 1e-12


def transfer(
    source: System, target: System, q: ArrayLike, v: ArrayLike | None = None
) -> tuple[Floats, Floats]:
    """Configurations and velocities of one system in another one with other meshes or orders.

    Items are matched by name. What is not a beam keeps its numbers, and so do nodes that are in
    both meshes. New nodes are where the elements interpolate the motion: the turn from the
    interpolated reference directors to the interpolated present ones is brought to the nearest
    rotation, and applied to the true reference of the node. Rigid motions and the reference itself
    are carried over exactly, whatever the elements.

    Parameters
    ----------
    source, target : System
        Beams of the same names on meshes of the same lines, see
        :meth:`skfem_cosserat.MeshCurve.refined`; of any orders.
    q : (n,) or (N, n) array
        Configurations of `source`.
    v : (n,) or (N, n) array, optional
        Velocities, which fulfil the internal constraints; default: zero.

    Returns
    -------
    q, v : (n,) or (N, n) arrays
        Of `target`; triads are orthonormal, and velocities those of rotations.

    Raises
    ------
    InputError
        If an item is missing in `source`, or is another kind of item there.
    MeshError
        If the meshes of a beam do not divide the same lines.

    Examples
    --------
    >>> from skfem_cosserat import Beam, MeshCurve, Model, Section
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> systems = []
    >>> for count in (1, 2):
    ...     model = Model()
    ...     mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 2), count)
    ...     beam = model.add("beam", Beam(mesh, section, director=(1, 0, 0)))
    ...     systems.append(model.freeze())
    >>> q = systems[0].q0
    >>> q[14] = 2.02   # the end, drawn by 1 %
    >>> transfer(*systems, q)[0][[2, 14, 26]].tolist()
    [0.0, 1.01, 2.02]
    """
    Q, single = as_stack(source, "q", q)
    V = np.zeros_like(Q) if v is None else as_stack(source, "v", v)[0]
    if V.shape != Q.shape:
        raise InputError("argument v", f"has shape {V.shape}, q has {Q.shape}")
    known = {item.name: item for item in source.structures}
    y, ydot = (a.reshape(len(Q), source.rows, 3) for a in (Q, V))
    out = np.empty((2, len(Q), target.rows, 3))
    for item in target.structures:
        if id(item) not in target.first:
            continue
        other = known.get(item.name)
        if other is None or other.kind != item.kind or id(other) not in source.first:
            raise InputError(
                item.label, f"is not in the system before: it has {sorted(map(str, known))}"
            )
        own, count = target.first[id(item)][1], _rows(item)
        row = source.first[id(other)][1]
        part = slice(row, row + _rows(other))
        if is_beam(item) and is_beam(other):
            values = _beam(other, item, y[:, part], ydot[:, part])
        elif count == _rows(other):
            values = (y[:, part], ydot[:, part])
        else:
            raise InputError(item.label, f"has {count} rows, {_rows(other)} in the system before")
        out[:, :, own : own + count] = values
    found = out.reshape(2, len(Q), target.n)
    return (found[0, 0], found[1, 0]) if single else (found[0], found[1])


def new_rows(source: System, target: System) -> IndexArray:
    """Rows (k, 4) of y of the nodes of beams in `target` that are no nodes of `source`.

    Raises
    ------
    MeshError
        If the meshes of a beam do not divide the same lines.
    """
    known = {item.name: item for item in source.structures if is_beam(item)}
    out = [np.zeros((0, 4), dtype=np.int64)]
    for beam in (item for item in target.structures if is_beam(item)):
        other, basis = known[beam.name], beam.basis
        from ..mesh.relate import places_in

        e, x = places_in(other.mesh, beam.mesh, basis.interpolation.nodes)
        met = np.zeros(basis.n_nodes, dtype=bool)
        met[basis.connectivity] = _met(other, e, x)[0]
        nodes = np.flatnonzero(~met)
        out.append(target.first[id(beam)][1] + 4 * nodes[:, None] + np.arange(4))
    return np.concatenate(out)


def _rows(item: object) -> int:
    """Rows of y that an item has."""
    vertices = item.vertices()  # type: ignore[attr-defined]
    return len(vertices) * (1 if vertices.triads is None else 4)


def _beam(source: Beam, target: Beam, y: Floats, ydot: Floats) -> tuple[Floats, Floats]:
    """Rows (N, 4 nodes, 3) of the nodes of a beam, and their rates."""
    kind = target.basis.interpolation.nodes
    from ..mesh.relate import places_in

    e, x = places_in(source.mesh, target.mesh, kind)
    nodes = target.basis.connectivity
    q, v = (a.reshape(len(a), -1, 4, 3) for a in (y, ydot))
    reference = source.reference.reshape(1, -1, 4, 3)
    now, rate, start = (_inside(source, e, x, a) for a in (q, v, reference))
    turn, spin = _turn(now[..., 1:, :], start[..., 1:, :]), spins(now, rate)
    own = target.reference.reshape(-1, 4, 3)[nodes]
    moved, moving = _moved(now, rate, start, turn, spin, own)
    met, node = _met(source, e, x)
    if met.any():
        # a node of both: its own triad, not the one interpolated by this element
        k = node[met]
        now, rate, start = q[:, k], v[:, k], reference[:, k]
        turn = np.swapaxes(now[..., 1:, :], -1, -2) @ start[..., 1:, :]
        at, along = _moved(now, rate, start, turn, spins(now, rate), own[met])
        same = (abs(own[met] - start[0]).max(axis=(1, 2)) <= SAME)[:, None, None]
        moved[:, met] = np.where(same, now, at)
        moving[:, met] = np.where(same, rate, along)
    shape = (len(q), len(target.basis.nodes), 4, 3)
    out = np.empty(shape), np.empty(shape)
    for field, values in zip(out, (moved, moving), strict=True):
        field[:, nodes] = values
    return out[0].reshape(len(q), -1, 3), out[1].reshape(len(q), -1, 3)


def _inside(beam: Beam, e: np.ndarray, x: Floats, nodal: Floats) -> Floats:
    """Values (N, ne, n, 4, 3) of sections inside elements of nodal frames (N, nodes, 4, 3)."""
    local = nodal[:, beam.basis.connectivity[e]]
    local = local.copy()
    local[..., 1:, :] = beam.rotations[e] @ local[..., 1:, :]
    return np.asarray(np.einsum("aef,kefaic->kefic", beam.basis.shape(x), local))


def _turn(d: Floats, start: Floats) -> Floats:
    """Rotations (..., 3, 3) nearest to ``sum d_i D_i^T``."""
    u, _, vt = np.linalg.svd(np.swapaxes(d, -1, -2) @ start)
    return np.asarray(u @ vt)


def spins(now: Floats, rate: Floats) -> Floats:
    """Angular velocities (..., 3) that come nearest to the rates of directors."""
    d, ddot = now[..., 1:, :], rate[..., 1:, :]
    squares = (d * d).sum(axis=(-2, -1))[..., None, None] * np.eye(3)
    inertia = squares - np.swapaxes(d, -1, -2) @ d
    momentum = np.cross(d, ddot).sum(axis=-2)
    return np.asarray(np.linalg.solve(inertia, momentum[..., None])[..., 0])


def _moved(
    now: Floats, rate: Floats, start: Floats, turn: Floats, spin: Floats, own: Floats
) -> tuple[Floats, Floats]:
    """Frames (..., 4, 3) with a reference of their own that are rigid with places, their rates."""
    back = np.swapaxes(turn, -1, -2)
    frames, rates = np.empty_like(now), np.empty_like(rate)
    arm = (own[..., None, 0, :] - start[..., None, 0, :]) @ back
    frames[..., 0, :] = now[..., 0, :] + arm[..., 0, :]
    frames[..., 1:, :] = own[..., 1:, :] @ back
    rates[..., 0, :] = rate[..., 0, :] + np.cross(spin, arm[..., 0, :])
    rates[..., 1:, :] = np.cross(spin[..., None, :], frames[..., 1:, :])
    return frames, rates


def _met(beam: Beam, e: np.ndarray, x: Floats) -> tuple[np.ndarray, np.ndarray]:
    """Which places are at nodes of a beam, and at which."""
    gaps = abs(x[..., None] - beam.basis.interpolation.nodes)
    nearest = gaps.argmin(axis=-1)
    node = np.take_along_axis(beam.basis.connectivity[e], nearest[..., None], axis=-1)[..., 0]
    from ..mesh.relate import MEETS

    return gaps.min(axis=-1) <= MEETS, node
