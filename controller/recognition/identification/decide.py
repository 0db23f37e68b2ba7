"""Decision on fitted hypotheses: the best, its score, its rivals, or "unknown"."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..fitting import MAX_MISFIT_PX, ModelEdgePoints
from .hypotheses import SAME_PLACE_MM, Hypothesis

SAME_OUTLINE_PX = 0.6  # two predicted outlines this near each other are one in any picture
SAME_SHARE = 0.97  # share of an outline's length that must agree; the rest is where samples end
SHOWN_LIFT = 0.2  # difference in brightness (cosines) at an inner edge that always shows
SHOWN_JUMP_MM = 1.5  # height of a step that always shows, by its shadow
# Score from which a part is named. Two to one, since a false name costs more than a refusal: under
# lamps it accepts 1 of 353 strangers and refuses 19 of 391 right answers; 0.5 accepts 5 and
# refuses 11 (ADR 8).
KNOWN = 0.65
LOG_ODDS_SCALE = 3.0  # ADR 8: probabilities come out too sure by about so much
CONVINCING = 0.9
CONVINCING_PX = 0.6  # with a worse fit another hypothesis may lie near by
DECIDES = 6.0  # log-odds from which a hypothesis is ruled out: 7 to 1 on that scale
# Longest connected edge under several lamps that a part may leave unexplained. The longest on 44
# right answers is 24 mm, on a flange of another bore 122 (docs/adr/0090).
MAX_UNEXPLAINED_MM = 40.0


@dataclass(frozen=True, eq=False, slots=True)
class Decision:
    """Decision on a list of hypotheses.

    Attributes
    ----------
    best : None for an unknown object
    score : probability that best is right, or that the object is unknown
    rivals : hypotheses the picture cannot tell from the best: those that look the same, and those
        that would be an answer by themselves and are hardly less likely
    nearest : the hypothesis that came nearest, for the reason why it is unknown
    """

    best: Hypothesis | None
    score: float
    rivals: tuple[Hypothesis, ...]
    nearest: Hypothesis | None


def decide(hypotheses: Sequence[Hypothesis], *, is_backlit: bool) -> Decision:
    """Return the answer for one object.

    Parameters
    ----------
    hypotheses : fitted ones, of one object, best first
    is_backlit : its outline is known whole
    """
    if not hypotheses:
        return Decision(None, 1.0, (), None)
    able = [h for h in hypotheses if not has_other_inside(h)]
    if not able:
        return Decision(None, max(1.0 - hypotheses[0].probability, 0.5), (), hypotheses[0])
    hypotheses, best = able, able[0]
    is_off = is_backlit and best.evidence.misfit_px > MAX_MISFIT_PX
    if best.probability < KNOWN or is_off:
        return Decision(None, max(1.0 - best.probability, 0.5), (), best)
    rivals = tuple(
        h
        for h in hypotheses[1:]
        if best.log_odds - h.log_odds < DECIDES
        and (
            h.probability >= KNOWN
            or looks_same(best.fit.edges, h.fit.edges, outline_only=is_backlit)
        )
    )
    others = [h for h in hypotheses[1:] if h not in rivals]
    if best.probability / (1 + _claims(best, others)) < 0.5:
        # what no alternative accounts for speaks against it
        return Decision(None, max(1.0 - best.probability, 0.5), (), best)
    return Decision(best, best.probability / (1 + _claims(best, hypotheses[1:])), rivals, best)


def has_other_inside(h: Hypothesis) -> bool:
    """Return True if a picture shows a hole, step or groove that the hypothesis lacks."""
    return h.evidence.unexplained_mm > MAX_UNEXPLAINED_MM


def part_score(best: Hypothesis, hypotheses: Sequence[Hypothesis]) -> float:
    """Return the probability that an object is the best hypothesis' part there, at any turn.

    Parameters
    ----------
    best : of the hypotheses
    hypotheses : about one object
    """
    others = [
        h
        for h in hypotheses
        if h.part != best.part or float(np.linalg.norm(h.place_mm - best.place_mm)) >= SAME_PLACE_MM
    ]
    return best.probability / (1 + _claims(best, others))


def _claims(best: Hypothesis, others: Sequence[Hypothesis]) -> float:
    """Return the claim of other hypotheses on the best one's score: all where equally likely."""
    was_looked_into = best.evidence.area_mm2 > 0
    gaps = [
        best.log_odds - h.log_odds for h in others if (h.evidence.area_mm2 > 0) == was_looked_into
    ]
    return float(np.exp(-np.array(gaps) / LOG_ODDS_SCALE).sum())


def is_convincing(hypotheses: Sequence[Hypothesis]) -> bool:
    """Return True if one of the hypotheses on a front-lit object needs no others beside it."""
    return any(
        h.probability > CONVINCING
        and h.evidence.misfit_px < CONVINCING_PX
        and not has_other_inside(h)
        for h in hypotheses
    )


def looks_same(a: ModelEdgePoints, b: ModelEdgePoints, *, outline_only: bool) -> bool:
    """Return True if two predictions are one drawing, both ways, to the picture's resolution.

    Parameters
    ----------
    a, b : predicted edges in one picture, of two hypotheses for one object
    outline_only : True where the picture is backlit: edges inside do not show
    """
    return _covered(a, b, outline_only) and _covered(b, a, outline_only)


def _covered(a: ModelEdgePoints, b: ModelEdgePoints, outline_only: bool) -> bool:
    # creases between surfaces that are lit alike are no difference anyone sees
    shows = (np.abs(a.lift) > SHOWN_LIFT) | (a.jump_mm > SHOWN_JUMP_MM)
    of = a.on_outline if outline_only else a.on_outline | shows
    within = b.on_outline if outline_only else np.ones(len(b.pixels), dtype=np.bool_)
    if not of.any() or not within.any():
        return not of.any()
    pixels, normals = b.pixels[within], b.normals[within]
    far, nearest = cKDTree(pixels).query(a.pixels[of])
    across = np.abs(((a.pixels[of] - pixels[nearest]) * normals[nearest]).sum(axis=1))
    apart = np.array([5.0])
    if len(pixels) > 2:
        apart = np.asarray(cKDTree(pixels).query(pixels, k=2)[0])[:, 1]
    step = np.quantile(apart, 0.9)  # where edges run side by side, samples are nearer than a step
    same = (across < SAME_OUTLINE_PX) & (far < 2 * step + 3.0)
    return bool(same.mean() > SAME_SHARE)
