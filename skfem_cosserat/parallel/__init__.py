"""Independent runs side by side, through any executor: results in order, failures kept apart."""

from .executors import Executor, Processes, run_all
from .jobs import Job, Outcome

__all__ = ["Executor", "Job", "Outcome", "Processes", "run_all"]
