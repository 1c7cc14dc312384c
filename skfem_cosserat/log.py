"""The logger of the package: silent until the user configures :mod:`logging`."""

from __future__ import annotations

import logging

logger = logging.getLogger("skfem_cosserat")
logger.addHandler(logging.NullHandler())
