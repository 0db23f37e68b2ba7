"""What the cell must know about itself, measured."""

from .commands import camera

__all__ = ["camera"]
