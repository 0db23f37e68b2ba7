"""Alarms 100 to 199: stops on request; 900 to 999: of the controller itself. Data only."""

from typing import Final

from messages import key

from .alarm import Alarm, Severity

_STOP, _ABORT, _REFUSED = Severity.STOP, Severity.ABORT, Severity.REFUSED
_HOST = "controller"
_NOTHING = "nothing"

CELL: Final = (
    Alarm(
        101, "stop", _STOP, "operator",
        key("somebody stopped the run"),
        _NOTHING,
        key("start again; a part in a gripper is reported first"),
    ),
    Alarm(
        102, "terminal_gone", _STOP, _HOST,
        key("the terminal was closed, or its connection broke"),
        _NOTHING,
        key("start again, in `tmux` or as a service"),
    ),
    Alarm(
        103, "parent_gone", _STOP, _HOST,
        key("the process that started the run died"),
        _NOTHING,
        key("start again; to let a run outlive its parent, run it as a service"),
    ),
    Alarm(
        104, "output_gone", _STOP, _HOST,
        key("the program that read the run's output has ended"),
        _NOTHING,
        key("start again with a reader that stays until the run ends"),
    ),
    Alarm(
        105, "aborted", _ABORT, "operator",
        key("somebody aborted the run"),
        key("the progress of any motion or grasp under way"),
        key("look at the cell and start again; a part in a gripper is reported first"),
    ),
    Alarm(
        901, "journal", _ABORT, _HOST,
        key("the journal cannot be written, and nothing may move without it"),
        key("everything done after its last row"),
        key(
            "put the file back, make room on the disk, check the folder's permissions, and "
            "start again"
        ),
    ),
    Alarm(
        902, "file", _ABORT, _HOST,
        key("a file of the run cannot be read or written"),
        _NOTHING,
        key("make room on the disk, check the folder's permissions, and start again"),
    ),
    Alarm(
        903, "worker_gone", _ABORT, _HOST,
        key("the worker process died: it was killed, or memory ran out"),
        _NOTHING,
        key("close other programs that use much memory, and start again"),
    ),
    Alarm(
        904, "emulator_gone", _ABORT, key("emulated cell"),
        key("the emulated cell has ended"),
        key("the whole state of the emulated cell: it is gone, and the part with it"),
        key("start again"),
    ),
    Alarm(
        905, "internal", _ABORT, _HOST,
        key("a bug of cellctl stopped the cell"),
        key("the progress of the action in which it happened"),
        key("look at the cell; send the log with your report"),
    ),
    Alarm(
        906, "cell", _ABORT, "cell",
        key("the cell cannot go on, for the reason in the message"),
        key("the items named in the message"),
        key("follow the message and start again"),
    ),
    Alarm(
        907, "cell_busy", _REFUSED, _HOST,
        key("another controller has the lock of the cell"),
        _NOTHING,
        key("wait for that run to end, or stop it"),
    ),
    Alarm(
        908, "disk_full", _STOP, _HOST,
        key("the disk is nearly full"),
        _NOTHING,
        key("make room on the disk and start again"),
    ),
    Alarm(
        909, "no_permit", _ABORT, _HOST,
        key("a motion was about to begin that nobody had permitted: a bug, caught in time"),
        _NOTHING,
        key("look at the cell and start again; send the journal with your report"),
    ),
    Alarm(
        910, "loop_late", Severity.WARNING, _HOST,
        key("the controller was late for longer than `detection.loop_late_s`"),
        key("changes in the cell meanwhile, until it is read"),
        key("close other programs on this machine"),
    ),
    Alarm(
        911, "control", _REFUSED, _HOST,
        key("the control socket cannot be served, or its server has ended"),
        _NOTHING,
        key("follow the message"),
    ),
    Alarm(
        912, "not_acknowledged", _REFUSED, _HOST,
        key("an emergency stop or an open door ended the last run, and nobody has acknowledged it"),
        key("changes in the cell since then"),
        key(
            "look at the cell, acknowledge with `cellctl ack --why` and the reason, then start "
            "again"
        ),
    ),
    Alarm(
        913, "lease", _ABORT, _HOST,
        key(
            "a device or space was requested out of order, or never released: a bug, caught in "
            "time"
        ),
        _NOTHING,
        key("look at the cell and start again; send the journal with your report"),
    ),
    Alarm(
        914, "step_failed", _STOP, "commissioning",
        key("a step of commissioning found a state that is not allowed"),
        _NOTHING,
        key("correct the fault named in the message and repeat the step"),
    ),
    Alarm(
        915, "declined", _STOP, "operator",
        key("a person ended a step of commissioning at a question"),
        _NOTHING,
        key("begin the step again"),
    ),
    Alarm(
        916, "nobody_there", _REFUSED, "operator",
        key("a step of commissioning needs a person, and nobody is there"),
        _NOTHING,
        key("start it in a terminal; `--yes` answers on an emulated cell"),
    ),
    Alarm(
        917, "refused_motion", _REFUSED, "arm",
        key("a jog was ordered to a place that the arm cannot or may not reach"),
        _NOTHING,
        key("read the reason and order another motion"),
    ),
    Alarm(
        918, "wrong_order", _REFUSED, "operator",
        key("an order of a jog was not understood"),
        _NOTHING,
        key("`?` lists the orders"),
    ),
    Alarm(
        919, "supervised", _ABORT, _HOST,
        key("the controller stalled, and its supervisor stopped the cell; or the supervisor ended"),
        key("changes in the cell meanwhile"),
        key("look at the cell, close other programs on this machine, and start again"),
    ),
    Alarm(
        922, "journal_lost", _REFUSED, _HOST,
        key("the journal noted for this cell is lost"),
        key("the contents of the grippers"),
        key("mount its disk or put the folder back; otherwise look at both grippers and use "
        "--part-removed"),
    ),
    Alarm(
        920, "broke_off", _ABORT, _HOST,
        key("an error prevented the run from coming to rest"),
        key("the position of the arm, and the contents of the grippers"),
        key("look at the cell; the next start reports parts that may be held"),
    ),
    Alarm(
        921, "cut_off", _ABORT, _HOST,
        key("the journal ends abruptly: the controller was killed, or power failed"),
        key("the position of the arm, and the contents of the grippers"),
        key("look at the cell; the next start reports parts that may be held"),
    ),
)  # fmt: skip
