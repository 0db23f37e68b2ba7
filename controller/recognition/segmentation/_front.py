"""Things under lamps on a matt table.

The table is smooth: its texture, the fall-off of the light and the shadows of objects all change
slowly, while the border of an object is as sharp as the lens. So the table is the region reachable
from far outside without crossing a sharp border; an unreachable region is an object, its dark walls
included. Within an object, table-like patches with no border to the outside are holes.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, ByteArray, Float32Array, Grey, IndexArray
from controller.imaging.levels import GROUND_BIN, Ground

from ._leaks import leaked
from ._objects import Crop, boxes_of, regions_of, sharpen
from ._types import Region

MARGIN_PX = 24  # margin of a crop: its rim is table, beyond most of a contact shadow
MIN_BRIGHT = 0.15  # a thing is brighter than the table by this share, and by more than its texture,
BRIGHT_NOISES = 5.0  # a thing is brighter by more than the noise of a dark table,
BRIGHT_STEPS = 1.5  # and by more than rounding to few levels: one step is no thing
TEXTURE_FACTOR = 5.0  # factor on the scatter of the table itself
SLOPE_PX = 9  # window over which a slope is distinguished from a step
SLOPE_SHARE = 1.3  # a step's slope over that window is a third of its own
SOBEL_GAIN = 128.0  # gain of the 5 x 5 filter for a slope of 1; half as much again askew, |x| + |y|
# factor on the noise: four deviations of the gradient, which averages over 5 x 5
NOISE_FACTOR = 0.8
STEP_FACTOR = 0.7  # factor on a level step: rounding of a slow slope is no border
MIN_EDGE = 0.012  # least step per pixel beyond the slope, as a share of the table's level
BINOMIAL = np.array([1.0, 2.0, 1.0])
RIDGE_PX = 5  # width across a border
STRONG_SHARE = 0.3  # share of a border's pixels that must have twice the least sharpness
MIN_BORDER = 8  # least length of a border [px]
GAP_PX = 3  # gaps in a border up to twice this do not open it
WIDE_GAP_PX = 6  # wide gaps, for the silhouette that takes a border with them for closed
FRINGE_PX = 7  # narrower ones may be wall or contact shadow
RIM_LEVEL = 0.3
MIN_HOLE = 8  # least width of a hole [px]
# Width of a lens's blur to either side of a border; 1 in pictures of few pixels, whose dim flanks
# are as narrow as the neighbourhood that belongs to 2.
MIXED_PX = 2
SEEN_CONTRAST = 2.0  # grey levels, or one step


def find_front(
    picture: Grey,
    reduced: Grey,
    relative: Grey,
    factor: int,
    ground: Ground,
    noise: float,
    step: int,
    usable: BoolArray | None,
    min_area_px: float,
) -> tuple[list[Region], int]:
    """Return the things on a matt table, and the number of specks ignored.

    Parameters
    ----------
    picture : (height, width) grey
    reduced, relative : (h, w) the picture ``factor`` times smaller; the same over the ground
    factor : reduction factor of the picture
    ground : the table's level
    noise : noise from pixel to pixel
    step : distance of grey levels
    usable : (height, width) mask of the table; None for everywhere
    min_area_px : smallest area that is not a speck [px of the picture]
    """
    height, width = picture.shape
    excess = max(MIN_BRIGHT, TEXTURE_FACTOR * ground.scatter)
    rounding = BRIGHT_STEPS * step if step > 1 else SEEN_CONTRAST
    beyond = max(BRIGHT_NOISES * noise, rounding)
    bright = relative > GROUND_BIN * (1.0 + excess)
    table = float(np.median(reduced[::4, ::4]))
    if excess * table < 2.0 * beyond:  # where it counts, by the level at each place
        whole = (0, 0, reduced.shape[1] * factor, reduced.shape[0] * factor)
        bright &= reduced > ground.over(whole, factor) + beyond
    slope = cv2.morphologyEx(reduced, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    sharp = slope > max(3.0 * MIN_EDGE * factor**0.5 * table, 6.0 * noise, 2.5 * step)
    candidates = cv2.morphologyEx(
        (bright | sharp).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)
    )
    least = max(2, int(0.3 * min_area_px / factor**2))
    boxes, specks = boxes_of(
        np.asarray(candidates, np.uint8), factor, (width, height), MARGIN_PX, least
    )
    found: list[Region] = []
    for box in boxes:
        window = np.s_[box[1] : box[3], box[0] : box[2]]
        crop = Crop(
            box,
            picture[window],
            None if usable is None else usable[window],
            MIXED_PX if factor > 1 else 1,
        )
        regions, small = _within(crop, ground, excess, beyond, noise, step, min_area_px)
        found += regions
        specks += small
    return found, specks


def _within(
    crop: Crop,
    ground: Ground,
    excess: float,
    beyond: float,
    noise: float,
    step: int,
    min_area_px: float,
) -> tuple[list[Region], int]:
    table = ground.over(crop.box_px)
    bound = table + np.maximum(np.float32(excess) * table, np.float32(beyond))
    bright = (crop.grey > bound).view(np.uint8)
    level = float(table[::8, ::8].mean())
    least = max(MIN_EDGE * level, NOISE_FACTOR * noise, STEP_FACTOR * (step if step > 1 else 0))
    border = _borders(crop.grey, least)
    blocked = bright | border
    solid = 1 - _reached(blocked)
    holes = _holes(crop.grey, solid, bright, border, table, excess)
    not_hole = 1 - holes
    rough = (solid & not_hole).view(np.bool_)
    contrast = max(SEEN_CONTRAST, float(step))
    if crop.usable is not None:
        rough &= crop.usable
    mask, field = sharpen(crop, rough, None, contrast)
    if crop.usable is not None:
        mask &= crop.usable
    is_bright = bright.view(np.bool_)
    mask = _without_fringe(mask) | (mask & is_bright)
    wanted = blocked.view(np.bool_)
    filled = mask | solid.view(np.bool_)
    lit = _lit(crop, table, bright)
    wide = ((1 - _reached(blocked, WIDE_GAP_PX)) & not_hole).view(np.bool_)
    tight = (_trimmed(solid, bright) & not_hole).view(np.bool_)
    others: tuple[BoolArray, ...] = (lit, filled, wide, tight)
    inside = leaked(border, solid, crop.mixed_px)
    if inside is not None:
        others = (mask, *others)
        mask = mask | inside
        near = cv2.dilate(inside.view(np.uint8), np.ones((3, 3), np.uint8)) > 0
        field[near] = np.where(mask[near], 1.0, -1.0)  # to a pixel, which will do for a hull
    return regions_of(crop, mask, field, wanted, min_area_px, others)


def _lit(crop: Crop, table: Float32Array, bright: ByteArray) -> BoolArray:
    """Return a mask of the bright pixels, less most of the outer half of their blurred rim.

    At half the level dim flanks beside bright ones would go with the rim.
    """
    side = 2 * crop.mixed_px + 1
    strongest = cv2.dilate(crop.grey, np.ones((side, side), np.uint8))
    level = cv2.addWeighted(strongest, RIM_LEVEL, table, 1.0 - RIM_LEVEL, 0.0, dtype=cv2.CV_32F)
    return np.asarray(bright.view(np.bool_) & (crop.grey > level))


def _borders(grey: Grey, least: float) -> ByteArray:
    """Return 1 along sharp borders: steps of ``least`` levels a pixel above the local slope.

    A step as sharp as the lens is 2 px wide, a shadow's border many: the same gradient over a
    wide window tells how much of it is slope. Only the ridge is kept, so that the foot of a
    shadow that runs up to a border does not widen it.
    """
    # Sobel's 5 x 5 filter, in two steps of 3 x 3 that take half the time
    soft = cv2.sepFilter2D(grey, cv2.CV_16S, BINOMIAL, BINOMIAL)
    gx = np.asarray(cv2.Sobel(soft, cv2.CV_16S, 1, 0), np.int16)
    gy = np.asarray(cv2.Sobel(soft, cv2.CV_16S, 0, 1), np.int16)
    sharp = _less_slope(grey, np.abs(gx) + np.abs(gy))
    at = np.flatnonzero(sharp > SOBEL_GAIN * least)
    at = at[_is_ridge(sharp, at, gx.ravel()[at], gy.ravel()[at])]
    ridge = np.zeros(grey.shape, dtype=np.uint8)
    ridge.ravel()[at] = 1
    _, labels = cv2.connectedComponents(ridge, connectivity=8, ltype=cv2.CV_32S)
    of = labels.ravel()[at]
    size = np.bincount(of)
    strong = of[sharp.ravel()[at] > 2.0 * SOBEL_GAIN * least]
    is_border = np.bincount(strong, minlength=len(size)) >= np.maximum(STRONG_SHARE * size, 4)
    is_border &= size >= MIN_BORDER
    ridge.ravel()[at] = is_border[of]
    return ridge


def _less_slope(grey: Grey, fine: NDArray[np.int16]) -> NDArray[np.int16]:
    """Return a gradient less its mean over a wide window, in units of 1 / ``SOBEL_GAIN``."""
    wide = cv2.boxFilter(grey, cv2.CV_16U, (SLOPE_PX, SLOPE_PX), normalize=False).view(np.int16)
    coarse = np.zeros_like(wide)
    np.abs(wide[:, 2:] - wide[:, :-2], out=coarse[:, 1:-1])
    coarse[1:-1] += np.abs(wide[2:] - wide[:-2])
    scale = SLOPE_SHARE * SOBEL_GAIN / (2.0 * SLOPE_PX**2)
    return np.asarray(cv2.addWeighted(fine, 1.0, coarse, -scale, 0.0, dtype=cv2.CV_16S), np.int16)


def _is_ridge(
    sharp: NDArray[np.int16], at: IndexArray, gx: NDArray[np.int16], gy: NDArray[np.int16]
) -> BoolArray:
    """Return a mask (n,) of the pixels sharpest across the border, to an eighth of a turn.

    Parameters
    ----------
    sharp : (h, w)
    at : (n,) flat indices of the pixels
    gx, gy : (n,) the gradient there
    """
    width = sharp.shape[1]
    ax, ay = np.abs(gx), np.abs(gy)
    askew = np.where((gx ^ gy) < 0, width - 1, width + 1)
    across = np.where(ay < 0.414 * ax, 1, np.where(ax < 0.414 * ay, width, askew))
    level = sharp.ravel()
    own = level[at]
    best = own.copy()
    for step in range(1, RIDGE_PX // 2 + 1):
        for side in (-step, step):
            np.maximum(best, level.take(at + side * across, mode="clip"), out=best)
    return np.asarray(own >= best)


def _reached(blocked: ByteArray, gap_px: int = GAP_PX) -> ByteArray:
    """Return 1 where a disc from the rim can reach past the blocked pixels."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * gap_px + 1, 2 * gap_px + 1))
    free = 1 - cv2.dilate(blocked, disc)
    padded = cv2.copyMakeBorder(free, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=1)
    cv2.floodFill(padded, None, (0, 0), 2)
    reached = (padded[1:-1, 1:-1] == 2).view(np.uint8)
    # step by step up to the borders, which are one pixel wide: a disc would leap over them
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    for _ in range(2 * gap_px):
        reached = cv2.dilate(reached, cross)
        np.greater(reached, blocked, out=reached.view(np.bool_))
    return np.asarray(reached, np.uint8)


