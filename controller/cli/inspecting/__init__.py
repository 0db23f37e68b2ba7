"""`cellctl inspect`: judge stored pictures of a part."""

from .commands import inspect

__all__ = ["inspect"]
