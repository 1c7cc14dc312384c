"""What starting costs: importing, compiling on an empty cache, reading a full one.

*import*: of the package in a fresh process in which optional packages cannot be found; nothing is
compiled and numba is not imported even where it is there. *cold*: two steps with compiled kernels
on an empty cache, less two with the plain ones, in fresh processes, for each integrator, treatment
and order that has compiled kernels; *warm*: the same on the cache that this left; *other mesh*: as
warm with another number of elements, which compiles nothing.

Times by the clock on the wall, since compiling may use a second processor, with those of this
processor beside them; medians over `repeats` (one run on an empty cache: it takes seconds). Measure
on an idle machine.

Run ``python examples/benchmarks/cold_start.py --help`` for the choices.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

import measuring
from measuring import INTEGRATORS, TREATMENTS

from skfem_cosserat.integrators.choice import refusal

HERE = Path(__file__).resolve().parent
#: at most (s)
LIMITS = {"import": 1.0, "cold": 12.0, "warm": 0.5, "other mesh": 0.5}
OPTIONAL = ("numba", "matplotlib", "pyvista", "vtk", "exudyn", "pypardiso", "dask")
ELEMENTS, OTHER = 6, 9
COLUMNS = (
    *("measure", "integrator", "treatment", "order", "seconds", "cpu_s", "limit", "compiled"),
    *("new_files", "numba_imported"),
)

IMPORT = """
import json, os, sys, time
hidden = set(filter(None, os.environ["HIDDEN"].split(",")))
class Hide:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in hidden:
            raise ModuleNotFoundError(f"{name} is hidden", name=name)
sys.meta_path.insert(0, Hide())
begun = time.perf_counter(), time.process_time()
import skfem_cosserat
answer = {"seconds": time.perf_counter() - begun[0], "cpu_s": time.process_time() - begun[1]}
print(json.dumps({**answer, "numba_imported": "numba" in sys.modules}))
"""

#: two steps; what is compiled in them is counted, not what is read from the disk
STEPS = """
import json, sys, time
folder, integrator, treatment, order, elements, kernels = sys.argv[1:]
sys.path.insert(0, folder)
import measuring
import skfem_cosserat as sc
from skfem_cosserat.integrators import Stepper
system = measuring.chain(int(elements), int(order))
own = measuring.INTEGRATORS[integrator](), measuring.TREATMENTS[treatment]()
state = sc.initial_state(system)
before = "numba" in sys.modules
if kernels == "numba":
    from skfem_cosserat.compiled import kept
    there = set(kept.folder().glob("*.kernel"))
begun = time.perf_counter(), time.process_time()
compiled = []
stepper = Stepper(system, *own, 1e-3, kernels=kernels)
measuring.advance(stepper, state, 2)
answer = {"seconds": time.perf_counter() - begun[0], "cpu_s": time.process_time() - begun[1]}
if kernels == "numba":
    compiled = set(kept.folder().glob("*.kernel")) - there
