"""Errors of the package: each says which item, which value came, and what was expected."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # pragma: no cover - for annotations only: errors is the lowest layer
    from typing import Any


class CosseratError(Exception):
    """Base of all errors raised by skfem_cosserat."""


class InputError(CosseratError, ValueError):
    """Bad input, found before any work starts.

    Parameters
    ----------
    item : str
        What the error is about, e.g. ``"beam 'boom'"`` or ``"argument step"``.
    message : str
        What came (the value), what was expected and, where possible, what to do.
    """

    def __init__(self, item: str, message: str) -> None:
        self.item = item
        super().__init__(f"{item}: {message}")


class MeshError(InputError):
    """A mesh that cannot carry beams (no lines, zero-length elements, unknown names)."""


class HistoryError(InputError):
    """A history file that is not ours, cut short, or does not belong to the model."""


class IncompatibleError(InputError):
    """Two choices that do not work together; both are named."""


class Diverged(CosseratError, RuntimeError):
    """A time step could not be solved; everything computed up to it is kept.

    Attributes
    ----------
    time : float
        Time at the start of the failed step (s): the last state that is valid.
    step : int
        Number of the failed step (the first step has number 1).
    residual : float
        Smallest scaled residual that was reached.
    history : object or None
        The history up to the failed step, filled in by ``simulate``.
    """

    def __init__(self, time: float, step: int, residual: float, reason: str, advice: str) -> None:
        self.time = time
        self.step = step
        self.residual = residual
        self.reason = reason
        self.advice = advice
        self.history: Any = None
        super().__init__(
            f"step {step} from t = {time:.9g} s could not be solved: {reason}"
            f" (scaled residual {residual:.3g}); {advice}"
        )
