"""Facts of an object: the stages of its recognition, once for picture and table.

Recognition keeps the data its search needs; further data for a reader, such as corners and grey
edges, is computed here from it, by the same functions.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import cv2
import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey
from controller.imaging import Camera, sample_picture

from ..binary import CornerTolerances, NoOutlineError, OutlineCorners, outline_corners
from ..fitting import NEAR_PX, ModelEdgePoints, predict_edges
from ..grey import Edgelets, picture_edgelets
from ..identification.hypotheses import Hypothesis, distinct, is_same_turn
from ..identification.sighting import Recognition, Sighting, Trace
from ..library import Candidate, Library, pose_on_table

MAX_CANDIDATES = 8  # candidates listed; more add nothing
MAX_OTHERS = 3  # rejected hypotheses drawn beside the one that was taken
LOOK_PX = 3  # reach of the search for an edge
STANDS_OUT = 2.0  # strength of an edge that stands out, in median slopes beside predicted edges
FAINT_LIFT = 0.1  # difference of cosines below which lamps may not show the edge of two surfaces
FAINT_JUMP_MM = 1.0  # height of a step whose shadow may not show


@dataclass(frozen=True, eq=False, slots=True)
class EdgeState:
    """State of predicted edges.

    Attributes
    ----------
    edges : their samples
    which : (n,) indices of those reported
    found : (n,) expected positions
    need_not_show : (n,) mask of edges that may be there though they are invisible
    """

    edges: ModelEdgePoints
    which: BoolArray
    found: BoolArray
    need_not_show: BoolArray


@dataclass(frozen=True, eq=False, slots=True)
class Other:
    """A rejected hypothesis: its name, its score, and its outline's samples."""

    caption: str
    edges: ModelEdgePoints


@dataclass(frozen=True, eq=False, slots=True)
class ObjectFacts:
    """One object with all the facts reported of it.

    Attributes
    ----------
    number : from 1
    sighting, trace : answer, and the trace of how it was found
    corners : corners of the outline and of each hole, in the table plane [mm]
    edgelets : pieces of grey edges, where there is no light table
    candidates : the best of the silhouette, symmetric ones once
    chosen : index of the hypothesis taken, -1 for none
    shown : the one that was taken, or that came nearest; -1 if none was fitted
    scores : (h,) scores of each hypothesis alone: how likely its evidence makes it
    edges : results of the predicted edges of the shown one
    others : the best hypotheses besides the shown one: fitted ones, then silhouettes
    """

    number: int
    sighting: Sighting
    trace: Trace
    corners: tuple[OutlineCorners, ...]
    edgelets: Edgelets | None
    candidates: tuple[Candidate, ...]
    chosen: int
    shown: int
    scores: tuple[float, ...]
    edges: tuple[EdgeState, ...]
    others: tuple[Other, ...]


def degrees_text(angle_rad: float, decimals: int) -> str:
    """Return an angle in degrees, zero without a sign."""
    return f"{round(float(np.degrees(angle_rad)), decimals) + 0.0:.{decimals}f}"


def object_facts(
    picture: Grey, camera: Camera, library: Library, seen: Recognition
) -> tuple[ObjectFacts, ...]:
    """Return the facts of all objects of a picture, in the order of its sightings.

    Parameters
    ----------
    picture : (h, w) as it was recognised
    camera : camera that took it
    library : library used for the recognition
    seen : the result, with a trace of each sighting
    """
    limits = CornerTolerances.for_pixels(camera.mm_per_px(np.zeros(3)))
    return tuple(
        _facts(number, sighting, trace, picture, camera, library, seen, limits)
        for number, (sighting, trace) in enumerate(
            zip(seen.sightings, seen.traces, strict=True), start=1
        )
    )


def _facts(
    number: int,
    sighting: Sighting,
    trace: Trace,
    picture: Grey,
    camera: Camera,
    library: Library,
    seen: Recognition,
    limits: CornerTolerances,
) -> ObjectFacts:
    region = trace.region
    is_backlit = seen.segmentation.lighting == "backlit"
    candidates = tuple(distinct(trace.candidates, library)[:MAX_CANDIDATES])
    x0, y0, x1, y1 = region.box_px
    crop = np.ascontiguousarray(picture[y0:y1, x0:x1])
    edgelets = None
    if not is_backlit and crop.size:
        corner = np.array([x0, y0], dtype=np.float64)
        edgelets = picture_edgelets(crop, lambda px: camera.on_plane(px + corner))
    chosen = _chosen(sighting, trace.hypotheses)
    scores = tuple(h.probability for h in trace.hypotheses)
    shown = chosen if chosen >= 0 else int(np.argmax(scores)) if scores else -1
    return ObjectFacts(
        number=number,
        sighting=sighting,
        trace=trace,
        corners=tuple(_corners(region.loops_px, camera, limits)),
        edgelets=edgelets,
        candidates=candidates,
        chosen=chosen,
        shown=shown,
        scores=scores,
        edges=_edge_states(trace.hypotheses[shown], picture, camera, library, is_backlit=is_backlit)
        if shown >= 0
        else (),
        others=_others(trace, candidates, shown, scores, camera, library),
    )


