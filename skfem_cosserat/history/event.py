"""What a history keeps of an event."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["EventRecord"]


class EventRecord(NamedTuple):
    """An event of a run.

    Attributes
    ----------
    time : float
        (s)
    name : str
    value : float
        What its condition gave there, beyond zero by what its time is located to.
    row : int
        The recorded state, before what the event does; where the scene or the state has changed
        the next row has the same time and is the state after it.
    step : int
        Number of the step, a shortened one, that ends there.
    loss : float
        Energy (J) that it took out of the scene.
    action : str
        What it did.

    Examples
    --------
    >>> print(EventRecord(0.25, "catch", 1e-13, 26, 26, 0.5, "ActionLock(knee)"))
    t = 0.25 s: 'catch', ActionLock(knee), takes 0.5 J
    """

    time: float
    name: str
    value: float
    row: int
    step: int
    loss: float
    action: str

    def __str__(self) -> str:
        lost = f", takes {self.loss:.6g} J" if self.loss else ""
        return f"t = {self.time:.9g} s: {self.name!r}, {self.action}{lost}"
