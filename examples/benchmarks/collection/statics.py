"""What the families of equilibria share: their inputs, the answer of ``main``, limits, tables."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

sys.path.extend(str(Path(__file__).resolve().parents[k]) for k in (1, 2))

import static_scenes
from static_scenes import Scene

import skfem_cosserat as sc
from collection.common import Cost, compare, levels, overridden, refined, tabled, timed
from collection.inputs import method

__all__ = ["HELD", "Asked", "answer", "bifurcation", "chosen", "extrapolated", "held", "highest"]
__all__ += ["inputs", "limit", "limit_points", "numbered", "parts", "regular", "table"]

#: inputs that may be negative, or zero
SIGNED = {"P", "alpha", "lam", "M", "F", "theta", "phi", "axis", "w"}
#: relative distance of the loads between which a bifurcation load is interpolated
AROUND = 3e-3
#: the same of displacements, for limit points
NEAR = 2e-3
#: displacements about a limit point, in units of that distance from it
SHARES = np.array([-1.0, -0.6, -0.2, 0.2, 0.6, 1.0])
#: how often points are taken about a displacement that turns out to be too far away
PASSES = 8
#: elements times their order of the coarsest mesh that is extrapolated from
LEAST = 12
#: elements by order of a beam whose theory holds strains: 288 unknowns
HELD = {1: 96, 2: 48, 3: 32, 4: 24}


@dataclass
class Asked:
    """How a case is computed; counts what that takes.

    Attributes
    ----------
    order, elements : int
        Of a beam.
    treatment : Treatment
    cost : Cost
    total : int
        Elements of all beams of the largest scene so far.
    """

    order: int
    elements: int
    treatment: Any
    cost: Cost
    total: int = 0

    @property
    def even(self) -> int:
        """Elements where one half ends at a node: the next even number."""
        return self.elements + self.elements % 2

    def path(self, scene: Scene, control: Any = None, **options: Any) -> sc.History:
        """Follow a path of the scene; only positions unless ``derive=True``."""
        self.note(scene)
        history = sc.static(
            scene.system, self.treatment, control, **{"derive": False, "watch": False, **options}
        )
        self.cost.add(history)
        return history

    def search(self, scene: Scene, control: Any) -> sc.History:
        """Follow a path for its critical points, as far as it goes."""
        try:
            return self.path(scene, control, watch=True)
        except sc.Diverged as failure:
            if failure.history is None:
                raise
            self.cost.newton_iterations += int(failure.history["newton_iterations"].sum())
            return failure.history

    def note(self, scene: Scene) -> None:
        """Count a scene's elements and unknowns."""
        system = scene.system
        saddle = isinstance(self.treatment, sc.Multipliers)
        unknowns = system.n + system.m if saddle else system.unknowns
        self.cost.unknowns = max(self.cost.unknowns, unknowns)
        self.total = max(self.total, len(scene.beam.basis.connectivity))


def answer(
    compute: Callable[[Asked], Mapping[str, Any]],
    fields: Sequence[str],
    counts: Mapping[int, int],
    order: int,
    elements: int | None,
    step: float | None,
    integrator: str,
    treatment: str,
    times: Any,
) -> dict[str, Any]:
    """What ``main`` gives: the case's numbers, NaN where no equilibrium was found, and the cost.

    Parameters
    ----------
    compute : callable
        Gives the numbers.
    fields : sequence of str
        Their names.
    counts : mapping of int to int
        Default number of elements by order.
    order, elements, step, integrator, treatment, times
        Of ``main``.

    Raises
    ------
    InputError
        For an argument that is none of its kind.
    """
    given = method(order, elements, step, integrator, treatment, times)
    number = counts[order] if given.elements is None else given.elements
    with timed() as cost:
        asked = Asked(order, number, given.treatment, cost)
        try:
            found = dict(compute(asked))
        except sc.Diverged as failure:
            found = dict.fromkeys(fields, math.nan)
            cost.converged = False
            if failure.history is not None:
                cost.add(failure.history)
    shared = {"order": order, "elements": asked.total or number, "step": given.step}
    return {**found, **cost.fields(), **shared}


