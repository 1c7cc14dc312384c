"""What a history says about the system it belongs to: names, constant arrays, derived series."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from functools import cache
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from .. import diagnostics
from ..body import MassPoint, RigidBody, ball_surface
from ..diagnostics import Projection
from ..diagnostics.joint_motion import relative_series
from ..diagnostics.stacked import all_rows
from ..frames import Place, is_beam
from ..history import History
from ..model import System, takes_scene
from ..model.groups import lumped
from ..types import Floats, IndexArray, check_kind
from ..version import VERSION

if TYPE_CHECKING:
    from ..beam import Beam

#: version of a package, whose metadata it takes a millisecond to read
_installed = cache(version)
#: strains at which stored energies that are not quadratic are compared
PROBE = 1e-2 * np.array([np.cos(k * np.arange(6)) for k in range(1, 5)])


def fingerprint(system: System) -> dict[str, Any]:
    """What makes a history belong to a system: names, and sums that any change of numbers moves."""
    y = system.extend(system.q0, 0.0)
    stiffness = [g.elements.stiffness.ravel() for g in system.beam_groups]
    numbers = {
        "reference": system.q0,
        "mass": system.mass.tocoo().data,
        "stiffness": np.concatenate([*stiffness, np.zeros(0)]),
        "gauss": np.concatenate([*(g.elements.points for g in system.beam_groups), np.zeros(0)]),
        "constraints": system.constraints.jacobian_values(y),
    }
    stored = [
        law.energy(PROBE * law.scale) for g in system.beam_groups for _, law in g.elements.stored
    ]
    if stored:
        numbers["stored energy"] = np.concatenate(stored)
    # weights without a pattern, so that nothing cancels or trades places
    sums = {k: float(v @ np.cos(1 + np.arange(len(v)) ** 1.5)) for k, v in numbers.items()}
    return {
        "items": [s.label for s in system.structures],
        "joints": [j.label for j in system.joints],
        "counts": [system.n, system.m],
        "numbers": sums,
    }


def other_model(system: System, found: dict[str, Any]) -> str | None:
    """How a fingerprint differs from that of the system, or None."""
    own = fingerprint(system)
    for name in ("items", "joints", "counts"):
        if found.get(name) != own[name]:
            return f"{name} {found.get(name)}, expected {own[name]}"
    for name, value in own["numbers"].items():
        other = found.get("numbers", {}).get(name, np.nan)
        if not np.isclose(other, value, rtol=1e-9, atol=1e-12):
            return f"{name} differs (weighted sum {other!r}, expected {value!r})"
    return None


def describe(system: System) -> tuple[dict[str, Any], dict[str, Floats]]:
    """Names and constant arrays of a system, as a history keeps them."""
    meta: dict[str, Any] = {
        "versions": {
            "skfem_cosserat": VERSION,
            "scikit-fem": _installed("scikit-fem"),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "python": platform.python_version(),
        },
        "machine": f"{platform.system()} {platform.machine()}",
        "fingerprint": fingerprint(system),
        **system.counts(),
        "beams": [],
        "bodies": [],
        "points": [],
        "joints": [],
        "couplings": [],
        #: force elements whose angles the series "turns" counts
        "turns": [item.name for item in system.couplings.angles],
    }
    static: dict[str, Any] = {"reference": system.q0}
    for item in system.structures:
        if is_beam(item):
            meta["beams"].append(_describe_beam(system, item, static))
        else:
            _describe_lump(system, lumped(item), meta, static)
    for joint in system.joints:
        ends = {"a": joint.a.label, "b": joint.b.label}
        meta["joints"].append({"name": joint.name, "type": joint.type, **ends})
    for coupling in system.couplings.items:
        ends = {"a": coupling.a.label, "b": coupling.b.label}
        meta["couplings"].append({"name": coupling.name, "type": coupling.kind, **ends})
    return meta, static


def recorded_turns(system: System, history: History) -> IndexArray | None:
    """Full turns of the system's angles at the last state; zero for those not recorded."""
    angles = system.couplings.angles
    if not angles or "turns" not in history:
        return None
    known = dict(zip(history.meta.get("turns", []), history["turns"][-1], strict=True))
    return np.array([known.get(item.name, 0) for item in angles], dtype=np.int64)


