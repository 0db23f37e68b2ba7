"""Search over an object's hypotheses: each fitted to the picture, best first.

Fitting is the slow step. Candidates are tried in the order of their silhouettes' overlap; a coarse
fit with few samples removes most, and hopeless ones are not fitted at all. The inside of an outline
is used only if the outline leaves a choice.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, takewhile

import numpy as np

from controller.arrays import FloatArray

from ..fitting import (
    FINE_REACH_MM,
    EdgeFit,
    EdgeModel,
    Evidence,
    FitOptions,
    FreeTurn,
    ImageEdges,
    Shading,
    are_highlights,
    are_shaded,
    at_rest_in,
    coarse_fit,
    fit_edges,
    grey_evidence,
    longest_alone_mm,
    outline_evidence,
    predict_edges,
    shading_fits,
    with_inside,
)
from ..library import Candidate, Library, is_same_turn, place_of, pose_on_table, turn_of
from ..partial import Cluster, predicted_shares
from .cutout import ObjectCutout
from .scene import SearchLimits
from .scores import (
    FRONT,
    SILHOUETTE,
    log_odds,
    log_odds_of_all,
    log_odds_under_lamps,
    probability,
)

SAME_TURN_RAD = np.radians(4.0)
SAME_PLACE_MM = 2.0
FEW_OTHERS = 3  # candidates up to which a fit is faster than a test, whose outline map takes 4 ms
OUTLINE_DECIDES = 15.0  # log-odds between fits of one outline that its inside cannot reverse


@dataclass(frozen=True, eq=False, slots=True)
class Hypothesis:
    """One hypothesis for an object, fitted to the picture.

    Attributes
    ----------
    part, pose : indices
    theta_rad : turn about z from the pose's ``R``
    place_mm : (2,) place of the centre of mass
    fit, evidence : its pose, and the evidence for it
    probability : probability that it is right, by itself
    log_odds : up to a constant, to compare it with other hypotheses about the same object
    overlap : overlap of the silhouettes it was found by, or score of the lines
    source : what proposed it, as `Candidate` has it; "cluster" for a fit beside others
    free_turn : axis about which the pictures leave its turn open; None if they show it
    """

    part: int
    pose: int
    theta_rad: float
    place_mm: FloatArray
    fit: EdgeFit
    evidence: Evidence
    probability: float
    log_odds: float
    overlap: float
    source: str
    free_turn: FreeTurn | None = None


def hypothesis_of(
    candidate: Candidate | Hypothesis,
    fit: EdgeFit,
    library: Library,
    evidence: Evidence,
    probability: float,
    log_odds: float,
    source: str,
) -> Hypothesis:
    """Return a fitted candidate as a hypothesis.

    Parameters
    ----------
    candidate, fit : candidate, and the fit of its pose
    library : library of the candidate
    evidence, probability, log_odds, source : of the `Hypothesis`
    """
    entry = library.entries[candidate.part]
    return Hypothesis(
        part=candidate.part,
        pose=candidate.pose,
        theta_rad=turn_of(entry.pose(candidate.pose).R, fit.T_world_part),
        place_mm=place_of(entry, fit.T_world_part),
        fit=fit,
        evidence=evidence,
        probability=probability,
        log_odds=log_odds,
        overlap=candidate.overlap,
        source=source,
    )


def weigh(
    candidates: Sequence[Candidate], cutout: ObjectCutout, limits: SearchLimits
) -> list[Hypothesis]:
    """Return fitted hypotheses, best first.

    Parameters
    ----------
    candidates : likeliest first; equal ones are fitted once
    cutout : the object
    limits : limits of the search
    """
    fine: list[Hypothesis] = []
    held: list[tuple[float, Candidate, EdgeFit]] = []
    bound, lead = -np.inf, 0.0
    most = limits.max_coarse if cutout.is_backlit else limits.max_lit
    likely: Iterator[Candidate] = islice(_distinct_ones(candidates, cutout.library), most)
    if cutout.is_backlit:
        likely = _that_may_fit(likely, lambda: bound, cutout, limits)
    for candidate in likely:
        if candidate.overlap < bound:
            break  # one fits perfectly, and this one's outline is another
        worth = limits.coarse_share * lead if lead >= limits.sure_coarse else 0.0
        coarse, score = _coarse(candidate, cutout, limits, worth)
        lead = max(lead, score)
        if coarse is None:
            continue
        if score < limits.sure_coarse:
            held.append((score, candidate, coarse))
            continue
        refined = _refine(candidate, coarse, cutout, limits)
        if refined is not None:
            fine.append(refined)
            if _is_perfect(refined, limits):
                bound = max(bound, refined.overlap - limits.overlap_gap)
    # what lies inside may yet decide against an outline that fits under lamps
    if not cutout.is_backlit or not any(_is_perfect(h, limits) for h in fine):
        held.sort(key=lambda item: -item[0])
        for score, candidate, coarse in held[: limits.max_fine]:
            if score < limits.coarse_share * held[0][0]:
                break
            if cutout.is_backlit and fine and score < limits.least_coarse:
                break  # it cannot be the answer, and another one says what came nearest
            refined = _refine(candidate, coarse, cutout, limits)
            if refined is not None:
                fine.append(refined)
    if not cutout.is_backlit:
        return ranked_under_lamps(fine, cutout.library)
    fine = without_repeats(fine, cutout.library)
    if len(fine) > 1:
        fine = look_inside(fine, cutout)
    return fine


def ranked_under_lamps(hypotheses: Sequence[Hypothesis], library: Library) -> list[Hypothesis]:
    """Return hypotheses about one object under lamps, weighed against each other, best first.

    Parameters
    ----------
    hypotheses : fitted ones; of those that are the same the likeliest is kept
    library : knows which turns leave a pose as it is
    """
    scores = log_odds_under_lamps([h.evidence for h in hypotheses])
    weighed = [replace(h, log_odds=score) for h, score in zip(hypotheses, scores, strict=True)]
    return without_repeats(weighed, library)


def look_inside(fine: list[Hypothesis], cutout: ObjectCutout) -> list[Hypothesis]:
    """Return hypotheses on a backlit outline; those it leaves open are weighed by the inside.

    Parameters
    ----------
    fine : best first
    cutout : the object
    """
    open_ones = [h for h in fine if h.log_odds > fine[0].log_odds - OUTLINE_DECIDES]
    if len(open_ones) < 2:
        return fine
    looked_at = _look_inside(open_ones, cutout)
    # with and without what lies inside, log-odds have different constants
    return [*without_repeats(looked_at, cutout.library), *fine[len(open_ones) :]]


def distinct(candidates: Sequence[Candidate], library: Library) -> list[Candidate]:
    """Return candidates in order, without those equal by a symmetry of the part."""
    return list(_distinct_ones(candidates, library))


def _distinct_ones(candidates: Sequence[Candidate], library: Library) -> Iterator[Candidate]:
    """Yield `distinct` candidates on demand: mostly only the first few are needed."""
    kept: list[Candidate] = []
    for c in candidates:
        if not any(is_same_reading(k, c, library, 4 * SAME_PLACE_MM) for k in kept):
            kept.append(c)
            yield c


def _that_may_fit(
    candidates: Iterator[Candidate],
    bound: Callable[[], float],
    cutout: ObjectCutout,
    limits: SearchLimits,
) -> Iterator[Candidate]:
    """Yield the first candidate, which mostly is the right one, and the others that may fit.

    If none of these is possible, then the nearest one, for the reason of the refusal.

    Parameters
    ----------
    candidates : by their overlap
    bound : the overlap that they need now that the first one is fitted
    cutout, limits : of `weigh`
    """
    yield from islice(candidates, 1)
    others = list(takewhile(lambda c: c.overlap >= bound(), candidates))
    outline = Cluster(cutout.region, cutout.camera) if len(others) > FEW_OTHERS else None
    if outline is None or len(outline.points_px) == 0:
        yield from others
        return
    met, _ = predicted_shares(others, outline, cutout.library, limits.first_reach_mm)
    least = min(limits.least_met, float(met.max()))
    yield from (c for c, share in zip(others, met.tolist(), strict=True) if share >= least)


def is_tried(
    candidate: Candidate | Hypothesis,
    hypotheses: Sequence[Candidate | Hypothesis],
    library: Library,
) -> bool:
    """Return True if a candidate is among some others, or has led to one of the hypotheses.

    Parameters
    ----------
    candidate : a view, fitted or not
    hypotheses : hypotheses of the same object, fitted or not
    library : knows which turns leave a pose as it is
    """
    return any(is_same_reading(h, candidate, library) for h in hypotheses)


def without_repeats(hypotheses: Sequence[Hypothesis], library: Library) -> list[Hypothesis]:
    """Return hypotheses best first, without repeats of pose and turn."""
    kept: list[Hypothesis] = []
    for h in sorted(hypotheses, key=lambda h: -h.log_odds):
        if not any(is_same_reading(k, h, library) for k in kept):
            kept.append(h)
    return kept


def is_same_reading(
    a: Candidate | Hypothesis,
    b: Candidate | Hypothesis,
    library: Library,
    within_mm: float = SAME_PLACE_MM,
) -> bool:
    """Return True if two hypotheses are one part, in one stable pose, at one position.

    Parameters
    ----------
    a, b : of one object, in the world's frame
    library : knows which turns leave a pose as it is
    within_mm : distance of the centres of mass below which their positions are one
    """
    turns = library.entries[a.part].turns_of(a.pose)
    return (
        (a.part, a.pose) == (b.part, b.pose)
        and float(np.linalg.norm(a.place_mm - b.place_mm)) < within_mm
        and is_same_turn(a.theta_rad, b.theta_rad, turns, SAME_TURN_RAD)
    )


def _is_perfect(h: Hypothesis, limits: SearchLimits) -> bool:
    return h.probability > limits.perfect and h.evidence.misfit_px < limits.perfect_px


def _reach_px(mm: float, cutout: ObjectCutout) -> float:
    return max(mm / cutout.mm_per_px, 3.0)


def _coarse(
    candidate: Candidate, cutout: ObjectCutout, limits: SearchLimits, worth: float
) -> tuple[EdgeFit | None, float]:
    """Return a candidate's first fit and score; a tall part is sought over a wider range.

    Under lamps inner edges are near each other, and a view made for another place may be off by
    more than that: there the outline is fitted first.

    Parameters
    ----------
    candidate, cutout, limits : of `weigh`
    worth : score that a candidate needs now that another one fits; under lamps, one that falls
        short of it gets no second try
    """
    pose = cutout.library.entries[candidate.part].pose(candidate.pose)
    model = cutout.library.model(candidate.part)
    T = pose_on_table(model, pose, candidate.x_mm, candidate.y_mm, candidate.theta_rad)
    best, best_score = None, 0.0
    if not cutout.is_backlit and candidate.source == "outline":
        best, best_score = _coarse_by_outline(T, candidate, cutout, limits)
        if best_score >= limits.sure_coarse or best_score < worth:
            return best, best_score
    reaches_mm = [limits.first_reach_mm]
    if cutout.is_backlit and candidate.slack_mm >= limits.slack_mm:
        reaches_mm.append(limits.first_reach_mm + candidate.slack_mm)
    reaches_px = [_reach_px(mm, cutout) for mm in reaches_mm]
    most, sure = limits.coarse_samples, limits.sure_coarse
    fit = coarse_fit(model, T, cutout.camera, cutout.measure, reaches_px, most, sure)
    return (fit, fit.score) if fit is not None and fit.score > best_score else (best, best_score)


def _coarse_by_outline(
    T_world_part: FloatArray, candidate: Candidate, cutout: ObjectCutout, limits: SearchLimits
) -> tuple[EdgeFit | None, float]:
    """Return the fit to a picture's edges, started from the fit to the outline."""
    model = cutout.library.model(candidate.part)
    reach_px = _reach_px(limits.first_reach_mm + candidate.slack_mm, cutout)
    options = FitOptions((reach_px,), steps=3, most=limits.coarse_samples)
    start = fit_edges(model, T_world_part, cutout.camera, cutout.outline, options)
    if start is None:
        return None, 0.0
    options = replace(options, reach_px=(_reach_px(limits.after_outline_mm, cutout),))
    fit = fit_edges(model, start.T_world_part, cutout.camera, cutout.measure, options)
    return fit, 0.0 if fit is None else fit.score


