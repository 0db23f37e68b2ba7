"""Curved walls on a tessellated hull: strips, and the false hollows that they make.

A tessellated curve has hollows that the real curve lacks: every strip of a rod holds the rod, and a
strip half-way round a rounded corner may hold the part in balance ("impossible" stable orientations
10 and 11 of the paper's Table 1). Such a hollow is never deeper than the height of the true curve
above the strip. So a strip's hollow that a climb of about that height leaves belongs to the lower
one beyond the pass.
"""

from dataclasses import dataclass
from itertools import chain

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray

from ..graph import components, distinct
from ..large import spans
from ._hull import Hull
from ._topple import Landscape

# Largest turn between strips of one curve: a circle of twelve corners or more.
SMOOTH_RAD = np.radians(31.0)
PLANE_RATIO = 4.0  # a plane is this many times larger than the strips it runs into
WIDE_RATIO = 25.0  # the same ratio if a curve over it would hardly bulge: strips differ in width
# Share of the greatest height; a smaller bulge does not tell a plane from a strip.
FINE_SHARE = 3e-4
BULGE_MARGIN = 1.5  # factor on bulges, since tessellations are uneven
BULGE_CAP_MM = 0.5  # a deeper hollow counts as a pose, whatever curve it is part of
LARGE_MM = 100.0  # a part reaching further is tessellated, and rolls, in proportion
NARROW_RAD = np.radians(10.0)  # strips that hold the part this near to the lowest are one balance
ROLLING_LIFT_MM = 0.15  # on one curve a climb of less is no rest: the part rolls over it


@dataclass(frozen=True, eq=False, slots=True)
class Strips:
    """Facets that are pieces of a curve.

    Attributes
    ----------
    is_strip : (f,)
    bulge_mm : (f,) height of the curve above a strip, 0 for a plane
    is_smooth : (e,) edges inside a curve, or where it runs into a plane
    region : (f,) number of the curve a strip is part of; each plane has one of its own
    is_wide : (f,) strips wider than those beside them, over which the curve hardly bulges
    is_band : (f,) strips of a band round the part's axis, however unequal they are
    cap_mm, lift_mm : `BULGE_CAP_MM` and `ROLLING_LIFT_MM` for a part of this size
    """

    is_strip: BoolArray
    bulge_mm: FloatArray
    is_smooth: BoolArray
    region: IntArray
    is_wide: BoolArray
    is_band: BoolArray
    cap_mm: float
    lift_mm: float


def find_strips(hull: Hull) -> Strips:
    """Return the strips of a hull, facets that are pieces of a curve; planes are removed first."""
    first, second = hull.edge_facets[:, 0], hull.edge_facets[:, 1]
    n1, n2 = hull.normals[first], hull.normals[second]
    angle = 2 * np.arcsin(np.clip(np.linalg.norm(n2 - n1, axis=1) / 2, 0, 1))
    smooth = angle < SMOOTH_RAD
    # ways to the smooth neighbours must lead to more than one side: a slope beside a plane is none
    here = np.concatenate([first[smooth], second[smooth]])
    there = np.concatenate([second[smooth], first[smooth]])
    largest = np.zeros(hull.count)
    np.maximum.at(largest, here, hull.areas_mm2[there])
    plane = hull.areas_mm2 > PLANE_RATIO * largest  # also true where nothing smooth is beside
    by_side, is_long = _bulges(hull, angle)
    over = np.zeros(hull.count)
    for k in (0, 1):
        tells = smooth & is_long[:, k]
        np.maximum.at(over, hull.edge_facets[tells, k], by_side[tells, k])
    fine_mm = FINE_SHARE * float(hull.heights_mm.max(initial=0.0))
    wide = (over > 0) & (over <= fine_mm) & (hull.areas_mm2 <= WIDE_RATIO * largest)
    plane &= ~wide
    inner = smooth & ~plane[first] & ~plane[second]
    region = components(hull.count, first[inner], second[inner])
    sizes = np.bincount(region)
    strip = ~plane & (sizes[region] >= 3)  # a roof is two planes, never a curve
    keep = smooth & (strip[first] | strip[second])

    bulge = np.zeros(hull.count)
    for side, over_side in ((first, by_side[:, 0]), (second, by_side[:, 1])):
        np.maximum.at(bulge, side[keep], over_side[keep])
    scale = max(1.0, float(hull.heights_mm.max(initial=0.0)) / LARGE_MM)
    cap_mm = BULGE_CAP_MM * scale
    strip &= bulge <= cap_mm  # wider, it is a face of its own, at a blunt angle to the next
    bulge[~strip] = 0.0
    smooth = keep & (strip[first] | strip[second])
    band = np.zeros(hull.count, dtype=bool)
    lift_mm = ROLLING_LIFT_MM * scale
    return Strips(strip, bulge, smooth, region, wide & strip, band, cap_mm, lift_mm)


