"""Asynchronous variational integrator: a step of its own for every element."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from ..constraints import Treatment
from ..errors import InputError
from ..log import logger
from ..model import System
from ..types import Floats, IndexArray, numbers, positive, real, switch
from .explicit import ExplicitScheme
from .limit import check_lumped, element_limits
from .march import Marching, check_scene

__all__ = ["Asynchronous"]


class Asynchronous(ExplicitScheme):
    """The explicit scheme with a step of its own for every element.

    A priority queue says which element kicks its nodes next; in between, every node drifts as a
    free rigid body from one kick of its elements to the next. Elements take the fewest equal parts
    of the run's step that are below `safety` times their own limit, so that all meet at its end,
    where the loads kick and states are recorded. Momentum maps are exact; energy stays within a
    bound, short of resonances: where the fast vibrations next to a slow element meet its rhythm,
    it feeds them. Steps that change little by little prevent that. The limits of elements are
    looked at again as these bend, and steps are made shorter where they have fallen, with a
    warning: the energy may change a little there.

    Of second order if `safety` gets smaller with the step: all elements then keep their numbers of
    steps. With the same `safety` only the longest steps get shorter, those of the fast elements
    stay, and so does what they leave of the error.

    Parameters
    ----------
    safety : float
        Largest step of an element by its limit, in (0, 1].
    grading : float
        Largest ratio of the steps of two elements that share a node; infinite: any.
    checked : bool
        False: `safety` may be above one, to see what happens there.

    Raises
    ------
    InputError
        If `safety` or `grading` is not in its range.
    IncompatibleError
        As :class:`Explicit`, before the run.

    Notes
    -----
    Loads kick at the ends of the run's steps only: choose these accordingly.

    Examples
    --------
    A rod of which a quarter is meshed eight times as finely:

    >>> from skfem_cosserat import Beam, Material, MeshCurve, Model, SectionCircle
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0.75, 0, 0), 3, name="coarse")
    >>> mesh = mesh + MeshCurve.init_line((0.75, 0, 0), (1, 0, 0), 8, name="fine")
    >>> section = SectionCircle(0.2, Material(5e6, 0.5, 1100))
    >>> model = Model()
    >>> rod = model.add("rod", Beam(mesh, section, director=(0, 1, 0), lumped=True))
    >>> Asynchronous(safety=1.0).counts(model.freeze(), 3.7e-3)[0].tolist()
    [1, 2, 4, 8, 8, 8, 8, 8, 8, 8, 8]
    """

    name = "asynchronous"
    reference = "Lew, Marsden, Ortiz & West, Arch. Ration. Mech. Anal. 167 (2003) 85"

    def __init__(self, safety: float = 0.9, grading: float = 2.0, checked: bool = True) -> None:
        self.checked = switch("argument checked", checked)
        expected = "a number in (0, 1]" if checked else "a positive finite number"
        self.safety = real("argument safety", "safety", safety, expected)
        if not 0 < self.safety <= (1 if checked else np.finfo(float).max):
            raise InputError("argument safety", f"{safety!r}, expected {expected}")
        expected = "a number of one or more"
        self.grading = real("argument grading", "grading", grading, expected)
        if not self.grading >= 1:
            raise InputError("argument grading", f"{grading!r}, expected {expected}")

    def __repr__(self) -> str:
        more = "" if self.checked else ", checked=False"
        return f"Asynchronous(safety={self.safety:g}, grading={self.grading:g}{more})"

    @staticmethod
    def limits(system: System) -> list[Floats]:
        """Largest stable step (ne,) in s of the elements of each beam group.

        Raises
        ------
        InputError
            If it is no system.
        IncompatibleError
            If the mass of a beam is not lumped.
        """
        return element_limits(system)

    def counts(
        self, system: System, step: float, limits: list[Floats] | None = None
    ) -> list[IndexArray]:
        """Steps (ne,) of the elements of each beam group in a step (s) of the run.

        Parameters
        ----------
        limits : list of arrays, optional
            Default: :meth:`limits`.

        Raises
        ------
        InputError
            For other arguments.
        IncompatibleError
            If the mass of a beam is not lumped.
        """
        step = positive("argument step", "step", step, " of seconds")
        chosen = self.limits(system) if limits is None else _checked(system, limits)
        counts = [
            np.maximum(1, np.ceil(step / (self.safety * each) * (1 - 1e-12))).astype(np.int64)
            for each in chosen
        ]
        while True:
            most = np.zeros(len(system.origin_rows), dtype=np.int64)
            for group, own in zip(system.beam_groups, counts, strict=True):
                np.maximum.at(most, group.vertices, own[:, None])
            least = [np.ceil(most[g.vertices].max(1) / self.grading) for g in system.beam_groups]
            graded = [
                np.maximum(own, each.astype(np.int64))
                for own, each in zip(counts, least, strict=True)
            ]
            if all((a == b).all() for a, b in zip(graded, counts, strict=True)):
                return counts
            counts = graded

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
        plan = partial(self.counts, system, h) if self.checked else None
        return Marching(self.name, system, h, 1, counts, method, kernels, steps, plan)


def _checked(system: System, limits: object) -> list[Floats]:
    """Limits of the elements of each beam group, as given."""
    check_lumped("steps of the elements", system)
    sizes = [len(group.vertices) for group in system.beam_groups]
    expected = f"expected positive numbers (s) of {sizes} elements, as limits(system) gives them"
    if not isinstance(limits, Sequence) or len(limits) != len(sizes):
        raise InputError("argument limits", f"{limits!r}, {expected}")
    out = [numbers("argument limits", "limits", each) for each in limits]
    if any(each.shape != (n,) or not (each > 0).all() for each, n in zip(out, sizes, strict=True)):
        raise InputError("argument limits", f"{limits!r}, {expected}")
    return out
