"""From a rough mask to things with outlines: borders moved to the half level between both sides."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ._loops import evenly, polygon_area, trace_loops
from ._types import Region

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Grey = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Box = tuple[int, int, int, int]

LOCAL_FACTOR = 4  # a side's level is the mean over this many times what is mixed, and one
MIXED_WEIGHT = 1.0 / 64.0  # they count only where there is nothing else, as in a thin web


@dataclass(frozen=True, eq=False, slots=True)
class Crop:
    """A part of a picture in which objects are looked at closely.

    Attributes
    ----------
    box_px : x0, y0, x1, y1
    grey : (h, w)
    usable : (h, w), None for all of it
    mixed_px : pixels this near a border hold some of both sides
    """

    box_px: Box
    grey: Grey
    usable: Mask | None
    mixed_px: int


def side_level(grey: Grey, side: NDArray[np.uint8], mixed_px: int) -> Floats:
    """Return the local level of a side (h, w), 1 where a pixel is of it, away from its border.

    Where nothing of it is near the level is 0.
    """
    square = np.ones((2 * mixed_px + 1, 2 * mixed_px + 1), dtype=np.uint8)
    pure = cv2.erode(side, square, borderType=cv2.BORDER_CONSTANT, borderValue=1)
    weight = cv2.addWeighted(side, 1.0, pure, 1.0 / MIXED_WEIGHT - 1.0, 0.0)
    window = (LOCAL_FACTOR * mixed_px + 1, LOCAL_FACTOR * mixed_px + 1)
    total = cv2.boxFilter(weight, cv2.CV_32F, window, normalize=False)
    light = cv2.multiply(grey, weight, dtype=cv2.CV_32F)
    light = cv2.boxFilter(light, cv2.CV_32F, window, normalize=False)
    out: Floats = light / np.maximum(total, 1e-3)
    return out


def sharpen(crop: Crop, rough: Mask, beyond: Floats | None, contrast: float) -> tuple[Mask, Floats]:
    """Return the mask with its border at the half level, and the field whose zero line that is.

    Parameters
    ----------
    rough : (h, w) objects, right to what is mixed
    beyond : (h, w) level of the ground; None to take it from beside the border
    contrast : difference of levels from which a border is seen; with less it stays where it is
    """
    grey, mixed_px = crop.grey, crop.mixed_px
    inner = rough.astype(np.uint8)
    inside = side_level(grey, inner, mixed_px)
    outside = side_level(grey, 1 - inner, mixed_px) if beyond is None else beyond
    field: Floats = grey - 0.5 * (inside + outside)
    is_dark = inside < outside
    field[is_dark] *= -1.0
    is_seen = cv2.absdiff(inside, outside) >= contrast
    square = np.ones((2 * mixed_px + 1, 2 * mixed_px + 1), dtype=np.uint8)
    near = cv2.morphologyEx(inner, cv2.MORPH_GRADIENT, square) > 0
    mask = np.where(near & is_seen, field > 0, rough)
    return mask, field


def regions_of(
    crop: Crop,
    mask: Mask,
    field: Floats,
    wanted: Mask | None,
    min_area_px: float,
    readings: tuple[Mask, ...] = (),
) -> tuple[list[Region], int]:
    """Return the connected things of a mask, and how many were too small to be one.

    Parameters
    ----------
    wanted : (h, w) only what has a pixel there; None for everything
    readings : other masks of the whole crop, cut to each thing's surroundings
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8), connectivity=8
    )
    kept, specks = [], 0
    for k in range(1, count):
        left, top, width, height, area = (int(s) for s in stats[k])
        if area < min_area_px:
            specks += 1
            continue
        window, box = _with_margin((left, top, left + width, top + height), crop)
        thing = labels[window] == k
        if wanted is not None and not (thing & wanted[window]).any():
            continue
        fine = trace_loops(thing, field[window], (box[0], box[1]))
        if not fine:
            continue
        area_px = polygon_area(fine[0]) - sum(polygon_area(loop) for loop in fine[1:])
        others = labels[window]
        elsewhere = (others != 0) & (others != k)
        kept.append(
            Region(
                box_px=box,
                mask=thing,
                loops_px=tuple(evenly(loop) for loop in fine),
                touches_edge=_is_cut(thing, window, crop),
                area_px=area_px,
                alternatives=tuple(
                    alternative
                    for reading in readings
                    if (alternative := reading[window] & ~elsewhere).any()
                    and int((alternative ^ thing).sum()) > 0.01 * area
                ),
            )
        )
    return kept, specks


def _with_margin(box: Box, crop: Crop, margin_px: int = 4) -> tuple[tuple[slice, slice], Box]:
    left, top, right, bottom = box
    height, width = crop.grey.shape
    left, top = max(left - margin_px, 0), max(top - margin_px, 0)
    right, bottom = min(right + margin_px, width), min(bottom + margin_px, height)
    x0, y0, _, _ = crop.box_px
    return (
        (slice(top, bottom), slice(left, right)),
        (x0 + left, y0 + top, x0 + right, y0 + bottom),
    )


def _is_cut(thing: Mask, window: tuple[slice, slice], crop: Crop) -> bool:
    """Return whether a thing reaches the crop's rim (it has none but the picture's) or beyond."""
    rows, columns = window
    height, width = crop.grey.shape
    if (
        (rows.start == 0 and thing[0].any())
        or (columns.start == 0 and thing[:, 0].any())
        or (rows.stop == height and thing[-1].any())
        or (columns.stop == width and thing[:, -1].any())
    ):
        return True
    if crop.usable is None:
        return False
    beyond = (~crop.usable[window]).astype(np.uint8)
    return bool((thing & (cv2.dilate(beyond, np.ones((5, 5), np.uint8)) > 0)).any())


def boxes_of(
    candidates: NDArray[np.uint8], factor: int, size_px: tuple[int, int], margin_px: int, least: int
) -> tuple[list[Box], int]:
    """Return boxes round the candidates of a reduced picture, met ones merged; how many left out.

    Parameters
    ----------
    candidates : (h, w) 1 where something is
    least : pixels of the reduced picture below which something is left out
    """
    count, _, stats, _ = cv2.connectedComponentsWithStats(candidates, connectivity=8)
    width, height = size_px
    boxes: list[Box] = []
    left_out = 0
    for x, y, w, h, area in stats[1:count].tolist():
        if area < least:
            left_out += 1
            continue
        boxes.append(
            (
                max(x * factor - margin_px, 0),
                max(y * factor - margin_px, 0),
                min((x + w) * factor + margin_px, width),
                min((y + h) * factor + margin_px, height),
            )
        )
    return _merged(boxes), left_out


def _merged(boxes: list[Box]) -> list[Box]:
    done: list[Box] = []
    todo = sorted(boxes)
    while todo:
        box = todo.pop()
        for other in done:
            if box[0] < other[2] and other[0] < box[2] and box[1] < other[3] and other[1] < box[3]:
                done.remove(other)
                todo.append(
                    (
                        min(box[0], other[0]),
                        min(box[1], other[1]),
                        max(box[2], other[2]),
                        max(box[3], other[3]),
                    )
                )
                break
        else:
            done.append(box)
    return done
