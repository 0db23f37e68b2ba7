"""Stored pictures of the table: what lies there."""

from .commands import recognise

__all__ = ["recognise"]
