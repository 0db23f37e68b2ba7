"""Rolling of bodies of revolution: bands of hull facets between two rims, or a rim and an apex.

Facets alone hardly distinguish such a band from planes: two rims that are divided differently are
bridged by triangles of very unequal areas, and a chamfer beside a band looks like a curve above it.
The axis decides: spun about it, the corners of a hull are circles, and the hull of these circles'
profile has one straight side for each band.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from controller.arrays import BoolArray, FloatArray, IntArray, square_to

from ..boundary import Face
from ..graph import components
from ._curves import LARGE_MM, PLANE_RATIO, SMOOTH_RAD, Strips
from ._hull import Hull

MAX_AXES = 6  # axes tried, those of the largest surfaces
SAME_AXIS = 1e-4  # sine of the largest angle between two axes that count as one
SAME_AXIS_MM = 0.1  # their largest distance; a cut plane's centre may be this far off
RIM_MM = 0.02  # corners of one rim stray this far from its circle; a large part's in proportion
MIN_FACETS = 6  # a band of fewer is no round
WIDE_SPAN = 2.0  # a facet that spans this many times what is usual is a flat cut into the round
USUAL_SHARE = 0.9  # share of a band's facets that span no more than is usual


@dataclass(frozen=True, eq=False, slots=True)
class HullProfile:
    """The convex hull of a body of revolution, cut along its axis, from one end to the other.

    Attributes
    ----------
    rims : (k, 2) distances along the axis and off it [mm]; the ends are discs, or apexes on the
        axis
    """

    rims: FloatArray

    def is_flat(self, band: int, cap_mm: float) -> bool:
        """Return True if a side of the profile is straight, not one chord of a curved wall."""
        lengths, turns = self._lengths, self._turns
        here = lengths[band]
        for beside, turn in ((band - 1, turns[band]), (band + 1, turns[band + 1])):
            there = lengths[beside] if 0 <= beside < len(lengths) else 0.0
            stands_out = here / 2 * np.tan(turn / 4) > cap_mm
            if turn < SMOOTH_RAD and here <= PLANE_RATIO * there and not stands_out:
                return False
        return True

    @property
    def _lengths(self) -> FloatArray:
        return np.asarray(np.linalg.norm(np.diff(self.rims, axis=0), axis=1))

    @property
    def _turns(self) -> FloatArray:
        """Turn of the profile at each rim (k,) [rad]; at the ends to the disc there."""
        along = np.diff(self.rims, axis=0)
        ways = np.arctan2(along[:, 1], along[:, 0])
        ways = np.concatenate([[np.pi / 2], ways, [-np.pi / 2]])
        return np.abs(np.diff(ways))


def with_rings(hull: Hull, strips: Strips, axes: tuple[FloatArray, FloatArray]) -> Strips:
    """Return the strips with bands round an axis added, each band a curve of its own.

    Parameters
    ----------
    hull : hull of the part
    strips : found in the facets alone
    axes : directions (a, 3) and points on them (a, 3), from the centre of mass, CAD frame's axes
    """
    n1, n2 = (hull.normals[hull.edge_facets[:, side]] for side in (0, 1))
    smooth = np.einsum("ij,ij->i", n1, n2) > np.cos(SMOOTH_RAD)
    for direction, point in zip(*axes, strict=True):
        for ring, bulge_mm in _rings(hull, strips, smooth, direction, point):
            strips = _joined(hull, strips, smooth, ring, bulge_mm)
    return strips


def axes_of(faces: tuple[Face, ...], centre_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return directions (a, 3) and points (a, 3), from a centre, of possible axes of revolution.

    Parameters
    ----------
    faces : faces of the part; a disc's axis is its normal
    centre_mm : (3,) origin of the points, CAD frame
    """
    directions: list[FloatArray] = []
    points: list[FloatArray] = []
    # a wall's axis is fitted, a plane's centre only is where its area is
    for face in sorted(faces, key=lambda f: (f.kind == "plane", -f.area_mm2)):
        direction = face.normal if face.kind == "plane" else face.axis
        length = float(np.linalg.norm(direction))
        if face.kind in {"sphere", "freeform"} or length < 0.5:
            continue
        direction, point = direction / length, face.centre_mm - centre_mm
        if any(_is_one(direction, point, a, p) for a, p in zip(directions, points, strict=True)):
            continue
        directions.append(direction)
        points.append(point)
        if len(directions) == MAX_AXES:
            break
    return np.reshape(directions, (-1, 3)), np.reshape(points, (-1, 3))


def _is_one(a: FloatArray, p: FloatArray, b: FloatArray, q: FloatArray) -> bool:
    off = (p - q) - ((p - q) @ b) * b
    return bool(np.linalg.norm(np.cross(a, b)) < SAME_AXIS and np.linalg.norm(off) < SAME_AXIS_MM)


