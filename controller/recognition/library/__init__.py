"""The library of possible parts: their views, and an index that finds them by shape."""

from ._index import FEW_VIEWS, Candidate, Silhouette, ViewIndex
from ._library import (
    Library,
    LibraryPart,
    check_fits,
    is_same_turn,
    make_entry,
    make_library,
    place_of,
    station_of,
    turn_of,
    turns_that_keep,
)
from ._views import CameraPlace, PartViews, pose_on_table, shadow_camera, view_part
from .polar import polar_grid

__all__ = [
    "FEW_VIEWS",
    "CameraPlace",
    "Candidate",
    "Library",
    "LibraryPart",
    "PartViews",
    "Silhouette",
    "ViewIndex",
    "check_fits",
    "is_same_turn",
    "make_entry",
    "make_library",
    "place_of",
    "polar_grid",
    "pose_on_table",
    "shadow_camera",
    "station_of",
    "turn_of",
    "turns_that_keep",
    "view_part",
]
