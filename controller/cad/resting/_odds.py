"""How likely each way to lie is, as drops are seen: a prior from geometry, updated by counts.

A Dirichlet prior worth about twenty drops (planning-facts.md 4): drop height and table change the
odds, so geometry is believed until the overhead camera has seen some tens of parts lie.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from ._poses import StablePose

Array = NDArray[np.float64]

PSEUDO_DROPS = 20.0
LEAST_WEIGHT = 0.01  # of a pseudo-drop: what geometry calls impossible may still be seen


@dataclass(frozen=True, eq=False, slots=True)
class PoseOdds:
    """Odds of a part's ways to lie: a Dirichlet distribution over them.

    Attributes
    ----------
    prior : (k,) pseudo-drops per pose, in the order of the poses
    counts : (k,) parts seen in each pose; a sighting that fits two poses may count half in each
    """

    prior: Array
    counts: Array

    def updated(self, counts: Sequence[float] | Array) -> "PoseOdds":
        """Return the odds after further sightings (k,).

        Raises
        ------
        ValueError : not one finite, non-negative number per pose
        """
        seen = np.asarray(counts, dtype=np.float64)
        if seen.shape != self.prior.shape or not (np.isfinite(seen) & (seen >= 0)).all():
            raise ValueError(f"{len(self.prior)} poses want as many counts of 0 or more: {counts}")
        return PoseOdds(self.prior, self.counts + seen)

    @property
    def mean(self) -> Array:
        """Expected odds of the poses (k,), which sum to 1."""
        weights = self.prior + self.counts
        return np.asarray(weights / weights.sum())

    def interval(self, credibility: float = 0.95) -> Array:
        """Return the bounds (k, 2) each pose's odds lie between, with equal tails outside."""
        weights = self.prior + self.counts
        rest = weights.sum() - weights
        tail = (1 - credibility) / 2
        if len(weights) == 1:
            return np.ones((1, 2))
        return np.column_stack([betaincinv(weights, rest, q) for q in (tail, 1 - tail)])


def pose_odds(poses: Sequence[StablePose], pseudo_drops: float = PSEUDO_DROPS) -> PoseOdds:
    """Return the odds of dropped parts before any was seen, worth ``pseudo_drops`` sightings.

    Raises
    ------
    ValueError : there is no pose, or ``pseudo_drops`` is not positive
    """
    if not poses or not pseudo_drops > 0:
        raise ValueError(f"odds want a pose and a prior: {len(poses)} poses, {pseudo_drops} drops")
    drop = np.array([p.drop_probability for p in poses])
    share = drop / drop.sum() if drop.sum() > 0 else np.full(len(drop), 1 / len(drop))
    return PoseOdds(np.maximum(pseudo_drops * share, LEAST_WEIGHT), np.zeros(len(share)))
