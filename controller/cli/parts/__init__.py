"""`compile`: everything that follows from a CAD file alone."""

from .commands import compile_

__all__ = ["compile_"]
