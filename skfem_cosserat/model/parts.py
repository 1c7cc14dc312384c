"""Parts of a scene that nothing connects, and what ties them to the ground."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from ..body import MassPoint
from ..coupling import SpringDamper
from ..errors import ModelWarning
from ..frames import is_beam
from ..frozen import lock_arrays
from ..types import Array, Floats, IndexArray
from ..warn import warn

if TYPE_CHECKING:
    from .groups import Structure
    from .system import System


@dataclass(frozen=True, eq=False)
class Connected:
    """Parts of a scene: beams, joints, springs and loads on several points connect.

    Attributes
    ----------
    part : (rows,) int array
        Number of the part that a row of y belongs to.
    free : (parts,) bool array
        Whether nothing ties it to the ground.
    """

    part: IndexArray
    free: np.typing.NDArray[np.bool_]

    def __str__(self) -> str:
        count = len(self.free)
        tied = int((~self.free).sum())
        if count == 1:
            return f"1 connected part, {'tied' if tied else 'not tied'} to the ground"
        return f"{count} separate parts, {tied or 'none'} of them tied to the ground"


@dataclass(eq=False)
class SeparateParts:
    """Parts of a scene that nothing connects, with their masses.

    Attributes
    ----------
    system : System
    part : (rows,) int array
        Number of the part that a row of y belongs to.
    free : (parts,) array
        1 where nothing ties it to the ground, else 0.
    ones : (rows,) array
        1 for rows of positions, 0 for directors.
    mu : (rows,) array
        Momentum by a common velocity of all positions: ``M 1`` (kg, kg m).
    total : (parts,) array
        Masses (kg).
    lift : (rows,) array
        ``mu`` by the mass of the part.
    """

    system: System
    part: IndexArray
    free: Floats
    ones: Floats
    mu: Floats

    def __post_init__(self) -> None:
        rows = len(self.part)
        self._gather = csr_matrix((np.ones(rows), (self.part, np.arange(rows))))
        self.total = np.maximum(self.sum(self.mu * self.ones), 1e-300)
        self.lift = self.mu / self.total[self.part]

    def sum(self, values: Array) -> Array:
        """Sums (parts, ...) over the rows of each part."""
        return (self._gather @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:])


@lru_cache(maxsize=4)
def separate_parts(system: System) -> SeparateParts:
    """Parts of a system that nothing connects, with their masses; cached."""
    found = connected_parts(system)
    ones = np.zeros(system.rows)
    ones[system.origin_rows] = 1.0
    return SeparateParts(system, found.part, found.free.astype(float), ones, system.mass @ ones)


def connected_parts(system: System, lines: bool = True) -> Connected:
    """Connected parts of a system; without `lines`, springs and cables along lines do not count.

    Examples
    --------
    >>> from skfem_cosserat import JointSpherical, Model, RigidBody, ground
    >>> model = Model()
    >>> arm = model.add("arm", RigidBody.box(1.0, (1, 1, 1)))
    >>> pin = model.add("pin", JointSpherical(ground((0, 0, 0)), arm.at((0, 0, 0))))
    >>> ball = model.add("ball", RigidBody.sphere(1.0, 1.0, velocity=(1, 0, 0)))
    >>> print(connected_parts(model.freeze()))
    2 separate parts, 1 of them tied to the ground
    """
    rows = system.rows
    g = system.constraints
    links = [_first_to_all(group.rows) for group in system.groups]
    own = g.inside
    links.append(np.stack([g.cols[own] // 3, rows + g.rows[own]], 1))
    joining = [c for c in system.couplings.items if lines or not isinstance(c, SpringDamper)]
    joining += system.couplings.own
    sides = [[system.row_of(side) for side in c.sides()] for c in joining]
    ends = [pair for each in sides for pair in pairwise(each)]
    pairs = np.array(ends, np.int64).reshape(-1, 2)
    inside = (pairs < rows).all(1)
    grounded = np.ones(len(g.cols), bool)
    grounded[own] = False
    tied = np.concatenate([rows + g.rows[grounded], pairs[~inside][pairs[~inside] < rows]])
    return _connected(np.concatenate([*links, pairs[inside]]), tied, rows, rows + system.m)


def _first_to_all(rows: IndexArray) -> IndexArray:
    """Pairs (ne r, 2) of the first row of each element with its rows (ne, r)."""
    return np.stack([np.broadcast_to(rows[:, :1], rows.shape), rows], -1).reshape(-1, 2)


def _connected(edges: IndexArray, tied: IndexArray, rows: int, size: int) -> Connected:
    """Parts of the first `rows` of a graph's vertices, free without one that is `tied`."""
    graph = csr_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(size, size))
    _, label = connected_components(graph, directed=False)
    names, part = np.unique(label[:rows], return_inverse=True)
    out = Connected(part, ~np.isin(names, label[tied]))
    lock_arrays(out)
    return out


def warn_of_loose_parts(system: System) -> None:
    """Say which beams and bodies hang on nothing, or on a spring, while other parts are tied.

    They may be meant to fly: what starts with a velocity is left out, of those on nothing also what
    has a load of its own, and scenes of which nothing is tied.
    """
    springs = [c for c in system.couplings.items if isinstance(c, SpringDamper)]
    found = connected_parts(system)
    firm = connected_parts(system, lines=False) if springs else found
    loaded = {id(item) for load in system.loads for item in load.references()}
    resting = _resting(system, found)
    loose = [item for items in resting.values() for item in items if id(item[0]) not in loaded]
    if loose:
        warn(
            "model",
            f"has {found}; {_listed(loose)} at rest, on no joint or spring that leads to the"
            " ground, and under no load but gravity: is a joint missing?",
            ModelWarning,
        )
    rows = {id(c): [system.row_of(c.a), system.row_of(c.b)] for c in springs}
    alone = {id(item) for items in resting.values() for item, _ in items}
    for part, items in _resting(system, firm).items():
        on = [
            c for c in springs if any(firm.part[r] == part for r in rows[id(c)] if r < system.rows)
        ]
        if len(on) < 3 and not any(id(item) in alone for item, _ in items):
            warn(
                "model",
                f"{_listed(items)} held by {' and '.join(c.label for c in on)} alone, which leaves"
                " all motions but along the line: right if it is meant, else a joint is missing",
                ModelWarning,
            )


def _resting(system: System, found: Connected) -> dict[int, list[tuple[Structure, str]]]:
    """Beams and bodies with their names, by free parts at rest; none where no part is tied."""
    out: dict[int, list[tuple[Structure, str]]] = {}
    if found.free.all() or not found.free.any():
        return out
    moving = np.unique(found.part[np.any(system.v0.reshape(-1, 3) != 0, 1)])
    for item in system.structures:
        if id(item) not in system.first or isinstance(item, MassPoint):
            continue
        row = system.first[id(item)][1]
        own = np.unique(found.part[row : row + 4 * (item.basis.n_nodes if is_beam(item) else 1)])
        alone = own[found.free[own] & ~np.isin(own, moving)]
        if len(alone):
            name = item.label if len(alone) == len(own) else f"a part of {item.label}"
            out.setdefault(int(alone[0]), []).append((item, name))
    return out


def _listed(items: list[tuple[Structure, str]]) -> str:
    """Some names, and the verb that goes with them."""
    names = ", ".join(name for _, name in items[:4])
    more = f" and {len(items) - 4} more" if len(items) > 4 else ""
    return f"{names}{more} {'are' if len(items) > 1 else 'is'}"
