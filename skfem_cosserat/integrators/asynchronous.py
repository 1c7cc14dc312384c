"""Asynchronous variational integrator: a step of its own for every element."""

from __future__ import annotations

import numpy as np

from ..constraints import Treatment
from ..errors import InputError
from ..log import logger
from ..model import System
from ..types import Floats, IndexArray, numbers
from .explicit import ExplicitScheme
from .limit import element_limits
from .march import Marching, check_scene

__all__ = ["Asynchronous"]


class Asynchronous(ExplicitScheme):
    """The explicit scheme with a step of its own for every element.

    A priority queue says which element kicks its nodes next; in between, every node drifts as a
    free rigid body from one kick of its elements to the next. Elements take the fewest equal parts
    of the run's step that are below `safety` times their own limit, so that all meet at its end,
    where the loads kick and states are recorded. Momentum maps are exact; energy stays within a
    bound unless a ratio of steps meets a resonance.

    Parameters
    ----------
    safety : float
        Largest step of an element by its limit, in (0, 1].
    checked : bool
        False: `safety` may be above one, to see what happens there.

    Raises
    ------
    InputError
        If `safety` is not in its range.
    IncompatibleError
        As :class:`Explicit`, before the run.

    Notes
    -----
    Loads kick at the ends of the run's steps only: choose these accordingly.

    Examples
    --------
    A rod of which a quarter is meshed eight times as finely:

    >>> import numpy as np
    >>> from skfem_cosserat import Beam, Material, MeshCurve, Model, SectionCircle
    >>> x = np.concatenate([np.linspace(0, 0.75, 4)[:-1], np.linspace(0.75, 1, 9)])
    >>> points = np.column_stack([x, 0 * x, 0 * x])
    >>> mesh = MeshCurve.init_polyline(points, name="rod")
    >>> section = SectionCircle(0.2, Material(5e6, 0.5, 1100))
    >>> model = Model()
    >>> rod = model.add("rod", Beam(mesh, section, director=(0, 1, 0), lumped=True))
    >>> Asynchronous(safety=1.0).counts(model.freeze(), 3.7e-3)[0].tolist()
    [1, 1, 1, 8, 8, 8, 8, 8, 8, 8, 8]
    """

    name = "asynchronous"
    reference = "Lew, Marsden, Ortiz & West, Arch. Ration. Mech. Anal. 167 (2003) 85"

    def __init__(self, safety: float = 0.8, checked: bool = True) -> None:
        value = numbers("argument safety", "safety", safety)
        if value.shape != () or not 0 < value <= (1 if checked else np.inf):
            raise InputError("argument safety", f"{safety!r}, expected a number in (0, 1]")
        self.safety, self.checked = float(value), bool(checked)

    def __repr__(self) -> str:
        return f"Asynchronous(safety={self.safety:g}{'' if self.checked else ', checked=False'})"

    def counts(self, system: System, step: float) -> list[IndexArray]:
        """Steps (ne,) of the elements of each beam group in a step (s) of the run."""
        limits: list[Floats] = element_limits(system)
        return [
            np.maximum(1, np.ceil(step / (self.safety * each) * (1 - 1e-12))).astype(np.int64)
            for each in limits
        ]

    def march(
        self, system: System, treatment: Treatment, h: float, kernels: str, steps: int | None
    ) -> Marching:
        """See the base class."""
        check_scene(repr(self), system, treatment)
        limit, counts = self.limit(system), self.counts(system, h)
        every = np.concatenate([*counts, np.zeros(0, dtype=np.int64)])
        low, high = int(every.min(initial=1)), int(every.max(initial=1))
        logger.info("steps of elements: %d to %d a step, smallest limit %s", low, high, limit)
        method = f"explicit, {low} to {high} steps of each element, smallest limit {limit}"
        return Marching(self.name, system, h, 1, counts, method, kernels, steps)