def _corners(
    loops_px: Sequence[FloatArray], camera: Camera, limits: CornerTolerances
) -> Iterator[OutlineCorners]:
    for loop in loops_px:
        with suppress(NoOutlineError):
            yield outline_corners(camera.on_plane(loop)[:, :2], limits)


def _chosen(sighting: Sighting, hypotheses: Sequence[Hypothesis]) -> int:
    if sighting.T_world_part is None:
        return -1
    off = [float(np.abs(h.fit.T_world_part - sighting.T_world_part).max()) for h in hypotheses]
    best = int(np.argmin(off)) if off else -1
    return best if best >= 0 and off[best] < 1e-6 else -1


def _others(
    trace: Trace,
    candidates: Sequence[Candidate],
    shown: int,
    scores: Sequence[float],
    camera: Camera,
    library: Library,
) -> tuple[Other, ...]:
    def name(hypothesis: Hypothesis | Candidate) -> str:
        turn = degrees_text(hypothesis.theta_rad, 1)
        return f"{library.entries[hypothesis.part].name}, pose {hypothesis.pose}, {turn} deg"

    out = [
        Other(f"{name(h)}: score {scores[k]:.3f}", h.fit.edges)
        for k, h in enumerate(trace.hypotheses)
        if k != shown
    ][:MAX_OTHERS]
    for c in candidates:
        if len(out) == MAX_OTHERS:
            break
        entry = library.entries[c.part]
        turns = entry.turns_of(c.pose)
        if any(
            (h.part, h.pose) == (c.part, c.pose) and is_same_turn(h.theta_rad, c.theta_rad, turns)
            for h in trace.hypotheses
        ):
            continue
        model = library.model(c.part)
        T = pose_on_table(model, entry.pose(c.pose), c.x_mm, c.y_mm, c.theta_rad)
        caption = f"{name(c)}: not fitted, overlap {c.overlap:.3f}"
        out.append(Other(caption, predict_edges(model, T, camera)))
    return tuple(out)


def _shows(edges: ModelEdgePoints, picture: Grey) -> BoolArray:
    """Return a mask (n,) of the predicted edges with the steepest grey level at the edge itself."""
    if len(edges.pixels) == 0:
        return np.zeros(0, dtype=np.bool_)
    low = np.floor(edges.pixels.min(axis=0)).astype(int) - LOOK_PX - 4
    high = np.ceil(edges.pixels.max(axis=0)).astype(int) + LOOK_PX + 5
    (x0, y0), (x1, y1) = np.maximum(low, 0).tolist(), np.maximum(high, 1).tolist()
    smooth = cv2.GaussianBlur(picture[y0:y1, x0:x1], (0, 0), 0.8).astype(np.float32)
    if smooth.size == 0:
        return np.zeros(len(edges.pixels), dtype=np.bool_)
    offsets = np.arange(-LOOK_PX, LOOK_PX + 1)
    at = edges.pixels[:, None] - [x0, y0] + offsets[:, None] * edges.normals[:, None]
    slopes = [
        sample_picture(cv2.Scharr(smooth, cv2.CV_32F, *way), at[..., 0], at[..., 1])
        for way in ((1, 0), (0, 1))
    ]
    normals = edges.normals[:, None]
    across = np.abs(slopes[0] * normals[..., 0] + slopes[1] * normals[..., 1])
    noise = float(np.median(across))
    peak = across.argmax(axis=1)
    strong = across.max(axis=1) > STANDS_OUT * noise
    return np.asarray(strong & (np.abs(offsets[peak]) <= NEAR_PX))


def _edge_states(
    h: Hypothesis, picture: Grey, camera: Camera, library: Library, *, is_backlit: bool
) -> tuple[EdgeState, ...]:
    edges = h.fit.edges
    found = h.fit.off_px < NEAR_PX
    if not is_backlit:
        faint = (np.abs(edges.lift) < FAINT_LIFT) & (edges.jump_mm < FAINT_JUMP_MM)
        every = np.ones(len(found), dtype=np.bool_)
        return (EdgeState(edges, every, found, np.asarray(~edges.on_outline & faint)),)
    # edges inside are no part of such a fit, but may show in the dark
    inside = predict_edges(library.model(h.part), h.fit.T_world_part, camera)
    return (
        EdgeState(edges, edges.on_outline, found, np.zeros(len(found), dtype=np.bool_)),
        EdgeState(
            inside, ~inside.on_outline, _shows(inside, picture), np.ones_like(inside.on_outline)
        ),
    )
