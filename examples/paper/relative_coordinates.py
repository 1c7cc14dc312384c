"""The six-body linkage in relative coordinates of its tree: the comparison the paper leaves open.

Leyendecker, Marsden & Ortiz, ZAMM 88 (2008) 677, end with the remark that a comparison of their
constrained formulation with relative coordinates "is certainly of interest and remains for future
work". Here is a plain one, in numpy alone and without the package: the cube-edge linkage of Bricard
cut at its last hinge, the five hinge angles of the tree as coordinates, the closure of the cut
hinge by multipliers. Of its five rows only four are independent; they are chosen in each step by
a QR factorisation with column pivoting. Variational midpoint integrator
``L_d = h L((a_n + a_{n+1})/2, (a_{n+1} - a_n)/h)`` with the constraint forces at the nodes, as in
equation (22); the mass matrix now depends on the configuration, and Newton's method needs the
second derivatives of the Lagrangian: by complex steps through a recursion along the chain.

All units SI. Run ``python examples/paper/relative_coordinates.py --help`` for the choices.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

Array = NDArray[Any]
Floats = NDArray[np.float64]

#: hinge k is at POINTS[k] with axis AXES[k]; moving rod k spans POINTS[k] to POINTS[k + 1]; the
#: sixth hinge, at POINTS[5], closes the ring with the rod that is fixed to the ground
POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1]], float)
AXES = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 0]], float)
MASS, EDGE, GRAVITY = 1.0, 0.1, np.array([0.0, -9.81, 0.0])
BODIES = 5
#: P3 (m) at times (s), by other means: maximal coordinates, minimum-norm multipliers, a Runge-Kutta
#: method of order 8 with a tolerance of 1e-12; trusted to 8 digits
REFERENCE = {
    0.5: (0.9682836791067968, -1.2246251594355344, 0.7501466094375233),
    1.0: (0.5105014611903579, -1.6491675993910289, 0.14012311455327287),
    1.5: (-0.5177294918808422, -1.646538412820696, 0.14445562754518096),
    2.0: (-0.9693403447686205, -1.2212468949568067, 0.7542780107815568),
    4.0: (0.5248995931057479, -1.6438760013958404, 0.1488358459506174),
    5.0: (0.9999999976065557, -1.0000672575874647, 0.9999327401985166),
    8.0: (-0.964948571494513, -1.2348595432957201, 0.7375609544891595),
    10.0: (0.9999999600604265, -1.0002690106935694, 0.9997309558318888),
}
RANK_TOLERANCE = 1e-8
CONDITION_STEPS = (1, 10, 20, 50, 100)
#: what sums over the bodies at and beyond each hinge
_BEYOND = np.triu(np.ones((BODIES, BODIES)))
_UPTO = _BEYOND.T.copy()
_EDGES = POINTS[1:] - POINTS[:-1]


def _skew(v: Floats) -> Floats:
    out = np.zeros((*v.shape[:-1], 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i, j], out[..., j, i] = -v[..., k], v[..., k]
    return out


def _rod_inertia() -> Floats:
    """Inertia (5, 3, 3) of square rods about their centres, in the reference configuration."""
    along = np.einsum("ki,kj->kij", _EDGES, _EDGES)
    across, axial = MASS * (1 + EDGE**2) / 12, MASS * EDGE**2 / 6
    return across * np.eye(3) + (axial - across) * along


_TURN, _TURN2 = _skew(AXES[:BODIES]), _skew(AXES[:BODIES]) @ _skew(AXES[:BODIES])
_INERTIA = _rod_inertia()
_WEIGHT = MASS * GRAVITY


def _cross(a: Array, b: Array) -> Array:
    """Faster than ``np.cross`` for few vectors."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def chain(angles: Array) -> tuple[Array, Array, Array]:
    """Rotations of the bodies (..., 5, 3, 3), hinge axes (..., 5, 3), points (..., 6, 3).

    Parameters
    ----------
    angles : (..., 5) array
        Hinge angles (rad), real or complex.
    """
    s, c = np.sin(angles)[..., None, None], np.cos(angles)[..., None, None]
    relative = np.eye(3) + s * _TURN + (1 - c) * _TURN2
    R = np.empty_like(relative)
    R[..., 0, :, :] = relative[..., 0, :, :]
    for k in range(1, BODIES):
        R[..., k, :, :] = R[..., k - 1, :, :] @ relative[..., k, :, :]
    axes = (R @ AXES[:BODIES, :, None])[..., 0]  # a hinge's own turn leaves its axis where it is
    points = np.zeros((*angles.shape[:-1], 6, 3), dtype=R.dtype)
    points[..., 1:, :] = np.cumsum((R @ _EDGES[:, :, None])[..., 0], axis=-2)
    return R, axes, points


