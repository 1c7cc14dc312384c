"""States carried over to a system of the same scene on other meshes, or with other theories."""

from __future__ import annotations

import numpy as np

from ..constraints.saddle import nearest_velocity
from ..diagnostics import momentum
from ..diagnostics.error import new_rows, spins, transfer
from ..diagnostics.nearest import nearest_configuration, settled
from ..errors import InputError
from ..integrators import State
from ..model import Model, System, system_of
from ..model.balance import amplitudes_at, balance
from ..types import Floats
from .start import checked_start


def carry_state(source: Model | System, target: Model | System, state: State) -> State:
    """A state of one system in another one with other meshes, orders or theories of its beams.

    Configuration and velocity go over by :func:`skfem_cosserat.diagnostics.transfer`: nodes that
    are in both systems keep them. New nodes are then brought into balance between those, with the
    loads and accelerations of that instant: left where they were interpolated, stiff motions
    (shear, extension) would get energy of their own.

    Where beams of `target` hold strains (:class:`skfem_cosserat.Theory`) it is the nearest
    configuration without these, the one that changes the other strains least, and the nearest
    velocity in the kinetic energy; the centre of mass and the linear momentum of a scene in free
    flight stay what they are. What `source` holds and `target` does not starts without strain:
    its forces, which were multipliers, have to build up anew, and vibrations with them. Begin such
    runs where these forces are small, or damp them.

    Parameters
    ----------
    source, target : Model or System
        Of the same scene, see :meth:`skfem_cosserat.Beam.refined`; with any theories.
    state : State
        Of `source`.

    Returns
    -------
    State
        Of `target`, for a run or a path that goes on from there. Its momentum is that of the
        velocity on the hidden constraints.

    Raises
    ------
    InputError, MeshError
        If the systems do not belong together, or a beam is bent, drawn or twisted too far for what
        it is to hold: named with both theories.

    Examples
    --------
    >>> from skfem_cosserat import Beam, MeshCurve, Model, Section, initial_state
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4), section, velocity=(3.0, 0, 0))
    >>> systems = []
    >>> for item in (beam.refined([3]), beam):
    ...     model = Model()
    ...     rod = model.add("rod", item)
    ...     systems.append(model.freeze())
    >>> fine, coarse = systems
    >>> state = carry_state(coarse, fine, initial_state(coarse))
    >>> bool(abs(state.p - initial_state(fine).p).max() < 1e-12)
    True
    """
    source = system_of(source, "argument source")
    target = system_of(target, "argument target")
    checked_start(source, state)
    v = nearest_velocity(source, source.extend(state.q, state.time), state.p, state.time)
    q, v = transfer(source, target, state.q, v)
    q, v = _settled(source, target, state.q, q, v, state.time)
    q, v = _held(source, target, q, v, state.time)
    p, factor = momentum(target, v), state.load_factor
    return State(state.time, state.index, q, p, True, state.turns, load_factor=factor)


def _settled(
    source: System, target: System, before: Floats, q: Floats, v: Floats, t: float
) -> tuple[Floats, Floats]:
    """With new nodes in balance between the others, and turning as they did.

    Their accelerations are interpolated from those that the forces cause in `source` at `before`.
    """
    loads = amplitudes_at(source, t)
    y = source.extend(before, t)
    a = nearest_velocity(source, y, -balance(source, y, loads).R.ravel(), None)
    inertia = momentum(target, transfer(source, target, before, a)[1])
    rows, y = new_rows(source, target), target.extend(q, t)
    rest = settled(target, y, amplitudes_at(target, t), rows, inertia)
    rates = v.reshape(-1, 3).copy()
    spin = spins(y[rows], rates[rows])
    rates[rows[:, 1:]] = np.cross(spin[:, None], rest[rows[:, 1:]])
    return rest[: target.rows].ravel(), rates.ravel()


def _held(source: System, target: System, q: Floats, v: Floats, t: float) -> tuple[Floats, Floats]:
    """Without the strains that beams of the target hold.

    Raises
    ------
    InputError
        Naming a beam with its theories in both systems.
    """
    if not target.theory_rows:
        return q, v
    y = target.extend(q, t)
    found = nearest_configuration(target, y)
    if found is None:
        g = abs(target.constraints.values(y))
        worst = max(target.theory_rows, key=lambda rows: float(g[rows.rows].max()))
        known = {beam.name: beam.theory for beam in source.beams}
        raise InputError(
            worst.beam.label,
            f"its state with {known[worst.beam.name]!r} cannot be carried over to"
            f" {worst.beam.theory!r}: no configuration near it is without the strains that this"
            " theory holds",
        )
    return found[: target.rows].ravel(), nearest_velocity(target, found, momentum(target, v), t)
