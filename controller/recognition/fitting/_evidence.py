"""The evidence for a fitted pose and against it, as figures for a decision.

Two questions, each asked both ways: is the prediction in the picture, and is the content of the
picture predicted?
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, FloatArray
from controller.cad.graph import components

from ._fit import EdgeFit
from ._measure import GreyMeasure, OutlineMeasure, visibility
from ._predict import ModelEdgePoints
from ._shade import Shading

Shine = Callable[[FloatArray, FloatArray], BoolArray]
Shade = Callable[[FloatArray], BoolArray]

NEAR_PX = 1.3  # an edge this near its prediction is where it should be
FAR_PX = 2.5
# Largest misfit of an outline that is still the part. Of 596 right hypotheses on path-traced
# silhouettes one exceeded it, of near wrong ones nine in ten: a part cut short is another part.
MAX_MISFIT_PX = 0.65
STRONG_NOISES = 8.0
STRONG_SHARE = 0.12  # share of the picture's own strong edges, for pictures without noise
# Grey levels / px; a weaker edge may come from rounding of a slow slope to whole levels.
ROUNDED = 1.0
MAX_EDGES = 1200
APART_PX = 3.0  # distance from the outline within which an inner edge cannot be told from it
ASIDE_PX = 5  # distance beside an edge at which another would be found by chance only
MAX_POINTS = 700  # points of an outline tested for a prediction
ALONE_MM = 1.2  # distance from all predictions beyond which an edge is not a side of one
SHADED_MM = 20.0  # length of an edge from which the part's own shade is considered as its cause
LINK_PX = 3.5  # largest gap between pixels of one edge, which is thin and broken by noise


@dataclass(frozen=True, eq=False, slots=True)
class ImageEdges:
    """Pixels of a crop at which the grey level jumps.

    Attributes
    ----------
    points_px : (n, 2) in the picture
    normals : (n, 2) unit, up the gradient
    strength : (n,) gradient [grey levels / px]
    every : one in so many is kept
    """

    points_px: FloatArray
    normals: FloatArray
    strength: FloatArray
    every: int = 1

    @property
    def length_px(self) -> int:
        """Length of all edges together in pixels, those left out among them."""
        return len(self.points_px) * self.every

    def length_mm(self, mm_per_px: float) -> float:
        """Return the length of all edges together [mm], those left out among them."""
        return self.length_px * mm_per_px

    def at(self, which: BoolArray) -> "ImageEdges":
        """Return the edge pixels of a mask (n,)."""
        return replace(
            self,
            points_px=self.points_px[which],
            normals=self.normals[which],
            strength=self.strength[which],
        )

    @staticmethod
    def of(measure: GreyMeasure, within: BoolArray, most: int = MAX_EDGES) -> "ImageEdges":
        """Return the ridges of the gradient inside a region of the crop.

        Parameters
        ----------
        measure : gradient of the crop
        within : (h, w)
        most : about so many pixels are kept
        """
        gx, gy = measure.own
        size = cv2.magnitude(gx, gy)
        inside = size[within]
        if inside.size == 0:
            return ImageEdges(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
        top = float(np.quantile(inside[:: max(1, inside.size // 5000)], 0.98))
        level = max(STRONG_NOISES * measure.noise, STRONG_SHARE * top, ROUNDED)
        v, u = np.nonzero((size > level) & within)
        inner = (v > 0) & (u > 0) & (v < size.shape[0] - 1) & (u < size.shape[1] - 1)
        v, u = v[inner], u[inner]
        nx, ny = gx[v, u] / size[v, u], gy[v, u] / size[v, u]
        # nearest neighbours up and down the gradient
        du, dv = np.rint(nx).astype(int), np.rint(ny).astype(int)
        ridge = (size[v, u] >= size[v + dv, u + du]) & (size[v, u] > size[v - dv, u - du])
        v, u, nx, ny = v[ridge], u[ridge], nx[ridge], ny[ridge]
        every = max(1, len(v) // most)
        v, u, nx, ny = v[::every], u[::every], nx[::every], ny[::every]
        points = np.column_stack([u, v]).astype(np.float64) + measure.corner
        normals = np.column_stack([nx, ny]).astype(np.float64)
        return ImageEdges(points, normals, size[v, u].astype(np.float64), every)


@dataclass(frozen=True, slots=True)
class Evidence:
    """Evidence of a picture for a pose; shares are of length, 0..1.

    Attributes
    ----------
    outline : share of the predicted outline that is in place
    explained : share of the observed outline, or of the picture's strong edges, that is predicted
    inner : share of the predicted edges inside that is present, weighted by how clearly they should
        show
    inner_mm : length of these, by how well they should show
    chance : chance of finding such edges beside their predictions: marks, dust and grain; known if
        a pose is compared with others by its inside, and for a lone part under several lamps
    image_px : length of the picture's strong edges in pixels: in few pixels, chance explains as
        much of them as in many is explained by the right pose alone
    unexplained_mm : length of the longest connected one of the picture's strong and sharp edges
        that nothing predicted is near: a hole, a step or a groove that the part does not have. 0
        under one lamp, where it may be a shadow's
    inner_explained : share of the picture's strong edges inside the part that is predicted
    image_mm : length of these
    sigma_px : standard deviation of the edges found
    misfit_px : root mean square distance of the predicted outline from what is seen; what is not
        found counts as `FAR_PX`
    outline_mm : length of the predicted outline
    shading : share of the brightness' variation inside that the surfaces' turn explains
    residual : variance of the brightness that is left [grey levels squared]; of several pictures
        the geometric mean
    area_mm2 : area examined, in all pictures
    """

    outline: float
    explained: float
    inner: float
    inner_mm: float
    inner_explained: float
    image_mm: float
    sigma_px: float
    misfit_px: float
    outline_mm: float
    shading: float
    residual: float
    area_mm2: float
    chance: float = 0.0
    image_px: float = 0.0
    unexplained_mm: float = 0.0


def outline_evidence(fit: EdgeFit, outline: OutlineMeasure, mm_per_px: float) -> Evidence:
    """Return the evidence of a known outline for a fit; it holds nothing of the inside.

    Parameters
    ----------
    fit : fit of the outline's predicted edges alone
    outline : observed
    mm_per_px : at the object
    """
    off = np.fmin(np.abs(fit.gaps.gap_px), FAR_PX)
    step_px = fit.edges.step_mm / mm_per_px
    points = outline.points[:: max(1, len(outline.points) // MAX_POINTS)]
    return Evidence(
        outline=_share(off < NEAR_PX),
        explained=_share(is_predicted(points, fit.edges, step_px)),
        inner=0.0,
        inner_mm=0.0,
        inner_explained=0.0,
        image_mm=0.0,
        sigma_px=fit.sigma_px,
        misfit_px=_root_mean_square(off),
        outline_mm=len(off) * fit.edges.step_mm,
        shading=0.0,
        residual=0.0,
        area_mm2=0.0,
    )


def with_inside(
    known: Evidence,
    edges: ModelEdgePoints,
    mm_per_px: float,
    greys: Sequence[GreyMeasure],
    shown: Sequence[tuple[ImageEdges, Shading]],
) -> Evidence:
    """Return evidence from an outline with that from inside it.

    Parameters
    ----------
    known : of the outline alone
    edges : all visible edges at the fitted pose
    mm_per_px : at the object
    greys : the pictures that edges inside the part are looked for in; one is enough for an edge
    shown : for each picture that shows the inside, its strong edges in the part and `shading_fits`
    """
    own = _apart_from_outline(edges)
    first = grey_evidence(own, known.sigma_px, mm_per_px, greys, *shown[0])
    others = [_explained(image_edges, own, mm_per_px) for image_edges, _ in shown[1:]]
    lengths_mm = [image_edges.length_mm(mm_per_px) for image_edges, _ in shown]
    image_mm = sum(lengths_mm)
    shares = (first.inner_explained, *others)
    explained_mm = sum(share * mm for share, mm in zip(shares, lengths_mm, strict=True))
    shading = Shading.of_all([shading for _, shading in shown])
    return replace(
        first,
        outline=known.outline,
        explained=known.explained,
        misfit_px=known.misfit_px,
        outline_mm=known.outline_mm,
        inner_explained=explained_mm / image_mm if image_mm > 0 else 0.0,
        image_mm=image_mm,
        shading=shading.explained,
        residual=shading.residual,
        area_mm2=shading.area_px * mm_per_px**2,
        chance=_chance(own, greys),
        image_px=float(sum(image_edges.length_px for image_edges, _ in shown)),
    )


def _apart_from_outline(edges: ModelEdgePoints) -> ModelEdgePoints:
    """Return edges without those inside that are too near the outline to tell apart."""
    on = edges.on_outline
    if not on.any():
        return edges
    far, _ = cKDTree(edges.pixels[on]).query(edges.pixels)
    return edges.at(on | (far > APART_PX))


def _chance(edges: ModelEdgePoints, greys: Sequence[GreyMeasure]) -> float:
    """Return the share of edges inside that would be found at any predicted place."""
    inner = ~edges.on_outline
    found: list[BoolArray] = []
    every = cKDTree(edges.pixels)
    for aside in (-ASIDE_PX, ASIDE_PX):
        pixels = edges.pixels + aside * edges.normals
        far, _ = every.query(pixels)
        free = inner & (far > APART_PX)
        found.append(_off_px(pixels, edges, greys)[free] < NEAR_PX)
    together = np.concatenate(found)
    return float(together.mean()) if len(together) else 0.0


def grey_evidence(
    edges: ModelEdgePoints,
    sigma_px: float,
    mm_per_px: float,
    greys: Sequence[GreyMeasure],
    image_edges: ImageEdges,
    shading: Shading,
    shine: Shine | None = None,
    shade: Shade | None = None,
    *,
    by_lamp: bool = False,
) -> Evidence:
    """Return the evidence of grey levels alone for a pose.

    Parameters
    ----------
    edges : all visible edges at that pose
    sigma_px : standard deviation of the fit that found it
    mm_per_px : at the object
    greys : the pictures edges are looked for in; one is enough for an edge
    image_edges : strong edges of the first, about the part
    shading : `shading_fits` of it; of several lamps' pictures, of all of them
    shine : tells which edges of a picture (points, normals) may be highlights of that pose: these
        need no explanation; None where all do
    shade : tells which points of a picture lie where the part shades itself: an edge there may be
        a shadow's under all lamps, and none of the part; None for no such place
    by_lamp : True for a measure of several lamps: each lamp's picture is searched by itself, and
        the chance of finding an edge is measured
    """
    on = edges.on_outline
    if by_lamp and greys[0].is_joint:
        off, chance = shown_edges(edges, greys[0], mm_per_px)
    else:
        off, chance = _off_px(edges.pixels, edges, greys), 0.0
    weight = visibility(edges)
    outline, inner, misfit_px = _found(off, on, weight)
    predicted = is_predicted(image_edges.points_px, edges, edges.step_mm / mm_per_px)
    if shine is not None:
        asked = predicted.copy()
        left = ~predicted
        asked[left] = ~shine(image_edges.points_px[left], image_edges.normals[left])
        image_edges, predicted = image_edges.at(asked), predicted[asked]
    # where the picture shows no strong edge, none is left to explain
    explained = _weighted(predicted, np.sqrt(image_edges.strength)) if len(predicted) else 1.0
    return Evidence(
        outline=outline,
        explained=explained,
        inner=inner,
        inner_mm=float(weight[~on].sum()) * edges.step_mm,
        inner_explained=explained,
        image_mm=image_edges.length_mm(mm_per_px),
        sigma_px=sigma_px,
        misfit_px=misfit_px,
        outline_mm=float(on.sum()) * edges.step_mm,
        shading=shading.explained,
        residual=shading.residual,
        area_mm2=shading.area_px * mm_per_px**2,
        chance=chance,
        image_px=float(image_edges.length_px),
        unexplained_mm=(
            longest_alone_mm(image_edges.at(~predicted), edges, mm_per_px, greys[0], shade)
            if greys[0].is_joint
            else 0.0
        ),
    )


def asked_of_each_lamp(
    known: Evidence, edges: ModelEdgePoints, shown: tuple[FloatArray, float]
) -> Evidence:
    """Return the evidence of edges that any of several lamps may show.

    Parameters
    ----------
    known : by the strongest gradient of all lamps
    edges : all visible edges at that pose
    shown : `shown_edges` of them
    """
    off, chance = shown
    outline, inner, misfit_px = _found(off, edges.on_outline, visibility(edges))
    return replace(known, outline=outline, inner=inner, misfit_px=misfit_px, chance=chance)


def _found(off: FloatArray, on: BoolArray, weight: FloatArray) -> tuple[float, float, float]:
    """Return the found shares of outline and inside, and the outline's misfit [px].

    Parameters
    ----------
    off : (n,) distance from each predicted edge to the nearest one found [px]
    on : (n,) mask of those on the outline
    weight : (n,) certainty with which they are visible
    """
    near = off < NEAR_PX
    misfit_px = float(np.sqrt(_weighted(off[on] ** 2, weight[on]))) if on.any() else FAR_PX
    return _weighted(near[on], weight[on]), _weighted(near[~on], weight[~on]), misfit_px


def longest_alone_mm(
    left: ImageEdges,
    edges: ModelEdgePoints,
    mm_per_px: float,
    grey: GreyMeasure,
    shade: Shade | None,
) -> float:
    """Return the length of the longest sharp edge without a predicted one near it [mm].

    Parameters
    ----------
    left : edges of the picture that are to be accounted for
    edges : all visible edges at a pose
    mm_per_px : at the object
    grey : the pictures that edges are sharp in or not
    shade : as `grey_evidence`
    """
    if len(left.points_px) == 0 or len(edges.pixels) == 0:
        return 0.0
    far_px, _ = cKDTree(edges.pixels).query(left.points_px)
    alone = left.at(np.asarray(far_px * mm_per_px > ALONE_MM))
    alone = alone.at(grey.are_sharp(alone.points_px, alone.normals))
    alone = alone.at(grey.are_seen_twice(alone.points_px, alone.normals))
    longest_mm = _connected_mm(alone, mm_per_px)
    if shade is None or longest_mm < SHADED_MM:
        return longest_mm
    return _connected_mm(alone.at(~shade(alone.points_px)), mm_per_px)


def _connected_mm(edges: ImageEdges, mm_per_px: float) -> float:
    """Return the length of the longest connected edge [mm]."""
    if len(edges.points_px) == 0:
        return 0.0
    longest = _longest(edges.points_px, LINK_PX * edges.every)
    return float(longest.sum()) * edges.every * mm_per_px


def _longest(points_px: FloatArray, link_px: float) -> BoolArray:
    """Return a mask of the points (n, 2) that are the longest chain of near ones."""
    links = cKDTree(points_px).query_pairs(link_px, output_type="ndarray")
    groups = components(len(points_px), links[:, 0], links[:, 1])
    return np.asarray(groups == np.bincount(groups).argmax())


def longest_missing(fit: EdgeFit) -> tuple[float, FloatArray] | None:
    """Return the longest connected edge of the predicted outline that is not seen.

    Parameters
    ----------
    fit : the fitted pose of an outline that is known whole

    Returns
    -------
    its length [mm], and its middle (3,), world: of a ring the centre, else a point of it; None for
    no edge that is longer than noise makes one, and where most of the outline is elsewhere, so that
    none of its edges is the reason
    """
    edges = fit.edges.at(fit.edges.on_outline & (fit.off_px > NEAR_PX))
    count = len(edges.points_mm)
    if count == 0 or 2 * count > int(fit.edges.on_outline.sum()):
        return None
    # an outline's samples lie high and low along the rim of one hole, and side by side in a picture
    longest = _longest(edges.pixels, LINK_PX)
    length_mm = float(longest.sum()) * edges.step_mm
    if length_mm <= ALONE_MM:
        return None
    points = edges.points_mm[longest]
    out = points - points.mean(axis=0)
    bearing = np.sort(np.arctan2(out[:, 1], out[:, 0]))
    gap = np.diff(bearing, append=bearing[0] + 2.0 * np.pi).max()
    if gap > np.pi / 2.0:  # it does not go round its middle
        return length_mm, points[np.linalg.norm(out, axis=1).argmin()]
    return length_mm, points.mean(axis=0)


def shown_edges(
    edges: ModelEdgePoints,
    grey: GreyMeasure,
    mm_per_px: float,
    others: Sequence[ModelEdgePoints] = (),
) -> tuple[FloatArray, float]:
    """Return the distances (n,) to the nearest edge under any lamp, and the rate of chance hits.

    Parameters
    ----------
    edges : all visible edges at a pose
    grey : of a scene under several lamps
    mm_per_px : at the object
    others : edges of the parts beside it: what these predict is not found by chance
    """
    gap, beside = grey.shown_by_any(edges, FAR_PX, ASIDE_PX)
    off = np.fmin(np.abs(gap), FAR_PX)
    every = cKDTree(edges.pixels, balanced_tree=False, compact_nodes=False)
    found: list[BoolArray] = []
    for side, there in zip((-ASIDE_PX, ASIDE_PX), beside, strict=True):
        far, _ = every.query(edges.pixels + side * edges.normals, distance_upper_bound=APART_PX)
        asked, is_there = ~np.isfinite(far), np.asarray(np.abs(there) < NEAR_PX)
        at = np.flatnonzero(asked & is_there)
        points = edges.pixels[at] + (side + there[at])[:, None] * edges.normals[at]
        for other in others:
            asked[at] &= ~is_predicted(points, other, other.step_mm / mm_per_px)
        found.append(is_there[asked])
    together = np.concatenate(found)
    return off, float(together.mean()) if len(together) else 0.0


def _off_px(pixels: FloatArray, edges: ModelEdgePoints, greys: Sequence[GreyMeasure]) -> FloatArray:
    """Return the distance of points (n, 2) beside edges from any picture's nearest edge, (n,)."""
    off = np.full(len(pixels), FAR_PX)
    for grey in greys:
        off = np.fmin(off, np.abs(grey.gaps(pixels, edges.normals, edges, FAR_PX).gap_px))
    return off


