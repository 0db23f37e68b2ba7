"""Sightings of parts that touch, or that the picture's edge cuts, by their free outlines.

Silhouettes of whole parts do not help here. The cluster is explained by several parts, or by one in
part; the alternatives for a place are decided as for a whole silhouette, by its free outline.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from controller.arrays import BoolArray

from ..fitting import Evidence, outline_evidence
from ..partial import CELL_PX, Cluster, PartialFit, PartPlace, explain_cluster
from ..segmentation import Region
from .cutout import ObjectCutout
from .decide import Decision, decide
from .hypotheses import Hypothesis, hypothesis_of, look_inside, without_repeats
from .scene import TableScene
from .scores import SILHOUETTE, log_odds, probability

# Position uncertainty allowed; a bar without a visible end may lie anywhere along.
MAX_SIGMA_MM = 0.4


@dataclass(frozen=True, eq=False, slots=True)
class PartialSighting:
    """One part of a cluster, or the rest without all parts.

    Attributes
    ----------
    region : its share of the cluster; its loops are the cluster's
    decision : decision on it
    hypotheses : hypotheses, best first; none for what is left
    free_share : free share of the best one's outline
    lies_on : numbers of the parts of this cluster that it lies on
    is_covered : something lies on it
    """

    region: Region
    decision: Decision
    hypotheses: tuple[Hypothesis, ...]
    free_share: float
    lies_on: tuple[int, ...] = ()
    is_covered: bool = False


def parts_of(region: Region, scene: TableScene) -> tuple[PartialSighting, ...]:
    """Return the parts of a backlit cluster, and the rest; nothing if none is sure.

    Parameters
    ----------
    region : the cluster
    scene : its pictures, and the parts that may be there
    """
    cluster = Cluster(region, scene.camera, scene.usable)
    explained = explain_cluster(cluster, scene.library)
    found: list[PartialSighting] = []
    left = explained.left
    for place in explained.places:
        own = _own_region(place.fits[0], cluster)
        hypotheses = _hypotheses(place, own, scene)
        decision = decide(hypotheses, is_backlit=True)
        if decision.best is None or not _is_certain(decision.best):
            left = left | (within(own, region) & region.mask)
            continue
        best = next(fit for fit in place.fits if _is_of(decision.best, fit))
        found.append(PartialSighting(own, decision, tuple(hypotheses), best.free_share))
    if not found:
        return ()
    return (*found, *_what_is_left(left, region, scene.least_px))


def _hypotheses(place: PartPlace, own: Region, scene: TableScene) -> list[Hypothesis]:
    mm = scene.mm_per_px(place.fits[0].fit.T_world_part[:2, 3])
    cutout, library = ObjectCutout(own, scene), scene.library
    found = []
    for fit, share in zip(place.fits, place.explained, strict=True):
        evidence = _evidence(fit, share, mm)
        alone = probability(evidence, SILHOUETTE)
        lead = log_odds(evidence, is_lit=cutout.is_lit)
        source = fit.candidate.source
        found.append(
            hypothesis_of(fit.candidate, fit.free_fit, library, evidence, alone, lead, source)
        )
    return look_inside(without_repeats(found, library), cutout)


def _evidence(fit: PartialFit, explained: float, mm_per_px: float) -> Evidence:
    known = outline_evidence(fit.free_fit, fit.cluster.measure, mm_per_px)
    return replace(known, outline=fit.agreement, explained=explained, misfit_px=fit.misfit_px)


def _is_certain(best: Hypothesis) -> bool:
    """Return True if the uncovered edges of a part fix its position."""
    spread = best.fit.covariance
    return bool(np.sqrt(max(spread[0, 0], spread[1, 1])) < MAX_SIGMA_MM)


def _is_of(h: Hypothesis, fit: PartialFit) -> bool:
    return h.fit.T_world_part is fit.fit.T_world_part


def _own_region(fit: PartialFit, cluster: Cluster) -> Region:
    """Return a part's share of a cluster."""
    whole = cluster.region
    shadow = cluster.raster(fit.shadow).astype(np.uint8)
    mask = whole.mask & (cv2.dilate(shadow, np.ones((CELL_PX, CELL_PX), np.uint8)) > 0)
    return cut_out(mask, whole, fit.free_share < 1.0)


def cut_out(mask: BoolArray, whole: Region, is_cut: bool) -> Region:
    """Return the piece of a region that a mask of its box marks.

    Parameters
    ----------
    mask : (h, w)
    whole : the region
    is_cut : True if it reaches the picture's edge if the region does
    """
    x0, y0, _, _ = whole.box_px
    left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
    margin = 4
    left, top, right, bottom = (
        max(left - margin, 0),
        max(top - margin, 0),
        min(left + width + margin, mask.shape[1]),
        min(top + height + margin, mask.shape[0]),
    )
    return Region(
        box_px=(x0 + left, y0 + top, x0 + right, y0 + bottom),
        mask=mask[top:bottom, left:right].copy(),
        loops_px=whole.loops_px,
        touches_edge=whole.touches_edge and is_cut,
        area_px=float(mask.sum()),
        alternatives=(),
    )


def within(own: Region, whole: Region) -> BoolArray:
    """Return the part of a region's mask in the box of another one."""
    out = np.zeros_like(whole.mask)
    x0, y0, x1, y1 = whole.box_px
    left, top, right, bottom = own.box_px
    u0, v0, u1, v1 = max(left, x0), max(top, y0), min(right, x1), min(bottom, y1)
    if u0 < u1 and v0 < v1:
        piece = own.mask[v0 - top : v1 - top, u0 - left : u1 - left]
        out[v0 - y0 : v1 - y0, u0 - x0 : u1 - x0] = piece
    return out


def connected(mask: BoolArray, whole: Region, least_px: float, is_cut: bool) -> list[Region]:
    """Return the connected pieces of a mask of a region's box.

    Parameters
    ----------
    mask : (h, w)
    whole : the region
    least_px : pixels below which a piece is none
    is_cut : True if they reach the picture's edge if the region does
    """
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    return [
        cut_out(labels == k, whole, is_cut)
        for k in range(1, len(stats))
        if stats[k, cv2.CC_STAT_AREA] >= least_px
    ]


def _what_is_left(left: BoolArray, whole: Region, least_px: float) -> list[PartialSighting]:
    """Return the connected pieces that no part covers, as unknown objects."""
    nothing = Decision(None, 1.0, (), None)
    pieces = connected(left, whole, least_px, True)
    return [PartialSighting(piece, nothing, (), 0.0) for piece in pieces]
