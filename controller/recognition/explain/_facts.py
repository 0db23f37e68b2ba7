"""Facts of an object: the stages of its recognition, once for picture and table.

Recognition keeps the data its search needs; further data for a reader, such as grey edges, is
computed here from it, by the same functions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, Grey
from controller.imaging import Camera

from ..fitting import NEAR_PX, GreyMeasure, ModelEdgePoints, predict_edges
from ..grey import Edgelets, picture_edgelets
from ..identification.hypotheses import Hypothesis, distinct
from ..identification.sighting import Recognition, Sighting, Trace
from ..library import Candidate, Library

MAX_CANDIDATES = 8  # candidates listed; more add nothing
MAX_OTHERS = 3  # rejected hypotheses drawn beside the one that was taken
LOOK_PX = 3.0  # reach of the search for an edge inside a backlit part
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
    edgelets : pieces of grey edges, where there is no light table
    candidates : the best of the silhouette, symmetric ones once
    chosen : index of the hypothesis taken, -1 for none
    shown : the one that was taken, or that came nearest; -1 if none was fitted
    scores : (h,) scores of each hypothesis alone: how likely its evidence makes it
    edges : results of the predicted edges of the shown one
    others : the best fitted hypotheses besides the shown one
    """

    number: int
    sighting: Sighting
    trace: Trace
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
    return tuple(
        _facts(number, sighting, trace, picture, camera, library, seen)
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
) -> ObjectFacts:
    region = trace.region
    is_backlit = seen.segmentation.lighting == "backlit"
    candidates = tuple(distinct(trace.candidates, library)[:MAX_CANDIDATES])
    x0, y0, x1, y1 = region.box_px
    crop = np.ascontiguousarray(picture[y0:y1, x0:x1])
    measure = GreyMeasure(crop, (x0, y0), is_lit=False)
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
        edgelets=edgelets,
        candidates=candidates,
        chosen=chosen,
        shown=shown,
        scores=scores,
        edges=_edge_states(trace.hypotheses[shown], measure, camera, library, is_backlit=is_backlit)
        if shown >= 0
        else (),
        others=_others(trace, shown, library),
    )


def _chosen(sighting: Sighting, hypotheses: Sequence[Hypothesis]) -> int:
    if sighting.T_world_part is None:
        return -1
    off = [float(np.abs(h.fit.T_world_part - sighting.T_world_part).max()) for h in hypotheses]
    best = int(np.argmin(off)) if off else -1
    return best if best >= 0 and off[best] < 1e-6 else -1


def _others(trace: Trace, shown: int, library: Library) -> tuple[Other, ...]:
    names = (f"{library.entries[h.part].name}, pose {h.pose}" for h in trace.hypotheses)
    told = [
        Other(f"{name}, {degrees_text(h.theta_rad, 1)} deg: score {h.probability:.3f}", h.fit.edges)
        for name, h in zip(names, trace.hypotheses, strict=True)
    ]
    return tuple(other for k, other in enumerate(told) if k != shown)[:MAX_OTHERS]


def _edge_states(
    h: Hypothesis, measure: GreyMeasure, camera: Camera, library: Library, *, is_backlit: bool
) -> tuple[EdgeState, ...]:
    edges = h.fit.edges
    found = h.fit.off_px < NEAR_PX
    if not is_backlit:
        faint = (np.abs(edges.lift) < FAINT_LIFT) & (edges.jump_mm < FAINT_JUMP_MM)
        every = np.ones(len(found), dtype=np.bool_)
        return (EdgeState(edges, every, found, np.asarray(~edges.on_outline & faint)),)
    # edges inside are no part of such a fit, but may show in the dark
    inside = predict_edges(library.model(h.part), h.fit.T_world_part, camera)
    gap_px = measure.gaps(inside.pixels, inside.normals, inside, LOOK_PX).gap_px
    shows = np.asarray(np.abs(gap_px) < NEAR_PX)
    return (
        EdgeState(edges, edges.on_outline, found, np.zeros(len(found), dtype=np.bool_)),
        EdgeState(inside, ~inside.on_outline, shows, np.ones_like(inside.on_outline)),
    )
