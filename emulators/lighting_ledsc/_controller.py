"""LedSC RGBW controller: four PWM channels, changes in a set time, settings after a restart.

Source: modbus_devices.md 6.3. How it is set when it leaves the factory is not known; here it is so
that a driver that does not set it up itself goes wrong: not live, with a slow transition.
"""

from collections.abc import Callable, Sequence
from typing import Final

from emulators.lighting_modbus import LampCharacter, LampWiring
from emulators.modbus import Point, PointMap

OUTPUTS: Final = 4
NARROW_OUTPUT: Final = 0  # channel A
NARROW_CYCLE: Final = 255
RESTART_AT: Final = 100
SLAVE_AT: Final = 1000
BAUD_AT: Final = 1001
PARITY_AT: Final = 1002
WIRING_AT: Final = 1003  # register of the outputs of red, green, blue and white
PARITIES: Final = (0, 2, 3)
SLOW_MS: Final = 1000
_MS: Final = 1e-3


class LedscDevice:
    """The controller.

    Parameters
    ----------
    unit : Modbus number
    cycle : PWM cycle it begins with

    Attributes
    ----------
    unit : the number it answers to; a new one holds from the next restart on
    restart_count : number of restarts so far
    """

    hears_broadcast = True

    def __init__(self, unit: int, cycle: int = NARROW_CYCLE) -> None:
        self.unit = unit
        self.restart_count = 0
        self._cycle = cycle
        self._slave = unit
        self._line = {BAUD_AT: 9600, PARITY_AT: 0}
        self._wiring = list(range(OUTPUTS))
        self._is_powered = True
        self._begin()
        self._points = PointMap(frozenset({0x03, 0x06, 0x10}), holdings=self._holdings())

    def _begin(self) -> None:
        self.unit = self._slave
        self._asked = [0] * OUTPUTS
        self._shown = [0] * OUTPUTS  # what the outputs are on their way to
        self._output = [0.0] * OUTPUTS
        self._slope = [0.0] * OUTPUTS  # shares of full light a second
        self._change_ms = SLOW_MS
        self._is_live = False

    @property
    def is_powered(self) -> bool:
        """Whether the supply is on; off, it is silent and dark."""
        return self._is_powered

    @is_powered.setter
    def is_powered(self, is_powered: bool) -> None:
        self._is_powered = is_powered
        if not is_powered:
            self._begin()

    def duty(self, colour: int) -> float:
        """Return the share of time for which the output of a colour is on, 0 to 1."""
        return self._output[self._wiring[colour]]

    def advance(self, dt_s: float) -> None:
        """Let time pass [world s]."""
        for colour in range(OUTPUTS):
            output = self._wiring[colour]
            away = self._target(colour) - self._output[output]
            reach = self._slope[output] * dt_s if self._change_ms else abs(away)
            self._output[output] += max(-reach, min(reach, away))

    def request(self, pdu: bytes, now_s: float) -> bytes | None:
        """Return the reply to one request; None without power.

        A block is written register by register, and shows once it is written whole.
        """
        if not self._is_powered:
            return None
        before = (list(self._shown), self._cycle)
        reply = self._points.answer(pdu)
        if self._is_live:
            self._shown = list(self._asked)
        if (self._shown, self._cycle) != before:
            self._set_out()
        return reply

    def _target(self, colour: int) -> float:
        most = (
            min(self._cycle, NARROW_CYCLE) if self._wiring[colour] == NARROW_OUTPUT else self._cycle
        )
        return min(self._shown[colour], most) / self._cycle

    def _set_out(self) -> None:
        """Begin the change to the wanted outputs, which all arrive at the same time."""
        for colour in range(OUTPUTS):
            output = self._wiring[colour]
            way = abs(self._target(colour) - self._output[output])
            self._slope[output] = way / (self._change_ms * _MS) if self._change_ms else 0.0
            if not self._change_ms:
                self._output[output] = self._target(colour)

    # --- registers ------------------------------------------------------------------------------

    def _holdings(self) -> dict[int, Point]:
        points = {colour: self._level(colour) for colour in range(OUTPUTS)}
        points |= {
            4: Point(lambda: self._change_ms, self._set_change),
            5: Point(lambda: int(self._is_live), self._set_live),
            6: Point(lambda: self._cycle, self._set_cycle, lambda word: word > 0),
            7: Point(lambda: 0),  # no sensor is connected
            8: Point(lambda: 0),
            RESTART_AT: Point(write=self._restart),
            SLAVE_AT: Point(lambda: self._slave, self._set_slave, lambda word: 1 <= word <= 247),
            BAUD_AT: self._line_setting(BAUD_AT, lambda word: 2400 <= word <= 57600),
            PARITY_AT: self._line_setting(PARITY_AT, lambda word: word in PARITIES),
        }
        return points | {WIRING_AT + colour: self._wired(colour) for colour in range(OUTPUTS)}

    def _level(self, colour: int) -> Point:
        def write(word: int) -> None:
            self._asked[colour] = word

        return Point(lambda: self._asked[colour], write)

    def _wired(self, colour: int) -> Point:
        def write(word: int) -> None:
            self._wiring[colour] = word

        return Point(lambda: self._wiring[colour], write, lambda word: word < OUTPUTS)

    def _line_setting(self, at: int, accepts: Callable[[int], bool]) -> Point:
        def write(word: int) -> None:
            self._line[at] = word

        return Point(lambda: self._line[at], write, accepts)

    def _set_change(self, word: int) -> None:
        self._change_ms = word

    def _set_live(self, word: int) -> None:
        self._is_live = word != 0

    def _set_cycle(self, word: int) -> None:
        self._cycle = word

    def _set_slave(self, word: int) -> None:
        self._slave = word

    def _restart(self, word: int) -> None:
        if word:
            self.restart_count += 1
            self._begin()


class LedscSupply:
    """The lamps' drive by several controllers; a `LampSupply`.

    Parameters
    ----------
    devices : in the order of their channels
    """

    def __init__(self, devices: Sequence[LedscDevice]) -> None:
        self._devices = tuple(devices)

    def drive(self, wiring: LampWiring, character: LampCharacter, *, is_wire_broken: bool) -> float:
        """Return the drive of a lamp's LEDs, 0 to 1.

        Parameters
        ----------
        wiring : its channel, counted through all controllers; its relay is not there
        character : response of the light to the drive
        is_wire_broken : the LEDs' own wire; they are dark then
        """
        number, colour = divmod(wiring.analog_channel, OUTPUTS)
        if is_wire_broken or number >= len(self._devices):
            return 0.0
        duty = self._devices[number].duty(colour)
        return duty if character.exponent == 1.0 else float(duty**character.exponent)