def lagrangian_slopes(angles: Array, rates: Array) -> tuple[Array, Array]:
    """``dL/da`` and ``dL/d(da/dt)``, (..., 5) each, by one recursion along the chain.

    With twists ``V_i = sum_{k <= i} S_k a_k'`` about the origin and the momenta ``H_k`` of all
    bodies at and beyond hinge k, ``dT/da_k' = S_k . H_k`` and ``dT/da_k = -H_k . [S_k, V_k]``.

    Parameters
    ----------
    angles, rates : (..., 5) array
        Hinge angles (rad) and their rates (rad/s), real or complex.
    """
    R, axes, points = chain(angles)
    hinge = points[..., :BODIES, :]
    centre = 0.5 * (hinge + points[..., 1:, :])
    arm = _cross(hinge, axes)
    turn = _UPTO @ (axes * rates[..., None])
    shift = _UPTO @ (arm * rates[..., None])
    linear = MASS * (shift + _cross(turn, centre))
    spin = R @ (_INERTIA @ (R.swapaxes(-1, -2) @ turn[..., None]))
    F = _BEYOND @ linear
    H = _BEYOND @ (_cross(centre, linear) + spin[..., 0])
    weight = _BEYOND @ np.broadcast_to(_WEIGHT, centre.shape)
    moment = _BEYOND @ _cross(centre, _WEIGHT)
    momentum = (axes * H + arm * F).sum(-1)
    bracket = _cross(axes, shift) + _cross(arm, turn)
    slope = (axes * moment + arm * weight - H * _cross(axes, turn) - F * bracket).sum(-1)
    return slope, momentum


def energy(angles: Floats, rates: Floats) -> Floats:
    """Kinetic energy and potential of gravity (J), (...)."""
    momentum = lagrangian_slopes(angles, rates)[1]
    points = chain(angles)[2]
    height = 0.5 * (points[..., 1:, :] + points[..., :-1, :])
    return 0.5 * (momentum * rates).sum(-1) - (height @ _WEIGHT).sum(-1)


def closure(angles: Array) -> Array:
    """What the cut hinge demands, (..., 5): its point (m), and two right angles of its axis."""
    R, _, points = chain(angles)
    axis = R[..., -1, :, 0]
    return np.concatenate([points[..., 5, :] - POINTS[5], axis[..., 1:]], axis=-1)


def closure_jacobian(angles: Floats) -> Floats:
    """``dg/da`` (5, 5) for angles (5,); of rank 4."""
    R, axes, points = chain(angles)
    out = np.empty((5, BODIES))
    out[:3] = _cross(axes, points[5] - points[:BODIES]).T
    out[3:] = _cross(axes, np.broadcast_to(R[-1, :, 0], axes.shape))[:, 1:].T
    return out


def independent_rows(G: Floats) -> Floats:
    """Numbers of a largest set of independent rows of G, best conditioned ones first."""
    _, r, pivots = qr(G.T, mode="economic", pivoting=True)
    size = abs(np.diag(r))
    return np.sort(pivots[: int((size > RANK_TOLERANCE * size[0]).sum())])


class Stepper:
    """Variational midpoint integrator in the five angles, with four multipliers.

    Parameters
    ----------
    step : float
        (s)

    Attributes
    ----------
    angles : (5,) array
        At the end of the last step.
    matrix : (9, 9) array
        Iteration matrix at the solution of the last step, not scaled.
    iterations : int
        Newton iterations of the last step.
    """

    def __init__(self, step: float) -> None:
        if not (np.isfinite(step) and step > 0):
            raise ValueError(f"step = {step!r}, expected a positive number")
        self.h = float(step)
        self.angles = np.zeros(BODIES)
        self.momentum = np.zeros(BODIES)  # from rest
        self._increment = np.zeros(BODIES)
        self.iterations = 0
        self.matrix = np.zeros((BODIES + 4, BODIES + 4))

    def advance(self) -> None:
        """One step.

        Raises
        ------
        RuntimeError
            If the mobility changes (a singular configuration) or Newton's method fails.
        """
        G0 = closure_jacobian(self.angles)
        rows = independent_rows(G0)
        if len(rows) != 4:
            raise RuntimeError(f"the closure has rank {len(rows)}, expected 4: mobility changes")
        left = self.h * G0[rows].T
        for start in (self._increment, np.zeros(BODIES)):
            if self._newton(self.angles + start, left, rows):
                return
        raise RuntimeError(f"no convergence at angles {self.angles.tolist()}: a smaller step")

    def _newton(self, new: Floats, left: Floats, rows: Floats) -> bool:
        """Solve ``dL/da' - (h/2) dL/da - p_n + h G(a_n)^T lam = 0, g(a_{n+1}) = 0``."""
        h, old, eps = self.h, self.angles, 1e-30
        lam, last = np.zeros(4), 0.0
        for iteration in range(1, 21):
            trial = new + 1j * eps * np.eye(BODIES)  # all derivatives by one complex recursion
            slope, momentum = lagrangian_slopes(0.5 * (old + trial), (trial - old) / h)
            r = momentum - 0.5 * h * slope
            residual = np.concatenate([r[0].real - self.momentum + left @ lam, closure(new)[rows]])
            matrix = np.zeros((BODIES + 4, BODIES + 4))
            matrix[:BODIES, :BODIES] = r.imag.T / eps
            matrix[:BODIES, BODIES:] = left
            matrix[BODIES:, :BODIES] = closure_jacobian(new)[rows]
            update = np.linalg.solve(matrix, -residual)
            new, lam = new + update[:BODIES], lam + update[BODIES:]
            size = float(abs(update[:BODIES]).max())
            # small, or the next one would be: estimated from the contraction of the last two
            if size < 1e-13 or (size < 1e-3 and size**3 < 1e-15 * last**2):
                self._accept(new, matrix, iteration)
                return True
            if not size < 10:
                return False
            last = size
        return False

    def _accept(self, new: Floats, matrix: Floats, iterations: int) -> None:
        mid, rate = 0.5 * (self.angles + new), (new - self.angles) / self.h
        slope, momentum = lagrangian_slopes(mid, rate)
        self.momentum = momentum + 0.5 * self.h * slope  # D_2 L_d
        self._increment, self.angles = new - self.angles, new
        self.matrix, self.iterations = matrix, iterations


