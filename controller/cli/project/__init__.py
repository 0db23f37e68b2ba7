"""A new project: recipe, cell file, part, script."""

from .commands import init

__all__ = ["init"]
