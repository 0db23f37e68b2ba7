"""Recognition: from a picture of the table to sightings of part, stable pose and place.

The order is the paper's (references.md P3.0): an object is cut out, its size and outline search the
library, the best hypotheses are fitted edge by edge under full perspective, and the evidence for
each decides. Under lamps, or if silhouettes do not decide, grey-level features propose hypotheses
of their own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, FloatArray, Grey
from controller.imaging import Camera

from ..library import FEW_VIEWS, Candidate, Library, LibraryPart, Silhouette, polar_grid
from ..segmentation import Region, brightest_of, joined, near_ones, segment
from .cutout import ObjectCutout
from .decide import Decision, decide, has_other_inside, is_convincing
from .hypotheses import (
    SAME_PLACE_MM,
    Hypothesis,
    SearchLimits,
    distinct,
    is_tried,
    ranked_under_lamps,
    weigh,
)
from .lines import by_lines
from .lit import parts_of_lit
from .sighting import Alternative, Recognition, Sighting, Trace
from .touching import PartialSighting, parts_of, within
from .wider import look_wider

Answers = tuple[Region, list[tuple[Sighting, Trace]]]  # of a region, and what is in it
LEFT_OVER = "touches known parts, but is none of them as far as it is seen; move it apart"
WHOLE = 0.95  # share of an outline's length that the part itself explains
# distance from the outline of a named part beyond which the outline belongs to another,
BESIDE_MM = 3.0
ANOTHER_MM = 12.0  # if this much of the cluster's outer outline does
LARGER = 1.1  # in largest known silhouettes: anything larger is several parts, or unknown
CROWD = 0.15  # distance in the index: the right view of seen silhouettes was within 0.13
CROWDED_VIEWS = 400  # views compared turn by turn in a crowd: 10 to 16 ms
FAR_BACKLIT = 0.6  # distance in the index: a whole silhouette finds its like nearby
MAX_BY_LINES = 8
LARGEST = 1.3  # in longest parts: the largest object with its shadow
FAR_FRONT = 1.5  # distance in the index of a silhouette with shaded sides missing


@dataclass(frozen=True, slots=True)
class RecognitionLimits:
    """Tolerances of recognition, each with its reason.

    Attributes
    ----------
    min_area_mm2 : smaller things are chips and dust, not parts
    search : limits of the search
    """

    min_area_mm2: float = 60.0
    search: SearchLimits = field(default_factory=SearchLimits)


def recognise(
    picture: Grey,
    camera: Camera,
    library: Library,
    lighting: Literal["backlit", "front", "auto"] = "auto",
    usable: BoolArray | None = None,
    lit: Sequence[Grey] = (),
    limits: RecognitionLimits | None = None,
) -> Recognition:
    """Return the things on the table, the largest first.

    An empty table is an empty answer.

    Parameters
    ----------
    picture : (height, width) grey
    camera : overhead, calibrated
    library : library of the possible parts, made for this camera
    lighting : a light table, lamps above a matt one, or "auto" to tell from the picture
    usable : (height, width) mask of the area for parts (the backlit area); elsewhere nothing is
        visible
    lit : pictures of the same scene under other lamps. Before a light table they decide what
        silhouettes cannot, parts that lie on others among it; under lamps all pictures are judged
        as one
    limits : limits of the search and tolerances on agreement; None for the defaults

    Raises
    ------
    ValueError : the picture is not of the camera's size, or not 8 bits deep
    """
    width, height = camera.size_px
    if picture.shape != (height, width):
        raise ValueError(f"a picture {picture.shape[::-1]} from a camera of {camera.size_px}")
    limits = limits or RecognitionLimits()
    middle = camera.on_plane(np.array([[width / 2, height / 2], [width / 2 + 1, height / 2 + 1]]))
    pixel_mm2 = float(np.prod(np.abs(middle[1, :2] - middle[0, :2])))
    least_px = limits.min_area_mm2 / pixel_mm2
    found = segment(picture, lighting, usable, least_px) if lighting != "front" or not lit else None
    is_backlit = found is not None and found.lighting == "backlit"
    inner: tuple[Grey, ...] = (*lit, picture)
    if lit and not is_backlit:
        inner = (brightest_of((picture, *lit)), picture, *lit)
        found = segment(inner[0], "front", usable, least_px)
    assert found is not None
    sightings: list[Sighting] = []
    traces: list[Trace] = []
    every: list[Answers] = []
    for region in found.regions:
        answers = [_identify(region, inner, camera, library, is_backlit, limits)]
        if is_backlit and _may_be_several(*answers[0], np.sqrt(pixel_mm2)):
            parts = parts_of(region, inner, camera, library, usable, least_px, limits.search)
            if answers[0][0].part is None or len(parts) > 1:
                answers = _of_parts(parts, camera, library, pixel_mm2) or answers
            if lit and _may_lean(region, answers, library, pixel_mm2):
                answers = _seen_under_lamps(
                    region, answers, lit, camera, library, usable, pixel_mm2, limits
                )
        every.append((region, answers))
    if not is_backlit:
        alone: list[Answers] = []
        if len(inner) > 1:
            every, alone = _looked_wider(every, inner, camera, library, usable, limits)
        every = _taken_apart(every, inner, camera, library, usable, pixel_mm2, limits)
        if alone:
            every = sorted([*every, *alone], key=lambda one: -one[0].area_px)
        every = each_once(every)
    for _, answers in every:
        first = len(sightings)
        for sighting, trace in answers:
            below = tuple(first + k for k in sighting.lies_on)
            sightings.append(replace(sighting, lies_on=below) if below else sighting)
            traces.append(trace)
    return Recognition(tuple(sightings), tuple(traces), found)


def _identify(
    region: Region,
    pictures: Sequence[Grey],
    camera: Camera,
    library: Library,
    is_backlit: bool,
    limits: RecognitionLimits,
) -> tuple[Sighting, Trace]:
    outlines, seen = _silhouettes(region, camera)
    if not seen:
        return _unknown(region, camera, 0.0, 1.0, "too small to recognise"), Trace(region, (), ())
    main = seen[0]
    if region.touches_edge:
        reason = "partly outside the picture or the backlit area; move it inwards"
        return _unknown(region, camera, main.area_mm2, 1.0, reason), Trace(region, (), ())
    candidates: list[Candidate] = []
    for which, silhouette in enumerate(seen):
        far = FAR_BACKLIT if is_backlit else FAR_FRONT
        candidates += library.index.search(silhouette, far=far, silhouette=which)
    candidates.sort(key=lambda c: -c.overlap)
    mm = camera.mm_per_px(np.array([*main.centroid_mm, 0.0]))
    cutout = ObjectCutout(region, pictures, mm, outlines, is_backlit=is_backlit)
    hypotheses = weigh(candidates, cutout, camera, library, limits.search)
    if not is_backlit and not is_convincing(hypotheses):
        proposed = by_lines(cutout.crops[0], cutout.corner_px, camera, library, MAX_BY_LINES)
        candidates += proposed
        new = [c for c in proposed if not is_tried(c, hypotheses, library)]
        lines = weigh(new, cutout, camera, library, limits.search, source="lines")
        hypotheses = ranked_under_lamps([*hypotheses, *lines], library)
    decision = decide(hypotheses, is_backlit=is_backlit)
    if is_backlit and decision.best is None and _is_crowded(main, library):
        crowd = library.index.search(main, CROWDED_VIEWS, far=CROWD)
        tried = distinct(candidates, library)[: limits.search.max_coarse]
        new = [c for c in crowd if not is_tried(c, tried, library)]
        candidates += new
        wider = replace(limits.search, max_coarse=limits.search.max_crowded)
        more = weigh(new, cutout, camera, library, wider)
        decision = decide(more, is_backlit=True)
        hypotheses = more if decision.best is not None else hypotheses
    trace = Trace(region, tuple(candidates), tuple(hypotheses))
    if decision.best is None:
        reason = _why_not(decision, library)
        return _unknown(region, camera, main.area_mm2, decision.score, reason), trace
    return _known(decision, decision.best, region, main.area_mm2, library), trace


def _is_crowded(silhouette: Silhouette, library: Library) -> bool:
    """Return True if more views are like a silhouette than the first search compares."""
    return library.index.near_count(silhouette, CROWD) > FEW_VIEWS


def _may_be_several(sighting: Sighting, trace: Trace, mm_per_px: float) -> bool:
    """Return True if an outline is no known part's, or one's with something smaller beside it."""
    if sighting.part is None:
        return True
    best = trace.hypotheses[0]
    if best.evidence.explained > WHOLE:
        return False
    far, _ = cKDTree(best.fit.edges.pixels).query(trace.region.loops_px[0])
    # the loop has a point each pixel
    is_beside = np.asarray(far * mm_per_px > BESIDE_MM)
    return float(is_beside.sum()) * mm_per_px > ANOTHER_MM


def _named(answers: Sequence[tuple[Sighting, Trace]]) -> int:
    """Return the number of parts identified."""
    return sum(seen.part is not None for seen, _ in answers)


def _may_lean(
    region: Region,
    answers: Sequence[tuple[Sighting, Trace]],
    library: Library,
    pixel_mm2: float,
) -> bool:
    """Return True if the unknown rest of a backlit thing may lean on a part, or be several."""
    named = _named(answers)
    if named == len(answers):
        return False
    return named > 0 or bool(region.area_px * pixel_mm2 > LARGER * library.index.area_mm2.max())


def _seen_under_lamps(
    region: Region,
    answers: list[tuple[Sighting, Trace]],
    lit: Sequence[Grey],
    camera: Camera,
    library: Library,
    usable: BoolArray | None,
    pixel_mm2: float,
    limits: RecognitionLimits,
) -> list[tuple[Sighting, Trace]]:
    """Return a backlit cluster as lamps show it, if that names more: parts that lean on others.

    A silhouette cannot tell which of two parts is above the other, and one that leans has not the
    outline of any stable pose.
    """
    pictures = (brightest_of(lit), *lit)
    least_px = limits.min_area_mm2 / pixel_mm2
    known = [_best_of(seen, trace) for seen, trace in answers if seen.part is not None]
    parts = parts_of_lit(region, pictures, camera, library, usable, least_px, limits.search, known)
    under_lamps = _of_parts(parts, camera, library, pixel_mm2)
    return under_lamps if _named(under_lamps) > len(known) else answers


def _best_of(sighting: Sighting, trace: Trace) -> Hypothesis:
    """Return the hypothesis behind a sighting."""
    return next(h for h in trace.hypotheses if h.fit.T_world_part is sighting.T_world_part)


def _taken_apart(
    every: Sequence[Answers],
    pictures: Sequence[Grey],
    camera: Camera,
    library: Library,
    usable: BoolArray | None,
    pixel_mm2: float,
    limits: RecognitionLimits,
) -> list[Answers]:
    """Return answers under lamps with clusters separated; touching things count as one."""
    out = dict(enumerate(every))
    for group in near_ones([region for region, _ in every]):
        numbers = [k for k in group if not every[k][0].touches_edge]
        whole = [every[k] for k in numbers]
        if not any(_may_be_several(*one[1][0], float(np.sqrt(pixel_mm2))) for one in whole):
            continue
        region = joined([region for region, _ in whole])
        least_px = limits.min_area_mm2 / pixel_mm2
        parts = parts_of_lit(region, pictures, camera, library, usable, least_px, limits.search)
        named_singly = sum(answers[0][0].part is not None for _, answers in whole)
        named = sum(part.decision.best is not None for part in parts)
        # one thing with nothing beside it is judged as a whole, pieces of one thing are not
        if max(len(parts), len(whole)) > 1 and (
            named > named_singly or (0 < named == named_singly and len(parts) > len(whole))
        ):
            for k in numbers[1:]:
                del out[k]
            out[numbers[0]] = region, _of_parts(parts, camera, library, pixel_mm2)
    return list(out.values())


def _looked_wider(
    every: Sequence[Answers],
    pictures: Sequence[Grey],
    camera: Camera,
    library: Library,
    usable: BoolArray | None,
    limits: RecognitionLimits,
) -> tuple[list[Answers], list[Answers]]:
    """Return the answers that stay, and those of things identified by all edges about them.

    Parameters
    ----------
    every : regions cut out, each by itself
    pictures : under several lamps, the brightest of all first
    camera, library, usable, limits : camera, library, usable and limits of `recognise`
    """
    left, found = dict(enumerate(every)), []
    known = [region for region, answers in every if answers[0][0].part is not None]
    for group in near_ones([region for region, _ in every]):
        near = [every[k] for k in group if k in left]
        if not near or any(answers[0][0].part is not None for _, answers in near):
            continue
        if usable is not None and any(region.touches_edge for region, _ in near):
            continue
        alone = _by_edges_about(near, known, pictures, camera, library, limits)
        if alone is None:
            continue
        region = alone[1].region
        found.append((region, [alone]))
        known.append(region)
        for k in list(left):
            # pieces farther off that are the part's, too
            if k in group or (left[k][0] not in known and _is_in(left[k][0], region)):
                del left[k]
    return list(left.values()), found


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


def _is_in(piece: Region, region: Region) -> bool:
    """Return True if most of a piece is part of a region."""
    return 2 * int((within(piece, region) & region.mask).sum()) > int(piece.mask.sum())


def _by_edges_about(
    near: Sequence[Answers],
    known: Sequence[Region],
    pictures: Sequence[Grey],
    camera: Camera,
    library: Library,
    limits: RecognitionLimits,
) -> tuple[Sighting, Trace] | None:
    """Return the one part that several unknown pieces make up; None if it stays unknown.

    Parameters
    ----------
    near : the pieces, and what was tried on them
    known : the picture's things that are known
    pictures, camera, library, limits : pictures, camera, library and limits of `recognise`
    """
    region = joined([region for region, _ in near])
    x0, y0, x1, y1 = region.box_px
    ends_mm = camera.on_plane(np.array([[x0, y0], [x1, y1]], dtype=np.float64))[:, :2]
    longest_mm = max(entry.extent_mm for entry in library.entries)
    if np.abs(ends_mm[1] - ends_mm[0]).max() > LARGEST * longest_mm:
        return None  # no part is so large: these are several
    before = [h for _, answers in near for h in answers[0][1].hypotheses]
    wide, candidates, hypotheses = look_wider(
        region, known, before, pictures, camera, library, limits.search
    )
    decision = decide(hypotheses, is_backlit=False)
    if decision.best is None:
        return None
    area_mm2 = sum(answers[0][0].area_mm2 for _, answers in near)
    wide = replace(wide, touches_edge=False)
    sighting = _known(decision, decision.best, wide, area_mm2, library)
    return sighting, Trace(wide, tuple(candidates), tuple(hypotheses))


def _of_parts(
    parts: Sequence[PartialSighting],
    camera: Camera,
    library: Library,
    pixel_mm2: float,
) -> list[tuple[Sighting, Trace]]:
    """Return the sightings of the parts of one cluster, and of the rest."""
    out = []
    others = len(parts) - 1
    for one in parts:
        area_mm2 = one.region.area_px * pixel_mm2
        best = one.decision.best
        if best is None:
            seen = _unknown(one.region, camera, area_mm2, one.decision.score, LEFT_OVER)
        else:
            seen = _known(one.decision, best, one.region, area_mm2, library)
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


def _silhouettes(
    region: Region, camera: Camera
) -> tuple[list[tuple[FloatArray, ...]], list[Silhouette]]:
    """Return the hypotheses about a region's outline, the likeliest first.

    Returns
    -------
    the loops of each in the picture [px], and the silhouette in the table plane
    """
    outlines, found = [], []
    for loops_px in (region.loops_px, *(_loops(m, region) for m in region.alternatives)):
        loops = tuple(camera.on_plane(loop)[:, :2] for loop in loops_px if len(loop) > 8)
        if not loops:
            continue
        try:
            grid, centroid, area = polar_grid(loops)
        except ValueError:
            continue
        perimeter = sum(_length(loop) for loop in loops)
        outlines.append(loops_px)
        found.append(Silhouette(area, perimeter, centroid, grid))
    return outlines, found


def _length(loop: FloatArray) -> float:
    """Return the length of a dense loop, its pixels' zigzag smoothed away."""
    smooth = loop + np.roll(loop, 1, axis=0) + np.roll(loop, 2, axis=0) + np.roll(loop, -1, axis=0)
    return float(np.linalg.norm(np.roll(smooth, -1, axis=0) - smooth, axis=1).sum()) / 4


