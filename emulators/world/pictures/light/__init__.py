"""The light of lamps on surfaces, the shadows between, and where in a picture these may fall."""

from .lamps import Lamps
from .reach import Reach, fill
from .shadows import (
    CHUNK,
    LIFT_MM,
    Index,
    Mask,
    Shadows,
    Spots,
    cast_shadows,
    chunks,
    wide_mask,
)

__all__ = [
    "CHUNK",
    "LIFT_MM",
    "Index",
    "Lamps",
    "Mask",
    "Reach",
    "Shadows",
    "Spots",
    "cast_shadows",
    "chunks",
    "fill",
    "wide_mask",
]
