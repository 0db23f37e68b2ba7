"""`run`, the main job, and what follows it: `recover` and `report`."""

from .commands import recover, report, run

__all__ = ["recover", "report", "run"]