def refitted(h: Hypothesis, T_world_part: FloatArray, cutout: ObjectCutout) -> Hypothesis | None:
    """Return a hypothesis fitted from another pose (4, 4); None where the picture shows too little.

    Parameters
    ----------
    h : its part rests in the same stable pose
    T_world_part : (4, 4) pose to start from
    cutout : the object
    """
    coarse = replace(h.fit, T_world_part=T_world_part)
    return _refine(h, coarse, cutout, cutout.scene.search)


def _refine(
    candidate: Candidate | Hypothesis, coarse: EdgeFit, cutout: ObjectCutout, limits: SearchLimits
) -> Hypothesis | None:
    model = cutout.library.model(candidate.part)
    pose = cutout.library.entries[candidate.part].pose(candidate.pose)
    options = FitOptions(
        reach_px=tuple(_reach_px(min(mm, limits.first_reach_mm), cutout) for mm in FINE_REACH_MM),
        steps=3,
        prior=at_rest_in(pose, is_lit=not cutout.is_backlit),
        most=limits.fine_outline if cutout.is_backlit else limits.fine_samples,
    )
    fit = fit_edges(model, coarse.T_world_part, cutout.camera, cutout.measure, options)
    if fit is None:
        return None
    if cutout.is_backlit:
        evidence = outline_evidence(fit, cutout.outline, cutout.mm_per_px)
    else:
        evidence = _under_lamps(fit, model, cutout)
    own = probability(evidence, SILHOUETTE if cutout.is_backlit else FRONT)
    lead = log_odds(evidence, is_lit=cutout.is_lit)
    return hypothesis_of(candidate, fit, cutout.library, evidence, own, lead, candidate.source)


