"""`cellctl history`: all parts that the cell inspected, and all that is known of one."""

from .commands import history

__all__ = ["history"]
