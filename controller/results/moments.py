"""The moment of each step worth drawing: the part's place, its holder, and the arm's pose."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

from controller.arrays import BoolArray, FloatArray
from controller.planning import (
    CellLayout,
    GiveStep,
    Grasp,
    Look,
    Pick,
    Plan,
    Present,
    ReceiveStep,
    SetDown,
    Step,
    shown_pose,
)


class MomentKind(StrEnum):
    """The kind of a step."""

    PICK = "pick"
    PRESENT = "present"
    GIVE = "hand_over"
    RECEIVE = "take_back"
    SET_DOWN = "set_down"
    LOOK = "look"
    PLACE = "place"
    PARK = "park"


class Seat(StrEnum):
    """The point of view for a close-up of a step."""

    INSPECTION = "inspection camera"
    OVERHEAD = "overhead camera"
    BESIDE = "beside the part"  # no camera of the cell sees it there


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """A step as a gripper closes, the picture is taken, or the part is released.

    Attributes
    ----------
    q : (6,) joints of the arm
    arm_opening_mm, fixed_opening_mm : openings of both grippers
    T_world_part : (4, 4) pose of the part
    grasp, fixed_grasp : grasp and fixed grasp of the arm gripper and the fixed gripper, None if it
        does not hold
    in_sight : (n,) bool, samples that a view shows; None for a step without a view
    """

    step: Step
    kind: MomentKind
    seat: Seat
    q: FloatArray
    arm_opening_mm: float
    fixed_opening_mm: float
    T_world_part: FloatArray
    grasp: Grasp | None = None
    fixed_grasp: Grasp | None = None
    view_id: str | None = None
    in_sight: BoolArray | None = None


def moments(plan: Plan, layout: CellLayout) -> tuple[Moment, ...]:
    """Return a plan's moments in order; placing a good part and parking come last."""
    return tuple(_moments(plan, layout))


def _moments(plan: Plan, layout: CellLayout) -> Iterator[Moment]:
    q, wide, idle = layout.park_q, layout.arm_gripper.max_mm, layout.fixed_open_mm
    for step in plan.steps:
        if isinstance(step, Pick):
            q, grasp = step.motion_down[-1], step.grasp
            T = shown_pose(layout, q, grasp.T_part_tcp)
            yield Moment(
                step, MomentKind.PICK, Seat.OVERHEAD, q, grasp.opening_mm, idle, T, grasp=grasp
            )
            q = step.motion_up[-1]
        elif isinstance(step, Present):
            yield Moment(
                step,
                MomentKind.PRESENT,
                Seat.INSPECTION,
                step.q,
                step.grasp.opening_mm,
                idle,
                step.T_world_part,
                grasp=step.grasp,
                view_id=step.view_id,
                in_sight=step.seen,
            )
            q = step.q
        elif isinstance(step, GiveStep | ReceiveStep):
            is_giving = isinstance(step, GiveStep)
            q = step.motion[-1] if isinstance(step, GiveStep) else step.approach[-1]
            yield Moment(
                step,
                MomentKind.GIVE if is_giving else MomentKind.RECEIVE,
                Seat.BESIDE,
                q,
                step.grasp.opening_mm,
                step.fixed_grasp.opening_mm,
                shown_pose(layout, q, step.grasp.T_part_tcp),
                grasp=step.grasp,
                fixed_grasp=step.fixed_grasp,
            )
            q = step.retreat[-1] if isinstance(step, GiveStep) else step.motion_out[-1]
        elif isinstance(step, SetDown):
            yield Moment(
                step,
                MomentKind.SET_DOWN,
                Seat.OVERHEAD,
                step.motion_down[-1],
                step.grasp.opening_mm,
                idle,
                step.T_world_part,
                grasp=step.grasp,
            )
            q, wide = step.motion_up[-1], step.open_mm
        elif isinstance(step, Look):
            yield Moment(
                step,
                MomentKind.LOOK,
                Seat.OVERHEAD,
                q,
                wide,
                idle,
                step.T_world_part,
                view_id=step.view_id,
                in_sight=step.seen,
            )
        else:
            raise ValueError(f"no moment is known of a {type(step).__name__}")
    place, park = plan.good_part_steps
    yield Moment(
        place,
        MomentKind.PLACE,
        Seat.BESIDE,
        place.motion_down[-1],
        place.grasp.opening_mm,
        idle,
        place.T_world_part,
        grasp=place.grasp,
    )
    yield Moment(
        park,
        MomentKind.PARK,
        Seat.OVERHEAD,
        park.motion[-1],
        place.open_mm,
        idle,
        place.T_world_part,
    )


def view_count(plan: Plan) -> int:
    """Return the number of views of a plan, in the arm gripper or on the table."""
    return sum(isinstance(step, Present | Look) for step in plan.steps)
