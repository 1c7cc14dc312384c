"""The command line: ``python -m skfem_cosserat changes``."""

from __future__ import annotations

import sys

from .cli import main

if __name__ == "__main__":
    sys.exit(main())
