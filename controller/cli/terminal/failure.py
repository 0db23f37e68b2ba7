"""Turns the end of a command into one sentence and an exit code.

Knows the errors of all rooms and so imports them; it is imported only after a failure. Those of
the history are errors of results, and its database is not loaded to name another failure.
"""

import os
from collections.abc import Sequence

from controller.cad import CadError
from controller.catalogue import PoolLostError
from controller.cell.devices.emulator import EmulatorError
from controller.cell.errors import CellError
from controller.cell.journal import JournalError
from controller.config import ConfigError
from controller.planning import NoPlanError
from controller.results.run import ResultsError, UnknownRunError
from drivers.errors import DeviceError

from ._bug import report_bug
from .output import refuse, warn

WRONG_INPUT = (ConfigError, CadError, UnknownRunError)  # exit code 2; all others 1
SAID_NO = (
    CellError,
    DeviceError,
    EmulatorError,
    JournalError,
    NoPlanError,
    PoolLostError,
    ResultsError,
)


def report_failure(error: BaseException, words: Sequence[str]) -> int:
    """Print one sentence about an error and return the exit code.

    Parameters
    ----------
    error : error that ended the command
    words : the command line, for the report of a bug
    """
    if isinstance(error, KeyboardInterrupt):
        warn("cellctl: interrupted")
        return 1
    if isinstance(error, WRONG_INPUT):
        refuse(error)
        return 2
    if isinstance(error, SAID_NO):
        refuse(error)
        return 1
    if isinstance(error, OSError) and error.strerror is not None:
        where = "" if error.filename is None else f"{os.fsdecode(error.filename)}: "
        warn(f"cellctl: {where}{error.strerror}")
        return 1
    report_bug(error, words, verbose="--verbose" in words or "-v" in words)
    return 1
