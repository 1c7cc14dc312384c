"""States and histories carried over to a system of the same scene on other meshes."""

from __future__ import annotations

import numpy as np

from ..diagnostics import Projection, momentum
from ..diagnostics.nearest import nearest_configuration
from ..diagnostics.settle import settled
from ..diagnostics.transfer import new_rows, spins, transfer
from ..errors import HistoryError, InputError
from ..history import History
from ..integrators import State
from ..kinds import is_beam
from ..model import System
from ..model.balance import amplitudes_at, balance
from ..simulate.describe import describe, other_model
from ..simulate.start import checked_start
from ..statics.record import recorded_amplitudes
from ..types import Floats

__all__ = ["carry_history", "carry_state"]

#: meta data that tell of the run and not of the system
_RUN = ("integrator", "treatment", "step", "status", "parameter", "kernels", "solver")
#: series that no mesh has a part in, beside those whose names begin with one of _ITEMS
_KEPT = (
    *("t", "step", "load_factor", "unstable", "critical", "turns"),
    *("newton_iterations", "attempts", "residual"),
    *("work_loads", "work_actuators", "work_drives", "dissipated", "work_ground"),
)
_ITEMS = ("joint/", "coupling/", "amplitudes/")


def carry_state(source: System, target: System, state: State) -> State:
    """A state of one system in another one with other meshes, orders or rungs of its beams.

    Configuration and velocity go over by :func:`skfem_cosserat.diagnostics.transfer`: nodes that
    are in both systems keep them. New nodes are then brought into balance between those, with the
    loads and accelerations of that instant: left where they were interpolated, stiff motions
    (shear, extension) would get energy of their own.

    Where beams of `target` hold strains (:class:`skfem_cosserat.Rung`) it is the nearest
    configuration without these, the one that changes the other strains least, and the nearest
    velocity in the kinetic energy; the centre of mass and the linear momentum of a scene in free
    flight stay what they are. What `source` holds and `target` does not starts without strain:
    its forces, which were multipliers, have to build up anew, and vibrations with them. Begin such
    runs where these forces are small, or damp them.

    Parameters
    ----------
    source, target : System
        Of the same scene, see :meth:`skfem_cosserat.Beam.refined`; with any rungs.
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
        it is to hold: named with both rungs.

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
    checked_start(source, state)
    v = Projection(source)(state.q, state.p, state.time)[0]
    q, v = transfer(source, target, state.q, v)
    q, v = _settled(source, target, state.q, q, v, state.time)
    q, v = _held(source, target, q, v, state.time)
    return State(state.time, state.index, q, momentum(target, v), True, state.turns)


def carry_history(source: System, target: System, history: History) -> History:
    """A history of one system as one of another system with refined meshes.

    All states go over, so that :func:`skfem_cosserat.restart`, :func:`skfem_cosserat.equilibrium`
    and exports take it for one of `target`: the last one, from which it goes on, as in
    :func:`carry_state`, those before it as they are interpolated. Reactions and
    coordinates of joints, works and times are kept as they were found; what belongs to the old
    mesh (strains, resultants, energies, multipliers of triads) is left out:
    :func:`skfem_cosserat.simulate.derive_series` gives energies and resultants anew.

    Parameters
    ----------
    source, target : System
    history : History
        Of `source`: of a run or a path.

    Returns
    -------
    History
        Its ``meta["carried"]`` holds the counts of `source`.

    Raises
    ------
    HistoryError
        If the history is none of `source`.
    InputError, MeshError
        If the systems do not belong together.
    """
    difference = other_model(source, history.meta.get("fingerprint", {}))
    if difference:
        raise HistoryError("history", f"belongs to another model: {difference}")
    times = history.series.get("load_factor", history.times)
    v, _ = Projection(source).stack(history["q"], history["p"], times)
    q, v = transfer(source, target, history["q"], v)
    if len(history):
        t, last = float(times[-1]), history["q"][-1]
        if "load_factor" in history:  # loads may be those of a path: at rest
            y, rows = target.extend(q[-1], t), new_rows(source, target)
            y, _ = settled(target, y, recorded_amplitudes(history), rows)
            q[-1] = y[: target.rows].ravel()
        else:
            q[-1], v[-1] = _settled(source, target, last, q[-1], v[-1], t)
        q[-1], v[-1] = _held(source, target, q[-1], v[-1], t)
    p = momentum(target, v)
    count = len(history)
    meta, static = describe(target)
    meta |= {name: history.meta[name] for name in _RUN if name in history.meta}
    meta["carried"] = source.counts()
    series = {
        name: values
        for name, values in history.series.items()
        if name in _KEPT or name.startswith(_ITEMS)
    }
    nothing = np.full((count, target.n), np.nan)
    series |= {"q": q, "p": p, "carried": p, "fresh": np.ones(count), "constraint_force": nothing}
    if "constraint_point" in history:
        series["constraint_point"] = np.full((count, 3 * target.total), np.nan)
    return History(meta, static, series)


def _settled(
    source: System, target: System, before: Floats, q: Floats, v: Floats, t: float
) -> tuple[Floats, Floats]:
    """With new nodes in balance between the others, and turning as they did.

    Their accelerations are interpolated from those that the forces cause in `source` at `before`.
    """
    loads = amplitudes_at(source, t)
    R = balance(source, source.extend(before, t), loads).R.ravel()
    projection = Projection(source)
    a = projection(before, -R, t)[0] - projection(before, np.zeros(source.n), t)[0]
    inertia = momentum(target, transfer(source, target, before, a)[1])
    rows, y = new_rows(source, target), target.extend(q, t)
    rest, _ = settled(target, y, amplitudes_at(target, t), rows, inertia)
    rates = v.reshape(-1, 3).copy()
    spin = spins(y[rows], rates[rows])
    rates[rows[:, 1:]] = np.cross(spin[:, None], rest[rows[:, 1:]])
    return rest[: target.rows].ravel(), rates.ravel()


def _held(source: System, target: System, q: Floats, v: Floats, t: float) -> tuple[Floats, Floats]:
    """Without the strains that beams of the target hold.

    Raises
    ------
    InputError
        Naming a beam with its rungs in both systems.
    """
    if not target.rung_rows:
        return q, v
    y = target.extend(q, t)
    found = nearest_configuration(target, y)
    if found is None:
        g = abs(target.constraints.values(y))
        worst = max(target.rung_rows, key=lambda rows: float(g[rows.rows].max()))
        known = {item.name: item.rung for item in source.structures if is_beam(item)}
        raise InputError(
            worst.beam.label,
            f"its state with {known[worst.beam.name]!r} cannot be carried over to"
            f" {worst.beam.rung!r}: no configuration near it is without the strains that the latter"
            " holds",
        )
    q = found[: target.rows].ravel()
    return q, Projection(target)(q, momentum(target, v), t)[0]
