"""Views of a posed solid by a camera: as pixels (maps), as lines (views)."""

from ._model import ViewModel, prepare_views
from ._types import DrawnEdge, LineView, Loop, Stroke
from .lines import camera_view, line_view, outline

__all__ = [
    "DrawnEdge",
    "LineView",
    "Loop",
    "Stroke",
    "ViewModel",
    "camera_view",
    "line_view",
    "outline",
    "prepare_views",
]
