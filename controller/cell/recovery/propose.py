"""The next start's options for a part that a run left: steps, first motion, proof."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import rotation_angle
from controller.planning.model import CellLayout
from controller.planning.motion import ProvenMove, Swept, segment_seconds, tcp_pose
from messages import joined, key, say

from ..custody import Custody
from ..journal import Once
from .beside import back_evidence, why_not_back
from .classify import Case, Opens, WayOut, classify
from .homing import (
    FIRST_MOTION,
    HOMING_STEPS,
    HomingWithPart,
    homing_evidence,
    lost_bounds,
    what_to_look_at,
    why_not_free,
)
from .interrupted import Interrupted
from .trail import Leaving
from .world import World

FIXED_PRESSES: Final = key("the fixed gripper presses once more: it closes, and opens nothing")
FIXED_ACTIVATES: Final = key(
    "once the arm stands free, the fixed gripper is activated: its jaws close, and open; they are "
    "empty by contact and light barrier"
)
FIXED_LOOK: Final = key("Look before you accept: nothing is between the fixed gripper's jaws.")
FIRST_SPEED: Final = 0.25  # share of the usual speed: the first motion after a crash
THEN: Final = {
    Custody.IN_ARM: (
        key(
            "plan onwards from the arm gripper; surface already in sight still counts, and the "
            "first view verifies the grasp"
        )
    ),
    Custody.IN_FIXED: key(
        "plan onwards from the fixed gripper; surface already in sight still counts"
    ),
    Custody.ON_TABLE: key("take the arm out of the picture, recognise the part again, grasp it"),
    Custody.LOST: key("take the arm out of the picture, and look for the part on the table"),
    Custody.PLACED: key("take the arm home: the part is in its tray"),
}


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """The steps that the cell would take; nothing moves before they are accepted.

    Attributes
    ----------
    left : state according to the journal
    case : case found
    q : (6,) present joints of the arm; empty if unknown
    leaving : path by which the arm leaves; None if the case calls for a person
    custody : custody of the part once the arm has left
    steps : in words, in order
    first_motion : the first motion of the arm, in words
    is_proven : the cell may go on by itself
    person : reason why a person has to look instead; empty if the cell can go on
    homing : the arm homes first, with what its gripper holds; None if it knows where it is
    look : points that a person has to check before accepting; empty for none
    """

    left: Interrupted
    case: Case
    q: FloatArray
    leaving: Leaving | None
    custody: Custody
    steps: tuple[str, ...]
    first_motion: str
    is_proven: bool
    person: str
    homing: HomingWithPart | None = None
    look: str = ""

    @property
    def evidence(self) -> tuple[str, ...]:
        """The evidence of journal and devices, sentence by sentence."""
        return self.case.evidence

    @property
    def preview(self) -> str:
        """The first motion of anything, in words."""
        if self.case.is_fixed_unconfirmed:
            return FIXED_PRESSES
        return self.first_motion or key("the arm gripper presses once more")

    @property
    def is_arm_alone(self) -> bool:
        """Whether only the arm goes on: the part on the table may have been exchanged."""
        done_with = (Custody.ON_TABLE, Custody.PLACED)
        return self.left.custody in done_with and self.left.intent is None

    @property
    def intents(self) -> tuple[str, ...]:
        """The unresolved intent, and whether it was done."""
        if self.left.intent is None or self.case.done is None:
            return ()
        return (
            say(
                "{name}: {done}", name=self.left.intent.name.replace("_", " "), done=self.case.done
            ),
        )


def propose(
    left: Interrupted,
    world: World,
    layout: CellLayout,
    swept: Swept | None = None,
    back: ProvenMove | None = None,
) -> Proposal:
    """Return the proposal for a part that a run left.

    Parameters
    ----------
    left : state according to the journal
    world : state according to the devices
    layout : layout for the preview of the first motion
    swept : the space that homing would sweep, where that was looked at
    back : the move back to its path of an arm that `beside_path` finds, where that was looked at
    """
    case = classify(left, world)
    if case.homes:
        return _home(left, world, case, layout, swept)
    person = case.person or _why_not(left, case)
    way = None if world.q is None else _way(left, case, world.q, back)
    if not person and (way is None or (len(way.waypoints) == 0 and not way.is_free_at_end)):
        person = why_not_back(back)
    if person:
        nowhere = np.zeros(0)
        return Proposal(
            left, case, nowhere, None, case.custody, (), "", is_proven=False, person=person
        )
    assert way is not None
    assert world.q is not None
    if back is not None:
        case = replace(case, evidence=(*case.evidence, back_evidence(back)))
    custody = _custody_after(case)
    first = _preview(world.q, way, layout)
    return Proposal(
        left,
        case,
        world.q,
        way,
        custody,
        tuple(_steps(case, custody, first, way)),
        first,
        is_proven=way.is_free_at_end and not case.activates_fixed,
        person="",
        look=FIXED_LOOK if case.activates_fixed else "",
    )


def _home(
    left: Interrupted, world: World, case: Case, layout: CellLayout, swept: Swept | None
) -> Proposal:
    """Return the proposal to home the arm as loaded, or the reason against it."""
    nowhere, person = np.zeros(0), why_not_free(swept)
    if person:
        person = say("{positions}; {person}", positions=world.positions, person=person)
        return Proposal(
            left, case, nowhere, None, case.custody, (), "", is_proven=False, person=person
        )
    assert swept is not None
    homing = HomingWithPart(lost_bounds(left, world, layout), swept)
    more = homing_evidence(homing, layout)
    return Proposal(
        left,
        replace(case, evidence=(*case.evidence, *more)),
        homing.bounds.q_estimate,
        None,
        case.custody,
        (*_confirming(case), *HOMING_STEPS, *_activating(case), THEN[case.custody]),
        FIRST_MOTION,
        is_proven=False,
        person="",
        homing=homing,
        look=joined(
            " ", (what_to_look_at(homing, layout), *((FIXED_LOOK,) if case.activates_fixed else ()))
        ),
    )


def arm_open_mm(left: Interrupted) -> float:
    """Return the opening [mm] at which the arm gripper leaves the part in place."""
    last = left.last_intent if left.trail.retreat else left.intent
    if last is not None and last.name in (Once.RELEASE_ARM, Once.SET_DOWN, Once.SORT):
        return float(last.open_mm or 0.0)
    hold = left.expected_hold or left.arm_hold
    assert hold is not None, "a rule opens the arm gripper only where it was to hold the part"
    return hold.grasp.pre_open_mm


def _way(left: Interrupted, case: Case, q: FloatArray, back: ProvenMove | None) -> Leaving | None:
    if case.leaves is WayOut.BY_RETREAT:
        return left.trail.retreat_from(q)
    return left.trail.leaving(q, () if back is None else back.waypoints)


def _custody_after(case: Case) -> Custody:
    """Return the part's custody once one of two grippers has opened."""
    if case.custody is Custody.IN_BOTH:
        return Custody.IN_ARM if case.opens is Opens.FIXED else Custody.IN_FIXED
    return case.custody


