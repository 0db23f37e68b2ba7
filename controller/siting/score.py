"""Score a site: the share of the parts shown, the clearance, and the seconds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from controller.arrays import FloatArray

from .site import CellSite

Stage = Literal["joints", "checked"]


@dataclass(frozen=True, slots=True)
class SiteOptions:
    """Fineness of the search, and the gain that counts as better.

    Attributes
    ----------
    as_good : sites whose values differ by less are equally good; of these, the one that needs the
        smallest moves is chosen
    keep_free_mm : ((x, x), (y, y)) of the backlit area; None for what the overhead camera sees
    move_camera, move_fixed_gripper : False if it is bolted down
    joints_only : a coarse result within a minute, without any check for collisions
    """

    arm_grasps: int = 14  # besides those that pick the part up from each stable pose
    fixed_grasps: int = 12  # each also turned over; with 5, some parts found no partner
    directions: int = 92
    checked_cameras: int = 12  # camera sites that get the collision checks
    checked_fixed_poses: int = 10
    local_steps: int = 2  # rounds of the search about the best
    # share of the surface; grasps and directions not tried may hide less
    worth_moving: float = 0.005
    worth_moving_s: float = 0.15  # share of the seconds that a part takes, which are estimates
    # Of the grasps, or of the gripper's poses over a tray; a smaller difference may be chance.
    worth_moving_hand_offs: float = 0.2
    as_good: float = 0.002
    keep_free_mm: tuple[tuple[float, float], tuple[float, float]] | None = None
    move_camera: bool = True
    move_fixed_gripper: bool = True
    joints_only: bool = False


@dataclass(frozen=True, slots=True)
class PartScore:
    """The figures of a site for one part; shares are of its surface unless another base is named.

    Attributes
    ----------
    name : name of the part
    showable : share that some grasp and some direction show, whatever the site
    shown : mean over the stable poses it may start in, weighted by their probabilities
    shown_worst : in the worst of these poses
    joints_allow : by kinematics alone at this site, as if every grasp were reachable
    views_share : reachable share of the (grasp, direction) pairs that show anything
    partners_share : share of the grasps that pick the part up and have partners for their hidden
        surface, from which one hand-off leads to such a partner
    hand_offs_share : share of all pairs of complementary grasps that one hand-off joins
    picks_share : share of the planar poses tried on the table from which some grasp picks it up
    view_s, regrasp_s : seconds of the views that show all, and of the regrasp between (estimates);
        NaN if there is no view, or no regrasp
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
    """A site with its figures over the family.

    Attributes
    ----------
    stage : "joints", by kinematics alone, or "checked", with collisions and hand-offs
    forbidden : reason why camera and fixed gripper may not stand there; None if they may
    value : figure by which sites are ranked, see `value_of`
    trays : per tray the share of the arm gripper's poses over it that touch nothing; a tray with 0
        cannot be served
    """

    site: CellSite
    parts: tuple[PartScore, ...]
    stage: Stage
    value: float
    forbidden: str | None = None
    trays: Mapping[str, float] = field(default_factory=dict)

    @property
    def shown_mean(self) -> float:
        """The mean share of the surface shown, over the parts."""
        return float(np.mean([p.shown for p in self.parts])) if self.parts else 0.0

    @property
    def shown_worst(self) -> float:
        """The share of the surface shown of the worst part in its worst pose."""
        return min((p.shown_worst for p in self.parts), default=0.0)

    @property
    def joints_allow(self) -> float:
        """The mean over the parts of what the joints alone allow here."""
        return float(np.mean([p.joints_allow for p in self.parts])) if self.parts else 0.0

    def mean(self, what: str) -> float:
        """Return the mean of a figure of `PartScore` over the parts that have it."""
        values = np.array([getattr(p, what) for p in self.parts], dtype=float)
        values = values[np.isfinite(values)]
        return float(values.mean()) if len(values) else float("nan")


# The weight of each figure's full range, compared with the share shown (1.0). The share shown comes
# first: a plan needs only a few views and one hand-off, so more of either is comfort. Of these
# figures the partners weigh most: a grasp from which no hand-off shows the rest costs every part
# held in it a longer sequence.
VIEWS_WEIGHT = 0.01
PARTNERS_WEIGHT = 0.04
HAND_OFFS_WEIGHT = 0.02
TRAYS_WEIGHT = 0.02  # a gripper that can come straight down places parts flat
SECOND_WEIGHT = 0.03 / 60.0
# A place on the table from which a part cannot be picked up is worse than a face not shown.
PICKS_WEIGHT = 1.0
TRAY_LOST = 1.0  # a tray that cannot be served at all


def value_of(parts: Sequence[PartScore], trays: Mapping[str, float] | None = None) -> float:
    """Return the value of a site; larger is better.

    Half of it is the family's mean, half its worst part, so that no part is sacrificed for others.
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
