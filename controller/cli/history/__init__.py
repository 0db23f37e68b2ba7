"""`cellctl history`, `review` and `backup`: all parts the cell inspected, and their reviews."""

from .commands import backup, history, review

__all__ = ["backup", "history", "review"]
