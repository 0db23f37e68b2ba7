"""The handshake with a PLC as a state machine: edges in, actions and registers out. No I/O.

A start is asked for by a rising edge and answered by `START_ACKNOWLEDGED`, or by `COMMAND_FAILED`
and a reason; both go when the PLC drops the bit. A result stands with `RESULT_VALID` until the PLC
raises `RESULT_ACKNOWLEDGED`; the next one comes after it has dropped that. So whatever is late,
doubled or missing on either side costs time and no part:

- a start that was high already when the bridge began is no edge: a PLC that writes all its outputs
  in each cycle would start the order of before the break once more
- a stop counts at once, even then
- a result that nobody has acknowledged is shown again after a restart, with the same number
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from ...model import PACKML_NUMBERS, CellState, OrderState, PartResult
from .registers import (
    ALARM,
    COUNT,
    HEARTBEAT,
    MAP_VERSION,
    PACKML,
    REFUSAL,
    STATUS,
    VERSION,
    Command,
    CommandBit,
    FailureReason,
    Status,
    result_registers,
)

HEARTBEAT_S: Final = 0.1
# A PLC whose heartbeat stands this long starts nothing: its program has stopped, or the line is
# cut.
STANDS_S: Final = 2.0
# Results that may wait for the PLC before it gets no further start, as on other makers' cameras.
MAX_WAITING: Final = 8
FAULTS: Final = frozenset({"Aborting", "Aborted", "Clearing"})


@dataclass(frozen=True, slots=True)
class StartOrder:
    """To be done: an order."""

    recipe: str
    quantity: int
    serial: str


@dataclass(frozen=True, slots=True)
class StopCell:
    """To be done: stop the cell on a ramp."""


Action = StartOrder | StopCell


class Handshake:
    """What cell and PLC have told each other.

    Parameters
    ----------
    recipes : name of the recipe of each number
    now_s : monotonic clock [s]
    """

    def __init__(self, recipes: Mapping[int, str], now_s: float) -> None:
        self._recipes = recipes
        self._began_s = now_s
        self._now_s = now_s
        self._command = Command()
        self._last_bits = CommandBit.START  # so that one that is high already is no edge
        self._beat: tuple[int, float] | None = None
        self._has_beaten = False
        self._state: CellState | None = None
        self._order: OrderState | None = None
        self._is_pending = False
        self._is_acknowledged = False
        self._failed_by: CommandBit | None = None
        self._reason = FailureReason.NONE
        self._alarm = 0
        self._shown: PartResult | None = None
        self._is_valid = False
        self._waiting = 0
        self._registers = [0] * COUNT
        self._registers[VERSION] = MAP_VERSION

    # what happens

    def write(self, command: Command, now_s: float) -> tuple[Action, ...]:
        """Take in what the PLC has written; return what is to be done."""
        self._now_s = now_s
        bits, before = command.bits, self._last_bits
        rising, falling = bits & ~before, before & ~bits
        if self._beat is None:
            self._beat = (command.heartbeat, now_s)
        elif self._beat[0] != command.heartbeat:
            self._beat, self._has_beaten = (command.heartbeat, now_s), True
        self._command, self._last_bits = command, bits
        actions: list[Action] = []
        if self._failed_by is not None and self._failed_by & falling:
            self._failed_by = None
        if falling & CommandBit.START:
            self._is_acknowledged = False
        if rising & CommandBit.RESET:
            self._failed_by, self._reason = None, FailureReason.NONE
        if rising & CommandBit.STOP:
            actions.append(StopCell())
        if rising & CommandBit.START:
            actions += self._start(command)
        if rising & CommandBit.RESULT_ACKNOWLEDGED and self._is_valid:
            self._shown, self._is_valid = None, False
            self._waiting = max(0, self._waiting - 1)
        self._show()
        return tuple(actions)

    def see(self, state: CellState) -> None:
        """Take in the state of the cell."""
        self._state = state
        if not state.alarms:
            self._alarm = 0

    def alarm(self, number: int) -> None:
        """Take in an alarm's number; it stands until the cell has no alarm."""
        self._alarm = number

    def taken(self, order: OrderState) -> None:
        """Take in what became of the order that was asked for, or of one of before a restart."""
        if self._is_pending:
            self._is_pending = False
            self._is_acknowledged = bool(self._last_bits & CommandBit.START)
        self._order = order if order.is_open else None
        if order.state == "refused":
            self._is_acknowledged = False
            self.fail(CommandBit.START, FailureReason.ORDER_REFUSED)

    def abandon(self) -> None:
        """Take note that what was to be done is not: the wire was interrupted."""
        if self._is_pending:
            self.fail(CommandBit.START, FailureReason.NOT_READY)

    def fail(self, command: CommandBit, reason: FailureReason) -> None:
        """Tell the PLC that a command was not carried out."""
        if command == CommandBit.START:
            self._is_pending = False
        self._failed_by, self._reason = command, reason

    def show(self, result: PartResult, values: tuple[str, ...]) -> None:
        """Show a result as soon as the PLC has dropped its acknowledgement of the last one.

        Parameters
        ----------
        result : of an order of the PLC
        values : ids of the characteristics, in the PLC's order

        Raises
        ------
        ValueError : another one is shown
        """
        if self._shown is not None and self._shown.key != result.key:
            raise ValueError("a result is shown that the PLC has not acknowledged")
        self._shown = result
        for address, value in result_registers(result, values).items():
            self._registers[address] = value
        self._show()

    def count_waiting(self, count: int) -> None:
        """Take in how many results wait for the PLC, the shown one among them."""
        self._waiting = count

    # what is so

    @property
    def order(self) -> OrderState | None:
        """The order of the PLC that is not over."""
        return self._order

    @property
    def is_shown(self) -> bool:
        """Whether a result waits for the PLC's acknowledgement."""
        return self._shown is not None

    def registers(self, now_s: float) -> list[int]:
        """Return what the PLC reads of the cell's part of the map.

        Parameters
        ----------
        now_s : monotonic clock [s]
        """
        self._now_s = now_s
        found = list(self._registers)
        found[STATUS] = int(self._status())
        found[PACKML] = PACKML_NUMBERS[self._state.packml] if self._state else 0
        found[ALARM] = self._alarm
        found[REFUSAL] = int(self._reason)
        found[HEARTBEAT] = int((now_s - self._began_s) / HEARTBEAT_S) % 0x10000
        return found

    def _status(self) -> Status:
        found, state = Status(0), self._state
        if state is not None and state.online and state.state != "unknown":
            found |= Status.ONLINE
        if self._bar() is FailureReason.NONE:
            found |= Status.READY
        if self._is_pending or self._order is not None:
            found |= Status.BUSY
        if self._is_valid:
            found |= Status.RESULT_VALID
        if self._is_acknowledged:
            found |= Status.START_ACKNOWLEDGED
        if self._failed_by is not None:
            found |= Status.COMMAND_FAILED
        if state is not None:
            if state.question is not None or state.packml == "Held":
                found |= Status.HELD
            if state.packml in FAULTS:
                found |= Status.FAULT
            if state.may_start != "never":
                found |= Status.REMOTE_ALLOWED
        return found

    def _show(self) -> None:
        if self._shown is not None and not self._last_bits & CommandBit.RESULT_ACKNOWLEDGED:
            self._is_valid = True

    def _start(self, command: Command) -> list[Action]:
        self._failed_by, self._reason = None, FailureReason.NONE
        reason = self._bar()
        quantity = command.quantity or 1
        name = self._recipes.get(command.recipe)
        if reason is FailureReason.NONE and name is None:
            reason = FailureReason.UNKNOWN_RECIPE
        if reason is FailureReason.NONE and (
            command.serial is None or (command.serial and quantity > 1)
        ):
            reason = FailureReason.BAD_SERIAL
        if reason is not FailureReason.NONE or name is None:
            self._failed_by, self._reason = CommandBit.START, reason
            return []
        self._is_pending = True
        return [StartOrder(name, quantity, command.serial or "")]

    def _bar(self) -> FailureReason:
        """Return what keeps a start from being taken, whatever its recipe."""
        state = self._state
        if self._is_pending or self._order is not None:
            return FailureReason.BUSY
        if self._command.bits & CommandBit.STOP:
            return FailureReason.STOP_BIT_IS_SET
        if not self._plc_is_alive():
            return FailureReason.HEARTBEAT_STANDS
        if state is not None and state.may_start == "never":
            return FailureReason.REMOTE_NOT_ALLOWED
        if self._waiting >= MAX_WAITING:
            return FailureReason.RESULTS_WAIT
        if state is None or not state.online or not state.is_ready:
            return FailureReason.NOT_READY
        return FailureReason.NONE

    def _plc_is_alive(self) -> bool:
        return (
            self._beat is not None and self._has_beaten and self._now_s - self._beat[1] < STANDS_S
        )
