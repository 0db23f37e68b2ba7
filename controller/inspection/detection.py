"""Detectable defects: smallest size and share of the surface, by kind.

Every check records at each sample the smallest mark that would have passed its limit; for an
outline, its largest unnoticed deviation. A mark of just that size passes in half of cases, since
noise and texture change its response. This module combines these sizes, sample by sample, into the
size found with a probability of 90 %. The figure comes from the noise model and its assumed
contrasts, not from a count of found defects (ADR 17).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid, SurfaceSamples
from messages import joined, key, say

from ._types import OUTLINE, Check, InspectionLimits, ViewResult
from .edge_evidence import KEPT_PARTS, find_edges
from .integrity import BURR_PX, CHIP_PX
from .limits import MIN_FACE_SHARE
from .lit import DISC, FILTER_STEP, LINE_NODES, LINE_WIDTH, MIN_WIDTH_PX, SPOT_NODES, STEP_PX

MARKS: Final = ("dent", "scratch", "stain")
AT_EDGES: Final = ("chip", "burr")
MISSING: Final = "missing"
KINDS: Final = (*AT_EDGES, *MARKS)
WORDS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "chip": "chips",
        "burr": "burrs",
        "dent": key("dents and pits"),
        "scratch": "scratches",
        "stain": "stains",
        MISSING: key("missing or extra material"),
    }
)
# A filter of the next width averages over 2.8 times the area: a mark that passed its limit in half
# of cases then passes in nine of ten.
NEXT_WIDTH: Final = FILTER_STEP
# Four looks that each find a mark in half of cases all miss it in one case of sixteen.
HALVES: Final = 4
# A run of the outline is a finding from about five standard deviations on; 1.28 more of them make
# nine of ten.
OVER_LIMIT: Final = 1.25
MAX_NAMED: Final = 6
NOTHING_ASKED: Final[Mapping[str, float]] = MappingProxyType({})
NO_FACES: Final[Mapping[int, str]] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Detection:
    """Detectability of one kind of defect, with a probability of 90 %.

    Attributes
    ----------
    kind : chip, burr, dent (including pits), scratch, stain, missing (including extra material)
    size_mm : size asked for by the recipe, or its smallest defect
    share : share of the surface on which that size would be found; for chips and burrs, of the
        sharp edges
    half_mm : size found on half of that share; None where there is none, or no finer size is sought
    is_asked : True if the recipe names it
    open_faces : number and share of each face on less than half of which it would be found
    """

    kind: str
    size_mm: float
    share: float
    half_mm: float | None
    is_asked: bool = False
    open_faces: tuple[tuple[int, float], ...] = ()

    @property
    def sentence(self) -> str:
        """Result in words, without a verb."""
        of = key("the edges") if self.kind in AT_EDGES else key("the surface")
        half = (
            ""
            if self.half_mm is None
            else say(" (half of that: {half_mm:.1f} mm)", half_mm=self.half_mm)
        )
        return say(
            "{words} of {size_mm:g} mm on {percent:.0f} % of {of}{half}",
            words=WORDS[self.kind],
            size_mm=self.size_mm,
            percent=100 * self.share,
            of=of,
            half=half,
        )


def detections(
    solid: Solid,
    samples: SurfaceSamples,
    views: Sequence[ViewResult],
    limits: InspectionLimits,
    asked_mm: Mapping[str, float] = NOTHING_ASKED,
    not_inspected: Mapping[int, str] = NO_FACES,
) -> tuple[Detection, ...]:
    """Return the detectable defects by kind; nothing where no view was evaluated.

    Parameters
    ----------
    solid : the part
    samples : n samples of its surface
    views : results of the views, with the records of each check
    limits : limits, with the smallest defect for kinds that the recipe does not name
    asked_mm : size asked for by the recipe, by kind
    not_inspected : reason, by face id, why the recipe leaves a face out
    """
    checks = [c for v in views if v.evaluated for c in v.checks if not c.reason]
    if not checks:
        return ()
    at_edge = _near_edges(solid, samples, limits.smallest_defect_mm / 4)
    every = np.ones(len(at_edge), dtype=bool)
    found = []
    for kind in (*KINDS, MISSING):
        asked = asked_mm.get(kind, limits.smallest_defect_mm)
        among = at_edge if kind in AT_EDGES else every
        if among.any():
            sizes = found_mm(kind, checks, samples, limits)
            found.append(
                _detection(
                    kind, sizes, among, samples, asked, kind in asked_mm, solid, limits,
                    not_inspected,
                )
            )  # fmt: skip
    return tuple(found)


def in_words(found: Sequence[Detection]) -> str:
    """Return the detectable defects as a sentence without a full stop; empty for none."""
    if not found:
        return ""
    return say(
        "found with 90 % probability: {sentence}",
        sentence=joined("; ", (d.sentence for d in found)),
    )


def stops(found: Sequence[Detection], solid: Solid) -> tuple[str, ...]:
    """Return the defects asked for by the recipe that the pictures would miss, in sentences.

    Parameters
    ----------
    found : detectability by kind of defect
    solid : the part, with the names of its faces
    """
    return tuple(
        say(
            "{words} of {size_mm:g} mm, which the recipe asks for, would not "
            "be found on half of {named}",
            words=WORDS[d.kind],
            size_mm=d.size_mm,
            named=_named(d, solid),
        )
        for d in found
        if d.is_asked and d.open_faces
    )


def least_mm(kind: str, mm_per_px: float, dust_mm: float = InspectionLimits().dust_mm) -> float:
    """Return the smallest size of a kind that a camera finds with 90 % on a clean surface.

    Parameters
    ----------
    kind : kind from `KINDS`
    mm_per_px : pixel size on the part, seen square
    dust_mm : largest width of a speck of dust

    Raises
    ------
    KeyError : the kind is not in `KINDS`
    """
    node_mm = STEP_PX * mm_per_px
    spot = max(2 * DISC * SPOT_NODES[0] * node_mm * NEXT_WIDTH, dust_mm)
    return {
        "chip": CHIP_PX * mm_per_px,
        "burr": BURR_PX * mm_per_px,
        "dent": spot,
        "stain": spot,
        "scratch": LINE_WIDTH * LINE_NODES * node_mm * NEXT_WIDTH,
        MISSING: MIN_WIDTH_PX * mm_per_px,
    }[kind]


def found_mm(
    kind: str, checks: Sequence[Check], samples: SurfaceSamples, limits: InspectionLimits
) -> FloatArray:
    """Return the smallest size found with 90 % at each sample (n,), inf where none is.

    Parameters
    ----------
    kind : kind of defect
    checks : checks made
    samples : n samples of the surface
    limits : limits, with the smallest defect and the largest dust
    """
    nothing = np.full(len(samples.points_mm), np.inf)
    if kind in MARKS:
        looks = [c.smallest_mm[kind] for c in checks if kind in c.smallest_mm]
        if not looks:
            return nothing
        widths = np.sort(np.stack(looks).astype(np.float64), axis=0)
        sure = NEXT_WIDTH * widths[0]
        if len(widths) >= HALVES:
            sure = np.minimum(sure, widths[HALVES - 1])
        return np.asarray(sure if kind == "scratch" else np.maximum(sure, limits.dust_mm))
    if kind == MISSING:
        compared = np.logical_or.reduce([c.compared for c in checks])
        return np.where(compared, limits.smallest_defect_mm, np.inf)
    for check in checks:
        if check.name == OUTLINE:
            size = _at_outline_mm(kind, check)
            nothing = np.where(check.compared, np.minimum(nothing, size), nothing)
    return nothing


def _at_outline_mm(kind: str, check: Check) -> float:
    """Return the smallest chip or burr found by an outline; a chip is half as deep as long."""
    depth = OVER_LIMIT * check.size_mm
    if kind == "chip":
        return max(check.length_mm, 2 * depth)
    return max(check.length_mm * BURR_PX / CHIP_PX, depth)


@lru_cache(maxsize=KEPT_PARTS)
def _near_edges(solid: Solid, samples: SurfaceSamples, reach_mm: float) -> BoolArray:
    """Return a mask (n,) of the samples within reach of a defect of an edge."""
    edges = find_edges(solid, reach_mm / 2)
    if edges is None:
        return np.zeros(len(samples.points_mm), dtype=bool)
    away, _ = cKDTree(edges.points_mm).query(samples.points_mm)
    return np.asarray(away <= reach_mm)


def _detection(
    kind: str,
    sizes: FloatArray,
    among: BoolArray,
    samples: SurfaceSamples,
    asked: float,
    is_asked: bool,
    solid: Solid,
    limits: InspectionLimits,
    not_inspected: Mapping[int, str],
) -> Detection:
    areas = np.where(among, samples.areas_mm2, 0.0)
    is_found = sizes <= asked
    open_faces = [
        (face, share)
        for face, share in _shares(is_found, among, samples)
        if share < MIN_FACE_SHARE
        and face not in not_inspected
        and solid.faces[face].area_mm2 >= limits.min_area_mm2
    ]
    return Detection(
        kind,
        asked,
        float(areas[is_found].sum() / areas.sum()),
        None if kind == MISSING else _half_mm(sizes, np.where(is_found, areas, 0.0)),
        is_asked,
        tuple(open_faces),
    )


def _shares(
    is_found: BoolArray, among: BoolArray, samples: SurfaceSamples
) -> Iterator[tuple[int, float]]:
    for face in np.unique(samples.face_ids[among]).tolist():
        mine = among & (samples.face_ids == face)
        yield face, float(is_found[mine].mean())


def _half_mm(sizes: FloatArray, areas: FloatArray) -> float | None:
    """Return the size not exceeded on half of an area (n,)."""
    known = areas > 0
    if not known.any():
        return None
    order = np.argsort(sizes[known])
    reached = np.cumsum(areas[known][order])
    at = int(np.searchsorted(reached, reached[-1] / 2))
    return float(sizes[known][order][at])


def _named(detection: Detection, solid: Solid) -> str:
    faces = [solid.faces[i].label for i, _ in detection.open_faces]
    more = len(faces) - MAX_NAMED
    named = joined(", ", faces[:MAX_NAMED])
    return say("{named} and {more} more faces", named=named, more=more) if more > 0 else named
