"""Lines of elements that hold shear strains, from their directors: what they add to the tree.

``Gamma_i = d_i . phi'`` at p Gauss points gives there ``phi' = D^-1 Gamma`` (rows of D: the
interpolated directors), and phi' is a polynomial of degree p - 1: with it all nodes of the element
follow from one of them. So do their velocities,

``dphi'/dt = sum_a A_a omega_a + D^-1 e_3 ds/dt``,  ``A_a = -N_a D^-1 [d_i^a x phi']``

for rotations of the nodes and a stretch s, at any configuration: the rows of A annihilate the
Jacobian of the constraints there, at nodes and midpoints alike. Theory: Betsch & Leyendecker, IJNME
67 (2006) 499, for the discrete null space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_matrix

from ..kernels import cross
from ..pattern import sum_at
from ..types import Array, Floats, IndexArray
from .tree import Span, Tree

__all__ = ["Spans"]


@dataclass(eq=False)
class _Elements:
    """Elements of one interpolation in the tree.

    Attributes
    ----------
    spans : list of Span
    rows : (ne, nn) int array
        First row of y of each node.
    N, slope : (ng, nn), (ne, ng, nn) array
        Shape functions and their derivatives by the arc length.
    weights : (ne, nn, ng) array
        ``phi_b - phi_entry = sum_g weights_bg phi'_g``.
    rotations : (ne, nn, 3, 3) array or None
    strain : (ne, ng, 3) array
        Gamma of the reference.
    measure : (ne, ng, 1) array
        Weight of each Gauss point times the length.
    stretches : (k, 2) int array, (k,) int array
        Element and point of each stretch, and the number of its coordinate.
    """

    spans: list[Span]
    rows: IndexArray
    N: Floats
    slope: Floats
    weights: Floats
    rotations: Floats | None
    strain: Floats
    measure: Floats
    stretched: IndexArray
    numbers: IndexArray

    def directors(self, y: Array) -> tuple[Array, Array]:
        """Of the section at the nodes (ne, nn, 3, 3) and at the Gauss points (ne, ng, 3, 3)."""
        d = y[self.rows[:, :, None] + _DIRECTORS]
        if self.rotations is not None:
            d = self.rotations @ d
        ne, nn = self.rows.shape
        return d, (self.N @ d.reshape(ne, nn, 9)).reshape(ne, -1, 3, 3)

    def inverse(self, D: Array) -> Array:
        """``D^-1`` (ne, ng, 3, 3) of interpolated directors; faster than LAPACK for so few."""
        c = cross(D[:, :, _YZX], D[:, :, _ZXY])
        volume = (D[:, :, 0] * c[:, :, 0]).sum(-1)
        return c.swapaxes(-1, -2) / volume[..., None, None]

    def slopes(self, y: Array) -> Array:
        """``phi'`` (ne, ng, 3)."""
        return self.slope @ y[self.rows]


_DIRECTORS = np.arange(1, 4)
_YZX, _ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])


def _elements(chosen: Sequence[tuple[Span, int]], row: IndexArray, tree: Tree) -> _Elements:
    spans = [span for span, _ in chosen]
    basis = spans[0].item.basis
    vertices = np.array([span.vertices for span in spans])
    lengths = np.array([span.item.basis.lengths[span.element] for span in spans])
    entry = np.array([span.vertices.index(v) for span, v in chosen])
    by_xi = basis.dshape(basis.points).T
    weights = np.zeros((len(spans), by_xi.shape[1], len(by_xi)))
    for k in np.unique(entry):
        others = [b for b in range(by_xi.shape[1]) if b != k]
        which = np.flatnonzero(entry == k)
        inverse = np.linalg.inv(by_xi[:, others])
        weights[which[:, None], others] = lengths[which, None, None] * inverse
    rotations = np.array([span.item.rotations[span.element] for span in spans])
    parts = [span.item.elements for span in spans]
    stretched = [
        (k, g, number)
        for k, span in enumerate(spans)
        for g, number in enumerate(tree.stretches[id(span)])
    ]
    table = np.array(stretched, dtype=np.int64).reshape(-1, 3)
    return _Elements(
        spans,
        row[vertices],
        basis.shape(basis.points).T.copy(),
        by_xi / lengths[:, None, None],
        weights,
        None if (rotations == np.eye(3)).all() else rotations,
        np.array([p.reference[s.element, :, :3] for p, s in zip(parts, spans, strict=True)]),
        np.array([p.measure[s.element] for p, s in zip(parts, spans, strict=True)]),
        table[:, :2],
        table[:, 2],
    )


