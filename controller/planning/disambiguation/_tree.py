"""The cheapest views that resolve an ambiguity: usually one, a tree of them for three or more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np

from controller.arrays import FloatArray

from ..model import LIGHTS, CellLayout, HeldHypothesis, Light
from ._reasons import why_alike
from ._rules import DisambiguationRules
from ._separate import Separations, cost_s, separations

SAME_COST_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class DecidingView:
    """A view to take, and the next step for each result.

    Attributes
    ----------
    view : row of the configurations offered
    light : lighting
    margin : the least of the pairs it parts, 1 being just enough
    groups : the hypotheses that it leaves, one group per outcome; they may overlap
    then : per group the next view, None where the ambiguity is over or stays
    """

    view: int
    light: Light
    margin: float
    groups: tuple[tuple[int, ...], ...]
    then: tuple[DecidingView | None, ...]

    @property
    def view_count(self) -> int:
        """Largest number of views taken."""
        return 1 + max((t.view_count for t in self.then if t is not None), default=0)

    def after(self, left: Sequence[int]) -> tuple[tuple[int, ...], DecidingView | None] | None:
        """Return the group and the view that follow when a view left the hypotheses `left`.

        The smallest group that holds them all; None if there is none, which an uninformative view
        may cause.
        """
        fitting = [k for k, g in enumerate(self.groups) if set(left) <= set(g)]
        if not fitting:
            return None
        k = min(fitting, key=lambda k: len(self.groups[k]))
        return self.groups[k], self.then[k]


@dataclass(frozen=True, slots=True, eq=False)
class Indistinguishable:
    """A pair that no available view separates.

    Attributes
    ----------
    best_margin : best margin of all views, less than 1
    reason : a sentence for people
    """

    pair: tuple[int, int]
    best_margin: float
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class DisambiguationTree:
    """Decision tree of views that identify the hypothesis.

    Attributes
    ----------
    first : None where no view tells any two apart
    worst_s : the dearest path through the tree
    indistinguishable : pairs that stay ambiguous
    separations : separations that it was chosen by
    """

    first: DecidingView | None
    worst_s: float
    indistinguishable: tuple[Indistinguishable, ...]
    separations: Separations


def separating_views(
    hypotheses: Sequence[HeldHypothesis],
    layout: CellLayout,
    q: FloatArray,
    seconds: FloatArray,
    opening_mm: float,
    rules: DisambiguationRules | None = None,
) -> DisambiguationTree:
    """Return the views that separate all separable hypotheses, cheapest in the worst case.

    Parameters
    ----------
    hypotheses : hypotheses of the part in the gripper
    layout : the cell
    q : (k, 6) reachable configurations, free of contact whichever hypothesis it is
    seconds : (k,) cost of each
    opening_mm : opening of the arm gripper, the same for all
    rules : uncertainty of the grasp, and the minimum difference; None for the defaults
    """
    rules = rules or DisambiguationRules()
    found = separations(hypotheses, layout, q, seconds, opening_mm, rules)
    best = found.margins.max(axis=(0, 1), initial=0.0)
    ambiguous = [(pair, float(best[p])) for p, pair in enumerate(found.pairs) if best[p] < 1.0]
    indistinguishable = []
    for (i, j), margin in ambiguous:
        a, b = hypotheses[i], hypotheses[j]
        reason = why_alike(a, b, layout, q, opening_mm, margin)
        indistinguishable.append(Indistinguishable((i, j), margin, reason))
    first, worst_s = cheapest_tree(len(hypotheses), found, seconds)
    return DisambiguationTree(first, worst_s, tuple(indistinguishable), found)


def cheapest_tree(
    candidate_count: int, found: Separations, seconds: FloatArray
) -> tuple[DecidingView | None, float]:
    """Return the tree of views whose dearest branch is cheapest, and its cost [s].

    If hypothesis t is the truth, a view leaves those that it cannot separate from t; these groups
    may overlap between truths. Exact over the views offered. The tree is None if no view decides
    anything.

    Parameters
    ----------
    candidate_count : number of candidates; the pairs of ``found`` number them from 0
    found : pairs that each view separates
    seconds : (k,) cost of each configuration [s]
    """
    views = _worth_asking(found, seconds)
    pair_at = {pair: p for p, pair in enumerate(found.pairs)}

    def pairs_of(left: tuple[int, ...]) -> frozenset[int]:
        return frozenset(pair_at[pair] for pair in combinations(left, 2))

    @cache
    def best(left: tuple[int, ...], tried: frozenset[int]) -> tuple[float, DecidingView | None]:
        """Return cost and first view of the cheapest path from here; tried pairs are excluded."""
        open_pairs = pairs_of(left) - tried
        chosen: tuple[float, DecidingView | None] = (np.inf, None)
        for view in views:
            if not open_pairs & view.parts:
                continue
            groups: list[tuple[int, ...]] = []
            for t in left:
                group = tuple(
                    c for c in left if c == t or pair_at[min(c, t), max(c, t)] not in view.parts
                )
                if group not in groups:
                    groups.append(group)
            rest = [best(g, (tried | view.parts) & pairs_of(g)) for g in groups]
            cost = view.cost_s + max(r[0] for r in rest)
            if cost < chosen[0] - SAME_COST_S:
                margins = found.margins[view.row, LIGHTS.index(view.light)]
                margin = min(float(margins[p]) for p in pairs_of(left) & view.parts)
                then = tuple(r[1] for r in rest)
                chosen = cost, DecidingView(view.row, view.light, margin, tuple(groups), then)
        return chosen if chosen[1] is not None else (0.0, None)

    _, first = best(tuple(range(candidate_count)), frozenset())
    return first, _worst_s(first, seconds)


@dataclass(frozen=True, slots=True)
class _View:
    """A configuration and a light, the pairs it separates, and its expected cost."""

    row: int
    light: Light
    parts: frozenset[int]
    cost_s: float


def _worth_asking(found: Separations, seconds: FloatArray) -> list[_View]:
    """Return the cheapest view for each set of pairs that some view separates."""
    kept: dict[frozenset[int], _View] = {}
    for k in range(len(found.margins)):
        for row, light in enumerate(LIGHTS):
            margins = found.margins[k, row]
            parts = frozenset(np.flatnonzero(margins >= 1.0).tolist())
            if not parts:
                continue
            weakest = min(float(margins[p]) for p in parts)
            cost = float(cost_s(seconds[k : k + 1], np.array([weakest]))[0])
            if parts not in kept or cost < kept[parts].cost_s - SAME_COST_S:
                kept[parts] = _View(k, light, parts, cost)
    return sorted(kept.values(), key=lambda v: (v.cost_s, v.row, v.light))


def _worst_s(step: DecidingView | None, seconds: FloatArray) -> float:
    if step is None:
        return 0.0
    return float(seconds[step.view]) + max(_worst_s(t, seconds) for t in step.then)
