"""What a section is to a beam: stiffness and mass, and the classical numbers read from them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import InputError
from ..section import Section
from ..types import ArrayLike, Floats, numbers
from .warping import Warping

__all__ = ["ProfileConstants"]


def _spin(x: Floats) -> Floats:
    """``(x_1, x_2, 0) x``."""
    return np.array([[0, 0, x[1]], [0, 0, -x[0]], [-x[1], x[0], 0]])


@dataclass(frozen=True, eq=False)
class ProfileConstants:
    """Constants of a section for the beam line through the origin of its axes.

    Attributes
    ----------
    stiffness : (6, 6) array
        ``(N, M) = stiffness (Gamma, K)`` (N, N m, N m^2).
    area : float
        (m^2).
    centroid, second_moments : (2,) and (2, 2) array
        Of the area: mean of ``X`` (m), and ``int X_i X_j dA`` about the origin (m^4).
    mass : float
        Per length (kg/m).
    centre : (2,) array
        Of mass (m).
    inertia : (2, 2) array
        ``int rho X_i X_j dA`` about the origin (kg m).
    shear_moduli : (2, 2) array
        ``int dA`` of the moduli ``((C_55, C_45), (C_45, C_44))`` of shear along d1 and d2 (N), of
        the material alone; ``G A`` on the diagonal if it is isotropic.
    error : float
        Estimated relative error of the elastic energy under the worst of all resultants.
    elements, unknowns : int
        Of the last mesh.
    outline : (k, 2) array
        Outer boundary (m).
    warping : Warping
        The six central solutions; resultants about ``origin``, axes turned by ``angle``.
    origin : (2,) array
        The beam line in the coordinates of ``warping`` (m).
    angle : float
        From the axes of ``warping`` to these (rad).

    Notes
    -----
    *Shear factors* are those of the energy (Renton, Comput. Struct. 38 (1991) 333; Pilkey,
    Analysis and Design of Elastic Beams, 2002): a shear force through the shear centre stores
    ``N^2 / (2 k G A)`` per length where its moment vanishes. A beam of this stiffness then stores
    exactly what the body does in Saint-Venant's solution. Cowper's factors (those of
    :class:`~skfem_cosserat.SectionCircle` and :class:`~skfem_cosserat.SectionTube`) average
    displacements instead: for a circle and nu = 0.3 they give 0.8864 in place of 0.8507.

    The *shear centre* is where a shear force stores no energy together with a torque, and so
    gives no twist in the mean of the energy (Trefftz, ZAMM 15 (1935) 220); it depends on Poisson's
    ratio only where materials differ in it. The definition by a vanishing mean rotation of the
    area differs from it by a term proportional to nu / (1 + nu).
    """

    stiffness: Floats
    area: float
    centroid: Floats
    second_moments: Floats
    mass: float
    centre: Floats
    inertia: Floats
    shear_moduli: Floats
    error: float
    elements: int
    unknowns: int
    outline: Floats = field(repr=False)
    warping: Warping = field(repr=False)
    origin: Floats = field(repr=False, default_factory=lambda: np.zeros(2))
    angle: float = field(repr=False, default=0.0)

    @property
    def compliance(self) -> Floats:
        """(6, 6): ``(Gamma, K) = compliance (N, M)``."""
        return np.asarray(np.linalg.inv(self.stiffness))

    @property
    def elastic_centre(self) -> Floats:
        """Point (2,) whose axial force bends nothing (m)."""
        F = self.compliance
        y, minus_x = -np.linalg.solve(F[3:5, 3:5], F[3:5, 2])
        return np.array([-minus_x, y])

    @property
    def shear_centre(self) -> Floats:
        """Point (2,) whose shear forces twist nothing (m)."""
        F = self.compliance
        return np.array([-F[5, 1], F[5, 0]]) / F[5, 5]

    @property
    def EA(self) -> float:
        """Axial stiffness: force by stretch where moments vanish at the elastic centre (N)."""
        return float(1 / self.moved(self.elastic_centre).compliance[2, 2])

    @property
    def EI(self) -> Floats:
        """Bending stiffness (2, 2) about d1 and d2 through the elastic centre (N m^2)."""
        return np.asarray(np.linalg.inv(self.compliance[3:5, 3:5]))

    @property
    def GJ(self) -> float:
        """Torsional stiffness: torque by twist (N m^2)."""
        return float(1 / self.compliance[5, 5])

    @property
    def GA(self) -> Floats:
        """Shear stiffness (2,): a force along d1 or d2 through the shear centre (N)."""
        return np.asarray(1 / self.moved(self.shear_centre).compliance.diagonal()[:2])

    @property
    def torsion_constant(self) -> float:
        """``GJ`` divided by the mean shear modulus of the material (m^4)."""
        return float(self.GJ * self.area / self.shear_moduli.diagonal().mean())

    @property
    def shear_factors(self) -> Floats:
        """(2,): ``GA`` divided by the shear stiffness of the material alone."""
        return np.asarray(self.GA / self.shear_moduli.diagonal())

    @property
    def principal_EI(self) -> tuple[Floats, float]:
        """Bending stiffnesses (2,), the larger first (N m^2), and the angle of its axis (rad).

        The angle is from d1 to the axis *about* which the section is stiffest, in (-pi/2, pi/2];
        zero if all axes are alike.
        """
        values, vectors = np.linalg.eigh(self.EI)
        axis = vectors[:, 1]
        if values[1] - values[0] <= 1e-9 * values[1]:
            return values[::-1], 0.0  # every axis is
        axis = axis * np.sign(axis[np.argmax(abs(axis) > 1e-12)])
        return values[::-1], float(np.arctan2(axis[1], axis[0]))

    def moved(self, origin: ArrayLike, angle: float = 0.0) -> ProfileConstants:
        """The same section about another line, and in turned axes.

        Parameters
        ----------
        origin : (2,) array
            Where the new line is, in the axes of these constants (m).
        angle : float
            From the axes d1, d2 of these constants to the new ones (rad).

        Examples
        --------
        >>> from skfem_cosserat import Material
        >>> from skfem_cosserat.profile import ProfileRectangle
        >>> about = ProfileRectangle(2.0, 1.0, Material(1.0, 0.0, 1.0)).constants(1e-2)
        >>> edge = about.moved((0, -0.5))
        >>> bool(np.isclose(edge.stiffness[3, 3], 2 / 3))          # 2 * 1**3 / 3
        True
        """
        item = "profile"
        o, turn = numbers(item, "origin", origin), numbers(item, "angle", angle)
        if o.shape != (2,) or turn.shape != () or not np.isfinite([*o, turn]).all():
            raise InputError(
                item, f"origin = {origin!r}, angle = {angle!r}, expected two numbers and one"
            )
        c, s = np.cos(turn), np.sin(turn)
        R = np.array([[c, s], [-s, c]])
        R3 = np.eye(3)
        R3[:2, :2] = R
        P = np.zeros((6, 6))
        P[:3, :3] = P[3:, 3:] = R3
        P[3:, :3] = -R3 @ _spin(o)
        D = P @ self.stiffness @ P.T

        def about(moments: Floats, weight: float, centre: Floats) -> Floats:
            mixed = weight * np.outer(o, centre)
            out = R @ (moments - mixed - mixed.T + weight * np.outer(o, o)) @ R.T
            return np.asarray((out + out.T) / 2)

        c, s = np.cos(self.angle), np.sin(self.angle)
        return replace(
            self,
            stiffness=(D + D.T) / 2,
            centroid=R @ (self.centroid - o),
            second_moments=about(self.second_moments, self.area, self.centroid),
            centre=R @ (self.centre - o),
            inertia=about(self.inertia, self.mass, self.centre),
            shear_moduli=R @ self.shear_moduli @ R.T,
            outline=(self.outline - o) @ R.T,
            origin=self.origin + np.array([[c, -s], [s, c]]) @ o,
            angle=self.angle + float(turn),
        )

    def section(self, viscosity: ArrayLike | None = None) -> Section:
        """The section of a beam along this line.

        Numbers that are zero to round-off are set to zero.

        Parameters
        ----------
        viscosity : (6, 6) or (6,) array, optional
            See :class:`~skfem_cosserat.Section`.
        """
        scale = np.sqrt(self.stiffness.diagonal())
        D = np.where(abs(self.stiffness) < 1e-11 * np.outer(scale, scale), 0, self.stiffness)
        own = np.sqrt(self.area)
        centre = np.where(abs(self.centre) < 1e-11 * own, 0, self.centre)
        inertia = self.inertia
        if abs(inertia[0, 1]) < 1e-11 * np.sqrt(inertia[0, 0] * inertia[1, 1]):
            inertia = inertia.diagonal()
        more = {"centre": centre} if centre.any() else {}
        return Section(D, self.mass, inertia, self.outline, viscosity, **more)

    def stresses(self, resultants: ArrayLike) -> tuple[Floats, Floats]:
        """Stresses in the material under the six resultants of the beam.

        Parameters
        ----------
        resultants : (6,) array
            ``(N_1, N_2, N_3, M_1, M_2, M_3)`` on the face with outward normal d3, about the
            origin and in the axes of these constants (N, N m).

        Returns
        -------
        points : (2, k) array
            Where, in the axes of these constants (m): the quadrature points of all elements.
        stresses : (6, k) array
            (11, 22, 33, 23, 13, 12) in the axes of these constants (N/m^2).

        Examples
        --------
        >>> from skfem_cosserat import Material
        >>> from skfem_cosserat.profile import ProfileRectangle
        >>> steel = Material(210e9, 0.3, 7850)
        >>> bar = ProfileRectangle(0.02, 0.04, steel).constants(1e-2)
        >>> x, stress = bar.stresses((0, 0, 0, 100.0, 0, 0))
        >>> bool(np.allclose(stress[2], 100 * x[1] / (0.02 * 0.04**3 / 12)))
        True
        """
        given = numbers("profile", "resultants", resultants)
        if given.shape != (6,) or not np.isfinite(given).all():
            raise InputError("profile", f"resultants = {given.tolist()}, expected six numbers")
        c, s = np.cos(self.angle), np.sin(self.angle)
        R = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        N = R.T @ given[:3]
        M = R.T @ given[3:] + _spin(self.origin) @ N
        stress = self.warping.stresses(np.concatenate([N, M])).reshape(6, -1)
        tensor = stress[[[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
        tensor = np.einsum("ia,abk,jb->ijk", R, tensor, R)
        points = np.reshape(self.warping.basis.global_coordinates(), (2, -1))
        turned = tensor[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
        return R[:2, :2] @ (points - self.origin[:, None]), turned

    def __str__(self) -> str:
        stiff, angle = self.principal_EI
        k = self.shear_factors

        def pair(values: Floats) -> str:
            own = 1e-11 * np.sqrt(self.area)
            return "  ".join(f"{0.0 if abs(x) < own else x:.6g}" for x in values)

        EI = self.EI
        rows = (
            ("area", f"{self.area:.6g}", "m^2"),
            ("centroid", pair(self.centroid), "m"),
            ("elastic centre", pair(self.elastic_centre), "m"),
            ("shear centre", pair(self.shear_centre), "m"),
            ("EA", f"{self.EA:.6g}", "N"),
            ("EI about d1, d2", f"{EI[0, 0]:.6g}  {EI[1, 1]:.6g}", "N m^2"),
            ("principal EI", f"{stiff[0]:.6g}  {stiff[1]:.6g}", "N m^2"),
            ("axis of the first", f"{np.degrees(angle):.4g}", "degrees from d1"),
            ("GJ", f"{self.GJ:.6g}", "N m^2"),
            ("torsion constant", f"{self.torsion_constant:.6g}", "m^4"),
            ("GA along d1, d2", f"{self.GA[0]:.6g}  {self.GA[1]:.6g}", "N"),
            ("shear factors", f"{k[0]:.6g}  {k[1]:.6g}", ""),
            ("mass", f"{self.mass:.6g}", "kg/m"),
            ("centre of mass", pair(self.centre), "m"),
            ("estimated error", f"{self.error:.1e}", f"with {self.elements} elements"),
        )
        return "\n".join(f"{name:<18}{value:<26}{unit}".rstrip() for name, value, unit in rows)
