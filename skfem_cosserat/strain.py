"""Strain measures of director beams as constant quadratic forms of an element's coordinates.

With directors interpolated like positions (113), every strain is a quadratic form of the
element's coordinates with constant coefficients, divided by the element length:

``eps_i = (1/2l) q_e . C_gi q_e``,  ``delta eps_i = (1/l) (C_gi q_e) . delta q_e``

(theory: Romero & Armero, IJNME 54 (2002) 1683; Betsch & Steinmann, IJNME 54 (2002) 1775). All
kernels follow from the one table ``C`` built here.
"""

from __future__ import annotations

import numpy as np

from .types import Floats

__all__ = ["strain_factors", "strain_table"]


def strain_table(shape: Floats, slope: Floats) -> Floats:
    """Coefficients ``C`` of the six strains at each Gauss point.

    ``Gamma_i = d_i . phi'`` and ``K_1 = (d3.d2' - d2.d3')/2`` and cyclic, prime = d/ds; the
    reference values are subtracted elsewhere.

    Parameters
    ----------
    shape, slope : (nn, ng) array
        Shape functions and their derivatives by the element coordinate on [0, 1].

    Returns
    -------
    (ng, 6, 12 nn, 12 nn) array
        Symmetric in the last two axes. Local order: ``12 a + c`` for node ``a``,
        ``c`` running over ``(phi, d1, d2, d3)``.

    Examples
    --------
    >>> C = strain_table(np.array([[.5], [.5]]), np.array([[-1.], [1.]]))
    >>> q = np.zeros((2, 4, 3)); q[:, 1:] = np.eye(3); q[1, 0] = (0, 0, 2.)
    >>> (q.ravel() @ C[0] @ q.ravel() / 2 / 2.0).tolist()       # length 2: d3 . phi' = 1
    [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    """
    nn, ng = shape.shape
    scalar = np.zeros((ng, 6, nn, 4, nn, 4))
    for g in range(ng):
        N, dN = shape[:, g], slope[:, g]
        product = np.outer(N, dN)
        wedge = (product - product.T) / 2
        for i in range(3):
            # Gamma_i = d_{i+1} . phi'
            scalar[g, i, :, i + 1, :, 0] += product
            scalar[g, i, :, 0, :, i + 1] += product.T
            # K_i = (d_k . d_j' - d_j . d_k')/2 with (i, j, k) cyclic
            j, k = (i + 1) % 3 + 1, (i + 2) % 3 + 1
            scalar[g, 3 + i, :, k, :, j] += wedge
            scalar[g, 3 + i, :, j, :, k] += wedge.T
    table = np.einsum("giaubv,cd->giaucbvd", scalar, np.eye(3))
    return np.ascontiguousarray(table.reshape(ng, 6, 12 * nn, 12 * nn))


def strain_factors(table: Floats) -> tuple[Floats, Floats]:
    """Shape functions and slopes (ng, nn) from which :func:`strain_table` made a table.

    Examples
    --------
    >>> shape, slope = strain_factors(strain_table(np.array([[.5], [.5]]), np.array([[-1.], [1.]])))
    >>> shape.tolist(), slope.tolist()
    ([[0.5, 0.5]], [[-1.0, 1.0]])
    """
    ng, _, k, _ = table.shape
    nn = k // 12
    # Gamma_1 = d1 . phi': products N_a dN_b, and the N_a add up to one
    product = table.reshape(ng, 6, nn, 4, 3, nn, 4, 3)[:, 0, :, 1, 0, :, 0, 0]
    slope = product.sum(1)
    shape = np.einsum("gab,gb->ga", product, slope) / (slope**2).sum(1)[:, None]
    return shape, slope
