"""Files for other programs, made from a history: ParaView series and tables; files of rows."""

from __future__ import annotations

from .paraview import ParaViewWriter, prepare_folder, write_paraview
from .table import write_csv, write_rows

__all__ = ["ParaViewWriter", "prepare_folder", "write_csv", "write_paraview", "write_rows"]
