"""Theories: which strains of a beam are modelled, and which are held at their reference values.

Each theory leaves out motions that a scene may not need, with their frequencies and unknowns:

``rigid < inextensible (and unshearable) < Kirchhoff (unshearable) < Reissner (full)``.

Strains are held at the Gauss points of each element, p of them for an element of order p: there are
as many as the nodes can follow. With one point more elements lock, with one fewer they have motions
that strain nothing. What holds them are constraint forces: their multipliers are the stress
resultants.

Each takes both treatments. With the null space method, too, what is held has multipliers, at a cost
linear in the number of elements; rigid elements move like bodies. On closed loops held strains are
eliminated, which fills the matrix: with plain kernels it is for tens of elements there.
"""

from __future__ import annotations

import numpy as np

from .frozen import Frozen
from .law import Law
from .types import Array, Floats, switch

SOURCE = "Antman, Nonlinear Problems of Elasticity, 2nd ed. (2005), chapter 8"


class Theory(Frozen):
    """Base of beam theories, each with the strains of a beam that it models; see the subclasses.

    Parameters
    ----------
    torsion : bool
        Whether the beam can be twisted. Without, K_3 keeps its reference value: for beams that
        nothing twists, such as those of a plane scene. Not for beams whose ends are both held
        against rotation about their line, nor for closed rings: there, no small motion out of the
        plane leaves them untwisted. They are refused, unless they are confined to the plane.

    Attributes
    ----------
    held : tuple of int
        Numbers of the strains ``(Gamma_1, Gamma_2, Gamma_3, K_1, K_2, K_3)`` that are held.
    """

    held: tuple[int, ...]
    reference = SOURCE
    _forces: tuple[int, ...] = ()

    def __init__(self, torsion: bool = True):
        self.torsion = switch("theory", torsion, "torsion")
        self.held = self._forces if self.torsion else (*self._forces, 5)

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and vars(other) == vars(self)

    def __hash__(self) -> int:
        return hash((type(self), self.torsion))


class TheoryReissner(Theory):
    """All six strains: shear, extension, bending, torsion (Simo & Reissner). The default.

    Examples
    --------
    >>> TheoryReissner().held, TheoryReissner(torsion=False).held
    ((), (5,))
    """


class TheoryKirchhoff(Theory):
    """Cross sections stay normal to the line: Gamma_1 = Gamma_2 = 0 (Kirchhoff, extensible).

    Leaves out shear waves, whose frequencies grow as 1/h without bound: rotations of nodes against
    the line. Valid where shear strains are small against bending, that is for slender beams: the
    error is of the order of ``EI/(GA L^2)``. Axial waves stay.

    Examples
    --------
    >>> TheoryKirchhoff().held
    (0, 1)
    """

    _forces = (0, 1)


class TheoryInextensible(Theory):
    """Neither shear nor extension: Gamma = 0. Kirchhoff's inextensible rod, Euler's elastica.

    Leaves out axial waves, too. Valid where no strain but that of bending and torsion matters: the
    errors are of the order of ``EI/(GA L^2)`` and ``EI/(EA L^2)``. A straight beam held at both
    ends cannot bend at all, since its ends would have to approach each other: such scenes are
    refused; :class:`TheoryKirchhoff` is for that.

    Examples
    --------
    >>> TheoryInextensible().held
    (0, 1, 2)
    """

    _forces = (0, 1, 2)


class TheoryRigid(Theory):
    """No strain at all: the beam moves as one piece.

    With the null space method it has the six unknowns of a body and exactly the inertia of the
    beam it replaces; joints, loads, sensors and pictures keep their places on it, and its section
    forces are multipliers. Its nodes keep their coordinates: where speed is what counts,
    :meth:`Beam.rigid_body` gives the same body as one node. Valid where all frequencies of the
    beam are far above those of interest; errors are of the order of one over its stiffness.

    Examples
    --------
    >>> TheoryRigid().held
    (0, 1, 2, 3, 4, 5)
    """

    _forces = (0, 1, 2, 3, 4, 5)

    def __init__(self) -> None:
        super().__init__()

    def __repr__(self) -> str:
        return "TheoryRigid()"


def released(matrices: Floats, held: tuple[int, ...]) -> Floats:
    """Section matrices (..., 6, 6) without what belongs to strains that are held."""
    out = matrices.copy()
    out[..., list(held), :] = 0
    out[..., :, list(held)] = 0
    return out


class LawHeld(Law):
    """A stored energy of which some strains are held: forces against these are multipliers.

    Parameters
    ----------
    law : Law
    held : tuple of int
        Numbers of strains.
    """

    def __init__(self, law: Law, held: tuple[int, ...]):
        # what measures increments: without forces against strains that are held
        own = np.isin(np.arange(6), held) * np.diag(law.stiffness)
        super().__init__(released(law.stiffness, held) + np.diag(own))
        self.law, self.held, self.noise = law, held, law.noise
        self._free = np.ones(6)
        self._free[list(held)] = 0

    def energy(self, eps: Array) -> Array:
        """W (...) in J/m of the strains that are free."""
        return self.law.energy(eps * self._free)

    def stress(self, eps: Array) -> Array:
        """``dW/d eps`` (..., 6) of the free strains; zero for those that are held."""
        return self.law.stress(eps * self._free) * self._free

    def beside(self, mean: Array, d: Array) -> tuple[Array, Array]:
        """Stress of the mean strain and derivatives of W beside it, both of the free strains."""
        stress, along = self.law.beside(mean * self._free, d * self._free)
        return stress * self._free, along

    def tangent(self, eps: Array) -> Array:
        """Second derivative (..., 6, 6) by the free strains; zero for those that are held."""
        return released(np.asarray(self.law.tangent(eps * self._free)), self.held)
