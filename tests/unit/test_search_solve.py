"""The search against trying everything, on problems small enough for it."""

from __future__ import annotations

from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.planning.search import (
    Effort,
    GraspSequence,
    Problem,
    greedy,
    live_grasps,
    needed_of,
    refuted,
    solve,
)


def random_problem(seed: int, **kinds: Any) -> Problem:
    """A small problem with ties, gaps, empty tables and missing ways."""
    rng = np.random.default_rng(seed)
    g = int(rng.integers(1, 5))
    m = int(rng.integers(0, 9))
    sizes = [int(rng.integers(0, 6)) for _ in range(g)]
    density = rng.choice([0.2, 0.4, 0.7])
    shows = [rng.random((v, m)) < density for v in sizes]
    if g > 1 and rng.random() < 0.4:  # two grips that show the same
        shows[1], sizes[1] = shows[0].copy(), sizes[0]
    if rng.random() < 0.5:
        view_s = [np.full(v, 3.0) for v in sizes]
    else:
        view_s = [
            rng.choice([2.0, 2.5, 3.0, 0.0, np.inf], v, p=[0.3, 0.3, 0.3, 0.02, 0.08])
            for v in sizes
        ]
    whole = rng.random() < 0.5  # many ties

    def price(shape: Any, least: float, most: float, missing: float) -> Any:
        values = rng.uniform(least, most, shape)
        values = np.round(values) if whole else values
        return np.where(rng.random(shape) < missing, np.inf, values)

    return Problem(
        shows=tuple(shows),
        weights=rng.random(m),
        view_s=tuple(view_s),
        first_s=price(g, 0.0, 6.0, 0.4),
        regrasp_s=price((g, g), 0.0, 8.0, rng.choice([0.0, 0.4, 0.8])),
        last_s=price(g, 0.0, 6.0, 0.4),
        seen=rng.random(m) < rng.choice([0.0, 0.3]),
    )


def all_ways(problem: Problem, most: int) -> list[tuple[int, ...]]:
    """Every way from start to finish, by trying them all."""
    n = problem.grasp_count
    paths = []
    for length in range(1, most + 1):
        for way in product(range(n), repeat=length):
            regrasps = [problem.regrasp_s[a, b] for a, b in pairwise(way) if a != b]
            same = any(a == b for a, b in pairwise(way))
            costs = [problem.first_s[way[0]], *regrasps, problem.last_s[way[-1]]]
            if not same and all(np.isfinite(p) for p in costs):
                paths.append(way)
    return paths


def brute_force(problem: Problem, most: int) -> tuple[float, np.ndarray] | None:
    """The least cost of showing all, and what has to be shown; inf where no way shows it all."""
    paths = all_ways(problem, most)
    if not paths:
        return None
    needed = np.zeros(len(problem.weights), dtype=bool)
    for way in paths:
        for g in way:
            for v, price in enumerate(problem.view_s[g]):
                if np.isfinite(price):
                    needed |= problem.shows[g][v]
    needed &= ~problem.seen
    covers: dict[tuple[int, ...], float] = {}
    best = np.inf
    for way in paths:
        key = tuple(sorted(set(way)))
        if key not in covers:
            covers[key] = _cheapest_cover(problem, key, needed)
        regrasps = sum(problem.regrasp_s[a, b] for a, b in pairwise(way))
        cost = problem.first_s[way[0]] + regrasps + problem.last_s[way[-1]] + covers[key]
        best = min(best, float(cost))
    return best, needed


def _cheapest_cover(problem: Problem, grasps: tuple[int, ...], needed: np.ndarray) -> float:
    # over all masks of elements: the cheapest price to have shown these, view by view
    wanted = np.flatnonzero(needed)
    cost = {0: 0.0}
    for g in grasps:
        for v, price in enumerate(problem.view_s[g]):
            if np.isfinite(price):
                bits = sum(1 << k for k, e in enumerate(wanted) if problem.shows[g][v][e])
                for mask, so_far in list(cost.items()):
                    after = mask | bits
                    cost[after] = min(cost.get(after, np.inf), so_far + float(price))
    return cost.get((1 << len(wanted)) - 1, np.inf)


