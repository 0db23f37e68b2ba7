"""Alarms 400 to 499: of the part and its custody. Data only."""

from typing import Final

from .alarm import Alarm, Severity

_RECOVERED, _HOLD, _REFUSED = Severity.RECOVERED, Severity.HOLD, Severity.REFUSED
_ARM, _FIXED = "arm gripper", "fixed gripper"
_TABLE = "overhead camera"

PARTS: Final = (
    Alarm(
        401, "grip_missed", _RECOVERED, _ARM,
        "the jaws closed on nothing over the table",
        "where on the table the part is: the fingers may have pushed it",
        "check fingers and pads, and that the part is the recipe's; start again",
    ),
    Alarm(
        402, "grip_wrong", _RECOVERED, _ARM,
        "the jaws stopped at another opening than the grasp has",
        "where on the table the part is, and whether it is the right part",
        "look for chips or a second part between the fingers; start again",
    ),
    Alarm(
        403, "part_lost", _RECOVERED, "both grippers",
        "the part has left the gripper that had it, and is not found again",
        "where the part is",
        "look below the arm's last path, in the fixed gripper and in the trays; check pads and "
        "part for oil",
    ),
    Alarm(
        404, "part_not_seen", _RECOVERED, _TABLE,
        "after a fall the table shows no part",
        "where the part is",
        "look below the arm's last path and at the fixed gripper",
    ),
    Alarm(
        405, "hold_not_seen", _RECOVERED, "inspection camera",
        "no view confirms how the part is held, or that it is held at all",
        "whether the arm gripper has the part, and how",
        "look at what the arm gripper holds; check lamps and camera of the station",
    ),
    Alarm(
        406, "held_otherwise", _RECOVERED, _ARM,
        "the part sits otherwise in the arm gripper than planned, or has slipped",
        "nothing: the pose was measured",
        "check pads and force; if every part slips, check the part's surface for oil",
    ),
    Alarm(
        407, "hand_off_failed", _RECOVERED, _FIXED,
        "the fixed gripper did not receive the part; the arm gripper still has it",
        "how exactly the part is held: the fixed gripper may have turned it",
        "look how the part sits between the jaws; check the pose of the fixed gripper in the cell "
        "file",
    ),
    Alarm(
        408, "take_back_failed", _RECOVERED, _ARM,
        "the arm gripper did not receive the part back; the fixed gripper still has it",
        "how exactly the part is held: no camera sees it in the fixed gripper",
        "look how the part sits between the jaws; take it out with `cellctl recover --open fixed`",
    ),
    Alarm(
        409, "seen_too_little", _RECOVERED, "inspection camera",
        "views showed less of the surface than was promised or is required",
        "whether the surface that is left is good",
        "read in the report which views could not be evaluated, and why",
    ),
    Alarm(
        410, "no_part", _HOLD, _TABLE,
        "nothing dark is on the backlit area",
        "nothing",
        "lay one part on the backlit area, start again",
    ),
    Alarm(
        411, "many_parts", _HOLD, _TABLE,
        "several objects are on the table, and none of them can be taken for the part",
        "which of them is meant, where several may be",
        "move them apart, or take the others away; start again",
    ),
    Alarm(
        424, "tray_full", _HOLD, "trays",
        "each nest of a tray has a part",
        "nothing",
        "empty the tray and answer; unattended, empty it and start again with --trays-empty",
    ),
    Alarm(
        412, "unknown_object", _HOLD, "the camera that saw it",
        "the object looks like none of the parts of the recipe",
        "what it is",
        "take it away, check it for damage, check the recipe's `part:`",
    ),
    Alarm(
        423, "part_cut_off", _HOLD, _TABLE,
        "the part is known, but lies partly outside the backlit area or the picture",
        "what else is where the camera does not see",
        "move it inwards, start again",
    ),
    Alarm(
        413, "wrong_part", _HOLD, "the camera that saw it",
        "another part of the recipe's `others:` is there",
        "nothing",
        "put the recipe's part there, or start with a recipe for this one",
    ),
    Alarm(
        414, "ambiguous", _RECOVERED, "inspection camera",
        "the deciding view shows another part of `others:`, or leaves several parts or poses",
        "which part it is, unless the message names it",
        "sort by hand what lies in the quarantine tray",
    ),
    Alarm(
        415, "no_plan", _HOLD, "planner",
        "no plan leads on from where the part is",
        "nothing",
        "read the reason in the message; move the part on the table, or take it out of the cell",
    ),
    Alarm(
        416, "no_way_home", _HOLD, "arm",
        "the arm cannot leave the camera's picture without touching something",
        "what stands about it, if it is not in the cell file",
        "clear the space about the arm, start again",
    ),
    Alarm(
        417, "fixture_not_empty", _HOLD, _FIXED,
        "the fixed gripper holds something before the arm is homed",
        "what it is",
        "take it out by hand and answer; or end the run, then `cellctl recover --open fixed`",
    ),
    Alarm(
        418, "still_held", _HOLD, "both grippers",
        "a gripper holds something although the part was said to be out",
        "what it holds",
        "look at both grippers, take the part out, then answer once more",
    ),
    Alarm(
        422, "recovery_contradicted", _HOLD, "both grippers",
        "going on with a part that was left, a gripper that should hold it does not",
        "which gripper has the part",
        "look at both grippers; take the part out with `cellctl recover`",
    ),
    Alarm(
        425, "no_serial", _HOLD, "scanner",
        "nobody read the serial number of the next part",
        "which part is to come next",
        "start with a terminal or with --wait, read the number and answer",
    ),
    Alarm(
        420, "part_may_be_held", _REFUSED, "both grippers",
        "a gripper holds a part, or may hold one, that an earlier run left",
        "whether and how the gripper named holds it",
        "see `cellctl recover`; take the part out, or start with --part-removed",
    ),
    Alarm(
        421, "release_impossible", _REFUSED, _FIXED,
        "the gripper cannot be opened without another motion first",
        "nothing",
        "take the part out by the gripper's own release, then start with --part-removed",
    ),
)  # fmt: skip
