"""Dark things before a light table.

The cut is half-way between the table's level there and that of the object. Walls that stand on the
light table mirror it and look lighter; they stay part of the object, because the half level at a
border refers to the object's own level next to it.
"""

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, Grey
from controller.imaging.levels import GROUND_BIN, MAX_BEYOND_WHITE, Ground

from ._objects import Box, Crop, boxes_of, regions_of, sharpen
from ._types import Region

MARGIN_PX = 10  # margin of a crop: enough ground to see a thing end
MIXED_PX = 2  # width of a lens's blur to either side of a border
SEEN_CONTRAST = 0.1  # least contrast, as a share of the ground's level


def find_backlit(
    picture: Grey,
    relative: Grey,
    factor: int,
    ground: Ground,
    white: int,
    cut: float,
    usable: BoolArray | None,
    min_area_px: float,
) -> tuple[list[Region], int]:
    """Return the things darker than the backlight, and the number of specks ignored.

    Parameters
    ----------
    picture : (height, width) grey
    relative : (h, w) reduced picture over the ground's level, the ground at ``GROUND_BIN``
    factor : reduction factor of the picture
    ground : the table's level
    white : level of saturated pixels
    cut : relative level of the threshold
    usable : (height, width) mask of the table; None for everywhere
    min_area_px : smallest area that is not a speck [px of the picture]
    """
    height, width = picture.shape
    dark = (relative < cut).astype(np.uint8)
    least = max(1, int(0.3 * min_area_px / factor**2))
    boxes, specks = boxes_of(dark, factor, (width, height), MARGIN_PX, least)
    found: list[Region] = []
    for box in boxes:
        window = np.s_[box[1] : box[3], box[0] : box[2]]
        crop = Crop(box, picture[window], None if usable is None else usable[window], MIXED_PX)
        regions, small = _within(crop, ground, white, cut / GROUND_BIN, min_area_px)
        found += regions
        specks += small
    return found, specks


def _within(
    crop: Crop, ground: Ground, white: int, cut: float, min_area_px: float
) -> tuple[list[Region], int]:
    beyond = table_level(ground, crop.box_px, white)
    level = np.minimum(beyond, white)
    threshold = cv2.multiply(level, cut)  # type: ignore[call-overload]  # no scalars in stubs
    rough = crop.grey < threshold
    if crop.usable is not None:
        rough &= crop.usable
    mask, field = sharpen(crop, rough, beyond, SEEN_CONTRAST * float(beyond[::8, ::8].mean()))
    if crop.usable is not None:
        mask &= crop.usable
    return regions_of(crop, mask, field, None, min_area_px)


def table_level(ground: Ground, box: Box, white: int) -> Float32Array:
    """Return the table's level (h, w) in a box, as if white were no limit.

    Parameters
    ----------
    ground : the table's level over the whole picture
    box : (x0, y0, x1, y1) pixels, the last ones excluded
    white : level of saturated pixels, 256 where none is
    """
    level = ground.over(box)
    if white < 256:
        np.clip(level, 1.0, MAX_BEYOND_WHITE * white, out=level)
    return level
