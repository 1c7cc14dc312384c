"""Checks of the reference of a beam: what its elements can follow of the line they lie on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..element import Interpolation
from ..errors import MeshError, ModelWarning
from ..types import Floats, IndexArray
from ..warn import warn

if TYPE_CHECKING:  # pragma: no cover - for annotations only
    from .mesh import MeshCurve

_NAMES = {1: "linear", 2: "quadratic", 3: "cubic", 4: "quartic"}


def turns(before: Floats, after: Floats) -> Floats:
    """Angles (...) in rad of the rotations between triads (..., 3, 3), 0 to pi.

    Exact also at small angles: ``|A - B|^2 = 8 sin^2(t/2)``.
    """
    chord = np.sqrt(((after - before) ** 2).sum(axis=(-2, -1)) / 8)
    return 2 * np.arcsin(np.clip(chord, 0, 1))


def _twists(before: Floats, after: Floats) -> Floats:
    """Angles (...) of their part about d3, on top of the smallest rotation between the two d3."""
    R = after @ np.swapaxes(before, -1, -2)
    return np.arctan2(R[..., 1, 0] - R[..., 0, 1], R[..., 0, 0] + R[..., 1, 1])


def gives_way(kind: Interpolation, angle: Floats) -> str:
    """End of a message about elements that turn by the angles (k,) in rad: the largest, the limit.

    See :attr:`skfem_cosserat.element.Interpolation.turn_limit`.
    """
    limit = np.degrees(kind.turn_limit)
    others = int((angle > kind.turn_limit + 1e-8).sum()) - 1
    more = f" ({others} more like it)" if others else ""
    return (
        f"{np.degrees(angle.max()):.3g} degrees, beyond the {limit:.3g} that a"
        f" {_NAMES[kind.order]} element can be bent by{more}: refine"
    )


def check_bends(
    mesh: MeshCurve,
    kind: Interpolation,
    nodes: IndexArray,
    places: Floats,
    triads: Floats,
    item: str,
) -> None:
    """Directors that flip, lines that fold back and elements that turn too far.

    Parameters
    ----------
    mesh : MeshCurve
    kind : Interpolation
    nodes : (ne, p + 1) int array
        Nodes of each element.
    places : (ne, p + 1, 3) array
        Where they are (m).
    triads : (ne, p + 1, 3, 3) array
        Section triads there.
    item : str
        Name of the beam in messages.

    Raises
    ------
    MeshError
        If neighbouring nodes of an element differ by 90 degrees or more, or its line turns
        against its sections inside.

    Notes
    -----
    An element that turns by more than :attr:`Interpolation.turn_limit` between its ends, and
    triads that flip about the tangent at a corner, are reported by a warning.
    """
    angle = turns(triads[:, :-1], triads[:, 1:]).round(9)  # of equal ones the first is named
    # at a quarter turn nothing is left of the stiffness of a linear element
    if angle.max() >= round(np.pi / 2, 9):
        e, a = (int(i) for i in np.unravel_index(int(angle.argmax()), angle.shape))
        twist = abs(float(_twists(triads[e, a], triads[e, a + 1])))
        where = f"between the nodes {nodes[e, a]} and {nodes[e, a + 1]} of element {e}"
        if twist > angle[e, a] / 2:
            raise MeshError(
                item,
                f"section triads turn by {np.degrees(twist):.3g} degrees about the tangent"
                f" {where}, expected less than 90: the given director is almost parallel to the"
                " line there, or the twist too fast for the mesh; change them or refine",
            )
        raise MeshError(
            item,
            f"the line turns by {np.degrees(angle[e, a]):.3g} degrees {where}, expected less than"
            " 90: refine",
        )
    _check_folds(mesh, kind, nodes, places, triads, item)
    total = angle.sum(axis=1).round(8)
    if total.max() > round(kind.turn_limit, 8):
        e = int(total.argmax())
        warn(
            item,
            f"element {e} turns between its ends, the nodes {nodes[e, 0]} and {nodes[e, -1]}, by"
            f" {gives_way(kind, total)}",
            ModelWarning,
        )
    _report_flips(mesh, nodes, triads, item)


def _check_folds(
    mesh: MeshCurve,
    kind: Interpolation,
    nodes: IndexArray,
    places: Floats,
    triads: Floats,
    item: str,
) -> None:
    """The line, and the interpolated one, run along the interpolated d3 everywhere."""
    xi, at = kind.dense.points, kind.dense
    exact = mesh.mapping().tangent(xi[None])
    slope = np.einsum("ag,eac->ceg", at.slopes, places)
    d3 = np.einsum("ag,eac->ceg", at.values, triads[:, :, 2])
    cosine = np.minimum((exact * d3).sum(0), (slope * d3).sum(0))
    if cosine.min() <= 0:
        e, g = (int(i) for i in np.unravel_index(int(cosine.argmin()), cosine.shape))
        raise MeshError(
            item,
            f"the line folds back inside element {e}, between the nodes {nodes[e, 0]} and"
            f" {nodes[e, -1]}: {xi[g] * mesh.lengths[e]:.3g} m from its start it runs against the"
            " tangents interpolated between its nodes; refine",
        )


def _report_flips(mesh: MeshCurve, nodes: IndexArray, triads: Floats, item: str) -> None:
    """Warn of a first director that turns by more than 90 degrees about the line at a corner."""
    order = mesh.chain_order
    e, f = order.before, order.after
    twist = abs(_twists(triads[e, -1], triads[f, 0]))
    flips = twist > np.pi / 2 + 1e-9
    if not flips.any():
        return
    number = np.empty(mesh.nelements, dtype=np.int64)  # of the chain
    number[order.elements] = np.repeat(np.arange(len(order.closed)), np.diff(order.first))
    for chain in np.unique(number[e[flips]]).tolist():
        own = np.flatnonzero(number[e] == chain)
        k = int(own[twist[own].argmax()])
        warn(
            item,
            f"section triads turn by {np.degrees(twist[k]):.3g} degrees about the line at node"
            f" {nodes[e[k], -1]}, between the elements {e[k]} and {f[k]}: forces and moments"
            " change their signs there; give another director",
            ModelWarning,
        )
