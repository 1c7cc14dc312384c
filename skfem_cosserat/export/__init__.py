"""Files for other programs, made from a history: ParaView series and tables."""

from __future__ import annotations

from .paraview import ParaViewWriter, prepare_folder, write_paraview
from .table import write_csv

__all__ = ["ParaViewWriter", "prepare_folder", "write_csv", "write_paraview"]
