"""`cellctl history`, `review`, `rejudge`, `backup`: parts the cell inspected, reviews of them."""

from .commands import backup, history, rejudge, review

__all__ = ["backup", "history", "rejudge", "review"]
