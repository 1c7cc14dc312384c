"""Print the table: ``python examples/benchmarks/collection [--full] [--out FOLDER] [ID ...]``."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import measuring

import collection


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("ids", nargs="*", help="families, such as S03; default: all")
    parser.add_argument("--full", action="store_true", help="all cases, the long ones as well")
    parser.add_argument("--json", type=Path, help="file for the rows, a list")
    parser.add_argument(
        "--out", type=Path, help="folder for the table: collection.csv, full: collection_full.csv"
    )
    arguments = parser.parse_args()
    rows: list[dict[str, object]] = []
    environment = measuring.environment()
    for family in collection.chosen(arguments.ids or None):  # written as it goes: a night's work
        found = collection.run(family, quick=not arguments.full)
        print(measuring.table(found, collection.COLUMNS), flush=True)
        rows += found
        if arguments.json:
            arguments.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")
        if arguments.out:
            name = "collection_full.csv" if arguments.full else "collection.csv"
            result = {"rows": rows, **environment}
            measuring.write(arguments.out / name, result, collection.COLUMNS)


if __name__ == "__main__":
    main()
