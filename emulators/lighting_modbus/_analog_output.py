"""Waveshare Modbus RTU Analog Output 8CH (B): eight outputs of 0 to 10 V.

Source: modbus_devices.md 6.1. Values over range are not documented by the vendor; as the page
advises, they get exception 03. Outputs keep their value when the master goes away.
"""

from typing import Final

from emulators.modbus import Point, PointMap

from ._waveshare import CHANNEL_COUNT, WaveshareModule

FULL_SCALE_MV: Final = 10_000
DAC_STEPS: Final = 4095  # 12 bit
_FUNCTIONS: Final = frozenset({0x03, 0x06, 0x10})


class AnalogOutput8Device(WaveshareModule):
    """The module. Registers read back the values written, outputs are the DAC's voltages."""

    def __init__(self, unit: int = 1) -> None:
        super().__init__(unit)
        self._asked_mv = [0] * CHANNEL_COUNT
        self._output_mv = [0.0] * CHANNEL_COUNT
        channels = {channel: self._channel(channel) for channel in range(CHANNEL_COUNT)}
        self._points = PointMap(_FUNCTIONS, holdings=channels | self.settings())

    def _channel(self, channel: int) -> Point:
        def write(millivolts: int) -> None:
            self._asked_mv[channel] = millivolts
            code = round(millivolts * DAC_STEPS / FULL_SCALE_MV)
            self._output_mv[channel] = code * FULL_SCALE_MV / DAC_STEPS

        return Point(lambda: self._asked_mv[channel], write, lambda mv: mv <= FULL_SCALE_MV)

    def output_mv(self, channel: int) -> float:
        """Return the voltage at a terminal, channels from 0 [mV]."""
        return self._output_mv[channel]

    def _reset_outputs(self) -> None:
        self._asked_mv = [0] * CHANNEL_COUNT  # assumed, modbus_devices.md 6.1
        self._output_mv = [0.0] * CHANNEL_COUNT

    def request(self, pdu: bytes, now_s: float) -> bytes | None:
        """Return the reply to one request; None without power."""
        return self._points.answer(pdu) if self.is_powered else None
