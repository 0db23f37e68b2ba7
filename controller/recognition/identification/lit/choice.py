"""Which of the fits about a cluster are there together, and what each place is with the rest known.

Two parts cannot be in one place, and each counts by what it explains that others do not. A place
of which nothing is sure once its neighbours are known is given up, and the rest chosen anew.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from controller.arrays import BoolArray

from ...library import Library
from ..decide import Decision, decide
from ..hypotheses import Hypothesis, without_repeats
from .fits import LitFit, are_in_one_place
from .search import Search, are_one_place

MAX_PLACES = 14
PART_COST = 40.0  # pixels of edges that another part has to explain
LIKELY = 0.5  # probability from which a shadow counts where poses in one place are compared
LEANS_LESS = 12.0  # log-odds, by which a part leans more rarely than it lies flat


@dataclass(frozen=True, eq=False, slots=True)
class Place:
    """One thing in a cluster.

    Attributes
    ----------
    fit : the best one's
    fits : what it may be
    decision : what it is, its neighbours being what they are
    hypotheses : what it may be, best first
    """

    fit: LitFit
    fits: tuple[LitFit, ...]
    decision: Decision
    hypotheses: tuple[Hypothesis, ...]

    def flat(self) -> "Place | None":
        """Return it as what lies flat on the table; None if it is nothing known then."""
        flat = {id(f.T): f for f in self.fits if not f.leans}
        hypotheses = tuple(h for h in self.hypotheses if id(h.fit.T_world_part) in flat)
        decision = decide(hypotheses, is_backlit=False)
        if decision.best is None:
            return None
        fit = flat[id(decision.best.fit.T_world_part)]
        return Place(fit, tuple(flat.values()), decision, hypotheses)


def chosen(fits: Sequence[LitFit], search: Search, library: Library) -> list[Place]:
    """Return the things that explain a cluster together, each of them a known part.

    Parameters
    ----------
    fits : all that may be there
    search : weighs them
    library : whose parts and stable poses the fits count
    """
    left = sorted(fits, key=lambda f: -search.worth(f))
    while True:
        places = _by_place(left)[:MAX_PLACES]
        taken = [places[k] for k in _best_set([place[0] for place in places], search)]
        firsts = [place[0] for place in taken]
        decided = [_decided(place, firsts, search, library) for place in taken]
        wrong = [place[0] for place, one in zip(taken, decided, strict=True) if one is None]
        if not wrong:
            return [one for one in decided if one is not None]
        left = [f for f in left if not any(f is one for one in wrong)]


def _decided(
    place: Sequence[LitFit], firsts: Sequence[LitFit], search: Search, library: Library
) -> Place | None:
    others = [f for f in firsts if f is not place[0]]
    able = [f for f in place if f is place[0] or not any(are_in_one_place(f, o) for o in others)]
    area = np.any([f.shadow for f in able if f is place[0] or search.alone(f) > LIKELY], axis=0)
    weighed = []
    for f in able:
        h = search.hypothesis(f, others, area)
        weighed.append(replace(h, log_odds=h.log_odds - LEANS_LESS) if f.leans else h)
    hypotheses = tuple(without_repeats(weighed, library))
    decision = decide(hypotheses, is_backlit=False)
    if decision.best is None:
        return None
    T = decision.best.fit.T_world_part
    return Place(next(f for f in able if f.T is T), tuple(able), decision, hypotheses)


def _by_place(fits: Sequence[LitFit]) -> list[list[LitFit]]:
    """Return fits by the place they are about, best first."""
    places: list[list[LitFit]] = []
    for fit in fits:
        for place in places:
            if are_one_place(place[0], fit):
                place.append(fit)
                break
        else:
            places.append([fit])
    return places


def _best_set(fits: Sequence[LitFit], search: Search) -> list[int]:
    """Return which fits that can be there together explain most."""
    count = len(fits)
    apart = np.ones((count, count), dtype=np.bool_)
    for i in range(count):
        for j in range(i):
            apart[i, j] = apart[j, i] = not are_in_one_place(fits[i], fits[j])
    every = search.cluster.image_edges.every
    gains = [max(search.worth(f) - PART_COST, 0.0) for f in fits]
    best: tuple[float, list[int]] = (0.0, [])

    def look(k: int, taken: list[int], explained: BoolArray | None, value: float) -> None:
        nonlocal best
        if value > best[0]:
            best = (value, list(taken))
        if k == count or value + sum(gains[k:]) <= best[0]:
            return
        if all(apart[k, j] for j in taken):
            mine = fits[k].explains
            new = mine if explained is None else mine & ~explained
            together = mine if explained is None else mine | explained
            worth = float(new.sum()) * every * search.alone(fits[k]) - PART_COST
            look(k + 1, [*taken, k], together, value + worth)
        look(k + 1, taken, explained, value)

    look(0, [], None, 0.0)
    return best[1]
