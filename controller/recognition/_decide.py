"""From fitted hypotheses to an answer: which, how sure, what else, or "unknown"."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ._hypotheses import Hypothesis
from ._scores import FRONT, SILHOUETTE, grey_odds, probability
from .fitting import EdgePoints

Array = NDArray[np.float64]

SAME_OUTLINE_PX = 0.6  # two predicted outlines this near each other are one in any picture
SAME_SHARE = 0.97  # of an outline's length; the rest is where samples end
KNOWN = 0.5  # an answer less likely than not is no answer
GREY_DECIDES = 3.0  # log-odds from which grey levels rule a reading out: 20 to 1


@dataclass(frozen=True, eq=False, slots=True)
class Decision:
    """What a list of hypotheses comes to.

    Attributes
    ----------
    best : None for an unknown object
    score : probability that best is right, or that the object is unknown
    rivals : readings the picture cannot tell from the best
    nearest : the hypothesis that came nearest, for the reason why it is unknown
    """

    best: Hypothesis | None
    score: float
    rivals: tuple[Hypothesis, ...]
    nearest: Hypothesis | None


def decide(hypotheses: Sequence[Hypothesis], *, is_backlit: bool, is_lit: bool) -> Decision:
    """Return the answer for one object.

    Parameters
    ----------
    hypotheses : fitted ones, of one object
    is_backlit : its outline is known whole
    is_lit : there is a picture of it under lamps
    """
    if not hypotheses:
        return Decision(None, 1.0, (), None)
    weights = SILHOUETTE if is_backlit else FRONT
    odds = [probability(h.evidence, weights) for h in hypotheses]
    order = np.argsort([-p for p in odds], kind="stable")
    ranked = [hypotheses[i] for i in order]
    best, p = ranked[0], odds[order[0]]
    if p < KNOWN:
        return Decision(None, 1.0 - p, (), best)
    rivals = []
    for other in ranked[1:]:
        if not looks_same(best.fit.edges, other.fit.edges, outline_only=is_backlit):
            continue
        rivals.append(other)
    # of readings with one outline, what lies inside it decides, if it does
    inside = {id(h): grey_odds(h.evidence, is_lit=is_lit) for h in (best, *rivals)}
    same = sorted([best, *rivals], key=lambda h: -inside[id(h)])
    best = same[0]
    rivals = [h for h in same[1:] if inside[id(best)] - inside[id(h)] < GREY_DECIDES]
    return Decision(best, p / (1 + len(rivals)), tuple(rivals), best)


def looks_same(a: EdgePoints, b: EdgePoints, *, outline_only: bool) -> bool:
    """Tell whether two predictions are one drawing, both ways, to what a picture resolves."""
    return _covered(a, b, outline_only) and _covered(b, a, outline_only)


def _covered(a: EdgePoints, b: EdgePoints, outline_only: bool) -> bool:
    # creases between surfaces that are lit alike are no difference anyone sees
    of = a.on_outline if outline_only else a.on_outline | (np.abs(a.lift) > 0.2)
    within = b.on_outline if outline_only else np.ones(len(b.pixels), dtype=np.bool_)
    if not of.any() or not within.any():
        return not of.any()
    pixels, normals = b.pixels[within], b.normals[within]
    far, nearest = cKDTree(pixels).query(a.pixels[of])
    across = np.abs(((a.pixels[of] - pixels[nearest]) * normals[nearest]).sum(axis=1))
    step = np.median(cKDTree(pixels).query(pixels, k=2)[0][:, 1]) if len(pixels) > 2 else 5.0
    same = (across < SAME_OUTLINE_PX) & (far < 2 * step + 3.0)
    return bool(same.mean() > SAME_SHARE)
