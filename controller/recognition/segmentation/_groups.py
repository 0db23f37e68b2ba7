"""Groups of things so near each other that they may touch, or be pieces of one part."""

from collections.abc import Sequence

import cv2
import numpy as np

from ._types import Region

NEAR_PX = 6  # half the distance between two things that may touch: a shaded side may lie between


def near_ones(regions: Sequence[Region]) -> list[list[int]]:
    """Return the numbers of regions in groups: each is near another one of its group.

    Parameters
    ----------
    regions : regions of one picture
    """
    group = list(range(len(regions)))
    for a in range(len(regions)):
        for b in range(a):
            if group[a] != group[b] and _are_near(regions[a], regions[b]):
                old, new = group[a], group[b]
                group = [new if g == old else g for g in group]
    order = dict.fromkeys(group)
    return [[k for k, g in enumerate(group) if g == one] for one in order]


def joined(regions: Sequence[Region]) -> Region:
    """Return several regions of one picture as one.

    Parameters
    ----------
    regions : at least one
    """
    if len(regions) == 1:
        return regions[0]
    boxes = np.array([region.box_px for region in regions])
    x0, y0 = boxes[:, :2].min(axis=0).tolist()
    x1, y1 = boxes[:, 2:].max(axis=0).tolist()
    shapes = np.zeros((1 + max(len(r.alternatives) for r in regions), y1 - y0, x1 - x0), np.bool_)
    for region in regions:
        left, top, right, bottom = region.box_px
        own = (region.mask, *region.alternatives)
        for k, shape in enumerate(shapes):
            shape[top - y0 : bottom - y0, left - x0 : right - x0] |= own[k if k < len(own) else 0]
    loops = sorted((loop for region in regions for loop in region.loops_px), key=len, reverse=True)
    return Region(
        box_px=(x0, y0, x1, y1),
        mask=shapes[0],
        loops_px=tuple(loops),
        touches_edge=any(region.touches_edge for region in regions),
        area_px=sum(region.area_px for region in regions),
        alternatives=tuple(shapes[1:]),
    )


def _are_near(a: Region, b: Region) -> bool:
    boxes = np.array([a.box_px, b.box_px])
    if (boxes[:, :2].max(axis=0) - boxes[:, 2:].min(axis=0) > 2 * NEAR_PX).any():
        return False
    x0, y0 = boxes[:, :2].min(axis=0).tolist()
    x1, y1 = boxes[:, 2:].max(axis=0).tolist()
    square = np.ones((2 * NEAR_PX + 1,) * 2, np.uint8)
    wide = []
    for one in (a, b):
        canvas = np.zeros((y1 - y0, x1 - x0), np.uint8)
        left, top, right, bottom = one.box_px
        canvas[top - y0 : bottom - y0, left - x0 : right - x0] = one.mask
        wide.append(cv2.dilate(canvas, square))
    return bool(np.logical_and(*wide).any())
