"""For each stable pose the part may start in: a complete plan, or the reason why there is none.

Computed before the first part arrives, so that a part that cannot be picked from its side is known
before it happens at the cell (planning-facts.md 9).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.cad import StablePose

from ..grasps import resting_pose
from ..model import CellLayout, NoPlanError, OnTable, Plan, PreparedPart
from ..regrasps import is_pickable
from .planner import plan_from

PLACE_COUNT = 3  # per side of the area parts may lie in
TURN_COUNT = 4


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """Promise for a part that starts in one stable pose.

    Attributes
    ----------
    plan : plan from the middle of the drop area, None without one
    reason : reason why there is no plan, a sentence; "" where there is one
    pickable : share of places and turns over that area from which the part can be taken
    same_as : pose that a symmetry of the part makes this one, and whose plan this is; -1 for none
    """

    pose_index: int
    probability: float
    plan: Plan | None
    reason: str
    pickable: float
    same_as: int = -1

    @property
    def is_complete(self) -> bool:
        """True if all is shown that any grasp and view could show, as far as can be counted."""
        plan = self.plan
        if plan is None:
            return False
        return plan.covered_fraction >= plan.reachable_fraction - plan.covered_U - 1e-9


def certify(
    part: PreparedPart, layout: CellLayout, poses: Sequence[StablePose], rng_seed: int = 0
) -> tuple[Certificate, ...]:
    """Return a certificate for each stable pose.

    Parameters
    ----------
    part : prepared
    layout : the cell
    poses : all stable poses, those that roll among them: a part may start so
    rng_seed : seed of the random trees; the same one gives the same plans
    """
    return tuple(_certificate(part, layout, pose, rng_seed) for pose in poses)


def _certificate(
    part: PreparedPart, layout: CellLayout, pose: StablePose, rng_seed: int
) -> Certificate:
    x, y = layout.set_down_mm.mean(axis=1)
    plan, reason = None, ""
    try:
        start = OnTable(pose.index, resting_pose(part.solid, pose, float(x), float(y)))
        plan = plan_from(part, layout, start, rng_seed=rng_seed)
    except NoPlanError as error:
        reason = str(error)
    return Certificate(pose.index, pose.probability, plan, reason, _pickable(part, layout, pose))


def _pickable(part: PreparedPart, layout: CellLayout, pose: StablePose) -> float:
    """Return the share of places and turns from which the part can be taken."""
    x_mm, y_mm = (np.linspace(low, high, PLACE_COUNT) for low, high in layout.set_down_mm)
    taken = []
    for x in x_mm:
        for y in y_mm:
            for k in range(TURN_COUNT):
                turn = 2 * np.pi * k / TURN_COUNT
                T = resting_pose(part.solid, pose, float(x), float(y), turn)
                taken.append(is_pickable(part, layout, T))
    return float(np.mean(taken))
