"""The order of views against trying all orders and all configurations."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, permutations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.planning.search import best_order
from controller.planning.search.order import exact_order, improved_order

Array = np.ndarray


def slowest_joint(a: Array, b: Array) -> Array:
    """Joints move together; the slowest one decides, and downwards is quicker than up."""
    step = b - a
    return np.where(step > 0.0, step * 1.5, -step).max(axis=-1)


def seconds(start: Array, stops: Sequence[Array], end: Array | None) -> float:
    points = [start, *stops, *([] if end is None else [end])]
    return float(sum(slowest_joint(a, b) for a, b in pairwise(points)))


def random_stops(seed: int, count: int, most: int) -> tuple[Array, list[Array], Array | None]:
    rng = np.random.default_rng(seed)
    options = [rng.normal(size=(int(rng.integers(1, most + 1)), 6)) for _ in range(count)]
    end = rng.normal(size=6) if rng.random() < 0.7 else None
    return rng.normal(size=6), options, end


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 4))
def test_the_order_is_as_short_as_the_best_of_all_orders(seed: int, count: int) -> None:
    start, options, end = random_stops(seed, count, 3)
    way = best_order(start, options, end, slowest_joint)
    assert sorted(stop for stop, _ in way) == list(range(count))
    shortest = min(
        seconds(start, [options[s][k] for s, k in zip(order, picks, strict=True)], end)
        for order in permutations(range(count))
        for picks in product(*(range(len(options[s])) for s in order))
    )
    assert seconds(start, [options[s][k] for s, k in way], end) == pytest.approx(shortest)


def test_six_stops_in_one_configuration_each_are_ordered_best() -> None:
    start, options, end = random_stops(3, 6, 1)
    way = best_order(start, options, end, slowest_joint)
    shortest = min(
        seconds(start, [options[s][0] for s in order], end) for order in permutations(range(6))
    )
    assert seconds(start, [options[s][0] for s, _ in way], end) == pytest.approx(shortest)


def test_stops_along_a_line_are_taken_one_after_the_other_however_many() -> None:
    rng = np.random.default_rng(5)
    for count in (3, 12, 25):
        at = rng.permutation(count)
        options = [np.array([[float(k + 1), 0, 0, 0, 0, 0]]) for k in at]
        end = np.array([count + 1.0, 0, 0, 0, 0, 0])
        way = best_order(np.zeros(6), options, end, slowest_joint)
        assert [int(at[stop]) for stop, _ in way] == list(range(count))


def tables(start: Array, options: Sequence[Array], end: Array | None) -> tuple[Array, ...]:
    every = np.concatenate(options)
    stop_of = np.repeat(np.arange(len(options)), [len(o) for o in options])
    last = np.zeros(len(every)) if end is None else slowest_joint(every, end)
    return slowest_joint(start, every), slowest_joint(every[:, None], every[None]), last, stop_of


def test_improved_ways_are_near_the_exact_ones_and_no_longer_than_always_the_nearest() -> None:
    excess = []
    for seed in range(12):
        start, options, end = random_stops(seed, 9, 3)
        every = np.concatenate(options)
        given_tables = tables(start, options, end)
        exact = seconds(start, every[exact_order(*given_tables)], end)
        improved = seconds(start, every[improved_order(*given_tables)], end)
        assert improved >= exact - 1e-9
        excess.append(improved / exact - 1.0)
        left, here, nearest = list(range(9)), start, []
        while left:
            k = min(left, key=lambda s: min(slowest_joint(here, options[s])))
            here = options[k][int(np.argmin(slowest_joint(here, options[k])))]
            nearest.append(here)
            left.remove(k)
        assert improved <= seconds(start, nearest, end) + 1e-9
    assert np.mean(excess) < 0.03


def test_a_long_round_is_the_same_every_time() -> None:
    start, options, end = random_stops(11, 22, 4)
    once = best_order(start, options, end, slowest_joint)
    assert once == best_order(start, options, end, slowest_joint)
    assert sorted(stop for stop, _ in once) == list(range(22))


def test_no_stops_need_no_order_and_a_stop_without_configuration_is_refused() -> None:
    assert best_order(np.zeros(6), [], None, slowest_joint) == []
    with pytest.raises(ValueError, match="without a configuration"):
        best_order(np.zeros(6), [np.zeros((0, 6))], None, slowest_joint)
