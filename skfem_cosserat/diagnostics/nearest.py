"""Nearest configurations on the constraints, and rigid motions."""

from __future__ import annotations

import numpy as np
from scipy.linalg import qr
from scipy.sparse import coo_matrix, csr_matrix, diags, identity, kron
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from ..constraints.base import RowSpace
from ..constraints.null_space import CLOSING
from ..constraints.saddle import full_mass
from ..kernels import exp_quaternion, nearest_rotations, rotation_matrix, skew
from ..linear import NEUTRAL, SingularMatrixError
from ..model import System
from ..model.balance import Amplitudes
from ..model.limits import FAR_TURN, over_rotated
from ..types import SAME, Floats, IndexArray, largest
from .stacked import (
    ReducedTangent,
    blocks_matrix,
    material_stiffness,
    null_space_matrix,
    reduced_tangent,
    weights,
)

# -- motions of a scene in which nothing is strained: of its beams and bodies as rigid pieces ------

#: rigid pieces above which motions of them are not sought: the search is dense
PIECES = 400


def rigid_pieces(system: System, joined: bool = False) -> tuple[IndexArray, list[str]]:
    """Number of each vertex's rigid piece, and names of the pieces.

    With `joined` those that fixed joints hold together are one piece.
    """
    count = len(system.origin_rows)
    pairs = [np.zeros((0, 2), np.int64)]
    for group in system.beam_groups:
        first = np.broadcast_to(group.vertices[:, :1], group.vertices.shape)
        pairs.append(np.stack([first, group.vertices], -1).reshape(-1, 2))
    fixed = [jr.joint for jr in system.joint_rows if jr.joint.type == "fixed" and joined]
    ends = [[system.spot(place).vertex for place in (joint.a, joint.b)] for joint in fixed]
    both = [pair for pair in ends if max(pair) < count]
    a, b = np.concatenate([*pairs, np.array(both, np.int64).reshape(-1, 2)]).T
    graph = coo_matrix((np.ones(len(a)), (a, b)), shape=(count, count))
    label = connected_components(graph, directed=False)[1]
    first = np.unique(label, return_index=True)[1]
    return label, [system.owner[v].label for v in first.tolist()]


def rigid_motions(
    system: System, y: Floats, label: IndexArray, count: int
) -> tuple[csr_matrix, Floats]:
    """Rates (n, 6 pieces) of unit translations (scene's length) and rotations about centroids."""
    kin = system.kinematics
    x = y[system.origin_rows]
    centres = np.array([x[label == k].mean(0) for k in range(count)])
    rates = np.zeros((len(x), 4, 3, 6))
    rates[:, 0, :, :3] = system.length * np.eye(3)
    rates[:, 0, :, 3:] = -skew(x - centres[label])
    rates[kin.frames, 1:, :, 3:] = -skew(y[kin.director_rows])
    own = np.arange(12) < np.where(system.is_frame[: len(x)], 12, 3)[:, None]
    rows = (3 * system.origin_rows[:, None] + np.arange(12))[own]
    cols = (6 * label).repeat(own.sum(1))[:, None] + np.arange(6)
    values = rates.reshape(-1, 12, 6)[own].ravel()
    shape = system.n, 6 * count
    return csr_matrix((values, (rows.repeat(6), cols.ravel())), shape=shape), centres


def motions_out_of_plane(system: System, count: int) -> csr_matrix:
    """Rows (k, 6 pieces) whose products with motions of pieces vanish in the scene's plane."""
    if system.plane is None:
        return csr_matrix((0, 6 * count))
    out_of = np.zeros((3, 6))
    out_of[0, :3] = system.plane.normal
    out_of[1:, 3:] = system.plane.axes
    return csr_matrix(kron(identity(count), out_of))


# -- motions that nothing holds --------------------------------------------------------------------

#: stiffness of a motion, against the terms that it is made of, below which nothing holds it: of
#: free motions it was below 5e-16, of a soft beam on a stiff one above 1.6e-13 (measured)
FREE = 1e-14
#: part of a motion without stiffness that is no motion of rigid pieces, up to which it is one
RIGID = 1e-6
#: free motions that are looked for at most
MOST = 16


