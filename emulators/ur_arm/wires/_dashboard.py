"""The dashboard server: one line of text in, one out; universal_robots.md 3.

There is no panel and no program on a disk: `load` finds no file, and popups are nobody's.
"""

from collections.abc import Callable, Mapping
from typing import Final

from .._facts import Software
from .._model import UrArm
from .._modes import RobotMode, RuntimeState, SafetyMode

GREETING: Final = "Connected: Universal Robots Dashboard Server"
NOT_REMOTE: Final = (
    "Command is not allowed due to safety reasons, please switch robot to Remote Control mode and "
    "reconnect to port 29999"
)
TOO_SOON: Final = (
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective "
    "stop before unlocking"
)
SERIAL_NUMBER: Final = "20195500001"
LINE_BYTES_MAX: Final = 4096


class DashboardSession:
    """One client of the dashboard.

    A connection that was made in local mode stays without remote control, whatever the mode is
    later.

    Parameters
    ----------
    arm : the controller
    software : its version
    """

    def __init__(self, arm: UrArm, software: Software) -> None:
        self._arm, self._software = arm, software
        self._was_remote = arm.is_remote
        self._rest = b""
        self.has_quit = False
        self._queries: Mapping[str, Callable[[], str]] = {
            "robotmode": lambda: f"Robotmode: {arm.robot_mode.name}",
            "safetymode": lambda: f"Safetymode: {arm.safety_mode.name}",
            "safetystatus": lambda: f"Safetystatus: {arm.safety_mode.name}",
            "running": lambda: f"Program running: {_word(self._plays)}",
            "programstate": self._program_state,
            "get loaded program": lambda: "No program loaded",
            "isprogramsaved": lambda: f"true {arm.program_name or 'unnamed'}",
            "polyscopeversion": lambda: f"URSoftware {software.text} (emulated)",
            "version": lambda: software.text,
            "get serial number": lambda: SERIAL_NUMBER,
            "get robot model": lambda: arm.facts.name,
            "is in remote control": lambda: _word(arm.is_remote),
            "get operational mode": lambda: "NONE",
            "close popup": lambda: "closing popup",
            "close safety popup": lambda: "closing safety popup",
            "quit": self._quit,
        }
        self._orders: Mapping[str, Callable[[], str]] = {
            "power on": lambda: self._done(arm.power_on(), "Powering on", "power on"),
            "brake release": lambda: self._done(
                arm.release_brakes(), "Brake releasing", "brake release"
            ),
            "power off": self._power_off,
            "play": lambda: self._done(arm.play(), "Starting program", "play"),
            "pause": lambda: self._done(arm.pause(), "Pausing program", "pause"),
            "stop": lambda: self._done(arm.stop_program(), "Stopped", "stop"),
            "unlock protective stop": self._unlock,
            "restart safety": self._restart_safety,
        }

    @property
    def _plays(self) -> bool:
        return self._arm.runtime_state is RuntimeState.PLAYING

    def feed(self, data: bytes) -> bytes:
        """Return the replies to the lines that are complete now."""
        self._rest += data
        replies = []
        while (cut := self._rest.find(b"\n")) >= 0 and not self.has_quit:
            line, self._rest = self._rest[:cut], self._rest[cut + 1 :]
            replies.append(self.answer(line.decode("utf-8", "replace").strip()))
        if len(self._rest) > LINE_BYTES_MAX:
            self._rest = b""
        return "".join(f"{reply}\n" for reply in replies).encode()

    def answer(self, line: str) -> str:
        """Return the reply to one line, without its newline; case does not count."""
        command = line.lower()
        if command in self._queries:
            return self._queries[command]()
        if command in self._orders:
            return self._orders[command]() if self._may_order else NOT_REMOTE
        word, _, rest = line.partition(" ")
        if word.lower() == "load":
            return f"File not found: {rest}" if self._may_order else NOT_REMOTE
        if word.lower() == "popup":
            return "showing popup"
        if word.lower() == "addtolog":
            return "Added log message"
        return f"could not understand: '{line}'"

    @property
    def _may_order(self) -> bool:
        return self._was_remote and self._arm.is_remote

    @staticmethod
    def _done(is_done: bool, reply: str, command: str) -> str:
        return reply if is_done else f"Failed to execute: {command}"

    def _program_state(self) -> str:
        states = {RuntimeState.PLAYING: "PLAYING", RuntimeState.PAUSED: "PAUSED"}
        state = self._arm.runtime_state
        word = states.get(state, "PAUSED" if state is RuntimeState.PAUSING else "STOPPED")
        return f"{word} {self._arm.program_name or 'null'}"

    def _quit(self) -> str:
        self.has_quit = True
        return "Disconnected"

    def _power_off(self) -> str:
        self._arm.power_off()
        return "Powering off"

    def _unlock(self) -> str:
        if self._arm.safety_mode is not SafetyMode.PROTECTIVE_STOP:
            return "Failed to execute: unlock protective stop"
        return "Protective stop releasing" if self._arm.unlock_protective_stop() else TOO_SOON

    def _restart_safety(self) -> str:
        arm = self._arm
        if arm.safety_mode in (SafetyMode.FAULT, SafetyMode.VIOLATION):
            arm.safety_mode = SafetyMode.NORMAL
        if arm.robot_mode is not RobotMode.POWER_OFF:
            arm.power_off()
        return "Restarting safety"


def _word(is_so: bool) -> str:
    return "true" if is_so else "false"
