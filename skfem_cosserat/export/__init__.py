"""Files for other programs, made from a history: ParaView series and tables; files of rows."""

from .paraview import (
    ParaViewWriter as ParaViewWriter,
    prepare_folder as prepare_folder,
    write_paraview as write_paraview,
)
from .table import write_csv as write_csv, write_rows as write_rows
