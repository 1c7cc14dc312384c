"""The plane in which a scene moves.

Nothing leaves the plane of a scene that equals its mirror image: an in-plane state has in-plane
forces only. So of every item it is asked whether its mirror image is itself (:func:`out_of_plane`);
with the components ``nu`` of the plane's normal in a frame, what is material is reflected by
``S = 1 - 2 nu nu^T``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ..body import MassPoint, RigidBody
from ..coupling import Coupling, JointActuator, JointSpringDamper
from ..errors import InputError
from ..frames import Place, is_beam, unit_vector
from ..frozen import Frozen
from ..joint import Joint
from ..kernels import cross, exp_quaternion, rotation_matrix
from ..law import Law
from ..load import Term
from ..relative import normals
from ..time_function import Constant
from ..types import SAME, TOLERANCE, ArrayLike, Floats, IndexArray, shown
from .force_elements import Couplings
from .groups import lumped
from .loading import Loading

if TYPE_CHECKING:
    from ..beam import Beam
    from .system import System

#: of states against the plane, relative: they come from runs
OFF_PLANE = 1e-8


class Planar(Frozen):
    """Asks for a scene in which everything moves in one plane.

    For :meth:`Model.freeze`. Unknowns out of the plane are not there at all: two displacements and
    one rotation for each frame, and only the constraints that act in the plane. All results are
    those of the scene in space, to rounding; histories hold all coordinates. What is out of the
    plane cannot be found, however: no modes, no bifurcations there. Compiled kernels have the
    unknowns of space, and keep the scene in its plane. There are no explicit schemes for it.

    Scenes that are their own mirror image by pairs of items, on either side of a plane, are not
    meant here, where each item is its own image: they are halved by leaving one half out. What the
    mirror plane cuts is held by ``JointPlanar(ground(x), node, normal)``, with its normal: the node
    stays in the plane and turns about the normal only, and the joint's force and moment are what
    the other half passes on. Loads, masses and springs on the plane count half. Motions that are
    not symmetric, modes and bifurcations among them, cannot be found then.

    Parameters
    ----------
    normal : (3,) array, optional
        Unit vector normal to the plane; default: found from geometry, sections, loads, joints
        and velocities.

    Examples
    --------
    A pendulum has one coordinate in space, too; its bob on a rod alone has two:

    >>> from skfem_cosserat import JointDistance, LoadGravity, MassPoint, Model, Planar, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(1.0, position=(1.0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> weight = model.add("weight", LoadGravity((0, 0, -9.81)))
    >>> model.freeze().unknowns, model.freeze(planar=Planar()).unknowns
    (2, 1)
    """

    def __init__(self, normal: ArrayLike | None = None):
        self.normal = None if normal is None else unit_vector("planar scene", "normal", normal)

    def __repr__(self) -> str:
        return f"Planar({'' if self.normal is None else f'normal={self.normal.tolist()}'})"


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane in space.

    Attributes
    ----------
    normal : (3,) array
        Unit vector, of the two the one whose largest component is positive.
    point : (3,) array
        In the plane (m).
    length : float
        Extent of the scene (m), which distances from the plane are compared with.

    Examples
    --------
    >>> plane = Plane(np.array([0, 0, -1.0]), np.array([0, 0, 2.0]))
    >>> plane.normal.tolist(), plane.axes.tolist(), float(plane.height(np.array([5.0, 1, 2.5])))
    ([0.0, 0.0, 1.0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 0.5)
    """

    normal: Floats
    point: Floats
    length: float = 1.0

    def __post_init__(self) -> None:
        n = np.where(abs(self.normal) < SAME, 0.0, self.normal) / np.linalg.norm(self.normal)
        n = n * np.sign(n[np.argmax(abs(n))])
        object.__setattr__(self, "normal", n + 0.0)

    def __repr__(self) -> str:
        return f"<plane normal to {self.normal.tolist()}>"

    @cached_property
    def axes(self) -> Floats:
        """Two unit vectors (2, 3) along the plane, with ``axes[0] x axes[1] = normal``."""
        k = np.flatnonzero(self.normal)
        if len(k) == 1:  # axes of space, in which each coordinate is in the plane or out of it
            return np.eye(3)[[(k[0] + 1) % 3, (k[0] + 2) % 3]]
        return normals(self.normal)

    def height(self, x: Floats) -> Floats:
        """Distance (...) of points (..., 3) from the plane (m)."""
        return (x - self.point) @ self.normal

    def moving(self, y0: Floats, origins: IndexArray) -> IndexArray:
        """Numbers of the rows of y that change: not of directors along the normal.

        Parameters
        ----------
        y0 : (rows, 3) array
            Reference configuration.
        origins : int array
            Rows that are positions.
        """
        moves = np.linalg.norm(y0 @ self.axes.T, axis=1) > TOLERANCE
        moves[origins] = True
        return np.flatnonzero(moves)

    def mirror(self, triad: Floats) -> Floats:
        """``S`` (..., 3, 3) of frames with these rows d1, d2, d3 (..., 3, 3)."""
        nu = triad @ self.normal
        return np.eye(3) - 2 * nu[..., :, None] * nu[..., None, :]

    def off_plane(self, place: Place, t: float) -> float:
        """Deviation of a moving ground place from the plane: by the extent, or rad."""
        if place.motion is None:
            return 0.0
        frame = place.motion.frame(place, t)
        rise = abs((frame[0] - place.position) @ self.normal) / self.length
        return max(rise, abs(frame[1:] @ self.normal - self.normal).max())

    def check_ground(self, place: Place, t: float) -> None:
        """Raise InputError if a ground place in prescribed motion is out of the plane."""
        off = self.off_plane(place, t)
        if off > OFF_PLANE:
            raise InputError(
                place.label,
                f"its prescribed motion leaves the plane normal to {self.normal.tolist()} that the"
                f" scene is confined to, by {off:.6g} (of the extent, or rad) at t = {t:g} s",
            )

    def check(
        self,
        item: str,
        what: str,
        numbers: Floats,
        origins: IndexArray,
        start: Floats | None = None,
        power: int = -1,
    ) -> None:
        """A configuration (n,) is off the plane where the reference `start` is, rates are nowhere.

        Parameters
        ----------
        item, what : str
            Named by the error.
        numbers : (n,) array
            Configuration, velocity or momentum.
        origins : int array
            Rows that are of positions: times a power of the extent of the scene they are compared
            with those of directors.
        start : (n,) array, optional
            Reference configuration; default: `numbers` are no configuration.
        power : {-1, 1}
            1: a momentum.

        Raises
        ------
        InputError
            If it leaves the plane.
        """
        rows = numbers.reshape(-1, 3)
        rise = (rows if start is None else rows - start.reshape(-1, 3)) @ self.normal
        scale = np.ones(len(rows))
        scale[origins] = self.length**power
        worst = (scale * abs(rise)).argmax()
        size = float((scale[:, None] * abs(rows)).max()) if start is None else 1.0
        if scale[worst] * abs(rise[worst]) > OFF_PLANE * size:
            raise InputError(
                item,
                f"{what} leaves the plane normal to {self.normal.tolist()} that the scene is"
                f" confined to, by {rise[worst]:.6g} in numbers {3 * worst} to"
                f" {3 * worst + 2}: {rows[worst].tolist()}",
            )

    def check_momentum(
        self, item: str, p: Floats, start: Floats, origins: IndexArray, triads: IndexArray
    ) -> None:
        """Raise InputError if a momentum (n,) that steps carry on leaves the plane.

        Momenta that would stretch the directors along the normal do not: the mirror image of such a
        state is itself. The variational scheme carries on the half step of a force that constraints
        then hold, and rotation vectors have such forces, as their cosines see all three directors.

        Parameters
        ----------
        start : (n,) array
            Reference configuration.
        origins : int array
            See :meth:`check`.
        triads : (k, 3) int array
            Rows of y that are directors of one frame each.
        """
        rows = p.reshape(-1, 3).copy()
        nu = start.reshape(-1, 3)[triads] @ self.normal
        stretch = (nu * (rows[triads] @ self.normal)).sum(1)
        rows[triads] -= (stretch[:, None] * nu)[..., None] * self.normal
        self.check(item, "its momentum", rows, origins, power=1)

    def check_spin(self, velocity: Floats) -> None:
        """Raise InputError if the axis of a turning frame is not the normal."""
        across = float(np.linalg.norm(np.cross(velocity, self.normal)))
        if across > TOLERANCE * np.linalg.norm(velocity):
            raise InputError(
                "spin",
                f"velocity = {velocity.tolist()} is off the normal {self.normal.tolist()} of the"
                f" plane that the scene is confined to, by {across:.6g} rad/s",
            )


# --------------------------------------------------------------------------------------------------
# Whether a scene stays in a plane, and what leads out of it.

# -- what leaves a plane: every item of a scene against its mirror image ---------------------------

#: what leaves: item, and how
OutOfPlane = Iterator[tuple[str, str]]
#: instants (s) at which functions of time are looked at before a run
INSTANTS = (0.0, 1e-3, 1e-2, 0.04, 0.1)
#: share of a load that may leave the plane later, where functions of time are evaluated
SHARE = 1e-6
RESULTANTS = ("N_1", "N_2", "N_3", "M_1", "M_2", "M_3")
#: strains, relative to an axial strain of one, at which stored energies are compared
PROBE = 1e-2 * np.array([np.cos(k * np.arange(6)) for k in range(1, 5)])


def places(system: System) -> Iterator[tuple[str, Place]]:
    """All points of a scene with the labels of their items."""
    for item in system.structures:
        vertices = item.vertices()
        if vertices is not None:
            for k, x in enumerate(vertices.positions):
                note = f" node {k}" if is_beam(item) else ""
                yield item.label, Place(item, k, x, np.zeros(3), None, note=note)
    for joint in system.joints:
        yield from ((joint.label, place) for place in (joint.a, joint.b))
    for coupling in system.couplings.items:
        yield from ((coupling.label, place) for place in (coupling.a, coupling.b))
    for load in system.loads:
        for place in load.places():
            yield load.label, place


def out_of_plane(system: System, plane: Plane) -> OutOfPlane:
    """Items that leave a plane: their labels, and how they do it."""
    seen = set()
    for label, place in places(system):
        off = float(plane.height(place.position))
        if abs(off) > TOLERANCE * system.length and label not in seen:
            seen.add(label)  # once for each item
            where = place.label.removeprefix(label).lstrip()
            yield label, f"{where} is {off:.6g} m off the plane"
    for item in system.structures:
        yield from _inertia(item, plane)
        yield from _velocity(item, plane)
        if is_beam(item):
            yield from _sections(item, plane)
    for joint in system.joints:
        yield from _freedom(joint, plane)
    for drive in system.drives:
        if not _in_plane(drive.joint, drive.coordinate.name, plane):
            yield drive.label, f"prescribes the {drive.coordinate.name}, which leaves the plane"
    yield from _loads(system.loading, plane)
    for members in [*([item] for item in system.couplings.items), *system.couplings.laws]:
        yield from _coupling(system, members, plane)
    yield from _ground(system, plane)


def _inertia(item: Beam | RigidBody | MassPoint, plane: Plane) -> OutOfPlane:
    """Centre and products of inertia of a body against its mirror image."""
    M = item.scalar_mass()
    if is_beam(item) or len(M) == 1:
        return
    host = lumped(item).on
    triad = host.triad if host is not None else item.vertices().triads[0]  # type: ignore[union-attr,index]
    assert triad is not None
    if found := _masses(M, triad @ plane.normal, TOLERANCE * plane.length):
        yield item.label, f"its {found}"


def _masses(M: Floats, nu: Floats, length: float = 0.0) -> str:
    """Message if masses by 1 and places along some axes are not their mirror image; else empty."""
    S = np.eye(len(M))
    S[1:, 1:] -= 2 * np.outer(nu, nu)
    odd = 0.5 * (M - S @ M @ S)
    size = M[1:, 1:].trace()
    radius = np.sqrt(size / M[0, 0]) if M[0, 0] else 0.0
    if abs(odd[0]).max() > TOLERANCE * M[0, 0] * max(radius, length):
        off = float(odd[0, 1:] @ nu / M[0, 0])
        return f"centre of mass is {off:.6g} m off the plane"
    worst = float(abs(odd[1:, 1:]).max())
    if worst > TOLERANCE * size:
        return (
            "inertia has no principal axis along the normal of the plane: product of inertia"
            f" {worst:.6g} in its Euler tensor"
        )
    return ""


def _velocity(item: Beam | RigidBody | MassPoint, plane: Plane) -> OutOfPlane:
    vertices = item.vertices()
    if vertices is None:
        return
    n = plane.normal
    out = vertices.velocities @ n
    worst = abs(out).argmax()
    if abs(out[worst]) > TOLERANCE * np.linalg.norm(vertices.velocities, axis=1).max():
        yield item.label, f"its initial velocity leaves the plane by {out[worst]:.6g} m/s"
    omega = vertices.angular_velocities
    across = np.linalg.norm(omega - np.outer(omega @ n, n), axis=1)
    if across.max() > TOLERANCE * np.linalg.norm(omega, axis=1).max():
        yield (
            item.label,
            f"its initial angular velocity is off the normal by {across.max():.6g} rad/s",
        )


def _sections(beam: Beam, plane: Plane) -> OutOfPlane:
    """Sections against their mirror images, at the nodes of each element."""
    nu = (beam.rotations @ beam.triads[beam.basis.connectivity]) @ plane.normal  # (ne, nn, 3)
    steep = float(abs(nu[:, :, 2]).max())
    if steep > TOLERANCE:
        yield beam.label, f"its tangent d3 leaves the plane, by {np.arcsin(steep):.6g} rad"
        return
    twist = float(abs(nu - nu[:, :1]).max())
    if twist > TOLERANCE:
        yield beam.label, f"its sections turn about its axis along it (pre-twist, by {twist:.6g})"
        return
    every = np.arange(len(nu))
    points = beam.elements.points
    free = np.broadcast_to(beam.strains_at(every, points), beam.elements.reference.shape)
    mirrored = [strain @ _flip(n) for strain, n in zip(free, nu[:, 0], strict=True)]
    if abs(free - mirrored).max() > TOLERANCE * abs(free).max():
        yield beam.label, "its strain without load leaves the plane"
    sections = beam.sections_at(every, points)
    normals = nu[:, 0].round(9)
    told = set()
    each = {
        (id(section), *n): (section, e)
        for e, (row, n) in enumerate(zip(sections, normals, strict=True))
        for section in row
    }
    for section, e in each.values():
        name = list(beam.sections)[beam.section_id[e]]
        found = _section(section.law, section.stiffness, section.density, nu[e, 0])
        found = found or _matrix(section.viscosity, nu[e, 0], "viscosity")
        if found and name not in told:
            told.add(name)
            yield beam.label, f"of its section {name!r} {found}"


def _section(law: Law, D: Floats, density: Floats, nu: Floats) -> str:
    if found := _matrix(D, nu, "stiffness"):
        return found
    if found := _masses(density, nu[:2]):
        return f"the {found}"
    eps = PROBE * law.scale
    here = law.energy(eps)
    worst = float((abs(here - law.energy(eps @ _flip(nu))) / abs(here)).max())
    if worst > TOLERANCE:
        return f"the stored energy is not that of the mirror image (by {worst:.6g}, relative)"
    return ""


def _flip(nu: Floats) -> Floats:
    """Mirror image of strains (6, 6): Gamma as vectors, K as axial ones."""
    S = np.eye(3) - 2 * np.outer(nu, nu)
    out = np.zeros((6, 6))
    out[:3, :3] = S
    out[3:, 3:] = -S
    return out


def _matrix(D: Floats, nu: Floats, what: str) -> str:
    """Message if a (6, 6) matrix couples motion in the plane with motion out of it; else empty."""
    J = _flip(nu)
    size = np.sqrt(abs(np.diag(D)))
    size = np.where(size > 0, size, size.max() or 1.0)
    odd = 0.5 * (D - J @ D @ J)
    share = abs(odd) / np.outer(size, size)
    i, j = np.unravel_index(np.argmax(share), share.shape)
    if share[i, j] <= TOLERANCE:
        return ""
    axis = np.degrees(np.arccos(min(1.0, abs(nu).max())))
    turned = f"the plane's normal is {axis:.6g} degrees off d1 and d2 of the section, "
    turned = turned if axis > SHARE else ""
    names = f"{RESULTANTS[i]} with {RESULTANTS[j]}" if i != j else f"{RESULTANTS[i]}"
    return (
        f"the {what} couples motion in the plane with motion out of it: {turned}entry {names}"
        f" = {odd[i, j]:.6g} (share {share[i, j]:.3g})"
    )


def _freedom(joint: Joint, plane: Plane) -> OutOfPlane:
    """Axes have to be along the normal or in the plane: else the joint leads out of it."""
    n = plane.normal
    free = joint.freedom()
    for turn in free.turns or ():
        angle = _tilt(turn.axis, n)
        if angle:
            yield joint.label, f"its axis {turn.axis.round(9).tolist()} is {angle}"
    slides = np.array([np.cross(s.left, s.right) for s in free.slides])
    if len(slides):
        rise = slides.T @ (slides @ n)
        if min(np.linalg.norm(rise), np.linalg.norm(rise - n)) > TOLERANCE:
            tilted = _tilt(slides[0] if len(slides) == 1 else np.cross(*slides), n)
            what = "axis" if len(slides) == 1 else "normal"
            yield joint.label, f"its {what} is {tilted}"


def _tilt(axis: Floats, n: Floats) -> str:
    """Angle of a direction, in words, if it is neither along n nor normal to it; else empty."""
    rise = abs(float(axis @ n))
    run = float(np.linalg.norm(np.cross(axis, n)))
    if min(rise, run) <= TOLERANCE:
        return ""
    return (
        f"{np.degrees(np.arctan2(run, rise)):.6g} degrees off the normal of the plane, not 0 or 90"
    )


def _in_plane(joint: Joint, name: str, plane: Plane) -> bool:
    """True if a coordinate of a joint is one of motion in the plane."""
    n = plane.normal
    free = joint.freedom()
    turns = {turn.name for turn in free.within(n).turns or ()}
    slides = {s.name for s in free.slides if abs(np.cross(s.left, s.right) @ n) < TOLERANCE}
    return name in turns | slides


# -- forces ----------------------------------------------------------------------------------------


def _stray(term: Term, value: Floats, plane: Plane) -> float:
    """Size of the part of a term's value that leaves the plane (N, N m, N/m, m/s^2)."""
    v = term.vectors(value)
    n = plane.normal
    if term.axial:
        return float(np.linalg.norm(v - np.outer(v @ n, n), axis=1).max())
    return float(abs(v @ n).max())


def _loads(loading: Loading, plane: Plane) -> OutOfPlane:
    for site in loading.sites():
        terms = [loading.terms[k] for k in site]
        single = len(site) == 1
        for t in (0.0,) if single else INSTANTS:
            value = terms[0].value
            if not single:
                value = np.asarray(sum(term.value * term.time.value(t) for term in terms))
            off = _stray(terms[0], value, plane)
            if off > TOLERANCE * np.linalg.norm(value):
                when = "" if single else f" at t = {t:g} s"
                where = "is off the normal" if terms[0].axial else "leaves the plane"
                text = f"{shown(value.round(9).tolist())}{when} {where} by {off:.6g}"
                yield loading.owners[site[0]].label, text
                break


def guard_of(loading: Loading, plane: Plane) -> Callable[[Floats, float], None] | None:
    """Check of the factors of all channels at a time, if some vector is a function of it."""
    watched = [
        site
        for site in loading.sites()
        if len(site) > 1 and not all(isinstance(loading.times[k], Constant) for k in site)
    ]

    def check(factors: Floats, t: float) -> None:
        for site in watched:
            value = np.asarray(sum(factors[k] * loading.terms[k].value for k in site))
            off = _stray(loading.terms[site[0]], value, plane)
            if off > SHARE * np.linalg.norm(value):
                raise InputError(
                    loading.owners[site[0]].label,
                    f"leaves the plane normal to {plane.normal.tolist()} that the scene is confined"
                    f" to, by {off:.6g} at t = {t:g} s",
                )

    return check if watched else None


def _coupling(system: System, members: list[Coupling], plane: Plane) -> OutOfPlane:
    """By its forces; springs on an angle of a joint by its axis: it turns in the plane or never.

    Several are of one law.
    """
    item = members[0]
    coordinate = item.coordinates[0]
    if (
        isinstance(item, (JointSpringDamper, JointActuator))
        and coordinate.kind == "angle"
        and not item.own_law
    ):
        if _in_plane(item.joint, coordinate.name, plane):
            return
        driven = [time.value(t) for t in INSTANTS for time in item.channels]
        if (item.stiffness @ item.neutral).any() or any(driven):
            yield item.label, f"acts on the {coordinate.name}, which leaves the plane"
        return
    instants = INSTANTS if item.channels or item.own_law else INSTANTS[:3]
    yield from _pushed(system, system.couplings_of(members), item.label, instants, plane)


def _pushed(
    system: System, alone: Couplings, label: str, instants: Sequence[float], plane: Plane
) -> OutOfPlane:
    """Forces out of the plane at states in it, and at instants."""
    rng = np.random.default_rng(0)
    worst = 0.0
    most = 0.0
    for t in instants:
        y = _motion(system, plane, rng)
        ydot = _motion(system, plane, rng)
        ydot = ydot - system.extend(system.q0, 0.0)
        start = alone.starting(system.extend(system.q0, 0.0), None, alone.values(t), 1.0, t)
        twists = _twist_forces(system, y, alone.static(start, y, ydot).force[: system.rows])
        worst = max(worst, _out_of_plane(twists, plane))
        most = max(most, abs(twists).max())
    if worst > TOLERANCE * most:
        yield (
            label,
            f"pushes out of the plane where all is in it, by a share of {worst / most:.3g}",
        )


def _motion(system: System, plane: Plane, rng: np.random.Generator) -> Floats:
    """Rows y (total, 3) of a scene whose frames have moved in the plane, each by itself."""
    kin = system.kinematics
    y = system.extend(system.q0, 0.0)
    x = system.origin_rows
    y[x] += 0.1 * system.length * rng.standard_normal((len(x), 2)) @ plane.axes
    theta = 0.3 * rng.standard_normal(len(kin.frames))
    R = rotation_matrix(exp_quaternion(theta[:, None] * plane.normal))
    y[kin.director_rows] = y[kin.director_rows] @ R.transpose(0, 2, 1)
    return y


def functions_off_plane(
    system: System, times: Floats, states: Floats
) -> tuple[str, str, float] | None:
    """Function of the motion that pushed out of the plane in a run: its load, what to say, when.

    Forces are those at recorded states (N, n), with the mean velocities from one to the next.
    """
    plane = system.plane
    n = len(states)
    if plane is None or n < 2:
        return None
    for members in system.couplings.laws:
        alone = system.couplings_of(members)
        none = np.zeros(1)
        worst, most, when = 0.0, 0.0, 0.0
        for k in range(n):
            other = k + 1 if k + 1 < n else k - 1
            t = float(times[k])
            y = system.extend(states[k], t)
            rates = (system.extend(states[other], float(times[other])) - y) / (times[other] - t)
            start = alone.starting(y, None, none, 1.0, t)
            twists = _twist_forces(system, y, alone.static(start, y, rates).force[: system.rows])
            off = _out_of_plane(twists, plane)
            worst, when = (off, t) if off > worst else (worst, when)
            most = max(most, abs(twists).max())
        if worst > SHARE * most:
            share = f"by a share of {worst / most:.3g}, which the run left out"
            text = f"pushed out of the plane that the scene is confined to, {share}"
            return members[0].label, text, when
    return None


def _twist_forces(system: System, y: Floats, force: Floats) -> Floats:
    """Forces, and moments by the extent, (2, v, 3) on each vertex."""
    kin = system.kinematics
    moments = np.zeros((len(system.origin_rows), 3))
    rows = kin.director_rows
    moments[kin.frames] = cross(y[rows], force[rows]).sum(1) / system.length
    return np.array([force[system.origin_rows], moments])


def _out_of_plane(twists: Floats, plane: Plane) -> float:
    n = plane.normal
    return max(abs(twists[0] @ n).max(), abs(twists[1] - np.outer(twists[1] @ n, n)).max())


def _ground(system: System, plane: Plane) -> OutOfPlane:
    """Prescribed motion, at the first instants."""
    prescribed = [drive.place for drive in system.drives]
    for place in system.moving:
        if any(place is other for other in prescribed):
            continue
        for t in INSTANTS:
            off = plane.off_plane(place, t)
            if off > TOLERANCE:
                text = f"its prescribed motion leaves the plane at t = {t:g} s, by {off:.6g}"
                yield place.label, f"{text} (m by the extent, or rad)"
                break


# -- whether a scene stays in a plane, which one, and what leaves it by how much -------------------


@dataclass(frozen=True, eq=False)
class Planarity:
    """Result of :func:`planarity`: true if the scene stays in a plane.

    Attributes
    ----------
    plane : Plane
        The one that comes nearest.
    out_of_plane : tuple of str
        What leaves it, and by how much; empty if nothing does.
    """

    plane: Plane
    out_of_plane: tuple[str, ...] = field(default=())

    def __bool__(self) -> bool:
        return not self.out_of_plane

    @property
    def planar(self) -> Planar | None:
        """For :meth:`Model.freeze`; None if the scene is not planar."""
        return Planar(self.plane.normal) if self else None

    def __repr__(self) -> str:
        normal = self.plane.normal.round(9).tolist()
        if self:
            return f"<planar, normal {normal}>"
        return f"<not planar; out of the plane normal to {normal}: {'; '.join(self.out_of_plane)}>"


def inspect(system: System, normal: Floats | None = None) -> Planarity:
    """Look for the plane of a scene, or at that with a given normal; see :func:`planarity`."""
    normals = _candidates(system) if normal is None else [normal]
    best = None
    for n in normals:
        plane = Plane(n, system.q0.reshape(-1, 3)[system.origin_rows].mean(0), system.length)
        found = Planarity(
            plane, tuple(f"{item}: {text}" for item, text in out_of_plane(system, plane))
        )
        if found:
            return found
        if best is None or len(found.out_of_plane) < len(best.out_of_plane):
            best = found
    assert best is not None
    return best


def confine(system: System, planar: Planar) -> None:
    """Confine a scene to its plane.

    Raises
    ------
    InputError
        Naming what leaves the plane, and by how much.
    """
    if not isinstance(planar, Planar):
        raise InputError("argument planar", f"{planar!r}, expected Planar()")
    found = inspect(system, planar.normal)
    if not found:
        plane = found.plane
        more = len(found.out_of_plane) - 1
        normal = plane.normal.round(9).tolist()
        point = (plane.point.round(9) + 0.0).tolist()
        raise InputError(
            "planar scene",
            f"{found.out_of_plane[0]}; the plane is normal to {normal}, through the middle of the"
            f" scene, {point}" + (f" ({more} more: see planarity(model))" if more else ""),
        )
    system.confine(found.plane)


# -- which plane -----------------------------------------------------------------------------------


def _candidates(system: System) -> list[Floats]:
    """Normals: of the points, if they span a plane; else of all that points or turns somewhere."""
    x = np.array([place.position for _, place in places(system)])
    _, sizes, V = np.linalg.svd((x - x.mean(0)) / system.length, full_matrices=False)
    sizes = np.append(sizes, np.zeros(3))[:3] / np.sqrt(len(x))
    if sizes[1] > 1e-6:
        axis = np.eye(3)[np.argmax(abs(V[2]))]
        # an axis of space may be what is meant
        return [V[2], axis] if abs(axis @ V[2]) > 0.99 else [V[2]]
    line = V[:1] if sizes[0] > 1e-6 else np.zeros((0, 3))
    along = [*np.zeros((0, 3))]
    about = [*np.eye(3)]
    for item in system.structures:
        vertices = item.vertices()
        if vertices is None:
            continue
        along.append(vertices.velocities[0])
        about.append(vertices.angular_velocities[0])
        if vertices.triads is not None:
            about = [*vertices.triads[0], *about]
    for site in system.loading.sites():
        if len(site) == 1:
            term = system.loading.terms[site[0]]
            (about if term.axial else along).extend(term.vectors(term.value))
    for joint in system.joints:
        free = joint.freedom()
        about += [turn.axis for turn in free.turns or ()]
        along += [np.cross(s.left, s.right) for s in free.slides]
    ways = [*line, *along]
    normals = [*about, *(np.cross(a, b) for a, b in product(line, along))]
    normals += [np.cross(a, b) for a, b in product(ways, repeat=2)] if len(ways) < 8 else []
    out: list[Floats] = []
    for n in normals:
        size = float(np.linalg.norm(n))
        if size <= TOLERANCE or (len(line) and abs(line @ n).max() > 1e-6 * size):
            continue
        n = n / size
        if not any(abs(n @ other) > 1 - 1e-12 for other in out):
            out.append(n)
    return out or [np.array([0.0, 0, 1])]
