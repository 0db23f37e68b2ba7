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
from controller.imaging import Camera, render_maps

from ..fitting import ImageEdges
from ..library import Candidate, Library
from ..segmentation import Region
from .cutout import ObjectCutout
from .decide import has_other_inside
from .hypotheses import Hypothesis, SearchLimits, alone_in, is_tried, judged_within, weigh
from .lines import by_sweep
from .lit import widened
from .touching import within

WIDER = 0.5  # reach of a part beyond a piece, as a share of the piece's longer side
WIDER_MM = 10.0
MAX_BY_SWEEP = 12
REACH_MM = 1.0  # largest offset of the candidates, which are already fitted to edges
MAY_BE = 0.1  # own probability from which a pose counts, and its area belongs to the thing
BESIDE_PX = 4  # distance round another thing within which edges are still its own
# Width of the table round a lone part; an edge within it means that the part is a detail.
BAND_MM = 6.0
# Share of the visible edges that a pose has to explain: a thin part fits along any long edge.
MIN_EXPLAINED = 0.55
AS_STRONG = 0.8  # share of the thing's own edge strength; fainter edges are grain and half-shadows


def look_wider(
    region: Region,
    others: Sequence[Region],
    before: Sequence[Hypothesis],
    pictures: Sequence[Grey],
    camera: Camera,
    library: Library,
    limits: SearchLimits,
) -> tuple[Region, list[Candidate], list[Hypothesis]]:
    """Return a wider cutout of a thing, its edges' proposals, and the likely hypotheses.

    Parameters
    ----------
    region : region cut out
    others : the picture's other things that are known
    before : hypotheses about it that did not convince
    pictures : pictures of the scene under several lamps, the brightest of all first
    camera : overhead, calibrated
    library : library of the possible parts
    limits : limits of the search
    """
    x0, y0, x1, y1 = region.box_px
    middle_px = np.array([[(x0 + x1) / 2, (y0 + y1) / 2]])
    mm = camera.mm_per_px(camera.on_plane(middle_px)[0])
    margin_px = round(max(WIDER * max(x1 - x0, y1 - y0), WIDER_MM / mm))
    wide = widened(region, margin_px, pictures[0].shape)
    free = _free(wide, others)
    cutout = ObjectCutout(wide, pictures, mm, [wide.loops_px], is_backlit=False)
    candidates = by_sweep(
        cutout.crops, cutout.corner_px, wide.mask, free, camera, library, MAX_BY_SWEEP
    )
    narrow = replace(
        limits,
        max_lit=MAX_BY_SWEEP,
        max_fine=MAX_BY_SWEEP,
        first_reach_mm=REACH_MM,
        shift_mm=0.0,
    )
    found = weigh(candidates, cutout, camera, library, narrow, source="lines")
    likely = [h for h in (*before, *found) if h.probability >= MAY_BE and _is_whole(h, pictures[0])]
    if not free.all():
        likely = [h for h in likely if not _is_taken(h, wide, free, camera, library)]
    if not likely:
        return wide, candidates, []
    best = max(likely, key=lambda h: (not has_other_inside(h), h.probability))
    mask = wide.mask | (_covered(best, wide, camera, library) & free)
    wide = replace(wide, mask=mask)
    cutout = ObjectCutout(wide, pictures, mm, [], is_backlit=False)
    judged = judged_within(likely, cutout, camera, library)
    about = _edges_about(cutout, free, round(BAND_MM / mm))
    # one that leaves most of the thing open says nothing against another
    judged = [
        alone_in(h, about, cutout, camera, library) for h in judged if h.probability >= MAY_BE
    ]
    able = [h for h in judged if not has_other_inside(h)]
    # what a piece's own outline or lines propose, and the edges about it do not, is no answer
    is_answer = (
        bool(able)
        and able[0].evidence.explained >= MIN_EXPLAINED
        and is_tried(able[0], found, library)
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


def _is_taken(
    h: Hypothesis, wide: Region, free: BoolArray, camera: Camera, library: Library
) -> bool:
    """Return True if a hypothesis puts most of the part where another thing is."""
    covered = _covered(h, wide, camera, library)
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


def _covered(h: Hypothesis, wide: Region, camera: Camera, library: Library) -> BoolArray:
    """Return a mask (h, w) of a region's box covered by the part of a hypothesis."""
    x0, y0, x1, y1 = wide.box_px
    seen = h.fit.edges.pixels
    low = np.maximum(np.floor(seen.min(axis=0)).astype(int) - 1, [x0, y0])
    high = np.minimum(np.ceil(seen.max(axis=0)).astype(int) + 2, [x1, y1])
    out = np.zeros(wide.mask.shape, dtype=np.bool_)
    if (low >= high).any():
        return out
    roi = (int(low[0]), int(low[1]), int(high[0]), int(high[1]))
    depth = render_maps(library.model(h.part).caster, h.fit.T_world_part, camera, roi).depth_mm
    out[low[1] - y0 : high[1] - y0, low[0] - x0 : high[0] - x0] = np.isfinite(depth)
    return out
