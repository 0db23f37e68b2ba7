"""One Intelligent Peripheral: its answer to a complete request, and the request's effect.

Transcript of umi_rtx.md 2 (commands) and, where that is silent, umi_rtx.md 7. Knows neither
framing nor time.
"""

from typing import Final

from ._axes import CONTROLLER_COUNT
from ._faults import Faults
from ._model import ArmModel
from ._motor import Motor, Parameter
from ._routines import home, soak

ACK: Final = b"\x00"
BUSY: Final = b"\x03"
OUT_OF_RANGE: Final = b"\x05"
READ_ONLY: Final = b"\x06"
BAD_CONTROLLER: Final = b"\x08"
UNKNOWN: Final = b"\x09"

REVISION: Final = 2  # placeholders, as in umi_rtx.md 3.1
VERSION: Final = 3
IO_MASK: Final = 0x3F  # six lines; umi_rtx.md 2.5
SUPPLY_LINE: Final = 0x01  # IP1's line 0: motor power present; umi_rtx.md 8.9


def request_length(opcode: int) -> int:
    """Return the length in bytes of a request that begins with ``opcode``; umi_rtx.md 2.1."""
    is_long = (
        0x18 <= opcode <= 0x1D or 0x58 <= opcode <= 0x67 or 0x70 <= opcode <= 0x80 or opcode >= 0xC0
    )
    return 3 if is_long else 1


def signed16(low: int, high: int) -> int:
    """Return the value of two data bytes; umi_rtx.md 2.2."""
    return int.from_bytes((low, high), "little", signed=True)


def with_checksum(reply_class: int, value: int) -> bytes:
    """Return reply class and checksum, low and high byte of a value; umi_rtx.md 2.2."""
    low, high = value & 0xFF, value >> 8 & 0xFF
    folded = low ^ high
    return bytes((reply_class | (folded >> 4 ^ folded & 0x0F), low, high))


def signed_nibble(nibble: int) -> int:
    """Return the signed value of four bits."""
    return nibble - 16 if nibble > 7 else nibble


