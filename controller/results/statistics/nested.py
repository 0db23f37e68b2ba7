"""Nested analysis of variance: the share of each level of repetition (references.md S25).

Values are repeated within grasps, grasps within start poses, start poses within parts. Groups may
be of different sizes: mean squares are equated with their expectations, level by level. If each
group of a level has one member only, the two levels cannot be separated, and are one here.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray, IntArray

from .capability import Interval, chi_square_quantile

CONFIDENCE: Final = 0.95


@dataclass(frozen=True, slots=True)
class Component:
    """Variance of one level, or of several that cannot be separated.

    Attributes
    ----------
    levels : their names, the coarsest first
    variance : with its 95 % interval; none of the three is below 0
    freedom : degrees of freedom of the level's mean square
    """

    levels: tuple[str, ...]
    variance: Interval
    freedom: int


@dataclass(frozen=True, eq=False, slots=True)
class NestedStudy:
    """The scatter of values, level by level.

    Attributes
    ----------
    n, mean : number and mean of all values
    components : from the coarsest level to the finest
    hidden : levels of which there is one group only, so that nothing is known of what they add
    counts : groups of each level, by name; of the finest the values
    """

    n: int
    mean: float
    components: tuple[Component, ...]
    hidden: tuple[str, ...]
    counts: dict[str, int]
    mean_squares: FloatArray
    shares: FloatArray

    def variance_below(self, level: str) -> Interval | None:
        """Return the variance of one level and all below it, with its interval; None if unknown.

        A level that cannot be told apart from a coarser one counts with that.
        """
        order = list(self.counts)
        first = next(
            (i for i, c in enumerate(self.components) if _is_at_or_below(c, level, order)), None
        )
        if first is None:
            return None
        return self._interval(self.shares[first:].sum(axis=0))

    def _interval(self, share: FloatArray) -> Interval:
        freedom = np.array([c.freedom for c in self.components])
        return _limits(share, self.mean_squares, freedom)


def nested_study(
    values: Sequence[float], groups: Sequence[tuple[Hashable, ...]], names: Sequence[str]
) -> NestedStudy | None:
    """Return the variance components of values, per level; None if nothing is repeated.

    Parameters
    ----------
    values : n of them
    groups : name of each value's group on each level but the finest, the coarsest first; a group is
        known by its name within its own
    names : names of all levels, the coarsest first; the last one is of the values themselves

    Raises
    ------
    ValueError : not as many groups as values, or names as levels
    """
    x = np.asarray(values, dtype=float)
    if len(groups) != len(x) or any(len(group) != len(names) - 1 for group in groups):
        raise ValueError("each value needs a group on each level but the finest")
    if len(x) < 2:
        return None
    members = [_numbers([g[: k + 1] for g in groups]) for k in range(len(names) - 1)]
    members.append(np.arange(len(x)))
    counts = [int(m.max()) + 1 for m in members]
    hidden: list[str] = []
    kept: list[tuple[list[str], IntArray, int]] = []  # names, members, degrees of freedom
    before = 1
    for name, member, count in zip(names, members, counts, strict=True):
        if count > before:
            kept.append(([name], member, count - before))
        elif kept:  # each group has one member, so the two levels cannot be separated
            kept[-1][0].append(name)
        else:
            hidden.append(name)
        before = count
    if not kept:
        return None
    squares, expected = _analysis(x, [m for _, m, _ in kept])
    freedom = np.array([f for _, _, f in kept])
    shares = np.asarray(np.linalg.inv(expected), dtype=float)
    components = tuple(
        Component(tuple(levels), _limits(shares[i], squares, freedom), f)
        for i, (levels, _, f) in enumerate(kept)
    )
    return NestedStudy(
        len(x), float(x.mean()), components, tuple(hidden),
        dict(zip(names, counts, strict=True)), squares, shares,
    )  # fmt: skip


def _is_at_or_below(component: Component, level: str, order: Sequence[str]) -> bool:
    return order.index(component.levels[-1]) >= order.index(level)


def _numbers(keys: Sequence[Hashable]) -> IntArray:
    """Return each key's number, in the order of first occurrence."""
    known: dict[Hashable, int] = {}
    return np.array([known.setdefault(key, len(known)) for key in keys])


def _analysis(x: FloatArray, members: Sequence[IntArray]) -> tuple[FloatArray, FloatArray]:
    """Return mean squares (k,) and their expectations (k, k) in the variances of all levels."""
    every = [np.zeros(len(x), dtype=int), *members]
    sums = np.array([_sum_of_squares(x, member) for member in every])
    overlap = np.array([[_overlap(coarse, fine) for fine in members] for coarse in every])
    freedom = np.diff([len(np.unique(member)) for member in every])
    expected = np.triu(np.diff(overlap, axis=0) / freedom[:, None])
    return np.diff(sums) / freedom, expected


def _sum_of_squares(x: FloatArray, member: IntArray) -> float:
    centred = x - x.mean()  # only differences matter; centring avoids cancellation
    return float((np.bincount(member, centred) ** 2 / np.bincount(member)).sum())


def _overlap(coarse: IntArray, fine: IntArray) -> float:
    """Return the sum over pairs of groups of their common values squared, over the coarse size."""
    table = np.zeros((int(coarse.max()) + 1, int(fine.max()) + 1))
    np.add.at(table, (coarse, fine), 1.0)
    return float((table**2 / table.sum(axis=1, keepdims=True)).sum())


def _limits(share: FloatArray, squares: FloatArray, freedom: FloatArray) -> Interval:
    """Return a sum of shares of mean squares with its interval (modified large samples)."""
    tail = (1 - CONFIDENCE) / 2
    below = 1 - freedom / chi_square_quantile(1 - tail, freedom)
    above = freedom / chi_square_quantile(tail, freedom) - 1
    terms = share * squares
    down = np.where(share > 0, below, above) * terms
    up = np.where(share > 0, above, below) * terms
    value = float(terms.sum())
    lower, upper = value - float(np.hypot.reduce(down)), value + float(np.hypot.reduce(up))
    return Interval(max(value, 0.0), max(lower, 0.0), max(upper, 0.0))
