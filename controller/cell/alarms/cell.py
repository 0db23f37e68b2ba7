"""Alarms 100 to 199: stops on request; 900 to 999: of the controller itself. Data only."""

from typing import Final

from .alarm import Alarm, Severity

_STOP, _ABORT, _REFUSED = Severity.STOP, Severity.ABORT, Severity.REFUSED
_HOST = "controller"
_NOTHING = "nothing"

CELL: Final = (
    Alarm(
        101, "stop", _STOP, "operator",
        "somebody stopped the run",
        _NOTHING,
        "start again; a part in a gripper is reported first",
    ),
    Alarm(
        102, "terminal_gone", _STOP, _HOST,
        "the terminal was closed, or its connection broke",
        _NOTHING,
        "start again, in `tmux` or as a service",
    ),
    Alarm(
        103, "parent_gone", _STOP, _HOST,
        "the process that started the run died",
        _NOTHING,
        "start again; to let a run outlive its parent, run it as a service",
    ),
    Alarm(
        104, "output_gone", _STOP, _HOST,
        "the program that read the run's output has ended",
        _NOTHING,
        "start again with a reader that stays until the run ends",
    ),
    Alarm(
        105, "aborted", _ABORT, "operator",
        "somebody aborted the run",
        "the progress of any motion or grasp under way",
        "look at the cell and start again; a part in a gripper is reported first",
    ),
    Alarm(
        901, "journal", _ABORT, _HOST,
        "the journal cannot be written, and nothing may move without it",
        "everything done after its last row",
        "put the file back, make room on the disk, check the folder's permissions, and start again",
    ),
    Alarm(
        902, "file", _ABORT, _HOST,
        "a file of the run cannot be read or written",
        _NOTHING,
        "make room on the disk, check the folder's permissions, and start again",
    ),
    Alarm(
        903, "worker_gone", _ABORT, _HOST,
        "the worker process died: it was killed, or memory ran out",
        _NOTHING,
        "close other programs that use much memory, and start again",
    ),
    Alarm(
        904, "emulator_gone", _ABORT, "emulated cell",
        "the emulated cell has ended",
        "the whole state of the emulated cell: it is gone, and the part with it",
        "start again",
    ),
    Alarm(
        905, "internal", _ABORT, _HOST,
        "a bug of cellctl stopped the cell",
        "the progress of the action in which it happened",
        "look at the cell; send the log with your report",
    ),
    Alarm(
        906, "cell", _ABORT, "cell",
        "the cell cannot go on, for the reason in the message",
        "the items named in the message",
        "follow the message and start again",
    ),
    Alarm(
        907, "cell_busy", _REFUSED, _HOST,
        "another controller has the lock of the cell",
        _NOTHING,
        "wait for that run to end, or stop it",
    ),
    Alarm(
        908, "disk_full", _STOP, _HOST,
        "the disk is nearly full",
        _NOTHING,
        "make room on the disk and start again",
    ),
    Alarm(
        909, "no_permit", _ABORT, _HOST,
        "a motion was about to begin that nobody had permitted: a bug, caught in time",
        _NOTHING,
        "look at the cell and start again; send the journal with your report",
    ),
    Alarm(
        910, "loop_late", Severity.WARNING, _HOST,
        "the controller was late for longer than `detection.loop_late_s`",
        "changes in the cell meanwhile, until it is read",
        "close other programs on this machine",
    ),
    Alarm(
        911, "control", _REFUSED, _HOST,
        "the control socket cannot be served, or its server has ended",
        _NOTHING,
        "follow the message",
    ),
    Alarm(
        912, "not_acknowledged", _REFUSED, _HOST,
        "an emergency stop or an open door ended the last run, and nobody has acknowledged it",
        "changes in the cell since then",
        "look at the cell, acknowledge with `cellctl ack --why` and the reason, then start again",
    ),
    Alarm(
        913, "lease", _ABORT, _HOST,
        "a device or space was requested out of order, or never released: a bug, caught in time",
        _NOTHING,
        "look at the cell and start again; send the journal with your report",
    ),
    Alarm(
        914, "step_failed", _STOP, "commissioning",
        "a step of commissioning found a state that is not allowed",
        _NOTHING,
        "correct the fault named in the message and repeat the step",
    ),
    Alarm(
        915, "declined", _STOP, "operator",
        "a person ended a step of commissioning at a question",
        _NOTHING,
        "begin the step again",
    ),
    Alarm(
        916, "nobody_there", _REFUSED, "operator",
        "a step of commissioning needs a person, and nobody is there",
        _NOTHING,
        "start it in a terminal; `--yes` answers on an emulated cell",
    ),
    Alarm(
        917, "refused_motion", _REFUSED, "arm",
        "a jog was ordered to a place that the arm cannot or may not reach",
        _NOTHING,
        "read the reason and order another motion",
    ),
    Alarm(
        918, "wrong_order", _REFUSED, "operator",
        "an order of a jog was not understood",
        _NOTHING,
        "`?` lists the orders",
    ),
    Alarm(
        919, "supervised", _ABORT, _HOST,
        "the controller stalled, and its supervisor stopped the cell; or the supervisor ended",
        "changes in the cell meanwhile",
        "look at the cell, close other programs on this machine, and start again",
    ),
    Alarm(
        922, "journal_lost", _REFUSED, _HOST,
        "the journal noted for this cell is lost",
        "the contents of the grippers",
        "mount its disk or put the folder back; otherwise look at both grippers and use "
        "--part-removed",
    ),
    Alarm(
        920, "broke_off", _ABORT, _HOST,
        "an error prevented the run from coming to rest",
        "the position of the arm, and the contents of the grippers",
        "look at the cell; the next start reports parts that may be held",
    ),
    Alarm(
        921, "cut_off", _ABORT, _HOST,
        "the journal ends abruptly: the controller was killed, or power failed",
        "the position of the arm, and the contents of the grippers",
        "look at the cell; the next start reports parts that may be held",
    ),
)  # fmt: skip
