"""Edges that show sizes in pictures: rims of round walls, straight edges of planes."""

from .lines import convex_lines
from .rims import RoundWall, plane_rims, round_walls

__all__ = ["RoundWall", "convex_lines", "plane_rims", "round_walls"]
