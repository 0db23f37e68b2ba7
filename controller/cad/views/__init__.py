"""What a camera sees of a posed solid: as pixels (maps), as lines (views)."""

from ._types import DrawnEdge, LineView, Loop, Stroke
from .maps import Roi, ViewMaps, render_maps, view_roi

__all__ = [
    "DrawnEdge",
    "LineView",
    "Loop",
    "Roi",
    "Stroke",
    "ViewMaps",
    "render_maps",
    "view_roi",
]
