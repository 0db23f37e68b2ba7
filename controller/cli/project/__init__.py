"""`init`: a new project with recipe, cell file, part and script."""

from .commands import init

__all__ = ["init"]
