"""Edges that show sizes in pictures: rims of round walls, straight edges of planes."""

from .lines import convex_lines
from .rims import RoundWall, round_walls

__all__ = ["RoundWall", "convex_lines", "round_walls"]