def inputs(
    defaults: Mapping[str, Any],
    *given: Mapping[str, Any] | None,
    optional: Sequence[str] = (),
) -> dict[str, Any]:
    """Physical inputs: the defaults, overridden one by one; the last word counts.

    Parameters
    ----------
    defaults : mapping
        A number, or a function of the inputs before it for one that follows from them.
    *given : mapping or None
        What overrides them: a case, then the user.
    optional : sequence of str
        Names of inputs that may be None: of stiffnesses, for a beam without that compliance.

    Raises
    ------
    InputError
        If a name is unknown or a number is none, infinite, or not positive where it has to be.
    """
    out: dict[str, Any] = dict(defaults)
    for each in given:
        out = overridden(out, each)
    for name, value in out.items():
        out[name] = value = value(out) if callable(value) else value
        if value is None and name in optional:
            continue
        if value is None and name in ("EA", "GA"):
            raise sc.InputError(
                "data",
                f"{name} = None, expected a positive finite number: this family has no beams"
                " without shear or without extension",
            )
        try:
            numbers = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            numbers = np.array(math.nan)
        if not np.isfinite(numbers).all() or (name not in SIGNED and numbers.min() <= 0):
            kind = "finite" if name in SIGNED else "positive finite"
            raise sc.InputError("data", f"{name} = {value!r}, expected a {kind} number")
    return out


def chosen(case: Any, keys: Sequence[str], default: str) -> str:
    """The key that is meant: itself, or a number for a key that is one; the default for None.

    Raises
    ------
    InputError
        If there is none.
    """
    if case is None:
        return default
    for key in keys:
        if case == key or (_number(case) is not None and _number(case) == _number(key)):
            return key
    raise sc.InputError("case", f"{case!r} is unknown, expected one of {list(keys)}")


def numbered(case: Any) -> float:
    """A case that is any number.

    Raises
    ------
    InputError
        If it is none.
    """
    number = _number(case)
    if number is None:
        raise sc.InputError("case", f"{case!r}, expected a number")
    return number


def parts(case: str) -> dict[str, float]:
    """Inputs that a case is named after: of "h=0.1,alpha=5" these two."""
    return {name: float(value) for name, value in (part.split("=") for part in case.split(","))}


def _number(value: Any) -> float | None:
    try:
        return float(value)
    except (TypeError, ValueError):
        return None


# -- readings --------------------------------------------------------------------------------------


def regular(history: sc.History) -> np.ndarray:
    """Rows of accepted steps: without the start and the critical points."""
    rows = history["critical"] == 0
    rows[0] = False
    return rows


def bifurcation(asked: Asked, scene: Scene) -> float:
    """First bifurcation load of a scene under unit load; NaN if none is found.

    The point found on the path is as good as the sign of a small pivot. Frequencies do better: the
    square of the lowest one vanishes there, and six loads around it give the zero.
    """
    asked.note(scene)
    estimates = sc.buckling(scene.system, 1).factors
    for share in (1.25, 2.5, 5.0) if len(estimates) else ():
        history = asked.search(scene, sc.LoadControl(until=share * estimates[0]))
        found = [p for p in history.meta["critical"] if p["kind"] == "bifurcation"]
        if found:
            return _refined(asked, scene, float(found[0]["load_factor"]))
    asked.cost.converged = False
    return math.nan


def _refined(asked: Asked, scene: Scene, load: float) -> float:
    """The load at which the square of the lowest frequency vanishes, near to the one given."""
    shares = 1 + AROUND * np.linspace(-1, 1, 6)
    path = asked.path(scene, sc.LoadControl(at=load * shares))
    squares = [sc.modes(scene.system, (path, k), 1).squares[0] for k in range(1, len(path))]
    zero = static_scenes.zero(squares, shares)
    return load * zero if abs(zero - 1) < AROUND else load


