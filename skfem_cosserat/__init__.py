"""Geometrically exact (Cosserat) beams and flexible multibody dynamics for scikit-fem.

Public names stand in ``__init__.pyi``, each with the module that it comes from. What a name needs
is imported when it is first asked for: a scene of rigid bodies needs no meshes.
"""

import lazy_loader as _lazy

from . import version as _version

_attached, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
__version__ = _version.VERSION
_ANSWER = "answer(model, quantities, tolerance, until)"
#: names of older versions, and what to take instead
_GONE = {
    "Asynchronous": "Explicit(rounds=...), whose steps are those of the stiffest element",
    "Adapted": f"{_ANSWER}, which finds the mesh, too",
    "Advice": f"{_ANSWER} and its simpler()",
    "StepAdvice": f"{_ANSWER}, which finds the step, too",
    "SolverMetis": "SolverSuperLU(), or SolverPardiso() for large lattices",
    "adapt": f"{_ANSWER}, which finds the mesh, too",
    "advise": f"{_ANSWER} and its simpler()",
    "advise_step": f"{_ANSWER}, which finds the step, too",
}


def __getattr__(name: str) -> object:
    if name in _GONE:
        raise AttributeError(f"skfem_cosserat.{name} is gone: take {_GONE[name]}")
    return _attached(name)
