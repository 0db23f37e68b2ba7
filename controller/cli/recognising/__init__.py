"""`recognise`: the parts in stored pictures of the table."""

from .commands import recognise

__all__ = ["recognise"]
