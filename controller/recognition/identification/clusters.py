"""Things that may be several: taken apart before a light table and under lamps."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from messages import key

from ..segmentation import Region, joined, near_ones
from .hypotheses import SAME_PLACE_MM, Hypothesis
from .lit import parts_of_lit
from .lone import identify
from .scene import TableScene
from .sighting import Seen, Sighting, Trace, known, unknown
from .touching import PartialSighting, parts_of

Answers = tuple[Region, list[Seen]]  # of a region, and what is in it
LEFT_OVER: Final = key(
    "touches known parts, but is none of them as far as it is seen; move it apart"
)
WHOLE: Final = 0.95  # share of an outline's length that the part itself explains
# Distance from the outline of a named part beyond which the outline belongs to another.
BESIDE_MM: Final = 3.0
ANOTHER_MM: Final = 12.0  # if this much of the cluster's outer outline does
LARGER: Final = 1.1  # in largest known silhouettes: anything larger is several parts, or unknown


def taken_apart_backlit(region: Region, scene: TableScene) -> Answers:
    """Return what a thing before a light table is: one part, several, or unknown.

    Lamps are asked where a rest is unknown: a silhouette cannot tell which of two parts is above
    the other, and one that leans has not the outline of any stable pose.

    Parameters
    ----------
    region : as it was cut out
    scene : its pictures, and the parts that may be there
    """
    answers = [identify(region, scene)]
    if not _may_be_several(*answers[0], scene):
        return region, answers
    parts = parts_of(region, scene)
    if answers[0][0].part is None or len(parts) > 1:
        answers = _of_parts(parts, scene) or answers
    *lit, _ = scene.pictures
    if lit and _may_lean(region, answers, scene):
        named = [_best_of(seen, trace) for seen, trace in answers if seen.part is not None]
        lamps = scene.seen_by(lit)
        under_lamps = _of_parts(parts_of_lit(region, lamps, named), lamps)
        if _named(under_lamps) > len(named):
            answers = under_lamps
    return region, answers


def taken_apart(every: Sequence[Answers], scene: TableScene) -> list[Answers]:
    """Return answers under lamps with clusters separated; touching things count as one.

    Parameters
    ----------
    every : regions cut out, each by itself
    scene : its pictures, and the parts that may be there
    """
    out = dict(enumerate(every))
    for group in near_ones([region for region, _ in every]):
        numbers = [k for k in group if not every[k][0].touches_edge]
        whole = [every[k] for k in numbers]
        if not any(_may_be_several(*one[1][0], scene) for one in whole):
            continue
        region = joined([region for region, _ in whole])
        parts = parts_of_lit(region, scene)
        named_singly = sum(_named(answers[:1]) for _, answers in whole)
        named = sum(part.decision.best is not None for part in parts)
        # one thing with nothing beside it is judged as a whole, pieces of one thing are not
        if max(len(parts), len(whole)) > 1 and (
            named > named_singly or (0 < named == named_singly and len(parts) > len(whole))
        ):
            for k in numbers[1:]:
                del out[k]
            out[numbers[0]] = region, _of_parts(parts, scene)
    return list(out.values())


def _may_be_several(sighting: Sighting, trace: Trace, scene: TableScene) -> bool:
    """Return True if an outline is no known part's, or one's with something smaller beside it."""
    if sighting.part is None:
        return True
    best = trace.hypotheses[0]
    if best.evidence.explained > WHOLE:
        return False
    far, _ = cKDTree(best.fit.edges.pixels).query(trace.region.loops_px[0])
    # the loop has a point each pixel
    mm_per_px = float(np.sqrt(scene.pixel_mm2))
    is_beside = np.asarray(far * mm_per_px > BESIDE_MM)
    return float(is_beside.sum()) * mm_per_px > ANOTHER_MM


def _named(answers: Sequence[Seen]) -> int:
    """Return the number of parts identified."""
    return sum(seen.part is not None for seen, _ in answers)


def _may_lean(region: Region, answers: Sequence[Seen], scene: TableScene) -> bool:
    """Return True if the unknown rest of a backlit thing may lean on a part, or be several."""
    named = _named(answers)
    if named == len(answers):
        return False
    largest_mm2 = LARGER * scene.library.index.area_mm2.max()
    return named > 0 or bool(region.area_px * scene.pixel_mm2 > largest_mm2)


def _best_of(sighting: Sighting, trace: Trace) -> Hypothesis:
    """Return the hypothesis behind a sighting."""
    return next(h for h in trace.hypotheses if h.fit.T_world_part is sighting.T_world_part)


def _of_parts(parts: Sequence[PartialSighting], scene: TableScene) -> list[Seen]:
    """Return the sightings of the parts of one cluster, and of the rest."""
    out = []
    others = len(parts) - 1
    for one in parts:
        area_mm2 = one.region.area_px * scene.pixel_mm2
        best = one.decision.best
        if best is None:
            seen = unknown(one.region, scene, area_mm2, one.decision.score, LEFT_OVER)
        else:
            seen = known(one.decision, best, one.region, area_mm2, scene.library)
        is_cut = one.region.touches_edge
        seen = replace(
            seen,
            free_share=one.free_share,
            touching_count=others,
            is_cut=is_cut and best is not None,
            lies_on=one.lies_on,
            is_covered=one.is_covered,
        )
        out.append((seen, Trace(one.region, (), one.hypotheses)))
    return out


def each_once(every: Sequence[Answers]) -> list[Answers]:
    """Return answers without pieces of a part that is named elsewhere.

    Parameters
    ----------
    every : of regions, what is in each
    """
    named = [seen for _, answers in every for seen, _ in answers if seen.part is not None]
    named.sort(key=lambda seen: -seen.score)
    first = [
        seen
        for k, seen in enumerate(named)
        if not any(_are_one(seen, other) for other in named[:k])
    ]
    return [
        (region, answers)
        for region, answers in every
        if len(answers) > 1
        or answers[0][0].part is None
        or any(answers[0][0] is seen for seen in first)
    ]


def _are_one(a: Sighting, b: Sighting) -> bool:
    """Return True if two sightings have one kind of part in one place."""
    return a.part == b.part and bool(np.hypot(a.x_mm - b.x_mm, a.y_mm - b.y_mm) < SAME_PLACE_MM)
