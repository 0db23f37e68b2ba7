"""`calibrate`: measures what the cell must know about itself."""

from .commands import camera

__all__ = ["camera"]
