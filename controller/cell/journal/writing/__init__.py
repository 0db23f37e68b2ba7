"""How rows reach the file: one by one, in the order in which they were put in."""

from .thread import BUSY_WALL_S, PATIENCE_WALL_S, Entry, WriterThread

__all__ = ["BUSY_WALL_S", "PATIENCE_WALL_S", "Entry", "WriterThread"]