def _rings(
    hull: Hull, strips: Strips, smooth: BoolArray, axis: FloatArray, point: FloatArray
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Yield each band round an axis: its facets (n,), and the bulge over them (n,)."""
    arm = hull.corners_mm - point
    along = arm @ axis
    out = arm - along[:, None] * axis
    off = np.linalg.norm(out, axis=1)
    near = RIM_MM * max(1.0, float(hull.heights_mm.max(initial=0.0)) / LARGE_MM)
    profile = _profile(np.column_stack([along, off]), near)
    if profile is None:
        return
    spans = _spans(hull, axis, out, off > near)
    level = hull.normals @ axis
    upright = np.linalg.norm(hull.normals - level[:, None] * axis, axis=1)
    for band in range(len(profile.rims) - 1):
        if not profile.is_flat(band, strips.cap_mm):
            continue
        rims = profile.rims[[band, band + 1]]
        is_on = np.abs(np.column_stack([along, off]) @ _across(rims) - rims[0] @ _across(rims))
        inside = ~strips.is_band
        inside[hull.facet[(is_on[hull.triangles] > near).any(axis=1)]] = False
        ids = np.flatnonzero(inside & (level * _across(rims)[0] + upright * _across(rims)[1] > 0.9))
        if len(ids) < MIN_FACETS:
            continue
        # the height of the part spun about the axis, over each facet, seen in its own direction
        reach = (level[ids, None] * rims[:, 0] + upright[ids, None] * rims[:, 1]).max(axis=1)
        bulge = reach - (hull.heights_mm[ids] - hull.normals[ids] @ point)
        usual = float(np.quantile(spans[ids], USUAL_SHARE, method="lower"))
        chosen = (spans[ids] <= WIDE_SPAN * usual) & (bulge <= strips.cap_mm)
        for ring in _smooth_runs(hull, smooth, ids[chosen]):
            yield ring, np.maximum(bulge[np.searchsorted(ids, ring)], 0.0)


def _profile(points: FloatArray, near: float) -> HullProfile | None:
    """Return the hull of points (n, 2), along and off an axis, as rims; None if they have none."""
    both = np.concatenate([points, points * [1.0, -1.0]])
    try:
        around = both[ConvexHull(both).vertices]  # anticlockwise
    except QhullError:
        return None
    upper = around[around[:, 1] > -near]
    middle = (around[:, 0].max() + around[:, 0].min()) / 2
    upper = upper[np.argsort(-np.arctan2(upper[:, 1], upper[:, 0] - middle), kind="stable")]
    rims = [upper[0]]
    for rim in upper[1:]:
        if np.linalg.norm(rim - rims[-1]) > 2 * near:
            rims.append(rim)
    # an apex, or a disc's own middle, below the axis by noise
    return HullProfile(np.maximum(np.array(rims), [-np.inf, 0.0])) if len(rims) > 1 else None


def _across(rims: FloatArray) -> FloatArray:
    """Return the outward direction (2,), along and off the axis, of the side between two rims."""
    side = rims[1] - rims[0]
    return np.asarray(np.array([-side[1], side[0]]) / np.linalg.norm(side))


def _spans(hull: Hull, axis: FloatArray, out: FloatArray, is_off: BoolArray) -> FloatArray:
    """Return each facet's extent round an axis (f,) [rad]; an apex on the axis counts nothing."""
    e1 = square_to(axis)[0]
    e2 = np.cross(axis, e1)
    facing = np.arctan2(hull.normals @ e2, hull.normals @ e1)[hull.facet]
    turn = np.arctan2(out @ e2, out @ e1)[hull.triangles] - facing[:, None]
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    turn[~is_off[hull.triangles]] = 0.0
    low, high = np.zeros(hull.count), np.zeros(hull.count)
    np.minimum.at(low, hull.facet, turn.min(axis=1))
    np.maximum.at(high, hull.facet, turn.max(axis=1))
    return np.asarray(high - low)


def _smooth_runs(hull: Hull, smooth: BoolArray, ids: IntArray) -> list[IntArray]:
    """Return runs of neighbouring facets (n,) with little turn from one to the next."""
    local = np.full(hull.count, -1)
    local[ids] = np.arange(len(ids))
    pairs = local[hull.edge_facets]
    pairs = pairs[(pairs >= 0).all(axis=1) & smooth]
    run = components(len(ids), pairs[:, 0], pairs[:, 1])
    runs = [ids[run == number] for number in np.unique(run)]
    return [found for found in runs if len(found) >= MIN_FACETS]


def _joined(
    hull: Hull, strips: Strips, smooth: BoolArray, ring: IntArray, bulge_mm: FloatArray
) -> Strips:
    """Return strips with the facets (n,) of one band made one curve."""
    is_strip, bulge = strips.is_strip.copy(), strips.bulge_mm.copy()
    region, is_band = strips.region.copy(), strips.is_band.copy()
    is_strip[ring], bulge[ring], is_band[ring] = True, bulge_mm, True
    region[ring] = region.max() + 1
    inside = np.isin(hull.edge_facets, ring).any(axis=1)
    return replace(
        strips,
        is_strip=is_strip,
        bulge_mm=bulge,
        region=region,
        is_band=is_band,
        is_smooth=strips.is_smooth | (smooth & inside),
    )
