"""`cellctl history` and `backup`: all parts that the cell inspected, and keeping what it wrote."""

from .commands import backup, history

__all__ = ["backup", "history"]