def _under_lamps(fit: EdgeFit, model: EdgeModel, cutout: ObjectCutout) -> Evidence:
    """Return the evidence of all lamps' pictures for a fit."""
    return grey_evidence(
        fit.edges,
        fit.sigma_px,
        cutout.mm_per_px,
        cutout.greys,
        cutout.image_edges[0],
        Shading.of_all(_shadings(fit, model, cutout)),
        partial(are_highlights, model, fit.T_world_part, cutout.camera),
        partial(are_shaded, model, fit.T_world_part, cutout.camera),
        by_lamp=True,
    )


def judged_within(hypotheses: Sequence[Hypothesis], cutout: ObjectCutout) -> list[Hypothesis]:
    """Return fitted hypotheses on a thing under lamps, judged in another cutout of it.

    Parameters
    ----------
    hypotheses : hypotheses of the thing; their fits stay as they are
    cutout : cutout of the same pictures, of which it says what belongs to the thing
    """
    judged = []
    for h in hypotheses:
        evidence = _under_lamps(h.fit, cutout.library.model(h.part), cutout)
        judged.append(replace(h, evidence=evidence, probability=probability(evidence, FRONT)))
    return ranked_under_lamps(judged, cutout.library)


def alone_in(h: Hypothesis, about: ImageEdges, cutout: ObjectCutout) -> Hypothesis:
    """Return a hypothesis with the longest edge nearby that it does not explain.

    Parameters
    ----------
    h : under lamps, judged by the thing alone
    about : strong edges round the thing
    cutout : cutout of the thing
    """
    shade = partial(are_shaded, cutout.library.model(h.part), h.fit.T_world_part, cutout.camera)
    mm = longest_alone_mm(about, h.fit.edges, cutout.mm_per_px, cutout.greys[0], shade)
    longest_mm = max(mm, h.evidence.unexplained_mm)
    return replace(h, evidence=replace(h.evidence, unexplained_mm=longest_mm))


def _look_inside(hypotheses: Sequence[Hypothesis], cutout: ObjectCutout) -> list[Hypothesis]:
    """Return hypotheses on one outline with the evidence of the grey levels inside."""
    evidences = []
    for h in hypotheses:
        model = cutout.library.model(h.part)
        most = cutout.scene.search.fine_samples
        edges = predict_edges(model, h.fit.T_world_part, cutout.camera, most)
        shadings = _shadings(h.fit, model, cutout)
        shown = list(zip(cutout.image_edges, shadings, strict=True))
        evidences.append(with_inside(h.evidence, edges, cutout.mm_per_px, cutout.greys, shown))
    return [
        replace(h, evidence=evidence, log_odds=score)
        for h, evidence, score in zip(
            hypotheses, evidences, log_odds_of_all(evidences, is_lit=cutout.is_lit), strict=True
        )
    ]


def _shadings(fit: EdgeFit, model: EdgeModel, cutout: ObjectCutout) -> tuple[Shading, ...]:
    return shading_fits(
        model, fit.T_world_part, cutout.camera, cutout.telling, cutout.corner_px, cutout.inside
    )