def _describe_lump(
    system: System, item: RigidBody | MassPoint, meta: dict[str, Any], static: dict[str, Any]
) -> None:
    """A body or mass point, also one that is attached to a node: it moves with that frame."""
    place = item.place() if isinstance(item, MassPoint) else item.at(item.position)
    if isinstance(item, RigidBody):
        meta["bodies"].append({"name": item.name, "shape": "surface"})
        static[f"body/{item.name}/offset"] = np.array(system.offset(place))
        if item.surface is not None:
            points = np.array(item.surface[0], dtype=float) + place.offset
            static[f"body/{item.name}/points"] = points
            static[f"body/{item.name}/faces"] = np.array(item.surface[1], dtype=np.int64)
    elif place.offset.any():  # off the origin of its frame: a small ball that moves with it
        meta["bodies"].append({"name": item.name, "shape": "ball"})
        points, faces = ball_surface(0.01 * system.length)
        static[f"body/{item.name}/offset"] = np.array(system.offset(place))
        static[f"body/{item.name}/points"] = points + place.offset
        static[f"body/{item.name}/faces"] = faces
    else:
        meta["points"].append({"name": item.name})
        static[f"point/{item.name}/offset"] = np.array(system.offset(place))


def _describe_beam(system: System, beam: Beam, static: dict[str, Any]) -> dict[str, Any]:
    key = f"beam/{beam.name}/"
    row = system.first[id(beam)][1]
    nodes = len(beam.basis.nodes)
    names = sorted(beam.mesh.subdomains or {})
    part = np.full(len(beam.section_id), -1, dtype=np.int64)
    for k, name in enumerate(names):
        part[beam.mesh.elements_of(name)] = k
    static[key + "offsets"] = 3 * (row + 4 * np.arange(nodes, dtype=np.int64))
    static[key + "connectivity"] = np.asarray(beam.basis.connectivity, dtype=np.int64)
    static[key + "lengths"] = beam.elements.lengths
    static[key + "rotations"] = beam.rotations
    static[key + "part"] = part
    static[key + "section"] = beam.section_id
    static[key + "gauss"] = beam.elements.points
    static[key + "nodes"] = beam.basis.interpolation.nodes
    for k, section in enumerate(beam.sections.values()):
        if section.outline is not None:
            static[key + f"outline/{k}"] = section.outline
    return {
        "name": beam.name,
        "order": beam.basis.order,
        "parts": names,
        "sections": list(beam.sections),
    }


@takes_scene
def derive_series(system: System, history: History) -> None:
    """Add what follows from the states: velocities, energies, momenta, forces, reactions.

    Adds ``v, Qp`` (projected on the hidden constraints), ``kinetic, strain_energy, external,
    coupling_energy, energy`` (kinetic + strain + coupling at (q, p)), ``energy_projected``,
    ``energy_balance``, ``linear_momentum``, ``angular_momentum``, ``constraint_violation``, for
    each beam ``strain`` and ``resultant`` (its elastic part: that of damped sections is left to
    ``diagnostics.section_forces``), for each joint ``position``, ``force`` and ``moment``, its
    relative coordinates and their rates, for each spring, damper, cable and bushing
    ``coordinate`` and ``force``.

    ``energy_balance`` is ``energy - work_loads - work_actuators - work_drives + dissipated`` less
    its first value: zero up to the solver's tolerance with energy-momentum, where all terms
    belong to the discrete equations; with the variational scheme an error of second order in the
    step that oscillates. ``external`` is the potential of gravity and dead loads: their work is in
    ``work_loads`` too, add one or the other.
    """
    check_kind("argument history", history, History)
    q, p, t = history["q"], history["p"], history.times
    v, projected = Projection(system).stack(q, p, t)
    kinetic = diagnostics.kinetic_energy(system, p)
    turns = history.series.get("turns")
    strain = diagnostics.strain_energy(system, q)
    coupling = diagnostics.coupling_energy(system, q, t, turns)
    series: dict[str, Floats] = {
        "v": v,
        "Qp": projected,
        "kinetic": kinetic,
        "strain_energy": strain,
        "external": diagnostics.external_energy(system, q, t),
        "coupling_energy": coupling,
        "energy": kinetic + strain + coupling,
        "energy_projected": diagnostics.kinetic_energy(system, projected) + strain + coupling,
        "linear_momentum": diagnostics.linear_momentum(system, p),
        "angular_momentum": diagnostics.angular_momentum(system, q, p),
        "angular_momentum_projected": diagnostics.angular_momentum(system, q, projected),
        "hidden_violation": diagnostics.hidden_violation(system, q, v, t),
    }
    for name, values in series.items():
        history.add_series(name, values)
    _add_balance(history)
    derive_configuration(system, history, t)


