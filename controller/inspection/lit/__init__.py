"""Pictures under lamps against bounds of the light: where they were compared, where they differ."""

from .compare import BURNT_GREY, Compared, compare
from .light import Light, Surface, bound_light, find_surface

__all__ = [
    "BURNT_GREY",
    "Compared",
    "Light",
    "Surface",
    "bound_light",
    "compare",
    "find_surface",
]
