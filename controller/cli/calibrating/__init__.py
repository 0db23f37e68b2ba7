"""`calibrate`: measures the cell's cameras."""

from .commands import camera

__all__ = ["camera"]
