"""Name of :mod:`skfem_cosserat.accuracy` before version 0.3."""

from .accuracy import *  # noqa: F403
