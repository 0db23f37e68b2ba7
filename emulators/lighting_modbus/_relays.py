"""Waveshare Modbus RTU Relay 8CH: eight relays, with the vendor's own commands in FC05.

Source: modbus_devices.md 6.2, protocol V2.
"""

from typing import Final

from emulators.modbus import COIL_OFF, COIL_ON, Point, PointMap

from ._waveshare import CHANNEL_COUNT, WaveshareModule

TOGGLE: Final = 0x5500
ALL_ON_TOO: Final = 0xFFFF  # the wiki's other spelling of FF00 for all relays
ALL_RELAYS: Final = 0x00FF
TOGGLE_ALL: Final = 0x01FF
FLASH_ON: Final = 0x0200
FLASH_OFF: Final = 0x0400
FLASH_UNIT_S: Final = 0.1
_FUNCTIONS: Final = frozenset({0x01, 0x03, 0x05, 0x06, 0x0F})
_EPSILON_S: Final = 1e-9  # steps of 1/240 s do not add up to round numbers


class Relay8Device(WaveshareModule):
    """The module; `advance` ends flashes."""

    def __init__(self, unit: int = 1) -> None:
        super().__init__(unit)
        self._is_closed = [False] * CHANNEL_COUNT
        self._flash_left_s: dict[int, float] = {}
        coils = {channel: self._relay(channel) for channel in range(CHANNEL_COUNT)}
        coils[ALL_RELAYS] = Point(
            write=self._set_all, accepts=lambda v: v in (COIL_ON, COIL_OFF, ALL_ON_TOO)
        )
        coils[TOGGLE_ALL] = Point(write=self._toggle_all)
        for channel in range(CHANNEL_COUNT):
            coils[FLASH_ON + channel] = self._flash(channel, is_closing=True)
            coils[FLASH_OFF + channel] = self._flash(channel, is_closing=False)
        self._points = PointMap(_FUNCTIONS, coils=coils, holdings=self.settings())

    def is_closed(self, channel: int) -> bool:
        """Return whether a relay's contact is closed, channels from 0."""
        return self._is_closed[channel]

    def _reset_outputs(self) -> None:
        self._is_closed = [False] * CHANNEL_COUNT
        self._flash_left_s.clear()

    def request(self, pdu: bytes, now_s: float) -> bytes | None:
        """Return the reply to one request; None without power."""
        return self._points.answer(pdu) if self.is_powered else None

    def advance(self, dt_s: float) -> None:
        """Let time pass [world s]."""
        if not self._flash_left_s:
            return
        for channel, left_s in list(self._flash_left_s.items()):
            if left_s - dt_s > _EPSILON_S:
                self._flash_left_s[channel] = left_s - dt_s
            else:
                self._switch(channel, is_closed=not self._is_closed[channel])

    def _switch(self, channel: int, *, is_closed: bool) -> None:
        self._flash_left_s.pop(channel, None)
        self._is_closed[channel] = is_closed

    def _relay(self, channel: int) -> Point:
        def write(word: int) -> None:
            is_closed = not self._is_closed[channel] if word == TOGGLE else word == COIL_ON
            self._switch(channel, is_closed=is_closed)

        return Point(
            lambda: self._is_closed[channel], write, lambda v: v in (COIL_ON, COIL_OFF, TOGGLE)
        )

    def _flash(self, channel: int, *, is_closing: bool) -> Point:
        def write(word: int) -> None:
            self._switch(channel, is_closed=is_closing)
            self._flash_left_s[channel] = word * FLASH_UNIT_S

        return Point(write=write)

    def _set_all(self, word: int) -> None:
        for channel in range(CHANNEL_COUNT):
            self._switch(channel, is_closed=word != COIL_OFF)

    def _toggle_all(self, _: int) -> None:
        for channel in range(CHANNEL_COUNT):
            self._switch(channel, is_closed=not self._is_closed[channel])