def _holes(
    grey: Grey,
    solid: ByteArray,
    bright: ByteArray,
    border: ByteArray,
    table: Float32Array,
    excess: float,
) -> ByteArray:
    """Return 1 where the table shows through a thing: table-like, and closed all round."""
    inner = solid & (1 - bright) & (1 - border)
    count, labels = cv2.connectedComponents(inner, connectivity=4, ltype=cv2.CV_32S)
    near_outside = inner & np.asarray(cv2.dilate(1 - solid, np.ones((7, 7), np.uint8)), np.uint8)
    is_closed = np.ones(count, dtype=np.bool_)
    is_closed[0] = False
    is_closed[labels[near_outside.view(np.bool_)]] = False
    holes = np.zeros_like(solid)
    if not is_closed.any():
        return holes
    at = np.flatnonzero(is_closed[labels])
    of = labels.ravel()[at]
    size = np.bincount(of)
    ratio = np.bincount(of, weights=grey.ravel()[at] / table.ravel()[at])
    is_hole = (size >= MIN_HOLE) & (ratio <= (1.0 + 0.5 * excess) * size)
    holes.ravel()[at] = is_hole[of]
    wide = np.asarray(cv2.dilate(holes, np.ones((3, 3), np.uint8)), np.uint8)
    return np.asarray(wide & (1 - bright))


def _trimmed(solid: ByteArray, bright: ByteArray) -> ByteArray:
    """Return the solid mask less narrow dark fringes: the table is darkest beside things."""
    dark = solid & (1 - bright)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (FRINGE_PX, FRINGE_PX))
    wide = cv2.morphologyEx(dark, cv2.MORPH_OPEN, disc)
    wide = cv2.dilate(wide, np.ones((3, 3), np.uint8))
    return np.asarray((np.asarray(wide, np.uint8) & dark) | bright, np.uint8)


def _without_fringe(mask: BoolArray) -> BoolArray:
    """Return the mask without the one-pixel hairs that a shadow's border leaves."""
    opened = cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return np.asarray(opened.view(np.bool_))