def _why_not(left: Interrupted, case: Case) -> str:
    """Return what the cell lacks to go on, as a sentence; empty if it lacks nothing."""
    custody = _custody_after(case)
    hold = left.expected_hold if case.holds_as_expected else left.arm_hold
    if custody is Custody.IN_ARM and hold is None:
        return key("the journal does not record the grasp of the arm gripper")
    if custody is Custody.IN_FIXED and left.fixed_hold is None:
        return key("the journal does not record the grasp of the fixed gripper")
    return ""


def _steps(case: Case, custody: Custody, first: str, way: Leaving) -> list[str]:
    steps = _confirming(case)
    if case.custody in (Custody.IN_ARM, Custody.IN_BOTH) and case.opens is not Opens.ARM:
        steps.append(key("the arm gripper presses once more: it closes, and opens nothing"))
    if case.opens is not Opens.NONE:
        steps.append(case.opens.value)
    if first:
        where = key("back along the path it came by") if way.is_back else key("on along its path")
        if case.leaves is WayOut.BY_RETREAT:
            where = key("away by the retreat that was planned")
        steps.append(
            say(
                "the arm goes {where}, {waypoints_count} waypoints: {first}",
                where=where,
                waypoints_count=len(way.waypoints),
                first=first,
            )
        )
    return [*steps, *_activating(case), THEN[custody]]


def _confirming(case: Case) -> list[str]:
    """Return the step by which the fixed gripper confirms its hold, if it has to."""
    return [FIXED_PRESSES] if case.is_fixed_unconfirmed else []


def _activating(case: Case) -> list[str]:
    """Return the step by which the fixed gripper is made ready again, if it has to be."""
    return [FIXED_ACTIVATES] if case.activates_fixed else []


def _preview(q: FloatArray, way: Leaving, layout: CellLayout) -> str:
    """Return the first motion of the arm in words; empty if it is in place."""
    if not way.waypoints:
        return ""
    target = way.waypoints[0]
    seconds = float(segment_seconds(layout, q, target)) / FIRST_SPEED
    T_now, T_then = tcp_pose(layout, q), tcp_pose(layout, target)
    shift_mm = T_then[:3, 3] - T_now[:3, 3]
    turn_deg = float(np.degrees(rotation_angle(T_now[:3, :3].T @ T_then[:3, :3])))
    return say(
        "first the TCP from {begin} to {end} mm, {distance_mm:.0f} mm and "
        "{turn_deg:.0f} degrees, about {seconds:.0f} s at "
        "{first_speed:.0%} of the usual speed",
        begin=_point(T_now),
        end=_point(T_then),
        distance_mm=float(np.linalg.norm(shift_mm)),
        turn_deg=turn_deg,
        seconds=seconds,
        first_speed=FIRST_SPEED,
    )


def _point(T: FloatArray) -> str:
    return "(" + ", ".join(f"{x:.0f}" for x in T[:3, 3]) + ")"


def listed(sentences: Sequence[str]) -> str:
    """Return sentences as the lines of a list."""
    return joined("\n", (say("  - {one}", one=one) for one in sentences))
