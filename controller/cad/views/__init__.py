"""What a camera sees of a posed solid: as pixels (maps), as lines (views)."""

from ._model import ViewModel, prepare_views
from ._types import DrawnEdge, LineView, Loop, Stroke
from .lines import camera_view, line_view, outline
from .maps import Roi, ViewMaps, meet_part, render_maps, view_roi

__all__ = [
    "DrawnEdge",
    "LineView",
    "Loop",
    "Roi",
    "Stroke",
    "ViewMaps",
    "ViewModel",
    "camera_view",
    "line_view",
    "meet_part",
    "outline",
    "prepare_views",
    "render_maps",
    "view_roi",
]
