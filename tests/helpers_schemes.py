"""All implicit schemes, for tests that are to hold for each, or for those with a property."""

from __future__ import annotations

import pytest

import skfem_cosserat as sc

#: what most tests run with, by objects
INTEGRATORS = (sc.Variational(), sc.EnergyMomentum())
TREATMENTS = (sc.NullSpace(), sc.Multipliers())
integrators = pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda each: each.name)
treatments = pytest.mark.parametrize("treatment", TREATMENTS, ids=lambda each: each.name)

SCHEMES: tuple[sc.Integrator, ...] = (
    sc.Variational(),
    sc.Variational(stabilized=True),
    sc.EnergyMomentum(),
    sc.EnergyMomentum(stabilized=True),
    sc.EnergyDecaying(0.1),
    sc.EnergyDecaying(rate=1.0, stabilized=True),
    sc.GeneralizedAlpha(0.8),
    sc.GeneralizedAlpha(0.8, stabilized=False),
    sc.Composition(sc.Variational(), 4),
    sc.Composition(sc.EnergyMomentum()),
)
#: the first one of each class
KINDS = tuple(s for k, s in enumerate(SCHEMES) if type(s) not in map(type, SCHEMES[:k]))


def stabilized(scheme: sc.Integrator) -> bool:
    """Whether its velocities fulfil the hidden constraints."""
    return bool(getattr(scheme, "stabilized", False))


def compiled(scheme: sc.Integrator) -> bool:
    """Whether its own steps have compiled kernels; a composition's are those of its part."""
    return scheme.part is None
