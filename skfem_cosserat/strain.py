"""Strain measures of director beams: the one place that says what they are.

A section has four fields ``x = (phi, d1, d2, d3)``, its place and its directors. Each strain is a
sum of products ``factor x_a . x_b'`` of a field and the slope of a field, prime = d/ds:

``Gamma_i = d_i . phi'``,  ``K_i = (d_k . d_j' - d_j . d_k')/2``,  (i, j, k) cyclic,

less its value in the reference, which is subtracted elsewhere. :data:`FORMS` is this table. With
directors interpolated like positions (113) every strain is a quadratic form of the coordinates q_e
of an element with constant coefficients C, divided by the length l of the element:

``eps = (1/2l) q_e . C q_e``,  ``delta eps = (1/l) (C q_e) . delta q_e``

and ``C/l`` is its second derivative: :func:`strain_table` makes C from the table. Theory: Romero &
Armero, IJNME 54 (2002) 1683; Betsch & Steinmann, IJNME 54 (2002) 1775.

Who needs strains reads one of the two. Compiled kernels have formulas of their own, written out for
speed; ``tests/compiled/test_compiled_strains.py`` holds them against the table.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .types import Array, Floats

#: products (a, b, factor) whose sum ``factor x_a . x_b'`` is a strain
Form = tuple[tuple[int, int, float], ...]

#: (Gamma_1, Gamma_2, Gamma_3, K_1, K_2, K_3) by the fields (phi, d1, d2, d3)
FORMS: tuple[Form, ...] = (
    ((1, 0, 1.0),),
    ((2, 0, 1.0),),
    ((3, 0, 1.0),),
    ((3, 2, 0.5), (2, 3, -0.5)),
    ((1, 3, 0.5), (3, 1, -0.5)),
    ((2, 1, 0.5), (1, 2, -0.5)),
)


def strain_measures(fields: Array, slopes: Array, which: Sequence[int] = range(6)) -> Array:
    """Strains of sections, without the reference's taken off.

    Parameters
    ----------
    fields, slopes : (..., 4, 3) array
        ``phi, d1, d2, d3`` and their derivatives by the arc length.
    which : sequence of int
        Numbers of strains.

    Returns
    -------
    (..., len(which)) array

    Examples
    --------
    >>> fields, slopes = np.zeros((2, 4, 3))
    >>> fields[1:], slopes[0] = np.eye(3), (0, 0, 2.0)
    >>> strain_measures(fields, slopes).tolist()       # d3 . phi' = 2
    [0.0, 0.0, 2.0, 0.0, 0.0, 0.0]
    """
    each = [
        sum(factor * (fields[..., a, :] * slopes[..., b, :]).sum(-1) for a, b, factor in FORMS[i])
        for i in which
    ]
    return np.stack(each, -1)


def strain_table(shape: Floats, slope: Floats) -> Floats:
    """Coefficients ``C`` of the six strains at each Gauss point.

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
    products = np.einsum("ug,vg->guv", shape, slope)
    scalar = np.zeros((ng, 6, nn, 4, nn, 4))
    for i, form in enumerate(FORMS):
        for a, b, factor in form:
            scalar[:, i, :, a, :, b] += factor * products
            scalar[:, i, :, b, :, a] += factor * products.swapaxes(1, 2)
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
    return np.einsum("gab,gb->ga", product, slope) / (slope**2).sum(1)[:, None], slope
