"""Limits of what steps and elements can follow: turns, prescribed motion, bending, tension."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..frames import StructuralItem
from ..joint import Joint, JointDrive
from ..types import Floats
from .groups import BeamGroup
from .loops import BROKEN, reached
from .system import System
from .theories import theory_of

if TYPE_CHECKING:
    from ..beam import Beam
    from ..element import Interpolation


# -- frames that turn far in a step ----------------------------------------------------------------

#: rotation (rad) in a step above which no scheme follows it: at this one those of second order are
#: off by 2 to 5 %
FAR_TURN = 0.5


def fastest_turn(system: System, v: Floats) -> tuple[str, float]:
    """Item that turns fastest at velocities v (n,), and its angular velocity (rad/s).

    Returns
    -------
    (str, float)
        Label of the item, empty if there are no frames.

    Examples
    --------
    >>> from skfem_cosserat import Model, RigidBody
    >>> model = Model()
    >>> body = model.add("body", RigidBody(1.0, (1, 1, 1), angular_velocity=(0, 0, 3.0)))
    >>> system = model.freeze()
    >>> fastest_turn(system, system.v0)
    ("rigid body 'body'", 3.0)
    """
    origins = system.origin_rows[system.is_frame[: len(system.origin_rows)]]
    if not len(origins):
        return "", 0.0
    rates = v.reshape(-1, 3)[origins[:, None] + np.arange(1, 4)]
    # directors are orthonormal: each component of the angular velocity moves two of them
    speeds = np.sqrt(0.5 * (rates**2).sum((-1, -2)))
    fastest = speeds.argmax()
    return owner(system, int(origins[fastest])).label, float(speeds[fastest])


def owner(system: System, row: int) -> StructuralItem:
    """Item that a row of y belongs to."""
    starts = [(system.first[id(i)][1], i) for i in system.structures if id(i) in system.first]
    return max((each for each in starts if each[0] <= row), key=lambda each: each[0])[1]


# -- constraints that do not hold ------------------------------------------------------------------


def broken_constraint(system: System, y: Floats, tolerance: float = BROKEN) -> str | None:
    """Message about a constraint that is violated at y, or on another branch; None: none is.

    The tolerance is relative to what motions of the scene's size change.
    """
    g = abs(system.constraints.values(y))
    sizes = np.ones((system.rows, 3))
    sizes[system.origin_rows] = system.length  # wherever it is: what motions of its size change
    allowed = tolerance * (abs(system.constraints.jacobian(y)) @ sizes.ravel())
    excess = g - allowed - 1e-15 * system.constraints.magnitudes(y)
    if not excess.max(initial=0.0) > 0:
        wrong = system.wrong_branch(y)
        return wrong and f"is on another branch, to which no motion leads: {wrong}"
    row = excess.argmax()
    return f"violates the constraint of the {constraint_owner(system, row)} by {g[row]:.6g}"


def constraint_owner(system: System, row: int) -> str:
    """Label of the item that a constraint row belongs to."""
    for jr in system.joint_rows:
        if jr.rows.start <= row < jr.rows.stop:
            return jr.joint.label
    for each in system.theory_rows:
        if each.rows.start <= row < each.rows.stop:
            return f"{each.beam.label}, {each.beam.theory!r}"
    return f"triad of {system.owner[int(system.kinematics.frames[row // 6])].label}"


# -- prescribed motion that jumps ----------------------------------------------------------------

#: second difference of prescribed motion (rad, relative to the extent) above which it jumps, if it
#: stays that large in intervals as short as rounding allows
JUMP = 1e-6


def where_it_stays(
    bend: Callable[[float, float], float], a: float, b: float, width: float
) -> tuple[float, float] | None:
    """Interval, within another and as short as `width`, in which a bend stays above 1, or None.

    The second difference of what is continuous shrinks with the interval, however steep it is.
    """
    while bend(a, b) > 1:
        if b - a <= width:
            return a, b
        middle = (a + b) / 2
        a, b = max((a, middle), (middle, b), key=lambda half: bend(*half))
    return None


@lru_cache(maxsize=4)
def _followed(system: System) -> tuple[Floats, dict[int, Joint | JointDrive]]:
    """Weights of the ground's rows that constraints feel, and of which item each frame is."""
    weights = np.zeros((system.grounds.rows // 4, 4, 3))
    owners: dict[int, Joint | JointDrive] = {}
    for joint in system.joints:
        for place in (joint.a, joint.b):
            if place.motion is not None:
                weights[system.grounds.number(place)] = 1.0
                owners[system.grounds.number(place)] = joint
    weights[:, 0] /= system.length
    for drive in system.drives:
        k = system.grounds.number(drive.place)
        turning = drive.coordinate.kind == "angle"  # felt by its cosine and sine
        weights[k, 0] = (1.0, 1.0, 0.0) if turning else (0.0, 0.0, 1 / system.length)
        owners[k] = drive
    return weights.reshape(-1, 3), owners


def jump(system: System, t0: float, t1: float) -> str | None:
    """Message about prescribed motion that jumps between two instants; None: none does."""
    weights, owners = _followed(system)
    ground, (a, b) = cache(system.ground), sorted((t0, t1))

    def bends(a: float, b: float) -> Floats:
        return weights / JUMP * abs(ground(a) - 2 * ground((a + b) / 2) + ground(b))

    shortest = 1e-14 * max(abs(a), abs(b))
    found = where_it_stays(lambda a, b: float(bends(a, b).max()), a, b, shortest)
    if found is None:
        return None
    a, b = found
    frame = int(bends(a, b).max(1).argmax()) // 4
    item = owners[frame]
    when = f"jumps at t = {b:.6g} s"
    if isinstance(item, JointDrive):
        return f"the {item.label} {when}: {reached(item, a)}, then {reached(item, b)}"
    far = np.linalg.norm((ground(b) - ground(a)).reshape(-1, 4, 3)[frame], axis=1)
    turn = 2 * np.arcsin(min(1.0, float(np.linalg.norm(far[1:])) / np.sqrt(8)))
    return (
        f"the prescribed motion of the ground at the {item.label} {when}, by {far[0]:.6g} m and"
        f" {turn:.6g} rad"
    )


# -- elements bent so far that they give way: why Newton's method fails on a mesh too coarse -------


def over_rotated(system: System, y: Floats) -> str | None:
    """Elements that turn, against the reference, by more than they can be bent on their own.

    The directors are interpolated, so the bending of a linear element between nodes at an angle t
    is sin(t)/l: its moment EI sin(2 t)/(2 l) peaks at 45 degrees, and a fold of 180 costs nothing.
    Higher orders give way later, see :attr:`skfem_cosserat.element.Interpolation.turn_limit`.
    Torsion counts like bending. The angle of an element is the sum of those between its
    neighbouring nodes, each below 180 degrees.

    Parameters
    ----------
    y : (rows or more, 3) array
        Configuration: the rows of a state q, or all rows from ``system.extend``.

    Returns
    -------
    str or None
        The worst element with its nodes and the angle; None if all are within their limits.

    Examples
    --------
    A straight beam of two linear elements, bent to a right angle by its end:

    >>> from skfem_cosserat import Beam, MeshCurve, Model, Section
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> model = Model()
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 2), 2)
    >>> beam = model.add("boom", Beam(mesh, section, director=(1, 0, 0)))
    >>> system = model.freeze()
    >>> y = system.q0.copy().reshape(-1, 3)
    >>> print(over_rotated(system, y))
    None
    >>> y[9:12] = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])
    >>> over_rotated(system, y).partition(",")[0]
    "relative rotation between nodes 1 and 2 of beam 'boom' is 90 degrees"
    """
    found = over_rotated_beam(system, y)
    return None if found is None else found[1]


def over_rotated_beam(system: System, y: Floats) -> tuple[str, str] | None:
    """Label of the beam that :func:`over_rotated` reports, and the message; None: none."""
    if not system.beams:  # a scene without beams imports no meshes
        return None
    from ..mesh.triads import gives_way

    worst = 1.0
    found = None
    for beam in system.beams:
        basis = beam.basis
        angle = _rotated(beam, _nodal(system, beam, y))
        ratio = float(angle.max()) / basis.interpolation.turn_limit
        if ratio > worst:
            a, b = basis.connectivity[angle.argmax()][[0, -1]]
            worst = ratio
            found = (
                beam.label,
                f"relative rotation between nodes {a} and {b} of {beam.label} is"
                f" {gives_way(basis.interpolation, angle)}{limp(beam)}",
            )
    return found


def first_over_rotated(system: System, states: Floats) -> int | None:
    """The first of some states (N, rows, 3) in which :func:`over_rotated` finds an element."""
    first = 0
    for some in np.array_split(states, len(states) // 100 + 1):
        bent = np.zeros(len(some), bool)
        for beam in system.beams:
            limit = beam.basis.interpolation.turn_limit
            bent |= (_rotated(beam, _nodal(system, beam, some)) / limit > 1.0).any(1)
        if bent.any():
            return first + int(bent.argmax())
        first += len(some)
    return None


def _nodal(system: System, beam: Beam, y: Floats) -> Floats:
    """Triads (..., nodes, 3, 3) of a beam's nodes at configurations (..., rows, 3)."""
    row = system.first[id(beam)][1]
    own = y[..., row : row + 4 * beam.basis.n_nodes, :]
    return own.reshape(*y.shape[:-2], -1, 4, 3)[..., 1:, :]


def _rotated(beam: Beam, nodal: Floats) -> Floats:
    """Angles (..., ne) that elements turn by, against the reference; rounded, so equal are equal.

    `nodal`: triads (..., nodes, 3, 3).
    """
    from ..mesh.triads import turns

    inner = beam.basis.connectivity
    now = _steps(nodal[..., inner, :, :])
    return turns(_steps(beam.triads[inner]), now).sum(-1).round(9)


def limp(beam: Beam) -> str:
    """That a beam is too soft by far to carry its own weight, as with E in MPa; else empty."""
    soft = float(_bending(beam.elements.stiffness, beam.theory.held).min())
    length = float(beam.elements.lengths.sum())
    weight = 9.81 * beam.scalar_mass()[:, ::4, ::4].sum()
    # such a stiffness looks wrong
    if not soft * 1e4 < weight * length**2:
        return ""
    return (
        f"; the bending stiffness EI = {soft:.3g} N m^2 of {beam.label} is"
        f" {soft / (weight * length**2):.1g} of its weight times its length squared: are"
        " lengths in m, and E in Pa?"
    )


def _steps(triads: Floats) -> Floats:
    """Rotations from node to node (..., p, 3, 3) in the nodes' own frames: (..., p + 1, 3, 3)."""
    return triads[..., 1:, :, :] @ triads[..., :-1, :, :].swapaxes(-1, -2)


# -- elements drawn so much that node rotations their Gauss points do not see grow -----------------


def undefined(system: System, y: Floats) -> str | None:
    """Message about a stored energy, or its stresses, not finite at y; None: all are finite."""
    for group in system.beam_groups:
        strain = group.strain(y)[0]
        for points, law in group.elements.stored:
            eps = strain[points]
            found = np.column_stack([law.energy(eps), law.stress(eps)])
            bad = np.flatnonzero(~np.isfinite(found).all(1) & np.isfinite(eps).all(1))
            if len(bad):
                beam, _ = beam_of(system, group, int(points[0][bad[0]]))
                values = ", ".join(f"{x:.6g}" for x in eps[bad[0]])
                return (
                    f"the stored energy of {beam.label} is {found[bad[0], 0]:.6g}, its stresses"
                    f" {found[bad[0], 1:].tolist()}, at strains [{values}]"
                )
    return None


def beam_of(system: System, group: BeamGroup, element: int) -> tuple[Beam, int]:
    """The beam that an element of a group belongs to, and its number there."""
    own = [(beam, group.slices.get(id(beam), slice(0, 0))) for beam in system.beams]
    return next((beam, element - e.start) for beam, e in own if e.start <= element < e.stop)


def overstretched(system: System, y: Floats, loads: Floats | None = None) -> str | None:
    """Elements whose tension is above what their bending stiffness can hold on this mesh.

    Parameters
    ----------
    system : System
    y : (rows or more, 3) array
        Configuration: the rows of a state q, or all rows from ``system.extend``.
    loads : (k,) array, optional
        Factors of the channels of loads, for strains that are loads; default: zero.

    Returns
    -------
    str or None
        The worst element with its nodes, its tension and the limit (N), and how many elements of
        the same order its beam needs; None if all are within their limits.

    Notes
    -----
    Rotations of nodes ``theta = c P_p`` (the Legendre polynomial of an element of order p, with
    signs such that neighbours agree) vanish at its p Gauss points: only their slope is seen, with
    the bending energy ``EI p (p + 1) c^2/h`` of an element. Yet they shorten the interpolated d3,
    by ``theta^2/2`` at the nodes and ``c^2/(2 p)`` in the mean, which releases ``N h c^2/(2 p)``.
    They grow above ``N = 2 p^2 (p + 1) EI/h^2``; for p = 3 and 4, where polynomials of lower order
    lend a hand, somewhat earlier: see :func:`tension_factor`. ``EI`` is the smaller bending
    stiffness, that at free twist and shear, ``h^2`` the length in the reference times the present
    one. It is the limit of a long row of equal elements; ends that are held and neighbours drawn
    less raise it: by 4 % for eight clamped elements of order 2. Shear as soft as ``GA = N`` and
    tension that varies within an element are left out.

    Elements with more Gauss points than p see these rotations as shear. They give way above
    ``p/(2 p + 1)`` of the shear stiffness on any mesh and are not looked at here.

    Examples
    --------
    A beam of two linear elements with EI = 500 N m^2 and h = 1 m, drawn by 2500 N:

    >>> from skfem_cosserat import Beam, MeshCurve, Model, Section
    >>> section = Section([1e6, 1e6, 1e6, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> model = Model()
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 2), 2)
    >>> beam = model.add("rope", Beam(mesh, section, director=(1, 0, 0)))
    >>> system = model.freeze()
    >>> y = system.q0.copy().reshape(-1, 3)
    >>> print(overstretched(system, y))
    None
    >>> y[system.origin_rows] *= 1.0025
    >>> overstretched(system, y).partition(" (1 more")[0]
    "tension 2.5e+03 N between nodes 0 and 1 of beam 'rope' is above 4 EI/h^2 = 2e+03 N"
    """
    found = overstretched_beam(system, y, loads=loads)
    return None if found is None else found[1]


def overstretched_beam(
    system: System,
    y: Floats,
    multipliers: Floats | None = None,
    loads: Floats | None = None,
) -> tuple[str, str] | None:
    """Label of the beam that :func:`overstretched` reports, and the message; None: none.

    With `multipliers` (m,) of the constraint rows the tension of inextensible beams counts, too.
    """
    worst = 1.0 + 1e-9
    about = None
    factors = np.zeros(len(system.loading.times)) if loads is None else loads
    drawn = {
        beam: tuple(values[which] for values in found)
        for group in system.beam_groups
        for found in [_tension(group, y, system.loading.strains(group, factors[None])[0])]
        for beam, which in group.slices.items()
    }
    for beam in system.beams:
        kind = beam.basis.interpolation
        if kind.points > kind.order:
            continue  # its Gauss points see them
        factor = tension_factor(kind)
        force, stretch, present = drawn[id(beam)]
        held = None if multipliers is None else theory_of(system.theory_rows, beam)
        if held is not None and multipliers is not None and held.can_bend:
            force = force + held.stress(multipliers)[:, :, 2] @ beam.elements.weights
        least = _bending(beam.elements.stiffness, beam.theory.held).min(1)
        bending = np.where(np.isnan(present), least, present)
        limit = factor * bending / (beam.basis.lengths**2 * stretch.clip(1e-300))
        ratio = (force / limit).round(9)  # of equal ones the first is named
        if ratio.max() > worst:
            e = int(ratio.argmax())
            worst = float(ratio.max())
            a, b = beam.basis.connectivity[e][[0, -1]]
            above = ratio > 1.0 + 1e-9
            count = len(ratio)
            others = int(above.sum()) - 1
            # an element cut into r = sqrt(N/limit) parts is at its limit
            needed = count - others - 1 + int(np.ceil(np.sqrt(ratio[above]).sum() - 1e-9))
            more = f" ({others} more like it)" if others else ""
            about = (
                beam.label,
                f"tension {force[e]:.3g} N between nodes {a} and {b} of {beam.label} is above"
                f" {factor:.3g} EI/h^2 = {limit[e]:.3g} N{more}: node rotations that its Gauss"
                f" points do not see can grow; refine: it takes {max(needed, count + 1)} elements"
                f" in place of {count}",
            )
    return about


@cache
def tension_factor(kind: Interpolation) -> float:
    """Largest tension of a row of elements with p Gauss points, in units of ``EI/h^2``.

    With Lobatto nodes 4, 24, ``30 + 18 sqrt(5) = 70.25`` and ``50 + 2 sqrt(2305) = 146.02`` for
    p = 1 to 4, with equidistant ones 61.27 and 155.98 for p = 3 and 4.

    Parameters
    ----------
    kind : Interpolation

    Notes
    -----
    In an element that follows the slope of its axis at the Gauss points, rotations theta of nodes
    have the energy ``EI/2 int theta'^2 ds + N/2 (2 G(theta^2) - L(theta^2))``: G sums over Gauss
    points what is interpolated, L the squares at nodes with the integrals of their shape functions.
    The factor is the smallest N at which it is not positive.

    Examples
    --------
    >>> from skfem_cosserat import InterpolationLobatto
    >>> [round(tension_factor(InterpolationLobatto(p)), 9) for p in (1, 2)]
    [4.0, 24.0]
    """
    from ..basis import gauss_rule
    from ..element import shape_derivatives, shape_functions

    x, w = gauss_rule(kind.order + 1)
    slope = shape_derivatives(kind, x)
    x, v = gauss_rule(kind.points)
    shape = shape_functions(kind, x)
    tension = 2 * (shape * v) @ shape.T - np.diag(shape @ v)
    values = np.linalg.eigvals(np.linalg.solve(-tension, (slope * w) @ slope.T))
    real = values[abs(values.imag) < 1e-9 * abs(values).max()].real
    return float(real[real > 1e-9].min())  # zero belongs to a constant theta


def _tension(group: BeamGroup, y: Floats, free: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean axial force (ne,) in N and stretch ``d3 . phi'`` (ne,) of elements.

    And the bending stiffness that sections of a stored energy have there, NaN for others. `free`:
    strains without stress (ne, ng, 6).
    """
    seen = group.strain(y)[0]
    weights = group.elements.weights
    strain = seen - free
    stretch = seen + group.elements.reference
    present = np.full(len(strain), np.nan)
    for points, law in group.elements.stored:
        ids = np.unique(points[0])
        mean = group.moduli(strain)[ids].sum(1) / group.elements.lengths[ids, None, None]
        present[ids] = _bending(mean, law.held)
    return group.stress(strain)[:, :, 2] @ weights, stretch[:, :, 2] @ weights, present


def _bending(stiffness: Floats, held: tuple[int, ...]) -> Floats:
    """The smaller bending stiffness (...) in N m^2 of sections (..., 6, 6) that are free otherwise.

    Of what is not held: without end if bending is.
    """
    if {3, 4} & set(held):
        return np.full(stiffness.shape[:-2], np.inf)
    free = [k for k in range(6) if k not in held]
    bending = [free.index(k) for k in (3, 4)]
    compliance = np.linalg.inv(stiffness[..., free, :][..., free])
    return 1 / np.linalg.eigvalsh(compliance[..., bending, :][..., bending])[..., -1]
