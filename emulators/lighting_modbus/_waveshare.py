"""The common features of Waveshare's RTU modules: settings registers, number, version.

Source: modbus_devices.md 6.1 and 6.2.

Sections (§) are those of modbus_devices.md.
"""

from typing import Final

from emulators.modbus import Point

CHANNEL_COUNT: Final = 8
SERIAL_REGISTER: Final = 0x2000
ADDRESS_REGISTER: Final = 0x4000
VERSION_REGISTER: Final = 0x8000
VERSION_1_00: Final = 0x0064

BAUDRATES: Final = (4800, 9600, 19200, 38400, 57600, 115200, 128000, 256000)  # baudrates by code
PARITY_CODES: Final = 3  # none and two more, whose order the vendor gives in two versions (§6.2)


class WaveshareModule:
    """Settings of one module.

    Attributes
    ----------
    unit : Modbus number, writable at 0x4000
    parity_code, baudrate : values written at 0x2000; kept without effect here, since the reference
        does not say when a module changes over
    """

    hears_broadcast = True

    def __init__(self, unit: int) -> None:
        self.unit = unit
        self.parity_code = 0
        self.baudrate = 9600
        self._is_powered = True

    @property
    def is_powered(self) -> bool:
        """Whether the supply is on; off, the module is silent and forgets its outputs."""
        return self._is_powered

    @is_powered.setter
    def is_powered(self, is_powered: bool) -> None:
        self._is_powered = is_powered
        if not is_powered:
            self._reset_outputs()

    def _reset_outputs(self) -> None:
        """Set the outputs to their state after power-up."""
        raise NotImplementedError

    def settings(self) -> dict[int, Point]:
        """Return the settings registers."""
        return {
            SERIAL_REGISTER: Point(write=self._set_serial, accepts=_is_serial_setting),
            ADDRESS_REGISTER: Point(lambda: self.unit, self._set_unit, lambda v: 1 <= v <= 255),
            VERSION_REGISTER: Point(lambda: VERSION_1_00),
        }

    def _set_serial(self, word: int) -> None:
        self.parity_code = word >> 8
        self.baudrate = BAUDRATES[word & 0xFF]

    def _set_unit(self, word: int) -> None:
        self.unit = word


def _is_serial_setting(word: int) -> bool:
    return word >> 8 < PARITY_CODES and word & 0xFF < len(BAUDRATES)
