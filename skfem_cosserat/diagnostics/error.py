"""Values of beams between their nodes, and configurations taken over to other meshes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arguments import checked
from ..errors import InputError
from ..frames import is_beam
from ..history import History
from ..kernels import beam_stress, nearest_rotations
from ..model import Model, System, system_of, takes_scene
from ..strain import strain_measures
from ..types import SAME, TOLERANCE, ArrayLike, Floats, IndexArray, check_kind, numbers, switch
from .energy import free_strains, group_of, held_forces, load_factors, section_strains
from .forces import element_balances, motion_of, part_resultants
from .stacked import as_stack, of_states

if TYPE_CHECKING:
    from ..beam import Beam

# -- configurations and velocities carried over to a system of the same scene on other meshes ------


@checked
def transfer(
    source: Model | System, target: Model | System, q: ArrayLike, v: ArrayLike | None = None
) -> tuple[Floats, Floats]:
    """Configurations and velocities of one system in another one with other meshes or orders.

    Items are matched by name. What is not a beam keeps its numbers, and so do nodes that are in
    both meshes. New nodes are where the elements interpolate the motion: the turn from the
    interpolated reference directors to the interpolated present ones is brought to the nearest
    rotation, and applied to the true reference of the node. Rigid motions and the reference itself
    are carried over exactly, whatever the elements.

    Parameters
    ----------
    source, target : Model or System
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
    From one element to two, with the end drawn by 1 %:

    >>> import skfem_cosserat as sc
    >>> section, models = sc.Section([1e4] * 6, mass=1.0, inertia=(10.0, 10.0)), []
    >>> for count in (1, 2):
    ...     models.append(sc.Model())
    ...     mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 0, 2), count)
    ...     beam = models[-1].add("beam", sc.Beam(mesh, section, director=(1, 0, 0)))
    >>> coarse, fine = (model.freeze() for model in models)
    >>> q = coarse.q0.copy()
    >>> q[14] = 2.02
    >>> middle, end = (fine.dofs(beam.node((0, 0, z)))[2] for z in (1, 2))
    >>> transfer(coarse, fine, q)[0][[middle, end]].tolist()
    [1.01, 2.02]
    """
    source = system_of(source, "argument source")
    target = system_of(target, "argument target")
    Q, single = as_stack(source, "q", q)
    if not np.isfinite(Q).all():
        raise InputError("argument q", "is not finite: rotations cannot be carried over")
    V = np.zeros_like(Q) if v is None else as_stack(source, "v", v, Q)[0]
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
        own = target.first[id(item)][1]
        count = _rows(item)
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
    known = {beam.name: beam for beam in source.beams}
    out = [np.zeros((0, 4), np.int64)]
    for beam in target.beams:
        other = known[beam.name]
        basis = beam.basis
        from ..mesh.divide import places_in

        e, x = places_in(other.mesh, beam.mesh, basis.interpolation.nodes)
        met = np.zeros(basis.n_nodes, bool)
        met[basis.connectivity] = _met(other, e, x)[0]
        out.append(target.first[id(beam)][1] + 4 * np.flatnonzero(~met)[:, None] + np.arange(4))
    return np.concatenate(out)


def _rows(item: object) -> int:
    """Rows of y that an item has."""
    vertices = item.vertices()  # type: ignore[attr-defined]
    return len(vertices) * (1 if vertices.triads is None else 4)


def _beam(source: Beam, target: Beam, y: Floats, ydot: Floats) -> tuple[Floats, Floats]:
    """Rows (N, 4 nodes, 3) of the nodes of a beam, and their rates."""
    kind = target.basis.interpolation.nodes
    from ..mesh.divide import places_in

    e, x = places_in(source.mesh, target.mesh, kind)
    nodes = target.basis.connectivity
    q, v = (a.reshape(len(a), -1, 4, 3) for a in (y, ydot))
    places = SectionPlaces(source, e.ravel(), x.ravel().clip(0, 1))
    now, rate, start = (
        places.at_points(a).reshape(len(a), *x.shape, 4, 3)
        for a in (y, ydot, source.reference.reshape(1, -1, 3))
    )
    turn = nearest_rotations(now[..., 1:, :].swapaxes(-1, -2) @ start[..., 1:, :])
    spin = spins(now, rate)
    own = target.reference.reshape(-1, 4, 3)[nodes]
    moved, moving = _moved(now, rate, start, turn, spin, own)
    reference = source.reference.reshape(1, -1, 4, 3)
    met, node = _met(source, e, x)
    k = node[met]  # a node of both keeps its numbers
    same = (abs(own[met] - reference[0, k]).max((1, 2)) <= SAME)[:, None, None]
    moved[:, met] = np.where(same, q[:, k], moved[:, met])
    moving[:, met] = np.where(same, v[:, k], moving[:, met])
    shape = (len(q), len(target.basis.nodes), 4, 3)
    out = np.empty(shape), np.empty(shape)
    for field, values in zip(out, (moved, moving), strict=True):
        field[:, nodes] = values
    return out[0].reshape(len(q), -1, 3), out[1].reshape(len(q), -1, 3)


def spins(now: Floats, rate: Floats) -> Floats:
    """Angular velocities (..., 3) that come nearest to the rates of directors."""
    d = now[..., 1:, :]
    ddot = rate[..., 1:, :]
    inertia = (d * d).sum(axis=(-2, -1))[..., None, None] * np.eye(3) - d.swapaxes(-1, -2) @ d
    return np.linalg.solve(inertia, np.cross(d, ddot).sum(-2)[..., None])[..., 0]


def _moved(
    now: Floats, rate: Floats, start: Floats, turn: Floats, spin: Floats, own: Floats
) -> tuple[Floats, Floats]:
    """Frames (..., 4, 3) with a reference of their own that are rigid with places, their rates."""
    back = turn.swapaxes(-1, -2)
    frames = np.empty_like(now)
    rates = np.empty_like(rate)
    arm = (own[..., None, 0, :] - start[..., None, 0, :]) @ back
    frames[..., 0, :] = now[..., 0, :] + arm[..., 0, :]
    frames[..., 1:, :] = own[..., 1:, :] @ back
    rates[..., 0, :] = rate[..., 0, :] + np.cross(spin, arm[..., 0, :])
    rates[..., 1:, :] = np.cross(spin[..., None, :], frames[..., 1:, :])
    return frames, rates


def _met(beam: Beam, e: np.ndarray, x: Floats) -> tuple[np.ndarray, np.ndarray]:
    """True for places that are at a node of a beam, and the nearest node of each place."""
    gaps = abs(x[..., None] - beam.basis.interpolation.nodes)
    nearest = gaps.argmin(-1)
    node = np.take_along_axis(beam.basis.connectivity[e], nearest[..., None], axis=-1)[..., 0]
    return gaps.min(-1) <= TOLERANCE, node


# -- beams at any point inside their elements: place, triad, strains and resultants ----------------


class SectionValues(NamedTuple):
    """Result of :func:`evaluate` at m points; with N states there is a leading axis N."""

    #: Places (m, 3) in m.
    position: Floats
    #: Section directors (m, 3, 3), d_{i+1} in row i.
    triad: Floats
    #: ``(Gamma, K)`` (m, 6), relative to the interpolated reference (-, 1/m).
    strain: Floats
    #: Elastic ``(N, M)`` (m, 6) that belong to these strains, in the section's frame, on the face
    #: with outward normal +d3 (N, N m).
    resultant: Floats


@takes_scene
@of_states
def evaluate(
    system: System,
    beam: Beam,
    q: ArrayLike,
    elements: ArrayLike,
    xi: ArrayLike,
    *,
    orthonormal: bool = False,
    multipliers: ArrayLike | None = None,
    t: ArrayLike = 0.0,
    amplitudes: ArrayLike | None = None,
) -> SectionValues:
    """A beam at any points inside its elements.

    Parameters
    ----------
    beam : Beam
        Of this system.
    q : (n,) or (N, n) array
        Configurations.
    elements, xi : (m,) array
        Elements and reference coordinates in [0, 1]; by arc length: ``*beam.along(s, part)``.
    orthonormal : bool
        Triads orthonormal, by polar decomposition: the rotations nearest to the interpolated
        directors.
    multipliers : (m,) or (N, m) array, optional
        As of :func:`multipliers`: resultants of strains that the beam's theory holds, interpolated
        from the Gauss points; NaN without.
    t : float or (N,) array
        Times (s) of the configurations, for strains that change: :class:`LoadStrain`.
    amplitudes : (k,) or (N, k) array, optional
        Factors of the channels of loads instead of those at `t`: ``path["amplitudes/loads"]``.

    Returns
    -------
    SectionValues
        ``position``, ``triad``, ``strain``, ``resultant``.

    Raises
    ------
    InputError
        If the beam is not in the system, an element is not in the beam, a coordinate not in
        [0, 1], or the shape of `q` does not fit the system.

    Notes
    -----
    Directors are interpolated as they are (113). At nodes they are orthonormal, between them not:
    ``d_i.d_j`` deviates by an amount that vanishes with h^(p+1) (a linear element that turns by
    an angle t has directors of length cos(t/2) in its middle). Positions and triads converge with
    h^(p+1), strains and resultants with h^p, and with h^(p+1) at the Gauss points, where
    :func:`section_strains` takes them; away from these a stiffness in shear makes large forces of
    small errors. Section forces at any point are those of
    :func:`~skfem_cosserat.diagnostics.forces_along`, which needs a balance.

    Examples
    --------
    A rod along x, 2 m long and drawn by 1 %, at 0.5 m and 1.5 m:

    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> mesh = sc.MeshCurve.init_line((0, 0, 0), (2, 0, 0), 1, name="rod")
    >>> rod = model.add("rod", sc.Beam(mesh, sc.Section([1e4] * 6, 1.0, (10.0, 10.0))))
    >>> system = model.freeze()
    >>> q = system.q0.copy()
    >>> q[system.dofs(rod.node("rod.end"))[0]] = 2.02
    >>> at = evaluate(system, rod, q, *rod.along([0.5, 1.5]))
    >>> at.position[:, 0].round(9).tolist(), at.resultant[:, 2].round(9).tolist()
    ([0.505, 1.515], [100.0, 100.0])
    """
    places = SectionPlaces(beam, elements, xi)
    factors = load_factors(system, t, amplitudes, len(np.asarray(q)))
    return places.values(system, q, factors, orthonormal=orthonormal, multipliers=multipliers)


@takes_scene
def forces_along(
    system: System, history: History, beam: Beam, s: ArrayLike, part: str | None = None
) -> Floats:
    """Section forces ``(N_1, N_2, N_3, M_1, M_2, M_3)`` at arc lengths of a beam, of a history.

    As :class:`~skfem_cosserat.SensorForce` sees them during a run, at all recorded states: without
    the viscous forces of sections.

    Parameters
    ----------
    history : History
        Of a run of this system, or a path of equilibria.
    beam : Beam
        Of this system.
    s : float or (m,) array
        Arc lengths in the reference from the start of the part (m).
    part : str, optional
        Name of a part of the mesh; default: the whole beam.

    Returns
    -------
    (N, m, 6) array
        In the section triad, on the face with outward normal +d3; tension positive (N, N m).

    Raises
    ------
    InputError
        If the history does not fit the system, the beam is not in it, or `s` is beyond the ends.
    HistoryError
        If events changed its joints or loads on the way: take ``history.segment(k)`` then, with
        the system of that segment.

    Notes
    -----
    By the balance of the part of an element from its ends to the point, in motion with
    :func:`accelerations`. They converge with h^(2p) at the ends of elements, where they are those
    of :func:`~skfem_cosserat.diagnostics.nodal_resultants`, and between them where loads are forces
    and moments at nodes, dead line loads or gravity, on straight beams. Between the ends inertia,
    following line loads and the curvature of the reference are known to h^(p+2) only: this matters
    for p = 3 and 4. At a node where a load, body or joint acts they jump; there they are those of
    the element that :meth:`Beam.along` takes: give an arc length beside the node.

    Examples
    --------
    A rod of 2 m that hangs from one end and weighs 10 N/m:

    >>> import skfem_cosserat as sc
    >>> model, mesh = sc.Model(), sc.MeshCurve.init_line((0, 0, 0), (0, 0, -2), 1, name="rod")
    >>> section = sc.Section([1e6] * 6, 1.0, (0.1, 0.1))
    >>> rod = model.add("rod", sc.Beam(mesh, section, director=(1, 0, 0)))
    >>> clamp = model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    >>> weight = model.add("weight", sc.LoadGravity((0, 0, -10.0)))
    >>> path = sc.static(model)
    >>> (forces_along(model, path, rod, [0.0, 0.5, 2.0])[-1, :, 2].round(6) + 0.0).tolist()
    [20.0, 15.0, 0.0]
    """
    check_kind("argument history", history, History)
    history.check_one_system()
    q, _ = as_stack(system, "history", history["q"])
    places = SectionPlaces(beam, *beam.along(np.atleast_1d(s), part))
    return places.resultants(system, q, *motion_of(system, history))


class SectionPlaces:
    """Points of a beam, and what :func:`evaluate` needs there whatever the configuration is.

    Parameters
    ----------
    beam, elements, xi
        As for :func:`evaluate`.
    """

    def __init__(self, beam: Beam, elements: ArrayLike, xi: ArrayLike):
        self.beam = beam
        self._e, self._x = e, x = _places(beam, elements, xi)
        lengths = beam.elements.lengths[e][:, None]
        self._shapes = beam.basis.shape(x).T, beam.basis.dshape(x).T / lengths
        self._turned = beam.rotations[e]
        self._sections = beam.section_points(e, x[:, None])
        self._own = (4 * beam.basis.connectivity[e][:, :, None] + np.arange(4)).reshape(len(e), -1)
        self._reference = self._at(beam.reference.reshape(1, -1, 3)[:, self._own])[1]
        free = np.zeros((len(e), 1, 6)) + beam.strains_at(e, x[:, None])
        self._reference = self._reference + free[:, 0]

    def at_points(self, y: Floats) -> Floats:
        """Values (k, m, 4, 3) of phi, d1, d2, d3 there, of rows (k, rows, 3) of the beam alone."""
        return self._at(y[:, self._own])[0]

    def _at(self, y: Floats) -> tuple[Floats, Floats]:
        """Values (k, m, 4, 3) of phi, d1, d2, d3 of the sections, and their strains (k, m, 6)."""
        nodal = y.reshape(*y.shape[:2], -1, 4, 3).copy()
        nodal[..., 1:, :] = self._turned @ nodal[..., 1:, :]
        value, slope = (np.einsum("ma,kmaic->kmic", S, nodal) for S in self._shapes)
        return value, strain_measures(value, slope)

    def values(
        self,
        system: System,
        q: ArrayLike,
        factors: Floats | None = None,
        *,
        orthonormal: bool = False,
        multipliers: ArrayLike | None = None,
    ) -> SectionValues:
        """Positions, triads, strains and resultants at the places, see :func:`evaluate`."""
        Q = np.reshape(q, (-1, system.rows, 3))
        beam = self.beam
        group = group_of(system, self.beam)
        value, strain = self._at(Q[:, group.rows[group.slices[id(beam)]][self._e]])
        strain = strain - self._reference
        triad = value[:, :, 1:]
        if switch("argument orthonormal", orthonormal):
            triad = nearest_rotations(triad)
        from ..element import lagrange  # imports scikit-fem, which rigid bodies do without

        weights = lagrange(beam.elements.points, self._x)
        elastic = strain
        if factors is not None:
            free = free_strains(system, beam, factors)[:, self._e]
            elastic = strain - np.einsum("gm,kmgi->kmi", weights, free)
        resultant = beam_stress(self._sections, elastic[:, :, None])[:, :, 0]
        held = np.asarray(held_forces(system, beam, multipliers, len(Q)))
        if held.ndim:
            resultant = resultant + np.einsum("gm,kmgi->kmi", weights, held[:, self._e])
        return SectionValues(value[:, :, 0], triad, strain, resultant)

    def resultants(self, system: System, q: ArrayLike, *motion: Any) -> Floats:
        """By the balance of parts of elements, see :func:`forces_along`.

        `motion`: as for :func:`element_balances`.
        """
        beam = self.beam
        t, amplitudes, *_ = motion
        (found,) = element_balances(system, [beam], q, *motion, viscous=False)
        factors = load_factors(system, t, amplitudes, len(found.force))
        strains = section_strains(system, beam, q)
        free = free_strains(system, beam, factors)
        return part_resultants(beam, self._e, self._x, found, strains, free)


def _places(beam: Beam, elements: ArrayLike, xi: ArrayLike) -> tuple[IndexArray, Floats]:
    from ..mesh.topology import element_numbers

    e = element_numbers(elements, len(beam.basis.connectivity))
    x = numbers(beam.label, "xi", xi)
    if x.shape not in ((), e.shape):
        raise InputError(beam.label, f"xi has shape {x.shape}, expected {e.shape} as elements")
    x = np.broadcast_to(x, e.shape)
    wrong = ~((x >= 0) & (x <= 1))
    if wrong.any():
        raise InputError(beam.label, f"xi = {x[wrong][0]} in element {e[wrong][0]}, not in [0, 1]")
    return e, x