def _explained(image_edges: ImageEdges, edges: ModelEdgePoints, mm_per_px: float) -> float:
    """Return the share of a picture's strong edges that are predicted."""
    predicted = is_predicted(image_edges.points_px, edges, edges.step_mm / mm_per_px)
    # strong ones count more, but one bright rim must not outvote all others
    return _weighted(predicted, np.sqrt(image_edges.strength))


def is_predicted(points_px: FloatArray, edges: ModelEdgePoints, step_px: float) -> BoolArray:
    """Return a mask (n,) of the points of a picture that lie on predicted edges.

    Parameters
    ----------
    points_px : (n, 2) x before y, in the whole picture
    edges : the predicted ones
    step_px : step between their samples along an edge
    """
    pixels, normals = edges.pixels, edges.normals
    if len(pixels) == 0 or len(points_px) == 0:
        return np.zeros(len(points_px), dtype=np.bool_)
    along_px = 0.75 * step_px + 2.0
    # what is farther off than both limits together is not asked for
    tree = cKDTree(pixels, balanced_tree=False, compact_nodes=False)
    reach_px = float(np.hypot(NEAR_PX + 0.3, along_px)) + 1e-6
    k = min(2, len(pixels))
    found = tree.query(points_px, k=k, distance_upper_bound=reach_px)
    far, nearest = (np.asarray(one).reshape(len(points_px), k) for one in found)
    answer = np.zeros(len(points_px), dtype=np.bool_)
    for distance, which in zip(far.T, nearest.T, strict=True):
        at = np.flatnonzero(np.isfinite(distance))
        which = which[at]
        away = points_px[at] - pixels[which]
        across = np.abs((away * normals[which]).sum(axis=1))
        along = np.sqrt(np.maximum((away**2).sum(axis=1) - across**2, 0.0))
        answer[at] |= (across < NEAR_PX + 0.3) & (along < along_px)
    return answer


def _root_mean_square(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _share(found: BoolArray) -> float:
    return float(found.mean()) if len(found) else 0.0


def _weighted(found: BoolArray | FloatArray, weight: FloatArray) -> float:
    total = float(weight.sum())
    return float((weight * found).sum()) / total if total > 0 else 0.0
