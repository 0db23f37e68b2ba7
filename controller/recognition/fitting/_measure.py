"""Two measures of an edge near its predicted place: by the outline, and by grey levels.

Before a backlight the outline is known whole. Elsewhere an edge is looked for in the grey
levels, along the normal of the predicted one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, Float32Array, FloatArray, Grey
from controller.imaging import Contour, loop_normals, sample_picture, signed_area

from ._predict import ModelEdgePoints

TURN_PX = 5.0  # distance added for an outline that runs the other way
FAINT = 0.03  # weight of an edge between surfaces that look alike from the camera
PLAIN_LIFT = 0.4  # difference in brightness (cosines) from which an edge must be seen
PLAIN_JUMP_MM = 4.0  # height of a step that must show by its shadow
CLEAR_LIFT = 0.4  # difference in brightness from which the brighter side is clear
SHARED_PX = 4.5  # reach of the search below which each edge belongs to the nearest prediction
OWN_PX = 0.8  # distance by which another prediction must be nearer
WRONG_SIGN = 0.3  # weight of an edge that is bright on the other side
BLURRED_PX = 2.5  # distance beside a part's own edge within which the camera's blur leaves slope
SOFT = 0.5  # share of the slope that is left there on both sides where a half-shadow begins or ends
SEEN_PX = 1  # distance within which another lamp's picture must show the same edge
SEEN_SHARE = 0.2  # least strength of that edge, as a share of the strongest
SIDE_PX = 1.0  # profiles are sampled at whole pixels, peaks between them by a parabola


@dataclass(frozen=True, eq=False, slots=True)
class Gaps:
    """Edges found beside predicted points.

    Attributes
    ----------
    gap_px : (n,) distance of the edge along the predicted normal, NaN where none was found
    weight : (n,) weight of each, 0..1
    """

    gap_px: FloatArray
    weight: FloatArray


class Measure(Protocol):
    """A way to find edges in a picture.

    Attributes
    ----------
    sees_inside : edges inside the outline are found too
    """

    sees_inside: bool

    def gaps(
        self, pixels: FloatArray, normals: FloatArray, edges: ModelEdgePoints, reach_px: float
    ) -> Gaps:  # pragma: no cover - protocol
        """Return the edges within reach of predicted points.

        Parameters
        ----------
        pixels : (n, 2) present positions of the points, x before y, in the whole picture
        normals : (n, 2) unit, by now, square to the edge
        edges : predicted edges: n samples, the mask of the outline, and the brighter side
        reach_px : range of the search along the normal, to both sides
        """
        ...


class OutlineMeasure:
    """Edges as points of a whole known outline; edges inside it are not seen.

    Parameters
    ----------
    outline : observed, to a fraction of a pixel
    judged : (height, width) pixels of the picture where the outline is the part's own; None for
        all
    """

    sees_inside = False

    def __init__(self, outline: Contour, judged: BoolArray | None = None) -> None:
        self._judged = judged
        own = self.is_judged(outline.points_px)
        self.points, self.normals = outline.points_px[own], outline.normals[own]
        self._tree = cKDTree(np.hstack([self.points, TURN_PX * self.normals]))

    @classmethod
    def of_loops(cls, loops_px: tuple[FloatArray, ...]) -> "OutlineMeasure":
        """Return the measure of closed loops (n, 2), ordered, either way round.

        The largest is the outer one.
        """
        areas = [signed_area(loop) for loop in loops_px]
        outer = int(np.argmax(np.abs(areas))) if areas else -1
        normals = [
            loop_normals(loop) * np.sign(area) * (1.0 if i == outer else -1.0)
            for i, (loop, area) in enumerate(zip(loops_px, areas, strict=True))
        ]
        nothing = np.zeros((0, 2))
        return cls(
            Contour(
                np.concatenate(loops_px) if loops_px else nothing,
                np.concatenate(normals) if normals else nothing,
            )
        )

    def is_judged(self, pixels: FloatArray) -> BoolArray:
        """Return a mask (n,) of the points (n, 2) of the picture with the part's own outline."""
        if self._judged is None:
            return np.ones(len(pixels), dtype=np.bool_)
        height, width = self._judged.shape
        x, y = np.round(pixels).astype(np.int64).T
        inside = (x > 1) & (y > 1) & (x < width - 2) & (y < height - 2)
        inside[inside] = self._judged[y[inside], x[inside]]
        return np.asarray(inside)

    def gaps(
        self, pixels: FloatArray, normals: FloatArray, edges: ModelEdgePoints, reach_px: float
    ) -> Gaps:
        """Return the distances to the nearest outline that runs the same way; as `Measure.gaps`.

        Parameters
        ----------
        pixels, normals : (n, 2) pixels and normals of the predicted points by now; normals away
            from the part
        edges : not asked: all of it is outline
        reach_px : beyond which nothing is found
        """
        asked = np.hstack([pixels, TURN_PX * normals])
        distance, nearest = self._tree.query(asked, distance_upper_bound=reach_px + TURN_PX)
        near = np.isfinite(distance) & self.is_judged(pixels)
        nearest = np.where(near, nearest, 0)
        away = self.points[nearest] - pixels
        agrees = (self.normals[nearest] * normals).sum(axis=1)
        along = (away * self.normals[nearest]).sum(axis=1)
        good = near & (agrees > 0.5) & (np.abs(along) < reach_px)
        return Gaps(np.where(good, along, np.nan), np.ones(len(pixels)))


