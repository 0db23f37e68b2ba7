"""`compile`: what follows from a CAD file alone."""

from .commands import compile_

__all__ = ["compile_"]