def free_motion(system: System, tangent: ReducedTangent) -> tuple[str, str] | None:
    """The item that moves most in a motion that nothing holds, and the motion in words.

    None: there is none. Such a motion has no stiffness, and moves beams and bodies as rigid
    pieces, in which no springs are strained.
    """
    K, P, metric, y = tangent.K, tangent.P, tangent.metric, tangent.balance.y
    scale = largest(K.diagonal() / metric.diagonal())
    factors = splu((K + (FREE * scale or 1.0) * metric).tocsc())
    modes = np.random.default_rng(0).standard_normal((K.shape[0], min(MOST, K.shape[0])))
    for _ in range(5):  # inverse iteration: what nothing holds is all that is left
        modes = np.linalg.qr(factors.solve(metric @ modes))[0]
    modes = modes @ np.linalg.svd(modes.T @ (K @ modes))[2].T
    none = NEUTRAL * scale * (modes * (metric @ modes)).sum(0)
    none += FREE * (abs(modes) * (abs(K) @ abs(modes))).sum(0)
    springs = blocks_matrix(system, [*system.empty_tangent(), system.couplings.stiffness(y)])
    for X, A in ((modes, K), (P @ modes, springs)):
        none[abs((X * (A @ X)).sum(0)) > none] = -1.0
    modes = modes[:, none >= 0]
    label, names = rigid_pieces(system)
    E, centres = rigid_motions(system, y, label, len(names))
    size = diags(np.sqrt(weights(system)).repeat(3))
    moved = size @ P @ modes
    weighted = size @ E
    gram = (weighted.T @ weighted).tocsc()  # mass points have no rotations
    gram += SAME * largest(gram.data) * identity(gram.shape[0], format="csc")
    twists = splu(gram).solve(weighted.T @ moved)
    _, strained, mix = np.linalg.svd(moved - weighted @ twists, full_matrices=False)
    twists = twists @ mix[strained <= RIGID * np.linalg.norm(moved, axis=0).max(initial=0.0)].T
    found = twists.shape[1]
    if not found:
        return None
    # as few pieces and components in each as possible
    chosen = qr(twists.T, pivoting=True, mode="economic")[2][:found]
    twist = np.linalg.solve(twists[chosen].T, twists.T)[0].reshape(-1, 2, 3)
    twist = np.where(abs(twist) < 1e-7, 0.0, twist)
    sizes = np.linalg.norm(twist, axis=(1, 2))
    k = sizes.argmax()
    v, w = twist[k]
    turn = np.linalg.norm(w)
    main = w / turn if turn else v / sizes[k]
    v, main = np.sign(main[abs(main).argmax()]) * np.array([v, main])
    text = f"translation along {_triple(main)}"
    if turn:
        through = centres[k] + system.length * np.cross(main, v) / turn
        text = f"rotation about {_triple(main)} through {_triple(through)}"
    others = [names[i] for i in np.flatnonzero(sizes) if i != k]
    text += f", with {' and '.join(others[:2])}{' and others' * (len(others) > 2)}" * bool(others)
    if found > 1:
        text += f", one of {found}{' or more' * (found == MOST)} such motions"
    return names[k], text


def _triple(v: Floats) -> str:
    return "(" + ", ".join(f"{x + 0.0:.3g}" for x in np.where(abs(v) < 1e-9, 0.0, v)) + ")"


# -- nodes brought to rest while all others are held -----------------------------------------------


def settled(
    system: System,
    y: Floats,
    amplitudes: Amplitudes,
    rows: IndexArray,
    inertia: Floats,
) -> Floats:
    """A configuration in which some nodes of beams are in equilibrium between all others.

    Interpolated nodes are farther off than what they are interpolated from, and stiff motions
    leave large forces there.

    Parameters
    ----------
    y : (total, 3) array
        All rows of the configuration.
    amplitudes : Amplitudes
        Of the loads.
    rows : (k, 4) int array
        Rows of y of the nodes: phi and the directors. Those that joints hold stay where they are.
    inertia : (n,) array
        ``M a``, which keeps the balance with the other forces.

    Returns
    -------
    (total, 3) array
        y as it was, if the others are too far from where these nodes could be at rest.
    """

    def missing(tangent: ReducedTangent) -> Floats:
        """Residual along the constraints."""
        return tangent.P.T @ (tangent.balance.R.ravel() + inertia)

    tangent = reduced_tangent(system, y, amplitudes)
    while len(rows):
        P = tangent.P.tocsc()
        outside = np.ones(system.n)
        outside[(3 * rows[..., None] + np.arange(3)).ravel()] = 0.0
        free = np.flatnonzero(abs(P).T @ outside == 0)  # columns of these nodes alone
        if not len(free):
            break
        try:
            change = splu(tangent.K[free][:, free].tocsc()).solve(-missing(tangent)[free])
        except RuntimeError:  # SuperLU: exactly singular
            break
        moved = y.copy()
        moved[: system.rows] += (P[:, free] @ change).reshape(-1, 3)
        moved[rows[:, 1:]] = nearest_rotations(moved[rows[:, 1:]])
        after = reduced_tangent(system, moved, amplitudes)
        sizes = [largest(missing(each)[free]) for each in (tangent, after)]
        if not sizes[1] < 0.5 * sizes[0]:  # rounding, or too far from where they are at rest
            break
        y = moved
        tangent = after
    return y


