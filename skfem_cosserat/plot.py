"""Charts of a history (matplotlib, optional)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from .arguments import checked
from .errors import InputError
from .export.table import record_of
from .figures import PALETTE, legend, panels, write_figure
from .history import History, SensorRecord
from .history.container import BALANCE
from .types import FilePath, Floats, names_known

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ENERGIES = {
    "kinetic": "kinetic",
    "strain_energy": "strain",
    "coupling_energy": "springs",
    "external": "external",
    "energy": "total",
    "energy_midpoint": "total (midpoint)",
    BALANCE: "balance",
}
_TOTALS = ("energy", "energy_midpoint")
#: by the last part of a series' name
_UNITS = {
    **dict.fromkeys((*_ENERGIES, "dissipated"), "J"),
    **dict.fromkeys(("work_loads", "work_actuators", "work_drives"), "J"),
    **{"angle": "rad", "displacement": "m", "angle_rate": "rad/s", "displacement_rate": "m/s"},
    **{"force": "N", "moment": "N m", "position": "m", "coordinate": "m"},
    **{"linear_momentum": "kg m/s", "angular_momentum": "kg m²/s"},
}
#: what is drawn unless names are given: of springs if there are some
_USUAL = ("kinetic", "strain_energy", "coupling_energy", *_TOTALS)


@checked
def plot_energy(
    history: History,
    path: FilePath | None = None,
    names: Sequence[str] | None = None,
    since: float = -np.inf,
) -> Figure:
    """Chart of the energies over time, and below it of what is wrong with their sum.

    Parameters
    ----------
    history : History
        With some of the series ``kinetic, strain_energy, coupling_energy, external, energy,
        energy_midpoint, energy_balance (N,)`` in J; ``coupling_energy`` is that of springs.
    path : path-like, optional
        Write the chart here (``.png``, ``.svg``, ``.pdf``).
    names : sequence of str, optional
        Which of them, as far as recorded. ``energy_balance`` is drawn below the others: the total
        less the work that was done and plus what was dissipated, zero for a perfect run. Without it
        the change of the totals is drawn there, which is an error only if nothing does work: no
        gravity, no loads, no drives. Default: all but ``external``, the potential of the loads,
        since that of a strong pulse would hide all others.
    since : float
        Time in s from which the balance, or the change of the total, counts, such as the end of a
        pulse. Default: from the start.

    Returns
    -------
    matplotlib.figure.Figure
        Over the load factor, of a path of equilibria.

    Raises
    ------
    InputError
        If none of the series was recorded, or a name is no energy.
    ImportError
        Without matplotlib.

    Examples
    --------
    >>> import numpy as np
    >>> zeros = np.zeros((2, 3))
    >>> series = {"t": [0.0, 0.1], "step": [0, 1], "q": zeros, "p": zeros, "energy": [2.0, 2.0]}
    >>> len(plot_energy(History({}, {}, series)).axes)
    2
    """
    return _chart(history, _energy_parts(history, names, since), path)


#: a panel of a chart: its height, and what draws into its axes
_Part = tuple[float, Callable[[Any], None]]


def _chart(history: History, parts: Sequence[_Part], path: FilePath | None) -> Figure:
    """Panels below each other over the same times."""
    heights = [height for height, _ in parts]
    size = 1.0 + sum(heights) * 4 / 3
    figure, axes = panels(7.5, size, len(parts), sharex=True, height_ratios=heights)
    for axis, (_, draw) in zip(axes, parts, strict=True):
        draw(axis)
        for line in axis.get_lines():  # of a single state
            line.set_marker("o" if len(line.get_xdata()) == 1 else "")
    axes[-1].set_xlabel("load factor" if "load_factor" in history else "time in s")
    return write_figure(figure, path)


def _energy_parts(history: History, names: Sequence[str] | None, since: float) -> list[_Part]:
    """Panels of the energies and of their balance."""
    for name in names or ():
        if name not in _ENERGIES:
            text = f"got {name!r}, expected some of them; {names_known(name, _ENERGIES)}"
            raise InputError("argument names", text)
    springs = "coupling_energy" in history and bool(np.any(history["coupling_energy"]))
    usual = [name for name in _USUAL if name != "coupling_energy" or springs]
    wanted = [*usual, BALANCE] if names is None else list(names)
    present = [name for name in _ENERGIES if name in history and name in wanted]
    if not present:
        raise InputError("history", f"has no energy series; expected some of {wanted}")
    x = history.abscissa
    colours = dict(zip(_ENERGIES, PALETTE.values(), strict=False)) | {"energy": "black"}
    above = [name for name in present if name != BALANCE]
    below = [BALANCE] if BALANCE in present else [name for name in above if name in _TOTALS]
    known = {*present, *(name for name in usual if name in history)}
    scale = max(float(np.nanmax(abs(history[name]), initial=0.0)) for name in known)

    def draw(axis: Any, name: str, values: Floats) -> None:
        axis.plot(x, values, color=colours[name], label=_ENERGIES[name], linewidth=1.0)

    def energies(axis: Any) -> None:
        for name in above:
            draw(axis, name, history[name])
        axis.set_ylabel("energy in J")
        legend(axis)

    def balance(axis: Any) -> None:
        for name in below:
            values = np.where(x >= since, history[name], np.nan)
            valid = values[np.isfinite(values)]
            if len(valid) and scale > 0.0:
                draw(axis, name, (values - valid[0]) / scale)
        what = "balance of energy" if BALANCE in below else "change of total"
        axis.set_ylabel(f"{what}\n/ largest energy")
        axis.axhline(0.0, color="grey", linewidth=0.5, zorder=1, label="_zero")

    return [(2.0, energies)] * bool(above) + [(1.0, balance)] * bool(below)


def _numbers(history: History, name: str, record: SensorRecord, axis: Any) -> None:
    """The numbers of a sensor or series."""
    lines = axis.plot(record.times, record.values, linewidth=1.0)
    item, _, what = name.rpartition("/")
    couplings = history.meta.get("couplings", ())
    between = {f"coupling/{c['name']}" for c in couplings if c["type"] in ("spring", "cable")}
    unit = record.unit
    # on a coordinate of a joint, or several of them, it may be a moment
    if not unit and (item in between or not item.startswith("coupling/")):
        unit = _UNITS.get(what, "")
    axis.set_ylabel(f"{name} in {unit}" if unit else name)
    if 1 < len(lines) <= 6:
        for line, label in zip(lines, "xyz" if len(lines) == 3 else "012345", strict=False):
            line.set_label(label)
        legend(axis)


@checked
def plot(history: History, names: Sequence[str] = (), path: FilePath | None = None) -> Figure:
    """Chart of energies, sensors and series, see :meth:`History.plot`."""
    energies = ["energy"] if "kinetic" in history or "strain_energy" in history else []
    parts = []
    for name in names or energies + [*history.sensors] or ["work_loads"]:
        if name == "energy":
            parts += _energy_parts(history, None, -np.inf)
        else:
            parts.append((1.5, partial(_numbers, history, name, record_of(history, name))))
    return _chart(history, parts, path)


def _path_of(history: History, what: str) -> Floats:
    """Places ``(N, 3)`` of a body, mass point, beam node or joint."""
    static, (item, _, node) = history.static, what.rpartition("/")
    if what.startswith("joint/") and f"{what}/position" in history:
        return history[f"{what}/position"]
    if f"{what}/offset" in static:
        start = int(static[f"{what}/offset"])
    elif f"{item}/offsets" in static:
        # nodes at vertices of the mesh: where lines start, inner ones, where lines end
        starts = static[f"{item}/connectivity"][:, 0]
        ends = static[f"{item}/connectivity"][:, -1]
        outer = np.setdiff1d(starts, ends), np.setdiff1d(ends, starts)
        vertices = np.concatenate([outer[0], np.intersect1d(starts, ends), outer[1]])
        try:
            start = int(static[f"{item}/offsets"][vertices[int(node)]])
        except (ValueError, IndexError):
            text = f"got {what!r}, the mesh of {item} has {len(vertices)} vertices"
            raise InputError("argument what", text) from None
    else:
        kinds = "'body/NAME', 'point/NAME', 'joint/NAME' or 'beam/NAME/NODE'"
        raise InputError("argument what", f"got {what!r}, expected {kinds}")
    return history["q"][:, start : start + 3]


@checked
def plot_orbit(
    history: History,
    what: str | Sequence[str],
    path: FilePath | None = None,
    axes: str = "xy",
) -> Figure:
    """Chart of the way of one or several points, seen along a coordinate axis.

    Parameters
    ----------
    history : History
        Recorded states.
    what : str or sequence of str
        ``"body/NAME"``, ``"point/NAME"``, ``"joint/NAME"`` or ``"beam/NAME/NODE"``: vertices of the
        mesh by their numbers, but 0 where the beam starts and -1 where it ends.
    path : path-like, optional
        Write the chart here.
    axes : str
        Two of ``x``, ``y``, ``z``: to the right and up.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If there is no such point, or ``axes`` are not two different axes.
    ImportError
        Without matplotlib.

    Examples
    --------
    >>> import numpy as np
    >>> q = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    >>> series = {"t": [0.0, 0.1], "step": [0, 1], "q": q, "p": q}
    >>> history = History({}, {"point/tip/offset": np.array(0)}, series)
    >>> plot_orbit(history, "point/tip", axes="xz").axes[0].get_ylabel()
    'z in m'
    """
    if len(axes) != 2 or len(set(axes)) != 2 or not set(axes) <= set("xyz"):
        raise InputError("argument axes", f"got {axes!r}, expected two of 'x', 'y', 'z'")
    names = [what] if isinstance(what, str) else list(what)
    columns = ["xyz".index(letter) for letter in axes]
    ways = [_path_of(history, name)[:, columns] for name in names]
    figure, (axis,) = panels(6.5, 4.5)
    for name, way in zip(names, ways, strict=True):
        line = axis.plot(way[:, 0], way[:, 1], linewidth=1.0, label=name)[0]
        axis.plot(way[:1, 0], way[:1, 1], "o", color=line.get_color(), markersize=4)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel(f"{axes[0]} in m")
    axis.set_ylabel(f"{axes[1]} in m")
    legend(axis)
    return write_figure(figure, path)
