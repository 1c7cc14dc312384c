"""Checks of a scene while it is frozen: each error names the item and the value."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import null_space

from ..errors import InputError
from ..joint import Joint, JointDrive
from ..kernels import mass_blocks, null_space_blocks
from ..types import SAME, TOLERANCE, Floats, IndexArray
from .kinematics import Kinematics
from .tree import Spot

if TYPE_CHECKING:
    from .system import System


@dataclass(frozen=True, eq=False)
class JointRows:
    """A joint or drive, its constraint rows and its two spots."""

    joint: Joint | JointDrive
    rows: slice
    a: Spot
    b: Spot


def check_drives(drives: Sequence[JointDrive]) -> None:
    """No coordinate is driven twice."""
    found: dict[tuple[int, str], JointDrive] = {}
    for drive in drives:
        other = found.setdefault((id(drive.joint), drive.coordinate.name), drive)
        if other is not drive:
            raise InputError(
                drive.label,
                f"contradicts the {other.label}: both prescribe the {drive.coordinate.name} of"
                f" the {drive.joint.label}",
            )


def check_mobility(system: System, doubt: str = "") -> None:
    """Something can move, or is moved by a drive; `doubt` is added to the message."""
    if system.unknowns > 0 or system.moving or system.placed is not None:
        return
    raise InputError(
        "model",
        f"mobility is zero: {system.n} coordinates and {system.rank} independent constraints"
        f" ({system.m} rows) leave no motion; free a joint or add a drive"
        + (f" ({doubt})" if doubt else ""),
    )


def check_inertia(system: System, y: Floats, closure: Callable[[], Floats]) -> None:
    """Every direction of motion that joints leave free has mass.

    A beam's d3 carries no mass, which is fine: rotations still move d1 and d2. What is refused is
    a vertex (or a tree of joints) with a direction of ``P^T M P`` that vanishes, such as the spin
    of a thin rod that no joint holds. Of a beam's consistent mass only the blocks of single nodes
    enter: it is positive definite exactly if they are.

    Trees whose pivots are all far from zero pass at the cost of their edges. The matrix of the
    others is looked at as a whole: what closes loops may hold the rest.

    Parameters
    ----------
    closure : callable
        Gives independent rows (r, unknowns) of the joints that close loops: they hold
        coordinates, too.
    """
    kin = system.kinematics
    tree = system.tree
    inertia = _vertex_inertia(system, y)
    fixed = kin.fixed_axes(y)
    linked = {v for e in tree.edges for v in (e.child, e.parent)}
    linked |= _holding(system)
    # vertices that nothing holds, all at once
    alone = np.array([v for v in tree.free if v not in linked], np.int64)
    for vertices in (kin.frames, kin.points):
        free = np.intersect1d(vertices, alone)
        if len(free):
            size = 6 if vertices is kin.frames else 3
            worst, number = _weakest(inertia[free, :size, :size])
            if worst >= 0:
                _report(system, tree.own[free[worst]][number], y, fixed)
    if not any(tree.own[v] for v in linked if v < len(tree.own)):
        return
    if _clearly_inert(kin, inertia, y, fixed):
        return
    rows = closure()
    T = kin.T.matrix(kin.values_at(y, fixed))
    for members, coordinates in _trees(system, rows):
        if not coordinates:
            continue
        A = np.zeros((len(coordinates),) * 2)
        for v in members:
            start = int(kin.twist_of[v])
            size = 6 if tree.is_frame[v] else 3
            local = T[start : start + size][:, coordinates].toarray()
            A += local.T @ inertia[v, :size, :size] @ local
        worst, number = _weakest(A[None], rows[:, coordinates])
        if worst >= 0:
            _report(system, coordinates[number], y, fixed)


def _clearly_inert(kin: Kinematics, inertia: Floats, y: Floats, fixed: Floats) -> bool:
    """True if all pivots are far from zero when joints are eliminated from the leaves on.

    Each pivot is compared with what it would be if the joints next to it were locked.
    """
    maps = kin.recursion
    S, X, used = maps.blocks(y, fixed)
    free = inertia.copy()
    locked = inertia.copy()
    unused = np.eye(6) * ~used[:, None]
    pivots = np.empty_like(S)
    sizes = np.empty(S.shape[:2])

    def pivot(v: IndexArray) -> tuple[Floats, Floats]:
        """``I S`` of vertices v, and their pivots ``S^T I S``, which are stored as well."""
        U = free[v] @ S[v]
        size = np.einsum("vik,vij,vjk->vk", S[v], locked[v], S[v])
        pivots[v], sizes[v] = S[v].transpose(0, 2, 1) @ U + unused[v], size
        return U, pivots[v] + np.eye(6) * (1e-15 * size + 1e-300)[:, None]

    for level in reversed(maps.levels):
        child = maps.child[level]
        U, D = pivot(child)
        rest = free[child] - U @ np.linalg.solve(D, U.transpose(0, 2, 1))
        up = maps.held[level]
        parent = maps.parent[level[up]]
        right = X[level[up]]
        left = right.transpose(0, 2, 1)
        np.add.at(locked, parent, left @ free[child[up]] @ right)
        np.add.at(free, parent, left @ rest[up] @ right)
    if len(maps.roots):
        pivot(maps.roots)
    moved = np.concatenate([maps.child, maps.roots])
    size = np.sqrt(np.where(used[moved], sizes[moved], 1.0))
    if not (size > 0).all():
        return False
    scaled = pivots[moved] / (size[:, :, None] * size[:, None, :])
    return bool((np.linalg.eigvalsh(scaled) > TOLERANCE).all())


def _weakest(blocks: Floats, closure: Floats | None = None) -> tuple[int, int]:
    """First singular block and the coordinate that moves most in its null vector, or (-1, -1).

    With `closure` (r, k) only null vectors that it maps to zero count; then there is one block.
    """
    diagonal = np.einsum("eii->ei", blocks)
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1))
    values, vectors = np.linalg.eigh(blocks * scale[:, :, None] * scale[:, None, :])
    bad = np.flatnonzero((values <= SAME).any(1))
    if not len(bad):
        return -1, -1
    e = int(bad[0])
    found = vectors[e, :, 0]
    if closure is not None and closure.any():
        massless = vectors[0][:, values[0] <= SAME]
        held = null_space((closure * scale) @ massless)
        if not held.shape[1]:
            return -1, -1
        found = massless @ held[:, 0]
    return e, int(abs(found).argmax())


def _holding(system: System) -> set[int]:
    """Vertices of beams that hold strains."""
    theories = system.theory_rows
    return {v for each in theories for e in range(each.shape[0]) for v in each.vertices(e)}


def _trees(system: System, closure: Floats) -> list[tuple[list[int], list[int]]]:
    """Vertices and coordinates of each tree of joints, or beam that holds strains.

    The ground separates trees.

    Trees that the rows of `closure` couple count as one.
    """
    tree = system.tree
    nv = len(system.origin_rows)
    root: dict[int, int] = {}
    for edge in tree.edges:
        root[edge.child] = (
            edge.child if edge.parent >= nv else root.setdefault(edge.parent, edge.parent)
        )
    for v in _holding(system):
        root.setdefault(v, v)
    members: dict[int, list[int]] = {}
    for v in sorted(root):
        members.setdefault(root[v], []).append(v)
    looped = []
    apart = []
    for vs in members.values():
        if closure[:, [k for v in vs for k in tree.own[v]]].any():
            looped += vs
        else:
            apart.append(vs)
    together = [*apart, looped] if looped else apart
    return [(vs, [k for v in vs for k in tree.own[v]]) for vs in together]


def _vertex_inertia(system: System, y: Floats) -> Floats:
    """``P_int^T M P_int`` of each vertex alone (nv, 6, 6); of points only 3x3 of it."""
    kin = system.kinematics
    number = np.full(len(system.origin_rows), -1)
    number[kin.frames] = np.arange(len(kin.frames))
    scalar = np.zeros((len(kin.frames), 4, 4))
    out = np.zeros((len(number), 6, 6))
    for group in system.groups:
        if group.framed:
            ne, nn = group.vertices.shape
            blocks = np.einsum("eaiaj->eaij", group.scalar_mass.reshape(ne, nn, 4, nn, 4))
            np.add.at(scalar, number[group.vertices], blocks)
        else:
            out[group.vertices[:, 0], :3, :3] = mass_blocks(group.scalar_mass)
    P = null_space_blocks(kin.directors(y))
    out[kin.frames] = P.transpose(0, 2, 1) @ mass_blocks(scalar) @ P
    return out


def _report(system: System, number: int, y: Floats, fixed: Floats) -> None:
    coordinate = system.tree.coordinate(number)
    item = system.owner[coordinate.vertex]
    axis = np.round(system.kinematics.axes(y, fixed)[number], 6).tolist()
    what = "translation along" if coordinate.kind == "translation" else "rotation about"
    x = np.round(y[system.vertex_rows[coordinate.vertex]], 9).tolist()
    raise InputError(
        item.label,
        f"{what} {axis} of the vertex at {x} has no inertia and no joint holds it: a coordinate"
        " needs mass or a joint",
    )
