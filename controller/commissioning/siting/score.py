"""What a site is worth: how much of the parts it shows, how freely, and in how many seconds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from controller.arrays import FloatArray

from .site import Site

Stage = Literal["joints", "checked"]


@dataclass(frozen=True, slots=True)
class SiteOptions:
    """How finely to search, and what counts as better.

    Attributes
    ----------
    as_good : sites whose values differ by less are equals; of these the one that needs the
        smallest moves is the answer
    keep_free_mm : ((x, x), (y, y)) of the glowing area; what the overhead camera sees if None
    move_camera, move_fixed_gripper : False where it is bolted down
    joints_only : a coarse answer within a minute: nothing is checked for collisions
    """

    arm_grasps: int = 14  # beside those that take each resting pose up
    fixed_grasps: int = 12  # each counts twice, turned over; with 5, some parts found no partner
    directions: int = 92
    checked_cameras: int = 12  # camera sites that get the collision checks
    checked_fixed_poses: int = 10
    local_steps: int = 2  # rounds of the search about the best
    worth_moving: float = 0.005  # of the surface: less is lost in grasps and directions not tried
    worth_moving_s: float = 0.15  # of the seconds a part takes; these are estimates
    worth_moving_hand_offs: float = 0.2  # of the grasps, or of the ways over a tray: a few are luck
    as_good: float = 0.002
    keep_free_mm: tuple[tuple[float, float], tuple[float, float]] | None = None
    move_camera: bool = True
    move_fixed_gripper: bool = True
    joints_only: bool = False


@dataclass(frozen=True, slots=True)
class PartScore:
    """What a site does for one part; shares of its surface unless they say of what.

    Attributes
    ----------
    shown : over the stable poses it may start in, by their probabilities; shown_worst : of the
        worst pose
    joints_allow : by kinematics alone at this site, every grasp being reachable
    views_share : of the (grasp, direction) pairs that show anything, what is reachable
    partners_share : of the grasps that take it up and have others showing what they hide, those
        from which one hand-off leads to such another
    hand_offs_share : of all pairs of grasps that complete each other, what one hand-off joins
    picks_share : of the places and turns tried on the table, where some grasp takes the part up
    view_s, regrasp_s : seconds of the views that show all, and of the regrasp between (estimates);
        NaN where there is no view, or no way to regrasp
    """

    name: str
    showable: float
    joints_allow: float
    shown: float
    shown_worst: float
    views_share: float
    partners_share: float
    hand_offs_share: float
    picks_share: float
    view_s: float
    regrasp_s: float


@dataclass(frozen=True, slots=True, eq=False)
class SiteScore:
    """A site and what it is worth over the family.

    Attributes
    ----------
    stage : "joints", by kinematics alone, or "checked", with collisions and hand-offs
    forbidden : why nothing may stand there; None otherwise
    value : what sites are ranked by, see `value_of`
    trays : per tray the share of the arm gripper's ways to be over it that touch nothing; 0 is
        unserved
    """

    site: Site
    parts: tuple[PartScore, ...]
    stage: Stage
    value: float
    forbidden: str | None = None
    trays: Mapping[str, float] = field(default_factory=dict)

    @property
    def shown_mean(self) -> float:
        """Return the mean share of the surface shown, over the parts."""
        return float(np.mean([p.shown for p in self.parts])) if self.parts else 0.0

    @property
    def shown_worst(self) -> float:
        """Return the share of the surface shown of the worst part in its worst pose."""
        return min((p.shown_worst for p in self.parts), default=0.0)

    @property
    def joints_allow(self) -> float:
        """Return the mean over the parts of what the joints alone allow here."""
        return float(np.mean([p.joints_allow for p in self.parts])) if self.parts else 0.0

    def mean(self, what: str) -> float:
        """Return the mean of a figure of `PartScore` over the parts that have it."""
        values = np.array([getattr(p, what) for p in self.parts], dtype=float)
        values = values[np.isfinite(values)]
        return float(values.mean()) if len(values) else float("nan")


# What a full range of each figure is worth beside the share shown (1.0). Seeing comes first: a plan
# needs a few views and one hand-off only, so more of either is comfort. A grasp from which no
# hand-off shows the rest costs every part held so a longer way round, and is worth most of these.
VIEWS_WEIGHT = 0.01
PARTNERS_WEIGHT = 0.04
HAND_OFFS_WEIGHT = 0.02
TRAYS_WEIGHT = 0.02  # a gripper that comes down straight sets parts down flat
SECOND_WEIGHT = 0.03 / 60.0
# a part that cannot be picked up somewhere on the table is worse than a face not shown
PICKS_WEIGHT = 1.0
TRAY_LOST = 1.0  # a tray that cannot be served at all


def value_of(parts: Sequence[PartScore], trays: Mapping[str, float] | None = None) -> float:
    """Return what a site is worth: larger is better.

    Half of it is the family's mean, half its worst part, so that no part is given up for others.
    """
    if not parts:
        return float("-inf")

    def mean(values: Sequence[float]) -> float:
        finite: FloatArray = np.array([v for v in values if np.isfinite(v)], dtype=float)
        return float(finite.mean()) if len(finite) else 0.0

    shown = 0.5 * mean([p.shown for p in parts]) + 0.5 * min(p.shown_worst for p in parts)
    freedom = VIEWS_WEIGHT * mean([p.views_share for p in parts])
    freedom += PARTNERS_WEIGHT * mean([p.partners_share for p in parts])
    freedom += HAND_OFFS_WEIGHT * mean([p.hand_offs_share for p in parts])
    seconds = mean([p.view_s for p in parts]) + mean([p.regrasp_s for p in parts])
    picks = mean([p.picks_share for p in parts])
    if trays:
        free = list(trays.values())
        freedom += TRAYS_WEIGHT * mean(free) - TRAY_LOST * sum(f == 0.0 for f in free)
    return shown + freedom - SECOND_WEIGHT * seconds - PICKS_WEIGHT * (1 - picks)
