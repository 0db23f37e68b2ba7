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
        "the position of the part on the table: the fingers may have pushed it",
        "check fingers and pads, and that the part matches the recipe; start again",
    ),
    Alarm(
        402, "grip_wrong", _RECOVERED, _ARM,
        "the jaws stopped at an opening other than the grasp's",
        "the position of the part on the table, and whether it is the right part",
        "look for chips or a second part between the fingers; start again",
    ),
    Alarm(
        403, "part_lost", _RECOVERED, "both grippers",
        "the part has left the gripper that held it, and was not found again",
        "the position of the part",
        "look below the arm's last path, in the fixed gripper and in the trays; check pads "
        "and part for oil",
    ),
    Alarm(
        404, "part_not_seen", _RECOVERED, _TABLE,
        "the part fell, and the table shows no part",
        "the position of the part",
        "look below the arm's last path and at the fixed gripper",
    ),
    Alarm(
        405, "hold_not_seen", _RECOVERED, "inspection camera",
        "no view confirms the hold, or even that a part is held",
        "whether the arm gripper has the part, and in which grasp",
        "look at the arm gripper; check lamps and camera of the station",
    ),
    Alarm(
        406, "held_otherwise", _RECOVERED, _ARM,
        "the part sits in the arm gripper otherwise than planned, or has slipped",
        "nothing: the pose was measured",
        "check pads and force; if every part slips, check the part's surface for oil",
    ),
    Alarm(
        407, "hand_off_failed", _RECOVERED, _FIXED,
        "the fixed gripper did not receive the part; the arm gripper still has it",
        "the exact grasp: the fixed gripper may have turned the part",
        "check how the part sits between the jaws; check the pose of the fixed gripper in "
        "the cell file",
    ),
    Alarm(
        408, "take_back_failed", _RECOVERED, _ARM,
        "the arm gripper did not receive the part back; the fixed gripper still has it",
        "the exact grasp: no camera sees the part in the fixed gripper",
        "check how the part sits between the jaws; take it out with `cellctl recover --open fixed`",
    ),
    Alarm(
        409, "seen_too_little", _RECOVERED, "inspection camera",
        "views showed less of the surface than planned or required",
        "whether the remaining surface is good",
        "read in the report which views could not be evaluated, and why",
    ),
    Alarm(
        410, "no_part", _HOLD, _TABLE,
        "nothing dark lies on the backlit area",
        "nothing",
        "lay one part on the backlit area and start again",
    ),
    Alarm(
        411, "many_parts", _HOLD, _TABLE,
        "several objects are on the table, and none of them can be chosen as the part",
        "which of them is the part, if several may be",
        "move them apart, or take the others away; start again",
    ),
    Alarm(
        424, "tray_full", _HOLD, "trays",
        "every nest of a tray has a part",
        "nothing",
        "empty the tray and answer; unattended, empty it and start again with --trays-empty",
    ),
    Alarm(
        412, "unknown_object", _HOLD, "the camera that saw it",
        "the object matches none of the parts of the recipe",
        "the identity of the object",
        "take it away, check it for damage, check the recipe's `part:`",
    ),
    Alarm(
        423, "part_cut_off", _HOLD, _TABLE,
        "the part is known, but lies partly outside the backlit area or the picture",
        "objects outside the camera's picture",
        "move it inwards and start again",
    ),
    Alarm(
        413, "wrong_part", _HOLD, "the camera that saw it",
        "another part of the recipe's `others:` is there",
        "nothing",
        "put the recipe's part there, or start with a recipe for this one",
    ),
    Alarm(
        414, "ambiguous", _RECOVERED, "inspection camera",
        "the deciding view shows another part of `others:`, or several parts or poses "
        "remain possible",
        "which part it is, unless the message names it",
        "sort by hand what lies in the quarantine tray",
    ),
    Alarm(
        415, "no_plan", _HOLD, "planner",
        "no plan leads on from the position of the part",
        "nothing",
        "read the reason in the message; move the part on the table, or take it out of the cell",
    ),
    Alarm(
        416, "no_way_home", _HOLD, "arm",
        "the arm cannot leave the camera's picture without contact",
        "obstacles that the cell file does not list",
        "clear the space about the arm and start again",
    ),
    Alarm(
        417, "fixture_not_empty", _HOLD, _FIXED,
        "the fixed gripper holds something before the arm is homed",
        "the identity of that object",
        "take it out by hand and answer; or end the run, then `cellctl recover --open fixed`",
    ),
    Alarm(
        418, "still_held", _HOLD, "both grippers",
        "a gripper holds something although the part was reported as taken out",
        "the identity of that object",
        "look at both grippers, take the part out, then answer once more",
    ),
    Alarm(
        422, "recovery_contradicted", _HOLD, "both grippers",
        "while continuing with a part of an earlier run, the gripper that should hold it does not",
        "which gripper has the part",
        "look at both grippers; take the part out with `cellctl recover`",
    ),
    Alarm(
        425, "no_serial", _HOLD, "scanner",
        "nobody read the serial number of the next part",
        "which part comes next",
        "start with a terminal or with --wait, read the number and answer",
    ),
    Alarm(
        420, "part_may_be_held", _REFUSED, "both grippers",
        "a gripper holds, or may hold, a part of an earlier run",
        "whether the gripper named holds it, and in which grasp",
        "see `cellctl recover`; take the part out, or start with --part-removed",
    ),
    Alarm(
        421, "release_impossible", _REFUSED, _FIXED,
        "the gripper cannot be opened without another motion first",
        "nothing",
        "take the part out by the gripper's own release, then start with --part-removed",
    ),
)  # fmt: skip