print(json.dumps({**answer, "numba_imported": before, "compiled": len(compiled)}))
"""


def python(code: str, *arguments: Any, **variables: str) -> dict[str, Any]:
    """What a fresh process answers."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    source = str(HERE.parents[1])
    path = os.pathsep.join(filter(None, (source, os.environ.get("PYTHONPATH"))))
    new = {**os.environ, "PYTHONPATH": path, **variables}
    done = subprocess.run(command, capture_output=True, text=True, env=new, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def imports(repeats: int) -> list[dict[str, Any]]:
    """Without optional packages; and what importing does where they are."""
    with TemporaryDirectory() as cache:
        fresh = {"NUMBA_CACHE_DIR": cache}
        runs = [python(IMPORT, HIDDEN=",".join(OPTIONAL), **fresh) for _ in range(repeats)]
        full = python(IMPORT, HIDDEN="", **fresh)
        row = {"measure": "import", **medians(runs)}
        files = len(contents(cache))
    imported = full["numba_imported"]
    return [row | {"compiled": None, "new_files": files, "numba_imported": imported}]


def medians(runs: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Of both clocks."""
    return {name: median(run[name] for run in runs) for name in ("seconds", "cpu_s")}


def contents(folder: str) -> dict[str, int]:
    """Files in a folder, and when they were written."""
    return {str(p): p.stat().st_mtime_ns for p in Path(folder).rglob("*") if p.is_file()}


def quiet(folder: str) -> dict[str, int]:
    """The files once nobody has written any for a second: a helper may still be at it."""
    found, last = contents(folder), {}
    for _ in range(120):
        if found == last:
            break
        time.sleep(1.0)
        found, last = contents(folder), found
    return found


def starts(integrator: str, treatment: str, order: int, repeats: int) -> list[dict[str, Any]]:
    """On an empty cache, a full one, and with another mesh."""
    own = (HERE, integrator, treatment, order)
    fixed = {"integrator": integrator, "treatment": treatment, "order": order}
    rows = []
    plain = medians([python(STEPS, *own, ELEMENTS, "numpy") for _ in range(repeats)])
    with TemporaryDirectory() as cache:
        for measure, elements, times in (
            ("cold", ELEMENTS, 1),
            ("warm", ELEMENTS, repeats),
            ("other mesh", OTHER, repeats),
        ):
            before = contents(cache)
            runs = [
                python(STEPS, *own, elements, "numba", NUMBA_CACHE_DIR=cache) for _ in range(times)
            ]
            files = {p: t for p, t in quiet(cache).items() if before.get(p) != t}
            row = {"measure": measure, **fixed, "new_files": len(files)}
            row |= {name: value - plain[name] for name, value in medians(runs).items()}
            row["compiled"] = max(r["compiled"] for r in runs)
            rows.append({**row, "numba_imported": any(r["numba_imported"] for r in runs)})
    return rows


def all_rows(
    orders: Sequence[int], integrators: Sequence[str], repeats: int
) -> Iterator[dict[str, Any]]:
    """Importing, then what has compiled kernels, with what each may take."""
    cases: list[Callable[[], list[dict[str, Any]]]] = [partial(imports, repeats)]
    for order, integrator, treatment in product(orders, integrators, TREATMENTS):
        pair = INTEGRATORS[integrator](), TREATMENTS[treatment]()
        if refusal(measuring.chain(ELEMENTS, order), *pair) is None:
            cases.append(partial(starts, integrator, treatment, order, repeats))
    for case in cases:
        for row in case():
            yield {**row, "limit": LIMITS[row["measure"]]}


def main(
    quick: bool = True,
    orders: Sequence[int] | None = None,
    integrators: Sequence[str] = tuple(INTEGRATORS),
    repeats: int = 3,
    out: str | Path | None = None,
) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    quick : bool
        Order 1 instead of 1 to 4.
    orders, integrators : sequences, optional
        Only these; no orders: importing alone.
    repeats : int
        Runs of which the median is taken.
    out : path, optional
        Folder for cold_start.csv.

    Returns
    -------
    dict
        ``rows``, ``dgemm_gflops`` and where it was measured.
    """
    chosen = ((1,) if quick else (1, 2, 3, 4)) if orders is None else tuple(orders)
    path = None if out is None else Path(out) / "cold_start.csv"
    return measuring.collected(all_rows(chosen, integrators, repeats), path, COLUMNS)


def missed(result: dict[str, Any]) -> list[str]:
    """What does not come up to the figures."""
    out = []
    for row in result["rows"]:
        name = " ".join(str(row[k]) for k in COLUMNS[:4] if row.get(k) is not None)
        if not row["seconds"] <= row["limit"]:
            out.append(f"{name}: {row['seconds']:.2f} s, at most {row['limit']:g}")
        if row["measure"] != "cold" and (row["compiled"] or row["new_files"]):
            out.append(
                f"{name}: {row['compiled']} functions compiled, {row['new_files']} new files"
            )
        if row["numba_imported"]:
            out.append(f"{name}: importing the package imports numba")
    return out


def report(result: dict[str, Any]) -> str:
    """The table as text."""
    return measuring.table(result["rows"], COLUMNS)


if __name__ == "__main__":
    sys.exit(measuring.command(__doc__, main, report, missed))
