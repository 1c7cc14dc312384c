"""Three-dimensional elasticity of what a profile is made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..errors import InputError
from ..section import Material
from ..types import ArrayLike, Floats, numbers, positive

__all__ = ["MaterialAnisotropic", "elasticity"]

#: Pairs of axes in Voigt's order (11, 22, 33, 23, 13, 12).
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def _checked(item: str, value: ArrayLike) -> Floats:
    """Finite, symmetric, positive definite (6, 6)."""
    C = numbers(item, "elasticity", value)
    if C.shape != (6, 6):
        raise InputError(item, f"elasticity has shape {C.shape}, expected (6, 6)")
    if not np.isfinite(C).all():
        raise InputError(item, f"elasticity is not finite: {C.tolist()}")
    if not np.allclose(C, C.T, rtol=1e-9, atol=1e-12 * abs(C).max()):
        raise InputError(item, f"elasticity is not symmetric by {abs(C - C.T).max():.3g}")
    lowest, highest = np.linalg.eigvalsh((C + C.T) / 2)[[0, -1]]
    if lowest <= 1e-12 * highest:
        raise InputError(
            item, f"elasticity is not positive definite: its lowest eigenvalue is {lowest:.3g}"
        )
    return np.asarray((C + C.T) / 2)


@dataclass(frozen=True, eq=False)
class MaterialAnisotropic:
    """Linear elastic material without any symmetry.

    Parameters
    ----------
    elasticity : (6, 6) array
        ``C`` (N/m^2) with ``stress = C strain`` in Voigt's order (11, 22, 33, 23, 13, 12), shear
        strains doubled; axis 3 is along the beam, axes 1 and 2 are those of the section.
    rho : float
        Density (kg/m^3).

    Raises
    ------
    InputError
        If the elasticity is not finite, symmetric and positive definite.

    Examples
    --------
    >>> MaterialAnisotropic(1e9 * np.eye(6), rho=1600.0).elasticity.shape
    (6, 6)
    """

    elasticity: Floats = field(repr=False)
    rho: float

    def __init__(self, elasticity: ArrayLike, rho: float) -> None:
        object.__setattr__(self, "elasticity", _checked("material", elasticity))
        object.__setattr__(self, "rho", positive("material", "rho", rho))

    @classmethod
    def orthotropic(
        cls, E: Sequence[float], G: Sequence[float], nu: Sequence[float], rho: float
    ) -> MaterialAnisotropic:
        """Material with three planes of symmetry, those of the section's axes.

        Parameters
        ----------
        E : (E_1, E_2, E_3)
            Young's moduli (N/m^2); ``E_3`` along the beam.
        G : (G_23, G_13, G_12)
            Shear moduli (N/m^2).
        nu : (nu_23, nu_13, nu_12)
            Poisson's ratios, ``nu_ij = -strain_j / strain_i`` under tension along i; so
            ``nu_ji = nu_ij E_j / E_i``.
        rho : float
            Density (kg/m^3).

        Examples
        --------
        >>> ply = MaterialAnisotropic.orthotropic(
        ...     (9e9, 9e9, 140e9), (4e9, 5e9, 5e9), (0.02, 0.02, 0.3), 1600.0)
        >>> bool(np.isclose(1 / np.linalg.inv(ply.elasticity)[2, 2], 140e9))
        True
        """
        item = "material"
        given = {"E": E, "G": G, "nu": nu}
        for name, value in given.items():
            if np.shape(value) != (3,):
                raise InputError(item, f"{name} = {value!r}, expected three numbers")
        moduli, shear, ratio = (numbers(item, name, value) for name, value in given.items())
        for name, values in (("E", moduli), ("G", shear)):
            if not (np.isfinite(values).all() and (values > 0).all()):
                raise InputError(item, f"{name} = {values.tolist()}, expected positive numbers")
        compliance = np.diag(np.concatenate([1 / moduli, 1 / shear]))
        for (i, j), value in zip(VOIGT[3:], ratio, strict=True):
            compliance[i, j] = compliance[j, i] = -value / moduli[i]
        if not np.isfinite(compliance).all() or np.linalg.eigvalsh(compliance)[0] <= 0:
            raise InputError(
                item,
                f"nu = {ratio.tolist()} is too large for E = {moduli.tolist()}: some strain"
                " would give back energy",
            )
        return cls(np.linalg.inv(compliance), rho)

    def rotated(self, rotation: ArrayLike) -> MaterialAnisotropic:
        """The same material, turned.

        Parameters
        ----------
        rotation : (3, 3) array
            Its columns are the material's old axes after the turn, in the section's axes.

        Examples
        --------
        Fibres along the beam, turned to 30 degrees in the plane of the axes 1 and 3:

        >>> ply = MaterialAnisotropic.orthotropic(
        ...     (9e9, 9e9, 140e9), (4e9, 5e9, 5e9), (0.02, 0.02, 0.3), 1600.0)
        >>> c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
        >>> off = ply.rotated([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        >>> bool(abs(off.elasticity[2, 4]) > 1e9)              # tension shears it
        True
        """
        Q = numbers("material", "rotation", rotation)
        if Q.shape != (3, 3) or not np.allclose(Q.T @ Q, np.eye(3), atol=1e-9):
            raise InputError("material", f"rotation = {Q.tolist()} is no (3, 3) rotation")
        T = np.empty((6, 6))  # stress_new = T stress_old
        for row, (i, j) in enumerate(VOIGT):
            for column, (k, m) in enumerate(VOIGT):
                T[row, column] = Q[i, k] * Q[j, m] + (Q[i, m] * Q[j, k] if k != m else 0.0)
        return MaterialAnisotropic(T @ self.elasticity @ T.T, self.rho)


def elasticity(material: Material | MaterialAnisotropic) -> Floats:
    """Elasticity ``C`` (6, 6) in N/m^2, Voigt's order (11, 22, 33, 23, 13, 12).

    Raises
    ------
    InputError
        If it is no material, or nearly incompressible (``nu > 0.495``).

    Examples
    --------
    >>> elasticity(Material(E=1.0, nu=0.0, rho=1.0)).diagonal().tolist()
    [1.0, 1.0, 1.0, 0.5, 0.5, 0.5]
    """
    if isinstance(material, MaterialAnisotropic):
        return material.elasticity
    if not isinstance(material, Material):
        raise InputError(
            "profile", f"material = {material!r}, expected a Material or MaterialAnisotropic"
        )
    if material.nu > 0.495:
        raise InputError(
            "profile",
            f"nu = {material.nu!r}: warping of a material that keeps its volume is not solved;"
            " take nu = 0.495 at most",
        )
    C = np.zeros((6, 6))
    C[:3, :3] = 2 * material.G * material.nu / (1 - 2 * material.nu)
    C[range(6), range(6)] += material.G * np.array([2, 2, 2, 1, 1, 1])
    return C