def derive_segments(systems: Sequence[System], history: History) -> None:
    """The same for a run whose system changed, for each of its segments.

    A series that a segment does not have, of a joint that is gone say, is NaN there. Multipliers
    are in the order of their own system's rows, behind them NaN.
    """
    found: list[dict[str, Floats]] = []
    for k, system in enumerate(systems):
        part = history.segment(k)
        basic = set(part)
        if len(part):
            derive_series(system, part)
        found.append({name: part[name] for name in list(part) if name not in basic})
    spans = history.segments
    for name in dict.fromkeys(name for part in found for name in part):
        shapes = [part[name].shape[1:] for part in found if name in part]
        size = tuple(int(each) for each in np.max(shapes, axis=0)) if shapes[0] else ()
        out = np.full((len(history), *size), np.nan)
        for (start, stop), derived in zip(spans, found, strict=True):
            if name in derived:
                own = derived[name]
                out[(slice(start, stop), *(slice(length) for length in own.shape[1:]))] = own
        history.add_series(name, out)
    _add_balance(history)


def _add_balance(history: History) -> None:
    """Energy less all work done since the start, and what was dissipated."""
    if "work_loads" in history:
        work = sum(history[name] for name in ("work_loads", "work_actuators", "work_drives"))
        balance = history["energy"] - work + history["dissipated"]
        history.add_series("energy_balance", balance - balance[:1])


def derive_configuration(system: System, history: History, t: Floats) -> None:
    """Add what follows from the configurations, the constraint forces and the velocities "v".

    Parameters
    ----------
    t : (N,) array
        Times of the prescribed motion.
    """
    q, v = history["q"], history["v"]
    turns = history.series.get("turns")
    series: dict[str, Floats] = {
        "constraint_violation": diagnostics.constraint_violation(system, q, t)
    }
    series |= relative_series(system, q, v, t, turns)
    y = diagnostics.constraint_points(system, history)
    lam = series["multipliers"] = diagnostics.multipliers(system, y, history["constraint_force"])
    for beam in (s for s in system.structures if is_beam(s)):
        series[f"beam/{beam.name}/strain"] = diagnostics.section_strains(system, beam, q)
        forces = diagnostics.section_forces(system, beam, q, multipliers=lam)
        series[f"beam/{beam.name}/resultant"] = forces
    for name, (force, moment) in diagnostics.reactions(system, y, lam).items():
        series[f"joint/{name}/force"], series[f"joint/{name}/moment"] = force, moment
    rows = all_rows(system, q, t)
    for jr in system.joint_rows:
        series[f"joint/{jr.joint.name}/position"] = _positions(system, jr.joint.a, rows)
    for item in system.couplings.items:
        ends = [_positions(system, place, rows) for place in (item.a, item.b)]
        series[f"coupling/{item.name}/ends"] = np.stack(ends, axis=1)
    for name, values in series.items():
        history.add_series(name, values)


def _positions(system: System, place: Place, y: Floats) -> Floats:
    """Where a place is, (N, 3)."""
    terms = system.kinematics.spot_terms(system.spot(place))
    return np.asarray(sum(c * y[:, a] for a, c in terms))