def _loops(mask: BoolArray, region: Region) -> tuple[FloatArray, ...]:
    """Return the outer loop of a mask's largest piece, and its holes, in the picture [px]."""
    contours, tree = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return ()
    parent = tree[0][:, 3]
    areas = np.array([cv2.contourArea(c) for c in contours])
    outer = int(np.where(parent < 0, areas, -1.0).argmax())
    mine = [outer, *np.flatnonzero(parent == outer).tolist()]
    return tuple(contours[i].reshape(-1, 2) + np.array(region.box_px[:2], float) for i in mine)


def _known(
    decision: Decision, best: Hypothesis, region: Region, area_mm2: float, library: Library
) -> Sighting:
    entry = library.entries[best.part]
    return Sighting(
        part=entry.name,
        pose_index=best.pose,
        R=entry.pose(best.pose).R,
        x_mm=float(best.place_mm[0]),
        y_mm=float(best.place_mm[1]),
        theta_rad=best.theta_rad,
        T_world_part=best.fit.T_world_part,
        score=decision.score,
        covariance=_covariance(best, entry),
        ambiguous_with=tuple(
            Alternative(library.entries[h.part].name, h.pose, h.theta_rad, h.fit.T_world_part)
            for h in decision.rivals
        ),
        area_mm2=area_mm2,
        box_px=region.box_px,
        residual_px=best.fit.sigma_px,
    )


