"""The section `faults` of recipe and cell files: the cell's acts on a fault, and how often.

The cell file has the policy of the cell, a recipe replaces single classes of it. A class has a list
of actions: each is taken a set number of times, then the next one; the last one ends the list.
"""

from collections.abc import Mapping
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field, model_validator

from .yaml_models import Section, WrongKeyError

FaultAct = Literal[
    "retry", "re_pose", "regrasp", "other_view", "skip_characteristic", "park_part", "hold", "abort"
]
# Actions that end the sequence: nothing follows them.
ENDS: Final = ("skip_characteristic", "park_part", "hold", "abort")
LONGEST_LIST: Final = 8

# Possible reactions of the cell to each class, the ends aside: another look makes no sense for a
# camera that is gone, and a dropped part cannot be parked.
_HELD_ENDS: Final = ("park_part", "hold", "abort")
_FREE_ENDS: Final = ("hold", "abort")
POSSIBLE: Final[Mapping[str, tuple[str, ...]]] = {
    "grasp_missed": ("re_pose", "regrasp", *_FREE_ENDS),
    "grasp_wrong": ("re_pose", "regrasp", *_FREE_ENDS),
    "dropped": ("re_pose", *_FREE_ENDS),
    "not_seen": ("retry", *_FREE_ENDS),
    "hold_not_seen": ("re_pose", *_FREE_ENDS),
    "held_otherwise": ("re_pose", *_HELD_ENDS),
    "hand_off_failed": ("retry", "regrasp", *_HELD_ENDS),
    "receive_failed": ("regrasp", *_HELD_ENDS),
    "seen_too_little": ("other_view", "skip_characteristic", *_HELD_ENDS),
    "ambiguous": _HELD_ENDS,
    "camera": ("retry", *_FREE_ENDS),
    "lights": ("retry", *_FREE_ENDS),
    "gripper": ("retry", *_FREE_ENDS),
}


class FaultStep(Section):
    """One action of a list.

    Attributes
    ----------
    do : the action
    times : number of times for one part before the next action of the list; no limit for an action
        that ends the list
    delay_s : wait so long before it [cell s]
    """

    do: FaultAct
    times: int = Field(1, ge=1, le=20)
    delay_s: float = Field(0.0, ge=0, le=60)


def _in_order(steps: tuple[FaultStep, ...]) -> tuple[FaultStep, ...]:
    """Return the list; raise ValueError unless its last action, and no other, ends it."""
    if not steps or steps[-1].do not in ENDS:
        raise ValueError(f"the last action must end the list: {', '.join(ENDS)}")
    for step in steps[:-1]:
        if step.do in ENDS:
            raise ValueError(f"`{step.do}` ends the list; nothing can follow it")
    if steps[-1].times != 1:
        raise ValueError(f"`{steps[-1].do}` ends the list; it has no `times`")
    return steps


FaultSteps = Annotated[
    tuple[FaultStep, ...], Field(max_length=LONGEST_LIST), AfterValidator(_in_order)
]


def _rule(*acts: tuple[FaultAct, int, float]) -> FaultSteps:
    return tuple(FaultStep(do=do, times=times, delay_s=delay_s) for do, times, delay_s in acts)


class FaultsSection(Section):
    """The cell's acts on each class of fault, and their limit in all.

    Attributes
    ----------
    grasp_missed, grasp_wrong : the jaws closed on nothing, or on something else, over the table
    dropped : a gripper has lost the part
    not_seen : it was lost, and the table shows no part
    hold_not_seen : a view does not show the part in the arm gripper
    held_otherwise : it sits otherwise in the arm gripper than planned, or has slipped
    hand_off_failed, receive_failed : the receiver did not get it; the giver still has it
    seen_too_little : views showed less than the plan promised, or too little of a face to judge it
    ambiguous : it may still be another part, or is one, by the view that was to decide
    camera, lights, gripper : a picture, a lamp or the fixed gripper's reading does not come
    times_in_all : recoveries of one part, measurements (held_otherwise, seen_too_little) and
        devices aside
    demote_after : a grasp or view that failed so often in the last `window` uses is avoided
    window : uses that are remembered of each grasp and view
    """

    grasp_missed: FaultSteps = _rule(("re_pose", 2, 0), ("hold", 1, 0))
    grasp_wrong: FaultSteps = _rule(("re_pose", 2, 0), ("hold", 1, 0))
    dropped: FaultSteps = _rule(("re_pose", 2, 0), ("hold", 1, 0))
    not_seen: FaultSteps = _rule(("retry", 2, 2), ("hold", 1, 0))
    hold_not_seen: FaultSteps = _rule(("re_pose", 2, 0), ("hold", 1, 0))
    held_otherwise: FaultSteps = _rule(("re_pose", 4, 0), ("park_part", 1, 0))
    hand_off_failed: FaultSteps = _rule(("retry", 1, 0), ("regrasp", 1, 0), ("park_part", 1, 0))
    receive_failed: FaultSteps = _rule(("regrasp", 2, 0), ("park_part", 1, 0))
    seen_too_little: FaultSteps = _rule(("other_view", 1, 0), ("skip_characteristic", 1, 0))
    ambiguous: FaultSteps = _rule(("park_part", 1, 0))
    camera: FaultSteps = _rule(("retry", 3, 1), ("abort", 1, 0))
    lights: FaultSteps = _rule(("retry", 3, 1), ("abort", 1, 0))
    gripper: FaultSteps = _rule(("retry", 3, 1), ("abort", 1, 0))
    times_in_all: int = Field(6, ge=0, le=100)
    demote_after: int = Field(3, ge=1, le=100)
    window: int = Field(20, ge=1, le=1000)

    @model_validator(mode="after")
    def _actions_are_possible(self) -> "FaultsSection":
        for name, possible in POSSIBLE.items():
            for number, step in enumerate(getattr(self, name)):
                if step.do not in possible:
                    raise WrongKeyError(
                        (name, number, "do"),
                        f"`{step.do}` is no action for {name}; possible: {', '.join(possible)}",
                    )
        if self.demote_after > self.window:
            raise WrongKeyError(
                ("demote_after",),
                f"{self.demote_after} failures do not fit into a window of {self.window} uses",
            )
        return self

    def replaced_by(self, other: "FaultsSection") -> "FaultsSection":
        """Return this policy with another section's settings in place of its own."""
        return self.model_copy(
            update={name: getattr(other, name) for name in other.model_fields_set}
        )
