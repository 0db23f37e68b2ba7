"""Probability of a hypothesis from its evidence, by a logistic curve fitted to pictures."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray

from ..fitting import Evidence

STRETCH_MM = 5.0  # length of edge that counts as one observation; nearer edges share their causes
STRETCH_PX = 10.0  # least length in pixels: in coarse pictures 5 mm are within the blur
SIDE_MM = 20.0  # length of outline that a bent wall or a badly calibrated corner shifts as a whole
MODEL_PX = 0.15  # least uncertainty of an outline, for any noise
PATCH_MM2 = 50.0  # area of surface that counts as one observation
FILM_MM2 = 150.0  # the same area where it decides between two sides: a spot of oil is no smaller
NOISE_VARIANCE = 4.0  # variance that no pose can explain, grey levels squared
FOUND = 1.0  # log-odds of a stretch of inner edge found in its place
ABSENT_LIT = -1.0  # log-odds of a missing one, under lamps
ABSENT_DARK = -0.1  # in the dark inside of a backlit part an edge that does not show means little
SHOWS = 0.85  # probability that an existing edge shows under one of the lamps
CHANCE_MIN = 0.05  # least chance that an edge is found by accident in any picture
# limit of the chance; where edges are everywhere, hardly any is distinguishable from chance
MAX_CHANCE = 0.9
MAX_LOG_ODDS = 12.0  # largest log-odds from any one kind of evidence


@dataclass(frozen=True, slots=True)
class Weights:
    """A logistic curve over evidence, with the weight of each kind of it.

    Attributes
    ----------
    bias : offset added to all of it
    outline, explained, inner, misfit, sigma, shading : of these
    length : length of the logarithm of how many pixels of the picture's edges there were to explain
    """

    bias: float
    outline: float
    explained: float
    inner: float
    misfit: float
    sigma: float
    shading: float
    length: float = 0.0


# Fitted (ADR 8, 90) to path-traced pictures of 26 parts, and under lamps of 14, each set twice more
# with half of its parts unknown, and trace_pictures.py's `--wide`; recognition is judged by other
# pictures. A whole outline is judged without its inside.
SILHOUETTE = Weights(-6.4, 0.0, 12.22, 0.0, -3.66, -1.45, 0.0, 0.0)
FRONT = Weights(-9.62, 0.0, 7.47, 5.48, -1.46, -1.85, 4.48, 0.24)
INNER_HALF_MM = 20.0  # length of inner edges that counts half beside the outline


def probability(evidence: Evidence, weights: Weights) -> float:
    """Return the probability that a hypothesis with this evidence is right, 0..1."""
    share = evidence.inner_mm / (evidence.inner_mm + INNER_HALF_MM)
    # several lamps show more edges by chance than the one that the curve is of
    outline = beyond_chance(evidence.outline, evidence.chance)
    inner = share * beyond_chance(evidence.inner, evidence.chance) + (1 - share) * outline
    logit = (
        weights.bias
        + weights.outline * outline
        + weights.explained * evidence.explained
        + weights.inner * inner
        + weights.misfit * evidence.misfit_px
        + weights.sigma * evidence.sigma_px
        + weights.shading * evidence.shading
        + weights.length * np.log1p(evidence.image_px)
    )
    return float(1.0 / (1.0 + np.exp(-np.clip(logit, -40, 40))))


def beyond_chance(share: float, chance: float) -> float:
    """Return the share of edges found beyond chance: 0 if none is, 1 if all.

    Parameters
    ----------
    share : share of the predicted edges that was found, 0..1
    chance : chance of finding edges placed anywhere, 0..1
    """
    chance = min(chance, MAX_CHANCE)
    return max(share - chance, 0.0) / (1.0 - chance)


def log_odds(evidence: Evidence, *, is_lit: bool) -> float:
    """Return the evidence for a hypothesis, up to a constant of the object, for comparison."""
    edges = float(np.clip(_edges(evidence, is_lit, None), -MAX_LOG_ODDS, MAX_LOG_ODDS))
    return edges + _without_edges(evidence, PATCH_MM2)


def log_odds_of_all(evidences: Sequence[Evidence], *, is_lit: bool) -> list[float]:
    """Return the evidence for hypotheses on one object, for comparison.

    Inner edges that all of them predict say nothing, so it is the best one's lead that is limited.

    Parameters
    ----------
    evidences : of each hypothesis
    is_lit : lamps show what is inside the outline
    """
    length = np.array([evidence.inner_mm for evidence in evidences])
    by_chance = np.array([evidence.chance for evidence in evidences])
    # of one object the pictures are the same, and so is what they show by chance
    chance = float(length @ by_chance / max(length.sum(), 1e-9)) if is_lit else None
    edges = np.array([_edges(evidence, is_lit, chance) for evidence in evidences])
    return [
        float(lead) + _without_edges(evidence, FILM_MM2)
        for lead, evidence in zip(_limited(edges), evidences, strict=True)
    ]


def log_odds_under_lamps(evidences: Sequence[Evidence]) -> list[float]:
    """Return the evidence for hypotheses on one object under lamps, for comparison.

    The lead of one over another is limited for each kind of evidence: light that falls off across
    a wide plate must not outweigh an outline that does not fit.
    """
    # of one object the pictures are the same, and a pixel is as long in all hypotheses
    lengths = [e.image_mm / e.image_px for e in evidences if e.image_px > 0]
    share = min(1.0, STRETCH_MM / (STRETCH_PX * max(lengths, default=0.0) + 1e-9))
    edges = np.array([_edges(evidence, True, None) for evidence in evidences]) * share
    shading = np.array([_shading(evidence, PATCH_MM2) for evidence in evidences]) * share
    explained = np.array([_explained(evidence) for evidence in evidences]) * share
    fit = np.array([_fit(evidence) for evidence in evidences])
    return [float(one) for one in _limited(edges) + _limited(shading) + explained + fit]


def _limited(lead: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(lead - lead.max(initial=-np.inf), -MAX_LOG_ODDS))


def _edges(evidence: Evidence, is_lit: bool, chance: float | None) -> float:
    """Return the score of the inner edges; without ``chance``, by their general weight."""
    found, absent = FOUND, ABSENT_LIT if is_lit else ABSENT_DARK
    if chance is not None:
        chance = min(max(chance, CHANCE_MIN), SHOWS)
        found, absent = np.log(SHOWS / chance), np.log((1.0 - SHOWS) / (1.0 - chance))
    stretches = evidence.inner_mm / STRETCH_MM
    return float(stretches * (found * evidence.inner + absent * (1.0 - evidence.inner)))


def _without_edges(evidence: Evidence, patch_mm2: float) -> float:
    return _explained(evidence) + _shading(evidence, patch_mm2) + _fit(evidence)


def _explained(evidence: Evidence) -> float:
    return evidence.image_mm / STRETCH_MM * evidence.inner_explained


def _shading(evidence: Evidence, patch_mm2: float) -> float:
    patches = evidence.area_mm2 / patch_mm2
    return float(-0.5 * patches * np.log(evidence.residual + NOISE_VARIANCE))


def _fit(evidence: Evidence) -> float:
    sides = evidence.outline_mm / SIDE_MM
    return float(-sides * np.log(evidence.misfit_px**2 + MODEL_PX**2))
