"""Whether the reference of the interface, as pdoc made it, holds every public name.

python tests/reference.py FOLDER
"""

from __future__ import annotations

import sys
from pathlib import Path

import skfem_cosserat


def main(folder: Path) -> None:
    """End with 1 if a name is missing."""
    page = (folder / "skfem_cosserat.html").read_text(encoding="utf-8")
    missing = [name for name in skfem_cosserat.__all__ if f'id="{name}"' not in page]
    missing = [
        name for name in missing if not (folder / "skfem_cosserat" / f"{name}.html").exists()
    ]
    if missing:
        sys.exit(f"the reference leaves out {', '.join(missing)}")
    sys.stdout.write(f"{len(skfem_cosserat.__all__)} public names in the reference\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