def check_is_a_way(problem: Problem, solution: GraspSequence) -> None:
    """What a solution says of itself, worked out again."""
    cost = problem.first_s[solution.grasps[0]] + problem.last_s[solution.grasps[-1]]
    for a, b in zip(solution.grasps[:-1], solution.grasps[1:], strict=True):
        assert a != b
        cost += problem.regrasp_s[a, b]
    shown = np.zeros(len(problem.weights), dtype=bool)
    for g, views in zip(solution.grasps, solution.views, strict=True):
        assert list(views) == sorted(set(views))
        for v in views:
            cost += problem.view_s[g][v]
            shown |= problem.shows[g][v]
    assert np.isfinite(cost)
    assert solution.cost_s == pytest.approx(cost)
    assert (solution.covered == shown).all()


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), most=st.integers(1, 4))
def test_the_search_finds_what_trying_everything_finds(seed: int, most: int) -> None:
    problem = random_problem(seed)
    expected = brute_force(problem, most)
    solution = solve(problem, max_grasps=most)
    if expected is None:
        assert solution is None
        return
    assert solution is not None
    cost, needed = expected
    check_is_a_way(problem, solution)
    assert (solution.needed == needed).all()
    if np.isinf(cost):
        assert not solution.is_complete
        assert solution.bound_s == np.inf
        return
    assert solution.is_optimal
    assert solution.cost_s == pytest.approx(cost, abs=1e-6)
    assert solution.bound_s <= cost + 1e-6


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_greedy_is_a_way_and_never_better_than_the_optimum(seed: int) -> None:
    problem = random_problem(seed)
    best, quick = solve(problem), greedy(problem)
    assert (best is None) == (quick is None)
    if best is not None and quick is not None:
        check_is_a_way(problem, quick)
        if quick.is_complete:
            assert best.bound_s <= best.cost_s <= quick.cost_s + 1e-6


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    lower_bounds=st.integers(0, 2),
    covers=st.integers(0, 1),
    paths=st.integers(1, 3),
)
def test_a_search_stopped_early_still_gives_a_true_bound(
    seed: int, lower_bounds: int, covers: int, paths: int
) -> None:
    problem = random_problem(seed)
    expected = brute_force(problem, 4)
    effort = Effort(lower_bounds=lower_bounds, covers=covers, nodes=1, paths=paths)
    solution = solve(problem, max_grasps=4, effort=effort)
    if expected is None:
        assert solution is None
        return
    assert solution is not None
    check_is_a_way(problem, solution)
    assert solution.bound_s <= expected[0] + 1e-6
    if solution.is_complete:
        assert solution.cost_s >= expected[0] - 1e-6


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_same_problem_gives_the_same_solution_and_a_renumbered_one_the_same_cost(
    seed: int,
) -> None:
    problem = random_problem(seed)
    one, two = solve(problem), solve(problem)
    rng = np.random.default_rng(seed)
    grasps = rng.permutation(problem.grasp_count)
    elements = rng.permutation(len(problem.weights))
    orders = [rng.permutation(len(problem.view_s[g])) for g in grasps]
    other = solve(
        Problem(
            shows=tuple(
                problem.shows[g][o][:, elements] for g, o in zip(grasps, orders, strict=True)
            ),
            weights=problem.weights[elements],
            view_s=tuple(problem.view_s[g][o] for g, o in zip(grasps, orders, strict=True)),
            first_s=problem.first_s[grasps],
            regrasp_s=problem.regrasp_s[np.ix_(grasps, grasps)],
            last_s=problem.last_s[grasps],
            seen=problem.seen[elements],
        )
    )
    if one is None:
        assert two is None
        assert other is None
        return
    assert two is not None
    assert other is not None
    assert (one.grasps, one.views, one.cost_s, one.bound_s) == (
        two.grasps,
        two.views,
        two.cost_s,
        two.bound_s,
    )
    assert other.is_complete == one.is_complete
    if one.is_complete:
        assert other.cost_s == pytest.approx(one.cost_s, abs=1e-6)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_refutation_takes_away_what_it_names_and_nothing_else(seed: int) -> None:
    problem = random_problem(seed)
    rng = np.random.default_rng(seed)
    n = problem.grasp_count
    regrasps = [(int(rng.integers(n)), int(rng.integers(n)))]
    views = [(g, 0) for g in range(n) if len(problem.view_s[g]) and rng.random() < 0.5]
    first, last = int(rng.integers(n)), int(rng.integers(n))
    before = [problem.regrasp_s.copy(), problem.first_s.copy(), problem.last_s.copy()]
    less = refuted(problem, regrasps=regrasps, views=views, firsts=[first], lasts=[last])
    for old, now, named in (
        (problem.regrasp_s, less.regrasp_s, regrasps),
        (problem.first_s, less.first_s, [(first,)]),
        (problem.last_s, less.last_s, [(last,)]),
        *(
            (problem.view_s[g], less.view_s[g], [(v,) for h, v in views if h == g])
            for g in range(n)
        ),
    ):
        for index in np.ndindex(old.shape):
            assert now[index] == (np.inf if index in named else old[index])
    for old, kept in zip(before, (problem.regrasp_s, problem.first_s, problem.last_s), strict=True):
        assert (old == kept).all()
    solution = solve(less)
    expected = brute_force(less, 3)
    short = solve(less, max_grasps=3, incumbent=solve(problem, max_grasps=3))
    assert (expected is None) == (short is None)
    if expected is not None and short is not None and short.is_complete:
        check_is_a_way(less, short)
        assert short.cost_s == pytest.approx(expected[0], abs=1e-6)
    if solution is not None:
        assert not set(regrasps) & set(zip(solution.grasps[:-1], solution.grasps[1:], strict=True))
        for g, taken in zip(solution.grasps, solution.views, strict=True):
            assert not {(g, v) for v in taken} & set(views)


