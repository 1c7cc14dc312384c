"""Tables 1 and 2 and figures 19 to 25 of Leyendecker, Marsden & Ortiz, ZAMM 88 (2008) 677.

One command makes every table and figure as PNG and CSV with provenance, and ``report.md`` with
each published number beside the computed one and a remark::

    python examples/reproduce_paper.py --out paper_results [--quick]
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: threads blur the timings

import argparse
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

from benchmarks.record import Record
from paper import charts, convergence, figures, report, tables
from skfem_cosserat.export import prepare_folder


def main(out: str | Path, quick: bool = False) -> dict[str, Any]:
    """Compute all numbers, write pictures, tables and the report.

    Parameters
    ----------
    out : path
        Folder, made if it does not exist.
    quick : bool
        Fewer timings, shorter runs, fewer steps of the stiff scene.

    Returns
    -------
    dict
        ``table 1``, ``table 2`` (see ``paper/tables.py``), ``figures`` (``paper/figures.py``),
        ``convergence`` (``paper/convergence.py``), each with its ``run``; ``runs`` and
        ``provenance``; ``paths`` written.
    """
    if not isinstance(out, str | Path):
        raise ValueError(f"out = {out!r}, expected a folder")
    folder = Path(out)
    prepare_folder(folder)  # before minutes of work, not after them
    record = Record()
    jobs = {
        "table 1": ("table 1: six-body linkage", tables.table_1),
        "table 2": ("table 2: three-bar swing", tables.table_2),
        "figures": ("figures 19 to 24", figures.main),
        "convergence": ("figure 25", convergence.main),
    }
    result: dict[str, Any] = {}
    for key, (title, job) in jobs.items():
        with record.run(f"{title}{', quick' if quick else ''}") as number:
            result[key] = job(quick)
        result[key]["run"] = number
    paths = charts.main(result["figures"], result["convergence"], folder, record)
    paths += report.main(result, folder, record)
    return result | {"runs": record.runs, "provenance": record.provenance, "paths": paths}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", default="paper_results", help="folder for all files")
    parser.add_argument("--quick", action="store_true", help="under three minutes on two cores")
    arguments = parser.parse_args()
    try:
        made = main(arguments.out, arguments.quick)
    except ValueError as error:
        parser.error(str(error))
    for run in made["runs"]:
        print(f"{run['title']}: {run['seconds']:.1f} s")
    print(f"{len(made['paths'])} files; read {Path(arguments.out) / 'report.md'}")
