"""The cheapest cover: against trying everything, stopped early, and handed over."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from controller.arrays import BoolArray, FloatArray
from controller.planning.search import exact_cover

LIMIT_S = 1e3


def cheapest_s(rows: BoolArray, costs_s: FloatArray) -> float:
    """Return what the cheapest cover costs, by trying every set of rows."""
    sets = (list(s) for k in range(1, len(rows) + 1) for s in combinations(range(len(rows)), k))
    return min(float(costs_s[s].sum()) for s in sets if rows[s].any(axis=0).all())


def a_table(seed: int, *, alike: bool) -> tuple[BoolArray, FloatArray]:
    """Return a table of views, each of which shows a stretch of a ring, and their costs."""
    rng = np.random.default_rng(seed)
    count, around = 11, 30
    first, long = rng.integers(0, around, count), rng.integers(5, 13, count)
    rows = (np.arange(around) - first[:, None]) % around < long[:, None]
    rows[:3] |= rng.random((3, around)) < 0.3
    rows[-1] |= ~rows.any(axis=0)
    costs = np.full(count, 3.65) if alike else rng.uniform(2.0, 5.0, count)
    return rows, costs


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("alike", [True, False])
def test_the_cheapest_cover_is_what_trying_everything_finds(seed: int, alike: bool) -> None:
    rows, costs_s = a_table(seed, alike=alike)
    least_s = cheapest_s(rows, costs_s)
    found, bound_s = exact_cover(rows, costs_s, LIMIT_S)
    assert found is not None
    assert rows[found].any(axis=0).all()
    assert costs_s[found].sum() == pytest.approx(least_s)
    assert bound_s == pytest.approx(least_s)
    assert exact_cover(rows, costs_s, least_s) == (None, least_s)  # nothing is cheaper
    again, _ = exact_cover(rows, costs_s, least_s + 0.01)
    assert again is not None


@pytest.mark.parametrize("alike", [True, False])
def test_stopped_early_the_bound_is_true_and_no_better_cover_was_missed(
    alike: bool,
) -> None:
    rng = np.random.default_rng(8)
    rows = rng.random((40, 60)) < 0.12
    rows[np.arange(60) % 40, np.arange(60)] = True
    costs_s = np.full(40, 3.65) if alike else rng.uniform(2.0, 5.0, 40)
    best, least_s = exact_cover(rows, costs_s, LIMIT_S)
    assert best is not None
    bounds = []
    for nodes in (1, 2, 5, 400):
        found, bound_s = exact_cover(rows, costs_s, LIMIT_S, nodes=nodes)
        assert bound_s <= least_s + 1e-6
        assert found is None or costs_s[found].sum() >= least_s - 1e-6
        bounds.append(bound_s)
    assert bounds == sorted(bounds)
    assert bounds[0] < bounds[-1] == pytest.approx(least_s)  # the first says less than the last
    # what few nodes leave open the solver of mixed integer programs decides as well
    handed, bound_s = exact_cover(rows, costs_s, LIMIT_S, tree_nodes=1)
    assert handed is not None
    assert costs_s[handed].sum() == pytest.approx(least_s)
    assert bound_s == pytest.approx(least_s)
    assert exact_cover(rows, costs_s, least_s, tree_nodes=1) == (None, least_s)