def test_a_known_solution_handed_in_does_not_change_the_optimum() -> None:
    for seed in range(15):
        problem = random_problem(seed)
        known = greedy(problem)
        alone, warm = solve(problem), solve(problem, incumbent=known)
        assert (alone is None) == (warm is None)
        if alone is not None and warm is not None and alone.is_complete:
            assert warm.is_optimal
            assert warm.cost_s == pytest.approx(alone.cost_s, abs=1e-6)


def test_a_known_solution_is_made_good_where_one_of_its_views_was_refuted() -> None:
    problem = Problem(
        shows=(np.array([[1, 1, 0, 0], [0, 0, 1, 1], [0, 1, 1, 1], [1, 0, 0, 0]], dtype=bool),),
        weights=np.full(4, 0.25),
        view_s=(np.array([2.0, 2.0, 3.0, 4.0]),),
        first_s=np.zeros(1),
        regrasp_s=np.full((1, 1), np.inf),
        last_s=np.zeros(1),
        seen=np.zeros(4, dtype=bool),
    )
    best = solve(problem)
    assert best is not None
    assert best.views == ((0, 1),)
    less = refuted(problem, views=[(0, 1)])
    again = solve(less, incumbent=best)
    assert again is not None
    assert again.views == ((0, 2),)
    assert again.cost_s == 5.0
    assert again.is_optimal


def pair_problem(regrasp_s: float) -> Problem:
    """Two grips, each showing what the other's pads hide; the first alone takes no finish."""
    return Problem(
        shows=(
            np.array([[True, True, False, False], [False, True, True, False]]),
            np.array([[False, False, True, True]]),
        ),
        weights=np.full(4, 0.25),
        view_s=(np.full(2, 3.0), np.full(1, 3.0)),
        first_s=np.array([5.0, np.inf]),
        regrasp_s=np.array([[np.inf, regrasp_s], [np.inf, np.inf]]),
        last_s=np.array([4.0, 6.0]),
        seen=np.zeros(4, dtype=bool),
    )


def test_two_grips_that_complete_each_other_are_taken_with_one_view_each() -> None:
    solution = solve(pair_problem(10.0))
    assert solution is not None
    assert solution.grasps == (0, 1)
    assert solution.views == ((0,), (0,))
    assert solution.cost_s == 5.0 + 3.0 + 10.0 + 3.0 + 6.0
    assert solution.is_optimal


def test_what_only_a_cut_off_grip_shows_is_not_needed() -> None:
    solution = solve(pair_problem(np.inf))
    assert solution is not None
    assert list(live_grasps(pair_problem(np.inf))) == [0]
    assert list(solution.needed) == [True, True, True, False]
    assert solution.cost_s == 5.0 + 3.0 + 3.0 + 4.0
    assert solution.is_optimal


def test_where_two_grips_exclude_each_other_the_one_that_shows_more_is_taken() -> None:
    problem = Problem(
        shows=(np.array([[True, False, False]]), np.array([[False, True, True]])),
        weights=np.array([0.2, 0.4, 0.4]),
        view_s=(np.array([3.0]), np.array([3.0])),
        first_s=np.array([1.0, 2.0]),
        regrasp_s=np.full((2, 2), np.inf),
        last_s=np.array([1.0, 1.0]),
        seen=np.zeros(3, dtype=bool),
    )
    solution = solve(problem)
    assert solution is not None
    assert needed_of(problem).all()
    assert (solution.grasps, solution.views) == ((1,), ((0,),))
    assert not solution.is_complete
    assert solution.bound_s == np.inf
    assert not solution.is_optimal


def test_a_grip_taken_up_again_only_to_finish_is_found() -> None:
    problem = pair_problem(2.0)
    back = problem.regrasp_s.copy()
    back[1, 0] = 2.0
    only_first = Problem(
        shows=problem.shows,
        weights=problem.weights,
        view_s=problem.view_s,
        first_s=problem.first_s,
        regrasp_s=back,
        last_s=np.array([4.0, np.inf]),
        seen=problem.seen,
    )
    solution = solve(only_first)
    assert solution is not None
    assert solution.grasps == (0, 1, 0)
    assert solution.cost_s == 5.0 + 3.0 + 2.0 + 3.0 + 2.0 + 4.0


def test_tables_that_do_not_fit_together_are_refused() -> None:
    problem = pair_problem(1.0)
    with pytest.raises(ValueError, match="one cost each"):
        Problem(
            shows=problem.shows,
            weights=problem.weights,
            view_s=(np.full(3, 3.0), np.full(1, 3.0)),
            first_s=problem.first_s,
            regrasp_s=problem.regrasp_s,
            last_s=problem.last_s,
            seen=problem.seen,
        )
