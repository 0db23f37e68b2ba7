"""From what an object may be to how well each of that explains the picture: best first.

Fitting is what costs time. Candidates are tried in the order of their silhouettes' overlap; a
coarse fit with few samples weeds out most, and what cannot come near the best is not fitted at
all.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.cad import Camera

from .fitting import (
    EdgeFit,
    Evidence,
    FitOptions,
    GreyMeasure,
    ImageEdges,
    LoopMeasure,
    Measure,
    fit_edges,
    gather,
    shading_fit,
)
from .library import Candidate, Library, lying, place_of, turn_of

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
Mask = NDArray[np.bool_]

SAME_TURN_RAD = np.radians(4.0)
SAME_PLACE_MM = 2.0


@dataclass(frozen=True, slots=True)
class SearchLimits:
    """How much is tried, each with its reason.

    Attributes
    ----------
    most_coarse : candidates fitted coarsely
    most_fine : of these fitted in full
    coarse_samples : edge samples of a coarse fit: enough to tell a turn that is off
    fine_samples : of a full one
    first_reach_mm : how far off a candidate may lie: its place comes from a centroid
    coarse_share : of the best one's coarse score that others need for a full fit
    overlap_gap : of silhouettes, by which a candidate may fall short of one that fits perfectly
    near_perfect : share of outline found and explained from which a fit is perfect
    tilt_rad : standard deviation of the table's tilt, and of what a chip under a part makes
    rocking_rad : of a part that rests on a curve, which friction holds beside its lowest place
    """

    most_coarse: int = 14
    most_fine: int = 4
    coarse_samples: int = 350
    fine_samples: int = 1100
    first_reach_mm: float = 5.0
    coarse_share: float = 0.75
    overlap_gap: float = 0.025
    near_perfect: float = 0.97
    tilt_rad: float = 0.0015
    rocking_rad: float = 0.02


@dataclass(frozen=True, eq=False, slots=True)
class Hypothesis:
    """A reading of an object that has been fitted to the picture.

    Attributes
    ----------
    part, pose : indices
    theta_rad : turn about z from the pose's ``R``
    place_mm : (2,) of the centre of mass
    fit, evidence : how it lies, and what speaks for it
    overlap : of the silhouettes it was found by, 0 if it was found otherwise
    source : "outline", "corners" or "lines": what proposed it
    """

    part: int
    pose: int
    theta_rad: float
    place_mm: Array
    fit: EdgeFit
    evidence: Evidence
    overlap: float
    source: str


@dataclass(frozen=True, eq=False, slots=True)
class Sight:
    """What of the pictures belongs to one object, ready to be compared with.

    Attributes
    ----------
    loops : its outline, where that is known whole
    greys : gradients of the pictures its inner edges are looked for in
    image_edges : strong edges of the first in and round it
    crop, corner_px, inside : that picture, where the crop begins, and which pixels are the part's
    mm_per_px : there
    is_lit : the pictures of ``greys`` were taken under lamps
    """

    loops: LoopMeasure | None
    greys: tuple[GreyMeasure, ...]
    image_edges: ImageEdges
    crop: Grey
    corner_px: tuple[int, int]
    inside: Mask
    mm_per_px: float
    is_lit: bool

    @property
    def measure(self) -> Measure:
        """What poses are fitted to."""
        return self.loops if self.loops is not None else self.greys[0]


def weigh(
    candidates: Sequence[Candidate],
    sight: Sight,
    camera: Camera,
    library: Library,
    limits: SearchLimits,
    source: str = "outline",
) -> list[Hypothesis]:
    """Return fitted hypotheses, best evidence first."""
    fine: list[Hypothesis] = []
    coarse: list[tuple[float, Candidate, EdgeFit]] = []
    for candidate in distinct(candidates, library)[: limits.most_coarse]:
        if fine and candidate.overlap < fine[0].overlap - limits.overlap_gap:
            break  # one fits perfectly, and this one's outline is another
        fit = _fit(candidate, sight, camera, library, limits, is_coarse=True)
        if fit is None:
            continue
        score = _coarse_score(fit, sight)
        coarse.append((score, candidate, fit))
        if not fine and score > 0.9 and sight.loops is not None:
            refined = _refine(candidate, fit, sight, camera, library, limits, source)
            if refined is not None and _is_perfect(refined, limits):
                fine.append(refined)
                coarse.pop()
    coarse.sort(key=lambda item: -item[0])
    best = 1.0 if fine else (coarse[0][0] if coarse else 0.0)
    for score, candidate, fit in coarse[: limits.most_fine]:
        if score < limits.coarse_share * best:
            break
        refined = _refine(candidate, fit, sight, camera, library, limits, source)
        if refined is not None:
            fine.append(refined)
    return without_repeats(fine, library)


def distinct(candidates: Sequence[Candidate], library: Library) -> list[Candidate]:
    """Return candidates without those that a symmetry of the part makes the same, in order."""
    kept: list[Candidate] = []
    for c in candidates:
        turns = library.entries[c.part].turns_of(c.pose)
        if not any(
            k.part == c.part
            and k.pose == c.pose
            and np.hypot(k.x_mm - c.x_mm, k.y_mm - c.y_mm) < 4 * SAME_PLACE_MM
            and is_same_turn(k.theta_rad, c.theta_rad, turns)
            for k in kept
        ):
            kept.append(c)
    return kept


def is_same_turn(a_rad: float, b_rad: float, turns_rad: Array) -> bool:
    """Tell whether two turns are the same up to those that leave the pose as it is."""
    if len(turns_rad) == 0:
        return True
    gap = (a_rad - b_rad - turns_rad + np.pi) % (2 * np.pi) - np.pi
    return bool(np.abs(gap).min() < SAME_TURN_RAD)


def without_repeats(hypotheses: list[Hypothesis], library: Library) -> list[Hypothesis]:
    """Return hypotheses best first, each pose and turn once."""
    ranked = sorted(hypotheses, key=lambda h: -rank(h.evidence))
    kept: list[Hypothesis] = []
    for h in ranked:
        turns = library.entries[h.part].turns_of(h.pose)
        if not any(
            k.part == h.part
            and k.pose == h.pose
            and float(np.linalg.norm(k.place_mm - h.place_mm)) < SAME_PLACE_MM
            and is_same_turn(k.theta_rad, h.theta_rad, turns)
            for k in kept
        ):
            kept.append(h)
    return kept


def rank(evidence: Evidence) -> float:
    """Return a number that orders hypotheses about one object."""
    return (
        evidence.outline
        + evidence.explained
        + 0.5 * evidence.inner
        + 0.5 * evidence.shading
        - 0.1 * evidence.sigma_px
    )


def _is_perfect(h: Hypothesis, limits: SearchLimits) -> bool:
    return min(h.evidence.outline, h.evidence.explained) > limits.near_perfect


def _reach_px(mm: float, sight: Sight) -> float:
    return max(mm / sight.mm_per_px, 3.0)


def _fit(
    candidate: Candidate,
    sight: Sight,
    camera: Camera,
    library: Library,
    limits: SearchLimits,
    *,
    is_coarse: bool,
) -> EdgeFit | None:
    entry = library.entries[candidate.part]
    model = library.model(candidate.part)
    T = lying(
        model.solid,
        entry.pose(candidate.pose),
        candidate.x_mm,
        candidate.y_mm,
        candidate.theta_rad,
    )
    reach = tuple(_reach_px(mm, sight) for mm in (limits.first_reach_mm, 2.0))
    return fit_edges(
        model,
        T,
        camera,
        sight.measure,
        FitOptions(reach_px=reach, steps=2, most=limits.coarse_samples),
    )


def _coarse_score(fit: EdgeFit, sight: Sight) -> float:
    """Return the share of predicted edges that are about where they should be."""
    off = np.abs(np.nan_to_num(fit.gaps.gap_px, nan=99.0))
    weight = np.where(fit.edges.on_outline, 1.0, 0.5 * np.clip(np.abs(fit.edges.lift), 0, 1))
    if sight.loops is not None:
        weight = fit.edges.on_outline.astype(np.float64)
    near = np.exp(-0.5 * (off / 1.5) ** 2)
    return float((near * weight).sum() / max(weight.sum(), 1e-9))


def _refine(
    candidate: Candidate,
    coarse: EdgeFit,
    sight: Sight,
    camera: Camera,
    library: Library,
    limits: SearchLimits,
    source: str,
) -> Hypothesis | None:
    model = library.model(candidate.part)
    entry = library.entries[candidate.part]
    pose = entry.pose(candidate.pose)
    # under lamps a wall's dark foot is easily lost, and a tilt would make up for it
    is_free = pose.rocking or pose.rolling
    options = FitOptions(
        reach_px=(_reach_px(1.5, sight), _reach_px(0.8, sight)),
        steps=2,
        tilt_rad=limits.rocking_rad if is_free and sight.loops is not None else limits.tilt_rad,
        most=limits.fine_samples,
    )
    fit = fit_edges(model, coarse.T_world_part, camera, sight.measure, options)
    if fit is None:
        return None
    shading = shading_fit(
        model, fit.T_world_part, camera, sight.crop, sight.corner_px, sight.inside
    )
    evidence = gather(fit, sight.mm_per_px, sight.loops, sight.greys, sight.image_edges, shading)
    return Hypothesis(
        candidate.part,
        candidate.pose,
        turn_of(pose.R, fit.T_world_part),
        place_of(entry, fit.T_world_part),
        fit,
        evidence,
        candidate.overlap,
        source,
    )