def _bulges(hull: Hull, angle: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the bulge of a curve over both facets of each edge (e, 2), and a mask of long sides.

    Along the sides of a facet, not across its ends, is where a strip is recognised.
    """
    start, end = hull.corners_mm[hull.edge_ends[:, 0]], hull.corners_mm[hull.edge_ends[:, 1]]
    length = np.linalg.norm(end - start, axis=1)[:, None]
    areas = hull.areas_mm2[hull.edge_facets]
    # the width beyond an edge, as of a strip of that length and the facet's area
    width = areas / np.maximum(length, np.sqrt(areas))
    return np.asarray(width / 2 * np.tan(angle / 4)[:, None]), np.asarray(length >= np.sqrt(areas))


def merge_hollows(hull: Hull, land: Landscape, strips: Strips) -> tuple[IntArray, FloatArray]:
    """Return each facet's bottom of its hollow (f,), false hollows filled, and probabilities (f,).

    Passes are gone through from the lowest up. Where two hollows meet, the shallower one ends; it
    was never one if it is a strip's and the climb out of it is no more than the strip's bulge.
    First hollows of one curve become one; then what is left narrow, as the balance on a rounded
    corner, falls to what lies beside, to each side alike. A wide one stays: a shaft with two flats
    rests on its round too, wherever it stops.

    Parameters
    ----------
    hull : hull of the part, f facets
    land : final facet of the part from each of its facets
    strips : mask of the facets that are pieces of a curve
    """
    rest = land.rest
    a, b = rest[hull.edge_facets[:, 0]], rest[hull.edge_facets[:, 1]]
    allowed = np.where(
        strips.is_strip,
        np.clip(BULGE_MARGIN * strips.bulge_mm, strips.lift_mm, strips.cap_mm),
        0.0,
    )
    heights = hull.heights_mm
    # most passes join nothing: the climb is too long for any strip
    climb = land.pass_mm - np.maximum(heights[a], heights[b])
    worth = strips.is_smooth & (a != b) & (climb <= strips.cap_mm)
    order = np.flatnonzero(worth)[np.argsort(land.pass_mm[worth], kind="stable")]
    a, b, top = a[order], b[order], land.pass_mm[order]
    parent = np.arange(hull.count)
    curved = strips.is_strip
    inner = curved[a] & curved[b]
    _fill(parent, heights, allowed, a[inner], b[inner], top[inner])
    bottom = parent[rest]
    held = distinct(rest)
    cosine = np.ones(hull.count)
    aligned = np.einsum("ij,ij->i", hull.normals[held], hull.normals[parent[held]])
    np.minimum.at(cosine, parent[held], aligned)
    narrow = np.where(cosine > np.cos(NARROW_RAD), allowed, 0.0)
    before = bottom
    if len(a):
        a, b = parent[a], parent[b]
        _fill(parent, heights, narrow, a, b, top)
        bottom = parent[rest]
    probabilities: FloatArray = np.bincount(
        before, land.probabilities, minlength=hull.count
    ).astype(np.float64)
    for fallen in np.unique(before[bottom != before]).tolist():
        out = ((a == fallen) | (b == fallen)) & (top - heights[fallen] <= narrow[fallen])
        to = np.unique(parent[np.where(a == fallen, b, a)[out]])
        share, probabilities[fallen] = probabilities[fallen] / max(len(to), 1), 0.0
        probabilities[to if len(to) else parent[fallen]] += share
    return np.asarray(bottom, dtype=np.int64), probabilities


def _fill(
    parent: IntArray,
    heights: FloatArray,
    allowed: FloatArray,
    a: IntArray,
    b: IntArray,
    top: FloatArray,
) -> None:
    """Join hollows a and b (n,) over passes in rising order where the shallower is false."""
    up = parent.tolist()
    height, limit = heights.tolist(), allowed.tolist()

    def bottom(i: int) -> int:
        while up[i] != i:
            up[i] = up[up[i]]
            i = up[i]
        return i

    passes = chain.from_iterable(  # millions of numbers as objects are a quarter of a gigabyte
        zip(a[span].tolist(), b[span].tolist(), top[span].tolist(), strict=True)
        for span in spans(len(a))
    )
    for i, j, pass_mm in passes:
        # as `bottom` does, without a call for each of millions of passes
        p, q = i, j
        while up[p] != p:
            up[p] = p = up[up[p]]
        while up[q] != q:
            up[q] = q = up[up[q]]
        if p == q:
            continue
        if (height[p], p) < (height[q], q):
            p, q = q, p
        if pass_mm - height[p] <= limit[p]:
            up[p] = q
    touched = distinct(np.concatenate([a, b]))
    parent[touched] = [bottom(i) for i in touched.tolist()]
    parent[:] = parent[parent]
