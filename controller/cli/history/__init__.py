"""`cellctl history`, `review` and `backup`: all parts that the cell inspected, and who decides."""

from .commands import backup, history, review

__all__ = ["backup", "history", "review"]
