"""Histories of runs: arrays over the recorded states, in memory or in a file.

A `History` holds numbers and names: export, charts and studies can read a run that was made on
another computer, by another version, or that was killed. Series that follow from the states are
derived by formulas that a run gives to its history, when they are first asked for.
Where a point is, a history says of places that it is given, by the names of their items.
"""

from .container import (
    History as History,
    SensorRecord as SensorRecord,
    Spectrum as Spectrum,
    spectrum as spectrum,
)
from .file import EventRecord as EventRecord, read_meta as read_meta
from .writer import HistoryWriter as HistoryWriter