class Spans:
    """All elements of the tree whose lines follow from directors.

    Parameters
    ----------
    tree : Tree
    row : (nv + ng,) int array
        First row of y of each vertex.
    twist_of : (nv,) int array
        First twist of each vertex.
    turning : dict of int to list of (int, int)
        Of each vertex whose rotation is relative to its parent's: coordinates that turn it, and
        which of the kinematics' pairs those are.

    Attributes
    ----------
    T_rows, T_cols : int arrays
        Where :meth:`values` are in the null space matrix of the tree.
    numbers : (k,) int array
        Coordinates that are stretches.
    """

    def __init__(
        self,
        tree: Tree,
        row: IndexArray,
        twist_of: IndexArray,
        turning: dict[int, list[tuple[int, int]]],
    ) -> None:
        kinds: dict[object, list[tuple[Span, int]]] = {}
        for span, entry in (pair for pair in tree.spans if not pair[0].rigid):
            kinds.setdefault(span.item.basis.interpolation, []).append((span, entry))
        self.groups = [_elements(chosen, row, tree) for chosen in kinds.values()]
        self.numbers: IndexArray = np.concatenate(
            [np.zeros(0, dtype=np.int64), *(g.numbers for g in self.groups)]
        )
        self._starts: list[int] = np.cumsum([0, *(len(g.numbers) for g in self.groups)]).tolist()
        self._number(tree, row, twist_of, turning)

    def _number(
        self,
        tree: Tree,
        row: IndexArray,
        twist_of: IndexArray,
        turning: dict[int, list[tuple[int, int]]],
    ) -> None:
        """Places of exits, blocks and stretches in the null space matrix."""
        # exits (element, node) are numbered group by group, blocks (element, exit, node) likewise
        exit_of: dict[tuple[int, int], int] = {}
        block_of: dict[tuple[int, int], int] = {}  # (exit, vertex)
        shift_of: dict[int, list[tuple[int, int]]] = {}  # exit: (stretch's number, of its values)
        exits = blocks = shifts = 0
        for g in self.groups:
            for span in g.spans:
                stretches = tree.stretches[id(span)]
                for b in span.vertices:
                    exit_of[id(span), b] = exits
                    for a in span.vertices:
                        block_of[exits, a] = blocks
                        blocks += 1
                    shift_of[exits] = [(k, shifts + i) for i, k in enumerate(stretches)]
                    shifts += len(stretches)
                    exits += 1
        self._exit_rows: IndexArray = np.concatenate(
            [np.zeros(0, dtype=np.int64), *(g.rows.ravel() for g in self.groups)]
        )
        members = {v: exits_of for v, exits_of in _paths(tree, exit_of).items() if exits_of}
        vertices_of = {
            exit_of[id(s), b]: s.vertices for g in self.groups for s in g.spans for b in s.vertices
        }
        whole: list[tuple[int, int, int, int]] = []
        turned: list[tuple[int, int, int, int, int]] = []
        moved: list[tuple[int, int, int]] = []
        below: list[tuple[int, int]] = []
        for c, path in members.items():
            found: dict[int, list[int]] = {}
            for e in path:
                below.append((e, int(row[c])))
                for a in vertices_of[e]:
                    found.setdefault(a, []).append(block_of[e, a])
                moved += [(int(twist_of[c]), number, k) for number, k in shift_of[e]]
            for a, which in found.items():
                one, two = which[0], which[1] if len(which) > 1 else blocks
                own = [k for k in tree.own[a] if tree.coordinates[k].kind == "rotation"]
                if own:
                    whole.append((int(twist_of[c]), own[0], one, two))
                    assert all(j == i + 1 for i, j in pairwise(own))
                else:
                    turned += [(int(twist_of[c]), k, one, two, p) for k, p in turning.get(a, [])]
        self._axes = None if tree.plane is None else tree.axes
        self._place(whole, turned, moved)
        exits_rows = np.array(below, dtype=np.int64).reshape(-1, 2)
        self._sums = csr_matrix(
            (np.ones(len(exits_rows)), (exits_rows[:, 0], exits_rows[:, 1])),
            shape=(exits, int(row[: len(twist_of)].max()) + 1),
        )

    def _place(
        self,
        whole: list[tuple[int, int, int, int]],
        turned: list[tuple[int, int, int, int, int]],
        moved: list[tuple[int, int, int]],
    ) -> None:
        xyz = np.arange(3)
        w = np.array(whole, dtype=np.int64).reshape(-1, 4)
        t = np.array(turned, dtype=np.int64).reshape(-1, 5)
        m = np.array(moved, dtype=np.int64).reshape(-1, 3)
        count = 3 if self._axes is None else len(self._axes)
        shape = (len(w), 3, count)
        rows = [np.broadcast_to(w[:, 0, None, None] + xyz[:, None], shape).ravel()]
        cols = [np.broadcast_to(w[:, 1, None, None] + np.arange(count), shape).ravel()]
        rows += [(each[:, 0, None] + xyz).ravel() for each in (t, m)]
        cols += [np.repeat(each[:, 1], 3) for each in (t, m)]
        self.T_rows: IndexArray = np.concatenate(rows)
        self.T_cols: IndexArray = np.concatenate(cols)
        self._whole, self._turned, self._moved = w[:, 2:], t[:, 2:], m[:, 2]

    # -- velocities --------------------------------------------------------------------------------

    def values(self, y: Array, axis: Array) -> Array:
        """Entries at ``(T_rows, T_cols)``; `axis` (pairs, 3) are those of the turning pairs."""
        blocks, shifts = [], []
        for g in self.groups:
            d, D = g.directors(y)
            inverse = g.inverse(D)
            # rows i: d_i^a x phi'
            turn = cross(d[:, None], g.slopes(y)[:, :, None, None])
            A = -g.N[..., None, None] * (inverse[:, :, None] @ turn)
            ne, ng, nn = A.shape[:3]
            blocks.append((g.weights @ A.reshape(ne, ng, nn * 9)).reshape(-1, 3, 3))
            if len(g.numbers):
                e = np.unique(g.stretched[:, 0])
                shift = g.weights[e, ..., None] * inverse[e][:, None, :, :, 2]
                shifts.append(shift.reshape(-1, 3))
        zero = np.zeros((1, 3, 3), dtype=y.dtype)
        E = np.concatenate([*blocks, zero])
        whole = E[self._whole[:, 0]] + E[self._whole[:, 1]]
        out = [(whole if self._axes is None else whole @ self._axes.T).ravel()]
        if len(self._turned):
            one, two, pair = self._turned.T
            out.append(((E[one] + E[two]) @ axis[pair][:, :, None]).ravel())
        if shifts:
            out.append(np.concatenate(shifts)[self._moved].ravel())
        return np.concatenate(out)

    # -- positions ---------------------------------------------------------------------------------

    def stretches(self, y: Array) -> Array:
        """Axial strains (k,) at the Gauss points that are free."""
        out = [np.zeros(0)]
        for g in self.groups:
            if len(g.numbers):
                _, D = g.directors(y)
                strain = (D[:, :, 2] * g.slopes(y)).sum(-1) - g.strain[:, :, 2]
                out.append(strain[g.stretched[:, 0], g.stretched[:, 1]])
        return np.concatenate(out)

    def arms(self, y: Array, stretches: Array) -> Array:
        """``phi - phi_entry`` (exits, 3) of all nodes, from directors and stretches (k,)."""
        out = []
        for k, g in enumerate(self.groups):
            _, D = g.directors(y)
            strain = g.strain.astype(np.result_type(y, stretches))
            own = stretches[self._starts[k] : self._starts[k + 1]]
            strain[g.stretched[:, 0], g.stretched[:, 1], 2] += own
            out.append((g.weights @ (g.inverse(D) @ strain[..., None])[..., 0]).reshape(-1, 3))
        return np.concatenate(out)

    def exits(self, tree: Tree) -> IndexArray:
        """Which of the exits each edge of the tree is that is part of an element."""
        number: dict[tuple[int, int], int] = {}
        for g in self.groups:
            for span in g.spans:
                for b in span.vertices:
                    number[id(span), b] = len(number)
        return np.array(
            [number[id(e.joint), e.child] for e in tree.edges if e.spans], dtype=np.int64
        )

    # -- forces ------------------------------------------------------------------------------------

    def carried(self, y: Array, force: Array) -> tuple[Array, list[Array]]:
        """Constraint forces that carry all forces on positions beyond the elements.

        Parameters
        ----------
        y : (total, 3) array
        force : (rows, 3) array

        Returns
        -------
        carried : (rows, 3) array
            ``G^T mu``: what is left of `force` without it adds up to nothing beyond each exit.
        stresses : list of (ne, ng, 6) arrays
            Mu as stress resultants, for the elements of each of :attr:`groups`; forces against a
            free stretch included.
        """
        sums = self._sums @ force[: self._sums.shape[1]]
        out = np.zeros_like(force)
        stresses, start = [], 0
        for g in self.groups:
            ne, nn, ng = g.weights.shape
            own = sums[start : start + ne * nn].reshape(ne, nn, 3)
            start += ne * nn
            _, D = g.directors(y)
            n = g.weights.transpose(0, 2, 1) @ own
            mu = (g.inverse(D).swapaxes(-1, -2) @ n[..., None])[..., 0]
            line = g.slope.transpose(0, 2, 1) @ n
            outer = mu[..., None] * g.slopes(y)[:, :, None]
            turn = (g.N.T @ outer.reshape(ne, ng, 9)).reshape(ne, nn, 3, 3)
            if g.rotations is not None:
                turn = g.rotations.swapaxes(-1, -2) @ turn
            local = np.concatenate([line[:, :, None], turn], axis=2)
            rows = g.rows[:, :, None] + np.arange(4)
            at = (3 * rows[..., None] + np.arange(3)).ravel()
            out += sum_at(at, local.ravel(), out.size).reshape(out.shape)
            stress = np.zeros((ne, ng, 6), dtype=mu.dtype)
            stress[:, :, :3] = mu / g.measure
            stresses.append(stress)
        return out, stresses


def _paths(tree: Tree, exit_of: dict[tuple[int, int], int]) -> dict[int, list[int]]:
    """Exits on the path from the root to each vertex."""
    out: dict[int, list[int]] = {}
    for edge in tree.edges:
        before = out.get(edge.parent, [])
        if isinstance(edge.joint, Span) and not edge.joint.rigid:
            before = [*before, exit_of[id(edge.joint), edge.child]]
        out[edge.child] = before
    return out