class GreyMeasure:
    """Edges as peaks of the grey-level gradient.

    In a scene under several lamps, one at a time, the gradient at each pixel is that of the lamp
    with the strongest one. A pose has to explain only the edges of the crop: if that is the
    brightest of all lamps' pictures, it has no shadows.

    Parameters
    ----------
    crop : (h, w) grey
    corner_px : (x0, y0) corner of the crop in the picture
    is_lit : True under lamps, where surfaces that face the camera are brighter
    others : (h, w) of the same scene, each under one lamp

    Attributes
    ----------
    gx, gy : (h, w) the strongest gradient [grey levels / px]
    own : the same of the crop alone
    is_joint : the crop is the brightest of several lamps' pictures, and no edge in it a shadow's
    """

    sees_inside = True

    def __init__(
        self,
        crop: Grey,
        corner_px: tuple[int, int],
        *,
        is_lit: bool,
        others: Sequence[Grey] = (),
    ) -> None:
        slopes = [_slope(one) for one in (crop, *others)]
        self.own = slopes[0]
        self.gx, self.gy = _strongest(slopes) if others else self.own
        self.corner = np.array(corner_px, dtype=np.float64)
        self.is_joint = len(others) > 0
        noises = [1.48 * float(np.median(np.abs(gx[::3, ::3]))) + 0.05 for gx, _ in slopes]
        self.noise = max(noises)
        self._lamps = tuple(zip(slopes, noises, strict=True))[1:]
        self._is_lit = is_lit

    def gaps(
        self, pixels: FloatArray, normals: FloatArray, edges: ModelEdgePoints, reach_px: float
    ) -> Gaps:
        """Return the strongest edges near predicted points, nearer ones preferred.

        Parameters
        ----------
        pixels, normals : (n, 2) pixels and normals of the predicted points by now, in the whole
            picture
        edges : predicted edges; under lamps, the brighter side decides between two
        reach_px : about which edges count less and less; with a short one, no edge is taken by two
            points
        """
        steps = np.arange(-np.ceil(reach_px) - 1, np.ceil(reach_px) + 2) * SIDE_PX
        slope = self._profiles((self.gx, self.gy), pixels, normals, steps)
        gap = self._peaks(slope, steps, edges, reach_px, self.noise)
        if reach_px <= SHARED_PX:
            gap[_is_anothers(pixels, normals, gap)] = np.nan
        weight = visibility(edges) if self._is_lit else np.ones(len(pixels))
        return Gaps(gap, weight)

    def shown_by_any(
        self, edges: ModelEdgePoints, reach_px: float, aside_px: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return the nearest edges that any of several lamps shows, at predictions and beside them.

        The strongest gradient of all lamps may be the border of one lamp's shadow, a pixel or two
        from an edge that another lamp shows well.

        Parameters
        ----------
        edges : as they were predicted
        reach_px : range of the search along the normal, to both sides
        aside_px : distance beside the predictions that is searched too

        Returns
        -------
        how far along the normal the edge is, (n,), and the same from places on both sides, (2, n);
        NaN where none is found
        """
        wide, half = int(np.ceil(reach_px)) + 1, aside_px
        steps = np.arange(-wide - half, wide + half + 1, dtype=np.float64) * SIDE_PX
        about = steps[half:-half]
        near = np.full((3, len(edges.pixels)), np.nan)
        for slopes, noise in self._lamps:
            slope = self._profiles(slopes, edges.pixels, edges.normals, steps)
            for row, begin in enumerate((half, 0, 2 * half)):
                beside = slope[begin : begin + len(about)]
                gap = self._peaks(beside, about, edges, reach_px, noise)
                is_nearer = ~(np.abs(gap) >= np.abs(near[row])) & np.isfinite(gap)
                near[row] = np.where(is_nearer, gap, near[row])
        near[0, _is_anothers(edges.pixels, edges.normals, near[0])] = np.nan
        return near[0], near[1:]

    def _profiles(
        self,
        slopes: tuple[Float32Array, Float32Array],
        pixels: FloatArray,
        normals: FloatArray,
        steps: FloatArray,
    ) -> Float32Array:
        """Return gradients along normals, one row for each step."""
        at_x, at_y = np.ascontiguousarray((pixels - self.corner).T)
        normal_x, normal_y = np.ascontiguousarray(normals.T)
        x = (at_x + steps[:, None] * normal_x).astype(np.float32)
        y = (at_y + steps[:, None] * normal_y).astype(np.float32)
        slope = sample_picture(slopes[0], x, y) * normal_x.astype(np.float32)
        slope += sample_picture(slopes[1], x, y) * normal_y.astype(np.float32)
        return np.asarray(slope, np.float32)

    def _peaks(
        self,
        slope: Float32Array,
        steps: FloatArray,
        edges: ModelEdgePoints,
        reach_px: float,
        noise: float,
    ) -> FloatArray:
        """Return the place (n,) of each profile's strongest peak, near ones preferred; NaN if none.

        Parameters
        ----------
        slope : (k, n) profiles
        steps : (k,) positions of their rows, about 0
        edges, reach_px : as `gaps`
        noise : noise of the picture
        """
        size = np.abs(slope)
        nearness = np.exp(-0.5 * (steps / max(reach_px, 1.0)) ** 2).astype(np.float32)
        inner = size[1:-1]
        is_peak = (inner >= size[:-2]) & (inner >= size[2:]) & (inner > 3 * noise)
        worth = np.where(is_peak, inner * nearness[1:-1, None], np.float32(-1.0))
        if self._is_lit:
            is_clear = ~edges.on_outline & (np.abs(edges.lift) > CLEAR_LIFT)
            brighter = np.where(is_clear, np.sign(edges.lift), 0.0).astype(np.float32)
            wrong_sign = slope[1:-1] * brighter < 0
            worth = np.where(wrong_sign, worth * np.float32(WRONG_SIGN), worth)
        best = worth.argmax(axis=0)
        columns = np.arange(slope.shape[1])
        found = worth[best, columns] > 0
        before, at, after = (size[best + k, columns].astype(np.float64) for k in range(3))
        bow = before - 2 * at + after
        offset = np.where(bow < -1e-9, 0.5 * (before - after) / np.minimum(bow, -1e-9), 0.0)
        gap = steps[1:-1][best] + np.clip(offset, -0.5, 0.5) * SIDE_PX
        gap[~found] = np.nan
        return np.asarray(gap)

    def are_sharp(self, points_px: FloatArray, normals: FloatArray) -> BoolArray:
        """Return a mask (n,) of edges of the crop as sharp as a part's own, on one side at least.

        Where a lamp's half-shadow begins or ends, brightness changes slowly on both sides.

        Parameters
        ----------
        points_px : (n, 2) x before y, in the whole picture
        normals : (n, 2) unit, up the gradient
        """
        steps = np.array([0.0, -BLURRED_PX, BLURRED_PX])
        slope = np.abs(self._profiles(self.own, points_px, normals, steps))
        return np.asarray(slope[1:].min(axis=0) < SOFT * slope[0])

    def are_seen_twice(self, points_px: FloatArray, normals: FloatArray) -> BoolArray:
        """Return a mask (n,) of edges of the crop shown by several lamps, as no shadow's border is.

        Parameters
        ----------
        points_px : (n, 2) x before y, in the whole picture
        normals : (n, 2) unit, up the gradient
        """
        steps = np.arange(-SEEN_PX, SEEN_PX + 1, dtype=np.float64)
        slopes = [self._profiles(slopes, points_px, normals, steps) for slopes, _ in self._lamps]
        size = np.abs(slopes).max(axis=1)
        noises = 3 * np.array([noise for _, noise in self._lamps])
        is_seen = (size > noises[:, None]) & (size > SEEN_SHARE * size.max(axis=0))
        return np.asarray(is_seen.sum(axis=0) > 1)


def _slope(crop: Grey) -> tuple[Float32Array, Float32Array]:
    """Return a picture's gradient along x and y (h, w) [grey levels / px]."""
    smooth = cv2.GaussianBlur(crop, (0, 0), 0.8).astype(np.float32)
    # Scharr turns with the edge; 1/32 makes it grey levels a pixel
    gx = np.asarray(cv2.Scharr(smooth, cv2.CV_32F, 1, 0, scale=1 / 32), np.float32)
    return gx, np.asarray(cv2.Scharr(smooth, cv2.CV_32F, 0, 1, scale=1 / 32), np.float32)


def _strongest(
    slopes: Sequence[tuple[Float32Array, Float32Array]],
) -> tuple[Float32Array, Float32Array]:
    """Return the strongest of several gradients at each pixel."""
    gx, gy = (one.copy() for one in slopes[0])
    size = cv2.magnitude(gx, gy)
    for other_x, other_y in slopes[1:]:
        other = cv2.magnitude(other_x, other_y)
        leads = other > size
        for kept, new in ((gx, other_x), (gy, other_y), (size, other)):
            np.copyto(kept, new, where=leads)
    return gx, gy


def _tree(points: FloatArray) -> cKDTree:
    """Return a tree for a single query; a better one takes longer to build than it saves."""
    return cKDTree(points, balanced_tree=False, compact_nodes=False)


def _is_anothers(pixels: FloatArray, normals: FloatArray, gap: FloatArray) -> BoolArray:
    """Return a mask (n,) of the edges found that belong to another, nearer predicted edge.

    Where a narrow chamfer is nearly as dark as the table only one of its two edges shows, and
    the other must not claim it.
    """
    asked = np.flatnonzero(np.abs(gap) > OWN_PX)
    answer = np.zeros(len(gap), dtype=np.bool_)
    if len(asked) == 0:
        return answer
    at = pixels[asked] + gap[asked, None] * normals[asked]
    nearer = np.abs(gap[asked]) - OWN_PX
    distance, nearest = _tree(pixels).query(at, distance_upper_bound=float(nearer.max()))
    some = np.flatnonzero(distance < nearer)
    asked, nearest = asked[some], np.asarray(nearest)[some]
    answer[asked] = np.abs((normals[nearest] * normals[asked]).sum(axis=1)) > 0.7
    return answer


def visibility(edges: ModelEdgePoints) -> FloatArray:
    """Return the visibility of predicted edges under lamps, (n,) 0..1.

    Surfaces that are turned differently are lit differently; a step throws a shadow or hides light.
    An outline shows by the surface beside it: a wall seen edge-on is as dark as a table.
    """
    turned = np.abs(edges.lift) / PLAIN_LIFT
    stepped = edges.jump_mm / PLAIN_JUMP_MM
    return np.asarray(np.clip(np.maximum(turned, stepped), FAINT, 1.0))
