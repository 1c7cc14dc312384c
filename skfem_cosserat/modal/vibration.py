"""Vibrations about an equilibrium, and shapes as histories."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix

from .. import checks
from ..analysis.describe import configuration_formulas, describe
from ..arguments import checked
from ..checks.coarseness import energies_of_motion
from ..errors import InputError
from ..history import History
from ..model import System, takes_scene
from ..model.balance import Amplitudes, Spin
from ..model.loops import moved
from ..notebook import Shown
from ..types import Array, FilePath, Floats, is_whole, largest, numbered, positive, whole
from ..warn import Notice, Notices, counted, told
from .eigen import Pencil, lowest, make_pencil, spectrum
from .state import Equilibrium, StateLike, as_system, resting

# -- A mode as a history: finite motions along its shape -------------------------------------------

#: of a film of a mode
FRAMES = 28


class Animated(Shown):
    """Modes that can be shown as films."""

    reduced: Array
    called: Any
    _at: Equilibrium

    def _eigenvalue(self, k: int) -> complex:
        return 0j

    def animation(
        self, index: int, amplitude: float = 0.1, frames: int = 24, periods: int = 1
    ) -> History:
        """A mode as a time series, to be shown and exported like any other history.

        Parameters
        ----------
        index : int
            Which mode.
        amplitude : float
            Largest displacement relative to the extent of the scene, or largest rotation in full
            turns: whichever is reached first.
        frames : int
            Frames of a period; one more is given, so that the last is the first again.
        periods : int
            How many; a mode that does not oscillate is shown as if it did, in 1 s.

        Returns
        -------
        History
            Finite rotations are composed along the motion, so that triads stay orthonormal and
            joints closed. Damping and growth are not shown. Velocities are those of the shape.

        Raises
        ------
        InputError
            For a mode that is not there, for numbers that are not positive, or if a closed loop
            cannot follow so far.
        """
        k = numbered("argument index", index, len(self.reduced), "modes")
        at = self._at
        s = self._eigenvalue(k)
        x = self.reduced[k]
        size = positive("argument amplitude", "amplitude", amplitude)
        whole("argument frames", frames, 1)
        whole("argument periods", periods, 1)
        system = at.system
        P = at.tangent.P
        # the largest displacement over the extent, or rotation over a full turn, in a period
        cycle = np.exp(1j * np.linspace(0, np.pi, 13))
        moved = np.multiply.outer(cycle, (P @ x).reshape(-1, 3)).real
        rows = system.kinematics.director_rows
        shifts = np.linalg.norm(moved[:, system.origin_rows], axis=-1) / system.length
        angles = 0.5 * np.cross(at.y[rows], moved[:, rows]).sum(2)
        turns = np.linalg.norm(angles, axis=-1) / (2 * np.pi)
        x = size / max(largest(shifts), largest(turns)) * x
        omega = abs(s.imag) if abs(s.imag) > 1e-9 * abs(s) else 2 * np.pi
        phases = 2 * np.pi / frames * np.arange(frames * periods + 1)
        waves = np.exp(1j * phases)[:, None] * x
        q = np.array([_moved(at, wave) for wave in waves.real])
        v = (P @ (1j * omega * waves).real.T).T
        increment = (P @ waves.real.T).T
        p = np.array([(system.mass @ row.reshape(-1, 3)).reshape(-1) for row in v])
        meta, static = describe(system)
        meta |= {
            "status": "completed",
            "integrator": "mode",
            "mode": k,
            "eigenvalue": [s.real, s.imag],
            "amplitude": size,
            #: functions of time are taken at this one (s)
            "instant": at.t,
        }
        static["equilibrium"] = at.y[: system.rows].reshape(-1)
        count = len(phases)
        series = {
            "t": phases / omega,
            "step": np.arange(count),
            "q": q,
            "p": p,
            "v": v,
            "constraint_force": np.full((count, system.n), np.nan),
            "increment": increment,
            "acceleration": np.real(s**2) * increment,
            "amplitudes/loads": np.tile(at.amplitudes.loads, (count, 1)),
            "amplitudes/spin": np.tile(at.amplitudes.turning, (count, 1, 1)),
        }
        return History(meta, static, series, None, [system], configuration_formulas)

    def animate(
        self,
        index: int,
        path: FilePath,
        *,
        amplitude: float = 0.1,
        fps: float = 25,
        **look: Any,
    ) -> Path:
        """Film of one cycle of a mode in 28 frames, over the pale state that it is a mode of.

        Parameters
        ----------
        index : int
            Which mode.
        path : path-like
            ``.gif``, which loops, or ``.mp4`` (extra ``film``).
        amplitude : float
            As for :meth:`animation`: relative to the extent of the scene.
        fps
            As for :meth:`History.animate`.
        **look
            ``colour``, ``camera``, ``radius``, ``names``, ``window`` as there; by default one
            colour.

        Returns
        -------
        Path
            The film.

        Raises
        ------
        InputError
            As :meth:`animation` and :meth:`History.animate`.
        ImportError
            Without pyvista (extra ``view``).
        CosseratError
            Without OpenGL.

        Examples
        --------
        >>> modes(model).animate(0, "mode.gif")  # doctest: +SKIP
        """
        from ..picture import Look, film

        history = self.animation(index, amplitude, FRAMES)
        rest = self.animation(index, 1e-9, 1)
        texts = FRAMES * [self.called(index)]
        how = Look(**{"window": (960, 540)} | look)
        return film(history, path, range(FRAMES), texts, [rest.row(0)], fps, how)


def _moved(at: Equilibrium, increment: Floats) -> Floats:
    """Configuration (n,) after a finite motion."""
    system = at.system
    y = at.y
    found = moved(system, y, y[system.rows :], increment)
    if found is None:
        raise InputError(
            "argument amplitude", "a closed loop cannot follow so far: take a smaller one"
        )
    return found[: system.rows].reshape(-1)


# -- eigenfrequencies and shapes of small vibrations about a state of rest or of steady rotation ---

#: growth relative to the modulus of an eigenvalue that is more than rounding
GROWTH = 1e-9


@checked
@dataclass(eq=False)
class Modes(Animated):
    """Modes ``dq = Re(shape exp(s t))``, the slowest first.

    Attributes
    ----------
    system : System
    eigenvalues : (count,) complex array
        s (1/s): of each conjugate pair the one with positive imaginary part. For an unstable
        state without damping the positive one of a real pair.
    shapes : (count, n) array
        Changes of the coordinates q; of unit modal mass, ``conj(shape) M shape = 1`` (kg). Complex
        with gyroscopic terms or damping.
    reduced : (count, unknowns) array
        The same in the unknowns of the null space method.
    rigid : int
        Motions without stiffness; they come first, with ``s = 0`` exactly. (In a turning frame a
        motion without stiffness need not be a rigid one, and the other way round.)
    q : (n,) array
        Configuration about which the scene vibrates.
    t : float
        Its time, or its load factor on a path.
    factorisations : int
        Of sparse matrices.
    warnings : list of dict
        As in ``history.meta["warnings"]``.
    """

    system: System
    eigenvalues: Array
    shapes: Array
    reduced: Array
    rigid: int
    q: Floats
    t: float
    factorisations: int
    _at: Equilibrium
    warnings: list[Notice] = field(default_factory=list)

    def called(self, index: int) -> str:
        """Its number and frequency."""
        k = numbered("argument index", index, len(self), "modes")
        return f"mode {k}: {self.frequencies[k]:.4g} Hz"

    def _eigenvalue(self, k: int) -> complex:
        return complex(self.eigenvalues[k])

    @property
    def omega(self) -> Floats:
        """Angular frequencies ``Im s`` (count,) (rad/s); zero where nothing oscillates."""
        return self.eigenvalues.imag + 0.0

    @property
    def frequencies(self) -> Floats:
        """``omega / (2 pi)`` (count,) (Hz)."""
        return self.omega / (2 * np.pi)

    @property
    def growth(self) -> Floats:
        """``Re s`` (count,) (1/s): negative for damped modes, positive for unstable ones."""
        return np.array(self.eigenvalues.real)

    @property
    def damping_ratios(self) -> Floats:
        """``-Re s / |s|`` (count,): 1 and more means overdamped, negative unstable, zero rigid."""
        size = abs(self.eigenvalues)
        return 0.0 - self.growth / np.where(size > 0, size, 1.0)

    @property
    def squares(self) -> Floats:
        """``-Re s^2`` (count,) ((rad/s)^2): of undamped modes omega^2, negative if unstable."""
        return -np.real(self.eigenvalues**2)

    @property
    def stable(self) -> bool:
        """True if no mode found grows."""
        return not bool((self.growth > GROWTH * abs(self.eigenvalues)).any())

    def __len__(self) -> int:
        return len(self.eigenvalues)

    def summary(self) -> dict[str, Any]:
        """State, frequencies and damping ratios."""
        factor = self._at.load_factor
        about = f"t = {self.t:g} s" if factor is None else f"load factor {factor:g}"
        return {"about": about, "modes": str(self), "warnings": told(self.warnings)}

    def __repr__(self) -> str:
        found = ", ".join(f"{hertz:.6g}" for hertz in self.frequencies[:3])
        more = ", ..." * (len(self) > 3)
        doubt = counted(self.warnings)
        about = self.summary()["about"]
        return f"<Modes: {len(self)} about {about}, {found}{more} Hz{doubt}>"

    def __str__(self) -> str:
        """A table."""
        lines = ["mode    omega rad/s   frequency Hz   damping ratio"]
        for k, (omega, hertz, ratio) in enumerate(
            zip(self.omega, self.frequencies, self.damping_ratios, strict=True)
        ):
            note = "  no stiffness" if k < self.rigid else ""
            if self.growth[k] > GROWTH * abs(self.eigenvalues[k]):
                note = f"  grows with {self.growth[k]:.4g} 1/s"
            elif omega == 0 and k >= self.rigid:
                note = f"  decays with {-self.growth[k]:.4g} 1/s"
            lines.append(f"{k:4d} {omega:14.7g} {hertz:14.7g} {ratio:15.6g}{note}")
        return "\n".join(lines)


@takes_scene
def modes(
    model: System,
    state: StateLike | None = None,
    count: int = 6,
    *,
    t: float | None = None,
    amplitudes: Amplitudes | None = None,
    spin: Spin | None = None,
    tolerance: float = 1e-6,
) -> Modes:
    """Eigenfrequencies and shapes of small vibrations about an equilibrium.

    Parameters
    ----------
    model : Model or System
        Also free of the ground, with joints, bodies, closed loops, springs and dampers.
    state : (n,) array, State, History or (History, index), optional
        Configuration to vibrate about; velocities are not looked at. Default: the reference
        **without loads**. A history gives its last state.
    count : int
        How many modes, at most ``system.unknowns``.
    t : float, optional
        Time (s) of loads and prescribed motion; default: that of the state, 0 for an array. Given
        with no state, the reference is taken with its loads. Prescribed motion stands still.
    amplitudes : Amplitudes, optional
        Factors of all loads and actuators instead. A path of :func:`static` knows its own, and
        its spin.
    spin : Spin, optional
        The state rests in a frame that turns steadily, the ground with it: with centrifugal and
        gyroscopic forces, frequencies as seen from there.
    tolerance : float
        Largest residual of the balance, relative to its terms.

    Returns
    -------
    Modes

    Raises
    ------
    InputError
        For a state that does not fit, is not finite, or is no equilibrium (with what is left over
        and where); for a count that is not there.
    IncompatibleError
        For a spin with a drag against space.
    CosseratError
        If the eigenvalue iteration does not converge.

    Notes
    -----
    ``P^T M P u'' + (2 P^T M Omega^ P + D) u' + P^T (dR/dq + sum_k lambda_k H_k) P u = 0``: the
    constraint forces of the state enter by the second derivatives H_k of the constraints. The
    number of modes below the last one is checked by Sylvester's law of inertia in large scenes.

    Examples
    --------
    The steel cantilever of 1 m x 10 mm x 10 mm bends first at 8.35 Hz, in both directions:

    >>> from skfem_cosserat import Beam, JointFixed, Material, MeshCurve, Model, SectionRectangle
    >>> from skfem_cosserat import ground
    >>> steel = Material(210e9, 0.3, 7850.0)
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, nodes={"root": 0.0})
    >>> model = Model()
    >>> beam = Beam(mesh, SectionRectangle(0.01, 0.01, steel), director=(0, 1, 0), order=4)
    >>> beam = model.add("beam", beam)
    >>> clamp = model.add("clamp", JointFixed(ground((0, 0, 0)), beam.node("root")))
    >>> modes(model, count=4).frequencies.round(3).tolist()
    [8.354, 8.354, 52.332, 52.332]
    """
    system = as_system(model)
    count = checked_count(count, system.unknowns)
    limit = positive("argument tolerance", "tolerance", tolerance)
    with Notices(system.warnings) as notices:
        at = resting(system, state, t, amplitudes, spin, limit)
        pencil = make_pencil(at)
        s, X, rigid, factorisations = _solve(pencil, count)
        if system.beam_groups and at.amplitudes.spin is None and not at.drawn:
            checks.apply(_shapes(pencil, s, X))
    shapes = (at.tangent.P @ X).T
    q = at.y[: system.rows].reshape(-1).copy()
    return Modes(system, s, shapes, X.T.copy(), rigid, q, at.t, factorisations, at, notices.found)


def _solve(pencil: Pencil, count: int) -> tuple[Array, Array, int, int]:
    """Eigenvalues, vectors, motions without stiffness, factorisations."""
    if pencil.simple:
        found = lowest(pencil.K, pencil.M, count, pencil.energies)
        s = np.sqrt(-found.values.astype(complex))
        s = np.where(found.values > 0, 1j * abs(s), abs(s))
        order = (~found.zero).argsort(kind="stable")
        s = s[order]
        X = found.vectors[:, order]
    else:
        found = spectrum(pencil, count)
        s = found.values
        X = found.vectors
    return s, led(X, pencil.M), int(found.zero.sum()), found.factorisations


def led(X: Array, metric: csr_matrix) -> Array:
    """Shapes (unknowns, count) whose largest entries, by a metric, are positive."""
    lead = X[np.argmax(abs(X) * np.sqrt(metric.diagonal())[:, None], 0), np.arange(X.shape[1])]
    return X * (abs(lead) / lead)


def _shapes(pencil: Pencil, s: Array, X: Array) -> checks.Shapes:
    """Modes for :mod:`checks`: those without damping, which have nearly the same shapes."""
    at = pencil.at
    system = pencil.at.system
    parts, noise = pencil.energies(X)
    energy = parts.diagonal().real
    squares = energy / np.einsum("ik,ik->k", X.conj(), pencil.M @ X).real
    state = system, at.y, at.tangent.balance.stresses, at.tangent.multipliers, at.amplitudes
    found = []
    for square, x in zip(squares, X.T, strict=True):
        motion = (at.tangent.P @ x).reshape(-1, 3)
        both = (motion.real, motion.imag)
        found.append(sum(energies_of_motion(*state, dq, -square * dq) for dq in both))
    energy = np.where((abs(energy) > noise) & (s != 0), abs(energy), 0.0)
    return checks.Shapes(system, "frequency", 2, np.array(found), energy)


def checked_count(count: int, most: int) -> int:
    """A number of modes.

    Raises
    ------
    InputError
        If it is no integer from 1 to `most`.
    """
    if not is_whole(count) or not 1 <= count <= most:
        raise InputError("argument count", f"{count!r}, expected 1 to {most} (the unknowns)")
    return int(count)
