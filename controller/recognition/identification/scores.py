"""Evidence -> probability that a hypothesis is right, by a logistic curve fitted to pictures."""

from dataclasses import dataclass

import numpy as np

from ..fitting import Evidence

STRETCH_MM = 5.0  # of edge that counts as one observation; nearer ones share their causes
SIDE_MM = 20.0  # of outline: a bent wall or a badly calibrated corner shifts as much together
MODEL_PX = 0.15  # no outline is known better, whatever the noise
PATCH_MM2 = 50.0  # of surface, likewise
NOISE_VARIANCE = 4.0  # grey levels squared no pose can explain
FOUND = 1.0  # log-odds for a stretch of inner edge that is where it should be
ABSENT_LIT = -1.0  # and for one that is not, under lamps
ABSENT_DARK = -0.1  # in the dark inside of a backlit part an edge that does not show means little
MAX_LOG_ODDS = 12.0  # from any one kind of evidence


@dataclass(frozen=True, slots=True)
class Weights:
    """A logistic curve over evidence: what each kind of it counts."""

    bias: float
    outline: float
    explained: float
    inner: float
    misfit: float
    sigma: float
    shading: float


# Fitted as benchmarks/fit_scores.py does it, to path-traced pictures of 26 parts; they are other
# pictures than those recognition is judged by. An outline that is known whole is judged without
# what lies inside it.
SILHOUETTE = Weights(-6.4, 0.0, 12.22, 0.0, -3.66, -1.45, 0.0)
FRONT = Weights(-8.63, 2.42, 6.91, 3.76, -0.54, -1.13, 4.98)
INNER_HALF_MM = 20.0  # of inner edges, that count half beside the outline


def probability(evidence: Evidence, weights: Weights) -> float:
    """Return how likely a hypothesis with this evidence is right, 0..1."""
    share = evidence.inner_mm / (evidence.inner_mm + INNER_HALF_MM)
    inner = share * evidence.inner + (1 - share) * evidence.outline
    logit = (
        weights.bias
        + weights.outline * evidence.outline
        + weights.explained * evidence.explained
        + weights.inner * inner
        + weights.misfit * evidence.misfit_px
        + weights.sigma * evidence.sigma_px
        + weights.shading * evidence.shading
    )
    return float(1.0 / (1.0 + np.exp(-np.clip(logit, -40, 40))))


def log_odds(evidence: Evidence, *, is_lit: bool) -> float:
    """Return the evidence for a hypothesis, up to a constant of the object's; to compare them."""
    stretches = evidence.inner_mm / STRETCH_MM
    absent = ABSENT_LIT if is_lit else ABSENT_DARK
    edges = stretches * (FOUND * evidence.inner + absent * (1.0 - evidence.inner))
    explained = evidence.image_mm / STRETCH_MM * evidence.inner_explained
    patches = evidence.area_mm2 / PATCH_MM2
    shading = -0.5 * patches * np.log(evidence.residual + NOISE_VARIANCE)
    sides = evidence.outline_mm / SIDE_MM
    fit = -sides * np.log(evidence.misfit_px**2 + MODEL_PX**2)
    return float(np.clip(edges, -MAX_LOG_ODDS, MAX_LOG_ODDS) + explained + shading + fit)
