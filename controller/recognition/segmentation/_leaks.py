"""Things whose border shows in part.

A dark side lies in its own shadow, or a wall is as grey as the table. The table's region then
enters through such a gap and swallows the whole object.

Borders with nothing solid beside them show where that happened. Nearby borders are then taken as
one object, and the area that they enclose as its region: this includes hollows of its outline and
its shadow, so it is a place to search rather than a silhouette.
"""

import cv2
import numpy as np

from controller.arrays import BoolArray, ByteArray, IndexArray

THIN_PX = 5  # a solid area narrower than this is only a border
BESIDE_PX = 3  # a border this near something solid is its own
JOIN = 6  # factor on the blurred width: gaps up to twice this are bridged
MIN_OPEN_PX = 30  # factor on the same: length of open border from which a thing is searched for
OPEN_SHARE = 0.25  # least open share of a thing's borders; below, it is a shadow
BORDERED = 0.35  # least share of the circumference covered by the borders


def leaked(border: ByteArray, solid: ByteArray, mixed_px: int) -> BoolArray | None:
    """Return the area that open borders enclose (h, w); None where no border lies open.

    Parameters
    ----------
    border : (h, w) 1 along sharp borders
    solid : (h, w) 1 where nothing came in from the table, the borders among it
    mixed_px : pixels this near a border hold some of both sides
    """
    square = np.ones((THIN_PX, THIN_PX), np.uint8)
    core = np.asarray(cv2.morphologyEx(solid, cv2.MORPH_OPEN, square), np.uint8)
    beside = np.ones((2 * BESIDE_PX + 1,) * 2, np.uint8)
    is_open = border & (1 - np.asarray(cv2.dilate(core, beside), np.uint8))
    least = MIN_OPEN_PX * mixed_px
    if cv2.countNonZero(is_open) < least:
        return None
    shown = border | core
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * JOIN * mixed_px + 1,) * 2)
    _, labels = cv2.connectedComponents(cv2.dilate(shown, disc), ltype=cv2.CV_32S)
    v, u = np.nonzero(shown)
    of = labels[v, u]
    open_px = np.bincount(labels[is_open > 0], minlength=labels.max() + 1)
    border_px = np.bincount(of, weights=border[v, u], minlength=len(open_px))
    out = np.zeros_like(solid)
    for which in np.flatnonzero((open_px >= least) & (open_px >= OPEN_SHARE * border_px)):
        mine = of == which
        _enclose(out, u[mine], v[mine], border_px[which])
    return out > 0 if out.any() else None


def _enclose(out: ByteArray, u: IndexArray, v: IndexArray, border_px: float) -> None:
    """Fill the hull of pixels (n,), unless they are too few or reach the crop's rim."""
    height, width = out.shape
    if min(u.min(), v.min()) == 0 or u.max() == width - 1 or v.max() == height - 1:
        return
    hull = cv2.convexHull(np.column_stack([u, v]).astype(np.int32))
    if border_px >= BORDERED * cv2.arcLength(hull, closed=True):
        cv2.fillConvexPoly(out, hull, 1)