@dataclass(frozen=True)
class LimitPoint:
    """Load factor, displacement (3,) of the scene's point and angle of its section there."""

    load: float
    displacement: np.ndarray
    angle: float


NOTHING = LimitPoint(math.nan, np.full(3, math.nan), math.nan)


def limit_points(
    asked: Asked, scene: Scene, path: sc.History, count: int, direction: Sequence[float]
) -> list[LimitPoint]:
    """The first limit points of a path, NaN where there are less.

    Their loads are stationary, their places not: these are found where the square of the lowest
    frequency vanishes, from six states around.

    Parameters
    ----------
    direction : (3,) sequence
        The point's displacement along it changes at these limit points.
    """
    found = [p["state"] for p in path.meta["critical"] if p["kind"] == "limit"][:count]
    asked.cost.converged = asked.cost.converged and len(found) == count
    points = [_refined_limit(asked, scene, path, k, np.asarray(direction)) for k in found]
    return points + [NOTHING] * (count - len(found))


def _refined_limit(
    asked: Asked, scene: Scene, path: sc.History, index: int, direction: np.ndarray
) -> LimitPoint:
    start = sc.equilibrium(scene.system, path, index)
    distance = NEAR * abs(float(direction @ scene.displacement(path, index)))
    at, values = [], []
    for sign in (-1.0, 1.0):
        way = distance * SHARES[3:]
        control = sc.DisplacementControl(scene.point, sign * direction, at=way)
        near = asked.path(scene, control, start=start)
        for k, step in enumerate(way, 1):
            at.append(sign * step / distance)
            square = sc.modes(scene.system, (near, k), 1).squares[0]
            place = scene.displacement(near, k)
            values.append([square, near["load_factor"][k], *place, scene.angle(near, k)])
    rows = np.array(values)
    zero = static_scenes.zero(rows[:, 0], at)
    load, x, y, z, angle = np.linalg.solve(np.vander(at), rows[:, 1:]).T @ np.vander([zero], 6)[0]
    return LimitPoint(float(load), np.array([x, y, z]), float(angle))


def highest(asked: Asked, scene: Scene, direction: Sequence[float], guess: float) -> LimitPoint:
    """The limit point near a displacement: the top of a polynomial through six loads around it.

    As exact as by frequencies if no other motion is nearly unstable there, and without any search:
    for meshes whose matrices are full.

    Parameters
    ----------
    direction : (3,) sequence
        The point's displacement along it is prescribed.
    guess : float
        Displacement at the limit point of a coarser mesh; NaN: none was found.
    """
    for _ in range(0 if math.isnan(guess) else PASSES):
        at = guess * (1 + NEAR * SHARES)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sc.PerformanceWarning)  # of full matrices
            path = asked.path(scene, sc.DisplacementControl(scene.point, direction, at=at))
        values = [
            [path["load_factor"][k], *scene.displacement(path, k), scene.angle(path, k)]
            for k in range(-len(SHARES), 0)
        ]
        series = np.linalg.solve(np.vander(SHARES), values)
        slopes = np.polyval(np.polyder(series[:, 0]), SHARES)
        top = static_scenes.zero(slopes, SHARES)
        if abs(top) <= 1:
            load, x, y, z, angle = series.T @ np.vander([top], len(SHARES))[0]
            return LimitPoint(float(load), np.array([x, y, z]), float(angle))
        guess *= 1 + NEAR * float(np.clip(top, -5, 5))
    asked.cost.converged = False
    return NOTHING


def extrapolated(values: Sequence[Any], ratio: float) -> np.ndarray:
    """Limit of values at k, ratio k, ratio^2 k ..., whose error is a series in 1/k."""
    rows = [np.asarray(v, dtype=float) for v in values]
    for j in range(1, len(rows)):
        rows = [b + (b - a) / (ratio**j - 1) for a, b in pairwise(rows)]
    return rows[0]


