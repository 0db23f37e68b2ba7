"""Choice of the fits that explain a cluster together, and of each place given the rest.

Two parts cannot be in one place, and each counts by the evidence that others do not explain. A
place that is uncertain once its neighbours are known is given up, and the rest chosen anew.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...library import Library
from ...partial import best_set, by_place
from ..decide import Decision, decide, part_score
from ..hypotheses import Hypothesis, without_repeats
from .fits import LitFit, are_in_one_place
from .search import SAME_SHADOW, ClusterSearch

MAX_PLACES = 14
PART_COST = 40.0  # edge pixels that another part has to explain
LIKELY = 0.5  # probability from which a shadow counts where poses in one place are compared
LEANS_LESS = 12.0  # log-odds of a leaning part against one that lies flat


@dataclass(frozen=True, eq=False, slots=True)
class ClusterPlace:
    """One thing in a cluster.

    Attributes
    ----------
    fit : the best one's fit
    fits : hypotheses
    decision : decision for it, given its neighbours
    hypotheses : hypotheses, best first
    """

    fit: LitFit
    fits: tuple[LitFit, ...]
    decision: Decision
    hypotheses: tuple[Hypothesis, ...]

    @property
    def sureness(self) -> float:
        """Probability that it is this part, in any pose or turn, 0..1."""
        best = self.decision.best
        return 0.0 if best is None else part_score(best, self.hypotheses)


def chosen(fits: Sequence[LitFit], search: ClusterSearch, library: Library) -> list[ClusterPlace]:
    """Return the things that explain a cluster together, each of them a known part.

    Parameters
    ----------
    fits : all possible fits
    search : weighs them
    library : library of the fits
    """
    every = search.cluster.image_edges.every

    def gain(fit: LitFit, points: float) -> float:
        return points * every * search.alone(fit) - PART_COST

    left = sorted(fits, key=lambda f: -search.worth(f))
    while True:
        places = by_place(left, SAME_SHADOW, MAX_PLACES)
        best = best_set([place[0] for place in places], are_in_one_place, gain)
        taken = [places[k] for k in best]
        firsts = [place[0] for place in taken]
        decided = [_decided(place, firsts, search, library) for place in taken]
        wrong = [place[0] for place, one in zip(taken, decided, strict=True) if one is None]
        if not wrong:
            return [one for one in decided if one is not None]
        left = [f for f in left if not any(f is one for one in wrong)]


def _decided(
    place: Sequence[LitFit], firsts: Sequence[LitFit], search: ClusterSearch, library: Library
) -> ClusterPlace | None:
    others = [f for f in firsts if f is not place[0]]
    able = [f for f in place if f is place[0] or not any(are_in_one_place(f, o) for o in others)]
    area = np.any([f.shadow for f in able if f is place[0] or search.alone(f) > LIKELY], axis=0)
    found = []
    for f in able:
        h = search.hypothesis(f, others, area)
        found.append(replace(h, log_odds=h.log_odds - LEANS_LESS * f.leans))
    hypotheses = tuple(without_repeats(found, library))
    decision = decide(hypotheses, is_backlit=False)
    if decision.best is None:
        return None
    T = decision.best.fit.T_world_part
    fit = next(f for f in able if f.T is T)
    return ClusterPlace(fit, tuple(able), decision, hypotheses)
