"""Independent runs side by side, through any executor: results in order, failures kept apart."""

from .jobs import Job, Outcome
from .processes import Processes
from .run import Executor, run_all

__all__ = ["Executor", "Job", "Outcome", "Processes", "run_all"]
