"""A second opinion on plans: who holds the part, with what grasp, and what touches what.

Follows the part from hand to hand with `planning_contacts`, which shares no geometry with
`controller.planning`; of the planner only its dataclasses are read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from planning_contacts import UMI, ArmReading, Checker, apart
from scipy.spatial import ConvexHull, QhullError

from controller.cad import Solid
from controller.planning import (
    CellLayout,
    GiveStep,
    Grasp,
    InArm,
    InFixedGripper,
    Look,
    OnTable,
    Park,
    Pick,
    Place,
    Plan,
    Present,
    ReceiveStep,
    SetDown,
    Start,
    Step,
)

Array = NDArray[np.float64]

POSE_MM, POSE_RAD = 0.5, 0.005  # one part in two hands: they agree on where it is


@dataclass
class Moment:
    """One picture of the plan: what the camera looks at, and what may be in its way."""

    step: Step
    q: Array
    arm_opening_mm: float
    fixed_opening_mm: float
    T_world_part: Array
    holder: str


@dataclass
class Walk:
    """What came of following a plan."""

    trouble: list[str] = field(default_factory=list)
    moments: list[Moment] = field(default_factory=list)
    states: int = 0


class Follower:
    """Follows the part through a plan; every finding is a sentence."""

    def __init__(
        self, layout: CellLayout, solid: Solid, start: Start | Array, arm: ArmReading = UMI
    ) -> None:
        self.layout, self.c = layout, Checker(layout, solid, arm)
        self.walk = Walk()
        self.q = layout.park_q if getattr(start, "q", None) is None else start.q
        self.opening = layout.arm_gripper.max_mm
        self.wide = 0.0 if layout.fixed_gripper is None else layout.fixed_gripper.max_mm
        self.fixture_opening = self.wide
        self.grasp: Grasp | None = None
        self.fixed_grasp: Grasp | None = None
        self.T: Array = np.eye(4)
        if isinstance(start, InArm):
            self.grasp = start.grasp
            self.opening = self.gap(start.grasp, start.grasp.opening_mm)
            self._place_part()
        elif isinstance(start, InFixedGripper):
            self.fixed_grasp = start.grasp
            self.fixture_opening = self.gap(start.grasp, start.grasp.opening_mm)
            self.opening = min(self.layout.arm_gripper.max_mm, self.opening)
            self.T = layout.T_world_fixed_tcp @ np.linalg.inv(start.grasp.T_part_tcp)
        else:
            self.T = start.T_world_part if isinstance(start, OnTable) else start

    def gap(self, grasp: Grasp, opening_mm: float) -> float:
        """Return how far apart the fingers' inner sides are: spread, their backs are the pads."""
        jaw = self.layout.arm_gripper if grasp.holder == "arm" else self.layout.fixed_gripper
        assert jaw is not None
        return opening_mm - (2 * jaw.finger_thickness_mm if grasp.is_inner else 0.0)

    @property
    def holder(self) -> str:
        arm, fixture = self.grasp is not None, self.fixed_grasp is not None
        return {(1, 0): "arm", (0, 1): "fixture", (1, 1): "both"}.get((arm, fixture), "table")

    def say(self, step: Step, text: str) -> None:
        self.walk.trouble.append(f"{step.label}: {text}")

    def needs(self, step: Step, holder: str) -> None:
        if self.holder != holder:
            self.say(step, f"needs the part with the {holder}, the {self.holder} has it")

    def same_grip(self, step: Step, grasp: Grasp) -> None:
        if self.grasp is None or np.abs(self.grasp.T_part_tcp - grasp.T_part_tcp).max() > 1e-9:
            self.say(step, f"speaks of grip {grasp.id}, the hand holds it otherwise")

    def _place_part(self) -> None:
        assert self.grasp is not None
        tip = self.c.arm.frames(self.layout, np.asarray(self.q))["tip"]
        self.T = tip @ np.linalg.inv(self.grasp.T_part_tcp)

    def drive(self, step: Step, *motions: Sequence[Array]) -> None:
        """Move as things stand: the part with the hand if it holds it."""
        path = [self.q, *(q for m in motions for q in m)]
        held_by = {"arm": ("arm",), "fixture": ("fixture",), "both": ("arm", "fixture")}
        self.walk.trouble += self.c.drive(
            path,
            self.opening,
            self.fixture_opening,
            self.grasp,
            self.T,
            held_by.get(self.holder, ()),
            step.label,
        )
        self.q = path[-1]
        if self.grasp is not None:
            self._place_part()

    def set_jaws(self, step: Step, hand_mm: float | None = None, fixture_mm: float = -1.0) -> None:
        """Open or close a jaw, looking at what its fingers pass."""
        hand = self.opening if hand_mm is None else hand_mm
        fixture = self.fixture_opening if fixture_mm < 0 else fixture_mm
        held_by = {"arm": ("arm",), "fixture": ("fixture",)}.get(self.holder, ("arm", "fixture"))
        for share in np.linspace(0, 1, 5):
            found = self.c.contacts(
                np.asarray(self.q)[None],
                float(self.opening + share * (hand - self.opening)),
                float(self.fixture_opening + share * (fixture - self.fixture_opening)),
                self.T,
                # whoever moves its fingers here is about to hold the part or has just held it
                ("arm", "fixture") if self.holder in {"both", "table"} else held_by,
            )
            self.walk.trouble += [f"{step.label}, jaws moving: {c}" for c in found]
        self.opening, self.fixture_opening = hand, fixture

    def takes(self, step: Step, grasp: Grasp) -> None:
        """Close the hand; the part stands where it stands."""
        tip = self.c.arm.frames(self.layout, np.asarray(self.q))["tip"]
        mm, rad = apart(tip @ np.linalg.inv(grasp.T_part_tcp), self.T)
        if mm > POSE_MM or rad > POSE_RAD:
            self.say(step, f"the hand is {mm:.2f} mm, {np.degrees(rad):.2f} deg off its grip")
        self.walk.trouble += self.c.hold(grasp, self.layout.arm_gripper, step.label)
        self.grasp = grasp
        self.set_jaws(step, hand_mm=self.gap(grasp, grasp.opening_mm))

    # ---- steps ----------------------------------------------------------------------------------
    def follow(self, step: Step) -> None:
        getattr(self, f"_{type(step).__name__.lower()}")(step)
        self.walk.states = self.c.states

    def _pick(self, step: Pick) -> None:
        self.needs(step, "table")
        self.opening = self.gap(step.grasp, step.pre_open_mm)
        self.drive(step, step.motion_in, step.motion_down)
        self.takes(step, step.grasp)
        self.drive(step, step.motion_up)

    def _present(self, step: Present) -> None:
        self.needs(step, "arm")
        self.same_grip(step, step.grasp)
        self.drive(step, step.motion)
        if np.abs(np.asarray(self.q) - step.q).max() > 1e-9:
            self.say(step, "stands elsewhere than it says")
        mm, rad = apart(self.T, step.T_world_part)
        if mm > 0.05 or rad > 1e-3:
            self.say(step, f"the part is {mm:.2f} mm from where the view says it is")
        self._moment(step)

    def _look(self, step: Look) -> None:
        self.needs(step, "table")
        if apart(self.T, step.T_world_part)[0] > 0.05:
            self.say(step, "the part lies elsewhere than the view says")
        self._moment(step)

    def _moment(self, step: Step) -> None:
        self.walk.moments.append(
            Moment(
                step, np.asarray(self.q), self.opening, self.fixture_opening, self.T, self.holder
            )
        )

    def _givestep(self, step: GiveStep) -> None:
        self.needs(step, "arm")
        self.same_grip(step, step.grasp)
        if self.layout.fixed_gripper is None:
            self.say(step, "there is no fixed gripper")
            return
        self.fixture_opening = self.gap(step.fixed_grasp, step.fixed_pre_open_mm)
        self.drive(step, step.motion)
        held = self.layout.T_world_fixed_tcp @ np.linalg.inv(step.fixed_grasp.T_part_tcp)
        mm, rad = apart(held, self.T)
        if mm > POSE_MM or rad > POSE_RAD:
            self.say(step, f"both jaws disagree by {mm:.2f} mm, {np.degrees(rad):.2f} deg")
        self.walk.trouble += self.c.hold(step.fixed_grasp, self.layout.fixed_gripper, step.label)
        self.fixed_grasp = step.fixed_grasp
        self.set_jaws(step, fixture_mm=self.gap(step.fixed_grasp, step.fixed_expected_opening_mm))
        self.set_jaws(step, hand_mm=self.gap(step.grasp, step.arm_open_mm))
        self.grasp = None
        self.drive(step, step.retreat)

    def _receivestep(self, step: ReceiveStep) -> None:
        self.needs(step, "fixture")
        # the jaws are still as they let go; they open where the straight way begins
        self.drive(step, step.motion_in)
        self.set_jaws(step, hand_mm=self.gap(step.grasp, step.pre_open_mm))
        self.drive(step, step.approach)
        self.takes(step, step.grasp)
        self.set_jaws(step, fixture_mm=self.gap(step.fixed_grasp, step.fixed_open_mm))
        self.fixed_grasp = None
        self.drive(step, step.motion_out)
        self.set_jaws(step, fixture_mm=self.wide)

    def _setdown(self, step: SetDown) -> None:
        self.needs(step, "arm")
        self._let_go(step)
        area = self.layout.set_down_mm
        x, y = (self.T[:3, :3] @ self.c.centroid + self.T[:3, 3])[:2]
        if not (area[0, 0] <= x <= area[0, 1] and area[1, 0] <= y <= area[1, 1]):
            self.say(step, f"({x:.0f}, {y:.0f}) is outside where parts may be set down")
        if not self._rests():
            self.say(step, "the part does not stand by itself there")

    def _place(self, step: Place) -> None:
        self.needs(step, "arm")
        self._let_go(step)
        tray = self.layout.trays[step.tray]
        at = (self.T[:3, :3] @ self.c.centroid + self.T[:3, 3])[:2]
        if (np.abs(at - tray.centre_mm) > np.array(tray.size_mm) / 2).any():
            self.say(step, f"let go at ({at[0]:.0f}, {at[1]:.0f}), which is not over the tray")
        if step.tilt_rad == 0 and not self._rests():
            self.say(step, "said to lie flat, does not rest like that")

    def _let_go(self, step: SetDown | Place) -> None:
        self.same_grip(step, step.grasp)
        self.drive(step, step.motion, step.motion_down)
        mm, rad = apart(self.T, step.T_world_part)
        if mm > POSE_MM or rad > POSE_RAD:
            self.say(step, f"lets go {mm:.2f} mm, {np.degrees(rad):.2f} deg off what it says")
        height = float((self.c.corners @ self.T[2, :3] + self.T[2, 3]).min())
        if height > 8.0:
            self.say(step, f"drops the part {height:.0f} mm")
        self.set_jaws(step, hand_mm=self.gap(step.grasp, step.open_mm))
        self.grasp = None
        self.drive(step, step.motion_up)

    def _rests(self) -> bool:
        """Tell whether the centre of mass is over what touches the ground."""
        points = self.c.corners @ self.T[:3, :3].T + self.T[:3, 3]
        feet = points[points[:, 2] < points[:, 2].min() + 0.5][:, :2]
        at = (self.T[:3, :3] @ self.c.centroid + self.T[:3, 3])[:2]
        if len(feet) < 3:
            return False
        try:
            edges = ConvexHull(feet).equations
        except QhullError:
            return False  # a line of points
        return bool((edges[:, :2] @ at + edges[:, 2] <= 0).all())

    def _park(self, step: Park) -> None:
        self.drive(step, step.motion)


def follow(
    plan: Plan, layout: CellLayout, solid: Solid, start: Start | Array, arm: ArmReading = UMI
) -> Walk:
    """Follow a plan from `start`: a pose (4, 4) on the table, OnTable, InArm or InFixedGripper."""
    f = Follower(layout, solid, start, arm)
    for step in plan.steps:
        f.follow(step)
    q, opening, grasp, T = f.q, f.opening, f.grasp, f.T
    for name, place in plan.place.items():
        f.q, f.opening, f.grasp, f.T = q, opening, grasp, T
        f.follow(place)
        f.follow(plan.park[name])
        if np.abs(np.asarray(f.q) - layout.park_q).max() > 1e-6:
            f.say(plan.park[name], "does not end where the arm parks")
    f.walk.trouble = sorted(set(f.walk.trouble))
    return f.walk


def check(plan: Plan, layout: CellLayout, solid: Solid, T_world_part: Start | Array) -> list[str]:
    """Return every finding along a whole plan, each named once."""
    return follow(plan, layout, solid, T_world_part).trouble