class Peripheral:
    """State of one IP.

    Parameters
    ----------
    number : 0 or 1
    model : the body whose motors this IP drives
    faults : shared with the wire
    """

    def __init__(self, number: int, model: ArmModel, faults: Faults) -> None:
        self.number = number
        self.is_restarted = True
        self.auto_toggle = False
        self.is_dead = False
        self._model = model
        self._faults = faults
        self._motors = model.motors[number]
        self._read_selection: int | None = None
        self._write_selection: int | None = None
        self._lines_out = 0
        self._lines_are_inputs = False
        self._lines_changed = False
        self._seen_supply_changes = 0

    def restart(self) -> None:
        """Lose everything: the state after power-up, a supply dip or `20`."""
        self._model.restart_ip(self.number)
        self.is_restarted = True
        self.auto_toggle = False
        self._read_selection = self._write_selection = None
        self._lines_out = 0
        self._lines_are_inputs = self._lines_changed = False
        self._seen_supply_changes = self._model.supply_change_count

    def execute(self, request: bytes) -> tuple[bytes, bool]:
        """Obey a complete request; return the reply, and whether the line is handed over."""
        opcode = request[0]
        if self.is_restarted:
            if opcode != 0x00:
                return bytes((self._faults.restart_code,)), False
            self.is_restarted = False
            return ACK, False
        if opcode == 0x20:
            self.restart()
            return ACK, self._faults.reset_toggles
        reply = self._obey(opcode, request)
        return reply, opcode == 0x29 or (self.auto_toggle and opcode != 0x28)

    def _obey(self, opcode: int, request: bytes) -> bytes:
        if opcode < 0x40:
            return self._simple(opcode, request)
        if opcode < 0x80:
            return self._parameter(opcode, request)
        if opcode == 0x80:
            actions = request[1] | request[2] << 8
            self._model.go_manual(
                self.number, [actions >> 2 * ctl & 3 for ctl in range(CONTROLLER_COUNT)]
            )
            return ACK
        if opcode < 0xA0:
            return UNKNOWN
        if opcode < 0xC0:
            ctls = [ctl for ctl in range(CONTROLLER_COUNT) if opcode >> ctl & 1]
            if self._faults.sticky_busy or not self._model.go_numeric(self.number, ctls):
                return BUSY
            return ACK
        nibbles = (request[1], request[1] >> 4, request[2], request[2] >> 4, opcode)
        self._model.nudge(self.number, [signed_nibble(nibble & 0x0F) for nibble in nibbles])
        return ACK

    # --- simple commands; umi_rtx.md 2.3, 2.4, 2.8 --------------------------------------------

    def _simple(self, opcode: int, request: bytes) -> bytes:
        if 0x10 <= opcode <= 0x17:
            return self._status(opcode)
        if 0x18 <= opcode <= 0x1D:
            return self._mode(opcode, request[1])
        model, ip = self._model, self.number
        match opcode:
            case 0x00 | 0x01:
                return bytes((0x20 | ip,))
            case 0x08:
                model.run_routine(ip, home(model, ip))
            case 0x09 | 0x0A:
                model.run_routine(ip, soak(model, ip, home_first=opcode == 0x0A))
            case 0x0B | 0x24:
                model.stop(ip, ramp=False)
            case 0x21:
                for motor in self._motors:
                    motor.zero_counter()
            case 0x22:
                for motor in self._motors:
                    motor.load_defaults()
            case 0x25:
                model.stop(ip, ramp=True)
            case 0x26:
                model.set_power(ip, on=False)
            case 0x27:
                model.set_power(ip, on=True)
            case 0x28:
                self.auto_toggle = False
            case 0x29:
                pass
            case 0x2A:
                self.auto_toggle = True
            case 0x38:
                return bytes((0x20 | ip, REVISION, VERSION))
            case _:
                return UNKNOWN
        return ACK

    def _status(self, opcode: int) -> bytes:
        if opcode == 0x17:
            return bytes((opcode, self._general_status(), 0x00))
        ctl = opcode & 7
        if ctl >= CONTROLLER_COUNT:
            return BAD_CONTROLLER
        return bytes((opcode, self._model.status(self.number, ctl), 0x00))

    def _general_status(self) -> int:
        status = 0
        for ctl in range(CONTROLLER_COUNT):
            status |= self._model.status(self.number, ctl) & 0x0F
        changes = self._model.supply_change_count
        if self._lines_changed or (self.number == 1 and changes != self._seen_supply_changes):
            status |= 0x10
        self._lines_changed = False
        self._seen_supply_changes = changes
        return status | self._lines_are_inputs * 0x20

    def _mode(self, opcode: int, ctl: int) -> bytes:
        if opcode >= 0x1C:  # the I/O lines have one direction per IP, whatever ctl says
            self._lines_are_inputs = opcode == 0x1C
            return ACK
        if ctl >= CONTROLLER_COUNT:
            return BAD_CONTROLLER
        motor = self._motors[ctl]
        if opcode <= 0x19:
            motor.is_force_mode = opcode == 0x19
        else:
            motor.is_relative = opcode == 0x1B
        return ACK

    # --- parameters; umi_rtx.md 2.5 -----------------------------------------------------------

    def _parameter(self, opcode: int, request: bytes) -> bytes:
        kind, ctl = opcode & 0xF8, opcode & 7
        if kind == 0x50:
            return UNKNOWN
        if kind == 0x60:  # frame 1: ctl bits and filler mean nothing, frame 2 names the ctl
            self._read_selection = request[1] if request[1] < Parameter.COUNT else None
            return OUT_OF_RANGE if self._read_selection is None else b"\xc0"
        if kind == 0x70:
            return self._select_write(request[1])
        if ctl >= CONTROLLER_COUNT:
            return BAD_CONTROLLER
        motor = self._motors[ctl]
        match kind:
            case 0x40:
                return with_checksum(0x80, motor.error)
            case 0x48:
                return with_checksum(0x80, motor.counter)
            case 0x58:
                motor.label(signed16(request[1], request[2]))
                return with_checksum(0xA0, signed16(request[1], request[2]))[:1]
            case 0x68:
                number, self._read_selection = self._read_selection, None
                if number is None:
                    return OUT_OF_RANGE
                return with_checksum(0xD0, self._read(motor, number))
            case _:
                number, self._write_selection = self._write_selection, None
                if number is None:
                    return OUT_OF_RANGE
                value = signed16(request[1], request[2])
                self._write(motor, number, value)
                return with_checksum(0xF0, value)[:1]

    def _select_write(self, number: int) -> bytes:
        self._write_selection = None
        if number >= Parameter.COUNT:
            return OUT_OF_RANGE
        if number == Parameter.ERROR:
            return READ_ONLY
        self._write_selection = number
        return b"\xe0"

    def _read(self, motor: Motor, number: int) -> int:
        match number:
            case Parameter.ERROR:
                return motor.error
            case Parameter.CURRENT_POSITION:
                return motor.counter
            case Parameter.CURRENT_FORCE:
                return motor.force
            case Parameter.USER_IO:
                return self._lines()
            case _:
                return motor.parameters[number]

    def _write(self, motor: Motor, number: int, value: int) -> None:
        match number:
            case Parameter.CURRENT_POSITION:
                motor.label(value)
            case Parameter.CURRENT_FORCE:
                pass  # the drive output follows from the servo
            case Parameter.USER_IO:
                before = self._lines()
                self._lines_out = value & IO_MASK
                self._lines_changed |= self._lines() != before
            case _:
                motor.parameters[number] = value

    def _lines(self) -> int:
        lines = 0 if self._lines_are_inputs else self._lines_out
        if self.number == 1:  # wired to the supply however the lines are set
            lines = lines & ~SUPPLY_LINE | (SUPPLY_LINE if self._model.has_supply else 0)
        return lines
