"""Parts of a cluster: poses are fitted, and the set that explains it best is taken.

Two parts cannot occupy the same space: along each line of sight one has to be behind the other. Of
all possible sets of parts, the one is taken whose outlines explain most of the cluster's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray

from ..fitting import MAX_MISFIT_PX
from ..library import Candidate, Library
from .candidates import propose_partial
from .cluster import CELL_PX, Cluster
from .depths import lines_in_both
from .fits import FIRST_MM, PartialFit, fit_partial
from .planar import predicted_shares
from .together import best_set, by_place

SAME_SHADOW = 0.7  # common share of the cells of two shadows from which two poses are one place
PART_COST = 24  # outline points of the cluster, about 6 mm, that another part must explain
# distance outside a part's outline within which its own outline would have been found
ABOUT_PX = 8.0
LEFT_CELLS = 1.5  # half the least width, in cells, of an unexplained rest
MIN_FREE = 0.65  # share of its outline by which a part is named; with less, others look like it
MIN_AGREEMENT = 0.9  # share of its free outline that has to be found
# Share of an outline to be found as it is moved in the table plane, before it is fitted, and
# the same of what is free of it. With the two shares above no less than 0.58 can be found; 81 parts
# that were named had 0.61 and 0.93 at least.
MIN_MET, MIN_AGREEING = 0.5, 0.8
MAX_PLACES = 16  # places that are weighed against each other
GIVE_UP = 24  # candidates in a row that do not agree, after which likelier ones are not to come
MAX_ROUNDS = 4  # rounds in which parts are sought in the unexplained rest


@dataclass(frozen=True, eq=False, slots=True)
class PartPlace:
    """A place with a part.

    Attributes
    ----------
    fits : hypotheses, best first
    explained : with each of them, the share of the cluster's outline on it and beside it that the
        parts predict
    """

    fits: tuple[PartialFit, ...]
    explained: tuple[float, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Explained:
    """The parts that explain a cluster.

    Attributes
    ----------
    places : the parts that are there
    left : (h, w) mask of the cluster's box that none of the parts covers
    """

    places: tuple[PartPlace, ...]
    left: BoolArray


def explain_cluster(cluster: Cluster, library: Library) -> Explained:
    """Return the parts that explain a cluster together, with the unexplained rest.

    Parameters
    ----------
    cluster : several parts that touch, or one that is cut
    library : library of the possible parts
    """
    fits: list[PartialFit] = []
    chosen: list[list[PartialFit]] = []
    is_open = np.ones(len(cluster.points_px), dtype=np.bool_)
    for _ in range(MAX_ROUNDS):
        new = _fitted(propose_partial(cluster, library, is_open), cluster, library)
        fits = sorted([*fits, *new], key=lambda fit: -fit.rank)
        before = len(chosen)
        chosen = _chosen(fits)
        for place in chosen:
            is_open &= ~place[0].explains
        if len(chosen) <= before or is_open.sum() < PART_COST:
            break
    found = [_not_buried(place, [p[0] for p in chosen if p is not place]) for place in chosen]
    firsts = [place[0] for place in found]
    described = []
    for k, place in enumerate(found):
        others = [first for j, first in enumerate(firsts) if j != k]
        shares = tuple(_explained_about(fit, [fit, *others]) for fit in place)
        described.append(PartPlace(tuple(place), shares))
    return Explained(tuple(described), _left(firsts, cluster))


def _fitted(
    candidates: Sequence[Candidate], cluster: Cluster, library: Library
) -> list[PartialFit]:
    """Return the candidates that agree with the picture, fitted."""
    fits: list[PartialFit] = []
    failed = 0
    for begin in range(0, len(candidates), GIVE_UP):
        some = candidates[begin : begin + GIVE_UP]
        found, covered = predicted_shares(some, cluster, library, FIRST_MM)
        free = np.maximum(1.0 - covered, 1e-9)
        may_fit = (found >= MIN_MET) & (found >= MIN_AGREEING * free)
        for candidate, may in zip(some, may_fit.tolist(), strict=True):
            if failed == GIVE_UP:
                return fits
            failed += 1
            if not may:
                continue
            fit = fit_partial(candidate, cluster, library)
            if (
                fit is not None
                and fit.free_share >= MIN_FREE
                and fit.agreement >= MIN_AGREEMENT
                and fit.misfit_px <= MAX_MISFIT_PX
            ):
                fits.append(fit)
                failed = 0
    return fits


def _chosen(fits: Sequence[PartialFit]) -> list[list[PartialFit]]:
    """Return the places whose best fits explain a cluster together, each one's neighbours known."""
    fits = list(fits)
    while True:
        places = by_place(fits, SAME_SHADOW, MAX_PLACES)
        best = best_set([place[0] for place in places], are_buried, _gain)
        chosen = [places[k] for k in best]
        firsts = [place[0] for place in chosen]
        alone = [one for one in firsts if one.lacks_cover([f for f in firsts if f is not one])]
        if not alone:
            return chosen
        fits = [fit for fit in fits if not any(fit is one for one in alone)]


def _not_buried(place: Sequence[PartialFit], others: Sequence[PartialFit]) -> list[PartialFit]:
    return [
        fit
        for k, fit in enumerate(place)
        if k == 0 or not any(are_buried(fit, other) for other in others)
    ]


def are_buried(a: PartialFit, b: PartialFit) -> bool:
    """Return True if two parts overlap in space."""
    at, chance = lines_in_both(a.depths, b.depths)
    return len(at) > chance


def _gain(fit: PartialFit, points: float) -> float:
    """Return the gain of a fit, by the outline points that it explains and others do not."""
    return points - PART_COST - 4.0 * fit.misfit_px


def _explained_about(fit: PartialFit, chosen: Sequence[PartialFit]) -> float:
    """Return the predicted share of the cluster's outline on a part and close beside it."""
    cluster = fit.cluster
    explained = np.any([one.explains for one in chosen], axis=0)
    shadow = cv2.erode(cluster.raster(fit.shadow).astype(np.uint8), np.ones((7, 7), np.uint8))
    x, y = np.round(cluster.points_px - cluster.region.box_px[:2]).astype(np.int64).T
    about = shadow[np.clip(y, 0, len(shadow) - 1), np.clip(x, 0, shadow.shape[1] - 1)] > 0
    free = fit.fit.edges.pixels[~fit.is_covered]
    far, nearest = cKDTree(free).query(cluster.points_px)
    normals = fit.fit.edges.normals[~fit.is_covered][nearest]
    same = (normals * cluster.normals_px).sum(axis=1) > 0.7
    about |= (far < ABOUT_PX) & same
    return float((explained & about).sum()) / max(int(about.sum()), 1)


def _left(fits: Sequence[PartialFit], cluster: Cluster) -> BoolArray:
    """Return a mask (h, w) of the cluster that no fit covers, without the fits' rims."""
    left = cluster.cells[2].copy()
    for fit in fits:
        left &= ~fit.shadow
    size = CELL_PX * (2 * int(np.ceil(LEFT_CELLS)) + 1)
    raster = cluster.raster(left).astype(np.uint8)
    opened = cv2.morphologyEx(raster, cv2.MORPH_OPEN, np.ones((size, size), np.uint8))
    return np.asarray((opened > 0) & cluster.region.mask)
