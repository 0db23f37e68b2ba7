"""Which fits to a cluster are there together: the search against all sets there are."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pytest
from numpy.typing import NDArray

from controller.recognition.partial import best_set, by_place

COST = 3.0


@dataclass(frozen=True, eq=False)
class Fit:
    shadow: NDArray[np.bool_]
    explains: NDArray[np.bool_]
    weight: float = 1.0


def fit_at(first: int, last: int, weight: float = 1.0) -> Fit:
    seen = (np.arange(40) >= first) & (np.arange(40) < last)
    return Fit(seen, seen, weight)


def gain(fit: Fit, points: float) -> float:
    return points * fit.weight - COST


def in_one_place(a: Fit, b: Fit) -> bool:
    return int((a.shadow & b.shadow).sum()) > 4


def value_of(fits: list[Fit]) -> float:
    explained, value = np.zeros(40, dtype=np.bool_), 0.0
    for fit in fits:
        value += gain(fit, float((fit.explains & ~explained).sum()))
        explained |= fit.explains
    return value


@pytest.mark.parametrize("seed", range(20))
def test_the_set_found_gains_as_much_as_any_that_can_be_there_together(seed: int) -> None:
    rng = np.random.default_rng(seed)
    begins = rng.integers(0, 34, 7).tolist()
    fits = [fit_at(k, k + int(rng.integers(3, 14)), rng.uniform(0.2, 1.0)) for k in begins]
    found = [fits[k] for k in best_set(fits, in_one_place, gain)]
    able = [
        list(some)
        for count in range(len(fits) + 1)
        for some in combinations(fits, count)
        if not any(in_one_place(a, b) for a, b in combinations(some, 2))
    ]
    assert any(len(some) == len(found) and set(some) == set(found) for some in able)
    assert value_of(found) == pytest.approx(max(value_of(some) for some in able))


def test_fits_are_sorted_by_the_first_one_of_their_place_and_places_beyond_the_limit_left_out() -> (
    None
):
    first, same, beside, far = fit_at(0, 10), fit_at(1, 11), fit_at(12, 20), fit_at(30, 38)
    assert by_place([first, beside, far, same], 0.5, 2) == [[first, same], [beside]]