def limit(
    data: Mapping[str, Any],
    scale: float,
    solve: Callable[[float, float], Mapping[str, Any]],
    *,
    first: float = 1e4,
    ratio: float = 4.0,
    levels: int = 3,
) -> dict[str, Any]:
    """Numbers of a rod with these EA and GA; without extension or shear where they are None.

    There the numbers of `levels` rods with stiffnesses ``scale first ratio^k`` are extrapolated;
    their errors are a series in the compliance.

    Parameters
    ----------
    data : mapping
        With EA and GA.
    scale : float
        A force: bending stiffness by the square of a length.
    solve : callable
        ``solve(EA, GA)`` gives the numbers.
    first, ratio, levels
        What is extrapolated from.
    """
    EA, GA = data["EA"], data["GA"]
    if EA is not None and GA is not None:
        return dict(solve(EA, GA))
    found = []
    for k in range(levels):
        stiff = scale * first * ratio**k
        found.append(solve(stiff if EA is None else EA, stiff if GA is None else GA))
    return {name: listed(extrapolated([f[name] for f in found], ratio)) for name in found[0]}


def held(
    asked: Asked,
    data: Mapping[str, Any],
    scale: float,
    solve: Callable[[float, float, sc.Theory, int], Mapping[str, Any]],
    counts: Sequence[int] = (),
) -> dict[str, Any]:
    """Numbers of a rod without shear, and without extension where EA is None, by its theory.

    The matrices of such beams are full, so that meshes are coarse: the numbers of all elements, of
    half and of a quarter as many are extrapolated (see :func:`.common.refined`).

    Parameters
    ----------
    asked : Asked
    data : mapping
        With EA.
    scale : float
        A force: bending stiffness by the square of a length. Of its size are the stiffnesses
        against strains that the theory holds at zero; they have no effect.
    solve : callable
        ``solve(EA, GA, theory, elements)`` gives the numbers; called for the coarsest mesh first.
    counts : sequence of int, optional
        Elements of other meshes than these three, from many to few.
    """
    theory = sc.TheoryInextensible() if data["EA"] is None else sc.TheoryKirchhoff()
    stiff = 1e4 * scale
    EA = stiff if data["EA"] is None else data["EA"]
    counts = counts or levels(asked.elements, asked.order, LEAST)
    found = [solve(EA, stiff, theory, count) for count in reversed(counts)][::-1]
    return {
        name: listed(refined([f[name] for f in found], counts, asked.order)) for name in found[0]
    }


def listed(value: Any) -> Any:
    """A number, or an array as a list."""
    return np.asarray(value).tolist()


# -- table -----------------------------------------------------------------------------------------


def table(
    family: str,
    main: Callable[..., dict[str, Any]],
    references: Mapping[str, Mapping[str, Any]],
    digits: float,
    quick: Sequence[str] | None = None,
    *,
    least: Mapping[str, float] | float = 0.0,
) -> list[dict[str, Any]]:
    """Rows of a family: each case computed once, each of its numbers beside the reference.

    Parameters
    ----------
    family : str
    main : callable
    references : mapping of str to mapping
        Numbers by case.
    digits : float
        That are trusted, of the largest component.
    quick : sequence of str, optional
        Only these cases.
    least : float or mapping of str to float
        Size that digits are counted from at least, for all numbers or by name: some are zero.
    """
    out = []
    for case, reference in references.items():
        if quick is not None and case not in quick:
            continue
        result = main(case)
        for name, value in reference.items():
            floor = least[name] if isinstance(least, Mapping) else least
            size = max(floor, float(abs(np.asarray(value, dtype=float)).max()))
            compared = compare(case, result, {name: value}, size * 10.0**-digits)
            out += tabled(family, result, compared)
    return out
