"""Segmentation: picture of the table -> masks and outlines to a fraction of a pixel.

Dark things before a light table, or things under lamps on a matt one (references.md P3.1).
"""

from ._groups import joined, near_ones
from ._lamps import brightest_of
from ._segment import segment
from ._types import Region, Segmentation

__all__ = ["Region", "Segmentation", "brightest_of", "joined", "near_ones", "segment"]
