"""Results of a segmentation."""

from dataclasses import dataclass
from typing import Literal

from controller.arrays import BoolArray, FloatArray
from controller.imaging.levels import Levels

Lighting = Literal["backlit", "front"]


@dataclass(frozen=True, eq=False, slots=True)
class Region:
    """One thing that lies on the table.

    Attributes
    ----------
    box_px : x0, y0, x1, y1 of the crop, with a margin where the picture allows
    mask : (y1 - y0, x1 - x0) the thing within the box, holes open
    loops_px : closed outlines, (n, 2) each, x before y in pixels of the whole picture, in order
        along the border with the thing on the left to the eye, about one point a pixel; the outer
        one first, then holes, longest first
    touches_edge : cut by the picture's edge or by that of the usable area
    area_px : within the outer loop, holes taken out
    alternatives : other silhouettes it may have, as ``mask``, where a front-lit picture
        leaves them open, each where it differs by 1 % and more: the bright part without dark
        walls, holes filled, walls with wider gaps in their borders, no narrow dark fringes
    """

    box_px: tuple[int, int, int, int]
    mask: BoolArray
    loops_px: tuple[FloatArray, ...]
    touches_edge: bool
    area_px: float
    alternatives: tuple[BoolArray, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Segmentation:
    """The things on the table, and the evidence of the histogram.

    Attributes
    ----------
    regions : largest first
    lighting : as asked, or as found
    is_bimodal : whether the histogram, relative to the table's level, shows two humps
    levels : grey levels and how well they separate
    remarks : sentences for the operator
    """

    regions: tuple[Region, ...]
    lighting: Lighting
    is_bimodal: bool
    levels: Levels
    remarks: tuple[str, ...]
