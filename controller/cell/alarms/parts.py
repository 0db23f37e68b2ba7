"""Alarms 400 to 499: of the part and its custody. Data only."""

from typing import Final

from messages import key

from .alarm import Alarm, Severity

_RECOVERED, _HOLD, _REFUSED = Severity.RECOVERED, Severity.HOLD, Severity.REFUSED
_ARM, _FIXED = key("arm gripper"), key("fixed gripper")
_TABLE = key("overhead camera")

PARTS: Final = (
    Alarm(
        401, "grip_missed", _RECOVERED, _ARM,
        key("the jaws closed on nothing over the table"),
        key("the position of the part on the table: the fingers may have pushed it"),
        key("check fingers and pads, and that the part matches the recipe; start again"),
    ),
    Alarm(
        402, "grip_wrong", _RECOVERED, _ARM,
        key("the jaws stopped at an opening other than the grasp's"),
        key("the position of the part on the table, and whether it is the right part"),
        key("look for chips or a second part between the fingers; start again"),
    ),
    Alarm(
        403, "part_lost", _RECOVERED, key("both grippers"),
        key("the part has left the gripper that held it, and was not found again"),
        key("the position of the part"),
        key("look below the arm's last path, in the fixed gripper and in the trays; check pads "
        "and part for oil"),
    ),
    Alarm(
        404, "part_not_seen", _RECOVERED, _TABLE,
        key("the part fell, and the table shows no part"),
        key("the position of the part"),
        key("look below the arm's last path and at the fixed gripper"),
    ),
    Alarm(
        405, "hold_not_seen", _RECOVERED, key("inspection camera"),
        key("no view confirms the hold, or even that a part is held"),
        key("whether the arm gripper has the part, and in which grasp"),
        key("look at the arm gripper; check lamps and camera of the station"),
    ),
    Alarm(
        406, "held_otherwise", _RECOVERED, _ARM,
        key("the part sits in the arm gripper otherwise than planned, or has slipped"),
        key("nothing: the pose was measured"),
        key("check pads and force; if every part slips, check the part's surface for oil"),
    ),
    Alarm(
        407, "hand_off_failed", _RECOVERED, _FIXED,
        key("the fixed gripper did not receive the part; the arm gripper still has it"),
        key("the exact grasp: the fixed gripper may have turned the part"),
        key("check how the part sits between the jaws; check the pose of the fixed gripper in "
        "the cell file"),
    ),
    Alarm(
        408, "take_back_failed", _RECOVERED, _ARM,
        key("the arm gripper did not receive the part back; the fixed gripper still has it"),
        key("the exact grasp: no camera sees the part in the fixed gripper"),
        key(
            "check how the part sits between the jaws; take it out with `cellctl recover "
            "--open fixed`"
        ),
    ),
    Alarm(
        409, "seen_too_little", _RECOVERED, key("inspection camera"),
        key("views showed less of the surface than planned or required"),
        key("whether the remaining surface is good"),
        key("read in the report which views could not be evaluated, and why"),
    ),
    Alarm(
        410, "no_part", _HOLD, _TABLE,
        key("nothing dark lies on the backlit area"),
        "nothing",
        key("lay one part on the backlit area and start again"),
    ),
    Alarm(
        411, "many_parts", _HOLD, _TABLE,
        key("several objects are on the table, and none of them can be chosen as the part"),
        key("which of them is the part, if several may be"),
        key("move them apart, or take the others away; start again"),
    ),
    Alarm(
        424, "tray_full", _HOLD, "trays",
        key("every nest of a tray has a part"),
        "nothing",
        key("empty the tray and answer; unattended, empty it and start again with --trays-empty"),
    ),
    Alarm(
        412, "unknown_object", _HOLD, key("the camera that saw it"),
        key("the object matches none of the parts of the recipe"),
        key("the identity of the object"),
        key("take it away, check it for damage, check the recipe's `part:`"),
    ),
    Alarm(
        423, "part_cut_off", _HOLD, _TABLE,
        key("the part is known, but lies partly outside the backlit area or the picture"),
        key("objects outside the camera's picture"),
        key("move it inwards and start again"),
    ),
    Alarm(
        413, "wrong_part", _HOLD, key("the camera that saw it"),
        key("another part of the recipe's `others:` is there"),
        "nothing",
        key("put the recipe's part there, or start with a recipe for this one"),
    ),
    Alarm(
        414, "ambiguous", _RECOVERED, key("inspection camera"),
        key("the deciding view shows another part of `others:`, or several parts or poses "
        "remain possible"),
        key("which part it is, unless the message names it"),
        key("sort by hand what lies in the quarantine tray"),
    ),
    Alarm(
        415, "no_plan", _HOLD, "planner",
        key("no plan leads on from the position of the part"),
        "nothing",
        key(
            "read the reason in the message; move the part on the table, or take it out of the "
            "cell"
        ),
    ),
    Alarm(
        416, "no_way_home", _HOLD, "arm",
        key("the arm cannot leave the camera's picture without contact"),
        key("obstacles that the cell file does not list"),
        key("clear the space about the arm and start again"),
    ),
    Alarm(
        417, "fixture_not_empty", _HOLD, _FIXED,
        key("the fixed gripper holds something before the arm is homed"),
        key("the identity of that object"),
        key("take it out by hand and answer; or end the run, then `cellctl recover --open fixed`"),
    ),
    Alarm(
        418, "still_held", _HOLD, key("both grippers"),
        key("a gripper holds something although the part was reported as taken out"),
        key("the identity of that object"),
        key("look at both grippers, take the part out, then answer once more"),
    ),
    Alarm(
        422, "recovery_contradicted", _HOLD, key("both grippers"),
        key(
            "while continuing with a part of an earlier run, the gripper that should hold it "
            "does not"
        ),
        key("which gripper has the part"),
        key("look at both grippers; take the part out with `cellctl recover`"),
    ),
    Alarm(
        425, "no_serial", _HOLD, "scanner",
        key("nobody read the serial number of the next part"),
        key("which part comes next"),
        key("start with a terminal or with --wait, read the number and answer"),
    ),
    Alarm(
        420, "part_may_be_held", _REFUSED, key("both grippers"),
        key("a gripper holds, or may hold, a part of an earlier run"),
        key("whether the gripper named holds it, and in which grasp"),
        key("see `cellctl recover`; take the part out, or start with --part-removed"),
    ),
    Alarm(
        421, "release_impossible", _REFUSED, _FIXED,
        key("the gripper cannot be opened without another motion first"),
        "nothing",
        key("take the part out by the gripper's own release, then start with --part-removed"),
    ),
)  # fmt: skip
