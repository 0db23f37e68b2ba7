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
        "start again; to outlive its parent, run it as a service",
    ),
    Alarm(
        104, "output_gone", _STOP, _HOST,
        "nobody reads the run's output any more",
        _NOTHING,
        "start again without a reader that leaves",
    ),
    Alarm(
        105, "aborted", _ABORT, "operator",
        "somebody aborted the run",
        "how far a motion or a grasp came that was under way",
        "look at the cell, start again; a part in a gripper is reported first",
    ),
    Alarm(
        901, "journal", _ABORT, _HOST,
        "the journal cannot be written, and nothing may move without it",
        "what was done after its last row",
        "put the file back in its place, make room on the disk, check the folder's permissions, "
        "start again",
    ),
    Alarm(
        902, "file", _ABORT, _HOST,
        "a file of the run cannot be read or written",
        _NOTHING,
        "make room on the disk, check the folder's permissions, start again",
    ),
    Alarm(
        903, "worker_gone", _ABORT, _HOST,
        "the worker process has died: it was killed, or memory ran out",
        _NOTHING,
        "close what else uses the memory, start again",
    ),
    Alarm(
        904, "emulator_gone", _ABORT, "emulated cell",
        "the emulated cell has ended",
        "all of the emulated cell: it is gone, and the part with it",
        "start again",
    ),
    Alarm(
        905, "internal", _ABORT, _HOST,
        "a bug of cellctl stopped the cell",
        "what the action in which it happened has done",
        "look at the cell; send the log with your report",
    ),
    Alarm(
        906, "cell", _ABORT, "cell",
        "the cell cannot go on, for the reason in the message",
        "what the message names",
        "do what the message names, start again",
    ),
    Alarm(
        907, "cell_busy", _REFUSED, _HOST,
        "another controller has the cell",
        _NOTHING,
        "wait until that run has ended, or stop it",
    ),
    Alarm(
        908, "disk_full", _STOP, _HOST,
        "the disk is nearly full",
        _NOTHING,
        "make room on the disk, start again",
    ),
    Alarm(
        909, "no_permit", _ABORT, _HOST,
        "something was to move that nobody had permitted: a bug, caught in time",
        _NOTHING,
        "look at the cell, start again; send the journal with your report",
    ),
    Alarm(
        910, "loop_late", Severity.WARNING, _HOST,
        "the controller was late for longer than `detection.loop_late_s`",
        "what happened in the cell meanwhile, until it is read",
        "close what else runs on the machine",
    ),
    Alarm(
        911, "control", _REFUSED, _HOST,
        "the control socket cannot be served, or nobody serves it",
        _NOTHING,
        "do what the message names",
    ),
    Alarm(
        912, "not_acknowledged", _REFUSED, _HOST,
        "an emergency stop or an open door ended the last run, and nobody has acknowledged it",
        "what was done in the cell since",
        "look at the cell, then `cellctl ack --why` with the reason, and start again",
    ),
    Alarm(
        913, "lease", _ABORT, _HOST,
        "a device or space was asked for out of order, or never given back: a bug, caught",
        _NOTHING,
        "look at the cell, start again; send the journal with your report",
    ),
    Alarm(
        914, "step_failed", _STOP, "commissioning",
        "what a step of commissioning found is not what should be",
        _NOTHING,
        "mend what the message names, repeat the step",
    ),
    Alarm(
        915, "declined", _STOP, "operator",
        "somebody ended a step of commissioning at a question",
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
        "a jog wanted to go where the arm cannot or may not",
        _NOTHING,
        "read why, order another motion",
    ),
    Alarm(
        918, "wrong_order", _REFUSED, "operator",
        "an order of a jog cannot be understood",
        _NOTHING,
        "`?` lists the orders",
    ),
    Alarm(
        919, "supervised", _ABORT, _HOST,
        "the controller stood still, and its supervisor stopped the cell; or the supervisor ended",
        "what happened in the cell meanwhile",
        "look at the cell, close what else runs on the machine, start again",
    ),
    Alarm(
        922, "journal_lost", _REFUSED, _HOST,
        "the journal that is noted for this cell is lost",
        "what the grippers hold",
        "mount its disk or put the folder back; else look at both grippers, use --part-removed",
    ),
    Alarm(
        920, "broke_off", _ABORT, _HOST,
        "an error kept the run from coming to rest",
        "where the arm is, and what the grippers hold",
        "look at the cell; the next start reports what may be held",
    ),
    Alarm(
        921, "cut_off", _ABORT, _HOST,
        "the journal just stops: the controller was killed, or power failed",
        "where the arm is, and what the grippers hold",
        "look at the cell; the next start reports what may be held",
    ),
)  # fmt: skip