def main(step: float = 1e-2, until: float = 10.0) -> dict[str, Any]:
    """Run the linkage from rest.

    Parameters
    ----------
    step, until : float
        Step size and end time (s).

    Returns
    -------
    dict
        ``times`` (N,), ``P3`` (N, 3), ``joint_angles`` (N, 6), ``closure`` (N,) (largest violation
        of all five rows of the cut hinge), ``energy_midpoint`` (N-1,), ``newton_iterations``
        (N-1,), ``unknowns``, ``coordinates``, ``rank``.
    """
    if not (np.isfinite(until) and until > 0):
        raise ValueError(f"until = {until!r}, expected a positive number")
    stepper = Stepper(step)
    count = int(np.floor(until / step * (1 + 1e-12)))
    angles, iterations = [stepper.angles], []
    for _ in range(count):
        stepper.advance()
        angles.append(stepper.angles)
        iterations.append(stepper.iterations)
    a = np.array(angles)
    R, _, points = chain(a)
    last = np.unwrap(np.arctan2(R[:, -1, 1, 2], R[:, -1, 1, 1]))  # of the ground against rod 5
    return {
        "times": np.arange(count + 1) * step,
        "P3": points[:, 3],
        "joint_angles": np.column_stack([a, last]),
        "closure": abs(closure(a)).max(-1),
        "energy_midpoint": energy(0.5 * (a[1:] + a[:-1]), np.diff(a, axis=0) / step),
        "newton_iterations": np.array(iterations, dtype=int),
        "unknowns": len(stepper.matrix),
        "coordinates": BODIES,
        "rank": len(independent_rows(closure_jacobian(stepper.angles))),
    }


def condition_number(step: float, scaled: bool = False, steps: Any = None) -> float:
    """Median 2-norm condition number of the iteration matrix over some steps.

    Parameters
    ----------
    step : float
        (s)
    scaled : bool
        With the rows and columns of the closure scaled by the largest entry of the dynamic block.
    steps : sequence of int, optional
        Step numbers; default: 1, 10, 20, 50, 100.
    """
    numbers = CONDITION_STEPS if steps is None else tuple(steps)
    if not numbers or not all(isinstance(k, int | np.integer) and k >= 1 for k in numbers):
        raise ValueError(f"steps = {steps!r}, expected positive step numbers")
    stepper = Stepper(step)
    values = []
    for number in range(1, max(numbers) + 1):
        stepper.advance()
        if number in numbers:
            matrix = stepper.matrix.copy()
            if scaled:
                size = abs(matrix[:BODIES, :BODIES]).max()
                matrix[:BODIES, BODIES:] *= size / stepper.h
                matrix[BODIES:, :BODIES] *= size
            values.append(np.linalg.cond(matrix))
    return float(np.median(values))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--step", type=float, default=1e-2)
    parser.add_argument("--until", type=float, default=10.0)
    arguments = parser.parse_args()
    result = main(arguments.step, arguments.until)
    print(f"six-body linkage in {result['coordinates']} angles, {result['unknowns']} unknowns")
    for time, place in REFERENCE.items():
        k = round(time / arguments.step)
        if k < len(result["times"]):
            error = float(np.linalg.norm(result["P3"][k] - place))
            print(f"  t = {time:4.1f} s: P3 off the reference by {error:.3e} m")
    print(f"  largest closure violation {result['closure'].max():.1e}")
