"""What scenes compiled kernels refuse, and why."""

from __future__ import annotations

import numpy as np

from ..constraints import Multipliers, NullSpace, Treatment
from ..frames import TOLERANCE
from ..model import System
from .base import Integrator
from .coupled import scalar

__all__ = ["refusal", "static_refusal"]

#: rows around the elimination of the tree: each costs a sweep a step
BORDER = 40


def refusal(system: System, integrator: Integrator, treatment: Treatment) -> str | None:
    """Why a scene cannot be stepped by compiled kernels; None: it can."""
    if integrator.single.scheme(1.0) is None:
        return f"the {integrator.name} integrator gives no scheme for compiled kernels"
    looped = len(system.closure.rows) > 0
    return _missing(
        treatment,
        (NullSpace, Multipliers),
        {
            "closed loops with multipliers": looped and isinstance(treatment, Multipliers),
            # whether motions agree around a loop is looked at in the general way only
            "closed loops in prescribed motion": looped and bool(system.moving),
            "springs on rotation vectors, bushings": not scalar(system.couplings),
            **_everywhere(system),
            **_rungs(system, treatment),
            **_plane(system, treatment),
        },
    )


def static_refusal(system: System, treatment: Treatment, spin: object) -> str | None:
    """Why equilibria of a scene cannot be found by compiled kernels; None: they can."""
    return _missing(
        treatment,
        (NullSpace,),
        {
            "closed loops": len(system.closure.rows) > 0,
            "springs, dampers and actuators": system.couplings.count > 0,
            **_everywhere(system),
            "scenes confined to a plane": system.plane is not None,
            "rungs of beams": len(system.rung_rows) > 0,
            "a turning frame": spin is not None,
        },
    )


def _everywhere(system: System) -> dict[str, bool]:
    return {
        "beams of several orders": len(system.beam_groups) > 1,
        "sections of a stored energy function": any(g.elements.stored for g in system.beam_groups),
    }


def _plane(system: System, treatment: Treatment) -> dict[str, bool]:
    """What there is for scenes in space only."""
    if system.plane is None:
        return {}
    return {
        "scenes confined to a plane with multipliers": isinstance(treatment, Multipliers),
        "moments and forces that follow the motion in a plane": not system.loading.dead_only,
        "springs, dampers and actuators in a plane": system.couplings.count > 0,
        "viscous sections and drag in a plane": system.damped,
        "prescribed motion in a plane": bool(system.moving),
        "beams in a plane whose sections are turned out of it": _oblique(system),
    }


def _oblique(system: System) -> bool:
    """Whether third directors of sections leave the plane, or others differ in an element."""
    assert system.plane is not None
    y = system.extend(system.q0, system.since)
    for g in system.beam_groups:
        d = y[system.origin_rows[g.vertices][:, :, None] + np.arange(1, 4)]
        if g.elements.rotations is not None:
            d = g.elements.rotations @ d
        rise = d @ system.plane.normal
        off = max(abs(rise[..., 2]).max(), abs(rise - rise[:, :1]).max())
        if off > TOLERANCE:
            return True
    return False


def _rungs(system: System, treatment: Treatment) -> dict[str, bool]:
    held = len(system.rung_rows) > 0
    curved = any(len(s.vertices) > 2 and not s.rigid for s, _ in system.tree.spans)
    return {
        "rungs of beams with multipliers": held and isinstance(treatment, Multipliers),
        "rungs of beams of higher order than one": curved,
        f"rungs of beams with more than {BORDER} rows that close loops or hold torsion": held
        and system.closure.rank > BORDER,
    }


def _missing(
    treatment: Treatment, kinds: tuple[type[Treatment], ...], reasons: dict[str, bool]
) -> str | None:
    """What there are no compiled kernels for, of treatments and of what a scene may have."""
    if not isinstance(treatment, kinds):
        return f"there are no compiled kernels for {treatment.name}"
    found = [what for what, there in reasons.items() if there]
    return f"there are no compiled kernels for {', '.join(found)}" if found else None
