"""Identification of the hypothesis in a picture, or the ambiguity that stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray

from ..model import Light
from ._difference import difference
from ._pictures import EdgePicture
from ._rules import DisambiguationRules
from ._separate import PredictedPictures, needed_px

# Share of the difference of two predictions by which a picture must be nearer to one.
CONVINCED = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """Result of one disambiguation view.

    Attributes
    ----------
    left : hypotheses that it may be, the likeliest first; empty if the picture fits none of them
    differs_px : (n,) differences of the picture from each prediction
    """

    left: tuple[int, ...]
    differs_px: FloatArray


def compare(
    measured: EdgePicture, predicted: PredictedPictures, light: Light, among: Sequence[int]
) -> FloatArray:
    """Return the number of pixels by which a picture differs from each prediction.

    Parameters
    ----------
    measured : on the grid of the predictions: mask against the backlight, or edges under the lamps
    predicted : predictions of all hypotheses, in the configuration of the picture
    light : lighting of the picture
    among : the hypotheses still possible; others get inf
    """
    found = np.full(len(predicted.pictures), np.inf)
    for c in among:
        found[c] = difference(measured, predicted.pictures[c], predicted.stance, light)
    return found


def discriminate(
    differs_px: FloatArray,
    apart_px: FloatArray,
    light: Light,
    among: Sequence[int],
    edges_px: FloatArray | None = None,
    rules: DisambiguationRules | None = None,
) -> Identification:
    """Return the hypotheses that are left after a picture.

    A hypothesis that fits worse than the best one is ruled out if the excess is half of the
    difference between the two predictions, and large enough for a picture to decide: errors common
    to both do not count. If the best one itself is as far off as this, the picture shows none of
    them; under lamps, where edges may stay invisible, only if more than half of its edges are
    missing as well.

    Parameters
    ----------
    differs_px : (n,) differences of the picture from each hypothesis's prediction, of `compare`
    apart_px : (n, n) differences between the predictions, of `apart`
    light : lighting of the picture
    among : the hypotheses still possible
    edges_px : (n,) edges that each prediction shows, of `edges_shown`; for pictures under lamps
    rules : minimum difference between pictures; None for the defaults
    """
    rules = rules or DisambiguationRules()
    needed = needed_px(light, rules)
    order = sorted(among, key=lambda c: (differs_px[c], c))
    best = order[0]
    others = [float(apart_px[best, c]) for c in order[1:] if apart_px[best, c] >= needed]
    nearest = min(others, default=needed / CONVINCED)
    shown = 0.0 if edges_px is None else float(edges_px[best])
    if differs_px[best] > CONVINCED * max(nearest, needed / CONVINCED, shown):
        return Identification((), differs_px)
    left = [
        c
        for c in order
        if c == best
        or apart_px[best, c] < needed
        or differs_px[c] - differs_px[best] < CONVINCED * apart_px[best, c]
    ]
    return Identification(tuple(left), differs_px)


def apart(predicted: PredictedPictures, light: Light) -> FloatArray:
    """Return the number of pixels by which the predictions of one view differ (n, n)."""
    n = len(predicted.pictures)
    found = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1, n):
            a, b = predicted.pictures[i], predicted.pictures[j]
            found[i, j] = found[j, i] = difference(a, b, predicted.stance, light)
    return found


def edges_shown(predicted: PredictedPictures) -> FloatArray:
    """Return the length [px] of edges each prediction shows clear of the arm gripper (n,)."""
    return np.array([float((p.edges & ~p.before).sum()) * p.step_px for p in predicted.pictures])
