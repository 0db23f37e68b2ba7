"""The main job, and what comes after it: a run, its end, its report, a recovery."""

from .commands import recover, report, run

__all__ = ["recover", "report", "run"]
