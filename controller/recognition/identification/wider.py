"""A lone thing that was cut short, or has a shadow, identified by the edges about it.

An edge visible under any lamp is real, though no outline is whole. Edges propose poses, which are
fitted like others. The area covered by a likely pose then belongs to the thing: it has to be
explained as well as the region cut out.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from controller.arrays import BoolArray, Grey

from ..fitting import ImageEdges
from ..library import Candidate
from ..segmentation import Region, joined, near_ones
from .by_edges import by_edges, edges_on_table
from .clusters import Answers
from .cutout import ObjectCutout, part_depth_mm
from .decide import decide, has_other_inside
from .hypotheses import Hypothesis, alone_in, is_tried, judged_within, weigh
from .lit import widened
from .scene import TableScene
from .sighting import Seen, Trace, known
from .touching import within

LARGEST = 1.3  # in longest parts: the largest object with its shadow
WIDER = 0.5  # reach of a part beyond a piece, as a share of the piece's longer side
WIDER_MM = 10.0
MAY_BE = 0.1  # own probability from which a pose counts, and its area belongs to the thing
BESIDE_PX = 4  # distance round another thing within which edges are still its own
# Width of the table round a lone part; an edge within it means that the part is a detail.
BAND_MM = 6.0
# Share of the visible edges that a pose has to explain: a thin part fits along any long edge.
MIN_EXPLAINED = 0.55
AS_STRONG = 0.8  # share of the thing's own edge strength; fainter edges are grain and half-shadows


def looked_wider(
    every: Sequence[Answers], scene: TableScene
) -> tuple[list[Answers], list[Answers]]:
    """Return the answers that stay, and those of things identified by all edges about them.

    Parameters
    ----------
    every : regions cut out, each by itself
    scene : pictures under several lamps, and the parts that may be there
    """
    left, found = dict(enumerate(every)), []
    named = [region for region, answers in every if answers[0][0].part is not None]
    for group in near_ones([region for region, _ in every]):
        near = [every[k] for k in group if k in left]
        if not near or any(answers[0][0].part is not None for _, answers in near):
            continue
        if scene.usable is not None and any(region.touches_edge for region, _ in near):
            continue
        alone = _by_edges_about(near, named, scene)
        if alone is None:
            continue
        region = alone[1].region
        found.append((region, [alone]))
        named.append(region)
        for k in list(left):
            # pieces farther off that are the part's, too
            if k in group or (left[k][0] not in named and _is_in(left[k][0], region)):
                del left[k]
    return list(left.values()), found


def _is_in(piece: Region, region: Region) -> bool:
    """Return True if most of a piece is part of a region."""
    return 2 * int((within(piece, region) & region.mask).sum()) > int(piece.mask.sum())


def _by_edges_about(
    near: Sequence[Answers], others: Sequence[Region], scene: TableScene
) -> Seen | None:
    """Return the one part that several unknown pieces make up; None if it stays unknown.

    Parameters
    ----------
    near : the pieces, and what was tried on them
    others : the picture's things that are known
    scene : pictures under several lamps, and the parts that it may be
    """
    region = joined([region for region, _ in near])
    x0, y0, x1, y1 = region.box_px
    ends_mm = scene.camera.on_plane(np.array([[x0, y0], [x1, y1]], dtype=np.float64))[:, :2]
    longest_mm = max(entry.extent_mm for entry in scene.library.entries)
    if np.abs(ends_mm[1] - ends_mm[0]).max() > LARGEST * longest_mm:
        return None  # no part is so large: these are several
    before = [h for _, answers in near for h in answers[0][1].hypotheses]
    wide, candidates, hypotheses = look_wider(region, others, before, scene)
    decision = decide(hypotheses, is_backlit=False)
    if decision.best is None:
        return None
    area_mm2 = sum(answers[0][0].area_mm2 for _, answers in near)
    wide = replace(wide, touches_edge=False)
    sighting = known(decision, decision.best, wide, area_mm2, scene.library)
    return sighting, Trace(wide, tuple(candidates), tuple(hypotheses))


def look_wider(
    region: Region,
    others: Sequence[Region],
    before: Sequence[Hypothesis],
    scene: TableScene,
) -> tuple[Region, list[Candidate], list[Hypothesis]]:
    """Return a wider cutout of a thing, its edges' proposals, and the likely hypotheses.

    Parameters
    ----------
    region : region cut out
    others : the picture's other things that are known
    before : hypotheses about it that did not convince
    scene : pictures under several lamps, and the parts that it may be
    """
    x0, y0, x1, y1 = region.box_px
    mm = ObjectCutout(region, scene).mm_per_px
    margin_px = round(max(WIDER * max(x1 - x0, y1 - y0), WIDER_MM / mm))
    wide = widened(region, margin_px, scene.pictures[0].shape)
    free = _free(wide, others)
    cutout = ObjectCutout(wide, scene)
    edges = edges_on_table(cutout.crops, cutout.corner_px, scene.camera, free)
    candidates = by_edges(edges, cutout.corner_px, wide.mask, scene)
    found = weigh(candidates, cutout, scene.search.for_edges(len(candidates)))
    likely = [
        h for h in (*before, *found) if h.probability >= MAY_BE and _is_whole(h, scene.pictures[0])
    ]
    if not free.all():
        likely = [h for h in likely if not _is_taken(h, wide, free, scene)]
    if not likely:
        return wide, candidates, []
    best = max(likely, key=lambda h: (not has_other_inside(h), h.probability))
    mask = wide.mask | (_covered(best, wide, scene) & free)
    wide = replace(wide, mask=mask)
    cutout = ObjectCutout(wide, scene)
    judged = judged_within(likely, cutout)
    about = _edges_about(cutout, free, round(BAND_MM / mm))
    # one that leaves most of the thing open says nothing against another
    judged = [alone_in(h, about, cutout) for h in judged if h.probability >= MAY_BE]
    able = [h for h in judged if not has_other_inside(h)]
    # what a piece's own outline or lines propose, and the edges about it do not, is no answer
    is_answer = (
        bool(able)
        and able[0].evidence.explained >= MIN_EXPLAINED
        and is_tried(able[0], found, scene.library)
    )
    return wide, candidates, judged if is_answer else []


def _edges_about(cutout: ObjectCutout, free: BoolArray, band_px: int) -> ImageEdges:
    """Return edges in a band round a thing that are about as strong as its own."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * band_px + 1,) * 2)
    mask = cutout.region.mask.astype(np.uint8)
    band = (cv2.dilate(mask, disc) > 0) & free & (cv2.dilate(mask, np.ones((7, 7))) == 0)
    found = ImageEdges.of(cutout.greys[0], np.asarray(band))
    own = cutout.image_edges[0].strength
    return found.at(found.strength > (AS_STRONG * np.median(own) if len(own) else np.inf))


