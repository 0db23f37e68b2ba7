"""Choice among many fits to one cluster: by places, then the set that explains most.

The same before a light table and under lamps; only the fit and its score differ.
"""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

import numpy as np

from controller.arrays import BoolArray


class FittedPart(Protocol):
    """A part fitted to a cluster."""

    @property
    def shadow(self) -> BoolArray:
        """Mask of the cluster where the part would be seen if nothing hid it."""

    @property
    def explains(self) -> BoolArray:
        """Mask (m,) of the cluster's features that it predicts."""


Fit = TypeVar("Fit", bound=FittedPart)


def are_one_place(a: FittedPart, b: FittedPart, share: float) -> bool:
    """Return True if two fits are of one thing.

    Parameters
    ----------
    a, b : fits to one cluster
    share : share of two shadows in common above which they count as one place
    """
    both = int((a.shadow & b.shadow).sum())
    return both > share * int((a.shadow | b.shadow).sum())


def by_place(fits: Sequence[Fit], share: float, most: int) -> list[list[Fit]]:
    """Return fits by the place they are about, best first.

    Parameters
    ----------
    fits : the best ones first
    share : as for `are_one_place`
    most : largest number of places; fits about others are left out
    """
    places: list[list[Fit]] = []
    for fit in fits:
        for place in places:
            if are_one_place(place[0], fit, share):
                place.append(fit)
                break
        else:
            if len(places) < most:
                places.append([fit])
    return places


def best_set(
    fits: Sequence[Fit],
    are_in_one_place: Callable[[Fit, Fit], bool],
    gain: Callable[[Fit, float], float],
) -> list[int]:
    """Return the numbers of the fits that can be there together and gain most.

    Parameters
    ----------
    fits : one of each place
    are_in_one_place : True if two of them exclude each other
    gain : gain of a fit: the part of its explanation that others lack
    """
    count = len(fits)
    apart = np.ones((count, count), dtype=np.bool_)
    for i in range(count):
        for j in range(i):
            apart[i, j] = apart[j, i] = not are_in_one_place(fits[i], fits[j])
    gains = [max(gain(fit, float(fit.explains.sum())), 0.0) for fit in fits]
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
            look(k + 1, [*taken, k], together, value + gain(fits[k], float(new.sum())))
        look(k + 1, taken, explained, value)

    look(0, [], None, 0.0)
    return best[1]
