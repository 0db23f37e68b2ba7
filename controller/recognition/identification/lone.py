"""One thing by itself: proposed by its silhouette, under lamps by edges; fitted and decided."""

from typing import Final

import numpy as np

from controller.arrays import FloatArray
from messages import key

from ..library import FEW_VIEWS, Candidate, Library, Silhouette, polar_grid
from ..segmentation import Region
from .by_edges import by_edges, edges_on_table
from .cutout import ObjectCutout
from .decide import decide, is_convincing
from .hypotheses import distinct, is_tried, ranked_under_lamps, weigh
from .scene import TableScene
from .sighting import Seen, Trace, known, unknown, why_not
from .turns import settle_turns

CROWD: Final = 0.15  # distance in the index: the right view of seen silhouettes was within 0.13
CROWDED_VIEWS: Final = 400  # views compared turn by turn in a crowd: 10 to 16 ms
FAR_BACKLIT: Final = 0.6  # distance in the index: a whole silhouette finds its like nearby
FAR_FRONT: Final = 1.5  # distance in the index of a silhouette with shaded sides missing
MIN_LOOP_PX: Final = 8  # shorter loops are dust


def identify(region: Region, scene: TableScene) -> Seen:
    """Return what a region is as one thing.

    Parameters
    ----------
    region : as it was cut out
    scene : its pictures, and the parts that it may be
    """
    silhouette = silhouette_of(region.loops_px, scene)
    if silhouette is None:
        reason = key("too small to recognise")
        return unknown(region, scene, 0.0, 1.0, reason), Trace(region, (), ())
    area_mm2, library = silhouette.area_mm2, scene.library
    if region.touches_edge:
        reason = key("partly outside the picture or the backlit area; move it inwards")
        return unknown(region, scene, area_mm2, 1.0, reason), Trace(region, (), ())
    far = FAR_BACKLIT if scene.is_backlit else FAR_FRONT
    candidates = library.index.search(silhouette, far=far)
    cutout = ObjectCutout(region, scene)
    hypotheses = weigh(candidates, cutout, scene.search)
    if not scene.is_backlit and not is_convincing(hypotheses):
        edges = edges_on_table(cutout.crops, cutout.corner_px, scene.camera)
        proposed = by_edges(edges, cutout.corner_px, region.mask, scene)
        candidates += proposed
        new = [c for c in proposed if not is_tried(c, hypotheses, library)]
        others = weigh(new, cutout, scene.search.for_edges(len(new)))
        hypotheses = ranked_under_lamps([*hypotheses, *others], library)
    if scene.is_backlit:
        hypotheses = settle_turns(hypotheses, cutout)
    decision = decide(hypotheses, is_backlit=scene.is_backlit)
    if scene.is_backlit and decision.best is None and _is_crowded(silhouette, library):
        crowd = library.index.search(silhouette, CROWDED_VIEWS, far=CROWD)
        tried: list[Candidate] = distinct(candidates, library)[: scene.search.max_coarse]
        new = [c for c in crowd if not is_tried(c, tried, library)]
        candidates += new
        more = weigh(new, cutout, scene.search.for_crowd())
        decision = decide(more, is_backlit=True)
        hypotheses = more if decision.best is not None else hypotheses
    trace = Trace(region, tuple(candidates), tuple(hypotheses))
    if decision.best is None:
        reason = why_not(decision, library, is_backlit=scene.is_backlit)
        return unknown(region, scene, area_mm2, decision.score, reason), trace
    return known(decision, decision.best, region, area_mm2, library), trace


def _is_crowded(silhouette: Silhouette, library: Library) -> bool:
    """Return True if more views are like a silhouette than the first search compares."""
    return library.index.near_count(silhouette, CROWD) > FEW_VIEWS


def silhouette_of(loops_px: tuple[FloatArray, ...], scene: TableScene) -> Silhouette | None:
    """Return the silhouette of an outline [px] in the table plane; None for one that is too small.

    Parameters
    ----------
    loops_px : the outer loop, and its holes
    scene : the picture's camera
    """
    plane = scene.camera.on_plane
    loops = tuple(plane(loop)[:, :2] for loop in loops_px if len(loop) > MIN_LOOP_PX)
    if not loops:
        return None
    try:
        grid, centroid, area = polar_grid(loops)
    except ValueError:
        return None
    return Silhouette(area, sum(_length(loop) for loop in loops), centroid, grid)


def _length(loop: FloatArray) -> float:
    """Return the length of a dense loop, its pixels' zigzag smoothed away."""
    smooth = loop + np.roll(loop, 1, axis=0) + np.roll(loop, 2, axis=0) + np.roll(loop, -1, axis=0)
    return float(np.linalg.norm(np.roll(smooth, -1, axis=0) - smooth, axis=1).sum()) / 4