def _is_taken(h: Hypothesis, wide: Region, free: BoolArray, scene: TableScene) -> bool:
    """Return True if a hypothesis puts most of the part where another thing is."""
    covered = _covered(h, wide, scene)
    return 2 * int((covered & ~free).sum()) > int(covered.sum())


def _is_whole(h: Hypothesis, picture: Grey) -> bool:
    """Return True if the whole part is in the picture, under a hypothesis."""
    height, width = picture.shape
    low, high = h.fit.edges.pixels.min(axis=0), h.fit.edges.pixels.max(axis=0)
    return bool((low >= 1).all() and (high < np.array([width, height]) - 2).all())


def _free(wide: Region, others: Sequence[Region]) -> BoolArray:
    """Return a mask (h, w) of a region's box without the other things."""
    taken = np.zeros(wide.mask.shape, dtype=np.uint8)
    for other in others:
        taken |= within(other, wide)
    beside = np.ones((2 * BESIDE_PX + 1,) * 2, np.uint8)
    return np.asarray(cv2.dilate(taken, beside) == 0)


def _covered(h: Hypothesis, wide: Region, scene: TableScene) -> BoolArray:
    """Return a mask (h, w) of a region's box covered by the part of a hypothesis."""
    model = scene.library.model(h.part)
    return np.isfinite(part_depth_mm(model, h.fit, scene.camera, wide.box_px))
