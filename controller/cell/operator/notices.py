"""Reports alarms to people away from the cell, by a command of their own. Never waited for."""

import json
import logging
import os
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from ..journal import rows

ALIVE_COUNT_MAX: Final = 5  # largest number of commands at a time; further alarms are not passed on
END_WALL_S: Final = 5.0  # time left for the last commands once the run has ended

log = logging.getLogger(__name__)


class Notices:
    """Runs a command for each alarm, with the alarm as JSON on its standard input.

    Parameters
    ----------
    command : program and arguments; empty for none
    folder : working folder, that of the cell file
    facts : facts of the run, added to each alarm
    """

    def __init__(self, command: Sequence[str], folder: Path, facts: dict[str, Any]) -> None:
        self._command, self._folder, self._facts = tuple(command), folder, facts
        self._alive: list[subprocess.Popen[bytes]] = []

    def take(self, row: rows.CellEvent) -> None:
        """Pass an event's alarm on, if it has one; returns at once.

        Parameters
        ----------
        row : as it went into the journal
        """
        if not self._command or row.alarm is None:
            return
        self._alive = [one for one in self._alive if one.poll() is None]
        if len(self._alive) >= ALIVE_COUNT_MAX:
            log.warning("on_alarm: %d of them still run; this alarm is left out", ALIVE_COUNT_MAX)
            return
        facts = {**self._facts, **row.alarm.model_dump(), "message": row.message}
        try:
            process = subprocess.Popen(
                self._command,
                cwd=self._folder,
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for the run
            )
        except OSError as error:
            log.warning("on_alarm: %s: %s", self._command[0], error.strerror or error)
            return
        self._alive.append(process)
        assert process.stdin is not None
        # an alarm is far smaller than a pipe; where nobody reads it, nobody is waited for
        os.set_blocking(process.stdin.fileno(), False)
        with suppress(OSError), process.stdin as pipe:
            pipe.write(json.dumps(facts).encode() + b"\n")

    def close(self) -> None:
        """Give the last commands a moment, then leave them to themselves."""
        for process in self._alive:
            with suppress(subprocess.TimeoutExpired):
                process.wait(END_WALL_S)
