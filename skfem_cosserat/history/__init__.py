"""What a simulation leaves behind: arrays over the recorded states, in memory or in a file.

A `History` holds numbers and names only. It knows no model and no solver, so export, charts and
studies can read a run that was made on another computer, by another version, or that was killed.
"""

from __future__ import annotations

from .container import History
from .event import EventRecord
from .file import read_meta
from .sensor import SensorRecord, Spectrum, spectrum
from .writer import HistoryWriter

__all__ = [
    "EventRecord",
    "History",
    "HistoryWriter",
    "SensorRecord",
    "Spectrum",
    "read_meta",
    "spectrum",
]
