"""Contact tests: boxes many at a time, and a part's triangles."""

from .boxes import Box, SolidBox, lowest_z, overlap, overlap_turned, segments_hit, stack
from .shape import PartShape, PlacedShape, Triangles
from .widths import narrowest_mm

__all__ = [
    "Box",
    "PartShape",
    "PlacedShape",
    "SolidBox",
    "Triangles",
    "lowest_z",
    "narrowest_mm",
    "overlap",
    "overlap_turned",
    "segments_hit",
    "stack",
]