# -- the configuration on the constraints that is nearest to a given one ---------------------------

#: violation, relative to the size of coordinates in the rows, that counts as none
HELD = 1e-14
#: elastic energy against kinetic energy in the distance, in units of the scene's lowest motions
STIFF = 1e3


def nearest_configuration(system: System, y: Floats) -> Floats | None:
    """Rows y (total, 3) moved on the constraints; None if these cannot be fulfilled near them.

    Nearest by what is kept: as little change as possible of the strains that beams have, and of
    places, weighted with the mass, where that leaves a choice. The centre of mass of a scene in
    free flight stays where it is.

    Newton's method for ``g(y) = 0``: of all increments with ``G dy = -g`` the one of least
    ``dy . (M + tau^2 K) dy``, K the stiffness of the material.

    Parameters
    ----------
    y : (total, 3) array
        With orthonormal triads.

    Examples
    --------
    The bob of a pendulum that has drifted off its circle:

    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> system = model.freeze()
    >>> y = system.extend(system.q0, 0.0)
    >>> y[0] = 0.66, 0, -0.88   # 1.1 away
    >>> found = nearest_configuration(system, y)
    >>> (found[0] + 0.0).round(9).tolist()
    [0.6, 0.0, -0.8]
    """
    constraints, best, start = system.constraints, np.inf, y
    for _ in range(CLOSING):
        g = constraints.values(y)
        # where terms cancel or vanish, coordinates are still known to rounding only
        size = constraints.magnitudes(y, np.full_like(y, largest(y)))
        violation = float((abs(g) / (size + 1e-300)).max(initial=0.0))
        if violation <= HELD or (violation >= 0.5 * best and best < 1e3 * HELD):
            # rotations of nodes that Gauss points do not see can make elements longer than they are
            turned = over_rotated(system, y) is not None and over_rotated(system, start) is None
            return None if turned or system.wrong_branch(y) is not None else y
        best = min(best, violation)
        try:
            change = _increment(system, y, g)
        except SingularMatrixError:
            return None
        if not np.isfinite(change).all():
            return None
        y = _moved(system, y, change)
    return None


def _increment(system: System, y: Floats, g: Floats) -> Floats:
    """The least one (rows, 3) that takes the violation g (m,) away to first order."""
    change = RowSpace(system, y).least_norm(-g)
    P = null_space_matrix(system, y).tocsc()
    if P.shape[1]:
        W = _metric(system, y)
        try:
            change = change - P @ splu((P.T @ W @ P).tocsc()).solve(P.T @ (W @ change))
        except RuntimeError as error:  # SuperLU: exactly singular
            raise SingularMatrixError("P^T M P is singular: a motion has no inertia") from error
    return change.reshape(-1, 3)


def _metric(system: System, y: Floats) -> csr_matrix:
    """``M + tau^2 K``: a motion of the scene's extent strains it by far more than it moves it."""
    M = full_mass(system)
    K = material_stiffness(system, y)
    size = float(K.diagonal().sum())
    if not size > 0:
        return M
    shifted = float(system.mass.diagonal()[system.origin_rows].sum()) * system.length**2
    return csr_matrix(M + (STIFF * shifted * len(system.origin_rows) ** 2 / size) * K)


def _moved(system: System, y: Floats, change: Floats) -> Floats:
    """With positions shifted and triads turned, by an increment of limited size."""
    kin = system.kinematics
    rates = np.zeros_like(y)
    rates[: system.rows] = change
    directors = kin.directors(y)
    spin = 0.5 * np.cross(directors, kin.directors(rates)).sum(1)
    share = min(1.0, FAR_TURN / max(largest(spin), 1e-300))
    out = y + share * rates
    # rows are directors, which inverse rotations turn from the right
    out[kin.director_rows] = directors @ rotation_matrix(exp_quaternion(-share * spin))
    return out
