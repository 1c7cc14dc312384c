"""Charts of a history (matplotlib, optional)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .arguments import checked
from .errors import InputError
from .figures import PALETTE, legend, panels, write_figure
from .history import History
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
    "energy_balance": "balance",
}
#: by the last part of a series' name
_UNITS = {
    **dict.fromkeys((*_ENERGIES, "dissipated"), "J"),
    **dict.fromkeys(("work_loads", "work_actuators", "work_drives"), "J"),
    **{"angle": "rad", "displacement": "m", "angle_rate": "rad/s", "displacement_rate": "m/s"},
    **{"force": "N", "moment": "N m", "position": "m", "coordinate": "m"},
    **{"linear_momentum": "kg m/s", "angular_momentum": "kg m²/s"},
}
#: what is drawn unless names are given: of springs if there are some
_USUAL = ("kinetic", "strain_energy", "coupling_energy", "energy", "energy_midpoint")


@checked
def plot_energy(
    history: History,
    path: FilePath | None = None,
    names: Sequence[str] | None = None,
    since: float = 0.0,
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
        pulse.

    Returns
    -------
    matplotlib.figure.Figure

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
    for name in names or ():
        if name not in _ENERGIES:
            text = f"got {name!r}, expected some of them; {names_known(name, _ENERGIES)}"
            raise InputError("argument names", text)
    springs = "coupling_energy" in history and bool(np.any(history["coupling_energy"]))
    usual = [name for name in _USUAL if name != "coupling_energy" or springs]
    wanted = [*usual, "energy_balance"] if names is None else list(names)
    present = [name for name in _ENERGIES if name in history and name in wanted]
    if not present:
        raise InputError("history", f"has no energy series; expected some of {wanted}")
    balanced = "energy_balance" in present
    drawn = [name for name in present if name != "energy_balance"]
    totals = [name for name in drawn if _ENERGIES[name].startswith("total")]
    below = ["energy_balance"] if balanced else totals
    sizes = [name for name in usual if name in history] if balanced else []
    scale = max(float(np.nanmax(abs(history[name]), initial=0.0)) for name in present + sizes)

    ratios = [2] * bool(drawn) + [1] * bool(below)
    rows = len(ratios)
    figure, axes = panels(7.5, 5.0 if rows > 1 else 3.2, rows, sharex=True, height_ratios=ratios)
    colours = dict(zip(_ENERGIES, PALETTE.values(), strict=False))
    for name in drawn:
        style = {"color": "black"} if name == "energy" else {"color": colours[name], "lw": 1.0}
        axes[0].plot(history.times, history[name], label=_ENERGIES[name], **style)
    if drawn:
        axes[0].set_ylabel("energy in J")
        legend(axes[0])
    for name in below:
        valid = np.flatnonzero(np.isfinite(history[name]) & (history.times >= since))
        if len(valid) and scale > 0.0:
            first = valid[0]  # later gaps stay gaps
            drift = (history[name][first:] - history[name][first]) / scale
            style = {"color": "black" if name == "energy" else colours[name], "lw": 1.0}
            axes[-1].plot(history.times[first:], drift, label=_ENERGIES[name], **style)
    if below:
        what = "balance of energy" if balanced else "change of total"
        axes[-1].set_ylabel(f"{what}\n/ largest energy")
        axes[-1].axhline(0.0, color="grey", linewidth=0.5, zorder=1)
    axes[-1].set_xlabel("time in s")
    return write_figure(figure, path)


@checked
def plot_series(history: History, names: Sequence[str], path: FilePath | None = None) -> Figure:
    """Chart of scalar or vector series over time, one panel for each.

    Parameters
    ----------
    history : History
        Recorded states.
    names : sequence of str
        Series of shape ``(N,)`` or ``(N, k)``.
    path : path-like, optional
        Write the chart here.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If a series does not exist or is no scalar or vector.
    ImportError
        Without matplotlib.

    Examples
    --------
    >>> import numpy as np
    >>> zeros = np.zeros((2, 3))
    >>> series = {"t": [0.0, 0.1], "step": [0, 1], "q": zeros, "p": zeros}
    >>> len(plot_series(History({}, {}, series), ["q", "p"]).axes)
    2
    """
    if not names:
        raise InputError("argument names", "is empty, expected at least one series")
    for name in names:
        if history[name].ndim > 2:
            raise InputError(f"series {name!r}", f"has shape {history[name].shape}")
    figure, axes = panels(7.5, 1.0 + 2.0 * len(names), len(names), sharex=True)
    for axis, name in zip(axes, names, strict=True):
        lines = axis.plot(history.times, history[name], linewidth=1.0)
        axis.set_ylabel(_with_unit(history, name))
        if 1 < len(lines) <= 6:
            for line, label in zip(lines, "xyz" if len(lines) == 3 else "012345", strict=False):
                line.set_label(label)
            legend(axis)
    axes[-1].set_xlabel("time in s")
    return write_figure(figure, path)


def _with_unit(history: History, name: str) -> str:
    """The name of a series with its unit, where it is known."""
    item, _, what = name.rpartition("/")
    couplings = history.meta.get("couplings", ())
    between = {f"coupling/{c['name']}" for c in couplings if c["type"] in ("spring", "cable")}
    if item.startswith("coupling/") and item not in between:
        return name  # on a coordinate of a joint, or several of them: it may be a moment
    return f"{name} in {_UNITS[what]}" if what in _UNITS else name


def _path_of(history: History, what: str) -> Floats:
    """Places ``(N, 3)`` of a body, mass point, beam node or joint."""
    kind, _, rest = what.partition("/")
    name, _, node = rest.rpartition("/")
    if kind == "joint" and f"{what}/position" in history:
        return history[f"{what}/position"]
    if kind in ("body", "point") and f"{what}/offset" in history.static:
        start = int(history.static[f"{what}/offset"])
        return history["q"][:, start : start + 3]
    if kind == "beam" and f"beam/{name}/offsets" in history.static:
        offsets = history.static[f"beam/{name}/offsets"]
        digits = node.removeprefix("-")
        if digits.isdigit() and -len(offsets) <= int(node) < len(offsets):
            start = int(offsets[int(node)])
            return history["q"][:, start : start + 3]
        raise InputError("argument what", f"got {what!r}, beam {name!r} has {len(offsets)} nodes")
    raise InputError(
        "argument what",
        f"got {what!r}, expected 'body/NAME', 'point/NAME', 'joint/NAME' or 'beam/NAME/NODE'",
    )


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
        ``"body/NAME"``, ``"point/NAME"``, ``"joint/NAME"`` or ``"beam/NAME/NODE"`` (negative nodes
        count from the end).
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