def _covariance(best: Hypothesis, entry: LibraryPart) -> FloatArray:
    """Return the fit's covariance; the turn of a round part, by its mesh alone, is unknown."""
    covariance = best.fit.covariance.copy()
    if len(entry.turns_of(best.pose)) == 0:
        covariance[2, :], covariance[:, 2] = 0.0, 0.0
        covariance[2, 2] = np.pi**2 / 3  # any turn is as likely
    return covariance


def _unknown(
    region: Region, camera: Camera, area_mm2: float, score: float, reason: str
) -> Sighting:
    x0, y0, x1, y1 = region.box_px
    v, u = np.nonzero(region.mask)
    centre = (
        np.array([[x0 + u.mean(), y0 + v.mean()]])
        if len(u)
        else np.array([[(x0 + x1) / 2, (y0 + y1) / 2]])
    )
    ground = camera.on_plane(centre)[0]
    return Sighting(
        part=None,
        pose_index=-1,
        R=None,
        x_mm=float(ground[0]),
        y_mm=float(ground[1]),
        theta_rad=0.0,
        T_world_part=None,
        score=score,
        covariance=None,
        ambiguous_with=(),
        area_mm2=area_mm2,
        box_px=region.box_px,
        residual_px=float("inf"),
        reason=reason,
    )


def _why_not(decision: Decision, library: Library) -> str:
    h = decision.nearest
    if h is None:
        return "none of the known parts has a silhouette of this size and shape"
    name = library.entries[h.part].name
    if has_other_inside(h):
        return (
            f"none of the known parts: nearest is {name}, but an edge of "
            f"{h.evidence.unexplained_mm:.0f} mm is seen where it has none"
        )
    return (
        f"none of the known parts: nearest is {name}, of whose edges "
        f"{100 * h.evidence.outline:.0f} % are in the picture and which explains "
        f"{100 * h.evidence.explained:.0f} % of what is seen"
    )
